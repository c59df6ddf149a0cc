//! The place of a fault in a scene file, and the checks that many fields share.

use crate::manifest::{Error, LeafOrigin, Result, SceneManifest, StatedLeaf};
use mesophyll_base::error::Fault;
use std::collections::BTreeSet;

/// The manifest and its text. The text tells the line of a fault.
pub struct ManifestText<'a> {
    pub manifest: &'a SceneManifest,
    pub text: &'a str,
}

impl<'a> ManifestText<'a> {
    /// An error at `key` of the `index`-th table with this `header` (`""` means the top of the file).
    pub fn error(&self, header: &str, index: usize, key: &str, what: impl std::fmt::Display) -> Error {
        let table = header.trim_matches(['[', ']']);
        let field = match (table, key) {
            ("", k) => k.to_string(),
            (t, "") => t.to_string(),
            (t, k) => format!("{t}.{k}"),
        };
        Error::Input {
            file: self.manifest.path.display().to_string(),
            line: line_of(self.text, header, index, key).and_then(|line| u32::try_from(line).ok()),
            field: Some(field),
            fault: Fault::Other(what.to_string()),
        }
    }

    pub fn range(&self, header: &str, index: usize, key: &str, value: f64, limits: [f64; 2], unit: &str) -> Result<()> {
        let [low, high] = limits;
        if value >= low && value <= high {
            return Ok(());
        }
        let limits =
            if high.is_finite() { format!("{low} to {high} {unit}") } else { format!("at least {low} {unit}") };
        Err(self.error(header, index, key, format!("found {value}, expected {}", limits.trim_end())))
    }

    pub fn positive(&self, header: &str, index: usize, key: &str, value: f64, unit: &str) -> Result<()> {
        if value > 0.0 && value.is_finite() {
            return Ok(());
        }
        Err(self.error(header, index, key, format!("found {value}, expected a positive {unit}")))
    }

    pub fn finite(&self, header: &str, index: usize, key: &str, values: &[f64]) -> Result<()> {
        if values.iter().all(|v| v.is_finite()) {
            return Ok(());
        }
        Err(self.error(header, index, key, format!("found {values:?}, expected finite numbers")))
    }

    pub fn colour(&self, header: &str, key: &str, values: &[f64; 3]) -> Result<()> {
        if values.iter().all(|v| v.is_finite() && *v >= 0.0) {
            return Ok(());
        }
        Err(self.error(header, 0, key, format!("found {values:?}, expected three numbers of at least 0")))
    }

    pub fn reflectance(&self, header: &str, index: usize, key: &str, values: &[f64; 3]) -> Result<()> {
        if values.iter().all(|v| (0.0..=1.0).contains(v)) {
            return Ok(());
        }
        Err(self.error(header, index, key, format!("found {values:?}, expected three reflectances, 0 to 1")))
    }

    pub fn leaf(&self, header: &str, index: usize, key: &str, name: &str) -> Result<()> {
        if self.manifest.leaf_index(name).is_some() {
            return Ok(());
        }
        let known: Vec<&str> = self.manifest.leaves.iter().map(|l| l.name.as_str()).collect();
        Err(self.error(
            header,
            index,
            key,
            format!("found \"{name}\", expected one of the scene's leaves ({})", known.join(", ")),
        ))
    }

    /// Checks that the leaf of a view that compares it with its fit exists and is fitted.
    pub fn fitted_leaf(&self, header: &str, index: usize, name: &str) -> Result<()> {
        self.leaf(header, index, "leaf", name)?;
        let stated = |leaf: &StatedLeaf| match leaf.origin {
            LeafOrigin::Uniform(_) => Some("uniform"),
            LeafOrigin::Layered(_) => Some("stated by its layers"),
            LeafOrigin::Look(_) => Some("stated by its look"),
            LeafOrigin::Fitted(_) | LeafOrigin::Other => None,
        };
        match self.manifest.leaf_index(name).and_then(|k| stated(&self.manifest.leaves[k])) {
            Some(how) => Err(self.error(header, index, "leaf", format!("\"{name}\" is {how}, expected a fitted leaf"))),
            None => Ok(()),
        }
    }

    /// An empty record of the names in tables with this header. `what` says what is named, for errors.
    pub fn names(&self, header: &'static str, what: &'static str) -> TableNames<'a, '_> {
        TableNames { place: self, header, what, seen: BTreeSet::new() }
    }
}

/// The names in the tables of one header. Each must be plain enough for a file's name, and used once only.
pub struct TableNames<'a, 'p> {
    place: &'p ManifestText<'a>,
    header: &'static str,
    what: &'static str,
    seen: BTreeSet<&'a str>,
}

impl<'a> TableNames<'a, '_> {
    /// Records the name of the `index`-th table.
    ///
    /// # Errors
    /// [`Error::Input`] for characters other than letters, digits, - and _, and for a name that another table has.
    pub fn take(&mut self, index: usize, name: &'a str) -> Result<()> {
        if !plain(name) {
            return Err(self.place.error(
                self.header,
                index,
                "name",
                format!("found \"{name}\", expected letters, digits, - and _"),
            ));
        }
        if !self.seen.insert(name) {
            let what = self.what;
            return Err(self.place.error(
                self.header,
                index,
                "name",
                format!("\"{name}\" is used twice, expected one {what} a name"),
            ));
        }
        Ok(())
    }
}

/// Whether a text has only letters, digits, - and _, so that it can name a file.
pub fn plain(name: &str) -> bool {
    !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_')
}

/// Line (from 1) of `key = …` in the `index`-th table with this header. Where the key is missing, the line of the
/// header.
fn line_of(text: &str, header: &str, index: usize, key: &str) -> Option<usize> {
    let (mut seen, mut inside, mut fallback) = (0, header.is_empty(), None);
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.starts_with('[') {
            if inside {
                break;
            }
            if line.split('#').next().map(str::trim) == Some(header) {
                inside = seen == index;
                seen += 1;
                if inside {
                    fallback = Some(number + 1);
                }
            }
        } else if inside && line.strip_prefix(key).is_some_and(|rest| rest.trim_start().starts_with('=')) {
            return Some(number + 1);
        }
    }
    fallback
}
