//! The slab is compared with independent computations: the other derivation, closed forms, Monte Carlo, finite
//! differences.

use super::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::PI;

fn log_uniform(rng: &mut Pcg64Mcg, low: f64, high: f64) -> f64 {
    (low.ln() + (high / low).ln() * rng.random::<f64>()).exp()
}

/// ω and 1−ω: half of the draws lie near ω = 1, half near 0.
fn albedo(rng: &mut Pcg64Mcg) -> (f64, f64) {
    let small = log_uniform(rng, 1e-9, 1.0);
    if rng.random::<f64>() < 0.5 { (small, 1.0 - small) } else { (1.0 - small, small) }
}

#[test]
fn integral_equation_and_ordinates_agree_where_both_are_good() {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    for _ in 0..200 {
        let (omega, absorbed) = albedo(&mut rng);
        let delta = log_uniform(&mut rng, 0.03, 0.12);
        let mu0 = if rng.random::<f64>() < 0.5 { 1.0 } else { 0.5 + 0.5 * rng.random::<f64>() };
        let a = thin_slab::solve(omega, delta, mu0);
        let (rho_d, log_t) = ordinates::modes(omega, absorbed).response(delta, mu0);
        assert!((rho_d / a.rho_d - 1.0).abs() < 3e-10, "ω {omega} Δ {delta} μ₀ {mu0}: ρd {} {rho_d}", a.rho_d);
        assert!((log_t - a.rho_t.ln()).abs() < 3e-10, "ω {omega} Δ {delta} μ₀ {mu0}: ρt {} {}", a.rho_t, log_t.exp());
    }
}

/// Chandrasekhar's H function of isotropic scattering, ln H(μ) = −(μ/π) ∫₀^{π/2} ln(1 − ω θ cot θ) / (cos²θ + μ² sin²θ)
/// dθ (Stibbs & Weir 1959).
fn chandrasekhar_h(omega: f64, mu: f64) -> f64 {
    let rule = quadrature::gauss(200);
    let sum: f64 = rule
        .iter()
        .map(|q| {
            // θ = (π/2)(1 − (1−x)²)… flattens the logarithm at θ = 0 for ω = 1
            let (theta, jacobian) = (0.5 * PI * q.x * q.x * q.x, 0.5 * PI * 3.0 * q.x * q.x);
            let (s, c) = theta.sin_cos();
            // 1 − θ cot θ by its series where it cancels
            let t = theta * theta;
            let dip = if theta < 0.1 {
                t * (1.0 / 3.0 + t * (1.0 / 45.0 + t * (2.0 / 945.0 + t / 4725.0)))
            } else {
                1.0 - theta * c / s
            };
            q.w * jacobian * (1.0 - omega + omega * dip).ln() / (c * c + mu * mu * s * s)
        })
        .sum();
    (-mu / PI * sum).exp()
}

#[test]
fn half_space_agrees_with_chandrasekhar() {
    // The plane albedo of the half space is 1 − √(1−ω) H(μ₀).
    for omega in [1e-3_f64, 0.1, 0.5, 0.9, 0.99, 0.9999] {
        for mu0 in [1.0, 0.6, 0.1] {
            let want = 1.0 - (1.0 - omega).sqrt() * chandrasekhar_h(omega, mu0);
            let got = medium::solve_at(mu0, omega, 1.0 - omega, 3000.0).rho_d;
            assert!((got / want - 1.0).abs() < 1e-9, "ω {omega} μ₀ {mu0}: {got} {want}");
        }
    }
}

#[test]
fn conservative_slab_tends_to_the_milne_problem() {
    // ω = 1, thick: ρt → H(1) / (√3 (Δ + 2 · 0.710446089598763)), Hopf's extrapolated distance.
    let hopf = 0.710_446_089_598_763;
    for delta in [50.0, 300.0, 1000.0] {
        let r = medium::solve(1.0, 0.0, delta);
        let want = chandrasekhar_h(1.0, 1.0) / (3.0_f64.sqrt() * (delta + 2.0 * hopf));
        assert!((r.rho_t / want - 1.0).abs() < 1e-9, "Δ {delta}: {} {want}", r.rho_t);
        assert!(r.rho_d + r.rho_t == 1.0);
    }
}

#[test]
fn monte_carlo_agrees() {
    // Analog photons, which share nothing with the deterministic methods.
    let mut rng = Pcg64Mcg::seed_from_u64(7);
    for (omega, delta) in [(0.9, 1.0), (0.5, 0.3), (1.0, 4.0)] {
        let photons = 60_000;
        let (mut up, mut down) = (0.0_f64, 0.0_f64);
        for _ in 0..photons {
            let (mut tau, mut mu, mut weight) = (0.0_f64, 1.0_f64, 1.0_f64);
            loop {
                tau -= mu * (1.0 - rng.random::<f64>()).ln();
                if tau < 0.0 {
                    up += weight;
                    break;
                }
                if tau > delta {
                    down += weight;
                    break;
                }
                weight *= omega;
                mu = 2.0 * rng.random::<f64>() - 1.0;
            }
        }
        let n = f64::from(photons);
        let r = medium::solve(omega, 1.0 - omega, delta);
        for (got, want) in [(up / n, r.rho_d), (down / n, r.rho_t)] {
            // weights are at most 1, so the standard error is below √(p(1−p)/n)
            let sd = (want * (1.0 - want) / n).sqrt();
            assert!((got - want).abs() < 4.0 * sd, "ω {omega} Δ {delta}: {got} {want} ± {sd}");
        }
    }
}

#[test]
fn exact_limits() {
    for delta in [0.0, 1e-6, 1.0, 60.0, 700.0, 1e4] {
        let r = medium::solve(0.0, 1.0, delta);
        assert_eq!((r.rho_d, r.rho_t), (0.0, (-delta).exp()));
        let r = medium::solve(1.0, 0.0, delta);
        assert!((r.rho_d + r.rho_t - 1.0).abs() <= f64::EPSILON, "{r:?}");
    }
    // A weak scatterer: e^(−Δ) (1 + first order), and the first order of ρd is (ω/2) ∫ E₂ e^(−τ).
    let r = medium::solve(1e-12, 1.0 - 1e-12, 60.0);
    assert!((r.rho_t / (-60.0_f64).exp() - 1.0).abs() < 1e-9);
    assert!((r.rho_d / (0.5e-12 * (1.0 - 2.0_f64.ln())) - 1.0).abs() < 1e-9, "{}", r.rho_d);
    for bad in [
        medium::solve(1.2, -0.2, 1.0),
        medium::solve(f64::NAN, 0.0, 1.0),
        medium::solve(0.5, 0.5, -1.0),
        medium::solve_at(0.0, 0.5, 0.5, 1.0),
    ] {
        assert!(bad.rho_d.is_nan() && bad.rho_t.is_nan());
    }
}

#[test]
fn deep_transmission_follows_the_diffusion_length() {
    // ρt(Δ+10)/ρt(Δ) → e^(−10 k), 1 = (ω/2k) ln((1+k)/(1−k)); ω = 0.9 from ρt = 1e-22 to 1e-26.
    let (omega, mut k) = (0.9, 0.5_f64);
    for _ in 0..200 {
        k = (k / omega).tanh();
    }
    let (a, b) = (medium::solve(omega, 0.1, 100.0).rho_t, medium::solve(omega, 0.1, 110.0).rho_t);
    assert!(((b / a).ln() + 10.0 * k).abs() < 1e-9, "{a} {b}");
}

#[test]
fn fast_agrees_with_exact_everywhere() {
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    for _ in 0..2500 {
        let (omega, absorbed) = albedo(&mut rng);
        let delta = log_uniform(&mut rng, 1e-8, 5e3);
        let (fast, want) = (reduced(omega, absorbed, delta).0, medium::solve(omega, absorbed, delta));
        assert!(
            (fast.rho_d / want.rho_d - 1.0).abs() < 2e-8,
            "ω {omega} 1−ω {absorbed} Δ {delta}: ρd {} {}",
            fast.rho_d,
            want.rho_d
        );
        if want.rho_t > 1e-30 {
            assert!(
                (fast.rho_t / want.rho_t - 1.0).abs() < 2e-8,
                "ω {omega} 1−ω {absorbed} Δ {delta}: ρt {} {}",
                fast.rho_t,
                want.rho_t
            );
        } else {
            assert!(fast.rho_t < 1e-29);
        }
    }
}

#[test]
fn partials_agree_with_differences_of_the_exact_solution() {
    let mut rng = Pcg64Mcg::seed_from_u64(4);
    for _ in 0..150 {
        let (omega, absorbed) = albedo(&mut rng);
        let delta = log_uniform(&mut rng, 1e-5, 50.0);
        let h = 0.3;
        let (a, s) = (absorbed * delta / h, omega * delta / h);
        let (r, p) = response_with_partials(a, s, h);
        let relative = |x: f64, f: &dyn Fn(f64) -> SlabResponse, got: SlabResponse| {
            let e = 1e-4 / delta.max(1.0);
            let (lo, hi) = (f(x * (1.0 - e)), f(x * (1.0 + e)));
            // The error is taken as a change for each relative change of the parameter, relative to the size of the
            // response.
            for (got, lo, hi, size) in
                [(got.rho_d, lo.rho_d, hi.rho_d, r.rho_d), (got.rho_t, lo.rho_t, hi.rho_t, r.rho_t)]
            {
                let want = (hi - lo) / (2.0 * e);
                let size = if size < 1e-30 { continue } else { size };
                assert!(
                    (got * x - want).abs() < 1e-6 * size.max(want.abs()),
                    "ω {omega} Δ {delta}: {} {want} of {size}",
                    got * x
                );
            }
        };
        relative(a, &|x| medium::response(x, s, h), p.sigma_a);
        relative(s, &|x| medium::response(a, x, h), p.sigma_s);
        relative(h, &|x| medium::response(a, s, x), p.thickness);
    }
}

/// `cargo test --release slab_table_is_made_again -- --ignored` rewrites the committed table (seconds).
#[test]
#[ignore = "rewrites data/slab/response.bin"]
fn slab_table_is_made_again() {
    let bytes = table::construction::bytes(|line| println!("{line}"));
    std::fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../data/slab/response.bin"), bytes).unwrap();
}

#[test]
fn the_papers_method_agrees() {
    for delta in [0.02, 0.3, 1.0, 5.0, 40.0] {
        for (omega, absorbed) in [(0.05, 0.95), (0.5, 0.5), (0.9, 0.1), (0.999, 0.001), (1.0, 0.0)] {
            let (got, want) = (fn_method::solve(omega, absorbed, delta, 1e-7), medium::solve(omega, absorbed, delta));
            assert!((got.response.rho_d / want.rho_d - 1.0).abs() < 1e-5, "Δ {delta} ω {omega}: {got:?} {want:?}");
            assert!((got.response.rho_t / want.rho_t - 1.0).abs() < 1e-5, "Δ {delta} ω {omega}: {got:?} {want:?}");
        }
    }
}
