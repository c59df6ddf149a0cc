//! Translucency maps (H7, H9 §3.3.4–9, corrected): how the light that comes through a leaf depends on where it comes
//! from, texel by texel.
//!
//! For light from ω that enters side S, the exit radiance of the other side over the irradiance at normal incidence is
//!
//! ```text
//! one wavelength, measured colour:  ρt(x)/π · f(x, ω),  f = π M / ∫ M dω
//! three wavelengths:                1/π · M_c(x, ω)
//! M(x, ω) = A_p Σ_i T(|x − x_i|, d_i) E(x_i, ω),  E = entry · V(x_i, ω) · max(0, n(x_i)·ω)/n_z(x_i)
//! ```
//!
//! Here ω is in the tangent frame of S (x right, y up in its image, z out of it). The coefficients of f, or of M, on a
//! directional basis are stored. Maps are in the columns of S's camera. Lengths in mm. The sources leave out 1/n_z
//! ([`TexelArea`]).
//!
//! The main path is [`run`]. It reads the leaf and chooses the tissue. Then, for each side, it projects the irradiance,
//! convolves, normalises, judges and writes.

#![warn(missing_docs)]

pub mod colour;
mod folder;
pub mod inverse;
pub mod judge;
pub mod recipe;
pub mod side;
pub mod source;
pub mod spread;
pub mod tissue;

use crate::leaf_folder::LeafFitFile;
use crate::record::FitKind;
use crate::record::maker::{self, FitMaker, FitOutcome};
use mesophyll_base::error::{Error, Result};
use mesophyll_files::hash;
use mesophyll_optics::dipole::DipoleForm;
use mesophyll_optics::translucency::basis::HemisphereBasis;
use mesophyll_optics::translucency::lights::{self, DirectionRule};
use source::{DirectionFrame, TranslucencyLeaf};
use std::path::Path;
use std::time::Instant;
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};
use tissue::LightEntry;

/// What the colour of the light that comes through is taken from.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    serde::Deserialize,
    Display,
    EnumString,
    EnumIter,
    IntoStaticStr,
    EnumMessage,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum TranslucencyColour {
    /// Directions at one wavelength, colour as measured: under the diffuse light that measured ρt, the picture is the
    /// measured one exactly.
    #[default]
    Substituted,
    /// The sources' product ρt(x)·M(x, ω) (H9 Eq. 3.23), scaled to the leaf's mean: dark veins count twice.
    Product,
    /// All three channels through the tissue; nothing substituted.
    ThreeWavelengths,
}

impl TranslucencyColour {
    /// Its name on the command line and in `fit.toml`.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// A tissue that needs no numbers beside its name.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    serde::Deserialize,
    Display,
    EnumString,
    EnumIter,
    IntoStaticStr,
    EnumMessage,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum TissueName {
    /// The slab that the leaf's fit found.
    #[default]
    Fit,
    /// The table of Habel 2009 (H9 Table 3.1; one wavelength, 510 nm).
    Table,
}

/// Where the tissue's coefficients come from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TissueSource {
    /// A tissue known by its name.
    Named(TissueName),
    /// Coefficients that the user states.
    Given {
        /// Absorption coefficient (1/mm).
        sigma_a: f64,
        /// Scattering coefficient (1/mm).
        sigma_s: f64,
        /// Mean cosine of the angle by which light is scattered, −1 to 1.
        g: f64,
    },
}

impl TissueSource {
    /// Its name on the command line and in `fit.toml`.
    pub fn name(self) -> &'static str {
        match self {
            TissueSource::Named(name) => name.into(),
            TissueSource::Given { .. } => "given",
        }
    }
}

/// Over which area a texel's light is counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum TexelArea {
    /// The facet's own, 1/n_z of the texel's: a slope catches n·ω/n_z a texel, all of the light that falls on it.
    #[default]
    Facet,
    /// The texel's, as H9 Eq. 3.13–3.14 have it: light on slopes is lost (a steep vein under normal light transmits 5 %
    /// too little).
    Texel,
}

impl TexelArea {
    /// Its name on the command line and in `fit.toml`.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// The options of `fit translucency`.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// What the colour is taken from.
    pub colour: TranslucencyColour,
    /// 0 red, 1 green, 2 blue; `None` takes the dominant one. Not for three wavelengths.
    pub channel: Option<usize>,
    /// Where the tissue's coefficients come from.
    pub tissue: TissueSource,
    /// How much light enters a texel; `None` takes what belongs to the tissue (`tissue::entry`).
    pub entry: Option<LightEntry>,
    /// Over which area a texel's light is counted.
    pub area: TexelArea,
    /// The boundary term A; `None` takes what belongs to the entry.
    pub a: Option<f64>,
    /// Form of the dipole whose point response spreads the light.
    pub form: DipoleForm,
    /// Number K of thickness levels.
    pub levels: usize,
    /// Light directions over the hemisphere: 128 on a spiral give errors that are 2.4 to 3.7 times smaller than those
    /// of the sources' 128 random ones (`bench translucency`).
    pub lights: DirectionRule,
    /// Directional basis that the maps' coefficients belong to.
    pub basis: HemisphereBasis,
    /// One light instead of a basis: elevation over the blade and azimuth (rad) in the lit side's frame.
    pub sun: Option<[f64; 2]>,
    /// Fit again although the folder holds this very fit.
    pub force: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            colour: TranslucencyColour::Substituted,
            channel: None,
            tissue: TissueSource::Named(TissueName::Fit),
            entry: None,
            area: TexelArea::Facet,
            a: None,
            form: DipoleForm::Thin,
            levels: 8,
            lights: DirectionRule::Spiral { count: lights::PAPER },
            basis: HemisphereBasis::HalfLife2,
            sun: None,
            force: false,
        }
    }
}

impl Options {
    fn describe(&self) -> String {
        format!("{:?}", Options { force: false, ..self.clone() })
    }
}

/// Hash of everything that decides the result.
pub fn input_hash(source: &TranslucencyLeaf, options: &Options) -> String {
    maker::input_hash([("leaf", source.hash.as_str()), ("options", &options.describe())])
}

/// Computes the translucency maps of the leaf fit in `input` into the folder `out`.
///
/// # Errors
/// An input that is no leaf fit or is damaged (exit code 2), a slab that the leaf fit did not determine (1), a folder
/// that cannot be written (2).
pub fn run(input: &Path, out: &Path, options: &Options) -> Result<FitOutcome> {
    let (leaf, options) = (input.to_path_buf(), options.clone());
    maker::make(FitKind::Translucency, out, &[input], move |maker| fit(&leaf, &options, maker))
}

fn fit(leaf: &Path, options: &Options, maker: &mut FitMaker) -> Result<FitOutcome> {
    let source = maker
        .phase("read the leaf and integrate its heights", || TranslucencyLeaf::read(leaf, DirectionFrame::Mesh))?;
    if let Some(found) = maker.up_to_date(input_hash(&source, options), options.force)? {
        return Ok(found);
    }
    let channels = channels(&source, options)?;
    let mut record = maker.record(&source.name);
    folder::describe(&mut record, &source, &channels, options)?;
    for side in &source.sides {
        let section = maker.part(folder::PART, side.name.name(), |out, times| {
            let made = side::make(&source, side, &channels, options, times)?;
            let step = Instant::now();
            let section = folder::side(out, &source, side, &made, options)?;
            times.phase(&format!("{}: write maps", side.name.name()), step);
            Ok(section)
        })?;
        record.sections.insert(side.name.name().into(), section);
    }
    let out = maker.begin()?;
    maker.take_parts()?;
    for side in &source.sides {
        record.files.insert(LeafFitFile::Maps.name(side.name), hash::file(&LeafFitFile::Maps.path(out, side.name))?);
    }
    Ok(FitOutcome::Done(maker.finish(record)?))
}

/// The channels to compute: 0 red, 1 green, 2 blue.
///
/// # Errors
/// [`Error::Usage`] for three wavelengths and a channel besides.
fn channels(source: &TranslucencyLeaf, options: &Options) -> Result<Vec<usize>> {
    match (options.colour, options.channel) {
        (TranslucencyColour::ThreeWavelengths, None) => Ok(vec![0, 1, 2]),
        (TranslucencyColour::ThreeWavelengths, Some(_)) => {
            Err(Error::Usage("three wavelengths need no channel: every channel is computed".into()))
        }
        (_, Some(c)) => Ok(vec![c]),
        (_, None) => Ok(vec![tissue::dominant(&source.sides)]),
    }
}
