//! Rays and camera paths a second on one thread, compared with Embree and Mitsuba on the same triangles and rays, in
//! turns.

use super::ProofFoliage;
use super::paths::ProofScene;
use crate::bench::{BenchRow, median_us};
use crate::peers::PeerInputs;
use glam::DVec3;
use mesophyll_base::statistics::median_of;
use mesophyll_transport::rays::{InstanceForest, Ray, RayHit, TriangleTree};
use std::hint::black_box;

/// Rays of a camera and incoherent ones are asked for in lots of this size, as the path tracer does.
const AT_ONCE: usize = 256;

/// The three kinds of rays.
pub const KINDS: [&str; 3] = ["camera", "incoherent", "shadow"];

impl ProofFoliage {
    fn rays(&self, kind: &str) -> &[Ray] {
        match kind {
            "camera" => &self.camera,
            "incoherent" => &self.incoherent,
            _ => &self.shadow,
        }
    }

    /// The answers for the rays of a kind: the triangle that each ray meets first (−1: none). For shadow rays, 0 means
    /// that any triangle is met, −1 none.
    fn found(&self, kind: &str) -> Vec<i32> {
        let rays = self.rays(kind);
        // As the path tracer asks such rays: many at once.
        let many = |find: fn(&InstanceForest, &[Ray]) -> Vec<Option<RayHit>>| {
            rays.chunks(AT_ONCE).flat_map(|rays| find(&self.forest, rays)).map(triangle).collect()
        };
        match kind {
            "camera" => many(|forest, rays| forest.nearest_of_neighbours(rays, |_, _, _| true)),
            "incoherent" => many(|forest, rays| forest.nearest_of_each(rays, |_, _, _| true)),
            _ => rays.iter().map(|ray| -i32::from(!self.forest.blocked(ray, |_, _, _| true))).collect(),
        }
    }

    /// Time of a ray of a kind (µs), measured once over all rays.
    fn time(&self, kind: &str) -> f64 {
        let clock = std::time::Instant::now();
        black_box(self.found(kind));
        clock.elapsed().as_secs_f64() * 1e6 / self.rays(kind).len() as f64
    }
}

/// The triangle of a hit; −1: none.
fn triangle(hit: Option<RayHit>) -> i32 {
    hit.map_or(-1, |hit| hit.triangle as i32)
}

/// One row for each kind of rays. Its error is the share of 300 rays whose answer differs from that of a search without
/// a tree.
///
/// # Errors
/// Those of [`ProofScene::new`].
pub fn bench_rows() -> crate::Result<Vec<BenchRow>> {
    let foliage = ProofFoliage::new();
    let build = median_us(0.0, || TriangleTree::new(&foliage.positions, &foliage.indices));
    let alone = alone(&foliage);
    let mut rows = vec![BenchRow {
        model: "render".into(),
        knob: "tree".into(),
        setting: "build".into(),
        error: f64::NAN,
        us: build,
        note: format!("one thread, {} triangles", foliage.indices.len() / 3),
    }];
    for kind in KINDS {
        let rays = foliage.rays(kind);
        let found = foliage.found(kind);
        let sample = rays.iter().zip(found).step_by(rays.len() / 300).take(300);
        let wrong = sample.filter(|(ray, found)| *found != without_tree(&alone, kind, ray));
        let error = wrong.count() as f64 / 300.0;
        let us = median_us(1500.0, || foliage.time(kind)) / rays.len() as f64;
        rows.push(BenchRow {
            model: "render".into(),
            knob: "rays".into(),
            setting: kind.into(),
            error,
            us,
            note: format!("{:.2} Mrays/s, one thread, {} rays; share of wrong answers", 1.0 / us, rays.len()),
        });
    }
    let scene = ProofScene::new(&foliage)?;
    let us = median_of([scene.time(), scene.time(), scene.time()]).unwrap_or(f64::NAN);
    rows.push(BenchRow {
        model: "render".into(),
        knob: "paths".into(),
        setting: "matte crown, even sky".into(),
        error: f64::NAN,
        us,
        note: format!("{:.3} M camera paths/s, one thread, median of 3 pictures", 1.0 / us),
    });
    Ok(rows)
}

/// Every triangle by itself, so that no tree takes part in the answer.
fn alone(foliage: &ProofFoliage) -> Vec<[DVec3; 3]> {
    foliage.indices.chunks_exact(3).map(|t| [0, 1, 2].map(|k| foliage.positions[t[k] as usize])).collect()
}

/// The same answer by solving a 3×3 system for each triangle that the ray comes near.
fn without_tree(triangles: &[[DVec3; 3]], kind: &str, ray: &Ray) -> i32 {
    let unit = ray.direction.normalize();
    let mut best = (f64::INFINITY, -1);
    for (k, [a, b, c]) in triangles.iter().enumerate() {
        // Corners are less than 40 mm apart, so a ray that stays farther away cannot meet them.
        let away = *a - ray.origin;
        if away.cross(unit).length_squared() > 40.0 * 40.0 {
            continue;
        }
        let s = glam::DMat3::from_cols(*b - *a, *c - *a, -ray.direction).inverse() * -away;
        if s.is_finite() && s.x >= 0.0 && s.y >= 0.0 && s.x + s.y <= 1.0 && s.z > 0.0 && s.z < best.0 {
            best = (s.z, k as i32);
        }
    }
    if kind == "shadow" { best.1.min(0) } else { best.1 }
}

/// The crown and its rays as little-endian numbers, our answers, and our time for a turn.
///
/// # Errors
/// Those of [`ProofScene::new`] and [`ProofScene::told`].
pub fn peers() -> crate::Result<PeerInputs> {
    let foliage = ProofFoliage::new();
    let floats = |points: &mut dyn Iterator<Item = DVec3>| -> Vec<u8> {
        points.flat_map(|p| p.as_vec3().to_array()).flat_map(f32::to_le_bytes).collect()
    };
    let mut files = vec![
        ("positions.f32".into(), floats(&mut foliage.positions.iter().copied())),
        ("indices.u32".into(), foliage.indices.iter().flat_map(|i| i.to_le_bytes()).collect()),
    ];
    for kind in KINDS {
        let rays = foliage.rays(kind);
        let both = &mut rays.iter().flat_map(|ray| [ray.origin, ray.direction]);
        files.push((format!("{kind}.f32"), floats(both)));
        files.push((format!("{kind}.i32"), foliage.found(kind).iter().flat_map(|i| i.to_le_bytes()).collect()));
    }
    let scene = ProofScene::new(&foliage)?;
    files.push(("paths.json".into(), scene.told()?.to_string().into_bytes()));
    let turn = move |kind: &str| if kind == "paths" { scene.time() } else { foliage.time(kind) };
    Ok(PeerInputs { files, ours: Vec::new(), turn: Some(Box::new(turn)) })
}
