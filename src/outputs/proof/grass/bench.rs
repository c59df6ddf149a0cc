//! Slices of a lawn compared with its blades: the error of their coverage and colour against their size in bytes, with
//! and without weights, and with only the first slices of a ray.

use crate::bench::{BenchRow, median_us};
use crate::{Error, Result};
use glam::DVec3;
use mesophyll_files::progress::TaskProgress;
use mesophyll_fits::grass::blades::LawnMeadow;
use mesophyll_fits::grass::judge::{self, LawnAppearance, LawnComparison, LawnRays, towards};
use mesophyll_fits::grass::march::LawnSlices;
use mesophyll_fits::grass::{Options, baked, folder::LawnErrors, optics, weights};
use mesophyll_plants::growth::meadow;
use std::path::Path;

/// The lawn, which is compiled into the program.
const LAWN: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/grass/lawn.toml"));
/// The numbers of slices and texels that are tried.
const TRIED: [(usize, [usize; 2]); 5] =
    [(16, [64, 16]), (16, [128, 32]), (16, [256, 64]), (32, [128, 32]), (32, [256, 64])];
/// Steps of the progress bar.
pub const PIECES: u64 = TRIED.len() as u64;

/// The rows of `mesophyll bench grass`.
///
/// # Errors
/// A stop that was asked for.
pub fn rows(bar: &TaskProgress) -> Result<Vec<BenchRow>> {
    let path = Path::new("data/grass/lawn.toml");
    let description: meadow::MeadowSpec = LAWN.parse().map_err(|e| Error::toml(path, LAWN, &e))?;
    let meadow = LawnMeadow::new(path, &description.grow(None), &optics::read(None)?)?;
    let rays = LawnRays { side: 48, level: 0.0, sunlit: false };
    let truth = judge::blades(&meadow, rays);
    let mut rows = Vec::new();
    for (count, texels) in TRIED {
        let options = Options { slices: count, texels, rays: 2, ..Options::default() };
        let mut slices = baked(&meadow, &options);
        let [w, h] = texels;
        if (count, texels) == TRIED[2] {
            let plain = LawnSlices { weighted: false, ..slices.clone() };
            rows.push(row(&plain, &truth, rays, "weights", "none"));
            rows.push(row(&slices, &truth, rays, "weights", "by the blades' projection"));
        }
        weights::fit(&meadow, &mut slices, rays.side)?;
        rows.push(row(&slices, &truth, rays, "slices, texels", &format!("{count}, {w}x{h}")));
        if (count, texels) == TRIED[2] {
            let upright = LawnSlices { level: None, ..slices.clone() };
            rows.push(row(&upright, &truth, rays, "level slice", "none"));
            for level in 1..slices.upright.levels.len() {
                let rays = LawnRays { level: level as f64, ..rays };
                rows.push(row(&slices, &truth, rays, "level of the sheets", &level.to_string()));
            }
        }
        bar.step()?;
    }
    Ok(rows)
}

fn row(slices: &LawnSlices, truth: &[LawnAppearance], rays: LawnRays, knob: &str, setting: &str) -> BenchRow {
    let judged: Vec<LawnComparison> = judge::judged(slices, truth, rays);
    let errors = LawnErrors::of(&judged);
    let d = -towards(30.0, 20.0);
    let origin = |k: usize| DVec3::new(0.37 * k as f64, 0.23 * k as f64, slices.height);
    let gather = || (0..1000).map(|k| slices.march(origin(k), d, usize::MAX, rays.level, |_, _| [0.0; 3]).opacity);
    BenchRow {
        model: "grass".into(),
        knob: knob.into(),
        setting: setting.into(),
        error: errors.coverage,
        us: median_us(50.0, || gather().sum::<f64>()) / 1000.0,
        note: format!(
            "root mean square of the coverage's error over 64 directions (worst {:.3}; colour {:.1} %); {:.2} MB; \
             time: a ray at 30° in double precision",
            errors.coverage_worst,
            100.0 * errors.colour,
            slices.bytes() as f64 / 1e6
        ),
    }
}
