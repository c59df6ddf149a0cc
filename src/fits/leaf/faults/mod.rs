//! Faults of the measurement, by the pattern that they leave in the readings: over frames, over place, over the value,
//! between passes, between sides, and in the white frames, the light box and the mirror strip. Each is named with its
//! file or field and its likely cause, so that nobody has to guess why a fit is not good.
//!
//! Every limit follows from the scatter of what is compared (so many standard errors, so many scatters of the other
//! frames) and from what would matter (a share of the light). None is fitted to an outcome.

pub mod bias;
mod boxes;
mod causes;
mod frames;
mod movement;
mod refit;
mod sample;
mod sentences;
pub mod transmittance;
mod trials;
mod white_frames;

pub use bias::TrialBias;

use crate::Result;
use crate::leaf::interior::LeafSideFit;
use crate::leaf::noise::CameraNoise;
use crate::record::THICKNESS_FAULT;
use crate::record::fault::{FaultGrade, MeasurementFault};
use crate::record::scan::ScanRecord;
use mesophyll_base::statistics::{NORMAL_MEDIAN, median_of};
use mesophyll_capture::inspection::{TubeInspection, mirror};
use mesophyll_capture::reader::TubeCapture;
use mesophyll_optics::tube::Travel;
use sample::TexelSample;
use trials::FaultTrials;

/// Thickness (mm) of leaves: filmy ferns have .01, succulents some millimetres.
const THICKNESS_MM: std::ops::RangeInclusive<f64> = 0.01..=8.0;

/// Noise is known to this share.
const NOISE: f64 = 0.1;

/// What was found in a scan.
#[derive(Debug, Default)]
pub struct ScanFindings {
    /// The faults, each once.
    pub faults: Vec<MeasurementFault>,
    /// For each side, how far the fitted texels are from those under the cause that explains its traces.
    pub bias: Vec<TrialBias>,
    /// For each side, the residuals over the noise where no cause explains them; 1 elsewhere.
    pub scale: Vec<f64>,
    /// Noise of the readings over the stated noise, from the differences between neighbouring texels. They share the
    /// error of a wrong model, so the difference has little of it. One for each side; `None` where there are too few.
    pub noise: Vec<Option<f64>>,
}

/// Looks for faults in everything that a fit has read.
///
/// # Errors
/// Frames that cannot be read.
pub fn look(
    capture: &TubeCapture,
    scan: &ScanRecord,
    level: &CameraNoise,
    sides: &[LeafSideFit],
) -> Result<ScanFindings> {
    let mut out = ScanFindings::default();
    let m = &capture.manifest;
    let names: Vec<&str> = sides.iter().map(|s| s.side.name()).collect();
    let whites = white_frames::look(capture, level);
    let boxes = boxes::look(capture, level, sides)?;
    let coarse = boxes.iter().any(|f| f.name == "few-values");
    let (mut single, mut causes, mut rest) = (Vec::new(), Vec::new(), Vec::new());
    for fitted in sides {
        let Some(sample) = TexelSample::read(capture, scan, fitted, level)? else {
            out.bias.push(TrialBias::default());
            out.scale.push(1.0);
            out.noise.push(None);
            continue;
        };
        let found = frames::look(&sample);
        let noise = noise(&sample);
        out.noise.push(noise);
        let wrong = |travel: Travel, frame: usize| found.iter().any(|f| f.travel == travel && f.frame == frame);
        let dark = sample.texels.iter().map(|t| capture.dark_at(*t)).collect();
        let trials = FaultTrials::new(scan, &sample, dark, noise.unwrap_or(1.0).max(1.0).powi(2), wrong);
        single.extend(found);
        if coarse || !whites.causes.is_empty() {
            // The traces are off for a reason that is known.
            out.bias.push(TrialBias::default());
            out.scale.push(trials.before().sqrt().max(1.0));
            continue;
        }
        let outcome = trials.search();
        out.scale.push(if outcome.unexplained { outcome.before.sqrt() } else { 1.0 });
        out.bias.push(outcome.bias);
        if outcome.unexplained {
            let moved = movement::look(&sample, &trials, m.texel_mm);
            rest.push(moved.unwrap_or_else(|| sentences::unexplained(fitted.side, &outcome)));
        }
        causes.push((fitted.side, outcome));
    }
    out.faults.extend(sentences::faults(&causes, scan, m, &whites));
    if coarse || out.faults.iter().any(|f| f.grade == FaultGrade::Wrong) {
        // Frames stand out for the same reason; those without readings, or with those of another, for their own.
        use frames::FrameDefect::{Copy, Repeated, Unread};
        single.retain(|f| matches!(f.wrong, Unread(_) | Copy(_) | Repeated(_)));
    }
    out.faults.extend(rest);
    out.faults.extend(boxes);
    out.faults.extend(frames::faults(&single, !whites.absent));
    out.faults.extend(thickness("thickness_mm", m.thickness_mm, &names));
    out.faults.extend(mirror(capture, sides));
    out.faults.extend(stated_noise(level, &out.noise, sides));
    // The worst comes first. A back that was not turned is why its images seem mirrored.
    out.faults.sort_by_key(|f| (std::cmp::Reverse(f.grade), f.name != "back-not-turned"));
    Ok(out)
}

/// A thickness that no leaf has, of a field of capture.toml or a scan of the leaf's height.
pub fn thickness(what: &str, h: f64, sides: &[&str]) -> Option<MeasurementFault> {
    let guess = if h > *THICKNESS_MM.end() { "µm or tenths of a mm taken for mm" } else { "cm or m taken for mm" };
    (!THICKNESS_MM.contains(&h)).then(|| {
        transmittance::fault(
            THICKNESS_FAULT,
            FaultGrade::Wrong,
            sides,
            &["sigma_a", "sigma_s", "thickness"],
            format!(
                "capture.toml: {what} is {h}, and leaves are {} to {} mm thick ({guess}?); σa and σs are in inverse \
                 proportion to it",
                THICKNESS_MM.start(),
                THICKNESS_MM.end()
            ),
        )
    })
}

/// Noise that is not as stated, by the traces' roughness and by the differences of neighbouring texels.
fn stated_noise(level: &CameraNoise, beside: &[Option<f64>], sides: &[LeafSideFit]) -> Option<MeasurementFault> {
    let beside: Vec<f64> = beside.iter().flatten().copied().collect();
    let rough = level.seen.filter(|_| !beside.is_empty())?;
    // Each of the two may be larger than the noise for another reason, so the smaller one is believed; pictures that
    // were resampled have neighbours that share noise, so noise that seems smaller is believed of both together only.
    let least = beside.iter().copied().fold(rough, f64::min);
    let most = beside.iter().copied().fold(rough, f64::max);
    let (name, off) = if least > 1.0 + NOISE {
        ("noise-understated", least)
    } else if most < 1.0 - NOISE {
        ("noise-overstated", most)
    } else {
        return None;
    };
    let effect = if off > 1.0 { "errors are too small by as much" } else { "errors are too large by as much" };
    Some(MeasurementFault {
        name: name.into(),
        grade: FaultGrade::Doubtful,
        sides: sides.iter().map(|s| s.side.name().into()).collect(),
        spoils: Vec::new(),
        says: format!(
            "capture.toml: the readings scatter {off:.2} times as much as noise_relative and noise_floor say, from \
             frame to frame and from texel to texel, whatever their model; {effect}"
        ),
    })
}

/// A mirror strip that contradicts the stated device.
fn mirror(capture: &TubeCapture, sides: &[LeafSideFit]) -> Option<MeasurementFault> {
    let mut looked = TubeInspection::default();
    mirror::look(&capture.folder, &capture.manifest, &mut looked);
    looked.mirror.iter().any(|check| !check.agrees).then(|| MeasurementFault {
        name: "mirror".into(),
        grade: FaultGrade::Wrong,
        sides: sides.iter().map(|s| s.side.name().into()).collect(),
        spoils: ["rho_s", "m", "normal"].map(String::from).to_vec(),
        says: looked.warnings.join("; ").replace(&format!("{}/", capture.folder.display()), ""),
    })
}

/// Noise over the stated noise: the robust scatter of differences between residuals of neighbouring texels.
fn noise(sample: &TexelSample) -> Option<f64> {
    let mut differences = Vec::new();
    for pass in &sample.passes {
        for (n, beside) in sample.beside.iter().enumerate() {
            for next in beside.iter().flatten() {
                // Every third frame is enough.
                for k in (n % 3..pass.frames()).step_by(3) {
                    let ((a, va), (b, vb)) = (pass.of(n, k), pass.of(*next, k));
                    for c in 0..3 {
                        let d = sample.residual(n, c, a[c], va[c]) - sample.residual(*next, c, b[c], vb[c]);
                        if d.is_finite() {
                            differences.push(d.abs());
                        }
                    }
                }
            }
        }
    }
    if differences.len() < 1000 {
        return None;
    }
    Some(median_of(differences)? / NORMAL_MEDIAN / std::f64::consts::SQRT_2)
}
