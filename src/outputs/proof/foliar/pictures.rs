//! What the foliar scattering model (FSM) costs and gains compared with the layered leaf (ABM) that it approximates, in
//! pictures: Table 3, Fig. 7 and Fig. 8 of Baranoski & Rokne (2001), and the error of exchanging source and viewer.
//!
//! The scenes are soybean leaves under sun and sky: one leaf lit from above, the same lit from below, and nine leaves
//! that shade and light each other. All pictures are small. The sun is a wide disk, because rays of the ABM find it
//! only by chance.

use super::figures::SOYBEAN;
use crate::Result;
use crate::bench::BenchRow;
use glam::{DMat4, DQuat, DVec2, DVec3, EulerRot};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_optics::foliar::goniometer::{RINGS, SECTORS, projected};
use mesophyll_optics::foliar::{LayeredLeaf, exact, fsm, walk};
use mesophyll_optics::side::Side;
use mesophyll_transport::foliar::{FoliarMaterial, FoliarModel};
use mesophyll_transport::path::{PathPicture, PathRequest, PathSettings, PathTracer, SamplingTarget};
use mesophyll_transport::{ReferenceCamera, ReferenceLeaf, ReferencePlacement, ReferenceSun, ReferenceWorld, tone};
use std::f64::consts::PI;
use std::sync::Arc;
use std::time::Instant;

const SIZE: [usize; 2] = [32, 24];
/// Paths for each pixel of the two reference pictures, whose mean the others are compared with, and paths for each
/// pixel of the others.
const REFERENCE: u32 = 4096;
const PATHS: u32 = 1024;
const EXPOSURE: f64 = 2.0;

/// A sheet of 50 by 30 mm that is bent to an arc, front up.
fn sheet() -> LeafMesh {
    const CELLS: usize = 12;
    let (mut positions, mut normals, mut uvs, mut indices) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for j in 0..=CELLS {
        for i in 0..=CELLS {
            let uv = DVec2::new(i as f64, j as f64) / CELLS as f64;
            let angle = 0.9 * (uv.y - 0.5);
            positions.push(DVec3::new(50.0 * (uv.x - 0.5), 34.0 * angle.sin(), 34.0 * (angle.cos() - 1.0)));
            normals.push(DVec3::new(0.0, angle.sin(), angle.cos()));
            uvs.push(uv);
        }
    }
    for j in 0..CELLS {
        for i in 0..CELLS {
            let at = |i: usize, j: usize| (j * (CELLS + 1) + i) as u32;
            indices.extend([at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    LeafMesh { positions, normals, uvs, indices, ..LeafMesh::default() }
}

/// The three sets: name, world and camera.
fn sets() -> [(&'static str, ReferenceWorld, ReferenceCamera); 3] {
    let leaf = || ReferenceLeaf::opaque(sheet(), [0.0; 3]);
    let world = |from: DVec3, places: Vec<DMat4>| ReferenceWorld {
        leaves: vec![leaf()],
        instances: places.into_iter().map(|transform| ReferencePlacement { leaf: 0, transform }).collect(),
        sun: Some(ReferenceSun { direction: from.normalize(), irradiance: [2.0, 1.9, 1.7], radius: 0.6 }),
        sky: Some([0.15, 0.18, 0.24]),
        exposure: EXPOSURE,
        ..ReferenceWorld::default()
    };
    let camera = |eye: DVec3, fov_y_deg: f64| ReferenceCamera { eye, target: DVec3::ZERO, up: DVec3::Z, fov_y_deg };
    let turned = |x: f64, y: f64, z: f64, at: DVec3| {
        DMat4::from_rotation_translation(DQuat::from_euler(EulerRot::XYZ, x, y, z), at)
    };
    let above = camera(DVec3::new(0.0, -60.0, 90.0), 30.0);
    let crowd = (0..9).map(|k| {
        let f = f64::from(k);
        let place = DVec3::new(18.0 * (f % 3.0 - 1.0), 16.0 * ((f / 3.0).floor() - 1.0), 9.0 * (2.4 * f).sin());
        turned(0.5 * (1.7 * f).sin(), 0.6 * (2.9 * f).cos(), f, place)
    });
    [
        ("lit from above", world(DVec3::new(0.5, 0.3, 0.9), vec![DMat4::IDENTITY]), above),
        ("lit from below", world(DVec3::new(0.5, 0.3, -0.9), vec![DMat4::IDENTITY]), above),
        ("nine leaves", world(DVec3::new(0.5, 0.3, 0.9), crowd.collect()), camera(DVec3::new(0.0, -90.0, 110.0), 38.0)),
    ]
}

/// A picture as it is shown, with the time of a path (µs) and the median relative error of its pixels.
fn draw(
    world: &ReferenceWorld,
    camera: ReferenceCamera,
    foliar: &FoliarMaterial,
    paths: u32,
    seed: u64,
) -> Result<(Vec<f64>, f64, f64)> {
    let world = ReferenceWorld { foliar: vec![Some(Arc::new(foliar.clone()))], ..world.clone() };
    let tracer = PathTracer::new(&world, PathSettings::default())?;
    let mut picture = PathPicture::new(SIZE[0], SIZE[1]);
    let request =
        PathRequest { camera, size: SIZE, seed, target: SamplingTarget { samples: Some(paths), error: None } };
    let clock = Instant::now();
    picture.draw(&tracer, &request, "picture", &mut |_| Ok(()))?;
    let us = clock.elapsed().as_secs_f64() * 1e6 / picture.total_paths() as f64;
    let shown = picture.mean.iter().flatten().map(|v| tone::display(f64::from(*v), EXPOSURE)).collect();
    Ok((shown, us, picture.median_error().unwrap_or(f64::NAN)))
}

/// Square root of the mean square of differences (Eq. 6).
fn rms(a: &[f64], b: &[f64]) -> f64 {
    (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len().max(1) as f64).sqrt()
}

fn row(knob: &str, setting: impl Into<String>, error: f64, us: f64, note: String) -> BenchRow {
    BenchRow { model: "fsm".into(), knob: knob.into(), setting: setting.into(), error, us, note }
}

/// The rows.
///
/// # Errors
/// A world that cannot be traced (these can), and a stop.
pub fn rows() -> Result<Vec<BenchRow>> {
    let soybean = SOYBEAN.map(|(_, depth)| LayeredLeaf::soybean(depth));
    let Some(model) = FoliarMaterial::new(FoliarModel::Fsm, soybean) else { return Ok(Vec::new()) };
    let (layers, paper) = (model.by(FoliarModel::Abm), model.of_paper());
    let mut rows = Vec::new();
    for (name, world, camera) in sets() {
        let (one, us, noise) = draw(&world, camera, &layers, REFERENCE, 1)?;
        let (two, ..) = draw(&world, camera, &layers, REFERENCE, 2)?;
        let truth: Vec<f64> = one.iter().zip(&two).map(|(a, b)| 0.5 * (a + b)).collect();
        let note = format!("noise that is left in the picture that FSM is held against, of {} paths", 2 * REFERENCE);
        rows.push(row("ABM as the leaf", name, 0.5 * rms(&one, &two), us, note));
        for (what, foliar) in [("FSM as the leaf", &model), ("FSM of the paper as the leaf", &paper)] {
            let (shown, its_us, its_noise) = draw(&world, camera, foliar, PATHS, 3)?;
            // Errors fall with the square root of the number of paths, so the same error takes the square of the ratio
            // as many paths.
            let equal = (us * noise.powi(2) * f64::from(REFERENCE)) / (its_us * its_noise.powi(2) * f64::from(PATHS));
            let note = format!(
                "RMS (Eq. 6) of displayed values from the ABM's picture; {:.1} times as fast a path, {equal:.1} times \
                 to the same noise",
                us / its_us
            );
            rows.push(row(what, name, rms(&shown, &truth), its_us, note));
        }
        for paths in [4, 16, 64, 256] {
            let (shown, its_us, _) = draw(&world, camera, &model, paths, 3)?;
            let setting = format!("{name}, {paths} paths a pixel");
            rows.push(row("convergence of FSM", setting, rms(&shown, &truth), its_us, "as above".into()));
        }
        let traced = ReferenceWorld { foliar: vec![Some(Arc::new(model.clone()))], ..world };
        let tracer = PathTracer::new(&traced, PathSettings::default())?;
        let aim = (camera.target - camera.eye).normalize();
        let times = 2000;
        for cut in [0.1, fsm::CUT, 0.001] {
            let clock = Instant::now();
            let (radiance, rays) = tracer.branched(camera.eye, aim, cut, times, 5);
            let us = clock.elapsed().as_secs_f64() * 1e6 / f64::from(times);
            let all = tracer.look(camera.eye, aim, 40_000, 7);
            let lost = 1.0 - radiance[1] / all.radiance[1].mean;
            let depths: Vec<String> = rays.iter().map(|n| format!("{n:.2}")).collect();
            let note = format!(
                "three rays a hit; green light that is lost, of the middle pixel; rays by depth: {}",
                depths.join(", ")
            );
            rows.push(row("threshold", format!("{name}, {cut}"), lost.abs(), us, note));
        }
    }
    rows.extend(exchanged(&soybean[1]));
    rows.extend(variations(&model, &soybean[1]));
    Ok(rows)
}

/// The error of taking the viewer for the source. The radiance of a leaf under diffuse light on one side is compared
/// with the share of light from the viewer that the leaf would reflect or let through. The two are equal for a
/// reciprocal leaf.
fn exchanged(leaf: &LayeredLeaf) -> Vec<BenchRow> {
    const NODES: usize = 24;
    const RAYS: u64 = 400_000;
    let nodes = mesophyll_base::quadrature::unit(NODES);
    [Side::Front, Side::Back]
        .into_iter()
        .map(|side| {
            let clock = Instant::now();
            // The light that leaves, ring by ring, under light that arrives evenly (sin²θ is uniform).
            let mut rings = [0.0; RINGS];
            for (k, &(x, w)) in nodes.iter().enumerate() {
                let seen = walk::directions(leaf, side, x.sqrt().asin(), RAYS, k as u64, &|| false);
                for (ring, sum) in rings.iter_mut().enumerate() {
                    *sum += w * (0..SECTORS).map(|s| seen.reading(ring, s).fraction.0).sum::<f64>();
                }
            }
            // The same radiance by FSM's exchange. Beyond the middle ring the viewer is on the other side.
            let other = if side == Side::Front { Side::Back } else { Side::Front };
            let (mut square, mut weight, mut worst) = (0.0, 0.0, 0.0f64);
            for (ring, share) in rings.iter().enumerate() {
                let area = projected(ring) * SECTORS as f64 / PI;
                let zenith = PI * (ring as f64 + 0.5) / RINGS as f64;
                let (radiance, model) = if ring < RINGS / 2 {
                    (share / area, exact::response(leaf, side, zenith).map(|r| r.reflectance))
                } else {
                    (share / area, exact::response(leaf, other, PI - zenith).map(|r| r.transmittance))
                };
                let off = model.unwrap_or(f64::NAN) / radiance - 1.0;
                square += area * off * off;
                weight += area;
                worst = if off.abs() > worst.abs() { off } else { worst };
            }
            let name = if side == Side::Front { "diffuse light from above" } else { "diffuse light from below" };
            let note = format!(
                "relative RMS over directions of view of what the ABM shows, had source and viewer been exchanged; \
                 worst of the rings {:+.0} %",
                100.0 * worst
            );
            row(
                "source and viewer exchanged",
                name,
                (square / weight).sqrt(),
                clock.elapsed().as_secs_f64() * 1e6,
                note,
            )
        })
        .collect()
}

/// Total variation between the ABM's and the FSM's light on the goniometer's patches: half the sum of the differences,
/// divided by the light that leaves.
fn variations(model: &FoliarMaterial, leaf: &LayeredLeaf) -> Vec<BenchRow> {
    let mut rows = Vec::new();
    for side in [Side::Front, Side::Back] {
        for degrees in [15.0, 30.0, 45.0, 60.0, 75.0] {
            let at = f64::to_radians(degrees);
            let seen = walk::directions(leaf, side, at, 4_000_000, 1, &|| false);
            let total = (seen.counts.reflected + seen.counts.transmitted) as f64 / seen.counts.rays as f64;
            let off = |foliar: &FoliarMaterial| -> f64 {
                let shares = foliar.patches(side, at, 1);
                let differences = shares
                    .iter()
                    .enumerate()
                    .map(|(k, share)| (seen.reading(k / SECTORS, k % SECTORS).fraction.0 - share).abs());
                0.5 * differences.sum::<f64>() / total
            };
            let word: &str = side.into();
            let note = format!("FSM of the paper {:.1} %", 100.0 * off(&model.of_paper()));
            rows.push(row("total variation from ABM", format!("{word}, {degrees}°"), off(model), f64::NAN, note));
        }
    }
    rows
}
