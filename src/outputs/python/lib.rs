//! `mesophyll._native`: the numbers behind the Python package `mesophyll`, which lies in the folder of that name beside
//! this file.
//!
//! Users call the package. It brings arrays into shape and says in its docstrings what they hold; here they arrive as
//! buffers of `f64`, are computed on all cores without Python's lock, and leave through buffers that the package made.
//! Rows are computed by the very functions that the command line's verbs call, so that both give the same digits. What
//! reads or writes files is the verb itself ([`command::command`]).
//!
//! Nothing here panics into Python ([`bridge::run`]), and errors are the sentences of the command line.

#![warn(missing_docs)]

mod bridge;
mod command;
mod folder;
mod models;
mod sky;
mod slab;
mod surface;

use pyo3::prelude::*;

#[pymodule(name = "_native")]
fn native(m: &Bound<'_, PyModule>) -> PyResult<()> {
    // Python goes on after Ctrl-C, and says itself what is to be said.
    mesophyll_files::progress::stay_when_stopped();
    mesophyll_files::progress::set_quiet(true);
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add("MOST_BANDS", mesophyll_sky::harmonics::MOST_BANDS)?;
    m.add_function(wrap_pyfunction!(slab::slab_invert, m)?)?;
    m.add_function(wrap_pyfunction!(slab::slab_forward, m)?)?;
    m.add_function(wrap_pyfunction!(slab::slab_evaluate, m)?)?;
    m.add_function(wrap_pyfunction!(surface::gloss_frames, m)?)?;
    m.add_function(wrap_pyfunction!(surface::gloss_fit, m)?)?;
    m.add_function(wrap_pyfunction!(surface::gloss_fit_samples, m)?)?;
    m.add_function(wrap_pyfunction!(command::command, m)?)?;
    m.add_function(wrap_pyfunction!(folder::verify, m)?)?;
    m.add_function(wrap_pyfunction!(folder::quality, m)?)?;
    m.add_function(wrap_pyfunction!(folder::read_exr, m)?)?;
    m.add_function(wrap_pyfunction!(folder::write_exr, m)?)?;
    m.add_function(wrap_pyfunction!(sky::sky_coefficients, m)?)?;
    m.add_function(wrap_pyfunction!(sky::sky_evaluate, m)?)?;
    m.add_function(wrap_pyfunction!(models::beam, m)?)?;
    m.add_function(wrap_pyfunction!(models::dipole, m)?)?;
    m.add_function(wrap_pyfunction!(models::abm, m)?)?;
    Ok(())
}
