//! `mesophyll fit motion`: resonance, damping and gain from measured deflections over time.

use crate::{Common, tables};
use crate::{Error, Result};
use mesophyll_error::Status;
use mesophyll_files::progress::say;
use mesophyll_files::table::{BatchIo, Sink, Table, push_number, push_text};
use mesophyll_fit_branch::motion::{self, Known, Motion, Value};

/// CSV columns `time_s,u_mm` and optionally `v_mm` (deflections of a branch's tip at even times, in one direction or in
/// two) → one row: resonance, damping and gain of an oscillator in gusts, with standard errors, by Whittle's
/// likelihood.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("fit motion"))]
pub struct Args {
    #[command(flatten)]
    io: BatchIo,
    /// Mean speed of the wind (m/s); default: it is fitted
    #[arg(long, value_name = "M_S")]
    speed: Option<f64>,
    /// Standard deviation of the wind's speed over its mean; with --speed it turns the gain into mm per m/s
    #[arg(long, value_name = "SHARE", requires = "speed")]
    turbulence: Option<f64>,
    /// Standard error of a reading (mm)
    #[arg(long, value_name = "MM", default_value_t = 0.0)]
    noise: f64,
    /// Lowest frequency that is used (Hz); default: all but the mean
    #[arg(long, value_name = "HZ")]
    lowest: Option<f64>,
    /// Highest frequency that is used (Hz); default: twice the resonance
    #[arg(long, value_name = "HZ")]
    highest: Option<f64>,
}

const COLUMNS: [&str; 19] = [
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
    "status",
];

pub fn run(args: &Args, common: &Common) -> Result<u8> {
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
    let record = motion::read::read(Table::open(&args.io.input)?)?;
    let known =
        Known { speed: args.speed, turbulence: args.turbulence, noise: args.noise, band: [args.lowest, args.highest] };
    let found = motion::fit(&record, &known);
    let mut sink = Sink::open(&args.io.rows(common.json), &args.io.input)?;
    sink.write_all(format!("{}\n", COLUMNS.join(",")).as_bytes())?;
    let (cells, status) = match &found {
        Ok(motion) => (cells(motion, &known), motion.status.clone()),
        Err(why) => (vec![f64::NAN; COLUMNS.len() - 1], Status::Refused(why.clone())),
    };
    let mut line = Vec::new();
    for cell in cells {
        push_number(&mut line, cell);
        line.push(b',');
    }
    push_text(&mut line, &status.to_string());
    line.push(b'\n');
    sink.write_all(&line)?;
    sink.finish()?;
    let readings = record.channels.first().map_or(0, Vec::len);
    say(format!("{readings} readings, {} s apart: {status}", record.step));
    Ok(0)
}

fn cells(m: &Motion, known: &Known) -> Vec<f64> {
    let none = Value { value: f64::NAN, error: f64::NAN };
    let gain = |c: usize| m.gains.get(c).copied().unwrap_or(none);
    // The density of gusts at low frequencies is (turbulence · v)²/(1.5 v) (H9 Eq. 4.15).
    let gusts = match (known.speed, known.turbulence) {
        (Some(speed), Some(turbulence)) => (turbulence * turbulence * speed / 1.5).sqrt(),
        _ => f64::NAN,
    };
    let a_speed = |v: Value| Value { value: v.value / gusts, error: v.error / gusts };
    let values = [m.resonance, m.damping, m.ratio, gain(0), gain(1), a_speed(gain(0)), a_speed(gain(1)), m.slowness];
    let mut out: Vec<f64> = values.iter().map(|v| v.value).collect();
    out.extend(values.iter().map(|v| v.error));
    out.extend([m.deviance, m.bins as f64]);
    out
}
