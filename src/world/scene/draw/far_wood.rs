//! Still coarser wood, for plants that stand in many places: of thin branches, fewer and wider ones are drawn, so that
//! wood covers as much as before. Lengths are in mm.

use super::detail::MeshDetailLevel;
use super::tubes::{self, WORTH, WoodLevels, WoodRing, WoodTube, fewer, rebuilt, thinned};
use mesophyll_files::mesh::LeafMesh;

/// Distances of the levels, the finest first: at each, a pixel is twice as wide as it says.
const LEVELS: [f64; 8] = [32.0, 64.0, 128.0, 256.0, 512.0, 1024.0, 2048.0, 4096.0];
/// The width of drawn branches over a level's distance: three eighths of a pixel at least.
const WIDTH: f64 = 0.75;
/// Corners of a ring.
const SIDES: usize = 3;
/// The deflection of a branch in a wind, over its length, for which there are rings enough.
const DEFLECTION: f64 = 0.25;

/// The levels of wood for plants that stand in many places: those of all wood, and coarser ones. Where wood `bends`,
/// the latter keep so many rings that a bent branch misses its place by half of the level's distance at most.
pub fn levels(mesh: &LeafMesh, bends: bool) -> WoodLevels {
    let mut out = tubes::levels(mesh, bends);
    let Some(tubes) = tubes::with_rings(mesh) else { return out };
    let mut before = out.levels.last().map_or(mesh.triangles(), |level| level.indices.len() / 3);
    for distance in LEVELS {
        let had = out.on_ring.len();
        let mut level = MeshDetailLevel { indices: Vec::new(), error_mm: distance, outline_only: false };
        for (k, wider) in kept(&tubes, distance) {
            let (tube, rings) = &tubes[k];
            let few = few(rings, distance, bends);
            rebuilt(mesh, tube, rings, &few, (SIDES, wider * fewer(tube.sides, SIDES).0), &mut out, &mut level);
        }
        // Levels of equal distance: the later one is drawn.
        if level.indices.len() / 3 < (WORTH * before as f64) as usize {
            before = level.indices.len() / 3;
            out.levels.push(level);
        } else {
            out.forget(had);
        }
    }
    out
}

/// The branches that a level has, and how many times as wide each is drawn. Together they are as large as all.
fn kept(tubes: &[(WoodTube, Vec<WoodRing>)], distance: f64) -> Vec<(usize, f64)> {
    let radius = |k: usize| tubes[k].1.iter().map(|ring| ring.radius).fold(0.0, f64::max);
    let size = |k: usize| {
        let of = |w: &[WoodRing]| w[0].middle.distance(w[1].middle) * (w[0].radius + w[1].radius);
        tubes[k].1.windows(2).map(of).sum::<f64>()
    };
    let long = |k: usize| {
        let steps = tubes[k].1.windows(2);
        steps.map(|w| w[0].middle.distance(w[1].middle)).sum::<f64>().max(2.0 * radius(k))
    };
    let largest = (0..tubes.len()).max_by(|a, b| size(*a).total_cmp(&size(*b)));
    let share = |k: usize| match largest == Some(k) {
        true => 1.0,
        // None is drawn wider than it is long.
        false => (2.0 * radius(k) / (WIDTH * distance).min(long(k))).min(1.0),
    };
    // Branches that follow each other have ranks far apart.
    let rank = |k: usize| (0.5 + 0.618_033_988_749_895 * k as f64).fract();
    let all: Vec<(usize, f64)> = (0..tubes.len()).map(|k| (k, share(k))).collect();
    let (thin, thick): (Vec<_>, Vec<_>) = all.into_iter().partition(|(_, share)| *share < 1.0);
    let drawn: Vec<(usize, f64)> = thin.iter().filter(|(k, share)| rank(*k) < *share).copied().collect();
    let wanted: f64 = thin.iter().map(|(k, _)| size(*k)).sum();
    let found: f64 = drawn.iter().map(|(k, share)| size(*k) / share).sum();
    let even = if found > 0.0 { wanted / found } else { 1.0 };
    let mut out = thick;
    out.extend(drawn.into_iter().map(|(k, share)| (k, even / share)));
    out.sort_by_key(|(k, _)| *k);
    out
}

/// The rings of a branch that a level keeps.
fn few(rings: &[WoodRing], distance: f64, bends: bool) -> Vec<usize> {
    let mut kept = vec![0];
    thinned(rings, 0, rings.len() - 1, 0.5 * distance, &mut kept);
    if !bends {
        return kept;
    }
    let place = |k: usize| rings[..=k].windows(2).map(|w| w[0].middle.distance(w[1].middle)).sum::<f64>();
    let length = place(rings.len() - 1);
    // Bent in a parabola, a piece of length s misses its chord by d (s/l)²/4, where d is the deflection of the tip.
    let longest = (2.0 * distance / (DEFLECTION * length).max(1e-9)).sqrt() * length;
    let mut out = vec![0];
    for k in 1..rings.len() {
        let last = out.last().copied().unwrap_or(0);
        if kept.contains(&k) || (k + 1 < rings.len() && place(k + 1) - place(last) > longest) {
            out.push(k);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat4, DVec3};
    use mesophyll_plants::form::tube;

    /// A trunk and many twigs.
    fn wood() -> LeafMesh {
        let mut out = tube(&[DVec3::ZERO, DVec3::Z * 2e3, DVec3::Z * 4e3], [80.0, 20.0], 12, 9);
        for k in 0..300 {
            let axis: Vec<DVec3> =
                (0..6).map(|i| DVec3::new(50.0 * f64::from(i), 3.0 * f64::from(i * i), 0.0)).collect();
            let turn = DMat4::from_rotation_z(2.4 * f64::from(k));
            let at = DMat4::from_translation(DVec3::Z * (500.0 + 10.0 * f64::from(k)));
            out.append(&tube(&axis, [2.0, 1.0], 6, 5), at * turn);
        }
        out
    }

    /// Half of the area of all tubes of a mesh over π: what they cover on average.
    fn covers(mesh: &LeafMesh) -> f64 {
        (0..mesh.triangles())
            .map(|t| {
                let [a, b, c] = mesh.triangle(t).map(|k| mesh.positions[k]);
                (b - a).cross(c - a).length()
            })
            .sum()
    }

    #[test]
    fn far_wood_has_few_triangles_and_covers_as_much() {
        for bends in [false, true] {
            let mesh = wood();
            let found = levels(&mesh, bends);
            let mut all = mesh.clone();
            all.append(&found.more, DMat4::IDENTITY);
            let mut before = mesh.triangles();
            for level in &found.levels {
                let coarse = LeafMesh { indices: level.indices.clone(), ..all.clone() };
                assert!(coarse.triangles() < before);
                before = coarse.triangles();
                let ratio = covers(&coarse) / covers(&mesh);
                assert!((ratio - 1.0).abs() < 0.06, "bends {bends}, {} mm: {ratio}", level.error_mm);
            }
            assert!(found.levels.iter().map(|l| l.error_mm).is_sorted());
            assert!(before * 100 < mesh.triangles(), "bends {bends}: {before} of {}", mesh.triangles());
            assert_eq!(found.on_ring.len(), found.more.positions.len());
        }
    }
}
