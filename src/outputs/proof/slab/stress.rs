//! The slab's stress table: forward methods compared with the exact solution, and inversions with the verdict that
//! physics requires.

use crate::stress::StressRow;
use mesophyll_optics::slab::faces::SlabFaces;
use mesophyll_optics::slab::inverse::{
    self, InversionPrecision, SingleMeasurement, SlabCoefficient, SlabEstimate, SlabModel, SlabShare, Status,
};
use mesophyll_optics::slab::{self, medium};
use std::time::Instant;

/// Inverse cases, from a committed file: a slab (ω, 1−ω, Δ, h) or a measurement (ρd, ρt, h), the stated noise, and the
/// verdict that it must get.
const CASES: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/stress/slab.csv"));

/// Forward cases: name, ω, 1−ω, Δ.
const FORWARD: [(&str, f64, f64, f64); 14] = [
    ("omega 0", 0.0, 1.0, 1.0),
    ("omega 0 and delta 700", 0.0, 1.0, 700.0),
    ("omega 1e-12", 1e-12, 1.0 - 1e-12, 1.0),
    ("omega 1e-3 and delta 60", 1e-3, 0.999, 60.0),
    ("omega 0.5 and delta 1e-6", 0.5, 0.5, 1e-6),
    ("omega 0.5 and delta 1e-9", 0.5, 0.5, 1e-9),
    ("omega 0.5 and delta 1000", 0.5, 0.5, 1000.0),
    ("1-omega 1e-7 and delta 1", 1.0 - 1e-7, 1e-7, 1.0),
    ("1-omega 1e-7 and delta 1000", 1.0 - 1e-7, 1e-7, 1000.0),
    ("1-omega 1e-14 and delta 1e5", 1.0 - 1e-14, 1e-14, 1e5),
    ("omega 1 and delta 1e-6", 1.0, 0.0, 1e-6),
    ("omega 1 and delta 1", 1.0, 0.0, 1.0),
    ("omega 1 and delta 1000", 1.0, 0.0, 1000.0),
    ("omega 1 and delta 1e6", 1.0, 0.0, 1e6),
];

/// The index of the cases with reflecting faces.
const INDEX: f64 = 1.41;

/// Slabs of index [`INDEX`], inverted with it: name, ω, 1−ω, Δ, noise, expected verdict.
const REFLECTING: [(&str, f64, f64, f64, f64, &str); 9] = [
    ("middle of the range", 0.8, 0.2, 2.0, 1e-3, "ok"),
    ("a phantom of silicone", 0.96, 0.04, 2.8, 1e-3, "ok"),
    ("delta 1e-3", 0.5, 0.5, 1e-3, 1e-6, "ok"),
    ("delta 1e-7 under the noise", 0.5, 0.5, 1e-7, 1e-6, "undetermined: sigma_a <="),
    ("omega 0", 0.0, 1.0, 1.0, 1e-6, "undetermined: sigma_s <="),
    ("omega 1", 1.0, 0.0, 3.0, 1e-3, "undetermined: sigma_a <="),
    ("1-omega 1e-7 above the noise", 1.0 - 1e-7, 1e-7, 3.0, 1e-10, "ok"),
    ("delta 1000 and absorbing", 0.5, 0.5, 1000.0, 1e-6, "undetermined: sigma_a >="),
    ("delta 1000 and 1-omega 1e-6", 1.0 - 1e-6, 1e-6, 1000.0, 1e-6, "ok"),
];

/// Runs every case.
pub fn stress_cases() -> Vec<StressRow> {
    let model = SlabModel::of_index(INDEX);
    let faces = SlabFaces::new(INDEX, 1.0);
    let matched = |omega: f64, absorbed: f64, delta: f64| {
        (slab::reduced(omega, absorbed, delta).0, medium::solve(omega, absorbed, delta))
    };
    let reflecting = |omega: f64, absorbed: f64, delta: f64| {
        (model.response(omega, absorbed, delta), faces.shares(omega, absorbed, delta).response())
    };
    let mut rows = Vec::new();
    for &(case, omega, absorbed, delta) in &FORWARD {
        rows.push(forward("slab forward", case, absorbed, || matched(omega, absorbed, delta)));
        rows.push(forward("slab index forward", case, absorbed, || reflecting(omega, absorbed, delta)));
    }
    for &(case, omega, absorbed, delta, noise, expected) in &REFLECTING {
        let r = faces.shares(omega, absorbed, delta).response();
        let truth = [absorbed * delta, omega * delta];
        rows.push(inverted("slab index", case, expected, Some(truth), || {
            inverse::invert_in(&model, InversionPrecision::Fast, r.rho_d, r.rho_t, 1.0, noise, noise)
        }));
    }
    rows.extend(wrong_models(&model));
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(CASES.as_bytes());
    for (line, record) in reader.records().enumerate() {
        rows.push(match record {
            Ok(record) => inverse_case(&record),
            Err(e) => broken(&format!("line {}", line + 2), &e.to_string()),
        });
    }
    rows
}

/// Measurements that the model does not describe. Two numbers determine two coefficients exactly, so only what no slab
/// of the index can have shows.
fn wrong_models(model: &SlabModel) -> Vec<StressRow> {
    let leaf = slab::reduced(0.3, 0.7, 4.0).0;
    let fit = |r: f64, t: f64| inverse::invert_in(model, InversionPrecision::Fast, r, t, 1.0, 1e-3, 1e-3);
    let single = |value: f64, sigma: f64| {
        let known = SlabCoefficient::Absorption;
        let single = SingleMeasurement { share: SlabShare::Reflected, value, err: 1e-3, known, sigma, sigma_err: 0.0 };
        inverse::invert_single(model, &single, 1.0)
    };
    let dim = 0.5 * model.mirror.face();
    let glass = model.mirror.clear();
    vec![
        inverted("slab index", "a slab without faces, taken for one with them", "refused: rho_t", None, || {
            fit(0.001, 0.99)
        }),
        inverted("slab index", "the mirror reflection was left out", "refused: rho_d", None, || fit(dim, leaf.rho_t)),
        inverted("slab index", "a pane of glass", "undetermined: sigma_a <=", None, || fit(1.0 - glass, glass)),
        inverted("slab index", "R brighter than the known absorption allows", "refused: rho_d", None, || {
            single(0.9, 5.0)
        }),
        inverted("slab index", "R and T in per cent", "refused: rho_d", None, || fit(11.9, 20.1)),
    ]
}

/// Compares the fast model (first) with the exact one. `ok` means six correct digits in both, for ρt down to 1e-30, and
/// conservation where nothing absorbs.
fn forward(
    model: &str,
    case: &str,
    absorbed: f64,
    both: impl FnOnce() -> (slab::SlabResponse, slab::SlabResponse),
) -> StressRow {
    let clock = Instant::now();
    let (got, want) = both();
    let ms = clock.elapsed().as_secs_f64() * 1e3;
    let relative = |a: f64, b: f64, floor: f64| if b.abs() <= floor { (a - b).abs() } else { (a / b - 1.0).abs() };
    let error = relative(got.rho_d, want.rho_d, 0.0).max(relative(got.rho_t, want.rho_t, 1e-30));
    let conserved = absorbed != 0.0 || (got.rho_d + got.rho_t - 1.0).abs() < 1e-15;
    let verdict = match (error < 1e-6, conserved) {
        (true, true) => "ok".to_string(),
        (false, _) => format!("wrong: relative error {error:.1e}"),
        (_, false) => format!("wrong: rho_d + rho_t = {}", got.rho_d + got.rho_t),
    };
    StressRow {
        model: model.into(),
        case: case.into(),
        expected: "ok".into(),
        verdict,
        digits: Some(digits(error)),
        condition: None,
        ms,
    }
}

fn digits(error: f64) -> f64 {
    -error.clamp(1e-16, 1.0).log10()
}

fn broken(case: &str, why: &str) -> StressRow {
    let text = |s: &str| s.to_string();
    StressRow {
        model: text("slab"),
        case: text(case),
        expected: text("ok"),
        verdict: format!("wrong: {why}"),
        digits: None,
        condition: None,
        ms: 0.0,
    }
}

/// One line of the table. An `ok` is `wrong` where the truth is more than four printed errors away.
fn inverse_case(record: &csv::StringRecord) -> StressRow {
    let text = |k: usize| record.get(k).unwrap_or("");
    let number = |k: usize| text(k).parse::<f64>().unwrap_or(f64::NAN);
    let (h, noise) = (number(6), number(7));
    let truth = (!text(1).is_empty()).then(|| [number(2) * number(3) / h, number(1) * number(3) / h]);
    let (mut r, mut t) = (number(4), number(5));
    if truth.is_some() {
        let at = medium::solve(number(1), number(2), number(3));
        (r, t) = (at.rho_d, at.rho_t);
    }
    if text(8) == "yes" {
        (r, t) = (f64::from(r as f32), f64::from(t as f32));
    }
    inverted("slab", text(0), text(9), truth, || inverse::invert(r, t, h, noise, noise))
}

/// The verdict of an inversion.
fn inverted(
    model: &str,
    case: &str,
    expected: &str,
    truth: Option<[f64; 2]>,
    invert: impl FnOnce() -> SlabEstimate,
) -> StressRow {
    let clock = Instant::now();
    let e = invert();
    let ms = clock.elapsed().as_secs_f64() * 1e3;
    let mut verdict = e.status.to_string();
    let mut correct = None;
    if let (Status::Ok, Some([a, s])) = (&e.status, truth) {
        correct = Some(digits((e.sigma_a / a - 1.0).abs().max((e.sigma_s / s - 1.0).abs())));
        let off = ((e.sigma_a - a) / e.sigma_a_err).abs().max(((e.sigma_s - s) / e.sigma_s_err).abs());
        if off.is_nan() || off > 4.0 {
            verdict = format!("wrong: ok, but {off:.1} printed errors from the truth");
        }
    }
    StressRow {
        model: model.into(),
        case: case.into(),
        expected: expected.into(),
        verdict,
        digits: correct,
        condition: e.condition.is_finite().then_some(e.condition),
        ms,
    }
}
