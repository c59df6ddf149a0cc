//! A leaf from one picture, or from the pictures of a texture atlas: a look that is stated and not fitted.
//!
//! It becomes the same folder that a fit of a leaf leaves: maps of ρd, ρt, gloss and normals a side, and a blade. So
//! scenes and exports need no second way. `fit.toml` says by its kind that nothing was fitted, and names every value
//! that nobody measured ([`FitRecord::stated`]). There are no σa, σs and γ, because a picture says nothing of tissue.

mod output;
#[cfg(test)]
mod tests;
mod texels;

use crate::record::maker::{self, FitMaker, FitOutcome};
use crate::record::{FitKind, FitRecord};
use crate::{Error, Result};
use mesophyll_capture::photo::manifest::TransferCurve;
use mesophyll_files::hash;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Slope m of the gloss where none is stated.
const SLOPE: f64 = 0.2;
/// Thickness where none is stated (mm): that of a thin broad leaf.
const THICKNESS_MM: f64 = 0.2;
/// Texels along the longer side of the maps where none are stated.
const TEXELS: usize = 1024;
/// Smallest slope of the gloss that both renderers draw.
const LEAST_SLOPE: f64 = 1e-3;

/// Which way green counts in a map of normals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GreenConvention {
    /// Up in the picture.
    Opengl,
    /// Down in the picture.
    Directx,
}

/// What is stated of a leaf. Every picture has the columns of the front, also that of the back.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Look {
    /// The picture of the front. Its colours are taken for ρd.
    pub albedo: PathBuf,
    /// The curve by which numbers of colours stand for light; when absent, the one that the file's own profile states.
    pub transfer: Option<TransferCurve>,
    /// A picture whose brightness is the opacity; when absent, the opacity that the albedo's file holds.
    pub opacity: Option<PathBuf>,
    /// Opacity from which a texel is on the leaf.
    pub cutoff: Option<f64>,
    /// The picture of the back; when absent, the back has the front's colours.
    pub back: Option<PathBuf>,
    /// A picture of the light that comes through: colours are ρt themselves, one channel is a share of the albedo.
    pub translucency: Option<PathBuf>,
    /// Factor on the picture of the light that comes through, 1 when absent; without that picture, on the albedo.
    pub rho_t_factor: Option<f64>,
    /// A map of normals of the front, each n coded as (n + 1)/2.
    pub normal: Option<PathBuf>,
    /// Which way its green counts.
    pub green: Option<GreenConvention>,
    /// Left, top, width and height of the rectangle of all pictures that is the leaf (pixels).
    pub region: Option<[usize; 4]>,
    /// Width of the picture, or of the region (mm).
    pub width_mm: Option<f64>,
    /// Largest number of texels along a side of the maps.
    pub texels: Option<usize>,
    /// Reflectance ρs of the gloss on both sides; the leaf is matte when absent.
    pub rho_s: Option<[f64; 3]>,
    /// Root mean square slope m of the gloss.
    pub m: Option<f64>,
    /// Thickness (mm).
    pub thickness_mm: Option<f64>,
}

impl Look {
    /// Reads a look from a file of its own, whose pictures are named relative to it.
    ///
    /// # Errors
    /// [`Error::Input`] naming the file and the field.
    pub fn read(path: &Path) -> Result<Look> {
        let look: Look = crate::record::read_toml(path)?;
        if let Some((field, what)) = look.fault() {
            return Err(Error::field(path, field, what));
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        Ok(look.resolved(|picture| folder.join(picture)))
    }

    /// The same with other paths of its pictures.
    pub fn resolved(&self, place: impl Fn(&Path) -> PathBuf) -> Look {
        let mut look = self.clone();
        look.albedo = place(&look.albedo);
        for picture in [&mut look.opacity, &mut look.back, &mut look.translucency, &mut look.normal] {
            *picture = picture.as_ref().map(|p| place(p));
        }
        look
    }

    /// The first field that is wrong, whatever the pictures hold, and a sentence about it.
    pub fn fault(&self) -> Option<(&'static str, String)> {
        let Some(width) = self.width_mm else {
            let what = "missing; a picture has no scale: expected the width of the picture, or of the region, in mm";
            return Some(("width_mm", what.into()));
        };
        let within = |name, value: Option<f64>, [low, high]: [f64; 2], unit: &str| {
            let value = value.filter(|v| !(low..=high).contains(v))?;
            Some((name, format!("found {value}, expected {low} to {high}{unit}")))
        };
        let gloss = self.rho_s.iter().flatten();
        within("width_mm", Some(width), [0.1, 1e4], " mm")
            .or_else(|| within("cutoff", self.cutoff, [0.01, 0.99], " of the opacity"))
            .or_else(|| within("rho_t_factor", self.rho_t_factor, [0.0, 10.0], ""))
            .or_else(|| within("texels", self.texels.map(|n| n as f64), [16.0, 8192.0], " texels"))
            .or_else(|| within("thickness_mm", self.thickness_mm, [1e-3, 100.0], " mm"))
            .or_else(|| within("m", self.m, [LEAST_SLOPE, 2.0], ", a slope"))
            .or_else(|| gloss.copied().find_map(|v| within("rho_s", Some(v), [0.0, 1.0], " a channel")))
            .or_else(|| self.beside())
    }

    /// A field that is missing beside another one, or that means nothing without it.
    fn beside(&self) -> Option<(&'static str, String)> {
        let missing = |name, what: &str| Some((name, format!("missing; {what}")));
        match self {
            Look { translucency: None, rho_t_factor: None, .. } => missing(
                "rho_t_factor",
                "no picture shows the light that comes through: expected translucency = a picture, or a factor on the \
                 albedo, such as 0.8",
            ),
            Look { normal: Some(_), green: None, .. } => missing(
                "green",
                "expected \"opengl\" (green counts up in the picture) or \"directx\" (down); the source of the map \
                 says which",
            ),
            Look { normal: None, green: Some(_), .. } => Some(("green", "given without a map of normals".into())),
            Look { rho_s: None, m: Some(_), .. } => {
                Some(("m", "given without rho_s; a matte leaf has no slope".into()))
            }
            _ => None,
        }
    }

    /// Every picture by the field that names it.
    fn pictures(&self) -> impl Iterator<Item = (&'static str, &PathBuf)> {
        let more = [
            ("opacity", &self.opacity),
            ("back", &self.back),
            ("translucency", &self.translucency),
            ("normal", &self.normal),
        ];
        [("albedo", &self.albedo)].into_iter().chain(more.into_iter().filter_map(|(n, p)| Some((n, p.as_ref()?))))
    }

    /// The input hash of the folder that is made of it. Where its pictures lie does not count.
    ///
    /// # Errors
    /// [`Error::Input`] for a picture that cannot be read.
    pub fn input_hash(&self) -> Result<String> {
        let stated = format!("{:?}", self.resolved(|p| p.file_name().map(PathBuf::from).unwrap_or_default()));
        let pictures: Vec<(&str, String)> =
            self.pictures().map(|(name, path)| Ok((name, hash::file(path)?))).collect::<Result<_>>()?;
        let parts = pictures.iter().map(|(name, hash)| (*name, hash.as_str()));
        Ok(maker::input_hash(parts.chain([("stated", stated.as_str())])))
    }

    fn cutoff(&self) -> f64 {
        self.cutoff.unwrap_or(0.5)
    }

    fn rho_s(&self) -> [f64; 3] {
        self.rho_s.unwrap_or_default()
    }
}

/// Makes the folder of a look, under the name that the leaf gets; `force` makes it again although it is there.
///
/// # Errors
/// [`Error::Input`] for pictures that cannot be read or contradict what is stated; a folder that cannot be written or
/// holds something else.
pub fn run(look: &Look, name: &str, out: &Path, force: bool) -> Result<FitRecord> {
    let inputs: Vec<PathBuf> = look.pictures().map(|(_, path)| path.clone()).collect();
    let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
    let (look, name) = (look.clone(), name.to_string());
    match maker::make(FitKind::Look, out, &inputs, move |maker| make(&look, &name, force, maker))? {
        FitOutcome::Done(record) | FitOutcome::UpToDate(record) => Ok(*record),
        FitOutcome::ShardDone { .. } => Err(Error::Missed("a look has no shards".into())),
    }
}

fn make(look: &Look, name: &str, force: bool, maker: &mut FitMaker) -> Result<FitOutcome> {
    let input = maker.phase("hash the pictures", || look.input_hash())?;
    if let Some(found) = maker.up_to_date(input, force)? {
        return Ok(found);
    }
    let found = maker.phase("read the pictures", || texels::read(look))?;
    let mut record = maker.record(name);
    let out = maker.begin()?.to_path_buf();
    maker.phase("blade and maps", || output::write(&out, look, name, &found, &mut record))?;
    Ok(FitOutcome::Done(maker.finish(record)?))
}
