//! What lights a scene: the sun, a sky that differs by direction, a scanner's tube, and how light arrives past and by
//! way of other surfaces.

use glam::Vec3;

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
    /// Grids of each piece, 1 to 8, all anchors of one before those of the next, which has half as many along both
    /// axes, and at least one. A pixel reads two of them, the coarser the fewer pixels lie between two anchors.
    pub levels: u32,
}

impl Anchors {
    /// Anchors along a piece and across it, on a level.
    pub fn level(&self, level: u32) -> [u32; 2] {
        self.grid.map(|n| (n >> level).max(1))
    }

    /// Pieces of the mesh: as many as its last one ends with.
    pub fn pieces(&self) -> u32 {
        let last = self.places.iter().map(|p| p.x).fold(0.0, f32::max) as u32;
        last / self.level(0).iter().product::<u32>() + 1
    }

    /// Anchors of all pieces, on this level and all coarser ones.
    pub fn count(&self, first_level: u32) -> usize {
        let each: u32 = (first_level..self.levels).map(|l| self.level(l).iter().product::<u32>()).sum();
        (self.pieces() * each) as usize
    }
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
