//! The solver as a user runs it, by `mesophyll stress` and `mesophyll bench`.

use assert_cmd::Command;
use serde_json::Value;

fn mesophyll() -> Command {
    Command::cargo_bin("mesophyll").expect("the binary is built with the tests")
}

fn rows(arguments: &[&str]) -> Vec<Value> {
    let output = mesophyll().args(arguments).assert().code(0).get_output().stdout.clone();
    let value: Value = serde_json::from_slice(&output).expect("JSON on standard output");
    value["rows"].as_array().expect("a field rows").clone()
}

#[test]
fn stress_nist_solves_all_54_runs() {
    let rows = rows(&["stress", "nist", "--json"]);
    assert_eq!(rows.len(), 54);
    let mut digits = 0.0;
    for row in &rows {
        for field in ["model", "case", "expected", "verdict", "digits", "condition", "ms"] {
            assert!(!row[field].is_null(), "{row} has no {field}");
        }
        assert_eq!((row["expected"].as_str(), row["verdict"].as_str()), (Some("ok"), Some("ok")), "{row}");
        assert!(row["detail"].as_str().unwrap().starts_with("ok"), "{row}");
        digits += row["digits"].as_f64().unwrap();
    }
    assert!(digits / 54.0 >= 10.0, "{} digits on average", digits / 54.0);
}

#[test]
fn every_table_of_stress_gets_the_verdicts_it_expects() {
    // The list of tables comes from the program's message for an unknown name, so a new table is run here too. For most
    // tables this is the only test. The rooms' own tests run a table again only where they test more of it.
    let said = mesophyll().args(["stress", "no-such-model"]).assert().code(2).get_output().stderr.clone();
    let said = String::from_utf8(said).unwrap();
    let list = said
        .split_once("possible values: ")
        .and_then(|(_, rest)| rest.split_once(']'))
        .expect("a list of the tables")
        .0;
    let mut tables: Vec<&str> = list.split(", ").collect();
    assert!(tables.len() >= 9, "{said}");
    // The 10,000 texels of `coverage` take half a minute in an optimised build, and minutes here. A test of
    // `proof::coverage` has a thousand of them. The test above runs `nist`.
    tables.retain(|t| !["all", "coverage", "nist"].contains(t));
    let rows = rows(&[&["stress"], &tables[..], &["--json"]].concat());
    for model in tables {
        assert!(rows.iter().filter(|r| r["model"] == model).count() >= 10, "{model} has few rows");
    }
    for row in &rows {
        assert_eq!(row["expected"], row["verdict"], "{row}");
        assert!(row["detail"].as_str().unwrap().starts_with(row["expected"].as_str().unwrap()), "{row}");
        // Where a fit of gloss promises an answer, it has the digits that the noise allows (at 1 %, two to three and a
        // half).
        if row["model"] == "gloss" && row["expected"] == "ok" {
            assert!(row["digits"].as_f64().is_some_and(|digits| digits > 1.0), "{row}");
        }
    }
    assert!(rows.iter().filter(|r| r["model"] == "slab").count() > 50);
}

#[test]
fn stress_solve_prints_a_table_and_names_its_cases() {
    let output = mesophyll().args(["stress", "solve"]).assert().code(0).get_output().stdout.clone();
    let text = String::from_utf8(output).unwrap();
    for word in ["only a product matters", "undetermined: b1 b2", "refused: not_finite", "cases as expected"] {
        assert!(text.contains(word), "{word:?} is missing from\n{text}");
    }
}

#[test]
fn unknown_names_are_usage_errors_with_the_list() {
    for verb in ["stress", "bench"] {
        let output = mesophyll().args([verb, "no-such-model"]).assert().code(2).get_output().clone();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(said.contains("no-such-model") && said.contains("solve"), "{said}");
        assert!(output.stdout.is_empty());
    }
}

#[test]
fn bench_gives_rows_a_plot_and_the_frontier_and_skips_missing_peers_with_a_word() {
    let folder = tempfile::tempdir().unwrap();
    let output = mesophyll()
        .args(["bench", "solve", "--peers", "--json", "-o", folder.path().to_str().unwrap()])
        .env("MESOPHYLL_PYTHON", "no-such-python")
        .assert()
        .code(0);
    let output = output.get_output();
    assert!(String::from_utf8_lossy(&output.stderr).contains("skipped"));
    let value: Value = serde_json::from_slice(&output.stdout).unwrap();
    let rows = value["rows"].as_array().unwrap();
    assert!(!rows.is_empty() && rows.iter().all(|r| r["knob"] != "peer"));
    let errors = |knob: &str| -> Vec<f64> {
        rows.iter().filter(|r| r["knob"] == knob).map(|r| r["error"].as_f64().unwrap()).collect()
    };
    // Errors (unlike times) are the same on every machine. More iterations, a tighter tolerance and the refinement give
    // more digits.
    for knob in ["iterations at most", "tolerance", "refinement"] {
        let e = errors(knob);
        assert!(e.len() >= 2 && e.last() < e.first(), "{knob}: {e:?}");
    }
    assert!(rows.iter().all(|r| r["us"].as_f64().unwrap() > 0.0));
    let svg = std::fs::read_to_string(folder.path().join("bench-solve.svg")).unwrap();
    assert!(svg.contains("run time"));
    assert!(folder.path().join("bench.json").exists());
}
