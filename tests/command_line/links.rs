//! Links between pages: every relative link of the README and of the book leads to a file that exists, and to a heading
//! that this file has. Every page of the book stands in its summary.

use std::path::{Path, PathBuf};

/// Targets of the links and pictures of a page, as file and heading, without those that lead elsewhere.
fn links(page: &str) -> impl Iterator<Item = (&str, &str)> {
    page.split("](").skip(1).filter_map(|rest| rest.split([')', ' ']).next()).filter_map(|target| {
        let leads_here = !target.contains("://") && !target.starts_with("mailto:");
        leads_here.then(|| target.split_once('#').unwrap_or((target, "")))
    })
}

/// The name that a link gives to a heading: lower case, words joined by `-`, without other signs.
fn heading(text: &str) -> String {
    let kept = text.trim().chars().filter(|c| c.is_alphanumeric() || c.is_whitespace() || ['-', '_'].contains(c));
    kept.map(|c| if c.is_whitespace() { '-' } else { c }).flat_map(char::to_lowercase).collect()
}

/// Names of the headings of a page, without the lines of its blocks of code.
fn headings(page: &str) -> Vec<String> {
    let text = page.split("\n```").step_by(2).flat_map(str::lines);
    text.filter_map(|l| l.trim_start_matches('#').strip_prefix(' ').filter(|_| l.starts_with('#')))
        .map(heading)
        .collect()
}

fn pages(folders: &[&str]) -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let files = |folder: &&str| std::fs::read_dir(root.join(folder)).unwrap().flatten().map(|f| f.path());
    folders.iter().flat_map(files).filter(|f| f.extension().is_some_and(|e| e == "md")).collect()
}

#[test]
fn every_relative_link_leads_to_a_file() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut pages = pages(&["docs", "docs/evidence", "data/scenes", "data/plants", "data/grass", "tests/peers"]);
    pages.extend([root.join("README.md"), root.join("data/README.md")]);
    let (mut followed, mut to_headings, mut lost) = (0, 0, Vec::new());
    for page in &pages {
        for (file, part) in links(&std::fs::read_to_string(page).unwrap()) {
            followed += 1;
            let there = if file.is_empty() { page.clone() } else { page.parent().unwrap().join(file) };
            let mut found = there.exists();
            if found && !part.is_empty() && there.extension().is_some_and(|e| e == "md") {
                to_headings += 1;
                found = headings(&std::fs::read_to_string(&there).unwrap()).iter().any(|h| h == part);
            }
            if !found {
                lost.push(format!("{}: {file}#{part}", page.strip_prefix(root).unwrap().display()));
            }
        }
    }
    println!("{followed} links on {} pages, {to_headings} to headings", pages.len());
    assert!(lost.is_empty(), "links that lead nowhere:\n{}", lost.join("\n"));
    assert!(followed > 100 && to_headings > 50, "only {followed} links were found, {to_headings} to headings");
}

#[test]
fn every_page_stands_in_the_summary_once() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    let summary = std::fs::read_to_string(docs.join("SUMMARY.md")).unwrap();
    for page in pages(&["docs", "docs/evidence"]).iter().filter(|p| !p.ends_with("SUMMARY.md")) {
        let name = page.strip_prefix(&docs).unwrap().to_string_lossy().replace('\\', "/");
        assert_eq!(links(&summary).filter(|(file, _)| *file == name).count(), 1, "{name} in docs/SUMMARY.md");
    }
}

/// The book without its evidence is short enough to be read. Signs that draw a table are no words. The list of others'
/// licences, which a program makes, the table of contents, and the list of the code's types do not count.
#[test]
fn the_book_is_short() {
    let words = |page: &PathBuf| {
        let text = std::fs::read_to_string(page).unwrap();
        text.split_whitespace().filter(|w| w.chars().any(|c| !['|', '-', '#', ':'].contains(&c))).count()
    };
    let left_out = ["third-party.md", "SUMMARY.md", "words.md"];
    let counted = |page: &&PathBuf| !left_out.iter().any(|name| page.ends_with(name));
    let book: usize = pages(&["docs"]).iter().filter(counted).map(words).sum();
    println!("{book} words");
    assert!(book <= 35_000, "{book} words, expected at most 35,000; what was measured belongs to docs/evidence");
}

/// The page of third parties names only packages that the lock file has, and holds the licences that ask to be shown.
#[test]
fn notices_of_third_parties_are_those_of_the_packages() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = std::fs::read_to_string(root.join("docs/third-party.md")).unwrap();
    let lock: toml::Table = std::fs::read_to_string(root.join("Cargo.lock")).unwrap().parse().unwrap();
    let packages = lock["package"].as_array().unwrap();
    let known = |name: &str, version: &str| {
        packages.iter().any(|p| p["name"].as_str() == Some(name) && p["version"].as_str() == Some(version))
    };
    let rows: Vec<[&str; 2]> = page
        .lines()
        .filter_map(|line| line.strip_prefix("| [")?.split_once("](").map(|(name, rest)| [name, rest]))
        .filter_map(|[name, rest]| Some([name, rest.split(" | ").nth(1)?]))
        .collect();
    let stale: Vec<&[&str; 2]> = rows.iter().filter(|[name, version]| !known(name, version)).collect();
    assert!(rows.len() > 200 && stale.is_empty(), "{} rows; run `make notices`: {stale:?}", rows.len());
    for text in ["SIL OPEN FONT LICENSE", "UBUNTU FONT LICENCE", "Neither the name of", "hw-skymodel"] {
        assert!(page.contains(text), "{text} is missing");
    }
}
