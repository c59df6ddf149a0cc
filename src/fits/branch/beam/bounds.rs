//! What no branch has: readings, units and results that cannot be, each with the likely cause.

use super::fit::{BranchEstimate, DeflectionMark, MeasuredBranch, PositionReference};
use mesophyll_plants::mechanics::load::Load;

/// Slack on what cannot be: a share of the length or distance, besides five standard errors of a deflection.
const SLACK: f64 = 0.02;
/// Readings that cannot be are left out while they are at most this share of all.
const FEW: f64 = 0.25;
/// Moduli of elasticity (GPa) outside of which there is no solid that a branch could be: from soft rubber to steel.
const SOLID: [f64; 2] = [1e-3, 250.0];
/// Moduli of elasticity (GPa) of stems and wood, green or dry (Wood Handbook, USDA Forest Products Laboratory, chapter
/// 5, has .5 to 25 for wood along and across its grain).
const WOOD: [f64; 2] = [0.01, 40.0];
/// A beam is slender up to this thickness over its length. Above, shear, which is not in the model, adds more than a
/// tenth to the deflection of wood.
const THICK: f64 = 0.2;

/// Why a reading cannot be used or cannot be; `None` where nothing is wrong with it. `with_errors`: whether deflections
/// of this branch have stated errors.
fn fault(r: &DeflectionMark, length: f64, along: PositionReference, with_errors: bool) -> Option<String> {
    let DeflectionMark { position, deflection, error } = *r;
    if !(0.0..=length * (1.0 + 1e-9)).contains(&position) {
        return Some(format!("position_mm is {position}; expected 0 to length_mm, {length}{}", unit(position, length)));
    }
    if !deflection.is_finite() {
        return Some(format!("deflection_mm is {deflection} at position_mm {position}; expected a number"));
    }
    if error <= 0.0 || error.is_infinite() {
        return Some(format!("deflection_err_mm is {error} at position_mm {position}; expected more than 0"));
    }
    if with_errors && error.is_nan() {
        return Some(format!(
            "deflection_err_mm is missing at position_mm {position}; other rows of this branch have it"
        ));
    }
    let slack = if error.is_nan() { 0.0 } else { 5.0 * error };
    let (reach, of, limit) = match along {
        PositionReference::Branch => (deflection.abs(), "than it is along the branch from the root", position),
        PositionReference::Axis => (deflection.hypot(position), "from the root than length_mm", length),
    };
    (reach > limit * (1.0 + SLACK) + slack + 1e-3 * length).then(|| {
        format!(
            "deflection_mm is {deflection} at position_mm {position}: no mark moves further {of}; are positions, \
             deflections and length_mm all in mm?"
        )
    })
}

/// A guess where a position lies far beyond the length.
fn unit(position: f64, length: f64) -> &'static str {
    match position / length {
        share if !(share > 5.0) => "",
        share if share < 50.0 => "; is the length in cm?",
        _ => "; is the length in m?",
    }
}

/// The readings that can be used, and why the others cannot.
///
/// # Errors
/// The first of the faults, where more than a quarter of the readings have one.
pub fn usable(branch: &MeasuredBranch, along: PositionReference) -> Result<(Vec<DeflectionMark>, Vec<String>), String> {
    let with_errors = branch.readings.iter().any(|r| !r.error.is_nan());
    let (mut good, mut faults) = (Vec::new(), Vec::new());
    for r in &branch.readings {
        match fault(r, branch.length, along, with_errors) {
            Some(why) => faults.push(why),
            None => good.push(*r),
        }
    }
    if faults.len() as f64 > FEW * branch.readings.len() as f64 {
        let first = faults.swap_remove(0);
        return Err(first);
    }
    Ok((good, faults))
}

/// Checks what belongs to the branch as a whole.
///
/// # Errors
/// A length, load or modulus that is not positive, in words.
pub fn check(branch: &MeasuredBranch) -> Result<(), String> {
    let length = branch.length;
    if !(length > 0.0 && length.is_finite()) {
        return Err(format!("length_mm is {length}; expected more than 0"));
    }
    for (name, [value, error]) in [("load_n", branch.load), ("modulus_gpa", branch.modulus)] {
        if value <= 0.0 || value.is_infinite() {
            return Err(format!("{name} is {value}; expected more than 0"));
        }
        if error < 0.0 || error.is_infinite() {
            return Err(format!("the error of {name} is {error}; expected 0 or more"));
        }
    }
    Ok(())
}

/// A number that no branch has: the output columns that it spoils, and why.
pub type ImpossibleValue = (&'static [&'static str], String);

/// What is impossible in a result.
pub fn impossible(
    branch: &MeasuredBranch,
    load: Load,
    taper: BranchEstimate,
    over_stiffness: BranchEstimate,
    radius: BranchEstimate,
) -> Vec<ImpossibleValue> {
    let mut out: Vec<ImpossibleValue> = Vec::new();
    if taper.value - 2.0 * taper.error > 1.0 {
        let hang = if load == Load::Tip { "" } else { ", or does the load hang nearer to the tip (--load tip)" };
        out.push((
            &["alpha", "load_over_stiffness_mm", "root_radius_mm"],
            format!(
                "alpha is {:.2}, thicker at the tip than at the root: are positions measured from the tip{hang}?",
                taper.value
            ),
        ));
    }
    if over_stiffness.value < 0.0 {
        out.push((
            &["load_over_stiffness_mm", "root_radius_mm"],
            "the branch moves against its load: deflections are positive in the direction of the load; are they \
             heights?"
                .into(),
        ));
    }
    let [_, modulus] = [branch.load[0], branch.modulus[0]];
    if modulus.is_finite() && !(SOLID[0]..=SOLID[1]).contains(&modulus) {
        let guess = if modulus > 1e6 { "Pa" } else { "MPa (N/mm2)" };
        let guess = if modulus > 1.0 { format!("; is it in {guess}?") } else { String::new() };
        out.push((&["root_radius_mm"], format!("modulus_gpa is {modulus}, which no branch has{guess}")));
    } else if radius.value > 0.5 * THICK * branch.length {
        out.push((
            &["root_radius_mm", "load_over_stiffness_mm", "alpha"],
            format!(
                "a root radius of {:.1} mm on a length of {} mm is too thick for a bending beam: are load_n in N, \
                 modulus_gpa in GPa and lengths in mm?",
                radius.value, branch.length
            ),
        ));
    }
    out
}

/// What is unusual in a measured branch without being wrong.
pub fn unusual(branch: &MeasuredBranch) -> Option<String> {
    let modulus = branch.modulus[0];
    let odd = (SOLID[0]..=SOLID[1]).contains(&modulus) && !(WOOD[0]..=WOOD[1]).contains(&modulus);
    odd.then(|| format!("modulus_gpa is {modulus}, which no wood has ({} to {})", WOOD[0], WOOD[1]))
}
