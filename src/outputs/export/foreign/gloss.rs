//! The gloss and the matte reflectance of a target that come nearest to ours.
//!
//! Theirs is s·a + d·b + z, where a is their lobe with its Fresnel factor, b the matte term (what the gloss leaves of
//! 1/π), and z a part that no parameter moves (Schlick's grazing reflection). At a given roughness s and d are the
//! solution of two normal equations in the norm of [`crate::foreign::nodes`]. The roughness is searched where a and b
//! together leave the least of our lobe; it depends on our slope m alone. So all integrals are made once for a few
//! slopes, and a texel interpolates them in ln m.
//!
//! Where b is even, the second normal equation says that theirs sends back as much even light as ours: the albedo is
//! kept, except where a parameter meets its bound.

use crate::foreign::micro::MicrofacetLobe;
use crate::foreign::nodes::DirectionPairs;
use crate::foreign::texel::{DiffuseCoupling, MaterialGloss, MaterialTexel};
use mesophyll_base::surface::gloss::Lobe;
use rayon::prelude::*;
use std::f64::consts::PI;

/// The lobe of a target without its numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LobeFamily {
    /// Its slopes and masking.
    pub micro: MicrofacetLobe,
    /// Index of its dielectric Fresnel factor, where it has one.
    pub index: Option<f64>,
    /// Whether Schlick's factor rises to 1 at grazing incidence, whatever the colour.
    pub grazing: bool,
    /// What it leaves to the matte light.
    pub under: DiffuseCoupling,
}

/// Slopes between which the table lies.
const SLOPES: [f64; 2] = [0.02, 1.5];
/// Number of its rows.
const ROWS: usize = 9;
/// Halvings (by the golden ratio) of the interval in which the roughness is searched.
const STEPS: usize = 18;

/// Scalar products of a row, in the norm of the nodes.
#[derive(Debug, Clone, Copy, Default)]
struct Row {
    ln_m: f64,
    ln_alpha: f64,
    /// a·a, a·b, b·b, ours·a, ours·b, z·a, z·b, matte·a, matte·b.
    products: [f64; 9],
}

/// The nearest parameters of a family for every slope.
#[derive(Debug, Clone)]
pub struct LobeTable {
    family: LobeFamily,
    rows: Vec<Row>,
}

/// What [`LobeTable::nearest`] finds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearestLobe {
    /// Matte reflectance.
    pub diffuse: [f64; 3],
    /// Scale of the gloss.
    pub colour: [f64; 3],
    /// Slope of their lobe.
    pub alpha: f64,
    /// Their matte term over ours: the factor for a reflectance without gloss.
    pub matte: f64,
}

impl LobeFamily {
    /// The lobe with its numbers.
    pub fn shine(&self, alpha: f64, colour: [f64; 3]) -> MaterialGloss {
        let grazing = if self.grazing { [1.0; 3] } else { colour };
        MaterialGloss { micro: self.micro, alpha, colour: [colour, grazing], index: self.index, metal: None }
    }

    /// The scalar products at a roughness, and what remains of our lobe.
    fn row(&self, nodes: &DirectionPairs, ours: &[f64], alpha: f64) -> ([f64; 9], f64) {
        let black = self.shine(alpha, [0.0; 3]);
        let white = self.shine(alpha, [1.0; 3]);
        let seen = MaterialTexel { diffuse: [1.0; 3], through: [0.0; 3], shine: Some(white), under: self.under };
        let (mut p, mut oo) = ([0.0; 9], 0.0);
        let (mut view, mut left) = ([f64::NAN; 3], 1.0);
        for (n, o) in nodes.all.iter().zip(ours) {
            if n.view != view {
                (view, left) = (n.view, if self.under == DiffuseCoupling::Albedo { seen.left(n.view) } else { 1.0 });
            }
            let vh = mesophyll_base::surface::gloss::dot(n.view, crate::foreign::micro::half(n.view, n.light));
            let lobe = self.micro.value(n.view, n.light, alpha);
            let z = lobe * black.factor(vh)[0];
            let a = lobe * white.factor(vh)[0] - z;
            let (b, e) = (left / PI, 1.0 / PI);
            for (sum, x) in p.iter_mut().zip([a * a, a * b, b * b, o * a, o * b, z * a, z * b, e * a, e * b]) {
                *sum += n.weight * x;
            }
            oo += n.weight * o * o;
        }
        let [aa, ab, bb, oa, ob, ..] = p;
        let [s, d] = solve([aa, ab, bb], [oa, ob]);
        (p, oo - s * oa - d * ob)
    }
}

/// The solution of two symmetric equations.
fn solve([aa, ab, bb]: [f64; 3], [x, y]: [f64; 2]) -> [f64; 2] {
    let det = aa * bb - ab * ab;
    if det > 1e-12 * aa * bb { [(x * bb - y * ab) / det, (y * aa - x * ab) / det] } else { [0.0, y / bb] }
}

impl LobeTable {
    /// The table of a family for our lobe and slopes between `low` and `high`.
    pub fn new(family: LobeFamily, lobe: Lobe, [low, high]: [f64; 2]) -> LobeTable {
        let [low, high] = [low, high].map(|m| m.clamp(SLOPES[0], SLOPES[1]).ln());
        let count = if high - low < 1e-6 { 1 } else { ROWS };
        let rows = (0..count).into_par_iter().map(|k| {
            let ln_m = low + (high - low) * k as f64 / (count.max(2) - 1) as f64;
            let m = ln_m.exp();
            let nodes = DirectionPairs::new(lobe, m);
            let n = [0.0, 0.0, 1.0];
            let ours: Vec<f64> = nodes.all.iter().map(|at| lobe.bounded(n, at.light, at.view, m)).collect();
            let rest = |ln_alpha: f64| family.row(&nodes, &ours, ln_alpha.exp()).1;
            // Golden section. The remainder has one minimum in this interval for every pair of lobes here.
            let golden = 0.5 * (5f64.sqrt() - 1.0);
            let (mut a, mut b) = (ln_m - 0.9, (ln_m + 0.6).min(0.0).max(ln_m - 0.8));
            let (mut x, mut y) = (b - golden * (b - a), a + golden * (b - a));
            let (mut fx, mut fy) = (rest(x), rest(y));
            for _ in 0..STEPS {
                if fx < fy {
                    (b, y, fy) = (y, x, fx);
                    x = b - golden * (b - a);
                    fx = rest(x);
                } else {
                    (a, x, fx) = (x, y, fy);
                    y = a + golden * (b - a);
                    fy = rest(y);
                }
            }
            let ln_alpha = 0.5 * (a + b);
            Row { ln_m, ln_alpha, products: family.row(&nodes, &ours, ln_alpha.exp()).0 }
        });
        LobeTable { family, rows: rows.collect() }
    }

    /// The family of this table.
    pub fn family(&self) -> LobeFamily {
        self.family
    }

    /// The parameters nearest to ρd/π + ρs f_s(m), with 0 ≤ colour ≤ `most` and no negative reflectance.
    pub fn nearest(&self, rho_d: [f64; 3], rho_s: [f64; 3], m: f64, most: f64) -> NearestLobe {
        let (row, next, t) = self.place(m.max(1e-9).ln());
        let mix = |a: f64, b: f64| a + (b - a) * t;
        let mut p = [0.0; 9];
        for (k, value) in p.iter_mut().enumerate() {
            *value = mix(row.products[k], next.products[k]);
        }
        let [aa, ab, bb, oa, ob, za, zb, ea, eb] = p;
        let (mut diffuse, mut colour) = ([0.0; 3], [0.0; 3]);
        for c in 0..3 {
            let (x, y) = (rho_s[c] * oa + rho_d[c] * ea - za, rho_s[c] * ob + rho_d[c] * eb - zb);
            let [mut s, mut d] = if rho_s[c] > 0.0 { solve([aa, ab, bb], [x, y]) } else { [0.0, y / bb] };
            if !(0.0..=most).contains(&s) {
                s = s.clamp(0.0, most);
                d = (y - s * ab) / bb;
            }
            if d < 0.0 {
                d = 0.0;
                s = (x / aa).clamp(0.0, most);
            }
            (colour[c], diffuse[c]) = (s, d);
        }
        NearestLobe { diffuse, colour, alpha: mix(row.ln_alpha, next.ln_alpha).exp(), matte: eb / bb }
    }

    fn place(&self, ln_m: f64) -> (&Row, &Row, f64) {
        let k = self.rows.partition_point(|r| r.ln_m <= ln_m).clamp(1, self.rows.len().max(2) - 1);
        let (row, next) = (&self.rows[k - 1], &self.rows[k.min(self.rows.len() - 1)]);
        let span = next.ln_m - row.ln_m;
        (row, next, if span > 0.0 { ((ln_m - row.ln_m) / span).clamp(0.0, 1.0) } else { 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::foreign::micro::{MaskingRule, SlopeDistribution};

    fn family(slopes: SlopeDistribution) -> LobeFamily {
        let micro = MicrofacetLobe { slopes, masking: MaskingRule::Separable };
        LobeFamily { micro, index: None, grazing: false, under: DiffuseCoupling::Added }
    }

    /// No other numbers near those found leave less (a search by trial, without normal equations).
    #[test]
    fn nothing_near_is_nearer() {
        let (m, rho_d, rho_s) = (0.3, 0.1, 0.08);
        let table = LobeTable::new(family(SlopeDistribution::Ggx), Lobe::Beckmann, [m, m]);
        let found = table.nearest([rho_d; 3], [rho_s; 3], m, 1.0);
        let nodes = DirectionPairs::new(Lobe::Beckmann, m);
        let rest = |alpha: f64, s: f64, d: f64| {
            nodes.integral(|v, l| {
                let ours = rho_d / PI + rho_s * Lobe::Beckmann.bounded([0.0, 0.0, 1.0], l, v, m);
                (table.family.micro.value(v, l, alpha) * s + d / PI - ours).powi(2)
            })
        };
        let (a, s, d) = (found.alpha, found.colour[0], found.diffuse[0]);
        let least = rest(a, s, d);
        for (x, y, z) in [(1.03, 1.0, 1.0), (0.97, 1.0, 1.0), (1.0, 1.02, 1.0), (1.0, 0.98, 1.0), (1.0, 1.0, 1.02)] {
            assert!(rest(a * x, s * y, d * z) > least, "{x} {y} {z}");
        }
        // It keeps the albedo.
        let theirs = nodes.albedo(|v, l| table.family.micro.value(v, l, a) * s + d / PI);
        let ours = rho_d * nodes.albedo(|_, _| 1.0 / PI)
            + rho_s * nodes.albedo(|v, l| Lobe::Beckmann.bounded([0.0, 0.0, 1.0], l, v, m));
        assert!((theirs - ours).abs() < 1e-9, "{theirs} {ours}");
    }
}
