//! Least squares with few unknowns.

/// The coefficients with which terms meet values best, each with a weight. A sample is its terms, its value and its
/// weight.
pub(crate) fn solved<const N: usize>(samples: impl Iterator<Item = ([f32; N], f32, f32)>) -> [f32; N] {
    let mut matrix = vec![[0.0f64; N]; N];
    let mut right = [0.0f64; N];
    for (terms, value, weight) in samples {
        let terms = terms.map(f64::from);
        let weight = f64::from(weight).powi(2);
        for i in 0..N {
            let scaled = weight * terms[i];
            right[i] += scaled * f64::from(value);
            for j in 0..=i {
                matrix[i][j] += scaled * terms[j];
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
