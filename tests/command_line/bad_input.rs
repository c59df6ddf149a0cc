//! Bad input and bad places as a user meets them: there is one sentence and the right exit code, and nothing is lost.
//! Damaged captures and interrupted fits are in `leaf_fit.rs`, damaged fits and meshes in `check.rs`. This file has the
//! cases that all verbs share, and scenes.

use crate::blade::{Blade, scene};
use crate::common::{begun_synthesis, mesophyll, refused, run};
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};

const SLABS: &str = "omega,delta\n0.9,1\n0.5,2\n";

/// A folder with a small fit, a scene that shows it and a table of slabs.
fn workplace() -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    Blade { width: 24, height: 18, texel_mm: 2.0, ..Blade::default() }.write(&dir.path().join("fits/elm"), "elm");
    let path = scene(dir.path(), "front", "elm", Some(30.0), None, "");
    std::fs::write(dir.path().join("slabs.csv"), SLABS).unwrap();
    (dir, path)
}

fn text(path: &Path) -> String {
    path.to_str().unwrap().to_string()
}

#[test]
fn a_scene_that_cannot_be_read_is_named_by_file_line_and_field() {
    let (dir, path) = workplace();
    let good = std::fs::read_to_string(&path).unwrap();
    let scan = "scan = { spec = \"elm.toml\", size = \"0x0\" }";
    let cases: [(&str, &str, &[&str]); 6] = [
        ("tolerance = 0.004", "tolerance = 0.004\ntoleranze = 1", &["front.toml:4", "unknown field `toleranze`"]),
        (
            "fit = \"fits/elm\"",
            "fit = \"fits/oak\"",
            &["front.toml", "leaf \"elm\": fit", "there is no fit at", "fits/oak"],
        ),
        ("fit = \"fits/elm\"", scan, &["front.toml:6", "leaf.scan: size: found \"0x0\"", "WIDTHxHEIGHT"]),
        ("fov_deg = 30", "fov_deg = \"wide\"", &["front.toml:19", "string"]),
        ("samples = 32", "samples = 0", &["check.samples: found 0, expected 1 to"]),
        ("zenith_deg = 30", "zenith_deg = nan", &["sun.zenith_deg: found NaN"]),
    ];
    for (from, to, words) in cases {
        assert!(good.contains(from), "{from}");
        std::fs::write(&path, good.replacen(from, to, 1)).unwrap();
        for verb in ["plan", "run"] {
            let out = text(&dir.path().join("out"));
            let more = if verb == "run" { vec!["--out", out.as_str()] } else { vec![] };
            refused(&run([&[verb, path.to_str().unwrap()], more.as_slice()].concat()), 2, words);
        }
    }
}

#[test]
fn files_of_the_wrong_kind_are_said_to_be() {
    let (dir, path) = workplace();
    let binary = dir.path().join("binary.toml");
    std::fs::write(&binary, [0xff, 0xfe, 0x00, 0x41]).unwrap();
    let [plant, triangles] = ["plant.glb", "plant.obj"].map(|name| dir.path().join(name));
    std::fs::write(&plant, b"glTF\x02\0\0\0\x0c\0\0\0").unwrap();
    std::fs::write(&triangles, "# of another program\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let [folder, binary, scene, plant, triangles] =
        [dir.path(), binary.as_path(), path.as_path(), plant.as_path(), triangles.as_path()].map(text);
    let nowhere = text(&dir.path().join("nowhere"));
    let dressed = text(&dir.path().join("dressed.glb"));
    let csv = text(&dir.path().join("slabs.csv"));
    let cases: [(&[&str], &[&str]); 14] = [
        (&["plan", &plant], &["plant.glb: found a binary glTF file (.glb), expected a scene", "[[plant]] file"]),
        (&["render", &plant, "-o", &nowhere], &["plant.glb: found a binary glTF file (.glb), expected a scene"]),
        (&["eval", "canopy", &triangles, "--fluxes"], &["plant.obj: found a Wavefront OBJ file, expected a scene"]),
        (&["import", &triangles, "-o", &nowhere], &["not a readable glTF file (found a Wavefront OBJ file", ".gltf"]),
        (
            &["dress", &triangles, "--leaf", "a=fits/elm", "-o", &dressed],
            &["not a readable glTF file (found a Wavefront OBJ file", ".gltf"],
        ),
        (&["plan", &folder], &[&folder, "found a folder, expected a file"]),
        (&["plan", &binary], &["binary.toml", "not UTF-8"]),
        (&["plan", &nowhere], &["nowhere", "no such file"]),
        (&["synth", &folder, "-o", &nowhere], &["found a folder, expected a file"]),
        (&["fit", "leaf", &scene, "-o", &nowhere], &[&scene, "found a file, expected the folder of a capture"]),
        (&["eval", "slab", "--in", &folder], &["found a folder, expected a file"]),
        (&["eval", "slab", "--in", &csv, "--out", &folder], &[&folder, "found a folder, expected the name of a file"]),
        (&["fit", "slab", "--in", &csv], &["slabs.csv: rho_d: no such column; the header has omega, delta"]),
        (&["report", &nowhere], &["nowhere", "no such folder"]),
    ];
    for (args, words) in cases {
        refused(&run(args), 2, words);
    }
    for (bytes, words) in [
        (b"".as_slice(), ["slabs.csv", "no header line"]),
        (b"\xff\xfeo\x00m".as_slice(), ["line 1", "not valid UTF-8"]),
        (b"omega/delta\n0,9/1\n".as_slice(), ["omega: no such column", "omega/delta"]),
    ] {
        std::fs::write(&csv, bytes).unwrap();
        refused(&run(["eval", "slab", "--in", &csv]), 2, &words);
    }
    // Semicolons and decimal commas are read, and that is said.
    std::fs::write(&csv, b"omega;delta\n0,9;1\n").unwrap();
    let loud = std::process::Command::new(env!("CARGO_BIN_EXE_mesophyll"));
    let output = { loud }.args(["eval", "slab", "--in", &csv]).output().unwrap();
    let [rows, said] = [&output.stdout, &output.stderr].map(|b| String::from_utf8_lossy(b).into_owned());
    assert!(rows.starts_with("omega,delta,rho_d,rho_t,status\n\"0,9\",1,0.26741") && rows.ends_with(",ok\n"), "{rows}");
    assert!(said.contains("slabs.csv: read as separated by semicolons with decimal commas"), "{said}");
    // A byte-order mark and line ends of other systems are allowed. A cell that is no text only affects its own row.
    std::fs::write(&csv, b"\xef\xbb\xbfomega,delta\r\n0.9,1\r\n0.9,\xff\r\n0.5,2\r\n").unwrap();
    let output = run(["eval", "slab", "--in", &csv]);
    let rows = String::from_utf8_lossy(&output.stdout);
    let status: Vec<&str> = rows.lines().map(|l| l.rsplit(',').next().unwrap()).collect();
    assert_eq!(
        (output.status.code(), status),
        (Some(0), vec!["status", "ok", "refused: delta is not valid UTF-8 text; expected a number", "ok"])
    );
}

/// The output is a file where a folder should be, or a place where nobody can create files, not even root.
#[test]
fn places_that_cannot_be_written_are_the_command_line_s_mistake() {
    let (dir, path) = workplace();
    let [fit, scene, csv] = [dir.path().join("fits/elm"), path.clone(), dir.path().join("slabs.csv")].map(|p| text(&p));
    for place in [format!("{csv}/in"), "/proc/mesophyll".to_string()] {
        let file = format!("{place}/out.x");
        let cases: [&[&str]; 8] = [
            &["synth", "data/leaves/elm.toml", "-o", &place, "--size", "24x18"],
            &["run", &scene, "--out", &place],
            &["report", &fit, "-o", &file],
            &["export", &fit, "--to", "gltf", "-o", &file],
            &["export", &fit, "--to", "csv", "-o", &file],
            &["export", &fit, "--to", "png", "-o", &place],
            &["eval", "slab", "--in", &csv, "--out", &file],
            &["bench", "slab", "-o", &place],
        ];
        for args in cases {
            refused(&run(args), 2, &["cannot write", &place]);
        }
        #[cfg(feature = "render")]
        refused(&run(["check", &scene, "--out", &place]), 2, &["cannot write", &place]);
    }
    assert_eq!(std::fs::read_to_string(&csv).unwrap(), SLABS);
}

/// Runs under a limit of 4 KiB for a file, which stops a write in its middle as a full disk does.
#[cfg(unix)]
fn with_little_room(args: &[&str]) -> Output {
    let words: String = args.iter().map(|a| format!(" '{a}'")).collect();
    let script = format!("trap '' XFSZ; ulimit -f 8; exec '{}' --quiet{words}", env!("CARGO_BIN_EXE_mesophyll"));
    mesophyll_free("sh").args(["-c", &script]).output().unwrap()
}

#[cfg(unix)]
fn mesophyll_free(program: &str) -> std::process::Command {
    let mut command = std::process::Command::new(program);
    command.current_dir(env!("CARGO_MANIFEST_DIR"));
    command
}

#[test]
#[cfg(unix)]
fn a_full_disk_is_said_and_what_was_there_stays() {
    let (dir, _) = workplace();
    let fit = text(&dir.path().join("fits/elm"));
    let slabs: String =
        std::iter::once("omega,delta\n".to_string()).chain((0..400).map(|k| format!("0.9,{k}\n"))).collect();
    std::fs::write(dir.path().join("slabs.csv"), slabs).unwrap();
    let csv = text(&dir.path().join("slabs.csv"));
    let kept = dir.path().join("kept");
    std::fs::create_dir(&kept).unwrap();
    let old = kept.join("old.out");
    std::fs::write(&old, "what was there").unwrap();
    let out = text(&old);
    let cases: [&[&str]; 5] = [
        &["eval", "slab", "--in", &csv, "--out", &out],
        &["report", &fit, "-o", &out],
        &["export", &fit, "--to", "gltf", "-o", &out],
        &["export", &fit, "--to", "exr", "-o", &out],
        &["export", &fit, "--to", "csv", "-o", &out],
    ];
    for args in cases {
        refused(&with_little_room(args), 1, &["cannot write", "old.out", "largest size allowed"]);
        assert_eq!(std::fs::read_to_string(&old).unwrap(), "what was there", "{args:?}");
        assert_eq!(std::fs::read_dir(&kept).unwrap().count(), 1, "{args:?} left something behind");
    }
    // A scan that could not be written whole is no capture.
    let scan = text(&dir.path().join("scan"));
    refused(
        &with_little_room(&["synth", "data/leaves/elm.toml", "-o", &scan, "--size", "48x36", "--frames", "8"]),
        1,
        &["cannot write"],
    );
    assert_eq!(std::fs::read_dir(&scan).unwrap().count(), 0, "a scan that failed left something behind");
}

/// The device that is always full is the output file, and the standard output.
#[test]
#[cfg(target_os = "linux")]
fn a_device_without_room_is_said_to_be_full() {
    let (dir, path) = workplace();
    let csv = text(&dir.path().join("slabs.csv"));
    refused(
        &run(["eval", "slab", "--in", &csv, "--out", "/dev/full"]),
        1,
        &["cannot write /dev/full", "the disk is full"],
    );
    for args in
        [vec!["eval", "slab", "--in", &csv], vec!["plan", path.to_str().unwrap(), "--json"], vec!["stress", "solve"]]
    {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let child = mesophyll().args(&args).stdout(Stdio::from(full)).stderr(Stdio::piped()).spawn().unwrap();
        refused(&child.wait_with_output().unwrap(), 1, &["cannot write standard output", "the disk is full"]);
    }
}

#[test]
#[cfg(unix)]
fn a_scan_that_is_stopped_is_no_capture() {
    let dir = tempfile::tempdir().unwrap();
    let scan = dir.path().join("scan");
    let child = begun_synthesis(&scan);
    let _ = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    let output = child.wait_with_output().unwrap();
    // A machine that finishes before the signal arrives has nothing to stop.
    if !output.status.success() {
        refused(&output, 130, &["stopped before the capture", "nothing of it was kept"]);
        assert_eq!(std::fs::read_dir(&scan).unwrap().count(), 0);
    }
}

#[test]
fn options_that_would_run_without_end_have_limits() {
    let (dir, _) = workplace();
    let csv = text(&dir.path().join("slabs.csv"));
    refused_usage(&run(["eval", "slab", "--in", &csv, "--threads", "65535"]), "1..=1024");
    // No slab has this thickness, because σ would be larger than any number.
    std::fs::write(&csv, "rho_d,rho_t,h\n0.1,0.2,1e-308\n0.1,0.2,1e300\n0.1,0.2,0.2\n").unwrap();
    let output = run(["fit", "slab", "--in", &csv, "--noise", "1e-4"]);
    let rows = String::from_utf8_lossy(&output.stdout).into_owned();
    let status: Vec<&str> = rows.lines().skip(1).map(|l| l.rsplit(',').next().unwrap()).collect();
    assert!(status[0].starts_with("refused: h is 1e-308 mm; expected a thickness of 1e-7 to 1e6 mm"), "{rows}");
    assert!(status[1].starts_with("refused: h is 1e300 mm") && status[2] == "ok", "{rows}");
    // 200,000 columns are refused before they are compared with each other.
    std::fs::write(&csv, (0..200_000).map(|k| format!("c{k}")).collect::<Vec<_>>().join(",")).unwrap();
    refused(&run(["fit", "slab", "--in", &csv]), 2, &["found 200000 columns, expected at most 65536"]);
}

/// `--resume` is part of the contract. The same command resumes without it too.
#[test]
fn fit_leaf_takes_resume() {
    let output = run(["fit", "leaf", "no/such", "-o", "no/such/fit", "--resume"]);
    refused(&output, 2, &["no/such"]);
    refused_usage(&run(["fit", "leaf", "no/such", "-o", "x", "--resume", "--force"]), "--force");
}

/// A message of the argument parser: several lines, and exit code 2.
#[track_caller]
fn refused_usage(output: &Output, word: &str) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && said.contains(word), "{said}");
}
