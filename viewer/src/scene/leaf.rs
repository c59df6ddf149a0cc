//! How a leaf looks: maps of either side, where its reflectance and transmittance come from, and its translucency.

use super::{Basis, Lobe, Sides};

/// A leaf: maps for either side, on a mesh whose normals point out of the front.
#[derive(Debug, Clone)]
pub struct Leaf {
    /// What it is called in what is printed.
    pub name: String,
    /// Size of the maps (all of one size), in texels.
    pub width: u32,
    /// Rows of texels.
    pub height: u32,
    /// Mean thickness h (mm); a texel's thickness is h + δ.
    pub thickness_mm: f32,
    /// The distribution of its gloss.
    pub lobe: Lobe,
    /// Maps are stored as each side's camera saw them: column i of the back is column `width−1−i` of the front, so the
    /// back is looked up at (1 − u, v).
    pub sides: Sides<SideMaps>,
    /// 1 on the leaf, row-major in the front's columns; `None` where the mesh is trimmed to the outline already.
    pub mask: Option<Vec<u8>>,
}

/// How one side looks. Maps are row-major, row 0 on top.
#[derive(Debug, Clone)]
pub struct SideMaps {
    /// W's first texture: γ (RGB) and δ (mm).
    pub gamma_delta: Vec<[f32; 4]>,
    /// W's second texture: ρs (RGB) and m; `None` is a matte side and uploads nothing.
    pub gloss: Option<Vec<[f32; 4]>>,
    /// Mapped normals in the mesh's tangent frame *of this side as its camera saw it*: x to the right in this side's
    /// image, y up, z out of this side; `None` is the mesh normal. With the mesh's tangent t, bitangent b and normal n,
    /// (x, y, z) is x·t + y·b + z·n on the front and −x·t + y·b − z·n on the back.
    pub normal: Option<Vec<[f32; 3]>>,
    /// For the sun's light that *enters this side*; `None` lets it through by the mapped normal's cosine.
    pub translucency: Option<Translucency>,
    /// Where ρd and ρt come from.
    pub interior: Interior,
}

/// How light that enters a side comes out of the other one, texel by texel, as it turns (Habel et al. 2007): maps in
/// the columns of the lit side's camera, in whose tangent frame (x right, y up, z out of the lit side) directions ω
/// towards the light are.
#[derive(Debug, Clone, PartialEq)]
pub struct Translucency {
    /// The same on both sides of a leaf. A flat, uniform leaf has the coefficient √(2π)/3 of each function, whichever
    /// they are.
    pub basis: Basis,
    /// One list of numbers, or one a channel.
    pub coefficients: Coefficients,
}

/// Three coefficients a texel.
#[derive(Debug, Clone, PartialEq)]
pub enum Coefficients {
    /// f(x, ω), which stands for the cosine n·ω and multiplies ρt.
    Factor(Vec<[f32; 3]>),
    /// M(x, ω) = ρt·f a channel (red, green, blue), which stands for both: three coefficients each.
    Colour([Vec<[f32; 3]>; 3]),
}

/// The axes of the Half-Life 2 basis (McTaggart 2004), orthonormal.
pub const HALF_LIFE_2: [[f32; 3]; 3] = [
    [-0.408_248_3, -0.707_106_77, 0.577_350_26],
    [-0.408_248_3, 0.707_106_77, 0.577_350_26],
    [0.816_496_6, 0.0, 0.577_350_26],
];

impl Translucency {
    /// The coefficient maps: one, or one a channel.
    pub fn layers(&self) -> &[Vec<[f32; 3]>] {
        match &self.coefficients {
            Coefficients::Factor(map) => std::slice::from_ref(map),
            Coefficients::Colour(maps) => maps,
        }
    }

    /// Σ h_i √(3/2π) H_i·ω as one product a·ω: the functions are linear in ω (or in ω bent), so that a texel's three
    /// coefficients are a vector, and interpolating one interpolates the other.
    pub fn vector(coefficients: [f32; 3]) -> [f32; 3] {
        let scale = (1.5 / std::f32::consts::PI).sqrt();
        std::array::from_fn(|axis| scale * (0..3).map(|i| coefficients[i] * HALF_LIFE_2[i][axis]).sum::<f32>())
    }
}

impl SideMaps {
    /// A side whose reflected and transmitted light no camera sees: it has no γ, no δ and no curve, shades black and
    /// uploads nothing.
    pub fn black() -> SideMaps {
        SideMaps {
            gamma_delta: Vec::new(),
            gloss: None,
            normal: None,
            translucency: None,
            interior: Interior::Scalars(SlabCurve::default()),
        }
    }

    /// Whether this side has neither a curve nor maps.
    pub fn is_black(&self) -> bool {
        matches!(&self.interior, Interior::Scalars(curve) if curve.rho_d.is_empty() && curve.rho_t.is_empty() && self.gamma_delta.is_empty())
    }
}

/// Where a side's ρd and ρt come from.
#[derive(Debug, Clone)]
pub enum Interior {
    /// W's scalars σa, σs: ρd = γ·curve.rho_d(h + δ), ρt = curve.rho_t(h + δ), linear between the curve's points.
    Scalars(SlabCurve),
    /// Pigment maps: ρd and ρt a texel, already solved from σa(x), σs(x) and h + δ(x); γ is not applied.
    Maps {
        /// Diffuse reflectance.
        rho_d: Vec<[f32; 3]>,
        /// Diffuse transmittance.
        rho_t: Vec<[f32; 3]>,
    },
}

/// ρd and ρt of the slab against thickness, on a uniform grid (at least two points).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SlabCurve {
    /// Thickness at the first point.
    pub min_mm: f32,
    /// Thickness at the last point.
    pub max_mm: f32,
    /// Diffuse reflectance at each point, a channel.
    pub rho_d: Vec<[f32; 3]>,
    /// Diffuse transmittance at each point, a channel.
    pub rho_t: Vec<[f32; 3]>,
}
