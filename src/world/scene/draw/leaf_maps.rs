//! Hands a leaf's maps to the GPU renderer: W's packed textures, normals in the tangent frame, and a slab curve for
//! each side; or pigment maps, computed for each texel. A side whose light no camera sees is handed over black, without
//! maps.

use crate::loaded::LoadedLeaf;
use crate::loaded::map_levels::halve;
use crate::loaded::translucency::TranslucencyQuantity;
use crate::manifest::{InteriorSource, SceneManifest, StatedLeaf, UniformLeaf};
use crate::placed::fits::reader;
use crate::placed::ledger::Ledger;
use crate::{Error, Result};
use mesophyll_files::quantity::Quantity;
use mesophyll_fits::leaf_folder::{LeafFit, LeafFitFile, filling};
use mesophyll_optics::side::Side;
use mesophyll_optics::slab;
use mesophyll_viewer::scene as viewer;
use mesophyll_web::bundle::slab_curve;
use rayon::prelude::*;

/// A fitted leaf in the renderer's form: maps of the sides that the plan needs, at the planned size.
///
/// # Errors
/// [`Error::Input`] where a map is missing or damaged.
pub fn fitted(
    manifest: &SceneManifest,
    leaf: LoadedLeaf,
    fitted: &LeafFit,
    ledger: &Ledger,
) -> Result<viewer::LeafMaterial> {
    let config = leaf.config;
    // A leaf has one thickness. The δ of a side that was fitted with another h contains the difference.
    let h = fitted.thickness(fitted.lead())?;
    let mut sides = viewer::Sides::of(|_| viewer::SideMaps::black());
    for side in Side::ALL {
        let needs = leaf.plan.needs(side);
        if needs.interior() {
            let shift = (fitted.thickness(side)? - h) as f32;
            sides[side] = interior(leaf.placed.interior(config), leaf, side, shift, ledger)?;
        }
        if needs.gloss {
            sides[side].gloss = leaf.loaded.textures[side].gloss.as_ref().map(|t| shrink(t, leaf, mean4));
        }
        if needs.normal {
            sides[side].normal = Some(shrink(&reader::normals(fitted, side, ledger)?, leaf, mean3));
        }
        if needs.translucency {
            let Some(maps) = &leaf.loaded.coefficients[side] else {
                let what = "the translucency maps are not made yet; `mesophyll run` and `check` make them";
                return Err(Error::field(&manifest.path, &format!("leaf \"{}\"", config.name), what));
            };
            let coefficients = match &maps.of {
                TranslucencyQuantity::Factor(map) => viewer::CoefficientMaps::Factor(shrink(map, leaf, mean3)),
                TranslucencyQuantity::Colour(maps) => {
                    viewer::CoefficientMaps::Colour([0, 1, 2].map(|c| shrink(&maps[c], leaf, mean3)))
                }
            };
            sides[side].translucency = Some(viewer::Translucency { basis: maps.basis, coefficients });
        }
    }
    let size = [leaf.plan.size[0].max(1), leaf.plan.size[1].max(1)];
    Ok(viewer::LeafMaterial {
        name: config.name.clone(),
        width: size[0].div_ceil(leaf.plan.block) as u32,
        height: size[1].div_ceil(leaf.plan.block) as u32,
        thickness_mm: h as f32,
        lobe: config.lobe(),
        sides,
        mask: if config.mesh.is_some() { Some(mask(leaf, fitted, ledger)?) } else { None },
    })
}

/// A leaf that is the same everywhere, with the sides that the plan needs.
pub fn uniform(leaf: LoadedLeaf, stated: &UniformLeaf) -> viewer::LeafMaterial {
    let rgb = |c: &[f64; 3]| c.map(|v| v as f32);
    even(leaf.config, 1.0, |side| {
        let needs = leaf.plan.needs(side);
        let mut maps = viewer::SideMaps::black();
        if needs.interior() {
            maps.interior = viewer::Interior::Maps {
                rho_d: vec![rgb(&stated.rho_d[side as usize])],
                rho_t: vec![rgb(&stated.rho_t)],
            };
        }
        let [r, g, b] = rgb(&stated.gloss().unwrap_or_default());
        maps.gloss = (needs.gloss && stated.gloss().is_some()).then(|| vec![[r, g, b, stated.m as f32]]);
        maps
    })
}

/// A leaf with maps of one texel.
pub fn even(
    config: &StatedLeaf,
    thickness_mm: f64,
    side: impl FnMut(Side) -> viewer::SideMaps,
) -> viewer::LeafMaterial {
    viewer::LeafMaterial {
        name: config.name.clone(),
        width: 1,
        height: 1,
        thickness_mm: thickness_mm as f32,
        lobe: config.lobe(),
        sides: viewer::Sides::of(side),
        mask: None,
    }
}

fn interior(
    kind: InteriorSource,
    leaf: LoadedLeaf,
    side: Side,
    shift: f32,
    ledger: &Ledger,
) -> Result<viewer::SideMaps> {
    let mut out = viewer::SideMaps::black();
    match kind {
        InteriorSource::Scalars => {
            let (Some(texels), Some(curve)) = (&leaf.loaded.textures[side].gamma_delta, &leaf.loaded.curves[side])
            else {
                return Ok(out);
            };
            let shifted: Vec<[f32; 4]> = texels.iter().map(|t| [t[0], t[1], t[2], t[3] + shift]).collect();
            out.gamma_delta = shrink(&shifted, leaf, mean4);
            out.interior = viewer::Interior::Scalars(slab_curve(curve));
        }
        InteriorSource::Maps => {
            let [rho_d, rho_t] = pigment(leaf, side, ledger)?;
            out.interior =
                viewer::Interior::Maps { rho_d: shrink(&rho_d, leaf, mean3), rho_t: shrink(&rho_t, leaf, mean3) };
        }
    }
    Ok(out)
}

/// ρd and ρt of every texel, computed from σa(x), σs(x) and the thickness; of a stated look what is stated.
///
/// # Errors
/// [`Error::Input`] for a map that cannot be read.
pub fn pigment(leaf: LoadedLeaf, side: Side, ledger: &Ledger) -> Result<[Vec<[f32; 3]>; 2]> {
    let Some(fitted) = &leaf.placed.fitted else { return Ok(Default::default()) };
    let path = fitted.path(LeafFitFile::Maps, side);
    let maps = reader::maps(fitted, side, ledger)?;
    if fitted.is_stated() {
        let planes = maps.require_planes(&path, &[Quantity::RhoD, Quantity::RhoT])?;
        let of = |first: usize| (0..planes[0].len()).map(|k| [0, 1, 2].map(|c| planes[first + c][k])).collect();
        return Ok([of(0), of(3)]);
    }
    let sigma = maps.require_planes(&path, &[Quantity::SigmaA, Quantity::SigmaS])?;
    let thickness = maps.require_scalar(&path, Quantity::Thickness)?;
    let texel = |k: usize| {
        if !(thickness[k] > 0.0 && sigma.iter().all(|p| p[k] >= 0.0 && p[k].is_finite())) {
            return [[f32::NAN; 3]; 2];
        }
        let h = f64::from(thickness[k]);
        let r = [0, 1, 2].map(|c| slab::response(f64::from(sigma[c][k]), f64::from(sigma[3 + c][k]), h));
        [r.map(|r| r.rho_d as f32), r.map(|r| r.rho_t as f32)]
    };
    let solved: Vec<[[f32; 3]; 2]> =
        ledger.note("solve", reader::entry(fitted, &LeafFitFile::Maps.name(side)), 0, || {
            (0..thickness.len()).into_par_iter().map(texel).collect()
        });
    let good: Vec<bool> = solved.iter().map(|t| t.iter().flatten().all(|v| v.is_finite())).collect();
    let mut both = [0, 1].map(|q: usize| solved.iter().map(|t| t[q]).collect::<Vec<_>>());
    filling::require(&path, &mut both, &good, maps.width, maps.height)?;
    Ok(both)
}

/// 1 where the fit found the leaf, in the front's columns. This is for meshes that do not end at the outline.
fn mask(leaf: LoadedLeaf, fitted: &LeafFit, ledger: &Ledger) -> Result<Vec<u8>> {
    let maps = reader::maps(fitted, Side::Front, ledger)?;
    let mask = maps.require_scalar(&fitted.path(LeafFitFile::Maps, Side::Front), Quantity::Mask)?;
    let on: Vec<u8> = mask.iter().map(|v| u8::from(*v != 0.0)).collect();
    Ok(shrink(&on, leaf, |a, b, c, d| u8::from(a + b + c + d >= 2)))
}

/// Averages over blocks of `leaf.plan.block` texels along a side.
fn shrink<T: Copy>(texels: &[T], leaf: LoadedLeaf, join: impl Fn(T, T, T, T) -> T + Copy) -> Vec<T> {
    let ([mut w, mut h], mut out, mut block) = (leaf.plan.size, texels.to_vec(), leaf.plan.block);
    while block > 1 {
        (w, h, out) = halve(&out, w, h, join);
        block /= 2;
    }
    out
}

fn mean4(a: [f32; 4], b: [f32; 4], c: [f32; 4], d: [f32; 4]) -> [f32; 4] {
    [0, 1, 2, 3].map(|k| (a[k] + b[k] + c[k] + d[k]) / 4.0)
}

fn mean3(a: [f32; 3], b: [f32; 3], c: [f32; 3], d: [f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|k| (a[k] + b[k] + c[k] + d[k]) / 4.0)
}
