//! Leaves and scenes as binary glTF 2.0. Every sheet has one primitive for each side, with its own material; textures
//! are embedded, and nodes scale to metres. The back of a leaf stands its thickness behind the front: of two surfaces
//! at the same place, a renderer that does not cull shows either.
//!
//! The material has metalness 0, a roughness whose square is the slope of GGX, and KHR_materials_specular with the same
//! reflectance at normal and grazing incidence, because our gloss has no Fresnel factor: `specularFactor` is the
//! largest channel w of the gloss, and `specularColor` the gloss over w. What is left, 1 − w, lights the rest: the base
//! colour, or base colour and transmission colour in the shares 1 − t and t of KHR_materials_diffuse_transmission.
//! Extensions are used and never required. [`crate::foreign::target`] finds the numbers, which are kept in bytes.

use super::blade::ExportMesh;
use super::texture::{TextureMirroring, encode, normal_pixel};
use crate::coat::{ExportCoat, ExportLoss, coats};
use crate::foreign::target::{ExportTarget, TargetSide};
use crate::instanced;
use crate::scene::{ExportScene, ExportSheet, ExportSky};
use crate::{Error, Result};
use glam::{DMat4, DVec3};
use mesophyll_files::glb::{self, Glb};
use mesophyll_files::gltf_file::BACK_OF_LEAF;
use mesophyll_files::image::to_srgb8;
use mesophyll_optics::side::Side;
use serde_json::{Value, json};
use std::path::Path;

/// Normal reflectance that a reader assumes (index 1.5).
const ASSUMED_F0: f64 = 0.04;

/// What a file is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GltfPurpose {
    /// A leaf alone with its own axes, opaque.
    Opaque,
    /// The same with transmitted light.
    Translucent,
    /// A whole scene with transmitted light, y up, its camera and its sun.
    Scene,
    /// A whole scene of shapes, places and camera; materials are names alone, one a sheet, and there is no light.
    Bare,
}

/// Writes `path` (.glb).
///
/// # Errors
/// [`Error::Write`].
pub fn write(shown: &ExportScene, path: &Path, kind: GltfPurpose) -> Result<ExportLoss> {
    let (translucent, scene) = (kind != GltfPurpose::Opaque, matches!(kind, GltfPurpose::Scene | GltfPurpose::Bare));
    let (target, name) =
        if translucent { (ExportTarget::GltfTranslucent, "gltf-translucent") } else { (ExportTarget::Gltf, "gltf") };
    if kind == GltfPurpose::Bare {
        return bare(shown, path).map(|()| ExportLoss::new(name, &[], &[]));
    }
    let coats = coats(shown, target);
    let mut file = Glb::default();
    let (mut meshes, mut materials, mut sided) = (Vec::new(), Vec::new(), Vec::new());
    for coat in &coats {
        let sides: Vec<Side> = Side::ALL.into_iter().filter(|s| lit(coat, *s)).collect();
        let mut primitives = Vec::new();
        for side in &sides {
            let shape = shape(coat.sheet, *side, sides.len());
            primitives.push(primitive(&mut file, &shape, materials.len(), is_second(*side, sides.len())));
            // A sheet with one side shows this side from behind, too.
            materials.push(material(&mut file, coat, *side, path, translucent, sides.len() == 1)?);
        }
        let first = materials.len() - sides.len();
        sided.push(sides.into_iter().zip(first..).collect());
        meshes.push(json!({"name": coat.sheet.name, "primitives": primitives}));
    }
    let stands = if scene { instanced::nodes(shown, &sided, &mut file, &mut meshes, path)? } else { Vec::new() };
    let mut used = vec!["KHR_materials_specular"];
    if translucent {
        used.push("KHR_materials_diffuse_transmission");
    }
    let mut root = json!({
        "asset": glb::asset(),
        "scene": 0,
        "meshes": meshes,
        "materials": materials,
    });
    if scene {
        if !stands.is_empty() {
            // A reader that does not know it would draw each plant once, and nobody would notice.
            used.push(instanced::EXTENSION);
            root["extensionsRequired"] = json!([instanced::EXTENSION]);
        }
        nodes(&mut root, shown, stands);
        if sun(&mut root, shown) {
            used.push("KHR_lights_punctual");
        }
    } else {
        root["scenes"] = json!([{"nodes": [0]}]);
        root["nodes"] = json!([{"mesh": 0, "name": "blade", "scale": [0.001, 0.001, 0.001]}]);
    }
    root["extensionsUsed"] = json!(used);
    file.write(path, root)?;
    let mut unsaid = shown.left_out.clone();
    unsaid.extend(shown.unsaid_exposure().filter(|_| scene));
    if scene && !matches!(shown.sky, ExportSky::None) {
        unsaid.push(
            "the sky's light, for which the format has no core light; the reader's environment takes its place".into(),
        );
    }
    if scene && shown.sun.is_some() {
        unsaid.push("the sun's disk: its light comes from one direction, so that shadows have no penumbra".into());
    }
    if !translucent && coats.iter().any(|c| c.sheet.texels.iter().any(|t| t.sides.front.rho_t != [0.0; 3])) {
        unsaid.push("transmitted light; --to gltf-translucent holds it".into());
    }
    Ok(ExportLoss::new(name, &coats, &unsaid))
}

/// Whether a side scatters any light.
pub(crate) fn lit(coat: &ExportCoat, side: Side) -> bool {
    side == Side::Front && !coat.leaf
        || coat.sheet.texels.iter().any(|t| {
            let p = &t.sides[side];
            [p.rho_d, p.rho_s, p.rho_t].iter().flatten().any(|v| *v > 0.0)
        })
}

/// The shape of a side of a sheet that shows this many sides. Its normals point out of this side.
pub(crate) fn shape(sheet: &ExportSheet, side: Side, sides: usize) -> ExportMesh {
    match side {
        Side::Front => sheet.mesh.clone(),
        Side::Back if is_second(side, sides) => sheet.mesh.turned().raised(sheet.thickness_mm),
        Side::Back => sheet.mesh.turned(),
    }
}

/// Whether a side of a sheet that shows this many sides is the back of a front.
pub(crate) fn is_second(side: Side, sides: usize) -> bool {
    side == Side::Back && sides > 1
}

/// Marks the back of a leaf whose front is in the file as well. Our readers take one of the two.
pub(crate) fn mark_back(primitive: &mut Value) {
    if !primitive["extras"].is_object() {
        primitive["extras"] = json!({});
    }
    primitive["extras"][BACK_OF_LEAF] = json!(true);
}

/// A shape with a material; `second` is the back of a front.
pub(crate) fn primitive(file: &mut Glb, shape: &ExportMesh, material: usize, second: bool) -> Value {
    let mut attributes = json!({
        "POSITION": file.floats("VEC3", &shape.positions),
        "NORMAL": file.floats("VEC3", &shape.normals),
        "TEXCOORD_0": file.floats("VEC2", &shape.uvs),
    });
    if shape.tangents.len() == shape.positions.len() {
        attributes["TANGENT"] = json!(file.floats("VEC4", &shape.tangents));
    }
    let indices = file.indices(&shape.indices);
    let mut out = json!({"attributes": attributes, "indices": indices, "material": material, "mode": 4});
    if second {
        mark_back(&mut out);
    }
    out
}

/// A linear value from 0 to 1 as a byte.
fn byte(v: f64) -> u8 {
    (v.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// The material of a side, with its pictures in the file.
pub(crate) fn material(
    file: &mut Glb,
    coat: &ExportCoat,
    side: Side,
    path: &Path,
    translucent: bool,
    double: bool,
) -> Result<Value> {
    let [width, height] = coat.sheet.size;
    let of = |k: usize| -> &TargetSide { &coat.coded[k][side] };
    let pixels = |pixel: &dyn Fn(usize) -> [u8; 3]| -> Vec<u8> { (0..width * height).flat_map(pixel).collect() };
    let png = |pixel: &dyn Fn(usize) -> [u8; 3]| encode(path, width, height, &pixels(pixel));
    let srgb = |c: [f64; 3]| c.map(|v| to_srgb8(v as f32));
    let name = |what: &str| format!("{} {} {what}", coat.sheet.name, side.name());
    let mut extensions = json!({});
    if translucent {
        // The factor sits in the alpha channel.
        let share = |k: usize| ([255; 3], byte(of(k).share));
        let factor = file.texture(&name("transmitted share"), &with_alpha(path, [width, height], &share)?);
        let through = png(&|k| srgb(of(k).through))?;
        extensions["KHR_materials_diffuse_transmission"] = json!({
            "diffuseTransmissionFactor": 1.0,
            "diffuseTransmissionTexture": factor,
            "diffuseTransmissionColorTexture": file.texture(&name("transmitted colour"), &through),
        });
    }
    // Where the sheet has holes, the base colour has them in its alpha channel.
    let base = match &coat.sheet.mask {
        Some(mask) => with_alpha(path, [width, height], &|k| (srgb(of(k).diffuse), if mask[k] { 255 } else { 0 }))?,
        None => png(&|k| srgb(of(k).diffuse))?,
    };
    let mut pbr = json!({"metallicFactor": 0.0, "baseColorTexture": file.texture(&name("base colour"), &base)});
    if coat.coded.iter().any(|c| c[side].weight > 0.0) {
        let roughness = png(&|k| [0, byte(of(k).alpha.sqrt()), 0])?;
        pbr["metallicRoughnessTexture"] = file.texture(&name("roughness"), &roughness);
        let gloss = with_alpha(path, [width, height], &|k| (srgb(of(k).gloss), byte(of(k).weight)))?;
        let gloss = file.texture(&name("specular colour and factor"), &gloss);
        extensions["KHR_materials_specular"] = json!({
            "specularTexture": gloss,
            "specularColorTexture": gloss,
            "specularColorFactor": vec![1.0 / ASSUMED_F0; 3],
        });
    } else {
        extensions["KHR_materials_specular"] = json!({"specularFactor": 0.0});
    }
    let mut out = json!({
        "name": format!("{} {}", coat.sheet.name, side.name()),
        "doubleSided": double,
        "pbrMetallicRoughness": pbr,
        "extensions": extensions,
    });
    if coat.sheet.mask.is_some() {
        out["alphaMode"] = json!("MASK");
    }
    if let Some(normals) = &coat.sheet.normals[side] {
        // The normals are in the front's columns, with x along +u on both sides.
        let picture = png(&|k| normal_pixel(normals[k], TextureMirroring::AsSeen))?;
        out["normalTexture"] = file.texture(&name("normals"), &picture);
    }
    Ok(out)
}

/// A picture of colours with an alpha channel.
fn with_alpha(path: &Path, [width, height]: [usize; 2], pixel: &dyn Fn(usize) -> ([u8; 3], u8)) -> Result<Vec<u8>> {
    let rgba: Vec<u8> = (0..width * height)
        .flat_map(|k| {
            let ([r, g, b], a) = pixel(k);
            [r, g, b, a]
        })
        .collect();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgba);
    let failed = |e: png::EncodingError| Error::write(path, e);
    encoder.write_header().map_err(failed)?.write_image_data(&rgba).map_err(failed)?;
    Ok(bytes)
}

/// Writes shapes, places and camera.
fn bare(shown: &ExportScene, path: &Path) -> Result<()> {
    let mut file = Glb::default();
    let mut mesh = |(k, sheet): (usize, &ExportSheet)| {
        let primitives = [primitive(&mut file, &sheet.mesh, k, false)];
        json!({"name": sheet.name, "primitives": primitives})
    };
    let meshes: Vec<Value> = shown.sheets.iter().enumerate().map(&mut mesh).collect();
    let materials: Vec<Value> = shown.sheets.iter().map(|s| json!({"name": s.name, "doubleSided": true})).collect();
    let mut root = json!({"asset": glb::asset(), "scene": 0, "meshes": meshes, "materials": materials});
    let of_stands = shown.each_place().skip(shown.places.len());
    nodes(&mut root, shown, of_stands.map(|(sheet, place)| one(shown, sheet, &place)).collect());
    file.write(path, root)
}

/// A node at `eye` whose −z points to `target`.
pub fn looking(eye: DVec3, target: DVec3, up: DVec3) -> DMat4 {
    let back = (eye - target).normalize();
    let right = up.cross(back).normalize();
    let up = back.cross(right);
    DMat4::from_cols(right.extend(0.0), up.extend(0.0), back.extend(0.0), eye.extend(1.0))
}

/// The node of a sheet at a place.
fn one(shown: &ExportScene, sheet: usize, place: &DMat4) -> Value {
    json!({"mesh": sheet, "name": shown.sheets[sheet].name, "matrix": place.to_cols_array()})
}

/// The nodes of a scene, with those of plants that stand in many places: everything below one node that turns z up into
/// y up and mm into metres.
fn nodes(root: &mut Value, shown: &ExportScene, stands: Vec<Value>) {
    let mut all = vec![Value::Null];
    all.extend(shown.places.iter().map(|(sheet, place)| one(shown, *sheet, place)));
    all.extend(stands);
    let c = &shown.camera;
    let look = looking(c.eye, c.target, c.up);
    all.push(json!({"name": "camera", "camera": 0, "matrix": look.to_cols_array()}));
    root["cameras"] = json!([{
        "type": "perspective",
        "perspective": {
            "yfov": c.fov_y_deg.to_radians(),
            "aspectRatio": shown.size[0] as f64 / shown.size[1] as f64,
            "znear": 0.001,
        },
        // The format has no exposure.
        "extras": {"exposure_stops": shown.stops()},
    }]);
    let half = 0.5f64.sqrt();
    all[0] = json!({
        "name": shown.name,
        "scale": [0.001, 0.001, 0.001],
        "rotation": [-half, 0.0, 0.0, half],
        "children": (1..all.len()).collect::<Vec<_>>(),
    });
    root["nodes"] = json!(all);
    root["scenes"] = json!([{"nodes": [0]}]);
}

/// Adds the sun to the nodes; false where there is none.
fn sun(root: &mut Value, shown: &ExportScene) -> bool {
    let (Some(sun), Some(nodes)) = (&shown.sun, root["nodes"].as_array_mut()) else { return false };
    // A light shines along its own −z.
    let toward = sun.direction.normalize();
    let up = if toward.z.abs() < 0.9 { DVec3::Z } else { DVec3::X };
    let last = nodes.len();
    nodes.push(json!({
        "name": "sun",
        "matrix": looking(DVec3::ZERO, -toward, up).to_cols_array(),
        "extensions": {"KHR_lights_punctual": {"light": 0}},
    }));
    if let Some(children) = nodes[0]["children"].as_array_mut() {
        children.push(json!(last));
    }
    let most = sun.irradiance.into_iter().fold(f64::MIN_POSITIVE, f64::max);
    let light = json!({
        "type": "directional", "name": "sun", "intensity": most, "color": sun.irradiance.map(|v| v.max(0.0) / most),
    });
    root["extensions"] = json!({"KHR_lights_punctual": {"lights": [light]}});
    true
}
