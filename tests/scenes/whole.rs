//! What `data/scenes/whole.toml` needs and what it does not: each fit is changed, and the picture changes or stays the
//! same byte by byte.
#![cfg(feature = "render")]

use crate::blade::{copy, edit, rehash};
use crate::skips;
use mesophyll::fits::record::FitRecord;
use std::path::{Path, PathBuf};

/// The scene in small, with a leaf that stands nowhere. `change` is applied to its text.
fn scene(folder: &Path, change: impl Fn(String) -> String) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(root.join("data/scenes/whole.toml")).unwrap();
    let small = text
        .replace("width = 600\nheight = 600", "width = 120\nheight = 120")
        .replace("seconds = 2\nfps = 30\n", "")
        .replace("[[plant]]\ngrow", "[[leaf]]\nname = \"spare\"\nfit = \"../../fits/balata\"\n\n[[plant]]\ngrow");
    let path = folder.join("data/scenes/whole.toml");
    std::fs::write(&path, change(small)).unwrap();
    path
}

/// Changes a map, and the hashes with it.
fn changed(fit: &Path, file: &str, change: impl Fn(&str, f32) -> f32) {
    edit(&fit.join(file), change);
    rehash(fit);
}

/// Channels that a paler side has multiplied together, so that its maps agree with each other.
fn paler(channel: &str) -> bool {
    channel.starts_with("gamma") || channel.starts_with("rho_d")
}

type Change = (&'static str, fn(&Path));

/// Nothing of these is in the plan.
const UNNEEDED: [Change; 4] = [
    ("error maps", |fits| {
        changed(&fits.join("elm"), "front_err.exr", |_, v| 2.0 * v + 0.1);
        changed(&fits.join("elm"), "back_err.exr", |_, v| 2.0 * v + 0.1);
    }),
    ("maps of held-out readings", |fits| changed(&fits.join("elm"), "front_held_out.exr", |_, v| 0.5 * v)),
    ("previews", |fits| {
        std::fs::copy(fits.join("elm/front_m.png"), fits.join("elm/back_rho_d.png")).unwrap();
        rehash(&fits.join("elm"));
    }),
    ("a leaf that stands nowhere", |fits| {
        changed(&fits.join("balata"), "front.exr", |c, v| if c.starts_with("gamma") { 0.5 * v } else { v });
    }),
];

/// Each of these is in the plan.
const NEEDED: [Change; 5] = [
    ("gloss of the front", |fits| {
        changed(&fits.join("elm"), "front.exr", |c, v| if c.starts_with("rho_s") { 2.0 * v } else { v });
    }),
    ("albedo factors of the front", |fits| {
        changed(&fits.join("elm"), "front.exr", |c, v| if paler(c) { 0.8 * v } else { v });
    }),
    ("albedo factors of the back", |fits| {
        changed(&fits.join("elm"), "back.exr", |c, v| if paler(c) { 0.8 * v } else { v });
    }),
    ("normals of the front", |fits| {
        changed(&fits.join("elm"), "front.exr", |c, v| if c == "normal.X" { 0.5 * v } else { v });
    }),
    ("taper and load of the twig", |fits| {
        let folder = fits.join("elm-twig");
        let mut record = FitRecord::read(&folder).unwrap();
        let load = record.sections.get_mut("branch elm-twig").unwrap().params.get_mut("load_over_stiffness").unwrap();
        load.value[0] *= 2.5;
        record.write(&folder).unwrap();
    }),
];

/// It draws the scene many times, and makes its translucency maps and its light anew after most changes.
#[test]
#[ignore = "takes minutes"]
fn needed_fits_change_the_whole_scene_and_others_leave_it_alone() {
    let dir = tempfile::tempdir().unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (data, fits) = (dir.path().join("data"), dir.path().join("fits"));
    std::fs::create_dir_all(data.join("scenes")).unwrap();
    for name in ["leaves", "plants"] {
        copy(&root.join("data").join(name), &data.join(name));
    }
    let fresh = || {
        let _ = std::fs::remove_dir_all(&fits);
        for name in ["elm", "balata", "elm-twig"] {
            copy(&root.join("fits").join(name), &fits.join(name));
        }
    };
    let picture = |path: &Path| {
        let mut command = assert_cmd::Command::cargo_bin("mesophyll").unwrap();
        let output = command
            .args(["--quiet", "check", "--goldens-only", "--update-golden", "--json", "--out"])
            .arg(dir.path().join("out"))
            .arg(path)
            .output()
            .unwrap();
        let drawn = !skips::no_adapter(&output);
        let said = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
        // Some of the changes contradict the rest of their fit, which the check names and draws all the same.
        assert!(!drawn || matches!(output.status.code(), Some(0 | 1)), "{said:?}");
        drawn.then(|| std::fs::read(data.join("scenes/golden/whole-whole.png")).unwrap())
    };
    fresh();
    let path = scene(dir.path(), |text| text);
    let Some(before) = picture(&path) else { return };
    let differing = |after: &[u8]| {
        let [a, b] = [&before, after].map(|png| image::load_from_memory(png).unwrap().into_rgb8());
        a.pixels().zip(b.pixels()).filter(|(p, q)| p != q).count()
    };
    assert!(picture(&path).unwrap() == before, "the same scene drawn twice");
    for (what, change) in UNNEEDED {
        fresh();
        change(&fits);
        assert!(picture(&path).unwrap() == before, "{what} changed the picture");
        println!("{what}: no byte changes");
    }
    for (what, change) in NEEDED {
        fresh();
        change(&fits);
        let after = picture(&path).unwrap();
        println!("{what}: {} of 14,400 pixels change", differing(&after));
        assert!(after != before, "{what} did not change the picture");
    }
    // What this scene asks the program to fit: translucency maps, light between leaves, the motion of branches.
    fresh();
    type Change = fn(String) -> String;
    let left_out: [(&str, Change); 4] = [
        ("translucency", |t| t.replace("translucency = { fit = \"../../fits/elm-translucency\" }\n", "")),
        ("light between leaves", |t| t.replace("[transfer]\npaths = 256\n", "")),
        ("flutter", |t| t.replace("flutter = { deg_per_m_s = 4 }\n", "")),
        ("the twig's sway", |t| t.replace("resonance_hz = 2.2\n", "resonance_hz = 1.1\n")),
    ];
    for (what, change) in left_out {
        let after = picture(&scene(dir.path(), change)).unwrap();
        println!("{what}: {} of 14,400 pixels change", differing(&after));
        assert!(after != before, "without {what} the picture is the same");
    }
}
