//! `mesophyll fit foliar` where `--pigments` names coefficients of `fit coefficients`: the contents of real leaves.

use super::foliar::{Args, DrawnLeaves, asked_of, draw, impossible, noise_is_stated};
use super::foliar_plots::{self, PlottedReading};
use crate::cli::{CommonArgs, batch};
use crate::cli::{Error, Result};
use mesophyll_files::spectra::{self, ReadingUnit, SpectrumColumn};
use mesophyll_files::table::{Batch, GroupRow, InputTable, Omissions, OutputRow, PhysicalRange, RowTally, counted};
use mesophyll_files::{atomic, progress};
use mesophyll_fits::plates::leaf::PlateReading;
use mesophyll_fits::plates::reading::side;
use mesophyll_fits::plates::{PlateCoefficients, PlateFitModel, table};
use mesophyll_optics::side::Side;
use std::path::Path;
use std::sync::PoisonError;

const TAKES: &str = "fit foliar takes R and T with a wavelength in nm, such as R450, T450, or spectra in long form: \
                     leaf, wavelength_nm, R, T";

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    if let Some(option) = args.of_the_layers() {
        let file = args.pigments.display();
        return Err(Error::Usage(format!(
            "{option} is for the layered leaf, and {file} holds coefficients of another one, which states what is \
             fitted; leave {option} out"
        )));
    }
    let coefficients = table::read(&args.pigments)?;
    let input = spectra::open(&args.io.input)?;
    let (tally, stated) = match spectra::long(&input)? {
        Some(form) => long(args, common, input, &form, &coefficients)?,
        None => wide(args, common, input, &coefficients)?,
    };
    batch::say_tally(&tally, &args.io, common, "leaf")?;
    if !stated {
        progress::say(
            "no noise is stated: the errors hold only what the model is off by; state the standard error of R and T by \
             --noise S or by columns such as R450_err",
        );
    }
    Ok(0)
}

/// Why a leaf lit only from below cannot be answered.
const BELOW: &str = "a leaf lit from below, and none lit from above; the coefficients describe leaves lit from above, \
                     and a lower side only beside the upper one";

/// A model for the wavelengths of a table, and the wavelengths that it has.
fn model(args: &Args, coefficients: &PlateCoefficients, mut all: Vec<f64>) -> (PlateFitModel, Vec<f64>) {
    all.sort_by(f64::total_cmp);
    all.dedup();
    (PlateFitModel::new(coefficients, &all, args.noise.unwrap_or(0.0)), all)
}

/// Says how many readings are outside the coefficients.
///
/// # Errors
/// Where all are.
fn within(name: &Path, coefficients: &PlateCoefficients, all: &[f64]) -> Result<()> {
    let [low, high] = coefficients.range();
    let outside: Vec<&f64> = all.iter().filter(|w| !(low..=high).contains(*w)).collect();
    if outside.len() == all.len() {
        let first = all.first().map_or_else(String::new, f64::to_string);
        let what =
            format!("a reading is at {first} nm; the coefficients have {low} to {high} nm, and no reading is there");
        return Err(Error::input(name, what));
    }
    if !outside.is_empty() {
        let (file, count) = (name.display(), counted(outside.len(), "reading"));
        progress::say(format!("{file}: {count} outside {low} to {high} nm, the table of coefficients, left out"));
    }
    Ok(())
}

/// One leaf from its readings with their wavelengths, in any order, and the readings with what was computed.
fn answer(
    model: &PlateFitModel,
    wavelengths: &[f64],
    mut readings: Vec<(f64, PlateReading)>,
) -> (OutputRow, Vec<PlottedReading>) {
    if !readings.is_empty() && readings.iter().all(|(_, r)| r.below) {
        return (OutputRow::refused(format!("no reading can be used: {BELOW}")), Vec::new());
    }
    for (at, r) in &mut readings {
        r.light = wavelengths.partition_point(|w| *w < *at);
    }
    readings.sort_by_key(|(_, r)| (r.light, r.below, r.through));
    let (row, computed) = model.fit_with_spectra(&readings.iter().map(|(_, r)| *r).collect::<Vec<_>>());
    let of = |((wavelength, r), computed): (&(f64, PlateReading), f64)| PlottedReading {
        wavelength: *wavelength,
        below: r.below,
        through: r.through,
        value: r.value,
        err: r.err,
        computed,
    };
    let shown = readings.iter().zip(computed).map(of).collect();
    (row, shown)
}

/// One row for each leaf. Also returns whether the noise is stated.
fn wide(
    args: &Args,
    common: &CommonArgs,
    input: InputTable,
    coefficients: &PlateCoefficients,
) -> Result<(RowTally, bool)> {
    if args.plots.is_some() {
        return Err(Error::Usage("--plots draws spectra in long form; expected a column wavelength_nm".into()));
    }
    let found = spectra::wide(&input);
    if found.readings.is_empty() {
        return Err(spectra::nothing(&input, &found, TAKES));
    }
    within(input.name(), coefficients, &found.readings.iter().map(|c| c.wavelength).collect::<Vec<_>>())?;
    let [low, high] = coefficients.range();
    let inside = |c: &SpectrumColumn| (low..=high).contains(&c.wavelength);
    let columns: Vec<SpectrumColumn> = found.readings.into_iter().filter(inside).collect();
    let (model, wavelengths) = model(args, coefficients, columns.iter().map(|c| c.wavelength).collect());
    let names: Vec<String> = columns.iter().map(|c| c.name.clone()).collect();
    let shares = ReadingUnit::of(&input, &names, args.percent)?;
    shares.check_noise(&input, &names, args.noise)?;
    let spec = asked_of(&columns, &[], PlateFitModel::outputs());
    let stated = noise_is_stated(args, &input, &columns);
    let name = input.name().to_path_buf();
    let batch = Batch::open(input, &args.io.rows(common.json), &spec)?;
    let (n, left) = (columns.len(), Omissions::default());
    let tally = batch.run(|row, out| {
        if let Some(why) = shares.refuse(names.iter().map(String::as_str).zip(row.all().iter().copied())) {
            return out.push(OutputRow::refused(why));
        }
        let lit = match side(row.text(0)) {
            Ok(lit) => lit,
            Err(why) => return out.push(OutputRow::refused(why)),
        };
        let mut bad: Vec<String> = row.faults().map(|(_, why)| why.to_string()).collect();
        let mut readings = Vec::new();
        for (k, c) in columns.iter().enumerate() {
            let (value, err) = (shares.scale * row.get(k), shares.scale * row.get(n + k));
            if value.is_nan() || row.faults().any(|(place, _)| place == n + k) {
                continue;
            }
            let below = c.side.unwrap_or(lit) == Side::Back;
            match impossible(c, value) {
                Some(why) => bad.push(why),
                None => readings.push((c.wavelength, PlateReading { light: 0, below, through: c.through, value, err })),
            }
        }
        if let (true, Some(why)) = (readings.is_empty(), bad.first()) {
            return out.push(OutputRow::refused(format!("no reading can be used: {why}")));
        }
        bad.into_iter().for_each(|why| left.add(row.line(), why));
        out.push(answer(&model, &wavelengths, readings).0);
    })?;
    left.say(&name);
    Ok((tally, stated))
}

/// One row for each wavelength. Also returns whether the noise is stated.
fn long(
    args: &Args,
    common: &CommonArgs,
    input: InputTable,
    form: &spectra::LongSpectra,
    coefficients: &PlateCoefficients,
) -> Result<(RowTally, bool)> {
    let (columns, name) = (&form.readings, input.name().to_path_buf());
    if columns.is_empty() {
        let what = format!("no columns of readings; expected R or T beside {}", form.wavelength);
        return Err(Error::input(&name, what));
    }
    let names: Vec<String> = columns.iter().map(|c| c.name.clone()).collect();
    let shares = ReadingUnit::of(&input, &names, args.percent)?;
    shares.check_noise(&input, &names, args.noise)?;
    let stated = noise_is_stated(args, &input, columns);
    let mut spec = asked_of(columns, &[], PlateFitModel::outputs());
    spec.required = vec![form.wavelength.clone()];
    spec.physical.push(PhysicalRange::not_negative(spec.required.clone()));
    let groups = spectra::leaves(input, &spec)?;
    let sink = groups.open(&args.io.rows(common.json))?;
    let at = |row: &GroupRow| spectra::in_nm(row.values[0], form.unit_nm);
    let [low, high] = coefficients.range();
    let mut all: Vec<f64> = groups.rows().map(at).collect();
    within(&name, coefficients, &all)?;
    all.retain(|w| (low..=high).contains(w));
    let (model, wavelengths) = model(args, coefficients, all);
    if let Some(folder) = &args.plots {
        atomic::probe_folder(folder)?;
    }
    let n = columns.len();
    let drawn = DrawnLeaves::default();
    let tally = groups.run_into(sink, &spec, |leaf, rows, left| {
        let (mut readings, mut bad): (Vec<(f64, PlateReading)>, Option<String>) = Default::default();
        for row in rows {
            let lit = match side(row.texts[0].as_deref()) {
                Ok(lit) => lit,
                Err(why) => {
                    bad.get_or_insert(why);
                    continue;
                }
            };
            for (k, c) in columns.iter().enumerate() {
                let (value, err) = (shares.scale * row.values[1 + k], shares.scale * row.values[1 + n + k]);
                if value.is_nan() || !(low..=high).contains(&at(row)) {
                    continue;
                }
                let below = c.side.unwrap_or(lit) == Side::Back;
                match impossible(c, value) {
                    Some(why) => {
                        left.add(row.line, why.clone());
                        bad.get_or_insert(why);
                    }
                    None => readings.push((at(row), PlateReading { light: 0, below, through: c.through, value, err })),
                }
            }
        }
        if let Some(why) = shares.refuse(readings.iter().map(|(_, r)| ("R or T", r.value))) {
            return OutputRow::refused(why);
        }
        match bad.filter(|_| readings.is_empty()) {
            Some(why) => OutputRow::refused(format!("no reading can be used: {why}")),
            None => {
                let (row, shown) = answer(&model, &wavelengths, readings);
                if args.plots.is_some() && !shown.is_empty() {
                    let panels = foliar_plots::panels(leaf, &shown);
                    drawn.lock().unwrap_or_else(PoisonError::into_inner).insert(leaf.to_string(), panels);
                }
                row
            }
        }
    })?;
    draw(args, groups.names(), drawn)?;
    Ok((tally, stated))
}
