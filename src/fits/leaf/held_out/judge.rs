//! The judgement at the end of a fit: all held-out frames of a side, read band by band, against their predictions.

use super::frames::{LIGHT_BOX, plane_name, rounded};
use super::{
    FARTHEST, FramePredictor, FrameSplits, HeldOutResiduals, LightBoxResiduals, PredictionScratch, ScanRecord,
    leverage, texel_of,
};
use crate::Result;
use crate::leaf::curve::{Incidence, ThicknessCurve};
use crate::leaf::interior::LeafSideFit;
use crate::leaf::noise::{self, CameraNoise};
use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::median_of;
use mesophyll_capture::reader::TubeCapture;
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::quantity::RGB;
use mesophyll_optics::tube::Travel;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Rows read at a time.
const ROWS: usize = 32;
/// How many held-out frames of a pass are stored: those nearest to the lobe's peak.
const STORED: usize = 2;
/// A file of held-out frames holds at most this many bytes before packing. Of a larger scan only every second (third,
/// …) row and column is stored.
const STORED_BYTES: usize = 8 << 20;

/// A judged side.
#[derive(Debug, Default)]
pub struct HeldOutJudgement {
    /// Results by pass, for the passes that have held-out frames.
    pub passes: BTreeMap<String, HeldOutResiduals>,
    /// How well the transmittance is explained; `None` where no texel can tell.
    pub light_box: Option<LightBoxResiduals>,
    /// What `front_held_out.exr` holds; `None` where nothing was held out.
    pub stored: Option<ChannelMaps>,
}

/// Sums over standardised residuals.
#[derive(Debug, Clone, Default)]
pub struct ResidualTally {
    /// Readings added so far.
    pub readings: usize,
    squares: f64,
    signed: f64,
    beyond: usize,
    /// Largest residual and the texel's index.
    pub worst: (f64, usize),
    /// Σ s², Σ s n and Σ n² over the texels, s being a texel's sum of squares and n its readings.
    spread: [f64; 3],
}

impl ResidualTally {
    /// Adds the residuals of one texel. NaN stands for a missing reading.
    pub fn add(&mut self, residuals: impl Iterator<Item = f64>, texel: usize) {
        let (mut s, mut n) = (0.0, 0.0);
        for z in residuals.filter(|z| !z.is_nan()) {
            n += 1.0;
            s += z.abs().min(FARTHEST).powi(2);
            self.signed += z.clamp(-FARTHEST, FARTHEST);
            self.beyond += usize::from(z.abs() > 3.0);
            if z.abs() > self.worst.0.abs() {
                self.worst = (z, texel);
            }
        }
        self.readings += n as usize;
        self.squares += s;
        for (sum, term) in self.spread.iter_mut().zip([s * s, s * n, n * n]) {
            *sum += term;
        }
    }

    /// Mean square of the standardised residuals.
    pub fn reduced_chi2(&self) -> f64 {
        self.squares / self.readings as f64
    }

    /// Standard error of the mean square. Texels are independent of each other, but the readings of one texel share its
    /// fit.
    pub fn stderr(&self) -> f64 {
        let mean = self.reduced_chi2();
        (self.spread[0] - 2.0 * mean * self.spread[1] + mean * mean * self.spread[2]).max(0.0).sqrt()
            / self.readings as f64
    }

    /// Share of the readings that are more than three standard deviations off.
    pub fn share_beyond_3(&self) -> f64 {
        self.beyond as f64 / self.readings as f64
    }

    /// Mean of the standardised residuals: above 0 where more was measured than predicted.
    pub fn bias(&self) -> f64 {
        self.signed / self.readings as f64
    }
}

/// Compares a fitted side with its held-out frames, in units of the noise of each texel's readings.
///
/// # Errors
/// Frames that cannot be read.
pub fn judge(
    capture: &TubeCapture,
    scan: &ScanRecord,
    splits: &FrameSplits,
    fitted: &LeafSideFit,
    level: &CameraNoise,
) -> Result<HeldOutJudgement> {
    // Single precision and the slab's curve keep a transmittance only to a few millionths, so less noise than that is
    // not claimed.
    let relative = (level.relative * level.lightbox * std::f64::consts::SQRT_2).max(noise::LEAST_RELATIVE);
    let mut out = HeldOutJudgement { light_box: light_box(capture, fitted, relative), ..HeldOutJudgement::default() };
    let Some(texel) = texel_of(&fitted.maps).filter(|_| splits.any()) else { return Ok(out) };
    let m = &capture.manifest;
    let at = |k: usize| m.size().place_mm(m.texel_mm, k);
    let good: Vec<_> = fitted.texels.iter().filter_map(|x| Some((at(x.at), texel(x.at)?))).collect();
    let expected = leverage::expected(scan, m, splits, &good);
    let mut stored = ChannelMaps::new(m.width.div_ceil(scan.stored_step), m.height.div_ceil(scan.stored_step));
    for pass in &m.passes {
        let split = splits.of(pass.name);
        if split.held.is_empty() {
            continue;
        }
        let positions: Vec<f64> = split.held.iter().map(|k| pass.positions()[*k]).collect();
        let kept = nearest_the_peak(scan, pass.name, &positions);
        let predictor = FramePredictor::new(scan, pass.name, &positions);
        let (mut all, mut frames) = (ResidualTally::default(), vec![ResidualTally::default(); positions.len()]);
        let mut planes = vec![[vec![f32::NAN; stored.width * stored.height], vec![], vec![]]; kept.len()];
        planes.iter_mut().for_each(|p| (p[1], p[2]) = (p[0].clone(), p[0].clone()));
        for first in (0..m.height).step_by(ROWS) {
            let rows = first..(first + ROWS).min(m.height);
            let inside = |k: usize| rows.contains(&(k / m.width));
            let list: Vec<usize> = fitted.texels.iter().map(|x| x.at).filter(|k| inside(*k)).collect();
            if list.is_empty() {
                continue;
            }
            let places: Vec<[u32; 2]> = list.iter().map(|k| [(k % m.width) as u32, (k / m.width) as u32]).collect();
            let band = capture.band(fitted.side, pass.name, rows.clone(), &places, &split.held)?;
            let noise = level.readings(capture, &places);
            let residuals: Vec<Option<Vec<Rgb>>> = list
                .par_iter()
                .enumerate()
                .map_init(PredictionScratch::default, |scratch, (n, &k)| {
                    let values = predictor.values(scratch, &texel(k)?, at(k));
                    let z = |(f, v): (usize, &Rgb)| {
                        Rgb::of(|c| (f64::from(band[f][n][c]) - v[c]) / noise[n].variance(c, v[c]).sqrt())
                    };
                    Some(values.iter().enumerate().map(z).collect())
                })
                .collect();
            for (n, (&k, z)) in list.iter().zip(&residuals).enumerate() {
                let Some(z) = z else { continue };
                all.add(z.iter().flatten().copied(), k);
                frames.iter_mut().zip(z).for_each(|(tally, z)| tally.add(z.iter().copied(), k));
                let (i, j) = (k % m.width, k / m.width);
                if i % scan.stored_step == 0 && j % scan.stored_step == 0 {
                    let to = j / scan.stored_step * stored.width + i / scan.stored_step;
                    for (plane, &f) in planes.iter_mut().zip(&kept) {
                        (0..3).for_each(|c| plane[c][to] = rounded(band[f][n][c], scan.noise_relative));
                    }
                }
            }
        }
        for (plane, &f) in planes.into_iter().zip(&kept) {
            for (c, plane) in plane.into_iter().enumerate() {
                stored.push(plane_name(pass.name.name(), split.held[f], c), plane);
            }
        }
        let chi2: Vec<f64> = frames.iter().map(ResidualTally::reduced_chi2).collect();
        let worst = (0..chi2.len()).max_by(|a, b| chi2[*a].total_cmp(&chi2[*b])).unwrap_or(0);
        out.passes.insert(
            pass.name.name().into(),
            HeldOutResiduals {
                stored: kept.iter().map(|f| split.held[*f]).collect(),
                frames: split.held.clone(),
                positions_mm: positions,
                readings: all.readings,
                reduced_chi2: all.reduced_chi2(),
                expected: expected[pass.name as usize].iter().sum::<f64>() / split.held.len() as f64,
                frame_expected: expected[pass.name as usize].clone(),
                stderr: all.stderr(),
                share_beyond_3: all.share_beyond_3(),
                bias: all.bias(),
                worst_frame: split.held[worst],
                worst_frame_chi2: chi2[worst],
                frame_chi2: chi2,
                worst: all.worst.0,
                worst_at: [all.worst.1 % m.width, all.worst.1 / m.width],
            },
        );
    }
    for (c, letter) in RGB.iter().enumerate() {
        let value = |k: usize| {
            let at = k / stored.width * scan.stored_step * m.width + k % stored.width * scan.stored_step;
            if fitted.mask[at] == 1 { rounded(fitted.measured.rho_t[at][c], relative) } else { f32::NAN }
        };
        let plane = (0..stored.width * stored.height).map(value).collect();
        stored.push(format!("{LIGHT_BOX}.{letter}"), plane);
    }
    out.stored = Some(stored);
    Ok(out)
}

/// The step between the rows and columns of a scan that are stored.
pub fn stored_step(width: usize, height: usize, passes: usize) -> usize {
    let bytes =
        |step: usize| width.div_ceil(step) * height.div_ceil(step) * 3 * (STORED * passes + 1) * size_of::<f32>();
    (1..).find(|step| bytes(*step) <= STORED_BYTES).unwrap_or(1)
}

/// Indices of the positions nearest to where a level texel in the middle mirrors the tube into the camera, in the order
/// of the frames.
fn nearest_the_peak(scan: &ScanRecord, travel: Travel, positions: &[f64]) -> Vec<usize> {
    let peak = match travel {
        Travel::X => -scan.tube_height_mm * scan.camera_deg.to_radians().tan(),
        Travel::Y => 0.0,
    };
    let mut order: Vec<usize> = (0..positions.len()).collect();
    order.sort_by(|&a, &b| (positions[a] - peak).abs().total_cmp(&(positions[b] - peak).abs()));
    order.truncate(STORED);
    order.sort_unstable();
    order
}

/// One floor is used for the whole side: that of the median texel.
fn light_box(capture: &TubeCapture, fitted: &LeafSideFit, relative: f64) -> Option<LightBoxResiduals> {
    let m = &capture.manifest;
    let floor = Rgb::of(|c| median_of(fitted.texels.iter().map(|x| x.reading.rho_t_floor[c])).unwrap_or(f64::NAN));
    let incidence = m.lightbox.camera_deg.to_radians().cos();
    let thickness: BTreeMap<usize, f64> = fitted.texels.iter().map(|x| (x.at, x.interior.thickness)).collect();
    through(
        fitted.sigma_a,
        fitted.sigma_s,
        m.thickness_mm,
        incidence,
        relative,
        floor,
        fitted.texels.iter().map(|x| x.at),
        |k| (thickness.get(&k).copied().unwrap_or(f64::NAN), fitted.measured.rho_t[k].map(f64::from)),
    )
}

/// Compares measured transmittances with the slab's. `texel` gives a texel's thickness (mm) and its measured
/// transmittances.
#[allow(clippy::too_many_arguments)]
pub(super) fn through(
    sigma_a: Rgb,
    sigma_s: Rgb,
    h: f64,
    incidence: f64,
    relative: f64,
    floor: Rgb,
    texels: impl Iterator<Item = usize>,
    texel: impl Fn(usize) -> (f64, Rgb),
) -> Option<LightBoxResiduals> {
    if !sigma_a.iter().chain(&sigma_s).all(|v| v.is_finite() && *v > 0.0) {
        return None;
    }
    let curves = sigma_a.zip(sigma_s, |a, s| ThicknessCurve::new(a, s, h, Incidence(incidence)));
    let mut tally = ResidualTally::default();
    for k in texels {
        let (thickness, measured) = texel(k);
        let z = |c: usize| {
            let t = curves[c].at(thickness.ln()).ln_rho_t.exp();
            (measured[c] - t) / (relative * t).hypot(floor[c].max(1e-9))
        };
        if thickness > 0.0 {
            tally.add((0..3).map(z), k);
        }
    }
    (tally.readings > 0).then(|| LightBoxResiduals {
        noise_relative: relative,
        noise_floor: floor.into(),
        readings: tally.readings,
        reduced_chi2: tally.reduced_chi2(),
        expected: 2.0 / 3.0,
        stderr: tally.stderr(),
        bias: tally.bias(),
    })
}
