//! Readings that are none: those of an instrument that hangs, copies, and wild ones.

use super::{MotionRecord, spikes};
use mesophyll_base::statistics::median_of;

/// A record without readings that are none.
#[derive(Debug, Clone)]
pub struct CleanRecord {
    /// Deflections (mm); NaN at gaps.
    pub channels: Vec<Vec<f64>>,
    /// Step in which the readings are written (mm), 0 where there is none.
    pub resolution: f64,
    /// What was left out, one phrase each.
    pub left_out: Vec<String>,
    /// Why nothing can be promised of what is left, if so.
    pub doubt: Option<String>,
}

/// A record without wild readings, as a motion in gusts has them.
#[derive(Debug, Clone, Default)]
pub struct DespikedRecord {
    /// Deflections (mm); NaN at gaps.
    pub channels: Vec<Vec<f64>>,
    /// Channel and place of what was left out.
    pub wild: Vec<(usize, usize)>,
}

/// An instrument hangs where it repeats itself so often.
const HANGS: usize = 8;
/// Readings pile up at an end of the instrument's range where they do so in this many visits, and are this many times
/// as many as in the next of so many parts of the range. A branch that is held before it is let go visits an end once,
/// and a steady swing, read in coarse steps, has 2.4 times as many readings in its last step as in the one before.
const VISITS: usize = 4;
const PILED: usize = 4;
const BINS: f64 = 200.0;
/// Differences of this many steps of writing are not 0 by rounding.
const MOVES: f64 = 5.0;
/// Readings are copies where this share repeats the one before.
const COPIES: f64 = 0.2;
/// More wild readings than this share, and than [`FEW`], are no accident.
const MANY: f64 = 0.01;
const FEW: usize = 3;

/// Takes out what is no reading.
pub fn clean(record: &MotionRecord) -> CleanRecord {
    let mut out = CleanRecord {
        channels: record.channels.clone(),
        resolution: record.channels.iter().map(|c| resolution(c, 0.0)).fold(0.0, f64::max),
        left_out: Vec::new(),
        doubt: record.channels.iter().find_map(|c| {
            let resolution = resolution(c, 0.0);
            copies(c, resolution).or_else(|| clipped(c, resolution))
        }),
    };
    for (k, channel) in out.channels.iter_mut().enumerate() {
        let name = ["u_mm", "v_mm"][k.min(1)];
        let what = if record.lines.is_empty() { "reading" } else { "line" };
        let held = hangs(channel, out.resolution);
        for range in &held {
            channel[range.clone()].fill(f64::NAN);
        }
        let count: usize = held.iter().map(ExactSizeIterator::len).sum();
        if let Some(first) = held.first() {
            out.left_out.push(format!(
                "{count} readings of {name} that repeat the one before, from {what} {} on",
                line(record, first.start)
            ));
        }
    }
    out
}

/// Takes out wild readings.
pub fn smooth(cleaned: &CleanRecord) -> DespikedRecord {
    let mut out = DespikedRecord { channels: cleaned.channels.clone(), wild: Vec::new() };
    for (c, channel) in out.channels.iter_mut().enumerate() {
        out.wild.extend(spikes::remove(channel, cleaned.resolution).into_iter().map(|k| (c, k)));
    }
    out
}

/// What is to be said of wild readings (channel and place, in order): a phrase, and why nothing can be promised where
/// there are many.
pub fn said(record: &MotionRecord, wild: &[(usize, usize)]) -> (Vec<String>, Option<String>) {
    let (mut phrases, mut doubt) = (Vec::new(), None);
    for (c, channel) in record.channels.iter().enumerate() {
        let name = ["u_mm", "v_mm"][c.min(1)];
        let places: Vec<usize> = wild.iter().filter(|w| w.0 == c).map(|w| line(record, w.1)).collect();
        let (Some(first), count) = (places.first(), places.len()) else { continue };
        let what = if record.lines.is_empty() { "reading" } else { "line" };
        let shown = places.iter().take(3).map(usize::to_string).collect::<Vec<_>>().join(", ");
        let more = if count > 3 { " …" } else { "" };
        let (plural, lines) = if count == 1 { ("", "") } else { ("s", "s") };
        phrases.push(format!("{count} wild reading{plural} of {name} ({what}{lines} {shown}{more})"));
        let there = channel.iter().filter(|r| !r.is_nan()).count();
        if count > FEW && count as f64 > MANY * there as f64 {
            doubt = doubt.or(Some(format!(
                "{count} or more of {there} readings of {name} are wild, the first in {what} {first}"
            )));
        }
    }
    (phrases, doubt)
}

/// The line of a reading, or its number where there is no file.
fn line(record: &MotionRecord, place: usize) -> usize {
    record.lines.get(place).copied().filter(|l| *l > 0).unwrap_or(place + 1)
}

/// Step in which readings are written: a power of ten, or twice or five times one, or that of a coarse scale; 0 where
/// there is none above 1e-8. `size` is how large the numbers were before they were subtracted from each other.
pub fn resolution(readings: &[f64], size: f64) -> f64 {
    let there: Vec<f64> = readings.iter().copied().filter(|r| !r.is_nan()).collect();
    let largest = there.iter().map(|r| r.abs()).fold(size, f64::max);
    let fits = |step: f64, from: f64, slack: f64| {
        let slack = slack + 4.0 * f64::EPSILON * largest / step;
        let whole = |r: &f64| ((r - from) / step - ((r - from) / step).round()).abs() < slack;
        slack < 0.1 && there.iter().all(whole)
    };
    for power in (-8..=3).rev() {
        for factor in [5.0, 2.0, 1.0] {
            let step = factor * 10f64.powi(power);
            if fits(step, 0.0, 1e-6) {
                return step;
            }
        }
    }
    // A scale of its own shows in few different readings.
    let mut sorted = there.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted.dedup();
    let least = sorted.windows(2).map(|w| w[1] - w[0]).fold(f64::INFINITY, f64::min);
    if 2 * sorted.len() < there.len() && fits(least, sorted[0], 0.05) { least } else { 0.0 }
}

/// Ranges of readings that repeat the one before, where the readings around them differ.
fn hangs(readings: &[f64], resolution: f64) -> Vec<std::ops::Range<usize>> {
    let mut out = Vec::new();
    let mut start = 0;
    for k in 1..=readings.len() {
        if readings.get(k) == Some(&readings[start]) {
            continue;
        }
        let length = k - start;
        if length >= HANGS {
            let around = start.saturating_sub(2 * length)..(k + 2 * length).min(readings.len());
            let apart = |j: usize| (readings[j + 1] - readings[j]).abs();
            let outside = (around.start..around.end - 1).filter(|j| !(start..k - 1).contains(j));
            let typical = median_of(outside.map(apart).filter(|d| !d.is_nan())).unwrap_or(0.0);
            if typical > MOVES * resolution {
                out.push(start + 1..k);
            }
        }
        start = k;
    }
    out
}

/// Whether the range of the instrument ends within the motion: readings pile up at the largest or the least value, in
/// several visits.
fn clipped(readings: &[f64], resolution: f64) -> Option<String> {
    let there: Vec<f64> = readings.iter().copied().filter(|r| !r.is_nan()).collect();
    let low = there.iter().copied().fold(f64::INFINITY, f64::min);
    let high = there.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let bin = resolution.max((high - low) / BINS);
    [(high, "largest"), (low, "least")].into_iter().find_map(|(end, which)| {
        let at_end = there.iter().filter(|r| **r == end).count();
        let beside = there.iter().filter(|r| **r != end && (**r - end).abs() < 1.01 * bin).count();
        let visits = readings.windows(2).filter(|w| w[1] == end && w[0] != end).count();
        (at_end >= HANGS && visits >= VISITS && at_end > PILED * beside).then(|| {
            format!(
                "{at_end} readings have exactly the {which} value, {end} mm, and few are close to it: the range of the \
                 instrument ends there"
            )
        })
    })
}

/// Whether readings are copies of the ones before, or lie on straight lines between others: then they were not read at
/// the times that the record gives.
fn copies(readings: &[f64], resolution: f64) -> Option<String> {
    let quarter = readings.len() / 4;
    // The share of equal neighbours, where the others differ by more than rounding, in all parts of the record: at the
    // end of a free decay, neighbours are equal because nothing moves.
    let share = |order: usize| {
        let part = |part: &[f64]| {
            let differences: Vec<f64> = match order {
                1 => part.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|d| !d.is_nan()).collect(),
                _ => part.windows(3).map(|w| (w[2] - 2.0 * w[1] + w[0]).abs()).filter(|d| !d.is_nan()).collect(),
            };
            let size = part.iter().filter(|r| !r.is_nan()).map(|r| r.abs()).fold(0.0, f64::max);
            // Halves of a step are rounded to either side.
            let none = (order as f64 - 1.0) * 1.01 * resolution + 1e-12 * size;
            let (same, other): (Vec<f64>, Vec<f64>) = differences.iter().partition(|d| **d <= none);
            let moved = median_of(other).unwrap_or(0.0) > 2.0 * MOVES * resolution.max(1e-12 * size);
            if moved { same.len() as f64 / differences.len() as f64 } else { 0.0 }
        };
        (0..4).map(|k| part(&readings[k * quarter..(k + 1) * quarter])).fold(1.0, f64::min)
    };
    let (copied, straight) = (share(1), share(2));
    if copied > COPIES {
        let percent = 100.0 * copied;
        return Some(format!(
            "{percent:.0} % of the readings repeat the one before: the branch was read more seldom than the times say"
        ));
    }
    (straight > COPIES).then(|| {
        format!(
            "{:.0} % of the readings lie on straight lines between others: they were interpolated, not read",
            100.0 * straight
        )
    })
}
