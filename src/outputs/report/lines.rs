//! Rows turned into lines of tables, as text. HTML and Markdown share them.

use crate::chart::{self, AxisTitles, ChartSeries};
use crate::figure::{self, ReportFigure, words};
use crate::model::{FitReport, ParameterDifference, ParameterRow, TimesReport};
use crate::number::{percent, plain, plus_minus, significant};
use crate::quantity::{channel_word, parameter};
use mesophyll_fits::record::FitKind;
use mesophyll_fits::translucency::judge::NAMES;
use serde::Serialize;
use std::collections::BTreeMap;

/// A parameter with its channels side by side.
#[derive(Debug, Clone, Serialize)]
pub struct ParameterLine {
    pub section: String,
    pub name: String,
    pub symbol: String,
    /// Meaning of the symbol; empty where it is not known.
    pub meaning: &'static str,
    pub unit: String,
    /// One cell, or three cells for red, green and blue.
    pub cells: Vec<ReportCell>,
    /// A series of numbers that are not colour channels.
    pub series: String,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ReportCell {
    /// Value ± standard error, or `undetermined`.
    pub text: String,
    /// The parts of the error. For an undetermined value, its best estimate and the reason why it is undetermined.
    pub note: String,
    pub undetermined: bool,
}

/// When the values of a fit are determined.
pub(crate) fn determined(kind: FitKind) -> &'static str {
    match kind {
        // The angles of a panorama have their own rule.
        FitKind::Panorama => "",
        FitKind::Scene => {
            "a reflectance is determined when its standard error is at most 0.25, another number when it is at most a \
             quarter of it, and a small absorption when it is at most all of it"
        }
        _ => "a value is determined when its standard error is at most 10 % of it",
    }
}

/// The rule for undetermined values of a fit, shown where a table has one.
pub(crate) fn rule(kind: FitKind) -> String {
    let when = determined(kind).replacen('a', "A", 1);
    let rule = "An undetermined value is shown with its best estimate: do not rely on more of it than its error or its \
                bound allows.";
    if when.is_empty() { rule.into() } else { format!("{when}. {rule}") }
}

/// The explanation of the caliper's share of an error, shown where a table has one.
pub(crate) const CALIPER: &str = "Thickness is measured by a caliper, and σa and σs are inversely proportional to it: \
 the caliper's error moves them and every thickness \
                           of the leaf together, by the same share. Its part and the fit's own part are given beside \
                           the whole error (they add as squares). γ, ρd, \
                           ρt, ρs and m do not depend on the caliper.";

/// One line a parameter, in the rows' order.
pub(crate) fn parameter_lines(rows: &[ParameterRow]) -> Vec<ParameterLine> {
    let mut lines: Vec<ParameterLine> = Vec::new();
    for of in rows.chunk_by(|a, b| a.section == b.section && a.name == b.name) {
        let first = &of[0];
        let (symbol, meaning) = parameter(&first.name);
        let series = of.len() > 1 && of.iter().any(|r| !matches!(r.channel.as_str(), "R" | "G" | "B"));
        let cells = of.iter().map(parameter_cell);
        let (cells, series) = match series {
            true => (Vec::new(), cells.map(|c| c.text).collect::<Vec<_>>().join("; ")),
            false => (cells.collect(), String::new()),
        };
        lines.push(ParameterLine {
            section: first.section.clone(),
            name: first.name.clone(),
            symbol,
            meaning,
            unit: first.unit.clone(),
            cells,
            series,
        });
    }
    lines
}

/// `0.412 ± 0.013`, or `undetermined` with the best estimate beside it; an undetermined value is never printed like a
/// known one.
pub(crate) fn parameter_cell(row: &ParameterRow) -> ReportCell {
    let Some(why) = &row.undetermined else {
        let text = match (row.value, row.stderr) {
            (None, _) => {
                return ReportCell { text: "undetermined".into(), note: "no estimate".into(), undetermined: true };
            }
            (Some(v), Some(e)) if e > 0.0 => plus_minus(v, e),
            (Some(v), stated) => {
                let note = if stated.is_some() { "held fixed" } else { "no error stated" };
                return ReportCell { text: plain(v), note: note.into(), undetermined: false };
            }
        };
        let parts = row.stderr.zip(row.stderr_caliper).filter(|(_, c)| *c > 0.0);
        let own = |e: f64, c: f64| (e * e - c * c).max(0.0).sqrt();
        let note = parts.map(|(e, c)| match own(e, c) {
            own if own < 1e-3 * e => "all of the error is the caliper's".to_string(),
            own => format!("own ± {}, caliper ± {}", significant(own, 2), significant(c, 2)),
        });
        return ReportCell { text, note: note.unwrap_or_default(), undetermined: false };
    };
    let estimate = match (row.value, row.stderr) {
        (None, _) => "no estimate".to_string(),
        (Some(v), None) => format!("best estimate {}, its error is not bounded", plain(v)),
        (Some(v), Some(e)) => format!("best estimate {} ({})", plus_minus(v, e), percent(e / v.abs())),
    };
    // The share was already stated.
    let why: Vec<&str> =
        why.split("; ").filter(|part| !part.is_empty() && !part.starts_with("relative standard error")).collect();
    let note = [vec![estimate.as_str()], why].concat().join("; ");
    ReportCell { text: "undetermined".into(), note, undetermined: true }
}

/// `sigma_a.R` → `σa red`, as correlations are labelled.
pub(crate) fn channel_of(name: &str) -> String {
    match name.split_once('.') {
        Some((head, channel)) => format!("{} {}", parameter(head).0, channel_word(channel)),
        None => parameter(name).0,
    }
}

/// The unit of a residual's RMS.
pub(crate) fn residual_unit(name: &str) -> &'static str {
    match name {
        "gloss" => "× the noise",
        "transmittance" => "of ρt (0 to 1)",
        "deflection" => "mm",
        "radiance" => "of the model",
        _ => "",
    }
}

/// `94.8 %`, or `2 of 3` for a few values, because a share of so few says nothing; `—` where no interval is judged.
pub fn coverage(share: Option<f64>, judged: Option<usize>) -> String {
    match (share, judged) {
        (None, _) => "—".into(),
        (Some(c), Some(n)) if n < MANY => format!("{} of {n}", (c * n as f64).round()),
        (Some(c), _) => percent(c),
    }
}

/// With fewer values than this, they are counted one by one.
pub(crate) const MANY: usize = 20;

/// A difference of two fits in words.
pub(crate) fn value_or_word(value: Option<f64>, error: Option<f64>) -> String {
    match (value, error) {
        (None, _) => "undetermined".into(),
        (Some(v), Some(e)) => plus_minus(v, e),
        (Some(v), None) => plain(v),
    }
}

/// `+1.3 σ`.
pub fn sigmas(row: &ParameterDifference) -> String {
    row.sigmas
        .map_or_else(|| "not weighed".into(), |s| format!("{}{} σ", if s > 0.0 { "+" } else { "" }, significant(s, 2)))
}

/// Figures of a section: those that are shown by themselves, and the table of a directional basis's errors.
#[derive(Debug, Clone, Default, Serialize)]
pub struct SectionFigures {
    pub single: Vec<ReportFigure>,
    /// Figures that have no name on the page.
    pub unnamed: usize,
    /// Heading of the table's first column; the table's other columns and cells follow.
    pub heading: String,
    pub columns: Vec<String>,
    pub table: Vec<(String, Vec<String>)>,
    pub caption: String,
}

pub fn figures(all: &BTreeMap<String, f64>) -> SectionFigures {
    let (single, unnamed) = figure::lines(all.iter().filter(|(name, _)| basis_figure(name).is_none()));
    let mut out = SectionFigures { single, unnamed, ..SectionFigures::default() };
    light_angles(&mut out, all);
    out
}

/// Errors of a directional basis: name in `fit.toml`, what the table calls it.
const BASIS_FIGURES: [(&str, &str); 5] = [
    ("mean", "mean error"),
    ("median", "median error"),
    ("p95", "95 % of the texels within"),
    ("rms", "RMS over that of the light"),
    ("faint", "texels left out as faint"),
];

/// `basis_p95_grazing_G` → (2, 2, `G`): row, light angle, channel.
fn basis_figure(name: &str) -> Option<(usize, usize, &str)> {
    let mut parts = name.strip_prefix("basis_")?.splitn(3, '_');
    let (what, angle, channel) = (parts.next()?, parts.next()?, parts.next()?);
    let row = BASIS_FIGURES.iter().position(|(n, _)| *n == what)?;
    Some((row, NAMES.iter().position(|n| *n == angle)?, channel))
}

/// How well the basis of a translucency fit represents the light, with one column for each light angle (and channel,
/// where there are several).
fn light_angles(out: &mut SectionFigures, all: &BTreeMap<String, f64>) {
    let found: Vec<(usize, usize, &str, f64)> =
        all.iter().filter_map(|(n, v)| basis_figure(n).map(|(r, a, c)| (r, a, c, *v))).collect();
    let mut channels: Vec<&str> = ["R", "G", "B"].into_iter().filter(|c| found.iter().any(|f| f.2 == *c)).collect();
    channels.extend(found.iter().map(|f| f.2).find(|c| !["R", "G", "B"].contains(c)));
    let columns: Vec<(usize, &str)> = (0..NAMES.len()).flat_map(|a| channels.iter().map(move |c| (a, *c))).collect();
    for (row, (_, title)) in BASIS_FIGURES.iter().enumerate() {
        let cell = |(a, c): &(usize, &str)| {
            let value = found.iter().find(|f| (f.0, f.1, f.2) == (row, *a, *c));
            value.map_or_else(|| "—".into(), |f| percent(f.3))
        };
        if found.iter().any(|f| f.0 == row) {
            out.table.push((title.to_string(), columns.iter().map(cell).collect()));
        }
    }
    if !out.table.is_empty() {
        out.heading = "error of the basis, light at".into();
        out.caption =
            "Against the full convolution. Errors are relative, over texels that get at least 1 % of the mean at that \
             angle; the RMS is over all texels."
                .into();
        let angle = |a: usize| ["π/2", "π/4", "π/8"][a];
        out.columns = columns
            .iter()
            .map(
                |(a, c)| {
                    if channels.len() > 1 { format!("{} {}", angle(*a), channel_word(c)) } else { angle(*a).into() }
                },
            )
            .collect();
    }
}

/// The traces as charts: error to the truth where it is known, and cost, both against run time.
pub(crate) fn trace_charts(fit: &FitReport) -> (Option<String>, Option<String>) {
    let Some(times) = &fit.times else { return (None, None) };
    let about = |what: &str| format!("{what} of {} against run time", fit.name);
    let truth = curves(times, |r| r.truth_error);
    let cost = curves(times, |r| Some(r.cost));
    let titles = |y: &'static str, about| AxisTitles { x: "run time (s)", y, about };
    (
        chart::log_log(&truth, titles("error to the truth", &about("Error"))),
        chart::log_log(&cost, titles("cost, ½ Σ r²", &about("Cost"))),
    )
}

/// A logarithmic axis has no zero: a first row at time zero is drawn at half of the first positive time.
fn curves(times: &TimesReport, pick: impl Fn(&mesophyll_base::solvers::TraceRow) -> Option<f64>) -> Vec<ChartSeries> {
    let first = |rows: &[mesophyll_base::solvers::TraceRow]| {
        rows.iter().map(|r| r.elapsed_s).filter(|t| *t > 0.0).fold(f64::INFINITY, f64::min)
    };
    times
        .traces
        .iter()
        .map(|(name, rows)| {
            let earliest = first(rows) / 2.0;
            let point = |r: &mesophyll_base::solvers::TraceRow| {
                Some((if r.elapsed_s > 0.0 { r.elapsed_s } else { earliest }, pick(r)?))
            };
            ChartSeries { name: words(name), points: rows.iter().filter_map(point).collect() }
        })
        .collect()
}

/// Phases with their share of the total.
#[derive(Debug, Clone, Serialize)]
pub struct PhaseLine {
    pub name: String,
    pub time: String,
    /// 0 … 100.
    pub share: f64,
}

pub(crate) fn phase_lines(times: &TimesReport) -> Vec<PhaseLine> {
    let sum: f64 = times.phases.iter().map(|p| p.seconds).sum();
    let total = times.total_s.max(sum).max(1e-12);
    times
        .phases
        .iter()
        .map(|p| PhaseLine {
            name: words(&p.name),
            time: crate::number::duration(p.seconds),
            share: 100.0 * p.seconds / total,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(value: f64, stderr: Option<f64>, undetermined: Option<&str>) -> ParameterRow {
        ParameterRow {
            section: "front".into(),
            name: "sigma_a".into(),
            channel: "B".into(),
            value: Some(value),
            stderr,
            stderr_caliper: None,
            unit: "1/mm".into(),
            undetermined: undetermined.map(str::to_string),
        }
    }

    #[test]
    fn what_is_undetermined_shows_no_figure_as_if_known() {
        let cell = parameter_cell(&row(0.02, Some(0.006), Some("relative standard error 0.30; at most 0.03")));
        assert!(cell.undetermined && cell.text == "undetermined");
        assert_eq!(cell.note, "best estimate 0.0200 ± 0.0060 (30.0 %); at most 0.03");
        let cell = parameter_cell(&row(0.5, None, Some("")));
        assert!(cell.text == "undetermined" && cell.note == "best estimate 0.5, its error is not bounded");
        assert_eq!(parameter_cell(&row(0.5, Some(0.01), None)).text, "0.500 ± 0.010");
    }

    #[test]
    fn the_calipers_share_stands_beside_the_fits_own() {
        // 0.3² + 0.4² = 0.5²
        let shared = ParameterRow { stderr_caliper: Some(0.4), ..row(20.0, Some(0.5), None) };
        assert_eq!(parameter_cell(&shared).note, "own ± 0.30, caliper ± 0.40");
        assert_eq!(parameter_cell(&row(20.0, Some(0.5), None)).note, "");
    }

    #[test]
    fn a_basis_errors_stand_by_light_angle() {
        let mut all: BTreeMap<String, f64> =
            NAMES.iter().enumerate().map(|(k, n)| (format!("basis_p95_{n}_G"), 0.01 * (k + 1) as f64)).collect();
        all.extend([("basis_rms_half_G".to_string(), 0.25), ("mean_free_path_mm".to_string(), 0.5)]);
        let f = figures(&all);
        assert_eq!(f.columns, ["π/2", "π/4", "π/8"]);
        assert_eq!(
            f.table[0],
            ("95 % of the texels within".to_string(), ["1.0 %", "2.0 %", "3.0 %"].map(String::from).to_vec())
        );
        assert_eq!(f.table[1].1, ["—", "25.0 %", "—"]);
        assert_eq!((f.single.len(), f.single[0].value.as_str(), f.unnamed), (1, "0.5 mm", 0));
        all.insert("basis_p95_steep_R".into(), 0.5);
        assert_eq!(figures(&all).columns[..2], ["π/2 red".to_string(), "π/2 green".to_string()]);
    }
}
