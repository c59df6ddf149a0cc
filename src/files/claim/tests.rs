//! Which files an output may replace.

use super::file;
use std::fs;

#[test]
fn an_output_replaces_what_its_verb_writes_and_nothing_else() {
    let dir = tempfile::tempdir().unwrap();
    let place = |name: &str| dir.path().join(name);
    for name in ["notes.md", "s.sh", "data.txt", "Makefile", "picture.png", "own.csv"] {
        fs::write(place(name), "mine").unwrap();
    }
    fs::write(place("empty"), "").unwrap();
    for name in ["notes.md", "s.sh", "data.txt", "Makefile", "picture.png"] {
        let sentence = file(&place(name), &["csv", "json"], &[]).unwrap_err().to_string();
        assert!(sentence.contains(name) && sentence.contains("ending in .csv or .json"), "{sentence}");
    }
    // A new file keeps to its ending too, as far as the ending says something.
    for name in ["new.md", "new.sh", "new.glb"] {
        let sentence = file(&place(name), &["csv"], &[]).unwrap_err().to_string();
        assert!(sentence.contains(name) && sentence.contains("expected .csv"), "{sentence}");
    }
    // Under an ending that says nothing, what the verb wrote before is replaced.
    fs::write(place("answers.out"), "x,y,status\n1,2,ok\n").unwrap();
    fs::write(place("notes.out"), "x,y\n").unwrap();
    assert!(file(&place("notes.out"), &["csv"], &[]).is_err());
    for name in ["own.csv", "new.csv", "new.CSV", "new.txt", "new", "empty", "answers.out"] {
        assert!(file(&place(name), &["csv"], &[]).is_ok(), "{name}");
    }
}

#[cfg(unix)]
#[test]
fn pipes_in_an_output_folder_do_not_hang() {
    let dir = tempfile::tempdir().unwrap();
    for name in [".mesophyll", "plan.json", ".probe.partial", ".rows.csv.partial", ".film.partial"] {
        let made = std::process::Command::new("mkfifo").arg(dir.path().join(name)).status();
        if !made.is_ok_and(|status| status.success()) {
            return crate::skips::skip(crate::skips::Need::System, "no mkfifo");
        }
    }
    assert!(super::folder(dir.path(), super::Kind::Bench, &[]).is_ok());
    let rows = dir.path().join("rows.csv");
    crate::atomic::write_bytes(&rows, b"x\n").unwrap();
    assert_eq!(fs::read(&rows).unwrap(), b"x\n");
    assert!(dir.path().join(".rows.csv.partial").exists(), "somebody's pipe is removed");
}
