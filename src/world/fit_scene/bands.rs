//! Numbers of many bands: what leaves and ground scatter at each wavelength, and the spectra that were found.

use crate::Result;
use crate::quantity::{UnknownKind, UnknownQuantity};
use crate::unknowns::SceneUnknowns;
use mesophyll_files::atomic;
use mesophyll_fits::record::RecordSection;
use mesophyll_scene::draw::bands;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::{AREA, StatedLeaf};
use mesophyll_transport::path::SurfaceBands;
use std::path::Path;

/// What a scene scatters at the wavelengths that were measured.
pub struct SceneBands {
    /// Wavelengths (nm).
    pub wavelengths: Vec<f64>,
    /// What each leaf of the world scatters, as the scene states it.
    pub surfaces: Vec<SurfaceBands>,
}

impl SceneBands {
    /// # Errors
    /// [`Error::Input`] where something has no spectrum, or one that does not cover the wavelengths.
    pub fn new(scene: &LoadedScene, wavelengths: &[f64]) -> Result<SceneBands> {
        Ok(SceneBands { wavelengths: wavelengths.to_vec(), surfaces: bands::surfaces(scene, wavelengths)? })
    }

    /// The name of each band's numbers.
    pub fn names(&self) -> Vec<String> {
        self.wavelengths.iter().map(|nm| format!("{nm}nm")).collect()
    }

    /// The unknowns that `asked` names, of a leaf of the world.
    ///
    /// # Errors
    /// A sentence for a number that bands do not have.
    pub fn unknowns(
        &self,
        k: usize,
        leaf: &StatedLeaf,
        asked: &[String],
    ) -> std::result::Result<Vec<UnknownQuantity>, String> {
        let (of, free) = (&self.surfaces[k], |what: &str| asked.iter().any(|n| n == what));
        let [front, back] = &of.rho_d;
        // What a side reflects and lets through is at most all of the light.
        let rest = |list: &[f64], taken: bool| -> Vec<f64> {
            list.iter().map(|v| if taken { (1.0 - v).max(0.0) } else { 1.0 }).collect()
        };
        let [beside_t, larger] =
            [of.rho_t.clone(), front.iter().zip(back).map(|(a, b)| a.max(*b)).collect::<Vec<f64>>()];
        let (beside_t, beside_d) = (rest(&beside_t, !free("rho_t")), rest(&larger, !free("rho_d")));
        let one = |kind, name: &str, at: &[f64], high: &[f64]| {
            reflectance(kind, &format!("leaf.{}.{name}", leaf.name), at, high)
        };
        let mut out = Vec::new();
        for what in asked {
            match what.as_str() {
                "rho_d" if leaf.discs.is_some() => {
                    let mean: Vec<f64> = front.iter().zip(back).map(|(a, b)| 0.5 * (a + b)).collect();
                    out.push(one(UnknownKind::RhoDBoth(k), "rho_d", &mean, &beside_t));
                }
                "rho_d" => {
                    out.push(one(UnknownKind::RhoD(k, false), "front.rho_d", front, &beside_t));
                    out.push(one(UnknownKind::RhoD(k, true), "back.rho_d", back, &beside_t));
                }
                "rho_t" => out.push(one(UnknownKind::RhoT(k), "rho_t", &of.rho_t, &beside_d)),
                other => {
                    let more = if leaf.discs.is_some() { format!(", or {AREA}") } else { String::new() };
                    return Err(format!(
                        "found \"{other}\", expected some of rho_d, rho_t, the numbers that have a value at each \
                         wavelength{more}"
                    ));
                }
            }
        }
        Ok(out)
    }

    /// What everything scatters with the present numbers.
    pub fn with(&self, list: &[UnknownQuantity]) -> Vec<SurfaceBands> {
        let mut out = self.surfaces.clone();
        for q in list {
            match &q.kind {
                UnknownKind::RhoD(leaf, back) => out[*leaf].rho_d[usize::from(*back)].clone_from(&q.at),
                UnknownKind::RhoDBoth(leaf) => out[*leaf].rho_d = [q.at.clone(), q.at.clone()],
                UnknownKind::Ground(leaf) => out[*leaf].rho_d[0].clone_from(&q.at),
                UnknownKind::RhoT(leaf) => out[*leaf].rho_t.clone_from(&q.at),
                _ => {}
            }
        }
        out
    }
}

/// Shares of the light, one a band.
fn reflectance(kind: UnknownKind, name: &str, at: &[f64], high: &[f64]) -> UnknownQuantity {
    let (at, high) = (at.to_vec(), high.to_vec());
    UnknownQuantity { kind, name: name.into(), at, low: 0.0, high, scale: None }
}

/// The file with the spectrum that was found of a leaf, or of the ground.
pub fn file(leaf: Option<&str>) -> String {
    leaf.map_or_else(|| "ground.csv".into(), |name| format!("leaf-{name}.csv"))
}

/// Writes what was found of each leaf and of the ground as spectra that scenes read, with standard errors where there
/// are any. Returns the files' names.
///
/// # Errors
/// [`Error::Write`].
pub fn save(numbers: &SceneUnknowns, section: &RecordSection, out: &Path) -> Result<Vec<String>> {
    let Some(bands) = &numbers.bands else { return Ok(Vec::new()) };
    let surfaces = bands.with(&numbers.list);
    let mut files = Vec::new();
    for (k, name) in numbers.banded() {
        let (of, name) = (&surfaces[k], name.as_deref());
        let discs = numbers.list.iter().any(|q| q.kind == UnknownKind::RhoDBoth(k));
        let same = of.rho_d[0] == of.rho_d[1];
        // Which name a column's numbers have in the record.
        let columns: Vec<(&str, &[f64], String)> = match name {
            None => vec![("albedo", &of.rho_d[0], "ground.albedo".into())],
            Some(name) => {
                let number = |number: &str| format!("leaf.{name}.{number}");
                let mut list = vec![("R", &of.rho_d[0][..], number(if discs { "rho_d" } else { "front.rho_d" }))];
                if !same {
                    list.push(("R_abaxial", &of.rho_d[1], number("back.rho_d")));
                }
                list.push(("T", &of.rho_t, number("rho_t")));
                list
            }
        };
        let mut text = String::from("wavelength_nm");
        columns.iter().for_each(|(column, ..)| text += &format!(",{column},{column}_err"));
        for (k, (nm, band)) in bands.wavelengths.iter().zip(&numbers.channels).enumerate() {
            text += &format!("\n{nm}");
            for (_, values, own) in &columns {
                let param = section.params.get(&format!("{own}.{band}"));
                let error = param.and_then(|p| p.stderr.first()).filter(|e| e.is_finite());
                text += &format!(",{:.6},{}", values[k], error.map_or(String::new(), |e| format!("{e:.6}")));
            }
        }
        let file = file(name);
        atomic::write_bytes(&out.join(&file), format!("{text}\n").as_bytes())?;
        files.push(file);
    }
    Ok(files)
}
