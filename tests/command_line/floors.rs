//! The order of the house: which package stands on which, and which folder of a package on which. The compiler refuses
//! a package that uses one above it, so what is read here of packages is only whether the page that shows them is true.
//! Inside a package the compiler allows everything, so the imports are read.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every package of the workspace: its folder, and the packages of the workspace that it uses.
fn packages() -> BTreeMap<String, (PathBuf, BTreeSet<String>)> {
    let read =
        |folder: &Path| -> toml::Table { std::fs::read_to_string(folder.join("Cargo.toml")).unwrap().parse().unwrap() };
    let members = read(root())["workspace"]["members"].as_array().unwrap().clone();
    let folders = members.iter().map(|m| root().join(m.as_str().unwrap())).chain([root().to_path_buf()]);
    folders
        .map(|folder| {
            let table = read(&folder);
            let used = table["dependencies"].as_table().unwrap().keys();
            // The package of the command line is called as the whole.
            let room = |name: &String| match name.as_str() {
                "mesophyll" => Some("mesophyll".to_string()),
                other => other.strip_prefix("mesophyll-").map(String::from),
            };
            let used = used.filter_map(room).collect();
            let name = table["package"]["name"].as_str().unwrap();
            (name.strip_prefix("mesophyll-").unwrap_or(name).to_string(), (folder, used))
        })
        .collect()
}

fn storey(name: &str, packages: &BTreeMap<String, (PathBuf, BTreeSet<String>)>) -> usize {
    packages[name].1.iter().map(|below| storey(below, packages) + 1).max().unwrap_or(0)
}

#[test]
fn the_page_of_rooms_is_what_their_manifests_say() {
    let packages = packages();
    assert!(packages.len() <= 20, "{} packages, expected at most 20", packages.len());
    let mut right: BTreeMap<usize, BTreeSet<&str>> = BTreeMap::new();
    for name in packages.keys() {
        right.entry(storey(name, &packages)).or_default().insert(name);
    }
    let page = std::fs::read_to_string(root().join("src/lib.rs")).unwrap();
    let drawn = page.split("```text\n").nth(1).and_then(|rest| rest.split("//! ```").next()).unwrap();
    let drawn: BTreeMap<usize, BTreeSet<&str>> = drawn
        .lines()
        .map(|line| {
            let line = line.trim_start_matches("//!").split('(').next().unwrap();
            let (floor, rooms) = line.trim().split_once(' ').unwrap();
            (floor.parse().unwrap(), rooms.split_whitespace().collect())
        })
        .collect();
    assert_eq!(drawn, right);
}

/// What lies in a package directly under its own root, from the bottom up. What is on one floor does not use each
/// other; `*` stands for everything that has no floor of its own, and these may use each other.
const FLOORS: [(&str, &[&[&str]]); 7] = [
    (
        "src/base",
        &[&["error", "fourier", "number", "processor", "quadrature", "random"], &["solvers", "surface"], &["*"]],
    ),
    ("src/models/optics", &[&["*"], &["translucency", "walk"]]),
    ("src/models/plants", &[&["mechanics"], &["*"]]),
    ("src/models/transport", &[&["rays"], &["*"]]),
    ("src/measurements/capture", &[&["*"], &["photo"]]),
    (
        "src/fits",
        &[&["record", "rivals"], &["leaf_folder"], &["*", "branch", "grass", "sky", "transfer", "translucency"]],
    ),
    (
        "src/world/scene",
        &[
            &["manifest"],
            &["placed"],
            &["plan"],
            &["loaded"],
            &["world"],
            &["draw"],
            &["path_tracing", "transfer", "window"],
            &["*"],
        ],
    ),
];

fn floor(name: &str, floors: &[&[&str]]) -> (usize, String) {
    let on = |name: &str| floors.iter().position(|f| f.contains(&name));
    on(name).map_or_else(|| (on("*").unwrap(), "*".into()), |k| (k, name.into()))
}

/// What a file uses of its package, by the first names. `depth` is the number of folders that it lies in.
fn used(text: &str, depth: usize) -> BTreeSet<String> {
    // A module inside of a file lies deeper than the file; of these, only tests are written in the file itself.
    let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap();
    let code: String = text.lines().filter(|l| !l.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n");
    // In a file of a folder, `super` is that folder and `super::super` is the package.
    let root = format!("{}::", vec!["super"; depth + 1].join("::"));
    let code = code.replace(&root, "crate::");
    let mut out = BTreeSet::new();
    for (at, found) in code.match_indices("crate::") {
        let rest = &code[at + found.len()..];
        let group = rest.strip_prefix('{').and_then(|g| g.split_once("};")).map_or(rest, |(inside, _)| inside);
        let mut inner = 0;
        let parts = group.split(|c| {
            inner += i32::from(c == '{') - i32::from(c == '}');
            c == ',' && inner == 0
        });
        let count = if rest.starts_with('{') { usize::MAX } else { 1 };
        let names = parts.take(count).map(|p| p.trim().split(|c: char| !c.is_alphanumeric() && c != '_').next());
        out.extend(names.flatten().map(String::from));
    }
    out
}

/// A sentence for every forbidden import in a file of the module `own`.
fn wrong(own: &str, file: &str, text: &str, depth: usize, modules: &[&str], floors: &[&[&str]]) -> Vec<String> {
    let (height, group) = floor(own, floors);
    let above = |name: &String| {
        let (other, its) = floor(name, floors);
        modules.contains(&name.as_str()) && other >= height && its != group
    };
    let found = used(text, depth).into_iter().filter(above);
    found.map(|name| format!("{file} uses {name}, which does not stand below {own}")).collect()
}

/// The Rust files of a folder, with the number of folders that each lies in.
fn files(folder: &Path, depth: usize, out: &mut Vec<(PathBuf, usize)>) {
    for path in std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()) {
        if path.is_dir() {
            files(&path, depth + 1, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            // A folder's own file is one step nearer to the package than the other files in it.
            let own = usize::from(path.ends_with("mod.rs"));
            out.push((path, depth - own));
        }
    }
}

#[test]
fn no_folder_of_a_package_uses_one_above_it() {
    let (mut faults, mut read) = (Vec::new(), 0);
    for (package, floors) in FLOORS {
        let root = root().join(package);
        let stem = |p: &Path| p.file_stem().unwrap().to_string_lossy().into_owned();
        let entries: Vec<PathBuf> = std::fs::read_dir(&root).unwrap().map(|e| e.unwrap().path()).collect();
        let modules: BTreeSet<String> = entries
            .iter()
            .filter(|p| p.join("mod.rs").exists() || p.extension().is_some_and(|e| e == "rs"))
            .map(|p| stem(p))
            .filter(|name| name != "lib")
            .collect();
        for name in floors.iter().flat_map(|f| f.iter()).filter(|name| **name != "*") {
            assert!(modules.contains(*name), "{package} has no {name}");
        }
        let modules: Vec<&str> = modules.iter().map(String::as_str).collect();
        for entry in entries.iter().filter(|p| modules.contains(&stem(p).as_str())) {
            let mut all = Vec::new();
            if entry.is_dir() {
                files(entry, 1, &mut all)
            } else {
                all.push((entry.clone(), 0))
            }
            for (path, depth) in all {
                let text = std::fs::read_to_string(&path).unwrap();
                faults.extend(wrong(&stem(entry), &path.display().to_string(), &text, depth, &modules, floors));
                read += 1;
            }
        }
    }
    assert!(read > 400, "only {read} files were read");
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// The things that stand in the world are built upon the fits, and not the other way round.
#[test]
fn fits_use_nothing_of_what_is_placed() {
    let mut all = Vec::new();
    files(&root().join("src/world/scene/placed/fits"), 2, &mut all);
    assert!(all.len() > 3, "only {} files were read", all.len());
    for (path, _) in all {
        let text = std::fs::read_to_string(&path).unwrap();
        let other = text.lines().filter(|l| !l.trim_start().starts_with("//")).find(|line| {
            line.match_indices("crate::placed::").any(|(at, found)| {
                let rest = &line[at + found.len()..];
                !["fits", "ledger", "Error", "Result", "{Error", "{Result"].iter().any(|n| rest.starts_with(n))
            })
        });
        assert!(other.is_none(), "{} uses {other:?}", path.display());
    }
}

#[test]
fn an_import_from_above_is_found_however_it_is_written() {
    let floors = FLOORS[6].1;
    let modules = ["manifest", "placed", "plan", "loaded", "draw", "path_tracing", "window", "film"];
    for text in [
        "use crate::draw::card;",
        "    let world = crate::draw::reference::world();",
        "use crate::{Error, film::Length, draw::{card, sunlight}};",
        "use super::super::draw::card;",
    ] {
        assert!(!wrong("plan", "a.rs", text, 1, &modules, floors).is_empty(), "{text}");
        assert!(wrong("film", "a.rs", text, 1, &modules, floors).is_empty(), "{text}");
    }
    assert_eq!(wrong("window", "a.rs", "use crate::path_tracing::render;", 1, &modules, floors).len(), 1);
    // In the file of the folder itself, one `super` is the package; in a file beside it, it is the folder.
    assert_eq!(wrong("plan", "mod.rs", "use super::draw::card;", 0, &modules, floors).len(), 1);
    assert!(wrong("plan", "a.rs", "use super::draw::card;", 1, &modules, floors).is_empty());
}
