//! "Is this good?": all rules in one place. Every reason is stated; the worst one decides.

use crate::lines::{self, MANY};
use crate::model::{FitReport, QualityLevel, ReportVerdict, SectionReport, VerdictReason};
use crate::number::{count, percent, plain};
use crate::quantity::{parameter, symbol};
use crate::{held_out, residuals};
use mesophyll_fits::record::fault::FaultGrade;
use mesophyll_fits::record::{DISCARDED, FitKind, FitRecord, GAUGE_GAMMA, GAUGE_THICKNESS, READINGS};
use mesophyll_fits::translucency::judge::NAMES;
use mesophyll_optics::defect::Defect;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::path::Path;

/// Shares of good texels on the leaf above which a leaf is good, and below which it is bad.
const TEXELS_GOOD: f64 = 0.98;
const TEXELS_BAD: f64 = 0.9;
/// Share of readings that may be left out as outliers: noise reaches that far in one of 150,000.
const DISCARDED_GOOD: f64 = 0.001;
/// Share of runs (texels) that stopped without converging.
const RUNS_GOOD: f64 = 0.002;
const RUNS_BAD: f64 = 0.1;
/// Share of truths inside 95 % intervals.
const COVERAGE_GOOD: std::ops::RangeInclusive<f64> = 0.93..=0.97;
const COVERAGE_USABLE: std::ops::RangeInclusive<f64> = 0.85..=0.995;
/// A median error to the truth below this is small, whatever its interval says.
const CLOSE: f64 = 0.01;
/// A value with a larger relative error is not called determined (the promise behind `ok` in batch forms).
const RELATIVE_ERROR: f64 = mesophyll_fits::record::next::DETERMINED;
/// The same for angles (degrees).
const ANGLE_ERROR: f64 = 3.0;
/// Above this condition number of the shared problem, half of the digits of an f64 are lost.
const CONDITION: f64 = 1e8;

/// Judges a fit by its record and by what was read from its folder.
pub fn of_fit(record: &FitRecord, folder: &Path, report: &FitReport) -> ReportVerdict {
    let mut reasons = Vec::new();
    // Whether a reason rests on a truth that only a synthetic capture holds, and whether any other is bad.
    let (by_truth, missed) = (Cell::new(false), Cell::new(false));
    let mut say = |level: QualityLevel, text: String| {
        missed.set(missed.get() || (level == QualityLevel::Bad && !by_truth.get()));
        reasons.push(VerdictReason { level, text });
    };
    match record.termination {
        Some(t) if t.converged() => {
            say(QualityLevel::Good, format!("the fit converged ({})", t.name().replace('_', " ")))
        }
        Some(t) => say(QualityLevel::Bad, format!("the fit did not converge: {}", t.name().replace('_', " "))),
        None => {}
    }
    for fault in &record.faults {
        let level = if fault.grade == FaultGrade::Wrong { QualityLevel::Bad } else { QualityLevel::Doubtful };
        say(level, fault.says.clone());
    }
    for s in &report.sections {
        let side = if s.name == "all" { String::new() } else { format!("{}: ", s.name) };
        approximation(&side, s, &mut say);
        // A function that is approximated has no noise with which its residuals could be compared.
        for (what, r) in s.residuals.iter().filter(|_| !approximates(s)) {
            let (level, text) = residuals::judge(what, r, record, s);
            say(level, format!("{side}{text}"));
        }
        texels(&side, s, &record.defects, &mut say);
        discarded(&side, s, &mut say);
        shared_problems(&side, s, &mut say);
        let (stopped, all) = terminations(s);
        if stopped > 0 {
            let level = match stopped as f64 / all as f64 {
                s if s > RUNS_BAD => QualityLevel::Bad,
                s if s > RUNS_GOOD => QualityLevel::Doubtful,
                _ => QualityLevel::Good,
            };
            match level {
                QualityLevel::Good => {
                    say(level, format!("{side}all but {} of {} runs converged", count(stopped), count(all)))
                }
                _ => say(level, format!("{side}{} of {} runs did not converge", count(stopped), count(all))),
            }
        }
        by_truth.set(true);
        truth(&side, s, &mut say);
        by_truth.set(false);
        directions(&side, s, &mut say);
        if let Some(c) = s.condition.filter(|c| c.is_nan() || *c > CONDITION) {
            say(QualityLevel::Doubtful, format!("{side}the shared problem is badly conditioned ({})", plain(c)));
        }
        if let Some(rank) = s.rank.filter(|r| *r < s.correlation_names.len()) {
            say(
                QualityLevel::Doubtful,
                format!(
                    "{side}rank {rank} of {}: some parameters are not determined together",
                    s.correlation_names.len()
                ),
            );
        }
    }
    residuals::unseen_tilt(record, &mut say);
    residuals::sides(record, &mut say);
    held_out::reasons(&report.held_out, &mut say);
    parameters(report, &mut say);
    let doubt = record.options.get("doubt").filter(|_| record.kind == FitKind::Translucency);
    let doubt = doubt.map(|doubt| format!("{doubt}; the maps are not to be relied on"));
    let stated = record.stated_in_one().map(|said| format!("{said}; nothing of it was measured"));
    doubt.into_iter().chain(stated).for_each(|text| say(QualityLevel::Doubtful, text));
    match mesophyll_fits::consistency::of(folder) {
        Ok(faults) => {
            faults.all().for_each(|what| say(QualityLevel::Bad, what.clone()));
            faults.notes.iter().chain(&faults.unseen).for_each(|what| say(QualityLevel::Doubtful, what.clone()));
        }
        Err(e) => say(QualityLevel::Bad, e.to_string()),
    }
    for m in report.missing.iter().filter(|m| m.contains("no maps") || m.contains("not a readable")) {
        say(QualityLevel::Doubtful, m.clone());
    }
    ReportVerdict { missed: missed.get(), ..finish(&report.name, reasons) }
}

/// Worst errors of approximated functions: their name, what is good, what is bad, and what they are relative to.
const APPROXIMATIONS: [(&str, f64, f64, &str); 3] = [
    ("error_worst", 1.1e-4, 0.01, "the smallest c00"),
    ("worst_error_of_tip", 0.01, 0.05, "the tip's deflection"),
    ("irradiance_error_worst", 0.05, 0.2, "an anchor's irradiance (standard error)"),
];

fn approximates(s: &SectionReport) -> bool {
    APPROXIMATIONS.iter().any(|a| s.figures.contains_key(a.0))
}

/// Fits of a function (a sky's polynomials, a branch's basis, the light at a scene's anchors) are judged by their worst
/// error.
fn approximation(side: &str, s: &SectionReport, say: &mut impl FnMut(QualityLevel, String)) {
    for (name, good, bad, unit) in APPROXIMATIONS {
        let Some(error) = s.figures.get(name) else { continue };
        let fact = format!("{side}worst error {} of {unit}", plain(*error));
        let level = match *error {
            e if e <= good => QualityLevel::Good,
            e if e <= bad => QualityLevel::Doubtful,
            _ => QualityLevel::Bad,
        };
        say(level, fact);
    }
}

/// The part of the transmitted light that a directional basis leaves out, at its worst light angle: RMS over RMS.
const BASIS_GOOD: f64 = 0.05;
const BASIS_BAD: f64 = 0.5;

/// A translucency fit is judged by how well its basis holds the full convolution.
fn directions(side: &str, s: &SectionReport, say: &mut impl FnMut(QualityLevel, String)) {
    // The worst channel at each angle.
    let worst = NAMES.map(|angle| {
        let of = s.figures.iter().filter(|(n, _)| n.starts_with(&format!("basis_rms_{angle}_")));
        of.map(|(_, v)| *v).fold(f64::NAN, f64::max)
    });
    let [steep, half, grazing] = worst.map(percent);
    let level = match worst.into_iter().fold(f64::NAN, f64::max) {
        w if w.is_nan() => return,
        w if w <= BASIS_GOOD => QualityLevel::Good,
        w if w <= BASIS_BAD => QualityLevel::Doubtful,
        _ => QualityLevel::Bad,
    };
    say(
        level,
        format!(
            "{side}the stored directions keep the light that comes through to within {steep}, {half} and {grazing} \
             (root mean square; light at π/2, π/4 \
             and π/8 over the blade)"
        ),
    );
}

fn texels(
    side: &str,
    s: &SectionReport,
    defects: &BTreeMap<String, String>,
    say: &mut impl FnMut(QualityLevel, String),
) {
    let Some(good) = s.counts.get("good").copied() else { return };
    // Besides good and outside, the fates are the named defects. Other counts (of all texels, of undetermined ones)
    // overlap with them.
    let named: Vec<(&String, usize)> =
        s.counts.iter().filter(|(n, _)| defects.values().any(|d| d == *n)).map(|(n, c)| (n, *c)).collect();
    let outside = s.counts.get("outside").copied().unwrap_or(0);
    // Texels on the outline show leaf and background at once; they are left out of photographs by design.
    let edge = named.iter().find(|(name, _)| name.as_str() == Defect::Edge.name()).map_or(0, |(_, n)| *n);
    let inside = s
        .counts
        .get("texels")
        .map_or_else(|| good + named.iter().map(|d| d.1).sum::<usize>(), |all| all.saturating_sub(outside))
        .saturating_sub(edge);
    if inside == 0 {
        say(QualityLevel::Bad, format!("{side}no texel lies on the leaf"));
        return;
    }
    let share = good as f64 / inside as f64;
    let mut fact = format!("{side}{} of {} texels are good", percent(share), count(inside));
    let rest = named.iter().filter(|d| d.1 > 0 && d.0.as_str() != Defect::Edge.name());
    if let Some((name, n)) = rest.max_by_key(|d| d.1) {
        fact.push_str(&format!(" (most of the rest: {}, {})", name.replace('_', " "), count(*n)));
    }
    let level = match share {
        s if s >= TEXELS_GOOD => QualityLevel::Good,
        s if s >= TEXELS_BAD => QualityLevel::Doubtful,
        _ => QualityLevel::Bad,
    };
    say(level, fact);
}

/// Readings that the fit left out as outliers.
fn discarded(side: &str, s: &SectionReport, say: &mut impl FnMut(QualityLevel, String)) {
    let (Some(&left_out), Some(&all)) = (s.counts.get(DISCARDED), s.counts.get(READINGS)) else { return };
    if left_out == 0 {
        return;
    }
    let share = left_out as f64 / all.max(1) as f64;
    let level = if share > DISCARDED_GOOD { QualityLevel::Doubtful } else { QualityLevel::Good };
    let (left_out, all) = (count(left_out), count(all));
    say(level, format!("{side}{left_out} of {all} readings were left out as outliers ({})", percent(share)));
}

/// The number of runs that did not converge and the number of all runs, over the texels. The leaf-wide problem
/// (`leaf_wide:NAME`) is judged separately.
fn terminations(s: &SectionReport) -> (usize, usize) {
    let runs = || s.terminations.iter().filter(|(n, _)| !n.contains(':'));
    let stopped = runs().filter(|(n, _)| !converged(n)).map(|(_, c)| c).sum();
    (stopped, runs().map(|(_, c)| c).sum())
}

fn converged(name: &str) -> bool {
    ["gradient_small", "cost_converged", "step_small", "direct"].contains(&name)
}

/// Problems over the whole leaf that stopped without converging.
fn shared_problems(side: &str, s: &SectionReport, say: &mut impl FnMut(QualityLevel, String)) {
    for (problem, ending) in s.terminations.keys().filter_map(|n| n.split_once(':')) {
        if converged(ending) {
            continue;
        }
        let (problem, ending) = (problem.replace('_', "-"), ending.replace('_', " "));
        say(QualityLevel::Bad, format!("{side}the {problem} problem did not converge: {ending}"));
    }
}

/// One sentence on the errors, one on the intervals that are right, one on those that are too narrow, and one on those
/// that are too wide. Wrong intervals around values within a percent of the truth are doubtful; around worse values
/// they are bad.
fn truth(side: &str, s: &SectionReport, say: &mut impl FnMut(QualityLevel, String)) {
    let (mut near, mut right, mut wide) = (Vec::new(), Vec::new(), Vec::new());
    let (mut narrow, mut narrow_level) = (Vec::new(), QualityLevel::Doubtful);
    for (name, t) in &s.truth {
        let q = symbol(name);
        if t.median_relative <= RELATIVE_ERROR {
            near.push(format!("{q} {}", percent(t.median_relative)));
        } else {
            say(
                QualityLevel::Doubtful,
                format!("{side}{q} is {} from the known truth (median)", percent(t.median_relative)),
            );
        }
        let Some(c) = t.coverage95 else { continue };
        let close = t.median_relative <= CLOSE;
        // A share of a few values says nothing, so they are counted instead. Records of earlier versions do not state
        // their number.
        let few =
            t.judged.or_else(|| matches!(name.as_str(), "sigma_a" | "sigma_s").then_some(3)).filter(|n| *n < MANY);
        if let Some(values) = few {
            // That one of three misses happens by chance in one fit of seven, which is no evidence where eight such
            // triples are judged. That two of three miss happens in one of 140.
            let hit = (c * values as f64).round() as usize;
            match (values, hit) {
                (1, 1) => say(
                    QualityLevel::Good,
                    format!(
                        "{side}the known truth of {q} lies in its 95 % interval (one value, which says little of the \
                         error)"
                    ),
                ),
                (1, _) => say(
                    QualityLevel::Doubtful,
                    format!("{side}the known truth of {q} lies outside its 95 % interval (by chance in one fit of 20)"),
                ),
                _ if hit == values => right.push(format!("{q} in {hit} of {values} channels")),
                (3, 2) => right.push(format!("{q} in 2 of 3 channels (by chance in one fit of seven)")),
                _ => narrow.push(format!("{q} in {hit} of {values} channels")),
            }
            if hit + 1 < values && !close {
                narrow_level = QualityLevel::Bad;
            }
        } else if COVERAGE_GOOD.contains(&c) {
            right.push(format!("{q} {}", percent(c)));
        } else if c > 0.95 {
            wide.push(format!("{q} {}", percent(c)));
        } else {
            narrow.push(format!("{q} {}", percent(c)));
            if !COVERAGE_USABLE.contains(&c) && !close {
                narrow_level = QualityLevel::Bad;
            }
        }
    }
    if let (Some(h), Some(g)) = (s.figures.get(GAUGE_THICKNESS), s.figures.get(GAUGE_GAMMA)) {
        let text = format!(
            "{side}σa, σs, h + δ and γ rest on means over the measured texels, where the known truth's differ: \
             thickness by {}, γ by {}; their stated errors do not \
             hold that and are not judged",
            percent(h.abs()),
            percent(g.abs())
        );
        say(QualityLevel::Doubtful, text);
    }
    let mut state = |level: QualityLevel, head: &str, list: Vec<String>| {
        if !list.is_empty() {
            say(level, format!("{side}{head}: {}", list.join(", ")));
        }
    };
    state(narrow_level, "stated errors are too small, 95 % intervals hold the truth of too few", narrow);
    state(QualityLevel::Doubtful, "stated errors are too large, 95 % intervals hold the truth of too many", wide);
    state(QualityLevel::Good, "median error to the known truth", near);
    state(QualityLevel::Good, "stated errors are right, 95 % intervals hold the truth of", right);
}

fn parameters(report: &FitReport, say: &mut impl FnMut(QualityLevel, String)) {
    let undetermined: Vec<String> = report
        .parameters
        .iter()
        .filter_map(|p| {
            let reason = p.undetermined.as_ref()?;
            let place = if p.section == "all" { String::new() } else { format!(" of the {}", p.section) };
            let channel = if p.channel.is_empty() { String::new() } else { format!(".{}", p.channel) };
            let why = if reason.is_empty() { String::new() } else { format!(" ({reason})") };
            Some(format!("{}{channel}{place}{why}", parameter(&p.name).0))
        })
        .collect();
    if !undetermined.is_empty() {
        let rule = lines::determined(report.kind);
        let rule = if rule.is_empty() { String::new() } else { format!("; {rule}") };
        say(QualityLevel::Doubtful, format!("not determined by the data: {}{rule}", undetermined.join("; ")));
    }
    let loose: Vec<String> = report
        .parameters
        .iter()
        .filter(|p| p.undetermined.is_none())
        .filter_map(|p| {
            let relative = p.stderr? / p.value.filter(|v| *v != 0.0)?.abs();
            let channel = if p.channel.is_empty() { String::new() } else { format!(".{}", p.channel) };
            // A relative error of an angle means nothing, because its zero is a convention.
            let loose = if p.unit == "deg" { p.stderr? > ANGLE_ERROR } else { relative > RELATIVE_ERROR };
            let place = if p.section == "all" { String::new() } else { format!("{} ", p.section) };
            loose.then(|| format!("{place}{}{channel} ± {}", parameter(&p.name).0, percent(relative)))
        })
        .collect();
    if !loose.is_empty() {
        say(QualityLevel::Doubtful, format!("known to worse than {}: {}", percent(RELATIVE_ERROR), loose.join(", ")));
    }
}

/// The worst level, and a sentence with up to three reasons of that level.
fn finish(name: &str, mut reasons: Vec<VerdictReason>) -> ReportVerdict {
    reasons.sort_by_key(|r| std::cmp::Reverse(r.level));
    let level = reasons.iter().map(|r| r.level).max().unwrap_or(QualityLevel::Doubtful);
    let mut ruling: Vec<&str> = reasons.iter().filter(|r| r.level == level).map(|r| r.text.as_str()).collect();
    let more = ruling.len().saturating_sub(3);
    ruling.truncate(3);
    let mut sentence = match level {
        QualityLevel::Good => format!("{name} is good: {}", ruling.join("; ")),
        QualityLevel::Doubtful if reasons.is_empty() => {
            format!("{name} cannot be judged: it states no residuals, counts or errors")
        }
        QualityLevel::Doubtful => format!("{name} is usable with care: {}", ruling.join("; ")),
        QualityLevel::Bad => format!("{name} is not good: {}", ruling.join("; ")),
    };
    sentence += &if more > 0 { format!("; and {more} more.") } else { ".".into() };
    ReportVerdict { level, sentence, missed: level == QualityLevel::Bad, reasons }
}
