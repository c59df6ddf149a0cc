//! A lawn for the tests of the grass pass: its scene file, cameras that look at it, and the radiance along every
//! pixel's ray in double precision.

use crate::skips::{self, Need};
use glam::{DVec2, DVec3, Vec3};
use mesophyll::fits::grass::march::{LawnSlices, SliceCrossing};
use mesophyll::fits::grass::sheet::CHANNELS;
use mesophyll::scene::draw::handover;
use mesophyll::scene::loaded::LoadedScene;
use mesophyll::scene::manifest::SceneManifest;
use mesophyll::scene::placed::leaf::LeafSearch;
use mesophyll::scene::placed::ledger::Ledger;
use mesophyll_viewer::scene::{Camera, GrassSheet, Scene as Drawn};
use mesophyll_viewer::{AdapterInfo, Backend, Error, Options, Renderer};
use std::path::{Path, PathBuf};

/// Pixels along each side of a picture.
pub const SIDE: u32 = 49;
pub const SOIL: [f64; 3] = [0.06, 0.045, 0.03];

pub fn renderer() -> Option<Renderer> {
    renderer_on(Backend::Any)
}

pub fn renderer_on(backend: Backend) -> Option<Renderer> {
    match Renderer::headless(&Options { backend, ..Options::default() }) {
        Ok(renderer) => Some(renderer),
        Err(Error::NoAdapter) => {
            skips::skip(Need::Adapter, "no graphics adapter");
            None
        }
        Err(other) => panic!("{other}"),
    }
}

/// A scene of a lawn on a small square, with further text `more`.
pub fn file(folder: &Path, grass: &str, more: &str) -> PathBuf {
    let meadow = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("data/grass/lawn.toml")).unwrap();
    let meadow = meadow.replace("size_mm = [400, 400]", "size_mm = [120, 100]");
    assert!(meadow.contains("[120, 100]"));
    std::fs::write(folder.join("meadow.toml"), meadow).unwrap();
    let path = folder.join("scene.toml");
    let rest = "[sky]\nradiance = [1, 1, 1]\n[[view]]\nname = \"above\"\nkind = \"perspective\"\neye_mm = [0, 0, 600]\n\
         target_mm = [0, 0, 0]\nup = [0, 1, 0]\nfov_deg = 20\n[check]\nwidth = 32\nheight = 32\nsamples = 4\n";
    std::fs::write(&path, format!("schema = 1\nname = \"lawn\"\n{grass}\n{rest}{more}")).unwrap();
    path
}

pub const GRASS: &str = "[[grass]]\nname = \"lawn\"\nmeadow = \"meadow.toml\"\ntiles = [401, 401]\nslices = 5\n\
     texels = [64, 16]\nsteps = 256\nposition_mm = [31, -17]\n";
pub const GROUND: &str = "[ground]\nalbedo = [0.06, 0.045, 0.03]\nreach_mm = 50000\nheight_mm = 4\n";

/// The lawn as it is handed to the renderer, without the ground's mesh, and its slices.
pub fn lawn(folder: &Path) -> (Drawn, LawnSlices) {
    lawn_of(folder, GRASS)
}

pub fn lawn_of(folder: &Path, grass: &str) -> (Drawn, LawnSlices) {
    lawn_with(folder, grass, GROUND)
}

/// The same with further text of the scene file, the ground's included.
pub fn lawn_with(folder: &Path, grass: &str, more: &str) -> (Drawn, LawnSlices) {
    let manifest = SceneManifest::read(&file(folder, grass, more)).unwrap();
    let ledger = Ledger::new();
    let scene = LoadedScene::open(manifest, LeafSearch::default(), &ledger).unwrap();
    let mut drawn = handover::scene(&scene, &ledger).unwrap();
    drawn.instances.clear();
    (drawn.msaa, drawn.sky) = (1, None);
    (drawn, held(&scene.placed.grass[0].slices(&scene.manifest, &ledger).unwrap()))
}

/// The slices as an adapter holds them, in half floats.
fn held(slices: &LawnSlices) -> LawnSlices {
    let mut out = slices.clone();
    let sheets = [Some(&mut out.upright), out.level.as_mut()];
    let texels = sheets.into_iter().flatten().flat_map(|sheet| &mut sheet.levels).flat_map(|level| &mut level.texels);
    texels.flatten().for_each(|v| *v = in_half(*v));
    out
}

/// The nearest number with ten bits after the first one. Numbers below 6e-5 keep more bits here, which has no visible
/// effect.
pub fn in_half(v: f32) -> f32 {
    f32::from_bits((v.to_bits() + 0xfff + (v.to_bits() >> 13 & 1)) & !0x1fff)
}

/// Cameras straight above the lawn, at elevations from 14° to 70° (two of them along the slices), and inside the lawn.
/// They look at the place `at` on the ground or near it. Pixels are smaller than texels.
pub fn cameras(at: Vec3, height: f32) -> Vec<Camera> {
    let one = |eye: Vec3, target: Vec3, up: Vec3, fov_y_deg: f32| Camera {
        eye: at + eye,
        target: at + target,
        up,
        fov_y_deg,
    };
    let turned = |elevation: f32, azimuth: f32| {
        let (e, a) = (elevation.to_radians(), azimuth.to_radians());
        one(400.0 * Vec3::new(e.cos() * a.cos(), e.cos() * a.sin(), e.sin()), Vec3::ZERO, Vec3::Z, 7.0)
    };
    let inside = Vec3::new(3.0, -7.0, 0.4 * height);
    vec![
        one(Vec3::new(2.0, 1.0, 500.0), Vec3::new(2.0, 1.0, 0.0), Vec3::Y, 9.0),
        turned(14.0, 37.0),
        turned(17.0, 0.0),
        turned(30.0, 90.0),
        turned(45.0, 222.0),
        turned(70.0, 300.0),
        one(inside, inside + Vec3::new(1.0, 0.3, -0.4), Vec3::Z, 30.0),
    ]
}

/// Origin (in the lawn) and direction of every pixel's ray, row by row, for rays that reach the layer or begin in it.
pub fn rays(camera: &Camera, origin: Vec3, height: f64) -> Vec<(DVec3, DVec3)> {
    let [eye, target, up] = [camera.eye, camera.target, camera.up].map(Vec3::as_dvec3);
    let forward = (target - eye).normalize();
    let right = forward.cross(up).normalize();
    let above = right.cross(forward);
    let tan = (0.5 * f64::from(camera.fov_y_deg).to_radians()).tan();
    let share = |k: u32| 2.0 * (f64::from(k) + 0.5) / f64::from(SIDE) - 1.0;
    (0..SIDE * SIDE)
        .map(|k| {
            let d = (forward + right * (share(k % SIDE) * tan) - above * (share(k / SIDE) * tan)).normalize();
            let from = eye - origin.as_dvec3();
            let first = if from.z > height { (height - from.z) / d.z } else { 0.0 };
            (from + d * first, d)
        })
        .collect()
}

/// How the wind leans a lawn at a place (x and y from the lawn's origin).
pub type Lean<'a> = &'a dyn Fn(DVec2) -> DVec2;
pub const STILL: Lean = &|_| DVec2::ZERO;

/// Radiance along every pixel's ray: `colour` of the slices, and `soil` of the ground where light is left.
pub fn twin(
    slices: &LawnSlices,
    camera: &Camera,
    origin: Vec3,
    lean: Lean,
    colour: impl Fn(&SliceCrossing, &[f64; CHANNELS], DVec3) -> [f64; 3],
    soil: impl Fn(DVec3) -> f64,
) -> Vec<([f64; 3], f64)> {
    let one = |(o, d): (DVec3, DVec3)| {
        let found = slices.march_leaning(o, d, 256, 0.0, lean, |c, t| colour(c, t, d));
        let ground = -o.z / d.z;
        let mut out = found.colour;
        if d.z < 0.0 && found.opacity <= 1.0 - 1e-4 {
            let light = soil(o + d * ground);
            (0..3).for_each(|c| out[c] += (1.0 - found.opacity) * SOIL[c] * light);
        } else {
            out = out.map(|v| v / found.opacity);
        }
        (out, found.depth.unwrap_or(ground))
    };
    rays(camera, origin, slices.height).into_iter().map(one).collect()
}

/// Every pixel agrees within `1e-3` of the brightest one. A few exceptions are allowed, whose ray passes so close to
/// the crossing of two slices that single precision takes them in another order. In the mean, a software adapter's
/// pixels agree within 3e-5: places of up to a metre have errors of 6e-5 mm in single precision, texels are 1.9 mm
/// long, and one texel may be as bright as the picture and its neighbour black. Other adapters may filter with
/// fractions of 8 bits, and some store radiance with 16 bits.
pub fn agree(what: &str, adapter: &AdapterInfo, drawn: &[[f32; 4]], right: &[[f64; 3]]) {
    let white = right.iter().flatten().fold(0.0f64, |a, b| a.max(*b));
    assert!(white > 0.01, "{what}: {white}");
    let off = |(a, b): (&[f32; 4], &[f64; 3])| (0..3).map(|c| (f64::from(a[c]) - b[c]).abs()).fold(0.0, f64::max);
    let errors: Vec<f64> = drawn.iter().zip(right).map(|pair| off(pair) / white).collect();
    let beyond = errors.iter().filter(|e| **e > 1e-3).count() as f64 / errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let worst = errors.iter().fold(0.0f64, |a, b| a.max(*b));
    println!("{what}: mean {mean:.2e}, beyond 1e-3: {:.2} %, worst {worst:.3}", 100.0 * beyond);
    let most = match adapter {
        AdapterInfo { half_precision: true, .. } => 1e-3,
        AdapterInfo { is_software: true, .. } => 3e-5,
        _ => 2e-4,
    };
    assert!(
        beyond < 0.005 && mean < most,
        "{what}: mean {mean}, at most {most} allowed, {beyond} beyond 1e-3, worst {worst}"
    );
}

/// The same sheet with one opacity everywhere, of white blades that transmit nothing and face up.
pub fn even(sheet: &GrassSheet, opacity: f32) -> GrassSheet {
    let mut out = sheet.clone();
    for level in &mut out.levels {
        let n = level.planes[0].len();
        let (normal, rho) = ([0.0, 0.0, opacity, opacity], [opacity, opacity, opacity, 0.5 * opacity]);
        level.planes = [vec![normal; n], vec![rho; n], vec![rho; n], vec![[0.0; 4]; n]];
    }
    out
}
