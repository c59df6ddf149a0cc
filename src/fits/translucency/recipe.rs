//! How translucency maps were made, as the options and parameters in `fit.toml` state it. Only this module writes and
//! reads these.

use super::tissue::{self, LightEntry};
use super::{Options, TexelArea, TranslucencyColour};
use crate::record::FitRecord;
use crate::translucency::{Error, Result};
use mesophyll_files::quantity::RGB;
use mesophyll_optics::dipole::{DipoleForm, Tissue};
use mesophyll_optics::side::Side;
use std::collections::BTreeMap;
use std::path::Path;

/// What the light of one map depends on, besides the leaf and its tissue.
#[derive(Debug, Clone, PartialEq)]
pub struct TranslucencyRecipe {
    /// What the colour is taken from.
    pub colour: TranslucencyColour,
    /// How much light enters a texel.
    pub entry: LightEntry,
    /// Over which area a texel's light is counted.
    pub area: TexelArea,
    /// Form of the dipole whose point response spreads the light.
    pub form: DipoleForm,
    /// 0 red, 1 green, 2 blue.
    pub channels: Vec<usize>,
}

impl TranslucencyRecipe {
    /// The part of a fit's options that decides how one map is lit, for these channels (0 red, 1 green, 2 blue).
    pub fn of(options: &Options, channels: &[usize]) -> TranslucencyRecipe {
        let Options { colour, area, form, .. } = *options;
        TranslucencyRecipe { colour, entry: tissue::entry(options), area, form, channels: channels.to_vec() }
    }

    /// Writes the recipe into a record's options.
    pub fn write(&self, options: &mut BTreeMap<String, String>) {
        let form = match self.form {
            DipoleForm::Thin => "thin".into(),
            DipoleForm::Images => "images".into(),
            DipoleForm::Dipoles(n) => format!("dipoles {n}"),
        };
        let channels = self.channels.iter().map(|c| RGB[*c]).collect::<Vec<_>>().join(" ");
        for (name, text) in [
            ("colour", self.colour.name().into()),
            ("entry", self.entry.name().into()),
            ("area", self.area.name().into()),
            ("form", form),
            ("channel", channels),
        ] {
            options.insert(name.into(), text);
        }
    }

    /// Reads the recipe from the record of maps in `folder`; `None` where the maps do not say how they were made.
    ///
    /// # Errors
    /// [`Error::Input`] for an option that is missing or has an unknown name.
    pub fn read(record: &FitRecord, folder: &Path) -> Result<Option<TranslucencyRecipe>> {
        let said = |name: &str| record.options.get(name).map(String::as_str);
        let bad = |name: &str, expected: &str| {
            let found = said(name).unwrap_or("nothing");
            let what = format!("found {found}, expected {expected}");
            Error::field(&folder.join("fit.toml"), &format!("options.{name}"), what)
        };
        let Some(colour) = said("colour") else { return Ok(None) };
        let form = said("form").and_then(|name| match name {
            "thin" => Some(DipoleForm::Thin),
            "images" => Some(DipoleForm::Images),
            _ => name.strip_prefix("dipoles")?.trim().parse().ok().map(DipoleForm::Dipoles),
        });
        let letters = said("channel").unwrap_or_default().split_whitespace();
        let channels: Option<Vec<usize>> = letters.map(|l| RGB.iter().position(|c| *c == l)).collect();
        let parsed = |name: &str| said(name).unwrap_or_default();
        Ok(Some(TranslucencyRecipe {
            colour: colour.parse().map_err(|_| bad("colour", "substituted, product or three-wavelengths"))?,
            entry: parsed("entry").parse().map_err(|_| bad("entry", "matched or albedo"))?,
            area: parsed("area").parse().map_err(|_| bad("area", "facet or texel"))?,
            form: form.ok_or_else(|| bad("form", "thin, images or dipoles N"))?,
            channels: channels.filter(|c| !c.is_empty()).ok_or_else(|| bad("channel", "R, G or B"))?,
        }))
    }

    /// Whether a record's maps were made with the colour and the entry that are asked for, as far as the record says.
    pub fn agrees(record: &FitRecord, asked: &Options) -> bool {
        let mut wanted = BTreeMap::new();
        TranslucencyRecipe::of(asked, &[]).write(&mut wanted);
        ["colour", "entry"].iter().all(|name| record.options.get(*name).is_none_or(|said| *said == wanted[*name]))
    }
}

/// The tissue behind a side in the `k`-th of the recipe's channels.
///
/// # Errors
/// [`Error::Input`] for a parameter that is missing or not a number.
pub fn tissue(record: &FitRecord, folder: &Path, side: Side, k: usize) -> Result<Tissue> {
    let (file, side) = (folder.join("fit.toml"), side.name());
    let section = record.sections.get(side).ok_or_else(|| Error::field(&file, side, "missing"))?;
    let one = |name: &str| {
        section.params.get(name).and_then(|p| p.value.get(k)).copied().filter(|v| v.is_finite()).ok_or_else(|| {
            Error::field(&file, &format!("{side}.{name}"), format!("expected at least {} finite numbers", k + 1))
        })
    };
    Ok(Tissue { sigma_a: one("sigma_a")?, sigma_s: one("sigma_s")?, g: one("g")?, a: one("a")? })
}
