//! The slab by discrete ordinates, solved in closed form mode by mode.
//!
//! The kernel is isotropic. So the eigenproblem is a rank-one change of a diagonal (one secular equation), and the
//! matrix of a single boundary is a Cauchy matrix, whose inverse is known as products. There remains a small system
//! that couples the two boundaries through the modes that survive the crossing. No growing exponential is ever formed,
//! ω = 1 (where two modes merge) is an ordinary point, and the transmittance of a thick slab keeps its relative
//! accuracy.
//!
//! The ordinates are Gauss–Legendre in s with μ = 1 − (1 − s³)². This concentrates nodes at μ = 0 (the radiance is like
//! μ ln μ there) and at μ = 1 (the Case pole 1/ν₀ comes close when ω is small).

use super::quadrature::gauss;
use super::roots::{first_root, next_root};
use std::sync::OnceLock;

/// Number of ordinates in a hemisphere that [`modes`] uses.
pub const N: usize = 40;
/// Modes that are weaker than e^−CUT after the crossing do not couple the boundaries.
const CUT: f64 = 42.0;

pub(super) struct Ordinates<const N: usize> {
    /// In descending order, so that the poles 1/μ² ascend.
    pub mu: [f64; N],
    /// Weights.
    pub w: [f64; N],
    /// 1 − μ_i²/μ_j², computed without cancellation: `gap[j][i]`.
    pub gap: [[f64; N]; N],
    /// ⟨μ²⟩.
    pub mean_square: f64,
}

fn ordinates() -> &'static Ordinates<N> {
    static ORDINATES: OnceLock<Box<Ordinates<N>>> = OnceLock::new();
    ORDINATES.get_or_init(Ordinates::new)
}

impl<const N: usize> Ordinates<N> {
    fn new() -> Box<Ordinates<N>> {
        let mut o = Box::new(Ordinates { mu: [0.0; N], w: [0.0; N], gap: [[0.0; N]; N], mean_square: 0.0 });
        let rule: Vec<_> = gauss(N).into_iter().rev().collect();
        let m: Vec<f64> = rule.iter().map(|q| (1.0 - q.x) * (1.0 + q.x + q.x * q.x)).collect();
        for (i, q) in rule.iter().enumerate() {
            o.mu[i] = q.x.powi(3) * (1.0 + m[i]);
            o.w[i] = q.w * 6.0 * q.x * q.x * m[i];
        }
        for j in 0..N {
            for i in 0..N {
                let (a, b) = (rule[j].x, rule[i].x);
                let rise = (a - b) * (a * a + a * b + b * b); // s_j³ − s_i³ = m_i − m_j
                o.gap[j][i] = rise * (m[i] + m[j]) * (o.mu[j] + o.mu[i]) / (o.mu[j] * o.mu[j]);
            }
        }
        o.mean_square = (0..N).map(|i| o.w[i] * o.mu[i] * o.mu[i]).sum();
        o
    }
}

/// The decay constants of one single-scattering albedo: S ∝ e^(±kτ) solves the equation of transfer at these ordinates.
pub(super) struct Eigen<const N: usize> {
    /// In ascending order; k[0] may be 0.
    pub k: [f64; N],
    /// 1 − k_α²μ_i², without cancellation: `d[α][i]`.
    pub d: [[f64; N]; N],
}

impl<const N: usize> Eigen<N> {
    /// For the albedo `omega` > 0. `absorbed` = 1 − omega is passed separately so that it keeps its digits.
    pub fn new(o: &Ordinates<N>, omega: f64, absorbed: f64) -> Eigen<N> {
        let mut d = [[0.0; N]; N];
        let mut k = [0.0; N];
        for j in 0..N {
            let found = if j == 0 { first_root(o, omega, absorbed) } else { next_root(o, omega, j) };
            // found = (k²μ_j², y = 1 − k²μ_j²)
            k[j] = found.0.sqrt() / o.mu[j];
            for i in 0..N {
                let ratio = 1.0 - o.gap[j][i];
                d[j][i] = if i == j {
                    found.1
                } else if j == 0 {
                    1.0 - found.0 * ratio
                } else {
                    o.gap[j][i] + found.1 * ratio
                };
            }
            if j == 0 && found.0 > 0.5 {
                for i in 1..N {
                    d[0][i] = o.gap[0][i] + found.1 * (1.0 - o.gap[0][i]);
                }
            }
        }
        Eigen { k, d }
    }
}

/// The modes e^(−kτ) of one single-scattering albedo, and the coefficients of one boundary.
pub struct OrdinateModes<const N: usize> {
    /// In ascending order; k[0] may be 0.
    k: [f64; N],
    /// Π_i(1−k_αμ_i) / Π_{β≠α,0}(1−k_α/k_β): the half space's amplitudes, without the factor of mode 0
    a: [f64; N],
    /// Π_{γ≠0}(1+k_β/k_γ) / Π_i(1+k_βμ_i)
    b: [f64; N],
    /// −ln M₀₀/k₀ − Δ: twice the extrapolated distance
    extrapolation: f64,
}

impl<const N: usize> OrdinateModes<N> {
    /// Modes of albedo `omega` > 0. `absorbed` = 1 − omega is passed separately so that it keeps its digits.
    fn new(o: &Ordinates<N>, omega: f64, absorbed: f64) -> OrdinateModes<N> {
        let Eigen { k, d } = Eigen::new(o, omega, absorbed);
        let (mut a, mut b) = ([0.0; N], [0.0; N]);
        let inverse_k: [f64; N] = std::array::from_fn(|i| if i == 0 { 0.0 } else { 1.0 / k[i] });
        let inverse_pole: [f64; N] = std::array::from_fn(|i| if i == 0 { 0.0 } else { 1.0 / (1.0 - d[i][i]) });
        for j in 0..N {
            // Π (1+k_j/k_i) and Π (1+k_jμ_i) stay far from overflow: k_jμ_i is below 1e6
            let (mut sums, mut cosines, mut up) = (1.0, 1.0 + k[j] * o.mu[0], 1.0);
            for i in 1..N {
                sums *= 1.0 + k[j] * inverse_k[i];
                cosines *= 1.0 + k[j] * o.mu[i];
            }
            for i in (1..N).filter(|&i| i != j) {
                // (1 − k_j²μ_i²)/(1 − k_j²/k_i²), the latter from the two distances to the pole 1/μ_i²
                up *= d[j][i] / ((d[j][i] - d[i][i]) * inverse_pole[i]);
            }
            b[j] = sums / cosines;
            // 1 − k_jμ_i = (1 − k_j²μ_i²)/(1 + k_jμ_i), and likewise 1 − k_j/k_i; i = j and i = 0 have no partner in
            // the product above
            a[j] = up * d[j][j] * b[j] * if j == 0 { 1.0 } else { 0.5 * d[j][0] };
        }
        // Σ 2 atanh(k₀μ_i) − Σ 2 atanh(k₀/k_γ), over k₀
        let k0 = k[0];
        let mut extrapolation = 2.0 * atanh_over(k0, o.mu[0], d[0][0]);
        for i in 1..N {
            let apart = (d[0][i] - d[i][i]) / (1.0 - d[i][i]);
            extrapolation += 2.0 * (atanh_over(k0, o.mu[i], d[0][i]) - atanh_over(k0, 1.0 / k[i], apart));
        }
        OrdinateModes { k, a, b, extrapolation }
    }

    /// Half-space amplitude of mode α.
    fn half_space(&self, i: usize) -> f64 {
        if i == 0 { self.a[0] } else { self.a[i] * self.k[0] / (self.k[0] - self.k[i]) }
    }

    /// Coupling M_αβ of the boundaries without its factor e^(−k_βΔ). Column 0 is divided by k₀.
    fn coupling(&self, i: usize, j: usize) -> f64 {
        let k = &self.k;
        match (i, j) {
            (0, 0) => f64::NAN, // the callers take M₀₀ from `extrapolation`
            (0, _) => self.a[0] * self.b[j],
            (_, 0) => k[i] / (k[i] + k[0]) / (k[0] - k[i]) * self.a[i] * 2.0 * self.b[0],
            _ => k[i] / (k[i] + k[j]) * (k[0] + k[j]) / (k[0] - k[i]) * self.a[i] * self.b[j],
        }
    }

    /// ρd and ln ρt of the slab of optical thickness `delta` for a beam at cosine `mu0`.
    pub fn response(&self, delta: f64, mu0: f64) -> (f64, f64) {
        if self.k[0] * delta > 4.0 {
            self.far_boundaries(delta, 1.0 / mu0)
        } else {
            self.near_boundaries(delta, 1.0 / mu0)
        }
    }

    /// How many modes couple the boundaries: those whose light at the other side is not negligible compared with
    /// e^(−slow Δ).
    fn active(&self, delta: f64, slow: f64) -> usize {
        (0..N).take_while(|&i| i == 0 || (self.k[i] - slow) * delta < CUT).count()
    }

    /// The far boundary is a small correction, so A = A₀ − M B and B = −M A are solved by iteration. What crosses the
    /// slab has the factor e^(−slow Δ), which is kept separately. So the transmittance may underflow while its
    /// logarithm does not.
    fn far_boundaries(&self, delta: f64, c: f64) -> (f64, f64) {
        let slow = self.k[0].min(c);
        let active = self.active(delta, slow);
        let crossing: Vec<f64> = (0..active).map(|i| (-(self.k[i] - slow) * delta).exp()).collect();
        let m00 = (-self.k[0] * self.extrapolation).exp() * crossing[0];
        let apply = |v: &[f64], i: usize| {
            let first = if i == 0 { m00 } else { self.coupling(i, 0) * self.k[0] * crossing[0] };
            first * v[0] + (1..active).map(|j| self.coupling(i, j) * crossing[j] * v[j]).sum::<f64>()
        };
        let scale = (-slow * delta).exp();
        let mut a: Vec<f64> = (0..active).map(|i| self.half_space(i)).collect();
        // b is B e^(slow Δ)
        let mut b = vec![0.0; active];
        for _ in 0..60 {
            let old = (a[0], b[0]);
            b = (0..active).map(|i| -apply(&a, i)).collect();
            a = (0..active).map(|i| self.half_space(i) - scale * scale * apply(&b, i)).collect();
            if (a[0] - old.0).abs() <= 1e-17 * a[0].abs() && (b[0] - old.1).abs() <= 1e-16 * b[0].abs() {
                break;
            }
        }
        let (mut rho_d, mut crossed) = (0.0, (-(c - slow) * delta).exp());
        for i in 0..N {
            let k = self.k[i];
            let (ai, bi) = if i < active {
                (a[i], b[i])
            } else {
                (self.half_space(i) - scale * scale * apply(&b, i), -apply(&a, i))
            };
            let (near, far) = (near_exit(k, delta, c), far_exit(k, delta, c, slow));
            rho_d += ai * near + scale * scale * bi * far;
            crossed += ai * far + bi * near;
        }
        (rho_d, crossed.ln() - slow * delta)
    }

    /// Solves for even and odd parts, (1+M)(A+B) = A₀ and (1−M)(A−B) = A₀. The odd amplitude of mode 0 is x/k₀, so that
    /// k₀ = 0 is an ordinary point.
    fn near_boundaries(&self, delta: f64, c: f64) -> (f64, f64) {
        let active = self.active(delta, 0.0);
        let k0 = self.k[0];
        let crossing: Vec<f64> = (0..active).map(|i| (-self.k[i] * delta).exp()).collect();
        let log_m00 = -k0 * (delta + self.extrapolation);
        let m = |i: usize, j: usize| self.coupling(i, j) * crossing[j];
        let half: Vec<f64> = (0..active).map(|i| self.half_space(i)).collect();
        let mut even = vec![0.0; active * active];
        let mut odd = vec![0.0; active * active];
        for i in 0..active {
            for j in 0..active {
                let (e, o) = match (i, j) {
                    (0, 0) => (
                        1.0 + log_m00.exp(),
                        if k0 > 0.0 { -log_m00.exp_m1() / k0 } else { delta + self.extrapolation },
                    ),
                    (_, 0) => (m(i, 0) * k0, -m(i, 0)),
                    _ => {
                        let unit = if i == j { 1.0 } else { 0.0 };
                        (unit + m(i, j), unit - m(i, j))
                    }
                };
                even[i * active + j] = e;
                odd[i * active + j] = o;
            }
        }
        let e = solve_dense(even, half.clone());
        let o = solve_dense(odd, half);
        // S = ½ Σ E (e^(−kτ) + e^(−k(Δ−τ))) + ½ Σ O (e^(−kτ) − e^(−k(Δ−τ)))
        let (mut sum, mut difference) = (0.0, 0.0);
        for i in 0..N {
            let (near, far) = (near_exit(self.k[i], delta, c), far_exit(self.k[i], delta, c, 0.0));
            let (ei, oi) = if i < active {
                (e[i], o[i])
            } else {
                let h = self.half_space(i);
                let rest = |v: &[f64]| (1..active).map(|j| m(i, j) * v[j]).sum::<f64>();
                (h - m(i, 0) * k0 * e[0] - rest(&e), h + m(i, 0) * o[0] + rest(&o))
            };
            sum += ei * (near + far);
            difference += oi * if i == 0 { odd_exit(k0, delta, c) } else { near - far };
        }
        (0.5 * (sum + difference), ((-c * delta).exp() + 0.5 * (sum - difference)).ln())
    }
}

/// ∫₀^Δ e^(−kτ) c e^(−cτ) dτ.
pub(super) fn near_exit(k: f64, delta: f64, c: f64) -> f64 {
    -c * (-(k + c) * delta).exp_m1() / (k + c)
}

/// e^(slow Δ) ∫₀^Δ e^(−k(Δ−τ)) c e^(−cτ) dτ, slow ≤ k and ≤ c.
pub(super) fn far_exit(k: f64, delta: f64, c: f64, slow: f64) -> f64 {
    let gap = (c - k).abs();
    let decay = (-(c.min(k) - slow) * delta).exp();
    if gap * delta < 1e-300 { c * delta * decay } else { -c * decay * (-gap * delta).exp_m1() / gap }
}

/// (near − far)/k for the mode whose k may be 0.
pub(super) fn odd_exit(k: f64, delta: f64, c: f64) -> f64 {
    if k > 0.5 * c.min(1.0) {
        return (near_exit(k, delta, c) - far_exit(k, delta, c, 0.0)) / k;
    }
    let ratio =
        if k * delta < 1e-5 { 0.5 * delta * (1.0 - (k * delta).powi(2) / 12.0) } else { (0.5 * k * delta).tanh() / k };
    c * (1.0 + (-k * delta).exp()) * (1.0 + (-c * delta).exp()) / ((c - k) * (c + k))
        * (c * ratio - (0.5 * c * delta).tanh())
}

/// atanh(k m)/k with 1 − k²m² given.
fn atanh_over(k: f64, m: f64, d: f64) -> f64 {
    let x = k * m;
    if x < 1e-4 {
        m * (1.0 + x * x / 3.0 + x.powi(4) / 5.0)
    } else if x < 0.5 {
        x.atanh() / k
    } else {
        0.5 * ((1.0 + x).powi(2) / d).ln() / k
    }
}

/// Gaussian elimination with partial pivoting of a row-major matrix.
fn solve_dense(mut m: Vec<f64>, mut v: Vec<f64>) -> Vec<f64> {
    let n = v.len();
    for k in 0..n {
        let mut p = k;
        for i in k + 1..n {
            if m[i * n + k].abs() > m[p * n + k].abs() {
                p = i;
            }
        }
        if p != k {
            for j in k..n {
                m.swap(k * n + j, p * n + j);
            }
            v.swap(k, p);
        }
        let (top, rest) = m.split_at_mut((k + 1) * n);
        let pivot = &top[k * n..];
        for (i, row) in rest.chunks_exact_mut(n).enumerate() {
            let f = row[k] / pivot[k];
            if f != 0.0 {
                for (x, y) in row[k + 1..].iter_mut().zip(&pivot[k + 1..]) {
                    *x -= f * y;
                }
                v[k + 1 + i] -= f * v[k];
            }
        }
    }
    for i in (0..n).rev() {
        let tail: f64 = (i + 1..n).map(|j| m[i * n + j] * v[j]).sum();
        v[i] = (v[i] - tail) / m[i * n + i];
    }
    v
}

/// The modes of albedo ω; 1 − ω is passed separately.
pub(crate) fn modes(omega: f64, absorbed: f64) -> OrdinateModes<N> {
    OrdinateModes::new(ordinates(), omega, absorbed)
}

/// A solver with `K` ordinates in a hemisphere, for the sweep over their number. It takes (ω, 1 − ω, Δ), with the beam
/// along the normal.
pub fn with_ordinates<const K: usize>() -> impl Fn(f64, f64, f64) -> (f64, f64) {
    let o: Box<Ordinates<K>> = Ordinates::new();
    move |omega, absorbed, delta| OrdinateModes::new(&o, omega, absorbed).response(delta, 1.0)
}
