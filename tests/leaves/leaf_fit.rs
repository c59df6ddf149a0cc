//! `fit leaf` as a program: recovery, resuming, sharding, and full disks.

use crate::common::{copy_tree, mesophyll, refused, run, scan, succeeded, was_fitted};
use mesophyll::files::image::read_exr;
use mesophyll::files::quantity::Quantity;
use mesophyll::fits::record::FitRecord;
use std::path::Path;
use std::sync::OnceLock;

/// A scan without noise that several tests copy or read.
fn clean_scan() -> &'static Path {
    static SCAN: OnceLock<(tempfile::TempDir, std::path::PathBuf)> = OnceLock::new();
    &SCAN
        .get_or_init(|| {
            let dir = crate::common::kept::kept();
            let capture =
                scan(dir.path(), "balata", &["--size", "48x36", "--frames", "60", "--noise", "0", "--seed", "1"]);
            (dir, capture)
        })
        .1
}

/// A small noisy scan to damage.
pub fn small_scan() -> &'static Path {
    static SCAN: OnceLock<(tempfile::TempDir, std::path::PathBuf)> = OnceLock::new();
    &SCAN
        .get_or_init(|| {
            let dir = crate::common::kept::kept();
            let capture =
                scan(dir.path(), "elm", &["--size", "24x18", "--frames", "16", "--noise", "0.01", "--seed", "1"]);
            (dir, capture)
        })
        .1
}

pub fn damaged(dir: &tempfile::TempDir, damage: impl Fn(&Path)) -> String {
    let copy = dir.path().join("damaged");
    copy_tree(small_scan(), &copy);
    damage(&copy);
    copy.to_str().unwrap().to_string()
}

pub fn fit(capture: &str, dir: &tempfile::TempDir) -> std::process::Output {
    run(["fit", "leaf", capture, "-o", dir.path().join("fit").to_str().unwrap()])
}

#[test]
fn a_noise_free_scan_is_recovered_to_a_thousandth() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("fit");
    was_fitted(&run(["fit", "leaf", clean_scan().to_str().unwrap(), "-o", out.to_str().unwrap()]));
    let record = FitRecord::read(&out).unwrap();
    for side in ["front", "back"] {
        let section = &record.sections[side];
        assert!(
            section.counts["good"] * 100 >= (section.counts["texels"] - section.counts["outside"]) * 98,
            "{:?}",
            section.counts
        );
        for quantity in ["rho_d", "rho_t", "thickness", "sigma_a", "sigma_s"] {
            let error = section.truth[quantity];
            assert!(error.p99_relative < 1e-3, "{side} {quantity}: {error:?}");
        }
    }
    for name in ["front.exr", "back.exr", "front_err.exr", "back_err.exr", "blade.glb", "times.toml"] {
        assert!(out.join(name).exists(), "{name}");
    }
    // ρd + ρt + absorbed = 1 with something absorbed everywhere
    let maps = read_exr(&out.join("front.exr")).unwrap();
    let (mask, d, t) = (
        maps.scalar(Quantity::Mask).unwrap(),
        maps.plane(Quantity::RhoD, 1).unwrap(),
        maps.plane(Quantity::RhoT, 1).unwrap(),
    );
    assert!((0..mask.len()).all(|k| mask[k] != 1.0 || d[k] + t[k] < 1.0));
}

/// The light box is seen at 40°. The slab is solved for that incidence, and ρt is written for a beam along the normal,
/// like the truth.
#[test]
fn an_oblique_light_box_recovers_the_same_leaf() {
    let dir = tempfile::tempdir().unwrap();
    let spec = dir.path().join("oblique.toml");
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("data/leaves/balata.toml")).unwrap();
    assert!(!text.contains("[device]"));
    std::fs::write(&spec, format!("{text}\n[device]\nlightbox_camera_deg = 40.0\n")).unwrap();
    let [capture, out] = ["scan", "fit"].map(|n| dir.path().join(n).to_str().unwrap().to_string());
    let args = ["--size", "32x24", "--frames", "48", "--noise", "0"];
    succeeded(&run([["synth", spec.to_str().unwrap(), "-o", capture.as_str()].as_slice(), args.as_slice()].concat()));
    // The box does not show ρt along the normal. Its conversion is tested here.
    let read = |name: &str| read_exr(&Path::new(&capture).join(name)).unwrap();
    let (truth, box_, leaf, dark) =
        (read("truth/front.exr"), read("lightbox_empty.exr"), read("front/lightbox.exr"), read("dark.exr"));
    let k = (0..32 * 24).find(|&k| k > 12 * 32 + 10 && truth.scalar(Quantity::Mask).unwrap()[k] == 1.0).unwrap();
    let at = |m: &mesophyll::files::image::ChannelMaps| m.get("G").unwrap()[k];
    let ratio = (at(&leaf) - at(&dark)) / (at(&box_) - at(&dark));
    assert!(ratio < 0.97 * truth.plane(Quantity::RhoT, 1).unwrap()[k]);
    let manifest = Path::new(&capture).join("capture.toml");
    let text = std::fs::read_to_string(&manifest).unwrap();
    std::fs::write(&manifest, text.replace("sides = [\"front\", \"back\"]", "sides = [\"front\"]")).unwrap();
    succeeded(&run(["fit", "leaf", &capture, "-o", &out]));
    let record = FitRecord::read(Path::new(&out)).unwrap();
    assert_eq!(record.sections.keys().collect::<Vec<_>>(), ["blade", "front"]);
    for quantity in ["rho_d", "rho_t", "thickness", "sigma_a", "sigma_s"] {
        let error = record.sections["front"].truth[quantity];
        assert!(error.p99_relative < 1e-3, "{quantity}: {error:?}");
    }
}

/// The tube is 2 mm away from its place in `capture.toml`. The mirror strip reveals this, and the message says by how
/// much the fitted normals will lean.
#[test]
fn the_mirror_strip_foretells_the_lean_of_the_normals() {
    let dir = tempfile::tempdir().unwrap();
    let right = scan(dir.path(), "elm", &["--size", "24x18", "--frames", "60", "--noise", "0.01"]);
    let shifted = dir.path().join("shifted");
    copy_tree(&right, &shifted);
    let path = shifted.join("capture.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let moved = text.replace("start_mm = -400.0", "start_mm = -398.0").replace("end_mm = 250.0", "end_mm = 252.0");
    assert_ne!(text, moved);
    std::fs::write(&path, moved).unwrap();
    let look = |capture: &Path| -> serde_json::Value {
        let output = run(["inspect", capture.to_str().unwrap(), "--json"]);
        succeeded(&output);
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let lean = |found: &serde_json::Value, k: usize| found["mirror"][k]["lean_deg"].as_f64().unwrap();
    let fine = look(&right);
    assert!((0..2).all(|k| lean(&fine, k).abs() < 0.02), "{fine:#}");
    assert!(!fine["warnings"].to_string().contains("mirror"), "{fine:#}");
    let wrong = look(&shifted);
    // cos²(55°)/(2 · 100 mm) · 2 mm
    assert!((lean(&wrong, 0) - 0.1885).abs() < 0.02 && lean(&wrong, 1).abs() < 0.02, "{wrong:#}");
    let warnings = wrong["warnings"].to_string();
    assert!(
        warnings.contains("mirror/x")
            && warnings.contains("normals will lean by +0.1")
            && warnings.contains("start_mm"),
        "{warnings}"
    );

    let mean_tilt = |capture: &Path| {
        let out = capture.with_extension("fit");
        was_fitted(&run(["fit", "leaf", capture.to_str().unwrap(), "-o", out.to_str().unwrap()]));
        let maps = read_exr(&out.join("front.exr")).unwrap();
        let (mask, x, z) = (
            maps.scalar(Quantity::Mask).unwrap(),
            maps.plane(Quantity::Normal, 0).unwrap(),
            maps.plane(Quantity::Normal, 2).unwrap(),
        );
        let tilts: Vec<f64> =
            (0..mask.len()).filter(|&k| mask[k] == 1.0).map(|k| f64::from(x[k] / z[k]).atan().to_degrees()).collect();
        tilts.iter().sum::<f64>() / tilts.len() as f64
    };
    let leaned = mean_tilt(&shifted) - mean_tilt(&right);
    assert!((leaned - 0.1885).abs() < 0.04, "the mean normal leans by {leaned}°");
}

#[test]
fn shards_and_a_resumed_run_give_the_bytes_of_one_run() {
    let dir = tempfile::tempdir().unwrap();
    let capture = small_scan().to_str().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_string();
    let (one, parts) = (path("one"), path("parts"));
    succeeded(&run(["fit", "leaf", capture, "-o", &one, "--threads", "1"]));
    succeeded(&run(["fit", "leaf", capture, "-o", &parts, "--shard", "1/2"]));
    refused(&run(["fit", "leaf", capture, "-o", &parts, "--merge"]), 1, &["parts are missing"]);
    succeeded(&run(["fit", "leaf", capture, "-o", &parts, "--shard", "2/2"]));
    succeeded(&run(["fit", "leaf", capture, "-o", &parts, "--merge"]));
    for name in ["fit.toml", "front.exr", "back.exr", "front_err.exr", "blade.glb", "front_rho_d.png"] {
        let [a, b] = [&one, &parts].map(|d| std::fs::read(Path::new(d).join(name)).unwrap());
        assert!(a == b, "{name} differs");
    }
    // The same command again computes nothing.
    let before = std::fs::metadata(Path::new(&one).join("front.exr")).unwrap().modified().unwrap();
    succeeded(&run(["fit", "leaf", capture, "-o", &one]));
    assert_eq!(std::fs::metadata(Path::new(&one).join("front.exr")).unwrap().modified().unwrap(), before);
}

#[test]
#[cfg(unix)]
fn ctrl_c_keeps_finished_parts_and_the_next_run_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let capture = scan(dir.path(), "elm", &["--size", "96x288", "--frames", "16", "--noise", "0.01", "--seed", "2"]);
    let out = dir.path().join("fit");
    let args = ["fit", "leaf", capture.to_str().unwrap(), "-o", out.to_str().unwrap(), "--threads", "1"];
    let mut child = mesophyll().args(args).stderr(std::process::Stdio::piped()).spawn().unwrap();
    // Waits for the first part, then interrupts.
    let parts = |out: &Path| -> usize {
        let folders = std::fs::read_dir(out).into_iter().flatten().flatten().filter(|e| e.path().is_dir());
        folders
            .flat_map(|f| std::fs::read_dir(f.path()).into_iter().flatten().flatten())
            .filter(|e| {
                e.file_name().to_string_lossy().ends_with(".exr") && !e.file_name().to_string_lossy().starts_with('.')
            })
            .count()
    };
    while parts(&out) == 0 && child.try_wait().unwrap().is_none() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let _ = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    let output = child.wait_with_output().unwrap();
    // A machine that finishes first has nothing to resume. Everywhere else the run ends as interrupted.
    if !output.status.success() {
        refused(&output, 130, &["interrupted", "run the same command again"]);
        assert!(parts(&out) > 0);
        assert!(!out.join("fit.toml").exists());
    }
    was_fitted(&run(args));
    assert!(out.join("fit.toml").exists());
}

#[test]
fn the_paper_s_reduction_is_there_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("fit");
    was_fitted(&run(["fit", "leaf", clean_scan().to_str().unwrap(), "-o", out.to_str().unwrap(), "--method", "paper"]));
    let record = FitRecord::read(&out).unwrap();
    assert_eq!(record.options["method"], "paper");
    let f = &record.sections["front"].figures;
    assert!(f["transmittance_rms_exact"] < 0.2 * f["transmittance_rms_paper"], "{f:?}");
}

#[test]
fn a_folder_that_cannot_be_written_is_the_command_line_s_mistake() {
    let capture = small_scan().to_str().unwrap();
    refused(&run(["fit", "leaf", capture, "-o", "/proc/mesophyll"]), 2, &["output folder", "/proc/mesophyll"]);
}

#[test]
#[cfg(unix)]
fn a_full_disk_ends_in_a_sentence_and_leaves_nothing_half_written() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("fit");
    // A limit of the file size replaces a full disk: the same write fails in the middle.
    let script = format!(
        "trap '' XFSZ; ulimit -f 8; exec '{}' --quiet fit leaf '{}' -o '{}'",
        env!("CARGO_BIN_EXE_mesophyll"),
        small_scan().display(),
        out.display()
    );
    let output = std::process::Command::new("sh").args(["-c", &script]).output().unwrap();
    refused(&output, 1, &["cannot write"]);
    assert!(!out.join("fit.toml").exists());
    let litter: Vec<_> = std::fs::read_dir(&out)
        .unwrap()
        .flatten()
        .filter(|e| e.file_name().to_string_lossy().ends_with(".partial"))
        .collect();
    assert!(litter.is_empty(), "{litter:?}");
    // With enough room, the same command continues and succeeds.
    succeeded(&run(["fit", "leaf", small_scan().to_str().unwrap(), "-o", out.to_str().unwrap()]));
    FitRecord::read(&out).unwrap().verify(&out).unwrap();
}

/// The maps of σa and σs explain every texel by a pigment content of its own. The true elm has one σa and σs and an
/// albedo factor γ. The intervals must hold the true leaf described in the same way. The exact slab, which the fit does
/// not use, turns that description back into the true ρd and ρt.
#[test]
fn intervals_of_the_pigment_maps_hold_the_true_leaf() {
    let dir = tempfile::tempdir().unwrap();
    let capture = scan(dir.path(), "elm", &["--size", "60x45", "--frames", "24", "--noise", "0.003", "--seed", "3"]);
    let out = dir.path().join("fit");
    succeeded(&run(["fit", "leaf", capture.to_str().unwrap(), "-o", out.to_str().unwrap()]));
    let record = FitRecord::read(&out).unwrap();
    for side in ["front", "back"] {
        let read = |path: &Path| read_exr(path).unwrap();
        let (fit, err) = (read(&out.join(format!("{side}.exr"))), read(&out.join(format!("{side}_err.exr"))));
        let (own, truth) =
            (read(&out.join(format!("{side}_truth.exr"))), read(&capture.join(format!("truth/{side}.exr"))));
        let mask = fit.scalar(Quantity::Mask).unwrap();
        for name in ["sigma_a", "sigma_s"] {
            let (mut inside, mut all, mut apart) = (0, 0, 0);
            for c in ["R", "G", "B"] {
                let channel = format!("{name}.{c}");
                let [value, error, own] = [&fit, &err, &own].map(|m| m.get(&channel).unwrap());
                let plain = truth.get(&channel).unwrap();
                for k in (0..mask.len()).filter(|&k| mask[k] == 1.0 && own[k].is_finite() && error[k].is_finite()) {
                    inside += usize::from((value[k] - own[k]).abs() <= 1.96 * error[k]);
                    apart += usize::from((value[k] - plain[k]).abs() > 1.96 * error[k]);
                    all += 1;
                }
            }
            let (share, missed) = (inside as f64 / all as f64, apart as f64 / all as f64);
            assert!((0.93..=0.97).contains(&share), "{side} {name}: {share} of {all}");
            // The leaf's single σ is another quantity. At this noise these intervals miss it more than three times as
            // often as they may miss their own quantity, which is one time in twenty.
            assert!(missed > 3.0 * 0.05, "{side} {name}: {missed}");
            let said = record.sections[side].truth[&format!("{name}_map")];
            assert!(
                (said.coverage95.unwrap() - share).abs() < 0.005 && said.judged == Some(all),
                "{said:?} {share} {all}"
            );
        }
        for c in ["R", "G", "B"] {
            let at = |maps: &mesophyll::files::image::ChannelMaps, name: &str, k: usize| {
                f64::from(maps.get(&format!("{name}.{c}")).unwrap()[k])
            };
            for k in (0..mask.len()).filter(|&k| mask[k] == 1.0 && at(&own, "sigma_a", k).is_finite()).step_by(37) {
                let thickness = f64::from(truth.scalar(Quantity::Thickness).unwrap()[k]);
                let slab = mesophyll::optics::slab::medium::response(
                    at(&own, "sigma_a", k),
                    at(&own, "sigma_s", k),
                    thickness,
                );
                let off =
                    [slab.rho_d / at(&truth, "rho_d", k), slab.rho_t / at(&truth, "rho_t", k)].map(|r| (r - 1.0).abs());
                assert!(off.iter().all(|o| *o < 2e-4), "{side} {c} texel {k}: {off:?}");
            }
        }
    }
    let page = dir.path().join("report.html");
    succeeded(&run(["report", out.to_str().unwrap(), "-o", page.to_str().unwrap()]));
    let page = std::fs::read_to_string(page).unwrap();
    assert_eq!(mesophyll::report::figure::unnamed(&record), Vec::<String>::new());
    assert!(
        page.contains("describe the leaf in another way than the parameters")
            && page.contains("described in the same way")
    );
}

/// σa and σs are inversely proportional to the caliper's thickness. The caliper's part of the error is stated
/// separately, and it adds to the fit's own part as squares.
#[test]
fn the_calipers_share_of_an_error_is_stated() {
    let dir = tempfile::tempdir().unwrap();
    let capture = damaged(&dir, |copy| {
        let path = copy.join("capture.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        let h: f64 = text.lines().find_map(|l| l.strip_prefix("thickness_mm = ")).unwrap().parse().unwrap();
        std::fs::write(&path, format!("thickness_err_mm = {}\n{text}", 0.02 * h)).unwrap();
    });
    succeeded(&fit(&capture, &dir));
    let with = FitRecord::read(&dir.path().join("fit")).unwrap();
    let without = tempfile::tempdir().unwrap();
    succeeded(&fit(small_scan().to_str().unwrap(), &without));
    let without = FitRecord::read(&without.path().join("fit")).unwrap();
    for name in ["sigma_a", "sigma_s"] {
        let [a, b] = [&with, &without].map(|r| &r.sections["front"].params[name]);
        assert!(b.stderr_caliper.is_empty(), "{b:?}");
        for c in 0..3 {
            let share = a.stderr_caliper[c] / a.value[c];
            assert!((share - 0.02).abs() < 1e-9, "{share}");
            // The error of the fit without a caliper's error is the fit's own part.
            let sum = b.stderr[c].hypot(a.stderr_caliper[c]);
            assert!(
                (a.stderr[c] / sum - 1.0).abs() < 1e-6 || !sum.is_finite(),
                "{name} {c}: {} and {sum}",
                a.stderr[c]
            );
        }
    }
    let thickness = &with.sections["front"].params["thickness"];
    assert_eq!(thickness.stderr, thickness.stderr_caliper);
}

/// A leaf made of layers is no slab. Its texels are measured as well as those of any leaf, and the report says that the
/// slab does not describe them. From texel to texel, σa follows the pigments.
#[test]
fn a_leaf_of_layers_is_fitted_and_its_misfit_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let capture = scan(dir.path(), "soybean", &["--size", "48x36", "--frames", "60", "--noise", "0.01"]);
    let [out, plots] = ["fit", "plots"].map(|n| dir.path().join(n));
    was_fitted(&run(["fit", "leaf", capture.to_str().unwrap(), "-o", out.to_str().unwrap()]));
    let record = FitRecord::read(&out).unwrap();
    for side in ["front", "back"] {
        let section = &record.sections[side];
        // The scan itself is explained within its noise.
        assert!((section.residuals["gloss"].reduced_chi2 - 1.0).abs() < 0.1);
        for quantity in ["rho_d", "rho_t", "rho_s"] {
            let covered = section.truth[quantity].coverage95.unwrap();
            assert!((0.9..0.99).contains(&covered), "{side} {quantity}: {covered}");
        }
        // The leaf is not. And no σ is compared with a truth that does not have it.
        assert!(section.residuals["transmittance"].reduced_chi2 > 3.0);
        assert!(!section.truth.contains_key("sigma_a") && !section.truth.contains_key("gamma"));
        // Over the whole thickness, σa follows the pigments. But the division of the absorption between σa and
        // thickness differs from that in the leaf.
        for c in ["R", "G", "B"] {
            let [whole, per_length] =
                ["crossing", "absorption"].map(|n| section.figures[&format!("{n}_correlation.{c}")]);
            assert!(whole > 0.98 && per_length < whole, "{side} {c}: {whole} {per_length}");
        }
        assert!(section.figures["crossing_ratio.G"] > 1.0);
    }
    let printed = run(["report", out.to_str().unwrap(), "--markdown", "--plots", plots.to_str().unwrap()]);
    assert_eq!(printed.status.code(), Some(1), "{printed:?}");
    let text = String::from_utf8_lossy(&printed.stdout).into_owned();
    for said in ["soybean is not good", "the model does not describe these measurements", "σa against the pigments"] {
        assert!(text.contains(said), "{said}: {text}");
    }
    let picture = std::fs::read_to_string(plots.join("soybean-front.svg")).unwrap();
    assert!(picture.matches("<circle").count() > 300 && picture.contains("absorption of the mesophyll"));
    let fit = Path::new(env!("CARGO_MANIFEST_DIR")).join("fits/elm");
    let other = run(["report", fit.to_str().unwrap(), "--plots", plots.to_str().unwrap()]);
    refused(&other, 2, &["elm", "the scan of a leaf made of layers"]);
}
