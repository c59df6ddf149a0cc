//! Windows against ringing: factors a band that soften the jump at the horizon, and what each costs.
//!
//! A sky that ends at the horizon rings: its truncated sum dips below zero in the lower hemisphere. The jump is not
//! confined to m = 0 (its height varies with azimuth), so a filter of the zonal terms alone (Habel 2009 Eq. 5.5) leaves
//! dips that a filter of every order removes.

use super::harmonics::{HarmonicBasis, HarmonicCoefficients};
use super::irradiance;
use std::f64::consts::PI;

/// Which orders a window touches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WindowOrders {
    /// m = 0 alone.
    Zonal,
    /// Every order m.
    All,
}

/// Factors w_l, one a band.
#[derive(Debug, Clone, PartialEq)]
pub struct HarmonicWindow {
    /// What it is called in tables and options.
    pub name: String,
    /// Which orders are multiplied.
    pub orders: WindowOrders,
    /// w_l, from l = 0.
    pub factors: Vec<f64>,
}

/// sin x/x.
fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { x.sin() / x }
}

impl HarmonicWindow {
    /// No window.
    pub fn none(bands: usize) -> HarmonicWindow {
        HarmonicWindow { name: "none".into(), orders: WindowOrders::All, factors: vec![1.0; bands] }
    }

    /// The dissertation's: sin x/x with x = πl/N on m = 0 (Habel 2009 Eq. 5.5).
    pub fn zonal(bands: usize) -> HarmonicWindow {
        HarmonicWindow { name: "zonal".into(), orders: WindowOrders::Zonal, ..HarmonicWindow::lanczos(bands) }
    }

    /// The same factors on every order: a convolution, so that it softens all jumps alike.
    pub fn lanczos(bands: usize) -> HarmonicWindow {
        let factors = (0..bands).map(|l| sinc(PI * l as f64 / bands as f64)).collect();
        HarmonicWindow { name: "lanczos".into(), orders: WindowOrders::All, factors }
    }

    /// 1/(1 + λ l²(l+1)²): the least squared Laplacian (Sloan 2008, "Stupid spherical harmonics tricks").
    pub fn laplacian(bands: usize, lambda: f64) -> HarmonicWindow {
        let factors = (0..bands).map(|l| 1.0 / (1.0 + lambda * (l * (l + 1)).pow(2) as f64)).collect();
        HarmonicWindow { name: "laplacian".into(), orders: WindowOrders::All, factors }
    }

    /// The convolution with a kernel that is nowhere negative, of all such the one that keeps most of band 1: what
    /// comes out is nowhere negative either, whatever the sky. The kernel is the square of Σ_k P_k(x₁) (2k+1) P_k(z), k
    /// ≤ (N−1)/2, with x₁ the largest zero of the next Legendre polynomial (Fejér's extremal problem on the sphere);
    /// band 1 keeps the share x₁.
    pub fn positive(bands: usize) -> HarmonicWindow {
        let degree = bands.saturating_sub(1) / 2;
        let legendre = |z: f64, up_to: usize| {
            let mut p = vec![1.0, z];
            for k in 2..=up_to.max(1) {
                p.push(((2 * k - 1) as f64 * z * p[k - 1] - (k - 1) as f64 * p[k - 2]) / k as f64);
            }
            p
        };
        let zero = super::quadrature::gauss(degree + 1).last().map_or(0.0, |n| n.0);
        let at_zero = legendre(zero, degree);
        let mut factors = vec![0.0; bands];
        for &(z, w) in super::quadrature::gauss(2 * bands + 2).iter() {
            let p = legendre(z, bands.max(degree));
            let kernel: f64 = (0..=degree).map(|k| (2 * k + 1) as f64 * at_zero[k] * p[k]).sum();
            factors.iter_mut().enumerate().for_each(|(l, f)| *f += w * kernel * kernel * p[l]);
        }
        let whole = factors.first().copied().unwrap_or(1.0);
        factors.iter_mut().for_each(|f| *f /= whole);
        HarmonicWindow { name: "positive".into(), orders: WindowOrders::All, factors }
    }

    /// The coefficients with the window on; bands beyond the window's are dropped.
    pub fn apply(&self, c: &HarmonicCoefficients) -> HarmonicCoefficients {
        let mut out = c.clone();
        for l in 0..c.bands() {
            let w = self.factors.get(l).copied().unwrap_or(0.0);
            let range = match self.orders {
                WindowOrders::Zonal => l * (l + 1)..l * (l + 1) + 1,
                WindowOrders::All => l * l..(l + 1) * (l + 1),
            };
            out.values_mut()[range].iter_mut().for_each(|v| *v = v.map(|x| w * x));
        }
        out
    }
}

/// How deep a sum dips in the lower hemisphere, where it should be zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowDip {
    /// Smallest luminance over the mean luminance of the upper hemisphere.
    pub luminance: f64,
    /// The same of the worst channel, over that channel's mean.
    pub channel: f64,
}

/// The dip of coefficients even in azimuth, on 1° × 3° steps.
pub fn lowest_below(c: &HarmonicCoefficients, basis: &HarmonicBasis) -> WindowDip {
    // windows keep band 0, so this is the mean of the unwindowed upper hemisphere
    let mean = c.get(0, 0).map(|v| v * (4.0 * PI).sqrt() / (2.0 * PI));
    let luminance = |rgb: [f64; 3]| crate::colour::xyz_from_rgb(rgb)[1];
    let bright = luminance(mean);
    let mut dip = WindowDip { luminance: f64::INFINITY, channel: f64::INFINITY };
    for row in 0..=90 {
        let theta = PI * f64::from(90 + row) / 180.0;
        for column in 0..=60 {
            let phi = PI * f64::from(column) / 60.0;
            let v = basis.sum(c, [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]);
            dip.luminance = dip.luminance.min(luminance(v) / bright);
            dip.channel = (0..3).map(|k| v[k] / mean[k]).fold(dip.channel, f64::min);
        }
    }
    dip
}

/// Relative change of the irradiance on level ground, worst channel, against what the whole hemisphere sends (`exact`:
/// see [`irradiance::on_level_ground`]).
pub fn irradiance_change(c: &HarmonicCoefficients, exact: [f64; 3]) -> f64 {
    let got = irradiance::irradiance(c, [0.0, 0.0, 1.0]);
    (0..3).map(|k| got[k] / exact[k] - 1.0).fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Preetham;
    use crate::projection::direct;

    /// θs = 1.3, τ = 3, N = 7, computed elsewhere: luminance dips to −.38 of the mean, with the zonal filter −.23,
    /// filtering every order −.08.
    #[test]
    fn the_zonal_filter_leaves_most_of_the_dip() {
        let c = direct(&Preetham.at(1.3, 3.0).unwrap(), 7);
        let basis = HarmonicBasis::new(7);
        let dip = |w: &HarmonicWindow| lowest_below(&w.apply(&c), &basis).luminance;
        let (none, zonal, all) =
            (dip(&HarmonicWindow::none(7)), dip(&HarmonicWindow::zonal(7)), dip(&HarmonicWindow::lanczos(7)));
        println!("none {none:.3} zonal {zonal:.3} lanczos {all:.3}");
        assert!(
            (none + 0.38).abs() < 0.01 && (zonal + 0.23).abs() < 0.01 && (all + 0.08).abs() < 0.01,
            "{none} {zonal} {all}"
        );
    }

    /// A kernel that is nowhere negative cannot make a sky negative, and keeps as much of band 1 as theory allows.
    #[test]
    fn the_positive_window_is_positive_and_extremal() {
        let w = HarmonicWindow::positive(7);
        assert!((w.factors[1] - 0.861_136_311_594_052_6).abs() < 1e-12, "{:?}", w.factors);
        let basis = HarmonicBasis::new(7);
        for (s, t) in [(0.0, 2.5), (1.3, 3.0), (1.57, 6.0)] {
            let low = lowest_below(&w.apply(&direct(&Preetham.at(s, t).unwrap(), 7)), &basis);
            assert!(low.channel > -1e-12, "θs {s}: {low:?}");
        }
    }

    #[test]
    fn windows_keep_the_mean_and_reach_their_orders() {
        let c = direct(&Preetham.at(1.0, 3.0).unwrap(), 7);
        for w in [
            HarmonicWindow::zonal(7),
            HarmonicWindow::lanczos(7),
            HarmonicWindow::laplacian(7, 0.001),
            HarmonicWindow::positive(7),
        ] {
            let out = w.apply(&c);
            assert!((w.factors[0] - 1.0).abs() < 1e-14);
            let touched = out.get(3, 2)[0] != c.get(3, 2)[0];
            assert_eq!(touched, w.orders == WindowOrders::All, "{}", w.name);
        }
        // the dissertation's factor of l = 1 at N = 7 is sin(π/7)/(π/7)
        assert!((HarmonicWindow::zonal(7).factors[1] - (PI / 7.0).sin() * 7.0 / PI).abs() < 1e-15);
    }
}
