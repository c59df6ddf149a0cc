//! The kinds of capture, and the one way to open a `capture.toml`.

use crate::{Error, Result};
use mesophyll_base::error::TomlKind;
use mesophyll_files::whole_file;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};
use strum::IntoEnumIterator;

/// How a leaf was measured.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    strum::Display,
    strum::EnumIter,
    strum::EnumMessage,
    strum::EnumString,
    strum::IntoStaticStr,
)]
#[strum(serialize_all = "lowercase")]
pub enum CaptureKind {
    /// A lit tube that travels over the leaf, and a light box
    Tube,
    /// Photographs under a dome and in front of a back light, and height scans
    Dome,
    /// Photographs of one side while narrow beams fall on the other
    Beams,
    /// Photographs of both sides in open shade, with a grey card and a ruler, and on a light table
    Photo,
}

impl CaptureKind {
    /// What the field `kind` says. A scan under a tube has no such field.
    pub fn field(self) -> Option<&'static str> {
        (self != CaptureKind::Tube).then(|| self.into())
    }

    fn in_words(self) -> &'static str {
        match self {
            CaptureKind::Tube => "a scan under a linear light source",
            CaptureKind::Dome => "photographs under a dome and height scans",
            CaptureKind::Beams => "photographs of the light that comes through",
            CaptureKind::Photo => "photographs in open shade and on a light table",
        }
    }

    /// The verb that fits this kind.
    fn way_on(self) -> &'static str {
        match self {
            CaptureKind::Tube | CaptureKind::Dome | CaptureKind::Photo => "mesophyll fit leaf",
            CaptureKind::Beams => "mesophyll fit tissue",
        }
    }

    /// The kind of the capture in `folder`; `None` where its `capture.toml` names no known kind. A text that is not
    /// TOML counts as a scan under a tube, whose reader then says what is wrong with it.
    ///
    /// # Errors
    /// [`Error::Input`] when there is no readable `capture.toml`.
    pub fn of(folder: &Path) -> Result<Option<CaptureKind>> {
        let (_, text) = text(folder)?;
        Ok(text.parse::<toml::Table>().map_or(Some(CaptureKind::Tube), |table| CaptureKind::in_table(&table)))
    }

    fn in_table(table: &toml::Table) -> Option<CaptureKind> {
        let said = table.get("kind").map(|v| v.as_str().unwrap_or_default());
        CaptureKind::iter().find(|kind| kind.field() == said)
    }
}

/// Reads the manifest of a capture of the kind `expected`. Returns its path and its contents.
///
/// # Errors
/// [`Error::Input`] that names the folder or the field: no capture, a fit, another kind of capture, a field that is
/// missing, unknown or of another type.
pub fn read<T: DeserializeOwned>(folder: &Path, expected: CaptureKind) -> Result<(PathBuf, T)> {
    let (path, text) = text(folder)?;
    if let Ok(table) = text.parse::<toml::Table>()
        && CaptureKind::in_table(&table) != Some(expected)
    {
        return Err(Error::field(&path, "kind", other_kind(&table, expected)));
    }
    let manifest = toml::from_str(&text).map_err(|e| Error::toml_of(TomlKind::Capture, &path, &text, &e))?;
    Ok((path, manifest))
}

/// The path and the text of the manifest in `folder`.
fn text(folder: &Path) -> Result<(PathBuf, String)> {
    let path = folder.join("capture.toml");
    if folder.is_file() {
        return Err(Error::input(folder, "found a file, expected the folder of a capture"));
    }
    if !path.exists() && folder.join("fit.toml").is_file() {
        return Err(Error::input(folder, "found a fit (fit.toml), expected a capture (capture.toml)"));
    }
    let text = whole_file::text(&path)?;
    Ok((path, text))
}

/// What was found and what was expected where they differ, and which verb takes what was found.
fn other_kind(table: &toml::Table, expected: CaptureKind) -> String {
    let kind = CaptureKind::in_table(table);
    let found = match (table.get("kind"), kind) {
        (Some(value), Some(kind)) => format!("found {value} ({})", kind.in_words()),
        (Some(value), None) => format!("found {value}"),
        (None, _) if table.contains_key("tube") => format!("found none: {}", CaptureKind::Tube.in_words()),
        (None, _) => "missing".into(),
    };
    let wanted = match (expected, kind) {
        (CaptureKind::Tube, None) => {
            format!("\"dome\", \"photo\", \"beams\", or no kind for {}", expected.in_words())
        }
        (CaptureKind::Tube, Some(_)) => format!("{}, which has no kind", expected.in_words()),
        (other, _) => format!("\"{}\" ({})", other.field().unwrap_or_default(), other.in_words()),
    };
    let known = kind.filter(|kind| kind.field().is_some() || table.contains_key("tube"));
    let way_on = known.map(|kind| format!("; the way on of what was found is `{}`", kind.way_on())).unwrap_or_default();
    format!("{found}, expected {wanted}{way_on}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads every kind as every other one. The message must say what was found, what was expected, and which verb
    /// takes it.
    #[test]
    fn another_kind_is_named_with_its_way_on() {
        let dir = tempfile::tempdir().unwrap();
        let texts = [
            (CaptureKind::Tube, "[tube]\nheight_mm = 1\n"),
            (CaptureKind::Dome, "kind = \"dome\"\n"),
            (CaptureKind::Beams, "kind = \"beams\"\n"),
            (CaptureKind::Photo, "kind = \"photo\"\n"),
        ];
        for (found, text) in texts {
            std::fs::write(dir.path().join("capture.toml"), text).unwrap();
            assert_eq!(CaptureKind::of(dir.path()).unwrap(), Some(found));
            for expected in CaptureKind::iter() {
                let outcome = read::<toml::Table>(dir.path(), expected);
                if found == expected {
                    outcome.unwrap();
                    continue;
                }
                let said = outcome.unwrap_err().to_string();
                let words = ["capture.toml: kind: found", found.in_words(), expected.in_words(), found.way_on()];
                assert!(words.iter().all(|w| said.contains(w)), "{said}");
            }
        }
        std::fs::write(dir.path().join("capture.toml"), "kind = \"dom\"\n").unwrap();
        let said = read::<toml::Table>(dir.path(), CaptureKind::Dome).unwrap_err().to_string();
        assert!(said.contains("found \"dom\", expected \"dome\""), "{said}");
    }

    #[test]
    fn a_fit_is_not_a_capture_of_any_kind() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("fit.toml"), "").unwrap();
        for kind in CaptureKind::iter() {
            let said = read::<toml::Table>(dir.path(), kind).unwrap_err().to_string();
            assert!(said.contains("found a fit (fit.toml), expected a capture"), "{said}");
            assert!(
                read::<toml::Table>(&dir.path().join("fit.toml"), kind)
                    .unwrap_err()
                    .to_string()
                    .contains("found a file")
            );
        }
    }
}
