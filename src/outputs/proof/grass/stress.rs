//! Meadows and rays that are hard for slices: whether the opacity along a ray stays a share, and whether it is right.

use crate::stress::StressRow;
use glam::{DVec2, DVec3};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_fits::grass::blades::{LawnMeadow, STEPS};
use mesophyll_fits::grass::hill::Hill;
use mesophyll_fits::grass::judge::{LawnRays, coverage_of_blades, coverage_of_slices, towards};
use mesophyll_fits::grass::march::{LawnSlices, unleant};
use mesophyll_fits::grass::sheet::{CHANNELS, CellEdges, SliceAtlas};
use mesophyll_fits::grass::{Options, baked, optics, weights};
use mesophyll_plants::growth::meadow;
use std::path::Path;
use std::time::Instant;

/// A lawn on a small square, with this many blades a square metre.
fn lawn(per_m2: f64, size_mm: [f64; 2]) -> Result<LawnMeadow, String> {
    lawn_with(per_m2, size_mm, |_| ())
}

/// The same, with blades that were changed.
fn lawn_with(per_m2: f64, size_mm: [f64; 2], change: impl Fn(&mut LeafMesh)) -> Result<LawnMeadow, String> {
    let text = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/grass/lawn.toml"));
    let mut described: meadow::MeadowSpec = text.parse().map_err(|e: toml::de::Error| e.to_string())?;
    described.size_mm = size_mm;
    described.swards.iter_mut().for_each(|sward| sward.per_m2 = per_m2);
    let leaves = optics::read(None).map_err(|e| e.to_string())?;
    let mut grown = described.grow(None);
    grown.blades.iter_mut().for_each(|blade| change(&mut blade.mesh));
    LawnMeadow::new(Path::new("lawn.toml"), &grown, &leaves).map_err(|e| e.to_string())
}

fn small(slices: usize) -> Result<(LawnMeadow, LawnSlices), String> {
    let meadow = lawn(21_000.0, [100.0, 100.0])?;
    let options = Options { slices, texels: [64, 32], rays: 2, ..Options::default() };
    let slices = baked(&meadow, &options);
    Ok((meadow, slices))
}

/// The same slices with one opacity everywhere.
fn even(opacity: f32) -> Result<LawnSlices, String> {
    let (_, slices) = small(8)?;
    let mut texel = [0.0; CHANNELS];
    texel[0] = opacity;
    let upright = SliceAtlas::new([64, 32], 16, CellEdges::Level, |_, _, _| texel);
    let level = Some(SliceAtlas::new([64, 64], 1, CellEdges::Level, |_, _, _| texel));
    let cover = LawnSlices::covers(&upright, level.as_ref());
    Ok(LawnSlices { upright, level, cover, ..slices })
}

/// Opacity along a ray; an error where it is not between 0 and 1.
fn opacity(slices: &LawnSlices, origin: DVec3, d: DVec3, steps: usize) -> Result<f64, String> {
    let found = slices.march(origin, d, steps, 0.0, |_, texel| [texel[1], texel[2], texel[3]]);
    let share = |v: f64| (0.0..=1.0 + 1e-12).contains(&v);
    if !share(found.opacity) || !found.colour.iter().all(|c| share(*c)) || found.steps > steps {
        return Err(format!("opacity {} and colour {:?} after {} slices", found.opacity, found.colour, found.steps));
    }
    Ok(found.opacity)
}

/// A row. `of` returns what was found, what is right, and how far apart the two may be.
fn row(case: &str, expected: &str, of: impl FnOnce() -> Result<[f64; 3], String>) -> StressRow {
    let clock = Instant::now();
    let found = of();
    let ms = clock.elapsed().as_secs_f64() * 1e3;
    let verdict = match &found {
        Ok([found, right, most]) if (found - right).abs() <= *most => "ok".to_string(),
        Ok([found, right, most]) => format!("wrong: {found}, expected {right} within {most}"),
        Err(why) => format!("refused: {why}"),
    };
    StressRow {
        model: "grass".into(),
        case: case.into(),
        expected: expected.into(),
        verdict,
        digits: None,
        condition: None,
        ms,
    }
}

/// A hill as steep as a scene may have it, with a slope of 0.6 at 300 mm to each side of its top.
fn steep(slices: &LawnSlices) -> Hill {
    let radius = 300.0;
    Hill { middle: 0.1 * DVec2::from(slices.period), height: 0.6 * 0.5f64.exp() * radius, radius }
}

/// The share of the sun's light that reaches the ground where the hill falls by 0.6 along x. Only the level slice has
/// blades, with the same opacity everywhere. So their optical depth from above is −ln(1 − opacity), and along another
/// direction it is as much larger as the projection of blades and the way through the lawn are.
fn sunny(azimuth_deg: f64) -> Result<[f64; 3], String> {
    let opacity = 0.5;
    let even = even(opacity)?;
    let upright = SliceAtlas::new([64, 32], 16, CellEdges::Level, |_, _, _| [0.0; CHANNELS]);
    let cover = LawnSlices::covers(&upright, even.level.as_ref());
    let projection = std::array::from_fn(|k| 0.4 - 0.2 * k as f64 / STEPS as f64);
    // The level slice shows more than the blades, so that a share of it is enough in every direction.
    let slices = LawnSlices { upright, cover, projection, shown: [0.0, 1.0], ..even };
    let hill = steep(&slices);
    let (at, sun) = (hill.middle + DVec2::new(hill.radius, 0.0), towards(45.0, azimuth_deg));
    let depth = -f64::from(1.0 - opacity).ln() * (0.4 - 0.2 * sun.z) / (sun.z + 0.6 * sun.x);
    Ok([slices.on_ground(&hill, at, sun), (-depth).exp(), 1e-6])
}

/// The rows of `mesophyll stress grass`.
pub fn rows() -> Vec<StressRow> {
    let middle = |s: &LawnSlices| DVec3::new(7.0, -11.0, 0.5 * s.height);
    vec![
        row("level, along the slices across y: 1,000 slices", "ok", || {
            let (_, s) = small(8)?;
            Ok([opacity(&s, middle(&s), DVec3::X, 1000)?, 1.0, 1e-3])
        }),
        row("level, at 45°: both kinds at the same places", "ok", || {
            let (_, s) = small(8)?;
            let origin = DVec3::new(0.0, 0.0, 0.3 * s.height);
            Ok([opacity(&s, origin, DVec3::new(1.0, 1.0, 0.0).normalize(), 1000)?, 1.0, 1e-3])
        }),
        row("from below as from above: the same slices, the same opacity", "ok", || {
            let (_, s) = small(8)?;
            let d = -towards(55.0, 31.0);
            let top = DVec3::new(3.0, 4.0, s.height);
            let ground = top + d * (s.height / -d.z);
            Ok([opacity(&s, ground, -d, 1000)?, opacity(&s, top, d, 1000)?, 1e-4])
        }),
        row("from inside, both ways: together what the whole ray has", "ok", || {
            let (_, s) = small(8)?;
            let d = -towards(65.0, 31.0);
            let top = DVec3::new(3.0, 4.0, s.height);
            let inside = top + d * (0.37 * s.height / -d.z);
            let passes = (1.0 - opacity(&s, inside, d, 1000)?) * (1.0 - opacity(&s, inside, -d, 1000)?);
            Ok([1.0 - passes, opacity(&s, top, d, 1000)?, 1e-3])
        }),
        row("on the ground, looking down: nothing is left to cross", "ok", || {
            let (_, s) = small(8)?;
            Ok([opacity(&s, DVec3::new(1.0, 2.0, 0.0), DVec3::NEG_Z, 1000)?, 0.0, 0.0])
        }),
        row("no steps", "ok", || {
            let (_, s) = small(8)?;
            Ok([opacity(&s, middle(&s), -towards(30.0, 10.0), 0)?, 0.0, 0.0])
        }),
        row("one slice a direction", "ok", || {
            let (meadow, mut s) = small(1)?;
            weights::fit(&meadow, &mut s, 16).map_err(|e| e.to_string())?;
            let rays = LawnRays { side: 32, level: 0.0, sunlit: false };
            let of = |e: f64| {
                [coverage_of_slices(&s, rays, towards(e, 37.0)), coverage_of_blades(&meadow, rays, towards(e, 37.0))]
            };
            let [found, right] = of(40.0);
            Ok([found, right, 0.1])
        }),
        row("opacity 0 everywhere", "ok", || {
            Ok([opacity(&even(0.0)?, DVec3::new(1.0, 2.0, 40.0), -towards(20.0, 10.0), 1000)?, 0.0, 0.0])
        }),
        row("opacity 1 everywhere", "ok", || {
            let s = even(1.0)?;
            Ok([opacity(&s, DVec3::new(1.0, 2.0, s.height), -towards(20.0, 10.0), 1000)?, 1.0, 1e-3])
        }),
        row("a hundred times as many blades", "ok", || {
            let meadow = lawn(2_100_000.0, [20.0, 20.0])?;
            let s = baked(&meadow, &Options { slices: 8, texels: [64, 32], rays: 1, ..Options::default() });
            let rays = LawnRays { side: 16, level: 0.0, sunlit: false };
            let to = towards(60.0, 20.0);
            Ok([coverage_of_slices(&s, rays, to), coverage_of_blades(&meadow, rays, to), 0.05])
        }),
        row("blades whose texture coordinates lie at one point, without tangents: as with them", "ok", || {
            let of = |meadow: LawnMeadow| {
                let s = baked(&meadow, &Options { slices: 8, texels: [64, 32], rays: 2, ..Options::default() });
                opacity(&s, DVec3::new(3.0, 4.0, s.height), -towards(70.0, 31.0), 1000)
            };
            let flat = lawn_with(21_000.0, [100.0, 100.0], |mesh| {
                mesh.uvs.iter_mut().for_each(|uv| *uv = DVec2::ZERO);
                mesh.tangents.iter_mut().for_each(|t| t.0 = DVec3::splat(f64::NAN));
            })?;
            Ok([of(flat)?, of(lawn(21_000.0, [100.0, 100.0])?)?, 0.0])
        }),
        row("one blade, from 5° over the ground: a quarter of what it covers", "ok", || {
            let meadow = lawn(100.0, [100.0, 100.0])?;
            let mut s = baked(&meadow, &Options { slices: 8, texels: [64, 32], rays: 4, ..Options::default() });
            weights::fit(&meadow, &mut s, 32).map_err(|e| e.to_string())?;
            let rays = LawnRays { side: 128, level: 0.0, sunlit: false };
            let to = towards(5.0, 20.0);
            let right = coverage_of_blades(&meadow, rays, to);
            Ok([coverage_of_slices(&s, rays, to), right, 0.25 * right])
        }),
        row("a wind that leans all by 45°: as a ray that is leant the other way", "ok", || {
            let (_, s) = small(8)?;
            let (lean, origin, d) = (DVec2::new(0.6, -0.8), middle(&s), -towards(50.0, 20.0));
            let found = s.march_leaning(origin, d, 1000, 0.0, |_| lean, |_, _| [0.0; 3]).opacity;
            Ok([found, opacity(&s, unleant(origin, lean), unleant(d, lean), 1000)?, 1e-12])
        }),
        row("gusts that turn from slice to slice: opacity stays a share", "ok", || {
            let (_, s) = small(8)?;
            let lean = |at: DVec2| DVec2::new((0.9 * at.x).sin(), (1.1 * at.y).cos());
            let top = DVec3::new(3.0, 4.0, s.height);
            let found = s.march_leaning(top, -towards(30.0, 20.0), 1000, 0.0, lean, |_, t| [t[1], t[2], t[3]]);
            Ok([found.opacity.max(found.colour[0]), 0.5, 0.5])
        }),
        row("irregular, straight down: every rectangle covers what the meadow covers", "ok", || {
            let (_, s) = small(8)?;
            let moved = LawnSlices { irregular: Some(7), ..s.clone() };
            let mean = |s: &LawnSlices, at: [f64; 2]| -> Result<f64, String> {
                let n = 64;
                let one = |k: usize| {
                    let axis = |k: usize, a: usize| (at[a] + (k as f64 + 0.5) / n as f64 - 0.5) * s.period[a];
                    opacity(s, DVec3::new(axis(k % n, 0), axis(k / n, 1), s.height), DVec3::NEG_Z, 1000)
                };
                Ok((0..n * n).map(one).sum::<Result<f64, String>>()? / (n * n) as f64)
            };
            let right = mean(&s, [0.0; 2])?;
            let mut worst = right;
            for k in 0..25 {
                let found = mean(&moved, [f64::from(k % 5 - 2), f64::from(k / 5 - 2)])?;
                worst = if (found - right).abs() > (worst - right).abs() { found } else { worst };
            }
            Ok([worst, right, 1e-6])
        }),
        row("irregular, 3,000 million rectangles away: opacity stays a share", "ok", || {
            let s = LawnSlices { irregular: Some(u32::MAX), ..small(8)?.1 };
            let far = DVec3::new(-3e9 * s.period[0], 3e9 * s.period[1], s.height);
            Ok([opacity(&s, far, -towards(30.0, 20.0), 1000)?, 0.5, 0.5])
        }),
        row("irregular, level along the seam of two rectangles: 1,000 slices", "ok", || {
            let s = LawnSlices { irregular: Some(7), ..small(8)?.1 };
            let seam = DVec3::new(3.0, 0.5 * s.period[1], 0.3 * s.height);
            Ok([opacity(&s, seam, DVec3::X, 1000)?, 1.0, 1e-3])
        }),
        row("a hill of no height: as level ground", "ok", || {
            let (_, s) = small(8)?;
            let (origin, d) = (DVec3::new(3.0, 4.0, s.height), -towards(40.0, 31.0));
            let flat = Hill { height: 0.0, ..steep(&s) };
            Ok([s.march_on(&flat, origin, d, 1000.0, |_, _| [0.0; 3]).0.opacity, opacity(&s, origin, d, 1000)?, 1e-3])
        }),
        row("a hollow, straight down its axis: the ground is at its bottom", "ok", || {
            let (_, s) = small(8)?;
            let hollow = Hill { height: -steep(&s).height, ..steep(&s) };
            let origin = hollow.middle.extend(s.height);
            let (_, ground) = s.march_on(&hollow, origin, DVec3::NEG_Z, 1000.0, |_, _| [0.0; 3]);
            Ok([ground.ok_or("no ground")?, s.height - hollow.height, 1e-6])
        }),
        row("over the ridge of the steepest hill into the lawn behind it: opacity stays a share", "ok", || {
            let (_, s) = small(8)?;
            let hill = steep(&s);
            let d = -towards(20.0, 31.0);
            let over = hill.middle.extend(hill.height + 0.9 * s.height);
            let found = s.march_on(&hill, over - d * 200.0, d, 1000.0, |_, t| [t[1], t[2], t[3]]).0;
            Ok([found.opacity.max(found.colour[0]), 0.5, 0.5])
        }),
        row("a slope of 0.6, the sun 45° high before it, level slice alone: its closed form", "ok", || sunny(0.0)),
        row("the same with the sun at the side", "ok", || sunny(90.0)),
        row("the same with the sun behind it, 14° over the slope", "ok", || sunny(180.0)),
        row("zero height: no blade stands", "refused: lawn.toml: no blade stands above the ground", || {
            lawn(0.0, [100.0, 100.0]).map(|_| [0.0; 3])
        }),
        row("blades ten thousand times as long as the square", "refused: lawn.toml: more than 2000000 blades", || {
            lawn(1e12, [0.005, 0.005]).map(|_| [0.0; 3])
        }),
    ]
}
