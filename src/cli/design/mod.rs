//! `mesophyll design …`: which readings to take, one file for each kind of measurement. The list is
//! [`crate::cli::models::MODELS`].

use super::CommonArgs;
use crate::cli::models::{ModelEntry, ModelVerb};
use crate::cli::verb_choice::{VerbCatalogue, VerbChoice};
use crate::cli::{Error, Result};
use mesophyll_files::{atomic, claim};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

pub mod beam;
pub mod foliar;
pub mod gloss;
pub mod leaf;
pub mod motion;
pub mod scene;
pub mod slab;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: VerbChoice<Designs>,
}

/// The measurements that can be planned.
#[derive(Debug, Clone)]
enum Designs {}

impl VerbCatalogue for Designs {
    fn verb(model: &ModelEntry) -> Option<ModelVerb> {
        model.design
    }
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    args.what.run(common)
}

/// Where the chosen readings go.
#[derive(Debug, Clone, clap::Args)]
pub struct ChosenIo {
    /// CSV to write the chosen readings to
    #[arg(short = 'o', long = "out", alias = "output", value_name = "FILE.csv")]
    output: Option<PathBuf>,
}

/// What a design answers: the errors of several sets of readings, and the readings that were chosen.
#[derive(Debug, Clone, Default)]
struct DesignAnswer {
    /// What was planned, in one line.
    title: String,
    /// What the errors are of.
    columns: Vec<String>,
    /// Sets of readings.
    sets: Vec<ReadingSet>,
    /// The ratio that no set as large as the chosen one can fall below.
    best_possible: Option<f64>,
    /// What the chosen readings leave undetermined, by name.
    undetermined: Vec<String>,
    /// What else has to be said, a sentence each.
    notes: Vec<String>,
    /// Columns of the chosen readings, and a row each.
    chosen: (Vec<&'static str>, Vec<Vec<String>>),
}

/// A set of readings and its errors.
#[derive(Debug, Clone)]
struct ReadingSet {
    name: String,
    errors: Vec<f64>,
    /// How many times larger the errors are than those of all readings.
    ratio: f64,
}

impl DesignAnswer {
    /// Prints the answer, and writes the chosen readings where they are asked for.
    fn give(&self, io: &ChosenIo, inputs: &[&Path], common: &CommonArgs) -> Result<()> {
        if let Some(path) = &io.output {
            claim::file(path, &["csv"], inputs)?;
            let lines = std::iter::once(self.chosen.0.join(",")).chain(self.chosen.1.iter().map(|row| row.join(",")));
            atomic::write_bytes(path, lines.map(|line| line + "\n").collect::<String>().as_bytes())?;
        }
        if common.json {
            return crate::cli::print_json(&self.json());
        }
        crate::cli::print(&self.text(io.output.is_none()))
    }

    fn json(&self) -> Value {
        let set = |set: &ReadingSet| {
            let errors: Map<String, Value> =
                self.columns.iter().zip(&set.errors).map(|(name, e)| (name.clone(), json!(e))).collect();
            json!({ "set": set.name, "errors": errors, "errors_over_all": set.ratio })
        };
        let chosen = |row: &Vec<String>| -> Value {
            let value = |text: &String| text.parse::<f64>().map_or_else(|_| json!(text), |number| json!(number));
            self.chosen
                .0
                .iter()
                .zip(row)
                .map(|(name, text)| (name.to_string(), value(text)))
                .collect::<Map<_, _>>()
                .into()
        };
        json!({
            "design": self.title,
            "sets": self.sets.iter().map(set).collect::<Vec<_>>(),
            "best_possible_over_all": self.best_possible,
            "columns": self.chosen.0,
            "chosen": self.chosen.1.iter().map(chosen).collect::<Vec<_>>(),
            "undetermined": self.undetermined,
            "notes": self.notes,
        })
    }

    fn text(&self, list: bool) -> String {
        let wide = self.sets.iter().map(|s| s.name.chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = self.columns.iter().map(|c| c.chars().count().max(9)).collect();
        let mut text = format!("{}\nStandard errors:\n{:wide$}", self.title, "");
        self.columns.iter().zip(&widths).for_each(|(name, w)| text += &format!("  {name:>w$}"));
        text += "  times the errors of all readings\n";
        for set in &self.sets {
            text += &format!("{:wide$}", set.name);
            set.errors.iter().zip(&widths).for_each(|(e, w)| text += &format!("  {:>w$}", short(*e)));
            text += &format!("  {:.2}\n", set.ratio);
        }
        if let Some(bound) = self.best_possible {
            text += &format!(
                "No choice of as many readings has less than {bound:.2} times the errors of all readings together.\n"
            );
        }
        self.notes.iter().for_each(|note| text += &format!("{note}\n"));
        if list {
            text += &format!("{}\n", self.chosen.0.join(","));
            self.chosen.1.iter().for_each(|row| text += &format!("{}\n", row.join(",")));
        }
        text
    }
}

/// A number with three significant digits.
fn short(value: f64) -> String {
    match value.abs() {
        v if !v.is_finite() => "unknown".into(),
        v if (1e-3..1e4).contains(&v) => {
            let digits = (2 - v.log10().floor() as i32).max(0) as usize;
            format!("{value:.digits$}")
        }
        _ => format!("{value:.2e}"),
    }
}

/// A list of names from an argument, each at most once.
///
/// # Errors
/// [`Error::Usage`] naming the word that is none of them.
fn names<T: std::str::FromStr + PartialEq + strum::IntoEnumIterator + std::fmt::Display>(
    argument: &str,
    words: &[String],
) -> Result<Vec<T>> {
    let mut found = Vec::new();
    for word in words {
        let one: T = word.trim().parse().map_err(|_| {
            let all = T::iter().map(|t| t.to_string()).collect::<Vec<_>>().join(", ");
            Error::Usage(format!("{argument}: found {word:?}, expected {all}"))
        })?;
        if !found.contains(&one) {
            found.push(one);
        }
    }
    Ok(found)
}

/// A number of an argument that has to be positive.
///
/// # Errors
/// [`Error::Usage`] naming the argument and what was found.
fn positive(argument: &str, value: f64) -> Result<f64> {
    if value > 0.0 && value.is_finite() {
        return Ok(value);
    }
    Err(Error::Usage(format!("{argument}: found {value}, expected a positive number")))
}

/// `A..B`, or a single value as both of its ends.
///
/// # Errors
/// [`Error::Usage`] where it is none, or leaves `within`.
fn range_of(argument: &str, text: &str, within: [f64; 2]) -> Result<[f64; 2]> {
    let (a, b) = text.split_once("..").unwrap_or((text, text));
    let range = [a, b].map(|v| v.trim().parse::<f64>().unwrap_or(f64::NAN));
    if range[0] <= range[1] && range[0] >= within[0] && range[1] <= within[1] {
        return Ok(range);
    }
    let expected = format!("expected a value or a range A..B within {} to {}", within[0], within[1]);
    Err(Error::Usage(format!("{argument}: found {text:?}, {expected}")))
}
