//! `mesophyll stress`: the committed tables of stiff and extreme cases, each with the verdict that it must get.

use super::{CommonArgs, models};
use crate::cli::{Error, Result};
use clap::builder::PossibleValuesParser;
use mesophyll_files::progress;
use mesophyll_proof::stress::StressRow;
use mesophyll_proof::tables;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Which tables to run: names, or all (default: say what there is)
    #[arg(value_name = "MODEL",
        value_parser = PossibleValuesParser::new(models::names(|m| m.stress)))]
    models: Vec<String>,
}

/// A row as JSON has it: where the case got what it expects, the verdict is as short as that, and its full text (with a
/// bound) stands apart.
#[derive(serde::Serialize)]
struct Shown {
    #[serde(flatten)]
    row: StressRow,
    detail: String,
}

impl Shown {
    fn new(mut row: StressRow) -> Self {
        let detail = row.verdict.clone();
        if row.passed() {
            row.verdict.clone_from(&row.expected);
        }
        Shown { row, detail }
    }
}

/// Puts the rows of a table under the table's name. The rest of a longer model name moves to the case (`slab forward` →
/// `slab`, `forward: …`).
fn named(table: &str, mut rows: Vec<StressRow>) -> Vec<StressRow> {
    for row in &mut rows {
        if let Some(part) = row.model.strip_prefix(table).map(str::trim).filter(|part| !part.is_empty()) {
            row.case = format!("{part}: {}", row.case);
            row.model = table.into();
        }
    }
    rows
}

/// Runs the tables. Returns 0 where every case got the verdict that it expects; otherwise it returns 1 and the other
/// cases are named.
pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    if args.models.is_empty() {
        return models::list("stress", |m| m.stress, common);
    }
    let wanted = models::asked(&args.models, |m| m.stress);
    let bar = progress::TaskProgress::new("stress tables", wanted.len() as u64);
    let mut all: Vec<StressRow> = Vec::new();
    for (name, table) in wanted {
        if progress::stop_requested() {
            return Err(Error::Interrupted("stopped between two stress tables; nothing was printed".into()));
        }
        let _part = progress::TaskProgress::of(name);
        all.extend(named(name, table()?));
        bar.advance(1);
    }
    drop(bar);
    if common.json {
        let rows: Vec<Shown> = all.iter().cloned().map(Shown::new).collect();
        super::print_json(&serde_json::json!({ "rows": rows }))?;
    } else {
        super::print(&tables::stress_table(&all))?;
    }
    let missed: Vec<String> = all
        .iter()
        .filter(|r| !r.passed())
        .map(|r| format!("{}: {} (expected {:?}, got {:?})", r.model, r.case, r.expected, r.verdict))
        .collect();
    if missed.is_empty() {
        return Ok(0);
    }
    Err(Error::Missed(format!("{} of {} stress cases missed: {}", missed.len(), all.len(), missed.join("; "))))
}
