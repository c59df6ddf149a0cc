//! σa and σs of a leaf whose thickness was measured. One slab a channel is found that gives the leaf's mean albedo ρd
//! and mean transmittance ρt at the leaf's own thicknesses h(x).
//!
//! Two equations determine the two unknowns of a channel. Over the good texels, the mean of ρd/ρd(σ, h(x)) is 1 (so
//! that the mean of γ is 1), and the mean of ρt/ρt(σ, h(x)) is 1. Texels of similar thickness are grouped first. The
//! standard errors add three parts: the noise of the two means, the error of the highlight that was subtracted from all
//! texels, and the error of the caliper (σ is inversely proportional to the thickness).

use mesophyll_base::solvers::Termination;
use mesophyll_base::solvers::damping::{self, DampedProblem, DampingControl, newton_step};
use mesophyll_optics::slab::inverse;
use mesophyll_optics::slab::response_with_partials;

/// What one texel shows in one channel.
#[derive(Debug, Clone, Copy, Default)]
pub struct DomeTexel {
    pub thickness: f64,
    pub rho_d: f64,
    pub rho_t: f64,
    pub rho_d_err: f64,
    pub rho_t_err: f64,
}

/// Errors that all texels of a side share.
#[derive(Debug, Clone, Copy)]
pub struct DomeSharedErrors {
    /// Standard error of ρd, absolute.
    pub rho_d: f64,
    /// Standard error of the thickness, relative to it.
    pub thickness: f64,
}

/// The slab of a channel (1/mm), with standard errors. `undetermined` says why the numbers cannot be relied on, if so.
#[derive(Debug, Clone, PartialEq)]
pub struct DomeSlabFit {
    pub sigma_a: [f64; 2],
    pub sigma_s: [f64; 2],
    pub undetermined: Vec<String>,
}

const GROUPS: usize = 48;

/// Fits one channel. `letter` names the channel in the message of `undetermined`.
pub fn fit(texels: &[DomeTexel], shared: DomeSharedErrors, letter: &str) -> DomeSlabFit {
    let groups = groups(texels);
    let n = texels.len().max(1) as f64;
    let mean = |f: &dyn Fn(&DomeTexel) -> f64| texels.iter().map(f).sum::<f64>() / n;
    let (rho_d, rho_t, h) = (mean(&|t| t.rho_d), mean(&|t| t.rho_t), mean(&|t| t.thickness));
    let own = |f: &dyn Fn(&DomeTexel) -> f64| (mean(&|t| f(t).powi(2)) / n).sqrt();
    let start = inverse::invert(rho_d, rho_t, h, own(&|t| t.rho_d_err).hypot(shared.rho_d), own(&|t| t.rho_t_err));
    let mut undetermined = Vec::new();
    let x = [start.sigma_a, start.sigma_s];
    if !x.iter().all(|v| *v > 0.0 && v.is_finite()) {
        for name in ["sigma_a", "sigma_s"] {
            undetermined
                .push(format!("{name}.{letter}: no slab has this albedo ({rho_d:.4}) and transmittance ({rho_t:.4})"));
        }
        return DomeSlabFit { sigma_a: [x[0], f64::INFINITY], sigma_s: [x[1], f64::INFINITY], undetermined };
    }
    let start_at = At::new(&groups, x);
    let (At { x, .. }, end) = damping::minimize(&mut Leaf(&groups), start_at, &DampingControl::HALVED);
    let settled = end.converged();
    // Where the search did not settle, its end says nothing of an error.
    let error = |value: f64, of_mean: f64, at: f64| {
        if settled { value * (of_mean / at).hypot(shared.thickness) } else { f64::INFINITY }
    };
    let (a, s) = (error(x[0], start.sigma_a_err, start.sigma_a), error(x[1], start.sigma_s_err, start.sigma_s));
    for (name, value, err) in [("sigma_a", x[0], a), ("sigma_s", x[1], s)] {
        if !settled {
            undetermined.push(format!(
                "{name}.{letter}: the slab of the mean texel does not settle over the leaf's thicknesses"
            ));
        } else if !(err <= 0.1 * value) {
            undetermined.push(format!("{name}.{letter}: relative standard error {:.2}", err / value));
        }
    }
    DomeSlabFit { sigma_a: [x[0], a], sigma_s: [x[1], s], undetermined }
}

/// Groups of texels of similar thickness: their share of the leaf, thickness, ρd and ρt.
struct Leaf<'a>(&'a [(f64, f64, f64, f64)]);

/// The residuals mean ρd/ρd(σ) − 1 and mean ρt/ρt(σ) − 1, and their derivatives by ln σa and ln σs.
struct At {
    x: [f64; 2],
    f: [f64; 2],
    j: [[f64; 2]; 2],
}

impl At {
    fn new(groups: &[(f64, f64, f64, f64)], x: [f64; 2]) -> At {
        let (mut f, mut j) = ([-1.0, -1.0], [[0.0; 2]; 2]);
        for &(share, h, d, t) in groups {
            let (r, p) = response_with_partials(x[0], x[1], h);
            let (ratio_d, ratio_t) = (share * d / r.rho_d, share * t / r.rho_t);
            f[0] += ratio_d;
            f[1] += ratio_t;
            for (k, by) in [p.sigma_a, p.sigma_s].into_iter().enumerate() {
                j[0][k] -= ratio_d * x[k] * by.rho_d / r.rho_d;
                j[1][k] -= ratio_t * x[k] * by.rho_t / r.rho_t;
            }
        }
        At { x, f, j }
    }
}

/// Newton's method in ln σa and ln σs.
impl DampedProblem for Leaf<'_> {
    type Point = At;
    type Step = [f64; 2];

    /// Limits a step to a factor of e.
    fn step(&mut self, at: &At, _: f64) -> Option<[f64; 2]> {
        let step = newton_step(&at.j, at.f).map(|s| s.clamp(-1.0, 1.0));
        step.iter().all(|s| s.is_finite()).then_some(step)
    }

    fn end(&mut self, at: &mut At, step: &[f64; 2]) -> Option<Termination> {
        let small = step.iter().all(|s| s.abs() < 1e-12);
        if small {
            at.x = moved(at.x, step, 1.0);
        }
        small.then_some(Termination::StepSmall)
    }

    fn take(&mut self, at: &At, step: &[f64; 2], share: f64) -> At {
        At::new(self.0, moved(at.x, step, share))
    }

    /// Every step is kept: the residuals are close to linear in the logarithms, and the length of a step is limited.
    fn better(&self, _: &At, _: &At) -> bool {
        true
    }
}

fn moved(x: [f64; 2], step: &[f64; 2], share: f64) -> [f64; 2] {
    [x[0] * (-share * step[0]).exp(), x[1] * (-share * step[1]).exp()]
}

/// The groups of texels of similar thickness.
fn groups(texels: &[DomeTexel]) -> Vec<(f64, f64, f64, f64)> {
    let mut sorted: Vec<&DomeTexel> = texels.iter().collect();
    sorted.sort_unstable_by(|a, b| a.thickness.total_cmp(&b.thickness));
    sorted
        .chunks(texels.len().div_ceil(GROUPS).max(1))
        .map(|g| {
            let n = g.len() as f64;
            let mean = |f: &dyn Fn(&DomeTexel) -> f64| g.iter().map(|t| f(t)).sum::<f64>() / n;
            (n / texels.len() as f64, mean(&|t| t.thickness), mean(&|t| t.rho_d), mean(&|t| t.rho_t))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_optics::slab::medium::response;

    #[test]
    fn the_slab_comes_back_from_a_leaf_of_many_thicknesses() {
        let texels: Vec<DomeTexel> = (0..2000)
            .map(|k| {
                let h = 0.12 + 0.3 * (f64::from(k) / 2000.0).powi(3);
                let r = response(4.0, 12.0, h);
                // The albedo factors have the mean 1, so they do not change the slab.
                let gamma = 1.0 + 0.2 * (0.7 * f64::from(k)).sin();
                DomeTexel { thickness: h, rho_d: gamma * r.rho_d, rho_t: r.rho_t, rho_d_err: 1e-3, rho_t_err: 1e-3 }
            })
            .collect();
        let slab = fit(&texels, DomeSharedErrors { rho_d: 0.0, thickness: 0.0 }, "G");
        assert!(slab.undetermined.is_empty(), "{slab:?}");
        assert!((slab.sigma_a[0] / 4.0 - 1.0).abs() < 3e-3 && (slab.sigma_s[0] / 12.0 - 1.0).abs() < 3e-3, "{slab:?}");
        // The mean of γ is 1 by construction.
        let gamma =
            texels.iter().map(|t| t.rho_d / response(slab.sigma_a[0], slab.sigma_s[0], t.thickness).rho_d).sum::<f64>()
                / 2000.0;
        assert!((gamma - 1.0).abs() < 1e-3, "{gamma}");
        // A caliper error of 3 % shows in both standard errors.
        let slab = fit(&texels, DomeSharedErrors { rho_d: 0.0, thickness: 0.03 }, "G");
        assert!(slab.sigma_a[1] / slab.sigma_a[0] >= 0.03 && slab.sigma_s[1] / slab.sigma_s[0] >= 0.03);
    }

    #[test]
    fn what_no_slab_does_is_said() {
        let texels = [DomeTexel { thickness: 0.2, rho_d: 0.7, rho_t: 0.6, rho_d_err: 1e-3, rho_t_err: 1e-3 }; 9];
        assert!(!fit(&texels, DomeSharedErrors { rho_d: 0.0, thickness: 0.0 }, "R").undetermined.is_empty());
    }
}
