//! Scenes of a few leaves and their pictures with noise, for tests and for stiff cases.

use crate::{Error, Result};
use mesophyll_files::image::{ChannelMaps, Packing, write_exr};
use mesophyll_fits::gloss::synthetic::GaussianDeviates;
use mesophyll_scene::draw::reference;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::placed::leaf::LeafSearch;
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_transport::path::{PathPicture, PathRequest, PathSettings, PathTracer, SamplingTarget};
use std::fmt::Write;
use std::path::Path;

/// Columns and rows of the pictures.
pub const SIZE: [usize; 2] = [32, 24];
/// ρd of the front and of the back, ρt, the ground's albedo, the sun's irradiance.
pub const TRUTH: [[f64; 3]; 5] =
    [[0.06, 0.12, 0.03], [0.1, 0.16, 0.07], [0.07, 0.15, 0.02], [0.2, 0.15, 0.1], [3.0, 2.9, 2.6]];
/// Values that are wrong by a factor of two, and the true sun.
pub const START: [[f64; 3]; 5] = [[0.12, 0.06, 0.06], [0.05, 0.3, 0.04], [0.03, 0.3, 0.04], [0.4, 0.1, 0.2], TRUTH[4]];

/// A level blade of 45 by 24 mm, as glTF with its buffer inside.
pub fn blade() -> String {
    let corners: [[f32; 3]; 4] = [[0.0, -12.0, 0.0], [45.0, -12.0, 0.0], [45.0, 12.0, 0.0], [0.0, 12.0, 0.0]];
    let mut bytes: Vec<u8> = corners.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([0u16, 1, 2, 0, 2, 3].into_iter().flat_map(u16::to_le_bytes));
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let coded: String = bytes
        .chunks(3)
        .flat_map(|c| {
            let word = u32::from(c[0]) << 16 | u32::from(c[1]) << 8 | u32::from(c[2]);
            [18, 12, 6, 0].map(|shift| char::from(DIGITS[(word >> shift & 63) as usize]))
        })
        .collect();
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
        "buffers":[{{"uri":"data:application/octet-stream;base64,{coded}","byteLength":60}}],
        "bufferViews":[{{"buffer":0,"byteLength":48}},{{"buffer":0,"byteOffset":48,"byteLength":12}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,-12,0],"max":[45,12,0]}},
        {{"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"}}]}}"#
    )
}

/// A scene of leaves `a`, and a leaf `b` far below the ground, which no picture shows.
pub fn scene([front, back, through, ground, sun]: [[f64; 3]; 5], tables: &str) -> String {
    let mut text = format!(
        "schema = 1\nname = \"few\"\n[[leaf]]\nname = \"a\"\nmesh = \"blade.gltf\"\nmesh_unit = \"mm\"\n\
         mesh_up = \"z\"\nuniform = {{ rho_d = [{front:?}, {back:?}], rho_t = {through:?} }}\n\
         [[leaf]]\nname = \"b\"\nmesh = \"blade.gltf\"\nmesh_unit = \"mm\"\nmesh_up = \"z\"\n\
         uniform = {{ rho_d = [[0.1, 0.1, 0.1], [0.1, 0.1, 0.1]], rho_t = [0.1, 0.1, 0.1] }}\n\
         [ground]\nalbedo = {ground:?}\nreach_mm = 400\n\
         [sun]\nzenith_deg = 35\nazimuth_deg = 40\nirradiance = {sun:?}\n[sky]\nradiance = [0.4, 0.45, 0.6]\n\
         [check]\nwidth = {}\nheight = {}\n",
        SIZE[0], SIZE[1]
    );
    for (name, eye) in [("across", [-150, -180, 150]), ("against", [160, 130, 20])] {
        let _ = write!(
            text,
            "[[view]]\nname = \"{name}\"\nkind = \"perspective\"\neye_mm = {eye:?}\ntarget_mm = [0, 0, 40]\n\
             fov_deg = 40\n"
        );
    }
    for k in 0..24 {
        let f = f64::from(k);
        let at = [50.0 * (2.1 * f).sin(), 50.0 * (1.3 * f + 0.4).cos(), 15.0 + 4.0 * f];
        let turn = [60.0 * (1.7 * f).sin(), 50.0 * (0.9 * f).cos(), 77.0 * f];
        let _ = write!(text, "[[instance]]\nleaf = \"a\"\nposition_mm = {at:?}\nrotation_deg = {turn:?}\n");
    }
    text + "[[instance]]\nleaf = \"b\"\nposition_mm = [0, 0, -5000]\n" + tables
}

/// The scene with 200 leaves, and pictures of 96 × 72 pixels. `numbers` and `tables` are as for [`scene`].
pub fn crowd(numbers: [[f64; 3]; 5], tables: &str) -> String {
    let mut text = scene(numbers, "").replace("width = 32", "width = 96").replace("height = 24", "height = 72");
    for k in 24..200 {
        let f = f64::from(k);
        let at = [70.0 * (2.1 * f).sin(), 70.0 * (1.3 * f + 0.4).cos(), 15.0 + 0.5 * f];
        let turn = [60.0 * (1.7 * f).sin(), 50.0 * (0.9 * f).cos(), 77.0 * f];
        let _ = write!(text, "[[instance]]\nleaf = \"a\"\nposition_mm = {at:?}\nrotation_deg = {turn:?}\n");
    }
    text + tables
}

/// Opens the scene of this text, which it writes into a folder.
///
/// # Errors
/// Those of a scene that cannot be read, and of a folder that cannot be written.
pub fn opened(folder: &Path, text: &str) -> Result<LoadedScene> {
    let path = folder.join("scene.toml");
    let write = |path: &Path, text: &str| std::fs::write(path, text).map_err(|e| Error::write(path, e));
    write(&path, text)?;
    write(&folder.join("blade.gltf"), &blade())?;
    LoadedScene::open(SceneManifest::read(&path)?, LeafSearch::default(), &Ledger::new())
}

/// How a picture is taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SyntheticExposure {
    /// What the radiance is multiplied by.
    pub factor: f64,
    /// Relative standard deviation of a pixel.
    pub noise: f64,
    /// Paths a pixel.
    pub samples: u32,
    /// Seed of the paths and of the noise.
    pub seed: u64,
}

impl Default for SyntheticExposure {
    fn default() -> Self {
        SyntheticExposure { factor: 1.0, noise: 0.01, samples: 512, seed: 77 }
    }
}

/// Draws the views of a scene into a folder, times a factor, with noise of 1 % and the error of their own paths stated.
/// `change` makes a reading of what is shown with noise, by its pixel.
///
/// # Errors
/// Those of [`opened`] and of drawing.
pub fn photograph(folder: &Path, text: &str, factor: f64, change: impl Fn(usize, f64) -> f64) -> Result<()> {
    taken(folder, text, SyntheticExposure { factor, ..SyntheticExposure::default() }, change)
}

/// As [`photograph`], by any exposure.
///
/// # Errors
/// As [`photograph`].
pub fn taken(folder: &Path, text: &str, by: SyntheticExposure, change: impl Fn(usize, f64) -> f64) -> Result<()> {
    let scene = opened(folder, text)?;
    let world = reference::traced(&scene, 0.0, &Ledger::new())?;
    let tracer = PathTracer::new(&world, PathSettings::default())?;
    let mut deviates = GaussianDeviates::new(by.seed);
    let size = [scene.manifest.check.width, scene.manifest.check.height].map(|n| n as usize);
    for view in scene.manifest.perspectives() {
        let mut picture = PathPicture::new(size[0], size[1]);
        let target = SamplingTarget { samples: Some(by.samples), error: None };
        let request = PathRequest { camera: view.camera, size, seed: by.seed, target };
        picture.draw(&tracer, &request, "", &mut |_| Ok(()))?;
        let mut maps = ChannelMaps::new(size[0], size[1]);
        let (mut seen, mut errors) = (vec![Vec::new(); 3], vec![Vec::new(); 3]);
        for (k, mean) in picture.mean.iter().enumerate() {
            for c in 0..3 {
                let [value, own] = [mean[c], picture.error(k)[c]].map(|v| by.factor * f64::from(v));
                seen[c].push(change(k, value + by.noise * value * deviates.normal()) as f32);
                errors[c].push((by.noise * value).hypot(own) as f32);
            }
        }
        for (prefix, planes) in [("", seen), ("error.", errors)] {
            planes.into_iter().zip(["R", "G", "B"]).for_each(|(p, c)| maps.push(format!("{prefix}{c}"), p));
        }
        write_exr(&folder.join(format!("{}.exr", view.name)), &maps, Packing::Zip)?;
    }
    Ok(())
}

/// Both pictures, as tables of a scene.
pub const BOTH: &str =
    "[[picture]]\nview = \"across\"\nfile = \"across.exr\"\n[[picture]]\nview = \"against\"\nfile = \"against.exr\"\n";

/// The scene with its first camera turned by 1° about the vertical.
pub fn turned(text: String) -> String {
    let ([x, y], (sin, cos)) = ([150.0, 180.0], 1f64.to_radians().sin_cos());
    let target = [x * cos - y * sin - x, x * sin + y * cos - y, 40.0];
    text.replacen("target_mm = [0, 0, 40]", &format!("target_mm = {target:?}"), 1)
}

/// The scene with all of its leaves 5 mm to the side.
pub fn moved(text: String) -> String {
    let line = |line: &str| {
        let place = line.strip_prefix("position_mm = [").and_then(|rest| rest.split_once(','));
        let number = place.and_then(|(x, rest)| Some((x.trim().parse::<f64>().ok()?, rest)));
        number.map_or_else(|| line.to_string(), |(x, rest)| format!("position_mm = [{},{rest}", x + 5.0))
    };
    text.lines().map(line).collect::<Vec<_>>().join("\n") + "\n"
}

/// The scene with a gloss on the leaves that its cameras see.
pub fn glossy(text: String) -> String {
    let end = " }\n[[leaf]]\nname = \"b\"";
    text.replacen(end, &format!(", rho_s = [0.06, 0.06, 0.06], m = 0.25{end}"), 1)
}
