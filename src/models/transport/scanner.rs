//! The picture of a scanner: every pixel's centre along the camera's parallel rays, under the light of the tube.
//!
//! The tube is a cylinder of uniform radiance. A texel sees it under the angles θ ± asin(radius/distance) across, and
//! between the angles of its ends along it. Radiance is a plain sum over both angles, with many midpoints each. No
//! formula of `optics::tube` is used, so this is a check of them.

use super::accelerate::Ray;
use super::renderer::ReferenceRenderer;
use super::world::ReferenceScanner;
use crate::{Error, Result};
use glam::DVec3;
use rayon::prelude::*;

/// Numbers of midpoints along the tube and across it.
const ALONG: usize = 200;
const ACROSS: usize = 5;

impl ReferenceScanner {
    /// ∫ g(l) over the tube's solid angle as seen from `point`, in units where ∫ cosθ/π of an infinite tube straight
    /// above is 1.
    pub(super) fn gathered(&self, point: DVec3, of: impl Fn(DVec3) -> [f64; 2]) -> [f64; 2] {
        let (travel, along) = if self.along_x { (point.y, point.x) } else { (point.x, point.y) };
        let (away, up) = (self.at_mm - travel, self.height_mm - point.z);
        let distance = away.hypot(up);
        let theta = away.atan2(up);
        let beta = (self.radius_mm / distance).min(1.0).asin();
        let ends = [-0.5, 0.5].map(|s| ((s * self.length_mm - along) / distance).atan());
        let step = (ends[1] - ends[0]) / ALONG as f64;
        let across = if beta > 0.0 { ACROSS } else { 1 };
        let mut sum = [0.0; 2];
        for k in 0..across {
            let t = theta + beta * ((2 * k + 1) as f64 / across as f64 - 1.0);
            for i in 0..ALONG {
                let phi = ends[0] + (i as f64 + 0.5) * step;
                let (s, c) = phi.sin_cos();
                let local = [t.sin() * c, s, t.cos() * c];
                let l = if self.along_x { DVec3::new(local[1], local[0], local[2]) } else { DVec3::from(local) };
                let [a, b] = of(l);
                sum[0] += c * a;
                sum[1] += c * b;
            }
        }
        // The brightness of a cylinder: the angle that it fills, over the angle that follows from the distance of its
        // axis.
        let spread = if beta > 0.0 { beta / self.radius_mm } else { 1.0 / distance };
        sum.map(|v| v * step / across as f64 * 2.0 * spread * self.height_mm)
    }
}

impl ReferenceRenderer<'_> {
    /// Radiance at the centres of the wanted pixels of a `width` × `height` picture; NaN elsewhere.
    ///
    /// # Errors
    /// [`Error::Usage`] for a world without a scanner.
    pub fn scan(&self, width: usize, height: usize, wanted: impl Fn(usize) -> bool + Sync) -> Result<Vec<[f64; 3]>> {
        let Some(scanner) = self.world().scanner else {
            return Err(Error::Usage("scan: the world has no scanner".into()));
        };
        let pixel = |k: usize| {
            if !wanted(k) {
                return [f64::NAN; 3];
            }
            let x = ((k % width) as f64 + 0.5 - 0.5 * width as f64) * scanner.pixel_mm;
            let y = (0.5 * height as f64 - (k / width) as f64 - 0.5) * scanner.pixel_mm;
            self.look(&Ray::new(DVec3::new(x, y, 0.0) + scanner.camera * (10.0 * scanner.height_mm), -scanner.camera))
        };
        Ok((0..width * height).into_par_iter().with_min_len(16).map(pixel).collect())
    }
}
