//! Finds which branch grows on which: a branch's root lies nearest to the surface of its parent, or inside the parent.
//!
//! The thickest tube is the trunk. A tube whose ends differ in thickness begins at the thick end. One with ends of
//! equal thickness may begin at either. For every tube, the tubes that its root may stand on get a weight ([`weight`]).
//! From the trunk on, every tube whose best parent is in the tree joins the tree. When none is left, the thickest of
//! the remaining tubes counts as not attached, and its own branches join it.
//!
//! A tube whose root stands on a piece that is no tube is not attached either: what carries it is not known.

use super::BranchPiece;
use super::axis::TaperedTube;
use super::other_pieces::Refused;
use crate::form::nearest;
use glam::DVec3;
use rayon::prelude::*;

/// The largest gap between a root and the surface of its parent, in radii of the root. A root may also lie inside the
/// parent.
const GAP: f64 = 1.5;
/// The least thickness of a parent relative to the branch that grows on it.
const THICKNESS: f64 = 0.6;
/// A tube may begin at either end if the thinner end has at least this share of the thickness of the other.
const ALIKE: f64 = 0.9;
/// Penalty for a root at the place where the parent itself begins, because siblings share that place.
const BROTHER: f64 = 1.0;
/// The largest difference in height between the roots of other trunks and the first one's, as a share of the plant's
/// size.
const GROUND: f64 = 0.03;

/// A place that a tube's root may stand on.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    parent: usize,
    /// Whether the tube's thin end is its root there.
    turned: bool,
    /// The smaller the weight, the more likely the parent.
    weight: f64,
    gap: f64,
}

impl TaperedTube {
    /// The box around the axis, and the largest radius.
    pub(super) fn around(&self) -> (DVec3, DVec3, f64) {
        let (low, high) = self
            .axis
            .iter()
            .fold((DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY)), |(a, b), p| (a.min(*p), b.max(*p)));
        (low, high, self.root_radius.max(self.tip_radius))
    }
}

/// How unlikely a parent is. The weight grows with the root's distance from the parent's surface, in the child's radii,
/// and with its distance from the parent's axis, in the parent's radii.
fn weight(gap: f64, distance: f64, child: f64, parent: f64) -> f64 {
    gap.max(0.0) / child + 0.3 * (distance / parent).min(3.0)
}

fn candidates(tubes: &[TaperedTube], boxes: &[(DVec3, DVec3, f64)], refused: &[Refused], k: usize) -> Choice {
    let tube = &tubes[k];
    let alike = tube.tip_radius >= ALIKE * tube.root_radius;
    let mut out = Vec::new();
    let mut near: Option<(usize, f64)> = None;
    let mut ends = Vec::new();
    for turned in [false, true] {
        if turned && !alike {
            continue;
        }
        let (end, radius) =
            if turned { (tube.axis.last(), tube.tip_radius) } else { (tube.axis.first(), tube.root_radius) };
        let Some(end) = end.copied() else { continue };
        let reach = GAP * radius;
        ends.push((end, reach));
        for (j, (low, high, thick)) in boxes.iter().enumerate() {
            let outside = (*low - end).max(end - *high).max(DVec3::ZERO).length() - thick;
            if j == k || outside > near.map_or(f64::INFINITY, |(_, gap)| gap.max(reach)) {
                continue;
            }
            let (at, distance) = nearest(&tubes[j].axis, end);
            let there = tubes[j].radius(at);
            let gap = distance - there;
            if near.is_none_or(|(_, least)| gap < least) {
                near = Some((j, gap));
            }
            if gap > reach || there < THICKNESS * radius {
                continue;
            }
            let mut weight = weight(gap, distance, radius, there);
            if at * tubes[j].length() < there.max(radius) {
                // Siblings are about as thick as each other, whereas a branch at the foot of a trunk is thinner than
                // the trunk.
                if radius > 0.8 * there && tubes[j].tip_radius < ALIKE * tubes[j].root_radius {
                    continue;
                }
                weight += BROTHER;
            }
            out.push(Candidate { parent: j, turned, weight, gap });
        }
    }
    out.sort_by(|a, b| a.weight.total_cmp(&b.weight).then(a.parent.cmp(&b.parent)));
    // A tube that it stands in, or that is nearer, is its parent all the same.
    let least = out.first().map_or(f64::INFINITY, |best| best.gap);
    let gaps = || ends.iter().flat_map(|(end, reach)| refused.iter().filter_map(|piece| piece.within(*end, *reach)));
    let stands = if least > 0.0 { gaps().min_by(f64::total_cmp).filter(|gap| *gap < least) } else { None };
    if stands.is_some() {
        out.clear();
    }
    Choice { candidates: out, near, stands }
}

/// What a tube may stand on.
struct Choice {
    /// The most likely one first.
    candidates: Vec<Candidate>,
    /// The nearest surface of all other tubes, for a tube without candidates.
    near: Option<(usize, f64)>,
    /// The gap to a piece that is no tube, where the tube stands on that.
    stands: Option<f64>,
}

/// Finds every tube's parent. The `piece` of a branch is the index of its tube. Parents stand before what grows on
/// them. `refused` are the triangles of each piece that is no tube.
pub fn attach(tubes: Vec<TaperedTube>, refused: Vec<Vec<[DVec3; 3]>>) -> Vec<BranchPiece> {
    let boxes: Vec<_> = tubes.iter().map(TaperedTube::around).collect();
    let refused: Vec<Refused> = refused.into_iter().map(Refused::new).collect();
    let all: Vec<Choice> = (0..tubes.len()).into_par_iter().map(|k| candidates(&tubes, &boxes, &refused, k)).collect();
    // The thickest tubes come first.
    let mut order: Vec<usize> = (0..tubes.len()).collect();
    order.sort_by(|a, b| tubes[*b].root_radius.total_cmp(&tubes[*a].root_radius).then(a.cmp(b)));
    let size =
        boxes.iter().fold((DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY)), |(a, b), (p, q, _)| {
            (a.min(*p), b.max(*q))
        });
    let size = (size.1 - size.0).length();
    let mut place: Vec<Option<usize>> = vec![None; tubes.len()];
    let mut out: Vec<BranchPiece> = Vec::with_capacity(tubes.len());
    // A tube waits until its best parent is in the tree.
    let mut waiting: Vec<Vec<usize>> = vec![Vec::new(); tubes.len()];
    for (k, choice) in all.iter().enumerate() {
        if let Some(best) = choice.candidates.first() {
            waiting[best.parent].push(k);
        }
    }
    for first in &order {
        if place[*first].is_some() {
            continue;
        }
        // In a ring of tubes, each is the best parent of the next. The ring is opened where a member has another parent
        // in the tree.
        let ring = out_of_ring(*first, &all, &place);
        let (start, candidate) = ring.map_or((*first, None), |(k, c)| (k, Some(c)));
        let mut next = vec![(start, candidate)];
        while let Some((k, candidate)) = next.pop() {
            if place[k].is_some() {
                continue;
            }
            place[k] = Some(out.len());
            let mut branch = match candidate {
                Some(c) => joined(&tubes[k], c, &all[k].candidates, &place, &out),
                None => rootless(&tubes[k], &all[k], &tubes, &place, &out, size),
            };
            branch.piece = k;
            out.push(branch);
            next.extend(waiting[k].iter().map(|child| (*child, all[*child].candidates.first().copied())));
        }
    }
    out
}

/// The member of a ring with the most likely other parent in the tree, and that parent.
fn out_of_ring(first: usize, all: &[Choice], place: &[Option<usize>]) -> Option<(usize, Candidate)> {
    let (mut at, mut seen) = (first, Vec::new());
    while !seen.contains(&at) {
        seen.push(at);
        match all[at].candidates.first() {
            Some(best) if place[best.parent].is_none() => at = best.parent,
            _ => break,
        }
    }
    let others = seen.iter().flat_map(|k| all[*k].candidates.iter().map(move |c| (*k, *c)));
    others.filter(|(_, c)| place[c.parent].is_some()).min_by(|a, b| a.1.weight.total_cmp(&b.1.weight))
}

fn joined(
    tube: &TaperedTube,
    c: Candidate,
    list: &[Candidate],
    place: &[Option<usize>],
    out: &[BranchPiece],
) -> BranchPiece {
    let parent = place[c.parent].unwrap_or(0);
    // The parent's tube has the direction that it got when it was attached.
    let tube = if c.turned { tube.turned() } else { tube.clone() };
    let (at, _) = nearest(&out[parent].tube.axis, tube.axis[0]);
    let second = list.iter().filter(|o| o.parent != c.parent).map(|o| o.weight).fold(f64::INFINITY, f64::min);
    let lead = if second.is_finite() { (second - c.weight).max(0.0) } else { f64::INFINITY };
    let clear = if lead.is_finite() { lead / (lead + 0.15) } else { 1.0 };
    let touching = 1.0 - 0.5 * (c.gap.max(0.0) / (GAP * tube.root_radius.max(f64::MIN_POSITIVE))).min(1.0);
    BranchPiece {
        piece: 0,
        level: out[parent].level.map(|l| l + 1),
        parent: Some(parent),
        at,
        confidence: clear * touching,
        unattached: None,
        tube,
    }
}

/// Adds a trunk, or a branch that nothing carries.
fn rootless(
    tube: &TaperedTube,
    choice: &Choice,
    tubes: &[TaperedTube],
    place: &[Option<usize>],
    out: &[BranchPiece],
    size: f64,
) -> BranchPiece {
    let branch = BranchPiece {
        piece: 0,
        tube: tube.clone(),
        parent: None,
        at: 0.0,
        level: Some(0),
        confidence: 1.0,
        unattached: None,
    };
    let unknown = |why: String| BranchPiece { level: None, confidence: 0.0, unattached: Some(why), ..branch.clone() };
    if let Some(gap) = choice.stands {
        return unknown(format!("its root is {:.3} mm from a piece that is no tube, see others.csv", gap));
    }
    let trunk = out.iter().find(|b| b.unattached.is_none()).map(|b| &b.tube);
    let Some(trunk) = trunk else { return branch };
    let up = (trunk.axis[trunk.axis.len() - 1] - trunk.axis[0]).normalize_or(DVec3::Y);
    let beside = (tube.axis[0] - trunk.axis[0]).dot(up).abs() < GROUND * size;
    if beside && tube.root_radius > 0.25 * trunk.root_radius {
        return branch;
    }
    let why = match choice.near.and_then(|(k, gap)| Some((place[k]?, gap, tubes[k].root_radius))) {
        Some((k, gap, _)) if gap > GAP * tube.root_radius => {
            format!("the nearest branch is b{k}, whose surface is {gap:.3} mm from its root")
        }
        Some((k, _, thick)) => {
            format!("the only branch near its root is b{k}, which is {thick:.3} mm thick at its own")
        }
        None => "no branch in the tree is near its root".into(),
    };
    unknown(why)
}
