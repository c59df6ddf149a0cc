//! One primitive of a plant, as it is dressed: coordinates, tangents, and the same triangles seen from behind.

use super::{Coated, Dressed};
use crate::Error;
use glam::{DVec2, DVec3};
use gltf::Semantic;
use gltf::accessor::DataType;
use mesophyll_files::glb::Glb;
use mesophyll_files::gltf_file::{self, Opened, Surface};
use mesophyll_files::mesh::{self, LeafMesh};
use mesophyll_flora::import::flat::{Flat, flat};
use mesophyll_optics::side::Side;
use serde_json::{Value, json};
use std::collections::HashMap;
use std::path::Path;

/// The file that is dressed.
pub(super) struct Work<'a> {
    pub path: &'a Path,
    pub opened: &'a Opened,
    pub make: bool,
    pub file: &'a mut Glb,
    /// Accessors of turned normals and tangents, by the accessor that they were made of.
    pub turned: HashMap<usize, usize>,
    pub done: Dressed,
}

impl Work<'_> {
    /// The primitives that take the place of `own`, or why it stays as it is.
    pub fn dress(
        &mut self,
        field: &str,
        primitive: &gltf::Primitive,
        set: u64,
        own: &Value,
        coated: &Coated,
    ) -> std::result::Result<Vec<Value>, String> {
        let plain = |semantic: &Semantic| primitive.get(semantic).is_none_or(|a| a.data_type() == DataType::F32);
        if ![Semantic::Positions, Semantic::Normals, Semantic::Tangents].iter().all(plain) {
            return Err("found quantized vertices, expected numbers of 32 bits".into());
        }
        // File and field stand before all that is printed.
        let said =
            |e: Error| e.to_string().replace(&format!("{}: {field}", self.path.display()), "").replacen(": ", "", 1);
        let surface = gltf_file::surface(self.path, field, primitive, &self.opened.buffers).map_err(said)?;
        if surface.indices.is_empty() {
            return Err("found no triangles".into());
        }
        let kept = if self.make { None } else { self.own_coordinates(primitive, set, surface.positions.len()) };
        let mut front = own.clone();
        let mut whole = vec![true; surface.indices.len() / 3];
        let uvs = if let Some((accessor, uvs)) = kept {
            front["attributes"]["TEXCOORD_0"] = json!(accessor);
            uvs
        } else {
            let found = flat(&surface);
            if found.pieces[0] == 0 {
                return Err(format!("found no texture coordinates and no flat piece among {}", found.pieces[1]));
            }
            if found.pieces[1] > 0 {
                let [flat, others] = found.pieces;
                let what = format!("{field}: {others} of {} pieces are not flat and stay as they are", flat + others);
                self.done.undressed.push(what);
            }
            let uvs = self.make_coordinates(&mut front, &found, coated);
            self.done.made += found.triangles.iter().filter(|flat| **flat).count();
            whole = found.triangles;
            uvs
        };
        if coated.mapped {
            self.make_tangents(&mut front, primitive, &surface, &uvs);
        }
        let mut out = Vec::new();
        let all = whole.iter().all(|dressed| *dressed);
        if !all {
            let mut rest = own.clone();
            rest["indices"] = json!(self.file.indices(&some(&surface, &whole, false, false)));
            out.push(rest);
        }
        if let Some(extensions) = front.get_mut("extensions").and_then(Value::as_object_mut)
            && extensions.remove("KHR_materials_variants").is_some()
        {
            self.done.undressed.push(format!("{field}: its variants (KHR_materials_variants) were left out"));
        }
        if !all {
            front["indices"] = json!(self.file.indices(&some(&surface, &whole, true, false)));
        }
        for (side, material) in &coated.sides {
            let mut new = front.clone();
            if *side == Side::Back && coated.sides.len() > 1 {
                new["indices"] = json!(self.file.indices(&some(&surface, &whole, true, true)));
                self.turn(&mut new);
            }
            new["material"] = json!(material);
            out.push(new);
        }
        self.done.primitives += 1;
        self.done.triangles += whole.iter().filter(|dressed| **dressed).count();
        Ok(out)
    }

    /// The file's own texture coordinates and their accessor, where they tell one place from another.
    fn own_coordinates(
        &self,
        primitive: &gltf::Primitive,
        set: u64,
        vertices: usize,
    ) -> Option<(usize, Vec<[f32; 2]>)> {
        let accessor = primitive.get(&Semantic::TexCoords(set as u32))?;
        let reader = primitive.reader(|b| self.opened.buffers.get(b.index()).map(|d| d.0.as_slice()));
        let list: Vec<[f32; 2]> = reader.read_tex_coords(set as u32)?.into_f32().collect();
        let whole = list.len() == vertices && list.iter().flatten().all(|v| v.is_finite());
        (whole && list.iter().any(|uv| *uv != list[0])).then(|| (accessor.index(), list))
    }

    fn make_coordinates(&mut self, front: &mut Value, found: &Flat, coated: &Coated) -> Vec<[f32; 2]> {
        let uvs: Vec<[f32; 2]> = found.places.iter().map(|place| coated.coordinates(*place)).collect();
        front["attributes"]["TEXCOORD_0"] = json!(self.file.floats("VEC2", &uvs));
        // Tangents belong to the coordinates that they came with.
        let lists = front["targets"].as_array().map_or(0, Vec::len);
        front["attributes"].as_object_mut().map(|list| list.remove("TANGENT"));
        for k in 0..lists {
            front["targets"][k].as_object_mut().map(|list| list.remove("TANGENT"));
        }
        uvs
    }

    /// Tangents where the file has none, and normals for them.
    fn make_tangents(&mut self, front: &mut Value, own: &gltf::Primitive, surface: &Surface, uvs: &[[f32; 2]]) {
        if front["attributes"]["TANGENT"].is_u64() {
            return;
        }
        let mut mesh = LeafMesh {
            positions: surface.positions.clone(),
            uvs: uvs.iter().map(|uv| DVec2::from(uv.map(f64::from))).collect(),
            indices: surface.indices.clone(),
            ..LeafMesh::default()
        };
        let reader = own.reader(|b| self.opened.buffers.get(b.index()).map(|d| d.0.as_slice()));
        let unit = |n: DVec3| n.try_normalize().unwrap_or(DVec3::Z);
        mesh.normals = match reader.read_normals() {
            Some(list) => list.map(|n| unit(gltf_file::wide(n))).collect(),
            None => mesh::vertex_normals(&mesh).into_iter().map(unit).collect(),
        };
        if mesh.normals.len() != mesh.positions.len() {
            return;
        }
        if front["attributes"]["NORMAL"].is_null() {
            let normals: Vec<[f32; 3]> = mesh.normals.iter().map(|n| n.as_vec3().to_array()).collect();
            let new = self.file.floats("VEC3", &normals);
            front["attributes"]["NORMAL"] = json!(new);
            self.turned
                .insert(new, self.file.floats("VEC3", &normals.iter().map(|n| n.map(|v| -v)).collect::<Vec<_>>()));
        }
        let tangents: Vec<[f32; 4]> = mesh::vertex_tangents(&mesh)
            .into_iter()
            .map(|(t, w)| t.as_vec3().extend(if w < 0.0 { -1.0 } else { 1.0 }).to_array())
            .collect();
        let new = self.file.floats("VEC4", &tangents);
        front["attributes"]["TANGENT"] = json!(new);
        let turned: Vec<[f32; 4]> = tangents.iter().map(|[x, y, z, w]| [*x, *y, *z, -w]).collect();
        self.turned.insert(new, self.file.floats("VEC4", &turned));
    }

    /// Turns normals, and the handedness of tangents, of the vertices and of what moves them.
    fn turn(&mut self, primitive: &mut Value) {
        let mut turn = |list: &mut Value, name: &str| {
            if let Some(accessor) = list.get(name).and_then(Value::as_u64) {
                list[name] = json!(self.turned(accessor as usize, name == "NORMAL"));
            }
        };
        if let Some(list) = primitive.get_mut("attributes") {
            turn(list, "NORMAL");
            turn(list, "TANGENT");
        }
        for list in primitive.get_mut("targets").and_then(Value::as_array_mut).into_iter().flatten() {
            turn(list, "NORMAL");
        }
    }

    fn turned(&mut self, accessor: usize, normals: bool) -> usize {
        if let Some(known) = self.turned.get(&accessor) {
            return *known;
        }
        let get = |b: gltf::Buffer| self.opened.buffers.get(b.index()).map(|d| d.0.as_slice());
        let Some(own) = self.opened.document.accessors().nth(accessor) else { return accessor };
        let new = if normals {
            let list: Vec<[f32; 3]> = gltf::accessor::Iter::new(own, get).into_iter().flatten().collect();
            self.file.floats("VEC3", &list.iter().map(|n: &[f32; 3]| n.map(|v| -v)).collect::<Vec<_>>())
        } else {
            let list: Vec<[f32; 4]> = gltf::accessor::Iter::new(own, get).into_iter().flatten().collect();
            self.file.floats("VEC4", &list.iter().map(|[x, y, z, w]| [*x, *y, *z, -w]).collect::<Vec<_>>())
        };
        self.turned.insert(accessor, new);
        new
    }
}

/// The triangles that are marked as `dressed` says, also turned round.
fn some(surface: &Surface, whole: &[bool], dressed: bool, turned: bool) -> Vec<u32> {
    let triangles = surface.indices.chunks_exact(3).zip(whole).filter(|(_, own)| **own == dressed);
    triangles.flat_map(|(t, _)| if turned { [t[0], t[2], t[1]] } else { [t[0], t[1], t[2]] }).collect()
}
