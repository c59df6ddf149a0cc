//! Licences of the code of others: every package that is linked comes from a registry, under a licence that `deny.toml`
//! allows. `cargo deny check` reads the same file, and looks for known faults too.

use std::path::Path;
use std::process::Command;

/// Whether an expression such as `(MIT OR Apache-2.0) AND Unicode-3.0` can be met with the licences `allowed`.
fn is_met(expression: &str, allowed: &[String]) -> bool {
    // Older packages write `/` for OR. No name of a licence has a blank but those with an exception.
    let spaced = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ");
    let spaced = spaced.replace(" WITH ", "+WITH+");
    let words: Vec<String> = spaced.split_whitespace().map(|w| w.replace("+WITH+", " WITH ")).collect();
    let (met, rest) = any(&words, allowed);
    assert!(rest.is_empty(), "{expression}: {rest:?} is left");
    met
}

/// One or more terms joined by OR, and what follows them.
fn any<'a>(words: &'a [String], allowed: &[String]) -> (bool, &'a [String]) {
    let (mut met, mut rest) = all(words, allowed);
    while rest.first().is_some_and(|w| w == "OR") {
        let (other, left) = all(&rest[1..], allowed);
        (met, rest) = (met || other, left);
    }
    (met, rest)
}

/// One or more names or groups joined by AND, and what follows them.
fn all<'a>(words: &'a [String], allowed: &[String]) -> (bool, &'a [String]) {
    let one = |words: &'a [String]| -> (bool, &'a [String]) {
        if words[0] == "(" {
            let (met, rest) = any(&words[1..], allowed);
            assert_eq!(rest[0], ")");
            return (met, &rest[1..]);
        }
        (allowed.contains(&words[0]), &words[1..])
    };
    let (mut met, mut rest) = one(words);
    while rest.first().is_some_and(|w| w == "AND") {
        let (other, left) = one(&rest[1..]);
        (met, rest) = (met && other, left);
    }
    (met, rest)
}

#[test]
fn expressions_are_read_as_they_are_meant() {
    let allowed = ["MIT", "Apache-2.0 WITH LLVM-exception", "Unicode-3.0"].map(String::from);
    for met in ["MIT", "MIT OR GPL-2.0-only", "GPL-3.0/MIT", "(MIT OR Apache-2.0) AND Unicode-3.0"] {
        assert!(is_met(met, &allowed), "{met}");
    }
    assert!(is_met("Apache-2.0 WITH LLVM-exception OR Apache-2.0", &allowed));
    for missed in ["GPL-2.0-only", "MIT AND OFL-1.1", "Apache-2.0", "MIT AND (OFL-1.1 OR Zlib)"] {
        assert!(!is_met(missed, &allowed), "{missed}");
    }
}

#[test]
fn every_licence_is_allowed_and_every_package_comes_from_a_registry() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let deny: toml::Table = toml::from_str(&std::fs::read_to_string(root.join("deny.toml")).unwrap()).unwrap();
    let allowed: Vec<String> = deny["licenses"]["allow"].clone().try_into().unwrap();
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".into());
    let output = Command::new(cargo)
        .args(["metadata", "--locked", "--offline", "--format-version", "1", "--filter-platform"])
        .arg(format!("{}-unknown-linux-gnu", std::env::consts::ARCH))
        .current_dir(root)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    let ours = metadata["workspace_members"].as_array().unwrap();
    let others: Vec<_> = packages.iter().filter(|p| !ours.contains(&p["id"])).collect();
    assert!(others.len() > 200, "only {} packages", others.len());
    for package in others {
        let (name, licence) = (&package["name"], package["license"].as_str().unwrap_or_default());
        assert!(is_met(licence, &allowed), "{name} has the licence {licence:?}; deny.toml does not allow it");
        let source = package["source"].as_str().unwrap_or_default();
        assert!(source.starts_with("registry+") || source.starts_with("sparse+"), "{name} comes from {source:?}");
    }
}
