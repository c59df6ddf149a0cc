//! The layout of the source: lines are at most 120 characters wide and files at most 400 lines long, so that both can
//! be read without scrolling to and fro.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const WIDTH: usize = 120;
const LINES: usize = 400;

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for path in std::fs::read_dir(folder).unwrap().flatten().map(|f| f.path()) {
        let ends = |of: &[&str]| path.extension().is_some_and(|e| of.iter().any(|o| e == *o));
        if path.is_dir() {
            sources(&path, found);
        } else if ends(&["rs", "wgsl", "py"]) {
            found.push(path);
        }
    }
}

#[test]
fn lines_and_files_are_short() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    for folder in ["src", "tests", "viewer"] {
        sources(&root.join(folder), &mut found);
    }
    assert!(found.len() > 500, "only {} files were found", found.len());
    let mut faults = Vec::new();
    for path in &found {
        let (text, name) = (std::fs::read_to_string(path).unwrap(), path.strip_prefix(root).unwrap().display());
        let lines = text.lines().count();
        if lines > LINES {
            faults.push(format!("{name}: {lines} lines, expected at most {LINES}"));
        }
        for (k, line) in text.lines().enumerate().filter(|(_, line)| line.chars().count() > WIDTH) {
            faults.push(format!("{name}:{}: {} characters, expected at most {WIDTH}", k + 1, line.chars().count()));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// Names that many modules define, each for itself: a verb's arguments, a function's options, and a package's own
/// error.
const OWN: [&str; 4] = ["Args", "Error", "Options", "Result"];

/// A word means one thing: a public type's name is defined once in the whole workspace. `docs/words.md` explains the
/// words that matter most.
#[test]
fn a_public_type_has_a_name_of_its_own() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    ["src", "viewer"].iter().for_each(|folder| sources(&root.join(folder), &mut files));
    let mut places: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for path in files.iter().filter(|p| p.extension().is_some_and(|e| e == "rs")) {
        let file = path.strip_prefix(root).unwrap().display().to_string();
        for line in std::fs::read_to_string(path).unwrap().lines() {
            let Some(rest) = line.trim_start().strip_prefix("pub ") else { continue };
            let Some((kind, rest)) = rest.split_once(' ') else { continue };
            if ["struct", "enum", "trait", "type", "union"].contains(&kind) {
                let name: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                places.entry(name).or_default().push(file.clone());
            }
        }
    }
    assert!(places.len() > 800, "only {} names were found", places.len());
    let twice: Vec<String> = places
        .iter()
        .filter(|(name, files)| files.len() > 1 && !OWN.contains(&name.as_str()))
        .map(|(name, files)| format!("{name} is defined in {}", files.join(" and ")))
        .collect();
    assert!(twice.is_empty(), "{}", twice.join("\n"));
    // The page of words names types that there are, in the files where they are.
    let page = std::fs::read_to_string(root.join("docs/words.md")).unwrap();
    let mut rows = 0;
    for line in page.lines().filter(|l| l.contains("` in `")) {
        let told: Vec<&str> = line.split('`').collect();
        let [.., name, _, file, _] = told[..] else { panic!("{line}") };
        let there = places.get(name).is_some_and(|files| files.iter().any(|f| f == file));
        assert!(there, "docs/words.md names {name} in {file}; it is in {:?}", places.get(name));
        rows += 1;
    }
    assert!(rows > 60, "only {rows} words were found");
}
