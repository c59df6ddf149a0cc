//! `make demo` and `make fits` end with the program's result and say where to look. A script replaces the program.
#![cfg(unix)]

use std::os::unix::fs::PermissionsExt;
use std::process::Command;

/// Runs `make TARGET` in a fresh folder. The program's `run` ends with `code`, with or without writing a report.
/// Returns whether make succeeded, and what it printed.
fn make(target: &str, code: i32, report: bool) -> (bool, String) {
    let dir = tempfile::tempdir().unwrap();
    let stub = dir.path().join("stub");
    let write =
        if report { format!("mkdir -p out/{target}; echo new > out/{target}/report.html;") } else { String::new() };
    std::fs::write(&stub, format!("#!/bin/sh\n[ \"$1\" = run ] || exit 0\n{write}\nexit {code}\n")).unwrap();
    std::fs::set_permissions(&stub, std::fs::Permissions::from_mode(0o755)).unwrap();
    // A report of an earlier run must not be taken for this run's report.
    std::fs::create_dir_all(dir.path().join("out").join(target)).unwrap();
    std::fs::write(dir.path().join("out").join(target).join("report.html"), "old").unwrap();
    let makefile = concat!(env!("CARGO_MANIFEST_DIR"), "/Makefile");
    let mut command = Command::new("make");
    // The variables that an outer make passes on are removed.
    command.env_remove("MAKEFLAGS").env_remove("MAKELEVEL").current_dir(dir.path());
    let output =
        command.args(["-f", makefile, "-o", "build", target, "MESOPHYLL=./stub"]).output().expect("make starts");
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    (output.status.success(), said)
}

#[test]
fn a_target_ends_with_the_code_of_the_program_and_says_where_to_look() {
    for target in ["demo", "fits"] {
        let report = format!("open out/{target}/report.html");
        let (fine, said) = make(target, 0, true);
        assert!(fine && said.contains(&format!("Done: {report}")), "{said}");
        // A picture missed its limit, and the report says which one.
        let (fine, said) = make(target, 1, true);
        assert!(!fine && said.contains("Error 1") && said.contains("Not good") && said.contains(&report), "{said}");
        // There is no report: no adapter, a full disk, or a program that was killed.
        for code in [1, 2, 139] {
            let (fine, said) = make(target, code, false);
            assert!(!fine && said.contains(&format!("Error {code}")), "{said}");
            assert!(
                said.contains("no report was written") && !said.contains("Done") && !said.contains("open out"),
                "{said}"
            );
        }
    }
}
