//! Other programs that judge what was written, and that tests skip where they are not installed.

use crate::common::skips::{Need, skip};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// The numbers that a Python script prints as JSON; a skip where Python has no `module`. `MESOPHYLL_PYTHON` names the
/// interpreter.
pub fn python(module: &str, script: &str, folder: &Path) -> Option<Value> {
    let python = std::env::var("MESOPHYLL_PYTHON").unwrap_or_else(|_| "python3".into());
    let found = Command::new(&python).args(["-c", &format!("import {module}")]).output();
    if !found.is_ok_and(|out| out.status.success()) {
        skip(Need::Peer, &format!("Python has no {module} (MESOPHYLL_PYTHON)"));
        return None;
    }
    let out = Command::new(&python).args(["-c", script]).current_dir(folder).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    Some(serde_json::from_slice(&out.stdout).unwrap())
}

/// The bytes that a page's script left as base64 in an element `seen`, after Chromium showed the page without a
/// display; `None` where there is no Chromium.
pub fn shown(folder: &Path, page: &str) -> Option<Vec<u8>> {
    let chromium = ["chromium", "chromium-browser", "google-chrome"]
        .into_iter()
        .find(|name| Command::new(name).arg("--version").output().is_ok_and(|out| out.status.success()));
    let Some(chromium) = chromium else {
        skip(Need::Peer, "no Chromium (apt-get install chromium)");
        return None;
    };
    let path = folder.join("looked-at.html");
    std::fs::write(&path, page).unwrap();
    let show = || {
        Command::new(chromium)
            .args(["--headless", "--no-sandbox", "--disable-quic", "--no-first-run"])
            .args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--allow-file-access-from-files"])
            .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
            .args(["--window-size=1280,900", "--virtual-time-budget=30000", "--dump-dom"])
            .arg(format!("--user-data-dir={}", folder.join("profile").display()))
            .arg(format!("file://{}", path.display()))
            .output()
            .unwrap()
    };
    // Its virtual clock may run out before a busy machine has read the page's files, so there are three attempts.
    let ended = |out: &std::process::Output| String::from_utf8_lossy(&out.stdout).contains("<pre id=\"seen\">");
    let mut out = show();
    for _ in 0..2 {
        if !ended(&out) {
            out = show();
        }
    }
    let dom = String::from_utf8_lossy(&out.stdout).into_owned();
    let (_, found) = dom
        .split_once("<pre id=\"seen\">")
        .unwrap_or_else(|| panic!("the script did not end: {} {}", out.status, String::from_utf8_lossy(&out.stderr)));
    Some(decoded(found.split_once('<').unwrap().0))
}

/// Bytes of base64 text.
fn decoded(text: &str) -> Vec<u8> {
    let digit = |c: u8| match c {
        b'A'..=b'Z' => c - b'A',
        b'a'..=b'z' => c - b'a' + 26,
        b'0'..=b'9' => c - b'0' + 52,
        b'+' => 62,
        _ => 63,
    };
    let digits: Vec<u8> = text.bytes().filter(|c| *c != b'=').map(digit).collect();
    let whole = |four: &[u8]| four.iter().enumerate().fold(0u32, |w, (k, d)| w | u32::from(*d) << (18 - 6 * k));
    digits.chunks(4).flat_map(|c| whole(c).to_be_bytes()[1..c.len()].to_vec()).collect()
}
