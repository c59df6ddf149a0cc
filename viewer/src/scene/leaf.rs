//! The look of a leaf: maps of either side, the source of its reflectance and transmittance, and its translucency.

use super::{Lobe, Sides, TranslucencyBasis};
use serde::{Deserialize, Serialize};

/// A leaf: maps for either side, on a mesh whose normals point out of the front.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct LeafMaterial {
    /// Name of the leaf in printed text.
    pub name: String,
    /// Columns of the maps, which all have the same size, in texels.
    pub width: u32,
    /// Rows of texels.
    pub height: u32,
    /// Mean thickness h (mm); a texel's thickness is h + δ.
    pub thickness_mm: f32,
    /// The distribution of its gloss.
    pub lobe: Lobe,
    /// The two sides. Maps are stored as each side's camera saw them: column i of the back is column `width−1−i` of the
    /// front. So the back is read at (1 − u, v).
    /// back is looked up at (1 − u, v).
    pub sides: Sides<SideMaps>,
    /// 1 on the leaf, row by row in the front's columns; `None` where the mesh already ends at the outline.
    pub mask: Option<Vec<u8>>,
}

/// The look of one side. Maps are stored row by row, with row 0 on top.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SideMaps {
    /// W's first texture: γ (RGB) and δ (mm).
    pub gamma_delta: Vec<[f32; 4]>,
    /// W's second texture: ρs (RGB) and m. With `None` the side is matte and uploads nothing.
    pub gloss: Option<Vec<[f32; 4]>>,
    /// Mapped normals in the mesh's tangent frame *of this side as its camera saw it*: x to the right in this side's
    /// image, y up, z out of this side. `None` means the mesh's normal. With the mesh's tangent t, bitangent b and
    /// normal n, (x, y, z) is x·t + y·b + z·n on the front and −x·t + y·b − z·n on the back.
    pub normal: Option<Vec<[f32; 3]>>,
    /// Maps for sunlight that *enters this side*. With `None`, the cosine of the mapped normal decides how much comes
    /// through.
    pub translucency: Option<Translucency>,
    /// The source of ρd and ρt.
    pub interior: Interior,
}

/// How sunlight that enters a side leaves by the other one, texel by texel, as the light's direction changes (Habel et
/// al. 2007). The maps have the columns of the lit side's camera. Directions ω towards the light are in this camera's
/// tangent frame: x right, y up, z out of the lit side.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Translucency {
    /// The basis, which is the same on both sides of a leaf. For a flat, uniform leaf the coefficient of each function
    /// is √(2π)/3 in either basis.
    pub basis: TranslucencyBasis,
    /// The coefficients of all channels together, or of each channel.
    pub coefficients: CoefficientMaps,
}

/// Three coefficients for each texel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum CoefficientMaps {
    /// f(x, ω), which replaces the cosine n·ω and is multiplied by ρt.
    Factor(Vec<[f32; 3]>),
    /// M(x, ω) = ρt·f for each channel (red, green, blue), which replaces both. Each channel has three coefficients.
    Colour([Vec<[f32; 3]>; 3]),
}

/// The axes of the Half-Life 2 basis (McTaggart 2004), orthonormal.
pub const HALF_LIFE_2: [[f32; 3]; 3] = [
    [-0.408_248_3, -0.707_106_77, 0.577_350_26],
    [-0.408_248_3, 0.707_106_77, 0.577_350_26],
    [0.816_496_6, 0.0, 0.577_350_26],
];

impl Translucency {
    /// The coefficient maps: a single one, or one for each channel.
    pub fn layers(&self) -> &[Vec<[f32; 3]>] {
        match &self.coefficients {
            CoefficientMaps::Factor(map) => std::slice::from_ref(map),
            CoefficientMaps::Colour(maps) => maps,
        }
    }

    /// The vector a with Σ h_i √(3/2π) H_i·ω = a·ω. The functions are linear in ω (or in the bent ω), so a texel's
    /// three coefficients are a vector, and interpolating the vectors interpolates the function.
    pub fn vector(coefficients: [f32; 3]) -> [f32; 3] {
        let scale = (1.5 / std::f32::consts::PI).sqrt();
        std::array::from_fn(|axis| scale * (0..3).map(|i| coefficients[i] * HALF_LIFE_2[i][axis]).sum::<f32>())
    }
}

impl SideMaps {
    /// A side whose reflected and transmitted light no camera sees. It has no γ, no δ and no curve, is drawn black, and
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
        matches!(&self.interior,
            Interior::Scalars(curve) if curve.rho_d.is_empty() && curve.rho_t.is_empty() && self.gamma_delta.is_empty())
    }
}

/// The source of a side's ρd and ρt.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum Interior {
    /// W's scalars σa, σs: ρd = γ·curve.rho_d(h + δ), ρt = curve.rho_t(h + δ), linear between the curve's points.
    Scalars(SlabCurve),
    /// Pigment maps: ρd and ρt of each texel, already computed from σa(x), σs(x) and h + δ(x). γ is not applied.
    Maps {
        /// Diffuse reflectance.
        rho_d: Vec<[f32; 3]>,
        /// Diffuse transmittance.
        rho_t: Vec<[f32; 3]>,
    },
}

/// ρd and ρt of the slab over its thickness, at two or more points with equal steps.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SlabCurve {
    /// Thickness at the first point.
    pub min_mm: f32,
    /// Thickness at the last point.
    pub max_mm: f32,
    /// Diffuse reflectance at each point, for each channel.
    pub rho_d: Vec<[f32; 3]>,
    /// Diffuse transmittance at each point, for each channel.
    pub rho_t: Vec<[f32; 3]>,
}
