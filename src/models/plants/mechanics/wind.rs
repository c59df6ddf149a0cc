//! Wind and the answer of a branch to it: spectra, resonance, mass, leaning, and the weights of a leaf's three motion
//! textures.
//!
//! Units: Hz, m, m/s, kg, s. Spectra are one-sided power densities.

use std::f64::consts::PI;

/// A mean wind and its gusts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wind {
    /// Mean speed v_m (m/s), positive.
    pub speed: f64,
    /// Standard deviation of the speed over its mean.
    pub turbulence: f64,
}

impl Wind {
    /// Power density of the speed ((m/s)²/Hz) at `f` (Hz): H9 Eq. 4.15, P ∝ v_m/(1 + f/v_m)^(5/3), scaled so that the
    /// integral over all frequencies is (turbulence · v_m)². The source's f/v_m means f · 1 m / v_m.
    pub fn spectrum(&self, f: f64) -> f64 {
        let sigma = self.turbulence * self.speed;
        // ∫ (1 + f/v)^(−5/3) df = 3v/2.
        sigma * sigma / (1.5 * self.speed) * (1.0 + f / self.speed).powf(-5.0 / 3.0)
    }
}

/// A branch as a damped oscillator about its root.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Oscillator {
    /// Undamped resonance f_h (Hz).
    pub resonance: f64,
    /// Damping γ (1/s), as in ẍ + γ ẋ + (2π f_h)² x = F/m; critical at 4π f_h.
    pub damping: f64,
}

impl Oscillator {
    /// A branch of `length` L (m): f_h = 2.55 L^(−0.59) (H9 Eq. 4.20, measured on broad-leaved trees), and 2.5 times
    /// that without leaves. `ratio` is the damping over the critical one.
    pub fn of_branch(length: f64, leafless: bool, ratio: f64) -> Self {
        let resonance = resonance(length, leafless);
        Oscillator { resonance, damping: ratio * 4.0 * PI * resonance }
    }

    /// Displacement per force (m/N) at `f` for a mass `m` (kg): H9 Eq. 4.16 with the denominator that the equation of
    /// motion gives, 2π m √((2π(f_h²−f²))² + (f γ)²). The print squares the wrong factor; γ is in 1/s (for a damping
    /// γ_h in Hz put γ = 2π γ_h).
    pub fn compliance(&self, f: f64, mass: f64) -> f64 {
        1.0 / (2.0 * PI * mass * self.denominator(f))
    }

    /// Amplification relative to a steady force: 1 at f = 0.
    pub fn response(&self, f: f64) -> f64 {
        2.0 * PI * self.resonance * self.resonance / self.denominator(f)
    }

    fn denominator(&self, f: f64) -> f64 {
        (2.0 * PI * (self.resonance * self.resonance - f * f)).hypot(f * self.damping)
    }
}

/// Resonance (Hz) of a branch of `length` (m), H9 Eq. 4.20.
pub fn resonance(length: f64, leafless: bool) -> f64 {
    2.55 * length.powf(-0.59) * if leafless { 2.5 } else { 1.0 }
}

/// A branch that sways in the wind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sway {
    /// The wind that it stands in.
    pub wind: Wind,
    /// Its resonance and damping.
    pub oscillator: Oscillator,
    /// Tip deflection over length that a steady wind of the mean speed would cause across the branch. The force is
    /// taken as proportional to the speed (H9 Eq. 4.19), so gusts of standard deviation σ add σ/v_m of it.
    pub lean: f64,
}

impl Sway {
    /// Power density (1/Hz) of the tip deflection over length.
    pub fn spectrum(&self, f: f64) -> f64 {
        let per_speed = self.lean / self.wind.speed * self.oscillator.response(f);
        per_speed * per_speed * self.wind.spectrum(f)
    }

    /// Highest frequency that a motion texture holds: 2 f_h (H9 §4.5.3).
    pub fn highest(&self) -> f64 {
        2.0 * self.oscillator.resonance
    }

    /// Steady tip deflection over length towards r and s in a wind that blows along the vector `wind`, of any length:
    /// H9 Eq. 4.21–4.22. A zero vector gives no lean.
    pub fn steady(&self, wind: [f64; 3], r: [f64; 3], s: [f64; 3]) -> [f64; 2] {
        let size = wind.iter().map(|c| c * c).sum::<f64>().sqrt();
        if !(size > 0.0 && size.is_finite()) {
            return [0.0; 2];
        }
        [r, s].map(|axis| self.lean * axis.iter().zip(wind).map(|(a, w)| a * w / size).sum::<f64>())
    }
}

/// A truncated cone that stands for a branch when its mass is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruncatedCone {
    /// Length (m).
    pub length: f64,
    /// Radius at the root (m).
    pub root: f64,
    /// Radius at the tip (m).
    pub tip: f64,
}

/// Mass (kg) of a branch and its sub-branches: H9 Eq. 4.17. `density` in kg/m³.
pub fn mass(density: f64, cones: &[TruncatedCone]) -> f64 {
    let volume = |c: &TruncatedCone| PI * c.length / 3.0 * (c.root * c.root + c.root * c.tip + c.tip * c.tip);
    density * cones.iter().map(volume).sum::<f64>()
}

/// Weights of a leaf's motion textures in the planes xy, yz and xz: H9 Eq. 4.27, 1 − |W_z|/|W| and so on, normalised to
/// a sum of 1 (the print's sum runs from 1.27 to 2). Without wind all three weigh the same.
pub fn leaf_weights(wind: [f64; 3]) -> [f64; 3] {
    let size = wind.iter().map(|c| c * c).sum::<f64>().sqrt();
    if !(size > 0.0 && size.is_finite()) {
        return [1.0 / 3.0; 3];
    }
    let free = [wind[2], wind[0], wind[1]].map(|c| 1.0 - c.abs() / size);
    let sum: f64 = free.iter().sum();
    free.map(|w| w / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gusts_hold_the_variance_that_is_asked_for() {
        let wind = Wind { speed: 4.0, turbulence: 0.3 };
        // ∫ over f = v (e^z − 1), by the trapezium rule in z.
        let n = 40_000;
        let h = 30.0 / f64::from(n);
        let sum: f64 = (0..n)
            .map(|k| {
                let z = (f64::from(k) + 0.5) * h;
                wind.spectrum(4.0 * z.exp_m1()) * 4.0 * z.exp() * h
            })
            .sum();
        assert!((sum / 1.44 - 1.0).abs() < 1e-4, "{sum}");
    }

    /// The response of Eq. 4.16 against the equation of motion stepped in time.
    #[test]
    fn the_oscillator_is_that_of_the_equation_of_motion() {
        let o = Oscillator { resonance: 1.3, damping: 3.0 };
        let mass = 2.5;
        for f in [0.2, 1.0, 1.3, 2.4] {
            let (dt, omega) = (1e-4, 2.0 * PI * f);
            let acceleration = |t: f64, x: f64, v: f64| {
                (omega * t).sin() / mass - o.damping * v - (2.0 * PI * o.resonance).powi(2) * x
            };
            let (mut x, mut v, mut t, mut peak) = (0.0, 0.0, 0.0, 0.0f64);
            let end = 12.0 + 2.0 / f;
            while t < end {
                let (k1x, k1v) = (v, acceleration(t, x, v));
                let (k2x, k2v) =
                    (v + 0.5 * dt * k1v, acceleration(t + 0.5 * dt, x + 0.5 * dt * k1x, v + 0.5 * dt * k1v));
                x += dt * k2x;
                v += dt * k2v;
                let _ = k1x;
                t += dt;
                if t > 12.0 {
                    peak = peak.max(f64::abs(x));
                }
            }
            let expected = o.compliance(f, mass);
            assert!((peak / expected - 1.0).abs() < 2e-3, "{f} Hz: {peak} {expected}");
            let steady = 1.0 / (mass * (2.0 * PI * o.resonance).powi(2));
            assert!((o.response(f) * steady / expected - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn figures_of_branches() {
        assert!((resonance(1.0, false) - 2.55).abs() < 1e-15 && (resonance(1.0, true) - 6.375).abs() < 1e-12);
        let cylinder = mass(700.0, &[TruncatedCone { length: 2.0, root: 0.01, tip: 0.01 }]);
        assert!((cylinder - 700.0 * PI * 1e-4 * 2.0).abs() < 1e-12);
        let cone = mass(700.0, &[TruncatedCone { length: 2.0, root: 0.01, tip: 0.0 }]);
        assert!((cone * 3.0 - cylinder).abs() < 1e-12);
    }

    #[test]
    fn weights_sum_to_one_and_survive_still_air() {
        assert_eq!(leaf_weights([0.0; 3]), [1.0 / 3.0; 3]);
        assert_eq!(leaf_weights([f64::NAN, 0.0, 0.0]), [1.0 / 3.0; 3]);
        // With wind along x, the plane yz is crossed head-on and gets no weight.
        assert_eq!(leaf_weights([3.0, 0.0, 0.0]), [0.5, 0.0, 0.5]);
        for w in [[1.0, 1.0, 1.0], [0.1, -2.0, 5.0], [1e-200, 0.0, 2e-200]] {
            assert!((leaf_weights(w).iter().sum::<f64>() - 1.0).abs() < 1e-12, "{w:?}");
        }
    }

    #[test]
    fn steady_wind_leans_along_itself() {
        let sway = Sway {
            wind: Wind { speed: 3.0, turbulence: 0.2 },
            oscillator: Oscillator::of_branch(1.0, false, 0.3),
            lean: 0.1,
        };
        let [a, b] = sway.steady([0.0, 2.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
        assert!((a - 0.1).abs() < 1e-15 && b == 0.0);
        assert_eq!(sway.steady([0.0; 3], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]), [0.0; 2]);
    }
}
