//! Whether a record agrees with itself, whatever its hashes say. What one of its numbers says of another is checked
//! here for fits of every kind; what maps say is for the room that knows them.

use crate::record::scan::HeldOutResiduals;
use crate::record::{FitParameter, FitRecord, RecordSection, ResidualStatistics};

/// How far two numbers of a record may differ that the fit computed from the same sums, relative to the larger. Records
/// hold double precision; a sum over millions of readings in another order loses a few digits more.
const SAME: f64 = 1e-9;
/// Degrees of freedom that a fit may have beyond its readings, because of what was known beforehand.
const KNOWN: f64 = 4.5;

/// Whether two numbers are the same but for rounding. NaN agrees with everything: it stands for a number that is not
/// known.
fn same(a: f64, b: f64) -> bool {
    a == b || !((a - b).abs() > SAME * a.abs().max(b.abs()))
}

impl FitRecord {
    /// A sentence for each pair of its numbers that cannot both be what a fit wrote. Each names the field and both
    /// numbers.
    pub fn contradictions(&self) -> Vec<String> {
        let mut out = Vec::new();
        for (name, section) in &self.sections {
            let mut say = |field: &str, what: String| out.push(format!("{name}.{field}: {what}"));
            for (field, param) in &section.params {
                parameter(param, &mut |what| say(field, what));
            }
            correlation(section, &mut say);
            for (field, residuals) in &section.residuals {
                of_residuals(residuals, &mut |what| say(&format!("residuals.{field}"), what));
            }
            for (pass, held) in &section.held_out {
                held_out(held, &mut |what| say(&format!("held_out.{pass}"), what));
            }
            self.counts(section, &mut say);
            for (field, truth) in &section.truth {
                if truth.coverage95.is_some_and(|c| !(0.0..=1.0).contains(&c)) {
                    let found = truth.coverage95.unwrap_or(f64::NAN);
                    say(&format!("truth.{field}.coverage95"), format!("found {found}, expected a share from 0 to 1"));
                }
            }
        }
        out
    }

    /// A sentence where another program or another version made the fit. Its numbers are read as they are.
    pub fn made_elsewhere(&self) -> Option<String> {
        const OURS: &str = env!("CARGO_PKG_VERSION");
        let told = if self.program.is_empty() { "an unnamed program" } else { &self.program };
        let parts = |version: &str| -> Option<Vec<u32>> {
            version.split(['.', '-', '+']).take(3).map(|part| part.parse().ok()).collect()
        };
        let how = match self.program.strip_prefix("mesophyll ") {
            Some(OURS) => return None,
            Some(version) => match (parts(version), parts(OURS)) {
                (Some(theirs), Some(ours)) if theirs < ours => "an older version",
                (Some(theirs), Some(ours)) if theirs > ours => "a newer version",
                _ => "another version",
            },
            None => "another program",
        };
        Some(format!("fit.toml was made by {told}, {how} than this one (mesophyll {OURS})"))
    }

    /// Texels by their fate add up to all texels.
    fn counts(&self, section: &RecordSection, say: &mut impl FnMut(&str, String)) {
        let count = |name: &str| section.counts.get(name).copied();
        let (Some(all), Some(good), Some(outside)) = (count("texels"), count("good"), count("outside")) else { return };
        let defects: usize = self.defects.values().filter_map(|name| count(name)).sum();
        let sum = good.saturating_add(outside).saturating_add(defects);
        if sum != all {
            let parts = format!("{good} good, {outside} outside and {defects} with a defect are {sum}");
            say("counts", format!("{parts}, but texels says {all}"));
        }
    }
}

fn parameter(param: &FitParameter, say: &mut impl FnMut(String)) {
    let values = param.value.len();
    for (name, list) in [("stderr", &param.stderr), ("stderr_caliper", &param.stderr_caliper)] {
        if !list.is_empty() && list.len() != values {
            say(format!("found {} of {name} for {values} values", list.len()));
        }
        if let Some(negative) = list.iter().find(|e| **e < 0.0) {
            say(format!("{name} is {negative}, expected 0 or more"));
        }
    }
    let more = |(part, all): &(&f64, &f64)| **part > **all && !same(**part, **all);
    if let Some((part, all)) = param.stderr_caliper.iter().zip(&param.stderr).find(more) {
        say(format!("the caliper's part of the standard error, {part}, is larger than the whole, {all}"));
    }
}

fn correlation(section: &RecordSection, say: &mut impl FnMut(&str, String)) {
    let (rows, names) = (&section.correlation, section.correlation_names.len());
    if rows.len() != names || rows.iter().any(|row| row.len() != names) {
        say("correlation", format!("found {} rows for {names} names, expected a square of that size", rows.len()));
        return;
    }
    'all: for i in 0..names {
        for j in 0..=i {
            let (a, b) = (rows[i][j], rows[j][i]);
            let pair = format!("{} and {}", section.correlation_names[i], section.correlation_names[j]);
            let what = if i == j && !same(a, 1.0) {
                format!("of {} with itself is {a}, expected 1", section.correlation_names[i])
            } else if (a - b).abs() > SAME {
                format!("of {pair} is {a} in one row and {b} in the other, expected the same number twice")
            } else if a.abs() > 1.0 + SAME {
                format!("of {pair} is {a}, expected a number from −1 to 1")
            } else {
                continue;
            };
            say("correlation", what);
            break 'all;
        }
    }
    if let Some(c) = section.condition.filter(|c| *c < 1.0 && !same(*c, 1.0)) {
        say("condition", format!("found {c}, expected a condition number, which is 1 or more"));
    }
    if let Some(rank) = section.rank.filter(|rank| names > 0 && *rank > names) {
        say("rank", format!("found {rank} for {names} parameters, expected at most as many"));
    }
}

fn of_residuals(r: &ResidualStatistics, say: &mut impl FnMut(String)) {
    for (name, value) in [("chi2", r.chi2), ("reduced_chi2", r.reduced_chi2), ("rms", r.rms), ("worst", r.worst)] {
        if value < 0.0 {
            say(format!("{name} is {value}, expected 0 or more"));
        }
    }
    let freedom = r.chi2 / r.reduced_chi2;
    // What is known beforehand may count as a reading or two.
    if freedom.is_finite() && r.samples > 0 && freedom > r.samples as f64 * (1.0 + SAME) + KNOWN {
        say(format!(
            "chi2 {} over reduced_chi2 {} are {freedom:.0} degrees of freedom, more than the {} readings",
            r.chi2, r.reduced_chi2, r.samples
        ));
    }
}

fn held_out(held: &HeldOutResiduals, say: &mut impl FnMut(String)) {
    let frames = held.frames.len();
    for (name, count) in [
        ("positions_mm", held.positions_mm.len()),
        ("frame_chi2", held.frame_chi2.len()),
        ("frame_expected", held.frame_expected.len()),
    ] {
        if count != frames {
            say(format!("found {count} of {name} for {frames} frames"));
            return;
        }
    }
    if frames == 0 {
        return;
    }
    let (least, most) = held.frame_chi2.iter().fold((f64::INFINITY, 0.0f64), |(a, b), c| (a.min(*c), b.max(*c)));
    let within = |v: f64| v.is_nan() || (v >= least * (1.0 - SAME) && v <= most * (1.0 + SAME));
    if !within(held.reduced_chi2) {
        say(format!("reduced_chi2 is {}, but those of its frames are {least} to {most}", held.reduced_chi2));
    }
    if !same(held.worst_frame_chi2, most) {
        say(format!("worst_frame_chi2 is {}, but the largest of frame_chi2 is {most}", held.worst_frame_chi2));
    }
    let expected = held.frame_expected.iter().sum::<f64>() / frames as f64;
    if !same(held.expected, expected) {
        say(format!("expected is {}, but the mean of frame_expected is {expected}", held.expected));
    }
    if held.expected < 1.0 - SAME {
        say(format!("expected is {}, but noise alone gives 1", held.expected));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::FitKind;

    fn record() -> FitRecord {
        let section = RecordSection {
            counts: [("texels", 12), ("good", 9), ("outside", 2), ("dark", 1)].map(|(n, c)| (n.into(), c)).into(),
            residuals: [(
                "gloss".to_string(),
                ResidualStatistics { samples: 100, chi2: 90.0, reduced_chi2: 1.0, ..ResidualStatistics::default() },
            )]
            .into(),
            correlation_names: vec!["a".into(), "b".into()],
            correlation: vec![vec![1.0, -0.3], vec![-0.3, 1.0]],
            condition: Some(3.0),
            rank: Some(2),
            held_out: [(
                "x".to_string(),
                HeldOutResiduals {
                    frames: vec![3, 9],
                    positions_mm: vec![0.0, 1.0],
                    reduced_chi2: 1.05,
                    expected: 1.03,
                    frame_chi2: vec![1.0, 1.1],
                    frame_expected: vec![1.02, 1.04],
                    worst_frame_chi2: 1.1,
                    ..HeldOutResiduals::default()
                },
            )]
            .into(),
            params: [(
                "load".to_string(),
                FitParameter {
                    value: vec![2.0],
                    stderr: vec![0.1],
                    stderr_caliper: vec![0.05],
                    ..FitParameter::default()
                },
            )]
            .into(),
            ..RecordSection::default()
        };
        FitRecord {
            defects: [("-1".to_string(), "dark".to_string())].into(),
            sections: [("front".to_string(), section)].into(),
            ..FitRecord::new(FitKind::Leaf, "elm", String::new())
        }
    }

    #[test]
    fn every_number_is_held_against_the_others_that_say_it() {
        assert_eq!(record().contradictions(), Vec::<String>::new());
        type Change = fn(&mut RecordSection);
        let changes: [(&str, Change); 11] = [
            ("front.counts: ", |s| *s.counts.get_mut("good").unwrap() = 12),
            ("front.residuals.gloss: ", |s| s.residuals.get_mut("gloss").unwrap().reduced_chi2 = 0.5),
            ("front.correlation: ", |s| s.correlation[0][1] = 0.3),
            ("front.correlation: ", |s| (s.correlation[0][1], s.correlation[1][0]) = (1.2, 1.2)),
            ("front.condition: ", |s| s.condition = Some(0.3)),
            ("front.rank: ", |s| s.rank = Some(3)),
            ("front.held_out.x: ", |s| s.held_out.get_mut("x").unwrap().reduced_chi2 = 2.0),
            ("front.held_out.x: ", |s| s.held_out.get_mut("x").unwrap().expected = 1.3),
            ("front.held_out.x: ", |s| s.held_out.get_mut("x").unwrap().frame_chi2[1] = 1.4),
            ("front.load: ", |s| s.params.get_mut("load").unwrap().stderr[0] = 0.01),
            ("front.load: ", |s| s.params.get_mut("load").unwrap().stderr[0] = -0.1),
        ];
        for (named, change) in changes {
            let mut changed = record();
            change(changed.sections.get_mut("front").unwrap());
            let said = changed.contradictions();
            assert!(said.iter().any(|s| s.starts_with(named)), "{named}: {said:?}");
        }
    }

    #[test]
    fn who_made_it_is_said_by_name() {
        assert_eq!(record().made_elsewhere(), None);
        for (program, how) in [
            ("mesophyll 0.0.1", "an older version"),
            ("mesophyll 999.0.0", "a newer version"),
            ("mesophyll next", "another version"),
            ("leaffit 3", "another program"),
            ("", "an unnamed program"),
        ] {
            let said = FitRecord { program: program.into(), ..record() }.made_elsewhere().unwrap();
            assert!(said.contains(how) && said.contains(program), "{said}");
        }
    }
}
