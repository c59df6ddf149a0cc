use super::*;
use crate::optics::gloss::Lobe;
use rand::{RngExt, SeedableRng};

pub fn device(lobe: Lobe, noise: f64) -> Device {
    let c = 55f64.to_radians();
    Device {
        height_mm: 100.0,
        length_mm: 500.0,
        radius_mm: 2.5,
        camera: [c.sin(), 0.0, c.cos()],
        lobe,
        noise_relative: noise,
        noise_floor: 5e-4,
    }
}

pub fn positions(from: f64, to: f64, n: usize) -> Vec<f64> {
    (0..n).map(|k| from + (to - from) * k as f64 / (n - 1) as f64).collect()
}

pub struct Truth {
    pub rho_d: [f64; 3],
    pub rho_s: [f64; 3],
    pub m: f64,
    pub tilt: [f64; 2],
}

/// A normal deviate.
pub fn gauss(rng: &mut rand_pcg::Pcg64) -> f64 {
    let (a, b): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (2.0 * std::f64::consts::PI * b).cos()
}

pub fn trace(
    model: &Model,
    d: &Device,
    travel: Travel,
    xs: &[f64],
    texel: [f64; 2],
    t: &Truth,
    rng: Option<&mut rand_pcg::Pcg64>,
) -> Vec<[f32; 3]> {
    let n = normal_of(t.tilt);
    let mut out: Vec<[f64; 3]> = xs
        .iter()
        .map(|&x| {
            let r = model.response(travel, x, texel, n, t.m);
            std::array::from_fn(|c| t.rho_d[c] * r.d + t.rho_s[c] * r.s)
        })
        .collect();
    if let Some(rng) = rng {
        for v in out.iter_mut().flatten() {
            *v += gauss(rng) * ((d.noise_relative * *v).powi(2) + d.noise_floor.powi(2)).sqrt();
        }
    }
    out.into_iter().map(|v| v.map(|x| x as f32)).collect()
}

#[test]
fn exact_traces_give_back_the_truth() {
    for lobe in [Lobe::Beckmann, Lobe::Ggx, Lobe::CookTorrance { index: 1.45 }] {
        let d = device(lobe, 0.01);
        let (xs, ys) = (positions(-400.0, 250.0, 100), positions(-325.0, 325.0, 100));
        let fine = Model::new(d.tube(), d.camera, lobe, &Precision { along: 24, across: 8 });
        let (one, two) = (TexelFitter::new(&d, &xs, None), TexelFitter::new(&d, &xs, Some(&ys)));
        for (m, tilt, texel) in [(0.1, [0.05, 0.0], [0.0, 0.0]), (0.3, [-0.1, 0.12], [20.0, -15.0]), (0.05, [0.12, -0.2], [-30.0, 22.0])] {
            let t = Truth { rho_d: [0.06, 0.14, 0.03], rho_s: [0.05, 0.05, 0.06], m, tilt };
            let tx = trace(&fine, &d, Travel::X, &xs, texel, &t, None);
            let ty = trace(&fine, &d, Travel::Y, &ys, texel, &t, None);
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
        let xs = positions(-400.0, 250.0, 100);
        let fitter = TexelFitter::new(&d, &xs, None);
        let mut ws = fitter.workspace();
        let fine = Model::new(d.tube(), d.camera, d.lobe, &Precision { along: 16, across: 6 });
        let mut rng = rand_pcg::Pcg64::seed_from_u64(7);
        let (mut fails, mut inside, mut total, mut ratio, mut evals, mut flagged) = (0, [0usize; 4], 0usize, vec![], 0, 0);
        let mut time = std::time::Duration::ZERO;
        for _ in 0..2000 {
            let mut u = |a: f64, b: f64| a + (b - a) * rng.random::<f64>();
            let t = Truth {
                rho_d: [u(0.02, 0.3), u(0.05, 0.4), u(0.02, 0.2)],
                rho_s: {
                    let s = u(0.01, 0.1);
                    [s, s * 1.1, s * 0.9]
                },
                m: if hard { u(f64::ln(ms[0]), f64::ln(ms[1])).exp() } else { u(ms[0], ms[1]) },
                tilt: [u(-tilt, tilt), 0.0],
            };
            let tx = trace(&fine, &d, Travel::X, &xs, [0.0, 0.0], &t, Some(&mut rng));
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
#[ignore = "figures"]
fn probe() {
    let d = device(Lobe::Beckmann, 0.02);
    let xs = positions(-400.0, 250.0, 100);
    let fitter = TexelFitter::new(&d, &xs, None);
    let fine = Model::new(d.tube(), d.camera, d.lobe, &Precision { along: 16, across: 6 });
    for (m, tilt) in [(0.682, -0.029), (0.801, -0.003), (0.73, -0.11), (0.78, 0.035), (0.6, 0.124)] {
        let t = Truth { rho_d: [0.1, 0.15, 0.08], rho_s: [0.06; 3], m, tilt: [tilt, 0.0] };
        let mut rng = rand_pcg::Pcg64::seed_from_u64(9);
        let tx = trace(&fine, &d, Travel::X, &xs, [0.0, 0.0], &t, Some(&mut rng));
        let mut ws = fitter.workspace();
        let passes: Vec<(&Pass, &[[f32; 3]])> = vec![(&fitter.passes[0], &tx[..])];
        ws.load(&passes);
        let mut job = Job {
            fitter: &fitter,
            ws: &mut ws,
            texel: [0.0; 2],
            passes: vec![&fitter.passes[0]],
            evaluations: 0,
            iterations: 0,
            matte: false,
        };
        job.weigh_by_samples();
        job.start(0);
        let mut all = vec![];
        fitter.passes[0].bank.best([0.0; 2], &job.ws.sum.clone(), &job.ws.sum_w.clone(), 8, &mut all);
        println!(
            "truth m {m} tilt {tilt}: starts {:?}",
            all.iter().map(|s| (s.m, (s.tilt * 1e3).round() / 1e3, s.cost.round())).collect::<Vec<_>>()
        );
        let truth = job.evaluate([m.ln(), tilt, 0.0]);
        job.weigh_by_model(&truth);
        let truth = job.evaluate([m.ln(), tilt, 0.0]);
        println!("   chi2 at truth {:.1}", truth.chi2);
        for s in all.iter().take(6) {
            job.iterations = 0;
            let (r, why) = job.solve([s.m.ln(), s.tilt, 0.0], 1e-5);
            println!(
                "   from {:.2} {:.3}: m {:.3} tilt {:.3} chi2 {:.1} its {} {why:?} rho {:.3} {:.3}",
                s.m,
                s.tilt,
                r.p[0].exp(),
                r.p[1],
                r.chi2,
                job.iterations,
                r.linear[1].rho_d,
                r.linear[1].rho_s
            );
        }
    }
}
