//! The bent axis of a tapered branch, exactly, however far it bends: Euler's elastica.
//!
//! A branch is clamped level at its root, does not stretch, and carries a load F that keeps its direction, across the
//! straight branch ([`Load`]). θ(t) is the angle of the axis to the straight one at the place t along the branch, 0
//! (root) to 1 (tip). With the length as the unit, w = 1 + (α−1)t the radius over the root's, A = F/(E′r₁⁴) over the
//! length as in [`crate::mechanics::beam`], and v(t) the share of the load that hangs beyond t,
//!
//! ```text
//! w⁴ θ′ = m,    m′ = −(4A/π) v cos θ,    θ(0) = 0,    m(1) = 0
//! ```
//!
//! m is the bending moment over E I₁/L, with I₁ = π s₁⁴/4 (L. D. Landau and E. M. Lifshitz, *Theory of Elasticity*,
//! §19: rods of varying thickness have E I(t) in place of E I). For small A it is the linear beam of
//! [`crate::mechanics::beam`].
//!
//! The same curve minimises the energy ∫ ½ w⁴ θ′² − (4A/π) v sin θ dt. Its second derivative is positive wherever 0 ≤ θ
//! ≤ π, and a level branch never bends beyond the vertical; so there is one curve for each load that is reached from
//! rest, and Newton's method finds it. θ is a polynomial of degree 10 in each of a few elements of the taper's own
//! coordinate y ([`crate::mechanics::taper`]), in which it is smooth up to the tip of any taper. Places and angles are
//! within 1e-9 of the length, and of a radian, for tapers from .03 to [`crate::mechanics::beam::TAPER_MAX`] and tips
//! that move by up to .8 of the length; within 1e-6 for tapers from 1e-3.
//!
//! Limits: no shear (the branch at least 15 times as long as thick), no stretching, wood that stays elastic, and a
//! root that holds.

use crate::mechanics::length::AxisPoint;
use crate::mechanics::load::Load;
use crate::mechanics::taper::{TERMS, TaperShape, coordinate};
use mesophyll_base::chebyshev;
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::LazyLock;

/// Degree of θ in an element.
const DEGREE: usize = 10;
/// Values of θ in an element, those at both ends included.
const NODES: usize = DEGREE + 1;
/// Gauss points in an element: exact for the square of θ's slope times a weight of degree 9.
const POINTS: usize = 14;
/// Elements from root to tip, and under a load that bends the root sharply.
const ELEMENTS: [usize; 2] = [6, 14];
/// The amplitude A from which on the root is bent sharply: the tip of an untapered branch moves by half of its length.
const SHARP: f64 = 4.0;
/// Slope at most of the line on which a branch is continued beyond its tip.
const STEEP: f64 = 3.0;
/// Newton steps at most; five are usual.
const STEPS: usize = 60;

/// What one element needs, on (0, 1): values and slopes, at the Gauss points, of the polynomials that are 1 at one of
/// the Chebyshev points and 0 at the others.
struct Rule {
    points: [(f64, f64); POINTS],
    value: [[f64; NODES]; POINTS],
    slope: [[f64; NODES]; POINTS],
    /// Chebyshev coefficients (row) of those polynomials (column).
    series: [[f64; NODES]; NODES],
}

static RULE: LazyLock<Rule> = LazyLock::new(|| {
    let half = |k: usize| if k == 0 || k == DEGREE { 2.0 } else { 1.0 };
    // T_k at the j-th point −cos(πj/DEGREE), which ascend.
    let at = |k: usize, j: usize| (PI * (k * (DEGREE - j)) as f64 / DEGREE as f64).cos();
    let series: [[f64; NODES]; NODES] =
        std::array::from_fn(|k| std::array::from_fn(|j| 2.0 / DEGREE as f64 * at(k, j) / (half(k) * half(j))));
    let points: Vec<(f64, f64)> = mesophyll_base::quadrature::unit(POINTS);
    let table = |which: usize| {
        std::array::from_fn(|q| {
            std::array::from_fn(|j| {
                let column: [f64; NODES] = std::array::from_fn(|k| series[k][j]);
                sum_and_slope(&column, points[q].0)[which]
            })
        })
    };
    Rule { value: table(0), slope: table(1), points: std::array::from_fn(|q| points[q]), series }
});

/// A Chebyshev series on (0, 1) and its slope at `x`.
fn sum_and_slope(series: &[f64; NODES], x: f64) -> [f64; 2] {
    let z = 2.0 * x - 1.0;
    let (t, d) = chebyshev::slopes::<NODES>(z);
    let of = |values: [f64; NODES]| series.iter().zip(values).map(|(c, v)| c * v).sum::<f64>();
    [of(t), 2.0 * of(d)]
}

/// (eᶻ − 1)/z.
fn growth(z: f64) -> f64 {
    if z.abs() < 1e-5 { 1.0 + z / 2.0 + z * z / 6.0 } else { z.exp_m1() / z }
}

/// A bent branch.
#[derive(Debug, Clone, PartialEq)]
pub struct Elastica {
    load: Load,
    shape: TaperShape<f64>,
    /// F/(E′r₁⁴) over the length; its sign is the side to which the branch bends.
    amplitude: f64,
    /// Ends of the elements in y, from 0 to 1.
    ends: Vec<f64>,
    /// θ at the points of all elements, from root to tip; neighbours share one.
    theta: Vec<f64>,
    /// Chebyshev series of θ in each element.
    series: Vec<[f64; NODES]>,
    /// Place of each element's start, along and across.
    starts: Vec<[f64; 2]>,
}

impl Elastica {
    /// The axis under `load` with the taper `alpha` in (0, [`crate::mechanics::beam::TAPER_MAX`]] and A = `amplitude`,
    /// the load F/(E′r₁⁴) over the length; its sign is the side. `None` where these are not numbers of that range, or
    /// where the load is so great that no curve is found (above a thousand times what bends a branch noticeably). A
    /// place in mm has to be made a share first ([`Load::on`]).
    pub fn solve(load: Load, alpha: f64, amplitude: f64) -> Option<Elastica> {
        let fits = alpha > 0.0 && alpha <= crate::mechanics::beam::TAPER_MAX && amplitude.is_finite();
        let placed = match load {
            Load::Share(at) => at > 0.0 && at <= 1.0,
            Load::Millimetres(_) => false,
            _ => true,
        };
        if !(fits && placed) {
            return None;
        }
        let shape = TaperShape::new(alpha, [0.0; TERMS]);
        let count = ELEMENTS[usize::from(amplitude.abs() > SHARP)];
        let split = |n: usize, from: f64, to: f64| (1..=n).map(move |k| from + (to - from) * k as f64 / n as f64);
        let mut ends = vec![0.0];
        match load {
            // θ is not smooth where a single load hangs, so elements end there.
            Load::Share(at) if at < 1.0 => {
                let y = coordinate(&shape, at);
                let before = ((count as f64 * y).round() as usize).max(1);
                ends.extend(split(before, 0.0, y));
                ends.extend(split((count - before.min(count - 1)).max(1), y, 1.0));
            }
            _ => ends.extend(split(count, 0.0, 1.0)),
        }
        let mut beam =
            Elastica { load, shape, amplitude, ends, theta: Vec::new(), series: Vec::new(), starts: Vec::new() };
        beam.theta = vec![0.0; beam.elements() * DEGREE + 1];
        let system = beam.system();
        // The linear beam's slope, laid over to an angle, is near the answer.
        let (_, slope, curvature) = system.derivatives(&beam.theta);
        let linear = system.step(&slope, curvature)?;
        beam.theta.iter_mut().zip(linear).for_each(|(t, l)| *t = l.atan().max(0.0));
        beam.descend(&system)
    }

    /// [`Elastica::solve`] for a branch that differs little from this one, whose curve is where the search starts.
    pub fn near(&self, alpha: f64, amplitude: f64) -> Option<Elastica> {
        if matches!(self.load, Load::Share(at) if at < 1.0)
            || (amplitude.abs() > SHARP) != (self.amplitude.abs() > SHARP)
        {
            return Self::solve(self.load, alpha, amplitude);
        }
        let shape = TaperShape::new(alpha, [0.0; TERMS]);
        let beam = Elastica { shape, amplitude, ..self.clone() };
        let system = beam.system();
        beam.descend(&system)
    }

    fn elements(&self) -> usize {
        self.ends.len() - 1
    }

    /// Share of the load beyond y, in the element `k`.
    fn beyond(&self, k: usize, y: f64) -> f64 {
        let (alpha, ln) = (self.shape.alpha, self.shape.ln_alpha);
        // 1 − t, without cancellation at the tip.
        let rest = || alpha * self.shape.ell * (1.0 - y) * growth(-(1.0 - y) * ln);
        match self.load {
            Load::Even => rest(),
            Load::OwnWeight => {
                let w = (y * ln).exp();
                rest() * (w * w + w * alpha + alpha * alpha) / (1.0 + alpha + alpha * alpha)
            }
            Load::Share(at) if at < 1.0 && self.ends[k] >= coordinate(&self.shape, at) => 0.0,
            Load::Tip | Load::Share(_) | Load::Millimetres(_) => 1.0,
        }
    }

    fn system(&self) -> System {
        let rule = &*RULE;
        let kappa = 4.0 / PI * self.amplitude.abs();
        let (ln, ell) = (self.shape.ln_alpha, self.shape.ell);
        let mut system = System { stiffness: Vec::new(), loads: Vec::new() };
        for k in 0..self.elements() {
            let size = self.ends[k + 1] - self.ends[k];
            // dt = ℓ w dy, so that ½ w⁴ θ′² dt = ½ w³/ℓ (dθ/dy)² dy.
            let mut stiffness = [[0.0; NODES]; NODES];
            let mut loads = [0.0; POINTS];
            for (q, (x, g)) in rule.points.iter().enumerate() {
                let y = self.ends[k] + size * x;
                let w = (y * ln).exp();
                loads[q] = kappa * self.beyond(k, y) * ell * w * g * size;
                let weight = w * w * w / ell * g / size;
                for i in 0..NODES {
                    for j in 0..=i {
                        stiffness[i][j] += weight * rule.slope[q][i] * rule.slope[q][j];
                    }
                }
            }
            for i in 0..NODES {
                for j in 0..i {
                    stiffness[j][i] = stiffness[i][j];
                }
            }
            system.stiffness.push(stiffness);
            system.loads.push(loads);
        }
        system
    }

    /// Newton's method on the energy from the θ at hand, with steps that are halved until the energy falls.
    fn descend(mut self, system: &System) -> Option<Elastica> {
        let mut at = system.derivatives(&self.theta);
        let mut settled = false;
        for _ in 0..STEPS {
            let step = system.step(&at.1, at.2)?;
            // Where so little can be gained the energy's own rounding would decide.
            let gain: f64 = at.1.iter().zip(&step).map(|(g, s)| -0.5 * g * s).sum();
            let flat = gain <= 1e-11 * at.0.abs();
            let mut share = 1.0;
            let (next, there) = loop {
                let next: Vec<f64> =
                    self.theta.iter().zip(&step).map(|(t, s)| (t + share * s).clamp(0.0, FRAC_PI_2)).collect();
                let there = system.derivatives(&next);
                if there.0 <= at.0 || flat || share < 1e-6 {
                    break (next, there);
                }
                share *= 0.5;
            };
            let moved = next.iter().zip(&self.theta).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            (self.theta, at) = (next, there);
            // Newton's method squares the error: after such a step only rounding is left.
            if moved < 1e-8 && share == 1.0 {
                settled = true;
                break;
            }
        }
        if !settled {
            return None;
        }
        let rule = &*RULE;
        self.series = (0..self.elements())
            .map(|k| {
                let values = &self.theta[k * DEGREE..=(k + 1) * DEGREE];
                std::array::from_fn(|c| rule.series[c].iter().zip(values).map(|(s, v)| s * v).sum())
            })
            .collect();
        self.starts = vec![[0.0; 2]];
        for k in 0..self.elements() {
            let next = self.place(k, 1.0);
            self.starts.push(next);
        }
        Some(self)
    }

    /// The place (along, across) at the share `x` of the element `k`.
    fn place(&self, k: usize, x: f64) -> [f64; 2] {
        let size = (self.ends[k + 1] - self.ends[k]) * x;
        let mut at = self.starts[k];
        for (p, g) in &RULE.points {
            let theta = sum_and_slope(&self.series[k], x * p)[0];
            let dt = g * size * self.shape.ell * ((self.ends[k] + size * p) * self.shape.ln_alpha).exp();
            at[0] += dt * theta.cos();
            at[1] += dt * theta.sin();
        }
        at
    }

    /// The point at y, 0 to 1.
    fn at_coordinate(&self, y: f64) -> AxisPoint<f64> {
        let k = self.ends[1..self.elements()].iter().filter(|end| **end < y).count();
        let size = self.ends[k + 1] - self.ends[k];
        let x = ((y - self.ends[k]) / size).clamp(0.0, 1.0);
        let [theta, slope] = sum_and_slope(&self.series[k], x);
        let [along, across] = self.place(k, x);
        let side = 1f64.copysign(self.amplitude);
        let curvature = side * slope / (size * self.shape.ell * (y * self.shape.ln_alpha).exp());
        AxisPoint { along, across: side * across, cos: theta.cos(), sin: side * theta.sin(), curvature }
    }

    /// The point that is `t` along the branch, 0 (root) to 1 (tip).
    pub fn at(&self, t: f64) -> AxisPoint<f64> {
        self.at_coordinate(coordinate(&self.shape, t.clamp(0.0, 1.0)).clamp(0.0, 1.0))
    }

    /// The point below the place `x` of the straight axis. Beyond the tip, which a bent branch does not bring as far
    /// as its length, it is on the tip's tangent, or on a line less steep where the tip hangs.
    pub fn below(&self, x: f64) -> AxisPoint<f64> {
        let tip = self.at_coordinate(1.0);
        if x >= tip.along {
            let across = tip.across + (x - tip.along) * (tip.sin / tip.cos.max(f64::EPSILON)).clamp(-STEEP, STEEP);
            return AxisPoint { along: x, across, ..tip };
        }
        let (mut low, mut high) = (0.0, 1.0);
        let mut y = coordinate(&self.shape, x.max(0.0));
        for _ in 0..80 {
            let bent = self.at_coordinate(y);
            let miss = x - bent.along;
            if miss > 0.0 {
                low = y
            } else {
                high = y
            };
            let step = miss / (bent.cos * self.shape.ell * (y * self.shape.ln_alpha).exp()).max(f64::MIN_POSITIVE);
            let newton = y + step;
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            let moved = (next - y).abs();
            y = next;
            if moved < 1e-13 {
                break;
            }
        }
        self.at_coordinate(y)
    }
}

/// The energy ½ θᵀKθ − Σ load sin θ of all elements.
struct System {
    stiffness: Vec<[[f64; NODES]; NODES]>,
    /// Loads at the Gauss points.
    loads: Vec<[f64; POINTS]>,
}

/// Energy, its slope, and its curvature: a band of the lower triangle, row by row, the diagonal first.
type Derivatives = (f64, Vec<f64>, Vec<[f64; NODES]>);

impl System {
    fn derivatives(&self, theta: &[f64]) -> Derivatives {
        let rule = &*RULE;
        let (mut energy, mut slope) = (0.0, vec![0.0; theta.len()]);
        let mut curvature = vec![[0.0; NODES]; theta.len()];
        for (k, (stiffness, loads)) in self.stiffness.iter().zip(&self.loads).enumerate() {
            let at = k * DEGREE;
            let local = &theta[at..at + NODES];
            for i in 0..NODES {
                let pull: f64 = stiffness[i].iter().zip(local).map(|(s, t)| s * t).sum();
                energy += 0.5 * local[i] * pull;
                slope[at + i] += pull;
                for j in 0..=i {
                    curvature[at + i][i - j] += stiffness[i][j];
                }
            }
            for (value, load) in rule.value.iter().zip(loads) {
                let angle: f64 = value.iter().zip(local).map(|(v, t)| v * t).sum();
                let (sin, cos) = angle.sin_cos();
                energy -= load * sin;
                for i in 0..NODES {
                    slope[at + i] -= load * cos * value[i];
                    let bend = load * sin * value[i];
                    for j in 0..=i {
                        curvature[at + i][i - j] += bend * value[j];
                    }
                }
            }
        }
        (energy, slope, curvature)
    }

    /// −curvature⁻¹ slope by Cholesky's decomposition of the band, with θ = 0 held at the root.
    fn step(&self, slope: &[f64], mut band: Vec<[f64; NODES]>) -> Option<Vec<f64>> {
        let n = slope.len();
        let first = |i: usize| i.saturating_sub(DEGREE).max(1);
        for i in 1..n {
            for j in first(i)..=i {
                let shared = first(i).max(first(j));
                let sum: f64 = (shared..j).map(|k| band[i][i - k] * band[j][j - k]).sum();
                let value = band[i][i - j] - sum;
                band[i][i - j] = if i == j { value.sqrt() } else { value / band[j][0] };
            }
            if !(band[i][0] > 0.0 && band[i][0].is_finite()) {
                return None;
            }
        }
        let mut x = vec![0.0; n];
        for i in 1..n {
            let sum: f64 = (first(i)..i).map(|k| band[i][i - k] * x[k]).sum();
            x[i] = (-slope[i] - sum) / band[i][0];
        }
        for i in (1..n).rev() {
            let sum: f64 = (i + 1..n.min(i + NODES)).map(|k| band[k][k - i] * x[k]).sum();
            x[i] = (x[i] - sum) / band[i][0];
        }
        Some(x)
    }
}

#[cfg(test)]
mod tests;
