//! The leaves of a far plant as rectangles, and the order in which they are left out.

use crate::geometry::ball;
use crate::scene::{Instance, Interior, LeafMaterial, Mesh, Side};
use crate::thinning::ranks;
use glam::{Mat3, Vec3};

/// The number of leaves that are chosen by their moments; the others follow in an order that looks random.
const HERDED: usize = 512;
/// The largest number of leaves that are compared for this.
const COMPARED: usize = 1 << 23;
/// Turns by which the smallest rectangle is looked for.
const TURNS: usize = 18;
/// Moments of a leaf.
const MOMENTS: usize = 30;

/// A leaf as a rectangle.
#[derive(Clone, Copy)]
pub(super) struct Card {
    pub middle: Vec3,
    /// Half of its sides.
    pub sides: [Vec3; 2],
    /// Out of its front.
    pub normal: Vec3,
    /// Light that it sends back from its front and from its back, and what it lets through.
    pub sends: [f32; 3],
}

impl Card {
    pub(super) fn area(&self) -> f32 {
        4.0 * self.sides[0].cross(self.sides[1]).length()
    }

    /// The same where an instance of its mesh stands.
    pub(super) fn placed(&self, instance: &Instance) -> Card {
        let m = Mat3::from_mat4(instance.transform);
        Card {
            middle: instance.transform.transform_point3(self.middle),
            sides: self.sides.map(|side| m * side),
            normal: (m * self.normal).normalize_or(Vec3::Z),
            sends: self.sends,
        }
    }

    /// The sunlight that it sends towards a view.
    pub(super) fn sent(&self, view: Vec3, sun: Vec3) -> f32 {
        let (front, cosine) = (self.normal.dot(view) > 0.0, self.normal.dot(sun));
        cosine.abs() * if (cosine > 0.0) == front { self.sends[usize::from(!front)] } else { self.sends[2] }
    }
}

/// The smallest rectangle around a mesh along its vector area, made as large as that is.
pub(super) fn rectangle(mesh: &Mesh, sends: [f32; 3]) -> Card {
    let p = |k: u32| mesh.positions[k as usize];
    let area: Vec3 = mesh.indices.chunks_exact(3).map(|t| 0.5 * (p(t[1]) - p(t[0])).cross(p(t[2]) - p(t[0]))).sum();
    let normal = area.normalize_or(Vec3::Z);
    let (first, second) = normal.any_orthonormal_pair();
    let reach = |axis: Vec3| {
        let along = mesh.positions.iter().map(|p| p.dot(axis));
        along.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
    };
    let turned = |k: usize| {
        let (sin, cos) = (std::f32::consts::FRAC_PI_2 * k as f32 / TURNS as f32).sin_cos();
        let axes = [cos * first + sin * second, cos * second - sin * first];
        (axes, axes.map(reach))
    };
    let size = |reach: &[[f32; 2]; 2]| reach.map(|[low, high]| 0.5 * (high - low).max(1e-6));
    let smallest = (0..TURNS).map(turned).min_by(|a, b| {
        let [a, b] = [&a.1, &b.1].map(|reach| size(reach).iter().product::<f32>());
        a.total_cmp(&b)
    });
    let (axes, reach) = smallest.unwrap_or_else(|| turned(0));
    let half = size(&reach);
    let even = (0.25 * area.length() / (half[0] * half[1])).sqrt();
    let middle = [0, 1].map(|k| 0.5 * (reach[k][0] + reach[k][1]) * axes[k]);
    let high = ball(&mesh.positions).0.dot(normal) * normal;
    Card { middle: middle[0] + middle[1] + high, sides: [0, 1].map(|k| even * half[k] * axes[k]), normal, sends }
}

/// What a side sends back and what it lets through to the other side, the means over its maps (green).
pub(super) fn means(leaf: &LeafMaterial, side: Side) -> [f32; 2] {
    let maps = &leaf.sides[side];
    let mean = |values: &mut dyn Iterator<Item = f32>| {
        let (sum, count) = values.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
        if count > 0.0 { sum / count } else { 0.0 }
    };
    match &maps.interior {
        Interior::Maps { rho_d, rho_t } => [rho_d, rho_t].map(|map| mean(&mut map.iter().map(|c| c[1]))),
        Interior::Scalars(curve) => {
            let gamma =
                if maps.gamma_delta.is_empty() { 1.0 } else { mean(&mut maps.gamma_delta.iter().map(|c| c[1])) };
            let [d, t] = [&curve.rho_d, &curve.rho_t].map(|points| mean(&mut points.iter().map(|c| c[1])));
            [gamma * d, t]
        }
    }
}

/// A rank from 0 to 1 for each leaf. The first ones are chosen so that any number of them has the moments of all.
pub(super) fn order(cards: &[Card]) -> Vec<f32> {
    let n = cards.len();
    let mut out = ranks(n);
    let middle = cards.iter().map(|c| c.middle).sum::<Vec3>() / n.max(1) as f32;
    let reach = cards.iter().map(|c| c.middle.distance(middle)).fold(1e-3, f32::max);
    let mut moments: Vec<[f32; MOMENTS]> = cards.iter().map(|c| moments(c, (c.middle - middle) / reach)).collect();
    let mean_area = cards.iter().map(Card::area).sum::<f32>() / n.max(1) as f32;
    let mut mean = [0.0f32; MOMENTS];
    for (own, card) in moments.iter_mut().zip(cards) {
        own.iter_mut().for_each(|m| *m *= card.area() / mean_area.max(1e-30));
        mean.iter_mut().zip(&*own).for_each(|(sum, m)| *sum += m / n as f32);
    }
    // All moments count alike.
    let mut spread = [0.0f32; MOMENTS];
    for own in &moments {
        spread.iter_mut().zip(own).zip(&mean).for_each(|((sum, m), mean)| *sum += (m - mean).powi(2) / n as f32);
    }
    for own in &mut moments {
        for ((m, mean), spread) in own.iter_mut().zip(&mean).zip(&spread) {
            *m = (*m - mean) / spread.sqrt().max(1e-6);
        }
    }
    let mut first = Vec::new();
    let mut taken = vec![false; n];
    let mut sum = [0.0f32; MOMENTS];
    for _ in 0..HERDED.min(n / 4).min(COMPARED / n.max(1)) {
        // The leaf with which the sum of the moments is smallest.
        let after = |own: &[f32; MOMENTS]| own.iter().zip(&sum).map(|(m, sum)| (m + sum).powi(2)).sum::<f32>();
        let left = (0..n).filter(|k| !taken[*k]).map(|k| (after(&moments[k]), k));
        let Some((_, best)) = left.min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        taken[best] = true;
        sum.iter_mut().zip(&moments[best]).for_each(|(sum, m)| *sum += m);
        first.push(best);
    }
    let mut others: Vec<usize> = (0..n).filter(|k| !taken[*k]).collect();
    others.sort_by(|a, b| out[*a].total_cmp(&out[*b]));
    for (place, k) in first.into_iter().chain(others).enumerate() {
        out[k] = (place as f32 + 0.5) / n as f32;
    }
    out
}

/// The moments of a leaf at a place of the unit ball: of its normal, of its place and of both.
fn moments(card: &Card, place: Vec3) -> [f32; MOMENTS] {
    let (n, p) = (card.normal.to_array(), place.to_array());
    let mut out = [0.0; MOMENTS];
    out[0] = 1.0;
    out[1..4].copy_from_slice(&n);
    out[4..7].copy_from_slice(&p);
    let both = |a: [f32; 3], b: [f32; 3]| [a[0] * b[1], a[1] * b[2], a[2] * b[0]];
    out[7..10].copy_from_slice(&both(n, n));
    out[10..13].copy_from_slice(&n.map(|x| x * x));
    out[13..16].copy_from_slice(&both(p, p));
    out[16..19].copy_from_slice(&p.map(|x| x * x));
    for (k, n) in n.iter().enumerate() {
        out[19 + 3 * k..22 + 3 * k].copy_from_slice(&p.map(|p| n * p));
    }
    let outwards = card.normal.dot(place);
    out[28] = outwards * outwards;
    out[29] = place.length_squared() * place.length_squared();
    out
}
