//! `mesophyll eval slab`: ω and Δ in, ρd and ρt out.

use crate::cli::names::named;
use crate::cli::{CommonArgs, batch, tables};
use crate::cli::{Error, Result};
use mesophyll_files::table::{self, BatchIo, BatchSpec, InputTable, OutputRow, Status};
use mesophyll_optics::slab::faces::{INDEX, INDEX_EXPECTED};
use mesophyll_optics::slab::verdict::{SlabEvaluator, SlabMethod};

/// CSV columns `omega,delta` (single-scattering albedo, optical thickness) → `rho_d,rho_t,status`.
///
/// The slab scatters isotropically. It has the index of its surroundings, so that its faces reflect nothing; with
/// `--index N` it lies in air, and rho_d has the mirror reflection of its faces, as an integrating sphere measures it.
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
    #[arg(long, value_parser = named::<SlabMethod>(), default_value_t = SlabMethod::Fast)]
    method: SlabMethod,
    /// Angle of the beam from the normal, below 90 (with --method exact)
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0)]
    incidence_deg: f64,
    /// Refractive index of the slab; its faces reflect light from outside and from inside, beyond the critical angle
    /// all of it (fast or exact)
    #[arg(long, value_name = "N", default_value_t = 1.0)]
    index: f64,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    if !(0.0..90.0).contains(&args.incidence_deg) {
        return Err(Error::Usage(format!("--incidence-deg is {}; expected 0 to below 90", args.incidence_deg)));
    }
    if args.incidence_deg != 0.0 && args.method != SlabMethod::Exact {
        return Err(Error::Usage("--incidence-deg needs --method exact; the others are made for a normal beam".into()));
    }
    if !INDEX.contains(&args.index) {
        return Err(Error::argument("--index", args.index, INDEX_EXPECTED));
    }
    if args.index != 1.0 && args.method == SlabMethod::Fn {
        return Err(Error::Usage("--index needs --method fast or exact; fn is for faces that reflect nothing".into()));
    }
    let mu0 = args.incidence_deg.to_radians().cos();
    let spec = BatchSpec {
        required: vec!["omega".into(), "delta".into()],
        optional: vec!["one_minus_omega".into()],
        outputs: vec!["rho_d".into(), "rho_t".into()],
        ..BatchSpec::default()
    };
    let table = InputTable::open(&args.io.input)?;
    let slabs = SlabEvaluator::new(args.method, mu0, args.index);
    let tally = table::run(table, &args.io.rows(common.json), &spec, |row, out| {
        out.push(match slabs.evaluate(row.get(0), row.get(1), row.get(2)) {
            (_, Status::Refused(why)) => OutputRow::refused(why),
            (r, status) => OutputRow { values: vec![r.rho_d, r.rho_t], status },
        });
    })?;
    batch::say_tally(&tally, &args.io, common, "row")?;
    Ok(0)
}
