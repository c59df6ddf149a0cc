//! The held-out frames that a fit's folder keeps. They judge the maps in the folder again, whatever has happened to the
//! maps since.

use super::judge::{ResidualTally, through};
use super::{FramePredictor, HeldOutResiduals, LightBoxResiduals, PredictionScratch, ScanRecord, texel_of};
use crate::leaf_folder::LeafFitFile;
use crate::record::FitRecord;
use crate::{Error, Result};
use mesophyll_base::rgb::Rgb;
use mesophyll_files::image::read_exr;
use mesophyll_files::quantity::{Quantity, RGB};
use mesophyll_optics::side::Side;
use mesophyll_optics::tube::Travel;
use rayon::prelude::*;
use std::path::Path;

/// Channels of the light box's transmittance as it was measured: `light_box.R` and so on.
pub const LIGHT_BOX: &str = "light_box";

/// Channel of a frame: `x0012.R`.
pub(super) fn plane_name(pass: &str, frame: usize, channel: usize) -> String {
    format!("{pass}{frame:04}.{}", RGB[channel])
}

/// A reading, rounded to as many binary digits as give it within a 64th of its relative noise. The other digits are
/// random and would not compress.
pub(super) fn rounded(value: f32, relative: f64) -> f32 {
    let digits = (32.0 / relative.max(1e-7)).log2().ceil().clamp(8.0, 23.0) as u32;
    if digits == 23 || !value.is_finite() {
        return value;
    }
    let dropped = 23 - digits;
    f32::from_bits(((value.to_bits() >> (dropped - 1)) + 1) >> 1 << dropped)
}

/// One side's stored frames, compared with what the folder's maps predict now.
#[derive(Debug, Clone)]
pub struct StoredFrames {
    /// Which side it is.
    pub side: Side,
    /// Columns of the stored images.
    pub width: usize,
    /// Rows of the stored images.
    pub height: usize,
    /// The step between stored rows and columns of the maps.
    pub step: usize,
    /// The stored frames.
    pub frames: Vec<StoredFrame>,
    /// How well the transmittance is explained; `None` where it was not stored.
    pub light_box: Option<LightBoxResiduals>,
}

/// A stored frame. Planes are a channel each; NaN off the good texels.
#[derive(Debug, Clone)]
pub struct StoredFrame {
    /// The pass that the frame belongs to.
    pub travel: Travel,
    /// Its number in the pass, from 0.
    pub frame: usize,
    /// Position of the tube along the travel (mm).
    pub position_mm: f64,
    /// What was measured (1 is a white texel under an infinite tube).
    pub measured: [Vec<f32>; 3],
    /// What the maps predict, in the same unit.
    pub predicted: [Vec<f32>; 3],
    /// (measured − predicted) / noise.
    pub residual: [Vec<f32>; 3],
    /// Readings that were compared.
    pub readings: usize,
    /// Mean square of the residuals, in units of the noise.
    pub reduced_chi2: f64,
    /// The mean square that noise and the fit's own errors lead to expect.
    pub expected: f64,
    /// Standard error of `reduced_chi2`.
    pub stderr: f64,
    /// Share of the readings that are more than three standard deviations off.
    pub share_beyond_3: f64,
    /// Mean residual in units of the noise.
    pub bias: f64,
}

impl StoredFrame {
    /// How far the prediction is off, beyond noise and chance, in units of the noise.
    pub fn off(&self) -> f64 {
        super::off(self.reduced_chi2, self.expected, self.stderr)
    }

    /// Pass and number, as in `x 12`.
    pub fn name(&self) -> String {
        format!("{} {}", self.travel.name(), self.frame)
    }
}

impl StoredFrames {
    /// Index in the whole maps of the stored texel `k`.
    pub fn texel(&self, k: usize, width: usize) -> usize {
        k / self.width * self.step * width + k % self.width * self.step
    }
}

/// Reads what a fit's folder keeps of a side and predicts it from the folder's maps; `None` where nothing was held out.
///
/// # Errors
/// A map or file of held-out frames that is missing, damaged or of another size.
pub fn kept(folder: &Path, record: &FitRecord, side: Side) -> Result<Option<StoredFrames>> {
    let (Some(scan), Some(section)) = (&record.scan, record.sections.get(side.name())) else { return Ok(None) };
    if section.held_out.is_empty() {
        return Ok(None);
    }
    let path = LeafFitFile::HeldOut.path(folder, side);
    let stored = read_exr(&path)?;
    let maps_path = LeafFitFile::Maps.path(folder, side);
    let maps = read_exr(&maps_path)?;
    let step = scan.stored_step.max(1);
    let (width, height) = (maps.width.div_ceil(step), maps.height.div_ceil(step));
    if (stored.width, stored.height) != (width, height) {
        return Err(Error::input(
            &path,
            format!("found {}x{} texels, expected {width}x{height}", stored.width, stored.height),
        ));
    }
    let texel = texel_of(&maps)
        .ok_or_else(|| Error::input(&maps_path, "channels are missing, expected rho_d, rho_s, m and normal"))?;
    let mask = maps.require_scalar(&maps_path, Quantity::Mask)?;
    let mut out = StoredFrames { side, width, height, step, frames: Vec::new(), light_box: None };
    for travel in [Travel::X, Travel::Y] {
        let Some(held) = section.held_out.get(travel.name()) else { continue };
        for &frame in &held.stored {
            let planes = |c: usize| stored.require(&path, &plane_name(travel.name(), frame, c)).map(<[f32]>::to_vec);
            let measured = [planes(0)?, planes(1)?, planes(2)?];
            let position = position(held, frame).ok_or_else(|| {
                Error::field(
                    &folder.join("fit.toml"),
                    &format!("{}.held_out", side.name()),
                    format!("frame {frame} has no position"),
                )
            })?;
            let predictor = FramePredictor::new(scan, travel, &[position]);
            let at = |k: usize| {
                let place = out.texel(k, maps.width);
                let centre = [maps.width, maps.height].map(|n| 0.5 * n as f64 - 0.5);
                let p = [(place % maps.width) as f64 - centre[0], centre[1] - (place / maps.width) as f64];
                (place, p.map(|v| v * scan.texel_mm))
            };
            let predicted: Vec<Option<Rgb>> = (0..width * height)
                .into_par_iter()
                .map_init(PredictionScratch::default, |scratch, k| {
                    let (place, mm) = at(k);
                    let good = mask[place] == 1.0 && measured.iter().any(|p| p[k].is_finite());
                    Some(predictor.values(scratch, &texel(place).filter(|_| good)?, mm)[0])
                })
                .collect();
            out.frames.push(frame_of(scan, held, travel, frame, position, measured, &predicted));
        }
    }
    out.light_box = light_box(&out, record, section, &stored, &maps, mask);
    Ok(Some(out))
}

fn position(held: &HeldOutResiduals, frame: usize) -> Option<f64> {
    held.frames.iter().position(|f| *f == frame).and_then(|k| held.positions_mm.get(k)).copied()
}

fn frame_of(
    scan: &ScanRecord,
    held: &HeldOutResiduals,
    travel: Travel,
    frame: usize,
    position_mm: f64,
    measured: [Vec<f32>; 3],
    predicted: &[Option<Rgb>],
) -> StoredFrame {
    let mut tally = ResidualTally::default();
    let mut planes = [0, 1, 2].map(|_| [vec![f32::NAN; predicted.len()], vec![f32::NAN; predicted.len()]]);
    for (k, value) in predicted.iter().enumerate() {
        let Some(value) = value else { continue };
        let z = Rgb::of(|c| (f64::from(measured[c][k]) - value[c]) / scan.noise(value[c]));
        tally.add(z.into_iter(), k);
        for c in 0..3 {
            (planes[c][0][k], planes[c][1][k]) = (value[c] as f32, z[c] as f32);
        }
    }
    let [[r, zr], [g, zg], [b, zb]] = planes;
    StoredFrame {
        travel,
        frame,
        position_mm,
        measured,
        predicted: [r, g, b],
        residual: [zr, zg, zb],
        readings: tally.readings,
        reduced_chi2: tally.reduced_chi2(),
        expected: held
            .frames
            .iter()
            .position(|f| *f == frame)
            .and_then(|k| held.frame_expected.get(k))
            .copied()
            .unwrap_or(held.expected),
        stderr: tally.stderr(),
        share_beyond_3: tally.share_beyond_3(),
        bias: tally.bias(),
    }
}

/// Compares the stored transmittance with the slab of the folder's σa, σs and thickness.
fn light_box(
    kept: &StoredFrames,
    record: &FitRecord,
    section: &crate::record::RecordSection,
    stored: &mesophyll_files::image::ChannelMaps,
    maps: &mesophyll_files::image::ChannelMaps,
    mask: &[f32],
) -> Option<LightBoxResiduals> {
    let (scan, told) = (record.scan.as_ref()?, section.light_box.as_ref()?);
    let rgb = |name: &str| <[f64; 3]>::try_from(section.params.get(name)?.value.as_slice()).ok().map(Rgb);
    let h = *section.params.get("thickness")?.value.first()?;
    let measured: Vec<&[f32]> = RGB.iter().map(|c| stored.get(&format!("{LIGHT_BOX}.{c}"))).collect::<Option<_>>()?;
    let thickness = maps.scalar(Quantity::Thickness)?;
    let incidence = scan.lightbox_camera_deg.to_radians().cos();
    let good = (0..kept.width * kept.height).filter(|k| mask[kept.texel(*k, maps.width)] == 1.0);
    through(rgb("sigma_a")?, rgb("sigma_s")?, h, incidence, told.noise_relative, told.noise_floor.into(), good, |k| {
        (f64::from(thickness[kept.texel(k, maps.width)]), Rgb::of(|c| f64::from(measured[c][k])))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_stays_within_a_64th_of_the_noise() {
        for v in [1e-6f32, 0.0123456, 0.337, 1.0, -0.02, 7.77] {
            for relative in [0.1, 0.01, 1e-3] {
                assert!(
                    f64::from((rounded(v, relative) - v).abs()) <= f64::from(v.abs()) * relative / 64.0,
                    "{v} {relative}"
                );
            }
        }
        assert!(rounded(f32::NAN, 0.01).is_nan());
        // Noise below the precision of a float rounds nothing.
        assert_eq!(rounded(0.123_456_79, 1e-6), 0.123_456_79);
    }
}
