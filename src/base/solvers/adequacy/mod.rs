//! Whether a model describes what was measured: the one rule for lack of fit, which every fit uses.
//!
//! A fit's standard errors hold only where the model is right and the residuals are noise. Two things betray a wrong
//! model:
//!
//! - χ² is larger than its own spread allows. Where the noise is only estimated from the scatter, χ² says nothing.
//! - The residuals follow a pattern along an order that the measurement has (wavelength, angle, time, place):
//!   neighbours agree, or slow waves explain too much of the scatter. Noise has no pattern.
//!
//! Both are compared with what noise alone gives after as many parameters were fitted, so a right model with few
//! readings is not accused ([`pattern`]). A pattern is compared with the residuals' own scatter, so a noise that is
//! only understated is not taken for one. The tests of one fit together accuse a right model in one case of a thousand.
//!
//! Where a test fails, the standard errors are widened by the residuals' own covariance ([`correlated`]), and the fit
//! says that the model does not describe the readings. A χ² that is too small under a stated noise is no fault of the
//! model: the noise is overstated, and the errors are too large rather than too small.

// A comparison with NaN is false, so `!(a < b)` is written where NaN must fail.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod correlated;
mod pattern;
#[cfg(test)]
mod tests;

use crate::error::Status;
use crate::solvers::{ResidualNoise, decomposition};
use nalgebra::DMatrix;

/// Several readings in an order in which a wrong model leaves a pattern.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReadingOrder {
    /// What the order is along, as a sentence names it: `wavelength`, `position`, `time`.
    pub name: &'static str,
    /// Indices of residuals, each run in its order. Readings that do not follow one another (reflectance and
    /// transmittance, two channels) are runs of their own. A residual may be in no run.
    pub runs: Vec<Vec<usize>>,
}

impl ReadingOrder {
    /// One run that holds the residuals in the order of `key`, one number a residual.
    pub fn sorted(name: &'static str, key: &[f64]) -> ReadingOrder {
        let mut run: Vec<usize> = (0..key.len()).collect();
        run.sort_by(|a, b| key[*a].total_cmp(&key[*b]));
        ReadingOrder { name, runs: vec![run] }
    }
}

/// What is judged: the residuals of a fit at its solution.
#[derive(Debug, Clone, Copy)]
pub struct SolutionResiduals<'a> {
    /// Residuals in units of their standard errors: of the true ones where the noise is known, of their relative sizes
    /// where it is estimated.
    pub residuals: &'a [f64],
    /// ∂residual/∂parameter, column by column (`m` rows, entry `i` of column `j` at `j·m + i`).
    pub jacobian: &'a [f64],
    /// Whether the standard errors are known.
    pub noise: ResidualNoise,
    /// Root mean square of residuals, in their units, below which they are rounding or the model's own precision and
    /// are not judged.
    pub floor: f64,
    /// The orders in which patterns are looked for.
    pub along: &'a [ReadingOrder],
}

/// What made the model doubtful.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Finding {
    /// χ² is too large: the residuals are this many times the noise.
    Excess(f64),
    /// Residuals that follow one another agree; holds the order's name and the correlation of neighbours.
    Neighbours(&'static str, f64),
    /// Slow waves along the order explain this share of the scatter.
    Slow(&'static str, f64),
    /// A residual is no number.
    NotFinite,
}

/// How well a model describes its readings.
#[derive(Debug, Clone, PartialEq)]
pub struct Adequacy {
    /// Σ r².
    pub chi2: f64,
    /// Residuals less rank.
    pub freedom: usize,
    /// What failed; nothing where the model describes the readings.
    pub findings: Vec<Finding>,
    /// Factor, 1 or more, by which each parameter's standard error has to be multiplied; 1 where nothing failed.
    pub widening: Vec<f64>,
    /// Whether χ² is smaller than the stated noise allows: the noise is overstated or the readings are not independent.
    pub overstated: bool,
}

/// The tests of one fit together accuse a right model this often.
pub const ACCUSED: f64 = 1e-3;
/// Where χ² over its degrees of freedom is below this although the noise is stated, the readings agree with the model
/// far within their noise, and patterns in them are rounding.
const WITHIN: f64 = 0.1;
/// A direction of the parameters whose scaled singular value is below this times the largest is not determined.
const RANK: f64 = 1e-9;

/// Judges a fit.
pub fn judge(readings: &SolutionResiduals) -> Adequacy {
    let r = readings.residuals;
    let m = r.len();
    let n = readings.jacobian.len().checked_div(m).unwrap_or(0);
    let chi2: f64 = r.iter().map(|v| v * v).sum();
    let mut out = Adequacy { chi2, freedom: m, findings: Vec::new(), widening: vec![1.0; n], overstated: false };
    let Some(basis) = Basis::new(readings.jacobian, m, n).filter(|_| chi2.is_finite()) else {
        out.findings.push(Finding::NotFinite);
        return out;
    };
    out.freedom = m.saturating_sub(basis.q.ncols());
    if out.freedom == 0 || !(chi2 > m as f64 * readings.floor.powi(2)) {
        return out;
    }
    let reduced = chi2 / out.freedom as f64;
    let known = readings.noise == ResidualNoise::Known;
    let tests = 2 * readings.along.len() + usize::from(known);
    let limit = normal_quantile(ACCUSED / tests.max(1) as f64);
    if known {
        let z = chi2_score(chi2, out.freedom as f64);
        out.overstated = z < -limit;
        if z > limit {
            out.findings.push(Finding::Excess(reduced.sqrt()));
        }
    }
    if !known || reduced > WITHIN {
        for along in readings.along {
            let [neighbours, slow] = pattern::scores(r, &basis.q, &along.runs, out.freedom);
            if neighbours.score > limit {
                out.findings.push(Finding::Neighbours(along.name, neighbours.share));
            }
            if slow.score > limit {
                out.findings.push(Finding::Slow(along.name, slow.share));
            }
        }
    }
    if !out.findings.is_empty() {
        let base = if known { 1.0 } else { reduced };
        let whole = (0..m).map(|k| vec![k]).collect::<Vec<_>>();
        let runs = readings.along.iter().map(|a| &a.runs).chain([&whole]);
        for widened in runs.map(|runs| correlated::variances(r, &basis, runs)) {
            for (factor, (wide, plain)) in out.widening.iter_mut().zip(widened.iter().zip(&basis.variances)) {
                let ratio = (wide / (base * plain)).sqrt();
                *factor = factor.max(if ratio.is_nan() { 1.0 } else { ratio });
            }
        }
    }
    out
}

impl Adequacy {
    /// Whether all tests passed.
    pub fn describes(&self) -> bool {
        self.findings.is_empty()
    }

    /// Why the model does not describe `what` (`branch`, `leaf`), as a sentence without an end; `None` where it does.
    pub fn why(&self, what: &str) -> Option<String> {
        if self.describes() {
            return None;
        }
        let said: Vec<String> = self.findings.iter().map(Finding::words).collect();
        Some(format!("the model does not describe this {what}: {}", said.join(", and ")))
    }

    /// The status of a fit whose values have these names: that none of them can be relied on, and why; `None` where the
    /// model describes the readings.
    pub fn status(&self, names: &[&str], what: &str) -> Option<Status> {
        self.why(what).map(|why| Status::undetermined(names, &why))
    }
}

impl Finding {
    fn words(&self) -> String {
        match self {
            Finding::Excess(times) => format!("the residuals are {} times the noise", short(*times)),
            Finding::Neighbours(name, by) => {
                format!("residuals next to each other along the {name} agree (correlation {by:.2})")
            }
            Finding::Slow(name, share) => {
                format!("slow waves along the {name} make {:.0} % of the residuals' scatter", 100.0 * share)
            }
            Finding::NotFinite => "a residual is no number".into(),
        }
    }
}

/// A factor with about two digits.
fn short(x: f64) -> String {
    if x < 9.95 { format!("{x:.1}") } else { format!("{x:.0}") }
}

/// What the Jacobian spans.
struct Basis {
    /// Orthonormal columns, m × rank.
    q: DMatrix<f64>,
    /// The pseudo-inverse of the Jacobian, transposed: m × n. Zero columns where a parameter is not determined.
    inverse: DMatrix<f64>,
    /// Diagonal of (JᵀJ)⁻¹ on what is determined.
    variances: Vec<f64>,
}

impl Basis {
    fn new(jacobian: &[f64], m: usize, n: usize) -> Option<Basis> {
        if n == 0 || m == 0 {
            return (jacobian.is_empty()).then(|| Basis {
                q: DMatrix::zeros(m, 0),
                inverse: DMatrix::zeros(m, 0),
                variances: Vec::new(),
            });
        }
        let mut scaled = DMatrix::from_column_slice(m, n, &jacobian[..m * n]);
        let lengths: Vec<f64> = scaled.column_iter().map(|c| c.norm()).map(|l| if l > 0.0 { l } else { 1.0 }).collect();
        for (mut column, length) in scaled.column_iter_mut().zip(&lengths) {
            column /= *length;
        }
        let svd = decomposition::svd(scaled)?;
        let (u, vt, s) = (svd.u?, svd.v_t?, svd.singular_values);
        let largest = s.iter().copied().fold(0.0, f64::max);
        let kept: Vec<usize> = (0..s.len()).filter(|k| s[*k] > RANK * largest && s[*k] > 0.0).collect();
        let q = u.select_columns(&kept);
        let inverse = DMatrix::from_fn(m, n, |i, j| {
            kept.iter().map(|&k| u[(i, k)] * vt[(k, j)] / s[k]).sum::<f64>() / lengths[j]
        });
        let variances = inverse.column_iter().map(|c| c.norm_squared()).collect();
        Some(Basis { q, inverse, variances })
    }
}

/// How many standard deviations χ² lies from what `freedom` degrees of freedom expect, as a number that is normally
/// distributed (E. B. Wilson, M. M. Hilferty, "The distribution of chi-square", PNAS 17 (1931), 684–688; good to a few
/// hundredths from 3 degrees on). Positive where χ² is too large.
pub fn chi2_score(chi2: f64, freedom: f64) -> f64 {
    let spread = 2.0 / (9.0 * freedom);
    ((chi2 / freedom).cbrt() - (1.0 - spread)) / spread.sqrt()
}

/// The number that a normally distributed one exceeds with probability `p`, for `p` below a half; good to 5e-4
/// (M. Abramowitz, I. A. Stegun, "Handbook of Mathematical Functions", 26.2.23).
pub fn normal_quantile(p: f64) -> f64 {
    let t = (-2.0 * p.ln()).sqrt();
    let top = 2.515_517 + t * (0.802_853 + t * 0.010_328);
    let bottom = 1.0 + t * (1.432_788 + t * (0.189_269 + t * 0.001_308));
    t - top / bottom
}
