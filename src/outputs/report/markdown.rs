//! The rows as Markdown tables, for terminals, issues and notes.

use crate::model::{
    CheckReport, FitComparison, FitReport, PlanReport, QualityLevel, Report, ReportVerdict, SectionReport,
};
use crate::number::{count, duration, percent, plain};
use crate::quantity::{channel_word, parameter, symbol};
use crate::{figure, lines};
use mesophyll_scene::manifest::ViewKind;
use std::fmt::Write;

/// Renders a report.
pub fn render(report: &Report) -> String {
    let mut out = format!(
        "# {}\n\n**{}.** {}\n",
        inline(&report.title),
        report.verdict.level.word(),
        inline(&report.verdict.sentence)
    );
    for c in &report.checks {
        check(&mut out, c);
    }
    for c in &report.comparisons {
        comparison(&mut out, c);
    }
    for f in &report.fits {
        fit(&mut out, f);
    }
    for p in &report.plans {
        plan(&mut out, p);
    }
    out
}

/// Text inside a line or a cell: no line breaks, no column breaks, no markup.
fn inline(text: &str) -> String {
    text.replace(['\n', '\r'], " ").replace('|', "\\|").replace('<', "&lt;").replace('*', "\\*").replace('`', "'")
}

fn table(out: &mut String, head: &[&str], rows: impl IntoIterator<Item = Vec<String>>) {
    let mut rows = rows.into_iter().peekable();
    if rows.peek().is_none() {
        return;
    }
    let _ = writeln!(out, "\n| {} |\n|{}", head.join(" | "), " --- |".repeat(head.len()));
    for row in rows {
        let cells: Vec<String> = row.iter().map(|c| inline(c)).collect();
        let _ = writeln!(out, "| {} |", cells.join(" | "));
    }
}

fn heading(out: &mut String, level: usize, text: &str) {
    let _ = writeln!(out, "\n{} {}", "#".repeat(level), inline(text));
}

fn list(out: &mut String, items: &[String]) {
    if items.is_empty() {
        return;
    }
    let lines: Vec<String> = items.iter().map(|i| format!("- {}", inline(i))).collect();
    let _ = writeln!(out, "\n{}", lines.join("\n"));
}

fn or_dash(value: Option<f64>, format: impl Fn(f64) -> String) -> String {
    value.map_or_else(|| "—".into(), format)
}

fn reasons(out: &mut String, v: &ReportVerdict) {
    let mark = |l: QualityLevel| match l {
        QualityLevel::Good => "ok",
        QualityLevel::Doubtful => "look",
        QualityLevel::Bad => "BAD",
    };
    let lines: Vec<String> = v.reasons.iter().map(|r| format!("{}: {}", mark(r.level), r.text)).collect();
    if !lines.is_empty() {
        list(out, &lines);
    }
}

fn fit(out: &mut String, f: &FitReport) {
    heading(out, 2, &format!("{} ({})", f.name, f.kind.words()));
    let _ = writeln!(out, "\n**{}**", inline(&f.verdict.sentence));
    reasons(out, &f.verdict);
    if let Some(next) = &f.next_measurement {
        let _ = writeln!(out, "\nWhat to measure next: {}.", inline(&next.sentence));
    }
    if !f.parameters.is_empty() {
        heading(out, 3, "Parameters");
        let rows = f.parameters.iter().map(|p| {
            let cell = lines::parameter_cell(p);
            let text = with_estimate(cell.text, &cell.note);
            let (symbol, meaning) = parameter(&p.name);
            vec![p.section.clone(), symbol, meaning.into(), channel_word(&p.channel).into(), text, p.unit.clone()]
        });
        table(out, &["side", "parameter", "what it is", "channel", "value ± standard error", "unit"], rows);
        let undetermined = f.parameters.iter().any(|p| p.undetermined.is_some());
        let shared = f.parameters.iter().any(|p| p.stderr_caliper.is_some());
        let rule = lines::rule(f.kind);
        for (_, text) in [(undetermined, &*rule), (shared, lines::CALIPER)].iter().filter(|(met, _)| *met) {
            let _ = writeln!(out, "\n{text}");
        }
    }
    if !f.maps.is_empty() {
        heading(out, 3, "Maps");
        let rows = f.maps.iter().map(|m| {
            vec![
                m.section.clone(),
                symbol(&m.quantity),
                channel_word(&m.channel).into(),
                count(m.summary.samples),
                plain(m.summary.p01),
                plain(m.summary.median),
                plain(m.summary.p99),
                or_dash(m.stderr_median, plain),
                count(m.undetermined),
                or_dash(m.truth.map(|t| t.median_absolute), plain),
                or_dash(m.truth.and_then(|t| t.coverage95), percent),
                m.unit.clone(),
            ]
        });
        let head = [
            "side",
            "map",
            "channel",
            "texels",
            "1 %",
            "median",
            "99 %",
            "median standard error",
            "undetermined",
            "median error to truth",
            "inside 95 %",
            "unit",
        ];
        table(out, &head, rows);
    }
    for s in &f.sections {
        section(out, s);
    }
    if let Some(t) = &f.times {
        heading(out, 3, "Run time");
        let memory = t.peak_memory_mib.map(|m| format!(", peak memory {} MiB", plain(m))).unwrap_or_default();
        let _ = writeln!(out, "\nTotal {} on {} threads{memory}.", duration(t.total_s), t.threads);
        table(
            out,
            &["phase", "time", "share"],
            lines::phase_lines(t).into_iter().map(|p| vec![p.name, p.time, percent(p.share / 100.0)]),
        );
        for (name, rows) in &t.traces {
            heading(out, 4, &format!("Error against run time: {}", figure::words(name)));
            let rows = rows.iter().map(|r| {
                vec![
                    r.iteration.to_string(),
                    count(r.evaluations),
                    duration(r.elapsed_s),
                    plain(r.cost),
                    plain(r.gradient),
                    or_dash(r.truth_error, plain),
                ]
            });
            table(out, &["iteration", "evaluations", "time", "cost", "gradient", "error to truth"], rows);
        }
    }
    if !f.missing.is_empty() {
        heading(out, 3, "What this fit does not hold");
        list(out, &f.missing);
    }
}

fn section(out: &mut String, s: &SectionReport) {
    let head = |what: &str| if s.name == "all" { what.to_string() } else { format!("{what}, {}", s.name) };
    if !s.residuals.is_empty() {
        heading(out, 3, &head("Residuals"));
        let rows = s.residuals.iter().map(|(n, r)| {
            let at = format!("{}, {}", r.worst_at[0], r.worst_at[1]);
            vec![
                figure::words(n),
                count(r.samples),
                plain(r.chi2),
                plain(r.reduced_chi2),
                plain(r.rms),
                plain(r.worst),
                at,
            ]
        });
        table(out, &["of", "samples", "χ²", "reduced χ²", "RMS", "worst texel", "at column, row"], rows);
    }
    if !s.truth.is_empty() {
        heading(out, 3, &head("Against the truth"));
        let rows = s.truth.iter().map(|(n, t)| {
            vec![
                symbol(n),
                percent(t.median_relative),
                percent(t.p99_relative),
                lines::coverage(t.coverage95, t.judged),
            ]
        });
        table(out, &["quantity", "median error", "99 % within", "truths inside 95 % intervals"], rows);
    }
    if !s.counts.is_empty() || !s.terminations.is_empty() || s.condition.is_some() {
        heading(out, 3, &head("How it ended"));
        table(out, &["reason to stop", "runs"], s.terminations.iter().map(|(n, c)| vec![figure::words(n), count(*c)]));
        table(out, &["texels", "count"], s.counts.iter().map(|(n, c)| vec![figure::words(n), count(*c)]));
        if let Some(c) = s.condition {
            let rank = s.rank.map(|r| format!(", rank {r}")).unwrap_or_default();
            let _ = writeln!(out, "\nCondition number {}{rank}.", plain(c));
        }
    }
    if !s.correlation_names.is_empty() {
        heading(out, 3, &head("Correlations"));
        let labels: Vec<String> = s.correlation_names.iter().map(|n| lines::channel_of(n)).collect();
        let mut names = vec![""];
        names.extend(labels.iter().map(String::as_str));
        let rows = s.correlation.iter().zip(&s.correlation_names).map(|(line, n)| {
            let mut row = vec![lines::channel_of(n)];
            row.extend(line.iter().map(|v| format!("{v:.2}")));
            row
        });
        table(out, &names, rows);
    }
    let figures = lines::figures(&s.figures);
    if !s.figures.is_empty() {
        heading(out, 3, &head("Figures"));
        let mut names = vec![figures.heading.as_str()];
        names.extend(figures.columns.iter().map(String::as_str));
        let lines = figures.table.into_iter().map(|(n, cells)| [vec![n], cells].concat());
        table(out, &names, lines);
        table(
            out,
            &["figure", "value", "what it means"],
            figures.single.into_iter().map(|f| vec![f.name, f.value, f.meaning.into()]),
        );
        if figures.unnamed > 0 {
            let _ = writeln!(
                out,
                "\nFigures of fit.toml that have no name in this version of the report: {}.",
                figures.unnamed
            );
        }
    }
}

fn with_estimate(text: String, estimate: &str) -> String {
    if estimate.is_empty() { text } else { format!("{text} ({estimate})") }
}

fn comparison(out: &mut String, c: &FitComparison) {
    heading(out, 2, &format!("{} against {}", c.second, c.first));
    let _ = writeln!(out, "\n{}", inline(&c.sentence));
    let rows = c.parameters.iter().map(|p| {
        vec![
            p.section.clone(),
            symbol(&p.name),
            channel_word(&p.channel).into(),
            with_estimate(lines::value_or_word(p.first, p.first_stderr), &p.estimates[0]),
            with_estimate(lines::value_or_word(p.second, p.second_stderr), &p.estimates[1]),
            or_dash(p.difference, plain),
            lines::sigmas(p),
            p.unit.clone(),
        ]
    });
    table(
        out,
        &["side", "parameter", "channel", "first", "second", "difference", "in combined standard errors", "unit"],
        rows,
    );
    let rows = c.maps.iter().map(|m| {
        vec![
            m.section.clone(),
            symbol(&m.quantity),
            channel_word(&m.channel).into(),
            count(m.texels),
            plain(m.median_difference),
            plain(m.p99_absolute),
            or_dash(m.beyond95, percent),
            m.unit.clone(),
        ]
    });
    table(
        out,
        &["side", "map", "channel", "texels", "median difference", "99 % within", "beyond 1.96 σ", "unit"],
        rows,
    );
    if !c.notes.is_empty() {
        list(out, &c.notes);
    }
}

fn check(out: &mut String, c: &CheckReport) {
    heading(out, 2, "Pictures, checked against the reference");
    let verdict = |p: Option<bool>| match p {
        Some(true) => "passed",
        Some(false) => "missed",
        None => "not judged",
    };
    let _ = writeln!(out, "\nDrawn by {}: {}.", inline(&c.adapter), verdict(c.passed));
    let rows = c.views.iter().map(|v| {
        let get = |name: &str| v.figures.get(name).copied();
        let limit = |name: &str| get(name).map_or_else(|| "not judged".into(), plain);
        // A card is compared with a formula; its look is not compared with the reference.
        let flip = if v.kind == ViewKind::Card { "not judged".into() } else { limit("threshold_flip_p99") };
        let [found, noise, error, error_noise] =
            ["flip_p99", "noise_flip_p99", "max_error", "noise_max_error"].map(|name| or_dash(get(name), plain));
        let times = ["frame_ms_median", "frame_ms_p95"].map(|name| or_dash(get(name), plain));
        [
            vec![
                v.name.clone(),
                verdict(v.passed).into(),
                found,
                flip,
                noise,
                error,
                limit("threshold_max_error"),
                error_noise,
            ],
            times.to_vec(),
        ]
        .concat()
    });
    let head = [
        "view",
        "verdict",
        "FLIP, 99 % of the pixels",
        "at most",
        "noise",
        "largest error",
        "at most",
        "noise",
        "frame median (ms)",
        "frame 95 % (ms)",
    ];
    table(out, &head, rows);
    list(out, &c.views.iter().flat_map(|v| v.why.iter().map(|w| format!("{}: {w}", v.name))).collect::<Vec<_>>());
    if !c.missing.is_empty() {
        list(out, &c.missing);
    }
}

fn plan(out: &mut String, p: &PlanReport) {
    heading(out, 2, "What was left out, and why");
    table(
        out,
        &["left out", "because", "saved"],
        p.left_out.iter().map(|i| vec![i.name.clone(), i.reason.clone(), i.saved.clone()]),
    );
    table(out, &["needed", "because"], p.needed.iter().map(|i| vec![i.name.clone(), i.reason.clone()]));
}
