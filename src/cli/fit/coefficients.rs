//! `mesophyll fit coefficients`: spectra of leaves with measured contents in, specific absorptions and indices out.

use crate::cli::{CommonArgs, tables};
use crate::cli::{Error, Result};
use mesophyll_files::spectra;
use mesophyll_files::{atomic, claim, progress};
use mesophyll_fits::plates::{calibration, reading, table, training};
use std::io::Write;
use std::path::{Path, PathBuf};

/// CSV columns `leaf,species,R400,T400,…` with `measured_chlorophyll_ug_cm2`, `measured_carotenoid_ug_cm2`,
/// `measured_water_g_cm2` and `measured_dry_g_cm2` → a table of coefficients, a row a wavelength, for
/// `fit foliar --pigments`.
///
/// The leaf is a stack of plates, described by seven numbers. Each species is left out once, to learn what the model is
/// off by in leaves that it has not seen.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("fit coefficients"))]
pub struct Args {
    /// CSV to read (`-`: standard input)
    #[arg(long = "in", value_name = "FILE", default_value = "-")]
    input: PathBuf,
    /// CSV to write (`-`: standard output); written whole or not at all
    #[arg(short = 'o', long = "out", alias = "output", value_name = "FILE", default_value = "-")]
    output: PathBuf,
    /// R and T are in per cent
    #[arg(long)]
    percent: bool,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    claim::file(&args.output, &["csv"], &[&args.input])?;
    let table = spectra::open(&args.input)?;
    let file = (args.output != Path::new("-")).then(|| atomic::PendingFile::create(&args.output)).transpose()?;
    let name = table.name().to_path_buf();
    let training = reading::read(table, args.percent)?;
    if let Some(why) = training::refusal(&training) {
        return Err(Error::input(&name, why));
    }
    let trained = training::train(&training)?;
    let text = table::write(&trained.coefficients);
    match file {
        None => crate::cli::print(&String::from_utf8_lossy(&text))?,
        Some(mut file) => {
            file.write_all(&text).map_err(|e| Error::write(&args.output, atomic::explain(&e)))?;
            file.finish()?;
        }
    }
    progress::say(calibration::words(&trained.coefficients, training.without_species));
    for said in trained.uncarried.iter().chain(&trained.suspects) {
        progress::say(format!("{}: {said}", name.display()));
    }
    if common.json && args.output != Path::new("-") {
        let population = trained.coefficients.population;
        crate::cli::print_json(&serde_json::json!({
            "leaves": population.counts[0], "species": population.counts[1], "rms": population.rms,
            "uncarried": trained.uncarried, "suspects": trained.suspects,
        }))?;
    }
    Ok(0)
}
