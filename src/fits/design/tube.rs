//! Positions of a linear light source: which of them tell most about a leaf's texels.

use super::search;
use crate::Result;
use crate::gloss::{GlossFitDevice, GlossTexelFitter, ReadingNoise, RobustWeighting, normal_of, normal_slopes};
use mesophyll_base::selection::{DesignAim, DesignChoice, DesignParameter, DesignProblem, DesignSituation};
use mesophyll_base::statistics::median_of;
use mesophyll_files::progress::TaskProgress;
use mesophyll_optics::gloss::{Lobe, LobeKind, dot};
use mesophyll_optics::tube::{Travel, TubeModel, TubePrecision};
use rayon::prelude::*;
use strum::{Display, EnumIter, EnumString, IntoEnumIterator, IntoStaticStr};

pub use crate::gloss::synthetic::GlossFitTruth;

/// What a design of a leaf scan can be for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumString, EnumIter, IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
pub enum TexelQuantity {
    /// Diffuse reflectance ρd.
    RhoD,
    /// Gloss reflectance ρs.
    RhoS,
    /// Slope of the gloss.
    M,
    /// Normal: the tilts that the passes show.
    Normal,
}

impl TexelQuantity {
    /// Which of the parameters it is.
    fn indices(self) -> std::ops::Range<usize> {
        match self {
            TexelQuantity::RhoD => 0..3,
            TexelQuantity::RhoS => 3..6,
            TexelQuantity::M => 6..7,
            TexelQuantity::Normal => 7..9,
        }
    }
}

/// Parameters of a texel: ρd and ρs (R, G, B each), m, tilt, tilt_y (rad).
const PARAMETERS: usize = 9;
/// What is known before any reading: reflectances lie between 0 and 1, slopes below 1.2, leaves lean less than 60°.
const KNOWN: [f64; PARAMETERS] = [0.5, 0.5, 0.5, 0.3, 0.3, 0.3, 0.4, 0.5, 0.5];
/// A pass of a capture has at least this many frames.
pub const LEAST_FRAMES: usize = 8;

/// A texel that a design has to serve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DesignTexel {
    /// Its place on the blade (mm).
    pub at_mm: [f64; 2],
    /// What it is thought to be.
    pub truth: GlossFitTruth,
    /// The noise of its readings.
    pub noise: ReadingNoise,
}

/// A place of the tube.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TubePlace {
    /// The direction of travel.
    pub pass: Travel,
    /// Its position along the travel (mm).
    pub position_mm: f64,
}

/// A scan that is planned.
#[derive(Debug, Clone)]
pub struct TubeDesign {
    /// The device.
    pub device: GlossFitDevice,
    /// Places that the tube can take: pass x in the order of travel, then pass y.
    pub places: Vec<TubePlace>,
    /// Texels of the leaf.
    pub texels: Vec<DesignTexel>,
    /// What it is for.
    pub wanted: Vec<TexelQuantity>,
    /// Places whose frames are there already, as indices.
    pub taken: Vec<usize>,
}

/// Standard errors of what a texel has, the median over the texels: ρd and ρs (of the three channels together), m, and
/// the normal (degrees).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DesignTexelErrors(pub [f64; 4]);

impl TubeDesign {
    /// The problem of choosing places.
    pub fn problem(&self) -> DesignProblem {
        let both = self.passes().len() > 1;
        let wanted = |k: usize| self.wanted.iter().any(|q| q.indices().contains(&k)) && (k < 8 || both);
        let name = |k: usize| TexelQuantity::iter().find(|q| q.indices().contains(&k)).map_or("", Into::into);
        let parameter = |k: usize| DesignParameter { name: name(k).into(), known: KNOWN[k], wanted: wanted(k) };
        let bar = TaskProgress::new(format!("light at {} places", self.places.len()), self.texels.len() as u64);
        let situation = |texel: &DesignTexel| (self.situation(texel), bar.advance(1)).0;
        let mut problem = DesignProblem {
            aim: DesignAim::Parameters,
            parameters: (0..PARAMETERS).map(parameter).collect(),
            situations: self.texels.par_iter().map(situation).collect(),
            taken: self.taken.clone(),
        };
        if !both {
            // A fit of one pass takes the tilt across it as 0.
            problem.parameters[8].known = 1e-9;
        }
        problem
    }

    fn passes(&self) -> Vec<Travel> {
        [Travel::X, Travel::Y].into_iter().filter(|t| self.places.iter().any(|p| p.pass == *t)).collect()
    }

    fn situation(&self, texel: &DesignTexel) -> DesignSituation {
        let GlossFitDevice { camera, lobe, .. } = self.device;
        let model = TubeModel::new(self.device.tube(), camera, lobe, &TubePrecision::default());
        let t = &texel.truth;
        let (normal, slopes) = (normal_of(t.tilt), normal_slopes(t.tilt));
        let rows = |place: &TubePlace| {
            let r = model.response(place.pass, place.position_mm, texel.at_mm, normal, t.m);
            let mut rows = vec![0.0; 3 * PARAMETERS];
            for c in 0..3 {
                let sd = texel.noise.variance(c, t.rho_d[c] * r.d + t.rho_s[c] * r.s).sqrt();
                let row = &mut rows[c * PARAMETERS..(c + 1) * PARAMETERS];
                (row[c], row[3 + c], row[6]) = (r.d / sd, r.s / sd, t.rho_s[c] * r.s_m / sd);
                for (k, slope) in slopes.iter().enumerate() {
                    row[7 + k] = (t.rho_d[c] * dot(r.d_n, *slope) + t.rho_s[c] * dot(r.s_n, *slope)) / sd;
                }
            }
            rows
        };
        let values = [&t.rho_d[..], &t.rho_s[..], &[t.m], &t.tilt[..]].concat();
        DesignSituation { values, rows: self.places.iter().map(rows).collect() }
    }

    /// The best `count` places. A capture needs at least eight frames a pass, so a pass gets none or that many.
    ///
    /// # Errors
    /// A stop that was asked for.
    pub fn choose(&self, problem: &DesignProblem, count: usize) -> Result<Option<DesignChoice>> {
        let Some(free) = search::choose(problem, count)? else { return Ok(None) };
        let too_few = |pass: &Travel| {
            let frames = self.of(&free.chosen, *pass).len();
            // A capture may lack pass y, but not pass x.
            frames < LEAST_FRAMES && (frames > 0 || *pass == Travel::X)
        };
        // The pass with too few gets the eight best beside what it has, and the other one the rest.
        let Some(few) = self.passes().into_iter().find(too_few) else { return Ok(Some(free)) };
        let mut with = problem.clone();
        while self.of(&with.taken, few).len() < LEAST_FRAMES {
            let next = free.chosen.iter().copied().filter(|k| self.places[*k].pass == few && !with.taken.contains(k));
            let Some(next) = next.chain(self.spread(few)).find(|k| !with.taken.contains(k)) else { return Ok(None) };
            with.taken.push(next);
        }
        search::choose(&with, count.max(with.taken.len()))
    }

    /// Places of a pass from coarse to fine.
    fn spread(&self, pass: Travel) -> Vec<usize> {
        let all: Vec<usize> = (0..self.places.len()).filter(|k| self.places[*k].pass == pass).collect();
        let mut order = Vec::new();
        for parts in 1..=all.len() {
            order.extend(mesophyll_base::selection::evenly(all.len(), parts + 1).into_iter().map(|k| all[k]));
        }
        order
    }

    /// `count` places evenly over the passes, each pass with its share.
    pub fn evenly(&self, count: usize) -> Vec<usize> {
        let passes = self.passes();
        let mut chosen = Vec::new();
        for (k, pass) in passes.iter().enumerate() {
            let all: Vec<usize> = (0..self.places.len()).filter(|p| self.places[*p].pass == *pass).collect();
            let share = count / passes.len() + usize::from(k < count % passes.len());
            chosen.extend(mesophyll_base::selection::evenly(all.len(), share).into_iter().map(|k| all[k]));
        }
        chosen
    }

    /// Those of `chosen` that lie in a pass.
    pub fn of(&self, chosen: &[usize], pass: Travel) -> Vec<usize> {
        chosen.iter().copied().filter(|k| self.places[*k].pass == pass).collect()
    }

    /// The errors that a choice leaves.
    pub fn errors(&self, choice: &DesignChoice) -> DesignTexelErrors {
        let of = |q: TexelQuantity| {
            let all: Vec<f64> = q.indices().map(|k| choice.errors[k]).filter(|e| *e > 1e-6).collect();
            (all.iter().map(|e| e * e).sum::<f64>() / all.len().max(1) as f64).sqrt()
        };
        let errors: Vec<f64> = TexelQuantity::iter().map(of).collect();
        DesignTexelErrors([errors[0], errors[1], errors[2], errors[3].to_degrees()])
    }

    /// Fits texels to exact readings of another lobe at the chosen places. Returns how many standard deviations of χ²
    /// the misfit adds, the median over the texels: a design that adds less than four cannot tell that the leaf has
    /// another lobe. `None` where a fit cannot be made.
    pub fn lack_of_fit(&self, chosen: &[usize], other: LobeKind) -> Option<f64> {
        let at = |pass| self.of(chosen, pass).into_iter().map(|k| self.places[k].position_mm).collect::<Vec<f64>>();
        let (x, y) = (at(Travel::X), at(Travel::Y));
        if x.is_empty() {
            return None;
        }
        let y = (!y.is_empty()).then_some(y);
        let lobe = Lobe::of(other, self.device.lobe.index().unwrap_or(crate::gloss::samples::INDEX));
        let device = GlossFitDevice { lobe, ..self.device.clone() };
        let mut fitter = GlossTexelFitter::new(&self.device, &x, y.as_deref());
        fitter.robust = RobustWeighting::Off;
        let seen = |texel: &DesignTexel| {
            let read = |pass, positions: &[f64]| {
                crate::gloss::synthetic::trace(&device, pass, positions, texel.at_mm, &texel.truth, None)
            };
            let (trace_x, trace_y) = (read(Travel::X, &x), y.as_ref().map(|y| read(Travel::Y, y)));
            let ws = &mut fitter.workspace();
            let fit = fitter.fit_under(&texel.noise, ws, texel.at_mm, &trace_x, trace_y.as_deref());
            let freedom = fit.samples.saturating_sub(fit.parameters) as f64;
            (freedom > 0.0).then(|| fit.chi2 / (2.0 * freedom).sqrt())
        };
        let all: Vec<Option<f64>> = self.texels.par_iter().map(seen).collect();
        median_of(all.into_iter().flatten())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gloss::synthetic::{GaussianDeviates, LEAF, device, ramp, trace};

    fn places(frames: usize) -> Vec<TubePlace> {
        let pass =
            |pass, from, to| ramp(from, to, frames).into_iter().map(move |position_mm| TubePlace { pass, position_mm });
        pass(Travel::X, -400.0, 250.0).chain(pass(Travel::Y, -325.0, 325.0)).collect()
    }

    fn planned(texels: &[([f64; 2], f64, [f64; 2])], wanted: &[TexelQuantity]) -> TubeDesign {
        let device = device(Lobe::Beckmann, 0.01);
        let texel = |(at_mm, m, tilt): &([f64; 2], f64, [f64; 2])| DesignTexel {
            at_mm: *at_mm,
            truth: GlossFitTruth { rho_d: [0.06, 0.12, 0.04], rho_s: [0.04; 3], m: *m, tilt: *tilt },
            noise: device.noise(),
        };
        let texels = texels.iter().map(texel).collect();
        TubeDesign { device, places: places(50), texels, wanted: wanted.to_vec(), taken: Vec::new() }
    }

    /// The errors that a design states are the scatter of fits to noisy scans at its places.
    #[test]
    fn planned_errors_are_the_scatter_of_fits() {
        let design = planned(&LEAF[..2], &[TexelQuantity::RhoS, TexelQuantity::M, TexelQuantity::Normal]);
        let problem = design.problem();
        let choice = design.choose(&problem, 25).unwrap().unwrap();
        let at = |pass| design.of(&choice.chosen, pass).into_iter().map(|k| design.places[k].position_mm).collect();
        let (x, y): (Vec<f64>, Vec<f64>) = (at(Travel::X), at(Travel::Y));
        assert!(x.len() >= 8 && y.len() >= 8 && x.len() + y.len() == 25, "{} {}", x.len(), y.len());
        let fitter = GlossTexelFitter::new(&design.device, &x, Some(&y));
        for (situation, texel) in design.texels.iter().enumerate() {
            let covariance = problem.covariance_of(situation, &choice.chosen).unwrap();
            let draws = 1200;
            let mut noise = GaussianDeviates::new(5 + situation as u64);
            let mut squares = [0.0; 3];
            for _ in 0..draws {
                let mut read = |pass, positions: &[f64]| {
                    trace(&design.device, pass, positions, texel.at_mm, &texel.truth, Some(&mut noise))
                };
                let (trace_x, trace_y) = (read(Travel::X, &x), read(Travel::Y, &y));
                let fit = fitter.fit(&mut fitter.workspace(), texel.at_mm, &trace_x, Some(&trace_y));
                let off = [fit.rho_s[1] - 0.04, fit.m - texel.truth.m, fit.tilt[1] - texel.truth.tilt[1]];
                squares.iter_mut().zip(off).for_each(|(s, o)| *s += o * o);
            }
            for (k, sum) in [4, 6, 8].into_iter().zip(squares) {
                let (stated, seen) = (covariance[(k, k)].sqrt(), (sum / f64::from(draws)).sqrt());
                assert!((seen / stated - 1.0).abs() < 0.1, "parameter {k} of texel {situation}: {seen} {stated}");
            }
        }
    }

    #[test]
    fn chosen_frames_beat_even_ones_and_no_set_beats_the_bound() {
        let design = planned(&LEAF, &[TexelQuantity::RhoS, TexelQuantity::M, TexelQuantity::Normal]);
        let problem = design.problem();
        let (chosen, even) =
            (design.choose(&problem, 25).unwrap().unwrap(), problem.judge(&design.evenly(25)).unwrap());
        let bound = problem.best_possible(25).unwrap();
        assert!(chosen.ratio < 0.8 * even.ratio, "{} {}", chosen.ratio, even.ratio);
        assert!(bound <= chosen.ratio && chosen.ratio < 1.1 * bound, "{} {bound}", chosen.ratio);
    }

    /// Frames crowded where the errors are smallest still tell another lobe, or it is said that they do not: three
    /// frames cannot.
    #[test]
    fn another_lobe_is_seen_by_many_frames_and_not_by_few() {
        let design = planned(&LEAF[..3], &[TexelQuantity::M]);
        let all: Vec<usize> = (0..design.places.len()).collect();
        let many = design.lack_of_fit(&all, LobeKind::Ggx).unwrap();
        let few = design.lack_of_fit(&design.evenly(16), LobeKind::Ggx).unwrap();
        assert!(many > 4.0 && few < many, "{many} {few}");
        assert!(design.lack_of_fit(&all, LobeKind::Beckmann).unwrap() < 0.05);
    }
}
