//! The exponential integrals E₁ and E₂ of real positive argument (Abramowitz & Stegun 5.1.11, 5.1.14, 5.1.22).

const EULER_GAMMA: f64 = 0.577_215_664_901_532_9;

/// E₁(z) = ∫₁^∞ e^(−zt)/t dt for z > 0; relative accuracy about 1e-15.
pub fn e1(z: f64) -> f64 {
    if z <= 1.0 {
        let (mut sum, mut term) = (0.0, -1.0);
        for k in 1..30 {
            let k = f64::from(k);
            term *= -z / k;
            sum += term / k;
            if term.abs() < 1e-18 {
                break;
            }
        }
        sum - EULER_GAMMA - z.ln()
    } else {
        (-z).exp() * e1_scaled(z)
    }
}

/// E₂(z) = e^(−z) − z E₁(z) for z ≥ 0.
pub fn e2(z: f64) -> f64 {
    if z == 0.0 {
        1.0
    } else if z <= 1.0 {
        (-z).exp() - z * e1(z)
    } else {
        // 1/(z+2− 1·2/(z+4− 2·3/(z+6− …))): no cancellation.
        (-z).exp() * fraction(z, 2)
    }
}

fn e1_scaled(z: f64) -> f64 {
    fraction(z, 1)
}

/// e^z E_n(z) for z ≥ 1 by the modified Lentz algorithm.
fn fraction(z: f64, n: u32) -> f64 {
    let n = f64::from(n);
    let mut b = z + n;
    let mut c = 1e300;
    let mut d = 1.0 / b;
    let mut h = d;
    for i in 1..400 {
        let i = f64::from(i);
        let a = -i * (n - 1.0 + i);
        b += 2.0;
        d = 1.0 / (a * d + b);
        c = b + a / c;
        let del = c * d;
        h *= del;
        if (del - 1.0).abs() < 1e-16 {
            break;
        }
    }
    h
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_tables() {
        // Abramowitz & Stegun, tables 5.1 and 5.4.
        for (z, want) in
            [(0.5, 0.559_773_594_776_160_2), (1.0, 0.219_383_934_395_520_3), (2.0, 0.048_900_510_708_061_12)]
        {
            assert!((e1(z) / want - 1.0).abs() < 1e-14, "E1({z}) = {}", e1(z));
        }
        assert!((e2(1.0) - 0.148_495_506_775_922).abs() < 1e-14);
        assert!((e2(1.0 + 1e-13) - e2(1.0)).abs() < 1e-12);
    }
}
