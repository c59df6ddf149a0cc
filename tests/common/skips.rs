//! The things that some tests need besides Rust. Where one is missing, the test calls [`skip`] and returns. The skip is
//! counted in a file under `target/`, because the test harness hides the output of tests that pass; `make test` prints
//! the sum at its end. With `MESOPHYLL_REQUIRE_ALL`, as in continuous integration, a skip is a failure. Databases that
//! are not part of the repository are the exception.
//!
//! The library, `tests/` and `viewer/tests` share this file by `#[path]`.
#![allow(dead_code)]

use std::io::Write;
use std::path::PathBuf;

/// A thing that a test needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// A graphics adapter, which may be a software adapter.
    Adapter,
    /// A C compiler (`cc`).
    Compiler,
    /// A virtual display (`xvfb-run`).
    Display,
    /// A program of the operating system.
    System,
    /// Real measurements in the folder `MESOPHYLL_DATA`. They are not in the repository, so they cannot be required.
    Data,
    /// A foreign program that Debian has no package of, such as Khronos' glTF validator, or a large one, such as a
    /// browser.
    Peer,
    /// A property that one graphics interface has and another has not.
    Elsewhere,
}

/// Counts the calling test as skipped, for `why`.
///
/// # Panics
/// Where everything is required (`MESOPHYLL_REQUIRE_ALL`) and the thing can be installed.
pub fn skip(need: Need, why: &str) {
    let test = std::thread::current().name().unwrap_or("a test").to_string();
    let required = std::env::var_os("MESOPHYLL_REQUIRE_ALL").is_some_and(|v| !v.is_empty() && v != "0");
    let optional = matches!(need, Need::Data | Need::Peer | Need::Elsewhere);
    assert!(
        optional || !required,
        "{test}: {why}, but MESOPHYLL_REQUIRE_ALL is set: install what is missing (`make setup-test`)"
    );
    println!("skipped: {why}");
    let file = list().expect("a skipped test is counted: the test lies in Cargo's folder, or MESOPHYLL_SKIPPED is set");
    let line = format!("{why}\t{test}\n");
    if let Ok(mut out) = std::fs::OpenOptions::new().create(true).append(true).open(file) {
        let _ = out.write_all(line.as_bytes());
    }
}

/// The file that `MESOPHYLL_SKIPPED` names, or `target/skipped-tests.txt`. `target` is the folder with Cargo's notes
/// about the compiler that holds the running test. (Cargo's mark `CACHEDIR.TAG` is missing where another program made
/// the folder.)
fn list() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os("MESOPHYLL_SKIPPED") {
        return Some(named.into());
    }
    let me = std::env::current_exe().ok()?;
    let target = me.ancestors().find(|folder| folder.join(".rustc_info.json").is_file())?;
    Some(target.join("skipped-tests.txt"))
}

/// The folder of real measurements, or a skip.
pub fn data(what: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("MESOPHYLL_DATA").map(PathBuf::from);
    if folder.is_none() {
        skip(Need::Data, &format!("MESOPHYLL_DATA is not set ({what})"));
    }
    folder
}

/// Whether the program said that there is no adapter. Then the calling test is skipped.
pub fn no_adapter(output: &std::process::Output) -> bool {
    let none = String::from_utf8_lossy(&output.stderr).contains("no graphics adapter");
    if none {
        assert_eq!(output.status.code(), Some(1), "a check that looked at nothing must not pass");
        skip(Need::Adapter, "no graphics adapter");
    }
    none
}
