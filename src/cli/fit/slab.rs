//! `mesophyll fit slab`: ρd, ρt and thickness in, σa and σs out.

use super::slab_columns::{SlabColumns, column_names, wavelengths};
use super::slab_pictures::{self, PlottedRow};
use super::thickness::{LEAVES_MM, doubted, no_leaf, not_in_mm, thickness_unit};
use crate::cli::names::named;
use crate::cli::{CommonArgs, batch, tables};
use crate::cli::{Error, Result};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use mesophyll_files::spectra::{self, LEAF, ReadingUnit};
use mesophyll_files::table::{Batch, BatchIo, BatchSpec, InputRow, OutputRow, PhysicalRange, Status, counted};
use mesophyll_files::unit::LengthUnit;
use mesophyll_files::{atomic, progress};
use mesophyll_fits::slab::{self, Options, SlabMeasurement, SpecularPart};
use mesophyll_optics::slab::faces::{INDEX, INDEX_EXPECTED};
use mesophyll_optics::slab::inverse::{InversionPrecision, MORE_THAN_ALL, SlabModel};
use mesophyll_report::spectrum;
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
///
/// The slab scatters isotropically, so sigma_s is the reduced coefficient σs(1−g) of tissue that scatters forward. It
/// is taken at the index of its surroundings, so that its faces reflect nothing, unless `--index N` states its own.
///
/// One of rho_d and rho_t is enough where the other coefficient is known: a column `known_sigma_a` or `known_sigma_s`
/// (1/mm, with `known_sigma_a_err` or `known_sigma_s_err`).
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
    #[arg(long, value_parser = named::<InversionPrecision>(), default_value_t = InversionPrecision::Fast)]
    method: InversionPrecision,
    /// Names of the input columns, as `rho_d=reflectance_550,rho_t=transmittance_550,h=thickness_mm`
    #[arg(long, value_name = "NAME=COLUMN,…", value_delimiter = ',')]
    columns: Vec<String>,
    /// Unit of the thickness column (default: what its name ends in, `_um`, `_mm` or `_m`; a column `h` is in mm)
    #[arg(long, value_parser = PossibleValuesParser::new(UNITS).try_map(|name| name.parse::<LengthUnit>()))]
    thickness_unit: Option<LengthUnit>,
    /// Reflectance of the surface itself (gloss), taken off rho_d before the fit: light that never entered the leaf,
    /// some 0.03 to 0.05 where the instrument kept the mirror reflection
    #[arg(long, value_name = "R0", default_value_t = 0.0)]
    surface: f64,
    /// Reflectances and transmittances, and their errors, are in per cent; --noise stays a share of 1
    #[arg(long)]
    percent: bool,
    /// Refractive index of the slab, 1 to 3: its faces reflect light from outside and from inside, beyond the critical
    /// angle all of it, as inverse adding-doubling reckons it (1: the index of the surroundings, nothing is reflected)
    #[arg(long, value_name = "N", default_value_t = 1.0)]
    index: f64,
    /// With --index: whether rho_d has the mirror reflection of the faces. included: all that is reflected, as in an
    /// integrating sphere with its port closed; excluded: the mirror reflection left through an open port
    #[arg(long, value_parser = named::<SpecularPart>(), default_value_t = SpecularPart::Included)]
    specular: SpecularPart,
    /// Take thicknesses that no leaf has (below 0.01 mm or above 10 mm) and coefficients above 1000/mm for right: the
    /// slab is something else
    #[arg(long)]
    any_thickness: bool,
    /// Draw σa and σs over wavelength into this folder, a picture a leaf; the table needs a column `leaf` (or
    /// `leaf_id`) and wavelengths
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
}

/// Units of thicknesses.
const UNITS: [&str; 3] = ["um", "mm", "m"];

const WAVELENGTH: &str = "wavelength_nm";

/// Why the readings of an integrating sphere alone determine nothing.
const LOST_LIGHT: &str = "light that leaves the sample beside the sphere's ports is missing and looks like absorption; \
                          where it is small, give R and T as a table";

pub(super) const INPUTS: [&str; 9] = [
    "rho_d",
    "rho_t",
    "h",
    "rho_d_err",
    "rho_t_err",
    "known_sigma_a",
    "known_sigma_s",
    "known_sigma_a_err",
    "known_sigma_s_err",
];

/// Other names in tables of spectra: where a table has no column of the first name, the next one is looked for.
pub(super) const ALSO: [&[&str]; 9] = [
    &["R"],
    &["T"],
    &["thickness_mm", "thickness_um", "thickness_m", "thickness"],
    &["R_err"],
    &["T_err"],
    &[],
    &[],
    &[],
    &[],
];

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    super::check_noise(args.noise)?;
    if !(0.0..1.0).contains(&args.surface) {
        return Err(Error::Usage(format!("--surface is {}; expected a reflectance of 0 to below 1", args.surface)));
    }
    if !INDEX.contains(&args.index) {
        return Err(Error::argument("--index", args.index, INDEX_EXPECTED));
    }
    if args.index != 1.0 && args.surface != 0.0 {
        return Err(Error::Usage(
            "--surface and --index both account for what the surface reflects; expected one of them".into(),
        ));
    }
    if args.index == 1.0 && args.specular == SpecularPart::Excluded {
        return Err(Error::Usage("--specular excluded needs --index: at index 1 the faces reflect nothing".into()));
    }
    let table = spectra::open(&args.io.input)?;
    if let Some(stated) = table.stated() {
        stated.check_index(table.name(), args.index)?;
    }
    let loses_light = table.stated().is_some_and(|stated| stated.loses_light);
    let mut names = column_names(&args.columns, &table)?;
    spectra::find(&table, &INPUTS, &mut names)?;
    let some_known = names[5..7].iter().any(|name| table.column(name).is_some());
    if some_known && names[..2].iter().all(|name| table.column(name).is_none()) {
        return Err(Error::input(
            table.name(),
            "it has a known sigma, but neither rho_d nor rho_t; expected one of them, in a row for each wavelength",
        ));
    }
    let wide =
        if !some_known && table.column(&names[0]).is_none() && args.columns.iter().all(|c| !c.starts_with("rho_")) {
            wavelengths(&table, &names)?
        } else {
            Vec::new()
        };
    let is_wide = !wide.is_empty();
    let slabs = if is_wide { wide } else { vec![SlabColumns::new(names.clone(), None)] };
    let shares_are_there = is_wide || names[..2].iter().any(|name| table.column(name).is_some());
    if shares_are_there && table.column(&names[2]).is_none() && names[2] == INPUTS[2] {
        if let Some(stated) = table.stated() {
            return Err(Error::input(table.name(), stated.lacks(INPUTS[2])));
        }
        let what = "no such column; expected the thickness, h in mm or a column such as thickness_um; the header has";
        return Err(Error::field(table.name(), INPUTS[2], format!("{what} {}", table.shown_header())));
    }
    let leaf = LEAF.into_iter().find(|name| table.column(name).is_some()).unwrap_or(LEAF[0]);
    let (wavelength, unit_nm) = spectra::wavelength(&table)?.unwrap_or((WAVELENGTH.into(), 1.0));
    let mut spec = BatchSpec {
        texts: vec![leaf.into()],
        outputs: slab::OUTPUTS.iter().map(|s| s.to_string()).collect(),
        ..BatchSpec::default()
    };
    if !is_wide {
        // With one coefficient known, one of rho_d and rho_t is enough, in the whole table or in a row.
        for (value, error) in [(5, 7), (6, 8)] {
            if table.column(&names[error]).is_some() {
                table.require(&names[value])?;
            }
        }
        let (needed, rest) = if some_known { ([2, 0, 1], 1) } else { ([0, 1, 2], 3) };
        spec.required = needed[..rest].iter().map(|&k| names[k].clone()).collect();
        spec.optional = needed[rest..]
            .iter()
            .map(|&k| &names[k])
            .chain(&names[3..])
            .cloned()
            .chain(args.plots.iter().map(|_| wavelength.clone()))
            .collect();
        for (name, column) in INPUTS.iter().zip(&names).skip(3) {
            if name != column {
                table.require(column)?;
            }
        }
    } else {
        spec.required = vec![names[2].clone()];
        spec.optional = slabs.iter().flat_map(|slab| slab.readings().chain(slab.errors())).cloned().collect();
        spec.dropped = spec.optional.clone();
        spec.readings = spec.optional.clone();
        spec.outputs.insert(0, WAVELENGTH.into());
        spec.whole.push(WAVELENGTH.into());
    }
    let readings: Vec<String> = slabs.iter().flat_map(SlabColumns::readings).cloned().collect();
    let errors: Vec<String> = slabs.iter().flat_map(SlabColumns::errors).cloned().collect();
    // Where no column has errors, every row with an answer is without. A counter that all threads write costs time.
    let some_have_errors = errors.iter().any(|name| table.column(name).is_some());
    spec.physical = vec![
        PhysicalRange::shares(readings.clone()),
        PhysicalRange::not_negative([errors, vec![names[2].clone(), wavelength.clone()]].concat()),
    ];
    let shares = ReadingUnit::of(&table, &readings, args.percent)?;
    shares.check_noise(&table, &readings, args.noise)?;
    if let Some(folder) = &args.plots {
        table.require(leaf)?;
        if !is_wide {
            table.require(&wavelength)?;
        }
        atomic::probe_folder(folder)?;
    }
    let found: Mutex<Vec<PlottedRow>> = Mutex::default();
    let column = names[2].clone();
    let unit = thickness_unit(&column, args.thickness_unit)?;
    let scale = unit.unwrap_or(LengthUnit::Millimetre).mm();
    // A column `h` is a plain number in mm, of any slab; a column that names its unit is a leaf's.
    let leaf_like = !(args.any_thickness || column == "h" && args.thickness_unit.is_none());
    let slabs: Vec<SlabColumns> = slabs.into_iter().map(|slab| slab.within(&spec)).collect();
    let (at, thickness_at) = (spec.place(&wavelength), spec.place(&column).unwrap_or_default());
    let (without_errors, more_than_all) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let batch = Batch::open(table, &args.io.rows(common.json), &spec)?;
    say_assumptions(args);
    let reflecting = (args.index != 1.0).then(|| SlabModel::of_index(args.index));
    let model = reflecting.as_ref().unwrap_or(SlabModel::matched());
    let options =
        Options { precision: args.method, noise: args.noise, surface: args.surface, model, specular: args.specular };
    let answer = |slab: &SlabColumns, row: &InputRow| {
        let m = slab.read(row)?;
        let measured = slab.readings().map(String::as_str).zip([m.rho_d, m.rho_t]);
        if let (Some((empty, _)), None) = (measured.clone().find(|(_, v)| v.is_nan()), m.known) {
            let enough = if some_known { "; one of rho_d and rho_t is enough only beside a known sigma" } else { "" };
            return Err(format!("{empty} is empty{enough}"));
        }
        if let Some(why) = shares.refuse_each(measured) {
            return Err(why);
        }
        let thickness = m.thickness_mm;
        let [rho_d, rho_t, rho_d_err, rho_t_err] =
            [m.rho_d, m.rho_t, m.rho_d_err, m.rho_t_err].map(|v| v * shares.scale);
        let m = SlabMeasurement { rho_d, rho_t, rho_d_err, rho_t_err, thickness_mm: thickness * scale, ..m };
        let mut answer = slab::answer(&options, &m);
        if matches!(&answer.status, Status::Refused(why) if why.starts_with(MORE_THAN_ALL)) {
            more_than_all.fetch_add(1, Ordering::Relaxed);
        }
        if leaf_like && let Some(why) = no_leaf(&column, thickness, unit, &answer.values) {
            answer.status = doubted(answer.status, &why);
        } else if loses_light {
            answer.status = doubted(answer.status, LOST_LIGHT);
        }
        if some_have_errors && !m.noise_is_stated(&options) && !answer.values.is_empty() {
            without_errors.fetch_add(1, Ordering::Relaxed);
        }
        if args.plots.is_some() && !answer.values.is_empty() {
            let leaf = row.text(0).unwrap_or_default().to_string();
            let wavelength =
                slab.wavelength.or_else(|| Some(spectra::in_nm(row.get(at?), unit_nm))).unwrap_or(f64::NAN);
            let point = PlottedRow { number: row.number(), leaf, wavelength, values: answer.values.clone() };
            found.lock().unwrap_or_else(PoisonError::into_inner).push(point);
        }
        Ok(answer)
    };
    let tally = batch.run(|row, out| {
        let thickness = row.get(thickness_at);
        if unit.is_none() && thickness > 0.0 && !(LEAVES_MM[0]..=LEAVES_MM[1]).contains(&thickness) {
            out.push(OutputRow::refused(not_in_mm(&column, thickness)));
            return;
        }
        for slab in &slabs {
            let OutputRow { mut values, status } = answer(slab, row).unwrap_or_else(OutputRow::refused);
            if let Some(wavelength) = slab.wavelength {
                // A row without numbers still says which leaf and wavelength it belongs to.
                values.resize(slab::OUTPUTS.len(), f64::NAN);
                values.insert(0, wavelength);
            }
            out.push(OutputRow { values, status });
        }
    })?;
    batch::say_tally(&tally, &args.io, common, "row")?;
    if let rows @ 1.. = more_than_all.into_inner() {
        progress::say(format!(
            "{} {} more than all light: is the white reference less bright than it was taken for, or \
             were R and T measured at different places?",
            counted(rows, "row"),
            if rows == 1 { "reflects and transmits" } else { "reflect and transmit" }
        ));
    }
    if let Some(folder) = &args.plots {
        let leaves = slab_pictures::panels(found.into_inner().unwrap_or_else(PoisonError::into_inner));
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

/// Says what the table cannot show and the fit takes for granted.
fn say_assumptions(args: &Args) {
    let faces = if args.index == 1.0 {
        "the slab is taken at the index of its surroundings (1), so that its faces reflect nothing; --index N states \
         another"
            .to_string()
    } else {
        let specular = match args.specular {
            SpecularPart::Included => "with",
            SpecularPart::Excluded => "without",
        };
        format!(
            "the slab is taken at the index {} in air, and rho_d {specular} the mirror reflection of its faces",
            args.index
        )
    };
    progress::say(format!("{faces}; scattering is taken as isotropic: sigma_s is the reduced one, σs(1−g)"));
}
