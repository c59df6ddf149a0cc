//! In which form a table is written: what separates its cells, whether commas are decimal, and which line names the
//! columns. The first lines of the file tell it; the others are not looked at.

use super::cell::{self, Cell, Possible};

/// How a table is written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Dialect {
    /// What separates cells: a comma, a semicolon or a tab.
    pub separator: u8,
    /// Whether runs of blanks separate cells; the rows are then handed on with the separator in their place.
    pub blanks: bool,
    /// Whether numbers have decimal commas.
    pub decimal_comma: bool,
    /// How many lines stand before the one that names the columns.
    pub skipped: usize,
    /// The mark of a comment in front of the names of the columns; empty where there is none.
    pub mark: String,
    /// How many comment lines stand before the names of the columns.
    comments: usize,
}

/// What is written after a comment mark is no part of the table.
const MARKS: [&str; 4] = ["#", "%", "//", ";"];

/// This many rows tell a table's form.
const ROWS: usize = 50;

/// A line that holds something.
#[derive(Clone, Copy)]
struct Line<'a> {
    /// Its place in the file, from 0.
    place: usize,
    text: &'a [u8],
}

impl Dialect {
    /// The usual form of a CSV.
    pub const CSV: Dialect =
        Dialect { separator: b',', blanks: false, decimal_comma: false, skipped: 0, mark: String::new(), comments: 0 };

    /// The form of a table by its first bytes. `whole` says that they are the whole file; otherwise the last line may
    /// be cut.
    pub fn of(head: &[u8], whole: bool) -> Dialect {
        let lines = lines(head, whole);
        let mut at = 0;
        // A spreadsheet may write what separates the cells into the first line.
        let mut stated = None;
        if let Some(separator) = lines.first().and_then(|l| stated_separator(l.text)) {
            (stated, at) = (Some(separator), 1);
        }
        let first = at;
        while at < lines.len() && is_comment(&lines[at..]) {
            at += 1;
        }
        if at == lines.len() {
            return Dialect { skipped: lines.get(first).map_or(0, |l| l.place), ..Dialect::CSV };
        }
        let sample = |from: usize| &lines[from..lines.len().min(from + ROWS)];
        let form = |lines: &[Line]| stated.map_or_else(|| separator(lines), |s| (s, false));
        let (mut separator, mut blanks) = form(sample(at));
        // The names of the columns may be behind a comment mark; the line below is then one of numbers.
        let mut mark = "";
        if let Some(names) = (at > first).then(|| unmarked(&lines[at - 1])) {
            let with_names: Vec<Line> = std::iter::once(names).chain(sample(at).iter().copied()).collect();
            let as_named = form(&with_names);
            if names_the_columns(names, &lines[at], as_named) {
                at -= 1;
                mark = mark_of(lines[at].text).unwrap_or_default();
                (separator, blanks) = as_named;
            }
        }
        let mark = mark.to_string();
        let decimal_comma = !blanks && separator != b',' && commas_are_decimal(&sample(at)[1..], separator);
        let comments = at - first;
        let skipped = lines[at].place;
        Dialect { separator: if blanks { b'\t' } else { separator }, blanks, decimal_comma, skipped, mark, comments }
    }

    /// How the table is read, where that is not the usual way.
    pub fn words(&self) -> Option<String> {
        let mut parts: Vec<String> = Vec::new();
        let separator = match self.separator {
            _ if self.blanks => Some("blanks"),
            b';' => Some("semicolons"),
            b'\t' => Some("tabs"),
            _ => None,
        };
        let commas = if self.decimal_comma { " with decimal commas" } else { "" };
        parts.extend(separator.map(|s| format!("separated by {s}{commas}")));
        if !self.mark.is_empty() {
            parts.push(format!("with the names of its columns in line {} behind {}", self.skipped + 1, self.mark));
        }
        if self.comments > 0 {
            let lines = if self.comments == 1 { "line" } else { "lines" };
            parts.push(format!("without the {} comment {lines} at its beginning", self.comments));
        }
        (!parts.is_empty()).then(|| parts.join(", "))
    }
}

/// The lines that hold something.
fn lines(head: &[u8], whole: bool) -> Vec<Line<'_>> {
    let mut lines = Vec::new();
    let (mut start, mut place) = (0, 0);
    while start < head.len() && lines.len() < 4 * ROWS {
        let end = memchr::memchr2(b'\n', b'\r', &head[start..]).map(|n| start + n);
        if end.is_none() && !whole && !lines.is_empty() {
            break;
        }
        let end = end.unwrap_or(head.len());
        if end > start {
            lines.push(Line { place, text: &head[start..end] });
        }
        start = if head[end..].starts_with(b"\r\n") { end + 2 } else { end + 1 };
        place += 1;
    }
    lines
}

/// The mark that a comment begins with, perhaps in quotes.
fn mark_of(line: &[u8]) -> Option<&'static str> {
    let text = line.trim_ascii_start();
    let text = text.strip_prefix(b"\"").unwrap_or(text);
    MARKS.into_iter().find(|mark| text.starts_with(mark.as_bytes()))
}

/// Whether the first of these lines is a comment. What looks like a comment mark may also be the name of the first
/// column: `#` of numbered rows, or nothing before a semicolon that separates. Then the line below has as many cells,
/// and numbers among them.
fn is_comment(lines: &[Line]) -> bool {
    let (line, rest) = (lines[0].text, &lines[1..]);
    let below = |separator: u8| {
        let alike = |l: &&Line| mark_of(l.text).is_none() && count(l.text, separator) == count(line, separator);
        let numbers = |l: &Line| cells(l.text, separator, false).iter().any(|c| is_number(c));
        count(line, separator) > 0 && rest.first().filter(alike).is_some_and(numbers)
    };
    let named = |name: &str, separator: u8| cells(line, separator, false)[0] == name && below(separator);
    match mark_of(line) {
        None => false,
        Some(";") => !named("", b';'),
        Some("#") => !b",;\t".iter().any(|&separator| named("#", separator)),
        Some(_) => true,
    }
}

/// The separator of a line `sep=;`.
fn stated_separator(line: &[u8]) -> Option<u8> {
    let text: Vec<u8> = line.iter().filter(|b| **b != b'"').map(u8::to_ascii_lowercase).collect();
    match text.strip_prefix(b"sep=")? {
        [separator @ (b',' | b';' | b'\t')] => Some(*separator),
        _ => None,
    }
}

/// How often a separator stands in a line outside quotes.
fn count(line: &[u8], separator: u8) -> usize {
    let mut quoted = false;
    let outside = |b: &&u8| {
        quoted ^= **b == b'"';
        !quoted && **b == separator
    };
    line.iter().filter(outside).count()
}

/// The cells of a line.
fn cells(line: &[u8], separator: u8, blanks: bool) -> Vec<String> {
    let text = String::from_utf8_lossy(line);
    if blanks {
        return text.split_whitespace().map(String::from).collect();
    }
    let (mut cells, mut quoted) = (vec![String::new()], false);
    for c in text.chars() {
        match c {
            '"' => quoted = !quoted,
            c if !quoted && u32::from(c) == u32::from(separator) => cells.push(String::new()),
            c => {
                if let Some(cell) = cells.last_mut() {
                    cell.push(c);
                }
            }
        }
    }
    cells.iter().map(|c| c.trim().to_string()).collect()
}

/// What separates the cells, and whether runs of blanks do. The separator that stands in the first line and equally
/// often in most of the others is taken.
fn separator(lines: &[Line]) -> (u8, bool) {
    let Some((first, rest)) = lines.split_first() else { return (b',', false) };
    let score = |&separator: &u8| {
        let n = count(first.text, separator);
        let alike = rest.iter().filter(|line| count(line.text, separator) == n).count();
        (n > 0).then_some((alike, n, separator))
    };
    // Of two that are alike, the comma is taken.
    let best = b"\t;,".iter().filter_map(score).max_by_key(|(alike, n, _)| (*alike, *n));
    if let Some((_, _, separator)) = best {
        return (separator, false);
    }
    let words = cells(first.text, b' ', true).len();
    let numbers = |line: &Line| {
        let cells = cells(line.text, b' ', true);
        cells.len() == words && cells.iter().any(|c| is_number(c)) && !line.text.contains(&b'"')
    };
    (b',', words > 1 && !first.text.contains(&b'"') && !rest.is_empty() && rest.iter().all(numbers))
}

fn is_number(text: &str) -> bool {
    matches!(cell::read(text, text.contains(','), &Possible::ANY), Cell::Number(_) | Cell::Stated)
}

/// A comment line without its mark.
fn unmarked<'a>(line: &Line<'a>) -> Line<'a> {
    let text = line.text.trim_ascii_start();
    let text = text.strip_prefix(b"\"").unwrap_or(text);
    Line { text: text.strip_prefix(mark_of(line.text).unwrap_or_default().as_bytes()).unwrap_or(text), ..*line }
}

/// Whether a comment line, which comes without its mark, names the columns of the line below it, which then is the
/// first row.
fn names_the_columns(names: Line, below: &Line, (separator, blanks): (u8, bool)) -> bool {
    let (names, row) = (cells(names.text, separator, blanks), cells(below.text, separator, blanks));
    let numbers: Vec<f64> = row.iter().filter_map(|c| c.replace(',', ".").parse().ok()).collect();
    let one = names.len() == 1;
    let alike = names.len() == row.len() && !(one && names[0].contains(char::is_whitespace));
    alike && names.iter().all(|n| !n.is_empty()) && !numbers.is_empty() && !are_wavelengths(&numbers)
}

/// Whether numbers are wavelengths that name columns: several in rising order, in nm or µm.
fn are_wavelengths(numbers: &[f64]) -> bool {
    let rising = numbers.windows(2).all(|w| w[0] < w[1]);
    let all_in = |[low, high]: [f64; 2]| numbers.iter().all(|v| (low..=high).contains(v));
    rising && (numbers.len() >= 3 && all_in([150.0, 30_000.0]) || numbers.len() >= 5 && all_in([0.2, 30.0]))
}

/// Whether the commas in the cells of these rows are decimal. A cell such as `1,550` alone does not tell, because its
/// comma may separate thousands; nor do commas beside decimal points.
fn commas_are_decimal(rows: &[Line], separator: u8) -> bool {
    let (mut decimal, mut point) = (false, false);
    for text in rows.iter().flat_map(|row| cells(row.text, separator, false)) {
        point |= text.contains('.') && text.parse::<f64>().is_ok();
        if !text.contains(',') || !is_number(&text) {
            continue;
        }
        let (before, after) = text.split_once(',').unwrap_or_default();
        let before = before.trim_start_matches(['-', '+', '−', '–']);
        let thousands = after.len() == 3 && !before.starts_with('0') && (1..=3).contains(&before.len());
        decimal |= !thousands;
    }
    decimal && !point
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Dialect {
        Dialect::of(text.as_bytes(), true)
    }

    #[test]
    fn separators_and_decimal_commas_are_told_by_the_first_rows() {
        let told = |text: &str| (char::from(of(text).separator), of(text).decimal_comma);
        for (text, separator, decimal) in [
            ("x,y\n1,2\n", ',', false),
            ("x;y\n1;2\n", ';', false),
            ("x;y\n0,5;2\n", ';', true),
            ("x\ty\n0,5\t2\n", '\t', true),
            ("x\ty\n0.5\t2\n", '\t', false),
            // A name with a comma in it, and numbers with decimal commas.
            ("leaf;R (450,5);T\na;0,5;0,1\nb;0,25;0,1\n", ';', true),
            ("note;remark,x\n\"a;b\",1\nc,2\n", ',', false),
            // A comma that may separate thousands says nothing, and neither do commas beside points.
            ("w\tR\n1,550\t7\n", '\t', false),
            ("w;R\n1,550;0.5\n0,5;3\n", ';', false),
            ("w\tR\n1,550\t0,7\n", '\t', true),
            ("sep=;\nx;y\n1;2\n", ';', false),
            ("x\n1\n", ',', false),
            ("\"a;b\",x\n\"c\",1\n", ',', false),
        ] {
            assert_eq!(told(text), (separator, decimal), "{text:?}");
        }
    }

    #[test]
    fn blanks_separate_only_what_is_a_table_that_way() {
        assert!(of("wl  R T\n 450 0.1  0.2\n460 0.1 0.2\n").blanks);
        for text in ["my column\n1\n2\n", "first name\nold oak\n", "x y\n", "x y,z\n1 2,3\n"] {
            assert!(!of(text).blanks, "{text:?}");
        }
    }

    #[test]
    fn comments_are_skipped_and_may_name_the_columns() {
        let told = |text: &str| (of(text).skipped, of(text).mark);
        for (text, skipped, mark) in [
            ("# made by\n\n% a, b\n// c\n\nx,y\n1,2\n", 5, ""),
            ("# made by\n#wl,R(adaxial),T\n350,0.1,0.2\n", 1, "#"),
            ("% wl;R\r350;0,1\r", 0, "%"),
            ("# wl R T\n350 0.1 0.2\n351 0.1 0.2\n", 0, "#"),
            // The line below has names.
            ("# leaf, measured, 2013\nleaf,R,T\na,0.1,0.2\n", 1, ""),
            ("# a,b,c,d\nleaf,450,460,470\nx,0.1,0.2,0.3\n", 1, ""),
            ("# one number\n5,4\n", 1, ""),
            ("\"# made, by\",,\nx,y,z\n1,2,3\n", 1, ""),
            // What is no comment.
            ("#,x\n1,2\n", 0, ""),
            (";R450;T450\n1;0,5;0,4\n", 0, ""),
            ("; made by\n;\nx;y\n1;2\n", 2, ""),
            ("x,y\n# 1,2\n", 0, ""),
            ("sep=,\n# c\nx,y\n1,2\n", 2, ""),
        ] {
            assert_eq!(told(text), (skipped, mark.to_string()), "{text:?}");
        }
        assert_eq!(
            of("# a\n# b\nx;y\n0,5;2\n").words().unwrap(),
            "separated by semicolons with decimal commas, without the 2 comment lines at its beginning"
        );
        assert_eq!(of("x,y\n").words(), None);
    }
}
