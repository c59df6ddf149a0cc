//! Where the plants of a `[[plant]]` stand: at one place, spread over an area, or where a list says. Turns and scales
//! come from the seed.

use super::Result;
use super::placement::rotation;
use crate::manifest::{SceneManifest, StatedPlant};
use glam::{DMat4, DVec2, DVec3};
use mesophyll_files::numbers;
use mesophyll_files::unit::LengthUnit;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// Candidates for each place in an area, of which the one is taken that is farthest from all places before it.
const CANDIDATES: usize = 8;

/// A plant's place, before the rotation that all plants of its `[[plant]]` share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// From the position of the `[[plant]]` (mm).
    pub offset: DVec3,
    /// Turn about the vertical (rad).
    pub azimuth: f64,
    /// A factor on the scale of the `[[plant]]`.
    pub scale: f64,
}

impl Spot {
    /// The transform from plant to world.
    pub fn transform(&self, said: &StatedPlant) -> DMat4 {
        DMat4::from_translation(DVec3::from(said.position_mm) + self.offset)
            * DMat4::from_rotation_z(self.azimuth)
            * DMat4::from_quat(rotation(said.rotation_deg))
            * DMat4::from_scale(DVec3::splat(said.scale * self.scale))
    }
}

/// The places of a `[[plant]]`.
///
/// # Errors
/// [`super::Error::Input`] for a list that cannot be read.
pub fn spots(manifest: &SceneManifest, said: &StatedPlant) -> Result<Vec<Spot>> {
    let mut out = match (&said.positions, said.area_mm) {
        (Some(file), _) => {
            let unit = said.unit.unwrap_or(LengthUnit::Metre).mm();
            let mut rng = Pcg64::seed_from_u64(said.seed);
            let at =
                |p: [f64; 3]| Spot { offset: unit * DVec3::from(p), azimuth: TAU * rng.random::<f64>(), scale: 1.0 };
            numbers::read::<3>(&manifest.resolve(file), "x y z")?.into_iter().map(at).collect()
        }
        (None, Some([width, depth])) => spread(DVec2::new(width, depth), said.count, said.seed),
        (None, None) => vec![Spot { offset: DVec3::ZERO, azimuth: 0.0, scale: 1.0 }],
    };
    if let Some([low, high]) = said.scales {
        // Numbers of their own: with and without `scales`, plants stand at the same places.
        let mut rng = Pcg64::seed_from_u64(said.seed.wrapping_add(1 << 32));
        out.iter_mut().for_each(|spot| spot.scale = low + (high - low) * rng.random::<f64>());
    }
    Ok(out)
}

/// Places that are spread over an area, each with a turn. Random places keep a distance from those before them.
fn spread(area: DVec2, count: usize, seed: u64) -> Vec<Spot> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut found = Neighbours::new(area, count);
    let one = |_| {
        // Mitchell's best candidate of a few.
        let mut best = (DVec2::ZERO, -1.0);
        for _ in 0..CANDIDATES {
            let (x, y) = (rng.random::<f64>() - 0.5, rng.random::<f64>() - 0.5);
            let place = DVec2::new(area.x * x, area.y * y);
            let free = found.nearest(place);
            if free > best.1 {
                best = (place, free);
            }
        }
        found.add(best.0);
        Spot { offset: best.0.extend(0.0), azimuth: TAU * rng.random::<f64>(), scale: 1.0 }
    };
    (0..count).map(one).collect()
}

/// Points in cells of a grid around the origin, of which about one is in each.
pub struct Neighbours {
    low: DVec2,
    cell: DVec2,
    size: [i64; 2],
    cells: Vec<Vec<(u32, DVec2)>>,
    count: u32,
}

impl Neighbours {
    /// A grid for `count` points in an area around the origin.
    pub fn new(area: DVec2, count: usize) -> Neighbours {
        let side = (area.x * area.y / count.max(1) as f64).sqrt();
        let along = |length: f64| ((length / side).round() as i64).clamp(1, count.max(1) as i64);
        let size = [along(area.x), along(area.y)];
        let cells = vec![Vec::new(); (size[0] * size[1]) as usize];
        let cell = area / DVec2::new(size[0] as f64, size[1] as f64);
        Neighbours { low: -0.5 * area, cell, size, cells, count: 0 }
    }

    fn cell_of(&self, place: DVec2) -> [i64; 2] {
        let at = (place - self.low) / self.cell;
        [(at.x as i64).clamp(0, self.size[0] - 1), (at.y as i64).clamp(0, self.size[1] - 1)]
    }

    /// Adds a point, which gets the next number.
    pub fn add(&mut self, place: DVec2) {
        let [x, y] = self.cell_of(place);
        self.cells[(y * self.size[0] + x) as usize].push((self.count, place));
        self.count += 1;
    }

    /// The points in cells that are `ring` cells from that of a place, along x or along y.
    fn ring(&self, place: DVec2, ring: i64) -> impl Iterator<Item = &(u32, DVec2)> {
        let [x, y] = self.cell_of(place);
        let rows = (y - ring).max(0)..=(y + ring).min(self.size[1] - 1);
        rows.flat_map(move |row| {
            let whole = (row - y).abs() == ring;
            let step = if whole || ring == 0 { 1 } else { 2 * ring as usize };
            let columns = (x - ring..=x + ring).step_by(step).filter(|c| (0..self.size[0]).contains(c));
            columns.flat_map(move |column| &self.cells[(row * self.size[0] + column) as usize])
        })
    }

    /// The squared distance to the nearest point; infinite where there is none.
    fn nearest(&self, place: DVec2) -> f64 {
        let mut best = f64::INFINITY;
        if self.count == 0 {
            return best;
        }
        let narrow = self.cell.min_element();
        for ring in 0..=self.size[0].max(self.size[1]) {
            // Cells of this ring are as far as all rings between.
            if best <= (narrow * (ring - 1).max(0) as f64).powi(2) {
                break;
            }
            best = self.ring(place, ring).map(|(_, p)| p.distance_squared(place)).fold(best, f64::min);
        }
        best
    }

    /// The numbers of the points in the cell of a place and in those around it.
    pub fn around(&self, place: DVec2) -> impl Iterator<Item = u32> {
        (0..=1).flat_map(move |ring| self.ring(place, ring)).map(|(number, _)| *number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The grid finds what a search of all points finds.
    #[test]
    fn the_grid_finds_the_nearest_point() {
        for area in [DVec2::new(3e4, 3e4), DVec2::new(1e5, 300.0), DVec2::new(1.0, 5e6)] {
            let mut rng = Pcg64::seed_from_u64(7);
            let mut grid = Neighbours::new(area, 400);
            let mut all: Vec<DVec2> = Vec::new();
            for _ in 0..400 {
                let place = DVec2::new(rng.random::<f64>() - 0.5, rng.random::<f64>() - 0.5) * area;
                let plain = all.iter().map(|p| p.distance_squared(place)).fold(f64::INFINITY, f64::min);
                assert_eq!(grid.nearest(place), plain);
                grid.add(place);
                all.push(place);
            }
        }
    }
}
