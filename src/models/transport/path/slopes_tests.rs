//! Derivatives along paths are compared with those of closed forms, and with differences of radiance.

use super::slopes::{DerivativeTracer, RadianceParameter};
use super::tests::BOTH;
use super::*;
use crate::camera::ReferenceCamera;
use crate::foliar::{FoliarMaterial, FoliarModel};
use crate::lobe::ReflectionLobe;
use crate::test_worlds::{leaf, plates, square};
use crate::world::{
    ReferenceGloss, ReferenceInterior, ReferenceLeaf, ReferencePlacement, ReferenceSide, ReferenceSun, SlabAt,
};
use glam::DMat4;
use mesophyll_optics::foliar::{LayeredLeaf, exact};
use mesophyll_optics::side::Side;
use mesophyll_optics::slab;
use std::sync::Arc;

/// Means and standard errors of the green channel's radiance and derivatives along a line of sight, over rounds.
fn along(world: &ReferenceWorld, of: &[RadianceParameter], from: DVec3, to: DVec3, paths: u32) -> Vec<(f64, f64)> {
    let tracer = PathTracer::new(world, BOTH).unwrap();
    let slopes = DerivativeTracer::new(&tracer, of);
    let camera = ReferenceCamera { eye: from, target: to, up: DVec3::new(0.3, 0.8, 0.1), fov_y_deg: 1e-6 };
    let rounds: Vec<Vec<f64>> = (0..16)
        .map(|k| {
            let sheet = slopes.picture(&camera, [1, 1], [8, paths / 128], k).unwrap();
            std::iter::once(sheet.mean[1]).chain((0..of.len()).map(|k| sheet.slope(0, k, 1))).collect()
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

/// One leaf in the middle of a sky of radiance 1.
fn alone(leaf: ReferenceLeaf, foliar: Option<FoliarMaterial>) -> ReferenceWorld {
    let mut world = plates(1.0, &[(0.0, [0.0; 2], 0.0)]);
    (world.leaves[0], world.foliar, world.sky) = (leaf, vec![foliar.map(Arc::new)], Some([1.0; 3]));
    world
}

/// Half steps of the numbers of [`mapped`].
const STEPS: [f64; 6] = [0.01, 0.01, 0.002, 0.01, 0.05, 0.01];

/// Both sides of a leaf with maps of γ, thickness and gloss whose tissue is a slab: by factors on σa and σs, an
/// addition to the thickness, and factors on γ, ρs and m, or their derivatives by one of these numbers.
fn mapped([sigma_a, sigma_s, more, gamma, shine, rough]: [f64; 6], by: Option<usize>) -> [ReferenceSide; 2] {
    let (a, s) = ([1.6, 0.7, 3.0], [9.0, 11.0, 8.0]);
    let curve: SlabAt = Arc::new(move |h| {
        let all = [0, 1, 2].map(|c| {
            let (at, slope) = slab::response_with_partials(a[c] * sigma_a, s[c] * sigma_s, h + more);
            match by {
                Some(0) => [slope.sigma_a.rho_d * a[c], slope.sigma_a.rho_t * a[c]],
                Some(1) => [slope.sigma_s.rho_d * s[c], slope.sigma_s.rho_t * s[c]],
                Some(2) => [slope.thickness.rho_d, slope.thickness.rho_t],
                Some(3) => [at.rho_d, 0.0],
                Some(_) => [0.0; 2],
                None => [at.rho_d, at.rho_t],
            }
        });
        (all.map(|v| v[0]), all.map(|v| v[1]))
    });
    let texels = |v: [f64; 4], by: f64| v.map(|v| (v * by) as f32).to_vec();
    let [of_gamma, of_shine, of_m] = match by {
        None => [gamma, shine, rough],
        Some(4) => [gamma, 1.0, 0.0],
        Some(5) => [gamma, 0.0, 1.0],
        Some(3) => [1.0, 0.0, 0.0],
        Some(_) => [gamma, 0.0, 0.0],
    };
    [1.0, 1.3].map(|side| ReferenceSide {
        interior: ReferenceInterior::Scalars {
            gamma: [0, 1, 2].map(|c| texels([0.9, 1.1, 0.8 + 0.1 * f64::from(c), 1.2], of_gamma)),
            thickness: texels([0.2, 0.25, 0.3, 0.18], side),
            curve: curve.clone(),
        },
        gloss: Some(ReferenceGloss {
            rho_s: [0, 1, 2].map(|_| texels([0.04, 0.06, 0.05, 0.03], side * of_shine)),
            m: texels([0.3, 0.35, 0.4, 0.3], of_m),
        }),
        normal: None,
    })
}

/// A leaf with maps in a sky of radiance 1 shows ρd + ρt + ρs a(μ, m), with all of them as its maps say there.
#[test]
fn numbers_of_maps_have_the_derivatives_of_a_sheet() {
    let at = [1.1, 0.9, 0.01, 0.95, 1.2, 1.05];
    let blade = |x: [f64; 6]| {
        let ([front, back], even) = (mapped(x, None), leaf(square(40.0), [0.0; 2], 0.0, None));
        ReferenceLeaf { width: 2, height: 2, front, back, ..even }
    };
    let of: Vec<RadianceParameter> =
        (0..6).map(|k| RadianceParameter::Look { leaf: 0, sides: Arc::new(mapped(at, Some(k))) }).collect();
    for from in [DVec3::new(30.0, 60.0, 90.0), DVec3::new(-40.0, 20.0, -70.0)] {
        let to = DVec3::new(7.0, -12.0, 0.0);
        let found = along(&alone(blade(at), None), &of, from, to, 1 << 15);
        let shown = |x: [f64; 6]| {
            let world = alone(blade(x), None);
            let stage = crate::stage::Stage::new(&world);
            let met = stage.nearest(&Ray::new(from, (to - from).normalize())).unwrap();
            let surface = stage.surface(&met, SideBy::Triangle);
            let (rho_s, m) = surface.gloss().unwrap();
            let mirrored = crate::lobe::Lobe::Beckmann.directional_albedo(surface.normal().dot(surface.view), m);
            surface.rho_d()[1] + surface.rho_t()[1] + rho_s[1] * mirrored
        };
        for k in 0..6 {
            let [low, high] =
                [-1.0, 1.0].map(|s| shown(std::array::from_fn(|j| at[j] + if j == k { s * STEPS[k] } else { 0.0 })));
            let (want, (mean, error)) = ((high - low) / (2.0 * STEPS[k]), found[k + 1]);
            assert!((mean - want).abs() <= 4.0 * error + 2e-3 * want.abs(), "{k}: {mean} ± {error}, expected {want}");
            assert!(error <= 0.02 * want.abs().max(0.05), "{k}: ± {error} of {want}");
        }
    }
}

/// A leaf of layers in a sky of radiance 1 shows all that it reflects and lets through. Its derivative by a content
/// that absorbs in all channels is compared with differences of the exact method.
#[test]
fn absorptions_of_layers_have_the_derivatives_of_a_sheet() {
    let (depths, by, step) = ([0.3, 0.1, 0.6], [1.0, 0.3, 2.0], 0.01);
    let at = |h: f64| [0, 1, 2].map(|c| depths[c] + by[c] * h);
    let of = [RadianceParameter::Depth { leaf: 0, by }];
    let [made, other] = [depths, at(0.1)].map(|d| FoliarMaterial::new(FoliarModel::Fsm, d.map(LayeredLeaf::soybean)));
    let (made, other) = (made.unwrap(), other.unwrap());
    for model in [FoliarModel::Fsm, FoliarModel::Abm] {
        let made = made.by(model);
        // The view is of a whole degree, where the table of FSM has a row.
        for (zenith, side) in [(40f64, Side::Front), (65.0, Side::Back)] {
            let up = if side == Side::Front { 1.0 } else { -1.0 };
            let (sin, cos) = zenith.to_radians().sin_cos();
            let world = alone(leaf(square(40.0), [0.0; 2], 0.0, None), made.with_depths(depths));
            let found = along(&world, &of, DVec3::new(50.0 * sin, 0.0, 50.0 * cos * up), DVec3::ZERO, 1 << 15);
            let shown = |h: f64| {
                let seen = exact::response(&LayeredLeaf::soybean(at(h)[1]), side, zenith.to_radians()).unwrap();
                seen.reflectance + seen.transmittance
            };
            let want = (shown(step) - shown(-step)) / (2.0 * step);
            let (mean, error) = found[1];
            assert!(
                (mean - want).abs() <= 4.0 * error + 2e-3 * want.abs(),
                "{model:?} {side:?}: {mean} ± {error}, {want}"
            );
            assert!(error <= 0.01 * want.abs(), "{model:?}: ± {error} of {want}");
        }
    }
    // Other absorptions than those it was made with give the leaf that is made with them.
    let again = made.with_depths(other.depths()).unwrap();
    for back in [false, true] {
        let view = DVec3::new(0.6, 0.0, 0.8);
        let [a, b] = [&again, &other].map(|leaf| leaf.meet(view, DVec3::Z, back));
        for c in 0..3 {
            assert!((a.diffuse[c] - b.diffuse[c]).abs() < 1e-4 && (a.through[c] - b.through[c]).abs() < 1e-9);
        }
    }
}
