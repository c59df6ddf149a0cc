//! A film: a scene's picture at every step of time, as the wind moves the scene and autumn colours it. The real-time
//! renderer draws it, with a PNG for each frame.
//!
//! A film that was stopped can be continued. A frame is written whole or not at all, and the record beside the frames
//! states what they show.

use crate::draw::handover;
use crate::loaded::LoadedScene;
use crate::path_tracing::{made_from, views};
use crate::placed::ledger::Ledger;
use crate::{Error, Result};
use mesophyll_base::tone::ToneCurve;
use mesophyll_files::image::{self, ChannelMaps, Packing};
use mesophyll_files::progress::{self, TaskProgress};
use mesophyll_files::{atomic, hash, memory};
use mesophyll_viewer as viewer;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The options of `mesophyll film`.
#[derive(Debug, Clone)]
pub struct Options {
    /// Folder of the frames.
    pub out: PathBuf,
    /// The view to draw; the first perspective view when absent.
    pub view: Option<String>,
    /// The wind's time of the first frame (s).
    pub from: f64,
    /// The film ends before this time (s).
    pub to: f64,
    /// Frames for each second.
    pub fps: f64,
    /// Pixels across and down; those of the scene's check when absent.
    pub size: Option<[u32; 2]>,
    /// Writes motion vectors beside every frame.
    pub motion: bool,
    /// The curve from radiance to the frames; the scene's own when absent.
    pub tone: Option<ToneCurve>,
    /// Whether the film replaces another film in the same folder.
    pub force: bool,
}

/// The file that identifies a folder of frames.
pub const RECORD: &str = "film.json";

/// The largest number of frames, about an hour at 30 a second. A larger number is more likely a typing error than
/// meant.
const MOST_FRAMES: f64 = 100_000.0;

/// The content of a folder of frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneFilm {
    /// The scene's name.
    pub film: String,
    /// The view's name.
    pub view: String,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// The wind's time of the first frame (s).
    pub from: f64,
    /// Frames for each second.
    pub fps: f64,
    /// Number of frames of the complete film.
    pub frames: u32,
    /// Hash of everything else that decides the frames, including the adapter that draws.
    pub made_from: String,
}

impl SceneFilm {
    /// The file of frame `k`.
    pub fn frame(&self, folder: &Path, k: u32) -> PathBuf {
        folder.join(format!("frame-{k:05}.png"))
    }

    /// The file of its motion vectors: pixels to the right (`motion.X`) and down (`motion.Y`) since the previous frame,
    /// NaN where nothing is drawn.
    pub fn motion(&self, folder: &Path, k: u32) -> PathBuf {
        folder.join(format!("frame-{k:05}.motion.exr"))
    }

    /// The wind's time of frame `k` (s).
    pub fn time(&self, k: u32) -> f64 {
        self.from + f64::from(k) / self.fps
    }
}

/// Draws the missing frames. The second number is that of the frames that existed already.
///
/// # Errors
/// [`Error::Usage`] for a scene where nothing moves, times that are out of order, a view that the scene does not have,
/// or a folder that holds frames of another film (unless [`Options::force`]); [`Error::Missed`] without an adapter;
/// [`Error::Interrupted`] after Ctrl-C, when all finished frames have been written.
pub fn film(scene: &mut LoadedScene, options: &Options, ledger: &Ledger) -> Result<(SceneFilm, u32)> {
    let drawn_by = |e: viewer::Error| {
        // Drivers that find too little memory are not found themselves.
        let hint = if matches!(e, viewer::Error::NoAdapter) { memory::hint() } else { String::new() };
        Error::Missed(format!("the renderer failed: {e}{hint}"))
    };
    let frames = options.frames()?;
    if !scene.placed.moves().with_time() && !scene.manifest.fades() {
        return Err(Error::Usage(format!("{}: {NOTHING_MOVES}", scene.manifest.path.display())));
    }
    if options.motion && scene.placed.moves().grass {
        return Err(Error::Usage(format!(
            "{}: found a lawn that leans in the wind, which has no motion vectors; expected a film without --motion",
            scene.manifest.path.display()
        )));
    }
    let view = views(scene, options.view.as_deref())?[0].clone();
    let mut renderer = viewer::Renderer::headless(&viewer::Options::default()).map_err(drawn_by)?;
    let adapter = renderer.adapter().clone();
    let drawer = format!("{} {} {}", adapter.name, adapter.backend, adapter.driver);
    let check = &scene.manifest.check;
    let [width, height] = options.size.unwrap_or([check.width, check.height]);
    let most = renderer.gpu().max_side();
    if width.max(height) > most {
        return Err(Error::Usage(format!(
            "frames of {width}x{height} pixels: expected at most {most} on this adapter"
        )));
    }
    // The transfer changes pictures too, and another version of this program may also do so.
    let between = scene.transfer.as_ref().map_or("", |t| &t.record.record_hash);
    let made_from = made_from(scene, &view)?;
    let display = scene.manifest.display_by(options.tone);
    let lawns = lawns(scene)?;
    let film = SceneFilm {
        film: scene.manifest.name.clone(),
        view: view.name.clone(),
        size: [width, height],
        from: options.from,
        fps: options.fps,
        frames,
        made_from: hash::combine(
            [
                ("scene", made_from.as_str()),
                ("transfer", between),
                ("adapter", drawer.as_str()),
                ("curve", display.curve.into()),
                ("version", env!("CARGO_PKG_VERSION")),
            ]
            .into_iter()
            .chain(lawns.iter().map(|(name, record)| (*name, record.as_str()))),
        ),
    };
    claim_frames(&film, options)?;

    // The views and the sizes of their pixels are those of the frames. For example, a wide frame may look down on a
    // lawn.
    (scene.manifest.check.width, scene.manifest.check.height) = (width, height);
    let mut drawn = handover::shown(scene, display, ledger)?;
    renderer.set_scene(&drawn).map_err(drawn_by)?;
    let camera = handover::camera(&view.camera);
    progress::say(format!("drawn by {} ({}, {})", adapter.name, adapter.backend, adapter.driver));
    let bar = TaskProgress::new(format!("film {}", film.film), u64::from(frames));
    let mut kept = 0;
    for k in 0..frames {
        let file = film.frame(&options.out, k);
        let vectors = film.motion(&options.out, k);
        if file.is_file() && (!options.motion || vectors.is_file()) {
            kept += 1;
            bar.advance(1);
            continue;
        }
        if progress::stop_requested() {
            return Err(Error::Interrupted(format!(
                "stopped before frame {k} of {frames}; the frames so far are in {}, and the same command goes on",
                options.out.display()
            )));
        }
        if scene.manifest.fades() {
            scene.manifest.age(film.time(k))?;
            drawn = handover::shown(scene, display, ledger)?;
            renderer.set_scene(&drawn).map_err(drawn_by)?;
        }
        if let Some(wind) = &mut drawn.wind {
            wind.time_s = film.time(k);
            renderer.set_time(wind);
        }
        if options.motion {
            let mut before = drawn.wind;
            if let Some(wind) = &mut before {
                wind.time_s -= 1.0 / film.fps;
            }
            let [width, height] = film.size;
            let moved = renderer.motion(&drawn, &camera, &camera, before.as_ref(), width, height).map_err(drawn_by)?;
            let axis = |c: usize| moved.iter().map(|m| m.map_or(f32::NAN, |m| m[c])).collect::<Vec<f32>>();
            let channels = vec![("motion.X".to_string(), axis(0)), ("motion.Y".to_string(), axis(1))];
            let maps = ChannelMaps { width: width as usize, height: height as usize, channels };
            image::write_exr(&vectors, &maps, Packing::Zip)?;
        }
        let picture = renderer.render(&camera, film.size[0], film.size[1]).map_err(drawn_by)?;
        image::write_png(&file, picture.width as usize, picture.height as usize, picture.ldr.as_flattened())?;
        bar.advance(1);
    }
    Ok((film, kept))
}

/// The error for a scene without motion.
pub const NOTHING_MOVES: &str = "nothing moves in this scene, so all frames would be equal; expected a [wind] and a \
    plant or a lawn that it moves, or a leaf with fades_to below its chlorophyll";

impl Options {
    /// Number of frames.
    ///
    /// # Errors
    /// [`Error::Usage`] for times out of order, and for more than 100,000 frames.
    pub fn frames(&self) -> Result<u32> {
        let (from, to) = (self.from, self.to);
        if !(from.is_finite() && to.is_finite() && to > from) {
            let expected = "expected two times (s), the first before the other";
            return Err(Error::Usage(format!("--from {from} --to {to}: {expected}")));
        }
        // A frame whose time reaches the end only by rounding is not drawn.
        let count = ((to - from) * self.fps - 1e-6).ceil();
        if !(count <= MOST_FRAMES) {
            return Err(Error::Usage(format!("{count} frames from {from} to {to} s: expected at most {MOST_FRAMES}")));
        }
        Ok(count.max(1.0) as u32)
    }
}

/// The record of every fit of slices, by the lawn's name. Only films use slices; path-traced pictures show the blades.
fn lawns(scene: &LoadedScene) -> Result<Vec<(&str, String)>> {
    let manifest = &scene.manifest;
    let fitted = manifest.grass.iter().filter_map(|g| Some((g.name.as_str(), manifest.resolve(g.fit.as_ref()?))));
    fitted.map(|(name, fit)| Ok((name, hash::file(&fit.join("fit.toml"))?))).collect()
}

/// Writes the record of a new film, or accepts that of the same film.
fn claim_frames(film: &SceneFilm, options: &Options) -> Result<()> {
    let record = options.out.join(RECORD);
    let there: Option<SceneFilm> = match std::fs::read(&record) {
        Ok(_) if options.force => None,
        Ok(bytes) => Some(serde_json::from_slice(&bytes).map_err(|e| {
            Error::input(&record, format!("not the record of a film ({e}); give --force to draw anew"))
        })?),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => None,
        // The owner of these frames is unknown, so none of them is removed.
        Err(e) => return Err(Error::input(&record, atomic::explain(&e))),
    };
    match there {
        // A film with the same pictures and another length: a longer film continues a shorter one.
        Some(there) if SceneFilm { frames: film.frames, ..there.clone() } == *film => {}
        Some(there) if has_frames(&options.out) => {
            return Err(Error::Usage(format!(
                "{}: holds {} frames of another film (view {}, from {} s, {} a second, {}×{} pixels) or of a scene, \
                 fit or adapter that has changed since; name another folder, or give --force to draw anew",
                options.out.display(),
                there.frames,
                there.view,
                there.from,
                there.fps,
                there.size[0],
                there.size[1]
            )));
        }
        _ => remove_frames(&options.out)?,
    }
    let json = serde_json::to_string_pretty(film).unwrap_or_default();
    atomic::write_bytes(&record, json.as_bytes())
}

/// Whether a file is a frame or its motion vectors, judged by its name.
fn is_frame(entry: &std::fs::DirEntry) -> bool {
    let name = entry.file_name();
    let name = name.to_string_lossy();
    let number = name.strip_prefix("frame-").and_then(|n| n.strip_suffix(".png").or(n.strip_suffix(".motion.exr")));
    number.is_some_and(|n| n.parse::<u32>().is_ok())
}

fn has_frames(folder: &Path) -> bool {
    std::fs::read_dir(folder).into_iter().flatten().flatten().any(|entry| is_frame(&entry))
}

/// Removes the frames of another film, before the record describes this one.
fn remove_frames(folder: &Path) -> Result<()> {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if is_frame(&entry) {
            std::fs::remove_file(entry.path()).map_err(|e| Error::write(&entry.path(), atomic::explain(&e)))?;
        }
    }
    Ok(())
}
