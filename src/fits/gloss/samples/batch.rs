//! `fit gloss --samples`: reads goniometer tables and writes one row for each leaf.

use super::columns::Columns;
use super::verdict::{self, Suspicion};
use super::{GlossFitSettings, GlossSample, GlossSampleFit, LobeChoice, MeasuredGloss, fit};
use crate::Result;
use mesophyll_files::progress;
use mesophyll_files::table::{
    BatchSpec, GroupRow, Groups, InputTable, OutputRow, PhysicalRange, RowTally, TableOutput,
};
use mesophyll_optics::gloss::LobeKind;
use std::collections::BTreeMap;
use std::sync::Mutex;
use strum::IntoEnumIterator;

/// Leaves that are spoken of on standard error; of more, only the number.
const SPOKEN: usize = 30;
/// Readings outside are marks of a missing one; they may be in per cent and of a mirror.
const POSSIBLE: [f64; 2] = [-0.9, 1e4];

/// `fit gloss --samples`: reads all rows, groups them by `leaf`, and writes one row for each leaf in the order in which
/// leaves first appear. What was left out of a leaf, and which lobe was chosen by how much, is said on standard error.
///
/// # Errors
/// A missing column, one that says something of the directions and is not understood, an unreadable input, an
/// unwritable output.
pub fn run(
    table: InputTable,
    output: &TableOutput,
    values: &[String],
    settings: &GlossFitSettings,
) -> Result<RowTally> {
    let columns = Columns::of(&table, values)?;
    let spec = asked(&columns, settings);
    let chosen: Mutex<BTreeMap<String, String>> = Mutex::default();
    let groups = Groups::read(table, &spec, "leaf")?;
    let tally = groups.run(output, &spec, |name, rows, left| {
        let mut samples = Vec::new();
        let mut worst = None;
        for row in rows {
            match columns.sample(&row.values, settings) {
                Ok((sample, readings)) => {
                    samples.push(sample);
                    readings.into_iter().for_each(|why| left.add(row.line, why));
                }
                Err(why) => {
                    worst = worst.or_else(|| Some(format!("line {}: {why}", row.line)));
                    left.add(row.line, why);
                }
            }
        }
        if samples.is_empty() {
            return OutputRow::refused(worst.unwrap_or_else(|| "no readings".into()));
        }
        let (answer, lobe) = answered(&samples, &columns.values, settings);
        if let (Some(lobe), Ok(mut chosen)) = (lobe, chosen.lock()) {
            chosen.insert(name.to_string(), lobe);
        }
        answer
    })?;
    let chosen = chosen.into_inner().unwrap_or_default();
    for name in groups.names().filter(|name| chosen.contains_key(*name)).take(SPOKEN) {
        progress::say(format!("leaf {name}: {}", chosen[name]));
    }
    if chosen.len() > SPOKEN {
        progress::say(format!("and {} more leaves", chosen.len() - SPOKEN));
    }
    Ok(tally)
}

/// What is read of a goniometer table, and what is answered.
fn asked(columns: &Columns, settings: &GlossFitSettings) -> BatchSpec {
    BatchSpec {
        required: columns.required(),
        optional: columns.values.clone(),
        outputs: outputs(&columns.values, settings),
        readings: columns.values.clone(),
        physical: vec![
            PhysicalRange { columns: columns.values.clone(), range: POSSIBLE },
            PhysicalRange::degrees(columns.required()),
        ],
        ..BatchSpec::default()
    }
}

/// The leaves of a goniometer table with their readings, in the order in which they first appear. Rows that cannot be
/// used are left out.
///
/// # Errors
/// Those of [`run`] that concern the input.
pub fn leaves(table: InputTable, values: &[String], settings: &GlossFitSettings) -> Result<Vec<MeasuredGloss>> {
    let columns = Columns::of(&table, values)?;
    let groups = Groups::read(table, &asked(&columns, settings), "leaf")?;
    let of = |(name, rows): (&str, &[GroupRow])| MeasuredGloss {
        name: name.into(),
        samples: rows.iter().filter_map(|row| Some(columns.sample(&row.values, settings).ok()?.0)).collect(),
    };
    Ok(groups.each().map(of).collect())
}

/// Output columns of [`answer`] for value columns of these names.
pub fn outputs(values: &[String], settings: &GlossFitSettings) -> Vec<String> {
    let each = |suffix: &str| values.iter().map(|v| format!("rho_d_{v}{suffix}")).collect::<Vec<_>>();
    let mut outputs = each("");
    outputs.extend(["rho_s", "m", "tilt", "tilt_y", "rms"].map(String::from));
    outputs.extend(each("_err"));
    outputs.extend(["rho_s_err", "m_err", "tilt_err", "tilt_y_err"].map(String::from));
    if settings.index.is_none() {
        outputs.extend(["index", "index_err"].map(String::from));
    }
    if settings.surface == LobeChoice::Auto {
        outputs.extend(LobeKind::iter().map(|kind| format!("evidence_{}", kind.to_string().replace('-', "_"))));
    }
    outputs
}

/// Fits one leaf and says what was found as the row of a batch; `values` are the names of the value columns.
pub fn answer(samples: &[GlossSample], values: &[String], settings: &GlossFitSettings) -> OutputRow {
    answered(samples, values, settings).0
}

/// The row, and which lobe was chosen by how much where it was not stated.
fn answered(samples: &[GlossSample], values: &[String], settings: &GlossFitSettings) -> (OutputRow, Option<String>) {
    let found = match fit(samples, settings) {
        Ok(found) => found,
        Err(why) => return (OutputRow::refused(why), None),
    };
    if let Some(why) = verdict::not_reflectance(samples, &found, values, settings) {
        return (OutputRow::refused(why), None);
    }
    let suspicion = Suspicion::of(samples, &found, settings);
    let status = verdict::status(&found, values, samples, settings, &suspicion);
    let auto = settings.surface == LobeChoice::Auto;
    (OutputRow { values: cells(&found, settings), status }, auto.then(|| chosen(&found)))
}

fn cells(f: &GlossSampleFit, settings: &GlossFitSettings) -> Vec<f64> {
    let mut cells: Vec<f64> = f.rho_d.iter().copied().chain([f.rho_s, f.m, f.tilt[0], f.tilt[1], f.rms]).collect();
    cells.extend(f.rho_d_err.iter().copied().chain([f.rho_s_err, f.m_err, f.tilt_err[0], f.tilt_err[1]]));
    if settings.index.is_none() {
        // A lobe without an index has none to print.
        cells.extend(f.lobe.index().map_or([f64::NAN; 2], |index| [index, f.index_err]));
    }
    if settings.surface == LobeChoice::Auto {
        let own = f.evidence[LobeKind::from(f.lobe) as usize];
        cells.extend(f.evidence.iter().map(|e| e - own));
    }
    cells
}

/// Which lobe describes the leaf best, and by how much.
fn chosen(f: &GlossSampleFit) -> String {
    let own = LobeKind::from(f.lobe);
    let best = f.evidence[own as usize];
    let others: Vec<String> = LobeKind::iter()
        .zip(&f.evidence)
        .filter(|(kind, _)| *kind != own)
        .map(|(kind, e)| format!("{kind} {:.1}", e - best))
        .collect();
    let tied: Vec<String> = f.tied.iter().map(ToString::to_string).collect();
    let equal = if tied.is_empty() { String::new() } else { format!("; {} describes it as well", tied.join(" or ")) };
    format!("lobe {own} (ln of the evidence against it: {}){equal}", others.join(", "))
}
