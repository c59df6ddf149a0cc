//! The list of models, and the page that says how one is added.

use super::*;

#[test]
fn every_model_has_a_name_of_its_own_and_something_to_do() {
    for (k, model) in MODELS.iter().enumerate() {
        let verbs = [model.fit.is_some(), model.eval.is_some(), model.bench.is_some(), model.stress.is_some()];
        assert!(verbs.contains(&true), "{}", model.name);
        assert!(MODELS[..k].iter().all(|other| other.name != model.name), "{} is there twice", model.name);
    }
}

#[test]
fn what_is_asked_for_comes_once_and_in_the_order_asked() {
    let names = |asked_for: &[&str]| -> Vec<&str> {
        let words: Vec<String> = asked_for.iter().map(|w| w.to_string()).collect();
        asked(&words, |m| m.stress).into_iter().map(|(name, _)| name).collect()
    };
    assert_eq!(names(&["sky", "nist", "sky"]), ["sky", "nist"]);
    assert!(names(&[]).is_empty());
    assert_eq!(names(&["sky", "all"]).len(), with(|m| m.stress).count());
}

/// The page that says what a new model touches names files that are there.
#[test]
fn the_files_of_the_page_are_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(".");
    let page = std::fs::read_to_string(root.join("docs/adding.md")).unwrap();
    let mut seen = 0;
    for line in page.lines() {
        for (k, path) in line.split('`').enumerate().filter(|(k, _)| k % 2 == 1) {
            let rooms = ["src/", "docs/", "data/", "viewer/", "tests/"];
            let after = line.split('`').skip(k + 1).collect::<String>();
            if rooms.iter().any(|room| path.starts_with(room)) && !after.contains("(new)") {
                assert!(root.join(path).exists(), "{path} of docs/adding.md is not there");
                seen += 1;
            }
        }
    }
    assert!(seen >= 15, "{seen} paths");
}
