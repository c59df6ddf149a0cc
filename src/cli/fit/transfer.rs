//! `mesophyll fit transfer SCENE -o DIR`.

use crate::cli::Result;
use crate::cli::{CommonArgs, destination};
use mesophyll_fits::record::FitRecord;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_scene::placed::{PlacedScene, leaf::LeafSearch};
use mesophyll_scene::{loaded::LoadedScene, transfer};
use std::path::PathBuf;

/// Fits how the light that reaches each leaf of a scene depends on the light around the scene.
///
/// Part of it passes between the other leaves, and part is scattered by them. The scene's [transfer] sets the
/// resolution. DIR gets operators.exr, a preview, fit.toml and times.toml. `run`, `check`
/// and `view` make it by themselves where a scene lacks it.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  mesophyll fit transfer data/scenes/between.toml -o out/between-transfer")]
pub struct Args {
    /// Scene with a [transfer]
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// Folder to write
    #[arg(short, long = "out", alias = "output", value_name = "DIR", value_parser = destination::folder())]
    output: PathBuf,
    /// Folder of an earlier run, whose fits of the scene's leaves are used
    #[arg(long, value_name = "DIR", value_parser = destination::folder())]
    run: Option<PathBuf>,
    /// Compute again although the folder already holds this very fit
    #[arg(long)]
    force: bool,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let manifest = SceneManifest::read(&args.scene)?;
    let ledger = Ledger::new();
    let search = LeafSearch { out: args.run.as_deref(), compared: true, free: false };
    let placed = PlacedScene::new(&manifest, search, &ledger)?;
    let scene = LoadedScene::new(manifest, placed, &ledger)?;
    scene.require_sound_fits(&ledger)?;
    let outcome = transfer::make(&scene, &args.output, args.force, &ledger)?;
    super::told(outcome, &args.output, common, summary)
}

/// A summary of the record for people.
fn summary(record: &FitRecord) -> String {
    let say = |name: &str| record.options.get(name).map_or("", String::as_str);
    let mut text = format!("{}: {}, {} paths for each anchor\n", record.name, say("light"), say("paths"));
    for (name, section) in &record.sections {
        let count = |k: &str| section.counts.get(k).copied().unwrap_or(0);
        let figure = |k: &str| section.figures.get(k).copied().unwrap_or(f64::NAN);
        if name == "sun" {
            let (maps, vertices) = (count("directions"), count("vertices"));
            text += &format!("sun seen by {vertices} vertices from {maps} directions: {:.0} bytes\n", figure("bytes"));
            continue;
        }
        text += &format!(
            "{} anchors, {} rows of {} columns: {:.2} MB on the adapter\n",
            count("anchors"),
            count("rows"),
            count("columns"),
            figure("bytes_on_gpu") / 1e6
        );
        text += &format!(
            "irradiance known to {:.2} % (median), {:.2} % (worst anchor)\n",
            100.0 * figure("irradiance_error_median"),
            100.0 * figure("irradiance_error_worst")
        );
    }
    text
}
