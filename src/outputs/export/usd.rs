//! OpenUSD text with UsdPreviewSurface: `scene.usda` and textures as OpenEXR.
//!
//! UsdPreviewSurface has one side and transmits nothing; the front's colours are on both sides. v runs upwards.

use crate::Result;
use crate::coat::{ExportCoat, ExportLoss, TexturePaint, TextureWriter, coats};
use crate::foreign::target::ExportTarget;
use crate::scene::{ExportScene, ExportSky};
use glam::{DMat4, DVec3};
use mesophyll_files::atomic;
use mesophyll_optics::side::Side;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Writes the folder; returns its files and what is lost.
///
/// # Errors
/// [`crate::Error::Write`].
pub fn write(shown: &ExportScene, folder: &Path) -> Result<(Vec<PathBuf>, ExportLoss)> {
    let coats = coats(shown, ExportTarget::Usd);
    let mut textures = TextureWriter::new(folder);
    let mut text = String::from(
        r#"#usda 1.0
(
    defaultPrim = "World"
    metersPerUnit = 0.001
    upAxis = "Z"
)

class Scope "Sheets"
{
"#,
    );
    for coat in &coats {
        sheet(&mut text, coat, &mut textures)?;
    }
    text.push_str("}\n\ndef Xform \"World\"\n{\n");
    for (k, (of, place)) in shown.places.iter().enumerate() {
        let name = &shown.sheets[*of].name;
        let _ = writeln!(
            text,
            r#"    def Xform "{name}_{k}" (
        instanceable = true
        references = </Sheets/{name}>
    )
    {{
{}    }}"#,
            transform(place)
        );
    }
    stands(&mut text, shown);
    lights(&mut text, shown, &mut textures)?;
    text.push_str("}\n");
    let mut unsaid = shown.left_out.clone();
    unsaid.push("transmitted light, and the back: the front's colours are on both sides".into());
    unsaid.push(
        "what renderers of UsdPreviewSurface do otherwise: the errors are those of GGX with Smith's masking and \
         Schlick's Fresnel factor, and none was compared"
            .into(),
    );
    let lost = ExportLoss::new("usd", &coats, &unsaid);
    let path = folder.join("scene.usda");
    atomic::write_bytes(&path, text.as_bytes())?;
    let mut written = vec![path];
    written.append(&mut textures.written);
    Ok((written, lost))
}

/// Plants that stand in many places: a point instancer, whose prototypes are plants, which are point instancers of
/// sheets themselves.
fn stands(text: &mut String, shown: &ExportScene) {
    let standing: Vec<_> = shown.standing().collect();
    if standing.is_empty() {
        return;
    }
    let places = standing.iter().enumerate().flat_map(|(k, (_, places))| places.iter().map(move |place| (k, *place)));
    let names: Vec<String> = (0..standing.len()).map(|k| format!("plant_{k}")).collect();
    text.push_str("    def PointInstancer \"Stand\"\n    {\n");
    points(text, "        ", &places.collect::<Vec<_>>(), &names);
    text.push_str("        def Scope \"Prototypes\"\n        {\n");
    for ((group, _), name) in standing.iter().zip(&names) {
        // The sheets that this plant has, and the number of each among them.
        let mut sheets: Vec<usize> = group.iter().map(|(sheet, _)| *sheet).collect();
        sheets.sort_unstable();
        sheets.dedup();
        let number = |sheet: usize| sheets.partition_point(|of| *of < sheet);
        let leaves: Vec<(usize, DMat4)> = group.iter().map(|(sheet, place)| (number(*sheet), *place)).collect();
        let parts: Vec<String> = sheets.iter().map(|sheet| shown.sheets[*sheet].name.clone()).collect();
        let _ = writeln!(text, "            def PointInstancer \"{name}\"\n            {{");
        points(text, "                ", &leaves, &parts);
        text.push_str("                def Scope \"Prototypes\"\n                {\n");
        for part in &parts {
            let head = format!(
                "def Xform \"{part}\" (\n    instanceable = true\n    references = </Sheets/{part}>\n)\n{{\n}}"
            );
            head.lines().for_each(|line| text.extend(["                    ", line, "\n"]));
        }
        text.push_str("                }\n            }\n");
    }
    text.push_str("        }\n    }\n");
}

/// The attributes of a point instancer: the number of a prototype and its place, for each point. Older readers take the
/// turns in half precision, newer ones in single precision.
fn points(text: &mut String, indent: &str, places: &[(usize, DMat4)], prototypes: &[String]) {
    let parts: Vec<_> = places.iter().map(|(_, place)| place.to_scale_rotation_translation()).collect();
    let three = |v: DVec3| format!("({}, {}, {})", v.x as f32, v.y as f32, v.z as f32);
    let turns = list(&parts, |(_, q, _)| format!("({}, {}, {}, {})", q.w as f32, q.x as f32, q.y as f32, q.z as f32));
    let lines = [
        format!("rel prototypes = [{}]", list(prototypes, |name| format!("<Prototypes/{name}>"))),
        format!("int[] protoIndices = [{}]", list(places, |(k, _)| k.to_string())),
        format!("point3f[] positions = [{}]", list(&parts, |(_, _, at)| three(*at))),
        format!("quath[] orientations = [{turns}]"),
        format!("quatf[] orientationsf = [{turns}]"),
        format!("float3[] scales = [{}]", list(&parts, |(scale, _, _)| three(*scale))),
    ];
    lines.iter().for_each(|line| text.extend([indent, line.as_str(), "\n"]));
}

/// A transform; USD multiplies row vectors, so its rows are our columns.
fn transform(m: &DMat4) -> String {
    let row = |c: usize| {
        let v = m.col(c);
        format!("({}, {}, {}, {})", v.x, v.y, v.z, v.w)
    };
    format!(
        r#"        matrix4d xformOp:transform = ( {}, {}, {}, {} )
        uniform token[] xformOpOrder = ["xformOp:transform"]
"#,
        row(0),
        row(1),
        row(2),
        row(3)
    )
}

fn list<T>(values: impl IntoIterator<Item = T>, shown: impl Fn(T) -> String) -> String {
    values.into_iter().map(shown).collect::<Vec<_>>().join(", ")
}

fn sheet(text: &mut String, coat: &ExportCoat, textures: &mut TextureWriter) -> Result<()> {
    let (sheet, mesh) = (coat.sheet, &coat.sheet.mesh);
    let three = |v: &[f32; 3]| format!("({}, {}, {})", v[0], v[1], v[2]);
    let _ = writeln!(
        text,
        r#"    def Xform "{}"
    {{
        def Mesh "Mesh" (
            prepend apiSchemas = ["MaterialBindingAPI"]
        )
        {{
            uniform bool doubleSided = 1
            uniform token subdivisionScheme = "none"
            int[] faceVertexCounts = [{}]
            int[] faceVertexIndices = [{}]
            point3f[] points = [{}]
            normal3f[] normals = [{}] (
                interpolation = "vertex"
            )
            texCoord2f[] primvars:st = [{}] (
                interpolation = "vertex"
            )
            rel material:binding = <../Material>
        }}"#,
        sheet.name,
        list(mesh.indices.chunks_exact(3), |_| "3".into()),
        list(&mesh.indices, u32::to_string),
        list(&mesh.positions, three),
        list(&mesh.normals, three),
        list(&mesh.uvs, |t| format!("({}, {})", t[0], 1.0 - t[1])),
    );
    let of = |k: usize| &coat.coded[k].front;
    let mut inputs = String::from("                int inputs:useSpecularWorkflow = 1\n");
    let mut nodes = String::new();
    let mut add = |input: &str, kind: &str, paint: &TexturePaint, decode: bool| {
        let _ = match paint {
            TexturePaint::Flat([v, ..]) if kind == "float" => {
                writeln!(inputs, "                float inputs:{input} = {v}")
            }
            TexturePaint::Flat([r, g, b]) => {
                writeln!(inputs, "                {kind} inputs:{input} = ({r}, {g}, {b})")
            }
            TexturePaint::File(file) => {
                let output = if kind == "float" { "r" } else { "rgb" };
                let scale = if decode {
                    "                float4 inputs:scale = (2, 2, 2, 1)
                float4 inputs:bias = (-1, -1, -1, 0)
"
                } else {
                    ""
                };
                let out = if kind == "float" { "float outputs:r" } else { "float3 outputs:rgb" };
                let _ = writeln!(
                    nodes,
                    r#"            def Shader "{input}"
            {{
                uniform token info:id = "UsdUVTexture"
                asset inputs:file = @{file}@
                token inputs:sourceColorSpace = "raw"
                token inputs:wrapS = "clamp"
                token inputs:wrapT = "clamp"
{scale}                float2 inputs:st.connect = <../st.outputs:result>
                {out}
            }}"#
                );
                writeln!(inputs, "                {kind} inputs:{input}.connect = <../{input}.outputs:{output}>")
            }
        };
    };
    add("diffuseColor", "color3f", &textures.colour(sheet, "diffuse", |k| of(k).diffuse)?, false);
    add("specularColor", "color3f", &textures.colour(sheet, "gloss", |k| of(k).gloss)?, false);
    let roughness = textures.colour(sheet, "roughness", |k| [of(k).alpha.max(0.0).sqrt(); 3])?;
    add("roughness", "float", &roughness, false);
    if let Some(normals) = textures.normals(sheet, Side::Front)? {
        add("normal", "normal3f", &normals, true);
    }
    if let Some(mask) = &sheet.mask {
        let on = |k: usize| [f32::from(u8::from(mask[k])); 3];
        add("opacity", "float", &textures.picture(&format!("{}_mask", sheet.name), sheet.size, on)?, false);
    }
    let _ = writeln!(
        text,
        r#"        def Material "Material"
        {{
            token outputs:surface.connect = <Surface.outputs:surface>
            def Shader "Surface"
            {{
                uniform token info:id = "UsdPreviewSurface"
{inputs}                token outputs:surface
            }}
            def Shader "st"
            {{
                uniform token info:id = "UsdPrimvarReader_float2"
                string inputs:varname = "st"
                float2 outputs:result
            }}
{nodes}        }}
    }}"#
    );
    Ok(())
}

fn lights(text: &mut String, shown: &ExportScene, textures: &mut TextureWriter) -> Result<()> {
    let c = &shown.camera;
    // The picture is 24 mm high, in tenths of a scene unit.
    let (height, aspect) = (24.0, shown.size[0] as f64 / shown.size[1] as f64);
    let focal = 0.5 * height / c.half_height();
    let _ = writeln!(
        text,
        r#"    def Camera "Camera"
    {{
        float focalLength = {focal}
        float horizontalAperture = {}
        float verticalAperture = {height}
        float2 clippingRange = (1, 1e7)
        float exposure = {}
{}    }}"#,
        height * aspect,
        shown.stops(),
        transform(&crate::gltf::looking(c.eye, c.target, c.up))
    );
    if let Some(sun) = &shown.sun {
        let [r, g, b] = sun.irradiance;
        let toward = sun.direction.normalize();
        let up = if toward.z.abs() < 0.9 { DVec3::Z } else { DVec3::X };
        let _ = writeln!(
            text,
            r#"    def DistantLight "Sun"
    {{
        float inputs:angle = {}
        bool inputs:normalize = 1
        float inputs:intensity = 1
        color3f inputs:color = ({r}, {g}, {b})
{}    }}"#,
            2.0 * sun.radius.to_degrees(),
            transform(&crate::gltf::looking(DVec3::ZERO, -toward, up))
        );
    }
    let file = match &shown.sky {
        ExportSky::None => return Ok(()),
        ExportSky::Even([r, g, b]) => format!("        color3f inputs:color = ({r}, {g}, {b})\n"),
        // The first column of OpenEXR's panoramas looks to +y, a quarter turn after ours.
        ExportSky::Map(map) => match textures.picture("sky", map.size, |k| map.from_column(map.size[0] / 4, k))? {
            TexturePaint::File(file) => format!(
                "        asset inputs:texture:file = @{file}@\n        token inputs:texture:format = \"latlong\"\n"
            ),
            TexturePaint::Flat(_) => String::new(),
        },
    };
    let turn = DMat4::from_rotation_x(std::f64::consts::FRAC_PI_2);
    let _ = writeln!(
        text,
        "    def DomeLight \"Sky\"\n    {{\n        float inputs:intensity = 1\n{file}{}    }}",
        transform(&turn)
    );
    Ok(())
}
