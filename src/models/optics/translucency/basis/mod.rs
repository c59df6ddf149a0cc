//! Functions of direction over the hemisphere, and the projection of samples onto them.
//!
//! The Half-Life 2 basis (McTaggart 2004; H9 Eq. 3.17) has three functions ℋ_i(ω) = √(3/2π) H_i·ω. They are orthonormal
//! over the hemisphere although they are not clamped. They span exactly the linear functions v·ω. So a texel's three
//! coefficients h_i carry the same information as the vector v = √(3/2π) Σ h_i H_i ([`vector`]), which is evaluated by
//! one dot product. The coefficients are what is stored, as in the sources.
//!
//! **Projection.** Samples f(ω_m) with solid angles w_m are fitted by least squares: c = G⁻¹ Σ w_m φ(ω_m) f(ω_m), where
//! G = Σ w_m φ φᵀ is the Gram matrix of the sample set. A function in the span of the basis is reproduced exactly,
//! whatever the samples. The paper's Eq. 3.21 takes the identity for G ([`SampleWeights::Plain`]). With random
//! directions that alone costs some per cent on a flat leaf.

use super::lights::{DirectionRule, DirectionSet};
use nalgebra::DMatrix;
use std::f64::consts::TAU;

/// The three vectors (H9 §3.3.8).
pub const HALF_LIFE_2: [[f64; 3]; 3] = [
    [-0.408_248_290_463_863, -std::f64::consts::FRAC_1_SQRT_2, 0.577_350_269_189_625_7],
    [-0.408_248_290_463_863, std::f64::consts::FRAC_1_SQRT_2, 0.577_350_269_189_625_7],
    [0.816_496_580_927_726, 0.0, 0.577_350_269_189_625_7],
];

/// Each coefficient of a flat uniform leaf, f = n·ω (H9 Eq. 3.22): √(2π)/3.
pub const FLAT: f64 = 0.835_542_758_210_333_9;

/// A set of functions on the upper hemisphere.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HemisphereBasis {
    /// Three linear functions.
    HalfLife2,
    /// The Half-Life 2 functions of a light whose part along the blade is first multiplied by (2z/(1+z))^¼ ([`bent`]).
    /// A flat leaf has the same three coefficients as before. But the difference between a light from one side and from
    /// the other goes to zero at the horizon, as with relief. With `count` 6 there are also z² and the two functions of
    /// second order in azimuth.
    Bent {
        /// 3 or 6 functions.
        count: usize,
    },
    /// The first 4 or 6 functions of the H-basis (Habel & Wimmer 2010): constant, linear, and two of second order in
    /// the tangent plane.
    HBasis {
        /// 4 or 6 functions.
        count: usize,
    },
    /// Real spherical harmonics of bands below `bands` (at most 6), restricted to the hemisphere; not orthogonal there.
    Spherical {
        /// How many bands, at most 6.
        bands: usize,
    },
    /// Hemispherical harmonics (Gautron et al. 2004), Legendre functions shifted to 2z − 1, of bands below `bands` (at
    /// most 6).
    Hemispherical {
        /// How many bands, at most 6.
        bands: usize,
    },
    /// z times polynomials of x and y of degree below `degree` (at most 3: 1, 3 or 6 functions). All of them are zero
    /// at the horizon, like the light on a flat leaf.
    Cosine {
        /// The polynomials' degree plus one, at most 3.
        degree: usize,
    },
}

impl From<mesophyll_base::surface::basis::TranslucencyBasis> for HemisphereBasis {
    fn from(drawn: mesophyll_base::surface::basis::TranslucencyBasis) -> HemisphereBasis {
        match drawn {
            mesophyll_base::surface::basis::TranslucencyBasis::HalfLife2 => HemisphereBasis::HalfLife2,
            mesophyll_base::surface::basis::TranslucencyBasis::Bent => HemisphereBasis::Bent { count: 3 },
        }
    }
}

/// How samples are weighted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleWeights {
    /// Least squares over solid angle: solid angles and the Gram matrix of the sample set.
    Gram,
    /// The paper's sum (H9 Eq. 3.21): the Gram matrix is taken for the identity. For orthonormal bases only.
    Plain,
}

impl HemisphereBasis {
    /// Number of functions, and of coefficients a texel.
    pub fn count(self) -> usize {
        match self {
            HemisphereBasis::HalfLife2 => 3,
            HemisphereBasis::Bent { count } => {
                if count > 3 {
                    6
                } else {
                    3
                }
            }
            HemisphereBasis::HBasis { count } => count.min(6),
            HemisphereBasis::Spherical { bands } | HemisphereBasis::Hemispherical { bands } => bands.min(6).pow(2),
            HemisphereBasis::Cosine { degree } => [0, 1, 3, 6][degree.min(3)],
        }
    }

    /// Those that `fit translucency` offers, the default first.
    pub const OFFERED: [HemisphereBasis; 7] = [
        HemisphereBasis::HalfLife2,
        HemisphereBasis::Bent { count: 3 },
        HemisphereBasis::Bent { count: 6 },
        HemisphereBasis::HBasis { count: 6 },
        HemisphereBasis::Cosine { degree: 3 },
        HemisphereBasis::Spherical { bands: 3 },
        HemisphereBasis::Hemispherical { bands: 3 },
    ];

    /// Its name in files, in tables and on the command line: the kind of functions and how many there are, such as
    /// `h-basis-6`. Half-Life 2 is a game; its basis has three functions and no number of its own.
    pub fn name(self) -> String {
        match self {
            HemisphereBasis::HalfLife2 => "half-life-2".into(),
            HemisphereBasis::Bent { .. } => format!("bent-{}", self.count()),
            HemisphereBasis::HBasis { .. } => format!("h-basis-{}", self.count()),
            HemisphereBasis::Spherical { .. } => format!("spherical-{}", self.count()),
            HemisphereBasis::Hemispherical { .. } => format!("hemispherical-{}", self.count()),
            HemisphereBasis::Cosine { .. } => format!("cosine-{}", self.count()),
        }
    }

    /// What its functions are, in a few words.
    pub fn describe(self) -> &'static str {
        match self {
            HemisphereBasis::HalfLife2 => "three linear functions, those of the game Half-Life 2",
            HemisphereBasis::Bent { .. } if self.count() == 3 => {
                "the same three of a light that is bent so that its difference between sides ends at the horizon"
            }
            HemisphereBasis::Bent { .. } => "those three, z² and the two of second order in azimuth",
            HemisphereBasis::HBasis { .. } => "the H-basis: constant, linear, and of second order in the tangent plane",
            HemisphereBasis::Spherical { .. } => "spherical harmonics, restricted to the hemisphere",
            HemisphereBasis::Hemispherical { .. } => "harmonics that are orthogonal on the hemisphere",
            HemisphereBasis::Cosine { .. } => "z times polynomials, which vanish at the horizon",
        }
    }

    /// The basis of that [`HemisphereBasis::name`]. Fits of former versions have other names for the two that renderers
    /// draw; these are understood too.
    pub fn named(name: &str) -> Option<HemisphereBasis> {
        let name = match name {
            "half-life 2" => "half-life-2",
            "bent half-life 2, 3" => "bent-3",
            other => other,
        };
        let (kind, number) = name.rsplit_once('-')?;
        let count = number.parse::<usize>().ok()?;
        let of_bands = || (0..=6).find(|bands| bands * bands == count);
        let basis = match kind {
            "half-life" => HemisphereBasis::HalfLife2,
            "bent" => HemisphereBasis::Bent { count },
            "h-basis" => HemisphereBasis::HBasis { count },
            "spherical" => HemisphereBasis::Spherical { bands: of_bands()? },
            "hemispherical" => HemisphereBasis::Hemispherical { bands: of_bands()? },
            "cosine" => HemisphereBasis::Cosine {
                degree: (0..=3).find(|d| HemisphereBasis::Cosine { degree: *d }.count() == count)?,
            },
            _ => return None,
        };
        (basis.name() == name).then_some(basis)
    }

    /// The basis as renderers draw it, if they do.
    pub fn drawn(self) -> Option<mesophyll_base::surface::basis::TranslucencyBasis> {
        mesophyll_base::surface::basis::TranslucencyBasis::ALL
            .into_iter()
            .find(|drawn| HemisphereBasis::from(*drawn) == self)
    }

    /// Bytes for each texel as half floats, the form in which textures keep them.
    pub fn bytes(self) -> usize {
        2 * self.count()
    }

    /// Multiply-adds and square roots of a reconstruction from a direction, the functions included: a shader's work for
    /// each texel.
    pub fn operations(self) -> [usize; 2] {
        match self {
            // For coefficients as they are stored: three dot products, weighted. As a vector ([`vector`]) it takes 3.
            HemisphereBasis::HalfLife2 => [12, 0],
            HemisphereBasis::Bent { .. } => {
                if self.count() > 3 {
                    [25, 2]
                } else {
                    [16, 2]
                }
            }
            HemisphereBasis::HBasis { count } => [count.min(6) + if count > 4 { 4 } else { 1 }, 0],
            // Each function of higher order takes one more product than those before.
            HemisphereBasis::Spherical { .. } => [2 * self.count(), 0],
            HemisphereBasis::Hemispherical { .. } => [2 * self.count() + 2, usize::from(self.count() > 1)],
            HemisphereBasis::Cosine { .. } => [2 * self.count(), 0],
        }
    }

    /// Whether ∫ φ_i φ_j dω is the identity.
    pub fn orthonormal(self) -> bool {
        matches!(
            self,
            HemisphereBasis::HalfLife2 | HemisphereBasis::HBasis { .. } | HemisphereBasis::Hemispherical { .. }
        )
    }

    /// Function `i` (below [`HemisphereBasis::count`]) in a unit direction with z ≥ 0.
    pub fn value(self, i: usize, direction: [f64; 3]) -> f64 {
        let [x, y, z] = direction;
        match self {
            HemisphereBasis::HalfLife2 => {
                let h = HALF_LIFE_2[i];
                (3.0 / TAU).sqrt() * (h[0] * x + h[1] * y + h[2] * z)
            }
            HemisphereBasis::Bent { .. } => match i {
                0..3 => HemisphereBasis::HalfLife2.value(i, self.argument(direction)),
                3 => z * z,
                4 => z / (1.0 + z) * (x * x - y * y),
                _ => z / (1.0 + z) * 2.0 * x * y,
            },
            HemisphereBasis::HBasis { .. } => match i {
                0 => 1.0 / TAU.sqrt(),
                1 => (3.0 / TAU).sqrt() * y,
                2 => (3.0 / TAU).sqrt() * (2.0 * z - 1.0),
                3 => (3.0 / TAU).sqrt() * x,
                4 => (15.0 / TAU).sqrt() * x * y,
                _ => 0.5 * (15.0 / TAU).sqrt() * (x * x - y * y),
            },
            HemisphereBasis::Spherical { .. } => harmonic(i, z, x, y) / 2f64.sqrt(),
            HemisphereBasis::Hemispherical { .. } => harmonic(i, 2.0 * z - 1.0, x, y),
            HemisphereBasis::Cosine { .. } => z * [1.0, x, y, x * y, x * x - y * y, x * x + y * y][i],
        }
    }

    /// The direction at which the three linear functions are evaluated: the light's, or the bent one. With [`vector`]
    /// it reconstructs by one dot product.
    pub fn argument(self, direction: [f64; 3]) -> [f64; 3] {
        if let HemisphereBasis::Bent { .. } = self { bent(direction) } else { direction }
    }

    /// ∫ φ_i dω over the hemisphere, of each function.
    pub fn integrals(self) -> Vec<f64> {
        // The rule is exact: after the integral over azimuth only polynomials of low degree in z are left.
        let rule = DirectionSet::new(DirectionRule::Product { levels: 16, azimuths: 16 });
        let over = |i: usize| rule.directions.iter().zip(&rule.weights).map(|(d, w)| w * self.value(i, *d)).sum();
        (0..self.count()).map(over).collect()
    }
}

/// A direction whose part along the blade is multiplied by (2z/(1+z))^¼, which is 1 straight above and 0 at the
/// horizon. The result is not a unit vector. [`HemisphereBasis::Bent`] evaluates the Half-Life 2 functions there. Of
/// the simple exponents, ¼ was the best one on grown leaves of two species; 0 (no bending) and ½ were worse.
pub fn bent(direction: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = direction;
    let share = (2.0 * z / (1.0 + z)).max(0.0).sqrt().sqrt();
    [share * x, share * y, z]
}

/// Real harmonic number l(l+1)+m of the tangent-plane azimuth of (x, y), with Legendre functions of t, orthonormal for
/// the measure dt/2·dφ. For the hemispherical functions t = 2z − 1 is not the cosine that belongs to (x, y), which the
/// harmonics of the room `sky` take for granted.
fn harmonic(index: usize, t: f64, x: f64, y: f64) -> f64 {
    let l = (index as f64).sqrt().floor() as usize;
    let order = index as i64 - (l * (l + 1)) as i64;
    let m = order.unsigned_abs() as usize;
    // P_m^m = (2m−1)!! (1−t²)^(m/2), no Condon–Shortley sign; then upwards in l.
    let mut p = (0..m).map(|k| (2 * k + 1) as f64).product::<f64>() * (1.0 - t * t).max(0.0).powf(0.5 * m as f64);
    let mut before = 0.0;
    for k in m + 1..=l {
        (p, before) = (((2 * k - 1) as f64 * t * p - (k + m - 1) as f64 * before) / (k - m) as f64, p);
    }
    let ratio: f64 = (l - m + 1..=l + m).map(|k| 1.0 / k as f64).product();
    let phi = y.atan2(x);
    let turn = match order {
        0 => 1.0,
        o if o > 0 => 2f64.sqrt() * (m as f64 * phi).cos(),
        _ => 2f64.sqrt() * (m as f64 * phi).sin(),
    };
    ((2 * l + 1) as f64 / TAU * ratio).sqrt() * p * turn
}

/// The vector v for which v·ω is the reconstruction by Half-Life 2 coefficients. For bent coefficients, the
/// reconstruction is its product with [`HemisphereBasis::argument`].
pub fn vector(coefficients: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|c| (3.0 / TAU).sqrt() * (0..3).map(|i| coefficients[i] * HALF_LIFE_2[i][c]).sum::<f64>())
}

/// The matrix that turns samples over a set of lights into coefficients: coefficient i = Σ_m `matrix[i][m]` f(ω_m).
#[derive(Debug, Clone, PartialEq)]
pub struct Projector {
    /// Directions ω_m of the lights.
    pub directions: Vec<[f64; 3]>,
    /// One row for each coefficient, one column for each direction.
    pub matrix: Vec<Vec<f64>>,
}

impl Projector {
    /// # Errors
    /// A sentence where the lights do not determine the coefficients (fewer lights than functions, or badly placed
    /// ones), or where plain sums are asked for a basis that is not orthonormal.
    pub fn new(basis: HemisphereBasis, lights: &DirectionSet, weights: SampleWeights) -> Result<Projector, String> {
        let (n, count) = (lights.len(), basis.count());
        let values = DMatrix::from_fn(count, n, |i, m| basis.value(i, lights.directions[m]));
        let weighted = DMatrix::from_fn(count, n, |i, m| lights.weights[m] * values[(i, m)]);
        let matrix = if weights == SampleWeights::Plain {
            if !basis.orthonormal() {
                return Err(format!("plain sums want an orthonormal basis; {} is none", basis.name()));
            }
            weighted
        } else {
            let gram = &weighted * values.transpose();
            let poor = || format!("{n} light directions do not determine the {count} functions of {}", basis.name());
            let scale = gram.diagonal().max();
            let factor = gram.cholesky().ok_or_else(poor)?;
            // A pivot is lost in rounding: on these directions the functions are dependent.
            if !(factor.l_dirty().diagonal().min().powi(2) > 1e-12 * scale) {
                return Err(poor());
            }
            factor.solve(&weighted)
        };
        Ok(Projector {
            directions: lights.directions.clone(),
            matrix: matrix.row_iter().map(|r| r.iter().copied().collect()).collect(),
        })
    }

    /// A projector to one image, ∫ f dω: the transmitted light under a uniform sky.
    pub fn total(lights: &DirectionSet) -> Projector {
        Projector { directions: lights.directions.clone(), matrix: vec![lights.weights.clone()] }
    }

    /// Number of images that a projection makes.
    pub fn count(&self) -> usize {
        self.matrix.len()
    }

    /// Coefficients of one function given by its samples at the lights.
    pub fn project(&self, samples: &[f64]) -> Vec<f64> {
        self.matrix.iter().map(|row| row.iter().zip(samples).map(|(p, f)| p * f).sum()).collect()
    }
}

#[cfg(test)]
mod tests;
