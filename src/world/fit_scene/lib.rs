//! `fit scene`: what leaves, ground and light of a scene are, from pictures of it, by gradients through the path
//! tracer.
//!
//! The scene states geometry, cameras and starting values; pictures are linear radiance. Light is followed through all
//! scatterings between leaves, and each path carries the derivatives by the unknown numbers
//! ([`mesophyll_transport::path::slopes`]). Standard errors hold the noise of the measurement and that of our own
//! pictures. Readings that the fit did not see, and whole pictures that are kept from it, judge the result.

#![warn(missing_docs)]
// A comparison with NaN is false, so `!(a < b)` is written where NaN must fail.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod area;
#[cfg(test)]
mod area_tests;
mod bands;
#[cfg(test)]
mod bands_tests;
mod covariance;
pub mod design;
mod judge;
mod mapped;
mod photographs;
mod pictures;
pub mod processor;
mod quantity;
mod reflectances;
mod residuals;
mod scatter;
mod scene_file;
mod step;
mod steps;
pub mod synthetic;
#[cfg(test)]
mod tests;
mod tissue;
#[cfg(test)]
mod tissue_tests;
mod unknowns;

pub(crate) use mesophyll_base::error::{Error, Result};
use mesophyll_files::{atomic, hash, memory};
use mesophyll_fits::record::maker::{self, FitMaker, FitOutcome};
use mesophyll_fits::record::{FitKind, FitRecord, RecordSection};
use mesophyll_scene::draw::reference;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_transport::path::Canopy;
use mesophyll_transport::world::ReferenceWorld;
use photographs::ScenePhotograph;
pub use reflectances::wavelengths;
use std::path::{Path, PathBuf};
use unknowns::SceneUnknowns;

/// The options of a fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Most paths a pixel of a step's pictures.
    pub samples: u32,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Fit again although the folder already holds this very fit.
    pub force: bool,
}

/// Most paths a pixel, where nothing else is asked for.
pub const SAMPLES: u32 = 1024;
/// How numbers are found. It changes when the same pictures give other numbers.
const METHOD: &str = "three sets of paths a step; curvature of at least half of its own paths; even draws of discs";
/// The scene with what was found, in the fit's folder.
pub const SCENE: &str = "scene.toml";
/// The steps, in the fit's folder.
pub const TRACE: &str = "trace.csv";

/// Finds the unknown numbers of `scene` and writes them into the folder `out`.
///
/// # Errors
/// [`Error::Input`] for tables or pictures that cannot be used, before anything is drawn; [`Error::Interrupted`] after
/// a stop; what [`maker::make`] gives.
pub fn run(scene: &LoadedScene, out: &Path, options: &Options, ledger: &Ledger) -> Result<FitOutcome> {
    let manifest = &scene.manifest;
    manifest.require_pictures()?;
    let wavelengths = wavelengths(manifest)?;
    let shots = photographs::read(manifest, wavelengths.as_deref())?;
    let world = reference::traced(scene, manifest.rest_time(), ledger)?;
    require_canopy(manifest, &world, options.seed, wavelengths.is_some())?;
    let mut groups: Vec<String> = shots.iter().filter_map(|s| s.exposure.clone()).collect();
    groups.sort();
    groups.dedup();
    let mut numbers = SceneUnknowns::new(scene, world, &groups, wavelengths.as_deref(), ledger)?;
    numbers.seed = options.seed;
    // Two pictures of all derivatives, the same as a list, and the readings.
    let [pixels, readings] = [0, 1].map(|k| shots.iter().map(|s| [s.uses.len(), s.seen.len()][k]).sum::<usize>());
    let bytes = readings as u64 * (40 * numbers.list.len() as u64 + 134);
    memory::require(
        bytes + numbers.disc_bytes(),
        &format!("{pixels} pixels with {} unknowns (smaller pictures need less)", numbers.list.len()),
    )?;
    let hash = input_hash(manifest, options)?;
    let (manifest, options) = (manifest.clone(), *options);
    let read = manifest.taken.iter().map(|t| &t.file).chain(manifest.factors.iter().map(|f| &f.file));
    let inputs: Vec<PathBuf> =
        std::iter::once(manifest.path.clone()).chain(read.map(|file| manifest.resolve(file))).collect();
    let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
    maker::make(FitKind::Scene, out, &inputs, move |maker| fit(&manifest, numbers, shots, &hash, &options, maker))
}

/// Refuses a scene whose reflectance factors were measured, and that can have none.
fn require_canopy(manifest: &SceneManifest, world: &ReferenceWorld, seed: u64, bands: bool) -> Result<()> {
    if manifest.factors.is_empty() {
        return Ok(());
    }
    Canopy::new(world, seed).map_err(|what| Error::input(&manifest.path, what))?;
    let light = world.sun.as_ref().map_or([0.0; 3], |sun| sun.irradiance);
    // Bands are lit alike, whatever the sun's channels are.
    let lit = if bands { light.iter().any(|e| *e > 0.0) } else { light.iter().all(|e| *e > 0.0) };
    if !lit {
        let what = "found a channel with 0, expected a sun that shines in all three, as reflectance factors need";
        return Err(Error::field(&manifest.path, "sun.irradiance", what));
    }
    Ok(())
}

fn fit(
    manifest: &SceneManifest,
    mut numbers: SceneUnknowns,
    mut shots: Vec<ScenePhotograph>,
    hash: &str,
    options: &Options,
    maker: &mut FitMaker,
) -> Result<FitOutcome> {
    if let Some(found) = maker.up_to_date(hash.to_string(), options.force)? {
        return Ok(found);
    }
    let found = maker.phase("steps", || steps::find(&mut numbers, &mut shots, options))?;
    let mut record = maker.record(&manifest.name);
    record.termination = Some(found.termination);
    let mut say = |name: &str, text: String| record.options.insert(name.into(), text);
    say("paths", format!("{} a pixel in the last pictures", found.paths));
    say("seed", options.seed.to_string());
    say("pictures", shots.iter().map(|s| s.name.as_str()).collect::<Vec<_>>().join(", "));
    let section = judge::section(&numbers, &shots, &found, &mut record);
    let scale = "blue -4 to red +4 standard errors of a reading less the scene; grey: does not count";
    record.options.insert("residual_pictures".into(), format!("red, green and blue side by side, {scale}"));
    maker.times.traces.insert("steps".into(), found.steps.iter().map(|step| step.row).collect());
    let out = maker.begin()?.to_path_buf();
    let mut files = residuals::pictures(&shots, &found, &out)?;
    files.extend(residuals::tables(&numbers, &shots, &found, &out)?);
    files.extend(bands::save(&numbers, &section, &out)?);
    record.sections.insert("all".into(), section);
    files.extend(found_leaves(&numbers, &out)?);
    for (name, list) in numbers.found_discs() {
        let file = scene_file::disc_file(&name);
        atomic::write_bytes(&out.join(&file), list.as_bytes())?;
        files.push(file);
    }
    atomic::write_bytes(&out.join(SCENE), scene_file::found(manifest, &numbers, &out)?.as_bytes())?;
    files.push(SCENE.into());
    let text = residuals::steps(&found, &numbers.values(), &covariance::unit(&numbers));
    atomic::write_bytes(&out.join(TRACE), text.as_bytes())?;
    for file in files {
        record.files.insert(file.clone(), hash::file(&out.join(file))?);
    }
    Ok(FitOutcome::Done(maker.finish(record)?))
}

/// Writes every fit whose numbers were unknown, with what was found, into a folder of its own. Returns the names of the
/// files that identify these.
fn found_leaves(numbers: &SceneUnknowns, out: &Path) -> Result<Vec<String>> {
    let mut files = Vec::new();
    for (name, k, maps) in numbers.mapped() {
        let folder = scene_file::leaf_folder(&name);
        maps.save(k, &numbers.list, &out.join(&folder))?;
        files.push(format!("{folder}/{}", mesophyll_fits::record::RECORD));
    }
    Ok(files)
}

/// The hash of everything that decides a fit: the scene's text, and every file that it names.
fn input_hash(manifest: &SceneManifest, options: &Options) -> Result<String> {
    let mut told = format!("{} {}", options.samples, options.seed);
    for file in scene_file::named(manifest)? {
        // Of a folder, such as a fit, the record says what is in it.
        let file = if file.is_dir() { file.join(mesophyll_fits::record::RECORD) } else { file };
        if file.is_file() {
            told += &format!(" {}", hash::file(&file)?);
        }
    }
    let scene = mesophyll_files::whole_file::text(&manifest.path)?;
    Ok(maker::input_hash([("method", METHOD), ("scene", scene.as_str()), ("files", told.as_str())]))
}

/// A summary of a fit for people: each number with its error.
pub fn summary(record: &FitRecord) -> String {
    let mut text = String::new();
    let none = RecordSection::default();
    let section = record.sections.get("all").unwrap_or(&none);
    for (name, param) in &section.params {
        let (value, error) = (param.value.first().copied().unwrap_or(f64::NAN), param.stderr.first());
        text += &match (param.undetermined.first(), error) {
            (Some(why), _) => {
                format!("{name}: undetermined, {}\n", why.rsplit_once(": ").map_or(why.as_str(), |w| w.1))
            }
            (None, error) => {
                let error = error.copied().unwrap_or(0.0);
                // Two digits of the error.
                let places = (1 - error.max(1e-9).log10().floor() as i32).clamp(0, 10) as usize;
                format!("{name} = {value:.places$} ± {error:.places$}\n")
            }
        };
    }
    for (what, count) in section.counts.iter().filter(|(_, count)| **count > 0) {
        text += &format!("{count} {} left out\n", what.replace('_', " "));
    }
    for (what, residuals) in &section.residuals {
        text += &format!("{what}: {} readings, reduced χ² {:.4}\n", residuals.samples, residuals.reduced_chi2);
    }
    text
}
