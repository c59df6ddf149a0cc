//! `mesophyll synth` as a program: the files it writes, the same bytes from the same seed, and its messages for bad
//! requests.

use assert_cmd::Command;
use mesophyll::capture::manifest::{TubeManifest, frame_path, mirror_path, white_path};
use mesophyll::files::image::{exr_info, read_exr};
use mesophyll::files::quantity::Quantity;
use mesophyll::optics::side::Side;
use mesophyll::optics::tube::Travel;
use std::path::{Path, PathBuf};

fn spec(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data/leaves").join(format!("{name}.toml"))
}

fn synth(out: &Path, name: &str, more: &[&str]) -> assert_cmd::assert::Assert {
    let size: &[&str] = if more.contains(&"--size") { &[] } else { &["--size", "32x24"] };
    let mut command = Command::cargo_bin("mesophyll").unwrap();
    command.arg("synth").arg(spec(name)).arg("-o").arg(out).args(["--frames", "8"]).args(size).args(more).assert()
}

/// Every file below a folder with its bytes, sorted by name.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(here) = folders.pop() {
        for entry in std::fs::read_dir(here).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                found.push((path.strip_prefix(folder).unwrap().to_path_buf(), std::fs::read(&path).unwrap()));
            }
        }
    }
    found.sort();
    found
}

#[test]
fn a_capture_is_complete_and_calibrates_to_its_truth() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("elm");
    synth(&out, "elm", &["--noise", "0"]).success();
    let manifest = TubeManifest::read(&out).unwrap();
    assert_eq!((manifest.width, manifest.height, manifest.sides.len(), manifest.passes.len()), (32, 24, 2, 2));
    for travel in [Travel::X, Travel::Y] {
        assert_eq!(manifest.pass(travel).unwrap().positions().len(), 8);
        for k in 0..8 {
            for side in [Side::Front, Side::Back] {
                let info = exr_info(&frame_path(&out, side, travel, k)).unwrap();
                assert!(info.width == 32 && info.height == 24 && !info.half);
            }
            exr_info(&white_path(&out, travel, k)).unwrap();
            exr_info(&mirror_path(&out, travel, k)).unwrap();
        }
    }
    let read = |name: &str| read_exr(&out.join(name)).unwrap();
    let (truth, mask) = (read("truth/front.exr"), read("mask.exr"));
    let get = |maps: &mesophyll::files::image::ChannelMaps, name: &str, k: usize| f64::from(maps.get(name).unwrap()[k]);

    // The light box: (leaf − dark)/(box − dark) is ρt, and that of the back is the mirror image of the front's.
    let (dark, empty) = (read("dark.exr"), read("lightbox_empty.exr"));
    let (front, back) = (read("front/lightbox.exr"), read("back/lightbox.exr"));
    let mut on_leaf = 0;
    for k in 0..32 * 24 {
        if get(&mask, "Y", k) < 0.5 {
            continue;
        }
        on_leaf += 1;
        let mirrored = k / 32 * 32 + 31 - k % 32;
        for c in ["R", "G", "B"] {
            let ratio = |leaf, k| (get(leaf, c, k) - get(&dark, c, k)) / (get(&empty, c, k) - get(&dark, c, k));
            let rho_t = get(&truth, &format!("rho_t.{c}"), k);
            assert!(
                (ratio(&front, k) / rho_t - 1.0).abs() < 1e-4 && (ratio(&back, mirrored) / rho_t - 1.0).abs() < 1e-4
            );
        }
    }
    assert!(on_leaf > 100);

    // A frame is calibrated by the white sheet and a thin tube's closed form (G3; the tube's radius changes it by less
    // than 1 %). It holds at least the diffuse part. Where the mirror direction is far away (last frame of pass x), it
    // holds nothing else.
    let (frame, white) = (read("front/x/0007.exr"), read("white/x/0007.exr"));
    assert_eq!((white.width, white.height), (32, 24));
    for k in (0..32 * 24).filter(|&k| get(&mask, "Y", k) > 0.5) {
        let [x, y] = manifest.size().place_mm(manifest.texel_mm, k);
        let [u, h] = [(250.0 - x) / 100.0, 100.0];
        let r = f64::hypot(1.0, u);
        let half = |end: f64| {
            let phi = (end / (h * r)).atan();
            0.5 * (phi + phi.sin() * phi.cos())
        };
        let flat = 2.0 / std::f64::consts::PI / (r * r) * (half(250.0 - y) + half(250.0 + y));
        let normal = ["X", "Y", "Z"].map(|c| get(&truth, &format!("normal.{c}"), k));
        // The tilt along the tube is left out, because the light's two halves nearly cancel there.
        let tilted = flat * (normal[0] * u + normal[2]).max(0.0);
        let value = (get(&frame, "G", k) - get(&dark, "G", k)) / (get(&white, "G", k) - get(&dark, "G", k)) * flat;
        let diffuse = get(&truth, "rho_d.G", k) * tilted;
        assert!((value - diffuse).abs() < 0.02 * diffuse + 1e-4, "texel {k}: {value} {diffuse}");
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let [a, b, c] = ["a", "b", "c"].map(|n| dir.path().join(n));
    synth(&a, "balata", &["--passes", "x", "--threads", "1"]).success();
    synth(&b, "balata", &["--passes", "x", "--threads", "3", "--raw-exposures"]).success();
    synth(&c, "balata", &["--passes", "x", "--seed", "2"]).success();
    let without_raw: Vec<_> = contents(&b)
        .into_iter()
        .filter(|(p, _)| !p.to_string_lossy().contains("000") || p.extension().is_some_and(|e| e == "exr"))
        .collect();
    assert!(contents(&b).len() == without_raw.len() + 2 * 8 * 3);
    assert!(contents(&a) == without_raw);
    let differing = contents(&a).iter().zip(&contents(&c)).filter(|(x, y)| x != y).count();
    assert!(differing > 20, "another seed changes every noisy file, not {differing}");
}

#[test]
fn bad_requests_end_in_one_sentence_and_exit_code_2() {
    let dir = tempfile::tempdir().unwrap();
    let says = |assert: assert_cmd::assert::Assert, what: &str| {
        let output = assert.code(2).get_output().clone();
        let text = String::from_utf8(output.stderr).unwrap();
        assert!(text.contains(what) && text.lines().count() == 1, "{text}");
    };
    let out = dir.path().join("new");
    let run = |args: &[&str], spec: &Path, out: &Path| {
        Command::cargo_bin("mesophyll")
            .unwrap()
            .args(["synth", "--quiet"])
            .arg(spec)
            .arg("-o")
            .arg(out)
            .args(args)
            .assert()
    };
    for size in ["0x0", "32", "32x", "-3x4", "99999x2"] {
        says(run(&[&format!("--size={size}")], &spec("elm"), &out), "--size: found");
    }
    says(run(&["--frames", "3"], &spec("elm"), &out), "--frames: found 3");
    says(run(&["--noise", "2"], &spec("elm"), &out), "--noise: found 2");
    says(run(&[], Path::new("no/such.toml"), &out), "no/such.toml: no such file");
    let full = dir.path().join("full");
    std::fs::create_dir(&full).unwrap();
    std::fs::write(full.join("precious.txt"), "x").unwrap();
    says(run(&[], &spec("elm"), &full), "is not empty");
    assert!(full.join("precious.txt").exists());
    let text = std::fs::read_to_string(spec("elm")).unwrap();
    for (from, to, what) in [
        ("lean = 0.8", "leen = 0.8", "unknown field `leen`"),
        ("thickness_mm = 0.15", "thickness_mm = -0.15", "thickness_mm: found -0.15"),
        ("[0.4, ", "[0.01, ", "outline.profile"),
    ] {
        assert!(text.contains(from), "{from}");
        let path = dir.path().join("bad.toml");
        std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
        says(run(&[], &path, &out), what);
    }
    assert!(!out.exists());
    // A file where the folder should be cannot be written into, not even by root.
    says(run(&["--size", "32x24"], &spec("elm"), &full.join("precious.txt")), "cannot write to the output folder");
}

#[test]
fn every_species_grows() {
    let dir = tempfile::tempdir().unwrap();
    for entry in std::fs::read_dir(spec("elm").parent().unwrap()).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "toml") {
            continue;
        }
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let out = dir.path().join(&name);
        synth(&out, &name, &["--size", "16x12", "--passes", "x"]).success();
        let manifest = TubeManifest::read(&out).unwrap();
        assert_eq!(manifest.name, name);
        let truth = read_exr(&out.join("truth/back.exr")).unwrap();
        let inside = truth.scalar(Quantity::Mask).unwrap().iter().filter(|m| **m == 1.0).count();
        assert!(inside > 16 * 12 / 6, "{name} covers {inside} of 192 texels");
    }
}

/// A leaf made of layers has a truth with pigments and without σ. Light is conserved. The visible colours are those of
/// the exact method for the stated contents.
#[test]
fn a_leaf_of_layers_has_another_truth() {
    use mesophyll::optics::foliar::{LayeredLeaf, MesophyllPath as Crossing, Oblateness, exact};
    use mesophyll::optics::side::Side as Lit;

    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("soybean");
    synth(&out, "soybean", &["--passes", "x", "--noise", "0"]).success();
    for (side, lit) in [("front", Lit::Front), ("back", Lit::Back)] {
        let truth = read_exr(&out.join(format!("truth/{side}.exr"))).unwrap();
        for none in ["sigma_a.R", "sigma_s.G", "gamma.B"] {
            assert!(truth.get(none).is_none(), "{side} states {none}, which a leaf of layers does not have");
        }
        let get = |name: &str, k: usize| f64::from(truth.get(name).unwrap()[k]);
        let inside: Vec<usize> = (0..32 * 24).filter(|&k| get("mask.Y", k) == 1.0).collect();
        let of = |name: &str| inside.iter().map(|&k| get(name, k)).collect::<Vec<f64>>();
        let span = |name: &str| of(name).into_iter().fold([f64::MAX, 0.0], |[a, b]: [f64; 2], v| [a.min(v), b.max(v)]);
        let [least, most] = span("chlorophyll.Y");
        assert!(least < 0.5 * most && most > 30.0, "veins hold less: {least} to {most}");
        assert!(span("carotenoid.Y")[0] > 3.0, "carotenoids stay in veins");
        // Green, at 550 nm in data/tables/pigments.csv, with the specification's contents of protein, cellulose and
        // water.
        for &k in inside.iter().step_by(37) {
            let pigments = 12_000.0 * get("chlorophyll.Y", k) + 6000.0 * get("carotenoid.Y", k);
            let depth = 1e-6 * (pigments + 10.0 * 500.0 + 4.4 * 1000.0) + 0.0006 * 0.01;
            let leaf = LayeredLeaf {
                depth,
                n_cuticle: 1.51,
                n_mesophyll: 1.415,
                n_antidermal: 1.41,
                oblateness: Oblateness::USUAL,
                path: Crossing::Sieve,
            };
            let want = exact::response(&leaf, lit, 0.0).unwrap();
            let mirrored = (0.51f64 / 2.51).powi(2);
            let found = [get("rho_d.G", k), get("rho_t.G", k), get("absorption.G", k) * get("thickness.Y", k)];
            let off = [found[0] - (want.reflectance - mirrored), found[1] - want.transmittance, found[2] / depth - 1.0];
            assert!(off.iter().all(|e| e.abs() < 2e-6), "{side} texel {k}: {off:?}");
        }
    }
    for (args, what) in [
        (["--model", "exact"], "interior: found no such table, or only zeros in it, expected one, for the model exact"),
        (["--acquisition", "dome"], "which the model foliar does not have"),
    ] {
        let other = dir.path().join("other");
        let said = Command::cargo_bin("mesophyll")
            .unwrap()
            .arg("synth")
            .arg(spec("soybean"))
            .arg("-o")
            .arg(&other)
            .args(args)
            .assert();
        let text = String::from_utf8_lossy(&said.failure().code(2).get_output().stderr).into_owned();
        assert!(text.contains(what), "{text}");
        assert!(!other.exists());
    }
    let text = std::fs::read_to_string(spec("soybean")).unwrap();
    for (from, to, what) in [
        ("../tables/pigments.csv", "none.csv", "none.csv"),
        ("path = \"sieve\"", "path = \"straight\"", "slant"),
        (
            "chlorophyll_ug_cm2 = 40.0",
            "chlorophyll_ug_cm2 = -40.0",
            "foliar.chlorophyll_ug_cm2: found -40, expected 0 to 100000",
        ),
        ("chlorophyll_ug_cm2 = 40.0", "chlorophyll_ug_cm2 = 1e6", "foliar.chlorophyll_ug_cm2: found 1000000, expected"),
        ("chlorophyll_ug_cm2 = 40.0", "chlorophyll_ug_cm2 = 4000.0", "expected at most 20"),
        ("path = \"sieve\"", "path = \"sieve\"\nwavelengths_nm = [700, 550, 450]", "foliar.wavelengths_nm: found 700"),
        ("path = \"sieve\"", "path = \"sieve\"\noblateness = [5, 5, 1]", "expected an array of length 4"),
    ] {
        assert!(text.contains(from), "{from}");
        let path = dir.path().join("bad.toml");
        let table = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/tables/pigments.csv");
        let told = text.replacen(from, to, 1).replace("../tables/pigments.csv", table.to_str().unwrap());
        std::fs::write(&path, told).unwrap();
        let said = Command::cargo_bin("mesophyll")
            .unwrap()
            .arg("synth")
            .arg(&path)
            .arg("-o")
            .arg(dir.path().join("bad"))
            .assert();
        let text = String::from_utf8_lossy(&said.failure().code(2).get_output().stderr).into_owned();
        assert!(text.contains(what), "{to}: {text}");
    }
}
