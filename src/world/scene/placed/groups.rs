//! Plants that share poses. Where a `[[plant]]` stands often, its plants move in groups: a group has one pose, which is
//! computed once for each picture. Gusts reach the groups one after the other, as the wind carries them over the land.

use super::spots::{Neighbours, Spot};
use crate::manifest::{SceneManifest, StatedPlant};
use glam::{DMat4, DVec2, DVec3};
use mesophyll_transport::ReferenceCamera;
use std::collections::BTreeSet;
use std::f64::consts::{PI, TAU};

/// More plants of a `[[plant]]` than the first number share poses if they have more leaves together than the second;
/// more than the third always do.
const FEW: usize = 16;
const FEW_LEAVES: usize = 50_000;
const MANY: usize = 64;

/// Number of poses that many plants share.
pub const SHARED: usize = 24;
/// Number of the plants nearest to the cameras, which have poses of their own.
pub const OWN: usize = 8;
/// A place is beside a picture whose direction from the camera is farther from the line of sight than the picture's
/// corner, where it is wider than high by the inverse of this. It counts as so much farther away (mm).
const VIEW: f64 = 0.6;
const BESIDE: f64 = 1e9;
/// Time (s) by which a group is later than the one before it.
const LATER: f64 = 1.0;

/// The plants of a `[[plant]]` that share poses.
#[derive(Debug, Clone, PartialEq)]
pub struct PlantGroups {
    /// The group of each place.
    pub of_place: Vec<u32>,
    /// For each group a transform from plant to world: that of its first plant, in the turn for which the wind bends
    /// the group.
    pub leaders: Vec<DMat4>,
    /// For each group, the time after which it has the gusts (s).
    pub delays: Vec<f64>,
    /// How much earlier or later than by the wind gusts reach plants: the mean over all places (s).
    pub off: f64,
    /// The places that are nearest to the cameras, or the first ones where there is no camera.
    pub near: Vec<usize>,
}

impl PlantGroups {
    /// Whether so many plants with so many leaves each share poses in a scene. Where a scene repeats, plants in a wind
    /// do not: they keep the turns that they have by themselves.
    pub fn form(manifest: &SceneManifest, plants: usize, leaves: usize) -> bool {
        let many = plants > MANY || (plants > FEW && plants.saturating_mul(leaves) > FEW_LEAVES);
        let blown = manifest.wind.as_ref().is_some_and(|w| w.speed_m_s > 0.0);
        many && manifest.transfer.is_none() && !(manifest.periodic.is_some() && blown)
    }

    /// Puts places into groups. In a wind each place gets the turn of its group.
    pub fn new(manifest: &SceneManifest, said: &StatedPlant, spots: &mut [Spot]) -> PlantGroups {
        let position = DVec3::from(said.position_mm);
        let cameras: Vec<ReferenceCamera> = manifest.perspectives().map(|v| v.camera).collect();
        let away = |spot: &Spot| {
            let of = |camera: &ReferenceCamera| {
                let to = position + spot.offset - camera.eye;
                let beside = to.normalize_or_zero().dot(camera.axes()[0]) < VIEW / camera.half_height().hypot(VIEW);
                to.length() + if beside { BESIDE } else { 0.0 }
            };
            cameras.iter().map(of).fold(f64::INFINITY, f64::min)
        };
        let mut near: Vec<usize> = (0..spots.len()).collect();
        if !cameras.is_empty() {
            let far: Vec<f64> = spots.iter().map(away).collect();
            near.sort_by(|a, b| far[*a].total_cmp(&far[*b]));
        }
        near.truncate(OWN);
        let Some(wind) = manifest.wind.as_ref().filter(|w| w.speed_m_s > 0.0) else {
            let (of_place, leaders) = (vec![0; spots.len()], vec![spots[0].transform(said)]);
            return PlantGroups { of_place, leaders, delays: vec![0.0], off: 0.0, near };
        };
        let blown = |spot: &Spot| (position + spot.offset).dot(wind.direction()) / 1e3 / wind.speed_m_s;
        let own: Vec<usize> = if cameras.is_empty() { Vec::new() } else { near.clone() };
        let groups = SHARED + own.len();
        let mut of_place = vec![u32::MAX; spots.len()];
        let (mut leaders, mut delays) = (vec![None; groups], vec![0.0; groups]);
        for (k, place) in own.iter().enumerate() {
            of_place[*place] = (SHARED + k) as u32;
            leaders[SHARED + k] = Some(spots[*place].transform(said));
            delays[SHARED + k] = blown(&spots[*place]);
        }
        let (low, high) = spots
            .iter()
            .map(|s| s.offset.truncate())
            .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        let (middle, area) = (0.5 * (low + high), (high - low).max(DVec2::splat(1.0)));
        let mut before = Neighbours::new(area, spots.len());
        let mut numbers: Vec<u32> = Vec::with_capacity(spots.len());
        let mut off = 0.0;
        let count = spots.len() as f64;
        for (k, spot) in spots.iter_mut().enumerate() {
            if of_place[k] != u32::MAX {
                continue;
            }
            let at = spot.offset.truncate() - middle;
            let taken: BTreeSet<u32> = before.around(at).map(|n| of_place[numbers[n as usize] as usize]).collect();
            let phase = blown(spot);
            let late = |group: u32| apart(phase - delay(group), SHARED as f64 * LATER);
            // The group whose gusts are most in time, and that no neighbour has.
            let free = |group: &u32| (taken.contains(group), late(*group));
            let best = (0..SHARED as u32).min_by(|a, b| {
                let (a, b) = (free(a), free(b));
                a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
            });
            let group = best.unwrap_or(0);
            off += late(group) / count;
            spot.azimuth = turn(group);
            leaders[group as usize].get_or_insert_with(|| spot.transform(said));
            delays[group as usize] = delay(group);
            of_place[k] = group;
            before.add(at);
            numbers.push(k as u32);
        }
        let first = spots[0].transform(said);
        PlantGroups { of_place, leaders: leaders.into_iter().map(|l| l.unwrap_or(first)).collect(), delays, off, near }
    }
}

/// The time after which a group has the gusts.
fn delay(group: u32) -> f64 {
    f64::from(group) * LATER
}

/// The turn of a group about the vertical (rad): the golden angle apart from that of the group before.
fn turn(group: u32) -> f64 {
    (PI * (3.0 - 5f64.sqrt()) * f64::from(group)).rem_euclid(TAU)
}

/// How far two times are apart that count in a circle.
fn apart(time: f64, circle: f64) -> f64 {
    let within = time.rem_euclid(circle);
    within.min(circle - within)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    /// In a wind along x, neighbours differ, a gust reaches plants farther along x later, and the plants that are
    /// nearest to the camera are alone.
    #[test]
    fn groups_follow_the_wind_and_neighbours_differ() {
        let text = "schema = 1\nname = \"t\"\n[[leaf]]\nname = \"a\"\nmesh = \"m.glb\"\n\
                    uniform = { rho_d = [[0.1, 0.1, 0.1], [0.1, 0.1, 0.1]], rho_t = [0.1, 0.1, 0.1] }\n\
                    [[plant]]\nfile = \"p.glb\"\nmaterials = { leaf = \"a\" }\n[wind]\nspeed_m_s = 5\nseed = 1\n\
                    [[view]]\nkind = \"perspective\"\nname = \"v\"\neye_mm = [0, 0, 1e3]\n\
                    target_mm = [1e4, 0, 1e3]\nfov_deg = 40\n[sky]\nradiance = [1, 1, 1]\n";
        let manifest = match SceneManifest::parse(text, Path::new("t.toml")) {
            Ok(manifest) => manifest,
            Err(error) => panic!("{error}"),
        };
        let place = |k: usize| DVec3::new((k % 40) as f64 * 4e3, (k / 40) as f64 * 4e3, 0.0);
        let mut spots: Vec<Spot> = (0..1600).map(|k| Spot { offset: place(k), azimuth: 0.0, scale: 1.0 }).collect();
        let groups = PlantGroups::new(&manifest, &manifest.plants[0], &mut spots);
        assert_eq!((groups.leaders.len(), groups.of_place.len()), (SHARED + OWN, 1600));
        let mut same = 0;
        let mut late = Vec::new();
        for k in 0..1600 {
            let group = groups.of_place[k];
            let beside = [k + 1, k + 40].into_iter().filter(|j| *j < 1600 && (k % 40 < 39 || *j == k + 40));
            same += beside.filter(|j| groups.of_place[*j] == group).count();
            if (group as usize) < SHARED {
                late.push(apart(place(k).x / 1e3 / 5.0 - groups.delays[group as usize], SHARED as f64 * LATER));
                assert_eq!(spots[k].azimuth, turn(group));
            }
        }
        assert_eq!(same, 0);
        // At random the mean would be a quarter of the circle: 6 s.
        let mean = late.iter().sum::<f64>() / late.len() as f64;
        assert!(mean < 3.0 && (groups.off / mean - 1.0).abs() < 0.02, "{mean} {}", groups.off);
        for own in SHARED as u32..(SHARED + OWN) as u32 {
            assert_eq!(groups.of_place.iter().filter(|g| **g == own).count(), 1);
        }
        // The first plant stands below the camera and is not seen.
        assert_eq!(groups.of_place[1] as usize, SHARED);
    }
}
