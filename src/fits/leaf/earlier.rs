//! The fit of fewer frames of the same scan, from which a fit of more frames starts.
//!
//! A scan may grow frame by frame. Each new frame sees every texel, so every texel is fitted again; but its answer lies
//! close to the one before. The search for a start among templates, which a fit from nothing begins with, is not needed
//! then. A texel whose answer is not good from there is searched for as in a fit from nothing, so that both find the
//! same within what the solver leaves open.

use crate::gloss::GlossFitStart;
use crate::leaf::Options;
use crate::leaf_folder::{LeafFit, LeafFitFile};
use crate::record::scan::ScanRecord;
use mesophyll_capture::manifest::TubeManifest;
use mesophyll_files::image::read_exr;
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::side::Side;
use std::collections::BTreeMap;
use std::path::Path;

/// A slope that is known worse than this is not started from.
const KNOWN: f64 = 0.3;

/// A fit of fewer frames.
#[derive(Debug, Default)]
pub struct EarlierFit {
    sides: BTreeMap<Side, Vec<Option<GlossFitStart>>>,
    /// Frames of pass x and of pass y that it was made from.
    pub frames: [usize; 2],
}

impl EarlierFit {
    /// The fit in `folder`, if it is one of fewer frames of this scan with the same options.
    pub fn of(folder: &Path, manifest: &TubeManifest, options: &Options) -> Option<EarlierFit> {
        let fit = LeafFit::open(folder).ok()?;
        let scan = fit.record.scan.as_ref()?;
        let (before, now) = (scan.frames, ScanRecord::count_frames(manifest));
        let same = fit.record.name == manifest.name
            && scan.texel_mm == manifest.texel_mm
            && (scan.lobe.clone(), scan.lobe_index) == ScanRecord::name_lobe(options.lobe)
            && fit.record.options.get("robust") == Some(&options.robust.to_string());
        let grown = before[0] > 0 && before != now && (0..2).all(|k| before[k] <= now[k]);
        // A pass that there was not shows tilts that nothing was known of.
        let passes = (before[1] > 0) == (now[1] > 0);
        if !(same && grown && passes) || fit.record.verify(folder).is_err() {
            return None;
        }
        let starts = |side: &Side| Some((*side, side_of(folder, manifest, *side)?));
        let sides: BTreeMap<_, _> = manifest.sides.iter().map(starts).collect::<Option<_>>()?;
        Some(EarlierFit { sides, frames: before })
    }

    /// Where to start in a texel of a side.
    pub fn start(&self, side: Side, texel: usize) -> Option<GlossFitStart> {
        *self.sides.get(&side)?.get(texel)?
    }
}

/// The good texels of a side.
fn side_of(folder: &Path, manifest: &TubeManifest, side: Side) -> Option<Vec<Option<GlossFitStart>>> {
    let [maps, errors] = [LeafFitFile::Maps, LeafFitFile::Errors].map(|file| read_exr(&file.path(folder, side)).ok());
    let (maps, errors) = (maps?, errors?);
    if [maps.width, maps.height] != [manifest.width, manifest.height] {
        return None;
    }
    let (mask, m, m_err) = (maps.scalar(Quantity::Mask)?, maps.scalar(Quantity::M)?, errors.scalar(Quantity::M)?);
    let [x, y, z] = maps.three(Quantity::Normal)?;
    let one = |k: usize| {
        let [m, m_err, x, y, z] = [m[k], m_err[k], x[k], y[k], z[k]].map(f64::from);
        let good = mask[k] == 1.0 && m > 0.0 && m_err <= KNOWN * m && z > 0.0;
        good.then(|| GlossFitStart { m, tilt: [x.atan2(z), y.clamp(-1.0, 1.0).asin()] })
    };
    Some((0..mask.len()).map(one).collect())
}
