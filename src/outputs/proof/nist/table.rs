//! All 54 runs with one set of options, and the resulting digits.

use super::models;
use super::reader::{self, NistDataset};
use crate::Result;
use crate::precise::{PreciseProblem, refined};
use crate::stress::StressRow;
use mesophyll_base::solvers::{Fit, Options, multi_start};
use std::time::Instant;

macro_rules! files {
    ($($name:literal),* $(,)?) => {
        [$(($name, include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/nist/", $name, ".dat")))),*]
    };
}

/// The 27 files, compiled into the program, from NIST's lower to its higher level of difficulty.
pub const FILES: [(&str, &str); 27] = files![
    "Misra1a", "Chwirut2", "Chwirut1", "Lanczos3", "Gauss1", "Gauss2", "DanWood", "Misra1b", "Kirby2", "Hahn1",
    "Nelson", "MGH17", "Lanczos1", "Lanczos2", "Gauss3", "Misra1c", "Misra1d", "Roszman1", "ENSO", "MGH09", "Thurber",
    "BoxBOD", "Rat42", "MGH10", "Eckerle4", "Rat43", "Bennett5",
];

/// A run counts as solved with more than this many digits in every parameter, as is usual for these problems.
pub(super) const SOLVED: f64 = 4.0;

/// One run: a problem from one of its starts.
#[derive(Debug, Clone)]
pub struct NistOutcome {
    /// The problem's name, as NIST has it.
    pub name: String,
    /// 1 or 2.
    pub start: usize,
    /// What the solver returned.
    pub fit: Fit,
    /// Fewest correct digits over the parameters.
    pub digits: f64,
    /// Fewest correct digits over the certified standard deviations.
    pub deviation_digits: f64,
    /// Correct digits of the residual standard deviation.
    pub residual_digits: f64,
    /// Run time (ms).
    pub ms: f64,
}

impl NistOutcome {
    /// Whether the run converged to the certified parameters.
    pub fn solved(&self) -> bool {
        self.fit.converged() && self.digits > SOLVED
    }

    /// `ok` where the parameters and the certified standard deviations are both right.
    pub fn verdict(&self) -> String {
        if !self.fit.converged() {
            format!("refused: {}", self.fit.termination.name())
        } else if !self.solved() {
            "missed: another minimum than the certified one".into()
        } else if self.deviation_digits.min(self.residual_digits) <= SOLVED {
            "missed: standard deviations".into()
        } else {
            "ok".into()
        }
    }
}

/// The problems as data.
///
/// # Errors
/// None for the files in the program; those of the reader if one is damaged.
pub fn datasets() -> Result<Vec<NistDataset>> {
    FILES.iter().map(|(name, text)| reader::parse(text, &format!("{name}.dat"))).collect()
}

/// Correct decimal digits of `value`, between 0 and 11.
pub fn digits(value: f64, certified: f64) -> f64 {
    let error = ((value - certified) / certified).abs();
    if error.is_nan() { 0.0 } else { (-error.log10()).clamp(0.0, 11.0) }
}

fn fewest(values: &[f64], certified: &[f64]) -> f64 {
    values.iter().zip(certified).map(|(v, c)| digits(*v, *c)).fold(11.0, f64::min)
}

/// How a run is solved from a start.
pub type NistSolver<'a> = &'a dyn Fn(&dyn PreciseProblem, &[f64]) -> Fit;

/// Runs every problem from both starts, by the same solver.
///
/// # Errors
/// As [`datasets`].
pub fn solve_all(solver: NistSolver) -> Result<Vec<NistOutcome>> {
    let mut outcomes = Vec::new();
    for set in datasets()? {
        let Some(problem) = models::problem(&set) else { continue };
        outcomes.extend((1..=2).map(|start| run(&set, problem.as_ref(), start, solver)));
    }
    Ok(outcomes)
}

/// Solves as users' fits are solved, then adds the last digits that double precision does not hold.
fn certified(problem: &dyn PreciseProblem, start: &[f64]) -> Fit {
    let options = Options::default();
    refined(problem, multi_start::minimize_scales(problem, start, &options), options.noise)
}

/// One problem from start 1 or 2.
pub(super) fn run(set: &NistDataset, problem: &dyn PreciseProblem, start: usize, solver: NistSolver) -> NistOutcome {
    let clock = Instant::now();
    let fit = solver(problem, &set.starts[start - 1]);
    let ms = clock.elapsed().as_secs_f64() * 1e3;
    NistOutcome {
        name: set.name.clone(),
        start,
        digits: fewest(&fit.params, &set.values),
        deviation_digits: fewest(&fit.uncertainty.stderr, &set.deviations),
        residual_digits: digits(fit.uncertainty.reduced_chi2.sqrt(), set.residual_deviation),
        fit,
        ms,
    }
}

/// The rows of `mesophyll stress nist`: every run must come to `ok`.
///
/// # Errors
/// As [`datasets`].
pub fn stress() -> Result<Vec<StressRow>> {
    let row = |o: NistOutcome| StressRow {
        model: "nist".into(),
        case: format!("{} start {}", o.name, o.start),
        expected: "ok".into(),
        verdict: o.verdict(),
        digits: Some(o.digits),
        condition: Some(o.fit.uncertainty.condition),
        ms: o.ms,
    };
    Ok(solve_all(&certified)?.into_iter().map(row).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_base::solvers::jacobian;

    /// The goal for the solver: all 54 runs solved with at least 10 digits on average, and the certified standard
    /// deviations as well.
    #[test]
    fn all_27_problems_from_both_starts() {
        let all = solve_all(&certified).unwrap();
        assert_eq!(all.len(), 54);
        for o in &all {
            let run = format!("{} from start {}", o.name, o.start);
            assert_eq!((o.verdict().as_str(), o.fit.uncertainty.rank), ("ok", o.fit.params.len()), "{run}");
            assert!(o.deviation_digits > 9.0, "{run}: {} digits of the standard deviations", o.deviation_digits);
            assert!(o.residual_digits > 9.0, "{run}: {} digits of the residual standard deviation", o.residual_digits);
        }
        let mean = all.iter().map(|o| o.digits).sum::<f64>() / 54.0;
        assert!(mean >= 10.0, "{mean} digits on average");
    }

    /// The digits do not depend on one lucky trust radius: any first radius leads to them, by the retries of the same
    /// strategy.
    #[test]
    fn other_first_radii_solve_all_but_a_few() {
        for initial_radius in [0.1, 100.0] {
            let options = Options { initial_radius, ..Options::default() };
            let all = solve_all(&|p, start| multi_start::minimize_scales(p, start, &options)).unwrap();
            let missed: Vec<String> =
                all.iter().filter(|o| !o.solved()).map(|o| format!("{} {}", o.name, o.start)).collect();
            assert!(missed.is_empty(), "radius {initial_radius}: {missed:?}");
        }
    }

    #[test]
    fn derivatives_of_all_models_agree_with_differences_at_the_certified_values() {
        for set in datasets().unwrap() {
            let problem = models::problem(&set).unwrap();
            let found = jacobian::check(problem.as_ref(), &set.values).unwrap();
            assert!(found.worst < 1e-6, "{}: {found:?}", set.name);
        }
    }

    /// The certified values also check the formulas: their sum of squares must be the certified one.
    #[test]
    fn certified_values_reproduce_the_certified_sum_of_squares() {
        for set in datasets().unwrap() {
            let problem = models::problem(&set).unwrap();
            let mut r = vec![0.0; problem.residuals()];
            problem.evaluate(&set.values, &mut r);
            let sum: f64 = r.iter().map(|v| v * v).sum();
            // Lanczos1 fits to 1e-13, so the eleven printed digits of its parameters are too few for its residuals.
            if set.name != "Lanczos1" {
                assert!(
                    (sum / set.sum_of_squares - 1.0).abs() < 1e-8,
                    "{}: {sum} against {}",
                    set.name,
                    set.sum_of_squares
                );
            }
        }
    }

    #[test]
    fn digits_are_counted_honestly() {
        assert_eq!(digits(1.0, 1.0), 11.0);
        assert!((digits(1.0 + 1e-5, 1.0) - 5.0).abs() < 1e-6);
        assert_eq!(digits(f64::NAN, 1.0), 0.0);
        assert_eq!(digits(f64::INFINITY, 1.0), 0.0);
        assert_eq!(digits(300.0, 1.0), 0.0);
    }
}
