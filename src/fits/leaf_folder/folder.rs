//! The folder of a leaf fit: the names of its files, and the fit as it is read.

use crate::leaf_folder::edit::{self, LeafSideEdit};
use crate::leaf_folder::other_side::OtherSide;
use crate::leaf_folder::{Error, Result};
use crate::record::{FitKind, FitRecord, RecordSection};
use mesophyll_files::hash;
use mesophyll_files::image::{self, ChannelMaps, ExrInfo};
use mesophyll_files::mesh::{self, LeafMesh};
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::side::{Side, Sides};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// The blade as a mesh, where the fit made one.
pub const BLADE: &str = "blade.glb";

/// A file that the folder holds for each side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LeafFitFile {
    /// `front.exr`: the quantities, named as [`Quantity::channel`] says.
    Maps,
    /// `front_err.exr`: their standard errors under the same names.
    Errors,
    /// `front_truth.exr`: the true σa and σs of a synthetic capture. It is not part of the fit.
    Truth,
    /// `front_held_out.exr`: frames that the fit did not see.
    HeldOut,
}

impl LeafFitFile {
    /// The files that are part of the fit.
    pub const ALL: [LeafFitFile; 3] = [LeafFitFile::Maps, LeafFitFile::Errors, LeafFitFile::HeldOut];

    /// Name of the file for a side.
    pub fn name(self, side: Side) -> String {
        self.of(side.name())
    }

    /// As [`LeafFitFile::name`], for a section of a record, which need not be a side.
    pub fn of(self, section: &str) -> String {
        let what = match self {
            LeafFitFile::Maps => "",
            LeafFitFile::Errors => "_err",
            LeafFitFile::Truth => "_truth",
            LeafFitFile::HeldOut => "_held_out",
        };
        format!("{section}{what}.exr")
    }

    /// The file of a side in `folder`.
    pub fn path(self, folder: &Path, side: Side) -> PathBuf {
        folder.join(self.name(side))
    }
}

/// A fitted leaf, opened. Its record is read; a side's maps are read once, when they are first asked for.
#[derive(Debug, Clone)]
pub struct LeafFit {
    /// The name that its user gives it; otherwise the name in the record.
    pub name: String,
    /// The folder of the fit.
    pub folder: PathBuf,
    /// Its `fit.toml`.
    pub record: FitRecord,
    maps: Arc<Sides<OnceLock<ChannelMaps>>>,
    /// The side that was not measured, and what a scene says of it.
    other: Option<(Side, OtherSide)>,
    /// What was changed by hand since the leaf was fitted, and the fit before the change.
    edited: Option<(Sides<LeafSideEdit>, Box<LeafFit>)>,
}

impl LeafFit {
    /// Opens the folder of a leaf fit, or of a stated look.
    ///
    /// # Errors
    /// [`Error::Input`] where there is no fit, or one of something else.
    pub fn open(folder: &Path) -> Result<LeafFit> {
        let look = FitRecord::read(folder).is_ok_and(|record| record.kind == FitKind::Look);
        LeafFit::open_as(folder, if look { FitKind::Look } else { FitKind::Leaf })
    }

    /// Whether its look is stated, so that nothing of it was fitted. Its maps are ρd and ρt; there are no σa, σs and γ.
    pub fn is_stated(&self) -> bool {
        self.record.kind == FitKind::Look
    }

    /// Opens the folder of another fit that keeps its maps a side, such as a translucency fit's.
    ///
    /// # Errors
    /// As [`LeafFit::open`].
    pub fn open_as(folder: &Path, kind: FitKind) -> Result<LeafFit> {
        let record = FitRecord::read_as(folder, kind)?;
        let name = record.name.clone();
        Ok(LeafFit { name, folder: folder.into(), record, maps: Arc::default(), other: None, edited: None })
    }

    /// The same under the name that a scene gives it.
    pub fn called(self, name: &str) -> LeafFit {
        LeafFit { name: name.into(), ..self }
    }

    /// The leaf with this for the side that was not measured. A leaf whose sides were both measured stays as it is.
    pub fn completed(self, other: &OtherSide) -> LeafFit {
        let Some(side) = Side::ALL.into_iter().find(|side| !self.has(*side)) else { return self };
        let mut record = self.record.clone();
        if let Some(mut section) = record.sections.get(side.other().name()).cloned() {
            // How well the measured side was met says nothing of this one.
            (section.residuals, section.truth, section.figures) = Default::default();
            (section.held_out, section.light_box) = Default::default();
            record.sections.insert(side.name().into(), section);
        }
        record.options.insert("other_side".into(), other.said(side));
        LeafFit { record, maps: Arc::default(), other: Some((side, other.clone())), ..self }
    }

    /// The side that was not measured, where something stands for it.
    pub fn unmeasured(&self) -> Option<(Side, &OtherSide)> {
        self.other.as_ref().map(|(side, other)| (*side, other))
    }

    /// The leaf with values changed by hand. Its record changes at once, its maps when they are asked for. The ρd and
    /// ρt maps stay unchanged until [`LeafFit::solved`] is called.
    pub fn edited(&self, edits: Sides<LeafSideEdit>) -> LeafFit {
        let fit = self.edited.as_ref().map_or(self, |(_, fit)| fit);
        let mut record = fit.record.clone();
        for (side, edit) in edits.iter() {
            if let Some(section) = record.sections.get_mut(side.name()) {
                edit.record(section);
            }
        }
        LeafFit { record, maps: Arc::default(), edited: Some((edits, Box::new(fit.clone()))), ..fit.clone() }
    }

    /// The sides that were fitted, the front first.
    pub fn sides(&self) -> impl Iterator<Item = Side> {
        Side::ALL.into_iter().filter(|s| self.has(*s))
    }

    /// Whether a side was fitted.
    pub fn has(&self, side: Side) -> bool {
        self.record.sections.contains_key(side.name())
    }

    /// The record's section of a side.
    ///
    /// # Errors
    /// [`Error::Input`] where the side was not fitted.
    pub fn section(&self, side: Side) -> Result<&RecordSection> {
        self.record.sections.get(side.name()).ok_or_else(|| {
            Error::field(&self.record_path(), side.name(), "missing; expected the section of this side of the leaf")
        })
    }

    /// The leaf's σa or σs: one number for each colour channel (1/mm).
    ///
    /// # Errors
    /// [`Error::Input`] that names the field, for anything but three finite numbers of at least 0.
    pub fn rgb(&self, side: Side, quantity: Quantity) -> Result<[f64; 3]> {
        let values = self.param(side, quantity)?;
        match values {
            [r, g, b] if values.iter().all(|v| v.is_finite() && *v >= 0.0) => Ok([*r, *g, *b]),
            _ => {
                Err(self.bad(side, quantity, &format!("found {values:?}, expected three finite numbers of at least 0")))
            }
        }
    }

    /// Mean thickness h (mm).
    ///
    /// # Errors
    /// [`Error::Input`] that names the field, for anything but one positive number.
    pub fn thickness(&self, side: Side) -> Result<f64> {
        match self.param(side, Quantity::Thickness)? {
            [h] if *h > 0.0 && h.is_finite() => Ok(*h),
            other => Err(self.bad(
                side,
                Quantity::Thickness,
                &format!("found {other:?}, expected one positive length in mm"),
            )),
        }
    }

    /// Size of a texel (mm).
    ///
    /// # Errors
    /// [`Error::Input`] that names the field, for anything but a positive number.
    pub fn texel_mm(&self) -> Result<f64> {
        const FIELD: &str = "texel_mm";
        let found = self.record.options.get(FIELD).map_or("nothing", String::as_str);
        match found.parse::<f64>() {
            Ok(v) if v > 0.0 && v.is_finite() => Ok(v),
            _ => Err(Error::field(
                &self.record_path(),
                &format!("options.{FIELD}"),
                format!("found {found}, expected a positive length in mm"),
            )),
        }
    }

    fn param(&self, side: Side, quantity: Quantity) -> Result<&[f64]> {
        let param = self.section(side)?.params.get(quantity.name());
        param.map(|p| p.value.as_slice()).ok_or_else(|| self.bad(side, quantity, "missing"))
    }

    fn bad(&self, side: Side, quantity: Quantity, what: &str) -> Error {
        Error::field(&self.record_path(), &format!("{}.{}", side.name(), quantity.name()), what)
    }

    /// Path of its `fit.toml`.
    pub fn record_path(&self) -> PathBuf {
        self.folder.join("fit.toml")
    }

    /// Path of a file of a side.
    pub fn path(&self, file: LeafFitFile, side: Side) -> PathBuf {
        file.path(&self.folder, side)
    }

    /// The maps of a side.
    ///
    /// # Errors
    /// [`Error::Input`] for a file that is missing or damaged.
    pub fn maps(&self, side: Side) -> Result<&ChannelMaps> {
        let place = &self.maps[side];
        if let Some(maps) = place.get() {
            return Ok(maps);
        }
        let maps = match (&self.edited, &self.other) {
            (None, Some((own, other))) if *own == side => other.maps(self, side)?,
            (None, _) => image::read_exr(&self.path(LeafFitFile::Maps, side))?,
            (Some((edits, fit)), _) => {
                let mut maps = fit.maps(side)?.clone();
                edits[side].maps(&mut maps, self.thickness(side)?);
                maps
            }
        };
        Ok(place.get_or_init(|| maps))
    }

    /// Whether the maps of a side are in memory.
    pub fn is_read(&self, side: Side) -> bool {
        self.maps[side].get().is_some()
    }

    /// The maps of a side in which ρd and ρt are computed by the slab, texel by texel, from γ, the thickness and the
    /// leaf's σa and σs: what an edited leaf reflects and transmits. Those of a stated look are what is stated.
    ///
    /// # Errors
    /// As [`LeafFit::maps`], and for a parameter or a channel that is missing.
    pub fn solved(&self, side: Side) -> Result<ChannelMaps> {
        if self.is_stated() {
            return self.maps(side).cloned();
        }
        let (sigma_a, sigma_s) = (self.rgb(side, Quantity::SigmaA)?, self.rgb(side, Quantity::SigmaS)?);
        let mut maps = self.maps(side)?.clone();
        edit::solve(&self.path(LeafFitFile::Maps, side), &mut maps, sigma_a, sigma_s)?;
        Ok(maps)
    }

    /// The side whose mean thickness is used for the leaf: the front where it was fitted.
    pub fn lead(&self) -> Side {
        if self.has(Side::Front) { Side::Front } else { Side::Back }
    }

    /// Size and channels of a side's maps.
    ///
    /// # Errors
    /// [`Error::Input`] for a file that is missing or damaged.
    pub fn info(&self, side: Side) -> Result<ExrInfo> {
        let own = self.unmeasured().is_some_and(|(other, _)| other == side);
        image::exr_info(&self.path(LeafFitFile::Maps, if own { side.other() } else { side }))
    }

    /// The blade's mesh; `None` where the fit made none.
    ///
    /// # Errors
    /// [`Error::Input`] for a mesh that cannot be read.
    pub fn blade(&self) -> Result<Option<LeafMesh>> {
        let path = self.folder.join(BLADE);
        path.is_file().then(|| mesh::read(&path, None)).transpose()
    }

    /// Hashes one of the folder's files again and compares the hash with the one that the fit recorded.
    ///
    /// # Errors
    /// [`Error::Missed`] for a file that changed since, or that `fit.toml` does not list.
    pub fn verify(&self, file: &str) -> Result<()> {
        let path = self.folder.join(file);
        match self.record.files.get(file) {
            None => Err(Error::Missed(format!("{}: fit.toml lists no content hash for it", path.display()))),
            Some(expected) if &hash::file(&path)? != expected => Err(Error::Missed(format!(
                "{}: changed since it was fitted (its content hash is not the one in fit.toml)",
                path.display()
            ))),
            Some(_) => Ok(()),
        }
    }
}
