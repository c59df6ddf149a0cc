//! The leaves that a scene may show: where their data come from, and how they are drawn.

use super::foliar::StatedLayers;
use mesophyll_base::surface::basis::TranslucencyBasis;
use mesophyll_files::unit::LengthUnit;
use mesophyll_fits::look::Look;
use mesophyll_fits::translucency::{Options, TissueName, TissueSource, TranslucencyColour};
use mesophyll_optics::gloss::{Lobe, LobeKind};
use mesophyll_transport::foliar::FoliarMaterial;
use serde::Deserialize;
use std::path::PathBuf;
use std::sync::Arc;

/// A leaf that the scene may show: a fit folder, and the source of the fit where it is missing or stale.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatedLeaf {
    /// The name by which instances refer to it.
    pub name: String,
    /// The name of another leaf. This leaf is drawn from the same data, and only the other leaf says where they come
    /// from.
    pub like: Option<String>,
    /// A folder of `fit leaf`.
    pub fit: Option<PathBuf>,
    /// A folder with a scan, from which the fit is made.
    pub capture: Option<PathBuf>,
    /// A synthetic scan, which is made where there is no capture.
    pub scan: Option<StatedScan>,
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
    #[serde(default)]
    pub interior: InteriorSource,
    /// The distribution of its gloss.
    #[serde(default)]
    pub lobe: LobeKind,
    /// Index of refraction of a lobe with Fresnel reflectance.
    pub index: Option<f64>,
    /// A reflection that is the same everywhere on the leaf, instead of a fit. It needs a mesh.
    pub uniform: Option<UniformLeaf>,
    /// Pictures of the leaf instead of a fit.
    pub look: Option<Look>,
    /// Layers of tissue instead of a fit. They need a mesh.
    pub foliar: Option<StatedLayers>,
    /// The optical model that is computed from those layers.
    #[serde(skip)]
    pub layers: Option<Arc<FoliarMaterial>>,
    /// How transmitted sunlight depends on the sun's direction. When absent, it follows from ρt and the mapped normal
    /// alone.
    pub translucency: Option<StatedTranslucency>,
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
}

/// A leaf whose reflection is stated: on either side f_r = ρd/π + ρs·f_s, where ρs·f_s is the gloss, and in both
/// directions f_t = ρt/π.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UniformLeaf {
    /// Diffuse reflectance of the front and of the back, linear sRGB.
    pub rho_d: [[f64; 3]; 2],
    /// Transmittance, the same in both directions.
    pub rho_t: [f64; 3],
    /// Reflectance ρs of the gloss on both sides. ρd is not reduced by it. The leaf is matte when this is absent.
    pub rho_s: Option<[f64; 3]>,
    /// Root mean square slope m of the gloss.
    #[serde(default = "slope")]
    pub m: f64,
}

fn slope() -> f64 {
    0.2
}

impl UniformLeaf {
    /// ρs, unless it is zero.
    pub fn gloss(&self) -> Option<[f64; 3]> {
        self.rho_s.filter(|rho_s| rho_s.iter().any(|v| *v > 0.0))
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
