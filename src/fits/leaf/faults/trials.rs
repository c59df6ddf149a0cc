//! Faults of the whole scan, found by trial. Where a leaf's traces are not explained, a few texels are fitted again
//! under what could be wrong: another angle of the camera, another height of the tube, light that was not taken off, a
//! coding of the frames, a pass in reverse. The cause that explains most of what is left is the likely one, and its
//! amount is found on the way. Causes that explain it equally well are all named.

use super::bias::{TrialBias, bias};
use super::causes::{CauseFamily, FaultCause, FrameCoding, LightChange, device, place};
use super::refit::{FrameReadings, PARAMETERS, PassHypothesis, descend};
use super::sample::{PassReadings, TexelSample};
use crate::leaf::held_out::{FramePredictor, PredictionScratch, TexelParameters};
use crate::record::scan::ScanRecord;
use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::upper_quantile;
use mesophyll_capture::calibration::white_response;
use mesophyll_optics::gloss::{Lobe, LobeKind};
use mesophyll_optics::tube::Travel;
use rayon::prelude::*;

/// Texels that are fitted again.
pub const TEXELS: usize = 40;
/// The share of them whose χ² is smallest speaks for the leaf.
const SPEAK: f64 = 0.8;
/// A cause is named where it takes away at least this share of what χ² has above the noise.
pub const EXPLAINS: f64 = 0.85;
/// χ² that is less than this share above the noise is not worth a search.
const LEAST: f64 = 0.04;
/// Residuals of a bright reading below this share of it are the precision of the model and of the white frames.
const PRECISION: f64 = 1e-3;
/// So many of the causes have their amount refined.
const REFINED: usize = 8;
/// Causes whose share is smaller than the best one's by no more than this are named beside it.
const TIE: f64 = 0.04;

/// What the trials of one side found.
#[derive(Debug, Clone, PartialEq)]
pub struct TrialOutcome {
    /// Reduced χ² of the texels as they were fitted.
    pub before: f64,
    /// Under the best cause.
    pub after: f64,
    /// The true variance of the noise over the stated one.
    pub noise: f64,
    /// χ² is above the noise, and no cause explains it.
    pub unexplained: bool,
    /// The causes that explain it, best first; empty where none does.
    pub causes: Vec<FaultCause>,
    /// How far the fitted texels are from those under the best cause.
    pub bias: TrialBias,
}

/// The scan's device and readings, and the texels that are fitted again.
pub struct FaultTrials<'a> {
    scan: &'a ScanRecord,
    pub(super) sample: &'a TexelSample,
    /// Dark level of each texel, in the camera's values.
    dark: Vec<Rgb>,
    pub(super) noise: f64,
    chosen: Vec<usize>,
    /// Readings that count: frames by pass.
    used: Vec<Vec<bool>>,
}

impl<'a> FaultTrials<'a> {
    /// `wrong(pass, frame)`: frames that are left out; `dark`: the dark level of each sampled texel; `noise`: the true
    /// variance of the noise over the stated one.
    pub fn new(
        scan: &'a ScanRecord,
        sample: &'a TexelSample,
        dark: Vec<Rgb>,
        noise: f64,
        wrong: impl Fn(Travel, usize) -> bool,
    ) -> Self {
        let step = sample.texels.len().div_ceil(TEXELS).max(1);
        let chosen = (step / 2..sample.texels.len()).step_by(step).collect();
        let used = sample.passes.iter().map(|p| (0..p.frames()).map(|k| !wrong(p.travel, k)).collect()).collect();
        FaultTrials { scan, sample, dark, noise, chosen, used }
    }

    /// Reduced χ² of the texels as they are.
    pub fn before(&self) -> f64 {
        self.fit(FaultCause::None, 1).chi2
    }

    /// Tries every cause where the texels' χ² is above the noise by more than chance. A few texels choose the likely
    /// causes, more of them find their amounts, and all decide.
    pub fn search(&self) -> TrialOutcome {
        let noise = self.noise;
        let base = self.fit(FaultCause::None, 1);
        let mut out = TrialOutcome {
            before: base.chi2,
            after: base.chi2,
            noise,
            unexplained: false,
            causes: Vec::new(),
            bias: TrialBias::default(),
        };
        let chance = 6.0 * (2.0 / base.freedom).sqrt() * noise;
        let excess = base.chi2 - noise;
        let bright = f64::from(self.bright());
        let residual = base.chi2.sqrt() * self.scan.noise(bright) / bright;
        if !(excess > chance.max(LEAST * noise) && residual > PRECISION) {
            return out;
        }
        let mut coarse: Vec<(f64, CauseFamily, usize)> = self
            .causes()
            .into_iter()
            .map(|family| {
                let costs: Vec<f64> = family.grid.iter().map(|x| self.fit((family.of)(*x), 4).chi2).collect();
                let top = (0..costs.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b])).unwrap_or(0);
                (costs[top], family, top)
            })
            .collect();
        coarse.sort_by(|a, b| a.0.total_cmp(&b.0));
        coarse.truncate(REFINED);
        let mut tried: Vec<(f64, FaultCause)> = coarse
            .iter()
            .map(|(_, family, top)| {
                let cause = self.refine(family, *top);
                (self.fit(cause, 1).chi2, cause)
            })
            .collect();
        tried.sort_by(|a, b| a.0.total_cmp(&b.0));
        let share = |chi2: f64| (base.chi2 - chi2) / excess;
        let Some(&(best, cause)) = tried.first().filter(|t| share(t.0) > EXPLAINS) else {
            out.unexplained = true;
            return out;
        };
        out.after = best;
        out.causes = tried.iter().filter(|t| share(t.0) > share(best) - TIE).map(|t| t.1).take(3).collect();
        out.bias = bias(&base.texels, &self.fit(cause, 1).texels);
        out
    }

    /// Every cause that the scan may have, with a range of its amount where it has one.
    fn causes(&self) -> Vec<CauseFamily> {
        let scan = self.scan;
        let both = self.sample.passes.len() == 2;
        let grid = |from: f64, to: f64, count: usize| {
            (0..count).map(|k| from + (to - from) * k as f64 / (count - 1) as f64).collect::<Vec<f64>>()
        };
        let scaled = |value: f64, list: &[f64]| list.iter().map(|f| f * value).collect::<Vec<f64>>();
        let bright = f64::from(self.bright());
        let far = [-0.3, -0.1, 0.0, 0.1, 0.3];
        let mut list = vec![
            CauseFamily::of(
                FaultCause::Camera,
                grid((scan.camera_deg - 24.0).max(-85.0), (scan.camera_deg + 24.0).min(85.0), 9),
            ),
            CauseFamily::of(FaultCause::Offset, scaled(bright, &[-0.1, -0.03, -0.01, 0.0, 0.01, 0.03, 0.1, 0.2])),
            CauseFamily::of(|a| FaultCause::Drift(LightChange::Throughout, a), grid(-0.4, 0.4, 9)),
            CauseFamily::of(|d| FaultCause::Zero(Travel::X, d), scaled(scan.tube_height_mm, &far)),
            CauseFamily::one(FaultCause::Reversed(true, false)),
            CauseFamily::one(FaultCause::Mirrored),
            CauseFamily::one(FaultCause::Coded(FrameCoding::Srgb)),
            CauseFamily::one(FaultCause::Coded(FrameCoding::Gamma)),
        ];
        // White frames that fall off as they must have shown already that these are right.
        if self.sample.passes.iter().all(|p| p.gain.is_empty()) {
            list.push(CauseFamily::of(
                FaultCause::Height,
                scaled(scan.tube_height_mm, &[0.6, 0.75, 0.9, 1.0, 1.1, 1.3, 1.6]),
            ));
            list.push(CauseFamily::of(
                FaultCause::Length,
                scaled(scan.tube_length_mm, &[0.25, 0.5, 0.8, 1.0, 1.4, 2.5]),
            ));
            list.push(CauseFamily::of(FaultCause::Texel, scaled(scan.texel_mm, &[0.4, 0.6, 0.8, 1.0, 1.3, 1.8, 2.5])));
        }
        if scan.tube_radius_mm > 0.0 {
            list.push(CauseFamily::of(
                FaultCause::Radius,
                scaled(scan.tube_radius_mm, &[0.05, 0.5, 1.0, 2.0, 4.0, 8.0]),
            ));
        }
        if both {
            list.push(CauseFamily::one(FaultCause::Reversed(false, true)));
            list.push(CauseFamily::one(FaultCause::Reversed(true, true)));
            list.push(CauseFamily::one(FaultCause::Exchanged));
            list.push(CauseFamily::of(|a| FaultCause::Drift(LightChange::After(Travel::X), a), grid(-0.4, 0.4, 9)));
            list.push(CauseFamily::of(|a| FaultCause::Drift(LightChange::Before(Travel::X), a), grid(-0.4, 0.4, 9)));
            list.push(CauseFamily::of(|a| FaultCause::Drift(LightChange::After(Travel::Y), a), grid(-0.4, 0.4, 9)));
            list.push(CauseFamily::of(|a| FaultCause::Drift(LightChange::Before(Travel::Y), a), grid(-0.4, 0.4, 9)));
            list.push(CauseFamily::of(
                |g| FaultCause::Level(Travel::Y, g),
                vec![0.5, 0.7, 0.8, 0.9, 1.0, 1.1, 1.25, 1.4, 2.0],
            ));
            list.push(CauseFamily::of(|d| FaultCause::Zero(Travel::Y, d), scaled(scan.tube_height_mm, &far)));
        }
        // The lobes that the tube's vector code has.
        let lobes = ["beckmann", "ggx", "cook-torrance"].into_iter().filter_map(|name| name.parse::<LobeKind>().ok());
        list.extend(
            lobes
                .map(|kind| Lobe::of(kind, 1.45))
                .filter(|l| l.name() != scan.lobe)
                .map(|l| CauseFamily::one(FaultCause::Surface(l))),
        );
        list
    }

    /// A bright reading, calibrated.
    fn bright(&self) -> f32 {
        let all = self.sample.passes.iter().flat_map(|p| &p.measured).flatten().copied();
        upper_quantile(&mut all.filter(|v| v.is_finite()).collect::<Vec<_>>(), 9, 10).unwrap_or(0.0)
    }

    /// The best member of a family around the best point of its grid.
    fn refine(&self, family: &CauseFamily, top: usize) -> FaultCause {
        let grid = &family.grid;
        let (mut low, mut high) = (grid[top.saturating_sub(1)], grid[(top + 1).min(grid.len() - 1)]);
        if low == high {
            return (family.of)(low);
        }
        let cost = |x: f64| self.fit((family.of)(x), 2).chi2;
        let mut best = (cost(grid[top]), grid[top]);
        // Golden section.
        for _ in 0..5 {
            let (a, b) = (high - 0.618 * (high - low), low + 0.618 * (high - low));
            let (at_a, at_b) = (cost(a), cost(b));
            for (c, x) in [(at_a, a), (at_b, b)] {
                if c < best.0 {
                    best = (c, x);
                }
            }
            if at_a < at_b {
                high = b;
            } else {
                low = a;
            }
        }
        (family.of)(best.1)
    }

    /// Fits every `step`-th of the chosen texels under a cause.
    fn fit(&self, cause: FaultCause, step: usize) -> Fits {
        self.fit_these(&self.chosen, cause, step)
    }

    /// The same for some texels.
    pub(super) fn fit_these(&self, chosen: &[usize], cause: FaultCause, step: usize) -> Fits {
        let scan = device(self.scan, cause);
        let passes: Vec<PassHypothesis> = self.passes(cause, &scan);
        let each: Vec<(f64, f64, TexelParameters)> = chosen
            .par_iter()
            .step_by(step)
            .map_init(PredictionScratch::default, |scratch, &n| self.fit_texel(scratch, n, cause, &scan, &passes))
            .collect();
        // A texel at the margin or on the stalk may fit no model. It must not speak for the others.
        let mut order: Vec<usize> = (0..each.len()).filter(|n| each[*n].0.is_finite()).collect();
        order.sort_by(|a, b| (each[*a].0 / each[*a].1).total_cmp(&(each[*b].0 / each[*b].1)));
        order.truncate((SPEAK * each.len() as f64).ceil() as usize);
        let freedom: f64 = order.iter().map(|n| each[*n].1).sum();
        let chi2: f64 = order.iter().map(|n| each[*n].0).sum();
        Fits { chi2: chi2 / freedom.max(1.0), freedom, texels: each.into_iter().map(|e| e.2).collect() }
    }

    /// The tube's places and the readings that belong to them.
    fn passes(&self, cause: FaultCause, scan: &ScanRecord) -> Vec<PassHypothesis<'_>> {
        let count = self.sample.passes.len();
        (0..count)
            .map(|p| {
                let own = &self.sample.passes[p];
                let exchanged = cause == FaultCause::Exchanged && count == 2;
                let (readings, used) =
                    if exchanged { (&self.sample.passes[1 - p], &self.used[1 - p]) } else { (own, &self.used[p]) };
                let mut positions = own.positions.clone();
                let turned = matches!(cause, FaultCause::Reversed(x, y) if [x, y][own.travel as usize]);
                if turned {
                    positions.reverse();
                }
                if let FaultCause::Zero(travel, d) = cause
                    && travel == own.travel
                {
                    positions.iter_mut().for_each(|x| *x += d);
                }
                positions.truncate(readings.frames());
                PassHypothesis {
                    predictor: FramePredictor::new(scan, own.travel, &positions),
                    travel: own.travel,
                    before: p,
                    first: self.sample.passes[..p].iter().map(PassReadings::frames).sum(),
                    positions,
                    readings,
                    used,
                }
            })
            .collect()
    }

    /// χ², degrees of freedom and the texel.
    fn fit_texel(
        &self,
        scratch: &mut PredictionScratch,
        n: usize,
        cause: FaultCause,
        scan: &ScanRecord,
        passes: &[PassHypothesis],
    ) -> (f64, f64, TexelParameters) {
        let at = place(self.sample.at[n], cause, self.scan);
        let data: Vec<FrameReadings> = passes.iter().map(|pass| self.data(n, cause, scan, pass)).collect();
        let readings: usize = data.iter().map(|d| d.iter().flatten().filter(|r| r[1] > 0.0).count()).sum();
        let parameters = PARAMETERS - (2 - passes.len().min(2));
        let level = TexelParameters { m: 0.35, normal: [0.0, 0.0, 1.0], ..self.sample.fitted[n] };
        let mut best: Option<(f64, TexelParameters)> = None;
        for start in [self.sample.fitted[n], level] {
            // Another start is worth its time where the first one has not led to the noise.
            if best.is_some_and(|b| b.0 < 1.3 * self.noise * readings as f64) {
                break;
            }
            let (chi2, texel) = descend(scratch, start, at, passes, &data);
            if best.is_none_or(|b| chi2 < b.0) {
                best = Some((chi2, texel));
            }
        }
        let (chi2, texel) = best.unwrap_or((0.0, level));
        (chi2, readings.saturating_sub(parameters).max(1) as f64, texel)
    }

    /// Readings of a texel in one pass under a cause, each with the inverse of its standard deviation (0: none).
    fn data(&self, n: usize, cause: FaultCause, scan: &ScanRecord, pass: &PassHypothesis) -> FrameReadings {
        let frames = pass.positions.len();
        let readings = pass.readings;
        let at = self.sample.at[n];
        let whites = !readings.gain.is_empty();
        let moved = place(at, cause, self.scan);
        (0..frames)
            .map(|k| {
                let (mut measured, mut spread) = (readings.measured[n * readings.frames() + k], 1.0);
                if let FaultCause::Moved(from, shift) = cause
                    && pass.first + k >= from
                {
                    (measured, spread) = self
                        .sample
                        .shifted(readings, n, k, shift)
                        .map_or((Rgb::splat(f32::NAN), 1.0), |(v, s)| (v, s.sqrt()));
                }
                // The white sheet's response as it was taken, and as it is under the cause.
                let (mut was, mut is) = (1.0, 1.0);
                if whites {
                    was = white_response(&self.scan.tube(), readings.travel, readings.positions[k], at);
                    is = white_response(&scan.tube(), pass.travel, pass.positions[k], moved);
                    if matches!(cause, FaultCause::Reversed(..) | FaultCause::Mirrored | FaultCause::Exchanged) {
                        // The frames are in another order than their white frames.
                        is = was;
                    }
                }
                let at = k as f64 / (frames - 1).max(1) as f64;
                let light = cause.light(pass.travel, at, pass.before, self.sample.passes.len());
                std::array::from_fn(|c| {
                    let y = f64::from(measured[c]);
                    let sd = spread * self.sample.noise[n].variance(c, y.max(0.0)).sqrt();
                    if !y.is_finite() || !pass.used[k] {
                        return [0.0, 0.0];
                    }
                    let gain = if whites { f64::from(readings.gain[n * readings.frames() + k][c]) } else { 1.0 };
                    let dark = self.dark[n][c];
                    let change = |y: f64| match cause {
                        FaultCause::Offset(a) => y - a,
                        FaultCause::Coded(coding) => (coding.linear(y * gain + dark) - dark) / gain,
                        _ => y * is / was / light,
                    };
                    // The noise changes with the readings: its slope is that of the change.
                    let slope = (change(y + sd) - change(y - sd)) / (2.0 * sd);
                    let value = change(y);
                    let weight = 1.0 / (sd * slope.abs());
                    if value.is_finite() && weight.is_finite() { [value, weight] } else { [0.0, 0.0] }
                })
            })
            .collect()
    }
}

/// Texels that were fitted again.
pub(super) struct Fits {
    /// Reduced.
    pub chi2: f64,
    freedom: f64,
    texels: Vec<TexelParameters>,
}
