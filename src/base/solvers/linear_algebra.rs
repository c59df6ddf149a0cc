//! Linear least squares by QR: min Σ w (A x − b)², with the same trace, rank and errors as the nonlinear solver.

use super::decomposition;
use super::lm::Fit;
use super::qr;
use super::trace::{Termination, TraceRow};
use super::uncertainty::{ResidualNoise, Uncertainty};
use nalgebra::{DMatrix, DVector};
use std::time::Instant;

/// Solves min Σ ((A x − b)/σ)².
///
/// `a`: m × n. `b`: m values. `sigma`: standard errors of `b` (m values, positive), or empty for equal weights. A σ of
/// infinity drops its row. With [`ResidualNoise::Known`] the errors are those that `sigma` implies (1 where empty);
/// with [`ResidualNoise::Estimated`] they are scaled by the reduced χ².
///
/// Columns may have any scale. Where the columns are dependent, the solution is the shortest one in column-scaled
/// coordinates. The parameters that take part in an undetermined direction are then NaN with infinite errors, while
/// `fit.residuals` is still the best possible. Wrong lengths, no data, a σ ≤ 0 and values that are not finite end as
/// [`Termination::Refused`], with NaN everywhere.
pub fn solve(a: &DMatrix<f64>, b: &[f64], sigma: &[f64], noise: ResidualNoise) -> Fit {
    let clock = Instant::now();
    let (m, n) = a.shape();
    let usable = m > 0
        && n > 0
        && b.len() == m
        && (sigma.is_empty() || sigma.len() == m && sigma.iter().all(|s| *s > 0.0))
        && a.iter().chain(b).all(|v| v.is_finite());
    let mut fit = Fit::failed(n, m, Termination::Refused);
    if !usable {
        return fit;
    }
    let weight = |i: usize| sigma.get(i).map_or(1.0, |s| 1.0 / s);
    let rows = (0..m).filter(|i| weight(*i) > 0.0).count();
    let lengths: Vec<f64> =
        (0..n).map(|k| qr::length(&(0..m).map(|i| weight(i) * a[(i, k)]).collect::<Vec<_>>())).collect();
    let scale: Vec<f64> = lengths.iter().map(|l| if *l > 0.0 { *l } else { 1.0 }).collect();
    if rows == 0 || scale.iter().any(|s| !s.is_finite()) {
        return fit;
    }
    let mut triangle: Vec<f64> = (0..n * m).map(|k| weight(k % m) * a[(k % m, k / m)] / scale[k / m]).collect();
    let mut right: Vec<f64> = (0..m).map(|i| weight(i) * b[i]).collect();
    qr::reduce(&mut triangle, m, n, &mut right);

    let tolerance = (m.max(n) as f64) * f64::EPSILON;
    let square = DMatrix::from_fn(n, n, |i, j| if i <= j && i < m { triangle[j * m + i] } else { 0.0 });
    let full_rank = {
        let Some(sigma) = decomposition::singular_values(square.clone()) else { return fit };
        m >= n && sigma.min() > tolerance * sigma.max()
    };
    // Scaled coordinates: y = x · scale.
    let y: Vec<f64> = if full_rank {
        qr::solve_upper(&triangle, m, n, &right)
    } else {
        let top = DVector::from_fn(n, |i, _| right.get(i).copied().unwrap_or(0.0));
        let Some(svd) = decomposition::svd(square) else { return fit };
        let cut = tolerance * svd.singular_values.max();
        match svd.solve(&top, cut) {
            Ok(y) => y.iter().copied().collect(),
            Err(_) => return fit,
        }
    };
    let x: Vec<f64> = y.iter().zip(&scale).map(|(y, s)| y / s).collect();
    let residuals: Vec<f64> = (0..m)
        .map(|i| if weight(i) > 0.0 { weight(i) * ((0..n).map(|k| a[(i, k)] * x[k]).sum::<f64>() - b[i]) } else { 0.0 })
        .collect();
    let norm = qr::length(&residuals);
    let cost = 0.5 * norm * norm;
    // Undo the scaling, so that the errors are those of x.
    for k in 0..n {
        for i in 0..m.min(k + 1) {
            triangle[k * m + i] *= if lengths[k] > 0.0 { lengths[k] } else { 0.0 };
        }
    }
    let uncertainty = Uncertainty::from_triangle(&triangle, m, rows, n, 2.0 * cost, noise, tolerance);
    fit.params = x;
    for k in &uncertainty.undetermined {
        fit.params[*k] = f64::NAN;
    }
    let gradient =
        (0..n).map(|k| (0..m).map(|i| weight(i) * a[(i, k)] * residuals[i]).sum::<f64>().abs()).fold(0.0, f64::max);
    fit.termination = if lengths.iter().all(|l| *l == 0.0) { Termination::Flat } else { Termination::Direct };
    fit.trace = vec![TraceRow {
        iteration: 1,
        evaluations: 1,
        elapsed_s: clock.elapsed().as_secs_f64(),
        cost,
        gradient,
        step: qr::length(&y),
        truth_error: None,
    }];
    fit.evaluations = 1;
    fit.residuals = residuals;
    fit.cost = cost;
    fit.uncertainty = uncertainty;
    fit
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(x: &[f64]) -> DMatrix<f64> {
        DMatrix::from_fn(x.len(), 2, |i, j| if j == 0 { 1.0 } else { x[i] })
    }

    /// The textbook formulas of weighted regression on a line: slope = (S Sxy − Sx Sy)/Δ, variances Sxx/Δ and S/Δ.
    #[test]
    fn a_weighted_line_agrees_with_the_closed_form() {
        let x = [0.3, 1.1, 2.0, 2.2, 4.7, 5.0];
        let y = [1.0, 1.9, 3.2, 3.0, 6.1, 6.4];
        let s = [0.1, 0.2, 0.1, 0.3, 0.2, 0.5];
        let sum = |f: &dyn Fn(usize) -> f64| (0..x.len()).map(|i| f(i) / (s[i] * s[i])).sum::<f64>();
        let (s0, sx, sy) = (sum(&|_| 1.0), sum(&|i| x[i]), sum(&|i| y[i]));
        let (sxx, sxy) = (sum(&|i| x[i] * x[i]), sum(&|i| x[i] * y[i]));
        let delta = s0 * sxx - sx * sx;
        let fit = solve(&line(&x), &y, &s, ResidualNoise::Known);
        let near = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-12, "{a} against {b}");
        near(fit.params[0], (sxx * sy - sx * sxy) / delta);
        near(fit.params[1], (s0 * sxy - sx * sy) / delta);
        near(fit.uncertainty.stderr[0], (sxx / delta).sqrt());
        near(fit.uncertainty.stderr[1], (s0 / delta).sqrt());
        near(fit.uncertainty.correlation(0, 1), -sx / (s0 * sxx).sqrt());
        assert_eq!((fit.uncertainty.rank, fit.uncertainty.freedom, fit.termination), (2, 4, Termination::Direct));
    }

    #[test]
    fn dependent_columns_are_named_and_never_get_a_number() {
        let a = DMatrix::from_fn(5, 3, |i, j| [1.0, i as f64, 2.0 * i as f64][j]);
        let fit = solve(&a, &[1.0, 2.0, 3.0, 4.0, 5.5], &[], ResidualNoise::Estimated);
        assert_eq!(fit.uncertainty.rank, 2);
        assert_eq!(fit.uncertainty.undetermined, [1, 2]);
        assert!(fit.params[0].is_finite() && fit.params[1].is_nan() && fit.params[2].is_nan());
        assert!(fit.uncertainty.stderr[0].is_finite() && fit.uncertainty.stderr[1].is_infinite());
        let d = &fit.uncertainty.directions[0];
        assert!((d[1] + 2.0 * d[2]).abs() < 1e-12 * d[1].abs(), "{d:?} is not along (0, 2, −1)");
        // The residuals are still the best that two columns allow.
        let two = solve(&line(&[0.0, 1.0, 2.0, 3.0, 4.0]), &[1.0, 2.0, 3.0, 4.0, 5.5], &[], ResidualNoise::Estimated);
        assert!((fit.cost - two.cost).abs() < 1e-14 && (fit.params[0] - two.params[0]).abs() < 1e-13);
    }

    #[test]
    fn zero_columns_short_systems_and_columns_of_any_scale() {
        let flat = solve(&DMatrix::zeros(4, 2), &[1.0; 4], &[], ResidualNoise::Estimated);
        assert_eq!(flat.termination, Termination::Flat);
        assert!(flat.params.iter().all(|p| p.is_nan()));
        let short = solve(&DMatrix::from_row_slice(1, 2, &[1.0, 1.0]), &[2.0], &[], ResidualNoise::Known);
        assert_eq!((short.uncertainty.rank, short.uncertainty.undetermined.len()), (1, 2));
        let x: Vec<f64> = (0..9).map(f64::from).collect();
        let tiny = DMatrix::from_fn(9, 2, |i, j| if j == 0 { 1e-150 } else { 1e120 * x[i] });
        let fit = solve(&tiny, &x.iter().map(|x| 3.0 + 2.0 * x).collect::<Vec<_>>(), &[], ResidualNoise::Known);
        assert!((fit.params[0] * 1e-150 - 3.0).abs() < 1e-12 && (fit.params[1] * 1e120 - 2.0).abs() < 1e-12);
        assert_eq!(fit.uncertainty.rank, 2);
    }

    #[test]
    fn nonsense_is_refused() {
        let a = line(&[0.0, 1.0, 2.0]);
        for (b, s) in
            [(vec![1.0, 2.0], vec![]), (vec![1.0, f64::NAN, 2.0], vec![]), (vec![1.0; 3], vec![1.0, 0.0, 1.0])]
        {
            let fit = solve(&a, &b, &s, ResidualNoise::Known);
            assert_eq!(fit.termination, Termination::Refused);
            assert!(fit.params.iter().all(|p| p.is_nan()) && fit.uncertainty.stderr.iter().all(|s| s.is_infinite()));
        }
    }

    #[test]
    fn an_infinite_sigma_drops_its_row() {
        let with = solve(
            &line(&[0.0, 1.0, 2.0, 9.0]),
            &[1.0, 2.1, 2.9, 50.0],
            &[1.0, 1.0, 1.0, f64::INFINITY],
            ResidualNoise::Estimated,
        );
        let without = solve(&line(&[0.0, 1.0, 2.0]), &[1.0, 2.1, 2.9], &[], ResidualNoise::Estimated);
        assert_eq!(with.uncertainty.freedom, 1);
        for k in 0..2 {
            assert!((with.params[k] - without.params[k]).abs() < 1e-14);
            assert!((with.uncertainty.stderr[k] - without.uncertainty.stderr[k]).abs() < 1e-14);
        }
    }
}
