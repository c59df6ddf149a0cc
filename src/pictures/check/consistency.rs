//! Whether the fits that a scene uses are still as they were fitted: their content hashes, and whether their numbers
//! agree with each other and with the blade.
//!
//! Of a leaf's maps and its blade this is looked at: normals lean in the direction in which the blade leans, and the
//! mask is the blade's outline.
//!
//! What numbers of a fit say of each other is looked at wherever a fit is read ([`mesophyll_fits::consistency`]). Of a
//! folder whose record does not say how the leaf was measured, three things are looked at here: the mean thickness is
//! h, ρd is γ times the reflectance of the leaf's slab at the texel's thickness, and ρt is that slab's transmittance,
//! in the median.

use mesophyll_base::error::Result;
use mesophyll_base::statistics::median_of;
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::mesh::LeafMesh;
use mesophyll_files::quantity::{Quantity, RGB};
use mesophyll_fits::consistency::{ConsistencyFaults, FileChange, says_how_it_was_measured};
use mesophyll_fits::leaf_folder::frames;
use mesophyll_fits::leaf_folder::{BLADE, LeafFit, LeafFitFile, packing};
use mesophyll_fits::record::RECORD;
use mesophyll_optics::side::Side;
use mesophyll_optics::slab;
use mesophyll_scene::loaded::{LoadedLeaf, LoadedScene};
use mesophyll_scene::placed::fits::reader;
use mesophyll_scene::placed::ledger::Ledger;
use rayon::prelude::*;
use std::path::Path;

/// Shares of texels that may differ (at rims, where filling and filtering differ), and how far the others may be off.
const STRAY: f64 = 0.01;
const SAME: f64 = 1e-3;
/// Largest deviation of the median of the transmittance over the slab's. Pigment makes single texels differ more, but
/// not a whole leaf.
const TRANSMITTANCE: f64 = 0.1;
/// Smallest share that mask and outline must have in common.
const OUTLINE: f64 = 0.9;

/// What the fits of a scene say against themselves: fits of leaves, of translucency maps, of branches and of lawns. A
/// file that the scene does not need is no fault of it, and is named as a note.
///
/// # Errors
/// [`mesophyll_base::error::Error::Input`] for a file that cannot be read.
pub fn verify(scene: &LoadedScene, ledger: &Ledger) -> Result<ConsistencyFaults> {
    let mut faults = scene.faults(ledger)?;
    let leaves = scene.placed.leaves.iter();
    let opened: Vec<&LeafFit> = leaves
        .flat_map(|l| [l.fitted.as_ref(), l.translucent.as_ref().and_then(|t| t.fitted.as_ref())])
        .flatten()
        .collect();
    let unneeded = |path: &Path| {
        let needed = scene.plan.needed.iter().any(|need| need.file.as_deref() == Some(path));
        !needed && !path.ends_with(RECORD) && opened.iter().any(|fit| path.starts_with(&fit.folder))
    };
    let (beside, changed): (Vec<FileChange>, _) = faults.changed.into_iter().partition(|c| unneeded(&c.path));
    faults.changed = changed;
    faults.notes.extend(beside.into_iter().map(|c| c.said));
    for leaf in scene.leaves() {
        faults.contradictions.extend(contradictions(leaf, ledger)?);
    }
    Ok(faults)
}

/// A sentence for every contradiction in what the plan needs of a leaf.
///
/// # Errors
/// [`mesophyll_base::error::Error::Input`] for a map that cannot be read.
pub fn contradictions(leaf: LoadedLeaf, ledger: &Ledger) -> Result<Vec<String>> {
    let mut out = Vec::new();
    let Some(fitted) = &leaf.placed.fitted else { return Ok(out) };
    for (side, needs) in Side::ALL.into_iter().zip(&leaf.plan.sides) {
        if !(needs.any() || needs.mean) {
            continue;
        }
        let path = fitted.path(LeafFitFile::Maps, side);
        let maps = reader::maps(fitted, side, ledger)?;
        let mask = maps.require_scalar(&path, Quantity::Mask)?;
        let thickness = maps.require_scalar(&path, Quantity::Thickness)?;
        let good: Vec<usize> = (0..mask.len()).filter(|&k| mask[k] > 0.0).collect();
        let mut say = |what: String| out.push(format!("{}: {what}", path.display()));
        if good.is_empty() {
            say("no good texel at all".into());
            continue;
        }
        if !says_how_it_was_measured(&fitted.record) {
            let h = fitted.thickness(side)?;
            let mean = good.iter().map(|&k| f64::from(thickness[k])).sum::<f64>() / good.len() as f64;
            if off(mean / h, 1.0, 0.01) {
                say(format!("its mean thickness is {mean:.4} mm, but fit.toml says {h:.4} mm"));
            }
            if !fitted.is_stated() {
                interior(fitted, side, maps, &good)?.into_iter().for_each(&mut say);
            }
        }
        if let Some(mesh) = leaf.placed.mesh.as_ref().filter(|_| leaf.placed.mesh_path.starts_with(&fitted.folder)) {
            for what in shape(fitted, side, needs.normal, maps, mesh)? {
                say(what);
            }
        }
    }
    Ok(out)
}

/// Whether `value` is further than `by` from `expected`, or NaN.
fn off(value: f64, expected: f64, by: f64) -> bool {
    value.is_nan() || (value - expected).abs() > by
}

fn interior(fitted: &LeafFit, side: Side, maps: &ChannelMaps, good: &[usize]) -> Result<Vec<String>> {
    let (sigma_a, sigma_s) = (fitted.rgb(side, Quantity::SigmaA)?, fitted.rgb(side, Quantity::SigmaS)?);
    let path = fitted.path(LeafFitFile::Maps, side);
    let thickness = maps.require_scalar(&path, Quantity::Thickness)?;
    let [gamma, rho_d, rho_t] = [
        maps.require_three(&path, Quantity::Gamma)?,
        maps.require_three(&path, Quantity::RhoD)?,
        maps.require_three(&path, Quantity::RhoT)?,
    ];
    let mut out = Vec::new();
    for (c, letter) in RGB.into_iter().enumerate() {
        let (gamma, rho_d, rho_t) = (gamma[c], rho_d[c], rho_t[c]);
        let ratios: Vec<(f64, f64)> = good
            .par_iter()
            .map(|&k| {
                let r = slab::response(sigma_a[c], sigma_s[c], f64::from(thickness[k]));
                (f64::from(gamma[k]) * r.rho_d / f64::from(rho_d[k]), r.rho_t / f64::from(rho_t[k]))
            })
            .collect();
        let stray = ratios.iter().filter(|r| off(r.0, 1.0, SAME)).count() as f64 / ratios.len() as f64;
        if stray > STRAY {
            out.push(format!("rho_d.{letter} is not gamma times the slab's at {:.1} % of the texels", 100.0 * stray));
        }
        let median = median_of(ratios.iter().map(|r| r.1)).unwrap_or(f64::NAN);
        if off(median, 1.0, TRANSMITTANCE) {
            out.push(format!(
                "the slab of fit.toml lets {median:.2} times the light of rho_t.{letter} through, in the median"
            ));
        }
    }
    Ok(out)
}

/// Compares the mask with the blade, and the normals where they are `needed`.
fn shape(fitted: &LeafFit, side: Side, needed: bool, maps: &ChannelMaps, mesh: &LeafMesh) -> Result<Vec<String>> {
    let mut out = Vec::new();
    let (w, h) = (maps.width, maps.height);
    let (path, blade) = (fitted.path(LeafFitFile::Maps, side), fitted.folder.join(BLADE));
    let covered = frames::covered(mesh, w, h);
    let column = |k: usize| side.in_front(k, w);
    let mask = maps.require_scalar(&path, Quantity::Mask)?;
    let (mut both, mut either) = (0usize, 0usize);
    for (k, m) in mask.iter().enumerate() {
        both += usize::from(*m != 0.0 && covered[column(k)]);
        either += usize::from(*m != 0.0 || covered[column(k)]);
    }
    let common = both as f64 / either.max(1) as f64;
    if common < OUTLINE {
        out.push(format!("its mask and the outline of blade.glb have {:.1} % in common", 100.0 * common));
    }
    if !needed {
        return Ok(out);
    }
    let normals = packing::normals(&path, maps)?;
    let frames = frames::frames(&blade, mesh, w, h)?;
    let on: Vec<usize> = (0..w * h).filter(|&k| mask[k] > 0.0 && covered[column(k)]).collect();
    // The blade's relief comes from these normals. If they are mirrored, they lean against it.
    let (mut with, mut against) = ([0.0; 2], [0.0; 2]);
    for &k in &on {
        let of_mesh = frames[column(k)][2];
        // The back's own normal is the mesh's turned over, (−x, −y, −z), seen after a turn about y: (x, −y, z).
        let seen = [of_mesh.x, if side == Side::Back { -of_mesh.y } else { of_mesh.y }];
        for axis in 0..2 {
            let (a, b) = (f64::from(normals[k][axis]), seen[axis]);
            with[axis] += (a - b).powi(2);
            against[axis] += (a + b).powi(2);
        }
    }
    for (axis, name) in ["X", "Y"].into_iter().enumerate() {
        if with[axis] > against[axis] {
            out.push(format!("normal.{name} leans against the blade: is it mirrored?"));
        }
    }
    Ok(out)
}
