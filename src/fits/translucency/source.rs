//! The input of a translucency fit: the maps of a leaf fit, brought into the form that the light transport takes.
//!
//! Lengths in mm, σ in 1/mm. Texels without a measurement take the values of their nearest good neighbour, so that no
//! light is lost at a hole in the data. Texels beside the leaf are empty.

use crate::leaf_folder::{LeafFit, LeafFitFile, filling, packing};
use crate::record::RecordSection;
use crate::translucency::{Error, Result};
use mesophyll_files::hash;
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::side::Side;
use mesophyll_optics::translucency::relief;
use std::path::Path;

/// One side's maps, as its own camera saw it, row-major.
#[derive(Debug, Clone)]
pub struct TranslucencySideMaps {
    /// Which side it is.
    pub name: Side,
    /// Diffuse reflectance, 0 to 1, a channel each.
    pub rho_d: [Vec<f32>; 3],
    /// Diffuse transmittance, 0 to 1, a channel each.
    pub rho_t: [Vec<f32>; 3],
    /// Unit normals in the frame that was asked for: x right, y up, z out of this side.
    pub normal: Vec<[f64; 3]>,
    /// Height of the surface over that frame's plane (mm), outward of this side.
    pub height: Vec<f64>,
    /// Root mean square of the slope that no height explains.
    pub slope_residual: f64,
    /// Thickness of the blade (mm), 0 off the leaf.
    pub thickness: Vec<f64>,
    /// Texels on the leaf.
    pub mask: Vec<bool>,
    /// Absorption coefficient (1/mm) of the slab in each channel.
    pub sigma_a: [f64; 3],
    /// Scattering coefficient (1/mm) of each channel.
    pub sigma_s: [f64; 3],
    /// Standard errors (1/mm) of `sigma_a` and `sigma_s`; infinite where nothing is known.
    pub sigma_err: [[f64; 3]; 2],
    /// The leaf fit's statements about coefficients that it did not determine, one sentence each.
    pub undetermined: Vec<String>,
}

/// Blades are some tenths of a millimetre thick. A map far beyond these limits has other units, or is not a map of
/// thickness.
const THICKNESS_MM: std::ops::RangeInclusive<f64> = 1e-6..=1e3;

/// The frame in which directions are stated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DirectionFrame {
    /// The mesh's tangent frame, texel by texel, for a renderer that bends the blade itself.
    Mesh,
    /// The frame of the photographs: the blade as it lay, with its own bend.
    Photograph,
}

/// A leaf whose inside is to be computed.
#[derive(Debug, Clone)]
pub struct TranslucencyLeaf {
    /// The leaf's name, as its fit states it.
    pub name: String,
    /// Columns of every map.
    pub width: usize,
    /// Rows of every map.
    pub height: usize,
    /// Size of a texel on the blade (mm).
    pub texel_mm: f64,
    /// Mean thickness h (mm).
    pub thickness_mm: f64,
    /// The sides that were fitted: the front, or both.
    pub sides: Vec<TranslucencySideMaps>,
    /// Content hash of what was read.
    pub hash: String,
}

impl TranslucencyLeaf {
    /// Reads a folder of `fit leaf`.
    ///
    /// # Errors
    /// [`Error::Input`] for a folder that holds no leaf fit, a map that is missing, damaged or of another size, or a
    /// field that is missing.
    pub fn read(folder: &Path, frame: DirectionFrame) -> Result<TranslucencyLeaf> {
        let leaf = LeafFit::open(folder)?;
        if leaf.is_stated() {
            let what = "is stated, not fitted: a picture says nothing of σa and σs, through which light spreads in a \
                        leaf; expected a folder of fit leaf";
            return Err(Error::field(&leaf.record_path(), "kind", what));
        }
        let texel_mm = leaf.texel_mm()?;
        let mut size = None;
        let mut sides = Vec::new();
        let mut thickness_mm = f64::NAN;
        for name in leaf.sides() {
            thickness_mm = leaf.thickness(name)?;
            sides.push(side(&leaf, name, frame, texel_mm, &mut size)?);
        }
        let Some((width, height)) = size else {
            let what = "missing, and so is back; expected the section of a side";
            return Err(Error::field(&leaf.record_path(), Side::Front.name(), what));
        };
        leaf.record.verify(folder)?;
        let hash = hash::file(&leaf.record_path())?;
        Ok(TranslucencyLeaf { name: leaf.name, width, height, texel_mm, thickness_mm, sides, hash })
    }

    /// The maps of one side, where that side was fitted.
    pub fn side(&self, name: Side) -> Option<&TranslucencySideMaps> {
        self.sides.iter().find(|s| s.name == name)
    }
}

/// Standard error of a channel. An error that is not stated counts as 0.
fn error(section: &RecordSection, name: &str, c: usize) -> f64 {
    section.params.get(name).and_then(|p| p.stderr.get(c).copied()).filter(|e| !e.is_nan()).unwrap_or(0.0)
}

fn side(
    leaf: &LeafFit,
    name: Side,
    frame: DirectionFrame,
    texel_mm: f64,
    size: &mut Option<(usize, usize)>,
) -> Result<TranslucencySideMaps> {
    let path = leaf.path(LeafFitFile::Maps, name);
    let maps = leaf.maps(name)?;
    let (width, height) = *size.get_or_insert((maps.width, maps.height));
    maps.require_size(&path, width, height)?;
    let code = maps.require_scalar(&path, Quantity::Mask)?;
    let mask: Vec<bool> = code.iter().map(|v| *v != 0.0).collect();
    let good: Vec<bool> = code.iter().map(|v| *v == 1.0).collect();
    if !good.contains(&true) {
        return Err(Error::input(&path, "mask.Y marks no texel as good (1); nothing is known of this side"));
    }
    let rgb = |quantity| -> Result<[Vec<f32>; 3]> {
        let mut planes = maps.require_three(&path, quantity)?.map(<[f32]>::to_vec);
        filling::nearest(&mut planes, &good, width, height);
        Ok(planes)
    };
    let seen = match frame {
        DirectionFrame::Mesh => packing::blade_normals(leaf, name, maps)?,
        DirectionFrame::Photograph => packing::normals(&path, maps)?,
    };
    let mut normal = [seen.into_iter().map(|n| unit(n.map(f64::from))).collect::<Vec<[f64; 3]>>()];
    filling::nearest(&mut normal, &good, width, height);
    let [normal] = normal;
    let mut thickness = [maps.require_scalar(&path, Quantity::Thickness)?.to_vec()];
    filling::nearest(&mut thickness, &good, width, height);
    let thickness: Vec<f64> =
        thickness[0].iter().zip(&mask).map(|(v, m)| if *m { f64::from(*v) } else { 0.0 }).collect();
    if let Some(k) = (0..thickness.len()).find(|&k| mask[k] && !(THICKNESS_MM.contains(&thickness[k]))) {
        let (i, j) = (k % width, k / width);
        let found = thickness[k];
        let (low, high) = (THICKNESS_MM.start(), THICKNESS_MM.end());
        return Err(Error::input(
            &path,
            format!("thickness.Y at column {i}, row {j}: found {found}, expected {low} to {high} mm"),
        ));
    }
    let section = leaf.section(name)?;
    let relief = relief::integrate(&normal, &mask, width, height, texel_mm);
    Ok(TranslucencySideMaps {
        name,
        rho_d: rgb(Quantity::RhoD)?,
        rho_t: rgb(Quantity::RhoT)?,
        height: relief.height,
        slope_residual: relief.residual,
        normal,
        thickness,
        mask,
        sigma_a: leaf.rgb(name, Quantity::SigmaA)?,
        sigma_s: leaf.rgb(name, Quantity::SigmaS)?,
        sigma_err: [Quantity::SigmaA, Quantity::SigmaS].map(|q| [0, 1, 2].map(|c| error(section, q.name(), c))),
        undetermined: section.params.values().flat_map(|p| p.undetermined.iter().cloned()).collect(),
    })
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
    // A normal that is not a number, or that points into the leaf, is replaced by the mesh's own.
    if length > 0.0 && length.is_finite() && v[2] > 0.0 { v.map(|c| c / length) } else { [0.0, 0.0, 1.0] }
}
