//! Scenes whose visibility is known in closed form, and helpers for the tests of this folder.

use super::{AreaLight, ShadowReceivers, ShadowScene};
use crate::lobe::Lobe;
use crate::world::{ReferenceInterior, ReferenceLeaf, ReferencePlacement, ReferenceSide, ReferenceWorld};
use glam::{DMat4, DQuat, DVec2, DVec3};
use mesophyll_files::mesh::LeafMesh;
use std::f64::consts::PI;

/// The sun's angular radius (rad).
const SUN: f64 = 0.00465;

/// A level rectangle around the origin with its front up, in `nx` by `ny` pieces.
pub(super) fn grid(width: f64, height: f64, nx: u32, ny: u32) -> LeafMesh {
    let mut mesh = LeafMesh::default();
    for j in 0..=ny {
        for i in 0..=nx {
            let uv = DVec2::new(f64::from(i) / f64::from(nx), f64::from(j) / f64::from(ny));
            mesh.positions.push(DVec3::new((uv.x - 0.5) * width, (0.5 - uv.y) * height, 0.0));
            mesh.normals.push(DVec3::Z);
            mesh.uvs.push(uv);
        }
    }
    for j in 0..ny {
        for i in 0..nx {
            let a = j * (nx + 1) + i;
            let below = a + nx + 1;
            mesh.indices.extend([a, below, a + 1, a + 1, below, below + 1]);
        }
    }
    mesh
}

pub(super) fn leaf(mesh: LeafMesh) -> ReferenceLeaf {
    outlined(mesh, 1, 1, None)
}

/// A black leaf with an outline.
pub(super) fn outlined(mesh: LeafMesh, width: usize, height: usize, mask: Option<Vec<u8>>) -> ReferenceLeaf {
    let none = || [0, 1, 2].map(|_| vec![0.0; width * height]);
    let side = || ReferenceSide {
        interior: ReferenceInterior::Maps { rho_d: none(), rho_t: none() },
        gloss: None,
        normal: None,
    };
    ReferenceLeaf { mesh, width, height, front: side(), back: side(), mask, lobe: Lobe::Beckmann }
}

/// A world with each mesh once, at its place.
pub(super) fn world(of: Vec<(LeafMesh, DMat4)>) -> ReferenceWorld {
    ReferenceWorld {
        instances: of
            .iter()
            .enumerate()
            .map(|(leaf, (_, transform))| ReferencePlacement { leaf, transform: *transform })
            .collect(),
        leaves: of.into_iter().map(|(mesh, _)| leaf(mesh)).collect(),
        ..ReferenceWorld::default()
    }
}

fn at(x: f64, y: f64, z: f64) -> DMat4 {
    DMat4::from_translation(DVec3::new(x, y, z))
}

/// A disk with `sides` corners around the origin.
fn plate(radius: f64, sides: u32) -> LeafMesh {
    let mut mesh = LeafMesh::default();
    mesh.positions.push(DVec3::ZERO);
    for k in 0..sides {
        mesh.positions.push(DVec2::from_angle(2.0 * PI * f64::from(k) / f64::from(sides)).extend(0.0) * radius);
        mesh.indices.extend([0, 1 + k, 1 + (k + 1) % sides]);
    }
    mesh.normals = vec![DVec3::Z; mesh.positions.len()];
    mesh.uvs = mesh.positions.iter().map(|p| p.truncate() / (2.0 * radius) + 0.5).collect();
    mesh
}

/// The maps of a world with its leaves as drawn.
fn maps(world: &ReferenceWorld, light: &AreaLight, directions: &[DVec3]) -> (ShadowReceivers, Vec<Vec<u8>>) {
    let receivers = ShadowReceivers::new(world, &[]).unwrap();
    let mut maps = Vec::new();
    let shadows = ShadowScene::new(world, &receivers, light).unwrap();
    shadows
        .maps(directions, |k, map| {
            assert_eq!(k, maps.len());
            // The map is also computed alone, without data of the directions before.
            let follow = |_, alone: &[u8]| {
                assert!(alone == map);
                Ok(())
            };
            shadows.follow(std::iter::once(directions[k]), follow)?;
            maps.push(map.to_vec());
            Ok(())
        })
        .unwrap();
    (receivers, maps)
}

/// The share of the sun that a tiny, tilted receiver at the origin sees past `occluder`.
fn seen(occluder: Vec<(LeafMesh, DMat4)>, light: &AreaLight, direction: DVec3) -> f64 {
    let tilt = DMat4::from_quat(DQuat::from_rotation_x(0.4));
    let mut all = vec![(grid(1e-4, 1e-4, 1, 1), tilt)];
    all.extend(occluder);
    let (receivers, maps) = maps(&world(all), light, &[direction]);
    let own: Vec<u8> = receivers.of(0).map(|k| maps[0][k]).collect();
    assert!(own.iter().all(|v| v.abs_diff(own[0]) <= 4), "{own:?}");
    f64::from(own[0]) / 255.0
}

/// The edge of a wide plate through the middle of the sun leaves half of it. Elsewhere a segment of the disk is left.
/// This holds from below as from above.
#[test]
fn half_a_plane_hides_a_segment_of_the_disk() {
    let light = AreaLight::disk(SUN, 1024).unwrap();
    for up in [1.0, -1.0] {
        for h in [-1.2, -0.7, -0.3, 0.0, 0.4, 0.9, 1.3f64] {
            // At the height 1000 the disk is 2 · 4.65 wide. The plate covers everything beyond the share h of its
            // radius.
            let edge = 1000.0 * SUN.tan() * h;
            let hidden =
                seen(vec![(grid(400.0, 400.0, 7, 5), at(edge + 200.0, 3.0, up * 1000.0))], &light, DVec3::Z * up);
            let t = h.clamp(-1.0, 1.0);
            let want = 1.0 - (t.acos() - t * (1.0 - t * t).sqrt()) / PI;
            assert!((hidden - want).abs() < 0.006, "edge at {h} radii, {up}: {hidden}, expected {want}");
        }
    }
}

/// A round plate in front of the round sun hides the lens of two circles.
#[test]
fn a_disk_before_the_disk_hides_their_lens() {
    let light = AreaLight::disk(SUN, 1024).unwrap();
    let sun = 500.0 * SUN.tan();
    for (radius, apart) in [(0.5, 0.2), (0.5, 0.7), (1.0, 1.0), (1.5, 1.1), (0.3, 1.4), (3.0, 0.5)] {
        let direction = DVec3::new(0.5, -0.3, 0.8).normalize();
        let turn = DMat4::from_quat(DQuat::from_rotation_arc(DVec3::Z, direction));
        let place = turn * at(apart * sun, 0.0, 500.0);
        let found = seen(vec![(plate(radius * sun, 720), place)], &light, direction);
        let lens = {
            let (r, d): (f64, f64) = (radius, apart);
            if d >= 1.0 + r {
                0.0
            } else if d <= (1.0 - r).abs() {
                PI * r.min(1.0).powi(2)
            } else {
                let a = ((d * d + 1.0 - r * r) / (2.0 * d)).acos();
                let b = ((d * d + r * r - 1.0) / (2.0 * d * r)).acos();
                a - a.sin() * a.cos() + r * r * (b - b.sin() * b.cos())
            }
        };
        let want = 1.0 - lens / PI;
        assert!((found - want).abs() < 0.008, "radius {radius}, {apart} apart: {found}, expected {want}");
    }
}

/// A plate above another: the umbra and the lit area agree with geometry, and the plate that casts the shadow is lit.
#[test]
fn a_plate_above_another_throws_its_shadow() {
    let light = AreaLight::disk(SUN, 64).unwrap();
    let scene =
        world(vec![(grid(200.0, 200.0, 80, 80), DMat4::IDENTITY), (grid(60.0, 60.0, 4, 4), at(0.0, 0.0, 100.0))]);
    let direction = DVec3::new(0.3, 0.0, 1.0);
    let (receivers, maps) = maps(&scene, &light, &[direction, -direction]);
    let soft = 1.1 * 100.0 * SUN * 1.1;
    let mut counts = [0; 2];
    for k in receivers.of(0) {
        let p = receivers.get(k).position;
        // The shadow is 30 mm towards −x.
        let past = ((p.x + 30.0).abs() - 30.0).max(p.y.abs() - 30.0);
        if past < -soft {
            assert_eq!(maps[0][k], 0, "{p}");
            counts[0] += 1;
        } else if past > soft {
            assert_eq!(maps[0][k], 255, "{p}");
            counts[1] += 1;
        }
        // With light from below, the lower plate is lit and hides the light from the upper one.
        assert_eq!(maps[1][k], 255);
    }
    assert!(counts.iter().all(|n| *n > 400), "{counts:?}");
    for k in receivers.of(1) {
        assert_eq!((maps[0][k], maps[1][k]), (255, 0));
    }
}

/// Random leaves, one with an outline and one of discs. Some touch or cross each other.
fn thicket(seed: u64, of: usize) -> ReferenceWorld {
    let mut state = seed;
    let mut next = move || {
        state = crate::seeds::mix(state, 7);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut curved = grid(60.0, 30.0, 12, 6);
    for p in &mut curved.positions {
        p.z = 0.004 * p.x * p.x + 0.2 * p.y.abs();
    }
    let holes = (0..64).map(|k| u8::from((k % 8 + k / 8) % 5 != 0)).collect();
    let cut = outlined(grid(40.0, 40.0, 6, 6), 8, 8, Some(holes));
    let mut world = ReferenceWorld { leaves: vec![leaf(curved), cut], ..ReferenceWorld::default() };
    for k in 0..of {
        let mut spread = |by: f64| DVec3::new(next() - 0.5, next() - 0.5, next() - 0.5) * by;
        let (place, axis) = (spread(120.0), spread(6.0));
        let transform = DMat4::from_scale_rotation_translation(
            DVec3::splat(0.8 + 0.1 * (k % 5) as f64),
            DQuat::from_scaled_axis(axis),
            place,
        );
        world.instances.push(ReferencePlacement { leaf: k % 2, transform });
    }
    world
}

/// Triangles on a plane and rays to each point of the light give the same result, except for points just at an edge.
#[test]
fn casting_finds_what_rays_find() {
    let wide = AreaLight::polygon(&[[-0.02, -0.01], [0.03, -0.01], [0.0, 0.02]].map(DVec2::from), 40).unwrap();
    for (seed, light) in [(1, AreaLight::disk(SUN, 64).unwrap()), (2, AreaLight::disk(0.0, 1).unwrap()), (3, wide)] {
        let scene = thicket(seed, 14);
        let receivers = ShadowReceivers::new(&scene, &[3.0, 4.0]).unwrap();
        let shadows = ShadowScene::new(&scene, &receivers, &light).unwrap();
        let directions = [[0.3, 0.2, 0.9], [0.0, 0.0, 1.0], [-0.7, 0.4, -0.2], [1.0, 0.0, 0.0]].map(DVec3::from);
        let mut partly = 0;
        shadows
            .maps(&directions, |k, map| {
                let rays = shadows.by_rays(directions[k]);
                let wrong = map.iter().zip(&rays).filter(|(a, b)| a != b).count();
                assert!(wrong * 2000 <= map.len(), "{wrong} of {} differ", map.len());
                partly += map.iter().filter(|v| ![0, 255].contains(*v)).count();
                assert!(map.iter().filter(|v| **v == 0).count() > 100);
                Ok(())
            })
            .unwrap();
        assert!(light.len() == 1 || partly > 100, "{partly}");
    }
}

/// A scene that repeats has the same shadows as a long row of its copies.
#[test]
fn what_repeats_hides_as_its_copies_do() {
    let light = AreaLight::disk(0.02, 16).unwrap();
    let mut one = world(vec![(grid(10.0, 10.0, 5, 5), at(0.0, 0.0, 0.0)), (grid(8.0, 30.0, 2, 2), at(6.0, 0.0, 20.0))]);
    let mut many = one.clone();
    for (x, y) in (-6..=6).flat_map(|x| (-3..=3).map(move |y| (x, y))).filter(|c| *c != (0, 0)) {
        many.instances.extend(one.instances.clone().into_iter().map(|p| ReferencePlacement {
            transform: at(20.0 * f64::from(x), 30.0 * f64::from(y), 0.0) * p.transform,
            ..p
        }));
    }
    one.periodic = Some([20.0, 30.0]);
    let direction = DVec3::new(1.2, 0.1, 0.8);
    let (receivers, repeated) = maps(&one, &light, &[direction]);
    let (_, copied) = maps(&many, &light, &[direction]);
    let own = receivers.len();
    assert_eq!(repeated[0][..own], copied[0][..own]);
    assert!([0, 255].iter().all(|v| repeated[0].contains(v)));
}
