//! What a table's bytes pass through before its rows are cut: they become UTF-8, and their lines are counted.

use memchr::{memchr, memchr_iter, memchr2_iter};
use std::io::{self, Read};

/// Counts the lines that hold anything, whichever line ends they have. It knows nothing of rows and cells, so that the
/// rows that were cut from the same bytes can be compared with this number.
pub(super) struct Lines<R> {
    source: R,
    ended: u64,
    /// Whether the last line that was begun holds anything.
    open: bool,
}

impl<R: Read> Lines<R> {
    pub fn new(source: R) -> Self {
        Lines { source, ended: 0, open: false }
    }

    /// How many lines that are not empty were read so far.
    pub fn count(&self) -> u64 {
        self.ended + u64::from(self.open)
    }

    fn see(&mut self, bytes: &[u8]) {
        let mut start = 0;
        let mut end = |at: usize| {
            self.ended += u64::from(self.open || at > start);
            (self.open, start) = (false, at + 1);
        };
        if memchr(b'\r', bytes).is_some() {
            memchr2_iter(b'\n', b'\r', bytes).for_each(&mut end);
        } else {
            memchr_iter(b'\n', bytes).for_each(&mut end);
        }
        self.open |= start < bytes.len();
    }
}

impl<R: Read> Read for Lines<R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let n = self.source.read(bytes)?;
        self.see(&bytes[..n]);
        Ok(n)
    }
}

/// How many lines of a text hold anything.
pub(super) fn filled(text: &[u8]) -> u64 {
    let mut lines = Lines::new(io::empty());
    lines.see(text);
    lines.count()
}

/// How a text is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Utf8,
    Utf16 { big_endian: bool },
}

/// This many bytes tell an encoding.
const ENOUGH: usize = 512;

impl Encoding {
    /// The encoding of a text by its first bytes, and the length of its byte-order mark.
    pub fn of(head: &[u8]) -> (Encoding, usize) {
        let head = &head[..head.len().min(ENOUGH)];
        if head.starts_with(&[0xef, 0xbb, 0xbf]) {
            return (Encoding::Utf8, 3);
        }
        let units = (head.len() / 2).max(1);
        // A table has digits, separators and line ends. In UTF-16 one byte of each of them is 0, always the same one.
        let zeros = |of: usize| head.iter().skip(of).step_by(2).filter(|b| **b == 0).count();
        for (mark, big_endian) in [([0xff, 0xfe], false), ([0xfe, 0xff], true)] {
            let (high, low) = (zeros(usize::from(!big_endian)), zeros(usize::from(big_endian)));
            let marked = head.starts_with(&mark);
            if marked && high > 0 || low == 0 && head.len() > 3 && 4 * high >= 3 * units {
                return (Encoding::Utf16 { big_endian }, if marked { 2 } else { 0 });
            }
        }
        (Encoding::Utf8, 0)
    }
}

/// A whole text file as UTF-8 with line feeds, whatever its encoding and line ends; `None` where it is no text.
pub fn plain_text(bytes: &[u8]) -> Option<String> {
    let (encoding, mark) = Encoding::of(bytes);
    let mut text = String::new();
    match encoding {
        Encoding::Utf8 => text.push_str(std::str::from_utf8(&bytes[mark..]).ok()?),
        Encoding::Utf16 { big_endian } => {
            FromUtf16::new(&bytes[mark..], big_endian).read_to_string(&mut text).ok()?;
        }
    }
    Some(if text.contains('\r') { text.replace("\r\n", "\n").replace('\r', "\n") } else { text })
}

/// A text in UTF-16 as UTF-8. What is no character becomes a replacement character.
pub(super) struct FromUtf16<R> {
    source: R,
    big_endian: bool,
    /// Bytes that were read and not yet decoded: half a unit, or half of a pair of units.
    rest: Vec<u8>,
    decoded: Vec<u8>,
    at: usize,
}

impl<R: Read> FromUtf16<R> {
    pub fn new(source: R, big_endian: bool) -> Self {
        FromUtf16 { source, big_endian, rest: Vec::new(), decoded: Vec::new(), at: 0 }
    }

    /// Decodes the next bytes; false at the end.
    fn fill(&mut self) -> io::Result<bool> {
        let kept = self.rest.len();
        self.rest.resize(kept + (1 << 16), 0);
        let n = self.source.read(&mut self.rest[kept..])?;
        self.rest.truncate(kept + n);
        let unit = |pair: &[u8]| {
            let pair = [pair[0], pair[1]];
            if self.big_endian { u16::from_be_bytes(pair) } else { u16::from_le_bytes(pair) }
        };
        let mut units: Vec<u16> = self.rest.chunks_exact(2).map(unit).collect();
        let mut taken = 2 * units.len();
        if n > 0 && units.last().is_some_and(|u| (0xd800..0xdc00).contains(u)) {
            // The other half of the pair follows.
            units.pop();
            taken -= 2;
        }
        self.decoded.clear();
        self.at = 0;
        for character in char::decode_utf16(units) {
            let character = character.unwrap_or(char::REPLACEMENT_CHARACTER);
            self.decoded.extend_from_slice(character.encode_utf8(&mut [0; 4]).as_bytes());
        }
        self.rest.drain(..taken);
        if n == 0 && !self.rest.is_empty() {
            self.rest.clear();
            self.decoded.extend_from_slice("\u{fffd}".as_bytes());
        }
        Ok(n > 0 || !self.decoded.is_empty())
    }
}

impl<R: Read> Read for FromUtf16<R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        while self.at == self.decoded.len() {
            if !self.fill()? {
                return Ok(0);
            }
        }
        let n = bytes.len().min(self.decoded.len() - self.at);
        bytes[..n].copy_from_slice(&self.decoded[self.at..self.at + n]);
        self.at += n;
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Hands out its bytes a few at a time.
    struct Slow<'a>(&'a [u8], usize);

    impl Read for Slow<'_> {
        fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
            let n = self.1.min(self.0.len()).min(bytes.len());
            bytes[..n].copy_from_slice(&self.0[..n]);
            self.0 = &self.0[n..];
            Ok(n)
        }
    }

    #[test]
    fn lines_are_counted_whatever_ends_them_and_wherever_they_are_cut() {
        for (text, count) in
            [("", 0), ("a", 1), ("a\n", 1), ("\n\na\r\nb\rc\n\r\n", 3), ("a\r\rb\n\nc", 3), ("\r\n\r\n", 0)]
        {
            assert_eq!(filled(text.as_bytes()), count, "{text:?}");
            for size in 1..4 {
                let mut lines = Lines::new(Slow(text.as_bytes(), size));
                io::copy(&mut lines, &mut io::sink()).unwrap();
                assert_eq!(lines.count(), count, "{text:?} by {size}");
            }
        }
    }

    #[test]
    fn utf_16_is_recognised_and_decoded() {
        let text = "leaf;R\nµ🌿;0,5\n";
        for big_endian in [false, true] {
            let bytes = |mark: bool| -> Vec<u8> {
                let units = mark.then_some(0xfeff).into_iter().chain(text.encode_utf16());
                units.flat_map(|u| if big_endian { u.to_be_bytes() } else { u.to_le_bytes() }).collect()
            };
            let utf16 = Encoding::Utf16 { big_endian };
            assert_eq!(Encoding::of(&bytes(true)), (utf16, 2));
            assert_eq!(Encoding::of(&bytes(false)), (utf16, 0));
            for size in [1, 3, 1000] {
                let mut decoded = String::new();
                let plain = bytes(false);
                FromUtf16::new(Slow(&plain, size), big_endian).read_to_string(&mut decoded).unwrap();
                assert_eq!(decoded, text);
            }
            let mut cut = bytes(false);
            cut.truncate(cut.len() - 1);
            let mut decoded = String::new();
            FromUtf16::new(&cut[..], big_endian).read_to_string(&mut decoded).unwrap();
            assert!(decoded.ends_with("5\u{fffd}"));
        }
        for plain in [&b"x,y\n1,2\n"[..], b"", b"x", b"\xff\xfe,x\n1,2\n", b"\xff\xfe\n1\n"] {
            assert_eq!(Encoding::of(plain), (Encoding::Utf8, 0), "{plain:?}");
        }
        assert_eq!(Encoding::of(b"\xef\xbb\xbfx"), (Encoding::Utf8, 3));
    }
}
