//! A capture under a dome becomes maps: albedo, transmittance, thickness, heights and normals of both sides, with standard errors and
//! named defects (Habel 2009, §3.3.2, made explicit where the text leaves it to tools). Lengths in mm, shares 0 … 1.
//!
//! Albedo: (picture − dark)/(white − dark) · the sheet's reflectance, less the mirrored dome, over the share of the dome that the slope
//! sees. Transmittance: (picture − dark)/(back light − dark): light that fell on the *other* side. Thickness: the sum of both heights
//! less its lean, its highest place set to the caliper's. Normals: from smoothed heights by central differences.

use super::align::{self, Alignment};
use super::defect::{Defect, GOOD, OUTSIDE};
use super::highlight::{self, Highlight};
use super::manifest::{Manifest, Picture};
use super::noise::{deviation, quantile};
use super::reader::{Capture, Pictures, Pixels};
use super::smooth::{Kernel, mirrored, smooth};
use crate::capture::lightbox::mask_from_transmission;
use crate::capture::manifest::SideName;
use crate::{Error, Result};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// What the reduction is told beside the capture.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options {
    /// Standard deviation of the smoothing of heights (mm); as narrow as the noise allows when absent.
    pub smooth_mm: Option<f64>,
}

/// One side, row-major as its camera saw it; NaN off the leaf.
#[derive(Debug, Clone)]
pub struct Side {
    /// Diffuse reflectance without the highlight, a channel.
    pub albedo: Vec<[f64; 3]>,
    /// Its standard error from the photographs' noise; that of the highlight is common to all texels ([`Highlight::stderr`]).
    pub albedo_err: Vec<[f64; 3]>,
    /// Share of the back light that comes through towards this side's camera, a channel.
    pub transmittance: Vec<[f64; 3]>,
    pub transmittance_err: Vec<[f64; 3]>,
    /// mm towards this side's camera over the blade's middle plane.
    pub height: Vec<f64>,
    /// Unit normals in this side's image frame.
    pub normal: Vec<[f64; 3]>,
    pub highlight: Highlight,
    /// 1 good, 0 off the leaf, else a [`Defect`]'s code.
    pub status: Vec<i16>,
}

/// A whole capture as maps. `mask`, `thickness` and its error are in the front's columns.
#[derive(Debug, Clone)]
pub struct Reduced {
    pub width: usize,
    pub height: usize,
    pub texel_mm: f64,
    pub mask: Vec<bool>,
    /// mm; NaN off the leaf.
    pub thickness: Vec<f64>,
    /// Of a texel, from the scans' noise; that of the zero is common to all ([`Alignment::offset_err_mm`]).
    pub thickness_err: Vec<f64>,
    pub alignment: Alignment,
    pub noise: PhotoNoise,
    pub front: Side,
    pub back: Side,
}

/// Noise of a photograph's reading: √((relative·value)² + floor²).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PhotoNoise {
    pub relative: f64,
    pub floor: f64,
    pub stated: bool,
}

impl Reduced {
    pub fn side(&self, side: SideName) -> &Side {
        match side {
            SideName::Front => &self.front,
            SideName::Back => &self.back,
        }
    }

    /// Texels of a side with each defect, by name; those without any are left out.
    pub fn defects(&self, side: SideName) -> BTreeMap<&'static str, usize> {
        let status = &self.side(side).status;
        let count = |d: Defect| (d.name(), status.iter().filter(|s| **s == d.code()).count());
        Defect::ALL.map(count).into_iter().filter(|(_, n)| *n > 0).collect()
    }
}

/// Reduces an open capture.
///
/// # Errors
/// [`Error::Input`] when the pictures do not show one leaf: outlines that do not match, heights that do not cancel or have the wrong
/// sign, no texel on the leaf.
pub fn reduce(capture: &Capture, options: &Options) -> Result<Reduced> {
    let m = &capture.manifest;
    let (w, h) = (m.width, m.height);
    let noise = photo_noise(capture);
    let ratio = |leaf: &Pixels, reference: &Pixels| quotient(leaf, reference, noise, m, capture.has_dark);
    let through = [SideName::Front, SideName::Back].map(|s| ratio(&capture.pictures(s).translucency, &capture.empty));
    let mask = outline(capture, &through)?;
    let masks = [mask.clone(), mirrored(&mask, w)];

    let shape = thickness(capture, &mask, options)?;
    let [front_height, back_height] = &shape.height;
    let heights = [front_height, back_height];
    let mut sides = [SideName::Front, SideName::Back].into_iter().enumerate().zip(through).map(|((s, name), (t, t_err))| {
        let pictures = capture.pictures(name);
        let normal = normals(heights[s], &masks[s], w, m.texel_mm);
        let (mut albedo, mut albedo_err) = ratio(&pictures.albedo, &capture.white);
        albedo.iter_mut().chain(&mut albedo_err).for_each(|v| v.iter_mut().for_each(|v| *v *= m.white_reflectance));
        let highlight = highlight::estimate(&albedo, &masks[s], m.highlight_index.map(|n| n[s]));
        for (k, (a, e)) in albedo.iter_mut().zip(&mut albedo_err).enumerate() {
            // A slope sees the dome down to the blade's plane.
            let seen = 0.5 * (1.0 + normal[k][2]);
            for c in 0..3 {
                (a[c], e[c]) = if masks[s][k] { ((a[c] - highlight.share) / seen, e[c] / seen) } else { (f64::NAN, f64::NAN) };
            }
        }
        let off = |map: Vec<[f64; 3]>| map.into_iter().zip(&masks[s]).map(|(v, m)| if *m { v } else { [f64::NAN; 3] }).collect::<Vec<_>>();
        Side {
            albedo,
            albedo_err,
            transmittance: off(t),
            transmittance_err: off(t_err),
            height: heights[s].clone(),
            normal,
            highlight,
            status: Vec::new(),
        }
    });
    let (Some(mut front), Some(mut back)) = (sides.next(), sides.next()) else {
        return Err(Error::input(&capture.folder, "found less than two sides"));
    };
    let holes: Vec<bool> = {
        let back = mirrored(&capture.back.height, w);
        (0..w * h).map(|k| !(capture.front.height[k].is_finite() && back[k].is_finite())).collect()
    };
    let thin: Vec<bool> = shape.thickness.iter().map(|d| *d <= 0.0).collect();
    front.status = status(&front, &back, &capture.front, &masks[0], &holes, &thin, w);
    back.status = status(&back, &front, &capture.back, &masks[1], &mirrored(&holes, w), &mirrored(&thin, w), w);
    Ok(Reduced {
        width: w,
        height: h,
        texel_mm: m.texel_mm,
        thickness_err: mask.iter().map(|m| if *m { shape.alignment.thickness_noise_mm } else { f64::NAN }).collect(),
        mask,
        thickness: shape.thickness,
        alignment: shape.alignment,
        noise,
        front,
        back,
    })
}

/// As stated, or seen in the front's green photograph under the dome, all of it taken as a floor.
fn photo_noise(capture: &Capture) -> PhotoNoise {
    let m = &capture.manifest;
    if m.noise_relative.is_some() || m.noise_floor.is_some() {
        return PhotoNoise { relative: m.noise_relative.unwrap_or(0.0), floor: m.noise_floor.unwrap_or(0.0), stated: true };
    }
    let green: Vec<f64> = capture.front.albedo.iter().map(|v| f64::from(v[1])).collect();
    let mask = capture.mask.clone().unwrap_or_else(|| vec![true; green.len()]);
    let floor = deviation(&green, &mask, m.width).map_or(0.0, |(sd, _)| sd);
    PhotoNoise { relative: 0.0, floor, stated: false }
}

/// picture/reference and its standard error, both with their dark level off already; NaN where the reference shows no light.
fn quotient(picture: &Pixels, reference: &Pixels, noise: PhotoNoise, m: &Manifest, dark: bool) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let shots = f64::from(m.reference_shots);
    let variance = |v: f64| (noise.relative * v).powi(2) + noise.floor.powi(2);
    let dark = if dark { noise.floor.powi(2) / shots } else { 0.0 };
    let texel = |(p, r): (&[f32; 3], &[f32; 3])| {
        let (mut value, mut error) = ([f64::NAN; 3], [f64::NAN; 3]);
        for c in 0..3 {
            let (p, r) = (f64::from(p[c]), f64::from(r[c]));
            if r > 0.0 && p.is_finite() {
                let q = p / r;
                value[c] = q;
                // The dark frame is taken off both.
                error[c] = (variance(p) + q * q * variance(r) / shots + (1.0 - q).powi(2) * dark).sqrt() / r;
            }
        }
        (value, error)
    };
    picture.iter().zip(reference).map(texel).unzip()
}

/// `mask.exr`, or what darkens the back light on both sides; and a check that both sides' outlines are the same leaf's.
fn outline(capture: &Capture, through: &[(Vec<[f64; 3]>, Vec<[f64; 3]>); 2]) -> Result<Vec<bool>> {
    let (w, h) = (capture.manifest.width, capture.manifest.height);
    let seen = [0, 1].map(|s: usize| {
        let ratio: Vec<[f32; 3]> = through[s].0.iter().map(|v| v.map(|v| v as f32)).collect();
        mask_from_transmission(&ratio, w, h)
    });
    let path = |side| Picture::Translucency.path(&capture.folder, side);
    for (side, seen) in [SideName::Front, SideName::Back].into_iter().zip(&seen) {
        if !seen.contains(&true) {
            return Err(Error::input(&path(side), "no texel is darker than the back light without the leaf, so no leaf is seen"));
        }
    }
    let [front, back] = &seen;
    let back = mirrored(back, w);
    let compare = |side, seen: &[bool], mask: &[bool], what: &str| {
        let (fits, turned) = (overlap(seen, mask), overlap(&mirrored(seen, w), mask));
        if turned > fits + 0.1 {
            return Err(Error::input(
                &path(side),
                format!(
                    "the leaf's outline is the mirror image of {what} ({:.0} % overlap, mirrored {:.0} %); expected the back's pictures mirrored, and each side's in its own folder",
                    100.0 * fits,
                    100.0 * turned
                ),
            ));
        }
        if fits < 0.8 {
            return Err(Error::input(
                &path(side),
                format!("the leaf's outline overlaps {what} by {:.0} % only; expected one leaf that stays in place", 100.0 * fits),
            ));
        }
        Ok(())
    };
    match &capture.mask {
        Some(mask) => {
            compare(SideName::Front, front, mask, "mask.exr")?;
            compare(SideName::Back, &back, mask, "mask.exr")?;
            Ok(mask.clone())
        }
        None => {
            compare(SideName::Back, &back, front, "the front's")?;
            Ok(front.iter().zip(&back).map(|(f, b)| *f && *b).collect())
        }
    }
}

/// Texels that both hold over texels that either holds.
fn overlap(a: &[bool], b: &[bool]) -> f64 {
    let both = a.iter().zip(b).filter(|(a, b)| **a && **b).count();
    let either = a.iter().zip(b).filter(|(a, b)| **a || **b).count();
    both as f64 / either.max(1) as f64
}

/// Thickness (front's columns) and both sides' smoothed heights over the middle plane.
struct Shape {
    thickness: Vec<f64>,
    height: [Vec<f64>; 2],
    alignment: Alignment,
}

fn thickness(capture: &Capture, mask: &[bool], options: &Options) -> Result<Shape> {
    let m = &capture.manifest;
    let (w, h) = (m.width, m.height);
    let path = Picture::Height.path(&capture.folder, SideName::Back);
    let mut scans =
        [capture.front.height.clone(), mirrored(&capture.back.height, w)].map(|s| s.into_iter().map(f64::from).collect::<Vec<_>>());
    let sum: Vec<f64> = (0..w * h).map(|k| if mask[k] { scans[0][k] + scans[1][k] } else { f64::NAN }).collect();
    let lean = align::plane(&sum, mask, w)
        .ok_or_else(|| Error::input(&path, "fewer than 16 texels of the leaf have a height on both sides; expected heights all over it"))?;
    let rest: Vec<f64> = (0..w * h).map(|k| sum[k] - lean.at(k, w, h)).collect();

    let filter = Kernel::gaussian(m.height_filter_mm / m.texel_mm);
    let noise = m.height_noise_mm.or_else(|| align::height_noise(&rest, mask, w, &filter)).unwrap_or(0.0);
    let forced = options.smooth_mm.map(|s| s / m.texel_mm);
    let [(thin, left), (flat, slope)] = align::widths(noise, &filter, m.thickness_max_mm, m.texel_mm, forced);
    let weight: Vec<f64> = rest.iter().map(|v| f64::from(u8::from(v.is_finite()))).collect();
    let calm = smooth(&rest, &weight, w, &Kernel::gaussian(thin.max(0.7)));
    let (above, below) =
        reach(&calm, mask, 2f64.sqrt() * noise).ok_or_else(|| Error::input(&path, "no texel of the leaf has a height on both sides"))?;
    one_blade(&path, m, above, below)?;

    let (top, raised, top_err) = align::highest(&rest, w, &filter, m.contact_texels(), 2f64.sqrt() * noise);
    let offset = m.thickness_max_mm - top;
    let filled = |values: &[f64], width: f64| filled(values, mask, w, width);
    let thickness: Vec<f64> = filled(&rest, thin).into_iter().map(|v| v + offset).collect();
    // The back scan takes all of the lean; the middle plane is the front's mean less half the thickness.
    let mean = |map: &[f64]| {
        let (sum, n) = (0..w * h).filter(|&k| mask[k] && map[k].is_finite()).fold((0.0, 0usize), |(s, n), k| (s + map[k], n + 1));
        sum / n.max(1) as f64
    };
    let half = 0.5 * mean(&thickness);
    let zero = mean(&scans[0]) - half;
    scans[0].iter_mut().for_each(|v| *v -= zero);
    scans[1].iter_mut().enumerate().for_each(|(k, v)| *v += zero + offset - lean.at(k, w, h));
    let [front, back] = scans;
    let height = [filled(&front, flat), mirrored(&filled(&back, flat), w)];
    let [x, y] = lean.lean();
    let alignment = Alignment {
        tilt: [x / m.texel_mm, y / m.texel_mm],
        offset_mm: offset - lean.at(0, 1, 1),
        offset_err_mm: top_err.hypot(m.thickness_max_err_mm.unwrap_or(0.0)),
        raised_mm: raised,
        height_noise_mm: noise,
        noise_stated: m.height_noise_mm.is_some(),
        smooth_thickness_mm: thin * m.texel_mm,
        smooth_height_mm: flat * m.texel_mm,
        thickness_noise_mm: left,
        slope_noise: slope,
        above_mm: above,
        below_mm: below,
    };
    Ok(Shape { thickness, height, alignment })
}

/// How far a map reaches above and below its median on the mask, one texel in a thousand left out at each end, less what noise of this
/// deviation would do by itself.
fn reach(values: &[f64], mask: &[bool], noise: f64) -> Option<(f64, f64)> {
    let mut all: Vec<f64> = values.iter().zip(mask).filter(|(v, m)| **m && v.is_finite()).map(|(v, _)| *v).collect();
    if all.is_empty() {
        return None;
    }
    let [low, middle, high] = [0.001, 0.5, 0.999].map(|q| quantile(&mut all, q));
    // Three deviations of what the smoothing leaves, about a quarter of the noise.
    let slack = 0.75 * noise;
    Some(((high - middle - slack).max(0.0), (middle - low - slack).max(0.0)))
}

/// Heights of one blade cancel but for its thickness, and veins make it thicker, not thinner.
fn one_blade(path: &Path, m: &Manifest, above: f64, below: f64) -> Result<()> {
    if above + below > 1.5 * m.thickness_max_mm {
        return Err(Error::input(
            path,
            format!(
                "front and back heights sum to values {:.3} mm apart, found thickness_max_mm = {}; expected heights in mm towards each side's camera, the back's mirrored, so that all but the thickness cancels",
                above + below,
                m.thickness_max_mm
            ),
        ));
    }
    if below > 2.0 * above && below > 0.1 * m.thickness_max_mm {
        return Err(Error::input(
            path,
            format!(
                "the sum of front and back heights hangs {below:.3} mm below its median and rises {above:.3} mm over it; expected veins to stand out: heights are positive towards each side's camera"
            ),
        ));
    }
    Ok(())
}

/// Smoothed values on the mask; holes hold what the nearest values say, by ever wider smoothing.
fn filled(values: &[f64], mask: &[bool], width: usize, smoothing: f64) -> Vec<f64> {
    let weight: Vec<f64> = values.iter().zip(mask).map(|(v, m)| f64::from(u8::from(*m && v.is_finite()))).collect();
    let mut out = smooth(values, &weight, width, &Kernel::gaussian(smoothing));
    let mut wider = smoothing.max(0.5);
    while wider < values.len() as f64 && out.iter().zip(mask).any(|(v, m)| *m && !v.is_finite()) {
        wider *= 2.0;
        let more = smooth(values, &weight, width, &Kernel::gaussian(wider));
        out.iter_mut().zip(more).filter(|(v, _)| !v.is_finite()).for_each(|(v, m)| *v = m);
    }
    out.iter_mut().zip(mask).filter(|(_, m)| !**m).for_each(|(v, _)| *v = f64::NAN);
    out
}

/// Unit normals by central differences, one-sided beside the outline; NaN off the leaf.
fn normals(height: &[f64], mask: &[bool], width: usize, texel: f64) -> Vec<[f64; 3]> {
    let rows = height.len() / width;
    let on = |k: Option<usize>| k.filter(|&k| mask[k]);
    let slope = |k: usize, a: Option<usize>, b: Option<usize>| match (on(a), on(b)) {
        (Some(a), Some(b)) => 0.5 * (height[b] - height[a]) / texel,
        (Some(a), None) => (height[k] - height[a]) / texel,
        (None, Some(b)) => (height[b] - height[k]) / texel,
        (None, None) => 0.0,
    };
    (0..height.len())
        .map(|k| {
            if !mask[k] {
                return [f64::NAN; 3];
            }
            let (i, j) = (k % width, k / width);
            let x = slope(k, (i > 0).then(|| k - 1), (i + 1 < width).then_some(k + 1));
            let y = slope(k, (j + 1 < rows).then_some(k + width), (j > 0).then(|| k - width));
            let s = (1.0 + x * x + y * y).sqrt();
            [-x / s, -y / s, 1.0 / s]
        })
        .collect()
}

/// The first defect that applies. Light that comes through towards this camera fell on the other side: its albedo counts for energy.
fn status(side: &Side, other: &Side, pictures: &Pictures, mask: &[bool], holes: &[bool], thin: &[bool], width: usize) -> Vec<i16> {
    let entered = mirrored(&other.albedo, width);
    let entered_err = mirrored(&other.albedo_err, width);
    let common = other.highlight.stderr;
    (0..mask.len())
        .map(|k| {
            if !mask[k] {
                return OUTSIDE;
            }
            let (a, t) = (side.albedo[k], side.transmittance[k]);
            let three = |v: [f64; 3], f: &dyn Fn(f64, usize) -> bool| (0..3).any(|c| f(v[c], c));
            let defect = if pictures.saturated[k] {
                Some(Defect::Saturated)
            } else if a.iter().chain(&t).any(|v| !v.is_finite()) {
                Some(Defect::NoReading)
            } else if holes[k] {
                Some(Defect::Hole)
            } else if thin[k] {
                Some(Defect::Thickness)
            } else if three(t, &|t, c| t + entered[k][c] - 1.0 > 3.0 * entered_err[k][c].hypot(side.transmittance_err[k][c]).hypot(common))
            {
                Some(Defect::Energy)
            } else if three(a, &|a, c| a < -3.0 * side.albedo_err[k][c].hypot(side.highlight.stderr)) {
                Some(Defect::Dark)
            } else {
                None
            };
            defect.map_or(GOOD, Defect::code)
        })
        .collect()
}
