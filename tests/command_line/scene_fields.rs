//! The tables of fields in `data/scenes/README.md` are those of the program: every field that the reader of scene files
//! takes stands there, and every field that stands there is taken.
//!
//! The reader tells its fields itself: it refuses a field that it does not know, and names those that it knows.

use mesophyll::scene::manifest::SceneManifest;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

const PAGE: &str = "data/scenes/README.md";
/// A field of no table.
const STRANGE: &str = "no_such_field = 1\n";
/// A scene that may have one more table.
const SCENE: &str = "schema = 1\nname = \"s\"\n";
const UNIFORM: &str = "uniform = { rho_d = [[0, 0, 0], [0, 0, 0]], rho_t = [0, 0, 0] }\n";

type Fields = BTreeSet<String>;

/// A row of the page: the names of its fields, and what it says of them.
struct Row {
    fields: Vec<String>,
    says: String,
}

/// The tables of fields of the page, by the heading that they stand below.
fn page() -> BTreeMap<String, Vec<Vec<Row>>> {
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(PAGE)).unwrap();
    let (mut found, mut heading, mut within) = (BTreeMap::<_, Vec<Vec<Row>>>::new(), String::new(), false);
    for line in text.lines() {
        if let Some(of) = line.strip_prefix("### ") {
            heading = of.split(':').next().unwrap_or_default().to_string();
        }
        if line.starts_with("| field |") {
            found.entry(heading.clone()).or_default().push(Vec::new());
            within = true;
        } else if !line.starts_with('|') {
            within = false;
        } else if within && !line.starts_with("|---") {
            let (names, says) = line[1..].split_once('|').unwrap();
            let fields = names.split('`').skip(1).step_by(2).map(String::from).collect();
            found.get_mut(&heading).unwrap().last_mut().unwrap().push(Row { fields, says: says.into() });
        }
    }
    found
}

/// The fields that the reader names where it finds one that it does not know.
#[track_caller]
fn taken(text: &str) -> Fields {
    let said = SceneManifest::parse(&format!("{SCENE}{text}"), Path::new("s.toml")).unwrap_err().to_string();
    assert!(said.contains("no_such_field"), "{text}: {said}");
    let fields: Fields = match said.split_once("expected its fields ") {
        Some((_, list)) => list.split(", ").map(String::from).collect(),
        None => {
            let list = said.split_once("expected ").unwrap_or_else(|| panic!("{said}")).1;
            list.split('`').skip(1).step_by(2).map(String::from).collect()
        }
    };
    assert!(!fields.is_empty(), "{said}");
    fields
}

/// The fields of all these tables, each with what it must have to be read that far.
#[track_caller]
fn all(tables: &[&str]) -> Fields {
    tables.iter().flat_map(|table| taken(&format!("{table}{STRANGE}"))).collect()
}

/// The fields of a table inside a field of a leaf.
#[track_caller]
fn inside(field: &str) -> Fields {
    let whole = if field == "translucency" || field == "other_side" { "fit = \"f\"\n" } else { "" };
    taken(&format!("[[leaf]]\nname = \"a\"\n{whole}{field} = {{ {} }}\n", STRANGE.trim()))
}

#[test]
fn the_page_of_scenes_has_the_fields_that_are_read() {
    let view = "[[view]]\nname = \"v\"\n";
    let place = "eye_mm = [0, 0, 9]\ntarget_mm = [0, 0, 0]\nfov_deg = 30\n";
    let (sun, model) =
        ("[sun]\nzenith_deg = 30\nirradiance = [1, 1, 1]\n", "[sky]\nmodel = \"preetham\"\nturbidity = 3\n");
    let leaf = |kind: &str| format!("[[leaf]]\nname = \"a\"\n{kind}");
    let leaves =
        ["fit = \"f\"\n", "like = \"b\"\n", UNIFORM, "foliar = {}\n", "look = { albedo = \"a.png\" }\n"].map(leaf);
    let views = [
        format!("{view}kind = \"perspective\"\n{place}"),
        format!("{view}kind = \"card\"\nleaf = \"a\"\n{place}"),
        format!("{view}kind = \"capture\"\nleaf = \"a\"\n"),
    ];
    // Each table of the page: its heading, the word before its fields, and the fields that are read.
    let tables: Vec<(&str, usize, &str, Fields)> = vec![
        ("`[[leaf]]`", 0, "", all(&leaves.each_ref().map(String::as_str))),
        ("`[[leaf]]`", 1, "", inside("foliar")),
        ("`[[leaf]]`", 2, "", inside("uniform")),
        ("`[[leaf]]`", 3, "", inside("scan")),
        ("`[[instance]]`", 0, "", all(&["[[instance]]\n"])),
        ("`[[plant]]`", 0, "", all(&["[[plant]]\n"])),
        ("`[[plant.branch]]`", 0, "", all(&["[[plant]]\nmaterials = {}\n[[plant.branch]]\n"])),
        ("`[[grass]]`", 0, "", all(&["[[grass]]\n"])),
        ("`[wind]`", 0, "", all(&["[wind]\n"])),
        ("`[ground]` and `[periodic]`", 0, "ground.", all(&["[ground]\n"])),
        ("`[ground]` and `[periodic]`", 0, "periodic.", all(&["[periodic]\n"])),
        ("`[sun]` and `[sky]`", 0, "sun.", all(&[sun, &format!("{model}{sun}")])),
        (
            "`[sun]` and `[sky]`",
            0,
            "sky.",
            all(&["[sky]\nradiance = [1, 1, 1]\n", "[sky]\nenvironment = \"e.exr\"\n", model]),
        ),
        ("`[transfer]`", 0, "", all(&["[transfer]\n"])),
        ("`[day]`", 0, "", all(&["[day]\n"])),
        ("`[[view]]`", 0, "", all(&views.each_ref().map(String::as_str))),
        ("`[[picture]]`, `[[brf]]` and `[unknown]`", 0, "picture.", all(&["[[picture]]\n"])),
        ("`[[picture]]`, `[[brf]]` and `[unknown]`", 0, "brf.", all(&["[[brf]]\n"])),
        ("`[[picture]]`, `[[brf]]` and `[unknown]`", 0, "unknown.", all(&["[unknown]\n"])),
        ("`[camera]`", 0, "", all(&["[camera]\n"])),
        ("`[check]`", 0, "", all(&["[check]\n"])),
    ];
    let page = page();
    // How many fields each table has.
    let tables_there = page.iter().flat_map(|(heading, tables)| tables.iter().enumerate().map(move |t| (heading, t)));
    let shown: BTreeMap<(&str, usize), usize> = tables_there
        .map(|(heading, (k, rows))| ((heading.as_str(), k), rows.iter().map(|r| r.fields.len()).sum()))
        .collect();
    let mut names: Fields = BTreeSet::new();
    let own = ("The scene", 0);
    let (mut wrong, mut seen) = (Vec::new(), BTreeMap::from([(own, shown[&own])]));
    for (heading, k, before, mut read) in tables {
        let rows = page.get(heading).and_then(|tables| tables.get(k));
        let rows = rows.unwrap_or_else(|| panic!("{PAGE} has no table {k} below {heading}"));
        let written: Fields =
            rows.iter().flat_map(|r| &r.fields).filter_map(|f| f.strip_prefix(before)).map(String::from).collect();
        // A branch has a table of its own.
        if heading == "`[[plant]]`" {
            assert!(read.remove("branch"));
        }
        let absent: Vec<_> = read.difference(&written).collect();
        let unknown: Vec<_> = written.difference(&read).collect();
        if !absent.is_empty() || !unknown.is_empty() {
            wrong.push(format!("{heading} {before}: not on the page {absent:?}, not read {unknown:?}"));
        }
        *seen.entry((heading, k)).or_default() += written.len();
        names.extend(heading.split(['[', ']']).filter(|w| w.starts_with(char::is_alphabetic)).map(String::from));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert_eq!(seen, shown, "{PAGE} has a table or a field that this test does not know");
    // The fields of the scene itself, and the tables that have a heading.
    names.extend(page[own.0][own.1].iter().flat_map(|r| r.fields.iter().cloned()));
    names.retain(|name| !name.contains('.'));
    assert_eq!(names, taken(STRANGE));
}

/// Small tables are described in the row of the field that holds them.
#[test]
fn a_row_names_the_fields_of_the_table_that_it_describes() {
    let page = page();
    let row = |heading: &str, field: &str| -> &Row {
        page[heading].iter().flatten().find(|r| r.fields.iter().any(|f| f == field)).unwrap()
    };
    let strange = STRANGE.trim();
    for (heading, field, read) in [
        ("`[[leaf]]`", "translucency", inside("translucency")),
        ("`[[leaf]]`", "other_side", inside("other_side")),
        (
            "`[[leaf]]`",
            "fades_to",
            taken(&format!("[[leaf]]\nname = \"a\"\nfoliar = {{ fades_to = {{ {strange} }} }}\n")),
        ),
        ("`[[plant]]`", "flutter", taken(&format!("[[plant]]\nflutter = {{ {strange} }}\n"))),
        ("`[ground]` and `[periodic]`", "ground.hill", taken(&format!("[ground]\nhill = {{ {strange} }}\n"))),
    ] {
        let says = &row(heading, field).says;
        let absent: Vec<_> = read.iter().filter(|name| !says.contains(name.as_str())).collect();
        assert!(absent.is_empty(), "{PAGE}: {field}: {absent:?} not in {says}");
    }
}
