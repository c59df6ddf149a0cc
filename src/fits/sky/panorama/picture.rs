//! From a panorama's channels to the pixels that a fit may use: above the horizon, not hidden, not clipped.

use super::disk::{self, PanoramaDisk};
use super::projection::PanoramaProjection;
use crate::sky::{Error, Result};
use mesophyll_base::statistics::{NORMAL_SCATTER, median};
use mesophyll_files::image::ChannelMaps;
use std::path::Path;

/// Which channels hold the readings and the mask.
#[derive(Debug, Clone, PartialEq)]
pub struct PanoramaChannels {
    /// Three (R, G, B) or one (luminance).
    pub radiance: Vec<String>,
    /// Channel of the mask: a pixel with a value below ½ is hidden. An alpha channel `A` hides in the same way.
    pub mask: Option<String>,
    /// Readings from this value on are clipped. `None`: it is found as the highest reading, where several pixels share
    /// it.
    pub saturation: Option<f64>,
}

impl Default for PanoramaChannels {
    fn default() -> Self {
        PanoramaChannels { radiance: ["R", "G", "B"].map(String::from).to_vec(), mask: None, saturation: None }
    }
}

/// One usable pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PanoramaPixel {
    /// Unit vector, z > 0.
    pub d: [f64; 3],
    /// Readings; with one channel only the first counts.
    pub value: [f64; 3],
    /// row · width + column.
    pub at: usize,
}

/// Fate of a pixel, as `mask.Y` of the fit's map has it.
pub const USED: f32 = 1.0;
/// Below the horizon, or hidden by the mask.
pub const HIDDEN: f32 = 0.0;
/// As bright as the sensor can tell, or brighter.
pub const CLIPPED: f32 = -1.0;
/// Seen, but no clear sky: a cloud, a tree or the sun's disk.
pub const OUTLIER: f32 = -2.0;

/// The usable part of a panorama.
#[derive(Debug, Clone, PartialEq)]
pub struct PanoramaReadings {
    /// Columns of the picture.
    pub width: usize,
    /// Rows of the picture.
    pub height: usize,
    /// Channels with a reading: 3 (red, green, blue) or 1 (luminance).
    pub channels: usize,
    /// The pixels that a fit may use.
    pub pixels: Vec<PanoramaPixel>,
    /// How many pixels are above the horizon, hidden and clipped ones included.
    pub above: usize,
    /// How many of `above` the mask hides.
    pub hidden: usize,
    /// How many of `above` the sensor clipped.
    pub clipped: usize,
    /// A value a pixel: [`USED`], [`HIDDEN`] (also below the horizon), [`CLIPPED`].
    pub fate: Vec<f32>,
    /// Relative noise of a reading, from the scatter of neighbours in a row about a straight line; `None` where there
    /// are too few of them.
    pub scatter: Option<f64>,
    /// The sun's disk, or why none is seen.
    pub disk: std::result::Result<PanoramaDisk, &'static str>,
}

/// Pixels with a negative reading are left out while they are at most this share.
const NEGATIVE: f64 = 0.05;
/// Smallest number of pixels that a fit is tried on.
const LEAST: usize = 12;
/// Smallest number of triples of neighbours from which the noise is estimated.
const TRIPLES: usize = 60;
/// Directions whose sine of elevation is below this are left out because of haze, hills and refraction at the horizon.
const LOWEST: f64 = 0.01;

/// Reads and checks a panorama.
///
/// # Errors
/// [`Error::Input`] that names the file and the channel: no such channel, a size that the projection does not have,
/// negative readings, nothing left.
pub fn read(
    path: &Path,
    maps: &ChannelMaps,
    projection: PanoramaProjection,
    channels: &PanoramaChannels,
) -> Result<PanoramaReadings> {
    let (w, h) = (maps.width, maps.height);
    projection.check(w, h).map_err(|why| Error::field(path, "size", why))?;
    if !matches!(channels.radiance.len(), 1 | 3) {
        let found = channels.radiance.len();
        return Err(Error::Usage(format!(
            "--channels has {found} names; expected three (red, green, blue) or one (luminance)"
        )));
    }
    let planes: Vec<&[f32]> = channels.radiance.iter().map(|n| maps.require(path, n)).collect::<Result<_>>()?;
    let mask = channels.mask.as_ref().map(|n| maps.require(path, n)).transpose()?;
    let alpha = maps.get("A");
    if let Some(s) = channels.saturation.filter(|s| !(*s > 0.0)) {
        return Err(Error::Usage(format!("--saturation is {s}; expected more than 0")));
    }
    let mut fate = vec![HIDDEN; w * h];
    let mut seen = Vec::new();
    let (mut above, mut hidden, mut below) = (0, 0, 0);
    let mut negative: Option<(usize, usize)> = None;
    let mut ringing = Vec::new();
    for at in 0..w * h {
        let Some(d) = projection.direction(w, h, at % w, at / w).filter(|d| d[2] > LOWEST) else { continue };
        above += 1;
        let off = |plane: Option<&[f32]>| plane.is_some_and(|p| !(p[at] >= 0.5));
        if off(mask) || off(alpha) || planes.iter().any(|p| p[at].is_nan()) {
            hidden += 1;
            continue;
        }
        // Compression makes readings beside bright edges negative; such a pixel says nothing.
        let value: [f64; 3] = std::array::from_fn(|k| planes.get(k).map_or(0.0, |p| f64::from(p[at])));
        if let Some(k) = value.iter().position(|v| *v < 0.0) {
            negative.get_or_insert((at, k));
            below += 1;
            hidden += 1;
            // It may be the disk itself.
            ringing.push(PanoramaPixel { d, value: value.map(|v| v.max(0.0)), at });
            continue;
        }
        seen.push(PanoramaPixel { d, value, at });
    }
    if above == 0 {
        return Err(Error::input(path, "no pixel lies above the horizon"));
    }
    if let Some((at, k)) = negative.filter(|_| below as f64 > NEGATIVE * above as f64) {
        let what = format!(
            "found {} at column {}, row {}, and {below} of {above} pixels above the horizon are negative; expected \
             radiance of 0 or more (hide a pixel by NaN or a mask)",
            planes[k][at],
            at % w,
            at / w
        );
        return Err(Error::field(path, &channels.radiance[k], what));
    }
    if seen.is_empty() {
        return Err(Error::input(path, "the whole sky is hidden; expected visible pixels above the horizon"));
    }
    let level = channels.saturation.unwrap_or_else(|| shared_peak(&seen));
    let visible = [&seen[..], &ringing].concat();
    let disk = disk::find(&visible, level, planes.len(), projection, [w, h]);
    let bright: Vec<usize> = seen.iter().filter(|p| p.value.iter().any(|v| !(*v < level))).map(|p| p.at).collect();
    for at in &bright {
        // The neighbours are left out as well, because light of a clipped pixel spills over.
        let (column, row) = (at % w, at / w);
        for y in row.saturating_sub(1)..=(row + 1).min(h - 1) {
            for x in [(column + w - 1) % w, column, (column + 1) % w] {
                fate[y * w + x] = CLIPPED;
            }
        }
    }
    let before = seen.len();
    seen.retain(|p| fate[p.at] == HIDDEN);
    let clipped = before - seen.len();
    // A pixel that is clipped but was never seen stays hidden.
    let mut all = vec![HIDDEN; w * h];
    for p in &seen {
        all[p.at] = USED;
    }
    for at in bright {
        all[at] = CLIPPED;
    }
    if seen.len() < LEAST {
        let what = format!(
            "{} usable pixels above the horizon ({hidden} hidden, {clipped} clipped); expected {LEAST} or more",
            seen.len()
        );
        return Err(Error::input(path, what));
    }
    if seen.iter().all(|p| p.value == [0.0; 3]) {
        return Err(Error::input(path, "the sky is black: every visible reading is 0"));
    }
    let scatter = scatter(&seen, w, planes.len());
    Ok(PanoramaReadings {
        width: w,
        height: h,
        channels: planes.len(),
        pixels: seen,
        above,
        hidden,
        clipped,
        fate: all,
        scatter,
        disk,
    })
}

/// The highest reading where at least three pixels have it (the sensor's limit), otherwise infinity.
fn shared_peak(pixels: &[PanoramaPixel]) -> f64 {
    let top = pixels.iter().flat_map(|p| p.value).filter(|v| !v.is_nan()).fold(0.0, f64::max);
    let sharing = pixels.iter().filter(|p| p.value.iter().any(|v| *v >= top * (1.0 - 1e-6))).count();
    if top.is_infinite() || sharing >= 3 { top * (1.0 - 1e-6) } else { f64::INFINITY }
}

/// Where the sky is smooth, (a − 2b + c)/(√6 b) of three neighbours in a row has the standard deviation of the noise.
/// Its median is taken and scaled to a Gaussian's standard deviation.
fn scatter(pixels: &[PanoramaPixel], width: usize, channels: usize) -> Option<f64> {
    let mut all: Vec<f64> = Vec::new();
    for triple in pixels.windows(3) {
        let [a, b, c] = triple else { continue };
        if b.at != a.at + 1 || c.at != a.at + 2 || a.at / width != c.at / width {
            continue;
        }
        for k in 0..channels {
            let mean = (a.value[k] + b.value[k] + c.value[k]) / 3.0;
            if mean > 0.0 {
                all.push((a.value[k] - 2.0 * b.value[k] + c.value[k]).abs() / (6f64.sqrt() * mean));
            }
        }
    }
    (all.len() >= TRIPLES).then(|| (NORMAL_SCATTER * median(&mut all).unwrap_or(f64::NAN)).max(1e-6))
}
