//! `mesophyll design slab`: which of the three measurements of a slab to repeat or to make better.

use super::positive;
use crate::cli::{CommonArgs, Result, batch, tables};
use mesophyll_files::progress::say;
use mesophyll_files::table::{self, BatchIo, BatchSpec, InputTable, OutputRow};
use mesophyll_optics::slab::inverse;
use std::sync::atomic::{AtomicUsize, Ordering};

/// CSV columns `rho_d,rho_t,h` (h in mm, each optionally with `_err`) → the relative standard errors of σa and σs, and
/// what they would be if the standard error of ρd, of ρt, or of the thickness were half as large.
///
/// A reading repeated four times has half its error. Each wavelength is inverted by itself, so bands do not help one
/// another; the thickness is common to all of them.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("design slab"))]
pub struct Args {
    #[command(flatten)]
    io: BatchIo,
    /// Standard error of rho_d and rho_t where a row has none of its own
    #[arg(long, value_name = "S", default_value_t = 0.005)]
    noise: f64,
    /// Standard error of the thickness (mm) where a row has none of its own
    #[arg(long, value_name = "MM", default_value_t = 0.01)]
    thickness_noise: f64,
}

/// What can be measured better.
const MEASURED: [&str; 3] = ["rho_d", "rho_t", "h"];

/// Relative errors of σa and σs of a slab whose three readings have these standard errors.
fn errors([r, t, h]: [f64; 3], [r_err, t_err, h_err]: [f64; 3]) -> [f64; 2] {
    let found = inverse::invert(r, t, h, r_err, t_err);
    let share = h_err / h;
    [found.sigma_a_err / found.sigma_a, found.sigma_s_err / found.sigma_s].map(|own| own.hypot(share))
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let (noise, thickness) = (positive("--noise", args.noise)?, positive("--thickness-noise", args.thickness_noise)?);
    let both = |prefix: &str| [format!("sigma_a_{prefix}"), format!("sigma_s_{prefix}")];
    let halved = MEASURED.iter().flat_map(|name| both(&format!("share_if_{name}_halved")));
    let spec = BatchSpec {
        required: MEASURED.map(String::from).into(),
        optional: MEASURED.map(|name| format!("{name}_err")).into(),
        outputs: both("share").into_iter().chain(halved).collect(),
        ..BatchSpec::default()
    };
    let best: [AtomicUsize; 3] = Default::default();
    let tally = table::run(InputTable::open(&args.io.input)?, &args.io.rows(common.json), &spec, |row, out| {
        let measured = [0, 1, 2].map(|k: usize| row.get(k));
        let usual = [noise, noise, thickness];
        let errs: [f64; 3] = std::array::from_fn(|k| if row.get(3 + k).is_nan() { usual[k] } else { row.get(3 + k) });
        if errs.iter().any(|e| *e < 0.0) || measured[2] <= 0.0 {
            return out.push(OutputRow::refused("a standard error below 0 or a thickness of 0 or less"));
        }
        let found = inverse::invert(measured[0], measured[1], measured[2], errs[0], errs[1]);
        let now = errors(measured, errs);
        let with = |k: usize| {
            let mut better = errs;
            better[k] *= 0.5;
            errors(measured, better)
        };
        let then = [0, 1, 2].map(with);
        let worst = |e: &[f64; 2]| e[0].max(e[1]);
        if let Some(k) = (0..3).min_by(|a, b| worst(&then[*a]).total_cmp(&worst(&then[*b])))
            && worst(&now).is_finite()
        {
            best[k].fetch_add(1, Ordering::Relaxed);
        }
        out.push(OutputRow { values: now.into_iter().chain(then.concat()).collect(), status: found.status });
    })?;
    let counts = best.map(AtomicUsize::into_inner);
    if let Some(k) = (0..3).max_by_key(|k| counts[*k]).filter(|k| counts[*k] > 0) {
        say(format!(
            "measuring {} better helps the worse of sigma_a and sigma_s most in {} of {} rows",
            MEASURED[k],
            counts[k],
            counts.iter().sum::<usize>()
        ));
    }
    batch::say_tally(&tally, &args.io, common, "row")?;
    Ok(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The thickness moves both coefficients by its own share, and a noise of nearly 0 leaves only that.
    #[test]
    fn the_thickness_counts_by_its_share() {
        let [a, s] = errors([0.1, 0.05, 0.2], [1e-9, 1e-9, 0.02]);
        assert!((a - 0.1).abs() < 1e-6 && (s - 0.1).abs() < 1e-6, "{a} {s}");
        let better = errors([0.1, 0.05, 0.2], [0.005, 0.005, 0.01]);
        let worse = errors([0.1, 0.05, 0.2], [0.005, 0.005, 0.02]);
        assert!(better[0] < worse[0] && better[1] < worse[1]);
    }
}
