//! Fits without knowledge of the sky, with products of two polynomial bases: the dissertation's monomials (Habel 2009
//! Eq. 5.1) or Chebyshev polynomials.
//!
//! On a product grid the design matrix is a Kronecker product Θ ⊗ T, and so are its QR factors. So the matrix of
//! 250,000 × 112 is never formed. The weakness of the dissertation's choice still shows: the condition number of the
//! product is the product of the two, and the normal equations square it.

use super::nodes;
use super::{Options, SkyFit, SkyFitForm, SkyFitMethod};
use crate::record::FitPhase;
use mesophyll_base::solvers::{Termination, TraceRow};
use mesophyll_sky::SkyFamily;
use mesophyll_sky::polynomials::tensor::{self, PolynomialBasis, PolynomialTensor};
use mesophyll_sky::projection::{ProjectionQuality, ProjectionRule};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::f64::consts::FRAC_PI_2;
use std::time::Instant;

/// Nodes of [`SkyFitMethod::Chebyshev`]: suns and turbidities.
const NODES: [usize; 2] = [24, 12];

/// Coefficients of all functions (channel by channel, l(l+1)/2 + m) at every sun, for one turbidity.
type Column = Vec<f64>;

/// Fits by the options' method. A model other than Preetham's is fitted at nodes only.
pub fn fit(options: &Options, model: &dyn SkyFamily) -> SkyFit {
    let clock = Instant::now();
    let basis = match options.method {
        SkyFitMethod::MonomialsQr | SkyFitMethod::MonomialsNormal => PolynomialBasis::Monomials,
        _ => PolynomialBasis::Chebyshev,
    };
    let at_nodes = options.method == SkyFitMethod::Chebyshev;
    let (suns, turbidities, columns, evaluations) = if at_nodes {
        let suns: Vec<f64> = nodes::whole(NODES[0].max(options.degrees[0] + 4), [0.0, FRAC_PI_2]);
        let turbidities = nodes::whole(NODES[1].max(options.degrees[1] + 3), options.turbidities);
        let (columns, evaluations) = by_integration(model, &suns, &turbidities, options.bands);
        (suns, turbidities, columns, evaluations)
    } else {
        let even =
            |low: f64, high: f64, k: usize| (low + (high - low) * k as f64 / (options.grid - 1) as f64).min(high);
        let suns: Vec<f64> = (0..options.grid).map(|k| even(0.0, FRAC_PI_2, k)).collect();
        let turbidities: Vec<f64> =
            (0..options.grid).map(|k| even(options.turbidities[0], options.turbidities[1], k)).collect();
        match by_interpolation(&suns, &turbidities, options) {
            Ok(columns) => (suns, turbidities, Ok(columns), 0),
            Err(why) => (suns, turbidities, Err(why), 0),
        }
    };
    let sampled = clock.elapsed().as_secs_f64();
    let powers = options.degrees.map(|d| d + 1);
    let matrix = |at: &[f64], range: [f64; 2], n: usize| {
        let mut m = DMatrix::zeros(at.len(), n);
        let mut row = vec![0.0; n];
        for (i, x) in at.iter().enumerate() {
            tensor::fill(basis, *x, range, &mut row);
            (0..n).for_each(|j| m[(i, j)] = row[j]);
        }
        m
    };
    let theta = matrix(&suns, [0.0, FRAC_PI_2], powers[0]);
    let tau = matrix(&turbidities, options.turbidities, powers[1]);
    let n = powers[0] * powers[1];
    let mut fitted = SkyFit {
        options: options.clone(),
        model: model.name().into(),
        form: None,
        termination: Termination::Refused,
        remark: String::new(),
        condition: f64::INFINITY,
        rank: 0,
        columns: n,
        samples: suns.len() * turbidities.len() * 3 * options.bands * (options.bands + 1) / 2,
        rms: f64::NAN,
        worst: f64::NAN,
        trace: Vec::new(),
        phases: vec![FitPhase { name: "integrate".into(), seconds: sampled }],
    };
    let columns = match columns {
        Ok(columns) => columns,
        Err(why) => return SkyFit { remark: why, ..fitted },
    };
    // The singular values of a Kronecker product are the products of the factors' singular values.
    let (a, b) = (theta.singular_values(), tau.singular_values());
    let values: Vec<f64> = a.iter().flat_map(|x| b.iter().map(move |y| x * y)).collect();
    let (largest, smallest) = values.iter().fold((0.0f64, f64::INFINITY), |(l, s), v| (l.max(*v), s.min(*v)));
    fitted.condition = largest / smallest;
    fitted.rank = values.iter().filter(|v| **v > largest * f64::EPSILON * n as f64).count();

    let solved = if options.method == SkyFitMethod::MonomialsNormal {
        normal_equations(&theta, &tau, &columns)
    } else {
        Ok(by_qr(&theta, &tau, &columns))
    };
    let total = clock.elapsed().as_secs_f64();
    fitted.phases.push(FitPhase { name: "solve".into(), seconds: total - sampled });
    match solved {
        Err(why) => fitted.remark = why,
        Ok(solution) => {
            let width = solution.first().map_or(0, Vec::len);
            let (squares, worst, gradient) = residual(&theta, &tau, &columns, &solution);
            fitted.rms = (squares / fitted.samples as f64).sqrt();
            fitted.worst = worst;
            fitted.trace = vec![TraceRow {
                iteration: 1,
                evaluations,
                elapsed_s: total,
                cost: 0.5 * squares,
                gradient,
                step: solution.iter().flatten().map(|v| v * v).sum::<f64>().sqrt(),
                truth_error: None,
            }];
            let form = PolynomialTensor::new(basis, options.bands, options.turbidities, powers, solution.concat());
            debug_assert_eq!(width, 3 * options.bands * (options.bands + 1) / 2);
            match form {
                Ok(form) if form.values().iter().all(|v| v.is_finite()) => {
                    fitted.form = Some(SkyFitForm::Tensor(form));
                    fitted.termination = Termination::Direct;
                }
                Ok(_) => fitted.termination = Termination::NotFinite,
                Err(why) => fitted.remark = why,
            }
            if fitted.rank < n {
                fitted.remark = format!("rank {} of {n}: the terms are not determined one by one", fitted.rank);
            }
        }
    }
    fitted
}

/// Integrates a black-box model at every node.
fn by_integration(
    model: &dyn SkyFamily,
    suns: &[f64],
    turbidities: &[f64],
    bands: usize,
) -> (Result<Vec<Column>, String>, usize) {
    // Evaluations of the model, and the coefficients for each turbidity.
    type Row = (usize, Vec<Vec<f64>>);
    let size = bands * (bands + 1) / 2;
    let rows: Vec<Result<Row, String>> = suns
        .par_iter()
        .map(|s| {
            let rule = ProjectionRule::new(*s, bands, ProjectionQuality::Fit);
            let at = |t: &f64| -> Result<Vec<f64>, String> {
                let c = rule.project(model.sky(*s, *t).map_err(|e| e.to_string())?.as_ref());
                let mut out = vec![0.0; 3 * size];
                for l in 0..bands {
                    for m in 0..=l {
                        (0..3).for_each(|k| out[k * size + l * (l + 1) / 2 + m] = c.get(l, m as isize)[k]);
                    }
                }
                Ok(out)
            };
            Ok((rule.evaluations() * turbidities.len(), turbidities.iter().map(at).collect::<Result<_, _>>()?))
        })
        .collect();
    let mut columns = vec![vec![0.0; suns.len() * 3 * size]; turbidities.len()];
    let mut evaluations = 0;
    for (i, row) in rows.into_iter().enumerate() {
        match row {
            Ok((count, values)) => {
                evaluations += count;
                for (j, v) in values.iter().enumerate() {
                    columns[j][i * 3 * size..(i + 1) * 3 * size].copy_from_slice(v);
                }
            }
            Err(why) => return (Err(why), evaluations),
        }
    }
    (Ok(columns), evaluations)
}

/// Fills a dense grid of Preetham's skies from the interpolant of [`nodes::dense`].
fn by_interpolation(suns: &[f64], turbidities: &[f64], options: &Options) -> Result<Vec<Column>, String> {
    let dense = nodes::dense(options.bands, options.turbidities)?;
    let size = options.bands * (options.bands + 1) / 2;
    let places: Vec<(usize, usize)> =
        (0..options.bands).flat_map(|l| (0..=l).map(move |m| (l * (l + 1) + m, l * (l + 1) / 2 + m))).collect();
    turbidities
        .par_iter()
        .map(|t| {
            let fixed = dense.at(*t).map_err(|e| e.to_string())?;
            let mut out = vec![0.0; suns.len() * 3 * size];
            let mut all = vec![[0.0; 3]; options.bands * options.bands];
            for (s, row) in suns.iter().zip(out.chunks_exact_mut(3 * size)) {
                fixed.fill(*s, &mut all);
                for (from, to) in &places {
                    (0..3).for_each(|k| row[k * size + to] = all[*from][k]);
                }
            }
            Ok(out)
        })
        .collect()
}

/// Orthonormal columns and the triangle, by Gram–Schmidt done twice, which is as orthogonal as reflections.
fn orthogonal(a: &DMatrix<f64>) -> (DMatrix<f64>, DMatrix<f64>) {
    let n = a.ncols();
    let (mut q, mut r) = (a.clone(), DMatrix::zeros(n, n));
    for j in 0..n {
        for _ in 0..2 {
            for i in 0..j {
                let dot = q.column(i).dot(&q.column(j));
                r[(i, j)] += dot;
                let column = q.column(i).clone_owned();
                q.column_mut(j).axpy(-dot, &column, 1.0);
            }
        }
        let length = q.column(j).norm();
        r[(j, j)] = length;
        if length > 0.0 {
            q.column_mut(j).unscale_mut(length);
        }
    }
    (q, r)
}

/// The products of left ⊗ right with the samples: for each i and each j, all functions.
fn project(left: &DMatrix<f64>, right: &DMatrix<f64>, columns: &[Column]) -> Vec<Vec<f64>> {
    let (m, n) = (left.nrows(), left.ncols());
    let width = columns.first().map_or(0, |c| c.len() / m);
    let partial: Vec<Vec<f64>> = columns
        .par_iter()
        .map(|column| {
            let mut out = vec![0.0; n * width];
            for (a, row) in column.chunks_exact(width).enumerate() {
                for (i, to) in out.chunks_exact_mut(width).enumerate() {
                    let w = left[(a, i)];
                    to.iter_mut().zip(row).for_each(|(t, v)| *t += w * v);
                }
            }
            out
        })
        .collect();
    let mut out = vec![vec![0.0; width]; n * right.ncols()];
    for (b, part) in partial.iter().enumerate() {
        for i in 0..n {
            for j in 0..right.ncols() {
                let w = right[(b, j)];
                out[i * right.ncols() + j]
                    .iter_mut()
                    .zip(&part[i * width..(i + 1) * width])
                    .for_each(|(t, v)| *t += w * v);
            }
        }
    }
    out
}

/// QR of the product. Its triangle is Rθ ⊗ Rτ, which is itself a triangle, solved from the last column to the first.
fn by_qr(theta: &DMatrix<f64>, tau: &DMatrix<f64>, columns: &[Column]) -> Vec<Vec<f64>> {
    let ((q1, r1), (q2, r2)) = (orthogonal(theta), orthogonal(tau));
    let mut x = project(&q1, &q2, columns);
    let triangle = r1.kronecker(&r2);
    let n = x.len();
    for k in (0..n).rev() {
        let (above, rest) = x.split_at_mut(k);
        let pivot = triangle[(k, k)];
        rest[0].iter_mut().for_each(|v| *v /= pivot);
        for (i, row) in above.iter_mut().enumerate() {
            let w = triangle[(i, k)];
            if w != 0.0 {
                row.iter_mut().zip(&rest[0]).for_each(|(t, v)| *t -= w * v);
            }
        }
    }
    x
}

/// Solves by the Gram matrix and its Cholesky factor.
fn normal_equations(theta: &DMatrix<f64>, tau: &DMatrix<f64>, columns: &[Column]) -> Result<Vec<Vec<f64>>, String> {
    let gram = (theta.transpose() * theta).kronecker(&(tau.transpose() * tau));
    let right = project(theta, tau, columns);
    let Some(factor) = gram.cholesky() else {
        return Err(
            "the Gram matrix is not positive definite in f64: the square of the condition number is beyond its digits"
                .into(),
        );
    };
    let width = right.first().map_or(0, Vec::len);
    let mut out = vec![vec![0.0; width]; right.len()];
    for f in 0..width {
        let x = factor.solve(&DVector::from_fn(right.len(), |k, _| right[k][f]));
        (0..right.len()).for_each(|k| out[k][f] = x[k]);
    }
    Ok(out)
}

/// Sum of squares, largest residual, and largest component of the gradient.
fn residual(theta: &DMatrix<f64>, tau: &DMatrix<f64>, columns: &[Column], x: &[Vec<f64>]) -> (f64, f64, f64) {
    let width = x.first().map_or(0, Vec::len);
    let left: Vec<Column> = columns
        .par_iter()
        .enumerate()
        .map(|(b, column)| {
            // Polynomials in θs alone, at this turbidity.
            let mut lines = vec![0.0; theta.ncols() * width];
            for (i, line) in lines.chunks_exact_mut(width).enumerate() {
                for j in 0..tau.ncols() {
                    let w = tau[(b, j)];
                    line.iter_mut().zip(&x[i * tau.ncols() + j]).for_each(|(t, v)| *t += w * v);
                }
            }
            let mut left = column.clone();
            for (a, row) in left.chunks_exact_mut(width).enumerate() {
                for (i, line) in lines.chunks_exact(width).enumerate() {
                    let w = theta[(a, i)];
                    row.iter_mut().zip(line).for_each(|(t, v)| *t -= w * v);
                }
            }
            left
        })
        .collect();
    let (squares, worst) = left.iter().flatten().fold((0.0, 0.0f64), |(s, w), v| (s + v * v, w.max(v.abs())));
    let gradient = project(theta, tau, &left).iter().flatten().fold(0.0f64, |g, v| g.max(v.abs()));
    (squares, worst, gradient)
}
