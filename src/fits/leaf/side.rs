//! What the reference images of one side say before any texel is fitted: where the leaf is and what it lets through.

use crate::leaf::noise::CameraNoise;
use crate::{Error, Result};
use mesophyll_base::image::ImageSize;
use mesophyll_base::rgb::Rgb;
use mesophyll_capture::lightbox::{mask_from_transmission, transmittance};
use mesophyll_capture::reader::TubeCapture;
use mesophyll_optics::side::{Side, mirror};

/// Mask and transmittance of one side, in that side's image.
#[derive(Debug)]
pub struct SideTransmittance {
    pub side: Side,
    pub mask: Vec<bool>,
    pub rho_t: Vec<Rgb<f32>>,
    pub rho_t_err: Vec<Rgb<f32>>,
    /// Change of ρt when the dark frame is one standard deviation too high.
    pub rho_t_by_dark: Vec<Rgb<f32>>,
}

impl SideTransmittance {
    pub fn read(capture: &TubeCapture, side: Side, level: &CameraNoise) -> Result<SideTransmittance> {
        let (leaf, empty) = capture.lightbox(side)?;
        // The floor is that of calibrated values, but photographs of the box are in the camera's values.
        let floor = level.camera_floor() * level.lightbox;
        let found = transmittance(&leaf, &empty, level.relative * level.lightbox, floor, level.dark, capture.dark());
        let (width, height) = (capture.manifest.width, capture.manifest.height);
        let mask = match capture.mask()? {
            Some(front) if side == Side::Front => front,
            // The back's mask is the mirror image of the front's.
            Some(front) => mirror(&front, width),
            None => mask_from_transmission(&found.value, ImageSize::new(width, height)),
        };
        if !mask.contains(&true) {
            let path = capture.folder.join(if capture.folder.join("mask.exr").exists() {
                "mask.exr"
            } else {
                "front/lightbox.exr"
            });
            return Err(Error::input(
                &path,
                "no texel is on the leaf; expected a leaf darker than the bare light box, or a mask with ones",
            ));
        }
        Ok(SideTransmittance { side, mask, rho_t: found.value, rho_t_err: found.error, rho_t_by_dark: found.by_dark })
    }

    /// Texels on the leaf.
    pub fn count(&self) -> usize {
        self.mask.iter().filter(|m| **m).count()
    }
}
