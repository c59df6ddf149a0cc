//! `mesophyll eval slab`: ω and Δ in, ρd and ρt out.

use crate::{Common, batch, tables};
use crate::{Error, Result};
use mesophyll_files::table::{self, Answer, BatchIo, Spec, Status, Table};
use mesophyll_optics::slab::{self, Response, exact, fn_method};

/// CSV columns `omega,delta` (single-scattering albedo, optical thickness) → `rho_d,rho_t,status`.
///
/// Near ω = 1, `one_minus_omega` may be given as a column of its own; where it is, it decides and omega only has to
/// agree to 1e-9.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("eval slab"))]
pub struct Args {
    #[command(flatten)]
    io: BatchIo,
    /// fast: table, 1e-8; exact: nine digits and more; fn: the paper's F_N, order raised until two agree
    #[arg(long, value_enum, default_value_t = Method::Fast)]
    method: Method,
    /// Angle of the beam from the normal, below 90 (with --method exact)
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0)]
    incidence_deg: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Method {
    Fast,
    Exact,
    Fn,
}

/// F_N orders are raised until ρd and ρt change by less than this; an answer that never settles to 1e-3 is not called
/// ok.
const FN_TOLERANCE: f64 = 1e-6;
const FN_SETTLED: f64 = 1e-3;

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
        out.push(evaluate(args.method, mu0, row.get(0), row.get(1), row.get(2)));
    })?;
    batch::say_tally(&tally, &args.io, common, "row")?;
    Ok(0)
}

/// Smaller numbers than this are stored with fewer digits than an answer promises.
const SMALLEST: f64 = 1e-300;

fn evaluate(method: Method, mu0: f64, omega: f64, delta: f64, one_minus_omega: f64) -> Answer {
    if !(0.0..=1.0).contains(&omega) {
        return Answer::refused(format!("omega is {omega}; expected 0 to 1"));
    }
    if !(delta >= 0.0 && delta.is_finite()) {
        return Answer::refused(format!("delta is {delta}; expected 0 or more"));
    }
    for (name, value) in [("omega", omega), ("delta", delta)] {
        if value != 0.0 && value < SMALLEST {
            return Answer::refused(format!(
                "{name} is {value:e}; expected 0 or at least {SMALLEST:e}, below which numbers lose their digits"
            ));
        }
    }
    let absorbed = if one_minus_omega.is_nan() { 1.0 - omega } else { one_minus_omega };
    if !(absorbed >= 0.0 && (omega + absorbed - 1.0).abs() < 1e-9) {
        return Answer::refused(format!(
            "one_minus_omega is {absorbed} beside omega {omega}; expected their sum to be 1"
        ));
    }
    // One of the two carries the digits: 1−ω near 1, ω near 0.
    let omega = if absorbed < 0.5 { 1.0 - absorbed } else { omega };
    let values = |r: Response| vec![r.rho_d, r.rho_t];
    match method {
        Method::Fast => Answer::ok(values(slab::reduced(omega, absorbed, delta).0)),
        Method::Exact => Answer::ok(values(exact::solve_at(mu0, omega, absorbed, delta))),
        Method::Fn => {
            let a = fn_method::solve(omega, absorbed, delta, FN_TOLERANCE);
            if a.change <= FN_SETTLED {
                Answer::ok(values(a.response))
            } else {
                let what = format!("rho_d; rho_t: order {} differs from the one before by {:.1e}", a.order, a.change);
                Answer { values: values(a.response), status: Status::Undetermined(what) }
            }
        }
    }
}
