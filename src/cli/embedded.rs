//! The verbs inside another program, which goes on when one has ended. The Python package calls them.

use super::{Cli, Verb, dispatch, numbers};
use crate::cli::{Error, Result};
use mesophyll_files::{progress, standard_output};
use std::sync::{Mutex, PoisonError};

/// What a verb answered.
#[derive(Debug)]
pub struct VerbAnswer {
    /// The exit code that the program would have: 0 done, 1 missed; or why there is no answer.
    pub outcome: Result<u8>,
    /// What it printed on standard output.
    pub printed: Vec<u8>,
    /// What it said on standard error, besides progress.
    pub said: Vec<String>,
}

/// Does what the command line does with these words (`["fit", "slab", "--in", …]`), and hands over what it prints. One
/// verb runs at a time, others wait. The worker threads are those of the calling program, and so is Ctrl-C: a stop is
/// asked for by [`progress::request_stop`].
pub fn answer(words: &[String]) -> VerbAnswer {
    static ONE: Mutex<()> = Mutex::new(());
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    // What was asked to stop while it waited does not begin.
    let cli = progress::go_on().and_then(|()| read(words));
    progress::listen();
    standard_output::keep();
    let outcome = cli.and_then(|cli| {
        let _verb = progress::TaskProgress::of(cli.verb.name());
        dispatch(&cli)
    });
    VerbAnswer { outcome, printed: standard_output::take(), said: progress::heard() }
}

/// The command that the words are.
fn read(words: &[String]) -> Result<Cli> {
    let all = std::iter::once("mesophyll").chain(words.iter().map(String::as_str));
    let cli = numbers::read(all).map_err(|e| Error::Usage(sentence(&e.render().to_string())))?;
    if cli.common.threads.is_some() {
        return Err(Error::Usage("--threads: the threads are those of the program that calls this one".into()));
    }
    if matches!(cli.verb, Verb::View(_)) {
        return Err(Error::Usage("view: a window is opened by the command line and not inside another program".into()));
    }
    Ok(cli)
}

/// What clap says of wrong words, without the usage below it, in one line.
fn sentence(text: &str) -> String {
    let lines = text.lines().take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more"));
    let parts: Vec<&str> = lines.map(str::trim).filter(|line| !line.is_empty()).collect();
    let said = parts.join("; ");
    said.strip_prefix("error: ").unwrap_or(&said).replace(":; ", ": ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<String> {
        text.split(' ').map(String::from).collect()
    }

    #[test]
    fn a_verb_answers_without_the_process() {
        let folder = tempfile::tempdir().unwrap();
        let table = folder.path().join("tapers.csv");
        std::fs::write(&table, "alpha,x\n1,1\n2,1\n").unwrap();
        let asked = format!("eval beam --in {}", table.display());
        let answer = answer(&words(&asked));
        assert_eq!(answer.outcome, Ok(0));
        let printed = String::from_utf8(answer.printed).unwrap();
        let lines: Vec<&str> = printed.lines().collect();
        assert_eq!(lines[0], "alpha,x,u,du,status");
        // A beam of even radius under an even load bends by F L³/(8 E I), with I = π r⁴/4.
        let bent: f64 = lines[1].split(',').nth(2).unwrap().parse().unwrap();
        assert!((bent - 0.5 / std::f64::consts::PI).abs() < 1e-12, "{printed}");
        assert!(lines[2].contains("refused: alpha is 2"), "{printed}");
        assert!(answer.said.contains(&"2 rows: 1 ok, 0 undetermined, 1 refused".into()), "{:?}", answer.said);
    }

    #[test]
    fn wrong_words_are_one_sentence() {
        for (asked, meant) in [
            ("eval beam --inn x.csv", "unexpected argument '--inn' found; tip: a similar argument exists: '--in'"),
            ("fit slap", "unrecognized subcommand 'slap'; tip: a similar subcommand exists: 'slab'"),
            ("view leaf.toml", "view: a window is opened by the command line and not inside another program"),
            ("--threads 3 fit beam", "--threads: the threads are those of the program that calls this one"),
        ] {
            let answer = answer(&words(asked));
            assert_eq!(answer.outcome, Err(Error::Usage(meant.into())));
            assert!(answer.printed.is_empty() && answer.said.is_empty());
        }
    }
}
