//! One picture of each side to look at: lit leaf, diffuse reflectance and transmittance; normals, thickness and
//! roughness. It is only for viewing; the truth is in the EXR files beside it.

use super::leaf::{SyntheticLeaf, SyntheticSide};
use crate::Result;
use mesophyll_base::statistics::upper_quantile;
use mesophyll_files::image::{to_srgb8, write_png};
use mesophyll_optics::side::Side;
use std::path::Path;

/// Widest tile (texels).
const TILE: usize = 720;

/// Writes the six maps of a side as tiles of one PNG, beside the truth in the folder of a capture.
pub fn write(capture: &Path, leaf: &SyntheticLeaf, side: Side) -> Result<()> {
    let path = mesophyll_capture::truth_path(capture, side).with_extension("png");
    let mask = leaf.mask_of(side);
    let side = leaf.side(side);
    let by = leaf.width.div_ceil(TILE);
    let (w, h) = (leaf.width / by, leaf.height / by);
    if w == 0 || h == 0 {
        return Ok(());
    }
    let range = |map: &[f32]| {
        map.iter().zip(&mask).filter(|(_, m)| **m).fold([f32::MAX, f32::MIN], |[a, b], (v, _)| [a.min(*v), b.max(*v)])
    };
    let [thin, thick] = range(&side.thickness);
    let [smooth, rough] = range(&side.m);
    let brightest = |map: &[[f32; 3]]| {
        let mut all: Vec<f32> = map.iter().zip(&mask).filter(|(_, m)| **m).map(|(v, _)| v[1]).collect();
        0.3 / upper_quantile(&mut all, 9, 10).unwrap_or(1.0).max(1e-6)
    };
    let (bright_d, bright_t) = (brightest(&side.rho_d), brightest(&side.rho_t));
    let tiles: [&dyn Fn(usize) -> [f32; 3]; 6] = [
        &|k| lit(side, k).map(|v| 0.55 * bright_d * v),
        &|k| side.rho_d[k].map(|v| bright_d * v),
        &|k| side.rho_t[k].map(|v| bright_t * v),
        &|k| side.normal[k].map(|v| linear(0.5 + 0.5 * v)),
        &|k| [linear((side.thickness[k] - thin) / (thick - thin).max(1e-9)); 3],
        &|k| [linear((side.m[k] - smooth) / (rough - smooth).max(1e-9)); 3],
    ];
    let mut pixels = vec![0u8; 3 * w * 2 * h * 3];
    for (t, tile) in tiles.iter().enumerate() {
        for j in 0..h {
            for i in 0..w {
                let mut sum = [0f32; 3];
                for k in (0..by * by).map(|s| (j * by + s / by) * leaf.width + i * by + s % by) {
                    let value = if mask[k] { tile(k) } else { [0.9; 3] };
                    (0..3).for_each(|c| sum[c] += value[c] / (by * by) as f32);
                }
                let at = 3 * ((t / 3 * h + j) * 3 * w + t % 3 * w + i);
                (0..3).for_each(|c| pixels[at + c] = to_srgb8(sum[c]));
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
fn lit(side: &SyntheticSide, k: usize) -> [f32; 3] {
    let n = side.normal[k];
    let lamps: [([f32; 3], f32); 2] = [([-0.42, 0.5, 0.757], 0.9), ([0.12, 0.16, 0.98], 0.12)];
    let mut sum = side.rho_d[k].map(|d| 0.3 * d);
    for (l, power) in lamps {
        let cosine = (n[0] * l[0] + n[1] * l[1] + n[2] * l[2]).max(0.0);
        let h = [l[0], l[1], l[2] + 1.0];
        let size = (h[0] * h[0] + h[1] * h[1] + h[2] * h[2]).sqrt();
        let ca = ((n[0] * h[0] + n[1] * h[1] + n[2] * h[2]) / size).max(1e-3);
        let m2 = side.m[k] * side.m[k];
        let bell = (-(1.0 / (ca * ca) - 1.0) / m2).exp() / (m2 * ca.powi(4));
        for (c, s) in sum.iter_mut().enumerate() {
            *s += power * (side.rho_d[k][c] * cosine + side.rho_s[k][c] * bell / (4.0 * n[2].max(0.1)));
        }
    }
    sum
}
