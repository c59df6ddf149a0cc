//! Visibility in stiff and extreme scenes, each with the verdict that it must get.

use super::cluster::cluster;
use crate::stress::StressRow;
use crate::transport::{square, stack};
use glam::{DMat4, DQuat, DVec3};
use mesophyll_transport::visibility::{
    AreaLight, CodedMaps, MapCollector, ShadowDirections, ShadowReceivers, ShadowScene,
};
use mesophyll_transport::{ReferencePlacement, ReferenceWorld};
use std::time::Instant;

/// The sun's angular radius (rad).
const SUN: f64 = 0.00465;

/// The table.
pub fn rows() -> Vec<StressRow> {
    let alone = || stack(&[(0.0, 0.3, 0.4)]);
    let two = |gap: f64| stack(&[(0.0, 0.3, 0.4), (gap, 0.3, 0.4)]);
    let up = DVec3::Z;
    vec![
        whole("a sun on the horizon", alone(), DVec3::X, &[255]),
        whole("a sun below the horizon", alone(), DVec3::new(0.3, 0.2, -0.5), &[255]),
        whole("a sun below, under two leaves", two(100.0), -up, &[255, 0]),
        whole("leaves 1 µm apart, from above", two(1e-3), up, &[0, 255]),
        whole("leaves 1 µm apart, from below", two(1e-3), -up, &[255, 0]),
        whole("leaves side by side that share an edge", side_by_side(), DVec3::new(0.5, 0.1, 0.7), &[255, 255]),
        whole("zero-area triangles among others", with_slivers(), up, &[0, 255]),
        whole("a leaf of zero-area triangles alone", slivers_alone(), DVec3::new(0.1, 0.2, 0.9), &[255]),
        whole("a million triangles over a leaf", million(), DVec3::new(0.02, 0.01, 1.0), &[0, 255]),
        whole("40 m under a roof 10 mm above", roof(), DVec3::new(0.2, 0.1, 0.9), &[0, 255]),
        whole("no leaves", ReferenceWorld::default(), up, &[]),
        like("a cluster 1 km from the origin", |world| {
            let away = DMat4::from_translation(DVec3::new(1e6, -5e5, 2e5));
            world.instances.iter_mut().for_each(|p| p.transform = away * p.transform);
        }),
        like("a cluster mirrored back and forth", |world| {
            let mirror = DMat4::from_scale(DVec3::new(1.0, -1.0, 1.0));
            for placed in &mut world.instances {
                placed.transform *= mirror;
            }
            world.leaves[0].mesh.positions.iter_mut().for_each(|p| p.y = -p.y);
        }),
        like("normals against the winding", |world| {
            world.leaves[0].mesh.normals.iter_mut().for_each(|n| *n = -*n);
        }),
        without_extent(),
        refused("a light that covers a third of the sky", "light: a point", || AreaLight::disk(1.0, 64).map(drop)),
        refused("a light without points", "light: 0 points", || AreaLight::disk(SUN, 0).map(drop)),
        refused("directions that are none", "visibility: expected directions", || {
            ShadowDirections::one(DVec3::ZERO).map(drop)
        }),
        refused("discs", "visibility: leaf 0: it is made of discs", || {
            let mut world = alone();
            world.leaves[0].mesh.discs = true;
            ShadowReceivers::new(&world, &[]).map(drop)
        }),
        refused("edges that need more vertices than there may be", "visibility: leaf 0: edges of 0.0001 mm", || {
            ShadowReceivers::new(&alone(), &[1e-4]).map(drop)
        }),
        damaged(),
    ]
}

fn row(case: &str, expected: &str, verdict: String, since: Instant) -> StressRow {
    StressRow {
        model: "visibility".into(),
        case: case.into(),
        expected: expected.into(),
        verdict,
        digits: None,
        condition: None,
        ms: since.elapsed().as_secs_f64() * 1e3,
    }
}

/// The receivers of a world as it is drawn, and the sun's map.
fn map(world: &ReferenceWorld, radius: f64, direction: DVec3) -> crate::Result<(ShadowReceivers, Vec<u8>)> {
    let (receivers, light) = (ShadowReceivers::new(world, &[])?, AreaLight::disk(radius, 64)?);
    let mut out = Vec::new();
    ShadowScene::new(world, &receivers, &light)?.maps(&[direction], |_, map| {
        out = map.to_vec();
        Ok(())
    })?;
    Ok((receivers, out))
}

/// All of an instance must be as bright as `want` says. The rim of a shadow, a tenth of the leaf wide, is left out.
fn whole(case: &str, world: ReferenceWorld, direction: DVec3, want: &[u8]) -> StressRow {
    let clock = Instant::now();
    let verdict = match map(&world, SUN, direction) {
        Err(why) => format!("refused: {why}"),
        Ok((receivers, map)) => {
            let inside = |k: usize| {
                let (receiver, blade) = (receivers.get(k), &receivers.blade(receivers.get(k).instance).mesh);
                (blade.uvs[receiver.vertex] - 0.5).abs().max_element() < 0.4
            };
            let wrong = (0..want.len()).find_map(|instance| {
                let found = receivers.of(instance).filter(|k| inside(*k)).find(|k| map[*k] != want[instance]);
                found
                    .map(|k| format!("wrong: {} at {}, expected {}", map[k], receivers.get(k).position, want[instance]))
            });
            wrong.unwrap_or_else(|| "ok".into())
        }
    };
    row(case, "ok", verdict, clock)
}

/// A change of the cluster that does not change what is seen, except at a few points that an edge just meets.
fn like(case: &str, change: impl FnOnce(&mut ReferenceWorld)) -> StressRow {
    let clock = Instant::now();
    let direction = DVec3::new(0.3, 0.5, 0.6);
    let (mut there, here) = (cluster(), cluster());
    change(&mut there);
    let verdict = match (map(&here, SUN, direction), map(&there, SUN, direction)) {
        (Ok((_, a)), Ok((_, b))) => {
            let differ = a.iter().zip(&b).filter(|(x, y)| x != y).count();
            if differ * 500 <= a.len() { "ok".into() } else { format!("wrong: {differ} of {} differ", a.len()) }
        }
        (Err(why), _) | (_, Err(why)) => format!("refused: {why}"),
    };
    row(case, "ok", verdict, clock)
}

/// A light that is a point is either seen or not. Away from penumbras the result is that of the disk.
fn without_extent() -> StressRow {
    let clock = Instant::now();
    let direction = DVec3::new(0.3, 0.5, 0.6);
    let verdict = match (map(&cluster(), 0.0, direction), map(&cluster(), SUN, direction)) {
        (Ok((_, point)), Ok((_, disk))) => {
            let wrong = |(p, d): &(&u8, &u8)| ![0, 255].contains(*p) || ([0, 255].contains(*d) && p != d);
            match point.iter().zip(&disk).filter(wrong).count() {
                0 => "ok".into(),
                wrong => format!("wrong: {wrong} of {}", point.len()),
            }
        }
        (Err(why), _) | (_, Err(why)) => format!("refused: {why}"),
    };
    row("a sun without extent", "ok", verdict, clock)
}

fn refused(case: &str, with: &str, work: impl FnOnce() -> crate::Result<()>) -> StressRow {
    let clock = Instant::now();
    let verdict = work().map_or_else(|why| format!("refused: {why}"), |()| "ok".into());
    row(case, &format!("refused: {with}"), verdict, clock)
}

/// A file of maps with one bit changed.
fn damaged() -> StressRow {
    let clock = Instant::now();
    let work = || -> crate::Result<()> {
        let (receivers, map) = map(&cluster(), SUN, DVec3::Z)?;
        let mut collector = MapCollector::new(receivers.len());
        collector.push(&map)?;
        let folder = tempfile::tempdir().map_err(|e| crate::Error::Usage(e.to_string()))?;
        let path = folder.path().join("maps");
        collector.finish(ShadowDirections::one(DVec3::Z)?)?.write(&path)?;
        let mut bytes = std::fs::read(&path).unwrap_or_default();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        mesophyll_files::atomic::write_bytes(&path, &bytes)?;
        let read = CodedMaps::read(&path);
        // The folder's name is left out, because it differs in every run.
        read.map(drop).map_err(|e| {
            let said = e.to_string();
            crate::Error::Usage(said.rsplit_once("maps: ").map_or(said.clone(), |(_, why)| why.into()))
        })
    };
    let verdict = work().map_or_else(|why| format!("refused: {why}"), |()| "ok".into());
    row("a file of maps with a bit changed", "refused: it is not what was written", verdict, clock)
}

fn side_by_side() -> ReferenceWorld {
    let mut world = stack(&[(0.0, 0.3, 0.4)]);
    world.instances.push(ReferencePlacement { leaf: 0, transform: DMat4::from_translation(DVec3::X * 2000.0) });
    world
}

/// A leaf under another, both with triangles that have no area.
fn with_slivers() -> ReferenceWorld {
    let mut world = stack(&[(0.0, 0.3, 0.4), (50.0, 0.3, 0.4)]);
    for leaf in &mut world.leaves {
        leaf.mesh = square(6);
        leaf.mesh.indices.extend([0, 0, 1, 2, 2, 2, 0, 3, 0, 0, 1, 2, 24, 24, 31]);
    }
    world
}

fn slivers_alone() -> ReferenceWorld {
    let mut world = stack(&[(0.0, 0.3, 0.4)]);
    world.leaves[0].mesh.indices = vec![0, 0, 1, 2, 2, 2, 0, 3, 0];
    world
}

fn million() -> ReferenceWorld {
    let mut world = stack(&[(0.0, 0.3, 0.4), (100.0, 0.3, 0.4)]);
    world.leaves[0].mesh = square(9);
    world.leaves[1].mesh = square(708);
    world.instances[1].transform *= DMat4::from_quat(DQuat::from_rotation_x(1e-3));
    world
}

/// Ground of 40 m under a roof 10 mm above it.
fn roof() -> ReferenceWorld {
    let mut world = stack(&[(0.0, 0.3, 0.4), (10.0, 0.3, 0.4)]);
    for (leaf, placed) in world.leaves.iter_mut().zip(&mut world.instances) {
        leaf.mesh = square(40);
        placed.transform *= DMat4::from_scale(DVec3::splat(20.0));
    }
    world
}
