//! Compares the fit with the truth that a synthetic scan comes with: median and 99th percentile of the errors, and how
//! often the truth lies within the stated errors.
//!
//! σa, σs, h + δ and γ are known except for the gauge (mean thickness = h, mean γ = 1), which holds over the texels
//! that could be measured. The truth itself may have another mean there, for example because the missing texels are
//! thicker than the rest. Such a gap between fit and truth comes from the gauge and not from noise. It is printed. The
//! standard errors do not claim to include it and are not judged by it.

use super::texels;
use crate::Result;
use crate::leaf::curve::Incidence;
use crate::leaf::interior::{FittedTexel, LeafSideFit};
use crate::leaf::slabmaps::SlabInverter;
use crate::record::{GAUGE_GAMMA, GAUGE_THICKNESS, TruthError};
use mesophyll_base::statistics::{median, median_of, upper_quantile};
use mesophyll_capture::reader::TubeCapture;
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::quantity::Quantity;
use rayon::prelude::*;
use std::collections::BTreeMap;

const SIGMA: [Quantity; 2] = [Quantity::SigmaA, Quantity::SigmaS];

/// The fit against the truth.
#[derive(Default)]
pub struct TruthComparison {
    /// By quantity.
    pub errors: BTreeMap<String, TruthError>,
    /// Extra figures (angles of normals).
    pub figures: BTreeMap<String, f64>,
    /// The truth of the σ maps.
    pub pigment: Option<ChannelMaps>,
}

/// Compares every quantity that both sides hold; empty where the capture has no truth.
pub fn compare(capture: &TubeCapture, fitted: &LeafSideFit) -> Result<TruthComparison> {
    let (mut errors, mut figures) = (BTreeMap::new(), BTreeMap::new());
    let Some(truth) = capture.truth(fitted.side)? else { return Ok(TruthComparison::default()) };
    let good: Vec<usize> = fitted.texels.iter().map(|x| x.at).collect();
    for quantity in [Quantity::RhoD, Quantity::RhoS, Quantity::M] {
        let mut all = Samples::default();
        for c in 0..quantity.letters().len() {
            all.maps(&truth, &fitted.maps, quantity, c, &good);
        }
        all.store(&mut errors, quantity.name());
    }

    let pigment = pigment(&truth, &good);
    let mut rho_t = Samples::default();
    let mut gamma = Samples::default();
    let mut sigma = [Samples::default(), Samples::default()];
    let mut shared = [Samples::default(), Samples::default()];
    for c in 0..3 {
        if let Some(t) = truth.plane(Quantity::RhoT, c) {
            let [value, error] = fitted.rho_t(c);
            for &k in &good {
                rho_t.push(t[k], f64::from(value[k]), f64::from(error[k]));
            }
        }
        if let Some(t) = truth.plane(Quantity::Gamma, c) {
            for x in &fitted.texels {
                gamma.push(t[x.at], x.interior.gamma[c], x.interior.gamma_err[c]);
            }
        }
        for (q, quantity) in SIGMA.into_iter().enumerate() {
            let Some(t) = truth.plane(quantity, c) else { continue };
            if let Some(own) = pigment.plane(quantity, c) {
                for x in &fitted.texels {
                    sigma[q].push(own[x.at], x.sigma[c].value[q], x.sigma[c].error[q]);
                }
            }
            let mean = good.iter().map(|&k| f64::from(t[k])).sum::<f64>() / good.len().max(1) as f64;
            let (value, relative) = if q == 0 {
                (fitted.sigma_a[c], fitted.sigma_a_rel[c])
            } else {
                (fitted.sigma_s[c], fitted.sigma_s_rel[c])
            };
            shared[q].push(mean as f32, value, value * relative);
            figures.insert(format!("{}_relative_error", quantity.channel(c)), value / mean - 1.0);
        }
        if let (Some(a), Some(t)) = (truth.plane(Quantity::Absorption, c), truth.scalar(Quantity::Thickness)) {
            let letter = Quantity::Absorption.letters()[c];
            let fit = |x: &FittedTexel| x.sigma[c].value[0];
            let crossing = |x: &FittedTexel| [f64::from(a[x.at] * t[x.at]), fit(x) * x.interior.thickness];
            let per_length = fitted.texels.iter().map(|x| [f64::from(a[x.at]), fit(x)]).collect();
            let whole = fitted.texels.iter().map(crossing).collect();
            for (name, pairs) in [("absorption", per_length), ("crossing", whole)] {
                let [correlation, ratio] = follows(pairs);
                figures.insert(format!("{name}_correlation.{letter}"), correlation);
                figures.insert(format!("{name}_ratio.{letter}"), ratio);
            }
        }
    }
    rho_t.store(&mut errors, "rho_t");
    gamma.store(&mut errors, "gamma");
    for ((map, leaf), name) in sigma.into_iter().zip(shared).zip(["sigma_a", "sigma_s"]) {
        map.store(&mut errors, &format!("{name}_map"));
        leaf.store(&mut errors, name);
    }
    if let Some(t) = truth.scalar(Quantity::Thickness) {
        let mut thickness = Samples::default();
        for FittedTexel { at, interior, .. } in &fitted.texels {
            thickness.push(t[*at], interior.thickness, interior.thickness_err);
        }
        thickness.store(&mut errors, "thickness");
    }
    let gauge = Gauge::of(&truth, fitted, &good);
    let claimed = fitted.sigma_a_rel.iter().chain(&fitted.sigma_s_rel).copied().fold(f64::INFINITY, f64::min);
    if gauge.gap() > GAUGE_SHARE * claimed {
        for name in ["sigma_a", "sigma_s", "sigma_a_map", "sigma_s_map", "thickness", "gamma"] {
            if let Some(e) = errors.get_mut(name) {
                e.coverage95 = None;
            }
        }
        figures.insert(GAUGE_THICKNESS.into(), gauge.thickness);
        figures.insert(GAUGE_GAMMA.into(), gauge.gamma);
    }
    let normals = (truth.three(Quantity::Normal), fitted.maps.three(Quantity::Normal));
    if let (Some([tx, ty, tz]), Some([x, y, z])) = normals {
        let mut angles: Vec<f64> = good
            .iter()
            .map(|&k| {
                // The cross product keeps its digits where acos of the dot product has none.
                let (a, b) = ([tx[k], ty[k], tz[k]].map(f64::from), [x[k], y[k], z[k]].map(f64::from));
                let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
                let dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
                cross.iter().map(|v| v * v).sum::<f64>().sqrt().atan2(dot).to_degrees()
            })
            .collect();
        if let (Some(median), Some(p99)) = (median(&mut angles), upper_quantile(&mut angles, 99, 100)) {
            figures.insert("normal_median_error_deg".into(), median);
            figures.insert("normal_p99_error_deg".into(), p99);
        }
    }
    Ok(TruthComparison { errors, figures, pigment: Some(pigment).filter(|p| !p.channels.is_empty()) })
}

/// How σa follows the absorption of the mesophyll in a leaf made of layers, from pairs of absorption and σa: their
/// correlation, and the median of σa over absorption. NaN where there are no pairs.
fn follows(mut pairs: Vec<[f64; 2]>) -> [f64; 2] {
    pairs.retain(|[a, s]| *a > 0.0 && s.is_finite());
    let n = pairs.len() as f64;
    let mean = |k: usize| pairs.iter().map(|p| p[k]).sum::<f64>() / n;
    let means = [mean(0), mean(1)];
    let product = |j: usize, k: usize| pairs.iter().map(|p| (p[j] - means[j]) * (p[k] - means[k])).sum::<f64>();
    let correlation = product(0, 1) / (product(0, 0) * product(1, 1)).sqrt();
    [correlation, median_of(pairs.iter().map(|[a, s]| s / a)).unwrap_or(f64::NAN)]
}

/// A gap of this share of the smallest standard error changes the coverage of a 95 % interval by less than half a per
/// cent.
const GAUGE_SHARE: f64 = 0.2;

/// How far the truth's means over the good texels are from what the fit sets them to.
struct Gauge {
    thickness: f64,
    gamma: f64,
}

impl Gauge {
    fn of(truth: &ChannelMaps, fitted: &LeafSideFit, good: &[usize]) -> Gauge {
        let mean = |quantity: Quantity, c: usize| {
            let map = truth.plane(quantity, c)?;
            Some(good.iter().map(|&k| f64::from(map[k])).sum::<f64>() / good.len().max(1) as f64)
        };
        let sum = fitted.texels.iter().map(|x| x.interior.thickness).sum::<f64>();
        let own = sum / fitted.texels.len().max(1) as f64;
        let thickness = mean(Quantity::Thickness, 0).map_or(0.0, |t| t / own - 1.0);
        let gamma = (0..3).filter_map(|c| mean(Quantity::Gamma, c)).map(|g| g - 1.0);
        Gauge { thickness, gamma: gamma.fold(0.0, |a, g| if g.abs() > f64::abs(a) { g } else { a }) }
    }

    fn gap(&self) -> f64 {
        self.thickness.abs().max(self.gamma.abs())
    }
}

/// The true leaf as the fit's σ maps describe it: σa and σs of every good texel from the texel's true ρd, ρt and
/// thickness. So the maps explain by pigment what the truth may store as an albedo factor γ beside one σa and σs for
/// the whole leaf. NaN elsewhere; no map where the truth lacks a channel.
pub fn pigment(truth: &ChannelMaps, good: &[usize]) -> ChannelMaps {
    let mut out = ChannelMaps::new(truth.width, truth.height);
    let Some(thickness) = truth.scalar(Quantity::Thickness) else { return out };
    let exact = SlabInverter::new(Incidence(1.0));
    for c in 0..3 {
        let (Some(d), Some(t)) = (truth.plane(Quantity::RhoD, c), truth.plane(Quantity::RhoT, c)) else {
            continue;
        };
        let solve =
            |k: &usize| exact.invert(f64::from(d[*k]), f64::from(t[*k]), f64::from(thickness[*k]), [1e-9; 2]).value;
        let found: Vec<[f64; 2]> = good.par_iter().map(solve).collect();
        for (q, quantity) in SIGMA.into_iter().enumerate() {
            let mut plane = vec![f32::NAN; d.len()];
            good.iter().zip(&found).for_each(|(k, s)| plane[*k] = s[q] as f32);
            out.add(quantity, c, plane);
        }
    }
    out
}

/// Relative errors and coverage of one quantity.
#[derive(Default)]
struct Samples {
    relative: Vec<f64>,
    inside: usize,
    judged: usize,
}

impl Samples {
    fn push(&mut self, truth: f32, found: f64, error: f64) {
        let truth = f64::from(truth);
        // Undetermined values (infinite or absent errors) make no claim that could be wrong.
        if !truth.is_finite() || !found.is_finite() || !error.is_finite() {
            return;
        }
        if truth != 0.0 {
            self.relative.push(((found - truth) / truth).abs());
        }
        self.judged += 1;
        // Truth maps and fits are stored in single precision, so its rounding is allowed for.
        self.inside += usize::from((found - truth).abs() <= 1.96 * error + 2.4e-7 * truth.abs());
    }

    fn maps(&mut self, truth: &ChannelMaps, fit: &ChannelMaps, quantity: Quantity, c: usize, good: &[usize]) {
        if let (Some(t), Some(v)) = (truth.plane(quantity, c), fit.plane(quantity, c)) {
            let e = texels::error(fit, quantity, c);
            for &k in good {
                self.push(t[k], f64::from(v[k]), f64::from(e[k]));
            }
        }
    }

    fn store(mut self, into: &mut BTreeMap<String, TruthError>, name: &str) {
        let all = &mut self.relative;
        let (Some(median_relative), Some(p99_relative)) = (median(all), upper_quantile(all, 99, 100)) else { return };
        let coverage95 = Some(self.inside as f64 / self.judged as f64);
        let error = TruthError { median_relative, p99_relative, coverage95, judged: Some(self.judged) };
        into.insert(name.into(), error);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn following_is_a_correlation_and_a_ratio() {
        let line = (1..=5).map(|k| [f64::from(k), 2.3 * f64::from(k)]).collect();
        let [correlation, ratio] = follows(line);
        assert!((correlation - 1.0).abs() < 1e-12 && (ratio - 2.3).abs() < 1e-12);
        // By hand: means 2 and 2, products 1, 2 and 2.
        let [correlation, ratio] = follows(vec![[1.0, 1.0], [2.0, 3.0], [3.0, 2.0], [0.0, 9.0], [1.0, f64::NAN]]);
        assert!((correlation - 0.5).abs() < 1e-12 && (ratio - 1.0).abs() < 1e-12, "{correlation} {ratio}");
        assert!(follows(Vec::new()).iter().all(|x| x.is_nan()));
    }
}
