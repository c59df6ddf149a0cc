//! Compares pictures by the means of their blocks. What represents blades only on average is judged in this way.

use mesophyll_transport::{ReferencePicture, tone};

/// Mean radiance of blocks of `side` pixels a side, row by row; pixels beyond the last whole block are left out.
pub fn means(hdr: &[[f32; 4]], [width, height]: [usize; 2], side: usize) -> Vec<[f32; 4]> {
    let [columns, rows] = [width, height].map(|n| n / side);
    let one = |k: usize| {
        let mut sum = [0.0f64; 4];
        for i in 0..side * side {
            let pixel = hdr[((k / columns) * side + i / side) * width + (k % columns) * side + i % side];
            (0..4).for_each(|c| sum[c] += f64::from(pixel[c]));
        }
        sum.map(|s| (s / (side * side) as f64) as f32)
    };
    (0..columns * rows).map(one).collect()
}

/// A picture of these means, as it is displayed; every block is judged.
pub fn picture(hdr: &[[f32; 4]], size: [usize; 2], side: usize, exposure: f64) -> ReferencePicture {
    let [width, height] = size.map(|n| n / side);
    let hdr = means(hdr, size, side);
    let byte = |v: f32| (tone::display(f64::from(v), exposure) * 255.0 + 0.5) as u8;
    let ldr = hdr.iter().map(|p| [byte(p[0]), byte(p[1]), byte(p[2]), 255]).collect();
    let n = width * height;
    ReferencePicture { width, height, hdr, ldr, noise: vec![0.0; n], interior: vec![true; n], penumbra: vec![false; n] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_have_the_mean_of_their_pixels() {
        // 5 by 4 pixels whose radiance is their column, and a tenth of their row.
        let hdr: Vec<[f32; 4]> = (0..20).map(|k| [(k % 5) as f32, (k / 5) as f32 / 10.0, 1.0, 1.0]).collect();
        let found = means(&hdr, [5, 4], 2);
        let right = [[0.5, 0.05], [2.5, 0.05], [0.5, 0.25], [2.5, 0.25]];
        assert_eq!(found.len(), 4);
        assert!(found.iter().zip(right).all(|(f, r)| (f[0] - r[0]).abs() < 1e-6 && (f[1] - r[1]).abs() < 1e-6));
        let picture = picture(&hdr, [5, 4], 2, 1.0);
        // 2.5/3.5 in sRGB.
        assert!((picture.width, picture.height) == (2, 2) && picture.ldr[1][0].abs_diff(220) <= 1, "{:?}", picture.ldr);
    }

    /// Tests what the limits of data/grass/scenes are based on: grass green, and the same colour 46 % brighter.
    #[test]
    fn a_lawn_that_is_off_by_twice_its_stated_error_passes_no_limit_below_these() {
        let even = |times: f32| vec![[0.09 * times, 0.16 * times, 0.035 * times, 1.0]; 160 * 160];
        let of = |hdr: &[[f32; 4]]| picture(hdr, [160, 160], 20, 1.0);
        let (right, bright) = (of(&even(1.0)), of(&even(1.46)));
        let apart = mesophyll_transport::compare::compare(&right, &bright.ldr).unwrap();
        println!("FLIP {}, largest error {:?}", apart.flip_p99, apart.max_error);
        assert!((0.25..0.4).contains(&apart.flip_p99), "{}", apart.flip_p99);
        assert!(apart.max_error.is_some_and(|e| (0.05..0.09).contains(&e)), "{:?}", apart.max_error);
    }
}
