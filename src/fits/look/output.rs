//! The folder of a look: the files that a fit of a leaf leaves, and a record that names all that is stated.

use super::texels::Texels;
use super::{GreenConvention, Look, SLOPE, THICKNESS_MM};
use crate::leaf::blade::{TexelGrid, glb, mesh};
use crate::leaf_folder::{BLADE, LeafFitFile, previews};
use crate::record::{FitParameter, FitRecord, RecordSection, STATED};
use crate::{Error, Result};
use mesophyll_base::rgb::Rgb;
use mesophyll_files::hash;
use mesophyll_files::image::{ChannelMaps, Packing, write_exr};
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::side::{Side, mirror};
use std::path::{Path, PathBuf};

/// Writes maps and blade, and says in the record what they are.
///
/// # Errors
/// Files that cannot be written; an outline too small for a mesh.
pub(super) fn write(out: &Path, look: &Look, name: &str, found: &Texels, record: &mut FitRecord) -> Result<()> {
    describe(look, found, record);
    let mut names = Vec::new();
    for side in Side::ALL {
        let values = maps(look, found, side);
        write_exr(&LeafFitFile::Maps.path(out, side), &values, Packing::Zip)?;
        previews::write(out, side, &values)?;
        record.sections.insert(side.name().into(), section(look, found));
        names.push(LeafFitFile::Maps.name(side));
    }
    let grid = TexelGrid { width: found.width, height: found.height, texel: found.texel_mm };
    let through: Vec<Rgb<f32>> = found.cover.iter().map(|c| Rgb::splat(1.0 - c)).collect();
    let flat = vec![Some([0.0; 2]); found.on.len()];
    let Some(blade) = mesh::build(&grid, &found.on, Some(&through), &flat) else {
        return Err(Error::input(&look.albedo, "the outline is too small for a mesh; expected the shape of a leaf"));
    };
    glb::write(&out.join(BLADE), name, &blade)?;
    let figures = [("blade_area_mm2", blade.area), ("blade_vertices", blade.positions.len() as f64)];
    let figures = figures.map(|(n, v)| (n.to_string(), v)).into_iter().collect();
    record.sections.insert("blade".into(), RecordSection { figures, ..RecordSection::default() });
    names.push(BLADE.into());
    for name in names {
        record.files.insert(name.clone(), hash::file(&out.join(&name))?);
    }
    Ok(())
}

/// What is stated, by name and with its value; nothing of it was measured.
fn describe(look: &Look, found: &Texels, record: &mut FitRecord) {
    let mut say = |name: &str, text: String| record.options.insert(name.into(), text);
    let named = |path: &PathBuf| path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let curve =
        serde_json::to_value(found.transfer).ok().and_then(|v| v.as_str().map(String::from)).unwrap_or_default();
    let whose = if look.transfer.is_some() { "as stated" } else { "as its file says" };
    let albedo = named(&look.albedo);
    let mut state = |name: &str, text: String| say(name, format!("{STATED}{text}"));
    state("rho_d_front", format!("the colours of {albedo}, taken for diffuse reflectance; curve {curve}, {whose}"));
    state(
        "rho_d_back",
        look.back.as_ref().map_or("taken from the front".into(), |p| format!("the colours of {}", named(p))),
    );
    let factor = look.rho_t_factor.unwrap_or(1.0);
    let through = look.translucency.as_ref().map_or("the front's rho_d".into(), named);
    state("rho_t", format!("{factor:?} times {through}, the same from both sides"));
    let default = |given: bool| if given { "" } else { " (nobody stated it: the program's default)" };
    state(
        "gloss",
        match look.rho_s {
            None => "none: the leaf is matte".into(),
            Some(rho_s) => {
                format!("rho_s {rho_s:?}, slope m {:?}{}", look.m.unwrap_or(SLOPE), default(look.m.is_some()))
            }
        },
    );
    state(
        "normal",
        match (&look.normal, look.green) {
            (Some(path), Some(green)) => {
                let way = if green == GreenConvention::Opengl { "up (opengl)" } else { "down (directx)" };
                format!("{}, green counts {way}; the back has the front's bumps as dents", named(path))
            }
            _ => "flat".into(),
        },
    );
    let thickness = look.thickness_mm.unwrap_or(THICKNESS_MM);
    state("thickness", format!("{thickness:?} mm{}", default(look.thickness_mm.is_some())));
    let opacity = look.opacity.as_ref().map_or(albedo, named);
    state("outline", format!("the opacity of {opacity}, from {:?}", look.cutoff()));
    let of = look.region.map_or("the picture".into(), |r| format!("the region {r:?}"));
    state("scale", format!("{:?} mm across {of}", look.width_mm.unwrap_or(f64::NAN)));
    state("color", "the channels of the pictures as linear sRGB; no camera profile was used".into());
    say("size", format!("{}x{}", found.width, found.height));
    say("texel_mm", format!("{:?}", found.texel_mm));
    say("lobe", "Beckmann".into());
    if !found.warnings.is_empty() {
        say("warnings", found.warnings.join("; "));
    }
}

/// The maps of a side as its own camera sees it.
fn maps(look: &Look, found: &Texels, side: Side) -> ChannelMaps {
    let (w, n) = (found.width, found.on.len());
    let mut out = ChannelMaps::new(w, found.height);
    let back = side == Side::Back;
    let mut add = |quantity: Quantity, c: usize, of: &dyn Fn(usize) -> f32| {
        let plane: Vec<f32> = (0..n).map(of).collect();
        out.add(quantity, c, if back { mirror(&plane, w) } else { plane });
    };
    let rho_s = look.rho_s();
    for c in 0..3 {
        add(Quantity::RhoD, c, &|k| found.rho_d[usize::from(back)][k][c]);
        add(Quantity::RhoT, c, &|k| found.rho_t[k][c]);
        add(Quantity::RhoS, c, &|_| rho_s[c] as f32);
        // The blade was turned about y, so x counts the other way, and out of the back is into the front.
        let sign = if back && c == 1 { -1.0 } else { 1.0 };
        add(Quantity::Normal, c, &|k| sign * found.normal[k][c]);
    }
    add(Quantity::M, 0, &|_| look.m.unwrap_or(SLOPE) as f32);
    add(Quantity::Thickness, 0, &|_| look.thickness_mm.unwrap_or(THICKNESS_MM) as f32);
    add(Quantity::Mask, 0, &|k| f32::from(u8::from(found.on[k])));
    out
}

fn section(look: &Look, found: &Texels) -> RecordSection {
    let good = found.on.iter().filter(|on| **on).count();
    let counts =
        [("texels", found.on.len()), ("outside", found.on.len() - good), ("good", good), ("scaled", found.scaled)];
    let thickness = FitParameter {
        value: vec![look.thickness_mm.unwrap_or(THICKNESS_MM)],
        stderr: vec![f64::INFINITY],
        unit: "mm".into(),
        undetermined: vec!["thickness: stated, not fitted".into()],
        ..FitParameter::default()
    };
    RecordSection {
        counts: counts.map(|(name, count)| (name.to_string(), count)).into_iter().collect(),
        params: [(Quantity::Thickness.name().to_string(), thickness)].into(),
        ..RecordSection::default()
    }
}
