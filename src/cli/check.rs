//! `mesophyll check`.

use super::CommonArgs;
#[cfg(feature = "render")]
use crate::cli::Error;
use crate::cli::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  mesophyll check data/scenes/front-lit.toml\n  mesophyll check \
     data/scenes/glossy-sky.toml --json --out out/check\n  \
     mesophyll check data/scenes/twig.toml --goldens-only\n  \
     mesophyll check data/scenes/breeze.toml --frames 100 --size 1920x1080    how many frames a second\n  \
     mesophyll check data/scenes/twig.toml --goldens-only --update-golden    after a deliberate change of a fit or of \
     the renderer\n\n\
    Exit code 1 when a threshold is missed, when a fit's files are not what was fitted, and when there is no adapter \
    to draw with.")]
pub struct Args {
    /// Scene to check
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// Folder for pictures and check.json (default: out/check/SCENE); an earlier run's folder counts its fits as done
    #[arg(short, long, alias = "output", value_name = "DIR", value_parser = super::destination::folder())]
    out: Option<PathBuf>,
    /// Write the scene's golden pictures anew instead of comparing with them
    #[arg(long)]
    update_golden: bool,
    /// Only draw every view small and compare it with its golden picture: no reference, seconds instead of minutes.
    /// Fits that are missing are made first, from small scans; everything goes to DIR/goldens
    #[arg(long)]
    goldens_only: bool,
    /// Only draw every perspective view N times, as a program does that shows frames, and time them: no reference, no
    /// goldens. Where something moves, every frame shows a time 1/30 s later and draws its shadow maps anew
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000),
        conflicts_with_all = ["goldens_only", "update_golden", "compare_interiors", "compare_methods"])]
    frames: Option<u32>,
    /// Size of the frames (default: that of the scene's [check])
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = super::film::size, requires = "frames")]
    size: Option<[u32; 2]>,
    /// Compare W's scalars with pigment maps for every leaf: bytes, fit error, picture error
    #[arg(long)]
    compare_interiors: bool,
    /// Draw every view of a scene with light between leaves by several methods, and compare their errors, times and
    /// sizes. DIR/methods.csv gets one row for each method and view
    #[arg(long, conflicts_with = "goldens_only")]
    compare_methods: bool,
}

#[cfg(feature = "render")]
pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    use mesophyll_check::{Options, golden};
    use mesophyll_files::{atomic, claim};
    use mesophyll_scene::loaded::LoadedScene;
    use mesophyll_scene::manifest::SceneManifest;
    use mesophyll_scene::placed::ledger::Ledger;
    use mesophyll_scene::placed::{PlacedScene, leaf::LeafSearch};

    let begun = std::time::Instant::now();
    let mut manifest = SceneManifest::read(&args.scene)?;
    let seen = manifest.perspectives().next().is_some();
    match args.frames {
        None => manifest.require_limits()?,
        Some(_) if seen => {}
        Some(_) => {
            let why = "none of kind \"perspective\", expected one whose frames can be timed";
            return Err(Error::field(&manifest.path, "view", why));
        }
    }
    if let Some([width, height]) = args.size {
        (manifest.check.width, manifest.check.height) = (width, height);
    }
    let out = args.out.clone().unwrap_or_else(|| PathBuf::from("out/check").join(&manifest.name));
    // Fits that are made for goldens alone are small, so they must not take the place of a run's own fits.
    let out = if args.goldens_only { out.join("goldens") } else { out };
    let _claim = claim::scene(&out, &args.scene)?;
    let ledger = Ledger::new();
    if args.goldens_only {
        golden::small_scans(&mut manifest);
    }
    let own = if args.goldens_only { Some(out.as_path()) } else { args.out.as_deref() };
    let search = LeafSearch { out: own, compared: true, free: false };
    let mut placed = PlacedScene::new(&manifest, search, &ledger)?;
    if args.goldens_only {
        placed.make_fits(&manifest, &out, search, &ledger, |_| true)?;
    }
    placed.make_looks(&manifest, &out, search, &ledger)?;
    // This takes seconds, not minutes: unlike the fit of a leaf, translucency maps are made on the way.
    if placed.unfitted().is_empty() {
        placed.make_translucency(&manifest, &out, search, &ledger)?;
    }
    placed.out = Some(out.clone());
    let mut scene = LoadedScene::new(manifest, placed, &ledger)?;
    scene.find_transfer(&out, &ledger)?;
    let options = Options {
        out: out.clone(),
        update_golden: args.update_golden,
        goldens_only: args.goldens_only,
        frames: args.frames.map(|n| n as usize),
        begun: Some(begun),
    };
    let (passed, mut text, mut json) =
        judged(&scene, &options, args.compare_interiors.then_some(args.out.as_deref()), &ledger)?;
    if args.compare_methods {
        let (rows, kept) = mesophyll_check::methods::weigh(&mut scene, &options, &ledger)?;
        text += &mesophyll_check::methods::text(&rows, &kept);
        json["methods"] = serde_json::to_value(&rows).unwrap_or_default();
        json["sun_visibility_at_rest"] = serde_json::to_value(&kept).unwrap_or_default();
    }
    atomic::write_bytes(
        &out.join("plan.json"),
        serde_json::to_string_pretty(&scene.plan).unwrap_or_default().as_bytes(),
    )?;
    if common.json {
        super::print_json(&json)?;
    } else {
        // With --frames nothing is drawn to be looked at, and pictures of an earlier check may lie there.
        let what =
            if args.frames.is_none() { "pictures and figures" } else { "figures (check.json, plan.json), no pictures" };
        super::print(&format!("{text}{what}: {}\n", out.display()))?;
    }
    Ok(u8::from(!passed))
}

/// Checks a planned scene; with `compare` (the folder of an earlier run, if any) the interiors of its leaves are
/// weighed against each other too. Whether it passed, as text, and as JSON.
#[cfg(feature = "render")]
pub(super) fn judged(
    scene: &mesophyll_scene::loaded::LoadedScene,
    options: &mesophyll_check::Options,
    compare: Option<Option<&std::path::Path>>,
    ledger: &mesophyll_scene::placed::ledger::Ledger,
) -> Result<(bool, String, serde_json::Value)> {
    use mesophyll_check::{check, interiors};

    let report = check(scene, options, ledger)?;
    let (mut json, mut text) = (serde_json::to_value(&report).unwrap_or_default(), report.text());
    let stated = scene.placed.stated();
    stated.iter().for_each(|said| text += &format!("{said}\n"));
    json["stated"] = stated.into();
    if let Some(out) = compare {
        let rows = interiors::compare(&scene.manifest, out, ledger)?;
        text += &interiors::text(&rows);
        json["interiors"] = serde_json::to_value(&rows).unwrap_or_default();
    }
    Ok((report.passed != Some(false), text, json))
}

#[cfg(not(feature = "render"))]
pub fn run(_args: &Args, _common: &CommonArgs) -> Result<u8> {
    Err(crate::cli::Error::Missed("nothing was checked: this build has no renderer (feature `render`)".into()))
}
