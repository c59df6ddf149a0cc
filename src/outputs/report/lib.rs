//! The report: how good fits are, as HTML, JSON and Markdown made from the same rows. Nothing new is computed here,
//! only summarised.

#![warn(missing_docs)]

mod captures;
mod chart;
mod colour;
mod comparison;
pub mod figure;
pub mod glossary;
mod held_out;
mod html;
pub mod layers;
mod lines;
mod maps;
mod markdown;
mod model;
mod notes;
pub mod number;
mod overall;
mod packing;
mod pictures;
mod quantity;
mod reader;
mod residuals;
mod scene;
mod size;
pub mod spectrum;
mod stats;
mod translucency;
mod values;
mod verdict;

pub use colour::COLORS;
pub use model::{QualityLevel, Report, ReportVerdict, VerdictReason};
use size::ReportDetail;
use std::path::{Path, PathBuf};

/// A folder to report: a fit (`fit.toml`), or a run with `check.json`, `plan.json` and fits below it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReportSource {
    /// The folder.
    pub folder: PathBuf,
}

impl ReportSource {
    /// A folder as a source.
    pub fn folder(folder: impl Into<PathBuf>) -> Self {
        ReportSource { folder: folder.into() }
    }

    /// Whether the folder is a fit itself (and not a run that may hold fits).
    pub(crate) fn is_fit(&self) -> bool {
        self.folder.join("fit.toml").exists()
    }
}

/// What to read and draw.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Options {
    /// Compares every further fit with the first.
    pub compare: bool,
    /// How finely pictures are drawn (HTML needs them, rows do not).
    pub pictures: Option<ReportDetail>,
    /// Heading; the fits' names when absent.
    pub title: Option<String>,
}

/// Two or more fits that are named one by one are meant to be compared; the fits of a run are not.
fn defaults(sources: &[ReportSource], pictures: Option<ReportDetail>) -> Options {
    Options { compare: sources.len() > 1 && sources.iter().all(ReportSource::is_fit), pictures, title: None }
}

/// Whether a file is a report that this program wrote.
pub fn is_report(path: &Path) -> bool {
    use std::io::Read;
    let mut head = String::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(4096).read_to_string(&mut head));
    read.is_ok() && head.contains(" · report</title>")
}

/// Writes one self-contained HTML file. Where it would be larger than 5 MB, pictures and values are shown more
/// coarsely, and the page says so.
///
/// # Errors
/// [`Error::Input`] for a folder without anything to report or with a broken `fit.toml`, `check.json` or `plan.json`;
/// [`Error::Write`].
pub fn write_html(sources: &[ReportSource], path: &Path) -> Result<Report> {
    let mut level = 0;
    let (report, page) = loop {
        let detail = &size::DETAILS[level];
        let report = reader::read(sources, &defaults(sources, Some(*detail)))?;
        let page = html::render(&report, detail)?;
        match size::next(level, page.len()) {
            Some(coarser) => level = coarser,
            None => break (report, page),
        }
    };
    mesophyll_files::atomic::write_bytes(path, page.as_bytes())?;
    Ok(report)
}

/// The verdict on the fit in `folder`: the same that a report of it says, without the report.
///
/// # Errors
/// As [`rows`].
pub fn verdict(folder: &Path) -> Result<ReportVerdict> {
    reader::verdict_of(folder)
}

/// The rows of a report.
pub fn rows(sources: &[ReportSource]) -> Result<Report> {
    reader::read(sources, &defaults(sources, None))
}

/// The rows as JSON; numbers that are not finite are `null`.
pub fn to_json(sources: &[ReportSource]) -> Result<serde_json::Value> {
    serde_json::to_value(rows(sources)?).map_err(|e| Error::Missed(format!("cannot write JSON: {e}")))
}

/// A report as Markdown.
pub fn markdown(report: &Report) -> String {
    markdown::render(report)
}

pub(crate) use mesophyll_base::error::{Error, Result};
