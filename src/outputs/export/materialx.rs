//! MaterialX with OpenPBR: `leaf.mtlx` and textures as OpenEXR. It is a material, not a scene.
//!
//! The leaf is a thin wall (`geometry_thin_walled`) of which all is `subsurface`: one colour, and one ratio of forward
//! to backward scattering, `subsurface_scatter_anisotropy`. Each side has its own, as `surfaceshader` and
//! `backsurfaceshader`. The specification takes the colour once. The graph of OpenPBR in MaterialX up to 1.39.5 takes
//! it twice (mended in its pull request 3066), so its square root is written for those. Which of them a reader has, the
//! library tells that its search path names.

use crate::Result;
use crate::coat::{ExportCoat, ExportLoss, TexturePaint, TextureWriter, coats};
use crate::foreign::target::{ExportTarget, TargetSide};
use crate::scene::ExportScene;
use mesophyll_files::atomic;
use mesophyll_optics::side::Side;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Variables that name MaterialX's libraries: its own, and OpenUSD's.
const SEARCH_PATHS: [&str; 2] = ["MATERIALX_SEARCH_PATH", "PXR_MTLX_STDLIB_SEARCH_PATHS"];

/// How often a reader's OpenPBR multiplies by the colour of a thin wall.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Taken {
    Once,
    Twice,
}

impl Taken {
    /// That of the first library on the search paths, with its file. Without one, that of the released versions.
    fn of_reader() -> (Taken, Option<PathBuf>) {
        let folders = SEARCH_PATHS.iter().filter_map(std::env::var_os);
        let folders: Vec<PathBuf> = folders.flat_map(|list| std::env::split_paths(&list).collect::<Vec<_>>()).collect();
        let files = folders.iter().flat_map(|folder| {
            ["bxdf", "libraries/bxdf"].map(|below| folder.join(below).join("open_pbr_surface.mtlx"))
        });
        let read = |file: PathBuf| Some((Taken::of_graph(&std::fs::read_to_string(&file).ok()?)?, Some(file)));
        files.into_iter().find_map(read).unwrap_or((Taken::Twice, None))
    }

    /// What a graph of OpenPBR says: the factor of its thin wall's reflection holds the colour, or does not. `None`
    /// where it has no thin wall.
    fn of_graph(text: &str) -> Option<Taken> {
        let wall = text.find("\"subsurface_thin_walled_reflection\"")?;
        let Some(at) = text.find("\"subsurface_thin_walled_brdf_factor\"").filter(|at| *at < wall) else {
            return Some(Taken::Once);
        };
        let node = text[at..].split("</multiply>").next().unwrap_or_default();
        Some(if node.contains("\"subsurface_color") { Taken::Twice } else { Taken::Once })
    }

    /// The number to write for a colour.
    fn coded(self, colour: f64) -> f64 {
        if self == Taken::Twice { colour.sqrt() } else { colour }
    }

    /// For whom the file is.
    fn says(self, library: Option<&Path>) -> String {
        match (self, library) {
            (Taken::Twice, None) => format!(
                "readers whose OpenPBR takes the colour of a thin wall once, as its specification says (MaterialX \
                 beyond 1.39.5): they show the leaf too bright; name their library in {}",
                SEARCH_PATHS[0]
            ),
            (Taken::Twice, Some(file)) => format!(
                "readers whose OpenPBR takes the colour of a thin wall once: the file is for {}, which takes it twice",
                file.display()
            ),
            (Taken::Once, file) => format!(
                "readers whose OpenPBR takes the colour of a thin wall twice (MaterialX up to 1.39.5): the file is for \
                 {}, which takes it once",
                file.map_or("later ones".into(), |f| f.display().to_string())
            ),
        }
    }
}

/// Writes the folder; returns its files and what is lost.
///
/// # Errors
/// [`crate::Error::Write`].
pub fn write(shown: &ExportScene, folder: &Path) -> Result<(Vec<PathBuf>, ExportLoss)> {
    let coats = coats(shown, ExportTarget::OpenPbr);
    let mut textures = TextureWriter::new(folder);
    let mut text = String::from("<?xml version=\"1.0\"?>\n<materialx version=\"1.39\" colorspace=\"lin_rec709\">\n");
    let (taken, library) = Taken::of_reader();
    for coat in &coats {
        material(&mut text, coat, taken, &mut textures)?;
    }
    text.push_str("</materialx>\n");
    let mut unsaid = shown.left_out.clone();
    unsaid.push(taken.says(library.as_deref()));
    unsaid.push("shapes, places, camera and light: the file holds materials, --to usd holds the scene".into());
    let lost = ExportLoss::new("materialx", &coats, &unsaid);
    let path = folder.join("leaf.mtlx");
    atomic::write_bytes(&path, text.as_bytes())?;
    let mut written = vec![path];
    written.append(&mut textures.written);
    Ok((written, lost))
}

/// An input with a value, or with a picture that is declared in `nodes`.
fn input(nodes: &mut String, name: &str, input: &str, kind: &str, paint: &TexturePaint) -> String {
    match paint {
        TexturePaint::Flat([v, ..]) if kind == "float" => {
            format!("    <input name=\"{input}\" type=\"float\" value=\"{v}\" />\n")
        }
        TexturePaint::Flat([r, g, b]) => {
            format!("    <input name=\"{input}\" type=\"{kind}\" value=\"{r}, {g}, {b}\" />\n")
        }
        TexturePaint::File(file) => {
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

fn material(text: &mut String, coat: &ExportCoat, taken: Taken, textures: &mut TextureWriter) -> Result<()> {
    let sheet = coat.sheet;
    for side in Side::ALL {
        let of = |k: usize| -> &TargetSide { &coat.coded[k][side] };
        let name = format!("{}_{}", sheet.name, side.name());
        let what = |w: &str| format!("{}_{w}", side.name());
        let (mut nodes, mut inputs) = (String::new(), String::new());
        let colour = textures.colour(sheet, &what("subsurface"), |k| of(k).diffuse.map(|c| taken.coded(c)))?;
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Graphs of the two kinds, as short as they can be.
    #[test]
    fn a_graph_says_how_often_it_takes_the_colour() {
        let graph = |factor: &str| {
            format!(
                "<nodegraph><multiply name=\"subsurface_thin_walled_brdf_factor\" type=\"color3\">\n<input \
                 name=\"in1\" type=\"color3\" {factor} /></multiply><multiply \
                 name=\"subsurface_thin_walled_reflection\" type=\"BSDF\"><input interfacename=\"subsurface_color\" \
                 /></multiply></nodegraph>"
            )
        };
        assert_eq!(Taken::of_graph(&graph("interfacename=\"subsurface_color\"")), Some(Taken::Twice));
        assert_eq!(Taken::of_graph(&graph("nodename=\"one_minus_anisotropy\"")), Some(Taken::Once));
        let plain = "<multiply name=\"subsurface_thin_walled_reflection\"></multiply>";
        assert_eq!(Taken::of_graph(plain), Some(Taken::Once));
        assert_eq!(Taken::of_graph("<materialx />"), None);
        assert_eq!((Taken::Twice.coded(0.25), Taken::Once.coded(0.25)), (0.5, 0.25));
    }
}
