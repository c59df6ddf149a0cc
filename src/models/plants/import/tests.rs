//! Plants with known branches, given as triangles.

use super::*;
use crate::form::Plant;
use crate::growth::{grow, spec::PlantSpec};
use glam::{DMat4, DQuat};
use mesophyll_files::glb::{self, Glb};
use mesophyll_files::mesh::LeafMesh;
use serde_json::json;
use std::path::PathBuf;

/// A known branch.
#[derive(Debug, Clone)]
struct Known {
    root: DVec3,
    radius: f64,
    length: f64,
    parent: Option<usize>,
}

/// How a soup of triangles is written.
#[derive(Debug, Clone, Copy)]
struct Style {
    /// The unit of the file's positions (mm).
    unit: f64,
    /// A scale of the positions, which the node undoes together with a turn.
    scale: f64,
    /// Number of triangles in a primitive.
    cut: usize,
    /// Whether shared vertices are repeated for every triangle.
    apart: bool,
}

const PLAIN: Style = Style { unit: 1000.0, scale: 1.0, cut: usize::MAX, apart: false };

/// From z up (mm) to the file's frame (y up, mm).
fn to_file(p: DVec3) -> DVec3 {
    DVec3::new(p.x, p.z, -p.y)
}

fn write_soup(meshes: &[LeafMesh], style: Style, path: &Path) {
    let mut file = Glb::default();
    let mut primitives = Vec::new();
    let mut write = |positions: &[DVec3], indices: &[u32]| {
        let narrow: Vec<[f32; 3]> =
            positions.iter().map(|p| (to_file(*p) / (style.unit * style.scale)).as_vec3().to_array()).collect();
        let (position, index) = (file.floats("VEC3", &narrow), file.indices(indices));
        primitives.push(json!({"attributes": {"POSITION": position}, "indices": index}));
    };
    // Everything goes into one list first, so that no piece has a primitive of its own.
    let (mut positions, mut indices) = (Vec::new(), Vec::new());
    for mesh in meshes {
        let first = positions.len() as u32;
        positions.extend(mesh.positions.iter().copied());
        indices.extend(mesh.indices.iter().map(|i| i + first));
    }
    for part in indices.chunks((style.cut.saturating_mul(3)).min(indices.len())) {
        if style.apart || style.cut < usize::MAX {
            let own: Vec<DVec3> = part.iter().map(|i| positions[*i as usize]).collect();
            write(&own, &(0..own.len() as u32).collect::<Vec<_>>());
        } else {
            write(&positions, part);
        }
    }
    let root = json!({"asset": glb::asset(), "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1]}, {"mesh": 0, "scale": [style.scale, style.scale, style.scale]}],
        "meshes": [{"primitives": primitives}]});
    file.write(path, root).unwrap();
}

/// The share of known branches that were found (root within two radii, length within 5 %), and the share of them with
/// the right parent.
fn judge(known: &[Known], found: &PlantPieces) -> [f64; 2] {
    let mut taken = vec![false; found.branches.len()];
    let matched: Vec<Option<usize>> = known
        .iter()
        .map(|k| {
            let best = (0..found.branches.len())
                .filter(|i| !taken[*i])
                .filter(|i| (found.branches[*i].tube.length() / k.length - 1.0).abs() <= 0.05)
                .map(|i| (i, found.branches[i].tube.axis[0].distance(to_file(k.root))))
                .filter(|(_, d)| *d <= 2.0 * k.radius)
                .min_by(|a, b| a.1.total_cmp(&b.1))?
                .0;
            taken[best] = true;
            Some(best)
        })
        .collect();
    let there = matched.iter().flatten().count();
    let right = known
        .iter()
        .zip(&matched)
        .filter(|(k, m)| {
            m.is_some_and(|m| match k.parent {
                None => found.branches[m].parent.is_none(),
                Some(p) => matched[p].is_some() && found.branches[m].parent == matched[p],
            })
        })
        .count();
    [there as f64 / known.len() as f64, right as f64 / known.len() as f64]
}

fn of_plant(plant: &Plant) -> (Vec<LeafMesh>, Vec<Known>) {
    let moved = |mesh: &LeafMesh, frame: DMat4| LeafMesh {
        positions: mesh.positions.iter().map(|p| frame.transform_point3(*p)).collect(),
        ..mesh.clone()
    };
    let wood = plant.branches.iter().map(|b| moved(&b.wood, b.frame()));
    let leaves = plant.leaves.iter().map(|l| moved(&plant.blades[l.blade].mesh, l.transform));
    let known = plant.branches.iter().map(|b| Known {
        root: b.root,
        radius: b.root_radius,
        length: b.length(),
        parent: b.parent.map(|j| j.branch),
    });
    (wood.chain(leaves).collect(), known.collect())
}

fn preset(name: &str) -> Plant {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../data/plants").join(format!("{name}.toml"));
    grow(&PlantSpec::read(&path).unwrap(), None)
}

fn through_a_file(meshes: &[LeafMesh], style: Style) -> PlantPieces {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("soup.glb");
    write_soup(meshes, style, &path);
    import(&path, None).unwrap().1
}

/// A tree whose roots lie on the parent's axis, with bent axes, and with leaves among the wood.
#[test]
fn branches_of_a_grown_tree_are_found() {
    let plant = preset("wych-elm");
    let (meshes, known) = of_plant(&plant);
    let found = through_a_file(&meshes, PLAIN);
    let [there, right] = judge(&known, &found);
    let unattached = found.branches.iter().filter(|b| b.unattached.is_some()).count();
    println!(
        "{} of {} branches, {:.2} % there, {:.2} % of the parents right, {unattached} unattached, {} leaves of {}, {} \
         others",
        found.branches.len(),
        known.len(),
        100.0 * there,
        100.0 * right,
        found.leaves.len(),
        plant.leaves.len(),
        found.others.len()
    );
    assert!(there >= 0.99 && right >= 0.97, "{there} {right}");
    assert_eq!(found.leaves.len(), plant.leaves.len());
    // The radii at both ends are right.
    let radius = |tube: &TaperedTube| (tube.root_radius, tube.tip_radius);
    let trunk = &found.branches[0].tube;
    assert!((radius(trunk).0 / plant.branches[0].root_radius - 1.0).abs() < 0.02, "{:?}", radius(trunk));
    let hung = found.leaves.iter().filter(|l| l.joint.is_some()).count();
    assert!(hung as f64 > 0.99 * found.leaves.len() as f64, "{hung}");
}

#[test]
fn units_scales_and_primitives_change_nothing() {
    let plant = preset("bird-cherry-sapling");
    let (meshes, known) = of_plant(&plant);
    let styles = [
        PLAIN,
        Style { scale: 0.01, ..PLAIN },
        Style { scale: 0.001, apart: true, ..PLAIN },
        // Primitives end in the middle of a branch.
        Style { cut: 97, scale: 3.0, ..PLAIN },
    ];
    for style in styles {
        let found = through_a_file(&meshes, style);
        assert_eq!(judge(&known, &found), [1.0, 1.0], "{style:?}");
        assert_eq!(found.leaves.len(), plant.leaves.len());
    }
}

/// A generator that shares no code with the other one: rings along a walk, closed ends, branches that fork in twos and
/// threes.
struct Walk {
    meshes: Vec<LeafMesh>,
    known: Vec<Known>,
    state: u64,
    /// The place of a child's root, from the parent's axis (0) to its surface (1).
    outside: f64,
    sides: usize,
    curve: f64,
}

impl Walk {
    fn chance(&mut self) -> f64 {
        self.state = self.state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.state >> 11) as f64 / (1u64 << 53) as f64
    }

    fn branch(&mut self, parent: Option<usize>, root: DVec3, heading: DVec3, radius: f64, length: f64, level: usize) {
        let steps = 9;
        let bend = heading.any_orthonormal_vector();
        let (mut place, mut d) = (root, heading);
        let mut path = vec![place];
        for _ in 0..steps {
            d = (DQuat::from_axis_angle(bend, self.curve / f64::from(steps)) * d).normalize();
            place += d * (length / f64::from(steps));
            path.push(place);
        }
        let mut mesh = LeafMesh::default();
        let thin = 0.35;
        for (k, p) in path.iter().enumerate() {
            let t = (path[(k + 1).min(path.len() - 1)] - path[k.saturating_sub(1)]).normalize();
            let (u, v) = (bend, t.cross(bend));
            let r = radius * (1.0 - (1.0 - thin) * k as f64 / f64::from(steps));
            for i in 0..self.sides {
                let a = std::f64::consts::TAU * i as f64 / self.sides as f64;
                mesh.positions.push(*p + (u * a.cos() + v * a.sin()) * r);
            }
        }
        let n = self.sides as u32;
        for k in 0..path.len() as u32 - 1 {
            for i in 0..n {
                let (a, b) = (k * n + i, k * n + (i + 1) % n);
                mesh.indices.extend([a, b, a + n, b, b + n, a + n]);
            }
        }
        // The ends are closed by fans around the ends of the axis.
        for (ring, centre) in [(0, path[0]), (path.len() as u32 - 1, path[path.len() - 1])] {
            let middle = mesh.positions.len() as u32;
            mesh.positions.push(centre);
            (0..n).for_each(|i| mesh.indices.extend([ring * n + i, ring * n + (i + 1) % n, middle]));
        }
        self.meshes.push(mesh);
        let own = self.known.len();
        self.known.push(Known { root, radius, length, parent });
        if level == 3 {
            return;
        }
        for child in 0..[7, 5, 4][level] {
            let at = 0.3 + 0.65 * (f64::from(child) + 0.8 * self.chance()) / f64::from([7, 5, 4][level]);
            let k = ((at * f64::from(steps)) as usize).min(path.len() - 2);
            let here = path[k].lerp(path[k + 1], at * f64::from(steps) - k as f64);
            let t = (path[k + 1] - path[k]).normalize();
            let (u, v) = t.any_orthonormal_pair();
            let a = 2.4 * f64::from(child) + self.chance();
            let out = u * a.cos() + v * a.sin();
            let r = radius * (1.0 - (1.0 - thin) * at);
            let fork = 0.7 + 0.4 * self.chance();
            let (size, long) = (0.45 + 0.25 * self.chance(), 0.35 + 0.2 * self.chance());
            let outside = self.outside;
            self.branch(
                Some(own),
                here + out * (r * outside),
                t * fork.cos() + out * fork.sin(),
                r * size,
                length * long,
                level + 1,
            );
        }
    }
}

#[test]
fn branches_of_another_generator_are_found() {
    for (outside, sides, curve) in [(0.0, 8, 0.0), (1.0, 6, 0.9), (0.6, 5, 1.6), (1.0, 3, 0.5)] {
        let mut walk = Walk { meshes: Vec::new(), known: Vec::new(), state: 5, outside, sides, curve };
        walk.branch(None, DVec3::new(100.0, -50.0, 0.0), DVec3::new(0.1, 0.0, 1.0).normalize(), 90.0, 4000.0, 0);
        let found = through_a_file(&walk.meshes, PLAIN);
        let [there, right] = judge(&walk.known, &found);
        println!(
            "roots {outside} radii out, {sides} sides, bent by {curve}: {:.1} % of {} there, {:.1} % of the parents \
             right",
            100.0 * there,
            walk.known.len(),
            100.0 * right
        );
        assert!(there >= 0.95 && right >= 0.95, "{outside} {sides} {curve}: {there} {right}");
    }
}

/// A floating branch, a ball and a cut-off piece without length are listed, each with a reason.
#[test]
fn what_cannot_be_attached_is_listed() {
    let mut walk = Walk { meshes: Vec::new(), known: Vec::new(), state: 5, outside: 0.0, sides: 8, curve: 0.3 };
    walk.branch(None, DVec3::ZERO, DVec3::Z, 40.0, 2000.0, 3);
    walk.branch(None, DVec3::new(500.0, 0.0, 1000.0), DVec3::X, 10.0, 300.0, 3);
    let ring = crate::form::tube(&[DVec3::new(0.0, 900.0, 0.0), DVec3::new(0.0, 902.0, 0.0)], [30.0, 30.0], 8, 2);
    walk.meshes.push(ring);
    let found = through_a_file(&walk.meshes, PLAIN);
    assert_eq!((found.branches.len(), found.others.len(), found.leaves.len()), (2, 1, 0));
    let floating = &found.branches[1];
    assert!(floating.parent.is_none() && floating.level.is_none());
    let table = table::branches(&found);
    let lines: Vec<&str> = table.lines().collect();
    assert!(lines[1].starts_with("b0,,,0,1999.9") && lines[1].ends_with(",1.0000,ok"), "{}", lines[1]);
    assert!(lines[2].contains("undetermined: parent (the nearest branch is b0"), "{}", lines[2]);
    assert!(found.others[0].why.contains("long and"), "{}", found.others[0].why);
}

/// A trunk and a branch that one triangle joins are one piece, which forks. It is listed as such, whatever the lengths
/// of both. What grows on either is not attached, and what grows on that has no level.
#[test]
fn bark_that_forks_is_listed_and_what_it_carries_is_not_guessed() {
    for (sides, at, length) in [(8, 1000.0, 1500.0), (8, 200.0, 400.0), (5, 1500.0, 100.0), (3, 1900.0, 300.0)] {
        let mut walk = Walk { meshes: Vec::new(), known: Vec::new(), state: 5, outside: 0.0, sides, curve: 0.02 };
        walk.branch(None, DVec3::ZERO, DVec3::Z, 40.0, 2000.0, 3);
        walk.branch(None, DVec3::new(45.0, 0.0, at), DVec3::X, 10.0, length, 3);
        let (upper, lower) = (DVec3::new(0.0, 0.0, 700.0), DVec3::new(0.0, -10.0, 1300.0));
        walk.branch(None, upper, DVec3::Y, 9.0, 300.0, 3);
        walk.branch(None, upper + DVec3::Y * 200.0, DVec3::Z, 4.0, 100.0, 3);
        walk.branch(None, lower, DVec3::NEG_Y, 6.0, 200.0, 3);
        let child = walk.meshes.remove(1);
        let trunk = &mut walk.meshes[0];
        let (own, nearest) = (trunk.positions.len() as u32, |p: DVec3, list: &[DVec3]| {
            (0..list.len()).min_by(|a, b| list[*a].distance(p).total_cmp(&list[*b].distance(p))).unwrap() as u32
        });
        let on = nearest(child.positions[0], &trunk.positions);
        trunk.positions.extend(&child.positions);
        trunk.indices.extend(child.indices.iter().map(|k| own + k));
        trunk.indices.extend([on, own, own + 1]);
        let found = through_a_file(&walk.meshes, PLAIN);
        assert_eq!((found.branches.len(), found.others.len()), (3, 1), "{length}");
        assert!(found.others[0].why.contains("it forks"), "{}", found.others[0].why);
        let stands = |b: &super::BranchPiece| b.unattached.as_ref().is_some_and(|why| why.contains("others.csv"));
        assert_eq!(found.branches.iter().filter(|b| stands(b)).count(), 2, "{length}");
        assert!(found.branches.iter().all(|b| b.level.is_none() && (stands(b) || b.parent.is_some())), "{length}");
    }
}

/// A rectangle of two triangles, which share a diagonal, gets its true length and width.
#[test]
fn blades_are_measured_along_their_sides() {
    let trunk = crate::form::tube(&[DVec3::ZERO, DVec3::Z * 400.0], [6.0, 3.0], 8, 6);
    let mut blade = LeafMesh::rectangle(50.0, 30.0);
    blade.positions.iter_mut().for_each(|p| *p += DVec3::new(30.0, 0.0, 200.0));
    let found = through_a_file(&[trunk, blade], PLAIN);
    let [leaf] = &found.leaves[..] else { panic!("{} blades", found.leaves.len()) };
    assert!((leaf.size[0] - 50.0).abs() < 0.01 && (leaf.size[1] - 30.0).abs() < 0.01, "{:?}", leaf.size);
    assert!(leaf.joint.is_some());
}

/// Small files that would need endless work or memory are refused by name.
#[test]
fn files_that_promise_too_much_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let told = |root: serde_json::Value| {
        let path = dir.path().join("plant.gltf");
        std::fs::write(&path, root.to_string()).unwrap();
        super::soup::read(&path, None).unwrap_err().to_string()
    };
    let nodes: Vec<_> = (0..60).map(|k| if k < 59 { json!({"children": [k + 1, k + 1]}) } else { json!({}) }).collect();
    let shared = told(json!({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes}));
    assert!(shared.contains("nodes[1]: is the child of more than one node"), "{shared}");
    let sparse = json!({"componentType": 5126, "type": "VEC3", "count": 40_000_000_000u64, "min": [0, 0, 0],
        "max": [1, 1, 1],
        "sparse": {"count": 1, "indices": {"bufferView": 0, "componentType": 5123}, "values": {"bufferView": 0}}});
    let sparse =
        told(json!({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "accessors": [sparse],
        "bufferViews": [{"buffer": 0, "byteLength": 12}],
        "buffers": [{"byteLength": 12, "uri": "data:application/octet-stream;base64,AAAAAAAAAAAAAAAA"}]}));
    assert!(sparse.contains("accessors[0].count: found 40000000000"), "{sparse}");
    // The library itself would panic at this one.
    let outside = told(json!({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}], "meshes": [{"primitives": [{"attributes": {"NORMAL": 0, "POSITION": 7}}]}],
        "accessors": [{"componentType": 5126, "type": "VEC3", "count": 3}]}));
    assert!(outside.contains("meshes[0].primitives[0].attributes.POSITION: found 7"), "{outside}");
}

#[test]
fn principal_axes_of_a_matrix() {
    let turn = glam::DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -0.7));
    let m = turn * glam::DMat3::from_diagonal(DVec3::new(2.0, 5.0, 1.0)) * turn.transpose();
    let found = axis::principal(m);
    for ((value, vector), (wanted, axis)) in
        found.into_iter().zip([(5.0, turn.y_axis), (2.0, turn.x_axis), (1.0, turn.z_axis)])
    {
        assert!((value - wanted).abs() < 1e-12 && (vector.dot(axis).abs() - 1.0).abs() < 1e-12, "{value} {vector}");
    }
}
