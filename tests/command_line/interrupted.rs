//! Ctrl-C in the middle of a fit. The fit stops at once and keeps the finished parts, and the same command continues
//! from there. What a run that was killed leaves behind hinders nobody. `tests/endurance` kills each verb many times.
#![cfg(unix)]

use crate::blade::Blade;
use crate::common::{mesophyll, refused, run, scan, succeeded};
use mesophyll::files::atomic::write_bytes;
use mesophyll::files::image::read_exr;
use mesophyll::fits::record::FitKind;
use mesophyll::fits::record::maker;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// A leaf whose translucency takes some seconds for each side.
fn leaf(dir: &Path) -> String {
    let folder = dir.join("leaf");
    let mut record = Blade { width: 240, height: 180, texel_mm: 0.15, ..Blade::default() }.write(&folder, "elm");
    record.options.insert("texel_mm".into(), "0.15".into());
    record.write(&folder).unwrap();
    folder.to_str().unwrap().into()
}

fn arguments(leaf: &str, out: &Path) -> Vec<String> {
    let words = ["fit", "translucency", leaf, "-o", out.to_str().unwrap(), "--colour", "three-wavelengths"];
    words.map(String::from).to_vec()
}

/// Starts the fit, waits until `there` is true, and presses Ctrl-C. Returns the output, the time until `there` was
/// true, and the time that the stop took.
fn interrupt(args: &[String], there: impl Fn() -> bool) -> (Output, Duration, Duration) {
    let start = Instant::now();
    let mut child: Child = mesophyll().args(args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    while !there() && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(2));
    }
    let reached = start.elapsed();
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let stop = Instant::now();
    (child.wait_with_output().unwrap(), reached, stop.elapsed())
}

/// The folder of the parts of a translucency fit.
fn parts(out: &Path) -> Option<PathBuf> {
    let list = std::fs::read_dir(out).into_iter().flatten().flatten().map(|e| e.path());
    list.into_iter().find(|p| p.file_name().unwrap().to_string_lossy().starts_with("parts-translucency-"))
}

#[test]
fn a_stopped_fit_keeps_a_finished_side_and_goes_on_with_the_other() {
    let dir = tempfile::tempdir().unwrap();
    let leaf = leaf(dir.path());
    let [out, whole] = ["stopped", "whole"].map(|n| dir.path().join(n));
    let args = arguments(&leaf, &out);
    let done = || parts(&out).is_some_and(|p| p.join("front.part.toml").exists());
    let (output, reached, ending) = interrupt(&args, done);
    // The other side would take as long as the first one did. A stop must not wait for it.
    assert!(!output.status.success(), "the fit ended before it could be stopped");
    let kept = parts(&out).unwrap();
    refused(&output, 130, &["interrupted", "run the same command again", kept.to_str().unwrap()]);
    assert!(4 * ending < reached, "stopped only after {ending:?}; a side took {reached:?}");
    assert!(!out.join("fit.toml").exists());
    let hidden = |folder: &Path| -> Vec<String> {
        let names = std::fs::read_dir(folder).unwrap().flatten().map(|e| e.file_name().to_string_lossy().into_owned());
        names.filter(|n| n.starts_with('.')).collect()
    };
    assert_eq!([hidden(&out), hidden(&kept)].concat(), Vec::<String>::new(), "half-written files are left");
    // Another kind of fit refuses the folder, and the same fit continues.
    refused(&run(["fit", "sky", "-o", out.to_str().unwrap()]), 2, &["a translucency fit that was stopped"]);
    succeeded(&run(&args));
    succeeded(&run(arguments(&leaf, &whole)));
    assert!(parts(&out).is_none(), "the parts have served their purpose");
    for name in ["fit.toml", "front.exr", "back.exr", "front_translucency.png", "back_translucency.png"] {
        let [a, b] = [&out, &whole].map(|folder| std::fs::read(folder.join(name)).unwrap());
        assert!(a == b, "{name} is not what one run gives");
    }
    let times = std::fs::read_to_string(out.join("times.toml")).unwrap();
    assert!(times.contains("back: convolution") && !times.contains("front: convolution"), "{times}");
}

#[test]
fn a_fit_stopped_before_anything_is_done_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let leaf = leaf(dir.path());
    let out = dir.path().join("new/deeper");
    let (output, ..) = interrupt(&arguments(&leaf, &out), || out.exists());
    refused(&output, 130, &["stopped; nothing was printed or written"]);
    assert!(!dir.path().join("new").exists());
}

/// A scene of uniform discs that takes some seconds to draw.
fn crowd(dir: &Path) -> String {
    let discs: String = (1..400)
        .map(|k| {
            let at = |q: f64| (f64::from(k) * q).sin() * 0.03;
            format!("0.004 {} {} {} {} {} 0.01\n", at(1.3), at(2.7), at(5.9), at(7.1), at(9.7))
        })
        .collect();
    std::fs::write(dir.join("discs.txt"), discs).unwrap();
    let path = dir.join("crowd.toml");
    std::fs::write(
        &path,
        "schema = 1\nname = \"crowd\"\n[[leaf]]\nname = \"disc\"\ndiscs = \"discs.txt\"\nuniform = { rho_d = [[0.4, \
         0.4, 0.4], [0.4, 0.4, 0.4]], rho_t = [0.4, 0.4, 0.4] }\n[[instance]]\nleaf = \"disc\"\n[sky]\nradiance = [1, \
         1, 1]\n[[view]]\nname = \"v\"\nkind = \"perspective\"\neye_mm = [0, -100, 60]\ntarget_mm = [0, 0, \
         0]\nfov_deg = 30\n[check]\nwidth = 80\nheight = 60\n",
    )
    .unwrap();
    path.to_str().unwrap().into()
}

/// A program that is killed when the test ends, however it ends.
struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill().and_then(|()| self.0.wait());
    }
}

#[test]
fn a_stopped_picture_is_one_runs_alone_and_goes_on_to_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let scene = crowd(dir.path());
    let sampled = |out: &str, samples: &str, more: &[&str]| -> Vec<String> {
        let out = dir.path().join(out);
        let all = [&["render", &scene, "-o", out.to_str().unwrap(), "--samples", samples], more].concat();
        all.into_iter().map(String::from).collect()
    };
    let args = |out: &str, more: &[&str]| sampled(out, "128", more);
    let started = Instant::now();
    succeeded(&run(args("whole", &[])));
    let whole = started.elapsed();
    // While one run draws for hours, another one is refused; once the first was killed the folder is free. The other
    // one names a view that is not there, so that it ends at once where it comes before the first.
    let start = || Killed(mesophyll().args(sampled("stopped", "1000000", &[])).stderr(Stdio::null()).spawn().unwrap());
    let mut drawing = start();
    let deadline = Instant::now() + Duration::from_secs(60);
    loop {
        let other = run(args("stopped", &["--view", "none"]));
        if String::from_utf8_lossy(&other.stderr).contains("another run") {
            refused(&other, 2, &["the output folder", "stopped is being written by another run"]);
            break;
        }
        refused(&other, 2, &["--view: found \"none\""]);
        assert!(Instant::now() < deadline, "the run that draws never had the folder");
        // The one that draws is refused where it came while the other one had the folder.
        if drawing.0.try_wait().unwrap().is_some() {
            drawing = start();
        }
    }
    drop(drawing);
    let begun = Instant::now();
    let (output, _, ending) = interrupt(&args("stopped", &[]), || begun.elapsed() > whole / 2);
    refused(&output, 130, &["v: stopped after", "--resume goes on"]);
    assert!(ending < Duration::from_secs(1), "stopped only after {ending:?}");
    let part = read_exr(&dir.path().join("stopped/v.exr")).unwrap();
    assert!(part.get("R").unwrap().iter().any(|v| *v > 0.0), "what was drawn is kept");
    succeeded(&run(args("stopped", &["--resume"])));
    for file in ["v.exr", "v.png", "v.progress.exr"] {
        let [a, b] = ["whole", "stopped"].map(|d| std::fs::read(dir.path().join(d).join(file)).unwrap());
        assert!(a == b, "{file} differs");
    }
    let list = std::fs::read_dir(dir.path().join("stopped")).unwrap().flatten().map(|e| e.file_name());
    let hidden: Vec<_> = list.filter(|name| name.to_string_lossy().starts_with('.')).collect();
    assert!(hidden.is_empty(), "{hidden:?}");
}

/// The test takes part as a shard that still writes: it holds the folder's lock.
#[test]
fn shards_put_a_fit_together_once_and_wait_for_each_other() {
    let dir = tempfile::tempdir().unwrap();
    // One part for each side, so that the first of two shards makes the front and the second one the back.
    let capture = scan(dir.path(), "elm", &["--size", "24x18", "--frames", "16", "--noise", "0.01", "--seed", "1"]);
    let out = dir.path().join("fit");
    let shard = |which: &str| {
        let [capture, out] = [&capture, &out].map(|path| path.to_str().unwrap().to_string());
        ["fit", "leaf", &capture, "-o", &out, "--threads", "1", "--shard", which].map(String::from)
    };
    // Starts a shard that is not quiet, and reads what it says until it waits.
    let waiting = |which: &str| {
        let mut program = Command::new(env!("CARGO_BIN_EXE_mesophyll"));
        program.args(shard(which)).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = Killed(program.spawn().unwrap());
        let mut said = BufReader::new(child.0.stderr.take().unwrap());
        let mut line = String::new();
        while !line.contains("waiting for another run") {
            line.clear();
            assert!(said.read_line(&mut line).unwrap() > 0, "shard {which} ended without waiting");
        }
        (child, said)
    };
    let ended = |(mut child, mut said): (Killed, BufReader<_>)| {
        let mut rest = String::new();
        Read::read_to_string(&mut said, &mut rest).unwrap();
        assert!(child.0.wait().unwrap().success(), "{rest}");
        rest
    };
    std::fs::create_dir(&out).unwrap();
    let third = File::open(&out).unwrap();
    third.lock_shared().unwrap();
    // While parts are missing, a shard waits for nobody.
    succeeded(&run(shard("1/2")));
    assert!(!out.join("fit.toml").exists());
    // Both find all parts, so both wait for the third. Then one finishes the fit, and the other one finds it.
    let both = [waiting("2/2"), waiting("1/2")];
    third.unlock().unwrap();
    let said = both.map(ended);
    assert_eq!(said.iter().filter(|s| s.contains("already holds this fit")).count(), 1, "{said:?}");
    // A shard that comes while the fit is put together waits for it.
    third.lock().unwrap();
    let late = waiting("1/2");
    third.unlock().unwrap();
    assert!(ended(late).contains("already holds this fit"));
}

#[test]
fn a_fits_folder_is_one_threads_until_the_fit_has_ended() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("fit");
    let place = out.clone();
    let other = |out: &Path| maker::make(FitKind::Beam, out, &[], |maker| maker.made_from("another".into()));
    maker::make(FitKind::Beam, &out, &[], move |maker| {
        maker.made_from("one".into())?;
        let parts = maker.parts("none").to_path_buf();
        write_bytes(&parts.join("a"), b"a part")?;
        maker.begin()?;
        // Of the claims that are refused none frees the folder, nor does the record that is written before the parts
        // go.
        for finished in [false, false, true, true] {
            if finished {
                let record = maker.record("one");
                maker.finish(record)?;
            }
            assert_eq!(parts.exists(), !finished);
            let refused = other(&place).unwrap_err();
            assert!(refused.to_string().contains("is being written by another run"), "{refused}");
        }
        Ok(())
    })
    .unwrap();
    other(&out).unwrap();
}
