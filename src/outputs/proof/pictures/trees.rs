//! What the motion of a tree costs beside drawing it (H9 Table 4.3). The tree has the numbers of the dissertation's:
//! 1,500 branches of four levels, 10,000 leaves, and about 75,000 vertices. It is drawn at rest and in a wind, by turns
//! on two renderers of one adapter, so that both have the same share of a busy machine.
//!
//! As in the table, shadow maps are drawn for each frame, at rest too.

use super::BenchRow;
use mesophyll_base::error::{Error, Result};
use mesophyll_base::statistics::{median_of, percentile};
use mesophyll_check::told;
use mesophyll_files::progress::{self, TaskProgress};
use mesophyll_scene::draw::handover;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::placed::leaf::LeafSearch;
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_transport::comparison::flip_map;
use mesophyll_viewer as gpu;
use mesophyll_viewer::scene as viewer;
use std::time::Instant;

/// A leaf: a flat quad, as in the dissertation, which hangs at the origin and lies along x (mm).
const LEAF: [[f32; 8]; 4] = [
    [0.0, -18.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
    [62.0, -18.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0],
    [62.0, 18.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
    [0.0, 18.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0],
];
pub(crate) const LEAF_FILE: &str = r#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}, "indices": 3}]}],
    "buffers": [{"uri": "leaf.bin", "byteLength": 140}],
    "bufferViews": [{"buffer": 0, "byteLength": 128, "byteStride": 32},
        {"buffer": 0, "byteOffset": 128, "byteLength": 12}],
    "accessors": [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, -18, 0], "max": [62, 18, 0]},
        {"bufferView": 0, "byteOffset": 12, "componentType": 5126, "count": 4, "type": "VEC3"},
        {"bufferView": 0, "byteOffset": 24, "componentType": 5126, "count": 4, "type": "VEC2"},
        {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}]}"#;
pub(crate) const TREE: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/plants/wych-elm.toml"));
/// Pixels of a picture.
const SIZE: [u32; 2] = [800, 600];
/// How many frames are drawn at a time: the first number of them without being timed, then the second number. A GPU
/// draws while the processor prepares the next frame, as in a program that shows them; a frame that nothing follows
/// would not tell what that costs. Software adapters draw on the processor, so there each frame is measured by itself.
const ON_GPU: [usize; 2] = [4, 60];
const BY_SOFTWARE: [usize; 2] = [0, 1];
/// The time between two frames (s).
const STEP: f64 = 1.0 / 30.0;
/// Steps of the progress bar.
pub const PIECES: u64 = WAYS.len() as u64;

/// A row of Table 4.3.
struct Way {
    name: &'static str,
    trees: usize,
    lit: bool,
    /// Whether motion is simplified.
    simplified: bool,
    /// What the dissertation states: frames a second at rest and in motion, and milliseconds of the motion alone.
    printed: [f64; 3],
    /// How many pairs of frames are drawn, one at rest and one in motion, of which the median counts. There are more
    /// where a frame is quick and its motion costs little.
    pairs: usize,
}

const WAYS: [Way; 4] = [
    Way { name: "unshaded", trees: 1, lit: false, simplified: false, printed: [299.0, 290.0, 0.104], pairs: 151 },
    Way { name: "shaded", trees: 1, lit: true, simplified: false, printed: [56.0, 48.0, 1.49], pairs: 31 },
    Way { name: "simplified", trees: 1, lit: true, simplified: true, printed: [56.0, 52.0, 0.68], pairs: 31 },
    Way { name: "4 trees", trees: 4, lit: true, simplified: false, printed: [49.0, 32.0, 5.4], pairs: 31 },
];

/// The buffer of [`LEAF_FILE`].
pub(crate) fn leaf_bytes() -> Vec<u8> {
    let corners = LEAF.as_flattened().iter().flat_map(|v| v.to_le_bytes());
    let triangles = [0u16, 1, 2, 0, 2, 3].into_iter().flat_map(u16::to_le_bytes);
    corners.chain(triangles).collect()
}

/// A scene with these trees in a wind, and its camera.
fn scene(way: &Way) -> Result<(viewer::Scene, viewer::Camera)> {
    let folder = tempfile::tempdir().map_err(|e| Error::Missed(format!("no folder for a tree: {e}")))?;
    let write = |name: &str, bytes: &[u8]| mesophyll_files::atomic::write_bytes(&folder.path().join(name), bytes);
    write("tree.toml", TREE.as_bytes())?;
    write("leaf.gltf", LEAF_FILE.as_bytes())?;
    write("leaf.bin", &leaf_bytes())?;
    let plant = |k: usize| {
        let [x, y] = [(k % 2) as f64, (k / 2) as f64].map(|v| 5500.0 * v);
        format!(
            "[[plant]]\ngrow = \"tree.toml\"\nposition_mm = [{x}, {y}, 0]\nrotation_deg = [0, 0, {}]\n\
             materials = {{ leaf = \"leaf\", bark = [0.11, 0.085, 0.06] }}\n",
            97 * k
        )
    };
    let lights = if way.lit {
        "[sun]\nzenith_deg = 52\nazimuth_deg = 65\n[sky]\nmodel = \"preetham\"\nturbidity = 3\n"
    } else {
        "[sky]\nradiance = [1, 1, 1]\n"
    };
    let leaf = "[[leaf]]\nname = \"leaf\"\nmesh = \"leaf.gltf\"\nmesh_unit = \"mm\"\nuniform = { rho_d = [[0.06, 0.1, \
                0.03], [0.09, 0.14, 0.06]], rho_t = [0.05, 0.1, 0.02], rho_s = [0.03, 0.03, 0.03] }\n";
    let wind = format!("[wind]\nspeed_m_s = 6\nseed = 3\nsimplified = {}\n", way.simplified);
    let view = "[[view]]\nname = \"tree\"\nkind = \"perspective\"\neye_mm = [-700, -8600, 1800]\ntarget_mm = [0, 0, \
                2500]\n\
                fov_deg = 42\n";
    let plants: String = (0..way.trees).map(plant).collect();
    write(
        "scene.toml",
        format!("schema = 1\nname = \"trees\"\nexposure = 0.14\n{leaf}{plants}{lights}{wind}{view}").as_bytes(),
    )?;
    let ledger = Ledger::new();
    let manifest = SceneManifest::read(&folder.path().join("scene.toml"))?;
    let opened = LoadedScene::open(manifest, LeafSearch::default(), &ledger)?;
    let mut out = handover::scene(&opened, &ledger)?;
    out.shadow_samples = 1;
    if !way.lit {
        let plain = |m: &viewer::Material| {
            viewer::Material::Opaque(viewer::OpaqueMaterial {
                name: m.name().into(),
                albedo: [0.1, 0.2, 0.05],
                pattern: None,
            })
        };
        out.materials = out.materials.iter().map(plain).collect();
    }
    let view = opened.manifest.perspectives().next().expect("the scene above has one view");
    Ok((out, handover::camera(&view.camera)))
}

/// Two renderers on one adapter.
struct Pair {
    still: gpu::Renderer,
    moving: gpu::Renderer,
}

/// Median times (µs): of a frame at rest, of a frame in motion, and of the CPU's part of the pose, which is a part of
/// the latter. And how many times as long the second frame of a pair takes as the first: the median, and the interval
/// that holds it with a probability of 95 %.
struct Times {
    still: f64,
    moving: f64,
    posing: f64,
    ratio: f64,
    between: [f64; 2],
}

/// Where, in an ordered list of so many values, the one stands below which the true median lies with a probability of
/// at most 2.5 %. Each value is below the median as often as a coin falls heads. The number of heads is nearly normal,
/// and its standard deviation is half the root of the number of coins.
fn below_median(values: usize) -> usize {
    let n = values as f64;
    ((n - 1.96 * n.sqrt()) / 2.0 - 1.0).max(0.0) as usize
}

/// Draws frames, before each of which something is done, which gets the frame's number. The time of a frame, and the
/// part of it that was needed to do that (µs).
fn frames(
    renderer: &mut gpu::Renderer,
    camera: &viewer::Camera,
    mut prepare: impl FnMut(&mut gpu::Renderer, usize) -> Result<()>,
) -> Result<[f64; 2]> {
    let ([w, h], [before, timed]) = (SIZE, if renderer.adapter().is_software { BY_SOFTWARE } else { ON_GPU });
    let (mut clock, mut preparing) = (Instant::now(), 0.0);
    for n in 0..before + timed {
        let start = Instant::now();
        if n == before {
            (clock, preparing) = (start, 0.0);
        }
        prepare(renderer, n)?;
        preparing += start.elapsed().as_secs_f64();
        if timed == 1 {
            renderer.draw(camera, w, h).map_err(told)?;
        } else {
            renderer.draw_ahead(camera, w, h).map_err(told)?;
        }
    }
    let took = clock.elapsed().as_secs_f64();
    gpu::readback::wait(renderer.gpu()).map_err(told)?;
    Ok([took, preparing].map(|s| 1e6 * s / timed as f64))
}

fn times(pair: &mut Pair, scene: &viewer::Scene, camera: &viewer::Camera, pairs: usize) -> Result<Times> {
    let mut rest = viewer::Scene { sections: None, wind: None, ..scene.clone() };
    rest.instances.iter_mut().for_each(|i| i.carried = None);
    let [w, h] = SIZE;
    pair.moving.set_scene(scene).map_err(told)?;
    pair.moving.draw(camera, w, h).map_err(told)?;
    // Shadow maps of what moves have no more texels than the picture shows. Those of the tree at rest get as many.
    if scene.sun.is_some() {
        rest.shadow_resolution = pair.moving.stats().shadow_side;
    }
    pair.still.set_scene(&rest).map_err(told)?;
    let mut all = [const { Vec::new() }; 4];
    let (mut lights, mut time_s) = (rest, 0.0);
    // The first pair is not counted.
    for k in 0..=pairs {
        let mut at_rest = || {
            frames(&mut pair.still, camera, |renderer, n| {
                // The sun moves to and fro by nothing that can be seen, so that its shadow maps are drawn again.
                if let Some(sun) = &mut lights.sun {
                    sun.direction.x += if (k + n) % 2 == 0 { 1e-6 } else { -1e-6 };
                    renderer.set_lights(&lights).map_err(told)?;
                }
                Ok(())
            })
        };
        let mut in_motion = || {
            frames(&mut pair.moving, camera, |renderer, _| {
                time_s += STEP;
                renderer.set_time(&viewer::WindState { time_s });
                Ok(())
            })
        };
        // Each of the two goes first in turn.
        let ([still, _], [moving, posing]) = if k % 2 == 1 {
            let first = in_motion()?;
            (at_rest()?, first)
        } else {
            (at_rest()?, in_motion()?)
        };
        if k > 0 {
            let numbers = [still, moving, posing, moving / still];
            all.iter_mut().zip(numbers).for_each(|(list, number)| list.push(number));
        }
    }
    all[3].sort_by(f64::total_cmp);
    let first = below_median(pairs);
    let between = [first, pairs - 1 - first].map(|k| all[3][k]);
    let [still, moving, posing, ratio] = all.map(|numbers| median_of(numbers).unwrap_or(0.0));
    Ok(Times { still, moving, posing, ratio, between })
}

/// The table, drawn in one run on one adapter, whose name the notes give. Without an adapter there are no rows, and a
/// message says so.
///
/// # Errors
/// Those of opening the adapter, of reading and of drawing, and [`mesophyll_base::error::Error::Interrupted`] after a
/// stop.
pub fn rows(bar: &TaskProgress) -> Result<Vec<BenchRow>> {
    let open = || gpu::Renderer::headless(&gpu::Options::default());
    let mut pair = match (open(), open()) {
        (Err(gpu::Error::NoAdapter), _) | (_, Err(gpu::Error::NoAdapter)) => {
            progress::say("no graphics adapter: the rows of moving trees are left out");
            bar.advance(PIECES);
            return Ok(Vec::new());
        }
        (still, moving) => Pair { still: still.map_err(told)?, moving: moving.map_err(told)? },
    };
    let gpu::AdapterInfo { name: adapter, is_software: software, .. } = pair.moving.adapter().clone();
    let mut rows = Vec::new();
    let mut full = Vec::new();
    for way in &WAYS {
        let (scene, camera) = scene(way)?;
        let seen = times(&mut pair, &scene, &camera, way.pairs)?;
        // Both kinds of adapter compare pictures of the same time.
        pair.moving.set_time(&viewer::WindState { time_s: 1.0 });
        let picture = pair.moving.render(&camera, SIZE[0], SIZE[1]).map_err(told)?.ldr;
        let mut error = f64::NAN;
        if way.simplified {
            let mut off = flip_map(&full, &picture, SIZE[0] as usize, SIZE[1] as usize);
            off.sort_by(f32::total_cmp);
            error = percentile(&off, 0.99).map_or(f64::NAN, f64::from);
        } else if way.lit && way.trees == 1 {
            full = picture;
        }
        let vertices: usize = scene.instances.iter().map(|i| scene.meshes[i.mesh].positions.len()).sum();
        let [still, moving, ms] = way.printed;
        rows.push(BenchRow {
            model: "wind".into(),
            knob: "Table 4.3".into(),
            setting: format!("{}: at rest", way.name),
            error: f64::NAN,
            us: seen.still,
            note: format!(
                "{} instances with {vertices} vertices; {}x{} on {adapter}{}",
                scene.instances.len(),
                SIZE[0],
                SIZE[1],
                if software { "" } else { ", which draws while the processor prepares the next frame" }
            ),
        });
        rows.push(BenchRow {
            model: "wind".into(),
            knob: "Table 4.3".into(),
            setting: format!("{}: in motion", way.name),
            error,
            us: seen.moving,
            note: format!(
                "{:.3} times a frame at rest, {:.3} to {:.3} with a probability of 95 % ({:.3} in the dissertation); \
                 the CPU's part, an amplitude for each branch, takes {:.2} ms; motion adds {:.2} ms in all ({ms} ms \
                 there, on another adapter)",
                seen.ratio,
                seen.between[0],
                seen.between[1],
                still / moving,
                1e-3 * seen.posing,
                1e-3 * (seen.moving - seen.still)
            ),
        });
        bar.step()?;
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The probability that the true median lies below the value found is that of so few heads, summed one by one.
    #[test]
    fn the_interval_of_a_median_holds_it_with_95_percent() {
        let mut pairs: Vec<usize> = WAYS.iter().map(|way| way.pairs).collect();
        pairs.push(1001);
        for n in pairs {
            let place = below_median(n);
            // In logarithms, so that no probability is rounded to 0.
            let (mut of, mut sums) = (-(n as f64) * 2f64.ln(), [0.0; 2]);
            for heads in 0..=place + 2 {
                sums[0] += if heads <= place { of.exp() } else { 0.0 };
                sums[1] += of.exp();
                of += ((n - heads) as f64 / (heads + 1) as f64).ln();
            }
            // Two places on, the probability would be too large: the interval is not much wider than it must be.
            assert!(sums[0] <= 0.025 && sums[1] > 0.025, "{n} pairs: {sums:?}");
        }
    }
}
