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
use crate::leaf::{SyntheticLeaf, SyntheticTexel};
use crate::slab_truth::SlabTruthTable;
use mesophyll_base::rgb::Rgb;
use mesophyll_capture::dome::visibility::visible;
use mesophyll_optics::dipole::Tissue;
use mesophyll_optics::side::{Side, Sides, mirror};
use mesophyll_optics::translucency::blade::BladeMaps;
use mesophyll_optics::translucency::convolution::{ConvolutionSettings, Convolver, TotalsSource};

/// How far sideways light is followed where only a part of a leaf is captured (mm).
pub(crate) const REACH_MM: f64 = 2.0;

/// τ of both sides, each as its own camera saw it; the back light stands behind the leaf.
///
/// # Errors
/// Only what the convolution refuses: a tissue that neither absorbs nor scatters.
pub fn through(leaf: &SyntheticLeaf, shape: &BladeMaps) -> Result<Sides<Vec<Rgb<f32>>>> {
    let width = leaf.size.width;
    let (front, back) = (shape.lit(Side::Front), shape.lit(Side::Back));
    // A facet with the normal's component n_z has 1/n_z times its texel's area, and receives that much more light.
    let falls = [&front, &back]
        .map(|lit| -> Vec<f64> { visible(lit).into_iter().zip(&lit.surface.normal).map(|(v, n)| v / n[2]).collect() });
    let mut shown = Sides::of(|_| vec![Rgb::splat(0f32); leaf.mask.len()]);
    for c in 0..3 {
        let tissue = tissue(&leaf.sides.front, c);
        let settings =
            ConvolutionSettings { totals: TotalsSource::Transport, ..ConvolutionSettings::new(tissue, leaf.texel_mm) };
        let Some(convolver) = Convolver::for_map(&settings, width, &front.thickness)? else { continue };
        let spread = convolver.run_each(&[
            (front.thickness.as_ref(), falls[0].as_slice()),
            (back.thickness.as_ref(), falls[1].as_slice()),
        ]);
        // What a texel would show if all light stayed in it.
        let alone = SlabTruthTable::new(1.0, [tissue.sigma_a; 2], tissue.sigma_s, range(&leaf.sides.front));
        // Light that fell on the back shows on the front.
        for ((side, out), spread) in shown.iter_mut().zip(spread.iter().rev()) {
            let spread = mirror(spread, width);
            for ((v, t), spread) in
                out.iter_mut().zip(&leaf.sides[side]).zip(spread).filter(|((_, t), _)| t.thickness > 0.0)
            {
                let alone = alone.at(tissue.sigma_a, f64::from(t.thickness)).rho_t;
                v[c] = (f64::from(t.rho_t[c]) * spread / alone) as f32;
            }
        }
    }
    Ok(shown)
}

/// The texels on the leaf.
fn on(side: &[SyntheticTexel]) -> impl Iterator<Item = &SyntheticTexel> {
    side.iter().filter(|t| t.thickness > 0.0)
}

fn range(side: &[SyntheticTexel]) -> [f64; 2] {
    on(side).map(|t| f64::from(t.thickness)).fold([f64::MAX, 0.0], |[a, b], d| [a.min(d), b.max(d)])
}

/// The mean tissue of a leaf in a channel. Scattering is isotropic, and all light that reaches a surface leaves, as in
/// the slab.
fn tissue(side: &[SyntheticTexel], c: usize) -> Tissue {
    let mean = |of: fn(&SyntheticTexel) -> Rgb<f32>| {
        on(side).map(|t| f64::from(of(t)[c])).sum::<f64>() / on(side).count().max(1) as f64
    };
    Tissue { sigma_a: mean(|t| t.sigma_a), sigma_s: mean(|t| t.sigma_s), g: 0.0, a: 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::slab_truth::response;
    use crate::spec::InteriorModel;
    use mesophyll_base::image::{Image, ImageSize};
    use mesophyll_optics::gloss::Lobe;

    const W: usize = 96;
    const H: usize = 80;

    /// A level leaf of the given thicknesses, in texels of 0.1 mm, and what its front shows in red, green and blue.
    fn shown(thickness: impl Fn(usize, usize) -> f32) -> (Vec<f32>, Vec<Rgb<f32>>, Vec<Rgb<f32>>) {
        let size = ImageSize::new(W, H);
        let front = Image::of(size, |k| thickness(size.position(k)[0], size.position(k)[1])).pixels;
        let (sigma_a, sigma_s) = (Rgb([5.0f32, 2.0, 8.0]), Rgb([6.0f32, 12.0, 4.0]));
        // There are only a few thicknesses, so each is solved once.
        let mut solved: Vec<SyntheticTexel> = Vec::new();
        for &d in &front {
            if !solved.iter().any(|s| s.thickness == d) {
                let rho_t =
                    sigma_a.zip(sigma_s, |a, s| response(f64::from(a), f64::from(s), f64::from(d)).rho_t as f32);
                solved.push(SyntheticTexel { rho_t, sigma_a, sigma_s, thickness: d, ..SyntheticTexel::default() });
            }
        }
        let side = |d: &[f32]| d.iter().map(|d| *solved.iter().find(|s| s.thickness == *d).unwrap()).collect();
        let (mask, heights) = (vec![true; W * H], [vec![0.1; W * H], vec![0.1; W * H]]);
        let mut shape = BladeMaps::from_heights(W, H, 0.1, mask.clone(), heights, [Vec::new(), Vec::new()]);
        shape.thickness = front.iter().map(|d| f64::from(*d)).collect();
        let leaf = SyntheticLeaf {
            size,
            texel_mm: 0.1,
            lobe: Lobe::Beckmann,
            model: InteriorModel::Exact,
            mask,
            relief: vec![0.0; W * H],
            sides: Sides { front: side(&front), back: side(&mirror(&front, W)) },
        };
        let shown = through(&leaf, &shape).unwrap().front;
        (front, leaf.sides.front.iter().map(|t| t.rho_t).collect(), shown)
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
            let sum = |m: &[Rgb<f32>]| inner().map(|k| f64::from(m[k][c])).sum::<f64>();
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
