//! `mesophyll export DIR --to FORMAT -o PATH`, and of a scene its plants as they stand at a time.

use super::{Common, place};
use crate::named::named;
use crate::{Error, Result};
use mesophyll_export::sky::SkyOptions;
use mesophyll_export::{Format, export};
use mesophyll_files::{claim, progress};
use mesophyll_manifest::Manifest;
use mesophyll_scene::ledger::Ledger;
use mesophyll_scene::placed::{self, branch};
use std::path::{Path, PathBuf};

/// Writes a fit, or a scene's plants as they stand in its wind, in a format other programs read.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  mesophyll export fits/elm --to gltf -o elm.glb
  mesophyll export fits/elm --to csv -o elm.csv
  mesophyll export data/scenes/breeze.toml --time 2.5 --to gltf -o posed.glb
  mesophyll fit sky -o out/sky && mesophyll export out/sky --to wgsl -o sky.wgsl
  mesophyll export out/sky --to c --sun-zenith-deg 40 --turbidity 3 --ground 0.2 -o noon.h")]
pub struct Args {
    /// Fit folder, or a scene with plants
    #[arg(value_name = "DIR|SCENE.toml")]
    folder: PathBuf,
    /// Format
    #[arg(long, value_parser = named::<Format>(), value_name = "FORMAT")]
    to: Format,
    /// File to write, `-` for standard output; with png and packed a folder
    #[arg(short, long = "out", alias = "output", value_name = "PATH")]
    output: PathBuf,
    /// Scene: when its plants are seen (s); the wind's own time when absent
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    time: Option<f64>,
    /// Sky: only the numbers of this sun (angle from the zenith), no polynomial
    #[arg(long, value_name = "DEG", requires = "turbidity")]
    sun_zenith_deg: Option<f64>,
    /// Sky: the turbidity that goes with --sun-zenith-deg
    #[arg(long, value_name = "T", requires = "sun_zenith_deg")]
    turbidity: Option<f64>,
    /// Sky: light from level ground of this albedo, 0 to 1, below the horizon (of the sky alone: the sun is not part of
    /// it)
    #[arg(long, value_name = "A", default_value_t = 0.0)]
    ground: f64,
}

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    let format = args.to;
    let stdout = place::is_stdout(&args.output);
    if stdout && (format.is_folder() || format == Format::Obj) {
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
    if scene && format != Format::Gltf {
        return Err(Error::Usage(format!(
            "--to {}: {} is a scene, whose plants can be exported as gltf; expected a fit folder for other formats",
            format.name(),
            args.folder.display()
        )));
    }
    if scene && (args.sun_zenith_deg.is_some() || args.ground != 0.0) {
        let what = "is a scene; --sun-zenith-deg, --turbidity and --ground are for sky fits";
        return Err(Error::Usage(format!("{} {what}", args.folder.display())));
    }
    if let Some(time) = args.time.filter(|t| !scene || !t.is_finite()) {
        return Err(Error::argument("--time", time, "a finite time, with a scene instead of a fit folder"));
    }
    let fixed = args.sun_zenith_deg.zip(args.turbidity).map(|(sun, turbidity)| (sun.to_radians(), turbidity));
    let options = SkyOptions { fixed, ground: args.ground };
    let written = place::file(&args.output, |path| {
        if scene { posed(&args.folder, args.time, path) } else { export(&args.folder, format, path, &options) }
    })?;
    if stdout {
        return Ok(0);
    }
    if common.json {
        let list: Vec<String> = written.iter().map(|p| p.display().to_string()).collect();
        super::print_json(&serde_json::json!({"written": list}))?;
    } else {
        written.iter().for_each(|p| progress::say(format_args!("written: {}", p.display())));
    }
    Ok(0)
}

/// A scene's plants as they stand at a time.
fn posed(scene: &Path, time: Option<f64>, path: &Path) -> Result<Vec<PathBuf>> {
    let manifest = Manifest::read(scene)?;
    let time = time.unwrap_or_else(|| branch::rest_time(&manifest));
    mesophyll_flora::file::write(&placed::posed::plants(&manifest, time, &Ledger::new())?, path)?;
    Ok(vec![path.to_path_buf()])
}
