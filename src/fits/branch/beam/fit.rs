//! Taper, load over stiffness and root radius of a branch from measured deflections.
//!
//! Model: a clamped, linearly tapered circular branch that is level when it is straight, under a load that keeps its
//! direction ([`Load`]), bent as far as it goes ([`mesophyll_plants::mechanics::elastica`]). Its size is A = F/(E′r₁⁴)
//! = F L³/(E s₁⁴) (mm): the load F (N), the length L (mm), the modulus E (N/mm²), the root radius s₁ (mm). A deflection
//! is how far a mark moved across the straight branch. Its position is the distance from the root along the branch,
//! which bending does not change, or along the straight axis, where a plumb line through the bent branch meets it.
//!
//! Unknowns are ln α (α is the taper: radius at the tip over radius at the root) and A. **Load, modulus and root radius
//! cannot be told apart**, because deflections depend on F/(E s₁⁴) alone. With load and modulus given, the root radius
//! is (F L³/(E A))^¼, and their errors are carried along. Nor does one set of readings tell the kind of load: it is
//! stated or taken as even, and [`super::evidence`] says where the readings speak against that.
//!
//! Limits: a root that gives way, a branch that is crooked at rest or rises steeply, and shear are not in the model.

use super::bounds;
use super::curve::{BranchFitMarks, PRECISION};
use super::evidence::{AlternativeLoad, against_even};
use mesophyll_base::solvers::adequacy::{self, Adequacy};
use mesophyll_base::solvers::{Fit, Problem, Termination};
use mesophyll_files::table::Status;
use mesophyll_plants::mechanics::beam::{TAPER_MAX, TAPER_MIN};
use mesophyll_plants::mechanics::load::Load;
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};

/// One mark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeflectionMark {
    /// Distance from the root (mm), 0 to the branch's length.
    pub position: f64,
    /// How far the load moved the mark across the branch (mm), positive in the direction of the load.
    pub deflection: f64,
    /// Standard error of the deflection (mm); NaN: not known.
    pub error: f64,
}

/// A measured branch. NaN stands for what was not measured.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredBranch {
    /// Length of the branch (mm).
    pub length: f64,
    /// The marks, and how far each was deflected.
    pub readings: Vec<DeflectionMark>,
    /// The whole load (N) and its standard error.
    pub load: [f64; 2],
    /// Modulus of elasticity (GPa) and its standard error.
    pub modulus: [f64; 2],
}

/// What positions were measured along.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum PositionReference {
    /// Marks on the branch: positions are lengths of the branch, bent or not
    #[default]
    Branch,
    /// The straight axis: positions as a photograph or a plumb line shows them
    Axis,
}

/// A number and its standard error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BranchEstimate {
    /// The number, in the unit that its field states; NaN where nothing is known.
    pub value: f64,
    /// Its standard error, in the same unit; infinite where nothing is known.
    pub error: f64,
}

impl BranchEstimate {
    const NOTHING: BranchEstimate = BranchEstimate { value: f64::NAN, error: f64::INFINITY };

    fn sure(&self) -> bool {
        self.error <= 0.1 * self.value.abs()
    }
}

/// A fitted branch.
#[derive(Debug, Clone, PartialEq)]
pub struct BranchFit {
    /// Taper α: radius at the tip over radius at the root.
    pub taper: BranchEstimate,
    /// F/(E′r₁⁴) = F L³/(E s₁⁴) (mm).
    pub load_over_stiffness: BranchEstimate,
    /// Root radius (mm); nothing is known about it without load and modulus.
    pub root_radius: BranchEstimate,
    /// Deflection of the tip across the branch (mm). Its error combines those of taper and load over stiffness.
    pub tip: BranchEstimate,
    /// Correlation of ln α with F/(E′r₁⁴).
    pub correlation: f64,
    /// Unweighted root mean square of the residuals (mm).
    pub rms: f64,
    /// Whether the errors come from stated ones; otherwise they come from the scatter of the residuals.
    pub stated: bool,
    /// The load that the numbers are for, its place as a share of the length.
    pub load: Load,
    /// Another load that explains the readings, where none was stated.
    pub other: Option<AlternativeLoad>,
    /// Readings that were left out, each with the reason.
    pub left_out: Vec<String>,
    /// What is unusual about the branch, for a reader to look at.
    pub unusual: Option<String>,
    /// The solver's result.
    pub fit: Fit,
    /// Which of the numbers can be relied on.
    pub status: Status,
}

/// All numbers that a fit gives.
const NAMES: [&str; 4] = ["alpha", "load_over_stiffness_mm", "root_radius_mm", "tip_mm"];
const TIED: &str = "load, modulus and root radius enter only as F/(E' r1^4); give load_n and modulus_gpa";

/// Fits one branch under `load`; `None`: an even load, which is compared with others.
///
/// # Errors
/// Why nothing can be fitted, in words: a length that is not positive, marks beyond the ends, too few readings, no
/// deflection, or a solver that stopped.
pub fn fit(branch: &MeasuredBranch, along: PositionReference, load: Option<Load>) -> Result<BranchFit, String> {
    bounds::check(branch)?;
    let length = branch.length;
    let (mut readings, left_out) = bounds::usable(branch, along)?;
    let stated = readings.iter().any(|r| !r.error.is_nan());
    // The root itself never moves, so a reading there says nothing.
    readings.retain(|r| r.position > 0.0);
    let needed = if stated { 2 } else { 3 };
    if readings.len() < needed {
        let what = if stated { "two unknowns" } else { "two unknowns and the noise" };
        let why = left_out.first().map(|w| format!("; left out: {w}")).unwrap_or_default();
        return Err(format!(
            "too few readings: {} beyond the root; expected at least {needed} ({what}){why}",
            readings.len()
        ));
    }
    if readings.iter().all(|r| r.deflection == 0.0) {
        return Err("no deflection: an unloaded branch shows neither taper nor stiffness".into());
    }
    let kind = load.unwrap_or_default().on(length)?;
    let marks = BranchFitMarks { readings: &readings, length, along, load: kind, stated, untapered: false };
    let fit = marks.fit();
    if !fit.converged() {
        return Err(format!("the fit stopped without a result: {}", fit.termination.name()));
    }
    let other = if load.is_none() { against_even(&readings, length, along, stated) } else { None };
    Ok(measured(branch, &marks, fit, other, left_out))
}

/// Whether the elastica describes the readings.
fn judged(marks: &BranchFitMarks, fit: &Fit) -> Adequacy {
    let mut jacobian = vec![0.0; 2 * fit.residuals.len()];
    marks.jacobian(&fit.params, &mut jacobian);
    let smallest = marks.readings.iter().map(|r| marks.scale(r)).fold(f64::INFINITY, f64::min);
    let places: Vec<f64> = marks.readings.iter().map(|r| r.position).collect();
    adequacy::judge(&adequacy::SolutionResiduals {
        residuals: &fit.residuals,
        jacobian: &jacobian,
        noise: marks.noise(),
        floor: PRECISION * marks.length / smallest,
        along: &[adequacy::ReadingOrder::sorted("position", &places)],
    })
}

fn measured(
    branch: &MeasuredBranch,
    marks: &BranchFitMarks,
    fit: Fit,
    other: Option<AlternativeLoad>,
    left_out: Vec<String>,
) -> BranchFit {
    let length = branch.length;
    let (alpha, amplitude) = (fit.params[0].exp(), fit.params[1]);
    let u = &fit.uncertainty;
    let adequacy = judged(marks, &fit);
    let wider = |k: usize| adequacy.widening.get(k).copied().unwrap_or(1.0);
    let taper = BranchEstimate { value: alpha, error: alpha * u.stderr[0] * wider(0) };
    let load_over_stiffness = BranchEstimate { value: amplitude * length, error: u.stderr[1] * length * wider(1) };
    let [taper, load_over_stiffness] = match &other {
        Some(o) => [o.widened(taper, o.taper.value), o.widened(load_over_stiffness, o.load_over_stiffness)],
        None => [taper, load_over_stiffness],
    };
    let correlation = u.correlation(0, 1);
    let tip = tip(marks, &fit, wider(0).max(wider(1)));
    let given = [branch.load[0], branch.modulus[0]].iter().all(|v| v.is_finite());
    let root_radius = if given && load_over_stiffness.value != 0.0 {
        let stiffness = branch.modulus[0] * 1e3;
        let radius = (branch.load[0] * length.powi(3) / (stiffness * load_over_stiffness.value.abs())).powf(0.25);
        let share = |[v, e]: [f64; 2]| if e.is_nan() { 0.0 } else { e / v };
        let a = load_over_stiffness.error / load_over_stiffness.value.abs();
        BranchEstimate {
            value: radius,
            error: 0.25 * radius * (a * a + share(branch.load).powi(2) + share(branch.modulus).powi(2)).sqrt(),
        }
    } else {
        BranchEstimate::NOTHING
    };
    let squares = fit.residuals.iter().zip(marks.readings).map(|(v, r)| (v * marks.scale(r)).powi(2));
    let rms = (squares.sum::<f64>() / marks.readings.len() as f64).sqrt();
    let status = Doubts {
        branch,
        load: marks.load,
        fit: &fit,
        values: [taper, load_over_stiffness, root_radius, tip],
        misfit: adequacy.why("branch"),
        other: other.as_ref(),
    }
    .status(given);
    BranchFit {
        taper,
        load_over_stiffness,
        root_radius,
        tip,
        correlation,
        rms,
        stated: marks.stated,
        load: marks.load,
        other,
        left_out,
        unusual: bounds::unusual(branch),
        fit,
        status,
    }
}

/// Deflection of the tip (mm), with the errors of both unknowns carried along.
fn tip(marks: &BranchFitMarks, fit: &Fit, wider: f64) -> BranchEstimate {
    let Some(bent) = marks.curve(&fit.params) else { return BranchEstimate::NOTHING };
    let slope = |k: usize| {
        let beside = marks.beside(&bent, &fit.params, k);
        beside.map_or(f64::NAN, |(a, b, apart)| (a.at(1.0).across - b.at(1.0).across) / apart)
    };
    let g = [slope(0), slope(1)];
    let covariance = &fit.uncertainty.covariance;
    let variance: f64 = (0..2).map(|i| (0..2).map(|j| g[i] * covariance[(i, j)] * g[j]).sum::<f64>()).sum();
    let error = if variance >= 0.0 { marks.length * variance.sqrt() * wider } else { f64::INFINITY };
    BranchEstimate { value: marks.length * bent.at(1.0).across, error }
}

/// What a status is made of.
struct Doubts<'a> {
    branch: &'a MeasuredBranch,
    load: Load,
    fit: &'a Fit,
    /// In the order of [`NAMES`].
    values: [BranchEstimate; 4],
    misfit: Option<String>,
    other: Option<&'a AlternativeLoad>,
}

impl Doubts<'_> {
    fn status(&self, given: bool) -> Status {
        let mut open = [false; 4];
        let mut reasons: Vec<String> = Vec::new();
        let mut doubt = |names: &[&str], why: String| {
            NAMES.iter().zip(&mut open).filter(|(n, _)| names.contains(n)).for_each(|(_, o)| *o = true);
            reasons.push(why);
        };
        if let Some(why) = &self.misfit {
            doubt(&NAMES, why.clone());
        }
        let [taper, over_stiffness, radius, _] = self.values;
        if let Some(other) = self.other {
            // What the tip does hardly depends on the load.
            let own = taper.value * self.fit.uncertainty.stderr[0];
            doubt(
                &NAMES[..3],
                format!(
                    "no load was stated and an even one taken, with alpha {:.2} ± {own:.2} (chi2 {:.3}); {} explains \
                     the readings {}; state --load",
                    taper.value,
                    self.fit.uncertainty.chi2,
                    other.words(),
                    other.how_well()
                ),
            );
        }
        if self.misfit.is_none() && !self.other.is_some_and(AlternativeLoad::stronger) {
            for (names, why) in bounds::impossible(self.branch, self.load, taper, over_stiffness, radius) {
                doubt(names, why);
            }
        }
        for (value, open) in self.values.iter().zip(&mut open) {
            *open |= !value.sure();
        }
        open[0] |= self.fit.at_bound.contains(&0);
        if !given {
            reasons.push(TIED.into());
        }
        let names = NAMES.iter().zip(open).filter(|(_, open)| *open).map(|(n, _)| self.bounded(n));
        Status::undetermined(names, &reasons.join("; "))
    }

    /// The name of a number that is open. At a bound of the model's range, one side of the taper's interval is known.
    fn bounded(&self, name: &str) -> String {
        let (taper, sigma) = (self.values[0], self.fit.uncertainty.stderr[0]);
        let doubted = self.misfit.is_some() || self.other.is_some();
        if name != NAMES[0] || !self.fit.at_bound.contains(&0) || doubted || !(2.0 * sigma < 3.0) {
            return name.into();
        }
        if taper.value > (TAPER_MIN * TAPER_MAX).sqrt() {
            format!("alpha >= {:.3}", taper.value * (-2.0 * sigma).exp())
        } else {
            format!("alpha <= {:.3e}", taper.value * (2.0 * sigma).exp())
        }
    }
}

/// The termination of a fit that ran, or the code for a fit that was refused.
pub fn termination(result: &Result<BranchFit, String>) -> Termination {
    result.as_ref().map_or(Termination::Refused, |m| m.fit.termination)
}
