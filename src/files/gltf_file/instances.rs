//! Instances of a node's mesh (`EXT_mesh_gpu_instancing`).

use super::{GltfDocument, INSTANCING};
use crate::{Error, Result};
use glam::{DMat4, DQuat, DVec3};
use gltf::accessor::{DataType, Dimensions, Iter};
use serde_json::Value;
use std::path::Path;

/// The places of instances in the frame of their node, and what `_AT` says of each. A node without instances counts as
/// one itself.
///
/// # Errors
/// [`Error::Input`] that names the node: an attribute that is missing, not of finite floats or of another length than
/// the others, and a rotation of length 0.
pub fn places(path: &Path, opened: &GltfDocument, node: &gltf::Node) -> Result<Vec<(Option<f64>, DMat4)>> {
    let Some(said) = node.extension_value(INSTANCING) else { return Ok(vec![(None, DMat4::IDENTITY)]) };
    let wrong = |field: String, what: String| {
        let name = node.name().map_or_else(|| format!("nodes[{}]", node.index()), |n| format!("node \"{n}\""));
        Error::field(path, &format!("{name}: {field}"), what)
    };
    let list = |key: &str, width: usize| -> Result<Option<Vec<f64>>> {
        let Some(index) = said.get("attributes").and_then(|a| a.get(key)).and_then(Value::as_u64) else {
            return Ok(None);
        };
        let field = || format!("{INSTANCING}.{key}");
        let accessor = opened
            .document
            .accessors()
            .nth(index as usize)
            .ok_or_else(|| wrong(field(), format!("found accessor {index}, which is not there")))?;
        let what = || format!("expected finite floats, {width} an instance, within their buffer");
        numbers(opened, &accessor, width).ok_or_else(|| wrong(field(), what())).map(Some)
    };
    let (moved, turned, scaled, at) =
        (list("TRANSLATION", 3)?, list("ROTATION", 4)?, list("SCALE", 3)?, list("_AT", 1)?);
    let lengths = [(&moved, 3), (&turned, 4), (&scaled, 3), (&at, 1)];
    let counts: Vec<usize> = lengths.iter().filter_map(|(l, w)| l.as_ref().map(|l| l.len() / w)).collect();
    let n = counts.first().copied().unwrap_or(0);
    if counts.iter().any(|c| *c != n) {
        return Err(wrong(INSTANCING.into(), "its attributes have different counts".into()));
    }
    let three = |list: &Option<Vec<f64>>, k: usize, none: DVec3| {
        list.as_ref().map_or(none, |l| DVec3::new(l[3 * k], l[3 * k + 1], l[3 * k + 2]))
    };
    (0..n)
        .map(|k| {
            let turn = turned.as_ref().map_or(DQuat::IDENTITY, |l| DQuat::from_slice(&l[4 * k..4 * k + 4]));
            if turn.length_squared() < 1e-12 {
                let what = format!("instance {k}: found 0, 0, 0, 0, expected a unit quaternion");
                return Err(wrong(format!("{INSTANCING}.ROTATION"), what));
            }
            let local = DMat4::from_scale_rotation_translation(
                three(&scaled, k, DVec3::ONE),
                turn.normalize(),
                three(&moved, k, DVec3::ZERO),
            );
            // Single precision may have rounded a place at the tip upwards.
            let rounded = |at: f64| if (-1e-6..=1.0 + 1e-6).contains(&at) { at.clamp(0.0, 1.0) } else { at };
            Ok((at.as_ref().map(|l| rounded(l[k])), local))
        })
        .collect()
}

/// The numbers of an accessor of floats, with `width` numbers in each entry.
fn numbers(opened: &GltfDocument, accessor: &gltf::Accessor, width: usize) -> Option<Vec<f64>> {
    let buffer = |b: gltf::Buffer| opened.buffers.get(b.index()).map(|d| d.0.as_slice());
    if accessor.data_type() != DataType::F32 {
        return None;
    }
    let out: Vec<f64> = match (accessor.dimensions(), width) {
        (Dimensions::Scalar, 1) => Iter::<f32>::new(accessor.clone(), buffer)?.map(f64::from).collect(),
        (Dimensions::Vec3, 3) => Iter::<[f32; 3]>::new(accessor.clone(), buffer)?.flatten().map(f64::from).collect(),
        (Dimensions::Vec4, 4) => Iter::<[f32; 4]>::new(accessor.clone(), buffer)?.flatten().map(f64::from).collect(),
        _ => return None,
    };
    (out.len() == accessor.count() * width && out.iter().all(|v| v.is_finite())).then_some(out)
}
