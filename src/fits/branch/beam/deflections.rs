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
//! | `load_n`, `load_err_n` | the whole load; optional |
//! | `modulus_gpa`, `modulus_err_gpa` | modulus of elasticity; optional |
//!
//! A cell that cannot be read costs its own reading; the rest of the branch is fitted.

use super::fit::{BranchFit, DeflectionMark, MeasuredBranch, PositionReference, fit};
use crate::branch::{Error, Result};
use mesophyll_files::table::{InputTable, RowTally, Status, TableRecord, TableSink, push_number, push_text};
use mesophyll_plants::mechanics::load::Load;
use rayon::prelude::*;
use std::collections::HashMap;

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

/// What lengths, errors, loads and moduli are.
const NOT_NEGATIVE: [f64; 2] = [0.0, f64::INFINITY];

/// A branch as it was read.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedBranch {
    /// Its name in the table.
    pub name: String,
    /// What was measured, or the reason why it cannot be used.
    pub branch: std::result::Result<MeasuredBranch, String>,
    /// Rows that could not be read, by line, and why.
    pub unread: Vec<String>,
}

/// Reads all rows, grouped by branch in order of first appearance. `noise`: standard error (mm) where the file states
/// none.
///
/// # Errors
/// A missing column or an unreadable file. A reading that cannot be read is left out, by line; rows of one branch that
/// contradict each other refuse it.
pub fn read(mut table: InputTable, noise: Option<f64>) -> Result<Vec<NamedBranch>> {
    let columns = REQUIRED.iter().map(|c| table.require(c)).collect::<Result<Vec<_>>>()?;
    let optional: Vec<Option<usize>> = OPTIONAL.iter().map(|c| table.column(c)).collect();
    let mut branches: Vec<NamedBranch> = Vec::new();
    let mut places: HashMap<String, usize> = HashMap::new();
    let mut row = TableRecord::default();
    while table.next_record(&mut row)? {
        let line = row.line();
        let name = row.shown(columns[0]).into_owned();
        let at = *places.entry(name.clone()).or_insert_with(|| {
            let empty =
                MeasuredBranch { length: f64::NAN, readings: Vec::new(), load: [f64::NAN; 2], modulus: [f64::NAN; 2] };
            branches.push(NamedBranch { name, branch: Ok(empty), unread: Vec::new() });
            branches.len() - 1
        });
        let NamedBranch { branch, unread, .. } = &mut branches[at];
        let mut faults: Vec<String> = row.fault(table.header.len()).into_iter().collect();
        let mut number = |column: Option<usize>, range: [f64; 2]| {
            let found = column.map_or(Ok(None), |column| table.number_in(&row, column, range));
            found.unwrap_or_else(|why| {
                faults.push(why);
                None
            })
        };
        let [length, position] = [1, 2].map(|k| number(Some(columns[k]), NOT_NEGATIVE));
        let deflection = number(Some(columns[3]), [f64::NEG_INFINITY, f64::INFINITY]);
        let [error, load, load_err, modulus, modulus_err] =
            [0, 1, 2, 3, 4].map(|k| number(optional[k], NOT_NEGATIVE).unwrap_or(f64::NAN));
        let error = if error.is_nan() { noise.unwrap_or(f64::NAN) } else { error };
        let broken = row.fault(table.header.len()).is_some();
        match (position, deflection) {
            (Some(position), Some(deflection)) if !broken => {
                if let Ok(known) = branch {
                    let length = length.unwrap_or(f64::NAN);
                    let reading = DeflectionMark { position, deflection, error };
                    if let Err(why) = add(known, line, length, reading, [load, load_err], [modulus, modulus_err]) {
                        *branch = Err(why);
                    }
                }
            }
            (position, _) if faults.is_empty() => {
                let missing = if position.is_none() { REQUIRED[2] } else { REQUIRED[3] };
                faults.push(format!("{missing} is missing"));
            }
            _ => {}
        }
        unread.extend(faults.iter().map(|why| format!("line {line}: {why}")));
    }
    Ok(branches)
}

/// Adds a row. What belongs to the branch as a whole must be the same in all its rows; empty cells are ignored.
fn add(
    branch: &mut MeasuredBranch,
    line: usize,
    length: f64,
    reading: DeflectionMark,
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

/// Fits every branch under `load`; `None`: an even load, compared with others ([`super::evidence`]).
pub fn fit_all(
    branches: &[NamedBranch],
    along: PositionReference,
    load: Option<Load>,
) -> Vec<std::result::Result<BranchFit, String>> {
    let one = |named: &NamedBranch| match &named.branch {
        Err(why) => Err(why.clone()),
        Ok(branch) if branch.readings.is_empty() && !named.unread.is_empty() => {
            Err(format!("no readings; left out: {}", named.unread[0]))
        }
        Ok(branch) => fit(branch, along, load).map_err(|why| match named.unread.first() {
            Some(line) if branch.readings.len() < 3 => format!("{why}; left out: {line}"),
            _ => why,
        }),
    };
    branches.par_iter().map(one).collect()
}

/// What is said beside the rows: which load the numbers are for, what was left out, what is unusual.
pub fn notes(
    branches: &[NamedBranch],
    fits: &[std::result::Result<BranchFit, String>],
    load: Option<Load>,
) -> Vec<String> {
    let mut notes = vec![match load {
        Some(load) => format!("the load is taken as {}, as stated", load.words()),
        None => format!(
            "the load is taken as {}; where it hangs otherwise: --load tip, own-weight, or its distance from the root",
            Load::Even.words()
        ),
    }];
    for (named, fit) in branches.iter().zip(fits) {
        let left = fit.as_ref().map_or(&[][..], |f| &f.left_out);
        let all: Vec<&String> = named.unread.iter().chain(left).collect();
        if let Some(first) = all.first() {
            let (n, s) = (all.len(), if all.len() == 1 { "" } else { "s" });
            notes.push(format!("branch {}: {n} cell{s} or reading{s} left out: {first}", named.name));
        }
        if let Some(unusual) = fit.as_ref().ok().and_then(|f| f.unusual.as_ref()) {
            notes.push(format!("branch {}: {unusual}", named.name));
        }
    }
    notes
}

/// Writes a row a branch.
///
/// # Errors
/// [`Error::Write`] where the output cannot be written.
pub fn write(
    branches: &[NamedBranch],
    fits: &[std::result::Result<BranchFit, String>],
    mut sink: TableSink,
) -> Result<RowTally> {
    let mut bytes = format!("branch,{},status\n", OUTPUTS.join(",")).into_bytes();
    let mut tally = RowTally::new(&OUTPUTS);
    for (NamedBranch { name, .. }, result) in branches.iter().zip(fits) {
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
    sink.write_all(&bytes)?;
    sink.finish()?;
    Ok(tally)
}

fn row(m: &BranchFit) -> Vec<f64> {
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
