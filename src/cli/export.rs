//! `mesophyll export DIR --to FORMAT -o PATH`, and of a scene its plants as they stand at a time.

use super::{CommonArgs, destination};
use crate::cli::names::named;
use crate::cli::{Error, Result};
use clap::builder::{PossibleValue, TypedValueParser};
use mesophyll_export::coat::ExportLoss;
use mesophyll_export::scene::{ExportScene, unmeasured};
use mesophyll_export::sky::SkyExportOptions;
use mesophyll_export::{ExportFormat, ExportResult, assemble, export};
use mesophyll_files::{claim, progress};
use mesophyll_fits::record::FitRecord;
use mesophyll_scene::draw::reference;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::{SceneManifest, SceneMaterial};
use mesophyll_scene::path_tracing;
#[cfg(feature = "render")]
use mesophyll_scene::placed::leaf::LeafSearch;
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_scene::placed::{self as placed, PlacedScene};
use std::path::{Path, PathBuf};
use strum::IntoEnumIterator;

/// Writes a fit, or a scene's plants as they stand in its wind, in a format other programs read.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  mesophyll export fits/elm --to gltf -o elm.glb
  mesophyll export fits/elm --to csv -o elm.csv
  mesophyll export data/scenes/cluster.toml --to mitsuba -o cluster-mitsuba
  mesophyll export data/scenes/breeze.toml --time 2.5 --to gltf -o posed.glb
  mesophyll export data/scenes/breeze.toml --from 0 --until 2 --step 0.04 --to gltf -o swaying.glb
  mesophyll export data/scenes/breeze.toml --to pivots -o pivots
  mesophyll export data/scenes/glossy-sky.toml --to web -o glossy-sky.mesophyll
  mesophyll fit sky -o out/sky && mesophyll export out/sky --to wgsl -o sky.wgsl
  mesophyll export out/sky --to hlsl --sun-zenith-deg 40 --sun-azimuth-deg 135 --turbidity 3 -o noon.hlsl
  mesophyll export out/sky --to c --sun-zenith-deg 40 --turbidity 3 --ground 0.2 -o noon.h")]
pub struct Args {
    /// Fit folder, or a scene with plants
    #[arg(value_name = "DIR|SCENE.toml")]
    folder: PathBuf,
    /// Format to write. With a number instead, the option sets the end of an animation (s), as --until does
    #[arg(long, value_parser = FormatOrTime, value_name = "FORMAT", required = true, allow_negative_numbers = true)]
    to: Vec<To>,
    /// File to write, `-` for standard output; with png, packed, sigma, pivots, mitsuba, pbrt, usd, blender,
    /// materialx and bsdf a folder
    #[arg(short, long = "out", alias = "output", value_name = "PATH")]
    output: PathBuf,
    /// Scenes only: time (s) at which the plants are exported (default: the time that [wind] states)
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    time: Option<f64>,
    /// Scenes as a whole only: the view whose camera is exported (default: the first perspective view)
    #[arg(long, value_name = "NAME")]
    view: Option<String>,
    /// Scene: first time (s) of an animation of its plants
    #[arg(long, value_name = "S", allow_negative_numbers = true, conflicts_with = "time")]
    from: Option<f64>,
    /// Scene: end of the animation (s); its last key is the last step at or before it
    #[arg(long, value_name = "S", allow_negative_numbers = true, requires = "from")]
    until: Option<f64>,
    /// Scenes only: step (s) between two keys of the animation
    #[arg(long, value_name = "S", default_value_t = 0.04, allow_negative_numbers = true, requires = "from")]
    step: f64,
    /// Scenes as a whole and web: folder of a run or check of the scene, whose fits are taken, and for web its
    /// reference pictures. Stated looks, and for web translucency maps, that the scene still lacks are made there
    /// (default: out/check/SCENE)
    #[arg(long, value_name = "DIR", value_parser = super::destination::folder())]
    run: Option<PathBuf>,
    /// Sky: only the numbers of this sun (angle from the zenith), no polynomial
    #[arg(long, value_name = "DEG", requires = "turbidity")]
    sun_zenith_deg: Option<f64>,
    /// Sky: the turbidity that goes with --sun-zenith-deg
    #[arg(long, value_name = "T", requires = "sun_zenith_deg")]
    turbidity: Option<f64>,
    /// Sky: azimuth of that sun, from +x to +y (default: 0)
    #[arg(long, value_name = "DEG", requires = "sun_zenith_deg", allow_negative_numbers = true)]
    sun_azimuth_deg: Option<f64>,
    /// Sky: light from level ground of this albedo, 0 to 1, below the horizon (of the sky alone: the sun is not part of
    /// it)
    #[arg(long, value_name = "A", default_value_t = 0.0)]
    ground: f64,
}

/// What `--to` says: the format or, for an animation, its last time.
#[derive(Debug, Clone, Copy)]
enum To {
    Format(ExportFormat),
    Time(f64),
}

/// No format is called by a number.
#[derive(Clone)]
struct FormatOrTime;

impl TypedValueParser for FormatOrTime {
    type Value = To;

    fn parse_ref(
        &self,
        command: &clap::Command,
        argument: Option<&clap::Arg>,
        value: &std::ffi::OsStr,
    ) -> std::result::Result<To, clap::Error> {
        match value.to_str().and_then(|text| text.parse().ok()) {
            Some(time) => Ok(To::Time(time)),
            None => named::<ExportFormat>().parse_ref(command, argument, value).map(To::Format),
        }
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        let all: Vec<PossibleValue> = named::<ExportFormat>().possible_values()?.collect();
        Some(Box::new(all.into_iter()))
    }
}

impl Args {
    /// The format, and the first and last time of an animation.
    fn asked(&self) -> Result<(ExportFormat, Option<[f64; 2]>)> {
        let formats: Vec<ExportFormat> =
            self.to.iter().filter_map(|t| if let To::Format(f) = t { Some(*f) } else { None }).collect();
        let said = self.to.iter().filter_map(|t| if let To::Time(s) = t { Some(*s) } else { None });
        let last: Vec<f64> = said.chain(self.until).collect();
        let &[format] = formats.as_slice() else {
            let found = format!("{} formats", formats.len());
            return Err(Error::argument("--to", found, "one format, such as gltf"));
        };
        match (self.from, last.as_slice()) {
            (None, []) => Ok((format, None)),
            (Some(from), [last]) => Ok((format, Some([from, *last]))),
            (Some(_), all) => {
                let found = format!("{} last times", all.len());
                Err(Error::argument("--until", found, "one, with --from"))
            }
            (None, [last, ..]) => Err(Error::argument("--until", last, "a first time (--from) beside it")),
        }
    }
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let (format, times) = args.asked()?;
    let stdout = destination::is_stdout(&args.output);
    if stdout && (format.is_folder() || format == ExportFormat::Obj) {
        return Err(Error::Usage(format!(
            "-o -: --to {} writes several files; expected a name, not standard output",
            format.name()
        )));
    }
    if stdout && common.json {
        return Err(Error::Usage(
            "-o -: standard output holds the exported file itself; expected no --json beside it".into(),
        ));
    }
    if !format.is_folder() && args.output.is_dir() {
        return Err(Error::Usage(format!(
            "{}: found a folder, expected the name of a file for {}",
            args.output.display(),
            format.name()
        )));
    }
    if !format.is_folder() {
        claim::file(&args.output, format.endings(), &[&args.folder])?;
    }
    let scene = args.folder.is_file();
    if scene && args.folder.file_name().is_some_and(|name| name == "fit.toml") {
        return Err(Error::input(&args.folder, "found the record of a fit, expected the fit's folder, or a scene"));
    }
    if let Some(run) = args.run.as_ref().filter(|_| format != ExportFormat::Web && !(scene && format.holds_scenes())) {
        return Err(Error::argument("--run", run.display(), "a scene that is exported as a whole, or --to web"));
    }
    if scene && !format.takes_scenes() {
        return Err(Error::Usage(format!(
            "--to {}: {} is a scene, whose plants can be exported as gltf or pivots, and which as a whole can be \
             exported as {}; expected a fit folder for other formats",
            format.name(),
            args.folder.display(),
            ExportFormat::iter().filter(|f| f.is_whole_scene()).map(ExportFormat::name).collect::<Vec<_>>().join(", ")
        )));
    }
    if let Some(view) = args.view.as_ref().filter(|_| !(scene && format.holds_scenes())) {
        return Err(Error::argument("--view", view, "a scene that is exported as a whole"));
    }
    if times.is_some() && format.holds_scenes() {
        return Err(Error::Usage(format!("--to {}: holds one time; expected --time, or --to gltf", format.name())));
    }
    if scene && (args.sun_zenith_deg.is_some() || args.ground != 0.0) {
        let what = "is a scene; --sun-zenith-deg, --sun-azimuth-deg, --turbidity and --ground are for sky fits";
        return Err(Error::Usage(format!("{} {what}", args.folder.display())));
    }
    if let Some(time) = args.time.filter(|t| !scene || !t.is_finite()) {
        return Err(Error::argument("--time", time, "a finite time, with a scene instead of a fit folder"));
    }
    if times.is_some() && !scene {
        let what = "is not a scene; --from, --until and --step write an animation of a scene's plants";
        return Err(Error::Usage(format!("{} {what}", args.folder.display())));
    }
    if format == ExportFormat::Pivots && (times.is_some() || args.time.is_some()) {
        let what = "pivot textures hold plants at rest; expected no time";
        return Err(Error::Usage(format!("--to pivots: {what}")));
    }
    let fixed = args.sun_zenith_deg.zip(args.turbidity).map(|(sun, turbidity)| (sun.to_radians(), turbidity));
    let azimuth = args.sun_azimuth_deg.unwrap_or(0.0).to_radians();
    let options = SkyExportOptions { fixed, azimuth, ground: args.ground };
    let done: ExportResult = destination::file(&args.output, |path| match times {
        _ if format == ExportFormat::Web => web(args, path),
        Some([from, last]) => moving(&args.folder, from, last, args.step, path),
        None if scene && format == ExportFormat::Pivots => pivots(&args.folder, path),
        None if scene && format.holds_scenes() => whole(args, format, path),
        None if scene => posed(&args.folder, args.time, path),
        None => export(&args.folder, format, path, &options),
    })?;
    if !scene {
        super::preparation::warn(&args.folder);
        let stated = FitRecord::read(&args.folder).ok().filter(|_| done.lost.is_none());
        stated.and_then(|record| record.stated_in_one()).into_iter().for_each(progress::say);
    }
    if stdout {
        done.lost.iter().flat_map(ExportLoss::lines).for_each(progress::say);
        return Ok(0);
    }
    if common.json {
        let list: Vec<String> = done.files.iter().map(|p| p.display().to_string()).collect();
        let mut out = serde_json::json!({"written": list});
        if let Some(lost) = &done.lost {
            out["loss"] = lost.json().clone();
        }
        super::print_json(&out)?;
    } else {
        done.files.iter().for_each(|p| progress::say(format_args!("written: {}", p.display())));
        done.lost.iter().flat_map(ExportLoss::lines).for_each(progress::say);
    }
    Ok(0)
}

/// The run's folder of a scene.
fn run_of(args: &Args, manifest: &SceneManifest) -> PathBuf {
    args.run.clone().unwrap_or_else(|| PathBuf::from("out/check").join(&manifest.name))
}

/// A whole scene at one time, as another renderer draws it.
fn whole(args: &Args, format: ExportFormat, path: &Path) -> Result<ExportResult> {
    let manifest = SceneManifest::read(&args.folder)?;
    let ledger = Ledger::new();
    let run = run_of(args, &manifest);
    let search = LeafSearch { out: args.run.as_deref(), compared: false, free: false };
    let mut placed = PlacedScene::new(&manifest, search, &ledger)?;
    placed.make_looks(&manifest, &run, search, &ledger)?;
    let scene = LoadedScene::new(manifest, placed, &ledger)?;
    scene.require_sound_fits(&ledger)?;
    if let Some(missing) = scene.placed.unfitted().first() {
        let leaf = format!("leaf \"{}\"", scene.manifest.leaves[*missing].name);
        let why = format!(
            "not fitted; `mesophyll run {}` makes the fit, then give its folder by --run",
            args.folder.display()
        );
        return Err(Error::field(&args.folder, &leaf, why));
    }
    let view = path_tracing::views(&scene, args.view.as_deref())?[0];
    let time = args.time.unwrap_or_else(|| scene.manifest.time_of(view));
    let mut world = reference::still(&scene, time, &ledger)?;
    reference::part_sun(&mut world, &scene.manifest)?;
    // The world has leaves, the blades of lawns, wood, and the rest. Only the world knows how many blades there are, so
    // that beside a lawn nothing is called bark.
    let wood = scene.placed.wood.iter().filter(|_| scene.placed.grass.is_empty()).map(|_| "bark".to_string());
    let names: Vec<String> = scene.drawn().map(|leaf| leaf.config.name.clone()).chain(wood).collect();
    let check = &scene.manifest.check;
    let size = [check.width as usize, check.height as usize];
    let mut shown = ExportScene::of_world(&world, &names, view.camera, size, &scene.manifest.name);
    shown.left_out.extend(scene.placed.stated().iter().map(|said| unmeasured(said)));
    if scene.placed.moves().any() {
        shown.left_out.push(format!("wind: everything stands as at {time} s"));
    }
    if scene.manifest.leaves.iter().any(|l| l.translucency.is_some()) {
        shown.left_out.push("translucency maps: the sun passes by the transmittance and the cosine alone".into());
    }
    assemble(&shown, format, path, true, &[&args.folder])
}

/// A scene, or a leaf in a scene around it, for the viewer in a browser.
#[cfg(feature = "render")]
fn web(args: &Args, path: &Path) -> Result<ExportResult> {
    use mesophyll_files::atomic;
    use mesophyll_scene::web;

    if args.time.is_some() || args.from.is_some() {
        return Err(Error::Usage("--to web: the plants stand as in the first view; expected no time".into()));
    }
    let manifest = SceneManifest::of(&args.folder)?;
    let ledger = Ledger::new();
    let run = run_of(args, &manifest);
    let out = args.run.as_deref();
    let search = LeafSearch { out, compared: true, free: true };
    let mut placed = PlacedScene::new(&manifest, search, &ledger)?;
    placed.make_looks(&manifest, &run, search, &ledger)?;
    if let Some(missing) = placed.unfitted().first() {
        let leaf = format!("leaf \"{}\"", manifest.leaves[*missing].name);
        let why = "not fitted yet; `mesophyll run` fits it, then give its folder by --run";
        return Err(Error::field(&manifest.path, &leaf, why));
    }
    placed.make_translucency(&manifest, &run, search, &ledger)?;
    placed.out = Some(run.clone());
    let mut scene = LoadedScene::new(manifest, placed, &ledger)?;
    scene.require_sound_fits(&ledger)?;
    scene.find_transfer(&run, &ledger)?;
    let bundle = web::bundle(&scene, &run, &ledger)?;
    let bytes = bundle.write().map_err(|e| Error::Usage(format!("{}: {e}", args.folder.display())))?;
    atomic::write_bytes(path, &bytes)?;
    let with = bundle.views.iter().filter(|v| v.reference.is_some()).count();
    progress::say(format_args!(
        "{} of {} views have a reference picture from {}; drop the file onto the page that `make web` builds",
        with,
        bundle.views.len(),
        run.display()
    ));
    Ok(vec![path.to_path_buf()].into())
}

#[cfg(not(feature = "render"))]
fn web(_: &Args, _: &Path) -> Result<ExportResult> {
    Err(Error::Missed("nothing to export: this build has no renderer (feature `render`)".into()))
}

/// A scene whose plants are written, and a sentence about what is not.
fn with_plants(scene: &Path) -> Result<SceneManifest> {
    let manifest = SceneManifest::read(scene)?;
    if !manifest.grass.is_empty() {
        let lawns: Vec<&str> = manifest.grass.iter().map(|g| g.name.as_str()).collect();
        progress::say(format_args!(
            "lawns are left out ({}); `mesophyll grow` writes the blades of a meadow",
            lawns.join(", ")
        ));
    }
    Ok(manifest)
}

/// What of a scene its plants alone do not hold, and how leaves are kept.
fn lacking(manifest: &SceneManifest, cure: &str) -> Vec<String> {
    let mut said: Vec<String> = Vec::new();
    let mut fitted = false;
    for plant in &manifest.plants {
        let file = plant.file.as_ref().or(plant.grow.as_ref());
        let stem = file.and_then(|file| file.file_stem());
        let own = || stem.map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        let name = plant.name.clone().unwrap_or_else(own);
        for (material, drawn) in &plant.materials {
            let drawn = match drawn {
                SceneMaterial::Leaf(leaf) => {
                    fitted = true;
                    format!("the leaf \"{leaf}\"")
                }
                SceneMaterial::Bark(rho) => format!("the reflectance {rho:?}"),
            };
            let what = format!("{drawn} of the scene: material \"{material}\" of {name} has the plant's own colour");
            if !said.contains(&what) {
                said.push(what);
            }
        }
    }
    said.extend(fitted.then(|| cure.to_string()));
    said.push("everything but plants: single leaves, ground, sun, sky and cameras".into());
    said
}

/// How a file keeps fitted leaves.
const DRESS: &str = "`mesophyll dress FILE --leaf MATERIAL=FIT --make-uv` puts a fitted leaf on, and --to \
                     gltf-translucent writes the scene with its leaves as it stands at one time";

/// A scene's plants as they stand at a time.
fn posed(scene: &Path, time: Option<f64>, path: &Path) -> Result<ExportResult> {
    let manifest = with_plants(scene)?;
    let time = time.unwrap_or_else(|| manifest.rest_time());
    mesophyll_export::plants(ExportFormat::Gltf, path, &lacking(&manifest, DRESS), || {
        mesophyll_plants::file::write(&placed::poses::plants(&manifest, time, &Ledger::new())?, path)?;
        Ok(vec![path.to_path_buf()])
    })
}

/// A scene's plants as an animation.
fn moving(scene: &Path, from: f64, last: f64, step: f64, path: &Path) -> Result<ExportResult> {
    let manifest = with_plants(scene)?;
    mesophyll_export::plants(ExportFormat::Gltf, path, &lacking(&manifest, DRESS), || {
        placed::poses::animation(&manifest, from, last, step, &Ledger::new(), path)?;
        Ok(vec![path.to_path_buf()])
    })
}

/// A scene's plants at rest, with textures of their pivots.
fn pivots(scene: &Path, folder: &Path) -> Result<ExportResult> {
    let manifest = with_plants(scene)?;
    let _claim = claim::folder(folder, claim::OutputKind::Pivots, &[scene])?;
    let plant = placed::poses::resting(&manifest, &Ledger::new())?;
    claim::begin(folder, claim::OutputKind::Pivots)?;
    let cure = "the maps of `mesophyll export FIT --to packed` are for the material of the leaves there";
    let written = mesophyll_export::plants(ExportFormat::Pivots, folder, &lacking(&manifest, cure), || {
        mesophyll_plants::file::write_pivots(&plant, folder)
    })?;
    claim::finish(folder)?;
    Ok(written)
}
