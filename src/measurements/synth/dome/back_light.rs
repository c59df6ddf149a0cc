//! What a leaf shows in front of a diffuse back light when light spreads sideways inside it; used for synthesis.
//!
//! For each texel and channel: τ(x) = ρt(x) · [A_p Σ_i T(|x − x_i|, d_i) V_i/n_z,i] / T_total(d(x)).
//!
//! - ρt is the slab's transmittance with the texel's own pigment, for a beam along the normal; by reciprocity that is
//!   what the camera sees.
//! - T is the diffusing kernel of the leaf's mean tissue, with its total set to the slab's (H9 Eq. 3.14 without the
//!   albedos; all light enters, as in the slab). A_p is the area of a texel.
//! - d is the thickness where the light entered.
//! - V/n_z is the back light that falls there past the relief, per area of the plane.
//!
//! A flat uniform leaf shows its ρt. A vein's shadow is softened. Next to a hole or the outline some light is lost.

use crate::Result;
use crate::leaf::{SyntheticLeaf, SyntheticSide};
use crate::slab_truth::SlabTruthTable;
use mesophyll_capture::dome::visibility::visible;
use mesophyll_optics::dipole::Tissue;
use mesophyll_optics::side::Side;
use mesophyll_optics::side::mirror;
use mesophyll_optics::translucency::blade::BladeMaps;
use mesophyll_optics::translucency::convolution::{ConvolutionSettings, Convolver, TotalsSource};

/// How far sideways light is followed where only a part of a leaf is captured (mm).
pub(crate) const REACH_MM: f64 = 2.0;

/// τ of both sides, front first, each as its own camera saw it; the back light stands behind the leaf.
///
/// # Errors
/// Only what the convolution refuses: a tissue that neither absorbs nor scatters.
pub fn through(leaf: &SyntheticLeaf, shape: &BladeMaps) -> Result<[Vec<[f32; 3]>; 2]> {
    let width = leaf.width;
    let (front, back) = (shape.lit(Side::Front), shape.lit(Side::Back));
    // A facet with the normal's component n_z has 1/n_z times its texel's area, and receives that much more light.
    let falls = [&front, &back]
        .map(|lit| -> Vec<f64> { visible(lit).into_iter().zip(&lit.surface.normal).map(|(v, n)| v / n[2]).collect() });
    let mut shown = [vec![[0f32; 3]; leaf.mask.len()], vec![[0f32; 3]; leaf.mask.len()]];
    for c in 0..3 {
        let tissue = tissue(&leaf.front, c);
        let settings =
            ConvolutionSettings { totals: TotalsSource::Transport, ..ConvolutionSettings::new(tissue, leaf.texel_mm) };
        let Some(convolver) = Convolver::for_map(&settings, width, &front.thickness)? else { continue };
        let spread = convolver.run_each(&[
            (front.thickness.as_ref(), falls[0].as_slice()),
            (back.thickness.as_ref(), falls[1].as_slice()),
        ]);
        // What a texel would show if all light stayed in it.
        let alone = SlabTruthTable::new(1.0, [tissue.sigma_a; 2], tissue.sigma_s, range(&leaf.front));
        // Light that fell on the back shows on the front.
        for ((out, side), spread) in shown.iter_mut().zip([&leaf.front, &leaf.back]).zip(spread.iter().rev()) {
            let spread = mirror(spread, width);
            for (k, v) in out.iter_mut().enumerate().filter(|(k, _)| side.thickness[*k] > 0.0) {
                let alone = alone.at(tissue.sigma_a, f64::from(side.thickness[k])).rho_t;
                v[c] = (f64::from(side.rho_t[k][c]) * spread[k] / alone) as f32;
            }
        }
    }
    Ok(shown)
}

fn range(side: &SyntheticSide) -> [f64; 2] {
    let on = side.thickness.iter().filter(|d| **d > 0.0).map(|d| f64::from(*d));
    on.fold([f64::MAX, 0.0], |[a, b], d| [a.min(d), b.max(d)])
}

/// The mean tissue of a leaf in a channel. Scattering is isotropic, and all light that reaches a surface leaves, as in
/// the slab.
fn tissue(side: &SyntheticSide, c: usize) -> Tissue {
    let on: Vec<usize> = (0..side.thickness.len()).filter(|&k| side.thickness[k] > 0.0).collect();
    let mean = |map: &[[f32; 3]]| on.iter().map(|&k| f64::from(map[k][c])).sum::<f64>() / on.len().max(1) as f64;
    Tissue { sigma_a: mean(&side.sigma_a), sigma_s: mean(&side.sigma_s), g: 0.0, a: 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::slab_truth::response;
    use mesophyll_optics::gloss::Lobe;

    const W: usize = 96;
    const H: usize = 80;

    /// A level leaf of the given thicknesses, in texels of 0.1 mm, and what its front shows in red, green and blue.
    fn shown(thickness: impl Fn(usize, usize) -> f32) -> (Vec<f32>, Vec<[f32; 3]>, Vec<[f32; 3]>) {
        let front: Vec<f32> = (0..W * H).map(|k| thickness(k % W, k / W)).collect();
        let (sigma_a, sigma_s) = ([5.0f32, 2.0, 8.0], [6.0f32, 12.0, 4.0]);
        // There are only a few thicknesses, so each is solved once.
        let mut solved: Vec<(f32, [f32; 3])> = Vec::new();
        for &d in &front {
            if !solved.iter().any(|s| s.0 == d) {
                let alone =
                    |c: usize| response(f64::from(sigma_a[c]), f64::from(sigma_s[c]), f64::from(d)).rho_t as f32;
                solved.push((d, [0, 1, 2].map(alone)));
            }
        }
        let side = |d: Vec<f32>| SyntheticSide {
            rho_t: d.iter().map(|d| solved.iter().find(|s| s.0 == *d).unwrap().1).collect(),
            sigma_a: vec![sigma_a; W * H],
            sigma_s: vec![sigma_s; W * H],
            thickness: d,
            ..SyntheticSide::default()
        };
        let (mask, relief, heights) = (vec![true; W * H], vec![0.0; W * H], [vec![0.1; W * H], vec![0.1; W * H]]);
        let mut shape = BladeMaps::from_heights(W, H, 0.1, mask.clone(), heights, [Vec::new(), Vec::new()]);
        shape.thickness = front.iter().map(|d| f64::from(*d)).collect();
        let back = side(mirror(&front, W));
        let leaf = SyntheticLeaf {
            width: W,
            height: H,
            texel_mm: 0.1,
            lobe: Lobe::Beckmann,
            mask,
            relief,
            front: side(front.clone()),
            back,
        };
        let [shown, _] = through(&leaf, &shape).unwrap();
        (front, leaf.front.rho_t, shown)
    }

    fn inner() -> impl Iterator<Item = usize> {
        (20..H - 20).flat_map(|j| (20..W - 20).map(move |i| j * W + i))
    }

    #[test]
    fn a_level_leaf_of_one_thickness_shows_the_slabs_transmittance() {
        let (_, own, seen) = shown(|_, _| 0.2);
        for c in 0..3 {
            assert!(inner().all(|k| (seen[k][c] / own[k][c] - 1.0).abs() < 1e-3));
            // No light comes in from beyond the image's edge, so some light is missing beside it.
            let edge = seen[40 * W][c] / own[40 * W][c];
            assert!((0.4..0.999).contains(&edge), "{c}: {edge}");
        }
    }

    /// A vein's shadow is softened: no light is lost, the vein is brighter than it would be alone, and its sides are
    /// darker.
    #[test]
    fn a_vein_is_softened_and_no_light_is_lost() {
        let mut gained = [0.0f32; 3];
        let (d, own, seen) = shown(|i, _| if (46..50).contains(&i) { 0.4 } else { 0.2 });
        for c in 0..3 {
            let sum = |m: &[[f32; 3]]| inner().map(|k| f64::from(m[k][c])).sum::<f64>();
            assert!((sum(&seen) / sum(&own) - 1.0).abs() < 1e-3, "{} {}", sum(&seen), sum(&own));
            let (vein, beside) = (40 * W + 47, 40 * W + 44);
            let (more, less) = (seen[vein][c] / own[vein][c] - 1.0, 1.0 - seen[beside][c] / own[beside][c]);
            assert!(d[vein] > d[beside] && more > 0.01 && less > 1e-3, "{c}: {more} {less}");
            gained[c] = more;
        }
        // Green scatters most and is absorbed least.
        assert!(gained[1] > 2.0 * gained[2], "{gained:?}");
    }
}
