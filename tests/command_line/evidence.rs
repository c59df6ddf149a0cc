//! Measured figures are committed as tables, and a page shows each of them as it is measured: no row is missing on the
//! page, none was typed there by hand. Other pages cite rows by their names.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("docs")
}

/// The rows of a table of figures, each a cell by its column.
fn rows(name: &str) -> Vec<BTreeMap<String, String>> {
    let mut table = csv::Reader::from_path(docs().join("evidence").join(name)).unwrap();
    let names = table.headers().unwrap().clone();
    let row = |row: csv::StringRecord| names.iter().map(String::from).zip(row.iter().map(String::from)).collect();
    table.records().map(|record| row(record.unwrap())).collect()
}

/// A page shows exactly the rows of its table.
#[track_caller]
fn shows(name: &str, least: usize, made_by: &str, facts: impl Fn(&BTreeMap<String, String>) -> String) {
    let page = std::fs::read_to_string(docs().join("evidence").join(name).with_extension("md")).unwrap();
    let mut shown: Vec<&str> = page.lines().filter(|line| line.starts_with("| ")).collect();
    shown.retain(|line| !line.starts_with("| what |"));
    let mut wanted = Vec::new();
    for row in rows(name) {
        assert!(row["value"] == "–" || row["value"].parse::<f64>().unwrap().is_finite(), "{row:?}");
        assert!(page.contains(&facts(&row)), "{row:?}");
        let [what, note] = ["what", "note"].map(|column| row[column].replace('|', "\\|"));
        wanted.push(format!("| {what} | {} {} | {note} |", row["value"], row["unit"]));
    }
    assert!(wanted.len() >= least, "only {} rows", wanted.len());
    shown.sort_unstable();
    wanted.sort_unstable();
    assert_eq!(shown, wanted, "{made_by} makes the page anew");
}

#[test]
fn the_page_of_the_gpu_shows_the_rows_of_its_table() {
    let facts = |row: &BTreeMap<String, String>| {
        format!("- {}; {}; commit {}", row["adapter"], row["processor"], row["commit"])
    };
    shows("gpu.csv", 100, "`.ci/gpu --page docs/evidence/gpu.csv`", facts);
}

#[test]
fn the_page_of_what_is_measured_shows_the_rows_of_its_table() {
    let facts =
        |row: &BTreeMap<String, String>| format!(" {}; commit {}, {}.", row["processor"], row["commit"], row["date"]);
    shows("measured.csv", 100, "`.ci/evidence --page docs/evidence/measured.csv`", facts);
}

/// A link to the page of measured figures whose title names a part and a row stands for that row, and its words hold
/// the row's value: `[0.0157 µs](evidence/measured.md "bench/beam, exact: f64")`.
#[test]
fn every_cited_row_is_there_with_its_value() {
    let table = rows("measured.csv");
    let mut cited = 0;
    let folders = [docs(), docs().join("evidence")].map(|folder| std::fs::read_dir(folder).unwrap());
    for file in folders.into_iter().flatten().flatten().map(|f| f.path()) {
        if file.extension().is_none_or(|e| e != "md") {
            continue;
        }
        let page = std::fs::read_to_string(&file).unwrap();
        for (before, after) in page.match_indices("measured.md \"").map(|(k, m)| page.split_at(k + m.len())) {
            let name = after.split('"').next().unwrap();
            let (part, what) = name.split_once(", ").unwrap_or((name, ""));
            let row = table.iter().find(|row| row["part"] == part && row["what"] == what);
            let row = row.unwrap_or_else(|| panic!("{}: there is no row {name:?}", file.display()));
            let words = before.rsplit('[').next().unwrap().split(']').next().unwrap();
            let said: f64 = words.split_whitespace().next().unwrap().parse().unwrap();
            let value: f64 = row["value"].parse().unwrap();
            assert!((said / value - 1.0).abs() < 0.06, "{}: {words:?} for {value}", file.display());
            cited += 1;
        }
    }
    assert!(cited > 0, "no page cites a measured row");
}

/// The tables of totals on the page of the random walk show the measured rows: for each of the walk's totals a line has
/// it with its error, and beside it what a form is off by (per cent).
#[test]
fn the_page_of_the_random_walk_shows_the_measured_totals() {
    let page = std::fs::read_to_string(docs().join("evidence/translucency-walk.md")).unwrap();
    let number = |text: &str| text.split_whitespace().next().and_then(|word| word.parse::<f64>().ok());
    let mut shown = 0;
    for row in rows("measured.csv").iter().filter(|row| row["what"].starts_with("oracle: ")) {
        let forms = [", dipoles 3: ", ", images: ", ", thin: ", ", slab: "];
        let Some((_, of)) =
            row["note"].rsplit_once("oracle ").filter(|_| forms.iter().any(|f| row["what"].contains(f)))
        else {
            continue;
        };
        let Some((total, error)) = of.split_once(" ± ").and_then(|(t, e)| Some((number(t)?, e.parse::<f64>().ok()?)))
        else {
            continue;
        };
        // Smaller totals stand there with other digits.
        if total < 5e-4 {
            continue;
        }
        let walk = format!("| {total:.4} ± {error:.4} |");
        let off = row["note"].strip_prefix("error ").and_then(|rest| number(rest.split(':').next()?));
        let says = |cell: &str| match off {
            // Rows have three digits.
            Some(off) => number(cell).is_some_and(|said| (said - 100.0 * off).abs() < 0.06 + 0.6 * off.abs()),
            None => cell.trim() == "–",
        };
        let told = page.lines().any(|line| line.split_once(&walk).is_some_and(|(_, rest)| rest.split('|').any(says)));
        assert!(told, "{} {}: no line has {walk} and what the form is off by", row["what"], row["note"]);
        shown += 1;
    }
    assert!(shown > 200, "only {shown} rows");
}
