//! A window fitted to skies: it causes as little ringing below the horizon as possible while losing as little
//! irradiance as possible.
//!
//! The unknowns are the factors w_1 … w_{N−1} of the bands (w_0 = 1). There are two kinds of residuals. For many
//! directions below the horizon it is the square of how far the windowed luminance dips below zero, relative to the
//! sky's mean. Times a weight, it is the square of the relative change of the irradiance upwards and, at half the
//! weight, on four tilted normals. Least squares squares them once more, so the deepest dip and the largest loss count
//! most. A larger weight loses less irradiance and allows deeper dips. [`matched`] takes the weight at which the dip
//! equals that of the sin x/x window on all orders, so that the two can be compared by their loss alone.

use crate::sky::{Error, Result};
use mesophyll_base::solvers::problem::ClosureProblem;
use mesophyll_base::solvers::{Fit, Options, lm};
use mesophyll_sky::harmonics::HarmonicBasis;
use mesophyll_sky::irradiance::{cosine_lobe, irradiance, on_level_ground};
use mesophyll_sky::projection::{ProjectionQuality, ProjectionRule};
use mesophyll_sky::window::{HarmonicWindow, WindowDip, WindowOrders, irradiance_change, lowest_below};
use mesophyll_sky::{HarmonicCoefficients, Preetham, colour};
use rayon::prelude::*;
use std::f64::consts::{FRAC_1_SQRT_2, PI};
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};

/// The windows that are offered, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum WindowKind {
    /// No window: the coefficients stay as they are.
    #[default]
    None,
    /// The sin x/x window on the zonal coefficients (order 0) alone.
    Zonal,
    /// The sin x/x window on the coefficients of all orders.
    Lanczos,
    /// The window that loses least irradiance of all that dip no deeper than the sin x/x window.
    Fitted,
    /// The window that lets no sky dip below zero.
    Positive,
}

impl WindowKind {
    /// The window on this many bands; `None` where nothing is changed.
    ///
    /// # Errors
    /// As [`matched`].
    pub fn window(self, bands: usize) -> Result<Option<HarmonicWindow>> {
        Ok(match self {
            WindowKind::None => None,
            WindowKind::Zonal => Some(HarmonicWindow::zonal(bands)),
            WindowKind::Lanczos => Some(HarmonicWindow::lanczos(bands)),
            WindowKind::Fitted => Some(matched(bands)?),
            WindowKind::Positive => Some(HarmonicWindow::positive(bands)),
        })
    }
}

/// Suns and turbidities of the fit, and of the table; they have none in common.
const FITTED_ON: ([f64; 6], [f64; 3]) = ([0.1, 0.5, 0.9, 1.2, 1.4, 1.55], [2.5, 4.0, 6.0]);
const SHOWN_ON: ([f64; 6], [f64; 3]) = ([0.0, 0.35, 0.75, 1.1, 1.3, 1.5], [2.7, 3.0, 5.5]);

/// Normals: upwards, and tilted by 45° to four sides.
const NORMALS: [[f64; 3]; 5] = [
    [0.0, 0.0, 1.0],
    [FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2],
    [-FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2],
    [0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2],
    [0.0, -FRAC_1_SQRT_2, FRAC_1_SQRT_2],
];

fn skies((suns, turbidities): ([f64; 6], [f64; 3]), bands: usize) -> Result<Vec<HarmonicCoefficients>> {
    let refused = |e: mesophyll_sky::SkyRefusal| Error::Missed(e.to_string());
    let rows: Result<Vec<Vec<HarmonicCoefficients>>> = suns
        .par_iter()
        .map(|s| {
            let rule = ProjectionRule::new(*s, bands, ProjectionQuality::Fit);
            turbidities.iter().map(|t| Ok(rule.project(&Preetham.at(*s, *t).map_err(refused)?))).collect()
        })
        .collect();
    Ok(rows?.concat())
}

/// The luminance of each band alone in direction `d`.
fn by_band(c: &HarmonicCoefficients, d: [f64; 3], y: &mut [f64], basis: &HarmonicBasis) -> Vec<f64> {
    basis.fill(d, y);
    (0..c.bands())
        .map(|l| {
            let sum = (l * l..(l + 1) * (l + 1))
                .fold([0.0; 3], |s, k| std::array::from_fn(|i| s[i] + y[k] * c.values()[k][i]));
            colour::xyz_from_rgb(sum)[1]
        })
        .collect()
}

/// Fits a window for N = `bands`. A larger `weight` loses less irradiance and dips deeper.
///
/// # Errors
/// Fewer than two bands; a solver that did not converge.
pub fn fit(bands: usize, weight: f64) -> Result<(HarmonicWindow, Fit)> {
    if bands < 2 {
        return Err(Error::Usage(format!("a window of {bands} bands has nothing to fit; expected 2 or more")));
    }
    let basis = HarmonicBasis::new(bands);
    let mut y = vec![0.0; bands * bands];
    // Rows of N numbers: the luminance of each band below the horizon over the mean, and the irradiance of each band
    // over the whole.
    let (mut below, mut lit) = (Vec::new(), Vec::new());
    for c in skies(FITTED_ON, bands)? {
        let mean = colour::xyz_from_rgb(c.get(0, 0))[1] * (4.0 * PI).sqrt() / (2.0 * PI);
        for row in 0..12 {
            let theta = PI * (92.0 + 8.0 * f64::from(row)) / 180.0;
            for column in 0..13 {
                let phi = PI * f64::from(column) / 12.0;
                let d = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
                below.push(by_band(&c, d, &mut y, &basis).iter().map(|v| v / mean).collect::<Vec<_>>());
            }
        }
        for n in NORMALS {
            let bands: Vec<f64> =
                by_band(&c, n, &mut y, &basis).iter().enumerate().map(|(l, v)| cosine_lobe(l) * v).collect();
            let whole: f64 =
                if n[2] == 1.0 { colour::xyz_from_rgb(on_level_ground(&c))[1] } else { bands.iter().sum() };
            lit.push((if n[2] == 1.0 { 1.0 } else { 0.5 }, bands.iter().map(|v| v / whole).collect::<Vec<_>>()));
        }
    }
    let (dips, losses) = ((1.0 / below.len() as f64).sqrt(), weight * (1.0 / lit.len() as f64).sqrt());
    let m = below.len() + lit.len();
    let windowed = |row: &[f64], w: &[f64]| row[0] + row[1..].iter().zip(w).map(|(a, b)| a * b).sum::<f64>();
    let evaluate = |w: &[f64], out: &mut [f64]| {
        for (r, row) in out.iter_mut().zip(&below) {
            *r = dips * windowed(row, w).min(0.0).powi(2);
        }
        for (r, (share, row)) in out[below.len()..].iter_mut().zip(&lit) {
            let change = windowed(row, w) - 1.0;
            *r = share * losses * change * change.abs();
        }
    };
    let jacobian = |w: &[f64], out: &mut [f64]| {
        for (i, row) in below.iter().enumerate() {
            let slope = 2.0 * dips * windowed(row, w).min(0.0);
            (1..bands).for_each(|l| out[(l - 1) * m + i] = slope * row[l]);
        }
        for (i, (share, row)) in lit.iter().enumerate() {
            let slope = 2.0 * share * losses * (windowed(row, w) - 1.0).abs();
            (1..bands).for_each(|l| out[(l - 1) * m + below.len() + i] = slope * row[l]);
        }
    };
    let problem = ClosureProblem::new(bands - 1, m, evaluate).with_jacobian(jacobian);
    let start = HarmonicWindow::lanczos(bands).factors[1..].to_vec();
    let options = Options { lower: vec![0.0; bands - 1], upper: vec![1.0; bands - 1], ..Options::default() };
    let fit = lm::minimize(&problem, &start, &options);
    if !fit.converged() {
        return Err(Error::Missed(format!("the window's fit ended as {}", fit.termination.name())));
    }
    let factors = std::iter::once(1.0).chain(fit.params.iter().copied()).collect();
    Ok((HarmonicWindow { name: "fitted".into(), orders: WindowOrders::All, factors }, fit))
}

/// The window that loses the least irradiance among those that dip no deeper than the sin x/x window on all orders,
/// over the skies of the fit.
///
/// # Errors
/// As [`fit`].
pub fn matched(bands: usize) -> Result<HarmonicWindow> {
    let seen = skies(FITTED_ON, bands)?;
    let basis = HarmonicBasis::new(bands);
    let dip = |w: &HarmonicWindow| {
        seen.par_iter().map(|c| lowest_below(&w.apply(c), &basis).luminance).reduce(|| 0.0, f64::min)
    };
    let limit = dip(&HarmonicWindow::lanczos(bands));
    let (mut low, mut high) = (1e-3f64, 1e3f64);
    let mut best = fit(bands, low)?.0;
    for _ in 0..12 {
        let middle = (low * high).sqrt();
        let window = fit(bands, middle)?.0;
        if dip(&window) >= limit {
            (low, best) = (middle, window);
        } else {
            high = middle;
        }
    }
    Ok(best)
}

/// The effect of a window on the skies of the table.
#[derive(Debug, Clone, PartialEq)]
pub struct WindowEffect {
    /// The window that was looked at.
    pub window: HarmonicWindow,
    /// Deepest dip of any sky.
    pub dip: WindowDip,
    /// Change of the irradiance on level ground, the largest of any sky and channel.
    pub change: f64,
    /// Root mean square of the change over skies (luminance).
    pub change_rms: f64,
}

/// The comparison of all windows, on skies that no window was fitted on.
///
/// # Errors
/// Only those of the skies.
pub fn table(windows: Vec<HarmonicWindow>, bands: usize) -> Result<Vec<WindowEffect>> {
    let seen = skies(SHOWN_ON, bands)?;
    let basis = HarmonicBasis::new(bands);
    let row = |window: HarmonicWindow| {
        let (mut dip, mut change, mut squares) = (WindowDip { luminance: 0.0, channel: 0.0 }, 0.0f64, 0.0);
        for c in &seen {
            let out = window.apply(c);
            let one = lowest_below(&out, &basis);
            dip = WindowDip { luminance: dip.luminance.min(one.luminance), channel: dip.channel.min(one.channel) };
            let off = irradiance_change(&out, on_level_ground(c));
            if off.abs() > change.abs() {
                change = off;
            }
            let bright = |v: [f64; 3]| colour::xyz_from_rgb(v)[1];
            squares += (bright(irradiance(&out, NORMALS[0])) / bright(on_level_ground(c)) - 1.0).powi(2);
        }
        WindowEffect { window, dip, change, change_rms: (squares / seen.len() as f64).sqrt() }
    };
    Ok(windows.into_par_iter().map(row).collect())
}

/// All windows of the comparison.
///
/// # Errors
/// As [`fit`].
pub fn all(bands: usize) -> Result<Vec<HarmonicWindow>> {
    Ok(vec![
        HarmonicWindow::none(bands),
        HarmonicWindow::zonal(bands),
        HarmonicWindow::lanczos(bands),
        HarmonicWindow::laplacian(bands, 0.002),
        matched(bands)?,
        HarmonicWindow::positive(bands),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fitted_window_dips_no_deeper_and_loses_less() {
        let rows = table(all(7).unwrap(), 7).unwrap();
        for r in &rows {
            println!(
                "{:10} dip {:.3} ({:.3} worst channel), irradiance {:+.4} rms {:.4}  {:.3?}",
                r.window.name, r.dip.luminance, r.dip.channel, r.change, r.change_rms, r.window.factors
            );
        }
        let by = |name: &str| rows.iter().find(|r| r.window.name == name).unwrap();
        let (zonal, lanczos, fitted) = (by("zonal"), by("lanczos"), by("fitted"));
        // On skies that were not fitted, it dips no deeper within a hundredth of the mean, and loses less.
        assert!(fitted.dip.luminance > lanczos.dip.luminance - 0.01 && fitted.change_rms < lanczos.change_rms);
        assert!(lanczos.dip.luminance > zonal.dip.luminance + 0.05 && by("positive").dip.channel > -1e-9);
    }

    #[test]
    fn weight_trades_ringing_for_loss() {
        let seen = skies(FITTED_ON, 5).unwrap();
        let basis = HarmonicBasis::new(5);
        let at = |weight: f64| {
            let (w, f) = fit(5, weight).unwrap();
            let change =
                seen.iter().map(|c| irradiance_change(&w.apply(c), on_level_ground(c)).abs()).fold(0.0, f64::max);
            (seen.iter().map(|c| lowest_below(&w.apply(c), &basis).luminance).fold(0.0, f64::min), change, f)
        };
        let (careful, loose) = (at(0.1), at(10.0));
        assert!(careful.0 > loose.0 && careful.1 > loose.1, "{:?} {:?}", (careful.0, careful.1), (loose.0, loose.1));
        assert!(careful.2.converged());
        assert!(fit(1, 0.1).is_err());
    }
}
