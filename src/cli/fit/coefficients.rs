//! `mesophyll fit coefficients`: spectra of leaves with measured contents in, specific absorptions and indices out.

use super::foliar::side;
use crate::cli::{CommonArgs, tables};
use crate::cli::{Error, Result};
use mesophyll_files::spectra::{self, ReadingUnit, SpectrumColumn};
use mesophyll_files::table::{InputTable, Omissions, TableRecord, counted};
use mesophyll_files::{atomic, claim, progress};
use mesophyll_fits::plates::training::{self, PlateExample, PlateTraining};
use mesophyll_fits::plates::{CONTENTS, calibration, table};
use mesophyll_optics::side::Side;
use std::io::Write;
use std::path::{Path, PathBuf};

/// CSV columns `leaf,species,R400,T400,…` with `measured_chlorophyll_ug_cm2`, `measured_carotenoid_ug_cm2`,
/// `measured_water_g_cm2` and `measured_dry_g_cm2` → a table of coefficients, a row a wavelength, for
/// `fit foliar --pigments`.
///
/// The leaf is a stack of plates, described by seven numbers. Each species is left out once, to learn what the model is
/// off by in leaves that it has not seen.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("fit coefficients"))]
pub struct Args {
    /// CSV to read (`-`: standard input)
    #[arg(long = "in", value_name = "FILE", default_value = "-")]
    input: PathBuf,
    /// CSV to write (`-`: standard output); written whole or not at all
    #[arg(short = 'o', long = "out", alias = "output", value_name = "FILE", default_value = "-")]
    output: PathBuf,
    /// R and T are in per cent
    #[arg(long)]
    percent: bool,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    claim::file(&args.output, &["csv"], &[&args.input])?;
    let table = spectra::open(&args.input)?;
    let file = (args.output != Path::new("-")).then(|| atomic::PendingFile::create(&args.output)).transpose()?;
    let name = table.name().to_path_buf();
    let training = read(table, args.percent)?;
    if let Some(why) = training::refusal(&training) {
        return Err(Error::input(&name, why));
    }
    let trained = training::train(&training)?;
    let text = table::write(&trained.coefficients);
    match file {
        None => crate::cli::print(&String::from_utf8_lossy(&text))?,
        Some(mut file) => {
            file.write_all(&text).map_err(|e| Error::write(&args.output, atomic::explain(&e)))?;
            file.finish()?;
        }
    }
    progress::say(calibration::words(&trained.coefficients));
    for said in trained.uncarried.iter().chain(&trained.suspects) {
        progress::say(format!("{}: {said}", name.display()));
    }
    if common.json && args.output != Path::new("-") {
        let population = trained.coefficients.population;
        crate::cli::print_json(&serde_json::json!({
            "leaves": population.counts[0], "species": population.counts[1], "rms": population.rms,
            "uncarried": trained.uncarried, "suspects": trained.suspects,
        }))?;
    }
    Ok(0)
}

/// The columns of R and of T at each wavelength, ascending.
fn pairs(name: &Path, columns: &[SpectrumColumn]) -> Result<Vec<(f64, [Option<usize>; 2])>> {
    let mut pairs: Vec<(f64, [Option<usize>; 2])> = Vec::new();
    for (k, c) in columns.iter().enumerate().filter(|(_, c)| !c.is_abaxial()) {
        let at = match pairs.iter().position(|p| p.0 == c.wavelength) {
            Some(at) => at,
            None => {
                pairs.push((c.wavelength, [None; 2]));
                pairs.len() - 1
            }
        };
        let slot = &mut pairs[at].1[usize::from(c.through)];
        if let Some(other) = slot.replace(k) {
            let what = format!("{} holds the same quantity; rename or remove one of the two", columns[other].name);
            return Err(Error::field(name, &c.name, what));
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(pairs)
}

/// Reads a table of leaves.
fn read(mut table: InputTable, percent: bool) -> Result<PlateTraining> {
    let name = table.name().to_path_buf();
    const TAKES: &str = "fit coefficients takes a row a leaf, with R and T by wavelength in nm, such as R450, T450";
    if let Some(long) = spectra::long(&table)? {
        let what = format!("a column of wavelengths, so a row is no leaf; {TAKES}");
        return Err(Error::field(&name, &long.wavelength, what));
    }
    let found = spectra::wide(&table);
    let columns = found.readings.clone();
    let pairs = pairs(&name, &columns)?;
    if pairs.is_empty() {
        return Err(spectra::nothing(&table, &found, TAKES));
    }
    let below = columns.iter().filter(|c| c.is_abaxial()).count();
    if below > 0 {
        progress::say(format!("{}: {} of lower sides left out", name.display(), counted(below, "column")));
    }
    if !pairs.iter().any(|p| p.1[0].is_some()) || !pairs.iter().any(|p| p.1[1].is_some()) {
        return Err(Error::input(&name, "it has only one of reflectance and transmittance; training needs both"));
    }
    let species = table.column("species");
    if species.is_none() {
        progress::say(format!(
            "{}: no column species, so each leaf counts as a species of its own, and neighbouring rows are left out \
             together; where leaves of one plant stand apart, the errors are too small",
            name.display()
        ));
    }
    let measured = (0..4).map(|k| table.require(&table::measured(k))).collect::<Result<Vec<_>>>()?;
    let names: Vec<String> = columns.iter().map(|c| c.name.clone()).collect();
    let shares = ReadingUnit::of(&table, &names, percent)?;
    let places = names.iter().map(|n| table.require(n)).collect::<Result<Vec<_>>>()?;
    let lit = table.column("side");
    let leaf = spectra::LEAF.into_iter().find_map(|n| table.column(n));
    let wavelengths = pairs.iter().map(|p| p.0).collect();
    let mut out = PlateTraining { wavelengths, without_species: species.is_none(), ..PlateTraining::default() };
    let (left, mut record) = (Omissions::default(), TableRecord::default());
    while table.next_record(&mut record)? {
        let line = record.line();
        if let Some(fault) = record.fault(table.header.len()) {
            left.add(line, fault);
            continue;
        }
        match lit.map_or(Ok(Side::Front), |place| side(Some(record.shown(place).trim()))) {
            Ok(Side::Front) => {}
            Ok(Side::Back) => {
                left.add(line, "a leaf lit from below; coefficients describe leaves lit from above");
                continue;
            }
            Err(why) => {
                left.add(line, why);
                continue;
            }
        }
        let number = |place: usize| -> std::result::Result<f64, String> {
            table.number(&record, place).map(|x| x.unwrap_or(f64::NAN))
        };
        let mut spectra = vec![[f64::NAN; 2]; pairs.len()];
        let mut count = 0;
        for (pair, (_, of)) in spectra.iter_mut().zip(&pairs) {
            for (value, column) in pair.iter_mut().zip(of) {
                let Some(column) = *column else { continue };
                match number(places[column]).map(|x| (x, shares.scale * x)) {
                    Ok((x, _)) if x.is_nan() => {}
                    Ok((_, x)) if (-0.1..=1.1).contains(&x) => {
                        *value = x;
                        count += 1;
                    }
                    Ok((x, _)) => {
                        let reading = (columns[column].name.as_str(), x);
                        let why = shares.refuse_each([reading].into_iter());
                        left.add(line, why.unwrap_or_else(|| format!("{} is {x}; expected 0 to 1", reading.0)));
                    }
                    Err(why) => left.add(line, why),
                }
            }
        }
        let mut contents = [f64::NAN; 4];
        for (k, (content, place)) in contents.iter_mut().zip(&measured).enumerate() {
            match number(*place) {
                Ok(x) if x.is_nan() || x >= 0.0 && x.is_finite() => *content = x,
                Ok(x) => left.add(line, format!("measured_{} is {x}; expected 0 or more", CONTENTS[k])),
                Err(why) => left.add(line, why),
            }
        }
        let shown = leaf.map(|k| record.shown(k).trim().to_string()).filter(|name| !name.is_empty());
        let shown = shown.unwrap_or_else(|| format!("line {line}"));
        let kind = species.map_or_else(|| format!("line {line}"), |k| record.shown(k).trim().to_string());
        if kind.is_empty() {
            left.add(line, "species is empty");
            continue;
        }
        if count < training::FEWEST_WAVELENGTHS {
            let fewest = training::FEWEST_WAVELENGTHS;
            left.add(line, format!("it has {}, expected at least {fewest}", counted(count, "reading")));
            continue;
        }
        let place = out.species.iter().position(|s| *s == kind).unwrap_or_else(|| {
            out.species.push(kind);
            out.species.len() - 1
        });
        out.examples.push(PlateExample { name: shown, species: place, spectra, measured: contents });
    }
    if shares.refuses_all() {
        let why = mesophyll_files::table::percent::SENTENCE;
        return Err(Error::input(&name, format!("its readings are above 1: {why}")));
    }
    left.say(&name);
    Ok(out)
}
