//! Lawns on their way to both renderers: blades to the path tracer, slices to the one in real time.

use super::reference::{black, mesh};
use crate::placed::grass::Grass;
use mesophyll_files::mesh::LeafMesh;
use mesophyll_fit_grass::optics::Optics;
use mesophyll_transport::{self as transport, lobe};
#[cfg(feature = "render")]
pub use slices::lawn;
use std::collections::BTreeSet;

/// Adds a lawn's blades to the path tracer's world: a leaf a material, in every rectangle.
pub fn blades(grass: &Grass, world: &mut transport::World) {
    let materials: BTreeSet<&str> = grass.plant.blades.iter().map(|b| b.material.as_str()).collect();
    for material in materials {
        let shape = grass.plant.blades_of(material);
        let Some(optics) = grass.leaves.get(material).filter(|_| !shape.indices.is_empty()) else { continue };
        let leaf = world.leaves.len();
        world.leaves.push(blade(&shape, optics));
        world.instances.extend(grass.places().map(|transform| transport::Placement { leaf, transform }));
    }
}

/// A matte sheet that is the same everywhere.
fn blade(shape: &LeafMesh, optics: &Optics) -> transport::ReferenceLeaf {
    let maps = |c: [f64; 3]| c.map(|v| vec![v as f32]);
    let [front, back] = optics.rho_d.map(|rho_d| {
        let interior = transport::Interior::Maps { rho_d: maps(rho_d), rho_t: maps(optics.rho_t) };
        transport::ReferenceSide { interior, ..black(1) }
    });
    transport::ReferenceLeaf {
        mesh: mesh(shape),
        width: 1,
        height: 1,
        front,
        back,
        mask: None,
        lobe: lobe::Lobe::Beckmann,
    }
}

#[cfg(feature = "render")]
mod slices {
    use crate::placed::grass::Grass;
    use glam::{Vec2, Vec3};
    use mesophyll_fit_grass::march::Slices;
    use mesophyll_fit_grass::sheet::{self, Sheet};
    use mesophyll_fit_grass::through;
    use mesophyll_viewer::scene as viewer;

    /// A lawn as the renderer takes it, over ground of this reflectance.
    pub fn lawn(grass: &Grass, slices: &Slices, soil: [f64; 3], steps: usize) -> viewer::Grass {
        let table = |values: [f64; viewer::GRASS_STEPS + 1]| values.map(|v| v as f32);
        let half = Vec2::new(slices.period[0] as f32, slices.period[1] as f32) * 0.5;
        let rest = Vec2::new(grass.tiles[0] as f32 - 0.5, grass.tiles[1] as f32 - 0.5) * 2.0 * half;
        let light = through::through(slices);
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
            scatter: through::scattered(slices).map(|v| v as f32),
            through: light.map(table),
            open: table(through::open(slices, &light)),
            soil_open: through::open_ground(slices) as f32,
        }
    }

    fn one_sheet(from: &Sheet) -> viewer::GrassSheet {
        let level = |l: &sheet::Level| {
            let plane = |of: [Option<usize>; 4]| {
                let one = |t: &sheet::Texel| of.map(|c| c.map_or(0.0, |c| t[c]));
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
}
