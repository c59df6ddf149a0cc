//! Plants that stand in many places, in glTF: nodes with `EXT_mesh_gpu_instancing`.
//!
//! The extension places one mesh often, and not a group of meshes. So a plant's leaves of one sheet become either one
//! mesh at the places of the plant, or stay one leaf at every place of every leaf, whichever takes fewer bytes.

use crate::gltf::{is_second, primitive, shape};
use crate::scene::{ExportScene, ExportSheet};
use crate::{Error, Result};
use glam::{DMat4, DQuat, DVec3};
use mesophyll_files::glb::Glb;
use mesophyll_optics::side::Side;
use serde_json::{Value, json};
use std::path::Path;

/// The extension's name.
pub(crate) const EXTENSION: &str = "EXT_mesh_gpu_instancing";

/// Bytes of a place: translation, rotation and scale.
const PLACE: usize = 40;

/// Bytes of a vertex with a tangent, and of an index.
const VERTEX: usize = 48;
const INDEX: usize = 4;

/// More bytes of places and merged meshes than a file of the format can hold, with room for what else is in it.
const MOST_BYTES: usize = 3 << 30;

/// The leaves of one sheet of a plant, at the places where the plant stands.
struct Part<'a> {
    sheet: usize,
    leaves: Vec<DMat4>,
    places: &'a [DMat4],
    /// Whether all of them become one mesh.
    merged: bool,
    bytes: usize,
}

/// Adds the meshes and places of plants to a file, and returns their nodes. The meshes of the sheets come first, and
/// `sided` has the sides of each with their materials.
///
/// # Errors
/// [`Error::Usage`] for more than the file can hold.
pub(crate) fn nodes(
    shown: &ExportScene,
    sided: &[Vec<(Side, usize)>],
    file: &mut Glb,
    meshes: &mut Vec<Value>,
    path: &Path,
) -> Result<Vec<Value>> {
    let standing: Vec<_> = shown.standing().collect();
    let parts: Vec<Part> = standing.iter().flat_map(|(group, places)| parts(shown, sided, group, places)).collect();
    let bytes = parts.iter().map(|part| part.bytes).fold(0, usize::saturating_add);
    if bytes > MOST_BYTES {
        let found = format!("found {:.1} GB of plants and their places", bytes as f64 / 1e9);
        let expected = "expected at most 3.2 GB, which the format can hold; --to usd has no such limit";
        return Err(Error::Usage(format!("{}: {found}, {expected}", path.display())));
    }
    let mut out = Vec::new();
    for Part { sheet: k, leaves, places, merged, .. } in parts {
        let sheet = &shown.sheets[k];
        let (mesh, at) = match merged {
            false => (k, places.iter().flat_map(|place| leaves.iter().map(move |leaf| *place * *leaf)).collect()),
            true => {
                let sides = sided[k].len();
                let mut one = |(side, material): &(Side, usize)| {
                    let shape = shape(sheet, *side, sides).gathered(&leaves);
                    primitive(file, &shape, *material, is_second(*side, sides))
                };
                let primitives: Vec<Value> = sided[k].iter().map(&mut one).collect();
                meshes.push(json!({"name": format!("{} of a plant", sheet.name), "primitives": primitives}));
                (meshes.len() - 1, places.to_vec())
            }
        };
        out.push(json!({
            "mesh": mesh,
            "name": format!("{} in many places", sheet.name),
            "extensions": {EXTENSION: {"attributes": attributes(file, &at)}},
        }));
    }
    Ok(out)
}

/// The parts of a plant, one a sheet.
fn parts<'a>(
    shown: &ExportScene,
    sided: &[Vec<(Side, usize)>],
    group: &[(usize, DMat4)],
    places: &'a [DMat4],
) -> Vec<Part<'a>> {
    let of_sheet = |(sheet, of): (usize, &ExportSheet)| {
        let leaves: Vec<DMat4> = group.iter().filter(|(of, _)| *of == sheet).map(|(_, leaf)| *leaf).collect();
        let one = of.mesh.positions.len() * VERTEX + of.mesh.indices.len() * INDEX;
        let as_one = (leaves.len() * one * sided[sheet].len()).saturating_add(places.len() * PLACE);
        let each = leaves.len().saturating_mul(places.len()).saturating_mul(PLACE);
        let (merged, bytes) = (as_one < each, as_one.min(each));
        (!leaves.is_empty()).then_some(Part { sheet, leaves, places, merged, bytes })
    };
    shown.sheets.iter().enumerate().filter_map(of_sheet).collect()
}

/// The extension's attributes of places.
fn attributes(file: &mut Glb, places: &[DMat4]) -> Value {
    let parts: Vec<_> = places.iter().map(DMat4::to_scale_rotation_translation).collect();
    let list = |of: fn(&(DVec3, DQuat, DVec3)) -> DVec3| -> Vec<[f32; 3]> {
        parts.iter().map(|part| of(part).as_vec3().to_array()).collect()
    };
    let turns: Vec<[f32; 4]> = parts.iter().map(|(_, turn, _)| turn.as_quat().normalize().to_array()).collect();
    json!({
        "TRANSLATION": file.floats("VEC3", &list(|part| part.2)),
        "ROTATION": file.floats("VEC4", &turns),
        "SCALE": file.floats("VEC3", &list(|part| part.0)),
    })
}
