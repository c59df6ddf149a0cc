//! Designs of measurements on real scans and by the program.

use crate::common::{refused, run as program, skips};
use mesophyll::base::selection::DesignAim;
use mesophyll::files::table::InputTable;
use mesophyll::fits::design::gloss::GonioDesign;
use mesophyll::fits::gloss::normal_of;
use mesophyll::fits::gloss::samples::{self, GlossFitSettings, GlossSample, LobeChoice, MeasuredGloss};
use mesophyll::optics::gloss::LobeKind;
use std::f64::consts::PI;

/// Root mean square of what a leaf's fit to `seen` leaves of `judged`.
fn left(seen: &[&GlossSample], judged: &[&GlossSample], settings: &GlossFitSettings) -> f64 {
    let own: Vec<GlossSample> = seen.iter().map(|s| (*s).clone()).collect();
    let found = samples::fit(&own, settings).unwrap();
    let (mut sum, mut count) = (0.0, 0.0);
    for s in judged {
        let gloss = PI * found.lobe.value(normal_of(found.tilt), s.light, s.view, found.m);
        for (v, d) in s.values.iter().zip(&found.rho_d).filter(|(v, _)| v.is_finite()) {
            sum += (v - d - found.rho_s * gloss).powi(2);
            count += 1.0;
        }
    }
    f64::sqrt(sum / count)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Ten directions that were chosen for one half of the leaves predict the other directions of the other half nearly as
/// well as the fit to all directions describes them.
#[test]
fn ten_directions_predict_real_leaves() {
    let Some(data) = skips::data("leaves/brf.csv") else { return };
    for lobe in [LobeKind::Beckmann, LobeKind::Ggx] {
        let settings = GlossFitSettings { surface: LobeChoice::Of(lobe), ..GlossFitSettings::default() };
        let read = |name: &str| -> Vec<MeasuredGloss> {
            samples::leaves(InputTable::open(&data.join("leaves").join(name)).unwrap(), &[], &settings).unwrap()
        };
        let (one, other) = (read("brf.csv"), read("brf_2.csv"));
        for (known, unseen) in [(&one, &other), (&other, &one)] {
            let design = GonioDesign::of(known, &settings, DesignAim::Predictions).unwrap();
            let choice = design.problem.choose(10).unwrap();
            let is = |s: &GlossSample, k: usize| {
                let at = design.directions[k];
                let angle = s.view[2].clamp(-1.0, 1.0).acos().to_degrees();
                let turn = s.view[1].atan2(s.view[0]).to_degrees().rem_euclid(360.0);
                (angle - at.view_zenith_deg).abs() < 0.5 && (angle < 0.5 || (turn - at.view_azimuth_deg).abs() < 0.5)
            };
            let predicted = |leaf: &MeasuredGloss, set: &[usize]| {
                let (seen, others): (Vec<&GlossSample>, Vec<&GlossSample>) =
                    leaf.samples.iter().partition(|s| set.iter().any(|k| is(s, *k)));
                assert!(seen.len() >= 8, "{} of ten directions", seen.len());
                left(&seen, &others, &settings)
            };
            let even: Vec<usize> = (0..10).map(|k| k * design.directions.len() / 10).collect();
            let all = |leaf: &MeasuredGloss| {
                let all: Vec<&GlossSample> = leaf.samples.iter().collect();
                left(&all, &all, &settings)
            };
            let whole = median(unseen.iter().map(all).collect());
            let some = median(unseen.iter().map(|leaf| predicted(leaf, &choice.chosen)).collect());
            let spaced = median(unseen.iter().map(|leaf| predicted(leaf, &even)).collect());
            println!(
                "{lobe}: median RMS of all {whole:.4}, predicted from ten {some:.4}, from every fourth {spaced:.4}"
            );
            assert!(some < spaced, "{some} {spaced}");
            // What Beckmann's lobe leaves of these leaves is no noise, so only the lobe that they want is held to this.
            assert!(lobe == LobeKind::Beckmann || some < 1.1 * whole, "{whole} {some}");
        }
    }
}

/// What the program answers: the chosen frames are a table, beside the errors of all and of even ones.
#[test]
fn a_scan_is_planned_and_goes_on_frame_by_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let run = |words: &[&str]| {
        let out = program(words);
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8(out.stdout).unwrap()
    };
    let (scan, list) = (path("scan"), path("positions.csv"));
    run(&["synth", "data/leaves/balata.toml", "-o", &scan, "--size", "40x30", "--frames", "12", "--passes", "x", "-q"]);
    let text = run(&["design", "leaf", &scan, "--next", "3", "--json", "-o", &list]);
    let answer: serde_json::Value = serde_json::from_str(&text).unwrap();
    let ratio = |k: usize| answer["sets"][k]["errors_over_all"].as_f64().unwrap();
    assert_eq!(answer["chosen"].as_array().unwrap().len(), 3);
    assert!(ratio(2) < ratio(1) && answer["best_possible_over_all"].as_f64().unwrap() <= ratio(2));
    let rows: Vec<String> = std::fs::read_to_string(&list).unwrap().lines().map(String::from).collect();
    assert_eq!((rows.len(), rows[0].as_str()), (4, "pass,position_mm"));
    // Nothing beyond the device's limits is proposed, and no step that it cannot make.
    let capture = folder.path().join("scan/capture.toml");
    let manifest = std::fs::read_to_string(&capture).unwrap();
    std::fs::write(&capture, manifest + "\n[limits]\nx_mm = [-120.0, 40.0]\nstep_mm = 5.0\n").unwrap();
    run(&["design", "leaf", &scan, "--next", "3", "-o", &list, "-q"]);
    for row in std::fs::read_to_string(&list).unwrap().lines().skip(1) {
        let at: f64 = row.trim_start_matches("x,").parse().unwrap();
        assert!((-120.0..=40.0).contains(&at) && (at / 5.0).fract() == 0.0, "{row}");
    }
    // A step that has no multiple within the limits leaves no place, which is said.
    let coarse = std::fs::read_to_string(&capture).unwrap().replace("[-120.0, 40.0]", "[1.0, 2.0]");
    std::fs::write(&capture, coarse).unwrap();
    let none = program(["design", "leaf", &scan, "--candidates", "20"]);
    refused(&none, 2, &["capture.toml", "limits.step_mm", "5 mm"]);
    refused(&program(["design", "leaf", &scan, "--passes", "y"]), 2, &["--passes", "pass x"]);
    // An error that is reached asks for nothing more.
    let done = run(&["design", "leaf", &scan, "--next", "3", "--until", "0.5", "--json"]);
    let done: serde_json::Value = serde_json::from_str(&done).unwrap();
    assert!(done["chosen"].as_array().unwrap().is_empty(), "{done}");
}

/// A fit of one column has five numbers: four directions leave nothing to spare, and that is said.
#[test]
fn few_directions_are_warned_of() {
    let output =
        program(["design", "gloss", "--in", "data/tables/samples.csv", "--values", "brf_550", "--directions", "4"]);
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && said.contains("leave 0 readings to spare"), "{output:?}");
}
