//! The plan of one side's gloss: kept, unless what it adds to a displayed value stays below the scene's tolerance at
//! every angle that the scene's views, placements and suns have ([`crate::loaded::gloss_bound`]).

use super::leaf::{Rgba, rgba, same_size, texture_bytes};
use super::light;
use super::{LeafPlan, LeftOut, Plan, sun_direction};
use crate::Result;
use crate::fits::fitted::Fitted;
use crate::ledger::Ledger;
use crate::loaded::gloss_bound::{self, Lights, Maps};
use crate::manifest::{Manifest, ViewKind};
use crate::placed::branch;
use crate::placed::daylight::{self, Daylight};
use glam::{DMat4, DVec3};
use mesophyll_optics::side::Side;
use std::f64::consts::TAU;

/// Decides about the gloss of side `s`, and reads its texture where it is needed.
///
/// # Errors
/// [`crate::Error::Input`] for a map that is missing, damaged or of another size.
pub fn side(manifest: &Manifest, leaf: &mut LeafPlan, s: usize, plan: &mut Plan, ledger: &Ledger) -> Result<()> {
    let Some(fitted) = leaf.fitted.clone() else { return Ok(()) };
    let side = Side::ALL[s];
    let file = format!("{}_rho_s_m.exr", side.name());
    let name = fitted.entry(&file);
    if !leaf.sides[s].gloss {
        if fitted.has(side) {
            let why = format!("no light falls on the {} where a camera sees it", side.name());
            plan.leave_out(LeftOut::new(name, why, texture_bytes(leaf.size) + fitted.file_bytes(&file), None));
        }
        return Ok(());
    }
    let Rgba { size, texels, .. } = rgba(&fitted, &file, ledger, |t| t[3] > 0.0)?;
    leaf.size = same_size(leaf.size, size, &fitted, &file)?;
    let tolerated = manifest.tolerance;
    let left = if texels.iter().all(|t| t[..3].iter().all(|v| *v <= 0.0)) {
        Some("matte: rho_s is zero everywhere".to_string())
    } else {
        let most = largest(manifest, leaf, s, &texels, plan, &fitted, ledger)?;
        (most < tolerated).then(|| {
            format!(
                "matte: at the angles of this scene's views and lights a highlight adds at most {most:.1e} to a \
                 displayed value, \
                 the scene tolerates {tolerated:.1e}"
            )
        })
    };
    if let Some(why) = left {
        leaf.sides[s].gloss = false;
        plan.leave_out(LeftOut::new(name, why, texture_bytes(size), None));
        return Ok(());
    }
    // How much a lobe mirrors of a sky depends on the angle between normal and view, of a constant sky too.
    leaf.sides[s].normal |= manifest.sky.is_some();
    leaf.textures[s].gloss = Some(texels);
    Ok(())
}

/// What gloss adds to a displayed value at most; infinite where a camera, a sun or a slider may take it anywhere.
fn largest(
    manifest: &Manifest,
    leaf: &LeafPlan,
    s: usize,
    texels: &[[f32; 4]],
    plan: &Plan,
    fitted: &Fitted,
    ledger: &Ledger,
) -> Result<f64> {
    let Some(mesh) = &leaf.mesh else { return Ok(f64::INFINITY) };
    if plan.free || manifest.sun.as_ref().is_some_and(|sun| sun.moves) {
        return Ok(f64::INFINITY);
    }
    let mut lights = lights(manifest)?;
    if !leaf.facing.lit[s] {
        lights.suns.clear();
    }
    let places: Vec<(DMat4, Vec<DVec3>)> = plan
        .placements
        .iter()
        .filter(|p| p.leaf == leaf.index)
        .flat_map(|p| {
            let views = manifest.views.iter().filter(|v| v.kind == ViewKind::Perspective);
            let seen = views.filter_map(|v| Some((v.eye_mm?.into(), branch::time(manifest, v))));
            if p.ride.is_none() || plan.bends.is_none() {
                vec![(p.transform, seen.map(|(eye, _)| eye).collect())]
            } else {
                seen.map(|(eye, time)| (plan.at_time(p, time).transform, vec![eye])).collect()
            }
        })
        .collect();
    let h = fitted.thickness(Side::ALL[s])?;
    let rho_d: Option<Vec<[f32; 3]>> =
        leaf.textures[s].gamma_delta.as_ref().zip(leaf.curves[s].as_ref()).map(|(texels, curve)| {
            let of = |t: &[f32; 4]| {
                let rho_d = curve.at(h + f64::from(t[3])).0;
                [0, 1, 2].map(|c| t[c] * rho_d[c] as f32)
            };
            texels.iter().map(of).collect()
        });
    let lobe = manifest.leaves[leaf.index].lobe();
    let most = |normals: Option<&[[f32; 3]]>| {
        let maps = Maps { size: leaf.size, back: s == 1, gloss: texels, normals, rho_d: rho_d.as_deref() };
        gloss_bound::most(lobe, mesh, s == 1, &maps.patches(mesh), &places, &lights, manifest.tolerance)
    };
    // Mapped normals only make the bound larger: they are not read where the mesh's own already exceed what is
    // tolerated.
    let by_mesh = most(None);
    if by_mesh > manifest.tolerance || lights.suns.is_empty() {
        return Ok(by_mesh);
    }
    let file = format!("{}_normal.exr", Side::ALL[s].name());
    let maps = fitted.maps(&file, &["X", "Y", "Z"], ledger)?;
    same_size(leaf.size, [maps.width, maps.height], fitted, &file)?;
    let plane: Vec<&[f32]> = maps.channels.iter().map(|(_, p)| p.as_slice()).collect();
    // A texel that the fit could not determine takes its neighbours' normal when it is drawn.
    let normal = |k: usize| [0, 1, 2].map(|c| plane[c][k]);
    let normals: Vec<[f32; 3]> = (0..plane[0].len())
        .map(normal)
        .map(|n| if n.iter().all(|v| v.is_finite()) { n } else { [0.0, 0.0, 1.0] })
        .collect();
    Ok(most(Some(&normals)))
}

/// Everything that lights the scene's views and hours.
fn lights(manifest: &Manifest) -> Result<Lights> {
    let mut out = Lights { exposure: manifest.exposure, ..Lights::default() };
    let (irradiance, _) = light::levels(manifest);
    if let (Some(direction), Some(sun)) = (sun_direction(manifest), &manifest.sun) {
        out.radius = sun.radius_deg.to_radians();
        out.suns.push((direction, irradiance));
    }
    if let Some(radiance) = manifest.sky.as_ref().and_then(|s| s.radiance) {
        (out.sky, out.even_sky) = (radiance, radiance);
    }
    let Some(now) = Daylight::of(manifest)? else { return Ok(out) };
    let mut skies = vec![now];
    if let (Some(day), Some(sky)) = (&manifest.day, &manifest.sky) {
        for hour in &day.hours {
            let (zenith, azimuth) = daylight::sun_of(day, *hour);
            let then = Daylight::at(manifest, zenith, azimuth, sky.turbidity.unwrap_or_default())?;
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

/// Where a physical sky is looked at for its brightest point: the sun, the horizon and a grid of degrees between.
fn directions(sky: &Daylight) -> Vec<DVec3> {
    let sun = daylight::direction(sky.zenith, sky.azimuth);
    let ring = |zenith: f64| (0..180).map(move |k| daylight::direction(zenith, TAU * f64::from(k) / 180.0));
    let grid = (0..90).flat_map(|k| ring(f64::from(k).to_radians()));
    grid.chain(ring((89.99f64).to_radians())).chain([sun, -DVec3::Z]).collect()
}
