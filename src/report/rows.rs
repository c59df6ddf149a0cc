//! Tables and plots of stress and bench rows.

use crate::files::atomic;
use crate::fit::bench::BenchRow;
use crate::fit::stress::StressRow;
use crate::{Error, Result};
use plotters::prelude::*;
use std::path::{Path, PathBuf};

/// Longest cell of a table, the last column's aside; longer ones end in `…` (JSON has them whole).
const WIDEST: usize = 48;

/// Columns padded to their widest cell; `right` says which are aligned to the right.
fn table(head: &[&str], right: &[bool], rows: &[Vec<String>]) -> String {
    let short = |cell: &str| match cell.chars().count() {
        n if n > WIDEST => cell.chars().take(WIDEST - 1).chain(['…']).collect(),
        _ => cell.to_string(),
    };
    let mut lines: Vec<Vec<String>> = vec![head.iter().map(|h| (*h).to_string()).collect()];
    lines.extend(
        rows.iter().map(|row| row.iter().enumerate().map(|(k, cell)| if k + 1 < row.len() { short(cell) } else { cell.clone() }).collect()),
    );
    let width = |k: usize| lines.iter().map(|l| l[k].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let mut text = String::new();
    for line in &lines {
        let cells: Vec<String> = line
            .iter()
            .enumerate()
            .map(|(k, cell)| {
                let pad = " ".repeat(widths[k] - cell.chars().count());
                if right[k] { format!("{pad}{cell}") } else { format!("{cell}{pad}") }
            })
            .collect();
        text.push_str(cells.join("  ").trim_end());
        text.push('\n');
    }
    text
}

fn number(value: Option<f64>, show: impl Fn(f64) -> String) -> String {
    value.map_or(String::new(), |v| if v.is_finite() { show(v) } else { "∞".into() })
}

/// Stress rows as text: a line a case, then a line a model with how many got their verdict and the digits on average.
pub fn stress_table(rows: &[StressRow]) -> String {
    let cells: Vec<Vec<String>> = rows
        .iter()
        .map(|r| {
            vec![
                if r.passed() { String::new() } else { "!".into() },
                r.model.clone(),
                r.case.clone(),
                r.expected.clone(),
                r.verdict.clone(),
                number(r.digits, |d| format!("{d:.1}")),
                number(r.condition, |c| format!("{c:.1e}")),
                format!("{:.2}", r.ms),
            ]
        })
        .collect();
    let head = ["", "model", "case", "expected", "verdict", "digits", "condition", "ms"];
    let mut text = table(&head, &[false, false, false, false, false, true, true, true], &cells);
    for model in names(rows.iter().map(|r| r.model.as_str())) {
        let of: Vec<&StressRow> = rows.iter().filter(|r| r.model == model).collect();
        let met = of.iter().filter(|r| r.passed()).count();
        let digits: Vec<f64> = of.iter().filter_map(|r| r.digits).collect();
        let mean = match digits.len() {
            0 => String::new(),
            n => format!(", {:.2} digits on average", digits.iter().sum::<f64>() / n as f64),
        };
        text.push_str(&format!("{model}: {met} of {} cases as expected{mean}\n", of.len()));
    }
    text
}

/// Bench rows as text.
pub fn bench_table(rows: &[BenchRow]) -> String {
    let cells: Vec<Vec<String>> = rows
        .iter()
        .map(|r| {
            let error = if r.error.is_finite() { format!("{:.1e}", r.error) } else { "–".into() };
            vec![r.model.clone(), r.knob.clone(), r.setting.clone(), error, time(r.us), r.note.clone()]
        })
        .collect();
    table(&["model", "knob", "setting", "error", "time", "note"], &[false, false, false, true, true, false], &cells)
}

/// A time in µs with a unit that keeps it short.
fn time(us: f64) -> String {
    match us {
        t if !t.is_finite() => "–".into(),
        t if t < 1.0 => format!("{:.0} ns", t * 1e3),
        t if t < 1e3 => format!("{t:.1} µs"),
        t if t < 1e6 => format!("{:.1} ms", t / 1e3),
        t => format!("{:.2} s", t / 1e6),
    }
}

fn names<'a>(all: impl Iterator<Item = &'a str>) -> Vec<String> {
    let mut seen: Vec<String> = Vec::new();
    for name in all {
        if !seen.iter().any(|s| s == name) {
            seen.push(name.to_string());
        }
    }
    seen
}

/// Draws a plot a model into `folder` (`bench-<model>.svg`): error against run time, a line a knob, both axes logarithmic. Models without a row
/// of positive error and time get none. Returns the files.
///
/// # Errors
/// [`Error::Write`] where a file cannot be written.
pub fn bench_plots(rows: &[BenchRow], folder: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for model in names(rows.iter().map(|r| r.model.as_str())) {
        let drawable = |r: &&BenchRow| r.model == model && r.error > 0.0 && r.us > 0.0 && r.error.is_finite() && r.us.is_finite();
        let of: Vec<&BenchRow> = rows.iter().filter(drawable).collect();
        if of.is_empty() {
            continue;
        }
        let path = folder.join(format!("bench-{model}.svg"));
        let svg = plot(&model, &of).map_err(|e| Error::write(&path, e))?;
        atomic::write_bytes(&path, svg.as_bytes())?;
        files.push(path);
    }
    Ok(files)
}

/// Range of values with room at both ends of a logarithmic axis.
fn span(values: impl Iterator<Item = f64> + Clone) -> std::ops::Range<f64> {
    let low = values.clone().fold(f64::INFINITY, f64::min);
    let high = values.fold(0.0, f64::max);
    low / 1.6..high * 2.5
}

fn plot(model: &str, rows: &[&BenchRow]) -> std::result::Result<String, String> {
    let text = |e: &dyn std::fmt::Display| format!("cannot draw: {e}");
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (860, 560)).into_drawing_area();
        area.fill(&WHITE).map_err(|e| text(&e))?;
        let mut chart = ChartBuilder::on(&area)
            .caption(format!("{model}: error against run time"), ("sans-serif", 20))
            .margin(14)
            .x_label_area_size(46)
            .y_label_area_size(72)
            .build_cartesian_2d(span(rows.iter().map(|r| r.us)).log_scale(), span(rows.iter().map(|r| r.error)).log_scale())
            .map_err(|e| text(&e))?;
        chart
            .configure_mesh()
            .x_desc("run time (µs)")
            .y_desc("error")
            .x_label_formatter(&|v| format!("{v:.0e}"))
            .y_label_formatter(&|v| format!("{v:.0e}"))
            .bold_line_style(RGBColor(214, 214, 214))
            .light_line_style(RGBColor(240, 240, 240))
            .draw()
            .map_err(|e| text(&e))?;
        for (k, knob) in names(rows.iter().map(|r| r.knob.as_str())).into_iter().enumerate() {
            let color = COLORS[k % COLORS.len()];
            let of: Vec<&&BenchRow> = rows.iter().filter(|r| r.knob == knob).collect();
            let points = of.iter().map(|r| (r.us, r.error));
            // Peers and the like are points without an order; a knob's settings follow one another.
            let apart = ["peer", "method", "lobe"].contains(&knob.as_str());
            if !apart {
                chart.draw_series(LineSeries::new(points.clone(), color.stroke_width(2))).map_err(|e| text(&e))?;
            }
            chart
                .draw_series(points.map(|p| Circle::new(p, 4, color.filled())))
                .map_err(|e| text(&e))?
                .label(knob.as_str())
                .legend(move |(x, y)| Circle::new((x + 8, y), 4, color.filled()));
            // The ends of a knob are named, what lies between follows; names of all settings would cover one another.
            let named = of.iter().enumerate().filter(|(k, _)| apart || *k == 0 || k + 1 == of.len()).map(|(_, r)| r);
            let style = ("sans-serif", 12).into_font().color(&color);
            chart.draw_series(named.map(|r| Text::new(r.setting.clone(), (r.us * 1.05, r.error), style.clone()))).map_err(|e| text(&e))?;
        }
        chart
            .configure_series_labels()
            // Slow and wrong at once: the emptiest corner.
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE.mix(0.85))
            .border_style(RGBColor(180, 180, 180))
            .draw()
            .map_err(|e| text(&e))?;
        area.present().map_err(|e| text(&e))?;
    }
    Ok(svg)
}

/// Told apart by readers who do not see every colour alike (Okabe and Ito, "Color universal design", 2008).
pub(super) const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(60, 60, 60),
];

#[cfg(test)]
mod tests {
    use super::*;

    fn bench(knob: &str, error: f64, us: f64) -> BenchRow {
        BenchRow { model: "m".into(), knob: knob.into(), setting: "4".into(), error, us, note: "a < b & c".into() }
    }

    #[test]
    fn tables_align_and_mark_what_missed() {
        let row = |case: &str, verdict: &str| StressRow {
            model: "m".into(),
            case: case.into(),
            expected: "ok".into(),
            verdict: verdict.into(),
            digits: Some(9.5),
            condition: Some(f64::INFINITY),
            ms: 1.0,
        };
        let text = stress_table(&[row("δ = 1", "ok"), row(&"long ".repeat(20), "undetermined: b1")]);
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[2].starts_with('!') && lines[1].starts_with(' ') && lines[2].contains('…'));
        assert_eq!(lines[3], "m: 1 of 2 cases as expected, 9.50 digits on average");
        let column = |l: &str| l.chars().collect::<Vec<_>>().iter().rposition(|c| *c == '∞');
        assert_eq!(column(lines[1]), column(lines[2]));
    }

    #[test]
    fn times_have_units() {
        assert_eq!([time(0.25), time(12.34), time(1.5e3), time(2.5e6)], ["250 ns", "12.3 µs", "1.5 ms", "2.50 s"]);
    }

    #[test]
    fn a_plot_is_written_for_drawable_rows_only() {
        let folder = tempfile::tempdir().unwrap();
        let rows = [bench("nodes", 1e-3, 4.0), bench("nodes", 1e-6, 40.0), bench("exact", 0.0, 90.0)];
        let files = bench_plots(&rows, folder.path()).unwrap();
        let svg = std::fs::read_to_string(&files[0]).unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("nodes") && svg.matches("<circle").count() >= 2);
        assert!(!svg.contains("exact"));
        assert!(bench_plots(&rows[2..], folder.path()).unwrap().is_empty());
    }
}
