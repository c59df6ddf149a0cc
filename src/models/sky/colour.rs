//! XYZ to linear sRGB (IEC 61966-2-1 primaries, D65), linear and unclamped, so that it commutes with every projection
//! and fit.

/// Rows R, G, B.
pub(crate) const RGB_FROM_XYZ: [[f64; 3]; 3] =
    [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]];

/// Linear sRGB of an XYZ colour, in its unit.
#[inline]
pub fn rgb_from_xyz(xyz: [f64; 3]) -> [f64; 3] {
    RGB_FROM_XYZ.map(|row| row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2])
}

/// XYZ of a linear sRGB colour: the exact inverse of [`RGB_FROM_XYZ`] (Cramer's rule), not a second rounded matrix.
pub fn xyz_from_rgb(rgb: [f64; 3]) -> [f64; 3] {
    let m = RGB_FROM_XYZ;
    let minor = |r: usize, c: usize| {
        let (a, b, d, e) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[a][d] * m[b][e] - m[a][e] * m[b][d]
    };
    let determinant: f64 = (0..3).map(|c| m[0][c] * minor(0, c)).sum();
    std::array::from_fn(|c| (0..3).map(|r| minor(r, c) * rgb[r]).sum::<f64>() / determinant)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_and_back() {
        for xyz in [[1.0, 0.0, 0.0], [0.2, 3.0, 0.7], [0.9505, 1.0, 1.089]] {
            let back = xyz_from_rgb(rgb_from_xyz(xyz));
            assert!(xyz.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-14), "{xyz:?} {back:?}");
        }
    }

    /// D65 white of the standard (x = .3127, y = .3290) is grey.
    #[test]
    fn white_is_white() {
        let (x, y) = (0.3127, 0.3290);
        let rgb = rgb_from_xyz([x / y, 1.0, (1.0 - x - y) / y]);
        assert!(rgb.iter().all(|c| (c - 1.0).abs() < 5e-4), "{rgb:?}");
    }
}
