//! Rows as JSON: the lines of a CSV are turned into `{"rows": [{column: value, …}, …]}` one after the other.

use super::sink::is_formula;
use std::io::{self, Write};

/// Turns whole CSV lines into JSON objects. The first line names the columns.
#[derive(Debug, Default)]
pub struct JsonRows {
    names: Vec<String>,
    any: bool,
}

impl JsonRows {
    /// Writes the rows of `lines`, which end at the end of a line.
    pub fn write(&mut self, lines: &[u8], to: &mut impl Write) -> io::Result<()> {
        let mut reader = csv::ReaderBuilder::new().has_headers(false).flexible(true).from_reader(lines);
        for record in reader.byte_records() {
            let record = record?;
            let cells = record.iter().map(String::from_utf8_lossy);
            if self.names.is_empty() {
                self.names = cells.map(|c| written(&c).to_string()).collect();
                to.write_all(b"{\"rows\": [")?;
                continue;
            }
            to.write_all(if self.any { b",\n  {" } else { b"\n  {" })?;
            self.any = true;
            for (k, (name, cell)) in self.names.iter().zip(cells).enumerate() {
                let comma = if k > 0 { ", " } else { "" };
                write!(to, "{comma}{}: {}", serde_json::Value::from(name.as_str()), value(&cell))?;
            }
            to.write_all(b"}")?;
        }
        Ok(())
    }

    /// Closes the list.
    pub fn finish(&self, to: &mut impl Write) -> io::Result<()> {
        to.write_all(if self.any { b"\n]}\n" } else { b"]}\n" })
    }
}

/// A number is written as it is. An empty cell, and a number that is not finite, become `null`. Everything else is
/// text.
fn value(cell: &str) -> String {
    match written(cell) {
        "" | "inf" | "-inf" | "NaN" => "null".into(),
        cell if serde_json::from_str::<serde_json::Number>(cell).is_ok() => cell.to_string(),
        cell => serde_json::Value::from(cell).to_string(),
    }
}

/// A cell without the apostrophe that keeps spreadsheets from running it.
fn written(cell: &str) -> &str {
    cell.strip_prefix('\'').filter(|rest| is_formula(rest.as_bytes())).unwrap_or(cell)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_become_values() {
        let (mut rows, mut out) = (JsonRows::default(), Vec::new());
        rows.write(b"id,x,x_err,note,status\n007,0.25,inf,\"a \"\"b\"\", c\",ok\n", &mut out).unwrap();
        rows.write(b"'=8,1e-300,,,\"refused: x is \"\"?\"\"\"\n", &mut out).unwrap();
        rows.finish(&mut out).unwrap();
        let json: serde_json::Value = serde_json::from_slice(&out).unwrap();
        let want = serde_json::json!({"rows": [
            {"id": "007", "x": 0.25, "x_err": null, "note": "a \"b\", c", "status": "ok"},
            {"id": "=8", "x": 1e-300, "x_err": null, "note": null, "status": "refused: x is \"?\""},
        ]});
        assert_eq!(json, want);
        let (mut none, mut out) = (JsonRows::default(), Vec::new());
        none.write(b"x,status\n", &mut out).unwrap();
        none.finish(&mut out).unwrap();
        assert_eq!(serde_json::from_slice::<serde_json::Value>(&out).unwrap(), serde_json::json!({"rows": []}));
    }
}
