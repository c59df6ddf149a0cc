//! What each knob of the translucency maps costs and gains: dipoles, thickness levels, map size, form of the kernels.

use super::{basis_study, validation};
use crate::bench::{BenchRow, median_us};
use crate::{Error, Result};
use mesophyll_files::progress::{self, TaskProgress};
use mesophyll_optics::dipole::{DipoleForm, Tissue};
use mesophyll_optics::slab;
use mesophyll_optics::translucency::convolution::{ConvolutionSettings, Convolver};
use mesophyll_optics::translucency::levels::{LevelKind, ThicknessLevels};

/// H9 Table 3.1 without its forward scattering, because the transport equation used for comparison is isotropic.
const TISSUE: Tissue = Tissue { sigma_a: 0.4, sigma_s: 9.486, g: 0.0, a: 1.0 };

fn row(knob: &str, setting: String, error: f64, us: f64, note: String) -> BenchRow {
    BenchRow { model: "translucency".into(), knob: knob.into(), setting, error, us, note }
}

/// The sum of dipoles is compared with infinitely many, and every form's total with the transport equation.
fn forms() -> Vec<BenchRow> {
    let mut rows = Vec::new();
    for (d, sigma_a) in [(0.2, 0.4), (0.2, 0.01), (0.5, 0.4)] {
        let tissue = Tissue { sigma_a, ..TISSUE };
        let all = tissue.total(d, DipoleForm::Images);
        for n in [0, 1, 3, 10, 30] {
            let form = DipoleForm::Dipoles(n);
            let error = (tissue.total(d, form) / all - 1.0).abs();
            let us = median_us(5.0, || tissue.transmittance(0.1, d, form));
            rows.push(row(
                &format!("dipoles: d {d} mm, sigma_a {sigma_a}/mm"),
                n.to_string(),
                error,
                us,
                "total against infinitely many; time of one T(r, d)".into(),
            ));
        }
    }
    for d in [0.02, 0.05, 0.11, 0.2, 0.5, 1.0] {
        let truth = slab::medium::response(TISSUE.sigma_a, TISSUE.sigma_s, d).rho_t;
        for (name, form) in
            [("dipoles 3", DipoleForm::Dipoles(3)), ("images", DipoleForm::Images), ("thin", DipoleForm::Thin)]
        {
            let total = TISSUE.total(d, form);
            // NaN means that a form has no answer; it gets no row.
            if total.is_finite() {
                let us = median_us(5.0, || TISSUE.total(d, form));
                rows.push(row(
                    &format!("form: {name}"),
                    format!("d {d} mm"),
                    (total / truth - 1.0).abs(),
                    us,
                    "total against the transport equation; time of one total".into(),
                ));
            }
        }
    }
    rows
}

/// Thickness of a leaf with veins: d from .15 to .5 mm.
fn thickness(n: usize) -> Vec<f64> {
    (0..n * n)
        .map(|k| {
            let (x, y) = ((k % n) as f64 / n as f64, (k / n) as f64 / n as f64);
            let vein = (-((x - 0.5 - 0.05 * (6.0 * y).sin()) / 0.02).powi(2))
                .exp()
                .max(0.5 * (-(((8.0 * (x + y)).fract() - 0.5) / 0.06).powi(2)).exp());
            0.15 + 0.05 * (9.0 * x).sin().powi(2) + 0.3 * vein
        })
        .collect()
}

fn convolver(n: usize, texel_mm: f64, levels: ThicknessLevels) -> Result<Convolver> {
    Convolver::with(&ConvolutionSettings { levels, ..ConvolutionSettings::new(TISSUE, texel_mm) }, n, n, 0.15, 0.5)
}

/// Numbers K of levels of each kind, compared with 64 Chebyshev levels.
fn levels() -> Result<Vec<BenchRow>> {
    let n = 256;
    let (d, light) = (thickness(n), vec![vec![1.0; n * n]]);
    let many =
        convolver(n, 0.1, ThicknessLevels { count: 64, kind: LevelKind::Chebyshev })?.run(&d, &light).swap_remove(0);
    let size: f64 = many.iter().map(|v| v * v).sum();
    let mut rows = Vec::new();
    for (name, kind) in [
        ("linear", LevelKind::Linear),
        ("cubic", LevelKind::Cubic),
        ("chebyshev", LevelKind::Chebyshev),
        ("svd", LevelKind::Svd),
    ] {
        progress::go_on()?;
        for count in [4, 6, 8, 12, 16] {
            let made = convolver(n, 0.1, ThicknessLevels { count, kind })?;
            let few = made.run(&d, &light).swap_remove(0);
            let rms = (few.iter().zip(&many).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / size).sqrt();
            let us = median_us(50.0, || made.run(&d, &light));
            let note = format!("RMS against 64 levels; time of one {n}x{n} image");
            rows.push(row(&format!("thickness levels: {name}"), format!("K {count}"), rms, us, note));
        }
    }
    Ok(rows)
}

/// Time of three images, kernels included, against the size of the map.
fn sizes() -> Result<Vec<BenchRow>> {
    let mut rows = Vec::new();
    for n in [128, 256, 512, 1024] {
        progress::go_on()?;
        let texel = 102.4 / n as f64;
        let (d, light) = (thickness(n), vec![vec![1.0; n * n]; 3]);
        let mut failed: Option<Error> = None;
        let us = median_us(20.0, || match convolver(n, texel, ThicknessLevels::default()) {
            Ok(made) => made.run(&d, &light).len(),
            Err(e) => {
                failed = Some(e);
                0
            }
        });
        if let Some(e) = failed {
            return Err(e);
        }
        rows.push(row(
            "map size",
            format!("{n}x{n}"),
            f64::NAN,
            us,
            "no error: time of three images of one side, K = 8, kernels included".into(),
        ));
    }
    Ok(rows)
}

/// Steps of the bar that [`rows`] takes.
pub const PIECES: u64 = 3 + basis_study::PIECES + validation::PIECES;

/// The table of `mesophyll bench translucency`.
///
/// # Errors
/// [`Error::Interrupted`]; no other that a correct program meets.
pub fn rows(bar: &TaskProgress) -> Result<Vec<BenchRow>> {
    let mut rows = forms();
    bar.step()?;
    rows.extend(levels()?);
    bar.step()?;
    rows.extend(sizes()?);
    bar.step()?;
    rows.extend(basis_study::rows(bar)?);
    rows.extend(validation::bench_rows(bar)?);
    Ok(rows)
}
