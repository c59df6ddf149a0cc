//! Relief: heights from a map of normals, and normals from heights.
//!
//! Heights in mm over one plane, outward; normals are unit vectors in the image frame: x right, y up (towards row 0), z
//! outward.
//!
//! **Integration.** The heights are found whose differences between neighbouring texels of the leaf agree best, in the
//! least-squares sense, with the mean slopes of the two texels (Frankot & Chellappa 1988 without their periodic
//! border). This is Poisson's equation on the leaf with free edges. On a rectangle, cosine transforms solve it directly
//! ([`cosine`]). On any other outline that solution is the preconditioner of conjugate gradients, whose number of steps
//! then depends on the shape of the outline and not on the resolution. It would not be enough to fill the outside with
//! zero slope and transform once: the edges would bend the whole leaf.

pub mod cosine;

use cosine::PoissonSolver;

/// The result of an integration.
#[derive(Debug, Clone, PartialEq)]
pub struct ReliefSolution {
    /// Heights (mm); mean 0 over each piece of the leaf, 0 off it.
    pub height: Vec<f64>,
    /// Root mean square of the slope that no height explains: noise, and steps finer than a texel.
    pub residual: f64,
    /// Number of pieces of the leaf that do not touch; their heights relative to each other are undetermined.
    pub pieces: usize,
    /// Conjugate-gradient steps taken.
    pub steps: usize,
}

/// Integration ends after this many steps in any case.
const MOST: usize = 400;

/// Heights from unit normals (z > 0 on the leaf) inside a mask of `width · height` texels of `texel_mm`.
pub fn integrate(normal: &[[f64; 3]], mask: &[bool], width: usize, height: usize, texel_mm: f64) -> ReliefSolution {
    let n = width * height;
    let edges = Edges { mask, width, height };
    let slope: Vec<[f64; 2]> =
        normal.iter().zip(mask).map(|(v, on)| if *on { [-v[0] / v[2], -v[1] / v[2]] } else { [0.0; 2] }).collect();
    // The rise from a texel to its right neighbour, and to its lower neighbour.
    let right = |k: usize| 0.5 * texel_mm * (slope[k][0] + slope[k + 1][0]);
    let down = |k: usize| -0.5 * texel_mm * (slope[k][1] + slope[k + width][1]);
    let mut r = vec![0.0; n];
    let mut count = 0usize;
    edges.each(|a, b| {
        let rise = if b == a + 1 { right(a) } else { down(a) };
        r[a] -= rise;
        r[b] += rise;
        count += 1;
    });
    let poisson = PoissonSolver::new(width, height);
    let precondition = |r: &[f64]| -> Vec<f64> {
        let mut s = poisson.solve(r);
        s.iter_mut().zip(mask).filter(|(_, on)| !**on).for_each(|(s, _)| *s = 0.0);
        s
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let mut z = vec![0.0; n];
    let mut p = precondition(&r);
    let mut rho = dot(&r, &p);
    let enough = 1e-18 * rho;
    let mut steps = 0;
    while rho > enough && steps < MOST {
        let turned = edges.laplacian(&p);
        let curvature = dot(&p, &turned);
        if !(curvature > 0.0) {
            break;
        }
        let a = rho / curvature;
        z.iter_mut().zip(&p).for_each(|(z, p)| *z += a * p);
        r.iter_mut().zip(&turned).for_each(|(r, t)| *r -= a * t);
        let s = precondition(&r);
        let next = dot(&r, &s);
        let b = next / rho;
        p.iter_mut().zip(&s).for_each(|(p, s)| *p = s + b * *p);
        rho = next;
        steps += 1;
    }
    let mut rest = 0.0;
    edges.each(|a, b| rest += (z[b] - z[a] - if b == a + 1 { right(a) } else { down(a) }).powi(2));
    let pieces = edges.centre(&mut z);
    ReliefSolution { height: z, residual: (rest / count.max(1) as f64).sqrt() / texel_mm, pieces, steps }
}

/// Heights (mm) from unit normals: the heights of [`integrate`] without its other results.
pub fn heights(normal: &[[f64; 3]], mask: &[bool], width: usize, height: usize, texel_mm: f64) -> Vec<f64> {
    integrate(normal, mask, width, height, texel_mm).height
}

/// Pairs of neighbouring texels on the leaf.
struct Edges<'a> {
    mask: &'a [bool],
    width: usize,
    height: usize,
}

impl Edges<'_> {
    /// Visits every pair of neighbouring texels on the leaf, left or upper one first.
    fn each(&self, mut visit: impl FnMut(usize, usize)) {
        let (w, h) = (self.width, self.height);
        for j in 0..h {
            for k in j * w..(j + 1) * w {
                if !self.mask[k] {
                    continue;
                }
                if k + 1 < (j + 1) * w && self.mask[k + 1] {
                    visit(k, k + 1);
                }
                if j + 1 < h && self.mask[k + w] {
                    visit(k, k + w);
                }
            }
        }
    }

    fn laplacian(&self, p: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; p.len()];
        self.each(|a, b| {
            let d = p[b] - p[a];
            out[a] -= d;
            out[b] += d;
        });
        out
    }

    /// Subtracts the mean of each connected piece and returns the number of pieces.
    fn centre(&self, z: &mut [f64]) -> usize {
        let mut seen = vec![false; z.len()];
        let (mut pieces, mut piece) = (0, Vec::new());
        for start in 0..z.len() {
            if !self.mask[start] || seen[start] {
                continue;
            }
            pieces += 1;
            piece.clear();
            piece.push(start);
            seen[start] = true;
            let mut next = 0;
            while next < piece.len() {
                let k = piece[next];
                next += 1;
                let (i, j) = (k % self.width, k / self.width);
                let around = [
                    (i > 0).then(|| k - 1),
                    (i + 1 < self.width).then(|| k + 1),
                    (j > 0).then(|| k - self.width),
                    (j + 1 < self.height).then(|| k + self.width),
                ];
                for n in around.into_iter().flatten() {
                    if self.mask[n] && !seen[n] {
                        seen[n] = true;
                        piece.push(n);
                    }
                }
            }
            let mean = piece.iter().map(|&k| z[k]).sum::<f64>() / piece.len() as f64;
            piece.iter().for_each(|&k| z[k] -= mean);
        }
        pieces
    }
}

/// Unit normals of a height map inside a mask: from central differences, from one-sided differences at the leaf's edge,
/// and straight up off the leaf and where a texel has no neighbour.
pub fn normals(z: &[f64], mask: &[bool], width: usize, height: usize, texel_mm: f64) -> Vec<[f64; 3]> {
    let slope = |k: usize, before: Option<usize>, after: Option<usize>| {
        let on = |k: Option<usize>| k.filter(|&k| mask[k]);
        match (on(before), on(after)) {
            (Some(a), Some(b)) => (z[b] - z[a]) / (2.0 * texel_mm),
            (Some(a), None) => (z[k] - z[a]) / texel_mm,
            (None, Some(b)) => (z[b] - z[k]) / texel_mm,
            (None, None) => 0.0,
        }
    };
    (0..width * height)
        .map(|k| {
            if !mask[k] {
                return [0.0, 0.0, 1.0];
            }
            let (i, j) = (k % width, k / width);
            let p = slope(k, (i > 0).then(|| k - 1), (i + 1 < width).then(|| k + 1));
            let q = slope(k, (j + 1 < height).then(|| k + width), (j > 0).then(|| k - width));
            let length = (1.0 + p * p + q * q).sqrt();
            [-p / length, -q / length, 1.0 / length]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A leaf-like outline with a hole on a map of n × ¾n texels, 30 mm wide.
    fn outline(n: usize) -> (usize, usize, f64, Vec<bool>) {
        let (w, h, t) = (n, 3 * n / 4, 30.0 / n as f64);
        let mask = (0..w * h)
            .map(|k| {
                let (x, y) = (t * (k % w) as f64 - 15.0, 11.0 - t * (k / w) as f64);
                let lobes = 9.0 + 2.0 * (5.0 * y.atan2(x)).cos();
                x.hypot(1.1 * y) < lobes && (x - 3.0).hypot(y - 1.0) > 1.2
            })
            .collect();
        (w, h, t, mask)
    }

    fn z(x: f64, y: f64) -> f64 {
        0.02 * x * y + 0.6 * (0.35 * x).sin() + 0.15 * (2.3 * x + 1.1 * y).cos() + 0.1 * (y - 0.3 * x).tanh()
    }

    fn slopes(x: f64, y: f64) -> [f64; 2] {
        let (wave, step) = (0.15 * (2.3 * x + 1.1 * y).sin(), 0.1 * (1.0 - (y - 0.3 * x).tanh().powi(2)));
        [0.02 * y + 0.21 * (0.35 * x).cos() - 2.3 * wave - 0.3 * step, 0.02 * x - 1.1 * wave + step]
    }

    /// Largest error of heights recovered from exact slopes, up to a constant, and the number of steps.
    fn recovered(n: usize) -> (f64, usize) {
        let (w, h, t, mask) = outline(n);
        let place = |k: usize| (t * (k % w) as f64 - 15.0, 11.0 - t * (k / w) as f64);
        let normal: Vec<[f64; 3]> = (0..w * h)
            .map(|k| {
                let [p, q] = slopes(place(k).0, place(k).1);
                let s = (1.0 + p * p + q * q).sqrt();
                [-p / s, -q / s, 1.0 / s]
            })
            .collect();
        let relief = integrate(&normal, &mask, w, h, t);
        assert_eq!(relief.pieces, 1);
        let on = || (0..w * h).filter(|&k| mask[k]);
        let mean = on().map(|k| z(place(k).0, place(k).1)).sum::<f64>() / on().count() as f64;
        assert!((0..w * h).all(|k| mask[k] || relief.height[k] == 0.0));
        (on().map(|k| (relief.height[k] + mean - z(place(k).0, place(k).1)).abs()).fold(0.0, f64::max), relief.steps)
    }

    /// Heights of ±1 mm are recovered from exact normals within the error of the trapezoid rule, which falls with the
    /// square of the texel's size. The number of steps stays about the same.
    #[test]
    fn heights_come_back_from_normals() {
        let (coarse, few) = recovered(101);
        let (fine, many) = recovered(202);
        // The trapezoid's relative error is (k h)²/12; the shortest wave has k = 2.55/mm and .15 mm.
        let expected = 0.15 * (2.55 * 30.0 / 202.0f64).powi(2) / 12.0;
        assert!(fine < 0.3 * coarse && fine < 1.5 * expected, "{coarse} {fine} {expected}");
        assert!(many <= few + 10 && many < 60, "{few} {many}");
    }

    #[test]
    fn pieces_stand_each_by_themselves() {
        // Two planes of one slope, and a lone texel.
        let (w, h) = (20, 9);
        let mask: Vec<bool> = (0..w * h).map(|k| !matches!(k % w, 8 | 16..) || k == 4 * w + 18).collect();
        let s = 1.0 / 1.0625f64.sqrt();
        let relief = integrate(&vec![[-0.25 * s, 0.0, s]; w * h], &mask, w, h, 0.1);
        assert_eq!(relief.pieces, 3);
        assert!(relief.residual < 1e-9);
        for k in (0..w * h).filter(|&k| mask[k]) {
            let middle = [3.5, 12.0, 18.0][usize::from(k % w > 8) + usize::from(k % w > 16)];
            let want = 0.025 * ((k % w) as f64 - middle);
            assert!((relief.height[k] - want).abs() < 1e-8, "{k}: {} {want}", relief.height[k]);
        }
    }

    /// A slope field with curl cannot be integrated: the residual says how much slope is left over.
    #[test]
    fn what_no_height_explains_is_said() {
        let (w, h) = (40, 40);
        let normal: Vec<[f64; 3]> = (0..w * h)
            .map(|k| {
                let (x, y) = ((k % w) as f64 - 19.5, 19.5 - (k / w) as f64);
                let s = (1.0 + 1e-4 * (x * x + y * y)).sqrt();
                [0.01 * y / s, -0.01 * x / s, 1.0 / s]
            })
            .collect();
        let relief = integrate(&normal, &vec![true; w * h], w, h, 0.1);
        let largest = relief.height.iter().fold(0.0f64, |a, z| a.max(z.abs()));
        // Mean square slope of the whirl along one axis: .01² (n²−1)/12. The corners of a square take up a little of
        // it.
        let whirl = 0.01 * (1599.0f64 / 12.0).sqrt();
        assert!(
            relief.residual > 0.7 * whirl && relief.residual <= whirl && relief.steps <= 2,
            "{} {whirl} {}",
            relief.residual,
            relief.steps
        );
        assert!(largest < 0.2, "{largest}");
    }

    #[test]
    fn normals_are_the_slopes() {
        let (w, h, t, mask) = outline(120);
        let place = |k: usize| (t * (k % w) as f64 - 15.0, 11.0 - t * (k / w) as f64);
        let heights: Vec<f64> = (0..w * h).map(|k| z(place(k).0, place(k).1)).collect();
        let found = normals(&heights, &mask, w, h, t);
        for k in (0..w * h).filter(|&k| mask[k]) {
            let [p, q] = slopes(place(k).0, place(k).1);
            let inside = [k - 1, k + 1, k - w, k + w].iter().all(|&n| mask[n]);
            // Third derivatives up to 2, second up to .9: h²/6 inside, h/2 at the edge.
            let bound = if inside { 2.0 * t * t / 6.0 } else { 0.5 * t };
            let v = found[k];
            assert!((-v[0] / v[2] - p).abs() < bound && (-v[1] / v[2] - q).abs() < bound, "{k} {inside}");
            assert!((v.iter().map(|c| c * c).sum::<f64>() - 1.0).abs() < 1e-14);
        }
    }
}
