//! The messages on standard error: a line every ten seconds during long work, nothing with `--quiet`, and nothing that
//! other libraries print.
#![cfg(unix)]

use crate::blade::{Blade, scene};
use crate::common::{mesophyll, refused};
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The program without `--quiet`.
fn loud() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mesophyll"));
    command.current_dir(env!("CARGO_MANIFEST_DIR"));
    command
}

/// Reads standard error until a line has all the words of `last`. Returns the first line with the words of `first`, the
/// time from `start` to when it came, and the last line. Then, or after three minutes, the program is ended.
fn lines_with(mut child: Child, start: Instant, first: &[&str], last: &[&str]) -> (String, Duration, String) {
    let (send, receive) = std::sync::mpsc::channel();
    let lines = BufReader::new(child.stderr.take().unwrap()).lines();
    std::thread::spawn(move || lines.map_while(Result::ok).for_each(|line| drop(send.send(line))));
    let (mut all, mut began) = (Vec::new(), None);
    while let Ok(line) = receive.recv_timeout(Duration::from_secs(180).saturating_sub(start.elapsed())) {
        all.push(line.clone());
        let has = |words: &[&str]| words.iter().all(|w| line.contains(w));
        if has(first) && began.is_none() {
            began = Some((line.clone(), start.elapsed()));
        }
        if let Some((began, after)) = began.clone().filter(|_| has(last)) {
            let _ = (child.kill(), child.wait());
            return (began, after, line);
        }
    }
    let _ = (child.kill(), child.wait());
    panic!("no lines with {first:?} and {last:?} within three minutes in: {all:#?}");
}

/// Stops a process or lets it go on.
fn signal(child: &Child, name: &str) {
    assert!(Command::new("kill").args([name, &child.id().to_string()]).status().unwrap().success());
}

#[test]
fn long_work_says_every_ten_seconds_how_far_it_is() {
    let dir = tempfile::tempdir().unwrap();
    let synth = |command: &mut Command, name: &str| {
        let long = ["synth", "data/leaves/elm.toml", "--size", "64x48", "--frames", "10000", "--threads", "1", "-o"];
        command.args(long).arg(dir.path().join(name)).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let mut quiet = synth(&mut mesophyll(), "quiet");
    let (loud, start) = (synth(&mut loud(), "loud"), Instant::now());
    // From the first frames on, both stand still until the ninth second, so that the machine is free for other work.
    // The time of their lines goes on.
    let begun = |name: &str| dir.path().join(name).join("front/x/0001.exr").exists();
    while !(begun("quiet") && begun("loud")) && start.elapsed() < Duration::from_secs(9) {
        std::thread::sleep(Duration::from_millis(5));
    }
    [&quiet, &loud].into_iter().for_each(|child| signal(child, "-STOP"));
    std::thread::sleep(Duration::from_secs(9).saturating_sub(start.elapsed()));
    [&quiet, &loud].into_iter().for_each(|child| signal(child, "-CONT"));
    // The first line describes the work at that moment: growing the leaf, or its first frames.
    let scanning = ["synth: scanning: ", " of 40000 (", " left"];
    let (line, after, last) = lines_with(loud, start, &["synth: ", " s"], &scanning);
    assert!(after > Duration::from_secs(8) && after < Duration::from_secs(25), "{line} came after {after:?}");
    let done: u64 = last.split(' ').nth(2).unwrap().parse().unwrap();
    assert!(done > 0, "{last}");
    quiet.kill().unwrap();
    let mut said = String::new();
    quiet.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert_eq!(said, "", "--quiet is not quiet");
    quiet.wait().unwrap();
}

/// There is no display, as on a server. libwayland complained about XDG_RUNTIME_DIR here whenever Mesa looked for one.
#[test]
#[cfg(feature = "render")]
fn libraries_say_nothing_where_there_is_no_display() {
    let dir = tempfile::tempdir().unwrap();
    Blade { width: 24, height: 18, texel_mm: 2.0, ..Blade::default() }.write(&dir.path().join("fits/elm"), "elm");
    let scene = scene(dir.path(), "front", "elm", Some(30.0), None, "");
    for folder in [None, Some("not/absolute")] {
        let mut command = mesophyll();
        for name in ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET", "XDG_RUNTIME_DIR"] {
            command.env_remove(name);
        }
        command.envs(folder.map(|f| ("XDG_RUNTIME_DIR", f)));
        let output = command.arg("check").arg(&scene).arg("--out").arg(dir.path().join("out")).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(said.lines().all(|l| l.starts_with("mesophyll: ")), "{said}");
        let mut command = mesophyll();
        for name in ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET", "XDG_RUNTIME_DIR"] {
            command.env_remove(name);
        }
        let output = command.arg("view").arg(&scene).arg("--out").arg(dir.path().join("view")).output().unwrap();
        refused(&output, 1, &["the window could not be opened: there is no display here"]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!said.contains(".rs") && !said.contains("os error"), "a place in a source file: {said}");
    }
}
