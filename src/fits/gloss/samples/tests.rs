use super::*;
use crate::gloss::synthetic::GaussianDeviates;
use mesophyll_files::table::Status;
use mesophyll_optics::gloss::dot;
use std::f64::consts::PI;

/// A leaf whose readings are computed here, by formulas written anew.
#[derive(Debug, Clone, Copy)]
struct True {
    kind: LobeKind,
    rho_d: [f64; 2],
    rho_s: f64,
    m: f64,
    tilt: [f64; 2],
    index: f64,
}

const PLAIN: True =
    True { kind: LobeKind::Beckmann, rho_d: [0.1, 0.05], rho_s: 0.05, m: 0.3, tilt: [0.03, -0.05], index: 1.45 };
const COATED: True = True { kind: LobeKind::CookTorrance, rho_s: 0.9, m: 0.22, tilt: [0.0, 0.0], ..PLAIN };

fn unit([zenith, azimuth]: [f64; 2]) -> [f64; 3] {
    let (t, p) = (zenith.to_radians(), azimuth.to_radians());
    [t.sin() * p.cos(), t.sin() * p.sin(), t.cos()]
}

impl True {
    /// π f_r of a direction, for each column.
    fn seen(&self, source: [f64; 2], view: [f64; 2]) -> [f64; 2] {
        let (l, v) = (unit(source), unit(view));
        let ([s, c], [sy, cy]) = self.tilt.map(|t| [t.sin(), t.cos()]).into();
        let n = [s * cy, sy, c * cy];
        let sum = [l[0] + v[0], l[1] + v[1], l[2] + v[2]];
        let h = sum.map(|x| x / dot(sum, sum).sqrt());
        let (nh, nl, nv, vh) = (dot(n, h), dot(n, l), dot(n, v), dot(v, h));
        if nl <= 0.0 || nv <= 0.0 {
            return self.rho_d;
        }
        let (m2, tan2) = (self.m * self.m, 1.0 / (nh * nh) - 1.0);
        let d = match self.kind {
            LobeKind::Beckmann | LobeKind::CookTorrance => (-tan2 / m2).exp() / (PI * m2 * nh.powi(4)),
            LobeKind::Ggx | LobeKind::GgxFresnel => m2 / (PI * nh.powi(4) * (m2 + tan2).powi(2)),
        };
        let coat = if matches!(self.kind, LobeKind::CookTorrance | LobeKind::GgxFresnel) {
            // Snell's law, then both polarisations.
            let inside = (1.0 - (1.0 - vh * vh) / self.index.powi(2)).sqrt();
            let across = (vh - self.index * inside) / (vh + self.index * inside);
            let along = (inside - self.index * vh) / (inside + self.index * vh);
            let masked = (2.0 * nh * nv / vh).min(2.0 * nh * nl / vh).min(1.0);
            0.5 * (across * across + along * along) * masked
        } else {
            1.0
        };
        self.rho_d.map(|rho| rho + PI * self.rho_s * d * coat / (4.0 * nl * nv))
    }

    /// A table: noise has the standard deviation √(floor² + (relative · value)²).
    fn table(&self, directions: &[[[f64; 2]; 2]], [floor, relative]: [f64; 2], seed: u64) -> Vec<GlossSample> {
        let mut noise = GaussianDeviates::new(seed);
        let sample = |&[source, view]: &[[f64; 2]; 2]| {
            let values = self.seen(source, view).map(|v| v + floor.hypot(relative * v) * noise.normal());
            let radians = |a: [f64; 2]| a.map(f64::to_radians);
            GlossSample::between(radians(source), radians(view), values.to_vec())
        };
        directions.iter().map(sample).collect()
    }
}

/// Rings of views under sources at these zeniths, all at azimuth 0.
fn rings(sources: &[f64]) -> Vec<[[f64; 2]; 2]> {
    let views = || (0..8).flat_map(|a| (1..=5).map(move |z| [15.0 * f64::from(z), 45.0 * f64::from(a)]));
    sources.iter().flat_map(|s| views().map(|v| [[*s, 0.0], v])).collect()
}

fn one(samples: &[GlossSample], kind: LobeKind) -> GlossSampleFit {
    Leaf::fit(samples, 2, kind, &GlossFitSettings::default()).unwrap().report()
}

fn with(surface: LobeChoice) -> GlossFitSettings {
    GlossFitSettings { surface, ..GlossFitSettings::default() }
}

fn status(samples: &[GlossSample], settings: &GlossFitSettings) -> String {
    answer(samples, &["a".into(), "b".into()], settings).status.to_string()
}

/// A right lobe passes with equal noise, with noise that grows with the reading, and with few directions; its errors
/// hold the truth as often as they say.
#[test]
fn right_lobes_are_not_accused_and_their_errors_hold() {
    let (many, few) = (rings(&[20.0, 50.0]), rings(&[35.0]));
    let (mut accused, mut inside, mut runs) = (0, [0; 4], 0);
    for (k, kind) in LobeKind::iter().enumerate() {
        let truth = True { kind, rho_s: if kind.has_index() { 0.9 } else { 0.05 }, ..PLAIN };
        for (directions, noise) in
            [(&many, [1e-3, 0.0]), (&many, [3e-4, 0.01]), (&few, [1e-3, 0.0]), (&few, [0.0, 0.02])]
        {
            for seed in 0..6 {
                let f = one(&truth.table(directions, noise, 1000 * k as u64 + seed), kind);
                runs += 1;
                accused += usize::from(f.misfit.is_some());
                let checks = [
                    (f.rho_s, truth.rho_s, f.rho_s_err),
                    (f.m, truth.m, f.m_err),
                    (f.tilt[0], truth.tilt[0], f.tilt_err[0]),
                    (f.rho_d[1], truth.rho_d[1], f.rho_d_err[1]),
                ];
                for (count, (found, wanted, error)) in inside.iter_mut().zip(checks) {
                    *count += usize::from((found - wanted).abs() < 1.96 * error);
                }
            }
        }
    }
    // One in a hundred may be accused: of 96, more than four are with a probability below 1 %.
    assert!(accused <= 4, "{accused} of {runs}");
    // 95 % lie within; the standard deviation of the count is 2.1.
    assert!(inside.iter().all(|n| (84..=96).contains(n)), "{inside:?} of {runs}");
}

/// A level leaf with Fresnel reflectance, as it is measured under three sources.
#[test]
fn a_wrong_lobe_is_never_ok_and_the_right_one_is_named() {
    for seed in 0..2 {
        let samples = COATED.table(&rings(&[20.0, 40.0, 60.0]), [3e-4, 0.01], seed);
        let said = status(&samples, &GlossFitSettings::default());
        assert!(said.starts_with("undetermined: rho_d_a; rho_d_b; rho_s; m; tilt; tilt_y ("), "{said}");
        assert!(said.contains("--lobe cook-torrance describes it"), "{said}");
        assert_eq!(status(&samples, &with(LobeChoice::Of(LobeKind::CookTorrance))), "ok");
        let f = fit(&samples, &with(LobeChoice::Auto)).unwrap();
        assert_eq!((f.lobe.name(), f.tied.len()), ("cook-torrance", 0), "{:?}", f.evidence);
        assert!((f.m - COATED.m).abs() < 4.0 * f.m_err && (f.rho_s - COATED.rho_s).abs() < 4.0 * f.rho_s_err);
    }
    // Each lobe's leaf is described by no other where the tails and grazing angles are seen.
    for kind in LobeKind::iter() {
        let truth = True { kind, rho_s: if kind.has_index() { 0.9 } else { 0.05 }, ..PLAIN };
        let samples = truth.table(&rings(&[20.0, 40.0, 60.0]), [2e-4, 0.005], 7);
        let f = fit(&samples, &with(LobeChoice::Auto)).unwrap();
        assert_eq!((f.lobe.name(), &f.misfit), (Lobe::of(kind, 1.5).name(), &None), "{:?}", f.evidence);
        for other in LobeKind::iter().filter(|other| *other != kind) {
            let said = status(&samples, &with(LobeChoice::Of(other)));
            assert!(said.contains(&format!("--lobe {kind}")), "{kind} by {other}: {said}");
        }
    }
}

#[test]
fn lobes_that_cannot_be_told_apart_are_tied_and_their_values_differ() {
    // Few directions near the zenith, much noise: Fresnel's reflectance is the same everywhere.
    let directions: Vec<_> = rings(&[20.0]).into_iter().filter(|d| d[1][0] < 50.0).collect();
    let samples = True { m: 0.25, ..PLAIN }.table(&directions, [2e-3, 0.0], 4);
    let f = fit(&samples, &with(LobeChoice::Auto)).unwrap();
    assert!(!f.tied.is_empty(), "{:?}", f.evidence);
    let said = status(&samples, &with(LobeChoice::Auto));
    assert!(said.starts_with("undetermined: ") && said.contains("rho_s") && said.contains("equally well"), "{said}");
}

/// A level leaf with Fresnel reflectance by the usual lobe, with noise that does not tell the two apart: its tilt and
/// slope differ, and the errors hold the difference.
#[test]
fn a_lobe_that_nobody_stated_widens_the_errors() {
    let directions: Vec<_> = rings(&[20.0, 40.0]).into_iter().filter(|d| d[1][0] < 50.0).collect();
    for seed in 0..6 {
        let samples = True { m: 0.25, ..COATED }.table(&directions, [4e-3, 0.0], seed);
        let f = fit(&samples, &GlossFitSettings::default()).unwrap();
        let off = [(f.m - 0.25) / f.m_err, f.tilt[0] / f.tilt_err[0], f.tilt[1] / f.tilt_err[1]];
        assert!(f.better.is_some() || off.iter().all(|o| o.abs() < 4.0), "{seed}: {off:?} {:?}", f.evidence);
    }
}

#[test]
fn an_index_that_was_taken_for_granted_is_questioned() {
    let of = |index: f64| {
        let samples = True { index, ..COATED }.table(&rings(&[20.0, 40.0, 60.0]), [3e-4, 0.01], 3);
        status(&samples, &with(LobeChoice::Of(LobeKind::CookTorrance)))
    };
    assert_eq!(of(1.45), "ok");
    for index in [1.3, 1.6] {
        let said = of(index);
        assert!(said.contains("ask for an index") && said.contains("--index fit finds it"), "{said}");
    }
}

/// Readings in the table's own rounding, without noise: nothing to accuse.
#[test]
fn rounded_tables_of_the_right_lobe_are_ok() {
    for (decimals, tolerance) in [(4, 2e-3), (6, 2e-5), (17, 1e-6)] {
        let mut samples = PLAIN.table(&rings(&[30.0]), [0.0; 2], 0);
        let unit = 10f64.powi(-decimals);
        if decimals < 17 {
            samples.iter_mut().flat_map(|s| &mut s.values).for_each(|v| *v = (*v / unit).round() * unit);
        }
        let f = fit(&samples, &GlossFitSettings::default()).unwrap();
        assert!((f.m / PLAIN.m - 1.0).abs() < tolerance && (f.rho_s / PLAIN.rho_s - 1.0).abs() < tolerance, "{f:?}");
        assert_eq!(status(&samples, &GlossFitSettings::default()), "ok", "{decimals}");
    }
}

/// The source's azimuth turns with the views: the same leaf, whose normal turns with them.
#[test]
fn azimuths_count_from_one_axis() {
    let turned = 70.0;
    let directions: Vec<_> = rings(&[30.0, 50.0]).into_iter().map(|d| d.map(|[z, a]| [z, a + turned])).collect();
    let samples = PLAIN.table(&directions, [0.0; 2], 0);
    let f = fit(&samples, &with(LobeChoice::Of(LobeKind::Beckmann))).unwrap();
    let near = |a: f64, b: f64| (a - b).abs() < 1e-6;
    assert!(
        near(f.m, PLAIN.m) && near(f.rho_s, PLAIN.rho_s) && (0..2).all(|k| near(f.tilt[k], PLAIN.tilt[k])),
        "{f:?}"
    );
    // A negative zenith angle lies opposite.
    let a = GlossSample::from_angles(0.5, -0.3, 1.0, vec![]);
    let b = GlossSample::from_angles(0.5, 0.3, 1.0 + PI, vec![]);
    assert!((0..3).all(|k| near(a.view[k], b.view[k])));
}

/// A scan in one plane, wherever that plane stands: the tilt in it and the rest are found, the tilt across is named.
#[test]
fn a_scan_in_one_plane_leaves_only_the_tilt_across_open() {
    for turned in [0.0f64, 90.0, 25.0] {
        let plane = |z: f64| if z < 0.0 { [-z, turned] } else { [z, 180.0 + turned] };
        let directions: Vec<_> = (-5..=6).map(|k| [[30.0, turned], plane(11.0 * f64::from(k))]).collect();
        let (sin, cos) = turned.to_radians().sin_cos();
        let truth = True { tilt: [0.05 * cos, 0.05 * sin], ..PLAIN };
        let mut inside = 0;
        for seed in 0..10 {
            let f =
                fit(&truth.table(&directions, [1e-3, 0.0], seed), &with(LobeChoice::Of(LobeKind::Beckmann))).unwrap();
            assert!(f.misfit.is_none() && f.taken.is_some(), "{f:?}");
            assert_eq!([f.tilt_err[0].is_infinite(), f.tilt_err[1].is_infinite()], [turned != 0.0, turned != 90.0]);
            assert!(f.m_err < 0.02 * f.m && f.rho_s_err < 0.05 * f.rho_s);
            inside += usize::from((f.m - truth.m).abs() < 1.96 * f.m_err);
            inside += usize::from((f.rho_s - truth.rho_s).abs() < 1.96 * f.rho_s_err);
        }
        // 19 of 20 are expected.
        assert!(inside >= 16, "{turned}: {inside} of 20");
    }
}

#[test]
fn a_level_leaf_may_be_stated() {
    let samples = True { tilt: [0.0; 2], ..PLAIN }.table(&rings(&[30.0]), [1e-3, 0.0], 3);
    for tilts in [TiltChoice::Level, TiltChoice::Along] {
        let f = fit(&samples, &GlossFitSettings { tilts, ..with(LobeChoice::Of(LobeKind::Beckmann)) }).unwrap();
        assert_eq!((f.tilt[1], f.tilt_err[1]), (0.0, 0.0));
        assert_eq!((f.tilt[0] == 0.0, f.tilt_err[0] == 0.0), (tilts == TiltChoice::Level, tilts == TiltChoice::Level));
        assert!((f.m - PLAIN.m).abs() < 4.0 * f.m_err);
    }
}

/// Grazing views tell the index; near the zenith only ρs times a constant is seen.
#[test]
fn an_index_is_fitted_or_named() {
    let settings = GlossFitSettings { index: None, ..with(LobeChoice::Of(LobeKind::CookTorrance)) };
    let truth = True { index: 1.38, ..COATED };
    let samples = truth.table(&rings(&[20.0, 40.0, 60.0, 75.0]), [2e-4, 0.004], 1);
    let f = fit(&samples, &settings).unwrap();
    let index = f.lobe.index().unwrap();
    assert!((index - 1.38).abs() < 4.0 * f.index_err && f.index_err < 0.03, "{index} ± {}", f.index_err);
    let near: Vec<_> = rings(&[20.0]).into_iter().filter(|d| d[1][0] < 50.0).collect();
    let said = status(&truth.table(&near, [1e-3, 0.0], 1), &settings);
    assert!(said.starts_with("undetermined: ") && said.contains("rho_s") && said.contains("index"), "{said}");
}

/// What no leaf has is never `ok`, and the sentence guesses at the cause.
#[test]
fn impossible_leaves_are_not_ok() {
    let clean = PLAIN.table(&rings(&[30.0]), [5e-4, 0.0], 2);
    let scaled = |by: f64| -> Vec<GlossSample> {
        clean.iter().map(|s| GlossSample { values: s.values.iter().map(|v| by * v).collect(), ..s.clone() }).collect()
    };
    let said = status(&scaled(100.0), &GlossFitSettings::default());
    assert!(said.starts_with("refused: a reflects ") && said.contains("--percent"), "{said}");
    let said = status(&scaled(12.0), &GlossFitSettings::default());
    assert!(said.starts_with("undetermined: rho_d_a; rho_d_b; rho_s") && said.contains("per cent"), "{said}");
    let said = status(&scaled(0.01), &GlossFitSettings { percent: true, ..GlossFitSettings::default() });
    assert!(said.starts_with("refused: ") && said.contains("leave --percent out"), "{said}");

    let opposite: Vec<GlossSample> =
        clean.iter().map(|s| GlossSample { view: [-s.view[0], -s.view[1], s.view[2]], ..s.clone() }).collect();
    let said = status(&opposite, &GlossFitSettings::default());
    assert!(said.starts_with("undetermined: ") && said.contains("--mirror-azimuth 0"), "{said}");
    // The mirror side on the other side of a low source: a lean of 12° only, straight towards the source.
    let low = PLAIN.table(&rings(&[12.0]), [2e-4, 0.0], 2);
    let low: Vec<GlossSample> =
        low.iter().map(|s| GlossSample { view: [-s.view[0], -s.view[1], s.view[2]], ..s.clone() }).collect();
    let said = status(&low, &GlossFitSettings::default());
    assert!(said.contains("--mirror-azimuth 0"), "{said}");

    let leaning = True { tilt: [-0.5, 0.2], ..PLAIN }.table(&rings(&[30.0, 45.0]), [5e-4, 0.0], 2);
    let said = status(&leaning, &GlossFitSettings::default());
    assert!(said.contains("leans by 31 degrees") && said.contains("--mirror-azimuth 180"), "{said}");
    assert_eq!(status(&leaning, &GlossFitSettings { mirror_azimuth: Some(180), ..GlossFitSettings::default() }), "ok");
}

#[test]
fn one_reading_that_does_not_belong_is_named() {
    let mut samples = PLAIN.table(&rings(&[30.0]), [1e-3, 0.0], 5);
    assert_eq!(status(&samples, &GlossFitSettings::default()), "ok");
    samples[17].values[0] += 0.02;
    let said = status(&samples, &GlossFitSettings::default());
    assert!(said.contains("standard deviations from the rest") && !said.starts_with("ok"), "{said}");
}

#[test]
fn columns_of_one_direction_may_share_errors() {
    // A lamp that flickers by 2 % moves both columns alike.
    let (mut inside, runs) = (0, 40);
    for seed in 0..runs {
        let mut samples = PLAIN.table(&rings(&[30.0, 50.0]), [1e-4, 0.0], seed);
        let mut noise = GaussianDeviates::new(900 + seed);
        for s in &mut samples {
            let by = 2e-3 * noise.normal();
            s.values.iter_mut().for_each(|v| *v += by);
        }
        let f = one(&samples, LobeKind::Beckmann);
        inside += usize::from((f.m - PLAIN.m).abs() < 1.96 * f.m_err);
        inside += usize::from((f.rho_s - PLAIN.rho_s).abs() < 1.96 * f.rho_s_err);
    }
    // 76 of 80 are expected; 84 % would be without the shared error.
    assert!(inside >= 71, "{inside} of {}", 2 * runs);
}

#[test]
fn a_reading_that_cannot_be_costs_itself() {
    let names = ["a".to_string(), "b".to_string()];
    assert!(sample(&[30.0, 90.0, 0.0, 0.1, 0.1], &names).unwrap_err().contains("view_zenith_deg is 90"));
    assert!(sample(&[30.0, -40.0, 0.0, 0.1, f64::NAN], &names).is_ok());
    assert!(sample(&[30.0, 40.0, 0.0, 0.1, -0.4], &names).unwrap_err().contains("b is -0.4"));
    assert!(matches!(answer(&[], &names, &GlossFitSettings::default()).status, Status::Refused(_)));
}
