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

use nalgebra::DMatrix;
use rayon::prelude::*;

/// One parameter that a design is for, or beside.
#[derive(Debug, Clone, PartialEq)]
pub struct DesignParameter {
    /// Its name, as the fit names it.
    pub name: String,
    /// What is known of it before any reading: its standard deviation, in its own unit.
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

/// Steps of the descent that bounds all designs from below.
const BOUND_STEPS: usize = 300;
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

    /// Covariance in one situation, where each candidate counts with a weight; `None` where numbers overflow.
    fn covariance(&self, situation: &DesignSituation, weight: impl Fn(usize) -> f64) -> Option<DMatrix<f64>> {
        let p = self.parameters.len();
        let mut information =
            DMatrix::from_diagonal(&nalgebra::DVector::from_fn(p, |k, _| self.parameters[k].known.powi(-2)));
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
        let inverse = scaled.cholesky()?.inverse();
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

    fn start(&self, chosen: &[usize]) -> Option<Vec<Covariance>> {
        let of = |(situation, weight): (&DesignSituation, DMatrix<f64>)| {
            let v = self.covariance(situation, |k| f64::from(u8::from(chosen.contains(&k))))?;
            Some(Covariance { v, weight })
        };
        self.situations.iter().zip(self.weights()?).map(of).collect()
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

    /// The best `count` readings, those that are taken already among them. `None` where a Jacobian is not finite.
    pub fn choose(&self, count: usize) -> Option<DesignChoice> {
        let mut chosen = self.taken.clone();
        let mut state = self.start(&chosen)?;
        while chosen.len() < count.min(self.candidates()) {
            let (next, _) = self.best(&state, 1.0, |k| !chosen.contains(&k))?;
            self.apply(&mut state, next, 1.0);
            chosen.push(next);
        }
        for _ in 0..20 {
            let mut better = false;
            for place in self.taken.len()..chosen.len() {
                state = self.start(&chosen)?;
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
        let state = self.start(chosen)?;
        let error = |k: usize| crate::statistics::median_of(state.iter().map(|s| s.v[(k, k)].sqrt()));
        Some(DesignChoice {
            chosen: chosen.to_vec(),
            errors: (0..self.parameters.len()).map(|k| error(k).unwrap_or(f64::NAN)).collect(),
            ratio: state.iter().map(Covariance::criterion).sum::<f64>().max(0.0).sqrt(),
        })
    }

    /// Covariance of the parameters that a set of readings leaves in one situation.
    pub fn covariance_of(&self, situation: usize, chosen: &[usize]) -> Option<DMatrix<f64>> {
        self.covariance(self.situations.get(situation)?, |k| f64::from(u8::from(chosen.contains(&k))))
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

    /// The ratio of errors that no set of `count` readings can fall below. The convex problem of readings in part is
    /// descended along its gradient; at every step the tangent bounds its least value from below.
    pub fn best_possible(&self, count: usize) -> Option<f64> {
        let (n, weights) = (self.candidates(), self.weights()?);
        let count = count.min(n);
        let mut share = vec![count as f64 / n as f64; n];
        self.taken.iter().for_each(|k| share[*k] = 1.0);
        let mut bound = 0.0f64;
        for step in 0..BOUND_STEPS {
            let state: Vec<Covariance> = self
                .situations
                .par_iter()
                .zip(&weights)
                .map(|(s, weight)| Some(Covariance { v: self.covariance(s, |k| share[k])?, weight: weight.clone() }))
                .collect::<Option<_>>()?;
            let value: f64 = state.iter().map(Covariance::criterion).sum();
            // ∂criterion/∂share_k = −tr(R V W V Rᵀ); a reading that is taken already is no choice.
            let slope = |k: usize| -> f64 {
                let of = |(s, of): (&Covariance, &DesignSituation)| {
                    let p = s.v.nrows();
                    let g = DMatrix::from_row_slice(of.rows[k].len() / p, p, &of.rows[k]) * &s.v;
                    -(&g * &s.weight).dot(&g)
                };
                state.iter().zip(&self.situations).map(of).sum()
            };
            let slopes: Vec<f64> = (0..n).into_par_iter().map(slope).collect();
            let mut order: Vec<usize> = (0..n).filter(|k| !self.taken.contains(k)).collect();
            order.sort_by(|a, b| slopes[*a].total_cmp(&slopes[*b]));
            order.truncate(count.saturating_sub(self.taken.len()));
            let mut vertex = vec![0.0; n];
            self.taken.iter().chain(&order).for_each(|k| vertex[*k] = 1.0);
            let drop: f64 = (0..n).map(|k| slopes[k] * (vertex[k] - share[k])).sum();
            bound = bound.max(value + drop);
            if -drop < 1e-4 * value {
                break;
            }
            let part = 2.0 / (step as f64 + 2.0) * 0.5;
            share.iter_mut().zip(&vertex).for_each(|(s, v)| *s += part * (v - *s));
        }
        Some(bound.max(1.0).sqrt())
    }
}

/// `count` indices of `candidates`, evenly from the first to the last.
pub fn evenly(candidates: usize, count: usize) -> Vec<usize> {
    let count = count.min(candidates);
    let at = |k: usize| (k as f64 * (candidates - 1) as f64 / (count.max(2) - 1) as f64).round() as usize;
    (0..count).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A polynomial of degree `degree`, read anywhere on [−1, 1] with the same error.
    fn polynomial(degree: usize, candidates: usize, error: f64) -> DesignProblem {
        let names = (0..=degree).map(|k| format!("c{k}"));
        let parameters = names.map(|name| DesignParameter { name, known: 1e3, wanted: true }).collect();
        let at = |k: usize| -1.0 + 2.0 * k as f64 / (candidates - 1) as f64;
        let rows = (0..candidates).map(|k| (0..=degree as i32).map(|d| at(k).powi(d) / error).collect()).collect();
        let situations = vec![DesignSituation { values: vec![1.0; degree + 1], rows }];
        DesignProblem { aim: DesignAim::Parameters, parameters, situations, taken: Vec::new() }
    }

    /// A straight line is known best from its two ends (Elfving 1952); the error of the slope has a closed form.
    #[test]
    fn a_line_is_read_at_its_ends() {
        let line = polynomial(1, 41, 0.1);
        let best = line.choose(6).unwrap();
        assert!(best.chosen.iter().all(|k| *k < 3 || *k > 37), "{:?}", best.chosen);
        // Σ (x − mean)² of three at either end, and n.
        let at = |k: &usize| -1.0 + *k as f64 / 20.0;
        let mean = best.chosen.iter().map(at).sum::<f64>() / 6.0;
        let spread: f64 = best.chosen.iter().map(|k| (at(k) - mean).powi(2)).sum();
        assert!((best.errors[1] / (0.1 / spread.sqrt()) - 1.0).abs() < 1e-6, "{:?}", best.errors);
    }

    /// Every set of five of eleven is looked at: the exchange finds the best, and the bound is below it.
    #[test]
    fn no_set_is_better_and_the_bound_holds() {
        let parabola = polynomial(2, 11, 0.05);
        let found = parabola.choose(5).unwrap();
        let mut least = f64::INFINITY;
        for set in 0u32..1 << 11 {
            if set.count_ones() == 5 {
                let chosen: Vec<usize> = (0..11).filter(|k| set >> k & 1 == 1).collect();
                least = least.min(parabola.judge(&chosen).unwrap().ratio);
            }
        }
        assert!((found.ratio / least - 1.0).abs() < 1e-9, "{} {least}", found.ratio);
        let bound = parabola.best_possible(5).unwrap();
        assert!(bound <= least && bound > 0.9 * least, "{bound} {least}");
    }

    /// What is predicted of a line best is what its ends tell: the mean variance of predictions is that of Var(c0) +
    /// Var(c1) · mean x².
    #[test]
    fn predictions_of_a_line_have_the_variance_of_its_parameters() {
        let mut line = polynomial(1, 21, 0.1);
        line.aim = DesignAim::Predictions;
        let (all, some) =
            (line.covariance_of(0, &evenly(21, 21)).unwrap(), line.covariance_of(0, &[0, 10, 20]).unwrap());
        let mean_square = (0..21).map(|k| (f64::from(k) / 10.0 - 1.0).powi(2)).sum::<f64>() / 21.0;
        let variance = |v: &DMatrix<f64>| v[(0, 0)] + mean_square * v[(1, 1)];
        let expected = (variance(&some) / variance(&all)).sqrt();
        assert!((line.judge(&[0, 10, 20]).unwrap().ratio / expected - 1.0).abs() < 1e-6);
    }

    /// A parabola read as a line leaves what is orthogonal to the line: Σ (x² − mean x²)² where places are symmetric.
    #[test]
    fn a_line_leaves_the_bend_of_a_parabola() {
        let line = polynomial(1, 21, 0.1);
        let at = |k: usize| k as f64 / 10.0 - 1.0;
        let bent: Vec<Vec<f64>> = (0..21).map(|k| vec![at(k).powi(2) / 0.1]).collect();
        let all = evenly(21, 21);
        let mean = all.iter().map(|k| at(*k).powi(2)).sum::<f64>() / 21.0;
        let expected: f64 = all.iter().map(|k| ((at(*k).powi(2) - mean) / 0.1).powi(2)).sum();
        assert!((line.lack_of_fit(0, &all, &bent).unwrap() / expected - 1.0).abs() < 1e-5);
        assert!(line.lack_of_fit(0, &[0, 20], &bent).unwrap() < 1e-3);
    }

    /// Readings that are taken stay, and the others are chosen beside them.
    #[test]
    fn what_is_taken_stays() {
        let mut line = polynomial(1, 21, 0.1);
        line.taken = vec![0, 1, 2, 3];
        let best = line.choose(6).unwrap();
        assert!([0, 1, 2, 3, 19, 20].iter().all(|k| best.chosen.contains(k)), "{:?}", best.chosen);
    }

    /// A parameter that is not wanted is known as badly as it may be.
    #[test]
    fn only_what_is_wanted_counts() {
        let mut line = polynomial(1, 21, 0.1);
        line.parameters[1].wanted = false;
        line.parameters[1].known = 1e-3;
        // With a known slope every reading tells the constant as well as any other.
        let (best, even) = (line.choose(4).unwrap(), line.judge(&evenly(21, 4)).unwrap());
        assert!((best.ratio / even.ratio - 1.0).abs() < 1e-3, "{} {}", best.ratio, even.ratio);
    }
}
