//! Goniometer tables of known leaves, among them some that the fitted lobe does not describe, each with the verdict
//! that it must get.

use crate::stress::StressRow;
use mesophyll_fits::gloss::normal_of;
use mesophyll_fits::gloss::samples::{GlossFitSettings, GlossSample, LobeChoice, answer};
use mesophyll_fits::gloss::synthetic::GaussianDeviates;
use mesophyll_optics::gloss::{Lobe, LobeKind};
use std::f64::consts::PI;

const RHO_D: [f64; 2] = [0.1, 0.05];
const M: f64 = 0.25;
const COATED: Lobe = Lobe::CookTorrance { index: 1.45 };

struct Case {
    name: &'static str,
    expected: &'static str,
    lobe: Lobe,
    rho_s: f64,
    tilt: [f64; 2],
    settings: GlossFitSettings,
    /// Views at these azimuths (degrees).
    azimuths: Vec<f64>,
    spoil: fn(&mut Vec<GlossSample>),
}

impl Default for Case {
    fn default() -> Case {
        Case {
            name: "",
            expected: "ok",
            lobe: Lobe::Beckmann,
            rho_s: 0.05,
            tilt: [0.04, -0.03],
            settings: GlossFitSettings { surface: LobeChoice::Of(LobeKind::Beckmann), ..GlossFitSettings::default() },
            azimuths: (0..8).map(|k| 45.0 * f64::from(k)).collect(),
            spoil: |_| {},
        }
    }
}

fn cases() -> Vec<Case> {
    let auto = || GlossFitSettings { surface: LobeChoice::Auto, ..GlossFitSettings::default() };
    vec![
        Case { name: "goniometer, the right lobe", ..Case::default() },
        Case {
            name: "goniometer, a leaf with Fresnel reflectance taken for beckmann",
            expected: "undetermined: rho_d_a; rho_d_b; rho_s; m; tilt; tilt_y (the model does not describe this leaf: ",
            lobe: COATED,
            rho_s: 0.9,
            tilt: [0.0; 2],
            ..Case::default()
        },
        Case {
            name: "goniometer, a leaf with Fresnel reflectance by the lobe with most evidence",
            lobe: COATED,
            rho_s: 0.9,
            settings: auto(),
            ..Case::default()
        },
        Case {
            name: "goniometer, a scan in one plane",
            expected: "undetermined: tilt_y (the readings do not show the tilt across",
            azimuths: vec![0.0, 180.0],
            tilt: [0.04, 0.0],
            ..Case::default()
        },
        Case {
            name: "goniometer, the mirror side at azimuth 0",
            expected: "undetermined: rho_d_a; rho_d_b; rho_s; m; tilt; tilt_y (",
            spoil: |samples| {
                // One source: several would show that no leaf is like this.
                samples.truncate(samples.len() / 3);
                samples.iter_mut().for_each(|s| (s.view[0], s.view[1]) = (-s.view[0], -s.view[1]));
            },
            ..Case::default()
        },
        Case {
            name: "goniometer, readings in per cent",
            expected: "refused: a reflects ",
            spoil: |samples| samples.iter_mut().flat_map(|s| &mut s.values).for_each(|v| *v *= 100.0),
            ..Case::default()
        },
        Case {
            name: "goniometer, one wrong reading",
            expected: "undetermined: rho_d_a; rho_d_b; rho_s; m; tilt; tilt_y (the model does not describe this leaf: ",
            spoil: |samples| samples[31].values[1] += 0.05,
            ..Case::default()
        },
    ]
}

/// Fits every case.
pub(super) fn rows() -> Vec<StressRow> {
    cases().iter().map(run).collect()
}

fn run(case: &Case) -> StressRow {
    let dir = |[t, p]: [f64; 2]| [t.sin() * p.cos(), t.sin() * p.sin(), t.cos()];
    let mut noise = GaussianDeviates::new(5);
    let normal = normal_of(case.tilt);
    let mut samples = Vec::new();
    for source in [20f64, 40.0, 60.0] {
        for azimuth in &case.azimuths {
            for zenith in 1..=7 {
                let source = [source.to_radians(), 0.0];
                let view = [f64::from(10 * zenith).to_radians(), azimuth.to_radians()];
                let gloss = PI * case.rho_s * case.lobe.value(normal, dir(source), dir(view), M);
                let values = RHO_D.map(|rho| {
                    let value = rho + gloss;
                    value + (0.005 * value).hypot(2e-4) * noise.normal()
                });
                samples.push(GlossSample::between(source, view, values.to_vec()));
            }
        }
    }
    (case.spoil)(&mut samples);
    let clock = std::time::Instant::now();
    let found = answer(&samples, &["a".into(), "b".into()], &case.settings);
    let ms = clock.elapsed().as_secs_f64() * 1e3;
    // Columns: ρd of both, ρs, m, tilt, tilt_y.
    let truth = [RHO_D[0], RHO_D[1], case.rho_s, M];
    let digits = found.status.is_ok().then(|| {
        let off = found.values.iter().zip(truth).map(|(v, t)| ((v - t) / t).abs().max(1e-16));
        -off.fold(0.0, f64::max).log10()
    });
    StressRow {
        model: "gloss".into(),
        case: case.name.into(),
        expected: case.expected.into(),
        verdict: found.status.to_string(),
        digits,
        condition: None,
        ms,
    }
}
