//! Which bands `mesophyll eval bands` is asked for.

use crate::cli::{Error, Result};
use mesophyll_files::spectra;
use mesophyll_files::table::{InputTable, TableRecord};
use mesophyll_sky::response::ObserverResponse;
use mesophyll_sky::sensor::SensorBand;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// What `--response` says.
#[derive(Debug, Clone, PartialEq)]
pub enum ResponseChoice {
    /// A published one.
    Published(ObserverResponse),
    /// Bands that see their wavelengths alike.
    Boxes(Vec<SensorBand>),
    /// The responses of a table.
    Table(PathBuf),
}

/// What the bands see.
#[derive(Debug)]
pub enum BandResponse {
    /// A published response.
    Published(ObserverResponse),
    /// The user's own bands.
    Own(Vec<SensorBand>),
}

impl FromStr for ResponseChoice {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<ResponseChoice, String> {
        if let Ok(known) = text.parse() {
            return Ok(ResponseChoice::Published(known));
        }
        let number = |part: &str| part.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        let part = |part: &str| {
            let (centre, width) = part.split_once(':')?;
            Some((centre.trim().to_string(), number(centre)?, number(width)?))
        };
        let parts: Vec<Option<(String, f64, f64)>> = text.split(',').map(part).collect();
        if parts.iter().all(Option::is_none) {
            return match Path::new(text).extension() {
                Some(_) => Ok(ResponseChoice::Table(text.into())),
                None => Err("expected srgb, cie-1931, a table such as response.csv, or bands as centre:width in nm \
                             such as 490:65,560:35"
                    .into()),
            };
        }
        let mut bands: Vec<SensorBand> = Vec::new();
        for (part, said) in parts.into_iter().zip(text.split(',')) {
            let Some((name, centre, width)) = part.filter(|(_, _, width)| *width > 0.0) else {
                return Err(format!("found {said}, expected a centre and a width in nm, such as 490:65"));
            };
            if bands.iter().any(|band| band.name == name) {
                return Err(format!("two bands have the centre {name}; expected each once"));
            }
            bands.push(SensorBand::of_box(&name, centre, width).map_err(|why| format!("band {name}: {why}"))?);
        }
        Ok(ResponseChoice::Boxes(bands))
    }
}

impl ResponseChoice {
    /// The response.
    ///
    /// # Errors
    /// [`Error::Input`] for a table that holds none.
    pub fn read(&self) -> Result<BandResponse> {
        Ok(match self {
            ResponseChoice::Published(known) => BandResponse::Published(*known),
            ResponseChoice::Boxes(bands) => BandResponse::Own(bands.clone()),
            ResponseChoice::Table(path) => BandResponse::Own(of_table(path)?),
        })
    }
}

/// The bands of a table: each column beside `wavelength_nm` is one.
fn of_table(path: &Path) -> Result<Vec<SensorBand>> {
    let mut table = InputTable::open(path)?;
    let Some((wavelength, unit_nm)) = spectra::wavelength(&table)? else {
        let what = format!("no such column; the header has {}", table.shown_header());
        return Err(Error::field(table.name(), "wavelength_nm", what));
    };
    let across = table.require(&wavelength)?;
    let names = table.header.clone();
    if names.len() < 2 {
        return Err(Error::input(table.name(), "no column beside the wavelengths; expected one for each band"));
    }
    // The answer has a column r_NAME and r_NAME_err for each band, and others with `abaxial_` for lower sides.
    if let Some(taken) = names.iter().find(|name| name.ends_with("_err") || name.starts_with("abaxial_")) {
        let what = "found a column whose name is one of the answer's; expected the name of a band";
        return Err(Error::field(table.name(), taken, what));
    }
    let (mut rows, mut record): (Vec<Vec<f64>>, _) = (Vec::new(), TableRecord::default());
    while table.next_record(&mut record)? {
        let bad = |what: String| Err(Error::field(table.name(), &format!("line {}", record.line()), what));
        if let Some(fault) = record.fault(names.len()) {
            return bad(fault);
        }
        let mut row = Vec::with_capacity(names.len());
        for (k, name) in names.iter().enumerate() {
            match table.number(&record, k) {
                Ok(Some(value)) if k == across => row.push(spectra::in_nm(value, unit_nm)),
                Ok(Some(value)) => row.push(value),
                Ok(None) => {
                    return bad(format!("{name} has no number; expected one in every row, 0 where a band is blind"));
                }
                Err(why) => return bad(why),
            }
        }
        rows.push(row);
    }
    rows.sort_by(|a, b| a[across].total_cmp(&b[across]));
    let band = |(k, name): (usize, &String)| {
        let points = rows.iter().map(|row| [row[across], row[k]]).collect();
        SensorBand::of_points(name, points).map_err(|why| Error::field(table.name(), name, why))
    };
    names.iter().enumerate().filter(|(k, _)| *k != across).map(band).collect()
}

impl BandResponse {
    /// The names of its bands in columns.
    pub fn names(&self) -> Vec<&str> {
        match self {
            BandResponse::Published(known) => known.letters().to_vec(),
            BandResponse::Own(bands) => bands.iter().map(|band| band.name.as_str()).collect(),
        }
    }

    /// For each band the weights of readings at these wavelengths (nm), which ascend.
    ///
    /// # Errors
    /// A sentence where the readings do not cover what a band sees, or lie too far apart.
    pub fn weights(&self, wavelengths: &[f64]) -> std::result::Result<Vec<Vec<f64>>, String> {
        match self {
            BandResponse::Published(known) => {
                let each = known.weights(wavelengths)?;
                Ok((0..3).map(|c| each.iter().map(|w| w[c]).collect()).collect())
            }
            BandResponse::Own(bands) => {
                let of =
                    |band: &SensorBand| band.weights(wavelengths).map_err(|why| format!("band {}: {why}", band.name));
                bands.iter().map(of).collect()
            }
        }
    }
}
