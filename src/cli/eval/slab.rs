//! `mesophyll eval slab`: ω and Δ in, ρd and ρt out.

use crate::named::named;
use crate::{Common, batch, tables};
use crate::{Error, Result};
use mesophyll_files::table::{self, Answer, BatchIo, Spec, Status, Table};
use mesophyll_optics::slab::verdict::{self, Method};

/// CSV columns `omega,delta` (single-scattering albedo, optical thickness) → `rho_d,rho_t,status`.
///
/// Near ω = 1, `one_minus_omega` may be given as a column of its own; where it is, it decides and omega only has to
/// agree to 1e-9.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("eval slab"))]
pub struct Args {
    #[command(flatten)]
    io: BatchIo,
    /// fast: interpolation in a table, error about 1e-8; exact: at least nine digits; fn: the paper's F_N method, whose
    /// order is raised until two successive orders agree
    #[arg(long, value_parser = named::<Method>(), default_value_t = Method::Fast)]
    method: Method,
    /// Angle of the beam from the normal, below 90 (with --method exact)
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0)]
    incidence_deg: f64,
}

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    if !(0.0..90.0).contains(&args.incidence_deg) {
        return Err(Error::Usage(format!("--incidence-deg is {}; expected 0 to below 90", args.incidence_deg)));
    }
    if args.incidence_deg != 0.0 && args.method != Method::Exact {
        return Err(Error::Usage("--incidence-deg needs --method exact; the others are made for a normal beam".into()));
    }
    let mu0 = args.incidence_deg.to_radians().cos();
    let spec = Spec {
        required: vec!["omega".into(), "delta".into()],
        optional: vec!["one_minus_omega".into()],
        outputs: vec!["rho_d".into(), "rho_t".into()],
        ..Spec::default()
    };
    let tally = table::run(Table::open(&args.io.input)?, &args.io.rows(common.json), &spec, |row, out| {
        out.push(match verdict::evaluate(args.method, mu0, row.get(0), row.get(1), row.get(2)) {
            (_, Status::Refused(why)) => Answer::refused(why),
            (r, status) => Answer { values: vec![r.rho_d, r.rho_t], status },
        });
    })?;
    batch::say_tally(&tally, &args.io, common, "row")?;
    Ok(0)
}
