//! The blade's mesh out of `blade.glb`: positions in mm, normals out of the front, (0, 0) the top left corner of the front's maps.

use crate::files::atomic::explain;
use crate::{Error, Result};
use std::path::Path;

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    pub positions: Vec<[f32; 3]>,
    pub normals: Vec<[f32; 3]>,
    /// xyz along +u, w the handedness; empty where the file has none.
    pub tangents: Vec<[f32; 4]>,
    pub uvs: Vec<[f32; 2]>,
    pub indices: Vec<u32>,
}

impl Mesh {
    /// Reads every triangle mesh of `FOLDER/blade.glb` as it stands (the blade's nodes carry no transforms).
    ///
    /// # Errors
    /// [`Error::Input`] when the file is missing, is no binary glTF, or lacks normals or texture coordinates.
    pub fn read(folder: &Path) -> Result<Mesh> {
        let path = folder.join("blade.glb");
        let bytes = std::fs::read(&path).map_err(|e| Error::input(&path, explain(&e)))?;
        let file = gltf::Gltf::from_slice(&bytes).map_err(|e| Error::input(&path, format!("not a readable binary glTF: {e}")))?;
        let Some(blob) = file.blob.as_deref() else {
            return Err(Error::input(&path, "found no binary part, expected a .glb with its own data"));
        };
        let mut mesh = Mesh::default();
        let mut tangents = true;
        for primitive in file.document.meshes().flat_map(|m| m.primitives()).filter(|p| p.mode() == gltf::mesh::Mode::Triangles) {
            let reader = primitive.reader(|_| Some(blob));
            let lacks = |what: &str| Error::field(&path, what, "a primitive has none; expected one a vertex");
            let base = mesh.positions.len() as u32;
            mesh.positions.extend(reader.read_positions().ok_or_else(|| lacks("POSITION"))?);
            mesh.normals.extend(reader.read_normals().ok_or_else(|| lacks("NORMAL"))?);
            mesh.uvs.extend(reader.read_tex_coords(0).ok_or_else(|| lacks("TEXCOORD_0"))?.into_f32());
            match reader.read_tangents() {
                Some(t) => mesh.tangents.extend(t),
                None => tangents = false,
            }
            match reader.read_indices() {
                Some(i) => mesh.indices.extend(i.into_u32().map(|i| i + base)),
                None => mesh.indices.extend(base..mesh.positions.len() as u32),
            }
        }
        if !tangents {
            mesh.tangents.clear();
        }
        let vertices = mesh.positions.len();
        let whole = mesh.normals.len() == vertices && mesh.uvs.len() == vertices && mesh.indices.len() % 3 == 0;
        if mesh.indices.is_empty() || !whole || mesh.indices.iter().any(|i| *i as usize >= vertices) {
            return Err(Error::input(&path, "the mesh is empty or its attributes do not belong together"));
        }
        Ok(mesh)
    }

    /// The same surface seen from behind: triangles wound the other way, normals turned, tangents still along +u.
    pub fn turned(&self) -> Mesh {
        Mesh {
            positions: self.positions.clone(),
            normals: self.normals.iter().map(|n| n.map(|v| -v)).collect(),
            // bitangent = w · normal × tangent stays where it was
            tangents: self.tangents.iter().map(|t| [t[0], t[1], t[2], -t[3]]).collect(),
            uvs: self.uvs.clone(),
            indices: self.indices.chunks_exact(3).flat_map(|t| [t[0], t[2], t[1]]).collect(),
        }
    }
}
