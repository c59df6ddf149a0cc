//! Reflectance and transmittance of blades: a table with an entry for each material (format:
//! `data/grass/optics/leaves.toml`).

use crate::grass::{Error, Result};
use mesophyll_files::{hash, whole_file};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

/// The table that is used where none is named.
const STATED: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/grass/optics/leaves.toml"));

/// A Lambertian sheet. The numbers are shares of the light in linear red, green and blue.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Optics {
    /// Reflectance of the front and of the back.
    pub rho_d: [[f64; 3]; 2],
    /// Transmittance, the same from either side.
    pub rho_t: [f64; 3],
}

/// The optics of each material, by its name.
pub type LawnMaterials = BTreeMap<String, Optics>;

/// The text by which a record names the table in `path`: its name and its hash.
///
/// # Errors
/// [`Error::Input`] for a table that cannot be read.
pub fn told(path: Option<&Path>) -> Result<String> {
    let Some(path) = path else { return Ok("stated, the program's own table".into()) };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    Ok(format!("stated, the table {name} ({})", hash::file(path)?))
}

/// Reads the table in `path`, or the program's own where no path is given.
///
/// # Errors
/// [`Error::Input`] for a table that cannot be read, or for a share that is negative or larger than 1.
pub fn read(path: Option<&Path>) -> Result<LawnMaterials> {
    let (path, text) = match path {
        Some(path) => (path, whole_file::text(path)?),
        None => (Path::new("data/grass/optics/leaves.toml"), STATED.to_string()),
    };
    let leaves: LawnMaterials = toml::from_str(&text).map_err(|e| Error::toml(path, &text, &e))?;
    for (name, leaf) in &leaves {
        for (side, rho_d) in ["front", "back"].into_iter().zip(leaf.rho_d) {
            for c in 0..3 {
                let (r, t) = (rho_d[c], leaf.rho_t[c]);
                if !(r >= 0.0 && t >= 0.0 && r + t <= 1.0) {
                    let found = format!("{r} reflected and {t} let through ({side}, channel {c})");
                    return Err(Error::unexpected(path, name, found, "shares of 0 or more, together at most 1"));
                }
            }
        }
    }
    Ok(leaves)
}
