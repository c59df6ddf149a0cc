//! The commands of the README and of `docs/` are run as they are printed, page by page, in a copy of the working
//! folder.
//!
//! Commands that need a long computation or a window are not run. They are listed here with the reason, and counted.
//! Scans are made smaller for the test. For these, the printed command is only checked to be accepted.

use crate::common;
use std::path::Path;
use std::process::Command;

const TISSUE: &str = "its texels have to be this fine, so it cannot be made smaller: minutes; tests/leaves/tissue.rs \
 fits photographs of its own";

const TRACED: &str = "slices are made and blades are traced without optimisation: a minute a view";

/// Commands that are not run, with the reason.
const LEFT_OUT: &[(&str, &str)] = &[
    ("make demo", "it builds an optimised program and runs the demo scene: minutes"),
    ("make test", "it runs this test"),
    ("make full", "two gigabytes of frames"),
    ("make web", "it builds an optimised module, for which Rust's target for browsers is needed: minutes"),
    ("make wheel", "it builds an optimised module: minutes"),
    ("make gallery", "large pictures are traced: an hour"),
    (
        "mesophyll render data/gallery/close.toml --real-time --run out/gallery -o out/gallery-real-time",
        "its leaf is scanned with 640 x 480 texels without optimisation: minutes",
    ),
    ("cargo build --release", "it builds an optimised program: minutes"),
    ("cargo build --release --no-default-features", "it builds an optimised program: minutes"),
    (
        "mesophyll run data/scenes/demo.toml --out out/demo",
        "a whole scan is fitted and drawn without optimisation: minutes",
    ),
    ("mesophyll run data/scenes/translucency.toml --out out/tr", "many views are drawn without optimisation: minutes"),
    ("mesophyll check data/scenes/between.toml", "two views are traced and drawn without optimisation: minutes"),
    (
        "mesophyll check data/scenes/between.toml --compare-methods",
        "two views are traced five times without optimisation: minutes",
    ),
    (
        "mesophyll run data/canopies/species/elm.toml --out out/elm-cluster",
        "14 leaves with 270 anchors each are traced and drawn without optimisation: minutes",
    ),
    ("mesophyll bench transfer", "a cluster is traced many times: minutes"),
    ("mesophyll check data/scenes/twig.toml", "a twig under a sky is drawn without optimisation: minutes"),
    (
        "mesophyll check data/scenes/back-lit.toml",
        "tests/scenes/check.rs draws and judges scenes where there is an adapter",
    ),
    ("mesophyll view data/scenes/glossy-sky.toml", "it opens a window and waits for its user"),
    ("mesophyll stress all", "tests/models/solve.rs runs its tables, each once: minutes"),
    ("mesophyll stress coverage", "ten thousand texels are fitted without optimisation: minutes"),
    ("mesophyll synth data/leaves/elm.toml -o out/patch-scan --patch-mm 13 --size 160x120 --frames 60", TISSUE),
    ("mesophyll fit leaf out/patch-scan -o out/patch", TISSUE),
    (
        "mesophyll synth data/leaves/elm.toml -o out/beams --acquisition beams --patch-mm 13 --size 160x120 --beam \
         front,90,0 --beam front,50,20",
        TISSUE,
    ),
    ("mesophyll fit tissue out/beams --blade out/patch -o out/tissue", TISSUE),
    ("mesophyll bench all -o out/bench", "a minute of an optimised program"),
    ("mesophyll bench translucency", "a minute of an optimised program"),
    ("mesophyll check data/grass/scenes/post.toml", TRACED),
    ("mesophyll check data/grass/scenes/meadow.toml", TRACED),
    ("mesophyll check data/grass/scenes/stone.toml", TRACED),
    ("mesophyll check data/grass/scenes/tree.toml", TRACED),
    ("mesophyll check data/grass/scenes/hill.toml", TRACED),
    ("mesophyll film data/grass/scenes/meadow.toml --from 0 --to 1.2 --fps 5 -o out/meadow-film", TRACED),
    ("mesophyll bench grass", "a lawn is photographed and weighted five times: a minute of an optimised program"),
];

/// Commands that are made smaller for the test: the printed words, and the words that are run instead.
const SMALLER: &[(&str, &str)] = &[
    ("-o out/elm-drawn --samples 16", "-o out/elm-drawn --samples 1"),
    ("--acquisition photo --size 960x720", "--acquisition photo --size 160x120"),
    ("--fps 4 -o out/autumn-film", "--fps 0.2 --size 60x60 -o out/autumn-film"),
    ("--to 4 -o out/breeze", "--to 0.1 --size 60x60 -o out/breeze"),
    ("--to 4 -o out/avenue", "--to 0.1 --size 60x60 -o out/avenue"),
    ("-o out/avenue-traced --samples 64", "-o out/avenue-traced --samples 1"),
    ("--size 120x90 --frames 60", "--size 48x36 --frames 40"),
    ("-o out/autumn --samples 64", "-o out/autumn --samples 1"),
    ("-o out/plant --samples 64", "-o out/plant --samples 1"),
    ("--size 240x180 --frames 60", "--size 48x36 --frames 12"),
    ("--acquisition dome --size 240x180", "--acquisition dome --size 48x36"),
    ("-o out/twig --samples 64", "-o out/twig --samples 1"),
    ("-o out/cluster --samples 64", "-o out/cluster --samples 1"),
    ("-o out/cluster --error 0.01", "-o out/cluster --samples 1"),
    ("plan.toml --more 2", "plan.toml --more 2 --cameras 1 --draws 1 --samples 8 --columns 8"),
    ("data/pictures/unknown.toml -o out/found", "data/pictures/unknown.toml -o out/found --samples 64"),
    ("scene.toml -o out/predicted --view beside", "scene.toml -o out/predicted --view beside --samples 4"),
    ("data/grass/lawn.toml -o out/lawn-slices", "data/grass/lawn.toml -o out/lawn-slices --texels 32x8 --entries 8"),
    ("data/canopies/directions.csv", "data/canopies/directions.csv --samples 2048"),
    ("data/canopies/views.csv", "data/canopies/views.csv --samples 1024"),
    ("data/canopies/unknown.toml -o out/spectra", "data/canopies/unknown.toml -o out/spectra --samples 16"),
];

/// Scenes that are made smaller for the test: the file, its words, and the words that replace them. A limit of the
/// first scene's check holds for each pixel, so it is as strict in a quarter of the pixels.
const SMALLER_SCENES: [(&str, &str, &str); 6] = [
    ("data/foliar/autumn.toml", "width = 600\nheight = 220", "width = 300\nheight = 110"),
    ("data/scenes/stands/avenue.toml", "plants/wych-elm.toml", "plants/elm-twig.toml"),
    ("data/scenes/stands/avenue.toml", "plants/bird-cherry-sapling.toml", "plants/elm-twig.toml"),
    ("data/scenes/stands/avenue.toml", "plants/balata.toml", "plants/elm-twig.toml"),
    ("data/scenes/stands/avenue.toml", "width = 480\nheight = 320", "width = 60\nheight = 40"),
    ("data/scenes/between.toml", "dense-twig.glb", "two-species.glb"),
];

/// Keeps one leaf of a scene and its instance, because each leaf is computed from its layers anew.
fn one_leaf(scene: &Path) {
    let mut read: toml::Table = toml::from_str(&std::fs::read_to_string(scene).unwrap()).unwrap();
    for list in ["leaf", "instance"] {
        let all = read[list].as_array_mut().unwrap();
        all.truncate(1);
    }
    std::fs::write(scene, toml::to_string(&read).unwrap()).unwrap();
}

fn is_command(text: &str) -> bool {
    ["mesophyll ", "make ", "cargo "].iter().any(|program| text.starts_with(program))
}

/// The commands of a page in their order: lines of its code blocks and, with `spans`, code within lines.
fn commands(page: &str, spans: bool) -> Vec<String> {
    let mut found = Vec::new();
    for line in page.lines() {
        if let Some(code) = line.strip_prefix("    ").filter(|code| is_command(code)) {
            // A remark begins with two blanks and a hash.
            found.push(code.split("  #").next().unwrap_or_default().trim().to_string());
        } else if spans {
            found.extend(line.split('`').skip(1).step_by(2).filter(|span| is_command(span)).map(String::from));
        }
    }
    // `make demo    # what it does` is one command and a remark.
    found.iter().map(|c| c.split("   ").next().unwrap_or_default().to_string()).collect()
}

/// A printed command as the test runs it.
fn smaller(printed: &str) -> String {
    SMALLER.iter().fold(printed.to_string(), |command, (long, short)| command.replace(long, short))
}

/// The output path of a command, from its `-o` or `--out`.
fn written(words: &[&str]) -> Option<String> {
    let at = words.iter().position(|w| ["-o", "--out"].contains(w))?;
    words.get(at + 1).map(|w| w.to_string())
}

/// The page with a command for every task.
const LISTED: &str = "docs/commands.md";

/// Runs the commands of a page. Returns how many were run and how many were left out. A command that the list has too
/// counts as run, because the list's test runs it, unless a later command of the page reads what it writes.
#[track_caller]
fn run_page(page: &str, spans: bool) -> [usize; 2] {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(root.join(page)).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for name in ["data", "fits"] {
        common::copy_tree(&root.join(name), &folder.path().join(name));
    }
    for (scene, long, short) in SMALLER_SCENES {
        let path = folder.path().join(scene);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(long), "{scene} has no {long}");
        std::fs::write(path, text.replace(long, short)).unwrap();
    }
    one_leaf(&folder.path().join("data/foliar/autumn.toml"));
    let listed = std::fs::read_to_string(root.join(LISTED)).unwrap();
    let elsewhere: Vec<String> =
        if page == LISTED { Vec::new() } else { commands(&listed, true).iter().map(|c| smaller(c)).collect() };
    let all = commands(&text, spans);
    let mut counts = [0, 0];
    for (k, printed) in all.iter().enumerate() {
        let words: Vec<&str> = printed.split_whitespace().collect();
        if words[0] == "mesophyll" {
            let parsed = mesophyll::cli::command().try_get_matches_from(&words);
            assert!(parsed.is_ok(), "{page}: {printed}: {}", parsed.err().map_or_else(String::new, |e| e.to_string()));
        }
        if let Some((_, why)) = LEFT_OUT.iter().find(|(command, _)| command == printed) {
            println!("{page}: left out: {printed} ({why})");
            counts[1] += 1;
            continue;
        }
        let smaller = smaller(printed);
        let words: Vec<&str> = smaller.split_whitespace().collect();
        assert_eq!(words[0], "mesophyll", "{page}: {printed} is neither run nor left out");
        let read = |place: String| all[k + 1..].iter().any(|later| later.contains(&place));
        if elsewhere.contains(&smaller) && !written(&words).is_some_and(read) {
            println!("{page}: run by the test of {LISTED}: {smaller}");
            counts[0] += 1;
            continue;
        }
        let clock = std::time::Instant::now();
        let output = Command::new(env!("CARGO_BIN_EXE_mesophyll"))
            .args(&words[1..])
            .current_dir(folder.path())
            .output()
            .unwrap();
        // Leaves are smaller here than on the page, and one page fits a leaf that the model does not describe: a fit or
        // a report of them may say that they are not good.
        let judged = ["report", "fit"].contains(words.get(1).unwrap_or(&"")) && output.status.code() == Some(1);
        let judged =
            judged && (words[1] == "report" || String::from_utf8_lossy(&output.stderr).contains("is not good"));
        assert!(output.status.success() || judged, "{page}: {smaller}: {}", String::from_utf8_lossy(&output.stderr));
        if let Some(place) = written(&words) {
            assert!(folder.path().join(&place).exists(), "{page}: {smaller} wrote no {place}");
        }
        println!("{page}: {:.1} s: {smaller}", clock.elapsed().as_secs_f64());
        counts[0] += 1;
    }
    println!("{page}: {} commands ran, {} are left out", counts[0], counts[1]);
    counts
}

#[test]
fn the_commands_of_the_readme_run() {
    assert_eq!(run_page("README.md", false), [7, 3]);
}

#[test]
fn the_commands_of_the_list_run() {
    let [ran, left_out] = run_page(LISTED, true);
    assert!(ran >= 23 && left_out <= 14, "{ran} ran, {left_out} are left out");
}

#[test]
fn the_commands_of_the_grass_page_run() {
    assert_eq!(run_page("docs/grass.md", false), [4, 8]);
}

#[test]
fn the_commands_of_the_sky_page_run() {
    assert_eq!(run_page("docs/sky.md", false), [8, 0]);
}

#[test]
fn the_commands_of_the_translucency_page_run() {
    assert_eq!(run_page("docs/translucency.md", false), [6, 4]);
}

#[test]
fn the_commands_of_the_light_page_run() {
    assert_eq!(run_page("docs/light.md", false), [6, 4]);
}

#[test]
fn the_commands_of_the_foliar_page_run() {
    assert_eq!(run_page("docs/foliar.md", false), [10, 0]);
}

#[test]
fn the_commands_of_the_tutorials_run() {
    assert_eq!(run_page("docs/tutorials.md", false), [24, 0]);
    assert_eq!(run_page("docs/good.md", false), [2, 0]);
}

#[test]
fn the_commands_of_the_export_page_run() {
    assert_eq!(run_page("docs/export.md", false), [11, 0]);
}

#[test]
fn the_commands_of_the_web_page_run() {
    assert_eq!(run_page("docs/web.md", false), [1, 1]);
}

#[test]
fn the_commands_of_the_photo_page_run() {
    assert_eq!(run_page("docs/photo.md", false), [5, 0]);
}

#[test]
fn the_commands_of_the_page_of_pictures_run() {
    assert_eq!(run_page("docs/pictures.md", false), [5, 0]);
}

#[test]
fn the_commands_of_the_page_of_designs_run() {
    assert_eq!(run_page("docs/designs.md", false), [7, 0]);
}

#[test]
fn the_commands_of_the_looks_page_run() {
    assert_eq!(run_page("docs/looks.md", false), [4, 0]);
}

#[test]
fn the_commands_of_the_pages_of_plants_run() {
    assert_eq!(run_page("docs/plants.md", false), [3, 0]);
    assert_eq!(run_page("docs/plants-import.md", false), [3, 0]);
    assert_eq!(run_page("docs/motion.md", false), [8, 0]);
}

/// Every page with commands is tested, and every command that is left out stands on a page.
#[test]
fn the_list_of_what_is_left_out_is_true() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut printed = commands(&std::fs::read_to_string(root.join("README.md")).unwrap(), false);
    let pages = ["docs", "docs/evidence"].map(|folder| std::fs::read_dir(root.join(folder)).unwrap());
    for file in pages.into_iter().flatten().flatten().map(|f| f.path()) {
        if file.extension().is_none_or(|e| e != "md") {
            continue;
        }
        let found = commands(&std::fs::read_to_string(&file).unwrap(), file.ends_with(LISTED));
        let tested = [
            LISTED,
            "docs/sky.md",
            "docs/translucency.md",
            "docs/light.md",
            "docs/foliar.md",
            "docs/plants.md",
            "docs/plants-import.md",
            "docs/motion.md",
            "docs/grass.md",
            "docs/tutorials.md",
            "docs/good.md",
            "docs/designs.md",
            "docs/export.md",
            "docs/photo.md",
            "docs/looks.md",
            "docs/pictures.md",
            "docs/web.md",
        ]
        .iter()
        .any(|page| file.ends_with(page));
        let all_left_out = found.iter().all(|c| LEFT_OUT.iter().any(|(command, _)| command == c));
        assert!(tested || all_left_out, "{}: its commands are not run", file.display());
        printed.extend(found);
    }
    for (command, _) in LEFT_OUT {
        assert!(printed.iter().any(|p| p == command), "{command} stands on no page");
    }
    println!("{} commands are printed, {} of them left out", printed.len(), LEFT_OUT.len());
}
