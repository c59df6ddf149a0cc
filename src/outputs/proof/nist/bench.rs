//! Error against run time for the solver's own knobs, on the 54 NIST runs.

use super::loops;
use super::table::{NistOutcome, SOLVED, solve_all};
use crate::Result;
use crate::bench::BenchRow;
use crate::precise::refined;
use mesophyll_base::solvers::{Options, Problem, lm, multi_start};
use mesophyll_base::statistics::median_of;

/// Rows for every knob of the solver: iterations, cost tolerance, first trust radius, derivatives, refinement. The
/// error of a setting is 10^−(mean correct digits over the 54 runs); its time is the median run's.
///
/// # Errors
/// As [`datasets`].
pub fn bench_rows() -> Result<Vec<BenchRow>> {
    let plain = Options::default();
    let with = |options: Options| solve_all(&|problem, start| lm::minimize(problem, start, &options));
    let standard = with(plain.clone())?;
    let mut rows = Vec::new();
    for max_iterations in [3, 5, 8, 12, 20, 50, 200] {
        let all = with(Options { max_iterations, ..plain.clone() })?;
        rows.push(row("iterations at most", max_iterations.to_string(), &all));
    }
    for tolerance in [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14] {
        let options = Options { cost_tolerance: tolerance, step_tolerance: tolerance, ..plain.clone() };
        rows.push(row("tolerance", format!("{tolerance:e}"), &with(options)?));
    }
    for initial_radius in [0.01, 0.1, 1.0, 10.0, 100.0] {
        let all = with(Options { initial_radius, ..plain.clone() })?;
        rows.push(row("first trust radius", initial_radius.to_string(), &all));
    }
    let numeric = solve_all(&|problem, start| lm::minimize(&WithoutDerivatives(problem), start, &plain))?;
    rows.push(row("derivatives", "numeric".into(), &numeric));
    rows.push(row("derivatives", "forward mode".into(), &standard));
    rows.push(row("refinement", "none".into(), &standard));
    let precise = solve_all(&|problem, start| refined(problem, lm::minimize(problem, start, &plain), plain.noise))?;
    rows.push(row("refinement", "double-double".into(), &precise));
    let far = Options { initial_radius: 100.0, ..plain.clone() };
    rows.push(row("descents from a radius of 100", "one descent".into(), &with(far.clone())?));
    let scales = solve_all(&|problem, start| multi_start::minimize_scales(problem, start, &far))?;
    rows.push(row("descents from a radius of 100", "until sound".into(), &scales));
    rows.push(row("loop", "trust region".into(), &standard));
    for (name, solver) in loops::LOOPS {
        rows.push(row("loop", name.into(), &solve_all(&|problem, start| solver(problem, start))?));
    }
    Ok(rows)
}

fn row(knob: &str, setting: String, all: &[NistOutcome]) -> BenchRow {
    let count = all.len() as f64;
    let mean = all.iter().map(|o| o.digits).sum::<f64>() / count;
    let deviations = all.iter().map(|o| o.deviation_digits).sum::<f64>() / count;
    let solved = all.iter().filter(|o| o.digits > SOLVED).count();
    BenchRow {
        model: "solve".into(),
        knob: knob.into(),
        setting,
        error: 10f64.powf(-mean),
        us: median_of(all.iter().map(|o| o.ms * 1e3)).unwrap_or(f64::NAN),
        note: format!("NIST: {solved} of {} solved, {mean:.2} digits, standard deviations {deviations:.2}", all.len()),
    }
}

/// The same residuals with the derivatives held back, so that the solver must difference.
struct WithoutDerivatives<'a>(&'a dyn Problem);

impl Problem for WithoutDerivatives<'_> {
    fn parameters(&self) -> usize {
        self.0.parameters()
    }
    fn residuals(&self) -> usize {
        self.0.residuals()
    }
    fn evaluate(&self, params: &[f64], out: &mut [f64]) {
        self.0.evaluate(params, out);
    }
}
