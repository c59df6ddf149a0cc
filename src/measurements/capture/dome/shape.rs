//! Turns two height scans of a capture into the blade's shape: thickness, and both sides' heights over one middle plane
//! (mm), with holes filled. Checks that the scans show one blade, each with heights towards its own camera.

use super::alignment::{self, ScanAlignment, SmoothingGoal};
use super::manifest::{DomeManifest, DomePicture};
use super::reader::DomeCapture;
use super::reduction::Options;
use super::smoothing::{SmoothingKernel, smooth};
use crate::{Error, Result};
use mesophyll_base::image::ImageSize;
use mesophyll_base::statistics::quantile;
use mesophyll_optics::side::{Side, Sides, mirror};
use std::path::Path;

/// Thickness (front's columns) and both sides' smoothed heights over the middle plane.
pub struct BladeShape {
    pub thickness: Vec<f64>,
    pub height: Sides<Vec<f64>>,
    pub alignment: ScanAlignment,
}

/// Aligns the scans, sets the zero of the thickness and smooths.
///
/// # Errors
/// [`Error::Input`] when the scans hold too little, do not cancel except for a thickness, or have the wrong sign.
pub fn shape(capture: &DomeCapture, mask: &[bool], options: &Options) -> Result<BladeShape> {
    let m = &capture.manifest;
    let (size, w) = (m.size(), m.width);
    let path = DomePicture::Height.path(&capture.folder, Side::Back);
    let scanned = |side: Side| capture.sides[side].height.iter().map(|z| f64::from(*z)).collect::<Vec<_>>();
    let mut scans = Sides { front: scanned(Side::Front), back: mirror(&scanned(Side::Back), w) };
    let sums = scans.front.iter().zip(&scans.back).zip(mask);
    let sum: Vec<f64> = sums.map(|((a, b), m)| if *m { a + b } else { f64::NAN }).collect();
    let lean = alignment::plane(&sum, mask, size).ok_or_else(|| {
        Error::input(
            &path,
            "fewer than 16 texels of the leaf have a height on both sides; expected heights all over it",
        )
    })?;
    let rest: Vec<f64> = sum.iter().enumerate().map(|(k, v)| v - lean.at(k, size)).collect();

    let filter = SmoothingKernel::gaussian(m.height_filter_mm / m.texel_mm);
    let noise = m.height_noise_mm.or_else(|| alignment::height_noise(&rest, mask, w, &filter)).unwrap_or(0.0);
    let forced = options.smooth_mm.map(|s| s / m.texel_mm);
    let thin = alignment::best_width(&rest, w, &filter, 2f64.sqrt() * noise, SmoothingGoal::Values, forced);
    let flat = Side::ALL.map(|side| {
        let on: Vec<f64> = scans[side].iter().zip(mask).map(|(v, m)| if *m { *v } else { f64::NAN }).collect();
        alignment::best_width(&on, w, &filter, noise, SmoothingGoal::Slopes, forced)
    });
    let weight: Vec<f64> = rest.iter().map(|v| f64::from(u8::from(v.is_finite()))).collect();
    let calm = smooth(&rest, &weight, w, &SmoothingKernel::gaussian(thin.texels.max(0.7)));
    let (above, below) = reach(&calm, mask, 2f64.sqrt() * noise)
        .ok_or_else(|| Error::input(&path, "no texel of the leaf has a height on both sides"))?;
    one_blade(&path, m, above, below)?;

    let top = alignment::highest(&rest, w, &filter, m.contact_texels(), 2f64.sqrt() * noise);
    let (shift_mm, shift_err_mm) = alignment::shift(&rest, &scans.front, mask, size, m.texel_mm);
    let trend = alignment::trend_err(&rest, mask, size, top.at);
    let offset = m.thickness_max_mm - top.value;
    let filled = |values: &[f64], width: f64| filled(values, mask, w, width);
    let thickness: Vec<f64> = filled(&rest, thin.texels).into_iter().map(|v| v + offset).collect();
    // The back scan gets all of the lean. The middle plane is the front's mean less half the thickness.
    let mean = |map: &[f64]| {
        let (sum, n) = (0..map.len())
            .filter(|&k| mask[k] && map[k].is_finite())
            .fold((0.0, 0usize), |(s, n), k| (s + map[k], n + 1));
        sum / n.max(1) as f64
    };
    let half = 0.5 * mean(&thickness);
    let zero = mean(&scans.front) - half;
    scans.front.iter_mut().for_each(|v| *v -= zero);
    scans.back.iter_mut().enumerate().for_each(|(k, v)| *v += zero + offset - lean.at(k, size));
    let height =
        Sides { front: filled(&scans.front, flat[0].texels), back: mirror(&filled(&scans.back, flat[1].texels), w) };
    let [x, y] = lean.lean();
    let alignment = ScanAlignment {
        tilt: [x / m.texel_mm, y / m.texel_mm],
        shift_mm,
        shift_err_mm,
        offset_mm: offset - lean.at(0, ImageSize::new(1, 1)),
        offset_err_mm: top.error.hypot(trend).hypot(m.thickness_max_err_mm.unwrap_or(0.0)),
        trend_err_mm: trend,
        raised_mm: top.raised,
        height_noise_mm: noise,
        noise_stated: m.height_noise_mm.is_some(),
        smooth_thickness_mm: thin.texels * m.texel_mm,
        smooth_height_mm: flat.map(|f| f.texels * m.texel_mm),
        thickness_noise_mm: thin.noise,
        slope_noise: flat.map(|f| f.noise / m.texel_mm),
        thickness_error_mm: thin.error,
        slope_error: flat.map(|f| f.error / m.texel_mm),
        above_mm: above,
        below_mm: below,
    };
    Ok(BladeShape { thickness, height, alignment })
}

/// How far a map reaches above and below its median on the mask, less what noise of this deviation alone would cause.
/// One texel in a thousand is left out at each end.
fn reach(values: &[f64], mask: &[bool], noise: f64) -> Option<(f64, f64)> {
    let mut all: Vec<f64> = values.iter().zip(mask).filter(|(v, m)| **m && v.is_finite()).map(|(v, _)| *v).collect();
    let [low, middle, high] = [0.001, 0.5, 0.999].map(|q| quantile(&mut all, q));
    let (low, middle, high) = (low?, middle?, high?);
    // Three deviations of the noise that the smoothing leaves, which is about a quarter of the noise.
    let slack = 0.75 * noise;
    Some(((high - middle - slack).max(0.0), (middle - low - slack).max(0.0)))
}

/// The heights of one blade cancel except for its thickness, and veins make it thicker, not thinner.
fn one_blade(path: &Path, m: &DomeManifest, above: f64, below: f64) -> Result<()> {
    if above + below > 1.5 * m.thickness_max_mm {
        return Err(Error::input(
            path,
            format!(
                "front and back heights sum to values {:.3} mm apart, found thickness_max_mm = {}; expected heights in \
                 mm towards each side's camera, the back's mirrored, so that all but the thickness cancels",
                above + below,
                m.thickness_max_mm
            ),
        ));
    }
    if below > 2.0 * above && below > 0.1 * m.thickness_max_mm {
        return Err(Error::input(
            path,
            format!(
                "the sum of front and back heights hangs {below:.3} mm below its median and rises {above:.3} mm over \
                 it; expected veins to stand out: heights are positive towards each side's camera"
            ),
        ));
    }
    Ok(())
}

/// Smoothed values on the mask. Holes are filled from the nearest values by wider and wider smoothing.
pub fn filled(values: &[f64], mask: &[bool], width: usize, smoothing: f64) -> Vec<f64> {
    let weight: Vec<f64> = values.iter().zip(mask).map(|(v, m)| f64::from(u8::from(*m && v.is_finite()))).collect();
    let mut out = smooth(values, &weight, width, &SmoothingKernel::gaussian(smoothing));
    let mut wider = smoothing.max(0.5);
    while wider < values.len() as f64 && out.iter().zip(mask).any(|(v, m)| *m && !v.is_finite()) {
        wider *= 2.0;
        let more = smooth(values, &weight, width, &SmoothingKernel::gaussian(wider));
        out.iter_mut().zip(more).filter(|(v, _)| !v.is_finite()).for_each(|(v, m)| *v = m);
    }
    out.iter_mut().zip(mask).filter(|(_, m)| !**m).for_each(|(v, _)| *v = f64::NAN);
    out
}
