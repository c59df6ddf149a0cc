//! The paper's reduction (W §3, "Fitting BRDF and BTDF"). It solves σa and σs at every texel with the mean thickness h
//! and averages them over the leaf. Then it finds γ and δ from Eq. 5, with A and B frozen at the averages.
//!
//! It is kept by name (`--method paper`) so that both reductions can be reported. With B frozen, Eq. 5 takes the
//! logarithm of a negative number wherever ρt falls below B ω/2. Such texels get no δ and are counted.

use crate::leaf::leaf_wide::LeafWideTexel;
use mesophyll_base::rgb::Rgb;
use mesophyll_optics::slab;

/// What the paper's reduction finds.
#[derive(Debug, Clone)]
pub struct PaperReduction {
    pub sigma_a: Rgb,
    pub sigma_s: Rgb,
    /// Standard error of each mean (scatter / √n).
    pub sigma_a_err: Rgb,
    pub sigma_s_err: Rgb,
    /// h + δ (mm); NaN where Eq. 5 has no solution in any channel.
    pub thickness: Vec<f64>,
    pub gamma: Vec<Rgb>,
    /// Texels for which the logarithm's argument is negative in at least one channel.
    pub negative_logarithms: usize,
    pub b_omega_half: Rgb,
}

/// Averages per-texel `(σa, σs)` (NaN where a texel's slab is not determined) and applies Eq. 5.
pub fn reduce(texels: &[LeafWideTexel], sigma: &[Rgb<[f64; 2]>], h: f64) -> PaperReduction {
    let mean = |c: usize, k: usize| {
        let values: Vec<f64> = sigma.iter().map(|s| s[c][k]).filter(|v| v.is_finite()).collect();
        let n = values.len() as f64;
        let m = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - m).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        (m, (variance / n).sqrt())
    };
    let [(sigma_a, sigma_a_err), (sigma_s, sigma_s_err)] = [0, 1].map(|k| Rgb::of(|c| mean(c, k)).unzip());
    let sigma_t = sigma_a + sigma_s;
    // A ω/2 and B ω/2 of the average leaf
    let (a_half, b_half) = Rgb::of(|c| {
        if !sigma_t[c].is_finite() {
            return (0.0, 0.0);
        }
        let r = slab::response(sigma_a[c], sigma_s[c], h);
        (r.rho_d, r.rho_t - (-sigma_t[c] * h).exp())
    })
    .unzip();
    let mut negative = 0;
    let mut thickness = Vec::with_capacity(texels.len());
    let mut gamma = Vec::with_capacity(texels.len());
    for x in texels {
        let solved: Vec<f64> = (0..3)
            .filter_map(|c| {
                let argument = x.rho_t[c] - b_half[c];
                (argument > 0.0).then(|| -argument.ln() / sigma_t[c])
            })
            .filter(|t| t.is_finite())
            .collect();
        negative += usize::from(solved.len() < 3);
        thickness.push(if solved.is_empty() { f64::NAN } else { solved.iter().sum::<f64>() / solved.len() as f64 });
        gamma.push(x.rho_d / a_half);
    }
    PaperReduction {
        sigma_a,
        sigma_s,
        sigma_a_err,
        sigma_s_err,
        thickness,
        gamma,
        negative_logarithms: negative,
        b_omega_half: b_half,
    }
}

/// Transmittance that Eq. 5 gives for a thickness, with B frozen.
pub fn transmittance(paper: &PaperReduction, thickness: f64) -> Rgb {
    (paper.sigma_a + paper.sigma_s).map(|s| (-s * thickness).exp()) + paper.b_omega_half
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uniform_leaf_is_its_own_average_and_dark_veins_have_no_logarithm() {
        let (sa, ss, h) = ([9.0, 2.6, 22.0], [18.0, 16.0, 21.0], 0.2);
        let texel = |t: f64| {
            let r = Rgb::of(|c| slab::response(sa[c], ss[c], t));
            LeafWideTexel {
                rho_d: r.map(|r| r.rho_d),
                rho_d_err: Rgb::splat(1e-4),
                rho_t: r.map(|r| r.rho_t),
                rho_t_floor: Rgb::splat(1e-9),
                ..LeafWideTexel::default()
            }
        };
        let sigma = Rgb::of(|c| [sa[c], ss[c]]);
        let paper = reduce(&[texel(h), texel(h), texel(2.5 * h)], &[sigma, sigma, sigma], h);
        assert!((paper.thickness[0] - h).abs() < 1e-9 && (paper.gamma[0][1] - 1.0).abs() < 1e-9);
        assert_eq!(paper.negative_logarithms, 1);
        assert!(paper.thickness[2].is_nan());
    }
}
