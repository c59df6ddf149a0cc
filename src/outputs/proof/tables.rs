//! Tables of stress and bench rows.

use crate::bench::BenchRow;
use crate::stress::StressRow;

/// Longest cell of a table, except in the last column. Longer cells end in `…` (JSON has them in full).
const WIDEST: usize = 48;

/// Columns padded to their widest cell. `right` says which are aligned to the right.
fn table(head: &[&str], right: &[bool], rows: &[Vec<String>]) -> String {
    let short = |cell: &str| match cell.chars().count() {
        n if n > WIDEST => cell.chars().take(WIDEST - 1).chain(['…']).collect(),
        _ => cell.to_string(),
    };
    let mut lines: Vec<Vec<String>> = vec![head.iter().map(|h| (*h).to_string()).collect()];
    lines.extend(rows.iter().map(|row| {
        row.iter().enumerate().map(|(k, cell)| if k + 1 < row.len() { short(cell) } else { cell.clone() }).collect()
    }));
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

/// Stress rows as text: one line for each case, then one line for each model with the number of cases that got their
/// verdict and the mean number of digits.
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

/// A time in µs, written in a unit that keeps it short.
fn time(us: f64) -> String {
    match us {
        t if !t.is_finite() => "–".into(),
        t if t < 1.0 => format!("{:.0} ns", t * 1e3),
        t if t < 1e3 => format!("{t:.1} µs"),
        t if t < 1e6 => format!("{:.1} ms", t / 1e3),
        t => format!("{:.2} s", t / 1e6),
    }
}

pub(super) fn names<'a>(all: impl Iterator<Item = &'a str>) -> Vec<String> {
    let mut seen: Vec<String> = Vec::new();
    for name in all {
        if !seen.iter().any(|s| s == name) {
            seen.push(name.to_string());
        }
    }
    seen
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
