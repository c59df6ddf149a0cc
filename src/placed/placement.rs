//! The placements of leaves at rest: first the scene's instances, then its cluster, then its tree ([`super::tree`]);
//! plants ([`super::plant`]) follow. Lengths are in mm. Something that hangs on a branch has a frame there: x points to
//! the branch's tip, and z as far up as the branch allows.
//!
//! A cluster is a twig along z with leaves that are a golden angle apart. Each blade's tip (its +x) points away from
//! the twig and droops. Droop, twist and height deviate by random amounts from the seed.

use super::tree;
use glam::{DMat4, DQuat, DVec3, EulerRot};
use mesophyll_manifest::{Cluster, Instance, Manifest};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// One leaf at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Index into the manifest's leaves.
    pub leaf: usize,
    /// The transform from the leaf to the world. It is that at rest if something bends the leaf.
    pub transform: DMat4,
    /// The thing that bends it.
    pub ride: Option<Ride>,
}

/// The thing that a placement moves with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Ride {
    /// A branch of the scene.
    Branch(OnBranch),
    /// A section of a plant, by its number among the sections of the scene ([`super::sections`]).
    Section(usize),
}

/// A place on a branch: 0 (root) to 1 (tip).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnBranch {
    /// Index into the manifest's branches.
    pub branch: usize,
    /// Place on the branch, from 0 (root) to 1 (tip).
    pub at: f64,
}

/// Every placement of the scene, in a fixed order.
pub fn placements(manifest: &Manifest) -> Vec<Placement> {
    let mut out: Vec<Placement> = manifest
        .instances
        .iter()
        .filter_map(|i| manifest.leaf_index(&i.leaf).map(|leaf| placed(manifest, i, leaf)))
        .collect();
    if let Some(cluster) = &manifest.cluster {
        let leaves: Vec<usize> = cluster.leaves.iter().filter_map(|n| manifest.leaf_index(n)).collect();
        out.extend(cluster_transforms(cluster).into_iter().enumerate().map(|(k, transform)| Placement {
            leaf: leaves[k % leaves.len()],
            transform,
            ride: None,
        }));
    }
    if let Some(tree) = &manifest.tree {
        let leaves: Vec<usize> = tree.leaves.iter().filter_map(|n| manifest.leaf_index(n)).collect();
        let grown = tree::grow(tree).leaves.into_iter().enumerate();
        out.extend(grown.map(|(k, transform)| Placement { leaf: leaves[k % leaves.len()], transform, ride: None }));
    }
    out
}

/// The rotation about x, then y, then z (degrees).
pub fn rotation(deg: [f64; 3]) -> DQuat {
    DQuat::from_euler(EulerRot::ZYX, deg[2].to_radians(), deg[1].to_radians(), deg[0].to_radians())
}

/// Root, and t, r and s, of a branch of the manifest.
pub fn frame(b: &mesophyll_manifest::Branch) -> (DVec3, [DVec3; 3]) {
    let t = DVec3::from(b.direction).normalize_or(DVec3::X);
    let up = if t.z.abs() > 0.999 { DVec3::X } else { DVec3::Z };
    let s = (up - t * t.dot(up)).normalize_or(DVec3::Y);
    (DVec3::from(b.position_mm), [t, s.cross(t), s])
}

fn placed(manifest: &Manifest, i: &Instance, leaf: usize) -> Placement {
    let own = instance_transform(i);
    let Some((ride, b)) = i.branch.as_ref().and_then(|name| {
        let branch = manifest.branch_index(name)?;
        Some((OnBranch { branch, at: i.at.unwrap_or(0.0) }, &manifest.branches[branch]))
    }) else {
        return Placement { leaf, transform: own, ride: None };
    };
    let (root, [t, r, s]) = frame(b);
    let place = root + t * (ride.at * b.length_mm);
    let on_branch = DMat4::from_cols(t.extend(0.0), r.extend(0.0), s.extend(0.0), place.extend(1.0));
    let out = rotation(i.rotation_deg) * DVec3::X * i.offset_mm.unwrap_or(0.0);
    Placement { leaf, transform: on_branch * DMat4::from_translation(out) * own, ride: Some(Ride::Branch(ride)) }
}

fn instance_transform(i: &Instance) -> DMat4 {
    DMat4::from_scale_rotation_translation(DVec3::splat(i.scale), rotation(i.rotation_deg), DVec3::from(i.position_mm))
}

fn cluster_transforms(c: &Cluster) -> Vec<DMat4> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let mut rng = Pcg64::seed_from_u64(c.seed);
    (0..c.count)
        .map(|k| {
            let mut stray = || rng.random::<f64>() * 2.0 - 1.0;
            let step = c.length_mm / c.count as f64;
            let height = (k as f64 + 0.5) * step - c.length_mm / 2.0 + 0.3 * step * stray();
            let azimuth = k as f64 * golden + 0.25 * stray();
            let droop = (c.droop_deg + c.spread_deg * stray()).to_radians();
            let twist = (c.spread_deg * stray()).to_radians();
            // In the blade's frame, +x points outward and +z (the front) up. The blade is twisted about its midrib,
            // droops about y, and then +x is turned to the azimuth.
            let turn = DQuat::from_rotation_z(azimuth) * DQuat::from_rotation_y(droop);
            let out = turn * DVec3::X;
            DMat4::from_scale_rotation_translation(
                DVec3::splat(c.scale),
                turn * DQuat::from_rotation_x(twist),
                out * c.offset_mm + DVec3::Z * height,
            )
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_apply_x_first_and_z_last() {
        let q = rotation([90.0, 0.0, 90.0]);
        // The turn about x maps y to z, and the turn about z leaves this unchanged. The turn about z maps x to y.
        assert!((q * DVec3::Y - DVec3::Z).length() < 1e-12);
        assert!((q * DVec3::X - DVec3::Y).length() < 1e-12);
    }

    #[test]
    fn a_seed_is_a_cluster_and_blades_hang_from_the_twig() {
        let c = Cluster {
            leaves: vec!["a".into()],
            count: 12,
            length_mm: 60.0,
            offset_mm: 40.0,
            droop_deg: 30.0,
            spread_deg: 0.0,
            scale: 1.0,
            seed: 7,
        };
        let all = cluster_transforms(&c);
        assert_eq!(all, cluster_transforms(&c));
        assert_ne!(all, cluster_transforms(&Cluster { seed: 8, ..c.clone() }));
        for t in all {
            let centre = t.transform_point3(DVec3::ZERO);
            assert!((centre.truncate().length() - 40.0 * 30f64.to_radians().cos()).abs() < 1e-9);
            // The blade droops: its tip is lower than its base, and its front faces up.
            assert!((t.transform_vector3(DVec3::X).z + 0.5).abs() < 1e-9);
            assert!(t.transform_vector3(DVec3::Z).z > 0.8);
        }
    }
}
