//! How sunlight passes through every placed leaf that has translucency maps, for the reference renderer: one map for
//! each instance and lit side ([`crate::loaded::convolution`]).

use crate::Result;
use crate::loaded::{LoadedLeaf, LoadedScene};
use crate::placed::placement::LeafPlacement;
use crate::placed::visible_sides::VisibleSides;
use glam::{DMat3, DVec3};
use mesophyll_optics::side::Side;
use mesophyll_transport::{ReferenceWorld, SunTransmission, SunlitMaps};
use rayon::prelude::*;

/// Computes the transmitted sunlight for every instance of `world`, which [`super::reference::world`] made, for the
/// present sun and the present places. Instances that show none of `eyes` any light from behind are left unchanged;
/// without eyes, all are lit.
///
/// # Errors
/// [`Error::Input`] for a leaf whose maps cannot be read.
pub fn relight(world: &mut ReferenceWorld, scene: &LoadedScene, eyes: Option<&[DVec3]>) -> Result<()> {
    relight_where(world, scene, eyes, |_, _| true)
}

/// As [`relight`], but only for those leaves' sides for which `has(leaf, side)` says that they still have their maps.
/// `leaf` is the renderers' index.
///
/// # Errors
/// As [`relight`].
pub fn relight_where(
    world: &mut ReferenceWorld,
    scene: &LoadedScene,
    eyes: Option<&[DVec3]>,
    has: impl Fn(usize, Side) -> bool,
) -> Result<()> {
    light(world, scene, eyes, false, has)
}

/// As [`relight`], with the stored coefficients instead of the convolution. Returns whether there was any such light.
///
/// # Errors
/// As [`relight`].
pub fn relight_as_stored(world: &mut ReferenceWorld, scene: &LoadedScene, eyes: &[DVec3]) -> Result<bool> {
    light(world, scene, Some(eyes), true, |_, _| true)?;
    Ok(!world.through.is_empty())
}

fn light(
    world: &mut ReferenceWorld,
    scene: &LoadedScene,
    eyes: Option<&[DVec3]>,
    stored: bool,
    has: impl Fn(usize, Side) -> bool,
) -> Result<()> {
    world.through.clear();
    let Some(found) = &world.sun else { return Ok(()) };
    let (sun, radius) = (found.direction.normalize_or_zero(), found.radius);
    let drawn: Vec<LoadedLeaf> = scene.drawn().collect();
    let instances = &world.instances;
    let mut through = vec![SunTransmission::default(); instances.len()];
    let mut any = false;
    for (index, &leaf) in drawn.iter().enumerate() {
        // Here it does not matter whether the plan leaves a side's maps out.
        let (Some(mesh), Some(fitted)) = (&leaf.placed.mesh, &leaf.placed.fitted) else { continue };
        let Some(inside) = leaf.inside()? else { continue };
        let facing = |i: usize| {
            let Some(eyes) = eyes else { return VisibleSides::ALL };
            let mut facing = VisibleSides::default();
            facing.add(
                mesh,
                &LeafPlacement { leaf: leaf.placed.index, transform: instances[i].transform, section: None, frame: 0 },
                eyes,
                Some((sun, radius)),
            );
            facing
        };
        let own: Vec<(usize, VisibleSides)> = (0..instances.len())
            .into_par_iter()
            .filter(|&i| instances[i].leaf == index)
            .map(|i| (i, facing(i)))
            .collect();
        for side in Side::ALL.into_iter().filter(|side| fitted.has(*side) && has(index, *side)) {
            let shown: Vec<usize> = own.iter().filter(|(_, f)| f.through[side.other()]).map(|(i, _)| *i).collect();
            if shown.is_empty() {
                continue;
            }
            any = true;
            let local = |i: &usize| (DMat3::from_mat4(instances[*i].transform).inverse() * sun).normalize_or_zero();
            // Two suns share the transforms of a convolution.
            let of = |pair: &[usize]| {
                let suns: Vec<DVec3> = pair.iter().map(local).collect();
                if stored { Ok(inside.stored(leaf, side, &suns)) } else { inside.lit(leaf, side, &suns, radius) }
            };
            let lit: Vec<Vec<SunlitMaps>> = shown.par_chunks(2).map(of).collect::<Result<_>>()?;
            for (i, map) in shown.into_iter().zip(lit.into_iter().flatten()) {
                through[i].entering[side as usize] = Some(map);
            }
        }
    }
    if any {
        world.through = through;
    }
    Ok(())
}
