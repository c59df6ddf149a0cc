//! Sweeps over the settings that decide the accuracy of branches: coefficients, degree in the taper, arc length steps,
//! precision, size of a motion texture.

use super::figures::{example, printed_length_error};
use super::reference;
use crate::bench::{BenchRow, median_us};
use mesophyll_fits::branch::beam::basis::{DEGREE, PolynomialVariable, of_branches, pair, shape, smooth_fit, worst};
use mesophyll_fits::branch::beam::fit::{PositionReference, fit};
use mesophyll_fits::branch::beam::synthetic::{BranchFitTruth, branch};
use mesophyll_plants::mechanics::length::{bend_with, kept, printed};
use mesophyll_plants::mechanics::load::Load;
use mesophyll_plants::mechanics::motion::{MotionTexture, deviation};
use mesophyll_plants::mechanics::motion_spectrum::SpectrumMethod;
use mesophyll_plants::mechanics::quadrature::four;
use mesophyll_plants::mechanics::taper::TERMS;
use mesophyll_plants::mechanics::{beam, taper};
use std::hint::black_box;

const TAPERS: [f64; 6] = [1e-4, 1e-2, 0.05, 0.1, 0.3, 1.0];

fn row(knob: &str, setting: impl Into<String>, error: f64, us: f64, note: &str) -> BenchRow {
    BenchRow { model: "beam".into(), knob: knob.into(), setting: setting.into(), error, us, note: note.into() }
}

/// Time of one evaluation at 64 places of one taper (µs).
fn each(mut work: impl FnMut(f64) -> f64) -> f64 {
    median_us(10.0, || (1..=64).map(|k| work(f64::from(k) / 64.0)).sum::<f64>()) / 64.0
}

/// The rows.
///
/// # Errors
/// None; the signature is that of every sweep.
pub fn bench_rows() -> crate::Result<Vec<BenchRow>> {
    let mut rows = Vec::new();
    let digits = |single: bool| {
        let mut fewest = 16.0f64;
        for alpha in TAPERS {
            for k in 1..=20 {
                let x = f64::from(k) / 20.0;
                let d = if single {
                    let (alpha, x) = (alpha as f32, x as f32);
                    let (u, du) = beam::single(alpha, x);
                    reference::digits(f64::from(alpha), f64::from(x), (f64::from(u), f64::from(du)))
                } else {
                    reference::digits(alpha, x, (beam::deflection(alpha, x), beam::slope(alpha, x)))
                };
                fewest = fewest.min(d);
            }
        }
        10f64.powf(-fewest)
    };
    let note = "u and u', relative, worst over tapers, against double-double";
    rows.push(row("exact", "f64", digits(false), each(|x| beam::deflection(black_box(0.1), x)), note));
    rows.push(row("exact", "f32", digits(true), each(|x| f64::from(beam::single(black_box(0.1), x as f32).0)), note));

    let of_tip = |alpha: f64, error: f64| error / beam::deflection(alpha, 1.0);
    let two = TAPERS.iter().map(|a| of_tip(*a, pair(*a, 101).max_error)).fold(0.0, f64::max);
    let p = pair(0.1, 101);
    rows.push(row(
        "printed pair",
        "2",
        two,
        each(|x| black_box(p.c2) * x * x + p.c4 * x.powi(4)),
        "of the tip, worst over tapers",
    ));
    let coefficients = |n: usize| vec![0.1; n];
    for n in 1..=8 {
        let c = coefficients(n);
        let time = each(|x| black_box(&c).iter().rev().fold(0.0, |s, a| s * x + a) * x * x);
        rows.push(row(
            "coefficients, powers of x",
            n.to_string(),
            of_branches(PolynomialVariable::Place, n),
            time,
            "of the tip, worst over tapers",
        ));
        let s = shape(0.1);
        let time = each(|x| {
            let y = taper::coordinate(black_box(&s), x);
            c.iter().rev().fold(0.0, |s, a| s * y + a) * y * y
        });
        rows.push(row(
            "coefficients, powers of y",
            n.to_string(),
            of_branches(PolynomialVariable::Taper, n),
            time,
            "of the tip, worst over tapers",
        ));
    }
    for degree in 2..=8 {
        let time = median_us(30.0, || smooth_fit(TERMS, degree));
        let note = format!("of the tip; {} numbers for all tapers; the time is that of the fit", TERMS * (degree + 1));
        rows.push(row(
            "smooth in the taper, degree",
            degree.to_string(),
            smooth_fit(TERMS, degree).worst().0,
            time,
            &note,
        ));
    }
    debug_assert!(worst(1.0, |x| shape(1.0).at(x).0) < 0.01 && DEGREE > 0);
    lengths(&mut rows);
    measured(&mut rows);
    for size in [64, 128, 256] {
        let s = example(0.25);
        for (name, method) in [
            ("printed", SpectrumMethod::Plain),
            ("inverse Abel", SpectrumMethod::InverseAbel),
            ("directed", SpectrumMethod::Directed),
        ] {
            let make = || MotionTexture::new(|f| s.spectrum(f), s.highest(), size, 5, method);
            let Some(motion) = make() else { continue };
            let error = deviation(&motion, |f| s.spectrum(f), 2, 16).0;
            rows.push(row(
                &format!("motion texture, {name}"),
                format!("{size}²"),
                error,
                median_us(30.0, make),
                "RMS log10 of the spectrum of lines, damping a quarter of critical",
            ));
        }
    }
    Ok(rows)
}

fn lengths(rows: &mut Vec<BenchRow>) {
    let nodes = four();
    let note = "length of the branch, worst over tapers from 1e-4 to 1 at tip deflections .25 to .75 L";
    let cases = || TAPERS.iter().flat_map(|a| [0.25, 0.5, 0.75].map(|t| (*a, t)));
    let off = cases().map(|(a, t)| printed_length_error(a, t).abs()).fold(0.0, f64::max);
    let s = shape(0.1);
    let amplitude = 0.5 / s.tip();
    let time = each(|x| {
        let (u, du) = s.at(x);
        printed(x, black_box(amplitude) * u, amplitude * du).0
    });
    rows.push(row("length correction", "printed", off, time, note));
    for steps in 1..=3 {
        let error = |(alpha, tip): (f64, f64)| {
            let s = shape(alpha);
            let a = tip / s.tip();
            (kept(&s, &bend_with(&s, 1.0, a, &nodes, steps), 1.0, a) - 1.0).abs()
        };
        let off = cases().map(error).fold(0.0, f64::max);
        let time = each(|x| bend_with(&s, x, black_box(amplitude), &nodes, steps).across);
        rows.push(row("length correction", format!("{steps} Newton"), off, time, note));
    }
}

fn measured(rows: &mut Vec<BenchRow>) {
    let truth = BranchFitTruth::default();
    for marks in [6, 12, 24, 48] {
        let b = branch(&truth, marks, 0.01, 1, PositionReference::Branch);
        if let Ok(m) = fit(&b, PositionReference::Branch, Some(Load::Even)) {
            let time = median_us(50.0, || fit(&b, PositionReference::Branch, Some(Load::Even)));
            rows.push(row(
                "marks of a measured branch",
                marks.to_string(),
                m.taper.error / m.taper.value,
                time,
                "relative standard error of the taper at 1 % noise; the time is that of the fit",
            ));
        }
    }
}
