//! Plain scene data: what the renderer draws. Lengths in mm, directions are unit vectors in world space (z up),
//! radiance in units set by the light; colours are linear sRGB.
//!
//! **The shading both renderers must agree on** (W = Wang et al. 2005, Eq. 1, with full A(ω, Δ), B(ω, Δ) and a bounded
//! gloss). At a point let `Ng` be the interpolated mesh normal turned to the viewer, `v` the direction to the viewer,
//! `l` to the sun. The viewed side is the one whose mesh normal faces the viewer, the far side the other one; `N` is
//! the viewed side's mapped normal (outward from that side), `F` the far side's (outward from *that* side, so it points
//! away from the viewer).
//!
//! ```text
//! sun lights the viewed side where l·Ng > 0:   L += E · V · max(0, N·l) · (ρd_viewed/π + f_s)
//! sun lights the far side where   l·Ng < 0:    L += E · V · max(0, F·l) · ρt_far/π
//!   … whose translucency was measured:         L += E · V · max(0, f_far(ω)) · ρt_far/π   (or max(0, M_far(ω))/π, a channel each)
//! constant sky:                                L += L_sky · (ρd_viewed + ρt_far + ρs · a(N·v, m))
//! dome L(ω):     L += ρd_viewed/π ∫ L max(0, N·ω) dω + ρt_far/π ∫ L max(0, F·ω) dω + ∫ L f_s max(0, N·ω) dω
//! ```
//!
//! f_far is the far side's [`Translucency`], looked up where the far side's other maps are; ω is l in the far side's
//! tangent frame, that of the *mesh* (relief is in f already): (T·l, B·l, Ng·l) for light on the front, (−T·l, B·l,
//! −Ng·l) on the back, with the mesh's interpolated T, B and outward-from-the-front Ng. In the bent basis f is looked
//! up at ω with x and y multiplied by (2z/(1+z))^¼. A sky's light comes through by ρt and the mapped normal whatever
//! translucency maps say.
//!
//! Where the scene has a [`Transfer`], sky and dome are replaced by what arrives past and by way of other surfaces.
//! With the irradiance vectors F₁ and F₂ of the point's two sides, ∫ L(ω) ω dω over the directions on either side:
//!
//! ```text
//! L += ρd_viewed/π · max(0, N·F_viewed) + ρt_far/π · max(0, F·F_far) + ρs·a·Σ W_l l_lm Y_lm(R)
//! ```
//! l_lm are the harmonics of what arrives at the point. Both are interpolated between the mesh's [`Anchors`].
//!
//! Of a [`Dome`] this renderer has N² harmonics alone. The two diffuse integrals are Σ A_l c_lm Y_lm (Ramamoorthi and
//! Hanrahan 2001), the glossy one ρs·a·Σ W_l c_lm Y_lm(R), R being the lobe's mean direction and W_l its bands about
//! it; sums below 0 (ringing) count as 0. A mapped normal sees the whole hemisphere around itself, also where that dips
//! under the blade, as under a constant sky.
//!
//! V is the mean over the shadow maps, or what the three corners of a triangle see of the sun, interpolated
//! (`Scene::sun_shares`).
//!
//! An opaque surface has ρt = 0 and ρs = 0, and ρd = 0 on its inside.
//!
//! E is the irradiance at normal incidence, V the visible share of the sun's disk, ρt_far the transmittance of a beam
//! that enters the far side. f_s = ρs·D·G/(4 (N·l)(N·v)), D = exp(−tan²α/m²)/(π m² cos⁴α) (Beckmann) or m²/(π cos⁴α
//! (m² + tan²α)²) (GGX), G = min(1, 2(N·h)(N·v)/(v·h), 2(N·h)(N·l)/(v·h)) (V-cavity); with `CookTorrance { index }`
//! times the dielectric Fresnel F(v·h) for unpolarised light. N·v is floored at 1e-3. a(N·v, m) is the directional
//! albedo of f_s per unit ρs: ∫ f_s/ρs cosθ dω. f_s = 0 where N·h ≤ 0; m is floored at 1e-3. The sun's centre lights
//! the surface, its disk only decides V. Maps are sampled bilinearly with texel centres at (i + ½)/W, clamped at the
//! rim; δ is sampled before the curve is looked up (clamped at its ends), mapped normals are sampled and then
//! normalised. Minified maps are averaged (a mip chain). A mask's edge lies where its bilinear sample passes ½. With
//! `msaa` 4 coverage is sampled at (3/8, 1/8), (7/8, 3/8), (1/8, 5/8), (5/8, 7/8) of a pixel and shading once a leaf,
//! at the pixel's centre (GL cuts a mask at the centre alone); the picture averages radiance before the tone map. The
//! sky is not shadowed by other leaves. Where nothing is hit the radiance is `Scene::background`. Picture: exposure ·
//! L, Reinhard x/(1 + x) a channel, sRGB encoding (IEC 61966-2-1), 8 bits.

mod leaf;
mod light;
mod motion;

pub use crate::grass::{GRASS_STEPS, Grass, GrassGusts, GrassLevel, GrassSheet, GrassTable, MOST_SLICES};
use glam::{Mat4, Vec2, Vec3, Vec4};
pub use leaf::{Coefficients, HALF_LIFE_2, Interior, Leaf, SideMaps, SlabCurve, Translucency};
pub use light::{Anchors, Dome, Scanner, Sun, Transfer};
pub use mesophyll_surface::basis::Basis;
pub use mesophyll_surface::gloss::Lobe;
pub use mesophyll_surface::side::{Side, Sides};
pub use motion::{Branch, Carried, MOST_BRANCHES, Ride, Section, Sections, Wind};
use std::sync::Arc;

/// Everything in a picture: meshes, materials, where a mesh stands in a material, what bends, and what lights it.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// Shapes, each of which may stand in many places.
    pub meshes: Vec<Mesh>,
    /// What surfaces look like.
    pub materials: Vec<Material>,
    /// What stands where.
    pub instances: Vec<Instance>,
    /// `None` leaves its code and its shadows out.
    pub sun: Option<Sun>,
    /// Radiance of a constant sky all around; `None` leaves its code out of the shader.
    pub sky: Option<[f32; 3]>,
    /// A sky that differs from direction to direction, instead of a constant one; `None` leaves its code and its pass
    /// out.
    pub dome: Option<Dome>,
    /// A scanner instead of sun and sky; seen by [`Renderer::scan`](crate::Renderer::scan). `None` leaves its code out.
    pub scanner: Option<Scanner>,
    /// Radiance of what nothing covers.
    pub background: [f32; 3],
    /// What radiance is multiplied with before it is displayed.
    pub exposure: f32,
    /// Shadow maps spread over the sun's disk: 0 leaves shadows out, 1 is a hard shadow, more are softer and truer.
    pub shadow_samples: u32,
    /// Texels along a side of a shadow map.
    pub shadow_resolution: u32,
    /// 1 or 4.
    pub msaa: u32,
    /// Branches that bend (at most [`MOST_BRANCHES`]); where nothing rides on one, no shader bends.
    pub branches: Vec<Branch>,
    /// What sways them; `None` uploads no motion texture.
    pub wind: Option<Wind>,
    /// Cross-sections of plants that carry leaves and bark about, at the wind's time; `None`: plants stand still.
    pub sections: Option<Sections>,
    /// How light arrives past and by way of other surfaces; every mesh that stands somewhere then has [`Anchors`] and
    /// every instance a first row. `None` lights every surface as if it stood alone, but for the sun's shadows.
    pub transfer: Option<Transfer>,
    /// 255 times the share of the sun's disk that vertices see, where the sun stands now: of all instances that have a
    /// [`Instance::first_share`]. They look into no shadow map.
    pub sun_shares: Option<Arc<Vec<u8>>>,
    /// Lawns as slices. They hide and are hidden by what else stands in the scene and lie in its shadow maps' shade,
    /// but throw no shadow on it. Without one no code and no texture of the pass exists.
    pub grass: Vec<Arc<Grass>>,
}

/// A mesh drawn somewhere in a material; rigid transforms with uniform scale.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Instance {
    /// Index into the scene's meshes.
    pub mesh: usize,
    /// Index into the scene's materials.
    pub material: usize,
    /// Mesh to world.
    pub transform: Mat4,
    /// What bends it; the transform is where it is at rest.
    pub ride: Option<Ride>,
    /// What carries it about, of the scene's sections; the transform is where it is at rest.
    pub carried: Option<Carried>,
    /// First row of its anchors in the scene's [`Transfer`].
    pub first_row: u32,
    /// The level of its anchors ([`Anchors::levels`]) that its rows begin with: finer ones are not kept, since it is
    /// never seen so near.
    pub first_level: u32,
    /// Where the scene's shares of the sun begin that are of its mesh's vertices, in their order; `None`: its shadows
    /// come from shadow maps.
    pub first_share: Option<u32>,
    /// It lies below everything and the sun is above: it is shaded and shades nothing, so that shadow maps need not
    /// cover it and are finer where things stand.
    pub floor: bool,
}

/// How a surface looks, apart from its shape.
// A scene has a handful of materials: an indirection would save no memory worth a line.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone)]
pub enum Material {
    /// A leaf, with light through it.
    Leaf(Leaf),
    /// A surface that lets nothing through.
    Opaque(Opaque),
}

/// Bark, ground: a diffuse surface of one colour that lets nothing through. It is seen from the side that its mesh's
/// normals point to; its inside is black.
#[derive(Debug, Clone, PartialEq)]
pub struct Opaque {
    /// What it is called in what is printed.
    pub name: String,
    /// Reflectance (red, green, blue), 0 to 1.
    pub albedo: [f32; 3],
}

/// Triangles with normals, tangents and places on maps; all lists but the triangles' have an entry a vertex.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// In the mesh's own frame and units.
    pub positions: Vec<Vec3>,
    /// Unit vectors; a leaf's point out of its front.
    pub normals: Vec<Vec3>,
    /// xyz tangent along +u, w = ±1 handedness: bitangent = w · normal × tangent, up in the front's image (towards
    /// smaller v).
    pub tangents: Vec<Vec4>,
    /// (0, 0) is the top left corner of the front's maps.
    pub uvs: Vec<Vec2>,
    /// Three a triangle.
    pub indices: Vec<u32>,
    /// Coarser triangulations of the same vertices for where it is small in the picture, finest first; may be empty.
    pub details: Vec<Detail>,
    /// Needed where the scene has a [`Transfer`].
    pub anchors: Option<Anchors>,
}

/// A coarser triangulation.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Detail {
    /// Three a triangle.
    pub indices: Vec<u32>,
    /// How far it is from the mesh at most, in the mesh's units.
    pub error: f32,
}

impl Material {
    /// What it is called in what is printed.
    pub fn name(&self) -> &str {
        match self {
            Material::Leaf(leaf) => &leaf.name,
            Material::Opaque(opaque) => &opaque.name,
        }
    }

    /// The leaf, unless it is something else.
    pub fn leaf(&self) -> Option<&Leaf> {
        match self {
            Material::Leaf(leaf) => Some(leaf),
            Material::Opaque(_) => None,
        }
    }
}

impl Scene {
    /// The material of this index, where there is one and it is a leaf.
    pub fn leaf(&self, material: usize) -> Option<&Leaf> {
        self.materials.get(material)?.leaf()
    }

    /// As [`Scene::leaf`], to be changed.
    pub fn leaf_mut(&mut self, material: usize) -> Option<&mut Leaf> {
        match self.materials.get_mut(material)? {
            Material::Leaf(leaf) => Some(leaf),
            Material::Opaque(_) => None,
        }
    }

    /// Adds a mesh and a material, and says at which index either is.
    pub fn add(&mut self, mesh: Mesh, material: Material) -> Instance {
        self.meshes.push(mesh);
        self.materials.push(material);
        let (mesh, material) = (self.meshes.len() - 1, self.materials.len() - 1);
        Instance { mesh, material, transform: Mat4::IDENTITY, ..Instance::default() }
    }
}

/// A pinhole camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Where it is.
    pub eye: Vec3,
    /// What it looks at.
    pub target: Vec3,
    /// What is up in the picture; not along the line of sight.
    pub up: Vec3,
    /// From the bottom of the picture to its top.
    pub fov_y_deg: f32,
}
