//! `fit gloss --samples`: goniometer tables in, a row a leaf out.

use super::{Sample, SamplesFit, TILT, fit};
use crate::gloss::M_RANGE;
use crate::{Error, Result};
use mesophyll_files::table::{Output, Record, Sink, Status, Table, Tally, push_number, push_text};
use mesophyll_optics::gloss::Lobe;

/// `fit gloss --samples`: reads all rows, groups them by `leaf`, writes a row a leaf in order of first appearance.
///
/// # Errors
/// A missing column, an unreadable input, an unwritable output. A bad row refuses its leaf, by line.
pub fn run(mut table: Table, output: &Output, values: &[String], lobe: Lobe) -> Result<Tally> {
    let values: Vec<String> = if values.is_empty() {
        table.header.iter().filter(|h| h.starts_with("brf")).cloned().collect()
    } else {
        values.to_vec()
    };
    if values.is_empty() {
        return Err(Error::input(
            table.name(),
            "no value columns: name them with --values, or begin their names with brf",
        ));
    }
    if let Some(twice) = values.iter().enumerate().find(|(k, v)| values[..*k].contains(v)) {
        return Err(Error::Usage(format!("--values names {} twice", twice.1)));
    }
    let leaf_at = table.require("leaf")?;
    let angles_at =
        [table.require("source_zenith_deg")?, table.require("view_zenith_deg")?, table.require("view_azimuth_deg")?];
    let values_at: Vec<usize> = values.iter().map(|v| table.require(v)).collect::<Result<_>>()?;
    let mut leaves: Vec<(String, std::result::Result<Vec<Sample>, String>)> = Vec::new();
    let mut places = std::collections::HashMap::new();
    let (mut record, mut line) = (Record::default(), 1);
    while table.next_record(&mut record)? {
        line += 1;
        let name = text(&record, leaf_at).to_string();
        let at = *places.entry(name.clone()).or_insert_with(|| {
            leaves.push((name, Ok(Vec::new())));
            leaves.len() - 1
        });
        let sample = match record.fault(table.header.len()) {
            None => read_sample(&table.header, &record, angles_at, &values_at),
            Some(fault) => Err(fault),
        };
        let list = &mut leaves[at].1;
        match (sample, &mut *list) {
            (Ok(sample), Ok(samples)) => samples.push(sample),
            (Err(why), Ok(_)) => *list = Err(format!("line {line}: {why}")),
            _ => {}
        }
    }
    let mut sink = Sink::open(output, table.source())?;
    let each = |suffix: &str| values.iter().map(|v| format!("rho_d_{v}{suffix}")).collect::<Vec<_>>();
    let mut header = vec!["leaf".to_string()];
    header.extend(each(""));
    header.extend(["rho_s", "m", "tilt", "tilt_y", "rms"].map(String::from));
    header.extend(each("_err"));
    header.extend(["rho_s_err", "m_err", "tilt_err", "tilt_y_err", "status"].map(String::from));
    let mut bytes = Vec::new();
    for (k, name) in header.iter().enumerate() {
        if k > 0 {
            bytes.push(b',');
        }
        push_text(&mut bytes, name);
    }
    bytes.push(b'\n');
    let mut tally = Tally::new(&header[1..header.len() - 1]);
    use rayon::prelude::*;
    let fits: Vec<_> = leaves
        .par_iter()
        .map(|(_, samples)| samples.as_ref().map_err(String::clone).and_then(|s| fit(s, lobe)))
        .collect();
    for ((name, _), fitted) in leaves.iter().zip(fits) {
        push_text(&mut bytes, name);
        let status = match fitted {
            Ok(f) => {
                let status = status(&f, &values);
                let cells = f.rho_d.iter().copied().chain([f.rho_s, f.m, f.tilt[0], f.tilt[1], f.rms]);
                let errors = f.rho_d_err.iter().copied().chain([f.rho_s_err, f.m_err, f.tilt_err[0], f.tilt_err[1]]);
                let numbers: Vec<f64> = cells.chain(errors).collect();
                for v in &numbers {
                    bytes.push(b',');
                    push_number(&mut bytes, *v);
                }
                tally.count(&status, &numbers);
                status
            }
            Err(why) => {
                bytes.extend(std::iter::repeat_n(b',', header.len() - 2));
                let status = Status::Refused(why);
                tally.count(&status, &[]);
                status
            }
        };
        bytes.push(b',');
        push_text(&mut bytes, &status.to_string());
        bytes.push(b'\n');
    }
    sink.write_all(&bytes)?;
    sink.finish()?;
    Ok(tally)
}

/// A cell as text; what is not UTF-8 shows as such in messages and is no number.
fn text(record: &Record, k: usize) -> &str {
    record.cells.get(k).unwrap_or("")
}

fn read_sample(
    header: &[String],
    record: &Record,
    angles_at: [usize; 3],
    values_at: &[usize],
) -> std::result::Result<Sample, String> {
    let number = |k: usize| text(record, k).parse::<f64>().ok().filter(|v| v.is_finite());
    let mut angles = [0.0; 3];
    for (angle, &k) in angles.iter_mut().zip(&angles_at) {
        *angle = number(k).ok_or_else(|| format!("{} is {:?}; expected degrees", header[k], text(record, k)))?;
    }
    for (k, limit) in [(0, 90.0), (1, 90.0)] {
        if !(0.0..limit).contains(&angles[k]) {
            return Err(format!("{} is {}; expected 0 to 90 degrees", header[angles_at[k]], angles[k]));
        }
    }
    let values = values_at
        .iter()
        .map(|&k| {
            let cell = text(record, k);
            if cell.is_empty() || cell.eq_ignore_ascii_case("nan") {
                return Ok(f64::NAN);
            }
            number(k).ok_or_else(|| format!("{} is {cell:?}; expected a number", header[k]))
        })
        .collect::<std::result::Result<Vec<_>, _>>()?;
    let [s, v, a] = angles.map(f64::to_radians);
    Ok(Sample::from_angles(s, v, a, values))
}

fn status(f: &SamplesFit, values: &[String]) -> Status {
    let mut names: Vec<String> = Vec::new();
    let unsure = |err: f64, value: f64| err.is_nan() || err > 0.1 * value;
    for (k, v) in values.iter().enumerate() {
        if unsure(f.rho_d_err[k], f.rho_d[k]) {
            names.push(format!("rho_d_{v}"));
        }
    }
    if unsure(f.rho_s_err, f.rho_s) {
        names.push("rho_s".into());
    }
    let at_bound = f.m <= 1.0001 * M_RANGE[0] || f.m >= 0.9999 * M_RANGE[1];
    if at_bound || unsure(f.m_err, f.m) {
        names.push("m".into());
    }
    for (k, name) in ["tilt", "tilt_y"].into_iter().enumerate() {
        if f.tilt[k].abs() >= TILT - 1e-9 || unsure(f.tilt_err[k], f.tilt[k].abs().max(0.35)) {
            names.push(name.into());
        }
    }
    if names.is_empty() { Status::Ok } else { Status::Undetermined(names.join(" ")) }
}
