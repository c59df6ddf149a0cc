//! Skipped tests are counted and named at the end of `make test`. Where everything is required, they are failures.
#![cfg(unix)]

#[path = "common/skips.rs"]
mod skips;

use skips::Need;
use std::path::Path;
use std::process::{Command, Output};

/// A process that runs a test which skips for `need`. `require` is set as in continuous integration.
fn child(need: &str, require: &str, list: &Path) -> Output {
    Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "child_that_skips", "--ignored", "--nocapture"])
        .env("MESOPHYLL_SKIPPED", list)
        .env("MESOPHYLL_REQUIRE_ALL", require)
        .env("MESOPHYLL_SKIP_FOR", need)
        .output()
        .unwrap()
}

#[test]
#[ignore = "run by a_skip_is_counted_and_fails_where_all_is_required"]
fn child_that_skips() {
    match std::env::var("MESOPHYLL_SKIP_FOR").as_deref() {
        Ok("adapter") => skips::skip(Need::Adapter, "no graphics adapter"),
        Ok("data") => skips::skip(Need::Data, "MESOPHYLL_DATA is not set (a table)"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_skip_is_counted_and_fails_where_all_is_required() {
    let dir = tempfile::tempdir().unwrap();
    let list = dir.path().join("skipped.txt");
    let summary = || {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join(".ci/skipped");
        let out = Command::new("bash").arg(script).env("MESOPHYLL_SKIPPED", &list).output().unwrap();
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8(out.stdout).unwrap()
    };
    assert_eq!(summary(), "skipped tests: 0\n");
    for (need, require, passes) in
        [("adapter", "", true), ("data", "1", true), ("adapter", "1", false), ("adapter", "0", true)]
    {
        let out = child(need, require, &list);
        let said = String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.success(), passes, "{need}, required: {require:?}: {said}");
        assert!(
            said.contains(if passes { "skipped: " } else { "no graphics adapter, but MESOPHYLL_REQUIRE_ALL is set" }),
            "{said}"
        );
    }
    // The same test, skipped twice, counts once.
    let said = summary();
    assert!(said.starts_with("skipped tests: 2\n"), "{said}");
    assert!(
        said.contains("  1: no graphics adapter\n") && said.contains("  1: MESOPHYLL_DATA is not set (a table)\n"),
        "{said}"
    );
}
