//! One lit side: its irradiance is projected onto the basis, sent through the tissue, normalised and judged.

use super::source::{TranslucencyLeaf, TranslucencySideMaps};
use super::tissue::{self, LightEntry};
use super::{Options, TexelArea, TissueName, TissueSource, TranslucencyColour, colour, judge};
use crate::record::FitTimes;
use crate::translucency::{Error, Result};
use mesophyll_files::progress::TaskProgress;
use mesophyll_optics::dipole::Tissue;
use mesophyll_optics::side::Side;
use mesophyll_optics::translucency::basis::{Projector, SampleWeights};
use mesophyll_optics::translucency::blade::{LitSide, SurfaceMaps};
use mesophyll_optics::translucency::convolution::{ConvolutionSettings, Convolver, TotalsSource};
use mesophyll_optics::translucency::horizon::Horizon;
use mesophyll_optics::translucency::irradiance::{self, Visibility};
use mesophyll_optics::translucency::levels::ThicknessLevels;
use mesophyll_optics::translucency::lights::{DirectionRule, DirectionSet};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::time::Instant;

/// The result of one lit side; images are in the columns of its camera.
#[derive(Debug, Clone)]
pub struct TranslucencySide {
    /// The side that the light enters.
    pub side: Side,
    /// Texels on the leaf, row by row.
    pub mask: Vec<bool>,
    /// The channels that were computed: 0 red, 1 green, 2 blue.
    pub channels: Vec<usize>,
    /// The tissue of each of `channels`.
    pub tissue: Vec<Tissue>,
    /// For each channel and basis function: coefficients of f, or of M with three wavelengths. With a fixed sun there
    /// is one image a channel, the value itself.
    pub coefficients: Vec<Vec<Vec<f64>>>,
    /// Thickness (mm), 0 off the leaf.
    pub thickness: Vec<f64>,
    /// The light of an even sky that enters, relative to a flat open texel, in the first channel. It combines entry,
    /// relief and the relief's shadows. 0 off the leaf.
    pub entering: Vec<f64>,
    /// Texels on the leaf that no light comes through.
    pub dark: usize,
    /// Figures for `fit.toml`, by name: above all, how far the basis is from the full convolution.
    pub figures: BTreeMap<String, f64>,
}

/// A facet counts for at most the area of this many texels: beyond, its normal shows noise more than slope.
const STEEPEST: f64 = 5.0;

/// The lit side in the form that light transport takes, in channel `c`: what enters a texel for each unit of n·ω.
/// `fit.toml` states `entry` and `area`.
pub fn surface(side: &TranslucencySideMaps, c: usize, entry: LightEntry, area: TexelArea) -> SurfaceMaps {
    let entry = |k: usize| match entry {
        LightEntry::Matched => 1.0,
        LightEntry::Albedo => (1.0 - f64::from(side.rho_d[c][k])).clamp(0.0, 1.0),
    };
    let area = |k: usize| match area {
        TexelArea::Facet => (1.0 / side.normal[k][2]).min(STEEPEST),
        TexelArea::Texel => 1.0,
    };
    SurfaceMaps {
        height: side.height.clone(),
        normal: side.normal.clone(),
        entry: (0..side.mask.len()).map(|k| entry(k) * area(k)).collect(),
    }
}

/// The lit side, with its surface.
pub fn lit<'a>(source: &TranslucencyLeaf, side: &'a TranslucencySideMaps, surface: &'a SurfaceMaps) -> LitSide<'a> {
    LitSide {
        side: if side.name == Side::Front { Side::Front } else { Side::Back },
        width: source.width,
        height: source.height,
        texel_mm: source.texel_mm,
        mask: Cow::from(&side.mask),
        thickness: Cow::from(&side.thickness),
        surface,
    }
}

/// The transport through one side's tissue.
///
/// # Errors
/// [`Error::Missed`] for a tissue or a thickness that no kernel can be made of.
pub fn convolver(
    source: &TranslucencyLeaf,
    side: &TranslucencySideMaps,
    tissue: &Tissue,
    options: &Options,
) -> Result<Convolver> {
    let range = side
        .thickness
        .iter()
        .zip(&side.mask)
        .filter(|(_, m)| **m)
        .fold([f64::INFINITY, 0.0], |[a, b]: [f64; 2], (d, _)| [a.min(*d), b.max(*d)]);
    let settings = ConvolutionSettings {
        form: options.form,
        levels: ThicknessLevels { count: options.levels, ..ThicknessLevels::default() },
        // LEAFMOD's coefficients belong to the transport equation. With its totals a flat uniform leaf lets through
        // what the slab says.
        totals: if options.tissue == TissueSource::Named(TissueName::Fit) {
            TotalsSource::Transport
        } else {
            TotalsSource::Form
        },
        ..ConvolutionSettings::new(*tissue, source.texel_mm)
    };
    Convolver::with(&settings, source.width, source.height, range[0], range[1])
        .map_err(|e| Error::Missed(format!("{} {}: {e}", source.name, side.name.name())))
}

/// Computes one side's maps.
///
/// # Errors
/// [`Error::Missed`] for a slab that the leaf fit did not determine, or that no kernel can be made of; [`Error::Usage`]
/// for lights that do not determine the basis.
pub fn make(
    source: &TranslucencyLeaf,
    side: &TranslucencySideMaps,
    channels: &[usize],
    options: &Options,
    times: &mut FitTimes,
) -> Result<TranslucencySide> {
    let name = side.name.name();
    let _bar = TaskProgress::of(format!("light through the {name}"));
    let mut phase = |what: &str, since: Instant| times.phase(&format!("{name}: {what}"), since);
    let step = Instant::now();
    let first = surface(side, channels[0], tissue::entry(options), options.area);
    let horizon = Horizon::new(&lit(source, side, &first));
    phase("horizon map", step);

    let lights = DirectionSet::new(options.lights);
    let mut projector = Projector::new(options.basis, &lights, SampleWeights::Gram).map_err(Error::Usage)?;
    // The last image is that of light from everywhere, which the measured colour is divided by. Its weights are scaled
    // so that exactly these directions give a flat leaf the value π.
    let cosines: f64 = lights.directions.iter().zip(&lights.weights).map(|(d, w)| w * d[2]).sum();
    projector.matrix.push(lights.weights.iter().map(|w| w * PI / cosines).collect());
    let mut made = TranslucencySide {
        side: side.name,
        mask: side.mask.clone(),
        channels: channels.to_vec(),
        tissue: Vec::new(),
        coefficients: Vec::new(),
        thickness: side.thickness.clone(),
        entering: Vec::new(),
        dark: 0,
        figures: BTreeMap::new(),
    };
    for &c in channels {
        let tissue = tissue::of(side, c, options)?;
        let surface = surface(side, c, tissue::entry(options), options.area);
        let lit = lit(source, side, &surface);
        let step = Instant::now();
        let mut sources = irradiance::project(&lit, &horizon, &projector, Visibility::Hard);
        if made.entering.is_empty() {
            made.entering = sources.last().map(|total| total.iter().map(|e| e / PI).collect()).unwrap_or_default();
        }
        if let Some([elevation, azimuth]) = options.sun {
            let total = sources.pop().unwrap_or_default();
            sources = vec![
                irradiance::irradiance(&lit, &horizon, judge::direction(elevation, azimuth), Visibility::Hard),
                total,
            ];
        }
        phase("irradiance and projection", step);
        let step = Instant::now();
        let convolver = convolver(source, side, &tissue, options)?;
        phase("kernels", step);
        let step = Instant::now();
        let mut images = convolver.run(&side.thickness, &sources);
        phase("convolution", step);
        let total = images.pop().unwrap_or_default();
        let dark = match options.colour {
            TranslucencyColour::Substituted => colour::substitute(&mut images, &total, &flat(options), &side.mask),
            TranslucencyColour::Product => colour::level(&mut images, &total, &side.mask),
            TranslucencyColour::ThreeWavelengths => 0,
        };
        made.dark = made.dark.max(dark);
        if options.sun.is_none() {
            let step = Instant::now();
            let letter = ["R", "G", "B"][c];
            let scale = judge::TranslucencyScale { colour: options.colour, total: &total, mask: &side.mask };
            for (figure, value) in judge::against_full(&lit, &horizon, &convolver, options.basis, &images, &scale) {
                made.figures.insert(format!("{figure}_{letter}"), value);
            }
            phase("judging the basis", step);
        }
        made.tissue.push(tissue);
        made.coefficients.push(images);
    }
    Ok(made)
}

/// Coefficients of a flat uniform leaf, f = n·ω.
fn flat(options: &Options) -> Vec<f64> {
    if let Some([elevation, _]) = options.sun {
        return vec![elevation.sin()];
    }
    let lights = DirectionSet::new(DirectionRule::Product { levels: 16, azimuths: 16 });
    let samples: Vec<f64> = lights.directions.par_iter().map(|d| d[2]).collect();
    Projector::new(options.basis, &lights, SampleWeights::Gram).map(|p| p.project(&samples)).unwrap_or_default()
}
