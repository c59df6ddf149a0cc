//! How the rows of a batch ended, in numbers and in words.

use super::Status;
use std::fmt::Write;

/// How many rows ended in which way, and which values were found in rows that leave some values open.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RowTally {
    /// Rows in all.
    pub rows: usize,
    /// Rows whose values nothing speaks against.
    pub ok: usize,
    /// Rows that leave some value open.
    pub undetermined: usize,
    /// Rows without values.
    pub refused: usize,
    values: Vec<Value>,
}

/// An output column that a status may name.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Value {
    name: String,
    /// Its place among the output columns.
    column: usize,
    /// In how many undetermined rows it has a value and is not named by the status.
    found: usize,
}

impl RowTally {
    /// A tally without rows. `outputs` are the output columns before `status`. The values among them are those with a
    /// column of errors (`x` with `x_err`), or all columns where none has one.
    pub fn new<S: AsRef<str>>(outputs: &[S]) -> RowTally {
        let has_error = |name: &str| outputs.iter().any(|o| o.as_ref().strip_suffix("_err") == Some(name));
        let any = outputs.iter().any(|o| has_error(o.as_ref()));
        let named = outputs.iter().map(AsRef::as_ref).enumerate().filter(|(_, name)| !any || has_error(name));
        let values = named.map(|(column, name)| Value { name: name.to_string(), column, found: 0 }).collect();
        RowTally { values, ..RowTally::default() }
    }

    /// Counts a row; `values` are its cells in the order of the output columns.
    pub fn count(&mut self, status: &Status, values: &[f64]) {
        self.rows += 1;
        match status {
            Status::Ok => self.ok += 1,
            Status::Refused(_) => self.refused += 1,
            Status::Undetermined(_) => {
                self.undetermined += 1;
                for v in &mut self.values {
                    let there = values.get(v.column).is_some_and(|x| !x.is_nan());
                    v.found += usize::from(there && !status.leaves_open(&v.name));
                }
            }
        }
    }

    /// Adds the rows of another part of the same batch.
    pub fn add(&mut self, part: &RowTally) {
        self.rows += part.rows;
        self.ok += part.ok;
        self.undetermined += part.undetermined;
        self.refused += part.refused;
        for (to, from) in self.values.iter_mut().zip(&part.values) {
            to.found += from.found;
        }
    }

    /// Each value's name and the number of rows in which it was found, the good rows among them.
    pub fn found(&self) -> impl Iterator<Item = (&str, usize)> {
        self.values.iter().map(|v| (v.name.as_str(), self.ok + v.found))
    }

    /// The numbers as a sentence. `row` is the word for a row: `row`, `leaf`, `branch`.
    pub fn words(&self, row: &str) -> String {
        let mut text = format!(
            "{}: {} ok, {} undetermined, {} refused",
            counted(self.rows, row),
            self.ok,
            self.undetermined,
            self.refused
        );
        if self.undetermined == 0 || self.values.len() < 2 {
            return text;
        }
        // Writing to a string cannot fail.
        let _ = if self.undetermined == 1 {
            let list =
                |found: bool| joined(self.values.iter().filter(|v| (v.found > 0) == found).map(|v| v.name.clone()));
            let (found, open) = (list(true), list(false));
            if found.is_empty() {
                write!(text, "; the undetermined {row} determines none of {open}")
            } else {
                write!(text, "; the undetermined {row} determines {found}, but not {open}")
            }
        } else {
            let each = self.values.iter().map(|v| match v.found {
                0 => format!("{} in none", v.name),
                n => format!("{} in {n}", v.name),
            });
            write!(text, "; of the undetermined ones, these values are determined: {}", joined(each))
        };
        text
    }
}

/// `1 row`, `2 rows`, `3 leaves`, `4 branches`.
pub fn counted(n: usize, what: &str) -> String {
    match what {
        _ if n == 1 => format!("1 {what}"),
        "leaf" => format!("{n} leaves"),
        _ if what.ends_with("ch") => format!("{n} {what}es"),
        _ => format!("{n} {what}s"),
    }
}

/// `a`, `a and b`, `a, b and c`.
fn joined(words: impl Iterator<Item = String>) -> String {
    let words: Vec<String> = words.collect();
    match words.split_last() {
        None => String::new(),
        Some((last, [])) => last.clone(),
        Some((last, first)) => format!("{} and {last}", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OUTPUTS: [&str; 5] = ["alpha", "radius", "alpha_err", "radius_err", "chi2"];

    fn open(what: &str) -> Status {
        Status::Undetermined(what.into())
    }

    #[test]
    fn one_row_says_what_was_found() {
        let mut t = RowTally::new(&OUTPUTS);
        t.count(&open("radius (alpha and load give no radius)"), &[0.3, f64::NAN, 0.01, f64::NAN, 1.0]);
        assert_eq!(
            t.words("row"),
            "1 row: 0 ok, 1 undetermined, 0 refused; the undetermined row determines alpha, but not radius"
        );
        assert_eq!(t.found().collect::<Vec<_>>(), [("alpha", 1), ("radius", 0)]);
        let mut none = RowTally::new(&OUTPUTS);
        none.count(&open("alpha radius (residuals exceed the noise)"), &[0.3, 2.0, 0.01, 0.1, 90.0]);
        assert_eq!(
            none.words("leaf"),
            "1 leaf: 0 ok, 1 undetermined, 0 refused; the undetermined leaf determines none of alpha and radius"
        );
    }

    #[test]
    fn several_rows_count_each_value() {
        let (mut t, mut part) = (RowTally::new(&OUTPUTS), RowTally::new(&OUTPUTS));
        t.count(&Status::Ok, &[0.3, 2.0, 0.01, 0.01, 1.0]);
        t.count(&open("alpha >= 0.5"), &[0.3, 2.0, 1.0, 0.1, 1.0]);
        part.count(&open("alpha; radius"), &[0.3, 2.0, 1.0, 9.0, 1.0]);
        part.count(&Status::Refused("x is empty".into()), &[]);
        t.add(&part);
        assert_eq!(
            t.words("branch"),
            "4 branches: 1 ok, 2 undetermined, 1 refused; of the undetermined ones, these values are determined: alpha \
             in none and radius in 1"
        );
        assert_eq!(t.found().collect::<Vec<_>>(), [("alpha", 1), ("radius", 2)]);
    }

    #[test]
    fn without_error_columns_every_output_is_a_value() {
        let t = RowTally::new(&["u", "du"]);
        assert_eq!(t.found().map(|(name, _)| name).collect::<Vec<_>>(), ["u", "du"]);
        assert_eq!(RowTally::new(&["t"]).words("leaf"), "0 leaves: 0 ok, 0 undetermined, 0 refused");
    }
}
