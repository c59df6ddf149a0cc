//! Ways along the surface of a piece: where its end is, how far every vertex is from there, and whether the piece
//! forks.

use super::axis::{Mesh, range};
use super::soup::Sets;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap, HashSet};

/// The way along the surface from one end to every vertex.
pub(super) fn from_end(mesh: &Mesh, neighbours: &[Vec<usize>]) -> Vec<f64> {
    let farthest = |from: &[f64]| (0..from.len()).max_by(|a, b| from[*a].total_cmp(&from[*b])).unwrap_or(0);
    let end = farthest(&ways(mesh, neighbours, &[0]));
    let rim = rim(mesh, end);
    ways(mesh, neighbours, if rim.is_empty() { std::slice::from_ref(&end) } else { &rim })
}

/// The length of the longest arm besides the one that goes farthest from the end: how much farther its tip is than the
/// place where it meets the rest. A tube has only one arm, whatever its shape. (It is the second largest persistence of
/// the maxima of `from_end`.)
pub(super) fn longest_arm(neighbours: &[Vec<usize>], from_end: &[f64]) -> f64 {
    let mut order: Vec<usize> = (0..from_end.len()).collect();
    order.sort_by(|a, b| from_end[*b].total_cmp(&from_end[*a]));
    // The farthest vertices come first. Each is the tip of a new arm, or it lies on known arms, which meet there. Of
    // two arms the one with the nearer tip ends where they meet. The lowest number of an arm is that of its tip.
    let (mut arms, mut number) = (Sets::default(), vec![None; from_end.len()]);
    let mut longest = 0.0f64;
    for v in &order {
        let own = arms.add();
        number[*v] = Some(own);
        for other in neighbours[*v].iter().filter_map(|n| number[*n]) {
            let [a, b] = [own, other].map(|k| arms.top(k));
            if a != b {
                longest = longest.max(from_end[order[a.max(b) as usize]] - from_end[*v]);
                arms.join(a, b);
            }
        }
    }
    longest
}

/// The radius that a tube would have with the area of the piece, and as long as the piece.
pub(super) fn mean_radius(mesh: &Mesh, from_end: &[f64]) -> f64 {
    let area = |t: &[usize; 3]| {
        let [a, b, c] = t.map(|v| mesh.places[v]);
        0.5 * (b - a).cross(c - a).length()
    };
    mesh.triangles.iter().map(area).sum::<f64>() / (std::f64::consts::TAU * range(from_end).1)
}

/// The vertices next to each vertex; a vertex is named once for each triangle that both have.
pub(super) fn neighbours(mesh: &Mesh) -> Vec<Vec<usize>> {
    let mut out = vec![Vec::new(); mesh.places.len()];
    for [a, b, c] in &mesh.triangles {
        for (p, q) in [(a, b), (b, c), (c, a)] {
            out[*p].push(*q);
            out[*q].push(*p);
        }
    }
    out
}

/// The length of the shortest way along edges from `sources` to every vertex (Dijkstra).
fn ways(mesh: &Mesh, neighbours: &[Vec<usize>], sources: &[usize]) -> Vec<f64> {
    let mut way = vec![f64::INFINITY; mesh.places.len()];
    let mut next: BinaryHeap<Reverse<(u64, usize)>> = BinaryHeap::new();
    for s in sources {
        way[*s] = 0.0;
        next.push(Reverse((0, *s)));
    }
    // The bit patterns of non-negative numbers have the same order as the numbers.
    while let Some(Reverse((bits, at))) = next.pop() {
        if f64::from_bits(bits) > way[at] {
            continue;
        }
        for n in &neighbours[at] {
            let there = way[at] + mesh.places[at].distance(mesh.places[*n]);
            if there < way[*n] {
                way[*n] = there;
                next.push(Reverse((there.to_bits(), *n)));
            }
        }
    }
    way
}

/// The vertices of the open rim that is nearest to a vertex; none where the piece is closed.
fn rim(mesh: &Mesh, from: usize) -> Vec<usize> {
    let mut sides: HashMap<(usize, usize), usize> = HashMap::new();
    for [a, b, c] in &mesh.triangles {
        for (p, q) in [(*a, *b), (*b, *c), (*c, *a)] {
            *sides.entry((p.min(q), p.max(q))).or_insert(0) += 1;
        }
    }
    let mut around: HashMap<usize, Vec<usize>> = HashMap::new();
    for ((p, q), count) in sides {
        if count == 1 {
            around.entry(p).or_default().push(q);
            around.entry(q).or_default().push(p);
        }
    }
    let distance = |v: usize| mesh.places[v].distance(mesh.places[from]);
    let Some(start) = around.keys().copied().min_by(|a, b| distance(*a).total_cmp(&distance(*b)).then(a.cmp(b))) else {
        return Vec::new();
    };
    let (mut out, mut next, mut seen) = (vec![start], vec![start], HashSet::from([start]));
    while let Some(at) = next.pop() {
        for n in around.get(&at).into_iter().flatten() {
            if seen.insert(*n) {
                out.push(*n);
                next.push(*n);
            }
        }
    }
    out
}
