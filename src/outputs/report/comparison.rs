//! Two fits side by side: parameters in units of their combined standard errors, maps texel by texel.

use crate::colour::MapFrame;
use crate::lines;
use crate::maps::{ReportSideMaps, difference_picture};
use crate::model::{
    ChannelPictures, FitComparison, FitReport, MapDifference, MapPictures, ParameterDifference, ParameterRow,
};
use crate::number::{percent, significant};
use crate::quantity::{self, channel_word, known};
use crate::size::ReportDetail;
use crate::stats::{quantile, sorted};
use mesophyll_files::quantity::split;

/// Differences of the second fit from the first, without maps.
pub fn parameters(first: &FitReport, second: &FitReport) -> FitComparison {
    let key = |p: &ParameterRow| (p.section.clone(), p.name.clone(), p.channel.clone());
    let mut notes = Vec::new();
    if first.kind != second.kind {
        notes.push(format!("{} is a {} and {} a {}", first.name, first.kind.words(), second.name, second.kind.words()));
    }
    if first.input_hash == second.input_hash && !first.input_hash.is_empty() {
        notes.push("both state the same input hash".into());
    }
    for (name, a) in &first.options {
        match second.options.get(name) {
            Some(b) if a != b => notes.push(format!("option {name}: {a} against {b}")),
            None => notes.push(format!("option {name}: {a} against none")),
            _ => {}
        }
    }
    notes.extend(
        second
            .options
            .iter()
            .filter(|(n, _)| !first.options.contains_key(*n))
            .map(|(n, b)| format!("option {n}: none against {b}")),
    );
    let mut rows = Vec::new();
    for a in &first.parameters {
        match second.parameters.iter().find(|b| key(b) == key(a)) {
            Some(b) => rows.push(difference(a, b)),
            None => notes.push(format!("{} {} {} is in {} only", a.section, a.name, a.channel, first.name)),
        }
    }
    let only: Vec<_> =
        second.parameters.iter().filter(|b| !first.parameters.iter().any(|a| key(a) == key(b))).collect();
    notes.extend(only.iter().map(|b| format!("{} {} {} is in {} only", b.section, b.name, b.channel, second.name)));
    FitComparison {
        first: first.name.clone(),
        second: second.name.clone(),
        sentence: sentence(&rows),
        parameters: rows,
        maps: Vec::new(),
        notes,
        pictures: Vec::new(),
    }
}

fn difference(a: &ParameterRow, b: &ParameterRow) -> ParameterDifference {
    let known = |p: &ParameterRow| if p.undetermined.is_some() { None } else { p.value };
    let difference = known(a).zip(known(b)).map(|(x, y)| y - x);
    let combined = a.stderr.zip(b.stderr).map(|(x, y)| x.hypot(y)).filter(|s| *s > 0.0);
    ParameterDifference {
        section: a.section.clone(),
        name: a.name.clone(),
        channel: a.channel.clone(),
        unit: a.unit.clone(),
        first: known(a),
        first_stderr: a.stderr,
        second: known(b),
        second_stderr: b.stderr,
        estimates: [a, b].map(lines::parameter_cell).map(|c| if c.undetermined { c.note } else { String::new() }),
        difference,
        sigmas: difference.zip(combined).map(|(d, s)| d / s),
    }
}

fn sentence(rows: &[ParameterDifference]) -> String {
    let judged: Vec<(&ParameterDifference, f64)> = rows.iter().filter_map(|r| Some((r, r.sigmas?))).collect();
    let apart = judged.iter().filter(|(_, s)| s.abs() > 1.96).count();
    let Some((worst, sigmas)) = judged.iter().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())) else {
        return "No parameter has standard errors in both fits, so differences cannot be weighed.".into();
    };
    let name = format!("{} {} {}", worst.section, quantity::symbol(&worst.name), channel_word(&worst.channel));
    let most = format!("the largest is {} standard errors ({})", significant(sigmas.abs(), 2), name.trim());
    match apart {
        0 => format!("The fits agree: all {} differences lie within 95 % intervals; {most}.", judged.len()),
        n => format!(
            "The fits differ: {n} of {} parameters by more than 1.96 combined standard errors; {most}.",
            judged.len()
        ),
    }
}

/// Adds a side's maps to a comparison; sides of different size are only noted.
pub fn side(out: &mut FitComparison, a: &ReportSideMaps, b: &ReportSideMaps, pictures: Option<ReportDetail>) {
    let (wa, ha, wb, hb) = (a.fit.width, a.fit.height, b.fit.width, b.fit.height);
    if (wa, ha) != (wb, hb) {
        out.notes.push(format!("{}: maps of {wa} × {ha} and {wb} × {hb} texels are not compared", a.section));
        return;
    }
    let mut names: Vec<&str> =
        a.fit.channels.iter().map(|(n, _)| n.as_str()).filter(|n| !quantity::SET_APART.contains(n)).collect();
    names.sort_by_key(|n| quantity::rank(n));
    for channel in names {
        let (Some(x), Some(y)) = (a.fit.get(channel), b.fit.get(channel)) else {
            out.notes.push(format!("{}: {channel} is in one fit only", a.section));
            continue;
        };
        let both = |i: usize| a.good[i] && b.good[i] && x[i].is_finite() && y[i].is_finite();
        let change = |i: usize| if both(i) { y[i] - x[i] } else { f32::NAN };
        let signed = sorted((0..x.len()).map(change));
        if signed.is_empty() {
            continue;
        }
        let sizes = sorted(signed.iter().map(|v| v.abs()));
        let errors = a.errors.as_ref().and_then(|m| m.get(channel)).zip(b.errors.as_ref().and_then(|m| m.get(channel)));
        let beyond95 = errors.map(|(ea, eb)| {
            let scores: Vec<f32> = (0..x.len())
                .filter(|&i| both(i))
                .map(|i| (y[i] - x[i]) / ea[i].hypot(eb[i]))
                .filter(|z| z.is_finite())
                .collect();
            scores.iter().filter(|z| z.abs() > 1.96).count() as f64 / scores.len().max(1) as f64
        });
        let (name, letter) = split(channel);
        let unit = known(name).map_or("", |q| q.unit);
        out.maps.push(MapDifference {
            section: a.section.clone(),
            quantity: name.into(),
            channel: letter.into(),
            unit: unit.into(),
            texels: signed.len(),
            median_difference: quantile(&signed, 0.5),
            median_absolute: quantile(&sizes, 0.5),
            p99_absolute: quantile(&sizes, 0.99),
            beyond95,
        });
        let Some(detail) = pictures.filter(|_| !matches!(letter, "R" | "B")) else { continue };
        let kept = (detail.others, detail.digits);
        let frame = MapFrame { width: wa, height: ha, max_width: detail.thumb, least_step: 1, texel_mm: None, kept };
        let words = format!("{} {} {}", a.section, quantity::symbol(name), channel_word(letter));
        let mut caption = format!("{}, {} − {}", words.trim(), out.second, out.first);
        if let Some(share) = beyond95 {
            caption.push_str(&format!("; {} of the texels differ by more than 1.96 standard errors", percent(share)));
        }
        if let Some(picture) = difference_picture(frame, change, unit, words.trim(), &caption) {
            out.pictures.push(MapPictures {
                quantity: name.into(),
                title: quantity::title(name),
                note: String::new(),
                section: a.section.clone(),
                channels: vec![ChannelPictures {
                    channel: channel_word(letter).into(),
                    pictures: vec![picture],
                    charts: Vec::new(),
                }],
            });
        }
    }
}
