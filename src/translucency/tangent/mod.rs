//! The light that a leaf lets through, as in [`super::convolve`], and its derivatives by ln σa, ln σs′ and the
//! logarithm of a factor on the thickness. σa is the absorption, σs′ the reduced scattering.
//!
//! Everything that does not change with the tissue (levels, weights, transforms) is a [`Stage`], made once;
//! [`Stage::at`] gives the transport of one tissue. A factor on the thickness moves the levels too, so their weights
//! stay the same. The reach of the kernels is fixed by the stage, so cost and gradient are smooth functions of the
//! tissue. The derivatives are exact ones of the discretised model: shares of the flow and totals are Chebyshev series
//! in ln r and ln d, and a series is linear in the values it is fitted to.
//!
//! There are two ways to the same numbers. [`Tangent::derivative`] is the change of every image along one parameter.
//! [`Tangent::gradient`] is the change of a weighted sum of all images along every parameter. The latter takes two
//! transforms for each level and image, the former six for three parameters. [`Tangent::by_thickness`] is the change of
//! such a sum along the thickness of every texel.

mod series;
#[cfg(test)]
mod tests;
mod totals;

use super::convolve::Totals;
use super::fourier::{Grid, Spectrum};
use super::kernel::Kernel;
use super::levels::{Levels, Nodes};
use mesophyll_error::{Error, Result};
use mesophyll_fourier::Complex;
use mesophyll_optics::dipole::{Form, Tissue, scalar::Dual};
use rayon::prelude::*;
use series::Series;
use std::f64::consts::PI;
use totals::{Slant, logarithms};

/// The parameters: ln σa, ln σs′, and ln of the factor on the thickness.
pub const PARTIALS: usize = 3;

/// The light of one image that enters (per area), with the thickness map of the stage that it enters and the incidence
/// of the stage that it has.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// Which thickness map of the stage the light enters.
    pub map: usize,
    /// Which incidence of the stage it has.
    pub incidence: usize,
    /// The light that enters, one value for each texel, row by row.
    pub light: &'a [f64],
}

/// Maps and levels of a leaf, in which the tissue may change.
#[derive(Debug)]
pub struct Stage {
    grid: Grid,
    texel_mm: f64,
    reach: usize,
    closed: bool,
    nodes: Nodes,
    range: [f64; 2],
    /// Thickness maps in mm, row by row, each in the columns of its own side.
    thickness: Vec<Vec<f64>>,
    /// For each thickness map: the weights of each level, texel by texel.
    weights: Vec<Vec<f64>>,
    /// Cosines of the angles between light and blade normal for which totals are computed; 1 is along the normal.
    incidences: Vec<f64>,
}

/// The transport of one tissue on a [`Stage`].
#[derive(Debug)]
pub struct Tangent<'a> {
    stage: &'a Stage,
    spectra: Vec<Spectrum>,
    /// For each level: the derivatives of its kernel.
    partials: Vec<[Spectrum; PARTIALS]>,
    /// For each thickness map and incidence, and each texel: the scattered total and the unscattered share, then the
    /// derivatives of both, parameter by parameter.
    parts: Vec<Vec<[f64; 2 * (PARTIALS + 1)]>>,
}

impl Stage {
    /// For maps of `width` × n texels of `texel_mm`. `thickness` (mm) is given for each lit side in its own columns; it
    /// is 0 or NaN where there is no tissue. Kernels end at `reach_mm` (at least one texel, at most the map), where the
    /// outermost texels take the remaining light. `incidences` are cosines (0 to 1) of the lights to the blade's
    /// normal. With [`Totals::Transport`] the total is that of a beam with this incidence, but the light spreads like
    /// that of a beam along the normal.
    ///
    /// # Errors
    /// Maps of unequal size, no texel with a thickness, no level, a texel that is not positive, a cosine out of range.
    pub fn new(
        width: usize,
        texel_mm: f64,
        thickness: Vec<Vec<f64>>,
        incidences: &[f64],
        levels: Levels,
        reach_mm: f64,
    ) -> Result<Stage> {
        if incidences.is_empty() || !incidences.iter().all(|mu| *mu > 0.0 && *mu <= 1.0) {
            return Err(Error::Usage(format!(
                "cosines of incidence {incidences:?}; expected some above 0 and at most 1"
            )));
        }
        let texels = thickness.first().map_or(0, Vec::len);
        if width == 0 || texels == 0 || !texels.is_multiple_of(width) || thickness.iter().any(|t| t.len() != texels) {
            return Err(Error::Usage(format!(
                "thickness maps of {texels} texels in rows of {width}; expected maps of one size"
            )));
        }
        if !(texel_mm > 0.0 && texel_mm.is_finite() && reach_mm > 0.0) || levels.count == 0 {
            let count = levels.count;
            return Err(Error::Usage(format!(
                "texels of {texel_mm} mm, reach {reach_mm} mm, {count} levels; expected numbers above 0"
            )));
        }
        let mut distinct: Vec<f64> = Vec::new();
        let mut range = [f64::INFINITY, 0.0f64];
        for &d in thickness.iter().flatten().filter(|&&d| d > 0.0 && d.is_finite()) {
            range = [range[0].min(d), range[1].max(d)];
            if distinct.len() <= levels.count && !distinct.contains(&d) {
                distinct.push(d);
            }
        }
        let nodes = match distinct.len() {
            0 => return Err(Error::Usage("no texel of the leaf has a thickness".into())),
            n if n <= levels.count => {
                distinct.sort_by(f64::total_cmp);
                Nodes::exact(distinct)
            }
            _ => Nodes::new(levels.kind, levels.count, range[0], range[1]),
        };
        let height = texels / width;
        let most = width.max(height) - 1;
        let wanted = (reach_mm / texel_mm).ceil().max(1.0);
        let (reach, closed) = if wanted > most as f64 { (most, false) } else { (wanted as usize, true) };
        let count = nodes.thickness.len();
        let weights = thickness.iter().map(|map| {
            let mut weights = vec![0.0; texels * count];
            weights
                .par_chunks_mut(count)
                .zip(map.par_iter())
                .filter(|(_, d)| **d > 0.0)
                .for_each(|(w, d)| nodes.weights(*d, w));
            weights
        });
        Ok(Stage {
            weights: weights.collect(),
            grid: Grid::new(width, height, reach),
            texel_mm,
            reach,
            closed,
            nodes,
            range,
            thickness,
            incidences: incidences.to_vec(),
        })
    }

    /// Largest distance (mm) that kernels span, and whether it is less than the whole map.
    pub fn reach_mm(&self) -> (f64, bool) {
        (self.reach as f64 * self.texel_mm, self.closed)
    }

    /// The transport of `tissue`, with every thickness multiplied by `factor`, in the thin form.
    ///
    /// # Errors
    /// A tissue or factor out of range, or so opaque that no light is left to compute with.
    pub fn at(&self, tissue: &Tissue, totals: Totals, factor: f64) -> Result<Tangent<'_>> {
        if let Some(fault) = tissue.fault() {
            return Err(Error::Usage(fault));
        }
        if !(tissue.sigma_a > 0.0 && tissue.sigma_s > 0.0 && factor > 0.0 && factor.is_finite()) {
            let Tissue { sigma_a, sigma_s, .. } = tissue;
            return Err(Error::Usage(format!(
                "sigma_a {sigma_a}, sigma_s {sigma_s}, thickness factor {factor}; expected above 0 for logarithms"
            )));
        }
        let opaque = || Error::Usage(format!("{tissue:?} lets no light through {} mm", factor * self.range[1]));
        let made: Option<Vec<[Kernel; PARTIALS + 1]>> =
            self.nodes.thickness.par_iter().map(|d| self.kernel(tissue, factor * d)).collect();
        let mut spectra = Vec::new();
        let mut partials = Vec::new();
        for kernels in &made.ok_or_else(opaque)? {
            let [value, by_a, by_s, by_d] = kernels;
            spectra.push(self.grid.spectrum(value));
            partials.push([by_a, by_s, by_d].map(|k| self.grid.spectrum(k)));
        }
        let mut curves = Vec::new();
        for mu in &self.incidences {
            let slant = (totals == Totals::Transport && *mu != 1.0).then(|| Slant::new(tissue, *mu));
            let curve = Series::fit(
                |d| logarithms(tissue, totals, slant.as_ref(), factor * d),
                self.range[0],
                self.range[1],
                24,
            );
            if !curve.coefficients.iter().flatten().all(|v| v.is_finite()) {
                return Err(opaque());
            }
            curves.push(curve);
        }
        let texel = |curve: &Series<{ 2 * (PARTIALS + 1) }>, d: f64| {
            let mut parts = [0.0; 2 * (PARTIALS + 1)];
            if d > 0.0 {
                let log = curve.at(d);
                for which in 0..2 {
                    parts[which] = log[which].exp();
                    (1..=PARTIALS).for_each(|p| parts[2 * p + which] = parts[which] * log[2 * p + which]);
                }
            }
            parts
        };
        let each = self.thickness.iter().flat_map(|map| curves.iter().map(move |curve| (map, curve)));
        let parts = each.map(|(map, curve)| map.par_iter().map(|d| texel(curve, *d)).collect()).collect();
        Ok(Tangent { stage: self, spectra, partials, parts })
    }

    /// The shape (sum 1) for one thickness, and its derivatives.
    fn kernel(&self, tissue: &Tissue, d: f64) -> Option<[Kernel; PARTIALS + 1]> {
        let whole = tissue.beyond_with_partials(0.0, d, Form::Thin);
        if !(whole.value > 0.0) {
            return None;
        }
        let by = |v: &Dual<f64>| [tissue.sigma_a * v.by[0], tissue.sigma_s * v.by[1], v.by[3]];
        let whole_by = by(&whole);
        let (low, high) = (0.499 * self.texel_mm, std::f64::consts::SQRT_2 * (self.reach as f64 + 1.0) * self.texel_mm);
        // ln of the share. Its nearest singularity is at r = ± i d, a quarter turn off the axis of ln r.
        let half = 0.5 * (high / low).ln();
        let height = 0.5 * PI / half;
        let count = (20.0 / (height + height.hypot(1.0)).ln()).ceil().clamp(12.0, 200.0) as usize;
        let share = |r: f64| {
            let g = tissue.beyond_with_partials(r, d, Form::Thin);
            // A value that has underflowed stays constant.
            if !(g.value > 1e-290 * whole.value) {
                return [-667.0, 0.0, 0.0, 0.0];
            }
            let g_by = by(&g);
            let change = |k: usize| g_by[k] / g.value - whole_by[k] / whole.value;
            [(g.value / whole.value).ln(), change(0), change(1), change(2)]
        };
        let curve = Series::fit(share, low, high, count);
        if !curve.coefficients.iter().flatten().all(|v| v.is_finite()) {
            return None;
        }
        let flow = |r: f64| {
            let [log, a, s, d] = curve.at(r);
            let g = log.exp();
            [g, g * a, g * s, g * d]
        };
        Some(Kernel::build(flow, self.texel_mm, self.reach, self.closed))
    }
}

impl Tangent<'_> {
    fn parts_of(&self, source: &Source) -> usize {
        source.map * self.stage.incidences.len() + source.incidence
    }

    /// The light that leaves, one image for each source.
    ///
    /// # Panics
    /// Where a map has another size than the stage.
    pub fn run(&self, sources: &[Source]) -> Vec<Vec<f64>> {
        let kernels: Vec<&Spectrum> = self.spectra.iter().collect();
        self.sum(sources, &kernels, |w, parts, light, rows| {
            rows.iter_mut().zip(w).for_each(|(row, w)| *row = w * parts[0] * light);
            parts[1] * light
        })
    }

    /// The change of [`Tangent::run`] along parameter `p`.
    ///
    /// # Panics
    /// Where a map has another size than the stage.
    pub fn derivative(&self, p: usize, sources: &[Source]) -> Vec<Vec<f64>> {
        let kernels: Vec<&Spectrum> = self.partials.iter().map(|s| &s[p]).chain(&self.spectra).collect();
        let n = self.spectra.len();
        self.sum(sources, &kernels, |w, parts, light, rows| {
            for (k, w) in w.iter().enumerate() {
                rows[k] = w * parts[0] * light;
                rows[n + k] = w * parts[2 * (p + 1)] * light;
            }
            parts[2 * p + 3] * light
        })
    }

    /// Σ over images and texels of `views` times the change of [`Tangent::run`], for every parameter at once.
    ///
    /// # Panics
    /// Where a map has another size than the stage.
    pub fn gradient(&self, sources: &[Source], views: &[Vec<f64>]) -> [f64; PARTIALS] {
        let stage = self.stage;
        let (n, width) = (self.spectra.len(), stage.grid.width);
        let kernels: Vec<&Spectrum> = self.spectra.iter().collect();
        let mut gradient = [0.0; PARTIALS];
        let mut counts: Vec<Vec<f64>> = Vec::new();
        for (pair, views) in sources.chunks(2).zip(views.chunks(2)) {
            let view = both(views, width);
            let fill = |y: usize, rows: &mut [&mut [Complex<f64>]]| {
                for (which, source) in pair.iter().enumerate() {
                    for x in 0..width {
                        let at = y * width + x;
                        let light = self.parts[self.parts_of(source)][at][0] * source.light[at];
                        for (row, w) in rows.iter_mut().zip(&stage.weights[source.map][at * n..][..n]) {
                            if which == 0 { row[x].re = w * light } else { row[x].im = w * light }
                        }
                    }
                }
            };
            let found = stage.grid.correlate(n, fill, &view);
            if counts.is_empty() {
                counts = found;
            } else {
                counts.iter_mut().zip(&found).for_each(|(a, b)| a.iter_mut().zip(b).for_each(|(a, b)| *a += b));
            }
            let worth = self.worth(&kernels, pair, &view);
            for (which, (source, view)) in pair.iter().zip(views).enumerate() {
                for (at, worth) in worth.iter().enumerate() {
                    let (parts, light) = (&self.parts[self.parts_of(source)][at], source.light[at]);
                    let worth = if which == 0 { worth.re } else { worth.im };
                    for (p, g) in gradient.iter_mut().enumerate() {
                        *g += light * (parts[2 * p + 2] * worth + parts[2 * p + 3] * view[at]);
                    }
                }
            }
        }
        for (counts, partials) in counts.iter().zip(&self.partials) {
            gradient.iter_mut().zip(partials).for_each(|(g, spectrum)| *g += spectrum.dot(counts));
        }
        gradient
    }

    /// The last entry of [`Tangent::gradient`], texel by texel: Σ over images and their texels of `views` times the
    /// change of [`Tangent::run`] along ln of one texel's own thickness. The result has one map for each thickness map
    /// of the stage.
    ///
    /// # Panics
    /// Where a map has another size than the stage.
    pub fn by_thickness(&self, sources: &[Source], views: &[Vec<f64>]) -> Vec<Vec<f64>> {
        const LAST: usize = PARTIALS - 1;
        let stage = self.stage;
        let kernels: Vec<&Spectrum> = self.spectra.iter().collect();
        let wider: Vec<&Spectrum> = self.partials.iter().map(|partials| &partials[LAST]).collect();
        let mut out: Vec<Vec<f64>> = stage.thickness.iter().map(|map| vec![0.0; map.len()]).collect();
        for (pair, views) in sources.chunks(2).zip(views.chunks(2)) {
            let view = both(views, stage.grid.width);
            let (worth, widened) = (self.worth(&kernels, pair, &view), self.worth(&wider, pair, &view));
            for (which, (source, view)) in pair.iter().zip(views).enumerate() {
                let part = |v: &Complex<f64>| if which == 0 { v.re } else { v.im };
                for (at, out) in out[source.map].iter_mut().enumerate() {
                    let parts = &self.parts[self.parts_of(source)][at];
                    let scattered = parts[2 * LAST + 2] * part(&worth[at]) + parts[0] * part(&widened[at]);
                    *out += source.light[at] * (scattered + parts[2 * LAST + 3] * view[at]);
                }
            }
        }
        out
    }

    /// How much a texel's whole scattered light, spread by `kernels` (one for each level), would add to Σ view · image.
    /// Real and imaginary part belong to the first and the second source of the pair.
    fn worth(
        &self,
        kernels: &[&Spectrum],
        pair: &[Source],
        view: &(impl Fn(usize, &mut [Complex<f64>]) + Sync),
    ) -> Vec<Complex<f64>> {
        let stage = self.stage;
        let (n, width) = (kernels.len(), stage.grid.width);
        let rows = stage.grid.backward(kernels, view, |y, parts| -> Vec<Complex<f64>> {
            let weight =
                |which: usize, at: usize, k: usize| pair.get(which).map_or(0.0, |s| stage.weights[s.map][at * n + k]);
            let texel = |x: usize| {
                let at = y * width + x;
                let re = (0..n).map(|k| weight(0, at, k) * parts[k][x].re).sum();
                Complex::new(re, (0..n).map(|k| weight(1, at, k) * parts[k][x].im).sum())
            };
            (0..width).map(texel).collect()
        });
        rows.concat()
    }

    /// Σ_k kernel_k ∗ row_k plus the light that stays in its texel. `texel(weights, parts, light, rows)` writes the
    /// values of the rows and returns what stays.
    fn sum(
        &self,
        sources: &[Source],
        kernels: &[&Spectrum],
        texel: impl Fn(&[f64], &[f64; 2 * (PARTIALS + 1)], f64, &mut [f64]) -> f64 + Sync,
    ) -> Vec<Vec<f64>> {
        let stage = self.stage;
        let (n, width) = (self.spectra.len(), stage.grid.width);
        let texels = width * stage.grid.height;
        assert!(
            sources.iter().all(|s| s.light.len() == texels),
            "sources have to hold {texels} texels, as the stage was made for"
        );
        let one = |source: &Source, at: usize, rows: &mut [f64]| {
            texel(
                &stage.weights[source.map][at * n..][..n],
                &self.parts[self.parts_of(source)][at],
                source.light[at],
                rows,
            )
        };
        let mut out = Vec::with_capacity(sources.len());
        for pair in sources.chunks(2) {
            let sum = stage.grid.forward(kernels, |y, rows| {
                let mut values = vec![0.0; rows.len()];
                for (which, source) in pair.iter().enumerate() {
                    for x in 0..width {
                        one(source, y * width + x, &mut values);
                        for (row, v) in rows.iter_mut().zip(&values) {
                            if which == 0 { row[x].re = *v } else { row[x].im = *v }
                        }
                    }
                }
            });
            for (which, source) in pair.iter().enumerate() {
                let mut values = vec![0.0; kernels.len()];
                let image = sum
                    .iter()
                    .enumerate()
                    .map(|(at, v)| if which == 0 { v.re } else { v.im } + one(source, at, &mut values));
                out.push(image.collect());
            }
        }
        out
    }
}

/// Writes a row of one or two real maps as real and imaginary part.
fn both(views: &[Vec<f64>], width: usize) -> impl Fn(usize, &mut [Complex<f64>]) + Sync {
    move |y, row| {
        for (x, v) in row.iter_mut().enumerate() {
            *v = Complex::new(views[0][y * width + x], views.get(1).map_or(0.0, |m| m[y * width + x]));
        }
    }
}
