//! Visibility maps of a cluster: error, time and bytes for different numbers of points of the sun's disk, spacings of
//! the directions, and codes.

use super::cluster::{EDGE_MM, cluster};
use crate::Result;
use crate::bench::{BenchRow, median_us};
use glam::DVec3;
use mesophyll_base::statistics::quantile;
use mesophyll_files::progress::TaskProgress;
use mesophyll_transport::ReferenceWorld;
use mesophyll_transport::visibility::{
    AreaLight, CodedMaps, MapCollector, ShadowDirections, ShadowReceivers, ShadowScene, runs,
};
use std::f64::consts::{PI, TAU};
use std::time::Instant;

/// Steps of the sweep's bar.
pub const PIECES: u64 = 4;
/// The sun's angular radius (rad).
const SUN: f64 = 0.00465;
/// Points of the disk where something else than their number is measured.
const POINTS: usize = 64;
/// Every this many of a cube's directions are coded. The number has no factor in common with 32.
const OF_THE_CUBE: usize = 15;

/// The sweep.
///
/// # Errors
/// [`crate::Error::Interrupted`] after Ctrl-C.
pub fn rows(bar: &TaskProgress) -> Result<Vec<BenchRow>> {
    let world = cluster();
    let receivers = ShadowReceivers::new(&world, &[EDGE_MM])?;
    let mut rows = Vec::new();
    for piece in [points, ways, spacings, codes] {
        rows.extend(piece(&world, &receivers)?);
        bar.step()?;
    }
    Ok(rows)
}

fn row(knob: &str, setting: impl ToString, error: f64, us: f64, note: String) -> BenchRow {
    BenchRow { model: "visibility".into(), knob: knob.into(), setting: setting.to_string(), error, us, note }
}

/// Directions spread over the sphere by the golden angle; none of them is a direction of a cube.
fn spread(count: usize) -> Vec<DVec3> {
    let at = |k: usize| {
        let z = 1.0 - (2.0 * k as f64 + 1.0) / count as f64;
        let (sin, cos) = (k as f64 * PI * (3.0 - 5f64.sqrt()) + 0.3).sin_cos();
        DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
    };
    (0..count).map(at).collect()
}

/// Maps of directions, and the time of one (µs).
fn maps(
    world: &ReferenceWorld,
    receivers: &ShadowReceivers,
    points: usize,
    directions: &[DVec3],
) -> Result<(Vec<Vec<u8>>, f64)> {
    let light = AreaLight::disk(SUN, points)?;
    let shadows = ShadowScene::new(world, receivers, &light)?;
    let mut maps = Vec::new();
    let clock = Instant::now();
    shadows.maps(directions, |_, map| {
        maps.push(map.to_vec());
        Ok(())
    })?;
    Ok((maps, clock.elapsed().as_secs_f64() * 1e6 / directions.len() as f64))
}

/// Root mean square difference of shares over the receivers that `of` selects.
fn rms(a: &[Vec<u8>], b: &[Vec<u8>], of: impl Fn(u8, u8) -> bool) -> f64 {
    let pairs = a.iter().flatten().zip(b.iter().flatten()).filter(|(x, y)| of(**x, **y));
    let (sum, count) = pairs.fold((0.0, 0usize), |(sum, count), (x, y)| {
        (sum + ((f64::from(*x) - f64::from(*y)) / 255.0).powi(2), count + 1)
    });
    (sum / count.max(1) as f64).sqrt()
}

/// How many points the disk needs.
fn points(world: &ReferenceWorld, receivers: &ShadowReceivers) -> Result<Vec<BenchRow>> {
    let directions = spread(12);
    let (fine, _) = maps(world, receivers, 4096, &directions)?;
    let partly = |x: u8, y: u8| ![0, 255].contains(&x) || ![0, 255].contains(&y);
    let mut rows = Vec::new();
    for count in [1, 4, 16, 32, 64, 128, 256, 1024] {
        let (found, us) = maps(world, receivers, count, &directions)?;
        let (inside, all) = (rms(&found, &fine, partly), rms(&found, &fine, |_, _| true));
        let note = format!(
            "RMS of the visible share in penumbras, against 4,096 points ({all:.1e} over all receivers); a map of {} \
             receivers, the mean of 12",
            receivers.len()
        );
        rows.push(row("disk points", count, inside, us, note));
    }
    Ok(rows)
}

/// Casting and rays must give the same map.
fn ways(world: &ReferenceWorld, receivers: &ShadowReceivers) -> Result<Vec<BenchRow>> {
    let light = AreaLight::disk(SUN, POINTS)?;
    let shadows = ShadowScene::new(world, receivers, &light)?;
    let directions = &spread(12)[3..6];
    let clock = Instant::now();
    let rays: Vec<Vec<u8>> = directions.iter().map(|d| shadows.by_rays(*d)).collect();
    let by_rays = clock.elapsed().as_secs_f64() * 1e6 / directions.len() as f64;
    let (cast, by_casting) = maps(world, receivers, POINTS, directions)?;
    let differ = rms(&cast, &rays, |_, _| true);
    let note = |what: &str| format!("{what}, {POINTS} points of the disk; RMS of what differs");
    Ok(vec![
        row("way", "a ray a point", 0.0, by_rays, note("all rays of a map")),
        row("way", "triangles cast", differ, by_casting, note("the same map")),
    ])
}

/// How far apart directions may be: the mixture of the maps around a light is compared with its own map.
fn spacings(world: &ReferenceWorld, receivers: &ShadowReceivers) -> Result<Vec<BenchRow>> {
    let lights = &spread(16)[..8];
    let (truth, _) = maps(world, receivers, POINTS, lights)?;
    let mut rows = Vec::new();
    for side in [8, 16, 32, 64, 128, 256] {
        rows.push(spacing(world, receivers, "cube", side, lights, &truth, |_| ShadowDirections::cube(side, -1.0))?);
    }
    for deg in [4.0, 2.0, 1.0, 0.5, 0.25, 0.125f64] {
        // A path through the light, which lies anywhere between two directions of the path.
        let path = |k: usize| {
            let (d, step) = (lights[k], deg.to_radians());
            let before = step * (0.618 * k as f64 + 0.25).fract();
            let across = d.any_orthonormal_vector();
            let at = |angle: f64| d * angle.cos() + across * angle.sin();
            ShadowDirections::arc(&[at(-before), at(step - before)])
        };
        rows.push(spacing(world, receivers, "path, degrees", deg, lights, &truth, path)?);
    }
    Ok(rows)
}

fn spacing(
    world: &ReferenceWorld,
    receivers: &ShadowReceivers,
    knob: &str,
    setting: impl ToString,
    lights: &[DVec3],
    truth: &[Vec<u8>],
    directions: impl Fn(usize) -> Result<ShadowDirections>,
) -> Result<BenchRow> {
    let (mut mixed, mut nearest, mut apart, mut us) = (Vec::new(), Vec::new(), 0.0, 0.0);
    for (k, light) in lights.iter().enumerate() {
        let all = directions(k)?;
        let blend = all.blend(*light);
        let around: Vec<DVec3> = blend.iter().map(|(k, _)| all.list()[*k]).collect();
        let (parts, _) = maps(world, receivers, POINTS, &around)?;
        let clock = Instant::now();
        let mix = |i: usize| {
            let sum: f64 = parts.iter().zip(&blend).map(|(part, (_, share))| share * f64::from(part[i])).sum();
            sum.round() as u8
        };
        mixed.push((0..receivers.len()).map(mix).collect::<Vec<u8>>());
        us += clock.elapsed().as_secs_f64() * 1e6 / lights.len() as f64;
        let most = (0..blend.len()).fold(0, |a, b| if blend[b].1 > blend[a].1 { b } else { a });
        nearest.push(parts[most].clone());
        apart += light.angle_between(around[most]).to_degrees() / lights.len() as f64;
    }
    let note = format!(
        "RMS of the visible share over all receivers, maps around {} lights mixed; the nearest map alone, {apart:.2}° \
         away, has {:.3}; to mix a map",
        lights.len(),
        rms(&nearest, truth, |_, _| true)
    );
    Ok(row(knob, setting, rms(&mixed, truth, |_, _| true), us, note))
}

/// Bytes and time of the codes, for a part of the source's cube and for the sun's path of a day.
fn codes(world: &ReferenceWorld, receivers: &ShadowReceivers) -> Result<Vec<BenchRow>> {
    let cube = ShadowDirections::cube(32, -1.0)?;
    let share: Vec<DVec3> = cube.list().iter().step_by(OF_THE_CUBE).copied().collect();
    // From horizon to horizon, with the noon 58° high, every quarter of a degree.
    let day: Vec<DVec3> = (0..=720)
        .map(|k| (k as f64 / 720.0 * 0.5 * TAU).sin_cos())
        .map(|(sin, cos)| DVec3::new(cos, -0.53 * sin, 0.848 * sin))
        .collect();
    let mut rows = Vec::new();
    for (which, directions) in [("cube", &share), ("day", &day)] {
        rows.extend(code(world, receivers, which, directions)?);
    }
    Ok(rows)
}

fn code(
    world: &ReferenceWorld,
    receivers: &ShadowReceivers,
    which: &str,
    directions: &[DVec3],
) -> Result<Vec<BenchRow>> {
    let light = AreaLight::disk(SUN, POINTS)?;
    let shadows = ShadowScene::new(world, receivers, &light)?;
    let (mut collector, mut sample) = (MapCollector::new(receivers.len()), Vec::new());
    let clock = Instant::now();
    shadows.maps(directions, |k, map| {
        // Decoding is timed on some of the maps.
        if k.is_multiple_of(16) {
            sample.push((k, map.to_vec()));
        }
        collector.push(map)
    })?;
    let run_lengths = collector.run_length_bytes();
    let coded: CodedMaps = collector.finish(ShadowDirections::arc(directions)?)?;
    let build = clock.elapsed().as_secs_f64() * 1e6 / directions.len() as f64;
    let raw = receivers.len() * directions.len();
    let mut map = vec![0; receivers.len()];
    // The median over maps of the time for 100,000 receivers (µs), and the share of receivers that differ. All
    // receivers of a map that cannot be read differ.
    let mut decoded = |decode: &dyn Fn(usize, &mut [u8]) -> bool| {
        let mut wrong = 0;
        let mut times: Vec<f64> = (0..sample.len())
            .map(|n| {
                let us = median_us(1.0, || decode(n, &mut map));
                let differ = |map: &[u8]| map.iter().zip(&sample[n].1).filter(|(a, b)| a != b).count();
                wrong += if decode(n, &mut map) { differ(&map) } else { map.len() };
                us * 1e5 / receivers.len() as f64
            })
            .collect();
        let [middle, longest] = [0.5, 1.0].map(|share| quantile(&mut times, share).unwrap_or(f64::NAN));
        (wrong as f64 / (receivers.len() * sample.len()) as f64, middle, longest)
    };
    let by_runs: Vec<Vec<u8>> = sample.iter().map(|(_, map)| runs::encode(map)).collect();
    let what = match which {
        "cube" => format!("{} of a 32² × 6 cube's 6,144 directions", directions.len()),
        _ => format!("{} directions of a day", directions.len()),
    };
    let mut rows = Vec::new();
    let mut add = |setting: &str, bytes: usize, (wrong, us, most): (f64, f64, f64)| {
        let note = format!(
            "share of receivers that differ; 100,000 receivers of a map decoded on one thread, at most {most:.0} µs; \
             {what}: {bytes} bytes, {:.1} times smaller than {raw}",
            raw as f64 / bytes as f64
        );
        rows.push(row(&format!("code, {which}"), setting, wrong, us, note));
    };
    add(
        "a byte each",
        raw,
        decoded(&|n, map| {
            map.copy_from_slice(&sample[n].1);
            true
        }),
    );
    let run_length = |n: usize, map: &mut [u8]| runs::decode(&by_runs[n], map).is_ok();
    add("run lengths", run_lengths, decoded(&run_length));
    let entropy = |n: usize, map: &mut [u8]| coded.decode(sample[n].0, map).is_ok();
    add("entropy code", coded.bytes(), decoded(&entropy));
    let note =
        format!("a map of {} receivers computed and coded, {POINTS} points of the disk; {what}", receivers.len());
    rows.push(row(&format!("code, {which}"), "build", 0.0, build, note));
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The cluster has as many receivers as stated. Its maps meet both goals of the code: they are twelve times smaller
    /// than raw bytes, and lossless. (Times are measured by `bench`.)
    #[test]
    fn the_cluster_s_maps_are_twelve_times_smaller() {
        let world = cluster();
        let receivers = ShadowReceivers::new(&world, &[EDGE_MM]).unwrap();
        assert_eq!(receivers.len(), 42_120);
        let light = AreaLight::disk(SUN, POINTS).unwrap();
        let shadows = ShadowScene::new(&world, &receivers, &light).unwrap();
        let (directions, mut collector, mut all) = (spread(24), MapCollector::new(receivers.len()), Vec::new());
        shadows
            .maps(&directions, |_, map| {
                all.push(map.to_vec());
                collector.push(map)
            })
            .unwrap();
        let (raw, run_lengths) = (24 * receivers.len(), collector.run_length_bytes());
        let coded = collector.finish(ShadowDirections::arc(&directions).unwrap()).unwrap();
        let mut map = vec![0; receivers.len()];
        for (k, want) in all.iter().enumerate() {
            coded.decode(k, &mut map).unwrap();
            assert!(map == *want);
        }
        assert!(coded.bytes() * 12 <= raw, "{} of {raw}", coded.bytes());
        assert!(coded.bytes() < run_lengths, "{run_lengths} as run lengths");
    }
}
