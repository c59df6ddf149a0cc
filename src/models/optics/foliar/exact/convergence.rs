//! Answers that are known to be right to 2e-5: the equation is solved on finer and finer nodes until two solutions
//! agree. Leaves with wide lobes need no such search.

use super::{LeafOperator, Resolution};
use crate::foliar::{LayeredLeaf, LeafResponse, Oblateness, Side};
use crate::number::{Dual, Scalar};

/// Reflectance and transmittance of light at `incidence` (radians from the normal, 0 to π/2) onto `side`, to 2e-5;
/// `None` where the method does not settle to that.
pub fn response(leaf: &LayeredLeaf, side: Side, incidence: f64) -> Option<LeafResponse> {
    responses(leaf, &[(side, incidence)])?.first().copied()
}

/// The same for light of several sides and angles.
pub fn responses(leaf: &LayeredLeaf, lights: &[(Side, f64)]) -> Option<Vec<LeafResponse>> {
    if straight(leaf) {
        let one = |&(side, at): &(Side, f64)| LeafOperator::straight(leaf, at).solve(leaf.depth).response(side, at);
        return Some(lights.iter().map(one).collect());
    }
    let prepared = prepared(leaf, &[leaf.depth], lights)?;
    let solved = prepared.solve(leaf.depth);
    Some(lights.iter().map(|&(side, at)| solved.response(side, at)).collect())
}

/// Prepares a leaf whose lobes turn light, finely enough that R and T of these lights are right to 2e-5 at these
/// absorptions times thickness. `None` where the method does not converge to that.
pub fn prepared(leaf: &LayeredLeaf, depths: &[f64], lights: &[(Side, f64)]) -> Option<LeafOperator> {
    let mut prepared = LeafOperator::new(leaf, Resolution::USUAL);
    if is_plain(leaf) {
        return Some(prepared);
    }
    let seen = |prepared: &LeafOperator| -> Vec<LeafResponse> {
        let at = |depth: &f64| {
            let solved = prepared.solve(*depth);
            lights.iter().map(|&(side, at)| solved.response(side, at)).collect::<Vec<_>>()
        };
        depths.iter().flat_map(at).collect()
    };
    let mut found = seen(&prepared);
    for resolution in Resolution::FINER {
        prepared = LeafOperator::new(leaf, resolution);
        let finer = seen(&prepared);
        let off = |(a, b): (&LeafResponse, &LeafResponse)| {
            (a.reflectance - b.reflectance).abs().max((a.transmittance - b.transmittance).abs())
        };
        let settled = finer.iter().zip(&found).map(off).fold(0.0, f64::max) < SETTLED;
        if settled {
            return Some(prepared);
        }
        found = finer;
    }
    None
}

/// The derivatives of [`responses`] by the absorption of one crossing, at the usual resolution.
pub fn by_depth(leaf: &LayeredLeaf, lights: &[(Side, f64)]) -> Vec<LeafResponse<Dual<f64, 1>>> {
    let constant = |x: f64| Dual::<f64, 1>::of(x);
    let Oblateness { cuticle, epidermis, palisade, spongy } = leaf.oblateness;
    let dual = LayeredLeaf {
        depth: Dual::parameter(leaf.depth, 0),
        n_cuticle: constant(leaf.n_cuticle),
        n_mesophyll: constant(leaf.n_mesophyll),
        n_antidermal: constant(leaf.n_antidermal),
        oblateness: Oblateness {
            cuticle: constant(cuticle),
            epidermis: constant(epidermis),
            palisade: constant(palisade),
            spongy: constant(spongy),
        },
        path: leaf.path,
    };
    if straight(leaf) {
        let one = |&(side, at): &(Side, f64)| LeafOperator::straight(&dual, at).solve(dual.depth).response(side, at);
        return lights.iter().map(one).collect();
    }
    let prepared = LeafOperator::new(&dual, Resolution::USUAL);
    let solved = prepared.solve(dual.depth);
    lights.iter().map(|&(side, at)| solved.response(side, at)).collect()
}

/// Two resolutions that agree within this are both right to 2e-5.
const SETTLED: f64 = 1e-5;

/// Whether no lobe turns light.
fn straight(leaf: &LayeredLeaf) -> bool {
    let Oblateness { epidermis, palisade, spongy, .. } = leaf.oblateness;
    [epidermis, palisade, spongy].iter().all(|o| o.is_infinite())
}

/// Whether the usual resolution is known to be enough: lobes are wide, and indices equal or well apart.
pub fn is_plain(leaf: &LayeredLeaf) -> bool {
    let Oblateness { epidermis, palisade, spongy, .. } = leaf.oblateness;
    let mut indices = [1.0, leaf.n_cuticle, leaf.n_mesophyll, leaf.n_antidermal];
    indices.sort_by(f64::total_cmp);
    [epidermis, palisade, spongy].iter().all(|o| *o <= 12.0)
        && indices.windows(2).all(|w| w[0] == w[1] || w[1] - w[0] > 0.005)
}

/// The parameters of [`derivatives`], in their order.
pub const PARAMETERS: [&str; 7] = [
    "depth",
    "n_cuticle",
    "n_mesophyll",
    "n_antidermal",
    "oblateness_epidermis",
    "oblateness_palisade",
    "oblateness_spongy",
];

/// Reflectance and transmittance with their derivatives by [`PARAMETERS`], at the usual resolution. Where two indices
/// are equal, or an oblateness is infinite, the derivative by it is that of a leaf in which they stay so.
pub fn derivatives(leaf: &LayeredLeaf, side: Side, incidence: f64) -> LeafResponse<Dual<f64, 7>> {
    let Oblateness { cuticle, epidermis, palisade, spongy } = leaf.oblateness;
    let dual = LayeredLeaf {
        depth: Dual::parameter(leaf.depth, 0),
        n_cuticle: Dual::parameter(leaf.n_cuticle, 1),
        n_mesophyll: Dual::parameter(leaf.n_mesophyll, 2),
        n_antidermal: Dual::parameter(leaf.n_antidermal, 3),
        oblateness: Oblateness {
            cuticle: Dual::of(cuticle),
            epidermis: Dual::parameter(epidermis, 4),
            palisade: Dual::parameter(palisade, 5),
            spongy: Dual::parameter(spongy, 6),
        },
        path: leaf.path,
    };
    let prepared = if straight(leaf) {
        LeafOperator::straight(&dual, incidence)
    } else {
        LeafOperator::new(&dual, Resolution::USUAL)
    };
    prepared.solve(dual.depth).response(side, incidence)
}
