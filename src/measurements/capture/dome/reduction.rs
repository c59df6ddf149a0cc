//! Reduces a capture under a dome to maps: albedo, transmittance, thickness, heights and normals of both sides, with
//! standard errors and named defects (Habel 2009, §3.3.2; steps that the text leaves to tools are explicit here).
//! Lengths in mm, shares 0 … 1.
//!
//! - Albedo: (picture − dark)/(white − dark) · the sheet's reflectance, less the mirrored dome, divided by the share of
//!   the dome that the texel sees past the relief.
//! - Transmittance: (picture − dark)/(back light − dark). Its light fell on the *other* side.
//! - Thickness: the sum of both heights less its lean, with its highest place set to the caliper's reading.
//! - Normals: from smoothed heights by central differences.

use super::alignment::ScanAlignment;
use super::highlight::{self, Highlight};
use super::manifest::{DomeManifest, DomePicture};
use super::noise::deviation;
use super::reader::{DomeCapture, DomeSidePictures};
use super::shape::{filled, shape};
use super::visibility::visible;
use crate::lightbox::mask_from_transmission;
use crate::{Error, Result};
use mesophyll_base::image::ImageSize;
use mesophyll_base::rgb::Rgb;
use mesophyll_optics::defect::{Defect, GOOD, OUTSIDE};
use mesophyll_optics::side::{Side, Sides, mirror};
use mesophyll_optics::translucency::blade::{BladeMaps, SurfaceMaps};
use serde::Serialize;
use std::collections::BTreeMap;

/// The defects that a capture under a dome can have.
pub const DEFECTS: [Defect; 6] =
    [Defect::NoReading, Defect::Saturated, Defect::Hole, Defect::Thickness, Defect::Energy, Defect::Dark];

/// The options of the reduction.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options {
    /// Standard deviation of the smoothing of heights (mm). When absent, it is as narrow as the noise allows.
    pub smooth_mm: Option<f64>,
}

/// One side, row-major as its camera saw it; NaN off the leaf (normals: straight up).
#[derive(Debug, Clone)]
pub struct DomeSideMaps {
    /// Diffuse reflectance without the highlight, a channel.
    pub albedo: Vec<Rgb>,
    /// Standard error of the albedo from the photographs' noise. The error of the highlight is common to all texels
    /// ([`Highlight::stderr`]).
    pub albedo_err: Vec<Rgb>,
    /// Share of the back light that comes through towards this side's camera, a channel.
    pub transmittance: Vec<Rgb>,
    /// Standard error of the transmittance.
    pub transmittance_err: Vec<Rgb>,
    /// mm towards this side's camera over the blade's middle plane.
    pub height: Vec<f64>,
    /// Unit normals in this side's image frame.
    pub normal: Vec<[f64; 3]>,
    /// Share of the dome that a texel sees past the relief, weighted by the cosine.
    pub visible: Vec<f64>,
    /// The mirrored light of the dome that was subtracted from the albedo.
    pub highlight: Highlight,
    /// 1 good, 0 off the leaf, else a [`Defect`]'s code.
    pub status: Vec<i16>,
}

/// A whole capture as maps. `mask`, `thickness` and its error are in the front's columns.
#[derive(Debug, Clone)]
pub struct DomeMaps {
    /// Columns and rows of every map.
    pub size: ImageSize,
    /// Size of a texel on the blade (mm).
    pub texel_mm: f64,
    /// Texels on the leaf, in the front's columns.
    pub mask: Vec<bool>,
    /// mm; NaN off the leaf.
    pub thickness: Vec<f64>,
    /// Standard error of each texel's thickness from the scans' noise and the detail that smoothing removed. The error
    /// of the zero is common to all texels ([`ScanAlignment::offset_err_mm`]).
    pub thickness_err: Vec<f64>,
    /// How the two height scans lie relative to each other.
    pub alignment: ScanAlignment,
    /// Noise of the photographs.
    pub noise: PhotoNoise,
    /// The maps of both sides, each in its own camera's columns.
    pub sides: Sides<DomeSideMaps>,
}

/// Noise of a photograph's reading: √((relative·value)² + floor²).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PhotoNoise {
    /// The part that grows with the value, as a share of it.
    pub relative: f64,
    /// The part that every reading has.
    pub floor: f64,
    /// Whether `capture.toml` states it; otherwise it is estimated.
    pub stated: bool,
}

impl DomeMaps {
    /// How many texels of a side have each defect, by name. Defects that do not occur are left out.
    pub fn defects(&self, side: Side) -> BTreeMap<&'static str, usize> {
        let status = &self.sides[side].status;
        let count = |d: Defect| (d.name(), status.iter().filter(|s| **s == d.code()).count());
        DEFECTS.map(count).into_iter().filter(|(_, n)| *n > 0).collect()
    }

    /// A channel of a map of a side without holes, row-major as its camera saw it. Texels without a reading, dark ones
    /// and those that break energy take values from their neighbours; 0 off the leaf.
    fn whole(&self, side: &DomeSideMaps, map: &[Rgb], channel: usize) -> Vec<f64> {
        let broken = [Defect::NoReading, Defect::Saturated, Defect::Energy, Defect::Dark].map(Defect::code);
        let on: Vec<bool> = side.status.iter().map(|s| *s != OUTSIDE).collect();
        let values: Vec<f64> =
            map.iter().zip(&side.status).map(|(v, s)| if broken.contains(s) { f64::NAN } else { v[channel] }).collect();
        filled(&values, &on, self.size.width, 0.0)
            .into_iter()
            .map(|v| if v.is_finite() { v.clamp(0.0, 1.0) } else { 0.0 })
            .collect()
    }

    /// Albedo of a side in a channel (0 red … 2 blue), 0 … 1; without holes, 0 off the leaf.
    pub fn albedo(&self, side: Side, channel: usize) -> Vec<f64> {
        self.whole(&self.sides[side], &self.sides[side].albedo, channel)
    }

    /// Transmittance towards the camera of a side (the light fell on the other side), without holes, 0 off the leaf.
    pub fn transmittance(&self, side: Side, channel: usize) -> Vec<f64> {
        self.whole(&self.sides[side], &self.sides[side].transmittance, channel)
    }

    /// The blade in one channel, ready for light transport: the share 1 − albedo of each side enters it. Texels without
    /// a positive thickness take their neighbours' thickness.
    pub fn blade(&self, channel: usize) -> BladeMaps {
        let positive: Vec<f64> = self.thickness.iter().map(|d| if *d > 0.0 { *d } else { f64::NAN }).collect();
        let thickness = filled(&positive, &self.mask, self.size.width, 0.0);
        let surface = |s: Side| {
            let side = &self.sides[s];
            let height = side.height.iter().map(|h| if h.is_finite() { *h } else { 0.0 }).collect();
            SurfaceMaps {
                height,
                normal: side.normal.clone(),
                entry: self.albedo(s, channel).into_iter().map(|a| 1.0 - a).collect(),
            }
        };
        BladeMaps {
            width: self.size.width,
            height: self.size.height,
            texel_mm: self.texel_mm,
            mask: self.mask.clone(),
            thickness: thickness.into_iter().map(|d| if d.is_finite() { d } else { 0.0 }).collect(),
            front: surface(Side::Front),
            back: surface(Side::Back),
        }
    }
}

/// Reduces an open capture.
///
/// # Errors
/// [`Error::Input`] when the pictures do not show one leaf: outlines that do not match, heights that do not cancel or
/// have the wrong sign, no texel on the leaf.
pub fn reduce(capture: &DomeCapture, options: &Options) -> Result<DomeMaps> {
    let m = &capture.manifest;
    let (w, h) = (m.width, m.height);
    let noise = photo_noise(capture);
    let ratio = |leaf: &[Rgb<f32>], reference: &[Rgb<f32>]| quotient(leaf, reference, noise, m, capture.has_dark);
    let through = Sides::of(|side| ratio(&capture.sides[side].translucency, &capture.empty));
    let mask = outline(capture, &through)?;
    let masks = Sides { front: mask.clone(), back: mirror(&mask, w) };

    let shape = shape(capture, &mask, options)?;
    let heights = [&shape.height.front, &shape.height.back].map(Clone::clone);
    let bare = BladeMaps::from_heights(w, h, m.texel_mm, mask.clone(), heights, [Vec::new(), Vec::new()]);
    let mut sides = Sides::of(|name| {
        let (pictures, mask) = (&capture.sides[name], &masks[name]);
        let lit = bare.lit(name);
        let (seen, normal) = (visible(&lit), lit.surface.normal.clone());
        let (mut albedo, mut albedo_err) = ratio(&pictures.albedo, &capture.white);
        albedo.iter_mut().chain(&mut albedo_err).for_each(|v| *v *= m.white_reflectance);
        let highlight = highlight::estimate(&albedo, mask, m.highlight_index.map(|n| n[name as usize]));
        for (k, (a, e)) in albedo.iter_mut().zip(&mut albedo_err).enumerate() {
            *a = if mask[k] { (*a - highlight.share) / seen[k] } else { Rgb::splat(f64::NAN) };
            *e = if mask[k] { *e / seen[k] } else { Rgb::splat(f64::NAN) };
        }
        let off = |map: &[Rgb]| map.iter().zip(mask).map(|(v, m)| if *m { *v } else { Rgb::splat(f64::NAN) }).collect();
        DomeSideMaps {
            albedo,
            albedo_err,
            transmittance: off(&through[name].0),
            transmittance_err: off(&through[name].1),
            height: shape.height[name].clone(),
            normal,
            visible: seen,
            highlight,
            status: Vec::new(),
        }
    });
    let own = |name: Side, map: &[bool]| if name == Side::Front { map.to_vec() } else { mirror(map, w) };
    let behind = mirror(&capture.sides.back.height, w);
    let holes: Vec<bool> =
        capture.sides.front.height.iter().zip(behind).map(|(a, b)| !(a.is_finite() && b.is_finite())).collect();
    let thin: Vec<bool> = shape.thickness.iter().map(|d| *d <= 0.0).collect();
    let found = Sides::of(|name| {
        let pictures = &capture.sides[name];
        status([&sides[name], &sides[name.other()]], pictures, &masks[name], &own(name, &holes), &own(name, &thin), w)
    });
    sides.front.status = found.front;
    sides.back.status = found.back;
    Ok(DomeMaps {
        size: m.size(),
        texel_mm: m.texel_mm,
        thickness_err: mask.iter().map(|m| if *m { shape.alignment.thickness_error_mm } else { f64::NAN }).collect(),
        mask,
        thickness: shape.thickness,
        alignment: shape.alignment,
        noise,
        sides,
    })
}

/// The stated noise; otherwise the noise seen in the front's green photograph under the dome, which is all taken as a
/// floor.
fn photo_noise(capture: &DomeCapture) -> PhotoNoise {
    let m = &capture.manifest;
    if m.noise_relative.is_some() || m.noise_floor.is_some() {
        return PhotoNoise {
            relative: m.noise_relative.unwrap_or(0.0),
            floor: m.noise_floor.unwrap_or(0.0),
            stated: true,
        };
    }
    let green: Vec<f64> = capture.sides.front.albedo.iter().map(|v| f64::from(v[1])).collect();
    let mask = capture.mask.clone().unwrap_or_else(|| vec![true; green.len()]);
    let floor = deviation(&green, &mask, m.width).map_or(0.0, |(sd, _)| sd);
    PhotoNoise { relative: 0.0, floor, stated: false }
}

/// picture/reference and its standard error; the dark level was already subtracted from both. NaN where the reference
/// shows no light.
fn quotient(
    picture: &[Rgb<f32>],
    reference: &[Rgb<f32>],
    noise: PhotoNoise,
    m: &DomeManifest,
    dark: bool,
) -> (Vec<Rgb>, Vec<Rgb>) {
    let shots = f64::from(m.reference_shots);
    let variance = |v: f64| (noise.relative * v).powi(2) + noise.floor.powi(2);
    let dark = if dark { noise.floor.powi(2) / shots } else { 0.0 };
    let texel = |p: f32, r: f32| {
        let (p, r) = (f64::from(p), f64::from(r));
        if !(r > 0.0 && p.is_finite()) {
            return (f64::NAN, f64::NAN);
        }
        let q = p / r;
        // The same dark frame is subtracted from both.
        (q, (variance(p) + q * q * variance(r) / shots + (1.0 - q).powi(2) * dark).sqrt() / r)
    };
    picture.iter().zip(reference).map(|(p, r)| p.zip(*r, texel).unzip()).unzip()
}

/// `mask.exr`, or the texels that darken the back light on both sides. Also checks that the outlines of both sides are
/// those of one leaf. `through` is what came through each side.
fn outline(capture: &DomeCapture, through: &Sides<(Vec<Rgb>, Vec<Rgb>)>) -> Result<Vec<bool>> {
    let w = capture.manifest.width;
    let seen = Sides::of(|side| {
        let ratio: Vec<Rgb<f32>> = through[side].0.iter().map(|v| v.map(|v| v as f32)).collect();
        mask_from_transmission(&ratio, capture.manifest.size())
    });
    let path = |side| DomePicture::Translucency.path(&capture.folder, side);
    for (side, seen) in seen.iter() {
        if !seen.contains(&true) {
            return Err(Error::input(
                &path(side),
                "no texel is darker than the back light without the leaf, so no leaf is seen",
            ));
        }
    }
    let (front, back) = (&seen.front, mirror(&seen.back, w));
    let compare = |side, seen: &[bool], mask: &[bool], what: &str| {
        let (fits, turned) = (overlap(seen, mask), overlap(&mirror(seen, w), mask));
        if turned > fits + 0.1 {
            return Err(Error::input(
                &path(side),
                format!(
                    "the leaf's outline is the mirror image of {what} ({:.0} % overlap, mirrored {:.0} %); expected \
                     the back's pictures mirrored, and each side's in its own folder",
                    100.0 * fits,
                    100.0 * turned
                ),
            ));
        }
        if fits < 0.8 {
            return Err(Error::input(
                &path(side),
                format!(
                    "the leaf's outline overlaps {what} by {:.0} % only; expected one leaf that stays in place",
                    100.0 * fits
                ),
            ));
        }
        Ok(())
    };
    match &capture.mask {
        Some(mask) => {
            compare(Side::Front, front, mask, "mask.exr")?;
            compare(Side::Back, &back, mask, "mask.exr")?;
            Ok(mask.clone())
        }
        None => {
            compare(Side::Back, &back, front, "the front's")?;
            Ok(front.iter().zip(&back).map(|(f, b)| *f && *b).collect())
        }
    }
}

/// The number of texels in both masks over the number in either.
fn overlap(a: &[bool], b: &[bool]) -> f64 {
    let both = a.iter().zip(b).filter(|(a, b)| **a && **b).count();
    let either = a.iter().zip(b).filter(|(a, b)| **a || **b).count();
    both as f64 / either.max(1) as f64
}

/// The first defect that applies. Light that comes through towards this camera fell on the other side, so that side's
/// albedo is used in the check of energy.
fn status(
    [side, other]: [&DomeSideMaps; 2],
    pictures: &DomeSidePictures,
    mask: &[bool],
    holes: &[bool],
    thin: &[bool],
    width: usize,
) -> Vec<i16> {
    let entered = mirror(&other.albedo, width);
    let entered_err = mirror(&other.albedo_err, width);
    let common = other.highlight.stderr;
    (0..mask.len())
        .map(|k| {
            if !mask[k] {
                return OUTSIDE;
            }
            let (a, t) = (side.albedo[k], side.transmittance[k]);
            let three = |v: Rgb, f: &dyn Fn(f64, usize) -> bool| (0..3).any(|c| f(v[c], c));
            let defect = if pictures.saturated[k] {
                Some(Defect::Saturated)
            } else if a.iter().chain(&t).any(|v| !v.is_finite()) {
                Some(Defect::NoReading)
            } else if holes[k] {
                Some(Defect::Hole)
            } else if thin[k] {
                Some(Defect::Thickness)
            } else if three(t, &|t, c| {
                t + entered[k][c] - 1.0 > 3.0 * entered_err[k][c].hypot(side.transmittance_err[k][c]).hypot(common)
            }) {
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
