//! Fitted leaves on a plant from elsewhere: the named materials of a glTF file are replaced by those of fits, and all
//! else stays as it is.
//!
//! A fitted leaf has two sides, each with a material of its own. Every mesh with a named material therefore gets a
//! second primitive, the same triangles seen from behind. Texture coordinates of the file are kept. Where there are
//! none, each flat piece is laid along the fitted blade by its own axes ([`mesophyll_flora::import::flat`]).

mod primitive;

use crate::coat::{Coat, Lost};
use crate::gltf::{lit, material};
use crate::shown::{Sheet, plain_name};
use crate::{Error, Exported, Result};
use mesophyll_files::glb::Glb;
use mesophyll_files::gltf_file::{self, Opened};
use mesophyll_foreign::target::Target;
use mesophyll_optics::side::Side;
use primitive::Work;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};

/// Extensions that a file may require: they are kept as they are, and none changes what is dressed.
const KEPT: [&str; 9] = [
    mesophyll_flora::file::INSTANCING,
    "KHR_lights_punctual",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

/// A material of the plant, and the fit that takes its place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Leaf {
    /// The material's name in the file; one without a name is called by its number, from 0.
    pub material: String,
    /// Folder of the leaf fit.
    pub fit: PathBuf,
}

/// What was done.
#[derive(Debug, Default)]
pub struct Dressed {
    /// The files, and what is lost.
    pub exported: Exported,
    /// Number of primitives that were dressed.
    pub primitives: usize,
    /// Number of their triangles.
    pub triangles: usize,
    /// Number of those triangles whose texture coordinates were made.
    pub made: usize,
    /// What has a named material and could not be dressed, a sentence each.
    pub undressed: Vec<String>,
}

/// Writes the plant in `path` with the fits of `leaves` to `out` (.glb), and what is lost beside it. `make` makes
/// texture coordinates also where the file has its own.
///
/// # Errors
/// [`Error::Input`] for a plant or a fit that cannot be read, for a material that is not there or is named twice, and
/// where nothing could be dressed; [`Error::Usage`] and [`Error::Write`] for `out`.
pub fn dress(path: &Path, leaves: &[Leaf], make: bool, out: &Path) -> Result<Dressed> {
    let record = crate::record_of_loss(out)?;
    gltf_file::read(path, &KEPT, |opened| {
        let wanted = materials(path, &opened, leaves)?;
        let (mut root, bin) = gltf_file::whole(path, &opened)?;
        let mut file = Glb::onto(&mut root, bin);
        let sheets = sheets(&root, &wanted, leaves)?;
        let coats: Vec<Coat> = sheets.iter().map(|(_, sheet)| Coat::new(sheet, Target::GltfTranslucent)).collect();
        let mut coated = Vec::new();
        for coat in &coats {
            coated.push(Coated::new(coat, &mut root, &mut file, out)?);
        }
        let of = |material: usize| {
            let key = key(&root["materials"][material], &leaves[*wanted.get(&material)?]);
            sheets.iter().position(|(k, _)| *k == key)
        };
        let of: BTreeMap<usize, usize> = wanted.keys().filter_map(|m| Some((*m, of(*m)?))).collect();
        let mut work =
            Work { path, opened: &opened, make, file: &mut file, turned: HashMap::new(), done: Dressed::default() };
        let mut used = BTreeSet::new();
        for mesh in opened.document.meshes() {
            let mut primitives = Vec::new();
            for primitive in mesh.primitives() {
                let own = root["meshes"][mesh.index()]["primitives"][primitive.index()].clone();
                let material = primitive.material().index();
                let Some(k) = material.and_then(|m| of.get(&m)) else {
                    primitives.push(own);
                    continue;
                };
                used.extend(material);
                let field = format!("meshes[{}].primitives[{}]", mesh.index(), primitive.index());
                let set = texture_set(&root["materials"][material.unwrap_or_default()]);
                match work.dress(&field, &primitive, set, &own, &coated[*k]) {
                    Ok(new) => primitives.extend(new),
                    Err(why) => {
                        work.done.undressed.push(format!("{field}: {why}"));
                        primitives.push(own);
                    }
                }
            }
            root["meshes"][mesh.index()]["primitives"] = json!(primitives);
        }
        let mut done = work.done;
        for m in &used {
            if colour(&root["materials"][*m])["extensions"]["KHR_texture_transform"].is_object() {
                let what = "the transform of its former texture (KHR_texture_transform) was left out";
                done.undressed.push(format!("materials[{m}]: {what}"));
            }
        }
        for (m, k) in wanted.iter().filter(|(m, _)| !used.contains(*m)) {
            done.undressed.push(format!("materials[{m}]: no mesh has the material \"{}\"", leaves[*k].material));
        }
        if done.primitives == 0 {
            let why = done.undressed.first().cloned().unwrap_or_default();
            return Err(Error::input(path, format!("nothing could be dressed: {why}")));
        }
        let mut names: Vec<Value> = root["extensionsUsed"].as_array().cloned().unwrap_or_default();
        for name in ["KHR_materials_specular", "KHR_materials_diffuse_transmission"] {
            if !names.iter().any(|n| n == name) {
                names.push(json!(name));
            }
        }
        root["extensionsUsed"] = json!(names);
        file.write(out, root)?;
        let lost = Lost::new("gltf-translucent", &coats, &done.undressed);
        done.exported = crate::beside(record.clone(), vec![out.to_path_buf()], lost)?;
        Ok(done)
    })
}

/// The fit (its place in `leaves`) of each material that is named.
fn materials(path: &Path, opened: &Opened, leaves: &[Leaf]) -> Result<BTreeMap<usize, usize>> {
    let names: Vec<String> = opened
        .document
        .materials()
        .filter_map(|m| m.index().map(|k| m.name().map_or_else(|| k.to_string(), String::from)))
        .collect();
    let mut wanted = BTreeMap::new();
    for (k, leaf) in leaves.iter().enumerate() {
        let mut any = false;
        for (m, _) in names.iter().enumerate().filter(|(_, name)| **name == leaf.material) {
            any = true;
            if wanted.insert(m, k).is_some() {
                return Err(Error::argument("--leaf", &leaf.material, "each material once"));
            }
        }
        if !any {
            let list = names.iter().collect::<BTreeSet<_>>().into_iter().map(|n| format!("\"{n}\""));
            let found = match list.collect::<Vec<_>>().join(", ") {
                none if none.is_empty() => "has no materials".to_string(),
                list => format!("has {list}"),
            };
            return Err(Error::input(path, format!("found no material \"{}\"; the file {found}", leaf.material)));
        }
    }
    Ok(wanted)
}

/// A fit with the outline of its blade cut out, or without: a card shows a leaf by its outline alone, a mesh has the
/// outline itself.
type Key = (PathBuf, bool);

fn key(material: &Value, leaf: &Leaf) -> Key {
    (leaf.fit.clone(), matches!(material["alphaMode"].as_str(), Some("MASK" | "BLEND")))
}

/// Each fit that is wanted, once for meshes and once for cards.
fn sheets(root: &Value, wanted: &BTreeMap<usize, usize>, leaves: &[Leaf]) -> Result<Vec<(Key, Sheet)>> {
    let mut sheets: Vec<(Key, Sheet)> = Vec::new();
    for (m, k) in wanted {
        let key = key(&root["materials"][*m], &leaves[*k]);
        if sheets.iter().any(|(known, _)| *known == key) {
            continue;
        }
        let (mut sheet, on) = Sheet::of_folder(&key.0)?;
        sheet.mask = key.1.then_some(on);
        let taken = sheets.iter().filter(|(_, s)| s.name.starts_with(&sheet.name)).count();
        if taken > 0 {
            sheet.name = plain_name(&format!("{}_{}", sheet.name, taken + 1));
        }
        sheets.push((key, sheet));
    }
    Ok(sheets)
}

/// The texture of a material's colour.
fn colour(material: &Value) -> &Value {
    &material["pbrMetallicRoughness"]["baseColorTexture"]
}

/// The set of texture coordinates that a material's colour is read with.
fn texture_set(material: &Value) -> u64 {
    let colour = colour(material);
    colour["extensions"]["KHR_texture_transform"]["texCoord"].as_u64().or(colour["texCoord"].as_u64()).unwrap_or(0)
}

/// A fit in the file.
struct Coated {
    /// Index of each side's material; a leaf with one fitted side shows it on both.
    sides: Vec<(Side, usize)>,
    /// Smallest and largest texture coordinates of the fitted blade.
    blade: [[f64; 2]; 2],
    /// Whether the fitted blade is longer across the picture than down.
    across: bool,
    /// Whether a side has mapped normals, for which a mesh needs tangents.
    mapped: bool,
}

impl Coated {
    fn new(coat: &Coat, root: &mut Value, file: &mut Glb, out: &Path) -> Result<Coated> {
        let sides: Vec<Side> = Side::ALL.into_iter().filter(|s| lit(coat, *s)).collect();
        let mut placed = Vec::new();
        for side in &sides {
            let new = material(file, coat, *side, out, true, sides.len() == 1)?;
            let Some(list) = root["materials"].as_array_mut() else { continue };
            list.push(new);
            placed.push((*side, list.len() - 1));
        }
        let mesh = &coat.sheet.mesh;
        let bounds = |list: &mut dyn Iterator<Item = f32>| {
            list.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v.into()), high.max(v.into())])
        };
        let [u, v] = [0, 1].map(|c| bounds(&mut mesh.uvs.iter().map(|uv| uv[c])));
        let [x, y] = [0, 1].map(|c| bounds(&mut mesh.positions.iter().map(|p| p[c])));
        let mapped = Side::ALL.iter().any(|s| coat.sheet.normals[*s].is_some());
        Ok(Coated { sides: placed, blade: [u, v], across: x[1] - x[0] >= y[1] - y[0], mapped })
    }

    /// Texture coordinates of a place on a flat piece (along, across): the fitted blade's base is on the left of its
    /// maps and its tip on the right; where the blade is longer upright, its base is at the bottom.
    fn coordinates(&self, [along, across]: [f64; 2]) -> [f32; 2] {
        let [[u0, u1], [v0, v1]] = self.blade;
        let at = |from: f64, to: f64, t: f64| (from + (to - from) * t) as f32;
        if self.across { [at(u0, u1, along), at(v1, v0, across)] } else { [at(u1, u0, across), at(v1, v0, along)] }
    }
}
