//! `mesophyll eval dipole`: thickness and radius in, a leaf's transmittance T(r, d) out.

use crate::named::named;
use crate::{Common, batch, tables};
use crate::{Error, Result};
use mesophyll_files::table::{self, Answer, BatchIo, Spec, Status, Table};
use mesophyll_optics::dipole::{Form, FormKind, Tissue};
use mesophyll_optics::slab;

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

/// More than anyone needs: at σa = 1e-6/mm the sum has long converged.
const MOST_DIPOLES: u32 = 1_000_000;
/// What `ok` promises of a number.
const PROMISE: f64 = 0.1;

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    let tissue = Tissue { sigma_a: args.sigma_a, sigma_s: args.sigma_s, g: args.g, a: args.a };
    if let Some(fault) = tissue.fault() {
        return Err(Error::Usage(format!("--{}", fault.replacen("sigma_", "sigma-", 1))));
    }
    if args.dipoles > MOST_DIPOLES {
        return Err(Error::Usage(format!("--dipoles is {}; expected 0 to {MOST_DIPOLES}", args.dipoles)));
    }
    let form = Form::of(args.method, args.dipoles);
    let spec =
        Spec { required: vec!["thickness".into(), "radius".into()], outputs: vec!["t".into()], ..Spec::default() };
    let tally = table::run(Table::open(&args.io.input)?, &args.io.rows(common.json), &spec, |row, out| {
        out.push(evaluate(&tissue, form, row.get(0), row.get(1)));
    })?;
    batch::say_tally(&tally, &args.io, common, "row")?;
    Ok(0)
}

fn evaluate(tissue: &Tissue, form: Form, thickness: f64, radius: f64) -> Answer {
    if !(thickness > 0.0 && thickness.is_finite()) {
        return Answer::refused(format!("thickness is {thickness}; expected above 0 (mm)"));
    }
    if !(radius >= 0.0 && radius.is_finite()) {
        return Answer::refused(format!("radius is {radius}; expected 0 or more (mm)"));
    }
    let l = tissue.mean_free_path();
    if !l.is_finite() {
        return Answer::refused("nothing absorbs or scatters; expected sigma_a + (1-g) sigma_s above 0");
    }
    if form == Form::Images && thickness <= l {
        return Answer::refused(format!(
            "thickness is {thickness}; expected above one mean free path, {l:.4} mm, with the method images"
        ));
    }
    let t = tissue.transmittance(radius, thickness, form);
    if !t.is_finite() {
        return Answer::refused(format!("t has no finite value at thickness {thickness} and radius {radius}"));
    }
    match doubt(tissue, form, thickness, t) {
        None => Answer::ok(vec![t]),
        Some(why) => Answer { values: vec![t], status: Status::Undetermined(format!("t: {why}")) },
    }
}

/// Why a value that can be computed is not to be trusted.
fn doubt(tissue: &Tissue, form: Form, thickness: f64, t: f64) -> Option<String> {
    if let Some(why) = tissue.doubt() {
        return Some(why);
    }
    let l = tissue.mean_free_path();
    if form != Form::Thin && thickness <= l {
        return Some(format!(
            "diffusion does not hold at a thickness of at most one mean free path, {l:.4} mm; the method thin does"
        ));
    }
    if t < 0.0 {
        return Some("negative; the sum does not hold here".into());
    }
    if tissue.sigma_a > tissue.reduced_scattering() {
        return Some("diffusion does not hold where sigma_a exceeds (1-g) sigma_s".into());
    }
    if let Form::Dipoles(n) = form {
        // The sum is the one asked for; what it leaves out of all the light is what makes it wrong.
        let whole = tissue.total(thickness, Form::Images);
        let left_out = 1.0 - tissue.total(thickness, form) / whole;
        if whole > 0.0 && !(left_out.abs() <= PROMISE) {
            return Some(format!("{n} dipoles leave out {:.0} % of the light at this thickness", 100.0 * left_out));
        }
    }
    // Matched faces have an exact total to be held to.
    if tissue.a == 1.0 {
        let exact = slab::response(tissue.sigma_a, tissue.reduced_scattering(), thickness).rho_t;
        let off = tissue.total(thickness, form) / exact - 1.0;
        if exact > 0.0 && !(off.abs() <= PROMISE) {
            return Some(format!(
                "the form's total is {:+.0} % off the transport equation's at this thickness",
                100.0 * off
            ));
        }
    }
    None
}
