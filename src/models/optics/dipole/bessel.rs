//! The modified Bessel functions K₀ and K₁ for |arg w| ≤ π/4. Near 0 they are power series (Abramowitz & Stegun 9.6.11,
//! 9.6.13). Elsewhere they are the integral K_ν(w) = ∫₀^∞ e^(−w cosh t) cosh νt dt (9.6.24), by the trapezoid rule.
//! Relative error about 1e-14.

use mesophyll_base::fourier::Complex;

const EULER_GAMMA: f64 = 0.577_215_664_901_532_9;

/// K₀(w) and K₁(w); 0 once e^(−w) underflows.
pub(crate) fn k01(w: Complex<f64>) -> [Complex<f64>; 2] {
    if w.norm() <= 2.0 { series(w) } else { integral(w) }
}

/// K₀(x) and K₁(x) for x > 0.
pub(crate) fn k01_real(x: f64) -> [f64; 2] {
    k01(Complex::new(x, 0.0)).map(|k| k.re)
}

fn series(w: Complex<f64>) -> [Complex<f64>; 2] {
    let q = w * w * 0.25;
    let one = Complex::new(1.0, 0.0);
    let log = (w * 0.5).ln() + EULER_GAMMA;
    // I₀ = Σ q^n/n!² and I₁ = (w/2) Σ q^n/(n!(n+1)!), together with the harmonic numbers of the logarithmic solutions.
    let (mut i0, mut i1, mut h0, mut h1) = (one, one, Complex::new(0.0, 0.0), one);
    let (mut t0, mut t1, mut harmonic) = (one, one, 0.0);
    for n in 1..24 {
        let n = f64::from(n);
        harmonic += 1.0 / n;
        t0 = t0 * q / (n * n);
        t1 = t1 * q / (n * (n + 1.0));
        i0 += t0;
        i1 += t1;
        h0 += t0 * harmonic;
        h1 += t1 * (2.0 * harmonic + 1.0 / (n + 1.0));
        if t0.norm() < 1e-18 * i0.norm() {
            break;
        }
    }
    [-log * i0 + h0, one / w + w * 0.5 * (log * i1 - h1 * 0.5)]
}

fn integral(w: Complex<f64>) -> [Complex<f64>; 2] {
    let step = (0.7 / w.norm().sqrt()).min(0.12);
    let (mut k0, mut k1) = (Complex::new(0.5, 0.0), Complex::new(0.5, 0.0));
    for j in 1..200 {
        let t = step * f64::from(j);
        let half = (0.5 * t).sinh();
        let rise = 2.0 * half * half; // cosh t − 1
        if w.re * rise > 42.0 {
            break;
        }
        let e = (-w * rise).exp();
        k0 += e;
        k1 += e * (1.0 + rise);
    }
    let scale = if w.re > 745.0 { Complex::new(0.0, 0.0) } else { (-w).exp() * step };
    [k0 * scale, k1 * scale]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_tables_and_the_wronskian() {
        // Abramowitz & Stegun, table 9.8 (e^x K at 2 and 10) and 9.6.11 at 0.1.
        for (x, k0, k1) in [
            (0.1, 2.427_069_024_702_017, 9.853_844_780_870_606),
            (2.0, 0.113_893_872_749_533_4, 0.139_865_881_816_522_4),
            (10.0, 1.778_006_231_616_765e-5, 1.864_877_345_382_558e-5),
        ] {
            let got = k01_real(x);
            assert!((got[0] / k0 - 1.0).abs() < 1e-14 && (got[1] / k1 - 1.0).abs() < 1e-14, "{x}: {got:?}");
        }
        assert_eq!(k01_real(1e4), [0.0, 0.0]);
    }

    #[test]
    fn series_and_integral_meet() {
        for arg in [0.0, -0.3, -0.785] {
            let w = Complex::from_polar(2.0, arg);
            for (a, b) in series(w).iter().zip(&integral(w)) {
                assert!((a - b).norm() < 3e-14 * b.norm(), "arg {arg}: {a} {b}");
            }
        }
        // K₀′ = −K₁ is checked by a central difference, also far out.
        for w in [Complex::from_polar(0.7, -0.7), Complex::from_polar(30.0, -0.7), Complex::new(300.0, 0.0)] {
            let e = 1e-5 * w.norm();
            let slope = (k01(w + e)[0] - k01(w - e)[0]) / (2.0 * e);
            assert!((slope + k01(w)[1]).norm() < 1e-5 * slope.norm(), "{w}");
        }
    }
}
