//! A side of a leaf fit as it lies on disk.

use crate::{Error, Result};
use mesophyll_files::image::{self, Maps};
use std::path::Path;

pub const RGB: [&str; 3] = ["R", "G", "B"];

/// Maps, errors (where there are any) and the mask of `front` or `back`.
#[derive(Debug)]
pub struct SideMaps {
    pub name: String,
    pub maps: Maps,
    pub errors: Option<Maps>,
    /// Normals in the blade's tangent frame (`X`, `Y`, `Z`).
    pub blade_normals: Option<Maps>,
    /// 1 good, 0 outside, negative: a defect; all 1 where the fit holds no mask.
    pub mask: Vec<f32>,
}

impl SideMaps {
    pub fn read(folder: &Path, name: &str) -> Result<SideMaps> {
        let maps = image::read_exr(&folder.join(format!("{name}.exr")))?;
        let same_size = |path: &Path, other: Maps| {
            if (other.width, other.height) == (maps.width, maps.height) {
                return Ok(other);
            }
            let what = format!("found {} × {}, expected {} × {}", other.width, other.height, maps.width, maps.height);
            Err(Error::field(path, "size", what))
        };
        let optional = |what: &str| {
            let path = folder.join(format!("{name}_{what}.exr"));
            if path.exists() { image::read_exr(&path).and_then(|m| same_size(&path, m)).map(Some) } else { Ok(None) }
        };
        let (errors, blade_normals) = (optional("err")?, optional("normal")?);
        let mask = maps.get("mask.Y").map_or_else(|| vec![1.0; maps.width * maps.height], <[f32]>::to_vec);
        Ok(SideMaps { name: name.into(), maps, errors, blade_normals, mask })
    }

    /// Three channels of a quantity.
    ///
    /// # Errors
    /// [`Error::Input`] naming the channel that is not there.
    pub fn rgb(&self, quantity: &str, folder: &Path) -> Result<[&[f32]; 3]> {
        let path = folder.join(format!("{}.exr", self.name));
        let plane = |c: &str| self.maps.require(&path, &format!("{quantity}.{c}"));
        Ok([plane("R")?, plane("G")?, plane("B")?])
    }

    pub fn one(&self, channel: &str, folder: &Path) -> Result<&[f32]> {
        self.maps.require(&folder.join(format!("{}.exr", self.name)), channel)
    }

    /// The 1st and 99th percentile over the good texels.
    pub fn range(&self, plane: &[f32]) -> (f64, f64) {
        let mut values: Vec<f32> =
            plane.iter().zip(&self.mask).filter(|(v, m)| **m > 0.5 && v.is_finite()).map(|(v, _)| *v).collect();
        values.sort_unstable_by(f32::total_cmp);
        let at =
            |q: f64| values.get(((values.len().saturating_sub(1)) as f64 * q).round() as usize).copied().unwrap_or(0.0);
        (f64::from(at(0.01)), f64::from(at(0.99)))
    }
}
