//! Plants that stand in many places, in files for other programs: every leaf is where it was, and a plant is there
//! once.

use crate::assembled::shown;
use crate::plants::validated;
use crate::programs::python;
use glam::{DMat4, DQuat, DVec3, Mat4, Quat, Vec3};
use mesophyll::export::scene::ExportScene;
use mesophyll::export::{ExportFormat, assemble};
use mesophyll::optics::gloss::Lobe;
use serde_json::{Value, json};
use std::path::Path;

fn place(k: usize, reach: f64) -> DMat4 {
    let k = k as f64;
    let at = DVec3::new((1.7 * k).sin(), (2.9 * k).cos(), (0.4 * k).sin()) * reach;
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, k, 2.0 * k, 0.3 * k);
    DMat4::from_scale_rotation_translation(DVec3::splat(0.5 + (k % 7.0) / 5.0), turn, at)
}

/// A square of 20 mm that stands by itself, two plants of it at 3 and at 60 places, and one that stands nowhere.
fn stand() -> ExportScene {
    let mut shown = shown(Lobe::Beckmann);
    shown.groups = vec![
        (0..4).map(|k| (0, place(k, 30.0))).collect(),
        (4..6).map(|k| (0, place(k, 30.0))).collect(),
        vec![(0, place(9, 30.0))],
    ];
    shown.stands = (0..63).map(|k| (usize::from(k >= 3), place(k + 20, 900.0))).collect();
    shown
}

/// The corners of the square, `out` of its plane, at all places, in order.
fn corners(places: impl Iterator<Item = DMat4>, out: f64) -> Vec<[f64; 3]> {
    let square = [(-10.0, 10.0), (10.0, 10.0), (10.0, -10.0), (-10.0, -10.0)].map(|(x, y)| DVec3::new(x, y, out));
    sorted(places.flat_map(|place| square.map(|p| place.transform_point3(p).to_array())).collect())
}

fn sorted(mut points: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
    let key = |p: &[f64; 3]| p.map(|v| (v * 10.0).round() as i64);
    points.sort_by_key(key);
    points
}

fn close(found: &[[f64; 3]], wanted: &[[f64; 3]], within: f64) {
    assert_eq!(found.len(), wanted.len());
    // Sorting may swap points that are nearly equal in x, so each is looked for among those with the next x.
    for (k, wanted) in wanted.iter().enumerate() {
        let near = &found[k.saturating_sub(40)..(k + 40).min(found.len())];
        let off = |p: &[f64; 3]| (0..3).map(|c| (p[c] - wanted[c]).abs()).fold(0.0, f64::max);
        let best = near.iter().map(off).fold(f64::INFINITY, f64::min);
        assert!(best < within, "{wanted:?} is missing by {best}");
    }
}

/// The numbers of an accessor of floats.
fn floats(root: &Value, bin: &[u8], accessor: &Value) -> Vec<Vec<f32>> {
    let of = |list: &str, k: &Value| root[list][k.as_u64().unwrap() as usize].clone();
    let accessor = of("accessors", accessor);
    assert_eq!(accessor["componentType"], 5126);
    let width = match accessor["type"].as_str().unwrap() {
        "VEC3" => 3,
        "VEC4" => 4,
        other => panic!("{other}"),
    };
    let begin = of("bufferViews", &accessor["bufferView"])["byteOffset"].as_u64().unwrap() as usize;
    let count = accessor["count"].as_u64().unwrap() as usize;
    let number = |at: usize| f32::from_le_bytes(bin[begin + 4 * at..][..4].try_into().unwrap());
    (0..count).map(|k| (0..width).map(|c| number(width * k + c)).collect()).collect()
}

/// The places of a node: one, or those of the extension.
fn places(root: &Value, bin: &[u8], node: &Value) -> Vec<Mat4> {
    let Some(attributes) = node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"].as_object() else {
        let numbers: Vec<f32> = node["matrix"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap() as f32).collect();
        return vec![Mat4::from_cols_slice(&numbers)];
    };
    let list = |name: &str| floats(root, bin, &attributes[name]);
    let (at, turn, scale) = (list("TRANSLATION"), list("ROTATION"), list("SCALE"));
    assert!(at.len() == turn.len() && at.len() == scale.len());
    (0..at.len())
        .map(|k| {
            let turn = Quat::from_slice(&turn[k]);
            assert!((turn.length() - 1.0).abs() < 1e-6);
            Mat4::from_scale_rotation_translation(Vec3::from_slice(&scale[k]), turn, Vec3::from_slice(&at[k]))
        })
        .collect()
}

/// A reader of the extension finds every leaf where it stands, on both sides; what stands often is in the file once,
/// and a reader without the extension is told.
#[test]
fn a_stand_is_an_instanced_gltf() {
    let folder = tempfile::tempdir().unwrap();
    let (shown, path) = (stand(), folder.path().join("s.glb"));
    assemble(&shown, ExportFormat::GltfTranslucent, &path, true, &[]).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let glb = gltf::Glb::from_slice(&bytes).unwrap();
    let (root, bin): (Value, _) = (serde_json::from_slice(&glb.json).unwrap(), glb.bin.unwrap());
    assert_eq!(root["extensionsRequired"], json!(["EXT_mesh_gpu_instancing"]));
    let document = gltf::Gltf::from_slice_without_validation(&bytes).unwrap();
    assert!(document.extensions_used().any(|e| e == "EXT_mesh_gpu_instancing"));
    // The sheet, and the second plant as one mesh: two leaves at sixty places. The first plant has more vertices than
    // places.
    assert_eq!((document.meshes().count(), root["meshes"][0]["primitives"].as_array().unwrap().len()), (2, 2));
    let nodes: Vec<&Value> = root["nodes"].as_array().unwrap().iter().filter(|n| n["mesh"].is_u64()).collect();
    assert_eq!(nodes.len(), 3);
    for side in 0..2 {
        let mut found = Vec::new();
        for node in &nodes {
            let mesh = &root["meshes"][node["mesh"].as_u64().unwrap() as usize]["primitives"][side];
            let attributes = &mesh["attributes"];
            let points = floats(&root, &bin, &attributes["POSITION"]);
            let normals = floats(&root, &bin, &attributes["NORMAL"]);
            assert!(normals.iter().all(|n| (Vec3::from_slice(n).length() - 1.0).abs() < 1e-5));
            for place in places(&root, &bin, node) {
                found.extend(
                    points.iter().map(|p| place.transform_point3(Vec3::from_slice(p)).to_array().map(f64::from)),
                );
            }
        }
        // The back of a leaf of unknown thickness stands 0.1 mm behind.
        let out = [0.0, -0.1][side];
        close(&sorted(found), &corners(shown.each_place().map(|(_, place)| place), out), 2e-3);
    }
    if let Some(said) = validated(&path) {
        assert!(said.starts_with("0 "), "{said}");
    }
}

/// OpenUSD's own reader finds every leaf where it stands, through both point instancers. Its validators have nothing to
/// say.
#[test]
fn a_stand_is_a_point_instancer() {
    let folder = tempfile::tempdir().unwrap();
    let shown = stand();
    assemble(&shown, ExportFormat::Usd, &folder.path().join("u"), true, &[]).unwrap();
    let text = std::fs::read_to_string(folder.path().join("u/scene.usda")).unwrap();
    // The outermost, and two plants; the third stands nowhere.
    assert_eq!(text.matches("def PointInstancer").count(), 3);
    assert_eq!(text.matches("def Mesh").count(), 1);
    let script = "
import json
from pxr import Usd, UsdGeom
stage = Usd.Stage.Open('u/scene.usda')
square = [(-10, 10, 0), (10, 10, 0), (10, -10, 0), (-10, -10, 0)]
def each(prim, above):
    instancer = UsdGeom.PointInstancer(prim)
    if not instancer:
        assert any(p.IsA(UsdGeom.Mesh) for p in Usd.PrimRange(prim, Usd.TraverseInstanceProxies())), prim
        yield above
        return
    targets = [stage.GetPrimAtPath(p) for p in instancer.GetPrototypesRel().GetForwardedTargets()]
    places = instancer.ComputeInstanceTransformsAtTime(0, 0, UsdGeom.PointInstancer.ExcludeProtoXform)
    for proto, place in zip(instancer.GetProtoIndicesAttr().Get(), places):
        yield from each(targets[proto], place * above)
from pxr import Gf
found = list(each(stage.GetPrimAtPath('/World/Stand'), Gf.Matrix4d(1)))
single = 'orientationsf' in [a.GetName() for a in stage.GetPrimAtPath('/World/Stand').GetAttributes()] \\
    and hasattr(UsdGeom.PointInstancer, 'GetOrientationsfAttr')
try:
    from pxr import UsdValidation
    every = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = [str(e.GetName()) for e in UsdValidation.ValidationContext(every).Validate(stage)]
except ImportError:
    errors = []
print(json.dumps([single, [list(m.Transform(Gf.Vec3d(*p))) for m in found for p in square], errors]))";
    let Some(said) = python("pxr", script, folder.path()) else { return };
    assert_eq!(said[2], json!([]));
    let found = sorted(serde_json::from_value(said[1].clone()).unwrap());
    let wanted = corners(shown.each_place().skip(shown.places.len()).map(|(_, place)| place), 0.0);
    // Readers of half precision are off by a thousandth of a plant.
    close(&found, &wanted, if said[0] == json!(true) { 2e-3 } else { 0.3 });
}

/// Formats that hold no plants write every leaf.
#[test]
fn other_formats_write_every_leaf() {
    let folder = tempfile::tempdir().unwrap();
    let shown = stand();
    assert_eq!(shown.each_place().count(), 1 + 4 * 3 + 2 * 60);
    for (format, file, word) in [
        (ExportFormat::Mitsuba, "scene.xml", "type=\"instance\""),
        (ExportFormat::Pbrt, "scene.pbrt", "ObjectInstance"),
    ] {
        let out = folder.path().join(format.name());
        assemble(&shown, format, &out, true, &[]).unwrap();
        let text = std::fs::read_to_string(out.join(file)).unwrap();
        assert_eq!(text.matches(word).count(), shown.place_count(), "{file}");
    }
    let mut many = shown.clone();
    many.stands = vec![(0, DMat4::IDENTITY); 2_000_001];
    let refused = assemble(&many, ExportFormat::Pbrt, Path::new("nowhere"), true, &[]).unwrap_err().to_string();
    let wanted = "found 8000005 leaves and pieces of wood at places of their own, expected at most 8000000";
    assert!(refused.contains(wanted), "{refused}");
}
