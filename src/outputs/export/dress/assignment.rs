//! Which fit each primitive of a plant gets: by the name of its material, or by that of its mesh or node where no
//! material has the name.

use super::LeafReplacement;
use crate::{Error, Result};
use mesophyll_files::gltf_file::GltfDocument;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Places of fits in the list of leaves.
#[derive(Debug, Default)]
pub(super) struct Wanted {
    /// By the index of the material.
    pub materials: BTreeMap<usize, usize>,
    /// By the index of the mesh.
    pub meshes: BTreeMap<usize, usize>,
}

impl Wanted {
    /// The fit of a primitive.
    pub fn leaf(&self, mesh: usize, material: Option<usize>) -> Option<usize> {
        let by_material = material.and_then(|m| self.materials.get(&m));
        by_material.or_else(|| self.meshes.get(&mesh)).copied()
    }

    /// Looks the names up.
    ///
    /// # Errors
    /// [`Error::Input`] for a name that nothing has, [`Error::Argument`] for one that is given twice.
    pub fn of(path: &Path, opened: &GltfDocument, leaves: &[LeafReplacement]) -> Result<Wanted> {
        let document = &opened.document;
        let materials: Vec<String> = document
            .materials()
            .filter_map(|m| m.index().map(|k| m.name().map_or_else(|| k.to_string(), String::from)))
            .collect();
        // A mesh is known by its own name and by those of the nodes that show it.
        let own = document.meshes().filter_map(|m| Some((m.index(), m.name()?.to_string())));
        let nodes = document.nodes().filter_map(|n| Some((n.mesh()?.index(), n.name()?.to_string())));
        let meshes: Vec<(usize, String)> = own.chain(nodes).collect();
        let mut wanted = Wanted::default();
        for (k, leaf) in leaves.iter().enumerate() {
            let twice = || Error::argument("--leaf", &leaf.material, "each material once");
            let named: Vec<usize> = (0..materials.len()).filter(|m| materials[*m] == leaf.material).collect();
            for m in &named {
                if wanted.materials.insert(*m, k).is_some() {
                    return Err(twice());
                }
            }
            if !named.is_empty() {
                continue;
            }
            let named: BTreeSet<usize> =
                meshes.iter().filter(|(_, name)| *name == leaf.material).map(|(mesh, _)| *mesh).collect();
            for mesh in &named {
                if wanted.meshes.insert(*mesh, k).is_some() {
                    return Err(twice());
                }
            }
            if named.is_empty() {
                let list = |names: BTreeSet<&String>| {
                    let shown: Vec<String> = names.iter().take(12).map(|n| format!("\"{n}\"")).collect();
                    let more = if names.len() > 12 { format!(" and {} more", names.len() - 12) } else { String::new() };
                    shown.join(", ") + &more
                };
                let found = match (list(materials.iter().collect()), list(meshes.iter().map(|m| &m.1).collect())) {
                    (none, meshes) if none.is_empty() && meshes.is_empty() => "has no materials".to_string(),
                    (none, meshes) if none.is_empty() => format!("has no materials, but the meshes {meshes}"),
                    (materials, _) => format!("has {materials}"),
                };
                return Err(Error::input(path, format!("found no material \"{}\"; the file {found}", leaf.material)));
            }
        }
        Ok(wanted)
    }
}
