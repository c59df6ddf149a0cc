//! The layout of the source: lines are at most 120 characters wide and files at most 400 lines long, so that both can
//! be read without scrolling to and fro.

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
