//! Faults of a measurement: the verdict of a scan that is clean but for one of them drops, and its sentence names the
//! cause. `stress leaf` has the whole table.

use crate::common::{copy_tree, run, scan};
use mesophyll::files::image::{Packing, read_exr, write_exr};
use mesophyll::fits::record::FitRecord;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

fn clean() -> &'static Path {
    static SCAN: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    &SCAN
        .get_or_init(|| {
            let dir = crate::common::kept::kept();
            let capture =
                scan(dir.path(), "balata", &["--size", "40x30", "--frames", "40", "--noise", "0.01", "--seed", "2"]);
            (dir, capture)
        })
        .1
}

/// The record and the verdict (`good`, `doubtful`, `bad` and its sentence) of the clean scan after `put`.
fn after(put: impl Fn(&Path)) -> (FitRecord, String, String) {
    let dir = tempfile::tempdir().unwrap();
    let (capture, fit) = (dir.path().join("scan"), dir.path().join("fit"));
    copy_tree(clean(), &capture);
    put(&capture);
    // The exit code is another test's.
    run(["fit", "leaf", capture.to_str().unwrap(), "-o", fit.to_str().unwrap()]);
    let output = run(["report", fit.to_str().unwrap(), "--json"]);
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let verdict = &report["fits"][0]["verdict"];
    let word = |field: &str| verdict[field].as_str().unwrap().to_string();
    (FitRecord::read(&fit).unwrap(), word("level"), word("sentence"))
}

fn edit(capture: &Path, from: &str, to: &str) {
    let path = capture.join("capture.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains(from), "{text}");
    std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
}

#[test]
fn a_clean_scan_has_no_fault() {
    let (record, level, sentence) = after(|_| {});
    assert!(record.faults.is_empty() && level == "good", "{sentence}; {:?}", record.faults);
    assert!(
        record.sections["front"].counts["readings_discarded"] * 10_000 < record.sections["front"].counts["readings"]
    );
}

#[test]
fn a_wrong_angle_of_the_camera_is_named_and_its_numbers_are_not_promised() {
    let (record, level, sentence) = after(|c| edit(c, "camera_deg = 55.0", "camera_deg = 47.0"));
    assert!(level == "bad" && sentence.contains("camera_deg"), "{sentence}");
    let fault = record.faults.iter().find(|f| f.name == "camera-angle").expect("a fault of that name");
    // The number that the data ask for is the truth within half a degree.
    let found: f64 = fault.says.split("camera_deg = ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!((found - 55.0).abs() < 0.6, "{}", fault.says);
    for side in ["front", "back"] {
        let section = &record.sections[side];
        assert_eq!(section.params["sigma_a"].undetermined.len(), 3);
        assert_eq!(section.counts["gloss_undetermined"], section.counts["good"]);
        // The errors hold the truth nevertheless: of Gaussian ones .95 would.
        for quantity in ["rho_s", "m"] {
            let inside = section.truth[quantity].coverage95.unwrap();
            assert!(inside > 0.8, "{side} {quantity}: {inside}");
        }
    }
}

#[test]
fn a_frame_that_flickers_is_named_and_counted() {
    let (record, level, sentence) = after(|c| {
        let path = c.join("front/x/0017.exr");
        let mut maps = read_exr(&path).unwrap();
        maps.channels.iter_mut().flat_map(|(_, v)| v).for_each(|v| *v *= 1.3);
        write_exr(&path, &maps, Packing::Raw).unwrap();
    });
    assert!(level == "doubtful" && sentence.contains("frame 17 of pass x of the front"), "{sentence}");
    assert_eq!((record.faults.len(), record.faults[0].name.as_str()), (1, "frame-brightness"));
    assert!(record.sections["front"].counts["readings_discarded"] > 500, "{:?}", record.sections["front"].counts);
    // The rest of the scan carries the numbers.
    assert!(record.sections["front"].params["sigma_a"].undetermined.is_empty());
}

#[test]
fn the_reflectance_of_the_white_sheet_scales_what_is_seen() {
    let (dark, ..) = after(|c| edit(c, "schema = 1", "schema = 1\nwhite_reflectance = 0.8"));
    // Nothing in the readings tells how much the sheet reflects.
    assert!(dark.faults.is_empty(), "{:?}", dark.faults);
    let (full, ..) = after(|_| {});
    let rms = |r: &FitRecord| r.sections["front"].truth["rho_d"].median_relative;
    // ρd is 0.8 times as large: a fifth off the truth of a sheet that reflects everything.
    assert!((rms(&dark) - 0.2).abs() < 0.02 && rms(&full) < 0.02, "{} {}", rms(&dark), rms(&full));
    let dir = tempfile::tempdir().unwrap();
    let capture = dir.path().join("scan");
    copy_tree(clean(), &capture);
    edit(&capture, "schema = 1", "schema = 1\nwhite_reflectance = 99.0");
    let output = run(["fit", "leaf", capture.to_str().unwrap(), "-o", dir.path().join("fit").to_str().unwrap()]);
    crate::common::refused(&output, 2, &["capture.toml", "white_reflectance", "found 99", "0.99"]);
}

#[test]
fn a_scan_of_one_pass_asks_for_the_other_first() {
    let dir = tempfile::tempdir().unwrap();
    let capture =
        scan(dir.path(), "balata", &["--size", "24x18", "--frames", "12", "--noise", "0.01", "--passes", "x"]);
    let fit = dir.path().join("fit");
    run(["fit", "leaf", capture.to_str().unwrap(), "-o", fit.to_str().unwrap()]);
    let record = FitRecord::read(&fit).unwrap();
    let next = record.next_measurement.expect("a pass is missing");
    assert!(next.sentence.starts_with("pass y, without which the normals' y is undetermined"), "{next:?}");
    assert!(record.options["normal.Y"].starts_with("undetermined: pass y"), "{:?}", record.options);
    let report: serde_json::Value =
        serde_json::from_slice(&run(["report", fit.to_str().unwrap(), "--json"]).stdout).unwrap();
    let report = &report["fits"][0];
    let rows = report["maps"].as_array().unwrap();
    for side in ["front", "back"] {
        let unseen = rows.iter().find(|r| r["section"] == side && r["quantity"] == "normal" && r["channel"] == "Y");
        let good = record.sections[side].counts["good"];
        assert_eq!(unseen.unwrap()["undetermined"].as_u64(), Some(good as u64), "{unseen:?}");
    }
    let reasons = report["verdict"]["reasons"].to_string();
    assert!(reasons.contains("the normals' y is undetermined in every texel"), "{reasons}");
}
