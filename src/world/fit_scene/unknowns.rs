//! The unknown numbers of a scene: what they are called, where they start, between which limits they lie, and the world
//! that they make.

use crate::area::{self, DiscPopulation};
use crate::bands::SceneBands;
use crate::mapped::MappedLeaf;
use crate::quantity::{CHANNELS, UnknownKind, UnknownQuantity};
use crate::tissue::SceneTissue;
use crate::{Error, Result};
use glam::DVec3;
use mesophyll_scene::draw::reference;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::{AREA, SceneManifest, SceneSky, SkyModel, StatedUnknowns, SunLight, UniformLeaf};
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_transport::RadianceAt;
use mesophyll_transport::path::SurfaceBands;
use mesophyll_transport::path::slopes::RadianceParameter;
use mesophyll_transport::world::{ReferenceGloss, ReferenceInterior, ReferenceLeaf, ReferenceWorld};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Half of the step by which turbidity is moved to find the sky's derivative.
const TURBIDITY_STEP: f64 = 0.02;

/// A scene with unknown numbers.
pub struct SceneUnknowns {
    /// The scene's own world, whose numbers are replaced.
    pub world: ReferenceWorld,
    /// The scene.
    pub manifest: SceneManifest,
    /// Names of the world's leaves, as far as they are leaves.
    leaves: Vec<String>,
    /// What leaves of the world consist of, where that is unknown.
    tissues: BTreeMap<usize, SceneTissue>,
    /// Leaves of discs whose area is unknown.
    pub populations: BTreeMap<usize, DiscPopulation>,
    /// Seed by which discs are taken away or added.
    pub seed: u64,
    /// What everything scatters at each wavelength, where bands were measured and not three channels.
    pub bands: Option<SceneBands>,
    /// Names of the channels, or of the bands.
    pub channels: Vec<String>,
    /// The unknowns.
    pub list: Vec<UnknownQuantity>,
}

impl SceneUnknowns {
    /// The unknowns of a scene, at the values that it states. `groups` are the names of unknown exposures,
    /// `wavelengths` (nm) those that were measured in place of three channels.
    ///
    /// # Errors
    /// Those of the scene's light, for a physical sky that its model refuses, and those of a fit's maps.
    pub fn new(
        scene: &LoadedScene,
        world: ReferenceWorld,
        groups: &[String],
        wavelengths: Option<&[f64]>,
        ledger: &Ledger,
    ) -> Result<SceneUnknowns> {
        let manifest = &scene.manifest;
        let none = StatedUnknowns::default();
        let unknown = manifest.unknown.as_ref().unwrap_or(&none);
        let (mut list, mut tissues, mut populations) = (Vec::new(), BTreeMap::new(), BTreeMap::new());
        let bands = wavelengths.map(|nm| SceneBands::new(scene, nm)).transpose()?;
        for (name, asked) in &unknown.leaves {
            let refuse = |what: String| Error::field(&manifest.path, &format!("unknown.leaves.{name}"), what);
            let Some((k, leaf)) = scene.drawn().enumerate().find(|(_, leaf)| leaf.config.name == *name) else {
                let what = "found a leaf that stands nowhere in the scene, expected one that pictures could show";
                return Err(refuse(what.into()));
            };
            let (areas, asked): (Vec<String>, Vec<String>) = asked.iter().cloned().partition(|what| what == AREA);
            if !areas.is_empty() {
                populations.insert(k, DiscPopulation::new(&world, k).map_err(refuse)?);
                list.push(area::unknown(k, name));
            }
            let asked = &asked;
            if let Some(bands) = &bands {
                list.extend(bands.unknowns(k, leaf.config, asked).map_err(refuse)?);
                continue;
            }
            let tissue = SceneTissue::of(scene, leaf, &world, k, asked, ledger)?;
            for what in asked {
                let own = tissue.as_ref().map_or(Ok(None), |tissue| tissue.unknown(k, name, what)).map_err(refuse)?;
                match (own, leaf.config.uniform()) {
                    (Some(own), _) => list.extend(own),
                    (None, Some(stated)) => {
                        list.extend(stated_unknowns(k, name, what, stated, leaf.config.discs.is_some(), asked));
                    }
                    (None, None) => {}
                }
            }
            tissue.map(|tissue| tissues.insert(k, tissue));
        }
        let mut add = |kind, name: &str, at: Vec<f64>, [low, high]: [f64; 2], scale| {
            let high = vec![high; at.len()];
            list.push(UnknownQuantity { kind, name: name.into(), at, low, high, scale });
        };
        let any = [1e-9, f64::INFINITY];
        if let (Some(ground), false) = (world.ground, unknown.ground.is_empty()) {
            let (k, albedo) = (world.instances[ground].leaf, manifest.ground.as_ref().map_or([0.0; 3], |g| g.albedo));
            let albedo = bands.as_ref().map_or_else(|| albedo.to_vec(), |bands| bands.surfaces[k].rho_d[0].clone());
            add(UnknownKind::Ground(k), "ground.albedo", albedo, [0.0, 1.0], None);
        }
        if let (Some(sun), false) = (&world.sun, unknown.sun.is_empty()) {
            add(UnknownKind::Sun, "sun.irradiance", sun.irradiance.to_vec(), any, RELATIVE);
        }
        for what in &unknown.sky {
            let sky = manifest.physical_sky();
            match what.as_str() {
                "scale" => {
                    let at = manifest.sky.as_ref().and_then(SceneSky::scale).unwrap_or(1.0);
                    add(UnknownKind::SkyScale, "sky.scale", vec![at], any, RELATIVE);
                }
                _ => {
                    let at = sky.map_or(3.0, |s| s.turbidity);
                    let hosek = sky.map(|s| s.model) == Some(SkyModel::HosekWilkie);
                    let low = if hosek { 1.0 } else { 1.7 };
                    add(UnknownKind::Turbidity, "sky.turbidity", vec![at], [low, 10.0], RELATIVE);
                }
            }
        }
        for group in groups {
            add(UnknownKind::Exposure(group.clone()), &format!("exposure.{group}"), vec![1.0], any, RELATIVE);
        }
        let leaves = scene.drawn().map(|leaf| leaf.config.name.clone()).collect();
        let channels = bands.as_ref().map_or_else(|| CHANNELS.map(String::from).to_vec(), SceneBands::names);
        let (manifest, seed) = (manifest.clone(), 0);
        Ok(SceneUnknowns { world, manifest, leaves, tissues, populations, seed, bands, channels, list })
    }

    /// Index of the first number of each unknown, and how many there are in all.
    pub fn places(&self) -> (Vec<usize>, usize) {
        let mut count = 0;
        let first = self.list.iter().map(|q| (count, count += q.at.len()).0).collect();
        (first, count)
    }

    /// The name of a leaf of the world.
    pub fn leaf_name(&self, leaf: usize) -> String {
        self.leaves.get(leaf).cloned().unwrap_or_default()
    }

    /// Every leaf with maps whose numbers are unknown: its name, its index, and the maps.
    pub fn mapped(&self) -> impl Iterator<Item = (String, usize, &MappedLeaf)> {
        self.tissues.iter().filter_map(|(k, tissue)| {
            if let SceneTissue::Maps(maps) = tissue { Some((self.leaf_name(*k), *k, &**maps)) } else { None }
        })
    }

    /// What everything scatters in each band, with the present numbers; `None` for three channels.
    pub fn surfaces(&self) -> Option<Vec<SurfaceBands>> {
        self.bands.as_ref().map(|bands| bands.with(&self.list))
    }

    /// Everything whose numbers of bands are unknown: its index in the world, and its name where it is a leaf.
    pub fn banded(&self) -> Vec<(usize, Option<String>)> {
        let mut out: Vec<(usize, Option<String>)> = Vec::new();
        for q in &self.list {
            let own = match q.kind {
                UnknownKind::Ground(k) => (k, None),
                UnknownKind::RhoD(k, _) | UnknownKind::RhoDBoth(k) | UnknownKind::RhoT(k) => {
                    (k, Some(self.leaf_name(k)))
                }
                _ => continue,
            };
            if self.bands.is_some() && !out.contains(&own) {
                out.push(own);
            }
        }
        out
    }

    /// Holds values of the numbers where no leaf's maps give more light than they get.
    pub fn keep_maps(&self, values: &mut [f64]) {
        let (first, _) = self.places();
        for (k, tissue) in &self.tissues {
            if let SceneTissue::Maps(maps) = tissue {
                maps.keep_energy(*k, &self.list, &first, values);
            }
        }
    }

    /// Sets all numbers.
    pub fn set(&mut self, values: &[f64]) {
        let mut values = values.iter();
        self.list.iter_mut().flat_map(|q| &mut q.at).zip(&mut values).for_each(|(at, v)| *at = *v);
    }

    /// All numbers, in the order of the unknowns.
    pub fn values(&self) -> Vec<f64> {
        self.list.iter().flat_map(|q| q.at.clone()).collect()
    }

    fn find(&self, kind: &UnknownKind) -> Option<&UnknownQuantity> {
        self.list.iter().find(|q| q.kind == *kind)
    }

    /// The manifest with the present numbers of light, and the sun where it is asked for.
    fn lit(&self, sun_deg: Option<[f64; 2]>, turbidity: Option<f64>) -> SceneManifest {
        let mut out = self.manifest.with_sun(sun_deg);
        let three = |q: &UnknownQuantity| [q.at[0], q.at[1], q.at[2]];
        if let (Some(sun), Some(q)) = (&mut out.sun, self.find(&UnknownKind::Sun)) {
            sun.light = SunLight::Stated(three(q));
        }
        if let Some(sky) = &mut out.sky {
            let turbidity = turbidity.or_else(|| Some(self.find(&UnknownKind::Turbidity)?.at[0]));
            let scale = self.find(&UnknownKind::SkyScale).map(|q| q.at[0]);
            match sky {
                SceneSky::Even(radiance) => *radiance = radiance.map(|v| v * scale.unwrap_or(1.0)),
                SceneSky::Picture(sky) => sky.scale = scale.or(sky.scale),
                SceneSky::Physical(sky) => {
                    (sky.turbidity, sky.scale) = (turbidity.unwrap_or(sky.turbidity), scale.or(sky.scale));
                }
            }
        }
        out
    }

    /// Sun and sky of a manifest, as the world has them.
    fn lights(&self, manifest: &SceneManifest) -> Result<ReferenceWorld> {
        let mut out = reference::lights(manifest)?;
        out.environment = self.world.environment.clone();
        if let (Some(map), Some(q)) = (&out.environment, self.find(&UnknownKind::SkyScale)) {
            let stated = self.manifest.panorama().and_then(|s| s.scale).unwrap_or(1.0);
            let scaled = (**map).clone().placed(0.0, q.at[0] / stated);
            let scaled = scaled.map_err(|what| Error::field(&manifest.path, "sky.scale", what))?;
            out.environment = Some(Arc::new(scaled));
        }
        if out.environment.is_some() {
            out.dome = None;
            out.sun = self.world.sun.is_some().then_some(out.sun).flatten();
        }
        Ok(out)
    }

    /// The world with the present numbers (that of bands is the same with any), and the sun at a zenith angle and an
    /// azimuth (degrees) where these are given.
    ///
    /// # Errors
    /// Those of a physical sky that its model refuses.
    pub fn world(&self, sun_deg: Option<[f64; 2]>) -> Result<ReferenceWorld> {
        if self.bands.is_some() {
            return Ok(self.world.clone());
        }
        let lights = self.lights(&self.lit(sun_deg, None))?;
        let mut out = self.world.clone();
        (out.sun, out.sky, out.dome, out.environment) = (lights.sun, lights.sky, lights.dome, lights.environment);
        for q in &self.list {
            let map = || [0, 1, 2].map(|c| vec![q.at[c.min(q.at.len() - 1)] as f32]);
            match &q.kind {
                UnknownKind::RhoD(leaf, back) => interior(&mut out.leaves[*leaf], *back, |rho_d, _| *rho_d = map()),
                UnknownKind::RhoDBoth(leaf) => [false, true].into_iter().for_each(|back| {
                    interior(&mut out.leaves[*leaf], back, |rho_d, _| *rho_d = map());
                }),
                UnknownKind::Ground(leaf) => interior(&mut out.leaves[*leaf], false, |rho_d, _| *rho_d = map()),
                UnknownKind::RhoT(leaf) => {
                    [false, true].into_iter().for_each(|back| {
                        interior(&mut out.leaves[*leaf], back, |_, rho_t| *rho_t = map());
                    });
                }
                UnknownKind::RhoS(leaf) => self.gloss(&mut out, *leaf, |gloss| gloss.rho_s = map()),
                UnknownKind::Slope(leaf) => self.gloss(&mut out, *leaf, |gloss| gloss.m = vec![q.at[0] as f32]),
                _ => {}
            }
        }
        for (k, tissue) in &self.tissues {
            tissue.set(*k, &self.list, &mut out)?;
        }
        Ok(out)
    }

    /// Changes the gloss of both sides; a matte side gets one that reflects nothing first, of the slope that the scene
    /// states.
    fn gloss(&self, world: &mut ReferenceWorld, leaf: usize, change: impl Fn(&mut ReferenceGloss)) {
        let stated = self.manifest.leaves.iter().find(|l| l.name == self.leaf_name(leaf));
        let m = stated.and_then(|l| l.uniform()).map_or(0.2, |u| u.m);
        let of = &mut world.leaves[leaf];
        for side in [&mut of.front, &mut of.back] {
            change(side.gloss.get_or_insert_with(|| ReferenceGloss::even([0.0; 3], m)));
        }
    }

    /// What pictures of the world under this sun are differentiated by, each with the index of its unknown. An exposure
    /// has none, and an unknown of two sides has two.
    ///
    /// # Errors
    /// Those of a physical sky that its model refuses.
    pub fn slopes(&self, sun_deg: Option<[f64; 2]>) -> Result<Vec<(usize, RadianceParameter)>> {
        let mut out = Vec::new();
        for (k, q) in self.list.iter().enumerate() {
            let of = match &q.kind {
                UnknownKind::RhoD(leaf, back) => RadianceParameter::RhoD { leaf: *leaf, back: *back },
                UnknownKind::RhoDBoth(leaf) => {
                    out.push((k, RadianceParameter::RhoD { leaf: *leaf, back: false }));
                    RadianceParameter::RhoD { leaf: *leaf, back: true }
                }
                UnknownKind::Ground(leaf) => RadianceParameter::RhoD { leaf: *leaf, back: false },
                UnknownKind::RhoT(leaf) => RadianceParameter::RhoT(*leaf),
                UnknownKind::RhoS(leaf) => RadianceParameter::RhoS(*leaf),
                UnknownKind::Slope(leaf) => RadianceParameter::Slope(*leaf),
                UnknownKind::Sun => RadianceParameter::Light { sky: None, sun: [1.0; 3] },
                UnknownKind::SkyScale => {
                    let lights = self.lights(&self.lit(sun_deg, None))?;
                    let own = self.find(&UnknownKind::Sun).is_some()
                        || self.manifest.sun.as_ref().is_none_or(|sun| sun.irradiance().is_some());
                    // The sun of a physical sky has the sky's unit.
                    let sun = lights.sun.as_ref().filter(|_| !own).map_or([0.0; 3], |s| s.irradiance);
                    let at = q.at[0];
                    RadianceParameter::Light { sky: Some(radiance(lights, 1.0 / at)), sun: sun.map(|v| v / at) }
                }
                UnknownKind::Turbidity => {
                    let [a, b] = [-1.0, 1.0].map(|s| (q.at[0] + s * TURBIDITY_STEP).clamp(q.low, q.high[0]));
                    let [below, above] = [a, b].map(|t| self.lights(&self.lit(sun_deg, Some(t))));
                    let (below, above, over) = (below?, above?, 1.0 / (b - a));
                    let irradiance = |w: &ReferenceWorld| w.sun.as_ref().map_or([0.0; 3], |s| s.irradiance);
                    let [low, high] = [irradiance(&below), irradiance(&above)];
                    let (low_at, high_at) = (radiance(below, over), radiance(above, over));
                    let sky: RadianceAt = Arc::new(move |d: DVec3| {
                        let (low, high) = (low_at(d), high_at(d));
                        [0, 1, 2].map(|c| high[c] - low[c])
                    });
                    RadianceParameter::Light { sky: Some(sky), sun: [0, 1, 2].map(|c| (high[c] - low[c]) * over) }
                }
                UnknownKind::Exposure(_) | UnknownKind::Area(_) => continue,
                UnknownKind::Slab(leaf, _)
                | UnknownKind::Factor(leaf, _)
                | UnknownKind::Absorption(leaf)
                | UnknownKind::Content(leaf, _) => {
                    let own = self.tissues.get(leaf).and_then(|tissue| tissue.slope(*leaf, &q.kind, &self.list));
                    let Some(own) = own else { continue };
                    own
                }
            };
            out.push((k, of));
        }
        Ok(out)
    }
}

/// Numbers that are judged relative to their own size.
const RELATIVE: Option<f64> = Some(1e-9);

/// The unknowns that `what` asks for, of a leaf whose reflectances are numbers. `asked` is all that is asked of it.
fn stated_unknowns(
    k: usize,
    leaf: &str,
    what: &str,
    stated: &UniformLeaf,
    discs: bool,
    asked: &[String],
) -> Vec<UnknownQuantity> {
    // What a side reflects and lets through is at most all of the light.
    let free = |what: &str| asked.iter().any(|n| n == what);
    let rest = |share: f64, taken: bool| if taken { (1.0 - share).max(0.0) } else { 1.0 };
    let beside_t: Vec<f64> = stated.rho_t.iter().map(|t| rest(*t, !free("rho_t"))).collect();
    let [front, back] = stated.rho_d;
    let beside_d: Vec<f64> = (0..3).map(|c| rest(front[c].max(back[c]), !free("rho_d"))).collect();
    let one = |kind, name: &str, at: [f64; 3], high: &[f64]| UnknownQuantity {
        kind,
        name: format!("leaf.{leaf}.{name}"),
        at: at.to_vec(),
        low: 0.0,
        high: high.to_vec(),
        scale: None,
    };
    match what {
        "rho_d" if discs => {
            let mean = [0, 1, 2].map(|c| 0.5 * (front[c] + back[c]));
            vec![one(UnknownKind::RhoDBoth(k), "rho_d", mean, &[1.0; 3])]
        }
        "rho_d" => vec![
            one(UnknownKind::RhoD(k, false), "front.rho_d", front, &beside_t),
            one(UnknownKind::RhoD(k, true), "back.rho_d", back, &beside_t),
        ],
        "rho_t" => vec![one(UnknownKind::RhoT(k), "rho_t", stated.rho_t, &beside_d)],
        "rho_s" => vec![one(UnknownKind::RhoS(k), "rho_s", stated.rho_s.unwrap_or([0.02; 3]), &[1.0; 3])],
        _ => vec![UnknownQuantity {
            kind: UnknownKind::Slope(k),
            name: format!("leaf.{leaf}.m"),
            at: vec![stated.m],
            low: 0.02,
            high: vec![1.0],
            scale: RELATIVE,
        }],
    }
}

/// The sky's radiance times a factor.
fn radiance(world: ReferenceWorld, factor: f64) -> RadianceAt {
    Arc::new(move |d: DVec3| world.sky_radiance(d).map(|v| v.max(0.0) * factor))
}

fn interior(leaf: &mut ReferenceLeaf, back: bool, change: impl FnOnce(&mut [Vec<f32>; 3], &mut [Vec<f32>; 3])) {
    let side = if back { &mut leaf.back } else { &mut leaf.front };
    if let ReferenceInterior::Maps { rho_d, rho_t } = &mut side.interior {
        change(rho_d, rho_t);
    }
}
