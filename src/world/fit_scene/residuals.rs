//! What is left of the readings, as files: pictures for programs and for eyes, tables, and the steps of the search.

use crate::Result;
use crate::photographs::{ReadingKind, ScenePhotograph};
use crate::steps::{SceneFit, SceneStep};
use crate::unknowns::SceneUnknowns;
use mesophyll_files::atomic;
use mesophyll_files::image::{ChannelMaps, Packing, write_exr, write_png};
use std::path::Path;

/// Standard errors at the ends of the scale of a residual picture for eyes.
pub const SCALE: f64 = 4.0;
/// The grey of a pixel that does not count.
const NOT_COUNTED: [u8; 3] = [120, 120, 120];

/// Writes, for each table of reflectance factors, what the scene shows and what is left of the readings in standard
/// errors. Returns the files' names.
pub fn tables(numbers: &SceneUnknowns, shots: &[ScenePhotograph], found: &SceneFit, out: &Path) -> Result<Vec<String>> {
    let columns: Vec<String> = match &numbers.bands {
        Some(bands) => bands.wavelengths.iter().map(f64::to_string).collect(),
        None => numbers.channels.iter().map(|channel| channel.to_lowercase()).collect(),
    };
    let n = columns.len();
    let mut files = Vec::new();
    for (s, shot) in shots.iter().enumerate() {
        let ReadingKind::Directions(toward) = &shot.by else { continue };
        let mut rows = vec![vec![f64::NAN; 2 * n]; toward.len()];
        for c in found.compared.iter().filter(|c| c.at[0] == s) {
            (rows[c.at[1]][c.at[2]], rows[c.at[1]][n + c.at[2]]) = (c.shown, c.residual);
        }
        let mut text = String::from("view_zenith_deg,view_azimuth_deg");
        for kind in ["brf", "residual"] {
            columns.iter().for_each(|column| text += &format!(",{kind}_{column}"));
        }
        for (angles, row) in toward.iter().zip(rows) {
            let cells = angles.iter().map(|a| format!("{:.4}", a.to_degrees()));
            let cells = cells.chain(row.iter().map(|v| format!("{v:.6}")));
            text += &format!("\n{}", cells.collect::<Vec<_>>().join(","));
        }
        text.push('\n');
        let file = format!("residual-{}.csv", shot.name);
        atomic::write_bytes(&out.join(&file), text.as_bytes())?;
        files.push(file);
    }
    Ok(files)
}

/// Writes, for each picture, what the scene shows (R, G, B) and what is left of the reading in standard errors
/// (`residual.R`, …; not a number where a pixel does not count), and a PNG of the latter: red, green and blue side by
/// side, from blue (the scene is too bright by [`SCALE`] standard errors) over white to red (too dark by as much).
/// Returns the files' names.
pub fn pictures(shots: &[ScenePhotograph], found: &SceneFit, out: &Path) -> Result<Vec<String>> {
    let mut files = Vec::new();
    for (s, shot) in shots.iter().enumerate().filter(|(_, shot)| matches!(shot.by, ReadingKind::Camera(_))) {
        let (pixels, [width, height]) = (shot.uses.len(), shot.size);
        let mut planes = vec![vec![f32::NAN; pixels]; 6];
        for c in found.compared.iter().filter(|c| c.at[0] == s) {
            let [_, k, channel] = c.at;
            planes[channel][k] = c.shown as f32;
            planes[3 + channel][k] = c.residual as f32;
        }
        let bytes: Vec<u8> = (0..height)
            .flat_map(|y| planes[3..].iter().flat_map(move |plane| &plane[y * width..][..width]))
            .flat_map(|residual| colour(f64::from(*residual)))
            .collect();
        let file = format!("residual-{}.png", shot.name);
        write_png(&out.join(&file), 3 * width, height, &bytes)?;
        files.push(file);
        let mut maps = ChannelMaps::new(width, height);
        let names = ["R", "G", "B", "residual.R", "residual.G", "residual.B"];
        names.into_iter().zip(planes).for_each(|(name, plane)| maps.push(name, plane));
        let file = format!("residual-{}.exr", shot.name);
        write_exr(&out.join(&file), &maps, Packing::Zip)?;
        files.push(file);
    }
    Ok(files)
}

/// The colour of a residual in standard errors.
fn colour(residual: f64) -> [u8; 3] {
    if !residual.is_finite() {
        return NOT_COUNTED;
    }
    let t = (residual / SCALE).clamp(-1.0, 1.0);
    let faded = ((1.0 - t.abs()) * 255.0).round() as u8;
    if t < 0.0 { [faded, faded, 255] } else { [255, faded, faded] }
}

/// The steps as a table: how far the numbers were from the result, and how well they were known, against the time that
/// it took. `distance` and `standard_error` are root mean squares over all numbers that are determined in the end, each
/// in its own unit: 1 for a reflectance, the number itself for other quantities.
pub fn steps(found: &SceneFit, values: &[f64], units: &[f64]) -> String {
    let known: Vec<usize> = (0..values.len()).filter(|k| found.undetermined[*k].is_none()).collect();
    let rms = |of: &dyn Fn(usize) -> f64| {
        (known.iter().map(|k| (of(*k) / units[*k]).powi(2)).sum::<f64>() / known.len().max(1) as f64).sqrt()
    };
    let mut text = String::from(
        "step,seconds,processor_s,paths,half_chi2,reduced_chi2,step_in_standard_errors,distance,standard_error\n",
    );
    for SceneStep { row, processor_s, paths, readings, values: then, stderr } in &found.steps {
        let (distance, error) = (rms(&|k| then[k] - values[k]), rms(&|k| stderr[k]));
        let processor = processor_s.map_or(String::new(), |s| format!("{s:.2}"));
        text += &format!(
            "{},{:.3},{processor},{paths},{:.6e},{:.4},{:.4},{distance:.6e},{error:.6e}\n",
            row.iteration + 1,
            row.elapsed_s,
            row.cost,
            2.0 * row.cost / (*readings).max(1) as f64,
            row.step,
        );
    }
    text
}
