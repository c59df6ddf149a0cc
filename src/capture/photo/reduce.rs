//! Reduces photographs to maps: ρd of both sides and ρt, texel by texel on the front's picture, with standard errors and
//! named defects. Lengths in mm, reflectances 0 … 1.
//!
//! - Reflectance of a side: card's reflectance · (picture/light)/(card/light), where the light over the picture is seen
//!   on the black sheet ([`super::light`]). What the surface mirrors and what the sheet sends back through the leaf are
//!   subtracted.
//! - Transmittance: (leaf on the table)/(bare table), set to 1 beside the leaf. Light that the leaf throws back onto the
//!   table returns and makes the table behind the leaf brighter by 1/(1 − r ρ), with r the table's reflectance and ρ that
//!   of the leaf's underside; the ratio is divided by it.
//! - One grid: whole pixels of the front's picture. The other pictures are sampled where their outlines put each place.

use super::light::Light;
use super::manifest::{Manifest, Shade};
use super::outline::{on_sheet, on_table, widened};
use super::picture::Picture;
use super::register::{Mask, Match, Motion, register};
use super::ruler::{self, Scale};
use crate::dome::highlight::{self, Highlight, fresnel_normal};
use crate::{Error, Result};
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::side::{Side, mirror};
use std::collections::BTreeMap;
use std::path::Path;

/// Texels along the longer side of the leaf where `texel_mm` is not stated. A texel has two pixels at least each way,
/// because a pixel of a photograph also shows its neighbours.
const TEXELS: usize = 720;
/// Texels around the leaf.
const MARGIN: usize = 3;
/// Relative standard error of ρd from what open shade does not show: slopes see less of the sky, and the sky over them
/// is not even. A slope of t radians sees about t²/4 less; this is a slope of .2.
const SLOPES: f64 = 0.01;
/// Relative standard error of the share that a lobe of stated slope mirrors: models of the lobe differ by that much.
const LOBE: f64 = 0.1;
/// Relative error of the light that comes back through the leaf from the sheet, beside that of the sheet's reflectance.
const BEHIND: f64 = 0.3;
/// A card that is this many times brighter or darker than stated is something else.
const WRONG: f64 = 2.5;
/// Outlines of one leaf overlap by at least this.
const OVERLAP: f64 = 0.9;
/// A mirror image counts as the better match where its overlap is larger by this.
const TURNED: f64 = 0.02;

/// What is wrong with a texel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Defect {
    /// A picture has no reading there.
    NoReading,
    /// A picture is clipped there.
    Saturated,
    /// So close to the outline that pixels of the pictures mix leaf and surroundings.
    Edge,
    /// Transmittance outside 0 to 1.
    Transmission,
    /// More light leaves than arrives.
    Energy,
    /// Darker than the subtracted gloss.
    Dark,
}

impl Defect {
    /// Every defect.
    pub const ALL: [Defect; 6] =
        [Defect::NoReading, Defect::Saturated, Defect::Edge, Defect::Transmission, Defect::Energy, Defect::Dark];

    /// Its code in masks.
    pub fn code(self) -> i16 {
        -1 - Defect::ALL.iter().position(|d| *d == self).unwrap_or(0) as i16
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Defect::NoReading => "no_reading",
            Defect::Saturated => "saturated",
            Defect::Edge => "edge",
            Defect::Transmission => "transmission",
            Defect::Energy => "energy",
            Defect::Dark => "dark",
        }
    }
}

/// One side, row-major as its camera saw it; NaN off the leaf.
#[derive(Debug, Clone)]
pub struct ReducedSide {
    /// Diffuse reflectance, a channel.
    pub rho_d: Vec<[f64; 3]>,
    /// Its standard error from noise and from the place in the picture.
    pub rho_d_err: Vec<[f64; 3]>,
    /// Relative standard error that all texels and channels share: card, light, slopes.
    pub alike: f64,
    /// Standard error that all texels of a channel share: gloss and the sheet.
    pub shared: [f64; 3],
    /// What the surface mirrors, as it was subtracted.
    pub gloss: Highlight,
    /// 1 good, 0 off the leaf, else a [`Defect`]'s code.
    pub status: Vec<i16>,
    /// What was found on the way, by name.
    pub figures: BTreeMap<&'static str, f64>,
}

/// All photographs as maps.
#[derive(Debug, Clone)]
pub struct Reduced {
    /// Columns of every map.
    pub width: usize,
    /// Rows of every map.
    pub height: usize,
    /// Size of a texel (mm).
    pub texel_mm: f64,
    /// The scale of the front's picture.
    pub scale: Scale,
    /// Pixel of the front's picture at the upper left of the maps.
    pub origin: [usize; 2],
    /// Pixels of the front's picture a texel, each way.
    pub step: usize,
    /// Texels on the leaf in every picture, in the front's columns.
    pub mask: Vec<bool>,
    /// The front's maps.
    pub front: ReducedSide,
    /// The back's maps, in its own columns.
    pub back: ReducedSide,
    /// Transmittance, in the front's columns; NaN off the leaf.
    pub rho_t: Vec<[f64; 3]>,
    /// Its standard error from noise and from the place in the picture.
    pub rho_t_err: Vec<[f64; 3]>,
    /// Relative standard error of ρt that all texels share.
    pub rho_t_shared: [f64; 3],
    /// Standard deviation of a reading v of the pictures: √(photon·v + read²).
    pub noise: Noise,
}

/// The camera's noise: a linear reading v has the variance photon·v + read².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Variance over reading.
    pub photon: f64,
    /// Standard deviation without light.
    pub read: f64,
    /// Whether it is stated; otherwise it was estimated on the card.
    pub stated: bool,
}

impl Noise {
    fn variance(&self, v: f64) -> f64 {
        self.photon * v.max(0.0) + self.read * self.read
    }
}

impl Reduced {
    /// One side's maps.
    pub fn side(&self, side: Side) -> &ReducedSide {
        match side {
            Side::Front => &self.front,
            Side::Back => &self.back,
        }
    }

    /// A map of the front's columns as the camera of `side` saw it.
    pub fn seen<T: Copy>(&self, map: &[T], side: Side) -> Vec<T> {
        match side {
            Side::Front => map.to_vec(),
            Side::Back => mirror(map, self.width),
        }
    }
}

/// The maps' grid over the front's picture.
#[derive(Debug, Clone, Copy)]
struct Grid {
    origin: [usize; 2],
    step: usize,
    width: usize,
    height: usize,
}

impl Grid {
    /// A place in the front's picture: the middle of pixel (a, b) of texel `k`.
    fn pixel(&self, k: usize, a: usize, b: usize) -> [f64; 2] {
        let [x, y] = [self.origin[0] + k % self.width * self.step + a, self.origin[1] + k / self.width * self.step + b];
        [x as f64 + 0.5, y as f64 + 0.5]
    }

    fn middle(&self, k: usize) -> [f64; 2] {
        let [x, y] = self.pixel(k, 0, 0);
        let half = 0.5 * (self.step as f64 - 1.0);
        [x + half, y + half]
    }

    /// The mean of `value` over the pixels of every texel that is asked for.
    fn mean(&self, wanted: &[bool], value: impl Fn([f64; 2]) -> [f64; 3] + Sync) -> Vec<[f64; 3]> {
        use rayon::prelude::*;
        let n = (self.step * self.step) as f64;
        let texel = |k: usize| {
            let mut sum = [0.0; 3];
            for p in (0..self.step * self.step).map(|s| self.pixel(k, s % self.step, s / self.step)) {
                let v = value(p);
                (0..3).for_each(|c| sum[c] += v[c] / n);
            }
            sum
        };
        (0..wanted.len()).into_par_iter().map(|k| if wanted[k] { texel(k) } else { [f64::NAN; 3] }).collect()
    }

    /// How much sampling between pixels smooths a map away: [`BLUR`] times the map's second differences.
    fn blur(&self, map: &[[f64; 3]], k: usize, c: usize) -> f64 {
        let (w, at) = (self.width, |k: usize| map.get(k).map_or(f64::NAN, |v| v[c]));
        let bend = at(k + 1) + at(k.wrapping_sub(1)) + at(k + w) + at(k.wrapping_sub(w)) - 4.0 * at(k);
        if bend.is_finite() { BLUR * bend.abs() / (self.step * self.step) as f64 } else { 0.0 }
    }

    /// How much a map changes from one texel to the next, in the steeper of both directions.
    fn slope(&self, map: &[[f64; 3]], k: usize, c: usize) -> f64 {
        let (w, at) = (self.width, |k: usize| map.get(k).map_or(f64::NAN, |v| v[c]));
        let across = 0.5 * (at(k + 1) - at(k.wrapping_sub(1)));
        let down = 0.5 * (at(k + w) - at(k.wrapping_sub(w)));
        [across, down].into_iter().filter(|v| v.is_finite()).fold(0.0, |a: f64, v| a.max(v.abs()))
    }
}

/// What smoothing took from a map, over the second differences of what it left. A camera's lens and sampling between
/// pixels smooth by 1/6 pixel² each along either axis (a straight line between two pixels at u of the way smooths by
/// u(1 − u), 1/6 on average). Half of both, 1/6, is the first term of a series; the finest detail that a camera still
/// shows makes the rest of the series about as large.
const BLUR: f64 = 1.0 / 3.0;

/// A side in open shade, before anything is subtracted.
struct Lit {
    value: Vec<[f64; 3]>,
    error: Vec<[f64; 3]>,
    /// Relative standard error of card and light.
    alike: f64,
    figures: BTreeMap<&'static str, f64>,
}

/// Reads and reduces the photographs of the capture in `folder`.
///
/// # Errors
/// [`Error::Input`] in one sentence: a picture that cannot be read, a card that is not there, clipped or not even, no
/// leaf, a leaf at the border, a clipped light table, outlines that do not match or are turned the wrong way.
pub fn reduce(folder: &Path, m: &Manifest) -> Result<Reduced> {
    let [front_path, back_path, leaf_path, bare_path] = m.pictures(folder);
    let picture = Picture::read(&front_path, m)?;
    let card = card_pixels(folder, &picture, &m.front, "front.card")?;
    let noise = noise(m, &picture, &card);
    for mark in m.ruler.marks_px {
        if !(mark[0] >= 0.0 && mark[1] >= 0.0 && mark[0] < picture.width as f64 && mark[1] < picture.height as f64) {
            let size = format!("marks inside the picture of {}x{} pixels", picture.width, picture.height);
            return Err(Manifest::wrong(folder, "ruler.marks_px", format!("{:?}", m.ruler.marks_px), size));
        }
    }
    let scale = ruler::scale(&picture, &m.ruler);
    let mut other = card.clone();
    let [a, b] = m.ruler.marks_px;
    other.extend((0..=1000).map(|s| f64::from(s) / 1000.0).map(|s| {
        let [x, y] = [0, 1].map(|k| (a[k] + s * (b[k] - a[k])) as usize);
        y * picture.width + x
    }));
    let mut outline = on_sheet(&picture, &other)?;
    let front_mask = outline.candidates.swap_remove(0);
    let front_outline = Mask { inside: &front_mask, width: picture.width };
    let grid = grid(folder, m, &front_mask, &picture, scale)?;
    let inside = |mask: Mask, p: [f64; 2]| {
        let at = p.map(|v| v.floor());
        let rows = (mask.inside.len() / mask.width) as f64;
        at[0] >= 0.0
            && at[1] >= 0.0
            && at[0] < mask.width as f64
            && at[1] < rows
            && mask.inside[at[1] as usize * mask.width + at[0] as usize]
    };
    let texels = grid.width * grid.height;
    let mut mask: Vec<bool> = (0..texels).map(|k| inside(front_outline, grid.middle(k))).collect();
    let front = lit(folder, m, &picture, &card, &outline.bright, &grid, &mask, None, noise, "front")?;
    drop(picture);

    let picture = Picture::read(&back_path, m)?;
    let card = card_pixels(folder, &picture, &m.back, "back.card")?;
    let outline = on_sheet(&picture, &card)?;
    let matches = outline.candidates.iter().filter_map(|c| {
        let candidate = Mask { inside: c, width: picture.width };
        Some((candidate, register(front_outline, candidate, true)?))
    });
    let best = matches.max_by(|a, b| a.1.overlap.total_cmp(&b.1.overlap));
    let Some((back_outline, back_match)) = best else { return Err(mismatch(&back_path, 0.0)) };
    judge(&back_path, front_outline, back_outline, &back_match, true, "turned over")?;
    (0..texels).for_each(|k| mask[k] &= inside(back_outline, back_match.motion.at(grid.middle(k))));
    let back = lit(folder, m, &picture, &card, &outline.bright, &grid, &mask, Some(&back_match), noise, "back")?;
    drop((picture, outline));

    let (picture, bare) = (Picture::read(&leaf_path, m)?, Picture::read(&bare_path, m)?);
    let table = on_light_table(&picture, &bare)?;
    let table_outline = Mask { inside: &table.mask, width: picture.width };
    let turned = m.light_table.up == Side::Back;
    let Some(table_match) = register(front_outline, table_outline, turned) else {
        return Err(mismatch(&leaf_path, 0.0));
    };
    let way = if turned { "the back up, as light_table.up says" } else { "the front up, as light_table.up says" };
    judge(&leaf_path, front_outline, table_outline, &table_match, turned, way)?;
    (0..texels).for_each(|k| mask[k] &= inside(table_outline, table_match.motion.at(grid.middle(k))));
    let under = if turned { &front } else { &back };
    let (rho_t, rho_t_err, rho_t_shared) =
        through(m, &picture, &bare, &table, &grid, &mask, &table_match, noise, under);

    let apart = back_match.apart_px.max(table_match.apart_px);
    let outside: Vec<bool> = mask.iter().map(|m| !m).collect();
    let reach = ((1.5 + 2.0 * apart) / grid.step as f64).ceil() as usize;
    let edge = widened(&outside, grid.width, grid.height, reach);
    let sides = [(Side::Front, front, None), (Side::Back, back, Some(&back_match))].map(|(side, lit, found)| {
        finished(m, side, lit, found, &grid, &mask, &edge, &rho_t, &rho_t_err, scale, &table_match)
    });
    let [mut front, mut back] = sides;
    let entered = [back.rho_d.clone(), front.rho_d.clone()];
    for (s, side) in [&mut front, &mut back].into_iter().enumerate() {
        for k in 0..texels {
            let over = (0..3).any(|c| {
                let error = side.rho_d_err[k][c].hypot(rho_t_err[k][c]).hypot(side.shared[c]);
                rho_t[k][c] + entered[s][k][c] - 1.0 > 3.0 * error
            });
            if side.status[k] == 1 && over {
                side.status[k] = Defect::Energy.code();
            }
        }
    }
    back.rho_d = mirror(&back.rho_d, grid.width);
    back.rho_d_err = mirror(&back.rho_d_err, grid.width);
    back.status = mirror(&back.status, grid.width);
    Ok(Reduced {
        width: grid.width,
        height: grid.height,
        texel_mm: scale.pixel_mm * grid.step as f64,
        scale,
        origin: grid.origin,
        step: grid.step,
        mask,
        front,
        back,
        rho_t,
        rho_t_err,
        rho_t_shared,
        noise,
    })
}

/// The pixels of the stated rectangle on the card.
fn card_pixels(folder: &Path, picture: &Picture, shade: &Shade, field: &str) -> Result<Vec<usize>> {
    let [left, top, width, height] = shade.card;
    let fits = left.checked_add(width).is_some_and(|r| r <= picture.width)
        && top.checked_add(height).is_some_and(|b| b <= picture.height);
    if width < 4 || height < 4 || !fits {
        let size = format!(
            "left, top, width and height of at least 4 by 4 pixels on the card, inside the {}x{} of the picture",
            picture.width, picture.height
        );
        return Err(Manifest::wrong(folder, field, format!("{:?}", shade.card), size));
    }
    let clipped = picture.clipped(shade.card);
    if clipped > 1e-3 {
        let what = format!("{:.1} % of the card's pixels are clipped; expected a shorter exposure", 100.0 * clipped);
        return Err(Error::input(&picture.path, what));
    }
    Ok((top..top + height).flat_map(|j| (left..left + width).map(move |i| j * picture.width + i)).collect())
}

/// The stated noise, or that of the differences of neighbours on the card, all taken as the photons'.
fn noise(m: &Manifest, picture: &Picture, card: &[usize]) -> Noise {
    if m.noise_photon.is_some() || m.noise_read.is_some() {
        return Noise { photon: m.noise_photon.unwrap_or(0.0), read: m.noise_read.unwrap_or(0.0), stated: true };
    }
    let pairs = card.windows(2).filter(|p| p[1] == p[0] + 1);
    let (mut squares, mut level) = (0.0, 0.0);
    for (a, b) in pairs.map(|p| (picture.pixels[p[0]], picture.pixels[p[1]])) {
        for (a, b) in a.into_iter().zip(b).filter(|(a, b)| a.is_finite() && b.is_finite()) {
            squares += 0.5 * f64::from(a - b).powi(2);
            level += 0.5 * f64::from(a + b);
        }
    }
    Noise { photon: if level > 0.0 { squares / level } else { 0.0 }, read: 0.0, stated: false }
}

fn grid(folder: &Path, m: &Manifest, mask: &[bool], picture: &Picture, scale: Scale) -> Result<Grid> {
    let w = picture.width;
    let on = || mask.iter().enumerate().filter(|(_, m)| **m).map(|(k, _)| [k % w, k / w]);
    let low = [0, 1].map(|a: usize| on().map(|p| p[a]).min().unwrap_or(0));
    let high = [0, 1].map(|a: usize| on().map(|p| p[a]).max().unwrap_or(0));
    let longest = (high[0] - low[0]).max(high[1] - low[1]) + 1;
    let step = match m.texel_mm {
        None => longest.div_ceil(TEXELS).max(2),
        Some(texel) => ((texel / scale.pixel_mm).round() as usize).max(1),
    };
    if longest / step < 8 {
        let expected = format!("a length that divides the leaf's {:.1} mm", longest as f64 * scale.pixel_mm);
        return Err(Manifest::wrong(
            folder,
            "texel_mm",
            m.texel_mm.unwrap_or(0.0),
            expected + " into 8 texels or more",
        ));
    }
    let origin = low.map(|v| v.saturating_sub(MARGIN * step));
    let [width, height] = [0, 1].map(|a: usize| (high[a] + 1 - origin[a]).div_ceil(step) + MARGIN);
    Ok(Grid { origin, step, width, height })
}

/// One side's reflectance against the card, gloss included.
fn lit(
    folder: &Path,
    m: &Manifest,
    picture: &Picture,
    card: &[usize],
    bright: &[bool],
    grid: &Grid,
    mask: &[bool],
    found: Option<&Match>,
    noise: Noise,
    name: &str,
) -> Result<Lit> {
    let light = Light::on_sheet(picture, bright);
    let w = picture.width;
    let middle = |k: usize| [(k % w) as f64 + 0.5, (k / w) as f64 + 0.5];
    let mut sums = [[0.0; 2]; 3];
    for &k in card {
        let by = light.at(middle(k));
        for c in 0..3 {
            let v = f64::from(picture.pixels[k][c]) / by[c];
            sums[c][0] += v;
            sums[c][1] += v * v;
        }
    }
    let n = card.len() as f64;
    let level = sums.map(|s| s[0] / n);
    let grain = sums.map(|s| (s[1] / n - (s[0] / n).powi(2)).max(0.0).sqrt());
    for c in 0..3 {
        // Noise alone, and a twentieth of the level for grain.
        let expected = (noise.variance(level[c]) + (0.05 * level[c]).powi(2)).sqrt();
        if !(level[c] > 0.0 && grain[c] < 2.0 * expected) {
            let found = format!("a rectangle with readings of {:.4} ± {:.4}", level[c], grain[c]);
            return Err(Manifest::wrong(
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
        return Err(Manifest::wrong(folder, &format!("{name}.card"), found, expected));
    }
    let motion = found.map_or(Motion::NONE, |f| f.motion);
    let factor = level.map(|l| m.card.reflectance / l);
    let value = grid.mean(mask, |p| {
        let at = motion.at(p);
        let (v, by) = (picture.at(at), light.at(at));
        [0, 1, 2].map(|c: usize| v[c] / by[c] * factor[c])
    });
    let pixels = (grid.step as f64 * motion.scale()).powi(2).max(1.0);
    let apart = found.map_or(0.0, |f| f.apart_px) / grid.step as f64;
    let error = (0..value.len())
        .map(|k| {
            let by = light.at(motion.at(grid.middle(k)));
            [0, 1, 2].map(|c: usize| {
                let unit = factor[c] / by[c];
                let noise = (noise.variance(value[k][c] / unit) / pixels).sqrt() * unit;
                let blur = if found.is_some() { grid.blur(&value, k, c) } else { 0.0 };
                noise.hypot(apart * grid.slope(&value, k, c)).hypot(blur)
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
    ]);
    Ok(Lit { value, error, alike: card_err.hypot(light_err).hypot(SLOPES), figures })
}

/// The leaf on the table: its mask, the ratio of both pictures beside it, and the relative standard error of that.
struct OnTable {
    mask: Vec<bool>,
    exposure: [[f64; 2]; 3],
}

fn on_light_table(picture: &Picture, bare: &Picture) -> Result<OnTable> {
    let (w, h) = (picture.width, picture.height);
    if (bare.width, bare.height) != (w, h) {
        let what =
            format!("found {}x{} pixels, expected the {w}x{h} of the picture with the leaf", bare.width, bare.height);
        return Err(Error::input(&bare.path, what));
    }
    let clipped = bare.clipped([0, 0, w, h]);
    if clipped > 1e-3 {
        let what = format!(
            "the light table is clipped in {:.1} % of the picture; expected a shorter exposure, the same with the leaf",
            100.0 * clipped
        );
        return Err(Error::input(&bare.path, what));
    }
    let mut levels: Vec<f64> = (0..w * h).step_by((w * h / 100_000).max(1)).map(|k| f64::from(bare.grey(k))).collect();
    levels.retain(|v| v.is_finite());
    let full = crate::dome::noise::quantile(&mut levels, 0.9);
    // Where the bare picture is darker than a tenth of the table there is no table.
    let ratio: Vec<[f32; 3]> = (0..w * h)
        .map(|k| {
            let lit = f64::from(bare.grey(k)) > 0.1 * full;
            [0, 1, 2].map(|c: usize| if lit { picture.pixels[k][c] / bare.pixels[k][c] } else { f32::NAN })
        })
        .collect();
    let mask = on_table(picture, &ratio)?;
    let near = widened(&mask, w, h, w.max(h) / 60 + 2);
    let exposure = [0, 1, 2].map(|c: usize| {
        let mut beside: Vec<f64> =
            (0..w * h).filter(|&k| !near[k] && ratio[k][c].is_finite()).map(|k| f64::from(ratio[k][c])).collect();
        if beside.len() < 100 {
            return [1.0, 0.05];
        }
        let quarter = |beside: &mut Vec<f64>, q| crate::dome::noise::quantile(beside, q);
        let (low, middle, high) = (quarter(&mut beside, 0.25), quarter(&mut beside, 0.5), quarter(&mut beside, 0.75));
        // Half the distance of the quartiles is .674 standard deviations. Noise averages out over the many pixels; what
        // does not is a table that changed from place to place, at most a tenth of what is seen.
        [middle, 0.1 * 0.5 * (high - low) / 0.674 / middle]
    });
    if exposure.iter().any(|e| !(0.2..=5.0).contains(&e[0])) {
        let what =
            format!("beside the leaf the table is {:.3} times as bright as bare; expected about 1", exposure[1][0]);
        return Err(Error::input(&picture.path, what));
    }
    Ok(OnTable { mask, exposure })
}

/// ρt, its standard error, and the relative error that all texels share.
fn through(
    m: &Manifest,
    picture: &Picture,
    bare: &Picture,
    table: &OnTable,
    grid: &Grid,
    mask: &[bool],
    found: &Match,
    noise: Noise,
    under: &Lit,
) -> (Vec<[f64; 3]>, Vec<[f64; 3]>, [f64; 3]) {
    let motion = found.motion;
    let r = m.light_table.reflectance;
    let below = mean(&under.value, mask);
    // The table behind the leaf is brighter by 1/(1 − rρ).
    let factor = [0, 1, 2].map(|c: usize| (1.0 - r * below[c]) / table.exposure[c][0]);
    let shared = [0, 1, 2].map(|c: usize| {
        // How far light spreads in the table before it returns is not known: under small leaves and near the outline
        // anything between none and all of it may be missing.
        let spread = r / 12f64.sqrt();
        let back = m.light_table.reflectance_err.hypot(spread) * below[c] / (1.0 - r * below[c]);
        back.hypot(table.exposure[c][1])
    });
    let value = grid.mean(mask, |p| {
        let at = motion.at(p);
        let (l, b) = (picture.at(at), bare.at(at));
        [0, 1, 2].map(|c: usize| l[c] / b[c] * factor[c])
    });
    let pixels = (grid.step as f64 * motion.scale()).powi(2).max(1.0);
    let apart = found.apart_px / grid.step as f64;
    let error = (0..value.len())
        .map(|k| {
            let b = if mask[k] { bare.at(motion.at(grid.middle(k))) } else { [f64::NAN; 3] };
            [0, 1, 2].map(|c: usize| {
                let t = value[k][c] / factor[c];
                let variance = noise.variance(t * b[c]) + t * t * noise.variance(b[c]);
                let noise = (variance / pixels).sqrt() / b[c] * factor[c];
                noise.hypot(apart * grid.slope(&value, k, c)).hypot(grid.blur(&value, k, c))
            })
        })
        .collect();
    (value, error, shared)
}

/// Mean of the finite values where `mask` is set, a channel.
fn mean(map: &[[f64; 3]], mask: &[bool]) -> [f64; 3] {
    let good = || map.iter().zip(mask).filter(|(v, m)| **m && v.iter().all(|v| v.is_finite())).map(|(v, _)| v);
    let n = good().count().max(1) as f64;
    [0, 1, 2].map(|c: usize| good().map(|v| v[c]).sum::<f64>() / n)
}

/// Subtracts gloss and what the sheet sends back, and names the defects. All maps are in the front's columns.
fn finished(
    m: &Manifest,
    side: Side,
    mut lit: Lit,
    found: Option<&Match>,
    grid: &Grid,
    mask: &[bool],
    edge: &[bool],
    rho_t: &[[f64; 3]],
    rho_t_err: &[[f64; 3]],
    scale: Scale,
    table: &Match,
) -> ReducedSide {
    let s = usize::from(side == Side::Back);
    let gloss = match m.gloss {
        None => highlight::estimate(&lit.value, mask, None),
        Some(g) => {
            let lobe = Lobe::Beckmann.albedo(1.0, g.slope[s]);
            let (share, n) = (fresnel_normal(g.index[s]) * lobe, g.index[s]);
            let by_index = lobe * g.index_err * 4.0 * (n - 1.0) / (n + 1.0).powi(3);
            let known = highlight::estimate(&lit.value, mask, Some(n));
            Highlight { share, stderr: by_index.hypot(LOBE * share), ..known }
        }
    };
    let sheet = m.background;
    let behind = mean(rho_t, mask).map(|t| t * t);
    let shared = behind.map(|t2| {
        let back = sheet.reflectance_err.hypot(BEHIND * sheet.reflectance) * t2;
        gloss.stderr.hypot(back)
    });
    let mut status = vec![0i16; mask.len()];
    for k in (0..mask.len()).filter(|&k| mask[k]) {
        for c in 0..3 {
            lit.value[k][c] -= gloss.share + sheet.reflectance * rho_t[k][c] * rho_t[k][c];
        }
        let (d, t) = (lit.value[k], rho_t[k]);
        let any = |f: &dyn Fn(usize) -> bool| (0..3).any(f);
        let defect = if edge[k] {
            Some(Defect::Edge)
        } else if any(&|c| d[c].is_infinite() || t[c].is_infinite()) {
            Some(Defect::Saturated)
        } else if any(&|c| d[c].is_nan() || t[c].is_nan()) {
            Some(Defect::NoReading)
        } else if any(&|c| t[c] < -3.0 * rho_t_err[k][c] || t[c] >= 1.0) {
            Some(Defect::Transmission)
        } else if any(&|c| d[c] < -3.0 * lit.error[k][c].hypot(shared[c])) {
            Some(Defect::Dark)
        } else {
            None
        };
        status[k] = defect.map_or(1, Defect::code);
    }
    let mut figures = lit.figures;
    figures.extend([
        ("gloss_share", gloss.share),
        ("gloss_stderr", gloss.stderr),
        ("sheet_through_leaf", sheet.reflectance * behind[1]),
        ("outline_overlap", found.map_or(1.0, |f| f.overlap)),
        ("outlines_apart_mm", found.map_or(0.0, |f| f.apart_px * scale.pixel_mm)),
        ("table_outline_overlap", table.overlap),
        ("table_outlines_apart_mm", table.apart_px * scale.pixel_mm),
        ("scale_relative_err", scale.relative_err),
        ("texel_pixels", grid.step as f64),
    ]);
    ReducedSide { rho_d: lit.value, rho_d_err: lit.error, alike: lit.alike, shared, gloss, status, figures }
}

fn mismatch(path: &Path, overlap: f64) -> Error {
    let share = 100.0 * overlap;
    let what =
        format!("the leaf's outline overlaps the front's by {share:.0} % only; expected one leaf, whole and flat");
    Error::input(path, what)
}

/// Refuses outlines that do not match, and a leaf that lies the wrong way up.
fn judge(path: &Path, first: Mask, second: Mask, found: &Match, mirrored: bool, way: &str) -> Result<()> {
    let other = register(first, second, !mirrored).map_or(0.0, |m| m.overlap);
    if other > found.overlap + TURNED {
        let [fits, turned] = [100.0 * found.overlap, 100.0 * other];
        let what = format!(
            "the leaf lies the wrong way up ({fits:.1} % overlap with the front's outline, {turned:.1} % if it is turned \
             over); expected it {way}"
        );
        return Err(Error::input(path, what));
    }
    if found.overlap < OVERLAP { Err(mismatch(path, found.overlap)) } else { Ok(()) }
}
