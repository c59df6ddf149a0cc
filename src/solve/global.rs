//! Search beyond one descent.

use super::lm::{self, Fit, Options};
use super::problem::Problem;

pub fn minimize_scales(problem: &dyn Problem, start: &[f64], options: &Options) -> Fit {
    lm::minimize(problem, start, options)
}
