//! Directions: a grid on the ball of what is found for some of them and asked for any, and terms of a fit.

use glam::{Vec2, Vec3};
use std::sync::OnceLock;

/// Nodes along each side of the grid, an odd number.
const SIDE: usize = 33;
/// Numbers of polynomials of a direction, of products of two, and of terms of a view and a sun.
const POLYNOMIALS: usize = 16;
const PRODUCTS: usize = POLYNOMIALS * (POLYNOMIALS + 1) / 2;
pub(super) const TERMS: usize = PRODUCTS + 4;

/// What is found at the nodes of a grid of directions, each where it is first asked for. The grid is the ball's
/// octahedron unfolded (Meyer et al. 2010, "On floating-point normal vectors"), with nodes on its rim.
pub(super) struct OnDirections<T>(Vec<OnceLock<T>>);

impl<T> OnDirections<T> {
    pub(super) fn new() -> OnDirections<T> {
        OnDirections((0..SIDE * SIDE).map(|_| OnceLock::new()).collect())
    }

    /// What is found at the four nodes around a direction, with their shares.
    pub(super) fn around(&self, d: Vec3, find: impl Fn(Vec3) -> T) -> [(&T, f32); 4] {
        let at = unfolded(d).min(Vec2::splat((SIDE - 1) as f32 - 1e-3));
        let (first, t) = (at.floor(), at - at.floor());
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| {
            let (column, row) = (first.x as usize + i, first.y as usize + j);
            let share = |t: f32, k: usize| if k == 1 { t } else { 1.0 - t };
            (self.at(column, row, &find), share(t.x, i) * share(t.y, j))
        })
    }

    /// What is found at the node that is nearest to a direction.
    pub(super) fn nearest(&self, d: Vec3, find: impl Fn(Vec3) -> T) -> &T {
        let at = unfolded(d).round();
        self.at(at.x as usize, at.y as usize, &find)
    }

    fn at(&self, column: usize, row: usize, find: &impl Fn(Vec3) -> T) -> &T {
        self.0[row * SIDE + column].get_or_init(|| find(node(column, row)))
    }
}

/// The place of a direction on the grid, in nodes.
fn unfolded(d: Vec3) -> Vec2 {
    let flat = d.truncate() / (d.x.abs() + d.y.abs() + d.z.abs());
    let folded = (1.0 - Vec2::new(flat.y, flat.x).abs()) * Vec2::ONE.copysign(flat);
    let last = (SIDE - 1) as f32;
    (0.5 * last * (if d.z < 0.0 { folded } else { flat } + 1.0)).clamp(Vec2::ZERO, Vec2::splat(last))
}

/// The direction of a node.
fn node(column: usize, row: usize) -> Vec3 {
    let flat = Vec2::new(column as f32, row as f32) * (2.0 / (SIDE - 1) as f32) - 1.0;
    let z = 1.0 - flat.x.abs() - flat.y.abs();
    let folded = (1.0 - Vec2::new(flat.y, flat.x).abs()) * Vec2::ONE.copysign(flat);
    (if z < 0.0 { folded } else { flat }).extend(z).normalize()
}

/// Directions that are spread evenly over the ball down to this height.
pub(super) fn spread(count: usize, low: f32) -> Vec<Vec3> {
    let one = |k: usize| {
        let z = low + (1.0 - low) * (k as f32 + 0.5) / count as f32;
        let (sin, cos) = (2.399_963_2 * k as f32).sin_cos();
        let flat = (1.0 - z * z).sqrt();
        Vec3::new(flat * cos, flat * sin, z)
    };
    (0..count).map(one).collect()
}

/// Polynomials of a direction up to the third order, each as good as orthogonal to the others.
fn polynomials(d: Vec3) -> [f32; POLYNOMIALS] {
    let Vec3 { x, y, z } = d;
    let (x2, y2, z2) = (x * x, y * y, z * z);
    let second = [x * y, y * z, z * x, x2 - y2, 3.0 * z2 - 1.0];
    let [u, v] = [5.0 * z2 - 1.0, 5.0 * z2 - 3.0];
    let third = [y * (3.0 * x2 - y2), x * y * z, y * u, z * v, x * u, z * (x2 - y2), x * (x2 - 3.0 * y2)];
    let mut out = [1.0, x, y, z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    out[4..9].copy_from_slice(&second);
    out[9..].copy_from_slice(&third);
    out
}

/// Terms of what all leaves send from a sun to an eye. It stays the same where the two are exchanged, so products of
/// polynomials count once. What is brighter where the eye is near the sun and sees no shadow has terms of its own.
pub(super) fn terms(view: Vec3, sun: Vec3) -> [f32; TERMS] {
    let (own, other) = (polynomials(view), polynomials(sun));
    let mut out = [0.0; TERMS];
    let pairs = (0..POLYNOMIALS).flat_map(|i| (0..=i).map(move |j| (i, j)));
    out.iter_mut().zip(pairs).for_each(|(term, (i, j))| *term = 0.5 * (own[i] * other[j] + own[j] * other[i]));
    let cosine = view.dot(sun);
    let near = |wide: f32| ((cosine - 1.0) / wide).exp();
    out[PRODUCTS..].copy_from_slice(&[cosine.powi(4), near(0.3), near(0.08), near(0.02)]);
    out
}
