//! MERL: three little-endian 32-bit sizes (90, 90, 180), then red, green and blue as 64-bit numbers by half angle,
//! difference angle and difference azimuth (Rusinkiewicz 1998). Half angles are finer near 0: θh = (k/90)²·90°.

use super::{DIRECTIONS, GoniometerReadings, direction, mirrored};
use crate::{Error, Result};
use mesophyll_files::atomic::explain;
use std::f64::consts::PI;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Cells by half angle, difference angle and difference azimuth.
const SIZES: [u64; 3] = [90, 90, 180];
/// The stored number over the BRDF.
const SCALE: [f64; 3] = [1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0];

/// Reads a part of the cells of a file: every 5th half angle, 10th difference angle and 20th azimuth.
pub fn read(path: &Path) -> Result<GoniometerReadings> {
    let failed = |e: std::io::Error| Error::input(path, explain(&e));
    let mut file = File::open(path).map_err(failed)?;
    let mut head = [0u8; 12];
    file.read_exact(&mut head).map_err(|_| Error::input(path, "shorter than the 12 bytes of MERL's header"))?;
    let word =
        |k: usize| u64::from(u32::from_le_bytes([head[4 * k], head[4 * k + 1], head[4 * k + 2], head[4 * k + 3]]));
    let found = [word(0), word(1), word(2)];
    if found != SIZES {
        return Err(Error::input(path, format!("found sizes {found:?}, expected MERL's {SIZES:?}")));
    }
    let cells: u64 = SIZES.iter().product();
    let (length, expected) = (file.metadata().map_err(failed)?.len(), 12 + 24 * cells);
    if length != expected {
        return Err(Error::input(path, format!("found {length} bytes, expected {expected} of MERL's sizes {SIZES:?}")));
    }
    let names: Vec<String> = ["brf_r", "brf_g", "brf_b"].map(String::from).to_vec();
    let mut readings = GoniometerReadings { chosen: names.clone(), names, rows: Vec::with_capacity(DIRECTIONS) };
    let mut planes = vec![[0u8; 8 * SIZES[2] as usize]; 3];
    for i in (1..SIZES[0]).step_by(5) {
        for j in (2..SIZES[1]).step_by(10) {
            for (c, plane) in planes.iter_mut().enumerate() {
                let at = 12 + 8 * (c as u64 * cells + (i * SIZES[1] + j) * SIZES[2]);
                file.seek(SeekFrom::Start(at)).map_err(failed)?;
                file.read_exact(plane).map_err(failed)?;
            }
            let middle = |k: u64, n: u64| (k as f64 + 0.5) / n as f64;
            let (theta_h, theta_d) = (0.5 * PI * middle(i, SIZES[0]).powi(2), 0.5 * PI * middle(j, SIZES[1]));
            for k in (7..SIZES[2]).step_by(20) {
                let [x, y, z] = direction(theta_d, PI * middle(k, SIZES[2]));
                // From the half vector's frame to that of the surface: a turn by θh about y.
                let (sin, cos) = theta_h.sin_cos();
                let light = [cos * x + sin * z, y, cos * z - sin * x];
                let view = mirrored(light, [sin, 0.0, cos]);
                let value = |c: usize| {
                    let bytes = planes[c].get(8 * k as usize..8 * k as usize + 8).and_then(|b| b.try_into().ok());
                    bytes.map_or(f64::NAN, f64::from_le_bytes) * SCALE[c]
                };
                readings.add(light, view, || (0..3).map(value).collect());
            }
        }
    }
    Ok(readings)
}
