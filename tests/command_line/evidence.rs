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
