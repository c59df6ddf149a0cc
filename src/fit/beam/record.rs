//! What a fit of branches leaves on disk: `fit.toml` and `times.toml`.

use super::basis::{DEGREE, smooth};
use super::deflections::Named;
use super::measured::{Along, Known, Measured, termination};
use crate::Result;
use mesophyll_plant::beam::{TAPER_MAX, TAPER_MIN};
use mesophyll_record::{FitRecord, Param, Phase, Residuals, SCHEMA, Section, Times};
use mesophyll_solve::Termination;
use std::path::Path;

fn empty(name: &str, input_hash: String) -> FitRecord {
    FitRecord {
        schema: SCHEMA,
        kind: "beam".into(),
        name: name.into(),
        program: concat!("mesophyll ", env!("CARGO_PKG_VERSION")).into(),
        input_hash,
        ..FitRecord::default()
    }
}

/// The coefficients of all tapers, as a section `all`: a₂ … a₅, each a Chebyshev series in ln α scaled to [−1, 1] over
/// the taper range.
pub fn of_basis() -> FitRecord {
    let (series, fit) = smooth();
    let f = &fit.fit;
    let mut section =
        Section { condition: Some(f.uncertainty.condition), rank: Some(f.uncertainty.rank), ..Section::default() };
    for (k, row) in series.series.iter().enumerate() {
        // Nothing was measured: a standard error of these numbers has no meaning. What they are good for are the
        // figures below.
        let param = Param { value: row.clone(), stderr: vec![f64::NAN; row.len()], ..Param::default() };
        section.params.insert(format!("a{}", k + 2), param);
    }
    section.terminations.insert(f.termination.name().into(), 1);
    let (worst, at) = fit.worst();
    let n = f.residuals.len().max(1);
    section.figures.insert("rms_error_of_tip".into(), (f.uncertainty.chi2 / n as f64).sqrt());
    section.figures.insert("worst_error_of_tip".into(), worst);
    section.figures.insert("worst_error_at_alpha".into(), at);
    let mut record = empty(
        "branch basis",
        mesophyll_files::hash::combine([("basis", format!("{TAPER_MIN} {TAPER_MAX} {DEGREE}").as_str())]),
    );
    record.termination = Some(f.termination);
    record.options.insert("alpha".into(), format!("{TAPER_MIN} to {TAPER_MAX}"));
    record.options.insert(
        "deflection".into(),
        "u = a2 y^2 + a3 y^3 + a4 y^4 + a5 y^5, y = ln(1 + (alpha - 1) x)/ln(alpha), F/(E' r1^4) = 1".into(),
    );
    record
        .options
        .insert("coefficients".into(), "Chebyshev series in 2 ln(alpha/alpha_max)/ln(alpha_min/alpha_max) - 1".into());
    record.sections.insert("all".into(), section);
    record
}

/// Measured branches, a section each.
pub fn of_branches(
    branches: &[Named],
    fits: &[std::result::Result<Measured, String>],
    along: Along,
    input_hash: String,
) -> FitRecord {
    let mut record = empty("branches", input_hash);
    let converged = fits.iter().filter(|f| termination(f).converged()).count();
    record.termination = fits.iter().map(termination).find(|t| t.converged()).or(Some(Termination::Refused));
    record.options.insert(
        "positions".into(),
        if along == Along::Branch { "along the branch" } else { "along the straight axis" }.into(),
    );
    record.options.insert("fitted".into(), format!("{converged} of {}", branches.len()));
    record.options.insert(
        "not told apart".into(),
        "load, modulus and root radius enter only as F/(E' r1^4); the radius needs the other two given".into(),
    );
    for ((name, _), fit) in branches.iter().zip(fits) {
        let mut section = Section::default();
        section.terminations.insert(termination(fit).name().into(), 1);
        match fit {
            Ok(m) => describe(&mut section, m),
            Err(why) => {
                record.options.insert(format!("refused {name}"), why.clone());
            }
        }
        record.sections.insert(format!("branch {name}"), section);
    }
    record
}

fn describe(section: &mut Section, m: &Measured) {
    let u = &m.fit.uncertainty;
    let mut add = |name: &str, k: Known, unit: &str| {
        let unknown = !(k.error <= 0.1 * k.value.abs());
        let undetermined = if unknown { vec![format!("{name}: {}", m.status)] } else { Vec::new() };
        section.params.insert(
            name.into(),
            Param { value: vec![k.value], stderr: vec![k.error], unit: unit.into(), undetermined, ..Param::default() },
        );
    };
    add("alpha", m.taper, "");
    add("load_over_stiffness", m.load_over_stiffness, "mm");
    add("root_radius", m.root_radius, "mm");
    add("tip", m.tip, "mm");
    section.correlation_names = vec!["ln alpha".into(), "load_over_stiffness".into()];
    section.correlation = u.correlations();
    section.condition = Some(u.condition);
    section.rank = Some(u.rank);
    let largest = m.fit.residuals.iter().fold(0.0f64, |a, r| a.max(r.abs()));
    section.residuals.insert(
        "deflection".into(),
        Residuals {
            samples: m.fit.residuals.len(),
            chi2: u.chi2,
            reduced_chi2: u.reduced_chi2,
            rms: m.rms,
            worst: largest,
            worst_at: [0, 0],
        },
    );
}

/// Writes a record and what differs from run to run into a claimed folder.
///
/// # Errors
/// [`crate::Error::Write`] where the folder cannot be written.
pub fn write(
    folder: &Path,
    record: &FitRecord,
    seconds: f64,
    traces: Vec<(String, mesophyll_solve::Trace)>,
) -> Result<()> {
    mesophyll_record::begin(folder, "beam")?;
    let times = Times {
        capture: None,
        phases: vec![Phase { name: "fit".into(), seconds }],
        total_s: seconds,
        threads: rayon::current_num_threads(),
        peak_memory_mib: None,
        traces: traces.into_iter().collect(),
    };
    times.write(folder)?;
    record.write(folder)
}
