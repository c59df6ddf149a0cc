//! `mesophyll inspect CAPTURE|FILE`.

mod beams;
mod dome;
mod file;
mod photo;

use super::CommonArgs;
use crate::cli::{Error, Result};
use mesophyll_capture::inspection::{ReferenceSummary, TubeInspection, inspect};
use mesophyll_capture::kind::CaptureKind;
use std::fmt::Write;
use std::path::PathBuf;

/// Looks a capture over before anyone waits for a fit: every file, every header, a sample of the frames. Of a single
/// file it says what it is, what it holds and which command takes it.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  mesophyll inspect scans/elm-01          can this be fitted, and what follows from what is absent?
  mesophyll inspect scans/elm-01 --deep   read every sample of every frame
  mesophyll inspect leaf.sig              which instrument's form is it, what does it hold, which fit takes it?
Files of instruments: SVC and GER .sig, Spectral Evolution .sed, ASD .asd and its text, CI-710s, iad .rxt, LI-COR text,
.xlsx (docs/tables.md says what is read of them). With --json the answer for a file has the keys form, holds, unit,
wavelength_nm, wavelengths, spectra, command, reason, notes.
The exit code is 2 when the capture cannot be fitted (every problem is listed), and for a damaged or unknown file.")]
pub struct Args {
    /// The capture's folder (holds capture.toml), or a file
    #[arg(value_name = "CAPTURE|FILE")]
    capture: PathBuf,
    /// Read every sample of every frame, not only headers, last rows and a few frames
    #[arg(long)]
    deep: bool,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    if args.capture.is_file() {
        return file::run(&args.capture, common);
    }
    if !args.capture.exists() {
        return Err(Error::input(&args.capture, "no such file or folder"));
    }
    // What cannot be read at all is reported by the look at a scan.
    match CaptureKind::of(&args.capture).ok().flatten() {
        Some(CaptureKind::Dome) => return dome::run(args, common),
        Some(CaptureKind::Beams) => return beams::run(args, common),
        Some(CaptureKind::Photo) => return photo::run(args, common),
        _ => {}
    }
    let found = inspect(&args.capture, args.deep)?;
    shown(args, common, &found, text, found.problems.len())
}

/// Prints the result, in words or as JSON. The exit code says whether the capture can be fitted.
fn shown<T: serde::Serialize>(
    args: &Args,
    common: &CommonArgs,
    found: &T,
    text: impl Fn(&T) -> String,
    problems: usize,
) -> Result<u8> {
    if common.json {
        super::print_json(found)?;
    } else {
        super::print(&text(found))?;
    }
    verdict(args, problems)
}

fn verdict(args: &Args, problems: usize) -> Result<u8> {
    match problems {
        0 => Ok(0),
        1 => Err(Error::input(&args.capture, "this capture cannot be fitted: it has a problem")),
        n => Err(Error::input(&args.capture, format!("this capture cannot be fitted: it has {n} problems"))),
    }
}

fn text(f: &TubeInspection) -> String {
    let mut out = String::new();
    let mut line = |text: String| {
        let _ = writeln!(out, "{text}");
    };
    if let Some(m) = &f.manifest {
        let sides: Vec<&str> = m.sides.iter().map(|s| s.name()).collect();
        line(format!(
            "{}: {} × {} texels of {} mm, h = {} mm, {}",
            m.name,
            m.width,
            m.height,
            m.texel_mm,
            m.thickness_mm,
            sides.join(" and ")
        ));
        line(format!(
            "tube {} mm up, {} mm long, radius {} mm; camera at {}°",
            m.tube.height_mm, m.tube.length_mm, m.tube.radius_mm, m.camera_deg
        ));
    }
    for p in &f.passes {
        line(format!(
            "{:>11}  {} of {} frames, {}; {} looked at: {:.4} … {:.4}, no reading {}, negative {}{}",
            format!("{}/{}", p.side, p.pass),
            p.found,
            p.expected,
            bytes(p.bytes),
            p.sampled,
            p.min,
            p.max,
            percent(p.no_reading_share),
            percent(p.negative_share),
            p.brightest.map_or_else(String::new, |(k, v)| format!(", brightest {k:04} (mean {v:.4})"))
        ));
    }
    for r in &f.references {
        line(format!("{:>20}  {}", r.name, reference(r)));
    }
    if let Some(n) = &f.noise {
        line(format!(
            "noise seen: {:.2} % of the value and a floor of {:.1e} ({} differences)",
            100.0 * n.relative,
            n.floor,
            n.differences
        ));
    }
    if let Some(n) = f.leaf_texels {
        line(format!("leaf: {n} texels"));
    }
    if let Some(e) = &f.estimate {
        line(format!(
            "a fit will read {} in {} files, and need roughly {:.0} MiB and {} on one core",
            bytes(e.bytes),
            e.files,
            e.memory_mib,
            duration(e.seconds)
        ));
    }
    out.push_str(&said([&f.notes, &f.warnings, &f.problems]));
    out
}

/// The notes, the warnings and the problems; where there are none, it says so.
fn said(lists: [&[String]; 3]) -> String {
    let mut out = String::new();
    for (head, list) in ["Notes", "Warnings", "Problems"].into_iter().zip(lists) {
        if !list.is_empty() {
            let _ = writeln!(out, "{head}:");
            list.iter().for_each(|n| {
                let _ = writeln!(out, "  - {n}");
            });
        }
    }
    if lists[2].is_empty() {
        out.push_str("This capture can be fitted.\n");
    }
    out
}

fn reference(r: &ReferenceSummary) -> String {
    match (r.files, r.min, r.median, r.max) {
        (0, ..) => "absent".into(),
        (n, Some(min), Some(median), Some(max)) => {
            let files = if n == 1 { String::new() } else { format!("{n} files, ") };
            format!("{files}{}, {min:.4} … {max:.4}, median {median:.4}", bytes(r.bytes))
        }
        (n, ..) => format!("{n} files, {}", bytes(r.bytes)),
    }
}

fn percent(share: f64) -> String {
    if share == 0.0 { "0 %".into() } else { format!("{:.2} %", 100.0 * share) }
}

fn bytes(n: u64) -> String {
    match n as f64 {
        n if n >= 1e9 => format!("{:.2} GB", n / 1e9),
        n if n >= 1e6 => format!("{:.1} MB", n / 1e6),
        n => format!("{:.0} kB", (n / 1e3).ceil()),
    }
}

fn duration(seconds: f64) -> String {
    if seconds < 90.0 { format!("{:.0} s", seconds.max(1.0)) } else { format!("{:.0} min", seconds / 60.0) }
}
