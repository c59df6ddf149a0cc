//! The bend of `passes/bend.wgsl` on the CPU, in single precision. It tells what the shadow maps and clipping planes
//! must cover, and what is under the pointer. Pictures use the shader alone.

use crate::scene::{Branch, Carried, Instance, Ride, Scene, Section, Sections, Wind};
use glam::{Vec2, Vec3};

/// Abscissae and weights of the four-point Gauss rule on 0 to 1.
const NODES: [(f32, f32); 4] = [
    (0.069_431_84, 0.173_927_42),
    (0.330_009_5, 0.326_072_57),
    (0.669_990_5, 0.326_072_57),
    (0.930_568_16, 0.173_927_42),
];

/// All branches and sections at one time.
#[derive(Debug, Clone)]
pub(crate) struct Bends<'a> {
    branches: &'a [Branch],
    amplitudes: Vec<Vec2>,
    sections: Vec<Section>,
    of_vertices: &'a [u32],
}

/// What moves an instance: a branch, a section, or nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Moved {
    pub ride: Option<Ride>,
    pub carried: Option<Carried>,
}

impl Moved {
    pub(crate) fn of(instance: &Instance) -> Moved {
        Moved { ride: instance.ride, carried: instance.carried }
    }

    /// Whether anything moves it.
    pub(crate) fn any(&self) -> bool {
        self.ride.is_some() || self.carried.is_some()
    }

    /// Whether every vertex moves in its own way.
    pub(crate) fn by_vertex(&self) -> bool {
        self.ride.is_some_and(|r| r.at.is_none()) || self.carried.is_some_and(|c| c.vertices.is_some())
    }
}

impl Sections {
    /// All sections at the time of a wind.
    pub(crate) fn now(&self, wind: Option<&Wind>) -> Vec<Section> {
        let mut all = (self.at)(wind.map_or(0.0, |w| w.time_s));
        let still = Section { from: Vec3::ZERO, to: Vec3::ZERO, turn: glam::Quat::IDENTITY };
        all.resize(self.count, still);
        all
    }
}

impl Wind {
    /// The place of a branch in the motion texture (0 to 1, wrapped).
    pub(crate) fn place(&self, branch: &Branch) -> [f32; 2] {
        [0, 1].map(|k| (branch.start[k] + self.time_s * branch.velocity[k]).rem_euclid(1.0) as f32)
    }

    fn sample(&self, at: [f32; 2]) -> Vec2 {
        if self.size == 0 {
            return Vec2::ZERO;
        }
        let n = self.size as i64;
        let p = at.map(|c| c * self.size as f32 - 0.5);
        let low = p.map(f32::floor);
        let texel = |dx: i64, dy: i64| {
            let [x, y] = [low[0] as i64 + dx, low[1] as i64 + dy].map(|c| c.rem_euclid(n));
            Vec2::from(self.motion[(y * n + x) as usize])
        };
        let (fx, fy) = (p[0] - low[0], p[1] - low[1]);
        texel(0, 0).lerp(texel(1, 0), fx).lerp(texel(0, 1).lerp(texel(1, 1), fx), fy)
    }
}

impl<'a> Bends<'a> {
    pub(crate) fn new(branches: &'a [Branch], sections: Option<&'a Sections>, wind: Option<&Wind>) -> Bends<'a> {
        let amplitude = |b: &Branch| Vec2::from(b.still) + wind.map_or(Vec2::ZERO, |w| b.gain * w.sample(w.place(b)));
        Bends {
            branches,
            amplitudes: branches.iter().map(amplitude).collect(),
            sections: sections.map_or_else(Vec::new, |s| s.now(wind)),
            of_vertices: sections.map_or(&[], |s| &s.of_vertices),
        }
    }

    pub(crate) fn of(scene: &'a Scene) -> Bends<'a> {
        Bends::new(&scene.branches, scene.sections.as_ref(), scene.wind.as_ref())
    }

    /// The place that a point in world space moves to. In a mesh that is moved vertex by vertex, it is vertex `number`.
    pub(crate) fn moved(&self, by: Moved, number: usize, point: Vec3) -> Vec3 {
        self.bent(by, number, point, Vec3::ZERO).0
    }

    /// The same for a point and a normal.
    pub(crate) fn bent(&self, by: Moved, number: usize, point: Vec3, normal: Vec3) -> (Vec3, Vec3) {
        if let Some(carried) = by.carried {
            let own = carried.vertices.and_then(|first| self.of_vertices.get(first as usize + number));
            let index = carried.first + own.copied().unwrap_or(0);
            let Some(s) = self.sections.get(index as usize) else { return (point, normal) };
            return (s.to + s.turn * (point - s.from), s.turn * normal);
        }
        let Some((ride, b)) = by.ride.and_then(|r| Some((r, self.branches.get(r.branch)?))) else {
            return (point, normal);
        };
        let amplitude = self.amplitudes[ride.branch];
        let size = amplitude.length();
        let share = if size > 0.0 { amplitude / size } else { Vec2::X };
        let local = point - b.root;
        let along = local.dot(b.t) / b.length;
        let x = ride.at.unwrap_or(along.clamp(0.0, 1.0));
        let axis = axis(b, x, size);
        let (e, f) = (share.x * b.r + share.y * b.s, share.x * b.s - share.y * b.r);
        let turned_t = axis.cosine * b.t + axis.sine * e;
        let turned_e = axis.cosine * e - axis.sine * b.t;
        let over = local.dot(e);
        let inside = ride.at.is_none() && (0.0..=1.0).contains(&along);
        let stretch = if inside { (1.0 - axis.curvature * over / b.length).max(0.05) } else { 1.0 };
        let position = b.root
            + b.length * (axis.along * b.t + axis.across * e)
            + (along - x) * b.length * turned_t
            + over * turned_e
            + local.dot(f) * f;
        let turned = normal.dot(b.t) / stretch * turned_t + normal.dot(e) * turned_e + normal.dot(f) * f;
        (position, turned.normalize_or_zero())
    }
}

struct Axis {
    along: f32,
    across: f32,
    cosine: f32,
    sine: f32,
    curvature: f32,
}

fn coordinate(b: &Branch, x: f32) -> f32 {
    if b.alpha < 0.5 {
        return ((1.0 - x) + b.alpha * x).ln() / b.ln_alpha;
    }
    let reduced = |z: f32| (0..8).rev().fold(0.0, |sum, k| sum * z * z + 1.0 / (2 * k + 1) as f32);
    let beta = b.alpha - 1.0;
    let (at, end) = (2.0 + beta * x, 2.0 + beta);
    x * end / at * reduced(beta * x / at) / reduced(beta / end)
}

fn place(b: &Branch, y: f32) -> f32 {
    let z = y * b.ln_alpha;
    if z.abs() >= 0.5 {
        return (z.exp() - 1.0) / (b.alpha - 1.0);
    }
    y * b.ell * (2..=8).rev().fold(1.0, |sum, k| 1.0 + z * sum / k as f32)
}

fn polynomial(a: &[f32; 4], y: f32) -> [f32; 3] {
    let [p, dp, ddp] = a.iter().enumerate().rev().fold([0.0f32; 3], |[p, dp, ddp], (k, a)| {
        let n = (k + 2) as f32;
        [p * y + a, dp * y + n * a, ddp * y + n * (n - 1.0) * a]
    });
    [p * y * y, dp * y, ddp]
}

fn axis(b: &Branch, x: f32, amplitude: f32) -> Axis {
    let velocity = |y: f32| Vec2::new((y * b.ln_alpha).exp() * b.ell, amplitude * polynomial(&b.a, y)[1]);
    let [p, dp, _] = polynomial(&b.a, coordinate(b, x));
    let (u, du) = (amplitude * p, amplitude * dp / (((1.0 - x) + b.alpha * x) * b.ell));
    let slant = (1.0 + du * du).sqrt();
    let mut y = coordinate(b, (x - u * du / ((1.0 + slant) * slant)).max(0.0));
    for _ in 0..2 {
        let extra: f32 = NODES
            .iter()
            .map(|(t, g)| {
                let v = velocity(y * t);
                g * v.y * v.y / (v.length() + v.x)
            })
            .sum();
        y = (y - (place(b, y) + y * extra - x) / velocity(y).length()).clamp(0.0, 1.0);
    }
    let [p, dp, ddp] = polynomial(&b.a, y);
    let v = velocity(y);
    let speed = v.length();
    Axis {
        along: place(b, y),
        across: amplitude * p,
        cosine: v.x / speed,
        sine: v.y / speed,
        curvature: amplitude * v.x * (ddp - dp * b.ln_alpha) / speed.powi(3),
    }
}
