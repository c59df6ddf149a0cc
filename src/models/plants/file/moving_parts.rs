//! Writes a plant that moves as binary glTF with an animation.
//!
//! Each branch's node moves with the place where it grows. The bark is a skinned mesh. Its joints are the
//! cross-sections that carry its vertices in both renderers ([`BarkCarriers`]), and each joint is a node in the
//! branch's node. A vertex belongs to one joint only. So at a key, the bark is exactly the pose, and not a mean of two
//! turns. The branch's own node is the joint of its root. Leaves are nodes in the node of their branch. The nodes
//! themselves hold the plant's pose at rest.
//!
//! The plant's node has a node below it that holds everything and has no transform of its own. The skins begin there.
//! Blender takes the node at which skins begin for a bone, and bones forget how they are scaled.
//!
//! A node that does not move relative to the node above it has no channel. In glTF the parent of a skinned mesh has no
//! effect, so the meshes of bark stand beside the plant's node, in metres.

use super::writer::{Shapes, below, narrow, node, placed, rooted, upright, whole};
use crate::form::{Branch, Plant};
use crate::pose::RigidMotion;
use crate::pose::bark::BarkCarriers;
use crate::{Error, Result};
use glam::DMat4;
use mesophyll_files::mesh::LeafMesh;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::path::Path;

/// A node stands still if its place in the node above moves by less than this share of itself, where a place below 1 mm
/// counts as 1 mm.
const STILL: f32 = 1e-6;

/// The parts of a plant that get keys: the cross-sections of its branches that carry something.
#[derive(Debug, Clone, PartialEq)]
pub struct MovingParts {
    /// Branch and share of its axis of each part: first the roots of all branches in their order, then the leaves, then
    /// the joints of the bark.
    pub on: Vec<(usize, f64)>,
    /// For each branch, the keyed sections that carry its bark, and the one of them that carries each vertex.
    bark: Vec<(Vec<usize>, Vec<u16>)>,
}

impl MovingParts {
    /// The cross-sections of a plant at rest that get keys.
    pub fn of(plant: &Plant) -> MovingParts {
        let roots = (0..plant.branches.len()).map(|k| (k, 0.0));
        let mut on: Vec<(usize, f64)> =
            roots.chain(plant.leaves.iter().map(|l| (l.joint.branch, l.joint.at))).collect();
        let own = |(k, branch): (usize, &Branch)| {
            let own = BarkCarriers::new(branch);
            let joint = |at: &f64| match *at {
                0.0 => k,
                at => {
                    on.push((k, at));
                    on.len() - 1
                }
            };
            (own.at.iter().map(joint).collect(), own.of_vertices.iter().map(|section| *section as u16).collect())
        };
        let bark = plant.branches.iter().enumerate().map(own).collect();
        MovingParts { on, bark }
    }
}

/// Translation (mm) and rotation of a node, relative to the node above it.
type Place = ([f32; 3], [f32; 4]);

/// The plant's nodes: roots of branches, leaves and joints, in the order of [`MovingParts::on`].
struct Nodes<'a> {
    plant: &'a Plant,
    carried: &'a MovingParts,
    /// Frames at rest, in the plant's frame.
    rest: Vec<DMat4>,
}

impl Nodes<'_> {
    fn new<'a>(plant: &'a Plant, carried: &'a MovingParts) -> Nodes<'a> {
        let branches = plant.branches.len();
        let rest = carried.on.iter().enumerate().map(|(k, (branch, at))| match k.checked_sub(branches) {
            None => plant.branches[k].frame(),
            Some(leaf) if leaf < plant.leaves.len() => plant.leaves[leaf].transform,
            Some(_) => {
                let branch = &plant.branches[*branch];
                let frame = branch.frame();
                DMat4::from_cols(frame.x_axis, frame.y_axis, frame.z_axis, branch.point(*at).0.extend(1.0))
            }
        });
        Nodes { plant, carried, rest: rest.collect() }
    }

    /// The node above: the root of a branch, or `None` for a trunk, which is in the plant's node.
    fn above(&self, k: usize) -> Option<usize> {
        match self.plant.branches.get(k) {
            Some(branch) => branch.parent.map(|joint| joint.branch),
            None => Some(self.carried.on[k].0),
        }
    }

    /// The places of all nodes relative to the nodes above them, after `motions` moved them from rest.
    fn places(&self, motions: &[RigidMotion]) -> Vec<Place> {
        let now: Vec<DMat4> = motions.iter().zip(&self.rest).map(|(by, rest)| by.carry(*rest)).collect();
        let place = |(k, frame): (usize, &DMat4)| {
            let local = self.above(k).map_or(*frame, |above| now[above].inverse() * *frame);
            let (_, turn, place) = local.to_scale_rotation_translation();
            (narrow(place), turn.normalize().as_quat().normalize().to_array())
        };
        now.iter().enumerate().map(place).collect()
    }
}

/// Writes `path` (.glb), whole or not at all: `plant` at rest, with an animation. Its keys lie `after` seconds after
/// the time `from`. They begin at 0 and rise, in single precision too. For such a time, `motions` gives how each of
/// `carried.on` moves from rest, in the plant's frame. The animation begins at 0 s, because glTF has no earlier time;
/// its `extras` keep `from` as `from_s`.
///
/// # Errors
/// [`Error::Missed`] where nothing moves, and the errors of [`mesophyll_files::glb::Glb::write`].
pub fn write_moving(
    plant: &Plant,
    carried: &MovingParts,
    from: f64,
    after: &[f64],
    motions: impl Fn(f64) -> Vec<RigidMotion> + Sync,
    path: &Path,
) -> Result<()> {
    let all = Nodes::new(plant, carried);
    let keys: Vec<Vec<Place>> = after.par_iter().map(|after| all.places(&motions(from + after))).collect();
    let mut shapes = Shapes::of(plant);
    let blades = shapes.blades(plant);
    // Node 0 holds the plant in mm, and keyed section k is node k + 1. The meshes of bark follow, and then the plant's
    // own node, which scales and turns all of it.
    let mut nodes = vec![json!({"name": format!("{} in mm", plant.name)})];
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); plant.branches.len() + 1];
    for (k, (_, at)) in carried.on.iter().enumerate() {
        let above = all.above(k).map_or(0, |above| above + 1);
        children[above].push(k + 1);
        nodes.push(match (plant.branches.get(k), plant.leaves.get(k.wrapping_sub(plant.branches.len()))) {
            (Some(branch), _) => node(branch, below(plant, branch).1, path)?,
            (None, leaf) => {
                let local = all.rest[above - 1].inverse() * all.rest[k];
                let mut node = placed(local);
                if let Some(leaf) = leaf {
                    node["scale"] = json!(narrow(local.to_scale_rotation_translation().0));
                    node["mesh"] = json!(blades[leaf.blade]);
                    node["extras"] = json!({ "at": at });
                }
                node
            }
        });
    }
    let mut skins: Vec<Value> = Vec::new();
    let mut bark_nodes = Vec::new();
    for (branch, (joints, of_vertices)) in plant.branches.iter().zip(&carried.bark) {
        if branch.wood.triangles() == 0 {
            continue;
        }
        let mesh = bark(&mut shapes, branch, of_vertices);
        let bind = shapes.file.floats("MAT4", &joints.iter().map(|k| unbound(all.rest[*k])).collect::<Vec<_>>());
        let joints: Vec<usize> = joints.iter().map(|k| k + 1).collect();
        skins.push(json!({"joints": joints, "inverseBindMatrices": bind, "skeleton": 0}));
        bark_nodes.push(nodes.len());
        nodes.push(json!({"name": format!("{} bark", branch.name), "mesh": mesh, "skin": skins.len() - 1}));
    }
    let mut own = whole(plant);
    own["children"] = json!([0]);
    nodes.push(own);
    let roots = [vec![nodes.len() - 1], bark_nodes].concat();
    let mut root = rooted(nodes, &children);
    root["scenes"][0]["nodes"] = json!(roots);
    if !skins.is_empty() {
        root["skins"] = json!(skins);
    }
    let input = shapes.file.times(&after.iter().map(|t| *t as f32).collect::<Vec<_>>());
    let (samplers, channels) = tracks(&mut shapes, &all, &keys, input);
    if channels.is_empty() {
        return Err(Error::Missed("nothing of the plants moves over these times".into()));
    }
    root["animations"] =
        json!([{"name": "wind", "samplers": samplers, "channels": channels, "extras": {"from_s": from}}]);
    shapes.write(path, root)
}

/// The transform from the file's frame to that of a joint at rest.
fn unbound(rest: DMat4) -> [f32; 16] {
    let mut inverse = (upright() * rest).inverse();
    // glTF demands that the matrix is exactly affine, which rounding may prevent.
    inverse.x_axis.w = 0.0;
    inverse.y_axis.w = 0.0;
    inverse.z_axis.w = 0.0;
    inverse.w_axis.w = 1.0;
    inverse.as_mat4().to_cols_array()
}

/// The bark of a branch at rest in the file's frame, with the joint of each vertex.
fn bark(shapes: &mut Shapes, branch: &Branch, of_vertices: &[u16]) -> usize {
    let mut mesh = LeafMesh::default();
    mesh.append(&branch.wood, upright() * branch.frame());
    let material = shapes.material(&branch.material, false);
    let mesh = shapes.mesh(&branch.name, &mesh, material);
    let joints = shapes.file.joints(&of_vertices.iter().map(|k| [*k, 0, 0, 0]).collect::<Vec<_>>());
    let weights = shapes.file.floats("VEC4", &vec![[1.0, 0.0, 0.0, 0.0]; of_vertices.len()]);
    shapes.attribute(mesh, "JOINTS_0", joints);
    shapes.attribute(mesh, "WEIGHTS_0", weights);
    mesh
}

/// Samplers and channels of every node that moves relative to the node above it.
fn tracks(shapes: &mut Shapes, all: &Nodes, keys: &[Vec<Place>], input: usize) -> (Vec<Value>, Vec<Value>) {
    let rest = all.places(&vec![RigidMotion::STILL; all.rest.len()]);
    let (mut samplers, mut channels) = (Vec::new(), Vec::new());
    let mut track = |node: usize, path: &str, output: usize| {
        samplers.push(json!({"input": input, "output": output, "interpolation": "LINEAR"}));
        channels.push(json!({"sampler": samplers.len() - 1, "target": {"node": node, "path": path}}));
    };
    let moves = |a: &[f32], b: &[f32]| a.iter().zip(b).any(|(a, b)| (a - b).abs() > STILL * b.abs().max(1.0));
    for (k, (place, turn)) in rest.iter().enumerate() {
        if keys.iter().any(|key| moves(&key[k].0, place)) {
            let output = shapes.file.floats("VEC3", &keys.iter().map(|key| key[k].0).collect::<Vec<_>>());
            track(k + 1, "translation", output);
        }
        // The quaternions q and −q are the same rotation. The sign is taken that is nearer to the previous key.
        let mut before = *turn;
        let turns: Vec<[f32; 4]> = keys
            .iter()
            .map(|key| {
                let dot: f32 = key[k].1.iter().zip(&before).map(|(a, b)| a * b).sum();
                before = key[k].1.map(|c| if dot < 0.0 { -c } else { c });
                before
            })
            .collect();
        if turns.iter().any(|t| moves(t, turn)) {
            let output = shapes.file.floats("VEC4", &turns);
            track(k + 1, "rotation", output);
        }
    }
    (samplers, channels)
}
