//! Numeric derivatives, and the check of analytic ones against them.

// A comparison with NaN is false, so `!(a < b)` is written where NaN must fail.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use super::problem::Problem;

/// Numeric Jacobian by central differences at two step lengths and Richardson's extrapolation. The error is of order
/// h⁴; a smooth model gives about eleven digits. Near a bound the steps are shortened, and on a bound the difference is
/// one-sided (error of order h²).
///
/// `lower` and `upper` may be empty (no bounds). Returns the number of residual evaluations; `out` as in
/// [`Problem::jacobian`].
///
/// L. F. Richardson, "The approximate arithmetical solution by finite differences …", Phil. Trans. A 210 (1911),
/// 307–357.
pub fn numeric(problem: &dyn Problem, params: &[f64], lower: &[f64], upper: &[f64], out: &mut [f64]) -> usize {
    let (n, m) = (problem.parameters(), problem.residuals());
    let mut x = params.to_vec();
    let mut at = |j: usize, value: f64, r: &mut Vec<f64>| {
        x[j] = value;
        problem.evaluate(&x, r);
        x[j] = params[j];
    };
    let [mut a, mut b, mut c, mut d] = [vec![0.0; m], vec![0.0; m], vec![0.0; m], vec![0.0; m]];
    let mut evaluations = 0;
    for j in 0..n {
        let x0 = params[j];
        let low = lower.get(j).copied().unwrap_or(f64::NEG_INFINITY);
        let high = upper.get(j).copied().unwrap_or(f64::INFINITY);
        // The truncation error h⁴ balances the rounding error ε/h at h ≈ ε^(1/5). A parameter at zero has no scale but
        // that of its bounds.
        let scale = if x0 != 0.0 { x0.abs() } else { (high - low).min(1.0) };
        let wanted = scale * f64::EPSILON.powf(0.2);
        let room = (x0 - low).min(high - x0);
        let column = &mut out[j * m..(j + 1) * m];
        if room > 0.05 * wanted {
            // The step is the difference of two doubles, so that (x0 + h) − x0 = h exactly.
            let h = exact_step(x0, wanted.min(room));
            let (half, quarter_steps) = (exact_step(x0, h / 2.0), 2.0);
            at(j, x0 + h, &mut a);
            at(j, x0 - h, &mut b);
            at(j, x0 + half, &mut c);
            at(j, x0 - half, &mut d);
            evaluations += 4;
            let q = (h / half) * (h / half);
            debug_assert!((h / half - quarter_steps).abs() < 0.5);
            for i in 0..m {
                let wide = (a[i] - b[i]) / (2.0 * h);
                let narrow = (c[i] - d[i]) / (2.0 * half);
                column[i] = narrow + (narrow - wide) / (q - 1.0);
            }
        } else {
            // A one-sided difference away from the bound: (4 f(h) − f(2h) − 3 f(0)) / 2h with h ≈ ε^(1/3).
            let sign = if high - x0 >= x0 - low { 1.0 } else { -1.0 };
            let h = sign * exact_step(x0, (scale * f64::EPSILON.cbrt()).min((high - low) / 4.0));
            at(j, x0, &mut a);
            at(j, x0 + h, &mut b);
            at(j, x0 + 2.0 * h, &mut c);
            evaluations += 3;
            for i in 0..m {
                column[i] = (4.0 * b[i] - c[i] - 3.0 * a[i]) / (2.0 * h);
            }
        }
    }
    evaluations
}

fn exact_step(x: f64, h: f64) -> f64 {
    let moved = x + h;
    moved - x
}

/// What [`check`] found: the worst entry of a Jacobian against numeric differences.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JacobianCheck {
    /// Largest difference, relative to the largest entry of its column.
    pub worst: f64,
    /// Row of the worst entry.
    pub residual: usize,
    /// Column of the worst entry.
    pub parameter: usize,
    /// That entry of the problem's own Jacobian.
    pub analytic: f64,
    /// The same by numeric differences.
    pub numeric: f64,
}

/// Compares a problem's Jacobian with [`numeric`] at `params`. `None` where the problem has no Jacobian of its own.
/// A correct Jacobian of a smooth model shows `worst` around 1e-10; a wrong sign or a forgotten factor shows about 1.
pub fn check(problem: &dyn Problem, params: &[f64]) -> Option<JacobianCheck> {
    let (n, m) = (problem.parameters(), problem.residuals());
    let (mut own, mut other) = (vec![0.0; n * m], vec![0.0; n * m]);
    if !problem.jacobian(params, &mut own) {
        return None;
    }
    numeric(problem, params, &[], &[], &mut other);
    let mut found = JacobianCheck { worst: 0.0, residual: 0, parameter: 0, analytic: 0.0, numeric: 0.0 };
    for j in 0..n {
        let column = j * m..(j + 1) * m;
        let largest = other[column.clone()].iter().chain(&own[column.clone()]).fold(0.0, |s: f64, v| s.max(v.abs()));
        for k in column {
            let difference = if own[k] == other[k] { 0.0 } else { (own[k] - other[k]).abs() / largest };
            // A NaN in either is a difference too.
            if !(difference <= found.worst) {
                found = JacobianCheck {
                    worst: difference,
                    residual: k - j * m,
                    parameter: j,
                    analytic: own[k],
                    numeric: other[k],
                };
            }
        }
    }
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::super::problem::ClosureProblem;
    use super::*;

    fn decay(p: &[f64], r: &mut [f64]) {
        for (i, r) in r.iter_mut().enumerate() {
            *r = p[0] * (-p[1] * i as f64).exp();
        }
    }

    fn decay_jacobian(p: &[f64], j: &mut [f64]) {
        for i in 0..10 {
            let e = (-p[1] * i as f64).exp();
            j[i] = e;
            j[10 + i] = -p[0] * i as f64 * e;
        }
    }

    #[test]
    fn a_right_jacobian_passes_and_a_wrong_one_is_located() {
        let right = ClosureProblem::new(2, 10, decay).with_jacobian(decay_jacobian);
        let found = check(&right, &[3.0, 0.4]).unwrap();
        assert!(found.worst < 1e-9, "{found:?}");
        let wrong = ClosureProblem::new(2, 10, decay).with_jacobian(|p: &[f64], j: &mut [f64]| {
            decay_jacobian(p, j);
            j[13] = -j[13];
        });
        let found = check(&wrong, &[3.0, 0.4]).unwrap();
        assert!(found.worst > 0.5 && found.residual == 3 && found.parameter == 1, "{found:?}");
        assert!(check(&ClosureProblem::new(2, 10, decay), &[3.0, 0.4]).is_none());
    }

    #[test]
    fn bounds_are_never_crossed() {
        let guarded = ClosureProblem::new(1, 1, |p: &[f64], r: &mut [f64]| {
            r[0] = if (0.0..=2.0).contains(&p[0]) { (p[0] + 1.0).ln() } else { f64::NAN };
        });
        for (x, tolerance) in [(0.0, 1e-8), (1e-5, 1e-7), (1.0, 1e-10), (2.0, 1e-8)] {
            let mut j = [0.0];
            numeric(&guarded, &[x], &[0.0], &[2.0], &mut j);
            let error = (j[0] * (x + 1.0) - 1.0).abs();
            assert!(error < tolerance, "at {x}: {error:e}");
        }
    }
}
