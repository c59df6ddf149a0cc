//! Fitted leaves on a plant from elsewhere: the named materials of a glTF file are replaced by those of fits, and all
//! else stays as it is.
//!
//! A fitted leaf has two sides, each with a material of its own. Every mesh with a named material therefore gets a
//! second primitive: the same triangles, seen from behind and moved back by the leaf's thickness. Texture
//! coordinates of the file are kept. Where there are none, each flat piece is laid along the fitted blade by its own
//! axes ([`mesophyll_plants::import::flat_pieces`]).

mod assignment;
mod cards;
mod coverage;
mod plan;
mod primitive;

use crate::coat::{ExportCoat, ExportLoss};
use crate::foreign::target::ExportTarget;
use crate::gltf::{lit, material};
use crate::scene::{ExportSheet, plain_name, unmeasured};
use crate::{Error, ExportResult, Result};
use assignment::Wanted;
use mesophyll_files::glb::Glb;
use mesophyll_files::gltf_file;
use mesophyll_fits::record::FitRecord;
use mesophyll_optics::side::Side;
use plan::Plan;
use primitive::Work;
use serde_json::{Value, json};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Extensions that a file may require: they are kept as they are, and none changes what is dressed.
const KEPT: [&str; 9] = [
    mesophyll_plants::file::INSTANCING,
    "KHR_lights_punctual",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

/// A material of the plant, or a mesh where no material has the name, and the fit that takes its place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeafReplacement {
    /// The material's name in the file; one without a name is called by its number, from 0.
    pub material: String,
    /// Folder of the leaf fit.
    pub fit: PathBuf,
}

/// What was done.
#[derive(Debug, Default)]
pub struct DressResult {
    /// The files, and what is lost.
    pub exported: ExportResult,
    /// Number of primitives that were dressed.
    pub primitives: usize,
    /// Number of their triangles.
    pub triangles: usize,
    /// Number of those triangles whose texture coordinates were made.
    pub made: usize,
    /// Number of leaves that were scattered over cards of twigs.
    pub scattered: usize,
    /// The area that was dressed, and how much of it shows the fitted blade (the file's unit, squared).
    pub area: [f64; 2],
    /// What has a named material and could not be dressed, or lost something, a sentence each.
    pub undressed: Vec<String>,
    /// What is probably not meant so, a sentence each.
    pub warnings: Vec<String>,
}

/// How a plant is dressed.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options {
    /// Makes texture coordinates also where the file has its own.
    pub make_uv: bool,
    /// Scatters leaves over flat pieces that are many times as large as the fitted blade.
    pub scatter: bool,
}

/// Writes the plant in `path` with the fits of `leaves` to `out` (.glb), and what is lost beside it.
///
/// # Errors
/// [`Error::Input`] for a plant or a fit that cannot be read, for a material that is not there or is named twice, and
/// where nothing could be dressed; [`Error::Usage`] and [`Error::Write`] for `out`.
pub fn dress(path: &Path, leaves: &[LeafReplacement], options: Options, out: &Path) -> Result<DressResult> {
    let record = crate::record_of_loss(out)?;
    gltf_file::read(path, &KEPT, |opened| {
        let wanted = Wanted::of(path, &opened, leaves)?;
        let (mut root, bin) = gltf_file::whole(path, &opened)?;
        let mut done = DressResult::default();
        let plans = plan::plans(path, &opened, &root, &wanted, options, &mut done.undressed);
        let mut file = Glb::onto(&mut root, bin);
        let sheets = sheets(&plans, leaves)?;
        let coats: Vec<ExportCoat> =
            sheets.iter().map(|s| ExportCoat::new(&s.sheet, ExportTarget::GltfTranslucent)).collect();
        let mut coated: Vec<(Key, Coated)> = Vec::new();
        for plan in &plans {
            if coated.iter().any(|(key, _)| *key == plan.key) {
                continue;
            }
            let Some(k) = sheets.iter().position(|s| (s.leaf, s.masked) == (plan.key.leaf, plan.key.masked)) else {
                continue;
            };
            file.wrap(plan.key.wrap);
            coated.push((plan.key, Coated::new(&coats[k], &sheets[k].on, plan.key.wrap, &mut root, &mut file, out)?));
        }
        let mut work = Work { path, opened: &opened, options, file: &mut file, turned: HashMap::new(), done };
        let mut plans = plans.into_iter().peekable();
        for mesh in opened.document.meshes() {
            let mut primitives = Vec::new();
            for primitive in mesh.primitives() {
                let own = root["meshes"][mesh.index()]["primitives"][primitive.index()].clone();
                let Some(plan) = plans.next_if(|p| p.at == [mesh.index(), primitive.index()]) else {
                    primitives.push(own);
                    continue;
                };
                let field = plan.field();
                let coat = coated.iter().find(|(key, _)| *key == plan.key);
                match coat.map(|(_, coated)| work.dress(&primitive, plan, &own, coated)).transpose()? {
                    Some(Ok(new)) => primitives.extend(new),
                    why => {
                        let why = why.and_then(std::result::Result::err).unwrap_or_default();
                        work.done.undressed.push(format!("{field}: {why}"));
                        primitives.push(own);
                    }
                }
            }
            root["meshes"][mesh.index()]["primitives"] = json!(primitives);
        }
        let mut done = work.done;
        plan::unused(&opened, &root, &wanted, leaves, &mut done.undressed);
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
        let mut unsaid = done.undressed.clone();
        for leaf in leaves {
            unsaid.extend(FitRecord::read(&leaf.fit)?.stated_in_one().iter().map(|said| unmeasured(said)));
        }
        let lost = ExportLoss::new("gltf-translucent", &coats, &unsaid);
        done.exported = crate::beside(record.clone(), vec![out.to_path_buf()], lost)?;
        Ok(done)
    })
}

/// A fit as the plant shows it: which one, with the outline of its blade cut out or without, and how its pictures go on
/// beyond their edges. A card shows a leaf by its outline alone; a mesh has the outline itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Key {
    leaf: usize,
    masked: bool,
    wrap: [u64; 2],
}

/// A fit once for meshes or once for cards.
struct Cut {
    leaf: usize,
    masked: bool,
    sheet: ExportSheet,
    /// Whether a texel, in the front's columns, is on the leaf.
    on: Vec<bool>,
}

/// Each fit that is wanted.
fn sheets(plans: &[Plan], leaves: &[LeafReplacement]) -> Result<Vec<Cut>> {
    let mut sheets: Vec<Cut> = Vec::new();
    for plan in plans {
        let Key { leaf, masked, .. } = plan.key;
        let fit = &leaves[leaf].fit;
        if sheets.iter().any(|s| (s.leaf, s.masked) == (leaf, masked)) {
            continue;
        }
        let (mut sheet, on) = ExportSheet::of_folder(fit)?;
        sheet.mask = masked.then(|| on.clone());
        let taken = sheets.iter().filter(|s| s.sheet.name.starts_with(&sheet.name)).count();
        if taken > 0 {
            sheet.name = plain_name(&format!("{}_{}", sheet.name, taken + 1));
        }
        sheets.push(Cut { leaf, masked, sheet, on });
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
    /// How far the back stands behind the file's surface (m).
    thickness_m: f64,
    /// Length and width of the rectangle around the fitted blade (m), and how much of it the blade fills.
    blade_m: [f64; 2],
    filled: f64,
    /// Whether a side has mapped normals, for which a mesh needs tangents.
    mapped: bool,
    /// Whether the outline is cut out.
    masked: bool,
    /// Columns and rows of its pictures, which of their texels are on the leaf, and how they go on.
    size: [usize; 2],
    on: Vec<bool>,
    wrap: [u64; 2],
}

impl Coated {
    fn new(
        coat: &ExportCoat,
        on: &[bool],
        wrap: [u64; 2],
        root: &mut Value,
        file: &mut Glb,
        out: &Path,
    ) -> Result<Coated> {
        let sides: Vec<Side> = Side::ALL.into_iter().filter(|s| lit(coat, *s)).collect();
        let mut placed = Vec::new();
        if !root["materials"].is_array() {
            root["materials"] = json!([]);
        }
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
        let [x, y] = [0, 1].map(|c| bounds(&mut mesh.positions.iter().map(|p| p[c]))).map(|[low, high]| high - low);
        let mapped = Side::ALL.iter().any(|s| coat.sheet.normals[*s].is_some());
        let across = x >= y;
        let [width, height] = coat.sheet.size;
        let texels = |[low, high]: [f64; 2], count: usize| {
            let at = |t: f64| ((t * count as f64).round().max(0.0) as usize).min(count);
            at(low)..at(high)
        };
        let there = texels(v, height).flat_map(|row| texels(u, width).map(move |column| row * width + column));
        let (mut all, mut leaf) = (0usize, 0usize);
        for k in there {
            (all, leaf) = (all + 1, leaf + usize::from(on[k]));
        }
        Ok(Coated {
            thickness_m: coat.sheet.thickness_mm / 1000.0,
            sides: placed,
            blade: [u, v],
            across,
            blade_m: [x.max(y), x.min(y)].map(|mm| mm / 1000.0),
            filled: if all > 0 { leaf as f64 / all as f64 } else { 1.0 },
            mapped,
            masked: coat.sheet.mask.is_some(),
            size: coat.sheet.size,
            on: on.to_vec(),
            wrap,
        })
    }

    /// Texture coordinates of a place on a flat piece (along, across): the fitted blade's base is on the left of its
    /// maps and its tip on the right; where the blade is longer upright, its base is at the bottom.
    fn coordinates(&self, [along, across]: [f64; 2]) -> [f32; 2] {
        let [[u0, u1], [v0, v1]] = self.blade;
        let at = |from: f64, to: f64, t: f64| (from + (to - from) * t) as f32;
        if self.across { [at(u0, u1, along), at(v1, v0, across)] } else { [at(u1, u0, across), at(v1, v0, along)] }
    }
}
