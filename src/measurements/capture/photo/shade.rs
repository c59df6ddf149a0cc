//! A side of the leaf in open shade: its reflectance against the grey card, gloss still included.

use super::grid::Grid;
use super::light::SheetLight;
use super::manifest::{PhotoManifest, ShadePhotograph};
use super::noise::SensorNoise;
use super::picture::LinearPhotograph;
use super::registration::{OutlineMatch, SimilarityTransform};
use crate::photo::{Error, Result};
use mesophyll_base::rgb::Rgb;
use std::collections::BTreeMap;
use std::path::Path;

/// Relative standard error of ρd from what open shade does not show: slopes see less of the sky, and the sky over them
/// is not even. A slope of t radians sees about t²/4 less; this is a slope of .2.
const SLOPES: f64 = 0.01;
/// A card that is this many times brighter or darker than stated is something else.
const WRONG: f64 = 2.5;
/// Cells each way that the card is cut into. How much their means differ says how well the mean of all is known,
/// whatever makes them differ: noise that neighbours share, the card's grain, or light that the sheet does not show.
const CELLS: usize = 4;

/// A side in open shade, before anything is subtracted.
pub(super) struct Lit {
    /// Reflectance with gloss, a channel of each texel.
    pub value: Vec<Rgb>,
    /// Its standard error from noise and from the place in the picture.
    pub error: Vec<Rgb>,
    /// The part of that which is noise.
    pub noise: Vec<Rgb>,
    /// Relative standard error of card and light.
    pub alike: f64,
    /// Relative standard error of the card's reading, a channel.
    pub card_reading: Rgb,
    /// What was found on the way, by name.
    pub figures: BTreeMap<&'static str, f64>,
}

/// The pixels of the stated rectangle on the card.
pub(super) fn card_pixels(
    folder: &Path,
    picture: &LinearPhotograph,
    shade: &ShadePhotograph,
    field: &str,
) -> Result<Vec<usize>> {
    let [left, top, width, height] = shade.card;
    let fits = left.checked_add(width).is_some_and(|r| r <= picture.width)
        && top.checked_add(height).is_some_and(|b| b <= picture.height);
    if width < 4 || height < 4 || !fits {
        let size = format!(
            "left, top, width and height of at least 4 by 4 pixels on the card, inside the {}x{} of the picture",
            picture.width, picture.height
        );
        return Err(PhotoManifest::wrong(folder, field, format!("{:?}", shade.card), size));
    }
    let clipped = picture.clipped(shade.card);
    if clipped > 1e-3 {
        let what = format!("{:.1} % of the card's pixels are clipped; expected a shorter exposure", 100.0 * clipped);
        return Err(Error::input(&picture.path, what));
    }
    Ok((top..top + height).flat_map(|j| (left..left + width).map(move |i| j * picture.width + i)).collect())
}

/// A side's picture in open shade, and what was found on it.
#[derive(Clone, Copy)]
pub(super) struct ShadedSide<'a> {
    /// The side's section of the manifest.
    pub name: &'a str,
    pub picture: &'a LinearPhotograph,
    /// The pixels of the card.
    pub card: &'a [usize],
    /// Whatever is brighter than the sheet.
    pub bright: &'a [bool],
    /// Where the front's outline lies in the picture; `None` for the front itself.
    pub found: Option<&'a OutlineMatch>,
    pub noise: &'a SensorNoise,
}

/// One side's reflectance against the card, gloss included.
pub(super) fn lit(folder: &Path, m: &PhotoManifest, side: ShadedSide, grid: &Grid, mask: &[bool]) -> Result<Lit> {
    let ShadedSide { name, picture, card, bright, found, noise } = side;
    let light = SheetLight::on_sheet(picture, bright);
    let middle = |k: usize| picture.size().middle(k);
    let shade = if name == "front" { &m.front } else { &m.back };
    let Card { level, grain, reading_err } = read_card(picture, shade.card, card, &light);
    let on_card = light.at(middle(card[card.len() / 2]));
    for c in 0..3 {
        // Noise of one pixel, and a twentieth of the level for grain.
        let unit = on_card[c].max(1e-12);
        let expected = (noise.of_mean(c, level[c] * unit, 1.0).sqrt() / unit).hypot(0.05 * level[c]);
        if !(level[c] > 0.0 && grain[c] < 2.0 * expected) {
            let found = format!("a rectangle with readings of {:.4} ± {:.4}", level[c], grain[c]);
            return Err(PhotoManifest::wrong(
                folder,
                &format!("{name}.card"),
                found,
                "one that lies wholly on an even card",
            ));
        }
    }
    // The light is in units of what the sheet shows, so the level says how much brighter than the sheet the card is.
    let stated = m.card.reflectance / m.background.reflectance.max(1e-9);
    if light.is_seen() && m.background.reflectance > 0.0 && !(1.0 / WRONG..WRONG).contains(&(level[1] / stated)) {
        let found = format!("a rectangle {:.2} times as bright as the sheet", level[1]);
        let expected = format!("about {stated:.2} times, as the stated reflectances of card and sheet say");
        return Err(PhotoManifest::wrong(folder, &format!("{name}.card"), found, expected));
    }
    let motion = found.map_or(SimilarityTransform::NONE, |f| f.motion);
    let factor = m.card.reflectance / level;
    let size = motion.scale();
    let value = grid.mean(mask, size, |p| {
        let at = motion.at(p);
        picture.at(at) / light.at(at) * factor
    });
    // Texels of the front are whole pixels.
    let side = if found.is_some() { grid.read(size) } else { grid.step as f64 };
    let noise: Vec<Rgb> = (0..value.len())
        .map(|k| {
            let by = light.at(motion.at(grid.middle(k)));
            Rgb::of(|c| {
                let unit = factor[c] / by[c];
                noise.of_mean(c, value[k][c] / unit, side).sqrt() * unit
            })
        })
        .collect();
    let apart = found.map_or(0.0, |f| f.apart_px) / grid.step as f64;
    let error = (0..value.len())
        .map(|k| {
            Rgb::of(|c| {
                let blur = if found.is_some() { grid.blur(&value, k, c, size) } else { 0.0 };
                noise[k][c].hypot(apart * grid.slope(&value, k, c)).hypot(blur)
            })
        })
        .collect();
    let on = mask.iter().enumerate().filter(|(_, m)| **m).map(|(k, _)| motion.at(grid.middle(k)));
    let (sum, count) = on.fold(([0.0; 2], 0.0), |(s, n), p| ([s[0] + p[0], s[1] + p[1]], n + 1.0));
    let leaf = sum.map(|s: f64| s / f64::max(count, 1.0));
    let of_card = middle(card[card.len() / 2]);
    let light_err = light.ratio_err(leaf, of_card);
    let card_err = m.card.reflectance_err / m.card.reflectance;
    let figures = BTreeMap::from([
        ("light_unevenness", light.unevenness()),
        ("light_relative_err", light_err),
        ("light_blocks", light.blocks as f64),
        ("card_relative_err", card_err),
        ("card_reading", level[1]),
        ("card_reading_relative_err", reading_err[1]),
        ("slopes_relative_err", SLOPES),
    ]);
    let alike = card_err.hypot(light_err).hypot(SLOPES);
    Ok(Lit { value, error, noise, alike, card_reading: reading_err, figures })
}

/// What the card shows, a channel: its level over the light, the standard deviation of a pixel, and the relative
/// standard error of the level.
struct Card {
    level: Rgb,
    grain: Rgb,
    reading_err: Rgb,
}

fn read_card(
    picture: &LinearPhotograph,
    [left, top, width, height]: [usize; 4],
    card: &[usize],
    light: &SheetLight,
) -> Card {
    let mut cells = [[[0.0; 2]; CELLS * CELLS]; 3];
    let mut squares = [0.0; 3];
    for &k in card {
        let ([i, j], by) = (picture.size().position(k), light.at(picture.size().middle(k)));
        let cell = (j - top) * CELLS / height * CELLS + (i - left) * CELLS / width;
        for c in 0..3 {
            let v = f64::from(picture.pixels[k][c]) / by[c];
            cells[c][cell] = [cells[c][cell][0] + v, cells[c][cell][1] + 1.0];
            squares[c] += v * v;
        }
    }
    let n = card.len() as f64;
    let level = Rgb(cells).map(|of| of.iter().map(|s| s[0]).sum::<f64>() / n);
    let grain = Rgb::of(|c: usize| (squares[c] / n - level[c].powi(2)).max(0.0).sqrt());
    let count = (CELLS * CELLS) as f64;
    let reading_err = Rgb::of(|c| {
        let off = cells[c].iter().map(|s| (s[0] / s[1] / level[c] - 1.0).powi(2)).sum::<f64>();
        (off / (count - 1.0) / count).sqrt()
    });
    Card { level, grain, reading_err }
}
