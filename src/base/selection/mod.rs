//! Which readings of many to take: those that leave the smallest standard errors.
//!
//! Every candidate reading has rows of the weighted Jacobian (∂value/∂parameter over the reading's standard error), in
//! every situation that the design is for: a draw of the parameters, or a place of the object. A set of readings S
//! leaves the covariance V(S) = (P + Σ_S JᵀJ)⁻¹, where P is what is known before any reading. The criterion is the
//! mean, over situations and wanted parameters, of V(S)_kk / V(all)_kk; or, where the readings themselves are to be
//! predicted, of their mean variance over that of all. Its square root is how many times larger the errors are than
//! those of all candidates. A mean over situations keeps a design from resting on one guess of the answer (Chaloner &
//! Verdinelli 1995, "Bayesian experimental design: a review"; the criterion is a weighted A-optimality, or
//! I-optimality).
//!
//! Readings are added one by one, each the best at its turn, and then exchanged one for one as long as that helps
//! (Fedorov 1972, "Theory of optimal experiments"). What no set can beat is found from the convex problem in which a
//! reading may be taken in part: its gradient bounds it from below (Pukelsheim 1993, "Optimal design of experiments").

mod bound;

use nalgebra::DMatrix;
use rayon::prelude::*;

/// One parameter that a design is for, or beside.
#[derive(Debug, Clone, PartialEq)]
pub struct DesignParameter {
    /// Its name, as the fit names it.
    pub name: String,
    /// What is known of it before any reading: its standard deviation, in its own unit; 0 where it is known exactly.
    pub known: f64,
    /// Whether its error counts.
    pub wanted: bool,
}

/// One draw of the parameters, or one place of the object.
#[derive(Debug, Clone, PartialEq)]
pub struct DesignSituation {
    /// The parameters' values, for errors relative to them.
    pub values: Vec<f64>,
    /// Rows of the weighted Jacobian, a candidate each: whole rows of as many numbers as there are parameters.
    pub rows: Vec<Vec<f64>>,
}

/// What a design makes small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DesignAim {
    /// The errors of the wanted parameters.
    #[default]
    Parameters,
    /// The errors of the values that the fitted model predicts for all candidates.
    Predictions,
}

/// Candidate readings, and what is asked of them.
#[derive(Debug, Clone, PartialEq)]
pub struct DesignProblem {
    /// What is to be small.
    pub aim: DesignAim,
    /// The parameters, in the order of the rows.
    pub parameters: Vec<DesignParameter>,
    /// What the design has to serve; at least one.
    pub situations: Vec<DesignSituation>,
    /// Candidates that are taken already, and stay.
    pub taken: Vec<usize>,
}

/// A set of readings, and what it leaves.
#[derive(Debug, Clone, PartialEq)]
pub struct DesignChoice {
    /// Indices of candidates, ascending.
    pub chosen: Vec<usize>,
    /// Standard error of each parameter: the median over the situations.
    pub errors: Vec<f64>,
    /// How many times larger the wanted errors are than those of all candidates: the root of the criterion.
    pub ratio: f64,
}

/// The information on a parameter that is known exactly. A larger number would not be finite in products.
const EXACT: f64 = 1e100;
/// Where a parameter's share that no other one explains is less than this, double precision does not hold it to 1 %.
const LOST: f64 = 1e-14;
/// An exchange must lower the criterion by this share.
const GAIN: f64 = 1e-6;

/// One situation while readings come and go.
#[derive(Clone)]
struct Covariance {
    v: DMatrix<f64>,
    /// The criterion is the trace of this times V.
    weight: DMatrix<f64>,
}

impl Covariance {
    fn criterion(&self) -> f64 {
        self.weight.dot(&self.v)
    }

    /// G = R V, and (I ± R V Rᵀ)⁻¹ for the rows R of a reading; `None` without rows, or where the reading is all that
    /// is known.
    fn gain(&self, rows: &[f64], sign: f64) -> Option<(DMatrix<f64>, DMatrix<f64>)> {
        let p = self.v.nrows();
        if rows.is_empty() {
            return None;
        }
        let r = DMatrix::from_row_slice(rows.len() / p, p, rows);
        let g = &r * &self.v;
        let inner = DMatrix::identity(r.nrows(), r.nrows()) + sign * (&g * r.transpose());
        Some((g, inner.cholesky()?.inverse()))
    }

    /// By how much the criterion changes with a reading (`sign` 1) or without it (−1).
    fn change(&self, rows: &[f64], sign: f64) -> f64 {
        let Some((g, inner)) = self.gain(rows, sign) else {
            // A reading that cannot be taken here changes nothing.
            return if rows.is_empty() { 0.0 } else { f64::INFINITY };
        };
        -sign * inner.dot(&(&g * &self.weight * g.transpose()))
    }

    fn update(&mut self, rows: &[f64], sign: f64) {
        if let Some((g, inner)) = self.gain(rows, sign) {
            self.v -= sign * (g.transpose() * inner * g);
        }
    }
}

impl DesignProblem {
    /// How many candidates there are.
    pub fn candidates(&self) -> usize {
        self.situations.first().map_or(0, |s| s.rows.len())
    }

    /// Covariance in one situation, where each candidate counts with a weight; `None` where numbers overflow,
    /// or where double precision cannot tell the parameters apart by these readings.
    fn covariance(&self, situation: &DesignSituation, weight: impl Fn(usize) -> f64) -> Option<DMatrix<f64>> {
        let p = self.parameters.len();
        let prior = |k: usize| self.parameters[k].known;
        let mut information = DMatrix::from_diagonal(&nalgebra::DVector::from_fn(p, |k, _| {
            if prior(k) == 0.0 { EXACT } else { prior(k).powi(-2) }
        }));
        for (candidate, rows) in situation.rows.iter().enumerate() {
            let w = weight(candidate);
            if w == 0.0 {
                continue;
            }
            for row in rows.chunks(p) {
                for i in 0..p {
                    for j in 0..p {
                        information[(i, j)] += w * row[i] * row[j];
                    }
                }
            }
        }
        // Parameters of unlike units are brought to one scale before the inversion.
        let scale: Vec<f64> = (0..p).map(|k| information[(k, k)].sqrt().recip()).collect();
        let scaled = DMatrix::from_fn(p, p, |i, j| information[(i, j)] * scale[i] * scale[j]);
        let root = scaled.cholesky()?;
        if root.l_dirty().diagonal().iter().any(|pivot| !(pivot * pivot > LOST)) {
            return None;
        }
        let inverse = root.inverse();
        Some(DMatrix::from_fn(p, p, |i, j| inverse[(i, j)] * scale[i] * scale[j]))
    }

    /// What turns a covariance into its share of the criterion, a situation each. The shares of all candidates sum to
    /// one.
    fn weights(&self) -> Option<Vec<DMatrix<f64>>> {
        let p = self.parameters.len();
        let share = 1.0 / self.situations.len() as f64;
        let of = |situation: &DesignSituation| {
            let all = self.covariance(situation, |_| 1.0)?;
            let weight = match self.aim {
                DesignAim::Parameters => {
                    let one = |k: usize| if self.parameters[k].wanted { all[(k, k)].recip() } else { 0.0 };
                    DMatrix::from_diagonal(&nalgebra::DVector::from_fn(p, |k, _| one(k)))
                }
                DesignAim::Predictions => {
                    let rows = DMatrix::from_row_slice(situation.rows.concat().len() / p, p, &situation.rows.concat());
                    rows.transpose() * rows
                }
            };
            let whole = weight.dot(&all);
            (whole > 0.0).then(|| weight * (share / whole))
        };
        self.situations.iter().map(of).collect()
    }

    fn start(&self, chosen: &[usize], weights: &[DMatrix<f64>]) -> Option<Vec<Covariance>> {
        let of = |(situation, weight): (&DesignSituation, &DMatrix<f64>)| {
            Some(Covariance { v: self.left_by(situation, chosen)?, weight: weight.clone() })
        };
        self.situations.iter().zip(weights).map(of).collect()
    }

    /// Covariance in one situation that a set of readings leaves.
    fn left_by(&self, situation: &DesignSituation, chosen: &[usize]) -> Option<DMatrix<f64>> {
        let mut taken = vec![0.0; self.candidates()];
        chosen.iter().for_each(|k| taken[*k] = 1.0);
        self.covariance(situation, |k| taken[k])
    }

    /// The candidate that changes the criterion most for the better, of those that `may`, and the change.
    fn best(&self, state: &[Covariance], sign: f64, may: impl Fn(usize) -> bool + Sync) -> Option<(usize, f64)> {
        let change =
            |k: usize| state.iter().zip(&self.situations).map(|(s, of)| s.change(&of.rows[k], sign)).sum::<f64>();
        (0..self.candidates())
            .into_par_iter()
            .filter(|k| may(*k))
            .map(|k| (k, change(k)))
            // Of equal ones the first is taken, so that the answer does not depend on the threads.
            .min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)))
    }

    fn apply(&self, state: &mut [Covariance], candidate: usize, sign: f64) {
        state.iter_mut().zip(&self.situations).for_each(|(s, of)| s.update(&of.rows[candidate], sign));
    }

    /// The best `count` readings, those that are taken already among them. `None` where a Jacobian is not finite, or
    /// where double precision cannot tell the parameters apart.
    pub fn choose(&self, count: usize) -> Option<DesignChoice> {
        self.choose_watched(count, &|_, _| true)
    }

    /// The same. `watch` hears how many steps of how many are done, as far as it is known yet, and ends the search
    /// where it answers with `false`; then there is no answer.
    pub fn choose_watched(&self, count: usize, watch: &dyn Fn(usize, usize) -> bool) -> Option<DesignChoice> {
        let mut chosen = self.taken.clone();
        let weights = self.weights()?;
        let mut state = self.start(&chosen, &weights)?;
        let new = count.min(self.candidates()).saturating_sub(chosen.len());
        let mut done = 0;
        let mut go_on = |rounds: usize| (watch(done, rounds * new), done += 1).0;
        while chosen.len() < count.min(self.candidates()) {
            if !go_on(2) {
                return None;
            }
            let (next, _) = self.best(&state, 1.0, |k| !chosen.contains(&k))?;
            self.apply(&mut state, next, 1.0);
            chosen.push(next);
        }
        for round in 0..20 {
            let mut better = false;
            for place in self.taken.len()..chosen.len() {
                if !go_on(2 + round) {
                    return None;
                }
                state = self.start(&chosen, &weights)?;
                let before: f64 = state.iter().map(Covariance::criterion).sum();
                self.apply(&mut state, chosen[place], -1.0);
                let without: f64 = state.iter().map(Covariance::criterion).sum();
                let (next, change) = self.best(&state, 1.0, |k| !chosen.contains(&k) || k == chosen[place])?;
                if without + change < before * (1.0 - GAIN) {
                    chosen[place] = next;
                    better = true;
                }
            }
            if !better {
                break;
            }
        }
        chosen.sort_unstable();
        self.judge(&chosen)
    }

    /// What a set of readings leaves.
    pub fn judge(&self, chosen: &[usize]) -> Option<DesignChoice> {
        let state = self.start(chosen, &self.weights()?)?;
        let error = |k: usize| crate::statistics::median_of(state.iter().map(|s| s.v[(k, k)].sqrt()));
        Some(DesignChoice {
            chosen: chosen.to_vec(),
            errors: (0..self.parameters.len()).map(|k| error(k).unwrap_or(f64::NAN)).collect(),
            ratio: state.iter().map(Covariance::criterion).sum::<f64>().max(0.0).sqrt(),
        })
    }

    /// Covariance of the parameters that a set of readings leaves in one situation.
    pub fn covariance_of(&self, situation: usize, chosen: &[usize]) -> Option<DMatrix<f64>> {
        self.left_by(self.situations.get(situation)?, chosen)
    }

    /// What is left of χ² where the readings follow another model than the one that is fitted: `difference` holds the
    /// other model's value less this one's over the standard error, for every row of every candidate. The part that
    /// the parameters can take up is taken off, to first order.
    pub fn lack_of_fit(&self, situation: usize, chosen: &[usize], difference: &[Vec<f64>]) -> Option<f64> {
        let (of, p) = (self.situations.get(situation)?, self.parameters.len());
        let covariance = self.covariance_of(situation, chosen)?;
        let (mut whole, mut taken_up) = (0.0, nalgebra::DVector::zeros(p));
        for k in chosen {
            for (row, d) in of.rows[*k].chunks(p).zip(&difference[*k]) {
                whole += d * d;
                taken_up += nalgebra::DVector::from_column_slice(row) * *d;
            }
        }
        Some((whole - (taken_up.transpose() * covariance * &taken_up)[(0, 0)]).max(0.0))
    }
}

/// `count` indices of `candidates`, evenly from the first to the last.
pub fn evenly(candidates: usize, count: usize) -> Vec<usize> {
    let count = count.min(candidates);
    let at = |k: usize| (k as f64 * (candidates - 1) as f64 / (count.max(2) - 1) as f64).round() as usize;
    (0..count).map(at).collect()
}

#[cfg(test)]
mod tests;
