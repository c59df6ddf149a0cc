//! What the peers of `bench --peers` are measured on: the same inputs for them and for us, written as files that their scripts read, and our
//! own row on them. Seeded: the inputs are the same in every run.

use super::bench::{BenchRow, median_us};
use super::gloss::{Device, TexelFitter, normal_of};
use super::nist;
use crate::optics::gloss::Lobe;
use crate::optics::slab;
use crate::optics::tube::{Model, Precision, Travel};
use crate::solve::global::starts_in_box;
use crate::{Error, Result};
use rand::{RngExt, SeedableRng};

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

fn ours(model: &str, setting: &str, mut errors: Vec<f64>, us: f64, note: &str) -> BenchRow {
    errors.sort_by(f64::total_cmp);
    let worst = errors.last().copied().unwrap_or(f64::NAN);
    BenchRow {
        model: model.into(),
        knob: "peer".into(),
        setting: setting.into(),
        error: errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN),
        us,
        note: format!("{} {note}, worst error {worst:.1e}", errors.len()),
    }
}

/// 64 slabs over single-scattering albedo .05–.995 and optical thickness .05–20.
fn slab_inputs() -> Inputs {
    let points = starts_in_box(&[0.05, 0.05f64.ln()], &[0.995, 20f64.ln()], 64, 7).unwrap_or_default();
    let rows: Vec<[f64; 4]> = points
        .iter()
        .map(|p| {
            let (omega, delta) = (p[0], p[1].exp());
            let r = slab::exact::solve(omega, 1.0 - omega, delta);
            [omega, delta, r.rho_d, r.rho_t]
        })
        .collect();
    let mut text = String::from("omega,delta,rho_d,rho_t\n");
    for [omega, delta, rho_d, rho_t] in &rows {
        text.push_str(&format!("{omega},{delta},{rho_d},{rho_t}\n"));
    }
    let larger = |a: f64, b: f64| if a > b || a.is_nan() { a } else { b };
    let count = rows.len() as f64;
    // With a thickness of 1 mm, σt in 1/mm is the optical thickness.
    let forward = |row: &[f64; 4]| slab::response((1.0 - row[0]) * row[1], row[0] * row[1], 1.0);
    let forward_errors = rows.iter().map(|row| {
        let r = forward(row);
        larger((r.rho_d / row[2] - 1.0).abs(), (r.rho_t / row[3] - 1.0).abs())
    });
    let inverse = |row: &[f64; 4]| slab::inverse::invert(row[2], row[3], 1.0, 1e-12, 1e-12);
    let inverse_errors = rows.iter().map(|row| {
        let e = inverse(row);
        let total = e.sigma_a + e.sigma_s;
        larger((e.sigma_s / total / row[0] - 1.0).abs(), (total / row[1] - 1.0).abs())
    });
    let forward_us = median_us(50.0, || rows.iter().map(|row| forward(row).rho_d).sum::<f64>()) / count;
    let inverse_us = median_us(100.0, || rows.iter().map(|row| inverse(row).sigma_a).sum::<f64>()) / count;
    Inputs {
        ours: vec![
            ours("slab", "mesophyll forward", forward_errors.collect(), forward_us, "rows"),
            ours("slab", "mesophyll inverse", inverse_errors.collect(), inverse_us, "rows"),
        ],
        files: vec![("slab.csv".into(), text)],
    }
}

/// 48 RGB texels under the default device with a thin tube: m .05–.5, tilt ±.1, 100 frames, 1 % noise.
fn gloss_inputs() -> Result<Inputs> {
    let camera = 55f64;
    let (sin, cos) = camera.to_radians().sin_cos();
    let device = Device {
        height_mm: 100.0,
        length_mm: 500.0,
        radius_mm: 0.0,
        camera: [sin, 0.0, cos],
        lobe: Lobe::Beckmann,
        noise_relative: 0.01,
        noise_floor: 5e-4,
    };
    let u: Vec<f64> = (0..100).map(|k| -4.0 + 6.5 * f64::from(k) / 99.0).collect();
    let positions: Vec<f64> = u.iter().map(|u| u * device.height_mm).collect();
    let fine = Model::new(device.tube(), device.camera, device.lobe, &Precision::fine());
    let points = starts_in_box(&[0.05f64.ln(), -0.1, 0.02, 0.02], &[0.5f64.ln(), 0.1, 0.2, 0.1], 48, 11).unwrap_or_default();
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(5);
    let mut normal = move || {
        let (a, b): (f64, f64) = (rng.random(), rng.random());
        (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    };
    let texels: Vec<(f64, Vec<[f32; 3]>)> = points
        .iter()
        .map(|p| {
            let (m, tilt, rho_d, rho_s) = (p[0].exp(), p[1], p[2], p[3]);
            let trace = positions.iter().map(|x| {
                let r = fine.response(Travel::X, *x, [0.0; 2], normal_of([tilt, 0.0]), m);
                [0.5, 1.0, 0.3].map(|colour| {
                    let value = colour * rho_d * r.d + rho_s * r.s;
                    (value + normal() * (device.noise_relative * value).hypot(device.noise_floor)) as f32
                })
            });
            (m, trace.collect())
        })
        .collect();
    let fitter = TexelFitter::new(&device, &positions, None);
    let mut workspace = fitter.workspace();
    let errors = texels.iter().map(|(m, trace)| (fitter.fit(&mut workspace, [0.0; 2], trace, None).m / m - 1.0).abs()).collect();
    let us = median_us(200.0, || texels.iter().map(|(_, trace)| fitter.fit(&mut workspace, [0.0; 2], trace, None).m).sum::<f64>())
        / texels.len() as f64;
    let value = serde_json::json!({
        "u": u,
        "camera_deg": camera,
        "height_mm": device.height_mm,
        "tube_length_mm": device.length_mm,
        "noise_relative": device.noise_relative,
        "noise_floor": device.noise_floor,
        "texels": texels.iter().map(|(m, trace)| serde_json::json!({ "m": m, "trace": trace })).collect::<Vec<_>>(),
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
