//! What photographs of a leaf are reduced to: maps of both sides, their errors and their defects.

use super::ruler::Scale;
use mesophyll_capture::dome::highlight::Highlight;
use mesophyll_optics::side::{Side, mirror};
use std::collections::BTreeMap;

/// One side, row-major as its camera saw it; NaN off the leaf.
#[derive(Debug, Clone)]
pub struct ReducedSide {
    /// Diffuse reflectance, a channel.
    pub rho_d: Vec<[f64; 3]>,
    /// Its standard error from noise and from the place in the picture.
    pub rho_d_err: Vec<[f64; 3]>,
    /// Relative standard error that all texels and channels share: card, light, slopes.
    pub alike: f64,
    /// Standard error that all texels of a channel share: gloss and the sheet.
    pub shared: [f64; 3],
    /// What the surface mirrors, as it was subtracted.
    pub gloss: Highlight,
    /// 1 good, 0 off the leaf, else the code of a defect (`mesophyll_optics::defect`).
    pub status: Vec<i16>,
    /// What was found on the way, by name.
    pub figures: BTreeMap<&'static str, f64>,
}

/// All photographs as maps.
#[derive(Debug, Clone)]
pub struct Reduced {
    /// Columns of every map.
    pub width: usize,
    /// Rows of every map.
    pub height: usize,
    /// Size of a texel (mm).
    pub texel_mm: f64,
    /// The scale of the front's picture.
    pub scale: Scale,
    /// Pixel of the front's picture at the upper left of the maps.
    pub origin: [usize; 2],
    /// Pixels of the front's picture a texel, each way.
    pub step: usize,
    /// Texels on the leaf in every picture, in the front's columns.
    pub mask: Vec<bool>,
    /// The front's maps.
    pub front: ReducedSide,
    /// The back's maps, in its own columns.
    pub back: ReducedSide,
    /// Transmittance, in the front's columns; NaN off the leaf.
    pub rho_t: Vec<[f64; 3]>,
    /// Its standard error from noise and from the place in the picture.
    pub rho_t_err: Vec<[f64; 3]>,
    /// Relative standard error of ρt that all texels share.
    pub rho_t_shared: [f64; 3],
    /// Standard deviation of a reading v of the pictures: √(photon·v + read²).
    pub noise: Noise,
}

/// The camera's noise: a linear reading v has the variance photon·v + read².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Variance over reading.
    pub photon: f64,
    /// Standard deviation without light.
    pub read: f64,
    /// Whether it is stated; otherwise it was estimated on the card.
    pub stated: bool,
}

impl Noise {
    /// The variance of a linear reading `v`.
    pub(super) fn variance(&self, v: f64) -> f64 {
        self.photon * v.max(0.0) + self.read * self.read
    }
}

impl Reduced {
    /// One side's maps.
    pub fn side(&self, side: Side) -> &ReducedSide {
        match side {
            Side::Front => &self.front,
            Side::Back => &self.back,
        }
    }

    /// A map of the front's columns as the camera of `side` saw it.
    pub fn seen<T: Copy>(&self, map: &[T], side: Side) -> Vec<T> {
        match side {
            Side::Front => map.to_vec(),
            Side::Back => mirror(map, self.width),
        }
    }
}
