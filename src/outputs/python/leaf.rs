//! Leaf fits and the files of a fit: `mesophyll.leaf` and `mesophyll.fits`.

use crate::bridge::{NumberBuffer, named, run, run_until};
use crate::surface::lobe;
use mesophyll_base::error::Error;
use mesophyll_capture::kind::CaptureKind;
use mesophyll_files::image::{self, ChannelMaps, Packing};
use mesophyll_files::progress;
use mesophyll_fits::consistency;
use mesophyll_fits::dome;
use mesophyll_fits::leaf::held_out::HoldOutRule;
use mesophyll_fits::leaf::{self, Options};
use mesophyll_fits::photo;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyByteArray;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// How many fits are under way. They share one request to stop, so Ctrl-C stops those of other threads too.
static UNDER_WAY: Mutex<usize> = Mutex::new(0);

/// A fit under way. The last one that ends takes back the request to stop, which by then all of them have seen.
struct UnderWay;

impl UnderWay {
    fn begin() -> UnderWay {
        *UNDER_WAY.lock().unwrap_or_else(PoisonError::into_inner) += 1;
        UnderWay
    }
}

impl Drop for UnderWay {
    fn drop(&mut self) {
        let mut count = UNDER_WAY.lock().unwrap_or_else(PoisonError::into_inner);
        *count -= 1;
        if *count == 0 {
            progress::go_on_again();
        }
    }
}

/// Fits a capture into the folder `out`, as `fit leaf`.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "they are the arguments of the Python function")]
pub fn leaf_fit(
    py: Python<'_>,
    capture: PathBuf,
    out: PathBuf,
    method: &str,
    lobe_of: (String, f64),
    robust: bool,
    hold_out: (usize, u64),
    gloss: Option<[f64; 2]>,
    force: bool,
    quiet: bool,
) -> PyResult<()> {
    let (every, seed) = hold_out;
    if every == 1 || every > 10_000 {
        return Err(PyValueError::new_err(format!("hold_out is {every}; expected 0 (none) or 2 to 10000")));
    }
    let options = Options {
        method: named("method", method)?,
        lobe: lobe(&lobe_of.0, lobe_of.1)?,
        robust,
        hold_out: HoldOutRule { every, seed },
        force,
        ..Options::default()
    };
    let _under_way = UnderWay::begin();
    run_until(py, true, progress::request_stop, || {
        progress::set_quiet(quiet);
        let outcome = match CaptureKind::of(&capture) {
            Ok(Some(CaptureKind::Dome)) => dome::run(&capture, &out, &dome::Options { gloss, force }),
            Ok(Some(CaptureKind::Photo)) => photo::run(&capture, &out, force),
            _ => leaf::run(&capture, &out, &options),
        };
        progress::set_quiet(true);
        outcome.map(drop)
    })
}

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
            return Err(PyValueError::new_err(format!(
                "channel {name} has {count} samples; expected {width} × {height}"
            )));
        }
        maps.push(name, samples.to_vec(py)?.into_iter().map(|v| v as f32).collect());
    }
    run(py, || image::write_exr(&path, &maps, Packing::Zip))
}
