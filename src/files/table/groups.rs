//! Tables in which several rows belong together: a leaf has one row for each wavelength or direction, and its answer is
//! one row.

use super::{Answer, Output, Plan, Record, Sink, Spec, Table, Tally, push_cells, push_text, whole};
use crate::progress::Bar;
use crate::{Error, Result};
use rayon::prelude::*;
use std::collections::HashMap;
use std::path::PathBuf;

/// One row of a group.
#[derive(Debug, Clone)]
pub struct GroupRow {
    /// Required columns first, then optional ones; NaN where an optional column or cell is absent.
    pub values: Vec<f64>,
    /// Columns of words; `None` where there is no such column.
    pub texts: Vec<Option<String>>,
    /// Line of the file, the header's is 1.
    pub line: usize,
}

/// Rows of one group, or why the group is refused: its first bad row, named by its line.
type Rows = std::result::Result<Vec<GroupRow>, String>;

/// All rows of a table by the word in one of its columns, in order of first appearance.
pub struct Groups {
    by: String,
    source: PathBuf,
    groups: Vec<(String, Rows)>,
}

impl Groups {
    /// Groups the rows of `table` by its column `by`. Only the columns that `spec` asks for are read; no others are
    /// carried through.
    ///
    /// # Errors
    /// A missing column, an unreadable input. A bad row is no error: it refuses its group.
    pub fn read(mut table: Table, spec: &Spec, by: &str) -> Result<Groups> {
        let at = table.require(by)?;
        let everything = table.header.clone();
        let plan = Plan::new(&table, &Spec { dropped: everything, ..spec.clone() })?;
        let mut groups: Vec<(String, Rows)> = Vec::new();
        let mut places: HashMap<String, usize> = HashMap::new();
        let (mut record, mut line) = (Record::default(), 1);
        while table.next_record(&mut record)? {
            line += 1;
            let name = &*record.shown(at);
            let place = match places.get(name) {
                Some(place) => *place,
                None => {
                    places.insert(name.to_string(), groups.len());
                    groups.push((name.to_string(), Ok(Vec::new())));
                    groups.len() - 1
                }
            };
            let list = &mut groups[place].1;
            match (plan.parsed(&record, spec), &mut *list) {
                (Ok((values, texts)), Ok(rows)) => {
                    let texts = texts.into_iter().map(|t| t.map(str::to_string)).collect();
                    rows.push(GroupRow { values, texts, line });
                }
                (Err(why), Ok(_)) => *list = Err(format!("line {line}: {why}")),
                _ => {}
            }
        }
        Ok(Groups { by: by.to_string(), source: table.source().to_path_buf(), groups })
    }

    /// Names of all groups, in order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.groups.iter().map(|(name, _)| name.as_str())
    }

    /// All readable rows.
    pub fn rows(&self) -> impl Iterator<Item = &GroupRow> {
        self.groups.iter().filter_map(|(_, rows)| rows.as_ref().ok()).flatten()
    }

    /// Answers each group by `f`, which gets the group's name and rows, and writes one row for each group: the name,
    /// the outputs of `spec`, and the status.
    ///
    /// # Errors
    /// An unwritable output, and a stop.
    pub fn run<F>(&self, output: &Output, spec: &Spec, f: F) -> Result<Tally>
    where
        F: Fn(&str, &[GroupRow]) -> Answer + Sync,
    {
        let mut sink = Sink::open(output, &self.source)?;
        let (mut bytes, whole) = (Vec::new(), whole(spec));
        push_text(&mut bytes, &self.by);
        for name in spec.outputs.iter().map(String::as_str).chain(["status"]) {
            bytes.push(b',');
            push_text(&mut bytes, name);
        }
        bytes.push(b'\n');
        let mut tally = Tally::new(&spec.outputs);
        let bar = Bar::of("rows");
        let answer = |(name, rows): &(String, Rows)| {
            let answer = match rows {
                Err(why) => Answer::refused(why.clone()),
                Ok(_) if crate::progress::stop_requested() => Answer::refused("interrupted"),
                Ok(rows) => f(name, rows),
            };
            bar.advance(1);
            answer
        };
        let answers: Vec<Answer> = self.groups.par_iter().map(answer).collect();
        if crate::progress::stop_requested() {
            return Err(Error::Interrupted("interrupted; no output file was written".into()));
        }
        for ((name, _), answer) in self.groups.iter().zip(&answers) {
            tally.count(&answer.status, &answer.values);
            push_text(&mut bytes, name);
            bytes.push(b',');
            push_cells(&mut bytes, answer, &whole);
        }
        sink.write_all(&bytes)?;
        sink.finish()?;
        Ok(tally)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_one_name_are_answered_together_and_a_bad_one_refuses_its_group() {
        let text = "leaf,x,note\nelm,1,a\nash,2,b\nelm,4,c\noak,x,d\n\"a,b\",8,\n";
        let table = Table::from_reader(Box::new(text.as_bytes()), "in.csv".into()).unwrap();
        let spec = Spec { required: vec!["x".into()], outputs: vec!["sum".into()], ..Spec::default() };
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out.csv");
        let groups = Groups::read(table, &spec, "leaf").unwrap();
        assert_eq!(groups.rows().count(), 4);
        let sum = |_: &str, rows: &[GroupRow]| Answer::ok(vec![rows.iter().map(|r| r.values[0]).sum()]);
        let tally = groups.run(&Output::csv(&out), &spec, sum).unwrap();
        assert_eq!((tally.rows, tally.ok, tally.refused), (4, 3, 1));
        let want = "leaf,sum,status\nelm,5.0,ok\nash,2.0,ok\n\
                    oak,,\"refused: line 5: x is \"\"x\"\"; expected a number\"\n\"a,b\",8.0,ok\n";
        assert_eq!(std::fs::read_to_string(out).unwrap(), want);
    }
}
