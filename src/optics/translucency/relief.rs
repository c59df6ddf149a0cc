//! Relief: normals from heights.
//!
//! Heights in mm over one plane, outward; normals are unit vectors in the image frame: x right, y up (towards row 0), z outward.

/// Unit normals of a height map inside a mask: central differences, one-sided at the leaf's edge, straight up off the leaf and where a texel has no neighbour.
pub fn normals(z: &[f64], mask: &[bool], width: usize, height: usize, texel_mm: f64) -> Vec<[f64; 3]> {
    let slope = |k: usize, before: Option<usize>, after: Option<usize>| {
        let on = |k: Option<usize>| k.filter(|&k| mask[k]);
        match (on(before), on(after)) {
            (Some(a), Some(b)) => (z[b] - z[a]) / (2.0 * texel_mm),
            (Some(a), None) => (z[k] - z[a]) / texel_mm,
            (None, Some(b)) => (z[b] - z[k]) / texel_mm,
            (None, None) => 0.0,
        }
    };
    (0..width * height)
        .map(|k| {
            if !mask[k] {
                return [0.0, 0.0, 1.0];
            }
            let (i, j) = (k % width, k / width);
            let p = slope(k, (i > 0).then(|| k - 1), (i + 1 < width).then(|| k + 1));
            let q = slope(k, (j + 1 < height).then(|| k + width), (j > 0).then(|| k - width));
            let length = (1.0 + p * p + q * q).sqrt();
            [-p / length, -q / length, 1.0 / length]
        })
        .collect()
}
