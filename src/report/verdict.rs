//! "Is this good?": the rules, in one place. Every reason is said; the worst one rules.

use crate::fit::record::FitRecord;
use crate::report::model::{CheckReport, FitReport, Level, Reason, Verdict};
use crate::report::number::{count, percent, plain, significant};
use crate::report::quantity::symbol;
use std::path::Path;

/// Reduced χ²: 1.4 is a scatter 18 % above the stated noise, 3 is 73 %.
const CHI2_GOOD: std::ops::RangeInclusive<f64> = 0.7..=1.4;
const CHI2_BAD: f64 = 3.0;
/// Share of good texels on the leaf.
const TEXELS_GOOD: f64 = 0.98;
const TEXELS_BAD: f64 = 0.9;
/// Share of runs (texels) that stopped without converging.
const RUNS_GOOD: f64 = 0.002;
const RUNS_BAD: f64 = 0.1;
/// Share of truths inside 95 % intervals.
const COVERAGE_GOOD: std::ops::RangeInclusive<f64> = 0.93..=0.97;
const COVERAGE_USABLE: std::ops::RangeInclusive<f64> = 0.85..=0.995;
/// Relative errors beyond this are not called determined (the promise behind `ok` in batch forms).
const RELATIVE_ERROR: f64 = 0.1;
/// Condition number of the shared problem beyond which half of the digits of an f64 are gone.
const CONDITION: f64 = 1e8;

/// Judges a fit by its record and by what was read of its folder.
pub fn of_fit(record: &FitRecord, folder: &Path, report: &FitReport) -> Verdict {
    let mut reasons = Vec::new();
    let mut say = |level: Level, text: String| reasons.push(Reason { level, text });
    match record.termination {
        Some(t) if t.converged() => say(Level::Good, format!("the fit converged ({})", t.name().replace('_', " "))),
        Some(t) => say(Level::Bad, format!("the fit did not converge: {}", t.name().replace('_', " "))),
        None => {}
    }
    for s in &report.sections {
        let side = if s.name == "all" { String::new() } else { format!("{}: ", s.name) };
        for (what, r) in &s.residuals {
            let chi2 = r.reduced_chi2;
            let fact = format!("{side}reduced χ² of {what} is {}", significant(chi2, 3));
            if !chi2.is_finite() {
                say(Level::Bad, format!("{side}the residuals of {what} have no reduced χ²"));
            } else if CHI2_GOOD.contains(&chi2) {
                say(Level::Good, format!("{fact}: the model explains the measurements within their stated noise"));
            } else if chi2 < 1.0 {
                say(Level::Doubtful, format!("{fact}: the measurements scatter less than their stated noise"));
            } else if chi2 > CHI2_BAD {
                say(Level::Bad, format!("{fact}: the model does not describe these measurements"));
            } else {
                say(Level::Doubtful, format!("{fact}: the model leaves more than the stated noise"));
            }
        }
        texels(&side, s, &mut say);
        let (stopped, all) = terminations(s);
        if stopped > 0 {
            let level = match stopped as f64 / all as f64 {
                s if s > RUNS_BAD => Level::Bad,
                s if s > RUNS_GOOD => Level::Doubtful,
                _ => Level::Good,
            };
            match level {
                Level::Good => say(level, format!("{side}all but {} of {} runs converged", count(stopped), count(all))),
                _ => say(level, format!("{side}{} of {} runs did not converge", count(stopped), count(all))),
            }
        }
        truth(&side, s, &mut say);
        if let Some(c) = s.condition.filter(|c| c.is_nan() || *c > CONDITION) {
            say(Level::Doubtful, format!("{side}the shared problem is badly conditioned ({})", plain(c)));
        }
        if let Some(rank) = s.rank.filter(|r| *r < s.correlation_names.len()) {
            say(
                Level::Doubtful,
                format!("{side}rank {rank} of {}: some parameters are not determined together", s.correlation_names.len()),
            );
        }
    }
    parameters(report, &mut say);
    if let Err(e) = record.verify(folder) {
        say(Level::Bad, e.to_string());
    }
    for m in report.missing.iter().filter(|m| m.contains("no maps") || m.contains("not a readable")) {
        say(Level::Doubtful, m.clone());
    }
    finish(&report.name, reasons)
}

fn texels(side: &str, s: &crate::report::model::SectionReport, say: &mut impl FnMut(Level, String)) {
    let inside: usize = s.counts.iter().filter(|(n, _)| *n != "outside").map(|(_, c)| c).sum();
    let Some(good) = s.counts.get("good").copied() else { return };
    if inside == 0 {
        say(Level::Bad, format!("{side}no texel lies on the leaf"));
        return;
    }
    let share = good as f64 / inside as f64;
    let mut fact = format!("{side}{} of {} texels are good", percent(share), count(inside));
    let defects = s.counts.iter().filter(|(n, c)| **c > 0 && !matches!(n.as_str(), "good" | "outside"));
    if let Some((name, n)) = defects.max_by_key(|(_, c)| **c) {
        fact.push_str(&format!(" (most of the rest: {}, {})", name.replace('_', " "), count(*n)));
    }
    let level = match share {
        s if s >= TEXELS_GOOD => Level::Good,
        s if s >= TEXELS_BAD => Level::Doubtful,
        _ => Level::Bad,
    };
    say(level, fact);
}

/// One sentence on the errors and one on the intervals; quantities that miss their mark get sentences of their own.
fn truth(side: &str, s: &crate::report::model::SectionReport, say: &mut impl FnMut(Level, String)) {
    let (mut near, mut covered) = (Vec::new(), Vec::new());
    for (name, t) in &s.truth {
        let q = symbol(name);
        if t.median_relative <= RELATIVE_ERROR {
            near.push(format!("{q} {}", percent(t.median_relative)));
        } else {
            say(Level::Doubtful, format!("{side}{q} is {} from the known truth (median)", percent(t.median_relative)));
        }
        let Some(c) = t.coverage95 else { continue };
        if COVERAGE_GOOD.contains(&c) {
            covered.push(format!("{q} {}", percent(c)));
            continue;
        }
        let level = if COVERAGE_USABLE.contains(&c) { Level::Doubtful } else { Level::Bad };
        let meaning = if c < 0.95 { "too small" } else { "too large" };
        say(level, format!("{side}95 % intervals of {q} hold {} of the truths: the stated errors are {meaning}", percent(c)));
    }
    if !near.is_empty() {
        say(Level::Good, format!("{side}median error to the known truth: {}", near.join(", ")));
    }
    if !covered.is_empty() {
        say(Level::Good, format!("{side}the stated errors are right: 95 % intervals hold the truth of {}", covered.join(", ")));
    }
}

/// (runs that did not converge, all runs).
fn terminations(s: &crate::report::model::SectionReport) -> (usize, usize) {
    const CONVERGED: [&str; 4] = ["gradient_small", "cost_converged", "step_small", "direct"];
    let stopped = s.terminations.iter().filter(|(n, _)| !CONVERGED.contains(&n.as_str())).map(|(_, c)| c).sum();
    (stopped, s.terminations.values().sum())
}

fn parameters(report: &FitReport, say: &mut impl FnMut(Level, String)) {
    let undetermined: Vec<String> = report
        .parameters
        .iter()
        .filter_map(|p| {
            let reason = p.undetermined.as_ref()?;
            let place = if p.section == "all" { String::new() } else { format!(" of the {}", p.section) };
            let channel = if p.channel.is_empty() { String::new() } else { format!(".{}", p.channel) };
            let why = if reason.is_empty() { String::new() } else { format!(" ({reason})") };
            Some(format!("{}{channel}{place}{why}", symbol(&p.name)))
        })
        .collect();
    if !undetermined.is_empty() {
        say(Level::Doubtful, format!("not determined by the data: {}", undetermined.join("; ")));
    }
    let loose: Vec<String> = report
        .parameters
        .iter()
        .filter(|p| p.undetermined.is_none())
        .filter_map(|p| {
            let relative = p.stderr? / p.value.filter(|v| *v != 0.0)?.abs();
            let channel = if p.channel.is_empty() { String::new() } else { format!(".{}", p.channel) };
            (relative > RELATIVE_ERROR).then(|| format!("{} {}{channel} ± {}", p.section, symbol(&p.name), percent(relative)))
        })
        .collect();
    if !loose.is_empty() {
        say(Level::Doubtful, format!("known to worse than {}: {}", percent(RELATIVE_ERROR), loose.join(", ")));
    }
}

/// Judges a check.
pub fn of_check(check: &CheckReport) -> Reason {
    let failed: Vec<&str> = check.views.iter().filter(|v| v.passed == Some(false)).map(|v| v.name.as_str()).collect();
    match check.passed {
        Some(true) if failed.is_empty() => {
            let views = check.views.len();
            let what = if views == 1 { "the picture agrees".into() } else { format!("all {views} pictures agree") };
            Reason { level: Level::Good, text: format!("{what} with the reference renderer ({})", check.adapter) }
        }
        None => Reason { level: Level::Doubtful, text: "check.json does not say whether the check passed".into() },
        _ if failed.is_empty() => Reason { level: Level::Bad, text: "the picture check missed its threshold".into() },
        _ => Reason { level: Level::Bad, text: format!("the picture check missed its threshold in {}", failed.join(", ")) },
    }
}

/// The verdict over everything in the report.
pub fn overall(fits: &[FitReport], checks: &[CheckReport]) -> Verdict {
    let mut reasons: Vec<Reason> =
        fits.iter().map(|f| Reason { level: f.verdict.level, text: f.verdict.sentence.trim_end_matches('.').to_string() }).collect();
    reasons.extend(checks.iter().map(of_check));
    let level = reasons.iter().map(|r| r.level).max().unwrap_or(Level::Doubtful);
    let sentence = match (level, reasons.is_empty()) {
        (_, true) => "There is nothing to judge: no fit and no check were found.".into(),
        (Level::Good, _) => "Every fit and check met its mark.".into(),
        (Level::Doubtful, _) => "Something needs a look before the numbers are relied on.".into(),
        (Level::Bad, _) => "Something missed its mark.".into(),
    };
    Verdict { level, sentence, reasons }
}

/// The worst level, and a sentence with up to three reasons of that level.
fn finish(name: &str, mut reasons: Vec<Reason>) -> Verdict {
    reasons.sort_by_key(|r| std::cmp::Reverse(r.level));
    let level = reasons.iter().map(|r| r.level).max().unwrap_or(Level::Doubtful);
    let mut ruling: Vec<&str> = reasons.iter().filter(|r| r.level == level).map(|r| r.text.as_str()).collect();
    let more = ruling.len().saturating_sub(3);
    ruling.truncate(3);
    let mut sentence = match level {
        Level::Good => format!("{name} is good: {}", ruling.join("; ")),
        Level::Doubtful if reasons.is_empty() => format!("{name} cannot be judged: the fit states no residuals, counts or errors"),
        Level::Doubtful => format!("{name} is usable with care: {}", ruling.join("; ")),
        Level::Bad => format!("{name} is not good: {}", ruling.join("; ")),
    };
    if more > 0 {
        sentence.push_str(&format!("; and {more} more"));
    }
    sentence.push('.');
    Verdict { level, sentence, reasons }
}
