//! Leaves built by hand, alone in a world with a sun and a sky.

use glam::{DMat4, DVec2, DVec3};
use mesophyll::files::mesh::LeafMesh;
use mesophyll::transport::lobe::Lobe;
use mesophyll::transport::{
    NormalFrame, NormalMap, ReferenceCamera, ReferenceGloss, ReferenceInterior, ReferenceLeaf, ReferencePlacement,
    ReferenceSide, ReferenceSun, ReferenceWorld,
};
use std::f64::consts::PI;

pub const SUN: f64 = 0.004_65;

/// A blade of `w`×`h` mm about the origin with `n`×`n` cells, bent upwards by `bend` mm at its sides.
pub fn blade(w: f64, h: f64, n: usize, bend: f64) -> LeafMesh {
    let mut mesh = LeafMesh::default();
    for j in 0..=n {
        for i in 0..=n {
            let (u, v) = (i as f64 / n as f64, j as f64 / n as f64);
            let x = w * (u - 0.5);
            let slope = 8.0 * bend * x / (w * w);
            mesh.positions.push(DVec3::new(x, h * (0.5 - v), 4.0 * bend * x * x / (w * w)));
            mesh.normals.push(DVec3::new(-slope, 0.0, 1.0).normalize());
            mesh.tangents.push((DVec3::new(1.0, 0.0, slope).normalize(), 1.0));
            mesh.uvs.push(DVec2::new(u, v));
        }
    }
    for j in 0..n {
        for i in 0..n {
            let a = (j * (n + 1) + i) as u32;
            let below = a + n as u32 + 1;
            mesh.indices.extend([a, below, a + 1, a + 1, below, below + 1]);
        }
    }
    mesh
}

/// One colour over a 1×1 map.
pub fn uniform(rho_d: [f64; 3], rho_t: [f64; 3], gloss: Option<([f64; 3], f64)>) -> ReferenceSide {
    ReferenceSide::even(rho_d, rho_t, gloss.map(|(rho_s, m)| ReferenceGloss::even(rho_s, m)))
}

pub fn leaf(mesh: LeafMesh, front: ReferenceSide, back: ReferenceSide, lobe: Lobe) -> ReferenceLeaf {
    ReferenceLeaf::even(mesh, [front, back], lobe)
}

pub fn alone(leaf: ReferenceLeaf, sun: Option<ReferenceSun>, sky: Option<[f64; 3]>) -> ReferenceWorld {
    ReferenceWorld {
        leaves: vec![leaf],
        instances: vec![ReferencePlacement { leaf: 0, transform: DMat4::IDENTITY }],
        sun,
        sky,
        ..ReferenceWorld::default()
    }
}

pub fn sun(direction: DVec3, radius: f64) -> Option<ReferenceSun> {
    Some(ReferenceSun { direction, irradiance: [3.0, 2.5, 2.0], radius })
}

pub fn camera(eye: DVec3, fov_y_deg: f64) -> ReferenceCamera {
    ReferenceCamera { eye, target: DVec3::ZERO, up: DVec3::Y, fov_y_deg }
}

/// A leaf with veins, two different sides, gloss and relief, `n` texels wide.
pub fn veined(n: usize) -> ReferenceLeaf {
    let texel = |k: usize| ((k % n) as f64 / n as f64, (k / n) as f64 / n as f64);
    let vein = |u: f64, v: f64| {
        let midrib = (-((u - 0.45) / 0.012).powi(2)).exp();
        let side = (0.5 + 0.5 * ((v - 0.7 * (u - 0.45).abs()) * 2.0 * PI * 7.0).cos()).powi(20);
        (midrib + 0.7 * side).min(1.0)
    };
    let map =
        |of: &dyn Fn(f64, f64) -> f64| (0..n * n).map(|k| of(texel(k).0, texel(k).1) as f32).collect::<Vec<f32>>();
    let side = |mirror: bool, tint: [f64; 3], shine: f64, m: f64, relief: f64| {
        let at = move |u: f64, v: f64| vein(if mirror { 1.0 - u } else { u }, v);
        let colour = |c: usize, vein_gain: f64| map(&|u, v| tint[c] * (1.0 + vein_gain * at(u, v)));
        let h = 0.5 / n as f64;
        let normals = (0..n * n)
            .map(|k| {
                let (u, v) = texel(k);
                let (dx, dy) = (at(u + h, v) - at(u - h, v), at(u, v - h) - at(u, v + h));
                let normal = DVec3::new(-relief * dx / h * 0.01, -relief * dy / h * 0.01, 1.0).normalize();
                [normal.x as f32, normal.y as f32, normal.z as f32]
            })
            .collect();
        ReferenceSide {
            interior: ReferenceInterior::Maps {
                rho_d: [colour(0, 1.5), colour(1, 0.8), colour(2, 1.8)],
                rho_t: [0, 1, 2].map(|c| map(&|u, v| 0.8 * tint[c] * (1.0 - 0.6 * at(u, v)))),
            },
            gloss: Some(ReferenceGloss {
                rho_s: [0, 1, 2].map(|_| map(&|u, v| shine * (1.0 - 0.5 * at(u, v)))),
                m: map(&|u, v| m + 0.1 * at(u, v)),
            }),
            normal: Some(NormalMap { frame: NormalFrame::Blade, values: normals }),
        }
    };
    let outline = |u: f64, v: f64| {
        let y = 2.0 * v - 1.0;
        (u - 0.48).abs() < 0.42 * (1.0 - y * y).max(0.0).powf(0.8)
    };
    ReferenceLeaf {
        mesh: blade(60.0, 60.0, 24, 4.0),
        width: n,
        height: n,
        front: side(false, [0.05, 0.13, 0.03], 0.05, 0.25, 1.0),
        back: side(true, [0.12, 0.21, 0.09], 0.02, 0.45, -1.0),
        mask: Some((0..n * n).map(|k| u8::from(outline(texel(k).0, texel(k).1))).collect()),
        lobe: Lobe::Beckmann,
    }
}

pub fn portrait() -> (ReferenceWorld, ReferenceCamera) {
    let mut world = alone(veined(64), sun(DVec3::new(0.5, 0.4, 1.0), SUN), Some([0.25, 0.3, 0.4]));
    world.exposure = 1.2;
    world.background = [0.02, 0.02, 0.025];
    (world, camera(DVec3::new(-20.0, -35.0, 110.0), 32.0))
}
