//! Diffusion compared with the random walk: where the forms of T(r, d) hold, and what a vein's shadow looks like.
//!
//! The oracle is [`mesophyll_optics::walk`]; each of its figures has a standard error. Rows contain signed errors (form
//! less oracle). They are relative unless the note says otherwise, and NaN where the form is not defined or the
//! oracle's standard error is more than a tenth.

pub mod plane;
pub mod vein;

use crate::Result;
use crate::bench::BenchRow;
use mesophyll_files::progress::TaskProgress;
use mesophyll_optics::walk::Histories;

/// How many histories the oracle follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OracleEffort {
    /// Histories of each plane slab.
    pub plane: u64,
    /// Histories of each vein, over all runs.
    pub vein: u64,
}

impl OracleEffort {
    /// This takes minutes on two cores.
    pub const FULL: OracleEffort = OracleEffort { plane: 400_000, vein: 1_000_000 };

    fn plane(self) -> Histories {
        Histories { count: self.plane, seed: 510 }
    }

    fn vein(self) -> Histories {
        Histories { count: self.vein, seed: 510 }
    }
}

fn row(knob: &str, setting: &str, error: f64, us: f64, note: String) -> BenchRow {
    BenchRow { model: "translucency".into(), knob: knob.into(), setting: setting.into(), error, us, note }
}

/// Steps of the bar that [`bench_rows`] takes.
pub const PIECES: u64 = 6;

/// All rows.
///
/// # Errors
/// [`crate::Error::Interrupted`], and the errors of the walk and of the convolution, which do not occur with these
/// settings.
pub fn bench_rows(bar: &TaskProgress) -> Result<Vec<BenchRow>> {
    rows(OracleEffort::FULL, bar)
}

/// [`bench_rows`] with another effort.
pub fn rows(effort: OracleEffort, bar: &TaskProgress) -> Result<Vec<BenchRow>> {
    let mut rows = plane::history_rows()?;
    bar.step()?;
    rows.extend(plane::total_rows(effort)?);
    bar.step()?;
    rows.extend(plane::incidence_rows(effort)?);
    bar.step()?;
    rows.extend(plane::spot_rows(effort)?);
    bar.step()?;
    rows.extend(plane::angle_rows(effort)?);
    bar.step()?;
    rows.extend(vein::rows(effort)?);
    bar.step()?;
    Ok(rows)
}

#[cfg(test)]
mod tests;
