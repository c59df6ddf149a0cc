//! Bands that share their paths are compared with the three channels, and with closed forms.

use super::bands::SurfaceBands;
use super::canopy::Canopy;
use super::estimate::Estimate;
use crate::lobe::Lobe;
use crate::test_worlds::{plates, square};
use crate::world::{ReferenceGloss, ReferenceLeaf, ReferencePlacement, ReferenceSide, ReferenceSun, ReferenceWorld};
use glam::{DMat4, DQuat, DVec3};

pub(super) const PERIOD: f64 = 100.0;

pub(super) fn sunlit(mut world: ReferenceWorld) -> ReferenceWorld {
    world.periodic = Some([PERIOD; 2]);
    let direction = DVec3::new(0.4, 0.1, 0.9);
    world.sun = Some(ReferenceSun { direction, irradiance: [2.0, 0.5, 1.0], radius: 0.0 });
    world
}

/// Leaves with a gloss over a ground, where all three channels differ.
pub(super) fn crown() -> ReferenceWorld {
    let mut world = plates(1.0, &[]);
    let gloss = || Some(ReferenceGloss::even([0.04; 3], 0.3));
    let side = |rho_d, gloss| ReferenceSide::even(rho_d, [0.05, 0.3, 0.45], gloss);
    let leaf = ReferenceLeaf::even(
        square(12.0),
        [side([0.04, 0.2, 0.5], gloss()), side([0.08, 0.1, 0.4], gloss())],
        Lobe::Beckmann,
    );
    world.leaves = vec![leaf, ReferenceLeaf::opaque(square(0.5 * PERIOD), [0.1, 0.2, 0.3])];
    for k in 0..24 {
        let f = f64::from(k);
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.9 * f.sin(), 0.8 * (2.0 * f).cos(), f);
        let at = DVec3::new(45.0 * (2.1 * f).sin(), 45.0 * (1.3 * f).cos(), 12.0 + 1.7 * f);
        world.instances.push(ReferencePlacement { leaf: 0, transform: DMat4::from_rotation_translation(turn, at) });
    }
    world.instances.push(ReferencePlacement { leaf: 1, transform: DMat4::IDENTITY });
    sunlit(world)
}

/// The bands that a world's three channels are, as the world holds them.
pub(super) fn channels(world: &ReferenceWorld) -> Vec<SurfaceBands> {
    let list = |maps: &[Vec<f32>; 3]| maps.iter().map(|map| f64::from(map[0])).collect::<Vec<f64>>();
    let of = |leaf: &ReferenceLeaf| {
        let [front, back] = [&leaf.front, &leaf.back].map(|side| match &side.interior {
            crate::ReferenceInterior::Maps { rho_d, rho_t } => (list(rho_d), list(rho_t)),
            crate::ReferenceInterior::Scalars { .. } => panic!("a leaf that is the same everywhere"),
        });
        SurfaceBands { rho_d: [front.0, back.0], rho_t: front.1 }
    };
    world.leaves.iter().map(of).collect()
}

#[test]
fn three_bands_are_the_three_channels() {
    let world = crown();
    let canopy = Canopy::new(&world, 5).unwrap();
    for toward in [[0.0, 0.0], [0.9, 2.0], [-0.5, 0.3]] {
        let bands = canopy.brf_of_bands(toward, &channels(&world), 3, 2048).unwrap();
        for (c, band) in bands.iter().enumerate() {
            let Estimate { mean, error } = canopy.brf(toward, c, 2048);
            assert!(mean > 0.0 && error > 0.0);
            assert!((band.mean - mean).abs() < 1e-9 * mean, "{c}: {band:?} {mean}");
            assert!((band.error - error).abs() < 1e-6 * error, "{c}: {band:?} {error}");
        }
    }
    // Equal bands, as many as do not fit side by side, have equal answers: those of a channel alone.
    let grey = |list: &[f64]| vec![list[2]; 11];
    let same: Vec<SurfaceBands> = channels(&world)
        .iter()
        .map(|s| SurfaceBands { rho_d: [grey(&s.rho_d[0]), grey(&s.rho_d[1])], rho_t: grey(&s.rho_t) })
        .collect();
    let bands = canopy.brf_of_bands([0.9, 2.0], &same, 11, 8192).unwrap();
    let Estimate { mean, error } = canopy.brf([0.9, 2.0], 2, 8192);
    assert!(bands.iter().all(|band| band == &bands[0]), "{bands:?}");
    assert!((bands[0].mean - mean).abs() < 4.0 * bands[0].error.hypot(error), "{:?} {mean} ± {error}", bands[0]);
}

#[test]
fn fluxes_of_three_bands_are_those_of_the_three_channels() {
    let mut world = crown();
    world.ground = Some(world.instances.len() - 1);
    let canopy = Canopy::new(&world, 5).unwrap();
    let bands = canopy.fluxes_of_bands(&channels(&world), 3, 4096).unwrap();
    for (c, band) in bands.iter().enumerate() {
        let want = canopy.fluxes(c, 4096);
        let pairs = [
            (band.reflected, want.reflected),
            (band.absorbed, want.absorbed),
            (band.transmitted, want.transmitted),
            (band.closure, want.closure),
        ];
        for (found, want) in pairs {
            assert!(want.mean > 0.01 && want.error > 0.0);
            assert!((found.mean - want.mean).abs() < 1e-6 * want.mean, "{c}: {found:?} {want:?}");
        }
        assert!((band.closure.mean - 1.0).abs() < 4.0 * band.closure.error, "{:?}", band.closure);
    }
    // Light between a plate and the ground, relative to what falls on the plate.
    let mut world = sunlit(plates(0.5 * PERIOD, &[(30.0, [0.4, 0.4], 0.3), (0.0, [0.3, 0.0], 0.0)]));
    world.ground = Some(1);
    let of = [[0.0, 0.0, 0.0], [0.4, 0.35, 0.3], [0.5, 0.4, 0.9]];
    let list = |k: usize| of.iter().map(|band| band[k]).collect::<Vec<f64>>();
    let surfaces = [SurfaceBands { rho_d: [list(0), list(0)], rho_t: list(1) }, SurfaceBands::opaque(list(2))];
    let found = Canopy::new(&world, 1).unwrap().fluxes_of_bands(&surfaces, of.len(), 1 << 15).unwrap();
    for (found, [rho, tau, ground]) in found.iter().zip(of) {
        let down = tau / (1.0 - rho * ground);
        let want = [rho + tau * ground * down, (1.0 - rho - tau) * (1.0 + ground * down), down];
        let found = [found.reflected, found.absorbed, found.transmitted];
        for (Estimate { mean, error }, want) in found.into_iter().zip(want) {
            assert!((mean - want).abs() <= 4.0 * error + 1e-9, "{rho} {tau}: {mean} ± {error}, {want}");
        }
    }
}

/// A plate that lets light through, over a ground: black and white bands beside each other, bands that only reflect or
/// only let through, and one odd band among many.
#[test]
fn bands_meet_their_closed_forms() {
    // ρ, τ, and the ground's albedo. Where nothing is absorbed, all light comes back, however often it turned.
    let mut of = vec![
        [0.0, 0.0, 0.0],
        [0.6, 0.4, 1.0],
        [1.0, 0.0, 0.5],
        [0.0, 1.0, 0.5],
        [0.4, 0.35, 0.3],
        [0.0, 0.9, 1.0],
        [0.02, 0.01, 0.1],
    ];
    of.extend(vec![[0.3, 0.0, 0.2]; 30]);
    let world = sunlit(plates(0.5 * PERIOD, &[(30.0, [0.4, 0.4], 0.3), (0.0, [0.3, 0.0], 0.0)]));
    let list = |k: usize| of.iter().map(|band| band[k]).collect::<Vec<f64>>();
    let surfaces = [SurfaceBands { rho_d: [list(0), list(0)], rho_t: list(1) }, SurfaceBands::opaque(list(2))];
    let canopy = Canopy::new(&world, 1).unwrap();
    for toward in [[0.0, 0.0], [1.0, 2.0]] {
        let found = canopy.brf_of_bands(toward, &surfaces, of.len(), 1 << 15).unwrap();
        for (Estimate { mean, error }, [rho, tau, ground]) in found.iter().zip(&of) {
            // Light on the ground, relative to what falls on the plate.
            let down = tau / (1.0 - rho * ground);
            let want = rho + tau * ground * down;
            assert!(*error <= 0.02 * want, "{rho} {tau} {ground}: ± {error}");
            assert!((mean - want).abs() <= 4.0 * error + 1e-9, "{rho} {tau} {ground}: {mean} ± {error}, {want}");
        }
        assert_eq!(found[0], Estimate { mean: 0.0, error: 0.0 });
    }
}

#[test]
fn what_has_no_bands_is_refused() {
    let world = crown();
    let canopy = Canopy::new(&world, 5).unwrap();
    let [leaf, ground] = &channels(&world)[..] else { panic!("two surfaces") };
    let refused = |surfaces: &[SurfaceBands], bands: usize, words: &str| {
        let told = canopy.brf_of_bands([0.0, 0.0], surfaces, bands, 32).unwrap_err();
        assert!(told.contains(words), "{told}");
    };
    refused(std::slice::from_ref(leaf), 3, "1 surfaces have bands, expected 2");
    refused(&[leaf.clone(), ground.clone()], 4, "surface 0 has 3 bands, expected 4");
    let mut shiny = crown();
    shiny.leaves[0].back.gloss = Some(ReferenceGloss::even([0.04, 0.05, 0.04], 0.3));
    let told = Canopy::new(&shiny, 5).unwrap().brf_of_bands([0.0, 0.0], &channels(&shiny), 3, 32).unwrap_err();
    assert!(told.contains("differs between channels"), "{told}");
}
