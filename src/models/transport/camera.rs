//! A pinhole camera and its rays.

use super::accelerate::Ray;
use crate::{Error, Result};
use glam::DVec3;

/// A pinhole camera; row 0 of its picture is the top row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceCamera {
    /// Place of the camera.
    pub eye: DVec3,
    /// The point that it looks at.
    pub target: DVec3,
    /// The direction that is up in the picture.
    pub up: DVec3,
    /// Full vertical field of view (degrees), above 0 and below 180.
    pub fov_y_deg: f64,
}

impl ReferenceCamera {
    /// Half the height of what the picture shows at a distance of 1.
    pub fn half_height(&self) -> f64 {
        (0.5 * self.fov_y_deg).to_radians().tan()
    }

    /// The directions along the line of sight, to the right and up in the picture: unit vectors, or zero for a camera
    /// that looks nowhere or along its own up direction.
    pub fn axes(&self) -> [DVec3; 3] {
        let forward = (self.target - self.eye).normalize_or_zero();
        let right = forward.cross(self.up).normalize_or_zero();
        [forward, right, right.cross(forward)]
    }
}

/// The camera, as a map from the picture to rays.
#[derive(Debug, Clone, Copy)]
pub struct CameraRays {
    eye: DVec3,
    /// Direction at the top left corner, and the steps for one pixel to the right and down.
    corner: DVec3,
    right: DVec3,
    down: DVec3,
}

impl CameraRays {
    /// The rays of a camera through the pixels of a picture.
    ///
    /// # Errors
    /// [`Error::Usage`] for a camera that looks nowhere, or along its own up direction.
    pub fn new(camera: &ReferenceCamera, width: usize, height: usize) -> Result<CameraRays> {
        let [forward, right, above] = camera.axes();
        if forward == DVec3::ZERO || right == DVec3::ZERO || !(camera.fov_y_deg > 0.0 && camera.fov_y_deg < 180.0) {
            return Err(Error::Usage(format!(
                "camera: eye and target must differ, up must not lie along the view, and the field of view ({}°) must \
                 be within 0 to 180",
                camera.fov_y_deg
            )));
        }
        let pixel = 2.0 * camera.half_height() / height as f64;
        let (right, down) = (right * pixel, above.normalize() * -pixel);
        Ok(CameraRays {
            eye: camera.eye,
            corner: forward - right * (0.5 * width as f64) - down * (0.5 * height as f64),
            right,
            down,
        })
    }

    /// The ray through (x, y) in pixels, where (0, 0) is the top left corner. Its direction is a unit vector.
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        Ray::new(self.eye, (self.corner + self.right * x + self.down * y).normalize())
    }
}
