//! Bilinear look-up in a map. Texel centres are at (i + ½)/W, clamped at the edges. u is to the right, v downwards, and
//! row 0 on top.

/// Four texels and their weights, which sum to 1.
#[derive(Debug, Clone, Copy)]
pub struct TexelTaps {
    at: [usize; 4],
    weight: [f64; 4],
}

impl TexelTaps {
    /// The texels around (u, v) of a `width`×`height` map. With `mirrored`, column `width−1−i` is read instead of i, as
    /// the back's maps need it.
    pub fn new(u: f64, v: f64, width: usize, height: usize, mirrored: bool) -> TexelTaps {
        let (i, j, fx) = axis(u, width);
        let (row, below, fy) = axis(v, height);
        let (i, j) = if mirrored { (width - 1 - i, width - 1 - j) } else { (i, j) };
        TexelTaps {
            at: [row * width + i, row * width + j, below * width + i, below * width + j],
            weight: [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy],
        }
    }

    /// The interpolated value of one channel.
    pub fn scalar(&self, map: &[f32]) -> f64 {
        let mut sum = 0.0;
        for k in 0..4 {
            sum += self.weight[k] * f64::from(map[self.at[k]]);
        }
        sum
    }

    /// The interpolated values of three channels.
    pub fn colour(&self, maps: &[Vec<f32>; 3]) -> [f64; 3] {
        [self.scalar(&maps[0]), self.scalar(&maps[1]), self.scalar(&maps[2])]
    }

    /// The interpolated vector of a map of vectors, not normalised.
    pub fn vector(&self, map: &[[f32; 3]]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for k in 0..4 {
            for (s, &x) in sum.iter_mut().zip(&map[self.at[k]]) {
                *s += self.weight[k] * f64::from(x);
            }
        }
        sum
    }

    /// The total weight of those of the four texels that are on.
    pub fn coverage(&self, mask: &[u8]) -> f64 {
        (0..4).filter(|&k| mask[self.at[k]] != 0).map(|k| self.weight[k]).sum()
    }
}

/// The two texels along one axis, and the place of the point between them.
fn axis(u: f64, size: usize) -> (usize, usize, f64) {
    let x = (u * size as f64 - 0.5).clamp(0.0, (size - 1) as f64);
    let i = (x as usize).min(size - 1);
    (i, (i + 1).min(size - 1), x - i as f64)
}

/// The texels that points from `low` to `high` read along one axis.
pub fn texels(low: f64, high: f64, size: usize) -> std::ops::RangeInclusive<usize> {
    axis(low, size).0..=axis(high, size).1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every texel that counts at a point between the two lies in the range, and the range is at most one texel larger.
    #[test]
    fn texels_between_two_places() {
        for (low, high) in [(0.0, 1.0), (0.3, 0.31), (0.124, 0.126), (-2.0, 0.1), (0.9, 3.0)] {
            let range = texels(low, high, 8);
            for k in 0..=1000 {
                let (i, j, _) = axis(low + (high - low) * f64::from(k) / 1000.0, 8);
                assert!(range.contains(&i) && range.contains(&j), "{low} {high} {i} {j} {range:?}");
            }
        }
        assert_eq!(texels(0.3, 0.31, 8), 1..=2);
    }

    #[test]
    fn centres_edges_and_between() {
        let map = [0.0, 1.0, 2.0, 3.0, 10.0, 11.0, 12.0, 13.0];
        let look = |u: f64, v: f64| TexelTaps::new(u, v, 4, 2, false).scalar(&map);
        for i in 0..4 {
            let u = (i as f64 + 0.5) / 4.0;
            assert!((look(u, 0.25) - i as f64).abs() < 1e-12);
            assert!((look(u, 0.5) - (i as f64 + 5.0)).abs() < 1e-12);
            // The back is the mirror image.
            let mirrored = TexelTaps::new(u, 0.25, 4, 2, true).scalar(&map);
            assert!((mirrored - (3 - i) as f64).abs() < 1e-12);
            assert!((TexelTaps::new(1.0 - u, 0.25, 4, 2, false).scalar(&map) - mirrored).abs() < 1e-12);
        }
        assert_eq!(look(-3.0, 0.0), 0.0);
        assert_eq!(look(7.0, 9.0), 13.0);
        assert!((look(0.5, 0.25) - 1.5).abs() < 1e-12);
        assert_eq!(TexelTaps::new(0.5, 0.5, 1, 1, true).scalar(&[4.0]), 4.0);
    }
}
