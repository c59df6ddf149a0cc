//! Groups that stand in many places are met as if each of their instances stood alone.

use crate::common::{Accept, EVERY, numbered, placement, point, seeded, soup, with_every_set};
use glam::{DMat4, DQuat, DVec3};
use mesophyll_transport::rays::{InstanceForest, Ray, RayHit, TriangleTree};
use rand::RngExt;

/// A hit by the shape's instance and the place alone: the number of the same instance in the flat forest.
type Named = (usize, usize, f64, [f64; 2]);

/// Two plants of several leaves at places of any turn and scale, with a ground and a lone leaf: once leaf by leaf, and
/// once with each plant stored once.
struct Both {
    flat: InstanceForest,
    grouped: InstanceForest,
    /// For each place, the first of its instances in the flat forest; for each group, the number of its first instance.
    first: Vec<usize>,
    begins: Vec<usize>,
    group_of: Vec<usize>,
    single: usize,
}

impl Both {
    fn new(seed: u64, places: usize, reach: f64) -> Both {
        let mut rng = seeded(seed);
        let meshes = [soup(&mut rng, 40, 0.4, 0.3), soup(&mut rng, 3, 0.3, 0.4), Vec::new()];
        let solid: fn(usize) -> bool = |k| k % 4 == 0;
        let shapes: Vec<_> = meshes.iter().map(|m| TriangleTree::with_solid(m, &numbered(m), solid)).collect();
        let single = vec![(0, placement(&mut rng, reach)), (1, DMat4::from_scale(DVec3::splat(reach)))];
        let mut plant = |leaves: usize, first: usize| -> Vec<(usize, DMat4)> {
            (0..leaves).map(|k| ((k + first) % 3, placement(&mut rng, 1.5))).collect()
        };
        // The third plant has no leaves at all.
        let groups = vec![plant(25, 0), plant(7, 1), Vec::new()];
        let mut rng = seeded(seed + 1);
        let places: Vec<(usize, DMat4)> = (0..places)
            .map(|k| {
                let scale = 10f64.powf(2.0 * rng.random::<f64>() - 1.0);
                let turn = DQuat::from_axis_angle(point(&mut rng, 1.0).normalize(), 6.0 * rng.random::<f64>());
                (k % 3, DMat4::from_scale_rotation_translation(DVec3::splat(scale), turn, point(&mut rng, reach)))
            })
            .collect();
        let (mut all, mut first) = (single.clone(), Vec::new());
        for (group, place) in &places {
            first.push(all.len());
            all.extend(groups[*group].iter().map(|(shape, leaf)| (*shape, *place * *leaf)));
        }
        let begins = vec![single.len(), single.len() + groups[0].len(), 0];
        Both {
            flat: InstanceForest::new(shapes.clone(), &all),
            grouped: InstanceForest::with_groups(shapes, &single, &groups, &places),
            first,
            begins,
            group_of: places.iter().map(|(group, _)| *group).collect(),
            single: single.len(),
        }
    }

    /// The same instance's number in the flat forest.
    fn named(&self, hit: RayHit) -> Named {
        let instance = match hit.place {
            None => {
                assert!(hit.instance < self.single);
                hit.instance
            }
            Some(place) => {
                let place = place as usize;
                self.first[place] + hit.instance - self.begins[self.group_of[place]]
            }
        };
        (instance, hit.triangle, hit.t, hit.barycentric)
    }
}

/// Fails where both differ by more than rounding; gives how many rays meet something at a place.
fn same(both: &Both, forest: &InstanceForest, rays: &[Ray], accept: Accept) -> usize {
    let together = forest.nearest_of_each(rays, accept);
    assert_eq!(together, forest.nearest_of_neighbours(rays, accept));
    let mut met = 0;
    for (ray, found) in rays.iter().zip(together) {
        assert_eq!(found, forest.nearest(ray, accept), "{ray:?}");
        assert_eq!(found.is_some(), forest.blocked(ray, accept));
        let alone = both.flat.nearest(ray, EVERY);
        assert_eq!(found.is_some(), alone.is_some(), "{ray:?}: {found:?}, leaf by leaf {alone:?}");
        let Some((found, alone)) = found.zip(alone) else { continue };
        met += usize::from(found.place.is_some());
        let (instance, triangle, t, [b, c]) = both.named(found);
        assert_eq!((instance, triangle), (alone.instance, alone.triangle), "{ray:?}");
        assert!((t - alone.t).abs() <= 1e-9 * alone.t, "{t} {}", alone.t);
        assert!((b - alone.barycentric[0]).abs() < 1e-6 && (c - alone.barycentric[1]).abs() < 1e-6);
        assert!(!forest.blocked_within(ray, t * (1.0 - 1e-9), accept), "{ray:?}");
        assert!(forest.blocked_within(ray, t * (1.0 + 1e-9), accept), "{ray:?}");
    }
    met
}

/// Rays from anywhere and those of a camera, among few and many places, near together and far apart.
#[test]
fn groups_are_met_as_leaf_by_leaf() {
    for (seed, places, reach) in [(31, 3, 2.0), (33, 60, 6.0), (35, 900, 300.0)] {
        let both = Both::new(seed, places, reach);
        let mut rng = seeded(seed + 2);
        let mut rays: Vec<Ray> = (0..1200)
            .map(|_| {
                let from = point(&mut rng, 1.5 * reach);
                Ray::new(from, point(&mut rng, reach) - from)
            })
            .collect();
        let eye = DVec3::new(0.0, -3.0 * reach, reach);
        rays.extend((0..900).map(|k| {
            let at = DVec3::new((k % 30) as f64 / 15.0 - 1.0, 0.0, (k / 30) as f64 / 15.0 - 1.0) * reach;
            Ray::new(eye, at - eye)
        }));
        for forest in with_every_set(&both.grouped) {
            let met = same(&both, &forest, &rays, EVERY);
            assert!(met > 50, "{met} of {} rays meet a group at {places} places", rays.len());
        }
    }
}

/// An outline is asked by the number of the instance, whichever place is hit; solid triangles are not asked for.
#[test]
fn outlines_are_asked_by_instance() {
    let both = Both::new(41, 60, 6.0);
    let mut rng = seeded(42);
    let odd: Accept = |instance, _, _| instance % 2 == 1;
    let mut met = 0;
    for _ in 0..1500 {
        let from = point(&mut rng, 9.0);
        let ray = Ray::new(from, point(&mut rng, 6.0) - from);
        let Some(hit) = both.grouped.nearest(&ray, odd) else { continue };
        assert!(hit.instance % 2 == 1 || hit.triangle % 4 == 0);
        met += 1;
    }
    assert!(met > 300, "{met}");
}

/// Equal plants inside each other: of hits at the same distance the first place counts.
#[test]
fn equal_places_have_an_order() {
    let sheet = [DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, -1.0, 0.0), DVec3::new(0.0, 1.0, 0.0)];
    let shapes = vec![TriangleTree::new(&sheet, &numbered(&sheet))];
    let group = vec![(0, DMat4::IDENTITY), (0, DMat4::from_translation(-DVec3::Z))];
    let places = vec![(0, DMat4::IDENTITY); 5000];
    let forest = InstanceForest::with_groups(shapes, &[], &[group], &places);
    let ray = Ray::new(DVec3::Z, -DVec3::Z);
    let found = forest.nearest(&ray, EVERY).map(|h| (h.t, h.instance, h.place));
    assert_eq!(found, Some((1.0, 0, Some(0))));
    assert_eq!(forest.nearest_of_each(&[ray; 9], EVERY), vec![forest.nearest(&ray, EVERY); 9]);
}

/// A group of one instance, at one place and at none, is not taken for an instance that stands alone.
#[test]
fn a_group_of_one_stands_at_its_places_alone() {
    let sheet = [DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, -1.0, 0.0), DVec3::new(0.0, 1.0, 0.0)];
    let shapes = || vec![TriangleTree::new(&sheet, &numbered(&sheet))];
    let ray = Ray::new(DVec3::Z, -DVec3::Z);
    let group = [vec![(0, DMat4::IDENTITY)]];
    let none = InstanceForest::with_groups(shapes(), &[], &group, &[]);
    assert!(none.nearest(&ray, EVERY).is_none() && none.bounds().is_none());
    let lower = [(0, DMat4::from_translation(DVec3::Z * -3.0))];
    let one = InstanceForest::with_groups(shapes(), &[], &group, &lower);
    assert_eq!(one.nearest(&ray, EVERY).map(|h| (h.t, h.place)), Some((4.0, Some(0))));
}

/// A million places: a ray from above each of some of them meets this one. It takes seconds, so it is asked for by
/// name.
#[test]
#[ignore = "it builds a tree over a million boxes: seconds"]
fn a_million_places_are_told_apart() {
    let start = std::time::Instant::now();
    let sheet = [DVec3::new(-0.4, -0.4, 0.0), DVec3::new(0.4, -0.4, 0.0), DVec3::new(0.0, 0.4, 0.0)];
    let shapes = vec![TriangleTree::new(&sheet, &numbered(&sheet))];
    let group = vec![(0, DMat4::IDENTITY), (0, DMat4::from_translation(-DVec3::Z))];
    let at = |k: usize| DVec3::new((k % 1000) as f64, (k / 1000) as f64, (k % 7) as f64);
    let places: Vec<(usize, DMat4)> = (0..1_000_000).map(|k| (0, DMat4::from_translation(at(k)))).collect();
    let forest = InstanceForest::with_groups(shapes, &[], &[group], &places);
    for k in (0..1_000_000).step_by(997) {
        let found = forest.nearest(&Ray::new(at(k) + DVec3::Z * 20.0, -DVec3::Z), EVERY).map(|h| (h.instance, h.place));
        assert_eq!(found, Some((0, Some(k as u32))));
    }
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let memory = status.lines().find(|line| line.starts_with("VmHWM")).unwrap_or_default();
    println!("{:.1} s; {memory}", start.elapsed().as_secs_f64());
}
