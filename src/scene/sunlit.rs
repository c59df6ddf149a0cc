//! What comes of the sun through every placed leaf that has translucency maps, for the reference renderer: one map an instance and lit side,
//! with the sun in each texel's own tangent frame (blades are curved).

use super::facing::Facing;
use super::placement::Placement;
use super::plan::{LeafPlan, Plan};
use super::texel_frame;
use super::translucency::{Coefficients, front_texel, value};
use crate::Result;
use crate::transport::{Sunlit, Through, World};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::sync::Arc;

/// One leaf's inside, ready for any sun.
#[derive(Debug)]
pub struct Inside {
    /// Tangent, image up and normal at every texel of the front's maps.
    frames: Vec<[DVec3; 3]>,
    width: usize,
}

impl Inside {
    /// # Errors
    /// [`crate::Error::Input`] where the leaf's mesh covers no texel.
    pub fn new(leaf: &LeafPlan) -> Result<Option<Inside>> {
        let Some(mesh) = &leaf.mesh else { return Ok(None) };
        let [width, height] = leaf.size;
        Ok(Some(Inside { frames: texel_frame::frames(&leaf.mesh_path, mesh, width, height)?, width }))
    }

    /// The sun (in the leaf's own frame) in every texel's tangent frame, as side `s` sees it.
    fn turned(&self, s: usize, sun: DVec3) -> impl Fn(usize) -> DVec3 + '_ {
        let out = if s == 0 { 1.0 } else { -1.0 };
        move |k| {
            let [t, b, n] = self.frames[front_texel(k, s, self.width)];
            DVec3::new(out * t.dot(sun), b.dot(sun), out * n.dot(sun))
        }
    }

    /// What multiplies ρt (or stands for it) when `sun` shines on side `s`.
    fn lit(&self, leaf: &LeafPlan, s: usize, sun: DVec3) -> Option<Sunlit> {
        let coefficients = leaf.translucency.as_ref()?.maps[s].as_ref()?;
        let omega = self.turned(s, sun);
        let of = |map: &[[f32; 3]]| -> Vec<f32> { map.iter().enumerate().map(|(k, h)| value(*h, omega(k)) as f32).collect() };
        Some(match coefficients {
            Coefficients::Factor(map) => Sunlit::Factor(Arc::new(of(map))),
            Coefficients::Colour(maps) => Sunlit::Colour(Arc::new([of(&maps[0]), of(&maps[1]), of(&maps[2])])),
        })
    }
}

/// Lights every instance of `world`, which [`super::reference::world`] made, for where its sun and its instances are now. Instances that
/// show no light from behind to any of `eyes` are left alone.
///
/// # Errors
/// [`crate::Error::Input`] for a leaf whose maps cannot be read.
pub fn relight(world: &mut World, plan: &Plan, eyes: &[DVec3]) -> Result<()> {
    world.through.clear();
    let Some(sun) = world.sun.as_ref().map(|s| s.direction.normalize_or_zero()) else { return Ok(()) };
    let drawn: Vec<&LeafPlan> = plan.leaves.iter().filter(|l| l.mesh.is_some()).collect();
    let mut insides = Vec::new();
    for leaf in &drawn {
        insides.push(if leaf.sides.iter().any(|s| s.translucency) { Inside::new(leaf)? } else { None });
    }
    if insides.iter().all(Option::is_none) {
        return Ok(());
    }
    let one = |placed: &crate::transport::Placement| -> Through {
        let mut out = Through::default();
        let Some((leaf, Some(inside))) = drawn.get(placed.leaf).zip(insides.get(placed.leaf).and_then(|i| i.as_ref()).map(Some)) else {
            return out;
        };
        let mut facing = Facing::default();
        if let Some(mesh) = &leaf.mesh {
            let placement = Placement { leaf: leaf.index, transform: placed.transform, ride: None };
            facing.add(mesh, &placement, eyes, Some(sun));
        }
        let local = (DMat3::from_mat4(placed.transform).inverse() * sun).normalize_or_zero();
        for s in [0, 1] {
            if leaf.sides[s].translucency && facing.through[1 - s] {
                out.entering[s] = inside.lit(leaf, s, local);
            }
        }
        out
    };
    world.through = world.instances.par_iter().map(one).collect();
    Ok(())
}
