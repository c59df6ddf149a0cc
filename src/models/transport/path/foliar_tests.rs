//! Leaves by B1's models in the path tracer, compared with the exact method.

use super::{PathSettings, PathTracer, SamplingStrategy};
use crate::foliar::{FoliarMaterial, FoliarModel};
use crate::lobe::ReflectionLobe;
use crate::test_worlds::{leaf, square};
use crate::world::{ReferencePlacement, ReferenceSun, ReferenceWorld};
use glam::{DMat4, DVec3};
use mesophyll_optics::foliar::{LayeredLeaf, exact, fsm};
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::side::Side;
use std::sync::{Arc, LazyLock};

/// Absorption of red, green and blue light in a soybean leaf's mesophyll.
const DEPTHS: [f64; 3] = [0.89, 0.51, 1.9];

static SOYBEAN: LazyLock<FoliarMaterial> =
    LazyLock::new(|| FoliarMaterial::new(FoliarModel::Fsm, DEPTHS.map(LayeredLeaf::soybean)).expect("a plain leaf"));

fn alone(foliar: FoliarMaterial) -> ReferenceWorld {
    ReferenceWorld {
        leaves: vec![leaf(square(10.0), [0.0; 2], 0.0, None)],
        foliar: vec![Some(Arc::new(foliar))],
        instances: vec![ReferencePlacement { leaf: 0, transform: DMat4::IDENTITY }],
        ..ReferenceWorld::default()
    }
}

fn view(degrees: f64, below: bool) -> DVec3 {
    let at = degrees.to_radians();
    DVec3::new(100.0 * at.sin(), 0.0, 100.0 * at.cos() * if below { -1.0 } else { 1.0 })
}

/// Under light from everywhere, a leaf shows everything that it would reflect and transmit of light from the viewer.
#[test]
fn a_leaf_under_an_even_sky_shows_what_the_exact_method_says() {
    for model in [FoliarModel::Fsm, FoliarModel::Abm] {
        let world = ReferenceWorld { sky: Some([1.0; 3]), ..alone(SOYBEAN.by(model)) };
        let tracer = PathTracer::new(&world, PathSettings::default()).unwrap();
        for (degrees, below) in [(20.0, false), (65.0, false), (45.0, true)] {
            let eye = view(degrees, below);
            let seen = tracer.look(eye, -eye, 8192, 3);
            let side = if below { Side::Back } else { Side::Front };
            for (channel, depth) in DEPTHS.into_iter().enumerate() {
                let want = exact::response(&LayeredLeaf::soybean(depth), side, degrees.to_radians()).unwrap();
                let want = want.reflectance + want.transmittance;
                let found = seen.radiance[channel];
                assert!(found.error < 0.01, "{model:?} {degrees}: {found:?}");
                assert!((found.mean - want).abs() < 4.0 * found.error + 2e-4, "{model:?} {degrees}: {found:?}, {want}");
            }
        }
    }
}

/// Drawing by lights and drawing by lobes gives the same light, so the densities are those of the draws.
#[test]
fn lights_and_lobes_find_the_same_light() {
    let sun = Some(ReferenceSun { direction: DVec3::new(0.5, 0.2, 0.8), irradiance: [2.0; 3], radius: 0.3 });
    for (degrees, below) in [(30.0, false), (60.0, true)] {
        let world = ReferenceWorld { sun, ..alone(SOYBEAN.clone()) };
        let eye = view(degrees, below) * DVec3::new(-1.0, 1.0, 1.0);
        let [a, b, c] =
            [SamplingStrategy::Both, SamplingStrategy::Lights, SamplingStrategy::Surfaces].map(|strategy| {
                let tracer = PathTracer::new(&world, PathSettings { strategy, ..PathSettings::default() }).unwrap();
                tracer.look(eye, -eye, 16_384, 3).radiance[1]
            });
        for other in [b, c] {
            let error = a.error.hypot(other.error);
            assert!((a.mean - other.mean).abs() < 4.0 * error + 1e-6, "{a:?} {other:?}");
            assert!(other.error < 0.1 * other.mean, "{other:?}");
        }
    }
}

/// Where the sun stands behind the side that is seen, light that turns back before the mesophyll goes to the mirror's
/// side rather than to the sun's.
#[test]
fn light_from_below_leans_forward() {
    let sun = Some(ReferenceSun { direction: DVec3::new(0.7, 0.0, -0.7), irradiance: [1.0; 3], radius: 0.05 });
    let world = ReferenceWorld { sun, ..alone(SOYBEAN.clone()) };
    let tracer = PathTracer::new(&world, PathSettings::default()).unwrap();
    let [forward, back] = [-1.0, 1.0].map(|way| {
        let eye = view(50.0, true) * DVec3::new(way, 1.0, 1.0);
        tracer.look(eye, -eye, 4096, 3).radiance[1].mean
    });
    assert!(forward > 1.3 * back, "{forward} {back}");
}

/// The paper's trees of three rays give the same radiance, except for the light below the threshold. For a leaf alone,
/// two thirds of the first hit's rays meet nothing more.
#[test]
fn three_rays_a_hit_lose_only_what_is_cut() {
    let world = ReferenceWorld { sky: Some([1.0; 3]), ..alone(SOYBEAN.clone()) };
    let tracer = PathTracer::new(&world, PathSettings::default()).unwrap();
    let eye = view(35.0, false);
    let (radiance, rays) = tracer.branched(eye, -eye, fsm::CUT, 4000, 2);
    let want = tracer.look(eye, -eye, 8192, 3).radiance[1];
    assert!((radiance[1] - want.mean).abs() < 0.03 * want.mean, "{radiance:?} {want:?}");
    assert_eq!(rays, [1.0, 3.0]);
}

/// The stand-in for other renderers returns no more light than it gets, and a clear leaf absorbs nothing.
#[test]
fn the_stand_in_has_the_leafs_albedo() {
    let soybean = SOYBEAN.stand_in();
    let clear = FoliarMaterial::new(FoliarModel::Fsm, [LayeredLeaf::soybean(0.0); 3]).unwrap().stand_in();
    let leaf = LayeredLeaf::soybean(0.0);
    // ∫ 2 sin θ cos θ of the light that the faces mirror, and of the gloss that represents it.
    let squares: Vec<f64> = (0..200).map(|k| (1.0 - (f64::from(k) + 0.5) / 200.0).sqrt()).collect();
    let mean = |of: &dyn Fn(f64) -> f64| squares.iter().map(|cos| of(*cos)).sum::<f64>() / 200.0;
    let faces = mean(&|cos| leaf.surface_reflectance(cos.acos()));
    for shown in [soybean, clear] {
        let lobe = Lobe::CookTorrance { index: shown.index };
        let gloss = mean(&|cos| shown.rho_s[1] * lobe.directional_albedo(cos, shown.m));
        assert_eq!(shown.rho_s, [shown.rho_s[1]; 3]);
        // The nearest gloss lacks a fifth of the light that the faces mirror, most of it at grazing angles, and adds
        // none.
        assert!(gloss < faces && gloss > 0.75 * faces, "{gloss} {faces}");
        for c in 0..3 {
            for rho_d in shown.rho_d.map(|side| side[c]) {
                assert!(rho_d > 0.0 && shown.rho_t[c] > 0.0, "{shown:?}");
                assert!(rho_d + shown.rho_t[c] + faces <= 1.0 + 1e-4, "{shown:?}");
            }
        }
    }
    // From above all light continues. From below, the transmittance is limited because it is the same in both
    // directions.
    assert!(clear.rho_d[0][1] + clear.rho_t[1] + faces > 0.999, "{clear:?} {faces}");
    assert!(clear.rho_d[1][1] + clear.rho_t[1] + faces > 0.97, "{clear:?} {faces}");
    assert!(soybean.rho_d[1][1] > 3.0 * soybean.rho_d[0][1]);
}
