use super::*;
use crate::slab::{medium, response};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

pub(super) fn log_uniform(rng: &mut Pcg64Mcg, low: f64, high: f64) -> f64 {
    (low.ln() + (high / low).ln() * rng.random::<f64>()).exp()
}

pub(super) fn gaussian(rng: &mut Pcg64Mcg) -> f64 {
    let u: f64 = 1.0 - rng.random::<f64>();
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * rng.random::<f64>()).cos()
}

#[test]
fn returns_to_the_slab_it_came_from() {
    let mut rng = Pcg64Mcg::seed_from_u64(11);
    let mut determined = 0;
    for _ in 0..600 {
        let (omega, delta) = (0.02 + 0.97 * rng.random::<f64>(), log_uniform(&mut rng, 0.02, 12.0));
        let h = log_uniform(&mut rng, 0.05, 2.0);
        let (a, s) = ((1.0 - omega) * delta / h, omega * delta / h);
        let r = medium::response(a, s, h);
        for (precision, digits) in [(InversionPrecision::Fast, 1e-6), (InversionPrecision::Exact, 1e-9)] {
            let e = invert_with(precision, r.rho_d, r.rho_t, h, 1e-9, 1e-9);
            if e.status.is_ok() {
                determined += 1;
                // Rounding does not allow 1e-9 in σ where 1−ω and T are both small.
                let room = digits * (e.condition / 30.0).max(1.0);
                assert!((e.sigma_a / a - 1.0).abs() < room, "ω {omega} Δ {delta}: {e:?} {a}");
                assert!((e.sigma_s / s - 1.0).abs() < room, "ω {omega} Δ {delta}: {e:?} {s}");
            }
        }
    }
    assert!(determined > 1100, "{determined}");
}

/// For rows called `ok` over random slabs and noise: how often the 95 % intervals contain σa and σs, how many values
/// are off by more than 4 errors, and how many rows there are.
fn coverage(rows: usize, seed: u64, noise: f64) -> ([f64; 2], usize, usize) {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let (mut inside, mut wrong, mut ok) = ([0usize; 2], 0, 0);
    for _ in 0..rows {
        let side = log_uniform(&mut rng, 1e-6, 1.0);
        let absorbed = if rng.random::<f64>() < 0.5 { side } else { 1.0 - 0.999_999 * side };
        let (delta, h) = (log_uniform(&mut rng, 1e-4, 300.0), log_uniform(&mut rng, 0.05, 1.0));
        let truth = [absorbed * delta / h, (1.0 - absorbed) * delta / h];
        let r = response(truth[0], truth[1], h);
        let e = invert(r.rho_d + noise * gaussian(&mut rng), r.rho_t + noise * gaussian(&mut rng), h, noise, noise);
        if e.status.is_ok() {
            ok += 1;
            let z = [(e.sigma_a - truth[0]) / e.sigma_a_err, (e.sigma_s - truth[1]) / e.sigma_s_err];
            for k in 0..2 {
                inside[k] += usize::from(z[k].abs() < 1.96);
            }
            if z[0].abs() > 4.0 || z[1].abs() > 4.0 {
                println!("1−ω {absorbed:.3e} Δ {delta:.3e} noise {noise}: z {z:?} {e:?} truth {truth:?}");
                wrong += 1;
            }
        }
    }
    ([inside[0] as f64 / ok as f64, inside[1] as f64 / ok as f64], wrong, ok)
}

#[test]
fn intervals_contain_the_truth_as_often_as_they_say() {
    for (noise, seed) in [(1e-2, 21), (1e-3, 22), (1e-6, 23)] {
        let ([a, s], wrong, ok) = coverage(6000, seed, noise);
        println!("noise {noise}: ok {ok}, coverage σa {a:.4} σs {s:.4}, beyond 4 errors {wrong}");
        // the binomial standard error of 0.95 over `ok` rows, twice
        let room = 2.0 * (0.05 * 0.95 / ok as f64).sqrt();
        for c in [a, s] {
            assert!(c > 0.93 - room && c < 0.97 + room, "noise {noise}: {c} of {ok}");
        }
        // 6e-5 is the two-sided Gaussian tail
        assert!(wrong as f64 <= 2.0 + 4.0 * 6.4e-5 * ok as f64, "{wrong} of {ok}");
    }
}

#[test]
fn bounds_by_name() {
    let name = |r: f64, t: f64, noise: f64| invert(r, t, 0.2, noise, noise).status.to_string();
    let starts = |got: String, want: &str| assert!(got.starts_with(want), "{got:?}, expected {want:?}");
    starts(name(0.3, 0.2, 1e-3), "ok");
    starts(name(0.6, 0.4, 1e-3), "undetermined: sigma_a <= ");
    starts(name(0.6, 0.4, 0.0), "undetermined: sigma_a <= ");
    starts(name(0.6, 0.4005, 1e-3), "undetermined: sigma_a <= ");
    starts(name(0.2, 0.0, 1e-6), "undetermined: sigma_a >= ");
    assert!(name(0.2, 0.0, 1e-6).contains("; sigma_s >= "));
    starts(name(0.2, 0.0, 0.0), "undetermined: sigma_a >= ");
    starts(name(0.0, 0.5, 1e-4), "undetermined: sigma_s <= ");
    starts(name(0.0, 1.0, 1e-4), "undetermined: sigma_a <= ");
    for (r, t) in [(f64::NAN, 0.2), (0.2, f64::INFINITY), (-0.1, 0.2), (0.2, -0.1), (0.7, 0.4), (1.0, 1.0), (0.0, 1.2)]
    {
        starts(name(r, t, 1e-3), "refused: ");
    }
    for h in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        starts(invert(0.3, 0.2, h, 1e-3, 1e-3).status.to_string(), "refused: h");
    }
    starts(invert(0.3, 0.2, 0.2, -1.0, 1e-3).status.to_string(), "refused: rho_d_err");
}

#[test]
fn stated_bounds_hold() {
    // The truth lies inside the one-sided bound in about 97.7 % of noisy rows, and is never far outside.
    let mut rng = Pcg64Mcg::seed_from_u64(31);
    let noise = 1e-3;
    let (mut rows, mut kept) = (0, 0);
    for _ in 0..3000 {
        let absorbed = log_uniform(&mut rng, 1e-6, 1.0);
        let delta = log_uniform(&mut rng, 1e-3, 200.0);
        let truth = [absorbed * delta, (1.0 - absorbed) * delta];
        let r = response(truth[0], truth[1], 1.0);
        let e = invert(r.rho_d + noise * gaussian(&mut rng), r.rho_t + noise * gaussian(&mut rng), 1.0, noise, noise);
        if let Status::Undetermined(text) = &e.status {
            for part in text.split("; ") {
                let words: Vec<&str> = part.split(' ').filter(|word| *word != "and").collect();
                let [name, bounds @ ..] = &words[..] else { continue };
                let true_value = truth[usize::from(*name == "sigma_s")];
                for pair in bounds.chunks(2) {
                    let bound: f64 = pair[1].parse().unwrap();
                    rows += 1;
                    kept += usize::from(if pair[0] == "<=" { true_value <= bound } else { true_value >= bound });
                }
            }
        }
    }
    println!("{kept} of {rows} bounds hold");
    assert!(rows > 500 && kept as f64 > 0.96 * rows as f64, "{kept} of {rows}");
}

/// `cargo test --release inversions_a_second -- --ignored --nocapture`
#[test]
#[ignore = "a timing, to be read, not judged"]
fn inversions_a_second() {
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    let rows: Vec<_> = (0..20_000)
        .map(|_| {
            let (omega, delta) = (0.02 + 0.97 * rng.random::<f64>(), log_uniform(&mut rng, 0.02, 12.0));
            let r = medium::solve(omega, 1.0 - omega, delta);
            (r, [(1.0 - omega) * delta, omega * delta])
        })
        .collect();
    for (precision, passes) in [(InversionPrecision::Fast, 50), (InversionPrecision::Exact, 1)] {
        let mut worst = [0.0_f64; 2];
        let mut ok = 0;
        let clock = std::time::Instant::now();
        for _ in 0..passes {
            for (r, truth) in &rows {
                let e = invert_with(precision, r.rho_d, r.rho_t, 1.0, 1e-6, 1e-6);
                if e.status.is_ok() {
                    ok += 1;
                    worst = [
                        worst[0].max((e.sigma_a / truth[0] - 1.0).abs()),
                        worst[1].max((e.sigma_s / truth[1] - 1.0).abs()),
                    ];
                }
            }
        }
        let rate = (passes * rows.len()) as f64 / clock.elapsed().as_secs_f64();
        println!(
            "{precision:?}: {rate:.0} inversions/s, ok {ok} of {}, largest relative errors {worst:?}",
            passes * rows.len()
        );
    }
}

#[test]
#[ignore = "long"]
fn coverage_over_many() {
    for noise in [3e-2, 1e-2, 3e-3, 1e-3, 1e-4, 1e-5, 1e-6, 1e-9] {
        let ([a, s], wrong, ok) = coverage(40_000, 77, noise);
        println!("noise {noise}: ok {ok}, coverage σa {a:.4} σs {s:.4}, beyond 4 errors {wrong}");
    }
}

#[test]
fn no_noise_from_clear_to_opaque_to_the_edge_of_numbers() {
    // With exact inputs, everything called ok is right within its errors, and nothing valid is refused.
    let mut rng = Pcg64Mcg::seed_from_u64(41);
    let mut ok = 0;
    for _ in 0..400 {
        let side = log_uniform(&mut rng, 1e-9, 1.0);
        let (omega, absorbed) = if rng.random::<f64>() < 0.5 { (side, 1.0 - side) } else { (1.0 - side, side) };
        let delta = log_uniform(&mut rng, 1e-6, 600.0);
        let r = medium::solve(omega, absorbed, delta);
        let e = invert(r.rho_d, r.rho_t, 1.0, 0.0, 0.0);
        assert!(!matches!(e.status, Status::Refused(_)), "ω {omega} Δ {delta}: {e:?}");
        if e.status.is_ok() {
            ok += 1;
            let off = ((e.sigma_a - absorbed * delta) / e.sigma_a_err)
                .abs()
                .max(((e.sigma_s - omega * delta) / e.sigma_s_err).abs());
            assert!(off < 4.0, "ω {omega} 1−ω {absorbed} Δ {delta}: {off} errors off, {e:?}");
        }
    }
    assert!(ok > 350, "{ok}");
}

#[test]
fn a_transmittance_measured_below_zero_bounds_like_zero() {
    for t in [0.0, -0.5e-3, -2.5e-3, -3.9e-3] {
        let e = invert(0.2, t, 0.3, 1e-3, 1e-3);
        let text = e.status.to_string();
        assert!(text.starts_with("undetermined: sigma_a >= ") && text.contains("; sigma_s >= "), "{t}: {text}");
        assert!(e.sigma_a.is_finite() && e.sigma_a_err.is_infinite(), "{t}: {e:?}");
    }
}

/// Where the transmittance is two to four errors above zero, the slab may be opaque and the coefficients stay open, but
/// their intervals are closed at two standard errors and so are the errors. Beyond four errors they are determined.
#[test]
fn a_transmittance_above_zero_closes_the_interval() {
    let (truth, h, noise) = ([22.2, 1.6], 0.16, 2e-3);
    let r = response(truth[0], truth[1], h);
    let mut last = f64::INFINITY;
    for z in [2.2, 3.0, 3.8, 4.2, 5.0, 5.5, 6.0, 9.0] {
        let e = invert(r.rho_d, z * noise, h, noise, noise);
        let open = e.status.leaves_open("sigma_a");
        assert!(open == (z < 4.0), "{z}: {e:?}");
        assert!(e.sigma_a_err.is_finite() && e.sigma_a_err <= last, "{z}: {e:?}");
        assert!((e.sigma_a_err > DETERMINED * e.sigma_a) == open, "{z}: {e:?}");
        last = e.sigma_a_err;
        let text = e.status.to_string();
        if open {
            // Both bounds are those of the slabs at two errors less and more light.
            let both: Vec<f64> = text.split([' ', ';']).skip(1).filter_map(|w| w.parse().ok()).take(2).collect();
            let at = |t: f64| invert(r.rho_d, t, h, 1e-9, 1e-9).sigma_a;
            let want = [at((z + 2.0) * noise), at((z - 2.0) * noise)];
            assert!(text.contains("sigma_a >= ") && text.contains(" and <= "), "{text}");
            for (got, want) in both.iter().zip(want) {
                assert!((got / want - 1.0).abs() < 0.1, "{z}: {text}, expected {want:?}");
            }
        }
    }
    // Within two errors of zero nothing limits the value.
    let e = invert(r.rho_d, 1.9 * noise, h, noise, noise);
    assert!(e.sigma_a_err.is_infinite() && !e.status.to_string().contains("<="), "{e:?}");
}

/// Away from the edges the largest errors that count as determined carry over linearly, so nobody has to ask the model.
#[test]
fn far_from_the_edges_determined_errors_are_linear() {
    let mut rng = Pcg64Mcg::seed_from_u64(17);
    let mut asked = 0;
    for _ in 0..6000 {
        let side = log_uniform(&mut rng, 1e-4, 1.0);
        let other = (1.0 - side) * rng.random::<f64>();
        let [r, t] = match rng.random_range(0..3) {
            0 => [side, other],
            1 => [other, side],
            _ => [other, 1.0 - side - other],
        };
        let lost = 1.0 - r - t;
        let ratio = log_uniform(&mut rng, 0.1, 10.0);
        let Some(point) =
            (if lost > 0.0 { solve(SlabModel::matched(), r, t, lost, InversionPrecision::Fast) } else { None })
        else {
            continue;
        };
        // The largest noise of this ratio that leaves both parameters determined.
        let unit = Measured { r, t, r_err: 1e-3 * ratio, t_err: 1e-3 / ratio };
        let scale =
            DETERMINED / Spread::new(SlabModel::matched(), &point, &unit).relative.into_iter().fold(0.0, f64::max);
        let m = Measured { r_err: scale * unit.r_err, t_err: scale * unit.t_err, ..unit };
        if near_edge(SlabModel::matched(), &m, lost) {
            continue;
        }
        asked += 1;
        let spread = Spread::new(SlabModel::matched(), &point, &m);
        assert!(bounds::nearly_linear(SlabModel::matched(), &m, &point, &spread, InversionPrecision::Fast), "{m:?}");
    }
    assert!(asked > 500, "{asked}");
}

/// Where a transmittance lies within two errors of zero, any thicker slab is left open, also where the other
/// coefficient is known with an error as large as the measurement's own.
#[test]
fn a_known_coefficient_does_not_close_what_darkness_leaves_open() {
    let model = SlabModel::matched();
    for share in [0.0, 0.1, 0.5, 1.0] {
        let single = SingleMeasurement {
            share: SlabShare::Transmitted,
            value: 1.8e-3,
            err: 1e-3,
            known: SlabCoefficient::Scattering,
            sigma: 2.0,
            sigma_err: 2.0 * share,
        };
        let e = invert_single(model, &single, 0.2);
        assert!(e.sigma_a_err.is_infinite() && !e.status.to_string().contains("<="), "{share}: {e:?}");
    }
}
