//! Leaves that are slabs, layers or maps: their derivatives against differences of pictures by the same random numbers,
//! and what is found of them.

use super::quantity::UnknownQuantity;
use super::synthetic::{BOTH, TRUTH, opened, photograph, scene};
use super::unknowns::SceneUnknowns;
use super::*;
use mesophyll_transport::ReferenceCamera;
use mesophyll_transport::path::slopes::DerivativeTracer;
use mesophyll_transport::path::{PathSettings, PathTracer};

/// The folder of a repository's file.
fn kept(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..").join(name).display().to_string()
}

/// What stands for a leaf in the scene's text, instead of `uniform` reflectances and a shape.
fn stated(leaf: &str) -> impl Fn(&str) -> String + use<> {
    let text = scene(TRUTH, "");
    let from = text.find("mesh = \"blade.gltf\"").unwrap();
    let old = text[from..text.find("[[leaf]]\nname = \"b\"").unwrap()].to_string();
    let leaf = leaf.to_string();
    move |tables: &str| scene(TRUTH, tables).replacen(&old, &leaf, 1)
}

const MESH: &str = "mesh = \"blade.gltf\"\nmesh_unit = \"mm\"\nmesh_up = \"z\"\n";

fn slab(sigma_a: [f64; 3], sigma_s: [f64; 3], thickness_mm: f64) -> String {
    let numbers = format!("sigma_a = {sigma_a:?}, sigma_s = {sigma_s:?}, thickness_mm = {thickness_mm}");
    format!("{MESH}uniform = {{ {numbers}, rho_s = [0.03, 0.03, 0.03] }}\n")
}

fn pigments(chlorophyll: f64, carotenoid: f64) -> String {
    let table = kept("data/tables/pigments.csv");
    format!(
        "{MESH}foliar = {{ pigments = \"{table}\", chlorophyll_ug_cm2 = {chlorophyll}, carotenoid_ug_cm2 = \
         {carotenoid}, water_g_cm2 = 0.01 }}\n"
    )
}

/// Compares every derivative of a scene's unknowns with differences, in the mean over a picture.
fn agree(leaf: &str, unknown: &str, names: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let text = stated(leaf)(&format!("[unknown]\nleaves = {{ a = {unknown} }}\n"));
    let scene = opened(folder.path(), &text).unwrap();
    let world = reference::traced(&scene, 0.0, &Ledger::new()).unwrap();
    let mut numbers = SceneUnknowns::new(&scene, world, &[], None, &Ledger::new()).unwrap();
    assert_eq!(numbers.list.iter().map(|q| q.name.as_str()).collect::<Vec<_>>(), names);
    let camera: ReferenceCamera = scene.manifest.perspectives().next().unwrap().camera;
    let slopes = numbers.slopes(None).unwrap();
    let of: Vec<_> = slopes.iter().map(|(_, of)| of.clone()).collect();
    const SEEDS: usize = 6;
    let seen = |numbers: &SceneUnknowns| {
        let world = numbers.world(None).unwrap();
        let tracer = PathTracer::new(&world, PathSettings::default()).unwrap();
        let drawn = DerivativeTracer::new(&tracer, &of);
        let mean = |seed: usize| {
            let sheet = drawn.picture(&camera, [16, 12], [2, 16], seed as u64).unwrap();
            let all = sheet.mean.len() as f64 / 3.0;
            let mut out = vec![[0.0; 3]; 1 + of.len()];
            for (k, pixel) in sheet.mean.chunks_exact(3).enumerate() {
                (0..3).for_each(|c| out[0][c] += pixel[c] / all);
                for (j, sum) in out[1..].iter_mut().enumerate() {
                    (0..3).for_each(|c| sum[c] += sheet.slope(k, j, c) / all);
                }
            }
            out
        };
        (0..SEEDS).map(mean).collect::<Vec<_>>()
    };
    let (plain, start) = (seen(&numbers), numbers.values());
    let (first, _) = numbers.places();
    for (j, (q, _)) in slopes.iter().enumerate() {
        let UnknownQuantity { at, name, .. } = numbers.list[*q].clone();
        for c in 0..3 {
            let number = first[*q] + if at.len() > 1 { c } else { 0 };
            // Light falls off like e^(−3) in the elm: over ±15 % its third derivative makes differences 3.5 % too
            // large.
            let step = 0.05 * start[number];
            let [low, high] = [-1.0, 1.0].map(|s| {
                let mut values = start.clone();
                values[number] += s * step;
                numbers.set(&values);
                seen(&numbers)
            });
            numbers.set(&start);
            let all: Vec<[f64; 2]> =
                (0..SEEDS).map(|k| [plain[k][1 + j][c], (high[k][0][c] - low[k][0][c]) / (2.0 * step)]).collect();
            let mean = |of: &dyn Fn(&[f64; 2]) -> f64| all.iter().map(of).sum::<f64>() / SEEDS as f64;
            let (slope, want) = (mean(&|v| v[0]), mean(&|v| v[1]));
            let spread = (mean(&|v| (v[0] - v[1] - slope + want).powi(2)) / (SEEDS - 1) as f64).sqrt();
            println!("{name} {c}: {slope:.5} {want:.5} ± {spread:.5}");
            // The picture is not linear in a number over the step.
            let what = format!("{name} {c}: {slope}, differences {want} ± {spread}");
            assert!((slope - want).abs() <= 4.5 * spread + 0.02 * want.abs(), "{what}");
        }
    }
}

#[test]
fn numbers_of_slabs_agree_with_differences() {
    let leaf = slab([1.5, 0.6, 3.0], [9.0, 11.0, 8.0], 0.2);
    let unknown = "[\"sigma_a\", \"sigma_s\", \"thickness_mm\", \"m\"]";
    agree(&leaf, unknown, &["leaf.a.sigma_a", "leaf.a.sigma_s", "leaf.a.thickness_mm", "leaf.a.m"]);
}

#[test]
fn contents_of_layers_agree_with_differences() {
    agree(&pigments(30.0, 8.0), "[\"chlorophyll\", \"carotenoid\"]", &["leaf.a.chlorophyll", "leaf.a.carotenoid"]);
    let leaf = format!("{MESH}foliar = {{ absorption = [0.3, 0.1, 0.6] }}\n");
    agree(&leaf, "[\"absorption\"]", &["leaf.a.absorption"]);
}

#[test]
fn numbers_of_fits_agree_with_differences() {
    let fit = kept("fits/elm");
    let of_slab = "[\"sigma_a\", \"sigma_s\", \"thickness_mm\"]";
    let names = ["leaf.a.sigma_a", "leaf.a.sigma_s", "leaf.a.thickness_mm"];
    agree(&format!("fit = \"{fit}\"\n"), of_slab, &names);
    agree(&format!("fit = \"{fit}\"\ninterior = \"maps\"\n"), of_slab, &names);
    let of_maps = "[\"rho_d\", \"rho_t\", \"rho_s\", \"m\"]";
    let names = ["front.rho_d", "back.rho_d", "rho_t", "rho_s", "m"].map(|name| format!("leaf.a.{name}.factor"));
    agree(&format!("fit = \"{fit}\"\n"), of_maps, &names.each_ref().map(String::as_str));
}

/// Fits the pictures of one scene from the start of another.
fn fitted(folder: &Path, text: &str, samples: u32) -> FitRecord {
    let scene = opened(folder, text).unwrap();
    let options = Options { samples, seed: 5, force: true };
    match run(&scene, &folder.join("fit"), &options, &Ledger::new()).unwrap() {
        FitOutcome::Done(record) => *record,
        other => panic!("{other:?}"),
    }
}

fn near(record: &FitRecord, name: &str, truth: f64, within: f64) {
    let param = &record.sections["all"].params[name];
    let (value, error) = (param.value[0], param.stderr[0]);
    let what = format!("{name}: {param:?}, {truth} is true");
    assert!((value - truth).abs() <= 4.0 * error && error <= within * truth, "{what}");
}

/// σa and the thickness from a start that is wrong by a factor of two. With σs unknown too, only products with the
/// thickness are known.
#[test]
fn a_slab_is_found_but_for_what_only_its_products_say() {
    let folder = tempfile::tempdir().unwrap();
    let (sigma_a, sigma_s) = ([1.5, 0.6, 3.0], [9.0, 11.0, 8.0]);
    photograph(folder.path(), &stated(&slab(sigma_a, sigma_s, 0.2))(""), 1.0, |_, v| v).unwrap();
    let start = stated(&slab([0.7, 1.2, 1.5], sigma_s, 0.4));
    let tables = |list: &str| format!("{BOTH}[unknown]\nleaves = {{ a = [\"sigma_a\", {list}] }}\n");
    let record = fitted(folder.path(), &start(&tables("\"thickness_mm\"")), 128);
    assert!(record.faults.is_empty(), "{:?}", record.faults);
    near(&record, "leaf.a.thickness_mm", 0.2, 0.05);
    for (c, channel) in quantity::CHANNELS.iter().enumerate() {
        near(&record, &format!("leaf.a.sigma_a.{channel}"), sigma_a[c], 0.1);
    }
    let found = SceneManifest::read(&folder.path().join("fit").join(SCENE)).unwrap();
    let slab = found.leaves[0].uniform().unwrap().slab.unwrap();
    assert_eq!(slab.thickness_mm, record.sections["all"].params["leaf.a.thickness_mm"].value[0]);
    let record = fitted(folder.path(), &start(&tables("\"thickness_mm\", \"sigma_s\"")), 32);
    for name in ["leaf.a.sigma_a.G", "leaf.a.sigma_s.B", "leaf.a.thickness_mm"] {
        let why = &record.sections["all"].params[name].undetermined;
        assert!(why[0].contains("only together with leaf.a."), "{name}: {why:?}");
    }
}

#[test]
fn chlorophyll_of_layers_is_found() {
    let folder = tempfile::tempdir().unwrap();
    photograph(folder.path(), &stated(&pigments(30.0, 8.0))(""), 1.0, |_, v| v).unwrap();
    let tables = format!("{BOTH}[unknown]\nleaves = {{ a = [\"chlorophyll\", \"carotenoid\"] }}\n");
    let record = fitted(folder.path(), &stated(&pigments(60.0, 4.0))(&tables), 64);
    assert!(record.faults.is_empty(), "{:?}", record.faults);
    near(&record, "leaf.a.chlorophyll", 30.0, 0.05);
    near(&record, "leaf.a.carotenoid", 8.0, 0.2);
    let found = SceneManifest::read(&folder.path().join("fit").join(SCENE)).unwrap();
    let stated = &found.leaves[0].layered().unwrap().stated;
    assert_eq!(stated.chlorophyll_ug_cm2, record.sections["all"].params["leaf.a.chlorophyll"].value[0]);
}

/// Pictures of a fit whose slab, or whose reflectances, are changed: the change is found, and the fit that is written
/// beside the scene has it.
#[test]
fn a_changed_fit_is_found_and_written() {
    use mesophyll_files::quantity::Quantity;
    use mesophyll_fits::leaf_folder::edit::{LeafSideEdit, save};
    use mesophyll_fits::leaf_folder::{LeafFit, reflecting};
    use mesophyll_optics::side::{Side, Sides};
    let folder = tempfile::tempdir().unwrap();
    let fit = kept("fits/elm");
    let plain = LeafFit::open(Path::new(&fit)).unwrap();
    let h = plain.thickness(Side::Front).unwrap();
    let sigma_a = plain.rgb(Side::Front, Quantity::SigmaA).unwrap();
    let edit = LeafSideEdit { sigma_a: [1.5, 0.7, 1.2], thickness_mm: 0.2 * h, ..LeafSideEdit::default() };
    let changed = save(&plain.edited(Sides::of(|_| edit)), folder.path()).unwrap();
    let text = |fit: &Path| stated(&format!("fit = \"{}\"\n", fit.display()));
    photograph(folder.path(), &text(&changed)(""), 1.0, |_, v| v).unwrap();
    let unknown = "[unknown]\nleaves = { a = [\"sigma_a\", \"thickness_mm\"] }\n";
    let record = fitted(folder.path(), &text(Path::new(&fit))(&format!("{BOTH}{unknown}")), 64);
    assert!(record.faults.is_empty(), "{:?}", record.faults);
    near(&record, "leaf.a.thickness_mm", 1.2 * h, 0.1);
    for (c, factor) in [1.5, 0.7, 1.2].into_iter().enumerate() {
        near(&record, &format!("leaf.a.sigma_a.{}", quantity::CHANNELS[c]), factor * sigma_a[c], 0.2);
    }
    record.verify(&folder.path().join("fit")).unwrap();
    let found = SceneManifest::read(&folder.path().join("fit").join(SCENE)).unwrap();
    let written = found.resolve(found.leaves[0].fit().unwrap().fit.as_ref().unwrap());
    let value = LeafFit::open(&written).unwrap().thickness(Side::Front).unwrap();
    assert!((value - record.sections["all"].params["leaf.a.thickness_mm"].value[0]).abs() < 1e-12);

    // A look, whose ρd of the back and ρt were changed.
    let edits = Sides::of(|side| LeafSideEdit {
        rho_d: if side == Side::Back { [0.8; 3] } else { [1.0; 3] },
        rho_t: [0.7, 1.2, 0.9],
        ..LeafSideEdit::default()
    });
    let look = folder.path().join("look");
    reflecting::save(&plain, &edits, &look, "changed").unwrap();
    photograph(folder.path(), &text(&look)(""), 1.0, |_, v| v).unwrap();
    let unknown = "[unknown]\nleaves = { a = [\"rho_d\", \"rho_t\"] }\n";
    let record = fitted(folder.path(), &text(Path::new(&fit))(&format!("{BOTH}{unknown}")), 64);
    assert!(record.faults.is_empty(), "{:?}", record.faults);
    for (name, truth) in [("front.rho_d", [1.0; 3]), ("back.rho_d", [0.8; 3]), ("rho_t", [0.7, 1.2, 0.9])] {
        for (c, channel) in quantity::CHANNELS.iter().enumerate() {
            near(&record, &format!("leaf.a.{name}.factor.{channel}"), truth[c], 0.1);
        }
    }
    let written = LeafFit::open(&folder.path().join("fit/leaf-a")).unwrap();
    written.record.verify(&written.folder).unwrap();
    assert!(written.is_stated() && written.record.contradictions().is_empty());
    // Of the look that was written, the same scene is drawn.
    let found = SceneManifest::read(&folder.path().join("fit").join(SCENE)).unwrap();
    let scene = LoadedScene::open(found, Default::default(), &Ledger::new()).unwrap();
    reference::traced(&scene, 0.0, &Ledger::new()).unwrap().validate().unwrap();
}
