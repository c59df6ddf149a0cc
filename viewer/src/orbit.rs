//! Moving the camera with the pointer: orbit about the target, pan across the picture, zoom along the line of sight.

use crate::scene::Camera;
use glam::{Quat, Vec3};

/// Smallest angle between the line of sight and the upright axis (rad).
const POLE: f32 = 0.03;

/// A camera that turns about its target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrbitCamera {
    /// The camera as it is now.
    pub camera: Camera,
    /// The axis that stays upright.
    axis: Vec3,
    /// Smallest and largest distance (mm).
    reach: (f32, f32),
}

impl OrbitCamera {
    /// `radius` is that of the scene (mm). The distance stays between a thousandth of it and a hundred times it.
    pub fn new(camera: Camera, radius: f32) -> OrbitCamera {
        OrbitCamera { camera, axis: camera.up.normalize_or(Vec3::Z), reach: (1e-3 * radius, 1e2 * radius) }
    }

    /// Turns by angles (rad): positive `right` moves the eye to the left, as if the scene were dragged to the right.
    pub fn turn(&mut self, right: f32, down: f32) {
        let arm = self.camera.eye - self.camera.target;
        let arm = Quat::from_axis_angle(self.axis, -right) * arm;
        let side = self.axis.cross(arm).normalize_or(Vec3::X);
        let polar = arm.angle_between(self.axis);
        let change = (-down).clamp(POLE - polar, std::f32::consts::PI - POLE - polar);
        self.camera.eye = self.camera.target + Quat::from_axis_angle(side, change) * arm;
        self.camera.up = self.axis;
    }

    /// Moves by shares of the picture's height.
    pub fn pan(&mut self, right: f32, down: f32) {
        let arm = self.camera.eye - self.camera.target;
        let size = 2.0 * arm.length() * self.camera.half_height();
        let across = self.camera.up.cross(arm).normalize_or(Vec3::X);
        let up = arm.cross(across).normalize_or(Vec3::Y);
        let shift = size * (down * up - right * across);
        self.camera.eye += shift;
        self.camera.target += shift;
    }

    /// Moves closer by a factor; above 1 is closer.
    pub fn zoom(&mut self, factor: f32) {
        let arm = self.camera.eye - self.camera.target;
        let length = (arm.length() / factor).clamp(self.reach.0, self.reach.1);
        self.camera.eye = self.camera.target + arm.normalize_or(Vec3::Z) * length;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn orbit() -> OrbitCamera {
        let camera = Camera { eye: Vec3::new(0.0, -10.0, 0.0), target: Vec3::ZERO, up: Vec3::Z, fov_y_deg: 40.0 };
        OrbitCamera::new(camera, 5.0)
    }

    #[test]
    fn dragging_right_shows_the_left_and_poles_hold() {
        let mut o = orbit();
        o.turn(0.5, 0.0);
        assert!(o.camera.eye.x < 0.0 && (o.camera.eye.length() - 10.0).abs() < 1e-4);
        o.turn(0.0, 0.3);
        assert!(o.camera.eye.z > 0.0, "dragging down shows the top");
        for _ in 0..100 {
            o.turn(0.1, 0.5);
        }
        assert!(o.camera.eye.is_finite() && o.camera.eye.cross(Vec3::Z).length() > 0.1);
    }

    #[test]
    fn panning_moves_the_scene_with_the_pointer_and_zoom_is_bounded() {
        let mut o = orbit();
        o.pan(0.25, 0.0);
        assert!(o.camera.target.x < 0.0 && o.camera.target.z.abs() < 1e-5);
        o.pan(0.0, 0.25);
        assert!(o.camera.target.z > 0.0);
        for _ in 0..100 {
            o.zoom(2.0);
        }
        assert!((o.camera.eye - o.camera.target).length() >= 4e-3);
    }
}
