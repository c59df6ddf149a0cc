//! A branch's deflection as four numbers in a coordinate that follows its taper.
//!
//! Polynomials in x converge badly for thin tips. For a strong taper, u(x) is a logarithm that nearly diverges at the
//! tip, and 11 terms still have an error of a fifth of the tip's deflection at α = 1e-4. As a function of y = ln w / ln
//! α, where w = 1 + (α−1)x is the radius over the root's, u is entire: the sum of a line and exponentials of ±y ln α. y
//! is 0 at the root and 1 at the tip, and becomes x as α → 1. So
//!
//! ```text
//! u ≈ P(y) = a₂y² + a₃y³ + a₄y⁴ + a₅y⁵,    u′ = P′(y) / (w ℓ),    ℓ = ln α / (α − 1)
//! ```
//!
//! The coefficients a are smooth functions of ln α ([`TaperSeries`]), so a tree hands over its tapers and needs no fit.
//! [`TaperShape`] is what a shader gets: eight plain numbers for each branch.

use super::beam::{TAPER_MAX, TAPER_MIN};
use mesophyll_base::number::FloatingPoint;

/// Coefficients of a branch: a₂ … a₅.
pub const TERMS: usize = 4;

/// What a renderer needs to bend a branch of one taper; deflections are of the normalised beam (F/(E′r₁⁴) = 1, unit
/// length).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TaperShape<T> {
    /// Taper α: tip radius over root radius.
    pub alpha: T,
    /// ln α.
    pub ln_alpha: T,
    /// ln α/(α−1); 1 for an untapered branch.
    pub ell: T,
    /// a₂ … a₅.
    pub a: [T; TERMS],
}

impl TaperShape<f64> {
    /// A shape from a taper and its coefficients.
    pub fn new(alpha: f64, a: [f64; TERMS]) -> Self {
        let ln_alpha = alpha.ln();
        TaperShape { alpha, ln_alpha, ell: ell(alpha), a }
    }

    /// The same numbers in single precision, as a shader has them.
    pub fn single(&self) -> TaperShape<f32> {
        let f = |v: f64| v as f32;
        TaperShape { alpha: f(self.alpha), ln_alpha: f(self.ln_alpha), ell: f(self.ell), a: self.a.map(f) }
    }
}

/// ln α/(α−1), regular at α = 1.
pub fn ell(alpha: f64) -> f64 {
    let beta = alpha - 1.0;
    if beta == 0.0 { 1.0 } else { beta.ln_1p() / beta }
}

/// Number of terms with which a power series in a quantity below 1/9 reaches the type's precision: 16 for `f64`, 8 for
/// `f32`.
const fn terms<T>() -> usize {
    2 * size_of::<T>()
}

/// y of x: ln(1+(α−1)x)/ln α. For α ≥ ½ it uses the series of the area hyperbolic tangent, whose common factor cancels,
/// so that α → 1 is regular.
pub fn coordinate<T: FloatingPoint>(shape: &TaperShape<T>, x: T) -> T {
    let (one, two) = (T::one(), T::of(2.0));
    let beta = shape.alpha - one;
    if shape.alpha < T::of(0.5) {
        return ((one - x) + shape.alpha * x).ln() / shape.ln_alpha;
    }
    let reduced = |z: T| {
        let mut sum = T::zero();
        for k in (0..terms::<T>()).rev() {
            sum = sum * (z * z) + one / T::of((2 * k + 1) as f64);
        }
        sum
    };
    let (at, end) = (two + beta * x, two + beta);
    x * end / at * reduced(beta * x / at) / reduced(beta / end)
}

/// x of y: (α^y − 1)/(α − 1), regular at α = 1.
pub fn position<T: FloatingPoint>(shape: &TaperShape<T>, y: T) -> T {
    let z = y * shape.ln_alpha;
    if z.abs() >= T::of(0.5) {
        return (z.exp() - T::one()) / (shape.alpha - T::one());
    }
    // (e^z − 1)/z.
    let mut sum = T::one();
    for k in (2..=terms::<T>()).rev() {
        sum = T::one() + z * sum / T::of(k as f64);
    }
    y * shape.ell * sum
}

/// P, P′ and P″ at y.
pub fn polynomial<T: FloatingPoint>(a: &[T; TERMS], y: T) -> [T; 3] {
    let (mut p, mut dp, mut ddp) = (T::zero(), T::zero(), T::zero());
    for (k, a) in a.iter().enumerate().rev() {
        let n = (k + 2) as f64;
        p = p * y + *a;
        dp = dp * y + T::of(n) * *a;
        ddp = ddp * y + T::of(n * (n - 1.0)) * *a;
    }
    [p * y * y, dp * y, ddp]
}

impl<T: FloatingPoint> TaperShape<T> {
    /// Deflection and slope at x in [0, 1].
    pub fn at(&self, x: T) -> (T, T) {
        let y = coordinate(self, x);
        let [p, dp, _] = polynomial(&self.a, y);
        let w = (T::one() - x) + self.alpha * x;
        (p, dp / (w * self.ell))
    }

    /// Deflection of the tip for F/(E′r₁⁴) = 1: the sum of the coefficients.
    pub fn tip(&self) -> T {
        self.a.iter().fold(T::zero(), |s, a| s + *a)
    }
}

/// Coefficients as functions of the taper: one Chebyshev series for each, in ln α scaled to [−1, 1] over [`TAPER_MIN`],
/// [`TAPER_MAX`].
#[derive(Debug, Clone, PartialEq)]
pub struct TaperSeries {
    /// Row k: the series of a_{k+2}; every row as long as the first.
    pub series: [Vec<f64>; TERMS],
}

/// ln α scaled to [−1, 1]: −1 at [`TAPER_MAX`], 1 at [`TAPER_MIN`].
pub fn scaled(alpha: f64) -> f64 {
    2.0 * (alpha / TAPER_MAX).ln() / (TAPER_MIN / TAPER_MAX).ln() - 1.0
}

/// The taper at a scaled place: the inverse of [`scaled`].
pub fn unscaled(s: f64) -> f64 {
    TAPER_MAX * ((s + 1.0) / 2.0 * (TAPER_MIN / TAPER_MAX).ln()).exp()
}

impl TaperSeries {
    /// The shape of a branch of taper `alpha` in [[`TAPER_MIN`], [`TAPER_MAX`]].
    pub fn shape(&self, alpha: f64) -> TaperShape<f64> {
        let t = mesophyll_base::chebyshev::values(scaled(alpha), self.series[0].len());
        TaperShape::new(alpha, std::array::from_fn(|k| self.series[k].iter().zip(&t).map(|(c, t)| c * t).sum()))
    }

    /// How many numbers describe all tapers.
    pub fn len(&self) -> usize {
        self.series.iter().map(Vec::len).sum()
    }

    /// Whether there are no coefficients.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOME: [f64; 4] = [0.3, -0.1, 0.05, 0.02];

    #[test]
    fn the_coordinate_and_its_inverse_agree_for_every_taper() {
        for alpha in [1e-4, 0.02, 0.3, 0.499_999, 0.5, 0.9, 1.0 - 1e-5, 1.0 - 1e-12, 1.0, 1.0 + 1e-5, 1.25] {
            let shape = TaperShape::new(alpha, SOME);
            for k in 0..=50 {
                let x = f64::from(k) / 50.0;
                let y = coordinate(&shape, x);
                assert!((position(&shape, y) - x).abs() < 1e-13, "α {alpha}, x {x}: {}", position(&shape, y));
                let single = shape.single();
                assert!((f64::from(coordinate(&single, x as f32)) - y).abs() < 2e-6, "f32 at α {alpha}, x {x}");
                assert!((f64::from(position(&single, y as f32)) - x).abs() < 2e-6, "f32 at α {alpha}, x {x}");
            }
            assert!((coordinate(&shape, 1.0) - 1.0).abs() < 1e-14);
        }
    }

    /// Compares with the logarithm itself, at its own precision, away from α = 1.
    #[test]
    fn the_series_is_the_logarithm() {
        for alpha in [0.5, 0.6, 0.8, 1.2] {
            for x in [0.1, 0.6, 0.95] {
                let shape = TaperShape::new(alpha, SOME);
                let y = ((alpha - 1.0) * x).ln_1p() / alpha.ln();
                assert!((coordinate(&shape, x) / y - 1.0).abs() < 1e-14, "α {alpha}, x {x}");
            }
        }
    }

    #[test]
    fn slopes_are_derivatives() {
        for alpha in [0.01, 0.4, 1.0] {
            let shape = TaperShape::new(alpha, SOME);
            for x in [0.2, 0.7, 0.95] {
                let h = 1e-6;
                let numeric = (shape.at(x + h).0 - shape.at(x - h).0) / (2.0 * h);
                assert!((shape.at(x).1 - numeric).abs() < 1e-7 * numeric.abs().max(1.0), "α {alpha}, x {x}");
            }
            let [_, dp, ddp] = polynomial(&shape.a, 0.6);
            let numeric = (polynomial(&shape.a, 0.6 + 1e-6)[1] - polynomial(&shape.a, 0.6 - 1e-6)[1]) / 2e-6;
            assert!((ddp - numeric).abs() < 1e-8 && dp > 0.0);
        }
    }

    #[test]
    fn the_scale_has_an_inverse() {
        for alpha in [1e-4, 0.1, 1.0, 1.25] {
            assert!((unscaled(scaled(alpha)) / alpha - 1.0).abs() < 1e-13);
        }
        assert!((scaled(TAPER_MIN) - 1.0).abs() < 1e-15 && (scaled(TAPER_MAX) + 1.0).abs() < 1e-15);
    }
}
