//! Error against run time of the gloss fit: quadrature nodes, frames used, lobe, template bank.

use crate::Result;
use crate::bench::{BenchRow, median_us};
use mesophyll_base::processor::InstructionSet;
use mesophyll_base::statistics::{median, upper_quantile};
use mesophyll_fits::gloss::synthetic::{GaussianDeviates, GlossFitTruth, device, pass_x, trace};
use mesophyll_fits::gloss::{GlossFitDevice, GlossTexelFitter, normal_of, normal_slopes};
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::tube::evaluator::{COLUMNS, PassEvaluator, TubeGeometry};
use mesophyll_optics::tube::{Travel, TubeModel, TubePrecision};

/// Texels with slopes within `m` and tilts up to ±`tilt`.
fn texels(count: usize, seed: u64, m: [f64; 2], tilt: f64) -> Vec<GlossFitTruth> {
    let mut noise = GaussianDeviates::new(seed);
    let mut draw = || {
        let rho_s = noise.uniform(0.01, 0.1);
        GlossFitTruth {
            rho_d: [noise.uniform(0.02, 0.3), noise.uniform(0.05, 0.4), noise.uniform(0.02, 0.2)],
            rho_s: [rho_s, 1.05 * rho_s, 0.95 * rho_s],
            m: noise.uniform(m[0], m[1]),
            tilt: [noise.uniform(-tilt, tilt), 0.0],
        }
    };
    (0..count).map(|_| draw()).collect()
}

/// Texels, the traces that the device records of them, and the results of fits.
struct Set {
    device: GlossFitDevice,
    positions: Vec<f64>,
    truths: Vec<GlossFitTruth>,
    traces: Vec<Vec<[f32; 3]>>,
}

impl Set {
    fn new(lobe: Lobe, noise: f64, frames: usize, truths: Vec<GlossFitTruth>) -> Set {
        let (device, positions) = (device(lobe, noise), pass_x(frames));
        let mut noise = GaussianDeviates::new(4);
        let traces =
            truths.iter().map(|t| trace(&device, Travel::X, &positions, [0.0; 2], t, Some(&mut noise))).collect();
        Set { device, positions, truths, traces }
    }

    /// Time of a texel (µs).
    fn time(&self, fitter: &GlossTexelFitter) -> f64 {
        let mut ws = fitter.workspace();
        let all = || self.traces.iter().map(|trace| fitter.fit(&mut ws, [0.0; 2], trace, None).m).sum::<f64>();
        median_us(60.0, all) / self.traces.len() as f64
    }

    /// Relative errors of m, and the number of failed fits: those that did not converge, or are off by more
    /// than six of their own errors.
    fn errors(&self, fitter: &GlossTexelFitter) -> (Vec<f64>, usize) {
        let mut ws = fitter.workspace();
        let (mut errors, mut failed) = (Vec::new(), 0);
        for (t, trace) in self.truths.iter().zip(&self.traces) {
            let fit = fitter.fit(&mut ws, [0.0; 2], trace, None);
            failed += usize::from(!fit.termination.converged() || !((fit.m - t.m).abs() < 6.0 * fit.m_err));
            errors.push((fit.m / t.m - 1.0).abs());
        }
        (errors, failed)
    }
}

fn row(knob: &str, setting: String, error: f64, us: f64, note: String) -> BenchRow {
    BenchRow { model: "gloss".into(), knob: knob.into(), setting, error, us, note }
}

/// The sweeps: time a texel (µs; RGB, one pass, one thread) over nodes, frames, template bank and lobe, and the errors
/// of traces and of the fit.
///
/// # Errors
/// None; the signature is that of every sweep.
pub fn bench_rows() -> Result<Vec<BenchRow>> {
    let mut rows = Vec::new();
    // Texels of a typical leaf.
    let truths = texels(200, 3, [0.05, 0.5], 0.1);
    let set = Set::new(Lobe::Beckmann, 0.01, 100, truths.clone());
    for along in [2, 3, 4, 6, 8, 12, 16, 24] {
        let fitter = GlossTexelFitter::with_precision(
            &set.device,
            &set.positions,
            None,
            &TubePrecision { along, ..TubePrecision::default() },
        );
        let note = "fit of an RGB texel, 100 frames; error: worst gloss trace of m .03-.7 over its peak";
        rows.push(row("quadrature nodes", along.to_string(), trace_error(along), set.time(&fitter), note.into()));
    }
    for frames in [25, 50, 100, 200, 400] {
        let set = Set::new(Lobe::Beckmann, 0.01, frames, truths.clone());
        let fitter = GlossTexelFitter::new(&set.device, &set.positions, None);
        let (mut errors, failed) = set.errors(&fitter);
        let note = format!("fit of an RGB texel; error: median of m, noise 1 %, {failed} of {} failed", errors.len());
        let error = median(&mut errors).unwrap_or(f64::NAN);
        rows.push(row("frames used", frames.to_string(), error, set.time(&fitter), note));
    }
    for lobe in Lobe::all(1.45) {
        // With F·G in the model, ρs is larger by about the factor by which F is small.
        let scale = if lobe.index().is_some() { 15.0 } else { 1.0 };
        let truths = truths.iter().map(|t| GlossFitTruth { rho_s: t.rho_s.map(|r| r * scale), ..*t }).collect();
        let set = Set::new(lobe, 0.01, 100, truths);
        let fitter = GlossTexelFitter::new(&set.device, &set.positions, None);
        let (mut errors, failed) = set.errors(&fitter);
        let note = format!(
            "fit of an RGB texel, 100 frames; error: median of m, noise 1 %, {failed} of {} failed",
            errors.len()
        );
        let error = median(&mut errors).unwrap_or(f64::NAN);
        rows.push(row("lobe", lobe.name().into(), error, set.time(&fitter), note));
    }
    // The hard set: here the descent does not make up for a poor start.
    let hard = Set::new(Lobe::Beckmann, 0.02, 100, texels(300, 6, [0.03, 0.9], 0.1745));
    for fineness in [0.15, 0.25, 0.4, 0.6, 1.0, 1.6, 2.5] {
        let fitter =
            GlossTexelFitter::with_bank(&hard.device, &hard.positions, None, &TubePrecision::default(), fineness);
        let (mut errors, failed) = hard.errors(&fitter);
        let note = format!(
            "templates; error: 90th percentile of m, noise 2 %, m .03-.9, tilt 10 degrees, {failed} of {} failed",
            errors.len()
        );
        rows.push(row(
            "template bank",
            fitter.bank_size().to_string(),
            upper_quantile(&mut errors, 9, 10).unwrap_or(f64::NAN),
            hard.time(&fitter),
            note,
        ));
    }
    Ok(rows)
}

/// Worst error of S relative to its peak for m from .03 to .7, compared with many nodes.
fn trace_error(along: usize) -> f64 {
    let (device, positions) = (device(Lobe::Beckmann, 0.01), pass_x(100));
    let fine = TubeModel::new(device.tube(), device.camera, device.lobe, &TubePrecision::fine());
    let pass = PassEvaluator::new(&fine, Travel::X, &positions, along, InstructionSet::detect());
    let (mut lit, mut columns) = (TubeGeometry::default(), vec![vec![0.0; pass.padded()]; COLUMNS]);
    let mut worst = 0.0f64;
    for (m, tilt) in [(0.03, 0.0), (0.07, 0.1), (0.15, -0.1), (0.3, 0.05), (0.5, -0.05), (0.7, 0.0)] {
        pass.light([0.0; 2], &mut lit);
        let mut lists = columns.iter_mut();
        let mut slices: [&mut [f64]; COLUMNS] =
            std::array::from_fn(|_| lists.next().map_or(&mut [][..], |c| &mut c[..]));
        let normal = normal_of([tilt, 0.0]);
        pass.respond(&mut lit, normal, &normal_slopes([tilt, 0.0])[..1], m, &mut slices);
        let truth: Vec<f64> = positions.iter().map(|&x| fine.response(Travel::X, x, [0.0; 2], normal, m).s).collect();
        let peak = truth.iter().copied().fold(0.0, f64::max);
        worst = truth.iter().zip(&columns[1]).map(|(a, b)| (a - b).abs() / peak).fold(worst, f64::max);
    }
    worst
}
