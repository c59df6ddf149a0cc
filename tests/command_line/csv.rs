//! Bad tables for every verb that reads tables: ragged rows, units, repeated column names, other encodings, and readers
//! that stop reading.

use std::io::{Read, Write};
use std::process::{Command, Output, Stdio};

const GEOMETRY: &str = "height_mm = 100.0\ntube_length_mm = 500.0\ntube_radius_mm = 2.5\ncamera_deg = 55.0\nu_start = \
 -4.0\nu_end = 2.5\nframes = 16\n\
                        noise_relative = 0.01\nnoise_floor = 5e-4\n";

/// A verb that reads a table: its arguments, the header, a good row, and the name of its first number.
struct Form {
    args: Vec<String>,
    header: String,
    good: String,
}

fn forms(geometry: &str) -> Vec<Form> {
    let words = |text: &str| {
        text.split_whitespace().map(|w| if w == "GEO" { geometry.to_string() } else { w.to_string() }).collect()
    };
    let frames: Vec<String> = (0..16).map(|k| format!("r{k}")).collect();
    let form =
        |args: &str, header: &str, good: &str| Form { args: words(args), header: header.into(), good: good.into() };
    vec![
        form("fit slab", "note,rho_d,rho_t,h", "a,0.3,0.2,0.2"),
        form("eval slab", "note,omega,delta", "a,0.5,1"),
        form("eval gloss --geometry GEO", "note,rho_d,rho_s,m,tilt", "a,0.1,0.05,0.3,0"),
        form(
            "fit gloss --geometry GEO",
            &format!("note,{}", frames.join(",")),
            "a,0.008,0.01,0.02,0.05,0.1,0.2,0.21,0.15,0.1,0.09,0.08,0.07,0.06,0.05,0.03,0.02",
        ),
    ]
}

fn run(args: &[String], input: &[u8]) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_mesophyll"))
        .arg("--quiet")
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // An error in the header may end the program before it has read everything.
    let _ = child.stdin.take().unwrap().write_all(input);
    child.wait_with_output().unwrap()
}

fn with_forms(check: impl Fn(&Form)) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("geometry.toml");
    std::fs::write(&path, GEOMETRY).unwrap();
    forms(path.to_str().unwrap()).iter().for_each(check);
}

#[track_caller]
fn usage_error(form: &Form, input: &str, words: &[&str]) {
    let out = run(&form.args, input.as_bytes());
    let said = String::from_utf8(out.stderr).unwrap();
    assert_eq!(out.status.code(), Some(2), "{:?}: {said}", form.args);
    assert!(out.stdout.is_empty());
    assert_eq!(said.trim().lines().count(), 1, "{said}");
    assert!(words.iter().all(|w| said.contains(w)), "{:?}: {said}", form.args);
}

/// Each ragged row is answered in its place, with its own cells first and the reason in the last cell.
#[test]
fn ragged_rows_are_refused_in_their_place() {
    with_forms(|form| {
        let Form { args, header, good } = form;
        let text = format!("{header}\n{good}\n{good},7\nshort\n{good}\n");
        let out = run(args, text.as_bytes());
        assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
        let answer = String::from_utf8(out.stdout).unwrap();
        let rows: Vec<csv::StringRecord> =
            csv::Reader::from_reader(answer.as_bytes()).records().map(|r| r.unwrap()).collect();
        assert_eq!(rows.len(), 4, "{answer}");
        let (width, status) = (header.split(',').count(), |k: usize| rows[k].iter().next_back().unwrap().to_string());
        assert!(!status(0).starts_with("refused"), "{args:?}: {}", status(0));
        assert_eq!(status(1), format!("refused: {} fields where the header has {width}", width + 1));
        assert_eq!(status(2), format!("refused: 1 fields where the header has {width}"));
        assert_eq!((&rows[2][0], &rows[0]), ("short", &rows[3]));
    });
}

/// With `--json` the rows on standard output are JSON with the same cells as the CSV. A file stays CSV.
#[test]
fn rows_can_be_json() {
    with_forms(|form| {
        let Form { args, header, good } = form;
        let text = format!("{header}\n{good}\nshort\n");
        let plain = run(args, text.as_bytes()).stdout;
        let with = |more: &[&str]| {
            let args: Vec<String> = args.iter().cloned().chain(more.iter().map(|m| m.to_string())).collect();
            let out = run(&args, text.as_bytes());
            assert!(out.status.success(), "{args:?}: {}", String::from_utf8_lossy(&out.stderr));
            out.stdout
        };
        let json: serde_json::Value = serde_json::from_slice(&with(&["--json"])).unwrap();
        let mut csv = csv::Reader::from_reader(&plain[..]);
        let names = csv.headers().unwrap().clone();
        let rows: Vec<csv::StringRecord> = csv.records().map(|r| r.unwrap()).collect();
        assert_eq!(json["rows"].as_array().unwrap().len(), rows.len());
        for (k, row) in rows.iter().enumerate() {
            for (name, cell) in names.iter().zip(row) {
                let value = &json["rows"][k][name];
                let same = match cell.parse::<f64>() {
                    Ok(v) if v.is_finite() => value.as_f64() == Some(v),
                    _ if cell.is_empty() || cell == "inf" => value.is_null(),
                    _ => value.as_str() == Some(cell),
                };
                assert!(same, "{args:?}: {name}: {cell:?} is {value}");
            }
        }
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("rows.csv");
        let counts: serde_json::Value =
            serde_json::from_slice(&with(&["--json", "-o", file.to_str().unwrap()])).unwrap();
        assert_eq!((counts["rows"].as_u64(), counts["refused"].as_u64()), (Some(2), Some(1)));
        assert_eq!(std::fs::read(file).unwrap(), plain);
    });
}

#[test]
fn a_header_that_names_a_column_twice_or_an_output_is_an_error() {
    with_forms(|form| {
        let name = form.header.split(',').nth(1).unwrap();
        usage_error(form, &format!("{},{name}\n{},1\n", form.header, form.good), &["standard input", name, "twice"]);
        usage_error(form, &form.header.replacen(name, "elsewhere", 1), &["standard input"]);
        usage_error(form, "", &["standard input", "no header line"]);
        // Semicolons separate as well as commas.
        let out = run(&form.args, format!("{}\n{}\n", form.header, form.good).replace(',', ";").as_bytes());
        let rows = String::from_utf8(out.stdout).unwrap();
        assert!(out.status.success() && rows.lines().count() == 2 && rows.starts_with("note,"), "{rows}");
        if form.args[0] == "fit" && form.args[1] == "slab" {
            usage_error(form, &format!("{},sigma_a\n", form.header), &["sigma_a", "already has"]);
        }
    });
}

/// One row has another encoding. A cell that is carried through keeps its bytes, a number in this encoding is refused,
/// and the batch continues.
#[test]
fn another_encoding_stops_no_batch() {
    with_forms(|form| {
        let mut text = format!("{}\n{}\n", form.header, form.good).into_bytes();
        text.extend_from_slice(b"\xff\xe4");
        text.extend_from_slice(&form.good.as_bytes()[1..]);
        text.extend_from_slice(b"\n");
        let broken = form.good.replacen("a,0", "a,\u{1}", 1).into_bytes();
        text.extend(broken.iter().map(|b| if *b == 1 { 0xb5 } else { *b }));
        text.extend_from_slice(format!("\n{}\n", form.good).as_bytes());
        let out = run(&form.args, &text);
        assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
        let lines: Vec<&[u8]> = out.stdout.split(|b| *b == b'\n').filter(|l| !l.is_empty()).collect();
        assert_eq!(lines.len(), 5);
        assert!(lines[2].starts_with(b"\xff\xe4,") && lines[2][2..] == lines[1][1..], "{:?}", form.args);
        // A reading of a trace costs itself, another number its row.
        let third = String::from_utf8_lossy(lines[3]);
        if form.args[..2] == ["fit", "gloss"] {
            assert!(!third.contains("refused"), "{third}");
        } else {
            assert!(
                third.contains("refused: ") && third.ends_with("not valid UTF-8 text; expected a number"),
                "{third}"
            );
        }
        assert_eq!(lines[4], lines[1]);
    });
    // A header must be text.
    with_forms(|form| {
        let out = run(&form.args, b"\xff\xfe\n1\n");
        assert_eq!(out.status.code(), Some(2));
        assert!(
            String::from_utf8_lossy(&out.stderr).contains("line 1: not valid UTF-8 text"),
            "{}",
            String::from_utf8_lossy(&out.stderr)
        );
    });
}

/// Every form gives the same answer whichever line ends the table has, and behind comments.
#[test]
fn line_ends_and_comments_change_no_answer() {
    with_forms(|form| {
        let Form { args, header, good } = form;
        let lines = [header, good, good, good];
        let with = |ends: [&str; 4], before: &str| {
            let rows: String = lines.iter().zip(ends).map(|(line, end)| format!("{line}{end}")).collect();
            let out = run(args, format!("{before}{rows}").as_bytes());
            assert_eq!(out.status.code(), Some(0), "{args:?}: {}", String::from_utf8_lossy(&out.stderr));
            String::from_utf8(out.stdout).unwrap()
        };
        let plain = with(["\n"; 4], "");
        assert_eq!(plain.lines().count(), 4);
        for ends in
            [["\r"; 4], ["\r\n"; 4], ["\r", "\r", "\n", "\n"], ["\n", "\r", "\r\n", ""], ["\r", "\n", "\n", "\r"]]
        {
            assert_eq!(with(ends, ""), plain, "{args:?}: {ends:?}");
            assert_eq!(with(ends, "# made by a program, at noon\r\n\r\n"), plain, "{args:?}: {ends:?}");
        }
    });
}

/// A cell with a unit in it is no number. A thickness column that names its unit is read in this unit.
#[test]
fn units_are_never_guessed() {
    let slab = |args: &[&str], text: &str| {
        let args: Vec<String> = ["fit", "slab"].iter().chain(args).map(|a| a.to_string()).collect();
        let out = run(&args, text.as_bytes());
        (out.status.code().unwrap(), String::from_utf8(out.stdout).unwrap(), String::from_utf8(out.stderr).unwrap())
    };
    let cells = slab(&[], "rho_d,rho_t,h\n0.3,0.2,0.2 mm\n30 %,0.2,0.2\n0.3,0.2,200um\n");
    assert_eq!(cells.0, 1, "every row is refused");
    assert_eq!(
        cells.1.lines().filter(|l| l.contains("refused: ") && l.ends_with("expected a number\"")).count(),
        3,
        "{}",
        cells.1
    );
    let numbers = |out: &str| out.lines().nth(1).unwrap().split(',').skip(3).map(String::from).collect::<Vec<_>>();
    let mm = slab(&[], "rho_d,rho_t,h\n0.3,0.2,0.2\n");
    for (column, value) in [
        ("thickness_um", "200"),
        ("thickness_mm", "0.2"),
        ("thickness (um)", "200"),
        ("h_m", "0.0002"),
        ("depth", "0.2"),
    ] {
        let out = slab(&["--columns", &format!("h={column}")], &format!("rho_d,rho_t,{column}\n0.3,0.2,{value}\n"));
        assert_eq!(out.0, 0, "{}", out.2);
        assert_eq!(numbers(&out.1), numbers(&mm.1), "{column}");
    }
    for (args, word) in [
        (&["--columns", "h=thickness_mm", "--thickness-unit", "um"][..], "thickness_mm"),
        (&["--columns", "h=thickness_cm"], "cm"),
        (&["--columns", "h=thickness_mil", "--thickness-unit", "um"], "mil"),
    ] {
        let column = args[1].split_once('=').unwrap().1;
        let out = slab(args, &format!("rho_d,rho_t,{column}\n0.3,0.2,0.2\n"));
        assert_eq!((out.0, out.1.as_str()), (2, ""), "{args:?}");
        assert!(out.2.contains(word) && out.2.trim().lines().count() == 1, "{}", out.2);
    }
    // A thickness column that names its unit needs no option. A column with another name is not mistaken for one.
    let named = slab(&[], "rho_d,rho_t,thickness_um\n0.3,0.2,200\n");
    assert_eq!((named.0, numbers(&named.1)), (0, numbers(&mm.1)), "{}", named.2);
    let lacks = slab(&[], "rho_d,rho_t,depth_um\n0.3,0.2,200\n");
    assert!(lacks.0 == 2 && lacks.2.contains("h: no such column") && lacks.2.contains("depth_um"), "{}", lacks.2);
}

/// `… | head -1`: the reader stops after a line, and the program ends quietly with exit code 0.
#[test]
fn a_reader_that_leaves_is_no_failure() {
    with_forms(|form| {
        let mut child = Command::new(env!("CARGO_BIN_EXE_mesophyll"))
            .args(&form.args)
            .arg("--quiet")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut input = child.stdin.take().unwrap();
        let (header, row) = (format!("{}\n", form.header), format!("{}\n", form.good).repeat(100));
        let writer = std::thread::spawn(move || {
            let _ = input.write_all(header.as_bytes());
            for _ in 0..40 {
                if input.write_all(row.as_bytes()).is_err() {
                    return;
                }
            }
        });
        let mut first = [0u8; 8];
        child.stdout.take().unwrap().read_exact(&mut first).unwrap();
        let out = child.wait_with_output().unwrap();
        writer.join().unwrap();
        assert_eq!(out.status.code(), Some(0), "{:?}", form.args);
        assert!(out.stderr.is_empty(), "{:?}: {}", form.args, String::from_utf8_lossy(&out.stderr));
    });
}

/// Blocks are streamed: the first rows are answered before the last ones are read.
#[test]
fn rows_come_out_while_others_go_in() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_mesophyll"))
        .args(["--quiet", "eval", "slab"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    let mut output = child.stdout.take().unwrap();
    input.write_all(b"omega,delta\n").unwrap();
    let row = b"0.5,1.0\n".repeat(1000);
    let (tell, told) = std::sync::mpsc::channel();
    let reader = std::thread::spawn(move || {
        let mut some = vec![0u8; 200_000];
        output.read_exact(&mut some).unwrap();
        tell.send(some).unwrap();
        // The rest is read and ignored, so that neither side waits for the other.
        let _ = std::io::copy(&mut output, &mut std::io::sink());
    });
    // The reader gets its share after far fewer rows than a batch may have. The input is still open then.
    let mut some = None;
    for _ in 0..400 {
        input.write_all(&row).unwrap();
        some = some.or_else(|| told.try_recv().ok());
        if some.is_some() {
            break;
        }
    }
    let some = some.expect("answers while the input is open");
    assert!(some.starts_with(b"omega,delta,rho_d,rho_t,status\n0.5,1.0,"));
    drop(input);
    assert!(child.wait().unwrap().success());
    reader.join().unwrap();
}
