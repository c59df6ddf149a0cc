//! All 54 runs with one set of options, and the digits that came out.

use super::models;
use super::parse::{self, Dataset};
use crate::Result;
use crate::fit::stress::StressRow;
use crate::solve::{Fit, Options, global};
use std::time::Instant;

macro_rules! files {
    ($($name:literal),* $(,)?) => { [$(($name, include_str!(concat!("../../../data/nist/", $name, ".dat")))),*] };
}

/// The 27 files, carried in the program: from NIST's lower to its higher level of difficulty.
const FILES: [(&str, &str); 27] = files![
    "Misra1a", "Chwirut2", "Chwirut1", "Lanczos3", "Gauss1", "Gauss2", "DanWood", "Misra1b", "Kirby2", "Hahn1", "Nelson", "MGH17",
    "Lanczos1", "Lanczos2", "Gauss3", "Misra1c", "Misra1d", "Roszman1", "ENSO", "MGH09", "Thurber", "BoxBOD", "Rat42", "MGH10", "Eckerle4",
    "Rat43", "Bennett5",
];

/// Solved: more than this many digits in every parameter, as is usual for these problems.
const SOLVED: f64 = 4.0;

/// One run: a problem from one of its starts.
#[derive(Debug, Clone)]
pub struct Outcome {
    pub name: String,
    pub level: String,
    /// 1 or 2.
    pub start: usize,
    pub fit: Fit,
    /// Fewest correct digits over the parameters.
    pub digits: f64,
    /// Fewest correct digits over the certified standard deviations.
    pub deviation_digits: f64,
    /// Correct digits of the residual standard deviation.
    pub residual_digits: f64,
    pub ms: f64,
}

impl Outcome {
    pub fn solved(&self) -> bool {
        self.fit.converged() && self.digits > SOLVED
    }
}

/// The problems as data.
///
/// # Errors
/// None for the files carried in the program; the reader's, should one be damaged.
pub fn datasets() -> Result<Vec<Dataset>> {
    FILES.iter().map(|(name, text)| parse::parse(text, &format!("{name}.dat"))).collect()
}

/// Correct decimal digits of `value`, between 0 and 11.
pub fn digits(value: f64, certified: f64) -> f64 {
    let error = ((value - certified) / certified).abs();
    if error.is_nan() { 0.0 } else { (-error.log10()).clamp(0.0, 11.0) }
}

fn fewest(values: &[f64], certified: &[f64]) -> f64 {
    values.iter().zip(certified).map(|(v, c)| digits(*v, *c)).fold(11.0, f64::min)
}

/// Runs every problem from both starts. The options are the same for all; only the starts differ.
///
/// # Errors
/// As [`datasets`].
pub fn solve_all(options: &Options) -> Result<Vec<Outcome>> {
    let mut outcomes = Vec::new();
    for set in datasets()? {
        let Some(problem) = models::problem(&set) else { continue };
        for (k, start) in set.starts.iter().enumerate() {
            let clock = Instant::now();
            let fit = global::minimize_scales(problem.as_ref(), start, options);
            let ms = clock.elapsed().as_secs_f64() * 1e3;
            outcomes.push(Outcome {
                name: set.name.clone(),
                level: set.level.clone(),
                start: k + 1,
                digits: fewest(&fit.params, &set.values),
                deviation_digits: fewest(&fit.uncertainty.stderr, &set.deviations),
                residual_digits: digits(fit.uncertainty.reduced_chi2.sqrt(), set.residual_deviation),
                fit,
                ms,
            });
        }
    }
    Ok(outcomes)
}

/// The rows of `mesophyll stress nist`: every run must come to `ok`.
///
/// # Errors
/// As [`datasets`].
pub fn stress() -> Result<Vec<StressRow>> {
    let row = |o: Outcome| StressRow {
        model: "nist".into(),
        case: format!("{} start {}", o.name, o.start),
        expected: "ok".into(),
        verdict: if o.solved() { "ok".into() } else { format!("missed: {}", o.fit.termination.name()) },
        digits: Some(o.digits),
        condition: Some(o.fit.uncertainty.condition),
        ms: o.ms,
    };
    Ok(solve_all(&Options::default())?.into_iter().map(row).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn explore() {
        for max_iterations in [500] {
            for radius in [100.0, 10.0, 1.0, 0.1, 0.01] {
                let all = solve_all(&Options { max_iterations, initial_radius: radius, ..Options::default() }).unwrap();
                let mean = all.iter().map(|o| o.digits).sum::<f64>() / 54.0;
                println!(
                    "evals {}  radius {radius} mean {mean} solved {}",
                    all.iter().map(|o| o.fit.evaluations).sum::<usize>(),
                    all.iter().filter(|o| o.solved()).count()
                );
                for o in &all {
                    if o.fit.evaluations > 400 || !o.solved() {
                        println!(
                            "{:10} {} {:5.2} {:5.2} {:5.2} {:?} it {} ev {} {:?} cond {:.1e} {:.2} ms",
                            o.name,
                            o.start,
                            o.digits,
                            o.deviation_digits,
                            o.residual_digits,
                            o.fit.termination,
                            o.fit.trace.len(),
                            o.fit.evaluations,
                            o.fit.refined,
                            o.fit.uncertainty.condition,
                            o.ms
                        );
                    }
                }
            }
        }
    }
}
