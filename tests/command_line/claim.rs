//! No verb overwrites its input, the output of another kind of verb, or a file that the program did not make.

use crate::blade::{Blade, scene};
use crate::common::{begun_synthesis, copy_tree, mesophyll, refused, run, succeeded};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

const SCAN: [&str; 5] = ["data/leaves/elm.toml", "--size", "24x18", "--frames", "8"];

fn text(path: impl AsRef<Path>) -> String {
    path.as_ref().to_str().unwrap().to_string()
}

/// Every file under a folder with its bytes, and every folder.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Option<Vec<u8>>> {
    let mut out = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let path = entry.path();
        if path.is_dir() {
            out.extend(contents(&path));
            out.insert(path, None);
        } else {
            let bytes = std::fs::read(&path).unwrap();
            out.insert(path, Some(bytes));
        }
    }
    out
}

/// A folder with a small leaf fit, a scene that shows it, a capture, a bench, a sky fit and a table. It is made once,
/// and each test gets a copy.
fn made() -> &'static Path {
    static MADE: OnceLock<tempfile::TempDir> = OnceLock::new();
    MADE.get_or_init(|| {
        let dir = crate::common::kept::kept();
        let at = |name: &str| text(dir.path().join(name));
        Blade { width: 24, height: 18, texel_mm: 2.0, ..Blade::default() }.write(&dir.path().join("fits/elm"), "elm");
        scene(dir.path(), "front", "elm", Some(30.0), None, "");
        succeeded(&run([&["synth", "-o", &at("scan")], SCAN.as_slice()].concat()));
        succeeded(&run(["bench", "beam", "-o", &at("bench")]));
        succeeded(&run(["fit", "sky", "--bands", "2", "--method", "compact", "-o", &at("sky")]));
        std::fs::write(at("slabs.csv"), "omega,delta\n0.9,1\n").unwrap();
        std::fs::write(at("marks.csv"), "branch,length_mm,position_mm,deflection_mm\nb,10,5,1\nb,10,10,3\n").unwrap();
        dir
    })
    .path()
}

/// A copy of the folder of [`made`].
struct Workplace {
    dir: tempfile::TempDir,
    scene: String,
}

impl Workplace {
    fn new() -> Workplace {
        let dir = tempfile::tempdir().unwrap();
        copy_tree(made(), dir.path());
        let scene = text(dir.path().join("front.toml"));
        Workplace { dir, scene }
    }

    fn at(&self, name: &str) -> String {
        text(self.dir.path().join(name))
    }
}

#[test]
fn a_folder_of_another_kind_is_refused_and_stays_as_it_is() {
    let place = Workplace::new();
    let [elm, scan, bench, sky] = ["fits/elm", "scan", "bench", "sky"].map(|n| place.at(n));
    let [real, inside, truth, marks] = ["real", "real/deeper", "scan/truth", "marks.csv"].map(|n| place.at(n));
    copy_tree(Path::new("fits/elm"), Path::new(&real));
    let scene = place.scene.as_str();
    let leaf = ["holds the leaf fit \"elm\""].as_slice();
    let capture = ["holds a capture"].as_slice();
    let cases: Vec<(Vec<&str>, &[&str])> = vec![
        (vec!["fit", "sky", "-o", &elm], leaf),
        (vec!["fit", "sky", "-o", &scan], capture),
        (vec!["fit", "sky", "-o", &truth], &["lies inside the capture"]),
        (vec!["fit", "sky", "-o", &bench], &["holds a bench (bench.json)"]),
        (vec!["fit", "leaf", &scan, "-o", &truth], &["lies inside", "scan"]),
        (vec!["fit", "leaf", &scan, "-o", &scan], &["is what is to be read"]),
        (vec!["fit", "leaf", &scan, "-o", &sky], &["holds the sky fit"]),
        (vec!["fit", "translucency", &real, "-o", &real], &["is what is to be read"]),
        (vec!["fit", "translucency", &real, "-o", &inside], &["lies inside"]),
        (vec!["fit", "beam", "--basis", "-o", &elm], leaf),
        (vec!["fit", "beam", "--deflections", &marks, "-o", &elm], leaf),
        (vec!["fit", "beam", "--pictures", &elm], leaf),
        (vec!["run", scene, "--out", &elm], leaf),
        (vec!["run", scene, "--out", &scan], capture),
        (vec!["bench", "slab", "-o", &elm], leaf),
        (vec!["bench", "slab", "-o", &scan], capture),
        (vec!["export", &elm, "--to", "png", "-o", &elm], &["is what is to be read"]),
        (vec!["export", &elm, "--to", "png", "-o", &sky], &["holds the sky fit"]),
        (vec!["synth", "data/leaves/elm.toml", "-o", &elm, "--force"], leaf),
        (vec!["synth", "data/leaves/elm.toml", "-o", &scan], &["is not empty"]),
        #[cfg(feature = "render")]
        (vec!["check", scene, "--out", &elm], leaf),
        #[cfg(feature = "render")]
        (vec!["check", scene, "--out", &scan], capture),
        #[cfg(feature = "render")]
        (vec!["view", scene, "--out", &sky], &["holds the sky fit"]),
    ];
    let before = contents(place.dir.path());
    for (args, words) in cases {
        refused(&run(&args), 2, &[&["the output folder"], words].concat());
        assert!(before == contents(place.dir.path()), "{args:?} changed something");
    }
    // An output of the same kind may be written again.
    succeeded(&run(["fit", "sky", "--bands", "3", "--method", "compact", "-o", &sky]));
    succeeded(&run(["bench", "beam", "-o", &bench]));
}

#[test]
fn a_file_that_belongs_to_something_is_refused_and_stays_as_it_is() {
    let place = Workplace::new();
    let [elm, scan, sky, csv] = ["fits/elm", "scan", "sky", "slabs.csv"].map(|n| place.at(n));
    let [record, times, map] = ["fits/elm/fit.toml", "fits/elm/times.toml", "fits/elm/front.exr"].map(|n| place.at(n));
    let [frame, arrays, rows] =
        ["scan/front/x/0001.exr", "sky/coefficients.json", "bench/bench.json"].map(|n| place.at(n));
    let [linked, hard] = ["linked.csv", "hard.csv"].map(|n| place.at(n));
    #[cfg(unix)]
    std::os::unix::fs::symlink(&csv, &linked).unwrap();
    #[cfg(unix)]
    std::fs::hard_link(&csv, &hard).unwrap();
    let scene = place.scene.clone();
    let cases: Vec<(Vec<&str>, &str)> = vec![
        (vec!["report", &elm, "-o", &record], "belongs to the leaf fit"),
        (vec!["report", &elm, "-o", &times], "belongs to the leaf fit"),
        (vec!["report", &elm, "-o", &scene], "is a .toml file, where one ending in .html was expected"),
        (vec!["report", &elm, "-o", &rows], "belongs to a bench"),
        (vec!["export", &elm, "--to", "exr", "-o", &map], "belongs to the leaf fit"),
        (vec!["export", &elm, "--to", "json", "-o", &record], "belongs to the leaf fit"),
        (vec!["export", &sky, "--to", "json", "-o", &arrays], "belongs to the sky fit"),
        (vec!["export", &elm, "--to", "exr", "-o", &frame], "lies inside the capture"),
        (vec!["eval", "slab", "--in", &csv, "--out", &csv], "is what is to be read"),
        #[cfg(unix)]
        (vec!["eval", "slab", "--in", &csv, "--out", &linked], "is what is to be read"),
        #[cfg(unix)]
        (vec!["eval", "slab", "--in", &csv, "--out", &hard], "is what is to be read"),
        (vec!["eval", "slab", "--in", &csv, "--out", &map], "belongs to the leaf fit"),
        (
            vec!["eval", "panorama", "--sun-zenith-deg", "50", "--turbidity", "3", "-o", &record],
            "belongs to the leaf fit",
        ),
    ];
    let before = contents(place.dir.path());
    for (args, words) in cases {
        refused(&run(&args), 2, &["the output file", words]);
        assert!(before == contents(place.dir.path()), "{args:?} changed something");
    }
    #[cfg(unix)]
    {
        // The shell redirects the same file to standard input.
        let input = std::fs::File::open(&csv).unwrap();
        let output = mesophyll().args(["eval", "slab", "--out", &csv]).stdin(Stdio::from(input)).output().unwrap();
        refused(&output, 2, &["is what is to be read"]);
    }
    // A report may be in the folder of its fit, and may be written again.
    for _ in 0..2 {
        succeeded(&run(["report", &elm, "-o", &place.at("fits/elm/report.html")]));
    }
    let _ = scan;
}

#[test]
fn force_replaces_a_synthetic_capture_and_nothing_else() {
    let place = Workplace::new();
    let synth = |folder: &str, more: &[&str]| run([&["synth", "-o", folder], SCAN.as_slice(), more].concat());
    // A folder that belongs to someone else, with names as in a capture.
    for name in ["mask.exr", "front", "truth/notes.txt", "photographs/holiday.png"] {
        let folder = place.at("stranger");
        let file = Path::new(&folder).join(name);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(&file, "precious").unwrap();
        refused(&synth(&folder, &["--force"]), 2, &["the output folder", "no capture"]);
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "precious");
        std::fs::remove_dir_all(&folder).unwrap();
    }
    // A measured capture has no truth.
    let scan = place.at("scan");
    std::fs::rename(Path::new(&scan).join("truth"), place.at("truth")).unwrap();
    let before = contents(Path::new(&scan));
    refused(&synth(&scan, &["--force"]), 2, &["measured capture", "never replaced"]);
    assert!(before == contents(Path::new(&scan)));
    std::fs::rename(place.at("truth"), Path::new(&scan).join("truth")).unwrap();
    // A synthetic capture is replaced; other files beside its pictures stay.
    let notes = ["scan/notes.txt", "scan/front/notes.txt", "scan/truth/notes.txt"].map(|n| place.at(n));
    notes.iter().for_each(|n| std::fs::write(n, "precious").unwrap());
    std::fs::write(place.at("scan/front/x/0099.exr"), "a frame of a longer scan").unwrap();
    succeeded(&synth(&scan, &["--force", "--seed", "2"]));
    assert!(notes.iter().all(|n| std::fs::read_to_string(n).unwrap() == "precious"));
    assert!(!Path::new(&place.at("scan/front/x/0099.exr")).exists());
    succeeded(&run(["inspect", &scan]));
}

/// A synthesis that was killed is not mistaken for a capture, and does not hinder the next one.
#[test]
#[cfg(unix)]
fn what_a_killed_synthesis_left_is_replaced() {
    let dir = tempfile::tempdir().unwrap();
    let scan = dir.path().join("scan");
    let mut child = begun_synthesis(&scan);
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!scan.join("capture.toml").exists(), "this machine scanned 240 frames before it could be stopped");
    refused(&run(["fit", "sky", "-o", scan.to_str().unwrap()]), 2, &["holds a capture (.mesophyll)"]);
    succeeded(&run([&["synth", "-o", scan.to_str().unwrap()], SCAN.as_slice()].concat()));
    succeeded(&run(["inspect", scan.to_str().unwrap()]));
}

#[test]
#[cfg(unix)]
fn a_link_is_written_through_and_modes_follow_the_umask() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let mode = |name: &str| std::fs::metadata(at(name)).unwrap().permissions().mode() & 0o7777;
    std::fs::write(at("in.csv"), "omega,delta\n0.9,1\n").unwrap();
    std::fs::create_dir(at("far")).unwrap();
    std::fs::write(at("far/old.csv"), "old").unwrap();
    std::fs::set_permissions(at("far/old.csv"), PermissionsExt::from_mode(0o604)).unwrap();
    symlink("far/old.csv", at("link.csv")).unwrap();
    symlink("link.csv", at("twice.csv")).unwrap();
    symlink("far/new.csv", at("dangling.csv")).unwrap();
    let write = |name: &str, umask: &str| {
        let script =
            format!("umask {umask}; exec '{}' -q eval slab --in in.csv --out {name}", env!("CARGO_BIN_EXE_mesophyll"));
        succeeded(&Command::new("sh").current_dir(dir.path()).args(["-c", &script]).output().unwrap());
    };
    for (umask, expected) in [("022", 0o644), ("077", 0o600), ("002", 0o664), ("027", 0o640)] {
        let name = format!("new-{umask}.csv");
        write(&name, umask);
        assert_eq!(mode(&name), expected, "umask {umask}");
    }
    for link in ["link.csv", "twice.csv", "dangling.csv"] {
        write(link, "022");
        assert!(std::fs::symlink_metadata(at(link)).unwrap().is_symlink(), "{link} was replaced");
        assert!(std::fs::read_to_string(at(link)).unwrap().starts_with("omega,delta,rho_d"));
    }
    assert!(at("far/new.csv").is_file());
    // A file that is replaced keeps its permissions.
    assert_eq!((mode("far/old.csv"), mode("far/new.csv")), (0o604, 0o644));
    assert_eq!(std::fs::read_dir(at("far")).unwrap().count(), 2, "temporary files were left");
}
