//! Pictures by the path tracer: for each perspective view, a file of radiance and its standard error, a PNG, and a file
//! from which a picture that was stopped continues.

use crate::draw::reference;
use crate::loaded::LoadedScene;
use crate::manifest::PerspectiveView;
use crate::placed::ledger::Ledger;
use crate::{Error, Result};
use mesophyll_base::tone::{self, PictureChannels, ToneCurve};
use mesophyll_files::{atomic, hash, image, memory, progress};
use mesophyll_transport::ReferenceWorld;
use mesophyll_transport::path::{DrawingOutcome, PathPicture, PathRequest, PathSettings, PathTracer, SamplingTarget};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The options of `mesophyll render`.
#[derive(Debug, Clone)]
pub struct Options {
    /// Folder of the pictures.
    pub out: PathBuf,
    /// The view to draw; all perspective views when absent.
    pub view: Option<String>,
    /// Camera paths for each pixel. Where neither this nor an error is given, it is the scene's `check.samples`.
    pub samples: Option<u32>,
    /// The largest number of scatterings of a path; no limit when absent.
    pub bounces: Option<u32>,
    /// Median relative error at which a picture is complete.
    pub error: Option<f64>,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Whether an earlier run's pictures are continued.
    pub resume: bool,
    /// The curve from radiance to the PNG; the scene's own when absent.
    pub tone: Option<ToneCurve>,
}

/// The result for one view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PathTracedView {
    /// The view's name.
    pub view: String,
    /// Pixels across and down.
    pub size: [usize; 2],
    /// Seed of the random numbers.
    pub seed: u64,
    /// The largest number of scatterings of a path.
    pub bounces: Option<u32>,
    /// Hash of everything else that decides the picture.
    pub made_from: String,
    /// The least and the largest number of camera paths of a pixel.
    pub samples: [u32; 2],
    /// Median of standard error over radiance, for the pixels that show something.
    pub median_relative_error: Option<f64>,
    /// Number of paths that were cut off, whose light is missing.
    pub cut_paths: u64,
    /// Camera paths in a second, in this run.
    pub paths_per_second: Option<f64>,
    /// Seconds of all runs together.
    pub seconds: f64,
    /// Whether it has the requested number of paths, or the requested error.
    pub done: bool,
}

/// The file that identifies a folder of pictures.
pub const RECORD: &str = "render.json";

#[derive(Debug, Default, Serialize, Deserialize)]
struct Record {
    pictures: BTreeMap<String, PathTracedView>,
}

/// Draws the views of a scene. `tell` is called for each view that is finished or stopped.
///
/// # Errors
/// [`Error::Usage`] for a view that the scene does not have, no samples, or more memory than there is; [`Error::Input`]
/// for a damaged input, or an unfinished picture of something else; [`Error::Interrupted`] after Ctrl-C, when the
/// present state has been written.
pub fn render(
    scene: &LoadedScene,
    options: &Options,
    ledger: &Ledger,
    mut tell: impl FnMut(&PathTracedView) -> Result<()>,
) -> Result<()> {
    let manifest = &scene.manifest;
    let views = views(scene, options.view.as_deref())?;
    let size = [manifest.check.width as usize, manifest.check.height as usize];
    memory::require(PathPicture::bytes(size[0], size[1]), &format!("a picture of {}×{} pixels", size[0], size[1]))?;
    let record = options.out.join(RECORD);
    // A record that cannot be read matters only where pictures are continued from it.
    let mut pictures = if options.resume { known(&record)? } else { known(&record).unwrap_or_default() };
    let mut at: Option<(f64, ReferenceWorld)> = None;
    for view in views {
        let time = manifest.time_of(view);
        let world = match at.take().filter(|(then, _)| *then == time) {
            Some((_, world)) => world,
            None => {
                let mut world = reference::traced(scene, time, ledger)?;
                reference::grain(&mut world, scene);
                world
            }
        };
        let earlier = pictures.get(&view.name).cloned();
        let drawn = one(scene, &world, view, size, options, earlier.as_ref(), &mut |drawn| {
            pictures.insert(view.name.clone(), drawn.clone());
            let json = serde_json::to_string_pretty(&Record { pictures: pictures.clone() }).unwrap_or_default();
            atomic::write_bytes(&record, json.as_bytes())
        })?;
        at = Some((time, world));
        tell(&drawn)?;
        if !drawn.done {
            return Err(Error::Interrupted(format!(
                "{}: stopped after {} paths a pixel; the picture so far is written, and --resume goes on with it",
                view.name, drawn.samples[0]
            )));
        }
    }
    Ok(())
}

/// The perspective views that are requested; at least one.
///
/// # Errors
/// [`Error::Usage`] for a scene without such views, or without this one.
pub fn views<'a>(scene: &'a LoadedScene, name: Option<&str>) -> Result<Vec<&'a PerspectiveView>> {
    let all: Vec<&PerspectiveView> = scene.manifest.perspectives().collect();
    let names = || all.iter().map(|v| v.name.as_str()).collect::<Vec<_>>().join(", ");
    match name {
        _ if all.is_empty() => Err(Error::Usage(format!(
            "{}: has no view with kind = \"perspective\"; nothing to render",
            scene.manifest.path.display()
        ))),
        None => Ok(all),
        Some(name) => match all.iter().find(|v| v.name == name) {
            Some(view) => Ok(vec![view]),
            None => {
                Err(Error::Usage(format!("--view: found \"{name}\", expected one of the scene's views ({})", names())))
            }
        },
    }
}

/// The pictures that a folder's record lists.
fn known(record: &Path) -> Result<BTreeMap<String, PathTracedView>> {
    if !record.exists() {
        return Ok(BTreeMap::new());
    }
    let text = std::fs::read_to_string(record).map_err(|e| Error::input(record, atomic::explain(&e)))?;
    let read: Record = serde_json::from_str(&text).map_err(|e| {
        Error::input(record, format!("not the record of rendered pictures ({e}); draw without --resume"))
    })?;
    Ok(read.pictures)
}

fn one(
    scene: &LoadedScene,
    world: &ReferenceWorld,
    view: &PerspectiveView,
    size: [usize; 2],
    options: &Options,
    earlier: Option<&PathTracedView>,
    note: &mut dyn FnMut(&PathTracedView) -> Result<()>,
) -> Result<PathTracedView> {
    let file = |ending: &str| options.out.join(format!("{}.{ending}", view.name));
    let kept = file("progress.exr");
    let made_from = made_from(scene, view)?;
    let samples = match (options.samples, options.error) {
        (None, None) => Some(scene.manifest.check.samples),
        (samples, _) => samples,
    };
    let mut drawn = PathTracedView {
        view: view.name.clone(),
        size,
        seed: options.seed,
        bounces: options.bounces,
        made_from,
        samples: [0; 2],
        median_relative_error: None,
        cut_paths: 0,
        paths_per_second: None,
        seconds: 0.0,
        done: false,
    };
    let mut picture = PathPicture::new(size[0], size[1]);
    if options.resume && kept.exists() {
        let earlier = earlier.filter(|e| same(e, &drawn)).ok_or_else(|| {
            Error::input(
                &kept,
                "holds a picture of another scene, size, seed or number of bounces; draw without --resume, or into \
                 another folder",
            )
        })?;
        drawn.seconds = earlier.seconds;
        picture = PathPicture::restore(&kept, size)?;
    }
    let tracer = PathTracer::new(world, PathSettings { bounces: options.bounces, ..PathSettings::default() })?;
    let request = PathRequest {
        camera: view.camera,
        size,
        seed: options.seed,
        target: SamplingTarget { samples, error: options.error },
    };
    if !options.resume && kept.exists() {
        // The file is removed before the record lists this picture, because it could be mistaken for its beginning.
        std::fs::remove_file(&kept).map_err(|e| Error::write(&kept, atomic::explain(&e)))?;
    }
    note(&drawn)?;
    let (start, before, seconds) = (Instant::now(), picture.total_paths(), drawn.seconds);
    let mut tell_of = |picture: &PathPicture, done: bool| {
        let elapsed = start.elapsed().as_secs_f64();
        drawn.samples = picture.paths();
        drawn.median_relative_error = picture.median_error();
        drawn.cut_paths = picture.cut;
        drawn.seconds = seconds + elapsed;
        drawn.paths_per_second = Some((picture.total_paths() - before) as f64 / elapsed.max(1e-9));
        drawn.done = done;
        note(&drawn)
    };
    let progress = picture.draw(&tracer, &request, &view.name, &mut |picture| {
        picture.store(&kept)?;
        tell_of(picture, false)
    })?;
    picture.write(&file("exr"))?;
    image::write_png(&file("png"), size[0], size[1], &displayed(&picture, scene, world, view, options)?)?;
    tell_of(&picture, progress == DrawingOutcome::Done)?;
    if picture.cut > 0 {
        progress::say(format!(
            "warning: {}: {} paths were cut off, after {} scatterings or because leaves give more light than they get; \
             the rest of their light is missing",
            view.name,
            picture.cut,
            mesophyll_transport::path::MOST_SCATTERINGS
        ));
    }
    Ok(drawn)
}

fn same(a: &PathTracedView, b: &PathTracedView) -> bool {
    (a.size, a.seed, a.bounces, &a.made_from) == (b.size, b.seed, b.bounces, &b.made_from)
}

/// Hash of the scene file and of every file that a picture of it is made from.
pub(crate) fn made_from(scene: &LoadedScene, view: &PerspectiveView) -> Result<String> {
    let manifest = &scene.manifest;
    let mut parts = vec![("scene".to_string(), hash::file(&manifest.path)?), ("view".to_string(), view.name.clone())];
    for leaf in &scene.placed.leaves {
        if let Some(fitted) = &leaf.fitted {
            parts.push((format!("fit {}", fitted.name), hash::file(&fitted.folder.join("fit.toml"))?));
        }
        if let Some(mesh) = &leaf.mesh {
            let shape = format!("{:?} {:?}", mesh.positions, mesh.indices);
            parts.push((format!("mesh {}", leaf.index), hash::bytes(shape.as_bytes())));
        }
        if let Some(translucent) = leaf.translucent.as_ref().and_then(|t| t.fitted.as_ref()) {
            let record = hash::file(&translucent.folder.join("fit.toml"))?;
            parts.push((format!("translucency {}", leaf.index), record));
        }
    }
    let own = manifest.leaves.iter().filter(|l| l.like.is_none());
    for file in own.filter_map(|l| l.layered()?.stated.pigments.as_ref()) {
        parts.push(("pigments".into(), hash::file(&manifest.resolve(file))?));
    }
    for wood in &scene.placed.wood {
        let shape = format!("{:?} {:?} {:?} {:?}", wood.mesh.positions, wood.mesh.indices, wood.places, wood.bark);
        parts.push((format!("wood {}", wood.name), hash::bytes(shape.as_bytes())));
    }
    for (grass, config) in scene.placed.grass.iter().zip(&manifest.grass) {
        parts.push((format!("meadow {}", grass.name), hash::file(&manifest.resolve(&config.meadow))?));
        parts.push((format!("leaves {}", grass.name), hash::bytes(format!("{:?}", grass.leaves).as_bytes())));
    }
    for stand in &scene.placed.stands {
        let wood = stand.wood.iter().map(|w| (&w.mesh.positions, &w.mesh.indices, w.bark)).collect::<Vec<_>>();
        let shape = hash::text(format_args!("{:?} {wood:?} {:?}", stand.leaves, stand.places));
        parts.push(("stand".into(), shape));
    }
    let placed = format!("{:?}", scene.placed.placements);
    parts.push(("places".into(), hash::bytes(placed.as_bytes())));
    if let Some(sky) = manifest.panorama() {
        let file = hash::file(&manifest.resolve(&sky.environment))?;
        let placed = format!("{:?} {:?} {file}", sky.rotation_deg, sky.scale);
        parts.push(("environment".into(), placed));
    }
    Ok(hash::combine(parts.iter().map(|(a, b)| (a.as_str(), b.as_str()))))
}

/// The picture as it is shown to people. Checks show it with Reinhard's curve and its channels as sRGB.
fn displayed(
    picture: &PathPicture,
    scene: &LoadedScene,
    world: &ReferenceWorld,
    view: &PerspectiveView,
    options: &Options,
) -> Result<Vec<u8>> {
    let display = scene.manifest.display_by(options.tone);
    let exposure = scene.manifest.exposure_of(display.curve);
    let surfaces = match display.channels {
        PictureChannels::Srgb => Vec::new(),
        PictureChannels::Bands => mesophyll_transport::covered(world, &view.camera, [picture.width, picture.height])?,
    };
    let pixel = |(k, radiance): (usize, &[f32; 3])| {
        let surface = surfaces.get(k).map_or(1.0, |s| f64::from(*s));
        display.display(radiance.map(f64::from), surface, exposure).map(tone::quantise)
    };
    Ok(picture.mean.iter().enumerate().flat_map(pixel).collect())
}
