//! Noise of one picture, estimated from the picture itself where it is not stated. The Laplacian difference of Immerkær
//! (1996) cancels anything that is locally a plane in either direction; its median is taken so that veins and the
//! outline count little. Real fine texture is taken for noise, so the result is an upper bound.

use mesophyll_base::statistics::{NORMAL_MEDIAN, median};

/// The stencil 1 −2 1; −2 4 −2; 1 −2 1, whose sum of squares is 36.
const STENCIL: [f64; 9] = [1.0, -2.0, 1.0, -2.0, 4.0, -2.0, 1.0, -2.0, 1.0];
/// Smallest number of places for an estimate.
const FEWEST: usize = 64;

/// Standard deviation of white noise in `values` (row-major) over the texels of `mask` whose neighbours all lie on it
/// and are numbers, and the median of the values there. `None` with fewer than 64 such texels.
pub fn deviation(values: &[f64], mask: &[bool], width: usize) -> Option<(f64, f64)> {
    let height = values.len() / width.max(1);
    let (mut found, mut level) = (Vec::new(), Vec::new());
    for j in 1..height.saturating_sub(1) {
        for i in 1..width.saturating_sub(1) {
            let at = |k: usize| (j + k / 3 - 1) * width + i + k % 3 - 1;
            if (0..9).all(|k| mask[at(k)] && values[at(k)].is_finite()) {
                found.push((0..9).map(|k| STENCIL[k] * values[at(k)]).sum::<f64>().abs() / 6.0);
                level.push(values[at(4)]);
            }
        }
    }
    if found.len() < FEWEST {
        return None;
    }
    Some((median(&mut found)? / NORMAL_MEDIAN, median(&mut level)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_base::random::RandomStream;

    #[test]
    fn the_noise_is_found_on_a_slope() {
        let (w, h) = (100, 80);
        let values: Vec<f64> = (0..w * h / 2)
            .flat_map(|k| RandomStream::new(9, &[k as u64]).normal_pair())
            .enumerate()
            .map(|(k, n)| 0.4 + 0.01 * (k % w) as f64 - 0.003 * (k / w) as f64 + 0.02 * n)
            .collect();
        let (sd, _) = deviation(&values, &vec![true; w * h], w).unwrap();
        assert!((sd / 0.02 - 1.0).abs() < 0.05, "{sd}");
        assert!(deviation(&values, &vec![false; w * h], w).is_none());
    }
}
