//! Translucency maps in a scene: requested, needed, left out, handed over, drawn.

#[cfg(feature = "render")]
mod drawn;

use crate::blade;
use crate::blade::{Blade, hashes};
use mesophyll::files::hash;
use mesophyll::files::image::{ChannelMaps, Packing, write_exr};
use mesophyll::fits::record::{FitKind, FitRecord, RecordSection};
use mesophyll::optics::side::Side;
use mesophyll::scene::loaded::LoadedScene;
use mesophyll::scene::manifest::SceneManifest;
use mesophyll::scene::placed::ledger::Ledger;
use mesophyll::scene::placed::{PlacedScene, leaf::LeafSearch};
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

/// Coefficient h_i of a flat, uniform leaf.
const FLAT: f64 = 0.835_542_4;

/// Writes made-up coefficients in the format of `fit translucency`: `h(side, column, row)`.
fn write_maps(dir: &Path, width: usize, height: usize, h: impl Fn(usize, usize, usize) -> [f64; 3]) {
    std::fs::create_dir_all(dir).unwrap();
    for (s, side) in ["front", "back"].iter().enumerate() {
        let mut maps = ChannelMaps::new(width, height);
        for i in 0..3 {
            let plane = (0..width * height).map(|k| h(s, k % width, k / width)[i] as f32).collect();
            maps.push(format!("translucency.{}", i + 1), plane);
        }
        write_exr(&dir.join(format!("{side}.exr")), &maps, Packing::Zip).unwrap();
    }
    let record = FitRecord {
        schema: 1,
        kind: FitKind::Translucency,
        name: "elm".into(),
        program: "test".into(),
        input_hash: hash::bytes(b"made up"),
        files: hashes(dir),
        sections: BTreeMap::from([
            ("front".to_string(), RecordSection::default()),
            ("back".to_string(), RecordSection::default()),
        ]),
        ..Default::default()
    };
    record.write(dir).unwrap();
}

/// Sets the basis of the maps' coefficients.
fn with_basis(maps: &Path, basis: &str) {
    let mut record = FitRecord::read(maps).unwrap();
    record.options.insert("basis".into(), basis.into());
    record.write(maps).unwrap();
}

/// A leaf whose transmitted light leans: on the left half more light comes from +x than from −x, and on the right half
/// less.
fn leaning(_: usize, column: usize, row: usize) -> [f64; 3] {
    let (x, y) = (column as f64 / 20.0, row as f64 / 15.0);
    [FLAT * (1.0 - 0.25 * x.sin()), FLAT * (1.0 + 0.2 * y.cos()), FLAT * (1.0 + 0.3 * x.sin())]
}

/// A scene whose leaf uses the maps.
fn scene(dir: &Path, name: &str, zenith: Option<f64>, sky: Option<f64>, extra: &str) -> PathBuf {
    let path = blade::scene(dir, name, "elm", zenith, sky, extra);
    let text = std::fs::read_to_string(&path).unwrap();
    let asks = "fit = \"fits/elm\"\ntranslucency = { fit = \"fits/elm-translucency\" }\n";
    std::fs::write(&path, text.replacen("fit = \"fits/elm\"\n", asks, 1)).unwrap();
    path
}

/// A folder with the leaf and its maps.
fn folder(blade: &Blade) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    blade.write(&dir.path().join("fits/elm"), "elm");
    write_maps(&dir.path().join("fits/elm-translucency"), blade.width, blade.height, leaning);
    dir
}

fn planned(path: &Path) -> (LoadedScene, Ledger) {
    let ledger = Ledger::new();
    (LoadedScene::open(SceneManifest::read(path).unwrap(), LeafSearch::default(), &ledger).unwrap(), ledger)
}

fn open(path: &Path, out: Option<&Path>) -> mesophyll::base::error::Result<LoadedScene> {
    LoadedScene::open(SceneManifest::read(path)?, LeafSearch { out, ..LeafSearch::default() }, &Ledger::new())
}

#[test]
fn a_leaf_that_is_never_back_lit_loads_no_map_and_says_so() {
    let dir = folder(&Blade { rho_s: [0.0, 0.0], ..Blade::default() });
    for (zenith, sky, word) in [(Some(30.0), None, "never back-lit"), (None, Some(1.0), "no sun")] {
        let (whole, ledger) = planned(&scene(dir.path(), "front", zenith, sky, ""));
        let plan = &whole.plan;
        for side in ["front", "back"] {
            let left =
                plan.left_out.iter().find(|l| l.name == format!("elm/translucency/{side}.exr")).expect("left out");
            assert!(left.reason.contains(word), "{}", left.reason);
            // The saving contains half floats with mips on the adapter, and the file.
            assert!(left.saved_bytes > 96 * 72 * 8, "{}", left.saved);
        }
        assert!(plan.needed.iter().all(|n| !n.name.contains("translucency")), "{:?}", plan.needed);
        assert!(ledger.entries().iter().all(|e| !e.what.contains("translucency")), "{:?}", ledger.entries());
        assert!(whole.placed.leaves[0].translucent.is_some());
        assert!(whole.loaded[0].coefficients.iter().all(|(_, c)| c.is_none()));
    }
}

#[test]
fn light_from_behind_needs_the_lit_sides_map_and_says_what_it_adds() {
    let dir = folder(&Blade::default());
    let (whole, ledger) = planned(&scene(dir.path(), "back", Some(140.0), None, ""));
    let plan = &whole.plan;
    let need = plan.needed.iter().find(|n| n.name == "elm/translucency/back.exr").expect("needed");
    assert!(need.reason.contains("enters the back"), "{}", need.reason);
    assert!(need.amount.as_ref().is_some_and(|a| a.contains("without it")), "{:?}", need.amount);
    assert!(need.hash.is_some() && need.bytes.is_some());
    assert!(plan.needed.iter().any(|n| n.name == "fit elm translucency"));
    let left = plan.left_out.iter().find(|l| l.name == "elm/translucency/front.exr").expect("the front's");
    assert!(left.reason.contains("never back-lit"), "{}", left.reason);
    // The mapped normal has no effect where the maps decide.
    assert!(!plan.leaves[0].sides[1].normal && plan.leaves[0].sides[1].rho_t);
    assert_eq!(ledger.count("read", "elm/translucency/back.exr"), 1);
    assert_eq!(ledger.count("read", "elm/translucency/front.exr"), 0);
    assert!(plan.left_out.iter().all(|l| l.name != "translucency maps"));
}

#[test]
fn maps_that_say_what_the_mapped_normal_says_are_left_out() {
    // For a flat blade without relief, f is n·ω.
    let flat = Blade { bump: 0.0, dome: 0.0, ..Blade::default() };
    let dir = folder(&flat);
    write_maps(&dir.path().join("fits/elm-translucency"), flat.width, flat.height, |_, _, _| [FLAT * 1.001; 3]);
    let (whole, _) = planned(&scene(dir.path(), "back", Some(140.0), None, ""));
    let plan = &whole.plan;
    let left = plan.left_out.iter().find(|l| l.name == "elm/translucency/back.exr").expect("left out");
    assert!(left.reason.contains("tolerates"), "{}", left.reason);
    assert!(!plan.leaves[0].sides[1].translucency && plan.leaves[0].sides[1].normal);
    assert!(plan.needed.iter().any(|n| n.name == "elm/back_normal"));
    // With an error of a tenth they are needed, and the figure is that tenth of the displayed value.
    write_maps(&dir.path().join("fits/elm-translucency"), flat.width, flat.height, |_, _, _| [FLAT * 1.1; 3]);
    let (whole, _) = planned(&scene(dir.path(), "back", Some(140.0), None, ""));
    let plan = &whole.plan;
    assert!(plan.leaves[0].sides[1].translucency);
}

#[test]
fn the_plan_is_the_contracts() {
    let dir = folder(&Blade::default());
    let path = scene(dir.path(), "back", Some(140.0), None, "");
    let output =
        assert_cmd::Command::cargo_bin("mesophyll").unwrap().arg("plan").arg(&path).arg("--json").output().unwrap();
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(json["needed"].as_array().unwrap().iter().any(|n| n["name"] == "elm/translucency/back.exr"), "{json:#}");
    for left in json["left_out"].as_array().unwrap() {
        for key in ["name", "reason", "saved"] {
            assert!(left[key].is_string(), "{left}");
        }
    }
}

#[test]
fn what_is_wrong_is_named() {
    let dir = folder(&Blade::default());
    let path = scene(dir.path(), "back", Some(140.0), None, "");
    // The folder has another kind of fit.
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("fits/elm-translucency", "fits/elm")).unwrap();
    let told = open(&path, None).unwrap_err().to_string();
    assert!(told.contains("kind") && told.contains("translucency"), "{told}");
    // The scene has an unknown field.
    std::fs::write(&path, text.replace("{ fit = \"fits/elm-translucency\" }", "{ map = \"x\" }")).unwrap();
    let told = SceneManifest::read(&path).unwrap_err().to_string();
    assert!(told.contains("map"), "{told}");
    // The maps have another size.
    std::fs::write(&path, &text).unwrap();
    write_maps(&dir.path().join("fits/elm-translucency"), 20, 10, leaning);
    let told = open(&path, None).unwrap_err().to_string();
    assert!(told.contains("20x10") && told.contains("96x72"), "{told}");
}

/// Writes the size of texels into a made-up leaf, as fits do.
fn with_texel(fit: &Path, texel_mm: f64) {
    let mut record = FitRecord::read(fit).unwrap();
    record.options.insert("texel_mm".into(), format!("{texel_mm:?}"));
    record.write(fit).unwrap();
}

#[cfg(feature = "render")]
#[test]
fn the_reference_convolves_and_a_flat_leafs_light_is_its_cosine() {
    use mesophyll::fits::translucency::TissueName;
    use mesophyll::scene::draw::reference;
    use mesophyll::scene::placed::fits::source::FitFreshness;
    use mesophyll::transport::SunlitMaps;

    let flat = Blade { width: 48, height: 36, texel_mm: 1.0, bump: 0.0, dome: 0.0, ..Blade::default() };
    let dir = tempfile::tempdir().unwrap();
    let fit = dir.path().join("fits/elm");
    flat.write(&fit, "elm");
    with_texel(&fit, flat.texel_mm);
    let path = scene(dir.path(), "back", Some(140.0), None, "");
    let manifest = SceneManifest::read(&path).unwrap();
    assert_eq!(manifest.leaves[0].translucency.as_ref().map(|t| t.tissue), Some(TissueName::Fit));
    let ledger = Ledger::new();
    let out = dir.path().join("out");
    let before = open(&path, Some(&out)).unwrap().plan;
    assert!(before.needed.iter().any(|n| n.name == "fit elm translucency" && n.status == Some(FitFreshness::Missing)));
    let search = LeafSearch { out: Some(&out), ..LeafSearch::default() };
    let mut placed = PlacedScene::new(&manifest, search, &ledger).unwrap();
    assert_eq!(placed.untranslucent(&manifest), [0]);
    placed.make_translucency(&manifest, &out, search, &ledger).unwrap();
    assert!(placed.untranslucent(&manifest).is_empty());
    let mut whole = LoadedScene::new(manifest, placed, &ledger).unwrap();
    // The plan would leave out maps that agree with the cosine. Here they are needed for the comparison.
    let plan = &mut whole.plan;
    assert!(
        !plan.leaves[0].sides[1].translucency && plan.left_out.iter().any(|l| l.name == "elm/translucency/back.exr")
    );
    plan.leaves[0].sides[1].translucency = true;
    let world = reference::world(&whole, &ledger).unwrap();
    let Some(SunlitMaps::Factor(map)) = &world.through[0].entering[1] else { panic!("no map") };
    let cosine = -(140f64.to_radians().cos());
    let off = map.iter().map(|f| (f64::from(*f) - cosine).abs()).fold(0.0, f64::max);
    assert!(off < 1e-3, "{off}");
    // The maps were made from another leaf, so they must be made again.
    Blade { h: 0.25, ..flat }.write(&fit, "elm");
    with_texel(&fit, 1.0);
    let after = open(&path, Some(&out)).unwrap().plan;
    assert!(
        after.needed.iter().any(|n| n.name == "fit elm translucency" && n.status == Some(FitFreshness::Stale)),
        "{:?}",
        after.needed
    );
}

#[test]
fn a_scene_asks_for_a_basis_and_what_no_renderer_evaluates_is_refused() {
    use mesophyll::scene::manifest::TranslucencyBasis;
    use mesophyll::scene::placed::fits::source::FitFreshness;

    let dir = folder(&Blade::default());
    let maps = dir.path().join("fits/elm-translucency");
    let path = scene(dir.path(), "back", Some(140.0), None, "");
    let text = std::fs::read_to_string(&path).unwrap();
    let asks = |basis: &str| {
        std::fs::write(
            &path,
            text.replace("elm-translucency\" }", &format!("elm-translucency\", basis = \"{basis}\" }}")),
        )
        .unwrap()
    };
    let status = |scene: &LoadedScene| scene.placed.leaves[0].translucent.as_ref().unwrap().source.status;
    // A named folder with another basis must be made again. One that states no basis has the published one.
    for (said, asked, wanted) in [
        (None, "half-life-2", FitFreshness::Reuse),
        (None, "bent-3", FitFreshness::Stale),
        (Some("half-life-2"), "bent-3", FitFreshness::Stale),
        (Some("bent-3"), "bent-3", FitFreshness::Reuse),
        (Some("bent-3"), "half-life-2", FitFreshness::Stale),
        (Some("h-basis-6"), "bent-3", FitFreshness::Stale),
        // The names of former versions.
        (Some("half-life 2"), "half-life 2", FitFreshness::Reuse),
        (Some("bent half-life 2, 3"), "bent", FitFreshness::Reuse),
    ] {
        if let Some(said) = said {
            with_basis(&maps, said);
        }
        asks(asked);
        assert_eq!(status(&open(&path, None).unwrap()), wanted, "{said:?} {asked}");
    }
    // Where the scene requests no basis, either is read. Others are refused.
    std::fs::write(&path, &text).unwrap();
    with_basis(&maps, "bent-3");
    let read = open(&path, None).unwrap();
    assert_eq!(read.loaded[0].coefficients[Side::Back].as_ref().unwrap().basis, TranslucencyBasis::Bent);
    for other in ["h-basis-6", "bent-6", "none: one light"] {
        with_basis(&maps, other);
        let told = open(&path, None).unwrap_err().to_string();
        let expected = "expected \"half-life-2\" or \"bent-3\"";
        assert!(told.contains("options.basis") && told.contains(other) && told.contains(expected), "{told}");
    }
    // A value that names no basis is refused with its line.
    asks("curved");
    let told = SceneManifest::read(&path).unwrap_err().to_string();
    assert!(
        told.contains("back.toml:7")
            && told.contains("curved")
            && told.contains("`half-life-2`")
            && told.contains("`bent-3`"),
        "{told}"
    );
}

#[test]
fn maps_are_made_in_the_basis_that_the_scene_asks_for() {
    use mesophyll::scene::manifest::TranslucencyBasis;
    use mesophyll::scene::placed::fits::source::FitFreshness;

    let flat = Blade { width: 48, height: 36, texel_mm: 1.0, ..Blade::default() };
    let dir = tempfile::tempdir().unwrap();
    flat.write(&dir.path().join("fits/elm"), "elm");
    with_texel(&dir.path().join("fits/elm"), flat.texel_mm);
    let path = scene(dir.path(), "back", Some(115.0), None, "");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("{ fit = \"fits/elm-translucency\" }", "{ basis = \"bent\" }")).unwrap();
    let (ledger, out) = (Ledger::new(), dir.path().join("out"));
    let manifest = SceneManifest::read(&path).unwrap();
    let search = LeafSearch { out: Some(&out), ..LeafSearch::default() };
    let mut placed = PlacedScene::new(&manifest, search, &ledger).unwrap();
    placed.make_translucency(&manifest, &out, search, &ledger).unwrap();
    let whole = LoadedScene::new(manifest, placed, &ledger).unwrap();
    let translucent = whole.placed.leaves[0].translucent.as_ref().unwrap();
    assert_eq!(translucent.source.status, FitFreshness::Reuse);
    assert!(translucent.fitted.as_ref().unwrap().record.options["basis"] == "bent-3");
    assert_eq!(whole.loaded[0].coefficients[Side::Back].as_ref().map(|m| m.basis), Some(TranslucencyBasis::Bent));
    // The basis is no longer requested, so a run's own maps are made again with the published one.
    std::fs::write(&path, text.replace("{ fit = \"fits/elm-translucency\" }", "{}")).unwrap();
    let after = open(&path, Some(&out)).unwrap().placed;
    assert_eq!(after.leaves[0].translucent.as_ref().unwrap().source.status, FitFreshness::Stale);
}

#[test]
fn a_leaf_may_be_drawn_from_another_ones_data() {
    let dir = folder(&Blade::default());
    let path = scene(
        dir.path(),
        "back",
        Some(140.0),
        None,
        "[[leaf]]\nname = \"plain\"\nlike = \"elm\"\n[[instance]]\nleaf = \"plain\"\nposition_mm = [70, 0, 0]\n",
    );
    let (whole, _) = planned(&path);
    let plan = &whole.plan;
    assert!(plan.leaves[0].sides[1].translucency && !plan.leaves[1].sides[1].translucency);
    let folder = |k: usize| whole.placed.leaves[k].fitted.as_ref().map(|f| &f.folder);
    assert_eq!(folder(0), folder(1));
    let text = std::fs::read_to_string(&path).unwrap();
    for (from, to, word) in [
        ("like = \"elm\"", "like = \"oak\"", "oak"),
        (
            "like = \"elm\"",
            "like = \"elm\"\nfit = \"fits/elm\"",
            "leaf.fit: given, but leaf \"plain\" is like another one",
        ),
        ("like = \"elm\"", "like = \"plain\"", "like another one itself"),
    ] {
        std::fs::write(&path, text.replace(from, to)).unwrap();
        let told = SceneManifest::read(&path).unwrap_err().to_string();
        assert!(told.contains(word), "{told}");
    }
}

#[test]
fn a_tree_shares_one_data_set_among_its_leaves() {
    let dir = folder(&Blade { rho_s: [0.0, 0.0], ..Blade::default() });
    let sapling = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/plants/bird-cherry-sapling.toml");
    let tree = format!("[[plant]]\ngrow = {sapling:?}\nmaterials = {{ leaf = \"elm\", bark = [0.1, 0.1, 0.1] }}\n");
    let (whole, _) = planned(&scene(dir.path(), "tree", Some(50.0), None, &tree));
    let plan = &whole.plan;
    assert_eq!(whole.placed.placements.len(), 231);
    assert!(!whole.placed.wood.is_empty() && plan.light.shadow_samples > 0);
    assert_eq!(plan.needed.iter().filter(|n| n.name == "elm/blade.glb").count(), 1);
}
