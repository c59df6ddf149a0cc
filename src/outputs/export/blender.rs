//! A scene for Blender: `scene.py`, a Python script that imports `scene.glb` and gives every sheet nodes for Cycles.
//!
//! Nodes are added and not mixed, so a leaf is exact but for its gloss's masking: Diffuse, Translucent and Glossy BSDF
//! for the front, others for the back, chosen by Backfacing.

use crate::Result;
use crate::coat::{ExportCoat, ExportLoss, TexturePaint, TextureWriter, coats};
use crate::foreign::micro::SlopeDistribution;
use crate::foreign::target::{ExportTarget, TargetSide};
use crate::gltf::{self, GltfPurpose};
use crate::scene::{ExportScene, ExportSky};
use mesophyll_files::atomic;
use mesophyll_optics::side::Side;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// The script after its data.
const SCRIPT: &str = include_str!("blender.py");

/// Writes the folder; returns its files and what is lost.
///
/// # Errors
/// [`crate::Error::Write`].
pub fn write(shown: &ExportScene, folder: &Path) -> Result<(Vec<PathBuf>, ExportLoss)> {
    let coats = coats(shown, ExportTarget::Blender);
    let mut textures = TextureWriter::new(folder);
    let mut materials = Map::new();
    for coat in &coats {
        let mut sides = json!({"slopes": SlopeDistribution::of(coat.sheet.lobe()).name().to_uppercase()});
        for side in Side::ALL {
            sides[side.name()] = one(coat, side, &mut textures)?;
        }
        if let Some(mask) = &coat.sheet.mask {
            let on = |k: usize| [f32::from(u8::from(mask[k])); 3];
            let name = format!("{}_mask", coat.sheet.name);
            sides["mask"] = value(&textures.picture(&name, coat.sheet.size, on)?);
        }
        materials.insert(coat.sheet.name.clone(), sides);
    }
    let sky = match &shown.sky {
        ExportSky::None => Value::Null,
        ExportSky::Even(radiance) => json!(radiance),
        // Blender's panoramas are as ours.
        ExportSky::Map(map) => value(&textures.picture("sky", map.size, |k| map.texels[k])?),
    };
    let sun = shown.sun.map(|sun| {
        json!({"towards": sun.direction.normalize().to_array(), "irradiance": sun.irradiance,
            "angle": 2.0 * sun.radius})
    });
    let data = json!({
        "materials": materials, "sky": sky, "sun": sun, "size": shown.size, "samples": shown.samples,
        "stops": shown.stops(),
    });
    let glb = folder.join("scene.glb");
    gltf::write(shown, &glb, GltfPurpose::Bare)?;
    let text = serde_json::to_string(&data.to_string()).map_err(|e| crate::Error::write(folder, e))?;
    let script = folder.join("scene.py");
    atomic::write_bytes(&script, format!("{}DATA = json.loads({text})\n{SCRIPT}", HEAD).as_bytes())?;
    let mut unsaid = shown.left_out.clone();
    if shown.sheets.iter().any(|s| s.normals.back.is_some()) {
        unsaid.push("the mapped normals of the back and of transmitted light".into());
    }
    let lost = ExportLoss::new("blender", &coats, &unsaid);
    let mut written = vec![script, glb];
    written.append(&mut textures.written);
    Ok((written, lost))
}

const HEAD: &str = "# A scene by Mesophyll, for Blender 4.2 or later: blender --python scene.py\nimport json\n";

fn value(paint: &TexturePaint) -> Value {
    match paint {
        TexturePaint::Flat(c) => json!(c),
        TexturePaint::File(file) => json!(file),
    }
}

fn one(coat: &ExportCoat, side: Side, textures: &mut TextureWriter) -> Result<Value> {
    let sheet = coat.sheet;
    let of = |k: usize| -> &TargetSide { &coat.coded[k][side] };
    let mut paint = |what: &str, number: &dyn Fn(usize) -> [f64; 3]| -> Result<Value> {
        textures.colour(sheet, &format!("{}_{what}", side.name()), number).map(|p| value(&p))
    };
    let mut out = json!({
        "diffuse": paint("diffuse", &|k| of(k).diffuse)?,
        "through": paint("through", &|k| of(k).through)?,
        "gloss": paint("gloss", &|k| of(k).gloss)?,
        "roughness": paint("roughness", &|k| [of(k).alpha.max(0.0).sqrt(); 3])?,
    });
    if side == Side::Front
        && let Some(normals) = textures.normals(sheet, side)?
    {
        out["normal"] = value(&normals);
    }
    Ok(out)
}
