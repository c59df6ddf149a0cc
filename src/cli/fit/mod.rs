//! `mesophyll fit …`: one file a fit.

use super::Common;
use crate::Result;

pub mod beam;
pub mod gloss;
pub mod leaf;
pub mod sky;
pub mod slab;
pub mod tissue;
pub mod translucency;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, clap::Subcommand)]
enum What {
    /// A leaf scan: reflectance, gloss, normals, interior, thickness and blade
    Leaf(leaf::Args),
    /// Coefficients of a tapered branch, or its taper and stiffness from measured deflections, from CSV
    Beam(beam::Args),
    /// Gloss traces of a linear light source, or goniometer samples, from CSV
    Gloss(gloss::Args),
    /// σa and σs of a slab from its reflectance, transmittance and thickness, from CSV
    Slab(slab::Args),
    /// Polynomials of a sky's spherical harmonics over sun and turbidity; or sun and turbidity from a picture of the
    /// sky
    Sky(sky::Args),
    /// How the light that comes through a leaf depends on its direction: scattering inside the blade, its relief and
    /// thickness
    Translucency(translucency::Args),
    /// What a leaf's inside is made of, from photographs of the light that comes through it
    Tissue(tissue::Args),
}

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    match &args.what {
        What::Leaf(a) => leaf::run(a, common),
        What::Beam(a) => beam::run(a, common),
        What::Gloss(a) => gloss::run(a, common),
        What::Slab(a) => slab::run(a, common),
        What::Sky(a) => sky::run(a, common),
        What::Translucency(a) => translucency::run(a, common),
        What::Tissue(a) => tissue::run(a, common),
    }
}
