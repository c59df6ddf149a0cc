//! A leaf as a stack of equal plates, of which a leaf may hold any number above one, whole or not: Allen, Gausman,
//! Richardson & Thomas (J. Opt. Soc. Am. 59, 1969), and PROSPECT of Jacquemoud & Baret (Remote Sensing of Environment
//! 34, 1990).
//!
//! A plate lies between two plane interfaces and absorbs. Light inside is diffuse. The first plate is lit within a cone
//! ([`CONE`]), because a leaf's surface is rough, and its gloss is a number of the leaf: a waxy or hairy leaf reflects
//! more at its surface than a smooth one. Equal plates do not know sides. In [`PlateIndex::sides`] the upper half of
//! the plates absorbs more than the lower one, as the palisade does, so that one leaf has two sides.

#[cfg(test)]
mod tests;

use crate::foliar::enter;
use crate::number::{Dual, Real, Scalar};
use crate::slab::expint::{e1, e2};
use mesophyll_base::quadrature;

/// Half the angle of the cone in which a leaf is lit (radians): what a rough surface makes of a beam.
pub const CONE: f64 = 40.0 * std::f64::consts::PI / 180.0;
/// Nodes of the integral over directions.
const NODES: usize = 32;
/// An absorption beyond which no light is left in a plate.
const BLACK: f64 = 60.0;

/// A quantity and its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateSensitivity {
    /// The quantity.
    pub value: f64,
    /// Its derivative by the absorption of the whole leaf.
    pub by_depth: f64,
    /// Its derivative by the number of plates.
    pub by_crossings: f64,
    /// Its derivative by the gloss of the surface.
    pub by_gloss: f64,
    /// Its derivative by the refractive index.
    pub by_index: f64,
}

/// What a refractive index does at an interface, prepared once for all leaves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateIndex {
    /// The refractive index of a plate.
    pub index: f64,
    /// The share of diffuse light that enters, and its derivative by the index.
    diffuse: [f64; 2],
    /// The share that enters of light within the [`CONE`], and its derivative by the index.
    cone: [f64; 2],
}

/// The share of light within a cone of half angle `angle` that an interface lets through from air into `index`, and its
/// derivative by the index: the mean of Fresnel's formula over the cone.
pub fn entering(angle: f64, index: f64) -> [f64; 2] {
    let least = if angle < std::f64::consts::FRAC_PI_2 { angle.cos() } else { 0.0 };
    let n = Dual::<f64, 1>::parameter(index, 0);
    let (mut sum, span) = ([0.0; 2], 1.0 - least);
    for (t, weight) in quadrature::unit(NODES) {
        let mu = least + span * t;
        let (mirrored, _, _) = enter(n, mu.acos());
        let weight = 2.0 * mu * span * weight / (1.0 - least * least);
        sum[0] += weight * (1.0 - mirrored.value);
        sum[1] -= weight * mirrored.by[0];
    }
    sum
}

impl PlateIndex {
    /// For a refractive index above 1.
    pub fn new(index: f64) -> PlateIndex {
        PlateIndex { index, diffuse: entering(std::f64::consts::FRAC_PI_2, index), cone: entering(CONE, index) }
    }

    /// The share of light that the surface mirrors where its gloss is 1.
    pub fn surface(&self) -> f64 {
        1.0 - self.cone[0]
    }

    /// Reflectance and transmittance of a leaf whose whole absorption is `depth` ≥ 0, which counts `crossings` ≥ 1
    /// plates, and whose surface mirrors `gloss` times what a smooth one does.
    pub fn response(&self, depth: f64, crossings: f64, gloss: f64) -> [PlateSensitivity; 2] {
        type Four = Dual<f64, 4>;
        let n = Four::parameter(self.index, 3);
        let leaf = StackedLeaf {
            depth: Four::parameter(depth, 0),
            crossings: Four::parameter(crossings, 1),
            gloss: Four::parameter(gloss, 2),
            index: n,
            diffuse: n.function(self.diffuse[0], self.diffuse[1]),
            cone: n.function(self.cone[0], self.cone[1]),
        };
        leaf.response().map(|x| PlateSensitivity {
            value: x.value,
            by_depth: x.by[0],
            by_crossings: x.by[1],
            by_gloss: x.by[2],
            by_index: x.by[3],
        })
    }

    /// [`PlateIndex::response`] without derivatives.
    pub fn values(&self, depth: f64, crossings: f64, gloss: f64) -> [f64; 2] {
        let leaf =
            StackedLeaf { depth, crossings, gloss, index: self.index, diffuse: self.diffuse[0], cone: self.cone[0] };
        leaf.response()
    }
}

/// Reflectance and transmittance of a leaf lit from above, and of the same leaf lit from below, each with its
/// derivatives by absorption, number of plates, gloss above, gloss below and lean.
pub type SidedPlates = [[(f64, [f64; 5]); 2]; 2];

impl PlateIndex {
    /// [`PlateIndex::response`] of both sides of a leaf. Half of the plates lie above the other half, and the share
    /// (1 + lean)/2 of the absorption lies in the upper half; `lean` is between −1 and 1. Each side has its own gloss.
    /// Without lean and with one gloss, both sides are those of equal plates.
    pub fn sides(&self, depth: f64, crossings: f64, gloss: [f64; 2], lean: f64) -> SidedPlates {
        type Five = Dual<f64, 5>;
        let [diffuse, mirrored] = [self.diffuse[0], 1.0 - self.cone[0]];
        let out = Five::of(diffuse / (self.index * self.index));
        let (one, back_in, back_out) = (Five::of(1.0), Five::of(1.0 - diffuse), Five::of(1.0) - out);
        let (crossings, lean) = (Five::parameter(crossings, 1), Five::parameter(lean, 4));
        let each = Five::parameter(depth, 0) / crossings;
        let half = |share: Five| {
            let through = transmitted(each * share);
            let t = through * out.times(diffuse) / (one - back_out * back_out * through * through);
            stack(back_in + back_out * through * t, t, crossings.times(0.5))
        };
        let ([upper_r, upper_t], [lower_r, lower_t]) = (half(one + lean), half(one - lean));
        let echo = one / (one - upper_r * lower_r);
        let t = upper_t * lower_t * echo;
        // The surface that is lit mirrors and lets in what it does within the cone, and not of diffuse light.
        let lit = |gloss: Five, r: Five| {
            let mirrored = gloss.times(mirrored);
            let enters = (one - mirrored).times(1.0 / diffuse);
            [mirrored + (r - back_in) * enters, t * enters]
        };
        let above = lit(Five::parameter(gloss[0], 2), upper_r + upper_t * upper_t * lower_r * echo);
        let below = lit(Five::parameter(gloss[1], 3), lower_r + lower_t * lower_t * upper_r * echo);
        [above, below].map(|side| side.map(|x| (x.value, x.by)))
    }
}

/// What [`PlateIndex::response`] computes with.
struct StackedLeaf<N> {
    depth: N,
    crossings: N,
    gloss: N,
    index: N,
    diffuse: N,
    cone: N,
}

impl<N: Real> StackedLeaf<N> {
    fn response(self) -> [N; 2] {
        let one = N::of(1.0);
        let through = transmitted(self.depth / self.crossings);
        // From inside, what enters is less by n², because of total reflection.
        let out = self.diffuse / (self.index * self.index);
        let (back_in, back_out) = (one - self.diffuse, one - out);
        let echo = one / (one - back_out * back_out * through * through);
        let plate = |enters: N, mirrored: N| {
            let t = enters * through * out * echo;
            [mirrored + back_out * through * t, t]
        };
        let mirrored = (one - self.cone) * self.gloss;
        let [first_r, first_t] = plate(one - mirrored, mirrored);
        let [r, t] = plate(self.diffuse, back_in);
        let [below_r, below_t] = stack(r, t, self.crossings - one);
        let echo = one / (one - below_r * r);
        [first_r + first_t * below_r * t * echo, first_t * below_t * echo]
    }
}

/// The share of diffuse light that crosses a plate of absorption k without meeting an interface: 2 E₃(k).
fn transmitted<N: Real>(k: N) -> N {
    let x = k.value().min(BLACK);
    if x <= 0.0 {
        return N::chain(1.0, [(-2.0, k)]);
    }
    N::chain((1.0 - x) * (-x).exp() + x * x * e1(x), [(-2.0 * e2(x), k)])
}

/// Reflectance and transmittance of `m` ≥ 0 equal plates with `r` and `t` each (Stokes 1862).
///
/// R = sinh mβ / sinh(α + mβ) and T = sinh α / sinh(α + mβ), where cosh α = (1 + r² − t²)/2r and
/// cosh β = (1 − r² + t²)/2t. Both sinh are multiples of the root of D², which is 0 where nothing is absorbed. All is
/// written in even functions of that root, so that it is smooth there.
fn stack<N: Real>(r: N, t: N, m: N) -> [N; 2] {
    let one = N::of(1.0);
    let square = (one + r + t) * (one + r - t) * (one - r + t) * (one - r - t);
    // sinh β = √D²/2t, so β = √D²/2t · (asinh y)/y.
    let y2 = square / (t * t).times(4.0);
    let per_root = even_asinh(y2) / t.times(2.0);
    let z2 = m * m * square * per_root * per_root;
    let rise = m * per_root * even_sinh(z2);
    let cosh_a = (one + r * r - t * t) / r.times(2.0);
    let down = even_cosh(z2) / r.times(2.0) + cosh_a * rise;
    [rise / down, one / (r.times(2.0) * down)]
}

/// asinh(√x)/√x.
fn even_asinh<N: Real>(x: N) -> N {
    let v = x.value();
    if v < 1e-3 {
        // Also right a little below 0, where rounding may lead.
        let value = 1.0 - v / 6.0 + v * v * (3.0 / 40.0 - v * (15.0 / 336.0 - v * 105.0 / 3456.0));
        let slope = -1.0 / 6.0 + v * (3.0 / 20.0 - v * (45.0 / 336.0 - v * 420.0 / 3456.0));
        return N::chain(value, [(slope, x)]);
    }
    let root = v.sqrt();
    let value = root.asinh() / root;
    N::chain(value, [((1.0 / (1.0 + v).sqrt() - value) / (2.0 * v), x)])
}

/// sinh(√x)/√x.
fn even_sinh<N: Real>(x: N) -> N {
    let v = x.value();
    if v < 1e-2 {
        let value = 1.0 + v / 6.0 * (1.0 + v / 20.0 * (1.0 + v / 42.0 * (1.0 + v / 72.0)));
        let slope = 1.0 / 6.0 + v / 60.0 * (1.0 + v / 28.0 * (1.0 + v / 54.0));
        return N::chain(value, [(slope, x)]);
    }
    let root = v.sqrt();
    let value = root.sinh() / root;
    N::chain(value, [((root.cosh() - value) / (2.0 * v), x)])
}

/// cosh(√x).
fn even_cosh<N: Real>(x: N) -> N {
    let v = x.value();
    let (value, slope) = if v < 1e-2 {
        let slope = 0.5 * (1.0 + v / 6.0 * (1.0 + v / 20.0 * (1.0 + v / 42.0)));
        (1.0 + v / 2.0 * (1.0 + v / 12.0 * (1.0 + v / 30.0 * (1.0 + v / 56.0))), slope)
    } else {
        let root = v.sqrt();
        (root.cosh(), root.sinh() / (2.0 * root))
    };
    N::chain(value, [(slope, x)])
}
