//! Files that are no tables: pictures, plants, descriptions, archives. They are told by their first bytes.

use super::{Found, quoted};
use crate::cli::{Error, Result};
use mesophyll_base::error::TomlKind;
use mesophyll_files::first_bytes::{FOREIGN, PICTURES};
use std::path::Path;

/// What the file is; `None` where it may be a table.
///
/// # Errors
/// Bytes that are no text and of no known form.
pub fn told(head: &[u8], path: &Path) -> Result<Option<Found>> {
    let found = |form: &str| Found { form: form.into(), ..Found::default() };
    let taken = |form: &str, command: String| Ok(Some(Found { command: Some(command), ..found(form) }));
    let barred = |form: &str, reason: String| Ok(Some(Found { reason: Some(reason), ..found(form) }));
    let file = quoted(path);
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    if let Some((_, form)) = PICTURES.iter().find(|(magic, _)| head.starts_with(magic)) {
        return Ok(Some(picture(found(form), path)));
    }
    if head.starts_with(b"glTF") {
        return taken("a binary glTF file (.glb)", format!("mesophyll import {file} -o FOLDER"));
    }
    if head.starts_with(b"tensor_file") {
        return taken("an RGL material (.bsdf)", format!("mesophyll fit gloss --samples --in {file}"));
    }
    if ending == "binary" && head.starts_with(&[90, 0, 0, 0, 90, 0, 0, 0, 180, 0, 0, 0]) {
        return taken("a MERL material (.binary)", format!("mesophyll fit gloss --samples --in {file}"));
    }
    if let Some((_, form, reason)) = FOREIGN.iter().find(|(magic, ..)| head.starts_with(magic)) {
        return barred(form, (*reason).into());
    }
    let wide = head.starts_with(b"\xff\xfe") || head.starts_with(b"\xfe\xff");
    let zeros = head.iter().filter(|b| **b == 0).count();
    // Text in UTF-16 has a zero in every second byte at most, and nothing but text between.
    let control = head.iter().any(|b| *b < 9 && *b > 0 || (14..26).contains(b));
    if control || (zeros > 0 && !wide && 3 * zeros < head.len()) {
        return Err(Error::input(
            path,
            "unknown: it is no text, and it begins like no picture, plant or file of an instrument that is known here",
        ));
    }
    if ending == "toml" || ending == "json" || ending == "gltf" {
        let text =
            std::fs::read_to_string(path).map_err(|e| Error::input(path, mesophyll_files::atomic::explain(&e)))?;
        return Ok(Some(description(&ending, &text, path)?));
    }
    let text = String::from_utf8_lossy(head);
    let begin = text.trim_start().to_ascii_lowercase();
    if begin.starts_with("<!doctype")
        || begin.starts_with("<html")
        || begin.starts_with("<?xml")
        || begin.starts_with("<svg")
    {
        return barred("a text with tags (HTML, XML or SVG)", "save its table as CSV".into());
    }
    if begin.starts_with("[header]") || begin.starts_with("\"open ") {
        return barred(
            "a gas exchange record of LI-COR (LI-6400, LI-6800)",
            "it holds no reflectance and no transmittance".into(),
        );
    }
    Ok(None)
}

/// A picture is part of a capture, or a panorama.
fn picture(mut found: Found, path: &Path) -> Found {
    let mut folders = path.ancestors().skip(1).take(4).map(|f| if f == Path::new("") { Path::new(".") } else { f });
    let capture = folders.find(|folder| folder.join("capture.toml").is_file());
    found.holds.push("a picture".into());
    match capture {
        Some(folder) => {
            found.command = Some(format!("mesophyll inspect {}", quoted(folder)));
            found.notes.push("it is part of the capture in that folder".into());
        }
        None if found.form.contains("OpenEXR") || found.form.contains("Radiance") => {
            found.command = Some(format!("mesophyll fit sky --panorama {} -o FOLDER", quoted(path)));
            found.notes.push("if it is a linear picture of the sky".into());
        }
        None => {
            found.reason = Some(
                "pictures are fitted as a capture, a folder with capture.toml, which `mesophyll inspect FOLDER` looks \
                 over; a panorama of the sky must be a linear EXR or Radiance picture; a picture of a leaf can be \
                 stated as its look, for `mesophyll import LOOK.toml`"
                    .into(),
            );
        }
    }
    found
}

/// A TOML or JSON text, by its fields.
fn description(ending: &str, text: &str, path: &Path) -> Result<Found> {
    let file = quoted(path);
    let parent = path.parent().filter(|p| *p != Path::new("")).unwrap_or(Path::new("."));
    let of = |form: &str, command: String| Found { form: form.into(), command: Some(command), ..Found::default() };
    if ending != "toml" {
        let json: serde_json::Value =
            serde_json::from_str(text).map_err(|e| Error::input(path, format!("it is no JSON: {e}")))?;
        if json.get("asset").is_some() {
            return Ok(of("a glTF file", format!("mesophyll import {file} -o FOLDER")));
        }
        let reason = "no command reads a JSON text of its own".to_string();
        return Ok(Found { form: "a JSON text".into(), reason: Some(reason), ..Found::default() });
    }
    let table: toml::Table = toml::from_str(text).map_err(|e| Error::toml(path, text, &e))?;
    let named = path.file_name().is_some_and(|name| name == "capture.toml");
    let kind = TomlKind::of(&table).or(named.then_some(TomlKind::Capture));
    Ok(match kind {
        Some(kind) => {
            let command = match kind {
                TomlKind::FitRecord => format!("mesophyll report {}", quoted(parent)),
                TomlKind::LightSource => format!("mesophyll fit gloss --geometry {file} --in TRACES.csv"),
                TomlKind::Growth => format!("mesophyll grow {file} -o PLANT.glb"),
                TomlKind::Look => format!("mesophyll import {file} -o FOLDER"),
                TomlKind::SyntheticLeaf => format!("mesophyll synth {file} -o CAPTURE"),
                TomlKind::Scene => format!("mesophyll render {file} -o FOLDER"),
                TomlKind::Capture => format!("mesophyll inspect {}", quoted(parent)),
            };
            of(&kind.to_string(), command)
        }
        None => Found {
            form: "a TOML text".into(),
            reason: Some("its fields are those of no scene, plant, meadow, leaf, device, capture or fit".into()),
            ..Found::default()
        },
    })
}
