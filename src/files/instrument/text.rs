//! Text of instruments: any common encoding, any line ends, decimal points or commas.

/// The text of a file in UTF-8 or UTF-16 (told by its byte-order mark or by its zero bytes), otherwise in Latin-1.
pub(super) fn decode(bytes: &[u8]) -> String {
    match bytes {
        [0xef, 0xbb, 0xbf, rest @ ..] => eight(rest),
        [0xff, 0xfe, rest @ ..] => sixteen(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => sixteen(rest, u16::from_be_bytes),
        // ASCII in UTF-16 without a mark has a zero in each pair of bytes.
        [a, 0, b, 0, ..] if *a > 0 && *b > 0 => sixteen(bytes, u16::from_le_bytes),
        [0, a, 0, b, ..] if *a > 0 && *b > 0 => sixteen(bytes, u16::from_be_bytes),
        _ => eight(bytes),
    }
}

/// UTF-8, and Latin-1 where it is no UTF-8. The last character may be cut off where `bytes` are the head of a file.
fn eight(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_string(),
        Err(e) if e.error_len().is_none() => String::from_utf8_lossy(&bytes[..e.valid_up_to()]).into_owned(),
        Err(_) => bytes.iter().map(|&b| char::from(b)).collect(),
    }
}

fn sixteen(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> String {
    let units = bytes.chunks_exact(2).map(|pair| unit([pair[0], pair[1]]));
    char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
}

/// The lines of a text with their numbers from 1. They may end in a line feed, a carriage return or both.
pub(super) fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut rest = Some(text);
    let next = move || {
        let text = rest?;
        let end = text.find(['\n', '\r']);
        rest = end.map(|end| {
            let pair = text[end..].starts_with("\r\n");
            &text[end + 1 + usize::from(pair)..]
        });
        Some(&text[..end.unwrap_or(text.len())])
    };
    (1..).zip(std::iter::from_fn(next))
}

/// A number with a decimal point or, where it has no point, with a decimal comma.
pub(super) fn number(token: &str) -> Option<f64> {
    let token = token.trim();
    if token.contains('.') || token.matches(',').count() != 1 {
        return token.parse().ok();
    }
    token.replace(',', ".").parse().ok()
}

/// A wavelength in nm: a positive number. None of these instruments works beyond 100 µm.
pub(super) fn wavelength(token: &str) -> Option<f64> {
    number(token).filter(|w| *w > 0.0 && *w < 1e5)
}

/// `KEY SEPARATOR VALUE`, both without the blanks around them; the key in lower case.
pub(super) fn pair(line: &str, separator: char) -> Option<(String, &str)> {
    let (key, value) = line.split_once(separator)?;
    Some((key.trim().to_ascii_lowercase(), value.trim()))
}

/// Lines that hold no reading, as a note; `None` where there is none.
pub(super) fn left_out(bad: &[usize]) -> Option<String> {
    match bad {
        [] => None,
        [line] => Some(format!("line {line} holds no reading and is left out")),
        [line, ..] => Some(format!("{} lines hold no reading and are left out, the first is line {line}", bad.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encodings_line_ends_and_commas() {
        let text = "Länge= 1\r\nb\rc\n\nd";
        let sixteen = |mark: &[u8], unit: fn(u16) -> [u8; 2]| {
            let units = text.encode_utf16().flat_map(unit);
            mark.iter().copied().chain(units).collect::<Vec<u8>>()
        };
        for bytes in [
            text.as_bytes().to_vec(),
            [b"\xef\xbb\xbf", text.as_bytes()].concat(),
            sixteen(b"\xff\xfe", u16::to_le_bytes),
            sixteen(b"\xfe\xff", u16::to_be_bytes),
            sixteen(b"", u16::to_le_bytes),
            sixteen(b"", u16::to_be_bytes),
            text.chars().map(|c| c as u8).collect(),
        ] {
            let decoded = decode(&bytes);
            let found: Vec<_> = lines(&decoded).collect();
            assert_eq!(found, [(1, "Länge= 1"), (2, "b"), (3, "c"), (4, ""), (5, "d")]);
        }
        assert_eq!(pair("Scan Time = 2 = 3", '='), Some(("scan time".into(), "2 = 3")));
        assert_eq!(
            (number(" 3,5"), number("3.5"), number("1,234.5"), number("1,2,3"), number("x")),
            (Some(3.5), Some(3.5), None, None, None)
        );
        assert_eq!((wavelength("-1"), wavelength("nan"), wavelength("550")), (None, None, Some(550.0)));
    }
}
