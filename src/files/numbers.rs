//! Plain lists of numbers: one entry a line, numbers separated by blanks. Empty lines, and everything after a `#`, are
//! skipped. Encodings and line ends are those of tables.

use crate::table::plain_text;
use crate::{Error, Result, whole_file};
use std::path::Path;

/// Reads entries of `N` finite numbers; `what` names them for messages ("radius, centre x y z").
///
/// # Errors
/// [`Error::Input`] naming the file, the line, what was found and what was expected; also for a file without an entry.
pub fn read<const N: usize>(path: &Path, what: &str) -> Result<Vec<[f64; N]>> {
    let text = plain_text(&whole_file::bytes(path, whole_file::MOST_DATA)?);
    let text = text.ok_or_else(|| Error::input(path, "found bytes that are no UTF-8 text"))?;
    let mut out = Vec::new();
    for (k, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default();
        let words: Vec<&str> = line.split_whitespace().collect();
        if words.is_empty() {
            continue;
        }
        let wrong =
            |found: String| Error::input(path, format!("line {}: {found}, expected {N} numbers: {what}", k + 1));
        if words.len() != N {
            return Err(wrong(format!("found {} of them", words.len())));
        }
        let mut entry = [0.0; N];
        for (value, word) in entry.iter_mut().zip(&words) {
            *value =
                word.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| wrong(format!("found \"{word}\"")))?;
        }
        out.push(entry);
    }
    if out.is_empty() {
        return Err(Error::input(path, format!("holds nothing, expected lines of {N} numbers: {what}")));
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_wrong_line_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            super::read::<2>(&path, "x y")
        };
        assert_eq!(read("# points\n1 2\n\n-3e2\t4 # last\n").unwrap(), [[1.0, 2.0], [-300.0, 4.0]]);
        assert_eq!(read("\u{feff}# points\r1 2\r\r\n-3e2\t4 # last\r").unwrap(), [[1.0, 2.0], [-300.0, 4.0]]);
        let wide = "1 2\r\n3 4\r\n".encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<u8>>();
        std::fs::write(&path, wide).unwrap();
        assert_eq!(super::read::<2>(&path, "x y").unwrap(), [[1.0, 2.0], [3.0, 4.0]]);
        for (text, expected) in [
            ("1 2\n3\n", "line 2: found 1 of them, expected 2 numbers: x y"),
            ("1 two\n", "line 1: found \"two\""),
            ("1 nan\n", "line 1: found \"nan\""),
            ("#\n", "holds nothing"),
        ] {
            let found = read(text).unwrap_err().to_string();
            assert!(found.contains(expected), "{found}");
        }
    }
}
