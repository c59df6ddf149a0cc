//! Tests of one table in all the forms in which it may be written, through every way of reading it.

use super::*;
use std::io::{Cursor, Write};

const HEADER: [&str; 3] = ["leaf", "x", "y"];
/// A name with a separator of each kind in it is quoted in every form.
const ROWS: [[&str; 3]; 5] = [
    ["elm", "0.9", "1"],
    ["a,b;c", "0.75", ""],
    ["ash", "-9999", "NA"],
    ["elm", "1.5e-3", "0.125"],
    ["ash", "2", "4.5"],
];

const ENDS: [[&str; 2]; 5] = [["\n", "\n"], ["\r\n", "\r\n"], ["\r", "\r"], ["\r", "\n"], ["\n", "\r"]];

/// How a text is stored.
#[derive(Clone, Copy, Debug)]
enum Stored {
    Plain,
    Utf8Mark,
    Utf16 { big_endian: bool, mark: bool },
}

const STORED: [Stored; 6] = [
    Stored::Plain,
    Stored::Utf8Mark,
    Stored::Utf16 { big_endian: false, mark: true },
    Stored::Utf16 { big_endian: true, mark: true },
    Stored::Utf16 { big_endian: false, mark: false },
    Stored::Utf16 { big_endian: true, mark: false },
];

impl Stored {
    fn bytes(self, text: &str) -> Vec<u8> {
        match self {
            Stored::Plain => text.as_bytes().to_vec(),
            Stored::Utf8Mark => [b"\xef\xbb\xbf", text.as_bytes()].concat(),
            Stored::Utf16 { big_endian, mark } => {
                let units = mark.then_some(0xfeff).into_iter().chain(text.encode_utf16());
                units.flat_map(|u| if big_endian { u.to_be_bytes() } else { u.to_le_bytes() }).collect()
            }
        }
    }
}

/// The table with these separators and line ends; the line behind the header ends in the first one.
fn written(separator: char, decimal_comma: bool, comments: &str, ends: [&str; 2]) -> String {
    let line = |cells: &[String]| cells.join(&separator.to_string());
    let cell = |k: usize, text: &str| match (k, decimal_comma) {
        (0, _) if text.contains(',') => format!("\"{text}\""),
        (0, _) | (_, false) => text.to_string(),
        _ => text.replace('.', ","),
    };
    let comments: String = comments.lines().map(|c| format!("{c}{}", ends[1])).collect();
    let mut text = comments + &line(&HEADER.map(String::from)) + ends[0];
    for row in ROWS {
        let cells: Vec<String> = row.iter().enumerate().map(|(k, text)| cell(k, text)).collect();
        text += &(line(&cells) + ends[1]);
    }
    text
}

fn opened(bytes: &[u8]) -> InputTable {
    InputTable::from_reader(Box::new(Cursor::new(bytes.to_vec())), "in.csv".into()).unwrap()
}

fn spec() -> BatchSpec {
    let [x, y] = ["x", "y"].map(String::from);
    BatchSpec { required: vec![x], optional: vec![y], outputs: vec!["sum".into()], ..BatchSpec::default() }
}

fn sum(row: &InputRow, out: &mut Vec<OutputRow>) {
    out.push(OutputRow::ok(vec![row.get(0) + if row.get(1).is_nan() { 100.0 } else { row.get(1) }]));
}

/// By blocks: the answers, each with its row as it was carried through.
fn by_blocks(table: InputTable) -> String {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out.csv");
    run(table, &TableOutput::csv(&out), &spec(), sum).unwrap();
    std::fs::read_to_string(out).unwrap()
}

/// Row by row: name, line and numbers.
fn by_rows(mut table: InputTable) -> Vec<(String, usize, Vec<Option<f64>>)> {
    let (mut rows, mut record) = (Vec::new(), TableRecord::default());
    while table.next_record(&mut record).unwrap() {
        assert_eq!(record.fault(3), None);
        let numbers = (1..3).map(|k| table.number(&record, k).unwrap()).collect();
        rows.push((record.shown(0).into_owned(), record.line(), numbers));
    }
    rows
}

/// By groups: the numbers of each leaf.
fn by_groups(table: InputTable) -> String {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out.csv");
    let all = |_: &str, rows: &[GroupRow], _: &Omissions| OutputRow::ok(vec![rows.iter().map(|r| r.values[0]).sum()]);
    Groups::read(table, &spec(), "leaf").unwrap().run(&TableOutput::csv(&out), &spec(), all).unwrap();
    std::fs::read_to_string(out).unwrap()
}

/// A table that gzip packed, in one piece or in several, is the table; one that ends in the middle is refused by name.
#[test]
fn a_packed_table_is_unpacked() {
    let packed = |text: &str| {
        let mut to = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
        to.write_all(text.as_bytes()).unwrap();
        to.finish().unwrap()
    };
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("leaves.csv.gz");
    let rows: String = (0..5000).map(|k| format!("{k},{}\n", k * k)).collect();
    for bytes in [packed(&format!("x,y\n{rows}")), [packed("x,y\n"), packed(&rows)].concat()] {
        std::fs::write(&path, &bytes).unwrap();
        let answers = by_blocks(InputTable::open(&path).unwrap());
        assert_eq!(answers.lines().count(), 5001);
        assert!(answers.contains(&format!("{}", 4999 + 4999 * 4999)));
        std::fs::write(&path, &bytes[..40]).unwrap();
        let sentence = InputTable::open(&path).err().unwrap().to_string();
        assert!(sentence.contains("leaves.csv.gz"), "{sentence}");
    }
}

#[test]
fn a_table_says_the_same_in_every_form() {
    let grouped = "leaf,sum,status\nelm,0.9015,ok\n\"a,b;c\",0.75,ok\nash,2.0,ok\n";
    let numbers =
        [[Some(0.9), Some(1.0)], [Some(0.75), None], [None, None], [Some(1.5e-3), Some(0.125)], [Some(2.0), Some(4.5)]];
    for (separator, decimal_comma) in [(',', false), (';', false), (';', true), ('\t', false), ('\t', true)] {
        // Carried cells keep their text.
        let cell = |text: &str| match text {
            _ if text.contains(',') => format!("\"{text}\""),
            _ if decimal_comma && text.contains('.') => format!("\"{}\"", text.replace('.', ",")),
            _ => text.to_string(),
        };
        let ends = ["1.9,ok", "100.75,ok", ",refused: x is missing (-9999)", "0.1265,ok", "6.5,ok"];
        let each = ROWS.iter().zip(ends).map(|(row, end)| format!("{},{end}\n", row.map(cell).join(",")));
        let blocks: String = std::iter::once("leaf,x,y,sum,status\n".to_string()).chain(each).collect();
        for (comments, before) in [("", 0), ("# made, by; a program\n% at noon", 2)] {
            for ends in ENDS {
                for stored in STORED {
                    let text = written(separator, decimal_comma, comments, ends);
                    let bytes = stored.bytes(&text);
                    let what = format!("{text:?} as {stored:?}");
                    assert_eq!(by_blocks(opened(&bytes)), blocks, "{what}");
                    assert_eq!(by_groups(opened(&bytes)), grouped, "{what}");
                    let rows = by_rows(opened(&bytes));
                    assert_eq!(rows.len(), ROWS.len(), "{what}");
                    for (k, (name, line, found)) in rows.iter().enumerate() {
                        assert_eq!(
                            (name.as_str(), *line, &found[..]),
                            (ROWS[k][0], k + 2 + before, &numbers[k][..]),
                            "{what}"
                        );
                    }
                    // The first rows are known before any is read.
                    assert_eq!(opened(&bytes).head(&["y".into()]), [1.0, 0.125, 4.5], "{what}");
                }
            }
        }
    }
}

/// More rows than a block and a buffer hold, with all line ends in turn.
#[test]
fn no_row_of_a_long_table_is_lost() {
    let mut text = "x,note\r".to_string();
    let ends = ["\n", "\r\n", "\r", "\r\r", "\n\r\n"];
    let rows = 60_000;
    for k in 0..rows {
        let note = if k % 1000 == 0 { "\"a\rb\"" } else { "" };
        text += &format!("{k},{note}{}", ends[(k / 7) % ends.len()]);
    }
    let spec = BatchSpec { required: vec!["x".into()], outputs: vec!["y".into()], ..BatchSpec::default() };
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out.csv");
    let table = opened(text.as_bytes());
    let tally = run(table, &TableOutput::csv(&out), &spec, |row, out| {
        assert_eq!(row.number(), row.get(0) as usize + 1);
        out.push(OutputRow::ok(vec![row.get(0)]));
    });
    assert_eq!(tally.unwrap().ok, rows);
    let mut reader = csv::Reader::from_path(out).unwrap();
    assert!(reader.records().enumerate().all(|(k, row)| row.unwrap()[0] == k.to_string()));
}

/// A row without an answer, and a row that went another way, are errors and no shorter file.
#[test]
fn rows_in_are_compared_with_rows_out() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out.csv");
    let text = "x,y\n1,2\n2,3\n\n3,4\n";
    let lazy = run(opened(text.as_bytes()), &TableOutput::csv(&out), &spec_of_x(), |row, out| {
        if row.get(0) != 2.0 {
            out.push(OutputRow::ok(vec![1.0]));
        }
    });
    let said = lazy.unwrap_err().to_string();
    assert!(said.starts_with("in.csv: 2 of its 3 lines below the header were answered"), "{said}");
    let mut table = opened(text.as_bytes());
    table.next_record(&mut TableRecord::default()).unwrap();
    let lost = run(table, &TableOutput::csv(&out), &spec_of_x(), |_, out| out.push(OutputRow::ok(vec![1.0])));
    assert!(lost.unwrap_err().to_string().contains("2 of its 3 lines"));
    assert!(!out.exists());
}

fn spec_of_x() -> BatchSpec {
    BatchSpec { required: vec!["x".into()], outputs: vec!["z".into()], ..BatchSpec::default() }
}

/// Columns, names and paths are checked when a batch is opened, before anything is read or computed.
#[test]
fn a_batch_is_refused_before_it_is_computed() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("in.csv");
    std::fs::write(&file, "x,z\n1,2\n").unwrap();
    let refused = |spec: &BatchSpec, out: &std::path::Path| {
        Batch::open(InputTable::open(&file).unwrap(), &TableOutput::csv(out), spec).err().unwrap().to_string()
    };
    let out = dir.path().join("out.csv");
    assert!(refused(&spec_of_x(), &out).contains("z: the input already has this output column"));
    let spec = BatchSpec { outputs: vec!["w".into()], ..spec_of_x() };
    assert!(refused(&spec, &file).contains("is what is to be read"));
    assert!(refused(&spec, dir.path()).contains("found a folder"));
    assert!(refused(&spec, std::path::Path::new("/proc/none/out.csv")).contains("/proc/none"));
}

/// Readings cost themselves; what is no reading refuses its row.
#[test]
fn a_bad_reading_costs_itself() {
    let spec = BatchSpec {
        optional: ["k", "r", "s"].map(String::from).to_vec(),
        readings: ["r", "s"].map(String::from).to_vec(),
        outputs: vec!["sum".into(), "faults".into()],
        physical: vec![PhysicalRange::shares(["r", "s"].map(String::from).to_vec())],
        ..BatchSpec::default()
    };
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out.csv");
    let text = "k,r,s\n1,0.1,0.2\n1,x,0.2\n1,-1,0.2\n1,-1,NA\nx,0.1,0.2\n1,0.1,-1\n1,-99.9,0.5\n";
    run(opened(text.as_bytes()), &TableOutput::csv(&out), &spec, |row, out| {
        let sum = [1, 2].iter().map(|&k| row.get(k)).filter(|v| !v.is_nan()).fold(0.0, |sum, v| sum + v);
        let faults: Vec<(usize, &str)> = row.faults().collect();
        assert!(faults.is_empty() || faults == [(1, "r is \"x\"; expected a number")] && row.line() == 3);
        out.push(OutputRow::ok(vec![sum, faults.len() as f64]));
    })
    .unwrap();
    let found = std::fs::read_to_string(out).unwrap();
    let ends: Vec<&str> = found.lines().skip(1).map(|line| line.splitn(4, ',').nth(3).unwrap()).collect();
    let k = "\"refused: k is \"\"x\"\"; expected a number\"";
    assert!(ends[0].starts_with("0.30000000000000004,0.0,ok"), "{found}");
    assert_eq!(ends[1..], ["0.2,1.0,ok", "0.2,0.0,ok", "0.0,0.0,ok", &format!(",,{k}"), "0.1,0.0,ok", "0.5,0.0,ok"]);
}
