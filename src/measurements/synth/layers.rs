//! A leaf made of layers as the truth of a synthetic scan (`docs/foliar.md`): the pigments of each place, and the
//! diffuse reflectance R and transmittance T that the exact method of `mesophyll_optics::foliar` gives for it.
//!
//! R and T depend only on the absorption of one crossing of the mesophyll. So they are tabulated over it for each
//! channel and interpolated. The error is 1e-6 for absorptions from .02 to 4, and 3e-5 from 0 to [`DEEPEST`].

use super::slab_truth::ChebyshevAxis;
use crate::{Error, Result};
use mesophyll_base::rgb::Rgb;
use mesophyll_capture::pigments;
use mesophyll_optics::foliar::exact::{self, LeafOperator};
use mesophyll_optics::foliar::pigments::{LeafContents, OpticalConstants};
use mesophyll_optics::foliar::{LayeredLeaf, MesophyllPath, Oblateness};
use mesophyll_optics::side::{Side, Sides};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// What a leaf holds per area, as the specification names it.
const CONTENTS: [&str; 5] =
    ["chlorophyll_ug_cm2", "carotenoid_ug_cm2", "protein_ug_cm2", "cellulose_lignin_ug_cm2", "water_g_cm2"];
/// A larger content is more likely a typing error than a leaf.
const MOST_CONTENT: f64 = 1e5;
/// With more absorption in one crossing of the mesophyll, nothing measurable comes through.
const DEEPEST: f64 = 20.0;

/// Whether a place that is thicker than others holds more.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ContentScaling {
    /// Contents per leaf area do not depend on the thickness of a place.
    #[default]
    Area,
    /// A place that is twice as thick as the mean holds twice as much.
    Volume,
}

/// How a leaf of layers is stated: the table `[foliar]` of a specification. Contents are those of the lamina per area
/// (µg/cm², water g/cm²).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FoliarSpec {
    /// Table of specific absorptions and refractive indices; relative to the specification.
    pub pigments: PathBuf,
    /// Wavelengths of red, green and blue (nm).
    #[serde(default = "wavelengths")]
    pub wavelengths_nm: [f64; 3],
    /// Whether thicker places hold more.
    #[serde(default)]
    pub per: ContentScaling,
    /// Chlorophyll of the lamina; veins hold less.
    #[serde(default)]
    pub chlorophyll_ug_cm2: f64,
    /// Carotenoids.
    #[serde(default)]
    pub carotenoid_ug_cm2: f64,
    /// Protein.
    #[serde(default)]
    pub protein_ug_cm2: f64,
    /// Cellulose and lignin.
    #[serde(default)]
    pub cellulose_lignin_ug_cm2: f64,
    /// Water.
    #[serde(default)]
    pub water_g_cm2: f64,
    /// Of cuticle, epidermis, palisade and spongy tissue.
    #[serde(default = "oblateness")]
    pub oblateness: [f64; 4],
    /// How long a crossing of the mesophyll is.
    pub path: MesophyllPath,
    /// The table at the three wavelengths, once it is read.
    #[serde(skip)]
    constants: Vec<OpticalConstants>,
}

fn wavelengths() -> [f64; 3] {
    [650.0, 550.0, 450.0]
}

fn oblateness() -> [f64; 4] {
    let Oblateness { cuticle, epidermis, palisade, spongy } = Oblateness::USUAL;
    [cuticle, epidermis, palisade, spongy]
}

/// Absorptions of one crossing at which the exact method must converge for a leaf: clear, green and black.
const SETTLES_AT: [f64; 3] = [0.01, 0.3, 3.0];

impl FoliarSpec {
    /// Reads the table of pigments, and refuses numbers that are no leaf.
    ///
    /// # Errors
    /// What is wrong with the specification or with the table, by file and field.
    pub fn read(&mut self, spec: &std::path::Path) -> Result<()> {
        let bad = |field: &str, found: String, expected: &str| {
            Err(Error::unexpected(spec, &format!("foliar.{field}"), found, expected))
        };
        for (name, content) in CONTENTS.iter().zip(self.per_area()) {
            if !(0.0..=MOST_CONTENT).contains(&content) {
                return bad(name, content.to_string(), &format!("0 to {MOST_CONTENT}"));
            }
        }
        if let Some(x) = self.oblateness.iter().find(|x| !(**x >= 0.0 && x.is_finite())) {
            return bad("oblateness", x.to_string(), "four numbers of 0 or more");
        }
        if let Some(parent) = spec.parent() {
            self.pigments = parent.join(&self.pigments);
        }
        let spectrum = pigments::read(&self.pigments)?;
        for wavelength in self.wavelengths_nm {
            let Some(constants) = spectrum.at(wavelength) else {
                let [low, high] = spectrum.range();
                return bad("wavelengths_nm", wavelength.to_string(), &format!("{low} to {high}, as in the table"));
            };
            self.constants.push(constants);
        }
        for c in 0..3 {
            let depth = self.held(1.0, 1.0, 1.0).depth[c];
            if depth > DEEPEST {
                let found = format!("contents that absorb {depth:.3} in one crossing at {} nm", self.wavelengths_nm[c]);
                return Err(Error::unexpected(spec, "foliar", found, format!("at most {DEEPEST}")));
            }
            let leaf = self.leaf(c);
            if let Some(fault) = leaf.as_ref().and_then(LayeredLeaf::fault) {
                return Err(Error::field(spec, "foliar", fault));
            }
            if leaf.and_then(|leaf| exact::prepared(&leaf, &SETTLES_AT, &lights(1.0))).is_none() {
                let what = "the exact method does not settle for such lobes and indices; expected wider lobes";
                return Err(Error::field(spec, "foliar", what));
            }
        }
        Ok(())
    }

    /// The contents in the order of [`CONTENTS`].
    fn per_area(&self) -> [f64; 5] {
        [
            self.chlorophyll_ug_cm2,
            self.carotenoid_ug_cm2,
            self.protein_ug_cm2,
            self.cellulose_lignin_ug_cm2,
            self.water_g_cm2,
        ]
    }

    /// The layers at a channel's wavelength; `None` before [`FoliarSpec::read`].
    fn leaf(&self, c: usize) -> Option<LayeredLeaf> {
        let [n_cuticle, n_mesophyll, n_antidermal] = self.constants.get(c)?.indices;
        let [cuticle, epidermis, palisade, spongy] = self.oblateness;
        let oblateness = Oblateness { cuticle, epidermis, palisade, spongy };
        Some(LayeredLeaf { depth: 0.0, n_cuticle, n_mesophyll, n_antidermal, oblateness, path: self.path })
    }

    /// What a place contains per area and absorbs. `chlorophyll` and `carotenoid` are relative to the lamina's,
    /// `thickness` is relative to the mean.
    pub(super) fn held(&self, chlorophyll: f64, carotenoid: f64, thickness: f64) -> Held {
        let scale = if self.per == ContentScaling::Volume { thickness } else { 1.0 };
        let mut per_area = self.per_area().map(|x| x * scale);
        per_area[0] *= chlorophyll;
        per_area[1] *= carotenoid;
        // The truth's maps are in single precision, so the leaf is solved for the values that they hold.
        let [chlorophyll, carotenoid] = [0, 1].map(|k| per_area[k] as f32);
        per_area[0] = f64::from(chlorophyll);
        per_area[1] = f64::from(carotenoid);
        let contents = LeafContents { per_area, scale: 1.0 };
        let depth = Rgb::of(|c| self.constants.get(c).map_or(0.0, |constants| constants.depth(&contents)));
        Held { chlorophyll, carotenoid, depth }
    }

    /// R and T of a channel for absorptions of one crossing in `range`. `oblique` is the cosine of the light box's
    /// camera. `None` before [`FoliarSpec::read`], and where the method does not converge.
    pub(super) fn table(&self, c: usize, oblique: f64, range: [f64; 2]) -> Option<Table> {
        let axis = ChebyshevAxis::new(range.map(bent), NODES);
        let depths: Vec<f64> = axis.nodes.iter().map(|t| BEND * t * t / (1.0 - t * t)).collect();
        let lights = lights(oblique);
        let leaf = self.leaf(c)?;
        let prepared = exact::prepared(&leaf, &range, &lights)?;
        let values = depths.par_iter().map(|d| seen(&prepared, *d, &lights)).collect();
        Some(Table { axis, values })
    }
}

/// What a place holds per area (µg/cm²), and the absorption of one crossing of its mesophyll, a channel each.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Held {
    pub chlorophyll: f32,
    pub carotenoid: f32,
    pub depth: Rgb,
}

/// The lights: for both sides along the normal, and at the cosine of the light box's camera.
fn lights(oblique: f64) -> [(Side, f64); 4] {
    let [a, b] = [Side::Front, Side::Back];
    [(a, 0.0), (b, 0.0), (a, oblique.acos()), (b, oblique.acos())]
}

/// What one side of a place shows: shares of the light, without what the surface mirrors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Seen {
    /// Diffuse reflectance of a beam along the normal.
    pub rho_d: f64,
    /// Transmittance of a beam along the normal.
    pub rho_t: f64,
    /// Transmittance of a beam at the angle of the light box's camera.
    pub through: f64,
}

/// Both sides; the front is the upper one.
fn seen(prepared: &LeafOperator, depth: f64, lights: &[(Side, f64); 4]) -> Sides<Seen> {
    let solved = prepared.solve(depth);
    let found = lights.map(|(side, at)| solved.response(side, at));
    let of = |k: usize| Seen {
        rho_d: found[k].reflectance - prepared.leaf().surface_reflectance(0.0),
        rho_t: found[k].transmittance,
        through: found[k + 2].transmittance,
    };
    Sides { front: of(0), back: of(1) }
}

/// Number of nodes over √(d/(d + [`BEND`])), where d is the absorption of one crossing. With slant paths R and T behave
/// like d·ln d near 0; as functions of the root they are smooth enough for polynomials.
const NODES: usize = 26;
const BEND: f64 = 0.4;

fn bent(depth: f64) -> f64 {
    (depth / (depth + BEND)).sqrt()
}

/// Both sides of a channel over the absorption of one crossing.
pub(super) struct Table {
    axis: ChebyshevAxis,
    values: Vec<Sides<Seen>>,
}

impl Table {
    pub fn at(&self, depth: f64) -> Sides<Seen> {
        let weights = self.axis.at(bent(depth));
        Sides::of(|side| {
            let sum = |of: fn(&Seen) -> f64| weights.iter().zip(&self.values).map(|(w, v)| w * of(&v[side])).sum();
            // Interpolation may give less than 0 where almost nothing comes through.
            let share = |of| f64::max(sum(of), 0.0);
            Seen { rho_d: share(|s| s.rho_d), rho_t: share(|s| s.rho_t), through: share(|s| s.through) }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stated(path: MesophyllPath) -> FoliarSpec {
        let constants = [[1.5, 1.42, 1.41], [1.51, 1.42, 1.41], [1.53, 1.43, 1.42]]
            .map(|indices| OpticalConstants { specific: [3e4, 1e4, 9.0, 4.0, 1e-4], indices });
        FoliarSpec {
            pigments: PathBuf::new(),
            wavelengths_nm: wavelengths(),
            per: ContentScaling::Area,
            chlorophyll_ug_cm2: 40.0,
            carotenoid_ug_cm2: 10.0,
            protein_ug_cm2: 0.0,
            cellulose_lignin_ug_cm2: 0.0,
            water_g_cm2: 0.0,
            oblateness: oblateness(),
            path,
            constants: constants.to_vec(),
        }
    }

    /// Between the nodes, from veins to the deepest green, the table agrees with the method itself, and all light is
    /// accounted for.
    #[test]
    fn the_table_is_the_exact_method() {
        for path in [MesophyllPath::Sieve, MesophyllPath::Slant] {
            let foliar = stated(path);
            let cosine = 40f64.to_radians().cos();
            let usual = (foliar.table(1, cosine, [0.02, 4.0]).unwrap(), 1e-6);
            let widest = (foliar.table(1, cosine, [0.0, DEEPEST]).unwrap(), 3e-5);
            let wide = [0.0, 1e-4, 3e-3, 0.017, 0.08, 0.6, 1.7, 5.0, 11.0, DEEPEST].map(|d| (d, &widest));
            let narrow = [0.02, 0.0313, 0.11, 0.37, 0.9, 2.3, 3.7].map(|d| (d, &usual));
            for (depth, (table, tabulated)) in wide.into_iter().chain(narrow) {
                let leaf = LayeredLeaf { depth, ..foliar.leaf(1).unwrap() };
                let lights = [(Side::Front, 0.0), (Side::Back, 0.0), (Side::Back, 40f64.to_radians())];
                let want = exact::responses(&leaf, &lights).unwrap();
                let got = table.at(depth);
                for ((side, got), want) in got.iter().zip(&want) {
                    let lost =
                        [got.rho_d + leaf.surface_reflectance(0.0) - want.reflectance, got.rho_t - want.transmittance];
                    println!("{path:?} {depth} {side}: {lost:?}");
                    assert!(lost.iter().all(|e| e.abs() < *tabulated), "{path:?} {depth} {side}: {lost:?}");
                }
                assert!((got.back.through - want[2].transmittance).abs() < *tabulated);
            }
        }
    }

    #[test]
    fn contents_absorb_by_area_or_by_volume() {
        let mut foliar = stated(MesophyllPath::Sieve);
        let of = |foliar: &FoliarSpec| foliar.held(0.5, 2.0, 3.0);
        // 20 µg/cm² of 3e4 cm²/g and 20 µg/cm² of 1e4 cm²/g
        assert!((of(&foliar).depth[0] - 0.8).abs() < 1e-6);
        foliar.per = ContentScaling::Volume;
        let held = of(&foliar);
        assert!((held.depth[0] - 2.4).abs() < 1e-6 && held.chlorophyll == 60.0 && held.carotenoid == 60.0);
    }
}
