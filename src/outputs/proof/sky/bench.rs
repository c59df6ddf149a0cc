//! `bench sky`: error against terms, bytes, fit time and evaluation time, with the dissertation's fit for comparison;
//! also integration and windows.

use super::dome;
use super::figures::{
    self, DISSERTATION_BYTES, DISSERTATION_ERROR, DISSERTATION_FIT_S, DISSERTATION_US, FrontierPoint,
};
use crate::Result;
use crate::bench::{BenchRow, median_us};
use mesophyll_fits::sky::{standard, window};
use mesophyll_sky::Preetham;
use mesophyll_sky::projection::{ProjectionQuality, ProjectionRule};

fn row(knob: &str, setting: String, error: f64, us: f64, note: String) -> BenchRow {
    BenchRow { model: "sky".into(), knob: knob.into(), setting, error, us, note }
}

/// The sweeps. A fit has two rows: one for the time of its evaluation and one for that of the fit. Errors are those of
/// the worst sky, relative to the smallest c00.
///
/// # Errors
/// As the fits.
pub fn bench_rows() -> Result<Vec<BenchRow>> {
    let reference = figures::reference()?;
    let points = figures::frontier(&reference, 500)?;
    let mut rows = of_points(&points);
    rows.push(row(
        "peer",
        "dissertation 2009, evaluation".into(),
        DISSERTATION_ERROR,
        DISSERTATION_US,
        format!(
            "{DISSERTATION_BYTES} bytes as f64; Pentium 4, 3.2 GHz; its error measured by us in f64, it claims .015"
        ),
    ));
    rows.push(row(
        "peer",
        "dissertation 2009, fit".into(),
        DISSERTATION_ERROR,
        DISSERTATION_FIT_S * 1e6,
        "2.3 h, Pentium 4, 3.2 GHz".into(),
    ));
    let fine = standard()?;
    if let Ok(fixed) = fine.at(3.3) {
        let mut out = [[0.0f32; 3]; 49];
        let us = figures::thousand_us(|k| fixed.fill(1.1 + 1e-4 * k, &mut out));
        let error = points.iter().find(|p| p.setting.contains("fine")).map_or(f64::NAN, |p| p.judged.worst);
        rows.push(row("turbidity fixed", "fine".into(), error, us, "the sun alone moves".into()));
    }
    let skies = [(0.3, 2.5), (1.1, 4.0), (1.5, 3.0), (1.57, 6.0)];
    for (name, quality) in [("fit's rule", ProjectionQuality::Fit), ("exact", ProjectionQuality::Exact)] {
        let (mut error, mut us, mut nodes) = (0.0f64, 0.0, 0);
        for (s, t) in skies {
            let Ok(sky) = Preetham.at(s, t) else { continue };
            let (got, want) = (
                ProjectionRule::new(s, 7, quality).project(&sky),
                ProjectionRule::new(s, 7, ProjectionQuality::Checked).project(&sky),
            );
            let c00 = want.get(0, 0).into_iter().fold(f64::INFINITY, f64::min);
            error = got.distance(&want).into_iter().fold(error, |e, d| e.max(d / c00));
            us += median_us(20.0, || ProjectionRule::new(s, 7, quality).project(&sky)) / skies.len() as f64;
            nodes += ProjectionRule::new(s, 7, quality).evaluations() / skies.len();
        }
        rows.push(row(
            "integration",
            name.into(),
            error,
            us,
            format!("{nodes} directions on average; error over the sky's own c00"),
        ));
    }
    for r in window::table(window::all(7)?, 7)? {
        let note = format!(
            "dips to {:.3} of the mean below the horizon (worst channel {:.3}); irradiance upwards {:+.1} % at most, \
             {:.1} % rms",
            r.dip.luminance,
            r.dip.channel,
            1e2 * r.change,
            1e2 * r.change_rms
        );
        rows.push(row("window", r.window.name, f64::NAN, f64::NAN, note));
    }
    rows.extend(dome::bench_rows()?);
    Ok(rows)
}

/// The frontier's rows.
fn of_points(points: &[FrontierPoint]) -> Vec<BenchRow> {
    let evaluated = points.iter().map(|p| {
        let note = format!("{} terms, {} bytes; error in f64 {:.1e}", p.terms, p.bytes, p.wide);
        row(&format!("{}: evaluation", p.family), p.setting.clone(), p.judged.worst, p.evaluate_us, note)
    });
    let fitted = points.iter().map(|p| {
        let note = format!("{} terms, {} bytes", p.terms, p.bytes);
        row(&format!("{}: fit", p.family), p.setting.clone(), p.judged.worst, p.fit_us, note)
    });
    evaluated.chain(fitted).collect()
}
