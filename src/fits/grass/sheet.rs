//! The pictures of slices. They are cells, side by side on one sheet (an atlas). Each cell has a border, and the sheet
//! has coarser levels.
//!
//! All numbers of a texel except its opacity are multiplied by the opacity. This makes every filter a plain mean:
//! between texels, from level to level, and in front-to-back blending. The mean opacity of a level is that of the next
//! finer one.

use crate::grass::{Error, Result};
use mesophyll_files::image::{ChannelMaps, Packing, read_exr, to_srgb8, write_exr, write_png};
use std::path::Path;

/// Bytes of a texel on a graphics adapter: 16 half floats.
pub const BYTES: usize = 32;
/// Number of values in a texel.
pub const CHANNELS: usize = 14;
/// Names of these values in a file. `rho_d` belongs to the side that faces +x (slices across x), +y or up, and
/// `rho_d_behind` to the other side. The normal points out of the first side. `place` is where in the slab the blade
/// is, from 0 (the end towards −x, −y or down) to 1.
pub const NAMES: [&str; CHANNELS] = [
    "opacity.Y",
    "rho_d.R",
    "rho_d.G",
    "rho_d.B",
    "rho_d_behind.R",
    "rho_d_behind.G",
    "rho_d_behind.B",
    "rho_t.R",
    "rho_t.G",
    "rho_t.B",
    "normal.X",
    "normal.Y",
    "normal.Z",
    "place.Y",
];
/// Number of levels of a sheet; small cells have fewer. The border is as wide as a texel of the coarsest level.
const LEVELS: u32 = 4;
/// Number of cells in a line of the sheet.
pub const LINE: usize = 8;

/// What a slice holds at one place: shares of the area. Every value except the opacity is multiplied by it.
pub type SliceTexel = [f32; CHANNELS];

/// What lies beyond the lower and the upper edge of a cell. Beyond its left and right edges a cell repeats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CellEdges {
    /// Below the cell, the row at the ground continues. Above it there is nothing.
    Upright,
    /// The cell repeats.
    Level,
}

/// Cells with borders, and coarser levels.
#[derive(Debug, Clone, PartialEq)]
pub struct SliceAtlas {
    /// Texels of a cell along its length and its height, without the border.
    pub cell: [usize; 2],
    /// Texels of the border on each side.
    pub border: usize,
    /// Number of cells.
    pub cells: usize,
    /// The levels, the finest first.
    pub levels: Vec<AtlasLevel>,
}

/// A level of a sheet.
#[derive(Debug, Clone, PartialEq)]
pub struct AtlasLevel {
    /// Number of texels in a row.
    pub width: usize,
    /// Number of rows. The first row is the top one.
    pub height: usize,
    /// The texels, row by row.
    pub texels: Vec<SliceTexel>,
}

/// Number of levels that cells of this size have.
fn levels([width, height]: [usize; 2]) -> u32 {
    LEVELS.min(width.min(height).ilog2()).max(1)
}

/// Number of texels of a sheet with this many cells, with borders and coarser levels.
pub(crate) fn area(cell: [usize; 2], cells: usize) -> usize {
    let border = 1 << levels(cell);
    let fine = cells.min(LINE) * cells.div_ceil(LINE) * (cell[0] + border) * (cell[1] + border);
    (0..levels(cell)).map(|k| fine >> (2 * k)).sum()
}

impl SliceAtlas {
    /// Makes a sheet of cells. `at(cell, column, row)` gives the texels of each cell, the top row first. The sides of
    /// `cell` are powers of two.
    pub fn new(
        cell: [usize; 2],
        cells: usize,
        edges: CellEdges,
        at: impl Fn(usize, usize, usize) -> SliceTexel,
    ) -> SliceAtlas {
        let [w, h] = cell;
        let border = 1 << (levels(cell) - 1);
        let pitch = [w + 2 * border, h + 2 * border];
        let (columns, rows) = (cells.min(LINE), cells.div_ceil(LINE));
        let (width, height) = (columns * pitch[0], rows * pitch[1]);
        let mut texels = vec![[0.0; CHANNELS]; width * height];
        for k in 0..cells {
            for row in 0..pitch[1] {
                for column in 0..pitch[0] {
                    // Adding w keeps the difference positive, because borders are at most as wide as a cell.
                    let x = (column + w - border) % w;
                    let y = match edges {
                        CellEdges::Level => Some((row + h - border) % h),
                        CellEdges::Upright if row < border => None,
                        CellEdges::Upright => Some((row - border).min(h - 1)),
                    };
                    let place = ((k / LINE) * pitch[1] + row) * width + (k % LINE) * pitch[0] + column;
                    texels[place] = y.map_or([0.0; CHANNELS], |y| at(k, x, y));
                }
            }
        }
        let mut sheet = SliceAtlas { cell, border, cells, levels: vec![AtlasLevel { width, height, texels }] };
        for _ in 1..levels(cell) {
            sheet.levels.extend(sheet.levels.last().map(AtlasLevel::halved));
        }
        sheet
    }

    /// The values at a share of a cell's length, which repeats, and at a share of its height over the ground. That one
    /// is from 0 to 1, and less counts as 0. Level 0 is the finest; between two levels the result is a mean of both.
    pub fn at(&self, cell: usize, [u, v]: [f64; 2], level: f64) -> [f64; CHANNELS] {
        let last = (self.levels.len() - 1) as f64;
        let level = level.clamp(0.0, last);
        let fine = self.level(cell, [u, v], level as usize);
        let share = level.fract();
        if share == 0.0 {
            return fine;
        }
        let coarse = self.level(cell, [u, v], level as usize + 1);
        std::array::from_fn(|c| fine[c] + share * (coarse[c] - fine[c]))
    }

    fn level(&self, cell: usize, [u, v]: [f64; 2], k: usize) -> [f64; CHANNELS] {
        let level = &self.levels[k];
        let [w, h] = self.cell;
        let corner = [(cell % LINE) * (w + 2 * self.border), (cell / LINE) * (h + 2 * self.border)];
        let size = (1 << k) as f64;
        let x = (corner[0] as f64 + self.border as f64 + u.rem_euclid(1.0) * w as f64) / size - 0.5;
        let y = (corner[1] as f64 + self.border as f64 + (1.0 - v.clamp(0.0, 1.0)) * h as f64) / size - 0.5;
        let (i, j) = (x.floor(), y.floor());
        let (fx, fy) = (x - i, y - j);
        let get = |di: usize, dj: usize| {
            let column = (i as usize + di).min(level.width - 1);
            let row = (j as usize + dj).min(level.height - 1);
            &level.texels[row * level.width + column]
        };
        let (a, b, c, d) = (get(0, 0), get(1, 0), get(0, 1), get(1, 1));
        let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        std::array::from_fn(|n| {
            [a, b, c, d].iter().zip(weights).map(|(texel, weight)| weight * f64::from(texel[n])).sum()
        })
    }

    /// Number of texels of all levels together.
    pub fn texels(&self) -> usize {
        self.levels.iter().map(|level| level.texels.len()).sum()
    }

    /// Writes the finest level with its borders, as half floats under the names of [`NAMES`].
    ///
    /// # Errors
    /// [`Error::Write`] where the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_exr(path, &maps(self.levels[0].width, &self.levels[0].texels), Packing::Half)
    }

    /// Reads a file of [`SliceAtlas::write`], and makes the coarser levels.
    ///
    /// # Errors
    /// [`Error::Input`] for a file that cannot be read or that is of another size.
    pub fn read(path: &Path, cell: [usize; 2], cells: usize) -> Result<SliceAtlas> {
        let empty = SliceAtlas::new(cell, cells, CellEdges::Level, |_, _, _| [0.0; CHANNELS]);
        let AtlasLevel { width, height, .. } = empty.levels[0];
        let mut sheet =
            SliceAtlas { levels: vec![AtlasLevel { width, height, texels: texels(path, width, height)? }], ..empty };
        for _ in 1..levels(cell) {
            sheet.levels.extend(sheet.levels.last().map(AtlasLevel::halved));
        }
        Ok(sheet)
    }

    /// Writes a picture of the finest level: ρd as it is seen, transparent where no blade is. `white` is the value of
    /// ρd that becomes white.
    pub fn preview(&self, path: &Path, white: f32) -> Result<()> {
        let level = &self.levels[0];
        let seen = |t: &SliceTexel| {
            let of = |c: usize| if t[0] > 0.0 { to_srgb8(t[c] / (t[0] * white)) } else { 0 };
            [of(1), of(2), of(3), (255.0 * t[0] + 0.5) as u8]
        };
        let bytes: Vec<u8> = level.texels.iter().flat_map(seen).collect();
        write_png(path, level.width, level.height, &bytes)
    }
}

impl AtlasLevel {
    /// The next coarser level, by means of two by two texels.
    fn halved(&self) -> AtlasLevel {
        let (width, height) = (self.width / 2, self.height / 2);
        let mean = |k: usize| {
            let (x, y) = (2 * (k % width), 2 * (k / width));
            let of = |i: usize, j: usize| &self.texels[(y + j) * self.width + x + i];
            let four = [of(0, 0), of(1, 0), of(0, 1), of(1, 1)];
            std::array::from_fn(|c| 0.25 * four.iter().map(|t| t[c]).sum::<f32>())
        };
        AtlasLevel { width, height, texels: (0..width * height).map(mean).collect() }
    }
}

/// The texels as named channels.
pub(crate) fn maps(width: usize, texels: &[SliceTexel]) -> ChannelMaps {
    let mut maps = ChannelMaps::new(width, texels.len() / width.max(1));
    for (c, name) in NAMES.into_iter().enumerate() {
        maps.push(name, texels.iter().map(|t| t[c]).collect());
    }
    maps
}

/// The texels of a file of a known size.
///
/// # Errors
/// [`Error::Input`] for a file that cannot be read, of another size, or with numbers that are not finite.
pub(crate) fn texels(path: &Path, width: usize, height: usize) -> Result<Vec<SliceTexel>> {
    let maps = read_exr(path)?;
    if (maps.width, maps.height) != (width, height) {
        let found = format!("{}x{} texels", maps.width, maps.height);
        return Err(Error::unexpected(path, "size", found, format!("{width}x{height}")));
    }
    let planes: Vec<&[f32]> = NAMES.iter().map(|name| maps.require(path, name)).collect::<Result<_>>()?;
    let texels: Vec<SliceTexel> = (0..width * height).map(|k| std::array::from_fn(|c| planes[c][k])).collect();
    match texels.iter().position(|t| t.iter().any(|v| !v.is_finite())) {
        Some(k) => Err(Error::input(path, format!("texel {k} holds a number that is not finite"))),
        None => Ok(texels),
    }
}
