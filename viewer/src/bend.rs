//! The motion of `passes/bend.wgsl` on the CPU, in single precision. It tells what the shadow maps and clipping planes
//! must cover, and what is under the pointer. Pictures use the shader alone.

use crate::scene::{Scene, SectionAnimation, SectionBinding, SectionMotion, WindState};
use glam::Vec3;

/// All sections at one time.
#[derive(Debug, Clone)]
pub(crate) struct Moved<'a> {
    sections: Vec<SectionMotion>,
    of_vertices: &'a [u32],
    turn_normals: bool,
}

impl SectionAnimation {
    /// All sections at the time of a wind.
    pub(crate) fn now(&self, wind: Option<&WindState>) -> Vec<SectionMotion> {
        let mut all = (self.at)(wind.map_or(0.0, |w| w.time_s));
        let still = SectionMotion { from: Vec3::ZERO, to: Vec3::ZERO, turn: glam::Quat::IDENTITY };
        all.resize(self.count, still);
        all
    }
}

impl<'a> Moved<'a> {
    /// Everything that `sections` carry, with their motions `now`.
    pub(crate) fn new(sections: Option<&'a SectionAnimation>, now: Vec<SectionMotion>) -> Moved<'a> {
        Moved {
            sections: now,
            of_vertices: sections.map_or(&[], |s| &s.of_vertices),
            turn_normals: sections.is_some_and(|s| s.turn_normals),
        }
    }

    pub(crate) fn of(scene: &'a Scene) -> Moved<'a> {
        let sections = scene.sections.as_ref();
        Moved::new(sections, sections.map_or_else(Vec::new, |s| s.now(scene.wind.as_ref())))
    }

    /// The motions of the sections.
    pub(crate) fn into_sections(self) -> Vec<SectionMotion> {
        self.sections
    }

    /// The place that a point in world space moves to. In a mesh that is moved vertex by vertex, it is vertex `number`.
    pub(crate) fn place(&self, by: Option<SectionBinding>, number: usize, point: Vec3) -> Vec3 {
        self.place_and_normal(by, number, point, Vec3::ZERO).0
    }

    /// The same for a point and a normal.
    pub(crate) fn place_and_normal(
        &self,
        by: Option<SectionBinding>,
        number: usize,
        point: Vec3,
        normal: Vec3,
    ) -> (Vec3, Vec3) {
        let section = by.and_then(|carried| {
            let own = carried.vertices.and_then(|first| self.of_vertices.get(first as usize + number));
            self.sections.get((carried.first + own.copied().unwrap_or(0)) as usize)
        });
        section.map_or((point, normal), |s| {
            let turned = if self.turn_normals { s.turn * normal } else { normal };
            (s.to + s.turn * (point - s.from), turned)
        })
    }
}
