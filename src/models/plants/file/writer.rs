//! Writes a plant as binary glTF.

use super::{Extras, INSTANCING, NodeExtras, PERIOD};
use crate::form::{Blade, Branch, Plant};
use crate::{Error, Result};
use glam::{DMat4, DQuat, DVec3};
use mesophyll_files::glb::{self, Glb};
use mesophyll_files::mesh::LeafMesh;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::f64::consts::FRAC_1_SQRT_2;
use std::path::Path;

/// Colours for programs that do not know the scene's leaves: linear reflectances of bark and blade.
const COLOURS: [[f64; 4]; 2] = [[0.13, 0.095, 0.065, 1.0], [0.06, 0.13, 0.03, 1.0]];

/// Writes `path` (.glb), whole or not at all.
///
/// # Errors
/// As [`Glb::write`].
pub fn write(plant: &Plant, path: &Path) -> Result<()> {
    let mut shapes = Shapes::of(plant);
    let blades = shapes.blades(plant);
    // Node 0 is the plant, and branch k is node k + 1. The leaves follow.
    let mut nodes = vec![whole(plant)];
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); plant.branches.len() + 1];
    for (k, branch) in plant.branches.iter().enumerate() {
        let (above, local) = below(plant, branch);
        children[above].push(k + 1);
        let mut node = node(branch, local, path)?;
        if branch.wood.triangles() > 0 {
            let material = shapes.material(&branch.material, false);
            node["mesh"] = json!(shapes.mesh(&branch.name, &branch.wood, material));
        }
        nodes.push(node);
    }
    let mut hung: BTreeMap<(usize, usize), Vec<(f64, DMat4)>> = BTreeMap::new();
    for leaf in &plant.leaves {
        let Some(branch) = plant.branches.get(leaf.joint.branch) else { continue };
        let local = branch.frame().inverse() * leaf.transform;
        hung.entry((leaf.joint.branch, leaf.blade)).or_default().push((leaf.joint.at, local));
    }
    for ((branch, blade), leaves) in &hung {
        let parts: Vec<_> = leaves.iter().map(|(_, local)| local.to_scale_rotation_translation()).collect();
        let at: Vec<[f32; 1]> = leaves.iter().map(|(at, _)| [*at as f32]).collect();
        let attributes = json!({
            "TRANSLATION": shapes.file.floats("VEC3", &parts.iter().map(|(_, _, t)| narrow(*t)).collect::<Vec<_>>()),
            "ROTATION": shapes.file.floats("VEC4",
                &parts.iter().map(|(_, q, _)| q.as_quat().to_array()).collect::<Vec<_>>()),
            "SCALE": shapes.file.floats("VEC3", &parts.iter().map(|(s, _, _)| narrow(*s)).collect::<Vec<_>>()),
            "_AT": shapes.file.floats("SCALAR", &at),
        });
        children[branch + 1].push(nodes.len());
        nodes.push(json!({
            "name": format!("{} leaves {blade}", plant.branches[*branch].name),
            "mesh": blades[*blade],
            "extensions": {INSTANCING: {"attributes": attributes}},
        }));
    }
    let mut root = rooted(nodes, &children);
    if !hung.is_empty() {
        root["extensionsUsed"] = json!([INSTANCING]);
    }
    shapes.write(path, root)
}

/// The node of the plant, which turns it to y up and scales mm to metres.
pub(super) fn whole(plant: &Plant) -> Value {
    let mut node = json!({
        "name": plant.name,
        "rotation": [-FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2],
        "scale": [0.001, 0.001, 0.001],
    });
    if let Some(period) = plant.period {
        node["extras"] = json!({ PERIOD: period });
    }
    node
}

/// The transform from the plant's frame to the file's, which is in metres with y up.
pub(super) fn upright() -> DMat4 {
    let turn = DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2);
    DMat4::from_scale_rotation_translation(DVec3::splat(0.001), turn, DVec3::ZERO)
}

/// The node above a branch's node (0 is the plant's, k + 1 that of branch k), and the branch's place in it.
pub(super) fn below(plant: &Plant, branch: &Branch) -> (usize, DMat4) {
    let above = branch.parent.and_then(|joint| plant.branches.get(joint.branch).map(|b| (joint.branch, b)));
    above.map_or((0, branch.frame()), |(k, parent)| (k + 1, parent.frame().inverse() * branch.frame()))
}

/// A branch's node without its mesh.
pub(super) fn node(branch: &Branch, local: DMat4, path: &Path) -> Result<Value> {
    let mut node = placed(local);
    node["name"] = json!(branch.name);
    node["extras"] = serde_json::to_value(Extras { branch: said(branch) }).map_err(|e| Error::write(path, e))?;
    Ok(node)
}

/// A file's JSON with these nodes. The first is the plant's. `children` lists the nodes below each of the first ones.
pub(super) fn rooted(mut nodes: Vec<Value>, children: &[Vec<usize>]) -> Value {
    for (node, below) in nodes.iter_mut().zip(children) {
        if !below.is_empty() {
            node["children"] = json!(below);
        }
    }
    json!({"asset": glb::asset(), "scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes})
}

/// The meshes and materials of a file that is being written.
#[derive(Default)]
pub(super) struct Shapes {
    pub file: Glb,
    materials: Vec<Value>,
    known: BTreeMap<(String, bool), usize>,
    colours: BTreeMap<String, [f64; 3]>,
    meshes: Vec<Value>,
}

impl Shapes {
    /// No meshes yet, and materials in the plant's colours.
    pub fn of(plant: &Plant) -> Shapes {
        Shapes { colours: plant.colours.clone(), ..Shapes::default() }
    }

    pub fn material(&mut self, name: &str, leaf: bool) -> usize {
        let materials = &mut self.materials;
        let own = self.colours.get(name).map(|[r, g, b]| [*r, *g, *b, 1.0]);
        let colour = own.unwrap_or(COLOURS[usize::from(leaf)]);
        *self.known.entry((name.to_string(), leaf)).or_insert_with(|| {
            materials.push(json!({"name": name, "doubleSided": leaf, "pbrMetallicRoughness": {
                "baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 0.7}}));
            materials.len() - 1
        })
    }

    /// Adds a mesh and returns its index.
    pub fn mesh(&mut self, name: &str, mesh: &LeafMesh, material: usize) -> usize {
        let value = self::mesh(&mut self.file, name, mesh, material);
        self.meshes.push(value);
        self.meshes.len() - 1
    }

    /// Adds an attribute of the vertices of a mesh's only primitive.
    pub fn attribute(&mut self, mesh: usize, name: &str, accessor: usize) {
        self.meshes[mesh]["primitives"][0]["attributes"][name] = json!(accessor);
    }

    /// Adds the mesh of every blade and returns the indices.
    pub fn blades(&mut self, plant: &Plant) -> Vec<usize> {
        let blade = |blade: &Blade| {
            let material = self.material(&blade.material, true);
            self.mesh("blade", &blade.mesh, material)
        };
        plant.blades.iter().map(blade).collect()
    }

    /// Writes the file. `root` is its JSON without meshes and materials.
    pub fn write(self, path: &Path, mut root: Value) -> Result<()> {
        if !self.meshes.is_empty() {
            root["meshes"] = json!(self.meshes);
            root["materials"] = json!(self.materials);
        }
        self.file.write(path, root)
    }
}

fn said(b: &Branch) -> NodeExtras {
    let straight = matches!(b.axis.as_slice(), [_, tip] if tip.y == 0.0 && tip.z == 0.0 && tip.x > 0.0);
    NodeExtras {
        level: b.level,
        at: b.parent.map(|joint| joint.at),
        length_mm: b.length(),
        root_radius_mm: b.root_radius,
        tip_radius_mm: b.tip_radius,
        taper: b.taper(),
        load_over_stiffness_mm: b.load,
        bending_load_mm: b.bending_load,
        lean_per_m_s: b.stated.lean_per_m_s,
        resonance_hz: b.stated.resonance_hz,
        damping: b.stated.damping,
        axis_mm: if straight { Vec::new() } else { b.axis.iter().map(|p| p.to_array()).collect() },
    }
}

pub(super) fn narrow(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}

pub(super) fn placed(local: DMat4) -> Value {
    let (_, rotation, translation) = local.to_scale_rotation_translation();
    json!({"translation": narrow(translation), "rotation": rotation.normalize().as_quat().normalize().to_array()})
}

fn mesh(file: &mut Glb, name: &str, mesh: &LeafMesh, material: usize) -> Value {
    let attributes = json!({
        "POSITION": file.floats("VEC3", &mesh.positions.iter().map(|p| narrow(*p)).collect::<Vec<_>>()),
        "NORMAL": file.floats("VEC3",
            &mesh.normals.iter().map(|n| n.as_vec3().normalize().to_array()).collect::<Vec<_>>()),
        "TEXCOORD_0": file.floats("VEC2", &mesh.uvs.iter().map(|t| t.as_vec2().to_array()).collect::<Vec<_>>()),
    });
    let indices = file.indices(&mesh.indices);
    json!({"name": name, "primitives": [{"attributes": attributes, "indices": indices, "material": material,
        "mode": 4}]})
}
