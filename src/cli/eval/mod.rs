//! `mesophyll eval …`: one file a model. The list is [`crate::cli::models::MODELS`].

use super::Common;
use crate::cli::Result;
use crate::cli::models::{Chosen, Model, Offers, Verb};

pub mod abm;
pub mod bands;
pub mod beam;
pub mod canopy;
pub mod dipole;
pub mod fsm;
pub mod gloss;
pub mod panorama;
pub mod sky;
pub mod slab;
pub mod sway;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: Chosen<Evaluations>,
}

/// The models that can be evaluated.
#[derive(Debug, Clone)]
enum Evaluations {}

impl Offers for Evaluations {
    fn verb(model: &Model) -> Option<Verb> {
        model.eval
    }
}

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    args.what.run(common)
}
