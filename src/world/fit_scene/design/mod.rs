//! `design scene`: which further pictures of a scene, by which camera and under which sun, would leave the smallest
//! errors of its unknown numbers.
//!
//! A picture that is not taken yet is drawn, with its derivatives, at several values of the unknown numbers. Its
//! information on them is Jᵀ W J, with the noise that it will have. It is estimated from two sets of paths, as in the
//! fit itself: a product of two derivatives of the same paths would be too large. The chooser of all designs
//! ([`mesophyll_base::selection`]) takes readings by their rows; those of a picture are a root of its information.

mod candidates;
mod information;
#[cfg(test)]
mod tests;

use crate::photographs::{self, ScenePhotograph};
use crate::pictures::{LitScene, LitWorld, is_fitted};
use crate::quantity::{UnknownKind, UnknownQuantity};
use crate::step::keep_energy;
use crate::unknowns::SceneUnknowns;
use crate::{Error, Result, covariance, require_canopy, wavelengths};
pub use candidates::SceneCandidate;
use information::{PlannedNoise, PlannedShot};
use mesophyll_base::selection::{DesignAim, DesignChoice, DesignParameter, DesignProblem, DesignSituation};
use mesophyll_files::progress::TaskProgress;
use mesophyll_scene::draw::reference;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::AREA;
use mesophyll_scene::placed::ledger::Ledger;

/// What is planned for.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneDesignOptions {
    /// Cameras on a dome around what the first view looks at, beside the scene's own views.
    pub cameras: usize,
    /// Zenith angles and azimuths of the sun (degrees), beside the scene's own and the hours of its day.
    pub suns: Vec<[f64; 2]>,
    /// Names of unknowns that count, or what they begin with; all but exposures where there are none.
    pub wanted: Vec<String>,
    /// Each number is taken up to this many times larger and smaller than the scene states it.
    pub range: f64,
    /// Sets of values of the unknown numbers.
    pub draws: usize,
    /// Relative noise of a pixel; that of the pictures that there are where it is not given.
    pub noise: Option<f64>,
    /// Paths a pixel.
    pub samples: u32,
    /// Most columns of a picture that is drawn. A larger one is drawn coarsely, and counts by its pixels.
    pub columns: usize,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl Default for SceneDesignOptions {
    fn default() -> SceneDesignOptions {
        SceneDesignOptions {
            cameras: 12,
            suns: Vec::new(),
            wanted: Vec::new(),
            range: 1.5,
            draws: 4,
            noise: None,
            samples: 32,
            columns: 64,
            seed: 1,
        }
    }
}

/// Pictures that could be taken, and what each would tell.
pub struct SceneDesign {
    /// The problem of choosing among them. The pictures that there are come first, and are taken.
    pub problem: DesignProblem,
    /// Pictures that could be taken, after those that there are.
    pub candidates: Vec<SceneCandidate>,
    /// Names of the pictures that there are.
    pub taken: Vec<String>,
    /// The relative noise of a pixel that is planned with.
    pub noise: f64,
    /// Each unknown: its name, and how many numbers it has.
    quantities: Vec<(String, usize)>,
    /// Beyond this error a number is not determined.
    limits: Vec<f64>,
}

/// The design for a scene.
///
/// # Errors
/// [`Error::Input`] for a scene without unknown numbers, without a camera, or with pictures that cannot be used;
/// [`Error::Usage`] for options that the scene has nothing for; a stop that was asked for.
pub fn plan(scene: &LoadedScene, options: &SceneDesignOptions, ledger: &Ledger) -> Result<SceneDesign> {
    let manifest = &scene.manifest;
    manifest.require_unknown()?;
    if wavelengths(manifest)?.is_some() {
        let what = "its tables have wavelengths; expected those of three channels, which pictures have too";
        return Err(Error::field(&manifest.path, "brf", what));
    }
    let asked = manifest.unknown.as_ref().map(|unknown| &unknown.leaves);
    if let Some((name, _)) = asked.into_iter().flatten().find(|(_, numbers)| numbers.iter().any(|n| n == AREA)) {
        let what = format!(
            "found \"{AREA}\", whose error is mostly due to where discs stand, which a plan does not count; expected \
             [unknown] without it, for a plan of the other numbers"
        );
        return Err(Error::field(&manifest.path, &format!("unknown.leaves.{name}"), what));
    }
    let there = manifest.taken.iter().any(|p| !p.held_out) || manifest.factors.iter().any(|f| !f.held_out);
    let mut shots = if there { photographs::read(manifest, None)? } else { Vec::new() };
    shots.retain(is_fitted);
    let world = reference::traced(scene, manifest.rest_time(), ledger)?;
    require_canopy(manifest, &world, options.seed, false)?;
    let candidates = candidates::all(manifest, options)?;
    let mut groups: Vec<String> = shots.iter().filter_map(|s| s.exposure.clone()).collect();
    groups.sort();
    groups.dedup();
    let mut numbers = SceneUnknowns::new(scene, world, &groups, None, ledger)?;
    let noise = noise(&shots, options);
    let size = shots.iter().find(|s| matches!(s.by, photographs::ReadingKind::Camera(_))).map(|s| s.size);
    let size = size.unwrap_or([manifest.check.width, manifest.check.height].map(|n| n as usize));
    let floor = shots.iter().map(|s| s.floor).fold(0.0, f64::max);
    let taken: Vec<String> = shots.iter().map(|s| s.name.clone()).collect();
    let mut planned: Vec<PlannedShot> = shots.iter().map(|s| PlannedShot::taken(s, options.columns)).collect();
    let new = candidates.iter().enumerate().map(|(k, c)| c.shot(taken.len() + k, size, [noise, floor]));
    planned.extend(new.map(|shot| PlannedShot::taken(&shot, options.columns)));

    let (unit, stated) = (covariance::unit(&numbers), numbers.values());
    let parameters = parameters(&numbers, &unit, options)?;
    let bar = TaskProgress::new("pictures drawn", (options.draws.max(1) * planned.len()) as u64);
    let mut situations = Vec::new();
    for draw in 0..options.draws.max(1) {
        let values = drawn(&numbers, &stated, options.range, draw);
        numbers.set(&values);
        let all: Vec<ScenePhotograph> = planned.iter().map(|p| p.shot.clone()).collect();
        let worlds = LitWorld::all(&numbers, &all, 0..1, true)?;
        let lit = LitScene::all(&numbers, &worlds)?;
        let seed = options.seed.wrapping_add(1 + 3 * draw as u64);
        let paths = [u64::from(options.samples), seed];
        let noise = PlannedNoise::drawn(&numbers, &lit, &planned, paths)?;
        let rows = (0..planned.len()).map(|k| {
            let rows = information::rows(&numbers, &lit, (&planned, &noise, k), &unit, paths)?;
            bar.step()?;
            Ok(rows)
        });
        situations.push(DesignSituation { values, rows: rows.collect::<Result<_>>()? });
        numbers.set(&stated);
    }
    let problem =
        DesignProblem { aim: DesignAim::Parameters, parameters, situations, taken: (0..taken.len()).collect() };
    let quantities = numbers.list.iter().map(|q| (q.name.clone(), q.at.len())).collect();
    let limits = numbers.list.iter().flat_map(|q| q.at.iter().map(|at| q.limit(*at))).collect();
    Ok(SceneDesign { problem, candidates, taken, noise, quantities, limits })
}

/// The noise of a pixel: as asked, as the pictures state it, or 1 %.
fn noise(shots: &[ScenePhotograph], options: &SceneDesignOptions) -> f64 {
    let stated = shots.iter().map(|s| s.noise).find(|noise| *noise > 0.0);
    options.noise.or(stated).unwrap_or(0.01)
}

/// The numbers, with what is known of each before any picture: it is uncertain by its own unit, as in the fit.
fn parameters(numbers: &SceneUnknowns, unit: &[f64], options: &SceneDesignOptions) -> Result<Vec<DesignParameter>> {
    let (list, channels) = (&numbers.list, &numbers.channels);
    let asked = |q: &UnknownQuantity| match options.wanted.is_empty() {
        true => !matches!(q.kind, UnknownKind::Exposure(_)),
        false => options.wanted.iter().any(|w| q.name.starts_with(w.as_str())),
    };
    if let Some(wrong) = options.wanted.iter().find(|w| !list.iter().any(|q| q.name.starts_with(w.as_str()))) {
        let all = list.iter().map(|q| q.name.as_str()).collect::<Vec<_>>().join(", ");
        return Err(Error::Usage(format!("--for: found {wrong:?}, expected what one of {all} begins with")));
    }
    let each = list.iter().flat_map(|q| q.names(channels).into_iter().map(move |name| (name, asked(q))));
    Ok(each.zip(unit).map(|((name, wanted), known)| DesignParameter { name, known: *known, wanted }).collect())
}

/// Values of the numbers within their range, other ones for each draw; the first are those that the scene states.
fn drawn(numbers: &SceneUnknowns, stated: &[f64], range: f64, draw: usize) -> Vec<f64> {
    let mut values = stated.to_vec();
    let limits = numbers.list.iter().flat_map(|q| q.high.iter().map(move |high| [q.low, *high]));
    for (k, (value, [low, high])) in values.iter_mut().zip(limits).enumerate() {
        // Shares of the range that neither draws nor numbers have in common: multiples of the golden section.
        let share = (0.5 + draw as f64 * (0.618_034 * (k + 1) as f64).fract()).fract();
        *value = (*value * range.powf(2.0 * share - 1.0)).clamp(low, high);
    }
    keep_energy(numbers, &mut values);
    values
}

impl SceneDesign {
    /// How many pictures there are.
    pub fn there(&self) -> usize {
        self.taken.len()
    }

    /// The unknowns that count: names, each with the places of its numbers.
    fn wanted(&self) -> impl Iterator<Item = (&str, std::ops::Range<usize>)> {
        let mut first = 0;
        let each = self.quantities.iter().map(move |(name, count)| (name.as_str(), (first, first += count).0, *count));
        each.map(|(name, first, count)| (name, first..first + count))
            .filter(|(_, of)| self.problem.parameters[of.start].wanted)
    }

    /// Names of the unknowns that count.
    pub fn names(&self) -> Vec<String> {
        self.wanted().map(|(name, _)| name.to_string()).collect()
    }

    /// The error of each unknown that counts: the root of the mean square over its channels.
    pub fn errors(&self, choice: &DesignChoice) -> Vec<f64> {
        let mean = |of: std::ops::Range<usize>| {
            let count = of.len() as f64;
            (of.map(|k| choice.errors[k].powi(2)).sum::<f64>() / count).sqrt()
        };
        self.wanted().map(|(_, of)| mean(of)).collect()
    }

    /// Unknowns that count, and that a choice leaves undetermined.
    pub fn undetermined(&self, choice: &DesignChoice) -> Vec<String> {
        let loose = |of: &std::ops::Range<usize>| of.clone().any(|k| choice.errors[k] > self.limits[k]);
        self.wanted().filter(|(_, of)| loose(of)).map(|(name, _)| name.to_string()).collect()
    }

    /// The new pictures of a choice, the most useful first; each with what all up to it leave. `None` as
    /// [`DesignProblem::choose`].
    pub fn one_by_one(&self, choice: &DesignChoice) -> Option<Vec<(usize, DesignChoice)>> {
        let mut left: Vec<usize> = choice.chosen.iter().copied().filter(|k| *k >= self.there()).collect();
        let (mut with, mut out) = (self.problem.taken.clone(), Vec::new());
        while !left.is_empty() {
            let judged = |k: &usize| Some((*k, self.problem.judge(&[&with[..], &[*k]].concat())?));
            let all: Vec<(usize, DesignChoice)> = left.iter().map(judged).collect::<Option<_>>()?;
            let best = all.into_iter().min_by(|a, b| a.1.ratio.total_cmp(&b.1.ratio))?;
            left.retain(|k| *k != best.0);
            with.push(best.0);
            out.push(best);
        }
        Some(out)
    }
}
