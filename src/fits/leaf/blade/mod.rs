//! The blade: its outline from the light that comes through, its relief from the normals, and a trimmed two-sided mesh.
//! The mesh that is rendered has the shape that was scanned.

pub mod glb;
pub mod mesh;
pub mod outline;
pub mod relief;

pub use mesh::BladeMesh;

use mesophyll_base::image::ImageSize;

/// A square grid of texels on the blade.
#[derive(Debug, Clone, Copy)]
pub struct TexelGrid {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Texel size (mm).
    pub texel: f64,
}

impl TexelGrid {
    /// Columns and rows.
    pub fn size(&self) -> ImageSize {
        ImageSize::new(self.width, self.height)
    }

    /// Texel coordinates (column, row; integers at centres) → position on the blade (mm).
    pub fn position(&self, column: f64, row: f64) -> [f64; 2] {
        let [x, y] = self.size().place_mm(self.texel, 0);
        [x + column * self.texel, y - row * self.texel]
    }

    /// Position on the blade (mm) → texel coordinates.
    pub fn texel(&self, at: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.size().place_mm(self.texel, 0);
        [(at[0] - x) / self.texel, (y - at[1]) / self.texel]
    }

    /// Texture coordinates of a position, (0, 0) in the top left corner of the front's maps.
    pub fn uv(&self, at: [f64; 2]) -> [f32; 2] {
        let [c, r] = self.texel(at);
        [((c + 0.5) / self.width as f64) as f32, ((r + 0.5) / self.height as f64) as f32]
    }
}
