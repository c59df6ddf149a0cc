//! A film of a scene: the content of its frames, how it is continued, and what is refused.

use crate::common::skips::{Need, skip};
use mesophyll::fits::grass;
use mesophyll::scene::draw::handover;
use mesophyll::scene::loaded::LoadedScene;
use mesophyll::scene::manifest::SceneManifest;
use mesophyll::scene::placed::{leaf::LeafSearch, ledger::Ledger};
use mesophyll_viewer::{Options, Renderer};
use std::path::{Path, PathBuf};
use std::process::Command;

const WIND: &str = "[wind]\nspeed_m_s = 9\nazimuth_deg = 30\nseed = 7\n";

/// A twig with eight leaves under a white sky, drawn with few pixels.
fn scene(folder: &Path, wind: &str) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    std::fs::copy(root.join("data/plants/elm-twig.toml"), folder.join("twig.toml")).unwrap();
    std::fs::copy(root.join("fits/elm/blade.glb"), folder.join("leaf.glb")).unwrap();
    let path = folder.join("scene.toml");
    let text = format!(
        "schema = 1\nname = \"s\"\n[[leaf]]\nname = \"elm\"\nuniform = {{ rho_d = [[0.1, 0.2, 0.1], [0.1, 0.2, 0.1]], \
         rho_t = [0.1, 0.2, 0.1] }}\nmesh = \"leaf.glb\"\n[sky]\nradiance = [1, 1, 1]\n[[view]]\nname = \"v\"\nkind = \
         \"perspective\"\neye_mm = [0, -900, 100]\ntarget_mm = [0, 0, 100]\nfov_deg = 40\n[check]\nwidth = \
         40\nheight = 30\nsamples = 1\nframes = 1\nseed = 1\n[[plant]]\ngrow = \"twig.toml\"\nmaterials = {{ leaf = \
         \"elm\", bark = [0.1, 0.1, 0.1] }}\n{wind}"
    );
    std::fs::write(&path, text).unwrap();
    path
}

fn film(folder: &Path, words: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mesophyll"));
    let output = command.args(["film", "scene.toml", "-o", "film"]).args(words).current_dir(folder).output().unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn a_film_shows_the_wind_and_goes_on() {
    if Renderer::headless(&Options::default()).is_err() {
        return skip(Need::Adapter, "no adapter draws a film");
    }
    let folder = tempfile::tempdir().unwrap();
    let path = scene(folder.path(), WIND);
    let frame = |k: u32| std::fs::read(folder.path().join(format!("film/frame-{k:05}.png"))).ok();
    let (code, told) = film(folder.path(), &["--from", "2", "--to", "2.3", "--fps", "10"]);
    assert_eq!(code, Some(0), "{told}");
    let first: Vec<_> = (0..3).map(|k| frame(k).unwrap()).collect();
    assert!(frame(3).is_none() && first[0] != first[1] && first[1] != first[2]);

    // Each frame is the scene's picture at its time.
    let manifest = SceneManifest::read(&path).unwrap();
    let scene = LoadedScene::open(manifest, LeafSearch::default(), &Ledger::new()).unwrap();
    let mut drawn = handover::scene(&scene, &Ledger::new()).unwrap();
    drawn.wind.as_mut().unwrap().time_s = 2.2;
    let mut renderer = Renderer::headless(&Options::default()).unwrap();
    renderer.set_scene(&drawn).unwrap();
    let picture =
        renderer.render(&handover::camera(&scene.manifest.perspectives().next().unwrap().camera), 40, 30).unwrap();
    let seen = image::load_from_memory(&first[2]).unwrap().to_rgb8();
    let wanted: Vec<u8> = picture.ldr.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
    assert_eq!(seen.into_raw(), wanted);

    // A missing frame is drawn again, existing frames stay, and a longer film continues with them.
    std::fs::remove_file(folder.path().join("film/frame-00001.png")).unwrap();
    let written = |k: u32| folder.path().join(format!("film/frame-{k:05}.png")).metadata().unwrap().modified().unwrap();
    let kept = written(0);
    let (code, told) = film(folder.path(), &["--from", "2", "--to", "2.4", "--fps", "10"]);
    assert_eq!(code, Some(0), "{told}");
    assert!((0..3).all(|k| frame(k).as_ref() == Some(&first[k as usize])) && frame(3).is_some());
    assert_eq!(kept, written(0));

    // Motion vectors are added to existing frames. Every pixel that shows a surface has one, and the sky has none. The
    // wind moves something.
    let vectors = |k: u32| folder.path().join(format!("film/frame-{k:05}.motion.exr"));
    assert!(!vectors(0).exists());
    let (code, told) = film(folder.path(), &["--from", "2", "--to", "2.4", "--fps", "10", "--motion"]);
    assert_eq!(code, Some(0), "{told}");
    assert!((0..4).all(|k| frame(k).is_some() && vectors(k).exists()) && frame(0).as_ref() == Some(&first[0]));
    let maps = mesophyll::files::image::read_exr(&vectors(1)).unwrap();
    assert_eq!((maps.width, maps.height), (40, 30));
    let [x, y] = ["motion.X", "motion.Y"].map(|c| maps.get(c).unwrap());
    let lengths: Vec<f32> = x.iter().zip(y).map(|(x, y)| x.hypot(*y)).collect();
    let covered = lengths.iter().filter(|l| !l.is_nan()).count();
    let moved = lengths.iter().filter(|l| **l > 1e-3).count();
    assert!(covered > 0 && covered < lengths.len() && 2 * moved > covered, "{moved} of {covered}");
    assert!(x.iter().zip(y).all(|(x, y)| x.is_nan() == y.is_nan()));

    // Another film is not mixed with this one.
    let (code, told) = film(folder.path(), &["--from", "1", "--to", "1.1", "--fps", "10"]);
    assert_eq!(code, Some(2), "{told}");
    assert!(told.contains("holds 4 frames of another film") && told.contains("--force"), "{told}");
    assert_eq!(frame(0).as_ref(), Some(&first[0]));
    let (code, told) = film(folder.path(), &["--from", "1", "--to", "1.1", "--fps", "10", "--force"]);
    assert_eq!(code, Some(0), "{told}");
    assert!(frame(0).as_ref() != Some(&first[0]) && frame(1).is_none() && !vectors(0).exists());

    // A film whose record cannot be read is not overwritten. A size that is refused does not claim the folder.
    std::fs::write(folder.path().join("film/film.json"), "{\"film\": \"x\"}").unwrap();
    let (code, told) = film(folder.path(), &["--from", "1", "--to", "1.1", "--fps", "10"]);
    assert!(code == Some(2) && told.contains("not the record of a film") && frame(0).is_some(), "{told}");
    let (code, told) = film(folder.path(), &["--to", "0.1", "--size", "60000x4", "--force"]);
    assert!(code == Some(2) && told.contains("on this adapter") && frame(0).is_some(), "{told}");
}

#[test]
fn a_film_that_cannot_be_drawn_says_why() {
    let folder = tempfile::tempdir().unwrap();
    scene(folder.path(), "");
    let refused = |words: &[&str], expected: &str| {
        let (code, told) = film(folder.path(), words);
        assert!(code == Some(2) && told.contains(expected), "{words:?}: {code:?}: {told}");
        assert!(!folder.path().join("film/film.json").exists());
    };
    refused(&[], "nothing moves in this scene");
    scene(folder.path(), WIND);
    refused(&["--from", "3", "--to", "3"], "expected two times");
    refused(&["--to", "1e9"], "expected at most 100000");
    refused(&["--fps", "0"], "expected a number above 0");
    refused(&["--size", "40"], "expected WIDTHxHEIGHT");
    refused(&["--view", "w"], "found \"w\", expected one of the scene's views (v)");
}

/// Frames with slices that were fitted again are not mixed with those of an earlier film.
#[test]
fn a_film_knows_the_slices_of_its_lawn() {
    if Renderer::headless(&Options::default()).is_err() {
        return skip(Need::Adapter, "no adapter draws a film");
    }
    let folder = tempfile::tempdir().unwrap();
    let meadow = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("data/grass/lawn.toml")).unwrap();
    let small = meadow.replace("size_mm = [400, 400]", "size_mm = [60, 60]");
    assert!(small != meadow);
    std::fs::write(folder.path().join("meadow.toml"), small).unwrap();
    let fit = |slices: usize| {
        let options =
            grass::Options { slices, texels: [16, 8], rays: 1, entries: 4, view: false, ..Default::default() };
        grass::run(&folder.path().join("meadow.toml"), &folder.path().join("slices"), &options).unwrap();
    };
    fit(2);
    let lawn = "[[grass]]\nname = \"lawn\"\nmeadow = \"meadow.toml\"\nfit = \"slices\"\ntiles = [2, \
                2]\n[ground]\nalbedo = [0, 0, 0]\nreach_mm = 1000\n";
    scene(folder.path(), &format!("{WIND}{lawn}"));
    let draw = || film(folder.path(), &["--to", "0.1", "--fps", "10", "--size", "8x8"]);
    assert_eq!(draw().0, Some(0));
    assert_eq!(draw().0, Some(0));
    let leaning = format!("{WIND}{}", lawn.replace("tiles =", "lean_per_m_s = 0.01\ntiles ="));
    scene(folder.path(), &leaning);
    let (code, told) = film(folder.path(), &["--to", "0.1", "--fps", "10", "--size", "8x8", "--motion", "--force"]);
    assert!(code == Some(2) && told.contains("a lawn that leans in the wind"), "{told}");
    scene(folder.path(), &format!("{WIND}{lawn}"));
    fit(3);
    let (code, told) = draw();
    assert!(code == Some(2) && told.contains("or of a scene, fit or adapter that has changed since"), "{told}");
}

/// A leaf that fades: its film turns from green to yellow and stays so from `at_s` on.
#[test]
fn a_film_of_autumn_turns_yellow() {
    if Renderer::headless(&Options::default()).is_err() {
        return skip(Need::Adapter, "no adapter draws a film");
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    let data = |name: &str| root.join(name).display().to_string();
    let text = std::fs::read_to_string(root.join("data/foliar/autumn-film.toml")).unwrap();
    let text = text
        .replace("../tables/pigments.csv", &data("data/tables/pigments.csv"))
        .replace("../../fits/elm/blade.glb", &data("fits/elm/blade.glb"));
    std::fs::write(folder.path().join("scene.toml"), &text).unwrap();
    let (code, told) = film(folder.path(), &["--from", "0", "--to", "16", "--fps", "0.25", "--size", "24x24"]);
    assert_eq!(code, Some(0), "{told}");
    let middle = |k: u32| {
        let file = folder.path().join(format!("film/frame-{k:05}.png"));
        image::open(file).unwrap().to_rgb8().get_pixel(12, 12).0.map(i32::from)
    };
    let [first, second, third, last] = [0, 1, 2, 3].map(middle);
    let yellow = |[r, g, _]: [i32; 3]| r - g;
    assert!(yellow(first) < -20, "{first:?}");
    assert!(first[0] < second[0] && second[0] < third[0] && third[0] < last[0], "{first:?} {second:?} {third:?}");
    // Only chlorophyll decreases. The blue light that carotenoid absorbs stays absorbed.
    assert!(yellow(last) > -3 && last[2] < last[0] - 15, "{last:?}");

    for (old, new, said) in [
        ("at_s = 10", "at_s = 0", "fades_to: found at_s = 0, expected above 0"),
        ("{ chlorophyll_ug_cm2 = 0.1", "{ chlorophyll_ug_cm2 = 60", "found chlorophyll_ug_cm2 = 60, expected above 0"),
        ("{ chlorophyll_ug_cm2 = 0.1", "{ chlorophyll_ug_cm2 = 0", "found chlorophyll_ug_cm2 = 0, expected above 0"),
        ("[sun]", "[transfer]\n\n[sun]", "fades_to: given beside [transfer]"),
        ("[[instance]]", "lobe = \"ggx\"\n\n[[instance]]", "leaf.lobe: given, but leaf"),
    ] {
        std::fs::write(folder.path().join("scene.toml"), text.replacen(old, new, 1)).unwrap();
        let (code, told) = film(folder.path(), &["--from", "0", "--to", "1", "--fps", "1"]);
        assert!(code == Some(2) && told.contains(said), "{new}: {told}");
    }
}
