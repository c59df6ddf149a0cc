//! What further frames of a scan would bring: the measurement to make next where the gloss is not determined.

use super::leaf::{TubeDesignOptions, finished, places, some};
use super::tube::{DesignTexel, GlossFitTruth, TexelQuantity, TubeDesign};
use crate::gloss::GlossFitDevice;
use crate::leaf::interior::LeafSideFit;
use crate::leaf::noise::CameraNoise;
use crate::leaf::texels;
use crate::record::next::{DETERMINED, NextMeasurement};
use mesophyll_base::selection::{DesignChoice, DesignProblem};
use mesophyll_base::statistics::median_of;
use mesophyll_capture::reader::TubeCapture;
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::tube::Travel;

/// Texels a side.
const TEXELS: usize = 16;
/// Numbers of further frames that are thought of.
const MORE: [usize; 8] = [4, 8, 12, 16, 24, 36, 60, 100];

/// The fewest further frames that bring the median texel's m and ρs to 10 %, or what a hundred would bring. `None`
/// where they are determined, by the fit's own errors, and where no texel can be planned for.
pub fn next(
    capture: &TubeCapture,
    device: &GlossFitDevice,
    level: &CameraNoise,
    sides: &[LeafSideFit],
) -> Option<NextMeasurement> {
    if sides.iter().all(is_determined) {
        return None;
    }
    let options =
        TubeDesignOptions { lobe: device.lobe, ..TubeDesignOptions::of(vec![TexelQuantity::RhoS, TexelQuantity::M]) };
    let texels: Vec<DesignTexel> = sides.iter().flat_map(|side| of_side(capture, level, side)).collect();
    if texels.is_empty() {
        return None;
    }
    let (at, taken) = places(&capture.manifest, &options, true);
    let mut design = finished(device.clone(), at, texels, &options);
    design.taken = taken;
    let problem = design.problem();
    let (quantity, now) = worst(&problem, &problem.judge(&design.taken)?)?;
    if now <= DETERMINED {
        return None;
    }
    let mut best = None;
    for more in MORE {
        let choice = design.choose(&problem, design.taken.len() + more).ok()??;
        let (_, then) = worst(&problem, &choice)?;
        let done = then <= DETERMINED;
        best = Some((more, choice, then));
        if done {
            break;
        }
    }
    let (more, choice, then) = best?;
    let sentence = format!(
        "{quantity} of the median texel is known to {:.0} %; {more} more frames {} would bring it to {:.0} %",
        100.0 * now,
        where_they_stand(&design, &choice),
        100.0 * then
    );
    Some(NextMeasurement { quantity, error_now: now, error_then: then, sentence })
}

/// Whether the fit's own errors say that ρs and m of the side's median texel are determined. Only where they do not,
/// the light of further frames is worth computing.
fn is_determined(side: &LeafSideFit) -> bool {
    let median = |plane: &[f32]| median_of(side.texels.iter().filter_map(|t| plane.get(t.at)).map(|v| f64::from(*v)));
    let known = |quantity: Quantity, c: usize| {
        let value = side.maps.get(&quantity.channel(c)).and_then(median);
        let error = median(texels::error(&side.maps, quantity, c));
        value.zip(error).is_some_and(|(value, error)| error <= DETERMINED * value.abs())
    };
    (0..3).all(|c| known(Quantity::RhoS, c)) && known(Quantity::M, 0)
}

/// The worst of m and of ρs in its channels, with its error as a share of the median value.
fn worst(problem: &DesignProblem, choice: &DesignChoice) -> Option<(String, f64)> {
    let value = |k: usize| median_of(problem.situations.iter().map(|s| s.values[k].abs()));
    let wanted = (0..problem.parameters.len()).filter(|k| problem.parameters[*k].wanted);
    let shares = wanted.filter_map(|k| Some((problem.parameters[k].name.clone(), choice.errors[k] / value(k)?)));
    shares.filter(|(_, share)| share.is_finite()).max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Where the new frames of a choice stand, in words.
fn where_they_stand(design: &TubeDesign, choice: &DesignChoice) -> String {
    let new = |pass| -> Vec<f64> {
        let chosen = design.of(&choice.chosen, pass).into_iter().filter(|k| !design.taken.contains(k));
        chosen.map(|k| design.places[k].position_mm).collect()
    };
    let one = |pass: Travel| {
        let at = new(pass);
        let (least, most) = at.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        (!at.is_empty()).then(|| format!("with the tube between {least:.0} and {most:.0} mm in pass {}", pass.name()))
    };
    [Travel::X, Travel::Y].into_iter().filter_map(one).collect::<Vec<_>>().join(" and ")
}

/// Good texels of a side, as they were fitted.
fn of_side(capture: &TubeCapture, level: &CameraNoise, side: &LeafSideFit) -> Vec<DesignTexel> {
    let width = capture.manifest.width;
    let three = |q| side.maps.three(q);
    let (Some(d), Some(s), Some(n), Some(m)) =
        (three(Quantity::RhoD), three(Quantity::RhoS), three(Quantity::Normal), side.maps.scalar(Quantity::M))
    else {
        return Vec::new();
    };
    let good: Vec<usize> = side.texels.iter().map(|t| t.at).collect();
    let at = some(&good, TEXELS);
    let places: Vec<[u32; 2]> = at.iter().map(|k| [(k % width) as u32, (k / width) as u32]).collect();
    let noise = level.readings(capture, &places);
    let texel = |(k, noise)| {
        let of = |planes: [&[f32]; 3]| planes.map(|p: &[f32]| f64::from(p[k]));
        let normal = of(n);
        let truth = GlossFitTruth {
            rho_d: of(d),
            rho_s: of(s),
            m: f64::from(m[k]),
            tilt: [normal[0].atan2(normal[2]), normal[1].clamp(-1.0, 1.0).asin()],
        };
        let finite = truth.rho_d.iter().chain(&truth.rho_s).chain([&truth.m]).all(|v| v.is_finite());
        let at_mm = capture.manifest.texel_position([k % width, k / width].map(|n| n as u32));
        (finite && truth.rho_s.iter().all(|v| *v > 0.0)).then_some(DesignTexel { at_mm, truth, noise })
    };
    at.into_iter().zip(noise).filter_map(texel).collect()
}
