//! A small light far away, as points around its centre: the sun's disk, or any other shape.

use crate::{Error, Result};
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::PI;

/// A light far away: points around its centre, each with its share of the irradiance on a surface that faces it.
///
/// A point is the projection of its direction on the plane across the centre's direction. Its x is level (from z ×
/// centre) and its y is upwards, both as sines. A light straight above or below has its x along the world's x.
#[derive(Debug, Clone, PartialEq)]
pub struct AreaLight {
    points: Vec<DVec2>,
    /// Weights of the points, which sum to 1.
    weights: Vec<f64>,
    /// Whether all weights are equal.
    even: bool,
    reach: f64,
}

/// Largest distance of a point from the centre (a sine). The light must be small, because a surface is assumed to
/// respond equally to all of its directions.
const WIDEST: f64 = 0.5;
/// The largest number of points in a light.
pub const MOST_POINTS: usize = 65_536;

impl AreaLight {
    /// Points with their weights, which are scaled to sum to 1.
    ///
    /// # Errors
    /// [`Error::Usage`] for no points or more than [`MOST_POINTS`], a point whose sine from the centre is above ½, a
    /// weight that is negative or not finite, or weights that are all 0.
    pub fn new(points: &[(DVec2, f64)]) -> Result<AreaLight> {
        let bad = |what: String| Err(Error::Usage(format!("light: {what}")));
        if points.is_empty() || points.len() > MOST_POINTS {
            return bad(format!("{} points, expected 1 to {MOST_POINTS}", points.len()));
        }
        let all: f64 = points.iter().map(|(_, weight)| *weight).sum();
        if !(all > 0.0 && all.is_finite()) || points.iter().any(|(_, weight)| !(*weight >= 0.0)) {
            return bad("expected weights of at least 0, one of them above it".into());
        }
        if let Some((far, _)) = points.iter().find(|(p, _)| !(p.length() <= WIDEST)) {
            return bad(format!("a point at ({}, {}), expected at most {WIDEST} from the centre", far.x, far.y));
        }
        Ok(AreaLight {
            points: points.iter().map(|(p, _)| *p).collect(),
            weights: points.iter().map(|(_, weight)| weight / all).collect(),
            even: points.iter().all(|(_, weight)| *weight == points[0].1),
            reach: points.iter().map(|(p, _)| p.length()).fold(0.0, f64::max),
        })
    }

    /// A disk of uniform radiance with this `radius` (rad), by `count` points on a sunflower's spiral (Vogel 1979).
    /// Each represents the same area. A disk without extent is a single point.
    ///
    /// # Errors
    /// As [`AreaLight::new`].
    pub fn disk(radius: f64, count: usize) -> Result<AreaLight> {
        AreaLight::ellipse([radius; 2], count)
    }

    /// As [`AreaLight::disk`], with its half widths (rad) along x and y.
    ///
    /// # Errors
    /// As [`AreaLight::new`]; [`Error::Usage`] for a half width that is negative or not finite.
    pub fn ellipse(half_widths: [f64; 2], count: usize) -> Result<AreaLight> {
        if let Some(wrong) = half_widths.iter().find(|r| !(0.0..PI / 2.0).contains(*r)) {
            return Err(Error::Usage(format!("light: half width {wrong} rad, expected 0 to below π/2")));
        }
        let size = DVec2::from(half_widths.map(f64::sin));
        if size == DVec2::ZERO {
            return AreaLight::new(&[(DVec2::ZERO, 1.0)]);
        }
        let golden = PI * (3.0 - 5f64.sqrt());
        let on_spiral = |k: usize| {
            let r = ((k as f64 + 0.5) / count as f64).sqrt();
            (DVec2::from_angle(k as f64 * golden) * r * size, 1.0)
        };
        AreaLight::new(&(0..count.min(MOST_POINTS + 1)).map(on_spiral).collect::<Vec<_>>())
    }

    /// A simple polygon of uniform radiance with these corners (sines, in either order of rotation), by about `count`
    /// points.
    ///
    /// # Errors
    /// As [`AreaLight::new`].
    pub fn polygon(corners: &[DVec2], count: usize) -> Result<AreaLight> {
        let sides = || corners.iter().zip(corners.iter().cycle().skip(1));
        let inside = |p: DVec2| {
            let right_of = |(a, b): (&DVec2, &DVec2)| {
                (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x)
            };
            sides().filter(|side| right_of(*side)).count() % 2 == 1
        };
        let (low, high) =
            corners.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)));
        let area = 0.5 * sides().map(|(a, b)| a.perp_dot(*b)).sum::<f64>().abs();
        let size = high - low;
        // The number of points in the box around it of which about `count` are inside.
        let tries = (count as f64 * size.x * size.y / area).ceil();
        if !(area > 0.0 && tries <= 16.0 * MOST_POINTS as f64) {
            return Err(Error::Usage("light: a polygon without area".into()));
        }
        // A sequence with steps of 1/g and 1/g², where g³ = g + 1, fills a square evenly (Roberts 2018).
        let g = 1.324_717_957_244_746;
        let at = |k: usize| {
            let step = DVec2::new(1.0 / g, 1.0 / (g * g)) * (k as f64 + 0.5);
            low + size * step.fract()
        };
        let points: Vec<_> = (0..tries as usize).map(at).filter(|p| inside(*p)).map(|p| (p, 1.0)).collect();
        AreaLight::new(&points)
    }

    /// A light from a picture of its radiance: `rows` of equal length, row 0 on top, with the total width `width` (a
    /// sine). Each texel that is not black becomes a point.
    ///
    /// # Errors
    /// As [`AreaLight::new`].
    pub fn picture(rows: &[&[f64]], width: f64) -> Result<AreaLight> {
        let columns = rows.first().map_or(0, |row| row.len());
        if rows.iter().any(|row| row.len() != columns) {
            return Err(Error::Usage("light: a picture whose rows are not of one length".into()));
        }
        let texel = width / columns as f64;
        let middle = DVec2::new(columns as f64, rows.len() as f64) * 0.5;
        let place = |i: usize, j: usize| {
            let p = DVec2::new(i as f64 + 0.5, j as f64 + 0.5) - middle;
            DVec2::new(p.x, -p.y) * texel
        };
        let texels = rows.iter().enumerate().flat_map(|(j, row)| row.iter().enumerate().map(move |(i, v)| (i, j, *v)));
        AreaLight::new(&texels.filter(|(.., v)| *v != 0.0).map(|(i, j, v)| (place(i, j), v)).collect::<Vec<_>>())
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Always false, because a light has at least one point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Largest tangent between the centre and a point.
    pub(super) fn tangent(&self) -> f64 {
        self.reach / (1.0 - self.reach * self.reach).sqrt()
    }

    /// Largest sine between the centre and a point.
    pub(super) fn reach(&self) -> f64 {
        self.reach
    }

    /// The points by their tangents.
    pub(super) fn tangents(&self) -> Vec<DVec2> {
        self.points.iter().map(|p| *p / (1.0 - p.length_squared()).sqrt()).collect()
    }

    /// The direction of point `k` in the light's frame ([`frame`]).
    pub(crate) fn direction(&self, k: usize) -> DVec3 {
        let p = self.points[k];
        p.extend((1.0 - p.length_squared()).sqrt())
    }

    /// The share of the light that is visible, as a byte: 255 · (1 − the share of the points whose bits are set).
    pub(super) fn left(&self, hidden: &[u64]) -> u8 {
        let share = if self.even {
            let rest = (64 - self.points.len() % 64) % 64;
            let count: u32 =
                hidden.iter().rev().enumerate().map(|(k, w)| if k == 0 { w << rest } else { *w }.count_ones()).sum();
            1.0 - f64::from(count) / self.points.len() as f64
        } else {
            let seen = |k: &usize| hidden[k / 64] >> (k % 64) & 1 == 0;
            (0..self.points.len()).filter(seen).map(|k| self.weights[k]).sum()
        };
        (255.0 * share).round().clamp(0.0, 255.0) as u8
    }

    /// The weight of each point.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }
}

/// Unit vectors across, up and towards the centre of a light in `direction` (of any length above 0), as columns.
pub(crate) fn frame(direction: DVec3) -> DMat3 {
    let d = direction.normalize_or(DVec3::Z);
    let level = DVec3::Z.cross(d);
    let x = if level.length() > 1e-9 { level.normalize() } else { DVec3::X };
    DMat3::from_cols(x, d.cross(x), d)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The share of the points on one side of a straight edge at distance `t` from the centre. `angle` is that of the
    /// edge's normal.
    fn beyond(light: &AreaLight, angle: f64, t: f64) -> f64 {
        let normal = DVec2::from_angle(angle);
        light.points.iter().zip(&light.weights).filter(|(p, _)| p.dot(normal) > t).map(|(_, w)| w).sum()
    }

    /// A straight edge cuts a segment off a disk, whose area is known. The error decreases faster than 1/√N, which
    /// random points would give.
    #[test]
    fn a_disk_s_points_divide_it_as_area_does() {
        let radius = 0.00465f64;
        let worst = |count: usize| {
            let light = AreaLight::disk(radius, count).unwrap();
            assert!((light.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            let mut worst = 0f64;
            for a in 0..24 {
                for k in -9..=9 {
                    let (angle, h) = (a as f64 * 0.27, k as f64 / 10.0);
                    let segment = (h.acos() - h * (1.0 - h * h).sqrt()) / PI;
                    worst = worst.max((beyond(&light, angle, h * radius.sin()) - segment).abs());
                }
            }
            worst
        };
        let (few, many) = (worst(16), worst(1024));
        assert!(few < 0.13 && many < few / 8.0, "{few} with 16 points, {many} with 1,024");
    }

    #[test]
    fn other_shapes_have_their_area_where_it_is() {
        let square = [[-0.1, -0.1], [0.3, -0.1], [0.3, 0.1], [-0.1, 0.1]].map(DVec2::from);
        let light = AreaLight::polygon(&square, 2000).unwrap();
        assert!((1900..=2100).contains(&light.len()), "{}", light.len());
        assert!((beyond(&light, 0.0, 0.1) - 0.5).abs() < 0.01);
        let ellipse = AreaLight::ellipse([0.2, 0.05], 2000).unwrap();
        assert!(ellipse.points.iter().all(|p| p.x.abs() <= 0.2f64.sin() && p.y.abs() <= 0.05));
        let picture = AreaLight::picture(&[&[0.0, 3.0], &[1.0, 0.0]], 0.2).unwrap();
        assert_eq!(picture.points, [DVec2::new(0.05, 0.05), DVec2::new(-0.05, -0.05)]);
        assert_eq!(picture.weights, [0.75, 0.25]);
        assert_eq!((picture.left(&[0]), picture.left(&[1]), picture.left(&[3])), (255, 64, 0));
    }

    #[test]
    fn a_light_that_is_none_is_refused() {
        let said = |light: Result<AreaLight>| light.unwrap_err().to_string();
        assert!(said(AreaLight::disk(0.005, 0)).contains("0 points"));
        assert!(said(AreaLight::disk(0.005, MOST_POINTS + 1)).contains("65537 points"));
        assert!(said(AreaLight::disk(f64::NAN, 4)).contains("half width NaN"));
        assert!(said(AreaLight::disk(1.2, 4)).contains("from the centre"));
        assert!(said(AreaLight::new(&[(DVec2::ZERO, 0.0)])).contains("weights"));
        assert!(said(AreaLight::new(&[(DVec2::ZERO, f64::NAN)])).contains("weights"));
        assert!(said(AreaLight::new(&[(DVec2::NAN, 1.0)])).contains("from the centre"));
        assert!(said(AreaLight::polygon(&[DVec2::ZERO; 3], 9)).contains("without area"));
        assert!(said(AreaLight::polygon(&[], 9)).contains("without area"));
        assert!(said(AreaLight::picture(&[&[1.0], &[]], 0.1)).contains("one length"));
        assert_eq!(AreaLight::disk(0.0, 64).unwrap().len(), 1);
    }
}
