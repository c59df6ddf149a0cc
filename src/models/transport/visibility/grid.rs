//! Sorts things into the cells of a rectangle.

use glam::DVec2;
use std::ops::{Range, RangeInclusive};

/// Cells of a rectangle.
#[derive(Debug, Default)]
pub(super) struct Grid {
    low: DVec2,
    high: DVec2,
    /// Number of cells for each mm.
    scale: DVec2,
    size: [usize; 2],
    /// The beginning of each cell's things, and the end of the list.
    start: Vec<u32>,
}

/// The largest mean number of cells for a thing. If things are larger, cells are made larger.
const COPIES: usize = 24;

impl Grid {
    /// Sorts `count` things into about `cells` cells. `rectangle(k)` is the area of the k-th thing, or `None` if it is
    /// nowhere. `thing(k)` is stored for it, cell by cell, in `into`.
    pub fn sort<T: Clone + Default>(
        &mut self,
        count: usize,
        cells: usize,
        rectangle: impl Fn(usize) -> Option<[DVec2; 2]>,
        into: &mut Vec<T>,
        thing: impl Fn(usize) -> T,
    ) {
        (self.low, self.high) = (0..count)
            .filter_map(&rectangle)
            .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), [a, b]| (low.min(a), high.max(b)));
        let mut cells = cells.max(1);
        let mut total = self.count(count, cells, &rectangle);
        while total > COPIES * count && cells > 1 {
            cells /= 4;
            total = self.count(count, cells, &rectangle);
        }
        into.clear();
        into.resize(total, T::default());
        for k in 0..count {
            let Some([low, high]) = rectangle(k) else { continue };
            let thing = thing(k);
            for cell in self.numbers(low, high) {
                // Cells are filled from their ends. What was the end of a cell becomes its beginning.
                self.start[cell] -= 1;
                into[self.start[cell] as usize] = thing.clone();
            }
        }
    }

    /// Chooses the cells, and sums up the number of things in each cell and all cells before it.
    fn count(&mut self, count: usize, cells: usize, rectangle: &impl Fn(usize) -> Option<[DVec2; 2]>) -> usize {
        let size = (self.high - self.low).max(DVec2::splat(1e-9));
        let side = (size.x * size.y / cells.max(1) as f64).sqrt();
        self.size = [0, 1].map(|q| ((size[q] / side).ceil() as usize).clamp(1, cells.max(1)));
        self.scale = DVec2::new(self.size[0] as f64, self.size[1] as f64) / size;
        self.start.clear();
        self.start.resize(self.size[0] * self.size[1] + 1, 0);
        for [low, high] in (0..count).filter_map(rectangle) {
            self.numbers(low, high).for_each(|cell| self.start[cell] += 1);
        }
        let mut sum = 0;
        for start in &mut self.start {
            sum += *start;
            *start = sum;
        }
        sum as usize
    }

    /// The things in the cell at a place; `None` outside the rectangle.
    pub fn cell(&self, p: DVec2) -> Option<Range<usize>> {
        let inside = p.cmpge(self.low).all() && p.cmple(self.high).all();
        inside.then(|| self.things(self.place(p)))
    }

    /// The columns and rows of the cells that a rectangle touches. One that is outside gets those at the rim.
    pub fn cells(&self, low: DVec2, high: DVec2) -> [RangeInclusive<usize>; 2] {
        let ([i0, j0], [i1, j1]) = (self.place(low), self.place(high));
        [i0..=i1, j0..=j1]
    }

    /// The things of a cell.
    pub fn things(&self, [i, j]: [usize; 2]) -> Range<usize> {
        self.range(j * self.size[0] + i)
    }

    fn range(&self, cell: usize) -> Range<usize> {
        self.start[cell] as usize..self.start[cell + 1] as usize
    }

    /// Column and row of a place.
    pub fn place(&self, p: DVec2) -> [usize; 2] {
        let at = (p - self.low) * self.scale;
        // Negative numbers become 0.
        [0, 1].map(|q| (at[q] as usize).min(self.size[q] - 1))
    }

    fn numbers(&self, low: DVec2, high: DVec2) -> impl Iterator<Item = usize> + use<> {
        let ([columns, rows], width) = (self.cells(low, high), self.size[0]);
        rows.flat_map(move |j| columns.clone().map(move |i| j * width + i))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every thing is found at every place that it covers.
    #[test]
    fn things_are_in_the_cells_that_they_cover() {
        let corner = |k: usize| DVec2::new((k * 37 % 101) as f64, (k * 53 % 89) as f64);
        let rectangle =
            |k: usize| (!k.is_multiple_of(5)).then(|| [corner(k), corner(k) + DVec2::new(1.0, (k % 40) as f64)]);
        let (mut grid, mut things) = (Grid::default(), Vec::new());
        grid.sort(300, 150, rectangle, &mut things, |k| k);
        for k in 0..300 {
            let Some([low, high]) = rectangle(k) else { continue };
            for at in [low, high, 0.5 * (low + high)] {
                assert!(things[grid.cell(at).unwrap()].contains(&k), "{k} at {at}");
            }
        }
        assert!(grid.cell(DVec2::new(-1.0, 3.0)).is_none());
    }

    #[test]
    fn large_things_get_large_cells_and_none_are_none() {
        let (mut grid, mut things) = (Grid::default(), Vec::new());
        grid.sort(1000, 1000, |_| Some([DVec2::ZERO, DVec2::ONE]), &mut things, |k| k);
        assert!(things.len() <= COPIES * 1000);
        grid.sort(0, 0, |_| None, &mut things, |k| k);
        assert!(grid.cell(DVec2::ZERO).is_none());
        // All things are at one point.
        grid.sort(9, 9, |_| Some([DVec2::ONE; 2]), &mut things, |k| k);
        assert!(!things[grid.cell(DVec2::ONE).unwrap()].is_empty());
    }
}
