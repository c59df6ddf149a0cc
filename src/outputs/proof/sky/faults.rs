//! Faults of a picture of the sky, each put into a clean panorama. The verdict is the fit's status; a fault that the
//! picture shows must leave the turbidity undetermined or be refused.

use crate::stress::StressRow;
use mesophyll_files::image::ChannelMaps;
use mesophyll_fits::sky::panorama;
use mesophyll_fits::sky::panorama::picture::{PanoramaChannels, read};
use mesophyll_fits::sky::panorama::render::{PanoramaShot, render};
use mesophyll_sky::Preetham;
use std::path::Path;
use std::time::Instant;

const WIDTH: usize = 128;
const HEIGHT: usize = 64;
/// What a fit of another picture than a sky's must say.
const NO_SKY: &str = "undetermined: ";

/// A fault, what must be said of it, and how it changes the value of a channel at a column and row.
type Fault = (&'static str, &'static str, fn(f32, usize, usize, usize) -> f32);

const FAULTS: [Fault; 8] = [
    ("none", "ok", |v, _, _, _| v),
    ("a mirror image, as another sky would look", "ok", |v, _, _, _| v),
    ("coded with sRGB", NO_SKY, |v, _, _, _| {
        let v = (0.05 * v).min(1.0);
        if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
    }),
    ("coded with a gamma of 2.2", NO_SKY, |v, _, _, _| v.max(0.0).powf(1.0 / 2.2)),
    ("stray light of a fifth of a bright reading", NO_SKY, |v, _, _, _| v + 2.0),
    ("white balance: red 1.3 times as bright", NO_SKY, |v, c, _, _| if c == 0 { 1.3 * v } else { v }),
    ("darker towards the horizon, as lenses do", NO_SKY, |v, _, _, row| {
        v * (1.0 - 0.6 * (2.0 * row as f32 / HEIGHT as f32).min(1.0).powi(2))
    }),
    ("clouds over a half, bright and dark", NO_SKY, |v, _, column, row| {
        let wave = (0.5 * column as f32).sin() * (0.7 * row as f32).cos();
        if wave > 0.0 { v * (1.0 + wave) } else { v }
    }),
];

/// Runs every fault.
pub fn rows() -> Vec<StressRow> {
    FAULTS.iter().map(run).collect()
}

fn run((name, expected, change): &Fault) -> StressRow {
    let clock = Instant::now();
    let verdict = match Preetham.at(0.9, 3.0) {
        Err(e) => format!("wrong: {e}"),
        Ok(sky) => {
            let shot = PanoramaShot {
                width: WIDTH,
                height: HEIGHT,
                azimuth: 0.7,
                noise: 0.02,
                seed: 11,
                ..PanoramaShot::default()
            };
            let mut maps = render(&sky, &shot);
            for (c, (_, plane)) in maps.channels.iter_mut().enumerate() {
                plane.iter_mut().enumerate().for_each(|(k, v)| *v = change(*v, c, k % WIDTH, k / WIDTH));
            }
            if name.starts_with("a mirror image") {
                mirror(&mut maps);
            }
            read(Path::new("sky.exr"), &maps, shot.projection, &PanoramaChannels::default())
                .map_err(|e| e.to_string())
                .and_then(|picture| panorama::fit(&picture, None))
                .map_or_else(|why| format!("refused: {why}"), |found| found.status.to_string())
        }
    };
    StressRow {
        model: "sky".into(),
        case: format!("fault of a panorama: {name}"),
        expected: (*expected).into(),
        verdict,
        digits: None,
        condition: None,
        ms: clock.elapsed().as_secs_f64() * 1e3,
    }
}

fn mirror(maps: &mut ChannelMaps) {
    maps.channels.iter_mut().for_each(|(_, plane)| plane.chunks_mut(WIDTH).for_each(<[f32]>::reverse));
}
