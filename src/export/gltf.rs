//! The blade as binary glTF 2.0: one primitive for each side, with its own material; textures are embedded, and nodes
//! scale to metres.
//!
//! The material has the base colour ρd, metalness 0, the roughness √m (glTF's α is roughness squared, and Beckmann's m
//! takes the place of α), and the specular colour ρs divided by the 0.04 that a reader assumes. `translucent` divides
//! the light that is not reflected in the way of glTF's diffuse transmission: with t the share of ρt in ρd + ρt, base
//! colour = ρd/(1 − t) and transmission colour = ρt/t.

use super::blade::Mesh;
use super::side::SideMaps;
use super::texture::{Turn, data_byte, encode, normal_pixel, pixels};
use crate::{Error, Result};
use mesophyll_files::glb::{self, Glb};
use mesophyll_files::image::to_srgb8;
use mesophyll_files::mesh::{self, LeafMesh};
use mesophyll_files::quantity::Quantity;
use mesophyll_leaf::BLADE;
use mesophyll_optics::side::Side;
use serde_json::{Value, json};
use std::path::Path;

/// Normal reflectance a glTF reader assumes (index 1.5).
const ASSUMED_F0: f32 = 0.04;

/// Writes `path` (.glb).
pub fn write(sides: &[SideMaps], folder: &Path, path: &Path, translucent: bool) -> Result<()> {
    let blade = mesh::read(&folder.join(BLADE), None)?;
    let mesh = Mesh::of(&blade);
    let mut file = Glb::default();
    let (mut primitives, mut materials) = (Vec::new(), Vec::new());
    for side in sides {
        let (shape, turn) = match side.side {
            Side::Front => (mesh.clone(), Turn::AsSeen),
            Side::Back => (mesh.turned(), Turn::Mirrored),
        };
        let attributes = json!({
            "POSITION": file.floats("VEC3", &shape.positions),
            "NORMAL": file.floats("VEC3", &shape.normals),
            "TEXCOORD_0": file.floats("VEC2", &shape.uvs),
            "TANGENT": file.floats("VEC4", &shape.tangents),
        });
        let indices = file.indices(&shape.indices);
        primitives.push(json!({"attributes": attributes, "indices": indices, "material": materials.len(), "mode": 4}));
        // A fit of one side shows this side from behind, too.
        materials.push(material(&mut file, side, &blade, folder, path, turn, translucent, sides.len() == 1)?);
    }
    let mut used = vec!["KHR_materials_specular"];
    if translucent {
        used.push("KHR_materials_diffuse_transmission");
    }
    let root = json!({
        "asset": glb::asset(),
        "extensionsUsed": used,
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "blade", "scale": [0.001, 0.001, 0.001]}],
        "meshes": [{"name": "blade", "primitives": primitives}],
        "materials": materials,
    });
    file.write(path, root)
}

fn material(
    file: &mut Glb,
    side: &SideMaps,
    blade: &LeafMesh,
    folder: &Path,
    path: &Path,
    turn: Turn,
    translucent: bool,
    double: bool,
) -> Result<Value> {
    let (width, height) = (side.maps.width, side.maps.height);
    let png = |pixel: &dyn Fn(usize) -> [u8; 3]| encode(path, width, height, &pixels(side, turn, pixel));
    let name = |what: &str| format!("{} {what}", side.side.name());
    let rho_d = side.rgb(Quantity::RhoD, folder)?;
    let at = |planes: [&[f32]; 3], k: usize| planes.map(|p| p[k].max(0.0));

    let mut extensions = json!({});
    let base = if translucent {
        let rho_t = side.rgb(Quantity::RhoT, folder)?;
        let share = |k: usize| {
            let (d, t): (f32, f32) = (at(rho_d, k).iter().sum(), at(rho_t, k).iter().sum());
            if d + t > 0.0 { (t / (d + t)).clamp(0.0, 1.0) } else { 0.0 }
        };
        // The factor sits in the alpha channel, so this picture alone is RGBA.
        let alpha = pixels(side, turn, |k| [data_byte(share(k), 0.0, 1.0); 3]);
        let factor = file.texture(&name("transmitted share"), &encode_alpha(path, width, height, &alpha)?);
        // The split uses the byte that the reader will see, not the exact share.
        let split = |k: usize| (f32::from(data_byte(share(k), 0.0, 1.0)) / 255.0).clamp(1e-3, 1.0 - 1e-3);
        let through = png(&|k| at(rho_t, k).map(|v| to_srgb8(v / split(k))))?;
        extensions["KHR_materials_diffuse_transmission"] = json!({
            "diffuseTransmissionFactor": 1.0,
            "diffuseTransmissionTexture": factor,
            "diffuseTransmissionColorTexture": file.texture(&name("transmitted colour"), &through),
        });
        png(&|k| at(rho_d, k).map(|v| to_srgb8(v / (1.0 - split(k)))))?
    } else {
        png(&|k| at(rho_d, k).map(to_srgb8))?
    };
    let mut pbr = json!({"metallicFactor": 0.0, "baseColorTexture": file.texture(&name("base colour"), &base)});
    match (side.rgb(Quantity::RhoS, folder), side.one(Quantity::M, folder)) {
        (Ok(rho_s), Ok(m)) => {
            let roughness = png(&|k| [0, data_byte(m[k].max(0.0).sqrt(), 0.0, 1.0), 0])?;
            pbr["metallicRoughnessTexture"] = file.texture(&name("roughness"), &roughness);
            let top = rho_s.iter().map(|p| side.range(p).1 as f32).fold(1e-6, f32::max);
            let specular = png(&|k| at(rho_s, k).map(|v| to_srgb8(v / top)))?;
            extensions["KHR_materials_specular"] = json!({
                "specularColorFactor": vec![top / ASSUMED_F0; 3],
                "specularColorTexture": file.texture(&name("specular colour"), &specular),
            });
        }
        _ => extensions["KHR_materials_specular"] = json!({"specularFactor": 0.0}),
    }
    let mut out =
        json!({"name": side.side.name(), "doubleSided": double, "pbrMetallicRoughness": pbr, "extensions": extensions});
    if let Some(normals) = side.normals(blade, folder)? {
        let picture = png(&|k| normal_pixel(normals[k], turn))?;
        out["normalTexture"] = file.texture(&name("normals"), &picture);
    }
    Ok(out)
}

/// White pixels whose alpha is the first of every three bytes.
fn encode_alpha(path: &Path, width: usize, height: usize, grey: &[u8]) -> Result<Vec<u8>> {
    let rgba: Vec<u8> = grey.chunks_exact(3).flat_map(|p| [255, 255, 255, p[0]]).collect();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgba);
    let failed = |e: png::EncodingError| Error::write(path, e);
    encoder.write_header().map_err(failed)?.write_image_data(&rgba).map_err(failed)?;
    Ok(bytes)
}
