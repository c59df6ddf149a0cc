//! What holds for the whole command line.

use super::*;

/// Every verb, with the verbs inside `fit` and `eval`, by its whole name.
fn verbs() -> Vec<(String, clap::Command)> {
    fn below(name: &str, verb: &clap::Command, all: &mut Vec<(String, clap::Command)>) {
        for sub in verb.get_subcommands() {
            let name = format!("{name} {}", sub.get_name());
            below(&name, sub, all);
            all.push((name, sub.clone()));
        }
    }
    let (mut all, mut command) = (Vec::new(), command());
    command.build();
    below("mesophyll", &command, &mut all);
    all
}

#[test]
fn every_verb_stands_in_one_group_of_the_help() {
    let command = command();
    let mut grouped: Vec<&str> = GROUPS.iter().flat_map(|(_, verbs)| verbs.iter().copied()).collect();
    let mut verbs: Vec<&str> = command.get_subcommands().map(clap::Command::get_name).chain(["help"]).collect();
    grouped.sort_unstable();
    verbs.sort_unstable();
    assert_eq!(grouped, verbs);
}

/// Outputs are named by `-o, --out` everywhere; `--output` is understood and shown nowhere.
#[test]
fn one_spelling_names_the_output() {
    let mut seen = 0;
    for (name, verb) in verbs() {
        for arg in verb.get_arguments() {
            let outputs =
                arg.get_long() == Some("out") || arg.get_short() == Some('o') || arg.get_long() == Some("output");
            if outputs {
                assert_eq!((arg.get_short(), arg.get_long()), (Some('o'), Some("out")), "{name}");
                assert_eq!(arg.get_all_aliases(), Some(vec!["output"]), "{name}");
                assert!(arg.get_visible_aliases().unwrap_or_default().is_empty(), "{name}");
                seen += 1;
            }
        }
    }
    assert!(seen >= 20, "{seen} verbs write");
}

/// The examples in help texts are accepted as they stand.
#[test]
fn examples_of_the_help_are_accepted() {
    let mut seen = 0;
    for (name, verb) in verbs() {
        // The texts themselves are checked, because long lines are broken when a help is printed.
        let texts = [verb.get_after_help(), verb.get_after_long_help()].into_iter().flatten();
        let help = texts.map(|text| format!("{text}\n")).collect::<String>();
        for line in help.lines().filter_map(|l| l.strip_prefix("  mesophyll ")) {
            // Three blanks begin a remark, `&&` the next command.
            for part in line.split("   ").next().unwrap_or_default().split("&& mesophyll ") {
                let words = std::iter::once("mesophyll").chain(part.split_whitespace());
                let parsed = Cli::try_parse_from(words);
                assert!(parsed.is_ok(), "{name}: {part}: {}", parsed.err().map_or_else(String::new, |e| e.to_string()));
                seen += 1;
            }
        }
    }
    assert!(seen >= 30, "{seen} examples");
}

#[test]
fn slips_are_answered_with_what_was_meant() {
    for (words, meant) in [
        (&["exprt"][..], "export"),
        (&["fit", "slap"], "slab"),
        (&["export", "fits/elm", "--to", "glft", "-o", "x"], "gltf"),
        (&["stress", "coverag"], "coverage"),
        (&["bench", "translucenci"], "translucency"),
        (&["eval", "sky", "--metod", "direct"], "--method"),
    ] {
        let error = Cli::try_parse_from(std::iter::once(&"mesophyll").chain(words)).expect_err("a slip").to_string();
        assert!(error.contains("similar") && error.contains(meant), "{words:?}: {error}");
    }
    for alias in ["gltf", "glb"] {
        assert!(Cli::try_parse_from(["mesophyll", "export", "fits/elm", "--to", alias, "-o", "x"]).is_ok());
    }
    // A folder cannot go to standard output.
    for words in [
        &["fit", "leaf", "scan", "-o", "-"][..],
        &["run", "scene.toml", "--out", "-"],
        &["synth", "leaf.toml", "--output", "-"],
    ] {
        let error = Cli::try_parse_from(std::iter::once(&"mesophyll").chain(words)).expect_err("no folder").to_string();
        assert!(error.contains("a folder is written"), "{words:?}: {error}");
    }
}
