//! Leaves that are stated by the layered model of B1 (`docs/foliar.md`). The path tracer draws them. The real-time
//! renderer shows a leaf with gloss in place of each ([`mesophyll_transport::foliar::MatteLeaf`]).

use super::leaf::LeafOrigin;
use super::uniform::UniformLeaf;
use crate::manifest::{Error, Result};
use mesophyll_fits::foliar::pigments;
use mesophyll_optics::foliar::pigments::LeafContents;
use mesophyll_optics::foliar::{LayeredLeaf as Layers, MesophyllPath, Oblateness, fsm};
use mesophyll_optics::gloss::LobeKind;
use mesophyll_transport::foliar::{FoliarMaterial, FoliarModel, MatteLeaf};
use serde::Deserialize;
use std::path::PathBuf;
use std::sync::Arc;

/// The layers of a leaf, as the scene file states them.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StatedLayers {
    /// `fsm` uses a table and lobes; `abm` follows rays through the layers, which is slow.
    pub model: FoliarModel,
    /// Absorption of one crossing of the mesophyll for red, green and blue (no unit). Pigments may be given instead.
    pub absorption: Option<[f64; 3]>,
    /// Table of specific absorptions and refractive indices. The pigment contents then determine the absorption.
    pub pigments: Option<PathBuf>,
    /// Wavelengths that represent red, green and blue (nm).
    pub wavelengths_nm: [f64; 3],
    pub chlorophyll_ug_cm2: f64,
    pub carotenoid_ug_cm2: f64,
    pub protein_ug_cm2: f64,
    pub cellulose_lignin_ug_cm2: f64,
    pub water_g_cm2: f64,
    /// Refractive indices of cuticle, mesophyll and antidermal wall; when absent, those of the table, or soybean's
    /// without a table.
    pub indices: Option<[f64; 3]>,
    /// Oblateness of the cells of cuticle, epidermis, palisade and spongy tissue.
    pub oblateness: [f64; 4],
    /// How the light's path through the mesophyll is computed: `slant` or `sieve`.
    pub path: String,
    /// How the chlorophyll content falls with time; it is constant when absent.
    pub fades_to: Option<AutumnFade>,
}

/// Autumn: the chlorophyll content falls exponentially with time, from the leaf's own value at 0 s to the value here.
/// Then it stays constant.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AutumnFade {
    /// Content at the end (µg/cm²), above 0.
    pub chlorophyll_ug_cm2: f64,
    /// Time at which the end is reached (s of a film), above 0.
    pub at_s: f64,
}

/// What a leaf of layers absorbs by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WhatAbsorbs {
    /// The absorption of one crossing of each channel.
    Absorption([f64; 3]),
    /// Contents, in the order of [`mesophyll_optics::foliar::pigments::SUBSTANCES`].
    Contents {
        /// How much there is of each: µg/cm² of the first four, g/cm² of water.
        amounts: [f64; 5],
        /// What one unit of each adds to the absorption of one crossing of each channel.
        per_content: [[f64; 5]; 3],
    },
}

impl StatedLayers {
    fn amounts(&self) -> [f64; 5] {
        [
            self.chlorophyll_ug_cm2,
            self.carotenoid_ug_cm2,
            self.protein_ug_cm2,
            self.cellulose_lignin_ug_cm2,
            self.water_g_cm2,
        ]
    }

    /// The chlorophyll content at a time (s), in µg/cm².
    fn chlorophyll(&self, time_s: f64) -> f64 {
        let first = self.chlorophyll_ug_cm2;
        self.fades_to
            .map_or(first, |last| first * (last.chlorophyll_ug_cm2 / first).powf((time_s / last.at_s).clamp(0.0, 1.0)))
    }

    /// What is wrong with the stated end, if anything is.
    fn fading_fault(&self) -> Option<String> {
        let AutumnFade { chlorophyll_ug_cm2: last, at_s } = self.fades_to?;
        let first = self.chlorophyll_ug_cm2;
        if self.pigments.is_none() {
            return Some("fades_to: given without a table of pigments, which says what chlorophyll absorbs".into());
        }
        if !(last > 0.0 && last <= first) {
            return Some(format!(
                "fades_to: found chlorophyll_ug_cm2 = {last}, expected above 0 and at most the leaf's own, {first}"
            ));
        }
        (!(at_s > 0.0 && at_s.is_finite())).then(|| format!("fades_to: found at_s = {at_s}, expected above 0"))
    }
}

impl Default for StatedLayers {
    fn default() -> StatedLayers {
        let Oblateness { cuticle, epidermis, palisade, spongy } = Oblateness::USUAL;
        StatedLayers {
            model: FoliarModel::Fsm,
            absorption: None,
            pigments: None,
            wavelengths_nm: fsm::WAVELENGTHS,
            chlorophyll_ug_cm2: 0.0,
            carotenoid_ug_cm2: 0.0,
            protein_ug_cm2: 0.0,
            cellulose_lignin_ug_cm2: 0.0,
            water_g_cm2: 0.0,
            indices: None,
            oblateness: [cuticle, epidermis, palisade, spongy],
            path: "slant".into(),
            fades_to: None,
        }
    }
}

impl super::SceneManifest {
    /// Whether any leaf changes its colour with time.
    pub fn fades(&self) -> bool {
        self.leaves.iter().any(|l| l.layered().is_some_and(|l| l.stated.fades_to.is_some()))
    }

    /// Gives all leaves that fade their colour at a time (s).
    ///
    /// # Errors
    /// As [`super::SceneManifest::read`].
    pub fn age(&mut self, time_s: f64) -> Result<()> {
        self.layer(time_s, true)?;
        self.share();
        Ok(())
    }

    /// Computes the leaves that are stated by layers as they are at a time (s), and the leaves that other renderers
    /// draw in their place. With `fading`, only leaves that fade are computed.
    pub(super) fn layer(&mut self, time_s: f64, fading: bool) -> Result<()> {
        for k in 0..self.leaves.len() {
            let Some(mut stated) = self.leaves[k].layered().map(|l| l.stated.clone()) else { continue };
            if self.leaves[k].like.is_some() || fading && stated.fades_to.is_none() {
                continue;
            }
            let fault =
                |what: String| Error::field(&self.path, &format!("leaf \"{}\", foliar", self.leaves[k].name), what);
            if let Some(what) = stated.fading_fault() {
                return Err(fault(what));
            }
            if stated.fades_to.is_some() && self.transfer.is_some() {
                let what = "fades_to: given beside [transfer], where light between leaves is worked out for one colour \
                            of each; expected one of the two";
                return Err(fault(what.into()));
            }
            stated.chlorophyll_ug_cm2 = stated.chlorophyll(time_s);
            let layers = self.layers(&stated, &fault)?;
            let model = stated.model;
            if model == FoliarModel::Abm && self.sun.as_ref().is_some_and(|s| s.radius_deg == 0.0) {
                let what = "model: found abm under a sun of radius 0, which random rays never hit; expected fsm, or a \
                            sun with a radius_deg above 0";
                return Err(fault(what.into()));
            }
            let foliar = FoliarMaterial::new(model, layers).ok_or_else(|| {
                fault("the exact method does not settle for such lobes and indices; expected wider lobes".into())
            })?;
            let MatteLeaf { rho_d, rho_t, rho_s, m, index } = foliar.stand_in();
            let leaf = &mut self.leaves[k];
            (leaf.lobe, leaf.index) = (LobeKind::CookTorrance, Some(index));
            if let LeafOrigin::Layered(layered) = &mut leaf.origin {
                let stand_in = UniformLeaf { rho_d, rho_t, rho_s: Some(rho_s), m, slab: None, spectrum: None };
                layered.made = Some((Arc::new(foliar), stand_in));
            }
        }
        Ok(())
    }

    /// What the leaf absorbs by.
    ///
    /// # Errors
    /// A table of pigments that cannot be read.
    pub fn absorbed_by(&self, stated: &StatedLayers) -> Result<WhatAbsorbs> {
        let (Some(table), None) = (&stated.pigments, &stated.absorption) else {
            return Ok(WhatAbsorbs::Absorption(stated.absorption.unwrap_or_default()));
        };
        let spectrum = pigments::read(&self.resolve(table))?;
        // The table was found to have these wavelengths when the leaf was made.
        let per = stated.wavelengths_nm.map(|w| spectrum.at(w).map_or([0.0; 5], |constants| constants.per_content()));
        Ok(WhatAbsorbs::Contents { amounts: stated.amounts(), per_content: per })
    }

    /// The layers at the wavelengths that represent red, green and blue.
    fn layers(&self, stated: &StatedLayers, fault: &dyn Fn(String) -> Error) -> Result<[Layers; 3]> {
        let path: MesophyllPath = stated
            .path
            .parse()
            .map_err(|_| fault(format!("path: found \"{}\", expected slant or sieve", stated.path)))?;
        let [cuticle, epidermis, palisade, spongy] = stated.oblateness;
        let oblateness = Oblateness { cuticle, epidermis, palisade, spongy };
        let soybean = Layers::soybean(0.0);
        let usual = [soybean.n_cuticle, soybean.n_mesophyll, soybean.n_antidermal];
        let amounts = stated.amounts();
        if let Some(x) = amounts.iter().find(|x| !(**x >= 0.0 && x.is_finite())) {
            return Err(fault(format!("a content is {x}; expected 0 or more")));
        }
        let of = |depth: f64, [n_cuticle, n_mesophyll, n_antidermal]: [f64; 3]| -> Result<Layers> {
            let leaf = Layers { depth, n_cuticle, n_mesophyll, n_antidermal, oblateness, path };
            leaf.fault().map_or(Ok(leaf), |what| Err(fault(what)))
        };
        let mut layers = [soybean; 3];
        match (&stated.absorption, &stated.pigments) {
            (Some(absorption), None) => {
                for (leaf, depth) in layers.iter_mut().zip(absorption) {
                    *leaf = of(*depth, stated.indices.unwrap_or(usual))?;
                }
            }
            (None, Some(table)) => {
                let spectrum = pigments::read(&self.resolve(table))?;
                for (leaf, wavelength) in layers.iter_mut().zip(stated.wavelengths_nm) {
                    let [low, high] = spectrum.range();
                    let constants = spectrum.at(wavelength).ok_or_else(|| {
                        fault(format!("wavelengths_nm: found {wavelength}, the table of pigments has {low} to {high}"))
                    })?;
                    let depth = constants.depth(&LeafContents { per_area: amounts, scale: 1.0 });
                    *leaf = of(depth, stated.indices.unwrap_or(constants.indices))?;
                }
            }
            _ => return Err(fault("expected one of absorption and pigments".into())),
        }
        Ok(layers)
    }
}
