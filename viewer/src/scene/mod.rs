//! Plain scene data: the things that the renderer draws. Lengths are in mm, directions are unit vectors in world space
//! (z up), the light sets the unit of radiance, and colours are linear sRGB.
//!
//! **The shading that both renderers must agree on** (W = Wang et al. 2005, Eq. 1, with full A(ω, Δ), B(ω, Δ) and a
//! bounded gloss). At a point, let `Ng` be the interpolated mesh normal turned to the viewer, `v` the direction to the
//! viewer, and `l` the direction to the sun. The viewed side is the one whose mesh normal faces the viewer; the far
//! side is the other one. `N` is the viewed side's mapped normal, outward from that side. `F` is the far side's mapped
//! normal, outward from *that* side, so it points away from the viewer.
//!
//! ```text
//! sun lights the viewed side where l·Ng > 0:   L += E · V · max(0, N·l) · (ρd_viewed/π + f_s)
//! sun lights the far side where   l·Ng < 0:    L += E · V · max(0, F·l) · ρt_far/π
//!   … whose translucency was measured:         L += E · V · max(0, f_far(ω)) · ρt_far/π
//!                                              (or max(0, M_far(ω))/π, a channel each)
//! constant sky:                                L += L_sky · (ρd_viewed + ρt_far + ρs · a(N·v, m))
//! dome L(ω):     L += ρd_viewed/π ∫ L max(0, N·ω) dω + ρt_far/π ∫ L max(0, F·ω) dω + ∫ L f_s max(0, N·ω) dω
//! ```
//!
//! f_far is the far side's [`Translucency`], read at the same place as the far side's other maps. ω is l in the far
//! side's tangent frame of the *mesh*, because f already contains the relief. It is (T·l, B·l, Ng·l) for light on the
//! front and (−T·l, B·l, −Ng·l) for light on the back, with the mesh's interpolated T, B and Ng outward from the front.
//! In the bent basis, f is evaluated at ω with x and y multiplied by (2z/(1+z))^¼. Transmitted light from the sky
//! always follows ρt and the mapped normal, with or without translucency maps.
//!
//! Where the scene has a [`RadianceTransfer`], light that arrives between and by way of other surfaces replaces sky and
//! dome. Let F₁ and F₂ be the irradiance vectors of the point's two sides, ∫ L(ω) ω dω over the directions on either
//! side:
//!
//! ```text
//! L += ρd_viewed/π · max(0, N·F_viewed) + ρt_far/π · max(0, F·F_far) + ρs·a·Σ W_l l_lm Y_lm(R)
//! ```
//! l_lm are the harmonics of the light that arrives at the point. Vectors and harmonics are interpolated between the
//! mesh's [`AnchorGrid`].
//!
//! For a [`SkyDome`], this renderer knows the N² harmonics only. The two diffuse integrals are Σ A_l c_lm Y_lm
//! (Ramamoorthi and Hanrahan 2001). The glossy one is ρs·a·Σ W_l c_lm Y_lm(R), where R is the lobe's mean direction and
//! W_l are its bands about it. Sums below 0, which come from ringing, count as 0. A mapped normal sees the whole
//! hemisphere around itself, also where this dips under the blade, as under a constant sky.
//!
//! V is the mean over the shadow maps. Where the vertices' shares of the sun are known (`Scene::sun_shares`), it is
//! their interpolation over the triangle.
//!
//! An opaque surface has ρt = 0 and ρs = 0, and ρd = 0 on its inside.
//!
//! E is the irradiance at normal incidence, V the visible share of the sun's disk, and ρt_far the transmittance of a
//! beam that enters the far side. f_s = ρs·D·G/(4 (N·l)(N·v)), where D = exp(−tan²α/m²)/(π m² cos⁴α) (Beckmann) or
//! m²/(π cos⁴α (m² + tan²α)²) (GGX), and G = min(1, 2(N·h)(N·v)/(v·h), 2(N·h)(N·l)/(v·h)) (V-cavity). `CookTorrance {
//! index }` multiplies it by the dielectric Fresnel factor F(v·h) for unpolarised light. N·v is at least 1e-3, m is at
//! least 1e-3, and f_s = 0 where N·h ≤ 0. a(N·v, m) is the directional albedo of f_s for ρs = 1: ∫ f_s/ρs cosθ dω. The
//! surface is lit from the sun's centre; the disk only decides V.
//!
//! Maps are sampled bilinearly with texel centres at (i + ½)/W, clamped at the rim. δ is sampled before the curve is
//! read, which is clamped at its ends. Mapped normals are sampled and then normalised. Minified maps are averaged (a
//! mip chain). A mask's edge lies where its bilinear sample passes ½.
//!
//! With `msaa` 4, coverage is sampled at (3/8, 1/8), (7/8, 3/8), (1/8, 5/8), (5/8, 7/8) of a pixel. Each leaf is shaded
//! once, at the pixel's centre, and GL cuts a mask at the centre only. The picture averages radiance before the tone
//! map. Other leaves do not shade the sky's light. Where nothing is hit the radiance is `Scene::background`. The
//! picture is exposure · L, Reinhard's x/(1 + x) for each channel, sRGB encoding (IEC 61966-2-1), 8 bits. With another
//! `Scene::display` it has a film's curve, or the light of surfaces is mapped from their bands to sRGB first.

mod leaf;
mod light;
mod motion;
mod stand;

pub use crate::grass::{GRASS_STEPS, Grass, GrassGusts, GrassHill, GrassLevel, GrassSheet, GrassTable, MOST_SLICES};
use glam::{Mat4, Vec2, Vec3, Vec4};
pub use leaf::{CoefficientMaps, HALF_LIFE_2, Interior, LeafMaterial, SideMaps, SlabCurve, Translucency};
pub use light::{AnchorGrid, Backdrop, RadianceTransfer, Scanner, SkyDome, Sun};
pub use mesophyll_base::surface::basis::TranslucencyBasis;
pub use mesophyll_base::surface::gloss::Lobe;
pub use mesophyll_base::surface::side::{Side, Sides};
pub use mesophyll_base::tone::{PictureChannels, PictureDisplay, ToneCurve};
pub use motion::{
    AxisPiece, PoseHierarchy, PoseLimb, SectionAnimation, SectionBinding, SectionMotion, SectionSeat, WindState,
};
use serde::{Deserialize, Serialize};
pub use stand::{PlantStand, StandPlace};
use std::sync::Arc;

/// Everything in a picture: meshes, materials, instances, the things that bend, and the lights.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Scene {
    /// The shapes, each of which may occur in many places.
    pub meshes: Vec<Mesh>,
    /// The materials of surfaces.
    pub materials: Vec<Material>,
    /// The instances: a mesh in a material at a place.
    pub instances: Vec<Instance>,
    /// The sun. With `None`, the shader has no code for it and no shadows.
    pub sun: Option<Sun>,
    /// Radiance of a constant sky all around. With `None`, the shader has no code for it.
    pub sky: Option<[f32; 3]>,
    /// A sky that depends on direction, instead of a constant one. With `None`, the shader has no code for it, and
    /// there is no pass for the sky.
    pub dome: Option<SkyDome>,
    /// A scanner instead of sun and sky; [`Renderer::scan`](crate::Renderer::scan) draws its picture. With `None`, the
    /// shader has no code for it.
    pub scanner: Option<Scanner>,
    /// Radiance where nothing is drawn.
    pub background: [f32; 3],
    /// An environment map that is seen in the place of background and sky, and lights nothing. With `None` there is no
    /// pass for it.
    pub backdrop: Option<Backdrop>,
    /// The factor that radiance is multiplied by before it is displayed.
    pub exposure: f32,
    /// The curve of the 8-bit picture, and what red, green and blue of the surfaces are there.
    pub display: PictureDisplay,
    /// Whether everything is drawn in full detail, however small it is in the picture. It costs time, and shows what
    /// levels of detail and leaves that are left out change.
    pub in_full: bool,
    /// Share of the light (0 to 1) that the camera's lens scatters around what is bright. It changes the 8-bit picture
    /// only; without it nothing of it is made.
    pub bloom: Option<f32>,
    /// Number of shadow maps spread over the sun's disk. 0 leaves shadows out, 1 gives hard shadows, and with more the
    /// shadows become softer and more accurate.
    pub shadow_samples: u32,
    /// Texels along a side of a shadow map.
    pub shadow_resolution: u32,
    /// Number of samples for each pixel, 1 or 4.
    pub msaa: u32,
    /// The wind, whose time moves sections and lawns. With `None`, the time is 0.
    pub wind: Option<WindState>,
    /// Cross-sections of plants that carry leaves and bark, at the wind's time. With `None`, plants stand still. They
    /// are computed, so they are not written with the scene.
    #[serde(skip)]
    pub sections: Option<SectionAnimation>,
    /// How light arrives between and by way of other surfaces. Every mesh with an instance then needs [`AnchorGrid`],
    /// and every instance a first row. With `None`, every surface is lit as if it stood alone, except for the sun's
    /// shadows.
    pub transfer: Option<RadianceTransfer>,
    /// 255 times the share of the sun's disk that each vertex sees for the sun's present direction, for all instances
    /// with a [`Instance::first_share`]. These instances do not use the shadow maps.
    pub sun_shares: Option<Arc<Vec<u8>>>,
    /// Plants that stand in many places. They are not written with the scene.
    #[serde(skip)]
    pub stands: Vec<Arc<PlantStand>>,
    /// Lawns as slices. They hide other things and are hidden by them, and they are shaded by the scene's shadow maps.
    /// But they cast no shadow. Without a lawn, the pass has no code and no textures.
    pub grass: Vec<Arc<Grass>>,
}

/// A mesh at a place in a material. Transforms are rigid, with a uniform scale.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Instance {
    /// Index into the scene's meshes.
    pub mesh: usize,
    /// Index into the scene's materials.
    pub material: usize,
    /// From the mesh's frame to the world.
    pub transform: Mat4,
    /// The section of the scene that carries it. The transform is its place at rest.
    pub carried: Option<SectionBinding>,
    /// First row of its anchors in the scene's [`RadianceTransfer`].
    pub first_row: u32,
    /// The level of its anchors ([`AnchorGrid::levels`]) with which its rows begin. Finer levels are not stored,
    /// because the instance is never seen from near enough.
    pub first_level: u32,
    /// Index of the first of the scene's shares of the sun that belong to its vertices, in their order. With `None`,
    /// its shadows come from shadow maps.
    pub first_share: Option<u32>,
    /// The stand of the scene whose plant it belongs to. The transform then leads to the plant's frame.
    #[serde(skip)]
    pub stand: Option<u32>,
    /// Whether it lies below everything that is seen while the sun is above. It then receives shadows and casts none,
    /// so that shadow maps need not cover it and have finer texels elsewhere.
    pub floor: bool,
}

/// How a surface looks, apart from its shape.
// A scene has a handful of materials: an indirection would save no memory worth a line.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum Material {
    /// A leaf, which transmits light.
    Leaf(LeafMaterial),
    /// A surface that transmits nothing.
    Opaque(OpaqueMaterial),
}

/// Bark or ground: a diffuse surface that transmits nothing. It is seen from the side that its mesh's normals point to;
/// its inside is black.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct OpaqueMaterial {
    /// Name of the surface in printed text.
    pub name: String,
    /// Reflectance (red, green, blue), 0 to 1.
    pub albedo: [f32; 3],
    /// A pattern that takes the place of the albedo. With `None`, the shader has no code for it.
    pub pattern: Option<AlbedoPattern>,
}

/// A map of reflectance that is laid side by side over x and y of the world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AlbedoPattern {
    /// Texels along x.
    pub width: u32,
    /// Texels along y.
    pub height: u32,
    /// Reflectance, row by row; row 0 has the largest y.
    pub texels: Arc<Vec<[f32; 3]>>,
    /// x and y of the map's corner with the least of both (mm).
    pub corner: [f32; 2],
    /// Lengths of the map along x and y (mm).
    pub size: [f32; 2],
}

/// Triangles with normals, tangents and texture coordinates. All lists except the indices have an entry for each
/// vertex.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Mesh {
    /// Places in the mesh's own frame and units.
    pub positions: Vec<Vec3>,
    /// Unit normals. Those of a leaf point out of its front.
    pub normals: Vec<Vec3>,
    /// xyz is the tangent along +u. w = ±1 is the handedness: bitangent = w · normal × tangent, which is up in the
    /// front's image (towards smaller v).
    pub tangents: Vec<Vec4>,
    /// Texture coordinates; (0, 0) is the top left corner of the front's maps.
    pub uvs: Vec<Vec2>,
    /// Indices of the vertices, three for each triangle.
    pub indices: Vec<u32>,
    /// Coarser triangulations of the same vertices, for places where the mesh is small in the picture. The finest is
    /// first; the list may be empty.
    pub details: Vec<DetailLevel>,
    /// The anchors of the mesh, which a scene with a [`RadianceTransfer`] needs.
    pub anchors: Option<AnchorGrid>,
}

/// A coarser triangulation.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct DetailLevel {
    /// Indices of the vertices, three for each triangle.
    pub indices: Vec<u32>,
    /// Its largest distance from the mesh, in the mesh's units.
    pub error: f32,
    /// Whether its normals are too far from the mesh's to be lit, so that only shadow maps may use it. Such levels come
    /// last.
    pub outline_only: bool,
}

impl Material {
    /// Name of the material in printed text.
    pub fn name(&self) -> &str {
        match self {
            Material::Leaf(leaf) => &leaf.name,
            Material::Opaque(opaque) => &opaque.name,
        }
    }

    /// The leaf, or `None` for another surface.
    pub fn leaf(&self) -> Option<&LeafMaterial> {
        match self {
            Material::Leaf(leaf) => Some(leaf),
            Material::Opaque(_) => None,
        }
    }
}

impl Scene {
    /// The leaf with this index among the materials; `None` if there is none, or if it is another surface.
    pub fn leaf(&self, material: usize) -> Option<&LeafMaterial> {
        self.materials.get(material)?.leaf()
    }

    /// As [`Scene::leaf`], for changing it.
    pub fn leaf_mut(&mut self, material: usize) -> Option<&mut LeafMaterial> {
        match self.materials.get_mut(material)? {
            Material::Leaf(leaf) => Some(leaf),
            Material::Opaque(_) => None,
        }
    }

    /// Adds a mesh and a material, and returns an instance with their indices.
    pub fn add(&mut self, mesh: Mesh, material: Material) -> Instance {
        self.meshes.push(mesh);
        self.materials.push(material);
        let (mesh, material) = (self.meshes.len() - 1, self.materials.len() - 1);
        Instance { mesh, material, transform: Mat4::IDENTITY, ..Instance::default() }
    }
}

/// A pinhole camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Place of the camera.
    pub eye: Vec3,
    /// The point that it looks at.
    pub target: Vec3,
    /// The direction that is up in the picture. It must not lie along the line of sight.
    pub up: Vec3,
    /// Field of view from the bottom of the picture to its top.
    pub fov_y_deg: f32,
}

impl Camera {
    /// Half the picture's height at a distance of 1.
    pub fn half_height(&self) -> f32 {
        (0.5 * self.fov_y_deg.to_radians()).tan()
    }
}
