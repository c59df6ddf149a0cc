//! Coarser wood for views from afar: tubes with fewer corners around and fewer rings. A tube with fewer corners is so
//! much wider that its circumference stays, because a convex shape seen from all sides is on average as wide as its
//! circumference over π (Cauchy). So wood covers as much of a picture as before. Lengths are in mm.

use super::detail::MeshDetailLevel;
use glam::DVec3;
use mesophyll_files::mesh::LeafMesh;
use std::f64::consts::{PI, TAU};

/// Largest distance of each level from the wood (mm), the finest first. More would lift what is lit out of shadows.
const LEVELS: [f64; 4] = [0.5, 2.0, 8.0, 32.0];
/// A level is dropped if it has more than this share of the triangles of the one before.
pub const WORTH: f64 = 0.7;

/// A tube of a mesh: `rings` rings of `sides` corners, each of which repeats its first corner at its end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WoodTube {
    first: usize,
    /// Number of corners of a ring.
    pub sides: usize,
    rings: usize,
}

/// A ring's middle, the directions to its first corner and along the axis, and its radius.
#[derive(Debug, Clone, Copy)]
pub struct WoodRing {
    /// Its middle.
    pub middle: DVec3,
    out: DVec3,
    axis: DVec3,
    /// Its radius.
    pub radius: f64,
}

/// The levels of wood.
#[derive(Debug, Clone, Default)]
pub struct WoodLevels {
    /// The finest first.
    pub levels: Vec<MeshDetailLevel>,
    /// The vertices that are to be appended to the mesh's.
    pub more: LeafMesh,
    /// For each of them a vertex of the mesh on the same ring.
    pub on_ring: Vec<u32>,
}

impl WoodLevels {
    /// Leaves only so many of the new vertices.
    pub fn forget(&mut self, had: usize) {
        let more = &mut self.more;
        more.positions.truncate(had);
        more.normals.truncate(had);
        more.tangents.truncate(had);
        more.uvs.truncate(had);
        self.on_ring.truncate(had);
    }
}

/// The levels of wood. There are none where the mesh does not consist of tubes in the order in which `grow` writes
/// them. Wood that `bends` keeps all of its rings, because between two rings that bend apart nothing would follow the
/// branch.
pub fn levels(mesh: &LeafMesh, bends: bool) -> WoodLevels {
    let mut out = WoodLevels::default();
    let Some(tubes) = with_rings(mesh) else { return out };
    let mut before = mesh.triangles();
    for distance in LEVELS {
        let mut level = MeshDetailLevel { indices: Vec::new(), error_mm: 0.0, outline_only: false };
        let had = out.on_ring.len();
        for (tube, rings) in &tubes {
            add(mesh, tube, rings, distance, bends, &mut out, &mut level);
        }
        if level.indices.len() / 3 < (WORTH * before as f64) as usize {
            before = level.indices.len() / 3;
            out.levels.push(level);
        } else {
            out.forget(had);
        }
    }
    out
}

/// The tubes that a mesh consists of, each with its rings.
pub fn with_rings(mesh: &LeafMesh) -> Option<Vec<(WoodTube, Vec<WoodRing>)>> {
    let rings = |t: WoodTube| (t, (0..t.rings).map(|k| ring(mesh, &t, k)).collect());
    Some(tubes(mesh)?.into_iter().map(rings).collect())
}

/// The tubes that a mesh consists of.
fn tubes(mesh: &LeafMesh) -> Option<Vec<WoodTube>> {
    let mut rest = &mesh.indices[..];
    let mut out = Vec::new();
    while let [a, _, c, ..] = *rest {
        let ring = c.checked_sub(a).filter(|r| *r > 3)?;
        let sides = ring as usize - 1;
        let corner = |n: usize| a + (n / sides) as u32 * ring + (n % sides) as u32;
        let quad = |k: u32| [k, k + 1, k + ring, k + 1, k + ring + 1, k + ring];
        let quads = rest.as_chunks::<6>().0.iter().enumerate().take_while(|(n, q)| **q == quad(corner(*n))).count();
        let tube = WoodTube { first: a as usize, sides, rings: quads / sides + 1 };
        let closed = |k: usize| {
            let first = tube.first + k * ring as usize;
            mesh.positions[first].distance(mesh.positions[first + sides]) <= 1e-3 * ring_size(mesh, first)
        };
        if quads == 0 || quads % sides != 0 || !(0..tube.rings).all(closed) {
            return None;
        }
        out.push(tube);
        rest = &rest[6 * quads..];
    }
    Some(out)
}

/// The length of a side of the ring that begins with this vertex.
fn ring_size(mesh: &LeafMesh, first: usize) -> f64 {
    mesh.positions[first].distance(mesh.positions[first + 1])
}

fn ring(mesh: &LeafMesh, tube: &WoodTube, k: usize) -> WoodRing {
    let first = tube.first + k * (tube.sides + 1);
    let corners = &mesh.positions[first..first + tube.sides];
    let n = tube.sides as f64;
    let middle = corners.iter().sum::<DVec3>() / n;
    let out = (corners[0] - middle).normalize_or_zero();
    let turn = |i: usize| (corners[i] - middle).cross(corners[(i + 1) % tube.sides] - middle);
    let axis = (0..tube.sides).map(turn).sum::<DVec3>().normalize_or_zero();
    WoodRing { middle, out, axis, radius: corners.iter().map(|p| p.distance(middle)).sum::<f64>() / n }
}

/// The factor by which a tube with `to` corners is wider than one with `from`, and its largest distance from that one,
/// for a radius of 1.
pub fn fewer(from: usize, to: usize) -> (f64, f64) {
    let around = |n: usize| n as f64 * (PI / n as f64).sin();
    let wider = around(from) / around(to);
    let inwards = 1.0 - wider * (PI / to as f64).cos();
    (wider, inwards.max(wider - 1.0))
}

/// Adds a tube to a level, at most `distance` from the tube of the mesh: half of it for fewer corners, half for fewer
/// rings. With `bends`, no ring is left out, and all of it is for fewer corners.
fn add(
    mesh: &LeafMesh,
    tube: &WoodTube,
    rings: &[WoodRing],
    distance: f64,
    bends: bool,
    out: &mut WoodLevels,
    level: &mut MeshDetailLevel,
) {
    let radius = rings.iter().map(|r| r.radius).fold(0.0, f64::max);
    let allowed = if bends { distance } else { 0.5 * distance };
    let sides = (3..tube.sides).find(|to| radius * fewer(tube.sides, *to).1 <= allowed).unwrap_or(tube.sides);
    let (wider, off) = if sides < tube.sides { fewer(tube.sides, sides) } else { (1.0, 0.0) };
    let mut kept = vec![0];
    let along = match bends {
        true => {
            kept.extend(1..rings.len());
            0.0
        }
        false => thinned(rings, 0, rings.len() - 1, 0.5 * distance, &mut kept),
    };
    level.error_mm = level.error_mm.max(radius * off + along);
    if sides < tube.sides {
        return rebuilt(mesh, tube, rings, &kept, (sides, wider), out, level);
    }
    let corner = |at: usize| (tube.first + kept[at] * (tube.sides + 1)) as u32;
    for at in 1..kept.len() {
        between(corner(at - 1), corner(at), sides, level);
    }
}

/// The triangles between two rings, which begin with these vertices.
fn between(low: u32, high: u32, sides: usize, level: &mut MeshDetailLevel) {
    for i in 0..sides as u32 {
        level.indices.extend([low + i, low + i + 1, high + i, low + i + 1, high + i + 1, high + i]);
    }
}

/// Adds the `kept` rings of a tube to a level with another number of corners, and so many times as wide.
pub fn rebuilt(
    mesh: &LeafMesh,
    tube: &WoodTube,
    rings: &[WoodRing],
    kept: &[usize],
    (sides, wider): (usize, f64),
    WoodLevels { more, on_ring, .. }: &mut WoodLevels,
    level: &mut MeshDetailLevel,
) {
    let start = (mesh.positions.len() + more.positions.len()) as u32;
    for k in kept {
        let (ring, first) = (rings[*k], tube.first + k * (tube.sides + 1));
        let across = ring.axis.cross(ring.out);
        let own = |v: DVec3| [ring.out, across, ring.axis].map(|axis| axis.dot(v));
        let ([n, _, lean], [_, turn, along]) = (own(mesh.normals[first]), own(mesh.tangents[first].0));
        for side in 0..=sides {
            let share = side as f64 / sides as f64;
            let (sin, cos) = (TAU * share).sin_cos();
            let (out, around) = (ring.out * cos + across * sin, across * cos - ring.out * sin);
            more.positions.push(ring.middle + wider * ring.radius * out);
            more.normals.push((n * out + lean * ring.axis).normalize_or_zero());
            let tangent = (turn * around + along * ring.axis).normalize_or_zero();
            more.tangents.push((tangent, mesh.tangents[first].1));
            more.uvs.push(mesh.uvs[first].lerp(mesh.uvs[first + tube.sides], share));
            on_ring.push(first as u32);
        }
    }
    let corner = |at: usize| start + (at * (sides + 1)) as u32;
    for at in 1..kept.len() {
        between(corner(at - 1), corner(at), sides, level);
    }
}

/// Keeps `to`, and the rings between it and `from` that the cone between the two misses by more than `distance`, in
/// place or radius (Douglas–Peucker). Returns the largest remaining distance.
pub fn thinned(rings: &[WoodRing], from: usize, to: usize, distance: f64, kept: &mut Vec<usize>) -> f64 {
    let (a, b) = (rings[from], rings[to]);
    let along = b.middle - a.middle;
    let off = |k: usize| {
        let t = ((rings[k].middle - a.middle).dot(along) / along.length_squared().max(1e-300)).clamp(0.0, 1.0);
        let beside = rings[k].middle.distance(a.middle + t * along);
        beside + (a.radius + t * (b.radius - a.radius) - rings[k].radius).abs()
    };
    let worst = (from + 1..to).map(|k| (k, off(k))).max_by(|p, q| p.1.total_cmp(&q.1));
    match worst {
        Some((k, far)) if far > distance => {
            let before = thinned(rings, from, k, distance, kept);
            before.max(thinned(rings, k, to, distance, kept))
        }
        _ => {
            kept.push(to);
            worst.map_or(0.0, |w| w.1)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::polygon::beside;
    use super::*;
    use glam::DMat4;
    use mesophyll_plants::form::tube;

    /// A thick bent branch and a thin straight twig on it.
    fn wood() -> LeafMesh {
        let axis: Vec<DVec3> = (0..=20).map(|k| DVec3::new(50.0 * f64::from(k), 0.1 * f64::from(k * k), 0.0)).collect();
        let mut out = tube(&axis, [30.0, 8.0], 12, 9);
        out.append(&tube(&[DVec3::ZERO, DVec3::Z * 200.0], [2.0, 1.0], 6, 5), DMat4::from_translation(axis[9]));
        out
    }

    /// Distance of a point from a triangle.
    fn off(p: DVec3, corners: [DVec3; 3]) -> f64 {
        let edge = |k: usize| [corners[k], corners[(k + 1) % 3]];
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
        match (0..3).all(|k| normal.cross(edge(k)[1] - edge(k)[0]).dot(p - edge(k)[0]) >= 0.0) {
            true => normal.dot(p - corners[0]).abs(),
            false => (0..3).map(|k| beside(p, edge(k))).fold(f64::MAX, f64::min),
        }
    }

    #[test]
    fn levels_have_fewer_triangles_and_stay_within_what_they_say() {
        let mesh = wood();
        let WoodLevels { levels, more, .. } = levels(&mesh, false);
        assert!(levels.len() >= 2, "{}", levels.len());
        let mut all = mesh.clone();
        all.append(&more, DMat4::IDENTITY);
        let mut before = mesh.triangles();
        for level in &levels {
            let coarse = LeafMesh { indices: level.indices.clone(), ..all.clone() };
            assert!(coarse.triangles() < before && level.error_mm <= LEVELS[3]);
            before = coarse.triangles();
            let facets: Vec<[DVec3; 3]> =
                (0..coarse.triangles()).map(|t| coarse.triangle(t).map(|k| coarse.positions[k])).collect();
            for p in mesh.positions.iter().step_by(3) {
                let far = facets.iter().map(|f| off(*p, *f)).fold(f64::MAX, f64::min);
                assert!(far <= level.error_mm + 1e-9, "{far} {}", level.error_mm);
            }
        }
        assert!(before * 4 < mesh.triangles(), "{before}");
    }

    /// The mean over all directions across the axis of how wide a tube is.
    fn wide(mesh: &LeafMesh, vertices: std::ops::Range<usize>) -> f64 {
        let of = |k: u32| {
            let (sin, cos) = (TAU * f64::from(k) / 720.0).sin_cos();
            let at = mesh.positions[vertices.clone()].iter().map(|p| DVec3::new(cos, sin, 0.0).dot(*p));
            at.clone().fold(f64::MIN, f64::max) - at.fold(f64::MAX, f64::min)
        };
        (0..720).map(of).sum::<f64>() / 720.0
    }

    #[test]
    fn a_tube_with_fewer_corners_is_as_wide_on_average() {
        let thin = tube(&[DVec3::ZERO, DVec3::Z * 200.0], [2.0, 2.0], 9, 5);
        let WoodLevels { levels, more, .. } = levels(&thin, false);
        let last = levels.last().expect("a level");
        // Three corners, and no rings between both ends of a straight tube.
        assert_eq!(last.indices.len(), 3 * 2 * 3);
        let first = *last.indices.iter().min().unwrap() as usize - thin.positions.len();
        let ratio = wide(&more, first..first + 4) / wide(&thin, 0..10);
        assert!((ratio - 1.0).abs() < 1e-3, "{ratio}");
        for (p, n) in more.positions[first..].iter().zip(&more.normals[first..]) {
            assert!(n.dot(p.with_z(0.0).normalize()) > 0.999, "{p} {n}");
        }
    }

    /// Each new corner stands in the plane of the ring that is named for it, and every level has all rings.
    #[test]
    fn wood_that_bends_keeps_its_rings() {
        let mesh = wood();
        let found = levels(&mesh, true);
        assert!(!found.levels.is_empty() && found.on_ring.len() == found.more.positions.len());
        let tubes = tubes(&mesh).expect("tubes");
        let of = |k: usize| {
            let tube = tubes.iter().rfind(|t| t.first <= k).expect("a tube");
            ring(&mesh, tube, (k - tube.first) / (tube.sides + 1))
        };
        for (p, k) in found.more.positions.iter().zip(&found.on_ring) {
            let WoodRing { middle, axis, radius, .. } = of(*k as usize);
            assert!(p.distance(middle) < 1.2 * radius && (*p - middle).dot(axis).abs() < 1e-9, "{p} {middle}");
        }
        let own = mesh.positions.len();
        for level in &found.levels {
            let on = |k: u32| found.on_ring.get((k as usize).wrapping_sub(own)).map_or(k, |first| *first);
            let rings: std::collections::BTreeSet<[i64; 3]> = level
                .indices
                .iter()
                .map(|k| of(on(*k) as usize).middle.to_array().map(|x| (1e6 * x).round() as i64))
                .collect();
            assert_eq!(rings.len(), tubes.iter().map(|t| t.rings).sum::<usize>());
            assert!(level.error_mm <= LEVELS[3]);
        }
    }

    #[test]
    fn other_meshes_have_no_levels() {
        let mut mesh = wood();
        mesh.indices.rotate_left(3);
        assert!(levels(&mesh, false).levels.is_empty());
        assert!(levels(&LeafMesh::rectangle(10.0, 10.0), true).levels.is_empty());
    }
}
