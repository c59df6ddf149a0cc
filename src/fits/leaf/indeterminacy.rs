//! What the measurements of a leaf leave open beyond their stated noise: a tilt that no pass shows, reflectances at
//! their bound, traces that no texel model explains, and the bounds of channels whose σa or σs is not determined.

use super::leaf_wide::{LeafSharedErrors, LeafWideTexel};
use super::texels;
use crate::leaf::noise::CameraNoise;
use mesophyll_base::rgb::Rgb;
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::slab::inverse::{self, SlabEstimate};

/// Standard deviation (rad) assumed for the tilt out of the plane of travel, which a single pass cannot see. It is
/// added to the tilt seen in the plane.
pub const UNSEEN: f64 = 0.1;
/// Where the misfit is larger than this share of the value, no parameter is determined within the promised 10 %.
const MISFIT: f64 = 0.1;

/// Relative error that the unseen tilts of a one-pass scan give to all ρd together. Under a tube a texel tilted by t
/// looks darker by cos t, that is by about t²/2. The mean of this over the leaf is not noise.
pub fn unseen_tilt(maps: &ChannelMaps, good: &[u32]) -> f64 {
    let x = maps.plane(Quantity::Normal, 0).unwrap_or(&[]);
    let seen = good.iter().map(|&k| f64::from(x[k as usize]).powi(2)).sum::<f64>() / good.len().max(1) as f64;
    0.5 * (seen + UNSEEN * UNSEEN)
}

/// Errors that all ρd share. `unseen` is the result of [`unseen_tilt`]; it is zero with two passes.
pub fn common(texels: &[LeafWideTexel], unseen: f64) -> LeafSharedErrors {
    // ρd is never negative. Near zero this raises its mean, at zero by 0.4 of its error. With z = μ/error the rise is
    // E[max(0, x)] − μ = φ(z) − z Q(z) errors. Here a rational approximation is used, which is exact in value and slope
    // at 0, and for large z.
    let lift = |z: f64| 0.398_942_28 * (-0.5 * z * z).exp() / (1.0 + 1.253_314_1 * z + z * z);
    let own = Rgb::of(|c| {
        let sum: f64 = texels.iter().map(|x| x.rho_d[c]).sum();
        let lifted: f64 = texels
            .iter()
            .filter(|x| x.rho_d_err[c] > 0.0)
            .map(|x| x.rho_d_err[c] * lift(x.rho_d[c] / x.rho_d_err[c]))
            .sum();
        if sum > 0.0 { lifted / sum } else { f64::INFINITY }
    });
    // Infinity would mean that there is no reflectance at all; the covariance needs a finite number.
    LeafSharedErrors { shared: unseen, own: own.map(|o| o.min(1e3)) }
}

/// Reduced χ² of the median texel, where the traces differ from the model by more than noise can explain and by more
/// than a tenth of the value.
pub fn unexplained(maps: &ChannelMaps, good: &[u32], level: &CameraNoise) -> Option<f64> {
    let (chi2, freedom) = texels::chi2(maps);
    let mut reduced: Vec<(f64, f64)> = good
        .iter()
        .map(|&k| (f64::from(chi2[k as usize]), f64::from(freedom[k as usize])))
        .filter(|(_, f)| *f > 0.0)
        .map(|(c, f)| (c / f, f))
        .collect();
    reduced.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let &(median, freedom) = reduced.get(reduced.len() / 2)?;
    (median > 1.0 + 8.0 * (2.0 / freedom).sqrt() && median.sqrt() * level.relative > MISFIT).then_some(median)
}

/// The slab of the mean texel of channel `c`; its errors are those of the mean.
pub fn mean_texel(
    texels: &[LeafWideTexel],
    c: usize,
    h: f64,
    rho_t_err: impl Fn(&LeafWideTexel, usize) -> f64,
    common: &LeafSharedErrors,
) -> SlabEstimate {
    let n = texels.len().max(1) as f64;
    let mean = |f: &dyn Fn(&LeafWideTexel) -> f64| texels.iter().map(f).sum::<f64>() / n;
    let (d, t) = (mean(&|x| x.rho_d[c]), mean(&|x| x.rho_t[c]));
    let d_err = mean(&|x| x.rho_d_err[c].powi(2)) / n;
    let t_err = mean(&|x| rho_t_err(x, c).powi(2)) / n;
    // Where thickness varies over the leaf, the mean texel belongs to a different slab than the leaf. So the scatter
    // counts in full.
    let scatter = mean(&|x| (x.rho_t[c] - t).powi(2)) / n;
    inverse::invert(
        d,
        t,
        h,
        (d_err + (d * common.shared.hypot(common.own[c])).powi(2)).sqrt().min(1.0),
        (t_err + scatter).sqrt(),
    )
}

/// Whether everything that came through channel `c` of the whole leaf may be noise: its mean is less than
/// [`inverse::OPAQUE`] of its standard errors.
pub fn opaque(texels: &[LeafWideTexel], c: usize, rho_t_err: impl Fn(&LeafWideTexel, usize) -> f64) -> bool {
    let sum: f64 = texels.iter().map(|x| x.rho_t[c]).sum();
    let variance: f64 = texels.iter().map(|x| rho_t_err(x, c).powi(2)).sum();
    sum < inverse::OPAQUE * variance.sqrt()
}

/// Relative errors of σa and σs in a channel that may be opaque: those of the mean texel's slab, which are infinite
/// only where nothing limits a coefficient.
pub fn relative(mean: &SlabEstimate) -> [f64; 2] {
    let share = [mean.sigma_a_err / mean.sigma_a, mean.sigma_s_err / mean.sigma_s];
    share.map(|share| if share.is_nan() { f64::INFINITY } else { share })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reflectances_at_their_bound_are_lifted_by_as_much_as_is_said() {
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_pcg::Pcg64::seed_from_u64(9);
        let mut normal = || {
            let (a, b): (f64, f64) = (rng.random(), rng.random());
            (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
        };
        // A truly black leaf: after the cut at zero its mean is all due to the cut, and the stated common error must be
        // about that large.
        let texels: Vec<LeafWideTexel> = (0..20_000)
            .map(|_| LeafWideTexel {
                rho_d: Rgb::splat(normal().max(0.0) * 1e-3),
                rho_d_err: Rgb::splat(1e-3),
                rho_t: Rgb([0.2 + 1e-3 * normal(), 1e-4 * normal(), 1.0]),
                rho_t_floor: Rgb::splat(1e-4),
                ..LeafWideTexel::default()
            })
            .collect();
        let own = common(&texels, 0.0).own[0];
        assert!((0.5..1.5).contains(&own), "{own}");
        // Well above zero the cut has no effect.
        let bright: Vec<LeafWideTexel> = texels.iter().map(|x| LeafWideTexel { rho_d: x.rho_d + 0.01, ..*x }).collect();
        assert!(common(&bright, 0.0).own[0] < 1e-6);
        assert!(opaque(&texels, 1, |_, _| 1e-4) && !opaque(&texels, 0, |_, _| 1e-3));
    }
}
