//! `mesophyll eval dipole`: thickness and radius in, a leaf's transmittance T(r, d) out.

use crate::cli::names::named;
use crate::cli::{CommonArgs, batch, tables};
use crate::cli::{Error, Result};
use mesophyll_files::table::{self, BatchIo, BatchSpec, InputTable, OutputRow, Status};
use mesophyll_optics::dipole::{DipoleForm, FormKind, Tissue, verdict};

/// CSV columns `thickness,radius` (mm) → `t,status`: exitance of the far side, 1/mm², per flux that entered `radius`
/// away.
///
/// The value is printed wherever the formula has one; `status` says where diffusion does not hold.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("eval dipole"))]
pub struct Args {
    #[command(flatten)]
    io: BatchIo,
    /// Absorption coefficient, 1/mm
    #[arg(long, value_name = "PER_MM", default_value_t = Tissue::TABLE.sigma_a, allow_negative_numbers = true)]
    sigma_a: f64,
    /// Scattering coefficient, 1/mm
    #[arg(long, value_name = "PER_MM", default_value_t = Tissue::TABLE.sigma_s, allow_negative_numbers = true)]
    sigma_s: f64,
    /// Mean cosine of the scattering angle, between -1 and 1
    #[arg(long, value_name = "COSINE", default_value_t = Tissue::TABLE.g, allow_negative_numbers = true)]
    g: f64,
    /// Boundary term A = (1+rho_d)/(1-rho_d), 1 or more
    #[arg(long, value_name = "A", default_value_t = Tissue::TABLE.a)]
    a: f64,
    /// The sum runs over j = -n … n (with --method dipoles)
    #[arg(long, value_name = "N", default_value_t = 3)]
    dipoles: u32,
    /// dipoles: the paper's sum; images: n = ∞, exact; thin: also for blades thinner than a mean free path (scattered
    /// light only)
    #[arg(long, value_parser = named::<FormKind>(), default_value_t = FormKind::Dipoles)]
    method: FormKind,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let tissue = Tissue { sigma_a: args.sigma_a, sigma_s: args.sigma_s, g: args.g, a: args.a };
    if let Some(fault) = tissue.fault() {
        return Err(Error::Usage(format!("--{}", fault.replacen("sigma_", "sigma-", 1))));
    }
    if args.dipoles > verdict::MOST_DIPOLES {
        let most = verdict::MOST_DIPOLES;
        return Err(Error::Usage(format!("--dipoles is {}; expected 0 to {most}", args.dipoles)));
    }
    let form = DipoleForm::of(args.method, args.dipoles);
    let spec = BatchSpec {
        required: vec!["thickness".into(), "radius".into()],
        outputs: vec!["t".into()],
        ..BatchSpec::default()
    };
    let tally = table::run(InputTable::open(&args.io.input)?, &args.io.rows(common.json), &spec, |row, out| {
        out.push(match verdict::evaluate(&tissue, form, row.get(0), row.get(1)) {
            (_, Status::Refused(why)) => OutputRow::refused(why),
            (t, status) => OutputRow { values: vec![t], status },
        });
    })?;
    batch::say_tally(&tally, &args.io, common, "row")?;
    Ok(0)
}
