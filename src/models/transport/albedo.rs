//! The directional albedo a(N·v, m) of a lobe as a table. It has exact values (see [`Lobe::directional_albedo`]) on a
//! grid, and interpolates them by cubics.
//!
//! The grid is uniform in ln m and in y = μ(1+m)/(μ+m). This y widens the range of grazing views whose cosine is about
//! m or less, where a changes fastest. The grid is refined until the error between its points is small; `error` keeps
//! the error that was found.

use super::lobe::{COS_VIEW_FLOOR, Lobe, M_FLOOR, ReflectionLobe};
use rayon::prelude::*;

/// a(N·v, m) for one lobe over a range of slopes.
#[derive(Debug, Clone)]
pub struct AlbedoTable {
    rows: usize,
    columns: usize,
    ln_m: [f64; 2],
    values: Vec<f64>,
    /// The largest absolute error that was found halfway between grid points.
    pub error: f64,
}

impl AlbedoTable {
    /// A table for slopes within `m_range` (at least 1e-3). It is refined until the error between its points is below
    /// `tolerance` or the grid has 257 views. [`AlbedoTable::error`] tells which error was reached.
    pub fn new(lobe: Lobe, m_range: [f64; 2], tolerance: f64) -> AlbedoTable {
        let ln_m = m_range.map(|m| m.max(M_FLOOR).ln());
        let narrow = ln_m[1] - ln_m[0] < 1e-9;
        let mut columns = 33;
        loop {
            let rows = if narrow {
                1
            } else {
                (((ln_m[1] - ln_m[0]) * columns as f64 / 8.0).ceil() as usize).clamp(5, columns)
            };
            let mut table = AlbedoTable { rows, columns, ln_m, values: Vec::new(), error: 0.0 };
            let exact =
                |t: &AlbedoTable, row: f64, column: f64| lobe.directional_albedo(t.cos_of(row, column), t.m_of(row));
            table.values = (0..rows * columns)
                .into_par_iter()
                .map(|k| exact(&table, (k / columns) as f64, (k % columns) as f64))
                .collect();
            let rows_probed: Vec<f64> = if rows == 1 {
                vec![0.0]
            } else {
                (0..rows - 1).step_by((rows / 8).max(1)).map(|j| j as f64 + 0.5).collect()
            };
            table.error = (0..columns - 1)
                .into_par_iter()
                .step_by(columns / 32)
                .flat_map_iter(|i| rows_probed.iter().map(move |&row| (row, i as f64 + 0.5)))
                .map(|(row, column)| {
                    (table.at(table.cos_of(row, column), table.m_of(row)) - exact(&table, row, column)).abs()
                })
                .reduce(|| 0.0, f64::max);
            if table.error <= tolerance || columns >= 257 {
                return table;
            }
            columns = 2 * columns - 1;
        }
    }

    fn m_of(&self, row: f64) -> f64 {
        let share = if self.rows == 1 { 0.0 } else { row / (self.rows - 1) as f64 };
        (self.ln_m[0] + share * (self.ln_m[1] - self.ln_m[0])).exp()
    }

    fn cos_of(&self, row: f64, column: f64) -> f64 {
        let m = self.m_of(row);
        let lowest = stretch(COS_VIEW_FLOOR, m);
        let y = lowest + (1.0 - lowest) * column / (self.columns - 1) as f64;
        y * m / (1.0 + m - y)
    }

    /// a(N·v, m), with both arguments clamped to the table.
    pub fn at(&self, cos_view: f64, m: f64) -> f64 {
        let ln_m = m.max(M_FLOOR).ln().clamp(self.ln_m[0], self.ln_m[1]);
        let m = ln_m.exp();
        let mu = cos_view.clamp(COS_VIEW_FLOOR, 1.0);
        let lowest = stretch(COS_VIEW_FLOOR, m);
        let column = (stretch(mu, m) - lowest) / (1.0 - lowest) * (self.columns - 1) as f64;
        let (i, wi) = cubic(column, self.columns);
        let along = |row: usize| -> f64 { (0..4).map(|k| wi[k] * self.values[row * self.columns + i + k]).sum() };
        if self.rows == 1 {
            return along(0);
        }
        let row = (ln_m - self.ln_m[0]) / (self.ln_m[1] - self.ln_m[0]) * (self.rows - 1) as f64;
        let (j, wj) = cubic(row, self.rows);
        (0..4).map(|k| wj[k] * along(j + k)).sum()
    }
}

fn stretch(mu: f64, m: f64) -> f64 {
    mu * (1.0 + m) / (mu + m)
}

/// The first of four neighbouring points, and their Lagrange weights at `x`. Near an end, the four are the outermost
/// ones.
fn cubic(x: f64, count: usize) -> (usize, [f64; 4]) {
    let first = (x.floor() as isize - 1).clamp(0, count as isize - 4) as usize;
    let t = x - first as f64;
    let (a, b, c, d) = (t, t - 1.0, t - 2.0, t - 3.0);
    (first, [-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn the_table_meets_the_quadrature_at_random_points() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
        for (lobe, range) in
            [(Lobe::Beckmann, [0.03, 0.7]), (Lobe::Ggx, [0.1, 0.4]), (Lobe::CookTorrance { index: 1.45 }, [0.2, 0.2])]
        {
            let table = AlbedoTable::new(lobe, range, 2e-5);
            assert!(table.error <= 2e-5, "{lobe:?}: {} with {} × {}", table.error, table.rows, table.columns);
            for _ in 0..60 {
                let m = range[0] * (range[1] / range[0]).powf(rng.random::<f64>());
                let mu = rng.random::<f64>().powi(2).max(COS_VIEW_FLOOR);
                let (found, exact) = (table.at(mu, m), lobe.directional_albedo(mu, m));
                assert!((found - exact).abs() < 6e-5, "{lobe:?} {mu} {m}: {found} {exact}");
            }
        }
    }
}
