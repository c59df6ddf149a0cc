//! Beyond one descent: trust radii of several scales, several starts, and which minima they agree on.
//!
//! Every descent is [`lm::minimize`]. Population methods (particle swarm, annealing) are not offered: for smooth least
//! squares each of their thousands of evaluations is better spent on a descent from one more start, which also ends on
//! the minimum instead of near it.

use super::lm::{self, Fit, Options};
use super::problem::Problem;

/// First trust radii that [`minimize_scales`] tries in turn, times [`Options::initial_radius`]. Too long a radius may
/// lead to a plateau, too short a one may end in the nearest local minimum.
const SCALES: [f64; 4] = [1.0, 100.0, 0.01, 10.0];

/// Whether a fit may be used as it is: it converged, with every parameter determined.
pub fn is_sound(fit: &Fit) -> bool {
    fit.converged() && fit.uncertainty.undetermined.is_empty() && fit.params.iter().all(|p| p.is_finite())
}

/// [`lm::minimize`], tried again with other trust radii where it did not converge or left parameters undetermined.
///
/// Returns the first sound fit ([`is_sound`]). Where there is none, it returns the converged fit of least cost; where
/// nothing converged, the first try. `evaluations` counts all tries; the trace is that of the returned fit.
pub fn minimize_scales(problem: &dyn Problem, start: &[f64], options: &Options) -> Fit {
    let mut evaluations = 0;
    let mut best: Option<Fit> = None;
    for scale in SCALES {
        let options = Options { initial_radius: scale * options.initial_radius, ..options.clone() };
        let fit = lm::minimize(problem, start, &options);
        evaluations += fit.evaluations;
        if is_sound(&fit) {
            return Fit { evaluations, ..fit };
        }
        best = Some(match best {
            Some(old) if old.converged() && !(fit.converged() && fit.cost < old.cost) => old,
            Some(old) if !old.converged() && !fit.converged() => old,
            _ => fit,
        });
    }
    match best {
        Some(fit) => Fit { evaluations, ..fit },
        None => lm::minimize(problem, start, options),
    }
}

/// One minimum that some of the starts ended in.
#[derive(Debug, Clone, PartialEq)]
pub struct Minimum {
    /// ½ Σ r² there.
    pub cost: f64,
    /// Where it is.
    pub params: Vec<f64>,
    /// How many starts ended here.
    pub hits: usize,
}

/// What several starts came to.
#[derive(Debug, Clone, PartialEq)]
pub struct MultiStart {
    /// The fit of least cost; `evaluations` counts all starts.
    pub best: Fit,
    /// Which start it came from.
    pub start: usize,
    /// Distinct minima by rising cost. If the best one was hit only once among many starts, there may be better ones.
    pub minima: Vec<Minimum>,
    /// Starts that did not converge.
    pub failed: usize,
}

/// Descends from each start and keeps the best. `None` for no starts.
///
/// Two ends are the same minimum when their costs agree to 1e-6 and their parameters to 1e-3, relatively. Ties go to
/// the earlier start, so that the result does not depend on anything but the arguments.
pub fn multi_start(problem: &dyn Problem, starts: &[Vec<f64>], options: &Options) -> Option<MultiStart> {
    let mut result: Option<MultiStart> = None;
    let (mut evaluations, mut failed) = (0, 0);
    let mut minima: Vec<Minimum> = Vec::new();
    for (index, start) in starts.iter().enumerate() {
        let fit = lm::minimize(problem, start, options);
        evaluations += fit.evaluations;
        if fit.converged() {
            let close = |a: f64, b: f64, tolerance: f64| (a - b).abs() <= tolerance * a.abs().max(b.abs());
            let same = |m: &&mut Minimum| {
                close(m.cost, fit.cost, 1e-6) && m.params.iter().zip(&fit.params).all(|(a, b)| close(*a, *b, 1e-3))
            };
            match minima.iter_mut().find(same) {
                Some(known) => known.hits += 1,
                None => minima.push(Minimum { cost: fit.cost, params: fit.params.clone(), hits: 1 }),
            }
        } else {
            failed += 1;
        }
        let better = result.as_ref().is_none_or(|r| {
            let (new, old) = (fit.converged(), r.best.converged());
            new && !old || new == old && fit.cost < r.best.cost
        });
        if better {
            result = Some(MultiStart { best: fit, start: index, minima: Vec::new(), failed: 0 });
        }
    }
    minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    result.map(|r| MultiStart { best: Fit { evaluations, ..r.best }, minima, failed, ..r })
}

/// `count` starts that fill a box evenly: the Owen-scrambled Sobol sequence of `seed`. `None` for more than 65,536
/// points or 256 parameters, and for bounds that are not finite, crossed, or of different lengths.
pub fn starts_in_box(lower: &[f64], upper: &[f64], count: usize, seed: u32) -> Option<Vec<Vec<f64>>> {
    let usable =
        lower.len() == upper.len() && lower.iter().zip(upper).all(|(l, u)| l.is_finite() && u.is_finite() && l <= u);
    if !usable || lower.len() > 256 || count > 1 << 16 {
        return None;
    }
    let coordinate = |i: usize, k: usize| {
        let t = f64::from(sobol_burley::sample(i as u32, k as u32, seed));
        lower[k] + t * (upper[k] - lower[k])
    };
    Some((0..count).map(|i| (0..lower.len()).map(|k| coordinate(i, k)).collect()).collect())
}

#[cfg(test)]
mod tests {
    use super::super::problem::ClosureProblem;
    use super::*;

    /// A sine of unknown frequency: there is a minimum at about every half cycle over the record, and one of them is
    /// right.
    fn sine(p: &[f64], r: &mut [f64]) {
        for (i, r) in r.iter_mut().enumerate() {
            let t = i as f64 * 0.1;
            *r = p[0] * (p[1] * t).sin() - 1.5 * (7.3 * t).sin();
        }
    }

    #[test]
    fn starts_across_a_box_find_the_frequency_that_one_start_misses() {
        let problem = ClosureProblem::new(2, 60, sine);
        let options = Options { lower: vec![0.1, 0.5], upper: vec![5.0, 12.0], ..Options::default() };
        let one = lm::minimize(&problem, &[1.0, 3.0], &options);
        assert!((one.params[1] - 7.3).abs() > 1.0);
        let starts = starts_in_box(&options.lower, &options.upper, 48, 1).unwrap();
        let found = multi_start(&problem, &starts, &options).unwrap();
        assert!((found.best.params[1] - 7.3).abs() < 1e-9 && (found.best.params[0] - 1.5).abs() < 1e-9);
        assert!(found.minima.len() > 2 && found.minima[0].hits >= 2, "{:?}", found.minima);
        assert!(found.minima.windows(2).all(|w| w[0].cost <= w[1].cost));
        assert_eq!(found.minima.iter().map(|m| m.hits).sum::<usize>() + found.failed, 48);
        assert_eq!(multi_start(&problem, &starts, &options).unwrap().start, found.start);
    }

    #[test]
    fn starts_fill_the_box_and_bad_boxes_are_refused() {
        let starts = starts_in_box(&[-1.0, 10.0], &[1.0, 20.0], 64, 3).unwrap();
        assert!(starts.iter().all(|s| (-1.0..=1.0).contains(&s[0]) && (10.0..=20.0).contains(&s[1])));
        // A Sobol set of 64 has exactly 16 points in each quarter of each axis.
        for quarter in 0..4 {
            let inside = starts.iter().filter(|s| ((s[0] + 1.0) * 2.0) as usize == quarter).count();
            assert_eq!(inside, 16);
        }
        assert!(starts_in_box(&[0.0], &[f64::INFINITY], 4, 0).is_none());
        assert!(starts_in_box(&[1.0], &[0.0], 4, 0).is_none());
        assert!(starts_in_box(&[0.0], &[1.0, 2.0], 4, 0).is_none());
    }

    /// A start on the far side of a plateau: the first radius lands where the exponential has vanished, another radius
    /// does not.
    #[test]
    fn another_radius_rescues_a_start_that_ends_on_a_plateau() {
        let data = [109.0, 149.0, 149.0, 191.0, 213.0, 224.0];
        let times = [1.0, 2.0, 3.0, 5.0, 7.0, 10.0];
        let problem = ClosureProblem::new(2, 6, |p: &[f64], r: &mut [f64]| {
            for i in 0..6 {
                r[i] = p[0] * (1.0 - (-p[1] * times[i]).exp()) - data[i];
            }
        });
        let far = Options { initial_radius: 100.0, ..Options::default() };
        assert!(!is_sound(&lm::minimize(&problem, &[1.0, 1.0], &far)));
        let fit = minimize_scales(&problem, &[1.0, 1.0], &far);
        assert!(is_sound(&fit) && (fit.params[1] - 0.547_237_485_42).abs() < 1e-7, "{:?}", fit.params);
        let flat = ClosureProblem::new(1, 2, |_: &[f64], r: &mut [f64]| r.fill(1.0));
        assert!(minimize_scales(&flat, &[1.0], &far).params[0].is_nan());
    }
}
