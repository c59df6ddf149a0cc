//! `mesophyll fit foliar`: R and T at some wavelengths in, pigments and the epidermis's oblateness out.

use crate::named::named;
use crate::{Common, batch, tables};
use crate::{Error, Result};
use mesophyll_files::progress;
use mesophyll_files::table::{self, Answer, BatchIo, GroupRow, Groups, Spec, Table, Tally, counted};
use mesophyll_fit::foliar::surface::{MOST_OBLATE, Setting};
use mesophyll_fit::foliar::{Known, Model, Parameter, Reading, pigments};
use mesophyll_optics::foliar::pigments::Spectrum;
use mesophyll_optics::foliar::{Oblateness, Path};
use mesophyll_optics::side::Side;
use mesophyll_report::spectrum::{self, Line, Panel};
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// CSV columns `R450,T450,R550,…` (reflectance and transmittance by wavelength in nm) → the parameters asked for, their
/// standard errors, `rms,minima,status`.
///
/// Or spectra in long form, a row a wavelength: `leaf,wavelength_nm,R,T` → a row a leaf.
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
    #[arg(long = "fit", value_name = "NAME,…", value_delimiter = ',', value_parser = named::<Parameter>(),
        default_values_t = [Parameter::Chlorophyll, Parameter::Carotenoid, Parameter::Oblateness])]
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
    /// Draw measured and computed R and T over wavelength into this folder, a picture a leaf; for spectra in long form
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
}

/// A column of readings.
pub struct Column {
    pub name: String,
    /// In nm.
    pub wavelength: f64,
    /// Of transmittance.
    pub through: bool,
    /// Where its name says so.
    pub abaxial: bool,
}

/// `R450`, `T550.5`, `R450_abaxial`.
pub fn column(name: &str) -> Option<Column> {
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
            "--fit names no parameter that R and T determine; expected at least one content or oblateness".into(),
        ));
    }
    let spectrum = pigments::read(&args.pigments)?;
    let table = Table::open(&args.io.input)?;
    let setting = Setting {
        palisade: args.oblateness_palisade,
        spongy: args.oblateness_spongy,
        path: if args.path == "slant" { Path::Slant } else { Path::Sieve },
        incidence: args.incidence_deg.to_radians(),
    };
    let given: Vec<Parameter> =
        SUBSTANCES.into_iter().chain([Parameter::Oblateness]).filter(|p| !args.asked.contains(p)).collect();
    let (tally, stated) = if table.column(WAVELENGTH).is_some() {
        long(args, common, table, &spectrum, setting, &given)?
    } else if args.plots.is_some() {
        return Err(Error::Usage(format!("--plots draws spectra in long form; expected a column {WAVELENGTH}")));
    } else {
        wide(args, common, table, &spectrum, setting, &given)?
    };
    batch::say_tally(&tally, &args.io, common, "leaf")?;
    if !stated {
        progress::say(
            "no noise is stated: the error cells are empty, and ok says only that the leaf could be fitted, not how \
             sure its numbers are; state the standard error of R and T by --noise S or by columns such as R450_err, \
             or exact input by --noise 0",
        );
    }
    Ok(0)
}

const WAVELENGTH: &str = "wavelength_nm";
/// Columns of readings in long form, then their errors.
const LONG: [&str; 4] = ["R", "T", "R_err", "T_err"];

/// The lit side that a cell names; the upper one where it names none.
fn side(word: Option<&str>) -> std::result::Result<Side, String> {
    match word.unwrap_or_default() {
        "" => Ok(Side::Front),
        word => Side::of_botanical(word).ok_or_else(|| format!("side is {word:?}; expected adaxial or abaxial")),
    }
}

/// What is known of a leaf, from the cells of the columns that are `given`.
fn known(given: &[Parameter], cells: &[f64]) -> std::result::Result<Known, String> {
    let mut known = Known { contents: [0.0; 5], oblateness: Oblateness::USUAL.epidermis };
    for (p, &x) in given.iter().zip(cells) {
        if x.is_nan() {
            continue;
        }
        if !(x >= 0.0 && x.is_finite()) {
            return Err(format!("{} is {x}; expected 0 or more", p.column()));
        }
        match SUBSTANCES.iter().position(|s| s == p) {
            Some(s) => known.contents[s] = x,
            None if x > MOST_OBLATE => return Err(format!("{} is {x}; expected 0 to {MOST_OBLATE}", p.column())),
            None => known.oblateness = x,
        }
    }
    Ok(known)
}

/// One row for each leaf, one column for each reading. Also returns whether the noise is stated.
fn wide(
    args: &Args,
    common: &Common,
    table: Table,
    spectrum: &Spectrum,
    setting: Setting,
    given: &[Parameter],
) -> Result<(Tally, bool)> {
    let columns: Vec<Column> = table.header.iter().filter_map(|name| column(name)).collect();
    if columns.is_empty() {
        let what = "no columns of readings; expected R and T with a wavelength in nm, such as R450, T450, or spectra \
                    in long form: leaf, wavelength_nm, R, T";
        return Err(Error::input(table.name(), what));
    }
    // One light for each wavelength and side, so that R and T of one light share what is computed.
    let mut lights: Vec<(f64, Side)> = Vec::new();
    for c in &columns {
        for side in [Side::Front, Side::Back] {
            if !lights.contains(&(c.wavelength, side)) {
                lights.push((c.wavelength, side));
            }
        }
    }
    let model = Model::new(spectrum, &lights, setting, &args.asked, args.noise)
        .map_err(|what| Error::input(table.name(), what))?;
    let names = columns.iter().map(|c| c.name.clone());
    let errors = columns.iter().map(|c| format!("{}_err", c.name));
    let spec = Spec {
        optional: names.chain(errors).chain(given.iter().map(|p| p.column().to_string())).collect(),
        outputs: model.outputs(),
        whole: vec!["minima".into()],
        texts: vec!["side".into()],
        ..Spec::default()
    };
    if table.column("side").is_none() && columns.iter().all(|c| !c.abaxial) {
        model.prepare(Side::Front);
    }
    let stated = args.noise.is_some() || columns.iter().all(|c| table.column(&format!("{}_err", c.name)).is_some());
    let tally = table::run(table, &args.io.rows(common.json), &spec, |row, out| {
        let answer = side(row.text(0)).and_then(|lit| {
            let mut readings: Vec<Reading> = Vec::new();
            for (k, c) in columns.iter().enumerate() {
                let side = if c.abaxial { Side::Back } else { lit };
                let light = lights.iter().position(|l| *l == (c.wavelength, side)).unwrap_or(0);
                let (value, err) = (row.get(k), row.get(columns.len() + k));
                if !value.is_nan() {
                    readings.push(Reading { light, through: c.through, value, err });
                }
            }
            readings.sort_by_key(|r| r.light);
            Ok(model.fit(&readings, &known(given, &row.all()[2 * columns.len()..])?))
        });
        out.push(answer.unwrap_or_else(Answer::refused));
    })?;
    Ok((tally, stated))
}

/// One row for each wavelength. Also returns whether the noise is stated.
fn long(
    args: &Args,
    common: &Common,
    table: Table,
    spectrum: &Spectrum,
    setting: Setting,
    given: &[Parameter],
) -> Result<(Tally, bool)> {
    let name = table.name().to_path_buf();
    if LONG[..2].iter().all(|c| table.column(c).is_none()) {
        return Err(Error::input(&name, "no columns of readings; expected R or T beside wavelength_nm"));
    }
    let measured = |of: &str| table.column(of).is_none() || table.column(&format!("{of}_err")).is_some();
    let stated = args.noise.is_some() || LONG[..2].iter().all(|of| measured(of));
    let mut spec = Spec {
        required: vec![WAVELENGTH.into()],
        optional: LONG.iter().map(|c| c.to_string()).chain(given.iter().map(|p| p.column().to_string())).collect(),
        whole: vec!["minima".into()],
        texts: vec!["side".into()],
        ..Spec::default()
    };
    let groups = Groups::read(table, &spec, "leaf")?;
    let light_of = |row: &GroupRow| side(row.texts[0].as_deref()).map(|side| (row.values[0], side));
    let key = |(wavelength, side): (f64, Side)| (wavelength.to_bits(), side == Side::Back);
    // Rows outside the range of the table of pigments cause their leaf to be refused below.
    let [low, high] = spectrum.range();
    let mut lights: Vec<(f64, Side)> =
        groups.rows().filter_map(|row| light_of(row).ok()).filter(|(w, _)| (low..=high).contains(w)).collect();
    lights.sort_by(|a, b| a.0.total_cmp(&b.0).then(key(*a).cmp(&key(*b))));
    lights.dedup();
    let places: HashMap<_, _> = lights.iter().enumerate().map(|(k, l)| (key(*l), k)).collect();
    let model =
        Model::new(spectrum, &lights, setting, &args.asked, args.noise).map_err(|what| Error::input(&name, what))?;
    for side in [Side::Front, Side::Back] {
        model.prepare(side);
    }
    spec.outputs = model.outputs();
    let drawn: Mutex<HashMap<String, Vec<Panel>>> = Mutex::default();
    let tally = groups.run(&args.io.rows(common.json), &spec, |leaf, rows, _| {
        let mut readings: Vec<Reading> = Vec::new();
        for row in rows {
            let light = match light_of(row) {
                Ok(light) => light,
                Err(why) => return Answer::refused(format!("line {}: {why}", row.line)),
            };
            let Some(&place) = places.get(&key(light)) else {
                return Answer::refused(format!(
                    "line {}: {WAVELENGTH} is {}; the table of pigments has {low} to {high}",
                    row.line, light.0
                ));
            };
            for (k, through) in [false, true].into_iter().enumerate() {
                let (value, err) = (row.values[1 + k], row.values[3 + k]);
                if !value.is_nan() {
                    readings.push(Reading { light: place, through, value, err });
                }
            }
        }
        readings.sort_by_key(|r| r.light);
        let known = match known(given, &rows[0].values[1 + LONG.len()..]) {
            Ok(known) => known,
            Err(why) => return Answer::refused(format!("line {}: {why}", rows[0].line)),
        };
        let answer = model.fit(&readings, &known);
        if args.plots.is_some() && !answer.values.is_empty() {
            let computed = model.computed(&readings, &known, &answer.values);
            let panels = [false, true].map(|through| panel(leaf, through, &readings, &computed, &lights));
            drawn.lock().unwrap_or_else(PoisonError::into_inner).insert(leaf.to_string(), panels.to_vec());
        }
        answer
    })?;
    if let Some(folder) = &args.plots {
        let mut drawn = drawn.into_inner().unwrap_or_else(PoisonError::into_inner);
        let leaves: Vec<_> = groups.names().filter_map(|name| drawn.remove_entry(name)).collect();
        let files = spectrum::pictures(folder, &leaves)?;
        progress::say(format!("{} in {}", counted(files.len(), "picture"), folder.display()));
    }
    Ok((tally, stated))
}

/// R or T over wavelength, as measured and as computed for the fitted leaf.
fn panel(leaf: &str, through: bool, readings: &[Reading], computed: &[f64], lights: &[(f64, Side)]) -> Panel {
    let word = if through { "transmittance" } else { "reflectance" };
    let of = |value: &dyn Fn(usize) -> [f64; 2]| -> Vec<[f64; 3]> {
        let shown = readings.iter().enumerate().filter(|(_, r)| r.through == through);
        shown.map(|(k, r)| [lights[r.light].0, value(k)[0], value(k)[1]]).collect()
    };
    let measured = of(&|k| [readings[k].value, readings[k].err]);
    let lines = vec![
        Line { name: "measured".into(), points: measured, dots: true },
        Line { name: "fitted".into(), points: of(&|k| [computed[k], f64::NAN]), dots: false },
    ];
    let across = spectrum::WAVELENGTH.into();
    Panel { title: format!("{leaf}: {word}"), across, axis: word.into(), logarithmic: false, lines }
}
