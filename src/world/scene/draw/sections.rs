//! Hands plants that move to the GPU renderer: the sections that carry leaves and bark, for each time. Also plants that
//! stand in many places.

use super::poses::poses;
use crate::placed::PlacedScene;
use crate::placed::sections::BarkMotion;
use crate::placed::stand::PlacedStand;
use crate::plan::light::parts_of_sun;
use glam::{DMat4, DQuat, DVec3};
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

/// Adds the places of stands.
pub fn stands(placed: &PlacedScene, out: &mut viewer::Scene) {
    out.stands.extend(placed.stands.iter().map(|stand| {
        let place =
            |(transform, pose): &(DMat4, u32)| viewer::StandPlace { transform: transform.as_mat4(), pose: *pose };
        Arc::new(viewer::PlantStand {
            places: stand.places.iter().map(place).collect(),
            first: stand.first as u32,
            sections: stand.sections as u32,
            poses: stand.poses as u32,
        })
    }));
}

/// The number of shadow maps beyond which a scene with stands gains nothing: their texels are as wide as what stands
/// there over the maps' side, and within a texel the parts of the sun's disk are not told apart. `None` without stands.
pub fn maps_of_sun(placed: &PlacedScene, out: &viewer::Scene) -> Option<u32> {
    let sun = out.sun.filter(|_| !placed.stands.is_empty())?;
    let places = || placed.stands.iter().flat_map(|stand| &stand.places).map(|(place, _)| place.w_axis.truncate());
    let (low, high) = places().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
    let texel = (high - low).max_element() / f64::from(out.shadow_resolution.max(1));
    let tall = |stand: &PlacedStand| {
        let top = stand.leaves.iter().map(|leaf| leaf.transform.w_axis.length()).fold(0.0, f64::max);
        let scale = stand.places.iter().map(|(place, _)| place.x_axis.truncate().length()).fold(0.0, f64::max);
        top * scale
    };
    let height = placed.stands.iter().map(tall).fold(0.0, f64::max);
    // Half of the height is the mean way of a shadow within a crown and to the ground.
    let penumbra = 2.0 * f64::from(sun.radius).tan() * 0.5 * height;
    Some((parts_of_sun(penumbra, texel.max(1e-9)).ceil() as u32).max(1))
}
