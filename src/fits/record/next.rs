//! The one measurement that would help a fit most: what it would bring of the number that is known worst.

use super::{FitKind, FitRecord, RecordSection};
use mesophyll_files::quantity::Quantity;
pub use mesophyll_optics::slab::inverse::DETERMINED;
use serde::{Deserialize, Serialize};

/// What to measure next, and what that would bring.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct NextMeasurement {
    /// The number that is known worst, as `front.sigma_a.B`, or `ground.albedo.B` of a fit with one section.
    pub quantity: String,
    /// Its standard error now, as a share of it; infinite where nothing was measured of it.
    pub error_now: f64,
    /// The same after the measurement; NaN where that depends on how the measurement is made.
    pub error_then: f64,
    /// What to measure, as a sentence.
    pub sentence: String,
}

/// A number of a record that is not determined.
struct Worst<'a> {
    quantity: String,
    /// Its standard error, and the part of it that comes from the caliper, as shares of it.
    error: f64,
    caliper: f64,
    section: &'a RecordSection,
}

impl NextMeasurement {
    /// The measurement that brings the worst number of `record` to 10 %. Random errors fall with the root of the number
    /// of readings. `None` where all numbers are determined, or where the worst one has no finite error, so that
    /// nobody can say how much would help.
    pub fn of(record: &FitRecord) -> Option<NextMeasurement> {
        let worst = worst(record)?;
        let own = (worst.error.powi(2) - worst.caliper.powi(2)).max(0.0).sqrt();
        let (quantity, now) = (worst.quantity.clone(), worst.error);
        let known = format!("{quantity} is known to {}", percent(now));
        let thickness = worst.section.params.get("thickness").and_then(|p| p.value.first().copied());
        if let (true, Some(mm)) = (worst.caliper > own && own < 0.9 * DETERMINED, thickness) {
            let share = (DETERMINED.powi(2) - own * own).sqrt();
            let sentence = format!(
                "{known}, mostly because of the thickness; a caliper with a standard error of {:.2} mm instead of \
                 {:.2} mm would bring it to {}",
                mm * share,
                mm * worst.caliper,
                percent(DETERMINED)
            );
            return Some(NextMeasurement { quantity, error_now: now, error_then: DETERMINED, sentence });
        }
        let rest = (DETERMINED.powi(2) - worst.caliper.powi(2)).max(0.0).sqrt().max(0.5 * DETERMINED);
        // Whole numbers from ten on, otherwise halves.
        let times = (2.0 * (own / rest).powi(2)).ceil() / 2.0;
        let then = (own * own / times + worst.caliper.powi(2)).sqrt();
        let what = match record.kind {
            FitKind::Leaf => "light-box photographs, averaged,",
            FitKind::Beam => "marks of the same precision",
            _ => "readings of the same precision",
        };
        let sentence = format!("{known}; {times} times as many {what} would bring it to {}", percent(then));
        Some(NextMeasurement { quantity, error_now: now, error_then: then, sentence })
    }
}

impl FitRecord {
    /// What to measure next: the pass that a scan lacks before anything else, because nothing else shows the tilts
    /// across the other one; then `next`. A sentence that names the pass already stays as it is.
    pub fn pass_first(&self, next: Option<NextMeasurement>) -> Option<NextMeasurement> {
        let Some(pass) = self.missing_pass() else { return next };
        let name = pass.name();
        let first = format!("pass {name}, without which the normals' {name} is undetermined");
        match next {
            Some(next) if next.sentence.starts_with(&first) => Some(next),
            Some(next) => {
                Some(NextMeasurement { sentence: format!("{first}; beyond that, {}", next.sentence), ..next })
            }
            // How well the tilts will be known depends on the frames of that pass.
            None => Some(NextMeasurement {
                quantity: Quantity::Normal.channel(pass as usize),
                error_now: f64::INFINITY,
                error_then: f64::NAN,
                sentence: first,
            }),
        }
    }
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

/// The number with the largest relative error above [`DETERMINED`]. Angles are not relative to themselves, and a value
/// of zero has no share.
fn worst(record: &FitRecord) -> Option<Worst<'_>> {
    let mut found: Option<Worst> = None;
    for (name, section) in &record.sections {
        for (parameter, p) in section.params.iter().filter(|(_, p)| !matches!(p.unit.as_str(), "deg" | "rad")) {
            for (c, (value, error)) in p.value.iter().zip(&p.stderr).enumerate() {
                let share = |e: f64| e / value.abs();
                let error = share(*error);
                let worse = found.as_ref().is_none_or(|f| error > f.error);
                if error.is_finite() && error > DETERMINED && worse {
                    let channel = if p.value.len() == 3 { [".R", ".G", ".B"][c] } else { "" };
                    let caliper = p.stderr_caliper.get(c).map_or(0.0, |e| share(*e));
                    let place = if name == "all" { String::new() } else { format!("{name}.") };
                    let quantity = format!("{place}{parameter}{channel}");
                    found = Some(Worst { quantity, error, caliper, section });
                }
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::FitParameter;
    use crate::record::scan::PASSES;

    fn record(value: f64, stderr: f64, caliper: f64) -> FitRecord {
        let mut section = RecordSection::default();
        let one = |value: f64, stderr: f64, caliper: Vec<f64>| FitParameter {
            value: vec![value],
            stderr: vec![stderr],
            stderr_caliper: caliper,
            ..FitParameter::default()
        };
        section.params.insert("sigma_a".into(), one(value, stderr, vec![caliper]));
        section.params.insert("thickness".into(), one(0.2, f64::NAN, Vec::new()));
        FitRecord { kind: FitKind::Leaf, sections: [("front".into(), section)].into(), ..FitRecord::default() }
    }

    #[test]
    fn a_determined_fit_needs_nothing() {
        assert_eq!(NextMeasurement::of(&record(10.0, 0.9, 0.0)), None);
        assert_eq!(NextMeasurement::of(&record(0.0, 0.9, 0.0)), None);
        assert_eq!(NextMeasurement::of(&record(10.0, f64::INFINITY, 0.0)), None);
    }

    #[test]
    fn the_pass_that_a_scan_lacks_comes_first() {
        let mut scan = record(10.0, 2.0, 0.0);
        let more = NextMeasurement::of(&scan);
        assert_eq!(scan.pass_first(more.clone()), more);
        scan.options.insert(PASSES.into(), "x".into());
        let both = scan.pass_first(more.clone()).unwrap();
        assert!(both.sentence.starts_with("pass y") && both.sentence.ends_with(&more.unwrap().sentence), "{both:?}");
        assert_eq!((both.quantity.as_str(), both.error_now), ("front.sigma_a", 0.2));
        // A record that was read again says it once.
        assert_eq!(scan.pass_first(Some(both.clone())), Some(both));
        let alone = scan.pass_first(None).unwrap();
        assert!(alone.sentence.starts_with("pass y") && alone.error_now.is_infinite(), "{alone:?}");
        assert_eq!(alone.quantity, "normal.Y");
    }

    #[test]
    fn the_only_section_has_no_name() {
        let mut scene = record(10.0, 2.0, 0.0);
        let section = scene.sections.remove("front").unwrap();
        scene.sections.insert("all".into(), section);
        let next = NextMeasurement::of(&scene).unwrap();
        assert_eq!(next.quantity, "sigma_a");
        assert!(next.sentence.starts_with("sigma_a is known to 20 %;"), "{}", next.sentence);
    }

    #[test]
    fn random_errors_ask_for_readings_and_the_caliper_for_a_better_one() {
        let more = NextMeasurement::of(&record(10.0, 2.0, 0.0)).unwrap();
        assert_eq!((more.error_now, more.error_then), (0.2, 0.1));
        assert!(more.sentence.contains("4 times as many light-box photographs"), "{}", more.sentence);
        // 15 % of which 14 % are the caliper's: 5.4 % are its own, so 8.4 % may be the caliper's: .017 mm of .2 mm.
        let finer = NextMeasurement::of(&record(10.0, 1.5, 1.4)).unwrap();
        assert!(finer.sentence.contains("0.02 mm instead of 0.03 mm"), "{}", finer.sentence);
    }
}
