//! Follows one ray at a time through the [`INTERFACES`], step by step as B1 describes it. It is plain and slow. It
//! serves surfaces that rays of any direction meet one by one, and it checks the vector code of [`super::walk`].
//!
//! A ray is not absorbed here. Instead, its path through the mesophyll is counted, so that one ray serves all
//! wavelengths with the same refractive indices: at a wavelength exp(−absorption · crossings) of it is left.

use super::lobe;
use super::{INTERFACES, LayeredLeaf, LeafMedium, LeafTissue, fresnel};
use std::f64::consts::TAU;

/// How a ray left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayExit {
    /// Unit vector; z points out of the upper side.
    pub direction: [f64; 3],
    /// Length of its path through the mesophyll, in thicknesses.
    pub crossings: f64,
}

/// After this many events a ray is given up: it is light that a clear layer has caught for ever.
const MOST_EVENTS: usize = 100_000;

/// Follows a ray that arrives in the unit direction `from` (z < 0 means onto the upper side), with uniform numbers in
/// [0, 1) from `random`. `None` where the ray was given up.
pub fn follow(leaf: &LayeredLeaf, from: [f64; 3], random: &mut impl FnMut() -> f64) -> Option<RayExit> {
    let mut d = from;
    let mut down = d[2] < 0.0;
    let mut k = if down { 0 } else { INTERFACES.len() - 1 };
    let mut crossings = 0.0;
    for _ in 0..MOST_EVENTS {
        let interface = &INTERFACES[k];
        let (here, next) = if down { (interface.above, interface.below) } else { (interface.below, interface.above) };
        let mu = d[2].abs();
        if here == LeafMedium::Mesophyll {
            crossings += leaf.path.length(mu);
        }
        let (n1, n2) = (index(leaf, here), index(leaf, next));
        let ratio = n1 / n2;
        // In the form 1 − ratio² (1 − μ²) a small μ would lose its digits.
        let square = (1.0 - ratio) * (1.0 + ratio) + ratio * ratio * mu * mu;
        let reflected = if square <= 0.0 { 1.0 } else { fresnel(n1, mu, n2, square.sqrt()) };
        let mirrored = random() < reflected;
        let tissue = match (down, mirrored) {
            (true, true) => interface.down_reflected,
            (true, false) => interface.down_refracted,
            (false, true) => interface.up_reflected,
            (false, false) => interface.up_refracted,
        };
        if mirrored {
            d[2] = -d[2];
            down = !down;
        } else {
            d = [ratio * d[0], ratio * d[1], square.max(0.0).sqrt().copysign(d[2])];
        }
        if let Some(tissue) = tissue {
            d = turned(d, oblateness(leaf, tissue), random);
        }
        match (k, down) {
            (0, false) => return Some(RayExit { direction: d, crossings }),
            (5, true) => return Some(RayExit { direction: d, crossings }),
            (_, true) => k += 1,
            (_, false) => k -= 1,
        }
    }
    None
}

fn index(leaf: &LayeredLeaf, medium: LeafMedium) -> f64 {
    match medium {
        LeafMedium::Air => 1.0,
        LeafMedium::Epidermis => leaf.n_cuticle,
        LeafMedium::Mesophyll => leaf.n_mesophyll,
        LeafMedium::Antidermal => leaf.n_antidermal,
    }
}

fn oblateness(leaf: &LayeredLeaf, tissue: LeafTissue) -> f64 {
    match tissue {
        LeafTissue::Cuticle => leaf.oblateness.cuticle,
        LeafTissue::Epidermis => leaf.oblateness.epidermis,
        LeafTissue::Palisade => leaf.oblateness.palisade,
        LeafTissue::Spongy => leaf.oblateness.spongy,
    }
}

/// A direction of the lobe around the unit vector `d`, drawn again until it is on the same side of the plane z = 0.
pub fn turned(d: [f64; 3], ob: f64, random: &mut impl FnMut() -> f64) -> [f64; 3] {
    if ob.is_infinite() {
        return d;
    }
    // Two unit vectors across d (Duff et al., "Building an orthonormal basis, revisited", JCGT 6, 2017).
    let sign = 1f64.copysign(d[2]);
    let a = -1.0 / (sign + d[2]);
    let b = d[0] * d[1] * a;
    let x = [1.0 + sign * d[0] * d[0] * a, sign * b, -sign * d[0]];
    let y = [b, sign + d[1] * d[1] * a, -d[1]];
    loop {
        // ξ in (0, 1], so that its power is not 0
        let alpha = lobe::polar(1.0 - random(), ob);
        let (sin, cos) = alpha.sin_cos();
        let (q, p) = (TAU * random()).sin_cos();
        let new: [f64; 3] = std::array::from_fn(|k| d[k] * cos + (x[k] * p + y[k] * q) * sin);
        if new[2] * d[2] > 0.0 {
            let length = (new[0] * new[0] + new[1] * new[1] + new[2] * new[2]).sqrt();
            return new.map(|v| v / length);
        }
        // Light exactly along the plane has no side, so its direction stays as it is.
        if d[2] == 0.0 {
            return d;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Side, exact, walk};
    use super::*;
    use rand::{RngExt, SeedableRng};

    /// Compares R and T with the exact method, which shares only Fresnel's formula, and directions with the vector
    /// code.
    #[test]
    fn single_rays_end_where_others_do() {
        let leaf = LayeredLeaf::soybean(0.5147);
        for (side, degrees) in [(Side::Front, 40.0f64), (Side::Back, 45.0)] {
            let at = degrees.to_radians();
            let down = side == Side::Front;
            let from = [at.sin(), 0.0, if down { -at.cos() } else { at.cos() }];
            let mut rng = rand_pcg::Pcg64::seed_from_u64(5);
            let rays = 60_000;
            let (mut r, mut t, mut forward, mut squares) = (0.0, 0.0, 0.0, 0.0);
            for _ in 0..rays {
                let exit = follow(&leaf, from, &mut || rng.random::<f64>()).unwrap();
                let kept = (-leaf.depth * exit.crossings).exp();
                if (exit.direction[2] > 0.0) == down {
                    r += kept;
                    forward += kept * exit.direction[0];
                } else {
                    t += kept;
                }
                squares += kept * kept;
            }
            let n = f64::from(rays);
            let want = exact::response(&leaf, side, at).unwrap();
            let error = 4.0 * squares.sqrt() / n;
            assert!((r / n - want.reflectance).abs() < error && (t / n - want.transmittance).abs() < error);
            // The mean of sin θ along the plane of incidence, from the goniometer's patches.
            let seen = walk::directions(&leaf, side, at, 200_000, 1, &|| false);
            let mut along = 0.0;
            for ring in 0..10 {
                for sector in 0..40 {
                    let (zenith, azimuth) = ((f64::from(ring) + 0.5) * 9f64, (f64::from(sector) + 0.5) * 9f64);
                    let share = seen.reading(ring as usize, sector as usize).fraction.0;
                    along -= share * zenith.to_radians().sin() * azimuth.to_radians().cos();
                }
            }
            assert!((forward / n - along).abs() < error + 2e-3, "{} {along}", forward / n);
        }
    }

    #[test]
    fn level_light_and_clear_layers_end() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(5);
        let mut random = || rng.random::<f64>();
        let leaf = LayeredLeaf::soybean(0.0);
        // Light along the plane is mirrored completely.
        let level = follow(&leaf, [1.0, 0.0, -0.0], &mut random).unwrap();
        assert_eq!(level.crossings, 0.0);
        let air = LayeredLeaf { n_cuticle: 1.0, n_mesophyll: 1.0, n_antidermal: 1.0, ..leaf };
        let through = follow(&air, [0.6, 0.0, -0.8], &mut random).unwrap();
        assert!(through.direction[2] < 0.0 && through.crossings >= 1.0);
    }
}
