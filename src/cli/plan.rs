//! `mesophyll plan`.

use super::Common;
use crate::Result;
use mesophyll_scene::{fits::missing as missing_fits, ledger::Ledger, manifest::Manifest, plan};
use std::fmt::Write;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  mesophyll plan data/scenes/glossy-sky.toml\n  mesophyll plan data/scenes/back-lit.toml \
     --json"
)]
pub struct Args {
    /// Scene to plan
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// Folder of an earlier run, whose fits count as done
    #[arg(short, long, alias = "output", value_name = "DIR", value_parser = super::place::folder())]
    out: Option<PathBuf>,
}

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    let manifest = Manifest::read(&args.scene)?;
    let plan = plan::make(&manifest, args.out.as_deref(), Some(&missing_fits::input_hash), &Ledger::new())?;
    if common.json {
        super::print_json(&plan)?;
    } else {
        super::print(&text(&plan))?;
    }
    Ok(0)
}

/// The plan in words.
pub fn text(plan: &plan::Plan) -> String {
    let mut out = format!("{} needs\n", plan.scene);
    for need in &plan.needed {
        let amount = need.amount.as_ref().map_or(String::new(), |a| format!(" [{a}]"));
        let _ = writeln!(out, "  {}{amount}: {}", need.name, need.reason);
    }
    let _ = writeln!(out, "left out");
    for left in &plan.left_out {
        let _ = writeln!(out, "  {}: {}; saved {}", left.name, left.reason, left.saved);
    }
    for warning in &plan.warnings {
        let _ = writeln!(out, "warning: {warning}");
    }
    out
}
