//! Finds which piece is a blade: its triangles all face about the same two opposite directions, or it is a sheet,
//! however curled it is. A tube's triangles face all directions around it, and it is no sheet.

use super::axis::principal;
use super::soup::{MeshPiece, TriangleSoup};
use super::{BranchPiece, LeafPiece};
use crate::form::nearest;
use glam::{DMat3, DVec3};
use std::collections::{HashMap, HashSet};
use std::f64::consts::TAU;

/// Least ratio of the largest eigenvalue of Σ A n nᵀ to the area Σ A. It is 1 for a flat piece, and at most ½ for a
/// round tube, whose eigenvalues are ½, ½ and 0. Folded or curled blades lie between.
const FLAT: f64 = 0.72;
/// Least square of a sheet's border, relative to that of a flat round one with the same area (4π times the area). No
/// sheet that can be flattened has less than 1; a cupped one has less, and half a ball ½. A cone, as the tips of
/// branches are, has its radius over its length.
const BORDER: f64 = 0.5;
/// Largest gap between a blade and its branch, as a share of the blade's length. Stalks are often not drawn.
const STALK: f64 = 0.6;
/// A blade whose width is more than this share of its length has no longest direction that could be trusted.
const ROUND: f64 = 0.9;

/// The piece as a blade, or `None` if it is none.
pub fn of(soup: &TriangleSoup, piece: &MeshPiece) -> Option<LeafPiece> {
    let (mut facing, mut whole) = (DMat3::ZERO, 0.0);
    for t in &piece.triangles {
        let [a, b, c] = soup.corners(*t);
        let cross = (b - a).cross(c - a);
        let (area, n) = (0.5 * cross.length(), cross.normalize_or_zero());
        facing += DMat3::from_cols(n * (n.x * area), n * (n.y * area), n * (n.z * area));
        whole += area;
    }
    let [(most, normal), ..] = principal(facing);
    if !(most > FLAT * whole || sheet(soup, piece, whole)) {
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
    let round = right - left > ROUND * (high - low);
    let picture = if round { up(soup, piece, normal) } else { None };
    let edge = if round { picture.or_else(|| longest_edge(soup, piece, normal)) } else { None };
    let (long, [low, high], [left, right]) = match edge {
        Some(edge) => (edge, extent(edge).into(), extent(normal.cross(edge)).into()),
        None => (long, [low, high], [left, right]),
    };
    Some(LeafPiece {
        piece: 0,
        centre,
        normal,
        size: [high - low, right - left],
        area: whole,
        ends: [centre + long * low, centre + long * high],
        upright: picture.is_some(),
        joint: None,
        nearest: None,
        gap: f64::INFINITY,
    })
}

/// Whether the piece, whose area is `area`, is a sheet: it has one border and no hole, and that border is not short for
/// its area.
fn sheet(soup: &TriangleSoup, piece: &MeshPiece, area: f64) -> bool {
    let edges = edges(soup, piece);
    let corners = piece.triangles.iter().flat_map(|t| soup.triangles[*t as usize]);
    let vertices = corners.collect::<HashSet<u32>>().len();
    // Euler's formula: a sheet with one border has 1, a tube 0, a closed surface 2. Where borders touch, more than two
    // edges of them meet.
    let mut meeting: HashMap<u32, usize> = HashMap::new();
    for end in edges.iter().filter(|(_, n)| **n == 1).flat_map(|(edge, _)| edge) {
        *meeting.entry(*end).or_default() += 1;
    }
    if vertices + piece.triangles.len() != edges.len() + 1
        || edges.values().any(|n| *n > 2)
        || meeting.values().any(|n| *n != 2)
    {
        return false;
    }
    let length = |[a, b]: &[u32; 2]| soup.places[*a as usize].distance(soup.places[*b as usize]);
    let border: f64 = edges.iter().filter(|(_, n)| **n == 1).map(|(edge, _)| length(edge)).sum();
    border * border > BORDER * 2.0 * TAU * area
}

/// The edges of a piece, and how many of its triangles have each.
fn edges(soup: &TriangleSoup, piece: &MeshPiece) -> HashMap<[u32; 2], usize> {
    let mut edges: HashMap<[u32; 2], usize> = HashMap::new();
    for t in &piece.triangles {
        let [a, b, c] = soup.triangles[*t as usize];
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *edges.entry([from.min(to), from.max(to)]).or_default() += 1;
        }
    }
    edges
}

/// The direction of the picture's top within the plane of `normal`: leaves grow upwards in pictures of leaves. `None`
/// without texture coordinates.
fn up(soup: &TriangleSoup, piece: &MeshPiece, normal: DVec3) -> Option<DVec3> {
    let of = |t: &u32| {
        let [a, b, c] = soup.corners(*t);
        let [p, q, r] = soup.said.get(*t as usize)?.uvs.map(|uv| uv.map(f64::from));
        let (d, e) = ([q[0] - p[0], q[1] - p[1]], [r[0] - p[0], r[1] - p[1]]);
        let turn = d[0] * e[1] - e[0] * d[1];
        (turn != 0.0).then(|| ((b - a) * e[0] - (c - a) * d[0]) * turn.signum())
    };
    let sum: DVec3 = piece.triangles.iter().filter_map(of).sum();
    (sum - normal * sum.dot(normal)).try_normalize()
}

/// The direction of the piece's longest edge that belongs to one triangle only, within the plane of `normal`.
fn longest_edge(soup: &TriangleSoup, piece: &MeshPiece, normal: DVec3) -> Option<DVec3> {
    let line = |[a, b]: [u32; 2]| soup.places[b as usize] - soup.places[a as usize];
    let mut border: Vec<[u32; 2]> =
        edges(soup, piece).into_iter().filter(|(_, n)| *n == 1).map(|(edge, _)| edge).collect();
    // The order of a map changes from run to run.
    border.sort_unstable();
    let longest = border.into_iter().map(line).max_by(|a, b| a.length().total_cmp(&b.length()))?;
    (longest - normal * longest.dot(normal)).try_normalize()
}

/// Attaches every blade to the branch that is nearest to one of its two ends. This end becomes the first one, unless a
/// picture says which is.
pub fn hang(leaves: &mut [LeafPiece], branches: &[BranchPiece]) {
    use rayon::prelude::*;
    let boxes: Vec<(DVec3, DVec3, f64)> = branches.iter().map(|b| b.tube.around()).collect();
    leaves.par_iter_mut().for_each(|leaf| {
        let mut base = 0;
        for (e, end) in leaf.ends.into_iter().enumerate() {
            for (k, (branch, (low, high, thick))) in branches.iter().zip(&boxes).enumerate() {
                let outside = (*low - end).max(end - *high).max(DVec3::ZERO).length();
                if outside - thick >= leaf.gap {
                    continue;
                }
                let (at, distance) = nearest(&branch.tube.axis, end);
                let gap = distance - branch.tube.radius(at);
                if gap < leaf.gap {
                    (base, leaf.gap, leaf.nearest) = (e, gap, Some((k, at)));
                }
            }
        }
        if !leaf.upright {
            leaf.ends.swap(0, base);
        }
        leaf.joint = leaf.nearest.filter(|_| leaf.gap <= STALK * leaf.size[0]);
    });
}
