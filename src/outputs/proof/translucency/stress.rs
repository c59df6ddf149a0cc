//! Stiff and extreme leaves, each with the verdict that it must get: blades thinner than a mean free path, no
//! absorption, hardly any scattering, veins of one texel, holes, no relief, and scattering that is almost entirely
//! forward or backward.

use crate::stress::StressRow;
use crate::{Error, Result};
use mesophyll_fits::record::FitTimes;
use mesophyll_fits::translucency::source::{TranslucencyLeaf, TranslucencySideMaps};
use mesophyll_fits::translucency::{Options, TissueName, TissueSource, side};
use mesophyll_optics::dipole::{DipoleForm, Tissue};
use mesophyll_optics::side::Side;
use mesophyll_optics::slab;
use mesophyll_optics::translucency::basis;
use mesophyll_optics::translucency::convolution::{ConvolutionSettings, Convolver};
use mesophyll_optics::translucency::levels::ThicknessLevels;
use mesophyll_optics::walk::slab::EntryDirection;
use mesophyll_optics::walk::{Boundary, Histories, Medium, Slab};
use std::time::Instant;

/// Relative error up to which a form is called right. Diffusion is nowhere more accurate (`bench translucency` has the
/// errors).
const RIGHT: f64 = 0.05;

fn row(case: &str, expected: &str, verdict: String, digits: Option<f64>, since: Instant) -> StressRow {
    StressRow {
        model: "translucency".into(),
        case: case.into(),
        expected: expected.into(),
        verdict,
        digits: digits.filter(|d| d.is_finite()),
        condition: None,
        ms: since.elapsed().as_secs_f64() * 1e3,
    }
}

/// `ok` where the error is allowed; otherwise the verdict says how large it is.
fn judged(found: f64, wanted: f64, allowed: f64) -> (String, Option<f64>) {
    let off = (found / wanted - 1.0).abs();
    let digits = Some((-off.log10()).clamp(0.0, 16.0));
    if off <= allowed {
        ("ok".into(), digits)
    } else {
        (format!("wrong: {found:.4e} for {wanted:.4e}, {:+.1} %", 100.0 * (found / wanted - 1.0)), digits)
    }
}

fn refused(e: &Error) -> String {
    format!("refused: {e}")
}

/// The thin form's total, compared with the transport equation.
fn against_transport(case: &str, sigma_a: f64, sigma_s: f64, d: f64) -> StressRow {
    let clock = Instant::now();
    let tissue = Tissue { sigma_a, sigma_s, g: 0.0, a: 1.0 };
    let (verdict, digits) =
        judged(tissue.total(d, DipoleForm::Thin), slab::medium::response(sigma_a, sigma_s, d).rho_t, RIGHT);
    row(case, "ok", verdict, digits, clock)
}

/// The same compared with a random walk, for scattering that is not isotropic.
fn against_walk(case: &str, expected: &str, g: f64, d: f64) -> Result<StressRow> {
    let clock = Instant::now();
    let (sigma_a, reduced) = (0.4, 9.5);
    let tissue = Tissue { sigma_a, sigma_s: reduced / (1.0 - g), g, a: 1.0 };
    let slab =
        Slab { medium: Medium { sigma_a, sigma_s: tissue.sigma_s, g }, thickness_mm: d, boundary: Boundary::Matched };
    let walk = slab.walk(EntryDirection::NORMAL, Histories { count: 100_000, seed: 1 }, &[])?;
    let (found, truth) = (tissue.total(d, DipoleForm::Thin), walk.transmitted);
    let (mut verdict, digits) = judged(found, truth.value, RIGHT + 3.0 * truth.error / truth.value);
    // A result that is called doubtful need not be right, but every wrong result must be called doubtful.
    if let Some(why) = tissue.doubt() {
        verdict = format!("undetermined: {why}");
    }
    Ok(row(case, expected, verdict, digits, clock))
}

/// A map of smoothly varying thickness with a vein of one texel, and a hole where `hole` is set.
fn veined(hole: bool) -> Vec<f64> {
    (0..64 * 64)
        .map(|k| {
            let (i, j) = ((k % 64) as f64, (k / 64) as f64);
            match k % 64 {
                40 => 0.5,
                20..26 if hole && (30..36).contains(&(k / 64)) => 0.0,
                _ => 0.18 + 0.02 * (0.11 * i).sin() * (0.07 * j).cos(),
            }
        })
        .collect()
}

fn settings(levels: usize) -> ConvolutionSettings {
    ConvolutionSettings {
        levels: ThicknessLevels { count: levels, ..ThicknessLevels::default() },
        ..ConvolutionSettings::new(Tissue { sigma_a: 0.4, sigma_s: 10.2, g: 0.07, a: 1.2 }, 0.1)
    }
}

/// Eight levels compared with sixty-four: the vein's shadow must not depend on their number.
fn vein() -> Result<StressRow> {
    let clock = Instant::now();
    let (thickness, light) = (veined(false), vec![vec![1.0; 64 * 64]]);
    let run = |levels| -> Result<Vec<f64>> {
        let made = Convolver::with(&settings(levels), 64, 64, 0.16, 0.5)?;
        Ok(made.run(&thickness, &light).swap_remove(0))
    };
    let (few, many) = (run(8)?, run(64)?);
    let off =
        few.iter().zip(&many).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / many.iter().map(|v| v * v).sum::<f64>();
    let rms = off.sqrt();
    let verdict = if rms <= 0.01 { "ok".into() } else { format!("wrong: {rms:.1e} RMS from the thickness levels") };
    Ok(row("a vein one texel wide, 8 thickness levels", "ok", verdict, Some(-rms.log10()), clock))
}

/// No light leaves from the texels of a hole, none is lost elsewhere, and every value is a number.
fn hole() -> Result<StressRow> {
    let clock = Instant::now();
    let (thickness, mut light) = (veined(true), vec![0.0; 64 * 64]);
    // Light falls only on the middle, so all of it leaves within the map.
    for k in 0..light.len() {
        if (16..48).contains(&(k % 64)) && (16..48).contains(&(k / 64)) {
            light[k] = 1.0;
        }
    }
    let settings = settings(8);
    let made = Convolver::with(&settings, 64, 64, 0.16, 0.5)?;
    let out = made.run(&thickness, &[light.clone()]).swap_remove(0);
    let wanted: f64 = thickness
        .iter()
        .zip(&light)
        .filter(|(d, _)| **d > 0.0)
        .map(|(d, l)| l * settings.tissue.total(*d, settings.form))
        .sum();
    let (verdict, digits) = if out.iter().all(|v| v.is_finite()) {
        judged(out.iter().sum(), wanted, 1e-5)
    } else {
        ("wrong: not a number".into(), None)
    };
    Ok(row("a hole in the leaf", "ok", verdict, digits, clock))
}

/// A leaf in memory: `n` × `n` texels without relief.
fn flat(n: usize, thickness: f64) -> TranslucencyLeaf {
    let side = TranslucencySideMaps {
        name: Side::Front,
        rho_d: [0.1, 0.2, 0.05].map(|v| vec![v; n * n]),
        rho_t: [0.1, 0.2, 0.05].map(|v| vec![v; n * n]),
        normal: vec![[0.0, 0.0, 1.0]; n * n],
        height: vec![0.0; n * n],
        slope_residual: 0.0,
        thickness: vec![thickness; n * n],
        mask: vec![true; n * n],
        sigma_a: [3.0, 1.0, 6.0],
        sigma_s: [10.0; 3],
        sigma_err: [[0.1; 3]; 2],
        undetermined: Vec::new(),
    };
    TranslucencyLeaf {
        name: "flat".into(),
        width: n,
        height: n,
        texel_mm: 0.1,
        thickness_mm: thickness,
        sides: vec![side],
        hash: String::new(),
    }
}

/// A uniform leaf without relief answers n·ω everywhere, so each Half-Life 2 coefficient is √(2π)/3.
fn no_relief() -> Result<StressRow> {
    let clock = Instant::now();
    let source = flat(48, 0.2);
    let made = side::make(&source, &source.sides[0], &[1], &Options::default(), &mut FitTimes::default())?;
    let off = made.coefficients[0].iter().flatten().map(|c| (c / basis::FLAT - 1.0).abs()).fold(0.0, f64::max);
    let verdict = if off < 1e-9 { "ok".into() } else { format!("wrong: coefficients are off by {off:.1e}") };
    Ok(row("no relief: half-life-2 coefficients", "ok", verdict, Some(-off.log10()), clock))
}

/// A slab that the leaf fit did not determine must not be used.
fn undetermined() -> StressRow {
    let clock = Instant::now();
    let mut source = flat(8, 0.2);
    source.sides[0].sigma_err[0][1] = f64::INFINITY;
    source.sides[0].undetermined = vec!["sigma_a.G: relative standard error inf".into()];
    let run = |options: &Options| side::make(&source, &source.sides[0], &[1], options, &mut FitTimes::default());
    let verdict = match (
        run(&Options::default()),
        run(&Options { tissue: TissueSource::Named(TissueName::Table), ..Options::default() }),
    ) {
        (Err(e), Ok(_)) => format!("undetermined: {e}"),
        (Ok(_), _) => "wrong: computed from a slab that is not determined".into(),
        (_, Err(e)) => format!("wrong: the table's tissue was refused too: {e}"),
    };
    row("the leaf fit left the slab undetermined", "undetermined: ", verdict, None, clock)
}

/// The table of `mesophyll stress translucency`.
pub fn rows() -> Result<Vec<StressRow>> {
    let paper = Tissue { sigma_a: 0.4, sigma_s: 10.2, g: 0.07, a: 1.2 };
    let clock = Instant::now();
    let form = |form| ConvolutionSettings { form, ..ConvolutionSettings::new(paper, 0.1) };
    let thin_refused = |f| Convolver::with(&form(f), 16, 16, 0.05, 0.2).map_or_else(|e| refused(&e), |_| "ok".into());
    let mut rows = vec![
        against_transport("d = l/10", 0.5, 9.5, 0.01),
        against_transport("d = l/2", 0.5, 9.5, 0.05),
        against_transport("d = l", 0.5, 9.5, 0.1),
        against_transport("sigma_a = 0, d = 3 l", 0.0, 10.0, 0.3),
        against_transport("sigma_a = 1e-12, d = 10 l", 1e-12, 10.0, 1.0),
        against_transport("sigma_a = 100 sigma_s", 10.0, 0.1, 0.2),
        against_transport("sigma_s = 0", 10.0, 0.0, 0.2),
        row("dipoles at d < l", "refused: thickness", thin_refused(DipoleForm::Dipoles(3)), None, clock),
        row("images at d < l", "refused: thickness", thin_refused(DipoleForm::Images), None, clock),
        against_walk("g = 0.9, d = 2 l", "ok", 0.9, 0.2)?,
        against_walk("g = 0.9, d = 10 l", "ok", 0.9, 1.0)?,
        against_walk("g = -0.9, d = 2 l", "undetermined: ", -0.9, 0.2)?,
        against_walk("g = -0.9, d = 10 l", "undetermined: ", -0.9, 1.0)?,
        vein()?,
        hole()?,
        no_relief()?,
        undetermined(),
    ];
    let clock = Instant::now();
    let bad = Tissue { sigma_a: f64::NAN, ..paper };
    let verdict = Convolver::with(&ConvolutionSettings::new(bad, 0.1), 16, 16, 0.1, 0.2)
        .map_or_else(|e| refused(&e), |_| "ok".into());
    rows.push(row("sigma_a not a number", "refused: ", verdict, None, clock));
    rows.extend(crate::tissue::stress::rows()?);
    Ok(rows)
}
