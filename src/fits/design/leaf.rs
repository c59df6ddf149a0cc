//! The texels that the design of a scan has to serve: those of a leaf that a specification describes, or those that a
//! first scan shows.

use super::tube::{DesignTexel, GlossFitTruth, LEAST_FRAMES, TexelQuantity, TubeDesign, TubePlace};
use crate::gloss::{GlossFitDevice, GlossTexelFitter};
use crate::leaf::held_out::{FrameSplits, HoldOutRule};
use crate::leaf::{noise, side::SideTransmittance};
use crate::{Error, Result};
use mesophyll_base::rgb::Rgb;
use mesophyll_capture::manifest::TubeManifest;
use mesophyll_capture::reader::TubeCapture;
use mesophyll_files::progress::go_on;
use mesophyll_files::table::{BatchSpec, Groups, InputTable};
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::side::Side;
use mesophyll_optics::tube::{Travel, Tube};
use mesophyll_synth::leaf::SyntheticLeaf;
use mesophyll_synth::spec::LeafSpec;
use std::path::Path;

/// Texels a leaf, of both sides together.
const TEXELS: usize = 64;
/// Rows of a scan from which texels are taken; each costs a read of every frame.
const ROWS: usize = 8;
/// Size of the image of a leaf that is grown only to be planned for.
const GROWN: (usize, usize) = (120, 90);

/// What a design of a scan is made with, beside the leaf.
#[derive(Debug, Clone, PartialEq)]
pub struct TubeDesignOptions {
    /// What it is for.
    pub wanted: Vec<TexelQuantity>,
    /// The gloss lobe.
    pub lobe: Lobe,
    /// Places a pass that the tube can take; `None`: those of the capture's frames, or 100.
    pub candidates: Option<usize>,
    /// The passes; empty: all that there are.
    pub passes: Vec<Travel>,
    /// Relative noise of a reading, for a leaf that nobody scanned.
    pub noise: f64,
    /// Ranges that take the place of the leaf's own values.
    pub ranges: Vec<TexelRange>,
    /// Angle of the camera from the vertical (degrees); `None`: the device's.
    pub camera_deg: Option<f64>,
    /// The exposure over that of the device: the floor of the noise is divided by it.
    pub exposure: f64,
}

/// Values that a quantity of the texels takes, evenly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexelRange {
    /// Which quantity; the normal's is the tilt (degrees) in either direction.
    pub quantity: TexelQuantity,
    /// Least and largest value.
    pub range: [f64; 2],
}

/// A device as it is planned for.
struct PlannedDevice<'a> {
    tube: Tube,
    camera_deg: f64,
    noise: [f64; 2],
    options: &'a TubeDesignOptions,
}

impl PlannedDevice<'_> {
    fn fitted(&self) -> GlossFitDevice {
        let camera = self.options.camera_deg.unwrap_or(self.camera_deg).to_radians();
        GlossFitDevice {
            height_mm: self.tube.height_mm,
            length_mm: self.tube.length_mm,
            radius_mm: self.tube.radius_mm,
            camera: [camera.sin(), 0.0, camera.cos()],
            lobe: self.options.lobe,
            noise_relative: self.noise[0],
            noise_floor: self.noise[1] / self.options.exposure,
        }
    }
}

/// The design for a leaf that a specification describes.
///
/// # Errors
/// [`Error::Input`] where the specification is wrong or has no texel.
pub fn of_specification(path: &Path, options: &TubeDesignOptions) -> Result<TubeDesign> {
    let spec = LeafSpec::read(path)?;
    let leaf = SyntheticLeaf::grow(&spec, spec.truth(path, None)?, GROWN.0, GROWN.1)
        .ok_or_else(|| Error::field(path, "outline", "not one texel of the field lies on the blade"))?;
    let noise = [options.noise, spec.device.noise_floor];
    let planned = PlannedDevice { tube: spec.device.tube, camera_deg: spec.device.camera_deg, noise, options };
    let device = planned.fitted();
    let all = [Travel::X, Travel::Y];
    let passes = all.iter().filter(|t| options.passes.is_empty() || options.passes.contains(t)).map(|travel| {
        let range = if *travel == Travel::X { spec.device.travel_x_mm } else { spec.device.travel_y_mm };
        (*travel, ramp(range, options.candidates.unwrap_or(100), None))
    });
    let places =
        passes.flat_map(|(pass, list)| list.into_iter().map(move |position_mm| TubePlace { pass, position_mm }));
    let mut texels = Vec::new();
    for (side, maps) in leaf.sides.iter() {
        let mask = leaf.mask_of(side);
        let on: Vec<usize> = (0..mask.len()).filter(|k| mask[*k] && maps[*k].normal[2] > 0.2).collect();
        for k in some(&on, TEXELS / 2) {
            let n = maps[k].normal.map(f64::from);
            texels.push(DesignTexel {
                at_mm: leaf.size.place_mm(leaf.texel_mm, k),
                truth: GlossFitTruth {
                    rho_d: maps[k].rho_d.0.map(f64::from),
                    rho_s: [f64::from(maps[k].rho_s); 3],
                    m: f64::from(maps[k].m),
                    tilt: [n[0].atan2(n[2]), n[1].clamp(-1.0, 1.0).asin()],
                },
                noise: device.noise(),
            });
        }
    }
    if texels.is_empty() {
        return Err(Error::field(path, "relief", "no texel faces the camera"));
    }
    Ok(finished(device, places.collect(), texels, options))
}

/// The design for a leaf that has been scanned: its texels are fitted first. With `more`, the frames that there are
/// stay, and further places are looked for beside them.
///
/// # Errors
/// Those of the capture, and [`Error::Missed`] where no texel of it is determined.
pub fn of_capture(folder: &Path, options: &TubeDesignOptions, more: bool) -> Result<TubeDesign> {
    let capture = TubeCapture::open(folder)?;
    let manifest = &capture.manifest;
    let frames = |travel| manifest.pass(travel).map_or(0, |p| p.positions().len());
    let none = HoldOutRule { every: 0, seed: 1 };
    let splits =
        FrameSplits { x: none.split(Travel::X, frames(Travel::X)), y: none.split(Travel::Y, frames(Travel::Y)) };
    let level = noise::level(&capture, &splits)?;
    let own = TubeDesignOptions { camera_deg: None, exposure: 1.0, ..options.clone() };
    let noise = [level.relative, level.floor];
    let mut planned = PlannedDevice { tube: manifest.tube, camera_deg: manifest.camera_deg, noise, options: &own };
    let positions = |travel| manifest.pass(travel).map(|p| p.positions());
    let x = positions(Travel::X).unwrap_or_default();
    let fitter = GlossTexelFitter::new(&planned.fitted(), &x, positions(Travel::Y).as_deref());
    let mut texels = Vec::new();
    for &side in &manifest.sides {
        let mask = SideTransmittance::read(&capture, side, &level)?.mask;
        texels.extend(fitted(&capture, side, &mask, &fitter, &level, &splits)?);
    }
    if texels.is_empty() {
        let what = "no texel that was looked at is determined by this scan, so nothing can be planned from it";
        return Err(Error::Missed(format!("{}: {what}; plan from a specification of the leaf", folder.display())));
    }
    planned.options = options;
    texels.iter_mut().for_each(|t| t.noise.floor /= Rgb::splat(options.exposure));
    let (places, taken) = places(manifest, options, more);
    // A capture may lack pass y, but not pass x.
    let x_is_asked = options.passes.is_empty() || options.passes.contains(&Travel::X);
    if places.is_empty() || x_is_asked && places.iter().all(|place| place.pass != Travel::X) {
        let what = "no place of the tube in pass x lies within the pass, or limits.x_mm";
        let [field, rest] = match manifest.limits.and_then(|limits| limits.step_mm) {
            Some(step) => {
                ["limits.step_mm", &format!(", at a whole number of steps of {step} mm; expected a finer step")]
            }
            None => ["limits", "; expected a range in which the tube can stand"],
        };
        return Err(Error::field(&folder.join("capture.toml"), field, format!("{what}{rest}")));
    }
    let mut design = finished(planned.fitted(), places, texels, options);
    design.taken = taken;
    Ok(design)
}

/// Texels of a scan as its fit has them.
fn fitted(
    capture: &TubeCapture,
    side: Side,
    mask: &[bool],
    fitter: &GlossTexelFitter,
    level: &noise::CameraNoise,
    splits: &FrameSplits,
) -> Result<Vec<DesignTexel>> {
    let (width, height) = (capture.manifest.width, capture.manifest.height);
    let rows: Vec<usize> = (0..height).filter(|j| mask[j * width..(j + 1) * width].contains(&true)).collect();
    let mut texels = Vec::new();
    for j in some(&rows, ROWS) {
        go_on()?;
        let on: Vec<usize> = (0..width).filter(|i| mask[j * width + i]).collect();
        let at: Vec<[u32; 2]> = some(&on, TEXELS / (2 * ROWS)).into_iter().map(|i| [i as u32, j as u32]).collect();
        let read = |travel| capture.band(side, travel, j..j + 1, &at, &splits.of(travel).kept);
        let (x, y) = (read(Travel::X)?, read(Travel::Y)?);
        for (n, noise) in level.readings(capture, &at).into_iter().enumerate() {
            let trace = |band: &[Vec<Rgb<f32>>]| band.iter().map(|frame| frame[n].0).collect::<Vec<_>>();
            let second = (!y.is_empty()).then(|| trace(&y));
            let place = capture.manifest.texel_position(at[n]);
            let fit = fitter.fit_under(&noise, &mut fitter.workspace(), place, &trace(&x), second.as_deref());
            if fit.defect.is_none() && fit.undetermined.is_empty() && fit.rho_d.iter().all(|v| v.is_finite()) {
                let truth = GlossFitTruth { rho_d: fit.rho_d, rho_s: fit.rho_s, m: fit.m, tilt: fit.tilt };
                texels.push(DesignTexel { at_mm: place, truth, noise });
            }
        }
    }
    Ok(texels)
}

/// Where the tube may stand, and which of the places are those of frames that stay.
pub(super) fn places(manifest: &TubeManifest, options: &TubeDesignOptions, more: bool) -> (Vec<TubePlace>, Vec<usize>) {
    let (mut places, mut taken) = (Vec::new(), Vec::new());
    let limits = manifest.limits.unwrap_or_default();
    for pass in [Travel::X, Travel::Y] {
        let mut own = manifest.pass(pass).map(|p| p.positions()).unwrap_or_default();
        let reach = limits.of(pass).or_else(|| Some([*own.first()?, *own.last()?]));
        let (Some(reach), true) = (reach, options.passes.is_empty() || options.passes.contains(&pass)) else {
            continue;
        };
        // A frame that stays was taken, whatever the limits say now; one that is to be taken again has to be possible.
        let whole = |p: f64| limits.step_mm.is_none_or(|step| ((p / step).round() * step - p).abs() < 1e-6);
        let possible = |p: &f64| whole(*p) && limits.of(pass).is_none_or(|[a, b]| (a - 1e-6..=b + 1e-6).contains(p));
        if !more {
            own.retain(possible);
        }
        // The frames of the scan themselves, unless others are asked for or none of them is possible.
        let fine = options.candidates.or((more || own.is_empty()).then_some(100));
        let others = fine.map(|n| ramp(reach, n, limits.step_mm)).unwrap_or_default();
        let kept = if more || fine.is_none() { own } else { Vec::new() };
        let first = places.len();
        if more {
            taken.extend(first..first + kept.len());
        }
        let new = others.into_iter().filter(|p| kept.iter().all(|q| (p - q).abs() > 1e-6));
        let mut list: Vec<f64> = kept.iter().copied().chain(new).collect();
        if !more {
            list.sort_by(f64::total_cmp);
        }
        places.extend(list.into_iter().map(|position_mm| TubePlace { pass, position_mm }));
    }
    (places, taken)
}

/// Reads places of the tube: a CSV with the columns `pass` (x or y) and `position_mm`, as `design leaf` writes it.
///
/// # Errors
/// [`Error::Input`] for another table, a pass that is none, and fewer frames than a capture has.
pub fn read_places(path: &Path) -> Result<Vec<(Travel, Vec<f64>)>> {
    let spec = BatchSpec { required: vec!["position_mm".into()], ..BatchSpec::default() };
    let groups = Groups::read(InputTable::open(path)?, &spec, "pass")?;
    let mut passes = Vec::new();
    for (name, rows) in groups.each() {
        let travel = [Travel::X, Travel::Y].into_iter().find(|t| t.name() == name);
        let travel = travel.ok_or_else(|| Error::unexpected(path, "pass", format!("\"{name}\""), "x or y"))?;
        let mut list: Vec<f64> = rows.iter().map(|row| row.values[0]).collect();
        list.sort_by(f64::total_cmp);
        list.dedup();
        if !(LEAST_FRAMES..=10_000).contains(&list.len()) || list.iter().any(|p| !(p.abs() <= 1e7)) {
            let found = format!("{} different places of pass {name}", list.len());
            return Err(Error::unexpected(path, "position_mm", found, "8 to 10000 a pass, within 1e7 mm"));
        }
        passes.push((travel, list));
    }
    passes.sort_by_key(|(travel, _)| *travel);
    if passes.first().is_none_or(|(travel, _)| *travel != Travel::X) {
        return Err(Error::unexpected(
            path,
            "pass",
            "no row of pass x",
            "the places of pass x, and of y where there is one",
        ));
    }
    Ok(passes)
}

/// At most `count` places over a range, each at a whole number of steps; none where no such place lies in it.
fn ramp([a, b]: [f64; 2], count: usize, step: Option<f64>) -> Vec<f64> {
    let (a, b) = (a.min(b), a.max(b));
    let at = |k: usize| a + (b - a) * k as f64 / (count.max(2) - 1) as f64;
    let rounded = |v: f64| step.map_or(v, |s| (v / s).round() * s);
    let within = |v: &f64| (a - 1e-9..=b + 1e-9).contains(v);
    let mut list: Vec<f64> = (0..count).map(|k| rounded(at(k))).filter(within).collect();
    list.dedup();
    list
}

/// At most `count` of a list, evenly.
pub(super) fn some(all: &[usize], count: usize) -> Vec<usize> {
    if all.len() <= count {
        return all.to_vec();
    }
    (0..count).map(|k| all[(2 * k + 1) * all.len() / (2 * count)]).collect()
}

/// The design for texels, with the values that the options state in place of theirs.
pub(super) fn finished(
    device: GlossFitDevice,
    places: Vec<TubePlace>,
    mut texels: Vec<DesignTexel>,
    options: &TubeDesignOptions,
) -> TubeDesign {
    let count = texels.len();
    for (n, range) in options.ranges.iter().enumerate() {
        let [a, b] = range.range;
        for (k, texel) in texels.iter_mut().enumerate() {
            // Each quantity takes its values in another order, so that they are not tied to one another.
            let turn = (k as f64 * (0.618_034 + 0.136 * n as f64)).fract();
            let value = if count < 2 { 0.5 * (a + b) } else { a + (b - a) * turn };
            let t = &mut texel.truth;
            match range.quantity {
                TexelQuantity::RhoD => t.rho_d = [value; 3],
                TexelQuantity::RhoS => t.rho_s = [value; 3],
                TexelQuantity::M => t.m = value,
                TexelQuantity::Normal => {
                    let turned = (k as f64 * 0.754_878).fract();
                    t.tilt = [value.to_radians(), (a + (b - a) * turned).to_radians()];
                }
            }
        }
    }
    TubeDesign { device, places, texels, wanted: options.wanted.clone(), taken: Vec::new() }
}

impl TubeDesignOptions {
    /// A design for everything that a texel has, with readings of 1 % noise.
    pub fn of(wanted: Vec<TexelQuantity>) -> TubeDesignOptions {
        TubeDesignOptions {
            wanted,
            lobe: Lobe::default(),
            candidates: None,
            passes: Vec::new(),
            noise: 0.01,
            ranges: Vec::new(),
            camera_deg: None,
            exposure: 1.0,
        }
    }
}
