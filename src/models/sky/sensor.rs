//! Bands of sensors that a user states: boxes, or responses over wavelength. A band's value is the integral of spectrum
//! and response over that of the response, in even light. It is a sum of readings with weights that do not depend on
//! them: readings count as joined by straight lines, and so do the points of a response.

/// Share of a band that readings may leave out; there the nearest reading counts.
const LEFT_OUT: f64 = 0.01;
/// Widest gap between neighbouring readings where a band sees (nm).
const WIDEST: f64 = 20.0;

/// One band.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorBand {
    /// Its name in columns.
    pub name: String,
    /// Points of the response: wavelength (nm), ascending, and a value that is not negative. It is 0 outside.
    points: Vec<[f64; 2]>,
}

impl SensorBand {
    /// A band that sees all wavelengths of `width` nm around `centre` alike.
    ///
    /// # Errors
    /// A sentence where there is no such box.
    pub fn of_box(name: &str, centre: f64, width: f64) -> Result<SensorBand, String> {
        SensorBand::of_points(name, vec![[centre - 0.5 * width, 1.0], [centre + 0.5 * width, 1.0]])
    }

    /// A band with a response at wavelengths (nm).
    ///
    /// # Errors
    /// A sentence where wavelengths do not ascend or values are no response.
    pub fn of_points(name: &str, points: Vec<[f64; 2]>) -> Result<SensorBand, String> {
        if let Some(bad) = points.iter().find(|p| !(p[1] >= 0.0 && p[1].is_finite())) {
            return Err(format!("the response is {} at {} nm; expected 0 or more", bad[1], bad[0]));
        }
        if let Some([nm, _]) = points.iter().find(|p| !(p[0] > 0.0 && p[0].is_finite())) {
            return Err(format!("found a wavelength of {nm} nm; expected one above 0"));
        }
        if let Some(pair) = points.windows(2).find(|p| p[0][0] >= p[1][0]) {
            let [[a, _], [b, _]] = [pair[0], pair[1]];
            return Err(if a == b { format!("{a} nm stands twice") } else { format!("{b} nm stands after {a} nm") });
        }
        let seen = points.windows(2).any(|p| p[0][1] + p[1][1] > 0.0);
        seen.then(|| SensorBand { name: name.into(), points }).ok_or_else(|| "the response is 0 everywhere".into())
    }

    /// The weight of each reading at these wavelengths (nm), which ascend. They sum to 1.
    ///
    /// # Errors
    /// A sentence where the readings do not cover what the band sees, or lie too far apart.
    pub fn weights(&self, wavelengths: &[f64]) -> Result<Vec<f64>, String> {
        let (Some(&first), Some(&last)) = (wavelengths.first(), wavelengths.last()) else {
            return Err("no reading".into());
        };
        let (mut weights, mut all, mut beyond) = (vec![0.0; wavelengths.len()], 0.0, 0.0);
        for pair in self.points.windows(2).filter(|pair| pair[0][1] + pair[1][1] > 0.0) {
            let ([from, low], [to, high]) = (pair[0], pair[1]);
            let inside = wavelengths.iter().copied().filter(|nm| (from..to).contains(nm) && *nm > from);
            let mut knots: Vec<f64> = std::iter::once(from).chain(inside).collect();
            knots.push(to);
            for step in knots.windows(2) {
                let (a, b) = (step[0], step[1]);
                let middle = 0.5 * (a + b);
                let k = wavelengths.partition_point(|nm| *nm <= middle);
                let inside = k > 0 && k < wavelengths.len();
                if inside && wavelengths[k] - wavelengths[k - 1] > WIDEST {
                    let [below, above] = [wavelengths[k - 1], wavelengths[k]];
                    return Err(format!("no reading between {below} and {above} nm; expected one every {WIDEST} nm"));
                }
                // Simpson's rule is exact for a product of two straight lines.
                for (nm, part) in [(a, 1.0), (middle, 4.0), (b, 1.0)] {
                    let response = low + (high - low) * (nm - from) / (to - from);
                    let amount = part * response * (b - a) / 6.0;
                    all += amount;
                    if !inside {
                        beyond += amount;
                        weights[if k == 0 { 0 } else { k - 1 }] += amount;
                    } else {
                        let t = (nm - wavelengths[k - 1]) / (wavelengths[k] - wavelengths[k - 1]);
                        weights[k - 1] += (1.0 - t) * amount;
                        weights[k] += t * amount;
                    }
                }
            }
        }
        if beyond > LEFT_OUT * all {
            let [low, high] = [self.points[0][0], self.points[self.points.len() - 1][0]];
            return Err(format!("readings from {first} to {last} nm; expected {low} to {high} nm, which it sees"));
        }
        Ok(weights.into_iter().map(|w| w / all).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean(band: &SensorBand, wavelengths: &[f64], of: impl Fn(f64) -> f64) -> f64 {
        band.weights(wavelengths).unwrap().iter().zip(wavelengths).map(|(w, nm)| w * of(*nm)).sum()
    }

    /// Against sums over steps of .001 nm of the response and of the readings' straight lines.
    #[test]
    fn a_band_is_the_mean_over_its_response() {
        let readings: Vec<f64> = (0..40).map(|k| 400.0 + 9.7 * f64::from(k)).collect();
        let curve = |nm: f64| 0.3 + 0.2 * (nm / 23.0).sin();
        let line = |nm: f64| {
            let k = readings.partition_point(|w| *w <= nm).clamp(1, readings.len() - 1);
            let t = (nm - readings[k - 1]) / (readings[k] - readings[k - 1]);
            curve(readings[k - 1]) * (1.0 - t) + curve(readings[k]) * t
        };
        let bell = vec![[640.0, 0.0], [655.0, 0.9], [671.0, 1.0], [690.0, 0.0]];
        let value = |nm: f64| {
            let k = bell.partition_point(|p| p[0] <= nm).clamp(1, bell.len() - 1);
            bell[k - 1][1] + (bell[k][1] - bell[k - 1][1]) * (nm - bell[k - 1][0]) / (bell[k][0] - bell[k - 1][0])
        };
        let plain = |from: f64, to: f64, weight: &dyn Fn(f64) -> f64| {
            let n = ((to - from) * 1000.0) as usize;
            let at = |k: usize| from + (k as f64 + 0.5) / 1000.0;
            let sums = (0..n).map(at).fold([0.0; 2], |s, nm| [s[0] + weight(nm) * line(nm), s[1] + weight(nm)]);
            sums[0] / sums[1]
        };
        let boxed = SensorBand::of_box("490", 490.0, 65.0).unwrap();
        assert!((mean(&boxed, &readings, curve) - plain(457.5, 522.5, &|_| 1.0)).abs() < 1e-7);
        let band = SensorBand::of_points("red", bell.clone()).unwrap();
        assert!((mean(&band, &readings, curve) - plain(640.0, 690.0, &value)).abs() < 1e-7);
        // A narrow band between two readings.
        let narrow = SensorBand::of_box("n", 552.0, 2.0).unwrap();
        assert!((mean(&narrow, &readings, curve) - line(552.0)).abs() < 1e-12);
    }

    #[test]
    fn what_is_no_band_is_refused() {
        let said = |points: &[[f64; 2]]| SensorBand::of_points("x", points.to_vec()).unwrap_err();
        assert!(said(&[[500.0, 1.0], [490.0, 1.0]]).contains("490 nm stands after 500 nm"));
        assert!(said(&[[500.0, -1.0], [510.0, 1.0]]).contains("-1 at 500 nm"));
        assert!(said(&[[500.0, 0.0], [510.0, 0.0]]).contains("0 everywhere"));
        let band = SensorBand::of_box("560", 560.0, 40.0).unwrap();
        let weights = |readings: &[f64]| band.weights(readings);
        assert!(weights(&[]).unwrap_err().contains("no reading"));
        assert!(weights(&[500.0, 600.0]).unwrap_err().contains("between 500 and 600 nm"));
        assert!(weights(&[550.0, 560.0, 580.0]).unwrap_err().contains("expected 540 to 580 nm"));
        assert!(weights(&[540.0, 560.0, 580.0]).is_ok());
    }
}
