//! `mesophyll eval beam`: taper and place in, deflection and slope out.

use crate::cli::Result;
use crate::cli::{CommonArgs, batch, tables};
use mesophyll_files::table::{self, BatchIo, BatchSpec, InputTable};
use mesophyll_fits::branch::beam;

/// CSV columns `alpha,x` (tip radius over root radius; place from 0 at the root to 1 at the tip) → `u,du,status`:
/// deflection and slope of an evenly loaded, clamped, tapered circular beam of unit length for F/(E′r₁⁴) = 1, to 12
/// digits.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("eval beam"))]
pub struct Args {
    #[command(flatten)]
    io: BatchIo,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let spec = BatchSpec {
        required: vec!["alpha".into(), "x".into()],
        outputs: vec!["u".into(), "du".into()],
        ..BatchSpec::default()
    };
    let tally = table::run(InputTable::open(&args.io.input)?, &args.io.rows(common.json), &spec, |row, out| {
        out.push(beam::evaluate(row.get(0), row.get(1)));
    })?;
    batch::say_tally(&tally, &args.io, common, "row")?;
    Ok(0)
}
