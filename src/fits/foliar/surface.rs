//! Reflectance R and transmittance T at one wavelength, as functions of absorption and of the epidermis's oblateness.
//! The exact method runs at the nodes of Chebyshev polynomials; the polynomials give values and derivatives in between.
//!
//! Thousands of leaves share the refractive indices of a wavelength. So the exact method runs once for each node
//! instead of at every step of every leaf's fit.

use mesophyll_base::chebyshev;
use mesophyll_optics::foliar::exact::{LeafOperator, Resolution};
use mesophyll_optics::foliar::{LayeredLeaf, MesophyllPath, Oblateness};
use mesophyll_optics::side::Side;

/// Largest oblateness of the epidermis that the fit looks for. The lobe is then 6° wide.
pub const MOST_OBLATE: f64 = 100.0;
/// Nodes over absorption and over ln(1 + oblateness).
const DEPTHS: usize = 26;
const LOBES: usize = 13;
/// At this absorption of one crossing the polynomials' variable d/(d + BEND) is one half. Beyond `BLACK` no light is
/// left.
const BEND: f64 = 0.4;
const BLACK: f64 = 40.0;

/// How finely the exact method is solved at the nodes: better than 2e-5, which is less than the error of interpolation.
const RESOLUTION: Resolution = Resolution { order: 10, piece: 9, azimuth: 12 };

/// The same where the indices of cuticle and mesophyll differ by less than [`CLOSE`], or the wall's is above one of
/// them by less: light of few angles is totally reflected between them, and coarser nodes miss it by up to 1e-4 where
/// lobes are narrow.
const FINER: Resolution = Resolution { order: 14, piece: 11, azimuth: 14 };
const CLOSE: f64 = 0.005;

/// What the fit takes as known of the leaf and the instrument.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoliarFitSetting {
    /// Oblateness of the palisade's lobes.
    pub palisade: f64,
    /// Oblateness of the spongy tissue's lobes.
    pub spongy: f64,
    /// How long a crossing of the mesophyll is.
    pub path: MesophyllPath,
    /// Angle of the light from the normal (radians).
    pub incidence: f64,
}

/// A quantity and its derivatives by absorption and by ln(1 + oblateness).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoliarSensitivity {
    /// The quantity.
    pub value: f64,
    /// Its derivative by absorption times thickness.
    pub by_depth: f64,
    /// Its derivative by ln(1 + oblateness of the epidermis).
    pub by_lobe: f64,
}

/// R and T at one wavelength, from one side.
#[derive(Debug, Clone)]
pub struct ResponseSurface {
    /// For R and T, the coefficients of T_i in the lobe's variable times T_j in the absorption's variable.
    coefficients: [Vec<f64>; 2],
}

/// ln(1 + [`MOST_OBLATE`]).
pub fn widest() -> f64 {
    MOST_OBLATE.ln_1p()
}

impl ResponseSurface {
    /// The surface of a leaf whose refractive indices (cuticle, mesophyll, antidermal wall) are `indices`.
    pub fn new(indices: [f64; 3], setting: &FoliarFitSetting, side: Side) -> ResponseSurface {
        let [n_cuticle, n_mesophyll, n_antidermal] = indices;
        let top = BLACK / (BLACK + BEND);
        let mut nodes = [vec![0.0; LOBES * DEPTHS], vec![0.0; LOBES * DEPTHS]];
        for i in 0..LOBES {
            let epidermis = (0.5 * widest() * (1.0 + chebyshev::node(i, LOBES))).exp_m1();
            let FoliarFitSetting { palisade, spongy, path, .. } = *setting;
            let oblateness = Oblateness { epidermis, palisade, spongy, ..Oblateness::USUAL };
            let leaf = LayeredLeaf { depth: 0.0, n_cuticle, n_mesophyll, n_antidermal, oblateness, path };
            let above = |low: f64, high: f64| high > low && high - low < CLOSE;
            let close = above(n_cuticle, n_mesophyll)
                || above(n_mesophyll, n_cuticle)
                || above(n_mesophyll, n_antidermal)
                || above(n_cuticle, n_antidermal);
            let prepared = LeafOperator::new(&leaf, if close { FINER } else { RESOLUTION });
            for j in 0..DEPTHS {
                let v = 0.5 * top * (1.0 + chebyshev::node(j, DEPTHS));
                let found = prepared.solve(BEND * v / (1.0 - v)).response(side, setting.incidence);
                nodes[0][i * DEPTHS + j] = found.reflectance;
                nodes[1][i * DEPTHS + j] = found.transmittance;
            }
        }
        let coefficients = nodes.map(|values| {
            let mut out = vec![0.0; LOBES * DEPTHS];
            for i in 0..LOBES {
                let (of_lobe, _) = chebyshev::slopes::<LOBES>(chebyshev::node(i, LOBES));
                for j in 0..DEPTHS {
                    let (of_depth, _) = chebyshev::slopes::<DEPTHS>(chebyshev::node(j, DEPTHS));
                    for (k, a) in of_lobe.iter().enumerate() {
                        for (l, b) in of_depth.iter().enumerate() {
                            let scale = [1.0, 2.0][usize::from(k > 0)] * [1.0, 2.0][usize::from(l > 0)];
                            let n = (LOBES * DEPTHS) as f64;
                            out[k * DEPTHS + l] += scale / n * a * b * values[i * DEPTHS + j];
                        }
                    }
                }
            }
            out
        });
        ResponseSurface { coefficients }
    }

    /// Σ `weights` · `surfaces`.
    pub fn mixed(weights: &[f64], surfaces: &[ResponseSurface]) -> ResponseSurface {
        let mut coefficients = [vec![0.0; LOBES * DEPTHS], vec![0.0; LOBES * DEPTHS]];
        for (weight, surface) in weights.iter().zip(surfaces) {
            for (out, of) in coefficients.iter_mut().zip(&surface.coefficients) {
                out.iter_mut().zip(of).for_each(|(out, x)| *out += weight * x);
            }
        }
        ResponseSurface { coefficients }
    }

    /// Largest difference in R and T between two surfaces, over a grid of absorptions and oblateness.
    pub fn distance(&self, other: &ResponseSurface) -> f64 {
        let mut worst = 0.0f64;
        for i in 0..=12 {
            for j in 0..=24 {
                let (lobe, v) = (widest() * f64::from(i) / 12.0, BLACK / (BLACK + BEND) * f64::from(j) / 24.0);
                let [a, b] = [self, other].map(|s| s.at(BEND * v / (1.0 - v), lobe));
                let off = a.iter().zip(&b).map(|(a, b)| (a.value - b.value).abs());
                worst = off.fold(worst, f64::max);
            }
        }
        worst
    }

    /// R and T, for an absorption times thickness of 0 or more and a ln(1 + oblateness) from 0 to [`widest`].
    pub fn at(&self, depth: f64, lobe: f64) -> [FoliarSensitivity; 2] {
        let top = BLACK / (BLACK + BEND);
        let inside = depth.clamp(0.0, BLACK);
        let (x, dx) = (2.0 * inside / (inside + BEND) / top - 1.0, 2.0 * BEND / (inside + BEND).powi(2) / top);
        let dx = if depth > BLACK { 0.0 } else { dx };
        let (y, dy) = (2.0 * lobe / widest() - 1.0, 2.0 / widest());
        let (of_depth, slope_depth) = chebyshev::slopes::<DEPTHS>(x);
        let (of_lobe, slope_lobe) = chebyshev::slopes::<LOBES>(y);
        [0, 1].map(|which| {
            let (mut value, mut by_depth, mut by_lobe) = (0.0, 0.0, 0.0);
            for (row, (a, da)) in self.coefficients[which].chunks_exact(DEPTHS).zip(of_lobe.iter().zip(&slope_lobe)) {
                let along: f64 = row.iter().zip(&of_depth).map(|(c, b)| c * b).sum();
                let slope: f64 = row.iter().zip(&slope_depth).map(|(c, b)| c * b).sum();
                value += a * along;
                by_depth += a * slope * dx;
                by_lobe += da * along * dy;
            }
            FoliarSensitivity { value, by_depth, by_lobe }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_optics::foliar::exact;

    /// Values and derivatives are compared with the exact method itself.
    #[test]
    fn between_its_nodes_it_is_the_exact_method() {
        let setting = FoliarFitSetting { palisade: 1.0, spongy: 5.0, path: MesophyllPath::Sieve, incidence: 0.14 };
        let surface = ResponseSurface::new([1.51, 1.416, 1.411], &setting, Side::Front);
        for (depth, epidermis) in
            [(0.0, 5.0), (0.02, 0.0), (0.13, 2.2), (0.6, 14.0), (1.7, 40.0), (5.0, 90.0), (30.0, 1.0)]
        {
            let leaf = LayeredLeaf {
                depth,
                n_cuticle: 1.51,
                n_mesophyll: 1.416,
                n_antidermal: 1.411,
                oblateness: Oblateness { epidermis, ..Oblateness::USUAL },
                path: MesophyllPath::Sieve,
            };
            let want = exact::derivatives(&leaf, Side::Front, setting.incidence);
            let got = surface.at(depth, epidermis.ln_1p());
            for (got, want) in got.iter().zip([want.reflectance, want.transmittance]) {
                assert!((got.value - want.value).abs() < 1e-4, "{depth} {epidermis}: {got:?} {want:?}");
                assert!((got.by_depth - want.by[0]).abs() < 2e-3, "{depth} {epidermis}: {got:?} {want:?}");
                assert!(
                    (got.by_lobe - want.by[4] * (1.0 + epidermis)).abs() < 2e-3,
                    "{depth} {epidermis}: {got:?} {want:?}"
                );
            }
        }
    }
}
