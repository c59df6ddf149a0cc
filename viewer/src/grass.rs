//! Grass as slices (Habel 2009, ch. 2): what the pass `passes/grass.rs` draws, as plain numbers. Lengths in mm, z up.

use crate::error::{Error, Result};
use crate::gpu::Gpu;
use glam::{DVec2, Vec2, Vec3};
use std::sync::Arc;

/// Tables are known at so many steps, of a height from 0 to the carrier's, or of |Ω_z| from 0 to 1.
pub const GRASS_STEPS: usize = 16;
/// A value at each step and at both ends.
pub type GrassTable = [f32; GRASS_STEPS + 1];
/// No ray crosses more slices than this.
pub const MOST_SLICES: u32 = 256;

/// A lawn: a level box over the ground, filled with a rectangle of slices that repeats.
#[derive(Debug, Clone, PartialEq)]
pub struct Grass {
    /// What it is called in what is printed.
    pub name: String,
    /// The middle of a rectangle, on the ground, in the world.
    pub origin: Vec3,
    /// The box from the origin, along x and y.
    pub low: Vec2,
    /// See `low`.
    pub high: Vec2,
    /// Of the box over the ground.
    pub height: f32,
    /// The rectangle that repeats.
    pub period: [f32; 2],
    /// Slices across x in a rectangle, and as many across y.
    pub count: u32,
    /// A ray crosses at most so many slices, 1 to [`MOST_SLICES`]; what it gathered stands for the rest.
    pub steps: u32,
    /// What opacities are weighted with (`fit grass` explains it): of the area of blades, the share that a direction
    /// sees, by |Ω_z|.
    pub projection: GrassTable,
    /// The same that the slices themselves show, along the ground and from above.
    pub shown: [f32; 2],
    /// Mean opacity of upright slices by height.
    pub cover: GrassTable,
    /// Mean opacity of the level slice.
    pub level_cover: f32,
    /// First slices across x, then those across y.
    pub upright: GrassSheet,
    /// The level slice at half the height; `None` leaves its code and its texture out.
    pub level: Option<GrassSheet>,
    /// Reflectance of the ground.
    pub soil: [f32; 3],
    /// Mean share of the light that a blade scatters, to both sides.
    pub scatter: [f32; 3],
    /// Share of the light that arrives at a height (first index) past the blades above, by |Ω_z| (second).
    pub through: [GrassTable; GRASS_STEPS + 1],
    /// Share of an even sky's light that arrives at blades, by height.
    pub open: GrassTable,
    /// Share of an even sky's light that arrives at the ground.
    pub soil_open: f32,
    /// How the wind leans the blades; `None` leaves its code and its map out.
    pub gusts: Option<Arc<GrassGusts>>,
    /// Every slice is drawn as polygons that are sorted and blended, back to front, instead of following a ray through
    /// all of them: what slices are compared with. No wind leans these.
    pub billboards: bool,
}

/// A map of gusts that repeats and moves with the wind: how far blades lean along x and y, the way of a point over its
/// height. A blade's point at the height z is z times its lean from where it would be without wind.
#[derive(Debug, Clone, PartialEq)]
pub struct GrassGusts {
    /// Without gusts.
    pub mean: [f32; 2],
    /// Texels a side of the map.
    pub size: u32,
    /// What gusts add, row by row, texel centres at (i + ½)/size, sampled linearly and repeated.
    pub added: Vec<[f32; 2]>,
    /// Sides of the map for each mm along x and along y.
    pub turn: [DVec2; 2],
    /// Sides of the map a second.
    pub drift: DVec2,
}

impl GrassGusts {
    /// Where a place of the world (x, y) is in the map at a time (s): 0 to 1 along both sides.
    pub fn place(&self, at: DVec2, time: f64) -> DVec2 {
        let sides = self.turn[0] * at.x + self.turn[1] * at.y + self.drift * time;
        sides - sides.floor()
    }
}

/// Pictures of slices side by side, each with a border, and coarser levels of them.
#[derive(Debug, Clone, PartialEq)]
pub struct GrassSheet {
    /// Texels of a picture along and up, without its border.
    pub cell: [u32; 2],
    /// Texels of the border on each side.
    pub border: u32,
    /// Pictures a line.
    pub columns: u32,
    /// The finest first, each half as wide and high as the one before.
    pub levels: Vec<GrassLevel>,
}

/// A level of a sheet, row-major, row 0 on top. All numbers but the opacity are multiplied by the opacity.
#[derive(Debug, Clone, PartialEq)]
pub struct GrassLevel {
    /// Texels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Normal and opacity; reflectance of the side that looks along +x, +y or up, and how far along it in its slab the
    /// blade is (0 to 1); reflectance of the other side, and the same again; transmittance, and nothing.
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
