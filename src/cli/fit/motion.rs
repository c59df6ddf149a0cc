//! `mesophyll fit motion`: resonance, damping and gain from measured deflections over time.

use crate::cli::names::named;
use crate::cli::{CommonArgs, tables};
use crate::cli::{Error, Result};
use mesophyll_base::error::Status;
use mesophyll_files::progress::say;
use mesophyll_files::table::{BatchIo, InputTable, TableSink, push_number, push_text};
use mesophyll_fits::branch::motion::{self, MotionEstimate, MotionFit, MotionKind, MotionPrior};

/// CSV columns `time_s,u_mm` and optionally `v_mm` (deflections of a branch's tip, read at a steady rate, in one
/// direction or in two) → one row: resonance and damping with standard errors, of a branch in gusts (with its gain, by
/// Whittle's likelihood) or of one that was pulled and let go (by least squares). Gaps and wild readings are left out,
/// drift is taken out, and the row says so.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("fit motion"))]
pub struct Args {
    #[command(flatten)]
    io: BatchIo,
    /// What the record shows
    #[arg(long, value_parser = named::<MotionKind>(), default_value_t = MotionKind::Auto)]
    kind: MotionKind,
    /// How often the branch was read (Hz); the times then only say which readings are missing. Default: from the times
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Mean speed of the wind (m/s); default: it is fitted
    #[arg(long, value_name = "M_S")]
    speed: Option<f64>,
    /// Standard deviation of the wind's speed over its mean; with --speed it turns the gain into mm per m/s
    #[arg(long, value_name = "SHARE", requires = "speed")]
    turbulence: Option<f64>,
    /// Standard error of a reading (mm), besides its rounding
    #[arg(long, value_name = "MM", default_value_t = 0.0)]
    noise: f64,
    /// Lowest frequency that is used (Hz); default: all but the mean and drift
    #[arg(long, value_name = "HZ")]
    lowest: Option<f64>,
    /// Highest frequency that is used (Hz), above which no resonance lies; default: twice the resonance
    #[arg(long, value_name = "HZ")]
    highest: Option<f64>,
}

const COLUMNS: [&str; 21] = [
    "resonance_hz",
    "damping_per_s",
    "damping_ratio",
    "gain_u_mm_per_sqrt_hz",
    "gain_v_mm_per_sqrt_hz",
    "gain_u_mm_per_m_s",
    "gain_v_mm_per_m_s",
    "wind_s_per_m",
    "resonance_hz_err",
    "damping_per_s_err",
    "damping_ratio_err",
    "gain_u_mm_per_sqrt_hz_err",
    "gain_v_mm_per_sqrt_hz_err",
    "gain_u_mm_per_m_s_err",
    "gain_v_mm_per_m_s_err",
    "wind_s_per_m_err",
    "deviance",
    "frequencies",
    "kind",
    "taken_out",
    "status",
];

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let positive = |name: &str, value: Option<f64>, least: bool| match value {
        Some(v) if !(v.is_finite() && (v > 0.0 || (least && v == 0.0))) => {
            Err(Error::argument(name, v, if least { "0 or more" } else { "a number above 0" }))
        }
        _ => Ok(()),
    };
    positive("--speed", args.speed, false)?;
    positive("--turbulence", args.turbulence, false)?;
    positive("--noise", Some(args.noise), true)?;
    positive("--lowest", args.lowest, true)?;
    positive("--highest", args.highest, false)?;
    positive("--rate", args.rate, false)?;
    let reading = motion::reader::read(InputTable::open(&args.io.input)?, args.rate)?;
    let record = reading.record;
    let known = MotionPrior {
        kind: args.kind,
        speed: args.speed,
        turbulence: args.turbulence,
        noise: args.noise,
        band: [args.lowest, args.highest],
    };
    let mut sink = TableSink::open(&args.io.rows(common.json), &args.io.input)?;
    let found = motion::fit(&record, &known);
    sink.write_all(format!("{}\n", COLUMNS.join(",")).as_bytes())?;
    let (cells, kind, mut taken_out, status) = match &found {
        Ok(motion) => (cells(motion, &known), motion.kind.to_string(), motion.taken_out.clone(), motion.status.clone()),
        Err(why) => (vec![f64::NAN; COLUMNS.len() - 3], String::new(), Vec::new(), Status::Refused(why.clone())),
    };
    taken_out.splice(0..0, reading.notes);
    let mut line = Vec::new();
    for cell in cells {
        push_number(&mut line, cell);
        line.push(b',');
    }
    for text in [kind, taken_out.join("; ")] {
        push_text(&mut line, &text);
        line.push(b',');
    }
    push_text(&mut line, &status.to_string());
    line.push(b'\n');
    sink.write_all(&line)?;
    sink.finish()?;
    let readings = record.lines.iter().filter(|l| **l > 0).count();
    let taken = found.as_ref().map_or(String::new(), |m| format!(", taken for {}", said(m)));
    say(format!("{readings} readings, {} s apart{taken}: {status}", record.step));
    if !taken_out.is_empty() {
        say(format!("taken out: {}", taken_out.join("; ")));
    }
    match status {
        Status::Refused(_) => Err(Error::Missed("the record was refused; the column status says why".into())),
        _ => Ok(0),
    }
}

/// What a motion was taken for, and why.
fn said(motion: &MotionFit) -> String {
    let kind = match motion.kind {
        MotionKind::FreeDecay => "a free decay",
        _ => "a motion in gusts",
    };
    format!("{kind} ({})", motion.why)
}

fn cells(m: &MotionFit, known: &MotionPrior) -> Vec<f64> {
    let none = MotionEstimate { value: f64::NAN, error: f64::NAN };
    let gain = |c: usize| m.gains.get(c).copied().unwrap_or(none);
    // The density of gusts at low frequencies is (turbulence · v)²/(1.5 v) (H9 Eq. 4.15).
    let gusts = match (known.speed, known.turbulence) {
        (Some(speed), Some(turbulence)) => (turbulence * turbulence * speed / 1.5).sqrt(),
        _ => f64::NAN,
    };
    let a_speed = |v: MotionEstimate| MotionEstimate { value: v.value / gusts, error: v.error / gusts };
    let values = [m.resonance, m.damping, m.ratio, gain(0), gain(1), a_speed(gain(0)), a_speed(gain(1)), m.slowness];
    let mut out: Vec<f64> = values.iter().map(|v| v.value).collect();
    out.extend(values.iter().map(|v| v.error));
    out.extend([m.deviance, m.bins as f64]);
    out
}
