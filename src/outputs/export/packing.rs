//! W's packing (Wang et al. 2005, §5) for a renderer. Each side has one RGBA texture of γ and δ, one of ρs and m, and
//! the normals in the blade's tangent frame, all as float OpenEXR.

use crate::Result;
use crate::side::ExportSideMaps;
use mesophyll_files::claim::{self, OutputKind};
use mesophyll_files::image::{ChannelMaps, Packing, write_exr};
use mesophyll_files::quantity::{RGB, XYZ};
use mesophyll_fits::leaf_folder::{LeafFit, LeafFitFile, packing};
use std::path::{Path, PathBuf};

/// Writes `PATH/front_gamma_delta.exr`, `PATH/front_rho_s_m.exr`, `PATH/front_normal.exr` and the back's. δ is the
/// thickness less the side's mean thickness h of `fit.toml`, in mm.
///
/// # Errors
/// A fit whose maps lack a quantity, a folder that holds something else (see [`claim::folder`]), or one that cannot be
/// written.
pub fn folder(sides: &[ExportSideMaps], from: &Path, path: &Path) -> Result<Vec<PathBuf>> {
    let leaf = LeafFit::open(from)?;
    let _claim = claim::folder(path, OutputKind::Maps, &[from])?;
    claim::begin(path, OutputKind::Maps)?;
    let mut written = Vec::new();
    for side in sides {
        let file = LeafFitFile::Maps.path(from, side.side);
        let rgba = [RGB[0], RGB[1], RGB[2], "A"];
        let first = packing::gamma_delta(&file, &side.maps, leaf.thickness(side.side)?)?;
        let second = packing::gloss(&file, &side.maps)?;
        let normals = packing::blade_normals(&leaf, side.side, &side.maps)?;
        let size = (side.maps.width, side.maps.height);
        for (what, texture) in [
            ("gamma_delta", texture(size, &rgba, &first)),
            ("rho_s_m", texture(size, &rgba, &second)),
            ("normal", texture(size, &XYZ, &normals)),
        ] {
            let to = path.join(format!("{}_{what}.exr", side.side.name()));
            write_exr(&to, &texture, Packing::Zip)?;
            written.push(to);
        }
    }
    claim::finish(path)?;
    Ok(written)
}

fn texture<const N: usize>((width, height): (usize, usize), names: &[&str; N], texels: &[[f32; N]]) -> ChannelMaps {
    let mut maps = ChannelMaps::new(width, height);
    for (c, name) in names.iter().enumerate() {
        maps.push(*name, texels.iter().map(|t| t[c]).collect());
    }
    maps
}
