//! `mesophyll stress`: the committed tables of stiff and extreme cases, each with the verdict that it must get.

use super::Common;
use crate::files::progress;
use crate::fit::stress::StressRow;
use crate::fit::{nist, solver};
use crate::report::rows;
use crate::{Error, Result};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Which tables to run (default: all)
    #[arg(value_name = "MODEL")]
    models: Vec<String>,
}

type Table = (&'static str, fn() -> Result<Vec<StressRow>>);

/// The tables by name. A model adds its line here.
const TABLES: [Table; 2] = [("solve", || Ok(solver::stress())), ("nist", nist::stress)];

/// Runs the tables; 0 where every case got the verdict it expects, else 1 with the others named.
pub fn run(args: &Args, common: &Common) -> Result<u8> {
    let names = TABLES.map(|(name, _)| name);
    let wanted = super::bench::chosen(&args.models, &names, "stress table")?;
    let bar = progress::Bar::new("stress tables", wanted.len() as u64);
    let mut all: Vec<StressRow> = Vec::new();
    for index in wanted {
        if progress::stop_requested() {
            return Err(Error::Interrupted("stopped between two stress tables; nothing was printed".into()));
        }
        all.extend(TABLES[index].1()?);
        bar.advance(1);
    }
    drop(bar);
    if common.json {
        super::print_json(&serde_json::json!({ "rows": all }))?;
    } else {
        super::print(&rows::stress_table(&all))?;
    }
    let missed: Vec<String> = all
        .iter()
        .filter(|r| r.verdict != r.expected)
        .map(|r| format!("{}: {} (expected {:?}, got {:?})", r.model, r.case, r.expected, r.verdict))
        .collect();
    if missed.is_empty() {
        return Ok(0);
    }
    Err(Error::Missed(format!("{} of {} stress cases missed: {}", missed.len(), all.len(), missed.join("; "))))
}
