//! Rays along the layers of a leaf.

use super::tests::{INF, SIDES, leaf};
use super::{exact, walk};

/// Between equal media nothing is reflected, however grazing the light is that lobes leave. Narrow, wide and mixed
/// lobes; light that grazes the leaf itself; clear and dark leaves.
#[test]
fn a_leaf_of_air_reflects_nothing() {
    let lobes = [[5.0, 1.0, 5.0], [0.0, 0.0, 0.0], [0.3, 30.0, 2.0], [INF, 0.0, INF], [100.0, 5.0, 0.0]];
    for (k, oblateness) in lobes.into_iter().enumerate() {
        for depth in [0.0, 0.05, 0.72] {
            let air = leaf([1.0; 3], oblateness, depth);
            for side in SIDES {
                for incidence in [0.0f64, 60.0, 85.0, 89.0, 89.99].map(f64::to_radians) {
                    let rays = 200_000;
                    let counts = walk::count(&air, side, incidence, rays, 100 + k as u64, &|| false);
                    assert_eq!((counts.reflected, counts.lost), (0, 0), "{oblateness:?} {depth} {side:?} {incidence}");
                    assert!(depth > 0.0 || counts.transmitted == rays, "{oblateness:?} {side:?} {incidence}");
                }
            }
        }
    }
}

/// Light that grazes the leaf, lobes that send much of it along the layers, and indices that hardly differ.
#[test]
fn rays_at_grazing_angles_are_those_of_the_exact_method() {
    let leaves = [
        leaf([1.0, 1.0, 1.3], [0.0, 1.0, 0.0], 0.1),
        leaf([1.0001, 1.0, 1.0002], [1.0, 0.0, 1.0], 0.0),
        leaf([1.5, 1.5, 1.5], [0.0, 0.0, 0.0], 0.02),
        leaf([1.41, 1.41001, 1.42], [5.0, 1.0, 0.5], 0.3),
    ];
    for (k, leaf) in leaves.iter().enumerate() {
        for side in SIDES {
            for incidence in [80.0f64, 88.0, 89.5].map(f64::to_radians) {
                // The method may refuse indices that agree in four digits; then there is nothing to compare with.
                let Some(want) = exact::response(leaf, side, incidence) else { continue };
                let counts = walk::count(leaf, side, incidence, 400_000, k as u64, &|| false);
                for (count, want) in [(counts.reflected, want.reflectance), (counts.transmitted, want.transmittance)] {
                    let (share, error) = counts.share(count);
                    assert!(
                        (share - want).abs() < 4.5 * error + 2e-5,
                        "{leaf:?} {side:?} {incidence}: {share} {error} {want}"
                    );
                }
            }
        }
    }
}
