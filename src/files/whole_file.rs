//! Files that are read as a whole. What a name leads to may have no end (`/dev/zero`, a pipe that somebody fills), or
//! be larger than the memory that there is. Both are said before memory ends.

use crate::atomic::explain;
use crate::{Error, Result, first_bytes, memory};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Largest text that is read as a whole: scenes, specifications, records (bytes).
pub const MOST_TEXT: u64 = 1 << 26;

/// Largest file of triangles, of discs or of data that is read as a whole (bytes). That of a glTF file is less than
/// twice as much.
pub const MOST_DATA: u64 = 1 << 31;

/// Largest amount that is read from a pipe or a device (bytes), whose length nobody knows before.
const MOST_STREAMED: u64 = 1 << 28;

/// The bytes of `path`, at most `most` of them.
///
/// # Errors
/// [`Error::Input`] for a file that is missing, or larger than `most`; [`Error::Usage`] where there is too little
/// memory for it.
pub fn bytes(path: &Path, most: u64) -> Result<Vec<u8>> {
    let failed = |e: std::io::Error| Error::input(path, explain(&e));
    let file = File::open(path).map_err(failed)?;
    let about = file.metadata().map_err(failed)?;
    let most = if about.is_file() { most } else { most.min(MOST_STREAMED) };
    let mib = |bytes: u64| bytes.div_ceil(1 << 20);
    if about.len() > most {
        let found = format!("{} MiB", mib(about.len()));
        return Err(Error::input(path, format!("found a file of {found}, expected at most {} MiB", mib(most))));
    }
    if about.len() > MOST_TEXT {
        memory::require(about.len(), &format!("{}: a file of {} MiB", path.display(), mib(about.len())))?;
    }
    let mut out = Vec::new();
    file.take(most + 1).read_to_end(&mut out).map_err(failed)?;
    if out.len() as u64 > most {
        let what = format!("found no end after {} MiB; expected a file, not a device that goes on", mib(most));
        return Err(Error::input(path, what));
    }
    Ok(out)
}

/// The text of `path`, at most [`MOST_TEXT`] bytes.
///
/// # Errors
/// As [`bytes`]; a file that is no UTF-8 text.
pub fn text(path: &Path) -> Result<String> {
    text_of(path, "a text file")
}

/// As [`text`], for a reader that says in its own words what is `expected`.
///
/// # Errors
/// As [`text`].
pub fn text_of(path: &Path, expected: &str) -> Result<String> {
    let other = |found: &str| Error::input(path, format!("found {found}, expected {expected}"));
    // What is too large to be read is named too.
    if let Some(form) = head(path).as_deref().and_then(binary) {
        return Err(other(form));
    }
    String::from_utf8(bytes(path, MOST_TEXT)?)
        .map_err(|e| other(binary(e.as_bytes()).unwrap_or("bytes that are not UTF-8")))
}

/// The first bytes of a file; `None` for what can be read only once, or not at all.
fn head(path: &Path) -> Option<Vec<u8>> {
    if !std::fs::metadata(path).ok()?.is_file() {
        return None;
    }
    let mut head = Vec::new();
    File::open(path).ok()?.take(64).read_to_end(&mut head).ok()?;
    Some(head)
}

/// What bytes are that are no text; `None` for a text, and for an unknown form.
fn binary(head: &[u8]) -> Option<&'static str> {
    // The last letter may be cut.
    let letters = std::str::from_utf8(head).map_or_else(|e| e.error_len().is_none(), |_| true);
    if letters && !head.contains(&0) { None } else { first_bytes::form(head) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_no_end_is_a_sentence() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.toml");
        std::fs::write(&path, "x = 1\n").unwrap();
        assert_eq!(text(&path).unwrap(), "x = 1\n");
        let sentence = bytes(&path, 3).unwrap_err().to_string();
        assert!(sentence.contains("a.toml: found a file of 1 MiB, expected at most 1 MiB"), "{sentence}");
        std::fs::write(&path, [0xff, 0x00]).unwrap();
        assert!(text(&path).unwrap_err().to_string().contains("not UTF-8"));
        std::fs::write(&path, b"glTF\x02\0\0\0").unwrap();
        let sentence = text(&path).unwrap_err().to_string();
        assert!(sentence.contains("a.toml: found a binary glTF file (.glb), expected a text file"), "{sentence}");
        #[cfg(unix)]
        {
            let sentence = text(Path::new("/dev/zero")).unwrap_err().to_string();
            assert!(sentence.contains("/dev/zero: found no end after 64 MiB"), "{sentence}");
        }
    }
}
