//! `mesophyll bench`: error against run time over each model's accuracy knobs, as a table and plots, with peers where
//! they are installed.

use super::{CommonArgs, destination, models};
use crate::cli::{Error, Result};
use clap::builder::PossibleValuesParser;
use mesophyll_files::claim::{self, OutputKind};
use mesophyll_files::progress::TaskProgress;
use mesophyll_files::{atomic, progress};
use mesophyll_proof::bench::BenchRow;
use mesophyll_proof::{bench_charts, tables};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  mesophyll bench                                 what there is
  mesophyll bench all -o out/bench                every model, tables and plots
  mesophyll bench translucency -o out/bench       about a minute on two idle cores; also translucency-basis.svg
  mesophyll bench sky --json                      rows for a program

A terminal shows how far it is and the time left. Ctrl-C stops before anything is printed or written.")]
pub struct Args {
    /// Which models to sweep: names, or all (default: say what there is)
    #[arg(value_name = "MODEL",
        value_parser = PossibleValuesParser::new(models::names(|m| m.bench)))]
    models: Vec<String>,
    /// Write bench.json, one plot for each model, and the documentation's pictures of these models into this folder
    #[arg(short, long = "out", alias = "output", value_name = "DIR", value_parser = destination::folder())]
    output: Option<PathBuf>,
    /// Also measure comparable Python packages (SciPy, lmfit, iadpython, PROSPECT-D, Mitsuba), as far as they are
    /// installed
    #[arg(long)]
    peers: bool,
}

/// Runs the sweeps. A stop between two steps leaves nothing behind. Times are only for ratios within one run: nothing
/// is asserted about them.
pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    if args.models.is_empty() {
        return match &args.output {
            None => models::list("bench", |m| m.bench, common),
            Some(folder) => Err(Error::argument("-o", folder.display(), "the names of models before it, or all")),
        };
    }
    let wanted = models::asked(&args.models, |m| m.bench);
    if cfg!(debug_assertions) {
        progress::say(
            "this build is not optimised, so its times say little; do not compare them with those of other programs",
        );
    }
    let claim = |folder: &PathBuf| claim::folder(folder, OutputKind::Bench, &[]);
    let _claim = args.output.as_ref().map(claim).transpose()?;
    let steps: u64 = wanted.iter().map(|(_, sweep)| sweep.steps + u64::from(args.peers)).sum();
    let bar = TaskProgress::new("sweeps", steps);
    let mut all: Vec<BenchRow> = Vec::new();
    for (name, sweep) in &wanted {
        let _part = TaskProgress::of(*name);
        all.extend((sweep.rows)(&bar)?);
        if args.peers {
            all.extend(super::peers::rows(name, sweep.peers)?);
            bar.step()?;
        }
    }
    drop(bar);
    if let Some(folder) = &args.output {
        let text = serde_json::to_string_pretty(&serde_json::json!({ "rows": all }))
            .map_err(|e| Error::Missed(e.to_string()))?;
        atomic::write_bytes(&folder.join("bench.json"), format!("{text}\n").as_bytes())?;
        let mut files = bench_charts::write(&all, folder)?;
        for draw in wanted.iter().filter_map(|(_, sweep)| sweep.pictures) {
            files.extend(draw(folder)?);
        }
        for file in files {
            progress::say(format!("wrote {}", file.display()));
        }
    }
    if common.json {
        super::print_json(&serde_json::json!({ "rows": all }))?;
    } else {
        super::print(&tables::bench_table(&all))?;
    }
    Ok(0)
}
