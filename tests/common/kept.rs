//! Folders that the tests of a program share. Rust drops no `static`, so that a temporary folder in one stays when the
//! program has ended. These lie with what is built, and the next program of tests removes those that nobody uses.

use std::path::Path;
use std::sync::Once;
use std::time::Duration;

const MARK: &str = "kept-";
/// Where nobody can tell whether a process still runs, its folders are left alone for so long.
const AGE: Duration = Duration::from_secs(24 * 3600);

/// A fresh folder for a `static`.
pub fn kept() -> tempfile::TempDir {
    static TIDY: Once = Once::new();
    let all = Path::new(env!("CARGO_TARGET_TMPDIR"));
    TIDY.call_once(|| remove_unused(all));
    tempfile::Builder::new().prefix(&format!("{MARK}{}-", std::process::id())).tempdir_in(all).unwrap()
}

/// Removes the folders of programs that have ended. What cannot be removed stays.
fn remove_unused(all: &Path) {
    for entry in std::fs::read_dir(all).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let Some((process, _)) = name.to_str().and_then(|n| n.strip_prefix(MARK)?.split_once('-')) else { continue };
        let processes = Path::new("/proc");
        let used = if processes.join("self").exists() {
            processes.join(process).exists()
        } else {
            entry.metadata().and_then(|m| m.modified()).is_ok_and(|at| at.elapsed().is_ok_and(|age| age < AGE))
        };
        if !used {
            let _ = std::fs::remove_dir_all(entry.path());
        }
    }
}
