//! `mesophyll eval gloss`: traces that a linear light source would show, wide, so that they feed `fit gloss`.

use crate::cli::fit::gloss::LobeArgs;
use crate::cli::{CommonArgs, batch, tables};
use crate::cli::{Error, Result};
use mesophyll_files::table::{Batch, BatchIo, BatchSpec, InputTable, OutputRow};
use mesophyll_fits::gloss::geometry::GlossGeometry;
use mesophyll_fits::gloss::{M_RANGE, normal_of};
use mesophyll_optics::tube::{Travel, TubeModel, TubePrecision};
use rand::{RngExt, SeedableRng};
use std::path::PathBuf;

/// CSV columns `rho_d,rho_s,m,tilt` (or `rho_d_r … rho_s_b,m,tilt`) → the trace `r0 … r{n-1}` (and `g0 …`, `b0 …`) of a
/// device.
///
/// A column `tilt_y` may be there, and `seed` for rows that differ in nothing else. Tilts are radians; columns
/// `tilt_deg` and `tilt_y_deg` are degrees. The columns are not carried through, so that the output can be fitted as it
/// is.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("eval gloss"))]
pub struct Args {
    /// The device (TOML)
    #[arg(long, value_name = "GEOMETRY.toml")]
    geometry: PathBuf,
    #[command(flatten)]
    lobe: LobeArgs,
    /// Gauss-Legendre nodes on half the tube
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u16).range(2..=256))]
    quadrature: u16,
    /// Add noise of this relative standard deviation (and the geometry's noise_floor)
    #[arg(long, value_name = "S")]
    noise: Option<f64>,
    /// Seed of the noise. Rows with the same parameters get the same noise, unless a column `seed` tells them apart
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    io: BatchIo,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let geometry = GlossGeometry::read(&args.geometry)?;
    if let Some(s) = args.noise.filter(|s| !(s.is_finite() && *s >= 0.0)) {
        return Err(Error::argument("--noise", s, "zero or a positive number"));
    }
    let device = geometry.device(args.lobe.lobe()?);
    let table = InputTable::open(&args.io.input)?;
    let rgb = table.column("rho_d_r").is_some();
    let suffixes: &[&str] = if rgb { &["_r", "_g", "_b"] } else { &[""] };
    let channels = suffixes.len();
    let ((tilt_column, tilt_unit), (tilt_y_column, tilt_y_unit)) = (table.angle("tilt")?, table.angle("tilt_y")?);
    let names = |stem: &str| suffixes.iter().map(|s| format!("{stem}{s}")).collect::<Vec<_>>();
    let required: Vec<String> =
        names("rho_d").into_iter().chain(names("rho_s")).chain(["m".into(), tilt_column.clone()]).collect();
    let optional: Vec<String> = vec![tilt_y_column, "seed".into()];
    let positions = geometry.positions_mm();
    let spec = BatchSpec {
        dropped: required.iter().chain(&optional).cloned().collect(),
        required,
        optional,
        outputs: ["r", "g", "b"][..channels]
            .iter()
            .flat_map(|c| (0..positions.len()).map(move |k| format!("{c}{k}")))
            .collect(),
        ..BatchSpec::default()
    };
    let batch = Batch::open(table, &args.io.rows(common.json), &spec)?;
    let precision = TubePrecision { along: args.quadrature.into(), ..TubePrecision::fine() };
    let model = TubeModel::new(device.tube(), device.camera, device.lobe, &precision);
    let tally = batch.run(|row, out| {
        let (m, tilt) = (row.get(2 * channels), tilt_unit * row.get(2 * channels + 1));
        let tilt_y = if row.get(2 * channels + 2).is_nan() { 0.0 } else { tilt_y_unit * row.get(2 * channels + 2) };
        if !(M_RANGE[0] * 0.01..=10.0).contains(&m) {
            out.push(OutputRow::refused(format!("m is {m}, expected {} to 10", M_RANGE[0] * 0.01)));
            return;
        }
        if !(tilt.abs() <= 1.5 && tilt_y.abs() <= 1.5) {
            out.push(OutputRow::refused(format!(
                "{} or tilt_y is beyond 1.5 rad (86 degrees)",
                spec.required[2 * channels + 1]
            )));
            return;
        }
        if let Some(k) = (0..2 * channels).find(|&k| !(0.0..1e6).contains(&row.get(k))) {
            out.push(OutputRow::refused(format!("{} is {}, expected zero or more", spec.required[k], row.get(k))));
            return;
        }
        let normal = normal_of([tilt, tilt_y]);
        let response: Vec<_> = positions.iter().map(|&x| model.response(Travel::X, x, [0.0; 2], normal, m)).collect();
        let mut values: Vec<f64> = (0..channels)
            .flat_map(|c| {
                let (rho_d, rho_s) = (row.get(c), row.get(channels + c));
                response.iter().map(move |r| rho_d * r.d + rho_s * r.s)
            })
            .collect();
        if let Some(noise) = args.noise {
            add_noise(&mut values, noise, geometry.noise_floor, args.seed, row.all());
        }
        out.push(OutputRow::ok(values));
    })?;
    batch::say_tally(&tally, &args.io, common, "row")?;
    Ok(0)
}

/// Gaussian noise, drawn from the seed and the row's own numbers, so that it does not depend on threads or order.
fn add_noise(values: &mut [f64], relative: f64, floor: f64, seed: u64, row: &[f64]) {
    let bytes: Vec<u8> = row.iter().flat_map(|v| v.to_bits().to_le_bytes()).chain(seed.to_le_bytes()).collect();
    let digest = blake3::hash(&bytes);
    let mut key = [0u8; 32];
    key.copy_from_slice(digest.as_bytes());
    let mut rng = rand_pcg::Pcg64::from_seed(key);
    for v in values {
        let (a, b): (f64, f64) = (rng.random(), rng.random());
        let normal = (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos();
        *v += normal * ((relative * *v).powi(2) + floor * floor).sqrt();
    }
}
