//! The statements of a finished fit: the four results with their errors, the fate of every pixel, and which of the
//! results are not determined (because of a misfit beyond the noise, another sun that fits as well, a bound, or too
//! large an error).

use super::descent::{DescentRound, OVERHEAD, SunChart};
use super::disk::PanoramaDisk;
use super::picture::{self, OUTLIER, PanoramaPixel, PanoramaReadings};
use super::{ANGLE_KNOWN, NAMES, NoiseSource, PanoramaEstimate, PanoramaFit, SunSource, start};
use mesophyll_base::solvers::adequacy::{self, Adequacy, ReadingOrder};
use mesophyll_base::solvers::{Fit, ResidualNoise};
use mesophyll_base::statistics::median_of;
use mesophyll_files::table::Status;
use mesophyll_sky::preetham;
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// The misfit is more than noise where reduced χ² is above 1 by this share, where the noise itself was measured.
const EXCESS_MEASURED: f64 = 0.4;

/// The pixels of a fit.
pub struct FittedPixels<'a> {
    pub pixels: &'a [PanoramaPixel],
    /// Whether each was kept.
    pub kept: &'a [bool],
    /// The model's readings there, channel by channel of each pixel.
    pub values: Vec<f64>,
}

/// The result of `round` on the pixels that were kept. `rival` is the zenith and azimuth of a sun that fits as well.
/// `sun`: the disk that the sun was held at, and what its error along the meridian and across does to turbidity and ln
/// scale.
pub fn finished(
    picture: &PanoramaReadings,
    FittedPixels { pixels, kept, values }: FittedPixels,
    round: DescentRound,
    rival: Option<(f64, f64)>,
    (level, from): (f64, NoiseSource),
    starts: &start::PanoramaStarts,
    sun: Option<(PanoramaDisk, [[f64; 2]; 2])>,
) -> PanoramaFit {
    let adequacy = judged(&round, picture.width, from);
    let DescentRound { chart, fit, .. } = round;
    let channels = picture.channels;
    let u = &fit.uncertainty;
    let (zenith, azimuth) = chart.sun(&fit.params);
    // rows: the four results by the four parameters
    let slope: [[f64; 4]; 4] = {
        let scale = fit.params[3].exp();
        let (a, b) = match chart {
            SunChart::Polar(_) => ([1.0, 0.0], [0.0, 1.0]),
            SunChart::Plane => {
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
    // A misfit widens the printed errors, but that does not make the results right.
    let wide = if from == NoiseSource::Residuals { 1.0 } else { u.reduced_chi2.max(1.0).sqrt() };
    let excess = from == NoiseSource::Neighbours && u.freedom > 0 && u.reduced_chi2 > 1.0 + EXCESS_MEASURED;
    let why = match (adequacy.why("sky"), excess) {
        (None, true) => Some(format!(
            "the model does not describe this sky: the residuals are {:.1} times the noise between neighbours",
            u.reduced_chi2.sqrt()
        )),
        (why, _) => why,
    };
    let wide = if excess { wide } else { 1.0 };
    let widening = |k: usize| {
        let first = 4 - adequacy.widening.len().min(4);
        adequacy.widening.get(k.wrapping_sub(first)).copied().unwrap_or(1.0).max(wide)
    };
    let error = |k: usize| {
        let v = covariance(k, k);
        // The sun's two numbers mix two parameters where it stands overhead.
        let wider = if k < 2 { widening(0).max(widening(1)) } else { widening(k) };
        let own = if v >= 0.0 { wider * v.sqrt() } else { f64::INFINITY };
        match sun {
            Some((disk, _)) if k == 0 => disk.error,
            Some((disk, _)) if k == 1 => disk.error / zenith.sin().max(1e-9),
            Some((_, [a, b])) => {
                let unit = slope[k][k];
                own.hypot(unit * a[k - 2]).hypot(unit * b[k - 2])
            }
            None => own,
        }
    };
    let turn = (azimuth + PI).rem_euclid(2.0 * PI) - PI;
    let sun_zenith = PanoramaEstimate { value: zenith, error: error(0) };
    let sun_azimuth = PanoramaEstimate { value: turn, error: error(1) };
    let turbidity = PanoramaEstimate { value: fit.params[2], error: error(2) };
    let scale = PanoramaEstimate { value: fit.params[3].exp(), error: error(3) };
    let correlated = |i: usize, j: usize| match sun {
        Some(_) if i < 2 || j < 2 => f64::from(u8::from(i == j)),
        _ => covariance(i, j) / (covariance(i, i) * covariance(j, j)).sqrt(),
    };
    let correlation = (0..4).map(|i| (0..4).map(|j| correlated(i, j)).collect()).collect();

    let mut fate = picture.fate.clone();
    let mut pixel_chi2 = vec![f32::NAN; fate.len()];
    let mut residuals = vec![vec![f32::NAN; fate.len()]; channels];
    let mut squares = 0.0;
    let mut samples = 0;
    let sampled: Vec<usize> = pixels.iter().map(|p| p.at).collect();
    // Pixels that were seen but left out when a large picture was thinned.
    for p in &picture.pixels {
        fate[p.at] = picture::HIDDEN;
    }
    let floor = 0.02 * median_of(pixels.iter().flat_map(|p| p.value[..channels].to_vec())).unwrap_or(f64::NAN);
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
    let described = why.is_none();
    let status = status(&fit, chart, [sun_zenith, sun_azimuth, turbidity, scale], why, rival, sun.is_some());
    PanoramaFit {
        sun_zenith,
        sun_azimuth,
        turbidity,
        scale,
        sun_from: if sun.is_some() { SunSource::Disk } else { SunSource::Sky },
        disk: picture.disk,
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
        described,
        status,
        fit,
    }
}

/// Whether the residuals are noise: their size where the noise is stated, and patterns along the rows and columns of
/// the picture.
fn judged(round: &DescentRound, width: usize, from: NoiseSource) -> Adequacy {
    // Readings of one channel, by the row or column of their pixels.
    let channels = round.places.windows(2).take_while(|p| p[0] == p[1]).count() + 1;
    let runs = |line: &dyn Fn(usize) -> usize| {
        let mut runs: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
        for (k, at) in round.places.iter().enumerate() {
            runs.entry((line(*at), k % channels)).or_default().push(k);
        }
        runs.into_values().collect::<Vec<_>>()
    };
    let along = [
        ReadingOrder { name: "rows of the picture", runs: runs(&|at| at / width) },
        ReadingOrder { name: "columns of the picture", runs: runs(&|at| at % width) },
    ];
    adequacy::judge(&adequacy::SolutionResiduals {
        residuals: &round.fit.residuals,
        jacobian: &round.jacobian,
        noise: if from == NoiseSource::Stated { ResidualNoise::Known } else { ResidualNoise::Estimated },
        floor: 0.0,
        along: &along,
    })
}

/// A sky whose sun and the disk are two different places.
pub fn disputed(found: PanoramaFit, disk: &PanoramaDisk, apart: f64) -> PanoramaFit {
    let degrees = f64::to_degrees;
    let why = format!(
        "a bright disk at zenith {:.1}, azimuth {:.1} is {:.0} degrees from where the sky's brightness puts the sun: \
         is it a lamp or a reflection, or is this no clear sky?",
        degrees(disk.zenith()),
        degrees(disk.azimuth()),
        degrees(apart),
    );
    PanoramaFit { status: Status::undetermined(NAMES, &why), ..found }
}

fn status(
    fit: &Fit,
    chart: SunChart,
    known: [PanoramaEstimate; 4],
    misfit: Option<String>,
    rival: Option<(f64, f64)>,
    held: bool,
) -> Status {
    if let Some(why) = misfit {
        let sure = |k: usize| held && k < 2 && known[k].error <= ANGLE_KNOWN;
        let open = (0..4).filter(|k| !sure(*k)).map(|k| NAMES[k]);
        let sun = if held { "; the sun is where its disk is seen" } else { "" };
        return Status::undetermined(open, &format!("{why}{sun}"));
    }
    let mut unknown: Vec<String> = Vec::new();
    if let Some((z, a)) = rival {
        unknown.push(format!(
            "{}; {} (a sun at {:.1}, {:.1} fits as well)",
            NAMES[0],
            NAMES[1],
            z.to_degrees(),
            a.to_degrees()
        ));
    }
    let [zenith, azimuth, turbidity, scale] = known;
    if rival.is_none() {
        let on_horizon = matches!(chart, SunChart::Polar(_)) && fit.at_bound.contains(&0) && zenith.value > 1.0;
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
    Status::undetermined(unknown, "")
}
