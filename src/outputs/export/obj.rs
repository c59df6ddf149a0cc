//! The blade as Wavefront OBJ (mm, normals, texture coordinates with v upwards), with one material for each side and
//! pictures beside the file.
//!
//! `map_Kd` is ρd (sRGB), `Ks` the mean ρs, `Ns` = 2/m² − 2 the Phong exponent of the mean roughness (Walter et al.
//! 2007, §5.2), `norm` the normals, `map_Pr` the roughness √m for readers of the physically based extension. ρt has no
//! place in the format.

use super::blade::ExportMesh;
use super::side::ExportSideMaps;
use super::texture::{TextureMirroring, data_byte, encode, normal_pixel, pixels};
use crate::{Error, Result};
use mesophyll_files::image::to_srgb8;
use mesophyll_files::quantity::Quantity;
use mesophyll_files::{atomic, claim};
use mesophyll_fits::leaf_folder::BLADE;
use mesophyll_fits::record::FitRecord;
use mesophyll_optics::side::Side;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Writes `PATH`, and beside it `STEM.mtl` and `STEM_front_rho_d.png` ….
pub fn write(sides: &[ExportSideMaps], record: &FitRecord, folder: &Path, path: &Path) -> Result<Vec<PathBuf>> {
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    // For most readers of these formats, a blank ends a file name.
    if stem.is_empty() || stem.contains(char::is_whitespace) {
        return Err(Error::Usage(format!(
            "{}: expected an output name without blanks, such as leaf.obj",
            path.display()
        )));
    }
    let blade = mesophyll_files::mesh::read(&folder.join(BLADE), None)?;
    let front = ExportMesh::of(&blade);
    let mut written = vec![path.to_path_buf()];
    let name = |what: &str| path.with_file_name(format!("{stem}{what}"));
    let mut materials = format!("# {} by {}\n", one_line(&record.name), one_line(&record.program));
    let mut text =
        format!("# {}: lengths in mm, normals out of each side\nmtllib {stem}.mtl\n", one_line(&record.name));
    for side in sides {
        let (back, own) = (side.side == Side::Back, side.side.name());
        let (mesh, turn) =
            if back { (front.turned(), TextureMirroring::Mirrored) } else { (front.clone(), TextureMirroring::AsSeen) };
        mesh_text(&mut text, &mesh, own, if back && sides.len() > 1 { front.positions.len() } else { 0 });
        let (width, height) = (side.maps.width, side.maps.height);
        let mut save = |what: &str, pixel: &dyn Fn(usize) -> [u8; 3]| {
            let file = name(&format!("_{own}_{what}.png"));
            claim::file(&file, &["png"], &[])?;
            atomic::write_bytes(&file, &encode(&file, width, height, &pixels(side, turn, pixel))?)?;
            let plain = file.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            written.push(file);
            Ok::<String, Error>(plain)
        };
        let _ = writeln!(materials, "newmtl {own}\nillum 2\nKd 1 1 1");
        let [r, g, b] = side.rgb(Quantity::RhoD, folder)?;
        let _ = writeln!(materials, "map_Kd {}", save("rho_d", &|k| [r[k], g[k], b[k]].map(to_srgb8))?);
        if let (Ok(rho_s), Ok(m)) = (side.rgb(Quantity::RhoS, folder), side.one(Quantity::M, folder)) {
            let mean = |plane: &[f32]| {
                let (sum, n) = plane
                    .iter()
                    .zip(&side.mask)
                    .filter(|(v, k)| **k > 0.5 && v.is_finite())
                    .fold((0.0, 0), |(s, n), (v, _)| (s + f64::from(*v), n + 1));
                sum / f64::from(n.max(1))
            };
            let exponent = (2.0 / mean(m).max(1e-3).powi(2) - 2.0).clamp(1.0, 1000.0);
            let [r, g, b] = rho_s.map(mean);
            let _ = writeln!(materials, "Ks {r:.5} {g:.5} {b:.5}\nNs {exponent:.2}");
            let _ = writeln!(
                materials,
                "map_Pr {}",
                save("roughness", &|k| [data_byte(m[k].max(0.0).sqrt(), 0.0, 1.0); 3])?
            );
        }
        if let Some(normals) = side.normals(&blade, folder)? {
            let _ = writeln!(materials, "norm {}", save("normal", &|k| normal_pixel(normals[k], turn))?);
        }
    }
    claim::file(&name(".mtl"), &["mtl"], &[])?;
    atomic::write_bytes(&name(".mtl"), materials.as_bytes())?;
    written.push(name(".mtl"));
    // The mesh is written last: when it exists, everything that it names exists.
    atomic::write_bytes(path, text.as_bytes())?;
    Ok(written)
}

fn mesh_text(text: &mut String, mesh: &ExportMesh, side: &str, offset: usize) {
    for p in &mesh.positions {
        let _ = writeln!(text, "v {} {} {}", p[0], p[1], p[2]);
    }
    for t in &mesh.uvs {
        let _ = writeln!(text, "vt {} {}", t[0], 1.0 - t[1]);
    }
    for n in &mesh.normals {
        let _ = writeln!(text, "vn {} {} {}", n[0], n[1], n[2]);
    }
    let _ = writeln!(text, "g {side}\nusemtl {side}");
    for t in mesh.indices.chunks_exact(3) {
        let [a, b, c] = [t[0], t[1], t[2]].map(|i| i as usize + offset + 1);
        let _ = writeln!(text, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}");
    }
}

fn one_line(text: &str) -> String {
    text.replace(['\n', '\r'], " ")
}
