//! Whole scenes: the committed ones can be read, a run makes missing data and nothing twice, and an edit solves the
//! slab again.

use crate::blade::{Blade, scene};
use crate::common::{refused, run, succeeded};
use crate::skips;
use mesophyll::base::tone::ToneCurve;
use mesophyll::files::quantity::Quantity;
use mesophyll::scene::draw::reference;
use mesophyll::scene::loaded::LoadedScene;
use mesophyll::scene::manifest::SceneManifest;
use mesophyll::scene::placed::{leaf::LeafSearch, ledger::Ledger};
use std::path::Path;

#[test]
fn every_committed_scene_reads_and_has_its_card() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/scenes");
    let mut names = Vec::new();
    for entry in
        std::fs::read_dir(folder).unwrap().flatten().filter(|e| e.path().extension().is_some_and(|x| x == "toml"))
    {
        let manifest = SceneManifest::read(&entry.path()).unwrap();
        assert_eq!(entry.path().file_stem().unwrap().to_str().unwrap(), manifest.name);
        let cards = manifest.cards().count();
        assert!(cards == 1 || manifest.name == "fits", "{}: {cards} cards", manifest.name);
        names.push(manifest.name);
    }
    for name in
        ["front-lit", "glossy-sky", "back-lit", "cluster", "twig", "demo", "fits", "sky", "day", "translucency", "tree"]
    {
        assert!(names.iter().any(|n| n == name), "{name} of {names:?}");
    }
}

/// A scene with a tiny scan that must be made first.
fn scanned(dir: &Path, seed: u64) -> std::path::PathBuf {
    let spec = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/leaves/elm.toml");
    let path = scene(dir, "tiny", "elm", Some(30.0), None, "");
    let scan = format!(
        "scan = {{ spec = {:?}, size = \"40x30\", frames = 24, noise = 0.01, seed = {seed} }}",
        spec.display().to_string()
    );
    let text = std::fs::read_to_string(&path).unwrap().replace("fit = \"fits/elm\"", &scan);
    // This tests that the stages follow each other, and not how well such a coarse leaf is drawn.
    std::fs::write(
        &path,
        text.replace("flip_p99 = 0.15", "flip_p99 = 1.0").replace("max_error = 0.012", "max_error = 1.0"),
    )
    .unwrap();
    path
}

#[test]
fn a_run_makes_what_is_missing_and_nothing_twice() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let run = |path: &Path| {
        assert_cmd::Command::cargo_bin("mesophyll")
            .unwrap()
            .arg("run")
            .arg(path)
            .arg("--out")
            .arg(&out)
            .output()
            .unwrap()
    };
    let done = |what: &str| {
        let ledger: serde_json::Value =
            serde_json::from_slice(&std::fs::read(out.join("ledger.json")).unwrap()).unwrap();
        ledger["entries"].as_array().unwrap().iter().filter(|e| e["action"] == what).count()
    };
    let first = run(&scanned(dir.path(), 1));
    let said = String::from_utf8_lossy(&first.stderr).into_owned();
    let drawn = !skips::no_adapter(&first);
    assert_eq!(first.status.code(), Some(if drawn { 0 } else { 1 }), "{said}");
    for file in ["fits/elm/fit.toml", "captures/elm/capture.toml", "plan.json", "report.html"] {
        assert!(out.join(file).is_file(), "{file}: {said}");
    }
    assert_eq!((done("scan"), done("fit")), (1, 1));
    if drawn {
        assert!(out.join("check.json").is_file() && out.join("above.png").is_file());
        // Beside the picture lie the reference, the FLIP map and the difference, and their scales are stated.
        let check: serde_json::Value = serde_json::from_slice(&std::fs::read(out.join("check.json")).unwrap()).unwrap();
        let view = &check["views"][0];
        for picture in ["image", "reference", "difference", "flip"] {
            assert!(out.join(view[picture].as_str().unwrap()).is_file(), "{picture}: {view}");
        }
        assert!(view["flip_top"].as_f64().unwrap() >= 2.0 * view["flip_p99"].as_f64().unwrap(), "{view}");
        assert!((view["difference_top"].as_f64().unwrap() - 0.0627).abs() < 1e-3, "{view}");
        let page = std::fs::read_to_string(out.join("report.html")).unwrap();
        assert!(
            page.contains("FLIP map: how visible") && page.contains("Renderer minus reference"),
            "the pictures of the page"
        );
    }
    let record = std::fs::read(out.join("fits/elm/fit.toml")).unwrap();
    run(&scanned(dir.path(), 1));
    assert_eq!((done("scan"), done("fit")), (0, 0), "an up-to-date fit was made again");
    assert_eq!(std::fs::read(out.join("fits/elm/fit.toml")).unwrap(), record);
    run(&scanned(dir.path(), 2));
    assert_eq!((done("scan"), done("fit")), (1, 1), "a stale fit was not made again");
    assert_ne!(std::fs::read(out.join("fits/elm/fit.toml")).unwrap(), record);
}

#[cfg(feature = "render")]
#[test]
fn a_thicker_leaf_dims_and_an_edit_becomes_a_fit() {
    use mesophyll::fits::record::FitRecord;
    use mesophyll::optics::slab;
    use mesophyll::scene::loaded::LoadedScene;
    use mesophyll::scene::placed::{leaf::LeafSearch, ledger::Ledger};
    use mesophyll::scene::window::edit::SceneEditor;
    use mesophyll_viewer::scene::{Interior, Side};
    use mesophyll_window::edit::{Edit, EditQuantity, EditTarget, Edits};
    use mesophyll_window::editor::Editor;

    let dir = tempfile::tempdir().unwrap();
    let blade = Blade { width: 48, height: 36, texel_mm: 1.0, ..Blade::default() };
    blade.write(&dir.path().join("fits/elm"), "elm");
    let manifest = SceneManifest::read(&scene(dir.path(), "front", "elm", Some(30.0), None, "")).unwrap();
    let free = LoadedScene::open(manifest, LeafSearch { free: true, ..LeafSearch::default() }, &Ledger::new()).unwrap();
    let mut editor = SceneEditor::new(free, dir.path().join("out")).unwrap();
    let start = editor.start(0).get(EditTarget::Leaf(0), EditQuantity::Thickness).unwrap();
    assert!((start - blade.h).abs() < 1e-6);
    let thick = |value: f64| -> Edits {
        let thickness = Edit { target: EditTarget::Leaf(0), quantity: EditQuantity::Thickness, value };
        let target = EditTarget::LeafSide(0, Side::Front);
        [thickness, Edit { target, quantity: EditQuantity::RhoS, value: 0.5 }].into_iter().collect()
    };
    let sides = editor.recompute(0, &thick(2.0 * start)).unwrap();
    let Interior::Scalars(curve) = &sides.back else { panic!("scalars") };
    // ρt of the doubled blade, from the slab itself at the ends of the curve.
    for (h, rho_t) in [(curve.min_mm, curve.rho_t[0]), (curve.max_mm, curve.rho_t[curve.rho_t.len() - 1])] {
        for (c, found) in rho_t.into_iter().enumerate() {
            let exact = slab::medium::response(blade.sigma_a[1][c], blade.sigma_s[1][c], f64::from(h)).rho_t;
            assert!((f64::from(found) / exact - 1.0).abs() < 1e-5);
            assert!(exact < slab::medium::response(blade.sigma_a[1][c], blade.sigma_s[1][c], blade.h).rho_t);
        }
    }
    assert!(editor.recompute(0, &thick(-1.0)).unwrap_err().contains("expected a positive thickness"));
    let place = editor.save(0, &thick(2.0 * start)).unwrap();
    let record = FitRecord::read(Path::new(&place)).unwrap();
    record.verify(Path::new(&place)).unwrap();
    let h = &record.sections["front"].params["thickness"];
    assert!((h.value[0] - 2.0 * blade.h).abs() < 1e-6 && h.stderr[0].is_infinite());
    let maps = mesophyll::files::image::read_exr(&Path::new(&place).join("front.exr")).unwrap();
    let k = 18 * 48 + 24;
    let thickness = f64::from(maps.scalar(Quantity::Thickness).unwrap()[k]);
    let exact = slab::medium::response(blade.sigma_a[0][1], blade.sigma_s[0][1], thickness).rho_t;
    assert!((f64::from(maps.plane(Quantity::RhoT, 1).unwrap()[k]) / exact - 1.0).abs() < 1e-5);
    assert!((maps.plane(Quantity::RhoS, 1).unwrap()[k] - 0.025).abs() < 1e-6);
    // The read-out of the texel under the pointer is the fit's value.
    let rows = editor.probe(0, Side::Front, [24, 18]);
    assert!(
        rows.iter().any(|(n, _)| n.starts_with("σa")) && rows.iter().any(|(n, v)| n == "texel" && v == "good"),
        "{rows:?}"
    );
}

/// A fit's folder in place of a scene is drawn from both sides, and the leaf fills the picture and no more. It stands
/// over a ground, which the view from below does not see.
#[test]
fn a_fit_is_drawn_from_both_sides() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    succeeded(&run(["render", "fits/elm", "-o", out.to_str().unwrap(), "--samples", "1", "--bounces", "1"]));
    let mut manifest = SceneManifest::of(Path::new("fits/elm")).unwrap();
    assert_eq!(manifest.display().curve, ToneCurve::Film);
    let size = [manifest.check.width as usize, manifest.check.height as usize];
    let views: Vec<_> = manifest.perspectives().cloned().collect();
    let ledger = Ledger::new();
    let covered = |manifest: SceneManifest| -> Vec<Vec<f32>> {
        let loaded = LoadedScene::open(manifest, LeafSearch::default(), &ledger).unwrap();
        let world = reference::traced(&loaded, 0.0, &ledger).unwrap();
        views.iter().map(|v| mesophyll::transport::covered(&world, &v.camera, size).unwrap()).collect()
    };
    let over_ground = covered(manifest.clone());
    manifest.ground = None;
    for ((view, alone), whole) in views.iter().zip(covered(manifest)).zip(over_ground) {
        assert!(out.join(format!("{}.png", view.name)).is_file());
        let drawn = mesophyll::files::image::read_exr(&out.join(format!("{}.exr", view.name))).unwrap();
        let green = drawn.get("G").unwrap();
        let inside: Vec<f32> = (0..alone.len()).filter(|k| alone[*k] == 1.0).map(|k| green[k]).collect();
        assert!(
            inside.iter().filter(|g| **g > 0.0).count() * 10 > 9 * inside.len(),
            "{}: the leaf is black",
            view.name
        );
        let columns: Vec<usize> = (0..alone.len()).filter(|k| alone[*k] > 0.0).map(|k| k % size[0]).collect();
        let [from, to] = [*columns.iter().min().unwrap(), *columns.iter().max().unwrap()];
        assert!(from > 0 && to + 1 < size[0], "{}: cut off", view.name);
        assert!(to - from > size[0] / 2, "{}: {from} to {to} of {}", view.name, size[0]);
        match view.name.as_str() {
            "back" => assert!(alone == whole),
            _ => assert!(whole.iter().all(|share| *share == 1.0)),
        }
    }
    let branch = run(["render", "fits/elm-twig", "-o", dir.path().join("no").to_str().unwrap()]);
    refused(&branch, 2, &["fits/elm-twig/fit.toml", "kind", "found a fit of the kind beam", "a leaf's fit"]);
    assert!(!dir.path().join("no").exists());
}
