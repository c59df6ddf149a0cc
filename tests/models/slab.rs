//! `eval slab` and `fit slab` as programs.

use crate::skips;
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

fn number(rows: &[Vec<String>], row: usize, column: usize) -> f64 {
    rows[row][column].parse().unwrap()
}

#[test]
fn eval_methods_agree_and_bad_rows_are_named() {
    let input =
        "delta,note,omega\n1,a,0.9\n1e-3,b,0.5\n60,c,0.2\n2,d,1\n0,e,0.3\n3,f,0\n1,g,1.5\n-1,h,0.5\noops,i,0.5\n1,j\n";
    let mut answers = Vec::new();
    for method in ["fast", "exact", "fn"] {
        let (code, out, _) = mesophyll(&["--quiet", "eval", "slab", "--method", method], input);
        assert_eq!(code, 0);
        let (header, rows) = table(&out);
        assert_eq!(header, ["delta", "note", "omega", "rho_d", "rho_t", "status"]);
        assert_eq!(rows.len(), 10);
        for (row, status) in [
            (6, "refused: omega is 1.5"),
            (7, "refused: delta is -1"),
            (8, "refused: delta is \"oops\""),
            (9, "refused: 2 fields"),
        ] {
            assert!(rows[row][5].starts_with(status), "{:?}", rows[row]);
            assert!(rows[row][3].is_empty());
        }
        answers.push(rows);
    }
    for row in 0..6 {
        for column in [3, 4] {
            let want = number(&answers[1], row, column);
            for (k, digits) in [(0, 1e-7), (2, 1e-4)] {
                let got = number(&answers[k], row, column);
                assert!((got - want).abs() <= digits * want, "row {row} column {column}: {got} {want}");
            }
            assert_eq!(answers[0][row][5], "ok");
        }
    }
    assert_eq!(number(&answers[0], 3, 3) + number(&answers[0], 3, 4), 1.0);
}

#[test]
fn one_minus_omega_keeps_its_digits() {
    let input = "omega,one_minus_omega,delta\n1,1e-12,1000\n0.5,0.6,1\n";
    let (_, out, _) = mesophyll(&["--quiet", "eval", "slab"], input);
    let (_, rows) = table(&out);
    // The absorbed share of a thick, nearly conservative slab is positive and proportional to 1 − ω.
    let lost = 1.0 - number(&rows, 0, 3) - number(&rows, 0, 4);
    assert!(lost > 1e-10 && lost < 1e-8, "{lost}");
    assert!(rows[1][5].starts_with("refused: one_minus_omega"));
}

#[test]
fn a_round_trip_through_files() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b, c) = (dir.path().join("a.csv"), dir.path().join("b.csv"), dir.path().join("c.csv"));
    let mut text = String::from("omega,delta\n");
    for k in 0..200 {
        text += &format!("{},{}\n", 0.05 + 0.94 * f64::from(k) / 200.0, 0.05 * 1.02_f64.powi(k));
    }
    std::fs::write(&a, text).unwrap();
    let path = |p: &Path| p.to_str().unwrap().to_string();
    assert_eq!(mesophyll(&["eval", "slab", "--method", "exact", "--in", &path(&a), "--out", &path(&b)], "").0, 0);
    let measured = std::fs::read_to_string(&b)
        .unwrap()
        .replace("status", "eval_status")
        .replace(",ok", ",ok,0.25")
        .replacen("eval_status", "eval_status,h", 1);
    std::fs::write(&b, measured).unwrap();
    let (code, json, _) =
        mesophyll(&["--json", "fit", "slab", "--in", &path(&b), "--out", &path(&c), "--noise", "1e-9"], "");
    assert_eq!(code, 0);
    assert!(json.contains("\"rows\": 200"), "{json}");
    let (header, rows) = table(&std::fs::read_to_string(&c).unwrap());
    let at = |name: &str| header.iter().position(|h| h == name).unwrap();
    for k in 0..rows.len() {
        let (omega, delta) = (number(&rows, k, at("omega")), number(&rows, k, at("delta")));
        assert_eq!(rows[k][at("status")], "ok");
        let (sa, ss) = (number(&rows, k, at("sigma_a")) * 0.25, number(&rows, k, at("sigma_s")) * 0.25);
        assert!(
            (sa / ((1.0 - omega) * delta) - 1.0).abs() < 1e-6 && (ss / (omega * delta) - 1.0).abs() < 1e-6,
            "{:?}",
            rows[k]
        );
    }
}

#[test]
fn options_are_checked_and_a_row_may_bring_its_own_errors() {
    let input = "rho_d,rho_t,h,rho_d_err,rho_t_err\n0.3,0.2,0.2,,\n0.3,0.2,0.2,0.1,0.1\n0.3,0.2,0.2,1e-4,1e-4\n";
    let (_, out, _) = mesophyll(&["--quiet", "fit", "slab", "--noise", "1e-6"], input);
    let (_, rows) = table(&out);
    assert_eq!(rows[0][9], "ok");
    assert!(rows[1][9].starts_with("undetermined: "), "{:?}", rows[1]);
    let ratio = number(&rows, 2, 7) / number(&rows, 0, 7);
    assert!((ratio / 100.0 - 1.0).abs() < 1e-2, "errors scale with the noise: {ratio}");
    for bad in [
        &["--noise", "-1"][..],
        &["--noise", "NaN"],
        &["--surface", "1"],
        &["--columns", "rho=x"],
        &["--columns", "rho_d"],
        &["--columns", "rho_d=h"],
        &["--columns", "rho_d_err=nosuch"],
        &["--method", "magic"],
        &["--thickness-unit", "parsec"],
    ] {
        let (code, _, err) = mesophyll(&[&["fit", "slab"], bad].concat(), input);
        assert_eq!(code, 2, "{bad:?}: {err}");
    }
    let micrometres =
        mesophyll(&["--quiet", "fit", "slab", "--thickness-unit", "um"], "rho_d,rho_t,h\n0.3,0.2,200\n").1;
    let millimetres = mesophyll(&["--quiet", "fit", "slab"], "rho_d,rho_t,h\n0.3,0.2,0.2\n").1;
    assert_eq!(
        micrometres.lines().nth(1).unwrap().split_once("200").unwrap().1,
        millimetres.lines().nth(1).unwrap().split_once("0.2,0.2").unwrap().1
    );
    let (_, out, _) = mesophyll(&["--quiet", "fit", "slab", "--surface", "0.03"], "rho_d,rho_t,h\n0.33,0.2,0.2\n");
    let (_, matte) = table(&millimetres);
    let (_, gloss) = table(&out);
    assert!((number(&gloss, 0, 4) / number(&matte, 0, 4) - 1.0).abs() < 1e-9);
}

/// Without a stated noise, no error is claimed. The error cells are empty, the values are those for exact input, and
/// one line says why.
#[test]
fn noise_is_asked_for() {
    // Two leaves measured with an accuracy of 5e-3. The second one has its own errors in the other form.
    let input = "rho_d,rho_t,h\n0.3801,0.5129,0.15\n0.05,0,0.2\n0.7,0.7,0.2\n";
    let (code, out, said) = mesophyll(&["fit", "slab"], input);
    let (header, rows) = table(&out);
    assert_eq!(
        (code, &header[3..]),
        (0, &["sigma_a", "sigma_s", "sigma_a_err", "sigma_s_err", "status"].map(String::from)[..])
    );
    let exact = table(&mesophyll(&["--quiet", "fit", "slab", "--noise", "0"], input).1).1;
    let honest = table(&mesophyll(&["--quiet", "fit", "slab", "--noise", "0.005"], input).1).1;
    for k in [3, 4] {
        assert!((number(&rows, 0, k) / number(&exact, 0, k) - 1.0).abs() < 1e-9);
        assert_eq!(rows[0][k + 2], "", "no error without noise");
        assert!(number(&exact, 0, k + 2) < 1e-5 * number(&exact, 0, k));
    }
    assert_eq!((rows[0][7].as_str(), exact[0][7].as_str()), ("ok", "ok"));
    // The noise contains a tenth of what the leaf absorbs. An earlier version did not say this.
    assert!(number(&honest, 0, 5) > 0.02 * number(&honest, 0, 3), "{honest:?}");
    assert!(
        rows[1][7].starts_with("undetermined: sigma_a >= ") && rows[1][7].contains("none was stated"),
        "{:?}",
        rows[1]
    );
    assert_eq!(rows[1][5], "");
    assert!(rows[2][7].starts_with("refused: rho_d + rho_t"), "{:?}", rows[2]);
    assert!(said.contains("no noise is stated for 2 rows") && said.contains("--noise 0"), "{said}");
    assert!(!mesophyll(&["fit", "slab", "--noise", "0.005"], input).2.contains("no noise"));
    // A row with its own errors needs no option. A row without them has no errors to show.
    let own = "rho_d,rho_t,h,rho_d_err,rho_t_err\n0.3801,0.5129,0.15,0.005,0.005\n0.3801,0.5129,0.15,,\n\
         0.3801,0.5129,0.15,0.005,\n";
    let (_, out, said) = mesophyll(&["fit", "slab"], own);
    let own = table(&out).1;
    assert_eq!(own[0][5..], honest[0][3..]);
    assert!(own[1][7].is_empty() && own[2][7].is_empty() && said.contains("for 2 rows"), "{own:?} {said}");
}

/// A thickness without a unit that is impossible in mm is refused by name. `h` is always in mm.
#[test]
fn a_thickness_without_a_unit_is_not_taken_for_mm() {
    let fit = |args: &[&str], text: &str| {
        let (code, out, err) = mesophyll(&[&["--quiet", "fit", "slab", "--noise", "0.005"], args].concat(), text);
        let rows = table(&out).1;
        let answered = rows.iter().any(|row| !row.last().unwrap().starts_with("refused"));
        assert_eq!(code, i32::from(!answered), "{err}");
        rows
    };
    let rows =
        fit(&["--columns", "h=thickness"], "rho_d,rho_t,thickness\n0.3,0.2,107\n0.3,0.2,0.000107\n0.3,0.2,0.107\n");
    let status = |rows: &[Vec<String>], k: usize| rows[k].last().unwrap().clone();
    assert!(
        status(&rows, 0).starts_with("refused: thickness is 107 and names no unit")
            && status(&rows, 0).contains("--thickness-unit um")
    );
    assert!(status(&rows, 1).contains("--thickness-unit m "), "{rows:?}");
    assert_eq!(status(&rows, 2), "ok");
    let mapped = fit(&["--columns", "h=leaf thickness"], "rho_d,rho_t,leaf thickness\n0.3,0.2,107\n");
    assert!(status(&mapped, 0).starts_with("refused: leaf thickness is 107 and names no unit"), "{mapped:?}");
    let same = [
        fit(&["--columns", "h=thickness", "--thickness-unit", "um"], "rho_d,rho_t,thickness\n0.3,0.2,107\n"),
        fit(&["--columns", "h=thickness_um"], "rho_d,rho_t,thickness_um\n0.3,0.2,107\n"),
        fit(&[], "rho_d,rho_t,h\n0.3,0.2,0.107\n"),
    ];
    for other in &same {
        assert!(
            (number(other, 0, 3) / number(&rows, 2, 3) - 1.0).abs() < 1e-12 && status(other, 0) == "ok",
            "{other:?}"
        );
    }
    let thick = fit(&[], "rho_d,rho_t,h\n0.3,0.2,107\n");
    assert!((1e3 * number(&thick, 0, 3) / number(&rows, 2, 3) - 1.0).abs() < 1e-12, "{thick:?}");
}

#[test]
fn species_means_run_as_they_are() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/data/leaves/species_means.csv");
    for band in ["450", "550", "650"] {
        let columns = format!("rho_d=reflectance_{band},rho_t=transmittance_{band},h=thickness_mm");
        let (code, out, _) = mesophyll(
            &["--quiet", "fit", "slab", "--in", file, "--columns", &columns, "--noise", "0.002", "--surface", "0.03"],
            "",
        );
        assert_eq!(code, 0);
        let (header, rows) = table(&out);
        assert_eq!(rows.len(), 45);
        let status = header.len() - 1;
        assert!(rows.iter().all(|r| !r[status].starts_with("refused")), "{rows:?}");
        if band == "550" {
            let ok = rows.iter().filter(|r| r[status] == "ok").count();
            assert!(ok > 30, "green light passes most leaves: {ok} of 45");
        }
    }
}

#[test]
fn a_reader_that_leaves_is_no_failure() {
    use std::io::{Read, Write};
    use std::process::{Command as Process, Stdio};
    let mut child = Process::new(env!("CARGO_BIN_EXE_mesophyll"))
        .args(["--quiet", "eval", "slab"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    let writer = std::thread::spawn(move || {
        let _ = input.write_all(b"omega,delta\n");
        for _ in 0..200_000 {
            if input.write_all(b"0.5,1.0\n").is_err() {
                break;
            }
        }
    });
    let mut first = [0u8; 16];
    child.stdout.take().unwrap().read_exact(&mut first).unwrap();
    let out = child.wait_with_output().unwrap();
    writer.join().unwrap();
    assert_eq!(out.status.code(), Some(0));
    assert!(out.stderr.is_empty(), "{}", String::from_utf8_lossy(&out.stderr));
}

#[test]
fn real_leaves_get_an_honest_status() {
    let Some(data) = skips::data("leaves/reflectance_transmittance.csv") else { return };
    let file = Path::new(&data).join("leaves/reflectance_transmittance.csv");
    for band in ["450", "550", "650"] {
        let columns = format!("rho_d=R{band},rho_t=T{band},h=thickness_um");
        let args = [
            "--quiet",
            "fit",
            "slab",
            "--in",
            file.to_str().unwrap(),
            "--columns",
            &columns,
            "--thickness-unit",
            "um",
            "--noise",
            "0.002",
        ];
        let (code, out, err) = mesophyll(&args, "");
        assert_eq!(code, 0, "{err}");
        let (header, rows) = table(&out);
        let at = |name: &str| header.iter().position(|h| h == name).unwrap();
        assert!(rows.len() > 200);
        for row in &rows {
            let status = &row[at("status")];
            let value = |name: &str| row[at(name)].parse::<f64>();
            if status == "ok" {
                for s in ["sigma_a", "sigma_s"] {
                    let (v, e) = (value(s).unwrap(), value(&format!("{s}_err")).unwrap());
                    assert!(v > 0.0 && e > 0.0 && e <= 0.1 * v, "{row:?}");
                }
            } else if status.starts_with("undetermined: ") {
                assert!(value("sigma_a").is_ok() && value("sigma_a_err").is_ok(), "{row:?}");
            } else {
                assert!(status.starts_with("refused: ") && value("sigma_a").is_err(), "{row:?}");
            }
        }
    }
}

/// A noise in per cent beside readings in per cent is a share of 1 all the same: refused where it exceeds the readings,
/// doubted where it is only larger than any instrument's.
#[test]
fn a_noise_in_per_cent_is_noticed() {
    let dark = "leaf,rho_d,rho_t,h\na,4.2,1.3,0.16\nb,5.1,2.2,0.2\nc,9.0,7.5,0.2\n";
    let (code, out, said) = mesophyll(&["fit", "slab", "--percent", "--noise", "0.2"], dark);
    assert!(code == 2 && out.is_empty(), "{out}{said}");
    for words in ["--noise: found 0.2, expected a share of 1", "also beside --percent", "in per cent (--noise 0.002)?"]
    {
        assert!(said.contains(words), "{said}\nlacks {words}");
    }
    let bright = "leaf,rho_d,rho_t,h\na,42,31,0.16\nb,45,40,0.2\n";
    let (code, _, said) = mesophyll(&["fit", "slab", "--percent", "--noise", "0.2"], bright);
    assert!(code == 0 && said.contains("20 % of all light"), "{said}");
    for table in [dark, bright] {
        let (code, out, said) = mesophyll(&["fit", "slab", "--percent", "--noise", "0.002"], table);
        assert!(code == 0 && out.contains(",ok") && !said.contains("per cent"), "{out}{said}");
    }
    // Fractions and a noise in per cent.
    let (code, _, said) = mesophyll(&["fit", "slab", "--noise", "0.5"], "rho_d,rho_t,h\n0.086,0.133,0.17\n");
    assert!(code == 2 && said.contains("--noise 0.005"), "{said}");
}
