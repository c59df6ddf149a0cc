//! Pictures that are read back from the adapter.

use super::Renderer;
use crate::error::{Error, Result};
use crate::gpu::{Gpu, Options, headless};
use crate::picture::Picture;
use crate::readback::TextureCopy;
use crate::scene::Camera;
use glam::Vec3;

impl Renderer {
    /// Opens an adapter without a window.
    ///
    /// # Errors
    /// `NoAdapter` where nothing can draw, `Device` where the adapter refuses.
    pub fn headless(options: &Options) -> Result<Renderer> {
        Ok(Renderer::on(Gpu::open(&headless(options), None, options)?))
    }

    /// Draws a picture of `width` × `height` pixels.
    ///
    /// # Errors
    /// `Size` for an empty or too large picture, `Scene` for a camera that looks nowhere, `Readback`.
    pub fn render(&mut self, camera: &Camera, width: u32, height: u32) -> Result<Picture> {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        self.record(&mut encoder, camera, width, height, None)?;
        let Some(targets) = &self.targets else { return Err(Error::Readback("no target".into())) };
        let hdr = TextureCopy::record(&self.gpu, &mut encoder, &targets.hdr);
        let ldr = TextureCopy::record(&self.gpu, &mut encoder, &targets.ldr);
        self.gpu.queue.submit([encoder.finish()]);
        let picture = Picture { width, height, hdr: hdr.floats(&self.gpu)?, ldr: ldr.bytes(&self.gpu)? };
        self.count()?;
        Ok(picture)
    }

    /// Counts the triangles that the adapter has chosen for the last picture, which has been drawn.
    pub(super) fn count(&mut self) -> Result<()> {
        if let Some(choose) = self.loaded.as_ref().and_then(|l| l.choose.as_ref()) {
            let draws = choose.draws(&self.gpu)?;
            self.stats.triangles += draws.iter().map(|d| u64::from(d[0]) / 3 * u64::from(d[1])).sum::<u64>();
        }
        Ok(())
    }

    /// Draws the picture of the scene's scanner.
    ///
    /// # Errors
    /// As [`Renderer::render`], and `Scene` where there is no scanner.
    pub fn scan(&mut self, width: u32, height: u32) -> Result<Picture> {
        if self.loaded.as_ref().is_none_or(|l| l.scanner.is_none()) {
            return Err(Error::Scene {
                place: "scanner".into(),
                found: "none".into(),
                expected: "a scene with a scanner".into(),
            });
        }
        // The picture uses the scanner's own camera. This one only has to be valid.
        let camera = Camera { eye: 1e3 * Vec3::Z, target: Vec3::ZERO, up: Vec3::Y, fov_y_deg: 30.0 };
        self.render(&camera, width, height)
    }
}
