//! `fit gloss --samples`: reads goniometer tables and writes one row for each leaf.

use super::{Sample, SamplesFit, TILT, fit};
use crate::gloss::M_RANGE;
use crate::{Error, Result};
use mesophyll_files::table::{Answer, Groups, Output, Spec, Status, Table, Tally};
use mesophyll_optics::gloss::Lobe;

/// `fit gloss --samples`: reads all rows, groups them by `leaf`, and writes one row for each leaf in the order in which
/// leaves first appear.
///
/// # Errors
/// A missing column, an unreadable input, an unwritable output. A bad row makes its whole leaf refused; the message
/// names the line.
pub fn run(table: Table, output: &Output, values: &[String], lobe: Lobe) -> Result<Tally> {
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
    for name in &values {
        table.require(name)?;
    }
    let spec = Spec {
        required: ANGLES.map(String::from).to_vec(),
        optional: values.clone(),
        outputs: outputs(&values),
        ..Spec::default()
    };
    Groups::read(table, &spec, "leaf")?.run(output, &spec, |_, rows, _| {
        let samples: std::result::Result<Vec<Sample>, String> = rows
            .iter()
            .map(|row| sample(&row.values, &values).map_err(|why| format!("line {}: {why}", row.line)))
            .collect();
        samples.map_or_else(Answer::refused, |samples| answer(&samples, &values, lobe))
    })
}

/// Output columns of [`answer`] for value columns of these names.
pub fn outputs(values: &[String]) -> Vec<String> {
    let each = |suffix: &str| values.iter().map(|v| format!("rho_d_{v}{suffix}")).collect::<Vec<_>>();
    let mut outputs = each("");
    outputs.extend(["rho_s", "m", "tilt", "tilt_y", "rms"].map(String::from));
    outputs.extend(each("_err"));
    outputs.extend(["rho_s_err", "m_err", "tilt_err", "tilt_y_err"].map(String::from));
    outputs
}

/// Fits one leaf and says what was found as the row of a batch; `values` are the names of the value columns.
pub fn answer(samples: &[Sample], values: &[String], lobe: Lobe) -> Answer {
    match fit(samples, lobe) {
        Ok(f) => {
            let cells = f.rho_d.iter().copied().chain([f.rho_s, f.m, f.tilt[0], f.tilt[1], f.rms]);
            let errors = f.rho_d_err.iter().copied().chain([f.rho_s_err, f.m_err, f.tilt_err[0], f.tilt_err[1]]);
            Answer { values: cells.chain(errors).collect(), status: status(&f, values) }
        }
        Err(why) => Answer::refused(why),
    }
}

const ANGLES: [&str; 3] = ["source_zenith_deg", "view_zenith_deg", "view_azimuth_deg"];

/// A direction with its readings: `cells` holds the three angles (degrees), then the readings, whose columns are called
/// `names`.
///
/// # Errors
/// A sentence that names the number that cannot be used.
pub fn sample(cells: &[f64], names: &[String]) -> std::result::Result<Sample, String> {
    let (angles, values) = cells.split_at(ANGLES.len());
    if let Some((name, x)) = ANGLES.iter().zip(angles).find(|(_, x)| !x.is_finite()) {
        return Err(format!("{name} is {x}; expected degrees"));
    }
    if let Some((name, x)) = ANGLES.iter().zip(angles).take(2).find(|(_, x)| !(0.0..90.0).contains(*x)) {
        return Err(format!("{name} is {x}; expected 0 to 90 degrees"));
    }
    if let Some((name, x)) = names.iter().zip(values).find(|(_, x)| x.is_infinite()) {
        return Err(format!("{name} is {x}; expected a number"));
    }
    let [s, v, a] = std::array::from_fn(|k| angles[k].to_radians());
    Ok(Sample::from_angles(s, v, a, values.to_vec()))
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
