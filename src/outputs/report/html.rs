//! The report as one HTML file: without anything from the network, in light or dark by the reader's preference. Its one
//! script (`page.js`) is for looking closer; without scripts everything but the values under the pointer is shown.

use crate::model::{FitComparison, FitReport, Report, ReportPicture, ViewReport};
use crate::number;
use crate::quantity::{channel_word, symbol};
use crate::size::ReportDetail;
use crate::{Error, Result};
use crate::{chart, colour, figure, lines, translucency};
use mesophyll_fits::record::FitKind;
use minijinja::value::{Serde, Value};
use minijinja::{AutoEscape, Environment, context};

/// The page and its parts, in reading order.
const TEMPLATES: [(&str, &str); 7] = [
    ("page", include_str!("page.html")),
    ("macros", include_str!("macros.html")),
    ("checks", include_str!("checks.html")),
    ("fit", include_str!("fit.html")),
    ("captures", include_str!("captures.html")),
    ("true_leaf", include_str!("true_leaf.html")),
    ("held_out", include_str!("held_out.html")),
];
const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// Renders a report that was read with pictures.
pub fn render(report: &Report, detail: &ReportDetail) -> Result<String> {
    let failed = |e: minijinja::Error| Error::Missed(format!("the report's template cannot be filled: {e:#}"));
    let mut env = Environment::new();
    env.set_auto_escape_callback(|_| AutoEscape::Html);
    env.add_filter("num", |v: &Value| number_or_dash(v, number::plain));
    env.add_filter("hundredths", |v: &Value| number_or_dash(v, |n| format!("{n:.2}").replace('-', "\u{2212}")));
    env.add_filter("pct", |v: &Value| number_or_dash(v, number::percent));
    env.add_filter("duration", |v: &Value| number_or_dash(v, number::duration));
    env.add_filter("thousands", |v: &Value| number_or_dash(v, |n| number::count(n.max(0.0) as usize)));
    env.add_filter("words", |v: String| figure::words(&v));
    env.add_filter("parameter", |v: String| lines::channel_of(&v));
    env.add_filter("residual_unit", |v: String| lines::residual_unit(&v));
    env.add_filter("coverage", |v: &Value| coverage(v));
    env.add_filter("symbol", |v: String| symbol(&v));
    env.add_filter("colour_word", |v: String| channel_word(&v).to_string());
    for (name, text) in TEMPLATES {
        env.add_template(name, text).map_err(failed)?;
    }
    let fits: Vec<Value> = report.fits.iter().map(fit).collect();
    let comparisons: Vec<Value> = report.comparisons.iter().map(comparison).collect();
    let checks: Vec<Value> = report
        .checks
        .iter()
        .map(|c| {
            let captures: Vec<_> = c.captures.iter().map(|r| &r.pictures).collect();
            let views: Vec<_> = c.views.iter().map(shot).collect();
            context! { row => Serde(c), views => views, captures => Serde(&captures) }
        })
        .collect();
    let page = env.get_template("page").map_err(failed)?;
    page.render(context! {
        glossary => Serde(crate::glossary::entries()),
        style => Value::from_safe_string(format!("{STYLE}{}", crate::chart::ramps())),
        script => Value::from_safe_string(SCRIPT.into()),
        scales => [colour::sequential(), colour::diverging()].map(colour::listed).to_vec(),
        detail_words => detail.words(),
        title => report.title.clone(),
        program => report.program.clone(),
        verdict => Serde(&report.verdict),
        word => report.verdict.level.word(),
        fits,
        comparisons,
        checks,
        plans => Serde(&report.plans),
    })
    .map(|html| keep_together(&html))
    .map_err(failed)
}

/// Keeps a number and its percent sign, and `h + δ`, on one line.
fn keep_together(html: &str) -> String {
    html.replace(" %", "\u{a0}%").replace("h + δ", "h\u{a0}+\u{a0}δ")
}

fn fit(f: &FitReport) -> Value {
    let (truth_chart, cost_chart) = lines::trace_charts(f);
    let lines = lines::parameter_lines(&f.parameters);
    let sections: Vec<Value> =
        f.sections.iter().map(|s| context! { row => Serde(s), figures => Serde(lines::figures(&s.figures)) }).collect();
    context! {
        row => Serde(f),
        word => f.verdict.level.word(),
        kind_words => f.kind.words(),
        coloured => lines.iter().any(|l| l.cells.len() == 3),
        rule => if f.parameters.iter().any(|p| p.undetermined.is_some()) { lines::rule(f.kind) } else { String::new() },
        caliper => if f.parameters.iter().any(|p| p.stderr_caliper.is_some()) { lines::CALIPER } else { "" },
        parameters => Serde(lines),
        sections,
        sides => Serde(&f.pictures),
        held_out => Serde(&f.held_out.pictures),
        phases => Serde(f.times.as_ref().map(lines::phase_lines).unwrap_or_default()),
        truth_chart,
        cost_chart,
        steps_chart => crate::pictures::chart(&f.name, &f.steps),
        made => Serde(if f.kind == FitKind::Translucency { translucency::how(&f.options) } else { Vec::new() }),
        has_truth => f.maps.iter().any(|m| m.truth.is_some()) || f.sections.iter().any(|s| !s.truth.is_empty()),
    }
}

fn comparison(c: &FitComparison) -> Value {
    let lines: Vec<Value> = c
        .parameters
        .iter()
        .map(|p| {
            context! {
                section => p.section.clone(),
                symbol => symbol(&p.name),
                channel => channel_word(&p.channel),
                unit => p.unit.clone(),
                first => lines::value_or_word(p.first, p.first_stderr),
                second => lines::value_or_word(p.second, p.second_stderr),
                estimates => Serde(&p.estimates),
                difference => p.difference.map_or_else(|| "—".into(), number::plain),
                sigmas => lines::sigmas(p),
                apart => p.sigmas.is_some_and(|s| s.abs() > 1.96),
            }
        })
        .collect();
    context! { row => Serde(c), lines, pictures => Serde(&c.pictures) }
}

fn shot(v: &ViewReport) -> Value {
    let picture = |p: &Option<ReportPicture>| Serde(p.clone());
    let top = |name: &str| v.figures.get(name).copied().filter(|t| *t > 0.0);
    let bar = |ramp: &str, range: Option<(f64, f64)>| range.map(|r| chart::colour_bar(ramp, r, ""));
    context! {
        row => Serde(v),
        image => picture(&v.image),
        reference => picture(&v.reference),
        difference => picture(&v.difference),
        flip => picture(&v.flip),
        true_leaf => picture(&v.true_leaf),
        difference_bar => bar("ramp-grey", top("difference_top").map(|t| (-t, t))),
        flip_bar => bar("ramp-flip", top("flip_top").map(|t| (0.0, t))),
    }
}

/// The share of truths inside their intervals in a `TruthError`, in words.
fn coverage(truth: &Value) -> String {
    let number = |name: &str| truth.get_attr(name).ok().and_then(|v| f64::try_from(v).ok());
    let judged = number("judged").map(|n| n as usize);
    lines::coverage(number("coverage95"), judged)
}

/// A number in words, `—` where there is none.
fn number_or_dash(value: &Value, format: impl Fn(f64) -> String) -> String {
    f64::try_from(value.clone()).map_or_else(|_| "—".into(), format)
}
