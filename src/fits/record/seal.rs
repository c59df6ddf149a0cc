//! The record hash: the content hash of `fit.toml` itself, stored in its second line. The record lists the content hash
//! of every map, so this one number stands for the whole folder, and a parameter changed by hand is noticed like a
//! changed map.

use mesophyll_base::error::{Error, Result};
use mesophyll_files::{atomic, hash};
use std::path::Path;

const KEY: &str = "record_hash = ";

/// Hash of the text without its record hash. Line endings do not count, because version control may change them.
fn of(text: &str) -> String {
    let lines: Vec<&str> = text.lines().filter(|line| !line.starts_with(KEY)).collect();
    hash::bytes(lines.join("\n").as_bytes())
}

/// The text of a record with its hash in the second line. The first line is `schema = …`, so the hash stands before
/// every table.
pub fn sealed(text: &str) -> String {
    let (first, rest) = text.split_once('\n').unwrap_or((text, ""));
    format!("{first}\n{KEY}\"{}\"\n{rest}", of(text))
}

/// Checks that `fit.toml` in `folder` is what a fit, or the window's edit, wrote.
///
/// # Errors
/// [`Error::Missed`] where it was changed since, or holds no record hash; [`Error::Input`] where it cannot be read.
pub fn verify(folder: &Path) -> Result<()> {
    let path = folder.join("fit.toml");
    let text = std::fs::read_to_string(&path).map_err(|e| Error::input(&path, atomic::explain(&e)))?;
    let found = text.lines().find_map(|line| line.strip_prefix(KEY)).map(|value| value.trim().trim_matches('"'));
    let what = match found {
        Some(hash) if hash == of(&text) => return Ok(()),
        Some(_) => "changed since it was written (its record_hash is not that of its content)",
        None => "holds no record_hash, so that nobody can tell whether its numbers are the fitted ones",
    };
    let accept = "fit it anew, or change the leaf in `mesophyll view`, which saves an edit as a fit of its own";
    Err(Error::Missed(format!("{}: {what}; {accept}", path.display())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{FitKind, FitParameter, FitRecord, RecordSection, SCHEMA};

    fn record() -> FitRecord {
        let load = FitParameter {
            value: vec![59.567070350437795],
            stderr: vec![0.64],
            unit: "mm".into(),
            ..FitParameter::default()
        };
        let unknown = FitParameter { value: vec![f64::NAN], stderr: vec![f64::INFINITY], ..FitParameter::default() };
        let params = [("load".to_string(), load), ("radius".to_string(), unknown)].into();
        let sections = [("branch twig".to_string(), RecordSection { params, ..RecordSection::default() })].into();
        FitRecord { schema: SCHEMA, kind: FitKind::Beam, name: "branches".into(), sections, ..FitRecord::default() }
    }

    /// A fit without maps has only this hash.
    #[test]
    fn a_number_changed_by_hand_is_noticed_and_a_saved_edit_is_not() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("fit.toml");
        record().write(dir.path()).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        record().verify(dir.path()).unwrap();
        // The hash is that of the lines by BLAKE3, so any program can compute it.
        let without: String = text.lines().filter(|l| !l.starts_with(KEY)).collect::<Vec<_>>().join("\n");
        assert!(text.contains(&format!("record_hash = \"{}\"", blake3::hash(without.as_bytes()).to_hex())), "{text}");
        let said = |text: &str| {
            std::fs::write(&path, text).unwrap();
            record().verify(dir.path()).err().map(|e| e.to_string())
        };
        assert_eq!(said(&text.replace('\n', "\r\n")), None, "line ends count");
        let forged = said(&text.replace("59.567070350437795", "150.0")).unwrap();
        assert!(
            forged.contains("fit.toml: changed since it was written") && forged.contains("mesophyll view"),
            "{forged}"
        );
        let none = said(&without).unwrap();
        assert!(none.contains("holds no record_hash"), "{none}");
        // An edit made by the program is accepted, because it is written with a new hash.
        let mut edited = FitRecord::read(dir.path()).unwrap();
        edited.sections.get_mut("branch twig").unwrap().params.get_mut("load").unwrap().value[0] = 150.0;
        edited.write(dir.path()).unwrap();
        edited.verify(dir.path()).unwrap();
        assert_eq!(FitRecord::read(dir.path()).unwrap().sections["branch twig"].params["load"].value, [150.0]);
    }
}
