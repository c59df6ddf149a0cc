use super::*;
use crate::fit::gloss::synthetic::{Noise, Truth, device, pass_x, ramp, trace};
use crate::optics::gloss::Lobe;

#[test]
fn exact_traces_give_back_the_truth() {
    for lobe in [Lobe::Beckmann, Lobe::Ggx, Lobe::CookTorrance { index: 1.45 }] {
        let d = device(lobe, 0.01);
        let (xs, ys) = (pass_x(100), ramp(-325.0, 325.0, 100));
        let (one, two) = (TexelFitter::new(&d, &xs, None), TexelFitter::new(&d, &xs, Some(&ys)));
        for (m, tilt, texel) in [(0.1, [0.05, 0.0], [0.0, 0.0]), (0.3, [-0.1, 0.12], [20.0, -15.0]), (0.05, [0.12, -0.2], [-30.0, 22.0])] {
            let t = Truth { rho_d: [0.06, 0.14, 0.03], rho_s: [0.05, 0.05, 0.06], m, tilt };
            let tx = trace(&d, Travel::X, &xs, texel, &t, None);
            let ty = trace(&d, Travel::Y, &ys, texel, &t, None);
            let f = two.fit(&mut two.workspace(), texel, &tx, Some(&ty));
            println!("{lobe:?} {m}: {f:.5?}");
            assert!((f.m - m).abs() < 2e-3 * m, "{f:?}");
            assert!((f.tilt[0] - tilt[0]).abs() < 1e-4 && (f.tilt[1] - tilt[1]).abs() < 1e-4, "{f:?}");
            for c in 0..3 {
                assert!((f.rho_d[c] / t.rho_d[c] - 1.0).abs() < 1e-3 && (f.rho_s[c] / t.rho_s[c] - 1.0).abs() < 2e-3, "{f:?}");
            }
            if tilt[1] == 0.0 {
                let f = one.fit(&mut one.workspace(), texel, &tx, None);
                assert!((f.m - m).abs() < 2e-3 * m && (f.tilt[0] - tilt[0]).abs() < 1e-4, "{f:?}");
                assert!(f.tilt_err[1].is_infinite() && f.normal_err[1].is_infinite());
            }
        }
    }
}

#[test]
#[ignore = "statistics over many texels, for figures"]
fn statistics() {
    for (noise, ms, tilt, hard) in [(0.01, [0.05, 0.5], 0.1, false), (0.02, [0.03, 0.9], 0.1745, true)] {
        let d = device(Lobe::Beckmann, noise);
        let xs = pass_x(100);
        let fitter = TexelFitter::new(&d, &xs, None);
        let mut ws = fitter.workspace();
        let mut rng = Noise::new(7);
        let (mut fails, mut inside, mut total, mut ratio, mut evals, mut flagged) = (0, [0usize; 4], 0usize, vec![], 0, 0);
        let mut time = std::time::Duration::ZERO;
        for _ in 0..2000 {
            let mut u = |a: f64, b: f64| rng.uniform(a, b);
            let t = Truth {
                rho_d: [u(0.02, 0.3), u(0.05, 0.4), u(0.02, 0.2)],
                rho_s: {
                    let s = u(0.01, 0.1);
                    [s, s * 1.1, s * 0.9]
                },
                m: if hard { u(f64::ln(ms[0]), f64::ln(ms[1])).exp() } else { u(ms[0], ms[1]) },
                tilt: [u(-tilt, tilt), 0.0],
            };
            let tx = trace(&d, Travel::X, &xs, [0.0, 0.0], &t, Some(&mut rng));
            let clock = std::time::Instant::now();
            let f = fitter.fit(&mut ws, [0.0, 0.0], &tx, None);
            time += clock.elapsed();
            total += 1;
            evals += f.evaluations;
            let z = [
                (f.m - t.m) / f.m_err,
                (f.tilt[0] - t.tilt[0]) / f.tilt_err[0],
                (f.rho_d[1] - t.rho_d[1]) / f.rho_d_err[1],
                (f.rho_s[1] - t.rho_s[1]) / f.rho_s_err[1],
            ];
            for k in 0..4 {
                inside[k] += usize::from(z[k].abs() < 1.96);
            }
            ratio.push(z[0].abs());
            if !f.undetermined.is_empty() {
                flagged += 1;
            }
            if !f.termination.converged() || z.iter().any(|v| v.is_nan() || v.abs() > 6.0) {
                fails += 1;
                println!(
                    "z {z:.1?} m {:.3} tilt {:.3} rs {:.3} rd {:.3}: {:?} m {:.3}±{:.3} tilt {:.3} chi2r {:.2} {:?} {:?}",
                    t.m,
                    t.tilt[0],
                    t.rho_s[1],
                    t.rho_d[1],
                    f.termination,
                    f.m,
                    f.m_err,
                    f.tilt[0],
                    f.reduced_chi2(),
                    f.undetermined.names(3),
                    f.defect
                );
            }
        }
        ratio.sort_by(f64::total_cmp);
        println!(
            "noise {noise}: {fails} failures of {total}; coverage {:?}; median |z_m|/.6745 {:.3}; {:.1} evaluations; {flagged} flagged; {:.1} us",
            inside.map(|i| i as f64 / total as f64),
            ratio[total / 2] / 0.6745,
            evals as f64 / total as f64,
            time.as_secs_f64() * 1e6 / total as f64
        );
    }
}

#[test]
fn a_common_level_widens_errors_by_what_it_does() {
    let d = device(Lobe::Beckmann, 0.01);
    let (xs, ys) = (pass_x(80), ramp(-325.0, 325.0, 80));
    let mut fitter = TexelFitter::new(&d, &xs, Some(&ys));
    let texel = [8.0, -5.0];
    let t = Truth { rho_d: [0.06, 0.14, 0.03], rho_s: [0.05, 0.05, 0.06], m: 0.3, tilt: [0.05, -0.08] };
    let (tx, ty) = (trace(&d, Travel::X, &xs, texel, &t, None), trace(&d, Travel::Y, &ys, texel, &t, None));
    let plain = fitter.fit(&mut fitter.workspace(), texel, &tx, Some(&ty));
    let level = 2e-4f32;
    fitter.offset = f64::from(level);
    let widened = fitter.fit(&mut fitter.workspace(), texel, &tx, Some(&ty));
    // What each channel's level really moves, fitted again.
    let mut moved = [0.0; 5];
    for c in 0..3 {
        let raise = |trace: &[[f32; 3]]| -> Vec<[f32; 3]> {
            trace
                .iter()
                .map(|s| {
                    let mut s = *s;
                    s[c] += level;
                    s
                })
                .collect()
        };
        let f = fitter.fit(&mut fitter.workspace(), texel, &raise(&tx), Some(&raise(&ty)));
        let now =
            [f.rho_d[0] - plain.rho_d[0], f.rho_s[0] - plain.rho_s[0], f.m - plain.m, f.tilt[0] - plain.tilt[0], f.tilt[1] - plain.tilt[1]];
        for (sum, d) in moved.iter_mut().zip(now) {
            *sum += d * d;
        }
    }
    let added = |wide: f64, narrow: f64| (wide * wide - narrow * narrow).sqrt();
    let found = [
        added(widened.rho_d_err[0], plain.rho_d_err[0]),
        added(widened.rho_s_err[0], plain.rho_s_err[0]),
        added(widened.m_err, plain.m_err),
        added(widened.tilt_err[0], plain.tilt_err[0]),
        added(widened.tilt_err[1], plain.tilt_err[1]),
    ];
    for (k, (found, moved)) in found.into_iter().zip(moved).enumerate() {
        assert!((found / moved.sqrt() - 1.0).abs() < 0.1, "{k}: {found} {}", moved.sqrt());
    }
}
