//! Every committed scene is drawn small and compared with its golden pictures. Fits that are wrong but consistent, with
//! new hashes, must not pass.
#![cfg(feature = "render")]

use crate::json;
use crate::skips;
use mesophyll::files::image::{Packing, read_exr, write_exr};
use mesophyll::files::quantity::Quantity;
use mesophyll::fits::leaf_folder::edit::{LeafSideEdit, save};
use mesophyll::fits::leaf_folder::{LeafFit, LeafFitFile};
use mesophyll::fits::record::FitRecord;
use mesophyll::optics::side::{Side, Sides};
use mesophyll::scene::manifest::{SceneManifest, SceneView};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::Instant;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn scenes() -> Vec<PathBuf> {
    let mut list: Vec<PathBuf> = std::fs::read_dir(root().join("data/scenes"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|x| x == "toml"))
        .collect();
    list.sort();
    list
}

fn check(scene: &Path, out: &Path, args: &[&str]) -> Output {
    let mut command = assert_cmd::Command::cargo_bin("mesophyll").unwrap();
    command
        .args(["--quiet", "check", "--goldens-only", "--json"])
        .args(args)
        .arg("--out")
        .arg(out)
        .arg(scene)
        .output()
        .unwrap()
}

/// Scans, fits and translucency maps that are not committed are made during the test.
#[test]
fn every_committed_scene_draws_its_goldens() {
    let dir = tempfile::tempdir().unwrap();
    let mut known: BTreeSet<PathBuf> = BTreeSet::new();
    let mut wrong = Vec::new();
    for scene in scenes() {
        let start = Instant::now();
        let manifest = SceneManifest::read(&scene).unwrap();
        let output = check(&scene, &dir.path().join(&manifest.name), &[]);
        if skips::no_adapter(&output) {
            return;
        }
        let report = json(&output);
        let views = report["views"].as_array().unwrap();
        println!("{}: {:.1} s", manifest.name, start.elapsed().as_secs_f64());
        for view in views {
            println!("  {}: {} {}", view["name"], view["golden_flip_mean"], view["golden_changed"]);
            let name = view["name"].as_str().unwrap();
            known.insert(scene.with_file_name(format!("golden/{}-{name}.png", manifest.name)));
        }
        // Every view of the file was drawn, and so were the hours where there is a day.
        let drawn: BTreeSet<&str> = views.iter().filter_map(|v| v["name"].as_str()).collect();
        for view in manifest.views.iter().map(SceneView::name).chain(manifest.day.iter().map(|_| "hours")) {
            assert!(drawn.contains(view), "{}: the view {view} was not drawn", manifest.name);
        }
        if output.status.code() != Some(0) {
            wrong.push(format!("{}: {report:#}", manifest.name));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let there: BTreeSet<PathBuf> =
        std::fs::read_dir(root().join("data/scenes/golden")).unwrap().map(|e| e.unwrap().path()).collect();
    assert_eq!(there, known, "a golden of no view, or a view without a golden; `make goldens` draws them anew");
}

/// Changes to the fits beside a scene. After each of them, the folder agrees with itself and with its hashes.
struct Tampering {
    what: &'static str,
    scene: &'static str,
    act: fn(&Path),
}

/// Writes the fit `name` under `fits` again as an edit in the window does: the maps are solved again, and everything is
/// hashed.
fn edit(fits: &Path, name: &str, change: impl Fn(f64) -> LeafSideEdit) {
    let folder = fits.join(name);
    let fitted = LeafFit::open(&folder).unwrap().called(name);
    let change = change(fitted.thickness(Side::Front).unwrap());
    let made = save(&fitted.edited(Sides::of(|_| change)), &fits.join("edited")).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    std::fs::rename(made, folder).unwrap();
}

fn scaled(sigma_a: f64, thickness_mm: f64) -> LeafSideEdit {
    LeafSideEdit { sigma_a: [sigma_a; 3], thickness_mm, ..LeafSideEdit::default() }
}

/// Multiplies γ and ρd by .8.
fn paler(folder: &Path) {
    let mut record = FitRecord::read(folder).unwrap();
    for side in Side::ALL {
        let file = LeafFitFile::Maps.name(side);
        let path = folder.join(&file);
        let mut maps = read_exr(&path).unwrap();
        for (quantity, c) in [Quantity::Gamma, Quantity::RhoD].into_iter().flat_map(|q| (0..3).map(move |c| (q, c))) {
            maps.plane_mut(quantity, c).unwrap().iter_mut().for_each(|v| *v *= 0.8);
        }
        write_exr(&path, &maps, Packing::Zip).unwrap();
        record.files.insert(file, mesophyll::files::hash::file(&path).unwrap());
    }
    record.write(folder).unwrap();
}

/// Multiplies the load of a measured branch by 2.5.
fn heavier(folder: &Path) {
    let mut record = FitRecord::read(folder).unwrap();
    record.sections.get_mut("branch elm-twig").unwrap().params.get_mut("load_over_stiffness").unwrap().value[0] *= 2.5;
    record.write(folder).unwrap();
}

const TAMPERINGS: [Tampering; 7] = [
    Tampering { what: "thickness × 1.3", scene: "back-lit", act: |fits| edit(fits, "elm", |h| scaled(1.0, 0.3 * h)) },
    Tampering { what: "thickness × 1.3", scene: "twig", act: |fits| edit(fits, "elm", |h| scaled(1.0, 0.3 * h)) },
    Tampering { what: "σa × 1.5", scene: "twig", act: |fits| edit(fits, "elm", |_| scaled(1.5, 0.0)) },
    Tampering { what: "γ × .8", scene: "front-lit", act: |fits| paler(&fits.join("elm")) },
    Tampering {
        what: "ρs × 2",
        scene: "glossy-sky",
        act: |fits| edit(fits, "balata", |_| LeafSideEdit { rho_s: 2.0, ..LeafSideEdit::default() }),
    },
    Tampering {
        what: "m × 2",
        scene: "sky",
        act: |fits| edit(fits, "balata", |_| LeafSideEdit { m: 2.0, ..LeafSideEdit::default() }),
    },
    Tampering { what: "load × 2.5", scene: "twig", act: |fits| heavier(&fits.join("elm-twig")) },
];

/// The goldens here are drawn from the committed fits themselves, so this test does not depend on the committed
/// pictures. The test above checks for every scene that unchanged fits agree with their goldens.
#[test]
fn a_consistent_but_wrong_fit_misses_its_golden() {
    let dir = tempfile::tempdir().unwrap();
    let (data, fits) = (dir.path().join("data"), dir.path().join("fits"));
    let fresh = || {
        let _ = std::fs::remove_dir_all(&fits);
        for name in ["elm", "balata", "elm-twig"] {
            copy(&root().join("fits").join(name), &fits.join(name));
        }
    };
    std::fs::create_dir_all(data.join("scenes")).unwrap();
    for name in ["leaves", "plants"] {
        copy(&root().join("data").join(name), &data.join(name));
    }
    let mut drawn = BTreeSet::new();
    for Tampering { what, scene, act } in TAMPERINGS {
        let path = data.join(format!("scenes/{scene}.toml"));
        let out = dir.path().join("out");
        fresh();
        if drawn.insert(scene) {
            std::fs::copy(root().join(format!("data/scenes/{scene}.toml")), &path).unwrap();
            let output = check(&path, &out, &["--update-golden"]);
            if skips::no_adapter(&output) {
                return;
            }
            assert_eq!(output.status.code(), Some(0), "{scene}: {:#}", json(&output));
        }
        act(&fits);
        let output = check(&path, &out, &[]);
        let report = json(&output);
        // The window scales maps and numbers alike, so that what it saves agrees with itself. γ × .8 misses the gauge.
        let named = report["failures"].as_array().unwrap();
        match what {
            "γ × .8" => {
                assert!(named.iter().any(|f| f.as_str().unwrap().contains("the mean of gamma")), "{report:#}")
            }
            _ => assert_eq!(named.len(), 0, "{what} of {scene} is seen without a golden: {report:#}"),
        }
        assert_eq!(output.status.code(), Some(1), "{what} of {scene} passes: {report:#}");
        let missed: Vec<&Value> = report["views"].as_array().unwrap().iter().filter(|v| v["passed"] == false).collect();
        for view in &missed {
            println!("{what} of {scene}, {}: {} {}", view["name"], view["golden_flip_mean"], view["golden_changed"]);
            assert!(view["why"][0].as_str().unwrap().contains("from the golden"), "{view:#}");
        }
        assert!(!missed.is_empty());
    }
}

/// Numbers of a leaf and of a branch that were changed by hand are named, whatever the pictures show.
#[test]
fn a_number_changed_by_hand_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let fits = dir.path().join("fits");
    for name in ["elm", "elm-twig"] {
        copy(&root().join("fits").join(name), &fits.join(name));
    }
    for name in ["data/leaves", "data/plants"] {
        copy(&root().join(name), &dir.path().join(name));
    }
    std::fs::create_dir_all(dir.path().join("data/scenes")).unwrap();
    let path = dir.path().join("data/scenes/twig.toml");
    std::fs::copy(root().join("data/scenes/twig.toml"), &path).unwrap();
    for (file, key) in [("elm-twig/fit.toml", "load_over_stiffness"), ("elm/fit.toml", "sigma_a")] {
        let place = fits.join(file);
        let text = std::fs::read_to_string(&place).unwrap();
        let (before, after) = text.split_once(&format!("{key}]\nvalue = [")).unwrap();
        std::fs::write(&place, format!("{before}{key}]\nvalue = [1{after}")).unwrap();
        let output = check(&path, &dir.path().join("out"), &["--update-golden"]);
        if skips::no_adapter(&output) {
            return;
        }
        let report = json(&output);
        assert_eq!(output.status.code(), Some(1), "{file}: {report:#}");
        let named = report["failures"].as_array().unwrap().iter().filter_map(Value::as_str);
        assert!(
            named.clone().any(|f| f.contains(file) && f.contains("changed since it was written")),
            "{file}: {report:#}"
        );
        std::fs::write(&place, text).unwrap();
    }
}

/// Copies a folder of plain files.
fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap().flatten() {
        std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
    }
}
