//! How well a few functions of direction represent the light that a leaf lets through (H7 Fig. 12, H9 Fig. 3.19). On
//! leaves with veins, the reconstruction is compared with the full convolution for a set of light directions. Bases are
//! compared by bytes and multiply-adds, light directions and horizon maps by time.
//!
//! The error is the paper's: f_rec/f − 1 over all texels, at elevations of π/2, π/4 and π/8 over the tangent plane,
//! with eight azimuths each. Bases are projected from many directions, so that the error is that of the basis and not
//! of chance directions. Leaves are grown flat (without fold, droop or waves, which belong to the mesh) and cut to a
//! piece of the lamina with its midrib. As in fits, their heights are integrated from their normals.

mod judge;
mod rows;

pub use judge::{BasisJudge, BasisOutcome};
pub use rows::{PIECES, rows};

use crate::{Error, Result};
use mesophyll_files::progress;
use mesophyll_optics::dipole::Tissue;
use mesophyll_optics::side::{Side, mirror};
use mesophyll_optics::translucency::basis::{HemisphereBasis, SampleWeights};
use mesophyll_optics::translucency::blade::{BladeMaps, SurfaceMaps};
use mesophyll_optics::translucency::lights::DirectionRule;
use mesophyll_optics::translucency::relief;
use mesophyll_synth::leaf::{SyntheticLeaf, SyntheticTexel};
use mesophyll_synth::spec::{InteriorModel, LeafSpec};

/// The directions with which bases are judged.
pub const FINE: DirectionRule = DirectionRule::Product { levels: 16, azimuths: 32 };

/// Texel size of the leaves that are judged (mm): the resolution of the paper's scanner.
pub const TEXEL_MM: f64 = 0.1;

/// One lit side of a piece of leaf, ready to be judged.
pub struct BasisCase {
    /// Name of the leaf and of the lit side.
    pub name: String,
    /// Shape and thickness.
    pub blade: BladeMaps,
    /// The side that the light falls on.
    pub side: Side,
    /// What the blade is made of.
    pub tissue: Tissue,
}

impl BasisCase {
    /// The leaf's name alone.
    pub fn leaf(&self) -> &str {
        self.name.split(',').next().unwrap_or_default()
    }
}

/// A combination that is judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BasisCandidate {
    /// The functions of direction.
    pub basis: HemisphereBasis,
    /// How samples are turned into coefficients.
    pub weights: SampleWeights,
    /// The directions of the samples.
    pub lights: DirectionRule,
}

impl BasisCandidate {
    /// Its name in rows and legends.
    pub fn name(&self) -> String {
        let weights = match self.weights {
            SampleWeights::Gram => "",
            SampleWeights::Plain => ", plain sums",
        };
        format!("{}{weights}", self.basis.name())
    }
}

/// A piece of a leaf of the size `size_mm` around `centre_mm` of its field (x right, y up from the middle), with texels
/// of `texel_mm`.
///
/// # Errors
/// [`Error::Missed`] when nothing of the leaf lies there.
pub fn piece(spec: &LeafSpec, texel_mm: f64, centre_mm: [f64; 2], size_mm: [f64; 2]) -> Result<BladeMaps> {
    let mut spec = spec.clone();
    (spec.relief.fold_deg, spec.relief.droop_mm, spec.relief.wave_mm) = (0.0, 0.0, 0.0);
    // Only the piece is grown: its field is the leaf's field, cut to it.
    let [w, h] = spec.field_mm.map(|f| (f / texel_mm).round() as usize);
    let missing = || Error::Missed(format!("{}: no leaf at {centre_mm:?} mm", spec.name));
    let leaf = SyntheticLeaf::grow(&spec, InteriorModel::Exact, w, h).ok_or_else(missing)?;
    let [cw, ch] = size_mm.map(|s| (s / texel_mm).round() as usize);
    let left = ((0.5 * spec.field_mm[0] + centre_mm[0] - 0.5 * size_mm[0]) / texel_mm).round().max(0.0) as usize;
    let top = ((0.5 * spec.field_mm[1] - centre_mm[1] - 0.5 * size_mm[1]) / texel_mm).round().max(0.0) as usize;
    if left + cw > w || top + ch > h {
        return Err(missing());
    }
    // The back's maps are brought into the front's columns, cut, and turned back.
    let cut = |k: usize| (top + k / cw) * w + left + k % cw;
    let n = cw * ch;
    let mask: Vec<bool> = (0..n).map(|k| leaf.mask[cut(k)]).collect();
    if !mask.contains(&true) {
        return Err(missing());
    }
    let part =
        |side: Side| -> Vec<SyntheticTexel> { (0..n).map(|k| leaf.sides[side][side.in_front(cut(k), w)]).collect() };
    let (front, back) = (part(Side::Front), mirror(&part(Side::Back), cw));
    let thickness = front.iter().map(|t| f64::from(t.thickness)).collect();
    let surface = |texels: &[SyntheticTexel], mask: &[bool]| {
        let normal: Vec<[f64; 3]> = texels
            .iter()
            .zip(mask)
            .map(|(t, on)| if *on { t.normal.map(f64::from) } else { [0.0, 0.0, 1.0] })
            .collect();
        let entry = texels.iter().map(|t| 1.0 - f64::from(t.rho_d[1])).collect();
        SurfaceMaps { height: relief::heights(&normal, mask, cw, ch, texel_mm), normal, entry }
    };
    let (front, back) = (surface(&front, &mask), surface(&back, &mirror(&mask, cw)));
    Ok(BladeMaps { width: cw, height: ch, texel_mm: leaf.texel_mm, mask, thickness, front, back })
}

/// The bases that are tried, in order of the size that they store, and the paper's own way of projecting.
pub fn candidates() -> Vec<BasisCandidate> {
    let mut list: Vec<BasisCandidate> = [
        HemisphereBasis::HalfLife2,
        HemisphereBasis::Bent { count: 3 },
        HemisphereBasis::Cosine { degree: 2 },
        HemisphereBasis::HBasis { count: 4 },
        HemisphereBasis::Hemispherical { bands: 2 },
        HemisphereBasis::HBasis { count: 6 },
        HemisphereBasis::Cosine { degree: 3 },
        HemisphereBasis::Bent { count: 6 },
        HemisphereBasis::Spherical { bands: 3 },
        HemisphereBasis::Hemispherical { bands: 3 },
    ]
    .map(|basis| BasisCandidate { basis, weights: SampleWeights::Gram, lights: FINE })
    .into();
    list.push(BasisCandidate {
        basis: HemisphereBasis::HalfLife2,
        weights: SampleWeights::Plain,
        lights: DirectionRule::default(),
    });
    list
}

/// Pieces of elm and balata lit on either side, in their own green tissue and in the paper's.
///
/// # Errors
/// Damaged specifications.
pub fn cases(texel_mm: f64) -> Result<Vec<BasisCase>> {
    let mut list = Vec::new();
    for (text, centre, size) in [
        (include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/leaves/elm.toml")), [2.0, 2.0], [14.0, 12.0]),
        (include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/leaves/balata.toml")), [2.0, 3.0], [14.0, 12.0]),
    ] {
        let spec: LeafSpec = text.parse().map_err(|e: toml::de::Error| Error::Missed(e.to_string()))?;
        let blade = piece(&spec, texel_mm, centre, size)?;
        let own = Tissue { sigma_a: spec.interior.sigma_a[1], sigma_s: spec.interior.sigma_s[1], g: 0.0, a: 1.0 };
        for (name, tissue) in [("own tissue", own), ("H9's tissue", PAPER_TISSUE)] {
            for side in [Side::Front, Side::Back] {
                let name = format!("{}, {} lit, {name}", spec.name, side.name());
                list.push(BasisCase { name, blade: blade.clone(), side, tissue });
            }
        }
    }
    Ok(list)
}

/// The bases that are drawn side by side: the sources' own sums over 128 random directions, the same functions with
/// their Gram matrix, three functions of the bent light, and nine hemispherical harmonics.
pub fn drawn() -> [BasisCandidate; 4] {
    let fine = |basis| BasisCandidate { basis, weights: SampleWeights::Gram, lights: FINE };
    [
        BasisCandidate {
            basis: HemisphereBasis::HalfLife2,
            weights: SampleWeights::Plain,
            lights: DirectionRule::default(),
        },
        fine(HemisphereBasis::HalfLife2),
        fine(HemisphereBasis::Bent { count: 3 }),
        fine(HemisphereBasis::Hemispherical { bands: 3 }),
    ]
}

/// [`drawn`] on every leaf and side, a row of outcomes each, in the paper's tissue: what H7 Fig. 12 shows.
///
/// # Errors
/// As [`cases`]; [`Error::Interrupted`].
pub fn histograms() -> Result<Vec<Vec<BasisOutcome>>> {
    let mut all = Vec::new();
    for case in cases(TEXEL_MM)?.iter().filter(|c| c.tissue == PAPER_TISSUE) {
        progress::go_on()?;
        let judge = BasisJudge::new(case)?;
        all.push(drawn().into_iter().map(|candidate| judge.judge(candidate)).collect::<Result<_>>()?);
    }
    Ok(all)
}

/// H9 Table 3.1, with a diffuse reflectance of .1.
const PAPER_TISSUE: Tissue = Tissue { sigma_a: 0.4, sigma_s: 10.2, g: 0.07, a: 1.1 / 0.9 };

#[cfg(test)]
mod tests {
    use super::*;

    fn elm() -> LeafSpec {
        include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/leaves/elm.toml")).parse().unwrap()
    }

    /// The heights that fits use are integrated from normals; they give these normals back.
    #[test]
    fn heights_and_normals_agree() {
        let blade = piece(&elm(), 0.2, [2.0, 2.0], [9.0, 8.0]).unwrap();
        let again = relief::normals(
            &blade.back.height,
            &mirror(&blade.mask, blade.width),
            blade.width,
            blade.height,
            blade.texel_mm,
        );
        let off: f64 =
            again.iter().zip(&blade.back.normal).map(|(a, b)| (0..2).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>()).sum();
        let size: f64 = blade.back.normal.iter().map(|n| n[0] * n[0] + n[1] * n[1]).sum();
        // Two central differences, one after the other, blur veins of a few texels.
        assert!(off < 0.25 * size, "{off} of {size}");
        assert!(piece(&elm(), 0.5, [30.0, 26.0], [4.0, 4.0]).is_err(), "off the field");
    }
}
