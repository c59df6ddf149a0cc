//! Directions of light over the hemisphere with their solid angles: stratified random ones (the paper's) and quadrature
//! rules.
//!
//! z = 0 is the tangent plane, z = 1 straight above; weights are steradians and sum to 2π.

use crate::slab::quadrature::gauss;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::{FRAC_PI_4, TAU};
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};

/// The paper's number of light directions (H9 Table 3.1).
pub const PAPER: usize = 128;

/// How directions are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DirectionRule {
    /// One random direction in each of N cells of equal solid angle (H9 §3.3.9, "Shirley's square to hemisphere
    /// mapping"). Same seed, same directions.
    Stratified {
        /// How many directions N.
        count: usize,
        /// Seed of the random numbers.
        seed: u64,
    },
    /// Gauss–Legendre in z with equally spaced azimuths, the first of them half a step from x. The rule is exact for
    /// polynomials of degree below 2·`levels` in z and below `azimuths` in azimuth. Steps at the horizon are only
    /// sampled.
    Product {
        /// Nodes in z.
        levels: usize,
        /// Number of azimuths at each node in z.
        azimuths: usize,
    },
    /// Points on a spiral that turns by the golden angle, at equal steps of z.
    Spiral {
        /// How many directions.
        count: usize,
    },
}

/// The rules that a fit offers, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum DirectionRuleKind {
    /// A spiral over the hemisphere
    #[default]
    Spiral,
    /// Random directions, one in each of equal parts
    Stratified,
}

impl DirectionRuleKind {
    /// The rule with this many directions.
    pub fn rule(self, count: usize) -> DirectionRule {
        match self {
            DirectionRuleKind::Spiral => DirectionRule::Spiral { count },
            DirectionRuleKind::Stratified => DirectionRule::Stratified { count, seed: 1 },
        }
    }
}

/// Directions and their solid angles (sr).
#[derive(Debug, Clone, PartialEq)]
pub struct DirectionSet {
    /// Unit vectors towards the lights.
    pub directions: Vec<[f64; 3]>,
    /// Solid angle of each (sr); they sum to 2π.
    pub weights: Vec<f64>,
}

impl Default for DirectionRule {
    fn default() -> Self {
        DirectionRule::Stratified { count: PAPER, seed: 1 }
    }
}

impl DirectionRule {
    /// How many directions the rule has.
    pub fn count(self) -> usize {
        match self {
            DirectionRule::Stratified { count, .. } | DirectionRule::Spiral { count } => count,
            DirectionRule::Product { levels, azimuths } => levels * azimuths,
        }
    }

    /// The rule in words, for tables.
    pub fn name(self) -> String {
        match self {
            DirectionRule::Stratified { count, seed } => {
                format!("{count}, one at random in each of as many cells (seed {seed})")
            }
            DirectionRule::Product { levels, azimuths } => format!("{levels} heights by {azimuths} azimuths"),
            DirectionRule::Spiral { count } => format!("{count} on a spiral"),
        }
    }
}

impl DirectionSet {
    /// The directions of a rule.
    pub fn new(rule: DirectionRule) -> DirectionSet {
        match rule {
            DirectionRule::Stratified { count, seed } => stratified(count, seed),
            DirectionRule::Product { levels, azimuths } => product(levels, azimuths),
            DirectionRule::Spiral { count } => {
                let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
                let directions =
                    (0..count).map(|k| raised((k as f64 + 0.5) / count as f64, golden * k as f64)).collect();
                DirectionSet { directions, weights: vec![TAU / count as f64; count] }
            }
        }
    }

    /// How many directions there are.
    pub fn len(&self) -> usize {
        self.directions.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.directions.is_empty()
    }
}

/// Direction at height z and azimuth φ.
pub fn raised(z: f64, phi: f64) -> [f64; 3] {
    let s = (1.0 - z * z).max(0.0).sqrt();
    [s * phi.cos(), s * phi.sin(), z]
}

fn product(levels: usize, azimuths: usize) -> DirectionSet {
    let step = TAU / azimuths as f64;
    let places: Vec<_> = gauss(levels)
        .into_iter()
        .flat_map(|node| (0..azimuths).map(move |k| (node, (k as f64 + 0.5) * step)))
        .collect();
    DirectionSet {
        directions: places.iter().map(|(node, phi)| raised(node.x, *phi)).collect(),
        weights: places.iter().map(|(node, _)| node.w * step).collect(),
    }
}

/// The unit square is cut into about √N rows whose heights are proportional to their numbers of cells. This gives N
/// nearly square cells of equal area for any N.
fn stratified(count: usize, seed: u64) -> DirectionSet {
    let mut rng = Pcg64::seed_from_u64(seed);
    let rows = ((count as f64).sqrt().round() as usize).max(1);
    let mut directions = Vec::with_capacity(count);
    for row in 0..rows {
        let (first, end) = (row * count / rows, (row + 1) * count / rows);
        for cell in first..end {
            let u = ((cell - first) as f64 + rng.random::<f64>()) / (end - first) as f64;
            let v = (first as f64 + (end - first) as f64 * rng.random::<f64>()) / count as f64;
            directions.push(hemisphere(u, v));
        }
    }
    DirectionSet { weights: vec![TAU / count as f64; count], directions }
}

/// Maps the unit square to the hemisphere so that equal areas become equal solid angles: Shirley & Chiu's (1997)
/// concentric map to the disk, then radius r to height z = 1 − r².
pub fn hemisphere(u: f64, v: f64) -> [f64; 3] {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    if a == 0.0 && b == 0.0 {
        return [0.0, 0.0, 1.0];
    }
    // Signed radius and the angle from the square's wedge.
    let (r, phi) = if a.abs() > b.abs() { (a, FRAC_PI_4 * b / a) } else { (b, 2.0 * FRAC_PI_4 - FRAC_PI_4 * a / b) };
    let s = r * (2.0 - r * r).sqrt();
    [s * phi.cos(), s * phi.sin(), 1.0 - r * r]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rules() -> [DirectionRule; 6] {
        [
            DirectionRule::default(),
            DirectionRule::Stratified { count: 127, seed: 9 },
            DirectionRule::Stratified { count: 1, seed: 9 },
            DirectionRule::Product { levels: 8, azimuths: 16 },
            DirectionRule::Product { levels: 3, azimuths: 7 },
            DirectionRule::Spiral { count: 128 },
        ]
    }

    #[test]
    fn directions_are_unit_and_cover_the_hemisphere() {
        for rule in rules() {
            let lights = DirectionSet::new(rule);
            assert_eq!(lights.len(), rule.count());
            assert!((lights.weights.iter().sum::<f64>() - TAU).abs() < 1e-12);
            for d in &lights.directions {
                assert!((d.iter().map(|c| c * c).sum::<f64>() - 1.0).abs() < 1e-13 && d[2] >= 0.0, "{d:?}");
            }
        }
        assert_eq!(DirectionSet::new(DirectionRule::default()), DirectionSet::new(DirectionRule::default()));
        assert_ne!(
            DirectionSet::new(DirectionRule::default()),
            DirectionSet::new(DirectionRule::Stratified { count: PAPER, seed: 2 })
        );
    }

    /// Cells have equal solid angle: the map's Jacobian, computed by differences, is 2π everywhere.
    #[test]
    fn the_square_maps_to_equal_solid_angles() {
        let h = 1e-6;
        for k in 0..400 {
            let (u, v) = ((0.5 + (k % 20) as f64) / 20.0 + 1e-3, (0.5 + (k / 20) as f64) / 20.0 + 2e-3);
            let along = |du: f64, dv: f64| {
                let (p, q) = (hemisphere(u + du, v + dv), hemisphere(u - du, v - dv));
                [0, 1, 2].map(|c| (p[c] - q[c]) / (2.0 * h))
            };
            let (a, b) = (along(h, 0.0), along(0.0, h));
            let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
            let area = cross.iter().map(|c| c * c).sum::<f64>().sqrt();
            assert!((area / TAU - 1.0).abs() < 1e-6, "{u} {v}: {area}");
        }
    }

    /// Each cell holds one direction: sorted by the inverse map, the directions fill all rows and columns.
    #[test]
    fn strata_hold_one_direction_each() {
        // Over many seeds the mean of z over a set scatters far less than 128 independent draws would (.29/√128 =
        // .0255).
        let means: Vec<f64> = (0..200)
            .map(|seed| {
                let lights = DirectionSet::new(DirectionRule::Stratified { count: 128, seed });
                lights.directions.iter().map(|d| d[2]).sum::<f64>() / 128.0
            })
            .collect();
        let rms = (means.iter().map(|m| (m - 0.5).powi(2)).sum::<f64>() / 200.0).sqrt();
        assert!(rms < 0.0255 / 4.0, "{rms}");
        assert!((means.iter().sum::<f64>() / 200.0 - 0.5).abs() < 4.0 * rms / 200f64.sqrt());
    }

    #[test]
    fn the_product_rule_is_exact_for_polynomials() {
        let lights = DirectionSet::new(DirectionRule::Product { levels: 4, azimuths: 8 });
        let integral = |f: &dyn Fn(&[f64; 3]) -> f64| {
            lights.directions.iter().zip(&lights.weights).map(|(d, w)| w * f(d)).sum::<f64>()
        };
        // ∫ x² dω = 2π/3, ∫ z⁴ = 2π/5, ∫ x⁴ = 2π/5, ∫ x²y² = 2π/15 over the upper hemisphere.
        assert!((integral(&|d| d[0] * d[0]) - TAU / 3.0).abs() < 1e-13);
        assert!((integral(&|d| d[2].powi(4)) - TAU / 5.0).abs() < 1e-13);
        assert!((integral(&|d| d[0].powi(4)) - TAU / 5.0).abs() < 1e-13);
        assert!((integral(&|d| (d[0] * d[1]).powi(2)) - TAU / 15.0).abs() < 1e-13);
    }
}
