//! Compares the walk with independent solutions: the exact slab, closed forms, doubling, composition of diffuse faces,
//! published values.

use super::rough::RoughSurface;
use super::slab::{ANGLES, EntryDirection};
use super::*;
use crate::slab::{medium, quadrature::gauss};
use nalgebra::DMatrix;

fn histories(count: u64) -> Histories {
    Histories { count, seed: 5 }
}

fn matched(sigma_a: f64, sigma_s: f64, g: f64, thickness_mm: f64) -> Slab {
    Slab { medium: Medium { sigma_a, sigma_s, g }, thickness_mm, boundary: Boundary::Matched }
}

/// Within `sigmas` standard errors, which are themselves small.
fn agrees(what: &str, got: HistoryEstimate, want: f64, sigmas: f64, largest_error: f64) {
    assert!(got.error <= largest_error, "{what}: standard error {} > {largest_error}", got.error);
    assert!(
        (got.value - want).abs() <= sigmas * got.error + 1e-12,
        "{what}: {} ± {}, expected {want}",
        got.value,
        got.error
    );
}

#[test]
fn isotropic_matched_slab_agrees_with_the_exact_solution() {
    for (omega, delta, mu0) in [
        (1.0, 0.02, 1.0),
        (1.0, 3.0, 1.0),
        (0.96, 1.0, 1.0),
        (0.96, 6.0, 1.0),
        (0.5, 0.3, 0.4),
        (0.9, 2.0, 0.1),
        (0.99, 20.0, 0.8),
    ] {
        let d = 0.2;
        let (ss, sa) = (omega * delta / d, (1.0 - omega) * delta / d);
        let want = medium::response_at(mu0, sa, ss, d);
        let sin = (1.0f64 - mu0 * mu0).sqrt();
        let got = matched(sa, ss, 0.0, d).walk(EntryDirection::Beam([0.0, sin, mu0]), histories(60_000), &[]).unwrap();
        let what = format!("ω {omega} Δ {delta} μ₀ {mu0}");
        agrees(&format!("{what} R"), got.reflected, want.rho_d, 4.0, 2.5e-3);
        agrees(&format!("{what} T"), got.transmitted, want.rho_t, 4.0, 2.5e-3);
        agrees(&format!("{what} unscattered"), got.unscattered, (-delta / mu0).exp(), 4.0, 1e-6);
        agrees(&format!("{what} balance"), got.balance, 1.0, 4.0, 2e-3);
    }
}

#[test]
fn absorber_empty_slab_and_no_slab() {
    let got = matched(3.0, 0.0, 0.0, 0.5).walk(EntryDirection::NORMAL, histories(1000), &[]).unwrap();
    assert!((got.transmitted.value - (-1.5f64).exp()).abs() < 1e-12 && got.reflected.value == 0.0);
    assert!((got.absorbed.value - (1.0 - (-1.5f64).exp())).abs() < 1e-12);
    // Lambertian light through an absorber: 2 E₃(Δ)
    let got = matched(3.0, 0.0, 0.0, 0.5).walk(EntryDirection::Diffuse, histories(20_000), &[]).unwrap();
    let want: f64 = gauss(60).iter().map(|q| 2.0 * q.x * q.w * (-1.5 / q.x).exp()).sum();
    agrees("2 E₃", got.transmitted, want, 4.0, 2e-3);
    for boundary in [
        Boundary::Matched,
        Boundary::Diffuse { reflectance: 0.3 },
        Boundary::Rough(RoughSurface { index: 1.0, slope: 0.3 }),
    ] {
        for (sigma_a, sigma_s, d) in [(0.0, 0.0, 1.0), (2.0, 5.0, 0.0), (0.0, 0.0, 0.0)] {
            let slab = Slab { medium: Medium { sigma_a, sigma_s, g: 0.0 }, thickness_mm: d, boundary };
            let got = slab.walk(EntryDirection::NORMAL, histories(4000), &[]).unwrap();
            // bounces between two diffuse faces with nothing between: T = (1 − ρ)/(1 − ρ²) = 1/(1 + ρ)
            let rho = if let Boundary::Diffuse { reflectance } = boundary { reflectance } else { 0.0 };
            agrees(&format!("{boundary:?} d {d}"), got.transmitted, 1.0 / (1.0 + rho), 4.0, 0.01);
            agrees("balance", got.balance, 1.0, 0.0, 1e-9);
        }
    }
}

/// Reflectance and transmittance of a slab with Henyey–Greenstein scattering by doubling (van de Hulst 1980), normal
/// beam.
fn doubling(omega: f64, g: f64, delta: f64) -> (f64, f64) {
    const N: usize = 24;
    // double Gauss; the beam as one more ordinate of vanishing weight
    let mut nodes: Vec<(f64, f64)> = gauss(N).iter().map(|q| (q.x, q.w)).collect();
    nodes.push((1.0, 1e-9));
    let legendre = |x: f64| {
        let mut p = vec![1.0, x];
        for l in 2..2 * N {
            p.push(((2 * l - 1) as f64 * x * p[l - 1] - (l - 1) as f64 * p[l - 2]) / l as f64);
        }
        p
    };
    let p: Vec<Vec<f64>> = nodes.iter().map(|n| legendre(n.0)).collect();
    let phase = |i: usize, j: usize, sign: f64| -> f64 {
        (0..2 * N)
            .map(|l| (2 * l + 1) as f64 * g.powi(l as i32) * p[i][l] * p[j][l] * if l % 2 == 1 { sign } else { 1.0 })
            .sum()
    };
    let doublings = 22;
    let thin = delta / f64::from(1u32 << doublings);
    let n = N + 1;
    let mut r = DMatrix::from_fn(n, n, |i, j| 0.5 * omega * thin / nodes[i].0 * phase(i, j, -1.0) * nodes[j].1);
    let mut t = DMatrix::from_fn(n, n, |i, j| {
        0.5 * omega * thin / nodes[i].0 * phase(i, j, 1.0) * nodes[j].1
            + if i == j { 1.0 - thin / nodes[i].0 } else { 0.0 }
    });
    for _ in 0..doublings {
        let between = (DMatrix::identity(n, n) - &r * &r).try_inverse().unwrap();
        let through = &t * between;
        r = &r + &through * &r * &t;
        t = &through * &t;
    }
    let flux = |m: &DMatrix<f64>| (0..n).map(|i| nodes[i].0 * nodes[i].1 * m[(i, n - 1)]).sum::<f64>() / nodes[n - 1].1;
    (flux(&r), flux(&t))
}

#[test]
fn anisotropic_slab_agrees_with_doubling_and_with_van_de_hulst() {
    // van de Hulst 1980, as Prahl et al. 1989 and Wang et al. 1995 quote it: 0.09739 and 0.66096
    let (r, t) = doubling(0.9, 0.75, 2.0);
    assert!((r - 0.09739).abs() < 2e-5 && (t - 0.66096).abs() < 2e-5, "{r} {t}");
    for (omega, g, delta) in [(0.9, 0.75, 2.0), (0.98, 0.9, 5.0), (0.95, -0.9, 1.5), (1.0, 0.5, 4.0), (0.7, -0.4, 0.1)]
    {
        let (r, t) = doubling(omega, g, delta);
        let got = matched((1.0 - omega) * delta, omega * delta, g, 1.0)
            .walk(EntryDirection::NORMAL, histories(60_000), &[])
            .unwrap();
        agrees(&format!("ω {omega} g {g} Δ {delta} R"), got.reflected, r, 4.0, 2.5e-3);
        agrees(&format!("ω {omega} g {g} Δ {delta} T"), got.transmitted, t, 4.0, 2.5e-3);
    }
}

/// A face reflects part of the light that leaves a bare slab back inside, Lambertian: two geometric series over the
/// exact responses of the bare slab.
#[test]
fn diffuse_faces_compose_the_bare_slab() {
    for (sa, ss, d, rho) in [(0.4, 10.2, 0.2, 0.45), (2.0, 5.0, 0.05, 0.6), (0.0, 8.0, 0.3, 0.3)] {
        let bare = medium::response(sa, ss, d);
        let (mut rd, mut td) = (0.0, 0.0);
        for q in gauss(40) {
            let at = medium::response_at(q.x, sa, ss, d);
            (rd, td) = (rd + 2.0 * q.x * q.w * at.rho_d, td + 2.0 * q.x * q.w * at.rho_t);
        }
        // flux on the lit face (a) and on the other (b), from inside: a = R + ρ(a Rd + b Td), b = T + ρ(b Rd + a Td)
        let (p, q) = (1.0 - rho * rd, rho * td);
        let (a, b) =
            ((p * bare.rho_d + q * bare.rho_t) / (p * p - q * q), (p * bare.rho_t + q * bare.rho_d) / (p * p - q * q));
        let slab = Slab {
            medium: Medium { sigma_a: sa, sigma_s: ss, g: 0.0 },
            thickness_mm: d,
            boundary: Boundary::Diffuse { reflectance: rho },
        };
        let got = slab.walk(EntryDirection::NORMAL, histories(60_000), &[]).unwrap();
        agrees("R", got.reflected, (1.0 - rho) * a, 4.0, 2.5e-3);
        agrees("T", got.transmitted, (1.0 - rho) * b, 4.0, 2.5e-3);
        agrees("unscattered", got.unscattered, (1.0 - rho) * (-(sa + ss) * d).exp(), 4.0, 1e-6);
        let got = matched(sa, ss, 0.0, d).walk(EntryDirection::Diffuse, histories(60_000), &[]).unwrap();
        agrees("Lambertian R", got.reflected, rd, 4.0, 2.5e-3);
        agrees("Lambertian T", got.transmitted, td, 4.0, 2.5e-3);
    }
}

#[test]
fn dielectric_faces_give_giovanellis_half_space() {
    // Giovanelli 1955: smooth face, n = 1.5, ω = 0.9, isotropic, normal light: total reflectance 0.2600 (with the 0.04
    // of the face)
    let slab = |slope: f64| Slab {
        medium: Medium { sigma_a: 1.0, sigma_s: 9.0, g: 0.0 },
        thickness_mm: 6.0,
        boundary: Boundary::Rough(RoughSurface { index: 1.5, slope }),
    };
    let got = slab(0.0).walk(EntryDirection::NORMAL, histories(50_000), &[]).unwrap();
    agrees("glossy", got.glossy, 0.04, 4.0, 2e-3);
    agrees("diffuse", got.reflected, 0.2600 - 0.04, 4.0, 2.5e-3);
    // With index 1 there is no face at all, however rough it is.
    let (medium, thickness_mm) = (Medium { sigma_a: 0.5, sigma_s: 6.0, g: 0.3 }, 0.2);
    let free = Slab { medium, thickness_mm, boundary: Boundary::Matched }
        .walk(EntryDirection::NORMAL, histories(40_000), &[])
        .unwrap();
    let none = Slab { medium, thickness_mm, boundary: Boundary::Rough(RoughSurface { index: 1.0, slope: 0.5 }) };
    let none = none.walk(EntryDirection::NORMAL, Histories { count: 40_000, seed: 9 }, &[]).unwrap();
    for (a, b) in
        [(free.transmitted, none.transmitted), (free.reflected, none.reflected), (free.unscattered, none.unscattered)]
    {
        assert!((a.value - b.value).abs() < 4.0 * a.error.hypot(b.error), "{a:?} {b:?}");
    }
}

#[test]
fn a_thin_slab_scatters_once_as_the_closed_form_says() {
    // isotropic, Δ = 1e-4: T(r) = σs/(4π) (1/r − 1/√(r² + d²)), over a ring ½σs [r − √(r² + d²)]; Δ ln Δ is the next
    // order
    let (ss, d) = (1e-3, 0.1);
    let edges = [0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 1.0];
    let got = matched(0.0, ss, 0.0, d).walk(EntryDirection::NORMAL, histories(60_000), &edges).unwrap();
    for (ring, e) in got.radial.iter().zip(edges.windows(2)) {
        let primitive = |r: f64| 0.5 * ss * (r - (r * r + d * d).sqrt());
        let want = (primitive(e[1]) - primitive(e[0])) / (std::f64::consts::PI * (e[1] * e[1] - e[0] * e[0]));
        agrees(&format!("ring {e:?}"), *ring, want, 4.0, 0.03 * want);
    }
    // isotropic emission leaves with flux ∝ dμ: far from Lambertian
    for (k, share) in got.angles.iter().enumerate() {
        let want = ((k + 1) as f64 / ANGLES as f64).sqrt() - (k as f64 / ANGLES as f64).sqrt();
        agrees(&format!("angle {k}"), *share, want, 4.0, 5e-3);
    }
    agrees("cosine", got.mean_cosine, 0.5, 4.0, 5e-3);
}

#[test]
fn rings_add_up_and_a_deep_slab_forgets_its_phase_function() {
    let edges: Vec<f64> = (0..=40).map(|k| 0.5 * f64::from(k)).collect();
    // Similarity: where light has scattered often, only σs(1−g) matters.
    let mut totals = Vec::new();
    for g in [0.0, 0.9, -0.9] {
        let got =
            matched(0.05, 10.0 / (1.0 - g), g, 1.0).walk(EntryDirection::Diffuse, histories(8_000), &edges).unwrap();
        let rings: f64 = got
            .radial
            .iter()
            .zip(edges.windows(2))
            .map(|(t, e)| t.value * std::f64::consts::PI * (e[1] * e[1] - e[0] * e[0]))
            .sum();
        let scattered = got.transmitted.value - got.unscattered.value;
        assert!((rings - scattered).abs() < 1e-9, "g {g}: {rings} {scattered}");
        assert!((got.angles.iter().map(|a| a.value).sum::<f64>() - 1.0).abs() < 1e-12);
        totals.push(got.transmitted);
    }
    for t in &totals[1..] {
        assert!(
            (t.value - totals[0].value).abs() < 0.04 * totals[0].value + 4.0 * t.error.hypot(totals[0].error),
            "{totals:?}"
        );
    }
}

#[test]
fn energy_is_conserved_over_the_whole_range() {
    for d in [1e-3, 0.1, 10.0] {
        for (sigma_a, sigma_s, g) in [(0.0, 1.0, 0.9), (1.0, 10.0, -0.9), (10.0, 30.0, 0.0), (1e-3, 3.0, 0.5)] {
            for boundary in [
                Boundary::Matched,
                Boundary::Diffuse { reflectance: 0.4 },
                Boundary::Rough(RoughSurface { index: 1.4, slope: 0.4 }),
            ] {
                let slab = Slab { medium: Medium { sigma_a, sigma_s, g }, thickness_mm: d, boundary };
                let got = slab.walk(EntryDirection::Beam([0.6, 0.0, 0.8]), histories(600), &[0.0, 1.0]).unwrap();
                agrees(&format!("{slab:?}"), got.balance, 1.0, 5.0, 0.05);
                assert!(got.lost.value == 0.0);
                let sum = got.reflected.value + got.glossy.value + got.transmitted.value + got.absorbed.value;
                assert!((sum - got.balance.value).abs() < 1e-9);
            }
        }
    }
}

#[test]
fn the_threads_do_not_matter_and_the_seed_does() {
    let slab = matched(0.4, 10.0, 0.1, 0.2);
    let on = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| slab.walk(EntryDirection::NORMAL, Histories { count: 30_000, seed }, &[0.0, 0.1, 0.3]).unwrap())
    };
    assert_eq!(on(1, 7), on(3, 7));
    assert_ne!(on(1, 7).transmitted, on(1, 8).transmitted);
}

/// Over many seeds, the standard errors agree with the scatter.
#[test]
fn standard_errors_are_what_they_say() {
    let slab = Slab {
        medium: Medium { sigma_a: 1.0, sigma_s: 8.0, g: 0.2 },
        thickness_mm: 0.2,
        boundary: Boundary::Diffuse { reflectance: 0.2 },
    };
    let runs: Vec<SlabWalk> = (0..60)
        .map(|seed| slab.walk(EntryDirection::NORMAL, Histories { count: 1000, seed }, &[0.0, 0.1, 0.3]).unwrap())
        .collect();
    for pick in [
        |w: &SlabWalk| w.transmitted,
        |w: &SlabWalk| w.reflected,
        |w: &SlabWalk| w.radial[1],
        |w: &SlabWalk| w.mean_square_radius,
        |w: &SlabWalk| w.angles[7],
        |w: &SlabWalk| w.mean_cosine,
    ] {
        let values: Vec<f64> = runs.iter().map(|w| pick(w).value).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let scatter = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64).sqrt();
        let said = runs.iter().map(|w| pick(w).error).sum::<f64>() / runs.len() as f64;
        // 60 runs give the scatter to 9 %.
        assert!((scatter / said - 1.0).abs() < 0.36, "{scatter} {said}");
    }
}

#[test]
fn what_cannot_be_walked_is_refused() {
    let good = matched(1.0, 1.0, 0.0, 1.0);
    let refused = |slab: Slab, entry: EntryDirection, n: u64, edges: &[f64]| {
        assert!(slab.walk(entry, histories(n), edges).is_err())
    };
    refused(matched(-1.0, 1.0, 0.0, 1.0), EntryDirection::NORMAL, 10, &[]);
    refused(matched(1.0, f64::NAN, 0.0, 1.0), EntryDirection::NORMAL, 10, &[]);
    refused(matched(1.0, 1.0, 1.0, 1.0), EntryDirection::NORMAL, 10, &[]);
    refused(matched(1.0, 1.0, 0.0, f64::INFINITY), EntryDirection::NORMAL, 10, &[]);
    refused(good, EntryDirection::Beam([1.0, 0.0, 0.0]), 10, &[]);
    refused(good, EntryDirection::NORMAL, 1, &[]);
    refused(good, EntryDirection::NORMAL, 10, &[0.0, 0.0]);
    refused(Slab { boundary: Boundary::Diffuse { reflectance: 1.0 }, ..good }, EntryDirection::NORMAL, 10, &[]);
    refused(
        Slab { boundary: Boundary::Rough(RoughSurface { index: 0.9, slope: 0.1 }), ..good },
        EntryDirection::NORMAL,
        10,
        &[],
    );
}
