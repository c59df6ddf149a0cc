//! The lobe of B1 (Eq. 2). A ray is turned by an angle α with the density (ob + 1)/2π · cos^ob α around its own
//! direction, where ob is the oblateness. The direction is drawn again where it would leave the ray's side of the
//! leaf's plane.

use mesophyll_base::quadrature;
use std::f64::consts::{FRAC_PI_2, PI};

/// The polar angle that the uniform number ξ in [0, 1] turns a ray by (Eq. 2): arccos ξ^(1/(ob+1)).
pub fn polar(xi: f64, ob: f64) -> f64 {
    if ob.is_infinite() { 0.0 } else { xi.powf(1.0 / (ob + 1.0)).acos() }
}

/// The density of directions `alpha` away from the ray (1/sr), before any is drawn again.
pub fn density(alpha: f64, ob: f64) -> f64 {
    let cos = alpha.cos();
    if alpha >= FRAC_PI_2 || cos <= 0.0 { 0.0 } else { (ob + 1.0) / (2.0 * PI) * cos.powf(ob) }
}

/// Share of first draws, around a ray at `theta` from the normal (0 to π/2), that stay on the ray's side of the plane.
/// At ob = 1 it is (1 + cos θ)/2.
pub fn acceptance(theta: f64, ob: f64) -> f64 {
    let from = FRAC_PI_2 - theta;
    if ob.is_infinite() || theta <= 0.0 {
        return 1.0;
    }
    // Of the directions that are turned by α, the share arccos(cot α cot θ)/π of all azimuths is below the plane.
    let below = |alpha: f64| {
        let cot = (from.tan() / alpha.tan()).clamp(-1.0, 1.0);
        cot.acos() / PI * 2.0 * PI * density(alpha, ob) * alpha.sin()
    };
    // From its start the density falls over about 1/(ob tan α), and over at most 1/√ob.
    let scale = (1.0 / ((ob + 1.0) * from.tan())).min(1.0 / (ob + 1.0).sqrt());
    let rule = quadrature::unit(24);
    let mut ends = vec![from];
    ends.extend([1.0, 3.0, 8.0, 20.0, 45.0].map(|k| from + k * scale).into_iter().filter(|e| *e < FRAC_PI_2 - 1e-9));
    ends.push(FRAC_PI_2);
    let mut lost = 0.0;
    for (k, pair) in ends.windows(2).enumerate() {
        let length = pair[1] - pair[0];
        for &(y, w) in &rule {
            // The share of azimuths starts like a root, and a small power of the cosine ends like one.
            let (x, dx) = match k {
                0 => (y * y, 2.0 * y * w),
                _ if k + 2 == ends.len() => (1.0 - (1.0 - y).powi(2), 2.0 * (1.0 - y) * w),
                _ => (y, w),
            };
            lost += length * dx * below(pair[0] + length * x);
        }
    }
    1.0 - lost
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn acceptance_has_its_closed_forms() {
        for k in 0..=90 {
            let theta = f64::from(k).to_radians();
            assert!((acceptance(theta, 1.0) - 0.5 * (1.0 + theta.cos())).abs() < 1e-9, "{k}");
            // half of the uniform hemisphere is cut along a plane: a lune
            assert!((acceptance(theta, 0.0) - (1.0 - theta / PI)).abs() < 1e-9, "{k}");
        }
        for ob in [0.0, 0.3, 1.0, 5.0, 100.0, 1e6] {
            assert!((acceptance(FRAC_PI_2, ob) - 0.5).abs() < 1e-7, "{ob}: {}", acceptance(FRAC_PI_2, ob));
            assert!((acceptance(0.0, ob) - 1.0).abs() < 1e-12);
        }
        // with ob = 3, by the moments of a cosine: 1/2 + 3/4 cos θ - 1/4 cos³ θ
        for theta in [0.3f64, 0.9, 1.4] {
            let c = theta.cos();
            assert!((acceptance(theta, 3.0) - (0.5 + 0.75 * c - 0.25 * c.powi(3))).abs() < 1e-9);
        }
    }

    #[test]
    fn the_polar_angle_belongs_to_the_density() {
        for ob in [0.0, 1.0, 5.0, 30.0] {
            for xi in [0.1, 0.5, 0.9] {
                // the share of directions further away than the angle is ξ
                let alpha = polar(xi, ob);
                let sum: f64 = quadrature::unit(64)
                    .iter()
                    .map(|(x, w)| {
                        let a = alpha + (FRAC_PI_2 - alpha) * x;
                        w * (FRAC_PI_2 - alpha) * 2.0 * PI * a.sin() * density(a, ob)
                    })
                    .sum();
                assert!((sum - xi).abs() < 1e-9);
            }
        }
        assert_eq!(polar(0.2, f64::INFINITY), 0.0);
    }
}
