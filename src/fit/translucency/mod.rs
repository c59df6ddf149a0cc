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
//! with ω in the tangent frame of S (x right, y up in its image, z out of it). What is stored are the coefficients of
//! f, or of M, on a directional basis; maps lie in the columns of S's camera. Lengths in mm. The sources leave 1/n_z
//! out ([`Area`]).
//!
//! The main path is [`run`]: read the leaf, choose the tissue, then side by side project the irradiance, convolve,
//! normalise, judge, write.

pub mod colour;
mod folder;
pub mod inverse;
pub mod judge;
pub mod recipe;
pub mod side;
pub mod source;
pub mod spread;
pub mod tissue;

use crate::{Error, Result};
use mesophyll_files::{hash, progress};
use mesophyll_optics::dipole::Form;
use mesophyll_record::{self as record, FitRecord, Phase, Times};
use mesophyll_translucency::basis::Basis;
use mesophyll_translucency::lights::{self, Rule};
use side::Made;
use source::{Frame, Source};
use std::path::Path;
use std::time::Instant;
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};
use tissue::Entry;

/// What the colour of the light that comes through is taken from.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    Display,
    EnumString,
    EnumIter,
    IntoStaticStr,
    EnumMessage,
    serde::Deserialize,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Colour {
    /// Directions at one wavelength, colour as measured: under the diffuse light that measured ρt, the picture is the
    /// measured one exactly.
    #[default]
    Substituted,
    /// The sources' product ρt(x)·M(x, ω) (H9 Eq. 3.23), scaled to the leaf's mean: dark veins count twice.
    Product,
    /// All three channels through the tissue; nothing substituted.
    ThreeWavelengths,
}

impl Colour {
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
    Display,
    EnumString,
    EnumIter,
    IntoStaticStr,
    EnumMessage,
    serde::Deserialize,
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
pub enum TissueFrom {
    Named(TissueName),
    /// 1/mm, 1/mm, mean cosine.
    Given {
        sigma_a: f64,
        sigma_s: f64,
        g: f64,
    },
}

impl TissueFrom {
    pub fn name(self) -> &'static str {
        match self {
            TissueFrom::Named(name) => name.into(),
            TissueFrom::Given { .. } => "given",
        }
    }
}

/// Over which area a texel's light is counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum Area {
    /// The facet's own, 1/n_z of the texel's: a slope catches n·ω/n_z a texel, all of the light that falls on it.
    #[default]
    Facet,
    /// The texel's, as H9 Eq. 3.13–3.14 have it: light on slopes is lost (a steep vein under normal light transmits 5 %
    /// too little).
    Texel,
}

impl Area {
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// What `fit translucency` is told.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    pub colour: Colour,
    /// 0 red, 1 green, 2 blue; `None` is the dominant one. Not for three wavelengths.
    pub channel: Option<usize>,
    pub tissue: TissueFrom,
    /// `None`: what belongs to the tissue (`tissue::entry`).
    pub entry: Option<Entry>,
    pub area: Area,
    /// The boundary term A; `None`: what belongs to the entry.
    pub a: Option<f64>,
    pub form: Form,
    /// Thickness levels K.
    pub levels: usize,
    /// Light directions over the hemisphere: 128 on a spiral are 2.4 to 3.7 times as good as the sources' 128 random
    /// ones (`bench translucency`).
    pub lights: Rule,
    pub basis: Basis,
    /// One light instead of a basis: elevation over the blade and azimuth (rad) in the lit side's frame.
    pub sun: Option<[f64; 2]>,
    /// Fit again although the folder holds this very fit.
    pub force: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            colour: Colour::Substituted,
            channel: None,
            tissue: TissueFrom::Named(TissueName::Fit),
            entry: None,
            area: Area::Facet,
            a: None,
            form: Form::Thin,
            levels: 8,
            lights: Rule::Spiral { count: lights::PAPER },
            basis: Basis::HalfLife2,
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

/// How a run ended.
#[derive(Debug)]
pub enum Outcome {
    Done(Box<FitRecord>),
    /// The folder already held this very fit; nothing was computed.
    UpToDate(Box<FitRecord>),
}

/// Hash of everything that decides the result.
pub fn input_hash(source: &Source, options: &Options) -> String {
    hash::combine([
        ("leaf", source.hash.as_str()),
        ("options", &options.describe()),
        ("program", env!("CARGO_PKG_VERSION")),
    ])
}

/// Computes the translucency maps of the leaf fit in `input` into the folder `out`.
///
/// # Errors
/// An input that is no leaf fit or is damaged (exit code 2), a slab that the leaf fit did not determine (1), a folder
/// that cannot be written (2).
pub fn run(input: &Path, out: &Path, options: &Options) -> Result<Outcome> {
    let clock = Instant::now();
    let source = Source::read(input, Frame::Mesh)?;
    record::claim(out, "translucency", &[input])?;
    let mut phases =
        vec![Phase { name: "read the leaf and integrate its heights".into(), seconds: clock.elapsed().as_secs_f64() }];
    let wanted = input_hash(&source, options);
    if !options.force
        && let Ok(record) = FitRecord::read(out)
        && record.input_hash == wanted
        && record.verify(out).is_ok()
    {
        return Ok(Outcome::UpToDate(Box::new(record)));
    }
    let made = make(&source, options, &mut phases)?;
    progress::go_on()?;
    let step = Instant::now();
    let record = folder::write(out, &source, &made, options, wanted)?;
    phases.push(Phase { name: "write maps".into(), seconds: step.elapsed().as_secs_f64() });
    let times = Times {
        total_s: clock.elapsed().as_secs_f64(),
        phases,
        threads: rayon::current_num_threads(),
        ..Times::default()
    };
    times.write(out)?;
    record.write(out)?;
    Ok(Outcome::Done(Box::new(record)))
}

/// All sides of a leaf, in memory.
///
/// # Errors
/// [`Error::Missed`] for a slab that the leaf fit did not determine.
pub fn make(source: &Source, options: &Options, phases: &mut Vec<Phase>) -> Result<Vec<Made>> {
    let channels = match (options.colour, options.channel) {
        (Colour::ThreeWavelengths, None) => vec![0, 1, 2],
        (Colour::ThreeWavelengths, Some(_)) => {
            return Err(Error::Usage("three wavelengths need no channel: every channel is computed".into()));
        }
        (_, Some(c)) => vec![c],
        (_, None) => vec![tissue::dominant(&source.sides)],
    };
    let one = |s| {
        progress::go_on()?;
        side::make(source, s, &channels, options, phases)
    };
    source.sides.iter().map(one).collect()
}
