//! Reduces photographs to maps: ρd of both sides and ρt, texel by texel on the front's picture, with standard errors
//! and named defects. Lengths in mm, reflectances 0 … 1.
//!
//! - Reflectance of a side: card's reflectance · (picture/light)/(card/light), where the light over the picture is seen
//!   on the black sheet ([`super::light`]). What the surface mirrors and what the sheet sends back through the leaf are
//!   subtracted.
//! - Transmittance: (leaf on the table)/(bare table), set to 1 beside the leaf. Light that the leaf throws back onto
//!   the table returns and makes the table behind the leaf brighter by 1/(1 − r ρ), with r the table's reflectance and
//!   ρ that of the leaf's underside; the ratio is divided by it.
//! - One grid: whole pixels of the front's picture. The other pictures are sampled where their outlines put each place.

use super::grid::{Grid, grid};
use super::manifest::Manifest;
use super::outline::{on_sheet, widened};
use super::picture::Picture;
use super::reduced::{Reduced, ReducedSide};
use super::register::{Mask, Match, register};
use super::ruler::{self, Scale};
use super::shade::{Lit, card_pixels, lit, noise};
use super::table::{mean, on_light_table, through};
use crate::{Error, Result};
use mesophyll_capture::dome::highlight::{self, Highlight, fresnel_normal};
use mesophyll_optics::defect::{Defect, GOOD};
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::side::{Side, mirror};
use std::path::Path;

/// Relative standard error of the share that a lobe of stated slope mirrors: models of the lobe differ by that much.
const LOBE: f64 = 0.1;
/// Relative error of the light that comes back through the leaf from the sheet, beside that of the sheet's reflectance.
const BEHIND: f64 = 0.3;
/// Outlines of one leaf overlap by at least this.
const OVERLAP: f64 = 0.9;
/// A mirror image counts as the better match where its overlap is larger by this.
const TURNED: f64 = 0.02;

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
        status[k] = defect.map_or(GOOD, Defect::code);
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
            "the leaf lies the wrong way up ({fits:.1} % overlap with the front's outline, {turned:.1} % if it is \
             turned over); expected it {way}"
        );
        return Err(Error::input(path, what));
    }
    if found.overlap < OVERLAP { Err(mismatch(path, found.overlap)) } else { Ok(()) }
}
