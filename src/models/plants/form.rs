//! A plant: branches that grow on branches, each with a frame, an axis and a tube of wood, and the leaves on them.

use glam::{DMat4, DVec2, DVec3};
use mesophyll_files::mesh::LeafMesh;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// A plant at rest: branches have the shape that their weight gave them, except for [`Branch::bending_load`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plant {
    /// Name of the plant.
    pub name: String,
    /// The branches; parents stand before what grows on them.
    pub branches: Vec<Branch>,
    /// The leaves, each at its place.
    pub leaves: Vec<Leaf>,
    /// The shapes that leaves are instances of.
    pub blades: Vec<Blade>,
    /// Colours of materials by name (linear red, green, blue), for programs that do not know the scene's leaves.
    pub colours: BTreeMap<String, [f64; 3]>,
    /// For a meadow, the size of the rectangle that repeats (mm), whose middle is the origin.
    pub period: Option<[f64; 2]>,
}

/// A place on a branch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Joint {
    /// Index of the branch.
    pub branch: usize,
    /// Share of its axis from the root (0) to the tip (1).
    pub at: f64,
}

/// A branch: a tapered tube around an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Branch {
    /// Name of the branch, which is unique in the plant.
    pub name: String,
    /// The place that it grows on; `None` for a trunk.
    pub parent: Option<Joint>,
    /// Level of the branch: 0 for a trunk, 1 for what grows on a trunk, and so on.
    pub level: usize,
    /// Where its axis begins (mm).
    pub root: DVec3,
    /// Unit vectors: t along the axis at its beginning, r and s across it.
    pub axes: [DVec3; 3],
    /// Points of the axis in the branch's own frame (along t, r and s from the root; mm). There are at least two, and
    /// the first is the root.
    pub axis: Vec<DVec3>,
    /// Radius at the root (mm).
    pub root_radius: f64,
    /// Radius at the tip (mm).
    pub tip_radius: f64,
    /// F/(E′r₁⁴) (mm) under its load if the branch were horizontal, as `fit beam --deflections` defines it.
    pub load: f64,
    /// The part of this load (mm) that the shape does not show yet. A scene bends the branch under it. It is 0 for a
    /// branch that has the shape that its weight has given it, and the whole load for a straight branch.
    pub bending_load: f64,
    /// What is stated about its motion.
    pub stated: BranchMotion,
    /// Name of the bark's material.
    pub material: String,
    /// The bark, in the branch's own frame; may be empty.
    pub wood: LeafMesh,
}

/// Least and largest of the numbers of [`BranchMotion`]: lean (1 for each m/s), resonance (Hz) and damping.
pub const LEANS: [f64; 2] = [0.0, 1.0];
/// See [`LEANS`].
pub const RESONANCES: [f64; 2] = [1e-3, 1e3];
/// See [`LEANS`].
pub const DAMPINGS: [f64; 2] = [0.01, 10.0];

/// What is stated about the motion of a branch. What is absent follows from the size and the mass of the plant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BranchMotion {
    /// The tip's deflection over the length for each m/s of a steady wind across the branch.
    pub lean_per_m_s: Option<f64>,
    /// Resonance frequency (Hz).
    pub resonance_hz: Option<f64>,
    /// Damping relative to critical damping.
    pub damping: Option<f64>,
}

/// A leaf on a branch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leaf {
    /// Index of the shape.
    pub blade: usize,
    /// The place that it hangs on.
    pub joint: Joint,
    /// From the blade's frame to the plant's: a rotation, a translation, and the same scale along all axes.
    pub transform: DMat4,
}

/// The shape of leaves. The blade's tip is along +x, its front along +z, its middle at the origin.
#[derive(Debug, Clone, PartialEq)]
pub struct Blade {
    /// Name of the material.
    pub material: String,
    /// Triangles (mm).
    pub mesh: LeafMesh,
}

impl Plant {
    /// The place where a leaf hangs on its branch, and the vector from there to the tip of its blade (mm).
    pub fn hang(&self, leaf: &Leaf) -> (DVec3, DVec3) {
        let hang = self.branches[leaf.joint.branch].point(leaf.joint.at).0;
        // The tip of the blade is along its x.
        let far = self.blades[leaf.blade].mesh.positions.iter().map(|p| p.x).fold(0.0, f64::max);
        (hang, leaf.transform.transform_point3(DVec3::X * far) - hang)
    }

    /// Number of triangles of wood and of all blades. Those of a shape count for each blade that has it.
    pub fn triangles(&self) -> usize {
        let blades = self.leaves.iter().filter_map(|leaf| self.blades.get(leaf.blade)).map(|blade| &blade.mesh);
        blades.chain(self.branches.iter().map(|b| &b.wood)).map(|mesh| mesh.triangles()).fold(0, usize::saturating_add)
    }

    /// Number of triangles of all blades of a material. Those of a shape count for each blade that has it.
    pub fn triangles_of(&self, material: &str) -> usize {
        let of_blade = |leaf: &Leaf| self.blades.get(leaf.blade).filter(|blade| blade.material == material);
        self.leaves.iter().filter_map(of_blade).map(|blade| blade.mesh.triangles()).fold(0, usize::saturating_add)
    }

    /// All blades of a material at their places, as one mesh. The mesh is empty where there are none.
    pub fn blades_of(&self, material: &str) -> LeafMesh {
        self.blades_at(material, |leaf| Some(leaf.transform))
    }

    /// The blades of a material as one mesh, where `place` puts each; it leaves out those for which there is no place.
    pub fn blades_at(&self, material: &str, place: impl Fn(&Leaf) -> Option<DMat4>) -> LeafMesh {
        let mut mesh = LeafMesh::default();
        for leaf in &self.leaves {
            let blade = self.blades.get(leaf.blade).filter(|blade| blade.material == material);
            if let Some((blade, place)) = blade.zip(place(leaf)) {
                mesh.append(&blade.mesh, place);
            }
        }
        mesh
    }
}

impl Branch {
    /// The transform from the branch's own frame to the plant's.
    pub fn frame(&self) -> DMat4 {
        let [t, r, s] = self.axes;
        DMat4::from_cols(t.extend(0.0), r.extend(0.0), s.extend(0.0), self.root.extend(1.0))
    }

    /// Length along the axis (mm).
    pub fn length(&self) -> f64 {
        self.axis.windows(2).map(|w| w[0].distance(w[1])).sum()
    }

    /// Tip radius over root radius.
    pub fn taper(&self) -> f64 {
        if self.root_radius > 0.0 { self.tip_radius / self.root_radius } else { 1.0 }
    }

    /// Radius at a share of the axis.
    pub fn radius(&self, at: f64) -> f64 {
        self.root_radius + at * (self.tip_radius - self.root_radius)
    }

    /// Gives the branch another taper: tip radius over root radius. The radius at the root stays, and the bark becomes
    /// thinner or thicker around the axis. No vertex moves farther than the radius changes at its share of the axis.
    pub fn set_taper(&mut self, taper: f64) {
        let (length, radii) = (self.length(), [self.root_radius, self.tip_radius]);
        self.tip_radius = taper * self.root_radius;
        if !(length > 0.0) {
            return;
        }
        let change = self.tip_radius - radii[1];
        let wood = &mut self.wood;
        for (p, n) in wood.positions.iter_mut().zip(&mut wood.normals) {
            let at = nearest(&self.axis, *p).0;
            let (middle, t) = along(&self.axis, at);
            let out = *p - middle;
            let (lengthwise, across) = (t * out.dot(t), out - t * out.dot(t));
            let (before, distance) = (radii[0] + at * (radii[1] - radii[0]), across.length());
            if !(distance > 0.0) {
                continue;
            }
            // Vertices within the radius, those of a rounded end, keep their share of it.
            let share = if before > distance { distance / before } else { 1.0 };
            let grown = (distance + share * at * change) / distance;
            *p = middle + lengthwise + across * grown;
            let (n_along, n_across) = (n.dot(t), *n - t * n.dot(t));
            // Beyond an end, the bark is stretched across the axis alone. Elsewhere its slope along the axis changes.
            let end = (at <= 0.0 || at >= 1.0) && lengthwise.length() > 1e-9 * length;
            let turned = match end {
                true => n_across / grown.max(1e-9) + t * n_along,
                false => n_across + t * (n_along - change / length * n_across.dot(across / distance)),
            };
            *n = turned.try_normalize().unwrap_or(*n);
        }
    }

    /// The place at a share of the axis, and the unit direction of the axis there; in the plant's frame.
    pub fn point(&self, at: f64) -> (DVec3, DVec3) {
        let (place, along) = along(&self.axis, at);
        let frame = self.frame();
        (frame.transform_point3(place), frame.transform_vector3(along))
    }

    /// The vector from root to tip, in the plant's frame.
    pub fn chord(&self) -> DVec3 {
        self.axis.last().map_or(DVec3::ZERO, |tip| self.frame().transform_vector3(*tip))
    }
}

impl Plant {
    /// The same plant in another frame. `place` is a rotation, a translation, and the same scale along all axes.
    pub fn moved(&self, place: DMat4) -> Plant {
        let scale = place.determinant().cbrt();
        let mut out = self.clone();
        for branch in &mut out.branches {
            branch.root = place.transform_point3(branch.root);
            branch.axes = branch.axes.map(|a| place.transform_vector3(a) / scale);
            let lengths = [&mut branch.root_radius, &mut branch.tip_radius, &mut branch.load, &mut branch.bending_load];
            lengths.into_iter().for_each(|l| *l *= scale);
            branch.axis.iter_mut().chain(&mut branch.wood.positions).for_each(|p| *p *= scale);
        }
        out.leaves.iter_mut().for_each(|leaf| leaf.transform = place * leaf.transform);
        // A plant that was turned or moved no longer repeats along these axes and around the origin.
        out.period = None;
        out
    }

    /// Adds another plant beside this one. Its branches' names get `called` as a prefix.
    pub fn join(&mut self, other: Plant, called: &str) {
        let (branches, blades) = (self.branches.len(), self.blades.len());
        self.branches.extend(other.branches.into_iter().map(|b| Branch {
            name: format!("{called}{}", b.name),
            parent: b.parent.map(|j| Joint { branch: j.branch + branches, ..j }),
            ..b
        }));
        self.leaves.extend(other.leaves.into_iter().map(|l| Leaf {
            blade: l.blade + blades,
            joint: Joint { branch: l.joint.branch + branches, ..l.joint },
            ..l
        }));
        self.blades.extend(other.blades);
    }
}

/// The place at a share of a line of points, and the unit direction of the line there.
pub fn along(axis: &[DVec3], at: f64) -> (DVec3, DVec3) {
    let whole: f64 = axis.windows(2).map(|w| w[0].distance(w[1])).sum();
    let mut left = at.clamp(0.0, 1.0) * whole;
    let mut found = (axis.first().copied().unwrap_or_default(), DVec3::X);
    for w in axis.windows(2) {
        let step = w[0].distance(w[1]);
        if !(step > 0.0) {
            continue;
        }
        found = (w[0].lerp(w[1], (left / step).min(1.0)), (w[1] - w[0]) / step);
        if left <= step {
            break;
        }
        left -= step;
    }
    found
}

/// The share of a line of points that is nearest to `place`, and its distance from `place`.
pub fn nearest(axis: &[DVec3], place: DVec3) -> (f64, f64) {
    let whole: f64 = axis.windows(2).map(|w| w[0].distance(w[1])).sum();
    let mut best = (0.0, axis.first().map_or(f64::INFINITY, |p| p.distance(place)));
    let mut before = 0.0;
    for w in axis.windows(2) {
        let (d, step) = (w[1] - w[0], w[0].distance(w[1]));
        let x = if step > 0.0 { ((place - w[0]).dot(d) / (step * step)).clamp(0.0, 1.0) } else { 0.0 };
        let distance = place.distance(w[0] + d * x);
        if distance < best.1 {
            best = (if whole > 0.0 { (before + x * step) / whole } else { 0.0 }, distance);
        }
        before += step;
    }
    best
}

/// A tube around an axis, with `sides` corners, `rings` rings at even steps and a linear taper. It is open at both
/// ends. Neighbouring rings are turned against each other as little as the axis allows. Coordinates are those of the
/// axis.
pub fn tube(axis: &[DVec3], radii: [f64; 2], sides: usize, rings: usize) -> LeafMesh {
    let (sides, rings) = (sides.max(3), rings.max(2));
    let mut mesh = LeafMesh::default();
    let length: f64 = axis.windows(2).map(|w| w[0].distance(w[1])).sum();
    let slope = if length > 0.0 { (radii[0] - radii[1]) / length } else { 0.0 };
    let mut across = along(axis, 0.0).1.any_orthonormal_vector();
    for ring in 0..rings {
        let at = ring as f64 / (rings - 1) as f64;
        let (place, _) = along(axis, at);
        // The mean direction on both sides keeps the tube as thick in a bend as between bends.
        let reach = 0.5 / (rings - 1) as f64;
        let (before, after) = (along(axis, at - reach).0, along(axis, at + reach).0);
        let t = (after - before).try_normalize().unwrap_or(along(axis, at).1);
        across = (across - t * across.dot(t)).try_normalize().unwrap_or_else(|| t.any_orthonormal_vector());
        let other = t.cross(across);
        let radius = radii[0] + at * (radii[1] - radii[0]);
        for side in 0..=sides {
            let (sin, cos) = (TAU * side as f64 / sides as f64).sin_cos();
            let out = across * cos + other * sin;
            mesh.positions.push(place + out * radius);
            mesh.normals.push((out + t * slope).normalize());
            mesh.tangents.push((other * cos - across * sin, -1.0));
            mesh.uvs.push(DVec2::new(side as f64 / sides as f64, at));
        }
    }
    let ring = sides as u32 + 1;
    for k in 0..rings as u32 - 1 {
        for i in 0..sides as u32 {
            let a = k * ring + i;
            mesh.indices.extend([a, a + 1, a + ring, a + 1, a + ring + 1, a + ring]);
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tubes_face_outwards_and_keep_their_radius_in_bends() {
        let bend: Vec<DVec3> = (0..=20)
            .map(|k| {
                let a = f64::from(k) / 20.0;
                DVec3::new(100.0 * a.sin(), 0.0, 100.0 * (1.0 - a.cos()))
            })
            .collect();
        let mesh = tube(&bend, [5.0, 2.0], 8, 11);
        for t in 0..mesh.triangles() {
            let [a, b, c] = mesh.triangle(t).map(|k| mesh.positions[k]);
            assert!((b - a).cross(c - a).dot(mesh.normals[mesh.triangle(t)[0]]) > 0.0, "facet {t}");
        }
        for (k, p) in mesh.positions.iter().enumerate() {
            let at = (k / 9) as f64 / 10.0;
            let (place, _) = along(&bend, at);
            assert!((p.distance(place) - (5.0 - 3.0 * at)).abs() < 1e-9);
        }
    }

    /// A tube with another taper is the tube that has this taper from the beginning.
    #[test]
    fn another_taper_makes_another_tube() {
        let bend: Vec<DVec3> = (0..=20)
            .map(|k| {
                let a = f64::from(k) / 20.0;
                DVec3::new(100.0 * a.sin(), 0.0, 100.0 * (1.0 - a.cos()))
            })
            .collect();
        let tube = |axis: &[DVec3], tip: f64| tube(axis, [5.0, tip], 8, 11);
        for axis in [&bend[..], &[DVec3::ZERO, DVec3::X * 90.0]] {
            let mut branch = Branch {
                name: "b".into(),
                parent: None,
                level: 0,
                root: DVec3::ZERO,
                axes: [DVec3::X, DVec3::Y, DVec3::Z],
                axis: axis.to_vec(),
                root_radius: 5.0,
                tip_radius: 2.0,
                load: 0.0,
                bending_load: 0.0,
                stated: BranchMotion::default(),
                material: "bark".into(),
                wood: tube(axis, 2.0),
            };
            let mut pointed = branch.clone();
            branch.set_taper(0.8);
            assert!((branch.tip_radius - 4.0).abs() < 1e-12);
            // Where the file says that the tip has no radius, nothing moves farther than the radius changes.
            pointed.tip_radius = 0.0;
            let rest = pointed.wood.clone();
            pointed.set_taper(0.8);
            let far = rest.positions.iter().zip(&pointed.wood.positions).map(|(a, b)| a.distance(*b));
            assert!(far.fold(0.0, f64::max) < 4.0 + 1e-9);
            assert!(pointed.wood.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-9));
            let expected = tube(axis, 4.0);
            for k in 0..expected.positions.len() {
                let off = branch.wood.positions[k].distance(expected.positions[k]);
                // In a bend, the nearest place of the axis is not exactly the middle of a ring.
                assert!(off < if axis.len() == 2 { 1e-9 } else { 0.05 }, "{k}: {off} mm");
                let turned = branch.wood.normals[k].distance(expected.normals[k]);
                assert!(turned < if axis.len() == 2 { 1e-9 } else { 2e-3 }, "{k}: {turned}");
            }
        }
    }

    #[test]
    fn places_are_shares_of_the_length() {
        let bent = [DVec3::ZERO, DVec3::X, DVec3::X, DVec3::new(1.0, 3.0, 0.0)];
        assert_eq!(along(&bent, 0.25), (DVec3::X, DVec3::X));
        assert_eq!(along(&bent, 0.5), (DVec3::new(1.0, 1.0, 0.0), DVec3::Y));
        assert_eq!(along(&bent, 1.0), (DVec3::new(1.0, 3.0, 0.0), DVec3::Y));
    }
}
