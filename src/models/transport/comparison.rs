//! Compares a picture with its reference: by a perceptual measure over the whole picture, and by the largest error
//! where both must agree exactly.
//!
//! FLIP (Andersson et al. 2020, LDR) models how a person sees the pictures at 0.7 m from a 4K screen that is 0.7 m wide
//! (67 pixels for each degree). Its mean and its 99th percentile are over all pixels. The largest error is over pixels
//! inside one surface and away from shadow edges, where sampling cannot explain a difference.

use super::renderer::ReferencePicture;
use crate::{Error, Result};
use mesophyll_base::statistics::percentile;
use nv_flip::{DEFAULT_PIXELS_PER_DEGREE, FlipImageRgb8};

/// The figures of a comparison. FLIP and errors are from 0 (equal) to 1.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureComparison {
    /// Number of pixels in a row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Mean FLIP error over the pixels.
    pub flip_mean: f64,
    /// 99 % of the pixels have a FLIP error of at most this.
    pub flip_p99: f64,
    /// Largest difference in a channel of the 8-bit pictures, over pixels that show a surface, are interior and
    /// outside penumbras. `None` when the view has no such pixel.
    pub max_error: Option<f64>,
    /// Column and row of that pixel; the first one, if there are several.
    pub max_at: Option<(usize, usize)>,
    /// 99th percentile of that difference over the same pixels.
    pub error_p99: Option<f64>,
    /// The pixels that count for `max_error`, as a share of the pixels that show a leaf; 0 when none counts.
    pub interior_share: f64,
    /// FLIP error of each pixel.
    pub flip: Vec<f32>,
}

/// Compares an RGBA picture (sRGB, alpha ignored) with the reference.
///
/// # Errors
/// [`Error::Usage`] when the sizes differ.
pub fn compare(reference: &ReferencePicture, picture: &[[u8; 4]]) -> Result<PictureComparison> {
    let judged: Vec<bool> = reference.interior.iter().zip(&reference.penumbra).map(|(&i, &p)| i && !p).collect();
    compare_where(reference, picture, &judged)
}

/// The same measures for two reference pictures with different seeds, which is the reference's own noise. Only pixels
/// that are interior and free of penumbra in both count.
pub fn noise_floor(a: &ReferencePicture, b: &ReferencePicture) -> Result<PictureComparison> {
    let calm = |p: &ReferencePicture| p.interior.iter().zip(&p.penumbra).map(|(&i, &s)| i && !s).collect::<Vec<_>>();
    let judged: Vec<bool> = calm(a).into_iter().zip(calm(b)).map(|(x, y)| x && y).collect();
    compare_where(a, &b.ldr, &judged)
}

fn compare_where(reference: &ReferencePicture, picture: &[[u8; 4]], judged: &[bool]) -> Result<PictureComparison> {
    let (width, height) = (reference.width, reference.height);
    if picture.len() != width * height {
        return Err(Error::Usage(format!(
            "a picture of {} pixels against a reference of {width}×{height}",
            picture.len()
        )));
    }
    let flip = flip_map(&reference.ldr, picture, width, height);
    let mut errors = Vec::new();
    let (mut largest, mut max_at) = (None, None);
    // A pixel of the sky is all of one surface, too, and says nothing of how a surface is shaded.
    let shows_leaf = |k: usize| reference.hdr[k][3] > 0.0;
    let judged = |k: usize| shows_leaf(k) && judged.get(k) == Some(&true);
    for (k, (a, b)) in reference.ldr.iter().zip(picture).enumerate() {
        if judged(k) {
            let error = (0..3).map(|c| a[c].abs_diff(b[c])).max().unwrap_or(0);
            if largest.is_none_or(|l| error > l) {
                (largest, max_at) = (Some(error), Some((k % width, k / width)));
            }
            errors.push(error);
        }
    }
    errors.sort_unstable();
    let leaf = (0..width * height).filter(|&k| shows_leaf(k)).count();
    let [flip_mean, flip_p99] = flip_figures(&flip);
    Ok(PictureComparison {
        width,
        height,
        flip_mean,
        flip_p99,
        max_error: largest.map(|e| f64::from(e) / 255.0),
        max_at,
        error_p99: percentile(&errors, 0.99).map(|e| f64::from(e) / 255.0),
        interior_share: errors.len() as f64 / leaf.max(1) as f64,
        flip,
    })
}

/// FLIP error of each pixel between two RGBA pictures of the same size.
pub fn flip_map(a: &[[u8; 4]], b: &[[u8; 4]], width: usize, height: usize) -> Vec<f32> {
    let image = |pixels: &[[u8; 4]]| {
        let bytes: Vec<u8> = pixels.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
        FlipImageRgb8::with_data(width as u32, height as u32, &bytes)
    };
    nv_flip::flip(image(a), image(b), DEFAULT_PIXELS_PER_DEGREE).to_vec()
}

/// The mean of a FLIP map, and the FLIP that 99 % of its pixels do not exceed.
pub fn flip_figures(map: &[f32]) -> [f64; 2] {
    let mut sorted = map.to_vec();
    sorted.sort_unstable_by(f32::total_cmp);
    let mean = map.iter().map(|&x| f64::from(x)).sum::<f64>() / map.len().max(1) as f64;
    [mean, percentile(&sorted, 0.99).map_or(0.0, f64::from)]
}

impl PictureComparison {
    /// The FLIP map as an RGB picture with 3 bytes for each pixel, from black (equal) to light yellow (FLIP `top` or
    /// more, 0 < `top` ≤ 1).
    pub fn flip_picture(&self, top: f64) -> Vec<u8> {
        let stretched: Vec<f32> = self.flip.iter().map(|f| (f64::from(*f) / top).min(1.0) as f32).collect();
        let map = nv_flip::FlipImageFloat::with_data(self.width as u32, self.height as u32, &stretched);
        map.apply_color_lut(&nv_flip::magma_lut()).to_vec()
    }
}

/// The difference of each channel as an RGB picture, enlarged `gain` times about mid-grey. Grey means equal, and
/// lighter means that the picture is too light.
pub fn difference_picture(reference: &[[u8; 4]], picture: &[[u8; 4]], gain: f64) -> Vec<u8> {
    let channel = |a: u8, b: u8| (128.0 + gain * (f64::from(b) - f64::from(a))).round().clamp(0.0, 255.0) as u8;
    reference.iter().zip(picture).flat_map(|(a, b)| [0, 1, 2].map(|c| channel(a[c], b[c]))).collect()
}
