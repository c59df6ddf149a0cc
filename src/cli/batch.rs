//! What the batch forms (CSV in, CSV out) share: the sentence at the end of a run.

use super::{CommonArgs, print_json};
use crate::cli::{Error, Result};
use mesophyll_files::progress;
use mesophyll_files::table::{BatchIo, RowTally, counted};
use std::path::Path;

/// Writes one line on standard error. With `--json` and the rows in a file, it writes the same numbers as JSON on
/// standard output. `row` is the word for a row: `row`, `leaf`, `branch`.
///
/// # Errors
/// [`Error::Missed`] where there are rows and every one is refused: exit code 1. With one that is answered the batch is
/// done, and the column `status` tells the others apart.
pub fn say_tally(tally: &RowTally, io: &BatchIo, common: &CommonArgs, row: &str) -> Result<()> {
    progress::say(tally.words(row));
    if common.json && io.output != Path::new("-") {
        let found: serde_json::Map<_, _> = tally.found().map(|(name, n)| (name.to_string(), n.into())).collect();
        let RowTally { rows, ok, undetermined, refused, .. } = tally;
        print_json(&serde_json::json!({ "rows": rows, "ok": ok, "undetermined": undetermined, "refused": refused,
                "found": found }))?;
    }
    if tally.rows > 0 && tally.refused == tally.rows {
        let all = counted(tally.rows, row);
        return Err(Error::Missed(format!("{all}, and every one was refused; the column status says why")));
    }
    Ok(())
}
