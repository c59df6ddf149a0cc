//! `mesophyll render`.

use super::CommonArgs;
use crate::cli::names::named;
use crate::cli::{Error, Result};
use mesophyll_files::claim;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::path_tracing::{self, Options, PathTracedView};
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_transport::tone::ToneCurve;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  mesophyll render data/scenes/twig.toml -o out/twig --samples 64\n  \
     mesophyll render fits/elm -o out/elm --samples 64\n  \
     mesophyll render data/scenes/cluster.toml -o out/cluster --error 0.01\n  \
     mesophyll render data/scenes/cluster.toml -o out/cluster --samples 1024 --resume\n  \
     mesophyll render data/scenes/breeze.toml -o out/breeze --real-time\n  \
     mesophyll render data/scenes/twig.toml -o out/twig-real-time --real-time --run out/twig --against out/twig\n\n\
    Each view becomes VIEW.exr (channels R, G, B: radiance; error.R, error.G, error.B: its standard error), VIEW.png \
    (tone-mapped) and VIEW.progress.exr, from which --resume goes on. With --real-time it becomes VIEW.exr \
    (channels R, G, B, A) and VIEW.png alone. \
    Fits that are missing are made first and kept in DIR/fits, or in that of --run.")]
pub struct Args {
    /// Scene to draw, with light between leaves; or the folder of a leaf's fit, which is drawn from both sides
    #[arg(value_name = "SCENE.toml|FIT")]
    scene: PathBuf,
    /// Folder for the pictures
    #[arg(short, long, alias = "output", value_name = "DIR", value_parser = super::destination::folder())]
    out: PathBuf,
    /// Folder of an earlier run, check or render of the scene, whose scans, fits and transfer are used. Those that the
    /// scene still lacks are made there (default: the folder of -o)
    #[arg(long, value_name = "DIR", value_parser = super::destination::folder())]
    run: Option<PathBuf>,
    /// Only this view (default: all perspective views)
    #[arg(long, value_name = "NAME")]
    view: Option<String>,
    /// Pixels (default: the scene's check.width and check.height)
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = super::film::size)]
    size: Option<[u32; 2]>,
    /// Camera paths a pixel (default: the scene's check.samples; with --error: as many as it takes)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    samples: Option<u32>,
    /// Most scatterings of a path: 1 is direct light alone (default: all, paths end by chance)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    bounces: Option<u32>,
    /// Seed of the random numbers
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Stop at this median relative error of the pixels, such as 0.01
    #[arg(long, value_name = "E", value_parser = positive)]
    error: Option<f64>,
    /// How radiance becomes VIEW.png (default: film where the scene has a [camera], else reinhard)
    #[arg(long, value_parser = named::<ToneCurve>())]
    tone: Option<ToneCurve>,
    /// Go on with the pictures that an earlier run left in DIR
    #[arg(long)]
    resume: bool,
    /// Draw by the real-time renderer instead, as `view` and `film` do: no paths, no standard errors
    #[arg(long, conflicts_with_all = ["samples", "bounces", "seed", "error", "resume"])]
    real_time: bool,
    /// With --real-time: compare each view with the PNG of the same name in this folder, by FLIP
    #[arg(long, value_name = "DIR", requires = "real_time")]
    against: Option<PathBuf>,
}

pub fn positive(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("expected a number above 0, such as 0.01".into()),
    }
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let mut manifest = SceneManifest::of(&args.scene)?;
    if let Some([width, height]) = args.size {
        (manifest.check.width, manifest.check.height) = (width, height);
    }
    // Pictures there would be replaced, and compared with themselves.
    if let Some(against) =
        args.against.as_ref().filter(|against| claim::resolved(against) == claim::resolved(&args.out))
    {
        let expected = "another folder than that of -o, whose pictures are replaced";
        return Err(Error::argument("--against", against.display(), expected));
    }
    let _claim = claim::folder(&args.out, claim::OutputKind::Render, &[&args.scene])?;
    let ledger = Ledger::new();
    let scene = match &args.run {
        Some(run) => super::preparation::scene_of_run(manifest, run, &ledger)?,
        None => super::preparation::scene(manifest, &args.out, &ledger)?,
    };
    let options = Options {
        out: args.out.clone(),
        view: args.view.clone(),
        samples: args.samples,
        bounces: args.bounces,
        error: args.error,
        seed: args.seed,
        resume: args.resume,
        tone: args.tone,
    };
    if args.real_time {
        return real_time(scene, &options, args, common, &ledger);
    }
    let mut all = Vec::new();
    let ended = path_tracing::render(&scene, &options, &ledger, |drawn| {
        all.push(drawn.clone());
        if common.json { Ok(()) } else { super::print(&line(drawn, args)) }
    });
    if common.json {
        super::print_json(&all)?;
    }
    ended.map(|()| 0)
}

/// The views by the real-time renderer.
#[cfg(feature = "render")]
fn real_time(
    mut scene: LoadedScene,
    options: &Options,
    args: &Args,
    common: &CommonArgs,
    ledger: &Ledger,
) -> Result<u8> {
    scene.find_transfer(args.run.as_ref().unwrap_or(&args.out), ledger)?;
    let mut all = Vec::new();
    mesophyll_scene::real_time::render(&scene, options, args.against.as_deref(), ledger, |drawn| {
        let file = options.out.join(format!("{}.png", drawn.view));
        let flip = drawn.flip.map_or(String::new(), |[mean, p99]| format!(", FLIP {mean:.4}, 99 % below {p99:.3}"));
        let line = format!("{}: drawn by {}{flip}; {}\n", drawn.view, drawn.adapter, file.display());
        all.push(drawn.clone());
        if common.json { Ok(()) } else { super::print(&line) }
    })?;
    if common.json {
        super::print_json(&all)?;
    }
    Ok(0)
}

#[cfg(not(feature = "render"))]
fn real_time(_: LoadedScene, _: &Options, _: &Args, _: &CommonArgs, _: &Ledger) -> Result<u8> {
    Err(Error::Missed("--real-time: this build has no renderer (feature `render`)".into()))
}

/// One view in a line.
fn line(drawn: &PathTracedView, args: &Args) -> String {
    let paths = match drawn.samples {
        [least, most] if least == most => format!("{least}"),
        [least, most] => format!("{least} to {most}"),
    };
    let error = match drawn.median_relative_error {
        Some(error) => format!("median error {:.2} %", 100.0 * error),
        None => "error undetermined (one path a pixel, or nothing to see)".into(),
    };
    let pace = drawn.paths_per_second.map_or(String::new(), |p| format!(", {:.2} M paths/s", p / 1e6));
    let file = args.out.join(format!("{}.png", drawn.view));
    format!("{}: {paths} paths a pixel, {error}, {:.1} s{pace}; {}\n", drawn.view, drawn.seconds, file.display())
}
