//! The interior: gauges, the leaf's slab, the slab of each texel, and what the leaf's slab leaves of ρt.

use super::slab::{Slab, Variance};
use super::{CAUSE, CLOSE, Off, Seen, Setup, TEXELS, figure, sample};
use mesophyll_base::rgb::Rgb;
use mesophyll_files::quantity::{Quantity, RGB};
use mesophyll_optics::slab;
use rayon::prelude::*;

pub(super) fn look(seen: &Seen, out: &mut Vec<String>) {
    let (Some(sigma_a), Some(sigma_s), Some(h)) =
        (seen.three(Quantity::SigmaA), seen.three(Quantity::SigmaS), seen.thickness())
    else {
        return;
    };
    let Some(planes) = Planes::of(seen) else { return };
    let slabs = sigma_a.zip(sigma_s, |a, s| Slab::new(a, s, h));
    let leaf = Leaf { seen, planes, sigma_a, sigma_s, slabs, h };
    match seen.setup {
        Setup::Dome => leaf.dome(out),
        Setup::Tube { .. } | Setup::Photo | Setup::Edited if seen.settled() => leaf.gauges(out),
        _ => {}
    }
    leaf.slab(out);
    leaf.pigment(out);
    leaf.residuals(out);
}

struct Planes<'a> {
    thickness: &'a [f32],
    gamma: [&'a [f32]; 3],
    rho_d: [&'a [f32]; 3],
    rho_t: [&'a [f32]; 3],
}

impl<'a> Planes<'a> {
    fn of(seen: &Seen<'a>) -> Option<Planes<'a>> {
        Some(Planes {
            thickness: seen.maps.scalar(Quantity::Thickness)?,
            gamma: seen.maps.three(Quantity::Gamma)?,
            rho_d: seen.maps.three(Quantity::RhoD)?,
            rho_t: seen.maps.three(Quantity::RhoT)?,
        })
    }
}

struct Leaf<'a, 'b> {
    seen: &'b Seen<'a>,
    planes: Planes<'a>,
    sigma_a: Rgb,
    sigma_s: Rgb,
    slabs: Rgb<Slab>,
    /// Mean thickness (mm).
    h: f64,
}

/// Groups of texels of similar thickness in the slab of a dome's leaf (`fit::dome::slab`).
const GROUPS: usize = 48;
/// Share of texels for which the slab's inverse may have found nothing although it should.
const WITHOUT_SLAB: f64 = 1e-3;

impl Leaf<'_, '_> {
    fn mean(&self, of: impl Fn(usize) -> f64) -> f64 {
        self.seen.good.iter().map(|&k| of(k)).sum::<f64>() / self.seen.good.len() as f64
    }

    /// The means of thickness and γ over the good texels are h and 1, but for two things that the maps bound.
    ///
    /// The fit takes the second-order bias of each texel's thickness out of its sums. With v the relative variance of
    /// the thickness and Δ the optical thickness, the bias is at most v(1 + Δ)/2, and that of γ, whose logarithmic
    /// slope by thickness is at most 1, at most v(2 + Δ)/2. And a texel that could not be measured is stood in for by
    /// the mean of a few good ones, which lies between the smallest and the largest of them.
    fn gauges(&self, out: &mut Vec<String>) {
        let seen = self.seen;
        let error = seen.errors.as_ref().and_then(|e| e.scalar(Quantity::Thickness));
        let depth = (0..3).map(|c| self.sigma_a[c] + self.sigma_s[c]).fold(0.0, f64::max);
        let bias = |k: usize| {
            let t = f64::from(self.planes.thickness[k]);
            let v = error.map_or(0.01, |e| (f64::from(e[k]) / t).powi(2));
            // The fit takes no bias out where the variance is larger than this.
            if v < 0.25 { v * (3.0 + depth * t) } else { 0.0 }
        };
        let stand_ins = seen.figure("stand_ins").unwrap_or(0.0) / seen.good.len() as f64;
        let open = seen.figure("gauge_thickness_relative").unwrap_or(0.0).abs();
        let bias = self.mean(bias) + open + CLOSE;
        let spread = |plane: &[f32]| {
            let of = seen.good.iter().map(|&k| f64::from(plane[k]));
            let (low, high) = of.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
            stand_ins * (high - low)
        };
        let (t, allowed) = (self.planes.thickness, bias * self.h + spread(self.planes.thickness));
        let mean = self.mean(|k| f64::from(t[k]));
        // An edit leaves a thousandth of the mean where it takes more than a texel has.
        let cut = seen.setup == Setup::Edited && seen.good.iter().any(|&k| f64::from(t[k]) <= 1.001e-3 * self.h);
        if !((mean - self.h).abs() <= allowed) && !cut {
            out.push(format!(
                "{}: the mean of thickness.Y over the good texels is {} mm, but thickness in fit.toml is {} mm; \
                 {CAUSE}",
                seen.path.display(),
                figure(mean),
                figure(self.h)
            ));
        }
        for c in (0..3).filter(|&c| seen.as_told(c)) {
            let gamma = self.planes.gamma[c];
            let mean = self.mean(|k| f64::from(gamma[k]));
            let allowed = bias * mean.abs().max(1.0) + spread(gamma);
            if !((mean - 1.0).abs() <= allowed) {
                out.push(format!(
                    "{}: the mean of gamma.{} over the good texels is {}, but the gauge of the fit is 1; the map was \
                     changed after the fit",
                    seen.path.display(),
                    RGB[c],
                    figure(mean)
                ));
            }
        }
    }

    /// A dome's thickness is measured, and its slab gives the mean ρd and ρt over groups of texels of similar
    /// thickness.
    fn dome(&self, out: &mut Vec<String>) {
        let (seen, t) = (self.seen, self.planes.thickness);
        let mean = self.mean(|k| f64::from(t[k]));
        if !((mean / self.h - 1.0).abs() <= CLOSE) {
            out.push(format!(
                "{}: the mean of thickness.Y over the good texels is {} mm, but thickness in fit.toml is {} mm; \
                 {CAUSE}",
                seen.path.display(),
                figure(mean),
                figure(self.h)
            ));
        }
        let mut sorted = seen.good.clone();
        sorted.sort_by(|&a, &b| t[a].total_cmp(&t[b]));
        for c in (0..3).filter(|&c| seen.as_told(c) && self.settled(c)) {
            let response = |t: f64| self.slabs[c].at(t);
            let mut sums = [0.0; 2];
            for group in sorted.chunks(sorted.len().div_ceil(GROUPS).max(1)) {
                let n = group.len() as f64;
                let mean = |of: &dyn Fn(usize) -> f64| group.iter().map(|&k| of(k)).sum::<f64>() / n;
                let at = response(mean(&|k| f64::from(t[k])));
                // The map of ρd is cut at zero; γ is not.
                let albedo = |k: usize| f64::from(self.planes.gamma[c][k]) * response(f64::from(t[k])).rho_d;
                let share = n / sorted.len() as f64;
                sums[0] += share * mean(&albedo) / at.rho_d;
                sums[1] += share * mean(&|k| f64::from(self.planes.rho_t[c][k])) / at.rho_t;
            }
            for (what, ratio) in ["gamma", "rho_t"].into_iter().zip(sums) {
                if !((ratio - 1.0).abs() <= 10.0 * CLOSE) {
                    out.push(format!(
                        "{}: {what}.{} is {} times what the slab of fit.toml gives, in the mean over the good texels; \
                         {CAUSE}",
                        seen.path.display(),
                        RGB[c],
                        figure(ratio)
                    ));
                }
            }
        }
    }

    /// Whether the slab of a dome's channel was found.
    fn settled(&self, c: usize) -> bool {
        let open = |q: Quantity| {
            let list = self.seen.param(q).map(|p| p.undetermined.as_slice()).unwrap_or_default();
            list.iter().any(|u| u.starts_with(&q.channel(c)) && !u.contains("relative standard error"))
        };
        !open(Quantity::SigmaA) && !open(Quantity::SigmaS)
    }

    /// ρd is γ times the slab's reflectance; of an edited leaf, ρt is the slab's transmittance.
    fn slab(&self, out: &mut Vec<String>) {
        let seen = self.seen;
        if seen.setup == Setup::Paper {
            return;
        }
        for c in (0..3).filter(|&c| seen.as_told(c)) {
            let off = |k: &usize| {
                let r = self.slabs[c].at(f64::from(self.planes.thickness[*k]));
                let expected = f64::from(self.planes.gamma[c][*k]) * r.rho_d;
                let expected = if seen.setup == Setup::Dome { expected.max(0.0) } else { expected };
                let mut off = [Off::default(), Off::default()];
                off[0].add(*k, f64::from(self.planes.rho_d[c][*k]), expected, CLOSE * expected.abs() + 1e-9);
                if seen.setup == Setup::Edited {
                    off[1].add(*k, f64::from(self.planes.rho_t[c][*k]), r.rho_t, CLOSE * r.rho_t + 1e-9);
                }
                off
            };
            let found = seen
                .good
                .par_iter()
                .map(off)
                .reduce(|| [Off::default(), Off::default()], |[a, b], [x, y]| [a.and(x), b.and(y)]);
            let letter = RGB[c];
            let slab = format!(
                "the slab of fit.toml (sigma_a {}, sigma_s {} 1/mm) at thickness.Y",
                figure(self.sigma_a[c]),
                figure(self.sigma_s[c])
            );
            out.extend(seen.told(
                &found[0],
                &seen.path,
                &format!("rho_d.{letter}"),
                &format!("gamma.{letter} times the reflectance of {slab}"),
            ));
            out.extend(seen.told(
                &found[1],
                &seen.path,
                &format!("rho_t.{letter}"),
                &format!("the transmittance of {slab}"),
            ));
        }
    }

    /// The maps of σa and σs are another description of ρd and ρt, texel by texel.
    fn pigment(&self, out: &mut Vec<String>) {
        let seen = self.seen;
        // An edit changes the leaf's σ and the maps by the same factor, but ρd and ρt by the leaf's slab.
        if seen.setup == Setup::Edited {
            return;
        }
        let (Some(a), Some(s)) = (seen.maps.three(Quantity::SigmaA), seen.maps.three(Quantity::SigmaS)) else { return };
        // Where the light box was seen at an angle, ρt was converted to the normal by the leaf's slab, not the texel's.
        let straight = !matches!(seen.setup, Setup::Tube { straight: false } | Setup::Paper)
            || seen.record.scan.as_ref().is_some_and(|scan| scan.lightbox_camera_deg == 0.0);
        for c in 0..3 {
            let texels: Vec<usize> = sample(&seen.good, TEXELS).collect();
            let off = |k: &usize| {
                let k = *k;
                let [d, t, h] = [self.planes.rho_d[c][k], self.planes.rho_t[c][k], self.planes.thickness[k]];
                let [d, t, h] = [d, t, h].map(f64::from);
                let mut off = [Off::default(), Off::default(), Off::default()];
                // Only these belong to exactly one slab.
                if !(d > 1e-6 && t > 1e-6 && d + t < 1.0 - 1e-5) {
                    return off;
                }
                let r = slab::response(f64::from(a[c][k]), f64::from(s[c][k]), h);
                if !(f64::from(a[c][k]) + f64::from(s[c][k])).is_finite() {
                    off[2].add(k, f64::NAN, 0.0, 0.0);
                    return off;
                }
                off[0].add(k, r.rho_d, d, CLOSE * d);
                if straight {
                    off[1].add(k, r.rho_t, t, CLOSE * t);
                }
                off
            };
            let [by_d, by_t, without] = texels.par_iter().map(off).reduce(
                || [Off::default(), Off::default(), Off::default()],
                |[a, b, c], [x, y, z]| [a.and(x), b.and(y), c.and(z)],
            );
            let letter = RGB[c];
            let of =
                |what: &str| format!("the {what} of the slab of sigma_a.{letter} and sigma_s.{letter} at thickness.Y");
            out.extend(seen.told(&by_d, &seen.path, &of("reflectance"), &format!("rho_d.{letter}")));
            out.extend(seen.told(&by_t, &seen.path, &of("transmittance"), &format!("rho_t.{letter}")));
            if without.count as f64 > WITHOUT_SLAB * texels.len() as f64 {
                out.push(format!(
                    "{}: sigma_a.{letter} or sigma_s.{letter} is no number at {} good texels whose rho_d and rho_t \
                     belong to a slab; the map was changed after the fit",
                    seen.path.display(),
                    without.count
                ));
            }
        }
    }

    /// What the leaf's slab leaves of ρt, against the χ² and the rms of `fit.toml`.
    fn residuals(&self, out: &mut Vec<String>) {
        let seen = self.seen;
        let Some(told) = seen.section.residuals.get("transmittance") else { return };
        let Some(variance) = Variance::of(seen) else { return };
        if !(0..3).all(|c| seen.as_told(c)) {
            return;
        }
        // Σ (ρt − T)²/variance, Σ (ρt − T)², and what rounding may add to each texel of both.
        let zero = [0.0; 4];
        let sums = seen
            .good
            .par_iter()
            .map(|&k| {
                (0..3).fold(zero, |mut sum, c| {
                    let model = self.slabs[c].at(f64::from(self.planes.thickness[k])).rho_t;
                    let off = f64::from(self.planes.rho_t[c][k]) - model;
                    let depth = (self.sigma_a[c] + self.sigma_s[c]) * f64::from(self.planes.thickness[k]);
                    let rounding = 2e-7 * (1.0 + depth) * model;
                    let variance = variance.at(c, k, model);
                    sum[0] += off * off / variance;
                    sum[1] += off * off;
                    sum[2] += rounding * rounding / variance;
                    sum[3] += rounding * rounding;
                    sum
                })
            })
            .reduce(|| zero, |a, b| std::array::from_fn(|i| a[i] + b[i]));
        let readings = (3 * seen.good.len()) as f64;
        // A sum of squares of x + r is at most (√Σx² + √Σr²)².
        let apart = |a: f64, b: f64, rounding: f64, share: f64| {
            !((a.sqrt() - b.sqrt()).abs() <= share * b.sqrt() + 2.0 * rounding.sqrt())
        };
        let texels = "the slab of fit.toml at thickness.Y leaves of rho_t";
        if apart(sums[0], told.chi2, sums[2], 0.05) {
            out.push(format!(
                "{}: {texels}, in units of the errors in {}, is a χ² of {}, but residuals.transmittance.chi2 in \
                 fit.toml is {}; the errors of rho_t, a map or fit.toml were changed after the fit",
                seen.path.display(),
                seen.errors_path.display(),
                figure(sums[0]),
                figure(told.chi2)
            ));
        }
        let rms = match seen.setup {
            Setup::Tube { .. } => told.rms,
            _ => return,
        };
        if apart(sums[1] / readings, rms * rms, sums[3] / readings, 1e-3) {
            out.push(format!(
                "{}: {texels} is {} (rms), but residuals.transmittance.rms in fit.toml is {}; {CAUSE}",
                seen.path.display(),
                figure((sums[1] / readings).sqrt()),
                figure(rms)
            ));
        }
    }
}
