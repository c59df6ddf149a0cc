//! Compares the scan's integral with area elements of the cylinder (computed with vectors only) and with closed forms.

use super::illumination::{TexelShading, TubeDevice};
use super::slab_truth::gauss_legendre;
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::tube::{Travel, Tube};
use std::f64::consts::PI;

const TUBE: Tube = Tube { height_mm: 100.0, length_mm: 500.0, radius_mm: 2.5 };

fn unit(v: [f64; 3]) -> [f64; 3] {
    let l = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    v.map(|x| x / l)
}

/// The same from area elements of the cylinder: ∫ f cosθi Le cosθl dA/r², computed with vectors only.
fn by_area(tube: Tube, travel: Travel, position: f64, at: [f64; 2], n: [f64; 3], m: f64, lobe: Lobe) -> TexelShading {
    let (s, c) = 55f64.to_radians().sin_cos();
    let v = [s, 0.0, c];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let (t, l) = if travel == Travel::X { (at[0], at[1]) } else { (at[1], at[0]) };
    let towards = (position - t).atan2(tube.height_mm);
    let d = (position - t).hypot(tube.height_mm);
    let arc = (tube.radius_mm / d).acos();
    let mut sum = TexelShading::default();
    let nodes = gauss_legendre(24);
    let pieces = 1500;
    for &(x, w) in &nodes {
        let beta = towards + PI + arc * x; // direction of the surface normal in the cross plane, from z towards travel
        let (sb, cb) = beta.sin_cos();
        let across = position - t + tube.radius_mm * sb;
        let up = tube.height_mm + tube.radius_mm * cb;
        // The part of this line of the cylinder above the texel's horizon: n·to > 0, linear in y.
        let (nt, nl) = if travel == Travel::X { (n[0], n[1]) } else { (n[1], n[0]) };
        // The lit length ends at the angle at which the axis' ends are seen (the capture's convention).
        let reach = across.hypot(up) / d;
        let (mut lo, mut hi) = ((-0.5 * tube.length_mm - l) * reach, (0.5 * tube.length_mm - l) * reach);
        let root = -(nt * across + n[2] * up) / nl;
        if nl > 0.0 {
            lo = lo.max(root).min(hi);
        } else if nl < 0.0 {
            hi = hi.min(root).max(lo);
        }
        for k in 0..pieces * 4 {
            let (g, gw) = [(-0.861136311594053, 0.347854845137454), (-0.339981043584856, 0.652145154862546)]
                .into_iter()
                .flat_map(|(g, w)| [(g, w), (-g, w)])
                .nth(k % 4)
                .unwrap();
            let step = (hi - lo) / pieces as f64;
            let y = lo + ((k / 4) as f64 + 0.5 + 0.5 * g) * step;
            let to = if travel == Travel::X { [across, y, up] } else { [y, across, up] };
            let out = if travel == Travel::X { [sb, 0.0, cb] } else { [0.0, sb, cb] };
            let r2 = dot(to, to);
            let omega = unit(to);
            let (ci, cl, cr) = (dot(n, omega), -dot(out, omega), dot(n, v));
            if ci <= 0.0 || cl <= 0.0 || cr <= 0.0 {
                continue;
            }
            let h = unit([omega[0] + v[0], omega[1] + v[1], omega[2] + v[2]]);
            let ca = dot(n, h);
            let tan2 = 1.0 / (ca * ca) - 1.0;
            let dist = match lobe {
                Lobe::Ggx | Lobe::GgxFresnel { .. } => m * m / (PI * ca.powi(4) * (m * m + tan2).powi(2)),
                _ => (-tan2 / (m * m)).exp() / (PI * m * m * ca.powi(4)),
            };
            let extra = match lobe {
                Lobe::CookTorrance { index } | Lobe::GgxFresnel { index } => {
                    let ch = dot(v, h);
                    let st = (1.0 - ch * ch).sqrt() / index;
                    let ct = (1.0 - st * st).sqrt();
                    let (rs, rp) = ((ch - index * ct) / (ch + index * ct), (ct - index * ch) / (ct + index * ch));
                    let g = 1f64.min(2.0 * ca * cr / ch).min(2.0 * ca * ci / ch);
                    0.5 * (rs * rs + rp * rp) * g
                }
                _ => 1.0,
            };
            let element =
                tube.height_mm / tube.radius_mm * ci * cl / r2 * (arc * w * tube.radius_mm) * (0.5 * step * gw);
            sum.diffuse += element / PI;
            sum.gloss += element * dist * extra / (4.0 * ci * cr);
        }
    }
    sum
}

#[test]
fn it_is_the_integral_over_the_cylinders_surface() {
    let cases = [
        (Travel::X, -140.0, [3.0, -8.0], [0.02, 0.01, 1.0], 0.03),
        (Travel::X, -155.0, [3.0, -8.0], [0.02, 0.01, 1.0], 0.06),
        (Travel::X, -60.0, [-20.0, 22.0], [0.1, -0.15, 1.0], 0.3),
        (Travel::X, 210.0, [-20.0, 22.0], [-0.3, 0.25, 1.0], 0.7),
        (Travel::X, -390.0, [30.0, 5.0], [0.25, 0.6, 1.0], 0.2), // the horizon cuts the tube
        (Travel::Y, 10.0, [3.0, -8.0], [0.3, 0.05, 1.0], 0.05),
        (Travel::Y, -15.0, [3.0, -8.0], [0.02, 0.01, 1.0], 0.12),
        (Travel::Y, 4.0, [-30.0, 2.0], [0.0, 0.0, 1.0], 0.03),
        (Travel::Y, -300.0, [3.0, -8.0], [-0.1, 0.2, 1.0], 0.5),
    ];
    for (travel, position, at, n, m) in cases {
        let n = unit(n);
        let device = TubeDevice::new(TUBE, travel, 55.0);
        let (t, l) = if travel == Travel::X { (at[0], at[1]) } else { (at[1], at[0]) };
        let index = 1.45;
        for (lobe, limit) in [
            (Lobe::Beckmann, 1e-6),
            (Lobe::Ggx, 1e-6),
            (Lobe::CookTorrance { index }, 2e-5),
            (Lobe::GgxFresnel { index }, 5e-5),
        ] {
            let found = device.shown(&device.seen(position, t), l, n, Some(m), lobe);
            let exact = by_area(TUBE, travel, position, at, n, m, lobe);
            let errors = [
                found.diffuse / exact.diffuse - 1.0,
                (found.gloss - exact.gloss) / (exact.gloss + 1e-3 * exact.diffuse),
            ];
            println!(
                "{travel:?} {position} m {m} {lobe:?}: {:.3e} {:.3e}  errors {:.1e} {:.1e}",
                exact.diffuse, exact.gloss, errors[0], errors[1]
            );
            assert!(
                errors[0].abs() < 1e-6 && errors[1].abs() < limit,
                "{travel:?} {position} {m} {lobe:?}: {found:?} {exact:?}"
            );
        }
    }
}

/// A white texel straight under an infinite tube shows 1, and .977 under one of 500 mm at 100 mm height. The thin tube
/// agrees with its closed form.
#[test]
fn white_is_one() {
    let white = |tube: Tube, position: f64| {
        let device = TubeDevice::new(tube, Travel::X, 55.0);
        device.shown(&device.seen(position, 0.0), 0.0, [0.0, 0.0, 1.0], None, Lobe::Beckmann).diffuse
    };
    assert!((white(Tube { length_mm: 1e9, ..TUBE }, 0.0) - 1.0).abs() < 1e-9);
    assert!((white(Tube { length_mm: 1e9, radius_mm: 0.0, ..TUBE }, 0.0) - 1.0).abs() < 1e-9);
    assert!((white(Tube { radius_mm: 0.0, ..TUBE }, 0.0) - 0.977).abs() < 5e-4);
    for u in [-4.0, -1.3, 0.0, 2.5] {
        let r = f64::hypot(1.0, u);
        let phi = (2.5 / r).atan();
        let closed = 2.0 / PI / (r * r) * (phi + phi.sin() * phi.cos());
        assert!((white(Tube { radius_mm: 0.0, ..TUBE }, 100.0 * u) / closed - 1.0).abs() < 1e-12);
    }
}
