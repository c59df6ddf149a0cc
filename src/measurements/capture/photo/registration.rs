//! Lays one photograph's leaf over another's by their outlines: a turn, a shift and a change of size, with or without
//! a mirror image. A leaf that was turned over is the mirror image of itself.
//!
//! Both masks become images of how much of a block is leaf. The start comes from the areas, the centres, and eight
//! turns; Gauss–Newton steps then minimise the sum of squared differences (Lucas & Kanade 1981), first on coarse and
//! then on fine blocks.

use mesophyll_base::image::{Image, ImageSize};
use nalgebra::{SMatrix, SVector};

/// Blocks along the longer side of the leaf, and around it: coarse and fine. Coarse steps begin far from the match, and
/// fine ones where the coarse ones ended.
const BLOCKS: [(usize, usize); 2] = [(48, 24), (240, 24)];
/// Starting turns a full circle.
const TURNS: usize = 8;
/// Turns that differ by more than this (radians) are different ways to lay a leaf.
const OTHER_TURN: f64 = 0.8;

/// From places in the first picture to places in the second (pixels): p ↦ [a −b; b a] (±(x − x₀), y − y₀) + shift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimilarityTransform {
    mirrored: bool,
    centre: [f64; 2],
    turn: [f64; 2],
    shift: [f64; 2],
}

impl SimilarityTransform {
    /// No motion.
    pub const NONE: SimilarityTransform =
        SimilarityTransform { mirrored: false, centre: [0.0; 2], turn: [1.0, 0.0], shift: [0.0; 2] };

    /// Where a place of the first picture lies in the second.
    pub fn at(&self, p: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.off_centre(p);
        let [a, b] = self.turn;
        [a * x - b * y + self.shift[0], b * x + a * y + self.shift[1]]
    }

    fn off_centre(&self, p: [f64; 2]) -> [f64; 2] {
        let x = p[0] - self.centre[0];
        [if self.mirrored { -x } else { x }, p[1] - self.centre[1]]
    }

    /// Size of a pixel of the first picture, in pixels of the second.
    pub fn scale(&self) -> f64 {
        self.turn[0].hypot(self.turn[1])
    }

    /// The angle between two turns (radians, 0 to π).
    fn turned_from(&self, other: &SimilarityTransform) -> f64 {
        let ([a, b], [c, d]) = (self.turn, other.turn);
        (a * d - b * c).atan2(a * c + b * d).abs()
    }

    /// The same between pictures of which `first` and `second` pixels are taken as one.
    fn of_blocks(&self, first: f64, second: f64) -> SimilarityTransform {
        SimilarityTransform {
            mirrored: self.mirrored,
            centre: self.centre.map(|v| v * first),
            turn: self.turn.map(|v| v * second / first),
            shift: self.shift.map(|v| v * second),
        }
    }
}

/// How two outlines lie over each other.
#[derive(Debug, Clone, Copy)]
pub struct OutlineMatch {
    /// From the first picture to the second.
    pub motion: SimilarityTransform,
    /// The share of the leaf that is covered by both outlines.
    pub overlap: f64,
    /// Mean distance between the outlines (pixels of the first picture).
    pub apart_px: f64,
}

/// A mask of some size, row-major.
#[derive(Debug, Clone, Copy)]
pub struct BinaryMask<'a> {
    /// Whether a pixel lies on the leaf.
    pub inside: &'a [bool],
    /// Pixels a row.
    pub width: usize,
}

impl BinaryMask<'_> {
    /// Whether a place lies on the leaf (pixels).
    pub fn holds(&self, p: [f64; 2]) -> bool {
        let [x, y] = p.map(f64::floor);
        let rows = (self.inside.len() / self.width.max(1)) as f64;
        x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < rows && self.inside[y as usize * self.width + x as usize]
    }
}

/// Matches of two outlines.
#[derive(Debug, Clone, Copy)]
pub struct OutlineMatches {
    /// The best one.
    pub best: OutlineMatch,
    /// The best one of those that turn the leaf by another large angle. It is nearly as good where an outline is
    /// symmetric.
    pub rival: Option<OutlineMatch>,
}

/// The best matches of two outlines with or without a mirror image; `None` for an empty mask.
pub fn register(first: BinaryMask, second: BinaryMask, mirrored: bool) -> Option<OutlineMatches> {
    let coarse = (Cover::of(first, BLOCKS[0])?, Cover::of(second, BLOCKS[0])?);
    let fine = (Cover::of(first, BLOCKS[1])?, Cover::of(second, BLOCKS[1])?);
    let (f, s) = &coarse;
    let size = (s.area / f.area).sqrt();
    let mut ends: Vec<(SimilarityTransform, f64)> = (0..TURNS)
        .map(|k| {
            let (sin, cos) = (std::f64::consts::TAU * k as f64 / TURNS as f64).sin_cos();
            f.descend(
                s,
                SimilarityTransform { mirrored, centre: f.centre, turn: [size * cos, size * sin], shift: s.centre },
            )
        })
        .collect();
    ends.sort_by(|a, b| a.1.total_cmp(&b.1));
    let refined = |start: SimilarityTransform| {
        let pixels = start.of_blocks(f.block as f64, s.block as f64);
        let (f, s) = &fine;
        let start = pixels.of_blocks(1.0 / f.block as f64, 1.0 / s.block as f64);
        let (end, _) = f.descend(s, start);
        f.compare(s, end, end.of_blocks(f.block as f64, s.block as f64))
    };
    let best = ends.first()?.0;
    let rival = ends.iter().find(|(m, _)| m.turned_from(&best) > OTHER_TURN).map(|(m, _)| refined(*m));
    let best = refined(best);
    // Fine blocks may see what coarse ones did not.
    Some(match rival {
        Some(rival) if rival.overlap > best.overlap => OutlineMatches { best: rival, rival: Some(best) },
        _ => OutlineMatches { best, rival },
    })
}

/// How much of each block is leaf, smoothed over neighbouring blocks. Blocks cover the leaf and some of what is around
/// it, not the picture, which may be hundreds of times as large. Places are counted in blocks from the picture's
/// corner.
struct Cover {
    block: usize,
    /// The first block's place.
    origin: [i64; 2],
    values: Image<f64>,
    area: f64,
    centre: [f64; 2],
}

impl Cover {
    fn of(mask: BinaryMask, (blocks, pad): (usize, usize)) -> Option<Cover> {
        let size = ImageSize::new(mask.width, mask.inside.len() / mask.width.max(1));
        let on = || mask.inside.iter().enumerate().filter(|(_, m)| **m).map(|(k, _)| size.position(k));
        let [mut left, mut top, mut right, mut bottom] = [usize::MAX, usize::MAX, 0, 0];
        for [i, j] in on() {
            (left, top, right, bottom) = (left.min(i), top.min(j), right.max(i), bottom.max(j));
        }
        if left > right {
            return None;
        }
        let block = ((right - left).max(bottom - top) / blocks).max(1);
        let origin = [left, top].map(|v| (v / block) as i64 - pad as i64);
        let [width, height] = [(left, right), (top, bottom)].map(|(a, b)| b / block - a / block + 1 + 2 * pad);
        let mut values = Image::of(ImageSize::new(width, height), |_| 0.0);
        let each = 1.0 / (block * block) as f64;
        on().for_each(|[i, j]| {
            let [i, j] = [(i / block, 0), (j / block, 1)].map(|(v, a)| (v as i64 - origin[a]) as usize);
            values[j * width + i] += each;
        });
        let area: f64 = values.pixels.iter().sum();
        let mut cover = Cover { block, origin, values, area, centre: [0.0; 2] };
        let mut centre = [0.0; 2];
        for (k, p) in cover.places() {
            (0..2).for_each(|a| centre[a] += cover.values[k] * p[a] / area);
        }
        cover.centre = centre;
        (0..2).for_each(|_| cover.smooth());
        Some(cover)
    }

    /// Averages each block with its eight neighbours.
    fn smooth(&mut self) {
        let size = self.values.size;
        let three = |values: &Image<f64>, k: usize, along: [i64; 2]| -> f64 {
            let [i, j] = size.position(k).map(|v| v as i64);
            (-1..2).map(|d| values.get([i + d * along[0], j + d * along[1]]).copied().unwrap_or(0.0)).sum()
        };
        let rows = Image::of(size, |k| three(&self.values, k, [1, 0]));
        self.values = Image::of(size, |k| three(&rows, k, [0, 1]) / 9.0);
    }

    /// The value and its slopes between blocks' centres; 0 outside.
    fn at(&self, [x, y]: [f64; 2]) -> (f64, [f64; 2]) {
        let (x, y) = (x - self.origin[0] as f64 - 0.5, y - self.origin[1] as f64 - 0.5);
        let ImageSize { width, height } = self.values.size;
        if !(x >= 0.0 && y >= 0.0 && x < (width - 1) as f64 && y < (height - 1) as f64) {
            return (0.0, [0.0; 2]);
        }
        let (i, j) = (x as usize, y as usize);
        let (u, v) = (x - i as f64, y - j as f64);
        let k = j * width + i;
        let [a, b, c, d] = [k, k + 1, k + width, k + width + 1].map(|k| self.values[k]);
        let value = (a * (1.0 - u) + b * u) * (1.0 - v) + (c * (1.0 - u) + d * u) * v;
        (value, [(b - a) * (1.0 - v) + (d - c) * v, (c - a) * (1.0 - u) + (d - b) * u])
    }

    /// Blocks on or near the leaf, with their places.
    fn places(&self) -> impl Iterator<Item = (usize, [f64; 2])> {
        let [x, y] = self.origin.map(|v| v as f64 + 0.5);
        let size = self.values.size;
        (0..size.texels())
            .map(move |k| (k, size.position(k).map(|v| v as f64)))
            .map(move |(k, [i, j])| (k, [i + x, j + y]))
    }

    /// Gauss–Newton steps from `motion`; the motion and the sum of squares where they end.
    fn descend(&self, other: &Cover, mut motion: SimilarityTransform) -> (SimilarityTransform, f64) {
        let mut best = (motion, f64::INFINITY);
        for _ in 0..60 {
            let (mut normal, mut right, mut cost) = (SMatrix::<f64, 4, 4>::zeros(), SVector::<f64, 4>::zeros(), 0.0);
            for (k, p) in self.places() {
                let (value, slope) = other.at(motion.at(p));
                let rest = value - self.values[k];
                cost += rest * rest;
                if rest != 0.0 && slope != [0.0; 2] {
                    let [x, y] = motion.off_centre(p);
                    let row =
                        SVector::from([slope[0] * x + slope[1] * y, slope[1] * x - slope[0] * y, slope[0], slope[1]]);
                    normal += row * row.transpose();
                    right += row * rest;
                }
            }
            let gain = best.1 - cost;
            if cost < best.1 {
                best = (motion, cost);
            }
            let Some(step) = normal.lu().solve(&right) else { break };
            if gain.abs() < 1e-7 * cost || !step.iter().all(|v| v.is_finite()) {
                break;
            }
            motion.turn = [motion.turn[0] - step[0], motion.turn[1] - step[1]];
            motion.shift = [motion.shift[0] - step[2], motion.shift[1] - step[3]];
        }
        best
    }

    /// What is left between both outlines. `motion` is in blocks, `pixels` the same in pixels.
    fn compare(&self, other: &Cover, motion: SimilarityTransform, pixels: SimilarityTransform) -> OutlineMatch {
        let (mut apart, mut either, mut rim) = (0.0, 0.0, 0.0);
        for (k, p) in self.places() {
            let (value, _) = other.at(motion.at(p));
            apart += (value - self.values[k]).abs();
            either += value.max(self.values[k]);
            let (_, slope) = self.at(p);
            rim += slope[0].hypot(slope[1]);
        }
        OutlineMatch { motion: pixels, overlap: 1.0 - apart / either, apart_px: apart / rim * self.block as f64 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An uneven shape, turned, shifted, enlarged and mirrored by known amounts, is found again to a tenth of a
    /// pixel, and its other hand does not fit.
    #[test]
    fn a_known_motion_is_found_again() {
        let shape = |x: f64, y: f64| {
            let (r, a) = (x.hypot(y), y.atan2(x));
            r < 60.0 + 14.0 * a.cos() + 9.0 * (2.0 * a + 0.7).sin() + 5.0 * (5.0 * a).cos()
        };
        let (w, h) = (240, 200);
        let middle = |k| ImageSize::new(w, h).middle(k);
        let first: Vec<bool> = (0..w * h).map(|k| shape(middle(k)[0] - 118.0, middle(k)[1] - 97.0)).collect();
        for (mirrored, angle) in [(true, 0.3), (false, 2.5)] {
            let (sin, cos) = f64::sin_cos(angle);
            // The place in the first picture of a place in the second, which is 1.2 times as large.
            let back = |x: f64, y: f64| {
                let (x, y) = ((x - 150.0) / 1.2, (y - 140.0) / 1.2);
                let (x, y) = (cos * x + sin * y, cos * y - sin * x);
                [if mirrored { -x } else { x }, y]
            };
            let (w2, h2) = (300, 280);
            let second: Vec<bool> = (0..w2 * h2)
                .map(|k| back((k % w2) as f64 + 0.5, (k / w2) as f64 + 0.5))
                .map(|[x, y]| shape(x, y))
                .collect();
            let [a, b] = [BinaryMask { inside: &first, width: w }, BinaryMask { inside: &second, width: w2 }];
            let found = register(a, b, mirrored).unwrap().best;
            assert!(found.overlap > 0.98, "{found:?}");
            for p in [[118.0, 97.0], [60.0, 100.0], [150.0, 60.0]] {
                let q = found.motion.at(p);
                let home = back(q[0], q[1]);
                let off = (home[0] - (p[0] - 118.0)).hypot(home[1] - (p[1] - 97.0));
                assert!(off < 0.1, "{p:?} is off by {off}");
            }
            assert!(register(a, b, !mirrored).unwrap().best.overlap < found.overlap - 0.05);
        }
    }

    /// A leaf of 60 pixels in a picture of 25 million: blocks cover the leaf, and it is found as in a small picture.
    #[test]
    fn a_small_leaf_in_a_large_picture_takes_few_blocks() {
        let shape = |x: f64, y: f64| {
            let (r, a) = (x.hypot(y), y.atan2(x));
            r < 30.0 + 7.0 * a.cos() + 4.0 * (2.0 * a + 0.7).sin()
        };
        let (w, h) = (5000, 5000);
        let drawn = |w: usize, h: usize, x0: f64, y0: f64| -> Vec<bool> {
            let mut inside = vec![false; w * h];
            for (i, j) in (0..120).flat_map(|j| (0..120).map(move |i| (i, j))) {
                let [x, y] = [i as f64 - 59.5, j as f64 - 59.5];
                let at = (y0 + y).floor() * w as f64 + (x0 + x).floor();
                inside[at as usize] = shape(x, y);
            }
            inside
        };
        let first = drawn(w, h, 4020.5, 3100.5);
        let second = drawn(200, 160, 100.5, 80.5);
        let [a, b] = [BinaryMask { inside: &first, width: w }, BinaryMask { inside: &second, width: 200 }];
        let cover = Cover::of(a, BLOCKS[1]).unwrap();
        assert!(cover.values.size.texels() < 500 * 500, "{:?}", cover.values.size);
        let found = register(a, b, false).unwrap().best;
        let q = found.motion.at([4030.5, 3090.5]);
        assert!((q[0] - 110.5).hypot(q[1] - 70.5) < 0.1 && found.overlap > 0.99, "{q:?} {found:?}");
    }
}
