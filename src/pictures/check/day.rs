//! The hours of a scene's day: the first perspective view under each of them, drawn into one picture from the fitted
//! polynomials. The mosaic has four columns, in the order of the hours. For every hour it is stated how far its
//! coefficients are from integrated ones.

use crate::told;
use mesophyll_base::error::Result;
use mesophyll_files::image;
use mesophyll_scene::draw::{handover, transfer};
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::placed::daylight::{self, Daylight};
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_scene::verdict::CheckHour;
use mesophyll_viewer as gpu;
use mesophyll_viewer::scene as viewer;
use std::path::Path;

/// Columns of the mosaic.
const COLUMNS: usize = 4;

/// The hours as one picture.
pub struct DayStrip {
    /// The hours, in the order of the day.
    pub hours: Vec<CheckHour>,
    /// The mosaic. A place without an hour is black.
    pub picture: gpu::Picture,
}

impl DayStrip {
    /// Writes the picture as PNG.
    ///
    /// # Errors
    /// [`mesophyll_base::error::Error::Write`] where it cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let gpu::Picture { width, height, ldr, .. } = &self.picture;
        image::write_png(path, *width as usize, *height as usize, ldr.as_flattened())
    }
}

/// Draws the hours, `w` × `h` pixels each; nothing without a `[day]` or a perspective view.
///
/// # Errors
/// [`mesophyll_base::error::Error::Missed`] where the renderer or the fit fails.
pub fn draw(
    scene: &LoadedScene,
    drawn: &viewer::Scene,
    renderer: &mut gpu::Renderer,
    (w, h): (u32, u32),
    ledger: &Ledger,
) -> Result<Option<DayStrip>> {
    let LoadedScene { manifest, plan, .. } = scene;
    let (Some(day), Some(sky)) = (&manifest.day, manifest.physical_sky()) else { return Ok(None) };
    let Some(view) = manifest.perspectives().next() else { return Ok(None) };
    let (tile_w, tile_h) = (w as usize, h as usize);
    let (columns, rows) = (day.hours.len().min(COLUMNS), day.hours.len().div_ceil(COLUMNS));
    let pixels = columns * tile_w * rows * tile_h;
    let mut mosaic = gpu::Picture {
        width: (columns * tile_w) as u32,
        height: (rows * tile_h) as u32,
        hdr: vec![[0.0; 4]; pixels],
        ldr: vec![[0, 0, 0, 255]; pixels],
    };
    let polynomials = daylight::polynomials(manifest, plan.light.sun_moves, ledger)?;
    let mut hours = Vec::new();
    let mut lit = drawn.clone();
    for (k, &hour) in day.hours.iter().enumerate() {
        let (zenith, azimuth) = day.sun(hour);
        let daylight = Daylight::at(manifest, zenith, azimuth, sky.turbidity)?;
        lit.dome = Some(handover::dome(&daylight, plan.light.sky_bands, polynomials)?);
        if let Some(sun) = &mut lit.sun {
            sun.direction = daylight::direction(daylight.zenith, azimuth).as_vec3();
            sun.irradiance = daylight.sun.map(|v| v as f32);
        }
        if let Some(found) = &scene.transfer {
            transfer::shade(found, daylight::direction(zenith, azimuth), &mut lit)?;
        }
        renderer.set_lights(&lit).map_err(told)?;
        let picture = renderer.render(&handover::camera(&view.camera), w, h).map_err(told)?;
        let (left, top) = ((k % COLUMNS) * tile_w, (k / COLUMNS) * tile_h);
        for (y, from) in (0..tile_h).map(|y| (y, y * tile_w..(y + 1) * tile_w)) {
            let at = (top + y) * columns * tile_w + left;
            mosaic.hdr[at..at + tile_w].copy_from_slice(&picture.hdr[from.clone()]);
            mosaic.ldr[at..at + tile_w].copy_from_slice(&picture.ldr[from]);
        }
        let (made, exact) = (
            daylight.light(plan.light.sky_bands, polynomials)?.harmonics,
            daylight.light(plan.light.sky_bands, None)?.harmonics,
        );
        let c00 = exact.get(0, 0);
        let error =
            made.distance(&exact).iter().zip(c00).map(|(d, c)| d / c.abs().max(f64::MIN_POSITIVE)).fold(0.0, f64::max);
        let (zenith_deg, azimuth_deg) = (zenith.to_degrees(), azimuth.to_degrees());
        hours.push(CheckHour { hour, zenith_deg, azimuth_deg, sun: daylight.sun, fit_error: error });
    }
    Ok(Some(DayStrip { hours, picture: mosaic }))
}
