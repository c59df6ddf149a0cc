//! The axis of a tube, and its radius along it.
//!
//! Every vertex gets a height. In a piece that is much longer than wide, it is measured along the piece's longest
//! direction. In other pieces, such as a hoop, it is the way along the surface from one end. Cuts at even heights are
//! polygons around the tube, and their centres form the axis. Heights are then measured along this axis and the cuts
//! are made again, so that they stand across it. The radius is the line that fits the corners of the cuts.

use super::arms::{from_end, longest_arm, mean_radius, neighbours};
use super::soup::{MeshPiece, Sets, TriangleSoup};
use crate::form::along;
use glam::{DMat3, DVec3};
use std::collections::{BTreeMap, HashMap};

/// The largest mean deviation of the cuts' radii from a line, as a share of the mean radius, in a piece that is closed
/// at both ends. It is .24 for an egg of any length, and 0 for a tapered tube.
const SWELL: f64 = 0.15;
/// A piece that ends in a point and is shorter than this many of its radii at the other end is a crown like a cone.
const CONE: f64 = 4.0;

/// The largest number of cuts through a piece.
const CUTS: usize = 48;
/// A piece with at least this ratio of length to width is followed along its longest direction.
const SLENDER: f64 = 4.0;
/// Number of rounds in which the cuts are made.
const ROUNDS: usize = 3;
/// A cut goes through a cap if its radius is below this share of the radius that the other cuts give there.
const CAP: f64 = 0.6;
/// Largest root mean square deviation of outlines from their radius, as a share of it.
const ROUND: f64 = 0.5;
/// The least length of a tube in radii.
const SHORTEST: f64 = 1.5;
/// Largest share of cuts that consist of several polygons.
const FORKED: f64 = 0.2;
/// The length of a second arm, in radii of the piece, from which on it counts as a branch of its own. Grown branches
/// with rough ends have at most .2; the shortest branch that is a tube has [`SHORTEST`] of its own radii.
const ARM: f64 = 3.0;

/// A tapered tube.
#[derive(Debug, Clone, PartialEq)]
pub struct TaperedTube {
    /// Points from root to tip (mm). Until the tube is attached, they go from the thick end to the thin one.
    pub axis: Vec<DVec3>,
    /// Radius at the beginning of the axis (mm).
    pub root_radius: f64,
    /// Radius at its end (mm).
    pub tip_radius: f64,
}

impl TaperedTube {
    /// Length along the axis (mm).
    pub fn length(&self) -> f64 {
        self.axis.windows(2).map(|w| w[0].distance(w[1])).sum()
    }

    /// Radius at a share of the axis (mm).
    pub fn radius(&self, at: f64) -> f64 {
        self.root_radius + at * (self.tip_radius - self.root_radius)
    }

    /// The same with the other end first.
    pub fn turned(&self) -> TaperedTube {
        let axis = self.axis.iter().rev().copied().collect();
        TaperedTube { axis, root_radius: self.tip_radius, tip_radius: self.root_radius }
    }
}

/// Eigenvalues of a symmetric matrix, the largest first, with their unit eigenvectors (Jacobi's rotations).
pub(crate) fn principal(m: DMat3) -> [(f64, DVec3); 3] {
    let mut a = m.to_cols_array_2d();
    let mut v = DMat3::IDENTITY.to_cols_array_2d();
    for _ in 0..32 {
        let off = a[0][1].abs() + a[0][2].abs() + a[1][2].abs();
        let size = a[0][0].abs() + a[1][1].abs() + a[2][2].abs();
        if !(off > 1e-15 * size) {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = 0.5 * (2.0 * a[p][q]).atan2(a[q][q] - a[p][p]);
            let (s, c) = theta.sin_cos();
            for k in 0..3 {
                let (x, y) = (a[k][p], a[k][q]);
                (a[k][p], a[k][q]) = (c * x - s * y, s * x + c * y);
            }
            for k in 0..3 {
                let (x, y) = (a[p][k], a[q][k]);
                (a[p][k], a[q][k]) = (c * x - s * y, s * x + c * y);
            }
            // The columns of v become the eigenvectors.
            for k in 0..3 {
                let (x, y) = (v[p][k], v[q][k]);
                (v[p][k], v[q][k]) = (c * x - s * y, s * x + c * y);
            }
        }
    }
    let mut out = [0, 1, 2].map(|k| (a[k][k], DVec3::from(v[k]).normalize_or(DVec3::X)));
    out.sort_by(|x, y| y.0.total_cmp(&x.0));
    out
}

/// A piece with its own list of vertices.
pub(super) struct Mesh {
    pub places: Vec<DVec3>,
    pub triangles: Vec<[usize; 3]>,
}

/// The axis and radii of a piece.
///
/// # Errors
/// A text that says why the piece is not a tube.
pub fn of(soup: &TriangleSoup, piece: &MeshPiece) -> Result<TaperedTube, String> {
    let mesh = mesh(soup, piece);
    let neighbours = neighbours(&mesh);
    let from_end = from_end(&mesh, &neighbours);
    let arm = longest_arm(&neighbours, &from_end);
    if arm > ARM * mean_radius(&mesh, &from_end) {
        return Err(format!("a second arm of {arm:.3} mm leaves it: it forks"));
    }
    let mut heights = heights(&mesh, &from_end);
    let count = (mesh.places.len() / 3).clamp(4, CUTS);
    let (mut axis, mut forked, mut radii) = (Vec::new(), 0.0, Vec::new());
    for round in 0..ROUNDS {
        let (low, high) = range(&heights);
        if !(high > low) {
            return Err("it has no length".into());
        }
        let cuts: Vec<(f64, Cut)> = (0..count)
            .filter_map(|k| {
                let level = low + (high - low) * (k as f64 + 0.5) / count as f64;
                Some((level, cut(&mesh, &heights, level)?))
            })
            .collect();
        // In the first round, cuts near the ends may not go all around the tube.
        let skip = if round == 0 && cuts.len() >= 8 { cuts.len() / 8 } else { 0 };
        let inner = &cuts[skip..cuts.len() - skip];
        let [(first, start), (second, next)] = match inner {
            [a, b, ..] => [(a.0, a.1.centre), (b.0, b.1.centre)],
            _ => return Err("it cannot be cut across".into()),
        };
        let [(last, end), (before, previous)] = match inner {
            [.., b, a] => [(a.0, a.1.centre), (b.0, b.1.centre)],
            _ => return Err("it cannot be cut across".into()),
        };
        axis = vec![start + (start - next) * ((first - low) / (second - first))];
        axis.extend(inner.iter().map(|(_, cut)| cut.centre));
        axis.push(end + (end - previous) * ((high - last) / (last - before)));
        forked = inner.iter().filter(|(_, cut)| cut.polygons > 1).count() as f64 / inner.len() as f64;
        if axis.iter().any(|p| !p.is_finite()) {
            return Err("it cannot be cut across".into());
        }
        heights = mesh.places.iter().map(|p| height_along(&axis, *p).0).collect();
        radii = cuts.into_iter().map(|(_, cut)| (height_along(&axis, cut.centre).0, cut)).collect();
    }
    if forked > FORKED {
        return Err(format!("{:.0} % of the cuts across it have several outlines: it forks", 100.0 * forked));
    }
    // The final heights give the places of the ends.
    let (low, high) = range(&heights);
    let length = high - low;
    let axis = trimmed(&axis, low, high);
    let outline: Vec<(f64, f64)> = radii.iter().map(|(height, cut)| ((height - low) / length, cut.radius)).collect();
    let [root, tip] = line(&outline);
    let rms = (radii.iter().map(|(_, cut)| cut.stray * cut.stray).sum::<f64>() / radii.len() as f64).sqrt();
    let mean = 0.5 * (root + tip);
    if !(mean > 0.0) || rms > ROUND * mean {
        let what = "the radius of its outlines varies by";
        return Err(format!("it is not round: {what} {rms:.3} mm around a mean of {mean:.3} mm"));
    }
    if let Some(why) = crown(&outline, [root, tip], length) {
        return Err(why);
    }
    if length < SHORTEST * mean {
        return Err(format!("it is {length:.3} mm long and {:.3} mm wide, expected a tube", 2.0 * mean));
    }
    let tube = TaperedTube { axis, root_radius: root.max(0.0), tip_radius: tip.max(0.0) };
    Ok(if tube.root_radius >= tube.tip_radius { tube } else { tube.turned() })
}

/// Why a piece is a crown that is drawn as one ball or cone, if it is. `outline` has the share of the axis and the
/// radius of each cut, `ends` the radii of the line through them.
fn crown(outline: &[(f64, f64)], ends: [f64; 2], length: f64) -> Option<String> {
    let [root, tip] = ends;
    let mean = 0.5 * (root + tip);
    let off = |(at, radius): &(f64, f64)| (radius - root - at * (tip - root)) / mean;
    let [first, last] = [outline.first()?, outline.last()?].map(off);
    let swell = outline.iter().map(|cut| off(cut).abs()).sum::<f64>() / outline.len() as f64;
    if first < -0.1 && last < -0.1 && swell > SWELL {
        return Some(format!("it swells like a ball between closed ends, to a radius of {mean:.3} mm: no branch does"));
    }
    let [thin, thick] = if root < tip { [root, tip] } else { [tip, root] };
    (thin < 0.15 * thick && length < CONE * thick).then(|| {
        format!("it is a cone of {length:.3} mm with a radius of {thick:.3} mm: no branch is so short for its width")
    })
}

fn mesh(soup: &TriangleSoup, piece: &MeshPiece) -> Mesh {
    let mut number: HashMap<u32, usize> = HashMap::new();
    let mut mesh = Mesh { places: Vec::new(), triangles: Vec::with_capacity(piece.triangles.len()) };
    for t in &piece.triangles {
        let triangle = soup.triangles[*t as usize].map(|v| {
            *number.entry(v).or_insert_with(|| {
                mesh.places.push(soup.places[v as usize]);
                mesh.places.len() - 1
            })
        });
        mesh.triangles.push(triangle);
    }
    mesh
}

pub(super) fn range(values: &[f64]) -> (f64, f64) {
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)))
}

/// The heights of the first round. `from_end` is the way along the surface from one end to each vertex.
fn heights(mesh: &Mesh, from_end: &[f64]) -> Vec<f64> {
    let mean = mesh.places.iter().sum::<DVec3>() / mesh.places.len() as f64;
    let spread = mesh.places.iter().fold(DMat3::ZERO, |sum, p| {
        let d = *p - mean;
        sum + DMat3::from_cols(d * d.x, d * d.y, d * d.z)
    });
    let [(long, axis), (wide, _), _] = principal(spread);
    if long > SLENDER * SLENDER * wide {
        return mesh.places.iter().map(|p| (*p - mean).dot(axis)).collect();
    }
    from_end.to_vec()
}

/// A cut across a piece.
struct Cut {
    /// Centre of its outline.
    centre: DVec3,
    /// Number of outlines that do not touch each other.
    polygons: usize,
    /// Mean distance of the corners from the centre. Half of the crossed edges are diagonals, which meet the outline
    /// between corners.
    radius: f64,
    /// Root mean square deviation of the crossed edges' distances from their mean.
    stray: f64,
}

fn cut(mesh: &Mesh, heights: &[f64], level: f64) -> Option<Cut> {
    let (mut sum, mut whole) = (DVec3::ZERO, 0.0);
    let mut crossings = BTreeMap::new();
    // Crossed edges of the same triangle belong to the same outline.
    let (mut outlines, mut number) = (Sets::default(), HashMap::new());
    for t in &mesh.triangles {
        let mut crossed = Vec::with_capacity(2);
        for (p, q) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            if (heights[p] < level) != (heights[q] < level) {
                let share = (level - heights[p]) / (heights[q] - heights[p]);
                crossed.push(((p.min(q), p.max(q)), mesh.places[p].lerp(mesh.places[q], share)));
            }
        }
        let [(e, a), (f, b)] = crossed.as_slice() else { continue };
        let length = a.distance(*b);
        sum += (*a + *b) * (0.5 * length);
        whole += length;
        crossings.insert(*e, *a);
        crossings.insert(*f, *b);
        let [e, f] = [e, f].map(|edge| *number.entry(*edge).or_insert_with(|| outlines.add()));
        outlines.join(e, f);
    }
    if !(whole > 0.0) {
        return None;
    }
    let centre = sum / whole;
    let mut distances: Vec<f64> = crossings.values().map(|p: &DVec3| p.distance(centre)).collect();
    distances.sort_by(f64::total_cmp);
    let mean = |list: &[f64]| list.iter().sum::<f64>() / list.len() as f64;
    let middle = mean(&distances);
    let stray = (distances.iter().map(|d| (d - middle).powi(2)).sum::<f64>() / distances.len() as f64).sqrt();
    Some(Cut { centre, polygons: outlines.count(), radius: mean(&distances[distances.len() / 2..]), stray })
}

/// The height of a place along an axis, which is extended beyond both ends, and the distance of the place from the
/// axis.
fn height_along(axis: &[DVec3], place: DVec3) -> (f64, f64) {
    let mut best = (0.0, f64::INFINITY);
    let mut before = 0.0;
    let last = axis.len().saturating_sub(2);
    for (k, w) in axis.windows(2).enumerate() {
        let (d, step) = (w[1] - w[0], w[0].distance(w[1]));
        if step > 0.0 {
            let mut x = (place - w[0]).dot(d) / (step * step);
            if k > 0 {
                x = x.max(0.0);
            }
            if k < last {
                x = x.min(1.0);
            }
            let distance = place.distance(w[0] + d * x);
            if distance < best.1 {
                best = (before + x * step, distance);
            }
        }
        before += step;
    }
    best
}

/// The part of the axis from height `low` to height `high`.
fn trimmed(axis: &[DVec3], low: f64, high: f64) -> Vec<DVec3> {
    let whole: f64 = axis.windows(2).map(|w| w[0].distance(w[1])).sum();
    let at = |height: f64| {
        let share = height / whole;
        let (place, direction) = along(axis, share);
        place + direction * (height - share.clamp(0.0, 1.0) * whole)
    };
    let mut out = vec![at(low)];
    let mut height = 0.0;
    for w in axis.windows(2) {
        let margin = 1e-6 * whole;
        if height > low + margin && height < high - margin {
            out.push(w[0]);
        }
        height += w[0].distance(w[1]);
    }
    out.push(at(high));
    out
}

/// Fits a line to radii over the share of the axis and returns its values at 0 and at 1. Cuts through a cap are left
/// out.
fn line(points: &[(f64, f64)]) -> [f64; 2] {
    let mut keep: Vec<bool> = vec![true; points.len()];
    let mut ends = [0.0; 2];
    for _ in 0..4 {
        let kept: Vec<(f64, f64)> = points.iter().zip(&keep).filter(|(_, k)| **k).map(|(p, _)| *p).collect();
        let n = kept.len() as f64;
        let (mx, my) = kept.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
        let (sxx, sxy) = kept.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + (x - mx).powi(2), b + (x - mx) * (y - my)));
        let slope = if sxx > 0.0 { sxy / sxx } else { 0.0 };
        let value = |x: f64| my + slope * (x - mx);
        ends = [value(0.0), value(1.0)];
        let next: Vec<bool> = points.iter().map(|(x, y)| *y >= CAP * value(*x)).collect();
        if next == keep || !next.contains(&true) {
            break;
        }
        keep = next;
    }
    ends
}
