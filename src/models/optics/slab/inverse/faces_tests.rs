//! The inversion of slabs with reflecting faces, and of one share with one known coefficient.

use super::tests::{gaussian, log_uniform};
use super::*;
use crate::slab::faces::SlabFaces;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::sync::OnceLock;

/// Index, model and exact faces of a few slabs.
fn slabs() -> &'static [(f64, SlabModel, SlabFaces)] {
    static SLABS: OnceLock<Vec<(f64, SlabModel, SlabFaces)>> = OnceLock::new();
    SLABS.get_or_init(|| [1.005, 1.41, 2.0].map(|n| (n, SlabModel::of_index(n), SlabFaces::new(n, 1.0))).into())
}

/// ω and 1−ω: half of the draws lie near ω = 1, half near 0.
fn albedo(rng: &mut Pcg64Mcg, smallest: f64) -> (f64, f64) {
    let side = log_uniform(rng, smallest, 1.0);
    if rng.random::<f64>() < 0.5 { (side, 1.0 - side) } else { (1.0 - side, side) }
}

#[test]
fn the_table_is_the_exact_solution() {
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    for (index, model, faces) in slabs() {
        for _ in 0..300 {
            let (omega, absorbed) = albedo(&mut rng, 1e-9);
            let delta = log_uniform(&mut rng, 1e-8, 1e4);
            let (got, want) = (model.response(omega, absorbed, delta), faces.shares(omega, absorbed, delta).response());
            assert!((got.rho_d / want.rho_d - 1.0).abs() < 3e-7, "n {index} ω {omega} Δ {delta}: {got:?} {want:?}");
            if want.rho_t > 1e-30 {
                assert!((got.rho_t / want.rho_t - 1.0).abs() < 3e-7, "n {index} ω {omega} Δ {delta}: {got:?} {want:?}");
            }
        }
    }
}

#[test]
fn returns_to_the_slab_it_came_from() {
    let mut rng = Pcg64Mcg::seed_from_u64(11);
    for (index, model, faces) in slabs() {
        let mut determined = 0;
        for _ in 0..150 {
            let (omega, absorbed) = albedo(&mut rng, 1e-3);
            let (delta, h) = (log_uniform(&mut rng, 1e-3, 30.0), log_uniform(&mut rng, 0.05, 2.0));
            let (a, s) = (absorbed * delta / h, omega * delta / h);
            let r = faces.shares(omega, absorbed, delta).response();
            for (precision, digits) in [(InversionPrecision::Fast, 1e-6), (InversionPrecision::Exact, 1e-9)] {
                let e = invert_in(model, precision, r.rho_d, r.rho_t, h, 1e-9, 1e-9);
                assert!(!matches!(e.status, Status::Refused(_)), "n {index} ω {omega} Δ {delta}: {e:?}");
                if e.status.is_ok() {
                    determined += 1;
                    let room = digits * (e.condition / 30.0).max(1.0);
                    let off = (e.sigma_a / a - 1.0).abs().max((e.sigma_s / s - 1.0).abs());
                    let z = ((e.sigma_a - a) / e.sigma_a_err).abs().max(((e.sigma_s - s) / e.sigma_s_err).abs());
                    assert!(off < room && z < 4.0, "n {index} {precision} ω {omega} Δ {delta}: {z} errors, {e:?}");
                }
            }
        }
        assert!(determined > 270, "n {index}: {determined}");
    }
}

#[test]
fn intervals_contain_the_truth_as_often_as_they_say() {
    let mut rng = Pcg64Mcg::seed_from_u64(23);
    let (_, model, faces) = &slabs()[1];
    let noise = 1e-3;
    let (mut inside, mut wrong, mut ok) = ([0usize; 2], 0, 0);
    let (mut bounds, mut kept) = (0, 0);
    for _ in 0..1500 {
        let (omega, absorbed) = albedo(&mut rng, 1e-3);
        let (delta, h) = (log_uniform(&mut rng, 0.01, 60.0), log_uniform(&mut rng, 0.05, 1.0));
        let truth = [absorbed * delta / h, omega * delta / h];
        let r = faces.shares(omega, absorbed, delta).response();
        let (r, t) = (r.rho_d + noise * gaussian(&mut rng), r.rho_t + noise * gaussian(&mut rng));
        let e = invert_in(model, InversionPrecision::Fast, r, t, h, noise, noise);
        assert!(!matches!(e.status, Status::Refused(_)), "ω {omega} Δ {delta}: {e:?}");
        if e.status.is_ok() {
            ok += 1;
            let z = [(e.sigma_a - truth[0]) / e.sigma_a_err, (e.sigma_s - truth[1]) / e.sigma_s_err];
            for k in 0..2 {
                inside[k] += usize::from(z[k].abs() < 1.96);
            }
            wrong += usize::from(z[0].abs() > 4.0 || z[1].abs() > 4.0);
        } else if let Status::Undetermined(text) = &e.status {
            for part in text.split("; ") {
                let words: Vec<&str> = part.split(' ').filter(|word| *word != "and").collect();
                let [name, both @ ..] = &words[..] else { continue };
                let value = truth[usize::from(*name == "sigma_s")];
                for pair in both.chunks(2) {
                    let bound = pair[1].parse::<f64>().unwrap();
                    bounds += 1;
                    kept += usize::from(if pair[0] == "<=" { value <= bound } else { value >= bound });
                }
            }
        }
    }
    let room = 3.0 * (0.05 * 0.95 / ok as f64).sqrt();
    for count in inside {
        let share = count as f64 / ok as f64;
        assert!((share - 0.95).abs() < 0.02 + room, "{share} of {ok}");
    }
    assert!(ok > 300 && wrong <= 2, "{wrong} of {ok}");
    assert!(bounds > 100 && kept as f64 > 0.95 * bounds as f64, "{kept} of {bounds}");
}

#[test]
fn bounds_and_refusals_by_name() {
    let (index, model, _) = &slabs()[1];
    let face = ((index - 1.0) / (index + 1.0)).powi(2);
    let clear = (1.0 - face) / (1.0 + face);
    let name = |r: f64, t: f64| invert_in(model, InversionPrecision::Fast, r, t, 0.2, 1e-3, 1e-3).status.to_string();
    let starts = |got: String, want: &str| assert!(got.starts_with(want), "{got:?}, expected {want:?}");
    starts(name(0.3, 0.2), "ok");
    starts(name(0.6, 0.4), "undetermined: sigma_a <= ");
    starts(name(0.6, 0.4005), "undetermined: sigma_a <= ");
    starts(name(0.2, 0.0), "undetermined: sigma_a >= ");
    assert!(name(0.2, 0.0).contains("; sigma_s >= "));
    // No more than the faces reflect: nothing scatters.
    let t = (1.0 - face) * (1.0 - face) * 0.5 / (1.0 - face * face * 0.25);
    starts(name(face + face * 0.5 * t, t), "undetermined: sigma_s <= ");
    starts(name(1.0 - clear, clear), "undetermined: sigma_a <= ");
    starts(name(0.02, 0.2), "refused: rho_d is 0.02; at this rho_t the faces of a slab of index 1.41 reflect 0.03");
    starts(name(0.03, 0.96), "refused: rho_t is 0.96; the faces of a slab of index 1.41 let through at most 0.9437");
    starts(name(0.7, 0.4), "refused: rho_d + rho_t");
    starts(name(11.9, 20.1), "refused: rho_d is 11.9; expected a fraction between 0 and 1 (is it in per cent?)");
}

/// One share and one coefficient, over random slabs: what is called ok is right within its errors, and bounds hold.
#[test]
fn one_share_and_one_coefficient() {
    let mut rng = Pcg64Mcg::seed_from_u64(31);
    let (matched, faces) = (SlabModel::matched(), &slabs()[1].1);
    let (mut ok, mut inside, mut wrong) = (0usize, 0usize, 0usize);
    for k in 0..1200 {
        let model = if k % 2 == 0 { matched } else { faces };
        let (omega, absorbed) = albedo(&mut rng, 1e-2);
        let (delta, h) = (log_uniform(&mut rng, 0.03, 20.0), log_uniform(&mut rng, 0.05, 1.0));
        let truth = [absorbed * delta / h, omega * delta / h];
        let r = model.response(omega, absorbed, delta);
        let noise = log_uniform(&mut rng, 1e-4, 1e-2);
        let (share, value) =
            if k % 4 < 2 { (SlabShare::Reflected, r.rho_d) } else { (SlabShare::Transmitted, r.rho_t) };
        let (known, at) = if k % 8 < 4 { (SlabCoefficient::Absorption, 0) } else { (SlabCoefficient::Scattering, 1) };
        let sigma_err = truth[at] * 0.03 * rng.random::<f64>();
        let sigma = truth[at] + sigma_err * gaussian(&mut rng);
        let value = value + noise * gaussian(&mut rng);
        let e = invert_single(model, &SingleMeasurement { share, value, err: noise, known, sigma, sigma_err }, h);
        let (found, err) = if at == 0 { (e.sigma_s, e.sigma_s_err) } else { (e.sigma_a, e.sigma_a_err) };
        if e.status.is_ok() {
            ok += 1;
            let z = (found - truth[1 - at]) / err;
            inside += usize::from(z.abs() < 1.96);
            wrong += usize::from(z.abs() > 4.0);
            assert!(err <= DETERMINED * found, "{e:?}");
        }
    }
    let share = inside as f64 / ok as f64;
    assert!(ok > 200 && wrong <= 1, "{wrong} of {ok}");
    assert!((share - 0.95).abs() < 0.02 + 3.0 * (0.05 * 0.95 / ok as f64).sqrt(), "{share} of {ok}");
}

#[test]
fn what_one_share_leaves_open_is_bounded_by_name() {
    let model = SlabModel::matched();
    let fit = |share: SlabShare, value: f64, known: SlabCoefficient, sigma: f64| {
        let e = invert_single(model, &SingleMeasurement { share, value, err: 2e-3, known, sigma, sigma_err: 0.0 }, 0.2);
        assert!(matches!(e.status, Status::Refused(_)) || (e.sigma_a.is_finite() && e.sigma_s.is_finite()), "{e:?}");
        e.status.to_string()
    };
    let starts = |got: String, want: &str| assert!(got.starts_with(want), "{got:?}, expected {want:?}");
    for t in [0.0, -1e-3, 1e-3] {
        starts(fit(SlabShare::Transmitted, t, SlabCoefficient::Scattering, 1.0), "undetermined: sigma_a >= ");
        starts(fit(SlabShare::Transmitted, t, SlabCoefficient::Absorption, 1.0), "undetermined: sigma_s >= ");
    }
    starts(fit(SlabShare::Transmitted, 0.999, SlabCoefficient::Absorption, 0.0), "undetermined: sigma_s <= ");
    starts(
        fit(SlabShare::Transmitted, 0.99, SlabCoefficient::Scattering, 1.0),
        "refused: rho_t is 0.99; a slab of this",
    );
    starts(fit(SlabShare::Reflected, 0.0, SlabCoefficient::Absorption, 1.0), "undetermined: sigma_s <= ");
    starts(fit(SlabShare::Reflected, 1.0, SlabCoefficient::Absorption, 0.0), "undetermined: sigma_s >= ");
    starts(fit(SlabShare::Reflected, 0.9, SlabCoefficient::Scattering, 1.0), "refused: rho_d is 0.9; a slab of this");
}

/// At a high index a little scattering takes more from the far face's mirror reflection than it sends back, so two
/// slabs reflect alike.
#[test]
fn several_slabs_of_one_reflectance_are_named() {
    let (model, a, s) = (&slabs()[2].1, 0.1, 0.05);
    let at = |s: f64| model.response(s / (a + s), a / (a + s), a + s).rho_d;
    assert!(at(s) > at(0.114) && at(0.3) > at(s));
    let single = SingleMeasurement {
        share: SlabShare::Reflected,
        value: at(s),
        err: 1e-5,
        known: SlabCoefficient::Absorption,
        sigma: a,
        sigma_err: 0.0,
    };
    let e = invert_single(model, &single, 1.0);
    let text = e.status.to_string();
    assert!(text.starts_with("undetermined: sigma_s (") && text.contains("1/mm give this rho_d alike"), "{text}");
    assert!((e.sigma_s / s - 1.0).abs() < 1e-3 && e.sigma_s_err > 0.1 * s, "{e:?}");
    // The transmittance tells them apart.
    let t = model.response(s / (a + s), a / (a + s), a + s).rho_t;
    let e =
        invert_single(model, &SingleMeasurement { share: SlabShare::Transmitted, value: t, err: 1e-5, ..single }, 1.0);
    assert!(e.status.is_ok() && (e.sigma_s / s - 1.0).abs() < 4e-3, "{e:?}");
}

/// `cargo test --release models_a_second -- --ignored --nocapture`
#[test]
#[ignore = "a timing, to be read, not judged"]
fn models_and_inversions_a_second() {
    for index in [1.01, 1.41, 2.0] {
        let clock = std::time::Instant::now();
        let model = SlabModel::of_index(index);
        let made = clock.elapsed();
        let _ = invert_in(&model, InversionPrecision::Fast, 0.3, 0.3, 1.0, 1e-6, 1e-6);
        let faces = SlabFaces::new(index, 1.0);
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let rows: Vec<_> = (0..2000)
            .map(|_| {
                let (omega, delta) = (0.02 + 0.97 * rng.random::<f64>(), log_uniform(&mut rng, 0.02, 12.0));
                faces.shares(omega, 1.0 - omega, delta).response()
            })
            .collect();
        let ready = clock.elapsed();
        for (precision, noise, passes) in [
            (InversionPrecision::Fast, 1e-6, 20),
            (InversionPrecision::Fast, 5e-3, 20),
            (InversionPrecision::Exact, 1e-9, 1),
        ] {
            let clock = std::time::Instant::now();
            for _ in 0..passes {
                for r in &rows {
                    std::hint::black_box(invert_in(&model, precision, r.rho_d, r.rho_t, 1.0, noise, noise));
                }
            }
            let rate = (passes * rows.len()) as f64 / clock.elapsed().as_secs_f64();
            println!("n {index} {precision} at a noise of {noise:e}: {rate:.0} inversions/s");
        }
        println!("n {index}: model made in {made:?}, 2000 exact slabs in {:?}", ready - made);
    }
}
