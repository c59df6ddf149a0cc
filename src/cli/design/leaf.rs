//! `mesophyll design leaf`: where the tube of a leaf scan should stand.

use super::{ChosenIo, DesignAnswer, ReadingSet, names, positive, range_of};
use crate::cli::fit::gloss::LobeArgs;
use crate::cli::{CommonArgs, Error, Result};
use mesophyll_base::selection::{DesignChoice, DesignProblem};
use mesophyll_fits::design::leaf::{TexelRange, TubeDesignOptions, of_capture, of_specification};
use mesophyll_fits::design::search;
use mesophyll_fits::design::tube::{TexelQuantity, TubeDesign};
use mesophyll_optics::gloss::LobeKind;
use mesophyll_optics::tube::Travel;
use std::path::PathBuf;
use strum::IntoEnumIterator;

/// Chooses the places of the tube that leave the smallest standard errors of ρd, ρs, m and the normal, averaged over
/// the texels of a leaf: one that a specification describes, or one that has been scanned. Prints the errors of the
/// chosen frames beside those of as many even ones and of all, and what no choice can beat.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  mesophyll design leaf data/leaves/elm.toml --frames 25 -o positions.csv\n  \
    mesophyll design leaf data/leaves/elm.toml --for rho_s,m --range m=0.1..0.3\n  \
    mesophyll design leaf out/demo/scan --next 4 --until 0.05\n\n\
    docs/designs.md says how a scan follows a design.")]
pub struct Args {
    /// Leaf specification, or the folder of a capture
    #[arg(value_name = "SPEC.toml|CAPTURE")]
    leaf: PathBuf,
    /// Frames of both passes together
    #[arg(long, value_name = "N", default_value_t = 25, value_parser = clap::value_parser!(u16).range(8..=2000))]
    frames: u16,
    /// A capture's frames stay, and N more are chosen beside them, in place of --frames
    #[arg(long, value_name = "N", conflicts_with = "frames", value_parser = clap::value_parser!(u16).range(1..=1000))]
    next: Option<u16>,
    /// With --next: the scan is complete where the standard errors are below this share of the value (of the normal:
    /// of a radian) in the median texel; then nothing is chosen
    #[arg(long, value_name = "SHARE", requires = "next")]
    until: Option<f64>,
    /// What it is for, by comma: rho_d, rho_s, m, normal
    #[arg(long = "for", value_name = "NAME,…", value_delimiter = ',', default_value = "rho_d,rho_s,m,normal")]
    wanted: Vec<String>,
    /// Places a pass that are looked at [default: a capture's own frames; 100 for a specification or with --next]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(8..=10_000))]
    candidates: Option<u16>,
    /// Passes that may be made, by comma [default: all that there are]
    #[arg(long, value_name = "x,y", value_delimiter = ',', value_parser = ["x", "y"])]
    passes: Vec<String>,
    /// Values in place of the leaf's own: m=0.1..0.3, rho_s=0.02..0.08, or the tilt in degrees normal=-20..20. The
    /// option can be repeated
    #[arg(long, value_name = "NAME=A..B", allow_hyphen_values = true)]
    range: Vec<String>,
    /// Relative noise of a reading, for a specification
    #[arg(long, value_name = "S", default_value_t = 0.01)]
    noise: f64,
    /// Angles of the camera (degrees) to compare, by comma
    #[arg(long, value_name = "DEG,…", value_delimiter = ',', allow_hyphen_values = true)]
    cameras: Vec<f64>,
    /// Exposures to compare, over the device's own, by comma; readings twice as long have half the floor of noise
    #[arg(long, value_name = "TIMES,…", value_delimiter = ',')]
    exposures: Vec<f64>,
    #[command(flatten)]
    lobe: LobeArgs,
    #[command(flatten)]
    io: ChosenIo,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let options = args.options()?;
    let scanned = args.leaf.is_dir();
    if args.next.is_some() && !scanned {
        let found = format!("found {}, expected the folder of a capture whose frames stay", args.leaf.display());
        return Err(Error::Usage(format!("--next: {found}")));
    }
    let planned = |options: &TubeDesignOptions| match scanned {
        true => of_capture(&args.leaf, options, args.next.is_some()),
        false => of_specification(&args.leaf, options),
    };
    let design = planned(&options)?;
    let problem = design.problem();
    let all: Vec<usize> = (0..design.places.len()).collect();
    let mut answer = DesignAnswer {
        title: args.title(&design),
        columns: ["rho_d", "rho_s", "m", "normal_deg"].map(String::from).into(),
        chosen: (vec!["pass", "position_mm"], Vec::new()),
        ..DesignAnswer::default()
    };
    let judged = |set: &[usize]| problem.judge(set).ok_or_else(|| args.impossible());
    answer.sets.push(row(&design, "all", &judged(&all)?));
    let count = args.next.map_or(usize::from(args.frames), |n| design.taken.len() + usize::from(n));
    if args.next.is_some() {
        let now = judged(&design.taken)?;
        answer.sets.push(row(&design, "the frames that are there", &now));
        if let Some(until) = args.until
            && worst(&problem, &now) <= until
        {
            answer.notes.push(format!("The errors asked for ({until}) are reached: no further frame is needed."));
            answer.give(&args.io, &[&args.leaf], common)?;
            return Ok(0);
        }
    } else {
        answer.sets.push(row(&design, "even", &judged(&design.evenly(count))?));
    }
    let choice = design.choose(&problem, count)?.ok_or_else(|| args.impossible())?;
    answer.sets.push(row(&design, "chosen", &choice));
    answer.best_possible = search::best_possible(&problem, choice.chosen.len())?;
    for (camera_deg, exposure, name) in args.others() {
        let other = planned(&TubeDesignOptions { camera_deg, exposure, ..options.clone() })?;
        let found = other.problem();
        if let Some(choice) = other.choose(&found, count)? {
            let share = error_ratio(&problem, &choice, &problem.judge(&all).ok_or_else(|| args.impossible())?);
            answer.sets.push(ReadingSet { ratio: share, ..row(&other, &name, &choice) });
        }
    }
    answer.notes.extend(lack_of_fit(&design, &choice, args.lobe.lobe()?.into()));
    let new = choice.chosen.iter().filter(|k| !design.taken.contains(k));
    answer.chosen.1 = new
        .map(|k| &design.places[*k])
        .map(|p| vec![p.pass.name().to_string(), format!("{:.3}", p.position_mm)])
        .collect();
    answer.give(&args.io, &[&args.leaf], common)?;
    Ok(0)
}

/// Median over the wanted parameters' errors of one choice over those of another.
fn error_ratio(problem: &DesignProblem, choice: &DesignChoice, all: &DesignChoice) -> f64 {
    let wanted = (0..problem.parameters.len()).filter(|k| problem.parameters[*k].wanted);
    let squares: Vec<f64> = wanted.map(|k| (choice.errors[k] / all.errors[k]).powi(2)).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// The largest wanted error as a share of the median value; of the normal in radians.
fn worst(problem: &DesignProblem, choice: &DesignChoice) -> f64 {
    let value = |k: usize| {
        let all = problem.situations.iter().map(|s| s.values[k].abs());
        mesophyll_base::statistics::median_of(all).unwrap_or(f64::NAN)
    };
    let wanted = (0..problem.parameters.len()).filter(|k| problem.parameters[*k].wanted);
    let share = |k: usize| if k < 7 { choice.errors[k] / value(k) } else { choice.errors[k] };
    wanted.map(share).fold(0.0, f64::max)
}

fn row(design: &TubeDesign, name: &str, choice: &DesignChoice) -> ReadingSet {
    let count = |pass| design.of(&choice.chosen, pass).len();
    let name = format!("{name}: {} in x, {} in y", count(Travel::X), count(Travel::Y));
    ReadingSet { name, errors: design.errors(choice).0.to_vec(), ratio: choice.ratio }
}

/// Whether the chosen frames would show that the leaf has another lobe than the one that is taken for granted.
fn lack_of_fit(design: &TubeDesign, choice: &DesignChoice, own: LobeKind) -> Vec<String> {
    /// A misfit of so many standard deviations of χ² is found by the fit.
    const SEEN: f64 = 4.0;
    let Some(other) = LobeKind::iter().find(|kind| *kind != own && kind.has_index() == own.has_index()) else {
        return Vec::new();
    };
    let Some(sigma) = design.lack_of_fit(&choice.chosen, other) else { return Vec::new() };
    let what = format!("a leaf with a {other} lobe in place of {own} changes chi2 by {sigma:.1} standard deviations");
    vec![if sigma >= SEEN {
        format!("Lack of fit: {what} in the median texel, so the fit would say so.")
    } else {
        format!(
            "warning: the design rests on the lobe. With these frames {what} in the median texel, and the fit would \
             not see it; take more frames, or some evenly spaced ones"
        )
    }]
}

impl Args {
    fn options(&self) -> Result<TubeDesignOptions> {
        let wanted: Vec<TexelQuantity> = names("--for", &self.wanted)?;
        if let Some(wrong) = self.exposures.iter().find(|e| !(1e-3..=1e3).contains(*e)) {
            return Err(Error::Usage(format!("--exposures: found {wrong}, expected 0.001 to 1000")));
        }
        if let Some(wrong) = self.cameras.iter().find(|c| !(-85.0..=85.0).contains(*c)) {
            return Err(Error::Usage(format!("--cameras: found {wrong}, expected -85 to 85 degrees")));
        }
        if !self.passes.is_empty() && !self.passes.iter().any(|name| name == Travel::X.name()) {
            return Err(Error::Usage("--passes: found y alone, expected x, or x,y: a capture has a pass x".into()));
        }
        let passes =
            [Travel::X, Travel::Y].into_iter().filter(|t| self.passes.iter().any(|name| name == t.name())).collect();
        Ok(TubeDesignOptions {
            lobe: self.lobe.lobe()?,
            candidates: self.candidates.map(usize::from),
            passes,
            noise: positive("--noise", self.noise)?,
            ranges: self.range.iter().map(|text| range(text)).collect::<Result<_>>()?,
            ..TubeDesignOptions::of(wanted)
        })
    }

    fn title(&self, design: &TubeDesign) -> String {
        let wanted = design.wanted.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        format!(
            "{}: {wanted} of {} texels, {} places of the tube",
            self.leaf.display(),
            design.texels.len(),
            design.places.len()
        )
    }

    /// Cameras and exposures that are compared: each camera at the device's exposure, and the other way round.
    fn others(&self) -> Vec<(Option<f64>, f64, String)> {
        let cameras = self.cameras.iter().map(|c| (Some(*c), 1.0, format!("camera at {c} degrees")));
        let exposures = self.exposures.iter().map(|e| (None, *e, format!("{e} times the exposure")));
        cameras.chain(exposures).collect()
    }

    fn impossible(&self) -> Error {
        let what = "these places of the tube do not show what is asked for: the numbers of a design are not finite, \
                    or too unlike for double precision";
        Error::Missed(format!("{}: {what}", self.leaf.display()))
    }
}

/// `m=0.1..0.3`.
fn range(text: &str) -> Result<TexelRange> {
    let wrong = || Error::Usage(format!("--range: found {text:?}, expected a range such as m=0.1..0.3"));
    let (name, values) = text.split_once('=').ok_or_else(wrong)?;
    let quantity = names("--range", &[name.to_string()])?[0];
    let within = match quantity {
        TexelQuantity::RhoD => [1e-4, 1.0],
        TexelQuantity::RhoS => [1e-4, 1.0],
        TexelQuantity::M => mesophyll_fits::gloss::M_RANGE,
        TexelQuantity::Normal => [-60.0, 60.0],
    };
    Ok(TexelRange { quantity, range: range_of("--range", values, within)? })
}
