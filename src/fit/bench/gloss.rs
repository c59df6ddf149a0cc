//! Sweeps of the gloss fit: quadrature of the tube, and how many frames a scan needs. Default device of the linear light source
//! (100 mm over the blade, 500 mm long, camera at 55°), Beckmann lobe, m .05–.5, tilt ±.1, 1 % noise.

use super::{BenchRow, median, median_us};
use crate::fit::gloss::{Device, TexelFitter, normal_of};
use crate::optics::gloss::Lobe;
use crate::optics::tube::{Model, Precision, Travel};
use crate::solve::global::starts_in_box;
use rand::{RngExt, SeedableRng};

/// Camera angle of the sweeps (degrees).
pub const CAMERA_DEG: f64 = 55.0;

/// The device of the sweeps, with a tube of this radius (mm).
pub fn device(radius_mm: f64) -> Device {
    let (sin, cos) = CAMERA_DEG.to_radians().sin_cos();
    Device {
        height_mm: 100.0,
        length_mm: 500.0,
        radius_mm,
        camera: [sin, 0.0, cos],
        lobe: Lobe::Beckmann,
        noise_relative: 0.01,
        noise_floor: 5e-4,
    }
}

/// `frames` tube positions over the height, from −4 to 2.5.
pub fn frames(frames: usize) -> Vec<f64> {
    (0..frames).map(|k| -4.0 + 6.5 * k as f64 / (frames - 1) as f64).collect()
}

/// A texel with known parameters and its RGB trace.
#[derive(Debug, Clone, PartialEq)]
pub struct Texel {
    pub m: f64,
    pub tilt: f64,
    pub trace: Vec<[f32; 3]>,
}

/// `count` texels seen at positions `u` (over the height), with seeded noise of the device's size (none where `noise` is false).
pub fn texels(device: &Device, u: &[f64], count: usize, noise: bool) -> Vec<Texel> {
    let fine = Model::new(device.tube(), device.camera, device.lobe, &Precision::fine());
    let points = starts_in_box(&[0.05f64.ln(), -0.1, 0.02, 0.02], &[0.5f64.ln(), 0.1, 0.2, 0.1], count, 11).unwrap_or_default();
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(5);
    let mut normal = move || {
        let (a, b): (f64, f64) = (rng.random(), rng.random());
        (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    };
    let mut texel = |p: &Vec<f64>| {
        let (m, tilt, rho_d, rho_s) = (p[0].exp(), p[1], p[2], p[3]);
        let frame = |u: &f64| {
            let r = fine.response(Travel::X, u * device.height_mm, [0.0; 2], normal_of([tilt, 0.0]), m);
            [0.5, 1.0, 0.3].map(|colour| {
                let value = colour * rho_d * r.d + rho_s * r.s;
                let spread = if noise { (device.noise_relative * value).hypot(device.noise_floor) } else { 0.0 };
                (value + normal() * spread) as f32
            })
        };
        Texel { m, tilt, trace: u.iter().map(frame).collect() }
    };
    points.iter().map(&mut texel).collect()
}

/// Median relative error of m and median time a texel (µs) of a fitter.
pub fn measure(fitter: &TexelFitter, texels: &[Texel], budget_ms: f64) -> (Vec<f64>, f64) {
    let mut workspace = fitter.workspace();
    let errors = texels.iter().map(|t| (fitter.fit(&mut workspace, [0.0; 2], &t.trace, None).m / t.m - 1.0).abs()).collect();
    let all = |w: &mut _| texels.iter().map(|t| fitter.fit(w, [0.0; 2], &t.trace, None).m).sum::<f64>();
    (errors, median_us(budget_ms, || all(&mut workspace)) / texels.len() as f64)
}

/// The rows.
pub fn bench_rows() -> Vec<BenchRow> {
    let row = |knob: &str, setting: usize, error: f64, us: f64, note: &str| BenchRow {
        model: "gloss".into(),
        knob: knob.into(),
        setting: setting.to_string(),
        error,
        us,
        note: note.into(),
    };
    let mut rows = Vec::new();
    let (thick, u) = (device(2.5), frames(100));
    let (quick, one) = (24, frames(100).iter().map(|u| u * 100.0).collect::<Vec<f64>>());

    // The model alone: worst error of the glossy response over frames, relative to its peak.
    let fine = Model::new(thick.tube(), thick.camera, thick.lobe, &Precision { along: 48, across: 16 });
    let lobes = [(0.05, 0.0), (0.1, 0.08), (0.25, -0.05), (0.5, 0.1)];
    let curve = |model: &Model, m: f64, tilt: f64| -> Vec<f64> {
        one.iter().map(|x| model.response(Travel::X, *x, [0.0; 2], normal_of([tilt, 0.0]), m).s).collect()
    };
    let truth: Vec<Vec<f64>> = lobes.iter().map(|(m, tilt)| curve(&fine, *m, *tilt)).collect();
    let mut model_row = |knob: &str, setting: usize, precision: Precision| {
        let model = Model::new(thick.tube(), thick.camera, thick.lobe, &precision);
        let error = lobes.iter().zip(&truth).fold(0.0, |worst: f64, ((m, tilt), truth)| {
            let peak = truth.iter().copied().fold(0.0, f64::max);
            curve(&model, *m, *tilt).iter().zip(truth).fold(worst, |w, (a, b)| w.max((a - b).abs() / peak))
        });
        let us = median_us(10.0, || curve(&model, 0.2, 0.05)) / one.len() as f64;
        rows.push(row(knob, setting, error, us, "response of a frame, worst over four lobes, relative to the peak"));
    };
    for along in [2, 3, 4, 6, 8, 12, 24] {
        model_row("nodes along the tube", along, Precision { along, across: 8 });
    }
    for across in [1, 2, 3, 5, 8] {
        model_row("nodes across the tube", across, Precision { along: 24, across });
    }

    // The fit: what its quadrature biases without noise, and what frames buy with it.
    let clean = texels(&thick, &u, quick, false);
    for along in [3, 4, 6, 8, 12] {
        let fitter = TexelFitter::with_precision(&thick, &one, None, &Precision { along, ..Precision::default() });
        let (errors, us) = measure(&fitter, &clean, 40.0);
        rows.push(row("nodes in the fit", along, median(errors), us, "fit of an RGB texel without noise, median relative error of m"));
    }
    for count in [15, 25, 50, 100, 200] {
        let u = frames(count);
        let positions: Vec<f64> = u.iter().map(|u| u * thick.height_mm).collect();
        let fitter = TexelFitter::new(&thick, &positions, None);
        let (errors, us) = measure(&fitter, &texels(&thick, &u, 2 * quick, true), 40.0);
        rows.push(row("frames", count, median(errors), us, "fit of an RGB texel with 1 % noise, median relative error of m"));
    }
    rows
}
