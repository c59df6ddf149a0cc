//! The direction of the light in a crown. Every piece of a branch shades the cells below it. Tips turn to where the
//! shade decreases fastest (shadow propagation; Palubicki et al., "Self-organizing tree models for image synthesis",
//! ACM Trans. Graph. 28 (2009), §4.2).

use glam::{DVec3, IVec3};
use std::collections::HashMap;

/// Shade that a piece of branch adds to its own cell, and the factor by which it decreases for each layer of cells
/// further down.
const SHADE: f64 = 1.0;
const FALL: f64 = 1.6;
/// Number of layers of cells below a piece that it shades.
const LAYERS: i32 = 6;
/// Weight of the upward direction relative to the gradient of the shade.
const SKY: f64 = 1.0;

/// Shade in a grid of cells.
#[derive(Debug, Clone)]
pub struct ShadeGrid {
    cell: f64,
    cells: HashMap<IVec3, f64>,
}

impl ShadeGrid {
    /// A grid without shade. `cell` is the width of a cell (mm).
    pub fn new(cell: f64) -> ShadeGrid {
        ShadeGrid { cell, cells: HashMap::new() }
    }

    fn index(&self, place: DVec3) -> IVec3 {
        (place / self.cell).floor().as_ivec3()
    }

    /// Adds the shade of a piece of branch at `place`.
    pub fn add(&mut self, place: DVec3) {
        let middle = self.index(place);
        for layer in 0..=LAYERS {
            let shade = SHADE * FALL.powi(-layer);
            for x in -layer..=layer {
                for y in -layer..=layer {
                    *self.cells.entry(middle + IVec3::new(x, y, -layer)).or_insert(0.0) += shade;
                }
            }
        }
    }

    /// The width of a cell (mm).
    pub fn cell(&self) -> f64 {
        self.cell
    }

    /// The unit direction towards more light: down the gradient of the shade, and up.
    pub fn direction(&self, place: DVec3) -> DVec3 {
        let middle = self.index(place);
        let shade = |offset: IVec3| self.cells.get(&(middle + offset)).copied().unwrap_or(0.0);
        let along = |axis: IVec3| shade(axis * 2) + shade(axis) - shade(-axis) - shade(axis * -2);
        let rise = DVec3::new(along(IVec3::X), along(IVec3::Y), along(IVec3::Z));
        (DVec3::Z * SKY - rise.normalize_or_zero()).try_normalize().unwrap_or(DVec3::Z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_away_from_what_shades() {
        let mut shade = ShadeGrid::new(10.0);
        assert_eq!(shade.direction(DVec3::ZERO), DVec3::Z);
        for k in 0..20 {
            shade.add(DVec3::new(40.0, f64::from(k) * 10.0 - 100.0, 30.0));
        }
        let seen = shade.direction(DVec3::new(5.0, 0.0, 0.0));
        assert!(seen.x < -0.2 && seen.z > 0.3, "{seen}");
    }
}
