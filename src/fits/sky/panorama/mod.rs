//! Sun, turbidity and scale from a panorama of the sky, which is the sky's part of reconstructing a scene.
//!
//! The model of a reading of channel c in direction d is s L_c(d; θs, φs, τ): Preetham's radiance in linear sRGB
//! (kcd/m²) for the sun's zenith angle θs and azimuth φs and the turbidity τ, times one scale s for all channels. So
//! the panorama must be white-balanced. Its noise is relative: σ = n √(L² + (L₀/50)²), where L₀ is the median reading.
//! The unknowns are θs, φs, τ and ln s. Pixels that differ from the model by more than [`CUT`] times the scatter are
//! clouds, trees or the sun's disk. They are left out, again and again until their set no longer changes.
//!
//! Where the picture shows the sun's disk ([`disk`]), the disk says where the sun is, and only turbidity and scale are
//! found from the sky's brightness, unless the sky tells the sun's place more closely and the disk agrees. So a sky
//! that Preetham's model does not describe still has its sun. Where the two are far apart, the answer says so.
//!
//! Limits: one clear sky without clouds, turbidity 1.7 to 10, and the sun above the horizon. A sky that Preetham's
//! model does not describe within the noise, or with residuals that have a pattern in the picture, leaves turbidity and
//! scale undetermined, and the sun too where its disk is not seen; then the best values are printed, with the misfit.

mod descent;
pub mod disk;
mod outcome;
pub mod picture;
pub mod projection;
pub mod record;
pub mod render;
mod start;
#[cfg(test)]
mod tests;

use descent::{DescentRound, ResidualWeights, SunChart, descend, modelled};
use disk::PanoramaDisk;
use mesophyll_base::solvers::{Fit, ResidualNoise, Termination, Trace};
use mesophyll_base::statistics::median_of;
use mesophyll_files::table::Status;
use mesophyll_sky::sun_direction;
use outcome::{FittedPixels, finished};
use picture::{CLIPPED, PanoramaPixel, PanoramaReadings};
use start::{PanoramaGuess, angle, turned};

/// A number and its standard error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PanoramaEstimate {
    /// The number, in the unit that its field states.
    pub value: f64,
    /// Its standard error, in the same unit; infinite where nothing is known.
    pub error: f64,
}

/// The result of the fit.
#[derive(Debug, Clone, PartialEq)]
pub struct PanoramaFit {
    /// Angle of the sun from the zenith (rad).
    pub sun_zenith: PanoramaEstimate,
    /// Azimuth of the sun (rad), from +x to +y, −π … π.
    pub sun_azimuth: PanoramaEstimate,
    /// Turbidity, 1.7 to 10.
    pub turbidity: PanoramaEstimate,
    /// The picture's reading for one kcd/m².
    pub scale: PanoramaEstimate,
    /// What the sun's direction was taken from.
    pub sun_from: SunSource,
    /// The sun's disk, or why none was seen.
    pub disk: Result<PanoramaDisk, &'static str>,
    /// Correlations of these four, in this order; NaN where undetermined.
    pub correlation: Vec<Vec<f64>>,
    /// Relative noise of a reading, which the errors are computed from.
    pub noise: f64,
    /// Where the noise is known from.
    pub noise_from: NoiseSource,
    /// Readings that were fitted.
    pub samples: usize,
    /// χ² of the readings over the degrees of freedom; 1 where the model describes the sky to within the noise.
    pub reduced_chi2: f64,
    /// Root mean square of (reading − model)/model.
    pub relative_rms: f64,
    /// What became of every pixel (see [`picture`]).
    pub fate: Vec<f32>,
    /// Mean squared residual of a pixel's channels, in units of the noise; NaN where the pixel is not used.
    pub pixel_chi2: Vec<f32>,
    /// (reading − model)/model, channel by channel; NaN where unseen.
    pub residuals: Vec<Vec<f32>>,
    /// How many pixels were left out because they show no clear sky.
    pub outliers: usize,
    /// How many different suns the descents ended at.
    pub minima: usize,
    /// How many descents failed.
    pub failed: usize,
    /// The descent that the results come from.
    pub fit: Fit,
    /// The steps of the search over starts.
    pub search: Trace,
    /// Whether the model describes the sky to within the noise.
    pub described: bool,
    /// Which of the results can be relied on.
    pub status: Status,
}

/// What the sun's direction was taken from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SunSource {
    /// The brightness of the whole sky.
    Sky,
    /// The sun's disk.
    Disk,
}

impl SunSource {
    /// Its name in `fit.toml` and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            SunSource::Sky => "sky",
            SunSource::Disk => "disk",
        }
    }
}

/// Where the noise is known from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoiseSource {
    /// Stated by the user.
    Stated,
    /// Estimated from the scatter of neighbouring pixels.
    Neighbours,
    /// Unknown: errors are scaled by the residuals, and a misfit cannot be detected.
    Residuals,
}

impl NoiseSource {
    /// Its name in `fit.toml`.
    pub fn name(self) -> &'static str {
        match self {
            NoiseSource::Stated => "stated",
            NoiseSource::Neighbours => "from neighbouring pixels",
            NoiseSource::Residuals => "from the residuals: a misfit cannot be seen",
        }
    }
}

/// Readings that are further off than this many standard deviations are left out.
const CUT: f64 = 4.5;
/// Largest number of rounds of leaving out and fitting again.
const ROUNDS: usize = 12;
/// Largest number of readings that are fitted; of larger pictures every n-th pixel is used.
pub const MOST_PIXELS: usize = 20_000;
/// An angle is determined where its standard error is below this (rad): 3°.
const ANGLE_KNOWN: f64 = 0.052_36;
/// Another sun fits as well where χ² rises by less than this.
const AS_GOOD: f64 = 9.0;

/// The sky's sun and the disk are the same where they are this many standard errors apart, or closer than half a
/// degree.
const SAME: f64 = 4.0;
const SAME_ANGLE: f64 = 0.009;
/// Another sky than the model's may put its sun this far from the true one (rad); one that is further off is no sky of
/// this sun.
const ASTRAY: f64 = 0.6;

/// Fits a panorama; `noise` is the relative standard error of a reading where it is known.
///
/// # Errors
/// Why nothing can be fitted, in words.
pub fn fit(picture: &PanoramaReadings, noise: Option<f64>) -> Result<PanoramaFit, String> {
    let sky = fit_with(picture, noise, None);
    let Ok(disk) = picture.disk else { return sky };
    let held = || fit_with(picture, noise, Some(disk));
    let Ok(sky) = sky else { return held() };
    let [z, a] = [sky.sun_zenith, sky.sun_azimuth];
    let apart = angle(disk.direction, turned(sun_direction(z.value), a.value));
    let described = sky.described && sky.noise_from != NoiseSource::Residuals && !sky.status.leaves_open(NAMES[0]);
    let error = z.error.hypot(a.error * z.value.sin());
    let same = apart <= SAME_ANGLE.max(SAME * disk.error.hypot(error));
    if described && same && error <= disk.error {
        return Ok(sky);
    }
    if (described && !same) || (apart > ASTRAY && !disk.certain()) {
        return Ok(outcome::disputed(sky, &disk, apart));
    }
    held().or(Ok(sky))
}

/// Fits a panorama whose sun is known from its disk, or is to be found.
fn fit_with(picture: &PanoramaReadings, noise: Option<f64>, disk: Option<PanoramaDisk>) -> Result<PanoramaFit, String> {
    if let Some(n) = noise.filter(|n| !(*n > 0.0 && *n < 1.0)) {
        return Err(format!("--noise is {n}; expected more than 0 and less than 1 (relative to a reading)"));
    }
    let (level, from) = match (noise, picture.scatter) {
        (Some(n), _) => (n, NoiseSource::Stated),
        (None, Some(n)) => (n, NoiseSource::Neighbours),
        (None, None) => (0.02, NoiseSource::Residuals),
    };
    let known = if from == NoiseSource::Residuals { ResidualNoise::Estimated } else { ResidualNoise::Known };
    let channels = picture.channels;
    let step = picture.pixels.len().div_ceil(MOST_PIXELS).max(1);
    let pixels: Vec<PanoramaPixel> = picture.pixels.iter().copied().step_by(step).collect();
    let floor = 0.02 * median_of(pixels.iter().flat_map(|p| p.value[..channels].to_vec())).unwrap_or(f64::NAN);
    let weights = ResidualWeights { noise: level, floor, known };
    let starts =
        disk.map_or_else(|| start::find(picture, level), |disk| start::held(picture, disk.zenith(), disk.azimuth()));
    let Some(first) = starts.guesses.first().copied() else {
        return Err("no sky of the model comes near this panorama".into());
    };
    let mut guess = first;
    let mut kept = vec![true; pixels.len()];
    let mut values = vec![0.0; pixels.len() * channels];
    // For every pixel, the standardised residual z of its worst channel, for a given sun.
    let misses = |chart: SunChart, p: &[f64], values: &mut [f64]| -> Vec<f64> {
        modelled(chart, p, &pixels, channels, values);
        pixels
            .iter()
            .zip(values.chunks_exact(channels))
            .map(|(pixel, m)| {
                (0..channels).map(|k| ((m[k] - pixel.value[k]) / (level * m[k].hypot(floor))).abs()).fold(0.0, f64::max)
            })
            .collect()
    };
    // The median of the largest of this many absolute normal deviates.
    let typical = if channels == 3 { 1.2568 } else { 0.6745 };
    let choose = |z: &[f64]| -> Vec<bool> {
        let spread = (median_of(z.iter().copied()).unwrap_or(f64::NAN) / typical)
            .max(if from == NoiseSource::Residuals { 1e-3 } else { 1.0 });
        z.iter().map(|z| *z <= CUT * spread).collect()
    };
    let chart = SunChart::at(guess.zenith, guess.azimuth);
    kept.copy_from_slice(&choose(&misses(chart, &chart.start(&guess), &mut values)));
    let mut last: Option<DescentRound> = None;
    for _ in 0..ROUNDS {
        if kept.iter().filter(|k| **k).count() * channels < 8 {
            return Err("hardly a pixel fits any sky of the model".into());
        }
        let round = descend(&pixels, &kept, channels, &guess, weights, disk.is_some());
        if !round.fit.converged() {
            return Err(format!("the fit stopped without a result: {}", round.fit.termination.name()));
        }
        let p = &round.fit.params;
        let (zenith, azimuth) = round.chart.sun(p);
        let next = PanoramaGuess { zenith, azimuth, turbidity: p[2], scale: p[3].exp(), cost: round.fit.cost };
        let now = choose(&misses(round.chart, p, &mut values));
        let still = now == kept;
        // The weights are those of the start: one more descent is made where the parameters moved.
        let moved = (next.scale / guess.scale - 1.0)
            .abs()
            .max((next.turbidity - guess.turbidity).abs())
            .max((next.zenith - guess.zenith).abs());
        (guess, kept, last) = (next, now, Some(round));
        if still && moved < 1e-4 {
            break;
        }
    }
    let Some(round) = last else { return Err("nothing was fitted".into()) };
    // Descents to other suns, on the same pixels.
    let used = |g: &PanoramaGuess| descend(&pixels, &kept, channels, g, weights, disk.is_some());
    let own = turned(sun_direction(guess.zenith), guess.azimuth);
    let mut rival = None;
    for g in starts.guesses.iter().skip(1) {
        let r = used(g);
        let (zenith, azimuth) = r.chart.sun(&r.fit.params);
        if !r.fit.converged() || angle(own, turned(sun_direction(zenith), azimuth)) < ANGLE_KNOWN {
            continue;
        }
        let scale = round.fit.uncertainty.reduced_chi2.max(1.0)
            * if from == NoiseSource::Residuals { round.fit.uncertainty.reduced_chi2 } else { 1.0 };
        if 2.0 * (r.fit.cost - round.fit.cost) < AS_GOOD * scale {
            rival = Some((zenith, azimuth));
        }
    }
    // What the disk's own error does to turbidity and scale: descents with the sun beside its place.
    let beside = disk.map(|disk| {
        [[disk.error, 0.0], [0.0, disk.error / guess.zenith.sin().max(disk.error)]].map(|[dz, da]| {
            let moved = PanoramaGuess { zenith: guess.zenith + dz, azimuth: guess.azimuth + da, ..guess };
            let p = used(&moved).fit.params;
            [p[2] - round.fit.params[2], p[3] - round.fit.params[3]]
        })
    });
    let sun = disk.zip(beside);
    let pixels = FittedPixels { pixels: &pixels, kept: &kept, values };
    Ok(finished(picture, pixels, round, rival, (level, from), &starts, sun))
}

/// Names of the four results, in order.
pub const NAMES: [&str; 4] = ["sun_zenith_deg", "sun_azimuth_deg", "turbidity", "scale"];

/// How a fit ended, for the record.
pub fn termination(result: &Result<PanoramaFit, String>) -> Termination {
    result.as_ref().map_or(Termination::Refused, |f| f.fit.termination)
}

/// How many pixels have this fate.
pub fn count(fate: &[f32], which: f32) -> usize {
    fate.iter().filter(|f| **f == which).count()
}

/// Pixels that the sensor clipped.
pub fn clipped(found: &PanoramaFit) -> usize {
    count(&found.fate, CLIPPED)
}
