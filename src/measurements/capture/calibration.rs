//! From camera values to the calibrated scale: value = frame / white × the white sheet's own response, its reflectance
//! times D.
//!
//! Plain division by the white frame would make every white texel 1 in every frame, and the effect of the tube's
//! distance would be lost. D puts it back (Gardner et al. 2003; the normalisation is documented in `data/README.md`).

use crate::manifest::{TubeManifest, TubePass, white_path};
use crate::{Error, Result};
use mesophyll_base::image::ImageSize;
use mesophyll_base::rgb::Rgb;
use mesophyll_files::image::{exr_info, read_exr_rows};
use mesophyll_files::quantity::RGB;
use mesophyll_optics::tube::{Travel, Tube};
use rayon::prelude::*;
use std::f64::consts::PI;
use std::path::Path;

/// White sheets wider than this are averaged down, because the gain varies slowly and the noise does not.
const GRID: usize = 96;

/// The response D of a white Lambertian texel that faces up, at `at` (mm), to the tube at `position` (mm along its
/// travel). Its unit is the response to an infinite tube straight above.
///
/// D = 1/(π r²) Σ over both ends (φ + sin φ cos φ), with tan φ = (distance to that end along the tube)/(r H), r =
/// √(1+u²), H the tube's height and u its horizontal distance over H. This is the closed form for a line source in
/// units of its height. A long Lambertian cylinder gives the same irradiance as its axis; by the capture's convention
/// its lit length ends at the angles at which the axis' ends are seen.
pub fn white_response(tube: &Tube, travel: Travel, position: f64, at: [f64; 2]) -> f64 {
    let (across, along) = match travel {
        Travel::X => (position - at[0], at[1]),
        Travel::Y => (position - at[1], at[0]),
    };
    let u = across / tube.height_mm;
    let r = (1.0 + u * u).sqrt();
    let end = |s: f64| {
        let phi = (s / (r * tube.height_mm)).atan();
        phi + phi.sin() * phi.cos()
    };
    let half = 0.5 * tube.length_mm;
    (end(half - along) + end(half + along)) / (PI * r * r)
}

/// The camera value of a texel whose calibrated value is 1, for each frame, on a coarse grid over the blade.
#[derive(Debug)]
pub struct FrameGain {
    size: ImageSize,
    blade: ImageSize,
    /// The grid of each frame.
    frames: Vec<Vec<Rgb<f32>>>,
}

impl FrameGain {
    /// Reads the white frames of one pass and divides them by the sheet's own response and reflectance.
    pub fn read(
        folder: &Path,
        manifest: &TubeManifest,
        pass: &TubePass,
        dark: Option<&[Rgb<f32>]>,
    ) -> Result<FrameGain> {
        let positions = pass.positions();
        let reflectance = manifest.white_reflectance.unwrap_or(1.0);
        let first = exr_info(&white_path(folder, pass.name, 0))?;
        let (w, h) = (first.width, first.height);
        // Average k×k blocks so that at most GRID columns are left.
        let block = w.div_ceil(GRID).max(1);
        let grid = ImageSize::new(w.div_ceil(block), h.div_ceil(block));
        let frames = positions
            .par_iter()
            .enumerate()
            .map(|(k, &position)| {
                let path = white_path(folder, pass.name, k);
                let info = exr_info(&path)?;
                if (info.width, info.height) != (w, h) {
                    return Err(Error::input(
                        &path,
                        format!(
                            "found {}x{} texels, the pass's first white frame has {w}x{h}",
                            info.width, info.height
                        ),
                    ));
                }
                let maps = read_exr_rows(&path, Some(&RGB), None)?;
                let mut sums = vec![Rgb::<(f64, u32)>::default(); grid.texels()];
                for j in 0..h {
                    for i in 0..w {
                        let wide = manifest.texel_mm * manifest.width as f64 / w as f64;
                        let at = ImageSize::new(w, h).place_mm(wide, j * w + i);
                        let response = reflectance * white_response(&manifest.tube, pass.name, position, at);
                        let dark = dark.map_or(Rgb::default(), |d| {
                            let column = ((i as f64 + 0.5) * manifest.width as f64 / w as f64) as usize;
                            let row = ((j as f64 + 0.5) * manifest.height as f64 / h as f64) as usize;
                            d[row.min(manifest.height - 1) * manifest.width + column.min(manifest.width - 1)]
                        });
                        for (c, (sum, count)) in sums[(j / block) * grid.width + i / block].iter_mut().enumerate() {
                            let v = f64::from(maps.channels[c].1[j * w + i]) - f64::from(dark[c]);
                            if v.is_finite() {
                                *sum += v / response;
                                *count += 1;
                            }
                        }
                    }
                }
                // A white sheet that reads nothing cannot calibrate: the frame has no reading there.
                let gain = |(sum, count): (f64, u32)| {
                    let gain = sum / f64::from(count);
                    if gain > 0.0 { gain as f32 } else { f32::NAN }
                };
                let out: Vec<Rgb<f32>> = sums.into_iter().map(|cell| cell.map(gain)).collect();
                if out.iter().flatten().all(|g| g.is_nan()) {
                    return Err(Error::input(
                        &path,
                        "the white sheet reads zero or less everywhere; expected a lit white frame",
                    ));
                }
                Ok(out)
            })
            .collect::<Result<Vec<_>>>()?;
        Ok(FrameGain { size: grid, blade: manifest.size(), frames })
    }

    /// Gains of all frames, cells and channels.
    pub fn values(&self) -> impl Iterator<Item = f32> + '_ {
        self.frames.iter().flatten().flatten().copied()
    }

    /// The gain of frame `k` at each of `texels`.
    pub fn at(&self, k: usize, texels: &[[u32; 2]]) -> Vec<Rgb<f32>> {
        self.interpolate(&self.frames[k], texels).collect()
    }

    /// Divides the values of frame `k` at `texels` by the interpolated gain.
    pub fn divide(&self, k: usize, texels: &[[u32; 2]], values: &mut [Rgb<f32>]) {
        values.iter_mut().zip(self.interpolate(&self.frames[k], texels)).for_each(|(v, gain)| *v /= gain);
    }

    /// The gain at each of `texels`, averaged over the frames.
    pub fn mean(&self, texels: &[[u32; 2]]) -> Vec<Rgb<f32>> {
        let mean = |cell: usize, c: usize| {
            let good = self.frames.iter().map(|f| f[cell][c]).filter(|v| v.is_finite());
            let (sum, count) = good.fold((0.0, 0u32), |(sum, count), v| (sum + f64::from(v), count + 1));
            (sum / f64::from(count)) as f32
        };
        let grid: Vec<Rgb<f32>> = (0..self.size.texels()).map(|cell| Rgb::of(|c| mean(cell, c))).collect();
        self.interpolate(&grid, texels).collect()
    }

    /// The interpolated value of the grid at each of `texels`.
    fn interpolate(&self, grid: &[Rgb<f32>], texels: &[[u32; 2]]) -> impl Iterator<Item = Rgb<f32>> {
        let ImageSize { width: w, height: h } = self.size;
        texels.iter().map(move |t| {
            let x = ((f64::from(t[0]) + 0.5) * w as f64 / self.blade.width as f64 - 0.5).clamp(0.0, (w - 1) as f64);
            let y = ((f64::from(t[1]) + 0.5) * h as f64 / self.blade.height as f64 - 0.5).clamp(0.0, (h - 1) as f64);
            let (i, j) = ((x as usize).min(w.saturating_sub(2)), (y as usize).min(h.saturating_sub(2)));
            let (i1, j1) = ((i + 1).min(w - 1), (j + 1).min(h - 1));
            let (fx, fy) = ((x - i as f64) as f32, (y - j as f64) as f32);
            let top = grid[j * w + i] * (1.0 - fx) + grid[j * w + i1] * fx;
            let low = grid[j1 * w + i] * (1.0 - fx) + grid[j1 * w + i1] * fx;
            top * (1.0 - fy) + low * fy
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Brute-force irradiance of a line source with Lambertian emission across its axis.
    fn brute(tube: &Tube, u_mm: f64, along: f64) -> f64 {
        let n = 200_000;
        let (h, half) = (tube.height_mm, tube.length_mm / 2.0);
        let mut sum = 0.0;
        for k in 0..n {
            let s = -half + tube.length_mm * (k as f64 + 0.5) / n as f64 - along;
            let d2 = u_mm * u_mm + h * h + s * s;
            let cos_texel = h / d2.sqrt();
            let sin_axis = ((u_mm * u_mm + h * h) / d2).sqrt();
            sum += cos_texel * sin_axis / d2 * tube.length_mm / n as f64;
        }
        // An infinite line straight above gives ∫ h·h/(h²+s²)² ds = π/(2h).
        sum * 2.0 * h / PI
    }

    #[test]
    fn white_response_is_the_line_integral() {
        let tube = Tube { height_mm: 100.0, length_mm: 500.0, radius_mm: 2.5 };
        for (position, at) in [(0.0, [0.0, 0.0]), (150.0, [-20.0, 30.0]), (-380.0, [35.0, -26.0])] {
            let closed = white_response(&tube, Travel::X, position, at);
            let sum = brute(&tube, position - at[0], at[1]);
            assert!((closed / sum - 1.0).abs() < 1e-7, "{closed} {sum}");
        }
        assert!((white_response(&tube, Travel::Y, 0.0, [0.0, 0.0]) - 0.977).abs() < 5e-4);
    }
}
