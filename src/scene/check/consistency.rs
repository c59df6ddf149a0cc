//! Whether a fit folder agrees with itself, whatever its hashes say: a map that was changed and hashed anew contradicts
//! the others.
//!
//! Five things a fit writes twice: mean thickness = h; ρd = γ·slab(σa, σs, h + δ); ρt = slab's, in the median; W's
//! packed textures = the named channels; packed normals = the scan's normals in the mesh's frame, leaning the way the
//! blade leans; mask = the blade's outline.

use crate::Result;
use crate::fits::fitted::Fitted;
use crate::ledger::Ledger;
use crate::loaded::Leaf;
use mesophyll_files::image::Maps;
use mesophyll_files::mesh::LeafMesh;
use mesophyll_leaf::frames;
use mesophyll_optics::side::Side;
use mesophyll_optics::slab;
use rayon::prelude::*;

/// Shares of texels that may stray (rims, where filling and filtering differ), and how far the others may.
const STRAY: f64 = 0.01;
const SAME: f64 = 1e-3;
/// Median of the transmittance over the slab's: pigment makes single texels stray further, a leaf as a whole does not.
const TRANSMITTANCE: f64 = 0.1;
/// Tangent-space components, at 19 of 20 texels: the rims of facets belong to either.
const NORMAL: f64 = 0.02;
const FACETS: f64 = 0.05;
/// Share of mask and outline in common.
const OUTLINE: f64 = 0.9;

/// A sentence for every contradiction in what the plan needs of a leaf.
///
/// # Errors
/// [`crate::Error::Input`] for a map that cannot be read.
pub fn contradictions(leaf: Leaf, ledger: &Ledger) -> Result<Vec<String>> {
    let mut out = Vec::new();
    let Some(fitted) = &leaf.placed.fitted else { return Ok(out) };
    for (s, side) in Side::ALL.into_iter().enumerate() {
        if !(leaf.plan.sides[s].any() || leaf.plan.sides[s].mean) {
            continue;
        }
        let path = fitted.folder.join(format!("{}.exr", side.name()));
        let names: Vec<String> = ["gamma", "rho_d", "rho_t", "rho_s"]
            .iter()
            .flat_map(|n| ["R", "G", "B"].map(|c| format!("{n}.{c}")))
            .chain(["mask.Y", "thickness.Y", "m.Y", "normal.X", "normal.Y", "normal.Z"].map(String::from))
            .collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let maps = fitted.maps(&format!("{}.exr", side.name()), &names, ledger)?;
        let good: Vec<usize> = (0..maps.width * maps.height)
            .filter(|&k| maps.require(&path, "mask.Y").is_ok_and(|m| m[k] > 0.0))
            .collect();
        let mut say = |what: String| out.push(format!("{}: {what}", path.display()));
        if good.is_empty() {
            say("no good texel at all".into());
            continue;
        }
        let plane = |name: &str| maps.get(name).unwrap_or_default();
        let h = fitted.thickness(side)?;
        let mean = good.iter().map(|&k| f64::from(plane("thickness.Y")[k])).sum::<f64>() / good.len() as f64;
        if off(mean / h, 1.0, 0.01) {
            say(format!("its mean thickness is {mean:.4} mm, but fit.toml says {h:.4} mm"));
        }
        for what in interior(fitted, side, &maps, &good)? {
            say(what);
        }
        for what in packed(leaf, s, &maps, &good, h) {
            say(what);
        }
        if let Some(mesh) = leaf.placed.mesh.as_ref().filter(|_| leaf.placed.mesh_path.starts_with(&fitted.folder)) {
            for what in shape(fitted, leaf, s, &maps, mesh, ledger)? {
                say(what);
            }
        }
    }
    Ok(out)
}

/// Further than `by` from `expected`; a NaN is.
fn off(value: f64, expected: f64, by: f64) -> bool {
    value.is_nan() || (value - expected).abs() > by
}

fn interior(fitted: &Fitted, side: Side, maps: &Maps, good: &[usize]) -> Result<Vec<String>> {
    let (sigma_a, sigma_s) = (fitted.rgb(side, "sigma_a")?, fitted.rgb(side, "sigma_s")?);
    let plane = |name: String| maps.get(&name).unwrap_or_default();
    let thickness = maps.get("thickness.Y").unwrap_or_default();
    let mut out = Vec::new();
    for (c, letter) in ["R", "G", "B"].into_iter().enumerate() {
        let (gamma, rho_d, rho_t) =
            (plane(format!("gamma.{letter}")), plane(format!("rho_d.{letter}")), plane(format!("rho_t.{letter}")));
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
        let mut through: Vec<f64> = ratios.iter().map(|r| r.1).collect();
        through.sort_by(f64::total_cmp);
        let median = through[through.len() / 2];
        if off(median, 1.0, TRANSMITTANCE) {
            out.push(format!(
                "the slab of fit.toml lets {median:.2} times the light of rho_t.{letter} through, in the median"
            ));
        }
    }
    Ok(out)
}

/// W's two textures against the named channels, as far as the plan read them.
fn packed(leaf: Leaf, s: usize, maps: &Maps, good: &[usize], h: f64) -> Vec<String> {
    let mut out = Vec::new();
    let mut compare = |what: &str, texels: &[[f32; 4]], names: [&str; 4], shift: f64| {
        let planes = names.map(|n| maps.get(n).unwrap_or_default());
        let differs = |k: usize| {
            (0..4).any(|c| {
                let expected = f64::from(planes[c][k]) - if c == 3 { shift } else { 0.0 };
                off(f64::from(texels[k][c]), expected, SAME * expected.abs().max(0.01))
            })
        };
        let stray = good.iter().filter(|&&k| differs(k)).count() as f64 / good.len() as f64;
        if stray > STRAY {
            out.push(format!("{what} disagrees with it at {:.1} % of the texels", 100.0 * stray));
        }
    };
    let name = Side::ALL[s].name();
    if let Some(t) = &leaf.loaded.textures[s].gamma_delta {
        compare(&format!("{name}_gamma_delta.exr"), t, ["gamma.R", "gamma.G", "gamma.B", "thickness.Y"], h);
    }
    if let Some(t) = &leaf.loaded.textures[s].gloss {
        compare(&format!("{name}_rho_s_m.exr"), t, ["rho_s.R", "rho_s.G", "rho_s.B", "m.Y"], 0.0);
    }
    out
}

/// Normals and mask against the blade.
fn shape(fitted: &Fitted, leaf: Leaf, s: usize, maps: &Maps, mesh: &LeafMesh, ledger: &Ledger) -> Result<Vec<String>> {
    let mut out = Vec::new();
    let (w, h) = (maps.width, maps.height);
    let path = fitted.folder.join("blade.glb");
    let covered = frames::covered(mesh, w, h);
    let column = |k: usize| if s == 1 { k / w * w + w - 1 - k % w } else { k };
    let mask = maps.get("mask.Y").unwrap_or_default();
    let (mut both, mut either) = (0usize, 0usize);
    for (k, m) in mask.iter().enumerate() {
        both += usize::from(*m != 0.0 && covered[column(k)]);
        either += usize::from(*m != 0.0 || covered[column(k)]);
    }
    let common = both as f64 / either.max(1) as f64;
    if common < OUTLINE {
        out.push(format!("its mask and the outline of blade.glb have {:.1} % in common", 100.0 * common));
    }
    if !leaf.plan.sides[s].normal {
        return Ok(out);
    }
    let planes = ["normal.X", "normal.Y", "normal.Z"].map(|n| maps.get(n).unwrap_or_default());
    let normals: Vec<[f32; 3]> = (0..w * h).map(|k| [planes[0][k], planes[1][k], planes[2][k]]).collect();
    let frames = frames::frames(&path, mesh, w, h)?;
    let on: Vec<usize> = (0..w * h).filter(|&k| mask[k] > 0.0 && covered[column(k)]).collect();
    // The blade's relief comes from these normals: mirrored, they lean against it.
    let (mut with, mut against) = ([0.0; 2], [0.0; 2]);
    for &k in &on {
        let of_mesh = frames[column(k)][2];
        // The back's own normal is the mesh's turned over, (−x, −y, −z), seen after a turn about y: (x, −y, z).
        let seen = [of_mesh.x, if s == 1 { -of_mesh.y } else { of_mesh.y }];
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
    let file = format!("{}_normal.exr", Side::ALL[s].name());
    let packed = fitted.maps(&file, &["X", "Y", "Z"], ledger)?;
    let expected = frames::tangent_space(&normals, &frames, w, Side::ALL[s]);
    let found: Vec<&[f32]> = packed.channels.iter().map(|(_, p)| p.as_slice()).collect();
    if packed.width * packed.height == w * h {
        let differs = |k: usize| (0..3).any(|c| off(f64::from(found[c][k]), f64::from(expected[k][c]), NORMAL));
        let stray = on.iter().filter(|&&k| differs(k)).count() as f64 / on.len().max(1) as f64;
        if stray > FACETS {
            out.push(format!("{file} disagrees with it at {:.1} % of the texels", 100.0 * stray));
        }
    }
    Ok(out)
}
