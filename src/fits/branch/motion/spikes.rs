//! Wild readings: single ones that the motion before and after them does not lead to.
//!
//! The readings are described as an autoregressive process (J. P. Burg's method, over all stretches without gaps),
//! whose filter a leaves white noise ε_t = Σ_i a_i x_(t−i). The difference of a reading from what all others together
//! let expect is then Σ_i a_i ε_(t+i)/Σ_i a_i², over the filters within the record, and its variance is that of ε over
//! Σ_i a_i². This sees far smaller errors than the readings' own spread, because a swaying branch is smooth. Gaps are
//! filled by their expectation first.

use mesophyll_base::statistics::{NORMAL_SCATTER, median_of};

/// A reading this many standard deviations off is wild. One that is not found changes the power density by at most the
/// square of this over the number of readings, of the place where it is least.
const WILD: f64 = 7.0;
/// Order of the process.
const ORDER: usize = 16;
/// Readings on each side that say how large the differences are at a place.
const AROUND: usize = 40;
/// A difference of this many steps of writing is more than rounding.
const ROUNDED: f64 = 3.0;
/// How often readings are taken out and the process is described anew.
const ROUNDS: usize = 30;
/// Steps of the solver that fills gaps.
const STEPS: usize = 60;

/// Replaces wild readings by gaps (NaN) and returns their places. `resolution` is the step in which readings are
/// written.
pub fn remove(readings: &mut [f64], resolution: f64) -> Vec<usize> {
    let mut found = Vec::new();
    let most = 3 + readings.len() / 20;
    for _ in 0..ROUNDS {
        let wild = wildest(readings, resolution);
        for k in &wild {
            readings[*k] = f64::NAN;
        }
        found.extend(&wild);
        if wild.is_empty() || found.len() > most {
            break;
        }
    }
    found.sort_unstable();
    found
}

/// Readings that are wild, and wilder than all others that share neighbours with them.
fn wildest(readings: &[f64], resolution: f64) -> Vec<usize> {
    let observed: Vec<usize> = (0..readings.len()).filter(|k| !readings[*k].is_nan()).collect();
    if observed.len() < 4 * ORDER {
        return Vec::new();
    }
    let mean = observed.iter().map(|k| readings[*k]).sum::<f64>() / observed.len() as f64;
    let (scores, off) = scores(readings, mean, &burg(readings, mean));
    let size = |k: usize| scores[k].abs();
    let everywhere = median_of(observed.iter().map(|k| size(*k))).unwrap_or(0.0);
    let large = |k: usize, usual: f64| size(k) > WILD * NORMAL_SCATTER * usual && off[k].abs() > ROUNDED * resolution;
    let suspects: Vec<usize> = observed.iter().copied().filter(|k| large(*k, everywhere)).collect();
    let local = |k: usize| {
        let range = k.saturating_sub(AROUND)..(k + AROUND + 1).min(readings.len());
        median_of(range.filter(|j| !readings[*j].is_nan()).map(size)).unwrap_or(0.0).max(everywhere)
    };
    let wild = |k: &usize| {
        let around = k.saturating_sub(ORDER)..(k + ORDER + 1).min(readings.len());
        large(*k, local(*k)) && around.filter(|j| !readings[*j].is_nan()).all(|j| size(j) <= size(*k))
    };
    suspects.into_iter().filter(wild).collect()
}

/// The filter 1, a_1 … of the process: Σ a_j x_(t−j) is white.
fn burg(readings: &[f64], mean: f64) -> Vec<f64> {
    // Stretches without gaps; where gaps are too frequent for that, the record with straight lines across them.
    let long = |of: &[f64]| of.split(|r| r.is_nan()).filter(|p| p.len() > 2 * ORDER).map(<[f64]>::len).sum::<usize>();
    let observed = readings.iter().filter(|r| !r.is_nan()).count();
    let mut whole = readings.to_vec();
    if 2 * long(readings) < observed {
        let open: Vec<usize> = (0..readings.len()).filter(|k| readings[*k].is_nan()).collect();
        join(&mut whole, &open);
    }
    let mut stretches: Vec<(Vec<f64>, Vec<f64>)> = Vec::new();
    for part in whole.split(|r| r.is_nan()).filter(|p| p.len() > 2 * ORDER) {
        let values: Vec<f64> = part.iter().map(|r| r - mean).collect();
        stretches.push((values.clone(), values));
    }
    let mut filter = vec![0.0; ORDER + 1];
    filter[0] = 1.0;
    for m in 1..=ORDER {
        let (mut top, mut bottom) = (0.0, 0.0);
        for (forward, backward) in &stretches {
            for t in m..forward.len() {
                top += forward[t] * backward[t - 1];
                bottom += forward[t] * forward[t] + backward[t - 1] * backward[t - 1];
            }
        }
        if !(bottom > 0.0) {
            break;
        }
        let reflection = -2.0 * top / bottom;
        let old = filter.clone();
        for j in 1..=m {
            filter[j] = old[j] + reflection * old[m - j];
        }
        for (forward, backward) in &mut stretches {
            for t in (m..forward.len()).rev() {
                let (f, b) = (forward[t], backward[t - 1]);
                forward[t] = f + reflection * b;
                backward[t] = b + reflection * f;
            }
        }
    }
    filter
}

/// For every place, the difference from what all others let expect: over its standard deviation (times one number for
/// all), and itself. Gaps are filled so that theirs is 0.
fn scores(readings: &[f64], mean: f64, filter: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let n = readings.len();
    let open: Vec<usize> = (0..n).filter(|k| readings[*k].is_nan()).collect();
    let mut filled: Vec<f64> = readings.iter().map(|r| r - mean).collect();
    join(&mut filled, &open);
    let white = |x: &[f64], t: usize| (0..=ORDER).map(|i| filter[i] * x[t - i]).sum::<f64>();
    // What a filter says of the place k, over all filters that hold it.
    let back = |noise: &[f64], k: usize| {
        let within = |i: &usize| (ORDER..n).contains(&(k + i));
        (0..=ORDER).filter(within).map(|i| filter[i] * noise[k + i]).sum::<f64>()
    };
    let whole = |x: &[f64]| (0..n).map(|t| if t < ORDER { 0.0 } else { white(x, t) }).collect::<Vec<f64>>();
    let squares = |k: usize| {
        let within = |i: &usize| (ORDER..n).contains(&(k + i));
        (0..=ORDER).filter(within).map(|i| filter[i] * filter[i]).sum::<f64>()
    };
    // Conjugate gradients on the unknown readings.
    let mut direction = vec![0.0; n];
    let mut noise = whole(&filled);
    let mut residual: Vec<f64> = open.iter().map(|k| -back(&noise, *k)).collect();
    let mut size: f64 = residual.iter().map(|r| r * r).sum();
    let end = 1e-20 * size;
    for (k, r) in open.iter().zip(&residual) {
        direction[*k] = *r;
    }
    for _ in 0..STEPS {
        if !(size > end) {
            break;
        }
        let moved = whole(&direction);
        let along: f64 = moved.iter().map(|m| m * m).sum();
        if !(along > 0.0) {
            break;
        }
        let step = size / along;
        noise.iter_mut().zip(&moved).for_each(|(e, m)| *e += step * m);
        for (k, r) in open.iter().zip(&mut residual) {
            *r = -back(&noise, *k);
        }
        let next: f64 = residual.iter().map(|r| r * r).sum();
        for (k, r) in open.iter().zip(&residual) {
            direction[*k] = r + next / size * direction[*k];
        }
        size = next;
    }
    let all: Vec<(f64, f64)> = (0..n).map(|k| (back(&noise, k), squares(k))).collect();
    (all.iter().map(|(b, s)| b / s.sqrt()).collect(), all.iter().map(|(b, s)| b / s).collect())
}

/// Fills gaps along straight lines, and those at the ends with the nearest reading.
fn join(filled: &mut [f64], open: &[usize]) {
    let mut is_open = vec![false; filled.len()];
    for k in open {
        is_open[*k] = true;
    }
    let known: Vec<usize> = (0..filled.len()).filter(|k| !is_open[*k]).collect();
    for k in open {
        let next = known.partition_point(|at| at < k);
        let (before, after) = (next.checked_sub(1).map(|b| known[b]), known.get(next).copied());
        filled[*k] = match (before, after) {
            (Some(a), Some(b)) => {
                let share = (k - a) as f64 / (b - a) as f64;
                filled[a] * (1.0 - share) + filled[b] * share
            }
            (Some(a), None) => filled[a],
            (None, Some(b)) => filled[b],
            (None, None) => 0.0,
        };
    }
}
