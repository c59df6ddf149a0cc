//! Content hashes (BLAKE3, hexadecimal): what a fit was made from, and whether a file is still what was written.

use crate::atomic::explain;
use crate::{Error, Result, whole_file};
use std::io;
use std::path::Path;

/// Hash of bytes in hand.
pub fn bytes(data: &[u8]) -> String {
    blake3::hash(data).to_hex().to_string()
}

/// Hash of a text that may be long: it is never held as a whole.
pub fn text(shown: std::fmt::Arguments) -> String {
    struct Hashed(blake3::Hasher);
    impl std::fmt::Write for Hashed {
        fn write_str(&mut self, part: &str) -> std::fmt::Result {
            self.0.update(part.as_bytes());
            Ok(())
        }
    }
    let mut hashed = Hashed(blake3::Hasher::new());
    // Nothing that a hasher does can fail.
    let _ = std::fmt::write(&mut hashed, shown);
    hashed.0.finalize().to_hex().to_string()
}

/// Hash of a file's content, streamed. Of a pipe or a device no more is read than [`whole_file::bytes`] does.
pub fn file(path: &Path) -> Result<String> {
    if std::fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir()) {
        return Ok(bytes(&whole_file::bytes(path, whole_file::MOST_DATA)?));
    }
    let mut source = std::fs::File::open(path).map_err(|e| Error::input(path, explain(&e)))?;
    let mut hasher = blake3::Hasher::new();
    io::copy(&mut source, &mut hasher).map_err(|e| Error::input(path, explain(&e)))?;
    Ok(hasher.finalize().to_hex().to_string())
}

/// Hash of an ordered list of named parts.
pub fn combine<'a>(parts: impl IntoIterator<Item = (&'a str, &'a str)>) -> String {
    let mut hasher = blake3::Hasher::new();
    for (name, hash) in parts {
        for text in [name, hash] {
            hasher.update(&(text.len() as u64).to_le_bytes());
            hasher.update(text.as_bytes());
        }
    }
    hasher.finalize().to_hex().to_string()
}
