//! One picture of each side to look at: lit leaf, diffuse reflectance and transmittance; normals, thickness and
//! roughness. It is only for viewing; the truth is in the EXR files beside it.

use super::leaf::{SyntheticLeaf, SyntheticTexel};
use crate::Result;
use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::upper_quantile;
use mesophyll_files::image::{to_srgb8, write_png};
use mesophyll_optics::side::Side;
use std::path::Path;

/// Widest tile (texels).
const TILE: usize = 720;
const TILES: usize = 6;

/// Writes the six maps of a side as tiles of one PNG, beside the truth in the folder of a capture.
pub fn write(capture: &Path, leaf: &SyntheticLeaf, side: Side) -> Result<()> {
    let path = mesophyll_capture::truth_path(capture, side).with_extension("png");
    let (mask, width) = (leaf.mask_of(side), leaf.size.width);
    let side = &leaf.sides[side];
    let by = width.div_ceil(TILE);
    let (w, h) = (width / by, leaf.size.height / by);
    if w == 0 || h == 0 {
        return Ok(());
    }
    let on = || side.iter().zip(&mask).filter(|(_, m)| **m).map(|(t, _)| t);
    let range =
        |of: fn(&SyntheticTexel) -> f32| on().map(of).fold([f32::MAX, f32::MIN], |[a, b], v| [a.min(v), b.max(v)]);
    let [thin, thick] = range(|t| t.thickness);
    let [smooth, rough] = range(|t| t.m);
    let brightest = |green: fn(&SyntheticTexel) -> f32| {
        0.3 / upper_quantile(&mut on().map(green).collect::<Vec<_>>(), 9, 10).unwrap_or(1.0).max(1e-6)
    };
    let (bright_d, bright_t) = (brightest(|t| t.rho_d[1]), brightest(|t| t.rho_t[1]));
    let tiles = |t: &SyntheticTexel| {
        [
            lit(t) * (0.55 * bright_d),
            t.rho_d * bright_d,
            t.rho_t * bright_t,
            Rgb(t.normal.map(|v| linear(0.5 + 0.5 * v))),
            Rgb::splat(linear((t.thickness - thin) / (thick - thin).max(1e-9))),
            Rgb::splat(linear((t.m - smooth) / (rough - smooth).max(1e-9))),
        ]
    };
    let mut pixels = vec![0u8; 3 * w * 2 * h * 3];
    for j in 0..h {
        for i in 0..w {
            let mut sums = [Rgb::splat(0f32); TILES];
            for k in (0..by * by).map(|s| (j * by + s / by) * width + i * by + s % by) {
                let shown = if mask[k] { tiles(&side[k]) } else { [Rgb::splat(0.9); TILES] };
                sums.iter_mut().zip(shown).for_each(|(sum, value)| *sum += value / (by * by) as f32);
            }
            for (t, sum) in sums.into_iter().enumerate() {
                let at = 3 * ((t / 3 * h + j) * 3 * w + t % 3 * w + i);
                pixels[at..at + 3].copy_from_slice(&sum.map(to_srgb8)[..]);
            }
        }
    }
    write_png(&path, 3 * w, 2 * h, &pixels)
}

/// Undoes the sRGB curve roughly, for tiles that show numbers instead of light.
fn linear(v: f32) -> f32 {
    v.clamp(0.0, 1.0).powf(2.2)
}

/// Light from a lamp at the upper left and a soft sky, with Beckmann gloss (Wang et al. 2005 Eq. 7), towards a camera
/// straight above.
fn lit(t: &SyntheticTexel) -> Rgb<f32> {
    let n = t.normal;
    let lamps: [([f32; 3], f32); 2] = [([-0.42, 0.5, 0.757], 0.9), ([0.12, 0.16, 0.98], 0.12)];
    let mut sum = t.rho_d * 0.3;
    for (l, power) in lamps {
        let cosine = (n[0] * l[0] + n[1] * l[1] + n[2] * l[2]).max(0.0);
        let h = [l[0], l[1], l[2] + 1.0];
        let size = (h[0] * h[0] + h[1] * h[1] + h[2] * h[2]).sqrt();
        let ca = ((n[0] * h[0] + n[1] * h[1] + n[2] * h[2]) / size).max(1e-3);
        let m2 = t.m * t.m;
        let bell = (-(1.0 / (ca * ca) - 1.0) / m2).exp() / (m2 * ca.powi(4));
        sum += (t.rho_d * cosine + t.rho_s * bell / (4.0 * n[2].max(0.1))) * power;
    }
    sum
}
