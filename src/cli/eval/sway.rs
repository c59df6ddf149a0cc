//! `mesophyll eval sway`: where the tips of a scene's branches are, over time.

use crate::{Common, tables};
use crate::{Error, Result};
use mesophyll_files::progress::Bar;
use mesophyll_files::table::{Output, Sink, push_number, push_text};
use mesophyll_scene::ledger::Ledger;
use mesophyll_scene::manifest::Manifest;
use mesophyll_scene::placed::branch::{self, Bends};
use std::path::PathBuf;

/// Where the tips of a scene's branches are as they sway in its wind: `time_s,plant,branch,tip_x_mm,tip_y_mm,tip_z_mm`,
/// a row a branch and time. Both renderers bend the branches by the same numbers.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("eval sway"))]
pub struct Args {
    /// Scene with branches
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// First time (s)
    #[arg(long, value_name = "S", default_value_t = 0.0, allow_negative_numbers = true)]
    from: f64,
    /// Last time (s)
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    to: f64,
    /// Between two times (s)
    #[arg(long, value_name = "S", default_value_t = 0.05)]
    step: f64,
    /// CSV to write (`-`: standard output); written whole or not at all
    #[arg(short = 'o', long = "out", alias = "output", value_name = "FILE", default_value = "-")]
    output: PathBuf,
}

/// More rows than this are likelier a typing error than a wish.
const MOST_ROWS: f64 = 2e8;

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    if !(args.step > 0.0 && args.step.is_finite()) {
        return Err(Error::argument("--step", args.step, "a time above 0"));
    }
    if !(args.from.is_finite() && args.to.is_finite() && args.to >= args.from) {
        return Err(Error::argument("--to", args.to, format!("a time not before --from ({})", args.from)));
    }
    let manifest = Manifest::read(&args.scene)?;
    let ledger = Ledger::new();
    let twigs = branch::twigs(&manifest, &ledger)?;
    if twigs.is_empty() {
        return Err(Error::field(&args.scene, "branch", "missing; expected a scene with branches"));
    }
    let bends = Bends::new(&manifest, &twigs, &ledger)?;
    // The last time counts although the steps may fall short of it by rounding.
    let steps = ((args.to - args.from) / args.step + 1e-9).floor();
    if (steps + 1.0) * twigs.len() as f64 > MOST_ROWS {
        let found = format!("{} rows", (steps + 1.0) * twigs.len() as f64);
        return Err(Error::argument("--step", found, format!("at most {MOST_ROWS:e}")));
    }
    let mut sink = Sink::open(&Output { path: args.output.clone(), json: common.json }, &args.scene)?;
    sink.write_all(b"time_s,plant,branch,tip_x_mm,tip_y_mm,tip_z_mm\n")?;
    let bar = Bar::of("times");
    let mut line = Vec::new();
    for k in 0..=steps as u64 {
        let time = args.from + k as f64 * args.step;
        line.clear();
        for (index, branch) in manifest.branches.iter().enumerate() {
            push_number(&mut line, time);
            line.push(b',');
            push_text(&mut line, &manifest.name);
            line.push(b',');
            push_text(&mut line, &branch.name);
            for c in bends.tip(index, time) {
                line.push(b',');
                push_number(&mut line, c);
            }
            line.push(b'\n');
        }
        sink.write_all(&line)?;
        bar.advance(1);
        if mesophyll_files::progress::stop_requested() {
            return Err(Error::Interrupted("interrupted; nothing was written".into()));
        }
    }
    sink.finish()?;
    Ok(0)
}
