//! Scene manifests: which leaves stand where, which lights shine on them, where the cameras are, and how close a
//! picture must come to its reference.
//!
//! Lengths are in mm and angles in degrees. World z is up. The light sets the unit of radiance, and colours are linear
//! sRGB. A path is relative to the scene file. Unknown fields are errors; an error names file, line and field.

#![warn(missing_docs)]

mod around;
mod foliar;
mod grass;
mod leaf;
mod light;
mod picture;
mod plant;
mod spectrum;
mod table;
mod uniform;
mod unknowns;
mod validate;
mod view;

pub use foliar::WhatAbsorbs;
pub use grass::StatedLawn;
pub use leaf::{
    FitOrigin, InteriorSource, LayeredOrigin, LeafOrigin, StatedLeaf, StatedScan, StatedTranslucency, UpAxis,
};
pub use light::{
    PhysicalSky, SceneDay, SceneShadows, SceneSky, SceneSun, SceneTransfer, StatedPanorama, SunLight, SunLocation,
    sun_words,
};
pub use mesophyll_base::surface::basis::TranslucencyBasis;
pub use mesophyll_sky::SkyModel;
pub use picture::PictureSky;
pub use plant::{
    BranchOverride, GRAINS_A_TILE, MOST_LEAF_RESONANCE, SceneGround, SceneHill, SceneInstance, SceneMaterial,
    ScenePeriod, SceneWind, StatedFlutter, StatedPlant,
};
pub use spectrum::StatedSpectrum;
pub use uniform::{UniformLeaf, UniformSlab};
pub use unknowns::{AREA, StatedFactors, StatedPhotograph, StatedUnknowns};
pub use view::{
    CaptureView, CardView, CheckSettings, PerspectiveView, SceneCamera, SceneView, TranslucencyReference, ViewKind,
};

use glam::DVec3;
pub(crate) use mesophyll_base::error::{Error, Result};
use mesophyll_base::error::{Fault, TomlKind};
use mesophyll_base::tone::{PictureChannels, PictureDisplay, ToneCurve};
use mesophyll_files::numbers;
use mesophyll_files::unit::LengthUnit;
use mesophyll_files::{first_bytes, whole_file};
use mesophyll_transport::ReferenceCamera;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use table::StatedTable;
use toml::de::DeTable;

/// The content of `data/scenes/*.toml` (format: `data/scenes/README.md`).
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneManifest {
    /// Version of the format.
    pub schema: u32,
    /// Name of the scene in printed text.
    pub name: String,
    /// A description for readers.
    #[serde(default)]
    pub description: String,
    /// The largest error of a displayed value (0 to 1, after tone mapping and sRGB encoding) that one shortcut of the
    /// plan may cause. A check needs this limit.
    pub tolerance: Option<f64>,
    /// The factor that radiance is multiplied by before it is displayed.
    #[serde(default = "one")]
    pub exposure: f64,
    /// What red, green and blue of the surfaces are, for pictures that are made to be looked at. Checks leave it out.
    #[serde(default)]
    pub channels: PictureChannels,
    /// Share of the light that a camera's lens scatters around what is bright, in films and in the window. Checks leave
    /// it out.
    pub bloom: Option<f64>,
    /// Radiance where nothing stands, unless the sky determines it.
    #[serde(default)]
    pub background: [f64; 3],
    /// The leaves that instances may show.
    #[serde(rename = "leaf", default, deserialize_with = "read_apart")]
    pub leaves: Vec<StatedLeaf>,
    /// Leaves that stand alone.
    #[serde(default, rename = "instance")]
    pub instances: Vec<SceneInstance>,
    /// Whole plants.
    #[serde(default, rename = "plant")]
    pub plants: Vec<StatedPlant>,
    /// The wind that moves plants and lawns.
    pub wind: Option<SceneWind>,
    /// Lawns on the ground.
    #[serde(default)]
    pub grass: Vec<StatedLawn>,
    /// The ground that everything stands on.
    pub ground: Option<SceneGround>,
    /// The period, in a scene that repeats without end.
    pub periodic: Option<ScenePeriod>,
    /// The sun; without it there is no direct sunlight.
    #[serde(default, deserialize_with = "read_apart")]
    pub sun: Option<SceneSun>,
    /// The sky; without it the sun is the only light.
    #[serde(default, deserialize_with = "read_apart")]
    pub sky: Option<SceneSky>,
    /// Hours of a day at which the scene is drawn too.
    pub day: Option<SceneDay>,
    /// Light between leaves in real time. Without it every leaf is lit as if it stood alone.
    pub transfer: Option<SceneTransfer>,
    /// The views: cameras, and what they show.
    #[serde(rename = "view", default, deserialize_with = "read_apart")]
    pub views: Vec<SceneView>,
    /// The camera's exposure, for pictures with a film's curve.
    pub camera: Option<SceneCamera>,
    /// Pictures that were taken of it, for `fit scene`.
    #[serde(default, rename = "picture")]
    pub taken: Vec<StatedPhotograph>,
    /// Reflectance factors that were measured of it, for `fit scene`.
    #[serde(default, rename = "brf")]
    pub factors: Vec<StatedFactors>,
    /// The numbers that `fit scene` finds from them.
    pub unknown: Option<StatedUnknowns>,
    /// How its pictures are judged.
    #[serde(default)]
    pub check: CheckSettings,
    /// The file this was read from.
    #[serde(skip)]
    pub path: PathBuf,
}

/// What a reader of scenes expects.
const SCENE: &str = "a scene (TOML); a plant's file is named in one, under [[plant]] file";

fn one() -> f64 {
    1.0
}

/// What [`SceneManifest::parse`] reads apart: only its name stands here, for the list of the fields that there are.
fn read_apart<'de, D: serde::Deserializer<'de>, T: Default>(from: D) -> std::result::Result<T, D::Error> {
    serde::de::IgnoredAny::deserialize(from).map(|_| T::default())
}

impl SceneManifest {
    /// Reads and validates a scene file.
    ///
    /// # Errors
    /// [`Error::Input`] naming the file, the line and the field, what was found and what was expected.
    pub fn read(path: &Path) -> Result<SceneManifest> {
        let text = whole_file::text_of(path, SCENE)?;
        if let Some(form) = first_bytes::model(text.trim_start().as_bytes()) {
            return Err(Error::input(path, format!("found {form}, expected {SCENE}")));
        }
        SceneManifest::parse(&text, path)
    }

    /// Validates the text of a scene file. Names of other files in it are relative to the folder of `path`.
    ///
    /// # Errors
    /// As [`SceneManifest::read`].
    pub fn parse(text: &str, path: &Path) -> Result<SceneManifest> {
        let wrong = |e: toml::de::Error| gone(path, text, Error::toml_of(TomlKind::Scene, path, text, &e));
        let mut root = DeTable::parse(text).map_err(wrong)?;
        let [leaves, views] = ["leaf", "view"].map(|header| StatedTable::all((path, text), root.get_mut(), header));
        let [sun, sky] = ["sun", "sky"].map(|header| StatedTable::one((path, text), root.get_mut(), header));
        let (leaves, views, sun, sky) = (leaves?, views?, sun?, sky?);
        let mut manifest = SceneManifest::deserialize(toml::Deserializer::from(root)).map_err(wrong)?;
        manifest.leaves = leaves.into_iter().map(StatedLeaf::read).collect::<Result<_>>()?;
        manifest.views = views.into_iter().map(SceneView::read).collect::<Result<_>>()?;
        manifest.sky = sky.map(SceneSky::read).transpose()?;
        manifest.sun = sun.map(|sun| SceneSun::read(sun, manifest.sky.as_ref())).transpose()?;
        manifest.path = path.to_path_buf();
        manifest.read_spectra()?;
        validate::validate(&manifest, text)?;
        manifest.layer(0.0, false)?;
        manifest.share();
        manifest.spread()?;
        manifest.read_picture()?;
        Ok(manifest)
    }

    /// Gives a leaf that is `like` another one the data of that leaf.
    fn share(&mut self) {
        for k in 0..self.leaves.len() {
            let Some(other) = self.leaves[k].like.as_ref().and_then(|n| self.leaf_index(n)) else { continue };
            let StatedLeaf { origin, lobe, index, mesh, part, discs, mesh_unit, mesh_up, .. } =
                self.leaves[other].clone();
            let leaf = &mut self.leaves[k];
            leaf.origin = origin;
            if leaf.layers().is_some() {
                (leaf.lobe, leaf.index) = (lobe, index);
            }
            if leaf.mesh.is_none() && leaf.discs.is_none() {
                (leaf.mesh, leaf.discs, leaf.mesh_unit) = (mesh, discs, mesh_unit);
                (leaf.part, leaf.mesh_up) = (part, mesh_up);
            }
        }
    }

    /// Adds a view from above to a scene without a perspective view, for callers that want to know what stands in it
    /// but need no picture.
    pub fn look_from_above(&mut self) {
        if self.perspectives().next().is_none() {
            let (eye, target, up) = (1e6 * DVec3::Z, DVec3::ZERO, DVec3::Y);
            let camera = ReferenceCamera { eye, target, up, fov_y_deg: 30.0 };
            self.views.push(SceneView::Perspective(PerspectiveView::new("above", camera)));
        }
    }

    /// The views of the scene as it stands.
    pub fn perspectives(&self) -> impl Iterator<Item = &PerspectiveView> + Clone {
        self.views.iter().filter_map(|v| if let SceneView::Perspective(view) = v { Some(view) } else { None })
    }

    /// The views of cards.
    pub fn cards(&self) -> impl Iterator<Item = &CardView> + Clone {
        self.views.iter().filter_map(|v| if let SceneView::Card(view) = v { Some(view) } else { None })
    }

    /// The views of leaves as their scans saw them.
    pub fn captures(&self) -> impl Iterator<Item = &CaptureView> + Clone {
        self.views.iter().filter_map(|v| if let SceneView::Capture(view) = v { Some(view) } else { None })
    }

    /// Replaces an instance with a list of positions by one instance for each position.
    fn spread(&mut self) -> Result<()> {
        let mut out = Vec::new();
        for (table, instance) in self.instances.iter().enumerate() {
            let Some(file) = &instance.positions else {
                out.push(instance.clone());
                continue;
            };
            let unit = instance.unit.unwrap_or(LengthUnit::Metre).mm();
            for at in numbers::read::<3>(&self.resolve(file), "x y z")? {
                let position_mm = [0, 1, 2].map(|k| instance.position_mm[k] + unit * at[k]);
                out.push(SceneInstance { position_mm, positions: None, list: Some(table), ..instance.clone() });
            }
        }
        self.instances = out;
        Ok(())
    }

    /// A path of the manifest, relative to the working folder.
    pub fn resolve(&self, relative: &Path) -> PathBuf {
        match self.path.parent() {
            Some(folder) if relative.is_relative() && !folder.as_os_str().is_empty() => tidy(&folder.join(relative)),
            _ => relative.to_path_buf(),
        }
    }

    /// The largest error of a displayed value that one shortcut of the plan may cause. Where the scene does not state
    /// it, it is the step between two values of an 8-bit picture.
    pub fn tolerated(&self) -> f64 {
        self.tolerance.unwrap_or(1.0 / 255.0)
    }

    /// Whether the scene states every limit that a check needs.
    ///
    /// # Errors
    /// [`Error::Input`] naming the first limit that is missing: `tolerance`, or a view's `max_error` or `flip_p99`.
    pub fn require_limits(&self) -> Result<()> {
        let missing = |what: String| Error::field(&self.path, &what, "missing; a check needs it");
        if self.tolerance.is_none() {
            return Err(missing("tolerance".into()));
        }
        for view in &self.views {
            let needs = match view {
                SceneView::Perspective(v) => [("max_error", v.max_error.is_none()), ("flip_p99", v.flip_p99.is_none())],
                SceneView::Card(v) => [("max_error", v.max_error.is_none()), ("flip_p99", false)],
                SceneView::Capture(_) => continue,
            };
            if let Some((key, _)) = needs.iter().find(|n| n.1) {
                return Err(missing(format!("view \"{}\": {key}", view.name())));
            }
        }
        Ok(())
    }

    /// The sky's physical model, if the sky is one.
    pub fn physical_sky(&self) -> Option<&PhysicalSky> {
        if let Some(SceneSky::Physical(sky)) = &self.sky { Some(sky) } else { None }
    }

    /// The radiance of a constant sky.
    pub fn even_sky(&self) -> Option<[f64; 3]> {
        if let Some(SceneSky::Even(radiance)) = self.sky { Some(radiance) } else { None }
    }

    /// What the scene states of the sky's picture, if the sky is one.
    pub fn panorama(&self) -> Option<&StatedPanorama> {
        if let Some(SceneSky::Picture(sky)) = &self.sky { Some(sky) } else { None }
    }

    /// The sky's picture, if the sky is one.
    pub fn pictured(&self) -> Option<&PictureSky> {
        self.panorama()?.picture.as_deref()
    }

    /// Whether the sky's light depends on its direction.
    pub fn varied_sky(&self) -> bool {
        self.physical_sky().is_some() || self.panorama().is_some()
    }

    /// How the scene is shown to people, where they do not ask for another curve: with a film's curve where there is a
    /// camera.
    pub fn display(&self) -> PictureDisplay {
        let curve = if self.camera.is_some() { ToneCurve::Film } else { ToneCurve::Reinhard };
        PictureDisplay { curve, channels: self.channels }
    }

    /// The same, with another curve where one is asked for.
    pub fn display_by(&self, tone: Option<ToneCurve>) -> PictureDisplay {
        let own = self.display();
        PictureDisplay { curve: tone.unwrap_or(own.curve), ..own }
    }

    /// The factor for radiance in a picture with this curve. That of a film comes from the scene's camera, where there
    /// is one.
    pub fn exposure_of(&self, curve: ToneCurve) -> f64 {
        let unit = self.physical_sky().and_then(|s| s.scale).unwrap_or(1.0);
        match (curve, self.camera) {
            // A radiance of 1 kcd/m² is `unit` scene units.
            (ToneCurve::Film, Some(camera)) => camera.exposure() * 1e3 / unit,
            _ => self.exposure,
        }
    }

    /// Whether the sun stands in more than one place.
    pub fn sun_moves(&self) -> bool {
        self.day.is_some() || self.sun.as_ref().is_some_and(|s| s.moves)
    }

    /// The time at which a view shows the scene (s).
    pub fn time_of(&self, view: &PerspectiveView) -> f64 {
        view.time_s.unwrap_or_else(|| self.rest_time())
    }

    /// The time at which the scene opens (s).
    pub fn rest_time(&self) -> f64 {
        self.wind.as_ref().map_or(0.0, |w| w.time_s)
    }

    /// The index of the leaf with this name.
    pub fn leaf_index(&self, name: &str) -> Option<usize> {
        self.leaves.iter().position(|l| l.name == name)
    }
}

/// The error for a scene that cannot be read. A table of an earlier version gets a word on what took its place.
fn gone(path: &Path, text: &str, error: Error) -> Error {
    let gone = [("cluster", "[cluster]"), ("tree", "[tree]"), ("branch", "[[branch]]")];
    let old = |line: &str| {
        let line = line.split('#').next().unwrap_or_default().trim();
        gone.iter().find(|(_, header)| *header == line)
    };
    let Some((number, (field, header))) = text.lines().enumerate().find_map(|(k, line)| Some((k, old(line)?))) else {
        return error;
    };
    let what = format!("{header} is no longer read; expected a [[plant]], which has wood, branches and leaves");
    Error::Input {
        file: path.display().to_string(),
        line: u32::try_from(number + 1).ok(),
        field: Some((*field).into()),
        fault: Fault::Other(what),
    }
}

/// Turns `a/b/../c` into `a/c`, without looking at the file system.
fn tidy(path: &Path) -> PathBuf {
    use std::path::Component;
    let mut out: Vec<Component> = Vec::new();
    for part in path.components() {
        match (part, out.last()) {
            (Component::ParentDir, Some(Component::Normal(_))) => {
                out.pop();
            }
            (Component::CurDir, _) => {}
            _ => out.push(part),
        }
    }
    out.iter().collect()
}
