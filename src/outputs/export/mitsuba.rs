//! A scene for Mitsuba 3: `scene.xml`, meshes as PLY, textures as OpenEXR.
//!
//! A leaf is composed of plugins: `blendbsdf` of `principledthin` with `diff_trans` 2, which is matte transmission and
//! nothing else, and of `twosided` with a `blendbsdf` of `diffuse` and `roughconductor` on each side. A blend has
//! weights that sum to 1, so every colour is divided by its constant weight; their sum is ours. The metal without
//! material (`none`) has no Fresnel factor, as our lobes; a Cook–Torrance lobe is a metal with k = 0, whose Fresnel
//! factor is the dielectric's.

use crate::Result;
use crate::coat::{ExportCoat, ExportLoss, TexturePaint, TextureWriter, coats};
use crate::foreign::micro::SlopeDistribution;
use crate::foreign::target::{ExportTarget, TargetSide};
use crate::ply;
use crate::scene::{ExportScene, ExportSky};
use glam::DMat4;
use mesophyll_files::atomic;
use mesophyll_optics::side::Side;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Writes the folder; returns its files and what is lost.
///
/// # Errors
/// [`crate::Error::Write`].
pub fn write(shown: &ExportScene, folder: &Path) -> Result<(Vec<PathBuf>, ExportLoss)> {
    let coats = coats(shown, ExportTarget::Mitsuba);
    let mut textures = TextureWriter::new(folder);
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<scene version=\"3.0.0\">\n");
    let _ = writeln!(
        text,
        "  <!-- {} by mesophyll {}: lengths in mm, z up -->",
        shown.name.replace("--", "-"),
        env!("CARGO_PKG_VERSION")
    );
    camera(&mut text, shown);
    light(&mut text, shown, &mut textures)?;
    let mut meshes = Vec::new();
    for coat in &coats {
        material(&mut text, coat, &mut textures)?;
        let path = folder.join(format!("meshes/{}.ply", coat.sheet.name));
        ply::write(&coat.sheet.mesh, &path, false)?;
        meshes.push(path);
    }
    places(&mut text, shown);
    text.push_str("</scene>\n");
    let mut unsaid = shown.left_out.clone();
    unsaid.extend(shown.unsaid_exposure());
    if shown.sun.is_some() {
        unsaid.push("the sun's disk: its light comes from one direction, so that shadows have no penumbra".into());
    }
    if shown.sheets.iter().any(|s| s.normals.iter().any(|(_, n)| n.is_some())) {
        unsaid.push("the mapped normals of transmitted light, which leaves by the mesh's own".into());
    }
    let lost = ExportLoss::new("mitsuba", &coats, &unsaid);
    let scene = folder.join("scene.xml");
    atomic::write_bytes(&scene, text.as_bytes())?;
    let mut written = vec![scene];
    written.extend(meshes);
    written.append(&mut textures.written);
    Ok((written, lost))
}

fn three(v: [f64; 3]) -> String {
    format!("{}, {}, {}", v[0], v[1], v[2])
}

fn camera(text: &mut String, shown: &ExportScene) {
    let c = &shown.camera;
    let _ = write!(
        text,
        "  <integrator type=\"path\"><integer name=\"max_depth\" value=\"-1\"/></integrator>\n  \
         <sensor type=\"perspective\">\n    <string name=\"fov_axis\" value=\"y\"/>\n    \
         <float name=\"fov\" value=\"{}\"/>\n    <float name=\"near_clip\" value=\"0.1\"/>\n    \
         <float name=\"far_clip\" value=\"1e7\"/>\n    <transform name=\"to_world\"><lookat origin=\"{}\" \
         target=\"{}\" up=\"{}\"/></transform>\n    <sampler type=\"independent\"><integer name=\"sample_count\" \
         value=\"{}\"/></sampler>\n    <film type=\"hdrfilm\"><integer name=\"width\" value=\"{}\"/>\
         <integer name=\"height\" value=\"{}\"/><string name=\"pixel_format\" value=\"rgb\"/>\
         <string name=\"component_format\" value=\"float32\"/><rfilter type=\"box\"/></film>\n  </sensor>\n",
        c.fov_y_deg,
        three(c.eye.to_array()),
        three(c.target.to_array()),
        three(c.up.to_array()),
        shown.samples,
        shown.size[0],
        shown.size[1],
    );
}

fn light(text: &mut String, shown: &ExportScene, textures: &mut TextureWriter) -> Result<()> {
    if let Some(sun) = &shown.sun {
        let _ = writeln!(
            text,
            "  <emitter type=\"directional\"><vector name=\"direction\" value=\"{}\"/>\
             <rgb name=\"irradiance\" value=\"{}\"/></emitter>",
            three((-sun.direction.normalize()).to_array()),
            three(sun.irradiance)
        );
    }
    match &shown.sky {
        ExportSky::None => {}
        ExportSky::Even(radiance) => {
            let _ = writeln!(
                text,
                "  <emitter type=\"constant\"><rgb name=\"radiance\" value=\"{}\"/></emitter>",
                three(*radiance)
            );
        }
        ExportSky::Map(map) => {
            // The first column of the plugin's picture looks to +x.
            if let TexturePaint::File(file) =
                textures.picture("sky", map.size, |k| map.from_column(map.size[0] / 2, k))?
            {
                let _ = writeln!(
                    text,
                    "  <emitter type=\"envmap\"><string name=\"filename\" value=\"{file}\"/><transform \
                     name=\"to_world\"><matrix value=\"0 0 -1 0  -1 0 0 0  0 1 0 0  0 0 0 1\"/></transform></emitter>"
                );
            }
        }
    }
    Ok(())
}

/// A colour or a picture under a name.
fn paint(name: &str, paint: &TexturePaint) -> String {
    match paint {
        TexturePaint::Flat(c) => format!("<rgb name=\"{name}\" value=\"{}\"/>", three(*c)),
        TexturePaint::File(file) => bitmap(name, file),
    }
}

fn bitmap(name: &str, file: &str) -> String {
    format!(
        "<texture type=\"bitmap\" name=\"{name}\"><string name=\"filename\" value=\"{file}\"/>\
         <boolean name=\"raw\" value=\"true\"/><string name=\"wrap_mode\" value=\"clamp\"/></texture>"
    )
}

/// The plugins refuse a colour above 1 but take it from a raw picture.
fn within(paint: TexturePaint, textures: &mut TextureWriter, name: &str) -> Result<TexturePaint> {
    match paint {
        TexturePaint::Flat(c) if c.iter().any(|v| *v > 1.0) => textures.picture(name, [1, 1], |_| c.map(|v| v as f32)),
        other => Ok(other),
    }
}

/// Shares of transmission, and of gloss in what is reflected.
fn weights(coat: &ExportCoat) -> [f64; 2] {
    let [t, d, s] = [coat.most(|c| c.through), coat.most(|c| c.diffuse), coat.most(|c| c.gloss)];
    let share = |a: f64, b: f64| if a > 0.0 { a / (a + b) } else { 0.0 };
    [share(t, d + s), share(s, d)]
}

fn material(text: &mut String, coat: &ExportCoat, textures: &mut TextureWriter) -> Result<()> {
    let [through, gloss] = weights(coat);
    let sheet = coat.sheet;
    let one = |side: Side, textures: &mut TextureWriter| -> Result<String> {
        let of = |k: usize| -> &TargetSide { &coat.coded[k][side] };
        let name = |what: &str| format!("{}_{what}", side.name());
        let left = 1.0 - through;
        let scaled = |c: [f64; 3], by: f64| if by > 0.0 { c.map(|v| v / by) } else { c };
        let diffuse = textures.colour(sheet, &name("diffuse"), |k| scaled(of(k).diffuse, left * (1.0 - gloss)))?;
        let diffuse = within(diffuse, textures, &format!("{}_{}", sheet.name, name("diffuse")))?;
        let mut bsdf = format!("<bsdf type=\"diffuse\">{}</bsdf>", paint("reflectance", &diffuse));
        if gloss > 0.0 {
            let colour = textures.colour(sheet, &name("gloss"), |k| scaled(of(k).gloss, left * gloss))?;
            let colour = within(colour, textures, &format!("{}_{}", sheet.name, name("gloss")))?;
            let alpha = match textures.colour(sheet, &name("alpha"), |k| [of(k).alpha; 3])? {
                TexturePaint::Flat([a, ..]) => format!("<float name=\"alpha\" value=\"{a}\"/>"),
                TexturePaint::File(file) => bitmap("alpha", &file),
            };
            let slopes = SlopeDistribution::of(sheet.lobe()).name();
            let metal = match coat.coder.index() {
                Some(n) => format!("<spectrum name=\"eta\" value=\"{n}\"/><spectrum name=\"k\" value=\"0\"/>"),
                None => "<string name=\"material\" value=\"none\"/>".into(),
            };
            bsdf = format!(
                "<bsdf type=\"blendbsdf\"><float name=\"weight\" value=\"{gloss}\"/>{bsdf}<bsdf \
                 type=\"roughconductor\"><string name=\"distribution\" \
                     value=\"{slopes}\"/>{metal}{alpha}{}</bsdf></bsdf>",
                paint("specular_reflectance", &colour)
            );
        }
        Ok(match textures.normals(sheet, side)? {
            Some(TexturePaint::File(file)) => format!(
                "<bsdf type=\"normalmap\"><boolean name=\"use_shadowing_function\" value=\"false\"/>{}{bsdf}</bsdf>",
                bitmap("normalmap", &file)
            ),
            _ => bsdf,
        })
    };
    let mut bsdf =
        format!("<bsdf type=\"twosided\">{}{}</bsdf>", one(Side::Front, textures)?, one(Side::Back, textures)?);
    if through > 0.0 {
        let colour = textures.colour(sheet, "through", |k| coat.coded[k].front.through.map(|v| v / through))?;
        let colour = within(colour, textures, &format!("{}_through", sheet.name))?;
        bsdf = format!(
            "<bsdf type=\"blendbsdf\"><float name=\"weight\" value=\"{through}\"/>{bsdf}<bsdf \
             type=\"principledthin\"><float name=\"diff_trans\" value=\"2\"/><float name=\"spec_trans\" \
             value=\"0\"/>{}</bsdf></bsdf>",
            paint("base_color", &colour)
        );
    }
    if let Some(mask) = &sheet.mask {
        let on =
            textures.picture(&format!("{}_mask", sheet.name), sheet.size, |k| [f32::from(u8::from(mask[k])); 3])?;
        if let TexturePaint::File(file) = on {
            bsdf = format!("<bsdf type=\"mask\">{}{bsdf}</bsdf>", bitmap("opacity", &file));
        }
    }
    // The outermost plugin gets the name.
    let named = bsdf.replacen("<bsdf ", &format!("<bsdf id=\"m_{}\" ", sheet.name), 1);
    let _ = writeln!(text, "  {named}");
    Ok(())
}

fn matrix(m: &DMat4) -> String {
    let rows: Vec<String> = (0..4)
        .map(|r| {
            let row = m.row(r);
            format!("{} {} {} {}", row.x, row.y, row.z, row.w)
        })
        .collect();
    format!("<transform name=\"to_world\"><matrix value=\"{}\"/></transform>", rows.join("  "))
}

fn places(text: &mut String, shown: &ExportScene) {
    let shape = |name: &str| {
        format!("<shape type=\"ply\"><string name=\"filename\" value=\"meshes/{name}.ply\"/><ref id=\"m_{name}\"/>")
    };
    for (k, sheet) in shown.sheets.iter().enumerate() {
        let places: Vec<DMat4> = shown.each_place().filter(|(of, _)| *of == k).map(|(_, m)| m).collect();
        if let [place] = places.as_slice() {
            let _ = writeln!(text, "  {}{}</shape>", shape(&sheet.name), matrix(place));
            continue;
        }
        let _ = writeln!(
            text,
            "  <shape type=\"shapegroup\" id=\"g_{0}\">{1}</shape></shape>",
            sheet.name,
            shape(&sheet.name)
        );
        for place in &places {
            let _ =
                writeln!(text, "  <shape type=\"instance\"><ref id=\"g_{}\"/>{}</shape>", sheet.name, matrix(place));
        }
    }
}
