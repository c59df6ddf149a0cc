//! `mesophyll fit translucency FIT -o DIR`.

use crate::cli::names::named;
use crate::cli::{CommonArgs, destination};
use crate::cli::{Error, Result};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use mesophyll_capture::kind::CaptureKind;
use mesophyll_files::progress::say;
use mesophyll_fits::dome;
use mesophyll_fits::record::FitRecord;
use mesophyll_fits::translucency::tissue::LightEntry;
use mesophyll_fits::translucency::{Options, TexelArea, TissueName, TissueSource, TranslucencyColour, run as fit};
use mesophyll_optics::dipole::{DipoleForm, FormKind};
use mesophyll_optics::translucency::basis::HemisphereBasis;
use mesophyll_optics::translucency::lights::DirectionRuleKind;
use std::path::PathBuf;

/// How the light that comes through a leaf depends on where it comes from, a texel at a time: scattering inside the
/// blade, shadows of its relief, its thickness.
///
/// DIR gets front.exr and back.exr (light that enters that side: coefficients on a directional basis), previews,
/// fit.toml and times.toml.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  mesophyll fit translucency out/elm -o out/elm-translucency
  mesophyll fit translucency out/elm -o out/rgb --colour three-wavelengths
  mesophyll fit translucency out/elm -o out/paper --colour product --tissue table --area texel --form dipoles \
  --dipoles 3
  mesophyll fit translucency out/elm -o out/noon --sun-elevation-deg 60 --sun-azimuth-deg 30     one light, no basis")]
pub struct Args {
    /// Folder of `fit leaf`, or a capture under a dome (its leaf fit is then kept as DIR/leaf)
    input: PathBuf,
    /// Folder to write
    #[arg(short, long = "out", alias = "output", value_name = "DIR", value_parser = destination::folder())]
    output: PathBuf,
    /// Where the colour of the light that comes through is from
    #[arg(long, value_parser = named::<TranslucencyColour>(), default_value_t = TranslucencyColour::Substituted)]
    colour: TranslucencyColour,
    /// Channel whose wavelength is used where only one is (default: the channel that transmits most light)
    #[arg(long, value_enum)]
    channel: Option<Channel>,
    /// The leaf fit's slab, or the table of the sources (510 nm: sigma_a 0.4, sigma_s 10.2, g 0.07)
    #[arg(long, value_parser = named::<TissueName>(), default_value_t = TissueName::Fit,
        conflicts_with_all = ["sigma_a", "sigma_s"])]
    tissue: TissueName,
    /// Absorption (1/mm) instead
    #[arg(long, value_name = "V", requires = "sigma_s", allow_negative_numbers = true)]
    sigma_a: Option<f64>,
    /// Scattering (1/mm) instead
    #[arg(long, value_name = "V", requires = "sigma_a", allow_negative_numbers = true)]
    sigma_s: Option<f64>,
    /// Mean cosine of scattering, with --sigma-a and --sigma-s
    #[arg(long, value_name = "V", requires = "sigma_a", allow_negative_numbers = true)]
    g: Option<f64>,
    /// Light that enters: all of it, or 1 - rho_d of the texel (default: all with the fit's slab, else 1 - rho_d)
    #[arg(long, value_parser = named::<LightEntry>())]
    entry: Option<LightEntry>,
    /// Area over which a texel collects light. facet: the inclined surface itself; texel: its projection, as in the
    /// sources
    #[arg(long, value_parser = named::<TexelArea>(), default_value_t = TexelArea::Facet)]
    area: TexelArea,
    /// Boundary term A = (1 + rho)/(1 - rho), at least 1 (default: 1 where all light enters, else from the mean rho_d)
    #[arg(long, value_name = "A", allow_negative_numbers = true)]
    a: Option<f64>,
    /// Kernel: thin is right for every thickness, images and dipoles for blades thicker than a mean free path
    #[arg(long, value_parser = named::<FormKind>(), default_value_t = FormKind::Thin)]
    form: FormKind,
    /// With --form dipoles: pairs j = -N to N [default: 3]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1000))]
    dipoles: Option<u32>,
    /// Thickness levels K
    #[arg(long, value_name = "K", default_value_t = 8, value_parser = clap::value_parser!(u16).range(2..=64))]
    levels: u16,
    /// Light directions over the hemisphere
    #[arg(long, value_name = "N", default_value_t = 128, value_parser = clap::value_parser!(u32).range(8..=100_000))]
    lights: u32,
    /// Placement of the light directions. spiral: on a spiral; stratified: one at random in each of N equal cells, as
    /// in the sources
    #[arg(long, value_parser = named::<DirectionRuleKind>(), default_value_t = DirectionRuleKind::Spiral)]
    placed: DirectionRuleKind,
    /// Functions of direction, with their number; the renderers evaluate half-life-2 and bent-3
    #[arg(long, value_parser = basis(), default_value = "half-life-2")]
    basis: HemisphereBasis,
    /// One light at this elevation over the blade, instead of a basis
    #[arg(
        long,
        value_name = "DEG",
        requires = "sun_azimuth_deg",
        conflicts_with = "basis",
        allow_negative_numbers = true
    )]
    sun_elevation_deg: Option<f64>,
    /// Its azimuth in the lit side's image, from right to up
    #[arg(long, value_name = "DEG", requires = "sun_elevation_deg", allow_negative_numbers = true)]
    sun_azimuth_deg: Option<f64>,
    /// Compute again although the folder already holds this very fit
    #[arg(long)]
    force: bool,
}

/// Reads one of the bases that are offered. Former versions named some of them without their number, which is still
/// understood.
fn basis() -> impl TypedValueParser<Value = HemisphereBasis> {
    let former = |basis: HemisphereBasis| match basis {
        HemisphereBasis::HalfLife2 | HemisphereBasis::Bent { .. } => None,
        other => other.name().rsplit_once('-').map(|(kind, _)| kind.to_string()),
    };
    let shown = HemisphereBasis::OFFERED
        .map(|basis| PossibleValue::new(basis.name()).help(basis.describe()).aliases(former(basis)));
    PossibleValuesParser::new(shown).try_map(move |name| {
        let mut all = HemisphereBasis::OFFERED.into_iter();
        all.find(|b| b.name() == name || former(*b).as_ref() == Some(&name)).ok_or("not the name of a basis")
    })
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Channel {
    R,
    G,
    B,
}

/// A number in a range, or a sentence that names the option.
fn within(name: &str, v: f64, low: f64, high: f64) -> Result<f64> {
    if v >= low && v <= high {
        return Ok(v);
    }
    let range = if high.is_infinite() { format!("at least {low}") } else { format!("{low} to {high}") };
    Err(Error::Usage(format!("--{name}: found {v}, expected {range}")))
}

fn options(args: &Args) -> Result<Options> {
    let tissue = match (args.sigma_a, args.sigma_s) {
        (Some(a), Some(s)) => TissueSource::Given {
            sigma_a: within("sigma-a", a, 0.0, 1e6)?,
            sigma_s: within("sigma-s", s, 0.0, 1e6)?,
            g: within("g", args.g.unwrap_or(0.0), -0.999, 0.999)?,
        },
        _ => TissueSource::Named(args.tissue),
    };
    let sun = match (args.sun_elevation_deg, args.sun_azimuth_deg) {
        (Some(e), Some(a)) => Some([
            within("sun-elevation-deg", e, 0.0, 90.0)?.to_radians(),
            within("sun-azimuth-deg", a, -360.0, 360.0)?.to_radians(),
        ]),
        _ => None,
    };
    if args.dipoles.is_some() && !matches!(args.form, FormKind::Dipoles) {
        return Err(Error::Usage("--dipoles: found without --form dipoles, expected both or neither".into()));
    }
    Ok(Options {
        colour: args.colour,
        channel: args.channel.map(|c| c as usize),
        tissue,
        entry: args.entry,
        area: args.area,
        a: args.a.map(|a| within("a", a, 1.0, f64::INFINITY)).transpose()?,
        form: DipoleForm::of(args.form, args.dipoles.unwrap_or(3)),
        levels: usize::from(args.levels),
        lights: args.placed.rule(args.lights as usize),
        basis: args.basis,
        sun,
        force: args.force,
    })
}

/// The leaf fit that is asked for: the folder itself, or one that is made from a capture under a dome and kept as
/// `leaf` in the output.
fn leaf(args: &Args) -> Result<PathBuf> {
    if args.input.join("fit.toml").is_file() || !args.input.join("capture.toml").is_file() {
        return Ok(args.input.clone());
    }
    if !matches!(CaptureKind::of(&args.input), Ok(Some(CaptureKind::Dome))) {
        return Err(Error::input(
            &args.input,
            "a capture, not a fit of one; `mesophyll fit leaf` fits a scan under a tube, and the folder of that fit is \
             wanted here",
        ));
    }
    let folder = args.output.join("leaf");
    dome::run(&args.input, &folder, &dome::Options { gloss: None, force: args.force })?;
    say(format!("leaf fit written to {}", folder.display()));
    Ok(folder)
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let (options, leaf) = (options(args)?, leaf(args)?);
    crate::cli::preparation::warn(&leaf);
    let outcome = fit(&leaf, &args.output, &options)?;
    super::told(outcome, &args.output, common, |record| {
        if let Some(why) = record.options.get("doubt") {
            say(format!("warning: {why}; do not rely on the maps"));
        }
        summary(record)
    })
}

/// A table for people.
fn summary(record: &FitRecord) -> String {
    let say = |name: &str| record.options.get(name).map_or("", String::as_str);
    let mut text =
        format!("{}: colour {}, channel {}, basis {}\n", record.name, say("colour"), say("channel"), say("basis"));
    for (name, section) in &record.sections {
        let count = |k: &str| section.counts.get(k).copied().unwrap_or(0);
        text += &format!("light through the {name}: {} texels", count("texels") - count("outside"));
        if count("no_light") > 0 {
            text += &format!(", {} of them transmit no light", count("no_light"));
        }
        text.push('\n');
        for (parameter, p) in &section.params {
            let values: Vec<String> = p.value.iter().map(|v| format!("{v:.4}")).collect();
            text += &format!("  {parameter:<10} {} {}\n", values.join("   "), p.unit);
        }
        for (figure, value) in section.figures.iter().filter(|(k, _)| k.starts_with("basis_rms")) {
            text += &format!("  {figure}: {:.2} % of the light that comes through\n", 100.0 * value);
        }
    }
    text
}
