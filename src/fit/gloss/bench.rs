//! Error against run time of the gloss fit: quadrature nodes, frames used.

use super::synthetic::{Noise, Truth, device, pass_x, trace};
use super::{TexelFitter, normal_of, normal_slopes};
use crate::Result;
use crate::fit::bench::{BenchRow, median_us};
use crate::optics::gloss::Lobe;
use crate::optics::tube::fast::{COLUMNS, Lit, Pass};
use crate::optics::tube::lanes::Level;
use crate::optics::tube::{Model, Precision, Travel};

/// Texels of a typical leaf: m .05–.5, tilts to ±6°.
fn texels(count: usize, seed: u64) -> Vec<Truth> {
    let mut noise = Noise::new(seed);
    let mut draw = || {
        let rho_s = noise.uniform(0.01, 0.1);
        Truth {
            rho_d: [noise.uniform(0.02, 0.3), noise.uniform(0.05, 0.4), noise.uniform(0.02, 0.2)],
            rho_s: [rho_s, 1.05 * rho_s, 0.95 * rho_s],
            m: noise.uniform(0.05, 0.5),
            tilt: [noise.uniform(-0.1, 0.1), 0.0],
        }
    };
    (0..count).map(|_| draw()).collect()
}

/// The sweeps: µs a texel (RGB, one pass, one thread) against nodes and frames, and the error of traces and of the fit.
///
/// # Errors
/// None today; the signature is that of every sweep.
pub fn bench_rows() -> Result<Vec<BenchRow>> {
    let mut rows = Vec::new();
    let (device, positions) = (device(Lobe::Beckmann, 0.01), pass_x(100));
    let truths = texels(200, 3);
    let mut noise = Noise::new(4);
    let traces: Vec<Vec<[f32; 3]>> = truths.iter().map(|t| trace(&device, Travel::X, &positions, [0.0; 2], t, Some(&mut noise))).collect();
    for along in [2, 3, 4, 6, 8, 12, 16, 24] {
        let precision = Precision { along, ..Precision::default() };
        let fitter = TexelFitter::with_precision(&device, &positions, None, &precision);
        let mut ws = fitter.workspace();
        let us = median_us(60.0, || {
            for trace in &traces {
                std::hint::black_box(fitter.fit(&mut ws, [0.0; 2], trace, None));
            }
        }) / traces.len() as f64;
        rows.push(BenchRow {
            model: "gloss".into(),
            knob: "quadrature nodes".into(),
            setting: along.to_string(),
            error: trace_error(along),
            us,
            note: "fit of an RGB texel, 100 frames; error: worst gloss trace of m .03-.7 over its peak".into(),
        });
    }
    for frames in [25, 50, 100, 200, 400] {
        let positions = pass_x(frames);
        let fitter = TexelFitter::new(&device, &positions, None);
        let mut ws = fitter.workspace();
        let mut noise = Noise::new(5);
        let traces: Vec<Vec<[f32; 3]>> =
            truths.iter().map(|t| trace(&device, Travel::X, &positions, [0.0; 2], t, Some(&mut noise))).collect();
        let mut errors: Vec<f64> =
            truths.iter().zip(&traces).map(|(t, y)| (fitter.fit(&mut ws, [0.0; 2], y, None).m / t.m - 1.0).abs()).collect();
        errors.sort_by(f64::total_cmp);
        let us = median_us(60.0, || {
            for trace in &traces {
                std::hint::black_box(fitter.fit(&mut ws, [0.0; 2], trace, None));
            }
        }) / traces.len() as f64;
        rows.push(BenchRow {
            model: "gloss".into(),
            knob: "frames used".into(),
            setting: frames.to_string(),
            error: errors[errors.len() / 2],
            us,
            note: "fit of an RGB texel; error: median of m, noise 1 %".into(),
        });
    }
    Ok(rows)
}

/// Worst error of S over its peak, m .03–.7, against many nodes.
fn trace_error(along: usize) -> f64 {
    let (device, positions) = (device(Lobe::Beckmann, 0.01), pass_x(100));
    let fine = Model::new(device.tube(), device.camera, device.lobe, &Precision::fine());
    let pass = Pass::new(&fine, Travel::X, &positions, along, Level::detect());
    let (mut lit, mut columns) = (Lit::default(), vec![vec![0.0; pass.padded()]; COLUMNS]);
    let mut worst = 0.0f64;
    for (m, tilt) in [(0.03, 0.0), (0.07, 0.1), (0.15, -0.1), (0.3, 0.05), (0.5, -0.05), (0.7, 0.0)] {
        pass.light([0.0; 2], &mut lit);
        let mut lists = columns.iter_mut();
        let mut slices: [&mut [f64]; COLUMNS] = std::array::from_fn(|_| lists.next().map_or(&mut [][..], |c| &mut c[..]));
        let normal = normal_of([tilt, 0.0]);
        pass.respond(&mut lit, normal, &normal_slopes([tilt, 0.0])[..1], m, &mut slices);
        let truth: Vec<f64> = positions.iter().map(|&x| fine.response(Travel::X, x, [0.0; 2], normal, m).s).collect();
        let peak = truth.iter().copied().fold(0.0, f64::max);
        worst = truth.iter().zip(&columns[1]).map(|(a, b)| (a - b).abs() / peak).fold(worst, f64::max);
    }
    worst
}
