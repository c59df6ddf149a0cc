//! Stiff and extreme branches, each with the verdict that it must get.

use super::reference;
use crate::stress::StressRow;
use mesophyll_fits::branch::beam::fit::{MeasuredBranch, PositionReference, fit};
use mesophyll_fits::branch::beam::synthetic::{BranchFitTruth, branch};
use mesophyll_fits::branch::beam::{basis, evaluate};
use mesophyll_plants::mechanics::beam;
use mesophyll_plants::mechanics::length::{bend, kept};
use mesophyll_plants::mechanics::load::Load;
use std::time::Instant;

fn row(
    case: &str,
    expected: &str,
    verdict: String,
    digits: Option<f64>,
    condition: Option<f64>,
    since: Instant,
) -> StressRow {
    StressRow {
        model: "beam".into(),
        case: case.into(),
        expected: expected.into(),
        verdict,
        digits,
        condition: condition.filter(|c| c.is_finite()),
        ms: since.elapsed().as_secs_f64() * 1e3,
    }
}

/// Fewest correct digits of u and u′ over x; the verdict is `ok` where there are as many as promised.
fn forward(case: &str, alpha: f64, promised: f64, at: impl Fn(f64) -> (f64, f64, f64, f64)) -> StressRow {
    let clock = Instant::now();
    let mut fewest = 16.0f64;
    for k in 0..=50 {
        for x in [f64::from(k) / 50.0, 1.0 - 1e-4 * f64::from(k) / 50.0] {
            let (alpha, x, u, du) = at(x);
            fewest = fewest.min(reference::digits(alpha, x, (u, du)));
        }
    }
    let verdict =
        if fewest >= promised { "ok".to_string() } else { format!("wrong: {fewest:.1} digits at alpha {alpha}") };
    row(case, "ok", verdict, Some(fewest), None, clock)
}

fn exact(case: &str, alpha: f64) -> StressRow {
    forward(case, alpha, 12.0, |x| (alpha, x, beam::deflection(alpha, x), beam::slope(alpha, x)))
}

fn single(case: &str, alpha: f32) -> StressRow {
    // An error of 2e-6 of u is allowed.
    forward(case, f64::from(alpha), 5.7, |x| {
        let x = x as f32;
        let (u, du) = beam::single(alpha, x);
        (f64::from(alpha), f64::from(x), f64::from(u), f64::from(du))
    })
}

/// A measured branch, fitted for an even load. Digits are those of taper and load over stiffness, where the fit claims
/// to know them.
fn measured(
    case: &str,
    expected: &str,
    truth: BranchFitTruth,
    noise: f64,
    spoil: impl Fn(&mut MeasuredBranch),
) -> StressRow {
    under(case, expected, truth, noise, Some(Load::Even), spoil)
}

/// A measured branch, fitted for a stated load or for none.
fn under(
    case: &str,
    expected: &str,
    truth: BranchFitTruth,
    noise: f64,
    load: Option<Load>,
    spoil: impl Fn(&mut MeasuredBranch),
) -> StressRow {
    let mut b = branch(&truth, 24, noise, 11, PositionReference::Branch);
    spoil(&mut b);
    let clock = Instant::now();
    match fit(&b, PositionReference::Branch, load) {
        Ok(m) => {
            let off = (m.taper.value / truth.alpha - 1.0)
                .abs()
                .max((m.load_over_stiffness.value / truth.load_over_stiffness() - 1.0).abs());
            let digits = (m.status == mesophyll_files::table::Status::Ok).then(|| (-off.log10()).clamp(0.0, 16.0));
            row(case, expected, m.status.to_string(), digits, Some(m.fit.uncertainty.condition), clock)
        }
        Err(why) => row(case, expected, format!("refused: {why}"), None, None, clock),
    }
}

/// The length that a branch keeps at a tip deflection; digits of the length.
fn kept_length(case: &str, alpha: f64, tip: f64) -> StressRow {
    let clock = Instant::now();
    let s = basis::shape(alpha);
    let a = tip / s.tip();
    let off = (kept(&s, &bend(&s, 1.0, a), 1.0, a) - 1.0).abs();
    let verdict = if off <= 1e-3 { "ok".to_string() } else { format!("wrong: length off by {off:.1e}") };
    row(case, "ok", verdict, Some(-off.max(1e-16).log10()), None, clock)
}

/// Runs the table.
pub fn rows() -> Vec<StressRow> {
    let clock = Instant::now();
    let refused = |case: &str, expected: &str, alpha: f64, x: f64| {
        row(case, expected, evaluate(alpha, x).status.to_string(), None, None, clock)
    };
    let t = BranchFitTruth::default();
    let mut rows = vec![
        exact("taper 1e-4", 1e-4),
        exact("taper 0.5, where the form changes at the tip", 0.5),
        exact("taper 1 - 1e-5", 1.0 - 1e-5),
        exact("taper 1", 1.0),
        exact("taper 1 + 1e-5", 1.0 + 1e-5),
        single("f32, taper 1e-4", 1e-4),
        single("f32, taper 0.25", 0.25),
        single("f32, taper 1 - 1e-5", 1.0 - 1e-5),
        single("f32, taper 1", 1.0),
        refused("taper 0", "refused: alpha", 0.0, 0.5),
        refused("beyond the tip", "refused: x", 0.5, 1.5),
    ];
    for alpha in [1e-4, 0.1, 1.0] {
        rows.push(kept_length(&format!("length at tip 1 L, taper {alpha}"), alpha, 1.0));
    }
    rows.extend([
        measured("measured, noise 1 %", "ok", t, 0.01, |_| {}),
        measured("measured, tip 1 L, noise 0.3 %", "ok", BranchFitTruth { tip: 1.0, ..t }, 3e-3, |_| {}),
        measured("measured, taper 1e-3, noise 0.01 %", "ok", BranchFitTruth { alpha: 1e-3, ..t }, 1e-4, |_| {}),
        measured(
            "measured, taper 1e-4, noise 5 %",
            "undetermined: alpha",
            BranchFitTruth { alpha: 1e-4, ..t },
            0.05,
            |_| {},
        ),
        measured(
            "measured, taper 1 - 1e-5, noise 0.1 %",
            "ok",
            BranchFitTruth { alpha: 1.0 - 1e-5, ..t },
            1e-3,
            |_| {},
        ),
        measured("measured, noise 20 %", "undetermined: alpha; load_over_stiffness_mm", t, 0.2, |_| {}),
        measured("measured, zero load, noise only", "undetermined: alpha", t, 0.01, |b| {
            // What the noise of the same seed leaves when the deflection itself is subtracted.
            for r in &mut b.readings {
                r.deflection -= t.place(r.position / t.length)[1];
            }
        }),
        measured("measured, zero load, zeros", "refused: no deflection", t, 0.01, |b| {
            b.readings.iter_mut().for_each(|r| r.deflection = 0.0)
        }),
        measured("measured, a single mark", "refused: too few readings", t, 0.01, |b| b.readings.truncate(1)),
        measured(
            "measured, load unknown",
            "undetermined: root_radius_mm (load, modulus and root radius",
            t,
            0.01,
            |b| b.load = [f64::NAN; 2],
        ),
        measured(
            "measured, an outlier of 50 %",
            "undetermined: alpha; load_over_stiffness_mm; root_radius_mm; tip_mm (the model does not describe",
            t,
            0.01,
            |b| {
                b.readings[20].deflection *= 1.5;
            },
        ),
    ]);
    rows.extend(wrong_models(t));
    rows
}

/// Branches of another kind than the fit takes them for, and strong bends.
fn wrong_models(t: BranchFitTruth) -> Vec<StressRow> {
    let rod = BranchFitTruth { alpha: 1.0, tip: 0.05, kind: Load::Tip, ..t };
    let everything = "undetermined: alpha; load_over_stiffness_mm; root_radius_mm; tip_mm (the model does not describe";
    vec![
        measured(
            "measured, tip hangs at .65 L, noise 0.3 %",
            "ok",
            BranchFitTruth { alpha: 0.2, tip: 1.5, ..t },
            3e-3,
            |_| {},
        ),
        under("measured, load at the tip as stated", "ok", rod, 3e-3, Some(Load::Tip), |_| {}),
        under(
            "measured, own weight as stated, tip .6 L",
            "ok",
            BranchFitTruth { alpha: 0.5, tip: 1.0, kind: Load::OwnWeight, ..t },
            3e-3,
            Some(Load::OwnWeight),
            |_| {},
        ),
        under(
            "measured, wrong model: load at .6 of a rod, none stated",
            everything,
            BranchFitTruth { kind: Load::Share(0.6), ..rod },
            3e-3,
            None,
            |_| {},
        ),
        measured(
            "measured, wrong model: load at a third, even stated",
            everything,
            BranchFitTruth { alpha: 0.6, kind: Load::Share(0.35), ..t },
            3e-3,
            |_| {},
        ),
        measured("measured, wrong model: the root gives way", everything, t, 2e-3, |b| {
            b.readings.iter_mut().for_each(|r| r.deflection += 0.05 * r.position);
        }),
        measured("measured, modulus in N/mm2", "undetermined: root_radius_mm (modulus_gpa", t, 3e-3, |b| {
            b.modulus[0] *= 1e3
        }),
        measured(
            "measured, deflections as heights",
            "undetermined: load_over_stiffness_mm; root_radius_mm (the branch moves against its load",
            t,
            3e-3,
            |b| b.readings.iter_mut().for_each(|r| r.deflection = -r.deflection),
        ),
        measured("measured, positions in cm", "refused: deflection_mm", t, 3e-3, |b| {
            b.readings.iter_mut().for_each(|r| r.position *= 0.1);
        }),
    ]
}
