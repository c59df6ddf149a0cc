//! Which levels of anchors light between leaves needs: those that the views of a scene come near enough for.

use super::transfer::views_decide;
use crate::manifest::SceneManifest;
use crate::placed::PlacedScene;
use glam::DVec3;
use mesophyll_transport::ReferenceCamera;
use mesophyll_transport::transfer::anchors::{level, levels};

/// The camera of a scene's pictures.
#[derive(Debug, Clone, Copy)]
pub struct PlanCamera {
    /// Place of the camera (mm).
    pub at: DVec3,
    /// The least angle between neighbouring pixels of its pictures (rad).
    pub pixel: f64,
    /// The angle between pixels in the middle of its pictures (rad), which is the largest one.
    pub middle: f64,
}

impl PlanCamera {
    /// The eye of pictures of this size. At the angle θ from the axis a pixel covers a smaller angle than in the
    /// middle. Across the direction from the middle it is smaller by cos θ, because the place on the picture plane is
    /// farther away. Along this direction it is smaller by cos² θ, because the ray also meets the picture at a slant.
    /// The corner has the largest θ.
    pub fn new(camera: &ReferenceCamera, [width, height]: [u32; 2]) -> PlanCamera {
        let up = camera.half_height();
        let pixels = f64::from(height.max(1));
        let across = up * f64::from(width) / pixels;
        let middle = 2.0 * up / pixels;
        PlanCamera { at: camera.eye, pixel: middle / (1.0 + up * up + across * across), middle }
    }

    /// Pixels that a ball of this centre and radius (mm) covers at least, where nothing hides it.
    pub fn pixels(&self, (centre, radius): (DVec3, f64)) -> f64 {
        std::f64::consts::PI * (radius / (self.at.distance(centre) * self.middle)).powi(2)
    }
}

/// As in `arrives.wgsl`: where anchors are fewer pixels apart than this, coarser anchors are mixed in.
const NEAR: f64 = 4.0;

/// The cameras of the perspective views. There are none where the views do not decide what is shown.
pub fn eyes(manifest: &SceneManifest, placed: &PlacedScene) -> Vec<PlanCamera> {
    if !views_decide(manifest, placed) {
        return Vec::new();
    }
    let size = [manifest.check.width, manifest.check.height];
    manifest.perspectives().map(|v| PlanCamera::new(&v.camera, size)).collect()
}

/// The finest level for which any eye is near enough: the distance between its pixels is fewer anchors than the next
/// level needs.
/// The `grid` of anchors lies on a leaf in a ball of this centre and radius (mm). Without an eye all levels are needed.
pub fn finest((centre, radius): (DVec3, f64), grid: [usize; 2], eyes: &[PlanCamera]) -> usize {
    // The least number of anchors for a unit of length, because a piece is not longer than the mesh.
    let dense = grid.map(|n| (n - 1) as f64 / (2.0 * radius));
    let dense = dense[0].min(dense[1]);
    let coarsest = (levels(grid) - 1) as f64;
    let of = |eye: &PlanCamera| {
        let passed = (eye.at.distance(centre) - radius).max(0.0) * eye.pixel * dense;
        (NEAR * passed).log2().clamp(0.0, coarsest) as usize
    };
    eyes.iter().map(of).min().unwrap_or(0)
}

/// The number of anchors of a grid's levels that are finer than `finest`.
pub fn finer(grid: [usize; 2], finest: usize) -> usize {
    (0..finest).map(|to| level(grid, to).iter().product::<usize>()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A leaf 60 mm long with five by three anchors: the coarser the level, the farther away every eye must be. An eye
    /// inside its ball, or no eye at all, keeps everything.
    #[test]
    fn only_levels_that_an_eye_comes_near_are_kept() {
        let at = |far: &[f64]| {
            let eyes: Vec<PlanCamera> =
                far.iter().map(|x| PlanCamera { at: DVec3::X * (100.0 + x), pixel: 1e-3, middle: 1e-3 }).collect();
            finest((DVec3::X * 100.0, 30.02), [5, 3], &eyes)
        };
        assert_eq!((at(&[]), at(&[10.0]), at(&[1e6])), (0, 0, 2));
        // Anchors are 30 mm apart across the leaf, which is half a distance for each pixel where a pixel is 15 mm wide.
        assert_eq!((at(&[1.45e4]), at(&[1.55e4]), at(&[1.55e4, 50.0])), (0, 1, 0));
        assert_eq!([0, 1, 2].map(|level| finer([5, 3], level)), [0, 15, 15 + 2]);
    }

    /// A disc of 10 mm at 1 m, where a pixel is 1 mm wide, covers π·10² pixels.
    #[test]
    fn a_ball_covers_as_many_pixels_as_its_disc() {
        let eye = PlanCamera { at: DVec3::ZERO, pixel: 1e-3, middle: 1e-3 };
        assert!((eye.pixels((DVec3::X * 1000.0, 10.0)) - 314.159).abs() < 1e-3);
    }
}
