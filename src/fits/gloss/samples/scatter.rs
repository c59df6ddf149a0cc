//! What the scatter of the residuals says: how the noise grows with the reading, whether the readings of one direction
//! share errors, and the standard errors that follow.
//!
//! Residuals of one direction are turned into their common part (sum over columns/√count) and contrasts between the
//! columns (Helmert's). The gloss is grey, so slope, normal and ρs come from the common parts alone, and a wrong lobe
//! shows in the common parts alone. For independent readings of equal noise both have the same variance.

use super::GlossSample;
use super::search::{Point, Problem, Solved};
use mesophyll_base::solvers::adequacy::normal_quantile;
use nalgebra::DMatrix;

/// A gain of the log-likelihood by this much makes a noise that grows with the reading worth its parameter.
const GROWS: f64 = 5.0;
/// A common noise of the columns of one direction is believed when equal noise gives it this seldom.
const SHARED: f64 = 1e-3;

/// Residuals of one kind and their derivatives, in the order of the directions.
#[derive(Debug, Clone, Default)]
pub(super) struct Part {
    /// (measured − computed) · √weight, turned.
    pub r: Vec<f64>,
    /// A row a residual: ∂residual/∂parameter.
    pub rows: Vec<Vec<f64>>,
    /// The sample of each residual.
    pub sample: Vec<usize>,
    /// Which of its direction's contrasts each residual is; 0 for a common part.
    pub which: Vec<usize>,
    /// How many parameters this part alone determines.
    pub rank: usize,
}

impl Part {
    /// The derivatives, column by column.
    pub fn jacobian(&self) -> Vec<f64> {
        let n = self.rows.first().map_or(0, Vec::len);
        (0..n).flat_map(|j| self.rows.iter().map(move |row| row[j])).collect()
    }

    pub fn freedom(&self) -> usize {
        self.r.len().saturating_sub(self.rank)
    }

    pub fn sum(&self) -> f64 {
        self.r.iter().map(|r| r * r).sum()
    }

    fn normal(&self, n: usize) -> DMatrix<f64> {
        let jacobian = DMatrix::from_fn(self.rows.len(), n, |i, j| self.rows[i][j]);
        jacobian.transpose() * jacobian
    }
}

/// A fit at a point with all its residuals. Parameters: ρd of each column, ρs, then the fitted components of the point.
#[derive(Debug, Clone)]
pub(super) struct Residuals {
    pub p: Point,
    pub solved: Solved,
    /// Components of the point that are fitted.
    pub live: Vec<usize>,
    pub common: Part,
    pub contrasts: Part,
    /// Residuals as they were read: raw residual, computed value, leverage, sample and column.
    pub plain: Vec<Plain>,
    pub covariance: DMatrix<f64>,
    /// Residuals' log-likelihood with the variance at its best, from the common parts.
    pub likelihood: f64,
}

/// One reading.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plain {
    pub residual: f64,
    pub computed: f64,
    pub leverage: f64,
    pub weight: f64,
    pub sample: usize,
    pub column: usize,
}

impl Residuals {
    /// `floor`: residuals below it are rounding.
    pub fn at(problem: &Problem, p: &Point, floor: f64) -> Residuals {
        let (column, solved, live) = (problem.column(p), problem.at(p), problem.live());
        let changes: Vec<Vec<f64>> = live.iter().map(|&k| problem.change(p, k)).collect();
        let (bands, n) = (problem.bands, problem.bands + 1 + live.len());
        let (mut common, mut contrasts) = (Part::default(), Part::default());
        let mut plain = Vec::new();
        let mut rows_of_plain: Vec<Vec<f64>> = Vec::new();
        let mut weights_logs = 0.0;
        for (i, sample) in problem.samples.iter().enumerate() {
            let mut here: Vec<(f64, Vec<f64>)> = Vec::new();
            let mut logs = 0.0;
            for (k, v) in sample.values.iter().enumerate() {
                let w = problem.weights[i * bands + k];
                if w <= 0.0 {
                    continue;
                }
                let computed = solved.rho_d[k] + solved.rho_s * column[i];
                let root = w.sqrt();
                let mut row = vec![0.0; n];
                row[k] = -root;
                row[bands] = -root * column[i];
                for (cell, change) in row[bands + 1..].iter_mut().zip(&changes) {
                    *cell = -root * solved.rho_s * change[i];
                }
                plain.push(Plain { residual: v - computed, computed, leverage: 0.0, weight: w, sample: i, column: k });
                rows_of_plain.push(row.clone());
                here.push((root * (v - computed), row));
                logs += 0.5 * w.ln();
            }
            if !here.is_empty() {
                weights_logs += logs / here.len() as f64;
            }
            turn(&here, i, &mut common, &mut contrasts);
        }
        (common.rank, contrasts.rank) = (2 + live.len(), bands - 1);
        let count = common.r.len() as f64;
        let sum = common.sum().max(count * floor * floor);
        let mut out = Residuals {
            p: *p,
            solved,
            likelihood: weights_logs - 0.5 * count * (sum / count).ln(),
            live,
            common,
            contrasts,
            plain,
            covariance: DMatrix::from_element(n, n, f64::INFINITY),
        };
        out.spread(n, &rows_of_plain);
        out
    }

    /// Covariance and leverages.
    fn spread(&mut self, n: usize, rows: &[Vec<f64>]) {
        let parts = [self.common.normal(n), self.contrasts.normal(n)];
        let whole = &parts[0] + &parts[1];
        let scale: Vec<f64> = (0..n).map(|k| whole[(k, k)].sqrt()).collect();
        let live: Vec<usize> = (0..n).filter(|&k| scale[k] > 0.0).collect();
        let scaled = |a: &DMatrix<f64>| {
            DMatrix::from_fn(live.len(), live.len(), |i, j| a[(live[i], live[j])] / (scale[live[i]] * scale[live[j]]))
        };
        let Some(inverse) = scaled(&whole).cholesky().map(|c| c.inverse()) else { return };
        for (at, row) in self.plain.iter_mut().zip(rows) {
            let row = nalgebra::DVector::from_iterator(live.len(), live.iter().map(|&k| row[k] / scale[k]));
            at.leverage = (row.dot(&(&inverse * &row))).clamp(0.0, 1.0);
        }
        let [a, b] = self.variances();
        let cov = &inverse * (a * scaled(&parts[0]) + b * scaled(&parts[1])) * &inverse;
        for (i, &k) in live.iter().enumerate() {
            for (j, &l) in live.iter().enumerate() {
                self.covariance[(k, l)] = cov[(i, j)] / (scale[k] * scale[l]);
            }
        }
    }

    /// Variance of common parts and of contrasts: one for both, unless the columns of a direction share errors.
    pub fn variances(&self) -> [f64; 2] {
        let (a, b) = (&self.common, &self.contrasts);
        let (fa, fb) = (a.freedom() as f64, b.freedom() as f64);
        // With fewer directions than parameters, the columns hold each other: one variance is all that can be told.
        let pooled = (a.sum() + b.sum()) / (self.plain.len() as f64 - a.rank as f64 - b.rank as f64).max(1.0);
        if fa < 1.0 || fb < 1.0 {
            return [pooled; 2];
        }
        let ratio = (a.sum() / fa) / (b.sum() / fb);
        if f_score(ratio, fa, fb) > normal_quantile(SHARED) { [a.sum() / fa, b.sum() / fb] } else { [pooled; 2] }
    }

    /// Standard error of parameter `k`; infinite where it is not determined.
    pub fn error(&self, k: usize) -> f64 {
        let variance = self.covariance[(k, k)];
        if variance >= 0.0 { variance.sqrt() } else { f64::INFINITY }
    }

    /// Weights for a noise whose standard deviation is proportional to √(1 + (growth · value)²), and how much the
    /// log-likelihood gains by it; `None` where it gains too little to be believed.
    pub fn growth(&self) -> Option<f64> {
        let free: Vec<(f64, f64)> = self
            .plain
            .iter()
            .map(|r| (r.residual.powi(2) / (1.0 - r.leverage).max(0.1), r.computed.max(0.0)))
            .collect();
        let n = free.len() as f64;
        let likelihood = |growth: f64| {
            let weight = |v: f64| 1.0 / (1.0 + (growth * v).powi(2));
            let sum: f64 = free.iter().map(|(u, v)| u * weight(*v)).sum();
            0.5 * free.iter().map(|(_, v)| weight(*v).ln()).sum::<f64>() - 0.5 * n * (sum / n).ln()
        };
        let values: Vec<f64> = free.iter().map(|f| f.1).filter(|v| *v > 0.0).collect();
        let (least, most) = values.iter().fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(*v), b.max(*v)));
        if !(most > least) {
            return None;
        }
        // From a noise that doubles nowhere to one that is proportional to the value nearly everywhere.
        let (from, to) = ((0.3 / most).ln(), (5.0 / least).ln());
        let tried = (0..=32).map(|k| (from + (to - from) * f64::from(k) / 32.0).exp());
        let best =
            tried.map(|g| (likelihood(g), g)).fold((f64::NEG_INFINITY, 0.0), |a, b| if b.0 > a.0 { b } else { a });
        (best.0 - likelihood(0.0) > GROWS).then_some(best.1)
    }
}

/// Adds the common part and the contrasts of one direction's residuals.
fn turn(here: &[(f64, Vec<f64>)], sample: usize, common: &mut Part, contrasts: &mut Part) {
    let Some((first, rest)) = here.split_first() else { return };
    let mut sum = first.clone();
    let add = |part: &mut Part, which: usize, r: f64, row: Vec<f64>| {
        part.which.push(which);
        part.r.push(r);
        part.rows.push(row);
        part.sample.push(sample);
    };
    for (j, (r, row)) in rest.iter().enumerate() {
        let before = (j + 1) as f64;
        let length = (before * (before + 1.0)).sqrt();
        let turned = sum.1.iter().zip(row).map(|(s, x)| (s - before * x) / length).collect();
        add(contrasts, j, (sum.0 - before * r) / length, turned);
        sum.0 += r;
        sum.1.iter_mut().zip(row).for_each(|(s, x)| *s += x);
    }
    let root = (here.len() as f64).sqrt();
    add(common, 0, sum.0 / root, sum.1.iter().map(|s| s / root).collect());
}

/// Normal score of a ratio of variances with these degrees of freedom (E. Paulson, Ann. Math. Stat. 13 (1942),
/// 233–235).
fn f_score(ratio: f64, over: f64, under: f64) -> f64 {
    let (u, v) = (2.0 / (9.0 * over), 2.0 / (9.0 * under));
    ((1.0 - v) * ratio.cbrt() - (1.0 - u)) / (u + v * ratio.cbrt().powi(2)).sqrt()
}

/// The unit in which the readings of a table were rounded: the largest power of ten that all are multiples of, 1e-9 at
/// the least; 0 where they have more digits.
pub(super) fn rounding(samples: &[GlossSample]) -> f64 {
    let values = || samples.iter().flat_map(|s| &s.values).filter(|v| v.is_finite());
    let whole = |unit: f64| values().all(|v| ((v / unit) - (v / unit).round()).abs() < 1e-4);
    (0..=9).map(|k| 10f64.powi(-k)).find(|unit| whole(*unit)).unwrap_or(0.0)
}
