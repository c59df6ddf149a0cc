//! Plans of pictures, held to fits of pictures that were drawn at the chosen places.

use super::*;
use crate::synthetic::{SyntheticExposure, TRUTH, opened, scene, taken};
use crate::{Options, run};
use mesophyll_fits::record::FitRecord;
use mesophyll_fits::record::maker::FitOutcome;
use std::fmt::Write;
use std::path::Path;

const UNKNOWN: &str = "[unknown]\nleaves = { a = [\"rho_t\"] }\nground = [\"albedo\"]\n";

/// Relative noise of a pixel.
const NOISE: f64 = 0.2;

fn options() -> SceneDesignOptions {
    SceneDesignOptions { cameras: 4, draws: 1, noise: Some(NOISE), samples: 64, ..SceneDesignOptions::default() }
}

/// The scene with the cameras of a choice and with its pictures, each in a file of its view's name.
fn with(design: &SceneDesign, new: &[usize], unknown: &str) -> String {
    let mut text = scene(TRUTH, "");
    let first = text.find("[[view]]").unwrap();
    let end = text.find("[[instance]]").unwrap();
    text.replace_range(first..end, "");
    for k in new {
        let one = &design.candidates[k - design.there()];
        let [eye, target, up] = [one.camera.eye, one.camera.target, one.camera.up].map(|v| v.to_array());
        let name = &one.camera_name;
        let _ = write!(
            text,
            "[[view]]\nname = \"{name}\"\nkind = \"perspective\"\neye_mm = {eye:?}\ntarget_mm = {target:?}\n\
             up = {up:?}\nfov_deg = 40\n"
        );
        if !unknown.is_empty() {
            let sun = one.sun_deg.map(|sun| format!("sun_deg = {sun:?}\n")).unwrap_or_default();
            let _ = write!(text, "[[picture]]\nview = \"{name}\"\nfile = \"{name}.exr\"\n{sun}");
        }
    }
    text + unknown
}

fn fitted(folder: &Path, text: &str, samples: u32, seed: u64) -> FitRecord {
    let scene = opened(folder, text).unwrap();
    match run(&scene, &folder.join("fit"), &Options { samples, seed, force: true }, &Ledger::new()).unwrap() {
        FitOutcome::Done(record) => *record,
        other => panic!("{other:?}"),
    }
}

/// Predicted errors beside those of fits: `fits` sets of pictures at the two chosen places, with noise and paths of
/// their own. Returns each number's root mean square error over the one that was predicted, and the same of the errors
/// that the fits state.
fn scatter(fits: u64) -> [Vec<f64>; 2] {
    let folder = tempfile::tempdir().unwrap();
    let planned = plan(&opened(folder.path(), &scene(TRUTH, UNKNOWN)).unwrap(), &options(), &Ledger::new()).unwrap();
    let choice = planned.problem.choose(2).unwrap();
    let (text, drawn) = (with(&planned, &choice.chosen, UNKNOWN), with(&planned, &choice.chosen, ""));
    let truth = [TRUTH[2], TRUTH[3]].concat();
    let (mut squares, mut stated) = (vec![0.0; truth.len()], vec![0.0; truth.len()]);
    for seed in 0..fits {
        // So much noise that the paths' own is next to nothing beside it.
        let by = SyntheticExposure { noise: NOISE, samples: 512, seed: 31 + 7 * seed, ..SyntheticExposure::default() };
        taken(folder.path(), &drawn, by, |_, v| v).unwrap();
        let record = fitted(folder.path(), &text, 256, 900 + 100 * seed);
        for (k, parameter) in planned.problem.parameters.iter().enumerate() {
            let found = &record.sections["all"].params[&parameter.name];
            squares[k] += (found.value[0] - truth[k]).powi(2);
            stated[k] += found.stderr[0].powi(2);
        }
    }
    [squares, stated].map(|of| of.iter().zip(&choice.errors).map(|(s, e)| (s / fits as f64).sqrt() / e).collect())
}

fn mean_square(ratios: &[f64]) -> f64 {
    (ratios.iter().map(|r| r * r).sum::<f64>() / ratios.len() as f64).sqrt()
}

/// Six numbers in six fits: 36 deviations scatter their root mean square by an eighth. The errors that the fits state
/// hardly scatter.
#[test]
fn predicted_errors_are_those_of_fits() {
    let [ratios, stated] = scatter(6);
    assert!((mean_square(&ratios) - 1.0).abs() < 0.4, "{ratios:?}");
    assert!((mean_square(&stated) - 1.0).abs() < 0.1 && stated.iter().all(|r| (r - 1.0).abs() < 0.2), "{stated:?}");
}

/// For the figures of docs/evidence/designs.md.
#[test]
#[ignore = "minutes"]
fn predicted_errors_are_the_scatter_of_many_fits() {
    let [ratios, stated] = scatter(60);
    println!("{:.3}: {ratios:.3?}", mean_square(&ratios));
    println!("stated {:.3}: {stated:.3?}", mean_square(&stated));
    assert!((mean_square(&ratios) - 1.0).abs() < 0.15, "{ratios:?}");
    assert!(ratios.iter().all(|r| (r - 1.0).abs() < 0.35), "{ratios:?}");
}

/// Light that comes through leaves is seen against the sun, and a ground that only one camera sees is known by that
/// one.
#[test]
fn a_camera_that_sees_the_ground_is_chosen_for_it() {
    let folder = tempfile::tempdir().unwrap();
    let up = "[[view]]\nname = \"up\"\nkind = \"perspective\"\neye_mm = [0, 0, 60]\ntarget_mm = [0, 1, 300]\n\
              fov_deg = 40\n";
    let down = "[[view]]\nname = \"down\"\nkind = \"perspective\"\neye_mm = [300, 300, 90]\ntarget_mm = [310, 310, 0]\n\
                fov_deg = 40\n";
    let unknown = format!("{up}{down}[unknown]\nground = [\"albedo\"]\n");
    let asked = SceneDesignOptions { cameras: 0, ..options() };
    let text = scene(TRUTH, &unknown);
    let first = text.find("[[view]]").unwrap();
    let end = text.find("[[instance]]").unwrap();
    let mut only = text.clone();
    only.replace_range(first..end, "");
    let found = plan(&opened(folder.path(), &only).unwrap(), &asked, &Ledger::new()).unwrap();
    let choice = found.problem.choose(1).unwrap();
    assert_eq!(found.candidates[choice.chosen[0]].camera_name, "down");
    assert_eq!(found.names(), ["ground.albedo"]);
}

/// Pictures that there are stay, their masks count, and further ones make the errors smaller; a leaf that no camera
/// sees is said to be undetermined.
#[test]
fn pictures_that_there_are_count() {
    let folder = tempfile::tempdir().unwrap();
    crate::synthetic::photograph(folder.path(), &scene(TRUTH, ""), 1.0, |_, v| v).unwrap();
    let one = "[[picture]]\nview = \"across\"\nfile = \"across.exr\"\n";
    let unknown = "[unknown]\nleaves = { a = [\"rho_t\"], b = [\"rho_d\"] }\n";
    let text = scene(TRUTH, &format!("{one}{unknown}"));
    let asked = SceneDesignOptions { cameras: 2, suns: vec![[60.0, 200.0]], samples: 16, draws: 2, ..options() };
    let found = plan(&opened(folder.path(), &text).unwrap(), &asked, &Ledger::new()).unwrap();
    assert_eq!((found.there(), found.candidates.len()), (1, 8));
    let choice = found.problem.choose(3).unwrap();
    let steps = found.one_by_one(&choice).unwrap();
    let now = found.problem.judge(&found.problem.taken).unwrap();
    assert!(steps.len() == 2 && steps[0].1.ratio < now.ratio && steps[1].1.ratio < steps[0].1.ratio);
    assert!((steps[1].1.ratio / choice.ratio - 1.0).abs() < 1e-9);
    assert_eq!(found.undetermined(&steps[1].1), ["leaf.b.front.rho_d", "leaf.b.back.rho_d"]);
    let refused = SceneDesignOptions { wanted: vec!["sky".into()], ..asked };
    let error = plan(&opened(folder.path(), &text).unwrap(), &refused, &Ledger::new()).err().unwrap().to_string();
    assert!(error.contains("--for: found \"sky\", expected what one of leaf.a.rho_t, "), "{error}");
}

/// Pictures under two suns give the ground that both were drawn of, and a fit that takes one sun for both is accused.
#[test]
fn pictures_under_two_suns_are_one_fit() {
    let folder = tempfile::tempdir().unwrap();
    let text = scene(TRUTH, "");
    crate::synthetic::photograph(folder.path(), &text, 1.0, |_, v| v).unwrap();
    std::fs::rename(folder.path().join("across.exr"), folder.path().join("first.exr")).unwrap();
    let later = text.replace("zenith_deg = 35\nazimuth_deg = 40", "zenith_deg = 60\nazimuth_deg = 200");
    assert_ne!(later, text);
    crate::synthetic::photograph(folder.path(), &later, 1.0, |_, v| v).unwrap();
    let both = |sun: &str| {
        format!(
            "[[picture]]\nview = \"across\"\nfile = \"first.exr\"\n[[picture]]\nview = \"across\"\n\
             file = \"across.exr\"\n{sun}[unknown]\nground = [\"albedo\"]\n"
        )
    };
    let found = fitted(folder.path(), &scene(TRUTH, &both("sun_deg = [60, 200]\n")), 128, 5);
    let albedo = &found.sections["all"].params["ground.albedo.G"];
    assert!(found.faults.is_empty() && (albedo.value[0] - 0.15).abs() < 4.0 * albedo.stderr[0], "{albedo:?}");
    let wrong = fitted(folder.path(), &scene(TRUTH, &both("")), 128, 5);
    assert_eq!(wrong.faults[0].name, "scene-model");
    let error = opened(folder.path(), &scene(TRUTH, &both("sun_deg = [95, 0]\n"))).and_then(|scene| {
        run(&scene, &folder.path().join("no"), &Options { samples: 16, seed: 1, force: true }, &Ledger::new())
    });
    let said = error.unwrap_err().to_string();
    assert!(said.contains("picture[1].sun_deg: found 95 and 0, expected a zenith angle"), "{said}");
}
