//! Tables in which several rows belong together: a leaf has one row for each wavelength or direction, and its answer is
//! one row. A row that cannot be read costs itself and not its group.

use super::cell::Possible;
use super::omissions::{Omissions, listed};
use super::physical_range::repeated;
use super::plan::{Stated, say_repeated};
use super::{
    BatchSpec, InputTable, OutputRow, Plan, RowTally, Status, TableOutput, TableRecord, TableSink, counted, push_cells,
    push_text, whole,
};
use crate::progress::{self, TaskProgress};
use crate::{Error, Result};
use rayon::prelude::*;
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

/// One row of a group.
#[derive(Debug, Clone)]
pub struct GroupRow {
    /// Required columns first, then optional ones; NaN where an optional column or cell is absent, and for a reading
    /// that was left out.
    pub values: Vec<f64>,
    /// Columns of words; `None` where there is no such column.
    pub texts: Vec<Option<String>>,
    /// Line of the file where the row begins; the first line is 1.
    pub line: usize,
}

/// The rows of one name that can be read, and what was left out.
struct Group {
    name: String,
    rows: Vec<GroupRow>,
    left: Omissions,
}

/// All rows of a table by the word in one of its columns, in order of first appearance.
pub struct Groups {
    by: String,
    name: PathBuf,
    source: PathBuf,
    groups: Vec<Group>,
}

impl Groups {
    /// Groups the rows of `table` by its column `by`. Only the columns that `spec` asks for are read; no others are
    /// carried through.
    ///
    /// # Errors
    /// A missing column, an unreadable input. A bad row is no error: it is left out.
    pub fn read(table: InputTable, spec: &BatchSpec, by: &str) -> Result<Groups> {
        let at = table.require(by)?;
        Groups::of(table, spec, by, |record| record.shown(at).into_owned())
    }

    /// All rows of `table` as one group, for a table without a column `by`.
    ///
    /// # Errors
    /// As [`Groups::read`].
    pub fn one(table: InputTable, spec: &BatchSpec, by: &str, name: &str) -> Result<Groups> {
        Groups::of(table, spec, by, |_| name.to_string())
    }

    fn of(
        mut table: InputTable,
        spec: &BatchSpec,
        by: &str,
        name_of: impl Fn(&TableRecord) -> String,
    ) -> Result<Groups> {
        // A repeated impossible value is looked for in all rows below.
        let everything = table.header.clone();
        let mut plan = Plan::new(&table, &BatchSpec { dropped: everything, physical: Vec::new(), ..spec.clone() })?;
        spec.physical.iter().for_each(|of| plan.bound(&of.columns, Possible::within(of.range)));
        let mut groups: Vec<Group> = Vec::new();
        let mut places: HashMap<String, usize> = HashMap::new();
        let (mut record, mut stated) = (TableRecord::default(), Stated::default());
        let (mut values, mut faults) = (Vec::new(), Vec::new());
        while table.next_record(&mut record)? {
            let name = name_of(&record);
            let place = *places.entry(name.clone()).or_insert_with(|| {
                groups.push(Group { name, rows: Vec::new(), left: Omissions::default() });
                groups.len() - 1
            });
            let Group { rows, left, .. } = &mut groups[place];
            match plan.numbers(&record, spec, &mut values, &mut faults, &mut stated) {
                Ok(()) => {
                    let texts = plan.words(&record).map(|t| t.map(str::to_string)).collect();
                    rows.push(GroupRow { values: values.clone(), texts, line: record.line() });
                    faults.drain(..).for_each(|(_, why)| left.add(record.line(), why));
                }
                Err(why) => left.add(record.line(), why),
            }
        }
        stated.say(&table);
        leave_out_repeated(&table, spec, &mut groups);
        let (name, source) = (table.name().to_path_buf(), table.source().to_path_buf());
        Ok(Groups { by: by.to_string(), name, source, groups })
    }

    /// Names of all groups, in order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.groups.iter().map(|group| group.name.as_str())
    }

    /// Each group's name with its readable rows, in order.
    pub fn each(&self) -> impl Iterator<Item = (&str, &[GroupRow])> {
        self.groups.iter().map(|group| (group.name.as_str(), group.rows.as_slice()))
    }

    /// All readable rows.
    pub fn rows(&self) -> impl Iterator<Item = &GroupRow> {
        self.groups.iter().flat_map(|group| &group.rows)
    }

    /// The file, for messages.
    pub fn name(&self) -> &Path {
        &self.name
    }

    /// Opens the output before anything is computed, for [`Groups::run_into`].
    ///
    /// # Errors
    /// An unwritable output.
    pub fn open(&self, output: &TableOutput) -> Result<TableSink> {
        TableSink::open(output, &self.source)
    }

    /// Answers each group by `f`, which gets the group's name, its readable rows, and what was left out so far, to
    /// which it may add. Writes one row for each group: the name, the outputs of `spec`, and the status. What was left
    /// out is said on standard error, and in the status of a group that is refused. A group without a readable row is
    /// refused without `f`.
    ///
    /// # Errors
    /// An unwritable output, and a stop.
    pub fn run<F>(&self, output: &TableOutput, spec: &BatchSpec, f: F) -> Result<RowTally>
    where
        F: Fn(&str, &[GroupRow], &Omissions) -> OutputRow + Sync,
    {
        self.run_into(self.open(output)?, spec, f)
    }

    /// As [`Groups::run`], with the output that [`Groups::open`] opened.
    ///
    /// # Errors
    /// As [`Groups::run`].
    pub fn run_into<F>(&self, mut sink: TableSink, spec: &BatchSpec, f: F) -> Result<RowTally>
    where
        F: Fn(&str, &[GroupRow], &Omissions) -> OutputRow + Sync,
    {
        let (mut bytes, whole) = (Vec::new(), whole(spec));
        push_text(&mut bytes, &self.by);
        for name in spec.outputs.iter().map(String::as_str).chain(["status"]) {
            bytes.push(b',');
            push_text(&mut bytes, name);
        }
        bytes.push(b'\n');
        let mut tally = RowTally::new(&spec.outputs);
        let bar = TaskProgress::of("rows");
        let answer = |group: &Group| {
            let answer = match &group.rows[..] {
                _ if progress::stop_requested() => OutputRow::refused("interrupted"),
                [] => OutputRow::refused(group.left.words()),
                rows => group.blamed(f(&group.name, rows, &group.left)),
            };
            bar.advance(1);
            answer
        };
        let answers: Vec<OutputRow> = self.groups.par_iter().map(answer).collect();
        if progress::stop_requested() {
            return Err(Error::Interrupted("interrupted; no output file was written".into()));
        }
        for (group, answer) in self.groups.iter().zip(&answers) {
            tally.count(&answer.status, &answer.values);
            push_text(&mut bytes, &group.name);
            bytes.push(b',');
            push_cells(&mut bytes, answer, &whole);
        }
        sink.write_all(&bytes)?;
        sink.finish()?;
        self.say_left_out();
        Ok(tally)
    }

    fn say_left_out(&self) {
        let left = self.groups.iter().filter(|group| group.left.count() > 0 && !group.rows.is_empty());
        let each: Vec<String> = left.clone().map(|group| format!("{}: {}", group.name, group.left.words())).collect();
        let count: usize = left.map(|group| group.left.count()).sum();
        if count > 0 {
            let (name, readings) = (self.name.display(), counted(count, "reading"));
            progress::say(format!("{name}: {readings} left out of {}: {}", self.by, listed(each.into_iter())));
        }
    }
}

impl Group {
    /// A refused answer that also names what was left out.
    fn blamed(&self, answer: OutputRow) -> OutputRow {
        match answer {
            OutputRow { values, status: Status::Refused(why) } if self.left.count() > 0 => {
                let why = format!("{why} (left out: {})", self.left.words());
                OutputRow { values, status: Status::Refused(why) }
            }
            answer => answer,
        }
    }
}

/// Leaves out the one impossible value that columns of a quantity repeat; see [`BatchSpec::physical`].
fn leave_out_repeated(table: &InputTable, spec: &BatchSpec, groups: &mut [Group]) {
    let names: Vec<&String> = spec.required.iter().chain(&spec.optional).collect();
    for physical in &spec.physical {
        let columns: HashSet<&String> = physical.columns.iter().collect();
        let places: Vec<usize> = (0..names.len()).filter(|&k| columns.contains(names[k])).collect();
        let rows = groups.iter().flat_map(|group| &group.rows);
        let Some(mark) = repeated(physical.range, rows.flat_map(|row| places.iter().map(|&k| row.values[k]))) else {
            continue;
        };
        say_repeated(table, Some(mark), &physical.columns);
        for Group { rows, left, .. } in groups.iter_mut() {
            rows.retain_mut(|row| {
                let needed = places.iter().find(|&&k| k < spec.required.len() && row.values[k] == mark);
                if let Some(&k) = needed {
                    left.add(row.line, format!("{} is missing ({mark})", names[k]));
                }
                for &k in places.iter().filter(|&&k| k >= spec.required.len()) {
                    let value = &mut row.values[k];
                    *value = if *value == mark { f64::NAN } else { *value };
                }
                needed.is_none()
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::PhysicalRange;

    fn answered(text: &'static str, spec: &BatchSpec) -> (String, RowTally) {
        let table = InputTable::from_reader(Box::new(text.as_bytes()), "in.csv".into()).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out.csv");
        let sum = |_: &str, rows: &[GroupRow], left: &Omissions| {
            let used = rows.iter().filter(|r| {
                let small = r.values[0] < 90.0;
                if !small {
                    left.add(r.line, format!("x is {}; expected below 90", r.values[0]));
                }
                small
            });
            match used.map(|r| r.values[0]).reduce(|a, b| a + b) {
                Some(sum) => OutputRow::ok(vec![sum]),
                None => OutputRow::refused("0 readings; expected at least 1"),
            }
        };
        let tally = Groups::read(table, spec, "leaf").unwrap().run(&TableOutput::csv(&out), spec, sum).unwrap();
        (std::fs::read_to_string(out).unwrap(), tally)
    }

    #[test]
    fn rows_of_one_name_are_answered_together_and_a_bad_one_costs_itself() {
        let text = "# made by\nleaf,x,note\nelm,1,a\nash,2,b\n\nelm,4,c\n\
                    oak,x,d\n\"a,b\",8,\nelm,NA,\nash,y,\nelm,90,\nfir,91,\n";
        let spec = BatchSpec { required: vec!["x".into()], outputs: vec!["sum".into()], ..BatchSpec::default() };
        let (found, tally) = answered(text, &spec);
        assert_eq!((tally.rows, tally.ok, tally.refused), (5, 3, 2));
        let want = "leaf,sum,status\nelm,5.0,ok\nash,2.0,ok\n\
                    oak,,\"refused: line 7: x is \"\"x\"\"; expected a number\"\n\"a,b\",8.0,ok\n\
                    fir,,refused: 0 readings; expected at least 1 (left out: line 12: x is 91; expected below 90)\n";
        assert_eq!(found, want);
    }

    /// A value outside what is possible that stands in several cells, as far apart as they may be.
    #[test]
    fn a_repeated_impossible_value_is_a_missing_reading() {
        let spec = BatchSpec {
            required: vec!["x".into()],
            optional: vec!["y".into()],
            outputs: vec!["sum".into()],
            physical: vec![PhysicalRange::shares(vec!["x".into(), "y".into()])],
            ..BatchSpec::default()
        };
        let (found, _) = answered("leaf,x,y\na,1,-1\na,-1,2\nb,2,-1\nb,3,4\n", &spec);
        assert_eq!(found, "leaf,sum,status\na,1.0,ok\nb,5.0,ok\n");
        // Twice is no pattern.
        let (found, _) = answered("leaf,x,y\na,1,1\na,-1,2\nb,2,-1\nb,3,-999\n", &spec);
        assert_eq!(found, "leaf,sum,status\na,0.0,ok\nb,5.0,ok\n");
    }
}
