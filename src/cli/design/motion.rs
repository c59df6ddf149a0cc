//! `mesophyll design motion`: how long and how often to read a branch in gusts.

use super::{ChosenIo, DesignAnswer, ReadingSet, positive};
use crate::cli::{CommonArgs, Error, Result};
use mesophyll_fits::branch::motion::design::MotionDesign;
use mesophyll_plants::mechanics::wind::resonance;
use std::f64::consts::PI;

/// Says how well resonance and damping will be known from records of some lengths and rates, and which record is the
/// shortest that knows the damping as well as asked.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  mesophyll design motion --length-mm 600 --until 0.1\n  \
    mesophyll design motion --resonance-hz 1.5 --damping-ratio 0.05 --noise 0.2 --sway-mm 8")]
pub struct Args {
    /// Resonance (Hz); default: from --length-mm
    #[arg(long, value_name = "HZ", required_unless_present = "length_mm")]
    resonance_hz: Option<f64>,
    /// Length of the branch, for the usual resonance of a branch with leaves
    #[arg(long, value_name = "MM", conflicts_with = "resonance_hz")]
    length_mm: Option<f64>,
    /// Damping over the critical one
    #[arg(long, value_name = "SHARE", default_value_t = 0.1)]
    damping_ratio: f64,
    /// Standard deviation of the tip's deflection in the wind (mm)
    #[arg(long, value_name = "MM", default_value_t = 10.0)]
    sway_mm: f64,
    /// Standard error of a reading (mm)
    #[arg(long, value_name = "MM", default_value_t = 0.5)]
    noise: f64,
    /// Mean speed of the wind (m/s) where it is measured; otherwise it is fitted, and taken as 3 here
    #[arg(long, value_name = "M_S")]
    speed: Option<f64>,
    /// Directions that are read
    #[arg(long, value_name = "1|2", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2))]
    channels: u8,
    /// Standard error of the damping, as a share of it
    #[arg(long, value_name = "SHARE", default_value_t = 0.1)]
    until: f64,
    #[command(flatten)]
    io: ChosenIo,
}

/// The longest record that is thought of (s).
const LONGEST: f64 = 86_400.0;

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let hz = match (args.resonance_hz, args.length_mm) {
        (Some(hz), _) => positive("--resonance-hz", hz)?,
        (None, Some(mm)) => resonance(positive("--length-mm", mm)? / 1000.0, false),
        (None, None) => return Err(Error::Usage("--resonance-hz or --length-mm: expected one of them".into())),
    };
    if !(args.damping_ratio > 1e-3 && args.damping_ratio < 1.0) {
        let found = format!("found {}, expected more than 0.001 and less than 1", args.damping_ratio);
        return Err(Error::Usage(format!("--damping-ratio: {found}")));
    }
    let design = MotionDesign {
        resonance_hz: hz,
        damping_per_s: args.damping_ratio * 4.0 * PI * hz,
        speed: positive("--speed", args.speed.unwrap_or(3.0))?,
        speed_known: args.speed.is_some(),
        sway_mm: positive("--sway-mm", args.sway_mm)?,
        noise_mm: if args.noise == 0.0 { 0.0 } else { positive("--noise", args.noise)? },
        channels: args.channels.into(),
    };
    let until = positive("--until", args.until)?;
    let mut answer = DesignAnswer {
        title: format!(
            "A branch that sways at {hz:.3} Hz with {} of the critical damping, in a wind of {} m/s",
            args.damping_ratio, design.speed
        ),
        columns: ["resonance (share)", "damping (share)"].map(String::from).into(),
        ..DesignAnswer::default()
    };
    let rates = [4.0, 6.0, 10.0, 20.0].map(|times| times * hz);
    let long = design.errors(3600.0, rates[3]);
    let ratio = |e: [f64; 2]| ((e[0] / long[0]).powi(2) + (e[1] / long[1]).powi(2)).sqrt() / 2f64.sqrt();
    for rate in rates {
        for seconds in [30.0, 120.0, 600.0, 3600.0] {
            let errors = design.errors(seconds, rate);
            let name = format!("{seconds} s at {rate:.2} Hz");
            answer.sets.push(ReadingSet { name, errors: errors.to_vec(), ratio: ratio(errors) });
        }
    }
    let found: Vec<(f64, f64)> =
        rates.iter().filter_map(|rate| Some((*rate, design.shortest(*rate, until, LONGEST)?))).collect();
    answer.chosen.0 = vec!["rate_hz", "seconds", "readings"];
    answer.chosen.1 = found
        .iter()
        .map(|(rate, s)| vec![format!("{rate:.3}"), format!("{s:.0}"), format!("{:.0}", rate * s)])
        .collect();
    // Of rates that need about the same time, the one with the fewest readings.
    let least = found.iter().map(|f| f.1).fold(f64::INFINITY, f64::min);
    answer.notes.push(match found.iter().find(|f| f.1 <= 1.1 * least) {
        Some((rate, s)) => format!(
            "A record of {s:.0} s at {rate:.2} Hz knows the damping to {} of itself; more readings a second hardly \
             help, and a shorter record is not enough.",
            args.until
        ),
        None => format!(
            "No record of a day knows the damping to {} of itself: its noise hides the motion, or the wind's speed has \
             to be measured (--speed).",
            args.until
        ),
    });
    answer.notes.push(
        "The errors are those of steady gusts and of the model's spectrum; a record of fewer than about thirty swings \
         cannot show that the spectrum is another one."
            .into(),
    );
    answer.give(&args.io, &[], common)?;
    Ok(0)
}
