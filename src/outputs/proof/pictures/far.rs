//! What a plant costs at a distance. The park elm of `bench wind`, with 10,000 leaves that are curved and have teeth,
//! is drawn from near to far: as always, without flat leaves and without simpler wood, and with everything in full
//! detail. The three draw by turns on renderers of one adapter, so that all have the same share of a busy machine.
//! Radiance and coverage are compared with a picture in full detail that has sixteen times as many pixels.
//!
//! Sun and sky are constant and the background is black. So the picture's mean radiance is what the plant sends, and
//! its mean opacity is what it covers.

use super::BenchRow;
use super::trees::{LEAF_FILE, TREE};
use glam::{DVec2, Vec3};
use mesophyll_base::error::{Error, Result};
use mesophyll_base::statistics::median_of;
use mesophyll_check::told;
use mesophyll_files::mesh::{LeafMesh, vertex_normals, vertex_tangents};
use mesophyll_files::progress::{self, TaskProgress};
use mesophyll_scene::draw::handover;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::placed::leaf::LeafSearch;
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_viewer as gpu;
use mesophyll_viewer::scene as viewer;
use std::time::Instant;

/// Distances of the camera from the plant's middle (m).
const DISTANCES: [f64; 6] = [8.0, 30.0, 60.0, 120.0, 240.0, 480.0];
/// Pixels of a picture, frames of which the median counts, and the opening angle (degrees).
const SIZE: [u32; 2] = [800, 600];
const FRAMES: usize = 5;
/// The picture in full detail, with which radiance and coverage are compared, has this many times as many pixels along
/// each side. With as many as the others, leaves far smaller than a pixel would fall between its samples: at 240 m such
/// a picture is 3 % too dark.
const FINER: u32 = 4;
const FOV_DEG: f32 = 42.0;
/// Number of sides from which radiance and coverage are measured.
const SIDES: u32 = 4;
const SCENE: &str = r#"schema = 1
name = "far"
exposure = 0.14
[[leaf]]
name = "leaf"
mesh = "leaf.gltf"
mesh_unit = "mm"
uniform = { rho_d = [[0.06, 0.1, 0.03], [0.09, 0.14, 0.06]], rho_t = [0.05, 0.1, 0.02], rho_s = [0.03, 0.03, 0.03] }
[[plant]]
grow = "tree.toml"
materials = { leaf = "leaf", bark = [0.11, 0.085, 0.06] }
[sun]
zenith_deg = 52
azimuth_deg = 65
irradiance = [10, 9.6, 9]
[sky]
radiance = [1, 1, 1]
[[view]]
name = "tree"
kind = "perspective"
eye_mm = [0, -8000, 1800]
target_mm = [0, 0, 2500]
fov_deg = 42
"#;
/// Steps of the progress bar.
pub const PIECES: u64 = DISTANCES.len() as u64;

/// A leaf with teeth, as long and as wide as that of `bench wind` (mm): 20 strips of 8 quads. It is flat where `curved`
/// is 0.
fn blade(curved: f64) -> LeafMesh {
    const STRIPS: u32 = 20;
    const ACROSS: u32 = 8;
    let mut mesh = LeafMesh::default();
    for i in 0..=STRIPS {
        let t = f64::from(i) / f64::from(STRIPS);
        let wide = 18.0 * (0.02 + (std::f64::consts::PI * t.powf(0.8)).sin()) * if i % 2 == 0 { 1.0 } else { 0.93 };
        for j in 0..=ACROSS {
            let across = 2.0 * f64::from(j) / f64::from(ACROSS) - 1.0;
            let p = DVec2::new(62.0 * t, wide * across);
            mesh.positions.push(p.extend(curved * (0.004 * (p.x - 31.0).powi(2) + 0.01 * p.y * p.y)));
            mesh.uvs.push(DVec2::new(t, 0.5 - p.y / 37.0));
        }
    }
    let id = |i: u32, j: u32| i * (ACROSS + 1) + j;
    for (i, j) in (0..STRIPS).flat_map(|i| (0..ACROSS).map(move |j| (i, j))) {
        mesh.indices.extend([id(i, j), id(i + 1, j), id(i + 1, j + 1), id(i, j), id(i + 1, j + 1), id(i, j + 1)]);
    }
    mesh.normals = vertex_normals(&mesh);
    mesh.tangents = vertex_tangents(&mesh);
    mesh
}

/// The plant, drawn as always.
fn scene() -> Result<viewer::Scene> {
    let folder = tempfile::tempdir().map_err(|e| Error::Missed(format!("no folder for a tree: {e}")))?;
    let write = |name: &str, bytes: &[u8]| mesophyll_files::atomic::write_bytes(&folder.path().join(name), bytes);
    write("tree.toml", TREE.as_bytes())?;
    write("leaf.gltf", LEAF_FILE.as_bytes())?;
    write("leaf.bin", &super::trees::leaf_bytes())?;
    write("scene.toml", SCENE.as_bytes())?;
    let ledger = Ledger::new();
    let mut opened =
        LoadedScene::open(SceneManifest::read(&folder.path().join("scene.toml"))?, LeafSearch::default(), &ledger)?;
    opened.placed.leaves.iter_mut().for_each(|leaf| leaf.mesh = Some(blade(1.0)));
    let mut out = handover::scene(&opened, &ledger)?;
    out.shadow_samples = 1;
    Ok(out)
}

/// The same without the levels that have vertices of their own: flat leaves and simpler wood.
fn without_flat(scene: &viewer::Scene) -> viewer::Scene {
    let mut out = scene.clone();
    for mesh in &mut out.meshes {
        let own = mesh.indices.iter().max().copied().unwrap_or(0);
        mesh.details.retain(|d| d.indices.iter().all(|k| *k <= own));
    }
    out
}

/// The same with only the leaves, of one triangle each, so that the triangles of a picture are its leaves.
fn one_triangle_each(scene: &viewer::Scene) -> viewer::Scene {
    let mut out = scene.clone();
    out.instances.retain(|i| scene.leaf(i.material).is_some());
    for mesh in &mut out.meshes {
        mesh.indices.truncate(3);
        mesh.details.clear();
    }
    (out.sun, out.shadow_samples) = (None, 0);
    out
}

/// The camera at a distance, on one of [`SIDES`] sides.
fn camera(distance_m: f64, side: u32) -> viewer::Camera {
    let target = Vec3::new(0.0, 0.0, 2500.0);
    let (sin, cos) = (std::f32::consts::TAU * (side as f32 + 0.2) / SIDES as f32).sin_cos();
    let eye = target + 1e3 * distance_m as f32 * Vec3::new(cos, sin, 0.15).normalize();
    viewer::Camera { eye, target, up: Vec3::Z, fov_y_deg: FOV_DEG }
}

/// Mean radiance (green) and mean opacity of a picture.
fn means(picture: &gpu::Picture) -> [f64; 2] {
    [1, 3].map(|c| picture.hdr.iter().map(|p| f64::from(p[c])).sum::<f64>() / picture.hdr.len() as f64)
}

/// The rows, drawn in one run on one adapter, whose name the notes give. The error is that of the radiance, relative to
/// the plant in full detail. Without an adapter there are no rows, and a message says so.
///
/// # Errors
/// Those of opening the adapter, of reading and of drawing, and [`mesophyll_base::error::Error::Interrupted`] after a
/// stop.
pub fn rows(bar: &TaskProgress) -> Result<Vec<BenchRow>> {
    let open = || gpu::Renderer::headless(&gpu::Options::default());
    let mut renderers = match open() {
        Err(gpu::Error::NoAdapter) => {
            progress::say("no graphics adapter: the rows of far plants are left out");
            bar.advance(PIECES);
            return Ok(Vec::new());
        }
        first => vec![first.map_err(told)?],
    };
    let adapter = renderers[0].adapter().name.clone();
    let scene = scene()?;
    let mut in_full = scene.clone();
    in_full.in_full = true;
    let ways = [scene.clone(), without_flat(&scene), in_full, one_triangle_each(&scene)];
    const IN_FULL: usize = 2;
    while renderers.len() < ways.len() {
        renderers.push(open().map_err(told)?);
    }
    for (renderer, way) in renderers.iter_mut().zip(&ways) {
        renderer.set_scene(way).map_err(told)?;
    }
    let [w, h] = SIZE;
    let mut rows = Vec::new();
    for distance in DISTANCES {
        let mut seen = [([0.0; 2], 0); 4];
        for side in (0..SIDES).rev() {
            for (way, (renderer, (sums, triangles))) in renderers.iter_mut().zip(&mut seen).enumerate() {
                let finer = if way == IN_FULL { FINER } else { 1 };
                let picture = renderer.render(&camera(distance, side), finer * w, finer * h).map_err(told)?;
                means(&picture).into_iter().zip(sums).for_each(|(mean, sum)| *sum += mean);
                *triangles = renderer.stats().triangles;
            }
        }
        let camera = camera(distance, 0);
        let mut times = [const { Vec::new() }; 3];
        for _ in 0..FRAMES {
            for (renderer, list) in renderers.iter_mut().zip(&mut times) {
                let clock = Instant::now();
                renderer.draw(&camera, w, h).map_err(told)?;
                list.push(1e6 * clock.elapsed().as_secs_f64());
            }
        }
        let [us, plain, full] = times.map(|list| median_of(list).unwrap_or(0.0));
        let off = |way: usize, c: usize| seen[way].0[c] / seen[IN_FULL].0[c] - 1.0;
        rows.push(BenchRow {
            model: "render".into(),
            knob: "distance".into(),
            setting: format!("{distance} m"),
            error: off(0, 0).abs(),
            us,
            note: format!(
                "{} leaves and {} triangles ({} without flat leaves and simpler wood, {} in full detail); a frame \
                 takes {:.2} of the time without these, {:.2} of that in full detail; seen from four sides, beside \
                 full detail with {FINER} times as many pixels a side, radiance {:+.2} %, coverage {:+.2} % (without \
                 these {:+.2} and {:+.2} %); {w}x{h} on {adapter}",
                seen[3].1,
                seen[0].1,
                seen[1].1,
                seen[IN_FULL].1,
                us / plain,
                us / full,
                100.0 * off(0, 0),
                100.0 * off(0, 1),
                100.0 * off(1, 0),
                100.0 * off(1, 1),
            ),
        });
        bar.step()?;
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The last lit levels of the bench's leaf are flat, with six corners and with four. Without them, the other levels
    /// are left.
    #[test]
    fn the_leaf_of_the_bench_has_flat_levels() {
        let mesh = handover::with_details(&blade(1.0), None, true);
        let own = blade(1.0).positions.len() as u32;
        let lit: Vec<&viewer::DetailLevel> = mesh.details.iter().filter(|d| !d.outline_only).collect();
        let last = lit.last_chunk::<2>().expect("levels").map(|d| d.indices.len() / 3);
        assert_eq!((last, mesh.positions.len()), ([4, 2], own as usize + 10));
        assert!(lit[lit.len() - 2..].iter().all(|d| d.indices.iter().all(|k| *k >= own)));
        let with = viewer::Scene { meshes: vec![mesh.clone()], ..viewer::Scene::default() };
        let left = without_flat(&with).meshes.remove(0);
        assert_eq!(left.details, handover::with_details(&blade(1.0), None, false).details);
    }

    /// Flat leaves in all directions, a few pixels long: with cards, the picture has the radiance and the coverage of
    /// the leaves in full detail. A curved leaf shows both of its sides from some directions, and a card cannot.
    #[test]
    fn cards_are_as_bright_and_as_dense_as_leaves() {
        let Ok(mut renderer) = gpu::Renderer::headless(&gpu::Options::default()) else { return };
        let maps = |rho: f32| viewer::SideMaps {
            interior: viewer::Interior::Maps { rho_d: vec![[rho; 3]], rho_t: vec![[0.5 * rho; 3]] },
            ..viewer::SideMaps::black()
        };
        let leaf = viewer::LeafMaterial {
            name: "leaf".into(),
            width: 1,
            height: 1,
            thickness_mm: 1.0,
            lobe: viewer::Lobe::Beckmann,
            sides: viewer::Sides::of(|_| maps(0.2)),
            mask: None,
        };
        let sun = viewer::Sun { direction: Vec3::new(0.6, 0.0, 0.8), irradiance: [10.0; 3], radius: 0.0047 };
        let mut scene = viewer::Scene { sun: Some(sun), sky: Some([1.0; 3]), msaa: 4, ..viewer::Scene::default() };
        let one = scene.add(handover::with_details(&blade(0.0), None, true), viewer::Material::Leaf(leaf));
        let spread = |k: u32, by: f64| (f64::from(k + 1) * by).fract() as f32;
        scene.instances = (0..400)
            .map(|k| {
                let axis = Vec3::new(spread(k, 0.819_173) - 0.5, spread(k, 0.671_044) - 0.5, spread(k, 0.549_7) - 0.5);
                let turned = glam::Quat::from_axis_angle(axis.normalize(), 6.0 * spread(k, 0.450_33));
                let place = 100.0 * Vec3::new((k % 20) as f32 - 9.5, 0.0, (k / 20) as f32 - 9.5);
                let transform = glam::Mat4::from_rotation_translation(turned, place);
                viewer::Instance { transform, ..one }
            })
            .collect();
        // 62 mm are 4.3 pixels.
        let camera = viewer::Camera { eye: Vec3::NEG_Y * 4e3, target: Vec3::ZERO, up: Vec3::Z, fov_y_deg: 32.0 };
        let mut seen = |in_full: bool| {
            scene.in_full = in_full;
            renderer.set_scene(&scene).expect("scene");
            let picture = renderer.render(&camera, 160, 160).expect("picture");
            (means(&picture), renderer.stats().triangles)
        };
        let ((cards, few), (full, all)) = (seen(false), seen(true));
        assert_eq!((few, all), (2 * 400, 320 * 400));
        // A leaf covers about 30 samples, of which those at its rim count by chance.
        for c in 0..2 {
            assert!((cards[c] / full[c] - 1.0).abs() < 0.02, "{c}: {cards:?} {full:?}");
        }
    }
}
