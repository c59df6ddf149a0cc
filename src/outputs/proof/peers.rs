//! What the peers of `bench --peers` are measured on: the same inputs for them and for us, written as files that their
//! scripts read, and our own row for these inputs. Seeded, so the inputs are the same in every run.

use crate::bench::{BenchRow, median_us};
use crate::nist;
use crate::slab::bench::{self as slab_bench, ProofSlab, forward_error, larger};
use crate::{Error, Result};
use mesophyll_base::statistics::median_of;
use mesophyll_fits::gloss::{GlossFitDevice, GlossTexelFitter, synthetic};
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::slab;
use mesophyll_optics::tube::Travel;

/// Our time (µs) for the work that a peer's script names.
type OurTime = Box<dyn Fn(&str) -> f64>;

/// Files for a peer's folder, and our rows on the same inputs.
pub struct PeerInputs {
    /// Name and bytes of every file.
    pub files: Vec<(String, Vec<u8>)>,
    /// This program's results for the same inputs.
    pub ours: Vec<BenchRow>,
    /// Where both are measured in turns: our time (µs) for the work that the script names.
    pub turn: Option<OurTime>,
}

/// The certified problems, for the peers of `bench solve`.
///
/// # Errors
/// None.
pub fn nist() -> Result<PeerInputs> {
    Ok(PeerInputs {
        files: nist::FILES.iter().map(|(name, text)| (format!("{name}.dat"), text.as_bytes().to_vec())).collect(),
        // The sweep itself already has our rows.
        ours: Vec::new(),
        turn: None,
    })
}

/// Our row: the median of `errors` (NaN means refused, and counts as the largest).
fn ours(model: &str, setting: &str, errors: Vec<f64>, us: f64, note: &str) -> BenchRow {
    let refused = errors.iter().filter(|e| e.is_nan()).count();
    let worst = errors.iter().copied().fold(0.0, f64::max);
    let note = format!("{} {note}, worst error {worst:.1e}, {refused} refused", errors.len());
    BenchRow {
        model: model.into(),
        knob: "peer".into(),
        setting: setting.into(),
        error: median_of(errors).unwrap_or(f64::NAN),
        us,
        note,
    }
}

/// The 64 slabs of the sweep.
pub fn slab() -> PeerInputs {
    let slabs = slab_bench::slabs();
    let mut text = String::from("omega,delta,rho_d,rho_t\n");
    for s in &slabs {
        text.push_str(&format!("{},{},{},{}\n", s.omega, s.delta, s.exact.rho_d, s.exact.rho_t));
    }
    let count = slabs.len() as f64;
    let forward = |s: &ProofSlab| slab::response(s.sigma_a, s.sigma_s, 1.0);
    let forward_errors = slabs.iter().map(|s| forward_error(s, forward(s)));
    let inverse = |s: &ProofSlab| slab::inverse::invert(s.exact.rho_d, s.exact.rho_t, 1.0, 1e-6, 1e-6);
    let inverse_errors = slabs.iter().map(|s| {
        // The peers are judged by the same numbers: single-scattering albedo and optical thickness.
        let e = inverse(s);
        let delta = e.sigma_a + e.sigma_s;
        larger((e.sigma_s / delta / s.omega - 1.0).abs(), (delta / s.delta - 1.0).abs())
    });
    let forward_us = median_us(50.0, || slabs.iter().map(|s| forward(s).rho_d).sum::<f64>()) / count;
    let inverse_us = median_us(100.0, || slabs.iter().map(|s| inverse(s).sigma_a).sum::<f64>()) / count;
    PeerInputs {
        ours: vec![
            ours("slab", "mesophyll forward", forward_errors.collect(), forward_us, "rows"),
            ours("slab", "mesophyll inverse", inverse_errors.collect(), inverse_us, "rows"),
        ],
        files: vec![("slab.csv".into(), text.into_bytes())],
        turn: None,
    }
}

/// 48 RGB texels of the default device with a thin tube: m .05–.5, tilt ±.1, 100 frames, 1 % noise.
///
/// # Errors
/// None in practice: an input that cannot be written as text.
pub fn gloss() -> Result<PeerInputs> {
    let device = GlossFitDevice { radius_mm: 0.0, ..synthetic::device(Lobe::Beckmann, 0.01) };
    let positions = synthetic::pass_x(100);
    let mut noise = synthetic::GaussianDeviates::new(5);
    let mut draw = |_| {
        let (rho_d, rho_s) = (noise.uniform(0.02, 0.2), noise.uniform(0.02, 0.1));
        synthetic::GlossFitTruth {
            rho_d: [0.5 * rho_d, rho_d, 0.3 * rho_d],
            rho_s: [rho_s; 3],
            m: noise.uniform(0.05f64.ln(), 0.5f64.ln()).exp(),
            tilt: [noise.uniform(-0.1, 0.1), 0.0],
        }
    };
    let truths: Vec<synthetic::GlossFitTruth> = (0..48).map(&mut draw).collect();
    let mut trace =
        |t: &synthetic::GlossFitTruth| synthetic::trace(&device, Travel::X, &positions, [0.0; 2], t, Some(&mut noise));
    let traces: Vec<Vec<[f32; 3]>> = truths.iter().map(&mut trace).collect();
    let fitter = GlossTexelFitter::new(&device, &positions, None);
    let mut workspace = fitter.workspace();
    let mut fitted = |trace: &[[f32; 3]]| fitter.fit(&mut workspace, [0.0; 2], trace, None).m;
    let errors = truths.iter().zip(&traces).map(|(t, trace)| (fitted(trace) / t.m - 1.0).abs()).collect();
    let us = median_us(200.0, || traces.iter().map(|trace| fitted(trace)).sum::<f64>()) / traces.len() as f64;
    let texel =
        |(t, trace): (&synthetic::GlossFitTruth, &Vec<[f32; 3]>)| serde_json::json!({ "m": t.m, "trace": trace });
    let texels: Vec<serde_json::Value> = truths.iter().zip(&traces).map(texel).collect();
    let value = serde_json::json!({
        "u": positions.iter().map(|x| x / device.height_mm).collect::<Vec<_>>(),
        "camera_deg": device.camera[0].atan2(device.camera[2]).to_degrees(),
        "height_mm": device.height_mm,
        "tube_length_mm": device.length_mm,
        "noise_relative": device.noise_relative,
        "noise_floor": device.noise_floor,
        "texels": texels,
    });
    let text = serde_json::to_string(&value).map_err(|e| Error::Missed(format!("cannot write JSON: {e}")))?;
    Ok(PeerInputs {
        files: vec![("gloss.json".into(), text.into_bytes())],
        ours: vec![ours("gloss", "mesophyll", errors, us, "RGB texels, relative error of m")],
        turn: None,
    })
}

#[cfg(test)]
mod tests {

    #[test]
    fn inputs_are_the_same_in_every_run_and_hold_what_scripts_read() {
        let (a, b) = (super::slab(), super::slab());
        assert_eq!(a.files, b.files);
        assert_eq!(a.files[0].1.iter().filter(|&&byte| byte == b'\n').count(), 65);
        assert!(a.ours.iter().all(|r| r.error < 1e-3 && r.us > 0.0), "{:?}", a.ours);
        let gloss = super::gloss().unwrap();
        let value: serde_json::Value = serde_json::from_slice(&gloss.files[0].1).unwrap();
        assert_eq!(value["texels"][47]["trace"][99].as_array().unwrap().len(), 3);
        assert!(gloss.ours[0].error < 0.05, "{:?}", gloss.ours);
    }
}
