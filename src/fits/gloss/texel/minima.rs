//! Where the descent of a texel starts, and the search among other minima: a narrow tilted lobe, a wide one and none at
//! all can look alike.

use super::descent::bounded;
use super::{CONVERGED, GlossFitStart, Job, State};
use crate::gloss::projection::{self, NONLINEAR};
use mesophyll_base::solvers::Termination;

/// A starting slope above this is doubted.
const WIDE: f64 = 0.9;
/// How many templates are tried where the best one does not lead to a good fit.
const STARTS: usize = 4;
/// ρs is taken for zero where this raises χ² by less than this limit (it allows for four parameters and for the search
/// over lobes).
const MATTE: f64 = 12.0;

impl Job<'_> {
    /// Where the fit starts: where it is told to, or at the best template.
    pub fn first(&mut self) -> Option<[f64; NONLINEAR]> {
        match self.earlier {
            None => self.best_template(),
            Some(GlossFitStart { m, tilt: [x, y] }) => {
                self.weigh_provisionally();
                let tilts = [x, if self.tilts > 1 { y } else { 0.0 }];
                Some(bounded(&[m.max(1e-3).ln(), tilts[0], tilts[1]], &[0.0; NONLINEAR]))
            }
        }
    }

    fn best_template(&mut self) -> Option<[f64; NONLINEAR]> {
        let start = self.start(0)?;
        Some(self.doubt(start))
    }

    /// Weights from the samples, which are good enough to start with.
    fn weigh_provisionally(&mut self) {
        let noise = [0, 1, 2].map(|c| self.noise.terms(c));
        let ws = &mut *self.ws;
        projection::weigh_by_samples(self.fitter.level, noise, &ws.y, &ws.used, &mut ws.w, &mut ws.sum);
    }

    /// The starting point that the templates of the first pass put in place `rank`. It leaves weights computed from the
    /// samples.
    pub fn start(&mut self, rank: usize) -> Option<[f64; NONLINEAR]> {
        self.weigh_provisionally();
        let mut p = [0.3f64.ln(), 0.0, 0.0];
        let ws = &mut *self.ws;
        let mut from = 0;
        for (k, pass) in self.fitter.passes[..self.tilts].iter().enumerate() {
            let range = from..from + pass.light.frames();
            from += pass.light.padded();
            pass.bank.best(
                self.texel,
                &ws.sum[0][range.clone()],
                &ws.sum[1][range],
                STARTS,
                &mut ws.match_scratch,
                &mut ws.starts,
            );
            let best = ws.starts.get(if k == 0 { rank } else { 0 })?;
            if k == 0 {
                p[0] = best.m.ln();
            }
            p[1 + k] = best.tilt;
        }
        Some(p)
    }

    /// Descends from a start, first under weights from the samples and, once near, under weights from the model.
    pub fn climb(&mut self, start: [f64; NONLINEAR]) -> (State, Termination) {
        let state = self.evaluate(start);
        self.descend(state, CONVERGED, true)
    }

    /// The widest template also resembles a lobe that is tilted steeply out of the plane of the pass. So smaller slopes
    /// are tried as well.
    pub fn doubt(&mut self, start: [f64; NONLINEAR]) -> [f64; NONLINEAR] {
        if self.tilts < 2 || start[0] < WIDE.ln() {
            return start;
        }
        let tried = [1.0, 0.5, 0.25].map(|by: f64| [start[0] + by.ln(), start[1], start[2]]);
        let chi2 = tried.map(|p| self.evaluate(p).chi2);
        let best = (0..tried.len()).min_by(|&a, &b| chi2[a].total_cmp(&chi2[b])).unwrap_or(0);
        tried[best]
    }

    /// Descends from the other templates. Returns the best fit of all, with its columns and weights in place; `rivals`
    /// collects every end point.
    pub fn others(&mut self, first: (State, Termination), rivals: &mut Vec<State>) -> (State, Termination) {
        let mut best = first;
        // A fit that began elsewhere has not tried the best template yet.
        for rank in usize::from(self.earlier.is_none())..STARTS + 2 {
            // Minima may lie closer together than neighbouring templates: a step to either side of the first fit is
            // tried, too.
            let start = match rank.checked_sub(STARTS) {
                None if rank == 0 => self.best_template(),
                None => self.start(rank),
                Some(side) => self.start(0).map(|_| bounded(&first.0.p, &[0.0, [-0.12, 0.12][side], 0.0])),
            };
            let Some(start) = start else { continue };
            let other = self.climb(start);
            rivals.push(other.0);
            if other.1.converged() >= best.1.converged() && other.0.chi2 < best.0.chi2 {
                rivals.push(best.0);
                best = other;
            }
        }
        // The columns and the weights are left as the winner has them.
        let state = self.evaluate(best.0.p);
        self.weigh(&State { channels: best.0.channels, ..state });
        (self.project(best.0.p), best.1)
    }

    /// The best fit without gloss, where the gloss of `full` explains no more than noise and a search over lobes would.
    pub fn matte(&mut self, full: State) -> Option<(State, Termination)> {
        if full.gloss_chi2() >= 4.0 * MATTE {
            return None;
        }
        self.matte = true;
        let bare = self.evaluate(full.p);
        let bare = self.descend(bare, CONVERGED, false);
        self.matte = false;
        if bare.0.chi2 - full.chi2 < MATTE {
            return Some(bare);
        }
        self.evaluate(full.p);
        None
    }
}
