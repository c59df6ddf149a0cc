//! The check: pictures of generated leaves against the reference, and that what must fail does fail.
#![cfg(feature = "render")]

mod common;

use common::{Blade, rehash, scene};
use serde_json::Value;
use std::path::Path;
use std::process::Output;

const CARD: &str = r#"
[[view]]
name = "card"
kind = "card"
leaf = "elm"
eye_mm = [20, -40, 90]
target_mm = [0, 0, 0]
fov_deg = 10
max_error = 1e-3
"#;

fn check(path: &Path, args: &[&str]) -> Output {
    let out = path.with_extension("out");
    assert_cmd::Command::cargo_bin("mesophyll").unwrap().arg("check").arg(path).arg("--json").arg("--out").arg(out).args(args).output().unwrap()
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&output.stderr)))
}

/// Machines without any adapter cannot look; they say so and the tests that need one are skipped.
fn no_adapter(output: &Output) -> bool {
    let none = String::from_utf8_lossy(&output.stderr).contains("no graphics adapter");
    if none {
        assert_eq!(output.status.code(), Some(1));
        eprintln!("skipped: no graphics adapter");
    }
    none
}

#[test]
fn a_leaf_lit_from_the_front_matches_its_reference_and_its_closed_form() {
    let dir = tempfile::tempdir().unwrap();
    Blade::default().write(&dir.path().join("fits/elm"), "elm");
    let output = check(&scene(dir.path(), "front", "elm", Some(30.0), Some(0.3), CARD), &[]);
    if no_adapter(&output) {
        return;
    }
    let report = json(&output);
    assert_eq!(output.status.code(), Some(0), "{report:#}");
    assert_eq!(report["passed"], true);
    assert!(report["adapter"].as_str().is_some_and(|a| !a.is_empty()));
    for view in report["views"].as_array().unwrap() {
        for key in ["flip_mean", "flip_p99", "max_error", "frame_ms_median", "frame_ms_p95"] {
            assert!(view[key].is_number(), "{key}: {view:#}");
        }
        for key in ["image", "reference", "difference"] {
            assert!(dir.path().join("front.out").join(view[key].as_str().unwrap()).is_file());
        }
    }
    println!("{report:#}");
}
