//! What photographs of a leaf are reduced to: maps of both sides, their errors and their defects.

use super::noise::SensorNoise;
use super::ruler::PictureScale;
use crate::dome::highlight::Highlight;
use mesophyll_base::rgb::Rgb;
use mesophyll_optics::side::Sides;
use std::collections::BTreeMap;

/// One side, row-major as its camera saw it; NaN off the leaf.
#[derive(Debug, Clone)]
pub struct PhotoSideMaps {
    /// Diffuse reflectance, a channel.
    pub rho_d: Vec<Rgb>,
    /// Its standard error from noise and from the place in the picture.
    pub rho_d_err: Vec<Rgb>,
    /// Relative standard error that all texels and channels share: card, light, slopes.
    pub alike: f64,
    /// Standard error that all texels of a channel share: gloss, the sheet, the card's reading.
    pub shared: Rgb,
    /// Transmittance, a channel: of light that leaves this side along the normal.
    pub rho_t: Vec<Rgb>,
    /// Its standard error from noise and from the place in the picture.
    pub rho_t_err: Vec<Rgb>,
    /// Relative standard error of ρt that all texels share.
    pub rho_t_shared: Rgb,
    /// Whether this side faced the camera on the light table; otherwise ρt is what was seen from the other side.
    pub rho_t_seen: bool,
    /// What the surface mirrors, as it was subtracted.
    pub gloss: Highlight,
    /// 1 good, 0 off the leaf, else the code of a defect (`mesophyll_optics::defect`).
    pub status: Vec<i16>,
    /// What was found on the way, by name.
    pub figures: BTreeMap<&'static str, f64>,
}

/// All photographs as maps.
#[derive(Debug, Clone)]
pub struct PhotoMaps {
    /// Columns of every map.
    pub width: usize,
    /// Rows of every map.
    pub height: usize,
    /// Size of a texel (mm).
    pub texel_mm: f64,
    /// The scale of the front's picture.
    pub scale: PictureScale,
    /// Pixel of the front's picture at the upper left of the maps.
    pub origin: [usize; 2],
    /// Pixels of the front's picture a texel, each way.
    pub step: usize,
    /// Texels on the leaf in every picture, in the front's columns.
    pub mask: Vec<bool>,
    /// The maps of both sides, each in its own columns.
    pub sides: Sides<PhotoSideMaps>,
    /// The camera's noise in the front's picture.
    pub noise: SensorNoise,
}
