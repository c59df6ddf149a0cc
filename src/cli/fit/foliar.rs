//! `mesophyll fit foliar`: R and T at some wavelengths in, pigments and the epidermis's oblateness out.

use crate::named::named;
use crate::{Common, batch, tables};
use crate::{Error, Result};
use mesophyll_files::progress;
use mesophyll_files::table::{self, Answer, BatchIo, Spec, Table};
use mesophyll_fit::foliar::surface::{MOST_OBLATE, Setting};
use mesophyll_fit::foliar::{Known, Model, Parameter, Reading, pigments};
use mesophyll_optics::foliar::{Oblateness, Path, Side};
use std::path::PathBuf;

/// CSV columns `R450,T450,R550,…` (reflectance and transmittance by wavelength in nm) → the parameters asked for, their standard errors, `rms,minima,status`.
///
/// The model is the layered leaf of `eval abm`. The errors need the noise of the measurements, as in `fit slab`:
/// `--noise S`, or columns `R450_err`; `--noise 0` says that the input is exact.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("fit foliar"))]
pub struct Args {
    #[command(flatten)]
    io: BatchIo,
    /// Table of specific absorptions and refractive indices
    #[arg(long, value_name = "TABLE.csv")]
    pigments: PathBuf,
    /// Absolute standard error of R and T, where a cell has none of its own; 0 for exact values (default: not known, no
    /// errors are printed)
    #[arg(long, value_name = "S")]
    noise: Option<f64>,
    /// What is fitted; the rest is taken from columns of the same names, or is 0 (the oblateness: 5)
    #[arg(long = "fit", value_name = "NAME,…", value_delimiter = ',', value_parser = named::<Parameter>(), default_values_t = [Parameter::Chlorophyll, Parameter::Carotenoid, Parameter::Oblateness])]
    asked: Vec<Parameter>,
    /// How long a crossing of the mesophyll is: sieve (the public program's) or slant
    #[arg(long, value_parser = ["sieve", "slant"], default_value = "sieve")]
    path: String,
    /// Angle of the light from the normal, 0 to below 90
    #[arg(long, value_name = "DEGREES", default_value_t = 8.0)]
    incidence_deg: f64,
    /// Oblateness of the palisade's lobes, 0 to 12
    #[arg(long, value_name = "OB", default_value_t = Oblateness::USUAL.palisade)]
    oblateness_palisade: f64,
    /// Oblateness of the spongy tissue's lobes, 0 to 12
    #[arg(long, value_name = "OB", default_value_t = Oblateness::USUAL.spongy)]
    oblateness_spongy: f64,
}

/// A column of readings.
struct Column {
    name: String,
    wavelength: f64,
    through: bool,
    /// Where its name says so.
    abaxial: bool,
}

/// `R450`, `T550.5`, `R450_abaxial`.
fn column(name: &str) -> Option<Column> {
    let through = match name.as_bytes().first()? {
        b'R' => false,
        b'T' => true,
        _ => return None,
    };
    let rest = &name[1..];
    let (number, abaxial) = rest.strip_suffix("_abaxial").map_or((rest, false), |n| (n, true));
    let digits = number.starts_with(|c: char| c.is_ascii_digit());
    let wavelength = number.parse::<f64>().ok().filter(|w| digits && w.is_finite())?;
    Some(Column { name: name.to_string(), wavelength, through, abaxial })
}

const SUBSTANCES: [Parameter; 5] =
    [Parameter::Chlorophyll, Parameter::Carotenoid, Parameter::Protein, Parameter::CelluloseLignin, Parameter::Water];

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    if let Some(noise) = args.noise.filter(|n| !(*n >= 0.0 && n.is_finite())) {
        return Err(Error::Usage(format!("--noise is {noise}; expected a standard error of 0 or more")));
    }
    if !(0.0..90.0).contains(&args.incidence_deg) {
        return Err(Error::Usage(format!("--incidence-deg is {}; expected 0 to below 90", args.incidence_deg)));
    }
    for (name, x) in [("palisade", args.oblateness_palisade), ("spongy", args.oblateness_spongy)] {
        if !(0.0..=12.0).contains(&x) {
            return Err(Error::Usage(format!("--oblateness-{name} is {x}; expected 0 to 12")));
        }
    }
    if let Some((k, _)) = args.asked.iter().enumerate().find(|(k, p)| args.asked[..*k].contains(p)) {
        return Err(Error::Usage(format!("--fit names {} twice", args.asked[k])));
    }
    if args.asked.iter().all(|p| *p == Parameter::Thickness) {
        return Err(Error::Usage(
            "--fit names nothing that R and T tell; expected at least one content or oblateness".into(),
        ));
    }
    let spectrum = pigments::read(&args.pigments)?;
    let table = Table::open(&args.io.input)?;
    let columns: Vec<Column> = table.header.iter().filter_map(|name| column(name)).collect();
    if columns.is_empty() {
        let what = "no columns of readings; expected R and T with a wavelength in nm, such as R450, T450";
        return Err(Error::input(table.name(), what));
    }
    let setting = Setting {
        palisade: args.oblateness_palisade,
        spongy: args.oblateness_spongy,
        path: if args.path == "slant" { Path::Slant } else { Path::Sieve },
        incidence: args.incidence_deg.to_radians(),
    };
    // A light for each wavelength and side, so that R and T of one share what is computed of it.
    let mut lights: Vec<(f64, Side)> = Vec::new();
    for c in &columns {
        for side in [Side::Adaxial, Side::Abaxial] {
            if !lights.contains(&(c.wavelength, side)) {
                lights.push((c.wavelength, side));
            }
        }
    }
    let model = Model::new(&spectrum, &lights, setting, &args.asked, args.noise)
        .map_err(|what| Error::input(table.name(), what))?;
    let given: Vec<Parameter> =
        SUBSTANCES.into_iter().chain([Parameter::Oblateness]).filter(|p| !args.asked.contains(p)).collect();
    let names = columns.iter().map(|c| c.name.clone());
    let errors = columns.iter().map(|c| format!("{}_err", c.name));
    let spec = Spec {
        optional: names.chain(errors).chain(given.iter().map(|p| p.column().to_string())).collect(),
        outputs: model.outputs(),
        whole: vec!["minima".into()],
        texts: vec!["side".into()],
        ..Spec::default()
    };
    let stated = args.noise.is_some() || columns.iter().all(|c| table.column(&format!("{}_err", c.name)).is_some());
    let tally = table::run(table, &args.io.rows(common.json), &spec, |row, out| {
        let lit = match row.text(0).unwrap_or_default() {
            "" => Side::Adaxial,
            word => match word.parse() {
                Ok(side) => side,
                Err(_) => {
                    out.push(Answer::refused(format!("side is {word:?}; expected adaxial or abaxial")));
                    return;
                }
            },
        };
        let mut readings: Vec<Reading> = Vec::new();
        for (k, c) in columns.iter().enumerate() {
            let side = if c.abaxial { Side::Abaxial } else { lit };
            let light = lights.iter().position(|l| *l == (c.wavelength, side)).unwrap_or(0);
            let (value, err) = (row.get(k), row.get(columns.len() + k));
            if !value.is_nan() {
                readings.push(Reading { light, through: c.through, value, err });
            }
        }
        readings.sort_by_key(|r| r.light);
        let mut known = Known { contents: [0.0; 5], oblateness: Oblateness::USUAL.epidermis };
        for (k, p) in given.iter().enumerate() {
            let x = row.get(2 * columns.len() + k);
            if x.is_nan() {
                continue;
            }
            if !(x >= 0.0 && x.is_finite()) {
                out.push(Answer::refused(format!("{} is {x}; expected 0 or more", p.column())));
                return;
            }
            match SUBSTANCES.iter().position(|s| s == p) {
                Some(s) => known.contents[s] = x,
                None if x > MOST_OBLATE => {
                    out.push(Answer::refused(format!("{} is {x}; expected 0 to {MOST_OBLATE}", p.column())));
                    return;
                }
                None => known.oblateness = x,
            }
        }
        out.push(model.fit(&readings, &known));
    })?;
    batch::say_tally(&tally, &args.io, common, "leaf")?;
    if !stated {
        progress::say(
            "no noise is stated: the error cells are empty, and ok says only that the leaf could be fitted, not how sure \
             its numbers are; state the standard error of R and T by --noise S or by columns such as R450_err, or exact \
             input by --noise 0",
        );
    }
    Ok(0)
}
