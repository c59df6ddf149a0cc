//! The outline of the leaf: the contour of half coverage, traced between texels (marching squares) and simplified
//! (Douglas–Peucker).

use mesophyll_base::image::{Image, ImageSize};
use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::median_of;

/// Share of each texel that the leaf covers. It comes from the light box where that shows partly covered texels,
/// otherwise from the mask. It is smoothed a little, so that the contour of one half runs between texels instead of
/// along their edges.
pub fn coverage(mask: &[bool], ratio: Option<&[Rgb<f32>]>, size: ImageSize) -> Image<f64> {
    let mean = |t: &Rgb<f32>| f64::from(t[0] + t[1] + t[2]) / 3.0;
    let leaf_level = ratio.map_or(0.0, |r| {
        let inside = r.iter().zip(mask).filter(|(_, m)| **m).map(|(t, _)| mean(t)).filter(|v| v.is_finite());
        median_of(inside).unwrap_or(0.0)
    });
    let raw = Image::of(size, |k| match ratio {
        // A partly covered texel at the edge lets through a mix of leaf and bare box.
        Some(r) if mean(&r[k]).is_finite() && leaf_level < 0.9 => {
            let share = ((1.0 - mean(&r[k])) / (1.0 - leaf_level)).clamp(0.0, 1.0);
            if mask[k] { share.max(0.5) } else { share.min(0.5) }
        }
        _ => f64::from(u8::from(mask[k])),
    });
    // 3×3 binomial, the border counting as outside
    Image::of(size, |k| {
        let [i, j] = size.position(k).map(|v| v as isize);
        let mut sum = 0.0;
        for (dj, wj) in [(-1, 1.0), (0, 2.0), (1, 1.0)] {
            for (di, wi) in [(-1, 1.0), (0, 2.0), (1, 1.0)] {
                sum += wi * wj * raw.get([i + di, j + dj]).copied().unwrap_or(0.0);
            }
        }
        sum / 16.0
    })
}

/// Closed contours of `field` at `level` in texel coordinates; anything beyond the image counts as outside. The first
/// point is not repeated at the end.
pub fn contours(field: &Image<f64>, level: f64) -> Vec<Vec<[f64; 2]>> {
    use std::collections::BTreeMap;
    // One ring of outside texels closes every contour.
    let (w, h) = (field.size.width + 2, field.size.height + 2);
    let at = |i: usize, j: usize| field.get([i as isize - 1, j as isize - 1]).copied().unwrap_or(level - 1.0);
    let inside = |i: usize, j: usize| at(i, j) >= level;
    // An edge of the grid is (i, j, 0: to the right, 1: downwards); each holds at most one crossing.
    type Edge = (usize, usize, u8);
    let mut next: BTreeMap<Edge, Vec<Edge>> = BTreeMap::new();
    for j in 0..h - 1 {
        for i in 0..w - 1 {
            let c = [inside(i, j), inside(i + 1, j), inside(i + 1, j + 1), inside(i, j + 1)];
            let edges: [Edge; 4] = [(i, j, 0), (i + 1, j, 1), (i, j + 1, 0), (i, j, 1)];
            // Walk with the inside on the left: from the edge where we enter the inside (going round) to the one where
            // we leave.
            let mut link = |from: usize, to: usize| next.entry(edges[from]).or_default().push(edges[to]);
            let crossing: Vec<usize> = (0..4).filter(|&k| c[k] != c[(k + 1) % 4]).collect();
            match crossing.len() {
                2 => {
                    let (a, b) = (crossing[0], crossing[1]);
                    if c[a] { link(a, b) } else { link(b, a) }
                }
                4 => {
                    // Saddle: the centre decides which corners belong together.
                    let centre = (at(i, j) + at(i + 1, j) + at(i + 1, j + 1) + at(i, j + 1)) / 4.0 >= level;
                    let outs: [usize; 2] = if c[0] { [0, 2] } else { [1, 3] };
                    for out in outs {
                        let to = if centre { (out + 1) % 4 } else { (out + 3) % 4 };
                        link(out, to);
                    }
                }
                _ => {}
            }
        }
    }
    let point = |e: Edge| {
        let (a, b) = (at(e.0, e.1), if e.2 == 0 { at(e.0 + 1, e.1) } else { at(e.0, e.1 + 1) });
        let f = ((level - a) / (b - a)).clamp(0.02, 0.98);
        let (dx, dy) = if e.2 == 0 { (f, 0.0) } else { (0.0, f) };
        [e.0 as f64 + dx - 1.0, e.1 as f64 + dy - 1.0]
    };
    let mut loops = Vec::new();
    while let Some((&start, _)) = next.iter().next() {
        let mut ring = Vec::new();
        let mut edge = start;
        loop {
            ring.push(point(edge));
            let Some(list) = next.get_mut(&edge) else { break };
            let Some(to) = list.pop() else { break };
            if list.is_empty() {
                next.remove(&edge);
            }
            edge = to;
            if edge == start {
                break;
            }
        }
        if ring.len() >= 8 {
            loops.push(ring);
        }
    }
    loops
}

/// Douglas–Peucker on a closed ring: no removed point is farther than `tolerance` from the thinned ring.
pub fn simplify(ring: &[[f64; 2]], tolerance: f64) -> Vec<[f64; 2]> {
    if ring.len() < 4 {
        return ring.to_vec();
    }
    // Split at the point farthest from the first.
    let far = (0..ring.len())
        .max_by(|&a, &b| distance2(ring[a], ring[0]).total_cmp(&distance2(ring[b], ring[0])))
        .unwrap_or(0);
    let mut keep = vec![false; ring.len() + 1];
    keep[0] = true;
    keep[far] = true;
    let closed: Vec<[f64; 2]> = ring.iter().copied().chain([ring[0]]).collect();
    let mut stack = vec![(0, far), (far, ring.len())];
    while let Some((a, b)) = stack.pop() {
        let worst =
            (a + 1..b).map(|k| (k, to_segment(closed[k], closed[a], closed[b]))).max_by(|p, q| p.1.total_cmp(&q.1));
        if let Some((k, d)) = worst
            && d > tolerance
        {
            keep[k] = true;
            stack.push((a, k));
            stack.push((k, b));
        }
    }
    (0..ring.len()).filter(|&k| keep[k]).map(|k| ring[k]).collect()
}

fn distance2(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
}

fn to_segment(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let length2 = distance2(a, b);
    let t = if length2 > 0.0 {
        (((p[0] - a[0]) * (b[0] - a[0]) + (p[1] - a[1]) * (b[1] - a[1])) / length2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    distance2(p, [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]).sqrt()
}

/// Signed area of a ring (texels²); the sign tells on which side of the ring the inside lies.
pub fn area(ring: &[[f64; 2]]) -> f64 {
    (0..ring.len()).map(|k| (ring[k], ring[(k + 1) % ring.len()])).map(|(a, b)| 0.5 * (a[0] * b[1] - b[0] * a[1])).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disk(w: usize, h: usize, r: f64) -> Image<f64> {
        // coverage of a disk, 8×8 samples a texel
        let size = ImageSize::new(w, h);
        Image::of(size, |k| {
            let [i, j] = size.position(k).map(|v| v as f64);
            let inside = (0..64).filter(|s| {
                let (dx, dy) = ((f64::from(s % 8) + 0.5) / 8.0 - 0.5, (f64::from(s / 8) + 0.5) / 8.0 - 0.5);
                (i + dx - w as f64 / 2.0).hypot(j + dy - h as f64 / 2.0) < r
            });
            inside.count() as f64 / 64.0
        })
    }

    #[test]
    fn a_disk_is_traced_between_texels() {
        let field = disk(60, 50, 18.3);
        let loops = contours(&field, 0.5);
        assert_eq!(loops.len(), 1);
        let ring = simplify(&loops[0], 0.1);
        assert!(ring.len() < loops[0].len() / 2);
        assert!((area(&ring).abs() / (std::f64::consts::PI * 18.3 * 18.3) - 1.0).abs() < 0.01);
        for p in &loops[0] {
            assert!(((p[0] - 30.0).hypot(p[1] - 25.0) - 18.3).abs() < 0.15);
        }
    }

    #[test]
    fn leaves_that_touch_the_border_close_and_holes_are_traced() {
        let size = ImageSize::new(30, 20);
        let field = Image::of(size, |k| {
            let [i, j] = size.position(k);
            if (i > 12 && i < 17) && (j > 7 && j < 12) { 0.0 } else { 1.0 }
        });
        let loops = contours(&field, 0.5);
        assert_eq!(loops.len(), 2);
        let areas: Vec<f64> = loops.iter().map(|l| area(l)).collect();
        assert!(areas[0] * areas[1] < 0.0, "a hole runs the other way round: {areas:?}");
    }
}
