//! Designs whose best sets are known, or can be looked for among all.

use super::*;

/// A polynomial of degree `degree`, read anywhere on [−1, 1] with the same error.
fn polynomial(degree: usize, candidates: usize, error: f64) -> DesignProblem {
    let names = (0..=degree).map(|k| format!("c{k}"));
    let parameters = names.map(|name| DesignParameter { name, known: 1e3, wanted: true }).collect();
    let at = |k: usize| -1.0 + 2.0 * k as f64 / (candidates - 1) as f64;
    let rows = (0..candidates).map(|k| (0..=degree as i32).map(|d| at(k).powi(d) / error).collect()).collect();
    let situations = vec![DesignSituation { values: vec![1.0; degree + 1], rows }];
    DesignProblem { aim: DesignAim::Parameters, parameters, situations, taken: Vec::new() }
}

/// A straight line is known best from its two ends (Elfving 1952); the error of the slope has a closed form.
#[test]
fn a_line_is_read_at_its_ends() {
    let line = polynomial(1, 41, 0.1);
    let best = line.choose(6).unwrap();
    assert!(best.chosen.iter().all(|k| *k < 3 || *k > 37), "{:?}", best.chosen);
    // Σ (x − mean)² of three at either end, and n.
    let at = |k: &usize| -1.0 + *k as f64 / 20.0;
    let mean = best.chosen.iter().map(at).sum::<f64>() / 6.0;
    let spread: f64 = best.chosen.iter().map(|k| (at(k) - mean).powi(2)).sum();
    assert!((best.errors[1] / (0.1 / spread.sqrt()) - 1.0).abs() < 1e-6, "{:?}", best.errors);
}

/// Every set of five of eleven is looked at: the exchange finds the best, and the bound is below it.
#[test]
fn no_set_is_better_and_the_bound_holds() {
    let parabola = polynomial(2, 11, 0.05);
    let found = parabola.choose(5).unwrap();
    let mut least = f64::INFINITY;
    for set in 0u32..1 << 11 {
        if set.count_ones() == 5 {
            let chosen: Vec<usize> = (0..11).filter(|k| set >> k & 1 == 1).collect();
            least = least.min(parabola.judge(&chosen).unwrap().ratio);
        }
    }
    assert!((found.ratio / least - 1.0).abs() < 1e-9, "{} {least}", found.ratio);
    let bound = parabola.best_possible(5).unwrap();
    assert!(bound <= least && bound > 0.9 * least, "{bound} {least}");
}

/// What is predicted of a line best is what its ends tell: the mean variance of predictions is that of Var(c0) +
/// Var(c1) · mean x².
#[test]
fn predictions_of_a_line_have_the_variance_of_its_parameters() {
    let mut line = polynomial(1, 21, 0.1);
    line.aim = DesignAim::Predictions;
    let (all, some) = (line.covariance_of(0, &evenly(21, 21)).unwrap(), line.covariance_of(0, &[0, 10, 20]).unwrap());
    let mean_square = (0..21).map(|k| (f64::from(k) / 10.0 - 1.0).powi(2)).sum::<f64>() / 21.0;
    let variance = |v: &DMatrix<f64>| v[(0, 0)] + mean_square * v[(1, 1)];
    let expected = (variance(&some) / variance(&all)).sqrt();
    assert!((line.judge(&[0, 10, 20]).unwrap().ratio / expected - 1.0).abs() < 1e-6);
}

/// A parabola read as a line leaves what is orthogonal to the line: Σ (x² − mean x²)² where places are symmetric.
#[test]
fn a_line_leaves_the_bend_of_a_parabola() {
    let line = polynomial(1, 21, 0.1);
    let at = |k: usize| k as f64 / 10.0 - 1.0;
    let bent: Vec<Vec<f64>> = (0..21).map(|k| vec![at(k).powi(2) / 0.1]).collect();
    let all = evenly(21, 21);
    let mean = all.iter().map(|k| at(*k).powi(2)).sum::<f64>() / 21.0;
    let expected: f64 = all.iter().map(|k| ((at(*k).powi(2) - mean) / 0.1).powi(2)).sum();
    assert!((line.lack_of_fit(0, &all, &bent).unwrap() / expected - 1.0).abs() < 1e-5);
    assert!(line.lack_of_fit(0, &[0, 20], &bent).unwrap() < 1e-3);
}

/// Readings that are taken stay, and the others are chosen beside them.
#[test]
fn what_is_taken_stays() {
    let mut line = polynomial(1, 21, 0.1);
    line.taken = vec![0, 1, 2, 3];
    let best = line.choose(6).unwrap();
    assert!([0, 1, 2, 3, 19, 20].iter().all(|k| best.chosen.contains(k)), "{:?}", best.chosen);
}

/// A parameter that is not wanted is known as badly as it may be.
#[test]
fn only_what_is_wanted_counts() {
    let mut line = polynomial(1, 21, 0.1);
    line.parameters[1].wanted = false;
    line.parameters[1].known = 1e-3;
    // With a known slope every reading tells the constant as well as any other.
    let (best, even) = (line.choose(4).unwrap(), line.judge(&evenly(21, 4)).unwrap());
    assert!((best.ratio / even.ratio - 1.0).abs() < 1e-3, "{} {}", best.ratio, even.ratio);
}

/// What is known exactly is no unknown: a slope beside a constant that is known has the error of a line through one
/// point, is read best as far from it as possible, and the constant gets neither better nor worse.
#[test]
fn what_is_known_exactly_is_no_unknown() {
    let mut line = polynomial(1, 21, 0.1);
    line.parameters[0].known = 0.0;
    let at = |k: &usize| *k as f64 / 10.0 - 1.0;
    let error = |of: &[usize]| (of.iter().map(|k| (at(k) / 0.1).powi(2)).sum::<f64>() + 1e-6).powf(-0.5);
    let (all, some) = (evenly(21, 21), evenly(21, 5));
    let found = line.judge(&some).unwrap();
    assert!(found.errors[0] < 1e-40 && (found.errors[1] / error(&some) - 1.0).abs() < 1e-9, "{:?}", found.errors);
    // The mean of the constant's share, which is 1, and the slope's.
    let expected = (0.5 * (1.0 + (error(&some) / error(&all)).powi(2))).sqrt();
    assert!((found.ratio / expected - 1.0).abs() < 1e-9, "{} {expected}", found.ratio);
    assert_eq!(line.choose(4).unwrap().chosen, [0, 1, 19, 20]);
}

/// Two parameters of which readings show little more than the sum: the error of either is right as long as there is an
/// answer, and where double precision does not hold what sets them apart there is none.
#[test]
fn what_double_precision_cannot_tell_apart_has_no_answer() {
    let at = |k: usize| k as f64 / 10.0 - 1.0;
    let spread = (0..21).map(|k| at(k).powi(2)).sum::<f64>();
    for (apart, answered) in [(1e-3, true), (1e-6, true), (1e-8, false), (0.0, false)] {
        let mut line = polynomial(1, 21, 1e-6);
        line.parameters.iter_mut().for_each(|p| p.known = 1e9);
        line.situations[0].rows = (0..21).map(|k| vec![1e6, 1e6 * (1.0 + apart * at(k))]).collect();
        let found = line.judge(&evenly(21, 21));
        assert_eq!(found.is_some(), answered, "{apart}");
        assert_eq!(line.choose(5).is_some(), answered, "{apart}");
        if let Some(found) = found {
            let expected = 1e-6 / (apart * spread.sqrt());
            assert!(found.errors.iter().all(|e| (e / expected - 1.0).abs() < 0.01), "{apart}: {found:?} {expected}");
        }
    }
}

/// The progress of a search never passes what is expected in all, and a search that is stopped has no answer.
#[test]
fn a_search_tells_how_far_it_is_and_stops() {
    let line = polynomial(3, 200, 0.1);
    let told = std::sync::Mutex::new(Vec::new());
    line.choose_watched(6, &|done, of| (told.lock().unwrap().push((done, of)), true).1).unwrap();
    let told = told.into_inner().unwrap();
    assert!(told.len() >= 12 && told.iter().enumerate().all(|(k, (done, of))| *done == k && done < of), "{told:?}");
    assert_eq!(line.choose_watched(6, &|done, _| done < 8), None);
    assert_eq!(line.best_possible_watched(6, &|done, _| done < 2), None);
}
