//! A sky that is a picture of everything around, and the sun that it shows.
//!
//! The path tracer takes the picture as it is. In real time the sky is a few harmonics, in which a disk of half a
//! degree would be lost. So there the sun is taken out of the picture, and shines from its place as a disk of its own.

use crate::manifest::{Error, Result, SceneManifest, SceneSky, SceneSun, SunLight, SunLocation};
use glam::DVec3;
use mesophyll_base::statistics::median_of;
use mesophyll_files::progress;
use mesophyll_fits::sky::panorama::disk;
use mesophyll_fits::sky::panorama::picture::PanoramaPixel;
use mesophyll_fits::sky::panorama::projection::PanoramaProjection;
use mesophyll_transport::environment::Environment;
use std::f64::consts::PI;
use std::sync::Arc;

/// The sky of a scene whose light is a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureSky {
    /// The whole picture.
    pub whole: Arc<Environment>,
    /// The picture without the sun that was taken out, with at most [`COLUMNS`] columns.
    pub rest: Arc<Environment>,
}

/// Columns of the picture that is seen in real time.
const COLUMNS: usize = 4096;
/// Columns of the picture in which the sun is looked for.
const SEARCHED: usize = 2048;
/// The light around the sun is that of a ring of this width (rad).
const RING: f64 = 0.09;
/// The sun is looked for in directions whose sine of elevation is above this.
const LOWEST: f64 = 0.01;

impl SceneManifest {
    /// Reads the picture of the scene's sky, and takes the sun from it where the scene states none.
    ///
    /// # Errors
    /// [`Error::Input`] for a picture that cannot be read, or that shows no sun where the scene says that it does.
    pub(crate) fn read_picture(&mut self) -> Result<()> {
        let Some(sky) = self.panorama() else { return Ok(()) };
        let (path, wanted) = (self.resolve(&sky.environment), sky.sun == Some(SunLocation::Picture));
        let (turn, scale) = (sky.rotation_deg.unwrap_or(0.0), sky.scale.unwrap_or(1.0));
        let whole = Environment::read(&path)?.placed(turn, scale).map_err(|what| Error::input(&path, what))?;
        let reduced = whole.reduced(COLUMNS);
        let rest = match (taken_out(&reduced), self.sun.is_some()) {
            (Err(why), _) if wanted => {
                let what = format!("found \"in the picture\", but {}: {why}; expected a [sun]", path.display());
                return Err(Error::field(&self.path, "sky.sun", what));
            }
            (Err(_), _) => reduced,
            (Ok((sun, _)), true) => {
                let at = [sun.zenith_deg, sun.azimuth_deg].map(|a| a.round());
                progress::say(format_args!(
                    "warning: {} shows a sun at zenith {} and azimuth {} degrees, and the scene has a [sun] too; both \
                     give light",
                    path.display(),
                    at[0],
                    at[1]
                ));
                reduced
            }
            (Ok((sun, rest)), false) => {
                self.sun = Some(sun);
                rest
            }
        };
        if let Some(SceneSky::Picture(sky)) = &mut self.sky {
            sky.picture = Some(Arc::new(PictureSky { whole: Arc::new(whole), rest: Arc::new(rest) }));
        }
        Ok(())
    }
}

/// The sun of a picture, and the picture without it.
///
/// # Errors
/// Why it shows no sun, in words.
fn taken_out(map: &Environment) -> std::result::Result<(SceneSun, Environment), &'static str> {
    let small = map.reduced(SEARCHED);
    let (columns, rows, texels) = small.texels();
    let pixels = small.centres().zip(texels).enumerate().filter(|(_, ((d, _), _))| d.z > LOWEST);
    let pixel = |(at, ((d, _), texel)): (usize, ((DVec3, f64), &[f32; 3]))| PanoramaPixel {
        d: d.to_array(),
        value: texel.map(f64::from),
        at,
    };
    let seen: Vec<PanoramaPixel> = pixels.map(pixel).collect();
    let found = disk::find(&seen, f64::INFINITY, 3, PanoramaProjection::Equirectangular, [columns, rows])?;
    let reach = (2.5 * found.radius).max(2.0 * PI / rows as f64);
    let towards = DVec3::from(found.direction);
    let from = |d: DVec3| towards.cross(d).length().atan2(towards.dot(d));

    let (columns, rows, texels) = map.texels();
    let near: Vec<(usize, DVec3, f64)> = map
        .centres()
        .enumerate()
        .filter(|(_, (d, _))| towards.dot(*d) > (reach + RING).cos())
        .map(|(k, (d, size))| (k, d, size))
        .collect();
    let (inside, ring): (Vec<_>, Vec<_>) = near.into_iter().partition(|(_, d, _)| from(*d) < reach);
    let around =
        [0, 1, 2].map(|c| median_of(ring.iter().map(|(k, ..)| f64::from(texels[*k][c]))).unwrap_or(f64::NAN).max(0.0));
    let around = around.map(|v| if v.is_finite() { v } else { 0.0 });
    let mut rest = texels.to_vec();
    let (mut irradiance, mut middle) = ([0.0; 3], DVec3::ZERO);
    let mut weights = Vec::with_capacity(inside.len());
    for (k, d, size) in &inside {
        let more = [0, 1, 2].map(|c| size * (f64::from(texels[*k][c]) - around[c]).max(0.0));
        (0..3).for_each(|c| irradiance[c] += more[c]);
        (0..3).for_each(|c| rest[*k][c] = rest[*k][c].min(around[c] as f32));
        let weight = more.iter().sum::<f64>();
        middle += weight * *d;
        weights.push(weight);
    }
    let sum: f64 = weights.iter().sum();
    if !(sum > 0.0 && middle.length() > 0.0) {
        return Err("the brightest place is no brighter than what is around it");
    }
    let middle = middle.normalize();
    let square = |d: DVec3| middle.cross(d).length().atan2(middle.dot(d)).powi(2);
    let spread: f64 = inside.iter().zip(&weights).map(|((_, d, _), w)| w * square(*d)).sum::<f64>() / sum;
    // Between texels the light falls off linearly, which spreads each by a third of its width squared. A uniform disk
    // has half of its radius squared.
    let texel = (PI / rows as f64).powi(2) / 3.0;
    let radius = (2.0 * (spread + texel)).sqrt();
    let sun = SceneSun {
        zenith_deg: middle.truncate().length().atan2(middle.z).to_degrees(),
        azimuth_deg: middle.y.atan2(middle.x).to_degrees(),
        light: SunLight::Picture(irradiance),
        radius_deg: radius.to_degrees().min(45.0),
        moves: false,
    };
    debug_assert_eq!(rest.len(), columns * rows);
    Ok((sun, map.with_texels(rest).map_err(|_| "the picture has no radiance around it")?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_sky::panorama;

    /// A dim, blue sky with a sun whose irradiance, place and size are known, drawn by `parts`² points a texel.
    fn map(columns: usize, sun: DVec3, irradiance: [f64; 3], radius: f64) -> Environment {
        let (rows, parts) = (columns / 2, 9);
        let radiance = irradiance.map(|e| e / (PI * radius.sin().powi(2)));
        let near = (radius + 4.0 * PI / columns as f64).cos();
        let texel = |(k, centre): (usize, [f64; 3])| {
            let points = if DVec3::from(centre).dot(sun) > near { parts * parts } else { 0 };
            let inside = |n: &usize| {
                let at = |i: usize, part: usize, of: usize| (i as f64 + (part as f64 + 0.5) / parts as f64) / of as f64;
                let place = [at(k % columns, n % parts, columns), at(k / columns, n / parts, rows)];
                DVec3::from(panorama::direction(place)).dot(sun) > radius.cos()
            };
            let share = (0..points).filter(inside).count() as f64 / (parts * parts) as f64;
            [0, 1, 2].map(|c| ([0.2, 0.3, 0.5][c] + share * radiance[c]) as f32)
        };
        let texels = panorama::centres(columns, rows).enumerate().map(texel).collect();
        Environment::new(columns, rows, texels).unwrap()
    }

    #[test]
    fn the_sun_is_taken_out_with_its_light_place_and_size() {
        let sun = DVec3::new(-0.3, 0.6, 0.5).normalize();
        for (columns, radius) in [(1024usize, 0.01f64), (512, 0.02), (2048, 0.004_65)] {
            let whole = map(columns, sun, [6.0, 5.0, 4.0], radius);
            let (found, rest) = taken_out(&whole).unwrap();
            let at = DVec3::new(
                found.zenith_deg.to_radians().sin() * found.azimuth_deg.to_radians().cos(),
                found.zenith_deg.to_radians().sin() * found.azimuth_deg.to_radians().sin(),
                found.zenith_deg.to_radians().cos(),
            );
            let pixel = 2.0 * PI / columns as f64;
            assert!(at.cross(sun).length() < 0.1 * pixel, "{columns}: {at} {sun}");
            let wide = (radius * radius + 2.0 / 3.0 * pixel * pixel).sqrt();
            assert!((found.radius_deg.to_radians() / wide - 1.0).abs() < 0.15, "{columns}: {found:?} {wide}");
            for (c, want) in [6.0, 5.0, 4.0].into_iter().enumerate() {
                let got = found.irradiance().unwrap()[c];
                assert!((got / want - 1.0).abs() < 0.02, "{columns}: {got} {want}");
            }
            assert!(rest.texels().2.iter().all(|t| t[0] < 0.2001 && t[2] < 0.5001));
            // A map that is turned has its sun turned.
            let (turned, _) = taken_out(&whole.placed(90.0, 2.0).unwrap()).unwrap();
            assert!(((turned.azimuth_deg - found.azimuth_deg).rem_euclid(360.0) - 90.0).abs() < 0.05);
            assert!((turned.irradiance().unwrap()[0] / found.irradiance().unwrap()[0] - 2.0).abs() < 1e-5);
        }
        let even = Environment::new(64, 32, vec![[1.0; 3]; 64 * 32]).unwrap();
        assert!(taken_out(&even).unwrap_err().contains("far brighter"));
    }
}
