//! What the renderer and people look at: W's packed textures, normals in the blade mesh's tangent frame, and 8-bit
//! previews.

use crate::Result;
use crate::leaf::blade::{Blade, Grid};
use crate::leaf::map_path;
use mesophyll_files::image::{Maps, Packing, to_srgb8, write_exr, write_png};
use mesophyll_files::quantity::{Quantity, RGB, XYZ};
use mesophyll_optics::side::{Side, behind};
use std::path::Path;

/// W's two RGBA textures a side, and normals in the blade mesh's tangent frame.
pub fn packed(
    out: &Path,
    grid: &Grid,
    thickness_mm: f64,
    side: Side,
    values: &Maps,
    blade: Option<&Blade>,
) -> Result<()> {
    let plane = |q: Quantity, c| values.plane(q, c).unwrap_or_default().to_vec();
    let mut first = Maps::new(grid.width, grid.height);
    let mut second = Maps::new(grid.width, grid.height);
    for (c, letter) in RGB.into_iter().enumerate() {
        first.push(letter, plane(Quantity::Gamma, c));
        second.push(letter, plane(Quantity::RhoS, c));
    }
    first.push("A", plane(Quantity::Thickness, 0).iter().map(|t| (f64::from(*t) - thickness_mm) as f32).collect());
    second.push("A", plane(Quantity::M, 0));
    write_exr(&map_path(out, side, "gamma_delta"), &first, Packing::Zip)?;
    write_exr(&map_path(out, side, "rho_s_m"), &second, Packing::Zip)?;

    let frames = blade.map(|b| b.frames(grid));
    let (x, y, z) = (plane(Quantity::Normal, 0), plane(Quantity::Normal, 1), plane(Quantity::Normal, 2));
    let mut tangent = [vec![0f32; x.len()], vec![0f32; x.len()], vec![0f32; x.len()]];
    for k in 0..x.len() {
        let n = [x[k], y[k], z[k]];
        let local = match (&frames, side) {
            (None, _) => n,
            (Some(f), Side::Front) => f[k].map(|axis| axis[0] * n[0] + axis[1] * n[1] + axis[2] * n[2]),
            (Some(f), Side::Back) => {
                // Into the front's frame, into the mesh's, and back behind the leaf again.
                let seen = [-n[0], n[1], -n[2]];
                let l = f[behind(k, grid.width)].map(|axis| axis[0] * seen[0] + axis[1] * seen[1] + axis[2] * seen[2]);
                [-l[0], l[1], -l[2]]
            }
        };
        for c in 0..3 {
            tangent[c][k] = local[c];
        }
    }
    let mut normal = Maps::new(grid.width, grid.height);
    for (name, plane) in XYZ.into_iter().zip(tangent) {
        normal.push(name, plane);
    }
    write_exr(&map_path(out, side, "normal"), &normal, Packing::Zip)
}

/// 8-bit previews: colours as sRGB on transparent ground, scalars as grey between their 1st and 99th percentile.
pub fn previews(out: &Path, side: Side, values: &Maps) -> Result<()> {
    let mask = values.scalar(Quantity::Mask).unwrap_or_default();
    let alpha = |k: usize| if mask[k] == 0.0 { 0 } else { 255 };
    let save = |what: &str, pixel: &dyn Fn(usize) -> [u8; 3]| {
        let bytes: Vec<u8> = (0..mask.len())
            .flat_map(|k| {
                let [r, g, b] = pixel(k);
                [r, g, b, alpha(k)]
            })
            .collect();
        write_png(&out.join(format!("{}_{what}.png", side.name())), values.width, values.height, &bytes)
    };
    let three = |q| values.three(q).unwrap_or_default();
    for quantity in [Quantity::RhoD, Quantity::RhoT, Quantity::RhoS] {
        let planes = three(quantity);
        save(quantity.name(), &|k| planes.map(|p| to_srgb8(p[k])))?;
    }
    for quantity in [Quantity::M, Quantity::Thickness] {
        let plane = values.scalar(quantity).unwrap_or_default();
        let mut sorted: Vec<f32> =
            plane.iter().zip(mask).filter(|(v, m)| **m == 1.0 && v.is_finite()).map(|(v, _)| *v).collect();
        sorted.sort_unstable_by(f32::total_cmp);
        let at = |q: f64| sorted.get(((sorted.len() as f64 - 1.0) * q) as usize).copied().unwrap_or(0.0);
        let (lo, hi) = (at(0.01), at(0.99));
        save(quantity.name(), &|k| [(((plane[k] - lo) / (hi - lo).max(1e-12)).clamp(0.0, 1.0) * 255.0) as u8; 3])?;
    }
    let normal = three(Quantity::Normal);
    save(Quantity::Normal.name(), &|k| normal.map(|p| ((p[k] * 0.5 + 0.5).clamp(0.0, 1.0) * 255.0 + 0.5) as u8))
}
