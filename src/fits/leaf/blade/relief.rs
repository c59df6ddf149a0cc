//! Relief: the heights whose slopes agree best with the measured normals, by least squares over neighbouring cells,
//! solved with conjugate gradients.

use super::TexelGrid;
use mesophyll_base::image::{Image, ImageSize};

/// Longest side of the grid that heights are solved on.
const CELLS: usize = 256;

/// Heights on a coarse grid over the blade.
#[derive(Debug, Clone)]
pub struct BladeRelief {
    /// How many texels a cell is wide.
    pub block: usize,
    /// Height (mm) of cell centres; its mean over the leaf is 0. Outside the leaf it continues with the
    /// slope of the edge.
    pub z: Image<f64>,
    /// Mean measured slopes [dz/dx, dz/dy] of cells; they continue outside the leaf.
    slope: [Image<f64>; 2],
    /// Root mean square of the part of the slopes that no height explains (the curl of noise and of true
    /// discontinuities).
    pub residual: f64,
}

/// Integrates slopes `[dz/dx, dz/dy]` (dimensionless; `None` off the leaf or at defects).
pub fn integrate(grid: &TexelGrid, slopes: &[Option<[f64; 2]>]) -> BladeRelief {
    let block = grid.width.max(grid.height).div_ceil(CELLS).max(1);
    let cells = ImageSize::new(grid.width.div_ceil(block), grid.height.div_ceil(block));
    let ImageSize { width: w, height: h } = cells;
    let mut sum = vec![[0.0f64; 3]; w * h];
    for (k, slope) in slopes.iter().enumerate() {
        if let Some([p, q]) = slope {
            let [column, row] = grid.size().position(k);
            let cell = &mut sum[row / block * w + column / block];
            cell[0] += p;
            cell[1] += q;
            cell[2] += 1.0;
        }
    }
    let on: Vec<bool> = sum.iter().map(|s| s[2] > 0.0).collect();
    let slope: Vec<[f64; 2]> =
        sum.iter().map(|s| if s[2] > 0.0 { [s[0] / s[2], s[1] / s[2]] } else { [0.0; 2] }).collect();
    let size = grid.texel * block as f64;
    // Each pair of neighbouring cells on the leaf: z_b − z_a = size · mean slope (rows run downwards, so dz/dy changes
    // sign).
    let mut pairs = Vec::new();
    for j in 0..h {
        for i in 0..w {
            let a = j * w + i;
            if !on[a] {
                continue;
            }
            if i + 1 < w && on[a + 1] {
                pairs.push((a, a + 1, size * 0.5 * (slope[a][0] + slope[a + 1][0])));
            }
            if j + 1 < h && on[a + w] {
                pairs.push((a, a + w, -size * 0.5 * (slope[a][1] + slope[a + w][1])));
            }
        }
    }
    let mut z = conjugate_gradients(w * h, &pairs);
    let count = on.iter().filter(|o| **o).count().max(1) as f64;
    let mean = z.iter().zip(&on).filter(|(_, o)| **o).map(|(z, _)| z).sum::<f64>() / count;
    for (z, o) in z.iter_mut().zip(&on) {
        if *o {
            *z -= mean;
        }
    }
    let rest: f64 = pairs.iter().map(|&(a, b, d)| ((z[b] - z[a] - d) / size).powi(2)).sum();
    let residual = (rest / pairs.len().max(1) as f64).sqrt();
    // The mesh carries the shape of the blade. Details finer than about a thirtieth of the blade (veins, bulges, a
    // round petiole) stay in the normal maps. The frame of the normal maps then turns slowly, and every renderer
    // interpolates it the same way.
    let sigma = w.max(h) as f64 / 32.0;
    let weight = blur(&Image::of(cells, |k| f64::from(u8::from(on[k]))), sigma);
    let mut slope = [0, 1]
        .map(|axis: usize| blur(&Image::of(cells, |k| slope[k][axis]), sigma).zip(&weight, |s, w| s / w.max(1e-9)));
    if let Some(source) = crate::leaf_folder::filling::sources(&on, w, h) {
        for (k, &from) in source.iter().enumerate() {
            let from = from as usize;
            let [to, of] = [k, from].map(|k| cells.position(k).map(|v| v as f64));
            let (dx, dy) = (to[0] - of[0], of[1] - to[1]);
            z[k] = z[from] + size * (slope[0][from] * dx + slope[1][from] * dy);
            slope[0][k] = slope[0][from];
            slope[1][k] = slope[1][from];
        }
    }
    let z = blur(&Image { size: cells, pixels: z }, sigma);
    BladeRelief { block, z, slope, residual }
}

/// Separable Gaussian blur of standard deviation `sigma` cells, normalised at the borders.
fn blur(image: &Image<f64>, sigma: f64) -> Image<f64> {
    let ImageSize { width, height } = image.size;
    let reach = (3.0 * sigma).ceil() as isize;
    let weight: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let pass = |source: &[f64], length: usize, lines: usize, step: usize, stride: usize| {
        let mut out = vec![0.0; source.len()];
        for line in 0..lines {
            for k in 0..length {
                let (mut sum, mut total) = (0.0, 0.0);
                for (w, d) in weight.iter().zip(-reach..=reach) {
                    let at = k as isize + d;
                    if at >= 0 && (at as usize) < length {
                        sum += w * source[line * stride + at as usize * step];
                        total += w;
                    }
                }
                out[line * stride + k * step] = sum / total;
            }
        }
        out
    };
    let rows = pass(&image.pixels, width, height, 1, width);
    Image { size: image.size, pixels: pass(&rows, height, width, width, 1) }
}

/// Solves the graph Laplacian of `pairs` for z (cells without a pair stay 0).
fn conjugate_gradients(n: usize, pairs: &[(usize, usize, f64)]) -> Vec<f64> {
    let mut z = vec![0.0; n];
    let mut r = vec![0.0; n];
    let mut degree = vec![0.0; n];
    for &(a, b, d) in pairs {
        r[b] += d;
        r[a] -= d;
        degree[a] += 1.0;
        degree[b] += 1.0;
    }
    let precondition =
        |r: &[f64]| -> Vec<f64> { r.iter().zip(&degree).map(|(r, d)| if *d > 0.0 { r / d } else { 0.0 }).collect() };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let mut s = precondition(&r);
    let mut p = s.clone();
    let mut rho = dot(&r, &s);
    let target = rho * 1e-16;
    let mut ap = vec![0.0; n];
    for _ in 0..4000 {
        if rho <= target || rho == 0.0 {
            break;
        }
        ap.fill(0.0);
        for &(a, b, _) in pairs {
            let d = p[b] - p[a];
            ap[b] += d;
            ap[a] -= d;
        }
        let curvature = dot(&p, &ap);
        if curvature <= 0.0 {
            break;
        }
        let alpha = rho / curvature;
        for k in 0..n {
            z[k] += alpha * p[k];
            r[k] -= alpha * ap[k];
        }
        s = precondition(&r);
        let next = dot(&r, &s);
        let beta = next / rho;
        rho = next;
        for k in 0..n {
            p[k] = s[k] + beta * p[k];
        }
    }
    z
}

impl BladeRelief {
    fn cell(&self, column: f64, row: f64) -> [f64; 2] {
        let b = self.block as f64;
        [(column + 0.5) / b - 0.5, (row + 0.5) / b - 0.5]
    }

    /// Height (mm) at texel coordinates.
    pub fn at(&self, column: f64, row: f64) -> f64 {
        let [x, y] = self.cell(column, row);
        self.z.bilinear(x, y)
    }

    /// Slope [dz/dx, dz/dy] at texel coordinates: the measured one, averaged over a cell.
    pub fn slope(&self, column: f64, row: f64) -> [f64; 2] {
        let [x, y] = self.cell(column, row);
        self.slope.each_ref().map(|slope| slope.bilinear(x, y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_stays_a_plane_to_its_edge() {
        let grid = TexelGrid { width: 64, height: 48, texel: 0.5 };
        let slopes: Vec<Option<[f64; 2]>> =
            (0..64 * 48).map(|k| (k % 64 > 8 && k % 64 < 50).then_some([0.1, -0.2])).collect();
        let relief = integrate(&grid, &slopes);
        let difference = relief.at(40.0, 10.0) - relief.at(12.0, 30.0);
        assert!((difference - (0.1 * 14.0 - 0.2 * 10.0)).abs() < 1e-6, "{difference}");
    }

    #[test]
    fn a_dome_comes_back_from_its_slopes() {
        let grid = TexelGrid { width: 90, height: 70, texel: 0.5 };
        let z = |x: f64, y: f64| 3.0 - 0.02 * x * x - 0.03 * y * y + 0.4 * (0.3 * x).sin();
        let inside = |x: f64, y: f64| (x / 20.0).powi(2) + (y / 15.0).powi(2) < 1.0;
        let slopes: Vec<Option<[f64; 2]>> = (0..90 * 70)
            .map(|k| {
                let [column, row] = grid.size().position(k);
                let [x, y] = grid.position(column as f64, row as f64);
                inside(x, y).then(|| [-0.04 * x + 0.12 * (0.3 * x).cos(), -0.06 * y])
            })
            .collect();
        let relief = integrate(&grid, &slopes);
        let [c, r] = grid.texel([0.25, 0.25]);
        let base = relief.at(c, r) - z(0.25, 0.25);
        for at in [[10.25, 3.25], [-8.75, -7.25], [15.25, 2.25]] {
            let [c, r] = grid.texel(at);
            // the ripple of 0.4 mm is finer than the mesh; the dome (several mm) is not
            assert!((relief.at(c, r) - z(at[0], at[1]) - base).abs() < 0.5, "{at:?}");
        }
    }
}
