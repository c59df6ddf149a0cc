//! A simulated measurement: texels of a leaf are read by planned and by even frames, with noise, and fitted.

use crate::beam::charts::{Picture, draw};
use crate::bench::BenchRow;
use crate::{Error, Result};
use mesophyll_base::statistics::median_of;
use mesophyll_files::atomic;
use mesophyll_fits::design::tube::{DesignTexel, GlossFitTruth, TexelQuantity, TubeDesign, TubePlace};
use mesophyll_fits::gloss::GlossTexelFitter;
use mesophyll_fits::gloss::synthetic::{GaussianDeviates, LEAF, device, ramp, trace};
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::tube::Travel;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Instant;

/// Numbers of frames.
const FRAMES: [usize; 6] = [16, 25, 36, 50, 100, 200];
/// Places of the tube in each pass.
const PLACES: usize = 100;
/// Scans of every texel.
const SCANS: usize = 150;

/// One set of frames: how many, whether they were planned, the relative error of m that was stated and that which fits
/// to noisy readings had, both as root mean squares over the texels, and the time of a texel's fit (µs).
#[derive(Debug, Clone, Copy)]
struct FrameSet {
    count: usize,
    planned: bool,
    stated: f64,
    seen: f64,
    us: f64,
}

/// The sets, measured once for the table and its picture.
fn measured() -> Result<&'static [FrameSet]> {
    static MEASURED: OnceLock<Vec<FrameSet>> = OnceLock::new();
    if let Some(sets) = MEASURED.get() {
        return Ok(sets);
    }
    let sets = measure()?;
    Ok(MEASURED.get_or_init(|| sets))
}

fn measure() -> Result<Vec<FrameSet>> {
    let device = device(Lobe::Beckmann, 0.01);
    let texel = |(at_mm, m, tilt): &([f64; 2], f64, [f64; 2])| DesignTexel {
        at_mm: *at_mm,
        truth: GlossFitTruth { rho_d: [0.06, 0.12, 0.04], rho_s: [0.04; 3], m: *m, tilt: *tilt },
        noise: device.noise(),
    };
    let pass =
        |pass, from, to| ramp(from, to, PLACES).into_iter().map(move |position_mm| TubePlace { pass, position_mm });
    let design = TubeDesign {
        texels: LEAF.iter().map(texel).collect(),
        places: pass(Travel::X, -400.0, 250.0).chain(pass(Travel::Y, -325.0, 325.0)).collect(),
        wanted: vec![TexelQuantity::RhoS, TexelQuantity::M, TexelQuantity::Normal],
        taken: Vec::new(),
        device,
    };
    let problem = design.problem();
    let no_answer = || Error::Missed("the design has no answer".into());
    let mut out = Vec::new();
    for count in FRAMES {
        let planned = design.choose(&problem, count)?.ok_or_else(no_answer)?.chosen;
        for (planned, chosen) in [(true, planned), (false, design.evenly(count))] {
            let at = |pass| design.of(&chosen, pass).into_iter().map(|k| design.places[k].position_mm).collect();
            let (x, y): (Vec<f64>, Vec<f64>) = (at(Travel::X), at(Travel::Y));
            let fitter = GlossTexelFitter::new(&design.device, &x, Some(&y));
            let (mut stated, mut seen, mut times) = (0.0, 0.0, Vec::new());
            for (k, texel) in design.texels.iter().enumerate() {
                let m = texel.truth.m;
                stated += problem.covariance_of(k, &chosen).ok_or_else(no_answer)?[(6, 6)] / (m * m);
                let mut noise = GaussianDeviates::new(17 + k as u64);
                let mut workspace = fitter.workspace();
                for _ in 0..SCANS {
                    let mut read = |pass, positions: &[f64]| {
                        trace(&design.device, pass, positions, texel.at_mm, &texel.truth, Some(&mut noise))
                    };
                    let (of_x, of_y) = (read(Travel::X, &x), read(Travel::Y, &y));
                    let clock = Instant::now();
                    let fit = fitter.fit(&mut workspace, texel.at_mm, &of_x, Some(&of_y));
                    times.push(clock.elapsed().as_secs_f64() * 1e6);
                    seen += (fit.m / m - 1.0).powi(2) / SCANS as f64;
                }
            }
            let [stated, seen] = [stated, seen].map(|sum| (sum / LEAF.len() as f64).sqrt());
            out.push(FrameSet { count, planned, stated, seen, us: median_of(times).unwrap_or(f64::NAN) });
        }
    }
    Ok(out)
}

/// The rows of `bench design`.
///
/// # Errors
/// A stop that was asked for.
pub fn rows() -> Result<Vec<BenchRow>> {
    let row = |set: &FrameSet| BenchRow {
        model: "design".into(),
        knob: format!("frames, {}", if set.planned { "planned" } else { "even" }),
        setting: set.count.to_string(),
        error: set.seen,
        us: set.us,
        note: format!(
            "relative error of m of fits to {SCANS} scans of {} texels; stated {:.2e}",
            LEAF.len(),
            set.stated
        ),
    };
    Ok(measured()?.iter().map(row).collect())
}

/// Draws `designs.svg`, errors against frames, into a folder.
///
/// # Errors
/// [`Error::Write`] where the file cannot be written.
pub fn pictures(folder: &Path) -> Result<Vec<PathBuf>> {
    let sets = measured()?;
    let curve = |name: &str, planned: bool, error: fn(&FrameSet) -> f64| {
        let points = sets.iter().filter(|set| set.planned == planned).map(|set| (set.count as f64, error(set)));
        (name.to_string(), points.collect())
    };
    let curves = [
        curve("planned: fits to noisy scans", true, |set| set.seen),
        curve("planned: stated", true, |set| set.stated),
        curve("even: fits to noisy scans", false, |set| set.seen),
        curve("even: stated", false, |set| set.stated),
    ];
    let picture = Picture {
        title: "error of m against frames, planned and even",
        x: "frames of both passes",
        y: "relative error of m",
        log_x: false,
        log_y: true,
        curves: &curves,
    };
    let path = folder.join("designs.svg");
    let svg = draw(&picture).map_err(|e| Error::write(&path, e))?;
    atomic::write_bytes(&path, svg.as_bytes())?;
    Ok(vec![path])
}
