//! The order of the scene's folders: each uses only those before it. Inside one crate the compiler does not enforce
//! this, so this test reads the imports.

use std::collections::BTreeSet;
use std::path::Path;

/// From the bottom up. Folders on one floor do not use each other.
const FLOORS: [&[&str]; 4] = [&["plan"], &["loaded"], &["draw"], &["traced", "window"]];

fn floor(name: &str) -> Option<usize> {
    FLOORS.iter().position(|f| f.contains(&name))
}

/// What a file uses of its crate, by the first names. `depth` is the number of folders that it lies in.
fn used(text: &str, depth: usize) -> BTreeSet<String> {
    let code: String = text.lines().filter(|l| !l.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n");
    // In a file of a folder, `super` is that folder and `super::super` is the crate.
    let root = format!("{}::", vec!["super"; depth + 1].join("::"));
    let code = code.replace(&root, "crate::");
    let mut out = BTreeSet::new();
    for (at, found) in code.match_indices("crate::") {
        let rest = &code[at + found.len()..];
        let group = rest.strip_prefix('{').and_then(|g| g.split_once("};")).map_or(rest, |(inside, _)| inside);
        let mut inner = 0;
        let parts = group.split(|c| {
            inner += i32::from(c == '{') - i32::from(c == '}');
            c == ',' && inner == 0
        });
        let count = if rest.starts_with('{') { usize::MAX } else { 1 };
        let names = parts.take(count).map(|p| p.trim().split(|c: char| !c.is_alphanumeric() && c != '_').next());
        out.extend(names.flatten().map(String::from));
    }
    out
}

/// A sentence for every forbidden import in a file of `folder`.
fn wrong(folder: &str, file: &str, text: &str, depth: usize) -> Vec<String> {
    let own = floor(folder);
    used(text, depth)
        .into_iter()
        .filter(|name| name != folder && floor(name) >= own)
        .map(|name| format!("{file} uses {name}/, which does not stand below {folder}/"))
        .collect()
}

fn look(folder: &str, path: &Path, depth: usize, out: &mut Vec<String>) -> usize {
    let mut files = 0;
    for entry in std::fs::read_dir(path).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files += look(folder, &path, depth + 1, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            // A folder's own file is one step nearer to the crate than the other files in it.
            let own = usize::from(path.ends_with("mod.rs"));
            out.extend(wrong(
                folder,
                &path.display().to_string(),
                &std::fs::read_to_string(&path).unwrap(),
                depth - own,
            ));
            files += 1;
        }
    }
    files
}

#[test]
fn no_folder_uses_one_above_it() {
    let root = &Path::new(env!("CARGO_MANIFEST_DIR")).join("src/world/scene");
    let (mut found, mut files) = (Vec::new(), 0);
    for entry in std::fs::read_dir(root).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        if path.is_dir() && std::fs::exists(path.join("mod.rs")).unwrap() {
            assert!(floor(&name).is_some(), "{name}/ has no floor");
            files += look(&name, &path, 1, &mut found);
        }
    }
    assert!(files > 25, "only {files} files were read");
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// In the room below, the things that stand in the world are built upon the fits, and not the other way round.
#[test]
fn fits_use_nothing_of_what_is_placed() {
    let folder = &Path::new(env!("CARGO_MANIFEST_DIR")).join("src/world/scene/placed/fits");
    let mut files = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        let mut used = used(&text, usize::from(!path.ends_with("mod.rs")));
        used.retain(|name| !["fits", "ledger", "Error", "Result"].contains(&name.as_str()));
        assert!(used.is_empty(), "{} uses {used:?}", path.display());
        files += 1;
    }
    assert!(files > 3, "only {files} files were read");
}

#[test]
fn an_import_from_above_is_found_however_it_is_written() {
    for text in [
        "use crate::draw::card;",
        "    let world = crate::draw::reference::world();",
        "use crate::{Error, film::Length, draw::{card, sunlit}};",
        "use super::super::draw::card;",
    ] {
        assert_eq!(wrong("plan", "a.rs", text, 1).len(), 1, "{text}");
        assert!(wrong("traced", "a.rs", text, 1).is_empty(), "{text}");
    }
    assert_eq!(wrong("window", "a.rs", "use crate::traced::render;", 1).len(), 1);
    for text in
        ["/// As [`crate::draw`].", "use super::draw::card;", "use crate::Result;", "use crate::{Error, Result};"]
    {
        assert!(wrong("plan", "a.rs", text, 1).is_empty(), "{text}");
    }
}
