//! Where a verb's output goes, as its `-o, --out` says: a folder, a file, or `-` for standard output.

use crate::cli::{Error, Result};
use clap::builder::{PathBufValueParser, TypedValueParser};
use mesophyll_files::atomic;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Parses the name of a folder to write. `-` is refused, because standard output cannot hold a folder.
pub fn folder() -> impl TypedValueParser<Value = PathBuf> {
    let named = |path: PathBuf| if is_stdout(&path) { Err("a folder is written, expected its name") } else { Ok(path) };
    PathBufValueParser::new().try_map(named)
}

/// Whether a file of this name is standard output.
pub fn is_stdout(path: &Path) -> bool {
    path == Path::new("-")
}

/// Where [`file`] keeps what goes to standard output.
static TEMPORARY: Mutex<Option<PathBuf>> = Mutex::new(None);

/// Removes what [`file`] keeps, for a program that ends in the middle of its work.
pub fn remove_temporary() {
    let place = TEMPORARY.lock().unwrap_or_else(PoisonError::into_inner).take();
    place.map(std::fs::remove_dir_all);
}

/// Lets `write` write a file. A file called `-` is printed on standard output when it is complete.
///
/// # Errors
/// Those of `write`; [`Error::Write`] where standard output or the temporary folder cannot be written.
pub fn file<T>(path: &Path, write: impl FnOnce(&Path) -> Result<T>) -> Result<T> {
    if !is_stdout(path) {
        return write(path);
    }
    let failed = |e: std::io::Error| Error::write(&std::env::temp_dir(), atomic::explain(&e));
    let folder = tempfile::tempdir().map_err(failed)?;
    *TEMPORARY.lock().unwrap_or_else(PoisonError::into_inner) = Some(folder.path().to_path_buf());
    let whole = folder.path().join("out");
    let done = write(&whole)?;
    super::print_bytes(&std::fs::read(&whole).map_err(failed)?)?;
    Ok(done)
}
