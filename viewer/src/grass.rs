//! Grass as slices (Habel 2009, ch. 2): the data that `passes/grass.rs` draws. Lengths are in mm, and z is up.

use crate::error::{Error, Result};
use crate::gpu::Gpu;
use glam::{DVec2, Vec2, Vec3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Number of steps of a table, over the height from 0 to the carrier's, or over |Ω_z| from 0 to 1.
pub const GRASS_STEPS: usize = 16;
/// A table with a value at each step and at both ends.
pub type GrassTable = [f32; GRASS_STEPS + 1];
/// The largest number of slices that a ray may cross.
pub const MOST_SLICES: u32 = 256;

/// A lawn: a level box over the ground, filled with a rectangle of slices that repeats.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Grass {
    /// Name of the lawn in printed text.
    pub name: String,
    /// The middle of one rectangle on the ground, in the world.
    pub origin: Vec3,
    /// The least x and y of the box, relative to the origin.
    pub low: Vec2,
    /// The largest x and y, relative to the origin.
    pub high: Vec2,
    /// Height of the box over the ground.
    pub height: f32,
    /// Size of the rectangle that repeats.
    pub period: [f32; 2],
    /// Number of slices across x in a rectangle, and the same number across y.
    pub count: u32,
    /// The largest number of slices that a ray crosses, 1 to [`MOST_SLICES`]. What it has gathered by then represents
    /// the rest.
    pub steps: u32,
    /// The projection that opacities are weighted by (`fit grass` explains it): the share of the blades' area that a
    /// direction sees, over |Ω_z|.
    pub projection: GrassTable,
    /// The same share as the slices themselves show it, along the ground and from above.
    pub shown: [f32; 2],
    /// Mean opacity of upright slices over the height.
    pub cover: GrassTable,
    /// Mean opacity of the level slice.
    pub level_cover: f32,
    /// The upright slices: first those across x, then those across y.
    pub upright: GrassSheet,
    /// The level slice at half the height. With `None`, the shader has no code and no texture for it.
    pub level: Option<GrassSheet>,
    /// Reflectance of the ground.
    pub soil: [f32; 3],
    /// Mean share of the light that a blade scatters to both sides together.
    pub scatter: [f32; 3],
    /// Share of the light that passes the blades above and arrives at a height (first index), over |Ω_z| (second
    /// index).
    pub through: [GrassTable; GRASS_STEPS + 1],
    /// Share of an even sky's light that arrives at blades, over the height.
    pub open: GrassTable,
    /// Share of an even sky's light that arrives at the ground.
    pub soil_open: f32,
    /// The seed by which every rectangle shows the meadow moved by a random number of eighths of its sides, so that
    /// the lawn does not repeat; `fit_grass::irregular` has the same rule. With `None`, all rectangles are alike, and
    /// the shader has no code for it.
    pub irregular: Option<u32>,
    /// The hill that the lawn is on. With `None`, the shader has no code for it.
    pub hill: Option<GrassHill>,
    /// How the wind leans the blades. With `None`, the shader has no code and no map for it.
    pub gusts: Option<Arc<GrassGusts>>,
    /// Whether every slice is drawn as polygons that are sorted and blended from back to front, instead of by following
    /// a ray through all slices. This is the method that slices are compared with. No wind leans these polygons.
    pub billboards: bool,
}

/// A hill in the shape of a Gaussian over the ground that the lawn's origin is on, or a hollow.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GrassHill {
    /// Place of its top in the world (x, y).
    pub middle: Vec2,
    /// Height of its top; less than 0 in a hollow.
    pub height: f32,
    /// Standard deviation of the Gaussian.
    pub radius: f32,
}

/// A map of gusts that repeats and moves with the wind. It holds the lean of blades along x and y: the displacement of
/// a point over its height. So a blade's point at the height z is moved by z times its lean.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GrassGusts {
    /// The lean without gusts.
    pub mean: [f32; 2],
    /// Number of texels along a side of the map.
    pub size: u32,
    /// The lean that gusts add, row by row. Texel centres are at (i + ½)/size; the map is sampled linearly and repeats.
    pub added: Vec<[f32; 2]>,
    /// Sides of the map for each mm along x and for each mm along y.
    pub turn: [DVec2; 2],
    /// Sides of the map for each second.
    pub drift: DVec2,
}

impl GrassGusts {
    /// The place in the map of a place in the world (x, y) at a time (s), from 0 to 1 along both sides.
    pub fn place(&self, at: DVec2, time: f64) -> DVec2 {
        let sides = self.turn[0] * at.x + self.turn[1] * at.y + self.drift * time;
        sides - sides.floor()
    }
}

/// Pictures of slices side by side, each with a border, and coarser levels of the whole.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GrassSheet {
    /// Texels of a picture along and up, without its border.
    pub cell: [u32; 2],
    /// Texels of the border on each side of a picture.
    pub border: u32,
    /// Number of pictures in a line.
    pub columns: u32,
    /// The levels, the finest first. Each has half the width and height of the one before.
    pub levels: Vec<GrassLevel>,
}

/// A level of a sheet, row by row, with row 0 on top. All numbers except the opacity are multiplied by the opacity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GrassLevel {
    /// Number of texels in a row.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// The four planes. The first is the normal and the opacity. The second is the reflectance of the side that faces
    /// +x, +y or up, and the place of the blade along this direction in its slab (0 to 1). The third is the reflectance
    /// of the other side, and the place again. The fourth is the transmittance; its last number is unused.
    pub planes: [Vec<[f32; 4]>; 4],
}

/// Refuses grass that contradicts itself.
pub(crate) fn validate(gpu: &Gpu, index: usize, grass: &Grass) -> Result<()> {
    let wrong = |what: &str, found: String, expected: &str| {
        Err(Error::Scene { place: format!("grass {index}, {what}"), found, expected: expected.into() })
    };
    let size = grass.high - grass.low;
    let lengths = [size.x, size.y, grass.height, grass.period[0], grass.period[1]];
    if !grass.origin.is_finite() || !lengths.iter().all(|l| l.is_finite() && *l > 0.0) {
        return wrong("size", format!("{lengths:?} mm at {}", grass.origin), "positive lengths");
    }
    if grass.count == 0 {
        return wrong("count", "0".into(), "one slice or more");
    }
    if !(1..=MOST_SLICES).contains(&grass.steps) {
        return wrong("steps", grass.steps.to_string(), "1 to 256");
    }
    let tables = grass.through.iter().chain([&grass.projection, &grass.cover, &grass.open]).flatten();
    let rest =
        grass.shown.iter().chain(&grass.soil).chain(&grass.scatter).chain([&grass.level_cover, &grass.soil_open]);
    if let Some(v) = tables.chain(rest).find(|v| !(v.is_finite() && **v >= 0.0)) {
        return wrong("tables", v.to_string(), "numbers of 0 or more");
    }
    if grass.irregular.is_some() && !grass.count.is_multiple_of(8) {
        return wrong("count", grass.count.to_string(), "a multiple of 8 in an irregular lawn");
    }
    if let Some(hill) = &grass.hill {
        if !(hill.middle.is_finite() && hill.height.is_finite() && hill.radius.is_finite() && hill.radius > 0.0) {
            return wrong("hill", format!("{hill:?}"), "finite numbers and a positive radius");
        }
        if grass.billboards || grass.gusts.is_some() {
            return wrong("hill", "billboards or gusts".into(), "neither on a hill");
        }
    }
    if grass.billboards && grass.gusts.is_some() {
        return wrong("billboards", "gusts".into(), "no wind");
    }
    if let Some(gusts) = &grass.gusts {
        let texels = (gusts.size as usize).pow(2);
        let map = gusts.mean.iter().chain(gusts.added.as_flattened()).all(|v| v.is_finite());
        let moves = gusts.turn.iter().chain([&gusts.drift]).all(|v| v.is_finite());
        if texels == 0 || gusts.added.len() != texels || !map || !moves {
            let found = format!("{} texels for {} a side", gusts.added.len(), gusts.size);
            return wrong("gusts", found, "a square map of finite numbers");
        }
    }
    let most = gpu.max_side();
    for (sheet, cells) in [(Some(&grass.upright), 2 * grass.count), (grass.level.as_ref(), 1)] {
        let Some(sheet) = sheet else { continue };
        let pitch = [0, 1].map(|k| sheet.cell[k] + 2 * sheet.border);
        let columns = sheet.columns.min(cells).max(1);
        let fine = [columns * pitch[0], cells.div_ceil(columns) * pitch[1]];
        let halves = |(k, level): (usize, &GrassLevel)| {
            let texels = level.width as usize * level.height as usize;
            [level.width, level.height] == fine.map(|n| n >> k) && level.planes.iter().all(|p| p.len() == texels)
        };
        if sheet.levels.is_empty() || !sheet.levels.iter().enumerate().all(halves) || fine.iter().any(|n| *n > most) {
            let found = sheet.levels.first().map_or("none".into(), |l| format!("{} x {} texels", l.width, l.height));
            let expected = format!("{} x {}, halved from level to level, at most {most} a side", fine[0], fine[1]);
            return wrong("sheet", found, &expected);
        }
        if !sheet.levels.iter().flat_map(|l| l.planes.iter().flatten().flatten()).all(|v| v.is_finite()) {
            return wrong("sheet", "a number that is not finite".into(), "finite numbers");
        }
    }
    Ok(())
}
