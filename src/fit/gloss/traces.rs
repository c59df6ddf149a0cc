//! The basis traces of one texel: D, S and their derivatives, one column each, padded to whole vectors with zeros.

use crate::fit::gloss::{normal_of, normal_slopes};
use crate::optics::tube::{Model, Travel};

/// Columns in the order the projection counts them.
pub const D: usize = 0;
pub const S: usize = 1;
pub const S_M: usize = 2;
pub const D_B: usize = 3;
pub const S_B: usize = 4;
pub const D_Y: usize = 5;
pub const S_Y: usize = 6;
pub const COLUMNS: usize = 7;

/// One column a basis trace, over all samples of both passes.
#[derive(Debug, Clone, Default)]
pub struct Basis {
    pub columns: [Vec<f64>; COLUMNS],
}

impl Basis {
    pub fn resize(&mut self, samples: usize) {
        for c in &mut self.columns {
            c.resize(samples, 0.0);
        }
    }

    /// Fills the rows from `offset` on with one pass.
    #[allow(clippy::too_many_arguments)]
    pub fn fill(&mut self, model: &Model, travel: Travel, positions: &[f64], texel: [f64; 2], m: f64, tilt: [f64; 2], offset: usize) {
        let (n, [nb, ny]) = (normal_of(tilt), normal_slopes(tilt));
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        for (k, &light) in positions.iter().enumerate() {
            let r = model.response(travel, light, texel, n, m);
            let row = [r.d, r.s, r.s_m, dot(r.d_n, nb), dot(r.s_n, nb), dot(r.d_n, ny), dot(r.s_n, ny)];
            for (column, value) in self.columns.iter_mut().zip(row) {
                column[offset + k] = value;
            }
        }
    }
}
