//! Helpers for tests that run the program: running it, small synthetic captures, and places that cannot be written.
#![allow(dead_code)]

pub mod kept;
pub mod skips;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The program under test.
pub fn mesophyll() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mesophyll"));
    command.current_dir(env!("CARGO_MANIFEST_DIR")).arg("--quiet");
    command
}

/// Runs the program with arguments. Panics only when it cannot be started.
pub fn run<S: AsRef<std::ffi::OsStr>>(args: impl IntoIterator<Item = S>) -> Output {
    mesophyll().args(args).output().expect("the binary starts")
}

/// Asserts an exit code, one sentence on stderr that contains every given word, and no panic.
#[track_caller]
pub fn refused(output: &Output, code: i32, words: &[&str]) {
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "stderr: {text}");
    assert!(!text.contains("panicked"), "{text}");
    assert_eq!(text.trim().lines().count(), 1, "one sentence expected: {text}");
    for word in words {
        assert!(text.contains(word), "{word:?} is missing in: {text}");
    }
}

#[track_caller]
pub fn succeeded(output: &Output) {
    assert!(output.status.success(), "stderr: {}", String::from_utf8_lossy(&output.stderr));
}

/// Asserts that a fit was written, whatever the verdict on it: exit code 0, or 1 with the sentence that it is not good.
#[track_caller]
pub fn was_fitted(output: &Output) {
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() || (output.status.code() == Some(1) && text.contains("is not good")), "{text}");
}

/// A synthetic scan of `SPEC` of `data/leaves` (without the extension) in a fresh folder.
pub fn scan(folder: &Path, spec: &str, extra: &[&str]) -> PathBuf {
    let capture = folder.join("scan");
    let spec = format!("data/leaves/{spec}.toml");
    let mut args = vec!["synth", spec.as_str(), "-o", capture.to_str().expect("a UTF-8 path")];
    args.extend(extra);
    succeeded(&run(args));
    capture
}

/// Starts a synthesis on one thread, and returns when it has written its first frame and has many left.
pub fn begun_synthesis(scan: &Path) -> std::process::Child {
    let args = ["synth", "data/leaves/elm.toml", "--size", "240x180", "--frames", "60", "--threads", "1", "-o"];
    let mut child = mesophyll().args(args).arg(scan).stderr(std::process::Stdio::piped()).spawn().expect("it starts");
    while !scan.join("front/x/0001.exr").exists() && child.try_wait().expect("it runs").is_none() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    child
}

/// Copies a folder tree.
pub fn copy_tree(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("folder");
    for entry in std::fs::read_dir(from).expect("readable").flatten() {
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy_tree(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).expect("copied");
        }
    }
}
