//! `mesophyll synth`: grows a leaf from a specification and scans it as a linear light source device would, or photographs it under a
//! dome and scans its heights.

use super::Common;
use crate::capture::dome::synth as dome;
use crate::capture::manifest::Travel;
use crate::capture::synth::leaf::Leaf;
use crate::capture::synth::scan::{self, Options};
use crate::capture::synth::spec::{Model, Spec};
use crate::files::{atomic, progress};
use crate::{Error, Result};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  mesophyll synth data/leaves/elm.toml -o out/elm\n  \
    mesophyll synth data/leaves/balata.toml -o out/balata --size 240x180 --frames 60 --noise 0\n  \
    mesophyll synth data/leaves/elm.toml -o out/elm-dome --acquisition dome --patch-mm 20 --size 256x256\n\n\
    The specification and the capture it becomes are described in data/README.md.")]
pub struct Args {
    /// Leaf specification
    #[arg(value_name = "SPEC.toml")]
    spec: PathBuf,
    /// Folder to write the capture to
    #[arg(long, short, value_name = "CAPTURE")]
    out: PathBuf,
    /// Size of the frames in texels; the blade keeps its size in mm
    #[arg(long, value_name = "WxH", default_value = "720x540")]
    size: String,
    /// How the leaf is measured
    #[arg(long, value_enum, default_value_t = Acquisition::Tube)]
    acquisition: Acquisition,
    /// Frames a pass (8 to 10000) [default: 100]
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    /// Relative noise of a reading; 0 writes exact values
    #[arg(long, value_name = "S", default_value_t = 0.01)]
    noise: f64,
    /// Seed of the noise; the leaf itself grows from the specification's
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Directions of travel: x, or x and y [default: xy]
    #[arg(long, value_name = "x|xy", value_parser = ["x", "xy"])]
    passes: Option<String>,
    /// Dome: width of the part of the leaf that is captured, in mm (its height follows the size's shape); the whole field otherwise
    #[arg(long, value_name = "MM")]
    patch_mm: Option<f64>,
    /// Dome: centre of that part, in mm from the middle of the field (x right, y up)
    #[arg(long, value_name = "X,Y", value_delimiter = ',', num_args = 1, allow_hyphen_values = true, requires = "patch_mm")]
    patch_at: Option<Vec<f64>>,
    /// Dome: noise of a height, standard deviation in mm; none with --noise 0 [default: 0.01]
    #[arg(long, value_name = "MM")]
    height_noise: Option<f64>,
    /// Truth of the leaf, instead of the specification's
    #[arg(long)]
    model: Option<Model>,
    /// Keep the three 16-bit exposures of every frame beside it
    #[arg(long)]
    raw_exposures: bool,
    /// Write into a folder that is not empty
    #[arg(long)]
    force: bool,
}

/// The two ways to measure a leaf.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Acquisition {
    /// A lit tube that travels over the leaf, and a light box
    Tube,
    /// Photographs under a dome and in front of a back light, and height scans
    Dome,
}

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    let (width, height) = parse_size(&args.size)?;
    if !(0.0..=1.0).contains(&args.noise) {
        return Err(Error::Usage(format!("--noise: found {}, expected 0 to 1", args.noise)));
    }
    let foreign = match args.acquisition {
        Acquisition::Tube => [("--patch-mm", args.patch_mm.is_some()), ("--height-noise", args.height_noise.is_some()), ("", false)],
        Acquisition::Dome => {
            [("--frames", args.frames.is_some()), ("--passes", args.passes.is_some()), ("--raw-exposures", args.raw_exposures)]
        }
    };
    if let Some((option, _)) = foreign.iter().find(|(_, given)| *given) {
        let needs = if args.acquisition == Acquisition::Tube { "dome" } else { "tube" };
        return Err(Error::Usage(format!("{option}: has no meaning here, expected with --acquisition {needs} only")));
    }
    match args.acquisition {
        Acquisition::Tube => tube(args, common, width, height),
        Acquisition::Dome => under_dome(args, common, width, height),
    }
}

fn under_dome(args: &Args, common: &Common, width: usize, height: usize) -> Result<u8> {
    let height_noise_mm = args.height_noise.unwrap_or(0.01);
    if !(0.0..=10.0).contains(&height_noise_mm) {
        return Err(Error::Usage(format!("--height-noise: found {height_noise_mm}, expected 0 to 10 mm")));
    }
    if width.min(height) < 3 {
        return Err(Error::Usage(format!("--size: found {width}x{height}, expected at least 3x3 for heights to have slopes")));
    }
    let centre = match args.patch_at.as_deref() {
        None => [0.0; 2],
        Some([x, y]) if x.is_finite() && y.is_finite() => [*x, *y],
        Some(list) => return Err(Error::Usage(format!("--patch-at: found {} numbers, expected X,Y in mm", list.len()))),
    };
    if let Some(size) = args.patch_mm
        && !(size > 0.0 && size.is_finite())
    {
        return Err(Error::Usage(format!("--patch-mm: found {size}, expected a positive width in mm")));
    }
    let spec = Spec::read(&args.spec)?;
    let options = dome::Options {
        width,
        height,
        patch: args.patch_mm.map(|size| (size, centre)),
        noise: args.noise,
        height_noise_mm,
        seed: args.seed,
        model: args.model.unwrap_or(spec.model),
    };
    free_folder(&args.out, args.force)?;
    progress::say(format!("growing {} ({})", spec.name, spec.species));
    let blade = dome::Blade::grow(&spec, &options)?.ok_or_else(|| {
        Error::Usage(format!("--size {width}x{height}: not one texel lies on the leaf; expected a larger size, or a patch on the leaf"))
    })?;
    let manifest = dome::capture(&spec, &blade, &options, &args.out)?;
    let texels = blade.leaf.mask.iter().filter(|m| **m).count();
    if common.json {
        super::print_json(&serde_json::json!({
            "capture": args.out, "kind": manifest.kind, "name": manifest.name, "width": width, "height": height,
            "texel_mm": manifest.texel_mm, "texels": texels, "thickness_max_mm": manifest.thickness_max_mm,
        }))?;
    } else {
        progress::say(format!("{}: {width}x{height} texels of {:.3} mm, {texels} on the leaf", args.out.display(), manifest.texel_mm));
    }
    Ok(0)
}

fn tube(args: &Args, common: &Common, width: usize, height: usize) -> Result<u8> {
    let frames = args.frames.unwrap_or(100);
    if !(8..=10_000).contains(&frames) {
        return Err(Error::Usage(format!("--frames: found {frames}, expected 8 to 10000")));
    }
    let spec = Spec::read(&args.spec)?;
    let options = Options {
        width,
        height,
        frames,
        passes: if args.passes.as_deref() == Some("x") { vec![Travel::X] } else { vec![Travel::X, Travel::Y] },
        noise: args.noise,
        seed: args.seed,
        model: args.model.unwrap_or(spec.model),
        raw_exposures: args.raw_exposures,
    };
    free_folder(&args.out, args.force)?;
    progress::say(format!("growing {} ({})", spec.name, spec.species));
    let leaf = Leaf::grow(&spec, options.model, width, height)
        .ok_or_else(|| Error::Usage(format!("--size {width}x{height}: not one texel lies on the leaf; expected a larger size")))?;
    let manifest = scan::scan(&spec, &leaf, &options, &args.out)?;
    let texels = leaf.mask.iter().filter(|m| **m).count();
    if common.json {
        super::print_json(&serde_json::json!({
            "capture": args.out, "name": manifest.name, "width": width, "height": height, "texel_mm": leaf.texel_mm, "texels": texels,
            "frames": manifest.passes.iter().map(|p| p.positions().len()).sum::<usize>() * 2,
        }))?;
    } else {
        progress::say(format!("{}: {width}x{height} texels of {:.3} mm, {texels} on the leaf", args.out.display(), leaf.texel_mm));
    }
    Ok(0)
}

fn parse_size(text: &str) -> Result<(usize, usize)> {
    let fail = || Error::Usage(format!("--size: found {text}, expected WIDTHxHEIGHT of 1 to 16384 texels each, such as 720x540"));
    let (w, h) = text.split_once(['x', 'X']).ok_or_else(fail)?;
    match (w.trim().parse(), h.trim().parse()) {
        (Ok(w), Ok(h)) if (1..=16_384).contains(&w) && (1..=16_384).contains(&h) => Ok((w, h)),
        _ => Err(fail()),
    }
}

/// An empty or new folder that can be written; with `force` what a capture holds is removed first, `capture.toml` foremost.
fn free_folder(folder: &Path, force: bool) -> Result<()> {
    atomic::probe_folder(folder)?;
    let occupied = std::fs::read_dir(folder).map_err(|e| Error::write(folder, atomic::explain(&e)))?.next().is_some();
    if !occupied {
        return Ok(());
    }
    if !force {
        return Err(Error::Usage(format!("the output folder {} is not empty; choose another or add --force", folder.display())));
    }
    for name in ["capture.toml", "mask.exr", "dark.exr", "lightbox_empty.exr", "white.exr", "backlight_empty.exr"] {
        remove(&folder.join(name))?;
    }
    for name in ["front", "back", "white", "mirror", "truth"] {
        remove(&folder.join(name))?;
    }
    Ok(())
}

fn remove(path: &Path) -> Result<()> {
    let done = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
    match done {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::write(path, atomic::explain(&e))),
        _ => Ok(()),
    }
}
