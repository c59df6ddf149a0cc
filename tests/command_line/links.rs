//! Links between pages: every relative link of the README and of the book leads to a file that exists.

use std::path::{Path, PathBuf};

/// Targets of the links and pictures of a page, without those that lead elsewhere or stay on the page.
fn links(page: &str) -> impl Iterator<Item = &str> {
    page.split("](").skip(1).filter_map(|rest| rest.split([')', ' ']).next()).filter_map(|target| {
        let file = target.split('#').next()?;
        (!file.is_empty() && !target.contains("://") && !target.starts_with("mailto:")).then_some(file)
    })
}

#[test]
fn every_relative_link_leads_to_a_file() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut pages: Vec<PathBuf> = vec![root.join("README.md"), root.join("data/README.md")];
    for folder in ["docs", "data/scenes", "data/plants", "data/grass", "tests/peers"] {
        let files = std::fs::read_dir(root.join(folder)).unwrap().flatten().map(|f| f.path());
        pages.extend(files.filter(|f| f.extension().is_some_and(|e| e == "md")));
    }
    let (mut followed, mut lost) = (0, Vec::new());
    for page in &pages {
        for link in links(&std::fs::read_to_string(page).unwrap()) {
            followed += 1;
            if !page.parent().unwrap().join(link).exists() {
                lost.push(format!("{}: {link}", page.strip_prefix(root).unwrap().display()));
            }
        }
    }
    println!("{followed} links on {} pages", pages.len());
    assert!(lost.is_empty(), "links that lead nowhere:\n{}", lost.join("\n"));
    assert!(followed > 100, "only {followed} links were found");
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
