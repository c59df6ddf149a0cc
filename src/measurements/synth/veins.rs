//! A vein network that is grown, not drawn. Primaries come from the outline, curved secondaries from the primaries.
//! Tertiaries are cross-veins and veins grown by space colonisation (Runions et al. 2005: veins grow towards auxin
//! sources spread over the lamina), whose tips join into meshes. Lengths in mm.

use super::colonisation::colonise;
use super::outline::BladeContour;
use super::spec::{VeinSpec, Venation};
use mesophyll_base::random::RandomStream;
use std::f64::consts::PI;

/// A straight piece of a vein; radii (half widths) at both ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VeinPiece {
    pub a: [f64; 2],
    pub b: [f64; 2],
    pub radius: [f64; 2],
}

/// The network, by order: primaries, secondaries, tertiaries.
#[derive(Debug, Clone, Default)]
pub struct VeinNetwork {
    pub orders: [VeinIndex; 3],
}

/// Pieces of veins, with a grid to find those near a point.
#[derive(Debug, Clone, Default)]
pub struct VeinIndex {
    list: Vec<VeinPiece>,
    /// Cells row by row, over the square −reach … reach in both directions.
    grid: Vec<Vec<u32>>,
    /// Cells from the origin to the edge.
    half: i32,
}

/// Edge of a grid cell (mm).
const CELL: f64 = 1.5;

/// The grid cell that holds a point.
pub fn cell(p: [f64; 2]) -> (i32, i32) {
    ((p[0] / CELL).floor() as i32, (p[1] / CELL).floor() as i32)
}

pub fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

impl VeinIndex {
    /// An empty set for pieces within `reach` mm of the origin.
    fn new(reach: f64) -> VeinIndex {
        let half = (reach / CELL).ceil() as i32 + 1;
        VeinIndex { list: Vec::new(), grid: vec![Vec::new(); (4 * half * half) as usize], half }
    }

    fn slot(&self, (i, j): (i32, i32)) -> Option<usize> {
        let (h, inside) = (self.half, |k: i32| (-self.half..self.half).contains(&k));
        (inside(i) && inside(j)).then(|| ((i + h) * 2 * h + j + h) as usize)
    }

    fn push(&mut self, piece: VeinPiece) {
        let k = self.list.len() as u32;
        let (lo, hi) = (
            cell([piece.a[0].min(piece.b[0]), piece.a[1].min(piece.b[1])]),
            cell([piece.a[0].max(piece.b[0]), piece.a[1].max(piece.b[1])]),
        );
        for i in lo.0..=hi.0 {
            for j in lo.1..=hi.1 {
                if let Some(slot) = self.slot((i, j)) {
                    self.grid[slot].push(k);
                }
            }
        }
        self.list.push(piece);
    }

    pub fn list(&self) -> &[VeinPiece] {
        &self.list
    }

    /// Distance to the nearest piece, and the vein's radius there; `None` where no piece is within `reach`.
    pub fn nearest(&self, p: [f64; 2], reach: f64) -> Option<(f64, f64)> {
        let (i, j) = cell(p);
        let mut best: Option<(f64, f64)> = None;
        let rings = (reach / CELL).ceil() as i32;
        for ring in 0..=rings {
            // Anything in this ring is at least (ring − 1) cells away.
            if let Some((d, _)) = best
                && d <= f64::from(ring - 1) * CELL
            {
                break;
            }
            for a in -ring..=ring {
                for b in -ring..=ring {
                    if a.abs().max(b.abs()) != ring {
                        continue;
                    }
                    let Some(slot) = self.slot((i + a, j + b)) else { continue };
                    for &k in &self.grid[slot] {
                        let piece = self.list[k as usize];
                        let d = [piece.b[0] - piece.a[0], piece.b[1] - piece.a[1]];
                        let length2 = (d[0] * d[0] + d[1] * d[1]).max(1e-18);
                        let t = (((p[0] - piece.a[0]) * d[0] + (p[1] - piece.a[1]) * d[1]) / length2).clamp(0.0, 1.0);
                        let away = distance(p, [piece.a[0] + t * d[0], piece.a[1] + t * d[1]]);
                        if away <= reach && best.is_none_or(|(d, _)| away < d) {
                            best = Some((away, piece.radius[0] + t * (piece.radius[1] - piece.radius[0])));
                        }
                    }
                }
            }
        }
        best
    }
}

impl VeinNetwork {
    pub fn grow(blade: &BladeContour, veins: &VeinSpec, seed: u64) -> VeinNetwork {
        let reach = blade.reach();
        let mut network = VeinNetwork { orders: [0, 1, 2].map(|_| VeinIndex::new(reach)) };
        let primaries = primaries(blade, veins);
        for line in &primaries {
            add(&mut network.orders[0], line, 0.5 * veins.width_mm[0]);
        }
        for line in secondaries(blade, veins, &primaries, seed) {
            add(&mut network.orders[1], &line, 0.5 * veins.width_mm[1]);
        }
        if let Some([a, b]) = blade.petiole() {
            let r = 0.5 * veins.width_mm[0];
            network.orders[0].push(VeinPiece { a, b, radius: [r, r] });
        }
        if veins.tertiary_mm > 0.0 {
            network.orders[2] = cross_veins(blade, veins, &network, seed);
            for piece in colonise(blade, veins, &network, seed) {
                network.orders[2].push(piece);
            }
        }
        network
    }
}

/// Adds a polyline whose radius tapers to a fifth along its length.
fn add(pieces: &mut VeinIndex, line: &[[f64; 2]], radius: f64) {
    let n = line.len();
    let at = |k: usize| radius * (1.0 - 0.8 * k as f64 / n as f64);
    for k in 1..n {
        pieces.push(VeinPiece { a: line[k - 1], b: line[k], radius: [at(k - 1), at(k)] });
    }
}

fn primaries(blade: &BladeContour, veins: &VeinSpec) -> Vec<Vec<[f64; 2]>> {
    let fractions = |n: usize| (0..=n).map(move |k| k as f64 / n as f64);
    match veins.kind {
        Venation::Pinnate => vec![fractions(200).map(|t| blade.place(t * 0.985, 0.0)).collect()],
        Venation::Parallel => {
            let midrib: Vec<[f64; 2]> = fractions(200).map(|t| blade.place(t * 0.985, 0.0)).collect();
            vec![midrib]
        }
        Venation::Palmate => {
            let n = veins.count.max(1);
            let spread = 2.0 * veins.angle_deg;
            (0..n)
                .map(|k| {
                    let angle = if n == 1 { 0.0 } else { -spread + 2.0 * spread * k as f64 / (n - 1) as f64 };
                    // Each bows a little outwards and ends short of the margin.
                    let mut line = vec![blade.base];
                    let (mut p, mut heading) = (blade.base, angle * 1.06);
                    for _ in 0..1000 {
                        heading -= 0.12 * angle / 60.0;
                        let (s, c) = heading.to_radians().sin_cos();
                        p = [p[0] + 0.4 * c, p[1] + 0.4 * s];
                        if !blade.holds([p[0] + 0.8 * c, p[1] + 0.8 * s]) {
                            break;
                        }
                        line.push(p);
                    }
                    line
                })
                .collect()
        }
    }
}

fn secondaries(blade: &BladeContour, veins: &VeinSpec, primaries: &[Vec<[f64; 2]>], seed: u64) -> Vec<Vec<[f64; 2]>> {
    let mut lines = Vec::new();
    let jitter = |k: usize, side: f64, what: u64| {
        veins.jitter * RandomStream::new(seed, &[0x5ec, k as u64, u64::from(side > 0.0), what]).signed()
    };
    match veins.kind {
        Venation::Pinnate => {
            for side in [1.0, -1.0] {
                for k in 0..veins.count {
                    // Secondaries are closer together towards base and tip, and the two sides are not exactly opposite.
                    let u =
                        (k as f64 + 0.5 + 0.25 * side * veins.jitter + 0.4 * jitter(k, side, 0)) / veins.count as f64;
                    let t0 = 0.02 + 0.95 * u * (1.0 - 0.12 * (1.0 - u));
                    // The angle is wider at the base, where lobes beside the petiole need veins, too.
                    let angle = veins.angle_deg
                        * (1.08 - 0.25 * u + 0.55 * (-u * 9.0).exp())
                        * (1.0 + 0.1 * jitter(k, side, 1));
                    lines.push(pinnate(blade, t0, side, angle, veins.arch, (seed, k)));
                }
            }
        }
        Venation::Parallel => {
            for side in [1.0, -1.0] {
                for k in 0..veins.count {
                    let f = (k as f64 + 1.0 + 0.25 * jitter(k, side, 0)) / (veins.count as f64 + 0.6);
                    let line = (0..=240).map(|i| {
                        let t = 0.01 + 0.975 * i as f64 / 240.0;
                        blade.place(t, side * f * blade.half_width(t, side > 0.0))
                    });
                    lines.push(line.collect());
                }
            }
        }
        Venation::Palmate => {
            for (p, primary) in primaries.iter().enumerate() {
                let length = primary.len();
                for side in [1.0, -1.0] {
                    for k in 0..5 {
                        let at = length as f64
                            * (0.30
                                + 0.15 * (k as f64 + 0.5 * f64::from(side > 0.0) + 0.4 * jitter(p * 7 + k, side, 0)));
                        let at = (at as usize).clamp(1, length - 1);
                        let (a, b) = (primary[at - 1], primary[at]);
                        let heading = (b[1] - a[1]).atan2(b[0] - a[0]);
                        let mut angle = heading + side * (0.78 + 0.15 * jitter(p * 7 + k, side, 1));
                        let mut point = b;
                        let mut line = vec![b];
                        for _ in 0..400 {
                            angle -= side * 0.012 * veins.arch;
                            let (s, c) = angle.sin_cos();
                            point = [point[0] + 0.35 * c, point[1] + 0.35 * s];
                            let ahead = [point[0] + 0.6 * c, point[1] + 0.6 * s];
                            let met =
                                primaries.iter().enumerate().any(|(q, other)| {
                                    q != p && other.iter().step_by(2).any(|v| distance(*v, point) < 1.0)
                                }) || lines.iter().any(|other: &Vec<[f64; 2]>| {
                                    other.iter().skip(6).step_by(2).any(|v| distance(*v, point) < 0.8)
                                });
                            if met || !blade.holds(ahead) {
                                break;
                            }
                            line.push(point);
                        }
                        if line.len() > 6 {
                            lines.push(line);
                        }
                    }
                }
            }
        }
    }
    lines
}

/// A secondary from the midrib at t0 towards the margin; with `arch` it turns along the margin before it gets there.
fn pinnate(
    blade: &BladeContour,
    t0: f64,
    side: f64,
    angle_deg: f64,
    arch: f64,
    (seed, k): (u64, usize),
) -> Vec<[f64; 2]> {
    let mut p = blade.place(t0, 0.0);
    let mut line = vec![p];
    let wobble = RandomStream::new(seed, &[0xb0b, k as u64, u64::from(side > 0.0)]).signed();
    for step in 0..2000 {
        let [t, s] = blade.along(p);
        let f = (s * side / blade.half_width(t, side > 0.0).max(1e-6)).clamp(0.0, 1.2);
        // Straight at first, then up along the margin.
        let turn = arch * (0.25 * f + 0.75 * f.powi(4));
        let wave = 2.0 * (step as f64 * 0.06 + 3.0 * wobble).sin() * wobble;
        let heading = (angle_deg * (1.0 - turn) + wave).to_radians() * side;
        let (sin, cos) = heading.sin_cos();
        p = [p[0] + 0.3 * cos, p[1] + 0.3 * sin];
        let limit = if arch > 0.5 { 0.94 } else { 1.2 };
        if f > limit || t > 0.985 || !blade.holds(p) {
            break;
        }
        line.push(p);
    }
    line
}

/// Cross-veins run from each secondary across the lamina until they meet another vein, like the rungs of a ladder.
fn cross_veins(blade: &BladeContour, veins: &VeinSpec, network: &VeinNetwork, seed: u64) -> VeinIndex {
    let mut grown = VeinIndex::new(blade.reach());
    let radius = 0.5 * veins.width_mm[2];
    let pitch = |k: u64| veins.tertiary_mm * (1.0 + 0.35 * RandomStream::new(seed, &[0xc055, k]).signed());
    // Between primaries that fan out there is lamina that no secondary crosses.
    let parents = if veins.kind == Venation::Palmate { 0..2 } else { 1..2 };
    let mut count = 0u64;
    for order in parents {
        let mut until_next = 0.5 * veins.tertiary_mm;
        let pieces = network.orders[order].list.clone();
        for piece in &pieces {
            until_next -= distance(piece.a, piece.b);
            if until_next > 0.0 {
                continue;
            }
            until_next += pitch(count);
            count += 1;
            let mut s = RandomStream::new(seed, &[0xc0, count, order as u64]);
            let along = (piece.b[1] - piece.a[1]).atan2(piece.b[0] - piece.a[0]);
            // On the side that faces the tip; on the midribs of a fan, on both sides in turn.
            let side = if (order == 0 && count.is_multiple_of(2)) || along > 0.0 { -1.0 } else { 1.0 };
            let heading = along + side * (PI / 2.0 - 0.15 + 0.2 * s.signed());
            let (mut p, mut line) = (piece.b, vec![piece.b]);
            let (phase, swing) = (6.3 * s.uniform(), 0.25 + 0.3 * s.uniform());
            let step = 0.12;
            for k in 0..150 {
                let (sin, cos) = (heading + swing * (phase + 1.9 * f64::from(k) * step).sin()).sin_cos();
                p = [p[0] + step * cos, p[1] + step * sin];
                if !blade.holds(p) {
                    break;
                }
                line.push(p);
                let met = (0..2).any(|o| network.orders[o].nearest(p, step).is_some())
                    || grown.nearest(p, 0.8 * step).is_some();
                if k > 3 && met {
                    break;
                }
            }
            for w in line.windows(2) {
                grown.push(VeinPiece { a: w[0], b: w[1], radius: [radius, radius] });
            }
        }
    }
    grown
}
