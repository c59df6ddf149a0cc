//! Derivatives along paths are compared with those of closed forms, and with differences of radiance.

use super::slopes::{DerivativeTracer, RadianceParameter};
use super::tests::BOTH;
use super::*;
use crate::camera::ReferenceCamera;
use crate::test_worlds::{leaf, plates, square};
use crate::world::{ReferencePlacement, ReferenceSun};
use glam::DMat4;
use std::sync::Arc;

/// Means and standard errors of the green channel's radiance and derivatives along a line of sight, over rounds.
fn along(world: &ReferenceWorld, of: &[RadianceParameter], from: DVec3, to: DVec3, paths: u32) -> Vec<(f64, f64)> {
    let tracer = PathTracer::new(world, BOTH).unwrap();
    let slopes = DerivativeTracer::new(&tracer, of);
    let camera = ReferenceCamera { eye: from, target: to, up: DVec3::new(0.3, 0.8, 0.1), fov_y_deg: 1e-6 };
    let rounds: Vec<Vec<f64>> = (0..16)
        .map(|k| {
            let sheet = slopes.picture(&camera, [1, 1], [8, paths / 128], k).unwrap();
            std::iter::once(sheet.mean[0][1]).chain(sheet.slopes.iter().map(|s| s[1])).collect()
        })
        .collect();
    (0..=of.len())
        .map(|q| {
            let mean = rounds.iter().map(|r| r[q]).sum::<f64>() / 16.0;
            let spread = rounds.iter().map(|r| (r[q] - mean).powi(2)).sum::<f64>() / 15.0;
            (mean, (spread / 16.0).sqrt())
        })
        .collect()
}

/// The radiance above two wide plates, by the reflectances of facing sides and by the transmittances: ρ₁ of the upper
/// plate's front and back, τ₁, ρ₂ of the lower plate's front, τ₂.
fn above([front, back, tau1, rho2, tau2]: [f64; 5]) -> f64 {
    let down = (tau1 + back * tau2) / (1.0 - back * rho2);
    front + tau1 * (rho2 * down + tau2)
}

#[test]
fn plates_have_the_derivatives_of_their_closed_form() {
    // Also black ones, whose derivatives no division by a reflectance could give.
    for at in [[0.3, 0.2, 0.35, 0.45, 0.4], [0.0, 0.0, 0.35, 0.0, 0.4], [0.2, 0.5, 0.0, 0.6, 0.0]] {
        let [front, back, tau1, rho2, tau2] = at;
        let mut world = plates(1e7, &[(20.0, [front, back], tau1), (0.0, [rho2, 0.5], tau2)]);
        world.sky = Some([1.0; 3]);
        let of = [
            RadianceParameter::RhoD { leaf: 0, back: false },
            RadianceParameter::RhoD { leaf: 0, back: true },
            RadianceParameter::RhoT(0),
            RadianceParameter::RhoD { leaf: 1, back: false },
            RadianceParameter::RhoT(1),
            RadianceParameter::Light { sky: Some(Arc::new(|_| [1.0; 3])), sun: [0.0; 3] },
        ];
        let found = along(&world, &of, DVec3::new(3.0, 5.0, 90.0), DVec3::new(0.0, 0.0, 20.0), 1 << 16);
        let slope = |k: usize| {
            let moved = |h: f64| above(std::array::from_fn(|j| at[j] + if j == k { h } else { 0.0 }));
            (moved(1e-6) - moved(-1e-6)) / 2e-6
        };
        let want = [above(at), slope(0), slope(1), slope(2), slope(3), slope(4), above(at)];
        for (k, ((mean, error), want)) in found.into_iter().zip(want).enumerate() {
            assert!((mean - want).abs() <= 4.0 * error + 1e-5, "{at:?}, {k}: {mean} ± {error}, expected {want}");
            assert!(error <= 0.02, "{k}: ± {error}");
        }
    }
}

/// A crowd of glossy leaves over a ground, under a sun and a sky: each derivative against the difference of two
/// radiances that were traced without any.
#[test]
fn sun_gloss_and_ground_agree_with_differences() {
    let world = |x: [f64; 6]| {
        let [rho, tau, rho_s, m, ground, sun] = x;
        let mut world = plates(10.0, &[]);
        world.leaves =
            vec![leaf(square(40.0), [rho, 0.3], tau, Some((rho_s, m))), leaf(square(400.0), [ground, 0.0], 0.0, None)];
        for k in 0..6 {
            let f = f64::from(k);
            let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.5 * f.sin(), 0.4 * f.cos(), f);
            let at = DVec3::new(25.0 * (2.1 * f).sin(), 25.0 * (1.3 * f).cos(), 20.0 + 8.0 * f);
            world.instances.push(ReferencePlacement { leaf: 0, transform: DMat4::from_rotation_translation(turn, at) });
        }
        world.instances.push(ReferencePlacement { leaf: 1, transform: DMat4::IDENTITY });
        let direction = DVec3::new(0.3, -0.4, 0.8);
        world.sun = Some(ReferenceSun { direction, irradiance: [sun; 3], radius: 0.1 });
        world.sky = Some([0.4; 3]);
        world
    };
    let at = [0.25, 0.2, 0.06, 0.35, 0.3, 3.0];
    let of = [
        RadianceParameter::RhoD { leaf: 0, back: false },
        RadianceParameter::RhoT(0),
        RadianceParameter::RhoS(0),
        RadianceParameter::Slope(0),
        RadianceParameter::RhoD { leaf: 1, back: false },
        RadianceParameter::Light { sky: None, sun: [1.0; 3] },
    ];
    let (from, to) = (DVec3::new(30.0, 60.0, 300.0), DVec3::new(3.0, 2.0, 40.0));
    let found = along(&world(at), &of, from, to, 1 << 15);
    let mean = |x: [f64; 6]| {
        let seen = PathTracer::new(&world(x), BOTH).unwrap().look(from, to - from, 1 << 17, 3).radiance[1];
        (seen.mean, seen.error)
    };
    let (plain, error) = mean(at);
    assert!((found[0].0 - plain).abs() <= 4.0 * (found[0].1.hypot(error)), "{:?} {plain}", found[0]);
    for k in 0..6 {
        let step = 0.1 * at[k];
        let moved = |h: f64| mean(std::array::from_fn(|j| at[j] + if j == k { h } else { 0.0 }));
        let ((high, a), (low, b)) = (moved(step), moved(-step));
        let (want, noise) = ((high - low) / (2.0 * step), a.hypot(b) / (2.0 * step));
        let (mean, error) = found[k + 1];
        // The radiance is nearly linear in each number within a tenth, but for m.
        let curved = if k == 3 { 0.03 } else { 0.003 } * want.abs();
        assert!((mean - want).abs() <= 4.0 * error.hypot(noise) + curved, "{k}: {mean} ± {error}, {want} ± {noise}");
    }
}
