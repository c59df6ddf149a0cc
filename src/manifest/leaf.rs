//! Leaves that a scene may show: where their data come from, and what is drawn of them.

use super::foliar::Stated;
use mesophyll_files::mesh::Unit;
use mesophyll_fit_translucency::{Colour, Options, TissueFrom, TissueName};
use mesophyll_optics::gloss::{Lobe, LobeKind};
use mesophyll_surface::basis::Basis;
use mesophyll_transport::foliar::Foliar;
use serde::Deserialize;
use std::path::PathBuf;
use std::sync::Arc;

/// A leaf the scene may show: a fit folder, and where the fit comes from when it is missing or stale.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Leaf {
    /// What instances call it.
    pub name: String,
    /// Another leaf's name: this one is drawn from the same data, where they come from is said there.
    pub like: Option<String>,
    /// A folder of `fit leaf`.
    pub fit: Option<PathBuf>,
    /// A folder with a scan, which the fit is made from.
    pub capture: Option<PathBuf>,
    /// A synthetic scan, made where there is no capture.
    pub scan: Option<Scan>,
    /// glTF; the fit's own blade when absent.
    pub mesh: Option<PathBuf>,
    /// A material of the plant or meadow that `mesh` is (or describes, for `mesophyll grow`): all its blades of this
    /// material, where they stand, are the mesh.
    pub part: Option<String>,
    /// Discs instead of a mesh, a line each: radius, centre x y z, normal x y z. For a uniform leaf that the path
    /// tracer draws.
    pub discs: Option<PathBuf>,
    /// Of that file's lengths; when absent, what the file says, or glTF's metre.
    pub mesh_unit: Option<Unit>,
    /// Where its diffuse reflectance and transmittance come from.
    #[serde(default)]
    pub interior: Interior,
    /// The distribution of its gloss.
    #[serde(default)]
    pub lobe: LobeKind,
    /// Index of refraction of the `cook-torrance` lobe.
    pub index: Option<f64>,
    /// The same everywhere on the leaf, instead of a fit; needs a mesh.
    pub uniform: Option<Uniform>,
    /// Layers of tissue instead of a fit; needs a mesh.
    pub foliar: Option<Stated>,
    /// What those layers do to light.
    #[serde(skip)]
    pub layers: Option<Arc<Foliar>>,
    /// How the sun comes through as it turns; by ρt and the mapped normal alone when absent.
    pub translucency: Option<Translucency>,
}

impl Leaf {
    /// The lobe that the leaf is fitted and drawn with.
    pub fn lobe(&self) -> Lobe {
        Lobe::of(self.lobe, self.index.unwrap_or(1.5))
    }

    /// The name that its data go by in a run's folder.
    pub fn data_name(&self) -> &str {
        self.like.as_deref().unwrap_or(&self.name)
    }
}

/// A leaf whose reflection is stated: f_r = ρd/π and the gloss ρs·f_s on either side, f_t = ρt/π both ways.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Uniform {
    /// Diffuse reflectance of the front and of the back, linear sRGB.
    pub rho_d: [[f64; 3]; 2],
    /// Transmittance, both ways.
    pub rho_t: [f64; 3],
    /// Of the gloss, on both sides; it is added without dimming ρd. Matte when absent.
    pub rho_s: Option<[f64; 3]>,
    /// Slope of the gloss.
    #[serde(default = "slope")]
    pub m: f64,
}

fn slope() -> f64 {
    0.2
}

impl Uniform {
    /// ρs, where it is not zero.
    pub fn gloss(&self) -> Option<[f64; 3]> {
        self.rho_s.filter(|rho_s| rho_s.iter().any(|v| *v > 0.0))
    }
}

/// Translucency maps of a leaf, made from its fit.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Translucency {
    /// A folder of `fit translucency`; made in the run's own folder when it is absent or not there.
    pub fit: Option<PathBuf>,
    /// What light is sent through when they are made.
    #[serde(default)]
    pub tissue: TissueName,
    /// One factor for all colours, or coefficients a channel.
    #[serde(default)]
    pub colour: Colour,
    /// What they are made with, and what a folder that is named must hold; when absent, the default and either of the
    /// two.
    pub basis: Option<Basis>,
}

impl Translucency {
    /// What `fit translucency` is told of it.
    pub fn options(&self) -> Options {
        Options {
            tissue: TissueFrom::Named(self.tissue),
            colour: self.colour,
            basis: self.basis.unwrap_or_default().into(),
            ..Options::default()
        }
    }
}

/// A synthetic scan to make when there is no capture: what `mesophyll synth` is told.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scan {
    /// A description for `mesophyll synth`.
    pub spec: PathBuf,
    /// Texels across and down, as `240x180`; the specification's own when absent.
    pub size: Option<String>,
    /// Width and height of what is scanned, around the middle of the specification's field; all of it when absent.
    pub field_mm: Option<[f64; 2]>,
    /// Absorption and scattering of the leaf's inside (1/mm; red, green, blue) in place of the specification's.
    pub sigma_a: Option<[f64; 3]>,
    /// See `sigma_a`.
    pub sigma_s: Option<[f64; 3]>,
    /// Frames a pass; the specification's own when absent.
    pub frames: Option<usize>,
    /// Relative standard deviation of a reading; the specification's own when absent.
    pub noise: Option<f64>,
    /// Of the noise; the specification's own when absent.
    pub seed: Option<u64>,
}

impl Scan {
    /// Texels across and down, where `size` says them as in `240x180`.
    pub fn texels(&self) -> Option<(usize, usize)> {
        let (w, h) = self.size.as_deref()?.split_once('x')?;
        let one = |t: &str| t.trim().parse::<usize>().ok().filter(|v| (1..=16_384).contains(v));
        Some((one(w)?, one(h)?))
    }
}

/// Where ρd and ρt come from: W's scalars σa and σs with γ and δ maps, or per-texel pigment maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interior {
    /// σa and σs are one number a channel; γ and δ are maps.
    #[default]
    Scalars,
    /// ρd and ρt are maps.
    Maps,
}
