//! What a file holds may be of any length, and messages quote it. Here they are cut to what a person reads.

use std::borrow::Cow;
use std::fmt::Write;

/// A word of more characters than this is cut.
const LONGEST_WORD: usize = 120;

/// A number of more characters than this is written with a power of ten.
const LONGEST_NUMBER: usize = 40;

/// A name of a file is left whole up to the length that systems allow.
const LONGEST_PATH: usize = 4096;

/// A message of more characters than this is cut.
const LONGEST: usize = 8000;

/// `text` with every long word cut, and cut itself where it is long. Numbers of many digits become `1e300`.
pub fn short(text: &str) -> Cow<'_, str> {
    let long = |word: &str| word.len() > LONGEST_NUMBER && shorter(word).is_some();
    if text.len() <= LONGEST && !text.split_whitespace().any(long) {
        return Cow::Borrowed(text);
    }
    let mut out = String::new();
    for piece in text.split_inclusive(char::is_whitespace) {
        if out.len() > LONGEST {
            let _ = write!(out, "… ({} characters in all)", text.chars().count());
            break;
        }
        let word = piece.trim_end_matches(char::is_whitespace);
        match shorter(word) {
            Some(cut) => out.extend([&cut, &piece[word.len()..]]),
            None => out.push_str(piece),
        }
    }
    Cow::Owned(out)
}

/// A long word as it is shown, `None` where it is not long.
fn shorter(word: &str) -> Option<String> {
    let bare = word.trim_end_matches([',', ';', ':', '"', ')', '.']).trim_start_matches(['"', '(']);
    let digits = |c: char| c.is_ascii_digit() || matches!(c, '.' | '-' | '+' | 'e' | 'E');
    if bare.len() > LONGEST_NUMBER
        && bare.chars().all(digits)
        && let Some(number) = bare.parse::<f64>().ok().filter(|number| number.is_finite())
    {
        return Some(word.replace(bare, &format!("{number:e}")));
    }
    let whole = if word.contains(['/', '\\']) { LONGEST_PATH } else { LONGEST_WORD };
    word.chars().nth(whole)?;
    let start: String = word.chars().take(LONGEST_WORD / 2).collect();
    Some(format!("{start}… ({} characters)", word.chars().count()))
}

#[cfg(test)]
mod tests {
    use super::short;
    use crate::error::Error;
    use std::path::Path;

    #[test]
    fn what_a_person_reads_stays_and_the_rest_is_counted() {
        let path = format!("/home/{}/leaf.csv", "folder/".repeat(40));
        for plain in ["a.csv:3: rho_d: found 0.25, expected a number", "found 1e-300", &path, "ρd ≤ 1"] {
            assert_eq!(short(plain), plain);
        }
        let said = Error::unexpected(Path::new("a.csv"), "h", "x".repeat(3_000_000), "a number").to_string();
        assert!(said.starts_with("a.csv: h: found xxx") && said.contains("(3000000 characters)"), "{}", said.len());
        assert!(said.len() < 200 && said.ends_with("expected a number"));
        // A number of 309 digits, as it is printed and as it stands in a file.
        let said = Error::unexpected(Path::new("a.csv"), "h", 1e308, "at most 1000").to_string();
        assert_eq!(said, "a.csv: h: found 1e308, expected at most 1000");
        let said = short(&format!("found \"{}\" here", "9".repeat(309))).into_owned();
        assert!(said.starts_with("found \"999") && said.contains("(311 characters)") && said.len() < 120, "{said}");
        let columns: Vec<String> = (0..100_000).map(|k| format!("column_{k}")).collect();
        let said = short(&columns.join(", ")).into_owned();
        assert!(said.len() < 9000 && said.ends_with("characters in all)"), "{}", said.len());
    }
}
