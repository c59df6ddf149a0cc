//! Scenes whose sky is a picture: where it stands, what of other programs is read, and that the real-time renderer
//! lights leaves by it as the path tracer does.

use crate::common::skips::{Need, skip};
use crate::common::{refused, run, succeeded};
use mesophyll::files::image::{ChannelMaps, Packing, read_exr, write_exr};
use mesophyll::scene::draw::handover;
use mesophyll::scene::loaded::LoadedScene;
use mesophyll::scene::manifest::SceneManifest;
use mesophyll::scene::placed::{leaf::LeafSearch, ledger::Ledger};
use mesophyll_viewer::{Options, Renderer};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// A leaf at the origin that is tilted about x, under `light`, with cameras towards two azimuths at an elevation of 30°
/// and one above the leaf.
fn scene(folder: &Path, light: &str, tilt_deg: f64) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    std::fs::copy(root.join("fits/elm/blade.glb"), folder.join("leaf.glb")).unwrap();
    let view = |azimuth: f64| {
        let (y, x) = azimuth.to_radians().sin_cos();
        let target = [86.603 * x, 86.603 * y, 950.0];
        format!(
            "[[view]]\nname = \"at{azimuth}\"\nkind = \"perspective\"\neye_mm = [0, 0, 900]\ntarget_mm = {target:?}\n"
        )
    };
    let text = format!(
        "schema = 1\nname = \"s\"\n[[leaf]]\nname = \"elm\"\nmesh = \"leaf.glb\"\nuniform = {{ rho_d = [[0.3, 0.4, \
         0.2], [0.3, 0.4, 0.2]], rho_t = [0.2, 0.3, 0.1] }}\n[[instance]]\nleaf = \"elm\"\n\
         rotation_deg = [{tilt_deg}, 0, 0]\n{light}\n{}fov_deg = 12\n{}fov_deg = 12\n\
         [[view]]\nname = \"leaf\"\nkind = \"perspective\"\neye_mm = [0, 0, 400]\ntarget_mm = [0, 0, 0]\n\
         up = [0, 1, 0]\nfov_deg = 2\n[check]\nwidth = 24\nheight = 24\n",
        view(70.0),
        view(110.0)
    );
    let path = folder.join("scene.toml");
    std::fs::write(&path, text).unwrap();
    path
}

/// The path tracer's picture of a view.
fn traced(folder: &Path, view: &str, samples: &str) -> ChannelMaps {
    let (path, out) = (folder.join("scene.toml"), folder.join("out"));
    let [path, out] = [path.to_str().unwrap(), out.to_str().unwrap()];
    succeeded(&run(["render", path, "-o", out, "--view", view, "--samples", samples]));
    read_exr(&folder.join(format!("out/{view}.exr"))).unwrap()
}

fn brightest(maps: &ChannelMaps) -> f32 {
    maps.get("G").unwrap().iter().fold(0.0, |a, b| a.max(*b))
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
    sum / n
}

/// A sky of 128 × 64 texels whose radiance is `of(column, row)`.
fn picture(path: &Path, of: impl Fn(usize, usize) -> [f32; 3]) {
    let mut maps = ChannelMaps::new(128, 64);
    for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
        maps.push(name, (0..128 * 64).map(|k| of(k % 128, k / 128)[c]).collect());
    }
    write_exr(path, &maps, Packing::Zip).unwrap();
}

#[test]
fn a_panorama_stands_in_a_scene_where_fit_sky_finds_its_sun() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_string();
    let sun = ["--sun-zenith-deg", "60", "--sun-azimuth-deg", "70", "--turbidity", "3", "--disk"];
    succeeded(&run(["eval", "panorama", "-o", &at("sky.exr")].into_iter().chain(sun)));
    let ran = run(["fit", "sky", "--json", "--panorama", &at("sky.exr"), "-o", &at("fit")]);
    let json: Value = serde_json::from_slice(&ran.stdout).unwrap();
    let azimuth = json["sun_azimuth_deg"]["value"].as_f64().unwrap();
    assert!((azimuth - 70.0).abs() < 1.0, "{json}");
    scene(dir.path(), "[sky]\nenvironment = \"sky.exr\"", 0.0);
    let [there, beside] = ["at70", "at110"].map(|view| brightest(&traced(dir.path(), view, "1")));
    assert!(there > 100.0 * beside && beside > 0.0, "{there} {beside}");
    // Turned by 40° it stands at 110°, with twice the light.
    scene(dir.path(), "[sky]\nenvironment = \"sky.exr\"\nrotation_deg = 40\nscale = 2", 0.0);
    let [now, away] = ["at70", "at110"].map(|view| brightest(&traced(dir.path(), view, "1")));
    assert!((away / (2.0 * there) - 1.0).abs() < 0.02 && away > 100.0 * now, "{away} {now} {there}");
}

/// A bright patch at azimuth 70° and a dim sky. The picture that is exported has it at the same place.
#[test]
fn exports_carry_the_picture_as_it_stands() {
    let dir = tempfile::tempdir().unwrap();
    let column = ((0.5 - 70.0 / 360.0) * 128.0) as usize;
    picture(&dir.path().join("sky.exr"), |i, j| if i == column && (18..24).contains(&j) { [9.0; 3] } else { [1.0; 3] });
    let path = scene(dir.path(), "[sky]\nenvironment = \"sky.exr\"", 0.0);
    // Blender's panoramas are as ours, the first column of Mitsuba's looks to +x, that of OpenUSD's to +y.
    for (format, first) in [("blender", 0.5), ("mitsuba", 0.0), ("usd", 0.25)] {
        let out = dir.path().join(format);
        let args = ["export", path.to_str().unwrap(), "--to", format, "--view", "leaf", "-o", out.to_str().unwrap()];
        succeeded(&run(args));
        let mut folders = vec![out];
        let mut sky = None;
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()) {
                match entry.file_stem().is_some_and(|s| s == "sky") {
                    _ if entry.is_dir() => folders.push(entry),
                    true => sky = Some(entry),
                    false => {}
                }
            }
        }
        let maps = read_exr(&sky.expect("a picture of the sky")).unwrap();
        let (k, _) = maps.channels[0].1.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).unwrap();
        let u = ((k % maps.width) as f64 + 0.5) / maps.width as f64;
        let azimuth = ((first - u) * 360.0).rem_euclid(360.0);
        assert!((azimuth - 70.0).abs() < 2.0, "{format}: {azimuth}");
    }
}

#[test]
fn skies_of_other_programs_are_read_and_what_is_none_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let sky = dir.path().join("sky.exr");
    let spoilt = |count: usize, bad: f32| {
        picture(
            &sky,
            |i, j| if (j * 128 + i) % 7 == 0 && (j * 128 + i) / 7 < count { [bad, 1.0, 1.0] } else { [1.0; 3] },
        );
    };
    let light = "[sky]\nenvironment = \"sky.exr\"";
    let path = scene(dir.path(), light, 0.0);
    let render =
        || run(["render", path.to_str().unwrap(), "-o", dir.path().join("out").to_str().unwrap(), "--samples", "1"]);
    for bad in [-1e-6, f32::NAN, f32::INFINITY] {
        spoilt(3, bad);
        succeeded(&render());
    }
    spoilt(1000, f32::NAN);
    refused(&render(), 2, &["sky.exr", "1000 of 24576 readings are not finite"]);
    spoilt(1000, -1.0);
    refused(&render(), 2, &["sky.exr", "1000 of 24576 readings are negative", "% of the light"]);
    // The same even sky as a Radiance picture, and what is said of it.
    let hdr =
        [b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n-Y 2 +X 4\n".to_vec(), [128, 128, 128, 130].repeat(8)];
    std::fs::write(dir.path().join("sky.hdr"), hdr.concat()).unwrap();
    scene(dir.path(), "[sky]\nenvironment = \"sky.hdr\"\nscale = 0.5", 0.0);
    assert_eq!(brightest(&traced(dir.path(), "at70", "1")), 0.5);
    // Statements that contradict each other or the picture.
    spoilt(0, 0.0);
    for (light, words) in [
        ("[sky]\nenvironment = \"sky.exr\"\nsun = \"in the picture\"", ["sky.sun", "far brighter than the sky"]),
        (
            "[sky]\nenvironment = \"sky.exr\"\nsun = \"in the picture\"\n[sun]\nzenith_deg = 1\nirradiance = [1, 1, 1]",
            ["sky.sun", "one of the two"],
        ),
        ("[sky]\nradiance = [1, 1, 1]\nrotation_deg = 4", ["sky.rotation_deg", "beside radiance"]),
        ("[sky]\nenvironment = \"none.hdr\"", ["none.hdr", "no such file"]),
    ] {
        scene(dir.path(), light, 0.0);
        refused(&render(), 2, &words);
    }
}

/// The leaf in real time, and its part that the path tracer is compared with: the picture's middle, which it fills.
fn drawn(folder: &Path, renderer: &mut Renderer) -> [f64; 3] {
    let manifest = SceneManifest::read(&folder.join("scene.toml")).unwrap();
    let scene = LoadedScene::open(manifest, LeafSearch::default(), &Ledger::new()).unwrap();
    renderer.set_scene(&handover::scene(&scene, &Ledger::new()).unwrap()).unwrap();
    let view = scene.manifest.perspectives().find(|v| v.name == "leaf").unwrap();
    let picture = renderer.render(&handover::camera(&view.camera), 24, 24).unwrap();
    assert!(picture.hdr.iter().all(|p| p[3] == 1.0), "the leaf fills the picture");
    [0, 1, 2].map(|c| mean(picture.hdr.iter().map(|p| f64::from(p[c]))))
}

/// A leaf under a picture with a sun, from above and in its own shade, and under the sky of Hošek and Wilkie: the
/// real-time renderer's mean radiance is the path tracer's.
#[test]
fn leaves_are_lit_in_real_time_as_the_path_tracer_lights_them() {
    let Ok(mut renderer) = Renderer::headless(&Options::default()) else {
        return skip(Need::Adapter, "no adapter draws the leaf");
    };
    let dir = tempfile::tempdir().unwrap();
    let sky = dir.path().join("sky.exr");
    let sky = sky.to_str().unwrap();
    let sun = ["--sun-zenith-deg", "50", "--sun-azimuth-deg", "-120", "--turbidity", "4", "--disk", "--ground", "0.2"];
    succeeded(&run(["eval", "panorama", "-o", sky, "--size", "512x256"].into_iter().chain(sun)));
    let picture = "[sky]\nenvironment = \"sky.exr\"\nrotation_deg = 75\nsun = \"in the picture\"";
    let model = "[sun]\nzenith_deg = 50\nazimuth_deg = -45\n[sky]\nmodel = \"hosek-wilkie\"\nturbidity = 4\n\
                 ground_albedo = [0.2, 0.2, 0.2]";
    for (light, tilt) in [(picture, 0.0), (picture, 55.0), (picture, -140.0), (model, 0.0), (model, 55.0)] {
        scene(dir.path(), light, tilt);
        let fast = drawn(dir.path(), &mut renderer);
        let maps = traced(dir.path(), "leaf", "256");
        for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
            let slow = mean(maps.get(name).unwrap().iter().map(|v| f64::from(*v)));
            assert!((fast[c] / slow - 1.0).abs() < 0.02, "{light}, tilt {tilt}, {name}: {} and {slow}", fast[c]);
        }
    }
}
