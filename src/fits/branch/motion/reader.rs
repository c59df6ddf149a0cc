//! Deflections over time: columns `time_s,u_mm` and optionally `v_mm`, read at a steady rate, with or without gaps.

use super::cleaning::resolution;
use super::clock::{self, TimeStamp};
use super::{MotionRecord, grid};
use crate::branch::{Error, Result};
use mesophyll_files::table::{self, InputTable};
use std::path::Path;

/// Columns that hold times, and how many of their units make a second; the first one is the usual one. `time` may
/// hold numbers in seconds.
const TIMES: [(&str, f64); 7] = [
    ("time_s", 1.0),
    ("time_ms", 1e-3),
    ("time_us", 1e-6),
    ("time_min", 60.0),
    ("time", 1.0),
    ("timestamp", 1.0),
    ("datetime", 1.0),
];
/// Numbers above this are milliseconds since 1970, not seconds: as seconds they would lie beyond the year 5000.
const EPOCH_MS: f64 = 1e11;
/// At most this share of the rows may be unusable.
const FAULTY: f64 = 0.1;
/// Most places of the grid, for each reading: a record with more gaps is none.
const SPARSE: usize = 20;
/// Deflections (mm) that are possible: no tip is 30 m off. Numbers like 99999 outside it stand for a missing reading.
const POSSIBLE: [f64; 2] = [-3e4, 3e4];

/// A record, and what was left out of the table.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionReading {
    /// The record.
    pub record: MotionRecord,
    /// What is to be said of it, one phrase each.
    pub notes: Vec<String>,
}

/// Rows in the order of the table.
#[derive(Default)]
struct Rows {
    lines: Vec<usize>,
    stamps: Vec<TimeStamp>,
    channels: Vec<Vec<f64>>,
    /// Cells that hold neither a number nor a sign for a missing one: how many, and the first one.
    odd: (usize, Option<String>),
    /// Rows whose time cannot be read, or whose cells are too few.
    lost: (usize, Option<String>),
}

/// Reads all rows. `rate` (1/s) is how often the branch was read, if it is stated; then times only say which reading
/// is which.
///
/// # Errors
/// A missing column, no readable row, times that are not even, repeat or go back; each names the line.
pub fn read(mut table: InputTable, rate: Option<f64>) -> Result<MotionReading> {
    let path = table.source().to_path_buf();
    let (time, unit) = TIMES.into_iter().find(|(name, _)| table.column(name).is_some()).unwrap_or(TIMES[0]);
    let mut columns = vec![table.require(time)?, table.require("u_mm")?];
    columns.extend(table.column("v_mm"));
    let rows = rows(&mut table, &columns, time)?;
    let n = rows.stamps.len();
    if n == 0 {
        let what = rows.lost.1.unwrap_or_else(|| "found no rows, expected deflections over time".into());
        return Err(Error::input(&path, what));
    }
    for (count, first) in [&rows.odd, &rows.lost] {
        if let Some(first) = first.as_ref().filter(|_| *count as f64 > FAULTY * (n + rows.lost.0) as f64) {
            return Err(Error::input(&path, first));
        }
    }
    let times = seconds(&rows, unit, &path, time)?;
    // Written seconds: what is left after the largest whole number that all have in common.
    let from: Vec<f64> = times.iter().map(|t| t - times[0]).collect();
    let size =
        rows.stamps.iter().map(|s| if let TimeStamp::Number(t) = s { t.abs() * unit } else { 0.0 }).fold(0.0, f64::max);
    let coarse = resolution(&from, size).min(1.0);
    let fault = |k: usize, what: String| Error::field(&path, &format!("line {}: {time}", rows.lines[k]), what);
    let last = n - 1;
    if !(from[last] > 0.0) && rate.is_none() {
        return Err(fault(
            last,
            format!("found {}, expected times that rise from line {} on", rows.shown(last), rows.lines[0]),
        ));
    }
    let grid = grid::find(&from, coarse, rate.map(|r| 1.0 / r)).map_err(|why| Error::field(&path, time, why))?;
    let back: Vec<usize> = (0..n).filter(|k| grid.places[*k].is_none()).collect();
    if back.len() as f64 > FAULTY * 0.1 * n as f64 && back.len() > 1 {
        let k = back[0];
        let (now, before) = (rows.shown(k), rows.shown(k - 1));
        let hint = if rate.is_some() { "is --rate right?" } else { "readings are even in time, but for gaps" };
        let what = if from[k] > from[k - 1] {
            format!("found {now} after {before}, and even steps of {:.6} s have no place for it; {hint}", grid.step)
        } else {
            format!("found {now} after {before}, expected a later time")
        };
        return Err(fault(k, what));
    }
    if rate.is_none() && grid.uneven as f64 > FAULTY * 0.1 * n as f64 {
        let (k, off) = grid.worst;
        let what = format!(
            "found {}, {off:.3} s off even steps of {:.6} s, as {} of {n} rows are; where the branch was read steadily \
             and only the times are not, --rate HZ states how often",
            rows.shown(k),
            grid.step,
            grid.uneven
        );
        return Err(fault(k, what));
    }
    let size = 1 + grid.places.iter().rev().find_map(|p| *p).unwrap_or(0);
    if size > SPARSE * n {
        let (k, gap) = longest(&grid, &from);
        let what = format!(
            "found a gap of {gap:.3} s; readings are {:.6} s apart: give the parts of the record one by one",
            grid.step
        );
        return Err(fault(k, what));
    }
    let mut record =
        MotionRecord { step: grid.step, channels: vec![vec![f64::NAN; size]; columns.len() - 1], lines: vec![0; size] };
    for (k, place) in grid.places.iter().enumerate() {
        if let Some(place) = place {
            record.lines[*place] = rows.lines[k];
            for (to, from) in record.channels.iter_mut().zip(&rows.channels) {
                to[*place] = from[k];
            }
        }
    }
    let notes = notes(&rows, &grid, &back, &from, rate.is_some(), coarse, time);
    Ok(MotionReading { record, notes })
}

/// What was left out.
fn notes(
    rows: &Rows,
    grid: &grid::TimeGrid,
    back: &[usize],
    times: &[f64],
    stated: bool,
    coarse: f64,
    time: &str,
) -> Vec<String> {
    let mut out = Vec::new();
    let mut say = |count: usize, what: &str, first: String| {
        if count > 0 {
            let plural = if count == 1 { "" } else { "s" };
            let (subject, rest) = what.split_once(' ').unwrap_or((what, ""));
            let gap = if rest.is_empty() { "" } else { " " };
            out.push(format!("{count} {subject}{plural}{gap}{rest} ({first})"));
        }
    };
    let n = rows.stamps.len();
    let size = 1 + grid.places.iter().rev().find_map(|p| *p).unwrap_or(0);
    let missing = size - grid.places.iter().flatten().count();
    let (k, gap) = longest(grid, times);
    say(missing, "time without a row", format!("the longest gap, {gap:.3} s, ends on line {}", rows.lines[k]));
    say(
        back.len(),
        "row whose time repeats or goes back",
        back.first().map_or(String::new(), |k| {
            format!(
                "the first on line {}: {time} {} after {}",
                rows.lines[*k],
                rows.shown(*k),
                rows.shown(k.saturating_sub(1))
            )
        }),
    );
    say(rows.lost.0, "row that cannot be read", rows.lost.1.clone().unwrap_or_default());
    say(rows.odd.0, "cell that is no number", rows.odd.1.clone().unwrap_or_default());
    let empty = |c: &Vec<f64>| c.iter().filter(|v| v.is_nan()).count();
    let blank = rows.channels.iter().map(empty).sum::<usize>() - rows.odd.0;
    let first = (0..n).find(|k| rows.channels.iter().any(|c| c[*k].is_nan())).map_or(0, |k| rows.lines[k]);
    say(blank, "cell without a reading", format!("the first on line {first}"));
    // Rounded times say less than the rows' order, unless the step is a whole number of theirs.
    let steps = grid.step / coarse;
    if !stated && steps < 20.0 && (steps - steps.round()).abs() > 1e-3 * steps {
        out.push(format!("a step of {:.6} s found from times written to {coarse} s", grid.step));
    }
    out
}

/// The row after the longest gap, and the gap's length (s).
fn longest(grid: &grid::TimeGrid, times: &[f64]) -> (usize, f64) {
    let mut best = (0, 0.0);
    let mut before: Option<(usize, usize)> = None;
    let mut most = 0;
    for (k, place) in grid.places.iter().enumerate() {
        let Some(place) = place else { continue };
        if let Some((at, row)) = before
            && place - at > most
        {
            most = place - at;
            best = (k, times[k] - times[row]);
        }
        before = Some((*place, k));
    }
    best
}

fn rows(table: &mut InputTable, columns: &[usize], time: &str) -> Result<Rows> {
    let mut out = Rows { channels: vec![Vec::new(); columns.len() - 1], ..Rows::default() };
    let mut row = table::TableRecord::default();
    while table.next_record(&mut row)? {
        let line = row.line();
        let mut lose = |what: String| {
            out.lost.0 += 1;
            out.lost.1.get_or_insert(what);
        };
        if let Some(fault) = row.fault(table.header.len()) {
            lose(format!("line {line}: {fault}"));
            continue;
        }
        let stamp = match table.number(&row, columns[0]) {
            Ok(found) => found.filter(|t| t.is_finite()).map(TimeStamp::Number),
            Err(_) => clock::parse(&row.shown(columns[0])),
        };
        let Some(stamp) = stamp else {
            let text = row.shown(columns[0]);
            lose(format!("line {line}: {time}: found {text:?}, expected seconds, h:m:s or a date with a time"));
            continue;
        };
        out.lines.push(line);
        out.stamps.push(stamp);
        for (channel, column) in out.channels.iter_mut().zip(&columns[1..]) {
            let found = table.number_in(&row, *column, POSSIBLE).and_then(|found| match found {
                Some(v) if !v.is_finite() => Err(format!("{} is {v}; expected a finite number", table.header[*column])),
                found => Ok(found.unwrap_or(f64::NAN)),
            });
            channel.push(found.unwrap_or_else(|why| {
                out.odd.0 += 1;
                out.odd.1.get_or_insert(format!("line {line}: {why}"));
                f64::NAN
            }));
        }
    }
    Ok(out)
}

impl Rows {
    /// A time for a message.
    fn shown(&self, k: usize) -> String {
        match self.stamps[k] {
            TimeStamp::Number(t) => t.to_string(),
            TimeStamp::OfDay(t) => {
                format!("{:02.0}:{:02.0}:{:06.3}", (t / 3600.0).floor(), (t / 60.0).floor() % 60.0, t % 60.0)
            }
            TimeStamp::Dated(..) => format!("{:.3} s after the first", self.stamps[k].after(&self.stamps[0], 1.0)),
        }
    }
}

/// Times in seconds. Times of day go on after midnight.
fn seconds(rows: &Rows, unit: f64, path: &Path, time: &str) -> Result<Vec<f64>> {
    let same = |a: &TimeStamp, b: &TimeStamp| std::mem::discriminant(a) == std::mem::discriminant(b);
    if let Some(k) = rows.stamps.iter().position(|s| !same(s, &rows.stamps[0])) {
        let field = format!("line {}: {time}", rows.lines[k]);
        return Err(Error::field(
            path,
            &field,
            "found a time in another form than in the first row; expected one form",
        ));
    }
    let mut days = 0.0;
    let mut before = f64::NEG_INFINITY;
    let one = |stamp: &TimeStamp| match *stamp {
        TimeStamp::Number(t) if t.abs() > EPOCH_MS && unit == 1.0 => stamp.after(&rows.stamps[0], 1e-3),
        TimeStamp::Number(_) | TimeStamp::Dated(..) => stamp.after(&rows.stamps[0], unit),
        TimeStamp::OfDay(t) => {
            if before - t > 0.5 * clock::DAY {
                days += 1.0;
            }
            before = t;
            t + days * clock::DAY
        }
    };
    Ok(rows.stamps.iter().map(one).collect())
}
