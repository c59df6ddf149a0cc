//! MaterialX with OpenPBR: `leaf.mtlx` and textures as OpenEXR. It is a material, not a scene.
//!
//! The leaf is a thin wall (`geometry_thin_walled`) of which all is `subsurface`: one colour, and one ratio of forward
//! to backward scattering, `subsurface_scatter_anisotropy`. Each side has its own, as `surfaceshader` and
//! `backsurfaceshader`. In the reference graph of OpenPBR the colour enters twice, so its square root is written.

use crate::Result;
use crate::coat::{Coat, Lost, Paint, Textures, coats};
use crate::shown::Shown;
use mesophyll_files::atomic;
use mesophyll_foreign::target::{Coded, Target};
use mesophyll_optics::side::Side;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Writes the folder; returns its files and what is lost.
///
/// # Errors
/// [`crate::Error::Write`].
pub fn write(shown: &Shown, folder: &Path) -> Result<(Vec<PathBuf>, Lost)> {
    let coats = coats(shown, Target::OpenPbr);
    let mut textures = Textures::new(folder);
    let mut text = String::from("<?xml version=\"1.0\"?>\n<materialx version=\"1.39\" colorspace=\"lin_rec709\">\n");
    for coat in &coats {
        material(&mut text, coat, &mut textures)?;
    }
    text.push_str("</materialx>\n");
    let mut unsaid = shown.left_out.clone();
    unsaid.push("shapes, places, camera and light: the file holds materials, --to usd holds the scene".into());
    let lost = Lost::new("materialx", &coats, &unsaid);
    let path = folder.join("leaf.mtlx");
    atomic::write_bytes(&path, text.as_bytes())?;
    let mut written = vec![path];
    written.append(&mut textures.written);
    Ok((written, lost))
}

/// An input with a value, or with a picture that is declared in `nodes`.
fn input(nodes: &mut String, name: &str, input: &str, kind: &str, paint: &Paint) -> String {
    match paint {
        Paint::Flat([v, ..]) if kind == "float" => {
            format!("    <input name=\"{input}\" type=\"float\" value=\"{v}\" />\n")
        }
        Paint::Flat([r, g, b]) => {
            format!("    <input name=\"{input}\" type=\"{kind}\" value=\"{r}, {g}, {b}\" />\n")
        }
        Paint::File(file) => {
            let node = format!("{name}_{input}");
            let read = if kind == "float" { "color3" } else { kind };
            let picture = if read == kind { node.clone() } else { format!("{node}_picture") };
            let _ = writeln!(
                nodes,
                "  <image name=\"{picture}\" type=\"{read}\">\n    <input name=\"file\" type=\"filename\" \
                 value=\"{file}\" />\n    <input name=\"uaddressmode\" type=\"string\" value=\"clamp\" />\n    <input \
                 name=\"vaddressmode\" type=\"string\" value=\"clamp\" />\n  </image>"
            );
            if picture != node {
                let _ = writeln!(
                    nodes,
                    "  <extract name=\"{node}\" type=\"float\">\n    <input name=\"in\" type=\"color3\" \
                     nodename=\"{picture}\" />\n    <input name=\"index\" type=\"integer\" value=\"0\" />\n  </extract>"
                );
            }
            format!("    <input name=\"{input}\" type=\"{kind}\" nodename=\"{node}\" />\n")
        }
    }
}

fn material(text: &mut String, coat: &Coat, textures: &mut Textures) -> Result<()> {
    let sheet = coat.sheet;
    for side in Side::ALL {
        let of = |k: usize| -> &Coded { &coat.coded[k][side] };
        let name = format!("{}_{}", sheet.name, side.name());
        let what = |w: &str| format!("{}_{w}", side.name());
        let (mut nodes, mut inputs) = (String::new(), String::new());
        let colour = textures.colour(sheet, &what("subsurface"), |k| of(k).diffuse)?;
        let ratio = textures.colour(sheet, &what("anisotropy"), |k| [of(k).share; 3])?;
        inputs += &input(&mut nodes, &name, "subsurface_color", "color3", &colour);
        inputs += &input(&mut nodes, &name, "subsurface_scatter_anisotropy", "float", &ratio);
        inputs += "    <input name=\"subsurface_weight\" type=\"float\" value=\"1\" />\n    <input \
                   name=\"geometry_thin_walled\" type=\"boolean\" value=\"true\" />\n";
        match coat.coder.index() {
            Some(index) => {
                let gloss = textures.colour(sheet, &what("gloss"), |k| of(k).gloss)?;
                let roughness = textures.colour(sheet, &what("roughness"), |k| [of(k).alpha.sqrt(); 3])?;
                inputs += &format!("    <input name=\"specular_ior\" type=\"float\" value=\"{index}\" />\n");
                inputs += &input(&mut nodes, &name, "specular_color", "color3", &gloss);
                inputs += &input(&mut nodes, &name, "specular_roughness", "float", &roughness);
            }
            None => inputs += "    <input name=\"specular_weight\" type=\"float\" value=\"0\" />\n",
        }
        if let Some(normals) = textures.normals(sheet, side)? {
            inputs += &input(&mut nodes, &name, "geometry_normal", "vector3", &normals);
            // The picture is decoded by a node between it and the input.
            let node = format!("{name}_geometry_normal");
            let _ = writeln!(
                nodes,
                "  <normalmap name=\"{node}_mapped\" type=\"vector3\">\n    <input name=\"in\" type=\"vector3\" \
                 nodename=\"{node}\" />\n  </normalmap>"
            );
            inputs = inputs.replace(&format!("nodename=\"{node}\""), &format!("nodename=\"{node}_mapped\""));
        }
        let _ = writeln!(
            text,
            "{nodes}  <open_pbr_surface name=\"{name}\" type=\"surfaceshader\">\n{inputs}  </open_pbr_surface>"
        );
    }
    let _ = writeln!(
        text,
        "  <surfacematerial name=\"{0}\" type=\"material\">\n    <input name=\"surfaceshader\" type=\"surfaceshader\" \
         nodename=\"{0}_front\" />\n    <input name=\"backsurfaceshader\" type=\"surfaceshader\" \
         nodename=\"{0}_back\" />\n  </surfacematerial>",
        sheet.name
    );
    Ok(())
}
