//! The fit of one texel. It starts from the bank of templates, runs Levenberg–Marquardt on the projected problem and
//! takes its weights from the model. Then come outliers (`outliers.rs`), the question whether there is a lobe at all,
//! the errors and the verdict (`report.rs`).

mod adequacy;
mod descent;
mod minima;
mod state;

pub(super) use descent::bounded;
pub(super) use state::State;

use super::projection::{self, ChannelProjection, NONLINEAR};
use super::start::{TemplateBank, TemplateMatch, TemplateScratch};
use super::{GlossFitDevice, GlossTexelFit, NO_LIGHT, ReadingNoise, RobustWeighting, normal_of, normal_slopes};
use mesophyll_base::processor::InstructionSet;
use mesophyll_base::solvers::Termination;
use mesophyll_optics::tube::evaluator::{self, COLUMNS, TubeGeometry};
use mesophyll_optics::tube::{Travel, TubeModel, TubePrecision};

/// The fit ends when the predicted decrease of χ² is below this; the last step is taken linearly. The step is then
/// below a twentieth of a standard error, and the linear step leaves an error of the order of its square.
pub(super) const CONVERGED: f64 = 3e-3;
/// Weights may change from here on: the fit is within about two standard errors.
const NEAR: f64 = 4.0;
/// Where ln m or a tilt (rad) moves farther than this from an answer that was there, the texel is fitted from nothing.
const STAYS: f64 = 0.1;
/// Above this slope a one-pass fit looks for other minima.
const BROAD: f64 = 0.6;
/// Gloss that explains less χ² than this is faint: other minima are looked for, and m is doubted. The first number is
/// for one pass, the second for two: a second pass sees the lobe from another side, and the search would take ten times
/// as long as the fit.
pub(super) const FAINT: [f64; 2] = [400.0, 60.0];
/// Where the correlation of ρd and ρs is below this, other minima are looked for; one pass, two passes.
const ALIKE: [f64; 2] = [-0.98, -0.995];

/// Where the fit of a texel may start, in place of the best template: the answer from fewer readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GlossFitStart {
    /// Slope of the gloss.
    pub m: f64,
    /// Tilts along x and along y (rad).
    pub tilt: [f64; 2],
}

/// Fits texels of one device; shared by threads.
pub struct GlossTexelFitter {
    pub(super) device: GlossFitDevice,
    passes: Vec<Pass>,
    pub(super) level: InstructionSet,
    /// How outliers among the samples are treated.
    pub robust: RobustWeighting,
    /// Standard deviation (rad) of the tilt that a one-pass fit cannot see. The possible effect of such a tilt on the
    /// other parameters widens their errors.
    pub unseen: f64,
}

struct Pass {
    light: evaluator::PassEvaluator,
    bank: TemplateBank,
}

/// Scratch of one thread. Columns hold both passes, each padded to whole vectors.
#[derive(Debug, Default)]
pub struct GlossFitWorkspace {
    pub(super) columns: [Vec<f64>; COLUMNS],
    pub(super) y: [Vec<f64>; 3],
    pub(super) w: [Vec<f64>; 3],
    /// 1 for a reading in use, 0 for a missing reading or an outlier.
    pub(super) used: [Vec<f64>; 3],
    /// Sum of the channels and its variance (infinite where one is missing).
    sum: [Vec<f64>; 2],
    lit: [TubeGeometry; 2],
    match_scratch: TemplateScratch,
    starts: Vec<TemplateMatch>,
}

impl GlossTexelFitter {
    /// `pass_x_positions_mm` and `pass_y_positions_mm` are the tube's positions along the travel (mm), one for each
    /// frame. Pass y is optional.
    pub fn new(device: &GlossFitDevice, pass_x_positions_mm: &[f64], pass_y_positions_mm: Option<&[f64]>) -> Self {
        Self::with_precision(device, pass_x_positions_mm, pass_y_positions_mm, &TubePrecision::default())
    }

    /// The same with a stated quadrature.
    pub fn with_precision(
        device: &GlossFitDevice,
        x_mm: &[f64],
        y_mm: Option<&[f64]>,
        precision: &TubePrecision,
    ) -> Self {
        Self::with_bank(device, x_mm, y_mm, precision, 1.0)
    }

    /// The same with a template bank `fineness` times as fine in either parameter.
    pub fn with_bank(
        device: &GlossFitDevice,
        x_mm: &[f64],
        y_mm: Option<&[f64]>,
        precision: &TubePrecision,
        fineness: f64,
    ) -> Self {
        let level = InstructionSet::detect();
        let model = TubeModel::new(device.tube(), device.camera, device.lobe, precision);
        let pass = |travel: Travel, positions: &[f64], range: [f64; 2]| Pass {
            light: evaluator::PassEvaluator::new(&model, travel, positions, precision.along, level),
            bank: TemplateBank::new(device, travel, positions, range, fineness),
        };
        let mut passes = vec![pass(Travel::X, x_mm, [-0.35, 0.6])];
        passes.extend(y_mm.map(|y| pass(Travel::Y, y, [-0.6, 0.6])));
        GlossTexelFitter { device: device.clone(), passes, level, robust: RobustWeighting::default(), unseen: 0.0 }
    }

    /// Templates of the first pass.
    pub fn bank_size(&self) -> usize {
        self.passes.first().map_or(0, |p| p.bank.size())
    }

    /// Room for fits of this device and these positions. Each thread needs its own.
    pub fn workspace(&self) -> GlossFitWorkspace {
        GlossFitWorkspace::default()
    }

    /// Fits one texel at `texel_mm` on the blade; samples in frame order, NaN (or infinite) = no reading. A channel
    /// without a single reading stays out of the fit and is returned as NaN.
    pub fn fit(
        &self,
        ws: &mut GlossFitWorkspace,
        texel_mm: [f64; 2],
        trace_x: &[[f32; 3]],
        trace_y: Option<&[[f32; 3]]>,
    ) -> GlossTexelFit {
        self.fit_under(&self.device.noise(), ws, texel_mm, trace_x, trace_y)
    }

    /// The same where the texel's own noise is known: a camera's gain and dark level differ from texel to texel.
    pub fn fit_under(
        &self,
        noise: &ReadingNoise,
        ws: &mut GlossFitWorkspace,
        texel_mm: [f64; 2],
        trace_x: &[[f32; 3]],
        trace_y: Option<&[[f32; 3]]>,
    ) -> GlossTexelFit {
        self.fit_from(None, noise, ws, texel_mm, [Some(trace_x), trace_y])
    }

    /// The same from a start that is known. Where that leads to no good fit, templates are tried as without it.
    pub fn fit_from(
        &self,
        earlier: Option<GlossFitStart>,
        noise: &ReadingNoise,
        ws: &mut GlossFitWorkspace,
        texel_mm: [f64; 2],
        given: [Option<&[[f32; 3]]>; 2],
    ) -> GlossTexelFit {
        let tilts = given.iter().flatten().count();
        let matches = tilts <= self.passes.len()
            && self.passes.iter().zip(given).all(|(p, t)| t.is_none_or(|t| t.len() == p.light.frames()));
        if !matches {
            return GlossTexelFit::refused("the traces and the tube positions differ in length");
        }
        let mut job = Job {
            fitter: self,
            noise: *noise,
            ws,
            texel: texel_mm,
            tilts,
            evaluations: 0,
            iterations: 0,
            matte: false,
            held: false,
            earlier,
        };
        job.load(given);
        job.run()
    }
}

/// One texel being fitted.
pub(super) struct Job<'a> {
    pub fitter: &'a GlossTexelFitter,
    pub noise: ReadingNoise,
    pub ws: &'a mut GlossFitWorkspace,
    texel: [f64; 2],
    /// How many passes are in use; as many tilts are fitted.
    pub tilts: usize,
    pub evaluations: usize,
    pub iterations: usize,
    /// Whether ρs is held at zero.
    pub matte: bool,
    /// Whether the tilt is held at its value.
    pub held: bool,
    /// Where the fit starts, if that is known.
    pub earlier: Option<GlossFitStart>,
}

impl Job<'_> {
    fn passes(&self) -> &[Pass] {
        &self.fitter.passes[..self.tilts]
    }

    /// Where the frames of each pass lie in the columns.
    pub fn frames(&self) -> [std::ops::Range<usize>; 2] {
        let mut from = 0;
        std::array::from_fn(|k| {
            let range = self.passes().get(k).map_or(from..from, |p| from..from + p.light.frames());
            from += self.passes().get(k).map_or(0, |p| p.light.padded());
            range
        })
    }

    fn load(&mut self, given: [Option<&[[f32; 3]]>; 2]) {
        let total: usize = self.passes().iter().map(|p| p.light.padded()).sum();
        let frames = self.frames();
        let ws = &mut *self.ws;
        let lists = ws.columns.iter_mut().chain(&mut ws.y).chain(&mut ws.w).chain(&mut ws.used).chain(&mut ws.sum);
        for list in lists {
            list.clear();
            list.resize(total, 0.0);
        }
        for (range, trace) in frames.into_iter().zip(given.into_iter().flatten()) {
            for c in 0..3 {
                let (y, used) = (&mut ws.y[c][range.clone()], &mut ws.used[c][range.clone()]);
                for ((y, used), v) in y.iter_mut().zip(used).zip(trace) {
                    let good = v[c].is_finite();
                    *y = if good { f64::from(v[c]) } else { 0.0 };
                    *used = if good { 1.0 } else { 0.0 };
                }
            }
        }
        for (pass, lit) in self.fitter.passes[..self.tilts].iter().zip(&mut ws.lit) {
            pass.light.light(self.texel, lit);
        }
    }

    fn run(&mut self) -> GlossTexelFit {
        let counts: [usize; 3] = std::array::from_fn(|c| self.ws.used[c].iter().sum::<f64>() as usize);
        let used: usize = counts.iter().sum();
        let channels = counts.iter().filter(|n| **n > 0).count();
        let parameters = 2 * channels + 1 + self.tilts;
        if used == 0 {
            return GlossTexelFit::refused("no readings");
        }
        if used <= parameters || counts.iter().any(|n| *n == 1 || *n == 2) {
            return GlossTexelFit::refused("too few readings");
        }
        if self.dark(used) {
            return GlossTexelFit::refused(NO_LIGHT);
        }
        let Some(start) = self.first() else { return GlossTexelFit::refused("no template fits") };
        let mut best = self.climb(start);
        let mut worst = self.weigh(&best.0);
        // χ² is larger than noise makes it (by 4 standard deviations): another template may have been the right one.
        let freedom = (used - parameters) as f64;
        let poor = |(state, end): &(State, Termination)| {
            !end.converged() || state.chi2 > freedom + 4.0 * (2.0 * freedom).sqrt()
        };
        let far = |state: &State| state.p.iter().zip(start).any(|(to, from)| (to - from).abs() > STAYS);
        if self.earlier.is_some() && (poor(&best) || far(&best.0)) {
            self.earlier = None;
            let Some(start) = self.first() else { return GlossTexelFit::refused("no template fits") };
            best = self.climb(start);
            worst = self.weigh(&best.0);
        }
        if poor(&best) {
            best = self.others(best, &mut Vec::new());
            worst = self.weigh(&best.0);
        }
        let mut outliers = 0;
        if self.fitter.robust != RobustWeighting::Off {
            (best.0, best.1, outliers) = self.reject(best.0, best.1, worst);
        }
        // There may be several minima where gloss is faint, where gloss looks like more diffuse light, and where one
        // pass shows a lobe so wide that a tilted narrow one may hide in it. Then all of them are looked at.
        let mut rivals = Vec::new();
        let wide = self.tilts == 1 && best.0.p[0] > BROAD.ln();
        let mut searched = wide || best.0.gloss_chi2() < FAINT[self.tilts - 1];
        if searched {
            best = self.others(best, &mut rivals);
        }
        let mut fit = match self.matte(best.0) {
            Some(bare) => return self.report_matte(best.0, bare, counts, parameters, outliers),
            None => self.report(best.0, best.1, counts, false, parameters, outliers),
        };
        if !searched && fit.correlation < ALIKE[self.tilts - 1] {
            searched = true;
            let before = best.0.p;
            best = self.others(best, &mut rivals);
            if best.0.p != before {
                fit = self.report(best.0, best.1, counts, false, parameters, outliers);
            }
        }
        if searched {
            self.compare(&mut fit, &best.0, &rivals);
            self.profile(&mut fit, &best.0, counts);
        }
        self.unseen(&mut fit, &best.0, counts);
        fit
    }

    /// Whether darkness explains every reading: χ² of zero light, under the noise of darkness, is within 4 standard
    /// deviations. A texel that faces away from the camera looks like this. Fitting it would be slow, and its
    /// parameters would be fitted to noise.
    fn dark(&self, used: usize) -> bool {
        let of_channel = |(c, y): (usize, &Vec<f64>)| {
            // An error of the dark frame is common to all readings of a texel.
            let (common, variance) = (3.0 * self.noise.dark_error[c], self.noise.variance(c, 0.0));
            y.iter().map(|y| (y.abs() - common).max(0.0).powi(2)).sum::<f64>() / variance
        };
        let chi2: f64 = self.ws.y.iter().enumerate().map(of_channel).sum();
        let n = used as f64;
        self.ws.y.iter().flatten().all(|y| *y <= 0.0) || chi2 < n + 4.0 * (2.0 * n).sqrt()
    }

    /// Computes weights from the fitted model. They do not depend on the samples' own noise, so they cause no bias.
    /// Returns the largest squared standardised residual.
    pub fn weigh(&mut self, state: &State) -> f64 {
        let (noise, level, ws) = (self.noise, self.fitter.level, &mut *self.ws);
        let mut worst = 0.0f64;
        for c in 0..3 {
            let rho = [state.channels[c].rho_d, state.channels[c].rho_s];
            worst = worst.max(projection::weigh(
                level,
                &ws.columns,
                rho,
                noise.terms(c),
                &ws.y[c],
                &ws.used[c],
                &mut ws.w[c],
            ));
        }
        worst
    }

    pub fn evaluate(&mut self, p: [f64; NONLINEAR]) -> State {
        self.evaluations += 1;
        let tilt = [p[1], p[2]];
        let (n, slopes) = (normal_of(tilt), normal_slopes(tilt));
        let ws = &mut *self.ws;
        let mut from = 0;
        for (pass, lit) in self.fitter.passes[..self.tilts].iter().zip(&mut ws.lit) {
            let to = from + pass.light.padded();
            let mut columns = ws.columns.each_mut().map(|c| &mut c[from..to]);
            pass.light.respond(lit, n, &slopes[..self.tilts], p[0].exp(), &mut columns);
            from = to;
        }
        self.project(p)
    }

    /// The linear solution for the present columns.
    pub fn project(&self, p: [f64; NONLINEAR]) -> State {
        let ws = &*self.ws;
        let channels: [ChannelProjection; 3] = std::array::from_fn(|c| {
            ChannelProjection::solve(self.fitter.level, &ws.columns, &ws.y[c], &ws.w[c], self.matte)
        });
        State { p, channels, chi2: channels.iter().map(|c| c.chi2).sum() }
    }

    /// Fills in the sums that only an accepted point needs.
    pub fn slopes(&self, state: &mut State) {
        let (ws, m) = (&*self.ws, state.p[0].exp());
        for c in 0..3 {
            state.channels[c].slopes(self.fitter.level, &ws.columns, &ws.y[c], &ws.w[c], m, self.tilts);
        }
    }
}

#[cfg(test)]
mod tests;
