//! Panoramas of everything around: which direction a place in the picture shows, and the reverse. Everything that reads
//! or writes a panorama goes through here.
//!
//! A panorama is seen from inside, with the zenith in its top row. Its middle column looks to +x, and the columns to
//! the right of it towards −y, as for a camera that turns to its right: azimuth 2π(½ − u), zenith angle πv. Places are
//! u from the left to the right edge and v from the top to the bottom, 0 to 1. The centre of the texel in column i of
//! W and row j of H is at u = (i + ½)/W, v = (j + ½)/H.

use std::f64::consts::{PI, TAU};

/// Unit vector towards the place (u, v). Places beyond the left and the right edge wrap around.
pub fn direction([u, v]: [f64; 2]) -> [f64; 3] {
    let ((sin, cos), (north, east)) = ((PI * v).sin_cos(), (TAU * (0.5 - u)).sin_cos());
    [sin * east, sin * north, cos]
}

/// The place of a direction of any length above 0: u at least 0 and below 1, v from 0 to 1. At the zenith and the nadir
/// u is ½.
pub fn place([x, y, z]: [f64; 3]) -> [f64; 2] {
    // The arc tangent is more accurate near the zenith than an arc cosine.
    let (azimuth, zenith) = (y.atan2(x), x.hypot(y).atan2(z));
    let u = 0.5 - azimuth / TAU;
    [if u < 1.0 { u } else { 0.0 }, zenith / PI]
}

/// Unit vectors towards the centres of a picture's texels, row by row.
pub fn centres(columns: usize, rows: usize) -> impl Iterator<Item = [f64; 3]> {
    let at = move |k: usize| [(k % columns) as f64 + 0.5, (k / columns) as f64 + 0.5];
    (0..columns * rows).map(move |k| {
        let [i, j] = at(k);
        direction([i / columns as f64, j / rows as f64])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The convention in words, at places that tell every mirror image and every turn apart.
    #[test]
    fn places_show_what_the_convention_says() {
        let half = 0.5f64.sqrt();
        for (at, d) in [
            ([0.5, 0.5], [1.0, 0.0, 0.0]),
            ([0.75, 0.5], [0.0, -1.0, 0.0]),
            ([0.25, 0.5], [0.0, 1.0, 0.0]),
            ([0.0, 0.5], [-1.0, 0.0, 0.0]),
            ([0.5, 0.0], [0.0, 0.0, 1.0]),
            ([0.5, 1.0], [0.0, 0.0, -1.0]),
            ([0.625, 0.5], [half, -half, 0.0]),
            ([0.5, 0.25], [half, 0.0, half]),
        ] {
            let (seen, back) = (direction(at), place(d));
            assert!((0..3).all(|k| (seen[k] - d[k]).abs() < 1e-15), "{at:?}: {seen:?} {d:?}");
            assert!((0..2).all(|k| (back[k] - at[k]).abs() < 1e-15), "{d:?}: {back:?} {at:?}");
        }
    }

    #[test]
    fn a_place_and_its_direction_belong_together() {
        for k in 0..1000 {
            let at = [f64::from(k % 37) / 37.0, (f64::from(k / 37) + 0.5) / 28.0];
            let back = place(direction(at));
            assert!((0..2).all(|c| (back[c] - at[c]).abs() < 1e-13), "{at:?} {back:?}");
        }
        assert_eq!(place([-1.0, 0.0, 0.0]), [0.0, 0.5]);
        assert_eq!(place([-1.0, -0.0, 0.0]), [0.0, 0.5]);
        assert_eq!(centres(4, 2).nth(5), Some(direction([0.375, 0.75])));
    }
}
