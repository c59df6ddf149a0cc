//! `mesophyll design beam`: where on a branch to measure.

use super::{ChosenIo, DesignAnswer, ReadingSet, positive, range_of};
use crate::cli::{CommonArgs, Error, Result, names};
use mesophyll_base::selection::{DesignChoice, evenly};
use mesophyll_fits::branch::beam::design::BeamDesign;
use mesophyll_fits::branch::beam::fit::PositionReference;
use mesophyll_fits::design::search;
use mesophyll_plants::mechanics::load::Load;

/// Chooses marks on a branch that will be loaded: those that leave the smallest standard errors of its taper and of
/// load over stiffness, averaged over the tapers that it may have.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  mesophyll design beam --length-mm 400 --tip-mm 60 --taper 0.2..0.8 --marks 6 \
    --load tip")]
pub struct Args {
    /// Length of the branch
    #[arg(long, value_name = "MM")]
    length_mm: f64,
    /// How far the load will move its tip
    #[arg(long, value_name = "MM")]
    tip_mm: f64,
    /// Taper (radius at the tip over radius at the root), a value or a range
    #[arg(long, value_name = "A..B", default_value = "0.1..0.9")]
    taper: String,
    /// How many marks
    #[arg(long, value_name = "N", default_value_t = 6, value_parser = clap::value_parser!(u16).range(2..=200))]
    marks: u16,
    /// Standard error of a deflection (mm)
    #[arg(long, value_name = "MM", default_value_t = 0.5)]
    noise: f64,
    /// How the load hangs on the branch: tip, even, own-weight, or the distance of a single load from the root, up to 1
    /// as a share of the length and above 1 in mm
    #[arg(long, value_name = "LOAD", default_value_t = Load::Even)]
    load: Load,
    /// What positions are measured along
    #[arg(long, value_parser = names::named::<PositionReference>(), default_value_t = PositionReference::Branch)]
    positions: PositionReference,
    #[command(flatten)]
    io: ChosenIo,
}

/// Places on a branch that are looked at.
const CANDIDATES: usize = 50;

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let design = BeamDesign {
        length_mm: positive("--length-mm", args.length_mm)?,
        taper: range_of("--taper", &args.taper, [1e-3, 1.0])?,
        tip_mm: positive("--tip-mm", args.tip_mm)?,
        load: args.load,
        along: args.positions,
        noise_mm: positive("--noise", args.noise)?,
        candidates: CANDIDATES.max(usize::from(args.marks)),
    };
    if design.tip_mm >= 0.9 * design.length_mm {
        let expected = format!("less than 0.9 of the length, {}", 0.9 * design.length_mm);
        return Err(Error::Usage(format!("--tip-mm: found {}, expected {expected}", design.tip_mm)));
    }
    let problem = design.problem().map_err(Error::Usage)?;
    let (count, all) = (usize::from(args.marks), design.candidates);
    let impossible = || Error::Missed("these marks do not show what is asked for".into());
    let judged = |set: &[usize]| problem.judge(set).ok_or_else(impossible);
    let choice = search::choose(&problem, count)?.ok_or_else(impossible)?;
    // Even marks stand at equal distances, the last one at the tip.
    let even: Vec<usize> = (1..=count).map(|k| (k * all).div_ceil(count) - 1).collect();
    let set =
        |name: String, choice: &DesignChoice| ReadingSet { name, errors: choice.errors.clone(), ratio: choice.ratio };
    let mut answer = DesignAnswer {
        title: format!("A branch of {} mm, taper {}, {}", args.length_mm, args.taper, args.load.words()),
        columns: ["alpha (share)", "load_over_stiffness (share)"].map(String::from).into(),
        sets: vec![
            set(format!("all {all}"), &judged(&evenly(all, all))?),
            set(format!("even {count}"), &judged(&even)?),
            set(format!("chosen {count}"), &choice),
        ],
        best_possible: search::best_possible(&problem, count)?,
        ..DesignAnswer::default()
    };
    let other = if args.load == Load::Tip { Load::Even } else { Load::Tip };
    if let Some(sigma) = design.lack_of_fit(&problem, &choice.chosen, other) {
        let what = format!("a load {} changes chi2 by at least {sigma:.1} standard deviations", other.words());
        answer.notes.push(if sigma >= 4.0 {
            format!("Lack of fit: {what}, so the fit would say so.")
        } else {
            format!(
                "warning: the design rests on the load. At these marks {what}, and the fit might not see it; state \
                 the load as it hung, or add marks between"
            )
        });
    }
    answer.chosen =
        (vec!["position_mm"], choice.chosen.iter().map(|k| vec![format!("{:.1}", design.positions()[*k])]).collect());
    answer.give(&args.io, &[], common)?;
    Ok(0)
}
