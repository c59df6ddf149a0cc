//! How much light a layered leaf reflects and lets through, by either method: one row of what `eval abm` prints.

use super::{LayeredLeaf, MesophyllPath, Oblateness, Side, exact, walk};

/// How the shares are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::EnumDiscriminants)]
#[strum_discriminants(
    name(MethodKind),
    doc = "The name of a [`Method`].",
    derive(strum::Display, strum::EnumString, strum::EnumIter, strum::IntoStaticStr, strum::EnumMessage),
    strum(serialize_all = "kebab-case")
)]
pub enum FoliarMethod {
    /// Random rays, at least 1. Different leaves have different noise, but a leaf has the same noise in every row.
    MonteCarlo {
        /// How many rays.
        rays: u64,
        /// Seed of the random numbers.
        seed: u64,
    },
    /// The equation that the mean of all rays obeys. It has no noise; its error is below 2e-5.
    Exact,
}

/// Reflectance and transmittance, each with its standard error (0 with [`FoliarMethod::Exact`]), for light that arrives
/// `incidence` radians off the normal. When `stop` returns true, no further rays are followed.
///
/// # Errors
/// A sentence where the exact method does not converge.
pub fn shares(
    leaf: &LayeredLeaf,
    side: Side,
    incidence: f64,
    method: FoliarMethod,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<[(f64, f64); 2], String> {
    match method {
        FoliarMethod::Exact => {
            let found = exact::response(leaf, side, incidence).ok_or_else(unsettled)?;
            Ok([(found.reflectance, 0.0), (found.transmittance, 0.0)])
        }
        FoliarMethod::MonteCarlo { rays, seed } => {
            let counts = walk::count(leaf, side, incidence, rays, own_seed(seed, leaf, side, incidence), stop);
            Ok([counts.share(counts.reflected), counts.share(counts.transmitted)])
        }
    }
}

/// The sentence for cases where the exact method's nodes are too coarse for the lobes.
pub fn unsettled() -> String {
    "the exact method does not settle to 2e-5 for lobes this narrow or indices this close; use --method monte-carlo"
        .into()
}

/// A seed for each case, so that different cases have different noise, and the same case has the same noise in every
/// row.
pub fn own_seed(seed: u64, leaf: &LayeredLeaf, side: Side, incidence: f64) -> u64 {
    let Oblateness { cuticle, epidermis, palisade, spongy } = leaf.oblateness;
    let numbers =
        [leaf.depth, leaf.n_cuticle, leaf.n_mesophyll, leaf.n_antidermal, cuticle, epidermis, palisade, spongy];
    let words = [incidence.to_bits(), (side == Side::Front).into(), (leaf.path == MesophyllPath::Slant).into()];
    // FNV-1a over the words
    let mix = |h: u64, x: u64| (h ^ x).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(29);
    numbers.map(f64::to_bits).into_iter().chain(words).fold(mix(0xcbf2_9ce4_8422_2325, seed), mix)
}
