//! The largest contribution of one side's gloss to a displayed value, over all angles of the scene's views, placements
//! and suns ([`super::gloss_bound`]).

use super::gloss_bound::{self, GlossMaps, LightBounds};
use super::{LoadedLeaf, Stand};
use crate::Result;
use crate::manifest::SceneManifest;
use crate::placed::daylight::{self, Daylight};
use crate::placed::fits::reader;
use glam::{DMat4, DVec3};
use mesophyll_fits::leaf_folder::LeafFit;
use mesophyll_optics::side::Side;
use std::f64::consts::TAU;
use std::sync::Arc;

/// The largest contribution of gloss to a displayed value; infinite where camera, sun or sliders are free.
pub fn most(at: Stand, leaf: LoadedLeaf, side: Side, texels: &[[f32; 4]], fitted: &LeafFit) -> Result<f64> {
    let Stand { manifest, placed, ledger } = at;
    let Some(mesh) = &leaf.placed.mesh else { return Ok(f64::INFINITY) };
    if placed.free || manifest.sun.as_ref().is_some_and(|sun| sun.moves) {
        return Ok(f64::INFINITY);
    }
    let mut lights = lights(manifest)?;
    if !leaf.placed.facing.lit[side] {
        lights.suns.clear();
    }
    let views = manifest.perspectives();
    let seen: Vec<(DVec3, f64)> = views.map(|v| (v.camera.eye, manifest.time_of(v))).collect();
    let eyes: Arc<[DVec3]> = seen.iter().map(|(eye, _)| *eye).collect();
    let own = placed.placements.iter().filter(|p| p.leaf == leaf.placed.index);
    let places: Vec<(DMat4, Arc<[DVec3]>)> = match placed.moves().plants() {
        false => own.map(|p| (p.transform, eyes.clone())).collect(),
        true => own
            .flat_map(|p| match p.section {
                None => vec![(p.transform, eyes.clone())],
                Some(_) => seen.iter().map(|s| (placed.at_time(p, s.1).transform, Arc::from([s.0]))).collect(),
            })
            .collect(),
    };
    let h = fitted.thickness(side)?;
    let rho_d: Option<Vec<[f32; 3]>> =
        leaf.loaded.textures[side].gamma_delta.as_ref().zip(leaf.loaded.curves[side].as_ref()).map(
            |(texels, curve)| {
                let of = |t: &[f32; 4]| {
                    let rho_d = curve.at(h + f64::from(t[3])).0;
                    [0, 1, 2].map(|c| t[c] * rho_d[c] as f32)
                };
                texels.iter().map(of).collect()
            },
        );
    let lobe = leaf.config.lobe();
    let back = side == Side::Back;
    let most = |normals: Option<&[[f32; 3]]>| {
        let maps = GlossMaps { size: leaf.plan.size, back, gloss: texels, normals, rho_d: rho_d.as_deref() };
        gloss_bound::most(lobe, mesh, back, &maps.patches(mesh), &places, &lights, manifest.tolerated())
    };
    // Mapped normals only increase the bound. So they are not read where the bound with the mesh's own normals already
    // exceeds the tolerance.
    let by_mesh = most(None);
    if by_mesh > manifest.tolerated() || lights.suns.is_empty() {
        return Ok(by_mesh);
    }
    let normals = reader::normals(fitted, side, ledger)?;
    Ok(most(Some(&normals)))
}

/// All lights of the scene's views and hours.
fn lights(manifest: &SceneManifest) -> Result<LightBounds> {
    let mut out = LightBounds { exposure: manifest.exposure, ..LightBounds::default() };
    if let Some(sun) = daylight::sun_disk(manifest)? {
        out.radius = sun.radius;
        out.suns.push((sun.direction, sun.irradiance));
    }
    if let Some(radiance) = manifest.even_sky() {
        (out.sky, out.even_sky) = (radiance, radiance);
    }
    if let Some(picture) = manifest.pictured() {
        let brightest = |most: [f64; 3], t: &[f32; 3]| [0, 1, 2].map(|c| most[c].max(f64::from(t[c])));
        out.sky = picture.rest.texels().2.iter().fold([0.0; 3], brightest);
    }
    let Some(now) = Daylight::of(manifest)? else { return Ok(out) };
    let mut skies = vec![now];
    if let (Some(day), Some(sky)) = (&manifest.day, manifest.physical_sky()) {
        for hour in &day.hours {
            let (zenith, azimuth) = day.sun(*hour);
            let then = Daylight::at(manifest, zenith, azimuth, sky.turbidity)?;
            out.suns.push((daylight::direction(then.zenith, azimuth), then.sun));
            skies.push(then);
        }
    }
    for sky in &skies {
        for d in directions(sky) {
            let seen = sky.radiance(d);
            (0..3).for_each(|c| out.sky[c] = out.sky[c].max(seen[c]));
        }
    }
    Ok(out)
}

/// The directions in which a physical sky is evaluated to find its brightest point: the sun, the horizon, and a grid of
/// degrees between.
fn directions(sky: &Daylight) -> Vec<DVec3> {
    let sun = daylight::direction(sky.zenith, sky.azimuth);
    let ring = |zenith: f64| (0..180).map(move |k| daylight::direction(zenith, TAU * f64::from(k) / 180.0));
    let grid = (0..90).flat_map(|k| ring(f64::from(k).to_radians()));
    grid.chain(ring((89.99f64).to_radians())).chain([sun, -DVec3::Z]).collect()
}
