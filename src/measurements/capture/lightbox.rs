//! Transmittance of a leaf on a diffuse light box, and the mask that follows from it.
//!
//! By reciprocity, (leaf − dark)/(box − dark) seen at an angle is the slab's ρt for a collimated beam at that angle
//! (`data/README.md`).

use mesophyll_base::image::ImageSize;
use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::median_of;

/// The ratio leaf/box with its standard error, for each texel and channel. NaN where the box reads nothing.
#[derive(Debug, Clone, Default)]
pub struct TransmittanceMap {
    /// Transmittance, 0 to 1.
    pub value: Vec<Rgb<f32>>,
    /// Its standard error.
    pub error: Vec<Rgb<f32>>,
    /// The part of the error that comes from the dark frame, with its sign: the change of the ratio where both
    /// photographs are one standard deviation of the dark frame too high. The texel's frames under the tube share this
    /// error.
    pub by_dark: Vec<Rgb<f32>>,
}

/// Transmittance from two photographs. `dark` is the standard deviation of the dark frame that was subtracted from
/// both; it shifts the ratio by (1 − ratio)/box. `level` is that dark frame, if there is one: the light-independent
/// signal that it removed has noise, too.
pub fn transmittance(
    leaf: &[Rgb<f32>],
    empty: &[Rgb<f32>],
    relative: f64,
    floor: f64,
    dark: f64,
    level: Option<&[Rgb<f32>]>,
) -> TransmittanceMap {
    let unknown = || vec![Rgb::splat(f32::NAN); leaf.len()];
    let mut found = TransmittanceMap { value: unknown(), error: unknown(), by_dark: unknown() };
    for (k, (l, e)) in leaf.iter().zip(empty).enumerate() {
        let level = level.map_or(Rgb::default(), |d| d[k].map(|v| if v > 0.0 { f64::from(v) } else { 0.0 }));
        for c in 0..3 {
            let (l, e) = (f64::from(l[c]), f64::from(e[c]));
            if e > 0.0 && l.is_finite() {
                let t = l / e;
                let variance = |v: f64| (relative * (v + level[c])).powi(2) + floor * floor;
                let by_dark = dark * (1.0 - t);
                found.value[k][c] = t as f32;
                found.error[k][c] = ((variance(l) + t * t * variance(e) + by_dark.powi(2)).sqrt() / e) as f32;
                found.by_dark[k][c] = (by_dark / e) as f32;
            }
        }
    }
    found
}

/// Where the leaf is, from its transmittance: texels darker than halfway between the leaf's median and the bare box, in
/// pieces of at least 1 % of the largest piece. Empty when nothing stands out.
pub fn mask_from_transmission(ratio: &[Rgb<f32>], size: ImageSize) -> Vec<bool> {
    let mean: Vec<f32> = ratio.iter().map(|t| (t[0] + t[1] + t[2]) / 3.0).collect();
    let Some(dark) = median_of(mean.iter().copied().filter(|v| *v < 0.8)) else { return vec![false; mean.len()] };
    let threshold = 0.5 * (1.0 + dark);
    let inside: Vec<bool> = mean.iter().map(|&v| v < threshold).collect();
    keep_large_pieces(&inside, size)
}

/// Removes 4-connected pieces smaller than 1 % of the largest.
fn keep_large_pieces(inside: &[bool], size: ImageSize) -> Vec<bool> {
    let (label, sizes) = pieces(inside, size);
    let largest = sizes.iter().copied().max().unwrap_or(0);
    label.iter().map(|&l| l != 0 && sizes[l as usize] * 100 >= largest).collect()
}

/// The 4-connected pieces of `inside`: the number of each texel's piece, 0 for none, and the texels of each piece.
pub fn pieces(inside: &[bool], size: ImageSize) -> (Vec<u32>, Vec<usize>) {
    let mut label = vec![0u32; inside.len()];
    let mut sizes = vec![0usize];
    let mut stack = Vec::new();
    for start in 0..inside.len() {
        if !inside[start] || label[start] != 0 {
            continue;
        }
        let name = sizes.len() as u32;
        sizes.push(0);
        label[start] = name;
        stack.push(start);
        while let Some(at) = stack.pop() {
            sizes[name as usize] += 1;
            for next in size.neighbours(at) {
                if inside[next] && label[next] == 0 {
                    label[next] = name;
                    stack.push(next);
                }
            }
        }
    }
    (label, sizes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mask_keeps_the_leaf_and_drops_specks() {
        let (w, h) = (40, 30);
        let leaf = |i: usize, j: usize| (i as f64 - 20.0).hypot(j as f64 - 15.0) < 10.0;
        let ratio: Vec<Rgb<f32>> = (0..w * h)
            .map(|k| if leaf(k % w, k / w) || k == 3 { Rgb([0.1, 0.2, 0.05]) } else { Rgb([1.0, 0.99, 1.01]) })
            .collect();
        let mask = mask_from_transmission(&ratio, ImageSize::new(w, h));
        assert!((0..w * h).all(|k| mask[k] == leaf(k % w, k / w)));
    }

    #[test]
    fn the_error_of_a_ratio_is_propagated() {
        let found = transmittance(&[Rgb::splat(0.2)], &[Rgb::splat(0.8)], 0.01, 0.0, 0.0, None);
        let (t, e) = (found.value[0][0], found.error[0][0]);
        assert!((t - 0.25).abs() < 1e-7 && (e - 0.25 * 0.01 * 2f32.sqrt()).abs() < 1e-7);
        let shifted = transmittance(&[Rgb::splat(0.201)], &[Rgb::splat(0.801)], 0.01, 0.0, 0.0, None).value[0][0] - t;
        let stated = transmittance(&[Rgb::splat(0.2)], &[Rgb::splat(0.8)], 0.01, 0.0, 0.001, None).by_dark[0][0];
        assert!((shifted / stated - 1.0).abs() < 3e-3, "{shifted} {stated}");
    }
}
