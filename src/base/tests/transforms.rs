//! Transforms against the sums that define them. Here and not beside the code, so that `rustfft` is compiled once.

use mesophyll_base::fourier::{Complex, forward, inverse};

/// Against the sum itself, for lengths with and without small factors.
#[test]
fn transforms_are_the_sums_they_say() {
    for n in [1usize, 2, 12, 17, 60] {
        let x: Vec<Complex<f64>> = (0..n).map(|k| Complex::new((k as f64).sin(), 0.3 * (k as f64).cos())).collect();
        for (transform, sign) in [(forward(n), -1.0), (inverse(n), 1.0)] {
            let mut found = x.clone();
            transform.process(&mut found);
            for (k, value) in found.iter().enumerate() {
                let turn = sign * std::f64::consts::TAU * k as f64 / n as f64;
                let want: Complex<f64> =
                    x.iter().enumerate().map(|(m, x)| x * Complex::from_polar(1.0, turn * m as f64)).sum();
                assert!((value - want).norm() < 1e-12 * n as f64, "{n} {k}: {value} {want}");
            }
        }
    }
}
