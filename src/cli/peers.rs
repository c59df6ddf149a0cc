//! Peers of `bench --peers`: the scripts of `tests/peers`. They run where Python and their modules are installed;
//! elsewhere they are skipped with a message.

use crate::cli::{Error, Result};
use mesophyll_files::progress;
use mesophyll_proof::bench::BenchRow;
use mesophyll_proof::peers::PeerInputs;
use serde::Deserialize;
use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};

/// Other programs that are measured beside a sweep.
#[derive(Debug, Clone, Copy)]
pub struct PeerScript {
    /// The text of their Python script.
    pub text: &'static str,
    /// What it gets.
    pub inputs: fn() -> Result<PeerInputs>,
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Line {
    Turn { turn: String },
    Row { peer: String, error: f64, us: f64, note: String },
    Skipped { skipped: String },
}

/// Rows of the peers of one sweep. A script gets the path of a folder with its inputs, and prints one JSON line for
/// each row, or one that says why it skipped. Where both are measured in turns, it also prints a line for each turn and
/// reads our time for it. `MESOPHYLL_PYTHON` names the interpreter; the default is `python3`.
///
/// # Errors
/// [`Error::Write`] where the inputs cannot be put into a temporary folder. A missing or failing peer is a message,
/// never an error.
pub fn rows(sweep: &str, peers: Option<PeerScript>) -> Result<Vec<BenchRow>> {
    let Some(PeerScript { text: script, inputs }) = peers else {
        progress::say(format!("peers of {sweep}: none to run"));
        return Ok(Vec::new());
    };
    let inputs = inputs()?;
    let folder = tempfile::tempdir().map_err(|e| Error::write(&std::env::temp_dir(), e))?;
    for (name, bytes) in &inputs.files {
        mesophyll_files::atomic::write_bytes(&folder.path().join(name), bytes)?;
    }
    let errors = folder.path().join("errors");
    let log = std::fs::File::create(&errors).map_err(|e| Error::write(&errors, e))?;
    let python = std::env::var("MESOPHYLL_PYTHON").unwrap_or_else(|_| "python3".into());
    // One thread, like ours: linear algebra libraries would otherwise take all cores.
    let started = Command::new(&python)
        .args(["-c", script])
        .arg(folder.path())
        .env("OMP_NUM_THREADS", "1")
        .env("OPENBLAS_NUM_THREADS", "1")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(log)
        .spawn();
    let mut running = match started {
        Ok(running) => running,
        Err(e) => {
            progress::say(format!("peers of {sweep}: skipped, {python} does not start ({e})"));
            return Ok(Vec::new());
        }
    };
    let (mut answers, lines) = (running.stdin.take(), running.stdout.take());
    let mut rows = Vec::new();
    for text in lines.into_iter().flat_map(|lines| BufReader::new(lines).lines()).map_while(|line| line.ok()) {
        match serde_json::from_str(&text) {
            Ok(Line::Turn { turn }) => {
                let us = inputs.turn.as_ref().map_or(f64::NAN, |time| time(&turn));
                // A script that no longer listens ends with its own message.
                let _ = answers.as_mut().map(|to| writeln!(to, "{us}"));
            }
            Ok(Line::Row { peer, error, us, note }) => {
                rows.push(BenchRow { model: sweep.into(), knob: "peer".into(), setting: peer, error, us, note });
            }
            Ok(Line::Skipped { skipped }) => progress::say(format!("peers of {sweep}: {skipped}")),
            Err(e) => progress::say(format!("peers of {sweep}: a line that is no row ({e})")),
        }
    }
    drop(answers);
    if !running.wait().is_ok_and(|status| status.success()) {
        let text = std::fs::read(&errors).unwrap_or_default();
        let reason = String::from_utf8_lossy(&text).lines().last().unwrap_or("no message").to_string();
        progress::say(format!("peers of {sweep}: the script failed: {reason}"));
    }
    // Our rows are added beside them, on the same inputs and from the same run. Alone they would say nothing.
    if !rows.is_empty() {
        rows.extend(inputs.ours);
    }
    Ok(rows)
}
