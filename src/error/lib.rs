//! The one error a user meets: a sentence that names the file, the field, what was found and what was expected.

use std::fmt::Display;
use std::path::Path;

/// What went wrong, said once. Rooms build these with [`Error::input`], [`Error::write`] and friends;
/// `main` prints the sentence and turns it into the exit code.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// An input that cannot be read or does not say what it should. `place` names the file and, where there is one, the
    /// field.
    #[error("{place}: {what}")]
    Input { place: String, what: String },
    /// The command line asks for something that cannot be done.
    #[error("{0}")]
    Usage(String),
    /// An output that could not be written; nothing half-written is left behind.
    #[error("cannot write {place}: {what}")]
    Write { place: String, what: String },
    /// A fit as a whole failed, or a check missed its threshold.
    #[error("{0}")]
    Missed(String),
    /// The user stopped the run; what was finished is kept.
    #[error("{0}")]
    Interrupted(String),
    /// The reader of our output went away (`mesophyll … | head`): not a failure of ours.
    #[error("the reader of standard output went away")]
    BrokenPipe,
}

pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// `path: what`, for an input file.
    pub fn input(path: &Path, what: impl Display) -> Self {
        Error::Input { place: path.display().to_string(), what: what.to_string() }
    }

    /// `path: field: what`, for a field of an input file.
    pub fn field(path: &Path, field: &str, what: impl Display) -> Self {
        Error::Input { place: format!("{}: {field}", path.display()), what: what.to_string() }
    }

    /// `path:line: message`, for an input that is not the TOML it should be; unknown and missing fields are named.
    pub fn toml(path: &Path, text: &str, e: &toml::de::Error) -> Self {
        let line = e.span().map_or(0, |s| text[..s.start.min(text.len())].matches('\n').count() + 1);
        Error::Input {
            place: format!("{}:{line}", path.display()),
            what: e.message().lines().collect::<Vec<_>>().join(" "),
        }
    }

    /// An output that could not be written.
    pub fn write(path: &Path, what: impl Display) -> Self {
        Error::Write { place: path.display().to_string(), what: what.to_string() }
    }

    /// Exit code: 0 done, 1 a fit or a check missed (or could not be written), 2 usage or unreadable input, 130
    /// interrupted.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Input { .. } | Error::Usage(_) => 2,
            Error::Write { .. } | Error::Missed(_) => 1,
            Error::Interrupted(_) => 130,
            Error::BrokenPipe => 0,
        }
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
    pub fn is_ok(&self) -> bool {
        *self == Status::Ok
    }

    /// Whether this status names the output column `name` as not determined. The names stand before any explanation,
    /// which begins with a bracket or a colon.
    pub fn leaves_open(&self, name: &str) -> bool {
        let Status::Undetermined(what) = self else { return false };
        let names = what.split(['(', ':']).next().unwrap_or_default();
        names.split([' ', ',', ';']).any(|word| word == name)
    }
}

impl std::fmt::Display for Status {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Status::Ok => f.write_str("ok"),
            Status::Undetermined(what) => write!(f, "undetermined: {what}"),
            Status::Refused(why) => write!(f, "refused: {why}"),
        }
    }
}
