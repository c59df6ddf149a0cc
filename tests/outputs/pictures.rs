//! Pictures of committed scenes by other renderers, where they are installed: squares of pixels on the leaf have our
//! path tracer's radiance, up to the stated loss of the export.

use crate::common::skips::{Need, skip};
use crate::common::{run, succeeded};
use crate::programs::{python, shown};
use mesophyll::files::image::{self, ChannelMaps};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

const WIDTH: usize = 80;
const HEIGHT: usize = 60;
/// Pixels along a side of a square.
const SQUARE: usize = 4;

/// A committed scene with small pictures, and one of its views.
struct Small {
    folder: tempfile::TempDir,
    scene: String,
    view: &'static str,
}

/// A picture: whether a pixel shows the leaf, and its linear RGB, from the top.
struct Picture {
    on: Vec<bool>,
    pixels: Vec<f64>,
}

impl Small {
    fn new(name: &str, view: &'static str) -> Small {
        let folder = tempfile::tempdir().unwrap();
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(root.join(format!("data/scenes/{name}.toml"))).unwrap();
        let fits = root.join("fits").display().to_string();
        let line = |line: &str| match line.split_once(" = ") {
            Some(("width", _)) => format!("width = {WIDTH}\n"),
            Some(("height", _)) => format!("height = {HEIGHT}\n"),
            _ => format!("{}\n", line.replace("../../fits", &fits)),
        };
        let scene = folder.path().join("small.toml");
        std::fs::write(&scene, text.lines().map(line).collect::<String>()).unwrap();
        Small { scene: scene.display().to_string(), folder, view }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn export(&self, to: &str, name: &str) {
        let out = self.at(name).display().to_string();
        succeeded(&run(["export", &self.scene, "--to", to, "--view", self.view, "-o", &out]));
    }

    /// Our own picture.
    fn ours(&self) -> ChannelMaps {
        let out = self.at("ours").display().to_string();
        succeeded(&run(["render", &self.scene, "--view", self.view, "--samples", "64", "-o", &out]));
        image::read_exr(&self.at("ours").join(format!("{}.exr", self.view))).unwrap()
    }

    /// Holds another program's picture against ours. The stated loss of light on the viewed side is the bound; of the
    /// front and the back, the larger one.
    fn is_ours(&self, theirs: &Picture, loss: &str) {
        let lost: Value = serde_json::from_slice(&std::fs::read(self.at(loss)).unwrap()).unwrap();
        let stated = ["front", "back"].map(|side| lost["surfaces"][0][side]["brdf_rms"].as_f64().unwrap());
        let ours = self.ours();
        let (mut squares, mut reference, mut count) = (0.0, 0.0, 0);
        let corners = (0..HEIGHT).step_by(SQUARE).flat_map(|y| (0..WIDTH).step_by(SQUARE).map(move |x| (y, x)));
        for (y, x) in corners {
            let inside: Vec<usize> = (0..SQUARE * SQUARE).map(|k| (y + k / SQUARE) * WIDTH + x + k % SQUARE).collect();
            if !inside.iter().all(|k| theirs.on[*k]) {
                continue;
            }
            count += 1;
            for (c, name) in ["R", "G", "B"].iter().enumerate() {
                let our: f64 = inside.iter().map(|k| f64::from(ours.get(name).unwrap()[*k])).sum();
                let their: f64 = inside.iter().map(|k| theirs.pixels[3 * k + c]).sum();
                squares += (our - their) * (our - their);
                reference += our * our;
            }
        }
        let rms = (squares / reference).sqrt();
        println!("{} {}: {rms:.4} of {stated:?}, {count} squares", self.view, loss);
        assert!(count > 40, "{count}");
        assert!(rms < stated[0].max(stated[1]), "{}: {rms} against {stated:?}", self.view);
    }
}

/// A picture as a script prints it.
fn printed(said: &Value) -> Picture {
    Picture {
        on: serde_json::from_value(said[0].clone()).unwrap(),
        pixels: serde_json::from_value(said[1].clone()).unwrap(),
    }
}

#[test]
fn mitsubas_picture_is_ours() {
    let small = Small::new("glossy-sky", "glance");
    small.export("mitsuba", "m");
    let script = "
import json, mitsuba as mi, numpy as np
mi.set_variant('scalar_rgb')
scene = mi.load_file('m/scene.xml')
sensor = scene.sensors()[0]
on = [bool(scene.ray_test(sensor.sample_ray(0, .5, mi.Point2f((x + .5) / 80, (y + .5) / 60), mi.Point2f(.5))[0]))
      for y in range(60) for x in range(80)]
print(json.dumps([on, np.array(mi.render(scene, spp=48)).ravel().tolist()]))";
    let Some(said) = python("mitsuba", script, small.folder.path()) else { return };
    small.is_ours(&printed(&said), "m/loss.json");
}

/// Blender's path tracer sees the sun on the leaf, through the leaf, and a glossy leaf under a sky.
#[test]
fn pictures_by_cycles_are_ours() {
    // What Blender says of itself goes to standard error, as its own code prints beside Python's.
    let script = "
import json, os, sys
out = os.dup(1)
os.dup2(2, 1)
import bpy
exec(compile(open('b/scene.py').read(), 'b/scene.py', 'exec'), {'__file__': 'b/scene.py', '__name__': 'scene'})
scene = bpy.context.scene
scene.cycles.samples, scene.cycles.use_adaptive_sampling, scene.cycles.use_denoising = 64, False, False
scene.render.film_transparent = True
scene.render.image_settings.file_format = 'OPEN_EXR'
scene.render.image_settings.color_mode, scene.render.image_settings.color_depth = 'RGBA', '32'
scene.render.filepath = os.path.abspath('b.exr')
bpy.ops.render.render(write_still=True)
image = bpy.data.images.load(scene.render.filepath)
image.colorspace_settings.name = 'Non-Color'
width, height = image.size
values = list(image.pixels)
rows = [values[4 * width * y:][:4 * width] for y in reversed(range(height))]
pixels = [row[4 * x:][:4] for row in rows for x in range(width)]
os.write(out, json.dumps([[p[3] > .999 for p in pixels], [v for p in pixels for v in p[:3]]]).encode())";
    for (scene, view) in [("front-lit", "front"), ("back-lit", "through"), ("glossy-sky", "glance")] {
        let small = Small::new(scene, view);
        small.export("blender", "b");
        let Some(said) = python("bpy", script, small.folder.path()) else { return };
        small.is_ours(&printed(&said), "b/loss.json");
    }
}

/// Where Node.js finds a package's script; a skip where it does not.
fn script(package: &str) -> Option<PathBuf> {
    let ask = format!("console.log(require.resolve('{package}'))");
    let found = Command::new("node").args(["-e", &ask]).output().ok().filter(|out| out.status.success());
    if found.is_none() {
        skip(Need::Peer, &format!("no {package} (npm install babylonjs babylonjs-loaders, NODE_PATH)"));
    }
    Some(PathBuf::from(String::from_utf8(found?.stdout).unwrap().trim()))
}

/// Babylon.js reads the glTF file with its extensions, and draws the leaf under its sun, lit from before and behind.
#[test]
fn pictures_by_babylon_are_ours() {
    let (Some(engine), Some(loaders)) = (script("babylonjs"), script("babylonjs-loaders")) else { return };
    for (scene, view) in [("front-lit", "front"), ("back-lit", "through")] {
        let small = Small::new(scene, view);
        small.export("gltf-translucent", "s.glb");
        let page = format!(
            "<!doctype html><html><body><canvas></canvas><script src=\"file://{}\"></script>
            <script src=\"file://{}\"></script><script>
            const FILE = \"file://{}\", WIDTH = {WIDTH}, HEIGHT = {HEIGHT};
            {}</script></body></html>",
            engine.display(),
            loaders.display(),
            small.at("s.glb").display(),
            include_str!("babylon.js")
        );
        let Some(bytes) = shown(small.folder.path(), &page) else { return };
        assert!(!bytes.starts_with(b"error"), "{}", String::from_utf8_lossy(&bytes));
        let values: Vec<f32> = bytes.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        let rows = values.chunks_exact(4 * WIDTH).rev();
        let pixels: Vec<&[f32]> = rows.flat_map(|row| row.chunks_exact(4)).collect();
        let theirs = Picture {
            on: pixels.iter().map(|p| p[3] > 0.999).collect(),
            pixels: pixels.iter().flat_map(|p| p[..3].iter().map(|v| f64::from(*v))).collect(),
        };
        small.is_ours(&theirs, "s.glb.loss.json");
    }
}
