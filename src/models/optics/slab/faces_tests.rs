//! The slab with reflecting faces is compared with adding-doubling, published numbers, Monte Carlo and closed forms.

use super::*;
use crate::slab::medium;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

fn near(got: f64, want: f64, room: f64, what: &str) {
    assert!((got - want).abs() <= room, "{what}: {got}, expected {want}");
}

/// Total reflectance and transmittance by adding-doubling (iadpython 0.5.3, Prahl et al. 1993, 32 quadrature points,
/// whose own error is below 2e-5): index, albedo, optical thickness, UR1, UT1.
const ADDING_DOUBLING: [[f64; 5]; 6] = [
    [1.5, 0.9, 1.0, 0.222004, 0.505964],
    [1.41, 0.5, 0.3, 0.068954, 0.723654],
    [1.33, 0.2, 2.0, 0.036960, 0.138684],
    [2.0, 0.95, 0.1, 0.216755, 0.755259],
    [1.41, 0.99, 5.0, 0.573524, 0.253627],
    [1.5, 0.9, 1000.0, 0.259940, 0.0],
];

#[test]
fn adding_doubling_agrees() {
    for [index, omega, delta, r, t] in ADDING_DOUBLING {
        let got = SlabFaces::new(index, 1.0).shares(omega, 1.0 - omega, delta).response();
        near(got.rho_d, r, 3e-5, "R");
        near(got.rho_t, t, 3e-5, "T");
    }
}

/// The half space of index 1.5 and albedo 0.9 reflects 0.2600 (Giovanelli 1955, as quoted for MCML by Wang et al.
/// 1995).
#[test]
fn giovanellis_half_space() {
    near(SlabFaces::new(1.5, 1.0).shares(0.9, 0.1, 2000.0).response().rho_d, 0.2600, 1e-4, "R");
}

#[test]
fn monte_carlo_agrees() {
    // Analog photons, which share nothing with the ordinates. Weights are at most 1, so the standard error is below
    // √(p(1−p)/n).
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    for (index, omega, delta, mu0) in
        [(1.41_f64, 0.9, 1.0, 1.0_f64), (1.5, 1.0, 4.0, 1.0), (1.2, 0.6, 0.3, 0.5), (2.0, 0.97, 0.05, 1.0)]
    {
        let photons = 60_000;
        let inside = (1.0 - (1.0 - mu0 * mu0) / (index * index)).sqrt();
        // Snell's law from inside; `None` beyond the critical angle
        let escapes = |mu: f64| {
            let sine2 = index * index * (1.0 - mu * mu);
            let out = (1.0 - sine2).max(0.0).sqrt();
            let s = ((out - index * mu) / (out + index * mu)).powi(2);
            let p = ((mu - index * out) / (mu + index * out)).powi(2);
            if sine2 >= 1.0 { 0.0 } else { 1.0 - 0.5 * (s + p) }
        };
        let (mut up, mut down) = (0.0_f64, 0.0_f64);
        for _ in 0..photons {
            if rng.random::<f64>() > escapes(inside) {
                up += 1.0;
                continue;
            }
            let (mut tau, mut mu, mut weight) = (0.0_f64, inside, 1.0_f64);
            let mut left = -(1.0 - rng.random::<f64>()).ln();
            loop {
                let to_face = if mu > 0.0 { (delta - tau) / mu } else { tau / -mu };
                if left < to_face {
                    tau += mu * left;
                    weight *= omega;
                    mu = 2.0 * rng.random::<f64>() - 1.0;
                    left = -(1.0 - rng.random::<f64>()).ln();
                    // Roulette: what is left of a weak photon survives with its share.
                    if weight < 1e-3 {
                        weight = if rng.random::<f64>() < weight { 1.0 } else { 0.0 };
                    }
                    if weight == 0.0 {
                        break;
                    }
                    continue;
                }
                left -= to_face;
                tau = if mu > 0.0 { delta } else { 0.0 };
                if rng.random::<f64>() < escapes(mu.abs()) {
                    if mu > 0.0 {
                        down += weight
                    } else {
                        up += weight
                    }
                    break;
                }
                mu = -mu;
            }
        }
        let n = f64::from(photons);
        let want = SlabFaces::new(index, mu0).shares(omega, 1.0 - omega, delta).response();
        for (got, want) in [(up / n, want.rho_d), (down / n, want.rho_t)] {
            let room = 4.0 * (want * (1.0 - want) / n).sqrt();
            near(got, want, room, &format!("n {index} ω {omega} Δ {delta} μ₀ {mu0}"));
        }
    }
}

#[test]
fn no_light_is_lost_or_made() {
    for index in [1.001, 1.2, 1.5, 2.0, 3.0] {
        for mu0 in [1.0, 0.3] {
            let faces = SlabFaces::new(index, mu0);
            for delta in [1e-8, 1e-3, 0.3, 4.0, 60.0, 1e3] {
                for absorbed in [0.0, 1e-12, 1e-4, 0.3, 0.9, 1.0 - 1e-9, 1.0] {
                    let s = faces.shares(1.0 - absorbed, absorbed, delta);
                    let sum = s.mirrored + s.scattered_back + s.passed + s.scattered_on + s.lost;
                    near(sum, 1.0, 1e-12, &format!("n {index} Δ {delta} 1−ω {absorbed}"));
                    assert!(s.lost >= 0.0 && s.scattered_back >= 0.0 && s.scattered_on >= 0.0, "{s:?}");
                    assert!(absorbed > 0.0 || s.lost == 0.0, "{s:?}");
                }
                // What is absorbed keeps its digits: it is proportional to 1 − ω where that is small.
                let [a, b] = [1e-13, 1e-12].map(|a| faces.shares(1.0 - a, a, delta).lost / a);
                assert!((a / b - 1.0).abs() < 1e-4, "n {index} Δ {delta}: {a} {b}");
            }
        }
    }
}

#[test]
fn an_index_that_tends_to_1_tends_to_the_slab_without_faces() {
    for (omega, delta) in [(0.9, 1.0), (0.3, 0.01), (0.999, 30.0), (1.0, 5.0)] {
        let (got, want) = (
            SlabFaces::new(1.0 + 1e-9, 1.0).shares(omega, 1.0 - omega, delta),
            medium::solve(omega, 1.0 - omega, delta),
        );
        near(got.response().rho_d / want.rho_d, 1.0, 3e-6, "R");
        near(got.response().rho_t / want.rho_t, 1.0, 3e-6, "T");
    }
}

/// A very thin slab keeps what it scatters beyond the critical angle: with q = √(1−1/n²) of the scattered light
/// trapped, and scattered again with ω, it leaves in the ratio ω(1−q)/(1−ωq).
#[test]
fn a_thin_slab_traps_light() {
    for (index, omega) in [(1.41_f64, 0.9), (2.0, 0.5)] {
        let delta = 1e-7;
        let s = SlabFaces::new(index, 1.0).shares(omega, 1.0 - omega, delta);
        let kept = (1.0 - 1.0 / (index * index)).sqrt();
        let left = s.scattered_back + s.scattered_on;
        let met = left + s.lost;
        near(left / met, omega * (1.0 - kept) / (1.0 - omega * kept), 1e-5, "share that leaves");
        // A beam that goes back and forth crosses (1−r) Σ rᵏ = 1 times.
        near(met / delta, 1.0, 1e-5, "share that meets something");
    }
}
