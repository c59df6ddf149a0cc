//! The slab of another index than its surroundings, whose faces reflect as Fresnel's equations say.
//!
//! A collimated beam meets the upper face from air. Inside, light that meets a face more obliquely than the critical
//! angle is reflected totally; of the rest, the face reflects r(μ) for unpolarised light and lets the remainder out.
//! The mirror reflection of the upper face, and of the lower one where the beam still reaches it, is part of the
//! reflectance, as an integrating sphere measures it. Scattering inside is isotropic.
//!
//! By reciprocity, what a beam sends into a hemisphere is the radiance that leaves against the beam under isotropic
//! unit radiance from that side. So the beam needs no source of its own: the source function S(τ) is a sum of modes
//! e^(±kτ) ([`super::ordinates`]) whose amplitudes follow from the two faces, I(0, μ) = (1−r) L + r I(0, −μ). The
//! beam's own path back and forth is added in closed form. The ordinates are split at the critical angle, and above it
//! they are spread over the cosine in air, in which r(μ) is smooth.
//!
//! R and T follow from light on both faces (R + T) and from light of opposite sign (R − T); a slab that hardly anything
//! crosses is solved from its two faces instead, so that T keeps its digits. What is absorbed is computed on its own
//! and not as 1 − R − T, so that it keeps its digits where ω is near 1.

use super::SlabResponse;
use super::ordinates::{Eigen, Ordinates, far_exit, near_exit, odd_exit};
use super::quadrature::gauss;
use mesophyll_base::surface::gloss::fresnel;

/// Indices that the ordinates are made for.
pub const INDEX: std::ops::RangeInclusive<f64> = 1.0..=3.0;
/// The same in words, for messages.
pub const INDEX_EXPECTED: &str = "1 (the index of the surroundings) to 3";

/// Ordinates in a hemisphere: beyond the critical angle, within it, and all.
const TRAPPED: usize = 16;
const FREE: usize = 24;
const N: usize = TRAPPED + FREE;
/// Slabs with k₀Δ above this are solved from their two faces.
const APART: f64 = 4.0;

/// Two plane faces between air and a slab of one index, and a beam that arrives at one angle.
pub struct SlabFaces {
    /// Reflectance of a face for the beam.
    mirror: f64,
    /// 1/cosine of the beam inside.
    slant: f64,
    rule: Box<Ordinates<N>>,
    /// Reflectance of a face from inside, for each ordinate.
    reflected: [f64; N],
}

/// Where the light of a beam goes; the parts sum to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaceShares {
    /// Reflected without being scattered, by both faces.
    pub mirrored: f64,
    /// Scattered at least once and reflected.
    pub scattered_back: f64,
    /// Transmitted without being scattered.
    pub passed: f64,
    /// Scattered at least once and transmitted.
    pub scattered_on: f64,
    /// ln of the whole transmittance; finite where that itself underflows.
    pub log_t: f64,
    /// Absorbed.
    pub lost: f64,
}

impl FaceShares {
    /// All that is reflected and all that is transmitted.
    pub fn response(&self) -> SlabResponse {
        SlabResponse { rho_d: self.mirrored + self.scattered_back, rho_t: self.log_t.exp() }
    }
}

impl SlabFaces {
    /// Faces of `index` ≥ 1 for a beam in air at the cosine `mu0` (0 < mu0 ≤ 1).
    pub fn new(index: f64, mu0: f64) -> SlabFaces {
        let n2 = index * index;
        // the square of the critical angle's cosine
        let critical2 = (index - 1.0) * (index + 1.0) / n2;
        let critical = critical2.sqrt();
        // μ, μ² − critical², weight and reflectance. Next to the critical angle neighbours differ by less than the
        // digits of μ show.
        let mut nodes: Vec<[f64; 4]> = Vec::with_capacity(N);
        for q in gauss(FREE) {
            // cosine in air, 1 − (1 − s³)²
            let m = (1.0 - q.x) * (1.0 + q.x + q.x * q.x);
            let out = q.x.powi(3) * (1.0 + m);
            let mu = (critical2 + out * out / n2).sqrt();
            nodes.push([mu, out * out / n2, q.w * 6.0 * q.x * q.x * m * out / (n2 * mu), fresnel(out, index)]);
        }
        // The map is no polynomial; with weights that sum to the width of the interval, ω = 1 conserves light exactly.
        let whole: f64 = nodes.iter().map(|n| n[2]).sum();
        for n in &mut nodes {
            n[2] *= (1.0 - critical) / whole;
        }
        for q in gauss(TRAPPED) {
            let mu = critical * q.x.powi(3);
            nodes.push([mu, critical2 * (q.x.powi(6) - 1.0), critical * q.w * 3.0 * q.x * q.x, 1.0]);
        }
        nodes.sort_by(|a, b| b[1].total_cmp(&a[1]));
        let mut rule = Box::new(Ordinates { mu: [0.0; N], w: [0.0; N], gap: [[0.0; N]; N], mean_square: 0.0 });
        let mut reflected = [0.0; N];
        for (i, n) in nodes.iter().enumerate() {
            (rule.mu[i], rule.w[i], reflected[i]) = (n[0], n[2], n[3]);
        }
        for j in 0..N {
            let square = rule.mu[j] * rule.mu[j];
            for i in 0..N {
                let [a, b] = [nodes[j], nodes[i]];
                let rise = if j.min(i) < FREE { a[1] - b[1] } else { (a[0] - b[0]) * (a[0] + b[0]) };
                rule.gap[j][i] = rise / square;
            }
            rule.mean_square += rule.w[j] * square;
        }
        let inside = (critical2 + mu0 * mu0 / n2).sqrt();
        SlabFaces { mirror: fresnel(mu0, index), slant: 1.0 / inside, rule, reflected }
    }

    /// The shares at single-scattering albedo `omega` and optical thickness `delta` ≥ 0; `absorbed` = 1 − omega is
    /// passed separately, so that it keeps its digits.
    pub fn shares(&self, omega: f64, absorbed: f64, delta: f64) -> FaceShares {
        let (r, c) = (self.mirror, self.slant);
        let through = (-c * delta).exp();
        let round = 1.0 - (r * through).powi(2);
        let passed = (1.0 - r) * (1.0 - r) * through / round;
        let mirrored = r + r * through * passed;
        let clear = FaceShares {
            mirrored,
            scattered_back: 0.0,
            passed,
            scattered_on: 0.0,
            log_t: ((1.0 - r) * (1.0 - r) / round).ln() - c * delta,
            lost: (1.0 - r) * -(-c * delta).exp_m1() / (1.0 - r * through),
        };
        if omega == 0.0 || delta == 0.0 {
            return clear;
        }
        let eigen = Eigen::new(&self.rule, omega, absorbed);
        if eigen.k[0] * delta > APART {
            self.far(&eigen, delta, clear)
        } else {
            self.near(&eigen, absorbed, delta, clear)
        }
    }

    /// Light of equal and of opposite sign on both faces.
    fn near(&self, eigen: &Eigen<N>, absorbed: f64, delta: f64, clear: FaceShares) -> FaceShares {
        let (k, d, mu, r) = (&eigen.k, &eigen.d, &self.rule.mu, &self.reflected);
        let (mut even, mut odd) = (Rows::new(), Rows::new());
        // tanh(kΔ/2), and the same over k
        let half: [f64; N] = std::array::from_fn(|j| (0.5 * k[j] * delta).tanh());
        let over: [f64; N] = std::array::from_fn(|j| if k[j] * delta > 1e-9 { half[j] / k[j] } else { 0.5 * delta });
        // Where little is absorbed, 1 − S is small. It is then solved for itself, as the slowest mode's difference from
        // 1 and a rest.
        let white = absorbed < 0.5;
        for i in 0..N {
            let (open, closed) = (1.0 - r[i], 1.0 + r[i]);
            for j in 0..N {
                let c = d[j][j] / d[j][i];
                even.m[i][j] = c * (open + k[j] * mu[i] * half[j] * closed);
                odd.m[i][j] = c * (over[j] * open + mu[i] * closed);
            }
            even.v[i] =
                if white { -(open * (k[0] * mu[i]).powi(2) + k[0] * mu[i] * half[0] * closed) / d[0][i] } else { open };
            odd.v[i] = open;
        }
        even.solve();
        odd.solve();
        let (c, through) = (self.slant, (-self.slant * delta).exp());
        let (mut sum, mut difference) = (0.0, 0.0);
        for j in 0..N {
            let mode = d[j][j] / (1.0 + (-k[j] * delta).exp());
            sum += even.v[j] * mode * (near_exit(k[j], delta, c) + far_exit(k[j], delta, c, 0.0));
            difference += odd.v[j] * mode * odd_exit(k[j], delta, c);
        }
        // ∫ S and ∫ (1−S) along the beam's way out
        let whole = -(-c * delta).exp_m1();
        let (back, missing) = if white {
            let missing = short_of_one(k[0], over[0], delta, c) - sum;
            (whole - missing, missing)
        } else {
            (sum, whole - sum)
        };
        let mirror = self.mirror;
        let both = (1.0 - mirror) * back / (1.0 - mirror * through);
        let apart = (1.0 - mirror) * difference / (1.0 + mirror * through);
        let scattered_on = 0.5 * (both - apart);
        FaceShares {
            scattered_back: 0.5 * (both + apart),
            scattered_on,
            log_t: (clear.passed + scattered_on).ln(),
            lost: (1.0 - mirror) * missing / (1.0 - mirror * through),
            ..clear
        }
    }

    /// Each face by itself, coupled by what crosses the slab, which has the factor e^(−slow Δ).
    fn far(&self, eigen: &Eigen<N>, delta: f64, clear: FaceShares) -> FaceShares {
        let (k, d, mu, r) = (&eigen.k, &eigen.d, &self.rule.mu, &self.reflected);
        let c = self.slant;
        let slow = k[0].min(c);
        let scale = (-slow * delta).exp();
        let crossing: [f64; N] = std::array::from_fn(|j| (-(k[j] - slow) * delta).exp());
        let mut face = Rows::new();
        let mut other = [[0.0; N]; N];
        for i in 0..N {
            for j in 0..N {
                let (c, x) = (d[j][j] / d[j][i], k[j] * mu[i]);
                face.m[i][j] = c * ((1.0 + x) - r[i] * (1.0 - x));
                other[i][j] = c * ((1.0 - x) - r[i] * (1.0 + x)) * crossing[j];
            }
        }
        let factors = face.factor();
        let solve = |v: [f64; N]| factors.solve(v);
        let cross = |v: &[f64; N]| -> [f64; N] {
            std::array::from_fn(|i| -other[i].iter().zip(v).map(|(m, x)| m * x).sum::<f64>())
        };
        let light: [f64; N] = std::array::from_fn(|i| 1.0 - r[i]);
        let mut near = solve(light);
        // the far amplitudes times e^(slow Δ)
        let mut far = [0.0; N];
        for _ in 0..20 {
            let old = near;
            far = solve(cross(&near));
            let back = cross(&far);
            near = solve(std::array::from_fn(|i| light[i] + scale * scale * back[i]));
            if near.iter().zip(&old).all(|(a, b)| (a - b).abs() <= 1e-15 * a.abs()) {
                break;
            }
        }
        // S along the beam's way out of the near and of the far face; the latter times e^(slow Δ)
        let (mut up, mut down) = (0.0, 0.0);
        for j in 0..N {
            let (close, away) = (near_exit(k[j], delta, c), far_exit(k[j], delta, c, slow));
            up += d[j][j] * (near[j] * close + scale * scale * far[j] * away);
            down += d[j][j] * (near[j] * away + far[j] * close);
        }
        let mirror = self.mirror;
        let through = (-(c - slow) * delta).exp();
        let round = 1.0 - (mirror * through * scale).powi(2);
        let scattered_on = (1.0 - mirror) * (down + mirror * through * up) / round;
        let scattered_back =
            (1.0 - mirror) * (up + mirror * through * scale * scale * (down + mirror * through * up) / round);
        let passed = (1.0 - mirror).powi(2) * through / round;
        let log_t = (passed + scattered_on).ln() - slow * delta;
        FaceShares {
            scattered_back,
            scattered_on: scattered_on * scale,
            log_t,
            lost: 1.0 - clear.mirrored - scattered_back - log_t.exp(),
            ..clear
        }
    }
}

/// ∫₀^Δ (1 − cosh(k(τ−Δ/2))/cosh(kΔ/2)) c e^(−cτ) dτ for k < c, with tanh(kΔ/2)/k given.
fn short_of_one(k: f64, over: f64, delta: f64, c: f64) -> f64 {
    (1.0 + (-c * delta).exp()) * k * k * (c * over - (0.5 * c * delta).tanh()) / ((c - k) * (c + k))
}

/// A dense system, solved by elimination with row scaling and partial pivoting.
struct Rows {
    m: Box<[[f64; N]; N]>,
    v: [f64; N],
}

/// Factors of a matrix.
struct Factors {
    m: Box<[[f64; N]; N]>,
    scale: [f64; N],
    order: [usize; N],
}

impl Rows {
    fn new() -> Rows {
        Rows { m: Box::new([[0.0; N]; N]), v: [0.0; N] }
    }

    fn factor(mut self) -> Factors {
        let mut scale = [0.0; N];
        for (row, s) in self.m.iter_mut().zip(&mut scale) {
            *s = 1.0 / row.iter().fold(0.0_f64, |a, x| a.max(x.abs()));
            row.iter_mut().for_each(|x| *x *= *s);
        }
        let mut order: [usize; N] = std::array::from_fn(|i| i);
        let m = &mut self.m;
        for k in 0..N {
            let p = (k..N).fold(k, |p, i| if m[i][k].abs() > m[p][k].abs() { i } else { p });
            m.swap(k, p);
            order.swap(k, p);
            let (top, rest) = m.split_at_mut(k + 1);
            let pivot = &top[k];
            for row in rest {
                let f = row[k] / pivot[k];
                row[k] = f;
                for (x, y) in row[k + 1..].iter_mut().zip(&pivot[k + 1..]) {
                    *x -= f * y;
                }
            }
        }
        Factors { m: self.m, scale, order }
    }

    /// Replaces `v` by the solution.
    fn solve(&mut self) {
        let rows = Rows { m: std::mem::replace(&mut self.m, Box::new([[0.0; N]; N])), v: self.v };
        self.v = rows.factor().solve(self.v);
    }
}

impl Factors {
    fn solve(&self, v: [f64; N]) -> [f64; N] {
        let mut x: [f64; N] = std::array::from_fn(|i| v[self.order[i]] * self.scale[self.order[i]]);
        for i in 0..N {
            for j in 0..i {
                x[i] -= self.m[i][j] * x[j];
            }
        }
        for i in (0..N).rev() {
            for j in i + 1..N {
                x[i] -= self.m[i][j] * x[j];
            }
            x[i] /= self.m[i][i];
        }
        x
    }
}

#[cfg(test)]
#[path = "faces_tests.rs"]
mod tests;
