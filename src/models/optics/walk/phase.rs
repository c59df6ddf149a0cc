//! Random directions: Henyey–Greenstein scattering, Lambertian emission, and turning a direction by an angle.

use super::tally::uniform;
use rand_pcg::Pcg64;
use std::f64::consts::PI;

/// A unit vector along the travel of light.
pub type Direction = [f64; 3];

/// Random cosine between the directions before and after scattering (Henyey & Greenstein 1941, by the inverse of the
/// cumulative distribution); isotropic at g = 0.
pub(crate) fn henyey_greenstein(g: f64, rng: &mut Pcg64) -> f64 {
    let x = 2.0 * uniform(rng) - 1.0;
    if g.abs() < 1e-5 {
        // The next term of the series is of order g.
        return (x + 1.5 * g * (1.0 - x * x)).clamp(-1.0, 1.0);
    }
    let s = (1.0 - g * g) / (1.0 + g * x);
    ((1.0 + g * g - s * s) / (2.0 * g)).clamp(-1.0, 1.0)
}

/// `d` turned by the angle of this cosine, at a uniformly random azimuth about it.
pub fn scattered(d: Direction, cos: f64, rng: &mut Pcg64) -> Direction {
    let (sin_a, cos_a) = (2.0 * PI * uniform(rng)).sin_cos();
    about(d, [(1.0 - cos * cos).max(0.0).sqrt() * cos_a, (1.0 - cos * cos).max(0.0).sqrt() * sin_a, cos])
}

/// Turns `local`, which is given in a frame whose z axis is the unit vector `axis`, into the frame in which `axis` is
/// given.
///
/// The frame is that of Duff et al. 2017: it branches only on the sign of the axis' z, and is accurate to rounding
/// everywhere.
pub fn about(axis: Direction, local: Direction) -> Direction {
    let (t, b) = tangents(axis);
    let v: Direction = std::array::from_fn(|k| local[0] * t[k] + local[1] * b[k] + local[2] * axis[k]);
    // One Newton step back to unit length, so that rounding does not add up over thousands of collisions.
    let scale = 1.5 - 0.5 * (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    [v[0] * scale, v[1] * scale, v[2] * scale]
}

/// The inverse of [`about`].
pub fn within(axis: Direction, v: Direction) -> Direction {
    let (t, b) = tangents(axis);
    [dot(t, v), dot(b, v), dot(axis, v)]
}

fn tangents(axis: Direction) -> (Direction, Direction) {
    let sign = 1f64.copysign(axis[2]);
    let a = -1.0 / (sign + axis[2]);
    let b = axis[0] * axis[1] * a;
    ([1.0 + sign * axis[0] * axis[0] * a, sign * b, -sign * axis[0]], [b, sign + axis[1] * axis[1] * a, -axis[1]])
}

/// A direction about +z with density cosθ/π.
pub fn lambert(rng: &mut Pcg64) -> Direction {
    let u = uniform(rng);
    let (sin_a, cos_a) = (2.0 * PI * uniform(rng)).sin_cos();
    let sin = (1.0 - u).max(0.0).sqrt();
    [sin * cos_a, sin * sin_a, u.sqrt()]
}

/// The scalar product: the cosine between two unit vectors.
pub fn dot(a: Direction, b: Direction) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
