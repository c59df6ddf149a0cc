//! What the form of a table states besides its cells.

use super::{InstrumentFile, InstrumentFormat, ReflectanceUnit, SpectrumQuantity};
use crate::{Error, Result, progress};
use std::path::Path;

/// What a file of an instrument states besides the readings that became a table.
#[derive(Debug, Clone, PartialEq)]
pub struct InstrumentStatement {
    /// Its form.
    pub form: InstrumentFormat,
    /// Unit of reflectance and transmittance; `None` where the form states none.
    pub unit: Option<ReflectanceUnit>,
    /// Refractive index of the sample, where the form states one.
    pub index: Option<f64>,
    /// Whether light that leaves the sample beside the instrument's ports is missing from its readings.
    pub loses_light: bool,
    /// The quantities that were read.
    holds: Vec<SpectrumQuantity>,
    notes: Vec<String>,
}

impl InstrumentStatement {
    pub(super) fn of(file: &InstrumentFile) -> InstrumentStatement {
        let holds = [SpectrumQuantity::Reflectance, SpectrumQuantity::Transmittance]
            .into_iter()
            .filter(|q| file.has(*q))
            .collect();
        InstrumentStatement {
            form: file.form,
            unit: file.unit,
            index: file.index,
            loses_light: file.loses_light,
            holds,
            notes: file.notes.clone(),
        }
    }

    pub(super) fn of_sheet(notes: Vec<String>) -> InstrumentStatement {
        InstrumentStatement {
            form: InstrumentFormat::Xlsx,
            unit: None,
            index: None,
            loses_light: false,
            holds: Vec::new(),
            notes,
        }
    }

    /// What a user should know of what was read.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Says which form was read, and its notes.
    pub(super) fn say(&self, path: &Path) {
        let unit = self.unit.map_or_else(String::new, |unit| format!(", in {unit}"));
        let holds = self.holds.iter().map(ToString::to_string).collect::<Vec<_>>().join(" and ");
        let holds = if holds.is_empty() { String::new() } else { format!(" with {holds}{unit}") };
        progress::say(format!("{} is {}{holds}", path.display(), self.form.name()));
        self.notes.iter().for_each(|note| progress::say(format!("  {note}")));
    }

    /// Why a command that needs the column `name` cannot use this file, and which command can.
    pub fn lacks(&self, name: &str) -> String {
        let form = self.form.name();
        if self.form == InstrumentFormat::Xlsx {
            return format!(
                "no column {name} in the sheet that was read of {form}; `mesophyll inspect` says what it holds"
            );
        }
        let percent = if self.unit == Some(ReflectanceUnit::PerCent) { " --percent" } else { "" };
        let holds = self.holds.iter().map(ToString::to_string).collect::<Vec<_>>().join(" and ");
        let missing = match name {
            "h" | "thickness" | "thickness_mm" | "thickness_um" | "thickness_m" => {
                let both = [SpectrumQuantity::Reflectance, SpectrumQuantity::Transmittance];
                let other = both.into_iter().find(|q| !self.holds.contains(q));
                other.map_or_else(String::new, |q| format!("{q} and no ")) + "thickness"
            }
            "rho_d" | "R" => SpectrumQuantity::Reflectance.to_string(),
            "rho_t" | "T" => SpectrumQuantity::Transmittance.to_string(),
            _ => format!("column {name}"),
        };
        format!(
            "{form} has no {missing}; it holds {holds} by wavelength, which `mesophyll fit foliar --pigments \
             TABLE.csv{percent}` takes"
        )
    }

    /// Whether what was asked for agrees with the unit that the form states. `percent`: the option `--percent`.
    ///
    /// # Errors
    /// The form states per cent and nobody asked for it, or the other way round.
    pub fn check_percent(&self, path: &Path, percent: bool) -> Result<()> {
        let form = self.form.name();
        match (self.unit, percent) {
            (Some(ReflectanceUnit::PerCent), false) => {
                Err(Error::input(path, format!("{form} states its numbers in per cent: add --percent")))
            }
            (Some(ReflectanceUnit::Share), true) => {
                Err(Error::input(path, format!("{form} states its numbers as shares of 1: leave --percent out")))
            }
            _ => Ok(()),
        }
    }

    /// Whether the refractive index that was asked for (`--index`, 1 where it was not given) is the one that the form
    /// states, within what dispersion may change.
    ///
    /// # Errors
    /// The form states another index.
    pub fn check_index(&self, path: &Path, asked: f64) -> Result<()> {
        match self.index {
            Some(n) if (n - asked).abs() > 0.03 => Err(Error::input(
                path,
                format!("{} states a sample of refractive index {n}: add --index {n}", self.form.name()),
            )),
            _ => Ok(()),
        }
    }
}
