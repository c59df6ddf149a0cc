use super::*;
use mesophyll_optics::slab;

/// A leaf of known σ with thickness and albedo that vary, and noise where asked.
pub fn leaf(n: usize, noise: f64, seed: u64) -> (Vec<LeafWideTexel>, [[f64; 2]; 3], Vec<f64>, f64) {
    use rand::{RngExt, SeedableRng};
    let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
    let sigma = [[9.0, 18.0], [2.6, 16.0], [22.0, 21.0]];
    let t: Vec<f64> = (0..n).map(|k| 0.2 * (1.0 + 0.35 * (k as f64 * 0.7).sin())).collect();
    let h = t.iter().sum::<f64>() / n as f64;
    let mut gamma: Vec<Rgb> = (0..n).map(|k| Rgb::of(|c| 1.0 + 0.2 * (k as f64 * (0.3 + c as f64)).cos())).collect();
    for c in 0..3 {
        let mean = gamma.iter().map(|g| g[c]).sum::<f64>() / n as f64;
        gamma.iter_mut().for_each(|g| g[c] /= mean);
    }
    let mut normal = || {
        let (a, b): (f64, f64) = (rng.random(), rng.random());
        (-2.0 * a.max(1e-300).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    };
    let texels = (0..n)
        .map(|k| {
            let mut x = LeafWideTexel { rho_t_floor: Rgb::splat(1e-9), ..LeafWideTexel::default() };
            for c in 0..3 {
                let r = slab::medium::response(sigma[c][0], sigma[c][1], t[k]);
                let d = gamma[k][c] * r.rho_d;
                x.rho_d_err[c] = (noise * d).max(1e-9);
                x.rho_d[c] = d + noise * d * normal();
                x.rho_t[c] = r.rho_t + (noise * r.rho_t) * normal();
            }
            x
        })
        .collect();
    (texels, sigma, t, h)
}

fn settings(h: f64, noise: f64) -> LeafWideSettings {
    LeafWideSettings {
        h,
        incidence: Incidence(1.0),
        relative: noise.max(1e-6),
        robust: true,
        iterations: 60,
        common: LeafSharedErrors::default(),
    }
}

#[test]
fn noise_free_leaves_are_recovered() {
    let (texels, sigma, t, h) = leaf(3000, 0.0, 1);
    let wide = fit(&texels, &[], Rgb([[6.0, 12.0], [4.0, 12.0], [15.0, 30.0]]), &settings(h, 0.0));
    assert!(wide.termination.converged(), "{:?} {:#?}", wide.termination, wide.trace);
    for c in 0..3 {
        assert!((wide.sigma_a[c] / sigma[c][0] - 1.0).abs() < 2e-4, "{:?} {:?}", wide.sigma_a, sigma);
        assert!((wide.sigma_s[c] / sigma[c][1] - 1.0).abs() < 2e-4, "{:?} {:?}", wide.sigma_s, sigma);
    }
    for (l, t) in wide.locals.iter().zip(&t) {
        assert!((l.thickness / t - 1.0).abs() < 5e-4);
    }
}

#[test]
fn errors_cover_the_truth() {
    let (mut inside, mut total, mut delta_inside, mut delta_total) = (0, 0, 0, 0);
    for seed in 0..24 {
        let (texels, sigma, t, h) = leaf(600, 0.02, 100 + seed);
        let wide = fit(&texels, &[], Rgb([[6.0, 12.0], [4.0, 12.0], [15.0, 30.0]]), &settings(h, 0.02));
        for c in 0..3 {
            for k in 0..2 {
                let found = if k == 0 { wide.sigma_a[c] } else { wide.sigma_s[c] };
                let sd = wide.covariance[(2 * c + k, 2 * c + k)].sqrt();
                total += 1;
                inside += usize::from((found / sigma[c][k]).ln().abs() < 1.96 * sd);
            }
        }
        for (l, t) in wide.locals.iter().zip(&t) {
            delta_total += 1;
            delta_inside += usize::from((l.thickness - t).abs() < 1.96 * l.thickness_err);
        }
    }
    let share = inside as f64 / total as f64;
    assert!((0.88..=1.0).contains(&share), "{inside} of {total}");
    let share = delta_inside as f64 / delta_total as f64;
    assert!((0.93..=0.97).contains(&share), "{delta_inside} of {delta_total}");
}

/// A channel that lets nothing through tells only the ratio of σa to σs. Both are infinitely uncertain; the other
/// channels' are not.
#[test]
fn a_lost_direction_is_not_a_certain_one() {
    let (mut texels, sigma, _, h) = leaf(400, 0.01, 5);
    let settings = settings(h, 0.01);
    for x in &mut texels {
        x.rho_t_floor = Rgb::splat(5e-4);
        x.rho_t[2] = 0.0;
    }
    let wide = fit(&texels, &[], Rgb([[9.0, 18.0], [2.6, 16.0], [110.0, 105.0]]), &settings);
    let relative = |k: usize| wide.covariance[(k, k)].sqrt();
    assert!(relative(4).is_infinite() && relative(5).is_infinite(), "{:?}", wide.covariance);
    assert!((0..4).all(|k| relative(k) < 0.05), "{:?}", wide.covariance);
    assert!((wide.sigma_a[1] / sigma[1][0]).ln().abs() < 4.0 * relative(2));
    assert_eq!(wide.rank, 5);
}
