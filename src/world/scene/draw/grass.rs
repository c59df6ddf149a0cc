//! Hands lawns to both renderers: blades to the path tracer, and slices to the real-time renderer.

use crate::manifest::SceneManifest;
use crate::placed::grass::PlacedLawn;
use crate::{Error, Result};
use glam::DMat4;
use mesophyll_files::mesh::LeafMesh;
use mesophyll_fits::grass::optics::Optics;
use mesophyll_plants::form::Leaf;
use mesophyll_transport::{self as transport, lobe};
use rayon::prelude::*;
#[cfg(feature = "render")]
pub use slices::{lawn, seen_from_above};
use std::collections::BTreeSet;
use std::sync::Arc;

/// The largest number of triangles in all rectangles of a lawn in the wind or on a hill, where each rectangle has its
/// own blades.
const MOST_TRIANGLES: usize = 40_000_000;

/// Adds a lawn's blades to the path tracer's world, with one leaf for each material and part, in every rectangle. In
/// the wind, where [`lean`] moves them, and on a hill, every rectangle has its own leaves.
///
/// # Errors
/// [`Error::Input`] for such a lawn with too many triangles.
pub fn blades(manifest: &SceneManifest, grass: &PlacedLawn, world: &mut transport::ReferenceWorld) -> Result<()> {
    let places = grass.tiles[0] * grass.tiles[1];
    if grass.is_own() {
        let triangles: usize = materials(grass).map(|(name, _)| grass.plant.blades_of(name).triangles()).sum();
        if triangles.saturating_mul(places) > MOST_TRIANGLES {
            let told = format!(
                "found {:?} rectangles of {triangles} triangles in the wind or on a hill, which move each blade by \
                 itself for the path tracer; expected at most {MOST_TRIANGLES} triangles in all",
                grass.tiles
            );
            return Err(Error::field(&manifest.path, &format!("grass \"{}\": tiles", grass.name), told));
        }
    }
    for (name, optics) in materials(grass) {
        if grass.is_own() {
            for (transform, shape) in grass.places().zip(own(grass, name)) {
                world.instances.push(transport::ReferencePlacement { leaf: world.leaves.len(), transform });
                world.leaves.push(blade(&shape, optics));
            }
            continue;
        }
        for (part, shape) in parts(grass, name) {
            let leaf = world.leaves.len();
            world.leaves.push(blade(&shape, optics));
            let moved = |k| DMat4::from_translation(grass.moved(part, k));
            let at = |(k, place)| transport::ReferencePlacement { leaf, transform: place * moved(k) };
            world.instances.extend(grass.places().enumerate().map(at));
        }
    }
    Ok(())
}

/// Leans the blades of all lawns for a time (s). `first` is the index in the world of the first lawn's first leaf.
pub fn lean(lawns: &[PlacedLawn], world: &mut transport::ReferenceWorld, first: usize, time: f64) {
    let mut next = first;
    for grass in lawns {
        for (name, _) in materials(grass) {
            let Some(leaning) = &grass.leaning else {
                next += parts(grass, name).count();
                continue;
            };
            let leaves = &mut world.leaves[next..next + grass.tiles[0] * grass.tiles[1]];
            next += leaves.len();
            let places: Vec<(DMat4, Arc<LeafMesh>)> = grass.places().zip(own(grass, name)).collect();
            leaves.par_iter_mut().zip(places).for_each(|(leaf, (place, shape))| {
                let at = place.w_axis.truncate().with_z(0.0);
                for (v, (point, normal)) in shape.positions.iter().zip(&shape.normals).enumerate() {
                    let (to, turned) = leaning.bent(*point + at, *normal, time);
                    (leaf.mesh.positions[v], leaf.mesh.normals[v]) = (to - at, turned);
                }
            });
        }
    }
}

/// The materials of the blades, with their optics.
fn materials(grass: &PlacedLawn) -> impl Iterator<Item = (&str, &Optics)> {
    let named = |leaf: &Leaf| grass.plant.blades.get(leaf.blade).map(|blade| blade.material.as_str());
    let materials: BTreeSet<&str> = grass.plant.leaves.iter().filter_map(named).collect();
    materials.into_iter().filter_map(|material| Some((material, grass.leaves.get(material)?)))
}

/// The blades of a material in each part of the rectangle that has some.
fn parts<'a>(grass: &'a PlacedLawn, material: &'a str) -> impl Iterator<Item = (Option<[usize; 2]>, LeafMesh)> + 'a {
    let shape = |part| grass.plant.blades_at(material, |leaf| grass.in_part(leaf, part));
    grass.parts().into_iter().map(move |part| (part, shape(part))).filter(|(_, shape)| !shape.indices.is_empty())
}

/// The blades of a material in each rectangle. In an irregular lawn and on a hill, every rectangle has others.
fn own<'a>(grass: &'a PlacedLawn, material: &'a str) -> impl Iterator<Item = Arc<LeafMesh>> + 'a {
    let shape = |k| Arc::new(grass.plant.blades_at(material, |leaf| Some(grass.place_in(leaf, k))));
    let alike = (grass.irregular.is_none() && grass.hill.is_none()).then(|| shape(0));
    (0..grass.tiles[0] * grass.tiles[1]).map(move |k| alike.clone().unwrap_or_else(|| shape(k)))
}

/// A matte sheet that is the same everywhere.
fn blade(shape: &LeafMesh, optics: &Optics) -> transport::ReferenceLeaf {
    let sides = optics.rho_d.map(|rho_d| transport::ReferenceSide::even(rho_d, optics.rho_t, None));
    transport::ReferenceLeaf::even(shape.clone(), sides, lobe::Lobe::Beckmann)
}

#[cfg(feature = "render")]
mod slices {
    use crate::manifest::SceneManifest;
    use crate::placed::daylight::sun_direction;
    use crate::placed::grass::PlacedLawn;
    use crate::placed::lawn_lean::LawnLean;
    use glam::{DVec2, DVec3, Vec2, Vec3};
    use mesophyll_fits::grass::march::LawnSlices;
    use mesophyll_fits::grass::sheet::{self, SliceAtlas};
    use mesophyll_fits::grass::transmittance;
    use mesophyll_transport::ReferenceCamera;
    use mesophyll_viewer::scene as viewer;
    use std::f64::consts::FRAC_PI_2;
    use std::sync::Arc;

    /// A lawn in the renderer's form, over ground of this reflectance.
    pub fn lawn(grass: &PlacedLawn, slices: &LawnSlices, soil: [f64; 3], steps: usize) -> viewer::Grass {
        let table = |values: [f64; viewer::GRASS_STEPS + 1]| values.map(|v| v as f32);
        let half = Vec2::new(slices.period[0] as f32, slices.period[1] as f32) * 0.5;
        let rest = Vec2::new(grass.tiles[0] as f32 - 0.5, grass.tiles[1] as f32 - 0.5) * 2.0 * half;
        let light = transmittance::through(slices);
        viewer::Grass {
            name: grass.name.clone(),
            origin: Vec3::new(grass.origin.x as f32, grass.origin.y as f32, grass.origin.z as f32),
            low: -half,
            high: rest,
            height: slices.height as f32,
            period: slices.period.map(|v| v as f32),
            count: slices.count as u32,
            steps: steps as u32,
            projection: table(slices.projection),
            shown: slices.shown.map(|v| v as f32),
            cover: table(slices.cover.0),
            level_cover: slices.cover.1 as f32,
            upright: one_sheet(&slices.upright),
            level: slices.level.as_ref().map(one_sheet),
            soil: soil.map(|v| v as f32),
            scatter: transmittance::scattered(slices).map(|v| v as f32),
            through: light.map(table),
            open: table(transmittance::open(slices, &light)),
            soil_open: transmittance::open_ground(slices) as f32,
            gusts: grass.leaning.as_ref().map(|leaning| Arc::new(gusts(leaning))),
            irregular: slices.irregular,
            hill: grass.hill.map(|hill| viewer::GrassHill {
                middle: hill.middle.as_vec2(),
                height: hill.height as f32,
                radius: hill.radius as f32,
            }),
            billboards: false,
        }
    }

    /// Numbers of steps of |Ω_z|, and of azimuths in a quarter, at which it is tested whether rays use the level slice.
    const STEEP: usize = 64;
    const TURNS: usize = 16;

    /// A share of a ray's optical depth. Without this share, the coverage has an error of this times τ e^−τ, which is
    /// at most 0.018. That is less than the error of slices in the worst direction.
    const LITTLE: f64 = 0.05;

    /// Whether the level slice gives more than [`LITTLE`] to any ray of a view or of the sun. Rays are tested up to the
    /// steepest of them. Pictures have the shape that the manifest's check states.
    pub fn seen_from_above(grass: &PlacedLawn, slices: &LawnSlices, manifest: &SceneManifest) -> bool {
        let aspect = f64::from(manifest.check.width) / f64::from(manifest.check.height);
        let views = manifest.perspectives();
        let of_views = views.map(|view| steepest(&view.camera, aspect));
        let of_sun = sun_direction(manifest).map_or(0.0, |d| d.z.abs());
        let mut most = of_views.fold(of_sun, f64::max);
        if let Some(leaning) = &grass.leaning {
            // In a leaning lawn, a ray is steeper by at most this angle.
            let lean = leaning.lean_per_m_s * leaning.gusts.strongest();
            most = (most.min(1.0).asin() + lean.atan()).min(FRAC_PI_2).sin();
        }
        if let Some(hill) = &grass.hill {
            most = (most.min(1.0).asin() + hill.steepest().atan()).min(FRAC_PI_2).sin();
        }
        (0..=STEEP).any(|k| {
            let z = most * k as f64 / STEEP as f64;
            let across = (1.0 - z * z).max(0.0).sqrt();
            (0..TURNS).any(|turn| {
                let (sin, cos) = (FRAC_PI_2 * turn as f64 / TURNS as f64).sin_cos();
                let [upright, level] = slices.weights(DVec3::new(across * cos, across * sin, z));
                let upright = upright * slices.shown[0] * across * (cos + sin);
                let level = level * slices.shown[1] * z;
                level > LITTLE * (upright + level)
            })
        })
    }

    /// The largest |Ω_z| of a camera's rays: 1 where it sees straight down or up, else that at the edge of its picture.
    fn steepest(camera: &ReferenceCamera, aspect: f64) -> f64 {
        let ([forward, right, above], tall) = (camera.axes(), camera.half_height());
        let within = |d: DVec3| {
            let z = d.dot(forward);
            z > 0.0 && (d.dot(right) / z).abs() <= tall * aspect && (d.dot(above) / z).abs() <= tall
        };
        if within(DVec3::Z) || within(DVec3::NEG_Z) {
            return 1.0;
        }
        let edge = |k: usize| {
            let (s, side) = (2.0 * (k / 4) as f64 / STEEP as f64 - 1.0, k % 4);
            let [x, y] = [[s, -1.0], [s, 1.0], [-1.0, s], [1.0, s]][side];
            (forward + right * (x * tall * aspect) + above * (y * tall)).normalize_or_zero().z.abs()
        };
        (0..4 * STEEP + 4).map(edge).fold(0.0, f64::max)
    }

    /// The gusts that lean a lawn, in the renderer's precision.
    fn gusts(LawnLean { gusts, lean_per_m_s }: &LawnLean) -> viewer::GrassGusts {
        let lean = |v: DVec2| (v * *lean_per_m_s).as_vec2().to_array();
        let added = gusts.motion.values.iter().map(|v| lean(gusts.across(v.map(f64::from)))).collect();
        viewer::GrassGusts {
            mean: lean(gusts.way * gusts.wind.speed),
            size: gusts.motion.size as u32,
            added,
            turn: gusts.turn(),
            drift: gusts.drift(),
        }
    }

    fn one_sheet(from: &SliceAtlas) -> viewer::GrassSheet {
        let level = |l: &sheet::AtlasLevel| {
            let plane = |of: [Option<usize>; 4]| {
                let one = |t: &sheet::SliceTexel| of.map(|c| c.map_or(0.0, |c| t[c]));
                l.texels.iter().map(one).collect()
            };
            let planes = [[10, 11, 12, 0], [1, 2, 3, 13], [4, 5, 6, 13]].map(|of| plane(of.map(Some)));
            let [a, b, c] = planes;
            let through = plane([Some(7), Some(8), Some(9), None]);
            viewer::GrassLevel { width: l.width as u32, height: l.height as u32, planes: [a, b, c, through] }
        };
        viewer::GrassSheet {
            cell: from.cell.map(|n| n as u32),
            border: from.border as u32,
            columns: sheet::LINE as u32,
            levels: from.levels.iter().map(level).collect(),
        }
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn the_steepest_ray_of_a_camera() {
            let camera =
                |eye: [f64; 3]| ReferenceCamera { eye: eye.into(), target: DVec3::ZERO, up: DVec3::Z, fov_y_deg: 20.0 };
            // The elevation is 30° in the middle, and 40° at the lower edge.
            let found = steepest(&camera([-3f64.sqrt(), 0.0, 1.0]), 1.5);
            assert!((found - 40f64.to_radians().sin()).abs() < 1e-3, "{found}");
            // At an elevation of 85°, straight down is in the picture.
            assert_eq!(steepest(&camera([-0.087, 0.0, 1.0]), 1.0), 1.0);
            assert!(steepest(&camera([-0.3, 0.0, 1.0]), 1.0) < 1.0);
        }
    }
}
