//! The trimmed mesh: a constrained Delaunay triangulation of the outline and a grid of inner points, lifted to the
//! relief.

use super::TexelGrid;
use super::outline::{contours, coverage, simplify};
use super::relief::{BladeRelief, integrate};
use mesophyll_base::rgb::Rgb;
use spade::{ConstrainedDelaunayTriangulation, HasPosition, Point2, Triangulation};

/// The mesh of the blade. Vertices are in mm (x right, y up, z out of the front). Both sides share one triangle list.
#[derive(Debug, Clone, Default)]
pub struct BladeMesh {
    /// Vertices (mm).
    pub positions: Vec<[f32; 3]>,
    /// Unit normals out of the front.
    pub normals: Vec<[f32; 3]>,
    /// Unit tangents along +u and the handedness w: bitangent = w · normal × tangent.
    pub tangents: Vec<[f32; 4]>,
    /// Place of each vertex in the front's maps, 0 to 1, v down.
    pub uvs: Vec<[f32; 2]>,
    /// Three vertices a triangle, counter-clockwise seen from the front.
    pub indices: Vec<u32>,
    /// Outline rings in mm (holes run the other way round).
    pub outline: Vec<Vec<[f64; 2]>>,
    /// Blade area (mm²), holes left out.
    pub area: f64,
    /// Root mean square of the part of the slopes that no height explains.
    pub slope_residual: f64,
}

/// How far the simplified outline may lie from the traced one (texels).
const TOLERANCE: f64 = 0.2;

#[derive(Debug, Clone, Copy)]
struct Vertex(Point2<f64>);

impl HasPosition for Vertex {
    type Scalar = f64;
    fn position(&self) -> Point2<f64> {
        self.0
    }
}

/// Reconstructs the blade. `slopes` are [dz/dx, dz/dy] of each texel, `None` where unknown. `ratio` is the light box's
/// photograph with the leaf over that without it. `None` when the mask holds no piece large enough to outline.
pub fn build(
    grid: &TexelGrid,
    mask: &[bool],
    ratio: Option<&[Rgb<f32>]>,
    slopes: &[Option<[f64; 2]>],
) -> Option<BladeMesh> {
    let field = coverage(mask, ratio, grid.size());
    let mut rings: Vec<Vec<[f64; 2]>> =
        contours(&field, 0.5).iter().map(|r| simplify(r, TOLERANCE)).filter(|r| r.len() >= 3).collect();
    // A piece or hole of less than four texels is noise of the mask, not a shape.
    rings.retain(|r| super::outline::area(r).abs() >= 4.0);
    if rings.is_empty() {
        return None;
    }
    let spacing = (grid.width.max(grid.height) as f64 / 90.0).max(3.0);
    let relief = integrate(grid, slopes);
    // A stretch of rim whose straight edge leaves the relief is divided: a single edge from corner to corner would
    // stand off the leaf like a wall.
    let height = |p: [f64; 2]| relief.at(p[0], p[1]);
    let rings: Vec<Vec<[f64; 2]>> = rings.iter().map(|r| divided(r, spacing, TOLERANCE * grid.texel, height)).collect();
    let mut cdt: ConstrainedDelaunayTriangulation<Vertex> = ConstrainedDelaunayTriangulation::new();
    for ring in &rings {
        let handles: Vec<_> = ring.iter().filter_map(|p| cdt.insert(Vertex(Point2::new(p[0], p[1]))).ok()).collect();
        for k in 0..handles.len() {
            let (a, b) = (handles[k], handles[(k + 1) % handles.len()]);
            if a != b {
                // Simplifying may make two edges cross by a fraction of a texel. The second of them is then not
                // enforced, and the triangulation chooses its edges freely.
                cdt.try_add_constraint(a, b);
            }
        }
    }
    let (columns, rows) = ((grid.width as f64 / spacing) as usize, (grid.height as f64 / spacing) as usize);
    for j in 0..=rows {
        for i in 0..=columns {
            // Rows are staggered for well-shaped triangles.
            let p = [(i as f64 + 0.5 * (j % 2) as f64) * spacing, j as f64 * spacing];
            let reach = 0.45 * spacing;
            // The image's edge is a rim, too: the bilinear value alone would continue past it.
            let clear = [[0.0, 0.0], [reach, 0.0], [-reach, 0.0], [0.0, reach], [0.0, -reach]]
                .map(|d| [p[0] + d[0], p[1] + d[1]])
                .iter()
                .all(|q| {
                    let within = q[0] >= -0.5
                        && q[1] >= -0.5
                        && q[0] <= grid.width as f64 - 0.5
                        && q[1] <= grid.height as f64 - 0.5;
                    within && field.bilinear(q[0], q[1]) > 0.5
                });
            if clear {
                // A point can only be refused when it is not finite, which these are.
                let _ = cdt.insert(Vertex(Point2::new(p[0], p[1])));
            }
        }
    }
    let mut blade = BladeMesh { slope_residual: relief.residual, ..BladeMesh::default() };
    for v in cdt.vertices() {
        push_vertex(&mut blade, grid, &relief, [v.position().x, v.position().y]);
    }
    for face in cdt.inner_faces() {
        let [a, b, c] = face.vertices();
        let centre = [0, 1].map(|k| {
            let get = |p: Point2<f64>| if k == 0 { p.x } else { p.y };
            (get(a.position()) + get(b.position()) + get(c.position())) / 3.0
        });
        // Points that divide a straight edge lie on it except for rounding, so slivers may appear outside of them. They
        // are left out.
        let area = triangle_area(a.position(), b.position(), c.position());
        if area > 1e-9 * spacing * spacing && inside(&rings, centre) {
            // Spade's faces run counter-clockwise in (column, row); rows point down, so the order is reversed for z up.
            blade.indices.extend([a.fix().index() as u32, c.fix().index() as u32, b.fix().index() as u32]);
            blade.area += area * grid.texel * grid.texel;
        }
    }
    blade.outline = rings.iter().map(|r| r.iter().map(|p| grid.position(p[0], p[1])).collect()).collect();
    Some(blade)
}

/// The ring (texels) with every edge cut into as few equal parts as keep each part within `gap` (mm) of the relief's
/// `height` (mm). Parts need not be shorter than the `spacing` of the inner points, because the triangles there are no
/// closer to the relief.
fn divided(ring: &[[f64; 2]], spacing: f64, gap: f64, height: impl Fn([f64; 2]) -> f64) -> Vec<[f64; 2]> {
    let mut out = Vec::with_capacity(ring.len());
    for (k, a) in ring.iter().enumerate() {
        let b = ring[(k + 1) % ring.len()];
        let length = (b[0] - a[0]).hypot(b[1] - a[1]);
        let along = |t: f64| [0, 1].map(|c: usize| a[c] + (b[c] - a[c]) * t);
        let keeps = |parts: usize| {
            let at = |i: usize| i as f64 / parts as f64;
            (0..parts).all(|i| {
                let (from, to) = (height(along(at(i))), height(along(at(i + 1))));
                // The relief is linear between texels, so looking at every half texel is enough.
                let looks = (2.0 * length / parts as f64).ceil().max(2.0) as usize;
                (1..looks).all(|k| {
                    let t = k as f64 / looks as f64;
                    (height(along(at(i) + t / parts as f64)) - from - t * (to - from)).abs() <= gap
                })
            })
        };
        let most = (length / spacing).ceil().max(1.0) as usize;
        let parts = (1..most).find(|&parts| keeps(parts)).unwrap_or(most);
        out.extend((0..parts).map(|i| along(i as f64 / parts as f64)));
    }
    out
}

fn push_vertex(blade: &mut BladeMesh, grid: &TexelGrid, relief: &BladeRelief, texel: [f64; 2]) {
    let [x, y] = grid.position(texel[0], texel[1]);
    let [p, q] = relief.slope(texel[0], texel[1]);
    let n = 1.0 / (1.0 + p * p + q * q).sqrt();
    let t = 1.0 / (1.0 + p * p).sqrt();
    blade.positions.push([x as f32, y as f32, relief.at(texel[0], texel[1]) as f32]);
    blade.normals.push([(-p * n) as f32, (-q * n) as f32, n as f32]);
    blade.tangents.push([t as f32, 0.0, (p * t) as f32, 1.0]);
    blade.uvs.push(grid.uv([x, y]));
}

fn triangle_area(a: Point2<f64>, b: Point2<f64>, c: Point2<f64>) -> f64 {
    0.5 * ((b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y)).abs()
}

/// Even–odd rule over all rings.
fn inside(rings: &[Vec<[f64; 2]>], p: [f64; 2]) -> bool {
    let mut odd = false;
    for ring in rings {
        for k in 0..ring.len() {
            let (a, b) = (ring[k], ring[(k + 1) % ring.len()]);
            if (a[1] > p[1]) != (b[1] > p[1]) && p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) {
                odd = !odd;
            }
        }
    }
    odd
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(a: [f64; 3]) -> [f64; 3] {
        let n = dot(a, a).sqrt();
        a.map(|v| v / n)
    }

    fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    }

    fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    }

    #[test]
    fn a_blade_that_is_cut_by_the_images_edge_has_a_rim_as_smooth_as_its_inside() {
        let grid = TexelGrid { width: 160, height: 120, texel: 0.08 };
        let mask = vec![true; grid.width * grid.height];
        // z = 0.3 sin(1.5 x) + 0.2 cos(2 y) mm: slopes up to 0.45 and 0.4, so no facet leans more than 32 degrees.
        let slopes: Vec<_> = (0..grid.width * grid.height)
            .map(|k| {
                let [x, y] = grid.position((k % 160) as f64, (k / 160) as f64);
                Some([0.45 * (1.5 * x).cos(), -0.4 * (2.0 * y).sin()])
            })
            .collect();
        let blade = build(&grid, &mask, None, &slopes).unwrap();
        let mut steepest = 0.0f64;
        for t in blade.indices.chunks_exact(3) {
            let p = [0, 1, 2].map(|k: usize| blade.positions[t[k] as usize].map(f64::from));
            let n =
                unit(cross([0, 1, 2].map(|k: usize| p[1][k] - p[0][k]), [0, 1, 2].map(|k: usize| p[2][k] - p[0][k])));
            steepest = steepest.max(n[2].acos().to_degrees());
        }
        assert!(steepest < 35.0, "{steepest}");
        let want = 160.0 * 120.0 * 0.08 * 0.08;
        assert!((blade.area / want - 1.0).abs() < 0.02, "{} {want}", blade.area);
    }

    #[test]
    fn rim_edges_keep_to_the_relief_or_are_as_short_as_the_inside_is_fine() {
        // A wave of 20 texels and .5 mm across a square's rim; gap .05 mm.
        let height = |p: [f64; 2]| 0.5 * (p[0] * std::f64::consts::TAU / 20.0).sin();
        let square = [[0.0, 0.0], [90.0, 0.0], [90.0, 60.0], [0.0, 60.0]];
        for spacing in [2.0, 3.0, 6.0] {
            let ring = divided(&square, spacing, 0.05, height);
            // Along the wave the edge is divided. Across the wave, where the height is constant, it is not.
            assert_eq!(ring.iter().filter(|p| p[0] == 90.0).count(), 2, "{spacing}");
            for (k, a) in ring.iter().enumerate() {
                let b = ring[(k + 1) % ring.len()];
                let length = (b[0] - a[0]).hypot(b[1] - a[1]);
                let off = (0..=100).map(|i| f64::from(i) / 100.0).map(|t| {
                    let p = [0, 1].map(|c: usize| a[c] + (b[c] - a[c]) * t);
                    (height(p) - height(*a) * (1.0 - t) - height(b) * t).abs()
                });
                let off = off.fold(0.0, f64::max);
                assert!(off < 0.055 || length <= spacing * 1.001, "{spacing}: {a:?} {b:?} is off by {off}");
            }
        }
    }

    #[test]
    fn an_ellipse_with_a_hole_becomes_a_mesh_of_its_area() {
        let grid = TexelGrid { width: 120, height: 90, texel: 0.5 };
        let on = |x: f64, y: f64| (x / 25.0).powi(2) + (y / 18.0).powi(2) < 1.0 && (x - 5.0).hypot(y) > 4.0;
        let (mut mask, mut slopes) = (Vec::new(), Vec::new());
        for k in 0..grid.width * grid.height {
            let [x, y] = grid.position((k % 120) as f64, (k / 120) as f64);
            mask.push(on(x, y));
            slopes.push(on(x, y).then_some([0.02 * x, -0.01 * y]));
        }
        let blade = build(&grid, &mask, None, &slopes).unwrap();
        let want = std::f64::consts::PI * (25.0 * 18.0 - 16.0);
        assert!((blade.area / want - 1.0).abs() < 0.01, "{} {want}", blade.area);
        // every triangle faces the front
        for t in blade.indices.chunks_exact(3) {
            let p = [0, 1, 2].map(|k: usize| blade.positions[t[k] as usize].map(f64::from));
            let n = cross([0, 1, 2].map(|k: usize| p[1][k] - p[0][k]), [0, 1, 2].map(|k: usize| p[2][k] - p[0][k]));
            assert!(n[2] > 0.0);
        }
        // normals lean as the slopes say
        for (p, n) in blade.positions.iter().zip(&blade.normals) {
            // At the edge the slope is a mean over the inner side of the smoothing: 0.02/mm times about 1.5 mm.
            assert!((f64::from(-n[0] / n[2]) - 0.02 * f64::from(p[0])).abs() < 0.05, "{p:?} {n:?}");
        }
    }
}
