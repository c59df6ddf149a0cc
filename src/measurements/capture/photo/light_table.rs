//! The leaf on the light table: what is seen of it over the bare table.

use super::grid::Grid;
use super::noise::SensorNoise;
use super::outline::{on_table, widened};
use super::picture::LinearPhotograph;
use super::texture::Chosen;
use crate::photo::{Error, Result};
use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::{median, quantile};

/// A share of the picture at least is bare table, by which it is told how bright the table is now.
const BARE: f64 = 0.05;
/// Readings of the bare table differ by this share at most, noise included.
const EVEN: f64 = 0.2;

/// The leaf on the table: its mask, the ratio of both pictures beside it, and the relative standard error of that.
pub(super) struct OnTable {
    /// Pixels of the leaf.
    pub mask: Vec<bool>,
    /// The ratio and its relative standard error, a channel.
    pub exposure: Rgb<[f64; 2]>,
}

/// Finds the leaf on the light table.
///
/// # Errors
/// [`Error::Input`] where both pictures differ in size, the table is clipped, or beside the leaf it is far from as
/// bright as when it was bare.
pub(super) fn on_light_table(picture: &LinearPhotograph, bare: &LinearPhotograph) -> Result<OnTable> {
    let (w, h) = (picture.width, picture.height);
    if (bare.width, bare.height) != (w, h) {
        let what =
            format!("found {}x{} pixels, expected the {w}x{h} of the picture with the leaf", bare.width, bare.height);
        return Err(Error::input(&bare.path, what));
    }
    let clipped = bare.clipped([0, 0, w, h]);
    if clipped > 1e-3 {
        let what = format!(
            "the light table is clipped in {:.1} % of the picture; expected a shorter exposure, the same with the leaf",
            100.0 * clipped
        );
        return Err(Error::input(&bare.path, what));
    }
    let sample = (w * h / 100_000).max(1);
    let mut levels: Vec<f64> = (0..w * h).step_by(sample).map(|k| f64::from(bare.grey(k))).collect();
    levels.retain(|v| v.is_finite());
    let full = quantile(&mut levels, 0.9).unwrap_or(0.0);
    // Where the bare picture is darker than a tenth of the table there is no table.
    let mut ratio: Vec<Rgb<f32>> = (0..w * h)
        .map(|k| {
            let lit = f64::from(bare.grey(k)) > 0.1 * full;
            Rgb::of(|c| if lit { picture.pixels[k][c] / bare.pixels[k][c] } else { f32::NAN })
        })
        .collect();
    // The table may have become darker or brighter. The leaf is darker than the table beside it, whatever that shows.
    let now = Rgb::of(|c| {
        let mut list: Vec<f64> = ratio.iter().step_by(sample).map(|v| f64::from(v[c])).collect();
        list.retain(|v| v.is_finite());
        let brightest = quantile(&mut list, 1.0 - BARE).unwrap_or(0.0);
        list.retain(|v| (v / brightest - 1.0).abs() < EVEN);
        median(&mut list).unwrap_or(0.0)
    });
    if now.iter().any(|e| !(0.2..=5.0).contains(e)) {
        let what = format!("beside the leaf the table is {:.3} times as bright as bare; expected about 1", now[1]);
        return Err(Error::input(&picture.path, what));
    }
    ratio.iter_mut().for_each(|v| (0..3).for_each(|c| v[c] /= now[c] as f32));
    let mask = on_table(picture, &ratio)?;
    let near = widened(&mask, picture.size(), w.max(h) / 60 + 2);
    let exposure = Rgb::of(|c| {
        let mut beside: Vec<f64> =
            (0..w * h).filter(|&k| !near[k] && ratio[k][c].is_finite()).map(|k| f64::from(ratio[k][c])).collect();
        if beside.len() < 100 {
            return [now[c], 0.05];
        }
        let [low, middle, high] = [0.25, 0.5, 0.75].map(|q| quantile(&mut beside, q).unwrap_or(0.0));
        // Half the distance of the quartiles is .674 standard deviations. Noise averages out over the many pixels; what
        // does not is a table that changed from place to place, at most a tenth of what is seen.
        [middle * now[c], 0.1 * 0.5 * (high - low) / 0.674 / middle]
    });
    Ok(OnTable { mask, exposure })
}

/// What is seen of one side on the light table, texel by texel.
pub(super) struct OverBare {
    /// The leaf over the bare table, which is ρt where nothing comes back from the leaf to the table.
    pub value: Vec<Rgb>,
    /// Its standard error from noise and from the place in the picture.
    pub error: Vec<Rgb>,
    /// Relative standard error that all texels share.
    pub shared: Rgb,
    /// How the leaf's outline lies over the front's.
    pub found: Chosen,
    /// How bright the table was beside the leaf, over the bare picture (green).
    pub drift: f64,
}

/// The leaf over the bare table.
pub(super) fn over_bare(
    picture: &LinearPhotograph,
    bare: &LinearPhotograph,
    table: &OnTable,
    grid: &Grid,
    mask: &[bool],
    found: Chosen,
    noise: &SensorNoise,
) -> OverBare {
    let motion = found.found.motion;
    let factor = table.exposure.map(|e| 1.0 / e[0]);
    let size = motion.scale();
    let value = grid.mean(mask, size, |p| {
        let at = motion.at(p);
        picture.at(at) / bare.at(at) * factor
    });
    let (side, apart) = (grid.read(size), found.found.apart_px / grid.step as f64);
    let error = (0..value.len())
        .map(|k| {
            let b = if mask[k] { bare.at(motion.at(grid.middle(k))) } else { Rgb::splat(f64::NAN) };
            Rgb::of(|c| {
                let t = value[k][c] / factor[c];
                let variance = noise.of_mean(c, t * b[c], side) + t * t * noise.of_mean(c, b[c], side);
                let noise = variance.sqrt() / b[c] * factor[c];
                noise.hypot(apart * grid.slope(&value, k, c)).hypot(grid.blur(&value, k, c, size))
            })
        })
        .collect();
    OverBare { value, error, shared: table.exposure.map(|e| e[1]), found, drift: table.exposure[1][0] }
}

/// Mean of the finite values where `mask` is set, a channel.
pub(super) fn mean(map: &[Rgb], mask: &[bool]) -> Rgb {
    let good = || map.iter().zip(mask).filter(|(v, m)| **m && v.iter().all(|v| v.is_finite())).map(|(v, _)| v);
    let n = good().count().max(1) as f64;
    Rgb::of(|c| good().map(|v| v[c]).sum::<f64>() / n)
}
