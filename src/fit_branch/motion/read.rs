//! Deflections over time: columns `time_s,u_mm` and optionally `v_mm`, at even times.

use super::Record;
use crate::{Error, Result};
use mesophyll_files::table::{self, Table};

/// Times may deviate from even spacing by this share of the step, because they are often written with few digits.
const EVEN: f64 = 0.02;

/// Reads all rows.
///
/// # Errors
/// A missing column, a cell that is no finite number, times that are not even; each names the line.
pub fn read(mut table: Table) -> Result<Record> {
    let path = table.source().to_path_buf();
    let mut columns = vec![table.require("time_s")?, table.require("u_mm")?];
    columns.extend(table.column("v_mm"));
    let names = ["time_s", "u_mm", "v_mm"];
    let mut times: Vec<f64> = Vec::new();
    let mut channels: Vec<Vec<f64>> = vec![Vec::new(); columns.len() - 1];
    let (mut row, mut line) = (table::Record::default(), 1);
    while table.next_record(&mut row)? {
        line += 1;
        if let Some(fault) = row.fault(table.header.len()) {
            return Err(Error::input(&path, format!("line {line}: {fault}")));
        }
        for (k, column) in columns.iter().enumerate() {
            let text = row.shown(*column);
            let value = text.trim().parse::<f64>().ok().filter(|v| v.is_finite());
            let value = value.ok_or_else(|| {
                let field = format!("line {line}: {}", names[k]);
                Error::unexpected(&path, &field, format!("{text:?}"), "a finite number")
            })?;
            if k == 0 { times.push(value) } else { channels[k - 1].push(value) }
        }
    }
    let n = times.len();
    let (Some(first), Some(last)) = (times.first(), times.last()) else {
        return Err(Error::input(&path, "found no rows, expected deflections over time"));
    };
    let step = (last - first) / (n.max(2) - 1) as f64;
    if !(step > 0.0) {
        return Err(Error::field(&path, "time_s", "found times that do not rise, expected even steps"));
    }
    let off = times.iter().enumerate().find(|(k, t)| (*t - first - *k as f64 * step).abs() > EVEN * step);
    if let Some((k, t)) = off {
        let field = format!("line {}: time_s", k + 2);
        return Err(Error::unexpected(&path, &field, t, format!("{}: steps of {step} s", first + k as f64 * step)));
    }
    Ok(Record { step, channels })
}
