//! The random numbers of a camera path: Owen-scrambled Sobol points (Burley 2020), four dimensions at a time.
//!
//! All paths of one randomisation of a pixel share a seed and take consecutive points of one sequence, so that together
//! they cover every dimension evenly. Different seeds give independent randomisations. Numbers beyond the sequence's
//! 256 dimensions, and bits below its 24, come from a hash.

use crate::seeds::mix;
use sobol_burley::{NUM_DIMENSION_SETS_4D, sample_4d};

/// The largest number of paths in one randomisation, which is the length of the sequence.
pub const MOST_PATHS: u32 = 1 << 16;

/// The numbers of one path.
#[derive(Debug, Clone)]
pub struct PathSampler {
    seed: u32,
    index: u32,
    /// Index of the next four dimensions.
    set: u32,
}

impl PathSampler {
    /// The numbers of path `index` (below [`MOST_PATHS`]) of the randomisation `seed`.
    pub fn new(seed: u32, index: u32) -> PathSampler {
        PathSampler { seed, index, set: 0 }
    }

    /// Skips four numbers that are not needed.
    pub fn skip(&mut self) {
        self.set += 1;
    }

    /// Four numbers in [0, 1).
    pub fn next(&mut self) -> [f64; 4] {
        let fine = mix(u64::from(self.seed) << 32 | u64::from(self.index), u64::from(self.set));
        let low = [0, 16, 32, 48].map(|shift| (fine >> shift & 0xffff) as f64 / 65_536.0);
        let set = self.set;
        self.set += 1;
        if set < NUM_DIMENSION_SETS_4D {
            let high = sample_4d(self.index, set, self.seed);
            [0, 1, 2, 3].map(|k| f64::from(high[k]) + low[k] / f64::from(1 << 24))
        } else {
            let more = mix(!fine, u64::from(set));
            [0, 16, 32, 48].map(|shift| ((more >> shift & 0xffff) as f64 + low[shift as usize / 16]) / 65_536.0)
        }
    }
}
