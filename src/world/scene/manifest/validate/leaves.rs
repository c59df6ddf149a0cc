//! Checks leaves: each has one source of data, and its fields belong together.

use super::place::ManifestText;
use crate::manifest::{InteriorSource, LeafOrigin, Result, StatedLeaf, UniformLeaf};
use mesophyll_fits::leaf_folder::other_side::OtherSide;
use mesophyll_transport::lobe::M_FLOOR;

const HEADER: &str = "[[leaf]]";

pub fn leaves(p: &ManifestText) -> Result<()> {
    let mut names = p.names(HEADER, "leaf");
    for (i, leaf) in p.manifest.leaves.iter().enumerate() {
        names.take(i, &leaf.name)?;
        match &leaf.origin {
            LeafOrigin::Uniform(uniform) => one_uniform(p, i, leaf, uniform)?,
            LeafOrigin::Layered(_) => shaped(p, i, "foliar", leaf)?,
            LeafOrigin::Look(look) => {
                let fault = |(field, what)| Err(p.error(HEADER, i, "look", format!("{field}: {what}")));
                look.fault().map_or(Ok(()), fault)?;
            }
            LeafOrigin::Fitted(_) | LeafOrigin::Other => {}
        }
        let like = leaf.like.as_ref().and_then(|name| p.manifest.leaf_index(name)).map(|k| &p.manifest.leaves[k]);
        if let Some(name) = &leaf.like {
            p.leaf(HEADER, i, "like", name)?;
            if like.is_some_and(|other| other.like.is_some()) {
                let what = format!("\"{name}\" is like another one itself; expected a leaf with data of its own");
                return Err(p.error(HEADER, i, "like", what));
            }
            let even = |l: &StatedLeaf| matches!(l.origin, LeafOrigin::Uniform(_) | LeafOrigin::Layered(_));
            if leaf.discs.is_some() && !like.is_some_and(even) {
                return Err(p.error(HEADER, i, "discs", "given without uniform; discs have no maps"));
            }
        }
        if leaf.part.is_some() && (leaf.mesh.is_none() || leaf.mesh_unit.is_some()) {
            let what =
                "given without a mesh, or with a mesh_unit; expected a mesh that is a plant's file or description";
            return Err(p.error(HEADER, i, "part", what));
        }
        if leaf.mesh_unit.is_some() && leaf.mesh.is_none() && leaf.discs.is_none() {
            let what = "given without a mesh; a fit's own blade says its unit itself";
            return Err(p.error(HEADER, i, "mesh_unit", what));
        }
        if leaf.mesh_up.is_some() && (leaf.mesh.is_none() || leaf.part.is_some()) {
            let what = "given without a mesh, or with a part, which stands as its plant does; expected a mesh alone";
            return Err(p.error(HEADER, i, "mesh_up", what));
        }
        let origin = like.unwrap_or(leaf);
        if let Some(other) = origin.fit().and_then(|f| f.other_side.as_ref()) {
            one_other_side(p, i, leaf, other)?;
        }
        let scan = leaf.fit().and_then(|f| f.scan.as_ref());
        if scan.is_some() && leaf.fit().is_some_and(|f| f.capture.is_some()) {
            return Err(p.error(HEADER, i, "scan", "given beside a capture; expected one of the two"));
        }
        if let Some(scan) = scan {
            if scan.size.is_some() && scan.texels().is_none() {
                let found = scan.size.as_deref().unwrap_or_default();
                let what = format!("size: found \"{found}\", expected WIDTHxHEIGHT such as 240x180");
                return Err(p.error(HEADER, i, "scan", what));
            }
            for side in scan.field_mm.iter().flatten() {
                p.range(HEADER, i, "scan", *side, [0.1, 1e4], "mm of field")?;
            }
            for sigma in scan.sigma_a.iter().chain(&scan.sigma_s).flatten() {
                p.range(HEADER, i, "scan", *sigma, [1e-6, 1e6], "1/mm of absorption or scattering")?;
            }
            p.range(HEADER, i, "scan", scan.frames.unwrap_or(100) as f64, [8.0, 10_000.0], "frames")?;
            p.range(HEADER, i, "scan", scan.noise.unwrap_or(0.0), [0.0, 1.0], "relative noise")?;
        }
        match (leaf.lobe.has_index(), leaf.index) {
            (true, Some(n)) => p.range(HEADER, i, "index", n, [1.0, 4.0], "")?,
            (true, None) => {
                return Err(p.error(HEADER, i, "index", format!("missing; the {} lobe needs one", leaf.lobe)));
            }
            (false, Some(_)) => {
                return Err(p.error(HEADER, i, "index", format!("given, but the {} lobe has none", leaf.lobe)));
            }
            (false, None) => {}
        }
    }
    Ok(())
}

/// The rounding error that ρd + ρt = 1 may have when the numbers have six digits.
const ROUNDING: f64 = 2e-6;

/// Checks that a leaf without maps has a shape. `key` is the field that states it.
fn shaped(p: &ManifestText, i: usize, key: &str, leaf: &StatedLeaf) -> Result<()> {
    match (&leaf.mesh, &leaf.discs) {
        (None, None) => Err(p.error(HEADER, i, "mesh", format!("missing; a {key} leaf needs a mesh, or discs"))),
        (Some(_), Some(_)) => Err(p.error(HEADER, i, "discs", "given beside a mesh; expected one of the two")),
        _ => Ok(()),
    }
}

/// Checks what stands for the side of a leaf that was not measured.
fn one_other_side(p: &ManifestText, i: usize, leaf: &StatedLeaf, other: &OtherSide) -> Result<()> {
    const KEY: &str = "other_side";
    if leaf.translucency.is_some() {
        let what = "given for a leaf with translucency, whose maps need both sides measured; expected one of the two";
        return Err(p.error(HEADER, i, KEY, what));
    }
    let OtherSide::Stated(stated) = other else { return Ok(()) };
    if leaf.interior == InteriorSource::Maps {
        let what = "states a reflection, but interior = \"maps\" takes it from the maps of the tissue; expected \
                    \"mirrored\", or interior = \"scalars\"";
        return Err(p.error(HEADER, i, KEY, what));
    }
    for (name, values) in [("rho_d", stated.rho_d), ("rho_s", stated.rho_s)] {
        for value in values {
            p.range(HEADER, i, KEY, value, [0.0, 1.0], &format!("of {name}"))?;
        }
    }
    p.range(HEADER, i, KEY, stated.m, [M_FLOOR, 2.0], "of slope m")
}

fn one_uniform(p: &ManifestText, i: usize, leaf: &StatedLeaf, uniform: &UniformLeaf) -> Result<()> {
    const KEY: &str = "uniform";
    shaped(p, i, KEY, leaf)?;
    if leaf.lobe.has_index() {
        return Err(p.error(HEADER, i, "lobe", format!("found {}, expected one without an index", leaf.lobe)));
    }
    if let Some(name) = uniform.lacks() {
        let what = match uniform.spectrum {
            None => format!("{name}: missing; expected rho_d and rho_t, a slab, or a spectrum"),
            Some(_) => format!("{name}: missing; beside a spectrum, expected both rho_d and rho_t, or none of the two"),
        };
        return Err(p.error(HEADER, i, KEY, what));
    }
    if let Some(slab) = &uniform.slab {
        for value in slab.sigma_a.iter().chain(&slab.sigma_s) {
            p.range(HEADER, i, KEY, *value, [0.0, 1e6], "1/mm of absorption or scattering")?;
        }
        p.range(HEADER, i, KEY, slab.thickness_mm, [1e-6, 1e3], "mm of thickness")?;
    }
    let [front, back] = &uniform.rho_d;
    let none = [0.0; 3];
    for (name, values) in [
        ("rho_d", front),
        ("rho_d", back),
        ("rho_t", &uniform.rho_t),
        ("rho_s", uniform.rho_s.as_ref().unwrap_or(&none)),
    ] {
        for value in values {
            p.range(HEADER, i, KEY, *value, [0.0, 1.0 + ROUNDING], &format!("of {name}"))?;
        }
    }
    p.range(HEADER, i, KEY, uniform.m, [M_FLOOR, 2.0], "of slope m")?;
    for (side, rho_d) in ["front", "back"].into_iter().zip([front, back]) {
        for c in 0..3 {
            let sum = rho_d[c] + uniform.rho_t[c];
            if !(sum <= 1.0 + ROUNDING) {
                let channel = ["R", "G", "B"][c];
                let what = format!("rho_d + rho_t of the {side}, {channel}, is {sum}; expected at most 1");
                return Err(p.error(HEADER, i, KEY, what));
            }
        }
    }
    Ok(())
}
