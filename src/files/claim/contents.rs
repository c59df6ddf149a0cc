//! What a folder holds of the things that verbs make; it is recognised by its files.

use super::{MARK, OutputKind, ending};
use serde_json::Value;
use std::fs;
use std::io::Read;
use std::path::Path;

/// So much of a file is looked at to tell what it is (bytes); a header of a table may be long.
const LONGEST_HEAD: u64 = 1 << 20;

/// What a folder with a `fit.toml` of this kind is called. In a look nothing was fitted.
pub fn fit_words(kind: &str) -> String {
    if kind == "look" { "stated look".into() } else { format!("{kind} fit") }
}

/// What a folder holds, in words for a message, and whether it is of the kind that claims it.
pub(super) struct Held {
    pub words: String,
    pub same: bool,
}

/// Everything that `folder` holds of what verbs make.
pub(super) fn holds(folder: &Path, claimed: OutputKind) -> Vec<Held> {
    let mut out = Vec::new();
    let mut found = |kind: OutputKind, words: String| out.push(Held { same: kind == claimed, words });
    if is_capture(folder) {
        found(OutputKind::Capture, "a capture (capture.toml)".into());
    }
    if let Some(fit) = fit_there(folder) {
        found(OutputKind::Fit(fit.kind.as_deref().unwrap_or("unknown")), fit.words);
    }
    for name in fs::read_dir(folder).into_iter().flatten().flatten().filter(|e| e.path().is_dir()) {
        if let Some(rest) = name.file_name().to_string_lossy().strip_prefix("parts-") {
            // `parts-KIND-HASH`; leaf fits of earlier versions left their kind out.
            let kind = rest.split_once('-').map_or("leaf", |(kind, _)| kind);
            found(OutputKind::Fit(kind), format!("a {kind} fit that was stopped (its parts)"));
        }
    }
    if let Some(words) = marked(folder) {
        out.push(Held { same: words == claimed.words(), words: format!("a {words} ({MARK})") });
    }
    for kind in [
        OutputKind::Scene,
        OutputKind::Render,
        OutputKind::Film,
        OutputKind::Bench,
        OutputKind::Maps,
        OutputKind::Pivots,
        OutputKind::Export,
        OutputKind::Import,
    ] {
        if let Some(mark) = marks(folder, kind).first() {
            out.push(Held { same: kind == claimed, words: format!("a {} ({mark})", kind.words()) });
        }
    }
    out
}

/// The kind that the marker states, in words.
pub(super) fn marked(folder: &Path) -> Option<String> {
    there(&folder.join(MARK)).and_then(|path| fs::read_to_string(path).ok()).map(|text| text.trim().to_string())
}

/// A path where there is a file. To read a pipe would wait for its other end.
fn there(path: &Path) -> Option<&Path> {
    path.is_file().then_some(path)
}

/// The files by which a folder of this kind is recognised, as far as they exist and have the right content.
pub(super) fn marks(folder: &Path, kind: OutputKind) -> Vec<&'static str> {
    let known: &[(&str, &str)] = match kind {
        OutputKind::Scene => &[("plan.json", "needed"), ("check.json", "views"), ("ledger.json", "stages")],
        OutputKind::Render => &[("render.json", "pictures")],
        OutputKind::Film => &[("film.json", "film")],
        OutputKind::Bench => &[("bench.json", "rows")],
        OutputKind::Maps => &[("ranges.json", "files")],
        OutputKind::Pivots => &[("pivots.json", "elements")],
        // A folder of pivots has a loss, too.
        OutputKind::Export if !marks(folder, OutputKind::Pivots).is_empty() => &[],
        OutputKind::Export => &[("loss.json", "target")],
        OutputKind::Import => &[("import.json", "pieces")],
        OutputKind::Fit(_) | OutputKind::Capture | OutputKind::Pictures => &[],
    };
    let says = |name: &str, key: &str| {
        let bytes = there(&folder.join(name)).and_then(|path| fs::read(path).ok()).unwrap_or_default();
        serde_json::from_slice::<Value>(&bytes).is_ok_and(|v| v.get(key).is_some())
    };
    known.iter().filter(|(name, key)| says(name, key)).map(|(name, _)| *name).collect()
}

pub(super) fn is_capture(folder: &Path) -> bool {
    folder.join("capture.toml").is_file()
}

/// What a folder's `fit.toml` states. A file of that name that cannot be read still belongs to somebody.
pub(super) struct FitThere {
    pub kind: Option<String>,
    pub files: Vec<String>,
    pub words: String,
}

pub(super) fn fit_there(folder: &Path) -> Option<FitThere> {
    let path = folder.join("fit.toml");
    if !path.is_file() {
        return None;
    }
    let table = fs::read_to_string(&path).ok().and_then(|text| text.parse::<toml::Table>().ok()).unwrap_or_default();
    let text = |key: &str| table.get(key).and_then(toml::Value::as_str).map(str::to_string);
    let files =
        table.get("files").and_then(toml::Value::as_table).map(|t| t.keys().cloned().collect()).unwrap_or_default();
    let words = match (text("kind"), text("name")) {
        (Some(kind), name) => format!("the {} \"{}\"", fit_words(&kind), name.unwrap_or_default()),
        _ => "a fit.toml that says no kind".into(),
    };
    Some(FitThere { kind: text("kind"), files, words })
}

/// The first file with one of these endings, by name. Hidden files and folders do not count.
pub(super) fn stranger(folder: &Path, endings: &[&str]) -> Option<String> {
    let list = fs::read_dir(folder).ok()?;
    let files = list.flatten().filter(|e| e.path().is_file()).map(|e| e.file_name().to_string_lossy().into_owned());
    files.filter(|n| !n.starts_with('.') && ending(Path::new(n)).is_some_and(|e| endings.contains(&e.as_str()))).min()
}

/// Whether the file `path` begins as one with one of these endings does.
pub(super) fn is_own(path: &Path, endings: &[&str]) -> bool {
    let mut head = Vec::new();
    let read = fs::File::open(path).and_then(|file| file.take(LONGEST_HEAD).read_to_end(&mut head));
    let first = head.split(|b| *b == b'\n').next().unwrap_or_default().trim_ascii_end();
    read.is_ok()
        && endings.iter().any(|ending| match *ending {
            // Every answer of a batch ends in its status.
            "csv" => first.ends_with(b",status"),
            "json" => head.starts_with(b"{"),
            "html" => first.to_ascii_lowercase().starts_with(b"<!doctype html"),
            "glb" => head.starts_with(b"glTF"),
            "exr" => head.starts_with(&[0x76, 0x2f, 0x31, 0x01]),
            "png" => head.starts_with(b"\x89PNG"),
            _ => false,
        })
}
