//! The solver's own stiff and extreme cases: problems that belong to no model, each with the verdict that it must get.

use crate::precise::{DoubleDouble, PreciseModel, PreciseModelProblem, PreciseReal, refined};
use crate::stress::StressRow;
use mesophyll_base::solvers::qr::MatrixScalar;
use mesophyll_base::solvers::{ClosureProblem, Fit, Options, Problem, ResidualNoise, linear_algebra, lm};
use nalgebra::DMatrix;
use std::time::Instant;

/// What a fit may be used for: `ok` where every relative standard error is at most 10 %; `undetermined: b1 b3`
/// (numbered from 1) where some are larger; `refused: ` and the reason where nothing was fitted.
pub fn verdict(fit: &Fit) -> String {
    if !fit.converged() {
        return format!("refused: {}", fit.termination.name());
    }
    let known = |k: &usize| fit.uncertainty.stderr[*k] <= 0.1 * fit.params[*k].abs();
    let unknown: Vec<String> = (0..fit.params.len()).filter(|k| !known(k)).map(|k| format!("b{}", k + 1)).collect();
    if unknown.is_empty() { "ok".into() } else { format!("undetermined: {}", unknown.join(" ")) }
}

/// A case: the verdict that it must get, and the right answer where there is one (NaN for parameters without one).
struct Case {
    name: &'static str,
    expected: &'static str,
    truth: Vec<f64>,
    solve: Box<dyn Fn() -> Fit>,
}

fn case(name: &'static str, expected: &'static str, truth: &[f64], solve: impl Fn() -> Fit + 'static) -> Case {
    Case { name, expected, truth: truth.to_vec(), solve: Box::new(solve) }
}

/// Correct digits of the worst parameter that has a right answer, at most 16.
fn digits(fit: &Fit, truth: &[f64]) -> Option<f64> {
    let each = fit.params.iter().zip(truth).filter(|(_, t)| t.is_finite());
    each.map(|(p, t)| {
        let error = if *t == 0.0 { p.abs() } else { (p / t - 1.0).abs() };
        if error.is_nan() { 0.0 } else { (-error.log10()).clamp(0.0, 16.0) }
    })
    .reduce(f64::min)
}

/// Runs the table.
pub fn stress() -> Vec<StressRow> {
    cases()
        .into_iter()
        .map(|case| {
            let clock = Instant::now();
            let fit = (case.solve)();
            let ms = clock.elapsed().as_secs_f64() * 1e3;
            StressRow {
                model: "solve".into(),
                case: case.name.into(),
                expected: case.expected.into(),
                verdict: verdict(&fit),
                digits: digits(&fit, &case.truth),
                condition: Some(fit.uncertainty.condition),
                ms,
            }
        })
        .collect()
}

fn minimize(problem: &dyn Problem, start: &[f64]) -> Fit {
    lm::minimize(problem, start, &Options::default())
}

/// Amplitude and rate of a decay at 20 times, without noise: the residuals vanish at (2, 0.6).
fn decay(p: &[f64], r: &mut [f64]) {
    for (i, r) in r.iter_mut().enumerate() {
        let t = i as f64 * 0.25;
        *r = p[0] * (-p[1] * t).exp() - 2.0 * (-0.6 * t).exp();
    }
}

/// A polynomial of degree 9 on [0, 1], in powers: column-scaled condition about 1e7.
struct Powers;

impl PreciseModel<10> for Powers {
    fn residuals(&self) -> usize {
        30
    }
    fn residual<T: PreciseReal>(&self, p: &[T; 10], index: usize) -> T {
        let x = T::precise(DoubleDouble::constant(index as f64) / DoubleDouble::constant(29.0));
        let value = |coefficients: &[T]| coefficients.iter().rev().fold(T::zero(), |s, c| s * x + *c);
        let truth: [T; 10] = std::array::from_fn(|k| T::constant(1.0 + k as f64));
        value(p) - value(&truth)
    }
}

/// The matrix with the entries 1/(i + j + 1), and the right side for which every coefficient is 1.
fn hilbert(n: usize) -> Fit {
    let a = DMatrix::from_fn(n + 6, n, |i, j| 1.0 / (i + j + 1) as f64);
    let b: Vec<f64> = (0..n + 6).map(|i| a.row(i).sum()).collect();
    linear_algebra::solve(&a, &b, &[], ResidualNoise::Estimated)
}

fn cases() -> Vec<Case> {
    let none = f64::NAN;
    vec![
        case("zero residual", "ok", &[2.0, 0.6], || minimize(&ClosureProblem::new(2, 20, decay), &[1.0, 1.0])),
        case("only a product matters", "undetermined: b1 b2", &[none, none, 0.6], || {
            minimize(
                &ClosureProblem::new(3, 20, |p: &[f64], r: &mut [f64]| decay(&[p[0] * p[1], p[2]], r)),
                &[1.0, 1.0, 1.0],
            )
        }),
        case("a parameter that does nothing", "undetermined: b3", &[2.0, 0.6, none], || {
            minimize(&ClosureProblem::new(3, 20, |p: &[f64], r: &mut [f64]| decay(&p[..2], r)), &[1.0, 1.0, 7.0])
        }),
        case("rate of a vanished amplitude", "undetermined: b1 b2", &[0.0, none], || {
            let gone = |p: &[f64], r: &mut [f64]| {
                for (i, r) in r.iter_mut().enumerate() {
                    *r = p[0] * (-p[1] * i as f64 * 0.25).exp() / 0.01;
                }
            };
            lm::minimize(
                &ClosureProblem::new(2, 20, gone),
                &[1.0, 1.0],
                &Options { noise: ResidualNoise::Known, ..Options::default() },
            )
        }),
        case("dependent columns", "undetermined: b2 b3", &[1.0, none, none], || {
            let a = DMatrix::from_fn(6, 3, |i, j| [1.0, i as f64, 2.0 * i as f64][j]);
            linear_algebra::solve(
                &a,
                &(0..6).map(|i| 1.0 + 4.0 * f64::from(i)).collect::<Vec<_>>(),
                &[],
                ResidualNoise::Estimated,
            )
        }),
        case("Hilbert 8, condition 1e9", "ok", &[1.0; 8], || hilbert(8)),
        case("Hilbert 14, beyond double precision", HILBERT_14, &[none; 14], || hilbert(14)),
        case(
            "polynomial of degree 9 in powers, refined",
            "ok",
            &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0],
            || {
                refined(
                    &PreciseModelProblem(Powers),
                    minimize(&PreciseModelProblem(Powers), &[0.0; 10]),
                    ResidualNoise::Estimated,
                )
            },
        ),
        case("units of 1e-200 and 1e150", "ok", &[2e-200, 0.6e150], || {
            minimize(
                &ClosureProblem::new(2, 20, |p: &[f64], r: &mut [f64]| decay(&[p[0] * 1e200, p[1] * 1e-150], r)),
                &[1e-200, 1e150],
            )
        }),
        case("steep: exp(300 b) = 2 from b = 1", "ok", &[2f64.ln() / 300.0], || {
            let steep = |p: &[f64], r: &mut [f64]| r.fill((300.0 * p[0]).exp() - 2.0);
            minimize(&ClosureProblem::new(1, 2, steep), &[1.0])
        }),
        case("no value left of zero", "ok", &[(-3f64).exp()], || {
            let guarded = |p: &[f64], r: &mut [f64]| r.fill(p[0].ln() + 3.0);
            minimize(&ClosureProblem::new(1, 2, guarded), &[4.0])
        }),
        case("bound in the way", "ok", &[1.0, 0.6], || {
            // The first parameter would go to 5, the second to 0.6.
            let pulled = |p: &[f64], r: &mut [f64]| {
                for (i, r) in r.iter_mut().enumerate() {
                    *r = if i < 2 { 100.0 * (p[0] - 5.0) } else { i as f64 * (p[1] - 0.6) };
                }
            };
            let options = Options {
                lower: vec![0.0, 0.0],
                upper: vec![1.0, 10.0],
                noise: ResidualNoise::Known,
                ..Options::default()
            };
            lm::minimize(&ClosureProblem::new(2, 21, pulled), &[0.5, 2.0], &options)
        }),
        case("as many residuals as parameters", "undetermined: b1 b2", &[2.0, 0.6], || {
            minimize(&ClosureProblem::new(2, 2, decay), &[1.0, 1.0])
        }),
        case("fewer residuals than parameters", "undetermined: b1 b2", &[none; 2], || {
            minimize(&ClosureProblem::new(2, 1, decay), &[1.0, 1.0])
        }),
        case("model is NaN", "refused: not_finite", &[], || {
            minimize(&ClosureProblem::new(2, 5, |_: &[f64], r: &mut [f64]| r.fill(f64::NAN)), &[1.0, 1.0])
        }),
        case("model overflows at the start", "refused: not_finite", &[], || {
            minimize(&ClosureProblem::new(1, 5, |p: &[f64], r: &mut [f64]| r.fill((1e4 * p[0]).exp())), &[1.0])
        }),
        case("model is constant", "refused: flat", &[], || {
            minimize(&ClosureProblem::new(2, 5, |_: &[f64], r: &mut [f64]| r.fill(1.0)), &[1.0, 1.0])
        }),
        case("start on a saddle: b² = 1 from b = 0", "refused: flat", &[], || {
            let square = |p: &[f64], r: &mut [f64]| r.fill(p[0] * p[0] - 1.0);
            minimize(
                &ClosureProblem::new(1, 2, square).with_jacobian(|p: &[f64], j: &mut [f64]| j.fill(2.0 * p[0])),
                &[0.0],
            )
        }),
        case("derivatives of the wrong sign", "refused: no_progress", &[], || {
            let up = |p: &[f64], r: &mut [f64]| r.fill(p[0].exp());
            minimize(
                &ClosureProblem::new(1, 2, up).with_jacobian(|p: &[f64], j: &mut [f64]| j.fill(-p[0].exp())),
                &[1.0],
            )
        }),
        case("start is NaN", "refused: refused", &[], || {
            minimize(&ClosureProblem::new(2, 20, decay), &[f64::NAN, 1.0])
        }),
        case("no data", "refused: refused", &[], || minimize(&ClosureProblem::new(2, 0, decay), &[1.0, 1.0])),
    ]
}

/// Two directions are undetermined, and every coefficient takes part in them.
const HILBERT_14: &str = "undetermined: b1 b2 b3 b4 b5 b6 b7 b8 b9 b10 b11 b12 b13 b14";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_case_gets_the_verdict_it_expects() {
        for row in stress() {
            println!("{:50} {:40} {:?} {:?}", row.case, row.verdict, row.digits, row.condition);
            assert_eq!(row.verdict, row.expected, "{}", row.case);
            if row.expected == "ok" {
                // At least half of the digits of double precision, or those that the condition number leaves.
                let promised = 8.0_f64.min(15.0 - row.condition.unwrap_or(1.0).log10());
                assert!(row.digits.unwrap_or(0.0) > promised, "{}: {:?} digits", row.case, row.digits);
            }
        }
    }
}
