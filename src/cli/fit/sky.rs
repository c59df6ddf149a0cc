//! `mesophyll fit sky`: polynomials of a sky's spherical harmonics over sun and turbidity, as a fit folder.

use crate::cli::Common;
use crate::cli::eval::sky::ModelName;
use crate::files::progress;
use crate::fit::sky::judge::Reference;
use crate::fit::sky::{self as fits, Method, Options, folder};
use crate::{Error, Result};
use std::path::PathBuf;

/// Fits every coefficient of N bands over sun zenith (0 to the horizon) and turbidity, and judges the fit against direct integration.
///
/// DIR gets fit.toml, times.toml and coefficients.json (the arrays in f32).
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder to write
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Polynomials and how they are found; fine: 1e-5 in 42 kB at 7 bands, compact: 1e-4 in 27 kB
    #[arg(long, value_enum, default_value_t = MethodName::Fine)]
    method: MethodName,
    /// Bands N: l < N
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = clap::value_parser!(u16).range(1..=fits::MOST_BANDS as i64))]
    bands: u16,
    /// Turbidities to cover
    #[arg(long, value_name = "LOW,HIGH", value_delimiter = ',', default_values_t = [2.5, 6.0])]
    turbidity: Vec<f64>,
    /// Samples of each variable, for the methods on a uniform grid
    #[arg(long, value_name = "N", default_value_t = 500)]
    grid: usize,
    /// The sky; hosek-wilkie is fitted as a black box by --method chebyshev
    #[arg(long, value_enum, default_value_t = ModelName::Preetham)]
    model: ModelName,
    /// Ground albedo of hosek-wilkie, 0 to 1
    #[arg(long, value_name = "A", default_value_t = 0.2)]
    albedo: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum MethodName {
    Fine,
    Compact,
    Chebyshev,
    ChebyshevGrid,
    MonomialsQr,
    MonomialsNormal,
}

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    let method = match args.method {
        MethodName::Fine => Method::Fine,
        MethodName::Compact => Method::Compact,
        MethodName::Chebyshev => Method::Chebyshev,
        MethodName::ChebyshevGrid => Method::ChebyshevGrid,
        MethodName::MonomialsQr => Method::MonomialsQr,
        MethodName::MonomialsNormal => Method::MonomialsNormal,
    };
    let [low, high] = args.turbidity[..] else {
        return Err(Error::Usage(format!("--turbidity has {} values; expected two", args.turbidity.len())));
    };
    let options = Options { method, bands: args.bands.into(), turbidities: [low, high], grid: args.grid, ..Options::default() };
    let model = args.model.model(args.albedo)?;
    let fitted = match args.model {
        ModelName::Preetham => fits::fit(&options)?,
        ModelName::HosekWilkie => fits::fit_model(&options, model.as_ref())?,
    };
    let reference = Reference::new(model.as_ref(), options.bands, options.turbidities, 33, 15).map_err(Error::Missed)?;
    let (wide, error) = folder::write(&args.output, &fitted, &reference)?;
    let bytes = fitted.form.as_ref().map_or(0, |f| f.narrow().bytes());
    progress::say(format!(
        "{} terms a function, {bytes} bytes, {:.0} ms; worst error {:.1e} of the smallest c00 ({:.1e} in f64), median {:.1e}; wrote {}",
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
            "smallest_c00": reference.smallest,
            "ms": 1e3 * fitted.seconds(),
        }))?;
    }
    Ok(0)
}
