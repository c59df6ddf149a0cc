use super::*;
use crate::side::Side;
use crate::translucency::blade::BladeMaps;

/// A blade with a given front relief (mm over columns and rows in mm, y up) and mask.
fn relief(w: usize, h: usize, texel: f64, on: impl Fn(f64, f64) -> bool, z: impl Fn(f64, f64) -> f64) -> BladeMaps {
    let place = |k: usize| (texel * (k % w) as f64, -texel * (k / w) as f64);
    let mask: Vec<bool> = (0..w * h).map(|k| on(place(k).0, place(k).1)).collect();
    let front: Vec<f64> = (0..w * h).map(|k| z(place(k).0, place(k).1)).collect();
    let n = w * h;
    BladeMaps::from_heights(w, h, texel, mask, [front, vec![1.0; n]], [vec![1.0; n], vec![1.0; n]])
}

/// Sine of the horizon by walking the ray in small steps over the bilinear heights of the leaf.
fn walked(lit: &LitSide, texel: usize, azimuth: f64) -> f64 {
    let (w, h) = (lit.width as f64, lit.height as f64);
    let (x0, y0) = ((texel % lit.width) as f64, (texel / lit.width) as f64);
    let z0 = lit.surface.height[texel];
    let (dx, dy) = (azimuth.cos(), -azimuth.sin());
    let mut tangent = 0.0f64;
    let mut t = 0.5;
    loop {
        let (x, y) = (x0 + t * dx, y0 + t * dy);
        if !(x >= 0.0 && y >= 0.0 && x <= w - 1.0 && y <= h - 1.0) {
            break;
        }
        let (i, j) = ((x.floor() as usize).min(lit.width - 2), (y.floor() as usize).min(lit.height - 2));
        let (f, g) = (x - i as f64, y - j as f64);
        let k = j * lit.width + i;
        let corners = [k, k + 1, k + lit.width, k + lit.width + 1];
        if corners.iter().all(|&c| lit.mask[c]) {
            let [a, b, c, d] = corners.map(|c| lit.surface.height[c]);
            let z = (a * (1.0 - f) + b * f) * (1.0 - g) + (c * (1.0 - f) + d * f) * g;
            tangent = tangent.max((z - z0) / (t * lit.texel_mm));
        }
        t += 0.05;
    }
    tangent / tangent.hypot(1.0)
}

#[test]
fn the_hull_finds_the_highest_sample() {
    // Compares with all pairs of samples, including equal heights and gaps.
    let heights = [0.0, 3.0, 1.0, 1.0, 5.0, -2.0, 0.5, 0.5, 0.5, 4.0, 2.0f32];
    let samples: Vec<(f32, f32)> =
        heights.iter().enumerate().filter(|(k, _)| *k != 2 && *k != 7).map(|(k, z)| (k as f32, *z)).collect();
    let mut line = Line { samples: samples.clone(), hull: Vec::new() };
    let (mut forth, mut back) = (vec![NOTHING; 11], vec![NOTHING; 11]);
    line.horizons(1.0, &mut forth, &mut back);
    for &(c, z) in &samples {
        let best = |ahead: bool| {
            let others = samples.iter().filter(|s| if ahead { s.0 > c } else { s.0 < c });
            others.map(|s| (s.1 - z) / (s.0 - c).abs()).fold(0.0f32, f32::max)
        };
        assert!((forth[c as usize] - best(true)).abs() < 1e-6 && (back[c as usize] - best(false)).abs() < 1e-6);
    }
}

/// A wall along y has a closed form in every slice, and nothing comes from beyond the edge.
#[test]
fn a_wall_stands_where_it_should() {
    let (texel, wall, high) = (0.25, 20.0 * 0.25, 2.0);
    let blade = relief(40, 161, texel, |_, _| true, |x, _| if x >= wall { high } else { 0.0 });
    let horizon = Horizon::sampled(&blade.lit(Side::Front), 1);
    let row = 80;
    for c in [2usize, 8, 13] {
        for k in 0..SLICES {
            let azimuth = TAU * k as f64 / SLICES as f64;
            let found = f64::from(horizon.slice(k)[row * 40 + c]);
            // The wall's top edge is one texel wide: between columns 19 and 20.
            let away = (wall - texel * c as f64) / azimuth.cos();
            let want = if azimuth.cos() > 0.3 { high / high.hypot(away) } else { 0.0 };
            // Steep lines meet the edge between two columns, on its ramp of one texel.
            let bound = if azimuth.cos() < 0.5 { 0.03 } else { 2e-6 };
            assert!((found - want).abs() < bound, "column {c}, slice {k}: {found}, expected {want}");
        }
    }
    // On the wall itself and beyond it nothing is higher.
    assert!((0..SLICES).all(|k| horizon.slice(k)[row * 40 + 30] == 0.0));
    // The back's camera does not see the relief of the front.
    let back = Horizon::new(&blade.lit(Side::Back));
    assert!((0..SLICES).all(|k| back.slice(k).iter().all(|s| *s == 0.0)));
}

/// Rows run downwards and y upwards. A ridge above a texel in the image is seen in slice 4 (+y), and slices turn from x
/// to y.
#[test]
fn slices_turn_from_x_to_y() {
    let blade = relief(21, 31, 1.0, |_, _| true, |_, y| if y == -5.0 { 3.0 } else { 0.0 });
    let horizon = Horizon::sampled(&blade.lit(Side::Front), 1);
    let at = |k: usize| f64::from(horizon.slice(k)[15 * 21 + 10]);
    assert!((at(4) - 3.0 / 3f64.hypot(10.0)).abs() < 1e-6, "{}", at(4));
    assert!((at(3) - at(5)).abs() < 1e-6 && at(3) > 0.2);
    assert!((8..16).all(|k| at(k) == 0.0));
}

/// Root mean square and largest difference from rays that are walked in the azimuths of the slices.
fn against_rays(blade: &BladeMaps) -> (f64, f64) {
    let lit = blade.lit(Side::Front);
    let horizon = Horizon::sampled(&lit, 1);
    let (mut sum, mut worst, mut count) = (0.0, 0.0f64, 0.0f64);
    // A texel of the edge extends half a texel outwards and sees along the edge; rays from its centre do not.
    let deep = |k: usize| {
        let (i, j) = (k % lit.width, k / lit.width);
        i > 1
            && j > 1
            && i + 2 < lit.width
            && j + 2 < lit.height
            && (0..25).all(|n| lit.mask[(j + n / 5 - 2) * lit.width + i + n % 5 - 2])
    };
    for texel in (0..lit.mask.len()).filter(|k| deep(*k)).step_by(31) {
        for k in 0..SLICES {
            let e = f64::from(horizon.slice(k)[texel]) - walked(&lit, texel, TAU * k as f64 / SLICES as f64);
            sum += e * e;
            worst = worst.max(e.abs());
            count += 1.0;
        }
    }
    ((sum / count).sqrt(), worst)
}

/// Smooth relief: slices agree with rays walked in the same azimuths, twice as closely on texels half as large.
#[test]
fn horizons_agree_with_walked_rays() {
    let z =
        |x: f64, y: f64| 0.12 * (2.1 * x + 0.4).sin() * (1.7 * y).cos() + 0.05 * (4.4 * (x + y)).sin() - 0.03 * x * x;
    let (coarse, _) = against_rays(&relief(63, 59, 0.1, |_, _| true, z));
    let (fine, worst) = against_rays(&relief(125, 117, 0.05, |_, _| true, z));
    assert!(fine < 0.6 * coarse && fine < 5e-3 && worst < 0.1, "{coarse} {fine} {worst}");
    // On a round leaf with a hole, texels of the edges see a little more or less of each other. Elsewhere the agreement
    // is as before.
    let round = |x: f64, y: f64| (x - 3.1).hypot(y + 2.9) < 2.8 && (x - 2.0).hypot(y + 2.0) > 0.5;
    let (rms, _) = against_rays(&relief(125, 117, 0.05, round, z));
    assert!(rms < 0.02, "{rms}");
}

/// There is nothing off the leaf: a tall texel outside the mask is not seen, and its own horizon is 0.
#[test]
fn only_the_leaf_stands() {
    let blade = relief(15, 15, 1.0, |x, _| x < 9.0, |x, _| if x > 9.0 { 50.0 } else { 0.0 });
    let horizon = Horizon::new(&blade.lit(Side::Front));
    assert!((0..SLICES).all(|k| horizon.slice(k).iter().all(|s| *s == 0.0)));
    // A lone texel, a single row, a single column.
    for (w, h) in [(1, 1), (1, 9), (9, 1)] {
        let blade = BladeMaps::flat(w, h, 0.1, 0.2, 1.0);
        assert_eq!(Horizon::new(&blade.lit(Side::Front)), Horizon::level(w, h));
    }
}
