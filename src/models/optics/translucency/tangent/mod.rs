//! The light that a leaf lets through, as in [`super::convolution`], and its derivatives by ln σa, ln σs′ and the
//! logarithm of a factor on the thickness. σa is the absorption, σs′ the reduced scattering.
//!
//! Everything that does not change with the tissue (levels, weights, transforms) is a [`TangentStage`], made once;
//! [`TangentStage::at`] gives the transport of one tissue. A factor on the thickness moves the levels too, so their
//! weights stay the same. The reach of the kernels is fixed by the stage, so cost and gradient are smooth functions of
//! the tissue. The derivatives are exact ones of the discretised model: shares of the flow and totals are Chebyshev
//! series in ln r and ln d, and a series is linear in the values it is fitted to.
//!
//! There are two ways to the same numbers. [`TransportTangent::derivative`] is the change of every image along one
//! parameter. [`TransportTangent::gradient`] is the change of a weighted sum of all images along every parameter. The
//! latter takes two transforms for each level and image, the former six for three parameters.
//! [`TransportTangent::by_thickness`] is the change of such a sum along the thickness of every texel.

mod series;
mod stage;
#[cfg(test)]
mod tests;
mod totals;

use super::fourier::Spectrum;
use mesophyll_base::fourier::Complex;
pub use stage::TangentStage;

/// The parameters: ln σa, ln σs′, and ln of the factor on the thickness.
pub const PARTIALS: usize = 3;

/// The light of one image that enters (per area), with the thickness map of the stage that it enters and the incidence
/// of the stage that it has.
#[derive(Debug, Clone, Copy)]
pub struct SourceImage<'a> {
    /// Which thickness map of the stage the light enters.
    pub map: usize,
    /// Which incidence of the stage it has.
    pub incidence: usize,
    /// The light that enters, one value for each texel, row by row.
    pub light: &'a [f64],
}

/// The transport of one tissue on a [`TangentStage`].
#[derive(Debug)]
pub struct TransportTangent<'a> {
    stage: &'a TangentStage,
    spectra: Vec<Spectrum>,
    /// For each level: the derivatives of its kernel.
    partials: Vec<[Spectrum; PARTIALS]>,
    /// For each thickness map and incidence, and each texel: the scattered total and the unscattered share, then the
    /// derivatives of both, parameter by parameter.
    parts: Vec<Vec<[f64; 2 * (PARTIALS + 1)]>>,
}

impl TransportTangent<'_> {
    fn parts_of(&self, source: &SourceImage) -> usize {
        source.map * self.stage.incidences.len() + source.incidence
    }

    /// The light that leaves, one image for each source.
    ///
    /// # Panics
    /// Where a map has another size than the stage.
    pub fn run(&self, sources: &[SourceImage]) -> Vec<Vec<f64>> {
        let kernels: Vec<&Spectrum> = self.spectra.iter().collect();
        self.sum(sources, &kernels, |w, parts, light, rows| {
            rows.iter_mut().zip(w).for_each(|(row, w)| *row = w * parts[0] * light);
            parts[1] * light
        })
    }

    /// The change of [`TransportTangent::run`] along parameter `p`.
    ///
    /// # Panics
    /// Where a map has another size than the stage.
    pub fn derivative(&self, p: usize, sources: &[SourceImage]) -> Vec<Vec<f64>> {
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

    /// Σ over images and texels of `views` times the change of [`TransportTangent::run`], for every parameter at once.
    ///
    /// # Panics
    /// Where a map has another size than the stage.
    pub fn gradient(&self, sources: &[SourceImage], views: &[Vec<f64>]) -> [f64; PARTIALS] {
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

    /// The last entry of [`TransportTangent::gradient`], texel by texel: Σ over images and their texels of `views`
    /// times the change of [`TransportTangent::run`] along ln of one texel's own thickness. The result has one map for
    /// each thickness map of the stage.
    ///
    /// # Panics
    /// Where a map has another size than the stage.
    pub fn by_thickness(&self, sources: &[SourceImage], views: &[Vec<f64>]) -> Vec<Vec<f64>> {
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
        pair: &[SourceImage],
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
        sources: &[SourceImage],
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
        let one = |source: &SourceImage, at: usize, rows: &mut [f64]| {
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
