//! Blades whose two sides are surfaces of their own, at the same place: a leaf is one surface with two sides, and its
//! area counts once. Triangles with the same corners are left out when a file is read; here the two may be cut into
//! triangles in other ways, be of two materials, or stand a hair apart.

use super::LeafPiece;
use super::soup::{MeshPiece, TriangleSoup};
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};

/// Largest distance between the vertices of the two, as a share of the blade's length.
const APART: f64 = 0.01;
/// Largest difference of their areas, as a share, and of the cosine between their planes from 1.
const UNLIKE: f64 = 0.02;

/// Takes the backs out of the blades, and returns how many triangles they have. Of two materials, the one that faces
/// upwards in the sum is the front; of one material, the first surface stays.
pub fn take(soup: &TriangleSoup, pieces: &[MeshPiece], leaves: &mut Vec<LeafPiece>) -> usize {
    let places: Vec<Vec<DVec3>> = leaves.iter().map(|leaf| places(soup, &pieces[leaf.piece])).collect();
    let mut order: Vec<usize> = (0..leaves.len()).collect();
    order.sort_by(|a, b| leaves[*a].centre.x.total_cmp(&leaves[*b].centre.x));
    let name = |k: usize| soup.material(&pieces[leaves[k].piece]);
    let mut pairs: Vec<[usize; 2]> = Vec::new();
    let mut paired = vec![false; leaves.len()];
    for (k, a) in order.iter().enumerate() {
        let one = &leaves[*a];
        let near = order[k + 1..].iter().take_while(|b| leaves[**b].centre.x - one.centre.x <= APART * one.size[0]);
        let found =
            near.copied().find(|b| !paired[*a] && !paired[*b] && same(one, &leaves[*b], [&places[*a], &places[*b]]));
        if let Some(b) = found {
            (paired[*a], paired[b]) = (true, true);
            // By material, then as they come.
            let mut pair = [*a, b];
            pair.sort_by_key(|k| (name(*k), *k));
            pairs.push(pair);
        }
    }
    let up = |k: usize| pieces[leaves[k].piece].triangles.iter().map(|t| facing(soup, *t).y).sum::<f64>();
    // By how much the first material of each two faces upwards more than the second.
    let mut more: BTreeMap<[&str; 2], f64> = BTreeMap::new();
    for [a, b] in &pairs {
        *more.entry([name(*a), name(*b)]).or_default() += up(*a) - up(*b);
    }
    let second = |[a, b]: &[usize; 2]| name(*a) == name(*b) || more[&[name(*a), name(*b)]] >= 0.0;
    let back = |pair: &[usize; 2]| pair[usize::from(second(pair))];
    let backs: BTreeSet<usize> = pairs.iter().map(back).collect();
    let triangles = backs.iter().map(|k| pieces[leaves[*k].piece].triangles.len()).sum();
    let mut index = 0;
    leaves.retain(|_| {
        index += 1;
        !backs.contains(&(index - 1))
    });
    triangles
}

/// The different places of a piece's vertices.
fn places(soup: &TriangleSoup, piece: &MeshPiece) -> Vec<DVec3> {
    let all: BTreeSet<u32> = piece.triangles.iter().flat_map(|t| soup.triangles[*t as usize]).collect();
    all.into_iter().map(|k| soup.places[k as usize]).collect()
}

/// A triangle's normal, as long as twice its area, towards where it winds counterclockwise.
fn facing(soup: &TriangleSoup, triangle: u32) -> DVec3 {
    let [a, b, c] = soup.corners(triangle);
    (b - a).cross(c - a)
}

/// Whether every vertex of each of the two is near one of the other.
fn same(a: &LeafPiece, b: &LeafPiece, places: [&Vec<DVec3>; 2]) -> bool {
    let near = APART * a.size[0];
    let beside = |from: &[DVec3], to: &[DVec3]| from.iter().all(|p| to.iter().any(|q| p.distance(*q) <= near));
    a.centre.distance(b.centre) <= near
        && (a.area - b.area).abs() <= UNLIKE * a.area
        && a.normal.dot(b.normal).abs() >= 1.0 - UNLIKE
        && beside(places[0], places[1])
        && beside(places[1], places[0])
}
