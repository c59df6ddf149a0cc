//! A leaf as layers that rays pass through: the algorithmic BDF model (ABM) and the foliar scattering model (FSM) of
//! Baranoski & Rokne (The Visual Computer 17, 2001; B1 in `docs/sources.md`).
//!
//! The leaf has six plane interfaces ([`INTERFACES`]). A ray that meets one is reflected or refracted, and then turned
//! by a random angle around its own new direction. Between the second interface and the third lies the mesophyll, which
//! absorbs. How much a leaf reflects and lets through is computed in two ways that share only Fresnel's formula:
//!
//! - [`walk`] follows random rays, as the paper does. It also says in which directions light leaves.
//! - [`exact`] solves the integral equation that the mean of the rays obeys. It has no noise, takes milliseconds and
//!   gives derivatives, but it knows only R and T.
//!
//! Angles are in radians, thickness in mm and absorption in 1/mm. Directions are given by the cosine μ of the angle
//! from the leaf's normal.

pub mod exact;
pub mod fsm;
pub mod goniometer;
#[cfg(test)]
mod grazing_tests;
pub mod lobe;
pub mod pigments;
pub mod ray;
pub mod shares;
#[cfg(test)]
mod tests;
pub mod walk;

use crate::number::Real;
use mesophyll_base::surface::side::Side;

/// How long a crossing of the mesophyll is taken to be.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantNames,
    serde::Serialize,
    serde::Deserialize,
)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum MesophyllPath {
    /// The thickness over cos θ, as geometry has it.
    Slant,
    /// The thickness over cos(cos θ), in radians: how the public ABM program accounts for sieve and detour effects.
    Sieve,
}

impl MesophyllPath {
    /// The length of a crossing at the cosine `mu`, in thicknesses.
    pub fn length<N: Real>(self, mu: N) -> N {
        match self {
            MesophyllPath::Slant => N::of(1.0) / mu,
            MesophyllPath::Sieve => N::of(1.0) / mu.cos(),
        }
    }
}

/// How strongly the lobes of each tissue concentrate light: exponents of a cosine around the ray, ≥ 0. An exponent of 0
/// gives a uniform hemisphere; infinity does not turn the ray at all.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Oblateness<N = f64> {
    /// Light that the leaf's outer faces reflect. It turns light that has already left, so R and T do not depend on it.
    pub cuticle: N,
    /// Light inside both epidermises.
    pub epidermis: N,
    /// Light that goes on inside the mesophyll.
    pub palisade: N,
    /// Light that goes down into the air below the mesophyll.
    pub spongy: N,
}

impl Oblateness {
    /// The figures of the public ABM program.
    pub const USUAL: Oblateness = Oblateness { cuticle: 5.0, epidermis: 5.0, palisade: 1.0, spongy: 5.0 };
}

/// A leaf. R and T depend on absorption and thickness only through their product.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LayeredLeaf<N = f64> {
    /// Absorption coefficient of the mesophyll times its thickness, ≥ 0, without unit.
    pub depth: N,
    /// Refractive index of cuticle and epidermis, ≥ 1.
    pub n_cuticle: N,
    /// Refractive index of the mesophyll, ≥ 1.
    pub n_mesophyll: N,
    /// Refractive index of the antidermal wall, ≥ 1.
    pub n_antidermal: N,
    /// How strongly lobes bundle light.
    pub oblateness: Oblateness<N>,
    /// How long a crossing of the mesophyll is.
    pub path: MesophyllPath,
}

/// Largest refractive index that is accepted.
pub const LARGEST_INDEX: f64 = 3.0;

impl LayeredLeaf {
    /// The soybean leaf of B1 (Table 1) with a given absorption of one crossing.
    pub fn soybean(depth: f64) -> LayeredLeaf {
        LayeredLeaf {
            depth,
            n_cuticle: 1.6,
            n_mesophyll: 1.41,
            n_antidermal: 1.42,
            oblateness: Oblateness::USUAL,
            path: MesophyllPath::Slant,
        }
    }

    /// What is wrong with the leaf: the name of the quantity, its value and what is expected. `None` for a valid leaf.
    pub fn fault(&self) -> Option<String> {
        if !(self.depth >= 0.0) {
            return Some(format!("absorption times thickness is {}; expected 0 or more", self.depth));
        }
        let indices =
            [("n_cuticle", self.n_cuticle), ("n_mesophyll", self.n_mesophyll), ("n_antidermal", self.n_antidermal)];
        if let Some((name, n)) = indices.iter().find(|(_, n)| !(1.0..=LARGEST_INDEX).contains(n)) {
            return Some(format!("{name} is {n}; expected 1 to {LARGEST_INDEX}"));
        }
        let Oblateness { cuticle, epidermis, palisade, spongy } = self.oblateness;
        let lobes = [
            ("oblateness_cuticle", cuticle),
            ("oblateness_epidermis", epidermis),
            ("oblateness_palisade", palisade),
            ("oblateness_spongy", spongy),
        ];
        lobes.iter().find(|(_, o)| !(*o >= 0.0)).map(|(name, o)| format!("{name} is {o}; expected 0 or more, or inf"))
    }

    /// Share of the light at `incidence` (radians from the normal) that the lit face reflects before anything enters.
    pub fn surface_reflectance(&self, incidence: f64) -> f64 {
        enter(self.n_cuticle, incidence).0
    }
}

/// What happens to light that arrives from air at `angle` from the normal onto a face of index `n`: the share that is
/// reflected, and the sine and cosine of the angle inside.
pub fn enter<N: Real>(n: N, angle: f64) -> (N, N, N) {
    let (sin, cos) = (N::of(angle.sin()), N::of(angle.cos()));
    let inside = sin / n;
    let cos_inside = (n * n - N::of(1.0) + cos * cos).sqrt() / n;
    (fresnel(N::of(1.0), cos, n, cos_inside), inside, cos_inside)
}

/// Reflectance of a plane interface for unpolarised light, ½(Rs + Rp), from the indices and the cosines on both sides.
pub fn fresnel<N: Real>(n1: N, cos1: N, n2: N, cos2: N) -> N {
    let s = (n1 * cos1 - n2 * cos2) / (n1 * cos1 + n2 * cos2);
    let p = (n2 * cos1 - n1 * cos2) / (n2 * cos1 + n1 * cos2);
    (s * s + p * p).times(0.5)
}

/// A layer between two interfaces; [`walk`] and [`exact`] follow rays through these.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LeafMedium {
    /// Air outside the leaf, or between mesophyll and antidermal wall.
    Air,
    /// An epidermis with its cuticle.
    Epidermis,
    /// The mesophyll.
    Mesophyll,
    /// The wall above the lower epidermis.
    Antidermal,
}

/// The tissue that decides the lobe of a ray.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LeafTissue {
    /// The outer faces.
    Cuticle,
    /// Both epidermises.
    Epidermis,
    /// The mesophyll.
    Palisade,
    /// The air below the mesophyll.
    Spongy,
}

/// A plane interface: the media above and below it, and the tissue that turns the ray after each of four events
/// (`None`: it is not turned).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LeafInterface {
    /// Medium above.
    pub above: LeafMedium,
    /// Medium below.
    pub below: LeafMedium,
    /// A ray that came downward and is reflected.
    pub down_reflected: Option<LeafTissue>,
    /// A ray that came downward and is refracted.
    pub down_refracted: Option<LeafTissue>,
    /// A ray that came upward and is reflected.
    pub up_reflected: Option<LeafTissue>,
    /// A ray that came upward and is refracted.
    pub up_refracted: Option<LeafTissue>,
}

/// The six interfaces from the adaxial face to the abaxial one. Which tissue turns a ray inside the leaf depends only
/// on where the ray goes; [`walk`] and [`exact`] make use of that.
pub const INTERFACES: [LeafInterface; 6] = {
    use LeafMedium::{Air, Antidermal, Epidermis, Mesophyll};
    const E: Option<LeafTissue> = Some(LeafTissue::Epidermis);
    const P: Option<LeafTissue> = Some(LeafTissue::Palisade);
    const S: Option<LeafTissue> = Some(LeafTissue::Spongy);
    const C: Option<LeafTissue> = Some(LeafTissue::Cuticle);
    const fn of(above: LeafMedium, below: LeafMedium, lobes: [Option<LeafTissue>; 4]) -> LeafInterface {
        LeafInterface {
            above,
            below,
            down_reflected: lobes[0],
            down_refracted: lobes[1],
            up_reflected: lobes[2],
            up_refracted: lobes[3],
        }
    }
    [
        of(Air, Epidermis, [C, E, E, None]),
        of(Epidermis, Mesophyll, [E, P, P, E]),
        of(Mesophyll, Air, [P, S, S, P]),
        of(Air, Antidermal, [None; 4]),
        of(Antidermal, Epidermis, [None, E, E, None]),
        of(Epidermis, Air, [E, None, C, E]),
    ]
};

/// Light that leaves the leaf, as shares of the incident light; the rest is absorbed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafResponse<N = f64> {
    /// Share that leaves on the lit side.
    pub reflectance: N,
    /// Share that leaves on the other side.
    pub transmittance: N,
}
