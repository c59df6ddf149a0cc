//! `mesophyll export DIR --to FORMAT -o PATH`.

use super::Common;
use crate::export::sky::SkyOptions;
use crate::export::{Format, export};
use crate::files::{claim, progress};
use crate::{Error, Result};
use std::path::PathBuf;

/// Writes a fit in a format other programs read.
#[derive(Debug, clap::Args)]
#[command(after_help = "Formats:
  png               a folder of 8-bit maps: rho_d, rho_t and rho_s as sRGB, the rest linear with ranges.json
  exr               one float OpenEXR with every map and its standard error
  csv               a row a texel: place, mask, every map and its standard error
  json              parameters with errors, statistics, run times; of a sky also the arrays and how to evaluate them
  gltf              the blade as .glb in metres, rho_d as base colour (opaque; right in any reader)
  gltf-translucent  the same with rho_t, for readers of KHR_materials_diffuse_transmission
  obj               the blade as .obj in mm with normals, .mtl and pictures beside it
  wgsl              a sky's fitted harmonics with an evaluator for shaders, f32
  c                 a sky's fitted harmonics with an evaluator as a C header, float or double

Examples:
  mesophyll export fits/elm --to gltf -o elm.glb
  mesophyll export fits/elm --to csv -o elm.csv
  mesophyll fit sky -o out/sky && mesophyll export out/sky --to wgsl -o sky.wgsl
  mesophyll export out/sky --to c --sun-zenith-deg 40 --turbidity 3 --ground 0.2 -o noon.h")]
pub struct Args {
    /// Fit folder
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Format
    #[arg(long, value_name = "FORMAT")]
    to: String,
    /// File to write (png: a folder)
    #[arg(short, long, value_name = "PATH")]
    output: PathBuf,
    /// Sky: only the numbers of this sun (angle from the zenith), no polynomial
    #[arg(long, value_name = "DEG", requires = "turbidity")]
    sun_zenith_deg: Option<f64>,
    /// Sky: the turbidity that goes with --sun-zenith-deg
    #[arg(long, value_name = "T", requires = "sun_zenith_deg")]
    turbidity: Option<f64>,
    /// Sky: light from level ground of this albedo, 0 to 1, below the horizon (of the sky alone: the sun is not part of it)
    #[arg(long, value_name = "A", default_value_t = 0.0)]
    ground: f64,
}

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    let format = Format::parse(&args.to)?;
    if format != Format::Png && args.output.is_dir() {
        return Err(Error::Usage(format!("{}: found a folder, expected the name of a file for {}", args.output.display(), format.name())));
    }
    if format != Format::Png {
        claim::file(&args.output, format.endings(), &[&args.folder])?;
    }
    let fixed = args.sun_zenith_deg.zip(args.turbidity).map(|(sun, turbidity)| (sun.to_radians(), turbidity));
    let written = export(&args.folder, format, &args.output, &SkyOptions { fixed, ground: args.ground })?;
    if common.json {
        let list: Vec<String> = written.iter().map(|p| p.display().to_string()).collect();
        super::print_json(&serde_json::json!({"written": list}))?;
    } else {
        written.iter().for_each(|p| progress::say(format_args!("written: {}", p.display())));
    }
    Ok(0)
}
