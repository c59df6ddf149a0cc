//! The directions that the pixels of a panorama look in. Azimuth grows from +x to +y, which is counter-clockwise seen
//! from above; z is up.
//!
//! - Equirectangular, 2:1 (whole sphere) or 4:1 (upper hemisphere), zenith in the top row, as [`panorama`] says:
//!   azimuth 2π(½ − u), zenith angle πv (or πv/2).
//! - Fisheye, square, equidistant about the zenith (an angular map that looks up). The top of the picture is +x and its
//!   right is +y. The zenith angle is the distance from the middle over half the width, times half the field. Outside
//!   of that circle there is nothing.
//!
//! Directions are those of pixel centres: u = (column + ½)/width, and v likewise for rows.

use mesophyll_sky::panorama;
use std::f64::consts::{PI, TAU};
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};

/// How a panorama maps pixels to directions, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum PanoramaProjectionKind {
    /// 2:1 (whole sphere) or 4:1 (upper hemisphere), zenith on top
    #[default]
    Equirectangular,
    /// Square, equidistant about the zenith (an angular map looking up)
    Fisheye,
}

/// How a panorama maps pixels to directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PanoramaProjection {
    /// Whole sphere (2:1) or upper hemisphere (4:1), with the zenith in the top row.
    Equirectangular,
    /// A circle in a square, equidistant about the zenith.
    Fisheye {
        /// The whole angle that the circle takes in (rad); π for a hemisphere.
        field: f64,
    },
}

impl PanoramaProjection {
    /// The projection of that kind; a fisheye's circle takes in `field_deg` degrees.
    pub fn of(kind: PanoramaProjectionKind, field_deg: f64) -> PanoramaProjection {
        match kind {
            PanoramaProjectionKind::Equirectangular => PanoramaProjection::Equirectangular,
            PanoramaProjectionKind::Fisheye => PanoramaProjection::Fisheye { field: field_deg.to_radians() },
        }
    }

    /// Whether pictures of this size are of this kind.
    ///
    /// # Errors
    /// What was expected, in words.
    pub fn check(self, width: usize, height: usize) -> Result<(), String> {
        match self {
            PanoramaProjection::Equirectangular if width != 2 * height && width != 4 * height => Err(format!(
                "found {width} x {height}; an equirectangular panorama is 2:1 (whole sphere) or 4:1 (upper \
                 hemisphere); see --projection"
            )),
            PanoramaProjection::Fisheye { .. } if width != height => {
                Err(format!("found {width} x {height}; a fisheye picture is square; see --projection"))
            }
            PanoramaProjection::Fisheye { field } if !(field > 0.0 && field <= TAU) => {
                Err(format!("the field is {} degrees; expected more than 0 and at most 360", field.to_degrees()))
            }
            _ => Ok(()),
        }
    }

    /// Unit vector of a pixel's centre; `None` outside a fisheye's circle.
    pub fn direction(self, width: usize, height: usize, column: usize, row: usize) -> Option<[f64; 3]> {
        let (u, v) = ((column as f64 + 0.5) / width as f64, (row as f64 + 0.5) / height as f64);
        match self {
            PanoramaProjection::Equirectangular => {
                Some(panorama::direction([u, if width == 4 * height { 0.5 * v } else { v }]))
            }
            PanoramaProjection::Fisheye { field } => {
                let (right, up) = (2.0 * u - 1.0, 1.0 - 2.0 * v);
                let r = right.hypot(up);
                let (theta, phi) = (0.5 * field * r, right.atan2(up));
                (r <= 1.0).then(|| [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()])
            }
        }
    }

    /// Height of a pixel in the middle of the picture (rad).
    pub fn pixel(self, width: usize, height: usize) -> f64 {
        match self {
            PanoramaProjection::Equirectangular if width == 4 * height => 0.5 * PI / height as f64,
            PanoramaProjection::Equirectangular => PI / height as f64,
            PanoramaProjection::Fisheye { field } => field / width as f64,
        }
    }

    /// Solid angle of a pixel (sr), in the direction of its centre; 0 outside a fisheye's circle.
    pub fn solid_angle(self, width: usize, height: usize, column: usize, row: usize) -> f64 {
        let Some(d) = self.direction(width, height, column, row) else { return 0.0 };
        let sin = d[0].hypot(d[1]);
        let pixel = self.pixel(width, height);
        match self {
            PanoramaProjection::Equirectangular => sin * pixel * TAU / width as f64,
            // A ring of the zenith angle θ has the circumference 2π sin θ, and 2πθ in the picture.
            PanoramaProjection::Fisheye { .. } => pixel * pixel * sin / d[2].clamp(-1.0, 1.0).acos().max(1e-12),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solid_angles_sum_to_what_the_picture_shows() {
        let sum = |p: PanoramaProjection, w: usize, h: usize| -> f64 {
            (0..w * h).map(|at| p.solid_angle(w, h, at % w, at / w)).sum()
        };
        assert!((sum(PanoramaProjection::Equirectangular, 200, 100) / (4.0 * PI) - 1.0).abs() < 1e-4);
        assert!((sum(PanoramaProjection::Equirectangular, 200, 50) / (2.0 * PI) - 1.0).abs() < 1e-4);
        assert!((sum(PanoramaProjection::Fisheye { field: PI }, 401, 401) / (2.0 * PI) - 1.0).abs() < 2e-3);
    }

    #[test]
    fn pixels_look_where_the_conventions_say() {
        let near = |d: Option<[f64; 3]>, want: [f64; 3]| {
            let d = d.unwrap();
            assert!((0..3).all(|k| (d[k] - want[k]).abs() < 0.01), "{d:?} {want:?}");
        };
        let e = PanoramaProjection::Equirectangular;
        near(e.direction(2000, 1000, 999, 499), [1.0, 0.0, 0.0]);
        near(e.direction(2000, 1000, 1499, 499), [0.0, -1.0, 0.0]);
        near(e.direction(2000, 1000, 0, 0), [0.0, 0.0, 1.0]);
        near(e.direction(2000, 500, 499, 499), [0.0, 1.0, 0.0]);
        let f = PanoramaProjection::Fisheye { field: PI };
        near(f.direction(1001, 1001, 500, 500), [0.0, 0.0, 1.0]);
        near(f.direction(1001, 1001, 500, 0), [1.0, 0.0, 0.0]);
        near(f.direction(1001, 1001, 1000, 500), [0.0, 1.0, 0.0]);
        assert!(f.direction(1001, 1001, 0, 0).is_none());
        assert!(
            e.check(300, 100).is_err() && e.check(400, 100).is_ok() && f.check(2, 1).is_err() && f.check(7, 7).is_ok()
        );
    }
}
