//! `mesophyll synth`: grows a leaf from a specification and scans it as a linear light source device would, photographs
//! it under a dome and scans its heights, photographs the light that comes through it, or photographs it in open shade
//! and on a light table.

use super::CommonArgs;
use crate::cli::names::named;
use crate::cli::{Error, Result};
use mesophyll_capture::beams::manifest::BeamPhotograph;
use mesophyll_capture::kind::CaptureKind;
use mesophyll_files::{claim, progress};
use mesophyll_fits::design::leaf::read_places;
use mesophyll_optics::side::Side;
use mesophyll_optics::tube::Travel;
use mesophyll_synth::beams;
use mesophyll_synth::dome;
use mesophyll_synth::leaf::SyntheticLeaf;
use mesophyll_synth::photo;
use mesophyll_synth::scan::{self, Options};
use mesophyll_synth::spec::{InteriorModel, LeafSpec};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  mesophyll synth data/leaves/elm.toml -o out/elm\n  \
    mesophyll synth data/leaves/balata.toml -o out/balata --size 240x180 --frames 60 --noise 0\n  \
    mesophyll synth data/leaves/elm.toml -o out/elm-dome --acquisition dome --patch-mm 20 --size 256x256\n  \
    mesophyll synth data/leaves/elm.toml -o out/elm-beams --acquisition beams --patch-mm 12 --size 128x128\n  \
    mesophyll synth data/leaves/elm.toml -o out/elm-photo --acquisition photo\n\n\
    The specification and the capture it becomes are described in data/README.md.")]
pub struct Args {
    /// Leaf specification
    #[arg(value_name = "SPEC.toml")]
    spec: PathBuf,
    /// Folder to write the capture to
    #[arg(short, long, alias = "output", value_name = "CAPTURE", value_parser = super::destination::folder())]
    out: PathBuf,
    /// Size of the frames in texels; the blade keeps its size in mm
    #[arg(long, value_name = "WxH", default_value = "720x540")]
    size: String,
    /// How the leaf is measured
    #[arg(long, value_parser = named::<CaptureKind>(), default_value_t = CaptureKind::Tube)]
    acquisition: CaptureKind,
    /// Frames a pass (8 to 10000) [default: 100]
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    /// Relative noise of a reading; 0 writes exact values
    #[arg(long, value_name = "S", default_value_t = 0.01)]
    noise: f64,
    /// Seed of the noise. The leaf itself depends on the seed in the specification
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Directions of travel: x, or x and y [default: xy]
    #[arg(long, value_name = "x|xy", value_parser = ["x", "xy"])]
    passes: Option<String>,
    /// CSV of the frames' places, pass and position_mm, as `design leaf` writes it
    #[arg(long, value_name = "FILE.csv", conflicts_with_all = ["frames", "passes"])]
    positions: Option<PathBuf>,
    /// Width (mm) of the part of the leaf that is captured; its height follows from the aspect ratio of --size
    /// (default: the whole field)
    #[arg(long, value_name = "MM")]
    patch_mm: Option<f64>,
    /// Dome, beams: centre of that part (a tube's field is the middle), in mm from the middle of the field (x right, y
    /// up)
    #[arg(
        long,
        value_name = "X,Y",
        value_delimiter = ',',
        num_args = 1,
        allow_hyphen_values = true,
        requires = "patch_mm"
    )]
    patch_at: Option<Vec<f64>>,
    /// Dome: noise of a height, standard deviation in mm; none with --noise 0 [default: 0.01]
    #[arg(long, value_name = "MM")]
    height_noise: Option<f64>,
    /// Beams only: one light, as side,elevation,azimuth, such as front,60,0: the lit side, the elevation above the
    /// blade, and the azimuth in the image of that side. The option can be repeated
    #[arg(long, value_name = "SIDE,DEG,DEG", allow_hyphen_values = true)]
    beam: Vec<String>,
    /// Truth of the leaf, instead of the specification's
    #[arg(long, value_parser = named::<InteriorModel>())]
    model: Option<InteriorModel>,
    /// Keep the three 16-bit exposures of every frame beside it
    #[arg(long)]
    raw_exposures: bool,
    /// Replace a synthetic capture that is there (a measured one is never replaced), or write beside other files
    #[arg(long)]
    force: bool,
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    let (width, height) = parse_size(&args.size)?;
    if !(0.0..=1.0).contains(&args.noise) {
        return Err(Error::argument("--noise", args.noise, "0 to 1"));
    }
    use CaptureKind::{Beams, Dome, Tube};
    let options: [(&str, bool, &[CaptureKind], &str); 7] = [
        ("--frames", args.frames.is_some(), &[Tube], "tube"),
        ("--passes", args.passes.is_some(), &[Tube], "tube"),
        ("--raw-exposures", args.raw_exposures, &[Tube], "tube"),
        ("--patch-at", args.patch_at.is_some(), &[Dome, Beams], "dome or beams"),
        ("--patch-mm", args.patch_mm.is_some(), &[Tube, Dome, Beams], "tube, dome or beams"),
        ("--height-noise", args.height_noise.is_some(), &[Dome], "dome"),
        ("--beam", !args.beam.is_empty(), &[Beams], "beams"),
    ];
    if let Some((option, _, _, needs)) =
        options.iter().find(|(_, given, meant, _)| *given && !meant.contains(&args.acquisition))
    {
        return Err(Error::Usage(format!("{option}: has no meaning here, expected with --acquisition {needs} only")));
    }
    match args.acquisition {
        CaptureKind::Tube => tube(args, common, width, height),
        CaptureKind::Dome => under_dome(args, common, width, height),
        CaptureKind::Beams => under_beams(args, common, width, height),
        CaptureKind::Photo => in_shade(args, common, width, height),
    }
}

/// The leaf's truth, which must be a slab where light travels sideways through the leaf.
fn slab(args: &Args, spec: &LeafSpec) -> Result<InteriorModel> {
    match spec.truth(&args.spec, args.model)? {
        InteriorModel::Foliar => Err(Error::Usage(
            "--acquisition dome, beams and photo spread light sideways by σa and σs, which the model foliar does not \
             have; expected --acquisition tube, or --model exact with a specification that has [interior]"
                .into(),
        )),
        model => Ok(model),
    }
}

fn under_dome(args: &Args, common: &CommonArgs, width: usize, height: usize) -> Result<u8> {
    let height_noise_mm = args.height_noise.unwrap_or(0.01);
    if !(0.0..=10.0).contains(&height_noise_mm) {
        return Err(Error::argument("--height-noise", height_noise_mm, "0 to 10 mm"));
    }
    if width.min(height) < 3 {
        return Err(Error::argument("--size", format!("{width}x{height}"), "at least 3x3 for heights to have slopes"));
    }
    let patch = patch(args)?;
    let spec = LeafSpec::read(&args.spec)?;
    let options = dome::Options {
        width,
        height,
        patch,
        noise: args.noise,
        height_noise_mm,
        seed: args.seed,
        model: slab(args, &spec)?,
    };
    let _claim = claim::capture(&args.out, &[&args.spec], args.force)?;
    progress::say(format!("growing {} ({})", spec.name, spec.species));
    let blade = dome::DomeLeaf::grow(&spec, &options)?.ok_or_else(|| {
        Error::Usage(format!(
            "--size {width}x{height}: not one texel lies on the leaf; expected a larger size, or a patch on the leaf"
        ))
    })?;
    let manifest = claim::capturing(&args.out, || dome::capture(&spec, &blade, &options, &args.out))?;
    let texels = blade.leaf.mask.iter().filter(|m| **m).count();
    if common.json {
        super::print_json(&serde_json::json!({
            "capture": args.out, "kind": manifest.kind, "name": manifest.name, "width": width, "height": height,
            "texel_mm": manifest.texel_mm, "texels": texels, "thickness_max_mm": manifest.thickness_max_mm,
        }))?;
    } else {
        progress::say(format!(
            "{}: {width}x{height} texels of {:.3} mm, {texels} on the leaf",
            args.out.display(),
            manifest.texel_mm
        ));
    }
    Ok(0)
}

/// Narrowest pictures in which leaf, card and ruler have room (pixels).
const PHOTO: [usize; 2] = [96, 72];

fn in_shade(args: &Args, common: &CommonArgs, width: usize, height: usize) -> Result<u8> {
    if width < PHOTO[0] || height < PHOTO[1] {
        let expected = format!("at least {}x{} for leaf, card and ruler", PHOTO[0], PHOTO[1]);
        return Err(Error::argument("--size", format!("{width}x{height}"), &expected));
    }
    let spec = LeafSpec::read(&args.spec)?;
    let options = photo::Options { width, height, noise: args.noise, seed: args.seed, model: slab(args, &spec)? };
    let _claim = claim::capture(&args.out, &[&args.spec], args.force)?;
    progress::say(format!("growing {} ({})", spec.name, spec.species));
    let blade = photo::grow(&spec, &options)?.ok_or_else(|| {
        Error::Usage(format!("--size {width}x{height}: not one texel lies on the leaf; expected a larger size"))
    })?;
    let manifest = claim::capturing(&args.out, || photo::capture(&spec, &blade, &options, &args.out))?;
    let texels = blade.leaf.mask.iter().filter(|m| **m).count();
    if common.json {
        super::print_json(&serde_json::json!({
            "capture": args.out, "kind": manifest.kind, "name": manifest.name, "width": width, "height": height,
            "texel_mm": blade.leaf.texel_mm, "texels": texels, "thickness_mm": manifest.thickness_mm,
        }))?;
    } else {
        progress::say(format!(
            "{}: five photographs of {width}x{height} pixels of {:.3} mm, {texels} on the leaf",
            args.out.display(),
            blade.leaf.texel_mm
        ));
    }
    Ok(0)
}

/// Width and centre of the part that is captured.
fn patch(args: &Args) -> Result<Option<(f64, [f64; 2])>> {
    let centre = match args.patch_at.as_deref() {
        None => [0.0; 2],
        Some([x, y]) if x.is_finite() && y.is_finite() => [*x, *y],
        Some(list) => {
            return Err(Error::argument("--patch-at", format!("{} numbers", list.len()), "X,Y in mm"));
        }
    };
    if let Some(size) = args.patch_mm
        && !(size > 0.0 && size.is_finite())
    {
        return Err(Error::argument("--patch-mm", size, "a positive width in mm"));
    }
    Ok(args.patch_mm.map(|size| (size, centre)))
}

/// `front,60,0`: lit side, elevation, azimuth.
fn beam(text: &str) -> Result<BeamPhotograph> {
    let fail =
        || Error::argument("--beam", text, "front or back, an elevation above 0 to 90 and an azimuth, as front,60,0");
    let parts: Vec<&str> = text.split(',').map(str::trim).collect();
    let [side, elevation, azimuth] = parts[..] else { return Err(fail()) };
    let lit = match side {
        "front" => Side::Front,
        "back" => Side::Back,
        _ => return Err(fail()),
    };
    match (elevation.parse::<f64>(), azimuth.parse::<f64>()) {
        (Ok(e), Ok(a)) if e > 0.0 && e <= 90.0 && (-360.0..=360.0).contains(&a) => {
            Ok(BeamPhotograph { file: String::new(), lit, elevation_deg: e, azimuth_deg: a })
        }
        _ => Err(fail()),
    }
}

fn under_beams(args: &Args, common: &CommonArgs, width: usize, height: usize) -> Result<u8> {
    if width.min(height) < 3 {
        return Err(Error::argument("--size", format!("{width}x{height}"), "at least 3x3"));
    }
    let given = args.beam.iter().map(|text| beam(text)).collect::<Result<Vec<BeamPhotograph>>>()?;
    let spec = LeafSpec::read(&args.spec)?;
    let options = beams::Options {
        width,
        height,
        patch: patch(args)?,
        beams: if given.is_empty() { beams::usual_beams() } else { beams::named(given) },
        noise: args.noise,
        seed: args.seed,
        model: slab(args, &spec)?,
    };
    let _claim = claim::capture(&args.out, &[&args.spec], args.force)?;
    progress::say(format!("growing {} ({})", spec.name, spec.species));
    let grown = beams::grow(&spec, &options).ok_or_else(|| {
        Error::Usage(format!(
            "--size {width}x{height}: not one texel lies on the leaf; expected a larger size, or a patch on the leaf"
        ))
    })?;
    let manifest = claim::capturing(&args.out, || beams::capture(&spec, &grown, &options, &args.out))?;
    let texels = grown.crop(&grown.leaf.mask).iter().filter(|m| **m).count();
    if common.json {
        super::print_json(&serde_json::json!({
            "capture": args.out, "kind": manifest.kind, "name": manifest.name, "width": width, "height": height,
            "texel_mm": manifest.texel_mm, "texels": texels, "photographs": manifest.beams.len(),
        }))?;
    } else {
        progress::say(format!(
            "{}: {width}x{height} texels of {:.3} mm, {texels} on the leaf",
            args.out.display(),
            manifest.texel_mm
        ));
    }
    Ok(0)
}

fn tube(args: &Args, common: &CommonArgs, width: usize, height: usize) -> Result<u8> {
    let frames = args.frames.unwrap_or(100);
    if !(8..=10_000).contains(&frames) {
        return Err(Error::argument("--frames", frames, "8 to 10000"));
    }
    let mut spec = LeafSpec::read(&args.spec)?;
    if let Some((size, _)) = patch(args)? {
        spec.field_mm = [size, size * height as f64 / width as f64];
    }
    let positions = args.positions.as_deref().map_or(Ok(Vec::new()), read_places)?;
    let passes = match (args.passes.as_deref(), positions.is_empty()) {
        (_, false) => positions.iter().map(|(travel, _)| *travel).collect(),
        (Some("x"), _) => vec![Travel::X],
        _ => vec![Travel::X, Travel::Y],
    };
    let options = Options {
        width,
        height,
        frames,
        passes,
        positions,
        noise: args.noise,
        seed: args.seed,
        model: spec.truth(&args.spec, args.model)?,
        raw_exposures: args.raw_exposures,
    };
    let _claim = claim::capture(&args.out, &[&args.spec], args.force)?;
    progress::say(format!("growing {} ({})", spec.name, spec.species));
    let leaf = SyntheticLeaf::grow(&spec, options.model, width, height).ok_or_else(|| {
        Error::Usage(format!("--size {width}x{height}: not one texel lies on the leaf; expected a larger size"))
    })?;
    let manifest = claim::capturing(&args.out, || scan::scan(&spec, &leaf, &options, &args.out))?;
    let texels = leaf.mask.iter().filter(|m| **m).count();
    if common.json {
        super::print_json(&serde_json::json!({
            "capture": args.out, "name": manifest.name, "width": width, "height": height, "texel_mm": leaf.texel_mm,
                "texels": texels,
            "frames": manifest.passes.iter().map(|p| p.positions().len()).sum::<usize>() * 2,
        }))?;
    } else {
        progress::say(format!(
            "{}: {width}x{height} texels of {:.3} mm, {texels} on the leaf",
            args.out.display(),
            leaf.texel_mm
        ));
    }
    Ok(0)
}

fn parse_size(text: &str) -> Result<(usize, usize)> {
    let fail = || Error::argument("--size", text, "WIDTHxHEIGHT of 1 to 16384 texels each, such as 720x540");
    let (w, h) = text.split_once(['x', 'X']).ok_or_else(fail)?;
    match (w.trim().parse(), h.trim().parse()) {
        (Ok(w), Ok(h)) if (1..=16_384).contains(&w) && (1..=16_384).contains(&h) => Ok((w, h)),
        _ => Err(fail()),
    }
}
