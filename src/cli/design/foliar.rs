//! `mesophyll design foliar`: which bands of a spectrometer tell most about the contents of leaves.

use super::{ChosenIo, DesignAnswer, ReadingSet, positive, range_of};
use crate::cli::{CommonArgs, Error, Result};
use mesophyll_base::selection::{DesignChoice, evenly};
use mesophyll_fits::design::foliar::FoliarDesign;
use mesophyll_fits::design::search;
use mesophyll_fits::plates::{CONTENTS, table};
use std::path::PathBuf;

/// Chooses bands that leave the smallest standard errors of a leaf's contents, averaged over leaves like those that the
/// coefficients were made from. What the model leaves unexplained counts, so that bands that repeat one another are
/// not taken for news.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  mesophyll fit coefficients --in SPECTRA.csv -o coefficients.csv\n  \
    mesophyll design foliar --pigments coefficients.csv --bands 8 --for chlorophyll,water")]
pub struct Args {
    /// Coefficients that `fit coefficients` wrote
    #[arg(long, value_name = "FILE.csv")]
    pigments: PathBuf,
    /// How many bands
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=500))]
    bands: u16,
    /// What it is for, by comma: chlorophyll, carotenoid, water, dry
    #[arg(
        long = "for",
        value_name = "NAME,…",
        value_delimiter = ',',
        default_value = "chlorophyll,carotenoid,water,dry"
    )]
    wanted: Vec<String>,
    /// What is read: R,T; R; or T
    #[arg(long, value_name = "R,T", value_delimiter = ',', default_value = "R,T", value_parser = ["R", "T"])]
    read: Vec<String>,
    /// Range of the instrument (nm)
    #[arg(long, value_name = "A..B", default_value = "200..4000")]
    range: String,
    /// Distance of neighbouring bands (nm); default: that over which the coefficients' misfit is alike
    #[arg(long, value_name = "NM")]
    step: Option<f64>,
    /// Standard error of a reading
    #[arg(long, value_name = "S", default_value_t = 0.005)]
    noise: f64,
    #[command(flatten)]
    io: ChosenIo,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let coefficients = table::read(&args.pigments)?;
    let name = |content: &str| content.split('_').next().unwrap_or_default().to_string();
    if let Some(wrong) = args.wanted.iter().find(|w| !CONTENTS.iter().any(|c| name(c) == **w)) {
        let all = CONTENTS.map(name).join(", ");
        return Err(Error::Usage(format!("--for: found {wrong:?}, expected {all}")));
    }
    let least = coefficients.wavelengths.windows(2).map(|w| w[1] - w[0]).fold(f64::INFINITY, f64::min);
    let step = match args.step {
        Some(step) if step >= 0.1 => positive("--step", step)?,
        Some(step) => return Err(Error::argument("--step", step, "at least 0.1 nm")),
        None => coefficients.misfit.reach.max(least).ceil(),
    };
    let range = range_of("--range", &args.range, [200.0, 4000.0])?;
    let design = FoliarDesign {
        bands: FoliarDesign::spaced(&coefficients, step, range),
        coefficients: &coefficients,
        read: ["R", "T"].map(|r| args.read.iter().any(|asked| asked == r)),
        noise: positive("--noise", args.noise)?,
        wanted: CONTENTS.map(|c| args.wanted.contains(&name(c))),
    };
    let (count, all) = (usize::from(args.bands), design.bands.len());
    if all < count {
        let [a, b] = coefficients.range();
        return Err(Error::Usage(format!(
            "--bands: found {count}, and {all} bands {step} nm apart lie within {} and the coefficients' {a} to {b} nm",
            args.range
        )));
    }
    let problem = design.problem();
    let impossible = || Error::input(&args.pigments, "these coefficients have no leaf that could be planned for");
    let judged = |set: &[usize]| problem.judge(set).ok_or_else(impossible);
    let choice = search::choose(&problem, count)?.ok_or_else(impossible)?;
    let set = |name: String, choice: &DesignChoice| ReadingSet {
        name,
        errors: choice.errors[..CONTENTS.len()].to_vec(),
        ratio: choice.ratio,
    };
    let mut answer = DesignAnswer {
        title: format!(
            "{}: {} from {}, {all} bands {step} nm apart",
            args.pigments.display(),
            args.wanted.join(", "),
            args.read.join(" and ")
        ),
        columns: CONTENTS.map(String::from).into(),
        sets: vec![
            set(format!("all {all}"), &judged(&evenly(all, all))?),
            set(format!("even {count}"), &judged(&evenly(all, count))?),
            set(format!("chosen {count}"), &choice),
        ],
        best_possible: search::best_possible(&problem, count)?,
        ..DesignAnswer::default()
    };
    let off: Vec<String> = CONTENTS
        .iter()
        .zip(coefficients.population.off)
        .filter(|(c, _)| args.wanted.contains(&name(c)))
        .map(|(c, off)| format!("{} {:.0} %", name(c), 100.0 * off))
        .collect();
    answer.notes.push(format!(
        "Whatever is read, the model itself is off in unseen species by: {}. `fit foliar` adds it to the errors.",
        off.join(", ")
    ));
    let readings = count * args.read.len();
    if readings <= 7 {
        answer.notes.push(format!(
            "warning: {readings} readings for seven numbers of a leaf: what is not read is taken from the leaves of \
             the training, and a leaf of another kind would not be seen"
        ));
    }
    answer.chosen =
        (vec!["wavelength_nm"], choice.chosen.iter().map(|k| vec![format!("{:.1}", design.bands[*k])]).collect());
    answer.give(&args.io, &[&args.pigments], common)?;
    Ok(0)
}
