//! The light that a leaf lets through: out(x_o) = A_p Σ_i T(|x_o − x_i|, d_i) s_i (H9 Eq. 3.14 without the albedos),
//! for many images s at once. s_i is the light that enters texel i of area A_p and thickness d_i, and T is the kernel
//! of [`crate::dipole`].
//!
//! The kernel is that of the thickness where the light enters. Shapes for a few [`ThicknessLevels`] of thickness are
//! convolved by FFT, while each texel's total is exactly that of its own thickness. The thin form's unscattered light
//! stays in its texel. Thickness is in mm; where it is 0, negative or NaN nothing enters (off the leaf, or in a hole,
//! which is open sky and not tissue).

use super::fourier::{Grid, Spectrum};
use super::kernel::Kernel;
use super::levels::{Curves, LevelKind, Nodes, ThicknessLevels};
pub use super::support::support;
use super::support::{scattered, total_parts};
use crate::dipole::{DipoleForm, Tissue};
use mesophyll_base::error::{Error, Result};
use mesophyll_base::fourier::Complex;
use rayon::prelude::*;
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};

/// What the total of a thickness is taken from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum TotalsSource {
    /// The form's own.
    #[default]
    Form,
    /// The transport equation's ρt (isotropic scattering with σs′): the kernel is rescaled, so that a flat uniform leaf
    /// transmits what the slab says.
    Transport,
}

/// All settings of a convolution besides the maps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConvolutionSettings {
    /// What the inside of the leaf is made of.
    pub tissue: Tissue,
    /// How the response to a point of light is computed.
    pub form: DipoleForm,
    /// How many thicknesses have kernels of their own.
    pub levels: ThicknessLevels,
    /// Where the total transmittance is taken from.
    pub totals: TotalsSource,
    /// Side of a texel, mm.
    pub texel_mm: f64,
    /// Kernels end at the distance beyond which less than this share of the light leaves.
    pub tail: f64,
}

impl ConvolutionSettings {
    /// The thin form with 8 Chebyshev levels and its own totals.
    pub fn new(tissue: Tissue, texel_mm: f64) -> ConvolutionSettings {
        ConvolutionSettings {
            tissue,
            form: DipoleForm::Thin,
            levels: ThicknessLevels::default(),
            totals: TotalsSource::Form,
            texel_mm,
            tail: 1e-6,
        }
    }
}

/// Kernels of one tissue for maps of one size.
#[derive(Debug)]
pub struct Convolver {
    pub(super) settings: ConvolutionSettings,
    pub(super) grid: Grid,
    pub(super) nodes: Nodes,
    pub(super) kernels: Vec<Kernel>,
    pub(super) spectra: Vec<Spectrum>,
    /// Scattered total and unscattered share as functions of the thickness.
    totals: [Option<Curves<1>>; 2],
}

/// Convolves each image with the kernels of `thickness` (`width` × n, row by row). Where the map holds no more than
/// `levels.count` different thicknesses, each has a kernel of its own.
///
/// # Errors
/// As [`Convolver::with`]; maps of unequal size.
pub fn convolve(
    images: &[Vec<f64>],
    thickness: &[f64],
    width: usize,
    settings: &ConvolutionSettings,
) -> Result<Vec<Vec<f64>>> {
    if width == 0 || !thickness.len().is_multiple_of(width) || images.iter().any(|m| m.len() != thickness.len()) {
        return Err(Error::Usage(format!(
            "maps of unequal size: thickness has {} texels in rows of {width}",
            thickness.len()
        )));
    }
    let Some(convolver) = Convolver::for_map(settings, width, thickness)? else {
        return Ok(vec![vec![0.0; thickness.len()]; images.len()]);
    };
    Ok(convolver.run(thickness, images))
}

impl Convolver {
    /// Kernels for thicknesses from `thinnest_mm` to `thickest_mm`.
    ///
    /// # Errors
    /// A tissue, texel, level count or thickness out of range; a form for which `thinnest_mm` is too thin
    /// ([`DipoleForm::Thin`] serves every thickness).
    pub fn with(
        settings: &ConvolutionSettings,
        width: usize,
        height: usize,
        thinnest_mm: f64,
        thickest_mm: f64,
    ) -> Result<Convolver> {
        if settings.levels.count == 0 {
            return Err(Error::Usage("thickness levels: found 0; expected 1 or more".into()));
        }
        if !(thinnest_mm > 0.0 && thickest_mm >= thinnest_mm && thickest_mm.is_finite()) {
            return Err(Error::Usage(format!(
                "thickness from {thinnest_mm} to {thickest_mm} mm; expected above 0 and ascending"
            )));
        }
        let nodes = Nodes::new(settings.levels.kind, settings.levels.count, thinnest_mm, thickest_mm);
        Convolver::build(settings, width, height, nodes, [thinnest_mm, thickest_mm])
    }

    /// For one map: exact where it has few thicknesses, with levels otherwise. `None` where no texel has a thickness.
    ///
    /// # Errors
    /// As [`Convolver::with`].
    pub fn for_map(settings: &ConvolutionSettings, width: usize, thickness: &[f64]) -> Result<Option<Convolver>> {
        let height = thickness.len() / width.max(1);
        let mut distinct: Vec<f64> = Vec::new();
        let mut range = [f64::INFINITY, 0.0f64];
        for &d in thickness.iter().filter(|&&d| d > 0.0) {
            range = [range[0].min(d), range[1].max(d)];
            if distinct.len() <= settings.levels.count && !distinct.contains(&d) {
                distinct.push(d);
            }
        }
        if distinct.is_empty() {
            return Ok(None);
        }
        if distinct.len() > settings.levels.count {
            return Convolver::with(settings, width, height, range[0], range[1]).map(Some);
        }
        distinct.sort_by(f64::total_cmp);
        Convolver::build(settings, width, height, Nodes::exact(distinct), range).map(Some)
    }

    fn build(
        settings: &ConvolutionSettings,
        width: usize,
        height: usize,
        mut nodes: Nodes,
        range: [f64; 2],
    ) -> Result<Convolver> {
        let ConvolutionSettings { tissue, form, texel_mm, .. } = *settings;
        if let Some(fault) = tissue.fault() {
            return Err(Error::Usage(fault));
        }
        if width == 0 || height == 0 || !(texel_mm > 0.0 && texel_mm.is_finite()) {
            return Err(Error::Usage(format!(
                "{width} x {height} texels of {texel_mm} mm; expected a map of texels above 0 mm"
            )));
        }
        if !(settings.tail > 0.0 && settings.tail < 0.1) {
            return Err(Error::Usage(format!("kernel tail is {}; expected above 0 and below 0.1", settings.tail)));
        }
        if form != DipoleForm::Thin && !(range[0] > tissue.mean_free_path()) {
            let l = tissue.mean_free_path();
            return Err(Error::Usage(format!(
                "thickness {} mm is at most one mean free path, {l:.4} mm; use the thin form",
                range[0]
            )));
        }
        let widest = nodes.thickness.iter().map(|&d| support(&tissue, form, d, settings.tail)).fold(0.0, f64::max);
        let wanted = (widest / texel_mm).ceil().max(1.0);
        let most = width.max(height) - 1;
        let (reach, closed) = if wanted > most as f64 { (most, false) } else { (wanted as usize, true) };
        let shape = |&d: &f64| {
            let whole = scattered(&tissue, d, form);
            if whole > 0.0 {
                let [kernel] = Kernel::build(|r| [tissue.beyond(r, d, form) / whole], texel_mm, reach, closed);
                kernel
            } else {
                Kernel::delta(reach)
            }
        };
        let mut kernels: Vec<Kernel> = nodes.thickness.iter().map(shape).collect();
        if settings.levels.kind == LevelKind::Svd && kernels.len() > settings.levels.count {
            kernels = nodes.principal(&kernels, settings.levels.count);
        }
        let grid = Grid::new(width, height, reach);
        let spectra = kernels.iter().map(|k| grid.spectrum(k)).collect();
        let fit = |which: usize| {
            if range[1] > range[0] {
                Curves::fit(|d| [total_parts(settings, d)[which]], range[0], range[1])
            } else {
                None
            }
        };
        let totals = [fit(0), fit(1)];
        Ok(Convolver { settings: *settings, grid, nodes, kernels, spectra, totals })
    }

    /// Farthest texel that a texel's light reaches, along x or y.
    pub fn reach(&self) -> usize {
        self.kernels.first().map_or(0, |k| k.reach)
    }

    /// Scattered and unscattered light for one unit that enters at thickness `d` (0 where there is no tissue).
    fn parts(&self, d: f64) -> [f64; 2] {
        if !(d > 0.0) {
            return [0.0; 2];
        }
        let direct = || total_parts(&self.settings, d);
        let at = |k: usize| self.totals[k].as_ref().and_then(|c| c.at(d)).map_or_else(|| direct()[k], |[v]| v);
        [at(0), at(1)]
    }

    /// For each texel: its weight on each level, which includes its own total, and then the unscattered share.
    fn weights(&self, thickness: &[f64]) -> Vec<f64> {
        let n = self.nodes.count() + 1;
        let mut weights = vec![0.0; thickness.len() * n];
        weights.par_chunks_mut(n).zip(thickness.par_iter()).for_each(|(w, &d)| {
            if d > 0.0 {
                let [scattered, ballistic] = self.parts(d);
                self.nodes.weights(d, &mut w[..n - 1]);
                w[..n - 1].iter_mut().for_each(|w| *w *= scattered);
                w[n - 1] = ballistic;
            }
        });
        weights
    }

    pub(super) fn check(&self, maps: &[&[f64]]) {
        let texels = self.grid.width * self.grid.height;
        assert!(
            maps.iter().all(|m| m.len() == texels),
            "maps have to hold {texels} texels, as the convolver was made for"
        );
    }

    /// The light that leaves, one map for each image. `images` is what enters (per area), `thickness` is in mm. All
    /// maps are row by row, of the size given at the start.
    ///
    /// # Panics
    /// Where a map has another size.
    pub fn run(&self, thickness: &[f64], images: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let sources: Vec<(&[f64], &[f64])> = images.iter().map(|i| (thickness, i.as_slice())).collect();
        self.run_each(&sources)
    }

    /// [`Convolver::run`] for images that have a thickness map each (`(thickness, image)`), such as both sides of a
    /// leaf. Two images share a transform.
    ///
    /// # Panics
    /// Where a map has another size.
    pub fn run_each(&self, sources: &[(&[f64], &[f64])]) -> Vec<Vec<f64>> {
        sources.iter().for_each(|s| self.check(&[s.0, s.1]));
        let mut made: Vec<(&[f64], Vec<f64>)> = Vec::new();
        for s in sources {
            if !made.iter().any(|m| std::ptr::eq(m.0, s.0)) {
                made.push((s.0, self.weights(s.0)));
            }
        }
        let weights = |s: &(&[f64], &[f64])| made.iter().find(|m| std::ptr::eq(m.0, s.0)).map_or(&[][..], |m| &m.1);
        let kernels: Vec<&Spectrum> = self.spectra.iter().collect();
        let (n, width) = (kernels.len() + 1, self.grid.width);
        let mut out = Vec::with_capacity(sources.len());
        for pair in sources.chunks(2) {
            let weights: Vec<&[f64]> = pair.iter().map(weights).collect();
            let sum = self.grid.forward(&kernels, |y, rows| {
                for (which, source) in pair.iter().enumerate() {
                    for x in 0..width {
                        let at = y * width + x;
                        let light = source.1[at];
                        for (k, row) in rows.iter_mut().enumerate() {
                            let v = weights[which][at * n + k] * light;
                            if which == 0 { row[x].re = v } else { row[x].im = v }
                        }
                    }
                }
            });
            for (which, source) in pair.iter().enumerate() {
                let part = |v: &Complex<f64>| if which == 0 { v.re } else { v.im };
                out.push(
                    sum.iter()
                        .enumerate()
                        .map(|(at, v)| part(v) + weights[which][at * n + n - 1] * source.1[at])
                        .collect(),
                );
            }
        }
        out
    }

    /// The transpose of [`Convolver::run`]: Σ_o T(|x_o − x_i|, d_i) y_o A_p for each map y of the unlit side.
    ///
    /// # Panics
    /// Where a map has another size.
    pub fn adjoint(&self, thickness: &[f64], maps: &[Vec<f64>]) -> Vec<Vec<f64>> {
        self.check(&[thickness]);
        maps.iter().for_each(|m| self.check(&[m]));
        let weights = self.weights(thickness);
        let kernels: Vec<&Spectrum> = self.spectra.iter().collect();
        let (n, width) = (kernels.len() + 1, self.grid.width);
        let mut out = Vec::with_capacity(maps.len());
        for pair in maps.chunks(2) {
            let value = |at: usize| Complex::new(pair[0][at], pair.get(1).map_or(0.0, |m| m[at]));
            let sum = self.grid.backward(
                &kernels,
                |y, row| row.iter_mut().enumerate().for_each(|(x, v)| *v = value(y * width + x)),
                |y, parts| {
                    let texel = |x: usize| {
                        let at = y * width + x;
                        let stays = value(at) * weights[at * n + n - 1];
                        parts.iter().enumerate().fold(stays, |sum, (k, part)| sum + part[x] * weights[at * n + k])
                    };
                    (0..width).map(texel).collect::<Vec<_>>()
                },
            );
            let sum = sum.concat();
            out.push(sum.iter().map(|v| v.re).collect());
            if pair.len() > 1 {
                out.push(sum.iter().map(|v| v.im).collect());
            }
        }
        out
    }

    /// [`Convolver::run`] texel by texel in space, with the same kernels and weights. It is the reference for tests and
    /// takes O(texels²).
    ///
    /// # Panics
    /// Where a map has another size.
    pub fn direct(&self, thickness: &[f64], image: &[f64]) -> Vec<f64> {
        self.check(&[thickness, image]);
        let weights = self.weights(thickness);
        let n = self.kernels.len() + 1;
        let mut out = vec![0.0; image.len()];
        for (from, &light) in image.iter().enumerate() {
            let w = &weights[from * n..][..n];
            if w.iter().all(|w| *w == 0.0) {
                continue;
            }
            let (x, y) = (from % self.grid.width, from / self.grid.width);
            out[from] += w[n - 1] * light;
            for (to, out) in out.iter_mut().enumerate() {
                let (i, j) = (x.abs_diff(to % self.grid.width), y.abs_diff(to / self.grid.width));
                *out += light * (0..n - 1).map(|k| w[k] * self.kernels[k].at(i, j)).sum::<f64>();
            }
        }
        out
    }
}

#[cfg(test)]
#[path = "convolution_tests.rs"]
mod tests;
