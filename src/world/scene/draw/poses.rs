//! Hands the branches of plants that move to the GPU renderer, which poses them on the adapter. Places are those of
//! `flora::pose`, in world space; they become single only after everything has been counted from a branch's root.

use crate::placed::winds::{SwayingPlant, SwayingPlants};
use glam::{DMat3, DMat4, DVec3, Vec3};
use mesophyll_plants::pose::{LengthConstraint, Limb};
use mesophyll_viewer::scene as viewer;
use rayon::prelude::*;
use std::sync::Arc;

/// The number of leaves whose turns are worth a thread of their own.
const SHARE: usize = 256;

/// Everything that the adapter needs to pose the plants of a scene.
pub fn poses(winds: &Arc<SwayingPlants>, lengths: LengthConstraint) -> viewer::PoseHierarchy {
    let mut out = viewer::PoseHierarchy {
        limbs: Vec::new(),
        pieces: Vec::new(),
        seats: Vec::new(),
        closed_form: lengths == LengthConstraint::ClosedForm,
        amplitudes: Arc::new(winds.amplitudes()),
        turns: None,
    };
    for (_, swaying, place) in winds.places() {
        add(&mut out, swaying, place);
    }
    if winds.plants.iter().flatten().any(|s| s.flutter.is_some()) {
        out.turns = Some(Arc::new(turns(winds.clone())));
    }
    out
}

/// The angle of every section: those of leaves that flutter, and 0.
fn turns(winds: Arc<SwayingPlants>) -> impl Fn(f64) -> Vec<f32> + Send + Sync {
    move |time| {
        let of_place = |(_, swaying, place): (usize, &SwayingPlant, usize)| {
            let count = swaying.sections.on().len();
            let Some(flutter) = &swaying.flutter else { return vec![0.0; count] };
            let leaves = (0..flutter.leaves()).into_par_iter().with_min_len(SHARE);
            let mut all: Vec<f32> = leaves.map(|leaf| flutter.turn(place, leaf, time) as f32).collect();
            all.resize(count, 0.0);
            all
        };
        winds.places().flat_map(of_place).collect()
    }
}

/// A plant at one of its places.
fn add(out: &mut viewer::PoseHierarchy, swaying: &SwayingPlant, place: usize) {
    let to_world = swaying.sections.places()[place];
    let scale = to_world.determinant().cbrt();
    let turn = DMat3::from_mat4(to_world) * scale.recip();
    let first = out.limbs.len() as u32;
    let limbs = &swaying.limbs.0;
    for limb in limbs {
        // Where it grows on the axis of its parent.
        let joint = limb.parent.map(|(parent, at)| {
            let at = at.clamp(0.0, 1.0);
            let (piece, point) = limbs[parent].rest(at).unwrap_or((0, limbs[parent].root));
            (parent, at, piece, point)
        });
        let pieces = out.pieces.len() as u32;
        out.pieces.extend(limb.pieces.iter().map(|(begin, at, way)| viewer::AxisPiece {
            begin: *begin as f32,
            place: (turn * (*at - limb.root) * scale).as_vec3(),
            way: (turn * *way).as_vec3(),
        }));
        if limb.pieces.is_empty() {
            out.pieces.push(viewer::AxisPiece { begin: 0.0, place: Vec3::ZERO, way: (turn * limb.axes[0]).as_vec3() });
        }
        let shape = limb.shape.single();
        out.limbs.push(viewer::PoseLimb {
            root: to_world.transform_point3(limb.root).as_vec3(),
            axes: [limb.axes[0], limb.axes[1]].map(|a| (turn * a).as_vec3()),
            length: (limb.length * scale) as f32,
            taper: [shape.alpha, shape.ln_alpha, shape.ell],
            coefficients: shape.a,
            parent: joint.map(|(parent, ..)| first + parent as u32),
            at: joint.map_or((0.0, 0), |(_, at, piece, _)| (at as f32, piece as u32)),
            offset: joint.map_or(Vec3::ZERO, |(.., point)| (turn * (limb.root - point) * scale).as_vec3()),
            pieces: [pieces, out.pieces.len() as u32 - pieces],
        });
    }
    let frame = Frame { to_world, turn, scale };
    for (k, (branch, share)) in swaying.sections.on().iter().enumerate() {
        let hang = swaying.flutter.as_ref().filter(|f| k < f.leaves()).map(|f| f.hang(k));
        out.seats.push(seat(&frame, first + *branch as u32, &limbs[*branch], share.clamp(0.0, 1.0), hang));
    }
}

/// A plant's place in the world.
struct Frame {
    to_world: DMat4,
    turn: DMat3,
    scale: f64,
}

fn seat(frame: &Frame, limb: u32, of: &Limb, share: f64, hang: Option<(DVec3, DVec3)>) -> viewer::SectionSeat {
    let (piece, axis) = of.rest(share).unwrap_or((0, of.root));
    let (point, about) = hang.unwrap_or((axis, of.axes[0]));
    viewer::SectionSeat {
        limb,
        share: share as f32,
        piece: piece as u32,
        from: frame.to_world.transform_point3(point).as_vec3(),
        offset: (frame.turn * (point - axis) * frame.scale).as_vec3(),
        axis: (frame.turn * about).as_vec3(),
    }
}
