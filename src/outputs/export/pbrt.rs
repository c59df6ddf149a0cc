//! A scene for pbrt-v4: `scene.pbrt`, meshes as PLY, textures as OpenEXR.
//!
//! A leaf is a `mix` of `diffusetransmission` and a `conductor` whose amount is the gloss. A material of pbrt is the
//! same on both sides, so it is the mean of ours; of a surface with a black back it is the front. The sky's picture is
//! a square of equal areas (Clarberg 2008).

use crate::Result;
use crate::coat::{ExportCoat, ExportLoss, TexturePaint, TextureWriter, coats};
use crate::foreign::target::ExportTarget;
use crate::ply;
use crate::scene::{ExportScene, ExportSky, SkyMap};
use glam::{DMat4, DVec3};
use mesophyll_files::atomic;
use mesophyll_optics::side::Side;
use std::f64::consts::FRAC_PI_4;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Pixels of each side of the sky's picture.
const SKY: usize = 512;

/// Writes the folder; returns its files and what is lost.
///
/// # Errors
/// [`crate::Error::Write`].
pub fn write(shown: &ExportScene, folder: &Path) -> Result<(Vec<PathBuf>, ExportLoss)> {
    let coats = coats(shown, ExportTarget::Pbrt);
    let mut textures = TextureWriter::new(folder);
    let mut text = format!("# mesophyll {}: lengths in mm, z up\n", env!("CARGO_PKG_VERSION"));
    let c = &shown.camera;
    // The field of view is that of the shorter edge. The picture's x runs against that of a right-handed world.
    let half = c.half_height() * (shown.size[0] as f64 / shown.size[1] as f64).min(1.0);
    let three = |v: DVec3| format!("{} {} {}", v.x, v.y, v.z);
    let _ = writeln!(
        text,
        "Scale -1 1 1\nLookAt {}  {}  {}\nCamera \"perspective\" \"float fov\" [ {} ]\nSampler \"zsobol\" \"integer \
         pixelsamples\" [ {} ]\nIntegrator \"volpath\" \"integer maxdepth\" [ 100 ]\nPixelFilter \"box\"\nFilm \"rgb\" \
         \"integer xresolution\" [ {} ] \"integer yresolution\" [ {} ] \"string filename\" \"scene.exr\"\nWorldBegin",
        three(c.eye),
        three(c.target),
        three(c.up),
        2.0 * half.atan().to_degrees(),
        shown.samples,
        shown.size[0],
        shown.size[1]
    );
    light(&mut text, shown, &mut textures)?;
    let mut written = Vec::new();
    for (k, coat) in coats.iter().enumerate() {
        let name = &coat.sheet.name;
        material(&mut text, coat, &mut textures)?;
        let path = folder.join(format!("meshes/{name}.ply"));
        ply::write(&coat.sheet.mesh, &path, true)?;
        written.push(path);
        let alpha = match &coat.sheet.mask {
            Some(mask) => {
                let file = format!("{name}_mask");
                let on = |k: usize| [f32::from(u8::from(mask[k])); 3];
                let paint = textures.picture(&file, coat.sheet.size, on)?;
                texture(&mut text, &file, "float", &paint);
                format!(" \"texture alpha\" \"{file}\"")
            }
            None => String::new(),
        };
        let _ = writeln!(
            text,
            "ObjectBegin \"{name}\"\nNamedMaterial \"{name}\"\nShape \"plymesh\" \"string filename\" \
             \"meshes/{name}.ply\"{alpha}\nObjectEnd"
        );
        for (_, place) in shown.each_place().filter(|(of, _)| *of == k) {
            let _ = writeln!(
                text,
                "AttributeBegin\nConcatTransform [ {} ]\nObjectInstance \"{name}\"\nAttributeEnd",
                columns(&place)
            );
        }
    }
    let mut unsaid = shown.left_out.clone();
    unsaid.extend(shown.unsaid_exposure());
    if coats.iter().any(|coat| coat.leaf) {
        unsaid.push("two sides that differ: a material of pbrt is the same on both, and is the mean".into());
    }
    if shown.sun.is_some() {
        unsaid.push("the sun's disk: its light comes from one direction, so that shadows have no penumbra".into());
    }
    if shown.sheets.iter().any(|s| s.normals.back.is_some()) {
        unsaid.push("the mapped normals of the back: the front's are on both sides".into());
    }
    let lost = ExportLoss::new("pbrt", &coats, &unsaid);
    let scene = folder.join("scene.pbrt");
    atomic::write_bytes(&scene, text.as_bytes())?;
    written.insert(0, scene);
    written.append(&mut textures.written);
    Ok((written, lost))
}

fn columns(m: &DMat4) -> String {
    m.to_cols_array().map(|v| v.to_string()).join(" ")
}

fn light(text: &mut String, shown: &ExportScene, textures: &mut TextureWriter) -> Result<()> {
    if let Some(sun) = &shown.sun {
        let d = sun.direction.normalize();
        let [r, g, b] = sun.irradiance;
        let _ = writeln!(
            text,
            "LightSource \"distant\" \"point3 from\" [ {} {} {} ] \"point3 to\" [ 0 0 0 ] \"rgb L\" [ {r} {g} {b} ]",
            d.x, d.y, d.z
        );
    }
    match &shown.sky {
        ExportSky::None => {}
        ExportSky::Even([r, g, b]) => {
            let _ = writeln!(text, "LightSource \"infinite\" \"rgb L\" [ {r} {g} {b} ]");
        }
        ExportSky::Map(map) => {
            if let TexturePaint::File(file) = textures.picture("sky", [SKY, SKY], |k| square(map, k))? {
                let _ = writeln!(text, "LightSource \"infinite\" \"string filename\" \"{file}\"");
            }
        }
    }
    Ok(())
}

/// The sky in a pixel of the square of equal areas: the mean of 4 × 4 directions.
fn square(map: &SkyMap, k: usize) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for s in 0..16 {
        let at = |pixel: usize, part: usize| 2.0 * (pixel as f64 + (part as f64 + 0.5) / 4.0) / SKY as f64 - 1.0;
        let seen = map.at(direction(at(k % SKY, s % 4), at(k / SKY, s / 4)));
        (0..3).for_each(|c| sum[c] += seen[c] / 16.0);
    }
    sum
}

/// Clarberg's map from the square [−1, 1]² to the sphere.
fn direction(u: f64, v: f64) -> DVec3 {
    let signed = 1.0 - (u.abs() + v.abs());
    let r = 1.0 - signed.abs();
    let phi = if r == 0.0 { FRAC_PI_4 } else { ((v.abs() - u.abs()) / r + 1.0) * FRAC_PI_4 };
    let across = r * (2.0 - r * r).max(0.0).sqrt();
    let z = (1.0 - r * r).copysign(signed);
    DVec3::new((phi.cos() * across).copysign(u), (phi.sin() * across).copysign(v), z)
}

fn texture(text: &mut String, name: &str, kind: &str, paint: &TexturePaint) {
    let _ = match paint {
        TexturePaint::File(file) => writeln!(
            text,
            "Texture \"{name}\" \"{kind}\" \"imagemap\" \"string filename\" \"{file}\" \"string wrap\" \"clamp\""
        ),
        TexturePaint::Flat([v, ..]) if kind == "float" => {
            writeln!(text, "Texture \"{name}\" \"float\" \"constant\" \"float value\" [ {v} ]")
        }
        TexturePaint::Flat([r, g, b]) => {
            writeln!(text, "Texture \"{name}\" \"{kind}\" \"constant\" \"rgb value\" [ {r} {g} {b} ]")
        }
    };
}

fn material(text: &mut String, coat: &ExportCoat, textures: &mut TextureWriter) -> Result<()> {
    let (sheet, name) = (coat.sheet, &coat.sheet.name);
    let of = |k: usize| &coat.coded[k].front;
    let normal = match textures.normals(sheet, Side::Front)? {
        Some(TexturePaint::File(file)) => format!(" \"string normalmap\" \"{file}\""),
        _ => String::new(),
    };
    let mut add = |what: &str, kind: &str, value: &dyn Fn(usize) -> [f64; 3]| -> Result<String> {
        let paint = textures.colour(sheet, what, value)?;
        let full = format!("{name}_{what}");
        texture(text, &full, kind, &paint);
        Ok(full)
    };
    let diffuse = add("diffuse", "spectrum", &|k| of(k).diffuse)?;
    let through = add("through", "spectrum", &|k| of(k).through)?;
    let glossy = coat.most(|c| [c.weight; 3]) > 0.0;
    let gloss = if glossy {
        let colour = add("gloss", "spectrum", &|k| of(k).gloss)?;
        let alpha = add("alpha", "float", &|k| [of(k).alpha; 3])?;
        Some((colour, alpha, add("amount", "float", &|k| [of(k).weight; 3])?))
    } else {
        None
    };
    let matte = if glossy { format!("{name}_matte") } else { name.clone() };
    let _ = writeln!(
        text,
        "MakeNamedMaterial \"{matte}\" \"string type\" \"diffusetransmission\" \"texture reflectance\" \"{diffuse}\" \
         \"texture transmittance\" \"{through}\"{normal}"
    );
    if let Some((colour, alpha, amount)) = gloss {
        let _ = writeln!(
            text,
            "MakeNamedMaterial \"{name}_metal\" \"string type\" \"conductor\" \"texture reflectance\" \"{colour}\" \
             \"texture roughness\" \"{alpha}\" \"bool remaproughness\" false{normal}\nMakeNamedMaterial \"{name}\" \
             \"string type\" \"mix\" \"string materials\" [ \"{matte}\" \"{name}_metal\" ] \"texture amount\" \
             \"{amount}\""
        );
    }
    Ok(())
}
