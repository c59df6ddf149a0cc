//! The fit of fewer frames of the same scan, from which a fit of more frames starts.
//!
//! A scan may grow frame by frame. Each new frame sees every texel, so every texel is fitted again; but its answer lies
//! close to the one before. The search for a start among templates, which a fit from nothing begins with, is not needed
//! then. A texel whose answer is not good from there, or far away, is searched for as in a fit from nothing, so that
//! both find the same within what the solver leaves open.

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::leaf::run;
    use crate::leaf::texels::FitShard;
    use crate::record::FitRecord;
    use crate::record::maker::FitOutcome;
    use mesophyll_files::image::ChannelMaps;
    use mesophyll_synth::leaf::SyntheticLeaf;
    use mesophyll_synth::scan;
    use mesophyll_synth::spec::{InteriorModel, LeafSpec};

    const LEAF: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/leaves/balata.toml"));

    /// A scan of 24 × 40 texels, which are two parts a side, with 24 frames a pass.
    fn scanned(folder: &Path) -> TubeManifest {
        let mut spec: LeafSpec = LEAF.parse().unwrap();
        (spec.veins.tertiary_mm, spec.veins.areole_mm) = (0.0, 0.0);
        let [width, height] = [24, 40];
        let leaf = SyntheticLeaf::grow(&spec, InteriorModel::Exact, width, height).unwrap();
        let options = scan::Options { width, height, frames: 24, seed: 3, ..scan::Options::default() };
        scan::scan(&spec, &leaf, &options, folder).unwrap();
        TubeManifest::read(folder).unwrap()
    }

    /// Lets the capture have only its first frames.
    fn with_frames(folder: &Path, all: &TubeManifest, count: usize) {
        let mut manifest = all.clone();
        for pass in &mut manifest.passes {
            pass.positions_mm = Some(pass.positions()[..count].to_vec());
            (pass.start_mm, pass.end_mm, pass.frames) = (None, None, None);
        }
        std::fs::write(folder.join("capture.toml"), toml::to_string(&manifest).unwrap()).unwrap();
    }

    fn maps(fit: &Path) -> [ChannelMaps; 2] {
        ["front.exr", "front_err.exr"].map(|name| read_exr(&fit.join(name)).unwrap())
    }

    /// Frames are added to a capture. The fit goes on from the one that is there, a stop in between loses nothing, and
    /// it ends where a fit from nothing ends.
    #[test]
    fn a_capture_that_grows_is_fitted_on() {
        let folder = tempfile::tempdir().unwrap();
        let [capture, nothing, grown] = ["scan", "nothing", "grown"].map(|name| folder.path().join(name));
        let (all, options) = (scanned(&capture), Options::default());
        with_frames(&capture, &all, 16);
        run(&capture, &grown, &options).unwrap();
        let before = FitRecord::read(&grown).unwrap();
        assert_eq!(before.scan.as_ref().unwrap().frames, [16, 16]);
        assert!(EarlierFit::of(&grown, &TubeManifest::read(&capture).unwrap(), &options).is_none());

        with_frames(&capture, &all, 24);
        let now = TubeManifest::read(&capture).unwrap();
        let starts = EarlierFit::of(&grown, &now, &options).unwrap();
        let known = starts.sides[&Side::Front].iter().flatten().count();
        assert!(known * 10 > before.sections["front"].counts["good"] * 9, "{known} texels have a start");
        let other = Options { robust: false, ..options.clone() };
        assert!(EarlierFit::of(&grown, &now, &other).is_none());

        let half = Options { shard: Some(FitShard { index: 0, count: 2 }), ..options.clone() };
        assert!(matches!(run(&capture, &grown, &half).unwrap(), FitOutcome::ShardDone { .. }));
        // A number without an error has NaN, which is not equal to itself; the hash is over all that is written.
        assert_eq!(FitRecord::read(&grown).unwrap().record_hash, before.record_hash);
        before.verify(&grown).unwrap();

        run(&capture, &grown, &options).unwrap();
        run(&capture, &nothing, &options).unwrap();
        let [found, expected] = [&grown, &nothing].map(|fit| FitRecord::read(fit).unwrap());
        assert_eq!(
            (found.input_hash.as_str(), found.scan.clone()),
            (expected.input_hash.as_str(), expected.scan.clone())
        );
        for name in ["sigma_a", "sigma_s"] {
            let [a, b] = [&found, &expected].map(|record| &record.sections["front"].params[name]);
            for c in 0..3 {
                assert!((a.value[c] - b.value[c]).abs() < 0.02 * b.stderr[c], "{name}: {a:?} {b:?}");
            }
        }
        let ([found, _], [expected, error]) = (maps(&grown), maps(&nothing));
        assert_eq!(found.scalar(Quantity::Mask), expected.scalar(Quantity::Mask));
        let (mut off, mut count) = (Vec::new(), 0);
        for name in ["m.Y", "rho_s.G", "rho_d.G", "normal.X", "normal.Y"] {
            let [a, b, e] = [&found, &expected, &error].map(|maps| maps.get(name).unwrap());
            for k in (0..a.len()).filter(|k| e[*k].is_finite()) {
                count += 1;
                let share = ((a[k] - b[k]) / e[k]).abs();
                off.extend((share > 0.1).then_some((name, k, share)));
            }
        }
        assert!(count > 800 && off.is_empty(), "{count}: {off:?}");
        // The same command again computes nothing.
        assert!(matches!(run(&capture, &grown, &options).unwrap(), FitOutcome::UpToDate(_)));
    }
}
