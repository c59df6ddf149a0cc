//! The page in headless Chromium: it draws what the program draws, before and after an edit of the slab. The test skips
//! where the page is not built (`make web`) or where there is no Chromium.
#![cfg(not(target_arch = "wasm32"))]

mod server;
#[path = "../../../tests/common/skips.rs"]
mod skips;

use glam::{Vec2, Vec3, Vec4};
use mesophyll_viewer::scene::{Camera, LeafMaterial, Lobe, Material, Mesh, Scene, SideMaps, Sides, Sun};
use mesophyll_viewer::{Error, Options, Renderer};
use mesophyll_web::bundle::{Bundle, BundleView, LeafSlabs, SideSlab};
use skips::{Need, skip};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

const SIZE: [u32; 2] = [320, 240];
const SLAB: SideSlab = SideSlab { sigma_a: [0.9, 0.5, 1.6], sigma_s: [11.0, 12.0, 10.0] };

/// Ends the browser when the test ends, however it ends.
struct Browser(Child);

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn chromium() -> Option<PathBuf> {
    let folders = std::env::var_os("PATH")?;
    let names = ["chromium", "chromium-browser", "google-chrome"];
    std::env::split_paths(&folders).flat_map(|f| names.map(|n| f.join(n))).find(|p| p.is_file())
}

/// A bent, glossy leaf with veins, lit by the sun from the front and by a constant sky.
fn bundle() -> Bundle {
    let n = 24usize;
    let mut mesh = Mesh::default();
    for j in 0..=n {
        for i in 0..=n {
            let [u, v] = [i, j].map(|k| k as f32 / n as f32);
            let (x, y) = (40.0 * (u - 0.5), 40.0 * (0.5 - v));
            mesh.positions.push(Vec3::new(x, y, -0.012 * x * x));
            let tangent = Vec3::new(1.0, 0.0, -0.024 * x).normalize();
            mesh.normals.push(tangent.cross(Vec3::Y));
            mesh.tangents.push(Vec4::from((tangent, 1.0)));
            mesh.uvs.push(Vec2::new(u, v));
            if i < n && j < n {
                let k = (j * (n + 1) + i) as u32;
                let below = k + n as u32 + 1;
                mesh.indices.extend([k, below, k + 1, k + 1, below, below + 1]);
            }
        }
    }
    let (width, height) = (32u32, 32u32);
    let side = || {
        let texel = |k: u32| {
            let vein = if (k % width).abs_diff(16) < 2 || (k / width).is_multiple_of(8) { 0.06 } else { -0.01 };
            [1.0, 0.95, 0.9, vein]
        };
        let mut maps = SideMaps::black();
        maps.gamma_delta = (0..width * height).map(texel).collect();
        maps.gloss = Some(vec![[0.03, 0.03, 0.03, 0.25]; (width * height) as usize]);
        maps
    };
    let leaf = LeafMaterial {
        name: "made up".into(),
        width,
        height,
        thickness_mm: 0.2,
        lobe: Lobe::Beckmann,
        sides: Sides { front: side(), back: side() },
        mask: None,
    };
    let mut scene = Scene {
        sun: Some(Sun { direction: Vec3::new(0.5, -0.3, 0.8).normalize(), irradiance: [3.0, 2.9, 2.7], radius: 0.005 }),
        sky: Some([0.25, 0.3, 0.4]),
        background: [0.02, 0.03, 0.05],
        exposure: 2.0,
        shadow_samples: 1,
        shadow_resolution: 512,
        msaa: 4,
        ..Scene::default()
    };
    let one = scene.add(mesh, Material::Leaf(leaf));
    scene.instances.push(one);
    let camera = Camera { eye: Vec3::new(10.0, -70.0, 60.0), target: Vec3::ZERO, up: Vec3::Z, fov_y_deg: 30.0 };
    let slabs = LeafSlabs { material: 0, thickness_mm: 0.2, sides: Sides { front: Some(SLAB), back: Some(SLAB) } };
    slabs.apply(scene.leaf_mut(0).unwrap()).unwrap();
    Bundle {
        title: "made up".into(),
        program: "a test".into(),
        scene,
        still: None,
        views: vec![BundleView { name: "front".into(), camera, size: SIZE, reference: None }],
        leaves: vec![slabs],
    }
}

fn png(rgba: &[u8], path: &Path) -> Vec<u8> {
    mesophyll_viewer::save_png(path, SIZE[0], SIZE[1], rgba).unwrap();
    std::fs::read(path).unwrap()
}

/// The mean over the pixels of the largest channel's difference, and the difference that 99 % of them do not exceed.
fn apart(a: &[u8], b: &[u8]) -> (f64, u8) {
    assert_eq!(a.len(), b.len());
    let pixels = a.as_chunks::<4>().0.iter().zip(b.as_chunks::<4>().0);
    let mut all: Vec<u8> = pixels.map(|(a, b)| (0..3).map(|c| a[c].abs_diff(b[c])).max().unwrap()).collect();
    all.sort_unstable();
    (all.iter().map(|d| f64::from(*d)).sum::<f64>() / all.len() as f64, all[all.len() * 99 / 100])
}

#[test]
fn a_browser_draws_what_the_program_draws() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../out/web");
    if !page.join("mesophyll_web_bg.wasm").is_file() {
        return skip(Need::Peer, "the page for browsers is not built (make web)");
    }
    let Some(chromium) = chromium() else { return skip(Need::Peer, "no Chromium") };
    let mut renderer = match Renderer::headless(&Options::default()) {
        Ok(renderer) => renderer,
        Err(Error::NoAdapter) => return skip(Need::Adapter, "no graphics adapter"),
        Err(other) => panic!("{other}"),
    };
    let folder = tempfile::tempdir().unwrap();
    let mut bundle = bundle();
    let mut draw = |scene: &Scene| {
        renderer.set_scene(scene).unwrap();
        renderer.render(&bundle.views[0].camera, SIZE[0], SIZE[1]).unwrap().ldr.into_flattened()
    };
    let ours = draw(&bundle.scene);
    let edited = LeafSlabs {
        thickness_mm: 0.28,
        sides: Sides::of(|_| Some(SideSlab { sigma_a: [2.5, 0.8, 3.0], ..SLAB })),
        ..bundle.leaves[0].clone()
    };
    let mut other = bundle.scene.clone();
    edited.apply(other.leaf_mut(0).unwrap()).unwrap();
    let ours_edited = draw(&other);
    bundle.views[0].reference = Some(png(&ours, &folder.path().join("ours.png")));

    let answers = server::Server::start(page, "made-up.mesophyll", bundle.write().unwrap());
    let url = format!("http://127.0.0.1:{}/index.html?scene=made-up.mesophyll", answers.port);
    let _browser = Browser(
        Command::new(chromium)
            .args(["--headless", "--no-sandbox", "--no-first-run", "--disable-background-networking"])
            .args(["--disable-component-update", "--disable-sync", "--disable-quic"])
            // Without a GPU, canvases too must be drawn by the software adapter.
            .args(["--enable-unsafe-webgpu", "--enable-features=Vulkan", "--use-webgpu-adapter=swiftshader"])
            .args(["--use-vulkan=swiftshader", "--use-angle=swiftshader"])
            .arg(format!("--user-data-dir={}", folder.path().join("profile").display()))
            .arg(url)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap(),
    );
    let said = |what: &str| answers.next(what);
    let adapter = said("adapter");
    if adapter == b"none" {
        return skip(Need::Peer, "Chromium has no WebGPU adapter here");
    }
    let (theirs, theirs_edited, compared) = (said("picture"), said("edited"), said("compared"));
    // Two adapters round differently, and cut edges at samples of their own.
    let close = |(mean, most): (f64, u8)| mean <= 0.5 && most <= 3;
    let found = apart(&ours, &theirs);
    assert!(close(found), "the picture is {found:?} of 255 from the program's");
    let found = apart(&ours_edited, &theirs_edited);
    assert!(close(found), "the edited picture is {found:?} of 255 from the program's");
    let moved = apart(&theirs, &theirs_edited);
    assert!(moved.0 > 3.0 && !close(moved), "the edit is visible: {moved:?} of 255");
    // The page's own comparison gives the same figures.
    let told: (f64, u8) = apart(&ours, &theirs);
    let compared = String::from_utf8(compared).unwrap();
    let (mean, most) = compared.split_once(' ').unwrap();
    assert!((mean.parse::<f64>().unwrap() - told.0).abs() < 1e-9, "{compared}, {told:?}");
    assert!(most.parse::<u8>().unwrap().abs_diff(told.1) <= 1, "{compared}, {told:?}");
}
