//! Hands a scene to the reference renderer in a separate way. It uses `front.exr` and `back.exr` (γ, thickness, ρs, m
//! and normals of each texel in the scan's frame) instead of W's packed textures, and its own interpolation of the slab
//! (Chebyshev in the thickness). Nothing that the plan leaves out is left out here: gloss, normals, translucency and
//! both sides are drawn wherever the fit has them.

use super::sunlight::relight;
use super::{grass, soil, stands};
use crate::Result;
use crate::loaded::{LoadedLeaf, LoadedScene};
use crate::manifest::{InteriorSource, SceneManifest, SunLight};
use crate::placed::PlacedScene;
use crate::placed::daylight::{Daylight, sun_disk};
use crate::placed::fits::reader;
use crate::placed::ledger::Ledger;
use crate::world::{SceneWorld, WorldInstance, WorldLights, WorldMaterial, WorldSky, WorldSurface};
use glam::DVec3;
use mesophyll_files::mesh::LeafMesh;
use mesophyll_files::quantity::Quantity;
use mesophyll_fits::leaf_folder::{LeafFit, LeafFitFile, filling};
use mesophyll_optics::side::Side;
use mesophyll_optics::slab;
use mesophyll_optics::slab::chebyshev::SlabInterpolant;
use mesophyll_transport as transport;
use mesophyll_transport::environment::Environment;
use rayon::prelude::*;
use std::f64::consts::PI;
use std::sync::Arc;

/// Everything the perspective views show.
///
/// # Errors
/// [`crate::Error::Input`] for a map that is missing, damaged or of another size.
pub fn world(scene: &LoadedScene, ledger: &Ledger) -> Result<transport::ReferenceWorld> {
    let mut out = standing(scene, ledger)?;
    stand_at(&mut out, scene, scene.manifest.rest_time());
    relight(&mut out, scene, Some(&scene.placed.eyes))?;
    Ok(out)
}

/// The scene at rest, without sunlight through its leaves.
fn standing(scene: &LoadedScene, ledger: &Ledger) -> Result<transport::ReferenceWorld> {
    let world = SceneWorld::new(scene)?;
    let mut out = lit(&scene.manifest, &world.lights);
    let one = |surface: &WorldSurface| surface_of(surface, ledger);
    out.leaves = world.surfaces[..world.leaves].iter().map(one).collect::<Result<_>>()?;
    let at = |k: WorldInstance| transport::ReferencePlacement { leaf: k.surface, transform: k.transform };
    out.instances = world.standing_leaves().map(at).collect();
    scene.placed.grass.iter().try_for_each(|grass| grass::blades(&scene.manifest, grass, &mut out))?;
    // The blades of lawns are numbered before wood and ground.
    let blades = out.leaves.len() - world.leaves;
    out.instances.extend(world.standing_solids().map(|k| at(WorldInstance { surface: k.surface + blades, ..k })));
    let solids = world.leaves + scene.placed.wood.len() + usize::from(world.ground().is_some());
    for surface in &world.surfaces[world.leaves..solids] {
        out.leaves.push(one(surface)?);
    }
    out.ground = world.ground().map(|_| out.instances.len() - 1);
    stands::trace(&world, &scene.placed, &scene.manifest.path, &mut out, one)?;
    Ok(out)
}

/// A surface with everything that its fit has. Parts that the plan leaves out are drawn here too, so that the picture
/// is compared with the leaf and not with the plan.
fn surface_of(surface: &WorldSurface, ledger: &Ledger) -> Result<transport::ReferenceLeaf> {
    let mesh = surface.mesh.clone();
    match surface.material {
        WorldMaterial::Fitted(leaf, fit) => one_leaf(mesh, leaf, fit, ledger),
        WorldMaterial::Stated(leaf, stated) => {
            let gloss = || stated.gloss().map(|rho_s| transport::ReferenceGloss::even(rho_s, stated.m));
            let sides = stated.rho_d.map(|rho_d| transport::ReferenceSide::even(rho_d, stated.rho_t, gloss()));
            Ok(transport::ReferenceLeaf::even(mesh, sides, leaf.config.lobe()))
        }
        WorldMaterial::Opaque { albedo, .. } => Ok(transport::ReferenceLeaf::opaque(mesh, albedo)),
    }
}

/// Everything through which the path tracer follows light, at a time (s). It is as [`world`], with the environment map
/// as it is, and with sunlight through every leaf that has maps for it, whether a view shows it or not.
///
/// # Errors
/// As [`world`].
pub fn traced(scene: &LoadedScene, time: f64, ledger: &Ledger) -> Result<transport::ReferenceWorld> {
    let mut out = still(scene, time, ledger)?;
    relight(&mut out, scene, None)?;
    Ok(out)
}

/// The same for callers whose leaves have no maps of sunlight that passes through them.
///
/// # Errors
/// As [`world`].
pub fn still(scene: &LoadedScene, time: f64, ledger: &Ledger) -> Result<transport::ReferenceWorld> {
    let mut out = unlit(scene, time, ledger)?;
    out.foliar = scene.drawn().map(|leaf| leaf.config.layers().cloned()).collect();
    out.periodic = scene.manifest.periodic.as_ref().map(|p| p.size_mm);
    if let Some(picture) = scene.manifest.pictured() {
        (out.dome, out.environment) = (None, Some(picture.whole.clone()));
        out.sun = out
            .sun
            .filter(|_| !scene.manifest.sun.as_ref().is_some_and(|sun| matches!(sun.light, SunLight::Picture(_))));
    }
    Ok(out)
}

/// Takes the sun out of the picture of a world that [`still`] made, and lets it shine by itself, for readers that draw
/// a coarse picture and a sun.
///
/// # Errors
/// [`crate::Error::Input`] for a physical sky that the model refuses.
pub fn part_sun(world: &mut transport::ReferenceWorld, manifest: &SceneManifest) -> Result<()> {
    if let Some(picture) = manifest.pictured() {
        (world.environment, world.sun) = (Some(picture.rest.clone()), sun_disk(manifest)?);
    }
    Ok(())
}

/// Adds the grain to the ground of a world that [`traced`] made, where the scene has one. Only pictures for people to
/// look at have it. A check compares with a renderer that draws an even ground.
pub fn grain(world: &mut transport::ReferenceWorld, scene: &LoadedScene) {
    let Some((k, ground)) = world.ground.zip(scene.manifest.ground.as_ref()) else { return };
    let size = world.periodic.unwrap_or([2.0 * ground.reach_mm.unwrap_or_default(); 2]);
    if let Some(leaf) = soil::leaf(ground, size, world.periodic.is_some()) {
        let of = world.instances[k].leaf;
        world.leaves[of] = leaf;
    }
}

/// The same for callers that need no light: without an environment map, and without sunlight through leaves.
///
/// # Errors
/// As [`world`].
pub fn unlit(scene: &LoadedScene, time: f64, ledger: &Ledger) -> Result<transport::ReferenceWorld> {
    let mut out = standing(scene, ledger)?;
    stand_at(&mut out, scene, time);
    Ok(out)
}

/// Moves the plants of a world that [`world`] made to a time (s).
///
/// # Errors
/// [`crate::Error::Input`] for a leaf whose inside cannot be read.
pub fn move_to(world: &mut transport::ReferenceWorld, scene: &LoadedScene, time: f64) -> Result<()> {
    if !scene.placed.moves().any() {
        return Ok(());
    }
    stand_at(world, scene, time);
    relight(world, scene, Some(&scene.placed.eyes))
}

/// The same, without sunlight through the leaves.
fn stand_at(world: &mut transport::ReferenceWorld, scene: &LoadedScene, time: f64) {
    let placed = &scene.placed;
    if !placed.moves().any() {
        return;
    }
    let drawn = placed.standing().filter(|p| placed.leaves[p.leaf].mesh.is_some());
    for (instance, p) in world.instances.iter_mut().zip(drawn) {
        instance.transform = placed.at_time(p, time).transform;
    }
    move_wood(world, placed, time);
    stands::move_to(world, placed, time);
    if placed.moves().grass {
        let first = scene.drawn().count();
        grass::lean(&placed.grass, world, first, time);
    }
}

/// Moves only the plants' wood.
pub fn move_wood(world: &mut transport::ReferenceWorld, placed: &PlacedScene, time: f64) {
    let after = usize::from(placed.ground.is_some()) + stands::traced(placed)[0];
    let first = world.leaves.len() - after - placed.wood.len();
    if let Some(winds) = &placed.winds {
        let sections = winds.sections(time);
        for (k, moved) in placed.wood.iter().enumerate().filter_map(|(k, wood)| Some((k, wood.moved(&sections)?))) {
            world.leaves[first + k].mesh = moved;
        }
    }
}

/// A world without leaves.
///
/// # Errors
/// [`crate::Error::Input`] for a physical sky that the model refuses.
pub fn lights(manifest: &SceneManifest) -> Result<transport::ReferenceWorld> {
    Ok(lit(manifest, &WorldLights::of(manifest)?))
}

fn lit(manifest: &SceneManifest, lights: &WorldLights) -> transport::ReferenceWorld {
    let (background, exposure) = (manifest.background, manifest.exposure);
    let mut out = transport::ReferenceWorld { background, exposure, ..transport::ReferenceWorld::default() };
    shine(&mut out, manifest, lights, 1.0);
    out
}

/// Gives a world other lights. A sky that is not the same everywhere is multiplied by `strength`.
pub fn shine(world: &mut transport::ReferenceWorld, manifest: &SceneManifest, lights: &WorldLights, strength: f64) {
    world.sun = lights.sun;
    (world.sky, world.dome) = match &lights.sky {
        WorldSky::Dark => (None, None),
        WorldSky::Even(radiance) => (Some(*radiance), None),
        WorldSky::Physical(daylight) => (None, Some(dome(manifest, (**daylight).clone(), strength))),
        WorldSky::Picture(picture) => (None, Some(pictured(&picture.rest, strength))),
    };
}

/// The sky itself, multiplied by `strength`, with the background below its horizon where there is no ground. The
/// ground's radiance is computed again from the sky, not from its harmonics.
pub fn dome(manifest: &SceneManifest, daylight: Daylight, strength: f64) -> transport::ReferenceDome {
    let above = |d: DVec3| if d.z > 0.0 { daylight.radiance(d) } else { [0.0; 3] };
    let ground = manifest.physical_sky().and_then(|s| s.ground_albedo).map(|albedo| {
        let sky = transport::closed_form::irradiance(&above, DVec3::Z);
        [0, 1, 2].map(|c| strength * albedo[c] * (sky[c] + daylight.sun[c] * daylight.zenith.cos()) / PI)
    });
    let below = ground.unwrap_or([0.0; 3]);
    transport::ReferenceDome {
        radiance: Arc::new(move |d| if d.z > 0.0 { daylight.radiance(d).map(|v| strength * v) } else { below }),
        seen_below: Some(ground.unwrap_or(manifest.background)),
        nodes: None,
    }
}

/// Columns of the picture whose texels are the nodes of a matte leaf's light: steps of 1.4°.
const NODES: usize = 256;

/// A sky that is a picture, multiplied by `strength`.
fn pictured(map: &Arc<Environment>, strength: f64) -> transport::ReferenceDome {
    let (coarse, map) = (map.reduced(NODES), map.clone());
    let node = |((direction, size), texel): ((DVec3, f64), &[f32; 3])| transport::DomeNode {
        direction,
        light: texel.map(|v| strength * size * f64::from(v)),
    };
    transport::ReferenceDome {
        nodes: Some(Arc::new(coarse.centres().zip(coarse.texels().2).map(node).collect())),
        radiance: Arc::new(move |d| map.at(d).map(|v| strength * v)),
        seen_below: None,
    }
}

fn one_leaf(mesh: LeafMesh, leaf: LoadedLeaf, fit: &LeafFit, ledger: &Ledger) -> Result<transport::ReferenceLeaf> {
    let config = leaf.config;
    let [mut width, mut height] = leaf.plan.size;
    let (mut sides, mut mask) = ([None, None], None);
    for (s, side) in Side::ALL.into_iter().enumerate().filter(|(_, side)| fit.has(*side)) {
        let read = one_side(leaf.placed.interior(config), fit, side, ledger)?;
        [width, height] = reader::same_size(fit, side, [width, height], read.size)?;
        if config.mesh.is_some() && s == 0 {
            mask = Some(read.on_leaf);
        }
        sides[s] = Some(read.side);
    }
    let [front, back] = sides.map(|s| s.unwrap_or_else(|| transport::ReferenceSide::black(width * height)));
    Ok(transport::ReferenceLeaf { mesh, width, height, front, back, mask, lobe: config.lobe() })
}

/// One side, as its maps describe it.
struct ReadSide {
    side: transport::ReferenceSide,
    size: [usize; 2],
    on_leaf: Vec<u8>,
}

fn one_side(interior: InteriorSource, fitted: &LeafFit, side: Side, ledger: &Ledger) -> Result<ReadSide> {
    let ReadPlanes { planes, on_leaf, size } = planes(interior, fitted, side, ledger)?;
    let mut planes = planes.into_iter().skip(1);
    let mut one = || planes.next().unwrap_or_default();
    let (thickness, m) = (one(), one());
    let rho_s = [one(), one(), one()];
    let interior = if fitted.is_stated() {
        transport::ReferenceInterior::Maps { rho_d: [one(), one(), one()], rho_t: [one(), one(), one()] }
    } else if interior == InteriorSource::Maps {
        solved(&thickness, &[one(), one(), one(), one(), one(), one()])
    } else {
        let (low, high) =
            thickness.iter().fold((f64::INFINITY, 0f64), |(a, b), h| (a.min(f64::from(*h)), b.max(f64::from(*h))));
        let curve =
            SlabInterpolant::new(fitted.rgb(side, Quantity::SigmaA)?, fitted.rgb(side, Quantity::SigmaS)?, low, high);
        transport::ReferenceInterior::Scalars {
            gamma: [one(), one(), one()],
            thickness,
            curve: Arc::new(move |h| curve.at(h)),
        }
    };
    let values = reader::normals(fitted, side, ledger)?;
    let normal = Some(transport::NormalMap { frame: transport::NormalFrame::Tangent, values });
    let glossy = rho_s.iter().flatten().any(|v| *v > 0.0);
    let gloss = glossy.then_some(transport::ReferenceGloss { rho_s, m });
    Ok(ReadSide { side: transport::ReferenceSide { interior, gloss, normal }, size, on_leaf })
}

/// The maps of a side, without holes.
struct ReadPlanes {
    /// Mask, thickness, m, ρs, and those of its inside.
    planes: Vec<Vec<f32>>,
    on_leaf: Vec<u8>,
    size: [usize; 2],
}

/// Reads the maps of a side.
fn planes(interior: InteriorSource, fitted: &LeafFit, side: Side, ledger: &Ledger) -> Result<ReadPlanes> {
    let path = fitted.path(LeafFitFile::Maps, side);
    let maps = reader::maps(fitted, side, ledger)?;
    let (width, height) = (maps.width, maps.height);
    let inside: &[Quantity] = match interior {
        InteriorSource::Maps if fitted.is_stated() => &[Quantity::RhoD, Quantity::RhoT],
        InteriorSource::Maps => &[Quantity::SigmaA, Quantity::SigmaS],
        InteriorSource::Scalars => &[Quantity::Gamma],
    };
    let common = [Quantity::Mask, Quantity::Thickness, Quantity::M, Quantity::RhoS];
    let mut planes = maps.require_planes(&path, &[&common, inside].concat())?;
    // A fit itself fills its maps beyond the good texels. Texels that it left undetermined are filled here.
    let good: Vec<bool> = (0..width * height).map(|k| planes.iter().all(|p| p[k].is_finite())).collect();
    let on_leaf = planes[0].iter().map(|v| u8::from(*v != 0.0)).collect();
    filling::require(&path, &mut planes, &good, width, height)?;
    Ok(ReadPlanes { planes, on_leaf, size: [width, height] })
}

/// The maps of thickness, of σa and of σs (a channel each) of a fitted side, without holes.
///
/// # Errors
/// As [`world`].
pub fn tissue(fitted: &LeafFit, side: Side, ledger: &Ledger) -> Result<Vec<Vec<f32>>> {
    let ReadPlanes { planes, .. } = planes(InteriorSource::Maps, fitted, side, ledger)?;
    // After the mask and the thickness come m and ρs.
    Ok(planes.into_iter().enumerate().filter(|(k, _)| *k == 1 || *k > 5).map(|(_, plane)| plane).collect())
}

/// ρd and ρt of every texel, from its own σa, σs and thickness.
fn solved(thickness: &[f32], sigma: &[Vec<f32>]) -> transport::ReferenceInterior {
    let texels: Vec<[f32; 6]> = (0..thickness.len())
        .into_par_iter()
        .map(|k| {
            let h = f64::from(thickness[k]);
            let r = [0, 1, 2].map(|c| slab::medium::response(f64::from(sigma[c][k]), f64::from(sigma[3 + c][k]), h));
            [r[0].rho_d, r[1].rho_d, r[2].rho_d, r[0].rho_t, r[1].rho_t, r[2].rho_t].map(|v| v as f32)
        })
        .collect();
    let plane = |c: usize| texels.iter().map(|t| t[c]).collect::<Vec<f32>>();
    transport::ReferenceInterior::Maps { rho_d: [plane(0), plane(1), plane(2)], rho_t: [plane(3), plane(4), plane(5)] }
}
