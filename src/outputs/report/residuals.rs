//! What residuals say about a fit: its reduced χ² compared with the spread that χ² itself has, and the two sides of a
//! leaf compared.

use crate::model::{QualityLevel, SectionReport};
use crate::number::{percent, significant};
use crate::quantity::symbol;
use mesophyll_fits::leaf::sides;
use mesophyll_fits::record::{FitKind, FitRecord, MIRROR, NOISE_SEEN, ResidualStatistics};

/// Chance does not move χ² by this many of its standard deviations.
const SPREADS: f64 = 5.0;
/// Noise is known to about 1 % at best (reduced χ² to 2.5 %). Less than that is no finding, however many readings there
/// are.
const NOISE_KNOWN: f64 = 0.025;
/// The same for noise that was estimated from the measurements themselves.
const NOISE_ESTIMATED: f64 = 0.3;
/// With a reduced χ² above this, the model does not describe its measurements: the residuals are 73 % larger than the
/// noise.
const BAD: f64 = 3.0;
/// Front and back differ if they are this many standard errors apart. Chance does that once in 16,000 comparisons.
const SIDES: f64 = 4.0;

/// Level and sentence for the residuals of `what`, compared with their own spread: with many readings even 1.03 is a
/// finding.
pub fn judge(what: &str, r: &ResidualStatistics, record: &FitRecord, s: &SectionReport) -> (QualityLevel, String) {
    let chi2 = r.reduced_chi2;
    if !chi2.is_finite() {
        return (QualityLevel::Bad, format!("the residuals of {what} have no reduced χ²"));
    }
    let freedom = if chi2 > 0.0 { (r.chi2 / chi2).max(1.0) } else { 1.0 };
    let estimated = record.options.get("noise_relative").is_some_and(|n| n.contains("estimated"));
    let spread = SPREADS * (2.0 / freedom).sqrt();
    let allowed = spread.max(if estimated { NOISE_ESTIMATED } else { NOISE_KNOWN });
    let noise = if estimated { "noise as estimated from the traces" } else { "stated noise" };
    let fact = format!("reduced χ² of {what} is {}", significant(chi2, 4));
    let against = format!("chance allows 1 ± {}", significant(spread, 2));
    if (chi2 - 1.0).abs() <= allowed {
        (QualityLevel::Good, format!("{fact}: the model explains the measurements within their {noise}"))
    } else if chi2 < 1.0 {
        (QualityLevel::Doubtful, format!("{fact} ({against}): the measurements scatter less than their {noise}"))
    } else if chi2 > BAD {
        (
            QualityLevel::Bad,
            format!("{fact}: the model does not describe these measurements{}", suspects(what, chi2, record, s)),
        )
    } else {
        (
            QualityLevel::Doubtful,
            format!("{fact} ({against}): the model leaves more than the {noise}{}", suspects(what, chi2, record, s)),
        )
    }
}

/// What could be wrong where a leaf's traces leave large residuals, and what in the capture could have shown it.
fn suspects(what: &str, chi2: f64, record: &FitRecord, s: &SectionReport) -> String {
    if record.kind != FitKind::Leaf || what != "gloss" {
        return String::new();
    }
    let mirror = record.options.get(MIRROR).map_or("", String::as_str);
    let geometry = match mirror {
        m if m.starts_with("warning") => format!("the device's geometry is not as stated ({m})"),
        m if m.contains("absent") => {
            "the camera's angle, the tube's height or its zero may be off, and without a mirror strip nothing in the \
            capture can tell; 5° of camera angle cost m 5 %, ρs 4 % and 1.3° of the normals"
                .into()
        }
        _ => "the mirror strip agrees with the stated geometry".into(),
    };
    // What was found to be wrong is said by itself.
    if let Some(fault) = record.faults.first() {
        return format!("; the likely cause is named ({})", fault.name);
    }
    // The model is not to be doubted for what the fit had to take for granted.
    let unseen = record.missing_pass().map(|pass| {
        let name = pass.name();
        format!(
            "pass {name} was not taken, so the fit takes the normals' {name} as 0, and that may be the cause: take \
             pass {name} before you doubt the model"
        )
    });
    let Some(seen) = s.figures.get(NOISE_SEEN) else {
        return format!(": {}{geometry}", unseen.map_or_else(String::new, |unseen| format!("{unseen}; ")));
    };
    // Noise that is wrong by a factor makes χ² wrong by its square.
    if (seen * seen - 1.0) > 0.5 * (chi2 - 1.0) {
        let off = percent((seen - 1.0).abs());
        format!(
            ": the traces are {off} rougher than the stated noise whatever their model, so the noise is understated; \
             errors are too small by as much"
        )
    } else {
        let cause = unseen.unwrap_or_else(|| "so it is the model that is off".into());
        format!(": the traces are as rough as the stated noise makes them, {cause}; {geometry}")
    }
}

/// The tilts that no pass shows.
pub fn unseen_tilt(record: &FitRecord, say: &mut impl FnMut(QualityLevel, String)) {
    if let Some(pass) = record.missing_pass() {
        let name = pass.name();
        say(
            QualityLevel::Doubtful,
            format!(
                "the normals' {name} is undetermined in every texel, because pass {name} was not taken: the maps hold 0"
            ),
        );
    }
}

/// Compares front with back, which both show one interior.
pub fn sides(record: &FitRecord, say: &mut impl FnMut(QualityLevel, String)) {
    let Some(section) = record.sections.get(sides::SECTION) else {
        if record.kind == FitKind::Leaf
            && record.sections.contains_key("front")
            && !record.sections.contains_key("back")
        {
            say(
                QualityLevel::Good,
                "only one side was measured, so nothing checks that its mean albedo is the interior's (mean γ = 1)"
                    .into(),
            );
        }
        return;
    };
    let prefix = format!("{}.", sides::APART_IN_ERRORS);
    let worst = section
        .figures
        .iter()
        .filter_map(|(n, v)| Some((n.strip_prefix(&prefix)?, *v)))
        .max_by(|a, b| a.1.total_cmp(&b.1));
    let Some((name, errors)) = worst else { return };
    let apart = section.figures.get(&format!("{}.{name}", sides::APART)).copied().unwrap_or(f64::NAN);
    let (quantity, channel) = name.split_once('.').unwrap_or((name, ""));
    let place = format!("{}.{channel}", symbol(quantity));
    if errors <= SIDES {
        say(
            QualityLevel::Good,
            format!("front and back agree on the interior (at most {} errors apart, {place})", significant(errors, 2)),
        );
    } else {
        say(
            QualityLevel::Doubtful,
            format!(
                "front and back disagree on the interior they share: {place} differs by {}, {} errors of the noise. \
                 Each side's σ takes its own mean albedo for the \
                 interior's (mean γ = 1), which the two sides do not confirm; the printed errors are widened to hold \
                 the difference",
                percent(apart.abs()),
                significant(errors, 2)
            ),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_fits::record::scan::PASSES;

    /// What is said of traces that scatter as stated and leave a reduced χ² of 1.07.
    fn said(passes: &str) -> String {
        let record =
            FitRecord { options: [(PASSES.into(), passes.into())].into(), kind: FitKind::Leaf, ..FitRecord::default() };
        let side = SectionReport {
            name: "front".into(),
            counts: Default::default(),
            terminations: Default::default(),
            residuals: Default::default(),
            truth: Default::default(),
            figures: [(NOISE_SEEN.to_string(), 1.0)].into(),
            correlation_names: Vec::new(),
            correlation: Vec::new(),
            condition: None,
            rank: None,
        };
        let left = ResidualStatistics { chi2: 1.07e6, reduced_chi2: 1.07, ..ResidualStatistics::default() };
        let (level, text) = judge("gloss", &left, &record, &side);
        assert_eq!(level, QualityLevel::Doubtful, "{text}");
        text
    }

    #[test]
    fn a_missing_pass_is_suspected_before_the_model() {
        let [both, one] = ["x y", "x"].map(said);
        assert!(both.contains("so it is the model that is off"), "{both}");
        assert!(one.contains("take pass y before you doubt the model") && !one.contains("model that is off"), "{one}");
    }
}
