//! Sun, turbidity and scale from a panorama of the sky: the sky's share of reconstructing a scene.
//!
//! Model: a reading of channel c in direction d is s L_c(d; θs, φs, τ), Preetham's radiance in linear sRGB (kcd/m²) times one scale for all channels:
//! the panorama has to be white-balanced. Its noise is relative: σ = n √(L² + (L₀/50)²) with L₀ the median reading.
//! Unknowns: the sun's zenith angle and azimuth, τ, ln s. Pixels that miss the model by more than [`CUT`] times the scatter are clouds, trees or the
//! sun's disk and are left out, over and over until their set stands still.
//!
//! Limits: one clear sky (no cloud cover), turbidity 1.7 to 10, the sun above the horizon. A sky that Preetham's model does not describe to within the noise
//! leaves nothing determined: the best values are printed, with the misfit.

pub mod picture;
pub mod projection;
pub mod record;
pub mod render;
mod start;
#[cfg(test)]
mod tests;

use crate::files::table::Status;
use crate::sky::preetham::{self, Turbid, xyz_from_separable};
use crate::sky::{colour, sun_direction};
use crate::solve::{Closure, Fit, Noise, Options, Termination, Trace, lm};
use picture::{CLIPPED, OUTLIER, Picture, Pixel, median};
use start::{Guess, angle, turned};
use std::f64::consts::{FRAC_PI_2, PI};

/// A number and its standard error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Known {
    pub value: f64,
    pub error: f64,
}

/// What came out.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Rad.
    pub sun_zenith: Known,
    /// Rad, from +x to +y, −π … π.
    pub sun_azimuth: Known,
    pub turbidity: Known,
    /// Reading of one kcd/m².
    pub scale: Known,
    /// Of the four, in this order; NaN where undetermined.
    pub correlation: Vec<Vec<f64>>,
    /// Relative noise of a reading that the errors stand on, and where it is from.
    pub noise: f64,
    pub noise_from: NoiseFrom,
    /// Readings fitted, χ² over the degrees of freedom, relative RMS of the residuals.
    pub samples: usize,
    pub reduced_chi2: f64,
    pub relative_rms: f64,
    /// Fate of every pixel (see [`picture`]) and its mean squared residual (NaN where unused).
    pub fate: Vec<f32>,
    pub pixel_chi2: Vec<f32>,
    /// (reading − model)/model, channel by channel; NaN where unseen.
    pub residuals: Vec<Vec<f32>>,
    pub outliers: usize,
    /// Suns that descents ended at, and descents that came to nothing.
    pub minima: usize,
    pub failed: usize,
    pub fit: Fit,
    pub search: Trace,
    pub status: Status,
}

/// What is known of the noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoiseFrom {
    /// Stated by the user.
    Stated,
    /// From how neighbouring pixels scatter.
    Neighbours,
    /// Unknown: errors are scaled by the residuals, and a misfit cannot be seen.
    Residuals,
}

impl NoiseFrom {
    pub fn name(self) -> &'static str {
        match self {
            NoiseFrom::Stated => "stated",
            NoiseFrom::Neighbours => "from neighbouring pixels",
            NoiseFrom::Residuals => "from the residuals: a misfit cannot be seen",
        }
    }
}

/// Readings further off than this many standard deviations are left out.
const CUT: f64 = 4.5;
/// Rounds of leaving out and fitting again.
const ROUNDS: usize = 12;
/// Most readings fitted: of larger pictures every n-th pixel is used.
pub const MOST_PIXELS: usize = 20_000;
/// Angles are called determined to within this 1σ (rad): 3°.
const ANGLE_KNOWN: f64 = 0.052_36;
/// Residuals beyond the noise: reduced χ² above 1 by this many of its standard deviations, or by this share where the noise was itself measured.
const EXCESS: f64 = 5.0;
const EXCESS_MEASURED: f64 = 0.4;
/// Another sun is as good where χ² rises by less than this.
const AS_GOOD: f64 = 9.0;

/// How the sun's direction is written in parameters: angles, or near the zenith (where azimuth loses its meaning) a plane.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Chart {
    /// Zenith angle, azimuth about this one.
    Polar(f64),
    /// Zenith angle times cosine and sine of the azimuth.
    Plane,
}

/// Suns nearer to the zenith than this are fitted in the plane.
const OVERHEAD: f64 = 0.3;

impl Chart {
    fn at(zenith: f64, azimuth: f64) -> Chart {
        if zenith < OVERHEAD { Chart::Plane } else { Chart::Polar(azimuth) }
    }

    fn sun(self, p: &[f64]) -> (f64, f64) {
        match self {
            Chart::Polar(_) => (p[0], p[1]),
            Chart::Plane => (p[0].hypot(p[1]), p[1].atan2(p[0])),
        }
    }

    fn start(self, g: &Guess) -> Vec<f64> {
        let [low, high] = preetham::TURBIDITIES;
        let t = g.turbidity.clamp(low, high);
        match self {
            Chart::Polar(_) => vec![g.zenith, g.azimuth, t, g.scale.ln()],
            Chart::Plane => vec![g.zenith * g.azimuth.cos(), g.zenith * g.azimuth.sin(), t, g.scale.ln()],
        }
    }

    fn bounds(self) -> (Vec<f64>, Vec<f64>) {
        let [low, high] = preetham::TURBIDITIES;
        match self {
            Chart::Polar(middle) => (vec![0.02, middle - PI, low, f64::NEG_INFINITY], vec![FRAC_PI_2, middle + PI, high, f64::INFINITY]),
            Chart::Plane => (vec![-0.8, -0.8, low, f64::NEG_INFINITY], vec![0.8, 0.8, high, f64::INFINITY]),
        }
    }
}

/// The model's readings: channel by channel of every pixel.
fn modelled(chart: Chart, p: &[f64], pixels: &[Pixel], channels: usize, out: &mut [f64]) {
    let (zenith, azimuth) = chart.sun(p);
    let sun = turned(sun_direction(zenith), azimuth);
    let turbid = Turbid::new(p[2]);
    let prefactors = turbid.prefactors(zenith);
    let scale = p[3].exp();
    for (pixel, out) in pixels.iter().zip(out.chunks_exact_mut(channels)) {
        let s = turbid.separable(pixel.d[2], angle(pixel.d, sun));
        let xyz = xyz_from_separable(std::array::from_fn(|k| scale * prefactors[k] * s[k]));
        match out {
            [one] => *one = xyz[1],
            many => many.copy_from_slice(&colour::rgb_from_xyz(xyz)[..channels]),
        }
    }
}

/// One descent on the pixels kept, with weights from the model at its start.
struct Round {
    chart: Chart,
    fit: Fit,
}

fn descend(pixels: &[Pixel], kept: &[bool], channels: usize, guess: &Guess, noise: f64, floor: f64, known: Noise) -> Round {
    let chart = Chart::at(guess.zenith, guess.azimuth);
    let start = chart.start(guess);
    let used: Vec<Pixel> = pixels.iter().zip(kept).filter(|(_, k)| **k).map(|(p, _)| *p).collect();
    let mut sigma = vec![0.0; used.len() * channels];
    modelled(chart, &start, &used, channels, &mut sigma);
    sigma.iter_mut().for_each(|s| *s = noise * s.hypot(floor));
    let problem = Closure::new(4, used.len() * channels, |p: &[f64], r: &mut [f64]| {
        modelled(chart, p, &used, channels, r);
        for (i, r) in r.iter_mut().enumerate() {
            *r = (*r - used[i / channels].value[i % channels]) / sigma[i];
        }
    });
    let (lower, upper) = chart.bounds();
    let options =
        Options { lower, upper, noise: known, max_iterations: 200, step_tolerance: 1e-8, cost_tolerance: 1e-10, ..Options::default() };
    Round { chart, fit: lm::minimize(&problem, &start, &options) }
}

/// Fits a panorama; `noise` is the relative standard error of a reading where it is known.
///
/// # Errors
/// Why nothing can be fitted, in words.
pub fn fit(picture: &Picture, noise: Option<f64>) -> Result<Found, String> {
    if let Some(n) = noise.filter(|n| !(*n > 0.0 && *n < 1.0)) {
        return Err(format!("--noise is {n}; expected more than 0 and less than 1 (relative to a reading)"));
    }
    let (level, from) = match (noise, picture.scatter) {
        (Some(n), _) => (n, NoiseFrom::Stated),
        (None, Some(n)) => (n, NoiseFrom::Neighbours),
        (None, None) => (0.02, NoiseFrom::Residuals),
    };
    let known = if from == NoiseFrom::Residuals { Noise::Estimated } else { Noise::Known };
    let channels = picture.channels;
    let step = picture.pixels.len().div_ceil(MOST_PIXELS).max(1);
    let pixels: Vec<Pixel> = picture.pixels.iter().copied().step_by(step).collect();
    let floor = 0.02 * median(&mut pixels.iter().flat_map(|p| p.value[..channels].to_vec()).collect::<Vec<_>>());
    let starts = start::find(picture, level);
    let Some(first) = starts.guesses.first().copied() else {
        return Err("no sky of the model comes near this panorama".into());
    };
    let mut guess = first;
    let mut kept = vec![true; pixels.len()];
    let mut values = vec![0.0; pixels.len() * channels];
    // (z of the worst channel) of every pixel at a sun
    let misses = |chart: Chart, p: &[f64], values: &mut [f64]| -> Vec<f64> {
        modelled(chart, p, &pixels, channels, values);
        pixels
            .iter()
            .zip(values.chunks_exact(channels))
            .map(|(pixel, m)| (0..channels).map(|k| ((m[k] - pixel.value[k]) / (level * m[k].hypot(floor))).abs()).fold(0.0, f64::max))
            .collect()
    };
    // the median of the largest of so many absolute normal deviates
    let typical = if channels == 3 { 1.2568 } else { 0.6745 };
    let choose = |z: &[f64]| -> Vec<bool> {
        let spread = (median(&mut z.to_vec()) / typical).max(if from == NoiseFrom::Residuals { 1e-3 } else { 1.0 });
        z.iter().map(|z| *z <= CUT * spread).collect()
    };
    let chart = Chart::at(guess.zenith, guess.azimuth);
    kept.copy_from_slice(&choose(&misses(chart, &chart.start(&guess), &mut values)));
    let mut last: Option<Round> = None;
    for _ in 0..ROUNDS {
        if kept.iter().filter(|k| **k).count() * channels < 8 {
            return Err("hardly a pixel fits any sky of the model".into());
        }
        let round = descend(&pixels, &kept, channels, &guess, level, floor, known);
        if !round.fit.converged() {
            return Err(format!("the fit stopped without a result: {}", round.fit.termination.name()));
        }
        let p = &round.fit.params;
        let (zenith, azimuth) = round.chart.sun(p);
        let next = Guess { zenith, azimuth, turbidity: p[2], scale: p[3].exp(), cost: round.fit.cost };
        let now = choose(&misses(round.chart, p, &mut values));
        let still = now == kept;
        // weights are the start's: once more where they moved
        let moved =
            (next.scale / guess.scale - 1.0).abs().max((next.turbidity - guess.turbidity).abs()).max((next.zenith - guess.zenith).abs());
        (guess, kept, last) = (next, now, Some(round));
        if still && moved < 1e-4 {
            break;
        }
    }
    let Some(round) = last else { return Err("nothing was fitted".into()) };
    // other suns, on the same pixels
    let used = |g: &Guess| descend(&pixels, &kept, channels, g, level, floor, known);
    let own = turned(sun_direction(guess.zenith), guess.azimuth);
    let mut rival = None;
    for g in starts.guesses.iter().skip(1) {
        let r = used(g);
        let (zenith, azimuth) = r.chart.sun(&r.fit.params);
        if !r.fit.converged() || angle(own, turned(sun_direction(zenith), azimuth)) < ANGLE_KNOWN {
            continue;
        }
        let scale = round.fit.uncertainty.reduced_chi2.max(1.0)
            * if from == NoiseFrom::Residuals { round.fit.uncertainty.reduced_chi2 } else { 1.0 };
        if 2.0 * (r.fit.cost - round.fit.cost) < AS_GOOD * scale {
            rival = Some((zenith, azimuth));
        }
    }
    Ok(finished(picture, &pixels, &kept, round, rival, (level, from), &starts, values))
}

fn finished(
    picture: &Picture,
    pixels: &[Pixel],
    kept: &[bool],
    round: Round,
    rival: Option<(f64, f64)>,
    (level, from): (f64, NoiseFrom),
    starts: &start::Starts,
    values: Vec<f64>,
) -> Found {
    let Round { chart, fit } = round;
    let channels = picture.channels;
    let u = &fit.uncertainty;
    let (zenith, azimuth) = chart.sun(&fit.params);
    // rows: the four results by the four parameters
    let slope: [[f64; 4]; 4] = {
        let scale = fit.params[3].exp();
        let (a, b) = match chart {
            Chart::Polar(_) => ([1.0, 0.0], [0.0, 1.0]),
            Chart::Plane => {
                let r = zenith.max(1e-9);
                ([azimuth.cos(), azimuth.sin()], [-azimuth.sin() / r, azimuth.cos() / r])
            }
        };
        [[a[0], a[1], 0.0, 0.0], [b[0], b[1], 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, scale]]
    };
    let covariance = |i: usize, j: usize| -> f64 {
        let mut sum = 0.0;
        for a in 0..4 {
            for b in 0..4 {
                // products with zero must not spread a NaN
                if slope[i][a] != 0.0 && slope[j][b] != 0.0 {
                    sum += slope[i][a] * u.covariance[(a, b)] * slope[j][b];
                }
            }
        }
        sum
    };
    // A misfit widens what is printed; it does not make it right.
    let wide = if from == NoiseFrom::Residuals { 1.0 } else { u.reduced_chi2.max(1.0).sqrt() };
    let misfit = from != NoiseFrom::Residuals && u.freedom > 0 && {
        let statistical = EXCESS * (2.0 / u.freedom as f64).sqrt();
        u.reduced_chi2 > 1.0 + if from == NoiseFrom::Neighbours { statistical.max(EXCESS_MEASURED) } else { statistical }
    };
    let widen = if misfit { wide } else { 1.0 };
    let error = |k: usize| {
        let v = covariance(k, k);
        if v >= 0.0 { widen * v.sqrt() } else { f64::INFINITY }
    };
    let turn = (azimuth + PI).rem_euclid(2.0 * PI) - PI;
    let sun_zenith = Known { value: zenith, error: error(0) };
    let sun_azimuth = Known { value: turn, error: error(1) };
    let turbidity = Known { value: fit.params[2], error: error(2) };
    let scale = Known { value: fit.params[3].exp(), error: error(3) };
    let correlation = (0..4).map(|i| (0..4).map(|j| covariance(i, j) / (covariance(i, i) * covariance(j, j)).sqrt()).collect()).collect();

    let mut fate = picture.fate.clone();
    let mut pixel_chi2 = vec![f32::NAN; fate.len()];
    let mut residuals = vec![vec![f32::NAN; fate.len()]; channels];
    let mut squares = 0.0;
    let mut samples = 0;
    let sampled: Vec<usize> = pixels.iter().map(|p| p.at).collect();
    // pixels that a large picture's thinning left out were seen and not fitted
    for p in &picture.pixels {
        fate[p.at] = picture::HIDDEN;
    }
    let floor = 0.02 * median(&mut pixels.iter().flat_map(|p| p.value[..channels].to_vec()).collect::<Vec<_>>());
    for (k, at) in sampled.iter().enumerate() {
        fate[*at] = if kept[k] { picture::USED } else { OUTLIER };
        let mut chi2 = 0.0;
        for c in 0..channels {
            let m = values[k * channels + c];
            let r = pixels[k].value[c] - m;
            residuals[c][*at] = (r / m) as f32;
            chi2 += (r / (level * m.hypot(floor))).powi(2) / channels as f64;
            if kept[k] {
                squares += (r / m.hypot(floor)).powi(2);
                samples += 1;
            }
        }
        pixel_chi2[*at] = chi2 as f32;
    }
    let outliers = kept.iter().filter(|k| !**k).count();
    let status = status(&fit, chart, [sun_zenith, sun_azimuth, turbidity, scale], misfit.then_some(u.reduced_chi2), rival);
    Found {
        sun_zenith,
        sun_azimuth,
        turbidity,
        scale,
        correlation,
        noise: level,
        noise_from: from,
        samples,
        reduced_chi2: u.reduced_chi2,
        relative_rms: (squares / samples.max(1) as f64).sqrt(),
        fate,
        pixel_chi2,
        residuals,
        outliers,
        minima: starts.guesses.len(),
        failed: starts.failed,
        search: starts.trace.clone(),
        status,
        fit,
    }
}

/// Names of the four results, in order.
pub const NAMES: [&str; 4] = ["sun_zenith_deg", "sun_azimuth_deg", "turbidity", "scale"];

fn status(fit: &Fit, chart: Chart, known: [Known; 4], misfit: Option<f64>, rival: Option<(f64, f64)>) -> Status {
    if let Some(chi2) = misfit {
        return Status::Undetermined(format!("{} (residuals exceed the noise: reduced chi2 {chi2:.3e})", NAMES.join(" ")));
    }
    let mut unknown: Vec<String> = Vec::new();
    if let Some((z, a)) = rival {
        unknown.push(format!("sun_zenith_deg sun_azimuth_deg (a sun at {:.1}, {:.1} fits as well)", z.to_degrees(), a.to_degrees()));
    }
    let [zenith, azimuth, turbidity, scale] = known;
    if rival.is_none() {
        let on_horizon = matches!(chart, Chart::Polar(_)) && fit.at_bound.contains(&0) && zenith.value > 1.0;
        if on_horizon {
            unknown.push(format!("sun_zenith_deg >= {:.2}", (zenith.value - 2.0 * zenith.error).max(0.0).to_degrees()));
        } else if !(zenith.error <= ANGLE_KNOWN) {
            unknown.push(NAMES[0].into());
        }
        if !(azimuth.error <= ANGLE_KNOWN) {
            unknown.push(if zenith.value < OVERHEAD && zenith.error <= ANGLE_KNOWN {
                format!("{} (the sun is overhead)", NAMES[1])
            } else {
                NAMES[1].into()
            });
        }
    }
    let [low, high] = preetham::TURBIDITIES;
    if fit.at_bound.contains(&2) {
        let lower = turbidity.value < 0.5 * (low + high);
        let bound = turbidity.value + if lower { 2.0 } else { -2.0 } * turbidity.error;
        unknown.push(match bound.is_finite() && (low..=high).contains(&bound) {
            true => format!("turbidity {} {bound:.3}", if lower { "<=" } else { ">=" }),
            false => "turbidity".into(),
        });
    } else if !(turbidity.error <= 0.1 * turbidity.value) {
        unknown.push(NAMES[2].into());
    }
    if !(scale.error <= 0.1 * scale.value) {
        unknown.push(NAMES[3].into());
    }
    if unknown.is_empty() { Status::Ok } else { Status::Undetermined(unknown.join(" ")) }
}

/// How a fit ended, for the record.
pub fn termination(result: &Result<Found, String>) -> Termination {
    result.as_ref().map_or(Termination::Refused, |f| f.fit.termination)
}

/// How many pixels met which fate.
pub fn count(fate: &[f32], which: f32) -> usize {
    fate.iter().filter(|f| **f == which).count()
}

/// Pixels that the sensor clipped.
pub fn clipped(found: &Found) -> usize {
    count(&found.fate, CLIPPED)
}
