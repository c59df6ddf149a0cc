//! Steps towards the numbers that explain the pictures.
//!
//! Pictures and derivatives are noisy. If both came from the same paths, their product would be biased, and so would
//! the product of two derivatives. So residuals come from one set of paths, derivatives from two others (J₁ and J₂):
//!
//! ```text
//! g = (J₁ + J₂)ᵀ W r / 2        N = (J₁ᵀ W J₂ + J₂ᵀ W J₁) / 2        step = N⁻¹ g
//! ```
//! While derivatives are noisy, N can be far too small along some directions, and a step there would make things worse.
//! So the curvature of a direction is at least half of what the gradient's own paths have; that changes steps, and not
//! where they end.
//!
//! W is the inverse of the measurement's variance and the picture's own together, both by the paths of the derivatives:
//! by those of the residuals, weights would be large where the picture happens to be dark. Once steps are no larger
//! than noise makes them, as many paths are followed as make the pictures' own noise a third of the measurement's.

use crate::covariance::{covariance, names, unit};
use crate::photographs::{PixelUse, ScenePhotograph};
use crate::pictures::{LitScene, LitWorld, ShotSlopes, draw, exposure, is_fitted, rounds, variances};
use crate::scatter::AreaScatter;
use crate::step::{moved, step};
use crate::unknowns::SceneUnknowns;
use crate::{Options, Result, processor};
use mesophyll_base::solvers::{Termination, TraceRow};
use mesophyll_base::statistics::median_of;
use mesophyll_files::progress::{self, TaskProgress};
use mesophyll_transport::path::slopes::DerivativePicture;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeSet;
use std::time::Instant;

/// Paths a pixel of the first step.
pub const PATHS: u32 = 16;
/// Most steps.
const STEPS: usize = 24;
/// The pictures' own noise is to be at most this share of the measurement's.
const OWN: f64 = 1.0 / 3.0;
/// Two estimates from paths of their own differ by twice their variance; a mean square of steps over variances up to
/// this is no more than that.
const NOISE_ALONE: f64 = 3.0;
/// Paths grow by this factor at most from one step to the next.
const GROWTH: f64 = 16.0;
/// After so many steps that are larger than noise makes them, four times as many paths are followed.
const PATIENCE: usize = 4;
/// Readings farther from the picture than this many times the typical residual count less (Huber 1964): a path's light
/// has no normal distribution, and rare bright paths would pull at the numbers.
const TYPICAL: f64 = 4.0;
/// The largest relative step after which derivatives are those of before.
const NEAR: f64 = 0.02;
/// Readings farther from the picture than this many standard errors are wild, where they are few.
pub const WILD: f64 = 6.0;
/// The largest share of wild pixels, and how many may stand together with their neighbours; more of them are a wrong
/// model.
const FEW: f64 = 0.05;
const ALONE: usize = 2;

/// One reading, compared with the picture.
#[derive(Debug, Clone, Copy)]
pub struct ReadingComparison {
    /// Index of the picture, of its pixel, and the channel.
    pub at: [usize; 3],
    /// Reading less picture, over the standard error of both.
    pub residual: f64,
    /// That standard error.
    pub error: f64,
    /// The picture's own noise over the measurement's.
    pub own: f64,
    /// What the picture shows.
    pub shown: f64,
    /// What the reading is used for.
    pub of: PixelUse,
}

/// One step of the search.
pub struct SceneStep {
    /// The row of the fit's trace.
    pub row: TraceRow,
    /// Processor time since the start (s), where the system says it.
    pub processor_s: Option<f64>,
    /// Paths a pixel of the step's pictures.
    pub paths: u32,
    /// Readings of the pictures before the step.
    pub readings: usize,
    /// The numbers after it.
    pub values: Vec<f64>,
    /// Their standard errors, as far as they were known.
    pub stderr: Vec<f64>,
}

/// The end of the search.
pub struct SceneFit {
    /// Covariance of the numbers, of those that are determined; infinite on the diagonal of others.
    pub covariance: DMatrix<f64>,
    /// Why each number is not determined.
    pub undetermined: Vec<Option<String>>,
    /// Readings compared with the last step's pictures, moved by that step, and held-out pictures with their own.
    pub compared: Vec<ReadingComparison>,
    /// Why the search ended.
    pub termination: Termination,
    /// The steps.
    pub steps: Vec<SceneStep>,
    /// Paths a pixel of the last pictures.
    pub paths: u32,
    /// Median of the pictures' own noise over the measurement's.
    pub own_noise: f64,
    /// Number of wild pixels that were left out.
    pub wild: usize,
    /// What the draw of discs adds to the standard errors of areas: each with its name.
    pub areas: Vec<(String, f64)>,
    /// The share of the variances of readings that is due to it, and that all readings have in common.
    pub scatter: f64,
}

/// What a step is made of.
pub struct SceneNormal {
    /// The normal matrix N.
    pub matrix: DMatrix<f64>,
    /// The normal matrix of both halves together, J̄ᵀ W J̄ with J̄ = (J₁ + J₂)/2: that of the gradient's own paths. It
    /// is too large by the derivatives' noise, where N may be too small by it.
    pub upper: DMatrix<f64>,
    /// The gradient.
    pub gradient: DVector<f64>,
    chi2: f64,
    count: usize,
    /// Median of the residuals over that of a normal distribution.
    typical: f64,
    /// Median of own noise over the measurement's.
    own: f64,
    /// Every reading of the pictures that were drawn.
    pub compared: Vec<ReadingComparison>,
    /// How what is shown depends on the numbers: a reading, a number, the derivative.
    pub slopes: Vec<(usize, usize, f64)>,
}

impl SceneNormal {
    /// The readings compared with what would be shown after a step.
    fn after(mut self, step: &[f64]) -> Vec<ReadingComparison> {
        for (k, number, slope) in self.slopes {
            let more = slope * step[number];
            let reading = &mut self.compared[k];
            reading.shown += more;
            reading.residual -= more / reading.error;
        }
        self.compared
    }
}

/// Whether the pictures' own noise is at most what it is to be of the measurement's.
fn is_enough(own: f64) -> bool {
    own <= 1.1 * OWN
}

/// How many paths a pixel make their own noise what it is to be, where it is `own` times the measurement's with
/// `paths`.
fn wanted(paths: u32, own: f64) -> u32 {
    let wanted = f64::from(paths) * (own / OWN).powi(2).max(1.0);
    (wanted / 16.0).ceil().min(f64::from(u32::MAX / 16)) as u32 * 16
}

/// How many paths a pixel the last pictures of a fit have, where their own noise is `own` times the measurement's with
/// the paths of the first step.
pub fn last_paths(own: f64, samples: u32) -> u32 {
    if is_enough(own) { PATHS.min(samples) } else { wanted(PATHS, own).min(samples) }
}

/// Finds the numbers.
///
/// # Errors
/// A stop that was asked for, and those of the scene's light.
pub fn find(numbers: &mut SceneUnknowns, shots: &mut [ScenePhotograph], options: &Options) -> Result<SceneFit> {
    let (clock, processor) = (Instant::now(), processor::seconds());
    let (_, n) = numbers.places();
    let bar = TaskProgress::of("steps");
    let (mut paths, mut seed, mut steps) = (PATHS.min(options.samples), options.seed, Vec::new());
    let (mut termination, mut wild) = (Termination::IterationLimit, None);
    let (mut last, mut since, mut stepped) = (None, 0, Vec::new());
    for iteration in 0..STEPS {
        progress::go_on()?;
        let normal = normal(numbers, shots, paths, seed)?;
        seed += 3;
        let (step, stderr) = step(numbers, &normal);
        let before = numbers.values();
        let after = moved(numbers, &before, &step);
        numbers.set(&after);
        stepped = after.iter().zip(&before).map(|(a, b)| a - b).collect();
        let shares: Vec<f64> = (0..n).map(|k| (after[k] - before[k]) / stderr[k]).filter(|s| s.is_finite()).collect();
        let square = shares.iter().map(|s| s * s).sum::<f64>() / shares.len().max(1) as f64;
        // Other discs stand in the fit than in the pictures. Until the end that is noise of an unknown size, which a
        // few wild readings must not decide.
        let counted = numbers.areas().next().is_some();
        let spread = if counted { normal.typical.powi(2).max(1.0) } else { 1.0 };
        let row = TraceRow {
            iteration,
            evaluations: 3 * (iteration + 1),
            elapsed_s: clock.elapsed().as_secs_f64(),
            cost: 0.5 * normal.chi2,
            gradient: normal.gradient.amax(),
            step: square.sqrt(),
            truth_error: None,
        };
        let processor_s = processor::seconds().zip(processor).map(|(now, then)| now - then);
        steps.push(SceneStep { row, processor_s, paths, readings: normal.count, values: after.clone(), stderr });
        progress::say(format_args!(
            "step {}: χ² {:.4} a reading, {paths} paths a pixel, {:.2} standard errors",
            iteration + 1,
            normal.chi2 / normal.count.max(1) as f64,
            square.sqrt()
        ));
        bar.advance(1);
        let own = normal.own;
        last = Some(normal);
        // A step that changes little changes the derivatives by as little.
        let unit = unit(numbers);
        let near = (0..n).all(|k| (after[k] - before[k]).abs() <= NEAR * unit[k].min(before[k].abs().max(0.02)));
        let enough = is_enough(own) || paths >= options.samples;
        since += 1;
        if square > NOISE_ALONE * spread && !(near && enough && wild.is_some()) {
            if since >= PATIENCE && !enough {
                (paths, since) = (paths.saturating_mul(4).min(options.samples), 0);
            }
            continue;
        }
        since = 0;
        if wild.is_none() {
            // Near the end, readings that nothing explains are left out once.
            wild = last.as_ref().map(|normal| leave_out(shots, &normal.compared, WILD * spread.sqrt()));
        } else if enough {
            termination = Termination::StepSmall;
            break;
        }
        paths = wanted(paths, own.min(GROWTH.sqrt() * OWN)).min(options.samples);
    }
    let Some(normal) = last else { return Err(crate::Error::Missed("no step was made".into())) };
    // The last step was so small that its own pictures, moved by the derivatives, judge the numbers. Pictures that were
    // kept from the fit are drawn now.
    let mut compared = held_out(numbers, shots, paths, seed + 5)?;
    let (mut covariance, undetermined) = covariance(numbers, &normal.matrix);
    let scatter = AreaScatter::new(numbers, shots, paths, seed + 11)?;
    let mut areas = Vec::new();
    if let Some(scatter) = &scatter {
        let part = scatter.widen(numbers, shots, &normal, &mut covariance);
        let (places, names) = (numbers.places().0, names(numbers));
        let known = numbers.areas().map(|(k, _)| places[k]).filter(|k| undetermined[*k].is_none());
        areas.extend(known.map(|k| (format!("{}.monte_carlo_error", names[k]), part[(k, k)].sqrt())));
    }
    let wild = wild.unwrap_or(0);
    let own_noise = normal.own;
    compared.extend(normal.after(&stepped));
    let scatter = scatter.map_or(0.0, |scatter| scatter.judge(numbers, shots, &mut compared));
    Ok(SceneFit { covariance, undetermined, compared, termination, steps, paths, own_noise, wild, areas, scatter })
}

fn normal(numbers: &SceneUnknowns, shots: &[ScenePhotograph], paths: u32, seed: u64) -> Result<SceneNormal> {
    let (first, n) = numbers.places();
    let [rounds, each] = rounds(paths, numbers.draws());
    let worlds = LitWorld::all(numbers, shots, 0..numbers.draws(), true)?;
    let lit = LitScene::all(numbers, &worlds)?;
    let slopes = &lit.first().map(LitScene::by).unwrap_or_default();
    let (a, one, two) = (
        draw(&lit, shots, is_fitted, None, [2 * rounds, each], seed)?,
        draw(&lit, shots, is_fitted, Some(0), [rounds, each], seed + 1)?,
        draw(&lit, shots, is_fitted, Some(1), [rounds, each], seed + 2)?,
    );
    let compared = compared(numbers, shots, is_fitted, &a, [&one, &two], rounds);
    let fitted = || compared.iter().filter(|c| c.of == PixelUse::Fitted);
    let (chi2, count) = (fitted().map(|c| c.residual * c.residual).sum(), fitted().count());
    let own = median_of(fitted().map(|c| c.own)).unwrap_or(0.0);
    // The median over that of a normal distribution.
    let typical = median_of(compared.iter().map(|c| c.residual.abs())).unwrap_or(0.0) / 0.674_5;
    let limit = TYPICAL * typical.max(1.0);
    let (mut matrix, mut gradient): (DMatrix<f64>, DVector<f64>) = (DMatrix::zeros(n, n), DVector::zeros(n));
    let mut upper = matrix.clone();
    let mut row: Vec<(usize, f64, f64)> = Vec::with_capacity(n);
    let mut by = Vec::new();
    for (place, reading) in compared.iter().enumerate() {
        let [s, k, c] = reading.at;
        let shot = ShotSlopes { numbers, shot: &shots[s], of: slopes, pictures: [&one[s], &two[s]] };
        shot.row(&first, k, c, &mut row);
        by.extend(row.iter().map(|(number, p, q)| (place, *number, 0.5 * (p + q))));
        if reading.of != PixelUse::Fitted {
            continue;
        }
        let weight = (limit / reading.residual.abs()).min(1.0) / (reading.error * reading.error);
        for (i, p, q) in &row {
            gradient[*i] += 0.5 * (p + q) * weight * reading.residual * reading.error;
            for (j, u, v) in &row {
                matrix[(*i, *j)] += 0.5 * weight * (p * v + q * u);
                upper[(*i, *j)] += 0.25 * weight * (p + q) * (u + v);
            }
        }
    }
    Ok(SceneNormal { matrix, upper, gradient, chi2, count, typical, own, compared, slopes: by })
}

/// The readings of the shots that `wanted` chooses, compared with `shown`. Two pictures of half as many paths give the
/// variances.
fn compared(
    numbers: &SceneUnknowns,
    shots: &[ScenePhotograph],
    wanted: impl Fn(&ScenePhotograph) -> bool,
    shown: &[DerivativePicture],
    [one, two]: [&[DerivativePicture]; 2],
    rounds: u32,
) -> Vec<ReadingComparison> {
    let mut out = Vec::new();
    for (s, shot) in shots.iter().enumerate().filter(|(_, shot)| wanted(shot)) {
        let factor = exposure(numbers, shot);
        let variances = variances(shot, [&one[s], &two[s]], rounds, factor);
        for k in (0..shot.uses.len()).filter(|k| shot.uses[*k] != PixelUse::Out) {
            for c in 0..shot.channels {
                let at = k * shot.channels + c;
                let ([measured, own], seen) = (variances[at], shot.seen[at]);
                let (error, shown) = ((measured + own).sqrt(), factor * shown[s].mean[at]);
                let residual = (seen - shown) / error;
                // Where nothing is seen, nothing is learnt.
                if residual.is_finite() && (seen != 0.0 || shown != 0.0) {
                    let own = (own / measured).sqrt();
                    out.push(ReadingComparison { at: [s, k, c], residual, error, own, shown, of: shot.uses[k] });
                }
            }
        }
    }
    out
}

/// The readings of pictures that are kept from the fit as a whole.
fn held_out(
    numbers: &SceneUnknowns,
    shots: &[ScenePhotograph],
    paths: u32,
    seed: u64,
) -> Result<Vec<ReadingComparison>> {
    let all = |shot: &ScenePhotograph| !is_fitted(shot);
    let [rounds, each] = rounds(paths, numbers.draws());
    let worlds = LitWorld::all(numbers, shots, 0..numbers.draws(), false)?;
    let lit = LitScene::all(numbers, &worlds)?;
    let shown = draw(&lit, shots, all, None, [2 * rounds, each], seed)?;
    let one = draw(&lit, shots, all, None, [rounds, each], seed + 7)?;
    let two = draw(&lit, shots, all, None, [rounds, each], seed + 8)?;
    Ok(compared(numbers, shots, all, &shown, [&one, &two], rounds))
}

/// Marks pixels with readings that are more than `wild` standard errors off, where they are few and stand alone, and
/// returns how many these are. What neighbours share is no accident of a pixel.
fn leave_out(shots: &mut [ScenePhotograph], compared: &[ReadingComparison], wild: f64) -> usize {
    let far: BTreeSet<[usize; 2]> =
        compared.iter().filter(|c| c.residual.abs() > wild).map(|c| [c.at[0], c.at[1]]).collect();
    let alone = |at: &&[usize; 2]| {
        let [s, k] = **at;
        let w = shots[s].size[0] as isize;
        let (x, y) = (k as isize % w, k as isize / w);
        let beside = (-1..=1).flat_map(|j| (-1..=1).map(move |i| (x + i, y + j)));
        let inside = beside.filter(|(i, j)| (0..w).contains(i) && *j >= 0);
        inside.filter(|(i, j)| far.contains(&[s, (j * w + i) as usize])).count() <= ALONE
    };
    let wild: Vec<[usize; 2]> = far.iter().filter(alone).copied().collect();
    let wild: Vec<[usize; 2]> = wild.into_iter().filter(|[s, k]| shots[*s].uses[*k] != PixelUse::Out).collect();
    let all = shots.iter().flat_map(|s| &s.uses).filter(|of| **of != PixelUse::Out).count();
    if wild.len() as f64 > FEW * all as f64 {
        return 0;
    }
    wild.iter().for_each(|[s, k]| shots[*s].uses[*k] = PixelUse::Wild);
    wild.len()
}
