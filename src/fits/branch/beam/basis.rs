//! Few coefficients for a branch's deflection: the dissertation's pair with its own sampling, and four coefficients in
//! a coordinate that follows the taper. The four are smooth functions of the taper, so that a tree needs no fit for
//! each branch.

use mesophyll_base::chebyshev;
use mesophyll_base::solvers::{Fit, ResidualNoise, linear_algebra};
use mesophyll_plants::mechanics::beam;
use mesophyll_plants::mechanics::taper::{
    self, TERMS, TaperSeries, TaperShape, coordinate, position, scaled, unscaled,
};
use nalgebra::DMatrix;
use std::sync::LazyLock;

/// H9 Eq. 4.8: the deflection u = c₂x² + c₄x⁴ at the place x along the branch, 0 to 1.
#[derive(Debug, Clone, PartialEq)]
pub struct DeflectionPolynomial {
    /// Coefficient of x².
    pub c2: f64,
    /// Coefficient of x⁴.
    pub c4: f64,
    /// Largest |u − c₂x² − c₄x⁴| over all x in [0, 1].
    pub max_error: f64,
    /// How the solver came to them.
    pub fit: Fit,
}

/// Least squares over `samples` evenly spaced places from 0 to 1, both included. 101 places are the sampling of H9
/// Table 4.1. They reproduce the table's coefficients to every digit, but two of its Δmax (largest errors) are
/// misprinted: α = 0.1 has .0024 for .00268, and α = 0.2 has .0081 for .00855.
pub fn pair(alpha: f64, samples: usize) -> DeflectionPolynomial {
    let x: Vec<f64> = (0..samples).map(|k| k as f64 / (samples - 1).max(1) as f64).collect();
    let a = DMatrix::from_fn(samples, 2, |i, j| if j == 0 { x[i].powi(2) } else { x[i].powi(4) });
    let b: Vec<f64> = x.iter().map(|x| beam::deflection(alpha, *x)).collect();
    let fit = linear_algebra::solve(&a, &b, &[], ResidualNoise::Estimated);
    let (c2, c4) = (fit.params[0], fit.params[1]);
    let max_error = worst(alpha, |x| c2 * x * x + c4 * x.powi(4));
    DeflectionPolynomial { c2, c4, max_error, fit }
}

/// Largest |u − approximation| over x, at 1,600 places: half of them evenly spaced in x, half in the taper's own
/// coordinate.
pub fn worst(alpha: f64, approximation: impl Fn(f64) -> f64) -> f64 {
    let shape = TaperShape::new(alpha, [0.0; TERMS]);
    (0..=800)
        .flat_map(|k| {
            let t = f64::from(k) / 800.0;
            [t, position(&shape, t).min(1.0)]
        })
        .map(|x| (beam::deflection(alpha, x) - approximation(x)).abs())
        .fold(0.0, mesophyll_base::solvers::qr::nan_max)
}

/// The variable that a polynomial uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PolynomialVariable {
    /// The place x: shifted Chebyshev polynomials times x².
    Place,
    /// The taper's coordinate y = ln(1+(α−1)x)/ln α.
    Taper,
}

/// Worst error over the taper range, in units of the tip's deflection, when each branch is fitted on its own with
/// `terms` coefficients. It tells what a basis can achieve.
pub fn of_branches(variable: PolynomialVariable, terms: usize) -> f64 {
    (0..=24)
        .map(|k| {
            let alpha = 1e-4f64.powf(f64::from(k) / 24.0);
            let shape = TaperShape::new(alpha, [0.0; TERMS]);
            let functions = |x: f64| -> Vec<f64> {
                let v = if variable == PolynomialVariable::Place { x } else { coordinate(&shape, x) };
                chebyshev::values(2.0 * v - 1.0, terms).iter().map(|t| v * v * t).collect()
            };
            let places: Vec<f64> = nodes(64)
                .map(|t| if variable == PolynomialVariable::Place { t } else { position(&shape, t).min(1.0) })
                .collect();
            let rows: Vec<Vec<f64>> = places.iter().map(|x| functions(*x)).collect();
            let a = DMatrix::from_fn(places.len(), terms, |i, j| rows[i][j]);
            let b: Vec<f64> = places.iter().map(|x| beam::deflection(alpha, *x)).collect();
            let c = linear_algebra::solve(&a, &b, &[], ResidualNoise::Estimated).params;
            let error = worst(alpha, |x| functions(x).iter().zip(&c).map(|(f, c)| f * c).sum());
            error / beam::deflection(alpha, 1.0)
        })
        .fold(0.0, mesophyll_base::solvers::qr::nan_max)
}

/// Chebyshev nodes on (0, 1).
fn nodes(n: usize) -> impl Iterator<Item = f64> {
    (0..n).map(move |k| 0.5 - 0.5 * chebyshev::node(k, n))
}

/// Coefficients of all tapers at once.
#[derive(Debug, Clone, PartialEq)]
pub struct TaperPolynomials {
    /// Series by power of y (from 2), each in Chebyshev polynomials of the scaled ln α.
    pub series: Vec<Vec<f64>>,
    /// The least-squares fit: residuals are relative to the tip's deflection.
    pub fit: Fit,
}

impl TaperPolynomials {
    /// Coefficients of one branch.
    pub fn coefficients(&self, alpha: f64) -> Vec<f64> {
        let t = chebyshev::values(scaled(alpha), self.series.first().map_or(0, Vec::len));
        self.series.iter().map(|row| row.iter().zip(&t).map(|(c, t)| c * t).sum()).collect()
    }

    /// Largest error over x at one taper.
    pub fn error(&self, alpha: f64) -> f64 {
        let a = self.coefficients(alpha);
        let shape = TaperShape::new(alpha, [0.0; TERMS]);
        worst(alpha, |x| {
            let y = coordinate(&shape, x);
            a.iter().rev().fold(0.0, |p, a| p * y + a) * y * y
        })
    }

    /// Largest error in units of the tip's deflection over tapers from 1e-4 to 1, and where.
    pub fn worst(&self) -> (f64, f64) {
        (0..=60)
            .map(|k| 1e-4f64.powf(f64::from(k) / 60.0))
            .map(|alpha| (self.error(alpha) / beam::deflection(alpha, 1.0), alpha))
            .fold((0.0, 1.0), |a, b| if b.0 <= a.0 { a } else { b })
    }
}

/// Number of tapers and of places that a fit is made on, each at Chebyshev nodes.
const GRID: usize = 32;

/// One least-squares fit of `terms` series of `degree`. The residual is relative to the deflection of each taper's tip,
/// so that all tapers have the same weight.
pub fn smooth_fit(terms: usize, degree: usize) -> TaperPolynomials {
    let width = degree + 1;
    let mut rows: Vec<(Vec<f64>, f64)> = Vec::with_capacity(GRID * GRID);
    for s in nodes(GRID) {
        let s = 2.0 * s - 1.0;
        let alpha = unscaled(s);
        let shape = TaperShape::new(alpha, [0.0; TERMS]);
        let (t, tip) = (chebyshev::values(s, width), beam::deflection(alpha, 1.0));
        for y in nodes(GRID) {
            let row = (0..terms * width).map(|k| y.powi((k / width) as i32 + 2) * t[k % width] / tip).collect();
            rows.push((row, beam::deflection(alpha, position(&shape, y).min(1.0)) / tip));
        }
    }
    let a = DMatrix::from_fn(rows.len(), terms * width, |i, j| rows[i].0[j]);
    let b: Vec<f64> = rows.iter().map(|r| r.1).collect();
    let fit = linear_algebra::solve(&a, &b, &[], ResidualNoise::Estimated);
    TaperPolynomials { series: fit.params.chunks(width).map(<[f64]>::to_vec).collect(), fit }
}

/// Degree of the series in ln α that the library uses: 4 × 6 numbers for all tapers.
pub const DEGREE: usize = 5;

/// The library's own coefficients; fitted once, in milliseconds.
pub fn smooth() -> &'static (TaperSeries, TaperPolynomials) {
    static FIT: LazyLock<(TaperSeries, TaperPolynomials)> = LazyLock::new(|| {
        let fit = smooth_fit(TERMS, DEGREE);
        (TaperSeries { series: std::array::from_fn(|k| fit.series[k].clone()) }, fit)
    });
    &FIT
}

/// A branch's shape for a renderer; `alpha` in [[`beam::TAPER_MIN`], [`beam::TAPER_MAX`]].
pub fn shape(alpha: f64) -> taper::TaperShape<f64> {
    smooth().0.shape(alpha)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_plants::mechanics::{branch::BranchFrame, length};

    #[test]
    fn table_4_1_to_every_printed_digit() {
        for (alpha, c2, c4, error, places) in [
            (0.05, "0.221875", "0.754029", 0.0469, 4),
            (0.1, "0.3326", "0.398924", 0.00268, 5),
            (0.2, "0.374571", "0.129428", 0.00855, 5),
            (0.3, "0.364816", "0.024577", 0.006, 3),
        ] {
            let p = pair(alpha, 101);
            assert_eq!(format!("{:.*}", c2.len() - 2, p.c2), c2);
            assert_eq!(format!("{:.*}", c4.len() - 2, p.c4), c4);
            // The table truncates the digits of its first row and rounds those of its last.
            let unit = 10f64.powi(-places);
            assert!((p.max_error - error).abs() <= unit, "α {alpha}: {}", p.max_error);
        }
        // Why two terms are not enough.
        let tip = |alpha: f64| pair(alpha, 101).max_error / beam::deflection(alpha, 1.0);
        println!("two terms: {:.3} of the tip at α = .01, {:.3} at α = 1", tip(0.01), tip(1.0));
        assert!(pair(0.01, 101).c2 < 0.0 && tip(0.01) > 0.2 && tip(1.0) > 0.02);
    }

    #[test]
    fn four_smooth_coefficients_stay_within_the_stated_share_of_the_tip() {
        // docs/evidence/speed.md says .35 % over all tapers; the last digit is rounded.
        let (smooth, fit) = smooth();
        let (worst, at) = fit.worst();
        println!(
            "{} numbers: worst error {worst:.2e} of the tip at α = {at:.2e}; condition {:.1e}",
            smooth.len(),
            fit.fit.uncertainty.condition
        );
        assert!(smooth.len() == 24 && worst < 0.0037);
        assert_eq!(fit.fit.uncertainty.rank, 24);
        // The form handed to renderers agrees with the fitted one, also for tapers close to 1.
        for alpha in [1e-4, 0.03, 1.0 - 1e-5, 1.0, 1.0 + 1e-5, 1.25] {
            let shape = smooth.shape(alpha);
            let got = super::worst(alpha, |x| shape.at(x).0);
            assert!(
                (got - fit.error(alpha)).abs() < 1e-12 && got < 0.0037 * beam::deflection(alpha, 1.0),
                "α {alpha}: {got}"
            );
        }
    }

    #[test]
    fn the_taper_coordinate_needs_few_terms_where_powers_of_x_fail() {
        assert!(of_branches(PolynomialVariable::Place, 8) > 0.1);
        assert!(of_branches(PolynomialVariable::Taper, 4) < 0.004);
        assert!(of_branches(PolynomialVariable::Taper, 8) < of_branches(PolynomialVariable::Taper, 4) / 10.0);
    }

    /// The length of bent branches from the root to the tip and to places between, measured along the arc of the curve.
    #[test]
    fn bent_branches_keep_their_length() {
        let mut worst = (0.0f64, 0.0, 0.0);
        for k in 0..=24 {
            let alpha = 1e-4f64.powf(f64::from(k) / 24.0);
            let shape = shape(alpha);
            for tip in [0.01, 0.1, 0.25, 0.5, 0.75, 1.0] {
                let amplitude = tip / shape.tip();
                for x in [0.25, 0.5, 0.8, 0.95, 1.0] {
                    let bent = length::bend(&shape, x, amplitude);
                    let error = (length::kept(&shape, &bent, x, amplitude) - 1.0).abs();
                    if error > worst.0 {
                        worst = (error, alpha, tip);
                    }
                }
            }
        }
        println!("worst length error {:.1e} (α = {:.1e}, tip {} L)", worst.0, worst.1, worst.2);
        // docs/evidence/speed.md says .013 %.
        assert!(worst.0 < 1.4e-4);
    }

    /// Compares with the settled curve of the exact beam: where a branch is, and in which direction it points.
    #[test]
    fn bent_branches_are_where_the_exact_curve_is() {
        let mut worst = [0.0f64; 2];
        for alpha in [0.01, 0.05, 0.1, 0.3, 0.6, 1.0] {
            let shape = shape(alpha);
            let amplitude = 0.75 / beam::deflection(alpha, 1.0);
            for k in 1..=40 {
                let x = f64::from(k) / 40.0;
                let (got, want) = (length::bend(&shape, x, amplitude), length::settled(alpha, x, amplitude));
                worst[0] = worst[0].max((got.along - want.along).hypot(got.across - want.across));
                worst[1] = worst[1].max((got.sin.atan2(got.cos) - want.sin.atan2(want.cos)).abs().to_degrees());
            }
        }
        println!("tip .75 L, α from .01: place off by {:.1e} L, direction by {:.2}°", worst[0], worst[1]);
        assert!(worst[0] < 0.01 && worst[1] < 2.4, "{worst:?}");
    }

    /// In single precision, a place near a thin tip is known to 6e-8 L (L is the length) times the slope there. The
    /// slope is 2,000 for a taper of 1e-4 and a tip deflection of .75 L.
    #[test]
    fn thin_tips_in_single_precision() {
        for (alpha, limit) in [(1e-4, 1e-4), (1e-3, 2e-5), (0.01, 5e-6), (0.1, 3e-6)] {
            let s = shape(alpha);
            let amplitude = 0.75 / s.tip();
            let off = (0..=1000)
                .map(|k| {
                    let x = k as f32 / 1000.0;
                    let wide = length::bend(&s, f64::from(x), amplitude);
                    let narrow = length::bend(&s.single(), x, amplitude as f32);
                    (wide.along - f64::from(narrow.along)).hypot(wide.across - f64::from(narrow.across))
                })
                .fold(0.0, f64::max);
            println!("f32 against f64 at α = {alpha}: {off:.1e} L");
            assert!(off < limit, "α {alpha}: {off}");
        }
    }

    #[test]
    fn a_branch_without_taper_bends_in_single_precision_as_in_double() {
        for alpha in [1.0 - 1e-5, 1.0, 1.0 + 1e-5, 0.05] {
            let b = BranchFrame {
                root: [0.0; 3],
                t: [0.0, 0.0, 1.0],
                r: [1.0, 0.0, 0.0],
                s: [0.0, 1.0, 0.0],
                length: 1.0,
                shape: shape(alpha),
            };
            let amplitude = b.amplitude_of_tip([0.5, 0.2]);
            let wide = b.deform(amplitude, [0.01, 0.0, 0.9], b.t, b.r);
            let narrow =
                b.single().deform(amplitude.map(|a| a as f32), [0.01, 0.0, 0.9], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]);
            for k in 0..3 {
                assert!((wide.position[k] - f64::from(narrow.position[k])).abs() < 3e-6, "α {alpha}");
                assert!((wide.normal[k] - f64::from(narrow.normal[k])).abs() < 1e-5, "α {alpha}");
            }
        }
    }

    /// Without a step of Newton's method, a point lies on the bent curve at the place along it that H9 Eq. 4.11 gives.
    /// The lengths of the simplified motion are kept as well as `docs/evidence/plants.md` says. They are summed over a
    /// polygon.
    #[test]
    fn the_closed_form_keeps_lengths_of_small_bends() {
        for (tip, allowed) in [(0.1, 0.006), (0.5, 0.07)] {
            for alpha in [0.1, 0.2, 0.4, 0.7, 1.0] {
                let shape = shape(alpha);
                let points = (0..=4000).map(|k| {
                    let x = 1.0 - (1.0 - f64::from(k) / 4000.0).powi(3);
                    let bent = length::bend_with(&shape, x, tip / shape.tip(), &[], 0);
                    [bent.along, bent.across]
                });
                let points: Vec<[f64; 2]> = points.collect();
                let whole: f64 = points.windows(2).map(|p| (p[1][0] - p[0][0]).hypot(p[1][1] - p[0][1])).sum();
                println!("taper {alpha}, tip {tip}: {:+.4}", whole - 1.0);
                assert!((whole - 1.0).abs() < allowed, "taper {alpha}, tip {tip}: {whole}");
            }
        }
    }
}
