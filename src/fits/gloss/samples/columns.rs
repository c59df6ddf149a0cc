//! Columns of a goniometer table: which angles and readings there are, in which units, and the directions they give.

use super::{GlossFitSettings, GlossSample};
use crate::{Error, Result};
use mesophyll_files::table::InputTable;

const ANGLES: [&str; 3] = ["source_zenith", "view_zenith", "view_azimuth"];
/// The angle that a table may leave out: it is then 0.
const OPTIONAL: &str = "source_azimuth";
/// A reflectance factor below this is no noise about zero.
const LEAST: f64 = -0.05;
/// Parts of the names of columns that say something of a direction.
const DIRECTIONAL: [&str; 22] = [
    "azimuth",
    "zenith",
    "phi",
    "theta",
    "azi",
    "zen",
    "elevation",
    "altitude",
    "incidence",
    "incident",
    "inclination",
    "polarisation",
    "polarization",
    "saa",
    "sza",
    "vza",
    "vaa",
    "raa",
    "tilt",
    "tts",
    "tto",
    "psi",
];

/// The columns of a table that are read.
#[derive(Debug, Clone)]
pub(super) struct Columns {
    /// Names of the angles and what turns their numbers into degrees, in the order of [`ANGLES`].
    angles: Vec<(String, f64)>,
    /// The source's azimuth, where the table has it.
    azimuth: Option<(String, f64)>,
    /// Names of the columns of readings.
    pub values: Vec<String>,
}

impl Columns {
    /// Finds the columns. `values`: those of readings; where none are named, all that begin with `brf`.
    ///
    /// # Errors
    /// A column that is missing, named twice, or one that says something of the directions that is not understood.
    pub fn of(table: &InputTable, values: &[String]) -> Result<Columns> {
        let values: Vec<String> = if values.is_empty() {
            table.header.iter().filter(|h| h.starts_with("brf")).cloned().collect()
        } else {
            values.to_vec()
        };
        if values.is_empty() {
            if let Some(stated) = table.stated() {
                return Err(Error::input(table.name(), stated.lacks("brf")));
            }
            return Err(Error::input(
                table.name(),
                "no value columns: name them with --values, or begin their names with brf",
            ));
        }
        if let Some(twice) = values.iter().enumerate().find(|(k, v)| values[..*k].contains(v)) {
            return Err(Error::Usage(format!("--values names {} twice", twice.1)));
        }
        for name in &values {
            table.require(name)?;
        }
        let mut angles = Vec::new();
        for name in ANGLES {
            let (column, factor) = table.angle(name)?;
            if table.column(&column).is_none() {
                table.require(&format!("{name}_deg"))?;
            }
            angles.push((column, factor.to_degrees()));
        }
        let azimuth = table.angle(OPTIONAL).map(|(name, factor)| (name, factor.to_degrees()))?;
        let azimuth = table.column(&azimuth.0).is_some().then_some(azimuth);
        let known = |h: &String| angles.iter().chain(&azimuth).any(|(name, _)| name == h) || values.contains(h);
        let told = |h: &&String| {
            let word = h.to_lowercase();
            word.split(|c: char| !c.is_alphabetic()).any(|part| DIRECTIONAL.contains(&part))
        };
        if let Some(column) = table.header.iter().find(|h| told(h) && !known(h)) {
            return Err(Error::field(
                table.name(),
                column,
                "a column that says something of the directions, and is not understood; directions are \
                 source_zenith_deg, source_azimuth_deg (0 where there is none), view_zenith_deg and view_azimuth_deg \
                 (without _deg: radians); rename it to the one that it is, or remove it",
            ));
        }
        Ok(Columns { angles, azimuth, values })
    }

    /// Names of the columns with angles that every row must have.
    pub fn required(&self) -> Vec<String> {
        self.angles.iter().chain(&self.azimuth).map(|(name, _)| name.clone()).collect()
    }

    /// The direction of a row: numbers in the order of [`Columns::required`], then readings. With it come sentences
    /// about readings that were left out.
    ///
    /// # Errors
    /// A sentence that names the angle that cannot be used.
    pub fn sample(
        &self,
        cells: &[f64],
        settings: &GlossFitSettings,
    ) -> std::result::Result<(GlossSample, Vec<String>), String> {
        let (angles, values) = cells.split_at(self.angles.len() + usize::from(self.azimuth.is_some()));
        let stated = self.angles.iter().chain(&self.azimuth);
        let mut degrees = [0.0; 4];
        for ((degree, x), (name, factor)) in degrees.iter_mut().zip(angles).zip(stated) {
            *degree = x * factor;
            if !x.is_finite() {
                return Err(format!("{name} is {x}; expected degrees"));
            }
            if name.contains("zenith") && degree.abs() >= 90.0 - 1e-9 {
                let most = if *factor == 1.0 { "90 degrees" } else { "a quarter of a turn" };
                return Err(format!("{name} is {x}; expected below {most}"));
            }
        }
        direction(degrees, values, &self.values, settings)
    }
}

/// A sample from the angles source zenith, view zenith, view azimuth, source azimuth (degrees) and readings whose
/// columns are called `names`.
fn direction(
    [source, view, azimuth, turned]: [f64; 4],
    values: &[f64],
    names: &[String],
    settings: &GlossFitSettings,
) -> std::result::Result<(GlossSample, Vec<String>), String> {
    let mut left = Vec::new();
    let unit = if settings.percent { 0.01 } else { 1.0 };
    let reading = |(x, name): (&f64, &String)| {
        let value = unit * x;
        if x.is_infinite() || value < LEAST {
            left.push(format!("{name} is {x}; expected a reflectance factor"));
            return f64::NAN;
        }
        value
    };
    let values = values.iter().zip(names).map(reading).collect();
    let mirror = if settings.mirror_azimuth == Some(0) { 180.0 } else { 0.0 };
    let source = [source.to_radians(), turned.to_radians()];
    let view = [view.to_radians(), (azimuth + mirror).to_radians()];
    Ok((GlossSample::between(source, view, values), left))
}

/// A direction with its readings: `cells` holds source zenith, view zenith and view azimuth (degrees), then the
/// readings, whose columns are called `names`.
///
/// # Errors
/// A sentence that names the number that cannot be used.
pub fn sample(cells: &[f64], names: &[String]) -> std::result::Result<GlossSample, String> {
    let angles = ANGLES.map(|name| (format!("{name}_deg"), 1.0)).to_vec();
    let columns = Columns { angles, azimuth: None, values: names.to_vec() };
    let (sample, left) = columns.sample(cells, &GlossFitSettings::default())?;
    left.into_iter().next().map_or(Ok(sample), Err)
}
