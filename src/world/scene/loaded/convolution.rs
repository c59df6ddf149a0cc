//! How sunlight passes through a leaf that has translucency maps, for the reference renderer: one map for each lit side
//! and sun, by the **full convolution** for that very sun. Blades are curved, so the sun has another direction in each
//! texel's tangent frame. Neither a directional basis nor the maps themselves are used, but the data that `fit.toml`
//! names as their source.

use super::LoadedLeaf;
use super::translucency::TranslucencyQuantity;
use crate::{Error, Result};
use glam::DVec3;
use mesophyll_fits::leaf_folder::filling;
use mesophyll_fits::leaf_folder::frames;
use mesophyll_fits::record::FitRecord;
use mesophyll_fits::translucency::recipe::{TranslucencyRecipe, tissue};
use mesophyll_fits::translucency::source::{DirectionFrame, TranslucencyLeaf};
use mesophyll_fits::translucency::{TranslucencyColour, colour, side};
use mesophyll_optics::dipole::{DipoleForm, Tissue};
use mesophyll_optics::side::{Side, Sides};
use mesophyll_optics::translucency::basis::{HemisphereBasis, Projector, SampleWeights};
use mesophyll_optics::translucency::blade::SurfaceMaps;
use mesophyll_optics::translucency::convolution::{ConvolutionSettings, Convolver, TotalsSource};
use mesophyll_optics::translucency::horizon::Horizon;
use mesophyll_optics::translucency::irradiance::{Visibility, irradiance_with, project};
use mesophyll_optics::translucency::levels::ThicknessLevels;
use mesophyll_optics::translucency::lights::{DirectionRule, DirectionSet};
use mesophyll_transport::SunlitMaps;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// Number of thickness levels, twice that of a fit.
const LEVELS: usize = 16;
/// Directions of the light from everywhere, by which the measured colour is divided.
const AROUND: DirectionRule = DirectionRule::Product { levels: 16, azimuths: 48 };

/// The interior of one leaf, ready for any sun.
#[derive(Debug)]
pub struct LeafInterior {
    /// Tangent, upward direction of the image, and normal at every texel of the front's maps.
    frames: Vec<[DVec3; 3]>,
    width: usize,
    ways: Sides<OnceLock<Way>>,
}

/// The way in which the reference computes light that enters one side.
#[derive(Debug)]
enum Way {
    Convolved(Box<Convolved>),
    /// The maps do not state how they were made. So the basis itself is used, with the sun in every texel's frame.
    AsTheyAre,
}

/// One lit side and the tissue behind it.
#[derive(Debug)]
struct Convolved {
    source: TranslucencyLeaf,
    /// Index in `source.sides`.
    at: usize,
    horizon: Horizon,
    channels: Vec<Channel>,
    colour: TranslucencyColour,
}

#[derive(Debug)]
struct Channel {
    surface: SurfaceMaps,
    convolver: Convolver,
    /// ∫ M dω.
    total: Vec<f64>,
}

impl Convolved {
    /// # Errors
    /// [`Error::Input`] for a `fit.toml` that contradicts itself or a leaf fit that cannot be read.
    fn new(leaf: &Path, maps: &Path, record: &FitRecord, lit: Side) -> Result<Option<Convolved>> {
        let Some(TranslucencyRecipe { colour, entry, area, form, channels }) = TranslucencyRecipe::read(record, maps)?
        else {
            return Ok(None);
        };
        let source = TranslucencyLeaf::read(leaf, DirectionFrame::Mesh)?;
        let Some(at) = source.sides.iter().position(|x| x.name == lit) else { return Ok(None) };
        let plain = side::surface(&source.sides[at], channels[0], entry, area);
        let horizon = Horizon::new(&side::lit(&source, &source.sides[at], &plain));
        let mut out = Convolved { source, at, horizon, channels: Vec::new(), colour };
        for (k, c) in channels.into_iter().enumerate() {
            let tissue = tissue(record, maps, lit, k)?;
            out.channels.push(out.channel(c, side::surface(&out.source.sides[at], c, entry, area), form, tissue)?);
        }
        Ok(Some(out))
    }

    fn channel(&self, c: usize, surface: SurfaceMaps, form: DipoleForm, tissue: Tissue) -> Result<Channel> {
        let of = &self.source.sides[self.at];
        let slab = tissue.sigma_a == of.sigma_a[c] && tissue.sigma_s == of.sigma_s[c] && tissue.g == 0.0;
        let settings = ConvolutionSettings {
            form,
            levels: ThicknessLevels { count: LEVELS, ..ThicknessLevels::default() },
            totals: if slab { TotalsSource::Transport } else { TotalsSource::Form },
            ..ConvolutionSettings::new(tissue, self.source.texel_mm)
        };
        let on = of.thickness.iter().zip(&of.mask).filter(|(_, m)| **m).map(|(d, _)| *d);
        let (thin, thick) = on.fold((f64::INFINITY, 0f64), |(a, b), d| (a.min(d), b.max(d)));
        let convolver = Convolver::with(&settings, self.source.width, self.source.height, thin, thick)?;
        // One function that is 1 everywhere gives the light from all around.
        let lights = DirectionSet::new(AROUND);
        let mut projector =
            Projector::new(HemisphereBasis::HalfLife2, &lights, SampleWeights::Gram).map_err(Error::Usage)?;
        projector.matrix = vec![lights.weights.clone()];
        let lit = side::lit(&self.source, of, &surface);
        let around = project(&lit, &self.horizon, &projector, Visibility::Hard);
        let total = convolver.run(&of.thickness, &around).pop().unwrap_or_default();
        Ok(Channel { surface, convolver, total })
    }

    /// For each sun, the factor that multiplies or replaces ρt. `omega(i, k)` is sun `i` in texel k's frame.
    fn lit(&self, count: usize, omega: impl Fn(usize, usize) -> DVec3 + Sync, width: f64) -> Vec<SunlitMaps> {
        let of = &self.source.sides[self.at];
        let soft = Visibility::Soft { width };
        let mut found: Vec<Vec<Vec<f32>>> = vec![Vec::new(); count];
        for channel in &self.channels {
            let lit = side::lit(&self.source, of, &channel.surface);
            let entering: Vec<Vec<f64>> =
                (0..count).map(|i| irradiance_with(&lit, &self.horizon, soft, |k| omega(i, k).to_array())).collect();
            for (i, through) in channel.convolver.run(&of.thickness, &entering).into_iter().enumerate() {
                let mut images = [through];
                match self.colour {
                    TranslucencyColour::Substituted => {
                        // A texel that no light reaches responds like a flat leaf; almost none are such.
                        colour::substitute(&mut images, &channel.total, &[0.0], &of.mask);
                        for (k, v) in images[0].iter_mut().enumerate() {
                            if channel.total[k].is_nan() || channel.total[k] <= 0.0 {
                                *v = omega(i, k).z.max(0.0);
                            }
                        }
                    }
                    TranslucencyColour::Product => {
                        colour::level(&mut images, &channel.total, &of.mask);
                    }
                    TranslucencyColour::ThreeWavelengths => {}
                }
                found[i].push(images[0].iter().map(|v| *v as f32).collect());
            }
        }
        found
            .into_iter()
            .map(|mut maps| match (maps.len(), maps.pop()) {
                (3, Some(blue)) => {
                    let green = maps.pop().unwrap_or_default();
                    SunlitMaps::Colour(Arc::new([maps.pop().unwrap_or_default(), green, blue]))
                }
                (_, one) => SunlitMaps::Factor(Arc::new(one.unwrap_or_default())),
            })
            .collect()
    }

    fn mask(&self) -> &[bool] {
        &self.source.sides[self.at].mask
    }
}

impl<'a> LoadedLeaf<'a> {
    /// The interior for the reference renderer, which is made when it is needed for the first time.
    ///
    /// # Errors
    /// As [`LeafInterior::new`].
    pub fn inside(self) -> Result<Option<&'a LeafInterior>> {
        let cell = &self.loaded.inside;
        if cell.get().is_none() {
            let _ = cell.set(LeafInterior::new(self)?);
        }
        Ok(cell.get().and_then(Option::as_ref))
    }
}

impl LeafInterior {
    /// The interior of a leaf; `None` where the leaf has no translucency maps.
    ///
    /// # Errors
    /// [`Error::Input`] where the leaf's mesh covers no texel.
    pub fn new(leaf: LoadedLeaf) -> Result<Option<LeafInterior>> {
        let (Some(mesh), true) =
            (&leaf.placed.mesh, leaf.placed.translucent.as_ref().is_some_and(|t| t.fitted.is_some()))
        else {
            return Ok(None);
        };
        let [width, height] = leaf.plan.size;
        Ok(Some(LeafInterior {
            frames: frames::frames(&leaf.placed.mesh_path, mesh, width, height)?,
            width,
            ways: Default::default(),
        }))
    }

    /// The way of computing light that enters a side. It is made when it is needed for the first time, so that a side
    /// that is never lit costs nothing.
    fn way(&self, leaf: LoadedLeaf, side: Side) -> Result<Option<&Way>> {
        let maps = leaf.placed.translucent.as_ref().and_then(|t| t.fitted.as_ref());
        let (Some(fitted), Some(maps)) = (&leaf.placed.fitted, maps) else { return Ok(None) };
        if self.ways[side].get().is_none() {
            let found = Convolved::new(&fitted.folder, &maps.folder, &maps.record, side)?;
            let _ = self.ways[side].set(found.map_or(Way::AsTheyAre, |c| Way::Convolved(Box::new(c))));
        }
        Ok(self.ways[side].get())
    }

    /// The direction of a sun (given in the leaf's own frame) in texel `k`'s tangent frame, as a side sees it.
    fn turned(&self, side: Side, sun: DVec3, k: usize) -> DVec3 {
        let out = if side == Side::Front { 1.0 } else { -1.0 };
        let [t, b, n] = self.frames[side.in_front(k, self.width)];
        DVec3::new(out * t.dot(sun), b.dot(sun), out * n.dot(sun))
    }

    /// The factor that multiplies or replaces ρt when each of `suns` shines on a side. `radius` is that of the sun
    /// (rad).
    ///
    /// # Errors
    /// [`Error::Input`] where the source of the maps cannot be read.
    pub fn lit(&self, leaf: LoadedLeaf, side: Side, suns: &[DVec3], radius: f64) -> Result<Vec<SunlitMaps>> {
        Ok(match self.way(leaf, side)? {
            None => Vec::new(),
            Some(Way::Convolved(found)) => {
                let mut lit = found.lit(suns.len(), |i, k| self.turned(side, suns[i], k), 2.0 * radius.sin());
                // Bilinear look-ups at the rim must not include the dark texels beside the leaf.
                for map in &mut lit {
                    spread(map, found.mask(), self.width);
                }
                lit
            }
            Some(Way::AsTheyAre) => self.stored(leaf, side, suns),
        })
    }

    /// The same by the stored coefficients. Its difference from the full convolution is the error of the basis.
    pub fn stored(&self, leaf: LoadedLeaf, side: Side, suns: &[DVec3]) -> Vec<SunlitMaps> {
        let Some(coefficients) = &leaf.loaded.coefficients[side] else { return Vec::new() };
        suns.iter()
            .map(|sun| {
                let of = |map: &[[f32; 3]]| -> Vec<f32> {
                    map.iter()
                        .enumerate()
                        .map(|(k, h)| coefficients.sum(*h, self.turned(side, *sun, k)) as f32)
                        .collect()
                };
                match &coefficients.of {
                    TranslucencyQuantity::Factor(map) => SunlitMaps::Factor(Arc::new(of(map))),
                    TranslucencyQuantity::Colour(maps) => {
                        SunlitMaps::Colour(Arc::new([of(&maps[0]), of(&maps[1]), of(&maps[2])]))
                    }
                }
            })
            .collect()
    }
}

/// Texels beside the leaf get their neighbours' values.
fn spread(map: &mut SunlitMaps, mask: &[bool], width: usize) {
    let around = |planes: &mut [Vec<f32>]| {
        filling::nearest(planes, mask, width, mask.len() / width);
    };
    match map {
        SunlitMaps::Factor(map) => {
            let mut planes = [std::mem::take(Arc::make_mut(map))];
            around(&mut planes);
            let [plane] = planes;
            *Arc::make_mut(map) = plane;
        }
        SunlitMaps::Colour(maps) => {
            let three: &mut [Vec<f32>; 3] = Arc::make_mut(maps);
            around(three);
        }
    }
}
