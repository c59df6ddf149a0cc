//! How far what branches carry reaches: boxes at rest around what each section carries, and balls that hold a plant
//! however it bends.

use crate::geometry::corners;
use crate::scene::{PoseHierarchy, Scene};
use glam::{Mat3, Vec3};

/// A box with its own axes: the centre, and half sides.
pub(crate) type Oriented = (Vec3, [Vec3; 3]);

/// The box around what each section carries at rest. Its axes are those of the first instance, or of the branch for
/// bark. What stands in many places has boxes only where `stands`, those of its first pose in the plant's frame.
pub(crate) fn boxes(scene: &Scene, poses: &PoseHierarchy, stands: bool) -> Vec<Option<Oriented>> {
    let mut found: Vec<Option<(Mat3, Vec3, Vec3)>> = vec![None; poses.seats.len()];
    let mut add = |section: usize, axes: Mat3, point: Vec3| {
        let (axes, low, high) = found[section].get_or_insert((axes, Vec3::INFINITY, Vec3::NEG_INFINITY));
        let own = axes.transpose() * point;
        (*low, *high) = (low.min(own), high.max(own));
    };
    let corners: Vec<Option<[Vec3; 8]>> = scene.meshes.iter().map(|m| corners(&m.positions)).collect();
    let of_vertices = scene.sections.as_ref().map_or(&[][..], |s| &s.of_vertices);
    for instance in scene.instances.iter().filter(|i| stands || i.stand.is_none()) {
        let (Some(by), m) = (instance.carried, instance.transform) else { continue };
        let columns = [m.x_axis, m.y_axis, m.z_axis].map(|c| c.truncate());
        let leaf = Mat3::from_cols(
            columns[0].normalize_or(Vec3::X),
            columns[1].normalize_or(Vec3::Y),
            columns[2].normalize_or(Vec3::Z),
        );
        match by.vertices {
            None => {
                let all = corners[instance.mesh].iter().flatten();
                all.for_each(|p| add(by.first as usize, leaf, m.transform_point3(*p)));
            }
            Some(first) => {
                for (k, p) in scene.meshes[instance.mesh].positions.iter().enumerate() {
                    let section = (by.first + of_vertices[first as usize + k]) as usize;
                    let [t, r] = poses.limbs[poses.seats[section].limb as usize].axes;
                    add(section, Mat3::from_cols(t, r, t.cross(r)), m.transform_point3(*p));
                }
            }
        }
    }
    let oriented = |of: Option<(Mat3, Vec3, Vec3)>| {
        let (axes, low, high) = of?;
        let half = 0.5 * (high - low);
        Some((axes * (0.5 * (low + high)), [axes.x_axis * half.x, axes.y_axis * half.y, axes.z_axis * half.z]))
    };
    found.into_iter().map(oriented).collect()
}

/// For each branch the ball that holds everything on its trunk, however branches bend: around the trunk's root, as far
/// as all lengths from there to a leaf's or a vertex' farthest corner. Lengths that are kept in closed form alone may
/// grow, and what they carry may then come out of it.
pub(crate) fn reach(scene: &Scene, poses: &PoseHierarchy) -> Vec<(Vec3, f32)> {
    // A file may let an axis begin beside the branch's root.
    let along = |limb: u32, share: f32| {
        let limb = &poses.limbs[limb as usize];
        poses.pieces[limb.pieces[0] as usize].place.length() + share * limb.length
    };
    let mut of_limbs: Vec<(usize, f32)> = Vec::with_capacity(poses.limbs.len());
    for (k, limb) in poses.limbs.iter().enumerate() {
        of_limbs.push(limb.parent.map_or((k, 0.0), |parent| {
            let (trunk, before) = of_limbs[parent as usize];
            (trunk, before + along(parent, limb.at.0) + limb.offset.length())
        }));
    }
    let mut radii = vec![0.0f32; poses.limbs.len()];
    for (seat, of) in poses.seats.iter().zip(boxes(scene, poses, true)) {
        let Some((centre, half)) = of else { continue };
        let (trunk, before) = of_limbs[seat.limb as usize];
        let along = along(seat.limb, seat.share) + seat.offset.length();
        let beyond = centre.distance(seat.from) + half.iter().map(|h| h.length()).sum::<f32>();
        radii[trunk] = radii[trunk].max(before + along + beyond);
    }
    of_limbs.iter().map(|(trunk, _)| (poses.limbs[*trunk].root, radii[*trunk])).collect()
}
