//! A side of a leaf fit as it lies on disk.

use crate::{Error, Result};
use mesophyll_base::statistics::quantile;
use mesophyll_files::image::{self, ChannelMaps};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_files::quantity::Quantity;
use mesophyll_fits::leaf_folder::{LeafFitFile, packing};
use mesophyll_fits::record::FitRecord;
use mesophyll_optics::side::Side;
use std::path::Path;

/// Maps, errors (where there are any) and the mask of a side.
#[derive(Debug)]
pub struct ExportSideMaps {
    /// Which side of the leaf.
    pub side: Side,
    /// The named maps.
    pub maps: ChannelMaps,
    /// Their standard errors, where the fit has any.
    pub errors: Option<ChannelMaps>,
    /// 1 good, 0 outside, negative: a defect; all 1 where the fit holds no mask.
    pub mask: Vec<f32>,
}

impl ExportSideMaps {
    /// Every side that was fitted.
    ///
    /// # Errors
    /// [`Error::Usage`] for a fit without maps; those of [`ExportSideMaps::read`].
    pub fn all(record: &FitRecord, folder: &Path) -> Result<Vec<ExportSideMaps>> {
        let fitted = Side::ALL.into_iter().filter(|s| record.sections.contains_key(s.name()));
        let sides: Vec<ExportSideMaps> = fitted.map(|s| ExportSideMaps::read(folder, s)).collect::<Result<_>>()?;
        if sides.is_empty() {
            let what = "which has no maps; it can be exported as json";
            return Err(Error::Usage(format!("{} is a {}, {what}", folder.display(), record.kind.words())));
        }
        Ok(sides)
    }

    /// # Errors
    /// [`crate::Error::Input`] for a map that cannot be read, or errors or a blade that do not fit to it.
    pub fn read(folder: &Path, side: Side) -> Result<ExportSideMaps> {
        let path = LeafFitFile::Maps.path(folder, side);
        let maps = image::read_exr(&path)?;
        let errors = LeafFitFile::Errors.path(folder, side);
        let errors = errors.exists().then(|| image::read_exr(&errors).map(|m| (m, errors))).transpose()?;
        let errors = errors.map(|(m, path)| m.require_size(&path, maps.width, maps.height).map(|()| m)).transpose()?;
        let mask = maps.scalar(Quantity::Mask).map_or_else(|| vec![1.0; maps.width * maps.height], <[f32]>::to_vec);
        Ok(ExportSideMaps { side, maps, errors, mask })
    }

    /// Three channels of a quantity.
    ///
    /// # Errors
    /// [`crate::Error::Input`] naming the channel that is not there.
    pub fn rgb(&self, quantity: Quantity, folder: &Path) -> Result<[&[f32]; 3]> {
        self.maps.require_three(&LeafFitFile::Maps.path(folder, self.side), quantity)
    }

    /// The only channel of a quantity.
    ///
    /// # Errors
    /// As [`ExportSideMaps::rgb`].
    pub fn one(&self, quantity: Quantity, folder: &Path) -> Result<&[f32]> {
        self.maps.require_scalar(&LeafFitFile::Maps.path(folder, self.side), quantity)
    }

    /// Normals in the blade's tangent frame; `None` where the fit holds none.
    ///
    /// # Errors
    /// [`crate::Error::Input`] for a blade that covers no texel.
    pub fn normals(&self, blade: &LeafMesh, folder: &Path) -> Result<Option<Vec<[f32; 3]>>> {
        let found = self.maps.three(Quantity::Normal).is_some();
        let path = LeafFitFile::Maps.path(folder, self.side);
        found.then(|| packing::tangent_normals(&path, &self.maps, self.side, blade)).transpose()
    }

    /// The 1st and 99th percentile over the good texels.
    pub fn range(&self, plane: &[f32]) -> (f64, f64) {
        let mut values: Vec<f32> =
            plane.iter().zip(&self.mask).filter(|(v, m)| **m > 0.5 && v.is_finite()).map(|(v, _)| *v).collect();
        let mut at = |share: f64| quantile(&mut values, share).map_or(0.0, f64::from);
        (at(0.01), at(0.99))
    }
}
