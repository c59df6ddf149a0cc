//! Faults of the light box's photographs, and frames that hold too few values.

use super::transmittance::{THROUGH, TransmittanceView, against_frames, energy, fault, moved_box, turned};
use crate::Result;
use crate::leaf::interior::LeafSideFit;
use crate::leaf::noise::CameraNoise;
use crate::record::fault::{FaultGrade, MeasurementFault};
use mesophyll_base::image::ImageSize;
use mesophyll_base::statistics::median_of;
use mesophyll_capture::reader::TubeCapture;
use mesophyll_files::image::read_exr_rows;
use std::collections::HashSet;

/// Beside the leaf the box is as bright with it as without, up to this share: it is the same light.
const LIGHT: f64 = 0.02;
/// Texels that must lie beside the leaf for that.
const BESIDE: usize = 40;
/// A photograph with so large a share of its texels at exactly its largest value is saturated.
const SATURATED: f64 = 0.05;
/// … and so many times as many as at the next smaller value.
const PILED: usize = 4;
/// Frames of 8 bits hold at most this many different values.
const LEVELS: usize = 280;

/// Looks at the photographs of the light box, and at the values that the frames hold.
///
/// # Errors
/// Photographs that cannot be read.
pub fn look(capture: &TubeCapture, level: &CameraNoise, sides: &[LeafSideFit]) -> Result<Vec<MeasurementFault>> {
    let mut out = Vec::new();
    let m = &capture.manifest;
    let names: Vec<&str> = sides.iter().map(|s| s.side.name()).collect();
    let empty = capture.folder.join("lightbox_empty.exr");
    for fitted in sides {
        let side = fitted.side.name();
        let name = format!("{side}/lightbox.exr");
        out.extend(coarse(capture, fitted)?);
        let leaf = capture.folder.join(side).join("lightbox.exr");
        let tops = [(&leaf, name.as_str(), vec![side]), (&empty, "lightbox_empty.exr", names.clone())];
        let mut saturated = false;
        for (path, called, whom) in tops {
            let maps = read_exr_rows(path, Some(&["R", "G", "B"]), None)?;
            let share = maps.channels.iter().map(|(_, v)| at_the_top(v)).fold(0.0, f64::max);
            saturated |= share > SATURATED;
            if share > SATURATED && !out.iter().any(|f: &MeasurementFault| f.says.starts_with(called)) {
                out.push(fault(
                    "box-saturated",
                    FaultGrade::Wrong,
                    &whom,
                    &THROUGH,
                    format!(
                        "{called}: {:.0} % of the texels have exactly the largest value: the photograph is saturated, \
                         and ρt is too large where the box is cut off",
                        100.0 * share
                    ),
                ));
            }
        }
        if !saturated {
            out.extend(against_frames(fitted, m.width).or_else(|| beside(fitted, m.width, level)));
        }
        out.extend(energy(side, &fitted.mask));
    }
    // A photograph that does not fit its own frames does not fit that of the other side either.
    let known = out.iter().any(|f| ["box-mirrored", "box-shifted"].contains(&f.name.as_str()));
    if let ([front, back], false) = (sides, known) {
        let turned =
            || turned(&TransmittanceView::of(front), &TransmittanceView::of(back), m.width, "back/lightbox.exr");
        out.extend(moved_box([front, back], m.width).or_else(turned));
    }
    Ok(out)
}

/// Share of the values that equal the largest one, where they pile up there: 0 where the next smaller value is about as
/// frequent, as in a picture of few values.
fn at_the_top(values: &[f32]) -> f64 {
    let finite = || values.iter().copied().filter(|v| v.is_finite());
    let top = finite().fold(f32::NEG_INFINITY, f32::max);
    let next = finite().filter(|v| *v < top).fold(f32::NEG_INFINITY, f32::max);
    let count = |of: f32| finite().filter(|v| *v == of).count();
    let (at_top, below) = (count(top), count(next));
    if below > 0 && at_top > PILED * below { at_top as f64 / finite().count() as f64 } else { 0.0 }
}

/// The light beside the leaf, with it and without.
fn beside(fitted: &LeafSideFit, width: usize, level: &CameraNoise) -> Option<MeasurementFault> {
    let mask = &fitted.measured.mask;
    let size = ImageSize::new(width, mask.len() / width);
    let clear = |k: usize| {
        let [i, j] = size.position(k).map(|v| v as i64);
        (-2..=2).all(|b| (-2..=2).all(|a| size.texel([i + a, j + b]).is_none_or(|at| !mask[at])))
    };
    let places: Vec<usize> = (0..mask.len()).filter(|k| clear(*k)).collect();
    let ratios: Vec<f64> = places
        .iter()
        .map(|k| fitted.measured.rho_t[*k].iter().map(|v| f64::from(*v)).sum::<f64>() / 3.0)
        .filter(|v| v.is_finite())
        .collect();
    if ratios.len() < BESIDE {
        return None;
    }
    let error = level.relative * level.lightbox * 2.0 / (ratios.len() as f64).sqrt();
    let ratio = median_of(ratios).unwrap_or(f64::NAN);
    // Paper or cloth may cover the box beside the leaf; then nothing can be said.
    if !(0.5..2.0).contains(&ratio) || (ratio - 1.0).abs() <= LIGHT.max(6.0 * error) {
        return None;
    }
    let side = fitted.side.name();
    Some(fault(
        "box-exposure",
        FaultGrade::Wrong,
        &[side],
        &THROUGH,
        format!(
            "{side}/lightbox.exr: beside the leaf the box is {ratio:.3} times as bright as in lightbox_empty.exr (its \
             light or the exposure changed between the two); every ρt is off by as much"
        ),
    ))
}

/// Frames that hold few different values.
fn coarse(capture: &TubeCapture, fitted: &LeafSideFit) -> Result<Option<MeasurementFault>> {
    let m = &capture.manifest;
    for pass in &m.passes {
        let count = pass.positions().len();
        let mut seen: HashSet<u32> = HashSet::new();
        let mut readings = 0usize;
        // The frames in the middle of the pass are among the bright ones.
        for k in (0..5).map(|k| count * (3 + k) / 10) {
            let path = mesophyll_capture::manifest::frame_path(&capture.folder, fitted.side, pass.name, k);
            let rows = m.height / 2..(m.height / 2 + 1 + 4096 / m.width.max(1)).min(m.height);
            let maps = read_exr_rows(&path, Some(&["R", "G", "B"]), Some(rows.clone()))?;
            for (_, values) in &maps.channels {
                for (at, v) in values.iter().enumerate() {
                    if fitted.measured.mask[rows.start * m.width + at] && v.is_finite() {
                        readings += 1;
                        seen.insert(v.to_bits());
                    }
                }
            }
        }
        if readings >= 600 && seen.len() <= LEVELS && seen.len() * 4 < readings {
            let side = fitted.side.name();
            return Ok(Some(fault(
                "few-values",
                FaultGrade::Doubtful,
                &[side],
                &[],
                format!(
                    "{side}/{}: the frames hold only {} different values among {readings} readings: they were stored \
                     with 8 bits or fewer, and their rounding is no noise",
                    pass.name.name(),
                    seen.len()
                ),
            )));
        }
    }
    Ok(None)
}
