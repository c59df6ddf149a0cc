//! What the camera sees of a synthetic leaf before black or white: the light that goes to and fro between the leaf and
//! what lies behind it. Nothing here is shared with the reduction. Every texel has the slab of the specification at its
//! own thickness, solved by doubling at Gauss's cosines, and a rough dielectric surface.

use crate::dome::DomeLeaf;
use crate::leaf::{SyntheticLeaf, SyntheticSide};
use crate::slab_truth::{SlabTruthTable, gauss_legendre};
use mesophyll_capture::dome::smoothing::{SmoothingKernel, smooth};
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::side::mirror;

/// Cosines of incidence at which slabs and surfaces are solved.
const COSINES: usize = 10;
/// Values of the reflectance along the normal between which the surface is interpolated.
const SURFACES: usize = 9;
const MOST: f64 = 0.16;

/// A side under light from all sides, a channel of each texel in its own columns.
pub(super) struct AllRound {
    /// Share that it throws back, its surface included.
    reflect: Vec<[f64; 3]>,
    /// Share that comes through.
    transmit: Vec<[f64; 3]>,
}

/// (cosine, weight): ∫ f(μ) 2μ dμ is the sum of weight · f(cosine).
fn cosines() -> impl Iterator<Item = (f64, f64)> {
    gauss_legendre(COSINES).into_iter().map(|(x, w)| (0.5 * (x + 1.0), 0.5 * w)).map(|(mu, w)| (mu, 2.0 * mu * w))
}

fn all_round(side: &SyntheticSide, lobe: Lobe) -> AllRound {
    let on: Vec<usize> = (0..side.thickness.len()).filter(|&k| side.thickness[k] > 0.0).collect();
    let mut found =
        AllRound { reflect: vec![[0.0; 3]; side.thickness.len()], transmit: vec![[0.0; 3]; side.thickness.len()] };
    let mean = |f: &dyn Fn(usize) -> f64| on.iter().map(|&k| f(k)).sum::<f64>() / on.len().max(1) as f64;
    let range = on
        .iter()
        .map(|&k| f64::from(side.thickness[k]))
        .fold([f64::MAX, 0.0], |[a, b]: [f64; 2], d| [a.min(d), b.max(d)]);
    for c in 0..3 {
        let (sigma_a, sigma_s) = (mean(&|k| f64::from(side.sigma_a[k][c])), mean(&|k| f64::from(side.sigma_s[k][c])));
        let table = |mu: f64| SlabTruthTable::new(mu, [sigma_a; 2], sigma_s, range);
        let (normal, from): (SlabTruthTable, Vec<(SlabTruthTable, f64)>) =
            (table(1.0), cosines().map(|(mu, w)| (table(mu), w)).collect());
        for &k in &on {
            let h = f64::from(side.thickness[k]);
            let along = normal.at(sigma_a, h);
            let (mut up, mut down) = (0.0, 0.0);
            for (table, w) in &from {
                let r = table.at(sigma_a, h);
                up += w * r.rho_d;
                down += w * r.rho_t;
            }
            found.reflect[k][c] = f64::from(side.rho_d[k][c]) * up / along.rho_d;
            found.transmit[k][c] = f64::from(side.rho_t[k][c]) * down / along.rho_t;
        }
    }
    let m = mean(&|k| f64::from(side.m[k]));
    let surface: Vec<f64> = (0..SURFACES).map(|i| mirrored(MOST * i as f64 / (SURFACES - 1) as f64, m)).collect();
    let fresnel = lobe.index().map_or(1.0, |index| ((index - 1.0) / (index + 1.0)).powi(2));
    for &k in &on {
        let at = (f64::from(side.rho_s[k][0]) * fresnel / MOST).clamp(0.0, 1.0) * (SURFACES - 1) as f64;
        let i = (at as usize).min(SURFACES - 2);
        let share = surface[i] + (at - i as f64) * (surface[i + 1] - surface[i]);
        (0..3).for_each(|c| found.reflect[k][c] += share);
    }
    found
}

/// Share of light from all sides that a rough dielectric of slope `m` mirrors, which reflects `normal` of a beam along
/// a facet's normal. The lobe of Cook and Torrance has Fresnel's law and the shadows of facets.
fn mirrored(normal: f64, m: f64) -> f64 {
    let r = normal.sqrt();
    let lobe = Lobe::CookTorrance { index: (1.0 + r) / (1.0 - r) };
    cosines().map(|(mu, w)| w * lobe.albedo(mu, m)).sum()
}

/// Both sides of a leaf under light from all sides.
pub(super) fn both_round(leaf: &SyntheticLeaf) -> [AllRound; 2] {
    [&leaf.front, &leaf.back].map(|side| all_round(side, leaf.lobe))
}

/// Light that the camera sees of both sides on a sheet of reflectance `sheet` in open shade, over the sky's; each side
/// in its own columns.
pub(super) fn shaded(blade: &DomeLeaf, round: &[AllRound; 2], sheet: f64) -> [Vec<[f64; 3]>; 2] {
    let w = blade.leaf.width;
    [0, 1].map(|s: usize| {
        let (shown, under) = (&blade.shown[s], mirror(&round[1 - s].reflect, w));
        (0..under.len())
            .map(|k| {
                let through = [0, 1, 2].map(|c: usize| {
                    // What the sheet sends to the underside, from all sides.
                    let lit = sheet * round[s].transmit[k][c] / (1.0 - sheet * under[k][c]);
                    f64::from(shown.transmittance[k][c]) * lit
                });
                [0, 1, 2].map(|c: usize| f64::from(shown.albedo[k][c] + shown.highlight[k]) + through[c])
            })
            .collect()
    })
}

/// Light that the camera sees of both sides on a light table of reflectance `table`, over the bare table's; each side
/// in its own columns. What the underside throws back spreads over `spread_mm` in the table before it returns.
pub(super) fn on_table(blade: &DomeLeaf, round: &[AllRound; 2], table: f64, spread_mm: f64) -> [Vec<[f64; 3]>; 2] {
    let (leaf, w) = (&blade.leaf, blade.leaf.width);
    let kernel = SmoothingKernel::gaussian(spread_mm / leaf.texel_mm);
    let everywhere = vec![1.0; leaf.mask.len()];
    let below = [&round[0], &round[1]].map(|side| {
        [0, 1, 2].map(|c: usize| {
            let one: Vec<f64> = side.reflect.iter().map(|r| r[c]).collect();
            mirror(&smooth(&one, &everywhere, w, &kernel), w)
        })
    });
    [0, 1].map(|s: usize| {
        let light = blade.shown[s].transmittance.iter().enumerate();
        light.map(|(k, t)| [0, 1, 2].map(|c: usize| f64::from(t[c]) / (1.0 - table * below[1 - s][c][k]))).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_capture::photo::diffuse::over_normal;
    use mesophyll_optics::gloss::fresnel;
    use mesophyll_optics::slab::medium::response;

    /// What the synthesis solves by doubling is what the reduction finds from ρd and ρt alone, and a rough surface
    /// mirrors less of light from all sides than a smooth one, which follows Fresnel's law.
    #[test]
    fn light_from_all_sides_is_that_of_the_slab_and_of_a_rough_surface() {
        let (sigma_a, sigma_s, thickness) = ([20.0f32, 3.0, 12.0], [4.0f32, 14.0, 9.0], [0.1f32, 0.15, 0.3]);
        let gamma = 1.2;
        let slab = |k: usize, c: usize| response(sigma_a[c].into(), sigma_s[c].into(), thickness[k].into());
        let side = SyntheticSide {
            rho_d: (0..3).map(|k| [0, 1, 2].map(|c| (gamma * slab(k, c).rho_d) as f32)).collect(),
            rho_t: (0..3).map(|k| [0, 1, 2].map(|c| slab(k, c).rho_t as f32)).collect(),
            rho_s: vec![[0.0278; 3]; 3],
            m: vec![0.05; 3],
            sigma_a: vec![sigma_a; 3],
            sigma_s: vec![sigma_s; 3],
            thickness: thickness.to_vec(),
            ..SyntheticSide::default()
        };
        let found = all_round(&side, Lobe::Beckmann);
        // The index 1.4 has .0278 along the normal.
        let steps = 4000;
        let smooth: f64 = (0..steps).map(|k| fresnel(((f64::from(k) + 0.5) / f64::from(steps)).sqrt(), 1.4)).sum();
        let smooth = smooth / f64::from(steps);
        for k in 0..3 {
            for c in 0..3 {
                let r = slab(k, c);
                let [up, down] = over_normal(r.rho_d, r.rho_t);
                let surface = found.reflect[k][c] - gamma * up * r.rho_d;
                assert!((surface / smooth - 0.98).abs() < 0.02, "{k} {c}: {surface} {smooth}");
                let through = found.transmit[k][c] / (down * r.rho_t) - 1.0;
                assert!(through.abs() < 2e-3, "{k} {c}: {through}");
            }
        }
        assert!(mirrored(0.0278, 0.4) < 0.8 * smooth && mirrored(0.0278, 0.4) > 0.0278);
    }
}
