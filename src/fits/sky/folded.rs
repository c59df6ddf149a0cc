//! The best fit. Preetham's integrals are divided by prefactors that have a closed form, and the rest is fitted with a
//! staircase of Chebyshev products: the higher the power of one variable, the fewer powers of the other.
//!
//! It is weighted least squares by QR at 24 × 12 Chebyshev nodes. The weight is the square root of the luminance's
//! prefactor: halfway between equal errors and the errors that a renderer sees.

use super::nodes::{self, lower};
use super::{Options, SkyFit, SkyFitForm};
use crate::record::FitPhase;
use mesophyll_base::chebyshev;
use mesophyll_base::solvers::{Termination, TraceRow, decomposition, qr};
use mesophyll_sky::polynomials::FoldedPolynomials;
use mesophyll_sky::polynomials::folding::{MOST_COLUMNS, MOST_ROWS, suns};
use mesophyll_sky::polynomials::mix::{ColourMix, OrderIndices, scaled_turbidity};
use mesophyll_sky::preetham::PreethamTurbidity;
use mesophyll_sky::projection::ProjectionQuality;
use nalgebra::{DMatrix, DVector};
use std::time::Instant;

/// Number of terms in each row of the staircase: 80 in all, which take 26,880 bytes in f32 at N = 7.
pub const COMPACT: [usize; 15] = [10, 9, 9, 8, 7, 7, 6, 5, 5, 4, 3, 3, 2, 1, 1];
/// The same with 124 terms: 41,664 bytes.
pub const FINE: [usize; 18] = [10, 10, 10, 9, 9, 9, 8, 8, 8, 7, 7, 6, 6, 5, 4, 3, 3, 2];

/// Fits with a given staircase (see [`FoldedPolynomials`]).
pub fn fit(options: &Options, rows: &[usize]) -> SkyFit {
    let clock = Instant::now();
    let (tall, wide) = (rows.len(), rows.iter().copied().max().unwrap_or(1));
    let (n_suns, n_turbid) = (24.max(tall + tall / 3), 12.max(wide + 2));
    let samples = nodes::sample(
        nodes::half(n_suns),
        nodes::turbidities(n_turbid, options.turbidities),
        options.bands,
        ProjectionQuality::Fit,
    );
    let sampled = clock.elapsed().as_secs_f64();

    let orders = OrderIndices::new(options.bands);
    let mix = ColourMix::new(options.turbidities);
    let terms: usize = rows.iter().sum();
    let m = n_suns * n_turbid;
    // The square root of the luminance's prefactor, scaled to 1 at its mean.
    let mut weights: Vec<f64> = Vec::with_capacity(m);
    for s in &samples.suns {
        weights.extend(samples.turbidities.iter().map(|t| PreethamTurbidity::new(*t).prefactors(*s)[0].sqrt()));
    }
    let mean = weights.iter().sum::<f64>() / m as f64;
    weights.iter_mut().for_each(|w| *w /= mean);

    let solve = |parity: usize| {
        let functions = if parity == 0 { &orders.even } else { &orders.odd };
        let design = design(rows, &samples.suns, &samples.turbidities, options.turbidities, parity, &weights);
        let mut right = Vec::with_capacity(m * 3 * functions.len());
        for c in 0..3 {
            for place in functions {
                let k = lower(*place);
                for (a, by_turbidity) in samples.values.iter().enumerate() {
                    right.extend(
                        by_turbidity.iter().enumerate().map(|(b, q)| weights[a * n_turbid + b] * mix.mixed(q[k])[c]),
                    );
                }
            }
        }
        least_squares(design, right, m, terms)
    };
    let (even, odd) = rayon::join(|| solve(0), || solve(1));
    // The order of the numbers before they become arrays: term by term, all functions of a term side by side.
    let arrange = |s: &Solved| {
        let functions = s.solution.len() / terms.max(1);
        let mut out = Vec::with_capacity(s.solution.len());
        for k in 0..terms {
            out.extend((0..functions).map(|f| s.solution[f * terms + k]));
        }
        out
    };
    let form = FoldedPolynomials::new(options.bands, options.turbidities, rows.to_vec(), arrange(&even), arrange(&odd));
    let total = clock.elapsed().as_secs_f64();
    let parts = [&even, &odd];
    let trace = parts
        .iter()
        .enumerate()
        .map(|(k, s)| TraceRow {
            iteration: k + 1,
            evaluations: samples.evaluations,
            elapsed_s: total,
            cost: 0.5 * s.squares,
            gradient: s.gradient,
            step: qr::length(&s.solution),
            truth_error: None,
        })
        .collect();
    let count = (m * 3 * (orders.even.len() + orders.odd.len())).max(1);
    SkyFit {
        options: options.clone(),
        model: "preetham".into(),
        termination: if form.is_ok() { Termination::Direct } else { Termination::NotFinite },
        remark: form.as_ref().err().cloned().unwrap_or_default(),
        form: form.ok().map(SkyFitForm::Folded),
        condition: even.condition.max(odd.condition),
        rank: even.rank.min(odd.rank),
        columns: terms,
        samples: count,
        rms: (parts.iter().map(|s| s.squares).sum::<f64>() / count as f64).sqrt(),
        worst: even.worst.max(odd.worst),
        trace,
        phases: vec![
            FitPhase { name: "integrate".into(), seconds: sampled },
            FitPhase { name: "solve".into(), seconds: total - sampled },
        ],
    }
}

/// Columns of the design matrix, one after another. Each runs over suns and, within a sun, over turbidities.
fn design(
    rows: &[usize],
    at_suns: &[f64],
    at_turbid: &[f64],
    range: [f64; 2],
    parity: usize,
    weights: &[f64],
) -> Vec<f64> {
    let columns: Vec<[f64; MOST_COLUMNS]> = at_turbid
        .iter()
        .map(|t| {
            let mut c = [0.0; MOST_COLUMNS];
            chebyshev::fill(scaled_turbidity(*t, range), 0, 1, &mut c);
            c
        })
        .collect();
    let tops: Vec<[f64; MOST_ROWS]> = at_suns
        .iter()
        .map(|s| {
            let (mut even, mut odd) = ([0.0; MOST_ROWS], [0.0; MOST_ROWS]);
            suns(*s, &mut even, &mut odd);
            if parity == 0 { even } else { odd }
        })
        .collect();
    let mut out = Vec::with_capacity(rows.iter().sum::<usize>() * weights.len());
    for (i, row) in rows.iter().enumerate() {
        for j in 0..*row {
            for (a, top) in tops.iter().enumerate() {
                out.extend(columns.iter().enumerate().map(|(b, c)| weights[a * columns.len() + b] * top[i] * c[j]));
            }
        }
    }
    out
}

/// The result of least squares with many right sides.
pub(super) struct Solved {
    /// One function after another.
    pub solution: Vec<f64>,
    pub squares: f64,
    pub worst: f64,
    /// Largest component of Aᵀr.
    pub gradient: f64,
    pub condition: f64,
    pub rank: usize,
}

/// min |A x − b| for each column b of `right`; `a` has m rows and n columns.
pub(super) fn least_squares(a: Vec<f64>, right: Vec<f64>, m: usize, n: usize) -> Solved {
    let k = right.len() / m;
    let mut both = a.clone();
    both.extend_from_slice(&right);
    // The right sides are appended as further columns: after n reflections their first n rows are Qᵀb.
    qr::reduce(&mut both, m, n + k, &mut vec![0.0; m]);
    let triangle = DMatrix::from_fn(n, n, |i, j| if i <= j { both[j * m + i] } else { 0.0 });
    let sigma = decomposition::singular_values(triangle.clone()).unwrap_or_else(|| DVector::zeros(n));
    let limit = m as f64 * f64::EPSILON * sigma.max();
    let rank = sigma.iter().filter(|s| **s > limit).count();
    let mut out = Solved {
        solution: Vec::with_capacity(n * k),
        squares: 0.0,
        worst: 0.0,
        gradient: 0.0,
        condition: if rank == n { sigma.max() / sigma.min() } else { f64::INFINITY },
        rank,
    };
    let mut residual = vec![0.0; m];
    for f in 0..k {
        let x = qr::solve_upper(&both[..n * m], m, n, &both[(n + f) * m..][..n]);
        residual.copy_from_slice(&right[f * m..(f + 1) * m]);
        for (column, x) in a.chunks_exact(m).zip(&x) {
            residual.iter_mut().zip(column).for_each(|(r, v)| *r -= v * x);
        }
        out.squares += residual.iter().map(|r| r * r).sum::<f64>();
        out.worst = residual.iter().fold(out.worst, |w, r| w.max(r.abs()));
        for column in a.chunks_exact(m) {
            out.gradient = out.gradient.max(column.iter().zip(&residual).map(|(v, r)| v * r).sum::<f64>().abs());
        }
        out.solution.extend(x);
    }
    out
}
