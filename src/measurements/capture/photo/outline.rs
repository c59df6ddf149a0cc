//! Where the leaf is in a photograph: in open shade it is brighter than the black sheet that it lies on, and on the
//! light table it is darker than the table.

use super::light::SheetLight;
use super::picture::LinearPhotograph;
use crate::lightbox::{mask_from_transmission, pieces};
use crate::photo::{Error, Result};
use mesophyll_base::image::ImageSize;
use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::quantile;
use std::path::Path;

/// How much brighter than the sheet a pixel must be to count as something that lies on it.
const BRIGHTER: f64 = 1.5;
/// Pixels of a sample for a quantile.
const SAMPLE: usize = 200_000;
/// Smallest leaf (pixels).
pub(super) const SMALLEST: usize = 400;
/// Pieces that may be the leaf, the largest first. A ruler may be many times as large as the leaf.
pub const PIECES: usize = 6;

/// What lies on the sheet in a picture in open shade.
#[derive(Debug)]
pub struct PhotoOutline {
    /// Masks of the pieces that may be the leaf, the largest first; holes are filled. None where nothing stands out.
    pub candidates: Vec<Vec<bool>>,
    /// Whatever is brighter than the sheet.
    pub bright: Vec<bool>,
    /// Whether a piece that may be the leaf touches the border.
    pub at_border: bool,
    /// Median brightness of the first candidate over the sheet's.
    pub contrast: f64,
}

/// A quantile of about [`SAMPLE`] finite values.
pub(super) fn level(values: impl Iterator<Item = f32>, count: usize, q: f64) -> f64 {
    let mut list: Vec<f64> = values.step_by((count / SAMPLE).max(1)).filter(|v| v.is_finite()).map(f64::from).collect();
    quantile(&mut list, q).unwrap_or(f64::NAN)
}

/// Finds what may be the leaf in a picture in open shade. Pieces that hold one of the pixels `other` (on the card or
/// the ruler) are not the leaf. At most `most` of the largest are looked at more closely.
///
/// What counts is the contrast of a pixel, its brightness over the sheet's in the channel where that is largest. The
/// sheet's brightness is first the first quintile of the picture, then the light that the sheet shows ([`SheetLight`]).
/// The edge of a piece lies halfway, in ratio, between the sheet and the piece's own median: a white ruler's edge is
/// not the leaf's.
pub fn on_sheet(picture: &LinearPhotograph, other: &[usize], most: usize) -> PhotoOutline {
    let size = picture.size();
    let sheet = Rgb::of(|c| level(picture.pixels.iter().map(|v| v[c]), size.texels(), 0.2).max(1e-9));
    // A clipped pixel is brighter than the sheet, one without a reading is not known to be.
    let against = |by: &dyn Fn(usize) -> Rgb| -> Vec<f32> {
        let contrast = |k: usize| {
            let (v, by) = (picture.pixels[k], by(k));
            (0..3).map(|c| f64::from(v[c]) / by[c]).fold(0.0, f64::max) as f32
        };
        (0..size.texels()).map(contrast).collect()
    };
    let over = |contrast: &[f32], threshold: f64| -> Vec<bool> {
        contrast.iter().map(|v| f64::from(*v) > threshold).collect()
    };
    let mut contrast = against(&|_| sheet);
    let light = SheetLight::on_sheet(picture, &over(&contrast, BRIGHTER));
    if light.is_seen() {
        contrast = against(&|k| light.at(size.middle(k)));
    }
    // Pieces that hold none of the pixels that are not the leaf's.
    let free = |threshold: f64| {
        let (label, mut sizes) = pieces(&over(&contrast, threshold), size);
        sizes[0] = 0;
        other.iter().for_each(|&k| sizes[label[k] as usize] = 0);
        (label, sizes)
    };
    let (label, sizes) = free(BRIGHTER);
    let mut order: Vec<usize> = (1..sizes.len()).filter(|&p| sizes[p] >= SMALLEST).collect();
    order.sort_unstable_by_key(|&p| (usize::MAX - sizes[p], p));
    let mut found = PhotoOutline { candidates: Vec::new(), bright: Vec::new(), at_border: false, contrast: f64::NAN };
    if order.is_empty() {
        found.bright = over(&contrast, BRIGHTER);
        return found;
    }
    let mut lowest = BRIGHTER;
    for piece in order.into_iter().take(PIECES) {
        let on = || (0..size.texels()).filter(|&k| label[k] as usize == piece);
        let median = level(on().map(|k| contrast[k]), sizes[piece], 0.5);
        let threshold = median.sqrt();
        let (own, own_sizes) = free(threshold);
        // The part of the piece that is left, or what it has become.
        let mut shared = vec![0usize; own_sizes.len()];
        on().for_each(|k| shared[own[k] as usize] += 1);
        let part = (1..own_sizes.len()).max_by_key(|&p| (shared[p], usize::MAX - p));
        let Some(part) = part.filter(|&p| own_sizes[p] >= SMALLEST) else { continue };
        let mask = filled(own.iter().map(|l| *l as usize == part).collect(), size);
        if touches_border(&mask, size) {
            found.at_border = true;
        } else {
            if found.candidates.is_empty() {
                found.contrast = median;
            }
            found.candidates.push(mask);
            lowest = lowest.min(threshold);
            if found.candidates.len() == most {
                break;
            }
        }
    }
    found.bright = over(&contrast, lowest);
    found
}

/// The leaf on the light table: the largest piece that darkens it. `ratio` is the picture with the leaf over the bare
/// table, NaN off the table.
///
/// # Errors
/// [`Error::Input`] where nothing is darker than the table, and where the leaf touches the border.
pub fn on_table(picture: &LinearPhotograph, ratio: &[Rgb<f32>]) -> Result<Vec<bool>> {
    let size = picture.size();
    let (label, sizes) = pieces(&mask_from_transmission(ratio, size), size);
    let largest = (1..sizes.len()).max_by_key(|&p| (sizes[p], usize::MAX - p)).filter(|&p| sizes[p] >= SMALLEST);
    let Some(largest) = largest else {
        return Err(Error::input(&picture.path, "no leaf is seen: nothing is darker than the bare light table"));
    };
    let mask: Vec<bool> = label.iter().map(|l| *l as usize == largest).collect();
    if touches_border(&mask, size) { Err(border(&picture.path)) } else { Ok(mask) }
}

/// The refusal of a picture whose leaf is not wholly inside.
pub(super) fn border(path: &Path) -> Error {
    Error::input(
        path,
        "the leaf, or something beside card and ruler, touches the border of the picture; expected the whole leaf \
         inside, with the sheet or the table all around it",
    )
}

pub(super) fn touches_border(mask: &[bool], ImageSize { width: w, height: h }: ImageSize) -> bool {
    (0..w).any(|i| mask[i] || mask[(h - 1) * w + i]) || (0..h).any(|j| mask[j * w] || mask[j * w + w - 1])
}

/// The mask without its holes: pieces of the outside that do not reach the border.
pub(super) fn filled(mask: Vec<bool>, size: ImageSize) -> Vec<bool> {
    let ImageSize { width: w, height: h } = size;
    let outside: Vec<bool> = mask.iter().map(|m| !m).collect();
    let (label, sizes) = pieces(&outside, size);
    let mut open = vec![false; sizes.len()];
    for k in (0..w).flat_map(|i| [i, (h - 1) * w + i]).chain((0..h).flat_map(|j| [j * w, j * w + w - 1])) {
        open[label[k] as usize] = true;
    }
    label.iter().map(|l| *l == 0 || !open[*l as usize]).collect()
}

/// Pixels that are set or have a set pixel within `reach` in the same row or, after that, in the same column.
pub fn widened(mask: &[bool], ImageSize { width: w, height: h }: ImageSize, reach: usize) -> Vec<bool> {
    let pass = |from: &[bool], n: usize, step: usize, start: usize, out: &mut [bool]| {
        let mut until = 0usize; // one past the last place that a set pixel before it covers
        for p in 0..n {
            if from[start + p * step] {
                until = p + reach + 1;
            }
            out[start + p * step] |= p < until;
        }
        let mut since = n; // the first place that a set pixel after it covers
        for p in (0..n).rev() {
            if from[start + p * step] {
                since = p.saturating_sub(reach);
            }
            out[start + p * step] |= p >= since;
        }
    };
    let mut rows = vec![false; w * h];
    (0..h).for_each(|j| pass(mask, w, 1, j * w, &mut rows));
    let mut out = vec![false; w * h];
    (0..w).for_each(|i| pass(&rows, h, w, i, &mut out));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_is_widened_and_its_hole_is_filled() {
        let size = ImageSize::new(12, 9);
        let places = || (0..size.texels()).map(|k| size.position(k));
        let at = |[i, j]: [usize; 2]| (4..7).contains(&i) && (3..6).contains(&j);
        let full = filled(places().map(|p| at(p) && p != [5, 4]).collect(), size);
        assert!(full.iter().zip(places()).all(|(full, p)| *full == at(p)));
        let wide = widened(&full, size, 2);
        assert!(wide.iter().zip(places()).all(|(on, [i, j])| *on == ((2..9).contains(&i) && (1..8).contains(&j))));
    }
}
