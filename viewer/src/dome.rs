//! A sky's harmonics as the shader reads them, and the weight that a gloss lobe gives to each band.
//!
//! Y_lm = K_lm p_lm(z) Re or Im (x + iy)^m, where p_mm = 1 and (l − m) p_lm = (2l − 1) z p_{l−1,m} − (l + m − 1)
//! p_{l−2,m}. The shader runs this recurrence, and the coefficients already contain the K_lm. Up to degree six, f32
//! loses no digit that a picture shows.
//!
//! The lobe seen from v is approximated by one that is round about its own mean direction R. Its band l is then W_l = ∫
//! f cosθ P_l(ω·R) / ∫ f cosθ. The first two bands are exact for any roughness and any slant. The error is the lobe's
//! departure from roundness in bands 2 and above.

use crate::lobe::{FLOOR, cavity, polar_nodes};
use crate::scene::{Lobe, SkyDome};
use std::f64::consts::PI;

/// The largest number of bands, l = 0 … 6.
pub const MOST_BANDS: usize = 7;

/// Number N of bands that N² coefficients have; `None` where their number is no square from 1 to 49.
pub(crate) fn bands(dome: &SkyDome) -> Option<usize> {
    (1..=MOST_BANDS).find(|n| n * n == dome.harmonics.len())
}

/// K_lm (2m − 1)!!, the factor that a coefficient contains.
pub(crate) fn norm(l: usize, m: usize) -> f64 {
    let ratio: f64 = ((l - m + 1)..=(l + m)).map(|k| k as f64).product();
    let odd: f64 = (1..=m).map(|k| (2 * k - 1) as f64).product();
    let two = if m == 0 { 1.0 } else { 2.0 };
    (two * (2 * l + 1) as f64 / (4.0 * PI) / ratio).sqrt() * odd
}

/// The harmonic Y_lm in the unit direction `d`, by the shader's recurrence and [`norm`]: what the tests below say of it
/// holds for the shader's harmonics. So it is not taken from the room `sky`, whose recurrence carries the norms along.
pub(crate) fn harmonic(l: usize, m: isize, [x, y, z]: [f64; 3]) -> f64 {
    let a = m.unsigned_abs();
    let (mut cos, mut sin) = (1.0, 0.0);
    for _ in 0..a {
        (cos, sin) = (cos * x - sin * y, cos * y + sin * x);
    }
    let (mut before, mut p) = (0.0, 1.0);
    for k in a + 1..=l {
        (before, p) = (p, ((2 * k - 1) as f64 * z * p - (k + a - 1) as f64 * before) / (k - a) as f64);
    }
    norm(l, a) * p * if m < 0 { sin } else { cos }
}

/// The coefficients for the shader, at l(l+1)+m.
pub(crate) fn coefficients(dome: &SkyDome) -> [[f32; 4]; MOST_BANDS * MOST_BANDS] {
    let mut out = [[0.0; 4]; MOST_BANDS * MOST_BANDS];
    for l in 0..bands(dome).unwrap_or(0) {
        for k in 0..=2 * l {
            let c = dome.harmonics[l * l + k];
            let n = norm(l, k.abs_diff(l)) * f64::from(dome.strength);
            let [r, g, b] = c.map(|v| (n * f64::from(v)) as f32);
            out[l * l + k] = [r, g, b, 0.0];
        }
    }
    out
}

/// The mean direction of a lobe and its weights of bands 1 to 6, on the same grid as
/// [`crate::lobe::ShaderAlbedoTable`].
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct MeanTable {
    pub m_min: f64,
    pub m_max: f64,
    /// The first `ROWS` rows hold x of the mean direction (from the normal away from the view) over the view's sine,
    /// its z, W_1 and W_2. As many rows follow with W_3 … W_6.
    pub texels: Vec<[f32; 4]>,
}

impl MeanTable {
    pub const COLUMNS: usize = 96;
    pub const ROWS: usize = 24;

    pub fn new(lobe: Lobe, m_min: f64, m_max: f64) -> MeanTable {
        let polar = polar_nodes(20);
        let (mut first, mut second) = (Vec::new(), Vec::new());
        for row in 0..Self::ROWS {
            let m = m_min * (m_max / m_min).powf(row as f64 / (Self::ROWS - 1) as f64);
            for column in 0..Self::COLUMNS {
                let x = FLOOR.sqrt() + (1.0 - FLOOR.sqrt()) * column as f64 / (Self::COLUMNS - 1) as f64;
                // Seen along the normal, the lobe does not lean. The table needs the limit of x over the sine.
                let nv = (x * x).min(1.0 - 1e-6);
                let mean = Mean::new(lobe, nv, m, &polar, 32);
                let w = mean.weights.map(|v| v as f32);
                first.push([(mean.direction[0] / (1.0 - nv * nv).sqrt()) as f32, mean.direction[1] as f32, w[1], w[2]]);
                second.push([w[3], w[4], w[5], w[6]]);
            }
        }
        first.extend(second);
        MeanTable { m_min, m_max, texels: first }
    }
}

/// The mean direction of one lobe and its weights.
pub(crate) struct Mean {
    /// Unit vector: x along the surface away from the view, z along the normal.
    pub direction: [f64; 2],
    /// W_0 … W_6.
    pub weights: [f64; MOST_BANDS],
}

impl Mean {
    /// The mean over half vectors drawn from D cosα, as in [`crate::lobe::directional_albedo`].
    pub fn new(lobe: Lobe, nv: f64, m: f64, polar: &[(f64, f64)], azimuths: usize) -> Mean {
        let sin_v = (1.0 - nv * nv).max(0.0).sqrt();
        // Direction of the light (x away from the view, z), and its weight.
        let mut lights = Vec::with_capacity(polar.len() * azimuths);
        for &(share, weight) in polar {
            let tan2 = lobe.quantile(share, m);
            let nh = 1.0 / (1.0 + tan2).sqrt();
            let sin_h = (tan2.sqrt() * nh).min(1.0);
            for k in 0..azimuths {
                let phi = PI * (k as f64 + 0.5) / azimuths as f64;
                let hx = sin_h * phi.cos();
                let vh = nv * nh + sin_v * hx;
                let nl = 2.0 * vh * nh - nv;
                if vh > 0.0 && nl > 0.0 {
                    let w = weight * lobe.fresnel(vh) * cavity(nh, nv, nl, vh) * vh / (nv * nh);
                    lights.push([sin_v - 2.0 * vh * hx, nl, w]);
                }
            }
        }
        let sum = |f: &dyn Fn(&[f64; 3]) -> f64| lights.iter().map(f).sum::<f64>();
        let total = sum(&|l| l[2]).max(f64::MIN_POSITIVE);
        let (x, z) = (sum(&|l| l[0] * l[2]), sum(&|l| l[1] * l[2]));
        let length = x.hypot(z);
        if length <= 0.0 {
            return Mean { direction: [0.0, 1.0], weights: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0] };
        }
        let direction = [x / length, z / length];
        let mut weights = [0.0; MOST_BANDS];
        for l in &lights {
            let c = direction[0] * l[0] + direction[1] * l[1];
            let (mut before, mut p) = (1.0, c);
            weights[0] += l[2];
            for (k, w) in weights.iter_mut().enumerate().skip(1) {
                *w += l[2] * p;
                let k = k as f64;
                (before, p) = (p, ((2.0 * k + 1.0) * c * p - k * before) / (k + 1.0));
            }
        }
        Mean { direction, weights: weights.map(|w| w / total) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The shader's recurrence agrees with closed forms of the harmonics (x, y, z of a unit vector).
    #[test]
    fn folded_coefficients_are_the_harmonics() {
        let d: [f64; 3] = [0.48, 0.6, 0.64];
        let [x, y, z] = d;
        let value = |l: usize, m: isize| harmonic(l, m, d);
        for (l, m, want) in [
            (0, 0, (1.0 / (4.0 * PI)).sqrt()),
            (1, -1, (3.0 / (4.0 * PI)).sqrt() * y),
            (1, 0, (3.0 / (4.0 * PI)).sqrt() * z),
            (2, 1, (15.0 / (4.0 * PI)).sqrt() * x * z),
            (2, 2, (15.0 / (16.0 * PI)).sqrt() * (x * x - y * y)),
            (3, 3, (35.0 / (32.0 * PI)).sqrt() * (x * x * x - 3.0 * x * y * y)),
            (3, -2, (105.0 / (4.0 * PI)).sqrt() * x * y * z),
            (4, 0, 3.0 / (16.0 * PI.sqrt()) * (35.0 * z.powi(4) - 30.0 * z * z + 3.0)),
        ] {
            assert!((value(l, m) - want).abs() < 1e-14, "{l} {m}: {} {want}", value(l, m));
        }
        // Unsöld's theorem: the squares of a degree sum to (2l+1)/(4π).
        for l in 0..MOST_BANDS {
            let sum: f64 = (-(l as isize)..=l as isize).map(|m| value(l, m).powi(2)).sum();
            assert!((sum * 4.0 * PI / (2 * l + 1) as f64 - 1.0).abs() < 1e-12, "{l}");
        }
    }

    /// A nearly smooth mirror sends the view into its mirror direction and keeps every band. A rough one is wide.
    #[test]
    fn a_mirror_is_a_mirror() {
        let polar = polar_nodes(20);
        for nv in [0.3f64, 0.7, 1.0] {
            let mean = Mean::new(Lobe::Beckmann, nv, 0.002, &polar, 32);
            assert!((mean.direction[1] - nv).abs() < 1e-4 && (mean.direction[0] - (1.0 - nv * nv).sqrt()).abs() < 1e-3);
            assert!(mean.weights.iter().all(|w| (w - 1.0).abs() < 1e-3), "{:?}", mean.weights);
        }
        let mean = Mean::new(Lobe::Beckmann, 0.8, 0.4, &polar, 32);
        assert!(mean.weights[1] < 0.95 && mean.weights[6] < mean.weights[1] && mean.weights[0] == 1.0);
    }
}
