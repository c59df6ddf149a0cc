//! `mesophyll eval panorama`: a picture of a sky whose sun and turbidity are known, for tests of `fit sky --panorama`.

use crate::cli::names::named;
use crate::cli::{CommonArgs, destination, tables};
use crate::cli::{Error, Result};
use mesophyll_files::image::{Packing, write_exr};
use mesophyll_files::{claim, progress};
use mesophyll_fits::sky::panorama::projection::{PanoramaProjection, PanoramaProjectionKind};
use mesophyll_fits::sky::panorama::render::{PanoramaShot, render};
use mesophyll_sky::SkyModel;
use std::path::PathBuf;

const EXAMPLES: &str = "Examples:
  mesophyll eval panorama --sun-zenith-deg 50 --turbidity 3 -o sky.exr
  mesophyll eval panorama --sun-zenith-deg 30 --turbidity 4 --projection fisheye --size 400x400 --noise 0.02 --disk \
  --clip 30 -o dome.exr";

/// Renders a sky as an EXR panorama (channels R, G, B: linear sRGB, kcd/m² times --scale), with seeded noise.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES, after_long_help = format!("{EXAMPLES}\n\n{}", tables::help("eval panorama")))]
pub struct Args {
    /// File to write, `-` for standard output
    #[arg(short, long = "out", alias = "output", value_name = "FILE.exr")]
    output: PathBuf,
    /// Sun: angle from the zenith, 0 to 90
    #[arg(long, value_name = "DEG")]
    sun_zenith_deg: f64,
    /// Sun: azimuth, from +x to +y
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    sun_azimuth_deg: f64,
    /// Turbidity
    #[arg(long, value_name = "T")]
    turbidity: f64,
    /// The sky
    #[arg(long, value_parser = named::<SkyModel>(), default_value_t = SkyModel::Preetham)]
    model: SkyModel,
    /// Ground albedo of hosek-wilkie, 0 to 1
    #[arg(long, value_name = "A", default_value_t = 0.2)]
    albedo: f64,
    /// Albedo of level ground drawn below the horizon, 0 to 1
    #[arg(long, value_name = "A", default_value_t = 0.0)]
    ground: f64,
    /// How pixels map to directions
    #[arg(long, value_parser = named::<PanoramaProjectionKind>(),
        default_value_t = PanoramaProjectionKind::Equirectangular)]
    projection: PanoramaProjectionKind,
    /// With --projection fisheye: the whole angle across the circle
    #[arg(long, value_name = "DEG", default_value_t = 180.0)]
    field_deg: f64,
    /// Pixels (default: 256x128, fisheye 256x256)
    #[arg(long, value_name = "WxH")]
    size: Option<String>,
    /// Reading of one kcd/m²
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    scale: f64,
    /// Relative standard error of a reading
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    noise: f64,
    /// Seed of the noise
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Draw the sun's disk
    #[arg(long)]
    disk: bool,
    /// Highest reading of the sensor
    #[arg(long, value_name = "V")]
    clip: Option<f64>,
}

/// Largest picture.
const MOST: usize = 1 << 26;

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    claim::file(&args.output, &["exr"], &[])?;
    let projection = PanoramaProjection::of(args.projection, args.field_deg);
    let default = if args.projection == PanoramaProjectionKind::Fisheye { "256x256" } else { "256x128" };
    let text = args.size.as_deref().unwrap_or(default);
    let size = text.split_once('x').and_then(|(w, h)| Some((w.parse::<usize>().ok()?, h.parse::<usize>().ok()?)));
    let (width, height) = size
        .filter(|(w, h)| *w > 0 && *h > 0 && w.checked_mul(*h).is_some_and(|n| n <= MOST))
        .ok_or_else(|| Error::Usage(format!("--size is {text}; expected WIDTHxHEIGHT, such as 256x128")))?;
    projection.check(width, height).map_err(|why| Error::Usage(format!("--size: {why}")))?;
    for (name, value, low, high) in [("--ground", args.ground, 0.0, 1.0), ("--noise", args.noise, 0.0, 0.3)] {
        if !(low..=high).contains(&value) {
            return Err(Error::Usage(format!("{name} is {value}; expected {low} to {high}")));
        }
    }
    for (name, value) in [("--scale", Some(args.scale)), ("--clip", args.clip)] {
        if value.is_some_and(|v| !(v > 0.0 && v.is_finite())) {
            return Err(Error::Usage(format!("{name} is {}; expected more than 0", value.unwrap_or(f64::NAN))));
        }
    }
    if !args.sun_azimuth_deg.is_finite() {
        return Err(Error::Usage(format!("--sun-azimuth-deg is {}; expected a number", args.sun_azimuth_deg)));
    }
    let model = mesophyll_fits::sky::over(args.model, args.albedo)?;
    let sky = model.sky(args.sun_zenith_deg.to_radians(), args.turbidity).map_err(|e| Error::Usage(e.to_string()))?;
    let shot = PanoramaShot {
        projection,
        width,
        height,
        azimuth: args.sun_azimuth_deg.to_radians(),
        scale: args.scale,
        noise: args.noise,
        seed: args.seed,
        ground: args.ground,
        disk: args.disk,
        clip: args.clip.unwrap_or(f64::INFINITY),
    };
    let stdout = destination::is_stdout(&args.output);
    if stdout && common.json {
        return Err(Error::Usage(
            "-o -: standard output holds the picture itself; expected no --json beside it".into(),
        ));
    }
    destination::file(&args.output, |path| write_exr(path, &render(sky.as_ref(), &shot), Packing::Zip))?;
    if common.json {
        crate::cli::print_json(&serde_json::json!({ "written": [args.output] }))?;
    } else if !stdout {
        progress::say(format!("wrote {}", args.output.display()));
    }
    Ok(0)
}
