//! `mesophyll fit sky`: polynomials of a sky's spherical harmonics over sun and turbidity, or the sun and turbidity of
//! a panorama, as a fit folder.

use crate::cli::names::named;
use crate::cli::{CommonArgs, destination, tables};
use crate::cli::{Error, Result};
use mesophyll_files::progress;
use mesophyll_fits::sky::panorama::{self, picture::PanoramaChannels, projection::PanoramaProjectionKind};
use mesophyll_fits::sky::{self as fits, Options, SkyFitMethod, folder};
use mesophyll_sky::SkyModel;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "Examples:
  mesophyll fit sky -o out/sky
  mesophyll fit sky --method compact --bands 4 -o out/sky-small
  mesophyll eval panorama --sun-zenith-deg 50 --turbidity 3 --noise 0.02 -o out/pano.exr
  mesophyll fit sky --panorama out/pano.exr -o out/pano-fit";

/// Fits every coefficient of N bands over sun zenith (0 to the horizon) and turbidity, and judges the fit against
/// direct integration.
///
/// DIR gets fit.toml, times.toml and coefficients.json (the arrays in f32).
///
/// With --panorama: from a picture of the sky (OpenEXR or Radiance, linear, white-balanced, proportional to radiance)
/// the sun's zenith angle and azimuth, the turbidity and the reading of one kcd/m², with standard errors. Azimuth grows
/// from +x to +y; an equirectangular picture's middle column looks to +x and its right half towards -y, a fisheye's top
/// is +x and its right +y. Ignored pixels: those that are NaN, those whose mask or alpha channel A is below 1/2, and
/// those below the horizon. The fit finds clipped pixels, clouds and the sun's disk by itself and leaves them out of
/// the sky.
///
/// The sun is taken from its disk where the picture shows it, unless the sky's brightness tells its place more closely
/// and the disk agrees; the answer says which. The disk is one compact spot far brighter than the sky, or clipped.
/// Where another spot is as bright there is none, and where the spot is far from the sun of the sky, both are named.
///
/// DIR gets fit.toml, times.toml and all.exr (fate, reduced chi2, residuals).
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES, after_long_help = format!("{EXAMPLES}\n\n{}", tables::help("fit sky")))]
pub struct Args {
    /// Folder to write
    #[arg(short, long = "out", alias = "output", value_name = "DIR", value_parser = destination::folder())]
    output: PathBuf,
    /// Polynomials and how they are found; at 7 bands, fine takes 42 kB and compact 27 kB (errors:
    /// docs/evidence/sky.md)
    #[arg(long, value_parser = named::<SkyFitMethod>(), default_value_t = SkyFitMethod::Fine)]
    method: SkyFitMethod,
    /// Bands N: l < N
    #[arg(long, value_name = "N", default_value_t = 7,
        value_parser = clap::value_parser!(u16).range(1..=fits::MOST_BANDS as i64))]
    bands: u16,
    /// Turbidities to cover
    #[arg(long, value_name = "LOW,HIGH", value_delimiter = ',', default_values_t = [2.5, 6.0])]
    turbidity: Vec<f64>,
    /// Samples of each variable, for the methods on a uniform grid
    #[arg(long, value_name = "N", default_value_t = 500)]
    grid: usize,
    /// The sky; hosek-wilkie is fitted as a black box by --method chebyshev
    #[arg(long, value_parser = named::<SkyModel>(), default_value_t = SkyModel::Preetham)]
    model: SkyModel,
    /// Ground albedo of hosek-wilkie, 0 to 1
    #[arg(long, value_name = "A", default_value_t = 0.2)]
    albedo: f64,
    /// Fit sun, turbidity and scale of this picture of the sky
    #[arg(long, value_name = "FILE",
        conflicts_with_all = ["method", "bands", "turbidity", "grid", "model", "albedo"])]
    panorama: Option<PathBuf>,
    /// With --panorama: how pixels map to directions
    #[arg(long, value_parser = named::<PanoramaProjectionKind>(),
        default_value_t = PanoramaProjectionKind::Equirectangular,
        requires = "panorama")]
    projection: PanoramaProjectionKind,
    /// With --projection fisheye: the whole angle across the circle
    #[arg(long, value_name = "DEG", default_value_t = 180.0, requires = "panorama")]
    field_deg: f64,
    /// With --panorama: three channels (red, green, blue) or one (luminance)
    #[arg(long, value_name = "NAMES", value_delimiter = ',',
        default_values_t = ["R".to_string(), "G".to_string(), "B".to_string()], requires = "panorama")]
    channels: Vec<String>,
    /// With --panorama: channel that hides pixels where it is below 1/2
    #[arg(long, value_name = "NAME", requires = "panorama")]
    mask: Option<String>,
    /// With --panorama: readings from here on are clipped (default: the highest, where several pixels share it)
    #[arg(long, value_name = "V", requires = "panorama")]
    saturation: Option<f64>,
    /// With --panorama: relative standard error of a reading (default: from how neighbouring pixels scatter)
    #[arg(long, value_name = "S", requires = "panorama")]
    noise: Option<f64>,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    if let Some(path) = &args.panorama {
        return from_panorama(args, path, common);
    }
    let method = args.method;
    let [low, high] = args.turbidity[..] else {
        return Err(Error::Usage(format!("--turbidity has {} values; expected two", args.turbidity.len())));
    };
    let options =
        Options { method, bands: args.bands.into(), turbidities: [low, high], grid: args.grid, ..Options::default() };
    let made = folder::make(&args.output, &options, args.model, args.albedo)?;
    let (fitted, wide, error, bytes) = (&made.fitted, &made.wide, &made.narrow, made.bytes);
    progress::say(format!(
        "{} terms a function, {bytes} bytes, {:.0} ms; worst error {:.1e} of the smallest c00 ({:.1e} in f64), median \
         {:.1e}; wrote {}",
        fitted.columns,
        1e3 * fitted.seconds(),
        error.worst,
        wide.worst,
        error.median,
        args.output.display()
    ));
    if !fitted.remark.is_empty() {
        progress::say(format!("note: {}", fitted.remark));
    }
    if common.json {
        crate::cli::print_json(&serde_json::json!({
            "method": method.name(),
            "bands": options.bands,
            "terms": fitted.columns,
            "bytes": bytes,
            "condition": fitted.condition.is_finite().then_some(fitted.condition),
            "rank": fitted.rank,
            "error_worst": error.worst,
            "error_worst_f64": wide.worst,
            "error_median": error.median,
            "error_worst_sum": error.worst_sum,
            "smallest_c00": made.smallest_c00,
            "ms": 1e3 * fitted.seconds(),
        }))?;
    }
    super::judged(&args.output)
}

fn from_panorama(args: &Args, path: &Path, common: &CommonArgs) -> Result<u8> {
    let told = panorama::record::Options {
        projection: args.projection,
        field_deg: args.field_deg,
        channels: PanoramaChannels {
            radiance: args.channels.clone(),
            mask: args.mask.clone(),
            saturation: args.saturation,
        },
        noise: args.noise,
    };
    let found = panorama::record::make(path, &args.output, &told)?;
    let shown = |k: panorama::PanoramaEstimate, unit: f64| format!("{:.4} ± {:.4}", k.value * unit, k.error * unit);
    let degrees = 180.0 / std::f64::consts::PI;
    progress::say(format!(
        "sun {} from the zenith, azimuth {} (degrees), taken from the {}; turbidity {}; scale {}; residuals {:.2} % of \
         a reading, reduced chi2 {:.3}; {}; wrote {}",
        shown(found.sun_zenith, degrees),
        shown(found.sun_azimuth, degrees),
        found.sun_from.name(),
        shown(found.turbidity, 1.0),
        shown(found.scale, 1.0),
        100.0 * found.relative_rms,
        found.reduced_chi2,
        found.status,
        args.output.display()
    ));
    if common.json {
        let number = |v: f64| v.is_finite().then_some(v);
        let known = |k: panorama::PanoramaEstimate, unit: f64| {
            let [value, stderr] = [k.value * unit, k.error * unit];
            serde_json::json!({"value": value, "stderr": number(stderr)})
        };
        crate::cli::print_json(&serde_json::json!({
            "sun_zenith_deg": known(found.sun_zenith, degrees),
            "sun_azimuth_deg": known(found.sun_azimuth, degrees),
            "turbidity": known(found.turbidity, 1.0),
            "scale": known(found.scale, 1.0),
            "sun_from": found.sun_from.name(),
            "disk": panorama::record::disk_in_words(&found),
            "noise": found.noise,
            "reduced_chi2": number(found.reduced_chi2),
            "relative_rms": found.relative_rms,
            "termination": found.fit.termination.name(),
            "outliers": found.outliers,
            "status": found.status.to_string(),
        }))?;
    }
    super::judged(&args.output)
}
