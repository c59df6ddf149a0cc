//! The Python package. The wheel is built, installed into a fresh virtual environment, compared with the command line,
//! and used by the notebooks of `docs/notebooks`.

use crate::common::skips::{Need, skip};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Runs a command that must succeed, and returns its output.
#[track_caller]
fn done(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {said}");
    said
}

/// The Python of a fresh virtual environment with the wheel in it; `None` where the tools are not installed.
fn python() -> Option<PathBuf> {
    static MADE: OnceLock<Option<(tempfile::TempDir, PathBuf)>> = OnceLock::new();
    let made = MADE.get_or_init(|| {
        let target = Path::new(env!("CARGO_BIN_EXE_mesophyll")).ancestors().nth(2)?;
        let tools = target.join("python/bin");
        if !tools.join("maturin").exists() {
            return None;
        }
        let folder = crate::common::kept::kept();
        let (wheels, fresh) = (folder.path().join("wheels"), folder.path().join("fresh"));
        let mut maturin = Command::new(tools.join("maturin"));
        maturin
            .args(["build", "--profile", "dev", "--locked", "-m", "src/outputs/python/Cargo.toml", "-o"])
            .arg(&wheels);
        // The wheel is used on this machine only, so it need not run on others.
        maturin.args(["--compatibility", "linux"]).current_dir(root()).env("CARGO", root().join(".ci/cargo-as-tested"));
        done(&mut maturin);
        let wheel = std::fs::read_dir(&wheels).unwrap().flatten().next().expect("a wheel").path();
        let name = wheel.file_name().unwrap_or_default().to_string_lossy().into_owned();
        assert!(name.starts_with("mesophyll-") && name.contains("-abi3-"), "{name}");
        done(Command::new(tools.join("python")).args(["-m", "venv", "--without-pip"]).arg(&fresh));
        let python = fresh.join("bin/python");
        let pip = ["--python", python.to_str()?, "install", "--quiet", "--no-index", "--no-deps"];
        done(Command::new(tools.join("pip")).args(pip).arg(&wheel));
        // NumPy and matplotlib come from the environment of the tools.
        let ask = "import sysconfig; print(sysconfig.get_path('purelib'))";
        let packages = |python: &Path| done(Command::new(python).args(["-c", ask])).trim().to_string();
        let link = Path::new(&packages(&python)).join("tools.pth");
        std::fs::write(link, packages(&tools.join("python"))).unwrap();
        Some((folder, python))
    });
    if made.is_none() {
        skip(
            Need::System,
            "no maturin, NumPy and matplotlib in target/python (made by .ci/python from Python 3.11 or newer)",
        );
    }
    made.as_ref().map(|(_, python)| python.clone())
}

/// Runs a file of `tests/python`, which has so many tests, with the package and the program.
#[track_caller]
fn passes(file: &str, tests: usize) {
    let Some(python) = python() else { return };
    let mut command = Command::new(python);
    command.arg(root().join("tests/python").join(file)).current_dir(root());
    let said = done(command.env("MESOPHYLL", env!("CARGO_BIN_EXE_mesophyll")));
    assert!(said.contains(&format!("Ran {tests} tests")), "{said}");
}

#[test]
fn the_package_gives_the_numbers_of_the_command_line() {
    passes("package.py", 16);
}

#[test]
fn the_package_has_every_verb() {
    passes("verbs.py", 16);
}

#[test]
fn the_package_has_every_design() {
    passes("designs.py", 3);
}

#[test]
fn the_notebooks_run() {
    let Some(python) = python() else { return };
    let program = Path::new(env!("CARGO_BIN_EXE_mesophyll")).parent().unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap_or_default());
    let notebooks = std::fs::read_dir(root().join("docs/notebooks")).unwrap().flatten().map(|f| f.path());
    let mut ran = 0;
    for notebook in notebooks.filter(|f| f.extension().is_some_and(|e| e == "ipynb")) {
        let mut command = Command::new(&python);
        command.arg(root().join("tests/python/notebook.py")).arg(&notebook).env("PATH", &path);
        println!("{}", done(&mut command));
        ran += 1;
    }
    assert_eq!(ran, 4);
}
