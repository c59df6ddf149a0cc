//! `mesophyll report DIR…`.

use super::{CommonArgs, destination};
use crate::cli::{Error, Result};
use mesophyll_files::table::counted;
use mesophyll_files::{claim, progress};
use mesophyll_report::{self as report, QualityLevel, ReportSource, ReportVerdict};
use std::path::{Path, PathBuf};

/// Reports how good fits are: one HTML file that needs no network, or the same rows as JSON or Markdown.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  mesophyll report fits/elm -o elm.html       how good is this fit?
  mesophyll report fits/elm out/elm2          two fits, compared
  mesophyll report out/demo --json            the same rows for a program

In the HTML file, maps and pictures zoom and pan, a slider wipes between a picture and its
reference, and the values of the maps stand under the pointer. Everything works with the keyboard
too. The file is smaller than 5 MB where it can be; what it leaves out for that, it says.

Exit code 1 where a fit or a check is \"Not good\", 0 for \"Good\" and \"Usable with care\".")]
pub struct Args {
    /// Fit folders (two or more are compared with the first), or the folder of a run
    #[arg(required = true, value_name = "DIR")]
    folders: Vec<PathBuf>,
    /// The HTML file, `-` for standard output (default: FOLDER.html beside the first folder, unless --json,
    /// --markdown or --plots is asked for)
    #[arg(short, long = "out", alias = "output", value_name = "FILE")]
    output: Option<PathBuf>,
    /// The rows as Markdown on standard output
    #[arg(long, conflicts_with = "json")]
    markdown: bool,
    /// For scans of leaves made of layers: plot the fitted σa against the absorption of the leaf's mesophyll, and write
    /// one picture for each side into this folder
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    if args.output.as_deref().is_some_and(destination::is_stdout) && (common.json || args.markdown) {
        return Err(Error::Usage(
            "-o -: standard output already holds what --json or --markdown prints; expected the name of an HTML file"
                .into(),
        ));
    }
    let sources: Vec<ReportSource> = args.folders.iter().map(ReportSource::folder).collect();
    if let Some(folder) = &args.plots {
        let files = report::layers::pictures(&sources, folder)?;
        progress::say(format!("{} in {}", counted(files.len(), "picture"), folder.display()));
    }
    let mut code = 0;
    if common.json || args.markdown {
        let report = report::rows(&sources)?;
        code = exit_code(&report.verdict);
        if common.json { super::print_json(&report)? } else { super::print(&report::markdown(&report))? }
    }
    if args.output.is_none() && (common.json || args.markdown || args.plots.is_some()) {
        return Ok(code);
    }
    let path = args.output.clone().map_or_else(|| beside(&args.folders[0]), Ok)?;
    let inputs: Vec<&Path> = args.folders.iter().map(PathBuf::as_path).collect();
    claim::file(&path, &["html"], &inputs)?;
    if path.is_dir() {
        return Err(Error::Usage(format!("{}: found a folder, expected the name of an HTML file", path.display())));
    }
    let report = destination::file(&path, |path| report::write_html(&sources, path))?;
    progress::say(format_args!("{}. {}", report.verdict.level.word(), report.verdict.sentence));
    for reason in &report.verdict.reasons {
        progress::say(format_args!("  {}", reason.text));
    }
    if !destination::is_stdout(&path) {
        progress::say(format_args!("written: {}", path.display()));
    }
    Ok(exit_code(&report.verdict))
}

/// The report's file beside a folder, and called like it: `out/elm.html` for `out/elm`.
///
/// # Errors
/// [`Error::Usage`] where a file that is no report has that name.
fn beside(folder: &Path) -> Result<PathBuf> {
    let whole = std::path::absolute(folder).map_err(|e| Error::input(folder, e))?;
    let name = whole.file_name().ok_or_else(|| Error::argument("-o", "nothing", "the name of an HTML file"))?;
    let mut name = name.to_os_string();
    name.push(".html");
    let path = if folder.file_name().is_some() { folder.with_file_name(&name) } else { whole.with_file_name(&name) };
    if path.exists() && !report::is_report(&path) {
        let why = format!("{}: found a file that is no report, expected none; name another file by -o", path.display());
        return Err(Error::Usage(why));
    }
    Ok(path)
}

/// A workflow goes on with what is good or usable with care, and stops at what is not good.
fn exit_code(verdict: &ReportVerdict) -> u8 {
    u8::from(verdict.level == QualityLevel::Bad)
}
