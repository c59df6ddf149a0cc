//! Hands a scene to the reference renderer in a separate way. It uses `front.exr` and `back.exr` (γ, thickness, ρs, m
//! and normals of each texel in the scan's frame) instead of W's packed textures, and its own interpolation of the slab
//! (Chebyshev in the thickness). Nothing that the plan leaves out is left out here: gloss, normals, translucency and
//! both sides are drawn wherever the fit has them.

use super::sunlight::{relight, relight_everywhere};
use super::{grass, soil};
use crate::loaded::{LoadedLeaf, LoadedScene};
use crate::manifest::{InteriorSource, SceneManifest, ViewCamera};
use crate::placed::PlacedScene;
use crate::placed::daylight::{Daylight, sun_direction};
use crate::placed::fits::reader;
use crate::placed::ledger::Ledger;
use crate::{Error, Result};
use glam::{DMat4, DVec3, DVec4};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_files::quantity::Quantity;
use mesophyll_fits::leaf_folder::{LeafFit, LeafFitFile, filling};
use mesophyll_optics::side::Side;
use mesophyll_optics::slab;
use mesophyll_optics::slab::chebyshev::SlabInterpolant;
use mesophyll_transport::environment::Environment;
use mesophyll_transport::{self as transport, lobe, world};
use rayon::prelude::*;
use std::f64::consts::PI;
use std::sync::Arc;

/// Everything the perspective views show.
///
/// # Errors
/// [`Error::Input`] for a map that is missing, damaged or of another size.
pub fn world(scene: &LoadedScene, ledger: &Ledger) -> Result<transport::ReferenceWorld> {
    let mut out = standing(scene, ledger)?;
    stand_at(&mut out, scene, scene.manifest.rest_time());
    relight(&mut out, scene, &scene.placed.eyes)?;
    Ok(out)
}

/// The scene at rest, without sunlight through its leaves.
fn standing(scene: &LoadedScene, ledger: &Ledger) -> Result<transport::ReferenceWorld> {
    let LoadedScene { manifest, placed, .. } = scene;
    let mut out = lights(manifest)?;
    let mut index = vec![None; placed.leaves.len()];
    for leaf in scene.drawn() {
        index[leaf.placed.index] = Some(out.leaves.len());
        out.leaves.push(one_leaf(manifest, leaf, ledger)?);
    }
    for p in &placed.placements {
        if let Some(leaf) = index[p.leaf] {
            out.instances.push(transport::ReferencePlacement { leaf, transform: p.transform });
        }
    }
    placed.grass.iter().try_for_each(|grass| grass::blades(manifest, grass, &mut out))?;
    for wood in &placed.wood {
        let leaf = out.leaves.len();
        out.instances
            .extend(wood.places.iter().map(|transform| transport::ReferencePlacement { leaf, transform: *transform }));
        out.leaves.push(barked(wood.bark, &wood.mesh));
    }
    if let Some((ground, albedo)) = &placed.ground {
        out.ground = Some(out.instances.len());
        out.instances.push(transport::ReferencePlacement { leaf: out.leaves.len(), transform: DMat4::IDENTITY });
        out.leaves.push(barked(*albedo, ground));
    }
    Ok(out)
}

/// Wood: diffuse bark that transmits nothing.
fn barked(bark: [f64; 3], rest: &LeafMesh) -> transport::ReferenceLeaf {
    let mut front = black(1);
    if let transport::ReferenceInterior::Maps { rho_d, .. } = &mut front.interior {
        *rho_d = bark.map(|v| vec![v as f32]);
    }
    transport::ReferenceLeaf {
        mesh: mesh(rest),
        width: 1,
        height: 1,
        front,
        back: black(1),
        mask: None,
        lobe: lobe::Lobe::Beckmann,
    }
}

/// Everything through which the path tracer follows light, at a time (s). It is as [`world`], with the environment map
/// as it is, and with sunlight through every leaf that has maps for it, whether a view shows it or not.
///
/// # Errors
/// As [`world`].
pub fn traced(scene: &LoadedScene, time: f64, ledger: &Ledger) -> Result<transport::ReferenceWorld> {
    let mut out = still(scene, time, ledger)?;
    relight_everywhere(&mut out, scene)?;
    Ok(out)
}

/// The same for callers whose leaves have no maps of sunlight that passes through them.
///
/// # Errors
/// As [`world`].
pub fn still(scene: &LoadedScene, time: f64, ledger: &Ledger) -> Result<transport::ReferenceWorld> {
    let mut out = unlit(scene, time, ledger)?;
    out.foliar = scene.drawn().map(|leaf| leaf.config.layers.clone()).collect();
    out.periodic = scene.manifest.periodic.as_ref().map(|p| p.size_mm);
    if let Some(picture) = scene.manifest.pictured() {
        (out.dome, out.environment) = (None, Some(picture.whole.clone()));
        out.sun = out.sun.filter(|_| !scene.manifest.sun.as_ref().is_some_and(|sun| sun.in_picture));
    }
    Ok(out)
}

/// Takes the sun out of the picture of a world that [`still`] made, and lets it shine by itself, for readers that draw
/// a coarse picture and a sun.
///
/// # Errors
/// [`Error::Input`] for a physical sky that the model refuses.
pub fn part_sun(world: &mut transport::ReferenceWorld, manifest: &SceneManifest) -> Result<()> {
    if let Some(picture) = manifest.pictured() {
        (world.environment, world.sun) = (Some(picture.rest.clone()), sun(manifest)?);
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
/// [`Error::Input`] for a leaf whose inside cannot be read.
pub fn move_to(world: &mut transport::ReferenceWorld, scene: &LoadedScene, time: f64) -> Result<()> {
    if !scene.placed.moves().any() {
        return Ok(());
    }
    stand_at(world, scene, time);
    relight(world, scene, &scene.placed.eyes)
}

/// The same, without sunlight through the leaves.
fn stand_at(world: &mut transport::ReferenceWorld, scene: &LoadedScene, time: f64) {
    let placed = &scene.placed;
    if !placed.moves().any() {
        return;
    }
    let drawn = placed.placements.iter().filter(|p| placed.leaves[p.leaf].mesh.is_some());
    for (instance, p) in world.instances.iter_mut().zip(drawn) {
        instance.transform = placed.at_time(p, time).transform;
    }
    move_wood(world, placed, time);
    if placed.moves().grass {
        let first = scene.drawn().count();
        grass::lean(&placed.grass, world, first, time);
    }
}

/// Moves only the plants' wood.
pub fn move_wood(world: &mut transport::ReferenceWorld, placed: &PlacedScene, time: f64) {
    let first = world.leaves.len() - usize::from(placed.ground.is_some()) - placed.wood.len();
    if let Some(winds) = &placed.winds {
        let sections = winds.sections(time);
        for (k, moved) in placed.wood.iter().enumerate().filter_map(|(k, wood)| Some((k, wood.moved(&sections)?))) {
            world.leaves[first + k].mesh = mesh(&moved);
        }
    }
}

/// A world without leaves.
///
/// # Errors
/// [`Error::Input`] for a physical sky that the model refuses.
pub fn lights(manifest: &SceneManifest) -> Result<transport::ReferenceWorld> {
    let daylight = Daylight::of(manifest)?.map(|d| dome(manifest, d, 1.0));
    Ok(transport::ReferenceWorld {
        sun: sun(manifest)?,
        sky: manifest.even_sky(),
        dome: daylight.or_else(|| manifest.pictured().map(|p| pictured(&p.rest, 1.0))),
        background: manifest.background,
        exposure: manifest.exposure,
        ..transport::ReferenceWorld::default()
    })
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
pub fn pictured(map: &Arc<Environment>, strength: f64) -> transport::ReferenceDome {
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

/// The sun in the reference renderer's form; `None` where the scene has none.
pub fn sun(manifest: &SceneManifest) -> Result<Option<transport::ReferenceSun>> {
    let (Some(direction), Some(sun)) = (sun_direction(manifest), &manifest.sun) else { return Ok(None) };
    let own = Daylight::of(manifest)?.map(|d| d.sun);
    let irradiance = sun.irradiance.or(own).unwrap_or_default();
    Ok(Some(transport::ReferenceSun { direction, irradiance, radius: sun.radius_deg.to_radians() }))
}

/// The camera of a view.
pub fn camera(camera: &ViewCamera) -> transport::ReferenceCamera {
    transport::ReferenceCamera {
        eye: DVec3::from(camera.eye_mm),
        target: DVec3::from(camera.target_mm),
        up: DVec3::from(camera.up),
        fov_y_deg: camera.fov_deg,
    }
}

/// A mesh in the reference renderer's form.
pub fn mesh(mesh: &LeafMesh) -> transport::ReferenceMesh {
    transport::ReferenceMesh {
        positions: mesh.positions.clone(),
        normals: mesh.normals.clone(),
        tangents: mesh.tangents.iter().map(|(t, w)| DVec4::from((*t, *w))).collect(),
        uvs: mesh.uvs.clone(),
        indices: mesh.indices.clone(),
        discs: false,
    }
}

/// A side that the fit does not have, or a side of wood.
pub fn black(texels: usize) -> transport::ReferenceSide {
    let none = || [vec![0.0; texels], vec![0.0; texels], vec![0.0; texels]];
    transport::ReferenceSide {
        interior: transport::ReferenceInterior::Maps { rho_d: none(), rho_t: none() },
        gloss: None,
        normal: None,
    }
}

/// A leaf with everything that its fit has. Parts that the plan leaves out are drawn here too, so that the picture is
/// compared with the leaf and not with the plan.
fn one_leaf(manifest: &SceneManifest, leaf: LoadedLeaf, ledger: &Ledger) -> Result<transport::ReferenceLeaf> {
    let config = leaf.config;
    if let (Some(blade), Some(stated)) = (&leaf.placed.mesh, &config.uniform) {
        return Ok(uniform(config, stated, blade));
    }
    let (Some(blade), Some(fitted)) = (&leaf.placed.mesh, &leaf.placed.fitted) else {
        return Err(Error::field(
            &manifest.path,
            &format!("leaf \"{}\"", config.name),
            "its maps are not made yet; `mesophyll run` makes them",
        ));
    };
    let mut size = leaf.plan.size;
    let (mut sides, mut mask) = ([None, None], None);
    for (s, side) in Side::ALL.into_iter().enumerate().filter(|(_, side)| fitted.has(*side)) {
        let read = one_side(leaf.placed.interior(config), fitted, side, ledger)?;
        size = reader::same_size(fitted, side, size, read.size)?;
        if config.mesh.is_some() && s == 0 {
            mask = Some(read.on_leaf);
        }
        sides[s] = Some(read.side);
    }
    let [front, back] = sides.map(|s| s.unwrap_or_else(|| black(size[0] * size[1])));
    Ok(transport::ReferenceLeaf {
        mesh: mesh(blade),
        width: size[0],
        height: size[1],
        front,
        back,
        mask,
        lobe: config.lobe(),
    })
}

/// A leaf that is the same everywhere.
fn uniform(
    config: &crate::manifest::StatedLeaf,
    stated: &crate::manifest::UniformLeaf,
    blade: &LeafMesh,
) -> transport::ReferenceLeaf {
    let maps = |c: &[f64; 3]| c.map(|v| vec![v as f32]);
    let [front, back] = stated.rho_d.each_ref().map(|rho_d| transport::ReferenceSide {
        interior: transport::ReferenceInterior::Maps { rho_d: maps(rho_d), rho_t: maps(&stated.rho_t) },
        gloss: stated.gloss().map(|rho_s| transport::ReferenceGloss { rho_s: maps(&rho_s), m: vec![stated.m as f32] }),
        normal: None,
    });
    let mesh = transport::ReferenceMesh { discs: config.discs.is_some(), ..mesh(blade) };
    transport::ReferenceLeaf { mesh, width: 1, height: 1, front, back, mask: None, lobe: config.lobe() }
}

/// One side, as its maps describe it.
struct ReadSide {
    side: transport::ReferenceSide,
    size: [usize; 2],
    on_leaf: Vec<u8>,
}

fn one_side(interior: InteriorSource, fitted: &LeafFit, side: Side, ledger: &Ledger) -> Result<ReadSide> {
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
    Ok(ReadSide { side: transport::ReferenceSide { interior, gloss, normal }, size: [width, height], on_leaf })
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
    world::ReferenceInterior::Maps { rho_d: [plane(0), plane(1), plane(2)], rho_t: [plane(3), plane(4), plane(5)] }
}
