//! Frames that no fit uses. They are left out by choice and predicted within their noise. They reveal a wrong fit,
//! whatever its files say about themselves.

use crate::common::{copy_tree, run, scan, succeeded, was_fitted};
use mesophyll::files::hash;
use mesophyll::files::image::{ChannelMaps, Packing, read_exr, write_exr};
use mesophyll::files::quantity::Quantity;
use mesophyll::fits::record::FitRecord;
use mesophyll::optics::slab;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A small noisy scan and its fit, with 40 frames in a pass, of which one in 10 is left out.
fn fitted() -> &'static (PathBuf, PathBuf) {
    static FIT: OnceLock<(tempfile::TempDir, (PathBuf, PathBuf))> = OnceLock::new();
    &FIT.get_or_init(|| {
        let dir = crate::common::kept::kept();
        let capture = scan(dir.path(), "elm", &["--size", "48x36", "--frames", "40", "--noise", "0.01", "--seed", "3"]);
        let out = dir.path().join("fit");
        succeeded(&run(["fit", "leaf", capture.to_str().unwrap(), "-o", out.to_str().unwrap(), "--hold-out", "10"]));
        (dir, (capture, out))
    })
    .1
}

fn report(fit: &Path) -> Value {
    let output = run(["report", fit.to_str().unwrap(), "--json"]);
    let report = serde_json::from_slice::<Value>(&output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(i32::from(report["verdict"]["level"] == "bad")));
    report["fits"][0].clone()
}

/// Largest error of the rows of one kind, in units of the noise.
fn off(report: &Value, kind: &str) -> f64 {
    let rows = report["held_out"]["rows"].as_array().unwrap();
    let worst =
        rows.iter().filter(|r| r["kind"] == kind).map(|r| r["off"].as_f64().unwrap()).fold(f64::NEG_INFINITY, f64::max);
    assert!(worst.is_finite(), "no row of {kind}: {rows:#?}");
    worst
}

#[test]
fn held_out_frames_are_named_and_predicted_within_their_noise() {
    let (_, fit) = fitted();
    let record = FitRecord::read(fit).unwrap();
    assert!(record.options["held_out"].contains("pass x: 4 of 40"), "{}", record.options["held_out"]);
    for side in ["front", "back"] {
        let section = &record.sections[side];
        for pass in ["x", "y"] {
            let held = &section.held_out[pass];
            assert_eq!((held.frames.len(), held.stored.len()), (4, 2));
            assert_eq!(held.readings, 3 * 4 * section.counts["good"]);
            // Nine parameters from 72 frames of three channels give an expectation about 4 % above the noise.
            assert!((1.01..1.2).contains(&held.expected), "{held:?}");
            assert!((held.reduced_chi2 / held.expected - 1.0).abs() < 0.1 + 3.0 * held.stderr, "{held:?}");
            assert!(held.share_beyond_3 < 0.01 && held.bias.abs() < 0.1, "{held:?}");
        }
        assert!(section.light_box.as_ref().unwrap().off() < 1.0 / 3.0, "{:?}", section.light_box);
        assert!(record.files.contains_key(&format!("{side}_held_out.exr")));
    }
    let report = report(fit);
    for kind in ["pass", "stored", "light_box"] {
        assert!(off(&report, kind) <= 1.0 / 3.0, "{kind}: {:#}", report["held_out"]);
    }
    let reasons = report["verdict"]["reasons"].to_string();
    assert!(reasons.contains("that the fit did not see are predicted within their noise"), "{reasons}");
    let page = fit.with_extension("html");
    succeeded(&run(["report", fit.to_str().unwrap(), "-o", page.to_str().unwrap()]));
    let page = std::fs::read_to_string(page).unwrap();
    assert!(
        page.contains("Frames that the fit did not see") && page.matches("measured, not seen by the fit").count() >= 2
    );
}

#[test]
fn shards_with_held_out_frames_give_the_bytes_of_one_run_and_the_seed_counts() {
    let dir = tempfile::tempdir().unwrap();
    let capture = scan(dir.path(), "elm", &["--size", "24x18", "--frames", "24", "--noise", "0.01", "--seed", "1"]);
    let capture = capture.to_str().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_string();
    let (one, parts, other) = (path("one"), path("parts"), path("other"));
    succeeded(&run(["fit", "leaf", capture, "-o", &one, "--threads", "1"]));
    for more in [&["--shard", "1/2"][..], &["--shard", "2/2"], &["--merge"]] {
        succeeded(&run([&["fit", "leaf", capture, "-o", parts.as_str()], more].concat()));
    }
    for name in ["fit.toml", "front.exr", "back_held_out.exr"] {
        let [a, b] = [&one, &parts].map(|d| std::fs::read(Path::new(d).join(name)).unwrap());
        assert!(a == b, "{name} differs");
    }
    succeeded(&run(["fit", "leaf", capture, "-o", &other, "--hold-out-seed", "2"]));
    let [a, b] = [&one, &other].map(|d| FitRecord::read(Path::new(d)).unwrap());
    assert_ne!(a.input_hash, b.input_hash);
    assert_ne!(a.sections["front"].held_out["x"].frames, b.sections["front"].held_out["x"].frames);
    // A fit without held-out frames has no figures of them, and its report says so.
    succeeded(&run(["fit", "leaf", capture, "-o", &other, "--hold-out", "0"]));
    let none = FitRecord::read(Path::new(&other)).unwrap();
    assert!(none.sections["front"].held_out.is_empty());
    assert!(report(Path::new(&other))["verdict"]["reasons"].to_string().contains("no frame was held out"));
}

/// A frame that is left out decides nothing: spoiling it changes no map.
#[test]
fn a_held_out_frame_is_not_seen_by_the_fit() {
    let dir = tempfile::tempdir().unwrap();
    let (capture, fit) = fitted();
    let frame = FitRecord::read(fit).unwrap().sections["front"].held_out["x"].frames[1];
    let spoilt = dir.path().join("spoilt");
    copy_tree(capture, &spoilt);
    let path = spoilt.join(format!("front/x/{frame:04}.exr"));
    let mut maps = read_exr(&path).unwrap();
    maps.channels.iter_mut().flat_map(|c| &mut c.1).for_each(|v| *v *= 1.2);
    write_exr(&path, &maps, Packing::Raw).unwrap();
    let out = dir.path().join("fit");
    was_fitted(&run(["fit", "leaf", spoilt.to_str().unwrap(), "-o", out.to_str().unwrap(), "--hold-out", "10"]));
    for name in ["front.exr", "front_err.exr", "back.exr"] {
        assert!(std::fs::read(out.join(name)).unwrap() == std::fs::read(fit.join(name)).unwrap(), "{name} differs");
    }
    let held = &FitRecord::read(&out).unwrap().sections["front"].held_out["x"];
    assert!(held.worst_frame == frame && held.worst_frame_chi2 > 5.0, "{held:?}");
}

/// Tampering with one side: factors, after which all maps are solved again so that they agree, and every file is hashed
/// again.
#[derive(Clone, Copy)]
struct Tamper {
    thickness: f64,
    sigma_a: f64,
    gamma: f32,
    rho_s: f32,
    m: f32,
}

const HONEST: Tamper = Tamper { thickness: 1.0, sigma_a: 1.0, gamma: 1.0, rho_s: 1.0, m: 1.0 };

fn tampered(dir: &Path, by: Tamper) -> PathBuf {
    let out = dir.join("fit");
    copy_tree(&fitted().1, &out);
    let mut record = FitRecord::read(&out).unwrap();
    for side in ["front", "back"] {
        let section = record.sections.get_mut(side).unwrap();
        let sigma_a = &mut section.params.get_mut("sigma_a").unwrap().value;
        sigma_a.iter_mut().for_each(|v| *v *= by.sigma_a);
        let (sigma_a, sigma_s) = (sigma_a.clone(), section.params["sigma_s"].value.clone());
        section.params.get_mut("thickness").unwrap().value[0] *= by.thickness;
        let path = out.join(format!("{side}.exr"));
        let mut maps = read_exr(&path).unwrap();
        scale(&mut maps, "thickness.Y", by.thickness as f32);
        scale(&mut maps, "m.Y", by.m);
        for c in ["R", "G", "B"] {
            scale(&mut maps, &format!("gamma.{c}"), by.gamma);
            scale(&mut maps, &format!("rho_s.{c}"), by.rho_s);
            scale(&mut maps, &format!("sigma_a.{c}"), by.sigma_a as f32);
        }
        let thickness = maps.scalar(Quantity::Thickness).unwrap().to_vec();
        for (k, c) in ["R", "G", "B"].iter().enumerate() {
            let slab: Vec<_> =
                thickness.iter().map(|t| slab::response(sigma_a[k], sigma_s[k], f64::from(*t))).collect();
            let gamma = maps.get(&format!("gamma.{c}")).unwrap().to_vec();
            set(&mut maps, &format!("rho_d.{c}"), slab.iter().zip(&gamma).map(|(s, g)| s.rho_d as f32 * g).collect());
            set(&mut maps, &format!("rho_t.{c}"), slab.iter().map(|s| s.rho_t as f32).collect());
        }
        write_exr(&path, &maps, Packing::Zip).unwrap();
    }
    for (name, sum) in &mut record.files {
        *sum = hash::file(&out.join(name)).unwrap();
    }
    record.write(&out).unwrap();
    out
}

fn scale(maps: &mut ChannelMaps, name: &str, by: f32) {
    let plane = maps.get(name).unwrap().iter().map(|v| v * by).collect();
    set(maps, name, plane);
}

fn set(maps: &mut ChannelMaps, name: &str, plane: Vec<f32>) {
    maps.channels.iter_mut().find(|c| c.0 == name).unwrap().1 = plane;
}

/// The list of the issue. Each entry says what is changed, and whether held-out frames and the light box must detect
/// it.
const LIST: [(&str, Tamper, bool, bool); 5] = [
    ("thickness × 1.3", Tamper { thickness: 1.3, ..HONEST }, false, true),
    ("σa × 1.5", Tamper { sigma_a: 1.5, ..HONEST }, true, true),
    ("γ × 0.8", Tamper { gamma: 0.8, ..HONEST }, true, false),
    ("ρs × 2", Tamper { rho_s: 2.0, ..HONEST }, true, false),
    ("m × 2", Tamper { m: 2.0, ..HONEST }, true, false),
];

#[test]
fn a_wrong_but_consistent_fit_is_caught_by_what_was_measured() {
    // Solving the maps again without a change is not tampering. The fit's own ρt is a measurement, and that of the slab
    // is a model of it.
    let dir = tempfile::tempdir().unwrap();
    let honest = report(&tampered(dir.path(), HONEST));
    assert!(off(&honest, "stored") <= 1.0 / 3.0 && off(&honest, "light_box") <= 1.0 / 3.0, "{:#}", honest["held_out"]);
    for (name, by, frames, light_box) in LIST {
        let dir = tempfile::tempdir().unwrap();
        let report = report(&tampered(dir.path(), by));
        let found = [off(&report, "stored"), off(&report, "light_box")];
        eprintln!(
            "{name}: held-out frames are off by {:.2} of their noise, the light box by {:.2}",
            found[0], found[1]
        );
        assert_eq!(report["verdict"]["level"], "bad", "{name}: {:#}", report["verdict"]);
        assert!(!frames || found[0] > 1.0, "{name}: frames {found:?}");
        assert!(!light_box || found[1] > 1.0, "{name}: light box {found:?}");
        assert!(light_box || found[1] < 1.0 / 3.0, "{name} does not touch what comes through: {found:?}");
    }
}

#[cfg(feature = "render")]
mod drawn {
    use super::*;
    use crate::common::mesophyll;
    use std::process::Output;

    /// A scene with one view: the leaf as its scan saw it.
    fn scene(dir: &Path, more: &str) -> PathBuf {
        let path = dir.join("scene.toml");
        let text = format!(
            "schema = 1\nname = \"scan\"\ntolerance = 0.004\n[[leaf]]\nname = \"elm\"\nfit \
             = \"fit\"\n[[instance]]\nleaf = \"elm\"\n\
             [sun]\nzenith_deg = 30\nirradiance = [1.0, 1.0, 1.0]\n[[view]]\nname = \"seen\"\nkind = \"capture\"\nleaf \
             = \"elm\"\n{more}"
        );
        std::fs::write(&path, text).unwrap();
        path
    }

    fn check(verb: &str, scene: &Path) -> Option<Output> {
        let out = scene.with_extension("out");
        let output = mesophyll()
            .args([verb, scene.to_str().unwrap(), "--json", "--out", out.to_str().unwrap()])
            .output()
            .unwrap();
        let none = String::from_utf8_lossy(&output.stderr).contains("no graphics adapter");
        if none {
            eprintln!("skipped: no graphics adapter");
        }
        (!none).then_some(output)
    }

    fn json(output: &Output) -> Value {
        serde_json::from_slice(&output.stdout)
            .unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&output.stderr)))
    }

    #[test]
    fn both_renderers_give_back_frames_that_the_fit_did_not_see() {
        let dir = tempfile::tempdir().unwrap();
        copy_tree(&fitted().1, &dir.path().join("fit"));
        let Some(output) = check("check", &scene(dir.path(), "side = \"front\"\npass = \"x\"\n")) else { return };
        let found = json(&output);
        assert_eq!(output.status.code(), Some(0), "{found:#}");
        let captures = found["captures"].as_array().unwrap();
        assert_eq!(captures.len(), 2, "the view, and the back's own: {captures:#?}");
        for capture in captures {
            for who in ["renderer", "reference"] {
                let drawn = &capture[who];
                assert!(drawn["off"].as_f64().unwrap() < 0.34, "{capture:#}");
                // The limit covers the differences between the tube as a sum of points, with half floats and the slab's
                // curve, and the exact integral. It is a small part of the noise.
                assert!(drawn["from_model"].as_f64().unwrap() < 0.1, "{capture:#}");
            }
            for image in ["measured_image", "image", "reference_image", "residual_image"] {
                assert!(dir.path().join("scene.out").join(capture[image].as_str().unwrap()).is_file());
            }
        }
    }

    #[test]
    fn pictures_of_a_tampered_fit_miss_the_measurement_and_run_ends_with_its_verdict() {
        for (name, by, frames, _) in LIST {
            let dir = tempfile::tempdir().unwrap();
            tampered(dir.path(), by);
            let path = scene(dir.path(), "");
            let Some(output) = check("check", &path) else { return };
            let found = json(&output);
            assert_eq!(output.status.code(), Some(1), "{name}: {found:#}");
            if frames {
                let worst = |who: &str| {
                    let all = found["captures"].as_array().unwrap().iter();
                    all.map(|c| c[who]["off"].as_f64().unwrap()).fold(0.0, f64::max)
                };
                assert!(worst("renderer") > 0.5 && worst("reference") > 0.5, "{name}: {found:#}");
            }
        }
        let dir = tempfile::tempdir().unwrap();
        tampered(dir.path(), LIST[3].1);
        let path = scene(dir.path(), "");
        let out = dir.path().join("out");
        let output =
            mesophyll().args(["run", path.to_str().unwrap(), "--out", out.to_str().unwrap()]).output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert_eq!(output.status.code(), Some(1), "{text}");
        assert!(text.trim_end().lines().last().unwrap().starts_with("Not good:"), "{text}");
    }

    #[test]
    fn a_fit_without_held_out_frames_skips_the_view_by_name() {
        let dir = tempfile::tempdir().unwrap();
        let fit = dir.path().join("fit");
        let capture = fitted().0.to_str().unwrap();
        succeeded(&run(["fit", "leaf", capture, "-o", fit.to_str().unwrap(), "--hold-out", "0"]));
        let Some(output) = check("check", &scene(dir.path(), "")) else { return };
        let found = json(&output);
        assert_eq!(output.status.code(), Some(0), "{found:#}");
        let skipped = found["skipped"].to_string();
        assert!(
            skipped.contains("view seen was skipped") && found["captures"].as_array().unwrap().is_empty(),
            "{found:#}"
        );
    }
}
