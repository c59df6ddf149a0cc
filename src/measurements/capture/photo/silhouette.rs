//! A leaf nearly as dark as the black sheet. In open shade its outline is lost in the noise, but on the light table it
//! is a clear silhouette. So the picture in open shade tells only where the leaf lies, by what differs from the sheet
//! over squares of pixels, and the outline is the silhouette, laid over that place.

use super::light::SheetLight;
use super::light_table::on_light_table;
use super::manifest::PhotoManifest;
use super::outline::{PIECES, PhotoOutline, SMALLEST, border, filled, level, touches_border, widened};
use super::picture::LinearPhotograph;
use super::registration::{BinaryMask, OutlineMatch, register};
use super::views::{judge, mismatch};
use crate::lightbox::pieces;
use crate::photo::{Error, Result};
use mesophyll_base::image::ImageSize;
use mesophyll_base::rgb::Rgb;
use mesophyll_optics::side::Side;
use std::path::Path;

/// A leaf whose median is fewer times as bright as the sheet may have a poor outline there.
const CLEAR: f64 = 2.0;
/// An outline on the sheet that overlaps the silhouette by less than this is poor.
const SAME: f64 = 0.97;
/// Squares over which a picture is averaged: this share of its longer side.
const SQUARE: f64 = 1.0 / 80.0;
/// The sheet lies all around: this share of the longer side of the picture, along its border, is taken for the sheet at
/// first.
const FRAME: f64 = 1.0 / 12.0;
/// What differs from the sheet by more than this many standard deviations of squares on the sheet is no noise.
const BEYOND: f64 = 5.0;
/// The fifth of the smallest of three Gaussian numbers' norms, in standard deviations.
const FIFTH: f64 = 1.0025;

/// The front's outline from the light table.
pub(super) struct ByTable {
    /// Pixels of the front's picture on the leaf.
    pub mask: Vec<bool>,
    /// Whatever differs from the sheet, the leaf among it.
    pub bright: Vec<bool>,
    /// Mean distance between the silhouette and the rough place (pixels), by which it may lie askew.
    pub apart_px: f64,
}

/// Whether the outline on the sheet must be compared with the silhouette.
pub(super) fn is_poor(on_sheet: &PhotoOutline) -> bool {
    !(on_sheet.contrast >= CLEAR)
}

/// What may be a dark leaf in a picture in open shade: whatever differs from the sheet, brighter or darker. Pieces that
/// hold one of the pixels `other` are not the leaf.
///
/// # Errors
/// [`Error::Input`] where nothing differs from the sheet beyond the noise.
pub(super) fn on_dark_sheet(picture: &LinearPhotograph, other: &[usize]) -> Result<PhotoOutline> {
    let size = picture.size();
    let ImageSize { width: w, height: h } = size;
    let mut bright = bright_at_least(picture);
    other.iter().for_each(|&k| bright[k] = true);
    let frame = (w.max(h) as f64 * FRAME) as usize;
    let inner = |k: usize| size.position(k).iter().zip([w, h]).all(|(at, n)| *at >= frame && *at + frame < n);
    let mut off: Vec<bool> = (0..w * h).map(|k| bright[k] || inner(k)).collect();
    let mut found = PhotoOutline { candidates: Vec::new(), bright: Vec::new(), at_border: false, contrast: f64::NAN };
    // What is taken for the sheet is first the border, then all but the leaf that was found by it.
    for _ in 0..3 {
        let light = SheetLight::on_sheet(picture, &off);
        let apart = apart(picture, &light);
        let on_sheet = (0..w * h).filter(|&k| !off[k]).map(|k| apart[k]);
        let noise = level(on_sheet, w * h, 0.2) / FIFTH;
        let beyond = |by: f64| -> Vec<bool> { (0..w * h).map(|k| bright[k] || f64::from(apart[k]) > by).collect() };
        let pieces_of = |by: f64| {
            let (label, mut sizes) = pieces(&beyond(by), size);
            let mut shining = vec![0; sizes.len()];
            (0..w * h).filter(|&k| bright[k]).for_each(|k| shining[label[k] as usize] += 1);
            // What is mostly bright, as a ruler, is no dark leaf.
            sizes.iter_mut().zip(&shining).filter(|(n, bright)| 2 * **bright > **n).for_each(|(n, _)| *n = 0);
            sizes[0] = 0;
            other.iter().for_each(|&k| sizes[label[k] as usize] = 0);
            (label, sizes)
        };
        let largest = |label: &[u32], sizes: &[usize]| -> Option<f64> {
            let piece =
                (1..sizes.len()).max_by_key(|&p| (sizes[p], usize::MAX - p)).filter(|&p| sizes[p] >= SMALLEST)?;
            let on = (0..w * h).filter(|&k| label[k] as usize == piece && !bright[k]).map(|k| apart[k]);
            Some(level(on, sizes[piece], 0.5))
        };
        let (label, sizes) = pieces_of(BEYOND * noise);
        let Some(median) = largest(&label, &sizes).filter(|m| m.is_finite()) else { break };
        // The edge lies halfway between the sheet and the leaf.
        let (label, sizes) = pieces_of((0.5 * median).max(BEYOND * noise));
        let mut order: Vec<usize> = (1..sizes.len()).filter(|&p| sizes[p] >= SMALLEST).collect();
        order.sort_unstable_by_key(|&p| (usize::MAX - sizes[p], p));
        found.candidates.clear();
        for piece in order.into_iter().take(PIECES) {
            let mask = filled(label.iter().map(|l| *l as usize == piece).collect(), size);
            if touches_border(&mask, size) {
                found.at_border = true;
            } else {
                found.candidates.push(mask);
            }
        }
        found.bright = beyond(BEYOND * noise);
        off = widened(&found.bright, size, side_of(w, h));
    }
    if found.candidates.is_empty() && found.at_border {
        return Err(border(&picture.path));
    }
    if found.candidates.is_empty() {
        let what = "no leaf differs from the sheet, neither brighter nor darker; expected a leaf that can be told from \
                    it, whole and away from the border: another black sheet, or a longer exposure, may do";
        return Err(Error::input(&picture.path, what));
    }
    Ok(found)
}

/// Pixels that are at least twice as bright as the first quintile: card, ruler, and whatever else is no dark leaf.
fn bright_at_least(picture: &LinearPhotograph) -> Vec<bool> {
    let n = picture.pixels.len();
    let sheet = Rgb::of(|c| level(picture.pixels.iter().map(|v| v[c]), n, 0.2).max(1e-9));
    picture.pixels.iter().map(|v| (0..3).any(|c| f64::from(v[c]) > CLEAR * sheet[c])).collect()
}

/// Half the side of the squares (pixels).
fn side_of(w: usize, h: usize) -> usize {
    ((w.max(h) as f64 * SQUARE) as usize / 2).max(1)
}

/// How far the mean over the square around each pixel is from the sheet: the norm of ln(picture/light) over the three
/// channels.
fn apart(picture: &LinearPhotograph, light: &SheetLight) -> Vec<f32> {
    let (w, h) = (picture.width, picture.height);
    let reach = side_of(w, h);
    // Sums over all pixels above and to the left.
    let mut sums = vec![[0f64; 3]; (w + 1) * (h + 1)];
    for j in 0..h {
        let mut row = [0.0; 3];
        for i in 0..w {
            let (pixel, by) = (picture.pixels[j * w + i], light.at([i as f64 + 0.5, j as f64 + 0.5]));
            for c in 0..3 {
                let v = f64::from(pixel[c]) / by[c];
                row[c] += if v.is_finite() { v } else { CLEAR };
                sums[(j + 1) * (w + 1) + i + 1][c] = sums[j * (w + 1) + i + 1][c] + row[c];
            }
        }
    }
    let square = |k: usize| {
        let range = |at: usize, n: usize| (at.saturating_sub(reach), (at + reach + 1).min(n));
        let [i, j] = picture.size().position(k);
        let ((left, right), (top, bottom)) = (range(i, w), range(j, h));
        let at = |i: usize, j: usize| sums[j * (w + 1) + i];
        let [a, b, c, d] = [at(right, bottom), at(left, bottom), at(right, top), at(left, top)];
        let n = ((right - left) * (bottom - top)) as f64;
        let squares = (0..3).map(|k| ((a[k] - b[k] - c[k] + d[k]) / n).max(1e-9).ln().powi(2));
        squares.sum::<f64>().sqrt() as f32
    };
    (0..w * h).map(square).collect()
}

/// The front's outline by the silhouette on the light table, where that on the sheet is poor; `None` where it is not.
/// The front's picture is read anew in here, so that no more pictures are in memory than elsewhere.
///
/// # Errors
/// As [`on_dark_sheet`]; pictures of the light table that cannot be read; a silhouette that fits no place.
pub(super) fn by_table(
    folder: &Path,
    m: &PhotoManifest,
    path: &Path,
    other: &[usize],
    on_sheet: &PhotoOutline,
) -> Result<Option<ByTable>> {
    let (silhouette, width) = {
        let bare = LinearPhotograph::read(&folder.join(&m.light_table.bare), m)?;
        let picture = LinearPhotograph::read(&folder.join(&m.light_table.leaf), m)?;
        (on_light_table(&picture, &bare)?.mask, picture.width)
    };
    let silhouette = BinaryMask { inside: &silhouette, width };
    let mirrored = m.light_table.up == Side::Back;
    let picture = LinearPhotograph::read(path, m)?;
    let as_mask = |inside: &'_ [bool]| -> Option<OutlineMatch> {
        Some(register(BinaryMask { inside, width: picture.width }, silhouette, mirrored)?.best)
    };
    if on_sheet.candidates.first().and_then(|c| as_mask(c)).is_some_and(|found| found.overlap >= SAME) {
        return Ok(None);
    }
    let rough = match on_dark_sheet(&picture, other) {
        Ok(rough) => rough,
        // What is brighter than the sheet, or lies at the border, is all there is.
        Err(_) if !on_sheet.candidates.is_empty() => return Ok(None),
        Err(_) if on_sheet.at_border => return Err(border(path)),
        Err(e) => return Err(e),
    };
    let places = rough.candidates.iter().filter_map(|c| Some((c, as_mask(c)?)));
    let Some((place, found)) = places.max_by(|a, b| a.1.overlap.total_cmp(&b.1.overlap)) else {
        return Err(mismatch(path, 0.0));
    };
    let way = format!("the {} up, as light_table.up says", m.light_table.up.name());
    judge(path, BinaryMask { inside: place, width: picture.width }, silhouette, &found, mirrored, &way)?;
    let size = picture.size();
    let mask = (0..size.texels()).map(|k| silhouette.holds(found.motion.at(size.middle(k)))).collect::<Vec<bool>>();
    if touches_border(&mask, size) {
        return Err(border(path));
    }
    let bright = rough.bright.iter().zip(&mask).map(|(b, on)| *b || *on).collect();
    Ok(Some(ByTable { mask, bright, apart_px: found.apart_px }))
}
