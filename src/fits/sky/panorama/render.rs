//! Panoramas with a known answer. Any [`Sky`] is evaluated by its own code (not the fit's), turned and scaled, with
//! seeded noise, the sun's disk, and a sensor that clips.

use super::projection::PanoramaProjection;
use mesophyll_base::random::RandomStream;
use mesophyll_files::image::ChannelMaps;
use mesophyll_sky::{Sky, irradiance, projection};
use std::f64::consts::PI;

/// What is rendered, and with which settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PanoramaShot {
    /// Which directions the pixels look in.
    pub projection: PanoramaProjection,
    /// Columns of the picture.
    pub width: usize,
    /// Rows of the picture.
    pub height: usize,
    /// Azimuth of the sun (rad), from +x to +y.
    pub azimuth: f64,
    /// What one kcd/m² reads as.
    pub scale: f64,
    /// Relative standard error of every channel of every pixel.
    pub noise: f64,
    /// Seed of the noise; the same seed gives the same picture.
    pub seed: u64,
    /// Albedo of level ground below the horizon; 0 leaves it black.
    pub ground: f64,
    /// Whether the sun's disk is drawn (as one bright pixel or more).
    pub disk: bool,
    /// Readings beyond this value are cut to it; infinite: none are.
    pub clip: f64,
}

impl Default for PanoramaShot {
    fn default() -> Self {
        PanoramaShot {
            projection: PanoramaProjection::Equirectangular,
            width: 256,
            height: 128,
            azimuth: 0.0,
            scale: 1.0,
            noise: 0.0,
            seed: 0,
            ground: 0.0,
            disk: false,
            clip: f64::INFINITY,
        }
    }
}

/// Radius of the sun's disk (rad) and its luminance at the ground on a clear day (kcd/m²).
const SUN_RADIUS: f64 = 0.00465;
const SUN_RADIANCE: f64 = 1.6e6;

/// Channels R, G, B. Pixels outside a fisheye's circle are NaN.
pub fn render(sky: &dyn Sky, shot: &PanoramaShot) -> ChannelMaps {
    let (w, h) = (shot.width, shot.height);
    let (sin, cos) = shot.azimuth.sin_cos();
    let sun = sky.sun_zenith();
    let ground: [f64; 3] = if shot.ground > 0.0 {
        irradiance::on_level_ground(&projection::direct(sky, 2)).map(|e| shot.ground * e / PI)
    } else {
        [0.0; 3]
    };
    // Width of a pixel in the middle of the picture. The disk lights each pixel by the share of it that it covers.
    let pixel = match shot.projection {
        PanoramaProjection::Equirectangular => 2.0 * PI / w as f64,
        PanoramaProjection::Fisheye { field } => field / w as f64,
    };
    let reach = SUN_RADIUS.max(0.71 * pixel);
    let disk = SUN_RADIANCE * (SUN_RADIUS / reach).powi(2);
    let mut planes = [vec![f32::NAN; w * h], vec![f32::NAN; w * h], vec![f32::NAN; w * h]];
    for row in 0..h {
        for column in 0..w {
            let Some(d) = shot.projection.direction(w, h, column, row) else { continue };
            let at = row * w + column;
            // The direction relative to a sun at azimuth 0.
            let turned = [cos * d[0] + sin * d[1], cos * d[1] - sin * d[0], d[2]];
            let mut rgb = if d[2] > 0.0 { sky.rgb(turned) } else { ground };
            if shot.disk && d[2] > 0.0 && mesophyll_sky::angle_to_sun(sun, turned) < reach {
                rgb = rgb.map(|v| v + disk);
            }
            let mut stream = RandomStream::new(shot.seed, &[at as u64]);
            let ([a, b], [c, _]) = (stream.normal_pair(), stream.normal_pair());
            for (k, z) in [a, b, c].into_iter().enumerate() {
                planes[k][at] = (shot.scale * rgb[k] * (1.0 + shot.noise * z)).min(shot.clip) as f32;
            }
        }
    }
    let mut maps = ChannelMaps::new(w, h);
    for (name, plane) in ["R", "G", "B"].into_iter().zip(planes) {
        maps.push(name, plane);
    }
    maps
}
