//! The sun's disk in a panorama: the one bright, compact spot that nothing else in the sky comes near.
//!
//! A sensor of high range shows the disk as a few pixels, thousands of times brighter than the sky; one that clips
//! shows it as a plateau with the glare around it. Both are found in the same way. The bright pixels are those within a
//! tenth of the brightest, weighed by their light, or those that are clipped, weighed by their solid angle. They are
//! the sun's where most of their weight lies in one small cap of the sphere, and their centroid is its direction.
//! Several lamps, a bright cloud and the glow around a hidden sun fail that, and then there is no disk.
//!
//! A fault of one channel is no sun, and a sun is never blue: of three channels the darker of red and green counts
//! first. Pictures that were compressed with loss may keep the disk in one channel only. There the brightest channel
//! counts, where the others show the glow around it.

use super::picture::PanoramaPixel;
use super::projection::PanoramaProjection;
use super::start::angle;
use mesophyll_base::statistics::median_of;

/// A disk that was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PanoramaDisk {
    /// Direction of its middle, a unit vector.
    pub direction: [f64; 3],
    /// Standard error of the direction, along any great circle (rad).
    pub error: f64,
    /// Root mean square distance of its pixels from its middle (rad); of a round disk 0.71 of the radius.
    pub radius: f64,
    /// Brightness over the median of the sky; of a clipped disk at least that.
    pub contrast: f64,
    /// Whether the sensor clipped it.
    pub clipped: bool,
}

impl PanoramaDisk {
    /// Angle from the zenith (rad).
    pub fn zenith(&self) -> f64 {
        self.direction[2].clamp(-1.0, 1.0).acos()
    }

    /// Azimuth (rad), from +x to +y.
    pub fn azimuth(&self) -> f64 {
        self.direction[1].atan2(self.direction[0])
    }

    /// Whether it is so bright that no lamp and no cloud under a daylight sky could be it.
    pub fn certain(&self) -> bool {
        !self.clipped && self.contrast > CERTAIN
    }
}

/// What is looked for, of a disk that is shown as it is and of one that is clipped.
struct Kind {
    /// Radius of the cap that holds a disk (rad).
    cap: f64,
    /// Share of the bright pixels' weight that lies in it.
    share: f64,
    /// Largest root mean square distance from the middle (rad).
    radius: f64,
    /// Smallest brightness over the sky's median.
    contrast: f64,
    /// Error of the centroid over the root mean square distance. Glare is lopsided.
    lopsided: f64,
}

const SHOWN: Kind = Kind { cap: 0.07, share: 0.8, radius: 0.035, contrast: 50.0, lopsided: 0.15 };
const CLIPPED: Kind = Kind { cap: 0.14, share: 0.75, radius: 0.09, contrast: 2.0, lopsided: 0.3 };
/// Pixels of this share of the brightest one belong to the bright ones.
const BRIGHT: f64 = 0.1;
/// A disk is this many times brighter than the sky around it.
const EDGE: f64 = 8.0;
/// Brightness over the sky's median that only the sun has. Its disk is 1e5 times as bright as a clear sky.
const CERTAIN: f64 = 3e3;
/// Error of the middle of a spot whose pixels are known to half a pixel (pixels), and the least one (rad): a third of
/// the sun's radius, for a disk that leaves cover partly.
const HALF: f64 = 0.3;
const LEAST: f64 = 1.5e-3;
/// Share of a round spot's area that its pixels fill. Below it, something covers parts of it.
const FILLED: f64 = 0.5;
/// Bright pixels that are tried as the middle.
const SEEDS: usize = 200;

/// A disk that one channel shows has a glow in the others: within this angle (rad) of it, they are on average so
/// many times as bright as the sky's median.
const GLOW: (f64, f64) = (0.1, 4.0);

/// Looks for the disk among the visible pixels above the horizon. Readings from `level` on are clipped (infinite: none
/// are). `shape`: width and height of the picture.
///
/// # Errors
/// Why no disk is seen, in words.
pub fn find(
    seen: &[PanoramaPixel],
    level: f64,
    channels: usize,
    projection: PanoramaProjection,
    shape: [usize; 2],
) -> Result<PanoramaDisk, &'static str> {
    let darker = |p: &PanoramaPixel| if channels == 3 { p.value[0].min(p.value[1]) } else { p.value[0] };
    let first = find_in(seen, level, &darker, projection, shape);
    if channels != 3 || first.is_ok() {
        return first;
    }
    let brightest = |p: &PanoramaPixel| p.value.into_iter().fold(0.0, f64::max);
    let Ok(disk) = find_in(seen, level, &brightest, projection, shape) else { return first };
    let middle = median_of(seen.iter().map(darker)).unwrap_or(f64::NAN);
    let reach = GLOW.0.max(3.0 * projection.pixel(shape[0], shape[1]));
    let near: Vec<f64> = seen.iter().filter(|p| angle(p.d, disk.direction) <= reach).map(darker).collect();
    let glow = near.iter().sum::<f64>() / near.len().max(1) as f64;
    // The glow is not as bright as the disk, so it alone does not tell it from a lamp.
    if glow >= GLOW.1 * middle { Ok(PanoramaDisk { contrast: glow / middle, ..disk }) } else { first }
}

/// [`find`] by one measure of a pixel's light.
fn find_in(
    seen: &[PanoramaPixel],
    level: f64,
    light: &dyn Fn(&PanoramaPixel) -> f64,
    projection: PanoramaProjection,
    shape: [usize; 2],
) -> Result<PanoramaDisk, &'static str> {
    let [w, h] = shape;
    let area = |p: &PanoramaPixel| projection.solid_angle(w, h, p.at % w, p.at / w);
    let middle = median_of(seen.iter().map(light)).unwrap_or(f64::NAN);
    let peak = seen.iter().map(light).fold(0.0, f64::max);
    let clipped = peak >= level;
    let kind = if clipped { CLIPPED } else { SHOWN };
    let contrast = peak.min(level) / middle;
    if !(contrast >= kind.contrast) {
        return Err("nothing is far brighter than the sky");
    }
    let bright: Vec<(&PanoramaPixel, f64)> = seen
        .iter()
        .filter(|p| light(p) >= if clipped { level } else { BRIGHT * peak })
        .map(|p| (p, if clipped { area(p) } else { (light(p) - middle) * area(p) }))
        .collect();
    let whole: f64 = bright.iter().map(|b| b.1).sum();
    let pixel = projection.pixel(w, h);
    let cap = kind.cap.max(3.0 * pixel);
    let inside = |d: [f64; 3]| bright.iter().filter(move |(p, _)| angle(p.d, d) <= cap);
    let weight = |d: [f64; 3]| inside(d).map(|b| b.1).sum::<f64>();
    let seeds = bright.iter().step_by(bright.len().div_ceil(SEEDS).max(1)).map(|b| b.0.d);
    let Some(mut d) = seeds.max_by(|a, b| weight(*a).total_cmp(&weight(*b))) else {
        return Err("nothing is far brighter than the sky");
    };
    for _ in 0..20 {
        let mut sum = [0.0; 3];
        inside(d).for_each(|(p, weight)| (0..3).for_each(|k| sum[k] += weight * p.d[k]));
        let length = (sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]).sqrt();
        d = sum.map(|v| v / length);
    }
    let held = weight(d);
    if !(held >= kind.share * whole) {
        return Err("several places are as bright as the brightest one");
    }
    let square: f64 = inside(d).map(|(p, weight)| weight * angle(p.d, d).powi(2)).sum();
    let radius = (square / held).sqrt();
    if !(radius <= kind.radius.max(pixel)) {
        return Err("the brightest place is no compact disk");
    }
    let reach = (3.0 * radius).max(3.0 * pixel).max(0.05);
    let near = |p: &&PanoramaPixel| (reach..reach + 0.09).contains(&angle(p.d, d));
    let around = median_of(seen.iter().filter(near).map(light)).unwrap_or(f64::NAN);
    if !clipped && around * EDGE > peak {
        return Err("the brightest place is a glow without an edge");
    }
    let mut error = LEAST.hypot(HALF * pixel).hypot(kind.lopsided * radius);
    let filled: f64 = inside(d).map(|(p, _)| area(p)).sum::<f64>() / (std::f64::consts::TAU * radius * radius);
    // Pixels that are hidden or below the horizon may hide a part of the glare.
    let rim = 2.0 * radius + 2.0 * pixel;
    let there: f64 = seen.iter().filter(|p| angle(p.d, d) <= rim).map(area).sum();
    let cut = there < 0.9 * std::f64::consts::TAU * (1.0 - rim.cos());
    if radius > 1.5 * pixel && (filled < FILLED || cut) {
        error = error.hypot(0.6 * radius);
    }
    Ok(PanoramaDisk { direction: d, error, radius, contrast, clipped })
}
