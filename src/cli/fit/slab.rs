//! `mesophyll fit slab`: ρd, ρt and thickness in, σa and σs out.

use crate::cli::Common;
use crate::files::progress;
use crate::files::table::{self, BatchIo, Spec, Table, Tally};
use crate::fit::slab::{self, Options};
use crate::optics::slab::inverse::Precision;
use crate::{Error, Result};
use std::path::Path;

/// CSV columns `rho_d,rho_t,h` → `sigma_a,sigma_s,sigma_a_err,sigma_s_err,status` (1/mm).
///
/// Optional columns `rho_d_err,rho_t_err` are standard errors of a row's own. Where noise leaves a parameter open, the status names it,
/// with a bound at two standard errors where one side is closed.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    io: BatchIo,
    /// Absolute standard error of rho_d and rho_t
    #[arg(long, value_name = "S", default_value_t = 1e-6)]
    noise: f64,
    /// fast: better than 1e-6 where determined; exact: nine digits
    #[arg(long, value_enum, default_value_t = Method::Fast)]
    method: Method,
    /// Names of the input columns, as `rho_d=reflectance_550,rho_t=transmittance_550,h=thickness_mm`
    #[arg(long, value_name = "NAME=COLUMN,…", value_delimiter = ',')]
    columns: Vec<String>,
    /// Unit of the thickness column (default: what its name ends in, `_um`, `_mm` or `_m`, else mm)
    #[arg(long, value_enum)]
    thickness_unit: Option<Unit>,
    /// Reflectance of the surface itself (gloss), taken off rho_d before the fit
    #[arg(long, value_name = "R0", default_value_t = 0.0)]
    surface: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Method {
    Fast,
    Exact,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Unit {
    Mm,
    Um,
    M,
}

const INPUTS: [&str; 5] = ["rho_d", "rho_t", "h", "rho_d_err", "rho_t_err"];

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    if !(args.noise >= 0.0 && args.noise.is_finite()) {
        return Err(Error::Usage(format!("--noise is {}; expected a standard error of 0 or more", args.noise)));
    }
    if !(0.0..1.0).contains(&args.surface) {
        return Err(Error::Usage(format!("--surface is {}; expected a reflectance of 0 to below 1", args.surface)));
    }
    let names = column_names(&args.columns)?;
    let spec = Spec {
        required: names[..3].to_vec(),
        optional: names[3..].to_vec(),
        outputs: slab::OUTPUTS.iter().map(|s| s.to_string()).collect(),
        ..Spec::default()
    };
    let table = Table::open(&args.io.input)?;
    for (name, column) in INPUTS.iter().zip(&names).skip(3) {
        if name != column {
            table.require(column)?;
        }
    }
    let options = Options {
        precision: if args.method == Method::Exact { Precision::Exact } else { Precision::Fast },
        noise: args.noise,
        surface: args.surface,
    };
    let unit = match thickness_unit(&names[2], args.thickness_unit)? {
        Unit::Mm => 1.0,
        Unit::Um => 1e-3,
        Unit::M => 1e3,
    };
    let tally = table::run(table, &args.io.output, &spec, |row, out| {
        let e = slab::fit(&options, row.get(0), row.get(1), row.get(2) * unit, row.get(3), row.get(4));
        out.push(slab::answer(&e));
    })?;
    say_tally(&tally, &args.io, common)?;
    Ok(0)
}

/// One line on standard error; with `--json`, and the rows in a file, JSON on standard output.
pub fn say_tally(tally: &Tally, io: &BatchIo, common: &Common) -> Result<()> {
    let Tally { rows, ok, undetermined, refused } = *tally;
    progress::say(format!("{rows} rows: {ok} ok, {undetermined} undetermined, {refused} refused"));
    if common.json && io.output != Path::new("-") {
        crate::cli::print_json(&serde_json::json!({ "rows": rows, "ok": ok, "undetermined": undetermined, "refused": refused }))?;
    }
    Ok(())
}

/// The unit that is asked for or that the column's name ends in. A name that says another unit than was asked for, or one that is not
/// known here, is an error: micrometres read as millimetres would look like an answer.
fn thickness_unit(column: &str, asked: Option<Unit>) -> Result<Unit> {
    let suffix = column.rsplit_once(['_', ' ', '(', '[']).map_or("", |(_, end)| end.trim_end_matches([')', ']']));
    let named = match suffix {
        "mm" => Some(Unit::Mm),
        "um" | "µm" | "μm" | "micron" | "microns" => Some(Unit::Um),
        "m" => Some(Unit::M),
        "cm" | "dm" | "nm" | "km" | "in" | "inch" | "inches" | "mil" | "mils" | "ft" => {
            return Err(Error::Usage(format!("the thickness column {column:?} is in {suffix:?}; expected mm, um or m")));
        }
        _ => None,
    };
    match (named, asked) {
        (Some(named), Some(asked)) if named != asked => {
            Err(Error::Usage(format!("--thickness-unit says otherwise than the name of the thickness column, {column:?}")))
        }
        (named, asked) => Ok(asked.or(named).unwrap_or(Unit::Mm)),
    }
}

/// The input's column for each of [`INPUTS`].
fn column_names(mapping: &[String]) -> Result<Vec<String>> {
    let mut names: Vec<String> = INPUTS.iter().map(|s| s.to_string()).collect();
    for pair in mapping.iter().filter(|p| !p.is_empty()) {
        let Some((name, column)) = pair.split_once('=') else {
            return Err(Error::Usage(format!("--columns has {pair:?}; expected NAME=COLUMN with NAME one of {}", INPUTS.join(", "))));
        };
        let Some(k) = INPUTS.iter().position(|n| *n == name.trim()) else {
            return Err(Error::Usage(format!("--columns names {:?}; expected one of {}", name.trim(), INPUTS.join(", "))));
        };
        names[k] = column.trim().to_string();
    }
    for (k, name) in names.iter().enumerate() {
        if names[..k].contains(name) {
            return Err(Error::Usage(format!("--columns uses the column {name:?} twice")));
        }
    }
    Ok(names)
}
