//! Finds what lies under the pointer: a ray through the picture against the instances' triangles, on the CPU.

use crate::bend::Moved;
use crate::scene::{Camera, Instance, LeafMaterial, Mesh, Scene, Side};
use glam::{Vec2, Vec3};

/// A point on something that stands in the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PickHit {
    /// Index into the scene's instances.
    pub instance: usize,
    /// Index into the scene's materials.
    pub material: usize,
    /// The side that is seen: the one whose mesh normal faces the viewer.
    pub side: Side,
    /// Texture coordinates on the front's maps.
    pub uv: Vec2,
    /// Column and row on the maps of the side that is seen; 0, 0 where the material has no maps.
    pub texel: [u32; 2],
    /// Place in the world.
    pub position: Vec3,
    /// Distance from the origin of the ray, in the world's units.
    pub distance: f32,
}

/// The ray through a picture at `x`, `y` (0 to 1 from the top left corner).
pub fn ray(camera: &Camera, aspect: f32, x: f32, y: f32) -> (Vec3, Vec3) {
    let forward = (camera.target - camera.eye).normalize();
    let right = forward.cross(camera.up).normalize();
    let up = right.cross(forward);
    let t = camera.half_height();
    (camera.eye, (forward + (2.0 * x - 1.0) * t * aspect * right + (1.0 - 2.0 * y) * t * up).normalize())
}

/// The nearest point that the picture shows at `x`, `y` (0 to 1). Holes in a mask are transparent.
pub fn pick(scene: &Scene, camera: &Camera, aspect: f32, x: f32, y: f32) -> Option<PickHit> {
    let (origin, direction) = ray(camera, aspect, x, y);
    let boxes: Vec<(Vec3, Vec3)> = scene.meshes.iter().map(bounds).collect();
    let sections = Moved::of(scene);
    let mut best: Option<PickHit> = None;
    for (i, instance) in scene.instances.iter().enumerate().filter(|(_, i)| i.stand.is_none()) {
        let Some(mesh) = scene.meshes.get(instance.mesh) else { continue };
        let leaf = scene.leaf(instance.material);
        let back = instance.transform.inverse();
        let (mut o, mut d) = (back.transform_point3(origin), back.transform_vector3(direction));
        // What a section carries is tested in world space, at its place.
        let moved = instance.carried.map(|_| swung(&sections, instance, mesh));
        if moved.is_some() {
            (o, d) = (origin, direction);
        } else if !meets_box(o, d, boxes[instance.mesh]) {
            continue;
        }
        let (positions, normals) = moved.as_ref().map_or((&mesh.positions, &mesh.normals), |m| (&m.0, &m.1));
        for triangle in mesh.indices.as_chunks::<3>().0 {
            let Some((t, u, v)) = meets_triangle(o, d, triangle.map(|k| positions[k as usize])) else { continue };
            if best.is_some_and(|b| b.distance <= t) {
                continue;
            }
            let weights = [1.0 - u - v, u, v];
            let corner = |k: usize| triangle[k] as usize;
            let uv: Vec2 = (0..3).map(|k| weights[k] * mesh.uvs[corner(k)]).sum();
            let normal: Vec3 = (0..3).map(|k| weights[k] * normals[corner(k)]).sum();
            let side = if normal.dot(d) <= 0.0 { Side::Front } else { Side::Back };
            let mut seen = [0, 0];
            if let Some(leaf) = leaf {
                let [column, row] = texel(leaf, uv);
                if leaf.mask.as_ref().is_some_and(|m| m[(row * leaf.width + column) as usize] == 0) {
                    continue;
                }
                seen = if side == Side::Front { [column, row] } else { [leaf.width - 1 - column, row] };
            }
            best = Some(PickHit {
                instance: i,
                material: instance.material,
                side,
                uv,
                texel: seen,
                position: origin + t * direction,
                distance: t,
            });
        }
    }
    best
}

/// Positions and normals in the world of a mesh that something moves.
fn swung(sections: &Moved, instance: &Instance, mesh: &Mesh) -> (Vec<Vec3>, Vec<Vec3>) {
    let m = instance.transform;
    let pairs = mesh.positions.iter().zip(&mesh.normals);
    let moved = |(k, (p, n)): (usize, (&Vec3, &Vec3))| {
        sections.place_and_normal(instance.carried, k, m.transform_point3(*p), m.transform_vector3(*n))
    };
    pairs.enumerate().map(moved).unzip()
}

fn texel(leaf: &LeafMaterial, uv: Vec2) -> [u32; 2] {
    let at = |x: f32, n: u32| ((x * n as f32).max(0.0) as u32).min(n - 1);
    [at(uv.x, leaf.width), at(uv.y, leaf.height)]
}

fn bounds(mesh: &Mesh) -> (Vec3, Vec3) {
    let start = (Vec3::splat(f32::MAX), Vec3::splat(f32::MIN));
    mesh.positions.iter().fold(start, |(l, h), p| (l.min(*p), h.max(*p)))
}

fn meets_box(o: Vec3, d: Vec3, (low, high): (Vec3, Vec3)) -> bool {
    let margin = 1e-4 * (high - low).max_element().max(1e-3);
    let (a, b) = ((low - margin - o) / d, (high + margin - o) / d);
    let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
    far >= near.max(0.0)
}

/// Distance and barycentric coordinates, for both faces (Möller & Trumbore 1997).
fn meets_triangle(o: Vec3, d: Vec3, [a, b, c]: [Vec3; 3]) -> Option<(f32, f32, f32)> {
    let (e, f) = (b - a, c - a);
    let p = d.cross(f);
    let determinant = e.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let s = o - a;
    let u = s.dot(p) / determinant;
    let q = s.cross(e);
    let v = d.dot(q) / determinant;
    let t = f.dot(q) / determinant;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some((t, u, v))
}
