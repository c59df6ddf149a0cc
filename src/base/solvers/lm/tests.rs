use super::*;
use crate::solvers::problem::ClosureProblem;

fn rosenbrock(p: &[f64], r: &mut [f64]) {
    r[0] = 10.0 * (p[1] - p[0] * p[0]);
    r[1] = 1.0 - p[0];
}

/// A decay with deterministic disturbances, for the error tests.
fn decay(p: &[f64], r: &mut [f64]) {
    for (i, r) in r.iter_mut().enumerate() {
        let t = i as f64 * 0.25;
        let data = 2.0 * (-0.6 * t).exp() + 0.01 * (1.7 * i as f64).sin();
        *r = p[0] * (-p[1] * t).exp() - data;
    }
}

#[test]
fn rosenbrock_is_solved_from_afar() {
    let problem = ClosureProblem::new(2, 2, rosenbrock);
    for start in [[-1.2, 1.0], [30.0, -700.0], [-50.0, 1e-4]] {
        let fit = minimize(&problem, &start, &Options::default());
        assert!(fit.converged(), "{start:?}: {:?}", fit.termination);
        assert!(
            (fit.params[0] - 1.0).abs() < 1e-9 && (fit.params[1] - 1.0).abs() < 1e-9,
            "{start:?}: {:?}",
            fit.params
        );
        assert!(fit.trace.windows(2).all(|w| w[1].cost <= w[0].cost && w[1].evaluations > w[0].evaluations));
    }
}

/// Compares standard errors with the scatter of fits to data with seeded noise, which is an independent way to the same
/// numbers.
#[test]
fn standard_errors_agree_with_the_scatter_of_repeated_fits() {
    use rand::RngExt;
    let mut rng = rand_pcg::Pcg64Mcg::new(7);
    let sigma = 0.02;
    let mut normal = move || {
        let (u, v): (f64, f64) = (rng.random(), rng.random());
        (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    };
    let runs = 1500;
    let (mut sum, mut squares, mut predicted) = ([0.0; 2], [0.0; 2], [0.0; 2]);
    for _ in 0..runs {
        let noise: Vec<f64> = (0..12).map(|_| sigma * normal()).collect();
        let problem = ClosureProblem::new(2, 12, |p: &[f64], r: &mut [f64]| {
            for (i, r) in r.iter_mut().enumerate() {
                let t = i as f64 * 0.25;
                *r = (p[0] * (-p[1] * t).exp() - 2.0 * (-0.6 * t).exp() - noise[i]) / sigma;
            }
        });
        let fit = minimize(&problem, &[1.0, 1.0], &Options { noise: ResidualNoise::Known, ..Options::default() });
        assert!(fit.converged());
        for k in 0..2 {
            let error = fit.params[k] - [2.0, 0.6][k];
            sum[k] += error;
            squares[k] += error * error;
            predicted[k] += fit.uncertainty.stderr[k] / f64::from(runs);
        }
    }
    for k in 0..2 {
        let scatter = (squares[k] / f64::from(runs)).sqrt();
        // The scatter of 1500 runs is itself known to 1/√3000 = 1.8 %; the limit is four times that.
        assert!(
            (scatter / predicted[k] - 1.0).abs() < 0.073,
            "parameter {k}: scatter {scatter}, predicted {}",
            predicted[k]
        );
        assert!(sum[k].abs() / f64::from(runs) < 0.15 * scatter);
    }
}

#[test]
fn a_redundant_parameter_is_named_and_has_no_error() {
    // Only the product of the first two parameters matters.
    let problem = ClosureProblem::new(3, 12, |p: &[f64], r: &mut [f64]| decay(&[p[0] * p[1], p[2]], r));
    let fit = minimize(&problem, &[1.0, 1.0, 1.0], &Options::default());
    assert!(fit.converged());
    assert_eq!((fit.uncertainty.rank, &fit.uncertainty.undetermined[..]), (2, &[0, 1][..]));
    assert!(fit.uncertainty.stderr[0].is_infinite() && fit.uncertainty.stderr[1].is_infinite());
    assert!(fit.uncertainty.condition.is_infinite());
    let plain = minimize(&ClosureProblem::new(2, 12, decay), &[1.0, 1.0], &Options::default());
    assert!((fit.params[2] - plain.params[1]).abs() < 1e-8);
    assert!((fit.uncertainty.stderr[2] / plain.uncertainty.stderr[1] - 1.0).abs() < 1e-5);
}

#[test]
fn models_without_values_or_slopes_fail_by_name_and_return_nothing() {
    let nan = ClosureProblem::new(1, 3, |_: &[f64], r: &mut [f64]| r.fill(f64::NAN));
    let flat = ClosureProblem::new(2, 3, |_: &[f64], r: &mut [f64]| r.fill(1.0));
    let empty = ClosureProblem::new(1, 0, |_: &[f64], _: &mut [f64]| {});
    let kink = ClosureProblem::new(1, 1, |p: &[f64], r: &mut [f64]| r[0] = 1.0 + p[0].abs().sqrt());
    let wrong_sign = ClosureProblem::new(1, 2, |p: &[f64], r: &mut [f64]| r.fill(p[0].exp()))
        .with_jacobian(|p: &[f64], j: &mut [f64]| j.fill(-p[0].exp()));
    for (name, fit, expected) in [
        ("nan", minimize(&nan, &[1.0], &Options::default()), Termination::NotFinite),
        ("flat", minimize(&flat, &[1.0, 2.0], &Options::default()), Termination::Flat),
        ("empty", minimize(&empty, &[1.0], &Options::default()), Termination::Refused),
        ("nan start", minimize(&kink, &[f64::NAN], &Options::default()), Termination::Refused),
        ("wrong sign", minimize(&wrong_sign, &[1.0], &Options::default()), Termination::NoProgress),
    ] {
        assert_eq!(fit.termination, expected, "{name}");
        assert!(fit.params.iter().all(|p| p.is_nan()), "{name} returned {:?}", fit.params);
        assert!(fit.uncertainty.stderr.iter().all(|s| s.is_infinite()), "{name}");
    }
}

#[test]
fn a_region_without_values_is_stepped_around() {
    // ln p has no value for p ≤ 0, and the first full step goes there.
    let problem = ClosureProblem::new(1, 1, |p: &[f64], r: &mut [f64]| r[0] = p[0].ln() + 3.0);
    let fit = minimize(&problem, &[4.0], &Options::default());
    assert!(fit.converged() && (fit.params[0] - (-3f64).exp()).abs() < 1e-10, "{fit:?}");
}

#[test]
fn bounds_hold_and_the_rest_is_still_optimal() {
    // The best solution with p0 ≥ 2.5: p1 minimises the remaining problem of one parameter.
    let problem = ClosureProblem::new(2, 12, decay);
    let options = Options { lower: vec![2.5, 0.0], upper: vec![10.0, 10.0], ..Options::default() };
    for start in [[3.0, 1.0], [9.0, 0.01], [2.5, 5.0]] {
        let fit = minimize(&problem, &start, &options);
        assert!(fit.converged(), "{start:?}: {:?}", fit.termination);
        assert_eq!(fit.at_bound, [0]);
        let alone = ClosureProblem::new(1, 12, |p: &[f64], r: &mut [f64]| decay(&[2.5, p[0]], r));
        let reference = minimize(&alone, &[1.0], &Options::default());
        assert!(
            (fit.params[1] - reference.params[0]).abs() < 1e-8,
            "{start:?}: {:?} against {:?}",
            fit.params,
            reference.params
        );
    }
    let crossed = Options { lower: vec![3.0, 0.0], upper: vec![2.0, 1.0], ..Options::default() };
    assert_eq!(minimize(&problem, &[1.0, 1.0], &crossed).termination, Termination::Refused);
}

#[test]
fn units_do_not_matter() {
    let plain = minimize(&ClosureProblem::new(2, 12, decay), &[1.0, 1.0], &Options::default());
    let scaled = ClosureProblem::new(2, 12, |p: &[f64], r: &mut [f64]| decay(&[p[0] * 1e-9, p[1] * 1e7], r));
    let fit = minimize(&scaled, &[1e9, 1e-7], &Options::default());
    assert!((fit.params[0] * 1e-9 / plain.params[0] - 1.0).abs() < 1e-9);
    assert!((fit.uncertainty.stderr[1] * 1e7 / plain.uncertainty.stderr[1] - 1.0).abs() < 1e-6);
    assert!((fit.uncertainty.condition / plain.uncertainty.condition - 1.0).abs() < 1e-5);
}

/// Residuals whose squares are too large or too small for doubles.
#[test]
fn the_size_of_the_residuals_does_not_matter() {
    let plain = minimize(&ClosureProblem::new(2, 12, decay), &[1.0, 1.0], &Options::default());
    for size in [1e-180, 1e180] {
        let scaled = ClosureProblem::new(2, 12, |p: &[f64], r: &mut [f64]| {
            decay(p, r);
            r.iter_mut().for_each(|r| *r *= size);
        });
        let fit = minimize(&scaled, &[1.0, 1.0], &Options::default());
        assert!(fit.converged(), "{size}: {:?}", fit.termination);
        assert!((fit.params[1] / plain.params[1] - 1.0).abs() < 1e-9, "{size}: {:?}", fit.params);
    }
}

#[test]
fn the_iteration_limit_is_told_and_gives_no_errors() {
    let fit = minimize(
        &ClosureProblem::new(2, 2, rosenbrock),
        &[-1.2, 1.0],
        &Options { max_iterations: 3, ..Options::default() },
    );
    assert_eq!(fit.termination, Termination::IterationLimit);
    assert!(fit.uncertainty.stderr.iter().all(|s| s.is_infinite()));
}
