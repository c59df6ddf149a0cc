//! Branches that were pulled and let go.

use super::*;

/// ẍ + γẋ + ω²x = 0 from a place and a speed, by Runge and Kutta's steps: none of the fit's formulas.
fn let_go(f: f64, gamma: f64, start: [f64; 2], step: f64, n: usize) -> Vec<f64> {
    let omega2 = (TAU * f).powi(2);
    let slope = |s: [f64; 2]| [s[1], -gamma * s[1] - omega2 * s[0]];
    let sub = 20;
    let h = step / f64::from(sub);
    let mut state = start;
    (0..n)
        .map(|_| {
            let out = state[0];
            for _ in 0..sub {
                let at = |k: [f64; 2], by: f64| [state[0] + by * k[0], state[1] + by * k[1]];
                let a = slope(state);
                let b = slope(at(a, 0.5 * h));
                let c = slope(at(b, 0.5 * h));
                let d = slope(at(c, h));
                for i in 0..2 {
                    state[i] += h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]);
                }
            }
            out
        })
        .collect()
}

fn noisy(mut readings: Vec<f64>, noise: f64, seed: u64) -> Vec<f64> {
    let mut rng = Pcg64::seed_from_u64(seed);
    readings.iter_mut().for_each(|r| *r += 7.0 + noise * normal(&mut rng));
    readings
}

fn record(step: f64, channels: Vec<Vec<f64>>) -> MotionRecord {
    MotionRecord { step, channels, ..MotionRecord::default() }
}

#[test]
fn a_branch_let_go_is_found_within_its_errors() {
    let mut pulls = Vec::new();
    for seed in 0..24u64 {
        let mut rng = Pcg64::seed_from_u64(900 + seed);
        let f = 0.6 + 2.0 * rng.random::<f64>();
        let ratio = 0.015 + 0.15 * rng.random::<f64>();
        let gamma = ratio * 2.0 * TAU * f;
        let one = |start, seed| noisy(let_go(f, gamma, start, 0.04, 500), 0.2, seed);
        let mut channels = vec![one([30.0, 40.0], seed)];
        if seed % 2 == 1 {
            channels.push(one([-5.0, 20.0], 700 + seed));
        }
        let found = fit(&record(0.04, channels), &MotionPrior::default()).unwrap();
        assert!(found.kind == MotionKind::FreeDecay && found.status.is_ok(), "{f} {ratio}: {found:?}");
        assert!(found.gains.is_empty() && found.deviance.is_nan());
        let pull = |v: MotionEstimate, truth: f64| (v.value - truth) / v.error;
        pulls.push([pull(found.resonance, f), pull(found.damping, gamma), pull(found.ratio, ratio)]);
    }
    for k in 0..3 {
        let mean = pulls.iter().map(|p| p[k]).sum::<f64>() / 24.0;
        let rms = (pulls.iter().map(|p| p[k] * p[k]).sum::<f64>() / 24.0).sqrt();
        // With 24 pulls, the mean scatters by .2 and the root mean square by .14.
        assert!(mean.abs() < 0.7 && (0.6..1.5).contains(&rms), "{k}: {mean} {rms}");
    }
}

/// What is no single damped oscillation is not promised: two modes, a drag that grows with the speed's square, gusts
/// while it decays, one that hardly moves.
#[test]
fn other_decays_are_not_called_found() {
    let one = |f: f64, gamma: f64, size: f64| let_go(f, gamma, [size, 0.0], 0.05, 600);
    let modes: Vec<f64> = one(1.2, 0.5, 30.0).iter().zip(one(1.9, 0.5, 8.0)).map(|(a, b)| a + b).collect();
    let (mut x, mut v) = (30.0f64, 0.0f64);
    let mut dragged = Vec::new();
    for k in 0..600 * 200 {
        if k % 200 == 0 {
            dragged.push(x);
        }
        v += 0.000_25 * (-(TAU * 1.2f64).powi(2) * x - 0.2 * v - 0.005 * v.abs() * v);
        x += 0.000_25 * v;
    }
    let pushed: Vec<f64> =
        one(1.2, 0.5, 30.0).iter().zip(stepped(1.2, 0.5, 30.0, 0.05, 600, 3)).map(|(a, b)| a + b).collect();
    for (name, motion) in [("modes", modes), ("drag", dragged), ("gusts", pushed)] {
        let found = fit(&record(0.05, vec![noisy(motion, 0.05, 1)]), &MotionPrior::default()).unwrap();
        assert!(found.status.leaves_open("damping_per_s"), "{name}: {found:?}");
    }
}

/// The kind can be stated, and what is stated wrongly is noticed.
#[test]
fn a_kind_that_is_stated_is_taken_and_judged() {
    let decay = record(0.05, vec![noisy(let_go(1.2, 0.75, [30.0, 0.0], 0.05, 600), 0.05, 1)]);
    let gusts = record(0.05, vec![stepped(1.3, 3.0, 30.0, 0.05, 8192, 1)]);
    for (record, right, wrong) in
        [(&decay, MotionKind::FreeDecay, MotionKind::Gusts), (&gusts, MotionKind::Gusts, MotionKind::FreeDecay)]
    {
        let taken = |kind: MotionKind| fit(record, &MotionPrior { kind, ..MotionPrior::default() }).unwrap();
        let [auto, stated, other] = [MotionKind::Auto, right, wrong].map(taken);
        assert!(auto.kind == right && auto.status.is_ok(), "{auto:?}");
        assert_eq!((stated.kind, stated.resonance), (right, auto.resonance));
        assert!(other.kind == wrong && other.status.leaves_open("resonance_hz"), "{other:?}");
    }
}

/// A hand that holds the branch before it lets go, and a level that drifts meanwhile.
#[test]
fn the_release_and_drift_are_found() {
    let swing = let_go(1.2, 0.75, [30.0, 0.0], 0.05, 500);
    let held: Vec<f64> = std::iter::repeat_n(30.0, 90).chain(swing.iter().copied()).collect();
    let found = fit(&record(0.05, vec![noisy(held, 0.1, 4)]), &MotionPrior::default()).unwrap();
    assert!(found.status.is_ok() && found.taken_out.iter().any(|t| t.contains("before the release")), "{found:?}");
    assert!((found.damping.value - 0.75).abs() < 4.0 * found.damping.error, "{found:?}");
    let drifting: Vec<f64> = swing.iter().enumerate().map(|(k, u)| u + 0.02 * k as f64).collect();
    let found = fit(&record(0.05, vec![noisy(drifting, 0.1, 5)]), &MotionPrior::default()).unwrap();
    assert!(found.status.is_ok() && found.taken_out.iter().any(|t| t.contains("drift")), "{found:?}");
    assert!((found.damping.value - 0.75).abs() < 4.0 * found.damping.error, "{found:?}");
}
