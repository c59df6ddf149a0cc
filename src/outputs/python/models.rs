//! Models on arrays: `mesophyll.branch`, `mesophyll.translucency`, `mesophyll.foliar`.

use crate::bridge::{
    CallInterrupt, NumberBuffer, RowCost, RowTroubles, answered, as_arguments, columns, fill, named, refuse,
};
use mesophyll_base::error::Status;
use mesophyll_optics::dipole::{DipoleForm, FormKind, Tissue, verdict};
use mesophyll_optics::foliar::shares::{FoliarMethod, shares};
use mesophyll_optics::foliar::{LayeredLeaf, MesophyllPath, Oblateness};
use mesophyll_optics::side::Side;
use pyo3::prelude::*;

/// Deflection and slope (2 cells a row) from taper and place, as `eval beam`.
#[pyfunction]
pub fn beam(py: Python<'_>, alpha: NumberBuffer, x: NumberBuffer, out: NumberBuffer) -> PyResult<RowTroubles> {
    let ([alpha, x], rows) = columns(py, [&alpha, &x])?;
    fill(py, rows, RowCost::Little, &out, |k, cells, _| {
        answered(mesophyll_fits::branch::beam::evaluate(alpha[k], x[k]), cells)
    })
}

/// T(r, d) (1 cell a row) from thickness and radius (mm), as `eval dipole`.
#[pyfunction]
pub fn dipole(
    py: Python<'_>,
    thickness: NumberBuffer,
    radius: NumberBuffer,
    tissue: [f64; 4],
    dipoles: u32,
    method: &str,
    out: NumberBuffer,
) -> PyResult<RowTroubles> {
    let [sigma_a, sigma_s, g, a] = tissue;
    let tissue = Tissue { sigma_a, sigma_s, g, a };
    if let Some(fault) = tissue.fault() {
        return Err(refuse(fault));
    }
    if dipoles > verdict::MOST_DIPOLES {
        return Err(refuse(format!("dipoles is {dipoles}; expected 0 to {}", verdict::MOST_DIPOLES)));
    }
    let form = DipoleForm::of(named::<FormKind>("method", method)?, dipoles);
    let ([thickness, radius], rows) = columns(py, [&thickness, &radius])?;
    fill(py, rows, RowCost::Little, &out, |k, cells, _| {
        let (t, status) = verdict::evaluate(&tissue, form, thickness[k], radius[k]);
        cells[0] = t;
        status
    })
}

/// Reflectance, transmittance, absorptance, surface reflectance and the errors of the first two (6 cells a row), as
/// `eval abm`. `leaves` has 10 numbers a row: absorption (1/mm), thickness (mm), the indices of cuticle, mesophyll and
/// antidermal wall, the oblateness of cuticle, epidermis, palisade and spongy tissue, and the angle of incidence
/// (degrees).
#[pyfunction]
pub fn abm(
    py: Python<'_>,
    leaves: NumberBuffer,
    side: &str,
    path: &str,
    rays: u64,
    seed: u64,
    out: NumberBuffer,
) -> PyResult<RowTroubles> {
    let side =
        Side::of_botanical(side).ok_or_else(|| refuse(format!("side is {side:?}; expected adaxial or abaxial")))?;
    let path: MesophyllPath = path.parse().map_err(|_| refuse(format!("path is {path:?}; expected slant or sieve")))?;
    // No rays: the exact method.
    let method = if rays == 0 { FoliarMethod::Exact } else { FoliarMethod::MonteCarlo { rays, seed } };
    let leaves = leaves.to_vec(py)?;
    fill(py, leaves.len() / 10, RowCost::Much, &out, |k, cells, stop| {
        match row(&leaves[10 * k..10 * k + 10], side, path, method, stop) {
            Ok(values) => {
                cells.copy_from_slice(&values);
                Status::Ok
            }
            Err(why) => Status::Refused(as_arguments(&why)),
        }
    })
}

fn row(
    cells: &[f64],
    side: Side,
    path: MesophyllPath,
    method: FoliarMethod,
    stop: &CallInterrupt,
) -> Result<[f64; 6], String> {
    let incidence = cells[9];
    if !(0.0..90.0).contains(&incidence) {
        return Err(format!("incidence_deg is {incidence}; expected 0 to below 90"));
    }
    for (name, x) in [("absorption_per_mm", cells[0]), ("mesophyll_thickness_mm", cells[1])] {
        if !(x >= 0.0 && x.is_finite()) {
            return Err(format!("{name} is {x}; expected 0 or more"));
        }
    }
    let oblateness = Oblateness { cuticle: cells[5], epidermis: cells[6], palisade: cells[7], spongy: cells[8] };
    let leaf = LayeredLeaf {
        depth: cells[0] * cells[1],
        n_cuticle: cells[2],
        n_mesophyll: cells[3],
        n_antidermal: cells[4],
        oblateness,
        path,
    };
    if let Some(fault) = leaf.fault() {
        return Err(fault);
    }
    let incidence = incidence.to_radians();
    let [(r, r_err), (t, t_err)] = shares(&leaf, side, incidence, method, &|| stop.asked())?;
    Ok([r, t, 1.0 - r - t, leaf.surface_reflectance(incidence), r_err, t_err])
}
