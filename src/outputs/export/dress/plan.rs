//! What is done with each primitive that gets a fit, before anything is written.

use super::assignment::Wanted;
use super::cards::Cut;
use super::coverage::{CLAMP, are_cards, inside, wrap};
use super::{Key, LeafReplacement, Options, colour, texture_set};
use crate::Error;
use mesophyll_files::gltf_file::{self, AlphaMask, GltfDocument, GltfPrimitive};
use mesophyll_plants::import::flat_pieces::{FlatPieces, flat};
use serde_json::Value;
use std::path::Path;

/// A primitive that gets a fit.
pub(super) struct Plan {
    /// Its mesh and its place in it.
    pub at: [usize; 2],
    /// How the fit is shown.
    pub key: Key,
    /// Its triangles, and the flat pieces among them.
    pub surface: GltfPrimitive,
    pub found: FlatPieces,
    /// The file's own texture coordinates and their accessor.
    pub own: Option<(usize, Vec<[f32; 2]>)>,
    /// What the former picture cut out.
    pub cut: Option<Cut>,
    /// Length of the file's unit where its node is (m): the largest of the nodes that show it.
    pub unit_m: f64,
}

impl Plan {
    /// Its name in messages.
    pub fn field(&self) -> String {
        let [mesh, primitive] = self.at;
        format!("meshes[{mesh}].primitives[{primitive}]")
    }
}

/// The plans in the order of the file. What cannot be dressed is added to `undressed`.
pub(super) fn plans(
    path: &Path,
    opened: &GltfDocument,
    root: &Value,
    wanted: &Wanted,
    options: Options,
    undressed: &mut Vec<String>,
) -> Vec<Plan> {
    let sizes = sizes(opened);
    let mut plans = Vec::new();
    for mesh in opened.document.meshes() {
        for primitive in mesh.primitives() {
            let material = primitive.material().index();
            let Some(leaf) = wanted.leaf(mesh.index(), material) else { continue };
            let at = [mesh.index(), primitive.index()];
            let field = format!("meshes[{}].primitives[{}]", at[0], at[1]);
            // File and field stand before all that is printed.
            let said =
                |e: Error| e.to_string().replace(&format!("{}: {field}", path.display()), "").replacen(": ", "", 1);
            let surface = match gltf_file::surface(path, &field, &primitive, &opened.buffers) {
                Ok(surface) if !surface.indices.is_empty() => surface,
                Ok(_) => {
                    undressed.push(format!("{field}: found no triangles"));
                    continue;
                }
                Err(why) => {
                    undressed.push(format!("{field}: {}", said(why)));
                    continue;
                }
            };
            let former = material.map_or(&Value::Null, |m| &root["materials"][m]);
            let found = flat(&surface);
            let own = own_coordinates(opened, &primitive, texture_set(former), surface.positions.len());
            let kept = own.as_ref().filter(|_| !options.make_uv);
            let cut = matches!(former["alphaMode"].as_str(), Some("MASK" | "BLEND"));
            let masked = cut || options.scatter || are_cards(&surface, &found);
            let own_wrap = wrap(root, colour(former));
            let mask = material.filter(|_| options.scatter).and_then(|m| AlphaMask::of(path, opened, m));
            let cut = mask.map(|mask| (mask, own_wrap));
            // Pictures that end where the coordinates do need not go on.
            let wrap = if kept.is_none_or(|(_, uvs)| inside(uvs)) { [CLAMP; 2] } else { own_wrap };
            let unit_m = sizes[mesh.index()] * opened.unit.mm() / 1000.0;
            plans.push(Plan { at, key: Key { leaf, masked, wrap }, surface, found, own, cut, unit_m });
        }
    }
    plans
}

/// The file's own texture coordinates and their accessor, where they tell one place from another.
fn own_coordinates(
    opened: &GltfDocument,
    primitive: &gltf::Primitive,
    set: u64,
    vertices: usize,
) -> Option<(usize, Vec<[f32; 2]>)> {
    let accessor = primitive.get(&gltf::Semantic::TexCoords(set as u32))?;
    let reader = primitive.reader(|b| opened.buffers.get(b.index()).map(|d| d.0.as_slice()));
    let list: Vec<[f32; 2]> = reader.read_tex_coords(set as u32)?.into_f32().collect();
    let whole = list.len() == vertices && list.iter().flatten().all(|v| v.is_finite());
    (whole && list.iter().any(|uv| *uv != list[0])).then(|| (accessor.index(), list))
}

/// How much the nodes that show a mesh enlarge it, the largest of them; 1 for a mesh without a node.
fn sizes(opened: &GltfDocument) -> Vec<f64> {
    let mut sizes = vec![0.0f64; opened.document.meshes().count()];
    let scenes = opened.document.scenes().flat_map(|s| s.nodes().collect::<Vec<_>>());
    let mut wait: Vec<(gltf::Node, f64, usize)> = scenes.map(|node| (node, 1.0, 0)).collect();
    while let Some((node, outer, depth)) = wait.pop() {
        let size = outer * gltf_file::local(&node).determinant().abs().cbrt();
        if let Some(mesh) = node.mesh() {
            sizes[mesh.index()] = sizes[mesh.index()].max(size);
        }
        if depth < gltf_file::DEEPEST {
            wait.extend(node.children().map(|child| (child, size, depth + 1)));
        }
    }
    sizes.into_iter().map(|s| if s > 0.0 && s.is_finite() { s } else { 1.0 }).collect()
}

/// Says which names led to no mesh, and what of the former textures was left out.
pub(super) fn unused(
    opened: &GltfDocument,
    root: &Value,
    wanted: &Wanted,
    leaves: &[LeafReplacement],
    undressed: &mut Vec<String>,
) {
    let shown =
        opened.document.meshes().flat_map(|m| m.primitives().filter_map(|p| p.material().index()).collect::<Vec<_>>());
    let used: std::collections::BTreeSet<usize> = shown.collect();
    for (m, k) in &wanted.materials {
        if !used.contains(m) {
            undressed.push(format!("materials[{m}]: no mesh has the material \"{}\"", leaves[*k].material));
        } else if colour(&root["materials"][*m])["extensions"]["KHR_texture_transform"].is_object() {
            let what = "the transform of its former texture (KHR_texture_transform) was left out";
            undressed.push(format!("materials[{m}]: {what}"));
        }
    }
}
