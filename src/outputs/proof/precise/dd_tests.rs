use super::*;

/// Reference values: mpmath at 60 digits, printed as two doubles.
#[test]
fn functions_agree_with_sixty_digit_references() {
    let cases = [
        ("exp 0.1", DoubleDouble::constant(0.1).exp(), 1.1051709180756477, -8.149523913327619e-17),
        ("exp -0.73", DoubleDouble::constant(-0.73).exp(), 0.48190899009020244, -2.5966514426892695e-18),
        ("exp 3.25", DoubleDouble::constant(3.25).exp(), 25.790339917193062, -2.0220949927714329e-16),
        ("exp -41.5", DoubleDouble::constant(-41.5).exp(), 9.479359653504757e-19, -6.881381692138951e-35),
        ("exp 300.7", DoubleDouble::constant(300.7).exp(), 3.911566412479153e+130, -2.2210200263893878e+114),
        ("ln 1e-08", DoubleDouble::constant(1e-08).ln(), -18.420680743952367, 1.757527539535928e-15),
        ("ln 0.37", DoubleDouble::constant(0.37).ln(), -0.9942522733438669, -3.652349485344856e-17),
        ("ln 1.0000001", DoubleDouble::constant(1.0000001).ln(), 9.999999505838704e-08, 1.5249709528441489e-24),
        ("ln 12.5", DoubleDouble::constant(12.5).ln(), 2.5257286443082556, -1.7065574170429193e-16),
        ("ln 1e+20", DoubleDouble::constant(1e+20).ln(), 46.051701859880914, -7.88798767963998e-16),
        ("sin 0.001", DoubleDouble::constant(0.001).sin(), 0.0009999998333333417, 5.670638989736153e-21),
        ("cos 0.001", DoubleDouble::constant(0.001).cos(), 0.9999995000000417, -7.831485455398128e-18),
        ("sin 0.9", DoubleDouble::constant(0.9).sin(), 0.7833269096274834, -1.1969598997849713e-17),
        ("cos 0.9", DoubleDouble::constant(0.9).cos(), 0.6216099682706644, 4.657128960836576e-17),
        ("sin 2.5", DoubleDouble::constant(2.5).sin(), 0.5984721441039565, -5.521403334082375e-17),
        ("cos 2.5", DoubleDouble::constant(2.5).cos(), -0.8011436155469337, -1.8674742705085553e-17),
        ("sin -7.75", DoubleDouble::constant(-7.75).sin(), -0.9945987791111761, -8.35257604489188e-18),
        ("cos -7.75", DoubleDouble::constant(-7.75).cos(), 0.10379435721925297, 4.265758670469736e-18),
        ("sin 88.125", DoubleDouble::constant(88.125).sin(), 0.15971871109322489, 7.939411991657978e-18),
        ("cos 88.125", DoubleDouble::constant(88.125).cos(), 0.9871625668180084, 2.825612251434378e-17),
        ("atan 1e-05", DoubleDouble::constant(1e-05).atan(), 9.999999999666668e-06, -4.575803486027043e-22),
        ("atan 0.4", DoubleDouble::constant(0.4).atan(), 0.3805063771123649, 3.540779945587601e-18),
        ("atan -1.5", DoubleDouble::constant(-1.5).atan(), -0.982793723247329, -1.3903311031230998e-17),
        ("atan 3000.0", DoubleDouble::constant(3000.0).atan(), 1.570462993473909, 2.267643401254332e-17),
        ("sqrt 0.3", DoubleDouble::constant(0.3).sqrt(), 0.5477225575051661, 2.890126723719787e-17),
        ("sqrt 2.0", DoubleDouble::constant(2.0).sqrt(), std::f64::consts::SQRT_2, -9.667293313452913e-17),
        ("sqrt 10000000000.0", DoubleDouble::constant(10000000000.0).sqrt(), 100000.0, 0.0),
        ("0.1 read", DoubleDouble::parse("0.1").unwrap(), 0.1, -5.551115123125783e-18),
        ("lanczos read", DoubleDouble::parse("2.513400000000E+00").unwrap(), 2.5134, 1.4352963262354023e-16),
        (
            "power",
            DoubleDouble::constant(3.7).pow(DoubleDouble::constant(-1.07)),
            0.24661765009599332,
            -1.3929835987193808e-18,
        ),
    ];
    for (name, got, hi, lo) in cases {
        // The logarithm is computed as a sum that contains 1, so near its zero only absolute digits are kept.
        let scale = if name.starts_with("ln") { f64::abs(hi).max(1.0) } else { f64::abs(hi) };
        let error = (got - DoubleDouble::sum(hi, lo)).value().abs() / scale;
        assert!(error < 1e-30, "{name}: relative error {error:e}");
    }
}

#[test]
fn identities_hold_to_thirty_digits() {
    for x in [1e-9, 0.03, 0.7, 1.9, 5.5, 88.0, 511.0] {
        let x = DoubleDouble::constant(x) / DoubleDouble::constant(3.0);
        let close = |a: DoubleDouble, b: DoubleDouble, what: &str| {
            let error = ((a - b) / b).value().abs();
            assert!(error < 2e-29, "{what} at {}: {error:e}", x.value());
        };
        close(x.ln().exp(), x, "exp ln");
        close(x.sqrt() * x.sqrt(), x, "sqrt²");
        close(x.sin().square() + x.cos().square(), DoubleDouble::one(), "sin² + cos²");
        close(x.exp() * (-x).exp(), DoubleDouble::one(), "exp(x) exp(−x)");
        let angle = x.atan();
        close(angle.sin() / angle.cos(), x, "tan atan");
    }
}

#[test]
fn decimals_are_read_beyond_double_precision() {
    let tenth = DoubleDouble::parse("-1.0E-01").unwrap();
    assert!((tenth * DoubleDouble::constant(10.0) + DoubleDouble::one()).value().abs() < 1e-31);
    assert_ne!(tenth.tail(), 0.0);
    for bad in ["", "nan", "inf", "1..2", "0x10", "1e", "1e400"] {
        assert!(DoubleDouble::parse(bad).is_none(), "{bad} was read");
    }
}

#[test]
fn infinities_and_nan_pass_through() {
    let inf = DoubleDouble::constant(f64::INFINITY);
    assert_eq!((inf + DoubleDouble::one()).value(), f64::INFINITY);
    assert_eq!((inf * DoubleDouble::constant(2.0)).value(), f64::INFINITY);
    assert_eq!((DoubleDouble::one() / inf).value(), 0.0);
    assert!(DoubleDouble::constant(-1.0).ln().value().is_nan());
    assert!(DoubleDouble::constant(-1.0).sqrt().value().is_nan());
    assert_eq!(DoubleDouble::constant(-2000.0).exp().value(), 0.0);
}
