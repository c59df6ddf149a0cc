//! The leaves that a scene may show: where their data come from, and how they are drawn.

use super::foliar::StatedLayers;
use super::table::StatedTable;
use super::uniform::UniformLeaf;
use crate::manifest::Result;
use mesophyll_base::surface::basis::TranslucencyBasis;
use mesophyll_files::unit::LengthUnit;
use mesophyll_fits::leaf_folder::other_side::OtherSide;
use mesophyll_fits::look::Look;
use mesophyll_fits::translucency::{Options, TissueName, TissueSource, TranslucencyColour};
use mesophyll_optics::gloss::{Lobe, LobeKind};
use mesophyll_transport::foliar::FoliarMaterial;
use serde::Deserialize;
use std::path::PathBuf;
use std::sync::Arc;

/// A leaf that the scene may show.
#[derive(Debug, Clone, PartialEq)]
pub struct StatedLeaf {
    /// The name by which instances refer to it.
    pub name: String,
    /// The name of another leaf. This leaf is drawn from the same data, and only the other leaf says where they come
    /// from.
    pub like: Option<String>,
    /// Where its look comes from.
    pub origin: LeafOrigin,
    /// A glTF file with the mesh; the fit's own blade when absent.
    pub mesh: Option<PathBuf>,
    /// A material of the plant or meadow that `mesh` holds (or describes, for `mesophyll grow`). All its blades of this
    /// material together are the mesh, each where it stands.
    pub part: Option<String>,
    /// A file with discs instead of a mesh. Each line has a radius, a centre x y z and a normal x y z. Only a uniform
    /// leaf that the path tracer draws can have discs.
    pub discs: Option<PathBuf>,
    /// Unit of the lengths in that file; when absent, the unit that the file states, or metres for glTF.
    pub mesh_unit: Option<LengthUnit>,
    /// Which axis of that file points up in the scene. When absent, it is glTF's y, except for a blade that lies in the
    /// file's plane of x and y.
    pub mesh_up: Option<UpAxis>,
    /// The source of its diffuse reflectance and transmittance.
    pub interior: InteriorSource,
    /// The distribution of its gloss.
    pub lobe: LobeKind,
    /// Index of refraction of a lobe with Fresnel reflectance.
    pub index: Option<f64>,
    /// How transmitted sunlight depends on the sun's direction. When absent, it follows from ρt and the mapped normal
    /// alone.
    pub translucency: Option<StatedTranslucency>,
}

/// Where the look of a leaf comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum LeafOrigin {
    /// From the leaf that it is like, whose origin takes this one's place once the scene is read.
    Other,
    /// From a fit.
    Fitted(FitOrigin),
    /// Pictures of the leaf instead of a fit.
    Look(Look),
    /// A reflection that is the same everywhere on the leaf, instead of a fit. It needs a mesh.
    Uniform(UniformLeaf),
    /// Layers of tissue instead of a fit. They need a mesh.
    Layered(Box<LayeredOrigin>),
}

/// A fit folder, and the source of the fit where it is missing or stale.
#[derive(Debug, Clone, PartialEq)]
pub struct FitOrigin {
    /// A folder of `fit leaf`.
    pub fit: Option<PathBuf>,
    /// A folder with a scan, from which the fit is made.
    pub capture: Option<PathBuf>,
    /// A synthetic scan, which is made where there is no capture.
    pub scan: Option<StatedScan>,
    /// What stands for a side that the fit does not have.
    pub other_side: Option<OtherSide>,
}

/// A leaf of layers.
#[derive(Debug, Clone, PartialEq)]
pub struct LayeredOrigin {
    /// The layers as the scene states them.
    pub stated: StatedLayers,
    /// The optical model that is computed from them, and the leaf that other renderers draw in its place.
    pub made: Option<(Arc<FoliarMaterial>, UniformLeaf)>,
}

impl StatedLeaf {
    /// The lobe with which the leaf is fitted and drawn.
    pub fn lobe(&self) -> Lobe {
        Lobe::of(self.lobe, self.index.unwrap_or(1.5))
    }

    /// The name of its data in a run's folder.
    pub fn data_name(&self) -> &str {
        self.like.as_deref().unwrap_or(&self.name)
    }

    /// The fit that it is drawn from, and the source of the fit.
    pub fn fit(&self) -> Option<&FitOrigin> {
        if let LeafOrigin::Fitted(fit) = &self.origin { Some(fit) } else { None }
    }

    /// The pictures that state its look.
    pub fn look(&self) -> Option<&Look> {
        if let LeafOrigin::Look(look) = &self.origin { Some(look) } else { None }
    }

    /// Its reflection where that is the same everywhere: as stated, or that of the leaf which stands for its layers.
    pub fn uniform(&self) -> Option<&UniformLeaf> {
        match &self.origin {
            LeafOrigin::Uniform(uniform) => Some(uniform),
            LeafOrigin::Layered(layered) => layered.made.as_ref().map(|(_, uniform)| uniform),
            _ => None,
        }
    }

    /// Its layers.
    pub fn layered(&self) -> Option<&LayeredOrigin> {
        if let LeafOrigin::Layered(layered) = &self.origin { Some(layered) } else { None }
    }

    /// The optical model that is computed from its layers.
    pub fn layers(&self) -> Option<&Arc<FoliarMaterial>> {
        self.layered()?.made.as_ref().map(|(layers, _)| layers)
    }

    pub(super) fn read(mut t: StatedTable) -> Result<StatedLeaf> {
        let (name, like) = (t.name()?, t.stated("like")?);
        let (origin, what) = if like.is_some() {
            (LeafOrigin::Other, "is like another one and has the data of that one")
        } else if t.has("look") {
            (LeafOrigin::Look(t.needed("look")?), "is stated by its look")
        } else if t.has("uniform") {
            (LeafOrigin::Uniform(t.needed("uniform")?), "is uniform and has no maps")
        } else if t.has("foliar") {
            let layered = LayeredOrigin { stated: t.needed("foliar")?, made: None };
            let what = "is stated by its layers, which have indices and lobes of their own";
            (LeafOrigin::Layered(Box::new(layered)), what)
        } else {
            let (fit, capture, scan) = (t.stated("fit")?, t.stated("capture")?, t.stated("scan")?);
            if fit.is_none() && capture.is_none() && scan.is_none() {
                let what = "missing; expected a fit folder, a capture, a scan, a look, uniform or foliar";
                let meant = ["capture", "scan", "look", "uniform", "foliar", "like"];
                return Err(t.missing(meant.into_iter().find(|key| t.near(key).is_some()).unwrap_or("fit"), what));
            }
            let other_side = t.stated("other_side")?;
            (LeafOrigin::Fitted(FitOrigin { fit, capture, scan, other_side }), "is drawn by the maps of a fit")
        };
        let maps = !matches!(origin, LeafOrigin::Uniform(_) | LeafOrigin::Layered(_));
        let layered = matches!(origin, LeafOrigin::Layered(_));
        let leaf = StatedLeaf {
            mesh: t.stated("mesh")?,
            part: t.stated("part")?,
            mesh_unit: t.stated("mesh_unit")?,
            mesh_up: t.stated("mesh_up")?,
            discs: if maps && like.is_none() { None } else { t.stated("discs")? },
            // What another kind of leaf has may be given where it says what is so anyway.
            lobe: if layered { t.default_only("lobe") } else { t.stated("lobe") }?.unwrap_or_default(),
            index: if layered { None } else { t.stated("index")? },
            interior: match origin {
                LeafOrigin::Other | LeafOrigin::Fitted(_) => t.stated("interior"),
                _ => t.default_only("interior"),
            }?
            .unwrap_or_default(),
            translucency: match origin {
                LeafOrigin::Other | LeafOrigin::Fitted(_) => t.stated("translucency")?,
                _ => None,
            },
            name,
            like,
            origin,
        };
        t.finish(&format!(", but leaf \"{}\" {what}", leaf.name))?;
        Ok(leaf)
    }
}

/// Translucency maps of a leaf, which are made from its fit.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatedTranslucency {
    /// A folder of `fit translucency`. The maps are made in the run's own folder when it is absent or does not exist.
    pub fit: Option<PathBuf>,
    /// The tissue model for the light inside the blade.
    #[serde(default)]
    pub tissue: TissueName,
    /// Whether there is one factor for all colours, or coefficients for each channel.
    #[serde(default)]
    pub colour: TranslucencyColour,
    /// The basis with which maps are made, and which a named folder must have. When absent, maps are made with the
    /// default, and a folder may have either of the two.
    pub basis: Option<TranslucencyBasis>,
}

impl StatedTranslucency {
    /// The options for `fit translucency`.
    pub fn options(&self) -> Options {
        Options {
            tissue: TissueSource::Named(self.tissue),
            colour: self.colour,
            basis: self.basis.unwrap_or_default().into(),
            ..Options::default()
        }
    }
}

/// A synthetic scan to make when there is no capture: the options of `mesophyll synth`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatedScan {
    /// A description for `mesophyll synth`.
    pub spec: PathBuf,
    /// Texels across and down, such as `240x180`; those of the specification when absent.
    pub size: Option<String>,
    /// Width and height of the scanned part, around the middle of the specification's field; the whole field when
    /// absent.
    pub field_mm: Option<[f64; 2]>,
    /// Absorption coefficient of the leaf's inside (1/mm; red, green, blue), in place of the specification's.
    pub sigma_a: Option<[f64; 3]>,
    /// Scattering coefficient, in the same units.
    pub sigma_s: Option<[f64; 3]>,
    /// Number of frames in a pass; that of the specification when absent.
    pub frames: Option<usize>,
    /// Relative standard deviation of a reading; that of the specification when absent.
    pub noise: Option<f64>,
    /// Seed of the noise; that of the specification when absent.
    pub seed: Option<u64>,
}

impl StatedScan {
    /// Texels across and down, from a `size` such as `240x180`.
    pub fn texels(&self) -> Option<(usize, usize)> {
        let (w, h) = self.size.as_deref()?.split_once('x')?;
        let one = |t: &str| t.trim().parse::<usize>().ok().filter(|v| (1..=16_384).contains(v));
        Some((one(w)?, one(h)?))
    }
}

/// The source of ρd and ρt: W's scalars σa and σs with γ and δ maps, or pigment maps with values for each texel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InteriorSource {
    /// σa and σs are one number for each channel; γ and δ are maps.
    #[default]
    Scalars,
    /// ρd and ρt are maps.
    Maps,
}

/// An axis of a mesh's file that points up in a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UpAxis {
    /// glTF's own: y is up, and z towards the viewer.
    Y,
    /// The scene's: the file's axes are those of the scene, as for a leaf that lies with its front up.
    Z,
}
