//! Scenes with known answers.
#![allow(dead_code)]

#[path = "../../../../tests/common/skips.rs"]
pub mod skips;

use glam::{Quat, Vec2, Vec3, Vec4};
use mesophyll_viewer::scene::{
    Camera, Interior, LeafMaterial, Lobe, Material, Mesh, Scene, SectionAnimation, SectionMotion, SideMaps, Sides,
    SlabCurve, Sun,
};
use mesophyll_viewer::{Error, Options, Renderer};
use std::sync::Arc;

pub const RHO_D: [f32; 3] = [0.08, 0.12, 0.05];
pub const RHO_T: [f32; 3] = [0.06, 0.11, 0.02];
pub const BACK_D: [f32; 3] = [0.16, 0.2, 0.13];
pub const BACK_T: [f32; 3] = [0.05, 0.1, 0.015];

/// A renderer, or `None` and a counted skip where the machine has no adapter at all.
pub fn renderer() -> Option<Renderer> {
    renderer_with(&Options::default())
}

pub fn renderer_with(options: &Options) -> Option<Renderer> {
    match Renderer::headless(options) {
        Ok(renderer) => Some(renderer),
        Err(Error::NoAdapter) => {
            skips::skip(skips::Need::Adapter, "no graphics adapter");
            None
        }
        Err(other) => panic!("{other}"),
    }
}

/// Whether a GPU draws. It places vertices on a grid of 1/256 pixel, filters maps with weights of 8 bits, and rounds
/// quotients and roots otherwise than a processor does.
pub fn on_gpu(renderer: &Renderer) -> bool {
    !renderer.adapter().is_software
}

/// The tolerance `relative`, or a larger one where the adapter or its formats are less precise.
pub fn held(renderer: &Renderer, relative: f64) -> f64 {
    let least = if renderer.adapter().half_precision { 2e-3 } else { 0.0f64 };
    relative.max(least).max(if on_gpu(renderer) { 1e-3 } else { 0.0 })
}

/// A flat square of `half` mm to each side in the plane z = 0, front up. u grows with x, and v falls with y.
pub fn square(half: f32) -> Mesh {
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    Mesh {
        positions: corners.iter().map(|(x, y)| Vec3::new(x * half, y * half, 0.0)).collect(),
        normals: vec![Vec3::Z; 4],
        tangents: vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4],
        uvs: corners.iter().map(|(x, y)| Vec2::new(0.5 + 0.5 * x, 0.5 - 0.5 * y)).collect(),
        indices: vec![0, 1, 2, 0, 2, 3],
        ..Mesh::default()
    }
}

/// A curve whose ρd and ρt change linearly with thickness. At `at` mm they are `rho_d` and `rho_t`.
pub fn curve(at: f32, rho_d: [f32; 3], rho_t: [f32; 3]) -> SlabCurve {
    let scaled = |c: [f32; 3], s: f32| c.map(|v| v * s);
    SlabCurve {
        min_mm: 0.5 * at,
        max_mm: 1.5 * at,
        rho_d: vec![scaled(rho_d, 0.8), rho_d, scaled(rho_d, 1.2)],
        rho_t: vec![scaled(rho_t, 1.5), rho_t, scaled(rho_t, 0.5)],
    }
}

pub fn side(texels: usize, curve: SlabCurve) -> SideMaps {
    SideMaps {
        gamma_delta: vec![[1.0, 1.0, 1.0, 0.0]; texels],
        gloss: None,
        normal: None,
        translucency: None,
        interior: Interior::Scalars(curve),
    }
}

/// A flat, matte, uniform leaf.
pub fn uniform_leaf() -> LeafMaterial {
    let (width, height) = (8, 8);
    LeafMaterial {
        name: "flat".into(),
        width,
        height,
        thickness_mm: 0.2,
        lobe: Lobe::Beckmann,
        sides: Sides { front: side(64, curve(0.2, RHO_D, RHO_T)), back: side(64, curve(0.2, BACK_D, BACK_T)) },
        mask: None,
    }
}

/// A square of 10 mm to each side as this leaf.
pub fn scene_of(leaf: LeafMaterial) -> Scene {
    on_mesh(square(10.0), leaf)
}

/// A mesh as this leaf.
pub fn on_mesh(mesh: Mesh, leaf: LeafMaterial) -> Scene {
    let mut scene = Scene { exposure: 1.0, shadow_samples: 0, shadow_resolution: 512, msaa: 1, ..Scene::default() };
    let one = scene.add(mesh, Material::Leaf(leaf));
    scene.instances.push(one);
    scene
}

/// The leaf with this index among the materials.
pub fn leaf(scene: &mut Scene, material: usize) -> &mut LeafMaterial {
    scene.leaf_mut(material).expect("a leaf")
}

pub fn sun(direction: Vec3) -> Sun {
    Sun { direction: direction.normalize(), irradiance: [3.0, 2.5, 2.0], radius: 0.00465 }
}

/// A camera that looks at the origin from `direction`, `distance` mm away.
pub fn camera(direction: Vec3, distance: f32) -> Camera {
    let eye = direction.normalize() * distance;
    let up = if direction.normalize().z.abs() > 0.99 { Vec3::Y } else { Vec3::Z };
    Camera { eye, target: Vec3::ZERO, up, fov_y_deg: 20.0 }
}

/// The point of the plane z = 0 seen at a pixel's centre.
pub fn seen_point(camera: &Camera, width: u32, height: u32, x: u32, y: u32) -> [f64; 3] {
    let v = |a: Vec3| [f64::from(a.x), f64::from(a.y), f64::from(a.z)];
    let (eye, target, up) = (v(camera.eye), v(camera.target), v(camera.up));
    let forward = unit(sub(target, eye));
    let right = unit(cross(forward, up));
    let above = cross(right, forward);
    let t = (f64::from(camera.fov_y_deg).to_radians() / 2.0).tan();
    let sx = (2.0 * (f64::from(x) + 0.5) / f64::from(width) - 1.0) * t * f64::from(width) / f64::from(height);
    let sy = (1.0 - 2.0 * (f64::from(y) + 0.5) / f64::from(height)) * t;
    let ray: [f64; 3] = std::array::from_fn(|i| forward[i] + sx * right[i] + sy * above[i]);
    let s = -eye[2] / ray[2];
    std::array::from_fn(|i| eye[i] + s * ray[i])
}

pub fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}
pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
pub fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
pub fn unit(a: [f64; 3]) -> [f64; 3] {
    let l = dot(a, a).sqrt();
    a.map(|x| x / l)
}
pub fn wide(a: Vec3) -> [f64; 3] {
    [f64::from(a.x), f64::from(a.y), f64::from(a.z)]
}

/// Fails unless two colours agree within `relative` of the larger one, plus 1e-6.
pub fn agree(what: &str, got: [f32; 4], want: [f64; 3], relative: f64) {
    for c in 0..3 {
        let (g, w) = (f64::from(got[c]), want[c]);
        assert!(
            (g - w).abs() <= relative * g.abs().max(w.abs()) + 1e-6,
            "{what}, channel {c}: drawn {g}, expected {w}"
        );
    }
}

/// A square grid of ±`half` mm with `n` cells along a side, bent to z = `bend`·x² (mm⁻¹), with exact normals and
/// tangents.
pub fn bent(half: f32, n: usize, bend: f32) -> Mesh {
    let mut mesh = Mesh::default();
    for j in 0..=n {
        for i in 0..=n {
            let (u, v) = (i as f32 / n as f32, j as f32 / n as f32);
            let (x, y) = ((2.0 * u - 1.0) * half, (1.0 - 2.0 * v) * half);
            let slope = 2.0 * bend * x;
            mesh.positions.push(Vec3::new(x, y, bend * x * x));
            mesh.normals.push(Vec3::new(-slope, 0.0, 1.0).normalize());
            mesh.tangents.push(Vec3::new(1.0, 0.0, slope).normalize().extend(1.0));
            mesh.uvs.push(Vec2::new(u, v));
        }
    }
    for j in 0..n as u32 {
        for i in 0..n as u32 {
            let a = j * (n as u32 + 1) + i;
            let b = a + n as u32 + 1;
            mesh.indices.extend([a, b, a + 1, a + 1, b, b + 1]);
        }
    }
    mesh
}

/// Sections across x of a leaf of [`square`] or [`bent`], whose vertices they carry one by one: the leaf swings about
/// the line x = −12 by `still` radians at once and by up to 0.3 radians, once in 20 s.
pub fn swinging(mesh: &Mesh, still: f32) -> SectionAnimation {
    let columns: Vec<f32> = {
        let mut all: Vec<f32> = mesh.positions.iter().map(|p| p.x).collect();
        all.sort_by(f32::total_cmp);
        all.dedup();
        all
    };
    let of = |p: &Vec3| columns.iter().position(|x| *x == p.x).unwrap_or(0) as u32;
    let of_vertices = Arc::new(mesh.positions.iter().map(of).collect::<Vec<u32>>());
    let count = columns.len();
    let at = move |time: f64| {
        let angle = still + (0.3 * (std::f64::consts::TAU * time / 20.0).sin()) as f32;
        let section = |x: &f32| {
            // The way from the line grows with x, and so does the turn.
            let turn = Quat::from_rotation_y(-angle * (x + 12.0) / 24.0);
            let from = Vec3::X * *x;
            SectionMotion { from, to: Vec3::X * -12.0 + turn * (from + Vec3::X * 12.0), turn }
        };
        columns.iter().map(section).collect()
    };
    SectionAnimation { count, of_vertices, turn_normals: true, poses: None, at: Arc::new(at) }
}
