//! `fit beam --deflections` reads a table of marks, with several branches in one file, and writes one row for each
//! branch.
//!
//! Columns, by name in any order:
//!
//! | column | meaning |
//! |---|---|
//! | `branch` | name; rows of one name belong together |
//! | `length_mm` | length of the branch; the same in all its rows |
//! | `position_mm` | distance of the mark from the root |
//! | `deflection_mm` | how far the load moved the mark across the branch |
//! | `deflection_err_mm` | its standard error; optional, without it the scatter of the residuals is used |
//! | `load_n`, `load_err_n` | the whole load, spread evenly along the branch; optional |
//! | `modulus_gpa`, `modulus_err_gpa` | modulus of elasticity; optional |

use super::measured::{Along, Branch, Measured, Reading, fit};
use crate::{Error, Result};
use mesophyll_files::table::{Output, Record, Sink, Status, Table, Tally, push_number, push_text};
use rayon::prelude::*;
use std::collections::HashMap;
use std::path::Path;

/// Output columns, before `status`.
pub const OUTPUTS: [&str; 12] = [
    "alpha",
    "load_over_stiffness_mm",
    "root_radius_mm",
    "tip_mm",
    "alpha_err",
    "load_over_stiffness_mm_err",
    "root_radius_mm_err",
    "tip_mm_err",
    "correlation",
    "chi2",
    "rms_mm",
    "readings",
];

const REQUIRED: [&str; 4] = ["branch", "length_mm", "position_mm", "deflection_mm"];
const OPTIONAL: [&str; 5] = ["deflection_err_mm", "load_n", "load_err_n", "modulus_gpa", "modulus_err_gpa"];

/// A branch as it was read, or the reason why it cannot be used.
pub type Named = (String, std::result::Result<Branch, String>);

/// Reads all rows, grouped by branch in order of first appearance. `noise`: standard error (mm) where the file states
/// none.
///
/// # Errors
/// A missing column or an unreadable file. A bad row refuses its branch, by line.
pub fn read(mut table: Table, noise: Option<f64>) -> Result<Vec<Named>> {
    let columns = REQUIRED.iter().map(|c| table.require(c)).collect::<Result<Vec<_>>>()?;
    let optional: Vec<Option<usize>> = OPTIONAL.iter().map(|c| table.column(c)).collect();
    let mut branches: Vec<Named> = Vec::new();
    let mut places: HashMap<String, usize> = HashMap::new();
    let (mut row, mut line) = (Record::default(), 1);
    while table.next_record(&mut row)? {
        let (record, fault) = (&row, row.fault(table.header.len()));
        line += 1;
        let name = record.shown(columns[0]).into_owned();
        let number = |k: usize| -> std::result::Result<f64, String> {
            let text = record.shown(columns[k]);
            text.parse::<f64>()
                .ok()
                .filter(|v| v.is_finite())
                .ok_or_else(|| format!("line {line}: {} is {text:?}; expected a number", REQUIRED[k]))
        };
        let maybe = |k: usize| -> std::result::Result<f64, String> {
            let text = optional[k].map(|c| record.shown(c)).unwrap_or_default();
            if text.is_empty() {
                return Ok(f64::NAN);
            }
            text.parse::<f64>().map_err(|_| format!("line {line}: {} is {text:?}; expected a number", OPTIONAL[k]))
        };
        let row = || {
            if let Some(fault) = &fault {
                return Err(format!("line {line}: {fault}"));
            }
            let error = maybe(0)?;
            let error = if error.is_nan() { noise.unwrap_or(f64::NAN) } else { error };
            let reading = Reading { position: number(2)?, deflection: number(3)?, error };
            Ok((number(1)?, reading, [maybe(1)?, maybe(2)?], [maybe(3)?, maybe(4)?]))
        };
        let at = *places.entry(name.clone()).or_insert_with(|| {
            let empty = Branch { length: f64::NAN, readings: Vec::new(), load: [f64::NAN; 2], modulus: [f64::NAN; 2] };
            branches.push((name, Ok(empty)));
            branches.len() - 1
        });
        let slot = &mut branches[at].1;
        let Ok(branch) = slot else { continue };
        if let Err(why) =
            row().and_then(|(length, reading, load, modulus)| add(branch, line, length, reading, load, modulus))
        {
            *slot = Err(why);
        }
    }
    Ok(branches)
}

/// Adds a row. What belongs to the branch as a whole must be the same in all its rows; empty cells are ignored.
fn add(
    branch: &mut Branch,
    line: usize,
    length: f64,
    reading: Reading,
    load: [f64; 2],
    modulus: [f64; 2],
) -> std::result::Result<(), String> {
    let settle = |have: &mut f64, new: f64, name: &str| {
        if have.is_nan() {
            *have = new;
        } else if !new.is_nan() && new != *have {
            return Err(format!("line {line}: {name} is {new}; earlier rows of this branch have {have}"));
        }
        Ok(())
    };
    settle(&mut branch.length, length, "length_mm")?;
    settle(&mut branch.load[0], load[0], "load_n")?;
    settle(&mut branch.load[1], load[1], "load_err_n")?;
    settle(&mut branch.modulus[0], modulus[0], "modulus_gpa")?;
    settle(&mut branch.modulus[1], modulus[1], "modulus_err_gpa")?;
    branch.readings.push(reading);
    Ok(())
}

/// Fits every branch.
pub fn fit_all(branches: &[Named], along: Along) -> Vec<std::result::Result<Measured, String>> {
    branches.par_iter().map(|(_, b)| b.as_ref().map_err(String::clone).and_then(|b| fit(b, along))).collect()
}

/// Writes a row a branch of what was read from `input`.
///
/// # Errors
/// [`Error::Write`] where the output cannot be written, [`Error::Usage`] where it is the input.
pub fn write(
    branches: &[Named],
    fits: &[std::result::Result<Measured, String>],
    input: &Path,
    output: &Output,
) -> Result<Tally> {
    let mut bytes = format!("branch,{},status\n", OUTPUTS.join(",")).into_bytes();
    let mut tally = Tally::new(&OUTPUTS);
    for ((name, _), result) in branches.iter().zip(fits) {
        push_text(&mut bytes, name);
        let (values, status) = match result {
            Ok(m) => (row(m), m.status.clone()),
            Err(why) => (vec![f64::NAN; OUTPUTS.len()], Status::Refused(why.clone())),
        };
        tally.count(&status, &values);
        for v in values {
            bytes.push(b',');
            push_number(&mut bytes, v);
        }
        bytes.push(b',');
        push_text(&mut bytes, &status.to_string());
        bytes.push(b'\n');
    }
    let mut sink = Sink::open(output, input)?;
    sink.write_all(&bytes)?;
    sink.finish()?;
    Ok(tally)
}

fn row(m: &Measured) -> Vec<f64> {
    let all = [m.taper, m.load_over_stiffness, m.root_radius, m.tip];
    // An error without a value is an empty cell, not an infinite one.
    let errors = all.iter().map(|k| if k.value.is_nan() { f64::NAN } else { k.error });
    let rest = [m.correlation, m.fit.uncertainty.chi2, m.rms, m.fit.residuals.len() as f64];
    all.iter().map(|k| k.value).chain(errors).chain(rest).collect()
}

/// Checks a noise that was given on the command line.
///
/// # Errors
/// [`Error::Usage`] unless it is positive.
pub fn check_noise(noise: Option<f64>) -> Result<()> {
    match noise {
        Some(n) if !(n > 0.0 && n.is_finite()) => {
            Err(Error::Usage(format!("--noise is {n}; expected a standard error in mm, more than 0")))
        }
        _ => Ok(()),
    }
}
