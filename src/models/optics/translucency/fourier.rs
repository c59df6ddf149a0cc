//! Real maps convolved with real, even kernels by padded two-dimensional FFTs; each complex transform carries two maps.
//!
//! Rows come first, then columns in blocks that stay in the cache. A map's transform is multiplied and summed while its
//! column is in the cache. The spectrum of a kernel that is even along both axes is real and even. So only a quarter of
//! it is stored, and the two maps of a transform never have to be separated.

use super::kernel::Kernel;
use mesophyll_base::fourier::{Complex, FourierTransform, forward, inverse};
use rayon::prelude::*;

/// Columns taken at a time.
const BLOCK: usize = 8;

type C = Complex<f64>;
const ZERO: C = C::new(0.0, 0.0);

/// Transforms for maps of one size and kernels up to one reach.
#[derive(Clone)]
pub(crate) struct Grid {
    pub width: usize,
    pub height: usize,
    /// Padded sizes, chosen so that nothing that leaves the map on one side comes back on the other.
    columns: usize,
    rows: usize,
    along: [FourierTransform; 2],
    down: [FourierTransform; 2],
}

impl std::fmt::Debug for Grid {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Grid {}×{} in {}×{}", self.width, self.height, self.columns, self.rows)
    }
}

/// The smallest even number ≥ n whose only prime factors are 2, 3, 5 and 7.
pub(crate) fn smooth_size(n: usize) -> usize {
    let smooth = |mut m: usize| {
        for p in [2, 3, 5, 7] {
            while m.is_multiple_of(p) {
                m /= p;
            }
        }
        m == 1
    };
    (n.max(2)..).find(|&m| m.is_multiple_of(2) && smooth(m)).unwrap_or(n)
}

/// A quarter of a kernel's spectrum: `values[column * (rows/2 + 1) + row]`.
#[derive(Debug, Clone)]
pub(crate) struct Spectrum {
    values: Vec<f64>,
}

impl Spectrum {
    /// Σ of the stored values times `counts`, as [`Grid::correlate`] gives them.
    pub fn dot(&self, counts: &[f64]) -> f64 {
        self.values.iter().zip(counts).map(|(a, b)| a * b).sum()
    }
}

impl Grid {
    pub fn new(width: usize, height: usize, reach: usize) -> Grid {
        let columns = smooth_size(width + reach.min(width - 1));
        let rows = smooth_size(height + reach.min(height - 1));
        let along = [forward(columns), inverse(columns)];
        let down = [forward(rows), inverse(rows)];
        Grid { width, height, columns, rows, along, down }
    }

    /// Spectrum of a kernel, cropped to the offsets that can occur.
    pub fn spectrum(&self, kernel: &Kernel) -> Spectrum {
        let (right, bottom) = (kernel.reach.min(self.width - 1), kernel.reach.min(self.height - 1));
        let (half, tall) = (self.columns / 2 + 1, self.rows / 2 + 1);
        // Rows, two in one transform: both are even, so both spectra are real.
        let mut lines = vec![0.0; (bottom + 2) * half];
        lines.par_chunks_mut(2 * half).enumerate().for_each(|(pair, out)| {
            let mut buffer = vec![ZERO; self.columns];
            for i in 0..=right {
                let second = if 2 * pair < bottom { kernel.at(i, 2 * pair + 1) } else { 0.0 };
                buffer[i] = C::new(kernel.at(i, 2 * pair), second);
                buffer[(self.columns - i) % self.columns] = buffer[i];
            }
            self.along[0].process(&mut buffer);
            for f in 0..half {
                out[f] = buffer[f].re;
                if out.len() > half {
                    out[half + f] = buffer[f].im;
                }
            }
        });
        let mut values = vec![0.0; half * tall];
        values.par_chunks_mut(2 * tall).enumerate().for_each(|(pair, out)| {
            let mut buffer = vec![ZERO; self.rows];
            let two = out.len() > tall;
            for j in 0..=bottom {
                let at = |f: usize| lines[j * half + f];
                buffer[j] = C::new(at(2 * pair), if two { at(2 * pair + 1) } else { 0.0 });
                buffer[(self.rows - j) % self.rows] = buffer[j];
            }
            self.down[0].process(&mut buffer);
            for q in 0..tall {
                out[q] = buffer[q].re;
                if two {
                    out[tall + q] = buffer[q].im;
                }
            }
        });
        Spectrum { values }
    }

    /// Σ_k kernel_k ∗ source_k for two maps. `fill(y, k, row)` writes them as real and imaginary part of row y (`width`
    /// values, which are zero before).
    pub fn forward(&self, kernels: &[&Spectrum], fill: impl Fn(usize, &mut [&mut [C]]) + Sync) -> Vec<C> {
        let (count, tall) = (kernels.len(), self.rows / 2 + 1);
        let mut lines = vec![ZERO; self.height * count * self.columns];
        lines.par_chunks_mut(count * self.columns).enumerate().for_each_init(
            || vec![ZERO; self.along[0].get_inplace_scratch_len()],
            |scratch, (y, line)| {
                let mut parts: Vec<&mut [C]> =
                    line.chunks_mut(self.columns).map(|row| &mut row[..self.width]).collect();
                fill(y, &mut parts);
                for row in line.chunks_mut(self.columns) {
                    if row[..self.width].iter().any(|v| *v != ZERO) {
                        self.along[0].process_with_scratch(row, scratch);
                    }
                }
            },
        );
        let mut turned = vec![ZERO; self.columns * self.height];
        turned.par_chunks_mut(BLOCK * self.height).enumerate().for_each_init(
            || {
                (
                    vec![ZERO; BLOCK * self.rows],
                    vec![ZERO; BLOCK * self.rows],
                    vec![ZERO; self.down[0].get_inplace_scratch_len()],
                )
            },
            |(sum, part, scratch), (block, out)| {
                let (first, wide) = (block * BLOCK, out.len() / self.height);
                sum.fill(ZERO);
                for (k, kernel) in kernels.iter().enumerate() {
                    part.fill(ZERO);
                    for y in 0..self.height {
                        let row = &lines[(y * count + k) * self.columns + first..][..wide];
                        for (c, v) in row.iter().enumerate() {
                            part[c * self.rows + y] = *v;
                        }
                    }
                    for c in 0..wide {
                        let column = &mut part[c * self.rows..][..self.rows];
                        self.down[0].process_with_scratch(column, scratch);
                        let spectrum = self.column(kernel, first + c);
                        let total = &mut sum[c * self.rows..][..self.rows];
                        for q in 0..tall {
                            total[q] += column[q] * spectrum[q];
                        }
                        for q in tall..self.rows {
                            total[q] += column[q] * spectrum[self.rows - q];
                        }
                    }
                }
                for c in 0..wide {
                    let column = &mut sum[c * self.rows..][..self.rows];
                    self.down[1].process_with_scratch(column, scratch);
                    out[c * self.height..][..self.height].copy_from_slice(&column[..self.height]);
                }
            },
        );
        self.rows_back(&turned, 1, |_, parts| parts[0].clone()).concat()
    }

    /// The transpose: two maps (`fill(y, row)`) convolved with every kernel. `gather(y, parts)` turns row y (`width`
    /// values for each kernel) into the result.
    pub fn backward<R: Send>(
        &self,
        kernels: &[&Spectrum],
        fill: impl Fn(usize, &mut [C]) + Sync,
        gather: impl Fn(usize, &[Vec<C>]) -> R + Sync,
    ) -> Vec<R> {
        let (count, tall) = (kernels.len(), self.rows / 2 + 1);
        let mut lines = vec![ZERO; self.height * self.columns];
        lines.par_chunks_mut(self.columns).enumerate().for_each_init(
            || vec![ZERO; self.along[0].get_inplace_scratch_len()],
            |scratch, (y, line)| {
                fill(y, &mut line[..self.width]);
                self.along[0].process_with_scratch(line, scratch);
            },
        );
        let mut turned = vec![ZERO; self.columns * count * self.height];
        turned.par_chunks_mut(BLOCK * count * self.height).enumerate().for_each_init(
            || {
                (
                    vec![ZERO; BLOCK * self.rows],
                    vec![ZERO; self.rows],
                    vec![ZERO; self.down[0].get_inplace_scratch_len()],
                )
            },
            |(part, work, scratch), (block, out)| {
                let (first, wide) = (block * BLOCK, out.len() / (count * self.height));
                part.fill(ZERO);
                for y in 0..self.height {
                    let row = &lines[y * self.columns + first..][..wide];
                    for (c, v) in row.iter().enumerate() {
                        part[c * self.rows + y] = *v;
                    }
                }
                for c in 0..wide {
                    let column = &mut part[c * self.rows..][..self.rows];
                    self.down[0].process_with_scratch(column, scratch);
                    for (k, kernel) in kernels.iter().enumerate() {
                        let spectrum = self.column(kernel, first + c);
                        for q in 0..self.rows {
                            work[q] = column[q] * spectrum[if q < tall { q } else { self.rows - q }];
                        }
                        self.down[1].process_with_scratch(work, scratch);
                        out[(c * count + k) * self.height..][..self.height].copy_from_slice(&work[..self.height]);
                    }
                }
            },
        );
        self.rows_back(&turned, count, gather)
    }

    /// The weight of each stored value of a kernel's spectrum in ⟨view, kernel ∗ part k⟩, for every part that `fill`
    /// writes (as in [`Grid::forward`]) and the map that `view` writes (as in [`Grid::backward`]). The two maps of a
    /// transform are added up. This is the derivative by a kernel, whatever the kernel is.
    pub fn correlate(
        &self,
        count: usize,
        fill: impl Fn(usize, &mut [&mut [C]]) + Sync,
        view: impl Fn(usize, &mut [C]) + Sync,
    ) -> Vec<Vec<f64>> {
        let (parts, tall) = (count + 1, self.rows / 2 + 1);
        let mut lines = vec![ZERO; self.height * parts * self.columns];
        lines.par_chunks_mut(parts * self.columns).enumerate().for_each_init(
            || vec![ZERO; self.along[0].get_inplace_scratch_len()],
            |scratch, (y, line)| {
                let (sources, last) = line.split_at_mut(count * self.columns);
                let mut each: Vec<&mut [C]> =
                    sources.chunks_mut(self.columns).map(|row| &mut row[..self.width]).collect();
                fill(y, &mut each);
                view(y, &mut last[..self.width]);
                line.chunks_mut(self.columns).for_each(|row| self.along[0].process_with_scratch(row, scratch));
            },
        );
        let scale = 1.0 / (self.columns * self.rows) as f64;
        let mut unfolded = vec![0.0; self.columns * count * tall];
        unfolded.par_chunks_mut(BLOCK * count * tall).enumerate().for_each_init(
            || (vec![ZERO; BLOCK * parts * self.rows], vec![ZERO; self.down[0].get_inplace_scratch_len()]),
            |(work, scratch), (block, out)| {
                let (first, wide) = (block * BLOCK, out.len() / (count * tall));
                work.fill(ZERO);
                for y in 0..self.height {
                    for k in 0..parts {
                        let row = &lines[(y * parts + k) * self.columns + first..][..wide];
                        for (c, v) in row.iter().enumerate() {
                            work[(c * parts + k) * self.rows + y] = *v;
                        }
                    }
                }
                for c in 0..wide {
                    let columns = &mut work[c * parts * self.rows..][..parts * self.rows];
                    columns.chunks_mut(self.rows).for_each(|column| self.down[0].process_with_scratch(column, scratch));
                    let (sources, seen) = columns.split_at(count * self.rows);
                    for (k, column) in sources.chunks(self.rows).enumerate() {
                        let out = &mut out[(c * count + k) * tall..][..tall];
                        for q in 0..self.rows {
                            out[q.min(self.rows - q)] +=
                                scale * (column[q].re * seen[q].re + column[q].im * seen[q].im);
                        }
                    }
                }
            },
        );
        let mut counts = vec![vec![0.0; (self.columns / 2 + 1) * tall]; count];
        for (k, counts) in counts.iter_mut().enumerate() {
            for f in 0..self.columns {
                let from = &unfolded[(f * count + k) * tall..][..tall];
                counts[f.min(self.columns - f) * tall..][..tall].iter_mut().zip(from).for_each(|(a, b)| *a += b);
            }
        }
        counts
    }

    fn column<'a>(&self, kernel: &'a Spectrum, f: usize) -> &'a [f64] {
        let tall = self.rows / 2 + 1;
        &kernel.values[f.min(self.columns - f) * tall..][..tall]
    }

    /// Inverse transforms along the rows of `turned[(f * count + k) * height + y]`, handed to `gather` row by row.
    fn rows_back<R: Send>(&self, turned: &[C], count: usize, gather: impl Fn(usize, &[Vec<C>]) -> R + Sync) -> Vec<R> {
        let scale = 1.0 / (self.columns * self.rows) as f64;
        let blocks = self.height.div_ceil(BLOCK);
        let rows: Vec<Vec<R>> = (0..blocks)
            .into_par_iter()
            .map_init(
                || (vec![vec![ZERO; self.columns]; count * BLOCK], vec![ZERO; self.along[1].get_inplace_scratch_len()]),
                |(parts, scratch), block| {
                    let first = block * BLOCK;
                    let tall = BLOCK.min(self.height - first);
                    parts.iter_mut().for_each(|part| part.resize(self.columns, ZERO));
                    for f in 0..self.columns {
                        for k in 0..count {
                            let values = &turned[(f * count + k) * self.height + first..][..tall];
                            for (row, v) in values.iter().enumerate() {
                                parts[row * count + k][f] = *v * scale;
                            }
                        }
                    }
                    (0..tall)
                        .map(|row| {
                            let parts = &mut parts[row * count..][..count];
                            for part in parts.iter_mut() {
                                self.along[1].process_with_scratch(part, scratch);
                                part.truncate(self.width);
                            }
                            gather(first + row, parts)
                        })
                        .collect()
                },
            )
            .collect();
        rows.into_iter().flatten().collect()
    }
}
