//! `mesophyll export DIR --to FORMAT -o PATH`.

use super::Common;
use crate::export::{Format, export};
use crate::files::progress;
use crate::{Error, Result};
use std::path::PathBuf;

/// Writes a fit in a format other programs read.
#[derive(Debug, clap::Args)]
#[command(after_help = "Formats:
  png               a folder of 8-bit maps: rho_d, rho_t and rho_s as sRGB, the rest linear with ranges.json
  exr               one float OpenEXR with every map and its standard error
  csv               a row a texel: place, mask, every map and its standard error
  json              parameters with errors, statistics, run times
  gltf              the blade as .glb in metres, rho_d as base colour (opaque; right in any reader)
  gltf-translucent  the same with rho_t, for readers of KHR_materials_diffuse_transmission
  obj               the blade as .obj in mm with normals, .mtl and pictures beside it

Examples:
  mesophyll export fits/elm --to gltf -o elm.glb
  mesophyll export fits/elm --to csv -o elm.csv")]
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
}

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    let format = Format::parse(&args.to)?;
    if format != Format::Png && args.output.is_dir() {
        return Err(Error::Usage(format!("{}: found a folder, expected the name of a file for {}", args.output.display(), format.name())));
    }
    let written = export(&args.folder, format, &args.output)?;
    if common.json {
        let list: Vec<String> = written.iter().map(|p| p.display().to_string()).collect();
        super::print_json(&serde_json::json!({"written": list}))?;
    } else {
        written.iter().for_each(|p| progress::say(format_args!("written: {}", p.display())));
    }
    Ok(0)
}
