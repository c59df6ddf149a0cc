//! Standard errors of texels, against those that they follow from.

use super::slab::{At, Slab, Variance};
use super::{Off, Seen, Setup, TEXELS, sample};
use mesophyll_base::rgb::Rgb;
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::quantity::{Quantity, RGB};
use mesophyll_optics::slab::response_with_partials;
use rayon::prelude::*;

/// Relative difference of a standard error from what it follows from: single precision and the slab's curve, through
/// second differences of the variance.
const SAME: f64 = 0.02;

pub(super) fn look(seen: &Seen, out: &mut Vec<String>) {
    let Some(errors) = &seen.errors else { return };
    match seen.setup {
        Setup::Tube { straight: true } | Setup::Photo if (0..3).all(|c| seen.as_told(c)) => {
            if let Some(chain) = Chain::of(seen, errors) {
                chain.look(out);
            }
        }
        Setup::Dome => dome(seen, errors, out),
        _ => {}
    }
}

/// The errors of thickness, γ, σa and σs of a leaf whose thickness follows from its ρt.
struct Chain<'a, 'b> {
    seen: &'b Seen<'a>,
    variance: Variance<'b>,
    slabs: Rgb<Slab>,
    /// Relative error of the mean thickness.
    caliper: f64,
    thickness: &'b [f32],
    gamma: [&'b [f32]; 3],
    sigma: [[&'b [f32]; 3]; 2],
    of_thickness: &'b [f32],
    of_gamma: [&'b [f32]; 3],
    of_rho_d: [&'b [f32]; 3],
    of_rho_t: [&'b [f32]; 3],
    of_sigma: [[&'b [f32]; 3]; 2],
}

/// One texel's slabs: the leaf's at its thickness, and the relative variance of the thickness that ρt leaves.
struct Texel {
    leaf: Rgb<At>,
    weight: Rgb,
    spread: f64,
}

impl<'a, 'b> Chain<'a, 'b> {
    fn of(seen: &'b Seen<'a>, errors: &'b ChannelMaps) -> Option<Chain<'a, 'b>> {
        let sigma = |maps: &'b ChannelMaps| Some([maps.three(Quantity::SigmaA)?, maps.three(Quantity::SigmaS)?]);
        let (a, s, h) = (seen.three(Quantity::SigmaA)?, seen.three(Quantity::SigmaS)?, seen.thickness()?);
        Some(Chain {
            seen,
            variance: Variance::of(seen)?,
            slabs: a.zip(s, |a, s| Slab::new(a, s, h)),
            caliper: seen.param(Quantity::Thickness)?.stderr.first()? / h,
            thickness: seen.maps.scalar(Quantity::Thickness)?,
            gamma: seen.maps.three(Quantity::Gamma)?,
            sigma: sigma(seen.maps)?,
            of_thickness: errors.scalar(Quantity::Thickness)?,
            of_gamma: errors.three(Quantity::Gamma)?,
            of_rho_d: errors.three(Quantity::RhoD)?,
            of_rho_t: errors.three(Quantity::RhoT)?,
            of_sigma: sigma(errors)?,
        })
    }

    fn look(&self, out: &mut Vec<String>) {
        let seen = self.seen;
        let texels: Vec<usize> = sample(&seen.good, TEXELS).collect();
        let none = || vec![Off::default(); 10];
        let some = |part: &[usize]| {
            let mut off = none();
            part.iter().for_each(|&k| self.texel(k, &mut off));
            off
        };
        let both = |a: Vec<Off>, b: Vec<Off>| -> Vec<Off> { a.into_iter().zip(b).map(|(x, y)| x.and(y)).collect() };
        let all = texels.par_chunks(4096).map(some).reduce(none, both);
        let names = std::iter::once("thickness.Y".to_string())
            .chain([Quantity::Gamma, Quantity::SigmaA, Quantity::SigmaS].iter().flat_map(|q| q.channels()));
        for (off, name) in all.iter().zip(names) {
            let what = format!("the error of {name}");
            let by = "what the errors of rho_d and rho_t in this file give for it";
            out.extend(seen.told(off, &seen.errors_path, &what, by));
        }
    }

    /// Thickness, then γ, σa and σs a channel each.
    fn texel(&self, k: usize, out: &mut [Off]) {
        let t = f64::from(self.thickness[k]);
        let leaf = Rgb::of(|c| self.slabs[c].at(t));
        let weight = Rgb::of(|c| 1.0 / self.variance.at(c, k, leaf[c].rho_t));
        // Three transmittances of one thickness: the inverse variances of ln t add up.
        let information: f64 = (0..3).map(|c| weight[c] * (leaf[c].rho_t * leaf[c].slope_t).powi(2)).sum();
        let at = Texel { leaf, weight, spread: 1.0 / information };
        let found = f64::from(self.of_thickness[k]);
        let caliper = match self.seen.setup {
            // The error of the stated thickness is part of that of each texel of photographs.
            Setup::Photo => self.caliper,
            _ => 0.0,
        };
        let expected = t * at.spread.sqrt().hypot(caliper);
        // An error as large as the value itself says that nothing is known, and how large it is does not matter.
        if at.spread < 1.0 {
            out[0].add(k, found, expected, SAME * expected);
        }
        for c in 0..3 {
            self.gamma(k, c, &at, &mut out[1 + c]);
            if matches!(self.seen.setup, Setup::Tube { .. }) {
                self.sigma(k, c, &at, out);
            }
        }
    }

    /// γ = ρd/R(t): the error of ρd, and that of the thickness through the slope of ln R. A dark frame that was taken
    /// off both ρd and ρt makes the two depend on each other by as much as their product at most.
    fn gamma(&self, k: usize, c: usize, at: &Texel, off: &mut Off) {
        let r = at.leaf[c];
        let own = f64::from(self.of_rho_d[c][k]) / r.rho_d;
        let by_thickness = (f64::from(self.gamma[c][k]) * r.slope_d).abs() * at.spread.sqrt();
        let most = (own + by_thickness) * (1.0 + SAME);
        let least = match self.seen.setup {
            // What photographs share is part of the error of ρd and not of γ, whose mean is 1.
            Setup::Photo => 0.0,
            _ => (own - by_thickness).abs() * (1.0 - SAME),
        };
        let found = f64::from(self.of_gamma[c][k]);
        if at.spread < 1.0 && own.is_finite() && found.is_finite() {
            off.within(k, found, least, most);
        }
    }

    /// dσ = ∂σ/∂ρd dρd + ∂σ/∂ρt dρt − σ d ln t (`leaf::slabmaps`), with the same bound on what a dark frame does.
    fn sigma(&self, k: usize, c: usize, at: &Texel, out: &mut [Off]) {
        let t = f64::from(self.thickness[k]);
        let value = [0, 1].map(|q: usize| f64::from(self.sigma[q][c][k]));
        let (_, p) = response_with_partials(value[0], value[1], t);
        let det = p.sigma_a.rho_d * p.sigma_s.rho_t - p.sigma_s.rho_d * p.sigma_a.rho_t;
        let by = [[p.sigma_s.rho_t / det, -p.sigma_s.rho_d / det], [-p.sigma_a.rho_t / det, p.sigma_a.rho_d / det]];
        let [d, e] = [self.of_rho_d[c][k], self.of_rho_t[c][k]].map(f64::from);
        let pull = at.weight[c] * at.leaf[c].rho_t * at.leaf[c].slope_t * at.spread;
        let others = (at.spread - (pull * e).powi(2)).max(0.0);
        for q in 0..2 {
            let found = f64::from(self.of_sigma[q][c][k]);
            let own = by[q][0] * d;
            let through = (by[q][1] - value[q] * pull) * e;
            let rest = value[q] * value[q] * others;
            let most = ((own.abs() + through.abs()).powi(2) + rest).sqrt();
            let least = ((own.abs() - through.abs()).powi(2) + rest).sqrt();
            // The error of a texel that the slab's inverse calls undetermined is the width of its range.
            let determined = found <= 0.05 * value[q] && most <= 0.05 * value[q];
            if (determined || found < 0.5 * least) && most.is_finite() && found.is_finite() && value[q] > 0.0 {
                // The bound loses digits where both parts nearly cancel.
                out[4 + 3 * q + c].within(k, found, least * (1.0 - SAME) - 1e-3 * most, most * (1.0 + SAME));
            }
        }
    }
}

/// A dome's errors are the sums that `fit.toml` names.
fn dome(seen: &Seen, errors: &ChannelMaps, out: &mut Vec<String>) {
    let texels: Vec<usize> = seen.good.clone();
    let mut same = |quantity: Quantity, c: usize, expected: &dyn Fn(usize) -> f64, by: &str| {
        let Some(plane) = errors.plane(quantity, c) else { return };
        let mut off = Off::default();
        for &k in &texels {
            let (found, expected) = (f64::from(plane[k]), expected(k));
            if expected.is_finite() {
                off.add(k, found, expected, SAME * expected);
            }
        }
        out.extend(seen.told(&off, &seen.errors_path, &format!("the error of {}", quantity.channel(c)), by));
    };
    let caliper = seen.param(Quantity::Thickness).and_then(|p| p.stderr.first()).copied();
    if let (Some(own), Some(caliper)) = (seen.figure("thickness_error_mm"), caliper) {
        same(Quantity::Thickness, 0, &|_| own.hypot(caliper), "figures.thickness_error_mm and the error of thickness");
    }
    if let Some(slope) = seen.figure("slope_error") {
        for c in 0..3 {
            same(Quantity::Normal, c, &|_| slope, "figures.slope_error in fit.toml");
        }
    }
    let (Some(sigma_a), Some(sigma_s)) = (seen.three(Quantity::SigmaA), seen.three(Quantity::SigmaS)) else { return };
    let (Some(shared), Some(t)) = (seen.figure("highlight_stderr"), seen.maps.scalar(Quantity::Thickness)) else {
        return;
    };
    for c in 0..3 {
        let Some(of_gamma) = errors.plane(Quantity::Gamma, c) else { return };
        let own = |k: usize| {
            let r = mesophyll_optics::slab::response(sigma_a[c], sigma_s[c], f64::from(t[k])).rho_d;
            (f64::from(of_gamma[k]) * r).hypot(shared)
        };
        let by = format!("that of gamma.{} with figures.highlight_stderr", RGB[c]);
        same(Quantity::RhoD, c, &own, &by);
    }
}
