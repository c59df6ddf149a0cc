//! Hashes of what a transfer is made from: the surfaces that light meets, and the light.

use glam::DVec3;
use mesophyll_files::hash;
use mesophyll_transport::transfer::TransferColumns;
use mesophyll_transport::world::{ReferenceInterior, ReferenceLeaf, ReferenceSide, ReferenceWorld, SunlitMaps};
use std::f64::consts::PI;

/// The hash of every mesh, map and place.
pub fn hash(world: &ReferenceWorld, leaves: usize) -> String {
    let each: Vec<String> = world.leaves.iter().map(leaf).collect();
    let places = world.instances.iter().flat_map(|p| {
        let matrix = p.transform.to_cols_array().into_iter().flat_map(f64::to_le_bytes);
        (p.leaf as u64).to_le_bytes().into_iter().chain(matrix)
    });
    let places = hash::bytes(&places.collect::<Vec<u8>>());
    let told = format!("{leaves} {:?}", world.periodic);
    let parts = each.iter().map(|h| ("leaf", h.as_str()));
    hash::combine(parts.chain([("places", places.as_str()), ("told", told.as_str())]))
}

/// The number of directions, spread evenly over the sphere, whose radiance identifies a sky.
const DIRECTIONS: usize = 2000;

/// Radiance of the sky in one of the [`DIRECTIONS`].
fn sky(world: &ReferenceWorld, k: usize) -> [f64; 3] {
    let golden = PI * (3.0 - 5f64.sqrt());
    let z = 1.0 - 2.0 * (k as f64 + 0.5) / DIRECTIONS as f64;
    let (sin, cos) = (golden * k as f64).sin_cos();
    let r = (1.0 - z * z).sqrt();
    world.sky_radiance(DVec3::new(r * cos, r * sin, z))
}

/// The number that entries are divided by before they are stored as half floats. Where entries are the light itself,
/// which may have any unit, it is about the largest irradiance. Elsewhere it is 1.
pub fn scale(world: &ReferenceWorld, columns: TransferColumns) -> f32 {
    if columns != TransferColumns::Light {
        return 1.0;
    }
    let sun = world.sun.map_or([0.0; 3], |s| s.irradiance);
    let sky = (0..DIRECTIONS).flat_map(|k| sky(world, k)).map(|l| PI * l);
    let most = sky.chain(sun).fold(0.0, f64::max) as f32;
    if most.is_normal() { most } else { 1.0 }
}

/// The hash of sun and sky, and of the sun's way through leaves. A sky is identified by its radiance in [`DIRECTIONS`]
/// directions.
pub fn light_hash(world: &ReferenceWorld) -> String {
    let bytes: Vec<u8> = (0..DIRECTIONS).flat_map(|k| sky(world, k)).flat_map(f64::to_le_bytes).collect();
    let mut through = Vec::new();
    let entering = world.through.iter().flat_map(|t| &t.entering).enumerate();
    for (k, sunlit) in entering.filter_map(|(k, s)| Some((k, s.as_ref()?))) {
        through.extend((k as u64).to_le_bytes());
        let maps: Vec<&Vec<f32>> = match sunlit {
            SunlitMaps::Factor(map) => vec![map.as_ref()],
            SunlitMaps::Colour(maps) => maps.iter().collect(),
        };
        through.extend(maps.into_iter().flatten().flat_map(|v| v.to_le_bytes()));
    }
    hash::combine([
        ("sky", hash::bytes(&bytes).as_str()),
        ("sun", format!("{:?}", world.sun).as_str()),
        ("through", hash::bytes(&through).as_str()),
    ])
}

fn leaf(leaf: &ReferenceLeaf) -> String {
    let mesh = &leaf.mesh;
    let mut bytes = Vec::new();
    let mut put = |values: &mut dyn Iterator<Item = f64>| bytes.extend(values.flat_map(f64::to_le_bytes));
    put(&mut mesh.positions.iter().chain(&mesh.normals).flat_map(|v| v.to_array()));
    put(&mut mesh.tangents.iter().flat_map(|(t, w)| t.extend(*w).to_array()));
    put(&mut mesh.uvs.iter().flat_map(|v| v.to_array()));
    put(&mut mesh.indices.iter().map(|i| f64::from(*i)));
    put(&mut leaf.mask.iter().flatten().map(|m| f64::from(*m)));
    for s in [&leaf.front, &leaf.back] {
        side(s, &mut put);
    }
    let lengths = [mesh.positions.len(), mesh.tangents.len(), mesh.indices.len()];
    let kind = |s: &ReferenceSide| {
        (matches!(s.interior, ReferenceInterior::Maps { .. }), s.gloss.is_some(), s.normal.is_some())
    };
    let sides = [kind(&leaf.front), kind(&leaf.back)];
    let told = format!("{} {} {:?} {} {lengths:?} {sides:?}", leaf.width, leaf.height, leaf.lobe, mesh.discs);
    hash::combine([("maps", hash::bytes(&bytes).as_str()), ("told", told.as_str())])
}

fn side(side: &ReferenceSide, put: &mut dyn FnMut(&mut dyn Iterator<Item = f64>)) {
    let mut maps = |maps: &[Vec<f32>]| put(&mut maps.iter().flatten().map(|v| f64::from(*v)));
    match &side.interior {
        ReferenceInterior::Maps { rho_d, rho_t } => {
            maps(rho_d);
            maps(rho_t);
        }
        ReferenceInterior::Scalars { gamma, thickness, curve } => {
            maps(gamma);
            maps(std::slice::from_ref(thickness));
            // The curve is a function, so the hash takes its values over the range of thicknesses that occur.
            let (low, high) =
                thickness.iter().fold((f32::INFINITY, 0f32), |(low, high), h| (low.min(*h), high.max(*h)));
            let at = |k: i32| {
                let (rho_d, rho_t) = curve(f64::from(low) + f64::from(high - low) * f64::from(k) / 8.0);
                rho_d.into_iter().chain(rho_t)
            };
            put(&mut (0..=8).flat_map(at));
        }
    }
    if let Some(gloss) = &side.gloss {
        put(&mut gloss.rho_s.iter().flatten().chain(&gloss.m).map(|v| f64::from(*v)));
    }
    if let Some(normal) = &side.normal {
        put(&mut std::iter::once(f64::from(normal.frame as u8)));
        put(&mut normal.values.iter().flatten().map(|v| f64::from(*v)));
    }
}
