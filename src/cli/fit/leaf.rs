//! `mesophyll fit leaf CAPTURE -o DIR`, for scans under a tube, captures under a dome, and photographs.

use super::gloss::LobeArgs;
use crate::cli::names::named;
use crate::cli::{CommonArgs, destination, print, print_json};
use crate::cli::{Error, Result};
use mesophyll_capture::kind::CaptureKind;
use mesophyll_fits::dome;
use mesophyll_fits::leaf::held_out::HoldOutRule;
use mesophyll_fits::leaf::texels::FitShard;
use mesophyll_fits::leaf::{LeafFitMethod, Options, run as fit};
use mesophyll_fits::photo;
use mesophyll_fits::record::FitRecord;
use mesophyll_fits::record::maker::FitOutcome;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  mesophyll fit leaf scan/elm -o out/elm
  mesophyll fit leaf scan/elm -o out/elm --method paper       the reduction as Wang et al. 2005 print it
  mesophyll fit leaf scan/elm -o out/elm --shard 1/4          one of four processes; then --merge
  mesophyll fit leaf dome/elm -o out/elm --gloss 1.4,0.3      a capture under a dome
  mesophyll fit leaf photo/elm -o out/elm                     photographs; docs/photo.md says how to take them

A run that was stopped goes on where it was when the same command is given again. Where DIR holds a fit of fewer \
frames of the same scan, texels start from it. Exit code 1 where the fit as a whole is not good, by the rules of \
`mesophyll report`; it is written all the same.")]
pub struct Args {
    /// Folder with capture.toml
    capture: PathBuf,
    /// Folder to write the fit to
    #[arg(short, long = "out", alias = "output", value_name = "DIR", value_parser = destination::folder())]
    output: PathBuf,
    /// How ρd and ρt become σa, σs, δ and γ
    #[arg(long, value_parser = named::<LeafFitMethod>(), default_value_t = LeafFitMethod::Exact)]
    method: LeafFitMethod,
    #[command(flatten)]
    lobe: LobeArgs,
    /// Give all texels full weight, however badly they fit
    #[arg(long)]
    no_robust: bool,
    /// Leave one frame of every N out of the fit and judge the fit by it; 0 leaves none out [default: 20]
    #[arg(long, value_name = "N", value_parser = parse_hold_out)]
    hold_out: Option<usize>,
    /// Seed that draws the frames that are left out [default: 1]
    #[arg(long, value_name = "SEED")]
    hold_out_seed: Option<u64>,
    /// Fit only the I-th of N parts of the texels (1-based), for several processes or machines
    #[arg(long, value_name = "I/N", value_parser = parse_shard)]
    shard: Option<FitShard>,
    /// Put the parts of all shards together
    #[arg(long, conflicts_with = "shard")]
    merge: bool,
    /// Dome captures only: effective refractive index and slope m of the gloss, which a dome does not show (index 1.2
    /// to 1.7, slope 0.078 to 0.5 for leaves)
    #[arg(long, value_name = "N,M", value_delimiter = ',')]
    gloss: Option<Vec<f64>>,
    /// Go on where a stopped run was; the same command does that without being told
    #[arg(long, conflicts_with = "force")]
    resume: bool,
    /// Fit again although the folder already holds this very fit
    #[arg(long)]
    force: bool,
}

fn parse_shard(text: &str) -> std::result::Result<FitShard, String> {
    let parsed = text.split_once('/').and_then(|(i, n)| Some((i.parse::<usize>().ok()?, n.parse::<usize>().ok()?)));
    match parsed {
        Some((i, n)) if i >= 1 && i <= n => Ok(FitShard { index: i - 1, count: n }),
        _ => Err("expected I/N with 1 ≤ I ≤ N, such as 2/4".into()),
    }
}

/// At most every second frame may be left out: a fit needs most of what was measured.
fn parse_hold_out(text: &str) -> std::result::Result<usize, String> {
    text.parse()
        .ok()
        .filter(|n| *n == 0 || (2..=10_000).contains(n))
        .ok_or_else(|| "expected 0 (none) or 2 to 10000".into())
}

/// Refuses the options of scans under a tube: `what` has no tube, so shards, lobes and the paper's reduction do not
/// apply.
fn without_tube(args: &Args, what: &str) -> Result<()> {
    let held_out = args.hold_out.is_some() || args.hold_out_seed.is_some();
    if args.shard.is_some() || args.merge || args.no_robust || held_out || matches!(args.method, LeafFitMethod::Paper) {
        return Err(Error::Usage(format!(
            "{}: {what} no traces to fit and no frames to leave out; --shard, --merge, --no-robust, --hold-out and \
             --method paper are for scans under a tube",
            args.capture.display()
        )));
    }
    Ok(())
}

fn from_photographs(args: &Args) -> Result<FitOutcome> {
    without_tube(args, "photographs have")?;
    if args.gloss.is_some() {
        return Err(Error::Usage(
            "--gloss is for captures under a dome; [gloss] in capture.toml is for photographs".into(),
        ));
    }
    photo::run(&args.capture, &args.output, args.force)
}

fn from_dome(args: &Args) -> Result<FitOutcome> {
    without_tube(args, "a capture under a dome has")?;
    let gloss = match args.gloss.as_deref() {
        None => None,
        Some([n, m]) if (1.0..=3.0).contains(n) && *m > 0.0 && *m <= 1.0 => Some([*n, *m]),
        Some(other) => {
            return Err(Error::Usage(format!(
                "--gloss: found {other:?}, expected an index of 1 to 3 and a slope above 0 and at most 1"
            )));
        }
    };
    dome::run(&args.capture, &args.output, &dome::Options { gloss, force: args.force })
}

fn from_tube(args: &Args) -> Result<FitOutcome> {
    if args.gloss.is_some() {
        return Err(Error::Usage("--gloss is for captures under a dome; a scan under a tube shows its gloss".into()));
    }
    let options = Options {
        method: args.method,
        lobe: args.lobe.lobe()?,
        robust: !args.no_robust,
        hold_out: HoldOutRule {
            every: args.hold_out.unwrap_or(HoldOutRule::default().every),
            seed: args.hold_out_seed.unwrap_or(HoldOutRule::default().seed),
        },
        shard: args.shard,
        merge: args.merge,
        force: args.force,
    };
    fit(&args.capture, &args.output, &options)
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let outcome = match CaptureKind::of(&args.capture) {
        Ok(Some(CaptureKind::Dome)) => from_dome(args)?,
        Ok(Some(CaptureKind::Photo)) => from_photographs(args)?,
        _ => from_tube(args)?,
    };
    let Some(record) = super::ended(outcome, &args.output) else { return Ok(0) };
    if common.json {
        print_json(&*record)?
    } else {
        print(&summary(&record))?
    }
    super::judged(&args.output)
}

/// A table for people: counts, shared parameters, and what is undetermined.
fn summary(record: &FitRecord) -> String {
    let mut text = String::new();
    for name in ["thickness", "gloss", "normal", "scale"] {
        if let Some(said) =
            record.options.get(name).filter(|_| record.options.get("capture_kind").is_some_and(|k| k == "photo"))
        {
            text += &format!("{} {name}: {said}\n", record.name);
        }
    }
    for (name, section) in &record.sections {
        if section.params.is_empty() {
            continue;
        }
        let count = |k: &str| section.counts.get(k).copied().unwrap_or(0);
        let leaf = count("texels") - count("outside");
        text += &format!("{} {name}: {} of {leaf} texels good", record.name, count("good"));
        for defect in record.defects.values() {
            if count(defect) > 0 {
                text += &format!(", {} {defect}", count(defect));
            }
        }
        text.push('\n');
        for (parameter, p) in &section.params {
            let values: Vec<String> = p.value.iter().zip(&p.stderr).map(|(v, e)| plus_minus(*v, *e)).collect();
            let line = format!("  {parameter:<10} {} {}", values.join("   "), p.unit);
            text += line.trim_end();
            text.push('\n');
            for u in &p.undetermined {
                text += &format!("  undetermined: {u}\n");
            }
        }
        for (what, r) in &section.residuals {
            text += &format!("  {what}: reduced chi2 {:.3}\n", r.reduced_chi2);
        }
        for (pass, held) in &section.held_out {
            let (n, chi2, expected, off) = (held.frames.len(), held.reduced_chi2, held.expected, held.off());
            text += &format!(
                "  {n} held-out frames of pass {pass}: reduced chi2 {chi2:.3}, {expected:.3} expected; off by {off:.2} \
                 of the noise\n"
            );
        }
    }
    text
}

fn plus_minus(value: f64, error: f64) -> String {
    if error.is_nan() {
        format!("{value:.4} (no error stated)")
    } else if error.is_finite() {
        format!("{value:.4} ± {error:.1e}")
    } else {
        format!("{value:.4} ± unknown")
    }
}
