//! Peers of `bench --peers`: the scripts of `tests/peers`, run where Python and their modules are installed, skipped
//! with a word where not.

use crate::{Error, Result};
use mesophyll_files::progress;
use mesophyll_proof::bench::BenchRow;
use mesophyll_proof::peers::Inputs;
use serde::Deserialize;
use std::process::{Command, Stdio};

#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Line {
    Row { peer: String, error: f64, us: f64, note: String },
    Skipped { skipped: String },
}

/// Rows of the peers of one sweep. A script gets the path of a folder with its inputs and prints a JSON line a row, or
/// one that says why it skipped. `MESOPHYLL_PYTHON` names the interpreter; `python3` else.
///
/// # Errors
/// [`Error::Write`] where the inputs cannot be put into a temporary folder. A missing or failing peer is a message,
/// never an error.
pub fn rows(sweep: &str, peers: Option<(&str, fn() -> Result<Inputs>)>) -> Result<Vec<BenchRow>> {
    let Some((script, inputs)) = peers else {
        progress::say(format!("peers of {sweep}: none to run"));
        return Ok(Vec::new());
    };
    let inputs = inputs()?;
    let folder = tempfile::tempdir().map_err(|e| Error::write(&std::env::temp_dir(), e))?;
    for (name, text) in &inputs.files {
        mesophyll_files::atomic::write_bytes(&folder.path().join(name), text.as_bytes())?;
    }
    let python = std::env::var("MESOPHYLL_PYTHON").unwrap_or_else(|_| "python3".into());
    // One thread, as ours: linear algebra libraries take all cores otherwise.
    let output = Command::new(&python)
        .args(["-c", script])
        .arg(folder.path())
        .env("OMP_NUM_THREADS", "1")
        .env("OPENBLAS_NUM_THREADS", "1")
        .stdin(Stdio::null())
        .stderr(Stdio::piped())
        .output();
    let output = match output {
        Ok(output) => output,
        Err(e) => {
            progress::say(format!("peers of {sweep}: skipped, {python} does not start ({e})"));
            return Ok(Vec::new());
        }
    };
    if !output.status.success() {
        let reason = String::from_utf8_lossy(&output.stderr).lines().last().unwrap_or("no message").to_string();
        progress::say(format!("peers of {sweep}: the script failed: {reason}"));
    }
    let mut rows = Vec::new();
    for text in String::from_utf8_lossy(&output.stdout).lines() {
        match serde_json::from_str(text) {
            Ok(Line::Row { peer, error, us, note }) => {
                rows.push(BenchRow { model: sweep.into(), knob: "peer".into(), setting: peer, error, us, note });
            }
            Ok(Line::Skipped { skipped }) => progress::say(format!("peers of {sweep}: {skipped}")),
            Err(e) => progress::say(format!("peers of {sweep}: a line that is no row ({e})")),
        }
    }
    // Ours beside them, on the same inputs and in the same run; alone they would say nothing.
    if !rows.is_empty() {
        rows.extend(inputs.ours);
    }
    Ok(rows)
}
