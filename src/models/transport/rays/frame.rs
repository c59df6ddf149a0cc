//! The frame in which a tree works. Its box spans −1 to 1 there, so that f32 has its full precision for any units and
//! any distance from the origin.

use glam::DVec3;

/// An axis-aligned box in f64.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bounds {
    pub low: DVec3,
    pub high: DVec3,
}

impl Bounds {
    /// The empty box.
    pub const EMPTY: Bounds = Bounds { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    pub fn is_empty(&self) -> bool {
        self.low.x > self.high.x
    }

    pub fn of(points: impl IntoIterator<Item = DVec3>) -> Bounds {
        points.into_iter().fold(Bounds::EMPTY, |b, p| Bounds { low: b.low.min(p), high: b.high.max(p) })
    }

    pub fn union(self, other: Bounds) -> Bounds {
        Bounds { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// The box, enlarged by the possible rounding error of its corners in f64.
    pub fn padded(self) -> Bounds {
        if self.is_empty() {
            return self;
        }
        let pad = DVec3::splat(1e-14 * self.low.abs().max(self.high.abs()).max_element());
        Bounds { low: self.low - pad, high: self.high + pad }
    }

    /// The eight corners.
    pub fn corners(&self) -> [DVec3; 8] {
        let pick = |low: f64, high: f64, upper: bool| if upper { high } else { low };
        std::array::from_fn(|k| {
            DVec3::new(
                pick(self.low.x, self.high.x, k & 1 != 0),
                pick(self.low.y, self.high.y, k & 2 != 0),
                pick(self.low.z, self.high.z, k & 4 != 0),
            )
        })
    }
}

/// The map local = (x − centre)·scale. The scale is a power of two, so it causes no rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Frame {
    pub centre: DVec3,
    pub scale: f64,
}

impl Frame {
    /// The frame in which `bounds` spans at least −½ to ½ and at most −1 to 1 along its longest side.
    pub fn of(bounds: &Bounds) -> Frame {
        if bounds.is_empty() {
            return Frame { centre: DVec3::ZERO, scale: 1.0 };
        }
        let centre = bounds.low * 0.5 + bounds.high * 0.5;
        // A box of a single point has no size, so its distance from the origin is used.
        let half = (bounds.high * 0.5 - bounds.low * 0.5).max_element().max(1e-15 * centre.abs().max_element());
        Frame { centre, scale: if half > 1e-290 { 2f64.powi(-(half.log2().floor() as i32) - 1) } else { 1.0 } }
    }

    /// A point in the frame.
    #[inline(always)]
    pub fn point(&self, p: DVec3) -> DVec3 {
        (p - self.centre) * self.scale
    }

    /// A box in the frame, rounded outwards to f32.
    pub fn rounded(&self, bounds: &Bounds) -> [[f32; 3]; 2] {
        [self.point(bounds.low).to_array().map(below), self.point(bounds.high).to_array().map(above)]
    }
}

/// The largest f32 that is not above x.
pub(crate) fn below(x: f64) -> f32 {
    let nearest = x as f32;
    if f64::from(nearest) > x { nearest.next_down() } else { nearest }
}

/// The smallest f32 that is not below x.
pub(crate) fn above(x: f64) -> f32 {
    -below(-x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Rounding is outwards, and at most to the neighbouring number.
        #[test]
        fn rounding_encloses(x in -1.0f64..1.0, exponent in -40i32..40) {
            let x = x * 2f64.powi(exponent);
            prop_assert!(f64::from(below(x)) <= x && x <= f64::from(above(x)));
            prop_assert!(f64::from(below(x).next_up()) >= x && f64::from(above(x).next_down()) <= x);
        }

        /// The box spans −1 to 1 in its frame, for any size and place.
        #[test]
        fn frames_fit(size in -3i32..10, x in -1.0f64..1.0, a in 0.01f64..1.0, b in 0.0f64..1.0) {
            let size = 10f64.powi(size);
            let low = DVec3::new(x, -x, 0.3) * 1e6;
            let bounds = Bounds { low, high: low + DVec3::new(a, b, 0.0) * size };
            let [low, high] = Frame::of(&bounds).rounded(&bounds);
            let most = low.iter().chain(&high).fold(0.0f32, |m, x| m.max(x.abs()));
            prop_assert!((0.4..=1.01).contains(&most), "{most}");
        }
    }
}
