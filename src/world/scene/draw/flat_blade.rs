//! The coarsest levels of a blade: flat pieces of a few corners. One with four corners is a card. Their plane is
//! perpendicular to the blade's vector area ∫ n dA, and their area is that vector's length. So, from every direction
//! from which the blade does not hide itself, a piece covers as much of the picture as the blade, and as much sunlight
//! falls on it. Lengths are in mm.

use super::polygon;
use glam::{DMat3, DVec2, DVec3, Vec3Swizzles};
use mesophyll_files::mesh::{LeafMesh, vertex_tangents};

/// A flat piece that stands for a blade.
#[derive(Debug, Clone, PartialEq)]
pub struct FlatBlade {
    /// Its corners as a mesh of its own; indices begin at 0.
    pub piece: LeafMesh,
    /// Largest distance between the blade and the piece, seen from either (the Hausdorff distance).
    pub error_mm: f64,
}

/// Largest root mean square angle (rad) between the blade's normals and those of the piece, whose corners have normals
/// of their own. It is what the coarsest lit level allows any vertex.
const TURN: f64 = 12.0 * std::f64::consts::PI / 180.0;
/// Largest root mean square distance between the blade's texture coordinates and those of the piece.
const OFF_MAP: f64 = 0.05;
/// Points along an edge of the piece where its distance from the blade's outline is measured.
const ALONG: usize = 16;

/// Largest relative difference between what a mask leaves of the blade and of the piece.
const OFF_MASK: f64 = 0.02;
/// Number of points on which that is counted.
const POINTS: usize = 4096;

/// A plane, with coordinates in it.
struct Plane {
    centre: DVec3,
    axes: [DVec3; 2],
    normal: DVec3,
}

impl Plane {
    fn flat(&self, p: DVec3) -> DVec2 {
        DVec2::from(self.axes.map(|a| a.dot(p - self.centre)))
    }

    fn place(&self, p: DVec2) -> DVec3 {
        self.centre + p.x * self.axes[0] + p.y * self.axes[1]
    }
}

/// The piece with so many `corners` for a blade whose boundary is `rings`. With `shown`, only the texture coordinates
/// for which it is true belong to the blade. `None` where the piece would be lit or coloured otherwise than the blade,
/// where a mask would leave more or less of it, where its corners cannot be found, or where holes are a tenth of the
/// blade or more.
pub fn flat(
    mesh: &LeafMesh,
    rings: &[Vec<u32>],
    corners: usize,
    shown: Option<&dyn Fn(DVec2) -> bool>,
) -> Option<FlatBlade> {
    let weights = weights(mesh);
    let whole: f64 = weights.iter().sum();
    let normal = vector_area(mesh);
    let area = normal.length();
    let normal = normal.try_normalize()?;
    let centre = weights.iter().zip(&mesh.positions).map(|(w, p)| *w * *p).sum::<DVec3>() / whole;
    let along = DVec3::X.reject_from(normal).try_normalize()?;
    let plane = Plane { centre, axes: [along, normal.cross(along)], normal };
    let outlines: Vec<Vec<DVec2>> =
        rings.iter().map(|r| r.iter().map(|k| plane.flat(mesh.positions[*k as usize])).collect()).collect();
    let outer = outlines.iter().max_by(|a, b| polygon::signed(a).total_cmp(&polygon::signed(b)))?;
    let filled = polygon::signed(outer);
    if area < 0.9 * filled {
        return None;
    }
    let polygon = polygon::few(outer, corners, area)?;
    let indices = polygon::ears(&polygon)?;
    let fits = Linear::new(&plane, mesh, &weights)?;
    let normals = fits.of(&plane, mesh, &weights, &|k| mesh.normals[k]);
    let uvs = fits.of(&plane, mesh, &weights, &|k| mesh.uvs[k].extend(0.0));
    let (low, high) = mesh.uvs.iter().fold((mesh.uvs[0], mesh.uvs[0]), |(l, h), t| (l.min(*t), h.max(*t)));
    let at = |field: &DMat3, p: DVec2| *field * DVec3::new(1.0, p.x, p.y);
    let mut square = [0.0; 2];
    for (k, w) in weights.iter().enumerate() {
        let p = plane.flat(mesh.positions[k]);
        square[0] += w * at(&normals, p).angle_between(mesh.normals[k]).powi(2);
        square[1] += w * at(&uvs, p).truncate().distance_squared(mesh.uvs[k]);
    }
    let [turn, off] = square.map(|s| (s / whole).sqrt());
    if !(turn <= TURN && off <= OFF_MAP) {
        return None;
    }
    let mut piece = LeafMesh {
        positions: polygon.iter().map(|p| plane.place(*p)).collect(),
        normals: polygon.iter().map(|p| at(&normals, *p).try_normalize().unwrap_or(normal)).collect(),
        uvs: polygon.iter().map(|p| at(&uvs, *p).truncate().clamp(low, high)).collect(),
        indices,
        ..LeafMesh::default()
    };
    piece.tangents = vertex_tangents(&piece);
    if let Some(shown) = shown {
        let [blade, flat] = [mesh, &piece].map(|m| kept(m, shown));
        if !((flat / blade - 1.0).abs() <= OFF_MASK) {
            return None;
        }
    }
    let error_mm = apart(mesh, rings, &plane, &polygon, &outlines);
    Some(FlatBlade { piece, error_mm })
}

/// ∫ n dA over the mesh.
fn vector_area(mesh: &LeafMesh) -> DVec3 {
    let facet = |t| {
        let [a, b, c] = mesh.triangle(t).map(|k| mesh.positions[k]);
        0.5 * (b - a).cross(c - a)
    };
    (0..mesh.triangles()).map(facet).sum()
}

/// A third of the area of the facets around each vertex.
fn weights(mesh: &LeafMesh) -> Vec<f64> {
    let mut out = vec![0.0; mesh.positions.len()];
    for t in 0..mesh.triangles() {
        let corners = mesh.triangle(t);
        let [a, b, c] = corners.map(|k| mesh.positions[k]);
        corners.iter().for_each(|k| out[*k] += (b - a).cross(c - a).length() / 6.0);
    }
    out
}

/// Length of the vector area of what a mask shows of a mesh. Points lie evenly on each facet (Roberts' sequence).
fn kept(mesh: &LeafMesh, shown: &dyn Fn(DVec2) -> bool) -> f64 {
    let each = POINTS.div_ceil(mesh.triangles().max(1));
    let facet = |t| {
        let corners = mesh.triangle(t);
        let [a, b, c] = corners.map(|k| mesh.positions[k]);
        let [ta, tb, tc] = corners.map(|k| mesh.uvs[k]);
        let inside = |k: &usize| {
            let [s, r] = [0.754_877_666, 0.569_840_291].map(|step: f64| (step * (*k as f64 + 0.5)).fract());
            let (s, r) = if s + r > 1.0 { (1.0 - s, 1.0 - r) } else { (s, r) };
            shown(ta + s * (tb - ta) + r * (tc - ta))
        };
        0.5 * (b - a).cross(c - a) * ((0..each).filter(inside).count() as f64 / each as f64)
    };
    (0..mesh.triangles()).map(facet).sum::<DVec3>().length()
}

/// Least squares of quantities over a plane, as 1, x and y, weighted by area.
struct Linear(DMat3);

impl Linear {
    fn new(plane: &Plane, mesh: &LeafMesh, weights: &[f64]) -> Option<Linear> {
        let mut sum = DMat3::ZERO;
        for (p, w) in mesh.positions.iter().zip(weights) {
            let row = plane.flat(*p).extend(1.0).zxy();
            sum += *w * DMat3::from_cols(row * row.x, row * row.y, row * row.z);
        }
        let inverse = sum.inverse();
        inverse.is_finite().then_some(Linear(inverse))
    }

    fn of(&self, plane: &Plane, mesh: &LeafMesh, weights: &[f64], what: &dyn Fn(usize) -> DVec3) -> DMat3 {
        let mut sum = DMat3::ZERO;
        for (k, w) in weights.iter().enumerate() {
            let row = plane.flat(mesh.positions[k]).extend(1.0).zxy();
            let v = *w * what(k);
            sum += DMat3::from_cols(v * row.x, v * row.y, v * row.z);
        }
        sum * self.0
    }
}

/// The Hausdorff distance between a blade and a piece of its plane. Of the blade its vertices count, because the
/// distance from the piece is largest there. Of the piece its rim counts where it lies outside of the outline.
fn apart(mesh: &LeafMesh, rings: &[Vec<u32>], plane: &Plane, polygon: &[DVec2], outlines: &[Vec<DVec2>]) -> f64 {
    let rim: Vec<[DVec3; 2]> = rings
        .iter()
        .flat_map(|r| (0..r.len()).map(|k| [r[k], r[(k + 1) % r.len()]].map(|v| mesh.positions[v as usize])))
        .collect();
    let edge = |k: usize| [polygon[k], polygon[(k + 1) % polygon.len()]];
    let edges = || (0..polygon.len()).map(edge);
    let blade = mesh.positions.iter().map(|p| {
        let (flat, up) = (plane.flat(*p), plane.normal.dot(*p - plane.centre));
        let beside = match super::detail::inside(std::slice::from_ref(&polygon.to_vec()), flat) {
            true => 0.0,
            false => {
                edges().map(|e| polygon::beside(flat.extend(0.0), e.map(|q| q.extend(0.0)))).fold(f64::MAX, f64::min)
            }
        };
        beside.hypot(up)
    });
    let points = edges().flat_map(|[a, b]| (0..ALONG).map(move |k| a.lerp(b, k as f64 / ALONG as f64)));
    let outside = points.filter(|p| !super::detail::inside(outlines, *p));
    let piece = outside.map(|p| rim.iter().map(|e| polygon::beside(plane.place(p), *e)).fold(f64::MAX, f64::min));
    blade.chain(piece).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::super::detail::rings;
    use super::*;
    use mesophyll_files::mesh::vertex_normals;

    /// An ellipse with semi-axes of 30 and 16 mm, of 12 rings of triangles, with a height (mm) over x.
    fn ellipse(height: fn(f64) -> f64) -> LeafMesh {
        let mut mesh = LeafMesh { positions: vec![DVec3::ZERO], ..LeafMesh::default() };
        let (rings, around) = (12u32, 48u32);
        for ring in 1..=rings {
            for k in 0..around {
                let p = DVec2::from_angle(std::f64::consts::TAU * f64::from(k) / f64::from(around));
                let p = f64::from(ring) / f64::from(rings) * p * DVec2::new(30.0, 16.0);
                mesh.positions.push(p.extend(height(p.x)));
            }
        }
        let id = |ring: u32, k: u32| if ring == 0 { 0 } else { 1 + (ring - 1) * around + k % around };
        for k in 0..around {
            mesh.indices.extend([0, id(1, k), id(1, k + 1)]);
            for ring in 1..rings {
                let [a, b] = [k, k + 1].map(|k| [id(ring, k), id(ring + 1, k)]);
                mesh.indices.extend([a[0], a[1], b[1], a[0], b[1], b[0]]);
            }
        }
        mesh.uvs = mesh.positions.iter().map(|p| DVec2::new(0.5 + p.x / 80.0, 0.5 - p.y / 80.0)).collect();
        mesh.normals = vertex_normals(&mesh);
        mesh.tangents = vertex_tangents(&mesh);
        mesh
    }

    fn of(mesh: &LeafMesh) -> FlatBlade {
        flat(mesh, &rings(mesh).unwrap(), 4, None).expect("a piece")
    }

    /// The shadow on a plane has the same area for the blade and for the piece, from any direction in which the blade
    /// does not hide itself; texture coordinates are those of the blade below.
    #[test]
    fn the_piece_covers_as_much_as_the_blade() {
        let mesh = ellipse(|x| 0.004 * x * x);
        let piece = of(&mesh).piece;
        assert_eq!((piece.positions.len(), piece.triangles()), (4, 2));
        for direction in [DVec3::Z, DVec3::new(0.5, 0.3, 0.8).normalize(), DVec3::new(-0.2, 0.6, 0.7).normalize()] {
            let shadow = |m: &LeafMesh| -> f64 {
                let facet = |t| {
                    let [a, b, c] = m.triangle(t).map(|k| m.positions[k]);
                    0.5 * (b - a).cross(c - a).dot(direction)
                };
                (0..m.triangles()).map(facet).sum()
            };
            assert!((shadow(&piece) / shadow(&mesh) - 1.0).abs() < 1e-9, "{direction}");
        }
        for (p, t) in piece.positions.iter().zip(&piece.uvs) {
            let (low, high) = (DVec2::new(10.0 / 80.0, 24.0 / 80.0), DVec2::new(70.0 / 80.0, 56.0 / 80.0));
            assert!(t.distance(DVec2::new(0.5 + p.x / 80.0, 0.5 - p.y / 80.0).clamp(low, high)) < 1e-6, "{p} {t}");
        }
        // The normals lean as the blade's do.
        for (p, n) in piece.positions.iter().zip(&piece.normals) {
            assert!(n.angle_between(DVec3::new(-0.008 * p.x, 0.0, 1.0)) < 0.03, "{p} {n}");
        }
        assert!(piece.tangents.iter().all(|(t, w)| t.x > 0.95 && *w == 1.0), "{:?}", piece.tangents);
    }

    /// With more corners a piece covers as much, and is nearer to a blade that is flat.
    #[test]
    fn six_corners_are_nearer_than_four() {
        let mesh = ellipse(|_| 0.0);
        let [four, six] = [4, 6].map(|n| flat(&mesh, &rings(&mesh).unwrap(), n, None).expect("a piece"));
        assert_eq!([four.piece.triangles(), six.piece.triangles()], [2, 4]);
        assert!(six.error_mm < 0.7 * four.error_mm, "{} {}", six.error_mm, four.error_mm);
        let [a, b] = [&four, &six].map(|f| vector_area(&f.piece).length());
        assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
    }

    /// The stated error is that of points on both rims, found by brute force. A rhomb of the same area is farther from
    /// the ellipse.
    #[test]
    fn the_stated_error_is_the_largest_distance() {
        let (mesh, steps) = (ellipse(|_| 0.0), 4000);
        let found = of(&mesh);
        let blade: Vec<DVec2> = (0..steps)
            .map(|k| DVec2::from_angle(std::f64::consts::TAU * f64::from(k) / f64::from(steps)))
            .map(|p| p * DVec2::new(30.0, 16.0))
            .collect();
        let rim = |corners: [DVec2; 4]| -> Vec<DVec2> {
            let edge = |k: usize| (0..1000).map(move |j| corners[k].lerp(corners[(k + 1) % 4], f64::from(j) / 1e3));
            (0..4).flat_map(edge).collect()
        };
        let far = |a: &[DVec2], b: &[DVec2]| {
            let near = |p: &DVec2| b.iter().map(|q| p.distance_squared(*q)).fold(f64::MAX, f64::min);
            a.iter().step_by(8).map(near).fold(0.0, f64::max).sqrt()
        };
        let apart = |corners: [DVec2; 4]| far(&blade, &rim(corners)).max(far(&rim(corners), &blade));
        let right = apart(std::array::from_fn(|k| found.piece.positions[k].truncate()));
        assert!((found.error_mm - right).abs() < 0.15, "{} {right}", found.error_mm);
        let [long, short] = [30.0, 16.0].map(|axis| axis * std::f64::consts::FRAC_PI_2.sqrt());
        let rhomb = apart([DVec2::X * long, DVec2::Y * short, DVec2::NEG_X * long, DVec2::NEG_Y * short]);
        assert!(right < 0.8 * rhomb, "{right} {rhomb}");
    }

    #[test]
    fn a_mask_that_the_piece_would_undo_refuses_it() {
        let flat_with =
            |mesh: &LeafMesh, shown: &dyn Fn(DVec2) -> bool| flat(mesh, &rings(mesh).unwrap(), 4, Some(shown));
        // A rectangle stands for itself, so a mask cuts the same out of it.
        let sheet = LeafMesh::rectangle(60.0, 30.0);
        let disk = |t: DVec2| t.distance(DVec2::splat(0.5)) < 0.4;
        let piece = flat_with(&sheet, &disk).expect("a piece");
        assert!(piece.error_mm < 0.5, "{}", piece.error_mm);
        // A mask with the blade's own outline would cut off what lies beyond it, and not give back what is missing.
        let outline = |t: DVec2| ((t - 0.5) * 80.0 / DVec2::new(30.0, 16.0)).length() < 1.0;
        assert!(flat_with(&ellipse(|_| 0.0), &outline).is_none());
        assert!(flat_with(&ellipse(|_| 0.0), &|_| true).is_some());
    }

    #[test]
    fn wavy_blades_and_those_that_have_large_holes_get_none() {
        let wavy = ellipse(|x| 3.0 * (x / 4.0).sin());
        assert!(flat(&wavy, &rings(&wavy).unwrap(), 4, None).is_none());
        let mut hollow = ellipse(|_| 0.0);
        // The six rings in the middle are a quarter of the area.
        hollow.indices.retain({
            let outer: Vec<u32> = (1 + 5 * 48..hollow.positions.len() as u32).collect();
            move |k| outer.contains(k)
        });
        assert!(hollow.indices.len().is_multiple_of(3));
        assert!(flat(&hollow, &rings(&hollow).unwrap(), 4, None).is_none());
    }
}
