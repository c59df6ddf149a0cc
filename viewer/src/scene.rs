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

pub use crate::grass::{GRASS_STEPS, Grass, GrassLevel, GrassSheet, GrassTable, MOST_SLICES};
use glam::{Mat4, Quat, Vec2, Vec3, Vec4};
pub use mesophyll_surface::basis::Basis;
pub use mesophyll_surface::gloss::Lobe;
pub use mesophyll_surface::side::{Side, Sides};
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

/// How light from all around arrives at the anchors of every instance, past and by way of other surfaces (Wang et al.
/// 2005, §4): rows that are sums over columns of the light. The sun's disk itself is not in it.
///
/// An anchor's rows are ∫ L(ω) ω dω over the directions on its front (x, y, z), the same over those on its back, and
/// for glossy leaves ∫ L(ω) Y_lm(ω) dω at l(l+1)+m. Wood and ground have one row, the irradiance on their front.
#[derive(Debug, Clone, PartialEq)]
pub struct Transfer {
    /// Bands of the light's harmonics, whose squares are the columns; `None`: one column, the light that the scene has
    /// and keeps.
    pub bands: Option<usize>,
    /// Bands of the harmonics among the rows of a glossy leaf, 1 to 7.
    pub gloss_bands: usize,
    /// What all entries are multiplied with: they are kept as half floats, and light may be in any unit.
    pub scale: f32,
    /// Row by row, column by column: light by way of other surfaces (red, green, blue), and straight from the sky.
    pub entries: Vec<[f32; 4]>,
}

/// Where light that arrives is known on a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Anchors {
    /// Anchors along each piece of the mesh and across it; 1 by 1 where every vertex is one.
    pub grid: [u32; 2],
    /// Of each vertex: the first anchor of its piece, and its place in the grid, 0 to `grid − 1`.
    pub places: Vec<Vec3>,
    /// Rows of an anchor: 1 (wood and ground), 6 (a leaf) or 6 + N² (a glossy one).
    pub rows: u32,
}

/// As many branches as fill the smallest uniform buffer every adapter has.
pub const MOST_BRANCHES: usize = 128;

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
    /// Where the scene's shares of the sun begin that are of its mesh's vertices, in their order; `None`: its shadows
    /// come from shadow maps.
    pub first_share: Option<u32>,
    /// It lies below everything and the sun is above: it is shaded and shades nothing, so that shadow maps need not
    /// cover it and are finer where things stand.
    pub floor: bool,
}

/// How an instance hangs on a branch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ride {
    /// Index into the scene's branches.
    pub branch: usize,
    /// Where it hangs, rigidly: 0 (root) to 1 (tip). `None`: the mesh is the branch itself and bends at every vertex.
    pub at: Option<f32>,
}

/// How sections carry an instance about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Carried {
    /// The section, or the first of those that the mesh's vertices count from.
    pub first: u32,
    /// Where [`Sections::of_vertices`] begins for the mesh's vertices; `None`: the whole instance is carried by one.
    pub vertices: Option<u32>,
}

/// Rigid motions in world space, a cross-section of a plant's branch each, as they are at a time (s).
#[derive(Clone)]
pub struct Sections {
    /// How many there are, at any time.
    pub count: usize,
    /// Of the vertices of bark: which section carries each, counted from the instance's first.
    pub of_vertices: Arc<Vec<u32>>,
    /// All of them at a time (s).
    pub at: Arc<dyn Fn(f64) -> Vec<Section> + Send + Sync>,
}

/// A rigid motion: a point p goes to `to` + `turn` (p − `from`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    /// A point at rest.
    pub from: Vec3,
    /// Where it goes.
    pub to: Vec3,
    /// How directions turn.
    pub turn: Quat,
}

impl std::fmt::Debug for Sections {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Sections({}, of {} vertices)", self.count, self.of_vertices.len())
    }
}

/// A branch at rest and how it bends. Amplitudes are in units of its length for the normalised deflection
/// u = a₂y² + a₃y³ + a₄y⁴ + a₅y⁵ with y = ln(1 + (α − 1)x)/ln α: the tip goes by amplitude · Σa · length, before the
/// length is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Branch {
    /// Where its axis begins.
    pub root: Vec3,
    /// From root to tip, a unit vector.
    pub t: Vec3,
    /// A unit vector across the branch.
    pub r: Vec3,
    /// A unit vector across the branch: r = s × t.
    pub s: Vec3,
    /// Of the axis, in the world's units.
    pub length: f32,
    /// α, tip radius over root radius.
    pub alpha: f32,
    /// ln α.
    pub ln_alpha: f32,
    /// ln α/(α − 1), which is 1 at α = 1.
    pub ell: f32,
    /// Coefficients a₂ to a₅ of the deflection.
    pub a: [f32; 4],
    /// Amplitude towards r and s without gusts: weight and mean wind.
    pub still: [f32; 2],
    /// Amplitude per unit of the motion texture.
    pub gain: f32,
    /// Line through the motion texture: where at time 0, and texture sides a second.
    pub start: [f64; 2],
    /// Texture sides a second.
    pub velocity: [f64; 2],
}

/// Gusts: a periodic texture whose channels drive the deflections towards r and s, and the time.
#[derive(Debug, Clone)]
pub struct Wind {
    /// Texels a side; row-major, texel centres at (i + ½)/size, sampled linearly and repeated. 0: no branch sways.
    pub size: u32,
    /// Row by row.
    pub motion: Vec<[f32; 2]>,
    /// Since the beginning of the scene.
    pub time_s: f64,
}

/// The sun as a disk.
#[derive(Debug, Clone, Copy)]
pub struct Sun {
    /// Towards the sun.
    pub direction: Vec3,
    /// Irradiance on a surface facing the sun.
    pub irradiance: [f32; 3],
    /// Angular radius (rad); 0.004 65 for the real one.
    pub radius: f32,
}

/// A tube-shaped lamp that moves over the plane z = 0 and an orthographic camera whose picture is rectified to that
/// plane: pixel (i, j) of W×H is the point ((i + ½ − W/2)·p, (H/2 − j − ½)·p). Nothing casts a shadow, and nothing
/// comes through.
///
/// With R the distance to the axis, h its height, and the tube seen under the angles θ ± β across and φ₀ … φ₁ along,
/// L = h/R · β/sin β · 2 ∫∫ (ρd/π + f_s) max(0, N·l) cosφ dφ dθ/2β, so that a white matte texel facing up under an
/// infinite tube straight above shows 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scanner {
    /// Towards the camera; a unit vector above the plane.
    pub camera: Vec3,
    /// Width of a pixel on the plane.
    pub pixel_mm: f32,
    /// Of the tube's axis above the plane.
    pub height_mm: f32,
    /// Lit length, centred.
    pub length_mm: f32,
    /// 0 is a thin tube.
    pub radius_mm: f32,
    /// The tube lies along x and moves along y, instead of the other way round.
    pub along_x: bool,
    /// Where it stands along its travel.
    pub at_mm: f32,
    /// Gloss with the V-cavity factor G, as scenes have it; else without, as leaves are fitted (Wang et al. 2005, Eq.
    /// 7).
    pub bounded: bool,
}

/// A sky: the light it throws on the leaves, and how it looks behind them. Plain numbers: where they come from is the
/// caller's business.
#[derive(Debug, Clone, PartialEq)]
pub struct Dome {
    /// Coefficients of the radiance all around (below the horizon too) in real orthonormal harmonics without the
    /// Condon–Shortley phase, at l(l+1)+m, z up, in world directions: N² of them, N from 1 to 7.
    pub harmonics: Vec<[f32; 3]>,
    /// Perez coefficients A … E of luminance Y and chromaticities x and y.
    pub perez: [[f32; 5]; 3],
    /// Factors of Y, Y/y and Y·x/y, in units of radiance.
    pub scale: [f32; 3],
    /// Radiance below the horizon; `None` shows the background there.
    pub ground: Option<[f32; 3]>,
    /// Towards the sun, which the sky's colours turn about.
    pub sun: Vec3,
    /// A factor on all of it.
    pub strength: f32,
    /// What the window's slider starts from.
    pub turbidity: f32,
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
