//! A fit whose numbers were changed and hashed anew is named by everything that reads it, a changed file is refused by
//! all of it, and exit codes follow the verdict.

use crate::common::{copy_tree, mesophyll, refused, run, scan};
use mesophyll::files::hash;
use mesophyll::files::image::{Packing, read_exr, write_exr};
use mesophyll::fits::record::FitRecord;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Output;

/// A folder with a copy of the committed fit of an elm leaf, and a scene that shows it.
fn folder() -> (tempfile::TempDir, PathBuf, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let (fit, scene) = (dir.path().join("elm"), dir.path().join("s.toml"));
    copy_tree(&Path::new(env!("CARGO_MANIFEST_DIR")).join("fits/elm"), &fit);
    let text = "schema = 1\nname = \"s\"\n[[leaf]]\nname = \"elm\"\nfit = \"elm\"\n[[instance]]\nleaf = \"elm\"\n\
                [sun]\nzenith_deg = 35\nirradiance = [3, 3, 3]\n[[view]]\nname = \"down\"\nkind = \"perspective\"\n\
                eye_mm = [3, 4, 150]\ntarget_mm = [0, 0, 0]\nup = [0, 1, 0]\nfov_deg = 40\n[check]\nwidth = 16\n\
                height = 12\n";
    std::fs::write(&scene, text).unwrap();
    (dir, fit, scene)
}

/// Writes the hash of every file anew, as someone would who wants a change to go unnoticed.
fn seal(fit: &Path, change: impl FnOnce(&mut FitRecord)) {
    let mut record = FitRecord::read(fit).unwrap();
    change(&mut record);
    for (name, hash) in &mut record.files {
        *hash = hash::file(&fit.join(name)).unwrap();
    }
    record.write(fit).unwrap();
}

/// Changes the good texels of some channels, and seals.
fn map(fit: &Path, file: &str, change: impl Fn(&str, f32) -> f32) {
    let mask = read_exr(&fit.join("front.exr")).unwrap().get("mask.Y").unwrap().to_vec();
    let mut maps = read_exr(&fit.join(file)).unwrap();
    for (name, plane) in &mut maps.channels {
        plane.iter_mut().zip(&mask).filter(|(_, m)| **m == 1.0).for_each(|(v, _)| *v = change(name, *v));
    }
    write_exr(&fit.join(file), &maps, Packing::Zip).unwrap();
    seal(fit, |_| ());
}

/// Runs the program with its messages, without `--quiet`.
fn loud(args: &[&str]) -> Output {
    std::process::Command::new(mesophyll().get_program()).args(args).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn numbers_changed_and_hashed_anew_are_named_by_all_who_read_them() {
    type Change = fn(&Path);
    let cases: [(&str, Change, &str, &str); 7] = [
        (
            "γ × .8",
            |f| map(f, "front.exr", |c, v| if c.starts_with("gamma") { 0.8 * v } else { v }),
            "front.exr",
            "gamma",
        ),
        (
            "ρt × 1.5",
            |f| map(f, "front.exr", |c, v| if c.starts_with("rho_t") { 1.5 * v } else { v }),
            "front.exr",
            "rho_t",
        ),
        (
            "NaN",
            |f| map(f, "front.exr", |c, v| if c == "rho_d.G" { f32::NAN } else { v }),
            "front.exr",
            "rho_d.G holds NaN",
        ),
        (
            "σ maps × 1.5",
            |f| map(f, "front.exr", |c, v| if c.starts_with("sigma") { 1.5 * v } else { v }),
            "front.exr",
            "sigma_a",
        ),
        ("errors ÷ 10", |f| map(f, "front_err.exr", |_, v| 0.1 * v), "front_err.exr", "errors of rho_d"),
        (
            "errors of σ ÷ 10",
            |f| {
                seal(f, |r| {
                    let param = r.sections.get_mut("front").unwrap().params.get_mut("sigma_s").unwrap();
                    param.stderr.iter_mut().for_each(|e| *e /= 10.0);
                });
            },
            "fit.toml",
            "sigma_s",
        ),
        ("another program", |f| seal(f, |r| r.program = "leaffit 3".into()), "elm", "another program"),
    ];
    for (what, change, file, words) in cases {
        let (dir, fit, scene) = folder();
        change(&fit);
        let named = |text: &str| text.contains(file) && text.contains(words);
        // A report judges.
        let report = run(["report", fit.to_str().unwrap(), "--json"]);
        let json: Value = serde_json::from_slice(&report.stdout).unwrap();
        let (level, code) = if what == "another program" { ("doubtful", 0) } else { ("bad", 1) };
        assert_eq!((json["verdict"]["level"].as_str(), report.status.code()), (Some(level), Some(code)), "{what}");
        let reasons = json["fits"][0]["verdict"]["reasons"].as_array().unwrap();
        let mut of_level = reasons.iter().filter(|r| r["level"] == level);
        assert!(of_level.any(|r| named(r["text"].as_str().unwrap())), "{what}: {reasons:#?}");
        // Who draws or exports it says the same and goes on.
        let out = dir.path().join("out");
        let drawn = ["render", scene.to_str().unwrap(), "-o", out.to_str().unwrap(), "--samples", "1"];
        let exported = ["export", fit.to_str().unwrap(), "--to", "json", "-o", &format!("{}.json", out.display())];
        // Drawing takes a second; that it says the same as the export is seen of one map and of the record.
        let drawn = if ["γ × .8", "another program"].contains(&what) { &drawn[..] } else { &[] };
        for words in [drawn, &exported].into_iter().filter(|words| !words.is_empty()) {
            let output = loud(words);
            let text = said(&output);
            let warned = text.lines().any(|line| line.starts_with("warning: ") && named(line));
            assert!(warned, "{what}, {}: {text}", words[0]);
            assert!(output.status.success(), "{what}, {}: {text}", words[0]);
        }
    }
}

#[test]
fn a_file_that_is_not_what_was_fitted_is_refused_by_all_who_use_it() {
    let (dir, fit, scene) = folder();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_string();
    let (place, scene, plant) = (at("elm"), scene.to_str().unwrap().to_string(), format!("Leaves={}", at("elm")));
    let text = std::fs::read_to_string(fit.join("fit.toml")).unwrap();
    std::fs::write(at("plant.glb"), "no plant").unwrap();
    for file in ["back_err.exr", "fit.toml"] {
        let path = fit.join(file);
        let before = std::fs::read(&path).unwrap();
        if file == "fit.toml" {
            std::fs::write(&path, text.replacen("robust = \"true\"", "robust = \"no\"", 1)).unwrap();
        } else {
            let mut maps = read_exr(&path).unwrap();
            maps.channels[0].1[0] = 0.5;
            write_exr(&path, &maps, Packing::Zip).unwrap();
        }
        assert_ne!(std::fs::read(&path).unwrap(), before);
        for words in [
            vec!["render", &scene, "-o", &at("out"), "--samples", "1"],
            vec!["export", &place, "--to", "csv", "-o", &at("a.csv")],
            vec!["export", &place, "--to", "json", "-o", &at("a.json")],
            vec!["export", &scene, "--to", "gltf-translucent", "-o", &at("a.glb")],
            vec!["dress", &at("plant.glb"), "--leaf", &plant, "-o", &at("b.glb")],
            vec!["fit", "translucency", &place, "-o", &at("through")],
        ] {
            refused(&run(&words), 1, &[file, "changed since"]);
        }
        let report = run(["report", &place, "--json"]);
        assert_eq!(report.status.code(), Some(1), "{file}");
        assert!(String::from_utf8_lossy(&report.stdout).contains("changed since"), "{file}");
        std::fs::write(&path, before).unwrap();
    }
    assert_eq!(run(["report", &place, "--json"]).status.code(), Some(0));
}

/// A capture that states a tenth of its noise: the model leaves ten times what it should.
#[test]
fn a_fit_that_is_not_good_ends_with_exit_code_1_and_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let capture = scan(dir.path(), "elm", &["--size", "32x24", "--frames", "24"]);
    let fits = |name: &str| {
        let out = dir.path().join(name);
        let output = run(["fit", "leaf", capture.to_str().unwrap(), "-o", out.to_str().unwrap(), "--json"]);
        let record: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert!(out.join("fit.toml").is_file() && record["kind"] == "leaf");
        let report = run(["report", out.to_str().unwrap(), "--json"]);
        assert_eq!(report.status.code(), output.status.code(), "fit and report judge by one rule");
        (output.status.code(), said(&output))
    };
    assert_eq!(fits("right"), (Some(0), String::new()));
    let place = capture.join("capture.toml");
    let text = std::fs::read_to_string(&place).unwrap();
    let tenth = |line: &str| match line.split_once("= ") {
        Some((name, noise)) if name.starts_with("noise_") => {
            format!("{name}= {}\n", 0.1 * noise.parse::<f64>().unwrap())
        }
        _ => format!("{line}\n"),
    };
    std::fs::write(&place, text.lines().map(tenth).collect::<String>()).unwrap();
    let (code, text) = fits("wrong");
    assert!(code == Some(1) && text.contains("is not good") && text.contains("reduced χ²"), "{code:?}: {text}");
    // A workflow that asks again gets the same answer.
    assert_eq!(fits("wrong").0, Some(1));
}

#[test]
fn a_table_of_which_every_row_is_refused_ends_with_exit_code_1() {
    let dir = tempfile::tempdir().unwrap();
    let table = |name: &str, rows: &str| {
        let path = dir.path().join(name);
        std::fs::write(&path, format!("rho_d,rho_t,thickness_mm\n{rows}")).unwrap();
        let output = run(["fit", "slab", "--noise", "0.001", "--in", path.to_str().unwrap()]);
        let text = String::from_utf8(output.stdout.clone()).unwrap();
        assert_eq!(text.lines().count(), 1 + rows.lines().count(), "{text}");
        output
    };
    let one = table("one.csv", "0.1,0.1,0.2\n0.9,0.9,0.2\n0.8,0.7,0.2\n");
    assert_eq!(one.status.code(), Some(0), "{}", said(&one));
    let none = table("none.csv", "0.9,0.9,0.2\n0.8,0.7,0.2\n");
    refused(&none, 1, &["2 rows", "every one was refused", "status"]);
}
