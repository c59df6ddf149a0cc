//! The leaf fit: calibrated frames → ρd, ρs, m and normal a texel → transmittance → σa, σs, h + δ, γ → blade and maps
//! on disk.
//!
//! The main path is [`run`]: open, texels (resumable, shardable), then side by side interior, comparison with the truth
//! where it is known, blade, and the fit folder that `data/README.md` and the crate's README describe.

pub mod blade;
pub mod curve;
pub mod defect;
pub mod held_out;
mod interior;
mod noise;
mod outliers;
mod output;
pub mod paper;
mod side;
pub mod sides;
pub mod slabmaps;
pub mod texels;
pub mod textures;
mod truth;
mod undetermined;
pub mod wide;

use crate::gloss::{Device, TexelFitter};
use crate::{Error, Result};
use held_out::{HoldOut, Splits};
use mesophyll_capture::manifest::{Pass, Travel};
use mesophyll_capture::reader::Capture;
use mesophyll_files::hash;
use mesophyll_files::progress::Bar;
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::side::Side;
use mesophyll_record::{self as record, FitRecord, Phase, SCHEMA, Times};
use std::path::{Path, PathBuf};
use std::time::Instant;
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};
use texels::{Job, Shard};

/// How per-texel reflectance and transmittance are reduced to the leaf's σa, σs, δ and γ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum Method {
    /// One joint least-squares problem over the whole leaf, with ρd and ρt as full functions of thickness.
    #[default]
    Exact,
    /// Solve every texel, average, then Eq. 5 with A and B frozen.
    Paper,
}

impl Method {
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// What `fit leaf` is told beside the capture.
#[derive(Debug, Clone)]
pub struct Options {
    pub method: Method,
    pub lobe: Lobe,
    pub robust: bool,
    /// Which frames are left out of the fit, to judge it by.
    pub hold_out: HoldOut,
    /// Make only these parts of the texel phase.
    pub shard: Option<Shard>,
    /// Do not fit texels: put the parts of all shards together.
    pub merge: bool,
    /// Fit again although the folder holds this very fit.
    pub force: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            method: Method::Exact,
            lobe: Lobe::Beckmann,
            robust: true,
            hold_out: HoldOut::default(),
            shard: None,
            merge: false,
            force: false,
        }
    }
}

impl Options {
    fn describe(&self) -> String {
        let HoldOut { every, seed } = self.hold_out;
        format!("method={} lobe={:?} robust={} hold_out={every}/{seed}", self.method.name(), self.lobe, self.robust)
    }
}

/// How a run ended.
#[derive(Debug)]
pub enum Outcome {
    /// The fit is complete.
    Done(Box<FitRecord>),
    /// The folder already held this very fit; nothing was computed.
    UpToDate(Box<FitRecord>),
    /// A shard is done; the fit is complete when all shards are and `--merge` has run.
    ShardDone { missing: usize },
}

/// Hash of everything that decides the result: the capture's content, the options, the program version.
pub fn input_hash(capture: &Capture, options: &Options) -> Result<String> {
    let content = capture.hash()?;
    Ok(hash::combine([
        ("capture", content.as_str()),
        ("options", &options.describe()),
        ("program", env!("CARGO_PKG_VERSION")),
    ]))
}

/// Fits `capture` into the folder `out`.
///
/// # Errors
/// Unreadable or invalid captures (exit code 2), an unwritable folder (2), an interruption (130, finished parts kept),
/// and a fit that as a whole cannot be trusted (1).
pub fn run(capture: &Path, out: &Path, options: &Options) -> Result<Outcome> {
    let clock = Instant::now();
    // The capture first: a mistyped one leaves no empty folder behind.
    let folder = capture;
    let capture = Capture::open(folder)?;
    record::claim(out, "leaf", &[folder])?;
    let mut phases = Phases::default();
    phases.add("open and check", clock);
    let step = Instant::now();
    let input = input_hash(&capture, options)?;
    phases.add("hash the capture", step);
    if !options.force
        && let Ok(record) = FitRecord::read(out)
        && record.input_hash == input
        && record.verify(out).is_ok()
    {
        return Ok(Outcome::UpToDate(Box::new(record)));
    }
    let parts = out.join(format!("parts-{}", &input[..12]));
    let manifest = &capture.manifest;
    let step = Instant::now();
    let split = |travel| {
        manifest.pass(travel).map_or_else(Default::default, |p| options.hold_out.split(travel, p.positions().len()))
    };
    let splits = Splits { x: split(Travel::X), y: split(Travel::Y) };
    let level = noise::level(&capture, &splits)?;
    let sides =
        manifest.sides.iter().map(|&s| side::Measured::read(&capture, s, &level)).collect::<Result<Vec<_>>>()?;
    phases.add("light box and mask", step);

    let camera = manifest.camera_deg.to_radians();
    let device = Device {
        height_mm: manifest.tube.height_mm,
        length_mm: manifest.tube.length_mm,
        radius_mm: manifest.tube.radius_mm,
        camera: [camera.sin(), 0.0, camera.cos()],
        lobe: options.lobe,
        noise_relative: level.relative,
        noise_floor: level.floor,
    };
    let seen = |p: &Pass| {
        let positions = p.positions();
        splits.of(p.name).kept.iter().map(|k| positions[*k]).collect::<Vec<f64>>()
    };
    let x = manifest.pass(Travel::X).map(seen).unwrap_or_default();
    let y = manifest.pass(Travel::Y).map(seen);
    let mut fitter = TexelFitter::new(&device, &x, y.as_deref());
    fitter.unseen = if y.is_none() { undetermined::UNSEEN } else { 0.0 };
    let jobs: Vec<Job> = sides
        .iter()
        .map(|s| Job {
            capture: &capture,
            side: s.side,
            mask: &s.mask,
            fitter: &fitter,
            level: &level,
            splits: &splits,
            parts: &parts,
        })
        .collect();
    if !options.merge {
        let bar = Bar::new("fitting texels", sides.iter().map(|s| s.count() as u64).sum());
        let shard = options.shard.unwrap_or(Shard { index: 0, count: 1 });
        let mut first = 0;
        for job in &jobs {
            let spent = job.run(shard, first, &bar)?;
            first += job.count();
            phases.push(format!("{}: read and calibrate frames", job.side.name()), spent.reading);
            phases.push(format!("{}: fit texels", job.side.name()), spent.fitting);
        }
    }
    let step = Instant::now();
    let mut merged = Vec::new();
    for job in &jobs {
        match job.merge()? {
            Some(maps) => merged.push(maps),
            None => {
                let missing = jobs.iter().map(|j| (0..j.count()).filter(|&p| !j.path(p).exists()).count()).sum();
                if options.merge {
                    return Err(Error::Missed(format!(
                        "{}: {missing} parts are missing; run every shard before --merge",
                        parts.display()
                    )));
                }
                return Ok(Outcome::ShardDone { missing });
            }
        }
    }
    phases.add("merge parts", step);

    let mut record = FitRecord {
        schema: SCHEMA,
        kind: "leaf".into(),
        name: manifest.name.clone(),
        program: concat!("mesophyll ", env!("CARGO_PKG_VERSION")).into(),
        input_hash: input,
        ..FitRecord::default()
    };
    output::describe(&mut record, &capture, options, &level, &splits);
    let mut times = Times {
        capture: Some(capture.folder.display().to_string()),
        threads: rayon::current_num_threads(),
        ..Times::default()
    };
    let mut done = Vec::new();
    for (measured, maps) in sides.into_iter().zip(merged) {
        let step = Instant::now();
        let _bar = Bar::of(format!("{}: interior", measured.side.name()));
        let fitted = interior::fit(&capture, measured, maps, options, &level, &mut times)?;
        phases.add(&format!("{}: interior", fitted.side.name()), step);
        done.push(fitted);
    }
    sides::compare(&mut done, manifest.thickness_err_mm.unwrap_or(0.0) / manifest.thickness_mm, &mut record);
    let step = Instant::now();
    let blade = output::blade(&capture, &done);
    phases.add("blade", step);
    let step = Instant::now();
    record::begin(out, "leaf")?;
    let mut judged = Vec::new();
    for fitted in &done {
        judged.push(held_out::judge(&capture, record.scan.get_or_insert_default(), &splits, fitted, &level)?);
    }
    phases.add("held-out frames", step);
    let step = Instant::now();
    for (fitted, judged) in done.iter().zip(judged) {
        let truth = truth::compare(&capture, fitted)?;
        output::side(out, &capture, fitted, &level, blade.as_ref(), truth, judged, &mut record)?;
    }
    output::finish(out, &capture, blade.as_ref(), &mut record)?;
    phases.add("write maps", step);
    times.phases = phases.0;
    times.total_s = clock.elapsed().as_secs_f64();
    times.peak_memory_mib = output::peak_memory_mib();
    times.write(out)?;
    record.write(out)?;
    // The parts served their purpose once fit.toml stands; a folder that cannot be removed harms nothing.
    let _ = std::fs::remove_dir_all(&parts);
    if done.iter().all(|d| d.wide_failed()) {
        return Err(Error::Missed(format!(
            "{}: the leaf-wide fit did not converge on any side ({}); maps are written, σa and σs are not to be used",
            out.join("fit.toml").display(),
            done.iter().map(|d| d.termination.name()).collect::<Vec<_>>().join(", ")
        )));
    }
    Ok(Outcome::Done(Box::new(record)))
}

/// Names of the files of W's packed textures in a fit folder.
pub fn map_path(folder: &Path, side: Side, what: &str) -> PathBuf {
    folder.join(format!("{}_{what}.exr", side.name()))
}

/// Wall times in order.
#[derive(Debug, Default)]
struct Phases(Vec<Phase>);

impl Phases {
    fn add(&mut self, name: &str, since: Instant) {
        self.push(name.to_string(), since.elapsed().as_secs_f64());
    }
    fn push(&mut self, name: String, seconds: f64) {
        self.0.push(Phase { name, seconds });
    }
}
