//! The three forms are compared with independent derivations, the transport equation, and brute-force integration.

use super::*;
use crate::slab::{medium, quadrature::gauss};
use std::f64::consts::PI;

const FORMS: [DipoleForm; 3] = [DipoleForm::Dipoles(3), DipoleForm::Images, DipoleForm::Thin];

/// σa of the paper's tissue, and values from nearly none to far above σs.
const ABSORPTIONS: [f64; 6] = [0.4, 0.01, 1e-6, 0.0, 3.0, 40.0];

fn tissue(sigma_a: f64) -> Tissue {
    Tissue { sigma_a, ..Tissue::TABLE }
}

/// The image sum in space, continued until it no longer changes: T and the share beyond r. It is written independently
/// of `sum.rs`.
fn image_sum(t: &Tissue, r: f64, d: f64) -> [f64; 2] {
    let (l, k) = (t.mean_free_path(), (3.0 * t.sigma_a * t.reduced_extinction()).sqrt());
    let zb = 2.0 * t.a * l / 3.0;
    let mut sums = [0.0; 2];
    for j in (-20_000..=20_000i32).rev() {
        let shift = 2.0 * f64::from(j) * (d + 2.0 * zb);
        for (z, sign) in [(d - shift - l, 1.0), (d - shift + l + 2.0 * zb, -1.0)] {
            let rho = z.hypot(r);
            let e = sign * z * (-k * rho).exp() / rho;
            sums[0] += e * (1.0 + k * rho) / (rho * rho) / (4.0 * PI);
            sums[1] += 0.5 * e;
        }
    }
    sums.map(|s| s * t.reduced_scattering() / t.reduced_extinction())
}

#[test]
fn images_in_space_are_the_sum_run_to_convergence() {
    for sigma_a in [0.4, 3.0] {
        let t = tissue(sigma_a);
        for d in [0.12, 0.2, 0.5, 2.0, 5.0] {
            for r in [1e-5, 0.003, 0.05, 0.2, 0.6, 1.2] {
                let want = image_sum(&t, r, d);
                let got = [t.transmittance(r, d, DipoleForm::Images), t.beyond(r, d, DipoleForm::Images)];
                for k in 0..2 {
                    // Far out the sum itself cancels, because the layer's light decays faster than the terms of the
                    // sum.
                    let lost = 1e-15 * image_sum(&t, 1e-5, d)[k];
                    assert!(
                        (got[k] - want[k]).abs() < 1e-10 * want[k].abs() + lost,
                        "σa {sigma_a} d {d} r {r}: {got:?} {want:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn thin_in_space_is_the_image_sum_of_every_depth() {
    let t = tissue(0.4);
    let (sigma, s) = (t.reduced_extinction(), t.reduced_scattering());
    let k = (3.0 * t.sigma_a * sigma).sqrt();
    let zb = 2.0 * t.a / (3.0 * sigma);
    for d in [0.03, 0.15, 0.6] {
        for r in [0.02, 0.1, 0.3, 0.8] {
            // φ(d)/(2A) of sources σs′ e^(−σz), each with its images over the two extrapolated boundaries
            let want: f64 = gauss(60)
                .iter()
                .map(|q| {
                    let z = q.x * d;
                    let green: f64 = (-60..=60)
                        .rev()
                        .map(|j| {
                            let shift = 2.0 * f64::from(j) * (d + 2.0 * zb);
                            let (real, image) = ((d - shift - z).hypot(r), (d - shift + z + 2.0 * zb).hypot(r));
                            (-k * real).exp() / real - (-k * image).exp() / image
                        })
                        .sum();
                    q.w * d * s * (-sigma * z).exp() * green * 3.0 * sigma / (4.0 * PI) / (2.0 * t.a)
                })
                .sum();
            let got = t.transmittance(r, d, DipoleForm::Thin);
            assert!(
                (got / want - 1.0).abs() < 1e-9 + 1e-7 * (r / d).min(1.0) * f64::from(r > 5.0 * d),
                "d {d} r {r}: {got} {want}"
            );
        }
    }
}

#[test]
fn contour_and_modes_agree_where_they_meet() {
    for sigma_a in ABSORPTIONS {
        let t = tissue(sigma_a);
        let c = t.coefficients();
        for d in [0.02, 0.15, 0.5] {
            let height = d + 2.0 * c.extrapolation;
            for (form, layer) in
                [(DipoleForm::Thin, layer::DipoleLayer::Thin), (DipoleForm::Images, layer::DipoleLayer::Images)]
            {
                if !t.defined(d, form) {
                    continue;
                }
                for r in [0.5 * height, 2.9 * height] {
                    let (near, far) = (in_space(&c, r, d, form), layer::modes(&c, layer, r, d));
                    // Modes cancel by e^(σtr (√(r²+d²) − r)).
                    let digits = 1e-12 * (c.transport2.sqrt() * (r.hypot(d) - r)).exp();
                    for k in 0..2 {
                        assert!(
                            (near[k] - far[k]).abs() < digits * far[k].abs(),
                            "{form:?} σa {sigma_a} d {d} r {r}: {near:?} {far:?}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn space_and_spectrum_are_one_another_s_transform() {
    // ∫ T J₀(kr) 2πr dr, by −d(beyond)/dr = 2πrT: T̂(k) = total − k ∫ beyond J₁(kr) dr. J₁ by its integral.
    let j1 = |x: f64| gauss(40).iter().map(|q| q.w * (PI * q.x - x * (PI * q.x).sin()).cos()).sum::<f64>();
    for form in FORMS {
        for d in [0.15, 0.4] {
            let t = tissue(0.4);
            for k in [0.5, 3.0, 9.0] {
                let integral: f64 = (0..12)
                    .flat_map(|panel| {
                        gauss(16).into_iter().map(move |q| (f64::from(panel) * 0.25 + 0.25 * q.x, 0.25 * q.w))
                    })
                    .map(|(r, w)| w * t.beyond(r, d, form) * j1(k * r))
                    .sum();
                let want = t.spectrum(k, d, form);
                let got = t.total(d, form) - k * integral;
                // In the thin form, `beyond` is like r² ln r at r = 0, where Gauss's rule is good to 1e-6.
                assert!((got - want).abs() < 2e-6 * t.total(d, form), "{form:?} d {d} k {k}: {got} {want}");
            }
            // T is the slope of `beyond`.
            for r in [0.03, 0.4] {
                let e = 1e-4 * r;
                let slope = (t.beyond(r - e, d, form) - t.beyond(r + e, d, form)) / (2.0 * e);
                assert!((slope / (2.0 * PI * r) / t.transmittance(r, d, form) - 1.0).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn images_are_the_limit_of_dipoles() {
    for sigma_a in [0.4, 3.0, 40.0] {
        for d in [0.15, 0.5] {
            for k in [0.0, 1.0, 20.0] {
                let t = tissue(sigma_a);
                let (want, got) = (t.spectrum(k, d, DipoleForm::Dipoles(4000)), t.spectrum(k, d, DipoleForm::Images));
                assert!((got / want - 1.0).abs() < 1e-12, "σa {sigma_a} d {d} k {k}: {got} {want}");
            }
        }
    }
}

#[test]
fn three_dipoles_leave_out_what_is_known() {
    // Relative error of the total of n = 3 against n = ∞ of the same sum.
    let error = |sigma_a: f64, d: f64| {
        tissue(sigma_a).total(d, DipoleForm::Dipoles(3)) / tissue(sigma_a).total(d, DipoleForm::Dipoles(200_000)) - 1.0
    };
    for (sigma_a, d, want, within) in
        [(0.4, 0.1, 0.009, 0.0005), (0.4, 0.5, 8e-7, 0.5e-7), (0.01, 0.2, 0.28, 0.005), (0.001, 0.2, 0.67, 0.005)]
    {
        let got = error(sigma_a, d).abs();
        assert!((got - want).abs() < within, "σa {sigma_a} d {d}: {got}");
    }
}

#[test]
fn totals_against_the_transport_equation() {
    // Worst |total/ρt − 1|, isotropic scattering with σs′, A = 1.
    let worst = |form: DipoleForm, sigma_a: f64, depths: &[f64]| {
        let t = tissue(sigma_a);
        depths
            .iter()
            .map(|&d| (t.total(d, form) / medium::response(sigma_a, t.reduced_scattering(), d).rho_t - 1.0).abs())
            .fold(0.0, f64::max)
    };
    let blades = [0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 1.0];
    for sigma_a in [0.4, 0.01, 1e-6, 0.0] {
        assert!(
            worst(DipoleForm::Thin, sigma_a, &blades) < 0.017,
            "σa {sigma_a}: {}",
            worst(DipoleForm::Thin, sigma_a, &blades)
        );
        assert!(worst(DipoleForm::Images, sigma_a, &[0.15, 0.2, 0.3, 0.5, 0.7, 1.0]) < 0.09, "σa {sigma_a}");
    }
    // For σa ≫ σs only the unscattered light is left, and only the thin form has it.
    assert!(worst(DipoleForm::Thin, 10.0, &[0.02, 0.05, 0.1, 0.15]) < 0.03);
    assert!(worst(DipoleForm::Thin, 40.0, &[0.02, 0.05, 0.1]) < 0.05);
    assert!(worst(DipoleForm::Images, 10.0, &[0.1]) > 0.5);
    // The paper's form becomes negative below one mean free path; the thin form stays positive.
    assert!(tissue(0.01).total(0.05, DipoleForm::Dipoles(3)) < 0.0 && tissue(0.01).total(0.05, DipoleForm::Thin) > 0.5);
}

#[test]
fn limits_are_smooth() {
    for form in [DipoleForm::Images, DipoleForm::Thin] {
        for k in [0.0, 0.3, 1.0, 30.0] {
            for d in [0.11, 0.5, 3.0] {
                // σa → 0 is an ordinary point.
                let [zero, tiny] = [0.0, 1e-14].map(|s| tissue(s).spectrum(k, d, form));
                assert!(zero > 0.0 && (tiny / zero - 1.0).abs() < 1e-9, "{form:?} k {k} d {d}: {zero} {tiny}");
            }
            // The series near KH = 1/2 agrees with the closed form, and so do the two sides of K = σt′.
            let t = tissue(0.0);
            for k in [0.5 / (0.3 + 4.0 / (3.0 * t.reduced_extinction())), t.reduced_extinction()] {
                let [a, b, c] = [-1e-6, 0.0, 1e-6].map(|e| t.spectrum(k * (1.0 + e), 0.3, form));
                assert!((a + c - 2.0 * b).abs() < 1e-11 * b, "{form:?}");
            }
        }
    }
    // Thin blades pass everything, whatever they are made of.
    for sigma_a in ABSORPTIONS {
        assert!((tissue(sigma_a).total(1e-9, DipoleForm::Thin) - 1.0).abs() < 1e-6);
        assert_eq!(tissue(sigma_a).total(0.0, DipoleForm::Thin), 1.0);
    }
    let air = Tissue { sigma_a: 0.0, sigma_s: 0.0, g: 0.0, a: 1.0 };
    assert_eq!((air.total(0.3, DipoleForm::Thin), air.transmittance(0.1, 0.3, DipoleForm::Thin)), (1.0, 0.0));
}

#[test]
fn nothing_is_nan_however_deep_or_far() {
    for sigma_a in ABSORPTIONS {
        for g in [-0.9, 0.07, 0.9] {
            let t = Tissue { sigma_a, g, ..Tissue::TABLE };
            for form in FORMS {
                for d in [1.01 * t.mean_free_path(), 1.0, 30.0, 1e4] {
                    for r in [1e-6, 0.1, 10.0, 1e4] {
                        let (value, beyond) = (t.transmittance(r, d, form), t.beyond(r, d, form));
                        assert!(
                            value.is_finite() && beyond.is_finite(),
                            "{form:?} σa {sigma_a} g {g} d {d} r {r}: {value} {beyond}"
                        );
                        if form != DipoleForm::Dipoles(3) {
                            assert!(
                                value >= 0.0 && beyond >= 0.0,
                                "{form:?} σa {sigma_a} g {g} d {d} r {r}: {value} {beyond}"
                            );
                        }
                    }
                    assert!(t.total(d, form).is_finite() && t.spectrum(1e3, d, form).is_finite());
                }
            }
        }
    }
    assert_eq!(tissue(40.0).transmittance(0.1, 1e4, DipoleForm::Thin), 0.0);
    assert!(tissue(0.4).transmittance(0.1, 0.05, DipoleForm::Images).is_nan());
}

#[test]
fn derivatives_agree_with_differences() {
    let t = Tissue { a: 1.4, ..tissue(0.3) };
    let d = 0.23;
    for form in FORMS {
        for r in [0.02, 0.3, 3.0] {
            let dual = in_space(&t.dual_coefficients(), r, TissueDual { value: d, by: [0.0, 0.0, 0.0, d] }, form);
            let at = |k: usize, e: f64| {
                let mut moved = t;
                let mut depth = d;
                match k {
                    0 => moved.sigma_a += e,
                    1 => moved.sigma_s += e,
                    2 => moved.g += e,
                    _ => depth *= 1.0 + e,
                }
                in_space(&moved.coefficients(), r, depth, form)
            };
            for k in 0..4 {
                for which in 0..2 {
                    let e = 1e-4;
                    let want = (at(k, e)[which] - at(k, -e)[which]) / (2.0 * e);
                    let got = dual[which].by[k];
                    assert!(
                        (got - want).abs() < 1e-5 * want.abs() + 1e-7 * dual[which].value,
                        "{form:?} r {r} {k} {which}: {got} {want}"
                    );
                }
            }
        }
    }
}
