//! Workbooks, written as the parts of the format that a reader needs.

use crate::instrument::xlsx::unpacks_within;
use crate::instrument::{InstrumentFormat, recognise, sheet};
use std::io::Write;
use zip::write::SimpleFileOptions;

/// A cell: a number, a text, a number shown as a date, an error.
pub enum Cell<'a> {
    N(f64),
    T(&'a str),
    D(f64),
    E(&'a str),
}
use Cell::{D, E, N, T};

fn name(column: usize) -> String {
    let letter = |k: usize| char::from(b'A' + k as u8);
    if column < 26 { letter(column).into() } else { format!("{}{}", letter(column / 26 - 1), letter(column % 26)) }
}

/// The part of a sheet: cells with their row (from 1) and column (from 0), and merged ranges.
fn part(cells: &[(usize, usize, Cell)], merged: &[&str]) -> String {
    let mut rows: Vec<usize> = cells.iter().map(|c| c.0).collect();
    rows.sort_unstable();
    rows.dedup();
    let mut data = String::new();
    for row in rows {
        data += &format!("<row r=\"{row}\">");
        for (_, column, cell) in cells.iter().filter(|c| c.0 == row) {
            let at = format!("{}{row}", name(*column));
            data += &match cell {
                N(v) => format!("<c r=\"{at}\"><v>{v}</v></c>"),
                T(text) => format!("<c r=\"{at}\" t=\"inlineStr\"><is><t>{text}</t></is></c>"),
                D(v) => format!("<c r=\"{at}\" s=\"1\"><v>{v}</v></c>"),
                E(text) => format!("<c r=\"{at}\" t=\"e\"><v>{text}</v></c>"),
            };
        }
        data += "</row>";
    }
    let merged: String = merged.iter().map(|m| format!("<mergeCell ref=\"{m}\"/>")).collect();
    format!(
        "<worksheet xmlns=\"http://schemas.openxmlformats.org/spreadsheetml/2006/main\"><sheetData>\
         {data}</sheetData><mergeCells>{merged}</mergeCells></worksheet>"
    )
}

/// A workbook of sheets: name, whether it is hidden, its part.
fn book(sheets: &[(&str, bool, String)]) -> Vec<u8> {
    let main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main";
    let office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships";
    let package = "http://schemas.openxmlformats.org/package/2006/relationships";
    let list: String = (sheets.iter().enumerate())
        .map(|(k, (name, hidden, _))| {
            let state = if *hidden { " state=\"hidden\"" } else { "" };
            format!("<sheet name=\"{name}\" sheetId=\"{n}\" r:id=\"rId{n}\"{state}/>", n = k + 1)
        })
        .collect();
    let relations: String = (1..=sheets.len())
        .map(|n| {
            format!("<Relationship Id=\"rId{n}\" Type=\"{office}/worksheet\" Target=\"worksheets/sheet{n}.xml\"/>")
        })
        .collect();
    let mut parts = vec![
        (
            "[Content_Types].xml".to_string(),
            "<Types xmlns=\"http://schemas.openxmlformats.org/package/2006/content-types\"/>".to_string(),
        ),
        (
            "_rels/.rels".into(),
            format!(
                "<Relationships xmlns=\"{package}\"><Relationship Id=\"rId1\" Type=\"{office}/officeDocument\" \
                 Target=\"xl/workbook.xml\"/></Relationships>"
            ),
        ),
        (
            "xl/workbook.xml".into(),
            format!("<workbook xmlns=\"{main}\" xmlns:r=\"{office}\"><sheets>{list}</sheets></workbook>"),
        ),
        (
            "xl/_rels/workbook.xml.rels".into(),
            format!(
                "<Relationships xmlns=\"{package}\">{relations}<Relationship Id=\"rId99\" Type=\"{office}/styles\" \
                 Target=\"styles.xml\"/></Relationships>"
            ),
        ),
        (
            "xl/styles.xml".into(),
            format!(
                "<styleSheet xmlns=\"{main}\"><cellXfs><xf numFmtId=\"0\"/><xf numFmtId=\"14\"/></cellXfs></styleSheet>"
            ),
        ),
    ];
    for (k, (_, _, part)) in sheets.iter().enumerate() {
        parts.push((format!("xl/worksheets/sheet{}.xml", k + 1), part.clone()));
    }
    zipped(&parts)
}

fn zipped(parts: &[(String, String)]) -> Vec<u8> {
    let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, text) in parts {
        writer.start_file(name, SimpleFileOptions::default()).unwrap();
        writer.write_all(text.as_bytes()).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

pub fn small() -> Vec<u8> {
    book(&[("Sheet1", false, part(&[(1, 0, T("leaf")), (1, 1, T("R450")), (2, 0, T("a")), (2, 1, N(0.05))], &[]))])
}

fn csv(bytes: &[u8]) -> (String, String) {
    let (table, notes) = sheet(bytes).unwrap();
    (String::from_utf8(table).unwrap(), notes.join("; "))
}

#[test]
fn a_sheet_becomes_a_table() {
    assert_eq!(recognise(&small()), Some(InstrumentFormat::Xlsx));
    assert_eq!(csv(&small()).0, "leaf,R450\na,0.05\n");
    // A title, an empty row and column, whole numbers as names, commas in texts, errors, a date, a remark beside.
    let cells = [
        (2, 1, T("Measured by Jo")),
        (4, 1, T("leaf, tree")),
        (4, 2, N(450.0)),
        (4, 4, N(550.5)),
        (5, 1, T("a")),
        (5, 2, N(0.1 + 0.2)),
        (5, 4, E("#N/A")),
        (5, 7, T("check this")),
        (6, 1, T("b")),
        (6, 2, D(44_000.0)),
        (6, 4, E("#DIV/0!")),
    ];
    let (table, notes) = csv(&book(&[("Leaves", false, part(&cells, &[]))]));
    assert_eq!(table, "\"leaf, tree\",450,550.5\na,0.30000000000000004,\nb,date 44000,#DIV/0!\n");
    assert!(notes.contains("1 rows above") && notes.contains("1 cells in columns without a name"), "{notes}");
}

#[test]
fn the_first_visible_sheet_with_a_table_is_read_and_the_others_are_named() {
    let table = |v: f64| part(&[(1, 0, T("leaf")), (1, 1, T("R450")), (2, 0, T("a")), (2, 1, N(v))], &[]);
    let words = part(&[(1, 0, T("Read")), (1, 1, T("me")), (2, 0, T("first")), (2, 1, T("please"))], &[]);
    let bytes = book(&[
        ("old", true, table(9.0)),
        ("About", false, words.clone()),
        ("Oaks", false, table(0.5)),
        ("Elms", false, table(0.6)),
    ]);
    let (table, notes) = csv(&bytes);
    assert_eq!(table, "leaf,R450\na,0.5\n");
    assert!(notes.contains("\"Oaks\" is read") && notes.contains("About, Elms, and 1 hidden"), "{notes}");
    assert!(sheet(&book(&[("About", false, words)])).unwrap_err().contains("holds no table"));
}

#[test]
fn a_merged_cell_holds_for_all_that_it_covers() {
    let mut cells = vec![(1, 0, T("leaf")), (1, 1, T("wavelength_nm")), (1, 2, T("R"))];
    for (k, leaf) in [(2, "elm"), (5, "oak")] {
        cells.push((k, 0, T(leaf)));
        for j in 0..3 {
            cells.push((k + j, 1, N(450.0 + 10.0 * j as f64)));
            cells.push((k + j, 2, N(0.1)));
        }
    }
    let (table, notes) = csv(&book(&[("S", false, part(&cells, &["A2:A4", "A5:A7"]))]));
    let leaves: Vec<&str> = table.lines().skip(1).map(|l| l.split(',').next().unwrap()).collect();
    assert_eq!(leaves, ["elm", "elm", "elm", "oak", "oak", "oak"]);
    assert!(notes.contains("4 cells take the value of the merged cell"), "{notes}");
}

/// Some kB that unpack to more than is allowed, and a sheet that claims the largest rectangle.
#[test]
fn a_workbook_that_unpacks_to_too_much_is_refused() {
    let parts =
        ["xl/worksheets/sheet1.xml", "xl/worksheets/sheet2.xml"].map(|name| (name.to_string(), " ".repeat(3 << 20)));
    let bytes = zipped(&parts);
    assert!(bytes.len() < 1 << 15);
    assert!(unpacks_within(6 << 20, &bytes).is_ok());
    assert!(unpacks_within(4 << 20, &bytes).unwrap_err().contains("unpacks to more than 4 MB"));
    let corner = "<row r=\"1048576\"><c r=\"XFD1048576\"><v>1</v></c></row></sheetData>";
    let wide = part(&[(1, 0, T("leaf")), (1, 1, T("R450")), (2, 0, T("a")), (2, 1, N(0.05))], &[]);
    let (table, _) = csv(&book(&[("S", false, wide.replace("</sheetData>", corner))]));
    assert_eq!(table, "leaf,R450\na,0.05\n,\n");
}
