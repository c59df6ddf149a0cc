//! A plant in the wind: the places of its branches when each is bent by an amplitude of its own, and of what hangs on
//! them.
//!
//! A branch's axis at rest is a line of points, not a straight beam. It bends like the straight beam from its root to
//! its tip ([`crate::mechanics::length`]): the piece of the axis at the share x turns as much as the beam turns there,
//! in one plane, about one direction across it. So each piece keeps its length, and a straight axis becomes the bent
//! beam itself. The sum over the pieces needs no quadrature, because ∫ cos and ∫ sin of the turn along a bent beam are
//! its places along and across.
//!
//! A branch rigidly follows the cross-section of its parent where it grows, and then bends in its own frame. Leaves
//! follow the cross-section of their branch, and may turn on it by themselves. An amplitude of 0 changes no number.

use crate::form::{Branch, Joint, Plant, nearest};
use crate::mechanics::beam::{TAPER_MAX, TAPER_MIN};
use crate::mechanics::length::{AxisPoint, bend_with};
use crate::mechanics::quadrature::gauss;
use crate::mechanics::taper::TaperShape;
use glam::{DMat3, DMat4, DVec3};
use rayon::prelude::*;
use std::sync::LazyLock;

pub mod bark;

/// Quadrature rule and number of Newton steps for the arc's length. They are accurate to 1e-9 of it for small bends.
/// For tips at [`FURTHEST`] they are accurate to 3e-8 at a taper of .01, and to 5e-6 at 1e-4, the thinnest.
static NODES: LazyLock<Vec<(f64, f64)>> = LazyLock::new(|| gauss(12));
const STEPS: usize = 5;

/// The largest deflection of a tip over the branch's length, computed for a beam whose length is not preserved. Beyond
/// it the beam model is not valid, and no wind exceeds it. Deflections up to [`FREELY`] stay unchanged, and larger ones
/// approach this limit.
pub const FURTHEST: f64 = 1.0;
/// Up to this ratio a deflection is unchanged.
pub const FREELY: f64 = 0.75;

/// The number of branches that are worth a thread of their own.
const SHARE: usize = 64;

/// How far a bent branch keeps its length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LengthConstraint {
    /// To the accuracy of the quadrature.
    #[default]
    Kept,
    /// In closed form: a point lies on the bent curve, at the place along it that H9 Eq. 4.11 gives. A branch whose tip
    /// moves by a tenth of its length is off by up to 0.6 %, and one whose tip moves by half of it, by up to 7 %.
    ClosedForm,
}

/// The angle (rad) after which the posed axis gets a new point. The length of the line of points is then accurate to
/// 1e-6.
const FINE: f64 = 0.005;

/// A rigid motion: how a cross-section of a branch moves everything that hangs on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidMotion {
    /// A point at rest.
    pub from: DVec3,
    /// The place that the point moves to.
    pub to: DVec3,
    /// The rotation of directions.
    pub turn: DMat3,
}

impl RigidMotion {
    /// The motion that moves nothing.
    pub const STILL: RigidMotion = RigidMotion { from: DVec3::ZERO, to: DVec3::ZERO, turn: DMat3::IDENTITY };

    /// The place that a point moves to.
    pub fn place(&self, point: DVec3) -> DVec3 {
        self.to + self.turn * (point - self.from)
    }

    /// The frame after the motion.
    pub fn carry(&self, frame: DMat4) -> DMat4 {
        if *self == RigidMotion::STILL {
            return frame;
        }
        let [x, y, z] = [frame.x_axis, frame.y_axis, frame.z_axis].map(|a| (self.turn * a.truncate()).extend(0.0));
        DMat4::from_cols(x, y, z, self.place(frame.w_axis.truncate()).extend(1.0))
    }

    /// The same motion in another frame. `place`, the transform to it, is a rotation, a translation, and the same scale
    /// along all axes.
    pub fn moved(&self, place: DMat4) -> RigidMotion {
        let turn = DMat3::from_mat4(place) * place.determinant().cbrt().recip();
        let [from, to] = [self.from, self.to].map(|p| place.transform_point3(p));
        RigidMotion { from, to, turn: turn * self.turn * turn.transpose() }
    }

    /// The motion `inner`, followed by this one.
    fn after(&self, inner: &RigidMotion) -> RigidMotion {
        if *self == RigidMotion::STILL {
            return *inner;
        }
        RigidMotion { from: inner.from, to: self.place(inner.to), turn: self.turn * inner.turn }
    }
}

/// A branch as far as bending needs it, in the plant's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Limb {
    /// The branch that it grows on, and where on its axis (0 root, 1 tip).
    pub parent: Option<(usize, f64)>,
    /// The place where it begins.
    pub root: DVec3,
    /// Orthonormal vectors: t from root to tip, r and s across it.
    pub axes: [DVec3; 3],
    /// Length along the axis (mm). A branch of length 0 does not bend.
    pub length: f64,
    /// How the straight beam bends that the branch bends as.
    pub shape: TaperShape<f64>,
    /// The beginning of each piece of the axis: the share of the length, the place, and the piece's unit direction.
    pub pieces: Vec<(f64, DVec3, DVec3)>,
    /// The tip's deflection over the length for an amplitude of 1, for small bends.
    pub tip: f64,
}

/// All branches of a plant at rest, ready to be bent.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RestPose(pub Vec<Limb>);

impl Limb {
    fn new(branch: &Branch, shape: &impl Fn(f64) -> TaperShape<f64>) -> Limb {
        let frame = branch.frame();
        let t = branch.chord().try_normalize().unwrap_or(branch.axes[0]);
        let across = branch.axes[1] - t * t.dot(branch.axes[1]);
        let r = across.try_normalize().unwrap_or_else(|| t.any_orthonormal_vector());
        let length = branch.length();
        let mut pieces = Vec::new();
        for (w, share) in branch.axis.windows(2).zip(bark::shares(branch)) {
            if w[0].distance(w[1]) > 0.0 && length > 0.0 {
                let [place, end] = [w[0], w[1]].map(|p| frame.transform_point3(p));
                pieces.push((share, place, (end - place).normalize()));
            }
        }
        let shape = shape(branch.taper().clamp(TAPER_MIN, TAPER_MAX));
        let (root, parent) = (branch.root, branch.parent.map(|j| (j.branch, j.at)));
        let mut limb = Limb { parent, root, axes: [t, r, t.cross(r)], length, shape, pieces, tip: 0.0 };
        let tip: f64 = limb.pieces.iter().enumerate().map(|(k, p)| limb.rise(k) * t.dot(p.2)).sum();
        // The tip of a curled axis moves less than that of a straight beam. At most a factor of two makes up for this.
        limb.tip = tip.max(0.5 * limb.shape.tip());
        limb
    }

    /// Deflection of the tip over the length, for an amplitude of 1, of the straight beam that the branch bends as; 0
    /// for a branch without length, which does not bend. Poses limit it ([`FREELY`]).
    pub fn beam_tip(&self) -> f64 {
        if self.length > 0.0 { self.shape.tip() } else { 0.0 }
    }

    /// The piece of the axis at the share `x`, and the place there at rest; `None` for a branch without length.
    pub fn rest(&self, x: f64) -> Option<(usize, DVec3)> {
        let piece = self.pieces.partition_point(|p| p.0 <= x).saturating_sub(1);
        let (begin, place, way) = *self.pieces.get(piece)?;
        Some((piece, place + way * ((x - begin) * self.length)))
    }

    /// The growth of the beam's deflection along piece `k`, for an amplitude of 1.
    fn rise(&self, k: usize) -> f64 {
        let end = self.pieces.get(k + 1).map_or(1.0, |p| p.0);
        self.shape.at(end).0 - self.shape.at(self.pieces[k].0).0
    }
}

/// A bent branch.
#[derive(Debug, Clone)]
struct Swung {
    /// The motion of the place where it grows.
    base: RigidMotion,
    size: f64,
    /// Unit vectors in the plane of bending and across it, at rest.
    e: DVec3,
    b: DVec3,
    lengths: LengthConstraint,
    /// For the beginning of every piece: its places along and across the beam, and its place before the base moves it.
    marks: Vec<(f64, f64, DVec3)>,
}

/// A plant's branches at one time.
#[derive(Debug, Clone)]
pub struct Pose<'a> {
    limbs: &'a RestPose,
    swung: Vec<Swung>,
    /// The motion of every leaf before its branch carries it; empty where no leaf moves by itself.
    leaves: Vec<RigidMotion>,
}

/// A size (0 or more) that is unchanged up to `free` and approaches `furthest` above.
pub fn limited(size: f64, free: f64, furthest: f64) -> f64 {
    let room = furthest - free;
    if size <= free { size } else { free + room * ((size - free) / room).tanh() }
}

/// An amplitude towards r and s as poses limit it; 0 where nothing bends. `tip` is the branch's [`Limb::beam_tip`].
pub fn held([x, y]: [f64; 2], tip: f64) -> [f64; 2] {
    if !(tip > 0.0 && x.is_finite() && y.is_finite()) {
        return [0.0; 2];
    }
    // Nearly all are so small. Their squares tell it without a root, which counts where thousands bend in a frame.
    if (x * x + y * y) * (tip * tip) <= FREELY * FREELY {
        return [x, y];
    }
    let wanted = x.hypot(y) * tip;
    let kept = limited(wanted, FREELY, FURTHEST) / wanted;
    [x * kept, y * kept]
}

impl RestPose {
    /// The branches of a plant at rest. `shape` gives the beam's coefficients for a taper.
    pub fn new(plant: &Plant, shape: impl Fn(f64) -> TaperShape<f64>) -> RestPose {
        RestPose(plant.branches.iter().map(|b| Limb::new(b, &shape)).collect())
    }

    /// All branches, each bent by its amplitude towards r and s. An amplitude is F/(E′r₁⁴) over the length, as in
    /// [`crate::mechanics::branch`]. An amplitude that is not finite bends nothing.
    pub fn pose(&self, amplitudes: impl Fn(usize) -> [f64; 2] + Sync) -> Pose<'_> {
        self.pose_with(LengthConstraint::Kept, amplitudes)
    }

    /// The same, with lengths kept in this way.
    pub fn pose_with(&self, lengths: LengthConstraint, amplitudes: impl Fn(usize) -> [f64; 2] + Sync) -> Pose<'_> {
        // Each branch bends in its own frame, whatever its parent does.
        let bent = |(k, limb): (usize, &Limb)| Swung::new(limb, amplitudes(k), lengths);
        let swung = self.0.par_iter().enumerate().with_min_len(SHARE).map(bent).collect();
        let mut pose = Pose { limbs: self, swung, leaves: Vec::new() };
        for (k, limb) in self.0.iter().enumerate() {
            // Parents stand before what grows on them, so their pose is known.
            if let Some((parent, at)) = limb.parent {
                pose.swung[k].base = pose.at(parent, at);
            }
        }
        pose
    }
}

impl Swung {
    /// A branch that is bent by this amplitude, on a base that does not move.
    fn new(limb: &Limb, amplitude: [f64; 2], lengths: LengthConstraint) -> Swung {
        let [t, r, s] = limb.axes;
        let [x, y] = held(amplitude, limb.beam_tip());
        let size = x.hypot(y);
        let e = if size > 0.0 { (x / size) * r + (y / size) * s } else { r };
        let mut swung = Swung { base: RigidMotion::STILL, size, e, b: t.cross(e), lengths, marks: Vec::new() };
        if size > 0.0 {
            swung.marks.reserve(limb.pieces.len());
            let mut place = limb.pieces.first().map_or(limb.root, |p| p.1);
            for (n, piece) in limb.pieces.iter().enumerate() {
                let bent = swung.bent(limb, piece.0);
                if n > 0 {
                    place = swung.end(limb, n - 1, piece.0, &bent);
                }
                swung.marks.push((bent.along, bent.across, place));
            }
        }
        swung
    }

    fn bent(&self, limb: &Limb, x: f64) -> AxisPoint<f64> {
        let steps = match self.lengths {
            LengthConstraint::Kept => STEPS,
            LengthConstraint::ClosedForm => 0,
        };
        bend_with(&limb.shape, x, self.size, &NODES, steps)
    }

    /// The place of the axis at `x`, within piece `k`, before the base moves it.
    fn end(&self, limb: &Limb, k: usize, x: f64, bent: &AxisPoint<f64>) -> DVec3 {
        let (begin, _, way) = limb.pieces[k];
        let (along, across, place) = self.marks[k];
        let (t, e, b) = (limb.axes[0], self.e, self.b);
        let (da, dc) = (bent.along - along, bent.across - across);
        let turned = way.dot(t) * (da * t + dc * e) + way.dot(e) * (da * e - dc * t) + way.dot(b) * (x - begin) * b;
        place + limb.length * turned
    }
}

impl Pose<'_> {
    /// The same pose with leaves that turn by themselves. `leaves` are their motions from rest, in the plant's frame.
    pub fn with_leaves(self, leaves: Vec<RigidMotion>) -> Self {
        Pose { leaves, ..self }
    }

    /// The motion from rest of leaf `k` of the plant, which hangs at `joint`.
    pub fn leaf(&self, k: usize, joint: Joint) -> RigidMotion {
        let carried = self.at(joint.branch, joint.at);
        self.leaves.get(k).map_or(carried, |own| carried.after(own))
    }

    /// The motion from rest, in the plant's frame, of what hangs on the cross-section of branch `k` at `at` (0 root, 1
    /// tip). A branch that does not exist moves nothing.
    pub fn at(&self, k: usize, at: f64) -> RigidMotion {
        let (Some(limb), Some(swung)) = (self.limbs.0.get(k), self.swung.get(k)) else { return RigidMotion::STILL };
        if swung.marks.is_empty() {
            return swung.base;
        }
        let x = at.clamp(0.0, 1.0);
        let Some((piece, from)) = limb.rest(x) else { return swung.base };
        let bent = swung.bent(limb, x);
        let (t, e) = (limb.axes[0], swung.e);
        let rest = DMat3::from_cols(t, e, swung.b);
        let after = DMat3::from_cols(bent.cos * t + bent.sin * e, bent.cos * e - bent.sin * t, swung.b);
        let own = RigidMotion { from, to: swung.end(limb, piece, x, &bent), turn: after * rest.transpose() };
        swung.base.after(&own)
    }

    /// The place of the tip of branch `k`.
    pub fn tip(&self, k: usize) -> DVec3 {
        self.point(k, 1.0)
    }

    /// The place of the axis of branch `k` at `at`.
    pub fn point(&self, k: usize, at: f64) -> DVec3 {
        let Some(limb) = self.limbs.0.get(k) else { return DVec3::ZERO };
        self.at(k, at).place(limb.rest(at).map_or(limb.root, |(_, rest)| rest))
    }

    /// The shares at which a posed axis has points: those of the axis at rest, those of `wanted`, and as many more as
    /// the bend needs.
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

    /// The plant as it stands at this time. `rest` is the plant at rest, whose limbs these are.
    pub fn plant(&self, rest: &Plant) -> Plant {
        let mut out = rest.clone();
        let mut grown: Vec<Vec<f64>> = vec![Vec::new(); rest.branches.len()];
        for joint in rest.branches.iter().filter_map(|b| b.parent) {
            grown[joint.branch].push(joint.at);
        }
        for (k, (branch, wanted)) in out.branches.iter_mut().zip(grown).enumerate() {
            let base = self.swung[k].base;
            if !self.swung[k].marks.is_empty() {
                // A branch's axis and wood are in its own frame, which moves with its base.
                let (own, frame) = (RigidMotion { ..base }, branch.frame());
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
            // The bend is in the shape now.
            branch.bending_load = 0.0;
            if base != RigidMotion::STILL {
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
