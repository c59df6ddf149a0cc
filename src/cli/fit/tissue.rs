//! `mesophyll fit tissue BEAMS --blade FIT -o DIR`.

use crate::cli::names::named;
use crate::cli::{CommonArgs, destination};
use crate::cli::{Error, Result};
use mesophyll_fits::record::FitRecord;
use mesophyll_fits::translucency::inverse::run::{Options, TissueFitStart, run as fit};
use mesophyll_fits::translucency::inverse::{self, BeamIncidence};
use mesophyll_fits::translucency::tissue::LightEntry;
use mesophyll_optics::translucency::convolution::TotalsSource;
use std::path::PathBuf;

/// Absorption and scattering inside a leaf, and a factor on its thickness, from photographs of the light that comes
/// through it under beams of known direction.
///
/// DIR gets fit.toml and times.toml. Scattering is found as (1 - g) sigma_s; no photograph of this kind tells g itself.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  mesophyll fit tissue scans/elm-beams --blade out/elm -o out/elm-tissue
  mesophyll fit tissue scans/elm-beams --blade out/elm -o out/elm-tissue --fix-scale     the leaf fit's thickness is \
  right
The capture (capture.toml with kind = \"beams\") is described in data/README.md; `mesophyll synth --acquisition beams` \
writes one.")]
pub struct Args {
    /// Capture of photographs under beams (kind "beams")
    #[arg(value_name = "BEAMS")]
    input: PathBuf,
    /// Folder of `fit leaf`: thickness, normals, outline, and the slab to compare with
    #[arg(long, value_name = "FIT")]
    blade: PathBuf,
    /// Folder to write
    #[arg(short, long = "out", alias = "output", value_name = "DIR", value_parser = destination::folder())]
    output: PathBuf,
    /// Take the thickness as the leaf fit has it
    #[arg(long)]
    fix_scale: bool,
    /// Mean cosine of scattering that sigma_s is stated for
    #[arg(long, value_name = "V", default_value_t = 0.0, allow_negative_numbers = true)]
    g: f64,
    /// Share of the light that crosses the surface. matched: all of it; albedo: 1 - rho_d of the texel
    #[arg(long, value_parser = named::<LightEntry>(), default_value_t = LightEntry::Matched)]
    entry: LightEntry,
    /// Total transmitted light. transport: scaled to the transport equation; form: as the diffusion formula gives it
    #[arg(long, value_parser = named::<TotalsSource>(), default_value_t = TotalsSource::Transport)]
    totals: TotalsSource,
    /// Transmission of an oblique beam. slant: from the transport equation; normal: the same as for a beam along the
    /// normal, as the renderers assume
    #[arg(long, value_parser = named::<BeamIncidence>(), default_value_t = BeamIncidence::Slant)]
    incidence: BeamIncidence,
    /// Where the search begins: the leaf fit's slab, or the sources' table
    #[arg(long, value_parser = named::<TissueFitStart>(), default_value_t = TissueFitStart::Slab)]
    start: TissueFitStart,
    /// Thickness levels K
    #[arg(long, value_name = "K", default_value_t = 8, value_parser = clap::value_parser!(u16).range(2..=64))]
    levels: u16,
    /// Leave out readings within this distance (mm) of a border of the picture at which the leaf is cut off (default:
    /// six mean thicknesses)
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    margin_mm: Option<f64>,
    /// Fit again although the folder already holds this very fit
    #[arg(long)]
    force: bool,
}

fn options(args: &Args) -> Result<Options> {
    if !(args.g.abs() < 1.0) {
        return Err(Error::Usage(format!("--g: found {}, expected between -1 and 1", args.g)));
    }
    if let Some(margin) = args.margin_mm
        && !(margin >= 0.0 && margin.is_finite())
    {
        return Err(Error::Usage(format!("--margin-mm: found {margin}, expected 0 or more")));
    }
    let totals = args.totals;
    let levels = usize::from(args.levels);
    Ok(Options {
        fit: inverse::Options {
            levels,
            totals,
            incidence: args.incidence,
            fix_scale: args.fix_scale,
            ..inverse::Options::default()
        },
        g: args.g,
        entry: args.entry,
        start: args.start,
        margin_mm: args.margin_mm,
        force: args.force,
    })
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let options = options(args)?;
    crate::cli::preparation::warn(&args.blade);
    let outcome = fit(&args.input, &args.blade, &args.output, &options)?;
    super::told(outcome, &args.output, common, summary)
}

/// A table for people.
fn summary(record: &FitRecord) -> String {
    let Some(section) = record.sections.get("all") else { return String::new() };
    let count = |k: &str| section.counts.get(k).copied().unwrap_or(0);
    let mut text = format!("{}: {} photographs, {} readings\n", record.name, count("photographs"), count("readings"));
    for (name, p) in &section.params {
        let values: Vec<String> = p.value.iter().zip(&p.stderr).map(|(v, e)| format!("{v:.4} ± {e:.1e}")).collect();
        text += &format!("  {name:<16} {} {}\n", values.join("   "), p.unit);
        p.undetermined.iter().for_each(|u| text += &format!("    undetermined: {u}\n"));
    }
    if let Some(chi2) = section.figures.get("reduced_chi2") {
        text += &format!("  reduced chi2 {chi2:.3}\n");
    }
    for (name, weak) in record.options.iter().filter(|(k, _)| k.starts_with("weak_")) {
        text += &format!("  {name}: {weak}\n");
    }
    text + &format!("  {}\n", record.options.get("comparison").map_or("", String::as_str))
}
