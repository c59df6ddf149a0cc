//! How unevenly a picture in open shade is lit, together with the camera's vignetting. The black sheet shows it: the
//! logarithm of its brightness is fitted, a channel each, by a polynomial of second degree over the picture, which then
//! holds for leaf and card too.

use super::picture::LinearPhotograph;
use mesophyll_base::image::ImageSize;
use mesophyll_base::rgb::Rgb;
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

type V6 = SVector<f64, 6>;

/// Blocks along the longer side of the picture. The sheet's brightness is averaged over a block.
const BLOCKS: usize = 40;
/// Fewer blocks do not determine the polynomial.
const FEWEST: usize = 18;
/// Relative standard deviation of the light over a picture where the sheet does not show it.
const UNSEEN: f64 = 0.05;

/// The light over a picture, relative to the light on the sheet's middle.
#[derive(Debug, Clone)]
pub struct SheetLight {
    size: [f64; 2],
    /// Coefficients of ln light, a channel; `None` where the sheet does not show enough.
    by: Option<Rgb<V6>>,
    /// (XᵀX)⁻¹ of the fit.
    spread: SMatrix<f64, 6, 6>,
    /// Relative root mean square of what the polynomial leaves of the sheet's blocks: noise, the sheet's grain, and
    /// light of higher degree.
    pub rest: f64,
    /// How many blocks were fitted.
    pub blocks: usize,
}

impl SheetLight {
    /// Fits the light of `picture` on its sheet: pixels where `bright` is not set, away from everything that is.
    pub fn on_sheet(picture: &LinearPhotograph, bright: &[bool]) -> SheetLight {
        let (w, h) = (picture.width, picture.height);
        let side = (w.max(h) / BLOCKS).max(4);
        let blocks = ImageSize::new(w / side, h / side);
        let busy: Vec<bool> = (0..blocks.texels())
            .map(|b| {
                let [i, j] = blocks.position(b).map(|v| v * side);
                (j..j + side).any(|y| bright[y * w + i..y * w + i + side].contains(&true))
            })
            .collect();
        let busy = super::outline::widened(&busy, blocks, 1);
        let size = [w as f64, h as f64];
        let mut light = SheetLight { size, by: None, spread: SMatrix::zeros(), rest: UNSEEN, blocks: 0 };
        let mut points: Vec<(V6, Rgb)> = Vec::new();
        for b in (0..blocks.texels()).filter(|&b| !busy[b]) {
            let [i, j] = blocks.position(b).map(|v| v * side);
            let (mut sum, mut count) = (Rgb::splat(0.0), 0.0);
            for k in (j..j + side).flat_map(|y| (i..i + side).map(move |x| y * w + x)) {
                let pixel = picture.pixels[k];
                if pixel.iter().all(|v| v.is_finite()) {
                    sum += pixel.map(f64::from);
                    count += 1.0;
                }
            }
            if count > 0.0 && sum.iter().all(|s| *s > 0.0) {
                let middle = [i as f64 + 0.5 * side as f64, j as f64 + 0.5 * side as f64];
                points.push((light.design(middle), sum.map(|s| (s / count).ln())));
            }
        }
        light.blocks = points.len();
        if points.len() < FEWEST {
            return light;
        }
        let x = DMatrix::from_fn(points.len(), 6, |r, c| points[r].0[c]);
        let normal = x.transpose() * &x;
        let Some(inverse) = normal.try_inverse() else { return light };
        let mut squares = 0.0;
        let by = Rgb::of(|c| {
            let y = DVector::from_fn(points.len(), |r, _| points[r].1[c]);
            let found = &inverse * (x.transpose() * &y);
            squares += (y - &x * &found).norm_squared();
            V6::from_fn(|k, _| found[k])
        });
        light.rest = (squares / (3 * (points.len() - 6)) as f64).sqrt();
        light.spread = SMatrix::from_fn(|r, c| inverse[(r, c)]);
        light.by = Some(by);
        light
    }

    /// Whether the sheet shows the light.
    pub fn is_seen(&self) -> bool {
        self.by.is_some()
    }

    /// 1, x, y, x², xy, y² with x and y from −1 to 1 over the picture.
    fn design(&self, p: [f64; 2]) -> V6 {
        let [x, y] = [0, 1].map(|k| 2.0 * p[k] / self.size[k] - 1.0);
        V6::from([1.0, x, y, x * x, x * y, y * y])
    }

    /// The light at a place of the picture; 1 everywhere where the sheet does not show it.
    pub fn at(&self, p: [f64; 2]) -> Rgb {
        let design = self.design(p);
        self.by.map_or(Rgb::splat(1.0), |by| by.map(|c| c.dot(&design).exp()))
    }

    /// Standard error of ln(light at `a`/light at `b`): that of the polynomial, and the rest of one block.
    pub fn ratio_err(&self, a: [f64; 2], b: [f64; 2]) -> f64 {
        let apart = self.design(a) - self.design(b);
        self.rest * (1.0 + (apart.transpose() * self.spread * apart)[(0, 0)].max(0.0)).sqrt()
    }

    /// Largest light over the picture's corners and middle, divided by the smallest.
    pub fn unevenness(&self) -> f64 {
        let [w, h] = self.size;
        let points = [[0.0, 0.0], [w, 0.0], [0.0, h], [w, h], [0.5 * w, 0.5 * h]].map(|p| self.at(p)[1]);
        points.iter().copied().fold(f64::MIN, f64::max) / points.iter().copied().fold(f64::MAX, f64::min)
    }
}
