//! `mesophyll fit slab`: ρd, ρt and thickness in, σa and σs out.

use super::spectra::{self, LEAF, Shares};
use crate::named::named;
use crate::{Common, batch, tables};
use crate::{Error, Result};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use mesophyll_files::table::{Answer, Batch, BatchIo, Physical, Spec, Table, counted};
use mesophyll_files::unit::Unit;
use mesophyll_files::{atomic, progress};
use mesophyll_fit::slab::{self, Measured, Options};
use mesophyll_optics::slab::inverse::Precision;
use mesophyll_report::spectrum::{self, Line, Panel};
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// CSV columns `rho_d,rho_t,h` → `sigma_a,sigma_s,sigma_a_err,sigma_s_err,status` (1/mm).
///
/// Spectra are read in long form, a row a wavelength (`leaf,wavelength_nm,R,T,thickness_mm`), and in wide form, a row a
/// leaf (`leaf,thickness_um,R450,T450,R550,…`); a wide row is answered by a row a wavelength.
///
/// The errors need the noise of the measurements: `--noise S`, or columns `rho_d_err,rho_t_err` for a row's own;
/// `--noise 0` says that the input is exact. Where no noise is stated the error cells are empty, and `ok` says only
/// that the slab could be inverted. Where noise leaves a parameter open, the status names it, with a bound at two
/// standard errors where one side is closed.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("fit slab"))]
pub struct Args {
    #[command(flatten)]
    io: BatchIo,
    /// Absolute standard error of rho_d and rho_t, where a row has none of its own; 0 for exact values (default: not
    /// known, no errors are printed)
    #[arg(long, value_name = "S")]
    noise: Option<f64>,
    /// fast: better than 1e-6 where determined; exact: nine digits
    #[arg(long, value_parser = named::<Precision>(), default_value_t = Precision::Fast)]
    method: Precision,
    /// Names of the input columns, as `rho_d=reflectance_550,rho_t=transmittance_550,h=thickness_mm`
    #[arg(long, value_name = "NAME=COLUMN,…", value_delimiter = ',')]
    columns: Vec<String>,
    /// Unit of the thickness column (default: what its name ends in, `_um`, `_mm` or `_m`; a column `h` is in mm)
    #[arg(long, value_parser = PossibleValuesParser::new(UNITS).try_map(|name| name.parse::<Unit>()))]
    thickness_unit: Option<Unit>,
    /// Reflectance of the surface itself (gloss), taken off rho_d before the fit: light that never entered the leaf,
    /// some 0.03 to 0.05 where the instrument kept the mirror reflection
    #[arg(long, value_name = "R0", default_value_t = 0.0)]
    surface: f64,
    /// Reflectances and transmittances, and their errors, are in per cent; --noise stays a share of 1
    #[arg(long)]
    percent: bool,
    /// Draw σa and σs over wavelength into this folder, a picture a leaf; the table needs a column `leaf` (or
    /// `leaf_id`) and wavelengths
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
}

/// Units of thicknesses.
const UNITS: [&str; 3] = ["um", "mm", "m"];

const WAVELENGTH: &str = "wavelength_nm";

/// One picture for each leaf, in order of first appearance. The rows may be in any order; each has its number, leaf,
/// wavelength and answer.
fn spectra(mut rows: Vec<(usize, String, f64, Vec<f64>)>) -> Vec<(String, Vec<Panel>)> {
    rows.sort_by_key(|r| r.0);
    let mut leaves: Vec<(String, Vec<(f64, Vec<f64>)>)> = Vec::new();
    let mut places = HashMap::new();
    for (_, leaf, wavelength, values) in rows {
        let place = *places.entry(leaf.clone()).or_insert_with(|| {
            leaves.push((leaf, Vec::new()));
            leaves.len() - 1
        });
        leaves[place].1.push((wavelength, values));
    }
    let panels = |(leaf, mut points): (String, Vec<(f64, Vec<f64>)>)| {
        points.retain(|p| p.0.is_finite());
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let panel = |k: usize, name: &str, word: &str| Panel {
            title: format!("{leaf}: {word}"),
            across: spectrum::WAVELENGTH.into(),
            axis: format!("{name} (1/mm)"),
            logarithmic: true,
            lines: vec![Line {
                name: name.into(),
                points: points.iter().map(|(w, v)| [*w, v[k], v[k + 2]]).collect(),
                dots: false,
            }],
        };
        let both = vec![panel(0, "σa", "absorption"), panel(1, "σs", "scattering")];
        (leaf, both)
    };
    leaves.into_iter().map(panels).collect()
}

const INPUTS: [&str; 5] = ["rho_d", "rho_t", "h", "rho_d_err", "rho_t_err"];

/// Other names in tables of spectra: where a table has no column of the first name, the next one is looked for.
const ALSO: [&[&str]; 5] =
    [&["R"], &["T"], &["thickness_mm", "thickness_um", "thickness_m", "thickness"], &["R_err"], &["T_err"]];

/// Range of a leaf's thickness (mm), with a margin at both ends. The same thicknesses in µm are numbers above this
/// range, and in m numbers below it. So a column that names no unit shows by its numbers whether it can be in mm.
const LEAVES_MM: [f64; 2] = [0.01, 10.0];

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    if let Some(noise) = args.noise.filter(|n| !(*n >= 0.0 && n.is_finite())) {
        return Err(Error::Usage(format!("--noise is {noise}; expected a standard error of 0 or more")));
    }
    if !(0.0..1.0).contains(&args.surface) {
        return Err(Error::Usage(format!("--surface is {}; expected a reflectance of 0 to below 1", args.surface)));
    }
    let table = spectra::open(&args.io.input)?;
    let mut names = column_names(&args.columns, &table)?;
    spectra::find(&table, &INPUTS, &mut names)?;
    let wide = if table.column(&names[0]).is_none() && args.columns.iter().all(|c| !c.starts_with("rho_")) {
        wavelengths(&table)?
    } else {
        Vec::new()
    };
    let leaf = LEAF.into_iter().find(|name| table.column(name).is_some()).unwrap_or(LEAF[0]);
    let (wavelength, unit_nm) = spectra::wavelength(&table)?.unwrap_or((WAVELENGTH.into(), 1.0));
    let mut spec = Spec {
        texts: vec![leaf.into()],
        outputs: slab::OUTPUTS.iter().map(|s| s.to_string()).collect(),
        ..Spec::default()
    };
    if wide.is_empty() {
        spec.required = names[..3].to_vec();
        spec.optional = names[3..].iter().cloned().chain(args.plots.iter().map(|_| wavelength.clone())).collect();
        for (name, column) in INPUTS.iter().zip(&names).skip(3) {
            if name != column {
                table.require(column)?;
            }
        }
    } else {
        spec.required = vec![names[2].clone()];
        spec.optional = wide.iter().flat_map(|(_, columns)| columns.clone()).collect();
        spec.dropped = spec.optional.clone();
        spec.readings = spec.optional.clone();
        spec.outputs.insert(0, WAVELENGTH.into());
        spec.whole.push(WAVELENGTH.into());
    }
    let of_wide = |range: std::ops::Range<usize>| wide.iter().flat_map(move |(_, c)| c[range.clone()].to_vec());
    let readings: Vec<String> = names[..2].iter().cloned().chain(of_wide(0..2)).collect();
    let errors = names[3..5].iter().cloned().chain(of_wide(2..4));
    spec.physical = vec![
        Physical::shares(readings.clone()),
        Physical::not_negative(errors.chain([names[2].clone(), wavelength.clone()]).collect()),
    ];
    let shares = Shares::of(&table, &readings, args.percent)?;
    if let Some(folder) = &args.plots {
        table.require(leaf)?;
        if wide.is_empty() {
            table.require(&wavelength)?;
        }
        atomic::probe_folder(folder)?;
    }
    let found: Mutex<Vec<(usize, String, f64, Vec<f64>)>> = Mutex::default();
    let options = Options { precision: args.method, noise: args.noise, surface: args.surface };
    let column = names[2].clone();
    let unit = thickness_unit(&column, args.thickness_unit)?;
    let scale = unit.unwrap_or(Unit::Millimetre).mm();
    // Where no column has errors, every row with an answer is without. A counter that all threads write costs time.
    let some_have_errors = if wide.is_empty() {
        names[3..].iter().any(|name| table.column(name).is_some())
    } else {
        wide.iter().any(|(_, columns)| columns[2..].iter().any(|name| table.column(name).is_some()))
    };
    let without_errors = AtomicUsize::new(0);
    let batch = Batch::open(table, &args.io.rows(common.json), &spec)?;
    let tally = batch.run(|row, out| {
        let thickness = row.get(if wide.is_empty() { 2 } else { 0 });
        if unit.is_none() && thickness > 0.0 && !(LEAVES_MM[0]..=LEAVES_MM[1]).contains(&thickness) {
            out.push(Answer::refused(not_in_mm(&column, thickness)));
            return;
        }
        let fitted = |wavelength: f64, cells: [f64; 4], columns: &[String]| {
            if let Some(why) = shares.refuse(columns.iter().map(String::as_str).zip(cells).take(2)) {
                return Answer::refused(why);
            }
            let [rho_d, rho_t, rho_d_err, rho_t_err] = cells.map(|v| v * shares.scale);
            let m = Measured { rho_d, rho_t, thickness_mm: thickness * scale, rho_d_err, rho_t_err };
            let answer = slab::answer(&options, &m);
            if some_have_errors && !m.noise_is_stated(&options) && !answer.values.is_empty() {
                without_errors.fetch_add(1, Ordering::Relaxed);
            }
            if args.plots.is_some() && !answer.values.is_empty() {
                let leaf = row.text(0).unwrap_or_default().to_string();
                let point = (row.number(), leaf, wavelength, answer.values.clone());
                found.lock().unwrap_or_else(PoisonError::into_inner).push(point);
            }
            answer
        };
        if wide.is_empty() {
            let wavelength = if args.plots.is_some() { unit_nm * row.get(5) } else { f64::NAN };
            out.push(fitted(wavelength, [0, 1, 3, 4].map(|k| row.get(k)), &names));
        }
        for (k, (wavelength, columns)) in wide.iter().enumerate() {
            let cells: [f64; 4] = std::array::from_fn(|c| row.get(1 + 4 * k + c));
            let bad = row.faults().find(|(place, _)| (1 + 4 * k..5 + 4 * k).contains(place));
            let Answer { mut values, status } = match (bad, cells[..2].iter().position(|v| v.is_nan())) {
                (Some((_, why)), _) => Answer::refused(why),
                (None, Some(empty)) => Answer::refused(format!("{} is empty", columns[empty])),
                (None, None) => fitted(*wavelength, cells, columns),
            };
            // A row without numbers still says which leaf and wavelength it belongs to.
            values.resize(slab::OUTPUTS.len(), f64::NAN);
            values.insert(0, *wavelength);
            out.push(Answer { values, status });
        }
    })?;
    batch::say_tally(&tally, &args.io, common, "row")?;
    if let Some(folder) = &args.plots {
        let leaves = spectra(found.into_inner().unwrap_or_else(PoisonError::into_inner));
        let files = spectrum::pictures(folder, &leaves)?;
        progress::say(format!("{} in {}", counted(files.len(), "picture"), folder.display()));
    }
    let without_errors = match args.noise {
        None if !some_have_errors => tally.ok + tally.undetermined,
        _ => without_errors.into_inner(),
    };
    if without_errors > 0 {
        progress::say(format!(
            "no noise is stated for {}: the error cells are empty, and ok says only that the slab could be inverted, \
             not how sure its numbers are; \
             state the standard error of rho_d and rho_t by --noise S or by columns rho_d_err and rho_t_err, or exact \
             input by --noise 0",
            counted(without_errors, "row")
        ));
    }
    Ok(0)
}

/// Why a thickness without a unit is not taken for mm, and how to make it readable.
fn not_in_mm(column: &str, thickness: f64) -> String {
    let [low, high] = LEAVES_MM;
    let hint = if (1e3 * low..=1e3 * high).contains(&thickness) {
        "; in um such numbers are usual: add --thickness-unit um"
    } else if (1e-3 * low..=1e-3 * high).contains(&thickness) {
        "; in m such numbers are usual: add --thickness-unit m"
    } else {
        "; add --thickness-unit"
    };
    format!(
        "{column} is {thickness} and names no unit; in mm this is outside the usual range of leaves, {low} to \
         {high}{hint} (or mm if the number is right)"
    )
}

/// The unit that is asked for, or that the column's name ends in; `None` where neither states one (a column `h` is in
/// mm). A name that states another unit than the one asked for, or an unknown one, is an error: micrometres read as
/// millimetres would look like an answer.
fn thickness_unit(column: &str, asked: Option<Unit>) -> Result<Option<Unit>> {
    let suffix = column.rsplit_once(['_', ' ', '(', '[']).map_or("", |(_, end)| end.trim_end_matches([')', ']']));
    let named = suffix.parse::<Unit>().ok();
    // Nobody measures leaves in these: such a name is more likely a mistake than a unit.
    if ["cm", "dm", "nm", "km", "in", "inch", "inches", "mil", "mils", "ft"].contains(&suffix) {
        return Err(Error::Usage(format!("the thickness column {column:?} is in {suffix:?}; expected mm, um or m")));
    }
    match (named, asked) {
        (Some(named), Some(asked)) if named != asked => Err(Error::Usage(format!(
            "--thickness-unit contradicts the unit in the name of the thickness column, {column:?}"
        ))),
        (None, None) if column == "h" => Ok(Some(Unit::Millimetre)),
        (named, asked) => Ok(asked.or(named)),
    }
}

/// The wavelengths of a table in wide form, ascending: those with a reflectance (`R550`) and a transmittance (`T550`),
/// with the columns of both and of their errors.
fn wavelengths(table: &Table) -> Result<Vec<(f64, [String; 4])>> {
    let found = spectra::wide(table);
    let columns: Vec<_> = found.readings.iter().filter(|c| !c.is_abaxial()).collect();
    let mut pairs: Vec<(f64, [String; 4])> = columns
        .iter()
        .filter(|r| !r.through)
        .filter_map(|r| {
            let t = columns.iter().find(|t| t.through && t.wavelength == r.wavelength)?;
            Some((r.wavelength, [r.name.clone(), t.name.clone(), r.error.clone(), t.error.clone()]))
        })
        .collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let one = columns.first().filter(|_| pairs.is_empty()).map(|c| if c.through { "T" } else { "R" });
    if let Some(one) = one {
        let what =
            format!("its columns hold {one} alone; expected R and T at the same wavelengths, such as R450 and T450");
        return Err(Error::input(table.name(), what));
    }
    if pairs.is_empty() && spectra::has_others(&found) {
        return Err(spectra::nothing(table, &found, "fit slab takes columns R450, T450 and so on, or R and T"));
    }
    Ok(pairs)
}

/// The input's column for each of [`INPUTS`].
fn column_names(mapping: &[String], table: &Table) -> Result<Vec<String>> {
    let usual = |(name, also): (&&str, &&[&str])| {
        let there = std::iter::once(name).chain(*also).find(|n| table.column(n).is_some());
        there.unwrap_or(name).to_string()
    };
    let mut names: Vec<String> = INPUTS.iter().zip(&ALSO).map(usual).collect();
    for pair in mapping.iter().filter(|p| !p.is_empty()) {
        let Some((name, column)) = pair.split_once('=') else {
            return Err(Error::Usage(format!(
                "--columns has {pair:?}; expected NAME=COLUMN with NAME one of {}",
                INPUTS.join(", ")
            )));
        };
        let Some(k) = INPUTS.iter().position(|n| *n == name.trim()) else {
            return Err(Error::Usage(format!(
                "--columns names {:?}; expected one of {}",
                name.trim(),
                INPUTS.join(", ")
            )));
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
