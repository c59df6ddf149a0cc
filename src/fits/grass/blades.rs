//! The blades that slices represent. They stand on a rectangle that repeats without end, and rays can hit them.

use crate::grass::optics::{LawnMaterials, Optics};
use crate::grass::{Error, Result};
use glam::{DMat3, DMat4, DVec3};
use mesophyll_plants::form::Plant;
use mesophyll_transport::rays::{InstanceForest, Ray, TriangleTree};
use std::f64::consts::TAU;
use std::path::Path;

/// The largest number of blades of a meadow. Blades that hang over an edge count on both sides of the rectangle.
const MOST: usize = 2_000_000;
/// Number of steps of |Ω_z| from 0 to 1 in [`LawnMeadow::projection`].
pub const STEPS: usize = 16;
/// Number of azimuths that the projection is averaged over.
const AZIMUTHS: usize = 32;

/// Blades on a rectangle that repeats. Lengths are in mm; z is up and the ground is at z = 0.
#[derive(Debug, Clone)]
pub struct LawnMeadow {
    /// Name of the meadow.
    pub name: String,
    /// Width and depth of the rectangle, whose middle is the origin.
    pub period: [f64; 2],
    /// Height of the highest tip.
    pub height: f64,
    /// Area of all blades (one side) over the area of the ground.
    pub leaf_area_index: f64,
    /// The share of its area that a blade shows to a direction Ω with |Ω_z| = k/[`STEPS`]: the mean of |n·Ω| over the
    /// area of all blades and over azimuth.
    pub projection: [f64; STEPS + 1],
    /// Number of blades on the rectangle.
    pub blades: usize,
    forest: InstanceForest,
    shapes: Vec<Shown>,
    placed: Vec<Placed>,
}

/// A shape of a blade, as rays see it.
#[derive(Debug, Clone)]
struct Shown {
    corners: Vec<[u32; 3]>,
    positions: Vec<DVec3>,
    normals: Vec<DVec3>,
    optics: Optics,
}

#[derive(Debug, Clone, Copy)]
struct Placed {
    shape: usize,
    turn: DMat3,
}

/// The point where a ray hits a blade.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BladeHit {
    /// Distance from the origin of the ray, in lengths of its direction.
    pub t: f64,
    /// Unit normal, on the side that the ray comes from.
    pub normal: DVec3,
    /// Diffuse reflectance of the side that the ray comes from, then of the other side.
    pub rho_d: [[f64; 3]; 2],
    /// Diffuse transmittance.
    pub rho_t: [f64; 3],
}

impl LawnMeadow {
    /// The blades of `plant`, which `path` names in errors.
    ///
    /// # Errors
    /// [`Error::Input`] for a plant that does not repeat, that has no blades above the ground, or whose materials the
    /// table of `leaves` does not have.
    pub fn new(path: &Path, plant: &Plant, leaves: &LawnMaterials) -> Result<LawnMeadow> {
        let Some(period) = plant.period else {
            return Err(Error::input(
                path,
                "no meadow: nothing says over which rectangle it repeats (a meadow is what \
                                           `mesophyll grow` makes of a description with a [[sward]])",
            ));
        };
        let mut shapes = Vec::new();
        for blade in &plant.blades {
            let optics = leaves.get(&blade.material).copied().ok_or_else(|| {
                let known: Vec<&str> = leaves.keys().map(String::as_str).collect();
                let found = format!("the material \"{}\"", blade.material);
                Error::unexpected(path, "material", found, format!("one of the table of leaves: {}", known.join(", ")))
            })?;
            let mesh = &blade.mesh;
            let corners = (0..mesh.triangles()).map(|t| mesh.triangle(t).map(|k| k as u32)).collect();
            shapes.push(Shown { corners, positions: mesh.positions.clone(), normals: mesh.normals.clone(), optics });
        }
        let (mut height, mut area, mut shown) = (0f64, 0.0, [0.0; STEPS + 1]);
        let (mut placed, mut transforms) = (Vec::new(), Vec::new());
        for leaf in &plant.leaves {
            let Some(shape) = shapes.get(leaf.blade).filter(|shape| !shape.positions.is_empty()) else { continue };
            let points: Vec<DVec3> = shape.positions.iter().map(|p| leaf.transform.transform_point3(*p)).collect();
            for t in &shape.corners {
                let [a, b, c] = t.map(|k| points[k as usize]);
                let n = 0.5 * (b - a).cross(c - a);
                area += n.length();
                shown.iter_mut().enumerate().for_each(|(k, sum)| *sum += projected(n, k as f64 / STEPS as f64));
            }
            let (low, high) = points.iter().fold((points[0], points[0]), |(l, h), p| (l.min(*p), h.max(*p)));
            height = height.max(high.z);
            let turn = DMat3::from_mat4(leaf.transform);
            // Copies of blades in the neighbouring rectangles that hang over the edge into this one.
            let range = |k: usize| {
                let half = 0.5 * period[k];
                ((low[k] - half) / period[k]).ceil() as i64..=((high[k] + half) / period[k]).floor() as i64
            };
            for i in range(0) {
                for j in range(1) {
                    let back = DVec3::new(-(i as f64) * period[0], -(j as f64) * period[1], 0.0);
                    placed.push(Placed { shape: leaf.blade, turn });
                    transforms.push((leaf.blade, DMat4::from_translation(back) * leaf.transform));
                    if placed.len() > MOST {
                        let found = format!("more than {MOST} blades with those that hang over an edge");
                        return Err(Error::input(path, found));
                    }
                }
            }
        }
        if !(height > 0.0 && area > 0.0) {
            return Err(Error::input(path, "no blade stands above the ground (z = 0)"));
        }
        let meshes = shapes.iter().map(|s| TriangleTree::new(&s.positions, s.corners.as_flattened())).collect();
        Ok(LawnMeadow {
            name: plant.name.clone(),
            period,
            height,
            leaf_area_index: area / (period[0] * period[1]),
            projection: shown.map(|sum| sum / area),
            blades: plant.leaves.len(),
            forest: InstanceForest::new(meshes, &transforms),
            shapes,
            placed,
        })
    }

    /// The nearest blade at 0 < t < `limit`; `limit` is finite.
    pub fn nearest(&self, ray: &Ray, limit: f64) -> Option<BladeHit> {
        self.pieces(ray, limit, |piece, from, length| {
            let hit = self.forest.nearest_within(piece, length, |_, _, _| true)?;
            let placed = self.placed[hit.instance];
            let shape = &self.shapes[placed.shape];
            let corners = shape.corners[hit.triangle].map(|k| k as usize);
            let [a, b, c] = corners.map(|k| shape.positions[k]);
            // A blade is scaled by the same factor along all axes, so its normals turn as the blade does.
            let facet = (placed.turn * (b - a)).cross(placed.turn * (c - a));
            let [v, w] = hit.barycentric;
            let [na, nb, nc] = corners.map(|k| shape.normals[k]);
            let normal = (placed.turn * (na * (1.0 - v - w) + nb * v + nc * w)).try_normalize();
            let front = facet.dot(ray.direction) < 0.0;
            let side = if front { 1.0 } else { -1.0 };
            let [rho_front, rho_back] = shape.optics.rho_d;
            Some(BladeHit {
                t: from + hit.t,
                normal: normal.unwrap_or(facet.normalize_or_zero()) * side,
                rho_d: if front { [rho_front, rho_back] } else { [rho_back, rho_front] },
                rho_t: shape.optics.rho_t,
            })
        })
    }

    /// Whether a blade is at 0 < t < `limit`; `limit` is finite.
    pub fn blocked(&self, ray: &Ray, limit: f64) -> bool {
        let met = |piece: &Ray, _, length| self.forest.blocked_within(piece, length, |_, _, _| true).then_some(());
        self.pieces(ray, limit, met).is_some()
    }

    /// Follows a ray from rectangle to rectangle. `met` gets the ray relative to the one rectangle, and the beginning
    /// and the length of its piece there, in lengths of the direction.
    fn pieces<T>(&self, ray: &Ray, limit: f64, met: impl Fn(&Ray, f64, f64) -> Option<T>) -> Option<T> {
        let mut from = 0.0;
        let cell = |x: f64, k: usize| (x / self.period[k] + 0.5).floor();
        let mut at = [cell(ray.origin.x, 0), cell(ray.origin.y, 1)];
        while from < limit {
            let mut next = [f64::INFINITY; 2];
            for k in 0..2 {
                let d = ray.direction[k];
                if d != 0.0 {
                    let edge = (at[k] + if d > 0.0 { 0.5 } else { -0.5 }) * self.period[k];
                    next[k] = (edge - ray.origin[k]) / d;
                }
            }
            let to = next[0].min(next[1]).min(limit);
            if to > from {
                let shift = DVec3::new(at[0] * self.period[0], at[1] * self.period[1], 0.0);
                let piece = Ray::new(ray.origin + ray.direction * from - shift, ray.direction);
                if let Some(found) = met(&piece, from, to - from) {
                    return Some(found);
                }
            }
            let k = usize::from(next[1] < next[0]);
            at[k] += ray.direction[k].signum();
            from = to.max(from);
        }
        None
    }

    /// [`LawnMeadow::projection`] at |Ω_z|, linear between its steps.
    pub fn shown(&self, vertical: f64) -> f64 {
        shown(&self.projection, vertical)
    }
}

/// The value of a table over |Ω_z| from 0 to 1, linear between its steps.
pub fn shown(table: &[f64; STEPS + 1], vertical: f64) -> f64 {
    let x = vertical.abs().min(1.0) * STEPS as f64;
    let k = (x as usize).min(STEPS - 1);
    table[k] + (x - k as f64) * (table[k + 1] - table[k])
}

/// The mean of |n·Ω| over azimuth, where Ω_z = s.
fn projected(n: DVec3, s: f64) -> f64 {
    let across = (1.0 - s * s).max(0.0).sqrt();
    let one = |k: usize| {
        let (sin, cos) = (TAU * (k as f64 + 0.5) / AZIMUTHS as f64).sin_cos();
        n.dot(DVec3::new(across * cos, across * sin, s)).abs()
    };
    (0..AZIMUTHS).map(one).sum::<f64>() / AZIMUTHS as f64
}
