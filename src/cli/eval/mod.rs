//! `mesophyll eval …`: one file a model. The list is [`crate::cli::models::MODELS`].

use super::CommonArgs;
use crate::cli::Result;
use crate::cli::models::{ModelEntry, ModelVerb};
use crate::cli::verb_choice::{VerbCatalogue, VerbChoice};

pub mod abm;
pub mod bands;
mod bands_response;
pub mod beam;
pub mod canopy;
mod canopy_bands;
pub mod dipole;
pub mod fsm;
pub mod gloss;
pub mod panorama;
pub mod sky;
pub mod slab;
pub mod sun;
pub mod sway;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: VerbChoice<Evaluations>,
}

/// The models that can be evaluated.
#[derive(Debug, Clone)]
enum Evaluations {}

impl VerbCatalogue for Evaluations {
    fn verb(model: &ModelEntry) -> Option<ModelVerb> {
        model.eval
    }
}

pub fn run(args: &Args, common: &CommonArgs) -> Result<u8> {
    args.what.run(common)
}
