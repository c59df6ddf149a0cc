//! Photographs in open shade and on a light table: from synthesis to a fit, against the truth, and bad pictures.

use crate::common::{copy_tree, refused, run, succeeded, was_fitted};
use mesophyll::capture::photo::{PhotoManifest, reduce};
use mesophyll::files::image::{Packing, read_exr, write_exr};
use mesophyll::fits::leaf_folder::LeafFit;
use mesophyll::optics::side::Side;
use mesophyll::optics::slab::medium;
use mesophyll::synth::spec::LeafSpec;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A noisy capture, made once.
pub(crate) fn made() -> &'static (tempfile::TempDir, PathBuf) {
    static ONCE: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    ONCE.get_or_init(|| {
        let dir = crate::common::kept::kept();
        let folder = dir.path().join("photo");
        let options = ["--acquisition", "photo", "--size", "200x150", "--seed", "2"];
        succeeded(&run([&["synth", "data/leaves/elm.toml", "-o", text(&folder)], &options[..]].concat()));
        (dir, folder)
    })
}

/// What a folder with a change says when it is reduced; empty where nothing is wrong.
pub(crate) fn changed(change: impl FnOnce(&Path)) -> String {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("photo");
    copy_tree(&made().1, &folder);
    change(&folder);
    let outcome = PhotoManifest::read(&folder).and_then(|m| reduce(&folder, &m));
    outcome.err().map_or_else(String::new, |e| e.to_string())
}

pub(crate) fn toml(folder: &Path, from: &str, to: &str) {
    let path = folder.join("capture.toml");
    let old = std::fs::read_to_string(&path).unwrap();
    assert!(old.contains(from), "{from} is not in\n{old}");
    std::fs::write(path, old.replacen(from, to, 1)).unwrap();
}

/// Rewrites a picture row by row.
pub(crate) fn rows(folder: &Path, file: &str, change: impl Fn(&mut [f32])) {
    let mut maps = read_exr(&folder.join(file)).unwrap();
    let w = maps.width;
    maps.channels.iter_mut().for_each(|(_, v)| v.chunks_mut(w).for_each(&change));
    write_exr(&folder.join(file), &maps, Packing::Raw).unwrap();
}

/// The pixels of this small picture are half a millimetre wide, and the finest veins are not. So the maps have texels
/// of four pixels, where the blur of sampling is small beside noise.
///
/// The truth lies within the stated errors: σa and σs of both sides, and the maps of ρd and ρt. What no photograph
/// shows is said by name, and the folder is a leaf fit that the report and the exports take.
#[test]
fn a_photographed_leaf_is_found_within_its_errors() {
    let (dir, folder) = made();
    let (out, coarse) = (dir.path().join("fit"), dir.path().join("coarse"));
    copy_tree(folder, &coarse);
    toml(&coarse, "noise_photon", "texel_mm = 2.0\nnoise_photon");
    let folder = &coarse;
    was_fitted(&run(["fit", "leaf", text(folder), "-o", text(&out)]));
    let fit = LeafFit::open(&out).unwrap();
    let spec = LeafSpec::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("data/leaves/elm.toml")).unwrap();
    for side in [Side::Front, Side::Back] {
        let section = fit.section(side).unwrap();
        for (name, truth) in [("sigma_a", spec.interior.sigma_a), ("sigma_s", spec.interior.sigma_s)] {
            let found = &section.params[name];
            for (c, truth) in truth.into_iter().enumerate() {
                let (value, error) = (found.value[c], found.stderr[c]);
                println!("{} {name} {c}: {value:.3} ± {error:.3}, truth {truth}", side.name());
                // Twelve numbers: three standard errors are passed by chance once in thirty.
                assert!((value - truth).abs() < 3.0 * error, "{} {name} {c}", side.name());
                assert!(error < 0.4 * truth, "{} {name} {c}: an error of {error} says nothing", side.name());
            }
        }
        for name in ["rho_d", "rho_t"] {
            let truth = section.truth[name];
            println!("{} {name}: {truth:?}", side.name());
            assert!(truth.coverage95.unwrap() > 0.9, "{} {name}: {truth:?}", side.name());
        }
        let errors = read_exr(&out.join(format!("{}_err.exr", side.name()))).unwrap();
        let open = |name: &str| errors.get(name).unwrap().iter().all(|e| e.is_nan() || e.is_infinite());
        assert!(open("normal.X") && open("rho_s.G") && open("m.Y") && !open("rho_d.G"));
    }
    let said = |name: &str| fit.record.options[name].clone();
    assert_eq!(said("rho_t"), "seen on the light table: front, back");
    assert!(said("normal").starts_with("undetermined") && said("gloss").starts_with("stated"));
    // A tick is two of these pixels from the next, which is too fine, so the marks alone give the scale.
    let scale_err = fit.section(Side::Front).unwrap().figures["scale_relative_err"];
    assert!(said("scale").contains("two marks") && scale_err < 0.03, "{}", said("scale"));
    // The field is 76 mm wide or 57 mm tall in the upper .76 of the picture.
    let pixel = 4.0 * f64::max(76.0 / 200.0, 57.0 / (0.76 * 150.0));
    let off = fit.texel_mm().unwrap() / pixel - 1.0;
    assert!(off.abs() < 3.0 * scale_err, "{off} {scale_err}");
    let report = run(["report", text(&out), "-o", text(&dir.path().join("fit.html"))]);
    assert!(matches!(report.status.code(), Some(0 | 1)), "{report:?}");
    succeeded(&run(["export", text(&out), "--to", "gltf", "-o", text(&dir.path().join("fit.glb"))]));
    // The same command again finds its own fit and writes nothing.
    let written = || std::fs::metadata(out.join("front.exr")).unwrap().modified().unwrap();
    let before = written();
    was_fitted(&run(["fit", "leaf", text(folder), "-o", text(&out)]));
    assert_eq!(before, written());
    refused(&run(["fit", "leaf", text(folder), "-o", text(&out), "--gloss", "1.4,0.3"]), 2, &["[gloss]"]);
}

/// Root mean square of (found − truth − the leaf's mean of that)/error over the good texels of each side, channel by
/// channel. What all texels share is left out, so it is 1 where the errors of single texels are right. `rho_d` holds
/// the place-to-place variation of gloss, which the errors bound; `shown` is ρd with gloss, without that part.
pub(crate) fn scatter(folder: &Path) -> Vec<(String, f64)> {
    let reduced = reduce(folder, &PhotoManifest::read(folder).unwrap()).unwrap();
    let mut found = Vec::new();
    for side in [Side::Front, Side::Back] {
        let maps = &reduced.sides[side];
        let truth = read_exr(&folder.join(format!("truth/{}.exr", side.name()))).unwrap();
        let plane = |name: &str| truth.get(name).unwrap();
        let on_texels = |plane: &dyn Fn(usize) -> f64, k: usize| {
            // The truth has the pixels of the front's picture, mirrored for the back, as the maps are.
            let (column, row, step) = (k % reduced.width, k / reduced.width, reduced.step);
            let column = if side == Side::Back { reduced.width - 1 - column } else { column };
            let mut sum = 0.0;
            for (i, j) in (0..step).flat_map(|j| (0..step).map(move |i| (i, j))) {
                let x = reduced.origin[0] + column * step + i;
                let x = if side == Side::Back { truth.width - 1 - x } else { x };
                sum += plane((reduced.origin[1] + row * step + j) * truth.width + x);
            }
            sum / (step * step) as f64
        };
        for name in ["shown", "rho_d", "rho_t"] {
            for (c, letter) in ["R", "G", "B"].into_iter().enumerate() {
                let (albedo, highlight) = (plane(&format!("albedo.{letter}")), plane("highlight.Y"));
                let through = plane(&format!("transmittance.{letter}"));
                let truth = |k: usize| match name {
                    "shown" => f64::from(albedo[k] + highlight[k]),
                    "rho_d" => f64::from(albedo[k]),
                    _ => f64::from(through[k]),
                };
                let good = (0..maps.status.len()).filter(|&k| maps.status[k] == 1);
                let off: Vec<(f64, f64)> = good
                    .map(|k| {
                        let by_gloss = 0.1 * maps.gloss.share;
                        let (value, error) = match name {
                            "shown" => (maps.rho_d[k][c], (maps.rho_d_err[k][c].powi(2) - by_gloss.powi(2)).sqrt()),
                            "rho_d" => (maps.rho_d[k][c], maps.rho_d_err[k][c]),
                            _ => (maps.rho_t[k][c], maps.rho_t_err[k][c]),
                        };
                        (value - on_texels(&truth, k), error)
                    })
                    .collect();
                let weight: f64 = off.iter().map(|o| o.1.powi(-2)).sum();
                let mean = off.iter().map(|o| o.0 * o.1.powi(-2)).sum::<f64>() / weight;
                let squares: f64 = off.iter().map(|o| ((o.0 - mean) / o.1).powi(2)).sum();
                found.push((format!("{} {name}.{letter}", side.name()), (squares / off.len() as f64).sqrt()));
            }
        }
    }
    found
}

/// Errors of single texels are neither too small nor too large: with every picture, and where the back's ρt is taken
/// from the front's picture.
#[test]
fn errors_of_texels_are_as_large_as_the_scatter() {
    for (what, line) in [("both sides", ""), ("one side", "turned = \"table_turned.exr\"\n")] {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("photo");
        copy_tree(&made().1, &folder);
        toml(&folder, "noise_photon", "texel_mm = 2.0\nnoise_photon");
        if !line.is_empty() {
            toml(&folder, line, "");
        }
        let found = scatter(&folder);
        found.iter().for_each(|(name, scatter)| println!("{what}: {name} {scatter:.3}"));
        for (name, scatter) in found {
            // Place, blur and gloss are bounds rather than deviations: errors may be some larger than the scatter.
            let least = if name.contains("rho_d") { 0.3 } else { 0.6 };
            assert!((least..1.25).contains(&scatter), "{what}: {name} {scatter}");
        }
    }
}

/// What the photographs of open shade and of the table measure is the slab's ρd and ρt: light from the whole
/// hemisphere, added up direction by direction, that is scattered once towards a camera along the normal. With an
/// albedo of 1e-3 a second scattering adds at most that share.
#[test]
fn a_camera_over_open_shade_sees_the_slab() {
    const STEPS: usize = 20_000;
    for delta in [0.2, 1.0, 3.0] {
        let omega = 1e-3;
        let slab = medium::response((1.0 - omega) * delta, omega * delta, 1.0);
        let (mut up, mut down) = (0.0, f64::exp(-delta));
        for k in 0..STEPS {
            let mu: f64 = (k as f64 + 0.5) / STEPS as f64;
            // Radiance 1 from every direction; the source of the scattered light at depth x is ω/2 ∫ exp(−x/μ) dμ, and
            // exp(−x) or exp(−(δ − x)) of it reaches the camera.
            up += 0.5 * omega * (1.0 - f64::exp(-delta * (1.0 + 1.0 / mu))) / (1.0 + 1.0 / mu) / STEPS as f64;
            let steep = 1.0 / mu - 1.0;
            down += 0.5 * omega * f64::exp(-delta) * -f64::exp_m1(-delta * steep) / steep / STEPS as f64;
        }
        assert!((slab.rho_d / up - 1.0).abs() < 2.0 * omega, "{delta}: {} {up}", slab.rho_d);
        let scattered = (down - f64::exp(-delta)) / down;
        assert!((slab.rho_t / down - 1.0).abs() < 2.0 * omega * scattered + 1e-8, "{delta}: {} {down}", slab.rho_t);
    }
}

/// A range of thickness enters the errors in full: σ × thickness is what was measured.
#[test]
fn a_range_of_thickness_widens_every_error() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("photo");
    copy_tree(&made().1, &folder);
    let stated = std::fs::read_to_string(folder.join("capture.toml")).unwrap();
    let lines = stated.lines().filter(|l| !l.starts_with("thickness")).collect::<Vec<_>>().join("\n");
    let ranged = lines.replace("transfer =", "thickness_range_mm = [0.1, 0.2]\ntransfer =");
    std::fs::write(folder.join("capture.toml"), ranged).unwrap();
    let out = dir.path().join("fit");
    was_fitted(&run(["fit", "leaf", text(&folder), "-o", text(&out)]));
    let fit = LeafFit::open(&out).unwrap();
    let found = &fit.section(Side::Front).unwrap().params["sigma_a"];
    // A thickness that may lie anywhere in a range has the standard deviation of its width over √12.
    let width = 0.1 / 12f64.sqrt() / 0.15;
    assert!((0..3).all(|c| found.stderr[c] / found.value[c] > width && found.stderr[c] / found.value[c] < 1.2 * width));
    assert_eq!(found.undetermined.len(), 3, "{found:?}");
}

/// Where no gloss is stated, the truth is within what is said; and σ is not called determined with more than that.
#[test]
fn without_stated_gloss_the_truth_is_within_wider_errors() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("photo");
    copy_tree(&made().1, &folder);
    let path = folder.join("capture.toml");
    let stated = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, &stated[..stated.find("[gloss]").unwrap()]).unwrap();
    toml(&folder, "noise_photon", "texel_mm = 2.0\nnoise_photon");
    let out = dir.path().join("fit");
    was_fitted(&run(["fit", "leaf", text(&folder), "-o", text(&out)]));
    let fit = LeafFit::open(&out).unwrap();
    assert!(fit.record.options["gloss"].starts_with("undetermined"));
    let spec = LeafSpec::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("data/leaves/elm.toml")).unwrap();
    for (side, gloss) in [(Side::Front, spec.front.rho_s), (Side::Back, spec.back.rho_s)] {
        let section = fit.section(side).unwrap();
        let [share, err, most] = ["gloss_share", "gloss_stderr", "gloss_at_most"].map(|name| section.figures[name]);
        println!("{}: gloss {share:.4} ± {err:.4}, at most {most:.4}, truth {gloss}", side.name());
        assert!(gloss < most && (share - gloss).abs() < 2.0 * err && err < 0.02, "{share} ± {err}");
        for (name, truth) in [("sigma_a", spec.interior.sigma_a), ("sigma_s", spec.interior.sigma_s)] {
            let found = &section.params[name];
            for (c, truth) in truth.into_iter().enumerate() {
                let (value, error) = (found.value[c], found.stderr[c]);
                println!("{} {name} {c}: {value:.3} ± {error:.3}, truth {truth}", side.name());
                assert!((value - truth).abs() < 3.0 * error, "{} {name} {c}", side.name());
            }
        }
        for name in ["rho_d", "rho_t"] {
            assert!(section.truth[name].coverage95.unwrap() > 0.9, "{name}: {:?}", section.truth[name]);
        }
    }
}

/// The table of `docs/evidence/photo.md`: leaves of six species and several seeds, each with its own errors of card,
/// sheet, table, caliper and marks. Pulls are (found − truth)/(stated error); their root mean square over many captures
/// is 1 where errors are right. `MESOPHYLL_SEEDS` is the number of seeds.
#[test]
#[ignore = "many minutes: prints the table of docs/evidence/photo.md"]
fn an_ensemble_of_leaves() {
    let seeds: u64 = std::env::var("MESOPHYLL_SEEDS").ok().and_then(|n| n.parse().ok()).unwrap_or(4);
    let dir = tempfile::tempdir().unwrap();
    println!("| leaf | ρt of the back | σa: pull, error | σs: pull, error | ρd within 95 % | ρt of front | of back |");
    println!("|---|---|---|---|---|---|---|");
    for name in ["elm", "alpinia", "balata", "omoto", "pelargonium", "prunus"] {
        let path = format!("data/leaves/{name}.toml");
        let spec = LeafSpec::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join(&path)).unwrap();
        // Sums of squared pulls and of relative errors of σa and σs, and of coverages; with and without the back's
        // picture.
        let mut sums = [[[0.0; 4]; 2]; 2];
        let mut within = [[0.0; 4]; 2];
        for seed in 1..=seeds {
            let folder = dir.path().join(format!("{name}-{seed}"));
            let seed = seed.to_string();
            let options = ["--acquisition", "photo", "--size", "200x150", "--seed", &seed];
            succeeded(&run([&["synth", &path, "-o", text(&folder)], &options[..]].concat()));
            toml(&folder, "noise_photon", "texel_mm = 2.0\nnoise_photon");
            for one in [0, 1] {
                if one == 1 {
                    toml(&folder, "turned = \"table_turned.exr\"\n", "");
                }
                let out = dir.path().join(format!("{name}-{seed}-{one}"));
                was_fitted(&run(["fit", "leaf", text(&folder), "-o", text(&out)]));
                let fit = LeafFit::open(&out).unwrap();
                for (s, side) in [Side::Front, Side::Back].into_iter().enumerate() {
                    let section = fit.section(side).unwrap();
                    let truths = [("sigma_a", spec.interior.sigma_a), ("sigma_s", spec.interior.sigma_s)];
                    for (sum, (name, truth)) in sums[one].iter_mut().zip(truths) {
                        let found = &section.params[name];
                        for (c, truth) in truth.into_iter().enumerate().filter(|(c, _)| found.stderr[*c].is_finite()) {
                            let pull = (found.value[c] - truth) / found.stderr[c];
                            *sum = [
                                sum[0] + pull * pull,
                                sum[1] + found.stderr[c] / truth,
                                sum[2] + 1.0,
                                sum[3].max(pull.abs()),
                            ];
                        }
                    }
                    within[one][s] += section.truth["rho_d"].coverage95.unwrap();
                    within[one][2 + s] += section.truth["rho_t"].coverage95.unwrap();
                }
            }
        }
        for one in [0, 1] {
            let say = |[squares, errors, n, worst]: [f64; 4]| {
                format!("{:.2} ({worst:.1}), {:.1} %", (squares / n).sqrt(), 100.0 * errors / n)
            };
            let [front, back, t_front, t_back] = within[one].map(|w| 100.0 * w / seeds as f64);
            println!(
                "| {name} | {} | {} | {} | {front:.1}, {back:.1} | {t_front:.1} | {t_back:.1} |",
                ["seen", "the front's"][one],
                say(sums[one][0]),
                say(sums[one][1])
            );
        }
    }
}
