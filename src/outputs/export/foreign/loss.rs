//! What a target cannot hold, as numbers.
//!
//! Let f be our leaf and g the target's material with the parameters that it gets, both seen from one side of the
//! leaf. The error of reflection is the relative root mean square
//!
//! ```text
//! E² = Σ ∬ (g − f)² cosθi cosθo dωi dωo / Σ ∬ f² cosθi cosθo dωi dωo
//! ```
//! over both hemispheres, three colours and the texels; that of transmission is the same with the incoming hemisphere
//! below the leaf. It is the error of the radiance under light from a single direction, weighted as light falls on a
//! leaf and as the leaf is seen. The error of the albedo is (1/π) ∬ (g − f) cosθi cosθo dωi dωo for each colour, the
//! mean over the texels: what is missing or too much under even light from everywhere.

use crate::foreign::nodes::DirectionPairs;
use crate::foreign::target::TargetCoder;
use crate::foreign::texel::ExportTexel;
use mesophyll_base::surface::side::{Side, Sides};
use rayon::prelude::*;
use std::f64::consts::PI;

/// The loss of one side.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SideLoss {
    /// Relative RMS error of reflection and of transmission; `None` where ours is black.
    pub rms: [Option<f64>; 2],
    /// Albedo error, theirs less ours, of reflection and of transmission, for each colour.
    pub albedo: [[f64; 3]; 2],
    /// Our own albedo of both.
    pub ours: [[f64; 3]; 2],
}

/// Squares and albedos of one texel: of the difference, and of ours.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    squares: [[f64; 2]; 2],
    albedo: [[f64; 3]; 2],
    ours: [[f64; 3]; 2],
}

/// The loss of these texels on both sides.
pub fn loss(texels: &[ExportTexel], coder: &TargetCoder) -> Sides<SideLoss> {
    Sides::of(|side| {
        let each: Vec<Sums> = texels.par_iter().map(|t| sums(t, coder, side)).collect();
        let n = each.len().max(1) as f64;
        let mut out = SideLoss::default();
        for k in 0..2 {
            let sum = |which: usize| each.iter().map(|s| s.squares[k][which]).sum::<f64>();
            let (difference, ours) = (sum(0), sum(1));
            out.rms[k] = (ours > 0.0).then(|| (difference / ours).sqrt());
            for c in 0..3 {
                out.albedo[k][c] = each.iter().map(|s| s.albedo[k][c]).sum::<f64>() / n;
                out.ours[k][c] = each.iter().map(|s| s.ours[k][c]).sum::<f64>() / n;
            }
        }
        out
    })
}

fn sums(texel: &ExportTexel, coder: &TargetCoder, side: Side) -> Sums {
    let part = &texel.sides[side];
    let nodes = DirectionPairs::new(texel.lobe, if part.rho_s.iter().any(|r| *r > 0.0) { part.m } else { 0.5 });
    let seen = coder.seen(&coder.encode(texel)[side]);
    let through = texel.through(side);
    let mut out = Sums::default();
    let (mut view, mut left) = ([f64::NAN; 3], 1.0);
    for n in &nodes.all {
        if n.view != view {
            (view, left) = (n.view, seen.left(n.view));
        }
        let theirs = seen.both(n.view, n.light, left);
        let ours = [texel.reflected(side, n.view, n.light), through];
        for k in 0..2 {
            for c in 0..3 {
                let difference = theirs[k][c] - ours[k][c];
                out.squares[k][0] += n.weight * difference * difference;
                out.squares[k][1] += n.weight * ours[k][c] * ours[k][c];
                out.albedo[k][c] += n.weight * difference / PI;
                out.ours[k][c] += n.weight * ours[k][c] / PI;
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::foreign::target::ExportTarget;
    use crate::foreign::texel::ExportTexelSide;
    use mesophyll_base::surface::gloss::Lobe;

    fn leaf(rho_s: f64) -> ExportTexel {
        let part = |d: f64, m: f64| ExportTexelSide {
            rho_d: [0.3 * d, d, 0.2 * d],
            rho_t: [0.03, 0.12, 0.01],
            rho_s: [rho_s; 3],
            m,
        };
        ExportTexel { sides: Sides { front: part(0.1, 0.3), back: part(0.16, 0.45) }, lobe: Lobe::Beckmann }
    }

    fn coder(target: ExportTarget, texel: &ExportTexel) -> TargetCoder {
        let m = Side::ALL.map(|s| texel.sides[s].m);
        TargetCoder::new(target, texel.lobe, [m[0].min(m[1]), m[0].max(m[1])], texel.sides.front.rho_s[0])
    }

    /// A matte leaf with one transmittance fits some targets exactly, and loses exactly what the others lack.
    #[test]
    fn a_matte_leaf_loses_what_a_target_lacks() {
        let texel = leaf(0.0);
        for target in [ExportTarget::Mitsuba, ExportTarget::Blender] {
            let lost = loss(&[texel], &coder(target, &texel));
            assert!(lost.iter().all(|(_, s)| s.rms.iter().all(|e| e.unwrap() < 1e-12)), "{target:?}: {lost:?}");
        }
        // An opaque target loses all transmission, and its albedo is the transmittance.
        let lost = loss(&[texel], &coder(ExportTarget::Usd, &texel));
        assert!((lost.front.rms[1].unwrap() - 1.0).abs() < 1e-12);
        assert!((lost.front.albedo[1][1] / -0.12 - 1.0).abs() < 0.01, "{lost:?}");
        // It shows the front's colour on the back, too: (.1 − .16)/.16.
        assert!(lost.front.rms[0].unwrap() < 1e-12 && (lost.back.rms[0].unwrap() - 0.375).abs() < 1e-9);
        // pbrt has one material for both sides: half the difference, .03 of .1 and of .16.
        let lost = loss(&[texel], &coder(ExportTarget::Pbrt, &texel));
        assert!((lost.front.rms[0].unwrap() - 0.3).abs() < 1e-9 && (lost.back.rms[0].unwrap() - 0.1875).abs() < 1e-9);
        // Bytes of glTF: half a step of 255 in sRGB is below 1 % of these reflectances, and 3 % of the darkest.
        let lost = loss(&[texel], &coder(ExportTarget::GltfTranslucent, &texel));
        assert!(lost.iter().all(|(_, s)| s.rms.iter().all(|e| (1e-6..0.02).contains(&e.unwrap()))), "{lost:?}");
        // One colour and one ratio: what the second singular value holds. For the front R = (.03, .1, .02) and T =
        // (.03, .12, .01) the squares of the singular values sum to .0267; their product is that of the cross product.
        let lost = loss(&[texel], &coder(ExportTarget::OpenPbr, &texel));
        let (r, t) = ([0.03f64, 0.1, 0.02], [0.03f64, 0.12, 0.01]);
        let square = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>();
        let cross = [r[1] * t[2] - r[2] * t[1], r[2] * t[0] - r[0] * t[2], r[0] * t[1] - r[1] * t[0]];
        let (sum, product) = (square(r) + square(t), square(cross));
        let second = 0.5 * (sum - (sum * sum - 4.0 * product).sqrt());
        let [a, b] = lost.front.rms.map(Option::unwrap);
        let found = a * a * square(r) + b * b * square(t);
        assert!((found / second - 1.0).abs() < 1e-6, "{found} {second}");
    }

    /// There is no relative error of nothing.
    #[test]
    fn a_black_side_has_no_relative_error() {
        let dark = ExportTexel { sides: Sides::of(|_| ExportTexelSide::default()), lobe: Lobe::Beckmann };
        assert_eq!(loss(&[dark], &coder(ExportTarget::Mitsuba, &dark)).front.rms, [None; 2]);
    }

    /// A glossy leaf is nearest to the targets with its own slopes.
    #[test]
    fn own_slopes_lose_least() {
        let texel = leaf(0.05);
        let rms = |target| loss(&[texel], &coder(target, &texel)).front.rms[0].unwrap();
        let (same, other, metal) =
            (rms(ExportTarget::Blender), rms(ExportTarget::GltfTranslucent), rms(ExportTarget::OpenPbr));
        assert!(same < other && same < metal, "{same} {other} {metal}");
        let albedo = loss(&[texel], &coder(ExportTarget::Mitsuba, &texel)).front.albedo[0];
        assert!(albedo.iter().all(|a| a.abs() < 1e-3), "{albedo:?}");
    }

    /// Wood and ground have one side; pbrt's material of both sides shows the front as it is.
    #[test]
    fn a_black_back_does_not_darken_the_front() {
        let front = ExportTexelSide { rho_d: [0.32, 0.27, 0.2], ..ExportTexelSide::default() };
        let ground = ExportTexel { sides: Sides { front, back: ExportTexelSide::default() }, lobe: Lobe::Beckmann };
        let coded = coder(ExportTarget::Pbrt, &ground).encode(&ground);
        assert_eq!(coded.front.diffuse, front.rho_d);
    }

    /// The loss agrees with a dense product rule over both angles and the azimuth, within the stated one per cent.
    #[test]
    fn losses_are_those_of_a_product_rule() {
        let part = ExportTexelSide { rho_d: [0.1, 0.2, 0.05], rho_t: [0.1; 3], rho_s: [0.05; 3], m: 0.3 };
        let texel = ExportTexel { sides: Sides::of(|_| part), lobe: Lobe::Beckmann };
        for target in [ExportTarget::Mitsuba, ExportTarget::Blender, ExportTarget::Pbrt] {
            let coder = coder(target, &texel);
            let seen = coder.seen(&coder.encode(&texel).front);
            let (n, mut squares) = (160, [0.0; 2]);
            let at = |t: f64, phi: f64| {
                let c = t * t;
                let s = (1.0 - c * c).sqrt();
                [s * phi.cos(), s * phi.sin(), c]
            };
            let mid = |k: usize| (k as f64 + 0.5) / n as f64;
            for (i, j, k) in (0..n).flat_map(|i| (0..n).flat_map(move |j| (0..64).map(move |k| (i, j, k)))) {
                // Clustered at the mirror direction: at grazing the lobe is narrow in azimuth.
                let u = (k as f64 + 0.5) / 64.0;
                let (v, l) = (at(mid(i), 0.0), at(mid(j), PI * (1.0 - u.powi(3))));
                let weight = u * u * mid(i).powi(3) * mid(j).powi(3);
                let (theirs, ours) = (seen.both(v, l, 1.0)[0], texel.reflected(Side::Front, v, l));
                for c in 0..3 {
                    squares[0] += weight * (theirs[c] - ours[c]).powi(2);
                    squares[1] += weight * ours[c] * ours[c];
                }
            }
            let (dense, found) = ((squares[0] / squares[1]).sqrt(), loss(&[texel], &coder).front.rms[0].unwrap());
            println!("{target:?} {dense} {found}");
            assert!((found / dense - 1.0).abs() < 0.01, "{target:?}: {found} against {dense}");
        }
    }
}
