//! Captures under a dome as a user meets them: the messages of `synth` and `inspect` for good and bad input.

use crate::common::{copy_tree, refused, run, succeeded};
use mesophyll::files::image::{ChannelMaps, Packing, read_exr, write_exr};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn synth(out: &Path, extra: &[&str]) -> std::process::Output {
    run([&["synth", "data/leaves/elm.toml", "-o", text(out), "--acquisition", "dome"], extra].concat())
}

/// Captures of a patch that the leaf fills, and of a whole leaf. They are made once.
fn made() -> &'static (tempfile::TempDir, PathBuf, PathBuf) {
    static ONCE: OnceLock<(tempfile::TempDir, PathBuf, PathBuf)> = OnceLock::new();
    ONCE.get_or_init(|| {
        let dir = crate::common::kept::kept();
        let (patch, whole) = (dir.path().join("patch"), dir.path().join("whole"));
        succeeded(&synth(&patch, &["--patch-mm", "12", "--patch-at", "-4,1", "--size", "80x60"]));
        succeeded(&synth(&whole, &["--size", "80x60"]));
        (dir, patch, whole)
    })
}

/// `inspect --json` of a changed copy: exit code, and problems, warnings and notes.
fn look(from: &Path, change: impl FnOnce(&Path)) -> (i32, [String; 3], String) {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("scan");
    copy_tree(from, &folder);
    change(&folder);
    let out = run(["inspect", text(&folder), "--json"]);
    let stderr = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(!stderr.contains("panicked"), "{stderr}");
    let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let list = |name: &str| {
        found[name].as_array().unwrap().iter().map(|v| format!("{}\n", v.as_str().unwrap())).collect::<String>()
    };
    (out.status.code().unwrap(), ["problems", "warnings", "notes"].map(list), stderr)
}

fn edit(folder: &Path, file: &str, change: impl Fn(&mut ChannelMaps)) {
    let path = folder.join(file);
    let mut maps = read_exr(&path).unwrap();
    change(&mut maps);
    write_exr(&path, &maps, Packing::Raw).unwrap();
}

fn each(folder: &Path, file: &str, value: impl Fn(f32) -> f32) {
    edit(folder, file, |maps| maps.channels.iter_mut().for_each(|(_, v)| v.iter_mut().for_each(|v| *v = value(*v))));
}

fn toml(folder: &Path, from: &str, to: &str) {
    let path = folder.join("capture.toml");
    let old = std::fs::read_to_string(&path).unwrap();
    assert!(old.contains(from), "{from} is not in\n{old}");
    std::fs::write(&path, old.replacen(from, to, 1)).unwrap();
}

fn turned(folder: &Path, file: &str) {
    edit(folder, file, |maps| {
        let w = maps.width;
        maps.channels.iter_mut().for_each(|(_, v)| v.chunks_mut(w).for_each(<[f32]>::reverse));
    });
}

#[test]
fn good_captures_are_summarised() {
    let (_, patch, whole) = made();
    for folder in [patch, whole] {
        let (code, [problems, _, notes], _) = look(folder, |_| {});
        assert_eq!((code, problems.as_str()), (0, ""));
        assert!(notes.contains("synthetic"));
        let out = run(["inspect", text(folder)]);
        let said = String::from_utf8_lossy(&out.stdout).into_owned();
        for word in [
            "under a dome",
            "front/albedo.exr",
            "thickness:",
            "the two height scans are tilted by",
            "This capture can be fitted.",
        ] {
            assert!(said.contains(word), "{word} is missing in\n{said}");
        }
    }
    // The texels are almost 1 mm wide on a leaf of 0.15 mm.
    let (_, [_, warnings, _], _) = look(whole, |_| {});
    assert!(warnings.contains("light spreads sideways by about its thickness"), "{warnings}");
    let (_, [_, warnings, _], _) = look(patch, |folder| each(folder, "front/albedo.exr", |v| v.min(0.05)));
    assert!(warnings.contains("share the highest value"), "{warnings}");
    let (_, [_, _, notes], _) = look(patch, |folder| {
        for file in ["dark.exr", "mask.exr"] {
            std::fs::remove_file(folder.join(file)).unwrap();
        }
        toml(folder, "highlight_index", "# highlight_index");
    });
    for word in ["dark.exr is absent", "mask.exr is absent", "one photograph does not tell highlight from colour"] {
        assert!(notes.contains(word), "{word}: {notes}");
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let [a, b, c] = ["a", "b", "c"].map(|n| dir.path().join(n));
    let small = ["--patch-mm", "3", "--size", "30x20"];
    succeeded(&synth(&a, &[&small[..], &["--threads", "1"]].concat()));
    succeeded(&synth(&b, &[&small[..], &["--threads", "3"]].concat()));
    succeeded(&synth(&c, &[&small[..], &["--seed", "2"]].concat()));
    let files = ["albedo", "translucency", "height"].map(|p| format!("front/{p}.exr"));
    let files = files.iter().map(String::as_str).chain(["white.exr", "dark.exr", "truth/back.exr", "capture.toml"]);
    for file in files {
        let [a, b, c] = [&a, &b, &c].map(|f| std::fs::read(f.join(file)).unwrap());
        assert!(a == b, "{file} differs between one thread and three");
        assert!(a != c || file.starts_with("truth"), "{file} is the same for another seed");
    }
}

#[test]
fn what_is_wrong_is_named_by_file_and_field() {
    let (_, patch, _) = made();
    let thickest = {
        let text = std::fs::read_to_string(patch.join("capture.toml")).unwrap();
        text.lines().find(|l| l.starts_with("thickness_max_mm")).unwrap().to_string()
    };
    // What is done to the capture, and what is then said.
    type Case<'a> = (&'a dyn Fn(&Path), &'a str);
    let cases: [Case; 16] = [
        (&|f| std::fs::remove_file(f.join("front/height.exr")).unwrap(), "front/height.exr: no such file or folder"),
        (&|f| std::fs::remove_file(f.join("white.exr")).unwrap(), "white.exr: no such file or folder"),
        (
            &|f| {
                let mut small = ChannelMaps::new(4, 3);
                ["R", "G", "B"].iter().for_each(|c| small.push(*c, vec![0.1; 12]));
                write_exr(&f.join("back/albedo.exr"), &small, Packing::Raw).unwrap();
            },
            "back/albedo.exr: found 4x3 texels, capture.toml says 80x60",
        ),
        (
            &|f| edit(f, "back/height.exr", |m| m.channels[0].0 = "Z".into()),
            "back/height.exr: Y: no such channel; the file holds Z",
        ),
        (&|f| each(f, "front/translucency.exr", |_| f32::NAN), "front/translucency.exr: no reading anywhere"),
        (&|f| each(f, "front/height.exr", |_| f32::NAN), "front/height.exr: no height anywhere"),
        (&|f| each(f, "backlight_empty.exr", |_| 0.0), "backlight_empty.exr: 100.0 % of the texels are no brighter"),
        (
            &|f| std::fs::write(f.join("front/albedo.exr"), b"not an image").unwrap(),
            "front/albedo.exr: not a readable OpenEXR file",
        ),
        (&|f| toml(f, "schema = 1", "schema = 1\ncolour = 3"), "capture.toml:2: unknown field `colour`"),
        (
            &|f| toml(f, &thickest, "thickness_max_mm = 0.0"),
            "capture.toml: thickness_max_mm: found 0, expected a positive length in mm",
        ),
        (&|f| toml(f, &thickest, ""), "missing field `thickness_max_mm`"),
        (
            &|f| toml(f, "[\"front\", \"back\"]", "[\"front\"]"),
            "capture.toml: sides: found [\"front\"], expected [\"front\", \"back\"]",
        ),
        (&|f| toml(f, "kind = \"dome\"", "kind = \"dom\""), "capture.toml: kind: found \"dom\", expected \"dome\""),
        // Heights point away from the cameras, so veins would be thinner than the blade between them.
        (
            &|f| ["front", "back"].iter().for_each(|s| each(f, &format!("{s}/height.exr"), |v| -v)),
            "expected veins to stand out: heights are positive towards each side's camera",
        ),
        (&|f| each(f, "back/height.exr", |v| -v), "back/height.exr: front and back heights sum to values"),
        (&|f| turned(f, "back/height.exr"), "back/height.exr: front and back heights sum to values"),
    ];
    for (change, said) in cases {
        let (code, [problems, ..], stderr) = look(patch, change);
        assert!(code == 2 && problems.contains(said), "{said:?} is missing in: {problems}{stderr}");
        assert_eq!(stderr.trim().lines().count(), 1, "{stderr}");
    }
    // All faults of the files are reported at once.
    let (_, [problems, ..], stderr) = look(patch, |f| {
        std::fs::remove_file(f.join("front/height.exr")).unwrap();
        std::fs::remove_file(f.join("back/translucency.exr")).unwrap();
    });
    assert!(problems.lines().count() == 2 && stderr.contains("it has 2 problems"), "{problems}{stderr}");
}

#[test]
fn outlines_tell_swapped_sides_and_a_back_that_is_not_mirrored() {
    let (_, _, whole) = made();
    let (code, [problems, ..], _) = look(whole, |f| {
        std::fs::rename(f.join("front"), f.join("other")).unwrap();
        std::fs::rename(f.join("back"), f.join("front")).unwrap();
        std::fs::rename(f.join("other"), f.join("back")).unwrap();
    });
    assert!(
        code == 2 && problems.contains("front/translucency.exr: the leaf's outline is the mirror image of mask.exr"),
        "{problems}"
    );
    let (code, [problems, ..], _) = look(whole, |f| {
        ["albedo", "translucency", "height"].iter().for_each(|p| turned(f, &format!("back/{p}.exr")));
        std::fs::remove_file(f.join("mask.exr")).unwrap();
    });
    assert!(
        code == 2 && problems.contains("back/translucency.exr: the leaf's outline is the mirror image of the front's"),
        "{problems}"
    );
}

#[test]
fn each_reader_names_the_kind_it_found() {
    let (dir, patch, _) = made();
    let error = mesophyll::capture::reader::TubeCapture::open(patch).unwrap_err().to_string();
    assert!(
        error.contains("capture.toml: kind: found \"dome\"") && error.contains("expected a scan under a linear"),
        "{error}"
    );
    let tube = dir.path().join("tube");
    succeeded(&run([
        "synth",
        "data/leaves/elm.toml",
        "-o",
        text(&tube),
        "--size",
        "16x12",
        "--frames",
        "8",
        "--passes",
        "x",
    ]));
    let error = mesophyll::capture::dome::DomeCapture::open(&tube).unwrap_err().to_string();
    assert!(
        error.contains("capture.toml: kind: found none: a scan under a linear light source")
            && error.contains("expected \"dome\""),
        "{error}"
    );
}

#[test]
fn bad_requests_end_in_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("new");
    let cases: [(&[&str], &[&str]); 8] = [
        (&["--frames", "20"], &["--frames: has no meaning here", "--acquisition tube"]),
        (&["--passes", "x"], &["--passes"]),
        (&["--patch-mm", "0"], &["--patch-mm: found 0, expected a positive width"]),
        (&["--patch-mm", "5", "--patch-at", "1,2,3"], &["--patch-at: found 3 numbers"]),
        (&["--patch-mm", "1", "--patch-at", "500,0"], &["not one texel lies on the leaf"]),
        (&["--height-noise=-1"], &["--height-noise: found -1, expected 0 to 10 mm"]),
        (&["--size", "2x2"], &["--size: found 2x2, expected at least 3x3"]),
        (&["--noise", "7"], &["--noise: found 7"]),
    ];
    for (args, words) in cases {
        let args: Vec<String> = args.iter().map(|a| a.to_string()).collect();
        let joined: Vec<&str> = args.iter().map(String::as_str).collect();
        refused(&synth(&out, &joined), 2, words);
    }
    let tube = run(["synth", "data/leaves/elm.toml", "-o", text(&out), "--patch-mm", "5", "--patch-at", "1,1"]);
    refused(&tube, 2, &["--patch-at: has no meaning here", "--acquisition dome"]);
    // A capture of the other kind in the same folder is replaced completely.
    succeeded(&synth(&out, &["--patch-mm", "3", "--size", "12x12"]));
    succeeded(&run(["synth", "data/leaves/elm.toml", "-o", text(&out), "--size", "16x12", "--frames", "8", "--force"]));
    assert!(!out.join("white.exr").exists() && out.join("white").exists());
}
