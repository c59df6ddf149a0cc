//! A plant in the wind: where its branches are when each is bent by an amplitude of its own, and what hangs on them.
//!
//! A branch's axis at rest is a line of points, not a straight beam. Its bend is that of the straight beam from its
//! root to its tip ([`mesophyll_plant::length`]): the piece of the axis at the share x is turned as the beam is turned
//! there, in one plane and about one direction across it. So each piece keeps its length, and a straight axis becomes
//! the bent beam itself. The sum over the pieces needs no quadrature: along a bent beam ∫ cos and ∫ sin of the turn
//! are its places along and across.
//!
//! A branch follows the cross-section of its parent where it grows, rigidly, and then bends in its own frame; leaves
//! follow the cross-section of theirs, and may turn on it by themselves. An amplitude of 0 changes no number.

use crate::form::{Branch, Joint, Plant, nearest};
use glam::{DMat3, DMat4, DVec3};
use mesophyll_plant::beam::{TAPER_MAX, TAPER_MIN};
use mesophyll_plant::length::{Bent, bend_with};
use mesophyll_plant::quadrature::gauss;
use mesophyll_plant::taper::Shape;
use std::sync::LazyLock;

/// Rule and Newton steps of the arc's length: to 1e-9 of it for small bends. For tips at
/// [`FURTHEST`] it is right to 3e-8 at a taper of .01, and to 5e-6 at 1e-4, the thinnest.
static NODES: LazyLock<Vec<(f64, f64)>> = LazyLock::new(|| gauss(12));
const STEPS: usize = 5;

/// A tip's deflection over the branch's length, as a beam's without its length kept, that no wind exceeds: beyond it a
/// beam says nothing. Deflections are as they come up to [`FREELY`] and approach this one above.
pub const FURTHEST: f64 = 1.0;
/// Up to here a deflection is as it comes.
pub const FREELY: f64 = 0.75;

/// The posed axis has a point wherever it turned by this angle (rad): its length as a line of points is then right to
/// 1e-6.
const FINE: f64 = 0.005;

/// Sections that carry bark lie at multiples of this share of a branch: a vertex is carried by the nearest. On a branch
/// that is bent by a radian its place is then off by 1e-4 of the branch's radius.
pub const SECTION_STEP: f64 = 1.0 / 8192.0;

/// A rigid motion: what a cross-section of a branch does to all that hangs on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rigid {
    /// A point at rest.
    pub from: DVec3,
    /// Where it goes.
    pub to: DVec3,
    /// How directions turn.
    pub turn: DMat3,
}

impl Rigid {
    /// Nothing moves.
    pub const STILL: Rigid = Rigid { from: DVec3::ZERO, to: DVec3::ZERO, turn: DMat3::IDENTITY };

    /// Where a point goes.
    pub fn place(&self, point: DVec3) -> DVec3 {
        self.to + self.turn * (point - self.from)
    }

    /// Where a frame goes.
    pub fn carry(&self, frame: DMat4) -> DMat4 {
        if *self == Rigid::STILL {
            return frame;
        }
        let [x, y, z] = [frame.x_axis, frame.y_axis, frame.z_axis].map(|a| (self.turn * a.truncate()).extend(0.0));
        DMat4::from_cols(x, y, z, self.place(frame.w_axis.truncate()).extend(1.0))
    }

    /// The same motion in another frame, into which `place` turns, moves and scales alike along all axes.
    pub fn moved(&self, place: DMat4) -> Rigid {
        let turn = DMat3::from_mat4(place) * place.determinant().cbrt().recip();
        let [from, to] = [self.from, self.to].map(|p| place.transform_point3(p));
        Rigid { from, to, turn: turn * self.turn * turn.transpose() }
    }

    /// First `inner`, then this.
    fn after(&self, inner: &Rigid) -> Rigid {
        if *self == Rigid::STILL {
            return *inner;
        }
        Rigid { from: inner.from, to: self.place(inner.to), turn: self.turn * inner.turn }
    }
}

/// What bends of a branch, in the plant's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Limb {
    parent: Option<(usize, f64)>,
    /// Where it begins.
    root: DVec3,
    /// Orthonormal: t from root to tip, r and s across it.
    pub axes: [DVec3; 3],
    /// Along the axis (mm); 0 bends nowhere.
    pub length: f64,
    shape: Shape<f64>,
    /// Where a piece of the axis begins: the share of the length, the place, and the piece's unit direction.
    pieces: Vec<(f64, DVec3, DVec3)>,
    /// The tip's deflection for an amplitude of 1, small bends, over the length.
    pub tip: f64,
}

/// All branches of a plant at rest, ready to be bent.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Limbs(pub Vec<Limb>);

impl Limb {
    fn new(branch: &Branch, shape: &impl Fn(f64) -> Shape<f64>) -> Limb {
        let frame = branch.frame();
        let t = branch.chord().try_normalize().unwrap_or(branch.axes[0]);
        let across = branch.axes[1] - t * t.dot(branch.axes[1]);
        let r = across.try_normalize().unwrap_or_else(|| t.any_orthonormal_vector());
        let length = branch.length();
        let mut pieces = Vec::new();
        let mut before = 0.0;
        for w in branch.axis.windows(2) {
            let step = w[0].distance(w[1]);
            if step > 0.0 && length > 0.0 {
                let [place, end] = [w[0], w[1]].map(|p| frame.transform_point3(p));
                pieces.push((before / length, place, (end - place).normalize()));
                before += step;
            }
        }
        let shape = shape(branch.taper().clamp(TAPER_MIN, TAPER_MAX));
        let (root, parent) = (branch.root, branch.parent.map(|j| (j.branch, j.at)));
        let mut limb = Limb { parent, root, axes: [t, r, t.cross(r)], length, shape, pieces, tip: 0.0 };
        let tip: f64 = limb.pieces.iter().enumerate().map(|(k, p)| limb.rise(k) * t.dot(p.2)).sum();
        // A curled axis reaches less far, but no bend makes up for more than half of it.
        limb.tip = tip.max(0.5 * limb.shape.tip());
        limb
    }

    /// By how much the beam's deflection grows along piece `k`, for an amplitude of 1.
    fn rise(&self, k: usize) -> f64 {
        let end = self.pieces.get(k + 1).map_or(1.0, |p| p.0);
        self.shape.at(end).0 - self.shape.at(self.pieces[k].0).0
    }
}

/// A bent branch.
#[derive(Debug, Clone)]
struct Swung {
    /// What the place where it grows does to it.
    base: Rigid,
    size: f64,
    /// In the plane of bending and across it, at rest.
    e: DVec3,
    b: DVec3,
    /// Of every piece's beginning: along and across the beam, and its place before the base moves it.
    marks: Vec<(f64, f64, DVec3)>,
}

/// A plant's branches at one time.
#[derive(Debug, Clone)]
pub struct Pose<'a> {
    limbs: &'a Limbs,
    swung: Vec<Swung>,
    /// How every leaf turns before its branch carries it; empty where none does.
    leaves: Vec<Rigid>,
}

/// A size of 0 or more that stays as it is up to `free`, and approaches `furthest` above.
pub fn limited(size: f64, free: f64, furthest: f64) -> f64 {
    let room = furthest - free;
    if size <= free { size } else { free + room * ((size - free) / room).tanh() }
}

impl Limbs {
    /// `shape` gives the coefficients of a taper.
    pub fn new(plant: &Plant, shape: impl Fn(f64) -> Shape<f64>) -> Limbs {
        Limbs(plant.branches.iter().map(|b| Limb::new(b, &shape)).collect())
    }

    /// All branches, each bent by its amplitude towards r and s: F/(E′r₁⁴) over the length, as
    /// [`mesophyll_plant::branch`] has it. What is not finite bends nothing.
    pub fn pose(&self, amplitudes: impl Fn(usize) -> [f64; 2]) -> Pose<'_> {
        let mut pose = Pose { limbs: self, swung: Vec::with_capacity(self.0.len()), leaves: Vec::new() };
        for (k, limb) in self.0.iter().enumerate() {
            // Parents stand before what grows on them.
            let base = limb.parent.map_or(Rigid::STILL, |(parent, at)| pose.at(parent, at));
            let [t, r, s] = limb.axes;
            let [x, y] = amplitudes(k);
            let wanted = x.hypot(y);
            let whole = limb.shape.tip();
            let bends = wanted > 0.0 && wanted.is_finite() && limb.length > 0.0;
            let size = if bends { limited(wanted * whole, FREELY, FURTHEST) / whole } else { 0.0 };
            let e = if bends { (x * r + y * s) / wanted } else { r };
            let mut swung = Swung { base, size, e, b: t.cross(e), marks: Vec::with_capacity(limb.pieces.len()) };
            if bends {
                let mut place = limb.pieces.first().map_or(limb.root, |p| p.1);
                for (n, piece) in limb.pieces.iter().enumerate() {
                    let bent = swung.bent(limb, piece.0);
                    if n > 0 {
                        place = swung.end(limb, n - 1, piece.0, &bent);
                    }
                    swung.marks.push((bent.along, bent.across, place));
                }
            }
            pose.swung.push(swung);
        }
        pose
    }
}

impl Swung {
    fn bent(&self, limb: &Limb, x: f64) -> Bent<f64> {
        bend_with(&limb.shape, x, self.size, &NODES, STEPS)
    }

    /// Where the axis is at `x`, within piece `k`, before the base moves it.
    fn end(&self, limb: &Limb, k: usize, x: f64, bent: &Bent<f64>) -> DVec3 {
        let (begin, _, way) = limb.pieces[k];
        let (along, across, place) = self.marks[k];
        let (t, e, b) = (limb.axes[0], self.e, self.b);
        let (da, dc) = (bent.along - along, bent.across - across);
        let turned = way.dot(t) * (da * t + dc * e) + way.dot(e) * (da * e - dc * t) + way.dot(b) * (x - begin) * b;
        place + limb.length * turned
    }
}

impl Pose<'_> {
    /// The same with leaves that turn by themselves: how each moves from rest, in the plant's frame.
    pub fn with_leaves(self, leaves: Vec<Rigid>) -> Self {
        Pose { leaves, ..self }
    }

    /// How leaf `k` of the plant moves from rest, which hangs at `joint`.
    pub fn leaf(&self, k: usize, joint: Joint) -> Rigid {
        let carried = self.at(joint.branch, joint.at);
        self.leaves.get(k).map_or(carried, |own| carried.after(own))
    }

    /// What the cross-section of branch `k` at `at` (0 root, 1 tip) does to what hangs on it: in the plant's frame, from
    /// rest. A branch that is not there moves nothing.
    pub fn at(&self, k: usize, at: f64) -> Rigid {
        let (Some(limb), Some(swung)) = (self.limbs.0.get(k), self.swung.get(k)) else { return Rigid::STILL };
        if swung.marks.is_empty() {
            return swung.base;
        }
        let x = at.clamp(0.0, 1.0);
        let piece = limb.pieces.partition_point(|p| p.0 <= x).saturating_sub(1);
        let bent = swung.bent(limb, x);
        let (begin, place, way) = limb.pieces[piece];
        let (t, e) = (limb.axes[0], swung.e);
        let rest = DMat3::from_cols(t, e, swung.b);
        let after = DMat3::from_cols(bent.cos * t + bent.sin * e, bent.cos * e - bent.sin * t, swung.b);
        let own = Rigid {
            from: place + way * ((x - begin) * limb.length),
            to: swung.end(limb, piece, x, &bent),
            turn: after * rest.transpose(),
        };
        swung.base.after(&own)
    }

    /// Where the tip of branch `k` is.
    pub fn tip(&self, k: usize) -> DVec3 {
        self.point(k, 1.0)
    }

    /// Where the axis of branch `k` is at `at`.
    pub fn point(&self, k: usize, at: f64) -> DVec3 {
        let Some(limb) = self.limbs.0.get(k) else { return DVec3::ZERO };
        let piece = limb.pieces.partition_point(|p| p.0 <= at).saturating_sub(1);
        let rest = limb.pieces.get(piece).map_or(limb.root, |p| p.1 + p.2 * ((at - p.0) * limb.length));
        self.at(k, at).place(rest)
    }

    /// Shares at which a posed axis has points: those of the axis at rest, `wanted`, and as many as the bend asks for.
    fn shares(&self, k: usize, axis: &[DVec3], wanted: impl Iterator<Item = f64>) -> Vec<f64> {
        let (limb, swung) = (&self.limbs.0[k], &self.swung[k]);
        let mut known: Vec<f64> = limb.pieces.iter().map(|p| p.0).chain(wanted).chain([1.0]).collect();
        known.sort_by(f64::total_cmp);
        known.dedup_by(|a, b| *a - *b < 1e-12);
        let turn = |x: f64| {
            let bent = swung.bent(limb, x);
            bent.sin.atan2(bent.cos)
        };
        let mut out = Vec::with_capacity(2 * axis.len());
        for w in known.windows(2) {
            let mut open = vec![(w[0], w[1], turn(w[0]), turn(w[1]), 0)];
            while let Some((low, high, before, after, depth)) = open.pop() {
                if after - before > FINE && depth < 12 {
                    let middle = 0.5 * (low + high);
                    let there = turn(middle);
                    open.push((middle, high, there, after, depth + 1));
                    open.push((low, middle, before, there, depth + 1));
                } else {
                    out.push(low);
                }
            }
        }
        out.push(1.0);
        out
    }

    /// The plant as it stands at this time, `rest` being the one whose limbs these are.
    pub fn plant(&self, rest: &Plant) -> Plant {
        let mut out = rest.clone();
        let mut grown: Vec<Vec<f64>> = vec![Vec::new(); rest.branches.len()];
        for joint in rest.branches.iter().filter_map(|b| b.parent) {
            grown[joint.branch].push(joint.at);
        }
        for (k, (branch, wanted)) in out.branches.iter_mut().zip(grown).enumerate() {
            let base = self.swung[k].base;
            if !self.swung[k].marks.is_empty() {
                // Everything of a branch is in its own frame, which moves with its base.
                let (own, frame) = (Rigid { ..base }, branch.frame());
                let local = own.carry(frame).inverse();
                let axis = std::mem::take(&mut branch.axis);
                branch.axis = self
                    .shares(k, &axis, wanted.into_iter())
                    .into_iter()
                    .map(|x| local.transform_point3(self.point(k, x)))
                    .collect();
                let wood = &mut branch.wood;
                let turned = |turn: DMat3, v: DVec3| local.transform_vector3(turn * frame.transform_vector3(v));
                for v in 0..wood.positions.len() {
                    let here = self.at(k, nearest(&axis, wood.positions[v]).0);
                    wood.positions[v] = local.transform_point3(here.place(frame.transform_point3(wood.positions[v])));
                    wood.normals[v] = turned(here.turn, wood.normals[v]);
                    wood.tangents[v].0 = turned(here.turn, wood.tangents[v].0);
                }
            }
            if base != Rigid::STILL {
                branch.root = base.place(branch.root);
                branch.axes = branch.axes.map(|a| base.turn * a);
            }
        }
        for (k, leaf) in out.leaves.iter_mut().enumerate() {
            leaf.transform = self.leaf(k, leaf.joint).carry(leaf.transform);
        }
        out
    }
}

#[cfg(test)]
mod tests;
