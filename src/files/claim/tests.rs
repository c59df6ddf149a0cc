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
    // What the verb wrote before is replaced, and so is what has an ending that says nothing.
    fs::write(place("answers.txt"), "x,y,status\n1,2,ok\n").unwrap();
    fs::write(place("any.out"), "x,y\n").unwrap();
    for name in ["own.csv", "new.csv", "new.CSV", "new.txt", "new", "empty", "answers.txt", "any.out"] {
        assert!(file(&place(name), &["csv"], &[]).is_ok(), "{name}");
    }
}

#[test]
fn a_new_folder_is_not_called_like_a_file() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["film.gif", "r.png", "elm.GLB"] {
        let refused = super::folder(&dir.path().join(name), super::OutputKind::Film, &[]);
        let Err(sentence) = refused.map(drop).map_err(|e| e.to_string()) else { panic!("{name} was made") };
        assert!(sentence.contains(name) && sentence.contains("expected a folder's name"), "{sentence}");
        assert!(!dir.path().join(name).exists());
    }
    // A point in a name is no ending, and what is there already is a folder.
    fs::create_dir(dir.path().join("old.png")).unwrap();
    for name in ["v1.2", "elm.july", "old.png"] {
        assert!(super::folder(&dir.path().join(name), super::OutputKind::Film, &[]).is_ok(), "{name}");
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
    assert!(super::folder(dir.path(), super::OutputKind::Bench, &[]).is_ok());
    let rows = dir.path().join("rows.csv");
    crate::atomic::write_bytes(&rows, b"x\n").unwrap();
    assert_eq!(fs::read(&rows).unwrap(), b"x\n");
    assert!(dir.path().join(".rows.csv.partial").exists(), "somebody's pipe is removed");
}

#[test]
#[cfg(unix)]
fn pipes_and_devices_are_written_in_place() {
    use std::os::unix::fs::FileTypeExt;
    let dir = tempfile::tempdir().unwrap();
    let pipe = dir.path().join("pipe");
    if !std::process::Command::new("mkfifo").arg(&pipe).status().is_ok_and(|s| s.success()) {
        return crate::skips::skip(crate::skips::Need::System, "no mkfifo");
    }
    let reader = std::thread::spawn({
        let pipe = pipe.clone();
        move || fs::read(pipe).unwrap()
    });
    crate::atomic::write_bytes(&pipe, b"through").unwrap();
    assert_eq!(reader.join().unwrap(), b"through");
    assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
}
