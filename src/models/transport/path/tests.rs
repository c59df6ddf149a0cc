//! The path tracer is compared with closed forms, and its samplers with their densities.

use super::lights::{SceneLights, density};
use super::scattering::ScatterPoint;
use super::*;
use crate::dome::ReferenceDome;
use crate::environment::Environment;
use crate::lobe::{Lobe, ReflectionLobe};
use crate::test_worlds::{leaf, plates, side, square};
use crate::world::{ReferencePlacement, ReferenceSun};
use glam::DMat4;
use std::f64::consts::PI;
use std::sync::Arc;

/// Radiance and its standard error along one line of sight.
fn along(world: &ReferenceWorld, from: DVec3, to: DVec3, paths: PathSettings, count: u32) -> (f64, f64) {
    let seen = PathTracer::new(world, paths).unwrap().look(from, to - from, count, 9);
    (seen.radiance[1].mean, seen.radiance[1].error)
}

pub const BOTH: PathSettings = PathSettings { bounces: None, strategy: SamplingStrategy::Both };

fn close((found, error): (f64, f64), want: f64, at_most: f64, what: &str) {
    assert!(error <= at_most * want, "{what}: the estimate {found} ± {error} is too coarse");
    assert!((found - want).abs() <= 4.0 * error + 1e-6 * want, "{what}: {found} ± {error}, expected {want}");
}

/// A crowd of leaves that absorb nothing cannot be distinguished from the sky around it.
#[test]
fn leaves_that_absorb_nothing_vanish_in_a_constant_sky() {
    let mut world = plates(10.0, &[]);
    world.leaves = vec![leaf(square(10.0), [0.7, 0.4], 0.3, None), leaf(square(10.0), [1.0, 1.0], 0.0, None)];
    // The first leaf's back absorbs what it does not reflect, so the leaf is turned until only its front is lit.
    world.leaves[0].back = side(0.7, 0.3, None);
    for k in 0..40 {
        let f = f64::from(k);
        let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, f, 2.0 * f, 0.3 * f);
        let at = DVec3::new((1.7 * f).sin() * 30.0, (2.9 * f).cos() * 30.0, f - 20.0);
        world
            .instances
            .push(ReferencePlacement { leaf: k as usize % 2, transform: DMat4::from_rotation_translation(turn, at) });
    }
    world.sky = Some([2.5; 3]);
    let tracer = PathTracer::new(&world, BOTH).unwrap();
    let mut met = 0;
    for k in 0..2000 {
        let f = f64::from(k);
        let from = DVec3::new(f.sin() * 90.0, f.cos() * 90.0, 70.0 * (0.37 * f).sin());
        let ray = Ray::new(from, (DVec3::new((3.0 * f).sin(), (5.0 * f).cos(), 0.1) * 20.0 - from).normalize());
        let brought = tracer.follow(ray, &mut PathSampler::new(1, k));
        assert!(!brought.cut);
        if brought.met {
            met += 1;
            assert!((brought.radiance[0] - 2.5).abs() < 1e-5, "{:?}", brought.radiance);
        }
    }
    assert!(met > 500, "{met}");
}

/// Two wide plates under a constant sky: the light between them in closed form.
#[test]
fn wide_plates_meet_their_closed_form() {
    let (upper, lower) = (([0.3, 0.2], 0.35), ([0.45, 0.5], 0.4));
    let mut world = plates(1e7, &[(20.0, upper.0, upper.1), (0.0, lower.0, lower.1)]);
    world.sky = Some([1.0; 3]);
    // Down between the plates D = τ₁ + ρ₁ U, and up U = ρ₂ D + τ₂, for a sky of radiance 1 on both sides.
    let down = (upper.1 + upper.0[1] * lower.1) / (1.0 - upper.0[1] * lower.0[0]);
    let up = lower.0[0] * down + lower.1;
    let above = upper.0[0] + upper.1 * up;
    let below = lower.0[1] + lower.1 * down;
    for (from, to, want) in [
        (DVec3::new(3.0, 5.0, 90.0), DVec3::new(0.0, 0.0, 20.0), above),
        (DVec3::new(3.0, 5.0, -90.0), DVec3::ZERO, below),
        (DVec3::new(3.0, 5.0, 10.0), DVec3::ZERO, up),
    ] {
        close(along(&world, from, to, BOTH, 4096), want, 0.01, "plates");
    }
}

/// A sheet with different skies on its two sides, and the same with a sun.
#[test]
fn a_sheet_between_two_skies() {
    let mut world = plates(1e6, &[(0.0, [0.3, 0.2], 0.45)]);
    world.dome = Some(ReferenceDome {
        radiance: Arc::new(|d| if d.z > 0.0 { [2.0; 3] } else { [0.5; 3] }),
        seen_below: Some([0.5; 3]),
        nodes: None,
    });
    for strategy in [SamplingStrategy::Both, SamplingStrategy::Lights, SamplingStrategy::Surfaces] {
        let paths = PathSettings { bounces: None, strategy };
        let above = along(&world, DVec3::new(1.0, 2.0, 5.0), DVec3::ZERO, paths, 8192);
        close(above, 0.3 * 2.0 + 0.45 * 0.5, 0.01, "from above");
        let below = along(&world, DVec3::new(1.0, 2.0, -5.0), DVec3::ZERO, paths, 8192);
        close(below, 0.2 * 0.5 + 0.45 * 2.0, 0.01, "from below");
    }
    world.dome = None;
    for radius in [0.0, 0.2] {
        let cos: f64 = 0.6;
        world.sun = Some(ReferenceSun {
            direction: DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos),
            irradiance: [3.0; 3],
            radius,
        });
        let above = along(&world, DVec3::new(1.0, 2.0, 5.0), DVec3::ZERO, BOTH, 8192);
        close(above, 0.3 * 3.0 * cos / PI, 0.01, "the sun from above");
        let below = along(&world, DVec3::new(1.0, 2.0, -5.0), DVec3::ZERO, BOTH, 8192);
        close(below, 0.45 * 3.0 * cos / PI, 0.01, "the sun from below");
    }
}

/// Glossy leaves in a corner under sun and sky. All ways of drawing directions have the same mean, with one, two and
/// many scatterings.
#[test]
fn all_ways_of_drawing_agree() {
    let mut world = ReferenceWorld {
        leaves: vec![leaf(square(10.0), [0.4, 0.3], 0.3, Some((0.2, 0.25)))],
        ..ReferenceWorld::default()
    };
    for (angle, at) in [(0.0, DVec3::ZERO), (1.2, DVec3::new(0.0, 8.0, 6.0)), (-0.8, DVec3::new(5.0, -9.0, 7.0))] {
        let transform = DMat4::from_rotation_translation(glam::DQuat::from_rotation_x(angle), at);
        world.instances.push(ReferencePlacement { leaf: 0, transform });
    }
    world.sun =
        Some(ReferenceSun { direction: DVec3::new(0.3, 0.1, 0.9).normalize(), irradiance: [2.0; 3], radius: 0.3 });
    let texels = (0..32 * 16).map(|k| [0.2 + ((k * 7919) % 97) as f32 / 50.0; 3]).collect();
    world.environment = Some(Arc::new(Environment::new(32, 16, texels).unwrap()));
    for bounces in [Some(1), Some(2), None] {
        let ways = [SamplingStrategy::Both, SamplingStrategy::Lights, SamplingStrategy::Surfaces].map(|strategy| {
            along(
                &world,
                DVec3::new(2.0, 1.0, 30.0),
                DVec3::new(1.0, 1.0, 0.0),
                PathSettings { bounces, strategy },
                32_768,
            )
        });
        for (mean, error) in &ways[1..] {
            let (both, other) = ways[0];
            assert!(*error < 0.02 * mean, "{bounces:?}: {ways:?}");
            assert!((mean - both).abs() < 4.0 * error.hypot(other), "{bounces:?}: {ways:?}");
        }
        // A constant sky is drawn by surfaces only, or by lights only.
        let even = ReferenceWorld { sky: Some([0.7; 3]), environment: None, ..world.clone() };
        let look = |strategy| {
            along(
                &even,
                DVec3::new(2.0, 1.0, 30.0),
                DVec3::new(1.0, 1.0, 0.0),
                PathSettings { bounces, strategy },
                32_768,
            )
        };
        let (a, b) = (look(SamplingStrategy::Both), look(SamplingStrategy::Lights));
        assert!((a.0 - b.0).abs() < 4.0 * a.1.hypot(b.1), "{bounces:?}: {a:?} {b:?}");
    }
}

/// Pearson's statistic of drawn directions over cells of zenith and azimuth, against a density that is integrated over
/// each cell. Returns its distance from the mean in standard deviations.
fn chi_square(draws: u32, draw: impl Fn(u32) -> Option<DVec3>, density: impl Fn(DVec3) -> f64) -> f64 {
    const RINGS: usize = 24;
    const SPOKES: usize = 24;
    let mut seen = vec![0.0; RINGS * SPOKES];
    let mut drawn = 0.0;
    for k in 0..draws {
        if let Some(d) = draw(k) {
            assert!((d.length() - 1.0).abs() < 1e-9);
            let i = ((d.z.clamp(-1.0, 1.0).acos() / PI * RINGS as f64) as usize).min(RINGS - 1);
            let j = ((d.y.atan2(d.x) / (2.0 * PI)).rem_euclid(1.0) * SPOKES as f64) as usize;
            seen[i * SPOKES + j.min(SPOKES - 1)] += 1.0;
            drawn += 1.0;
        }
    }
    let fine = 24;
    let (mut statistic, mut cells, mut rest, mut whole) = (0.0, 0, (0.0, 0.0), 0.0);
    for (k, seen) in seen.iter().enumerate() {
        let mut sum = 0.0;
        for a in 0..fine {
            for b in 0..fine {
                let theta = PI * ((k / SPOKES) as f64 + (a as f64 + 0.5) / fine as f64) / RINGS as f64;
                let phi = 2.0 * PI * ((k % SPOKES) as f64 + (b as f64 + 0.5) / fine as f64) / SPOKES as f64;
                let r = theta.sin();
                sum += r * density(DVec3::new(r * phi.cos(), r * phi.sin(), theta.cos()));
            }
        }
        let share = sum * 2.0 * PI * PI / (RINGS * SPOKES * fine * fine) as f64;
        whole += share;
        let expected = share * f64::from(draws);
        if expected > 50.0 {
            statistic += (seen - expected).powi(2) / expected;
            cells += 1;
        } else {
            rest = (rest.0 + seen, rest.1 + expected);
        }
    }
    assert!((whole - drawn / f64::from(draws)).abs() < 0.01, "the density integrates to {whole}, {drawn} were drawn");
    if rest.1 > 50.0 {
        statistic += (rest.0 - rest.1).powi(2) / rest.1;
        cells += 1;
    }
    assert!(cells > 20, "only {cells} cells tell anything");
    // Wilson & Hilferty 1931.
    let n = f64::from(cells - 1);
    ((statistic / n).cbrt() - (1.0 - 2.0 / (9.0 * n))) / (2.0 / (9.0 * n)).sqrt()
}

/// Plain random numbers. Evenly spread ones would give too small a statistic.
fn random(k: u32) -> [f64; 4] {
    let of = |q: u64| (crate::seeds::mix(77 + q, u64::from(k)) >> 11) as f64 / (1u64 << 53) as f64;
    [of(0), of(1), of(2), of(3)]
}

#[test]
fn drawn_directions_have_the_density_that_is_stated() {
    let v = DVec3::new(0.5, 0.2, 0.7).normalize();
    for lobe in Lobe::all(1.45) {
        let scatter = ScatterPoint::level(v, [0.3, 0.25], Some((0.4, 0.35, lobe)));
        let z = chi_square(200_000, |k| scatter.draw(random(k)).map(|t| t.direction), |d| scatter.density(d));
        assert!(z < 4.0, "{lobe:?}: {z}");
    }
    // A map with a sun of one texel in darkness, and a bright row. Its columns do not coincide with the cells.
    let mut texels = vec![[0.05f32; 3]; 50 * 25];
    texels[7 * 50 + 13] = [30.0; 3];
    (0..50).for_each(|i| texels[24 * 50 + i] = [2.0; 3]);
    texels[0] = [9.0; 3];
    let map = Environment::new(50, 25, texels).unwrap();
    let table = map.density.as_ref().unwrap();
    let z = chi_square(400_000, |k| Some(table.draw([random(k)[0], random(k)[1]])), |d| table.of(d));
    assert!(z < 4.0, "environment: {z}");
    // Radiance over density is constant, except for the sine within a row.
    for k in 0..1000 {
        let d = table.draw([random(k)[0], random(k)[1]]);
        assert!(table.of(d) > 0.0 && map.at(d)[0] > 0.0);
    }
    // Sun and sky together, with the choice between them.
    let world = ReferenceWorld {
        sun: Some(ReferenceSun { direction: DVec3::new(0.2, -0.5, 0.8), irradiance: [1.0; 3], radius: 0.5 }),
        dome: Some(ReferenceDome {
            radiance: Arc::new(|d| [if d.z > 0.0 { 1.0 + d.x + 3.0 * (8.0 * (d.z - 1.0)).exp() } else { 0.1 }; 3]),
            seen_below: Some([0.0; 3]),
            nodes: None,
        }),
        ..ReferenceWorld::default()
    };
    let lights = SceneLights::new(&world);
    let draw = |k: u32| lights.draw(random(k), SamplingStrategy::Both).map(|l| l.direction);
    let z = chi_square(200_000, draw, |d| density(&lights, d, SamplingStrategy::Both));
    assert!(z < 4.0, "sun and sky: {z}");
}

#[test]
fn scattering_is_reciprocal_and_gives_no_more_than_it_gets() {
    let dir = |t: f64, p: f64| DVec3::new(t.sin() * p.cos(), t.sin() * p.sin(), t.cos());
    for lobe in Lobe::all(1.45) {
        for (a, b) in [(dir(0.4, 0.1), dir(1.0, 2.0)), (dir(0.9, 4.0), dir(2.2, 1.0)), (dir(2.0, 0.0), dir(2.9, 3.0))] {
            let f = |v: DVec3, l: DVec3| ScatterPoint::level(v, [0.3, 0.4], Some((0.2, 0.3, lobe))).times_cosine(l)[0];
            let (there, back) = (f(a, b) / b.z.abs(), f(b, a) / a.z.abs());
            assert!((there / back - 1.0).abs() < 1e-12, "{lobe:?}: {there} {back}");
        }
        // With ρd + ρt + ρs = 1, the mean weight of the draws is at most 1 for every view.
        for theta in [0.1, 0.8, 1.3, 1.5] {
            let scatter = ScatterPoint::level(dir(theta, 0.0), [0.3, 0.2], Some((0.5, 0.3, lobe)));
            let n = 20_000;
            let sum: f64 = (0..n).filter_map(|k| scatter.draw(random(k))).map(|t| t.weight[0]).sum();
            let (found, exact) = (sum / f64::from(n), 0.5 + 0.5 * lobe.directional_albedo(theta.cos(), 0.3));
            assert!(exact <= 1.0 + 1e-9 && (found - exact).abs() < 0.01, "{lobe:?} {theta}: {found} {exact}");
        }
    }
}

/// Environment maps between texels: centres, the wrap in azimuth, the poles.
#[test]
fn environment_maps_lie_as_stated() {
    let (columns, rows) = (8, 4);
    let texels = (0..32).map(|k| [(k % columns) as f32, (k / columns) as f32, 1.0]).collect();
    let map = Environment::new(columns, rows, texels).unwrap();
    let at = |i: f64, j: f64| {
        let (t, p) = (j * PI / rows as f64, PI - i * 2.0 * PI / columns as f64);
        map.at(DVec3::new(t.sin() * p.cos(), t.sin() * p.sin(), t.cos()))
    };
    for (i, j) in [(0.5, 0.5), (3.5, 2.5), (7.5, 3.5)] {
        let [x, y, _] = at(i, j);
        assert!((x - (i - 0.5)).abs() < 1e-12 && (y - (j - 0.5)).abs() < 1e-12, "{i} {j}: {x} {y}");
    }
    assert!((at(8.0, 1.5)[0] - 3.5).abs() < 1e-12 && (at(2.0, 2.0)[0] - 1.5).abs() < 1e-12);
    assert!((at(2.0, 2.0)[1] - 1.5).abs() < 1e-12 && at(4.0, 0.1)[1].abs() < 1e-12);
    assert!(Environment::new(2, 1, vec![[0.0; 3], [1.0, f32::NAN, 0.0]]).unwrap_err().contains("column 1, row 0"));
    assert!(Environment::new(2, 1, vec![[0.0; 3], [-1.0, 0.0, 0.0]]).is_err());
}
