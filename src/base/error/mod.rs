//! The one error that every room returns, and how a value, a row or a fit ended.
//!
//! An error reaches the user once, as one sentence that names the file, the field, what was found and what was
//! expected. Programs that use the library read the same four as fields. Exit codes belong to the command line.

#![warn(missing_docs)]

mod quotation;
mod toml_kind;

pub use quotation::short;
use std::fmt::Display;
use std::path::Path;
pub use toml_kind::TomlKind;

/// What went wrong, said once. Its [`Display`] is the whole sentence for the user.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An input that cannot be read or does not say what it should.
    #[error("{}{fault}", place(file, *line, field.as_deref()))]
    Input {
        /// The file's path, or what stands for it (`standard input`).
        file: String,
        /// Line of the file, counted from 1, where it is known.
        line: Option<u32>,
        /// The field, column or table of the file, where one is to blame.
        field: Option<String>,
        /// What is wrong with it.
        fault: Fault,
    },
    /// An argument of the command line, or an option of a function, that cannot be used.
    #[error("{}: {fault}", short(name))]
    Argument {
        /// The argument as the user writes it, such as `--g`.
        name: String,
        /// What is wrong with it.
        fault: Fault,
    },
    /// Arguments that do not go together, or a request that cannot be met: a free sentence.
    #[error("{}", short(.0))]
    Usage(String),
    /// An output that could not be written; nothing half-written is left behind.
    #[error("cannot write {file}: {}", short(reason))]
    Write {
        /// The file's path.
        file: String,
        /// Why it could not be written.
        reason: String,
    },
    /// A fit as a whole failed, or a check missed its threshold: a free sentence.
    #[error("{}", short(.0))]
    Missed(String),
    /// The user stopped the run; what was finished is kept.
    #[error("{0}")]
    Interrupted(String),
    /// The reader of our output went away (`mesophyll … | head`): not a failure of ours.
    #[error("the reader of standard output went away")]
    BrokenPipe,
}

/// What is wrong with a field or an argument.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Fault {
    /// It holds something else than it should.
    #[error("found {}, expected {}", short(found), short(expected))]
    Unexpected {
        /// What it holds.
        found: String,
        /// What it should hold.
        expected: String,
    },
    /// Anything else, as a free sentence.
    #[error("{}", short(.0))]
    Other(String),
}

/// A result whose error is [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

/// `file:line: field: `, as far as these are known.
fn place(file: &str, line: Option<u32>, field: Option<&str>) -> String {
    let line = line.map_or(String::new(), |line| format!(":{line}"));
    let field = field.map_or(String::new(), |field| format!("{}: ", short(field)));
    format!("{file}{line}: {field}")
}

impl Error {
    /// `path: what`, for an input file as a whole.
    pub fn input(path: &Path, what: impl Display) -> Self {
        let file = path.display().to_string();
        Error::Input { file, line: None, field: None, fault: Fault::Other(what.to_string()) }
    }

    /// `path: field: what`, for a field of an input file.
    pub fn field(path: &Path, field: &str, what: impl Display) -> Self {
        let file = path.display().to_string();
        Error::Input { file, line: None, field: Some(field.into()), fault: Fault::Other(what.to_string()) }
    }

    /// `path: field: found …, expected …`, for a field of an input file that holds something else than it should.
    pub fn unexpected(path: &Path, field: &str, found: impl Display, expected: impl Display) -> Self {
        let file = path.display().to_string();
        Error::Input { file, line: None, field: Some(field.into()), fault: Fault::unexpected(found, expected) }
    }

    /// `--name: found …, expected …`, for an argument that cannot be used.
    pub fn argument(name: &str, found: impl Display, expected: impl Display) -> Self {
        Error::Argument { name: name.into(), fault: Fault::unexpected(found, expected) }
    }

    /// `path:line: message`, for an input that is not the TOML it should be; unknown and missing fields are named, and
    /// so is the field of a value that is wrong (within its table, whose line is given).
    pub fn toml(path: &Path, text: &str, e: &toml::de::Error) -> Self {
        let before = e.span().map(|s| &text[..s.start.min(text.len())]);
        let line = before.map_or(0, |before| before.matches('\n').count() + 1);
        // A value stands behind its key on the same line, unless it is a part of a longer one.
        let key = before.and_then(|before| Some(before.rsplit('\n').next()?.split_once('=')?.0.trim()));
        let bare = |key: &&str| key.chars().all(|c| c.is_ascii_alphanumeric() || "_-.".contains(c));
        Error::Input {
            file: path.display().to_string(),
            line: u32::try_from(line).ok(),
            field: key.filter(bare).map(String::from),
            fault: Fault::Other(e.message().lines().collect::<Vec<_>>().join(" ")),
        }
    }

    /// As [`Error::toml`], for a file that should be of a kind. Where its fields are those of another, this is said.
    pub fn toml_of(kind: TomlKind, path: &Path, text: &str, e: &toml::de::Error) -> Self {
        let error = Error::toml(path, text, e);
        match (text.parse().ok().and_then(|table| TomlKind::of(&table)), error) {
            (Some(found), Error::Input { file, line, field, fault }) if found != kind => {
                let fault = Fault::Other(format!("{fault}; this is {found}, expected {kind}"));
                Error::Input { file, line, field, fault }
            }
            (_, error) => error,
        }
    }

    /// An output that could not be written.
    pub fn write(path: &Path, reason: impl Display) -> Self {
        Error::Write { file: path.display().to_string(), reason: reason.to_string() }
    }

    /// Whether what the user gave is to blame: an input or an argument.
    pub fn is_usage(&self) -> bool {
        matches!(self, Error::Input { .. } | Error::Argument { .. } | Error::Usage(_))
    }
}

impl Fault {
    /// It holds `found`, and should hold `expected`.
    pub fn unexpected(found: impl Display, expected: impl Display) -> Self {
        Fault::Unexpected { found: found.to_string(), expected: expected.to_string() }
    }
}

/// How a value, a row of a table or a fit ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Status {
    /// Right within the stated errors, each relative 1σ ≤ 10 %. Where a form prints empty errors nothing is said of
    /// them.
    Ok,
    /// The best estimate stands; the named parameters are not determined.
    Undetermined(String),
    /// No numbers; the reason names the field.
    Refused(String),
}

impl Status {
    /// Whether nothing speaks against the value and its stated errors.
    pub fn is_ok(&self) -> bool {
        *self == Status::Ok
    }

    /// That these are not determined, and why where `why` says something; ok where nothing is named. A name may carry
    /// a bound (`sigma_a >= 21`) or a reason of its own in brackets.
    pub fn undetermined<N: AsRef<str>>(names: impl IntoIterator<Item = N>, why: &str) -> Status {
        let mut what = String::new();
        for name in names {
            what.push_str(if what.is_empty() { "" } else { "; " });
            what.push_str(name.as_ref());
        }
        match (what.is_empty(), why.is_empty()) {
            (true, _) => Status::Ok,
            (false, true) => Status::Undetermined(what),
            (false, false) => Status::Undetermined(format!("{what} ({why})")),
        }
    }

    /// Whether this status names the output column `name` as not determined. Names stand between semicolons; what
    /// stands in brackets or behind a colon explains them.
    pub fn leaves_open(&self, name: &str) -> bool {
        let Status::Undetermined(what) = self else { return false };
        let (mut deep, mut names) = (0, String::new());
        for c in what.chars() {
            match c {
                '(' => deep += 1,
                ')' => deep -= 1,
                ':' if deep == 0 => break,
                _ if deep == 0 => names.push(c),
                _ => {}
            }
        }
        names.split([' ', ',', ';']).any(|word| word == name)
    }
}

impl std::fmt::Display for Status {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Status::Ok => f.write_str("ok"),
            Status::Undetermined(what) => write!(f, "undetermined: {}", short(what)),
            Status::Refused(why) => write!(f, "refused: {}", short(why)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_are_open_stand_between_semicolons() {
        let open = |s: &Status, all: [&str; 3]| all.map(|name| s.leaves_open(name));
        let two = Status::undetermined(["m", "sigma_a >= 21 and <= 26"], "a lamp; of b (and c)");
        assert_eq!(two.to_string(), "undetermined: m; sigma_a >= 21 and <= 26 (a lamp; of b (and c))");
        assert_eq!(open(&two, ["m", "sigma_a", "c"]), [true, true, false]);
        assert!(!two.leaves_open("b"));
        // A name behind another one's reason.
        let late = Status::undetermined(["zenith (a sun at 3, 4 fits as well)", "scale"], "");
        assert_eq!(open(&late, ["zenith", "scale", "sun"]), [true, true, false]);
        assert_eq!(Status::undetermined([""; 0], "a reason alone"), Status::Ok);
    }

    #[test]
    fn an_error_is_one_sentence_and_its_parts() {
        let path = Path::new("a/capture.toml");
        let said = |e: Error| e.to_string();
        assert_eq!(said(Error::input(path, "no such file")), "a/capture.toml: no such file");
        assert_eq!(said(Error::field(path, "width", "missing")), "a/capture.toml: width: missing");
        let error = Error::unexpected(path, "width", 3, "8 or more");
        assert_eq!(error.to_string(), "a/capture.toml: width: found 3, expected 8 or more");
        let Error::Input { file, line: None, field: Some(field), fault: Fault::Unexpected { found, expected } } = error
        else {
            panic!("{error:?}")
        };
        assert_eq!([file.as_str(), &field, &found, &expected], ["a/capture.toml", "width", "3", "8 or more"]);
        assert_eq!(said(Error::argument("--g", 1.5, "between -1 and 1")), "--g: found 1.5, expected between -1 and 1");
        let text = "a = 1\nb = ]\n";
        let e = toml::from_str::<toml::Table>(text).unwrap_err();
        assert!(said(Error::toml(path, text, &e)).starts_with("a/capture.toml:2: "));
        // A value of another kind is named by its key.
        type Nested = std::collections::BTreeMap<String, std::collections::BTreeMap<String, i64>>;
        let text = "a.long = 1\n  b.wide = \"x\"\n";
        let named = said(Error::toml(path, text, &toml::from_str::<Nested>(text).unwrap_err()));
        assert!(named.starts_with("a/capture.toml:2: b.wide: "), "{named}");
        let e = toml::from_str::<std::collections::BTreeMap<String, i64>>("wide = \"x\"\n").unwrap_err();
        let named = said(Error::toml(path, "wide = \"x\"\n", &e));
        assert!(named.starts_with("a/capture.toml:1: wide: "), "{named}");
        let text = "wood = 1\nhieght = 2\n";
        let e = toml::from_str::<std::collections::BTreeMap<String, String>>(text).unwrap_err();
        let other = said(Error::toml_of(TomlKind::Scene, path, text, &e));
        assert!(other.ends_with("; this is the description of a plant or a meadow, expected a scene"), "{other}");
        assert_eq!(said(Error::toml_of(TomlKind::Growth, path, text, &e)), said(Error::toml(path, text, &e)));
        assert_eq!(said(Error::write(path, "the disk is full")), "cannot write a/capture.toml: the disk is full");
    }
}
