//! `mesophyll design gloss`: which directions a goniometer should read.

use super::{ChosenIo, DesignAnswer, ReadingSet};
use crate::cli::{CommonArgs, Error, Result, names, tables};
use mesophyll_base::selection::{DesignAim, DesignChoice, evenly};
use mesophyll_files::progress::say;
use mesophyll_files::table::InputTable;
use mesophyll_fits::design::gloss::GonioDesign;
use mesophyll_fits::design::search;
use mesophyll_fits::gloss::samples::{self, GlossFitSettings, LobeChoice};
use mesophyll_optics::gloss::LobeKind;
use std::path::PathBuf;

/// Chooses among the directions of a goniometer table those that tell most about leaves like the ones in it. The table
/// is that of `fit gloss --samples`; every leaf is fitted first. Usually the chosen directions predict all others best;
/// --for m makes the errors of the gloss's parameters smallest instead.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("design gloss"))]
pub struct Args {
    /// CSV of goniometer samples (`-`: standard input)
    #[arg(long = "in", value_name = "FILE", default_value = "-")]
    input: PathBuf,
    /// How many directions
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u16).range(4..=1000))]
    directions: u16,
    /// What it is for, by comma: predictions, or rho_s, m, tilt, tilt_y
    #[arg(long = "for", value_name = "NAME,…", value_delimiter = ',', default_value = "predictions")]
    wanted: Vec<String>,
    /// Columns of reflectance factors, by comma (default: those whose names begin with brf)
    #[arg(long, value_name = "COLUMN,…", value_delimiter = ',')]
    values: Vec<String>,
    /// Surface that the leaves are fitted with
    #[arg(long, value_parser = names::named::<LobeKind>(), default_value_t = LobeKind::Beckmann)]
    lobe: LobeKind,
    /// The readings are per cent
    #[arg(long)]
    percent: bool,
    #[command(flatten)]
    io: ChosenIo,
}

/// Parameters that may be asked for.
const NAMES: [&str; 4] = ["rho_s", "m", "tilt", "tilt_y"];

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let aim = args.aim()?;
    let settings =
        GlossFitSettings { surface: LobeChoice::Of(args.lobe), percent: args.percent, ..GlossFitSettings::default() };
    let leaves = samples::leaves(InputTable::open(&args.input)?, &args.values, &settings)?;
    let mut design = GonioDesign::of(&leaves, &settings, aim).map_err(|why| Error::input(&args.input, why))?;
    design.left_out.iter().for_each(|(name, why)| say(format!("leaf {name} is left out: {why}")));
    if aim == DesignAim::Parameters {
        for parameter in &mut design.problem.parameters {
            parameter.wanted = args.wanted.contains(&parameter.name);
        }
    }
    let (count, all) = (usize::from(args.directions), design.directions.len());
    if all <= count {
        let what = format!("{all} different directions, expected more than --directions {count}");
        return Err(Error::input(&args.input, what));
    }
    let impossible = || Error::input(&args.input, "these directions do not show what is asked for");
    let judged = |set: &[usize]| design.problem.judge(set).ok_or_else(impossible);
    let choice = search::choose(&design.problem, count)?.ok_or_else(impossible)?;
    let first = design.problem.parameters.len() - NAMES.len();
    let set = |name: String, choice: &DesignChoice| {
        let errors = choice.errors[first..].iter().zip(NAMES);
        let errors = errors.map(|(e, name)| if name.starts_with("tilt") { e.to_degrees() } else { *e }).collect();
        ReadingSet { name, errors, ratio: choice.ratio }
    };
    let mut answer = DesignAnswer {
        title: format!(
            "{}: {} of {} leaves, {all} directions",
            args.input.display(),
            args.wanted.join(", "),
            design.leaves.len()
        ),
        columns: ["rho_s", "m", "tilt_deg", "tilt_y_deg"].map(String::from).into(),
        sets: vec![
            set(format!("all {all}"), &judged(&evenly(all, all))?),
            set(format!("every {} of them", all / count), &judged(&evenly(all, count))?),
            set(format!("chosen {count}"), &choice),
        ],
        best_possible: search::best_possible(&design.problem, count)?,
        ..DesignAnswer::default()
    };
    let parameters = design.problem.parameters.len();
    let spare = (count * (parameters - NAMES.len())).saturating_sub(parameters);
    if spare < 4 {
        answer.notes.push(format!(
            "warning: {count} directions leave {spare} readings to spare, so the fit could not see that the lobe does \
             not describe a leaf"
        ));
    }
    let several = design.directions.iter().any(|d| d.source_zenith_deg.is_some());
    let header = ["source_zenith_deg", "view_zenith_deg", "view_azimuth_deg"];
    answer.chosen.0 = header[usize::from(!several)..].to_vec();
    answer.chosen.1 = choice
        .chosen
        .iter()
        .map(|k| &design.directions[*k])
        .map(|d| d.source_zenith_deg.into_iter().chain([d.view_zenith_deg, d.view_azimuth_deg]))
        .map(|angles| angles.map(|a| format!("{:.1}", a + 0.0)).collect())
        .collect();
    answer.give(&args.io, &[&args.input], common)?;
    Ok(0)
}

impl Args {
    fn aim(&self) -> Result<DesignAim> {
        if self.wanted == ["predictions"] {
            return Ok(DesignAim::Predictions);
        }
        match self.wanted.iter().find(|name| !NAMES.contains(&name.as_str())) {
            Some(wrong) => {
                let expected = format!("predictions alone, or some of {}", NAMES.join(", "));
                Err(Error::Usage(format!("--for: found {wrong:?}, expected {expected}")))
            }
            None => Ok(DesignAim::Parameters),
        }
    }
}
