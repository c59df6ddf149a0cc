//! The checks that every capture's manifest must pass: schema, size of photographs, lengths and noises. Each refusal
//! names the file, the field, what was found and what was expected.

use crate::{Error, Result};
use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::Path;

/// The manifest at `path`.
#[derive(Debug, Clone, Copy)]
pub struct ManifestCheck<'a> {
    /// Path of the file.
    pub path: &'a Path,
}

impl ManifestCheck<'_> {
    /// The refusal of one field.
    pub fn wrong(&self, field: &str, found: impl Display, expected: &str) -> Error {
        Error::unexpected(self.path, field, found, expected)
    }

    /// The schema this program writes, and photographs of a size that is allowed.
    pub fn photographs(&self, schema: u32, width: usize, height: usize, texels: RangeInclusive<usize>) -> Result<()> {
        if schema != 1 {
            return Err(self.wrong("schema", schema, "1"));
        }
        match [("width", width), ("height", height)].into_iter().find(|(_, value)| !texels.contains(value)) {
            Some((field, value)) => {
                Err(self.wrong(field, value, &format!("{} to {} texels", texels.start(), texels.end())))
            }
            None => Ok(()),
        }
    }

    /// Checks lengths of a device: between a nanometre and ten kilometres. Beyond these, arithmetic is tested and not a
    /// device.
    pub fn positive_mm<'a>(&self, lengths: impl IntoIterator<Item = (&'a str, f64)>) -> Result<()> {
        match lengths.into_iter().find(|(_, value)| !(1e-6..=1e7).contains(value)) {
            Some((field, value)) => Err(self.wrong(field, value, "a positive length in mm, 1e-6 to 1e7")),
            None => Ok(()),
        }
    }

    /// Checks a leaf's thickness: the thinnest leaves are some tens of micrometres thick, succulent ones some tens of
    /// millimetres.
    pub fn thickness_mm(&self, field: &str, value: f64) -> Result<()> {
        if (1e-3..=100.0).contains(&value) {
            Ok(())
        } else {
            Err(self.wrong(field, value, "a leaf's thickness: a positive length in mm, 0.001 to 100 (150 µm is 0.15)"))
        }
    }

    /// Checks numbers that may be left out, such as noises: zero or more.
    pub fn not_negative<const N: usize>(&self, numbers: [(&str, Option<f64>); N]) -> Result<()> {
        let stated = numbers.into_iter().filter_map(|(field, value)| Some((field, value?)));
        match stated.into_iter().find(|(_, value)| !(0.0..=1e7).contains(value)) {
            Some((field, value)) => Err(self.wrong(field, value, "zero or a positive number up to 1e7")),
            None => Ok(()),
        }
    }
}
