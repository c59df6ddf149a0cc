//! Stiff and extreme gloss traces, each with the verdict that it must get.

use crate::stress::StressRow;
use mesophyll_fits::gloss::synthetic::{GaussianDeviates, GlossFitTruth, device, pass_x, trace};
use mesophyll_fits::gloss::{GlossFitDevice, GlossTexelFit, GlossTexelFitter};
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::tube::Travel;

const COMMON: GlossFitTruth = GlossFitTruth { rho_d: [0.08, 0.15, 0.05], rho_s: [0.05; 3], m: 0.2, tilt: [0.05, 0.0] };
const COOK_TORRANCE: Lobe = Lobe::CookTorrance { index: 1.45 };
const NOT_EXPLAINED: &str = "(residuals exceed the noise)";

/// A case: the true texel, how its trace is damaged, and the verdict that it must get.
struct Case {
    name: &'static str,
    expected: String,
    truth: GlossFitTruth,
    noise: f64,
    /// Whether values are exact except for single precision; the stated noise is then that of the quadrature.
    exact: bool,
    lobe: Lobe,
    /// The lobe that the trace is fitted with, where it is another one.
    fitted: Option<Lobe>,
    camera_deg: f64,
    thin: bool,
    spoil: fn(&mut Vec<[f32; 3]>),
}

impl Default for Case {
    fn default() -> Self {
        Case {
            name: "",
            expected: "ok".into(),
            truth: COMMON,
            noise: 0.01,
            exact: false,
            lobe: Lobe::Beckmann,
            fitted: None,
            camera_deg: 55.0,
            thin: false,
            spoil: |_| {},
        }
    }
}

fn cases() -> Vec<Case> {
    let all = "rho_d_r; rho_d_g; rho_d_b; rho_s_r; rho_s_g; rho_s_b; m; tilt";
    vec![
        Case { name: "m = 0.01", truth: GlossFitTruth { m: 0.01, ..COMMON }, ..Case::default() },
        Case {
            name: "m = 0.9, strong gloss",
            truth: GlossFitTruth { m: 0.9, rho_d: [0.02, 0.05, 0.02], rho_s: [0.2; 3], ..COMMON },
            noise: 0.002,
            ..Case::default()
        },
        Case {
            name: "m = 0.9, weak gloss",
            truth: GlossFitTruth { m: 0.9, rho_d: [0.3, 0.4, 0.3], rho_s: [0.005; 3], ..COMMON },
            expected: "undetermined: rho_s_r; rho_s_g; rho_s_b; m".into(),
            ..Case::default()
        },
        Case {
            name: "rho_s = 0",
            truth: GlossFitTruth { rho_s: [0.0; 3], ..COMMON },
            expected: "undetermined: rho_s_r; rho_s_g; rho_s_b; m".into(),
            ..Case::default()
        },
        Case {
            name: "tube at grazing: mirror peak beyond its travel",
            truth: GlossFitTruth { tilt: [-0.2, 0.0], ..COMMON },
            ..Case::default()
        },
        Case {
            name: "lobe narrower than a frame",
            truth: GlossFitTruth { m: 0.006, ..COMMON },
            thin: true,
            expected: "undetermined: m (lobe narrower than two frames)".into(),
            ..Case::default()
        },
        Case {
            name: "clipped peak",
            spoil: |t| {
                let peak = (0..t.len()).max_by(|a, b| t[*a][1].total_cmp(&t[*b][1])).unwrap_or(0);
                let top = t[peak][1];
                t.iter_mut().filter(|v| v[1] > 0.7 * top).for_each(|v| *v = [f32::NAN; 3]);
            },
            ..Case::default()
        },
        Case {
            name: "one channel black",
            truth: GlossFitTruth { rho_d: [0.08, 0.15, 0.0], ..COMMON },
            expected: "undetermined: rho_d_b".into(),
            ..Case::default()
        },
        Case {
            name: "one channel without readings",
            spoil: |t| t.iter_mut().for_each(|v| v[2] = f32::NAN),
            expected: "undetermined: rho_d_b; rho_s_b".into(),
            ..Case::default()
        },
        Case {
            name: "constant trace",
            spoil: |t| t.fill([0.1; 3]),
            expected: format!("undetermined: {all} {NOT_EXPLAINED}"),
            ..Case::default()
        },
        Case { name: "values of single precision, no noise", noise: 3e-5, exact: true, ..Case::default() },
        Case { name: "m = 0.01, ggx", truth: GlossFitTruth { m: 0.01, ..COMMON }, lobe: Lobe::Ggx, ..Case::default() },
        Case {
            name: "m = 0.9, strong gloss, ggx",
            truth: GlossFitTruth { m: 0.9, rho_d: [0.02, 0.05, 0.02], rho_s: [0.2; 3], ..COMMON },
            noise: 0.002,
            lobe: Lobe::Ggx,
            ..Case::default()
        },
        Case {
            name: "m = 0.02, cook-torrance",
            truth: GlossFitTruth { m: 0.02, rho_s: [1.0; 3], ..COMMON },
            lobe: COOK_TORRANCE,
            ..Case::default()
        },
        Case {
            name: "m = 0.4, cook-torrance",
            truth: GlossFitTruth { m: 0.4, rho_s: [1.0; 3], ..COMMON },
            lobe: COOK_TORRANCE,
            ..Case::default()
        },
        Case {
            name: "m = 0.4, ggx-fresnel",
            truth: GlossFitTruth { m: 0.4, rho_s: [1.0; 3], ..COMMON },
            lobe: Lobe::GgxFresnel { index: 1.45 },
            ..Case::default()
        },
        Case {
            name: "a leaf of ggx taken for beckmann",
            lobe: Lobe::Ggx,
            fitted: Some(Lobe::Beckmann),
            noise: 0.005,
            expected: format!("undetermined: {all} ("),
            ..Case::default()
        },
        Case { name: "camera at grazing, 80 degrees", camera_deg: 80.0, ..Case::default() },
        Case {
            name: "camera straight above, broad lobe",
            camera_deg: 0.0,
            truth: GlossFitTruth { m: 0.5, ..COMMON },
            expected: format!("undetermined: {}", all.trim_end_matches("; tilt")),
            ..Case::default()
        },
        Case { name: "noise 20 %", noise: 0.2, expected: "ok".into(), ..Case::default() },
        Case {
            name: "three outliers",
            spoil: |t| [7, 30, 88].into_iter().for_each(|k| t[k] = [2.0, 0.0, 1.5]),
            ..Case::default()
        },
        Case {
            name: "all NaN",
            spoil: |t| t.fill([f32::NAN; 3]),
            expected: "refused: no readings".into(),
            ..Case::default()
        },
        Case {
            name: "a single sample",
            spoil: |t| t.iter_mut().skip(1).for_each(|v| *v = [f32::NAN; 3]),
            expected: "refused: too few readings".into(),
            ..Case::default()
        },
        Case {
            name: "dark texel",
            spoil: |t| t.fill([0.0; 3]),
            expected: "refused: no light above the noise".into(),
            ..Case::default()
        },
    ]
}

/// Fits every case.
pub fn rows() -> Vec<StressRow> {
    cases().into_iter().map(|c| run(&c)).chain(super::samples::rows()).collect()
}

fn run(case: &Case) -> StressRow {
    let mut device: GlossFitDevice = device(case.lobe, case.noise);
    let camera = case.camera_deg.to_radians();
    device.camera = [camera.sin(), 0.0, camera.cos()];
    if case.exact {
        device.noise_floor = 1e-6;
    }
    if case.thin {
        device.radius_mm = 0.0;
    }
    let positions = pass_x(100);
    let mut samples = trace(
        &device,
        Travel::X,
        &positions,
        [0.0; 2],
        &case.truth,
        (!case.exact).then_some(&mut GaussianDeviates::new(11)),
    );
    (case.spoil)(&mut samples);
    device.lobe = case.fitted.unwrap_or(case.lobe);
    let fitter = GlossTexelFitter::new(&device, &positions, None);
    let mut ws = fitter.workspace();
    // The fit runs once to build the templates, and once to be timed.
    fitter.fit(&mut ws, [0.0; 2], &samples, None);
    let clock = std::time::Instant::now();
    let fit = fitter.fit(&mut ws, [0.0; 2], &samples, None);
    let ms = clock.elapsed().as_secs_f64() * 1e3;
    let found = fitter.judge(&mut ws, &samples, &fit);
    let digits = if found.as_ref().is_none_or(|found| found.describes()) { digits(&fit, &case.truth) } else { None };
    let condition = fit.condition.is_finite().then_some(fit.condition);
    StressRow {
        model: "gloss".into(),
        case: case.name.into(),
        expected: case.expected.clone(),
        verdict: fit.judged(found.as_ref(), 3).status.to_string(),
        digits,
        condition,
        ms,
    }
}

/// Correct digits of the worst parameter that the fit claims to know (a tilt: of the angle over 0.35).
fn digits(fit: &GlossTexelFit, truth: &GlossFitTruth) -> Option<f64> {
    let unknown = fit.undetermined.names(3);
    let known = |name: &str| !unknown.contains(&name);
    let mut worst: Option<f64> = None;
    let mut see = |name: &str, got: f64, want: f64, scale: f64| {
        if known(name) && got.is_finite() {
            let d = -((got - want).abs() / scale).max(1e-16).log10();
            worst = Some(worst.map_or(d, |w| w.min(d)));
        }
    };
    for (c, suffix) in ["r", "g", "b"].into_iter().enumerate() {
        see(&format!("rho_d_{suffix}"), fit.rho_d[c], truth.rho_d[c], truth.rho_d[c].max(1e-3));
        see(&format!("rho_s_{suffix}"), fit.rho_s[c], truth.rho_s[c], truth.rho_s[c].max(1e-3));
    }
    see("m", fit.m, truth.m, truth.m);
    see("tilt", fit.tilt[0], truth.tilt[0], truth.tilt[0].abs().max(0.35));
    worst
}
