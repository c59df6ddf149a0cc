//! Reduces photographs to maps: ρd of both sides and ρt, texel by texel on the front's picture, with standard errors
//! and named defects. Lengths in mm, reflectances 0 … 1.
//!
//! - Reflectance of a side: card's reflectance · (picture/light)/(card/light), where the light over the picture is seen
//!   on the black sheet ([`super::light`]). What the surface mirrors ([`super::gloss`]) and what the sheet sends back
//!   through the leaf ([`super::interreflection`]) are subtracted.
//! - Transmittance: (leaf on the table)/(bare table), set to 1 beside the leaf. The ratio is divided by what the leaf's
//!   underside makes the table behind it brighter by ([`super::interreflection`]).
//! - One grid: whole pixels of the front's picture. The other pictures are sampled where their outlines put each place.

use super::gloss::{Gloss, LOBE, gloss};
use super::grid::{Grid, grid};
use super::interreflection::{Returned, Seen, returned};
use super::light_table::{OverBare, mean};
use super::manifest::PhotoManifest;
use super::maps::{PhotoMaps, PhotoSideMaps};
use super::noise::SensorNoise;
use super::outline::{PIECES, PhotoOutline, border, on_sheet, widened};
use super::picture::LinearPhotograph;
use super::registration::{BinaryMask, register};
use super::ruler::{self, PictureScale};
use super::shade::{Lit, ShadedSide, card_pixels, lit};
use super::silhouette;
use super::texture::{Chosen, choose};
use super::views::{OTHER_WAY, OVERLAP, PhotoFront, Views, judge, mismatch};
use crate::photo::Result;
use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::median_of;
use mesophyll_optics::defect::{Defect, GOOD};
use mesophyll_optics::side::{Side, Sides, mirror};
use std::path::Path;

/// Figure: 1 where a side is nearly as dark as the sheet, so that its outline is that of the light table.
pub const DARK: &str = "outline_of_light_table";

/// Relative error of the light that comes back through the leaf from the sheet, beside that of the sheet's reflectance.
const BEHIND: f64 = 0.3;

/// Reads and reduces the photographs of the capture in `folder`.
///
/// # Errors
/// [`Error::Input`] in one sentence: a picture that cannot be read, a card that is not there, clipped or not even, no
/// leaf, a leaf at the border, a clipped light table, outlines that do not match or are turned the wrong way.
pub fn reduce(folder: &Path, m: &PhotoManifest) -> Result<PhotoMaps> {
    let [front_path, back_path] = m.in_shade(folder);
    let picture = LinearPhotograph::read(&front_path, m)?;
    let card = card_pixels(folder, &picture, &m.front, "front.card")?;
    let noise = noise_on(folder, m, &picture, m.front.card, "front.card")?;
    for mark in m.ruler.marks_px {
        if !(mark[0] >= 0.0 && mark[1] >= 0.0 && mark[0] < picture.width as f64 && mark[1] < picture.height as f64) {
            let size = format!("marks inside the picture of {}x{} pixels", picture.width, picture.height);
            return Err(PhotoManifest::wrong(folder, "ruler.marks_px", format!("{:?}", m.ruler.marks_px), size));
        }
    }
    let scale = ruler::scale(&picture, &m.ruler);
    let mut other = card.clone();
    let [a, b] = m.ruler.marks_px;
    other.extend((0..=1000).map(|s| f64::from(s) / 1000.0).map(|s| {
        let [x, y] = [0, 1].map(|k| (a[k] + s * (b[k] - a[k])) as usize);
        y * picture.width + x
    }));
    let mut outline = on_sheet(&picture, &other, 1);
    let (picture, by_table) = if silhouette::is_poor(&outline) {
        drop(picture);
        let found = silhouette::by_table(folder, m, &front_path, &other, &outline)?;
        (LinearPhotograph::read(&front_path, m)?, found)
    } else {
        (picture, None)
    };
    let dark = by_table.as_ref().map(|found| found.apart_px);
    let (front_mask, bright) = match by_table {
        Some(found) => (found.mask, found.bright),
        None => (outline.candidates.swap_remove(0), outline.bright),
    };
    let front_outline = BinaryMask { inside: &front_mask, width: picture.width };
    let grid = grid(folder, m, &front_mask, &picture, scale)?;
    let texels = grid.width * grid.height;
    let mut mask: Vec<bool> = (0..texels).map(|k| front_outline.holds(grid.middle(k))).collect();
    let side =
        ShadedSide { name: "front", picture: &picture, card: &card, bright: &bright, found: None, noise: &noise };
    let front = lit(folder, m, side, &grid, &mask)?;
    drop(picture);

    let picture = LinearPhotograph::read(&back_path, m)?;
    let card = card_pixels(folder, &picture, &m.back, "back.card")?;
    let back_noise = noise_on(folder, m, &picture, m.back.card, "back.card")?;
    let outline = on_sheet(&picture, &card, PIECES);
    let overlap = |outline: &PhotoOutline| {
        let of = |c: &Vec<bool>| {
            Some(register(front_outline, BinaryMask { inside: c, width: picture.width }, true)?.best.overlap)
        };
        outline.candidates.iter().filter_map(of).fold(0.0, f64::max)
    };
    // A side that is too dark shows only where it lies; its outline is the front's.
    let standing_out = overlap(&outline);
    let dark_outline = if standing_out < OVERLAP { silhouette::on_dark_sheet(&picture, &card).ok() } else { None };
    let (outline, rough) = match dark_outline.filter(|dark| overlap(dark) >= OVERLAP) {
        Some(dark) => (dark, true),
        None => (outline, false),
    };
    let matches = outline.candidates.iter().filter_map(|c| {
        let candidate = BinaryMask { inside: c, width: picture.width };
        Some((candidate, register(front_outline, candidate, true)?))
    });
    let best = matches.max_by(|a, b| a.1.best.overlap.total_cmp(&b.1.best.overlap));
    let Some((back_outline, back_match)) = best else {
        return Err(if outline.at_border { border(&back_path) } else { mismatch(&back_path, 0.0) });
    };
    if outline.at_border && back_match.best.overlap < OVERLAP {
        return Err(border(&back_path));
    }
    judge(&back_path, front_outline, back_outline, &back_match.best, true, "turned over")?;
    let back_chosen = choose(&grid, &mask, &front.value, &picture, back_match);
    let back_match = back_chosen.found;
    (0..texels).for_each(|k| mask[k] &= rough || back_outline.holds(back_match.motion.at(grid.middle(k))));
    let side = ShadedSide {
        name: "back",
        picture: &picture,
        card: &card,
        bright: &outline.bright,
        found: Some(&back_match),
        noise: &back_noise,
    };
    let back = lit(folder, m, side, &grid, &mask)?;
    drop((picture, outline));

    let seen = PhotoFront { outline: front_outline, value: &front.value, least_apart_px: dark.unwrap_or(0.0) };
    let views = Views::read(folder, m, seen, &grid, &mut mask, &noise)?;
    let apart = views.each().map(|v| v.found.found.apart_px).fold(back_match.apart_px, f64::max);
    let outside: Vec<bool> = mask.iter().map(|m| !m).collect();
    let reach = ((1.5 + 2.0 * apart) / grid.step as f64).ceil() as usize;
    let edge = widened(&outside, grid.size(), reach);
    let inner: Vec<bool> = mask.iter().zip(&edge).map(|(m, e)| *m && !e).collect();
    // A leaf that is all edge has no good texel, but its figures are still told.
    let inner = if inner.contains(&true) { inner } else { mask.clone() };
    let lit = Sides { front, back };
    let (gloss, light) = behind(m, &lit, &views, &inner);
    let texels = LeafTexels { grid: &grid, scale, mask: &mask, edge: &edge };
    let of = |side, lit, found| finished(m, texels, lit, found, views.of(side), &gloss[side], &light[side]);
    let mut front = of(Side::Front, lit.front, None);
    let mut back = of(Side::Back, lit.back, Some(&back_chosen));
    name_energy(&mut front, &mut back);
    for (side, dark) in [(&mut front, dark.is_some()), (&mut back, rough)] {
        side.figures.insert(DARK, f64::from(u8::from(dark)));
    }
    for map in [&mut back.rho_d, &mut back.rho_d_err, &mut back.rho_t, &mut back.rho_t_err] {
        *map = mirror(map, grid.width);
    }
    back.status = mirror(&back.status, grid.width);
    Ok(PhotoMaps {
        width: grid.width,
        height: grid.height,
        texel_mm: scale.pixel_mm * grid.step as f64,
        scale,
        origin: grid.origin,
        step: grid.step,
        mask,
        sides: Sides { front, back },
        noise,
    })
}

/// The noise, refused where it is neither stated nor seen.
fn noise_on(
    folder: &Path,
    m: &PhotoManifest,
    picture: &LinearPhotograph,
    card: [usize; 4],
    field: &str,
) -> Result<SensorNoise> {
    let noise = SensorNoise::of(m, picture, card);
    if noise.is_known() {
        return Ok(noise);
    }
    let found = format!("{} by {} pixels, too few to measure the camera's noise on", card[2], card[3]);
    Err(PhotoManifest::wrong(
        folder,
        field,
        found,
        "a rectangle of at least 32 by 24 pixels, or noise_photon and noise_read",
    ))
}

/// Both sides' gloss, and the light between the leaf and what lies behind it.
fn behind(m: &PhotoManifest, lit: &Sides<Lit>, views: &Views, inner: &[bool]) -> (Sides<Gloss>, Sides<Returned>) {
    let seen = Sides::of(|side| {
        let (view, own) = views.of(side);
        let up = if own { side } else { side.other() };
        let (shade, table) = (mean(&lit[side].value, inner), mean(&view.value, inner));
        Seen { shade, shade_err: lit[side].alike, table, up }
    });
    // The bound on gloss is what a side shows without what the sheet adds, and that depends on the gloss in turn, by a
    // share of a share. So it is taken twice.
    let glosses = |by_sheet: Sides<Rgb>| {
        Sides::of(|side| {
            let own = lit[side].value.iter().map(|v| *v - by_sheet[side]);
            gloss(m, side, &own.collect::<Vec<_>>(), &lit[side].noise, inner)
        })
    };
    let first = glosses(Sides::default());
    let light = returned(m, &seen, &first);
    let rho_t = |side: Side| seen[side].table / (1.0 + light[side].table);
    let gloss = glosses(Sides::of(|side| light[side].sheet * rho_t(side).map(|t| t.powi(2))));
    let light = returned(m, &seen, &gloss);
    (gloss, light)
}

/// The texels of all maps, in the front's columns.
#[derive(Clone, Copy)]
struct LeafTexels<'a> {
    grid: &'a Grid,
    /// The scale of the front's picture.
    scale: PictureScale,
    /// Those on the leaf.
    mask: &'a [bool],
    /// Those near its outline.
    edge: &'a [bool],
}

/// Takes off gloss and what came from behind, and names the defects. All maps are in the front's columns.
fn finished(
    m: &PhotoManifest,
    LeafTexels { grid, scale, mask, edge }: LeafTexels,
    mut lit: Lit,
    found: Option<&Chosen>,
    (view, own): (&OverBare, bool),
    gloss: &Gloss,
    light: &Returned,
) -> PhotoSideMaps {
    let share = 1.0 / (1.0 + light.table);
    let scaled = |map: &[Rgb]| -> Vec<Rgb> { map.iter().map(|v| *v * share).collect() };
    // Gloss differs from place to place by about as much as models of the lobe do.
    lit.error.iter_mut().flatten().for_each(|e| *e = e.hypot(LOBE * gloss.normal.share));
    let (mut rho_t, mut rho_t_err) = (scaled(&view.value), scaled(&view.error));
    let other_way = if own { [0.0; 2] } else { OTHER_WAY };
    for (e, t) in rho_t_err.iter_mut().zip(&rho_t) {
        *e = e.zip(*t, |e, t| e.hypot(other_way[0] * t));
    }
    let rho_t_shared = view.shared.zip(light.table_err, |own, table| own.hypot(table).hypot(other_way[1]));
    let normal = gloss.normal;
    let t2 = mean(&rho_t, mask).map(|t| t * t);
    let level = mean(&lit.value, mask);
    let sheet = m.background;
    let shared = Rgb::of(|c| {
        let relative = (sheet.reflectance_err / sheet.reflectance.max(1e-9)).hypot(BEHIND);
        let back = light.sheet[c] * t2[c] * if sheet.reflectance > 0.0 { relative } else { 0.0 };
        normal.stderr.hypot(back).hypot(lit.card_reading[c] * level[c])
    });
    for map in [&mut lit.value, &mut lit.error, &mut rho_t, &mut rho_t_err] {
        map.iter_mut().zip(mask).filter(|(_, on)| !**on).for_each(|(v, _)| *v = Rgb::splat(f64::NAN));
    }
    let mut status = vec![0i16; mask.len()];
    for k in (0..mask.len()).filter(|&k| mask[k]) {
        lit.value[k] -= normal.share + light.sheet * rho_t[k] * rho_t[k];
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
    let median =
        |of: &[Rgb]| median_of((0..mask.len()).filter(|&k| status[k] == 1).map(|k| of[k][1])).unwrap_or(f64::NAN);
    let mut figures = lit.figures;
    figures.extend([
        ("rho_d_err_texel", median(&lit.error)),
        ("rho_t_err_texel", median(&rho_t_err)),
        ("gloss_share", normal.share),
        ("gloss_stderr", normal.stderr),
        ("gloss_at_most", normal.at_most),
        ("gloss_all_round", gloss.all_round),
        ("sheet_through_leaf", light.sheet[1] * t2[1]),
        ("all_round_reflectance", light.all_round[1]),
        ("table_brighter_behind_leaf", light.table[1]),
        ("table_beside_leaf", view.drift),
        ("rho_d_relative_err_shared", lit.alike),
        ("rho_d_err_shared", shared[1]),
        ("rho_t_relative_err_shared", rho_t_shared[1]),
        ("outline_overlap", found.map_or(1.0, |f| f.found.overlap)),
        ("outlines_apart_mm", found.map_or(0.0, |f| f.found.apart_px * scale.pixel_mm)),
        ("table_outline_overlap", view.found.found.overlap),
        ("table_outlines_apart_mm", view.found.found.apart_px * scale.pixel_mm),
        ("turn_doubtful", f64::from(u8::from(view.found.doubtful || found.is_some_and(|f| f.doubtful)))),
        ("scale_relative_err", scale.relative_err),
        ("texel_pixels", grid.step as f64),
    ]);
    PhotoSideMaps {
        rho_d: lit.value,
        rho_d_err: lit.error,
        alike: lit.alike,
        shared,
        rho_t,
        rho_t_err,
        rho_t_shared,
        rho_t_seen: own,
        gloss: normal,
        status,
        figures,
    }
}

/// Names the texels where more light leaves than arrives: what leaves a side on the light table arrived on the other,
/// which threw its own share back. Both sides' maps are in the front's columns.
fn name_energy(front: &mut PhotoSideMaps, back: &mut PhotoSideMaps) {
    let over = |out: &PhotoSideMaps, entered: &PhotoSideMaps, k: usize| {
        (0..3).any(|c| {
            let (d, t) = (entered.rho_d[k][c], out.rho_t[k][c]);
            let d_err = entered.rho_d_err[k][c].hypot(entered.shared[c]).hypot(entered.alike * d);
            let t_err = out.rho_t_err[k][c].hypot(out.rho_t_shared[c] * t);
            d + t - 1.0 > 3.0 * d_err.hypot(t_err)
        })
    };
    for k in 0..front.status.len() {
        let both = [over(front, back, k), over(back, front, k)];
        for (side, over) in [&mut *front, &mut *back].into_iter().zip(both) {
            if side.status[k] == 1 && over {
                side.status[k] = Defect::Energy.code();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What enters a side is judged by that side's error. One texel of each side, light that leaves the front entered
    /// the back: ρd .9 there and ρt .2 are too much if both are known to .01, whatever the front's own ρd is known to.
    #[test]
    fn energy_is_judged_by_the_errors_of_what_entered() {
        let side = |rho_d: f64, rho_d_err: f64, rho_t: f64| PhotoSideMaps {
            rho_d: vec![Rgb::splat(rho_d)],
            rho_d_err: vec![Rgb::splat(rho_d_err)],
            alike: 0.0,
            shared: Rgb::default(),
            rho_t: vec![Rgb::splat(rho_t)],
            rho_t_err: vec![Rgb::splat(0.01)],
            rho_t_shared: Rgb::default(),
            rho_t_seen: true,
            gloss: crate::dome::highlight::Highlight { share: 0.0, stderr: 0.0, at_most: 1.0, stated: true },
            status: vec![1],
            figures: std::collections::BTreeMap::new(),
        };
        let judged = |front: [f64; 2], back: [f64; 2]| {
            let [mut f, mut b] = [front, back].map(|[d, err]| side(d, err, 0.2));
            name_energy(&mut f, &mut b);
            [f.status[0], b.status[0]]
        };
        let energy = Defect::Energy.code();
        assert_eq!(judged([0.1, 1.0], [0.9, 0.01]), [energy, 1]);
        assert_eq!(judged([0.1, 0.01], [0.9, 1.0]), [1, 1]);
        assert_eq!(judged([0.9, 0.01], [0.1, 1.0]), [1, energy]);
    }
}
