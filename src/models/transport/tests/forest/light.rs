//! Plants that are stored once give the light that they give leaf by leaf.

use glam::{DMat4, DQuat, DVec2, DVec3};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_transport::lobe::Lobe;
use mesophyll_transport::path::{Canopy, PathSettings, PathTracer};
use mesophyll_transport::{
    Options, ReferenceCamera, ReferenceGloss, ReferenceLeaf, ReferencePlace, ReferencePlacement, ReferenceRenderer,
    ReferenceSide, ReferenceSun, ReferenceWorld, shown,
};

/// A level square of this half width, with ρd of its two sides, ρt, and gloss by ρs and m.
fn leaf(reach: f64, rho_d: [f64; 2], rho_t: f64, gloss: Option<(f64, f64)>) -> ReferenceLeaf {
    let at = |x: f64, y: f64| DVec3::new(x * reach, y * reach, 0.0);
    let mesh = LeafMesh {
        positions: vec![at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)],
        normals: vec![DVec3::Z; 4],
        uvs: vec![DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y],
        indices: vec![0, 1, 2, 0, 2, 3],
        ..LeafMesh::default()
    };
    let gloss = || gloss.map(|(rho_s, m)| ReferenceGloss::even([rho_s; 3], m));
    let sides = rho_d.map(|rho_d| ReferenceSide::even([rho_d; 3], [rho_t; 3], gloss()));
    ReferenceLeaf::even(mesh, sides, Lobe::Beckmann)
}

/// Numbers from 0 to 1 that look random.
fn scattered(k: usize) -> f64 {
    (k as f64 * 0.754_877_666 + 0.13).fract()
}

/// Two plants of glossy and of matte leaves at 40 places above a ground.
fn grouped() -> ReferenceWorld {
    let leaves = vec![
        leaf(1.0, [0.3, 0.5], 0.2, Some((0.05, 0.3))),
        leaf(0.7, [0.6, 0.2], 0.3, None),
        leaf(50.0, [0.4, 0.0], 0.0, None),
    ];
    let member = |k: usize| {
        let at = [3, 5, 7].map(|step| 6.0 * scattered(step * k) - 3.0);
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, k as f64, 2.1 * k as f64, 0.7 * k as f64);
        let transform = DMat4::from_rotation_translation(turn, DVec3::from(at) + DVec3::Z * 4.0);
        ReferencePlacement { leaf: k % 2, transform }
    };
    let place = |k: usize| {
        let at = DVec3::new(80.0 * scattered(2 * k) - 40.0, 80.0 * scattered(5 * k + 1) - 40.0, 0.0);
        let scale = DVec3::splat(0.5 + scattered(11 * k));
        let turn = DQuat::from_rotation_z(k as f64);
        ReferencePlace { group: k % 2, transform: DMat4::from_scale_rotation_translation(scale, turn, at) }
    };
    ReferenceWorld {
        leaves,
        instances: vec![ReferencePlacement { leaf: 2, transform: DMat4::IDENTITY }],
        groups: vec![(0..30).map(member).collect(), (30..50).map(member).collect()],
        places: (0..40).map(place).collect(),
        ground: Some(0),
        sun: Some(ReferenceSun { direction: DVec3::new(0.3, 0.2, 0.9), irradiance: [3.0; 3], radius: 0.005 }),
        sky: Some([0.4; 3]),
        ..ReferenceWorld::default()
    }
}

/// The same with each leaf as an instance of its own.
fn leaf_by_leaf(world: &ReferenceWorld) -> ReferenceWorld {
    let mut out = world.clone();
    (out.groups, out.places) = (Vec::new(), Vec::new());
    for place in &world.places {
        out.instances.extend(
            world.groups[place.group]
                .iter()
                .map(|member| ReferencePlacement { leaf: member.leaf, transform: place.transform * member.transform }),
        );
    }
    out
}

/// With equal random numbers, lines of sight bring equal light. At an edge, rounding may let a path miss what another
/// hits; one line in twenty may be such.
#[test]
fn equal_random_numbers_bring_equal_light() {
    let world = grouped();
    let flat = leaf_by_leaf(&world);
    let tracers = [&world, &flat].map(|world| PathTracer::new(world, PathSettings::default()).unwrap());
    let (mut other, mut brightest) = (0, 0.0f64);
    for k in 0..60 {
        let eye = DVec3::new(-70.0, 120.0 * scattered(3 * k) - 60.0, 25.0);
        let at = DVec3::new(60.0 * scattered(7 * k) - 30.0, 60.0 * scattered(k) - 30.0, 3.0);
        let [a, b] = tracers.each_ref().map(|tracer| tracer.look(eye, at - eye, 64, 5).radiance[1]);
        brightest = brightest.max(a.mean);
        other += usize::from((a.mean - b.mean).abs() > 1e-6 * a.mean);
        assert!((a.mean - b.mean).abs() <= 4.0 * a.error.hypot(b.error), "{a:?} {b:?}");
    }
    assert!(other <= 3 && brightest > 0.1, "{other} of 60 differ, the brightest is {brightest}");
}

/// A world that repeats, whose plants reach over the border of its cell.
#[test]
fn a_canopy_reflects_as_leaf_by_leaf() {
    let mut world = grouped();
    (world.sky, world.periodic) = (None, Some([70.0, 60.0]));
    world.leaves[2] = leaf(35.0, [0.4, 0.0], 0.0, None);
    let flat = leaf_by_leaf(&world);
    let canopies = [&world, &flat].map(|world| Canopy::new(world, 3).unwrap());
    for toward in [[0.0, 0.0], [0.6, 1.0], [1.1, 4.0]] {
        let [a, b] = canopies.each_ref().map(|canopy| canopy.brf(toward, 1, 8192));
        assert!((a.mean - b.mean).abs() <= 4.0 * a.error.hypot(b.error), "{toward:?}: {a:?} {b:?}");
        assert!(a.error < 0.02 * a.mean && a.mean > 0.05, "{a:?}");
    }
    let [a, b] = canopies.each_ref().map(|canopy| canopy.fluxes(1, 8192));
    assert!((a.transmitted.mean - b.transmitted.mean).abs() <= 4.0 * a.transmitted.error.hypot(b.transmitted.error));
    assert!((a.closure.mean - 1.0).abs() < 5.0 * a.closure.error + 1e-3, "{a:?}");
}

/// The direct-light reference draws the same picture, and tells leaves apart where they were told apart.
#[test]
fn the_direct_reference_draws_the_same_picture() {
    let world = grouped();
    let flat = leaf_by_leaf(&world);
    let camera =
        ReferenceCamera { eye: DVec3::new(-70.0, 10.0, 30.0), target: DVec3::Z, up: DVec3::Z, fov_y_deg: 40.0 };
    let options = Options { samples_per_pixel: 1, sun_samples: 1, sky_samples: 1, seed: 4, margin: 1 };
    let of = |world| ReferenceRenderer::new(world).unwrap().render(&camera, 60, 40, &options).unwrap();
    let (a, b) = (of(&world), of(&flat));
    let differs = |(a, b): &(&[f32; 4], &[f32; 4])| (0..4).any(|c| (a[c] - b[c]).abs() > 1e-5 * b[c].abs());
    assert!(a.hdr.iter().zip(&b.hdr).filter(differs).count() <= 5);
    assert!(a.interior.iter().zip(&b.interior).filter(|(a, b)| a != b).count() <= 5);
    // The ground, and members of both groups.
    let seen = shown(&world, &[camera], [60, 40]).unwrap();
    assert!(seen.len() == 51 && seen[0] && seen[1..31].contains(&true) && seen[31..].contains(&true));
}

/// A group or a leaf that is not there, and a place without an inverse.
#[test]
fn broken_groups_are_refused() {
    let refused = |change: &dyn Fn(&mut ReferenceWorld), what: &str| {
        let mut world = grouped();
        change(&mut world);
        let told = world.validate().unwrap_err().to_string();
        assert!(told.contains(what), "{told}");
    };
    refused(&|w| w.places[3].group = 2, "place 3: group 2 wanted, the scene has 2");
    refused(&|w| w.places[4].transform = DMat4::ZERO, "place 4: the transform cannot be inverted");
    refused(&|w| w.groups[1][0].leaf = 9, "instance 31: leaf 9 wanted, the scene has 3");
    refused(&|w| w.periodic = Some([1e-3, 1e-3]), "copies of what stands there");
}
