//! Error against run time for the solver's own knobs, on the 54 NIST runs.

use super::models;
use super::table::{Outcome, SOLVED, Solver, datasets, run};
use crate::Result;
use crate::bench::BenchRow;
use mesophyll_solve::{Dd, Options, Problem, global, lm};

/// Rows for every knob of the solver: iterations, cost tolerance, first trust radius, derivatives, refinement. The
/// error of a setting is 10^−(mean correct digits over the 54 runs); its time is the median run's.
///
/// # Errors
/// As [`datasets`].
pub fn bench_rows() -> Result<Vec<BenchRow>> {
    let plain = || Options { refine: false, ..Options::default() };
    let mut rows = Vec::new();
    for max_iterations in [3, 5, 8, 12, 20, 50, 200] {
        let all = sweep(&Options { max_iterations, ..plain() }, false, lm::minimize)?;
        rows.push(row("iterations at most", max_iterations.to_string(), &all));
    }
    for tolerance in [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14] {
        let options = Options { cost_tolerance: tolerance, step_tolerance: tolerance, ..plain() };
        rows.push(row("tolerance", format!("{tolerance:e}"), &sweep(&options, false, lm::minimize)?));
    }
    for initial_radius in [0.01, 0.1, 1.0, 10.0, 100.0] {
        rows.push(row(
            "first trust radius",
            initial_radius.to_string(),
            &sweep(&Options { initial_radius, ..plain() }, false, lm::minimize)?,
        ));
    }
    rows.push(row("derivatives", "numeric".into(), &sweep(&plain(), true, lm::minimize)?));
    rows.push(row("derivatives", "forward mode".into(), &sweep(&plain(), false, lm::minimize)?));
    rows.push(row("refinement", "none".into(), &sweep(&plain(), false, lm::minimize)?));
    rows.push(row("refinement", "double-double".into(), &sweep(&Options::default(), false, lm::minimize)?));
    for (setting, solver) in [("one descent", lm::minimize as Solver), ("until sound", global::minimize_scales)] {
        let options = Options { initial_radius: 100.0, ..plain() };
        rows.push(row("descents from a radius of 100", setting.into(), &sweep(&options, false, solver)?));
    }
    Ok(rows)
}

fn row(knob: &str, setting: String, all: &[Outcome]) -> BenchRow {
    let count = all.len() as f64;
    let mean = all.iter().map(|o| o.digits).sum::<f64>() / count;
    let deviations = all.iter().map(|o| o.deviation_digits).sum::<f64>() / count;
    let solved = all.iter().filter(|o| o.digits > SOLVED).count();
    let mut times: Vec<f64> = all.iter().map(|o| o.ms * 1e3).collect();
    times.sort_by(f64::total_cmp);
    BenchRow {
        model: "solve".into(),
        knob: knob.into(),
        setting,
        error: 10f64.powf(-mean),
        us: times.get(times.len() / 2).copied().unwrap_or(f64::NAN),
        note: format!("NIST: {solved} of {} solved, {mean:.2} digits, standard deviations {deviations:.2}", all.len()),
    }
}

fn sweep(options: &Options, numeric: bool, solver: Solver) -> Result<Vec<Outcome>> {
    let mut all = Vec::new();
    for set in datasets()? {
        let Some(problem) = models::problem(&set) else { continue };
        let bare = WithoutDerivatives(problem.as_ref());
        for start in 1..=2 {
            all.push(run(&set, if numeric { &bare } else { problem.as_ref() }, start, options, solver));
        }
    }
    Ok(all)
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
    fn refined(&self, params: &[Dd], residuals: &mut [Dd], jacobian: &mut [Dd]) -> bool {
        self.0.refined(params, residuals, jacobian)
    }
}
