//! Least squares with few unknowns.

/// The coefficients with which terms meet values best. A sample is its terms and its value.
pub(crate) fn solved<const N: usize>(samples: impl Iterator<Item = ([f32; N], f32)>) -> [f32; N] {
    let mut matrix = vec![[0.0f64; N]; N];
    let mut right = [0.0f64; N];
    for (terms, value) in samples {
        let terms = terms.map(f64::from);
        for i in 0..N {
            right[i] += terms[i] * f64::from(value);
            for j in 0..=i {
                matrix[i][j] += terms[i] * terms[j];
            }
        }
    }
    // A little of each coefficient's own square keeps what the samples do not tell at 0.
    let mean = (0..N).map(|i| matrix[i][i]).sum::<f64>() / N as f64;
    for i in 0..N {
        matrix[i][i] += 1e-4 * mean + f64::MIN_POSITIVE;
        for j in 0..=i {
            let before: f64 = (0..j).map(|k| matrix[i][k] * matrix[j][k]).sum();
            let rest = matrix[i][j] - before;
            matrix[i][j] = if i == j { rest.max(1e-300).sqrt() } else { rest / matrix[j][j] };
        }
        let before: f64 = (0..i).map(|k| matrix[i][k] * right[k]).sum();
        right[i] = (right[i] - before) / matrix[i][i];
    }
    for i in (0..N).rev() {
        let after: f64 = (i + 1..N).map(|k| matrix[k][i] * right[k]).sum();
        right[i] = (right[i] - after) / matrix[i][i];
    }
    right.map(|c| c as f32)
}

#[cfg(test)]
mod tests {
    use super::solved;

    /// Values of a function of the terms give its coefficients back, and a value that is off moves them by its share.
    #[test]
    fn coefficients_are_found() {
        let terms = |k: usize| [1.0, k as f32, (k * k) as f32 / 10.0];
        let value = |k: usize| 3.0 - 0.5 * k as f32 + 0.2 * (k * k) as f32 / 10.0;
        let found = solved((0..10).map(|k| (terms(k), value(k))));
        assert!(found.iter().zip([3.0, -0.5, 0.2]).all(|(a, b)| (a - b).abs() < 0.05), "{found:?}");
        let mean = solved([([1.0], 1.0), ([1.0], 2.0), ([1.0], 6.0)].into_iter());
        assert!((mean[0] - 3.0).abs() < 1e-3, "{mean:?}");
    }
}
