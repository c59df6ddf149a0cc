//! A crown of leaves: limbs on a trunk, boughs on limbs, twigs on boughs, and leaves in two ranks along twigs. It is
//! rigid, and one seed gives one tree. Lengths are in mm, z is up, and the trunk's foot is at the origin.
//!
//! Limbs reach for the surface of an ellipsoid. Each further order is shorter and leaves its parent at the angle
//! [`FORK`], a golden angle further around the parent than the one before, with random deviations from the seed. Leaves
//! are spread evenly over the length of all twigs.

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_manifest::Tree;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::{PI, TAU};

/// How many limbs, boughs and twigs grow on each branch of the order before.
const ORDERS: [usize; 3] = [16, 9, 7];
/// Mean angle between a branch and its parent (rad).
const FORK: f64 = 0.9;
/// Number of sides of a drawn branch, by its order from the trunk.
const SIDES: [usize; 4] = [12, 8, 6, 4];

/// One straight piece of wood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stick {
    /// Place where it begins (mm).
    pub from: DVec3,
    /// Place where it ends (mm).
    pub to: DVec3,
    /// Radius at its two ends.
    pub radius: [f64; 2],
    /// Order of the branch; 0 is the trunk.
    pub order: usize,
}

impl Stick {
    fn at(&self, x: f64) -> DVec3 {
        self.from.lerp(self.to, x)
    }

    fn along(&self) -> DVec3 {
        (self.to - self.from).normalize_or(DVec3::Z)
    }
}

/// The wood and the leaves of a tree.
#[derive(Debug, Clone, PartialEq)]
pub struct Grown {
    /// The pieces of wood, the trunk first.
    pub wood: Vec<Stick>,
    /// Transforms of blades to the world. Their tips are along +x and their fronts up.
    pub leaves: Vec<DMat4>,
}

/// Grows the tree.
pub fn grow(tree: &Tree) -> Grown {
    let mut rng = Pcg64::seed_from_u64(tree.seed);
    let mut stray = move || rng.random::<f64>() * 2.0 - 1.0;
    let golden = PI * (3.0 - 5f64.sqrt());
    let (height, crown) = (tree.height_mm, tree.crown_mm);
    let trunk = Stick {
        from: DVec3::ZERO,
        to: DVec3::new(0.02 * height * stray(), 0.02 * height * stray(), 0.9 * height),
        radius: [0.018 * height, 0.004 * height],
        order: 0,
    };
    // The crown is an ellipsoid from a fifth of the height to the top.
    let middle = DVec3::new(0.0, 0.0, 0.6 * height);
    let reach = DVec3::new(crown, crown, 0.4 * height);
    let mut wood = vec![trunk];
    let mut parents = vec![trunk];
    for (order, count) in ORDERS.into_iter().enumerate() {
        let mut children = Vec::new();
        for (k, parent) in parents.iter().enumerate() {
            let along = parent.along();
            let (u, v) = along.any_orthonormal_pair();
            for i in 0..count {
                let share = (i as f64 + 0.5 + 0.4 * stray()) / count as f64;
                // The first third of the trunk and the first fifth of a branch are bare.
                let bare = if order == 0 { 0.3 } else { 0.2 };
                let x = bare + (1.0 - bare) * share;
                let from = parent.at(x);
                let (sin, cos) = (golden * (i + k) as f64 + 0.5 * stray()).sin_cos();
                // Low limbs reach outward, and high ones upward.
                let fork = if order == 0 { 1.35 - 0.9 * share } else { FORK } + 0.2 * stray();
                let mut toward = along * fork.cos() + (u * cos + v * sin) * fork.sin();
                if order > 0 {
                    // The direction is turned slightly towards the light.
                    toward = (toward + 0.25 * DVec3::Z).normalize();
                }
                let length = if order == 0 {
                    0.8 * to_surface(from - middle, toward, reach)
                } else {
                    // Branches near the parent's tip are shorter.
                    let parent_length = parent.from.distance(parent.to);
                    (0.62 - 0.25 * share) * parent_length
                };
                let length = length * (1.0 + 0.15 * stray());
                let thick = 0.7 * (parent.radius[0] + (parent.radius[1] - parent.radius[0]) * x);
                children.push(Stick {
                    from,
                    to: from + toward * length,
                    radius: [thick, 0.3 * thick],
                    order: order + 1,
                });
            }
        }
        wood.extend(&children);
        parents = children;
    }
    let twigs = parents;
    // Twigs have the same number of leaves for each length. `ends` are the ends of the twigs on a line of all of them.
    let mut total = 0.0;
    let ends: Vec<f64> = twigs
        .iter()
        .map(|t| {
            total += t.from.distance(t.to);
            total
        })
        .collect();
    let leaves = (0..tree.count)
        .map(|k| {
            let along = total * (k as f64 + 0.5 + 0.3 * stray()) / tree.count as f64;
            let twig = ends.partition_point(|e| *e < along).min(twigs.len() - 1);
            let length = twigs[twig].from.distance(twigs[twig].to);
            // A twig is bare near its bough.
            let x = 0.12 + 0.88 * (1.0 - (ends[twig] - along) / length);
            leaf(tree, &twigs[twig], x.clamp(0.0, 1.0), k, &mut stray)
        })
        .collect();
    Grown { wood, leaves }
}

/// A blade in one of two ranks beside its twig, as level as the twig allows.
fn leaf(tree: &Tree, twig: &Stick, x: f64, rank: usize, stray: &mut impl FnMut() -> f64) -> DMat4 {
    let along = twig.along();
    let beside = along.cross(DVec3::Z).normalize_or(along.any_orthonormal_vector())
        * if rank.is_multiple_of(2) { 1.0 } else { -1.0 };
    let spread = tree.spread_deg.to_radians();
    let angle = 0.95 + 0.3 * stray();
    let out = (along * angle.cos() + beside * angle.sin()).normalize();
    let up = (DVec3::Z - out * out.z).normalize_or(out.any_orthonormal_vector());
    let turn = DQuat::from_mat3(&DMat3::from_cols(out, up.cross(out), up))
        * DQuat::from_rotation_y(tree.droop_deg.to_radians() + spread * stray())
        * DQuat::from_rotation_x(spread * stray());
    let scale = tree.scale * (1.0 + 0.15 * stray());
    let centre = twig.at(x) + turn * DVec3::X * (tree.offset_mm * scale);
    DMat4::from_scale_rotation_translation(DVec3::splat(scale), turn, centre)
}

/// Distance from inside an ellipsoid around the origin to its surface. From outside, or beyond the surface, it is a
/// tenth of the ellipsoid's reach.
fn to_surface(from: DVec3, toward: DVec3, reach: DVec3) -> f64 {
    let (p, d) = (from / reach, toward / reach);
    let (a, b, c) = (d.length_squared(), p.dot(d), p.length_squared() - 1.0);
    let root = b * b - a * c;
    let far = if root > 0.0 { (root.sqrt() - b) / a } else { 0.0 };
    far.max(0.1 * reach.min_element())
}

/// All wood as one mesh of cones. Normals point outward, and v goes from foot to tip.
pub fn wood(sticks: &[Stick]) -> LeafMesh {
    let mut mesh = LeafMesh::default();
    for stick in sticks {
        let along = stick.along();
        let (u, v) = along.any_orthonormal_pair();
        let sides = SIDES[stick.order.min(SIDES.len() - 1)];
        let slope = (stick.radius[0] - stick.radius[1]) / stick.from.distance(stick.to).max(1e-9);
        let first = mesh.positions.len() as u32;
        for end in [0, 1] {
            for i in 0..=sides {
                let (sin, cos) = (TAU * i as f64 / sides as f64).sin_cos();
                let out = u * cos + v * sin;
                mesh.positions.push(stick.at(end as f64) + out * stick.radius[end]);
                mesh.normals.push((out + along * slope).normalize());
                mesh.tangents.push((v * cos - u * sin, -1.0));
                mesh.uvs.push(DVec2::new(i as f64 / sides as f64, end as f64));
            }
        }
        let ring = sides as u32 + 1;
        for i in 0..sides as u32 {
            let a = first + i;
            mesh.indices.extend([a, a + 1, a + ring, a + 1, a + ring + 1, a + ring]);
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree() -> Tree {
        Tree {
            leaves: vec!["a".into()],
            count: 500,
            height_mm: 3000.0,
            crown_mm: 1000.0,
            offset_mm: 30.0,
            droop_deg: 20.0,
            spread_deg: 15.0,
            scale: 1.0,
            bark: [0.1; 3],
            seed: 3,
        }
    }

    #[test]
    fn a_seed_is_a_tree_and_leaves_are_spread_evenly() {
        let grown = grow(&tree());
        assert_eq!(grown, grow(&tree()));
        assert_ne!(grown, grow(&Tree { seed: 4, ..tree() }));
        assert_eq!(grown.leaves.len(), 500);
        assert_eq!(grown.wood.len(), 1 + 16 + 16 * 9 + 16 * 9 * 7);
        for t in &grown.leaves {
            // Transforms are rigid and right-handed, with fronts roughly up.
            assert!((t.determinant().cbrt() - t.x_axis.truncate().length()).abs() < 1e-9);
            assert!(t.transform_vector3(DVec3::Z).z > 0.0);
            let centre = t.transform_point3(DVec3::ZERO);
            assert!(centre.z > 0.0 && centre.z < 1.3 * 3000.0 && centre.truncate().length() < 1.8 * 1000.0, "{centre}");
        }
        // Neighbours on the line of twigs are neighbours on the tree.
        let many = grow(&Tree { count: 20_000, ..tree() });
        let near = many.leaves.windows(2).filter(|w| w[0].w_axis.distance(w[1].w_axis) < 150.0).count();
        assert!(near > 15_000, "{near}");
    }

    #[test]
    fn wood_is_closed_around_and_its_normals_point_out() {
        let grown = grow(&tree());
        let mesh = wood(&grown.wood);
        for t in 0..mesh.triangles() {
            let [a, b, c] = mesh.triangle(t).map(|k| mesh.positions[k]);
            let n = mesh.normals[mesh.triangle(t)[0]];
            assert!((b - a).cross(c - a).dot(n) > 0.0, "facet {t}");
        }
    }
}
