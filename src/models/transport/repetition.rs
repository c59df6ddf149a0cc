//! Worlds that repeat along x and y: what of them stands in one cell, and how a ray is followed from cell to cell.

use super::accelerate::{Bounds, Ray};
use super::world::{ReferencePlace, ReferencePlacement, ReferenceWorld};
use glam::{DMat4, DVec3};

/// A scene that repeats along x and y. Rays are followed through the cell around the origin. A ray that leaves the cell
/// enters it again on the opposite side.
pub(super) struct Repeat {
    /// Half the period.
    pub half: [f64; 2],
    /// Lowest and highest z of everything.
    pub height: [f64; 2],
}

/// The largest number of cells through which a ray is followed. A level ray that goes farther counts as hitting
/// nothing.
const MOST_CELLS: usize = 100_000;

impl Repeat {
    /// Calls `find` for one piece of the ray after the other, each up to where it leaves the cell.
    pub fn follow<T>(&self, ray: &Ray, find: impl Fn(&Ray, f64) -> Option<T>) -> Option<T> {
        let (mut origin, d) = (ray.origin, ray.direction);
        // A ray that starts above or below everything is moved directly to the height where it can hit something.
        let away = match d.z > 0.0 {
            true => self.height[0] - origin.z,
            false => self.height[1] - origin.z,
        };
        if away * d.z > 0.0 {
            origin += d * (away / d.z);
        }
        for axis in 0..2 {
            let period = 2.0 * self.half[axis];
            origin[axis] -= period * ((origin[axis] + self.half[axis]) / period).floor();
        }
        for _ in 0..MOST_CELLS {
            // The distance to the cell's wall at which the ray leaves.
            let wall = |axis: usize| match d[axis] {
                0.0 => f64::INFINITY,
                s => ((self.half[axis] * s.signum() - origin[axis]) / s).max(0.0),
            };
            let (x, y) = (wall(0), wall(1));
            let leave = x.min(y);
            // The limit lies slightly beyond the wall, so that what lies in the wall's plane belongs to this side.
            if let Some(found) = find(&Ray::new(origin, d), leave * (1.0 + 1e-9) + 1e-9) {
                return Some(found);
            }
            if !leave.is_finite() {
                return None;
            }
            origin += d * leave;
            let past = if d.z > 0.0 { origin.z > self.height[1] } else { origin.z < self.height[0] };
            if past || (d.z == 0.0 && !(self.height[0]..=self.height[1]).contains(&origin.z)) {
                return None;
            }
            let axis = usize::from(y < x);
            origin[axis] = -self.half[axis] * d[axis].signum();
        }
        None
    }
}

/// The first and the last shift, in whole periods along x and y, with which points reach into the cell around the
/// origin; `None` for no points.
fn shifts(points: impl Iterator<Item = DVec3>, size: [f64; 2]) -> Option<[[f64; 2]; 2]> {
    let (low, high) = points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    low.is_finite().then(|| {
        [0, 1].map(|axis| {
            let half = 0.5 * size[axis];
            [((-half - high[axis]) / size[axis]).ceil(), ((half - low[axis]) / size[axis]).floor()]
        })
    })
}

/// The vertices of a placed leaf.
fn vertices<'a>(world: &'a ReferenceWorld, placed: &'a ReferencePlacement) -> impl Iterator<Item = DVec3> + 'a {
    world.leaves[placed.leaf].mesh.positions.iter().map(|v| placed.transform.transform_point3(*v))
}

/// The shifts of each instance, and then of each place. Of a group, the corners of the box around it count.
fn all_shifts(world: &ReferenceWorld, size: [f64; 2]) -> impl Iterator<Item = Option<[[f64; 2]; 2]>> {
    let of_group = |group: &Vec<ReferencePlacement>| Bounds::of(group.iter().flat_map(|p| vertices(world, p)));
    let boxes: Vec<Bounds> = world.groups.iter().map(of_group).collect();
    let of_place = move |p: &ReferencePlace| {
        let around = &boxes[p.group];
        (!around.is_empty())
            .then(|| shifts(around.corners().into_iter().map(|v| p.transform.transform_point3(v)), size))
            .flatten()
    };
    world.instances.iter().map(move |p| shifts(vertices(world, p), size)).chain(world.places.iter().map(of_place))
}

/// Number of instances and places of groups in the cell around the origin, for a world that repeats with this period.
pub(super) fn copies(world: &ReferenceWorld, size: [f64; 2]) -> f64 {
    let count = |shifts: [[f64; 2]; 2]| shifts.iter().map(|[a, b]| (b - a + 1.0).max(0.0)).product::<f64>();
    all_shifts(world, size).flatten().map(count).sum()
}

/// What of a world that repeats stands in the cell around the origin.
pub(super) struct Cell {
    /// The leaf and the transform of each instance that stands by itself, and the index of the world's instance.
    pub placed: Vec<(usize, DMat4)>,
    pub instance: Vec<usize>,
    /// The group and the transform of each place, and the index of the world's place.
    pub places: Vec<(usize, DMat4)>,
    pub place: Vec<u32>,
}

impl Cell {
    /// The cell of a world with this period.
    pub fn of(world: &ReferenceWorld, size: [f64; 2]) -> Cell {
        let mut cell = Cell { placed: Vec::new(), instance: Vec::new(), places: Vec::new(), place: Vec::new() };
        for (k, shifts) in all_shifts(world, size).enumerate() {
            let Some([along_x, along_y]) = shifts else { continue };
            for x in along_x[0] as i64..=along_x[1] as i64 {
                for y in along_y[0] as i64..=along_y[1] as i64 {
                    let by = DMat4::from_translation(DVec3::new(x as f64 * size[0], y as f64 * size[1], 0.0));
                    match k.checked_sub(world.instances.len()) {
                        None => {
                            let p = &world.instances[k];
                            cell.placed.push((p.leaf, by * p.transform));
                            cell.instance.push(k);
                        }
                        Some(k) => {
                            let p = &world.places[k];
                            cell.places.push((p.group, by * p.transform));
                            cell.place.push(k as u32);
                        }
                    }
                }
            }
        }
        cell
    }
}
