use super::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

fn normal(rng: &mut Pcg64) -> f64 {
    let (a, b): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
}

/// Columns 1, x, x², … for even x in [−1, 1].
fn powers(m: usize, n: usize) -> Vec<f64> {
    (0..n).flat_map(|j| (0..m).map(move |i| (2.0 * i as f64 / (m - 1) as f64 - 1.0).powi(j as i32))).collect()
}

/// Parameters and residuals of a linear fit, by the normal equations.
fn fitted(y: &[f64], jacobian: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let m = y.len();
    let j = DMatrix::from_column_slice(m, jacobian.len() / m, jacobian);
    let y = nalgebra::DVector::from_column_slice(y);
    let p = (j.transpose() * &j).cholesky().unwrap().solve(&(j.transpose() * &y));
    let r = y - &j * &p;
    (p.iter().copied().collect(), r.iter().copied().collect())
}

fn judged(r: &[f64], jacobian: &[f64], noise: ResidualNoise) -> Adequacy {
    let along = [ReadingOrder { name: "place", runs: vec![(0..r.len()).collect()] }];
    judge(&SolutionResiduals { residuals: r, jacobian, noise, floor: 0.0, along: &along })
}

/// The rule promises to accuse one right model in a thousand; of 4,000 at most 12 are then accused by chance with a
/// probability above 99.9 %.
#[test]
fn a_right_model_is_hardly_ever_accused() {
    for noise in [ResidualNoise::Known, ResidualNoise::Estimated] {
        for (m, n) in [(12, 3), (30, 6), (200, 5)] {
            let jacobian = powers(m, n);
            let mut rng = Pcg64::seed_from_u64(7);
            let accused = (0..4000)
                .filter(|_| {
                    let y: Vec<f64> = (0..m).map(|_| normal(&mut rng)).collect();
                    !judged(&fitted(&y, &jacobian).1, &jacobian, noise).describes()
                })
                .count();
            assert!(accused <= 12, "{noise:?} {m} {n}: {accused}");
        }
    }
}

/// A straight line is fitted to a parabola that bends by six times the noise.
#[test]
fn a_wrong_model_is_accused_with_and_without_a_stated_noise() {
    let m = 40;
    let jacobian = powers(m, 2);
    let mut rng = Pcg64::seed_from_u64(3);
    for noise in [ResidualNoise::Known, ResidualNoise::Estimated] {
        for _ in 0..50 {
            let y: Vec<f64> = powers(m, 3)[2 * m..].iter().map(|x| 6.0 * x + normal(&mut rng)).collect();
            let found = judged(&fitted(&y, &jacobian).1, &jacobian, noise);
            assert!(!found.describes() && found.widening.iter().all(|w| *w >= 1.0), "{found:?}");
            assert!(found.why("leaf").unwrap().starts_with("the model does not describe this leaf: "));
        }
    }
    let loud: Vec<f64> = (0..m).map(|_| 3.0 * normal(&mut rng)).collect();
    let found = judged(&fitted(&loud, &jacobian).1, &jacobian, ResidualNoise::Known);
    assert!(matches!(found.findings[..], [Finding::Excess(times)] if (2.0..4.0).contains(&times)), "{found:?}");
    assert!(judged(&fitted(&loud, &jacobian).1, &jacobian, ResidualNoise::Estimated).describes());
}

/// Readings that are nearer to the model than their noise are no fault of the model, whatever their pattern.
#[test]
fn a_noise_that_is_overstated_is_said_and_no_fault() {
    let m = 60;
    let jacobian = powers(m, 2);
    let smooth: Vec<f64> = (0..m).map(|i| 0.01 * (i as f64 / 5.0).sin()).collect();
    let found = judged(&fitted(&smooth, &jacobian).1, &jacobian, ResidualNoise::Known);
    assert!(found.describes() && found.overstated, "{found:?}");
    let along = [ReadingOrder { name: "place", runs: vec![(0..m).collect()] }];
    let r = fitted(&smooth, &jacobian).1;
    let rounding = SolutionResiduals {
        residuals: &r,
        jacobian: &jacobian,
        noise: ResidualNoise::Estimated,
        floor: 0.1,
        along: &along,
    };
    assert!(judge(&rounding).describes() && !judge(&SolutionResiduals { floor: 0.0, ..rounding }).describes());
    let broken = judge(&SolutionResiduals { residuals: &[f64::NAN, 1.0], jacobian: &[1.0, 1.0], ..rounding });
    assert_eq!(broken.findings, [Finding::NotFinite]);
}

/// Residuals that are an autoregression: the widened errors hold the truth, the plain ones do not.
#[test]
fn widened_errors_hold_the_truth_where_residuals_are_correlated() {
    let (m, rho) = (200usize, 0.9f64);
    let jacobian = powers(m, 3);
    let basis = Basis::new(&jacobian, m, 3).unwrap();
    let mut rng = Pcg64::seed_from_u64(11);
    let (mut plain, mut wide, runs) = (0, 0, 300);
    for _ in 0..runs {
        let mut e = normal(&mut rng);
        let y: Vec<f64> = (0..m)
            .map(|_| {
                e = rho * e + (1.0 - rho * rho).sqrt() * normal(&mut rng);
                e
            })
            .collect();
        let (p, r) = fitted(&y, &jacobian);
        let found = judged(&r, &jacobian, ResidualNoise::Known);
        let error = basis.variances[0].sqrt();
        plain += usize::from(p[0].abs() < 1.96 * error);
        wide += usize::from(p[0].abs() < 1.96 * error * found.widening[0]);
    }
    let share = |n: usize| n as f64 / runs as f64;
    assert!(share(plain) < 0.6 && (0.9..=0.99).contains(&share(wide)), "{plain} {wide} of {runs}");
}

#[test]
fn scores_and_quantiles_are_those_of_tables() {
    // Upper 0.1 % and 2.5 % of the normal distribution; upper 0.1 % of χ² with 10 and 100 degrees of freedom.
    assert!((normal_quantile(1e-3) - 3.0902).abs() < 1e-3 && (normal_quantile(0.025) - 1.95996).abs() < 1e-3);
    for (chi2, freedom) in [(29.588, 10.0), (149.449, 100.0)] {
        assert!((chi2_score(chi2, freedom) - 3.0902).abs() < 0.03, "{}", chi2_score(chi2, freedom));
    }
}

/// Two channels that agree with each other are two runs: no pattern along either.
#[test]
fn runs_are_apart_and_a_parameter_that_is_not_determined_stays_so() {
    let m = 30;
    let mut jacobian = powers(m, 2);
    jacobian.extend(powers(m, 2)[m..].to_vec());
    let mut rng = Pcg64::seed_from_u64(5);
    let y: Vec<f64> = (0..m).map(|_| normal(&mut rng)).collect();
    let r = fitted(&y, &powers(m, 2)).1;
    let found = judged(&r, &jacobian, ResidualNoise::Known);
    assert_eq!((found.freedom, found.widening.len()), (m - 2, 3));
    assert_eq!(ReadingOrder::sorted("angle", &[3.0, 1.0, 2.0]).runs, [vec![1, 2, 0]]);
}
