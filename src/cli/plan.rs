//! `mesophyll plan`.

use super::CommonArgs;
use crate::cli::Result;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::placed::{leaf::LeafSearch, ledger::Ledger};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  mesophyll plan data/scenes/glossy-sky.toml\n  mesophyll plan data/scenes/back-lit.toml \
     --json"
)]
pub struct Args {
    /// Scene to plan
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// Folder of an earlier run, whose fits count as done
    #[arg(short, long, alias = "output", value_name = "DIR", value_parser = super::destination::folder())]
    out: Option<PathBuf>,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    say(&args.scene, args.out.as_deref(), common)
}

/// Prints the plan of a scene; fits in `out` count as done.
///
/// # Errors
/// Those of reading the scene and its fits, and of standard output.
pub fn say(scene: &Path, out: Option<&Path>, common: &CommonArgs) -> Result<u8> {
    let manifest = SceneManifest::read(scene)?;
    let search = LeafSearch { out, compared: true, free: false };
    let plan = LoadedScene::open(manifest, search, &Ledger::new())?.plan;
    if common.json {
        super::print_json(&plan)?;
    } else {
        super::print(&plan.text())?;
    }
    Ok(0)
}
