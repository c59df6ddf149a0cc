//! `fit.toml`: what a fit folder states about itself. The same input and seed give the same bytes, so times are kept
//! apart in `times.toml`.

#![warn(missing_docs)]

mod consistency;
mod depth;
pub mod fault;
mod kind;
pub mod maker;
pub mod next;
pub mod scan;
mod seal;

pub use depth::THICKNESS_FAULT;
pub use kind::FitKind;

use fault::MeasurementFault;
use mesophyll_base::error::{Error, Result};
use mesophyll_base::solvers::{Termination, TraceRow};
use mesophyll_files::{atomic, claim, hash, whole_file};
use scan::{HeldOutResiduals, LightBoxResiduals, ScanRecord};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

/// The file of a record in a fit's folder.
pub const RECORD: &str = "fit.toml";
/// Version of this file format.
pub const SCHEMA: u32 = 1;

/// A fitted parameter: one value, or one for each colour channel.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FitParameter {
    /// One number a channel (RGB) or a single one.
    pub value: Vec<f64>,
    /// Standard errors, same length; infinite where undetermined.
    pub stderr: Vec<f64>,
    /// The part of `stderr` that comes from the caliper's reading of the thickness (`thickness_err_mm`), as the same
    /// share for all of the leaf. The rest is the fit's own; the two add as squares. Empty where the caliper does not
    /// contribute.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stderr_caliper: Vec<f64>,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    /// Unit of the values and their errors; empty for pure numbers.
    pub unit: String,
    /// Channels (or the name itself) that the data do not determine, with the reason: `sigma_a.B: at most 0.02`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub undetermined: Vec<String>,
}

/// Residual statistics of a fit, weighted by the stated noise.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ResidualStatistics {
    /// How many readings the fit explains.
    pub samples: usize,
    /// Sum of the squared residuals, each in units of its noise.
    pub chi2: f64,
    /// `chi2` over the degrees of freedom: about 1 where the model and the stated noise are right.
    pub reduced_chi2: f64,
    /// Unweighted root mean square.
    pub rms: f64,
    /// Worst texel's reduced χ².
    pub worst: f64,
    /// The worst texel: column, row.
    pub worst_at: [usize; 2],
}

/// A side of a leaf, or the only section of a fit without sides.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct RecordSection {
    /// Number of texels by fate: good, outside, and each named defect.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub counts: BTreeMap<String, usize>,
    /// Number of texels (or runs) by termination name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub terminations: BTreeMap<String, usize>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    /// Residuals by what was measured, such as `gloss` and `transmittance`.
    pub residuals: BTreeMap<String, ResidualStatistics>,
    /// Correlations of the shared parameters, row by row, with their names.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub correlation_names: Vec<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    /// Row by row, in the order of `correlation_names`.
    pub correlation: Vec<Vec<f64>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    /// Condition number of the problem at the solution.
    pub condition: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    /// How many directions of the parameters the data determine.
    pub rank: Option<usize>,
    /// Plain figures worth reporting (median errors, coverage, comparison of methods), by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub figures: BTreeMap<String, f64>,
    /// Error to the truth where the capture holds it, by quantity.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub truth: BTreeMap<String, TruthError>,
    /// How well frames that the fit did not see are predicted, by pass.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub held_out: BTreeMap<String, HeldOutResiduals>,
    /// How well the slab gives back what came through the light box.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light_box: Option<LightBoxResiduals>,
    /// `[front.sigma_a] value = …`: parameters by name.
    #[serde(flatten)]
    pub params: BTreeMap<String, FitParameter>,
}

/// How far a map is from the known truth.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct TruthError {
    /// Half of the values are off by less than this share of the truth.
    pub median_relative: f64,
    /// 99 % of the values are off by less than this share of the truth.
    pub p99_relative: f64,
    /// Share of truths inside the 95 % interval; absent when no standard error is known, so that it is never NaN.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coverage95: Option<f64>,
    /// The number of values that the share is computed from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub judged: Option<usize>,
}

/// Figure: the roughness of the traces divided by the roughness that their stated noise would cause (standard
/// deviations).
pub const NOISE_SEEN: &str = "noise_seen_over_stated";
/// Option: what the mirror strip shows of the device's geometry. It begins with `warning:` where it contradicts the
/// capture.
pub const MIRROR: &str = "mirror";
/// Count: readings that the fit of the texels left out as outliers.
pub const DISCARDED: &str = "readings_discarded";
/// Count: readings of the texels that were fitted, with those left out.
pub const READINGS: &str = "readings";

/// An option that begins with this is a value that nobody measured or fitted.
pub const STATED: &str = "stated: ";

/// Figures that exist where the truth has another gauge than the fit. This one is the mean true thickness over the good
/// texels relative to the fit's, less 1.
pub const GAUGE_THICKNESS: &str = "gauge_of_truth_thickness_relative";
/// The mean true γ less 1, of the channel where it is farthest off; see [`GAUGE_THICKNESS`].
pub const GAUGE_GAMMA: &str = "gauge_of_truth_gamma_relative";

/// `fit.toml`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FitRecord {
    /// Version of the file format: [`SCHEMA`].
    pub schema: u32,
    /// Hash of the rest of the file, as it was read. [`FitRecord::write`] computes it again, so that an edit made by
    /// the program is accepted.
    #[serde(default, skip_serializing)]
    pub record_hash: String,
    /// What it is a fit of.
    pub kind: FitKind,
    /// The fit's name: that of its capture, or of its kind.
    pub name: String,
    /// Program and version that made it.
    pub program: String,
    /// Hash of everything the fit was made from (input files and options).
    pub input_hash: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    /// Why the fit ended, where it has one end and not one for each side.
    pub termination: Option<Termination>,
    /// The options and gauges of the fit, as text.
    #[serde(default)]
    pub options: BTreeMap<String, String>,
    /// Defect code of `mask.Y` → its name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub defects: BTreeMap<String, String>,
    /// Content hash of every file of the folder, by name, so that a map changed from outside is noticed.
    #[serde(default)]
    pub files: BTreeMap<String, String>,
    /// The device of a scan under a tube.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scan: Option<ScanRecord>,
    /// Faults of the measurement that its data show.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<MeasurementFault>,
    /// What to measure next, where a number is not determined.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub next_measurement: Option<next::NextMeasurement>,
    /// Sections by name: `front`, `back`, or `all`.
    #[serde(flatten)]
    pub sections: BTreeMap<String, RecordSection>,
}

/// `times.toml`: everything that differs from run to run, and from place to place.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FitTimes {
    /// Where the capture was (`fit.toml` records its content); absent for fits of something else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub capture: Option<String>,
    /// Phase name → wall time (s), in order.
    pub phases: Vec<FitPhase>,
    /// Wall time of the whole run (s).
    pub total_s: f64,
    /// Threads that it ran on.
    pub threads: usize,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    /// Largest amount of memory that the process held (MiB), where the system tells.
    pub peak_memory_mib: Option<f64>,
    /// Named traces: the leaf-wide problem, a typical texel, the worst texel, …
    #[serde(default)]
    pub traces: BTreeMap<String, Vec<TraceRow>>,
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
/// One step of a run.
pub struct FitPhase {
    /// What was done.
    pub name: String,
    /// Wall time (s).
    pub seconds: f64,
}

impl FitRecord {
    /// A record of what every fit says: its kind and name, what it was made from, and by which program.
    pub fn new(kind: FitKind, name: &str, input_hash: String) -> FitRecord {
        FitRecord {
            schema: SCHEMA,
            kind,
            name: name.into(),
            program: concat!("mesophyll ", env!("CARGO_PKG_VERSION")).into(),
            input_hash,
            ..FitRecord::default()
        }
    }

    /// Reads `DIR/fit.toml`.
    pub fn read(folder: &Path) -> Result<FitRecord> {
        let path = folder.join("fit.toml");
        let record: FitRecord = read_toml(&path)?;
        if record.schema != SCHEMA {
            return Err(Error::field(&path, "schema", format!("found {}, this program reads {SCHEMA}", record.schema)));
        }
        Ok(record)
    }

    /// Reads `DIR/fit.toml` of a fit of `kind`.
    ///
    /// # Errors
    /// [`Error::Input`] where there is none, or one of another kind.
    pub fn read_as(folder: &Path, kind: FitKind) -> Result<FitRecord> {
        let path = folder.join("fit.toml");
        if !path.is_file() {
            let told = format!("no {kind} fit here (no fit.toml); `mesophyll fit {kind}` writes one");
            return Err(Error::input(folder, told));
        }
        let record = FitRecord::read(folder)?;
        if record.kind != kind {
            return Err(Error::field(&path, "kind", format!("found \"{}\", expected \"{kind}\"", record.kind)));
        }
        Ok(record)
    }

    /// Everything that a look states in place of a fit, a sentence each; empty for fits.
    pub fn stated(&self) -> Vec<String> {
        let options = self.options.iter().filter(|_| self.kind == FitKind::Look);
        options.filter_map(|(name, text)| Some(format!("{name}: {}", text.strip_prefix(STATED)?))).collect()
    }

    /// The same in one sentence; nothing for fits.
    pub fn stated_in_one(&self) -> Option<String> {
        let all = self.stated();
        (!all.is_empty()).then(|| format!("{}: stated, not fitted: {}", self.name, all.join("; ")))
    }

    /// Hashes `fit.toml` and every file named in `files` afresh and compares.
    ///
    /// # Errors
    /// [`Error::Missed`] naming the first file that is not what the fit wrote; [`Error::Input`] for one that cannot be
    /// read.
    pub fn verify(&self, folder: &Path) -> Result<()> {
        self.changes(folder).into_iter().next().map_or(Ok(()), |(_, error)| Err(error))
    }

    /// As [`FitRecord::verify`], with the name of every file that is not what the fit wrote.
    pub fn changes(&self, folder: &Path) -> Vec<(String, Error)> {
        let changed = |(name, expected): (&String, &String)| {
            let path = folder.join(name);
            let error = match hash::file(&path) {
                Ok(found) if &found == expected => return None,
                Ok(_) => Error::Missed(format!(
                    "{}: changed since it was fitted (its content hash is not the one in fit.toml)",
                    path.display()
                )),
                Err(e) => e,
            };
            Some((name.clone(), error))
        };
        let record = FitRecord::verify_numbers(folder).err().map(|error| (RECORD.to_string(), error));
        record.into_iter().chain(self.files.iter().filter_map(changed)).collect()
    }

    /// Checks by its record hash that the numbers in `folder`'s `fit.toml` are the ones that were written.
    ///
    /// # Errors
    /// [`Error::Missed`] where they are not; the sentence says how a deliberate edit is made.
    pub fn verify_numbers(folder: &Path) -> Result<()> {
        seal::verify(folder)
    }

    /// Writes `fit.toml` with its record hash, after all other files, so that a folder with one is complete. Then
    /// removes the marker of unfinished work.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let path = folder.join("fit.toml");
        let text = toml::to_string(self).map_err(|e| Error::write(&path, e))?;
        atomic::write_bytes(&path, seal::sealed(&text).as_bytes())?;
        claim::finish(folder)
    }
}

impl FitTimes {
    /// Adds a phase that began at `since` and ends now.
    pub fn phase(&mut self, name: &str, since: Instant) {
        self.spent(name, since.elapsed().as_secs_f64());
    }

    /// Adds a phase that took this many seconds.
    pub fn spent(&mut self, name: &str, seconds: f64) {
        self.phases.push(FitPhase { name: name.into(), seconds });
    }

    /// Reads `times.toml` in `folder`.
    ///
    /// # Errors
    /// [`Error::Input`] where it is missing or is not what this program writes.
    pub fn read(folder: &Path) -> Result<FitTimes> {
        read_toml(&folder.join("times.toml"))
    }
    /// Writes `times.toml` into `folder`.
    ///
    /// # Errors
    /// [`Error::Write`] where the folder cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        write_toml(&folder.join("times.toml"), self)
    }
}

/// A TOML file as a value; unknown and missing fields are named with their line.
pub fn read_toml<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T> {
    let text = whole_file::text(path)?;
    toml::from_str(&text).map_err(|e| Error::toml(path, &text, &e))
}

/// Writes a value as TOML, whole or not at all.
///
/// # Errors
/// [`Error::Write`] where the file cannot be written.
pub fn write_toml<T: Serialize>(path: &Path, value: &T) -> Result<()> {
    let text = toml::to_string(value).map_err(|e| Error::write(path, e))?;
    atomic::write_bytes(path, text.as_bytes())
}
