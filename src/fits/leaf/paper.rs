//! The paper's reduction (W §3, "Fitting BRDF and BTDF"). It solves σa and σs at every texel with the mean thickness h
//! and averages them over the leaf. Then it finds γ and δ from Eq. 5, with A and B frozen at the averages.
//!
//! It is kept by name (`--method paper`) so that both reductions can be reported. With B frozen, Eq. 5 takes the
//! logarithm of a negative number wherever ρt falls below B ω/2. Such texels get no δ and are counted.

use crate::leaf::leaf_wide::LeafWideTexel;
use mesophyll_optics::slab;

/// What the paper's reduction finds.
#[derive(Debug, Clone)]
pub struct PaperReduction {
    pub sigma_a: [f64; 3],
    pub sigma_s: [f64; 3],
    /// Standard error of each mean (scatter / √n).
    pub sigma_a_err: [f64; 3],
    pub sigma_s_err: [f64; 3],
    /// h + δ (mm); NaN where Eq. 5 has no solution in any channel.
    pub thickness: Vec<f64>,
    pub gamma: Vec<[f64; 3]>,
    /// Texels for which the logarithm's argument is negative in at least one channel.
    pub negative_logarithms: usize,
    pub b_omega_half: [f64; 3],
}

/// Averages per-texel `(σa, σs)` (NaN where a texel's slab is not determined) and applies Eq. 5.
pub fn reduce(texels: &[LeafWideTexel], sigma: &[[[f64; 2]; 3]], h: f64) -> PaperReduction {
    let mut mean = [[0.0; 2]; 3];
    let mut err = [[f64::INFINITY; 2]; 3];
    for c in 0..3 {
        for k in 0..2 {
            let values: Vec<f64> = sigma.iter().map(|s| s[c][k]).filter(|v| v.is_finite()).collect();
            let n = values.len() as f64;
            let m = values.iter().sum::<f64>() / n;
            let variance = values.iter().map(|v| (v - m).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
            mean[c][k] = m;
            err[c][k] = (variance / n).sqrt();
        }
    }
    let (mut a_half, mut b_half, mut sigma_t) = ([0.0; 3], [0.0; 3], [0.0; 3]);
    for c in 0..3 {
        let [sa, ss] = mean[c];
        sigma_t[c] = sa + ss;
        if sigma_t[c].is_finite() {
            let r = slab::response(sa, ss, h);
            // A ω/2 and B ω/2 of the average leaf
            a_half[c] = r.rho_d;
            b_half[c] = r.rho_t - (-sigma_t[c] * h).exp();
        }
    }
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
        gamma.push([0, 1, 2].map(|c: usize| x.rho_d[c] / a_half[c]));
    }
    PaperReduction {
        sigma_a: [0, 1, 2].map(|c: usize| mean[c][0]),
        sigma_s: [0, 1, 2].map(|c: usize| mean[c][1]),
        sigma_a_err: [0, 1, 2].map(|c: usize| err[c][0]),
        sigma_s_err: [0, 1, 2].map(|c: usize| err[c][1]),
        thickness,
        gamma,
        negative_logarithms: negative,
        b_omega_half: b_half,
    }
}

/// Transmittance that Eq. 5 gives for a thickness, with B frozen.
pub fn transmittance(paper: &PaperReduction, thickness: f64) -> [f64; 3] {
    [0, 1, 2].map(|c: usize| (-(paper.sigma_a[c] + paper.sigma_s[c]) * thickness).exp() + paper.b_omega_half[c])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uniform_leaf_is_its_own_average_and_dark_veins_have_no_logarithm() {
        let (sa, ss, h) = ([9.0, 2.6, 22.0], [18.0, 16.0, 21.0], 0.2);
        let texel = |t: f64| {
            let r = [0, 1, 2].map(|c: usize| slab::response(sa[c], ss[c], t));
            LeafWideTexel {
                rho_d: r.map(|r| r.rho_d),
                rho_d_err: [1e-4; 3],
                rho_t: r.map(|r| r.rho_t),
                rho_t_floor: [1e-9; 3],
                covariance: [0.0; 3],
            }
        };
        let sigma = [0, 1, 2].map(|c: usize| [sa[c], ss[c]]);
        let paper = reduce(&[texel(h), texel(h), texel(2.5 * h)], &[sigma, sigma, sigma], h);
        assert!((paper.thickness[0] - h).abs() < 1e-9 && (paper.gamma[0][1] - 1.0).abs() < 1e-9);
        assert_eq!(paper.negative_logarithms, 1);
        assert!(paper.thickness[2].is_nan());
    }
}
