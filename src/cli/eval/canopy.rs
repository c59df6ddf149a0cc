//! `mesophyll eval canopy`: a canopy's reflectance factor towards directions, or where the sun's light goes.

use super::canopy_bands::BandChoice;
use crate::cli::{CommonArgs, batch, tables};
use crate::cli::{Error, Result};
use mesophyll_files::progress::{self, TaskProgress};
use mesophyll_files::table::{Batch, BatchIo, BatchSpec, InputTable, OutputRow};
use mesophyll_files::{atomic, claim};
use mesophyll_scene::draw::{bands, reference};
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::placed::{leaf::LeafSearch, ledger::Ledger};
use mesophyll_transport::path::{Canopy, Estimate, SurfaceBands};
use std::path::{Path, PathBuf};

/// The bidirectional reflectance factor of a periodic scene under its sun, as CSV: columns
/// `view_zenith_deg,view_azimuth_deg` → `brf,brf_err,status`. With --bands the factors at many wavelengths, from the
/// same paths: `brf_450,brf_450_err,…`. With --fluxes instead the shares of the sun's light that the canopy reflects
/// and absorbs, and that reach the ground; with --bands too, a row for each wavelength.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("eval canopy"))]
pub struct Args {
    /// Scene with a [periodic], a [sun] and no [sky]
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// Folder of an earlier run, whose fits of the scene's leaves are used
    #[arg(long, value_name = "DIR", value_parser = crate::cli::destination::folder())]
    run: Option<PathBuf>,
    /// CSV of directions towards the viewer (`-`: standard input)
    #[arg(long, value_name = "FILE.csv", required_unless_present = "fluxes", conflicts_with = "fluxes")]
    directions: Option<PathBuf>,
    /// Shares of the incident light instead: reflected, absorbed, transmitted
    #[arg(long)]
    fluxes: bool,
    /// CSV to write (`-`: standard output); written whole or not at all
    #[arg(short = 'o', long = "out", alias = "output", value_name = "FILE", default_value = "-")]
    output: PathBuf,
    /// Paths a direction, or with --fluxes in all
    #[arg(long, value_name = "N", default_value_t = 131_072,
        value_parser = clap::value_parser!(u32).range(32..=1 << 30))]
    samples: u32,
    /// Which of the scene's channels
    #[arg(long, value_name = "R|G|B", default_value = "G", value_parser = ["R", "G", "B"])]
    channel: String,
    /// Wavelengths (nm) instead of a channel, of leaves and a ground that have spectra: a list, a table with the column
    /// wavelength_nm, or all that the spectra have in common
    #[arg(long, value_name = "450,550,…|FILE.csv|all", conflicts_with = "channel")]
    bands: Option<BandChoice>,
    /// Seed of the random numbers
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// What is asked of the light: one channel, or many wavelengths.
enum CanopyLight {
    Channel(usize),
    Bands(Vec<SurfaceBands>, usize),
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    // The tables and the output are checked before the scene's leaves are fitted.
    let mut manifest = SceneManifest::read(&args.scene)?;
    let wavelengths = args.bands.as_ref().map(|bands| bands.wavelengths(&manifest)).transpose()?;
    let spec = BatchSpec {
        required: vec!["view_zenith_deg".into()],
        optional: vec!["view_azimuth_deg".into()],
        outputs: wavelengths.as_deref().map_or_else(|| vec!["brf".into(), "brf_err".into()], BandChoice::columns),
        ..BatchSpec::default()
    };
    let io = BatchIo { input: args.directions.clone().unwrap_or_default(), output: args.output.clone() };
    let open = |file: &PathBuf| Batch::open(InputTable::open(file)?, &io.rows(common.json), &spec);
    let batch = args.directions.as_ref().map(open).transpose()?;
    claim::file(&args.output, &["csv", "json"], &[&args.scene])?;
    let ledger = Ledger::new();
    let search = LeafSearch { out: args.run.as_deref(), compared: true, free: false };
    // No view is needed, but all leaves must be there.
    manifest.look_from_above();
    if wavelengths.is_some() {
        manifest.forget_colours();
    }
    let scene = LoadedScene::open(manifest, search, &ledger)?;
    scene.require_sound_fits(&ledger)?;
    let light = match &wavelengths {
        Some(nm) => CanopyLight::Bands(bands::surfaces(&scene, nm)?, nm.len()),
        None => CanopyLight::Channel(["R", "G", "B"].iter().position(|c| *c == args.channel).unwrap_or(1)),
    };
    let world = reference::traced(&scene, 0.0, &ledger)?;
    let canopy = Canopy::new(&world, args.seed).map_err(|what| Error::input(&args.scene, what))?;
    let shines = |channel: usize| world.sun.as_ref().is_some_and(|s| s.irradiance[channel] > 0.0);
    let dark = match light {
        CanopyLight::Channel(channel) if !shines(channel) => {
            Some(format!("0 in channel {}, expected a sun that shines in it, or another --channel", args.channel))
        }
        CanopyLight::Bands(..) if !(0..3).any(shines) => Some("0 in all channels, expected a sun that shines".into()),
        _ => None,
    };
    if let Some(what) = dark {
        return Err(Error::field(&args.scene, "sun.irradiance", what));
    }
    match (batch, &light) {
        (Some(batch), light) => directions(args, batch, &io, &canopy, light, common),
        (None, light) => fluxes(args, &canopy, light, wavelengths.as_deref(), common),
    }
}

fn directions(
    args: &Args,
    batch: Batch,
    io: &BatchIo,
    canopy: &Canopy,
    light: &CanopyLight,
    common: &CommonArgs,
) -> Result<u8> {
    let bar = TaskProgress::of("directions");
    let tally = batch.run(|row, out| {
        let (zenith, azimuth) = (row.get(0), row.get(1));
        // Without an azimuth the view is in the sun's plane. As is usual there, negative angles are on the sun's side.
        let (zenith, azimuth) = match azimuth.is_nan() {
            true => (-zenith.to_radians(), canopy.sun_azimuth()),
            false => (zenith.to_radians(), azimuth.to_radians()),
        };
        if !(zenith.cos() > 1e-3 && zenith.abs() < 1.6 && azimuth.is_finite()) {
            out.push(OutputRow::refused(format!(
                "view_zenith_deg is {}; expected above -89.9 and below 89.9",
                row.get(0)
            )));
            return;
        }
        let toward = [zenith, azimuth];
        let found = match light {
            CanopyLight::Channel(channel) => Ok(vec![canopy.brf(toward, *channel, args.samples)]),
            CanopyLight::Bands(surfaces, bands) => canopy.brf_of_bands(toward, surfaces, *bands, args.samples),
        };
        bar.advance(1);
        out.push(match found {
            Ok(factors) => OutputRow::ok(factors.iter().flat_map(|brf| [brf.mean, brf.error]).collect()),
            Err(why) => OutputRow::refused(why),
        });
    })?;
    batch::say_tally(&tally, io, common, "direction")?;
    Ok(0)
}

fn fluxes(args: &Args, canopy: &Canopy, light: &CanopyLight, nm: Option<&[f64]>, common: &CommonArgs) -> Result<u8> {
    let found = match light {
        CanopyLight::Channel(channel) => vec![canopy.fluxes(*channel, args.samples)],
        CanopyLight::Bands(surfaces, bands) => {
            canopy.fluxes_of_bands(surfaces, *bands, args.samples).map_err(|what| Error::input(&args.scene, what))?
        }
    };
    if progress::stop_requested() {
        return Err(Error::Interrupted("interrupted; nothing was written".into()));
    }
    let mut rows: Vec<Vec<(&str, f64)>> = Vec::new();
    for (k, of) in found.iter().enumerate() {
        let wavelength = nm.map(|nm| ("wavelength_nm", nm[k]));
        let shares = [
            ("reflected", of.reflected.mean),
            ("reflected_err", of.reflected.error),
            ("absorbed", of.absorbed.mean),
            ("absorbed_err", of.absorbed.error),
            ("transmitted", of.transmitted.mean),
            ("transmitted_err", of.transmitted.error),
        ];
        rows.push(wavelength.into_iter().chain(shares).collect());
    }
    if common.json && args.output == Path::new("-") {
        let json = rows
            .iter()
            .map(|row| row.iter().map(|(name, value)| (name.to_string(), serde_json::Value::from(*value))).collect());
        let mut json: Vec<serde_json::Map<String, serde_json::Value>> = json.collect();
        // Of a channel there is one answer.
        match nm {
            None => crate::cli::print_json(&json.pop().unwrap_or_default())?,
            Some(_) => crate::cli::print_json(&json)?,
        }
        return Ok(0);
    }
    let joined = |cells: Vec<String>| cells.join(",") + "\n";
    let header = rows.first().map(|row| joined(row.iter().map(|(name, _)| name.to_string()).collect()));
    let lines = rows.iter().map(|row| joined(row.iter().map(|(_, value)| value.to_string()).collect()));
    let text: String = header.into_iter().chain(lines).collect();
    match args.output == Path::new("-") {
        true => crate::cli::print(&text)?,
        false => atomic::write_bytes(&args.output, text.as_bytes())?,
    }
    let off = found.iter().map(|of| of.closure).max_by(|a, b| {
        let far = |e: &Estimate| (e.mean - 1.0).abs();
        far(a).total_cmp(&far(b))
    });
    if let Some(closure) = off {
        let most = if nm.is_some() { "by at most " } else { "by " };
        progress::say(format!(
            "energy balance: reflected + absorbed + taken up by the ground differs from 1 {most}{:+.1e} ± {:.1e}",
            closure.mean - 1.0,
            closure.error
        ));
    }
    Ok(0)
}
