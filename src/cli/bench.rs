//! `mesophyll bench`: error against run time over each model's accuracy knobs, as a table and plots, with peers where they are installed.

use super::Common;
use crate::files::{atomic, progress};
use crate::fit::bench::BenchRow;
use crate::fit::{beam, gloss, nist, sky, slab_bench, translucency};
use crate::report::{self, rows};
use crate::{Error, Result};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Which models to sweep (default: all)
    #[arg(value_name = "MODEL")]
    models: Vec<String>,
    /// Write bench.json and a plot a model into this folder
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Measure Python peers (SciPy, lmfit, iadpython) beside us, where Python has them
    #[arg(long)]
    peers: bool,
}

type Sweep = (&'static str, fn() -> Result<Vec<BenchRow>>);

/// The sweeps by name. A model adds its line here.
const SWEEPS: [Sweep; 6] = [
    ("solve", nist::bench_rows),
    ("slab", slab_bench::bench_rows),
    ("gloss", gloss::bench::bench_rows),
    ("beam", beam::bench::bench_rows),
    ("sky", sky::bench::bench_rows),
    ("translucency", translucency::bench::rows),
];

/// Runs the sweeps. Times are for ratios within one run: nothing is asserted of them.
pub fn run(args: &Args, common: &Common) -> Result<u8> {
    let names = SWEEPS.map(|(name, _)| name);
    let wanted = chosen(&args.models, &names, "bench")?;
    if cfg!(debug_assertions) {
        progress::say("this build is not optimised: its times say little, beside peers nothing");
    }
    let bar = progress::Bar::new("sweeps", wanted.len() as u64 * if args.peers { 2 } else { 1 });
    let mut all: Vec<BenchRow> = Vec::new();
    for index in wanted {
        let (name, sweep) = SWEEPS[index];
        if progress::stop_requested() {
            return Err(Error::Interrupted("stopped between two sweeps; nothing was printed".into()));
        }
        all.extend(sweep()?);
        bar.advance(1);
        if args.peers {
            all.extend(super::peers::rows(name)?);
            bar.advance(1);
        }
    }
    drop(bar);
    if let Some(folder) = &args.output {
        let text = serde_json::to_string_pretty(&serde_json::json!({ "rows": all })).map_err(|e| Error::Missed(e.to_string()))?;
        atomic::write_bytes(&folder.join("bench.json"), format!("{text}\n").as_bytes())?;
        let mut files = rows::bench_plots(&all, folder)?;
        if all.iter().any(|r| r.model == "sky") {
            files.extend(report::sky::pictures(folder, 500)?);
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

/// Indices of the names asked for, in the order asked; all of them where none was. Shared with `stress`.
pub(super) fn chosen(asked: &[String], names: &[&str], what: &str) -> Result<Vec<usize>> {
    if asked.is_empty() {
        return Ok((0..names.len()).collect());
    }
    let index = |name: &String| {
        names
            .iter()
            .position(|n| n == name)
            .ok_or_else(|| Error::Usage(format!("no {what} is called {name:?}; there are {}", names.join(", "))))
    };
    let mut indices = Vec::new();
    for name in asked {
        let k = index(name)?;
        if !indices.contains(&k) {
            indices.push(k);
        }
    }
    Ok(indices)
}
