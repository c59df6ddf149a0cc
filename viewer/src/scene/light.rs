//! The light of a scene: the sun, a sky that depends on direction, a scanner's tube, and light that arrives between and
//! by way of other surfaces.

use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// How light from all around arrives at the anchors of every instance, between and by way of other surfaces (Wang et
/// al. 2005, §4). Each row of entries is summed over the columns of the light. Direct light from the sun's disk is not
/// included.
///
/// The rows of an anchor are ∫ L(ω) ω dω over the directions on its front (x, y, z), the same over those on its back,
/// and for glossy leaves ∫ L(ω) Y_lm(ω) dω at l(l+1)+m. Wood and ground have one row, the irradiance on their front.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RadianceTransfer {
    /// Number of bands of the light's harmonics, whose square is the number of columns. `None` means one column: the
    /// light of the scene itself, which must not change.
    pub bands: Option<usize>,
    /// Number of bands of the harmonics among the rows of a glossy leaf, 1 to 7.
    pub gloss_bands: usize,
    /// The factor that all entries are to be multiplied by. They are stored as half floats, and light may have any
    /// unit.
    pub scale: f32,
    /// The entries, row by row and column by column: light by way of other surfaces (red, green, blue), and light
    /// straight from the sky.
    pub entries: Vec<[f32; 4]>,
}

/// The places on a mesh at which arriving light is known.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AnchorGrid {
    /// Number of anchors along each piece of the mesh and across it; 1 by 1 where every vertex is an anchor.
    pub grid: [u32; 2],
    /// For each vertex, the first anchor of its piece, and its place in the grid, 0 to `grid − 1`.
    pub places: Vec<Vec3>,
    /// Number of rows of an anchor: 1 (wood and ground), 6 (a leaf) or 6 + N² (a glossy leaf).
    pub rows: u32,
    /// Number of grids of each piece, 1 to 8. All anchors of one grid come before those of the next. The next grid has
    /// half as many along both axes, but at least one. A pixel reads two grids. The fewer pixels lie between two
    /// anchors, the coarser they are.
    pub levels: u32,
}

impl AnchorGrid {
    /// Number of anchors along a piece and across it, on a level.
    pub fn level(&self, level: u32) -> [u32; 2] {
        self.grid.map(|n| (n >> level).max(1))
    }

    /// Number of pieces of the mesh. The last place gives it.
    pub fn pieces(&self) -> u32 {
        let last = self.places.iter().map(|p| p.x).fold(0.0, f32::max) as u32;
        last / self.level(0).iter().product::<u32>() + 1
    }

    /// Number of anchors of all pieces, on this level and all coarser ones.
    pub fn count(&self, first_level: u32) -> usize {
        let each: u32 = (first_level..self.levels).map(|l| self.level(l).iter().product::<u32>()).sum();
        (self.pieces() * each) as usize
    }
}

/// A picture of everything around, seen from inside. Row 0 is at the zenith, the middle column looks to +x, and columns
/// to the right of it towards −y. Texel (i, j) has its centre at azimuth (½ − (i + ½)/width)·360° and zenith angle
/// (j + ½)·180°/height.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Backdrop {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Radiance, row by row.
    pub texels: Arc<Vec<[f32; 3]>>,
    /// By how much the picture is turned from +x towards +y (whole turns).
    pub turn: f32,
}

/// The sun as a disk.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Sun {
    /// Unit vector towards the sun.
    pub direction: Vec3,
    /// Irradiance on a surface facing the sun.
    pub irradiance: [f32; 3],
    /// Angular radius (rad); 0.004 65 for the real sun.
    pub radius: f32,
}

/// A tube-shaped lamp that moves over the plane z = 0, and an orthographic camera whose picture is rectified to that
/// plane: pixel (i, j) of W×H is the point ((i + ½ − W/2)·p, (H/2 − j − ½)·p). Nothing casts a shadow, and no light is
/// transmitted.
///
/// Let R be the distance to the tube's axis, h the height of the axis, and let the tube be seen under the angles θ ± β
/// across and φ₀ … φ₁ along. Then L = h/R · β/sin β · 2 ∫∫ (ρd/π + f_s) max(0, N·l) cosφ dφ dθ/2β. So a white matte
/// texel that faces up under an infinite tube straight above has L = 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Scanner {
    /// Unit vector towards the camera, above the plane.
    pub camera: Vec3,
    /// Width of a pixel on the plane.
    pub pixel_mm: f32,
    /// Height of the tube's axis above the plane.
    pub height_mm: f32,
    /// Length of the tube's lit part; its middle is at 0.
    pub length_mm: f32,
    /// Radius of the tube; 0 is a thin tube.
    pub radius_mm: f32,
    /// Whether the tube lies along x and moves along y. If not, it lies along y and moves along x.
    pub along_x: bool,
    /// Place of the tube along its travel.
    pub at_mm: f32,
    /// Whether gloss has the V-cavity factor G, as in scenes. Without it, gloss is as leaves are fitted (Wang et al.
    /// 2005, Eq. 7).
    pub bounded: bool,
}

/// A sky: its light on the leaves, and its look behind them. The caller decides where the numbers come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SkyDome {
    /// Coefficients of the radiance all around, below the horizon too, in real orthonormal harmonics without the
    /// Condon–Shortley phase, at l(l+1)+m, in world directions with z up. There are N² of them, N from 1 to 7.
    pub harmonics: Vec<[f32; 3]>,
    /// The look where it is a picture. Then the Perez coefficients and their factors are not used.
    pub picture: Option<Backdrop>,
    /// Perez coefficients A … E of luminance Y and chromaticities x and y.
    pub perez: [[f32; 5]; 3],
    /// Factors of Y, Y/y and Y·x/y, in units of radiance.
    pub scale: [f32; 3],
    /// Radiance below the horizon. With `None` the background is shown there.
    pub ground: Option<[f32; 3]>,
    /// Unit vector towards the sun, on which the sky's luminance and colours depend.
    pub sun: Vec3,
    /// A factor on the whole sky.
    pub strength: f32,
    /// The turbidity at which the window's slider starts; 0 where the sky is no model, but a picture of everything
    /// around, and does not follow the sun.
    pub turbidity: f32,
}

impl SkyDome {
    /// Whether the sky is a model: it follows the sun and ends at the horizon.
    pub fn is_model(&self) -> bool {
        self.turbidity > 0.0
    }
}
