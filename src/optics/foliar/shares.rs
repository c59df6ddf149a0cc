//! How much light a leaf of layers reflects and lets through, by either method: what `eval abm` prints a row.

use super::{Leaf, Oblateness, Path, Side, exact, walk};

/// How the shares are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Random rays, 1 or more. Leaves differ in their noise, and a leaf has the same noise wherever it stands.
    MonteCarlo {
        /// How many rays.
        rays: u64,
        /// Seed of the random numbers.
        seed: u64,
    },
    /// The equation that the mean of all rays obeys: no noise, 2e-5.
    Exact,
}

/// Reflectance and transmittance, each with its standard error (0 with [`Method::Exact`]), for light that arrives
/// `incidence` radians off the normal. Once `stop` says so no further rays are followed.
///
/// # Errors
/// A sentence where the exact method does not settle.
pub fn shares(
    leaf: &Leaf,
    side: Side,
    incidence: f64,
    method: Method,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<[(f64, f64); 2], String> {
    match method {
        Method::Exact => {
            let found = exact::response(leaf, side, incidence).ok_or_else(unsettled)?;
            Ok([(found.reflectance, 0.0), (found.transmittance, 0.0)])
        }
        Method::MonteCarlo { rays, seed } => {
            let counts = walk::count(leaf, side, incidence, rays, own_seed(seed, leaf, side, incidence), stop);
            Ok([counts.share(counts.reflected), counts.share(counts.transmitted)])
        }
    }
}

/// What the exact method answers where its nodes cannot follow the lobes.
pub fn unsettled() -> String {
    "the exact method does not settle to 2e-5 for lobes this narrow or indices this close; use --method monte-carlo"
        .into()
}

/// A seed for each case, so that cases differ in their noise and a case has the same wherever it stands.
pub fn own_seed(seed: u64, leaf: &Leaf, side: Side, incidence: f64) -> u64 {
    let Oblateness { cuticle, epidermis, palisade, spongy } = leaf.oblateness;
    let numbers =
        [leaf.depth, leaf.n_cuticle, leaf.n_mesophyll, leaf.n_antidermal, cuticle, epidermis, palisade, spongy];
    let words = [incidence.to_bits(), (side == Side::Adaxial).into(), (leaf.path == Path::Slant).into()];
    // FNV-1a over the words
    let mix = |h: u64, x: u64| (h ^ x).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(29);
    numbers.map(f64::to_bits).into_iter().chain(words).fold(mix(0xcbf2_9ce4_8422_2325, seed), mix)
}
