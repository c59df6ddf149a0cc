//! Translucency maps on disk: `front.exr` and `back.exr` (the light that enters that side, in the columns of its
//! camera), previews, `fit.toml`, `times.toml`.
//!
//! Channels: `translucency.1`, `.2` … (coefficients of f on the basis), `translucency.R1` … `.B3` (of M, with three
//! wavelengths), `translucency.Y` or `.R .G .B` (with one light), `thickness.Y` (mm), `entering.Y` (the light of an
//! even sky that enters, relative to a flat open texel) and `mask.Y` (1 on the leaf).

use super::recipe::TranslucencyRecipe;
use super::side::TranslucencySide;
use super::source::{TranslucencyLeaf, TranslucencySideMaps};
use super::tissue;
use super::{Options, TissueName, TissueSource, TranslucencyColour};
use crate::leaf_folder::LeafFitFile;
use crate::record::{FitParameter, FitRecord, RecordSection};
use crate::translucency::Result;
use mesophyll_base::statistics::upper_quantile;
use mesophyll_files::image::{ChannelMaps, Packing, to_srgb8, write_exr, write_png};
use mesophyll_files::quantity::{Quantity, RGB};
use std::path::Path;

/// What a part holds: the files of one side and its section. The parts of a stopped run are reused only where this is
/// the same.
pub const PART: &str = "side.exr, side_translucency.png, section";

/// Writes into the record what all sides share.
///
/// # Errors
/// [`crate::translucency::Error::Missed`] for a slab that the leaf fit did not determine.
pub fn describe(
    record: &mut FitRecord,
    source: &TranslucencyLeaf,
    channels: &[usize],
    options: &Options,
) -> Result<()> {
    TranslucencyRecipe::of(options, channels).write(&mut record.options);
    let mut say = |name: &str, text: String| record.options.insert(name.into(), text);
    say("leaf", source.hash.clone());
    say("basis", options.sun.map_or(options.basis.name(), |_| "none: one light".into()));
    if let Some([elevation, azimuth]) = options.sun {
        say("sun_elevation_deg", format!("{:?}", elevation.to_degrees()));
        say("sun_azimuth_deg", format!("{:?}", azimuth.to_degrees()));
    }
    say("tissue", options.tissue.name().into());
    say("levels", options.levels.to_string());
    say("lights", options.lights.name());
    say("size", format!("{}x{}", source.width, source.height));
    say("texel_mm", format!("{:?}", source.texel_mm));
    say("frame", "columns and tangent frame of the side that light enters: x right, y up, z out of it".into());
    for side in &source.sides {
        for c in channels {
            if let Some(why) = tissue::of(side, *c, options)?.doubt() {
                record.options.entry("doubt".into()).or_insert(why);
            }
        }
    }
    Ok(())
}

/// Writes one side's maps and preview into `out` and returns the record's section about them.
///
/// # Errors
/// [`crate::translucency::Error::Write`] for a file that cannot be written.
pub fn side(
    out: &Path,
    source: &TranslucencyLeaf,
    of: &TranslucencySideMaps,
    side: &TranslucencySide,
    options: &Options,
) -> Result<RecordSection> {
    write_exr(&LeafFitFile::Maps.path(out, side.side), &maps(source, side, options), Packing::Zip)?;
    preview(out, source, side)?;
    Ok(section(source, of, side, options))
}

/// Name of coefficient `i` (from 0) of channel `c`.
pub fn channel(options: &Options, c: usize, i: usize) -> String {
    match (options.colour, options.sun) {
        (TranslucencyColour::ThreeWavelengths, Some(_)) => format!("translucency.{}", RGB[c]),
        (TranslucencyColour::ThreeWavelengths, None) => format!("translucency.{}{}", RGB[c], i + 1),
        (_, Some(_)) => "translucency.Y".into(),
        (_, None) => format!("translucency.{}", i + 1),
    }
}

fn maps(source: &TranslucencyLeaf, side: &TranslucencySide, options: &Options) -> ChannelMaps {
    let mut maps = ChannelMaps::new(source.width, source.height);
    for (c, images) in side.channels.iter().zip(&side.coefficients) {
        for (i, image) in images.iter().enumerate() {
            maps.push(channel(options, *c, i), image.iter().map(|v| *v as f32).collect());
        }
    }
    for (name, image) in [(Quantity::Thickness.channel(0), &side.thickness), ("entering.Y".into(), &side.entering)] {
        maps.push(name, image.iter().map(|v| *v as f32).collect());
    }
    maps.add(Quantity::Mask, 0, side.mask.iter().map(|m| f32::from(u8::from(*m))).collect());
    maps
}

/// The first three images as a colour picture, from 0 (dark) to the 99th percentile (bright). Flat places are grey,
/// flanks are coloured (as in H9 Fig. 3.16).
fn preview(out: &Path, source: &TranslucencyLeaf, side: &TranslucencySide) -> Result<()> {
    let Some(images) = side.coefficients.first() else { return Ok(()) };
    let mut all: Vec<f64> =
        images.iter().flat_map(|i| i.iter().zip(&side.mask).filter(|(_, m)| **m).map(|(v, _)| *v)).collect();
    let top = upper_quantile(&mut all, 99, 100).unwrap_or(1.0).max(1e-12);
    let bytes: Vec<u8> = (0..side.mask.len())
        .flat_map(|k| {
            let of = |i: usize| to_srgb8((0.8 * images[i.min(images.len() - 1)][k] / top).clamp(0.0, 1.0) as f32);
            [of(0), of(1), of(2), if side.mask[k] { 255 } else { 0 }]
        })
        .collect();
    write_png(&out.join(format!("{}_translucency.png", side.side.name())), source.width, source.height, &bytes)
}

fn section(
    source: &TranslucencyLeaf,
    of: &TranslucencySideMaps,
    side: &TranslucencySide,
    options: &Options,
) -> RecordSection {
    let mut s = RecordSection { figures: side.figures.clone(), ..RecordSection::default() };
    let on = side.mask.iter().filter(|m| **m).count();
    s.counts.insert("texels".into(), side.mask.len());
    s.counts.insert("outside".into(), side.mask.len() - on);
    s.counts.insert("good".into(), on - side.dark.min(on));
    s.counts.insert("no_light".into(), side.dark);
    let mut say = |name: &str, unit: &str, value: &dyn Fn(usize) -> f64, stderr: &dyn Fn(usize) -> f64| {
        let each = |f: &dyn Fn(usize) -> f64| (0..side.tissue.len()).map(f).collect();
        s.params.insert(
            name.into(),
            FitParameter { value: each(value), stderr: each(stderr), unit: unit.into(), ..FitParameter::default() },
        );
    };
    // A tissue from the leaf fit has the leaf fit's errors; a tissue that the user states has none.
    let fitted = options.tissue == TissueSource::Named(TissueName::Fit);
    let err = |q: usize| move |k: usize| if fitted { of.sigma_err[q][side.channels[k]] } else { f64::NAN };
    say("sigma_a", "1/mm", &|k| side.tissue[k].sigma_a, &err(0));
    say("sigma_s", "1/mm", &|k| side.tissue[k].sigma_s, &err(1));
    say("g", "", &|k| side.tissue[k].g, &|_| f64::NAN);
    say("a", "", &|k| side.tissue[k].a, &|_| f64::NAN);
    s.figures.insert("slope_residual".into(), of.slope_residual);
    s.figures.insert("mean_free_path_mm".into(), side.tissue[0].mean_free_path());
    s.figures.insert("texel_over_mean_free_path".into(), source.texel_mm / side.tissue[0].mean_free_path());
    s
}
