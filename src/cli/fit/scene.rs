//! `mesophyll fit scene SCENE -o DIR`.

use crate::cli::Result;
use crate::cli::{CommonArgs, destination};
use mesophyll_fit_scene::{Options, SAMPLES, summary, wavelengths};
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::placed::leaf::LeafSearch;
use mesophyll_scene::placed::ledger::Ledger;
use std::path::PathBuf;

/// Finds what leaves, ground and light of a scene are, from linear pictures of it.
///
/// The scene states geometry, cameras and values to start from. [[picture]] tables say what was measured, [unknown]
/// which numbers are unknown. Light is followed through all scatterings between leaves. DIR gets fit.toml (each number
/// with its standard error, or why the pictures do not determine it), residual-VIEW.exr and .png, trace.csv, and
/// scene.toml: the scene with what was found.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example of the tables:
  [[picture]]
  view = \"across\"           the perspective view whose camera took it
  file = \"across.exr\"       linear R, G, B in the scene's units, and error.R, error.G, error.B where there are any
  noise = 0.01              relative standard deviation; beside errors in the file both add as squares
  noise_floor = 0.002       standard deviation where it is dark, in the scene's units; adds too
  mask = \"mask.exr\"         pixels that count, where not all do
  exposure = \"camera-1\"     an unknown factor that pictures with this name share
  sun_deg = [60, 200]       zenith angle and azimuth of its sun, where that is not the scene's
  held_out = true           only predicted, to judge the fit

  [[brf]]                   or a canopy's reflectance factors, under a sun alone
  file = \"brf.csv\"          view_zenith_deg, view_azimuth_deg, brf_r, brf_g, brf_b, and brf_r_err, …; or
                            brf_560, brf_665, … (nm) of leaves and a ground that have spectra

  [unknown]
  leaves = { a = [\"rho_d\", \"rho_t\", \"rho_s\", \"m\"], b = [\"sigma_a\", \"thickness_mm\"] }
  ground = [\"albedo\"]
  sky = [\"scale\", \"turbidity\"]
  sun = [\"irradiance\"]

Leaves with reflectances have rho_d, rho_t, rho_s, m (factors on maps, where they have maps); slabs and fitted leaves
sigma_a, sigma_s, thickness_mm, rho_s, m; leaves of layers chlorophyll, carotenoid, protein, cellulose_lignin, water, or
absorption. Leaves of discs also have area: that of all discs, from 0.2 to 2 times what the scene states. Where brf.file
has wavelengths, leaves have rho_d and rho_t at each, and what is found is written as spectra.

Exit code 1 when the pictures are not explained: by geometry, a camera or a light that is not as stated.")]
pub struct Args {
    /// Scene with [[picture]] and [unknown]
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// Folder to write
    #[arg(short, long = "out", alias = "output", value_name = "DIR", value_parser = destination::folder())]
    output: PathBuf,
    /// Folder of an earlier run, whose fits of the scene's leaves are used
    #[arg(long, value_name = "DIR", value_parser = destination::folder())]
    run: Option<PathBuf>,
    /// Most paths a pixel of a step's pictures; fewer are followed where the measurement is coarser
    #[arg(long, value_name = "N", default_value_t = SAMPLES)]
    #[arg(value_parser = clap::value_parser!(u32).range(16..=65_536))]
    samples: u32,
    /// Seed of the random numbers
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(..1 << 32))]
    seed: u64,
    /// Fit again although the folder already holds this very fit
    #[arg(long)]
    force: bool,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let mut manifest = SceneManifest::read(&args.scene)?;
    manifest.require_pictures()?;
    // A canopy needs no camera, and bands no colours.
    if manifest.taken.is_empty() {
        manifest.look_from_above();
    }
    if wavelengths(&manifest)?.is_some() {
        manifest.forget_colours();
    }
    let ledger = Ledger::new();
    let search = LeafSearch { out: args.run.as_deref(), compared: true, free: false };
    let scene = LoadedScene::open(manifest, search, &ledger)?;
    scene.require_sound_fits(&ledger)?;
    let options = Options { samples: args.samples, seed: args.seed, force: args.force };
    let outcome = mesophyll_fit_scene::run(&scene, &args.output, &options, &ledger)?;
    super::told(outcome, &args.output, common, summary)
}
