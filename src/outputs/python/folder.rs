//! The files of a fit: `mesophyll.fits`.

use crate::bridge::{NumberBuffer, refuse, run};
use mesophyll::report::{self, QualityLevel};
use mesophyll_base::error::Error;
use mesophyll_files::image::{self, ChannelMaps, Packing};
use mesophyll_fits::consistency;
use pyo3::prelude::*;
use pyo3::types::PyByteArray;
use std::path::PathBuf;

/// Checks that a folder holds a fit of this version, and that nothing in it was changed since. Returns a sentence for
/// everything that its numbers say against each other.
#[pyfunction]
pub fn verify(py: Python<'_>, folder: PathBuf) -> PyResult<Vec<String>> {
    run(py, || {
        let faults = consistency::of(&folder)?;
        match faults.changed.into_iter().next() {
            Some(changed) => Err(Error::Missed(changed.said)),
            None => Ok(faults.contradictions.into_iter().chain(faults.notes).collect()),
        }
    })
}

/// How good the fit in a folder is, as `mesophyll report` says: `ok`, `doubtful: …` or `missed: …`.
#[pyfunction]
pub fn quality(py: Python<'_>, folder: PathBuf) -> PyResult<String> {
    run(py, || {
        let verdict = report::verdict(&folder)?;
        Ok(match verdict.level {
            _ if verdict.missed => format!("missed: {}", verdict.sentence),
            QualityLevel::Good => "ok".into(),
            _ => format!("doubtful: {}", verdict.sentence),
        })
    })
}

/// Names and samples.
type NamedChannels<'py> = Vec<(String, Bound<'py, PyByteArray>)>;

/// Width, height, and name and single-precision samples of each channel of an OpenEXR file; row 0 is the top row.
#[pyfunction]
pub fn read_exr(py: Python<'_>, path: PathBuf) -> PyResult<(usize, usize, NamedChannels<'_>)> {
    let maps = run(py, || image::read_exr(&path))?;
    let bytes = |samples: &[f32]| samples.iter().flat_map(|v| v.to_ne_bytes()).collect::<Vec<u8>>();
    let channels = maps.channels.iter().map(|(name, s)| (name.clone(), PyByteArray::new(py, &bytes(s)))).collect();
    Ok((maps.width, maps.height, channels))
}

/// Writes named channels of `width` × `height` samples each as single-precision OpenEXR.
#[pyfunction]
pub fn write_exr(
    py: Python<'_>,
    path: PathBuf,
    width: usize,
    height: usize,
    channels: Vec<(String, NumberBuffer)>,
) -> PyResult<()> {
    let mut maps = ChannelMaps::new(width, height);
    for (name, samples) in channels {
        if samples.item_count() != width * height {
            let count = samples.item_count();
            return Err(refuse(format!("channel {name} has {count} samples; expected {width} × {height}")));
        }
        maps.push(name, samples.to_vec(py)?.into_iter().map(|v| v as f32).collect());
    }
    run(py, || image::write_exr(&path, &maps, Packing::Zip))
}
