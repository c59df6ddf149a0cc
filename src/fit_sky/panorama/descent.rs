//! The model's readings as a function of four parameters, and a descent from one guess of them.

use super::picture::Pixel;
use super::start::{Guess, angle, turned};
use mesophyll_sky::preetham::{self, Turbid, xyz_from_separable};
use mesophyll_sky::{colour, sun_direction};
use mesophyll_solve::{Closure, Fit, Noise, Options, lm};
use std::f64::consts::{FRAC_PI_2, PI};

/// How the sun's direction is written as two parameters: as angles, or as a point of a plane near the zenith, where the
/// azimuth has no meaning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Chart {
    /// Zenith angle, and azimuth relative to this one.
    Polar(f64),
    /// Zenith angle times cosine and sine of the azimuth.
    Plane,
}

/// Suns closer to the zenith than this are fitted in the plane.
pub const OVERHEAD: f64 = 0.3;

impl Chart {
    pub fn at(zenith: f64, azimuth: f64) -> Chart {
        if zenith < OVERHEAD { Chart::Plane } else { Chart::Polar(azimuth) }
    }

    pub fn sun(self, p: &[f64]) -> (f64, f64) {
        match self {
            Chart::Polar(_) => (p[0], p[1]),
            Chart::Plane => (p[0].hypot(p[1]), p[1].atan2(p[0])),
        }
    }

    pub fn start(self, g: &Guess) -> Vec<f64> {
        let [low, high] = preetham::TURBIDITIES;
        let t = g.turbidity.clamp(low, high);
        match self {
            Chart::Polar(_) => vec![g.zenith, g.azimuth, t, g.scale.ln()],
            Chart::Plane => vec![g.zenith * g.azimuth.cos(), g.zenith * g.azimuth.sin(), t, g.scale.ln()],
        }
    }

    pub fn bounds(self) -> (Vec<f64>, Vec<f64>) {
        let [low, high] = preetham::TURBIDITIES;
        match self {
            Chart::Polar(middle) => {
                (vec![0.02, middle - PI, low, f64::NEG_INFINITY], vec![FRAC_PI_2, middle + PI, high, f64::INFINITY])
            }
            Chart::Plane => (vec![-0.8, -0.8, low, f64::NEG_INFINITY], vec![0.8, 0.8, high, f64::INFINITY]),
        }
    }
}

/// The model's readings of every pixel, channel by channel.
pub fn modelled(chart: Chart, p: &[f64], pixels: &[Pixel], channels: usize, out: &mut [f64]) {
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

/// One descent on the pixels that are kept, with weights from the model at its start.
pub struct Round {
    pub chart: Chart,
    pub fit: Fit,
}

pub fn descend(
    pixels: &[Pixel],
    kept: &[bool],
    channels: usize,
    guess: &Guess,
    noise: f64,
    floor: f64,
    known: Noise,
) -> Round {
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
    let options = Options {
        lower,
        upper,
        noise: known,
        max_iterations: 200,
        step_tolerance: 1e-8,
        cost_tolerance: 1e-10,
        ..Options::default()
    };
    Round { chart, fit: lm::minimize(&problem, &start, &options) }
}
