//! Measures whether a picture repeats.

/// The correlation of a picture with itself, moved by `lag` pixels to the left and upwards: 1 where it repeats exactly,
/// near 0 where places that far apart have nothing to do with each other. It is Pearson's coefficient over all pixels
/// that lie in both pictures; NaN where there are none, or where they are all alike.
pub fn autocorrelation(values: &[f64], width: usize, lag: [usize; 2]) -> f64 {
    let height = values.len() / width.max(1);
    let pairs = || {
        let rows = 0..height.saturating_sub(lag[1]);
        rows.flat_map(move |y| (0..width.saturating_sub(lag[0])).map(move |x| y * width + x))
            // Relative to the first pixel, values that are all alike are exactly 0, and so is their variance.
            .map(|k| (values[k] - values[0], values[k + lag[1] * width + lag[0]] - values[0]))
    };
    let n = pairs().count() as f64;
    let (a, b) = pairs().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
    let sum = |of: &dyn Fn(f64, f64) -> f64| pairs().map(|(x, y)| of(x - a, y - b)).sum::<f64>();
    sum(&|x, y| x * y) / (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt()
}

/// The largest autocorrelation at the multiples of an eighth of a period (pixels, which eight divides), from half a
/// period to two periods along either side.
pub fn largest(values: &[f64], width: usize, period: [usize; 2]) -> f64 {
    let lags = (0..=16usize).flat_map(|i| (0..=16usize).map(move |j| [i, j])).filter(|[i, j]| *i.max(j) >= 4);
    let at = |[i, j]: [usize; 2]| autocorrelation(values, width, [i * period[0] / 8, j * period[1] / 8]);
    lags.map(at).fold(f64::NAN, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The autocorrelation of a wave of 16 pixels is the cosine of the lag, along the wave and not across it.
    #[test]
    fn a_wave_correlates_as_a_cosine() {
        let wave = |k: usize| (std::f64::consts::TAU * k as f64 / 16.0).sin();
        let picture: Vec<f64> = (0..96 * 80).map(|k| wave(k % 96)).collect();
        for lag in [0, 3, 8, 16] {
            // Over 64 or more pixels that are no whole number of waves, the mean is off by at most a sixth.
            let found = autocorrelation(&picture, 96, [lag, 7]);
            let right = (std::f64::consts::TAU * lag as f64 / 16.0).cos();
            assert!((found - right).abs() < if lag % 8 == 0 { 1e-9 } else { 0.05 }, "{lag}: {found} {right}");
        }
        assert!((largest(&picture, 96, [16, 16]) - 1.0).abs() < 1e-9);
        assert!(autocorrelation(&[0.1; 12], 4, [1, 1]).is_nan() && autocorrelation(&[1.0; 12], 4, [4, 0]).is_nan());
    }
}
