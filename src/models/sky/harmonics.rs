//! Real orthonormal spherical harmonics, without the Condon–Shortley phase: index l(l+1)+m, cos mφ for m > 0, sin |m|φ
//! for m < 0, z up.
//!
//! Y_lm = √2 K_l|m| P_l^|m|(cosθ) cos mφ (m > 0), K_l0 P_l (m = 0), √2 K_l|m| P_l^|m| sin |m|φ (m < 0), where K² =
//! (2l+1)/(4π) (l−|m|)!/(l+|m|)! and P_l^m has no factor (−1)^m. Values come from recurrences of the *normalised*
//! functions in l at fixed m (Holmes and Featherstone 2002, Eq. 11), which neither overflow nor lose digits. The sin^m
//! θ cos mφ are the real parts of (x + iy)^m, so no angle is ever computed.
//!
//! Skies, the path tracer and the light transfer all take their harmonics from here. Two other places compute harmonics
//! that differ in kind. The viewer's `dome` follows its shader, which leaves the norms to the coefficients, in the
//! shader's own recurrence. The translucency's `basis` needs Legendre functions of an argument that is not the cosine
//! of the direction, one function at a time.

use std::f64::consts::PI;

/// Largest number of bands that this program works with.
pub const MOST_BANDS: usize = 64;

/// Coefficients of a function on the sphere, three channels: N² triples at index l(l+1)+m.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct HarmonicCoefficients {
    bands: usize,
    values: Vec<[f64; 3]>,
}

impl HarmonicCoefficients {
    /// All zero.
    pub fn zero(bands: usize) -> Self {
        HarmonicCoefficients { bands, values: vec![[0.0; 3]; bands * bands] }
    }

    /// From N² triples; `None` where their number is not a square.
    pub(crate) fn from_values(values: Vec<[f64; 3]>) -> Option<Self> {
        let bands = values.len().isqrt();
        (bands * bands == values.len() && bands > 0).then_some(HarmonicCoefficients { bands, values })
    }

    /// Number of bands N: l = 0 … N−1.
    pub fn bands(&self) -> usize {
        self.bands
    }
    /// The coefficients, three channels each, at index l(l+1)+m.
    pub fn values(&self) -> &[[f64; 3]] {
        &self.values
    }
    /// The same, for changing them.
    pub fn values_mut(&mut self) -> &mut [[f64; 3]] {
        &mut self.values
    }
    /// The coefficient of degree l and order m; zero beyond the bands.
    pub fn get(&self, l: usize, m: isize) -> [f64; 3] {
        self.values.get(index(l, m)).copied().filter(|_| l < self.bands).unwrap_or([0.0; 3])
    }

    /// The first `bands` bands; missing ones are zero.
    pub fn truncated(&self, bands: usize) -> Self {
        let mut values = self.values.clone();
        values.resize(bands * bands, [0.0; 3]);
        HarmonicCoefficients { bands, values }
    }

    /// Root of the sum of squared differences, a channel each. Bands that one of the two lacks count as zero.
    pub fn distance(&self, other: &Self) -> [f64; 3] {
        let (a, b) = (&self.values, &other.values);
        let at = |v: &[[f64; 3]], k: usize, c: usize| v.get(k).map_or(0.0, |x| x[c]);
        std::array::from_fn(|c| {
            (0..a.len().max(b.len())).map(|k| (at(a, k, c) - at(b, k, c)).powi(2)).sum::<f64>().sqrt()
        })
    }
}

/// l(l+1)+m.
#[inline]
pub fn index(l: usize, m: isize) -> usize {
    (l * (l + 1)).wrapping_add_signed(m)
}

/// Values of all functions up to a number of bands; the factors of the recurrences are computed once.
#[derive(Debug, Clone, PartialEq)]
pub struct HarmonicBasis {
    bands: usize,
    /// For each m: the value of Y_mm without (x + iy)^m, then pairs (α, β) for l = m+1 …, with Y_l = α (z Y_{l−1} − β
    /// Y_{l−2}).
    orders: Vec<Order>,
}

#[derive(Debug, Clone, PartialEq)]
struct Order {
    first: f64,
    steps: Vec<[f64; 2]>,
}

impl HarmonicBasis {
    /// `bands` is at least 1.
    pub fn new(bands: usize) -> Self {
        let mut first = (1.0 / (4.0 * PI)).sqrt();
        let orders = (0..bands)
            .map(|m| {
                if m > 0 {
                    // √((2m+1)/(2m)) a step, and √2 once
                    first *= (if m == 1 { 2.0 } else { 1.0 } * (2 * m + 1) as f64 / (2 * m) as f64).sqrt();
                }
                let m2 = (m * m) as f64;
                let steps = (m + 1..bands).map(|l| {
                    let (l2, before) = ((l * l) as f64, ((l - 1) * (l - 1)) as f64);
                    [((4.0 * l2 - 1.0) / (l2 - m2)).sqrt(), ((before - m2) / (4.0 * before - 1.0)).abs().sqrt()]
                });
                Order { first, steps: steps.collect() }
            })
            .collect();
        HarmonicBasis { bands, orders }
    }

    /// Number of bands N: l = 0 … N−1.
    pub fn bands(&self) -> usize {
        self.bands
    }

    /// The recurrence of order `m`: the value of Y_mm without (x + iy)^m, and (α, β) of every later degree, with Y_l =
    /// α (z Y_{l−1} − β Y_{l−2}). `m` is less than the number of bands.
    pub fn recurrence(&self, m: usize) -> (f64, &[[f64; 2]]) {
        (self.orders[m].first, &self.orders[m].steps)
    }

    /// All N² values in the unit direction `d`; `out` has N² places.
    pub fn fill(&self, d: [f64; 3], out: &mut [f64]) {
        let (mut cos, mut sin) = (1.0, 0.0);
        for (m, order) in self.orders.iter().enumerate() {
            self.walk(m, order, d[2], |l, v| {
                out[l * (l + 1) + m] = v * cos;
                out[l * (l + 1) - m] = if m == 0 { v } else { v * sin };
            });
            (cos, sin) = (cos * d[0] - sin * d[1], cos * d[1] + sin * d[0]);
        }
    }

    /// The values for m ≥ 0 only, in the order l(l+1)/2 + m: a function that is even in azimuth needs no others. `out`
    /// has N(N+1)/2 places.
    pub(crate) fn fill_even(&self, d: [f64; 3], out: &mut [f64]) {
        let (mut cos, mut sin) = (1.0, 0.0);
        for (m, order) in self.orders.iter().enumerate() {
            self.walk(m, order, d[2], |l, v| out[l * (l + 1) / 2 + m] = v * cos);
            (cos, sin) = (cos * d[0] - sin * d[1], cos * d[1] + sin * d[0]);
        }
    }

    /// Values of one order without their (x + iy)^m.
    #[inline(always)]
    fn walk(&self, m: usize, order: &Order, z: f64, mut put: impl FnMut(usize, f64)) {
        let (mut before, mut value) = (0.0, order.first);
        put(m, value);
        for (k, [alpha, beta]) in order.steps.iter().enumerate() {
            (before, value) = (value, alpha * (z * value - beta * before));
            put(m + 1 + k, value);
        }
    }

    /// Σ c_lm Y_lm(d). `c` may have more or fewer bands than the basis; the bands that both have are used.
    pub fn sum(&self, c: &HarmonicCoefficients, d: [f64; 3]) -> [f64; 3] {
        let mut out = [0.0; 3];
        let bands = self.bands.min(c.bands());
        let (mut cos, mut sin) = (1.0, 0.0);
        for (m, order) in self.orders.iter().enumerate().take(bands) {
            self.walk(m, order, d[2], |l, v| {
                if l < bands {
                    let (plus, minus) = (c.values[l * (l + 1) + m], c.values[l * (l + 1) - m]);
                    for k in 0..3 {
                        out[k] += v * if m == 0 { plus[k] } else { cos * plus[k] + sin * minus[k] };
                    }
                }
            });
            (cos, sin) = (cos * d[0] - sin * d[1], cos * d[1] + sin * d[0]);
        }
        out
    }
}

/// Σ c_lm Y_lm(d) in the unit direction `d`. For many directions make a [`HarmonicBasis`] once.
pub fn evaluate(c: &HarmonicCoefficients, d: [f64; 3]) -> [f64; 3] {
    HarmonicBasis::new(c.bands().max(1)).sum(c, d)
}

/// The coefficients of the function turned about z by `phi` (counter-clockwise seen from above: +x goes to +y). Exact:
/// Habel 2009 Eq. 5.2 with the signs of this basis, c′_m = c_m cos mφ − c_−m sin mφ, c′_−m = c_−m cos mφ + c_m sin mφ.
pub fn rotate_z(c: &HarmonicCoefficients, phi: f64) -> HarmonicCoefficients {
    let mut turned = c.clone();
    for m in 1..c.bands() {
        let (sin, cos) = (m as f64 * phi).sin_cos();
        for l in m..c.bands() {
            let (p, q) = (l * (l + 1) + m, l * (l + 1) - m);
            for k in 0..3 {
                let (plus, minus) = (c.values[p][k], c.values[q][k]);
                turned.values[p][k] = plus * cos - minus * sin;
                turned.values[q][k] = minus * cos + plus * sin;
            }
        }
    }
    turned
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quadrature::gauss;

    fn direction(z: f64, phi: f64) -> [f64; 3] {
        let s = (1.0 - z * z).sqrt();
        [s * phi.cos(), s * phi.sin(), z]
    }

    /// ∫ Y_i Y_j over the sphere by a product rule that is exact for these degrees.
    fn gram_error(bands: usize) -> f64 {
        let basis = HarmonicBasis::new(bands);
        let (nodes, turns) = (gauss(bands), 2 * bands);
        let n = bands * bands;
        let mut gram = vec![0.0; n * n];
        let mut y = vec![0.0; n];
        for &(z, w) in nodes.iter() {
            for k in 0..turns {
                basis.fill(direction(z, 2.0 * PI * (k as f64 + 0.3) / turns as f64), &mut y);
                let w = w * 2.0 * PI / turns as f64;
                for i in 0..n {
                    for j in 0..=i {
                        gram[i * n + j] += w * y[i] * y[j];
                    }
                }
            }
        }
        (0..n)
            .flat_map(|i| (0..=i).map(move |j| (i, j)))
            .map(|(i, j)| (gram[i * n + j] - f64::from(i == j)).abs())
            .fold(0.0, f64::max)
    }

    #[test]
    fn orthonormal_to_1e_13() {
        for bands in [1, 2, 7, 16] {
            let e = gram_error(bands);
            assert!(e < 1e-13, "{bands} bands: {e:.1e}");
        }
    }

    /// Closed forms of Ramamoorthi and Hanrahan 2001, all signs positive.
    #[test]
    fn the_first_nine_are_the_textbooks() {
        let d = [0.48, 0.6, 0.64];
        let [x, y, z] = d;
        let mut got = [0.0; 9];
        HarmonicBasis::new(3).fill(d, &mut got);
        let a = (15.0 / (4.0 * PI)).sqrt();
        let b = (3.0 / (4.0 * PI)).sqrt();
        let want = [
            (1.0 / (4.0 * PI)).sqrt(),
            b * y,
            b * z,
            b * x,
            a * x * y,
            a * y * z,
            (5.0 / (16.0 * PI)).sqrt() * (3.0 * z * z - 1.0),
            a * x * z,
            0.5 * a * (x * x - y * y),
        ];
        for k in 0..9 {
            assert!((got[k] - want[k]).abs() < 1e-15, "{k}: {} {}", got[k], want[k]);
        }
    }

    /// Σ_m Y_lm² = (2l+1)/(4π) in every direction (Unsöld), for a degree far beyond use.
    #[test]
    fn unsoeld_holds_at_high_degree_and_at_the_poles() {
        let bands = MOST_BANDS;
        let mut y = vec![0.0; bands * bands];
        for z in [-1.0, -0.3, 0.0, 1e-9, 0.77, 0.999_999_9, 1.0] {
            HarmonicBasis::new(bands).fill(direction(z, 1.1), &mut y);
            for l in 0..bands {
                let sum: f64 = y[l * l..(l + 1) * (l + 1)].iter().map(|v| v * v).sum();
                let want = (2 * l + 1) as f64 / (4.0 * PI);
                assert!((sum / want - 1.0).abs() < 1e-12, "l {l}, z {z}: {sum} {want}");
            }
        }
    }

    #[test]
    fn turning_the_coefficients_turns_the_function() {
        let mut c = HarmonicCoefficients::zero(7);
        for (k, v) in c.values_mut().iter_mut().enumerate() {
            *v = [(k as f64 * 0.7).sin(), (k as f64 * 1.3).cos(), 0.1 * k as f64];
        }
        let turned = rotate_z(&c, 0.9);
        for (z, phi) in [(0.2, 0.0), (-0.7, 2.0), (0.95, -1.0)] {
            let (a, b) = (evaluate(&turned, direction(z, phi + 0.9)), evaluate(&c, direction(z, phi)));
            for k in 0..3 {
                assert!((a[k] - b[k]).abs() < 1e-13, "{a:?} {b:?}");
            }
        }
        let back = rotate_z(&turned, -0.9);
        assert!(back.distance(&c).iter().all(|d| *d < 1e-14));
    }

    #[test]
    fn sums_even_parts_and_sizes_agree() {
        let basis = HarmonicBasis::new(6);
        let d = direction(0.4, 0.8);
        let (mut all, mut even) = (vec![0.0; 36], vec![0.0; 21]);
        basis.fill(d, &mut all);
        basis.fill_even(d, &mut even);
        for l in 0..6 {
            for m in 0..=l {
                assert_eq!(all[l * (l + 1) + m], even[l * (l + 1) / 2 + m]);
            }
        }
        let mut c = HarmonicCoefficients::zero(8);
        c.values_mut().iter_mut().enumerate().for_each(|(k, v)| *v = [1.0 / (1 + k) as f64; 3]);
        let want: f64 = (0..36).map(|k| all[k] / (1 + k) as f64).sum();
        assert!((basis.sum(&c, d)[1] - want).abs() < 1e-14);
        assert!((evaluate(&c.truncated(6), d)[0] - want).abs() < 1e-14);
        assert_eq!(c.truncated(9).get(8, 0), [0.0; 3]);
    }
}
