//! Writes a plant at rest for the foliage materials of game engines: meshes, and two textures with a texel for each
//! *element*, which is a branch or a leaf. A material looks up a vertex's element by the second texture coordinates.
//! From there it goes to the parent and so on, and turns the vertex about every pivot on the way.
//!
//! Such materials go through [`LEVELS`] levels. A deeper branch or leaf belongs to its ancestor on the last level.
//!
//! Everything is in the frame and unit of the mesh's file: metres, y up.

use super::writer::{Shapes, rooted, upright};
use crate::form::Plant;
use crate::{Error, Result};
use glam::{DMat4, DVec3};
use mesophyll_files::image::{ChannelMaps, Packing, write_exr};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_files::{atomic, quantity};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Number of elements on the way from a trunk to the last level, both included.
pub const LEVELS: usize = 4;

/// A part of the plant that turns as a whole.
#[derive(Debug, Clone, Copy)]
struct Element {
    /// The place where it grows.
    pivot: DVec3,
    /// The vector from the pivot to its tip.
    reach: DVec3,
    /// Index of its parent; a trunk has its own index.
    parent: usize,
    /// Level of the element; 0 for a trunk.
    level: usize,
}

/// A plant's elements, parents before what grows on them, and the element of every branch and leaf.
struct Elements {
    all: Vec<Element>,
    of_branches: Vec<usize>,
    of_leaves: Vec<usize>,
}

impl Elements {
    /// The elements of a plant, in the plant's frame.
    fn of(plant: &Plant) -> Elements {
        let mut out = Elements { all: Vec::new(), of_branches: Vec::new(), of_leaves: Vec::new() };
        for branch in &plant.branches {
            let parent = branch.parent.map(|joint| out.of_branches[joint.branch]);
            let element = out.add(parent, branch.root, branch.chord());
            out.of_branches.push(element);
        }
        for leaf in &plant.leaves {
            let (pivot, reach) = plant.hang(leaf);
            let element = out.add(Some(out.of_branches[leaf.joint.branch]), pivot, reach);
            out.of_leaves.push(element);
        }
        out
    }

    fn add(&mut self, parent: Option<usize>, pivot: DVec3, reach: DVec3) -> usize {
        let level = parent.map_or(0, |p| self.all[p].level + 1);
        match parent {
            Some(parent) if level >= LEVELS => parent,
            _ => {
                let own = self.all.len();
                self.all.push(Element { pivot, reach, parent: parent.unwrap_or(own), level });
                own
            }
        }
    }
}

/// Writes `FOLDER/plant.glb`, `pivot_parent.exr`, `axis_length.exr` and `pivots.json`, which says how they are laid
/// out; returns their names.
///
/// # Errors
/// [`Error::Write`].
pub fn write_pivots(plant: &Plant, folder: &Path) -> Result<Vec<PathBuf>> {
    let elements = Elements::of(plant);
    let count = elements.all.len();
    let width = ((count as f64).sqrt().ceil() as usize).next_power_of_two();
    let height = count.div_ceil(width).next_power_of_two();
    let names = ["plant.glb", "pivot_parent.exr", "axis_length.exr", "pivots.json"].map(|name| folder.join(name));
    meshes(plant, &elements, [width, height], &names[0])?;
    let to_file = upright();
    let (mut first, mut second) = (vec![[0f32; 4]; width * height], vec![[0f32; 4]; width * height]);
    for (k, e) in elements.all.iter().enumerate() {
        let pivot = to_file.transform_point3(e.pivot).as_vec3();
        let reach = to_file.transform_vector3(e.reach);
        first[k] = pivot.extend(e.parent as f32).to_array();
        second[k] = reach.normalize_or_zero().as_vec3().extend(reach.length() as f32).to_array();
    }
    for (name, texels) in [(&names[1], first), (&names[2], second)] {
        let mut maps = ChannelMaps::new(width, height);
        for (c, channel) in quantity::RGB.into_iter().chain(["A"]).enumerate() {
            maps.push(channel, texels.iter().map(|t| t[c]).collect());
        }
        write_exr(name, &maps, Packing::Zip)?;
    }
    let of_level = |level| elements.all.iter().filter(|e| e.level == level).count();
    let about = json!({
        "about": "element k is the texel of column k % width and row k / width, row 0 at the top; TEXCOORD_1 of a \
                  vertex in plant.glb is the middle of its element's texel",
        "elements": count,
        "elements_a_level": (0..LEVELS).map(of_level).collect::<Vec<_>>(),
        "fused": plant.branches.len() + plant.leaves.len() - count,
        "width": width,
        "height": height,
        "unit": "m",
        "up": "y",
        "files": {
            "pivot_parent.exr": "R, G, B: where the element grows; A: its parent's index, its own for a trunk",
            "axis_length.exr": "R, G, B: unit direction from there to its tip; A: the distance between them",
        },
    });
    let text = serde_json::to_vec_pretty(&about).map_err(|e| Error::write(&names[3], e))?;
    atomic::write_bytes(&names[3], &text)?;
    Ok(names.to_vec())
}

/// A mesh and a node for each material.
fn meshes(plant: &Plant, elements: &Elements, size: [usize; 2], path: &Path) -> Result<()> {
    let bark = plant.branches.iter().zip(&elements.of_branches);
    let bark = bark.map(|(b, own)| (&b.material, false, &b.wood, b.frame(), *own));
    let leaves = plant.leaves.iter().zip(&elements.of_leaves).map(|(leaf, own)| {
        let blade = &plant.blades[leaf.blade];
        (&blade.material, true, &blade.mesh, leaf.transform, *own)
    });
    let parts: Vec<(&String, bool, &LeafMesh, DMat4, usize)> =
        bark.chain(leaves).filter(|part| part.2.triangles() > 0).collect();
    let mut kinds: Vec<(&String, bool)> = Vec::new();
    for (material, leaf, ..) in &parts {
        if !kinds.contains(&(*material, *leaf)) {
            kinds.push((material, *leaf));
        }
    }
    let mut shapes = Shapes::of(plant);
    let mut nodes = Vec::new();
    for (name, leaf) in kinds {
        let mut whole = LeafMesh::default();
        let mut texels: Vec<[f32; 2]> = Vec::new();
        for (_, _, mesh, frame, own) in parts.iter().filter(|p| p.0 == name && p.1 == leaf) {
            whole.append(mesh, upright() * *frame);
            let at = [own % size[0], own / size[0]];
            let middle = [0, 1].map(|c| ((at[c] as f64 + 0.5) / size[c] as f64) as f32);
            texels.resize(whole.positions.len(), middle);
        }
        let material = shapes.material(name, leaf);
        let mesh = shapes.mesh(name, &whole, material);
        let texels = shapes.file.floats("VEC2", &texels);
        shapes.attribute(mesh, "TEXCOORD_1", texels);
        nodes.push(json!({"name": name, "mesh": mesh}));
    }
    let all: Vec<usize> = (0..nodes.len()).collect();
    let mut root = rooted(nodes, &[]);
    root["scenes"][0]["nodes"] = json!(all);
    shapes.write(path, root)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::form::{Blade, Branch, Joint, Leaf};

    /// A chain of seven branches with a leaf on each. All elements are within four levels, and pivots and tips are at
    /// their places.
    #[test]
    fn what_is_too_deep_belongs_to_its_ancestor() {
        let mut plant = Plant::default();
        plant.blades.push(Blade { material: "leaf".into(), mesh: LeafMesh::rectangle(20.0, 10.0) });
        for k in 0..7 {
            let root = DVec3::new(10.0 * k as f64, 0.0, 0.0);
            plant.branches.push(Branch {
                name: k.to_string(),
                parent: (k > 0).then(|| Joint { branch: k - 1, at: 0.1 }),
                level: k,
                root,
                axes: [DVec3::X, DVec3::Y, DVec3::Z],
                axis: vec![DVec3::ZERO, DVec3::X * 100.0],
                root_radius: 2.0,
                tip_radius: 1.0,
                load: 0.0,
                bending_load: 0.0,
                stated: Default::default(),
                material: "bark".into(),
                wood: LeafMesh::default(),
            });
            let transform = DMat4::from_translation(root + DVec3::new(50.0, 15.0, 0.0));
            plant.leaves.push(Leaf { blade: 0, joint: Joint { branch: k, at: 0.5 }, transform });
        }
        let elements = Elements::of(&plant);
        assert_eq!(elements.of_branches, [0, 1, 2, 3, 3, 3, 3]);
        // The leaves of the first three branches are elements of their own.
        assert_eq!(elements.of_leaves, [4, 5, 6, 3, 3, 3, 3]);
        let parents: Vec<usize> = elements.all.iter().map(|e| e.parent).collect();
        assert_eq!(parents, [0, 0, 1, 2, 0, 1, 2]);
        let leaf = elements.all[5];
        assert_eq!((leaf.pivot, leaf.reach, leaf.level), (DVec3::X * 60.0, DVec3::new(10.0, 15.0, 0.0), 2));
    }
}
