//! Which sides of which leaves the cameras see and the sun lights, and whether any leaf can shade itself or another.
//!
//! Where an answer is uncertain, it is "needed": a triangle that may be edge-on in some part counts for both sides.

use super::placement::LeafPlacement;
use glam::{DMat3, DVec2, DVec3};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_files::progress::TaskProgress;
use mesophyll_optics::side::{Side, Sides};

/// Smaller cosines than this count as edge-on.
const EDGE: f64 = 0.03;

const BOTH: Sides<bool> = Sides { front: true, back: true };

/// The visible sides of one leaf, over all its placements and all cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct VisibleSides {
    /// Whether some camera sees this side.
    pub seen: Sides<bool>,
    /// Whether some camera sees this side where the sun shines on it.
    pub lit: Sides<bool>,
    /// Whether some camera sees this side where the sun shines on the other side.
    pub through: Sides<bool>,
}

impl VisibleSides {
    /// All of it, for a leaf whose mesh is not known yet.
    pub const ALL: VisibleSides = VisibleSides { seen: BOTH, lit: BOTH, through: BOTH };

    /// Adds what `eyes` see of one placement. The sun is given by its direction and its disk's radius (rad).
    ///
    /// Across a triangle, the normal and the vector to the eye are both linear. So the cosines of all nine pairs of
    /// corners bound the cosine at every point, and three cosines do so for the sun.
    pub fn add(&mut self, mesh: &LeafMesh, placement: &LeafPlacement, eyes: &[DVec3], sun: Option<(DVec3, f64)>) {
        if self.is_full(sun.is_some()) {
            return;
        }
        let turn = DMat3::from_mat4(placement.transform).inverse().transpose();
        let normals: Vec<DVec3> = mesh.normals.iter().map(|n| (turn * *n).normalize_or_zero()).collect();
        let sides = |cosines: &[f64], edge: f64| Sides {
            front: cosines.iter().any(|c| *c > -edge),
            back: cosines.iter().any(|c| *c < edge),
        };
        for t in 0..mesh.triangles() {
            let corner = mesh.triangle(t);
            let sunny = sun.map(|(l, radius)| sides(&corner.map(|k| normals[k].dot(l)), EDGE + radius.sin()));
            // Most triangles show nothing that others have not shown, wherever they are seen from.
            if Side::ALL.iter().all(|side| !self.lacks(*side, sunny)) {
                continue;
            }
            let positions = corner.map(|k| placement.transform.transform_point3(mesh.positions[k]));
            for eye in eyes {
                let towards = positions.map(|p| (*eye - p).normalize_or_zero());
                let seen = sides(corner.map(|k| towards.map(|v| normals[k].dot(v))).as_flattened(), EDGE);
                for side in Side::ALL.into_iter().filter(|side| seen[*side]) {
                    self.seen[side] = true;
                    if let Some(sunny) = sunny {
                        self.lit[side] |= sunny[side];
                        self.through[side] |= sunny[side.other()];
                    }
                }
            }
            if self.is_full(sun.is_some()) {
                return;
            }
        }
    }

    /// Whether there is anything new in a side that is seen on a triangle whose sides `sunny` the sun shines on.
    fn lacks(&self, side: Side, sunny: Option<Sides<bool>>) -> bool {
        !self.seen[side]
            || sunny.is_some_and(|sunny| sunny[side] && !self.lit[side] || sunny[side.other()] && !self.through[side])
    }

    fn is_full(&self, sun: bool) -> bool {
        self.seen == BOTH && (!sun || (self.lit == BOTH && self.through == BOTH))
    }
}

/// Whether any leaf can shade another or itself; where none can, the reason.
///
/// A leaf cannot shade itself if all its facets face the light with the same side, by more than the disk's radius, and
/// if it covers no point twice as seen from the sun. Two leaves cannot shade each other if the balls around them,
/// widened by the disk's spread, do not overlap as seen from the sun.
pub fn shadows(
    meshes: &[Option<&LeafMesh>],
    placements: &[LeafPlacement],
    sun: DVec3,
    radius: f64,
) -> Result<(), &'static str> {
    let mut spheres = Vec::new();
    let bar = TaskProgress::new("which leaves shade each other", placements.len() as u64);
    for placement in placements {
        bar.advance(1);
        let Some(mesh) = meshes[placement.leaf] else { return Ok(()) };
        if !lit_once(mesh, placement, sun, radius) {
            return Ok(());
        }
        let (centre, r) = mesh.bounds();
        let scale = placement.transform.x_axis.truncate().length();
        spheres.push((placement.transform.transform_point3(centre), r * scale));
    }
    for (i, (a, ra)) in spheres.iter().enumerate() {
        for (b, rb) in &spheres[i + 1..] {
            let d = *b - *a;
            let across = (d - sun * d.dot(sun)).length();
            if across < ra + rb + d.length() * radius.tan() {
                return Ok(());
            }
        }
    }
    Err(if spheres.len() > 1 {
        "as seen from the sun no leaf overlaps another or itself"
    } else {
        "as seen from the sun the leaf does not overlap itself"
    })
}

/// Texels along a side of the raster that searches for overlaps.
const RASTER: usize = 512;

fn lit_once(mesh: &LeafMesh, placement: &LeafPlacement, sun: DVec3, radius: f64) -> bool {
    let across = sun.any_orthonormal_vector();
    let up = sun.cross(across);
    let flat: Vec<DVec2> = mesh
        .positions
        .iter()
        .map(|p| placement.transform.transform_point3(*p))
        .map(|p| DVec2::new(p.dot(across), p.dot(up)))
        .collect();
    let turn = DMat3::from_mat4(placement.transform);
    let low = flat.iter().fold(DVec2::INFINITY, |a, p| a.min(*p));
    let high = flat.iter().fold(DVec2::NEG_INFINITY, |a, p| a.max(*p));
    let texel = ((high - low).max_element() / RASTER as f64).max(f64::MIN_POSITIVE);
    let mut covered = vec![false; RASTER * RASTER];
    let mut lit = 0.0;
    for t in 0..mesh.triangles() {
        let [a, b, c] = mesh.triangle(t);
        let n = (mesh.positions[b] - mesh.positions[a]).cross(mesh.positions[c] - mesh.positions[a]);
        let Some(n) = n.try_normalize() else { continue };
        let cosine = (turn * n).normalize_or_zero().dot(sun);
        if cosine.abs() <= radius.sin() || cosine * lit < 0.0 {
            return false;
        }
        lit = cosine;
        let corners = [flat[a], flat[b], flat[c]].map(|p| (p - low) / texel);
        let from = corners[0].min(corners[1]).min(corners[2]).floor();
        let to = corners[0].max(corners[1]).max(corners[2]).ceil().min(DVec2::splat(RASTER as f64));
        let edges = [0, 1, 2].map(|k: usize| (corners[(k + 1) % 3] - corners[k]) * cosine.signum());
        for y in from.y as usize..to.y as usize {
            // The part of the distance from each edge that depends on the row.
            let of_row = [0, 1, 2].map(|k: usize| edges[k].x * (y as f64 + 0.5 - corners[k].y));
            for x in from.x as usize..to.x as usize {
                let px = x as f64 + 0.5;
                // A centre on an edge counts for neither neighbour.
                let inside = of_row[0] - edges[0].y * (px - corners[0].x) > 1e-9
                    && of_row[1] - edges[1].y * (px - corners[1].x) > 1e-9
                    && of_row[2] - edges[2].y * (px - corners[2].x) > 1e-9;
                if inside && std::mem::replace(&mut covered[y * RASTER + x], true) {
                    return false;
                }
            }
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat4;

    fn at(x: f64, z: f64, tilt: f64) -> LeafPlacement {
        LeafPlacement {
            leaf: 0,
            transform: DMat4::from_translation(DVec3::new(x, 0.0, z)) * DMat4::from_rotation_y(tilt),
            section: None,
            frame: 0,
        }
    }

    #[test]
    fn a_flat_leaf_shows_the_side_that_faces_the_eye() {
        let mesh = LeafMesh::rectangle(40.0, 30.0);
        let eyes = [DVec3::new(0.0, -20.0, 200.0)];
        let facing = |sun: Option<DVec3>, tilt: f64| {
            let mut f = VisibleSides::default();
            f.add(&mesh, &at(0.0, 0.0, tilt), &eyes, sun.map(|l| (l, 0.005)));
            f
        };
        let [front, back, none] =
            [(true, false), (false, true), (false, false)].map(|(front, back)| Sides { front, back });
        let above = facing(Some(DVec3::new(0.3, 0.0, 1.0).normalize()), 0.0);
        assert_eq!(above, VisibleSides { seen: front, lit: front, through: none });
        let below = facing(Some(-DVec3::Z), 0.0);
        assert_eq!(below, VisibleSides { seen: front, lit: none, through: front });
        let turned = facing(Some(DVec3::Z), std::f64::consts::PI);
        assert_eq!(turned, VisibleSides { seen: back, lit: back, through: none });
        assert_eq!(facing(None, 0.0).lit, none);
    }

    /// No corner of this triangle is seen from the back where the sun shines, but a point on its edge is. So testing
    /// only the corners is not sufficient.
    #[test]
    fn what_only_the_middle_of_a_triangle_shows_is_found() {
        let lean = |angle: f64| DVec3::new(angle.sin(), 0.0, angle.cos());
        let mesh = LeafMesh {
            positions: vec![DVec3::new(-20.0, 0.0, 0.0), DVec3::new(20.0, 0.0, 0.0), DVec3::new(0.0, 20.0, 0.0)],
            normals: vec![lean(-0.8), lean(0.8), lean(-0.8)],
            tangents: vec![(DVec3::X, 1.0); 3],
            uvs: vec![glam::DVec2::ZERO; 3],
            indices: vec![0, 1, 2],
            discs: false,
        };
        // A low eye nearby, and a low sun on the other side.
        let eye = DVec3::new(22.0, 0.0, 6.0);
        let sun = lean(-1.3);
        let at = |x: f64| {
            let w = (x + 20.0) / 40.0;
            let n = lean(-0.8) * (1.0 - w) + lean(0.8) * w;
            (n.dot(eye - DVec3::new(x, 0.0, 0.0)), n.dot(sun))
        };
        let found =
            |both: &dyn Fn((f64, f64)) -> bool| (0..=400).map(|k| f64::from(k) / 10.0 - 20.0).any(|x| both(at(x)));
        let mut f = VisibleSides::default();
        f.add(
            &mesh,
            &LeafPlacement { leaf: 0, transform: DMat4::IDENTITY, section: None, frame: 0 },
            &[eye],
            Some((sun, 0.0)),
        );
        let corners = [at(-20.0), at(20.0)];
        assert!(corners.iter().all(|(v, l)| !(*v > 0.03 * 45.0 && *l > 0.03)), "{corners:?}");
        assert!(found(&|(v, l)| v > 0.0 && l > 0.0) && f.lit.front);
    }

    #[test]
    fn shadows_are_left_out_only_where_none_can_fall() {
        let flat = LeafMesh::rectangle(40.0, 30.0);
        let sun = DVec3::new(0.5, 0.0, 1.0).normalize();
        let of = |mesh: &LeafMesh, places: &[LeafPlacement]| shadows(&[Some(mesh)], places, sun, 0.005);
        assert!(of(&flat, &[at(0.0, 0.0, 0.0)]).is_err());
        assert!(of(&flat, &[at(0.0, 0.0, 0.0), at(200.0, 0.0, 0.0)]).is_err());
        assert!(of(&flat, &[at(0.0, 0.0, 0.0), at(20.0, 30.0, 0.0)]).is_ok());
        // The two are far apart sideways, but one behind the other as seen from the sun.
        assert!(of(&flat, &[at(0.0, 0.0, 0.0), at(200.0, 400.0, 0.0)]).is_ok());
        // A wall on one edge is folded up beside the light's path. Sunlight from +x does not pass it.
        let mut walled = flat.clone();
        walled.positions.extend([DVec3::new(20.0, -15.0, 30.0), DVec3::new(20.0, 15.0, 30.0)]);
        walled.normals.extend([DVec3::X; 2]);
        walled.indices.extend([2, 1, 5, 2, 5, 4]);
        assert!(of(&walled, &[at(0.0, 0.0, 0.0)]).is_ok());
        // A second layer below the first is hidden, although every facet faces the sun.
        let mut stacked = flat.clone();
        stacked.positions.extend(flat.positions.iter().map(|p| *p - DVec3::Z * 5.0));
        stacked.normals.extend(flat.normals.iter());
        stacked.indices.extend(flat.indices.iter().map(|i| i + 4));
        assert!(of(&stacked, &[at(0.0, 0.0, 0.0)]).is_ok());
    }
}
