//! The camera's sensor: seeded noise, three 16-bit exposures, each eight times longer than the next, saturation, and
//! the merging of the exposures. Values are in the units of a capture (1 = white texel under an infinite tube).

use mesophyll_base::random::RandomStream;

/// Factor between exposure times.
const STEP: f64 = 8.0;
/// Largest count of a 16-bit exposure; it means saturation.
pub(crate) const SATURATED: u16 = u16::MAX;
/// Exposures a frame.
pub(crate) const EXPOSURES: usize = 3;

#[derive(Debug, Clone, Copy)]
pub struct Sensor {
    /// Standard deviation relative to the value. 0 also switches off the floor and the counting.
    pub relative: f64,
    pub floor: f64,
    /// Value at which the shortest exposure saturates.
    pub full_scale: f64,
}

impl Sensor {
    /// Value at which exposure `e` saturates; exposure 0 is the longest.
    pub fn saturation(&self, e: usize) -> f64 {
        self.full_scale / STEP.powi((EXPOSURES - 1 - e) as i32)
    }

    /// Count of exposure `e` for a value.
    pub fn count(&self, value: f64, e: usize) -> u16 {
        (value / self.saturation(e) * f64::from(SATURATED)).round().clamp(0.0, f64::from(SATURATED)) as u16
    }

    /// The merged frame's value for a value that already carries its noise: the longest exposure that is not saturated,
    /// NaN where all are. Without noise it is the value itself, unless it saturates everywhere.
    pub fn merged(&self, value: f64) -> f32 {
        if self.relative == 0.0 {
            return if value < self.full_scale { value as f32 } else { f32::NAN };
        }
        for e in 0..EXPOSURES {
            let count = self.count(value, e);
            if count < SATURATED {
                return (f64::from(count) / f64::from(SATURATED) * self.saturation(e)) as f32;
            }
        }
        f32::NAN
    }

    /// Adds noise of standard deviation √((relative·value)² + floor²) to a row of values.
    pub fn disturb<'a>(&self, row: impl IntoIterator<Item = &'a mut f64>, mut stream: RandomStream) {
        if self.relative == 0.0 {
            return;
        }
        let normal = std::iter::repeat_with(|| stream.normal_pair()).flatten();
        for (value, n) in row.into_iter().zip(normal) {
            *value += n * (self.relative * *value).hypot(self.floor);
        }
    }

    /// The same sensor after averaging `n` shots.
    pub fn averaging(self, n: f64) -> Sensor {
        Sensor { relative: self.relative / n.sqrt(), floor: self.floor / n.sqrt(), ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SENSOR: Sensor = Sensor { relative: 0.01, floor: 5e-4, full_scale: 128.0 };

    #[test]
    fn noise_has_the_stated_spread_after_merging() {
        for value in [0.0, 0.03, 0.7, 5.0, 90.0] {
            let n = 40_000;
            let mut row = vec![value; n];
            // A dark level prevents noise around zero from being cut off by the counts.
            row.iter_mut().for_each(|v| *v += 0.01);
            SENSOR.disturb(&mut row, RandomStream::new(1, &[value.to_bits()]));
            let merged: Vec<f64> = row.iter().map(|&v| f64::from(SENSOR.merged(v))).collect();
            let mean = merged.iter().sum::<f64>() / n as f64;
            let sd = (merged.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n as f64).sqrt();
            let expected = (0.01 * (value + 0.01)).hypot(5e-4);
            // Standard error of a standard deviation: 1/√(2n) = .35 %; of the mean: sd/√n.
            assert!((sd / expected - 1.0).abs() < 0.015, "{value}: {sd} {expected}");
            assert!((mean - value - 0.01).abs() < 4.5 * expected / (n as f64).sqrt(), "{value}: {mean}");
        }
    }

    #[test]
    fn saturation_everywhere_is_no_reading() {
        assert!(SENSOR.merged(128.0).is_nan() && SENSOR.merged(500.0).is_nan());
        assert!((SENSOR.merged(100.0) / 100.0 - 1.0).abs() < 2e-5);
        let quiet = Sensor { relative: 0.0, ..SENSOR };
        assert_eq!(quiet.merged(1.234_567_8), 1.234_567_8f64 as f32);
        assert!(quiet.merged(128.0).is_nan());
    }
}
