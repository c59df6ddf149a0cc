//! The files that a fit of branches writes: `fit.toml` and `times.toml`.

use super::basis::{DEGREE, smooth, smooth_fit};
use super::deflections::{self, NamedBranch};
use super::fit::{BranchEstimate, BranchFit, PositionReference, termination};
use crate::branch::{Error, Result};
use crate::record::maker;
use crate::record::next::NextMeasurement;
use crate::record::{FitKind, FitParameter, FitRecord, RecordSection, ResidualStatistics};
use mesophyll_base::solvers::Termination;
use mesophyll_files::table::InputTable;
use mesophyll_plants::mechanics::beam::{TAPER_MAX, TAPER_MIN};
use mesophyll_plants::mechanics::load::Load;
use mesophyll_plants::mechanics::taper::TERMS;
use std::path::Path;
use std::time::Instant;

/// The coefficients of all tapers, as a section `all`: a₂ … a₅, each a Chebyshev series in ln α scaled to [−1, 1] over
/// the taper range.
pub fn of_basis() -> FitRecord {
    let (series, fit) = smooth();
    let f = &fit.fit;
    let mut section = RecordSection {
        condition: Some(f.uncertainty.condition),
        rank: Some(f.uncertainty.rank),
        ..RecordSection::default()
    };
    for (k, row) in series.series.iter().enumerate() {
        // Nothing was measured, so standard errors of these numbers have no meaning. The figures below say how good
        // they are.
        let param = FitParameter { value: row.clone(), stderr: vec![f64::NAN; row.len()], ..FitParameter::default() };
        section.params.insert(format!("a{}", k + 2), param);
    }
    section.terminations.insert(f.termination.name().into(), 1);
    let (worst, at) = fit.worst();
    let n = f.residuals.len().max(1);
    section.figures.insert("rms_error_of_tip".into(), (f.uncertainty.chi2 / n as f64).sqrt());
    section.figures.insert("worst_error_of_tip".into(), worst);
    section.figures.insert("worst_error_at_alpha".into(), at);
    let mut record = FitRecord::new(
        FitKind::Beam,
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

/// Measured branches, with one section for each. `load`: the stated one.
pub fn of_branches(
    branches: &[NamedBranch],
    fits: &[std::result::Result<BranchFit, String>],
    along: PositionReference,
    load: Option<Load>,
    input_hash: String,
) -> FitRecord {
    let mut record = FitRecord::new(FitKind::Beam, "branches", input_hash);
    let converged = fits.iter().filter(|f| termination(f).converged()).count();
    record.termination = fits.iter().map(termination).find(|t| t.converged()).or(Some(Termination::Refused));
    record.options.insert(
        "positions".into(),
        if along == PositionReference::Branch { "along the branch" } else { "along the straight axis" }.into(),
    );
    let stated = if load.is_some() { "stated" } else { "assumed" };
    record.options.insert("load".into(), format!("{}, {stated}", load.unwrap_or_default().words()));
    record.options.insert("fitted".into(), format!("{converged} of {}", branches.len()));
    record.options.insert(
        "not told apart".into(),
        "load, modulus and root radius enter only as F/(E' r1^4); the radius needs the other two given".into(),
    );
    for (NamedBranch { name, unread, .. }, fit) in branches.iter().zip(fits) {
        let mut section = RecordSection::default();
        section.terminations.insert(termination(fit).name().into(), 1);
        match fit {
            Ok(m) => {
                describe(&mut section, m);
                let left: Vec<&str> = unread.iter().chain(&m.left_out).map(String::as_str).collect();
                if !left.is_empty() {
                    record.options.insert(format!("left out {name}"), left.join("; "));
                }
                if let Some(other) = &m.other {
                    let said = format!("{}, {:.3} times as probable as an even load", other.words(), other.odds);
                    record.options.insert(format!("other load {name}"), said);
                }
            }
            Err(why) => {
                record.options.insert(format!("refused {name}"), why.clone());
            }
        }
        record.sections.insert(format!("branch {name}"), section);
    }
    let asked = branches.iter().zip(fits).filter_map(|(b, fit)| load_is_asked(&b.name, fit.as_ref().ok()?));
    record.next_measurement = asked.max_by(|a, b| a.error_now.total_cmp(&b.error_now));
    record
}

/// To state the load, where another than the assumed one gives another branch: no number of marks would tell.
fn load_is_asked(name: &str, m: &BranchFit) -> Option<NextMeasurement> {
    let other = m.other.as_ref()?;
    let u = &m.fit.uncertainty;
    let then = [u.stderr[0], u.stderr[1] / m.fit.params[1].abs()];
    let all = [("alpha", m.taper), ("load_over_stiffness", m.load_over_stiffness)].into_iter().zip(then);
    let now = all.map(|((quantity, k), then)| (quantity, k.error / k.value.abs(), then)).filter(|q| q.1.is_finite());
    let (quantity, error_now, error_then) = now.max_by(|a, b| a.1.total_cmp(&b.1))?;
    let sentence = format!(
        "branch {name}: the load was not stated; an even one gives alpha {:.2}, and {} explains the readings {}; state \
         how the load hangs (--load), because more marks seldom tell loads apart",
        m.taper.value,
        other.words(),
        other.how_well()
    );
    Some(NextMeasurement { quantity: format!("branch {name}.{quantity}"), error_now, error_then, sentence })
}

fn describe(section: &mut RecordSection, m: &BranchFit) {
    let u = &m.fit.uncertainty;
    let status = m.status.to_string();
    let why = status.split_once(" (").and_then(|(_, why)| why.strip_suffix(')'));
    let why = why.unwrap_or("relative standard error above 10 %");
    let mut add = |name: &str, k: BranchEstimate, unit: &str| {
        let column = if unit.is_empty() { name.to_string() } else { format!("{name}_{unit}") };
        let unknown = m.status.leaves_open(&column);
        let undetermined = if unknown { vec![format!("{name}: {why}")] } else { Vec::new() };
        section.params.insert(
            name.into(),
            FitParameter {
                value: vec![k.value],
                stderr: vec![k.error],
                unit: unit.into(),
                undetermined,
                ..FitParameter::default()
            },
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
        ResidualStatistics {
            samples: m.fit.residuals.len(),
            chi2: u.chi2,
            reduced_chi2: u.reduced_chi2,
            rms: m.rms,
            worst: largest,
            worst_at: [0, 0],
        },
    );
}

/// Fits the coefficients of all tapers into the folder `out`; the answer is the record and how long the fit took (s).
///
/// # Errors
/// A folder that cannot be written or that holds something else.
pub fn basis_to(out: &Path) -> Result<(FitRecord, f64)> {
    maker::make(FitKind::Beam, out, &[], |maker| {
        let record = of_basis();
        maker.made_from(record.input_hash.clone())?;
        let start = Instant::now();
        let fit = smooth_fit(TERMS, DEGREE);
        let seconds = start.elapsed().as_secs_f64();
        maker.times.phase("fit", start);
        maker.times.traces.insert("all".into(), fit.fit.trace);
        maker.begin()?;
        Ok((*maker.finish(record)?, seconds))
    })
}

/// Branches and what was found of each, in their order.
pub type BranchFitResults = (Vec<NamedBranch>, Vec<std::result::Result<BranchFit, String>>);

/// What is said of a table of marks.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BranchFitRequest {
    /// What positions were measured along.
    pub along: PositionReference,
    /// The load; `None`: taken as even, and compared with others.
    pub load: Option<Load>,
}

/// Fits the branches of the table in the file `marks`; with `out` also into that folder. `noise` is the standard error
/// (mm) of a deflection where the file states none.
///
/// # Errors
/// A table that cannot be read or that has no rows; a folder that cannot be written or that holds something else.
pub fn branches_to(
    marks: &Path,
    out: Option<&Path>,
    noise: Option<f64>,
    asked: BranchFitRequest,
) -> Result<BranchFitResults> {
    let BranchFitRequest { along, load } = asked;
    let path = marks.to_path_buf();
    let fit = move || -> Result<BranchFitResults> {
        let branches = deflections::read(InputTable::open(&path)?, noise)?;
        if branches.is_empty() {
            return Err(Error::input(&path, "no rows; expected at least one mark"));
        }
        let fits = deflections::fit_all(&branches, along, load);
        Ok((branches, fits))
    };
    let Some(out) = out else { return fit() };
    maker::make(FitKind::Beam, out, &[marks], move |maker| {
        let (branches, fits) = maker.phase("fit", fit)?;
        let told = [
            ("branches", format!("{branches:?}")),
            ("along", format!("{along:?}")),
            ("load", load.map_or("assumed even".into(), |load| load.to_string())),
        ];
        let input = maker::input_hash(told.iter().map(|(name, text)| (*name, text.as_str())));
        for (NamedBranch { name, .. }, fit) in branches.iter().zip(&fits) {
            if let Ok(fit) = fit {
                maker.times.traces.insert(name.clone(), fit.fit.trace.clone());
            }
        }
        maker.made_from(input.clone())?;
        let record = of_branches(&branches, &fits, along, load, input);
        maker.begin()?;
        maker.finish(record)?;
        Ok((branches, fits))
    })
}
