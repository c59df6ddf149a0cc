//! The leaf on the light table: its transmittance against the bare table.

use super::grid::Grid;
use super::manifest::Manifest;
use super::outline::{on_table, widened};
use super::picture::Picture;
use super::reduced::Noise;
use super::register::Match;
use super::shade::Lit;
use crate::{Error, Result};

/// The leaf on the table: its mask, the ratio of both pictures beside it, and the relative standard error of that.
pub(super) struct OnTable {
    /// Pixels of the leaf.
    pub mask: Vec<bool>,
    /// The ratio and its relative standard error, a channel.
    pub exposure: [[f64; 2]; 3],
}

/// Finds the leaf on the light table.
///
/// # Errors
/// [`Error::Input`] where both pictures differ in size, the table is clipped, or beside the leaf it is far from as
/// bright as when it was bare.
pub(super) fn on_light_table(picture: &Picture, bare: &Picture) -> Result<OnTable> {
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
    let mut levels: Vec<f64> = (0..w * h).step_by((w * h / 100_000).max(1)).map(|k| f64::from(bare.grey(k))).collect();
    levels.retain(|v| v.is_finite());
    let full = mesophyll_capture::dome::noise::quantile(&mut levels, 0.9);
    // Where the bare picture is darker than a tenth of the table there is no table.
    let ratio: Vec<[f32; 3]> = (0..w * h)
        .map(|k| {
            let lit = f64::from(bare.grey(k)) > 0.1 * full;
            [0, 1, 2].map(|c: usize| if lit { picture.pixels[k][c] / bare.pixels[k][c] } else { f32::NAN })
        })
        .collect();
    let mask = on_table(picture, &ratio)?;
    let near = widened(&mask, w, h, w.max(h) / 60 + 2);
    let exposure = [0, 1, 2].map(|c: usize| {
        let mut beside: Vec<f64> =
            (0..w * h).filter(|&k| !near[k] && ratio[k][c].is_finite()).map(|k| f64::from(ratio[k][c])).collect();
        if beside.len() < 100 {
            return [1.0, 0.05];
        }
        let quarter = |beside: &mut Vec<f64>, q| mesophyll_capture::dome::noise::quantile(beside, q);
        let (low, middle, high) = (quarter(&mut beside, 0.25), quarter(&mut beside, 0.5), quarter(&mut beside, 0.75));
        // Half the distance of the quartiles is .674 standard deviations. Noise averages out over the many pixels; what
        // does not is a table that changed from place to place, at most a tenth of what is seen.
        [middle, 0.1 * 0.5 * (high - low) / 0.674 / middle]
    });
    if exposure.iter().any(|e| !(0.2..=5.0).contains(&e[0])) {
        let what =
            format!("beside the leaf the table is {:.3} times as bright as bare; expected about 1", exposure[1][0]);
        return Err(Error::input(&picture.path, what));
    }
    Ok(OnTable { mask, exposure })
}

/// ρt, its standard error, and the relative error that all texels share.
pub(super) fn through(
    m: &Manifest,
    picture: &Picture,
    bare: &Picture,
    table: &OnTable,
    grid: &Grid,
    mask: &[bool],
    found: &Match,
    noise: Noise,
    under: &Lit,
) -> (Vec<[f64; 3]>, Vec<[f64; 3]>, [f64; 3]) {
    let motion = found.motion;
    let r = m.light_table.reflectance;
    let below = mean(&under.value, mask);
    // The table behind the leaf is brighter by 1/(1 − rρ).
    let factor = [0, 1, 2].map(|c: usize| (1.0 - r * below[c]) / table.exposure[c][0]);
    let shared = [0, 1, 2].map(|c: usize| {
        // How far light spreads in the table before it returns is not known: under small leaves and near the outline
        // anything between none and all of it may be missing.
        let spread = r / 12f64.sqrt();
        let back = m.light_table.reflectance_err.hypot(spread) * below[c] / (1.0 - r * below[c]);
        back.hypot(table.exposure[c][1])
    });
    let value = grid.mean(mask, |p| {
        let at = motion.at(p);
        let (l, b) = (picture.at(at), bare.at(at));
        [0, 1, 2].map(|c: usize| l[c] / b[c] * factor[c])
    });
    let pixels = (grid.step as f64 * motion.scale()).powi(2).max(1.0);
    let apart = found.apart_px / grid.step as f64;
    let error = (0..value.len())
        .map(|k| {
            let b = if mask[k] { bare.at(motion.at(grid.middle(k))) } else { [f64::NAN; 3] };
            [0, 1, 2].map(|c: usize| {
                let t = value[k][c] / factor[c];
                let variance = noise.variance(t * b[c]) + t * t * noise.variance(b[c]);
                let noise = (variance / pixels).sqrt() / b[c] * factor[c];
                noise.hypot(apart * grid.slope(&value, k, c)).hypot(grid.blur(&value, k, c))
            })
        })
        .collect();
    (value, error, shared)
}

/// Mean of the finite values where `mask` is set, a channel.
pub(super) fn mean(map: &[[f64; 3]], mask: &[bool]) -> [f64; 3] {
    let good = || map.iter().zip(mask).filter(|(v, m)| **m && v.iter().all(|v| v.is_finite())).map(|(v, _)| v);
    let n = good().count().max(1) as f64;
    [0, 1, 2].map(|c: usize| good().map(|v| v[c]).sum::<f64>() / n)
}
