//! Finds which piece is a blade: its triangles all face about the same two opposite directions. A tube's triangles face
//! all directions around it.

use super::axis::principal;
use super::soup::{Piece, Soup};
use super::{Branch, Leaf};
use crate::form::nearest;
use glam::{DMat3, DVec3};

/// Least ratio of the largest eigenvalue of Σ A n nᵀ to the area Σ A. It is 1 for a flat piece, and at most ½ for a
/// round tube, whose eigenvalues are ½, ½ and 0. Folded or curled blades lie between.
const FLAT: f64 = 0.72;
/// Largest gap between a blade and its branch, as a share of the blade's length. Stalks are often not drawn.
const STALK: f64 = 0.6;

/// The piece as a blade, or `None` if it is none.
pub fn of(soup: &Soup, piece: &Piece) -> Option<Leaf> {
    let (mut facing, mut whole) = (DMat3::ZERO, 0.0);
    for t in &piece.triangles {
        let [a, b, c] = soup.corners(*t);
        let cross = (b - a).cross(c - a);
        let (area, n) = (0.5 * cross.length(), cross.normalize_or_zero());
        facing += DMat3::from_cols(n * (n.x * area), n * (n.y * area), n * (n.z * area));
        whole += area;
    }
    let [(most, normal), ..] = principal(facing);
    if !(most > FLAT * whole) {
        return None;
    }
    let centre = soup.centre(piece);
    let corners = piece.triangles.iter().flat_map(|t| soup.corners(*t));
    // The second moment of the area, times 24. For a triangle it is A/12 times the sum of d dᵀ over its corners and
    // over their sum, and `area` is 2A.
    let spread = piece.triangles.iter().fold(DMat3::ZERO, |sum, t| {
        let [a, b, c] = soup.corners(*t);
        let area = (b - a).cross(c - a).length();
        let across = |p: DVec3| (p - centre) - normal * (p - centre).dot(normal);
        let d = [a, b, c].map(across);
        [d[0], d[1], d[2], d[0] + d[1] + d[2]]
            .iter()
            .fold(sum, |m, d| m + DMat3::from_cols(*d * (d.x * area), *d * (d.y * area), *d * (d.z * area)))
    });
    let [(_, long), (_, wide), _] = principal(spread);
    let extent = |axis: DVec3| {
        corners.clone().map(|p| (p - centre).dot(axis)).fold((0.0, 0.0), |(a, b), d| (d.min(a), d.max(b)))
    };
    let (low, high) = extent(long);
    let (left, right) = extent(wide);
    Some(Leaf {
        centre,
        normal,
        size: [high - low, right - left],
        area: whole,
        ends: [centre + long * low, centre + long * high],
        joint: None,
        gap: f64::INFINITY,
    })
}

/// Attaches every blade to the branch that is nearest to one of its two ends.
pub fn hang(leaves: &mut [Leaf], branches: &[Branch]) {
    use rayon::prelude::*;
    let boxes: Vec<(DVec3, DVec3, f64)> = branches.iter().map(|b| b.tube.around()).collect();
    leaves.par_iter_mut().for_each(|leaf| {
        for end in leaf.ends {
            for (k, (branch, (low, high, thick))) in branches.iter().zip(&boxes).enumerate() {
                let outside = (*low - end).max(end - *high).max(DVec3::ZERO).length();
                if outside - thick >= leaf.gap {
                    continue;
                }
                let (at, distance) = nearest(&branch.tube.axis, end);
                let gap = distance - branch.tube.radius(at);
                if gap < leaf.gap {
                    (leaf.gap, leaf.joint) = (gap, Some((k, at)));
                }
            }
        }
        if !(leaf.gap <= STALK * leaf.size[0]) {
            leaf.joint = None;
        }
    });
}
