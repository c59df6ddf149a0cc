//! One primitive of a plant, as it is dressed: coordinates, tangents, and the same triangles seen from behind.

use super::cards::{self, Card, TWIG};
use super::{Coated, DressResult, Options, Plan, coverage};
use crate::Result;
use crate::blade::{ExportMesh, raised};
use crate::gltf::{is_second, mark_back};
use glam::{DVec2, DVec3};
use gltf::Semantic;
use gltf::accessor::DataType;
use mesophyll_files::glb::Glb;
use mesophyll_files::gltf_file::{self, GltfDocument, GltfPrimitive};
use mesophyll_files::mesh::{self, LeafMesh};
use mesophyll_optics::side::Side;
use mesophyll_plants::import::flat_pieces::FlatPieces;
use serde_json::{Value, json};
use std::collections::HashMap;
use std::path::Path;

/// Where less than this share of the dressed area shows the leaf, something is wrong.
const LITTLE: f64 = 0.5;

/// What becomes of a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fate {
    /// It gets the fitted leaf.
    Dressed,
    /// It keeps its material.
    Stays,
    /// Scattered leaves take its place.
    Gone,
}

/// The file that is dressed.
pub(super) struct Work<'a> {
    pub path: &'a Path,
    pub opened: &'a GltfDocument,
    pub options: Options,
    pub file: &'a mut Glb,
    /// Accessors of turned normals and tangents, by the accessor that they were made of.
    pub turned: HashMap<usize, usize>,
    pub done: DressResult,
}

impl Work<'_> {
    /// The primitives that take the place of `own`, or why it stays as it is.
    ///
    /// # Errors
    /// [`Error::Input`] for a card on which too many leaves would lie.
    pub fn dress(
        &mut self,
        primitive: &gltf::Primitive,
        plan: Plan,
        own: &Value,
        coated: &Coated,
    ) -> Result<std::result::Result<Vec<Value>, String>> {
        let field = plan.field();
        let plain = |semantic: &Semantic| primitive.get(semantic).is_none_or(|a| a.data_type() == DataType::F32);
        if ![Semantic::Positions, Semantic::Normals, Semantic::Tangents].iter().all(plain) {
            return Ok(Err("found quantized vertices, expected numbers of 32 bits".into()));
        }
        let Plan { surface, found, .. } = &plan;
        let mut fate = vec![Fate::Dressed; surface.indices.len() / 3];
        let mut out = Vec::new();
        let twigs: Vec<Card> = cards::cards(surface, found)
            .into_iter()
            .filter(|card| card.length() * plan.unit_m > TWIG * coated.blade_m[0])
            .collect();
        let bent = own["targets"].is_array() || own["attributes"]["JOINTS_0"].is_u64();
        if self.options.scatter && !twigs.is_empty() && !bent {
            let leaves = cards::scatter(self.path, &plan, &twigs, coated)?;
            twigs.iter().flat_map(|card| &card.triangles).for_each(|t| fate[*t] = Fate::Gone);
            out.extend(self.scattered(&leaves, coated.thickness_m / plan.unit_m, coated));
        } else if let Some(largest) = twigs.iter().map(|card| card.length() * plan.unit_m).reduce(f64::max) {
            let why = if self.options.scatter { ", but what moves them cannot move scattered leaves" } else { "" };
            self.done.warnings.push(format!(
                "{field}: {} of {} pieces are up to {largest:.2} m long, and the fitted blade is {:.3} m: each may be \
                 a whole twig, and shows one huge leaf; --scatter lays leaves over them{why}",
                twigs.len(),
                found.flat.len() + found.others,
                coated.blade_m[0]
            ));
        }
        if fate.iter().all(|f| *f == Fate::Gone) {
            self.done.primitives += 1;
            return Ok(Ok(out));
        }
        let kept = plan.own.as_ref().filter(|_| !self.options.make_uv);
        let mut front = own.clone();
        self.uncoloured(&field, &mut front);
        let uvs = if let Some((accessor, uvs)) = kept {
            front["attributes"]["TEXCOORD_0"] = json!(accessor);
            uvs.clone()
        } else {
            if found.flat.is_empty() {
                return Ok(Err(format!("found no texture coordinates and no flat piece among {}", found.others)));
            }
            if found.others > 0 {
                let all = found.flat.len() + found.others;
                let what = format!("{field}: {} of {all} pieces are not flat and stay as they are", found.others);
                self.done.undressed.push(what);
            }
            let uvs = self.make_coordinates(&mut front, found, coated);
            fate.iter_mut().zip(&found.triangles).filter(|(_, flat)| !**flat).for_each(|(f, _)| *f = Fate::Stays);
            self.done.made += fate.iter().filter(|f| **f == Fate::Dressed).count();
            uvs
        };
        if coated.mapped {
            self.make_tangents(&mut front, primitive, surface, &uvs);
        }
        if fate.contains(&Fate::Stays) {
            let mut rest = own.clone();
            rest["indices"] = json!(self.file.indices(&some(surface, &fate, Fate::Stays, false)));
            out.insert(0, rest);
        }
        if let Some(extensions) = front.get_mut("extensions").and_then(Value::as_object_mut)
            && extensions.remove("KHR_materials_variants").is_some()
        {
            self.done.undressed.push(format!("{field}: its variants (KHR_materials_variants) were left out"));
        }
        if fate.iter().any(|f| *f != Fate::Dressed) {
            front["indices"] = json!(self.file.indices(&some(surface, &fate, Fate::Dressed, false)));
        }
        for (side, material) in &coated.sides {
            let mut new = front.clone();
            let second = is_second(*side, coated.sides.len());
            if second {
                let places = raised(&surface.positions, &surface.indices, -coated.thickness_m / plan.unit_m);
                new["attributes"]["POSITION"] = json!(self.file.floats("VEC3", &places));
                mark_back(&mut new);
                new["indices"] = json!(self.file.indices(&some(surface, &fate, Fate::Dressed, true)));
                self.turn(&mut new);
            }
            new["material"] = json!(material);
            out.push(new);
        }
        let dressed: Vec<bool> = fate.iter().map(|f| *f == Fate::Dressed).collect();
        let area = coverage::kept(surface, &dressed, &uvs, coated);
        self.judge(&field, area, kept.is_some(), coated);
        self.done.primitives += 1;
        self.done.triangles += dressed.iter().filter(|dressed| **dressed).count();
        Ok(Ok(out))
    }

    /// Adds to the area that was dressed, and warns where little of it shows the leaf.
    fn judge(&mut self, field: &str, [all, kept]: [f64; 2], own: bool, coated: &Coated) {
        let area = &mut self.done.area;
        *area = [area[0] + all, area[1] + kept];
        let share = kept / all;
        if share < LITTLE {
            let what = if coated.masked { "the fitted outline keeps only" } else { "only" };
            let rest = if coated.masked {
                "of its area"
            } else {
                "of its area lies on the fitted blade; the rest shows the colours of the blade's edge"
            };
            let way = if own { "; --make-uv lays the blade over each flat piece" } else { "" };
            self.done.warnings.push(format!("{field}: {what} {:.0} % {rest}{way}", 100.0 * share));
        }
    }

    /// Takes out the colours of vertices, with which the former picture was multiplied.
    fn uncoloured(&mut self, field: &str, front: &mut Value) {
        let Some(attributes) = front["attributes"].as_object_mut() else { return };
        let names: Vec<String> = attributes.keys().filter(|name| name.starts_with("COLOR_")).cloned().collect();
        for name in names {
            attributes.remove(&name);
            self.done.undressed.push(format!("{field}: its vertex colours ({name}) were left out"));
        }
        for target in front.get_mut("targets").and_then(Value::as_array_mut).into_iter().flatten() {
            target.as_object_mut().into_iter().for_each(|t| t.retain(|name, _| !name.starts_with("COLOR_")));
        }
    }

    /// The primitives of scattered leaves, one for each side. The back stands `thickness` (the file's unit) behind.
    fn scattered(&mut self, leaves: &LeafMesh, thickness: f64, coated: &Coated) -> Vec<Value> {
        let mut leaves = leaves.clone();
        leaves.tangents = mesh::vertex_tangents(&leaves);
        let front = ExportMesh::of(&leaves);
        self.done.scattered += front.indices.len() / 6;
        let both = [front.clone(), front.turned().raised(thickness)];
        let side = |(side, material): &(Side, usize)| {
            let second = is_second(*side, coated.sides.len());
            crate::gltf::primitive(self.file, &both[usize::from(second)], *material, second)
        };
        coated.sides.iter().map(side).collect()
    }

    fn make_coordinates(&mut self, front: &mut Value, found: &FlatPieces, coated: &Coated) -> Vec<[f32; 2]> {
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
    fn make_tangents(&mut self, front: &mut Value, own: &gltf::Primitive, surface: &GltfPrimitive, uvs: &[[f32; 2]]) {
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

/// The triangles with this fate, also turned round.
fn some(surface: &GltfPrimitive, fates: &[Fate], fate: Fate, turned: bool) -> Vec<u32> {
    let triangles = surface.indices.chunks_exact(3).zip(fates).filter(|(_, own)| **own == fate);
    triangles.flat_map(|(t, _)| if turned { [t[0], t[2], t[1]] } else { [t[0], t[1], t[2]] }).collect()
}
