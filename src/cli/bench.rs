//! `mesophyll bench`: error against run time over each model's accuracy knobs, as a table and plots, with peers where
//! they are installed.

use super::{Common, place};
use crate::{Error, Result};
use clap::builder::PossibleValuesParser;
use mesophyll_files::claim::{self, Kind};
use mesophyll_files::progress::Bar;
use mesophyll_files::{atomic, progress};
use mesophyll_proof::bench::BenchRow;
use mesophyll_proof::{beam, gloss, nist, sky, slab, translucency};
use mesophyll_report::{self as report, bench_plots, rows};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  mesophyll bench -o out/bench                    every model, tables and plots
  mesophyll bench translucency -o out/bench       about a minute on two idle cores; also translucency-basis.svg
  mesophyll bench sky --json                      rows for a program

A terminal shows how far it is and the time left. Ctrl-C stops before anything is printed or written.")]
pub struct Args {
    /// Which models to sweep (default: all)
    #[arg(value_name = "MODEL", value_parser = PossibleValuesParser::new(SWEEPS.map(|(name, _, _)| name)))]
    models: Vec<String>,
    /// Write bench.json, a plot a model, and the pictures of the documentation that belong to a model into this folder
    #[arg(short, long = "out", alias = "output", value_name = "DIR", value_parser = place::folder())]
    output: Option<PathBuf>,
    /// Measure Python peers (SciPy, lmfit, iadpython) beside us, where Python has them
    #[arg(long)]
    peers: bool,
}

/// Name, steps of the bar, and the rows, which take those steps.
type Sweep = (&'static str, u64, fn(&Bar) -> Result<Vec<BenchRow>>);

/// The sweeps by name. A model adds its line here.
const SWEEPS: [Sweep; 6] = [
    ("solve", 1, |bar| whole(bar, nist::bench_rows)),
    ("slab", 1, |bar| whole(bar, slab::bench::bench_rows)),
    ("gloss", 1, |bar| whole(bar, gloss::bench::bench_rows)),
    ("beam", 1, |bar| whole(bar, beam::bench::bench_rows)),
    ("sky", 1, |bar| whole(bar, sky::bench::bench_rows)),
    ("translucency", translucency::bench::PIECES, translucency::bench::rows),
];

/// A sweep of one step.
fn whole(bar: &Bar, rows: fn() -> Result<Vec<BenchRow>>) -> Result<Vec<BenchRow>> {
    let rows = rows()?;
    bar.step()?;
    Ok(rows)
}

/// Runs the sweeps; a stop between two steps leaves nothing behind. Times are for ratios within one run: nothing is
/// asserted of them.
pub fn run(args: &Args, common: &Common) -> Result<u8> {
    let names = SWEEPS.map(|(name, _, _)| name);
    let wanted = chosen(&args.models, &names);
    if cfg!(debug_assertions) {
        progress::say("this build is not optimised: its times say little, beside peers nothing");
    }
    if let Some(folder) = &args.output {
        claim::folder(folder, Kind::Bench, &[])?;
    }
    let steps: u64 = wanted.iter().map(|k| SWEEPS[*k].1 + u64::from(args.peers)).sum();
    let bar = Bar::new("sweeps", steps);
    let mut all: Vec<BenchRow> = Vec::new();
    for index in wanted {
        let (name, _, sweep) = SWEEPS[index];
        let part = Bar::of(name);
        all.extend(sweep(&bar)?);
        if args.peers {
            all.extend(super::peers::rows(name)?);
            bar.step()?;
        }
        drop(part);
    }
    drop(bar);
    if let Some(folder) = &args.output {
        let text = serde_json::to_string_pretty(&serde_json::json!({ "rows": all }))
            .map_err(|e| Error::Missed(e.to_string()))?;
        atomic::write_bytes(&folder.join("bench.json"), format!("{text}\n").as_bytes())?;
        let mut files = bench_plots::write(&all, folder)?;
        if all.iter().any(|r| r.model == "sky") {
            files.extend(report::sky::pictures(folder, &sky::figures::all(500)?)?);
        }
        if all.iter().any(|r| r.model == "translucency") {
            files.push(report::basis_charts::write(folder, &translucency::basis_study::histograms()?)?);
        }
        for file in files {
            progress::say(format!("wrote {}", file.display()));
        }
    }
    if common.json {
        super::print_json(&serde_json::json!({ "rows": all }))?;
    } else {
        super::print(&rows::bench_table(&all))?;
    }
    Ok(0)
}

/// Indices of the names asked for, each once, in the order asked; all of them where none was. Shared with `stress`.
pub(super) fn chosen(asked: &[String], names: &[&str]) -> Vec<usize> {
    if asked.is_empty() {
        return (0..names.len()).collect();
    }
    let mut indices = Vec::new();
    for k in asked.iter().filter_map(|name| names.iter().position(|n| n == name)) {
        if !indices.contains(&k) {
            indices.push(k);
        }
    }
    indices
}
