//! `mesophyll fit …`: one file a fit. The list is [`crate::cli::models::MODELS`].

use super::CommonArgs;
use crate::cli::models::{ModelEntry, ModelVerb};
use crate::cli::verb_choice::{VerbCatalogue, VerbChoice};
use crate::cli::{Error, Result};
use mesophyll_files::progress::say;
use mesophyll_fits::record::FitRecord;
use mesophyll_fits::record::maker::FitOutcome;
use mesophyll_report::{self as report, QualityLevel};
use std::path::Path;

pub mod beam;
pub mod coefficients;
pub mod foliar;
mod foliar_plates;
mod foliar_plots;
pub mod gloss;
pub mod grass;
pub mod leaf;
pub mod motion;
pub mod scene;
pub mod sky;
pub mod slab;
mod slab_columns;
mod slab_pictures;
mod thickness;
pub mod tissue;
pub mod transfer;
pub mod translucency;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: VerbChoice<Fits>,
}

/// The models that can be fitted.
#[derive(Debug, Clone)]
enum Fits {}

impl VerbCatalogue for Fits {
    fn verb(model: &ModelEntry) -> Option<ModelVerb> {
        model.fit
    }
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    args.what.run(common)
}

/// Checks a standard error of shares of light.
///
/// # Errors
/// [`Error::Usage`] for one that is negative or no number.
pub(crate) fn check_noise(noise: Option<f64>) -> Result<()> {
    match noise.filter(|n| !(*n >= 0.0 && n.is_finite())) {
        Some(noise) => Err(Error::Usage(format!("--noise is {noise}; expected a standard error of 0 or more"))),
        None => Ok(()),
    }
}

/// Says how the fit of the folder `out` ended, and returns its record; a shard has none.
fn ended(outcome: FitOutcome, out: &Path) -> Option<Box<FitRecord>> {
    let out = out.display();
    match outcome {
        FitOutcome::Done(record) => {
            say(format!("fit written to {out}"));
            Some(record)
        }
        FitOutcome::UpToDate(record) => {
            say(format!("{out} already holds this fit; --force fits again"));
            Some(record)
        }
        FitOutcome::ShardDone { missing: 0 } => {
            say(format!("shard done; all parts are there: run with --merge to finish {out}"));
            None
        }
        FitOutcome::ShardDone { missing } => {
            say(format!("shard done; {missing} parts of other shards are missing, then run with --merge"));
            None
        }
    }
}

/// Says how the fit of the folder `out` ended, and prints its record: as JSON, or by `summary`.
fn told(outcome: FitOutcome, out: &Path, common: &CommonArgs, summary: impl Fn(&FitRecord) -> String) -> Result<u8> {
    if let Some(record) = ended(outcome, out) {
        // A summary may print a warning, so it is always made.
        let text = summary(&record);
        if common.json {
            crate::cli::print_json(&*record)?
        } else {
            crate::cli::print(&text)?
        }
        return judged(out);
    }
    Ok(0)
}

/// Judges the fit that `out` now holds, by the rules of `mesophyll report` on what was measured. It stays written
/// whatever they say.
///
/// # Errors
/// [`Error::Missed`] with the verdict, for a fit that is not good: exit code 1.
fn judged(out: &Path) -> Result<u8> {
    let verdict = report::verdict(out)?;
    if verdict.missed {
        return Err(Error::Missed(format!("{}: {}", out.display(), verdict.sentence)));
    }
    if verdict.level != QualityLevel::Good {
        say(verdict.sentence);
    }
    Ok(0)
}
