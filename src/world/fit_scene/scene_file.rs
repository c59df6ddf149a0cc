//! The scene with what was found, as a file that other verbs take.

use crate::quantity::{SlabNumber, UnknownKind};
use crate::unknowns::SceneUnknowns;
use crate::{Error, Result, bands};
use mesophyll_files::whole_file;
use mesophyll_optics::foliar::pigments::SUBSTANCES;
use mesophyll_scene::manifest::SceneManifest;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// The text of the scene with the present numbers in the place of its own. Names of files that exist become whole
/// paths, because the new file lies in another folder. What was measured and what was unknown is left out.
///
/// # Errors
/// A scene file that can no longer be read.
pub fn found(manifest: &SceneManifest, numbers: &SceneUnknowns, out: &Path) -> Result<String> {
    let text = whole_file::text(&manifest.path)?;
    let mut table: Table = toml::from_str(&text).map_err(|e| Error::toml(&manifest.path, &text, &e))?;
    ["picture", "unknown", "brf"].iter().for_each(|key| drop(table.remove(*key)));
    let none = Default::default();
    let asked = manifest.unknown.as_ref().map_or(&none, |unknown| &unknown.leaves);
    let (present, index) = (numbers, |k: usize| numbers.leaf_name(k));
    // A leaf with a spectrum need not state what is found of it.
    for leaf in manifest.leaves.iter().filter(|leaf| asked.contains_key(&leaf.name)) {
        let stated = leaf.uniform().filter(|uniform| uniform.slab.is_none());
        if let (Some(stated), Some(table)) = (stated, uniform(&mut table, &leaf.name)) {
            let three = |v: [f64; 3]| Value::Array(v.map(Value::Float).to_vec());
            table.entry("rho_d").or_insert_with(|| Value::Array(stated.rho_d.map(three).to_vec()));
            table.entry("rho_t").or_insert_with(|| three(stated.rho_t));
        }
    }
    // Numbers of bands are spectra, which lie beside the new file.
    for q in numbers.list.iter().filter(|_| numbers.bands.is_none()) {
        let numbers = Value::Array(q.at.iter().map(|v| Value::Float(*v)).collect());
        match &q.kind {
            UnknownKind::RhoD(leaf, back) => {
                if let Some(Value::Array(both)) = uniform(&mut table, &index(*leaf)).and_then(|u| u.get_mut("rho_d"))
                    && let Some(side) = both.get_mut(usize::from(*back))
                {
                    *side = numbers;
                }
            }
            UnknownKind::RhoDBoth(leaf) => {
                let both = Value::Array(vec![numbers.clone(), numbers]);
                set(uniform(&mut table, &index(*leaf)), "rho_d", both);
            }
            UnknownKind::RhoT(leaf) => set(uniform(&mut table, &index(*leaf)), "rho_t", numbers),
            UnknownKind::RhoS(leaf) => set(uniform(&mut table, &index(*leaf)), "rho_s", numbers),
            UnknownKind::Slope(leaf) => set(uniform(&mut table, &index(*leaf)), "m", Value::Float(q.at[0])),
            UnknownKind::Ground(_) => set(table.get_mut("ground").and_then(Value::as_table_mut), "albedo", numbers),
            UnknownKind::Sun => set(table.get_mut("sun").and_then(Value::as_table_mut), "irradiance", numbers),
            UnknownKind::Turbidity => {
                set(table.get_mut("sky").and_then(Value::as_table_mut), "turbidity", Value::Float(q.at[0]));
            }
            UnknownKind::SkyScale => {
                let sky = table.get_mut("sky").and_then(Value::as_table_mut);
                if let Some(sky) = sky {
                    match sky.get_mut("radiance").and_then(Value::as_array_mut) {
                        Some(radiance) => radiance.iter_mut().for_each(|v| {
                            let own = v.as_float().or_else(|| v.as_integer().map(|i| i as f64)).unwrap_or(0.0);
                            *v = Value::Float(own * q.at[0]);
                        }),
                        None => drop(sky.insert("scale".into(), Value::Float(q.at[0]))),
                    }
                }
            }
            UnknownKind::Slab(leaf, number) => {
                let (key, found) = match number {
                    SlabNumber::SigmaA => ("sigma_a", numbers),
                    SlabNumber::SigmaS => ("sigma_s", numbers),
                    SlabNumber::Thickness => ("thickness_mm", Value::Float(q.at[0])),
                };
                set(uniform(&mut table, &index(*leaf)), key, found);
            }
            UnknownKind::Absorption(leaf) => set(inside(&mut table, &index(*leaf), "foliar"), "absorption", numbers),
            UnknownKind::Content(leaf, substance) => {
                let name = SUBSTANCES[*substance];
                let unit = if name == "water" { "g_cm2" } else { "ug_cm2" };
                let layers = inside(&mut table, &index(*leaf), "foliar");
                set(layers, &format!("{name}_{unit}"), Value::Float(q.at[0]));
            }
            // Maps are those of the fit that is written beside the scene.
            UnknownKind::Factor(..) | UnknownKind::Exposure(_) => {}
            // Discs that were counted are a list beside the scene.
            UnknownKind::Area(_) => {}
        }
    }
    table.iter_mut().for_each(|(key, value)| {
        files(manifest, key, value, &mut |text, path| {
            *text = std::path::absolute(path).unwrap_or(path.to_path_buf()).display().to_string();
        })
    });
    for (name, ..) in present.mapped() {
        if let Some(leaf) = leaf_table(&mut table, &name) {
            ["look", "capture", "scan"].iter().for_each(|key| drop(leaf.remove(*key)));
            leaf.insert("fit".into(), Value::String(leaf_folder(&name)));
        }
    }
    for (_, name) in present.banded() {
        let (of, colours) = match &name {
            Some(name) => (uniform(&mut table, name), &["rho_d", "rho_t"][..]),
            None => (table.get_mut("ground").and_then(Value::as_table_mut), &["albedo"][..]),
        };
        if let Some(of) = of {
            // Colours that were stated are those of the old spectrum.
            colours.iter().for_each(|key| drop(of.remove(*key)));
            of.insert("spectrum".into(), Value::String(bands::file(name.as_deref())));
        }
    }
    for (name, _) in present.found_discs() {
        if let Some(leaf) = leaf_table(&mut table, &name) {
            leaf.insert("discs".into(), Value::String(disc_file(&name)));
        }
    }
    let text = toml::to_string(&table).map_err(|e| Error::write(out, e))?;
    Ok(format!("# {} with what `mesophyll fit scene` found in its pictures.\n{text}", manifest.name))
}

fn set(table: Option<&mut Table>, key: &str, value: Value) {
    if let Some(table) = table {
        table.insert(key.into(), value);
    }
}

/// The leaf with this name.
fn leaf_table<'a>(table: &'a mut Table, name: &str) -> Option<&'a mut Table> {
    let leaves = table.get_mut("leaf")?.as_array_mut()?;
    let own = |leaf: &&mut Table| leaf.get("name").and_then(Value::as_str) == Some(name);
    leaves.iter_mut().filter_map(Value::as_table_mut).find(own)
}

/// A table of the leaf with this name.
fn inside<'a>(table: &'a mut Table, name: &str, key: &str) -> Option<&'a mut Table> {
    leaf_table(table, name)?.get_mut(key)?.as_table_mut()
}

/// The `uniform` of the leaf with this name.
fn uniform<'a>(table: &'a mut Table, name: &str) -> Option<&'a mut Table> {
    inside(table, name, "uniform")
}

/// The folder, beside the scene, of the fit with what was found of a leaf.
pub fn leaf_folder(name: &str) -> String {
    format!("leaf-{name}")
}

/// The list of the discs that were found of a leaf, beside the scene.
pub fn disc_file(name: &str) -> String {
    format!("discs-{name}.txt")
}

/// Fields whose text is a file or a folder even where it could be a name.
const FILES: [&str; 9] = ["mesh", "positions", "discs", "environment", "grow", "file", "mask", "fit", "capture"];

/// Every file and folder that a scene names.
///
/// # Errors
/// A scene file that can no longer be read.
pub fn named(manifest: &SceneManifest) -> Result<Vec<PathBuf>> {
    let text = whole_file::text(&manifest.path)?;
    let mut table: Table = toml::from_str(&text).map_err(|e| Error::toml(&manifest.path, &text, &e))?;
    let mut out = Vec::new();
    table.iter_mut().for_each(|(key, value)| files(manifest, key, value, &mut |_, path| out.push(path.to_path_buf())));
    Ok(out)
}

/// Calls `f` with every text that names an existing file or folder beside the scene, and with that.
fn files(manifest: &SceneManifest, key: &str, value: &mut Value, f: &mut impl FnMut(&mut String, &Path)) {
    match value {
        // Names have neither dots nor slashes.
        Value::String(text) if FILES.contains(&key) || text.contains(['.', '/']) => {
            let path = manifest.resolve(Path::new(text.as_str()));
            if path.exists() {
                f(text, &path);
            }
        }
        Value::Array(list) => list.iter_mut().for_each(|v| files(manifest, key, v, f)),
        Value::Table(table) => table.iter_mut().for_each(|(key, v)| files(manifest, key, v, f)),
        _ => {}
    }
}
