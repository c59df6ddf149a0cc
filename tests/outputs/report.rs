//! `mesophyll report` as a program.

use crate::samples::{Sample, write_fit, write_run};
use mesophyll::files::{hash, image};
use mesophyll::fits::record::next::NextMeasurement;
use mesophyll::fits::record::{FitRecord, TruthError};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

fn mesophyll(args: &[&str], folder: &Path) -> (i32, String, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_mesophyll")).args(args).current_dir(folder).output().unwrap();
    let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
    (out.status.code().unwrap_or(-1), text(&out.stdout), text(&out.stderr))
}

fn json(args: &[&str], folder: &Path) -> Value {
    let (code, stdout, stderr) = mesophyll(args, folder);
    let report: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(code, i32::from(report["verdict"]["level"] == "bad"), "{stderr}");
    report
}

/// The texts of a verdict's reasons with their levels.
fn reasons(fit: &Value) -> String {
    let list = fit["verdict"]["reasons"].as_array().unwrap();
    list.iter().map(|r| format!("{}: {}\n", r["level"].as_str().unwrap(), r["text"].as_str().unwrap())).collect()
}

#[test]
fn the_page_stands_alone_and_says_what_is_undetermined() {
    let dir = tempfile::tempdir().unwrap();
    write_fit(&dir.path().join("elm"), &Sample::default());
    write_run(&dir.path().join("run"), true);
    let (code, stdout, stderr) = mesophyll(&["report", "elm", "run", "-o", "out/r.html"], dir.path());
    assert_eq!((code, stdout.as_str()), (0, ""), "{stderr}");
    let page = std::fs::read_to_string(dir.path().join("out/r.html")).unwrap();
    for outside in ["http://", "https://", "<link", "@import", "url(", "file:", "fetch(", "import("] {
        assert!(!page.contains(outside), "the page reaches outside: {outside}");
    }
    // Its one script is written into it, and the page forbids the browser to load anything.
    assert_eq!((page.matches("<script").count(), page.matches("<script data-plain=").count()), (1, 1));
    assert!(page.contains("default-src 'none'; img-src data:;"));
    let sources = page.matches("src=\"").count();
    assert!(sources > 40, "{sources} pictures");
    assert_eq!(sources, page.matches("src=\"data:image/png;base64,").count());
    for said in [
        "at least 7.9",
        "prefers-color-scheme: dark",
        "the scene has no wind",
        "llvmpipe (software)",
        "more light out than in",
    ] {
        assert!(page.contains(said), "{said}");
    }
    for (earlier, later) in [
        ("Is this good?", "Pictures, checked against the reference"),
        ("at most 0.04; noise 0.012", "<h3>Parameters</h3>"),
        ("<h3>Parameters</h3>", "Maps of the front"),
        ("Maps of the back", "<h3>Residuals"),
        ("<h3>Residuals", "How the fit of the front ended"),
        ("<h3>Run time</h3>", "What was left out, and why"),
    ] {
        let [a, b] =
            [earlier, later].map(|text| page.find(text).unwrap_or_else(|| panic!("{text} is not on the page")));
        assert!(a < b, "{earlier} comes after {later}");
    }
    // Beside the picture: the reference, the FLIP map and the difference, the last two with their scales.
    for said in
        ["FLIP map", "Renderer minus reference", "<span>0.100</span>", "<span>0.0625</span>", "ramp-flip", "ramp-grey"]
    {
        assert!(page.contains(said), "{said}");
    }
    // Each figure has a name, a unit and a meaning. A figure without a name is counted, and its key is not shown.
    for said in ["texels that count for less", "One more figure of fit.toml has no name"] {
        assert!(page.contains(said), "{said}");
    }
    for key in
        ["down_weighted", "down weighted", "nobody_named", "nobody named", "transmittance_rms", "transmittance rms"]
    {
        assert!(!page.contains(key), "the raw key {key} is on the page");
    }
    assert!(
        page.contains("best estimate 8.") && page.contains("at most 10\u{a0}% of it"),
        "undetermined values and their rule"
    );
    // The undetermined blue σa (8.4 in the sample) must not appear as if it were known.
    assert!(!page.contains("8.4 ±") && !page.contains("8.40 ±"));
    assert!(page.trim_end().ends_with("</html>"));
    let tags = |name: &str| (page.matches(&format!("<{name}")).count(), page.matches(&format!("</{name}>")).count());
    for name in ["table", "figure>", "svg", "details", "section", "tbody"] {
        let (open, close) = (tags(name).0, page.matches(&format!("</{}", name.trim_end_matches('>'))).count());
        let open = if name == "figure>" { page.matches("<figure").count() } else { open };
        assert_eq!(open, close, "{name}");
    }
}

#[test]
fn what_to_measure_next_stands_before_reasons_which_say_that_they_open() {
    let dir = tempfile::tempdir().unwrap();
    let elm = dir.path().join("elm");
    write_fit(&elm, &Sample { sides: vec!["front"], ..Sample::default() });
    let mut record = FitRecord::read(&elm).unwrap();
    let sentence = "forty more frames".to_string();
    record.next_measurement = Some(NextMeasurement { sentence, ..NextMeasurement::default() });
    record.write(&elm).unwrap();
    assert_eq!(mesophyll(&["report", "elm", "-o", "r.html"], dir.path()).0, 0);
    let page = std::fs::read_to_string(dir.path().join("r.html")).unwrap();
    let (_, card) = page.split_once("<section id=\"fit1\">").unwrap();
    let (next, reasons) = (card.find("forty more frames").unwrap(), card.find("<ul class=\"reasons\">").unwrap());
    assert!(next < reasons);
    // A reason that a line does not hold is marked as one that opens, and no short one is.
    let list = card[reasons..].split_once("</ul>").map(|(list, _)| list).unwrap();
    let mut marked = 0;
    for reason in list.split("<details").skip(1) {
        let text = reason.split_once("<summary title=\"").and_then(|(_, rest)| rest.split_once('"')).unwrap().0;
        let long = reason.starts_with(" class=\"long");
        // An escaped sign counts as one.
        let right = if text.chars().count() > 50 { long || text.contains('&') } else { !long };
        assert!(right, "{reason}");
        marked += usize::from(long);
    }
    assert!(marked > 0, "{list}");
}

#[test]
fn the_same_fit_gives_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    write_fit(&dir.path().join("elm"), &Sample { sides: vec!["front"], ..Sample::default() });
    for name in ["a.html", "b.html"] {
        assert_eq!(mesophyll(&["report", "elm", "-o", name], dir.path()).0, 0);
    }
    assert_eq!(std::fs::read(dir.path().join("a.html")).unwrap(), std::fs::read(dir.path().join("b.html")).unwrap());
}

#[test]
fn coverage_is_what_the_normal_distribution_says() {
    let dir = tempfile::tempdir().unwrap();
    // With errors stated at half their size, 95 % intervals reach ±0.98 σ and hold erf(0.98/√2) = 67.3 % of the truths.
    for (name, overconfidence, expected) in [("right", 1.0, 0.95), ("half", 2.0, 0.6729)] {
        let sample = Sample { overconfidence, sides: vec!["front"], ..Sample::default() };
        write_fit(&dir.path().join(name), &sample);
        let report = json(&["report", name, "--json"], dir.path());
        let fit = &report["fits"][0];
        let covered: Vec<f64> =
            fit["maps"].as_array().unwrap().iter().map(|m| m["truth"]["coverage95"].as_f64().unwrap()).collect();
        assert_eq!(covered.len(), 22);
        let texels = fit["maps"][0]["summary"]["samples"].as_f64().unwrap();
        let mean = covered.iter().sum::<f64>() / 22.0;
        let sigma = (expected * (1.0 - expected) / (22.0 * texels)).sqrt();
        assert!((mean - expected).abs() < 5.0 * sigma, "{name}: {mean} against {expected} ± {sigma}");
        assert_eq!(reasons(fit).contains("too small"), overconfidence != 1.0, "{}", reasons(fit));
        assert_eq!(
            reasons(fit).contains("bad: front: stated errors are too small"),
            overconfidence != 1.0,
            "{}",
            reasons(fit)
        );
    }
}

/// A share over one value is 0 or 100 %. It says nothing about the errors, and the verdict must not use it.
#[test]
fn one_truth_is_no_share() {
    let dir = tempfile::tempdir().unwrap();
    let fit = dir.path().join("x");
    write_fit(&fit, &Sample { sides: vec!["front"], ..Sample::default() });
    for (coverage, level) in [(1.0, "good"), (0.0, "doubtful")] {
        let mut record = FitRecord::read(&fit).unwrap();
        let one =
            TruthError { median_relative: 0.003, p99_relative: 0.003, coverage95: Some(coverage), judged: Some(1) };
        record.sections.get_mut("front").unwrap().truth.insert("thickness_scale".into(), one);
        record.write(&fit).unwrap();
        let said = reasons(&json(&["report", "x", "--json"], dir.path())["fits"][0]);
        let line = said.lines().find(|l| l.contains("known truth of s lies")).unwrap_or_else(|| panic!("{said}"));
        assert!(line.starts_with(level) && !said.contains("too large") && !said.contains("too small"), "{said}");
    }
}

#[test]
fn names_from_files_cannot_inject_markup() {
    let dir = tempfile::tempdir().unwrap();
    let name = "<script>alert(1)</script>\"'&|*";
    write_fit(&dir.path().join("x"), &Sample { name: name.into(), sides: vec!["front"], ..Sample::default() });
    assert_eq!(mesophyll(&["report", "x", "-o", "r.html"], dir.path()).0, 0);
    let page = std::fs::read_to_string(dir.path().join("r.html")).unwrap();
    assert!(!page.contains("<script>") && page.contains("&lt;script&gt;"));
    let (_, markdown, _) = mesophyll(&["report", "x", "--markdown"], dir.path());
    assert!(!markdown.contains("<script>"));
}

#[test]
fn what_is_missing_is_said_and_never_a_crash() {
    let dir = tempfile::tempdir().unwrap();
    let fit = dir.path().join("elm");
    write_fit(&fit, &Sample::default());
    std::fs::remove_file(fit.join("back_err.exr")).unwrap();
    std::fs::remove_file(fit.join("times.toml")).unwrap();
    let whole = std::fs::read(fit.join("truth_front.exr")).unwrap();
    std::fs::write(fit.join("truth_front.exr"), &whole[..whole.len() / 2]).unwrap();
    let mut front = image::read_exr(&fit.join("front.exr")).unwrap();
    front.channels.retain(|(n, _)| !n.starts_with("gamma") && n != "mask.Y");
    front.channels.iter_mut().filter(|(n, _)| n == "m.Y").for_each(|(_, s)| s.fill(f32::NAN));
    image::write_exr(&fit.join("front.exr"), &front, image::Packing::Zip).unwrap();
    let report = json(&["report", "elm", "--json"], dir.path());
    let missing: Vec<&str> =
        report["fits"][0]["missing"].as_array().unwrap().iter().map(|m| m.as_str().unwrap()).collect();
    let all = missing.join("\n");
    for said in ["times.toml", "back_err.exr", "truth_front.exr", "mask.Y", "no channels of gamma", "m.Y has no value"]
    {
        assert!(all.contains(said), "{said} is not in\n{all}");
    }
    assert_eq!(mesophyll(&["report", "elm", "-o", "r.html"], dir.path()).0, 0);
    // Only the record is left.
    for entry in std::fs::read_dir(&fit).unwrap().flatten().filter(|e| e.file_name() != "fit.toml") {
        std::fs::remove_file(entry.path()).unwrap();
    }
    let (code, _, stderr) = mesophyll(&["report", "elm", "-o", "r.html"], dir.path());
    assert_eq!(code, 0, "{stderr}");
    let page = std::fs::read_to_string(dir.path().join("r.html")).unwrap();
    assert!(page.contains("front.exr: not there, so no maps of this side"));
}

#[test]
fn two_fits_are_weighed_by_their_combined_errors() {
    let dir = tempfile::tempdir().unwrap();
    for (name, seed) in [("a", 1), ("b", 7)] {
        let sample = Sample { name: "elm".into(), seed, truth: false, sides: vec!["front"], ..Sample::default() };
        write_fit(&dir.path().join(name), &sample);
    }
    let mut record = FitRecord::read(&dir.path().join("b")).unwrap();
    let front = record.sections.get_mut("front").unwrap();
    front.params.get_mut("sigma_s").unwrap().value[0] = 12.0;
    record.write(&dir.path().join("b")).unwrap();
    let first = FitRecord::read(&dir.path().join("a")).unwrap().sections["front"].params["sigma_s"].clone();

    let report = json(&["report", "a", "b", "--json"], dir.path());
    let c = &report["comparisons"][0];
    let rows = c["parameters"].as_array().unwrap();
    let red = rows.iter().find(|r| r["name"] == "sigma_s" && r["channel"] == "R").unwrap();
    let expected = (12.0 - first.value[0]) / (2.0 * 0.11f64.powi(2)).sqrt();
    assert!((red["sigmas"].as_f64().unwrap() - expected).abs() < 1e-9);
    let blue = rows.iter().find(|r| r["name"] == "sigma_a" && r["channel"] == "B").unwrap();
    assert!(blue["sigmas"].is_null() && blue["first"].is_null(), "an undetermined parameter is not weighed: {blue}");
    assert!(blue["estimates"][0].as_str().unwrap().contains("its error is not bounded; at least 7.9"), "{blue}");
    assert!(c["sentence"].as_str().unwrap().contains("The fits differ: 1 of 6"), "{}", c["sentence"]);
    // In independent draws with right errors, 5 % are beyond 1.96 combined standard errors.
    let maps = c["maps"].as_array().unwrap();
    let beyond = maps.iter().map(|m| m["beyond95"].as_f64().unwrap()).sum::<f64>() / maps.len() as f64;
    assert!((beyond - 0.05).abs() < 0.01, "{beyond}");
    // Fits with the same name are distinguished by their folders.
    assert_eq!((report["fits"][0]["name"].as_str(), report["fits"][1]["name"].as_str()), (Some("a"), Some("b")));
}

#[test]
fn a_missed_check_and_a_changed_file_make_the_verdict_bad() {
    let dir = tempfile::tempdir().unwrap();
    let fit = dir.path().join("out/fits/elm");
    write_fit(&fit, &Sample { sides: vec!["front"], ..Sample::default() });
    write_run(&dir.path().join("out"), false);
    let report = json(&["report", "out", "--json"], dir.path());
    assert_eq!(report["verdict"]["level"], "bad");
    assert!(report["comparisons"].as_array().unwrap().is_empty());
    assert_eq!(report["plans"][0]["left_out"][0]["name"], "beam fit");
    assert_eq!(report["fits"][0]["verdict"]["level"], "doubtful");

    let mut record = FitRecord::read(&fit).unwrap();
    record.files.insert("front.exr".into(), hash::file(&fit.join("front.exr")).unwrap());
    record.write(&fit).unwrap();
    assert!(!reasons(&json(&["report", "out", "--json"], dir.path())["fits"][0]).contains("bad:"));
    let mut bytes = std::fs::read(fit.join("front.exr")).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(fit.join("front.exr"), bytes).unwrap();
    let said = reasons(&json(&["report", "out", "--json"], dir.path())["fits"][0]);
    assert!(said.contains("bad:") && said.contains("changed since it was fitted"), "{said}");
}

#[test]
fn markdown_and_json_say_the_same() {
    let dir = tempfile::tempdir().unwrap();
    write_fit(&dir.path().join("elm"), &Sample { sides: vec!["front"], ..Sample::default() });
    let (code, markdown, stderr) = mesophyll(&["report", "elm", "--markdown"], dir.path());
    assert_eq!(code, 0, "{stderr}");
    let report = json(&["report", "elm", "--json"], dir.path());
    for row in report["fits"][0]["parameters"].as_array().unwrap().iter().filter(|r| r["undetermined"].is_null()) {
        let printed =
            mesophyll::report::number::plus_minus(row["value"].as_f64().unwrap(), row["stderr"].as_f64().unwrap());
        assert!(markdown.contains(&printed), "{printed}");
    }
    for reason in report["fits"][0]["verdict"]["reasons"].as_array().unwrap() {
        assert!(markdown.contains(reason["text"].as_str().unwrap()));
    }
    // Every line of a table has as many cells as its head.
    let lines: Vec<&str> = markdown.lines().collect();
    for pair in lines.windows(2).filter(|w| w[0].starts_with('|') && w[1].starts_with('|')) {
        let cells = |l: &str| l.replace("\\|", "").matches('|').count();
        assert_eq!(cells(pair[0]), cells(pair[1]), "{}\n{}", pair[0], pair[1]);
    }
}

#[test]
fn bad_input_is_one_sentence_and_exit_code_2() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("empty")).unwrap();
    std::fs::create_dir(dir.path().join("broken")).unwrap();
    std::fs::write(dir.path().join("broken/fit.toml"), "schema = 1\nkind = \"leaf\"\nname = ").unwrap();
    std::fs::create_dir(dir.path().join("check")).unwrap();
    std::fs::write(dir.path().join("check/check.json"), "{\"passed\": tru").unwrap();
    write_fit(&dir.path().join("ok"), &Sample { sides: vec!["front"], ..Sample::default() });
    let cases: [(&[&str], &str); 6] = [
        (&["report", "nowhere"], "nowhere: no such folder"),
        (&["report", "empty"], "nothing to report"),
        (&["report", "broken"], "fit.toml:3:"),
        (&["report", "check"], "check.json: not readable as JSON"),
        (&["report", "ok", "-o", "empty"], "found a folder, expected the name of an HTML file"),
        (&["report"], "DIR"),
    ];
    for (args, said) in cases {
        let (code, stdout, stderr) = mesophyll(args, dir.path());
        assert_eq!((code, stdout.as_str()), (2, ""), "{args:?}: {stderr}");
        assert!(stderr.contains(said), "{args:?}: {stderr}");
    }
    assert!(!dir.path().join("report.html").exists(), "nothing is written when nothing can be reported");
}

/// Writes samples of full size and their reports under `MESOPHYLL_LOOK`, for people to look at.
#[test]
#[ignore = "for looking at: set MESOPHYLL_LOOK to a folder"]
fn samples_to_look_at() {
    let Some(folder) = std::env::var_os("MESOPHYLL_LOOK") else { return };
    let folder = Path::new(&folder);
    let full = Sample { name: "elm".into(), width: 720, height: 540, ..Sample::default() };
    write_fit(&folder.join("elm"), &full);
    write_fit(
        &folder.join("elm2"),
        &Sample { name: "elm".into(), seed: 2, truth: false, sides: vec!["front"], ..full },
    );
    write_run(&folder.join("run"), true);
    for args in [["report", "elm", "run", "-o", "one.html"], ["report", "elm", "elm2", "-o", "two.html"]] {
        let (code, _, stderr) = mesophyll(&args, folder);
        assert_eq!(code, 0, "{stderr}");
    }
}
