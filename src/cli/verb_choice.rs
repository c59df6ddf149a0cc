//! The verbs inside `fit`, `eval` and `design`: those that the list of models has, and the one that was chosen.

use crate::cli::models::{ModelEntry, ModelVerb, with};
use crate::cli::{CommonArgs, Result};
use clap::{ArgMatches, Command, FromArgMatches};
use std::marker::PhantomData;

/// Which verbs a command offers: those of `fit`, of `eval` or of `design`.
pub trait VerbCatalogue {
    fn verb(model: &ModelEntry) -> Option<ModelVerb>;
}

/// The verb that was chosen, and its arguments.
#[derive(Debug, Clone)]
pub struct VerbChoice<O> {
    verb: ModelVerb,
    matches: ArgMatches,
    of: PhantomData<O>,
}

impl<O: VerbCatalogue> VerbChoice<O> {
    pub fn run(&self, common: &CommonArgs) -> Result<u8> {
        (self.verb.run)(&self.matches, common)
    }
}

impl<O: VerbCatalogue> FromArgMatches for VerbChoice<O> {
    fn from_arg_matches(matches: &ArgMatches) -> clap::error::Result<Self> {
        let missing = || clap::Error::new(clap::error::ErrorKind::MissingSubcommand);
        let (name, matches) = matches.subcommand().ok_or_else(missing)?;
        let (_, verb) = with(O::verb).find(|(n, _)| *n == name).ok_or_else(missing)?;
        Ok(VerbChoice { verb, matches: matches.clone(), of: PhantomData })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> clap::error::Result<()> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl<O: VerbCatalogue> clap::Subcommand for VerbChoice<O> {
    fn augment_subcommands(command: Command) -> Command {
        let add = |command: Command, (name, verb): (&'static str, ModelVerb)| {
            command.subcommand((verb.arguments)(Command::new(name)).about(verb.about).long_about(None))
        };
        with(O::verb).fold(command.subcommand_required(true).arg_required_else_help(true), add)
    }

    fn augment_subcommands_for_update(command: Command) -> Command {
        Self::augment_subcommands(command)
    }

    fn has_subcommand(name: &str) -> bool {
        with(O::verb).any(|(n, _)| n == name)
    }
}
