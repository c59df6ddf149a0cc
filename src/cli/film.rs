//! `mesophyll film`.

use super::CommonArgs;
use crate::cli::names::named;
use crate::cli::{Error, Result};
use mesophyll_base::tone::ToneCurve;
#[cfg(feature = "render")]
use std::path::Path;
use std::path::PathBuf;

/// Draws a moving scene as a film: a PNG a frame, or a video where ffmpeg is installed.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  mesophyll film data/scenes/breeze.toml --to 4 -o out/breeze\n  \
     mesophyll film data/scenes/breeze.toml --from 10 --to 20 --fps 25 --size 800x600 -o out/breeze.mp4\n\n\
    The frames are frame-00000.png and so on. A film that was stopped goes on by the same command. Fits that are \
    missing are made first and kept in DIR/fits. For a video, the frames lie in the folder FILE.frames beside it.")]
pub struct Args {
    /// Scene with a [wind], or with a leaf that fades (`fades_to`)
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// Folder for the frames, or a video to write
    #[arg(short, long, alias = "output", value_name = "DIR|FILE.mp4", value_parser = super::destination::folder())]
    out: PathBuf,
    /// Which view (default: the first perspective view)
    #[arg(long, value_name = "NAME")]
    view: Option<String>,
    /// The wind's time of the first frame
    #[arg(long, value_name = "S", default_value_t = 0.0, allow_negative_numbers = true)]
    from: f64,
    /// The film ends before this time
    #[arg(long, value_name = "S", default_value_t = 10.0, allow_negative_numbers = true)]
    to: f64,
    /// Frames a second
    #[arg(long, value_name = "N", default_value_t = 30.0, value_parser = super::render::positive)]
    fps: f64,
    /// Pixels (default: the scene's check.width and check.height)
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    size: Option<[u32; 2]>,
    /// Also write motion vectors, frame-00000.motion.exr and so on: pixels to the right and down since the frame before
    #[arg(long)]
    motion: bool,
    /// How radiance becomes a frame (default: film where the scene has a [camera], else reinhard)
    #[arg(long, value_parser = named::<ToneCurve>())]
    tone: Option<ToneCurve>,
    /// Draw anew although the folder holds another film
    #[arg(long)]
    force: bool,
}

/// Parses the size of pictures.
pub(super) fn size(text: &str) -> std::result::Result<[u32; 2], String> {
    let sides: Option<[u32; 2]> = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    // A side that is longer than any adapter draws is more likely a typing error than meant.
    let sides = sides.filter(|s| s.iter().all(|n| (1..=65_536).contains(n)));
    sides.ok_or_else(|| "expected WIDTHxHEIGHT, such as 800x600, with at most 65536 pixels a side".into())
}

#[cfg(feature = "render")]
pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    use mesophyll_files::{claim, progress};
    use mesophyll_scene::film::{self, Options};
    use mesophyll_scene::placed::ledger::Ledger;

    let manifest = mesophyll_scene::manifest::SceneManifest::read(&args.scene)?;
    let mut options = Options {
        out: args.out.clone(),
        view: args.view.clone(),
        from: args.from,
        to: args.to,
        fps: args.fps,
        size: args.size,
        motion: args.motion,
        tone: args.tone,
        force: args.force,
    };
    // Everything that can be refused is refused before a fit is made.
    options.frames()?;
    if manifest.wind.is_none() && !manifest.fades() {
        return Err(Error::Usage(format!("{}: {}", args.scene.display(), film::NOTHING_MOVES)));
    }
    let video = args.out.extension().is_some_and(|e| e.eq_ignore_ascii_case("mp4")).then_some(args.out.as_path());
    let folder = video.map_or(args.out.clone(), |v| v.with_extension("frames"));
    if let Some(video) = video {
        if !ffmpeg(Path::new("."), &["-version"])?.status.success() {
            return Err(Error::Usage("the program ffmpeg does not run; name a folder for the frames".into()));
        }
        if video.is_dir() {
            return Err(Error::Usage(format!("{}: found a folder, expected the name of a video", video.display())));
        }
        claim::file(video, &["mp4"], &[&args.scene])?;
    }
    let _claim = claim::folder(&folder, claim::OutputKind::Film, &[&args.scene])?;
    let ledger = Ledger::new();
    let mut scene = super::preparation::scene(manifest, &folder, &ledger)?;
    scene.find_transfer(&folder, &ledger)?;
    options.out.clone_from(&folder);
    let (film, kept) = film::film(&mut scene, &options, &ledger)?;
    if let Some(video) = video {
        encode(&folder, &film, video)?;
    }
    let written = video.unwrap_or(&folder);
    if common.json {
        super::print_json(&serde_json::json!({ "film": film, "frames_kept": kept, "written": written }))?;
    } else {
        let earlier = if kept > 0 { format!(", {kept} of them from an earlier run") } else { String::new() };
        let (first, last) = (film.time(0), film.time(film.frames - 1));
        let frames = film.frames;
        let what = format!("{frames} frames of {}, {first} to {last:.3} s{earlier}", film.view);
        super::print(&format!("{what}; {}\n", written.display()))?;
    }
    progress::pause();
    Ok(0)
}

/// Runs ffmpeg in a folder and waits for it.
#[cfg(feature = "render")]
fn ffmpeg(folder: &Path, arguments: &[&str]) -> Result<std::process::Output> {
    let mut program = std::process::Command::new("ffmpeg");
    program.args(arguments).current_dir(folder).stdin(std::process::Stdio::null()).output().map_err(|e| {
        Error::Usage(format!(
            "a video needs the program ffmpeg, which could not be started ({}); install it (on Debian: apt-get install \
             ffmpeg), or name a folder for the frames",
            mesophyll_files::atomic::explain(&e)
        ))
    })
}

/// Frames to a video that common players show: H.264, sides even, nearly lossless. Written whole or not at all.
#[cfg(feature = "render")]
fn encode(folder: &Path, film: &mesophyll_scene::film::SceneFilm, video: &Path) -> Result<()> {
    use mesophyll_files::atomic;
    // The video is first made beside the frames, so that a stopped run leaves no strange file where the video goes. The
    // names are plain, because ffmpeg gives % and : in a path a meaning of its own. What a killed run left is replaced.
    const HALF: &str = ".video.partial.mp4";
    let whole = folder.join(HALF);
    let (rate, frames) = (film.fps.to_string(), film.frames.to_string());
    let filter = "pad=ceil(iw/2)*2:ceil(ih/2)*2";
    let read = ["-y", "-loglevel", "error", "-framerate", &rate, "-i", "frame-%05d.png", "-frames:v", &frames];
    let write = ["-vf", filter, "-c:v", "libx264", "-crf", "14", "-pix_fmt", "yuv420p", HALF];
    let done = ffmpeg(folder, &[&read[..], &write[..]].concat())?;
    if !done.status.success() {
        // On a full disk it leaves a part.
        let _ = std::fs::remove_file(&whole);
        let said = String::from_utf8_lossy(&done.stderr);
        let last = said.lines().rev().find(|l| !l.trim().is_empty()).unwrap_or("no reason given");
        return Err(Error::Missed(format!("ffmpeg could not make the video: {}; the frames are kept", last.trim())));
    }
    let bytes = std::fs::read(&whole).map_err(|e| Error::input(&whole, atomic::explain(&e)))?;
    let written = atomic::write_bytes(video, &bytes);
    let removed = std::fs::remove_file(&whole).map_err(|e| Error::write(&whole, atomic::explain(&e)));
    // Where both failed, the user needs to know why there is no video.
    written.and(removed)
}

#[cfg(not(feature = "render"))]
pub fn run(_args: &Args, _common: &CommonArgs) -> Result<u8> {
    Err(Error::Missed("nothing draws a film: this build has no renderer (feature `render`)".into()))
}
