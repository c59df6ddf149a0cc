//! Output folders and output files are claimed here before anything is computed. A claim is refused where the verb
//! would overwrite its own input, the result of another kind of verb, or files that this program did not make.
//!
//! What a folder holds is recognised by the file that its maker writes last ([`OutputKind`]). Until that file is
//! written, the hidden file [`MARK`] names the kind. The parts of a stopped fit are in a folder whose name states the
//! kind.
//!
//! A claim also locks the folder against other runs, until its [`FolderClaim`] is dropped ([`lock`]).

mod contents;
mod lock;
mod places;
#[cfg(test)]
mod tests;

use crate::atomic::{self, explain};
use crate::{Error, Result};
pub use contents::fit_words;
use contents::{fit_there, holds, is_capture, is_own, marked, marks, stranger};
pub use lock::{ClaimMode, FolderClaim, undo};
pub use places::resolved;
use places::same_file;
use std::fs;
use std::path::Path;

/// What a verb makes in a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutputKind<'a> {
    /// A fit of the kind that `fit.toml` names.
    Fit(&'a str),
    /// A capture: `capture.toml`.
    Capture,
    /// What `run`, `check` and `view` make of a scene: `plan.json`, `check.json` or `ledger.json`.
    Scene,
    /// Pictures of the path tracer: `render.json`.
    Render,
    /// The frames of a film: `film.json`.
    Film,
    /// What `bench` makes: `bench.json`.
    Bench,
    /// The maps of `export --to png`: `ranges.json`.
    Maps,
    /// A plant's pivot textures: `pivots.json`.
    Pivots,
    /// A scene or a leaf for another renderer: `loss.json`.
    Export,
    /// Tables of a plant's branches: `import.json`.
    Import,
    /// Documentation pictures, which may lie beside anything but captures, fits and the other kinds.
    Pictures,
}

impl OutputKind<'_> {
    fn words(self) -> String {
        match self {
            OutputKind::Fit(kind) => fit_words(kind),
            OutputKind::Capture => "capture".into(),
            OutputKind::Scene => "run or a check".into(),
            OutputKind::Render => "folder of rendered pictures".into(),
            OutputKind::Film => "film".into(),
            OutputKind::Bench => "bench".into(),
            OutputKind::Maps => "folder of exported maps".into(),
            OutputKind::Pivots => "folder of pivot textures".into(),
            OutputKind::Export => "folder for another renderer".into(),
            OutputKind::Import => "folder of a plant's tables".into(),
            OutputKind::Pictures => "folder of pictures".into(),
        }
    }

    /// Endings of the files that this kind writes. A folder with such files that this program did not make is refused.
    fn endings(self) -> &'static [&'static str] {
        match self {
            OutputKind::Fit(_) => &["toml", "exr", "png", "glb", "json"],
            OutputKind::Capture => &["exr"],
            OutputKind::Scene | OutputKind::Maps => &["json", "png"],
            OutputKind::Film | OutputKind::Render => &["json", "png", "exr"],
            OutputKind::Bench => &["json"],
            OutputKind::Pivots => &["json", "exr", "glb"],
            OutputKind::Export => &["json", "xml", "pbrt", "mtlx", "usda", "py", "glb"],
            OutputKind::Import => &["json", "csv"],
            OutputKind::Pictures => &[],
        }
    }
}

/// The hidden file that names the kind of a folder as long as nothing else does.
pub const MARK: &str = ".mesophyll";

/// Files and folders at the top of a capture, as `synth` writes them. `capture.toml` comes first, so that a
/// half-removed capture no longer counts as one.
const CAPTURE_NAMES: [&str; 12] = [
    "capture.toml",
    "mask.exr",
    "dark.exr",
    "lightbox_empty.exr",
    "white.exr",
    "backlight_empty.exr",
    "front",
    "back",
    "white",
    "mirror",
    "photographs",
    "truth",
];

/// Endings that tell what a file is, among them those of the files that verbs write. `-o` names a file with one of them
/// only where the verb writes that ending.
const ENDINGS: [&str; 59] = [
    "toml", "exr", "png", "svg", "html", "json", "csv", "glb", "gltf", "obj", "mtl", "wgsl", "h", "mp4", "xml", "pbrt",
    "mtlx", "usda", "ply", "hdr", "jpg", "jpeg", "tif", "tiff", "xlsx", "pdf", "md", "sh", "py", "rs", "c", "ipynb",
    "zip", "gz", "tar", "7z", "fbx", "blend", "abc", "stl", "dae", "3ds", "usd", "usdc", "usdz", "gif", "bmp", "webp",
    "psd", "avi", "mov", "webm", "doc", "docx", "ods", "npy", "npz", "mat", "h5",
];

/// Claims `folder` for what a verb makes of `inputs`: creates it if needed, checks that it can be written, and locks it
/// until the answer is dropped.
///
/// # Errors
/// [`Error::Usage`] (exit code 2) that names the folder and what it holds, or that another run writes it. Then nothing
/// was changed.
pub fn folder(folder: &Path, kind: OutputKind, inputs: &[&Path]) -> Result<FolderClaim> {
    folder_for(folder, kind, inputs, ClaimMode::Alone)
}

/// As [`folder`]; with [`ClaimMode::Shared`] for a run that shares the folder with other shards of one fit. Such a run
/// waits for one that has the folder alone, because that one puts together what the shards made.
///
/// # Errors
/// As [`folder`]; [`Error::Interrupted`] after a stop while it waits.
pub fn folder_for(folder: &Path, kind: OutputKind, inputs: &[&Path], with: ClaimMode) -> Result<FolderClaim> {
    let refuse = |what: &str| refused(folder, kind, what);
    let place = resolved(folder);
    for input in inputs {
        let made_from = resolved(input);
        if place == made_from {
            return refuse("is what is to be read");
        }
        if made_from.is_dir() && place.starts_with(&made_from) {
            return refuse(&format!("lies inside {}, which is to be read", input.display()));
        }
    }
    if let Some(capture) = place.ancestors().skip(1).find(|a| is_capture(a)) {
        return refuse(&format!("lies inside the capture {}", capture.display()));
    }
    // A folder called `film.gif` would look as if the verb could write such a file.
    if let Some(found) = ending(&place).filter(|e| ENDINGS.contains(&e.as_str()) && !place.exists()) {
        let what = format!("found the ending of a file, .{found}; this is a folder, expected a folder's name");
        return Err(Error::Usage(format!("the output {}: {what}", folder.display())));
    }
    // A folder that another run makes just now says so before anything else: what it holds changes.
    let claim = FolderClaim::take(&place, with)?;
    fits_in(folder, &place, kind)?;
    atomic::probe_folder(folder)?;
    if claim.is_locked() {
        return Ok(claim);
    }
    // The folder is new, and another run may have had it before it is locked here.
    let claim = FolderClaim::take(&place, with)?;
    fits_in(folder, &place, kind)?;
    Ok(claim)
}

fn refused<T>(folder: &Path, kind: OutputKind, what: &str) -> Result<T> {
    let (folder, kind) = (folder.display(), kind.words());
    Err(Error::Usage(format!(
        "the output folder {folder} {what}; a {kind} there would overwrite it, so name another folder"
    )))
}

/// Refuses `folder`, which is at `place`, where it holds anything but what `kind` claims.
fn fits_in(folder: &Path, place: &Path, kind: OutputKind) -> Result<()> {
    let held = holds(place, kind);
    if let Some(other) = held.iter().find(|h| !h.same) {
        return refused(folder, kind, &format!("holds {}", other.words));
    }
    match stranger(place, kind.endings()) {
        Some(name) if held.is_empty() => {
            refused(folder, kind, &format!("holds files that are no {} ({name})", kind.words()))
        }
        _ => Ok(()),
    }
}

/// Claims `folder` for a synthetic capture. With `replace`, a synthetic capture may be there, but not a measured one
/// (without `truth/`) and no files that do not belong to a capture. The rest of a stopped synthesis may always be
/// there. Nothing is removed yet: see [`capturing`].
///
/// # Errors
/// As [`folder`]; a folder that is not empty, without `replace`.
pub fn capture(folder: &Path, inputs: &[&Path], replace: bool) -> Result<FolderClaim> {
    let claim = self::folder(folder, OutputKind::Capture, inputs)?;
    let shown = folder.display();
    if marked(folder).is_some() || (replace && is_capture(folder) && folder.join("truth").is_dir()) {
        return Ok(claim);
    }
    if fs::read_dir(folder).map_err(|e| Error::write(folder, explain(&e)))?.next().is_none() {
        return Ok(claim);
    }
    if !replace {
        return Err(Error::Usage(format!("the output folder {shown} is not empty; choose another or add --force")));
    }
    if is_capture(folder) {
        let what = "holds a measured capture (there is no truth/ in it), which is never replaced; name another folder";
        return Err(Error::Usage(format!("the output folder {shown} {what}")));
    }
    match CAPTURE_NAMES.iter().find(|name| folder.join(name).exists()) {
        Some(name) => Err(Error::Usage(format!(
            "the output folder {shown} is no capture but holds {name}; a capture there would overwrite it, so name \
             another folder"
        ))),
        None => Ok(claim),
    }
}

/// Runs a synthesis into a folder that [`capture`] has claimed, after removing the capture that it replaces. A
/// synthesis that does not finish leaves nothing behind.
///
/// # Errors
/// Those of `body`.
pub fn capturing<T>(folder: &Path, body: impl FnOnce() -> Result<T>) -> Result<T> {
    if marked(folder).is_some() || is_capture(folder) {
        remove_capture(folder)?;
    }
    begin(folder, OutputKind::Capture)?;
    let made = body();
    // The reason why the synthesis failed matters more than a rest that cannot be removed. In that case the marker
    // stays and shows it.
    let _ = if made.is_ok() { finish(folder) } else { remove_capture(folder) };
    made
}

/// Claims `folder` for what `run`, `check` and `view` make of the scene file `scene`, and marks it.
///
/// # Errors
/// As [`folder`].
pub fn scene(folder: &Path, scene: &Path) -> Result<FolderClaim> {
    let claim = self::folder(folder, OutputKind::Scene, &[scene])?;
    begin(folder, OutputKind::Scene)?;
    Ok(claim)
}

/// Removes what a capture's synthesis writes, and nothing else.
///
/// # Errors
/// [`Error::Write`] for a file that cannot be removed.
pub fn remove_capture(folder: &Path) -> Result<()> {
    let failed = |path: &Path, e: std::io::Error| Error::write(path, explain(&e));
    for path in CAPTURE_NAMES.map(|name| folder.join(name)) {
        if path.is_dir() {
            remove_pictures(&path).map_err(|e| failed(&path, e))?;
        } else if path.is_file() {
            fs::remove_file(&path).map_err(|e| failed(&path, e))?;
        }
    }
    finish(folder)
}

/// Removes the EXR and PNG files under a folder, and the folders that are empty afterwards. Links are left alone.
fn remove_pictures(folder: &Path) -> std::io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let (path, kind) = (entry.path(), entry.file_type()?);
        if kind.is_dir() {
            remove_pictures(&path)?;
        } else if kind.is_file() && ending(&path).is_some_and(|e| e == "exr" || e == "png") {
            fs::remove_file(&path)?;
        }
    }
    if fs::read_dir(folder)?.next().is_none() { fs::remove_dir(folder) } else { Ok(()) }
}

/// Marks `folder` with its kind, and removes the `fit.toml` of an earlier fit: from now on the folder holds no complete
/// fit.
///
/// # Errors
/// [`Error::Write`] or [`Error::Usage`] where the folder cannot be written.
pub fn begin(folder: &Path, kind: OutputKind) -> Result<()> {
    atomic::write_bytes(&folder.join(MARK), format!("{}\n", kind.words()).as_bytes())?;
    if matches!(kind, OutputKind::Fit(_)) {
        remove(&folder.join("fit.toml"))?;
    }
    Ok(())
}

/// Removes the marker, because the file that shows the kind has been written.
///
/// # Errors
/// [`Error::Write`] where the marker cannot be removed.
pub fn finish(folder: &Path) -> Result<()> {
    remove(&folder.join(MARK))
}

/// Claims the file `path` for a verb that writes files with these `endings` and reads `inputs`. `-`, devices and pipes
/// are free. A name with an ending by which another kind of file is known is refused, whether the file is there or not.
/// A text, or a file without an ending, is replaced only where it is empty or begins as the verb's own files do.
///
/// # Errors
/// [`Error::Usage`] (exit code 2) that names the file and what it is.
pub fn file(path: &Path, endings: &[&str], inputs: &[&Path]) -> Result<()> {
    if path == Path::new("-") || fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir()) {
        return Ok(());
    }
    let refuse = |what: String| {
        Err(Error::Usage(format!(
            "the output file {} {what} and would be overwritten; name another file",
            path.display()
        )))
    };
    if inputs.iter().any(|input| same_file(path, input)) {
        return refuse("is what is to be read".into());
    }
    let place = resolved(path);
    if let Some(capture) = place.ancestors().skip(1).find(|a| is_capture(a)) {
        return refuse(format!("lies inside the capture {}", capture.display()));
    }
    let Some((home, name)) = place.parent().zip(place.file_name()) else { return Ok(()) };
    let name = name.to_string_lossy();
    if let Some(words) = part_of(home, &name) {
        return refuse(format!("belongs to {words}"));
    }
    let (found, expected) = (ending(&place).unwrap_or_default(), format!(".{}", endings.join(" or .")));
    if endings.contains(&found.as_str()) {
        return Ok(());
    }
    // An empty file is what `mktemp` leaves; nothing is lost with it.
    let known = ENDINGS.contains(&found.as_str());
    let may_be_notes = matches!(found.as_str(), "" | "txt") && !is_own(&place, endings);
    if fs::metadata(&place).is_ok_and(|m| m.is_file() && m.len() > 0) && (known || may_be_notes) {
        let found = if found.is_empty() { "a file without an ending".into() } else { format!("a .{found} file") };
        return refuse(format!("is {found}, where one ending in {expected} was expected,"));
    }
    if known {
        let what = format!("found an ending of other files, .{found}; expected {expected}");
        return Err(Error::Usage(format!("the output file {}: {what}", path.display())));
    }
    Ok(())
}

/// What the file `name` belongs to in the folder `home`: either because it always would (a fit's record), or because it
/// exists there.
fn part_of(home: &Path, name: &str) -> Option<String> {
    let there = home.join(name).is_file();
    if let Some(fit) = fit_there(home) {
        let listed = || fit.files.iter().any(|f| f == name);
        let preview = || {
            let of_leaf = ["front_", "back_", "all"].iter().any(|p| name.starts_with(p));
            name.ends_with(".png") && (of_leaf || ["slices.png", "level.png", "view.png"].contains(&name))
        };
        if matches!(name, "fit.toml" | "times.toml") || (there && (listed() || preview())) {
            return Some(fit.words);
        }
    }
    let told = [
        OutputKind::Scene,
        OutputKind::Render,
        OutputKind::Film,
        OutputKind::Bench,
        OutputKind::Maps,
        OutputKind::Pivots,
        OutputKind::Export,
        OutputKind::Import,
    ]
    .into_iter()
    .find(|kind| marks(home, *kind).contains(&name) || (*kind == OutputKind::Film && there && is_frame(home, name)));
    told.map(|kind| format!("a {}", kind.words()))
}

/// Whether `name` is one of the frames of the film in `home`.
fn is_frame(home: &Path, name: &str) -> bool {
    let ending = name.ends_with(".png") || name.ends_with(".motion.exr");
    !marks(home, OutputKind::Film).is_empty() && name.starts_with("frame-") && ending
}

fn ending(path: &Path) -> Option<String> {
    path.extension().map(|e| e.to_string_lossy().to_lowercase())
}

fn remove(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::write(path, explain(&e))),
        _ => Ok(()),
    }
}
