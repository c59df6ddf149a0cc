//! What the camera sees of a synthetic leaf before black or white: the light that goes to and fro between the leaf and
//! what lies behind it. Nothing here is shared with the reduction. Every texel has the slab of the specification at its
//! own thickness, solved by doubling at Gauss's cosines, and a rough dielectric surface.

use crate::dome::{DomeLeaf, TexelAppearance};
use crate::leaf::{SyntheticLeaf, SyntheticTexel};
use crate::slab_truth::{SlabTruthTable, gauss_legendre};
use mesophyll_base::rgb::Rgb;
use mesophyll_capture::dome::smoothing::{SmoothingKernel, smooth};
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::side::{Sides, mirror};

/// Cosines of incidence at which slabs and surfaces are solved.
const COSINES: usize = 10;
/// Values of the reflectance along the normal between which the surface is interpolated.
const SURFACES: usize = 9;
const MOST: f64 = 0.16;

/// A texel under light from all sides.
#[derive(Clone, Copy, Default)]
pub(super) struct AllRound {
    /// Share that it throws back, its surface included.
    reflect: Rgb,
    /// Share that comes through.
    transmit: Rgb,
}

/// (cosine, weight): ∫ f(μ) 2μ dμ is the sum of weight · f(cosine).
fn cosines() -> impl Iterator<Item = (f64, f64)> {
    gauss_legendre(COSINES).into_iter().map(|(x, w)| (0.5 * (x + 1.0), 0.5 * w)).map(|(mu, w)| (mu, 2.0 * mu * w))
}

fn all_round(side: &[SyntheticTexel], lobe: Lobe) -> Vec<AllRound> {
    let mut found = vec![AllRound::default(); side.len()];
    let on = || side.iter().filter(|t| t.thickness > 0.0);
    let mean =
        |f: &dyn Fn(&SyntheticTexel) -> f32| on().map(|t| f64::from(f(t))).sum::<f64>() / on().count().max(1) as f64;
    let range = on().map(|t| f64::from(t.thickness)).fold([f64::MAX, 0.0], |[a, b]: [f64; 2], d| [a.min(d), b.max(d)]);
    for c in 0..3 {
        let (sigma_a, sigma_s) = (mean(&|t| t.sigma_a[c]), mean(&|t| t.sigma_s[c]));
        let table = |mu: f64| SlabTruthTable::new(mu, [sigma_a; 2], sigma_s, range);
        let (normal, from): (SlabTruthTable, Vec<(SlabTruthTable, f64)>) =
            (table(1.0), cosines().map(|(mu, w)| (table(mu), w)).collect());
        for (found, t) in found.iter_mut().zip(side).filter(|(_, t)| t.thickness > 0.0) {
            let h = f64::from(t.thickness);
            let along = normal.at(sigma_a, h);
            let (mut up, mut down) = (0.0, 0.0);
            for (table, w) in &from {
                let r = table.at(sigma_a, h);
                up += w * r.rho_d;
                down += w * r.rho_t;
            }
            found.reflect[c] = f64::from(t.rho_d[c]) * up / along.rho_d;
            found.transmit[c] = f64::from(t.rho_t[c]) * down / along.rho_t;
        }
    }
    let m = mean(&|t| t.m);
    let surface: Vec<f64> = (0..SURFACES).map(|i| mirrored(MOST * i as f64 / (SURFACES - 1) as f64, m)).collect();
    let fresnel = lobe.index().map_or(1.0, |index| ((index - 1.0) / (index + 1.0)).powi(2));
    for (found, t) in found.iter_mut().zip(side).filter(|(_, t)| t.thickness > 0.0) {
        let at = (f64::from(t.rho_s) * fresnel / MOST).clamp(0.0, 1.0) * (SURFACES - 1) as f64;
        let i = (at as usize).min(SURFACES - 2);
        let share = surface[i] + (at - i as f64) * (surface[i + 1] - surface[i]);
        found.reflect += share;
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
pub(super) fn both_round(leaf: &SyntheticLeaf) -> Sides<Vec<AllRound>> {
    Sides::of(|side| all_round(&leaf.sides[side], leaf.lobe))
}

/// Light that the camera sees of both sides on a sheet of reflectance `sheet` in open shade, over the sky's; each side
/// in its own columns.
pub(super) fn shaded(blade: &DomeLeaf, round: &Sides<Vec<AllRound>>, sheet: f64) -> Sides<Vec<Rgb>> {
    Sides::of(|side| {
        let under = mirror(&round[side.other()], blade.leaf.size.width);
        let texel = |((shown, round), under): ((&TexelAppearance, &AllRound), AllRound)| {
            // What the sheet sends to the underside, from all sides.
            let lit = sheet * round.transmit / (1.0 - sheet * under.reflect);
            shown.albedo.map(|a| f64::from(a + shown.highlight)) + shown.transmittance.map(f64::from) * lit
        };
        blade.shown[side].iter().zip(&round[side]).zip(under).map(texel).collect()
    })
}

/// Light that the camera sees of both sides on a light table of reflectance `table`, over the bare table's; each side
/// in its own columns. What the underside throws back spreads over `spread_mm` in the table before it returns.
pub(super) fn on_table(blade: &DomeLeaf, round: &Sides<Vec<AllRound>>, table: f64, spread_mm: f64) -> Sides<Vec<Rgb>> {
    let (leaf, w) = (&blade.leaf, blade.leaf.size.width);
    let kernel = SmoothingKernel::gaussian(spread_mm / leaf.texel_mm);
    let everywhere = vec![1.0; leaf.mask.len()];
    Sides::of(|side| {
        let under = Rgb::of(|c| {
            let one: Vec<f64> = round[side.other()].iter().map(|r| r.reflect[c]).collect();
            mirror(&smooth(&one, &everywhere, w, &kernel), w)
        });
        let shown = blade.shown[side].iter().enumerate();
        shown.map(|(k, v)| Rgb::of(|c| f64::from(v.transmittance[c]) / (1.0 - table * under[c][k]))).collect()
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
        let side: Vec<SyntheticTexel> = (0..3)
            .map(|k| SyntheticTexel {
                rho_d: Rgb::of(|c| (gamma * slab(k, c).rho_d) as f32),
                rho_t: Rgb::of(|c| slab(k, c).rho_t as f32),
                rho_s: 0.0278,
                m: 0.05,
                sigma_a: Rgb(sigma_a),
                sigma_s: Rgb(sigma_s),
                thickness: thickness[k],
                ..SyntheticTexel::default()
            })
            .collect();
        let found = all_round(&side, Lobe::Beckmann);
        // The index 1.4 has .0278 along the normal.
        let steps = 4000;
        let smooth: f64 = (0..steps).map(|k| fresnel(((f64::from(k) + 0.5) / f64::from(steps)).sqrt(), 1.4)).sum();
        let smooth = smooth / f64::from(steps);
        for k in 0..3 {
            for c in 0..3 {
                let r = slab(k, c);
                let [up, down] = over_normal(r.rho_d, r.rho_t);
                let surface = found[k].reflect[c] - gamma * up * r.rho_d;
                assert!((surface / smooth - 0.98).abs() < 0.02, "{k} {c}: {surface} {smooth}");
                let through = found[k].transmit[c] / (down * r.rho_t) - 1.0;
                assert!(through.abs() < 2e-3, "{k} {c}: {through}");
            }
        }
        assert!(mirrored(0.0278, 0.4) < 0.8 * smooth && mirrored(0.0278, 0.4) > 0.0278);
    }
}
