//! What a user may ask for: files without an end, little memory, long words in messages, and cells that a spreadsheet
//! would run.
#![cfg(unix)]

use crate::common::{mesophyll, refused, run, succeeded};
use std::fs;
use std::process::{Command, Output};

/// Runs the program with 200 MB of address space.
fn in_little_memory(words: &[&str]) -> Output {
    let limited = "ulimit -v 200000; exec \"$0\" \"$@\"";
    let mut command = Command::new("sh");
    command.current_dir(env!("CARGO_MANIFEST_DIR")).args(["-c", limited, env!("CARGO_BIN_EXE_mesophyll"), "--quiet"]);
    command.args(words).output().unwrap()
}

#[test]
fn little_memory_is_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let [glb, folder] = ["plant.glb", "folder"].map(|n| dir.path().join(n).to_str().unwrap().to_string());
    let cases: [&[&str]; 3] = [
        &["grow", "data/plants/bird-cherry.toml", "-o", &glb],
        &["fit", "translucency", "fits/elm", "-o", &folder],
        &["grow", "data/plants/bird-cherry.toml", "-o", &glb, "--threads", "200"],
    ];
    for words in cases {
        let _ = fs::remove_file(&glb);
        let output = in_little_memory(words);
        let text = String::from_utf8_lossy(&output.stderr);
        // A machine with few cores may do it in as little.
        if output.status.success() {
            continue;
        }
        assert!(matches!(output.status.code(), Some(1 | 2)), "{words:?}: {:?} {text}", output.status);
        assert!(text.contains("memory") && text.contains("195 MiB") && !text.contains("panicked"), "{words:?}: {text}");
        assert_eq!(text.trim().lines().count(), 1, "{text}");
        assert!(!dir.path().join("plant.glb").exists());
        let rest =
            fs::read_dir(dir.path()).unwrap().flatten().any(|e| e.file_name().to_string_lossy().starts_with('.'));
        assert!(!rest, "a half-written file is left");
    }
}

#[test]
fn a_device_without_an_end_is_a_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out").to_str().unwrap().to_string();
    for words in [&["plan", "/dev/zero"][..], &["grow", "/dev/zero", "-o", &format!("{out}.glb")]] {
        refused(&run(words), 2, &["/dev/zero", "found no end after 64 MiB"]);
    }
    refused(&run(["import", "/dev/zero", "-o", &out]), 2, &["/dev/zero", "found no end after 256 MiB"]);
}

#[test]
fn what_a_message_quotes_is_cut() {
    let dir = tempfile::tempdir().unwrap();
    let table = dir.path().join("table.csv");
    let path = table.to_str().unwrap();
    fs::write(&table, format!("omega,{}\n0.5,1\n", "x".repeat(3_000_000))).unwrap();
    let output = run(["eval", "slab", "--in", path]);
    refused(&output, 2, &["delta"]);
    assert!(output.stderr.len() < 2000, "{} bytes", output.stderr.len());
    fs::write(&table, format!("omega,delta\n0.5,-{}\n", "9".repeat(309))).unwrap();
    let output = run(["eval", "slab", "--in", path]);
    assert!(output.stdout.len() < 1000 && output.stderr.len() < 1000, "{}", String::from_utf8_lossy(&output.stdout));
}

#[test]
fn carried_cells_are_no_formulas() {
    let dir = tempfile::tempdir().unwrap();
    let [table, out] = ["table.csv", "out.csv"].map(|n| dir.path().join(n));
    fs::write(&table, "name,omega,delta,note\n=1+1,0.5,-0.1,@home\n-3.5,0.5,0.1,\"=A1,B\"\n").unwrap();
    let words = ["eval", "slab", "--in", table.to_str().unwrap(), "--out", out.to_str().unwrap()];
    succeeded(&run(words));
    let text = fs::read_to_string(&out).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines[1].starts_with("'=1+1,0.5,-0.1,'@home,"), "{text}");
    assert!(lines[2].starts_with("-3.5,0.5,0.1,\"'=A1,B\","), "{text}");
    // JSON holds the cells as they are.
    let said = mesophyll().args(&words[..4]).arg("--json").output().unwrap();
    let rows: serde_json::Value = serde_json::from_slice(&said.stdout).unwrap();
    assert_eq!(rows["rows"][0]["name"], "=1+1");
}

#[test]
fn notes_and_scripts_are_not_replaced() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["notes.md", "s.sh", "Makefile"] {
        let path = dir.path().join(name);
        fs::write(&path, "mine").unwrap();
        for words in [&["grow", "data/plants/elm-twig.toml", "-o"][..], &["report", "fits/elm", "-o"]] {
            let output = run(words.iter().copied().chain([path.to_str().unwrap()]));
            refused(&output, 2, &["the output file", name, "would be overwritten"]);
        }
        assert_eq!(fs::read(&path).unwrap(), b"mine");
    }
    let new = dir.path().join("plant.obj");
    refused(&run(["grow", "data/plants/elm-twig.toml", "-o", new.to_str().unwrap()]), 2, &[".obj", "expected .glb"]);
}

/// `stress`, `bench` and `report` look seldom for a stop, and end at once all the same.
#[test]
fn a_stop_ends_long_tables_within_a_second() {
    for words in [["stress", "all"], ["bench", "all"]] {
        let mut child = mesophyll().args(words).stdout(std::process::Stdio::null()).spawn().unwrap();
        // The thread that waits for Ctrl-C is the second one, and the workers come after it.
        let threads = || fs::read_dir(format!("/proc/{}/task", child.id())).map_or(3, |list| list.count());
        while threads() < 3 {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        std::thread::sleep(std::time::Duration::from_millis(300));
        let clock = std::time::Instant::now();
        assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
        let status = child.wait().unwrap();
        assert_eq!(status.code(), Some(130), "{words:?}");
        assert!(clock.elapsed().as_secs_f64() < 1.0, "{words:?}: {:?}", clock.elapsed());
    }
}

#[test]
fn a_processor_may_be_used_in_part() {
    let table = |set: Option<&str>| {
        let mut command = mesophyll();
        command
            .args(["eval", "slab", "--in", "data/tables/optics.csv"])
            .envs(set.map(|s| ("MESOPHYLL_INSTRUCTIONS", s)));
        command.output().unwrap()
    };
    let numbers = |output: Output| -> Vec<f64> {
        let text = String::from_utf8(output.stdout).unwrap();
        text.split([',', '\n']).filter_map(|cell| cell.parse().ok()).collect()
    };
    let all = numbers(table(None));
    assert!(all.len() > 10, "{all:?}");
    for set in ["plain", "avx2", "avx512"] {
        let found = numbers(table(Some(set)));
        let same = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-9 * b.abs();
        assert!(found.len() == all.len() && found.iter().zip(&all).all(same), "{set}: {found:?}, expected {all:?}");
    }
    refused(&table(Some("sse")), 2, &["MESOPHYLL_INSTRUCTIONS", "sse", "plain, avx2, avx512"]);
}
