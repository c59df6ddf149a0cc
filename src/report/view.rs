//! Rows turned into the lines of tables, as text: what HTML and Markdown share.

use crate::fit::translucency::judge::NAMES;
use crate::report::chart::{self, Series, Titles};
use crate::report::model::{FitReport, ParameterDifference, ParameterRow, TimesReport};
use crate::report::number::{percent, plain, plus_minus};
use crate::report::quantity::{channel_word, symbol};
use serde::Serialize;
use std::collections::BTreeMap;

/// A parameter with its channels side by side.
#[derive(Debug, Clone, Serialize)]
pub struct ParameterLine {
    pub section: String,
    pub name: String,
    pub symbol: String,
    pub unit: String,
    pub cells: Vec<Cell>,
}

#[derive(Debug, Clone, Serialize)]
pub struct Cell {
    pub text: String,
    /// Said instead of an error; empty where the parameter is determined.
    pub undetermined: String,
}

/// One line a parameter, in the rows' order.
pub fn parameter_lines(rows: &[ParameterRow]) -> Vec<ParameterLine> {
    let mut lines: Vec<ParameterLine> = Vec::new();
    for row in rows {
        let cell = parameter_cell(row);
        match lines.last_mut().filter(|l| l.section == row.section && l.name == row.name) {
            Some(line) => line.cells.push(cell),
            None => lines.push(ParameterLine {
                section: row.section.clone(),
                name: row.name.clone(),
                symbol: symbol(&row.name),
                unit: row.unit.clone(),
                cells: vec![cell],
            }),
        }
    }
    lines
}

/// `0.412 ± 0.013`, or `undetermined: at most 0.02` — never a figure that looks known.
pub fn parameter_cell(row: &ParameterRow) -> Cell {
    match (&row.undetermined, row.value) {
        (Some(why), _) if !why.is_empty() => Cell { text: "undetermined".into(), undetermined: why.clone() },
        (Some(_), Some(v)) => Cell { text: "undetermined".into(), undetermined: format!("best estimate {}, error unbounded", plain(v)) },
        (Some(_), None) | (None, None) => Cell { text: "undetermined".into(), undetermined: "no estimate".into() },
        (None, Some(v)) => Cell {
            text: row.stderr.map_or_else(|| format!("{} (no error given)", plain(v)), |e| plus_minus(v, e)),
            undetermined: String::new(),
        },
    }
}

/// A difference of two fits in words.
pub fn value_or_word(value: Option<f64>, error: Option<f64>) -> String {
    match (value, error) {
        (None, _) => "undetermined".into(),
        (Some(v), Some(e)) => plus_minus(v, e),
        (Some(v), None) => plain(v),
    }
}

/// `+1.3 σ`.
pub fn sigmas(row: &ParameterDifference) -> String {
    row.sigmas.map_or_else(
        || "not weighed".into(),
        |s| format!("{}{} σ", if s > 0.0 { "+" } else { "" }, crate::report::number::significant(s, 2)),
    )
}

/// Figures of a section. Names such as `exact.median_error` and `paper.median_error` become one table of methods.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Figures {
    /// Over the table's first column, and under the table.
    pub heading: String,
    pub caption: String,
    pub single: Vec<(String, String)>,
    pub methods: Vec<String>,
    /// Quantity, then a figure a method (`—` where it has none).
    pub table: Vec<(String, Vec<String>)>,
}

pub fn figures(all: &BTreeMap<String, f64>) -> Figures {
    let dotted: Vec<(&str, &str, f64)> = all.iter().filter_map(|(n, v)| n.split_once('.').map(|(a, b)| (a, b, *v))).collect();
    let shared = |tail: &str| dotted.iter().filter(|(_, t, _)| *t == tail).count() > 1;
    let mut out = Figures { heading: "methods compared".into(), ..Figures::default() };
    for (head, tail, _) in &dotted {
        if shared(tail) && !out.methods.iter().any(|m| m == head) {
            out.methods.push(head.to_string());
        }
    }
    let mut tails: Vec<&str> = dotted.iter().filter(|d| shared(d.1)).map(|d| d.1).collect();
    tails.sort_unstable();
    tails.dedup();
    for tail in tails {
        let cell = |m: &String| dotted.iter().find(|(a, b, _)| a == m && *b == tail).map_or_else(|| "—".into(), |d| plain(d.2));
        out.table.push((words(tail), out.methods.iter().map(cell).collect()));
    }
    if out.table.is_empty() {
        light_angles(&mut out, all);
    }
    for (name, value) in all {
        if basis_figure(name).is_none() && !name.split_once('.').is_some_and(|(_, tail)| shared(tail)) {
            out.single.push((words(name), plain(*value)));
        }
    }
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

/// How well the basis of a translucency fit holds the light, a column a light angle (and a channel where there are several).
fn light_angles(out: &mut Figures, all: &BTreeMap<String, f64>) {
    let found: Vec<(usize, usize, &str, f64)> = all.iter().filter_map(|(n, v)| basis_figure(n).map(|(r, a, c)| (r, a, c, *v))).collect();
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
            "Against the full convolution. Errors are relative, over texels that get at least 1 % of the mean at that angle; the RMS is over all texels.".into();
        let angle = |a: usize| ["π/2", "π/4", "π/8"][a];
        out.methods = columns
            .iter()
            .map(|(a, c)| if channels.len() > 1 { format!("{} {}", angle(*a), channel_word(c)) } else { angle(*a).into() })
            .collect();
    }
}

/// `median_relative_error` → `median relative error`.
pub fn words(name: &str) -> String {
    name.replace('_', " ").replace(':', ": ")
}

/// The traces as charts: error to the truth where it is known, and cost, both against run time.
pub fn trace_charts(fit: &FitReport) -> (Option<String>, Option<String>) {
    let Some(times) = &fit.times else { return (None, None) };
    let about = |what: &str| format!("{what} of {} against run time", fit.name);
    let truth = curves(times, |r| r.truth_error);
    let cost = curves(times, |r| Some(r.cost));
    let titles = |y: &'static str, about| Titles { x: "run time (s)", y, about };
    (chart::log_log(&truth, titles("error to the truth", &about("Error"))), chart::log_log(&cost, titles("cost, ½ Σ r²", &about("Cost"))))
}

/// A logarithmic axis has no zero: a first row at time zero stands where half of the first positive time would.
fn curves(times: &TimesReport, pick: impl Fn(&crate::solve::TraceRow) -> Option<f64>) -> Vec<Series> {
    let first = |rows: &[crate::solve::TraceRow]| rows.iter().map(|r| r.elapsed_s).filter(|t| *t > 0.0).fold(f64::INFINITY, f64::min);
    times
        .traces
        .iter()
        .map(|(name, rows)| {
            let earliest = first(rows) / 2.0;
            let point = |r: &crate::solve::TraceRow| Some((if r.elapsed_s > 0.0 { r.elapsed_s } else { earliest }, pick(r)?));
            Series { name: words(name), points: rows.iter().filter_map(point).collect() }
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

pub fn phase_lines(times: &TimesReport) -> Vec<PhaseLine> {
    let sum: f64 = times.phases.iter().map(|p| p.seconds).sum();
    let total = times.total_s.max(sum).max(1e-12);
    times
        .phases
        .iter()
        .map(|p| PhaseLine { name: words(&p.name), time: crate::report::number::duration(p.seconds), share: 100.0 * p.seconds / total })
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
            unit: "1/mm".into(),
            undetermined: undetermined.map(str::to_string),
        }
    }

    #[test]
    fn what_is_undetermined_shows_no_figure_as_if_known() {
        let cell = parameter_cell(&row(0.0, Some(0.0), Some("at most 0.02")));
        assert_eq!((cell.text.as_str(), cell.undetermined.as_str()), ("undetermined", "at most 0.02"));
        let cell = parameter_cell(&row(0.5, None, Some("")));
        assert!(cell.text == "undetermined" && cell.undetermined.contains("unbounded"));
        assert_eq!(parameter_cell(&row(0.5, Some(0.01), None)).text, "0.500 ± 0.010");
    }

    #[test]
    fn a_basis_errors_stand_by_light_angle() {
        let mut all: BTreeMap<String, f64> =
            NAMES.iter().enumerate().map(|(k, n)| (format!("basis_p95_{n}_G"), 0.01 * (k + 1) as f64)).collect();
        all.extend([("basis_rms_half_G".to_string(), 0.25), ("mean_free_path_mm".to_string(), 0.5)]);
        let f = figures(&all);
        assert_eq!(f.methods, ["π/2", "π/4", "π/8"]);
        assert_eq!(f.table[0], ("95 % of the texels within".to_string(), ["1.0 %", "2.0 %", "3.0 %"].map(String::from).to_vec()));
        assert_eq!(f.table[1].1, ["—", "25.0 %", "—"]);
        assert_eq!(f.single, [("mean free path mm".to_string(), "0.5".to_string())]);
        all.insert("basis_p95_steep_R".into(), 0.5);
        assert_eq!(figures(&all).methods[..2], ["π/2 red".to_string(), "π/2 green".to_string()]);
    }

    #[test]
    fn methods_stand_side_by_side() {
        let all = BTreeMap::from([
            ("exact.median_error".to_string(), 0.001),
            ("paper.median_error".to_string(), 0.2),
            ("paper.failed".to_string(), 12.0),
            ("texels".to_string(), 99.0),
        ]);
        let f = figures(&all);
        assert_eq!(f.methods, ["exact", "paper"]);
        assert_eq!(f.table, [("median error".to_string(), vec!["0.001".to_string(), "0.2".to_string()])]);
        assert_eq!(f.single.len(), 2);
    }
}
