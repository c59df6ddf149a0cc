//! What is said of an argument that should be a number: a sentence in place of what the parser of numbers says.

use super::{Cli, command};
use clap::FromArgMatches;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use std::ffi::OsString;

/// What is wrong with a number, as the standard library says it, and whether a whole one was expected.
const WRONG: [(&str, bool); 6] = [
    ("invalid float literal", false),
    ("cannot parse float from empty string", false),
    ("invalid digit found in string", true),
    ("cannot parse integer from empty string", true),
    ("number too large to fit in target type", true),
    ("number too small to fit in target type", true),
];

/// The command line that these words are, the program's name first.
///
/// # Errors
/// Help, version, and wrong words; of a number that cannot be read the error says what was expected.
pub(super) fn read(words: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> Result<Cli, clap::Error> {
    command().try_get_matches_from(words).and_then(|matches| Cli::from_arg_matches(&matches)).map_err(in_words)
}

/// The same error, with a sentence where a number could not be read.
fn in_words(e: clap::Error) -> clap::Error {
    let said = std::error::Error::source(&e).map(ToString::to_string).unwrap_or_default();
    let whole = WRONG.iter().find(|(wrong, _)| said.ends_with(wrong)).map(|(_, whole)| *whole);
    let text = |kind| match e.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        _ => None,
    };
    match (e.kind(), whole, text(ContextKind::InvalidArg), text(ContextKind::InvalidValue)) {
        (ErrorKind::ValueValidation, Some(whole), Some(argument), Some(found)) => {
            let sentence = format!(
                "{argument}: found {found:?}, expected {}\n\nFor more information, try '--help'.\n",
                expected(&found, whole)
            );
            clap::Error::raw(ErrorKind::ValueValidation, sentence).with_cmd(&command())
        }
        _ => e,
    }
}

/// What is expected in place of `found`, and the likely slip.
fn expected(found: &str, whole: bool) -> String {
    let kind = if whole { "a whole number" } else { "a number" };
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|x| x.is_finite() && (!whole || x.fract() == 0.0));
    let such = |text: &str, slip: &str| format!("{kind} such as {}: {slip}", text.trim());
    let with_point = found.replace(',', ".");
    if !whole && found.matches(',').count() == 1 && number(&with_point).is_some() {
        return such(&with_point, "is it a decimal comma?");
    }
    let bare = found.trim_end_matches(|c: char| c.is_alphabetic() || matches!(c, '%' | '°' | ' '));
    if let Some(x) = number(bare).filter(|_| bare != found) {
        return such(
            &if whole { x.to_string() } else { bare.to_string() },
            "the unit is the option's own, and --help says which it is",
        );
    }
    match found.parse::<f64>() {
        Ok(x) if whole && x.fract() != 0.0 => such(&x.round().to_string(), "this one has a fraction"),
        Ok(x) if whole && !(0.0..=1e6).contains(&x) => format!("{kind} in the range that --help states"),
        _ => format!("{kind} such as {}", if whole { "2" } else { "0.2" }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(words: &str) -> String {
        let read = read(words.split(' ').map(String::from).collect::<Vec<_>>());
        read.err().map_or_else(String::new, |e| e.to_string())
    }

    #[test]
    fn numbers_that_cannot_be_read_are_answered_with_what_was_expected() {
        for (words, expected) in [
            ("mesophyll fit slab --noise 0,2", "found \"0,2\", expected a number such as 0.2: is it a decimal comma?"),
            ("mesophyll fit slab --index 1,41", "found \"1,41\", expected a number such as 1.41: is it"),
            ("mesophyll film a.toml -o b --to 1000ms", "found \"1000ms\", expected a number such as 1000: the unit"),
            ("mesophyll fit slab --noise 2%", "expected a number such as 2: the unit is the option's own"),
            ("mesophyll fit slab --noise little", "found \"little\", expected a number such as 0.2\n"),
            ("mesophyll fit slab --noise 1.234,5", "found \"1.234,5\", expected a number such as 0.2\n"),
            ("mesophyll fit beam --samples 10.5", "found \"10.5\", expected a whole number such as 11: this one has"),
            ("mesophyll fit beam --samples 1,000", "found \"1,000\", expected a whole number such as 2\n"),
            ("mesophyll fit beam --samples 16.0x", "expected a whole number such as 16: the unit"),
            ("mesophyll fit beam --samples x", "found \"x\", expected a whole number such as 2\n"),
        ] {
            let found = said(words);
            assert!(found.starts_with("error: --") && found.contains(expected), "{words}: {found}");
            assert!(!found.contains("literal") && !found.contains("digit"), "{found}");
        }
        // Other slips are said as before.
        assert!(said("mesophyll fit beam --samples 1").contains("is not in 2..=1000000"));
        assert!(said("mesophyll fit slab --noise 0.2").is_empty());
    }
}
