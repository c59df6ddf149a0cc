//! `docs/tables.md`: its files are those of the repository, its commands print what the page says, and every verb's
//! `--help` shows its section.
//!
//! `MESOPHYLL_WRITE_DOCS=1 cargo test --test tables` writes the printed answers into the page again.

use crate::common;
use std::path::Path;
use std::process::Command;

const PAGE: &str = "docs/tables.md";

/// A fenced block of the page.
#[derive(Debug)]
struct Block {
    /// The verb to whose section it belongs.
    verb: String,
    /// Number of the first line inside the fence.
    line: usize,
    kind: Kind,
    text: String,
}

#[derive(Debug, PartialEq)]
enum Kind {
    /// A file with this name.
    File(String),
    Command,
    /// The output of the command before it in a terminal: standard output, then messages.
    Printed,
}

fn page() -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(PAGE)).unwrap()
}

fn blocks(page: &str) -> Vec<Block> {
    let lines: Vec<&str> = page.lines().collect();
    let (mut blocks, mut verb, mut before, mut k) = (Vec::new(), String::new(), "", 0);
    while k < lines.len() {
        if let Some(rest) = lines[k].strip_prefix("## `") {
            verb = rest.trim_end_matches('`').to_string();
        }
        if let Some(kind) = lines[k].strip_prefix("```") {
            let end = (k + 1..lines.len()).find(|&e| lines[e].starts_with("```")).expect("the fence is closed");
            let kind = match kind {
                "sh" => Kind::Command,
                "text" => Kind::Printed,
                "csv" | "toml" => {
                    let name = before
                        .strip_suffix("`:")
                        .and_then(|b| b.rsplit_once('`'))
                        .expect("a file is named before its block")
                        .1;
                    Kind::File(name.to_string())
                }
                other => panic!("line {}: a block of kind {other:?}", k + 1),
            };
            blocks.push(Block { verb: verb.clone(), line: k + 1, kind, text: lines[k + 1..end].join("\n") });
            k = end;
        } else if !lines[k].trim().is_empty() {
            before = lines[k];
        }
        k += 1;
    }
    blocks
}

/// The output of a command in a terminal: standard output, then messages.
fn shown(command: &str, folder: &Path) -> String {
    let words: Vec<&str> = command.split_whitespace().collect();
    assert_eq!(words[0], "mesophyll");
    let output = Command::new(env!("CARGO_BIN_EXE_mesophyll")).args(&words[1..]).current_dir(folder).output().unwrap();
    let (out, err) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert!(output.status.success(), "{command}: {err}");
    format!("{out}{err}").trim_end().to_string()
}

/// Words must be the same and numbers must agree, because other processors may give other last digits.
fn same(got: &str, want: &str) -> Result<(), String> {
    let words = |text: &str| text.split([',', ' ', '\n', ';', '%']).map(String::from).collect::<Vec<_>>();
    let (got, want) = (words(got), words(want));
    for (g, w) in got.iter().zip(&want) {
        let close = match (g.parse::<f64>(), w.parse::<f64>()) {
            (Ok(a), Ok(b)) => a == b || (a - b).abs() <= 1e-4 * b.abs() + 1e-9,
            _ => g == w,
        };
        if !close {
            return Err(format!("found {g:?}, the page has {w:?}"));
        }
    }
    if got.len() == want.len() {
        Ok(())
    } else {
        Err(format!("found {} words, the page has {}", got.len(), want.len()))
    }
}

#[test]
fn every_example_prints_what_the_page_says() {
    let folder = tempfile::tempdir().unwrap();
    let (mut page, write) = (page(), std::env::var_os("MESOPHYLL_WRITE_DOCS").is_some());
    let blocks = blocks(&page);
    for block in &blocks {
        if let Kind::File(name) = &block.kind {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, format!("{}\n", block.text)).unwrap();
        }
    }
    let mut new = Vec::new();
    for pair in blocks.windows(2).filter(|pair| pair[0].kind == Kind::Command) {
        let [command, printed] = pair else { unreachable!() };
        assert_eq!(printed.kind, Kind::Printed, "{} is followed by what it prints", command.text);
        let got = shown(&command.text, folder.path());
        if write {
            new.push((printed.line, printed.text.lines().count(), got));
        } else if let Err(why) = same(&got, &printed.text) {
            panic!("{PAGE}: {}: {why}; it printed\n{got}", command.text);
        }
    }
    assert!(blocks.iter().filter(|b| b.kind == Kind::Command).count() >= 12, "the page has an example for every form");
    if write {
        let mut lines: Vec<String> = page.lines().map(String::from).collect();
        for (line, count, text) in new.into_iter().rev() {
            lines.splice(line..line + count, text.lines().map(String::from));
        }
        page = lines.join("\n") + "\n";
        std::fs::write(Path::new(env!("CARGO_MANIFEST_DIR")).join(PAGE), page).unwrap();
    }
}

#[test]
fn the_files_of_the_page_are_those_of_the_repository() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut named = Vec::new();
    for block in blocks(&page()) {
        if let Kind::File(name) = block.kind {
            assert_eq!(std::fs::read_to_string(root.join(&name)).unwrap().trim_end(), block.text, "{name}");
            named.push(name);
        }
    }
    for file in std::fs::read_dir(root.join("data/tables")).unwrap().flatten() {
        let name = format!("data/tables/{}", file.file_name().to_string_lossy());
        assert!(named.contains(&name), "{name} stands on no page");
    }
}

/// The lines of a verb's section.
fn section(page: &str, verb: &str) -> Vec<String> {
    let lines = page.lines().skip_while(|l| *l != format!("## `{verb}`")).skip(1);
    lines.take_while(|l| !l.starts_with("## ")).map(String::from).collect()
}

#[test]
fn every_help_shows_its_section() {
    let page = page();
    let plain = |text: &str| {
        text.replace('`', "").replace('|', " ").replace("**", "").split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let verbs: Vec<&str> =
        page.lines().filter_map(|l| l.strip_prefix("## `")).map(|v| v.trim_end_matches('`')).collect();
    assert!(verbs.len() >= 10, "{verbs:?}");
    for verb in &verbs {
        let output = common::run(verb.split(' ').chain(["--help"]));
        let help = plain(&String::from_utf8(output.stdout).unwrap());
        let lines = section(&page, verb);
        let kept: Vec<String> = lines.into_iter().filter(|l| !l.starts_with("```") && !l.starts_with("|--")).collect();
        let want = plain(&kept.join("\n"));
        assert!(help.contains(&want), "{verb} --help lacks its section of {PAGE}");
    }
    // Every verb that reads a table has a section.
    for group in mesophyll::cli::command().get_subcommands() {
        for verb in group.get_subcommands().filter(|v| v.get_arguments().any(|a| a.get_long() == Some("in"))) {
            let name = format!("{} {}", group.get_name(), verb.get_name());
            assert!(verbs.contains(&name.as_str()), "{name} reads tables and {PAGE} has no section of it");
        }
    }
}

/// Every column of an example's input and output is explained in its section.
#[test]
fn every_column_of_the_examples_is_explained() {
    let page = page();
    for block in blocks(&page) {
        let is_table = match &block.kind {
            Kind::File(name) => name.ends_with(".csv"),
            Kind::Printed => block.text.lines().next().is_some_and(|l| l.ends_with(",status")),
            Kind::Command => false,
        };
        if !is_table {
            continue;
        }
        let rows: Vec<String> = section(&page, &block.verb).into_iter().filter(|l| l.starts_with('|')).collect();
        for column in block.text.lines().next().unwrap().split(',') {
            let named = |name: &str| rows.iter().any(|r| r.contains(&format!("`{name}`")));
            let base = column.strip_suffix("_err").filter(|_| named("_err") || named(column)).unwrap_or(column);
            let is_frame = base.strip_prefix('r').is_some_and(|k| k.parse::<u32>().is_ok());
            let explained = named(base)
                || (is_frame && named("r0"))
                || (base.starts_with("brf") && named("brf..."))
                || (base.starts_with("rho_d_brf") && named("rho_d_NAME"));
            let carried = ["status", "id"].contains(&column) || (column == "leaf" && block.verb == "fit slab");
            assert!(explained || carried, "{}: no word of the column {column}", block.verb);
        }
    }
}
