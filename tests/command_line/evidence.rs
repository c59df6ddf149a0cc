//! Measured figures are committed as tables, and a page shows each of them as it is measured: no row is missing on the
//! page, none was typed there by hand.

use std::path::Path;

#[test]
fn the_page_of_the_gpu_shows_the_rows_of_its_table() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/evidence");
    let page = std::fs::read_to_string(docs.join("gpu.md")).unwrap();
    let mut shown: Vec<&str> = page.lines().filter(|line| line.starts_with("| ")).collect();
    shown.retain(|line| !line.starts_with("| what |"));
    let mut table = csv::Reader::from_path(docs.join("gpu.csv")).unwrap();
    let names = table.headers().unwrap().clone();
    let mut wanted = Vec::new();
    for row in table.records() {
        let row = row.unwrap();
        let cell = |name: &str| row.get(names.iter().position(|n| n == name).unwrap()).unwrap();
        assert!(cell("value").parse::<f64>().unwrap().is_finite(), "{row:?}");
        assert!(page.contains(&format!("- {}; {}; commit {}", cell("adapter"), cell("processor"), cell("commit"))));
        wanted.push(format!("| {} | {} {} | {} |", cell("what"), cell("value"), cell("unit"), cell("note")));
    }
    assert!(wanted.len() > 100, "only {} rows", wanted.len());
    shown.sort_unstable();
    wanted.sort_unstable();
    assert_eq!(shown, wanted, "`.ci/gpu --page docs/evidence/gpu.csv` makes the page anew");
}
