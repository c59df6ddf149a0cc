//! Space colonisation (Runions et al. 2005). The finest veins grow from the nearest vein towards auxin sources that are
//! spread over the lamina, and their tips join into meshes. Lengths in mm.

use super::outline::BladeContour;
use super::spec::VeinSpec;
use super::veins::{VeinNetwork, VeinPiece, cell, distance};
use mesophyll_base::random::RandomStream;
use std::collections::HashMap;
use std::f64::consts::PI;

/// Fine veins between those of `network`. Auxin sources about half of `tertiary_mm` apart attract veins from the
/// nearest node until they are reached.
pub(crate) fn colonise(blade: &BladeContour, veins: &VeinSpec, network: &VeinNetwork, seed: u64) -> Vec<VeinPiece> {
    let spacing = 0.55 * veins.tertiary_mm;
    // A source that is closer than `born` to a vein needs no new vein. A source is reached when a vein comes within one
    // step.
    let (step, born) = (0.2 * spacing, 0.5 * spacing);
    let mut nodes: Vec<[f64; 2]> = Vec::new();
    for order in &network.orders {
        for piece in order.list() {
            let n = (distance(piece.a, piece.b) / step).ceil().max(1.0) as usize;
            nodes.extend((0..n).map(|k| {
                let t = k as f64 / n as f64;
                [piece.a[0] + t * (piece.b[0] - piece.a[0]), piece.a[1] + t * (piece.b[1] - piece.a[1])]
            }));
        }
    }
    // For each source, the distance to the nearest node and that node.
    let mut sources: Vec<([f64; 2], f64, usize)> =
        scatter(blade, spacing, seed).into_iter().map(|p| (p, f64::MAX, usize::MAX)).collect();
    let mut seen = 0;
    let mut parent: Vec<usize> = vec![usize::MAX; nodes.len()];
    let first = nodes.len();
    for round in 0..400 {
        for source in &mut sources {
            for (k, node) in nodes[seen..].iter().enumerate() {
                let (dx, dy) = (node[0] - source.0[0], node[1] - source.0[1]);
                let d = dx * dx + dy * dy;
                if d < source.1 {
                    (source.1, source.2) = (d, seen + k);
                }
            }
        }
        seen = nodes.len();
        let near_enough = if round == 0 { born } else { 1.1 * step };
        sources.retain(|s| s.1 > near_enough * near_enough);
        let mut pull: Vec<(usize, [f64; 2])> = sources
            .iter()
            .map(|(p, d2, k)| {
                let d = d2.sqrt();
                (*k, [(p[0] - nodes[*k][0]) / d, (p[1] - nodes[*k][1]) / d])
            })
            .collect();
        if pull.is_empty() {
            break;
        }
        pull.sort_by(|a, b| a.0.cmp(&b.0).then(a.1[0].total_cmp(&b.1[0])));
        for group in pull.chunk_by(|a, b| a.0 == b.0) {
            let k = group[0].0;
            let mut d = group.iter().fold([0.0, 0.0], |s, g| [s[0] + g.1[0], s[1] + g.1[1]]);
            let length = d[0].hypot(d[1]);
            if length < 0.1 {
                d = group[0].1; // opposite pulls: follow one
            }
            let length = d[0].hypot(d[1]);
            let mut s = RandomStream::new(seed, &[0x7e7, nodes.len() as u64]);
            let next = [0, 1].map(|c| nodes[k][c] + step * (d[c] / length + 0.25 * s.signed()));
            if blade.holds(next) {
                nodes.push(next);
                parent.push(k);
            }
        }
        if nodes.len() == seen {
            break;
        }
    }
    let mut children = vec![0u32; nodes.len()];
    for &p in &parent[first..] {
        children[p] += 1;
    }
    // Veins thicken with the number of tips that they feed (pipe model: the squares of the radii add up), counted from
    // the tips.
    let mut fed = vec![1.0f64; nodes.len()];
    for k in (first..nodes.len()).rev() {
        if parent[k] >= first {
            let f = fed[k];
            fed[parent[k]] += 0.15 * f;
        }
    }
    let radius = |k: usize| 0.5 * veins.width_mm[2] * (0.4 + 0.15 * fed[k].min(8.0).ln());
    let mut pieces = Vec::new();
    for k in first..nodes.len() {
        pieces.push(VeinPiece { a: nodes[parent[k]], b: nodes[k], radius: [radius(k), radius(k)] });
    }
    // Tips that end close to another branch join that branch.
    let mut near: HashMap<(i32, i32), Vec<usize>> = HashMap::new();
    for (k, p) in nodes.iter().enumerate() {
        near.entry(cell(*p)).or_default().push(k);
    }
    for k in first..nodes.len() {
        if children[k] > 0 {
            continue;
        }
        let mut ancestors = vec![k];
        while ancestors.len() < 14 && parent[ancestors[ancestors.len() - 1]] != usize::MAX {
            ancestors.push(parent[ancestors[ancestors.len() - 1]]);
        }
        let (i, j) = cell(nodes[k]);
        let mut best = (1.3 * spacing, usize::MAX);
        for a in -1..=1 {
            for b in -1..=1 {
                for &q in near.get(&(i + a, j + b)).map_or(&[][..], |v| v) {
                    let d = distance(nodes[k], nodes[q]);
                    if d < best.0 && !ancestors.contains(&q) && !ancestors.contains(&parent[q]) {
                        best = (d, q);
                    }
                }
            }
        }
        if best.1 != usize::MAX {
            pieces.push(VeinPiece { a: nodes[k], b: nodes[best.1], radius: [radius(k), radius(k)] });
        }
    }
    pieces
}

/// Points on the blade: one in each cell of a jittered grid, which is turned by an angle that depends on the seed.
fn scatter(blade: &BladeContour, spacing: f64, seed: u64) -> Vec<[f64; 2]> {
    // Even when turned by 45°, the square covers the blade.
    let n = (1.5 * blade.reach() / spacing).ceil() as i64;
    let (s, c) = (PI * RandomStream::new(seed, &[0xa7]).uniform()).sin_cos();
    let mut points = Vec::new();
    for i in -n..=n {
        for j in -n..=n {
            let mut r = RandomStream::new(seed, &[0xa0c, i as u64, j as u64]);
            let (x, y) = ((i as f64 + 0.42 * r.signed()) * spacing, (j as f64 + 0.42 * r.signed()) * spacing);
            let p = [c * x - s * y, s * x + c * y];
            if blade.holds(p) {
                points.push(p);
            }
        }
    }
    points
}
