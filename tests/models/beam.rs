//! `eval beam` and `fit beam` as programs.

use assert_cmd::Command;
use std::path::Path;

fn mesophyll(args: &[&str], input: &str) -> (i32, String, String) {
    let out = Command::cargo_bin("mesophyll").unwrap().args(args).write_stdin(input).output().unwrap();
    (out.status.code().unwrap(), String::from_utf8(out.stdout).unwrap(), String::from_utf8(out.stderr).unwrap())
}

/// Columns by name of a CSV answer.
fn table(text: &str) -> (Vec<String>, Vec<Vec<String>>) {
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let header = reader.headers().unwrap().iter().map(String::from).collect();
    (header, reader.records().map(|r| r.unwrap().iter().map(String::from).collect()).collect())
}

/// The value of a named column.
fn cell(answer: &(Vec<String>, Vec<Vec<String>>), row: usize, column: &str) -> f64 {
    let k = answer.0.iter().position(|h| h == column).unwrap();
    answer.1[row][k].parse().unwrap()
}

#[test]
fn eval_answers_and_refuses_by_name() {
    let input = "x,note,alpha\n1,a,1\n1,b,0.9999999\n0.5,c,1e-4\n0,d,0.3\n2,e,0.5\n-0.1,f,0.5\n0.5,g,0\n0.5,h,-1\n\
         0.5,i,7\nnan,j,0.5\n0.5,k,wide\n1,l\n";
    let (code, out, _) = mesophyll(&["--quiet", "eval", "beam"], input);
    assert_eq!(code, 0);
    let answer = table(&out);
    assert_eq!(answer.0, ["x", "note", "alpha", "u", "du", "status"]);
    assert_eq!(answer.1.len(), 12);
    // An untapered beam has u(1) = 1/(2π) and u′(1) = 2/(3π). The value at the neighbouring place differs in the
    // seventh digit.
    let pi = std::f64::consts::PI;
    assert!(
        (cell(&answer, 0, "u") * 2.0 * pi - 1.0).abs() < 1e-13
            && (cell(&answer, 0, "du") * 1.5 * pi - 1.0).abs() < 1e-13
    );
    assert!((cell(&answer, 1, "u") * 2.0 * pi - 1.0).abs() < 1e-6);
    assert_eq!((cell(&answer, 3, "u"), cell(&answer, 3, "du")), (0.0, 0.0));
    for row in 0..4 {
        assert_eq!(answer.1[row][5], "ok");
    }
    for (row, name) in
        [(4, "x"), (5, "x"), (6, "alpha"), (7, "alpha"), (8, "alpha"), (9, "x"), (10, "alpha"), (11, "2 fields")]
    {
        assert!(answer.1[row][5].starts_with(&format!("refused: {name}")), "{:?}", answer.1[row]);
        assert!(answer.1[row][3].is_empty() && answer.1[row][4].is_empty());
    }
}

#[test]
fn fit_gives_the_printed_pair_and_a_better_basis() {
    let (code, out, _) =
        mesophyll(&["--quiet", "fit", "beam", "--samples", "101"], "alpha\n0.05\n0.1\n0.2\n0.3\n1e-4\n1\n0\n");
    assert_eq!(code, 0);
    let answer = table(&out);
    assert_eq!(answer.0[..4], ["alpha", "c2", "c4", "max_error"]);
    for (row, c2, c4) in
        [(0, 0.221875, 0.754029), (1, 0.3326, 0.398924), (2, 0.374571, 0.129428), (3, 0.364816, 0.024577)]
    {
        assert!((cell(&answer, row, "c2") - c2).abs() <= 5e-7 && (cell(&answer, row, "c4") - c4).abs() <= 5e-7);
    }
    // The better basis is compared with the exact beam, for all rows, in units of the tip.
    let eval: String = ["0.05", "0.1", "0.2", "0.3", "1e-4", "1"].iter().map(|a| format!("{a},1\n")).collect();
    let (_, tips, _) = mesophyll(&["--quiet", "eval", "beam"], &format!("alpha,x\n{eval}"));
    let tips = table(&tips);
    for row in 0..6 {
        let (tip, worst) = (cell(&tips, row, "u"), cell(&answer, row, "a_max_error"));
        assert!(worst < 0.01 * tip, "{row}: {worst} of {tip}");
        // At the tip y = 1, so the sum of the coefficients is the deflection there.
        let sum: f64 = ["a2", "a3", "a4", "a5"].iter().map(|a| cell(&answer, row, a)).sum();
        assert!((sum - tip).abs() <= worst * (1.0 + 1e-9), "{row}: {sum} {tip} {worst}");
    }
    assert!(answer.1[6].last().unwrap().starts_with("refused: alpha"));
}

fn record_of(fit: &Path) -> String {
    std::fs::read_to_string(fit.join("fit.toml")).unwrap()
}

/// Taper and load are determined where only the radius is missing, and the sentence at the end says so. Where nobody
/// stated the load and one at the tip would do as well, the taper is open, and the row has both answers.
#[test]
fn what_was_found_is_said() {
    let twig = concat!(env!("CARGO_MANIFEST_DIR"), "/data/branches/elm-twig.csv");
    let fit = |load: &[&str]| {
        let args = [&["fit", "beam", "--deflections", twig, "--positions", "axis"], load].concat();
        let (code, out, said) = mesophyll(&args, "");
        assert_eq!(code, 0, "{said}");
        (table(&out), said)
    };
    let (even, said) = fit(&["--load", "even"]);
    assert!((cell(&even, 0, "alpha") / 0.25 - 1.0).abs() < 0.1);
    let want = "1 branch: 0 ok, 1 undetermined, 0 refused; the undetermined branch determines alpha, \
     load_over_stiffness_mm and tip_mm, but not root_radius_mm";
    assert_eq!(said.lines().last(), Some(want));
    assert!(said.starts_with("the load is taken as spread evenly along the branch, as stated"), "{said}");
    let (tip, _) = fit(&["--load", "tip"]);
    let (open, said) = fit(&[]);
    assert!(said.starts_with("the load is taken as spread evenly along the branch; ") && said.contains("--load"));
    let want = "1 branch: 0 ok, 1 undetermined, 0 refused; the undetermined branch determines tip_mm, but not alpha, \
     load_over_stiffness_mm and root_radius_mm";
    assert_eq!(said.lines().last(), Some(want));
    let status = open.1[0].last().unwrap();
    for words in [
        "undetermined: alpha; load_over_stiffness_mm; root_radius_mm (no load was stated",
        &format!("with alpha {:.2} ± ", cell(&even, 0, "alpha")),
        &format!("a load at the tip with alpha {:.2} ± ", cell(&tip, 0, "alpha")),
        "state --load",
    ] {
        assert!(status.contains(words), "{status}\nlacks {words}");
    }
    // The errors hold both answers.
    for name in ["alpha", "load_over_stiffness_mm"] {
        let apart = (cell(&even, 0, name) - cell(&tip, 0, name)).abs();
        let error = cell(&open, 0, &format!("{name}_err"));
        assert!(cell(&open, 0, name) == cell(&even, 0, name) && error > 0.5 * apart && error < apart, "{name} {error}");
    }
    let folder = tempfile::tempdir().unwrap();
    let rows = folder.path().join("rows.csv");
    let args = [
        "--json",
        "--quiet",
        "fit",
        "beam",
        "--deflections",
        twig,
        "--positions",
        "axis",
        "-o",
        rows.to_str().unwrap(),
    ];
    let counts: serde_json::Value = serde_json::from_str(&mesophyll(&args, "").1).unwrap();
    assert_eq!(
        counts["found"],
        serde_json::json!({"alpha": 0, "load_over_stiffness_mm": 0, "root_radius_mm": 0, "tip_mm": 1})
    );
}

/// A photographed twig whose load nobody stated: not `ok`, not "Good", and what to do next is to state the load.
#[test]
fn a_load_that_was_not_stated_is_what_to_state_next() {
    let folder = tempfile::tempdir().unwrap();
    let [marks, fit, page] = ["twig.csv", "twig", "twig.html"].map(|name| folder.path().join(name));
    let mut text = String::from("branch,length_mm,position_mm,deflection_mm,load_n,modulus_gpa\n");
    for (position, deflection) in [(100, 2.1), (200, 9.3), (300, 23.5), (400, 44.0)] {
        text += &format!("twig,400,{position},{deflection},0.5,8\n");
    }
    std::fs::write(&marks, text).unwrap();
    let [marks, fit, page] = [&marks, &fit, &page].map(|path| path.to_str().unwrap());
    let args = ["--quiet", "fit", "beam", "--deflections", marks, "--noise", "0.5", "-o", fit];
    let (code, out, said) = mesophyll(&args, "");
    assert!(code == 0 && said.is_empty(), "{said}");
    let row = table(&out);
    let status = row.1[0].last().unwrap();
    assert!(status.starts_with("undetermined: alpha; load_over_stiffness_mm; root_radius_mm ("), "{status}");
    assert!(cell(&row, 0, "alpha_err") > 0.1, "{out}");
    let (code, _, said) = mesophyll(&["report", fit, "-o", page], "");
    assert_eq!(code, 0, "{said}");
    let text = std::fs::read_to_string(page).unwrap();
    let next = text.lines().find(|line| line.contains("What to measure next")).unwrap_or_default();
    assert!(next.contains("--load") && next.contains("a load at the tip") && !next.contains("times as many"), "{text}");
    assert!(!text.contains("met its mark") && text.contains("not determined by the data"), "{text}");
    let args = ["--quiet", "fit", "beam", "--deflections", marks, "--noise", "0.5", "--load", "even"];
    let (_, out, _) = mesophyll(&args, "");
    assert_eq!(table(&out).1[0].last().unwrap(), "ok");
}

/// Deflections of `eval beam` are used as marks, and `fit beam --deflections` recovers the beam.
#[test]
fn measured_branches_are_fitted_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let marks: Vec<f64> = (1..=16).map(|k| f64::from(k) / 16.0).collect();
    let rows: String = marks.iter().map(|x| format!("0.25,{x:?}\n")).collect();
    let (_, out, _) = mesophyll(&["--quiet", "eval", "beam"], &format!("alpha,x\n{rows}"));
    let beam = table(&out);
    // So little that the branch is linear, as `eval beam` is.
    let (length, scale) = (600.0, 9.0);
    let mut text = String::from("branch,length_mm,position_mm,deflection_mm,deflection_err_mm,load_n,modulus_gpa\n");
    for (k, x) in marks.iter().enumerate() {
        let d = scale * cell(&beam, k, "u");
        text += &format!("oak,{length},{:?},{d:?},1e-3,2.5,9\n", x * length);
        text += &format!("bare,{length},{:?},{d:?},1e-3,,\n", x * length);
    }
    text += "short,600,600,3,0.1,,\nbroken,600,300,?,0.1,,\nbroken,600,400,2,0.1,,\nuneven,600,300,1,0.1,,\n\
         uneven,601,400,2,0.1,,\n";
    let file = folder.path().join("marks.csv");
    std::fs::write(&file, text).unwrap();
    let fit = folder.path().join("fit");
    let args = [
        "--quiet",
        "fit",
        "beam",
        "--deflections",
        file.to_str().unwrap(),
        "--positions",
        "axis",
        "-o",
        fit.to_str().unwrap(),
    ];
    let (code, out, err) = mesophyll(&args, "");
    assert_eq!(code, 0, "{err}");
    let answer = table(&out);
    assert_eq!(answer.1.len(), 5);
    let status = |row: usize| answer.1[row].last().unwrap().clone();
    assert_eq!(status(0), "ok");
    assert!((cell(&answer, 0, "alpha") / 0.25 - 1.0).abs() < 1e-3);
    assert!((cell(&answer, 0, "load_over_stiffness_mm") / scale - 1.0).abs() < 1e-3);
    // F L³/(E s⁴) = 9 mm with F = 2.5 N, E = 9000 N/mm².
    let radius = (2.5 * length.powi(3) / (9000.0 * scale)).powf(0.25);
    assert!((cell(&answer, 0, "root_radius_mm") / radius - 1.0).abs() < 1e-3);
    assert!(status(1).starts_with("undetermined: root_radius_mm (load, modulus and root radius"), "{}", status(1));
    assert!(answer.1[1][answer.0.iter().position(|h| h == "root_radius_mm").unwrap()].is_empty());
    assert!(status(2).starts_with("refused: too few readings"));
    assert!(status(3).contains("deflection_mm") && status(4).contains("length_mm"));
    let record = record_of(&fit);
    assert!(record.contains("kind = \"beam\"") && record.contains("branch oak"), "{record}");
    assert!(fit.join("times.toml").exists());
    // The names of rows and folder may follow -o, --out and the older --output. A name with an extension is the file of
    // the rows.
    for option in ["-o", "--out", "--output"] {
        let (place, rows) =
            (folder.path().join(format!("fit{option}")), folder.path().join(format!("rows{option}.csv")));
        let (place, rows) = (place.to_str().unwrap(), rows.to_str().unwrap());
        let args = [
            "--quiet",
            "fit",
            "beam",
            "--deflections",
            file.to_str().unwrap(),
            "--positions",
            "axis",
            "-o",
            place,
            option,
            rows,
        ];
        let (code, nothing, err) = mesophyll(&args, "");
        assert_eq!((code, nothing.as_str()), (0, ""), "{err}");
        assert_eq!(std::fs::read_to_string(rows).unwrap(), out);
        assert_eq!(std::fs::read_to_string(Path::new(place).join("fit.toml")).unwrap(), record_of(&fit));
    }
    // The same input gives the same bytes.
    let again = folder.path().join("again");
    let mut args = args;
    args[8] = again.to_str().unwrap();
    mesophyll(&args, "");
    assert_eq!(record, std::fs::read_to_string(again.join("fit.toml")).unwrap());
}

/// A uniform stick with a weight at three quarters of its length, bent strongly. Its curve comes from a chain of short
/// rigid rods with springs between them, which is none of our methods. The load is given as a share and in mm, and a
/// missing reading costs itself.
#[test]
fn a_weight_on_a_stick_is_found_where_it_hangs() {
    let (length, stiffness, weight, at) = (400.0, 2.4e4, 1.4, 300.0);
    let n = 4000;
    let step = length / f64::from(n);
    let hangs = (at / step) as usize;
    // The bending moment at the root is found by halving: too great a moment leaves some of it where the weight hangs.
    let chain = |moment: f64| {
        let (mut angle, mut left, mut points) = (0.5 * step * moment / stiffness, moment, vec![[0.0f64; 2]]);
        for k in 0..n as usize {
            let [x, y] = points[k];
            points.push([x + step * angle.cos(), y + step * angle.sin()]);
            if k < hangs {
                left -= weight * step * angle.cos();
                angle += step * left / stiffness;
            }
        }
        (left, points)
    };
    let (mut low, mut high) = (0.0, weight * at);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if chain(middle).0 > 0.0 { high = middle } else { low = middle }
    }
    let points = chain(high).1;
    assert!(points[n as usize][1] > 0.3 * length);
    // E I = stiffness for a rod of radius 3 mm.
    let modulus = stiffness / (std::f64::consts::PI / 4.0 * 81.0) / 1e3;
    let mut text = String::from("branch,length_mm,position_mm,deflection_mm,deflection_err_mm,load_n,modulus_gpa\n");
    for k in 1..=16 {
        let y = points[k * n as usize / 16][1];
        let shown = if k == 5 { String::from("NA") } else { format!("{y}") };
        text += &format!("stick,{length},{},{shown},0.05,{weight},{modulus}\n", 25 * k);
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("stick.csv");
    std::fs::write(&file, text).unwrap();
    let fit = |load: &[&str]| {
        let args = [&["fit", "beam", "--deflections", file.to_str().unwrap()], load].concat();
        let (code, out, said) = mesophyll(&args, "");
        // The exit code is 1 where every branch is refused.
        assert_eq!(code, i32::from(load == ["--load", "500"]), "{said}");
        (table(&out), said)
    };
    let (share, said) = fit(&["--load", "0.75"]);
    assert!(said.contains("1 cell or reading left out: line 6: deflection_mm"), "{said}");
    assert_eq!((share.1[0].last().unwrap().as_str(), cell(&share, 0, "readings")), ("ok", 15.0));
    for (name, want) in [("alpha", 1.0), ("root_radius_mm", 3.0), ("tip_mm", points[n as usize][1])] {
        let (got, error) = (cell(&share, 0, name), cell(&share, 0, &format!("{name}_err")));
        assert!((got - want).abs() < 3.0 * error && error < 0.02 * want, "{name}: {got} ± {error}, {want}");
    }
    assert_eq!(fit(&["--load", "300"]).0, share);
    // Taken as even, it is not described or another load is named.
    let (even, _) = fit(&[]);
    assert!(even.1[0].last().unwrap().starts_with("undetermined: alpha"), "{:?}", even.1[0]);
    let beyond = fit(&["--load", "500"]).0;
    assert!(beyond.1[0].last().unwrap().starts_with("refused: --load 500 is beyond the tip"), "{:?}", beyond.1[0]);
}

#[test]
fn the_basis_is_written_as_a_fit() {
    let folder = tempfile::tempdir().unwrap();
    let fit = folder.path().join("basis");
    let (code, _, err) = mesophyll(&["--quiet", "fit", "beam", "--basis", "-o", fit.to_str().unwrap()], "");
    assert_eq!(code, 0, "{err}");
    let record: toml::Value = toml::from_str(&std::fs::read_to_string(fit.join("fit.toml")).unwrap()).unwrap();
    assert_eq!(record["kind"].as_str(), Some("beam"));
    assert_eq!(record["termination"].as_str(), Some("direct"));
    assert_eq!(record["all"]["a2"]["value"].as_array().unwrap().len(), 6);
    assert_eq!(record["all"]["rank"].as_integer(), Some(24));
    // A report of this fit can be made.
    let page = folder.path().join("page.html");
    let (code, _, err) = mesophyll(&["--quiet", "report", fit.to_str().unwrap(), "-o", page.to_str().unwrap()], "");
    assert_eq!(code, 0, "{err}");
    let page = std::fs::read_to_string(page).unwrap();
    assert!(page.contains("largest error of the deflection") && !page.contains("no name in this version"));
}

#[test]
fn slips_of_the_command_line_are_usage() {
    for (args, words) in [
        (vec!["fit", "beam", "--basis"], "--out"),
        (vec!["fit", "beam", "--basis", "-o", "-"], "folder"),
        (vec!["fit", "beam", "-o", "a.csv", "-o", "b.csv"], "a.csv and b.csv"),
        (vec!["fit", "beam", "--samples", "1"], "--samples"),
        (vec!["fit", "beam", "--deflections", "no-such-file.csv"], "no-such-file.csv"),
        (vec!["fit", "beam", "--deflections", "x.csv", "--noise", "0"], "--noise"),
        (vec!["fit", "beam", "--positions", "axis"], "--deflections"),
        (vec!["fit", "beam", "--load", "tip"], "--deflections"),
        (vec!["fit", "beam", "--deflections", "x.csv", "--load", "end"], "own-weight"),
    ] {
        let (code, _, err) = mesophyll(&args, "alpha\n0.5\n");
        assert_eq!(code, 2, "{args:?}: {err}");
        assert!(err.contains(words), "{args:?}: {err}");
    }
    let (code, _, err) = mesophyll(&["fit", "beam"], "taper\n0.5\n");
    assert!(code == 2 && err.contains("alpha"), "{err}");
}
