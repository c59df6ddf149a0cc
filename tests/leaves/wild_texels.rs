//! Wild texels, wrong captures, and sides that disagree. A leaf fit is robust against the first, and reports the
//! others.

use crate::common::{copy_tree, refused, run, scan, was_fitted};
use mesophyll::files::image::{Packing, read_exr, write_exr};
use mesophyll::files::quantity::Quantity;
use mesophyll::fits::record::{FitRecord, NOISE_SEEN};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A noisy scan and its fit. Tests damage copies of them.
fn clean() -> &'static (PathBuf, FitRecord) {
    static CLEAN: OnceLock<(tempfile::TempDir, (PathBuf, FitRecord))> = OnceLock::new();
    &CLEAN
        .get_or_init(|| {
            let dir = crate::common::kept::kept();
            let capture =
                scan(dir.path(), "elm", &["--size", "60x45", "--frames", "40", "--noise", "0.01", "--seed", "4"]);
            let record = fit(&capture, &dir.path().join("fit"));
            (dir, (capture, record))
        })
        .1
}

fn fit(capture: &Path, out: &Path) -> FitRecord {
    was_fitted(&run(["fit", "leaf", capture.to_str().unwrap(), "-o", out.to_str().unwrap()]));
    FitRecord::read(out).unwrap()
}

/// A copy of the clean capture in which `change` may alter every frame of the front. It gets the frame's number and its
/// channels.
fn spoilt(dir: &Path, change: impl Fn(usize, &mut [f32], usize)) -> PathBuf {
    let copy = dir.join("spoilt");
    copy_tree(&clean().0, &copy);
    for pass in ["x", "y"] {
        for frame in 0.. {
            let path = copy.join("front").join(pass).join(format!("{frame:04}.exr"));
            if !path.exists() {
                break;
            }
            let mut maps = read_exr(&path).unwrap();
            maps.channels.iter_mut().enumerate().for_each(|(c, (_, values))| change(frame, values, c));
            write_exr(&path, &maps, Packing::Raw).unwrap();
        }
    }
    copy
}

/// Every `step`-th texel of the leaf.
fn every(step: usize) -> Vec<usize> {
    let mask = read_exr(&clean().0.join("mask.exr")).unwrap();
    let leaf: Vec<usize> = (0..mask.width * mask.height).filter(|&k| mask.get("Y").unwrap()[k] > 0.5).collect();
    leaf.into_iter().skip(step / 2).step_by(step).collect()
}

/// Numbers that look random but are always the same.
fn scrambled(seed: usize) -> f32 {
    let x = (seed as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let x = (x ^ (x >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    ((x >> 40) as f32) / (1u64 << 24) as f32
}

/// Difference of the front's σa from that of the clean fit, in the clean fit's standard errors, for each channel.
fn moved(record: &FitRecord) -> [f64; 3] {
    let (now, before) = (&record.sections["front"].params["sigma_a"], &clean().1.sections["front"].params["sigma_a"]);
    [0, 1, 2].map(|c: usize| (now.value[c] - before.value[c]).abs() / before.stderr[c])
}

#[test]
fn one_hot_texel_is_named_and_moves_nothing() {
    for level in [2.0, 10.0, 1e4f32] {
        let dir = tempfile::tempdir().unwrap();
        let hot = every(1000)[0];
        let record = fit(&spoilt(dir.path(), |_, values, _| values[hot] = level), &dir.path().join("fit"));
        let front = &record.sections["front"];
        assert_eq!(front.counts["unexplained"], 1, "{level}: {:?}", front.counts);
        let mask = read_exr(&dir.path().join("fit/front.exr")).unwrap();
        assert_eq!(mask.scalar(Quantity::Mask).unwrap()[hot], -9.0);
        assert!(moved(&record).iter().all(|m| *m < 0.3), "{level}: {:?}", moved(&record));
        assert!((front.residuals["gloss"].reduced_chi2 - 1.0).abs() < 0.02, "{:?}", front.residuals);
    }
}

/// The breakdown test, with constant, random and scaled texels in turn.
#[test]
fn one_per_cent_of_wild_texels_moves_less_than_the_error_and_ten_are_bounded() {
    for (step, limit) in [(100, 1.0), (10, 20.0)] {
        let dir = tempfile::tempdir().unwrap();
        let wild = every(step);
        let capture = spoilt(dir.path(), |frame, values, c| {
            for (n, &k) in wild.iter().enumerate() {
                match n % 3 {
                    0 => values[k] = 2.0,
                    1 => values[k] = 50.0 * scrambled(frame * 1_000_003 + 3 * k + c),
                    _ => values[k] *= 40.0,
                }
            }
        });
        let record = fit(&capture, &dir.path().join("fit"));
        let front = &record.sections["front"];
        let bad: usize = record.defects.values().map(|d| front.counts[d]).sum();
        assert!(bad >= wild.len(), "{bad} of {} are named: {:?}", wild.len(), front.counts);
        println!("every {step}: {} wild, {bad} named, σa moved by {:?} errors", wild.len(), moved(&record));
        assert!(moved(&record).iter().all(|m| *m < limit), "every {step}: {:?}", moved(&record));
    }
}

/// With random values up to 1e38 in the frames, a decomposition without a limit once ran forever. A few texels are
/// enough for this.
#[test]
fn frames_of_any_size_end_in_a_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let kept = every(40);
    let capture = spoilt(dir.path(), |frame, values, c| {
        for (k, v) in values.iter_mut().enumerate() {
            *v = 10f32.powf(76.0 * scrambled(frame * 1_000_003 + 3 * k + c) - 38.0);
        }
    });
    let mut mask = read_exr(&capture.join("mask.exr")).unwrap();
    mask.channels[0].1.iter_mut().enumerate().for_each(|(k, v)| *v = f32::from(u8::from(kept.contains(&k))));
    write_exr(&capture.join("mask.exr"), &mask, Packing::Raw).unwrap();
    let out = run(["fit", "leaf", capture.to_str().unwrap(), "-o", dir.path().join("fit").to_str().unwrap()]);
    refused(&out, 1, &["front", "no texel could be fitted"]);
}

#[test]
fn a_thickness_that_no_leaf_has_is_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let copy = dir.path().join("thin");
    copy_tree(&clean().0, &copy);
    let manifest = copy.join("capture.toml");
    let text = std::fs::read_to_string(&manifest).unwrap();
    let line = text.lines().find(|l| l.starts_with("thickness_mm")).unwrap();
    for wrong in ["1e-308", "1e300", "0.0", "nan"] {
        std::fs::write(&manifest, text.replace(line, &format!("thickness_mm = {wrong}"))).unwrap();
        let out = run(["fit", "leaf", copy.to_str().unwrap(), "-o", dir.path().join("fit").to_str().unwrap()]);
        refused(&out, 2, &["capture.toml", "thickness_mm", "0.001 to 100"]);
    }
}

/// The level and the sentences of a fit's verdict.
fn verdict(fit: &Path) -> (String, String) {
    let out = run(["report", fit.to_str().unwrap(), "--json"]);
    let report: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let verdict = &report["fits"][0]["verdict"];
    (verdict["level"].to_string(), verdict["reasons"].to_string())
}

/// A camera at 50° instead of 55° leaves a reduced χ² of 1.1. This is small, but many of its own standard deviations
/// above 1.
#[test]
fn a_wrong_camera_angle_is_a_finding() {
    let dir = tempfile::tempdir().unwrap();
    let right = dir.path().join("right");
    let record = fit(&clean().0, &right);
    // With the noise of each texel's own gain and dark level, χ² is 1 within its spread.
    let r = &record.sections["front"].residuals["gloss"];
    let spread = (2.0 * r.reduced_chi2 / r.chi2).sqrt();
    assert!((r.reduced_chi2 - 1.0).abs() < 5.0 * spread + 2e-3, "{r:?}, spread {spread}");
    assert!(
        (record.sections["front"].figures[NOISE_SEEN] - 1.0).abs() < 0.03,
        "{:?}",
        record.sections["front"].figures
    );
    assert!(!verdict(&right).1.contains("leaves more than"), "{}", verdict(&right).1);

    let copy = dir.path().join("scan");
    copy_tree(&clean().0, &copy);
    let _ = std::fs::remove_dir_all(copy.join("mirror"));
    let manifest = copy.join("capture.toml");
    let text = std::fs::read_to_string(&manifest).unwrap();
    assert!(text.contains("camera_deg = 55.0"));
    std::fs::write(&manifest, text.replacen("camera_deg = 55.0", "camera_deg = 50.0", 1)).unwrap();
    let wrong = dir.path().join("wrong");
    fit(&copy, &wrong);
    let (level, reasons) = verdict(&wrong);
    assert_ne!(level, "\"good\"");
    assert!(reasons.contains("camera's angle") && reasons.contains("mirror"), "{reasons}");
}

/// One side's albedo is half of the right value. Each side alone looks right, but the two contradict each other.
#[test]
fn sides_that_disagree_are_said_and_widen_the_errors() {
    let agreeing = &clean().1.sections["sides"];
    assert!(agreeing.figures["apart_in_errors.sigma_a.R"] < 4.0, "{:?}", agreeing.figures);
    let dir = tempfile::tempdir().unwrap();
    let capture = spoilt(dir.path(), |_, values, _| values.iter_mut().for_each(|v| *v *= 0.97));
    let out = dir.path().join("fit");
    let record = fit(&capture, &out);
    let figures = &record.sections["sides"].figures;
    assert!(figures["apart_in_errors.sigma_a.R"] > 10.0, "{figures:?}");
    let [front, back] = ["front", "back"].map(|s| &record.sections[s].params["sigma_a"]);
    for c in 0..3 {
        let combined = front.stderr[c].hypot(back.stderr[c]);
        assert!((front.value[c] - back.value[c]).abs() < 1.2 * combined, "{front:?} {back:?}");
    }
    assert!(verdict(&out).1.contains("front and back disagree"), "{}", verdict(&out).1);
}
