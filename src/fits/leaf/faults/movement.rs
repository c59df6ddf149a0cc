//! A leaf that moved. Where its picture is shifted by s texels, the readings differ from the prediction by −s times the
//! picture's gradient. The shift of every frame is found by least squares, and a step between two frames is looked for,
//! within a pass or between the passes. The fitted texels have taken up a part of the step, so its size is found by
//! trial.

use super::causes::FaultCause;
use super::sample::TexelSample;
use super::trials::{EXPLAINS, FaultTrials, TEXELS};
use crate::record::fault::{FaultGrade, MeasurementFault};

/// A step is one where it is this many of its standard errors.
const ERRORS: f64 = 8.0;
/// … and takes away this share of the shifts' squares.
const TAKES: f64 = 0.3;
/// Fewest texels, with those around them, that tell how far a leaf moved.
const FEWEST: usize = 20;
/// A leaf that moved by less than this (texels) does no harm.
const HARM: f64 = 0.5;

/// Shift of a frame (texels to the right and upwards) and the information about it.
#[derive(Debug, Clone, Copy, Default)]
struct Shift {
    /// Normal matrix xx, xy, yy.
    normal: [f64; 3],
    /// Right-hand side.
    pull: [f64; 2],
}

impl Shift {
    fn add(&mut self, other: &Shift) {
        self.normal.iter_mut().zip(other.normal).for_each(|(a, b)| *a += b);
        self.pull.iter_mut().zip(other.pull).for_each(|(a, b)| *a += b);
    }

    /// The shift, the χ² that it takes away, and its standard errors.
    fn solve(&self) -> Option<([f64; 2], f64, [f64; 2])> {
        let [a, b, c] = self.normal;
        let det = a * c - b * b;
        if !(det > 1e-9 * a * c) {
            return None;
        }
        let s = [(c * self.pull[0] - b * self.pull[1]) / det, (a * self.pull[1] - b * self.pull[0]) / det];
        Some((s, s[0] * self.pull[0] + s[1] * self.pull[1], [(c / det).sqrt(), (a / det).sqrt()]))
    }
}

/// Looks for a step of the leaf's place.
pub fn look(sample: &TexelSample, trials: &FaultTrials, texel_mm: f64) -> Option<MeasurementFault> {
    // Texels with neighbours on all four sides.
    let mut left = vec![None; sample.texels.len()];
    let mut below = vec![None; sample.texels.len()];
    for (n, [right, up]) in sample.beside.iter().enumerate() {
        if let Some(r) = right {
            left[*r] = Some(n);
        }
        if let Some(u) = up {
            below[*u] = Some(n);
        }
    }
    let inner: Vec<[usize; 5]> = (0..sample.texels.len())
        .filter_map(|n| Some([n, sample.beside[n][0]?, left[n]?, sample.beside[n][1]?, below[n]?]))
        .collect();
    if inner.len() < 30 {
        return None;
    }
    let mut shifts: Vec<Shift> = Vec::new();
    let mut names = Vec::new();
    let (mut squares, mut readings) = (0.0, 0.0);
    for pass in &sample.passes {
        for k in 0..pass.frames() {
            let mut shift = Shift::default();
            for &[n, right, left, up, down] in &inner {
                let (measured, predicted) = pass.of(n, k);
                let [r, l, u, d] = [right, left, up, down].map(|j| pass.of(j, k).1);
                for c in 0..3 {
                    let sd = sample.noise[n].variance(c, f64::from(predicted[c])).sqrt();
                    let z = (f64::from(measured[c]) - f64::from(predicted[c])) / sd;
                    if !z.is_finite() || z.abs() > 40.0 {
                        continue;
                    }
                    let g = [-0.5 * f64::from(r[c] - l[c]) / sd, -0.5 * f64::from(u[c] - d[c]) / sd];
                    squares += z * z;
                    readings += 1.0;
                    shift.add(&Shift { normal: [g[0] * g[0], g[0] * g[1], g[1] * g[1]], pull: [g[0] * z, g[1] * z] });
                }
            }
            shifts.push(shift);
            names.push((pass.travel, k));
        }
    }
    let scale = (squares / f64::max(readings, 1.0)).max(1.0);
    let sum = |range: std::ops::Range<usize>| {
        let mut all = Shift::default();
        shifts[range].iter().for_each(|s| all.add(s));
        all
    };
    let whole = sum(0..shifts.len()).solve()?.1;
    let each: f64 = shifts.iter().filter_map(|s| Some(s.solve()?.1)).sum::<f64>() - whole;
    let free = (2 * shifts.len()) as f64 * scale;
    let split = |at: usize| {
        let (a, b) = (sum(0..at).solve()?, sum(at..shifts.len()).solve()?);
        Some((a.1 + b.1 - whole, a, b))
    };
    let (gain, at, (a, b)) = (4..shifts.len().saturating_sub(3))
        .filter_map(|at| split(at).map(|(gain, a, b)| (gain, at, (a, b))))
        .max_by(|a, b| a.0.total_cmp(&b.0))?;
    let step = [b.0[0] - a.0[0], b.0[1] - a.0[1]];
    let error = [0, 1].map(|i: usize| a.2[i].hypot(b.2[i]) * scale.sqrt());
    let sure = (0..2).any(|i| step[i].abs() > ERRORS * error[i]);
    if !sure || gain < TAKES * (each - free) {
        return None;
    }
    let step = shift_from(trials, at)?;
    let side = sample.side.name();
    let (before, after) = (names[at - 1], names[at]);
    let when = if before.0 != after.0 {
        format!("between pass {} and pass {}", before.0.name(), after.0.name())
    } else {
        format!("between frames {} and {} of pass {}", before.1, after.1, after.0.name())
    };
    Some(MeasurementFault {
        name: "moved".into(),
        grade: FaultGrade::Wrong,
        sides: vec![side.into()],
        spoils: ["rho_d", "rho_s", "m", "normal", "sigma_a", "sigma_s", "gamma"].map(String::from).to_vec(),
        says: format!(
            "{side}: the leaf's picture moves by about {:+.1} columns and {:+.1} rows upwards ({:.2} mm) {when}: the \
             leaf or the camera was moved",
            step[0],
            step[1],
            step[0].hypot(step[1]) * texel_mm
        ),
    })
}

/// The shift of the leaf's picture, from a frame on, that explains what no other cause does.
fn shift_from(trials: &FaultTrials, from: usize) -> Option<[f64; 2]> {
    let around = |reach: i32| -> Vec<usize> {
        let inside =
            |n: &usize| (-reach..=reach).all(|x| (-reach..=reach).all(|y| trials.sample.at(*n, x, y).is_some()));
        (0..trials.sample.texels.len()).filter(inside).collect()
    };
    // A large leaf's sample is made of blocks that are three texels wide.
    let (reach, inside) = [2, 1].into_iter().map(|r| (r, around(r))).find(|(_, inside)| inside.len() >= FEWEST)?;
    let chosen: Vec<usize> = inside.iter().copied().step_by(inside.len().div_ceil(TEXELS)).collect();
    let chi2 = |shift: [f64; 2]| trials.fit_these(&chosen, FaultCause::Moved(from, shift), 1).chi2;
    let best = |list: &[[f64; 2]]| {
        list.iter().map(|s| (chi2(*s), *s)).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::INFINITY, [0.0; 2]))
    };
    let square = |reach: i32, step: f64, around: [f64; 2], limit: i32| -> Vec<[f64; 2]> {
        let all = (-reach..=reach).flat_map(|x| (-reach..=reach).map(move |y| [x, y]));
        let all = all.map(|s| [0, 1].map(|i: usize| around[i] + step * f64::from(s[i])));
        all.filter(|s| s.iter().all(|v| v.abs() <= f64::from(limit))).collect()
    };
    let still = chi2([0.0; 2]);
    let whole = best(&square(reach, 1.0, [0.0; 2], reach));
    let (least, shift) = best(&square(1, 0.5, whole.1, reach));
    let explains = still - least > EXPLAINS * (still - trials.noise);
    (explains && shift.iter().any(|s| s.abs() >= HARM)).then_some(shift)
}
