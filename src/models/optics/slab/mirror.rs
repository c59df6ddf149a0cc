//! What the two faces of a slab reflect by themselves: the slab that absorbs but does not scatter.
//!
//! A beam that keeps the share y in one crossing leaves such a slab as T = (1−r)² y / (1 − r²y²) and R = r + r y T,
//! where r is a face's reflectance for the beam. Scattering adds to R at the same T, so this R is the least that a slab
//! of the transmittance T can have.

/// The faces' reflectance for the beam; 0 for a slab of the index of its surroundings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaceReflectance {
    r: f64,
    clear: f64,
}

impl FaceReflectance {
    /// Faces between air and `index` ≥ 1, for a beam along the normal; 1 reflects nothing.
    pub fn of_index(index: f64) -> FaceReflectance {
        let r = ((index - 1.0) / (index + 1.0)).powi(2);
        FaceReflectance { r, clear: (1.0 - r) / (1.0 + r) }
    }

    /// Whether the faces reflect nothing.
    #[inline]
    pub fn is_none(&self) -> bool {
        self.r == 0.0
    }

    /// Reflectance of one face for the beam.
    #[inline]
    pub fn face(&self) -> f64 {
        self.r
    }

    /// What both faces reflect of a beam where the slab's optical thickness, absorbing and scattering, is `delta`.
    pub fn unscattered(&self, delta: f64) -> f64 {
        let (r, y) = (self.r, (-delta).exp());
        r + r * (1.0 - r).powi(2) * y * y / (1.0 - (r * y).powi(2))
    }

    /// Transmittance of a slab that neither scatters nor absorbs, the largest there is.
    #[inline]
    pub fn clear(&self) -> f64 {
        self.clear
    }

    /// y at the transmittance `t`.
    #[inline]
    pub fn crossing(&self, t: f64) -> f64 {
        let a = (1.0 - self.r).powi(2);
        2.0 * t / (a + (a * a + (2.0 * self.r * t).powi(2)).sqrt())
    }

    /// R at the transmittance `t`, and its derivative by it.
    #[inline]
    pub fn reflectance(&self, t: f64) -> (f64, f64) {
        if self.is_none() {
            return (0.0, 0.0);
        }
        let (r, y) = (self.r, self.crossing(t));
        (r * (1.0 + y * t), 2.0 * r * y / (1.0 + (r * y).powi(2)))
    }

    /// 1 − T − R where ln(clear/T) is `depth`, and −1 times its derivative by T.
    #[inline]
    pub fn absorbed(&self, depth: f64) -> (f64, f64) {
        let missing = -(-depth).exp_m1();
        if self.is_none() {
            return (missing, 1.0);
        }
        let (r, r2) = (self.r, self.r * self.r);
        let left = 1.0 - missing;
        // 1 − y by the quadratic equation, without cancellation where little is missing
        let b = 2.0 * r2 * left + (1.0 - r2);
        let rest = 2.0 * (1.0 - r2) * missing / (b + (b * b - 4.0 * r2 * (1.0 - r2) * missing * left).sqrt());
        let y = 1.0 - rest;
        ((1.0 - r) * rest / (1.0 - r * y), (1.0 + r * y).powi(2) / (1.0 + (r * y).powi(2)))
    }

    /// ln(clear/T) where 1 − T − R is `missing`; keeps its digits where that is small.
    pub fn depth(&self, missing: f64) -> f64 {
        let (r, r2) = (self.r, self.r * self.r);
        let rest = missing * (1.0 - r) / ((1.0 - r) - r * missing);
        let y = 1.0 - rest;
        (rest * (1.0 + r2 * y) / ((1.0 - r2) * y)).ln_1p()
    }

    /// How much R exceeds [`FaceReflectance::reflectance`] where `back` is reflected and `on` transmitted by
    /// scattering, and `passed` is transmitted without. All digits of a weak scatterer are kept.
    pub fn excess(&self, back: f64, on: f64, passed: f64) -> f64 {
        let a = (1.0 - self.r).powi(2);
        let t = passed + on;
        let root = |t: f64| (a * a + (2.0 * self.r * t).powi(2)).sqrt();
        back - 2.0 * self.r * on * (t + passed) / (root(t) + root(passed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_is_the_slab_that_only_absorbs() {
        for index in [1.0, 1.2, 1.41, 2.0] {
            let mirror = FaceReflectance::of_index(index);
            let r = mirror.face();
            for y in [1e-9_f64, 0.03, 0.4, 0.9, 0.999] {
                let t = (1.0 - r).powi(2) * y / (1.0 - r * r * y * y);
                let want = r + r * y * t;
                let (got, slope) = mirror.reflectance(t);
                assert!((mirror.crossing(t) / y - 1.0).abs() < 1e-14 && (got - want).abs() < 1e-15, "{index} {y}");
                let step = 1e-5 * t;
                let by = (mirror.reflectance(t + step).0 - mirror.reflectance(t - step).0) / (2.0 * step);
                assert!((by - slope).abs() < 1e-6 * slope.max(1e-3), "{index} {y}: {by} {slope}");
                let (lost, fall) = mirror.absorbed(mirror.clear().ln() - t.ln());
                assert!((lost - (1.0 - t - want)).abs() < 1e-14 && (fall - 1.0 - slope).abs() < 1e-12);
                let depth = mirror.clear().ln() - t.ln();
                assert!((mirror.depth(lost) - depth).abs() < 1e-13 * depth.max(1.0) / y, "{index} {y}");
                // A part of the transmittance that came by scattering: the excess is a plain difference.
                let (back, on) = (0.02, 0.1 * t);
                let whole = want + back - mirror.reflectance(t + on).0;
                assert!((mirror.excess(back, on, t) - whole).abs() < 1e-15);
            }
        }
    }
}
