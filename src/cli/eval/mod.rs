//! `mesophyll eval …`: one file a model.

use super::Common;
use crate::Result;

pub mod beam;
pub mod dipole;
pub mod gloss;
pub mod panorama;
pub mod sky;
pub mod slab;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, clap::Subcommand)]
enum What {
    /// ρd and ρt of a slab from ω and Δ
    Slab(slab::Args),
    /// Deflection and slope of a tapered branch
    Beam(beam::Args),
    /// Light diffusing through a leaf, by thickness and distance
    Dipole(dipole::Args),
    /// Traces of a linear light source over a glossy texel
    Gloss(gloss::Args),
    /// Spherical harmonics of a sky from the sun's zenith angle and turbidity
    Sky(sky::Args),
    /// A picture of a sky whose sun and turbidity are known, as EXR
    Panorama(panorama::Args),
}

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    match &args.what {
        What::Slab(a) => slab::run(a, common),
        What::Beam(a) => beam::run(a, common),
        What::Dipole(a) => dipole::run(a, common),
        What::Gloss(a) => gloss::run(a, common),
        What::Sky(a) => sky::run(a, common),
        What::Panorama(a) => panorama::run(a, common),
    }
}
