//! Where skies are sampled for a fit: Chebyshev nodes in (θs, ln(τ − τ₀)), where θs is the sun's zenith angle and τ the
//! turbidity. Also the integrals at these nodes, without their prefactors.

use mesophyll_base::chebyshev;
use mesophyll_sky::polynomials::FoldedPolynomials;
use mesophyll_sky::polynomials::folding::suns;
use mesophyll_sky::polynomials::mix::{ColourMix, OrderIndices, TURBIDITY_ZERO, scaled_turbidity};
use mesophyll_sky::preetham::PreethamTurbidity;
use mesophyll_sky::projection::{ProjectionQuality, ProjectionRule};
use rayon::prelude::*;
use std::f64::consts::FRAC_PI_2;

/// Sun angles at the positive half of 2n Chebyshev nodes on (−π/2, π/2), from the horizon upwards. Functions of one
/// parity need no more.
pub fn half(n: usize) -> Vec<f64> {
    (0..n).map(|k| FRAC_PI_2 * chebyshev::node(k, 2 * n)).collect()
}

/// n Chebyshev nodes on [low, high].
pub fn whole(n: usize, [low, high]: [f64; 2]) -> Vec<f64> {
    (0..n).map(|k| 0.5 * (low + high) + 0.5 * (high - low) * chebyshev::node(k, n)).collect()
}

/// n turbidities at Chebyshev nodes in ln(τ − τ₀).
pub fn turbidities(n: usize, [low, high]: [f64; 2]) -> Vec<f64> {
    let ends = [(low - TURBIDITY_ZERO).ln(), (high - TURBIDITY_ZERO).ln()];
    whole(n, ends).into_iter().map(|v| TURBIDITY_ZERO + v.exp()).collect()
}

/// The integrals of Y, Y/y and Y·x/y (luminance Y, chromaticities x and y) without prefactors, times each basis
/// function of m ≥ 0, at every sun and turbidity.
#[derive(Debug, Clone)]
pub struct SkyFitSamples {
    pub suns: Vec<f64>,
    pub turbidities: Vec<f64>,
    /// Indexed [sun][turbidity][l(l+1)/2 + m].
    pub values: Vec<Vec<Vec<[f64; 3]>>>,
    /// How many directions were evaluated.
    pub evaluations: usize,
}

/// Integrates, in parallel over the suns. One quadrature rule serves all turbidities.
pub fn sample(suns: Vec<f64>, turbidities: Vec<f64>, bands: usize, quality: ProjectionQuality) -> SkyFitSamples {
    let turbid: Vec<PreethamTurbidity> = turbidities.iter().map(|t| PreethamTurbidity::new(*t)).collect();
    let done: Vec<(usize, Vec<Vec<[f64; 3]>>)> = suns
        .par_iter()
        .map(|s| {
            let rule = ProjectionRule::new(*s, bands, quality);
            let at = |t: &PreethamTurbidity| rule.integrate(|d, gamma| t.separable(d[2], gamma));
            (rule.evaluations() * turbid.len(), turbid.iter().map(at).collect())
        })
        .collect();
    let evaluations = done.iter().map(|d| d.0).sum();
    SkyFitSamples { suns, turbidities, values: done.into_iter().map(|d| d.1).collect(), evaluations }
}

/// The interpolant through so many nodes that nothing of the sky is lost (1e-7 of the smallest c00, tested). It fills a
/// dense grid instead of an integration at each grid point. All its terms come from the discrete orthogonality of
/// Chebyshev polynomials at their nodes.
pub fn dense(bands: usize, range: [f64; 2]) -> Result<FoldedPolynomials<f64>, String> {
    const SUNS: usize = 32;
    const TURBID: usize = 20;
    let samples = sample(half(SUNS), turbidities(TURBID, range), bands, ProjectionQuality::Fit);
    let (orders, mix) = (OrderIndices::new(bands), ColourMix::new(range));
    // Weights of the discrete transform: 2/n, and half of that for degree 0.
    let mut columns = vec![[0.0; TURBID]; TURBID];
    for (row, t) in columns.iter_mut().zip(&samples.turbidities) {
        chebyshev::fill(scaled_turbidity(*t, range), 0, 1, row);
    }
    let (mut even, mut odd) = (vec![[0.0; SUNS]; SUNS], vec![[0.0; SUNS]; SUNS]);
    for (k, s) in samples.suns.iter().enumerate() {
        suns(*s, &mut even[k], &mut odd[k]);
    }
    let transform = |functions: &[usize], basis: &[[f64; SUNS]], even_part: bool| {
        let width = 3 * functions.len();
        let mut out = vec![0.0; SUNS * TURBID * width];
        for (a, by_turbidity) in samples.values.iter().enumerate() {
            for (b, q) in by_turbidity.iter().enumerate() {
                for i in 0..SUNS {
                    let wi = basis[a][i] * if even_part && i == 0 { 1.0 } else { 2.0 } / SUNS as f64;
                    for j in 0..TURBID {
                        let w = wi * columns[b][j] * if j == 0 { 1.0 } else { 2.0 } / TURBID as f64;
                        let row = &mut out[(i * TURBID + j) * width..][..width];
                        for (e, place) in functions.iter().enumerate() {
                            let v = mix.mixed(q[lower(*place)]);
                            for c in 0..3 {
                                row[c * functions.len() + e] += w * v[c];
                            }
                        }
                    }
                }
            }
        }
        out
    };
    let (e, o) = rayon::join(|| transform(&orders.even, &even, true), || transform(&orders.odd, &odd, false));
    FoldedPolynomials::new(bands, range, vec![TURBID; SUNS], e, o)
}

/// The index l(l+1)/2 + m of the function with the index l(l+1) + m, for m ≥ 0.
pub fn lower(place: usize) -> usize {
    let l = place.isqrt();
    let m = place - l * (l + 1);
    l * (l + 1) / 2 + m
}
