//! The model's readings as a function of four parameters, and a descent from one guess of them.

use super::picture::PanoramaPixel;
use super::start::{PanoramaGuess, angle, turned};
use mesophyll_base::solvers::{ClosureProblem, Fit, Options, ResidualNoise, Uncertainty, jacobian, lm};
use mesophyll_sky::preetham::{self, PreethamTurbidity, xyz_from_separable};
use mesophyll_sky::{colour, sun_direction};
use nalgebra::DMatrix;
use std::f64::consts::{FRAC_PI_2, PI};

/// How the sun's direction is written as two parameters: as angles, or as a point of a plane near the zenith, where the
/// azimuth has no meaning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SunChart {
    /// Zenith angle, and azimuth relative to this one.
    Polar(f64),
    /// Zenith angle times cosine and sine of the azimuth.
    Plane,
}

/// Suns closer to the zenith than this are fitted in the plane.
pub const OVERHEAD: f64 = 0.3;

impl SunChart {
    pub fn at(zenith: f64, azimuth: f64) -> SunChart {
        if zenith < OVERHEAD { SunChart::Plane } else { SunChart::Polar(azimuth) }
    }

    pub fn sun(self, p: &[f64]) -> (f64, f64) {
        match self {
            SunChart::Polar(_) => (p[0], p[1]),
            SunChart::Plane => (p[0].hypot(p[1]), p[1].atan2(p[0])),
        }
    }

    pub fn start(self, g: &PanoramaGuess) -> Vec<f64> {
        let [low, high] = preetham::TURBIDITIES;
        let t = g.turbidity.clamp(low, high);
        match self {
            SunChart::Polar(_) => vec![g.zenith, g.azimuth, t, g.scale.ln()],
            SunChart::Plane => vec![g.zenith * g.azimuth.cos(), g.zenith * g.azimuth.sin(), t, g.scale.ln()],
        }
    }

    pub fn bounds(self) -> (Vec<f64>, Vec<f64>) {
        let [low, high] = preetham::TURBIDITIES;
        match self {
            SunChart::Polar(middle) => {
                (vec![0.02, middle - PI, low, f64::NEG_INFINITY], vec![FRAC_PI_2, middle + PI, high, f64::INFINITY])
            }
            SunChart::Plane => (vec![-0.8, -0.8, low, f64::NEG_INFINITY], vec![0.8, 0.8, high, f64::INFINITY]),
        }
    }
}

/// The model's readings of every pixel, channel by channel.
pub fn modelled(chart: SunChart, p: &[f64], pixels: &[PanoramaPixel], channels: usize, out: &mut [f64]) {
    let (zenith, azimuth) = chart.sun(p);
    let sun = turned(sun_direction(zenith), azimuth);
    let turbid = PreethamTurbidity::new(p[2]);
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

/// One descent on the pixels that are kept, with weights from the model at its start.
pub struct DescentRound {
    pub chart: SunChart,
    /// The fit of all four parameters.
    pub fit: Fit,
    /// Derivatives of the residuals to the parameters that were fitted, at the solution.
    pub jacobian: Vec<f64>,
    /// For every residual, the place of its pixel: row · width + column.
    pub places: Vec<usize>,
}

/// How residuals are weighted.
#[derive(Clone, Copy)]
pub struct ResidualWeights {
    /// Standard deviation of a residual, relative to the model's reading with `floor`.
    pub noise: f64,
    /// What is added to the model's reading, in quadrature.
    pub floor: f64,
    /// Whether the noise is known.
    pub known: ResidualNoise,
}

/// `held`: whether the sun stays where the guess has it; then its two parameters have no error.
pub fn descend(
    pixels: &[PanoramaPixel],
    kept: &[bool],
    channels: usize,
    guess: &PanoramaGuess,
    weights: ResidualWeights,
    held: bool,
) -> DescentRound {
    let ResidualWeights { noise, floor, known } = weights;
    let chart = SunChart::at(guess.zenith, guess.azimuth);
    let start = chart.start(guess);
    // The first parameters that are fitted.
    let first = if held { 2 } else { 0 };
    let used: Vec<PanoramaPixel> = pixels.iter().zip(kept).filter(|(_, k)| **k).map(|(p, _)| *p).collect();
    let mut sigma = vec![0.0; used.len() * channels];
    modelled(chart, &start, &used, channels, &mut sigma);
    sigma.iter_mut().for_each(|s| *s = noise * s.hypot(floor));
    let problem = ClosureProblem::new(4 - first, used.len() * channels, |p: &[f64], r: &mut [f64]| {
        let p = [&start[..first], p].concat();
        modelled(chart, &p, &used, channels, r);
        for (i, r) in r.iter_mut().enumerate() {
            *r = (*r - used[i / channels].value[i % channels]) / sigma[i];
        }
    });
    let (lower, upper) = chart.bounds();
    let options = Options {
        lower: lower[first..].to_vec(),
        upper: upper[first..].to_vec(),
        noise: known,
        max_iterations: 200,
        step_tolerance: 1e-8,
        cost_tolerance: 1e-10,
        ..Options::default()
    };
    let mut fit = lm::minimize(&problem, &start[first..], &options);
    let (m, n) = (fit.residuals.len(), 4 - first);
    let mut inner = vec![0.0; m * n];
    if fit.converged() {
        jacobian::numeric(&problem, &fit.params, &options.lower, &options.upper, &mut inner);
    }
    if held {
        fit = with_sun(fit, &start);
    }
    DescentRound { chart, fit, jacobian: inner, places: places(pixels, kept, channels) }
}

/// A fit of turbidity and scale, with the two parameters of the sun put before them.
fn with_sun(fit: Fit, start: &[f64]) -> Fit {
    let u = fit.uncertainty;
    let covariance = DMatrix::from_fn(4, 4, |i, j| if i < 2 || j < 2 { 0.0 } else { u.covariance[(i - 2, j - 2)] });
    let uncertainty = Uncertainty {
        covariance,
        stderr: [&[0.0; 2], &u.stderr[..]].concat(),
        undetermined: u.undetermined.iter().map(|k| k + 2).collect(),
        directions: u.directions.iter().map(|d| [&[0.0; 2], &d[..]].concat()).collect(),
        ..u
    };
    Fit {
        params: [&start[..2], &fit.params[..]].concat(),
        at_bound: fit.at_bound.iter().map(|k| k + 2).collect(),
        uncertainty,
        ..fit
    }
}

/// For every residual its pixel's place in the picture.
fn places(pixels: &[PanoramaPixel], kept: &[bool], channels: usize) -> Vec<usize> {
    let used = pixels.iter().zip(kept).filter(|(_, k)| **k);
    used.flat_map(|(p, _)| std::iter::repeat_n(p.at, channels)).collect()
}
