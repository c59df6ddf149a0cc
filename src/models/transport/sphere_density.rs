//! A density over directions, as a table over zenith and azimuth. Light from a sky or an environment map is sampled by
//! it.
//!
//! The table has values at the centres of W × H texels, as a panorama has them ([`panorama`]). A cell lies between the
//! centres of four texels. There the density is bilinear, times the mean sine of the zenith angle in the cell's row. It
//! wraps around in azimuth and is constant beyond the outermost rows. Sampling is exact: a cell is drawn by its share,
//! and a point in the cell by the bilinear function (Pharr, Jakob & Humphreys 2023, §2.4.2 and §A.4).

use glam::DVec3;
use mesophyll_sky::panorama;
use std::f64::consts::PI;

/// A table over directions that can be sampled.
#[derive(Debug, Clone, PartialEq)]
pub struct SphereDensity {
    /// By how much the table is turned from +x towards +y (whole turns).
    pub turn: f64,
    columns: usize,
    rows: usize,
    /// Values at texel centres, row by row.
    values: Vec<f32>,
    /// Mean sine of the zenith angle in each row of cells. There is one more row of cells than of texels.
    sine: Vec<f64>,
    /// Cumulative shares of the rows of cells, from 0 to 1.
    row_sums: Vec<f64>,
    /// Cumulative shares within each row of cells, from 0 to 1.
    column_sums: Vec<f64>,
    /// Integral of the bilinear function, times the sines, over the unit square.
    total: f64,
}

/// The cell of a map of W columns and H rows that contains a direction, and the place in it.
#[derive(Debug, Clone, Copy)]
pub struct DirectionCell {
    /// The columns of texels left and right of the point.
    pub columns: [usize; 2],
    /// The rows of texels above and below the point.
    pub rows: [usize; 2],
    /// The place of the point in the cell, from 0 to 1, to the right and down.
    pub at: [f64; 2],
}

impl DirectionCell {
    /// The cell that contains a unit direction, in a map that is turned by so many whole turns.
    pub fn of(d: DVec3, columns: usize, rows: usize, turn: f64) -> DirectionCell {
        let [u, v] = panorama::place(d.to_array());
        let (x, y) = ((u + turn) * columns as f64 - 0.5, v * rows as f64 - 0.5);
        let (i, j) = (x.floor(), y.floor());
        let wrap = |i: f64| (i as isize).rem_euclid(columns as isize) as usize;
        let clamp = |j: f64| (j.max(0.0) as usize).min(rows - 1);
        DirectionCell { columns: [wrap(i), wrap(i + 1.0)], rows: [clamp(j), clamp(j + 1.0)], at: [x - i, y - j] }
    }

    /// Bilinear interpolation of the values of `texel(column, row)`.
    pub fn mix(&self, texel: impl Fn(usize, usize) -> f64) -> f64 {
        let [x, y] = self.at;
        let along = |row: usize| texel(self.columns[0], row) * (1.0 - x) + texel(self.columns[1], row) * x;
        along(self.rows[0]) * (1.0 - y) + along(self.rows[1]) * y
    }
}

impl SphereDensity {
    /// The density that is proportional to `values` (finite, at least 0; `columns · rows` of them); `None` where all
    /// are zero.
    pub fn new(columns: usize, rows: usize, values: Vec<f32>) -> Option<SphereDensity> {
        let edge = |r: usize| ((r as f64 - 0.5) / rows as f64).clamp(0.0, 1.0);
        let mut sine = Vec::with_capacity(rows + 1);
        let mut row_sums = vec![0.0];
        let mut column_sums = Vec::with_capacity((rows + 1) * (columns + 1));
        for r in 0..=rows {
            let (top, bottom) = (edge(r), edge(r + 1));
            let height = bottom - top;
            sine.push(((PI * top).cos() - (PI * bottom).cos()) / (PI * height));
            let [above, below] = [r.saturating_sub(1), r.min(rows - 1)];
            let first = column_sums.len();
            let mut sum = 0.0;
            column_sums.push(0.0);
            for i in 0..columns {
                let next = (i + 1) % columns;
                let corners = [(i, above), (next, above), (i, below), (next, below)];
                sum += corners.iter().map(|(i, j)| f64::from(values[j * columns + i])).sum::<f64>() / 4.0;
                column_sums.push(sum);
            }
            if sum > 0.0 {
                column_sums[first..].iter_mut().for_each(|s| *s /= sum);
            }
            row_sums.push(row_sums[r] + sum / columns as f64 * height * sine[r]);
        }
        let total = row_sums[rows + 1];
        row_sums.iter_mut().for_each(|s| *s /= total);
        let usable = total.is_finite() && total > 0.0;
        usable.then_some(SphereDensity { turn: 0.0, columns, rows, values, sine, row_sums, column_sums, total })
    }

    /// The same with every value at least `least`.
    pub fn raised(&self, least: f32) -> Option<SphereDensity> {
        SphereDensity::new(self.columns, self.rows, self.values.iter().map(|v| v.max(least)).collect())
    }

    /// Number of bytes of a table with this size.
    pub fn bytes(columns: usize, rows: usize) -> u64 {
        (4 * columns * rows + 8 * (columns + 1) * (rows + 1)) as u64
    }

    /// Probability density (1/sr) of a unit direction.
    pub fn of(&self, d: DVec3) -> f64 {
        let cell = DirectionCell::of(d, self.columns, self.rows, self.turn);
        let [_, zenith] = panorama::place(d.to_array());
        let row = ((zenith * self.rows as f64 + 0.5) as usize).min(self.rows);
        let value = cell.mix(|i, j| f64::from(self.values[j * self.columns + i]));
        let sin = (PI * zenith).sin();
        if sin > 0.0 { value * self.sine[row] / (self.total * 2.0 * PI * PI * sin) } else { 0.0 }
    }

    /// A direction for two uniform numbers; its density is [`SphereDensity::of`].
    pub fn draw(&self, [u, v]: [f64; 2]) -> DVec3 {
        let (r, v) = pick(&self.row_sums, v);
        let width = self.columns + 1;
        let (i, u) = pick(&self.column_sums[r * width..(r + 1) * width], u);
        let [above, below] = [r.saturating_sub(1), r.min(self.rows - 1)];
        let value = |i: usize, j: usize| f64::from(self.values[j * self.columns + i % self.columns]);
        let [a, b, c, d] = [value(i, above), value(i + 1, above), value(i, below), value(i + 1, below)];
        let y = linear(v, a + b, c + d);
        let x = linear(u, a + (c - a) * y, b + (d - b) * y);
        let edge = |r: f64| ((r - 0.5) / self.rows as f64).clamp(0.0, 1.0);
        let (top, bottom) = (edge(r as f64), edge(r as f64 + 1.0));
        let place = [(i as f64 + 0.5 + x) / self.columns as f64 - self.turn, top + (bottom - top) * y];
        DVec3::from(panorama::direction(place))
    }
}

/// The interval of ascending sums that contains `u`, and the place of `u` in it.
fn pick(sums: &[f64], u: f64) -> (usize, f64) {
    let k = sums[1..].partition_point(|s| *s <= u).min(sums.len() - 2);
    let share = sums[k + 1] - sums[k];
    (k, if share > 0.0 { ((u - sums[k]) / share).clamp(0.0, 1.0 - f64::EPSILON) } else { 0.5 })
}

/// A point of [0, 1) whose density rises linearly from `a` to `b`.
fn linear(u: f64, a: f64, b: f64) -> f64 {
    let sum = a + (a * a + (b * b - a * a) * u).max(0.0).sqrt();
    if sum > 0.0 { (u * (a + b) / sum).clamp(0.0, 1.0 - f64::EPSILON) } else { u }
}
