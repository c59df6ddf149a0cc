//! `mesophyll man [VERB…]`: the manual page of the program or of one of its verbs, for `man -l -`.

use crate::cli::Result;
use mesophyll_base::error::Error;
use std::io::{IsTerminal, Write};
use std::process::{Command, Stdio};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  mesophyll man
  mesophyll man fit slab
  mesophyll man glossary     words and signs of the help and the reports

In a terminal the page is shown by `man`, where that is there. To keep it, write it into a file:
`> mesophyll-fit-slab.1`.")]
pub struct Args {
    /// The verb, and what follows it: `fit slab`; without one, the page of the whole program. `glossary`: what words
    /// and signs mean
    #[arg(value_name = "VERB")]
    verb: Vec<String>,
}

pub fn run(args: &Args) -> Result<u8> {
    if args.verb == ["glossary"] {
        let page = mesophyll_report::glossary::page();
        super::print(&format!("{}\n", super::tables::plain(&page.lines().collect::<Vec<_>>())))?;
        return Ok(0);
    }
    let mut page = Vec::new();
    clap_mangen::Man::new(of(&args.verb)?).render(&mut page).map_err(|e| Error::Usage(format!("man: {e}")))?;
    if !(std::io::stdout().is_terminal() && shown(&page)) {
        super::print(&String::from_utf8_lossy(&page))?;
    }
    Ok(0)
}

/// Whether the system's `man` could show the page.
fn shown(page: &[u8]) -> bool {
    let man = Command::new("man").args(["-l", "-"]).stdin(Stdio::piped()).spawn();
    let Ok(mut man) = man else { return false };
    // A reader that quits early has seen enough.
    let _ = man.stdin.take().map(|mut to| to.write_all(page));
    man.wait().is_ok_and(|status| status.success())
}

/// The command that `verb` names, called as pages are: `mesophyll-fit-slab`.
fn of(verb: &[String]) -> Result<clap::Command> {
    let mut command = super::command().disable_help_subcommand(true);
    // Options that every verb has are handed down to the verbs only here.
    command.build();
    let mut found = &command;
    for word in verb {
        found = found.find_subcommand(word).ok_or_else(|| {
            Error::Usage(format!("man: `{}` has no verb `{word}`", found.get_bin_name().unwrap_or("mesophyll")))
        })?;
    }
    let called = found.get_bin_name().unwrap_or("mesophyll").to_string();
    Ok(found.clone().display_name(called.replace(' ', "-")).bin_name(called))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(verb: &[&str]) -> String {
        let verb: Vec<String> = verb.iter().map(|v| v.to_string()).collect();
        let mut page = Vec::new();
        clap_mangen::Man::new(of(&verb).unwrap()).render(&mut page).unwrap();
        String::from_utf8(page).unwrap()
    }

    #[test]
    fn the_page_of_the_program_names_every_verb_and_a_verbs_page_its_options() {
        let whole = page(&[]);
        for verb in super::super::command().get_subcommands() {
            assert!(whole.contains(&format!("mesophyll\\-{}(1)", verb.get_name())), "{}", verb.get_name());
        }
        let slab = page(&["fit", "slab"]);
        assert!(slab.contains(".TH mesophyll-fit-slab 1"), "{slab}");
        assert!(slab.contains("mesophyll fit slab"), "{slab}");
        // An option of the verb, and one that all verbs have.
        assert!(slab.contains("\\-\\-noise") && slab.contains("\\-\\-quiet"), "{slab}");
    }

    #[test]
    fn an_unknown_verb_is_named() {
        let e = of(&["fit".to_string(), "wool".to_string()]).unwrap_err();
        assert_eq!(e.to_string(), "man: `mesophyll fit` has no verb `wool`");
    }
}
