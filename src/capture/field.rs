//! What every capture's manifest is held to: its schema, the size of its photographs, lengths and noises. Each refusal names the file, the field, what was
//! found and what was expected.

use crate::{Error, Result};
use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::Path;

/// The manifest at `path`.
#[derive(Debug, Clone, Copy)]
pub struct Fields<'a> {
    pub path: &'a Path,
}

impl Fields<'_> {
    /// The refusal of one field.
    pub fn wrong(&self, field: &str, found: impl Display, expected: &str) -> Error {
        Error::field(self.path, field, format!("found {found}, expected {expected}"))
    }

    /// The schema this program writes, and photographs of a size that is allowed.
    pub fn photographs(&self, schema: u32, width: usize, height: usize, texels: RangeInclusive<usize>) -> Result<()> {
        if schema != 1 {
            return Err(self.wrong("schema", schema, "1"));
        }
        match [("width", width), ("height", height)].into_iter().find(|(_, value)| !texels.contains(value)) {
            Some((field, value)) => Err(self.wrong(field, value, &format!("{} to {} texels", texels.start(), texels.end()))),
            None => Ok(()),
        }
    }

    pub fn positive_mm<const N: usize>(&self, lengths: [(&str, f64); N]) -> Result<()> {
        match lengths.into_iter().find(|(_, value)| !(*value > 0.0 && value.is_finite())) {
            Some((field, value)) => Err(self.wrong(field, value, "a positive length in mm")),
            None => Ok(()),
        }
    }

    pub fn not_negative<const N: usize>(&self, numbers: [(&str, Option<f64>); N]) -> Result<()> {
        let stated = numbers.into_iter().filter_map(|(field, value)| Some((field, value?)));
        match stated.into_iter().find(|(_, value)| !(*value >= 0.0 && value.is_finite())) {
            Some((field, value)) => Err(self.wrong(field, value, "zero or a positive number")),
            None => Ok(()),
        }
    }
}
