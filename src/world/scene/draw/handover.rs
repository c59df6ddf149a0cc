//! Hands a scene to the GPU renderer: the parts of each fit folder that the plan lists, as plain scene data.
//!
//! The reference renderer gets its data in another way (`super::reference`).

use super::card::LeafCard;
use super::leaf_maps;
use super::sections::{BarkSections, maps_of_sun, plants, stands};
use super::{detail, far_wood, floor, grass, soil, transfer, tubes};
use crate::loaded::LoadedScene;
use crate::loaded::curve::curve;
use crate::manifest::SceneManifest;
use crate::placed::daylight::{self, Daylight};
use crate::placed::ledger::Ledger;
use crate::placed::stand::PlacedStand;
use crate::plan::levels;
use crate::world::{SceneWorld, WorldInstance, WorldLights, WorldMaterial, WorldSky, WorldSurface};
use crate::{Error, Result};
use glam::{DMat4, DVec2, DVec3};
use mesophyll_base::tone::PictureDisplay;
use mesophyll_files::mesh::LeafMesh;
use mesophyll_optics::side::Side;
use mesophyll_sky::polynomials::FoldedPolynomials;
use mesophyll_sky::{HarmonicCoefficients, panorama};
use mesophyll_transport::ReferenceCamera;
use mesophyll_transport::environment::Environment;
use mesophyll_viewer::scene as viewer;
use mesophyll_web::bundle::slab_curve;
use rayon::prelude::*;
use std::sync::Arc;

/// A leaf gets levels of detail if it is drawn with more triangles than this in total, which is the number of pixels of
/// a small picture.
const MANY_TRIANGLES: usize = 200_000;

/// Everything the perspective views show.
///
/// # Errors
/// [`Error::Input`] for a map that is missing, damaged or of another size.
pub fn scene(scene: &LoadedScene, ledger: &Ledger) -> Result<viewer::Scene> {
    let LoadedScene { manifest, placed, .. } = scene;
    refuse(manifest)?;
    let world = SceneWorld::new(scene)?;
    let mut out = lit(scene, &world.lights, ledger)?;
    // Meshes are in the order of the transfer's meshes. Those are finer where the transfer has the vertices' shares of
    // the sun.
    let finer = scene.transfer.as_ref().and_then(|t| t.sun.as_ref()).map(|sun| &sun.receivers.blades);
    let shown = |k: usize, mesh: &LeafMesh| match finer {
        Some(blades) => viewer_mesh(&blades[k].mesh),
        None => viewer_mesh(mesh),
    };
    let at = |i: WorldInstance, carried| viewer::Instance {
        mesh: i.surface,
        material: i.surface,
        transform: i.transform.as_mat4(),
        carried,
        ..viewer::Instance::default()
    };
    for (k, surface) in world.surfaces[..world.leaves].iter().enumerate() {
        out.add(shown(k, surface.mesh), material(manifest, surface, ledger)?);
    }
    let leaf = |i: WorldInstance| at(i, i.section.map(|k| viewer::SectionBinding { first: k as u32, vertices: None }));
    out.instances.extend(world.standing_leaves().map(leaf));
    for stand in 0..placed.stands.len() {
        let leaves = world.stand_leaves(stand);
        out.instances.extend(leaves.map(|i| viewer::Instance { stand: Some(stand as u32), ..leaf(i) }));
    }
    let often = |i: &viewer::Instance| i.stand.map_or(1, |k| placed.stands[k as usize].places.len());
    // A coarse triangle would blur the shadows that are stored at its corners.
    for (k, surface) in world.surfaces[..world.leaves].iter().enumerate().filter(|_| finer.is_none()) {
        let own = out.instances.iter().filter(|i| i.mesh == k).map(often);
        let drawn = own.sum::<usize>().saturating_mul(surface.mesh.triangles());
        if drawn > MANY_TRIANGLES {
            let what = format!("{}: levels of detail", out.materials[k].name());
            // The corners of a card have no place among the anchors of light between leaves.
            let card = scene.transfer.is_none();
            out.meshes[k] = ledger.note("make", what, 0, || with_details(surface.mesh, out.leaf(k), card));
        }
    }
    let leaves: usize = out.instances.iter().map(|i| often(i) * (out.meshes[i.mesh].indices.len() / 3)).sum();
    let of_stand = |s: &PlacedStand| s.places.len() * s.wood.iter().map(|w| w.mesh.triangles()).sum::<usize>();
    let all_wood: usize = placed.wood.iter().map(|w| w.mesh.triangles() * w.places.len()).sum::<usize>()
        + placed.stands.iter().map(of_stand).sum::<usize>();
    let mut barks = BarkSections::default();
    let (mut carried, ground) = (Vec::new(), world.ground());
    for (k, surface) in world.surfaces.iter().enumerate().skip(world.leaves) {
        let (wood, mut on_ring) = (Some(k) != ground, Vec::new());
        let mut mesh = if wood { shown(k, surface.mesh) } else { viewer_mesh(surface.mesh) };
        if wood && leaves + all_wood > MANY_TRIANGLES && scene.transfer.is_none() {
            let solids = world.leaves + placed.wood.len() + usize::from(ground.is_some());
            let bends = surface.bark.is_some();
            let found = match k < solids {
                true => tubes::levels(surface.mesh, bends),
                false => far_wood::levels(surface.mesh, bends),
            };
            append(&mut mesh, found.levels, &found.more);
            on_ring = found.on_ring;
        }
        carried.push(surface.bark.map(|bark| barks.carried(bark, &on_ring)));
        out.add(mesh, material(manifest, surface, ledger)?);
    }
    out.instances.extend(world.standing_solids().map(|i| at(i, carried[i.surface - world.leaves])));
    if let Some(ground) = ground.and(out.instances.last_mut()) {
        ground.floor = !placed.free
            && out.sun.is_some_and(|s| s.direction.z > 0.0)
            && manifest.ground.as_ref().is_some_and(|g| g.hill.is_none())
            && floor::hides_what_is_below(manifest, placed);
    }
    for stand in 0..placed.stands.len() {
        let wood = |surface| WorldInstance { surface, transform: DMat4::IDENTITY, section: None };
        let carried = |i: WorldInstance| at(i, carried[i.surface - world.leaves]);
        let all = world.stand_wood(stand).map(|surface| carried(wood(surface)));
        out.instances.extend(all.map(|i| viewer::Instance { stand: Some(stand as u32), ..i }));
    }
    stands(placed, &mut out);
    if let Some(most) = maps_of_sun(placed, &out) {
        out.shadow_samples = out.shadow_samples.min(most);
    }
    plants(placed, manifest.wind.as_ref().is_some_and(|w| w.simplified), barks, &mut out);
    for lawn in &placed.grass {
        let slices = lawn.slices(manifest, ledger)?;
        let soil = placed.ground.as_ref().map_or([0.0; 3], |(_, albedo)| *albedo);
        let mut drawn = ledger.note("make", format!("{}: light in the lawn", lawn.name), 0, || {
            grass::lawn(lawn, &slices, soil, manifest.grass[lawn.index].steps)
        });
        if !placed.free && !manifest.sun_moves() && !grass::seen_from_above(lawn, &slices, manifest) {
            drawn.level = None;
        }
        out.grass.push(Arc::new(drawn));
    }
    if placed.moves().with_time() {
        out.wind = Some(viewer::WindState { time_s: manifest.rest_time() });
    }
    if let Some(found) = &scene.transfer {
        transfer::arriving(found, &levels::eyes(manifest, placed), &mut out);
        if let Some(sun) = &world.lights.sun {
            transfer::shade(found, sun.direction, &mut out)?;
        }
    }
    Ok(out)
}

/// The same as it is shown to people, with the scene's bloom and the ground's grain. Checks leave all of it out.
///
/// # Errors
/// As [`scene`].
pub fn shown(of: &LoadedScene, display: PictureDisplay, ledger: &Ledger) -> Result<viewer::Scene> {
    let manifest = &of.manifest;
    let bloom = manifest.bloom.filter(|share| *share > 0.0).map(|share| share as f32);
    let exposure = manifest.exposure_of(display.curve) as f32;
    let mut out = viewer::Scene { bloom, display, exposure, ..scene(of, ledger)? };
    let ground = SceneWorld::new(of)?.ground();
    if let (Some(viewer::Material::Opaque(soil)), Some(ground)) =
        (ground.and_then(|k| out.materials.get_mut(k)), &manifest.ground)
    {
        soil.pattern = soil::pattern(ground);
    }
    Ok(out)
}

/// A blade in the renderer's precision, with its levels of detail. With `card`, the coarsest are flat, and the last is
/// a card, where these can stand for the blade; the mesh then has vertices of its own for them, after the blade's.
pub fn with_details(mesh: &LeafMesh, leaf: Option<&viewer::LeafMaterial>, card: bool) -> viewer::Mesh {
    let mut out = viewer_mesh(mesh);
    let cut = leaf.and_then(|l| Some((l.mask.as_ref()?, [l.width, l.height])));
    let shown = cut.map(|(mask, [width, height])| {
        let texel = |t: f64, n: u32| (t * f64::from(n)).clamp(0.0, f64::from(n) - 1.0) as usize;
        move |t: DVec2| mask.get(texel(t.y, height) * width as usize + texel(t.x, width)).is_some_and(|m| *m != 0)
    });
    let shown = shown.as_ref().map(|f| f as &dyn Fn(DVec2) -> bool);
    let (levels, piece) =
        if card { detail::levels_with_pieces(mesh, shown) } else { (detail::levels(mesh), LeafMesh::default()) };
    append(&mut out, levels, &piece);
    out
}

/// Gives a mesh levels of detail, and the vertices that only these have.
fn append(mesh: &mut viewer::Mesh, levels: Vec<detail::MeshDetailLevel>, vertices: &LeafMesh) {
    let more = viewer_mesh(vertices);
    mesh.positions.extend(more.positions);
    mesh.normals.extend(more.normals);
    mesh.tangents.extend(more.tangents);
    mesh.uvs.extend(more.uvs);
    mesh.details.extend(levels.into_iter().map(|level| viewer::DetailLevel {
        indices: level.indices,
        error: level.error_mm as f32,
        outline_only: level.outline_only,
    }));
}

fn material(manifest: &SceneManifest, surface: &WorldSurface, ledger: &Ledger) -> Result<viewer::Material> {
    Ok(match surface.material {
        WorldMaterial::Fitted(leaf, fit) => viewer::Material::Leaf(leaf_maps::fitted(manifest, leaf, fit, ledger)?),
        WorldMaterial::Stated(leaf, stated) => viewer::Material::Leaf(leaf_maps::uniform(leaf, stated)),
        WorldMaterial::Opaque { name, albedo } => {
            viewer::Material::Opaque(viewer::OpaqueMaterial { name: name.into(), albedo: rgb(&albedo), pattern: None })
        }
    })
}

/// A colour in the renderer's precision.
fn rgb(c: &[f64; 3]) -> [f32; 3] {
    c.map(|v| v as f32)
}

/// Refuses what only the path tracer draws.
fn refuse(manifest: &SceneManifest) -> Result<()> {
    let beyond = [
        ("periodic", "scenes that repeat", manifest.periodic.is_some()),
        ("leaf.discs", "discs", manifest.leaves.iter().any(|l| l.discs.is_some())),
    ];
    let Some((field, what, _)) = beyond.iter().find(|b| b.2) else { return Ok(()) };
    let told = format!("the real-time renderer draws no {what}; `mesophyll render` does");
    Err(Error::field(&manifest.path, field, told))
}

/// Sun, sky, exposure, and the sampling of shadows and edges.
fn lit(
    LoadedScene { manifest, plan, .. }: &LoadedScene,
    lights: &WorldLights,
    ledger: &Ledger,
) -> Result<viewer::Scene> {
    let bands = plan.light.sky_bands;
    let (sky, dome) = match &lights.sky {
        WorldSky::Dark => (None, None),
        WorldSky::Even(radiance) => (Some(rgb(radiance)), None),
        WorldSky::Physical(daylight) => {
            let polynomials = daylight::polynomials(manifest, plan.light.sun_moves, ledger)?;
            (None, Some(dome(daylight, bands, polynomials)?))
        }
        WorldSky::Picture(p) => (None, Some(pictured(&p.rest, bands, lights.sun.map(|sun| sun.direction)))),
    };
    Ok(viewer::Scene {
        sun: lights.sun.map(|sun| viewer::Sun {
            direction: sun.direction.as_vec3(),
            irradiance: rgb(&sun.irradiance),
            radius: sun.radius as f32,
        }),
        sky,
        dome,
        background: rgb(&manifest.background),
        exposure: manifest.exposure as f32,
        shadow_samples: plan.light.shadow_samples,
        shadow_resolution: plan.light.shadow_resolution,
        msaa: plan.light.msaa,
        ..viewer::Scene::default()
    })
}

/// A sky as plain numbers.
///
/// # Errors
/// [`Error::Usage`] for a sun or turbidity outside the range of the polynomials.
pub fn dome(
    daylight: &Daylight,
    bands: usize,
    polynomials: Option<&FoldedPolynomials<f32>>,
) -> Result<viewer::SkyDome> {
    let light = daylight.light(bands, polynomials)?;
    let picture = daylight.perez().is_none().then(|| looked_at(daylight));
    let (perez, scale) = daylight.perez().unwrap_or_default();
    Ok(viewer::SkyDome {
        harmonics: single(&light.harmonics),
        picture,
        perez: perez.map(|row| row.map(|v| v as f32)),
        scale: scale.map(|v| v as f32),
        ground: light.ground.map(|c| c.map(|v| v as f32)),
        sun: daylight::direction(daylight.zenith, daylight.azimuth).as_vec3(),
        strength: 1.0,
        turbidity: daylight.turbidity as f32,
    })
}

/// Columns of the picture of a sky whose formula the renderer does not know: steps of 0.18°.
const LOOK: usize = 2048;

/// What a model's sky looks like. Below the horizon it goes on as it is just above it, because the renderer draws the
/// ground there.
fn looked_at(daylight: &Daylight) -> viewer::Backdrop {
    let directions: Vec<[f64; 3]> = panorama::centres(LOOK, LOOK / 2).collect();
    let seen = |d: &[f64; 3]| {
        let above = DVec3::new(d[0], d[1], d[2].max(1e-4)).normalize();
        daylight.radiance(above).map(|v| v.max(0.0) as f32)
    };
    let texels = Arc::new(directions.par_iter().map(seen).collect());
    viewer::Backdrop { width: LOOK as u32, height: LOOK as u32 / 2, texels, turn: 0.0 }
}

/// A sky that is a picture: its harmonics light the leaves, and it is seen behind them.
pub fn pictured(map: &Environment, bands: usize, sun: Option<DVec3>) -> viewer::SkyDome {
    let (width, height, texels) = map.texels();
    viewer::SkyDome {
        harmonics: single(&map.harmonics(bands)),
        picture: Some(viewer::Backdrop {
            width: width as u32,
            height: height as u32,
            texels: Arc::new(texels.to_vec()),
            turn: map.turn() as f32,
        }),
        perez: [[0.0; 5]; 3],
        scale: [0.0; 3],
        ground: None,
        sun: sun.unwrap_or(DVec3::Z).as_vec3(),
        strength: 1.0,
        turbidity: 0.0,
    }
}

/// Coefficients in the renderer's precision.
fn single(of: &HarmonicCoefficients) -> Vec<[f32; 3]> {
    of.values().iter().map(|c| c.map(|v| v as f32)).collect()
}

/// A camera in the renderer's precision.
pub fn camera(camera: &ReferenceCamera) -> viewer::Camera {
    let [eye, target, up] = [camera.eye, camera.target, camera.up].map(|v| v.as_vec3());
    viewer::Camera { eye, target, up, fov_y_deg: camera.fov_y_deg as f32 }
}

/// A mesh in the renderer's precision.
pub fn viewer_mesh(mesh: &LeafMesh) -> viewer::Mesh {
    viewer::Mesh {
        positions: mesh.positions.iter().map(|p| p.as_vec3()).collect(),
        normals: mesh.normals.iter().map(|p| p.as_vec3()).collect(),
        tangents: mesh.tangents.iter().map(|(t, w)| t.extend(*w).as_vec4()).collect(),
        uvs: mesh.uvs.iter().map(|t| t.as_vec2()).collect(),
        indices: mesh.indices.clone(),
        ..viewer::Mesh::default()
    }
}

/// A card: one flat patch with a leaf's mean parameters, drawn with the same slab curve as a leaf.
///
/// # Errors
/// [`Error::Input`] for a physical sky that the model refuses.
pub fn card(scene: &LoadedScene, card: &LeafCard, ledger: &Ledger) -> Result<viewer::Scene> {
    let manifest = &scene.manifest;
    refuse(manifest)?;
    let mut out = lit(scene, &WorldLights::of(manifest)?, ledger)?;
    (out.shadow_samples, out.msaa) = (0, 1);
    let thickness = card.sides.iter().find_map(|(_, p)| Some(p.as_ref()?.thickness)).unwrap_or(1.0);
    let side = |side: Side| match card.sides[side].as_ref().filter(|_| card.planned[side]) {
        None => viewer::SideMaps::black(),
        Some(p) => {
            let (low, high) = (0.95 * p.thickness.min(thickness), 1.05 * p.thickness.max(thickness));
            let (curve, _) = curve(p.sigma_a, p.sigma_s, [low, high], 1e-5, "card slab curve", ledger);
            viewer::SideMaps {
                gamma_delta: vec![[
                    p.gamma[0] as f32,
                    p.gamma[1] as f32,
                    p.gamma[2] as f32,
                    (p.thickness - thickness) as f32,
                ]],
                gloss: p
                    .rho_s
                    .iter()
                    .any(|v| *v > 0.0)
                    .then(|| vec![[p.rho_s[0] as f32, p.rho_s[1] as f32, p.rho_s[2] as f32, p.m as f32]]),
                normal: None,
                translucency: None,
                interior: viewer::Interior::Scalars(slab_curve(&curve)),
            }
        }
    };
    let leaf = leaf_maps::even(&manifest.leaves[card.leaf], thickness, side);
    let drawn = out.add(viewer_mesh(&card.mesh), viewer::Material::Leaf(leaf));
    out.instances = vec![viewer::Instance { transform: card.transform.as_mat4(), ..drawn }];
    Ok(out)
}
