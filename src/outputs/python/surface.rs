//! Gloss: `mesophyll.gloss`.

use crate::bridge::{NumberBuffer, RowCost, RowTroubles, answered, fill, named, raise, refuse, run};
use mesophyll_base::error::Status;
use mesophyll_files::table::OutputRow;
use mesophyll_fits::gloss::geometry::GlossGeometry;
use mesophyll_fits::gloss::{GlossFitWorkspace, GlossTexelFit, GlossTexelFitter, RobustWeighting, samples};
use mesophyll_optics::gloss::{Lobe, LobeKind};
use mesophyll_optics::tube::TubePrecision;
use pyo3::prelude::*;
use std::cell::RefCell;
use std::path::Path;

/// The lobe of this name; `index` is looked at by Cook-Torrance only.
pub fn lobe(name: &str, index: f64) -> PyResult<Lobe> {
    let kind: LobeKind = named("lobe", name)?;
    if kind.has_index() && !(index > 1.0 && index < 4.0) {
        return Err(refuse(format!("index: found {index}, expected more than 1 and less than 4")));
    }
    Ok(Lobe::of(kind, index))
}

/// Positions u of the frames of a device, which is given as the text of its TOML file.
#[pyfunction]
pub fn gloss_frames(device: &str, name: &str) -> PyResult<Vec<f64>> {
    Ok(GlossGeometry::from_text(device, Path::new(name)).map_err(raise)?.frames_u())
}

/// Fits traces, `channels` (1 or 3) times as many numbers a row as the device has frames, channel by channel. Returns
/// the names of the cells, and the rows that did not end well.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "they are the arguments of the Python function")]
pub fn gloss_fit(
    py: Python<'_>,
    traces: NumberBuffer,
    channels: usize,
    device: (String, String),
    lobe_of: (String, f64),
    quadrature: usize,
    robust: &str,
    out: NumberBuffer,
) -> PyResult<(Vec<String>, RowTroubles)> {
    let geometry = GlossGeometry::from_text(&device.0, Path::new(&device.1)).map_err(raise)?;
    let (robust, lobe): (RobustWeighting, Lobe) = (named("robust", robust)?, lobe(&lobe_of.0, lobe_of.1)?);
    if !(2..=256).contains(&quadrature) {
        return Err(refuse(format!("quadrature is {quadrature}; expected 2 to 256")));
    }
    let frames = geometry.frames_u().len();
    let traces = traces.to_vec(py)?;
    let width = channels * frames;
    let precision = TubePrecision { along: quadrature, ..TubePrecision::default() };
    let mut fitter = run(py, || {
        Ok(GlossTexelFitter::with_precision(&geometry.device(lobe), &geometry.positions_mm(), None, &precision))
    })?;
    fitter.robust = robust;
    let troubles = fill(py, traces.len() / width, RowCost::Much, &out, |row, cells, _| {
        let of = &traces[row * width..(row + 1) * width];
        let value = |c: usize, k: usize| if c < channels { of[c * frames + k] as f32 } else { f32::NAN };
        let trace: Vec<[f32; 3]> = (0..frames).map(|k| std::array::from_fn(|c| value(c, k))).collect();
        thread_local!(static SCRATCH: RefCell<GlossFitWorkspace> = RefCell::default());
        let (fit, found) = SCRATCH.with_borrow_mut(|ws| {
            let fit = fitter.fit(ws, [0.0; 2], &trace, None);
            let found = fitter.judge(ws, &trace, &fit);
            (fit, found)
        });
        answered(fit.judged(found.as_ref(), channels), cells)
    })?;
    Ok((GlossTexelFit::outputs(channels), troubles))
}

/// Fits the goniometer samples of one leaf: rows of source zenith, view zenith, view azimuth (degrees) and a value a
/// name. Returns the names of the cells, the cells (none where refused) and the status.
#[pyfunction]
pub fn gloss_fit_samples(
    py: Python<'_>,
    rows: NumberBuffer,
    names: Vec<String>,
    lobe_of: (String, f64),
) -> PyResult<(Vec<String>, Vec<f64>, String)> {
    let kind = LobeKind::from(lobe(&lobe_of.0, lobe_of.1)?);
    let surface = if kind == LobeKind::default() { samples::LobeChoice::Usual } else { samples::LobeChoice::Of(kind) };
    let settings =
        samples::GlossFitSettings { surface, index: Some(lobe_of.1), ..samples::GlossFitSettings::default() };
    let cells = rows.to_vec(py)?;
    let outputs = samples::outputs(&names, &settings);
    let answer = run(py, || {
        let read: Result<Vec<samples::GlossSample>, String> = cells
            .chunks_exact(3 + names.len())
            .enumerate()
            .map(|(k, row)| samples::sample(row, &names).map_err(|why| format!("sample {k}: {why}")))
            .collect();
        Ok(read.map_or_else(OutputRow::refused, |read| samples::answer(&read, &names, &settings)))
    })?;
    let values = if matches!(answer.status, Status::Refused(_)) { Vec::new() } else { answer.values };
    Ok((outputs, values, answer.status.to_string()))
}
