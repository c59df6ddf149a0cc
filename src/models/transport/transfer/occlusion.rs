//! Multi-bounce ambient occlusion with translucent leaves: the cheap way to the light that arrives between leaves
//! (Habel 2009, §3.3.10, names it without formulas).
//!
//! From an anchor, rays find out what share of the light around is hidden, and by what. No path goes on from there.
//! Instead it is assumed that a surface in the way gets the light that the anchor itself gets: a side whose normal has
//! the cosine c with the anchor's normal gets the irradiance
//!
//! ```text
//! E(c) = (1 + c)/2 · E₁ + (1 − c)/2 · E₂
//! ```
//! where E₁ is the irradiance of the anchor's front and E₂ of its back. A surface with reflectance ρ and transmittance
//! τ shows the radiance (ρ E(c) + τ E(−c))/π on its viewed side. Integrated over the hidden directions, E is a linear
//! function of itself, E = S + M E, where S is what comes straight from sky and sun. M has two rows and two columns for
//! each channel, and (1 − M)⁻¹ is the sum over all numbers of scatterings. Jimenez et al. 2016 ("Practical Realtime
//! Strategies for Accurate Indirect Occlusion") do this for an opaque surface with one side.
//!
//! Surfaces that absorb nothing, in an even light, show exactly that light: each row of 1 − M is then what S sees of
//! the sky. Black surfaces are exact too. In between, errors are those of the assumption. Gloss between leaves is left
//! out.

/// The 2×2 matrix of a channel, or a part of it.
type Exchange = [[f64; 2]; 2];

/// Below this determinant an anchor is shut in by surfaces that absorb nothing. No light gets there.
const SHUT: f64 = 1e-9;

/// What hides the light around an anchor.
#[derive(Debug, Clone, Default)]
pub(super) struct Hidden {
    /// Row by row and channel by channel: what a row gets of the irradiances E₁ and E₂.
    shown: Vec<[[f64; 2]; 3]>,
    /// Irradiance of front and back by the sun, channel by channel.
    sun: [[f64; 2]; 3],
}

impl Hidden {
    /// Nothing, for an anchor with so many rows.
    pub fn none(rows: usize) -> Hidden {
        Hidden { shown: vec![[[0.0; 2]; 3]; rows], sun: [[0.0; 2]; 3] }
    }

    /// Adds a surface in the way: `values` are the weighted values of the rows in its direction, `cosine` is that of
    /// its viewed side's normal with the anchor's, and ρ and τ are those of its viewed side.
    pub fn add(&mut self, values: &[f64], cosine: f64, rho: [f64; 3], tau: [f64; 3]) {
        let (same, other) = (0.5 * (1.0 + cosine), 0.5 * (1.0 - cosine));
        for c in 0..3 {
            let by = [rho[c] * same + tau[c] * other, rho[c] * other + tau[c] * same];
            for (to, value) in self.shown.iter_mut().zip(values) {
                (0..2).for_each(|k| to[c][k] += value * by[k] / std::f64::consts::PI);
            }
        }
    }

    /// Adds the sun's irradiance on the side `back`.
    pub fn add_sun(&mut self, back: bool, irradiance: [f64; 3]) {
        (0..3).for_each(|c| self.sun[c][usize::from(back)] += irradiance[c]);
    }

    /// Adds the light that surfaces in the way show to a `round` of entries, which hold what comes straight, column by
    /// column. A round has this `share` of all paths. `irradiance` computes E₁ and E₂ from the values of the rows: it
    /// is given a function that returns the value of a row.
    pub fn close(
        &self,
        round: &mut [[f32; 4]],
        columns: usize,
        share: f64,
        irradiance: impl Fn(&dyn Fn(usize) -> f64) -> [f64; 2],
    ) {
        for c in 0..3 {
            let [to_front, to_back] = [0, 1].map(|from| irradiance(&|row| self.shown[row][c][from]));
            let matrix: Exchange = [[to_front[0], to_back[0]], [to_front[1], to_back[1]]].map(|r| r.map(|v| v / share));
            let [sun_front, sun_back] = self.sun[c];
            for column in 0..columns {
                let straight = irradiance(&|row| {
                    let entry = round[row * columns + column];
                    f64::from(entry[c]) + f64::from(entry[3])
                });
                let source = [straight[0] + sun_front, straight[1] + sun_back].map(|v| v / share);
                let [front, back] = solve(matrix, source);
                for (row, by) in self.shown.iter().enumerate() {
                    round[row * columns + column][c] += (by[c][0] * front + by[c][1] * back) as f32;
                }
            }
        }
    }
}

/// Solves E = S + M E. Where an anchor is shut in, nothing arrives.
fn solve(m: Exchange, s: [f64; 2]) -> [f64; 2] {
    let (a, b, c, d) = (1.0 - m[0][0], -m[0][1], -m[1][0], 1.0 - m[1][1]);
    let determinant = a * d - b * c;
    if !(determinant > SHUT) {
        return [0.0; 2];
    }
    [(d * s[0] - b * s[1]) / determinant, (a * s[1] - c * s[0]) / determinant]
}
