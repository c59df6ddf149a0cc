//! Slabs: `mesophyll.slab`.

use crate::bridge::{NumberBuffer, RowCost, RowTroubles, columns, fill, named};
use mesophyll_base::error::Status;
use mesophyll_fits::slab::{Options, SlabMeasurement, SpecularPart, found};
use mesophyll_optics::slab::inverse::SlabModel;
use mesophyll_optics::slab::{response, verdict};
use pyo3::prelude::*;

/// σa, σs and their errors (4 cells a row) from R, T, thickness (mm) and the standard errors of R and T.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "they are the arguments of the Python function")]
pub fn slab_invert(
    py: Python<'_>,
    r: NumberBuffer,
    t: NumberBuffer,
    thickness: NumberBuffer,
    r_err: NumberBuffer,
    t_err: NumberBuffer,
    method: &str,
    surface: f64,
    out: NumberBuffer,
) -> PyResult<RowTroubles> {
    let cost = if method == "fast" { RowCost::Little } else { RowCost::Much };
    let precision = named("method", method)?;
    let ([r, t, h, r_err, t_err], rows) = columns(py, [&r, &t, &thickness, &r_err, &t_err])?;
    // Rows without noise have NaN for it.
    let model = SlabModel::matched();
    let options = Options { precision, noise: None, surface, model, specular: SpecularPart::Included };
    fill(py, rows, cost, &out, |k, cells, _| {
        let measured = SlabMeasurement {
            rho_d: r[k],
            rho_t: t[k],
            thickness_mm: h[k],
            rho_d_err: r_err[k],
            rho_t_err: t_err[k],
            known: None,
        };
        let (values, status) = found(&options, &measured);
        cells.copy_from_slice(&values);
        status
    })
}

/// R and T (2 cells a row) from σa, σs (1/mm) and thickness (mm).
#[pyfunction]
pub fn slab_forward(
    py: Python<'_>,
    sigma_a: NumberBuffer,
    sigma_s: NumberBuffer,
    thickness: NumberBuffer,
    out: NumberBuffer,
) -> PyResult<RowTroubles> {
    let ([a, s, h], rows) = columns(py, [&sigma_a, &sigma_s, &thickness])?;
    fill(py, rows, RowCost::Little, &out, |k, cells, _| {
        for (name, value) in [("sigma_a", a[k]), ("sigma_s", s[k]), ("thickness", h[k])] {
            if !(value >= 0.0 && value.is_finite()) {
                return Status::Refused(format!("{name} is {value}; expected 0 or more"));
            }
        }
        let seen = response(a[k], s[k], h[k]);
        cells.copy_from_slice(&[seen.rho_d, seen.rho_t]);
        Status::Ok
    })
}

/// R and T (2 cells a row) from ω, Δ and 1 − ω (NaN where it is not given), as `eval slab`.
#[pyfunction]
pub fn slab_evaluate(
    py: Python<'_>,
    omega: NumberBuffer,
    delta: NumberBuffer,
    one_minus_omega: NumberBuffer,
    method: &str,
    incidence_deg: f64,
    out: NumberBuffer,
) -> PyResult<RowTroubles> {
    let cost = if method == "fast" { RowCost::Little } else { RowCost::Much };
    let method: verdict::SlabMethod = named("method", method)?;
    let ([omega, delta, rest], rows) = columns(py, [&omega, &delta, &one_minus_omega])?;
    let slabs = verdict::SlabEvaluator::new(method, incidence_deg.to_radians().cos(), 1.0);
    fill(py, rows, cost, &out, |k, cells, _| {
        let (seen, status) = slabs.evaluate(omega[k], delta[k], rest[k]);
        cells.copy_from_slice(&[seen.rho_d, seen.rho_t]);
        status
    })
}
