//! Plausible fit folders and captures, for tests of their readers. They are made up but consistent, so that a right
//! report can be distinguished from a wrong one.
#![allow(dead_code)]

use mesophyll::base::solvers::{Termination, TraceRow};
use mesophyll::files::image::{self, ChannelMaps, Packing};
use mesophyll::files::quantity::Quantity;
use mesophyll::fits::record::{
    FitParameter, FitPhase, FitRecord, FitTimes, RecordSection, ResidualStatistics, TruthError,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;
use std::path::Path;

/// The differences between a sample fit and a good one.
#[derive(Debug, Clone)]
pub struct Sample {
    pub name: String,
    pub width: usize,
    pub height: usize,
    pub seed: u64,
    /// Whether the truth lies in the folder.
    pub truth: bool,
    /// The true standard errors divided by the stated ones.
    pub overconfidence: f32,
    pub sides: Vec<&'static str>,
}

impl Default for Sample {
    fn default() -> Self {
        let sides = vec!["front", "back"];
        Sample { name: "sample".into(), width: 72, height: 54, seed: 1, truth: true, overconfidence: 1.0, sides }
    }
}

/// Distance from the outline (positive inside, in leaf half-widths) and nearness to a vein (0 … 1).
pub fn leaf_at(u: f32, v: f32) -> (f32, f32) {
    // u and v are from −1 to 1, and the leaf lies along u.
    let along = (u + 0.94) / 1.86;
    let half =
        if (0.0..=1.0).contains(&along) { 0.95 * along.powf(0.55) * (1.0 - along).powf(0.8) * 1.55 } else { -1.0 };
    let midrib = (-(v / 0.022).powi(2)).exp();
    let branch = (along * 8.0 - v.abs() * 3.0).fract();
    let secondary = 0.7 * (-((branch - 0.5) / 0.06).powi(2)).exp();
    (half - v.abs(), midrib.max(secondary))
}

fn normal(rng: &mut Pcg64Mcg) -> f32 {
    let (a, b): (f32, f32) = (rng.random::<f32>().max(1e-7), rng.random());
    (-2.0 * a.ln()).sqrt() * (std::f32::consts::TAU * b).cos()
}

/// For every channel: name, truth away from veins, truth on a vein, relative error.
const CHANNELS: [(&str, f32, f32, f32); 22] = [
    ("rho_d.R", 0.075, 0.12, 0.01),
    ("rho_d.G", 0.14, 0.20, 0.01),
    ("rho_d.B", 0.045, 0.07, 0.015),
    ("rho_s.R", 0.035, 0.030, 0.02),
    ("rho_s.G", 0.035, 0.030, 0.02),
    ("rho_s.B", 0.036, 0.031, 0.02),
    ("m.Y", 0.24, 0.32, 0.012),
    ("rho_t.R", 0.06, 0.10, 0.01),
    ("rho_t.G", 0.15, 0.21, 0.01),
    ("rho_t.B", 0.02, 0.035, 0.03),
    ("sigma_a.R", 5.1, 2.0, 0.015),
    ("sigma_a.G", 2.9, 1.2, 0.015),
    ("sigma_a.B", 8.4, 4.0, 0.04),
    ("sigma_s.R", 9.6, 8.1, 0.02),
    ("sigma_s.G", 10.2, 8.6, 0.02),
    ("sigma_s.B", 9.1, 7.7, 0.03),
    ("thickness.Y", 0.16, 0.29, 0.006),
    ("gamma.R", 0.99, 1.07, 0.01),
    ("gamma.G", 0.99, 1.07, 0.01),
    ("gamma.B", 0.99, 1.07, 0.015),
    ("normal.X", 0.0, 0.1, 0.0),
    ("normal.Y", 0.0, 0.05, 0.0),
];

/// Writes a whole leaf fit.
pub fn write_fit(folder: &Path, sample: &Sample) {
    std::fs::create_dir_all(folder).unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(sample.seed);
    let mut sections = BTreeMap::new();
    for (k, side) in sample.sides.iter().enumerate() {
        sections.insert(side.to_string(), write_side(folder, sample, side, 1.0 + 0.4 * k as f32, &mut rng));
    }
    let names = BTreeMap::from([
        ("-1".to_string(), "saturated".to_string()),
        ("-2".to_string(), "more_light_out_than_in".to_string()),
    ]);
    let record = FitRecord {
        schema: 1,
        kind: mesophyll::fits::record::FitKind::Leaf,
        name: sample.name.clone(),
        program: "mesophyll 0.1.0".into(),
        input_hash: "5f0c2b9e".repeat(8),
        termination: Some(Termination::CostConverged),
        options: BTreeMap::from([
            ("lobe".to_string(), "beckmann".to_string()),
            ("seed".to_string(), sample.seed.to_string()),
        ]),
        defects: names,
        sections,
        ..FitRecord::default()
    };
    record.write(folder).unwrap();
    times().write(folder).unwrap();
}

fn write_side(folder: &Path, sample: &Sample, side: &str, tone: f32, rng: &mut Pcg64Mcg) -> RecordSection {
    let (w, h) = (sample.width, sample.height);
    let (mut fit, mut truth, mut error) = (ChannelMaps::new(w, h), ChannelMaps::new(w, h), ChannelMaps::new(w, h));
    let place = |i: usize, flip: bool| {
        let x = if flip { w - 1 - i % w } else { i % w };
        let (u, v) = ((x as f32 + 0.5) / w as f32 * 2.0 - 1.0, ((i / w) as f32 + 0.5) / h as f32 * 2.0 - 1.0);
        leaf_at(u, v)
    };
    let mut mask = vec![0f32; w * h];
    for (i, m) in mask.iter_mut().enumerate() {
        let (inside, vein) = place(i, side == "back");
        *m = match inside {
            d if d <= 0.0 => 0.0,
            _ if rng.random::<f32>() < 0.004 => -1.0,
            _ if vein > 0.97 && rng.random::<f32>() < 0.03 => -2.0,
            _ => 1.0,
        };
    }
    for (name, plain, on_vein, relative) in CHANNELS {
        let planes: Vec<[f32; 3]> = (0..w * h)
            .map(|i| {
                if mask[i] != 1.0 {
                    return [f32::NAN; 3];
                }
                let (inside, vein) = place(i, side == "back");
                let wave = 1.0 + 0.06 * (9.0 * inside).sin() + 0.05 * ((i % w) as f32 / w as f32 * 11.0).cos();
                let t = if name.starts_with("normal") {
                    0.12 * (13.0 * inside).sin() * if name.ends_with('X') { 1.0 } else { -0.7 } + on_vein * vein
                } else {
                    (plain + (on_vein - plain) * vein) * wave * if name.starts_with("rho_d") { tone } else { 1.0 }
                };
                let e = if relative > 0.0 { relative * t } else { 0.006 };
                [t, t + e * normal(rng), e / sample.overconfidence]
            })
            .collect();
        for (k, maps) in [&mut truth, &mut fit, &mut error].into_iter().enumerate() {
            maps.push(name, planes.iter().map(|p| p[k]).collect());
        }
    }
    let z = (0..w * h).map(|i| {
        let [x, y] = ["normal.X", "normal.Y"].map(|n| fit.get(n).unwrap()[i]);
        (1.0 - x * x - y * y).max(0.0).sqrt()
    });
    let z: Vec<f32> = z.collect();
    fit.add(Quantity::Normal, 2, z);
    let chi2 = (0..w * h).map(|i| {
        if mask[i] == 1.0 { 1.0 + 0.1 * normal(rng) + 0.5 * place(i, side == "back").1 * 0.3 } else { f32::NAN }
    });
    let chi2: Vec<f32> = chi2.collect();
    let good: Vec<f32> = chi2.iter().copied().filter(|c| c.is_finite()).collect();
    let mean = f64::from(good.iter().sum::<f32>()) / good.len() as f64;
    let worst = (0..w * h).filter(|&i| chi2[i].is_finite()).max_by(|&a, &b| chi2[a].total_cmp(&chi2[b])).unwrap();
    let worst_value = f64::from(chi2[worst]);
    fit.add(Quantity::ReducedChi2, 0, chi2);
    let count = |code: f32| mask.iter().filter(|m| **m == code).count();
    let counts = BTreeMap::from([
        ("texels".to_string(), w * h),
        ("good".to_string(), count(1.0)),
        ("outside".to_string(), count(0.0)),
        ("saturated".to_string(), count(-1.0)),
        ("more_light_out_than_in".to_string(), count(-2.0)),
    ]);
    let texels = counts["good"];
    fit.add(Quantity::Mask, 0, mask);
    image::write_exr(&folder.join(format!("{side}.exr")), &fit, Packing::Zip).unwrap();
    image::write_exr(&folder.join(format!("{side}_err.exr")), &error, Packing::Zip).unwrap();
    if sample.truth {
        image::write_exr(&folder.join(format!("truth_{side}.exr")), &truth, Packing::Zip).unwrap();
        truth.channels.retain(|(name, _)| name.starts_with("sigma"));
        image::write_exr(&folder.join(format!("{side}_truth.exr")), &truth, Packing::Zip).unwrap();
    }
    let covered = if sample.overconfidence == 1.0 { 0.951 } else { 0.62 };
    let truths = [
        ("rho_d", 0.0068),
        ("rho_t", 0.0067),
        ("sigma_a_map", 0.013),
        ("sigma_a", 0.001),
        ("thickness", 0.004),
        ("m", 0.0081),
    ];
    let truth_rows = truths.map(|(n, e)| {
        (
            n.to_string(),
            TruthError {
                median_relative: e,
                p99_relative: 3.8 * e,
                coverage95: Some(if n == "sigma_a" { 1.0 } else { covered }),
                judged: Some(if n == "sigma_a" { 3 } else { texels }),
            },
        )
    });
    let nudge = 0.01 * normal(rng).clamp(-1.5, 1.5) as f64;
    RecordSection {
        counts,
        terminations: BTreeMap::from([
            ("cost_converged".to_string(), texels * 9 / 10),
            ("gradient_small".to_string(), texels - texels * 9 / 10 - 2),
            ("iteration_limit".to_string(), 2),
            ("leaf_wide:step_small".to_string(), 1),
        ]),
        residuals: BTreeMap::from([(
            "gloss".to_string(),
            ResidualStatistics {
                samples: texels * 600,
                chi2: mean * texels as f64 * 592.0,
                reduced_chi2: mean,
                rms: 0.0061,
                worst: worst_value,
                worst_at: [worst % w, worst / w],
            },
        )]),
        correlation_names: ["σa.R", "σa.G", "σa.B", "σs.R", "σs.G", "σs.B"].map(String::from).to_vec(),
        correlation: (0..6i32)
            .map(|i| {
                (0..6i32)
                    .map(|j| {
                        if i == j {
                            1.0
                        } else if (i - j).abs() == 3 {
                            -0.62
                        } else {
                            0.08 * f64::from((i + j) % 3)
                        }
                    })
                    .collect()
            })
            .collect(),
        condition: Some(41.7),
        rank: Some(6),
        figures: BTreeMap::from([
            ("down_weighted_texels".to_string(), 12.0),
            ("transmittance_rms_exact".to_string(), 0.0013),
            ("transmittance_rms_paper".to_string(), 0.0094),
            ("a_figure_that_nobody_named".to_string(), 0.0004),
        ]),
        truth: if sample.truth { truth_rows.into_iter().collect() } else { BTreeMap::new() },
        params: BTreeMap::from([
            (
                "sigma_a".to_string(),
                param(&[5.1, 2.9, 8.4], &[0.06, 0.04, f64::INFINITY], "1/mm", &["sigma_a.B: at least 7.9 1/mm"], nudge),
            ),
            ("sigma_s".to_string(), param(&[9.6, 10.2, 9.1], &[0.11, 0.10, 0.31], "1/mm", &[], nudge)),
            ("thickness".to_string(), param(&[0.1612], &[0.004], "mm", &[], 0.0)),
        ]),
        ..RecordSection::default()
    }
}

fn param(value: &[f64], stderr: &[f64], unit: &str, undetermined: &[&str], nudge: f64) -> FitParameter {
    FitParameter {
        value: value.iter().map(|v| v * (1.0 + nudge)).collect(),
        stderr: stderr.to_vec(),
        unit: unit.into(),
        undetermined: undetermined.iter().map(|s| s.to_string()).collect(),
        ..FitParameter::default()
    }
}

fn times() -> FitTimes {
    let phase = |name: &str, seconds| FitPhase { name: name.into(), seconds };
    let trace = |rate: f64, floor: f64, per_step: f64, steps: usize| -> Vec<TraceRow> {
        (0..steps)
            .map(|k| TraceRow {
                iteration: k,
                evaluations: 2 * k + 1,
                elapsed_s: per_step * k as f64,
                cost: 296.0 + 4.0e4 * rate.powi(k as i32),
                gradient: 1.0e3 * rate.powi(k as i32),
                step: 0.5 * rate.powi(k as i32),
                truth_error: Some(floor + 0.4 * rate.powf(0.5 * k as f64)),
            })
            .collect()
    };
    FitTimes {
        capture: None,
        phases: vec![
            phase("read_and_calibrate", 3.4),
            phase("gloss_fit", 21.9),
            phase("light_box", 0.6),
            phase("slab_inversion", 4.8),
            phase("reconstruct_blade", 1.1),
            phase("write", 0.9),
        ],
        total_s: 33.1,
        threads: 2,
        peak_memory_mib: Some(412.0),
        traces: BTreeMap::from([
            ("leaf_wide".to_string(), trace(0.12, 0.004, 0.8, 7)),
            ("typical_texel".to_string(), trace(0.2, 0.007, 2.1e-5, 8)),
            ("worst_texel".to_string(), trace(0.55, 0.05, 2.2e-5, 19)),
        ]),
    }
}

/// `check.json`, `plan.json` and pictures as a run writes them.
pub fn write_run(folder: &Path, passed: bool) {
    std::fs::create_dir_all(folder).unwrap();
    let (w, h) = (160, 120);
    let shade = |gain: f32| -> Vec<u8> {
        (0..w * h)
            .flat_map(|i| {
                let (u, v) = ((i % w) as f32 / w as f32 * 2.0 - 1.0, (i / w) as f32 / h as f32 * 2.0 - 1.0);
                let (inside, vein) = leaf_at(u, v);
                let l = if inside > 0.0 { gain * (1.0 + vein) * (0.6 + 0.3 * u) } else { 0.02 };
                [0.10 * l, 0.2 * l, 0.05 * l].map(image::to_srgb8)
            })
            .collect()
    };
    image::write_png(&folder.join("top.png"), w, h, &shade(2.0)).unwrap();
    image::write_png(&folder.join("top-reference.png"), w, h, &shade(2.01)).unwrap();
    image::write_png(&folder.join("top-difference.png"), w, h, &shade(0.1)).unwrap();
    image::write_png(&folder.join("top-flip.png"), w, h, &shade(0.2)).unwrap();
    let check = serde_json::json!({
        "passed": passed, "adapter": "llvmpipe (software)",
        "views": [{"name": "top", "kind": "perspective", "flip_mean": 0.004, "flip_p99": 0.021, "max_error": 0.031,
                   "threshold_flip_p99": 0.04, "threshold_max_error": 0.05, "noise_flip_p99": 0.012,
                       "noise_max_error": 0.008,
                   "flip_top": 0.1, "difference_top": 0.0625, "why": if passed { vec![] } else { vec!["pixel (3, 4) is \
                    too light"] },
                   "frame_ms_median": 18.2, "frame_ms_p95": 21.7, "passed": passed}]
    });
    std::fs::write(folder.join("check.json"), check.to_string()).unwrap();
    let plan = serde_json::json!({
        "needed": [{"name": "leaf fit elm", "reason": "the scene shows this leaf"}],
        "left_out": [{"name": "beam fit", "reason": "the scene has no wind", "saved": "0.4 s, 2 kB, a vertex \
         deformation"},
                     {"name": "sky polynomials", "reason": "the sun does not move", "saved": "27 kB"}]
    });
    std::fs::write(folder.join("plan.json"), plan.to_string()).unwrap();
}

/// A small capture of a disk-shaped leaf under a thin infinite tube. The exact radiance ρd·(2/π)·…/r² is not needed
/// here; any smooth decrease will do.
pub fn write_capture(folder: &Path, sides: &[&str], passes: &[&str], noise: f32) {
    const W: usize = 24;
    const H: usize = 18;
    const FRAMES: usize = 48;
    let mut rng = Pcg64Mcg::seed_from_u64(11);
    let list = |l: &[&str]| l.iter().map(|s| format!("\"{s}\"")).collect::<Vec<_>>().join(", ");
    let mut toml = format!(
        "schema = 1\nname = \"disk\"\nwidth = {W}\nheight = {H}\ntexel_mm = 1.0\nthickness_mm = 0.2\ncamera_deg = \
         55.0\n\
         noise_relative = {noise}\nnoise_floor = 5e-4\nsides = [{}]\n[tube]\nheight_mm = 100.0\nlength_mm = \
         500.0\nradius_mm = 2.5\n",
        list(sides)
    );
    for p in passes {
        toml.push_str(&format!("[[pass]]\nname = \"{p}\"\nstart_mm = -400.0\nend_mm = 250.0\nframes = {FRAMES}\n"));
    }
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(folder.join("capture.toml"), toml).unwrap();
    let inside = |i: usize| {
        let (x, y) = ((i % W) as f32 - 11.5, (i / W) as f32 - 8.5);
        (x / 11.0).powi(2) + (y / 8.0).powi(2) < 1.0
    };
    let light = |k: usize, i: usize| {
        let u = -4.0 + 6.5 * k as f32 / (FRAMES - 1) as f32 - (i % W) as f32 / 100.0;
        1.0 / (1.0 + u * u)
    };
    let mut noisy = |v: f32| v + (noise * v).hypot(5e-4) * normal(&mut rng);
    let mut frame = |w: usize, h: usize, value: &dyn Fn(usize, usize) -> f32| {
        let mut maps = ChannelMaps::new(w, h);
        for (c, name) in ["R", "G", "B"].iter().enumerate() {
            maps.push(*name, (0..w * h).map(|i| noisy(value(c, i))).collect());
        }
        maps
    };
    let albedo = [0.08, 0.15, 0.05];
    for side in sides {
        for pass in passes {
            for k in 0..FRAMES {
                let maps = frame(W, H, &|c, i| if inside(i) { albedo[c] * light(k, i) } else { 0.0 });
                image::write_exr(&folder.join(side).join(pass).join(format!("{k:04}.exr")), &maps, Packing::Zip)
                    .unwrap();
            }
        }
        let maps = frame(W, H, &|c, i| if inside(i) { 0.9 * albedo[c] } else { 0.9 });
        image::write_exr(&folder.join(side).join("lightbox.exr"), &maps, Packing::Zip).unwrap();
    }
    for pass in passes {
        for k in 0..FRAMES {
            let maps = frame(8, 6, &|_, i| light(k, i % 8));
            image::write_exr(&folder.join("white").join(pass).join(format!("{k:04}.exr")), &maps, Packing::Zip)
                .unwrap();
        }
    }
    let maps = frame(W, H, &|_, _| 0.9);
    image::write_exr(&folder.join("lightbox_empty.exr"), &maps, Packing::Zip).unwrap();
}
