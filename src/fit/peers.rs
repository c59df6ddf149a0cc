//! What the peers of `bench --peers` are measured on: the same inputs for them and for us, written as files that their scripts read, and our
//! own row on them. Seeded: the inputs are the same in every run.

use super::bench::slab::larger;
use super::bench::{self, BenchRow, median, median_us};
use super::gloss::TexelFitter;
use super::nist;
use crate::optics::slab;
use crate::{Error, Result};

/// Files for a peer's folder, and our rows on the same inputs.
#[derive(Debug, Clone)]
pub struct Inputs {
    pub files: Vec<(String, String)>,
    pub ours: Vec<BenchRow>,
}

/// Inputs for the peers of a sweep; `None` for one without peers.
///
/// # Errors
/// None in practice: an input that cannot be written as text.
pub fn inputs(sweep: &str) -> Result<Option<Inputs>> {
    Ok(match sweep {
        "solve" => Some(Inputs {
            files: nist::FILES.iter().map(|(name, text)| (format!("{name}.dat"), (*text).to_string())).collect(),
            // The sweep itself has our rows.
            ours: Vec::new(),
        }),
        "slab" => Some(slab_inputs()),
        "gloss" => Some(gloss_inputs()?),
        _ => None,
    })
}

fn ours(model: &str, setting: &str, errors: Vec<f64>, us: f64, note: &str) -> BenchRow {
    let refused = errors.iter().filter(|e| e.is_nan()).count();
    let worst = errors.iter().copied().fold(0.0, f64::max);
    BenchRow {
        model: model.into(),
        knob: "peer".into(),
        setting: setting.into(),
        us,
        note: format!("{} {note}, worst error {worst:.1e}, {refused} refused", errors.len()),
        error: median(errors),
    }
}

/// The 64 slabs of the sweep.
fn slab_inputs() -> Inputs {
    let samples = bench::slab::samples();
    let mut text = String::from("omega,delta,rho_d,rho_t\n");
    for s in &samples {
        let delta = s.sigma_a + s.sigma_s;
        text.push_str(&format!("{},{delta},{},{}\n", s.sigma_s / delta, s.exact.rho_d, s.exact.rho_t));
    }
    let count = samples.len() as f64;
    let forward = |s: &bench::slab::Sample| slab::response(s.sigma_a, s.sigma_s, 1.0);
    let forward_errors = samples.iter().map(|s| {
        let r = forward(s);
        larger((r.rho_d / s.exact.rho_d - 1.0).abs(), (r.rho_t / s.exact.rho_t - 1.0).abs())
    });
    let inverse = |s: &bench::slab::Sample| slab::inverse::invert(s.exact.rho_d, s.exact.rho_t, 1.0, 1e-9, 1e-9);
    let inverse_errors = samples.iter().map(|s| {
        // As the peers are judged: single-scattering albedo and optical thickness.
        let (e, total, truth) = (inverse(s), s.sigma_a + s.sigma_s, s.sigma_s / (s.sigma_a + s.sigma_s));
        let found = e.sigma_a + e.sigma_s;
        larger((e.sigma_s / found / truth - 1.0).abs(), (found / total - 1.0).abs())
    });
    let forward_us = median_us(50.0, || samples.iter().map(|s| forward(s).rho_d).sum::<f64>()) / count;
    let inverse_us = median_us(100.0, || samples.iter().map(|s| inverse(s).sigma_a).sum::<f64>()) / count;
    Inputs {
        ours: vec![
            ours("slab", "mesophyll forward", forward_errors.collect(), forward_us, "rows"),
            ours("slab", "mesophyll inverse", inverse_errors.collect(), inverse_us, "rows"),
        ],
        files: vec![("slab.csv".into(), text)],
    }
}

/// 48 RGB texels of the sweep's device with a thin tube, 100 frames, 1 % noise.
fn gloss_inputs() -> Result<Inputs> {
    let device = bench::gloss::device(0.0);
    let u = bench::gloss::frames(100);
    let texels = bench::gloss::texels(&device, &u, 48, true);
    let positions: Vec<f64> = u.iter().map(|u| u * device.height_mm).collect();
    let (errors, us) = bench::gloss::measure(&TexelFitter::new(&device, &positions, None), &texels, 200.0);
    let value = serde_json::json!({
        "u": u,
        "camera_deg": bench::gloss::CAMERA_DEG,
        "height_mm": device.height_mm,
        "tube_length_mm": device.length_mm,
        "noise_relative": device.noise_relative,
        "noise_floor": device.noise_floor,
        "texels": texels.iter().map(|t| serde_json::json!({ "m": t.m, "trace": t.trace })).collect::<Vec<_>>(),
    });
    let text = serde_json::to_string(&value).map_err(|e| Error::Missed(format!("cannot write JSON: {e}")))?;
    Ok(Inputs {
        files: vec![("gloss.json".into(), text)],
        ours: vec![ours("gloss", "mesophyll", errors, us, "RGB texels, relative error of m")],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_are_the_same_in_every_run_and_hold_what_scripts_read() {
        let (a, b) = (slab_inputs(), slab_inputs());
        assert_eq!(a.files, b.files);
        assert_eq!(a.files[0].1.lines().count(), 65);
        assert!(a.ours.iter().all(|r| r.error < 1e-3 && r.us > 0.0), "{:?}", a.ours);
        let gloss = gloss_inputs().unwrap();
        let value: serde_json::Value = serde_json::from_str(&gloss.files[0].1).unwrap();
        assert_eq!(value["texels"][47]["trace"][99].as_array().unwrap().len(), 3);
        assert!(gloss.ours[0].error < 0.05, "{:?}", gloss.ours);
        assert!(inputs("no such sweep").unwrap().is_none());
    }
}
