//! The convolution's exact derivatives by the tissue (σa, σs, g) and by a factor on every thickness, as a fit needs them.
//!
//! Kernels, their levels and the texels' totals are differentiated in closed form (dual numbers through the Hankel contour), so this is the derivative of
//! what [`Convolver::run`] computes, level errors included. The levels scale with the thickness factor: a texel keeps its place between them.
//! Principal shapes ([`LevelKind::Svd`]) change with the tissue; Chebyshev nodes of the same count stand in for them here.

use super::convolve::{Convolver, Settings, Totals};
use super::fourier::Spectrum;
use super::kernel::Kernel;
use super::levels::{Curves, LevelKind};
use crate::Result;
use crate::optics::dipole::scalar::{Dual, PARTIALS};
use crate::optics::dipole::{Form, Tissue};
use crate::optics::slab;
use rayon::prelude::*;
use rustfft::num_complex::Complex;

/// Value and derivatives by σa, σs, g and ln(thickness factor).
const M: usize = PARTIALS + 1;

/// A [`Convolver`] and its derivatives by σa (mm), σs (mm), g and the thickness factor at 1.
#[derive(Debug)]
pub struct Partials {
    convolver: Convolver,
    /// By parameter, then level.
    spectra: Vec<Vec<Spectrum>>,
    totals: [Option<Curves<M>>; 2],
}

impl Partials {
    /// Arguments and errors as [`Convolver::with`].
    ///
    /// # Errors
    /// As [`Convolver::with`].
    pub fn with(settings: &Settings, width: usize, height: usize, thinnest_mm: f64, thickest_mm: f64) -> Result<Partials> {
        let mut settings = *settings;
        if settings.levels.kind == LevelKind::Svd {
            settings.levels.kind = LevelKind::Chebyshev;
        }
        Ok(Partials::of(Convolver::with(&settings, width, height, thinnest_mm, thickest_mm)?))
    }

    /// For one map, as [`Convolver::for_map`] makes it: exact where it holds few thicknesses.
    ///
    /// # Errors
    /// As [`Convolver::with`].
    pub fn for_map(settings: &Settings, width: usize, thickness: &[f64]) -> Result<Option<Partials>> {
        let mut settings = *settings;
        if settings.levels.kind == LevelKind::Svd {
            settings.levels.kind = LevelKind::Chebyshev;
        }
        Ok(Convolver::for_map(&settings, width, thickness)?.map(Partials::of))
    }

    fn of(convolver: Convolver) -> Partials {
        let settings = &convolver.settings;
        let Settings { tissue, form, texel_mm, .. } = *settings;
        let (reach, closed) = (convolver.reach(), convolver.closed);
        let mut spectra: Vec<Vec<Spectrum>> = vec![Vec::new(); PARTIALS];
        for &d in &convolver.nodes.thickness {
            let whole = tissue.beyond_with_partials(0.0, d, form);
            let shape = |r: f64| components(tissue.beyond_with_partials(r, d, form) / whole);
            let kernels: [Kernel; M] = if whole.value > 0.0 {
                Kernel::build(shape, texel_mm, reach, closed)
            } else {
                std::array::from_fn(|_| Kernel::none(reach))
            };
            for (of, kernel) in spectra.iter_mut().zip(&kernels[1..]) {
                of.push(convolver.grid.spectrum(kernel));
            }
        }
        let [low, high] = convolver.range;
        let fit = |which: usize| if high > low { Curves::fit(|d| components(totals(settings, d)[which]), low, high) } else { None };
        let totals = [fit(0), fit(1)];
        Partials { spectra, totals, convolver }
    }

    /// The convolution itself.
    pub fn convolver(&self) -> &Convolver {
        &self.convolver
    }

    /// Per texel: weights of its shape on the levels, then scattered total and unscattered share, each with its derivatives.
    fn weights(&self, thickness: &[f64]) -> Vec<f64> {
        let levels = self.convolver.nodes.count();
        let n = levels + 2 * M;
        let mut weights = vec![0.0; thickness.len() * n];
        weights.par_chunks_mut(n).zip(thickness.par_iter()).for_each(|(w, &d)| {
            if d > 0.0 {
                self.convolver.nodes.weights(d, &mut w[..levels]);
                for k in 0..2 {
                    let direct = || components(totals(&self.convolver.settings, d)[k]);
                    let parts = self.totals[k].as_ref().and_then(|c| c.at(d)).unwrap_or_else(direct);
                    w[levels + k * M..][..M].copy_from_slice(&parts);
                }
            }
        });
        weights
    }

    /// One image convolved, and its derivatives.
    ///
    /// # Panics
    /// Where a map has another size.
    pub fn run(&self, thickness: &[f64], image: &[f64]) -> (Vec<f64>, [Vec<f64>; PARTIALS]) {
        self.convolver.check(&[thickness, image]);
        let weights = self.weights(thickness);
        let (levels, width) = (self.convolver.nodes.count(), self.convolver.grid.width);
        let n = levels + 2 * M;
        let of = |at: usize, k: usize| weights[at * n + k];
        let shapes: Vec<&Spectrum> = self.convolver.spectra.iter().collect();
        // Kernels as they are, totals differentiated: two parameters a transform.
        let mut maps: Vec<Vec<f64>> = Vec::with_capacity(M);
        for m in (0..M).step_by(2) {
            let sum = self.convolver.grid.forward(&shapes, |y, rows| {
                for x in 0..width {
                    let at = y * width + x;
                    let second = if m + 1 < M { of(at, levels + m + 1) } else { 0.0 };
                    let light = Complex::new(of(at, levels + m), second) * image[at];
                    for (k, row) in rows.iter_mut().enumerate() {
                        row[x] = light * of(at, k);
                    }
                }
            });
            maps.push(sum.iter().map(|v| v.re).collect());
            if m + 1 < M {
                maps.push(sum.iter().map(|v| v.im).collect());
            }
        }
        // Kernels differentiated, totals as they are.
        for (p, spectra) in self.spectra.iter().enumerate() {
            let kernels: Vec<&Spectrum> = spectra.iter().collect();
            let sum = self.convolver.grid.forward(&kernels, |y, rows| {
                for x in 0..width {
                    let at = y * width + x;
                    for (k, row) in rows.iter_mut().enumerate() {
                        row[x].re = of(at, k) * of(at, levels) * image[at];
                    }
                }
            });
            maps[p + 1].iter_mut().zip(&sum).for_each(|(map, v)| *map += v.re);
        }
        for (m, map) in maps.iter_mut().enumerate() {
            map.iter_mut().enumerate().for_each(|(at, v)| *v += of(at, levels + M + m) * image[at]);
        }
        let mut maps = maps.into_iter();
        (maps.next().unwrap_or_default(), std::array::from_fn(|_| maps.next().unwrap_or_default()))
    }

    /// Σ_m ⟨view_m, ∂(image_m convolved)/∂parameter⟩ by the transpose: the gradient of a sum of squares, given its residuals as views. One transform of
    /// each pair of views instead of one of every derivative.
    ///
    /// # Panics
    /// Where a map has another size, or the numbers of images and views differ.
    pub fn gradient(&self, thickness: &[f64], images: &[Vec<f64>], views: &[Vec<f64>]) -> [f64; PARTIALS] {
        self.convolver.check(&[thickness]);
        images.iter().chain(views).for_each(|m| self.convolver.check(&[m]));
        assert_eq!(images.len(), views.len(), "an image a view");
        let weights = self.weights(thickness);
        let (levels, width) = (self.convolver.nodes.count(), self.convolver.grid.width);
        let n = levels + 2 * M;
        let of = |at: usize, k: usize| weights[at * n + k];
        let kernels: Vec<&Spectrum> = self.convolver.spectra.iter().chain(self.spectra.iter().flatten()).collect();
        let mut gradient = [0.0; PARTIALS];
        for (images, views) in images.chunks(2).zip(views.chunks(2)) {
            let value = |at: usize| Complex::new(views[0][at], views.get(1).map_or(0.0, |m| m[at]));
            let rows = self.convolver.grid.backward(
                &kernels,
                |y, row| row.iter_mut().enumerate().for_each(|(x, v)| *v = value(y * width + x)),
                |y, parts| {
                    let mut row = [0.0; PARTIALS];
                    for x in 0..width {
                        let at = y * width + x;
                        let light = [images[0][at], images.get(1).map_or(0.0, |m| m[at])];
                        let blend = |from: usize| (0..levels).fold(Complex::new(0.0, 0.0), |sum, k| sum + parts[from + k][x] * of(at, k));
                        let shape = blend(0);
                        for p in 0..PARTIALS {
                            let back = shape * of(at, levels + 1 + p)
                                + blend((p + 1) * levels) * of(at, levels)
                                + value(at) * of(at, levels + M + 1 + p);
                            row[p] += back.re * light[0] + back.im * light[1];
                        }
                    }
                    row
                },
            );
            rows.iter().for_each(|row| gradient.iter_mut().zip(row).for_each(|(g, r)| *g += r));
        }
        gradient
    }
}

fn components(v: Dual<f64>) -> [f64; M] {
    std::array::from_fn(|m| if m == 0 { v.value } else { v.by[m - 1] })
}

/// Scattered total and unscattered share with their derivatives.
fn totals(settings: &Settings, d: f64) -> [Dual<f64>; 2] {
    let Settings { tissue, form, .. } = settings;
    let parts = [tissue.beyond_with_partials(0.0, d, *form), ballistic(tissue, d, *form)];
    if settings.totals == Totals::Form {
        return parts;
    }
    let (at, by) = slab::response_with_partials(tissue.sigma_a, tissue.reduced_scattering(), d);
    let reduced = by.sigma_s.rho_t;
    let wanted =
        Dual { value: at.rho_t, by: [by.sigma_a.rho_t, (1.0 - tissue.g) * reduced, -tissue.sigma_s * reduced, d * by.thickness.rho_t] };
    let whole = parts[0] + parts[1];
    if whole.value > 0.0 { parts.map(|p| p * wanted / whole) } else { [Dual { value: 0.0, by: [0.0; PARTIALS] }, wanted] }
}

fn ballistic(tissue: &Tissue, d: f64, form: Form) -> Dual<f64> {
    let e = tissue.ballistic(d, form);
    Dual { value: e, by: [-d * e, -d * (1.0 - tissue.g) * e, d * tissue.sigma_s * e, -d * tissue.reduced_extinction() * e] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    fn noise(seed: u64, n: usize, low: f64, high: f64) -> Vec<f64> {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
        (0..n).map(|_| low + (high - low) * rng.random::<f64>()).collect()
    }

    fn moved(settings: &Settings, k: usize, e: f64) -> (Settings, f64) {
        let (mut s, mut factor) = (*settings, 1.0);
        match k {
            0 => s.tissue.sigma_a += e,
            1 => s.tissue.sigma_s += e,
            2 => s.tissue.g += e,
            _ => factor += e,
        }
        (s, factor)
    }

    #[test]
    fn derivatives_are_those_of_the_convolution() {
        let (width, height) = (17, 13);
        let n = width * height;
        let (mut thickness, image) = (noise(1, n, 0.15, 0.4), noise(2, n, 0.0, 1.0));
        thickness[30] = 0.0;
        for (form, totals_from) in
            [(Form::Thin, Totals::Form), (Form::Thin, Totals::Transport), (Form::Images, Totals::Form), (Form::Dipoles(3), Totals::Form)]
        {
            let settings = Settings { form, totals: totals_from, ..Settings::new(Tissue { a: 1.3, ..Tissue::TABLE }, 0.08) };
            let partials = Partials::with(&settings, width, height, 0.15, 0.4).unwrap();
            let (value, by) = partials.run(&thickness, &image);
            let plain = partials.convolver().run(&thickness, std::slice::from_ref(&image)).remove(0);
            let size = plain.iter().fold(0.0f64, |m, v| m.max(*v));
            assert!(value.iter().zip(&plain).all(|(a, b)| (a - b).abs() < 1e-10 * size));
            for k in 0..PARTIALS {
                let e = 1e-4;
                let at = |e: f64| {
                    let (s, factor) = moved(&settings, k, e);
                    let convolver = Convolver::with(&s, width, height, 0.15 * factor, 0.4 * factor).unwrap();
                    let scaled: Vec<f64> = thickness.iter().map(|d| d * factor).collect();
                    convolver.run(&scaled, std::slice::from_ref(&image)).remove(0)
                };
                let (high, low) = (at(e), at(-e));
                let largest = by[k].iter().fold(0.0f64, |m, v| m.max(v.abs()));
                for i in 0..n {
                    let want = (high[i] - low[i]) / (2.0 * e);
                    assert!(
                        (by[k][i] - want).abs() < 1e-5 * largest,
                        "{form:?} {totals_from:?} parameter {k} texel {i}: {} {want}",
                        by[k][i]
                    );
                }
            }
            // The gradient by the transpose is the same derivative, summed.
            let views = [noise(3, n, -1.0, 1.0), noise(4, n, -1.0, 1.0), noise(5, n, -1.0, 1.0)];
            let images = [image.clone(), noise(6, n, 0.0, 1.0), noise(7, n, 0.0, 1.0)];
            let gradient = partials.gradient(&thickness, &images, &views);
            let mut want = [0.0; PARTIALS];
            for (image, view) in images.iter().zip(&views) {
                let (_, by) = partials.run(&thickness, image);
                (0..PARTIALS).for_each(|k| want[k] += by[k].iter().zip(view).map(|(a, b)| a * b).sum::<f64>());
            }
            for k in 0..PARTIALS {
                assert!((gradient[k] - want[k]).abs() < 1e-9 * (want[k].abs() + 1e-3), "{form:?} {k}: {gradient:?} {want:?}");
            }
        }
    }

    #[test]
    fn few_thicknesses_have_kernels_that_move_along() {
        let thickness: Vec<f64> = (0..63).map(|k| [0.03, 0.2][k % 2]).collect();
        let image = noise(2, 63, 0.0, 1.0);
        let settings = Settings::new(Tissue { sigma_a: 0.0, ..Tissue::TABLE }, 0.05);
        let partials = Partials::for_map(&settings, 9, &thickness).unwrap().unwrap();
        let (_, by) = partials.run(&thickness, &image);
        for (k, e, sides) in [(0, 1e-5, 1.0), (1, 1e-4, 2.0), (3, 1e-5, 2.0)] {
            let at = |e: f64| {
                let (s, factor) = moved(&settings, k, e);
                let scaled: Vec<f64> = thickness.iter().map(|d| d * factor).collect();
                super::super::convolve::convolve(std::slice::from_ref(&image), &scaled, 9, &s).unwrap().remove(0)
            };
            // σa cannot go below 0: a one-sided difference there.
            let (high, low) = (at(e), at(if sides == 1.0 { 0.0 } else { -e }));
            let largest = by[k].iter().fold(0.0f64, |m, v| m.max(v.abs()));
            for i in 0..63 {
                let want = (high[i] - low[i]) / (sides * e);
                assert!((by[k][i] - want).abs() < 1e-4 * largest, "parameter {k} texel {i}: {} {want}", by[k][i]);
            }
        }
    }
}
