//! Compares slices of a lawn with other methods that draw grass in real time. The same lawn under the same lights is
//! drawn in three ways: as slices through which rays are followed, as the same slices in polygons that are sorted and
//! blended (H9 §2.2), and blade by blade, instanced with levels of detail. Each picture is compared with the
//! path-traced blades.
//!
//! Sunlight on blades uses shadow maps that are drawn once and kept. The sky's light on each blade is computed as if
//! the blade stood alone.

use super::{BenchRow, repeats, ridge};
use glam::{DVec3, Vec3};
use mesophyll_base::error::{Error, Result};
use mesophyll_base::statistics::median_of;
use mesophyll_check::{blocks, told};
use mesophyll_files::progress::{self, TaskProgress};
use mesophyll_optics::side::Side;
use mesophyll_scene::draw::scene_reference::{ReferenceSampling, SceneReference};
use mesophyll_scene::draw::{handover, reference};
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::placed::leaf::LeafSearch;
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_transport::comparison::compare;
use mesophyll_transport::{self as transport, ReferencePicture};
use mesophyll_viewer as gpu;
use mesophyll_viewer::scene as viewer;
use std::path::Path;
use std::sync::Arc;

/// How a lawn is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Drawn {
    Slices(u32),
    Billboards,
    Blades,
}

const LAWN: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/grass/lawn.toml"));
const CLOVER: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/grass/clover.toml"));
/// Number of blades on a square metre of the lawn.
const PER_M2: f64 = 21_000.0;
/// Elevations of the eye over the ground (degrees), distances (mm), and densities relative to the thinnest lawn's.
const ELEVATIONS: [f64; 5] = [8.0, 20.0, 40.0, 65.0, 90.0];
const DISTANCES: [f64; 3] = [500.0, 1500.0, 4500.0];
const DENSITIES: [f64; 3] = [1.0, 4.0, 16.0];
/// Steps of the progress bar.
pub const PIECES: u64 = (ELEVATIONS.len() + DISTANCES.len() + DENSITIES.len() + TABLE.len() + 2) as u64;
/// The rows of the source's Table 2.1: pixels, steps, and the speed-up.
const TABLE: [([u32; 2], u32, f64); 3] = [([1024, 768], 4, 1.56), ([1024, 768], 16, 2.67), ([1600, 1200], 4, 1.93)];
/// Pixels of the pictures that are judged, paths for each pixel, and pixels along the side of a block.
const SIZE: [u32; 2] = [240, 160];
const PATHS: u32 = 48;
const BLOCK: usize = 20;
const FRAMES: usize = 3;

/// A lawn that can be drawn in all ways.
struct Lawn {
    scene: LoadedScene,
    base: viewer::Scene,
}

impl Lawn {
    /// A lawn with this many blades on a square metre, on a square of this many rectangles of 400 mm.
    fn new(per_m2: f64, tiles: usize) -> Result<Lawn> {
        Lawn::with(meadow(per_m2)?, tiles, "")
    }

    /// A lawn of a meadow, with more fields.
    fn with(meadow: String, tiles: usize, more: &str) -> Result<Lawn> {
        let folder = tempfile::tempdir().map_err(|e| Error::Missed(format!("no folder for a lawn: {e}")))?;
        let write =
            |name: &str, text: String| mesophyll_files::atomic::write_bytes(&folder.path().join(name), text.as_bytes());
        write("lawn.toml", meadow)?;
        let lights = "[ground]\nalbedo = [0.06, 0.045, 0.03]\nreach_mm = 20000\n[sun]\nzenith_deg = 50\nazimuth_deg = \
                      250\n\
                      irradiance = [10, 9.6, 9]\n[sky]\nradiance = [0.7, 0.85, 1.1]\n";
        let view = "[[view]]\nname = \"lawn\"\nkind = \"perspective\"\neye_mm = [0, -900, 400]\ntarget_mm = [0, 0, 0]\n\
                    fov_deg = 20\n";
        let grass = format!("[[grass]]\nname = \"lawn\"\nmeadow = \"lawn.toml\"\ntiles = [{tiles}, {tiles}]\n{more}");
        write("scene.toml", format!("schema = 1\nname = \"lawn\"\nexposure = 0.35\n{grass}{lights}{view}"))?;
        let ledger = Ledger::new();
        let manifest = SceneManifest::read(&folder.path().join("scene.toml"))?;
        let scene = LoadedScene::open(manifest, LeafSearch::default(), &ledger)?;
        let base = handover::scene(&scene, &ledger)?;
        Ok(Lawn { scene, base })
    }

    fn drawn(&self, way: Drawn) -> viewer::Scene {
        let mut out = self.base.clone();
        let with = |change: &dyn Fn(&mut viewer::Grass)| {
            let mut grass = self.base.grass[0].as_ref().clone();
            change(&mut grass);
            vec![Arc::new(grass)]
        };
        match way {
            Drawn::Slices(steps) => out.grass = with(&|g| g.steps = steps),
            Drawn::Billboards => out.grass = with(&|g| g.billboards = true),
            Drawn::Blades => self.blades(&mut out),
        }
        out
    }

    fn blades(&self, out: &mut viewer::Scene) {
        out.grass.clear();
        (out.shadow_samples, out.shadow_resolution) = (1, 4096);
        let lawn = &self.scene.placed.grass[0];
        let of_shape = |blade: &mesophyll_plants::form::Blade| {
            let optics = lawn.leaves[&blade.material];
            let rgb = |c: [f64; 3]| c.map(|v| v as f32);
            let side = |side: Side| viewer::SideMaps {
                interior: viewer::Interior::Maps {
                    rho_d: vec![rgb(optics.rho_d[side as usize])],
                    rho_t: vec![rgb(optics.rho_t)],
                },
                ..viewer::SideMaps::black()
            };
            let leaf = viewer::LeafMaterial {
                name: blade.material.clone(),
                width: 1,
                height: 1,
                thickness_mm: 1.0,
                lobe: viewer::Lobe::Beckmann,
                sides: viewer::Sides::of(side),
                mask: None,
            };
            out.add(handover::with_details(&blade.mesh, Some(&leaf), true), viewer::Material::Leaf(leaf))
        };
        let shapes: Vec<viewer::Instance> = lawn.plant.blades.iter().map(of_shape).collect();
        for place in lawn.places() {
            let at = |leaf: &mesophyll_plants::form::Leaf| viewer::Instance {
                transform: (place * leaf.transform).as_mat4(),
                ..shapes[leaf.blade]
            };
            out.instances.extend(lawn.plant.leaves.iter().map(at));
        }
    }
}

/// The description of the lawn, with another number of blades on a square metre.
fn meadow(per_m2: f64) -> Result<String> {
    let own = format!("\nper_m2 = {PER_M2}\n");
    match LAWN.matches(&own).count() {
        1 => Ok(LAWN.replace(&own, &format!("\nper_m2 = {per_m2}\n"))),
        found => {
            let told = format!("found {found} lines `{}`, expected one, which is changed", own.trim());
            Err(Error::field(Path::new("data/grass/lawn.toml"), "per_m2", told))
        }
    }
}

/// A camera at an elevation (degrees) and a distance from the lawn's middle (mm). It sees `seen` mm of the lawn from
/// top to bottom.
fn camera(elevation: f64, distance: f64, seen: f64) -> (viewer::Camera, transport::ReferenceCamera) {
    let ((se, ce), (sa, ca)) = (elevation.to_radians().sin_cos(), 20f64.to_radians().sin_cos());
    let (eye, target) = (distance * DVec3::new(ce * ca, ce * sa, se), DVec3::new(0.0, 0.0, 20.0));
    let up = if elevation > 80.0 { DVec3::Y } else { DVec3::Z };
    let fov_y_deg = 2.0 * (0.5 * seen / distance).atan().to_degrees();
    let vec = |v: DVec3| -> Vec3 { v.as_vec3() };
    let here = viewer::Camera { eye: vec(eye), target: vec(target), up: vec(up), fov_y_deg: fov_y_deg as f32 };
    (here, transport::ReferenceCamera { eye, target, up, fov_y_deg })
}

/// The error of a picture: the 99th percentile of FLIP, and the root mean square of the relative difference of the
/// means of blocks.
fn apart(truth: &ReferencePicture, picture: &gpu::Picture) -> Result<(f64, f64)> {
    let flip = compare(truth, &picture.ldr)?.flip_p99;
    let means = |hdr: &[[f32; 4]]| blocks::means(hdr, [truth.width, truth.height], BLOCK);
    let (right, found) = (means(&truth.hdr), means(&picture.hdr));
    let off = right.iter().zip(&found).map(|(r, f)| (f64::from(f[1]) / f64::from(r[1]) - 1.0).powi(2));
    Ok((flip, (off.sum::<f64>() / right.len() as f64).sqrt()))
}

fn frame(renderer: &mut gpu::Renderer, camera: &viewer::Camera, [w, h]: [u32; 2]) -> Result<f64> {
    let timing = renderer.time(camera, w, h, FRAMES).map_err(told)?;
    Ok(1e3 * timing.quantile(0.5).unwrap_or(f64::NAN))
}

impl Drawn {
    fn name(self) -> String {
        match self {
            Drawn::Slices(steps) => format!("slices, {steps} steps"),
            Drawn::Billboards => "billboards".into(),
            Drawn::Blades => "blades".into(),
        }
    }
}

/// All rows, drawn in one run on one adapter, whose name the notes give. Without an adapter there are no rows, and a
/// message says so.
///
/// # Errors
/// Those of opening the adapter, reading and drawing, and [`mesophyll_base::error::Error::Interrupted`] after a stop.
pub fn rows(bar: &TaskProgress) -> Result<Vec<BenchRow>> {
    let mut renderer = match gpu::Renderer::headless(&gpu::Options::default()) {
        Err(gpu::Error::NoAdapter) => {
            progress::say("no graphics adapter: the rows of drawn lawns are left out");
            bar.advance(PIECES);
            return Ok(Vec::new());
        }
        other => other.map_err(told)?,
    };
    let adapter = renderer.adapter().name.clone();
    let mut rows = Vec::new();
    let lawn = Lawn::new(PER_M2, 4)?;
    let world = reference::traced(&lawn.scene, 0.0, &Ledger::new())?;
    let truth = SceneReference::new(&world, true)?;
    let all = [Drawn::Slices(64), Drawn::Slices(16), Drawn::Slices(4), Drawn::Billboards, Drawn::Blades];
    let mut judged =
        |truth: &SceneReference, lawn: &Lawn, knob: &str, setting: f64, unit: &str, eye: (f64, f64, f64)| {
            let (here, there) = camera(eye.0, eye.1, eye.2);
            let [w, h] = SIZE.map(|n| n as usize);
            let sampling = |seed| ReferenceSampling { size: [w, h], samples: PATHS, sun_samples: 4, seed };
            let right = truth.draw(&there, "lawn", sampling(1))?;
            let noise = compare(&right, &truth.draw(&there, "lawn", sampling(2))?.ldr)?.flip_p99;
            for way in all {
                renderer.set_scene(&lawn.drawn(way)).map_err(told)?;
                let picture = renderer.render(&here, SIZE[0], SIZE[1]).map_err(told)?;
                let (error, off) = apart(&right, &picture)?;
                let us = frame(&mut renderer, &here, SIZE)?;
                rows.push(BenchRow {
                model: "grass".into(),
                knob: knob.into(),
                setting: format!("{setting}{unit}: {}", way.name()),
                error,
                us,
                note: format!(
                    "FLIP 99 % against path-traced blades (their noise {noise:.2}); means of blocks are off by {:.0} \
                     %; {}x{} pixels on {adapter}",
                    100.0 * off,
                    SIZE[0],
                    SIZE[1]
                ),
            });
            }
            bar.step()
        };
    for elevation in ELEVATIONS {
        judged(&truth, &lawn, "elevation", elevation, "°", (elevation, 1200.0, 200.0))?;
    }
    let wide = Lawn::new(PER_M2, 8)?;
    let world = reference::traced(&wide.scene, 0.0, &Ledger::new())?;
    let truth = SceneReference::new(&world, true)?;
    for distance in DISTANCES {
        judged(&truth, &wide, "distance", distance / 1e3, " m", (35.0, distance, 0.3 * distance))?;
    }
    rows.extend(densities(&adapter, bar)?);
    for (size, steps, speed_up) in TABLE {
        let mut times = [0.0; 2];
        for (time, way) in times.iter_mut().zip([Drawn::Slices(steps), Drawn::Billboards]) {
            renderer.set_scene(&lawn.drawn(way)).map_err(told)?;
            *time = frame(&mut renderer, &camera(25.0, 1200.0, 300.0).0, size)?;
        }
        rows.push(BenchRow {
            model: "grass".into(),
            knob: "Table 2.1".into(),
            setting: format!("{}x{}, {steps} steps", size[0], size[1]),
            error: f64::NAN,
            us: times[0],
            note: format!(
                "billboards take {:.2} times as long as slices; {speed_up} in the dissertation, on other adapters; \
                 {adapter}",
                times[1] / times[0]
            ),
        });
        bar.step()?;
    }
    rows.extend(repetition(&mut renderer)?);
    bar.step()?;
    rows.push(ridge::row(&mut renderer)?);
    bar.step()?;
    Ok(rows)
}

/// What a frame costs as the lawn gets denser. Each density has a renderer of its own, and they draw by turns, so that
/// all have the same share of a busy machine.
///
/// # Errors
/// Those of opening the adapter, reading and drawing, and [`mesophyll_base::error::Error::Interrupted`] after a stop.
fn densities(adapter: &str, bar: &TaskProgress) -> Result<Vec<BenchRow>> {
    const TURNS: usize = 9;
    let lawns: Vec<Lawn> = DENSITIES.iter().map(|d| Lawn::new(PER_M2 / 4.0 * d, 4)).collect::<Result<_>>()?;
    let open = |_: &f64| gpu::Renderer::headless(&gpu::Options::default()).map_err(told);
    let mut renderers: Vec<gpu::Renderer> = DENSITIES.iter().map(open).collect::<Result<_>>()?;
    let mut rows = Vec::new();
    for way in [Drawn::Slices(16), Drawn::Billboards, Drawn::Blades] {
        for (renderer, lawn) in renderers.iter_mut().zip(&lawns) {
            renderer.set_scene(&lawn.drawn(way)).map_err(told)?;
        }
        let mut times = [[0.0; TURNS]; DENSITIES.len()];
        for turn in 0..TURNS {
            for (renderer, times) in renderers.iter_mut().zip(&mut times) {
                times[turn] = frame(renderer, &camera(35.0, 1200.0, 300.0).0, [480, 320])?;
            }
        }
        let medians = times.map(|t| median_of(t).unwrap_or(0.0));
        rows.extend(DENSITIES.iter().enumerate().map(|(k, density)| BenchRow {
            model: "grass".into(),
            knob: "density".into(),
            setting: format!("x {density}: {}", way.name()),
            error: f64::NAN,
            us: medians[k],
            note: format!(
                "{:.2} times the time of the thinnest lawn ({:.0} blades a square metre), drawn by turns; 480x320 on \
                 {adapter}",
                medians[k] / medians[0],
                PER_M2 / 4.0
            ),
        }));
        bar.step()?;
    }
    Ok(rows)
}

/// How much 8 x 8 rectangles in the middle of a lawn repeat, seen from above at 24 pixels a rectangle, where rectangles
/// are all alike and where they are irregular. In the sun, the slices themselves show, which stand at the same places
/// in all rectangles. A lag of 14 of the 16 slices tells this from a repetition of the meadow.
///
/// # Errors
/// Those of reading and drawing.
fn repetition(renderer: &mut gpu::Renderer) -> Result<Vec<BenchRow>> {
    const RECTANGLES: usize = 8;
    const PIXELS: usize = 24;
    let side = RECTANGLES * PIXELS;
    let mut rows = Vec::new();
    for (name, meadow) in [("lawn", LAWN), ("clover", CLOVER)] {
        let lawn = Lawn::with(meadow.to_string(), RECTANGLES + 2, "irregular_seed = 7\n")?;
        let (above, _) = camera(90.0, 400_000.0, RECTANGLES as f64 * lawn.scene.placed.grass[0].period[1]);
        for way in ["all alike", "irregular"] {
            let mut drawn = lawn.base.clone();
            if way == "all alike" {
                drawn.grass = vec![Arc::new(viewer::Grass { irregular: None, ..lawn.base.grass[0].as_ref().clone() })];
            }
            let mut told_of = Vec::new();
            let mut us = f64::NAN;
            for light in ["in the sun", "under the sky alone"] {
                renderer.set_scene(&drawn).map_err(told)?;
                if drawn.sun.take().is_some() {
                    us = frame(renderer, &camera(35.0, 1200.0, 300.0).0, [480, 320])?;
                }
                let picture = renderer.render(&above, side as u32, side as u32).map_err(told)?;
                let green: Vec<f64> = picture.hdr.iter().map(|p| f64::from(p[1])).collect();
                let at = |lag| repeats::autocorrelation(&green, side, lag);
                told_of.push(format!(
                    "{light}: a rectangle along x {:.2}, along y {:.2}, 14 slices along x {:.2}, largest at a multiple \
                     of an eighth {:.2}",
                    at([PIXELS, 0]),
                    at([0, PIXELS]),
                    at([PIXELS * 14 / 16, 0]),
                    repeats::largest(&green, side, [PIXELS; 2])
                ));
            }
            let adapter = &renderer.adapter().name;
            let note =
                format!("autocorrelation from above; {}; time of 480x320 from 35°; {adapter}", told_of.join("; "));
            rows.push(BenchRow {
                model: "grass".into(),
                knob: "repetition".into(),
                setting: format!("{name}, rectangles {way}"),
                error: f64::NAN,
                us,
                note,
            });
        }
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_number_of_blades_is_changed() {
        let thin = meadow(0.25 * PER_M2).unwrap();
        let changed: Vec<_> = LAWN.lines().zip(thin.lines()).filter(|(a, b)| a != b).collect();
        assert_eq!(changed, [("per_m2 = 21000", "per_m2 = 5250")]);
        assert_eq!(meadow(PER_M2).unwrap(), LAWN);
    }
}
