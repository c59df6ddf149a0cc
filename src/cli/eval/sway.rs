//! `mesophyll eval sway`: where the tips of the branches of a scene's plants are over time.

use crate::cli::{CommonArgs, tables};
use crate::cli::{Error, Result};
use mesophyll_files::progress::TaskProgress;
use mesophyll_files::table::{TableOutput, TableSink, push_number, push_text};
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_scene::placed::plant::{self, PlacedPlant};
use mesophyll_scene::placed::winds::SwayingPlants;
use rayon::prelude::*;
use std::path::PathBuf;

/// The positions of the tips of the branches of a scene's plants as they sway in the scene's wind:
/// `time_s,plant,branch,tip_x_mm,tip_y_mm,tip_z_mm`, one row for each branch and time. Both renderers bend the branches
/// by the same numbers.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("eval sway"))]
pub struct Args {
    /// Scene with plants
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// First time (s)
    #[arg(long, value_name = "S", default_value_t = 0.0, allow_negative_numbers = true)]
    from: f64,
    /// Last time (s)
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    to: f64,
    /// Step between two times (s)
    #[arg(long, value_name = "S", default_value_t = 0.05)]
    step: f64,
    /// CSV to write (`-`: standard output); written whole or not at all
    #[arg(short = 'o', long = "out", alias = "output", value_name = "FILE", default_value = "-")]
    output: PathBuf,
}

/// More rows than this are more likely a typing error than a wish.
const MOST_ROWS: f64 = 2e8;

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    if !(args.step > 0.0 && args.step.is_finite()) {
        return Err(Error::argument("--step", args.step, "a time above 0"));
    }
    if !(args.from.is_finite() && args.to.is_finite() && args.to >= args.from) {
        return Err(Error::argument("--to", args.to, format!("a time not before --from ({})", args.from)));
    }
    let manifest = SceneManifest::read(&args.scene)?;
    let ledger = Ledger::new();
    let planted = plant::planted(&manifest, &ledger)?;
    let rows: usize = planted.iter().map(|p| p.places.len() * p.plant.branches.len()).sum();
    if rows == 0 {
        return Err(Error::field(&args.scene, "plant", "missing; expected a scene with a plant that has branches"));
    }
    let standing = Standing { winds: SwayingPlants::new(&manifest, &planted, &ledger)?, planted: &planted };
    // The last time is included although rounding may make the steps fall short of it.
    let steps = ((args.to - args.from) / args.step + 1e-9).floor();
    if (steps + 1.0) * rows as f64 > MOST_ROWS {
        let found = format!("{} rows", (steps + 1.0) * rows as f64);
        return Err(Error::argument("--step", found, format!("at most {MOST_ROWS:e}")));
    }
    let mut sink = TableSink::open(&TableOutput { path: args.output.clone(), json: common.json }, &args.scene)?;
    sink.write_all(b"time_s,plant,branch,tip_x_mm,tip_y_mm,tip_z_mm\n")?;
    let bar = TaskProgress::of("times");
    // A few times are computed at once, because plants of many branches take a while each.
    let all: Vec<u64> = (0..=steps as u64).collect();
    for some in all.chunks(256) {
        let lines: Vec<Vec<u8>> = some
            .par_iter()
            .map(|k| {
                let time = args.from + *k as f64 * args.step;
                let mut lines = Vec::new();
                standing.rows(&mut lines, time);
                lines
            })
            .collect();
        for line in lines {
            sink.write_all(&line)?;
            bar.advance(1);
        }
        if mesophyll_files::progress::stop_requested() {
            return Err(Error::Interrupted("interrupted; nothing was written".into()));
        }
    }
    sink.finish()?;
    Ok(0)
}

/// The scene's plants.
struct Standing<'a> {
    planted: &'a [PlacedPlant],
    /// `None`: they stand still.
    winds: Option<SwayingPlants>,
}

impl Standing<'_> {
    fn rows(&self, lines: &mut Vec<u8>, time: f64) {
        for (index, one) in self.planted.iter().enumerate() {
            for (place, to_world) in one.places.iter().enumerate() {
                let pose = self.winds.as_ref().and_then(|w| w.pose(index, place, time));
                for (k, branch) in one.plant.branches.iter().enumerate() {
                    let tip = pose.as_ref().map_or_else(|| branch.point(1.0).0, |pose| pose.tip(k));
                    let tip = to_world.transform_point3(tip).to_array();
                    row(lines, time, &one.name_at(place), &branch.name, tip);
                }
            }
        }
    }
}

fn row(lines: &mut Vec<u8>, time: f64, plant: &str, branch: &str, tip: [f64; 3]) {
    push_number(lines, time);
    for text in [plant, branch] {
        lines.push(b',');
        push_text(lines, text);
    }
    for c in tip {
        lines.push(b',');
        push_number(lines, c);
    }
    lines.push(b'\n');
}
