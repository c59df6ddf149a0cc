//! σa and σs of each side as textures, for renderers that follow light inside a leaf (volume coefficients of MDL and of
//! RTX's renderers are in 1/m), with the thickness that belongs to them.

use crate::coat::ExportLoss;
use crate::side::ExportSideMaps;
use crate::{ExportResult, Result};
use mesophyll_files::atomic;
use mesophyll_files::claim::{self, OutputKind};
use mesophyll_files::image::{ChannelMaps, Packing, write_exr};
use mesophyll_files::quantity::{Quantity, RGB};
use mesophyll_fits::leaf_folder::{LeafFitFile, filling};
use mesophyll_optics::slab;
use serde_json::{Value, json};
use std::path::Path;

/// 1/mm in 1/m, and m in mm.
const PER_METRE: f64 = 1000.0;

/// Writes `SIDE_sigma_a.exr` and `SIDE_sigma_s.exr` (1/m), `SIDE_thickness.exr` (m), `sigma.json` with units and ranges
/// and `loss.json`. What is lost is how far a slab of these numbers is from the fitted ρd and ρt.
///
/// # Errors
/// [`crate::Error::Input`] for a fit without these maps; [`crate::Error::Usage`] and [`crate::Error::Write`] for the
/// folder.
pub fn folder(sides: &[ExportSideMaps], from: &Path, path: &Path) -> Result<ExportResult> {
    let _claim = claim::folder(path, OutputKind::Export, &[from])?;
    let mut textures = Vec::new();
    let (mut ranges, mut surface, mut lines) = (json!({}), json!({"name": "leaf"}), Vec::new());
    for side in sides {
        let file = LeafFitFile::Maps.path(from, side.side);
        let (width, height) = (side.maps.width, side.maps.height);
        let mut planes = side.maps.require_planes(&file, &[Quantity::SigmaA, Quantity::SigmaS, Quantity::Thickness])?;
        let good: Vec<bool> =
            (0..width * height).map(|k| planes.iter().all(|p| p[k].is_finite() && p[k] >= 0.0)).collect();
        filling::require(&file, &mut planes, &good, width, height)?;
        let lost = loss(side, from, &planes)?;
        for (what, first, letters, factor) in [
            ("sigma_a", 0, &RGB[..], PER_METRE),
            ("sigma_s", 3, &RGB[..], PER_METRE),
            ("thickness", 6, &["Y"][..], 1.0 / PER_METRE),
        ] {
            let mut maps = ChannelMaps::new(width, height);
            let mut range = [f64::INFINITY, f64::NEG_INFINITY];
            for (letter, plane) in letters.iter().zip(&planes[first..]) {
                let scaled: Vec<f32> = plane.iter().map(|v| (f64::from(*v) * factor) as f32).collect();
                for v in &scaled {
                    range = [range[0].min(f64::from(*v)), range[1].max(f64::from(*v))];
                }
                maps.push(*letter, scaled);
            }
            let name = format!("{}_{what}.exr", side.side.name());
            ranges[&name] = json!({"unit": if first == 6 { "m" } else { "1/m" }, "least": range[0], "most": range[1]});
            textures.push((path.join(name), maps));
        }
        let shown = |v: [f64; 3]| v.map(|v| format!("{v:+.4}")).join(" ");
        lines.push(format!(
            "{}: a slab of these numbers differs from the fitted reflectance by {:.2} % and from the transmittance by \
             {:.2} % (relative RMS over the leaf); mean error, reflected {}, transmitted {}",
            side.side.name(),
            100.0 * lost.rms[0],
            100.0 * lost.rms[1],
            shown(lost.mean[0]),
            shown(lost.mean[1])
        ));
        surface[side.side.name()] = json!({
            "reflectance_rms": lost.rms[0], "transmittance_rms": lost.rms[1],
            "mean_error": {"reflected": lost.mean[0], "transmitted": lost.mean[1]},
        });
    }
    claim::begin(path, OutputKind::Export)?;
    let mut done = ExportResult::default();
    for (to, maps) in textures {
        write_exr(&to, &maps, Packing::Zip)?;
        done.files.push(to);
    }
    let units = json!({
        "scale": "textures hold the coefficients themselves, no factor is left to be applied; 1/mm = 1000/m",
        "phase_function": "isotropic",
        "textures": ranges,
    });
    done.files.push(path.join("sigma.json"));
    write(&path.join("sigma.json"), &units)?;
    let unsaid = [
        "gloss and normals".to_string(),
        "a surface that refracts: the numbers belong to a slab of index 1 under light along the normal".to_string(),
    ];
    let meaning = "reflectance_rms, transmittance_rms: relative root mean square of what a slab of these textures \
                   reflects and transmits against the fitted maps; mean_error: theirs less ours for red, green and \
                   blue (docs/export.md)";
    let lost = ExportLoss::other("sigma", meaning, vec![surface], lines, &unsaid);
    done.files.push(path.join("loss.json"));
    lost.write(&path.join("loss.json"))?;
    done.lost = Some(lost);
    claim::finish(path)?;
    Ok(done)
}

fn write(path: &Path, value: &Value) -> Result<()> {
    let mut text = serde_json::to_vec_pretty(value).map_err(|e| crate::Error::write(path, e))?;
    text.push(b'\n');
    atomic::write_bytes(path, &text)
}

/// Of reflectance and of transmittance: relative root mean square, and mean difference for each colour.
struct Loss {
    rms: [f64; 2],
    mean: [[f64; 3]; 2],
}

fn loss(side: &ExportSideMaps, from: &Path, planes: &[Vec<f32>]) -> Result<Loss> {
    let fitted = [side.rgb(Quantity::RhoD, from)?, side.rgb(Quantity::RhoT, from)?];
    let (mut squares, mut mean, mut count) = ([[0.0; 2]; 2], [[0.0; 3]; 2], 0.0f64);
    let whole = |k: usize| fitted.iter().flatten().all(|plane| plane[k].is_finite());
    for k in (0..side.mask.len()).filter(|k| side.mask[*k] > 0.5 && whole(*k) && planes[6][*k] > 0.0) {
        count += 1.0;
        for c in 0..3 {
            let at = |plane: usize| f64::from(planes[plane][k]);
            let slab = slab::response(at(c), at(3 + c), at(6));
            for (n, theirs) in [slab.rho_d, slab.rho_t].into_iter().enumerate() {
                let ours = f64::from(fitted[n][c][k]);
                squares[n][0] += (theirs - ours) * (theirs - ours);
                squares[n][1] += ours * ours;
                mean[n][c] += theirs - ours;
            }
        }
    }
    Ok(Loss {
        rms: squares.map(|[difference, ours]| if ours > 0.0 { (difference / ours).sqrt() } else { 0.0 }),
        mean: mean.map(|m| m.map(|v| v / count.max(1.0))),
    })
}
