//! Hands plants that move to the GPU renderer: the sections that carry leaves and bark, for each time.

use super::poses::poses;
use crate::placed::PlacedScene;
use crate::placed::sections::BarkMotion;
use glam::DQuat;
use mesophyll_plants::pose::{LengthConstraint, RigidMotion};
use mesophyll_viewer::scene as viewer;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The sections that carry the vertices of bark, in one list. A plant at many places has its vertices in the list once.
#[derive(Default)]
pub struct BarkSections {
    of_vertices: Vec<u32>,
    known: BTreeMap<*const Vec<u32>, u32>,
}

impl BarkSections {
    /// How the vertices of a wood are carried, and after them those of its levels of detail: each as the vertex of the
    /// wood that `on_ring` names.
    pub fn carried(&mut self, bark: &BarkMotion, on_ring: &[u32]) -> viewer::SectionBinding {
        let begin = *self.known.entry(Arc::as_ptr(&bark.of_vertices)).or_insert_with(|| {
            let begin = self.of_vertices.len() as u32;
            self.of_vertices.extend(bark.of_vertices.iter());
            self.of_vertices.extend(on_ring.iter().map(|k| bark.of_vertices[*k as usize]));
            begin
        });
        viewer::SectionBinding { first: bark.first as u32, vertices: Some(begin) }
    }
}

/// Hands over the plants that move: what the adapter needs to pose them for pictures, and a table of sections for each
/// time, computed in double precision, for everything else. In `simplified`
/// motion (H9 §4.8), lengths of branches are corrected in closed form, and normals do not turn.
pub fn plants(placed: &PlacedScene, simplified: bool, barks: BarkSections, out: &mut viewer::Scene) {
    let Some(winds) = placed.winds.clone() else { return };
    let lengths = if simplified { LengthConstraint::ClosedForm } else { LengthConstraint::Kept };
    let poses = Some(Arc::new(poses(&winds, lengths)));
    let section = |r: &RigidMotion| viewer::SectionMotion {
        from: r.from.as_vec3(),
        to: r.to.as_vec3(),
        turn: DQuat::from_mat3(&r.turn).as_quat(),
    };
    out.sections = Some(viewer::SectionAnimation {
        count: winds.section_count(),
        of_vertices: Arc::new(barks.of_vertices),
        turn_normals: !simplified,
        poses,
        at: Arc::new(move |time| winds.sections_with(lengths, time).iter().map(section).collect()),
    });
}
