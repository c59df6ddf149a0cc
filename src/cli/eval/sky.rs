//! `mesophyll eval sky`: sun and turbidity in, spherical harmonics of the sky out, N² rows for each row.

use crate::cli::Result;
use crate::cli::names::named;
use crate::cli::{CommonArgs, batch, tables};
use mesophyll_files::progress;
use mesophyll_files::table::{Batch, BatchIo, BatchSpec, InputTable, OutputRow};
use mesophyll_fits::sky::evaluator::{SkyFitEvaluator, SkyFitSource};
use mesophyll_fits::sky::window::WindowKind;
use mesophyll_sky::SkyModel;
use mesophyll_sky::harmonics::MOST_BANDS;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

/// CSV columns `sun_zenith,turbidity` (radians; a column `sun_zenith_deg` is in degrees) → N² rows
/// `sun_zenith,turbidity,index,r,g,b,status` for each.
///
/// Real orthonormal harmonics of the upper hemisphere, zero below the horizon: no Condon-Shortley phase, index
/// l(l+1)+m, z up, sun at azimuth 0 = +x, kcd/m², linear sRGB, not clamped. The default evaluates the fit (turbidity
/// 2.5 to 6, up to 7 bands); what it does not cover is integrated directly, and a message says so.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("eval sky"))]
pub struct Args {
    #[command(flatten)]
    io: BatchIo,
    /// Bands N: l < N
    #[arg(
        long,
        value_name = "N",
        default_value_t = 7,
        value_parser = clap::value_parser!(u16).range(1..=MOST_BANDS as i64)
    )]
    bands: u16,
    /// fit: fitted polynomials, error at most 4.1e-6; compact: polynomials of two thirds of the size, error at most
    /// 1.1e-5; direct: numerical integration, error about 1e-9. The other methods fit polynomials to the Preetham sky
    /// without using its formula
    #[arg(long, value_parser = named::<SkyFitSource>(), default_value_t = SkyFitSource::Fit)]
    method: SkyFitSource,
    /// The sky; hosek-wilkie needs --method direct
    #[arg(long, value_parser = named::<SkyModel>(), default_value_t = SkyModel::Preetham)]
    model: SkyModel,
    /// Ground albedo of hosek-wilkie, 0 to 1
    #[arg(long, value_name = "A", default_value_t = 0.2)]
    albedo: f64,
    /// Factors that reduce ringing. fitted: dips no deeper below zero than lanczos, but loses less irradiance;
    /// positive: never dips below zero
    #[arg(long, value_parser = named::<WindowKind>(), default_value_t = WindowKind::None)]
    window: WindowKind,
    /// Light from level ground of this albedo, 0 to 1, below the horizon (of the sky alone: the sun is not part of it)
    #[arg(long, value_name = "A", default_value_t = 0.0)]
    ground: f64,
    /// Evaluate the fit in this folder (see `fit sky`) in place of the built-in one
    #[arg(long, value_name = "DIR", conflicts_with_all = ["method", "model"])]
    fit: Option<PathBuf>,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let (bands, window, ground) = (usize::from(args.bands), args.window, args.ground);
    let table = InputTable::open(&args.io.input)?;
    let (sun_column, sun_unit) = table.angle("sun_zenith")?;
    let spec = BatchSpec {
        required: vec![sun_column.clone(), "turbidity".into()],
        outputs: ["index", "r", "g", "b"].map(String::from).to_vec(),
        whole: vec!["index".into()],
        ..BatchSpec::default()
    };
    let batch = Batch::open(table, &args.io.rows(common.json), &spec)?;
    let skies = match &args.fit {
        Some(folder) => SkyFitEvaluator::of_folder(folder, bands, window, ground)?,
        None => SkyFitEvaluator::new(args.method, args.model, args.albedo, bands, window, ground)?,
    };
    let (beyond, warned) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let tally = batch.run(|row, out| {
        let (sun, turbidity) = (sun_unit * row.get(0), row.get(1));
        match skies.at(sun, turbidity) {
            Ok(found) => {
                beyond.fetch_add(usize::from(found.beyond_fit), Ordering::Relaxed);
                warned.fetch_add(usize::from(found.warned), Ordering::Relaxed);
                let values = found.coefficients.values().iter().enumerate();
                out.extend(values.map(|(k, v)| OutputRow::ok(vec![k as f64, v[0], v[1], v[2]])));
            }
            Err(_) if sun_unit != 1.0 && !(0.0..=90.0).contains(&row.get(0)) => {
                out.push(OutputRow::refused(format!(
                    "{sun_column} is {}; expected 0 (zenith) to 90 (horizon)",
                    row.get(0)
                )));
            }
            Err(why) => out.push(OutputRow::refused(why.to_string())),
        }
    })?;
    let (beyond, warned) = (beyond.into_inner(), warned.into_inner());
    if warned > 0 {
        let [low, high] = skies.model().trusted();
        progress::say(format!(
            "warning: {warned} skies have a turbidity outside the {low} to {high} for which {} is trusted",
            skies.model().name()
        ));
    }
    if beyond > 0 {
        progress::say(format!("{beyond} skies lie outside the range of the fit and were integrated directly"));
    }
    batch::say_tally(&tally, &args.io, common, "row")?;
    Ok(0)
}
