//! `fit transfer`: the light that arrives at the leaves of a scene between and by way of other leaves, stored in a
//! folder like any fit.
//!
//! The folder holds `operators.exr` (the entries of [`mesophyll_transport::transfer::operator`], in half floats),
//! `fit.toml` and `times.toml`. With the sun's shadows it also holds `sun.visibility`. The input hash covers every
//! mesh, map and place of the scene, and the light where the light does not move. A fit that was stopped continues from
//! its finished parts.

#![warn(missing_docs)]

mod layout;
mod matter;
mod store;
mod sun;
#[cfg(test)]
mod tests;

pub use layout::{LeafRows, TransferLayout};
use mesophyll_base::statistics::lower_quantile;
pub use store::{OPERATORS, TransferFit};
pub use sun::{FreeSun, SUN, SunShadowMaps, TransferSun};

use crate::record::maker::{self, FitMaker, FitOutcome};
use crate::record::{FitKind, FitRecord, RecordSection};
use mesophyll_base::error::{Error, Result};
use mesophyll_files::image::{ChannelMaps, Packing, write_exr};
use mesophyll_files::{hash, memory, progress};
use mesophyll_transport::path::{PathSettings, PathTracer};
use mesophyll_transport::transfer::{self, TransferColumns, TransferMethod, TransferReceiver, TransferRequest};
use mesophyll_transport::world::ReferenceWorld;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// The options of a transfer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// How light between surfaces is found.
    pub method: TransferMethod,
    /// Number of anchors along a leaf and across it.
    pub anchors: [usize; 2],
    /// The functions that the light is a sum of.
    pub columns: TransferColumns,
    /// Number of bands of the harmonics for a glossy leaf, 1 to 7.
    pub gloss_bands: usize,
    /// Number of paths from each anchor.
    pub paths: u32,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Computes again although the folder holds this very fit.
    pub force: bool,
}

/// A scene and what its transfer is made for.
#[derive(Debug, Clone)]
pub struct TransferScene {
    /// Name of the scene.
    pub name: String,
    /// The things that stand in it, and its light.
    pub world: Arc<ReferenceWorld>,
    /// How many of the world's leaves, counted from the first, are leaves. The others are wood and ground.
    pub leaves: usize,
    /// Whether any picture will show each instance. Instances beyond the end of the list count as shown.
    pub seen: Vec<bool>,
    /// For each instance, the instance of the same leaf whose light it shows: itself, or another one, which stands for
    /// it. One that shows another's light does not count as seen. Instances beyond the end show their own.
    pub sources: Vec<usize>,
    /// The sun whose shadows are computed too ([`TransferScene::under_sun`]).
    pub sun: Option<TransferSun>,
}

/// Bytes of memory for each entry while it is computed: its four numbers as they are traced, scaled, packed and read
/// again.
pub const BYTES_AN_ENTRY: u64 = 64;
/// The largest buffer (bytes) that every adapter can bind, by WebGPU's default limits. Mesa's software adapter has no
/// larger one.
const BUFFER_OF_EVERY_ADAPTER: u64 = 128 << 20;

/// How entries are computed. It changes when the same scene gets other entries.
const METHOD: &str = "Gaussian neighbourhoods of 32 points; wood by its triangles' middles; in units of the light";
/// What the parts of this fit hold. It changes when their format changes.
const PART: &str = "entries of about 2,000 anchors as EXR, their errors";
/// The least number of anchors in a part.
const ANCHORS_A_PART: usize = 2000;

/// What a finished part records beside its entries.
#[derive(Serialize, Deserialize)]
struct Part {
    /// The error at each anchor; see [`transfer::InstanceTransfer`].
    errors: Vec<f32>,
}

/// Makes the transfer of `scene` in the folder `out`. `inputs` are the files that the scene is made from. They must not
/// lie in this folder.
///
/// # Errors
/// [`Error::Input`] for a world that contradicts itself, [`Error::Usage`] where it would need more memory than there
/// is, [`Error::Interrupted`] after a stop (finished parts are kept), and what [`maker::make`] gives.
pub fn run(scene: &TransferScene, inputs: &[&Path], out: &Path, options: &Options) -> Result<FitOutcome> {
    let (scene, options) = (scene.clone(), *options);
    maker::make(FitKind::Transfer, out, inputs, move |maker| fit(&scene, &options, maker))
}

fn fit(scene: &TransferScene, options: &Options, maker: &mut FitMaker) -> Result<FitOutcome> {
    let hash = maker.phase("look", || Ok(input_hash(scene, options)))?;
    if let Some(found) = maker.up_to_date(hash, options.force)? {
        return Ok(found);
    }
    let world = &*scene.world;
    let layout = maker.phase("anchors", || Ok(TransferLayout::new(scene, options)))?;
    let columns = options.columns.count();
    let bytes = (layout.rows * columns) as u64 * BYTES_AN_ENTRY;
    memory::require(bytes, &format!("the transfer of {} anchors", layout.anchors()))?;
    // Entries take 8 bytes, and the light that arrives 16 a row.
    let uploaded = (layout.rows * (8 * columns).max(16)) as u64;
    if uploaded > BUFFER_OF_EVERY_ADAPTER {
        progress::say(format!(
            "{}: the transfer of {} anchors takes a buffer of {} MiB on the adapter, and not every adapter has buffers \
             of more than {} MiB: some cannot draw it in real time. Fewer transfer.anchors take less, and so does \
             transfer.shared where copies stand in a list",
            scene.name,
            layout.anchors(),
            uploaded >> 20,
            BUFFER_OF_EVERY_ADAPTER >> 20
        ));
    }
    let tracer = maker.phase("box trees", || PathTracer::new(world, PathSettings::default()))?;
    let bar = progress::TaskProgress::new("transfer", layout.anchors() as u64);
    let (mut entries, mut errors) = (Vec::with_capacity(layout.rows * columns), Vec::new());
    let scale = matter::scale(world, options.columns);
    let request =
        TransferRequest { method: options.method, columns: options.columns, paths: options.paths, seed: options.seed };
    let start = std::time::Instant::now();
    for (k, part) in layout.parts(ANCHORS_A_PART).into_iter().enumerate() {
        let name = format!("part-{k}");
        let Part { errors: of_part } = maker.part(PART, &name, |folder, _| {
            let (mut found, mut errors) = (Vec::new(), Vec::new());
            for instance in part.clone().filter(|k| layout.is_own(*k)) {
                let leaf = &layout.leaves[world.instances[instance].leaf];
                let receiver = TransferReceiver { instance, anchors: &leaf.anchors.points, rows: leaf.rows };
                let of = transfer::measure(&tracer, &receiver, &request);
                progress::go_on()?;
                found.extend(of.entries.into_iter().map(|e| e.map(|v| v / scale)));
                errors.extend(of.errors);
            }
            write_exr(&folder.join(format!("{name}.exr")), &store::maps(&found), Packing::Half)?;
            Ok(Part { errors })
        })?;
        bar.advance(of_part.len() as u64);
        let path = maker.parts(PART).join(format!("{name}.exr"));
        let rows: usize = part.map(|i| layout.rows_of(world, i)).sum();
        match store::entries(&path, rows * columns) {
            Ok(found) => entries.extend(found),
            Err(error) => {
                // The damaged part would make every further run fail too.
                let _ = std::fs::remove_dir_all(maker.parts(PART));
                return Err(Error::input(
                    &path,
                    format!("a finished part is damaged ({error}); the parts were removed, run the same command again"),
                ));
            }
        }
        errors.extend(of_part);
    }
    maker.times.phase("paths", start);
    let sun = maker.phase("sun", || scene.sun.as_ref().map(|sun| sun.maps(world)).transpose())?;
    let mut record = maker.record(&scene.name);
    describe(&mut record, &layout, options, &errors, entries.len());
    store::note(&mut record, &scene.seen);
    if let Some(maps) = &sun {
        let section = record.sections.entry("sun".into()).or_default();
        section.counts.insert("directions".into(), maps.directions().len());
        section.counts.insert("vertices".into(), maps.receivers());
        section.figures.insert("bytes".into(), maps.bytes() as f64);
    }
    let out = maker.begin()?;
    let maps: ChannelMaps = store::maps(&entries);
    write_exr(&out.join(OPERATORS), &maps, Packing::Half)?;
    record.files.insert(OPERATORS.into(), hash::file(&out.join(OPERATORS))?);
    store::preview(out, &layout, world, &entries, columns)?;
    if let Some(maps) = sun {
        maps.write(&out.join(SUN))?;
        record.files.insert(SUN.into(), hash::file(&out.join(SUN))?);
    }
    Ok(FitOutcome::Done(maker.finish(record)?))
}

/// The hash of everything that decides the transfer of a scene.
pub fn input_hash(scene: &TransferScene, options: &Options) -> String {
    let mut told = format!(
        "{:?} {:?} {} {} {} {:?}",
        options.anchors, options.columns, options.gloss_bands, options.paths, options.seed, scene.seen
    );
    if !scene.sources.is_empty() {
        told += &format!(" {:?}", scene.sources);
    }
    if options.method != TransferMethod::Paths {
        told += &format!(" {:?}", options.method);
    }
    let matter = matter::hash(&scene.world, scene.leaves);
    let light = match options.columns {
        TransferColumns::Harmonics(_) => String::new(),
        TransferColumns::Light => matter::light_hash(&scene.world),
    };
    let sun = scene.sun.as_ref().map_or(String::new(), TransferSun::hash);
    maker::input_hash([
        ("method", METHOD),
        ("matter", matter.as_str()),
        ("light", light.as_str()),
        ("sun", sun.as_str()),
        ("options", told.as_str()),
    ])
}

/// Writes what the record says of the fit.
fn describe(record: &mut FitRecord, layout: &TransferLayout, options: &Options, errors: &[f32], entries: usize) {
    let mut say = |name: &str, text: String| record.options.insert(name.into(), text);
    say("anchors", format!("{}x{} a leaf", options.anchors[0], options.anchors[1]));
    say(
        "light",
        match options.columns {
            TransferColumns::Harmonics(bands) => format!("harmonics of {bands} bands"),
            TransferColumns::Light => "the scene's own, standing still".into(),
        },
    );
    if options.method == TransferMethod::AmbientOcclusion {
        say("method", "multi-bounce ambient occlusion: one ray each, what lies behind is estimated".into());
    }
    say("paths", options.paths.to_string());
    say("seed", options.seed.to_string());
    let mut section = RecordSection::default();
    let dark = errors.iter().filter(|e| e.is_nan()).count();
    section.counts.insert("anchors".into(), layout.anchors());
    section.counts.insert("rows".into(), layout.rows);
    section.counts.insert("columns".into(), options.columns.count());
    section.counts.insert("no_light".into(), dark);
    let mut known: Vec<f32> = errors.iter().copied().filter(|e| e.is_finite()).collect();
    let mut at = |share: f64| lower_quantile(&mut known, share).map_or(f64::NAN, f64::from);
    for (name, value) in [("irradiance_error_median", at(0.5)), ("irradiance_error_worst", at(1.0))] {
        section.figures.insert(name.into(), value);
    }
    section.figures.insert("bytes_on_gpu".into(), (entries * 8) as f64);
    record.sections.insert("transfer".into(), section);
}
