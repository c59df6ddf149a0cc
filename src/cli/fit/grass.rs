//! `mesophyll fit grass MEADOW -o DIR`.

use crate::cli::{CommonArgs, Error, Result, destination};
use mesophyll_fits::grass::judge::ELEVATIONS;
use mesophyll_fits::grass::{Options, run as fit};
use mesophyll_fits::record::FitRecord;
use std::path::PathBuf;

/// Fits upright slices to a meadow, so that a shader of the ground can trace them in real time.
///
/// A slice holds the opacity, reflectance, transmittance and normals of a slab of blades. The fit also says how far the
/// slices differ from the blades.
///
/// DIR gets slices.exr, level.exr, previews, fit.toml and times.toml. docs/grass.md explains them.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  mesophyll fit grass data/grass/lawn.toml -o out/lawn
  mesophyll fit grass data/grass/short.toml --slices 32 --texels 128x32 -o out/short")]
pub struct Args {
    /// The meadow: a description (.toml), or what `mesophyll grow` makes of it (.glb)
    #[arg(value_name = "MEADOW")]
    meadow: PathBuf,
    /// Folder to write
    #[arg(short, long = "out", alias = "output", value_name = "DIR", value_parser = destination::folder())]
    output: PathBuf,
    /// Slices across x, and as many across y
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u16).range(1..=128))]
    slices: u16,
    /// Texels along a slice and along its height: powers of two from 4 to 1024
    #[arg(long, value_name = "WxH", default_value = "256x64", value_parser = texels)]
    texels: [usize; 2],
    /// Leave out the level slice at half the height, which only views from above need
    #[arg(long)]
    upright_only: bool,
    /// Rays along each side of a texel
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=64))]
    rays: u16,
    /// Points of entry along each side of the square: for the rays that weights are fitted to and errors judged by
    #[arg(long, value_name = "N", default_value_t = 48, value_parser = clap::value_parser!(u16).range(4..=1024))]
    entries: u16,
    /// What the leaves of each material reflect and let through (default: the table data/grass/optics/leaves.toml)
    #[arg(long, value_name = "FILE.toml")]
    leaves: Option<PathBuf>,
    /// Fit again although the folder already holds this very fit
    #[arg(long)]
    force: bool,
}

fn texels(text: &str) -> std::result::Result<[usize; 2], String> {
    let side = |t: &str| t.parse().ok().filter(|n: &usize| n.is_power_of_two() && (4..=1024).contains(n));
    text.split_once('x')
        .and_then(|(w, h)| Some([side(w)?, side(h)?]))
        .ok_or_else(|| "expected two powers of two from 4 to 1024, such as 256x64".into())
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let known = |e: &std::ffi::OsStr| ["toml", "glb"].iter().any(|k| e.eq_ignore_ascii_case(k));
    if !args.meadow.extension().is_some_and(known) {
        let found = args.meadow.display();
        return Err(Error::Usage(format!("found {found}, expected a meadow that ends in .toml or .glb")));
    }
    let options = Options {
        slices: args.slices.into(),
        texels: args.texels,
        level: !args.upright_only,
        rays: args.rays.into(),
        entries: args.entries.into(),
        leaves: args.leaves.clone(),
        force: args.force,
        view: true,
    };
    super::told(fit(&args.meadow, &args.output, &options)?, &args.output, common, summary)
}

/// A summary of the record for people.
fn summary(record: &FitRecord) -> String {
    let say = |name: &str| record.options.get(name).map_or("", String::as_str);
    let figure = |section: &str, name: &str| {
        record.sections.get(section).and_then(|s| s.figures.get(name)).copied().unwrap_or(f64::NAN)
    };
    let mut text = format!("{}: slices {}\n", record.name, say("slices"));
    text += &format!(
        "{:.2} MB on the adapter; errors: coverage {:.3} (root mean square) and {:.3} (worst direction), \
         colour {:.1} %, sunlit share {:.1} %\n",
        figure("all", "bytes_on_gpu") / 1e6,
        figure("all", "coverage_rms_error"),
        figure("all", "coverage_worst_error"),
        100.0 * figure("all", "colour_rms_relative_error"),
        100.0 * figure("all", "sunlit_rms_relative_error"),
    );
    for elevation in ELEVATIONS {
        let name = format!("elevation {elevation:02}");
        text += &format!(
            "{elevation:>3}° over the ground: coverage {:.3}, slices {:.3}; colour off by {:.1} %, sunlit by {:.1} %\n",
            figure(&name, "coverage_of_blades"),
            figure(&name, "coverage_of_slices"),
            100.0 * figure(&name, "colour_rms_relative_error"),
            100.0 * figure(&name, "sunlit_rms_relative_error"),
        );
    }
    text
}
