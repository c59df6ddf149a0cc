//! How far a scene reaches, at rest and at a time of its wind: what shadow maps and clipping planes must cover.

use crate::bend::Moved;
use crate::geometry::{ball, corners};
use crate::passes::bounds::reach;
use crate::scene::{PlantStand, PoseHierarchy, Scene, SectionAnimation, SectionBinding, SectionMotion, WindState};
use glam::{Mat4, Vec3};
use std::sync::Arc;

/// Points around every instance at rest, in world space, and what carries them. They are the corners of boxes, or every
/// vertex where a mesh bends.
pub(crate) struct Extents {
    /// What casts a shadow stands first.
    points: Vec<(Option<SectionBinding>, Vec<Vec3>)>,
    /// How many of these cast a shadow.
    casters: usize,
    sections: Option<SectionAnimation>,
    /// The height below which there is nothing at rest.
    pub low: f32,
    /// Balls that hold all poses ([`reach`]), where the adapter poses what is carried.
    reach: Option<Vec<(Vec3, f32)>>,
}

/// How far a plant reaches that stands in many places, in its own frame.
pub(crate) struct StandBounds {
    /// Centre and radius of a ball around it at rest, and of one that it never leaves.
    pub rest: (Vec3, f32),
    pub moving: (Vec3, f32),
    /// The corners of the box around it at rest.
    corners: [Vec3; 8],
    /// The largest scale at its places.
    pub largest: f32,
}

/// The largest number of plants whose boxes count one by one.
const APART: usize = 4096;

/// What a ball at rest is made larger by where something moves, and what a plant's reach is made larger by where its
/// lengths are kept in closed form only.
const BENT: f32 = 1.1;
const CLOSED_FORM: f32 = 1.5;

/// The uniform scale of a transform.
pub(crate) fn scale_of(transform: &Mat4) -> f32 {
    transform.x_axis.truncate().length()
}

/// How far the plants of each stand reach.
pub(crate) fn bounds(scene: &Scene) -> Vec<Arc<StandBounds>> {
    if scene.stands.is_empty() {
        return Vec::new();
    }
    let boxes: Vec<Option<[Vec3; 8]>> = scene.meshes.iter().map(|mesh| corners(&mesh.positions)).collect();
    let poses = scene.sections.as_ref().and_then(|s| s.poses.as_deref());
    let reach = poses.map(|poses| (poses, reach(scene, poses)));
    let one = |(k, stand): (usize, &Arc<PlantStand>)| {
        let own = scene.instances.iter().filter(|i| i.stand == Some(k as u32));
        let points: Vec<Vec3> =
            own.filter_map(|i| Some(boxes[i.mesh]?.map(|p| i.transform.transform_point3(p)))).flatten().collect();
        let rest = ball(&points);
        let moving = match &reach {
            Some((poses, reach)) if stand.sections > 0 => {
                let seats = &poses.seats[stand.first as usize..][..stand.sections as usize];
                let balls = || seats.iter().map(|seat| reach[seat.limb as usize]);
                let far = balls().map(|(centre, radius)| centre.distance(rest.0) + radius).fold(rest.1, f32::max);
                (rest.0, far * if poses.closed_form { CLOSED_FORM } else { 1.0 })
            }
            _ if stand.sections > 0 => (rest.0, 2.0 * rest.1 * CLOSED_FORM),
            _ => rest,
        };
        let largest = stand.places.iter().map(|p| scale_of(&p.transform)).fold(0.0, f32::max);
        let corners = corners(&points).unwrap_or([Vec3::ZERO; 8]);
        Arc::new(StandBounds { rest, moving, corners, largest })
    };
    scene.stands.iter().enumerate().map(one).collect()
}

/// Points around all plants of a stand: the corners of each plant's box, or of the box around all of them where these
/// are many.
fn around(stand: &PlantStand, bounds: &StandBounds) -> Vec<Vec3> {
    let centre = 0.5 * (bounds.corners[0] + bounds.corners[7]);
    let larger = if stand.sections > 0 { BENT } else { 1.0 };
    let own = bounds.corners.map(|corner| centre + larger * (corner - centre));
    let all: Vec<Vec3> =
        stand.places.iter().flat_map(|place| own.map(|corner| place.transform.transform_point3(corner))).collect();
    match corners(&all) {
        Some(box_of_all) if stand.places.len() > APART => box_of_all.to_vec(),
        _ => all,
    }
}

/// Which branches belong to plants that stand in many places.
fn of_stands(scene: &Scene, poses: &PoseHierarchy) -> Vec<bool> {
    let mut found = vec![false; poses.limbs.len()];
    for stand in &scene.stands {
        let seats = &poses.seats[stand.first as usize..][..(stand.sections * stand.poses) as usize];
        seats.iter().for_each(|seat| found[seat.limb as usize] = true);
    }
    for k in 0..found.len() {
        found[k] |= poses.limbs[k].parent.is_some_and(|parent| found[parent as usize]);
    }
    found
}

impl Extents {
    pub(crate) fn new(scene: &Scene) -> Extents {
        Extents::of(scene, scene.sections.as_ref().and_then(|s| s.poses.as_deref()))
    }

    /// Where the adapter poses what is carried, the extents are those at rest, and the ball holds all poses.
    fn of(scene: &Scene, poses: Option<&PoseHierarchy>) -> Extents {
        let boxes: Vec<Option<[Vec3; 8]>> = scene.meshes.iter().map(|mesh| corners(&mesh.positions)).collect();
        let points = scene.instances.iter().filter(|i| i.stand.is_none()).filter_map(|instance| {
            let by = instance.carried;
            let own = by.is_some_and(|c| c.vertices.is_some()) && poses.is_none();
            let around = if own { &scene.meshes[instance.mesh].positions } else { &boxes[instance.mesh]?[..] };
            let points = around.iter().map(|p| instance.transform.transform_point3(*p)).collect();
            Some(((by, points), instance.floor))
        });
        // Lawns cast no shadow.
        let lawns = scene.grass.iter().map(|grass| {
            let far = (grass.high - grass.low).extend(grass.height);
            let corner = |k: u32| {
                let at = Vec3::new((k & 1) as f32, (k >> 1 & 1) as f32, (k >> 2) as f32);
                grass.origin + grass.low.extend(0.0) + at * far
            };
            ((None, (0..8).map(corner).collect()), true)
        });
        let stands = scene.stands.iter().zip(bounds(scene));
        let stands = stands.map(|(stand, bounds)| ((None, around(stand, &bounds)), false));
        let (floors, mut points): (Vec<_>, Vec<_>) = points.chain(stands).chain(lawns).partition(|(_, floor)| *floor);
        let casters = points.len();
        points.extend(floors);
        let heights = points.iter().flat_map(|((_, points), _)| points).map(|p: &Vec3| p.z);
        Extents {
            low: heights.fold(f32::INFINITY, f32::min),
            points: points.into_iter().map(|(one, _)| one).collect(),
            casters,
            sections: scene.sections.clone(),
            reach: poses.map(|poses| {
                let all = poses.limbs.iter().zip(reach(scene, poses)).zip(of_stands(scene, poses));
                all.filter(|((limb, _), stands)| limb.parent.is_none() && !stands).map(|((_, ball), _)| ball).collect()
            }),
        }
    }

    /// The points of what casts shadows and is not carried.
    pub(crate) fn still(&self) -> Vec<Vec3> {
        let still = self.points[..self.casters].iter().filter(|(by, _)| by.is_none());
        still.flat_map(|(_, points)| points).copied().collect()
    }

    /// Boxes around what stands in the scene at rest, as two corners: one around all that casts shadows, and one around
    /// each thing that does not.
    pub(crate) fn boxes(&self) -> Vec<[Vec3; 2]> {
        let around = |points: &mut dyn Iterator<Item = &Vec3>| {
            let first = *points.next()?;
            Some(points.fold([first; 2], |[low, high], p| [low.min(*p), high.max(*p)]))
        };
        let (casters, others) = self.points.split_at(self.casters);
        let all = around(&mut casters.iter().flat_map(|(_, points)| points));
        all.into_iter().chain(others.iter().filter_map(|(_, points)| around(&mut points.iter()))).collect()
    }

    pub(crate) fn sections(&self) -> Option<&SectionAnimation> {
        self.sections.as_ref()
    }

    /// The scene's extents at a time of its wind.
    pub(crate) fn at(&self, wind: Option<&WindState>) -> ExtentsNow {
        let sections = self.sections.as_ref().filter(|_| self.reach.is_none());
        let moved = Moved::new(sections, sections.map_or_else(Vec::new, |s| s.now(wind)));
        let mut points = Vec::with_capacity(self.points.iter().map(|(_, points)| points.len()).sum());
        let mut casting = 0;
        for (k, (by, own)) in self.points.iter().enumerate() {
            points.extend(own.iter().enumerate().map(|(n, p)| moved.place(*by, n, *p)));
            if k < self.casters {
                casting = points.len();
            }
        }
        let reach = self.reach.iter().flatten();
        let ends = reach.flat_map(|(centre, radius)| [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| (*centre, *radius * axis)));
        let far: Vec<Vec3> = ends.flat_map(|(centre, arm)| [centre - arm, centre + arm]).collect();
        let ball = match far.is_empty() {
            true => ball(&points),
            false => ball(&points.iter().chain(&far).copied().collect::<Vec<Vec3>>()),
        };
        points.truncate(casting);
        ExtentsNow { ball, casters: points, sections: moved.into_sections() }
    }
}

/// The extents of a scene at one time.
pub(crate) struct ExtentsNow {
    /// The motions of all sections; none where the adapter computes them.
    pub sections: Vec<SectionMotion>,
    /// The points that shadow maps must cover: everything that casts a shadow.
    pub casters: Vec<Vec3>,
    /// Centre and radius of a ball around everything, which clipping planes must cover.
    pub ball: (Vec3, f32),
}

/// Centre and radius of a ball around everything that a scene shows, as bent at its time.
pub fn ball_around(scene: &Scene) -> (Vec3, f32) {
    Extents::of(scene, None).at(scene.wind.as_ref()).ball
}
