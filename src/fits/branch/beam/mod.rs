//! Branches: coefficients that a renderer bends them with, and taper and stiffness from measured deflections.

pub mod basis;
pub mod bounds;
pub mod curve;
pub mod deflections;
pub mod design;
pub mod evidence;
pub mod fit;
pub mod record;
pub mod synthetic;
#[cfg(test)]
mod tests;

use mesophyll_files::table::OutputRow;
use mesophyll_plants::mechanics::beam::{self, TAPER_MAX, TAPER_MIN};

/// `eval beam`: `alpha,x` → `u,du`, for F/(E′r₁⁴) = 1 and unit length.
pub fn evaluate(alpha: f64, x: f64) -> OutputRow {
    if !(alpha > 0.0 && alpha <= TAPER_MAX) {
        return OutputRow::refused(format!(
            "alpha is {alpha}; expected more than 0 and at most {TAPER_MAX} (tip radius over root radius)"
        ));
    }
    if !(0.0..=1.0).contains(&x) {
        return OutputRow::refused(format!("x is {x}; expected 0 (root) to 1 (tip)"));
    }
    let (u, du) = (beam::deflection(alpha, x), beam::slope(alpha, x));
    if !(u.is_finite() && du.is_finite()) {
        return OutputRow::refused(format!(
            "alpha is {alpha}: the deflection of so thin a tip is beyond double precision"
        ));
    }
    OutputRow::ok(vec![u, du])
}

/// Output columns of [`coefficients`].
pub const OUTPUTS: [&str; 8] = ["c2", "c4", "max_error", "a2", "a3", "a4", "a5", "a_max_error"];

/// `fit beam`: `alpha` → H9's pair and its largest error, then four coefficients of the taper coordinate and theirs.
pub fn coefficients(alpha: f64, samples: usize) -> OutputRow {
    if !(TAPER_MIN..=TAPER_MAX).contains(&alpha) {
        return OutputRow::refused(format!(
            "alpha is {alpha}; expected {TAPER_MIN} to {TAPER_MAX} (tip radius over root radius)"
        ));
    }
    let pair = basis::pair(alpha, samples);
    if !pair.fit.converged() || !pair.c2.is_finite() {
        return OutputRow::refused(format!("{samples} samples do not determine two coefficients"));
    }
    let shape = basis::shape(alpha);
    let error = basis::worst(alpha, |x| shape.at(x).0);
    let [a2, a3, a4, a5] = shape.a;
    OutputRow::ok(vec![pair.c2, pair.c4, pair.max_error, a2, a3, a4, a5, error])
}

#[cfg(test)]
mod row_tests {
    use super::*;

    #[test]
    fn rows_are_answered_or_refused_by_name() {
        assert!(evaluate(0.3, 1.0).status.to_string() == "ok");
        for (alpha, x, name) in
            [(0.0, 0.5, "alpha"), (-1.0, 0.5, "alpha"), (1.5, 0.5, "alpha"), (0.5, 1.1, "x is"), (0.5, -0.1, "x is")]
        {
            let a = evaluate(alpha, x);
            assert!(
                a.values.is_empty()
                    && a.status.to_string().starts_with("refused: ")
                    && a.status.to_string().contains(name)
            );
        }
        assert!(evaluate(f64::INFINITY, 0.5).values.is_empty());
        assert!(coefficients(1e-5, 101).values.is_empty() && coefficients(0.5, 1).values.is_empty());
        assert_eq!(coefficients(0.5, 101).values.len(), OUTPUTS.len());
    }
}
