//! The leaf fit. Calibrated frames give ρd, ρs, m and the normal of each texel. With the transmittance ρt they give the
//! leaf's σa and σs, and each texel's thickness h + δ and relative reflectance γ. Blade and maps are then written to
//! disk.
//!
//! The main path is [`run`]. It opens the capture and fits texels (resumable, in shards). Then, for each side, it fits
//! the interior, compares with the truth where that is known, builds the blade, and writes the fit folder that
//! `data/README.md` and the crate's README describe.

pub mod blade;
pub mod curve;
mod defect;
mod earlier;
pub mod faults;
pub mod held_out;
pub(crate) mod indeterminacy;
pub(crate) mod interior;
pub mod leaf_wide;
pub(crate) mod noise;
pub(crate) mod outliers;
mod output;
mod paper;
pub(crate) mod side;
pub mod sides;
pub(crate) mod slabmaps;
pub mod texels;
mod truth;
mod widening;

use crate::design::frames;
use crate::gloss::{GlossFitDevice, GlossTexelFitter};
use crate::record::FitKind;
use crate::record::maker::{self, FitMaker, FitOutcome};
use crate::{Error, Result};
use earlier::EarlierFit;
use held_out::{FrameSplits, HoldOutRule};
use mesophyll_capture::manifest::TubePass;
use mesophyll_capture::reader::TubeCapture;
use mesophyll_files::progress::{TaskProgress, go_on, say};
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::tube::Travel;
use std::path::Path;
use std::time::Instant;
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};
use texels::{FitShard, Job};

/// How per-texel reflectance and transmittance are reduced to the leaf's σa, σs, δ and γ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum LeafFitMethod {
    /// One joint least-squares problem over the whole leaf, with ρd and ρt as full functions of thickness.
    #[default]
    Exact,
    /// Solve every texel, average, then Eq. 5 with A and B frozen.
    Paper,
}

impl LeafFitMethod {
    /// Its name on the command line and in `fit.toml`.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// What `fit leaf` is told beside the capture.
#[derive(Debug, Clone)]
pub struct Options {
    /// How the leaf's interior is found.
    pub method: LeafFitMethod,
    /// The gloss lobe that texels are fitted with.
    pub lobe: Lobe,
    /// Weigh outliers among a texel's readings down.
    pub robust: bool,
    /// Which frames are left out of the fit, to judge it by.
    pub hold_out: HoldOutRule,
    /// Make only these parts of the texel phase.
    pub shard: Option<FitShard>,
    /// Do not fit texels: put the parts of all shards together.
    pub merge: bool,
    /// Fit again although the folder holds this very fit.
    pub force: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            method: LeafFitMethod::Exact,
            lobe: Lobe::Beckmann,
            robust: true,
            hold_out: HoldOutRule::default(),
            shard: None,
            merge: false,
            force: false,
        }
    }
}

impl Options {
    fn describe(&self) -> String {
        let HoldOutRule { every, seed } = self.hold_out;
        format!("method={} lobe={:?} robust={} hold_out={every}/{seed}", self.method.name(), self.lobe, self.robust)
    }
}

/// Hash of everything that decides the result: the capture's content, the options, the program version.
pub fn input_hash(capture: &TubeCapture, options: &Options) -> Result<String> {
    Ok(maker::input_hash([("capture", capture.hash()?.as_str()), ("options", &options.describe())]))
}

/// Fits `capture` into the folder `out`.
///
/// # Errors
/// Unreadable or invalid captures (exit code 2), an unwritable folder (2), an interruption (130, finished parts kept),
/// and a fit that as a whole cannot be trusted (1).
pub fn run(capture: &Path, out: &Path, options: &Options) -> Result<FitOutcome> {
    let (folder, options) = (capture.to_path_buf(), options.clone());
    maker::make(FitKind::Leaf, out, &[capture], move |maker| fit(&folder, &options, maker))
}

fn fit(folder: &Path, options: &Options, maker: &mut FitMaker) -> Result<FitOutcome> {
    let capture = maker.phase("open and check", || TubeCapture::open(folder))?;
    let input = maker.phase("hash the capture", || input_hash(&capture, options))?;
    if options.shard.is_some() {
        maker.one_of_several();
    }
    if let Some(found) = maker.up_to_date(input, options.force)? {
        return Ok(found);
    }
    let parts = maker.parts(&texels::format()).to_path_buf();
    let manifest = &capture.manifest;
    let step = Instant::now();
    let split = |travel| {
        manifest.pass(travel).map_or_else(Default::default, |p| options.hold_out.split(travel, p.positions().len()))
    };
    let splits = FrameSplits { x: split(Travel::X), y: split(Travel::Y) };
    let mut level = noise::level(&capture, &splits)?;
    let sides = manifest
        .sides
        .iter()
        .map(|&s| side::SideTransmittance::read(&capture, s, &level))
        .collect::<Result<Vec<_>>>()?;
    maker.times.phase("light box and mask", step);

    let camera = manifest.camera_deg.to_radians();
    let device = GlossFitDevice {
        height_mm: manifest.tube.height_mm,
        length_mm: manifest.tube.length_mm,
        radius_mm: manifest.tube.radius_mm,
        camera: [camera.sin(), 0.0, camera.cos()],
        lobe: options.lobe,
        noise_relative: level.relative,
        noise_floor: level.floor,
    };
    let seen = |p: &TubePass| {
        let positions = p.positions();
        splits.of(p.name).kept.iter().map(|k| positions[*k]).collect::<Vec<f64>>()
    };
    let x = manifest.pass(Travel::X).map(seen).unwrap_or_default();
    let y = manifest.pass(Travel::Y).map(seen);
    let mut fitter = GlossTexelFitter::new(&device, &x, y.as_deref());
    fitter.unseen = if y.is_none() { indeterminacy::UNSEEN } else { 0.0 };
    // What the folder holds stays there until all texels are fitted, so that a stopped run starts from it again.
    let earlier = if options.force { None } else { EarlierFit::of(maker.folder(), manifest, options) };
    if let Some(EarlierFit { frames: [x, y], .. }) = &earlier {
        say(format_args!("the fit of {x} frames of pass x and {y} of pass y is there; texels start from it"));
    }
    let jobs: Vec<Job> = sides
        .iter()
        .map(|s| Job {
            capture: &capture,
            side: s.side,
            mask: &s.mask,
            fitter: &fitter,
            level: &level,
            splits: &splits,
            earlier: earlier.as_ref(),
            parts: &parts,
        })
        .collect();
    if !options.merge {
        let bar = TaskProgress::new("fitting texels", sides.iter().map(|s| s.count() as u64).sum());
        let shard = options.shard.unwrap_or(FitShard { index: 0, count: 1 });
        let mut first = 0;
        for job in &jobs {
            let spent = job.run(shard, first, &bar)?;
            first += job.count();
            maker.times.spent(&format!("{}: read and calibrate frames", job.side.name()), spent.reading);
            maker.times.spent(&format!("{}: fit texels", job.side.name()), spent.fitting);
        }
    }
    // The shard that finds all parts finishes the fit. Whether they are all there is asked once, before any is read:
    // another shard may write the last one meanwhile, and then it is that shard that finishes the fit.
    let missing = || jobs.iter().map(Job::missing).sum::<usize>();
    match missing() {
        0 => {}
        missing if options.merge => {
            let (parts, what) = (parts.display(), "parts are missing; run every shard before --merge");
            return Err(Error::Missed(format!("{parts}: {missing} {what}")));
        }
        missing => return Ok(FitOutcome::ShardDone { missing }),
    }
    // Where two shards find them all, one waits for the other. The other one has finished the fit then and has removed
    // the parts, also with --force.
    if let Some(found) = maker.alone()?
        && (!options.force || missing() > 0)
    {
        return Ok(found);
    }
    let step = Instant::now();
    let merged = jobs.iter().map(Job::merge).collect::<Result<Vec<_>>>()?;
    maker.times.phase("merge parts", step);

    let mut record = maker.record(&manifest.name);
    output::describe(&mut record, &capture, options, &level, &splits);
    maker.times.capture = Some(capture.folder.display().to_string());
    let mut done = Vec::new();
    for (measured, maps) in sides.into_iter().zip(merged) {
        go_on()?;
        let step = Instant::now();
        let _bar = TaskProgress::of(format!("{}: interior", measured.side.name()));
        let fitted = interior::fit(&capture, measured, maps, options, &level, &mut maker.times)?;
        maker.times.phase(&format!("{}: interior", fitted.side.name()), step);
        done.push(fitted);
    }
    sides::compare(&mut done, manifest.thickness_err_mm.unwrap_or(0.0) / manifest.thickness_mm, &mut record);
    let blade = maker.phase("blade", || Ok(output::blade(&capture, &done)))?;
    let step = Instant::now();
    let mut judged = Vec::new();
    for fitted in &done {
        judged.push(held_out::judge(&capture, record.scan.get_or_insert_default(), &splits, fitted, &level)?);
    }
    maker.times.phase("held-out frames", step);
    let step = Instant::now();
    let found = faults::look(&capture, record.scan.get_or_insert_default(), &level, &done)?;
    widening::found(&mut record, &mut done, found, &mut level);
    maker.times.phase("faults of the measurement", step);
    let step = Instant::now();
    let out = maker.begin()?.to_path_buf();
    for (fitted, judged) in done.iter().zip(judged) {
        let truth = truth::compare(&capture, fitted)?;
        output::side(&out, &capture, fitted, &level, truth, judged, &mut record)?;
    }
    output::finish(&out, &capture, blade.as_ref(), &mut record)?;
    record.next_measurement = frames::next(&capture, &device, &level, &done);
    maker.times.phase("write maps", step);
    let record = maker.finish(record)?;
    if done.iter().all(|d| d.wide_failed()) {
        return Err(Error::Missed(format!(
            "{}: the leaf-wide fit did not converge on any side ({}); maps are written, σa and σs are not to be used",
            out.join("fit.toml").display(),
            done.iter().map(|d| d.termination.name()).collect::<Vec<_>>().join(", ")
        )));
    }
    Ok(FitOutcome::Done(record))
}
