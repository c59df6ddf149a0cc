//! `mesophyll report`, driven from outside.

mod samples;

use assert_cmd::Command;
use samples::{Sample, write_fit, write_run};
use std::path::Path;

fn mesophyll(args: &[&str], folder: &Path) -> (i32, String, String) {
    let out = Command::cargo_bin("mesophyll").unwrap().args(args).current_dir(folder).output().unwrap();
    let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
    (out.status.code().unwrap_or(-1), text(&out.stdout), text(&out.stderr))
}

/// Writes full-size samples and their reports under `MESOPHYLL_LOOK`, for eyes.
#[test]
#[ignore = "for looking at: set MESOPHYLL_LOOK to a folder"]
fn samples_to_look_at() {
    let Some(folder) = std::env::var_os("MESOPHYLL_LOOK") else { return };
    let folder = Path::new(&folder);
    let full = Sample { name: "elm".into(), width: 720, height: 540, ..Sample::default() };
    write_fit(&folder.join("elm"), &full);
    write_fit(&folder.join("elm2"), &Sample { name: "elm".into(), seed: 2, truth: false, sides: vec!["front"], ..full });
    write_run(&folder.join("run"), true);
    for (args, _) in [(["report", "elm", "run", "-o", "one.html"], 0), (["report", "elm", "elm2", "-o", "two.html"], 0)] {
        let (code, _, stderr) = mesophyll(&args, folder);
        assert_eq!(code, 0, "{stderr}");
    }
}
