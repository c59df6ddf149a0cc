//! What a cell says: a number, nothing, or something else. All tables are read by this one list of missing readings.

/// Words that say that there is no reading; capitals do not matter. Programs write some of them (`#N/A` and
/// `#DIV/0!` a spreadsheet, `1.#QNAN` older compilers, `\N` a database), people the others.
const WORDS: [&str; 33] = [
    "",
    "nan",
    "-nan",
    "+nan",
    "nan(ind)",
    "-nan(ind)",
    "1.#qnan",
    "-1.#qnan",
    "1.#ind",
    "-1.#ind",
    "na",
    "n/a",
    "n.a.",
    "#n/a",
    "#na",
    "#value!",
    "#div/0!",
    "#num!",
    "#ref!",
    "#name?",
    "#null!",
    "null",
    "none",
    "nil",
    "missing",
    "-",
    "--",
    "---",
    "–",
    ".",
    "..",
    "?",
    "\\n",
];

/// The number that stands for a missing reading in every column.
const NOTHING: f64 = -9999.0;

/// Larger numbers are no readings of anything: programs write 1e30, 9.96921e36 (netCDF) or 1.23e34 for a missing one.
const FILL: f64 = 1e30;

/// What is possible in a column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Possible {
    /// The range in which readings of this quantity are.
    pub range: [f64; 2],
    /// The one value outside the range that this table repeats, which therefore means a missing reading.
    pub repeated: Option<f64>,
}

impl Possible {
    /// Any number.
    pub const ANY: Possible = Possible { range: [f64::NEG_INFINITY, f64::INFINITY], repeated: None };

    pub fn within(range: [f64; 2]) -> Possible {
        Possible { range, repeated: None }
    }

    /// Whether the number is in the range.
    #[inline]
    pub fn holds(&self, v: f64) -> bool {
        (self.range[0]..=self.range[1]).contains(&v)
    }

    /// Whether the number means a missing reading: −9999 in every column, and where no reading can be, a number of
    /// nines (−999, −9.99, 9999), a number of at least 1e30, and the value that the table repeats.
    #[inline]
    pub fn is_missing(&self, v: f64) -> bool {
        v == NOTHING || !self.holds(v) && v.is_finite() && (v.abs() >= FILL || nines(v) || self.repeated == Some(v))
    }
}

/// Whether a number is written with nines alone, and with two at least.
fn nines(v: f64) -> bool {
    let text = v.abs().to_string();
    let digits = text.trim_start_matches('0').bytes().filter(|b| *b != b'.');
    digits.clone().count() >= 2 && digits.clone().all(|b| b == b'9')
}

/// What a cell holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Cell {
    Number(f64),
    /// No reading: an empty cell or a word for that.
    Missing,
    /// A number that means that there is no reading.
    Stated,
    /// No number.
    Text,
    /// A number with a point in a table with decimal commas, or with a comma in another table.
    Unclear,
}

/// Reads a cell, which has no blanks around it.
#[inline]
pub(super) fn read(text: &str, decimal_comma: bool, possible: &Possible) -> Cell {
    let number = |v: f64| if possible.is_missing(v) { Cell::Stated } else { Cell::Number(v) };
    match text.parse::<f64>() {
        // `nan`, in any spelling
        Ok(v) if v.is_nan() => Cell::Missing,
        Ok(v) if decimal_comma && text.contains('.') && !possible.is_missing(v) => Cell::Unclear,
        Ok(v) => number(v),
        Err(_) if WORDS.iter().any(|word| word.eq_ignore_ascii_case(text)) => Cell::Missing,
        Err(_) => match unusual(text) {
            Some(plain) => match plain.parse::<f64>() {
                Ok(v) if v.is_finite() && (decimal_comma || !text.contains(',')) => number(v),
                Ok(v) if v.is_finite() => Cell::Unclear,
                _ => Cell::Text,
            },
            None if looks_grouped(text) => Cell::Unclear,
            None => Cell::Text,
        },
    }
}

/// A number with a decimal comma or a typographic minus sign, in plain form.
fn unusual(text: &str) -> Option<String> {
    let minus = text.starts_with(['−', '–']);
    let commas = text.matches(',').count();
    if !minus && commas == 0 || commas > 1 || commas == 1 && text.contains('.') {
        return None;
    }
    // Only digits, signs and an exponent are left: `1,inf` is no number.
    let plain = text.replacen(['−', '–'], "-", 1).replacen(',', ".", 1);
    plain.bytes().all(|b| b.is_ascii_digit() || b"+-.eE".contains(&b)).then_some(plain)
}

/// Whether it is a number with separated thousands: `1.234,5`, `1,234,567`.
fn looks_grouped(text: &str) -> bool {
    text.contains(',')
        && text.bytes().any(|b| b.is_ascii_digit())
        && text.bytes().all(|b| b"+-.,0123456789".contains(&b))
}

/// The sentence on a cell that is not the number that was expected.
pub(super) fn complaint(name: &str, text: &str, cell: Cell, decimal_comma: bool) -> String {
    match cell {
        Cell::Missing if text.is_empty() => format!("{name} is empty"),
        Cell::Missing | Cell::Stated => format!("{name} is missing ({text})"),
        Cell::Unclear if decimal_comma => format!(
            "{name} is {text:?}; in this table commas are decimal, so a point may separate thousands; expected a \
             number without a point"
        ),
        Cell::Unclear => format!(
            "{name} is {text:?}; a comma may be decimal or separate thousands; expected a number with a decimal point, \
             or a table with decimal commas in all its numbers, separated by semicolons or tabs"
        ),
        _ => format!("{name} is {text:?}; expected a number"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(text: &str) -> Cell {
        read(text, false, &Possible::ANY)
    }

    #[test]
    fn words_for_nothing_are_known_in_any_case() {
        for word in
            ["", "NaN", "NAN", "-nan", "NA", "n/a", "#N/A", "NULL", "None", "-", "--", ".", "#DIV/0!", "-9999.00"]
        {
            let nothing = matches!(plain(word), Cell::Missing | Cell::Stated);
            assert!(nothing, "{word}: {:?}", plain(word));
        }
        for word in ["x", "0.3 mm", "30 %", "nano", "1.2.3", "-.", "inch"] {
            assert_eq!(plain(word), Cell::Text, "{word}");
        }
        // A number that is not finite is a number; the model says what it thinks of it.
        assert_eq!(plain("inf"), Cell::Number(f64::INFINITY));
    }

    /// A number for nothing counts only where no reading can have this value.
    #[test]
    fn numbers_for_nothing_depend_on_the_quantity() {
        let share = Possible::within([-0.9, 200.0]);
        for text in ["-9999", "-999", "-99.99", "-9.999", "9999", "999.9", "1e34", "-1.0e31", "9.96921e36"] {
            assert_eq!(read(text, false, &share), Cell::Stated, "{text}");
        }
        for (text, v) in
            [("-0.001", -0.001), ("0.999", 0.999), ("99.9", 99.9), ("-1", -1.0), ("-9", -9.0), ("250", 250.0)]
        {
            assert_eq!(read(text, false, &share), Cell::Number(v), "{text}");
        }
        assert_eq!(read("-1", false, &Possible { repeated: Some(-1.0), ..share }), Cell::Stated);
        // A deflection may be −9.999 mm and −999 mm.
        for (text, v) in [("-9.999", -9.999), ("-999", -999.0), ("9999", 9999.0), ("1e300", 1e300)] {
            assert_eq!(plain(text), Cell::Number(v), "{text}");
        }
        assert_eq!(plain("-9999.0"), Cell::Stated);
    }

    #[test]
    fn commas_are_decimal_only_where_the_table_says_so() {
        let german = |text: &str| read(text, true, &Possible::ANY);
        for (text, v) in
            [("0,114", 0.114), ("-1,5e-3", -1.5e-3), ("550", 550.0), (",5", 0.5), ("−0,5", -0.5), ("1e5", 1e5)]
        {
            assert_eq!(german(text), Cell::Number(v), "{text}");
        }
        for text in ["1.234,5", "1.234", "0.5", "1,234,567"] {
            assert_eq!(german(text), Cell::Unclear, "{text}");
        }
        assert_eq!(german("-9999.0"), Cell::Stated);
        assert_eq!(german("-9999,0"), Cell::Stated);
        for text in ["1,inf", "a,b", "1,2x"] {
            assert_eq!(german(text), Cell::Text, "{text}");
        }
        for text in ["0,114", "1,234.5"] {
            assert_eq!(plain(text), Cell::Unclear, "{text}");
        }
        assert_eq!(plain("−0.5"), Cell::Number(-0.5));
    }
}
