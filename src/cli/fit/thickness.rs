//! The thickness of a leaf in a table: its unit, and limits. What no leaf has is never called ok.

use crate::cli::{Error, Result};
use mesophyll_files::table::Status;
use mesophyll_files::unit::LengthUnit;
use mesophyll_fits::slab;

/// Range of a leaf's thickness (mm), with a margin at both ends. The same thicknesses in µm are numbers above this
/// range, and in m numbers below it. So a column that names no unit shows by its numbers whether it can be in mm.
pub const LEAVES_MM: [f64; 2] = [0.01, 10.0];

/// Coefficients above this (1/mm) belong to no tissue.
const TISSUE: f64 = 1e3;

/// Why no leaf has this thickness or these coefficients, if so.
pub fn no_leaf(column: &str, thickness: f64, unit: Option<LengthUnit>, values: &[f64]) -> Option<String> {
    let unit = unit.unwrap_or(LengthUnit::Millimetre);
    let leaf = |t: f64, unit: LengthUnit| (LEAVES_MM[0]..=LEAVES_MM[1]).contains(&(t * unit.mm()));
    if !leaf(thickness, unit) {
        let [low, high] = LEAVES_MM.map(|mm| mm / unit.mm());
        let others = [LengthUnit::Micrometre, LengthUnit::Millimetre, LengthUnit::Metre]
            .into_iter()
            .filter(|u| leaf(thickness, *u));
        let others: Vec<&'static str> = others.map(Into::into).collect();
        let hint = if others.is_empty() { String::new() } else { format!("; is it in {}?", others.join(" or ")) };
        let name: &'static str = unit.into();
        return Some(format!(
            "{column} is {thickness}; leaves have {low} to {high} {name}{hint} --any-thickness if it is right"
        ));
    }
    let above = values.iter().take(2).position(|v| *v > TISSUE && v.is_finite())?;
    Some(format!(
        "{} is above {TISSUE}/mm, more than any tissue has; are thickness, rho_d and rho_t in their units? \
         --any-thickness if they are",
        slab::OUTPUTS[above]
    ))
}

/// The status of numbers that no leaf has: never ok.
pub fn doubted(status: Status, why: &str) -> Status {
    match status {
        Status::Ok => Status::undetermined(["sigma_a", "sigma_s"], why),
        Status::Undetermined(what) => Status::undetermined([what], why),
        refused => refused,
    }
}

/// Why a thickness without a unit is not taken for mm, and how to make it readable.
pub fn not_in_mm(column: &str, thickness: f64) -> String {
    let [low, high] = LEAVES_MM;
    let hint = if (1e3 * low..=1e3 * high).contains(&thickness) {
        "; in um such numbers are usual: add --thickness-unit um"
    } else if (1e-3 * low..=1e-3 * high).contains(&thickness) {
        "; in m such numbers are usual: add --thickness-unit m"
    } else {
        "; add --thickness-unit"
    };
    format!(
        "{column} is {thickness} and names no unit; in mm this is outside the usual range of leaves, {low} to \
         {high}{hint} (or mm if the number is right)"
    )
}

/// The unit that is asked for, or that the column's name ends in; `None` where neither states one (a column `h` is in
/// mm). A name that states another unit than the one asked for, or an unknown one, is an error: micrometres read as
/// millimetres would look like an answer.
pub fn thickness_unit(column: &str, asked: Option<LengthUnit>) -> Result<Option<LengthUnit>> {
    let suffix = column.rsplit_once(['_', ' ', '(', '[']).map_or("", |(_, end)| end.trim_end_matches([')', ']']));
    let named = suffix.parse::<LengthUnit>().ok();
    // Nobody measures leaves in these: such a name is more likely a mistake than a unit.
    if ["cm", "dm", "nm", "km", "in", "inch", "inches", "mil", "mils", "ft"].contains(&suffix) {
        return Err(Error::Usage(format!("the thickness column {column:?} is in {suffix:?}; expected mm, um or m")));
    }
    match (named, asked) {
        (Some(named), Some(asked)) if named != asked => Err(Error::Usage(format!(
            "--thickness-unit contradicts the unit in the name of the thickness column, {column:?}"
        ))),
        (None, None) if column == "h" => Ok(Some(LengthUnit::Millimetre)),
        (named, asked) => Ok(asked.or(named)),
    }
}
