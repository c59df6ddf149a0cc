use super::*;
use crate::side::{Side, mirror};
use crate::translucency::basis::{FLAT, HemisphereBasis, SampleWeights};
use crate::translucency::blade::BladeMaps;
use crate::translucency::lights::{DirectionRule, DirectionSet, raised};

/// A blade with ridges, an uneven outline and entries that vary.
fn ridged(w: usize, h: usize) -> BladeMaps {
    let n = w * h;
    let mask: Vec<bool> = (0..n)
        .map(|k| ((k % w) as f64 - 0.52 * w as f64).hypot((k / w) as f64 - 0.47 * h as f64) < 0.48 * h as f64)
        .collect();
    let z = |k: usize| 0.15 * ((k % w) as f64 * 0.7).sin() + 0.1 * ((k / w) as f64 * 0.45 + (k % w) as f64 * 0.2).cos();
    let front = (0..n).map(|k| 0.4 + z(k)).collect();
    let back = (0..n).map(|k| 0.4 - 0.5 * z(n - 1 - k)).collect();
    let entry = [
        (0..n).map(|k| 0.8 + 0.1 * (k as f64).sin()).collect(),
        (0..n).map(|k| 0.7 + 0.1 * (k as f64).cos()).collect(),
    ];
    BladeMaps::from_heights(w, h, 0.1, mask, [front, back], entry)
}

#[test]
fn a_flat_leaf_takes_the_cosine() {
    let blade = BladeMaps::flat(9, 7, 0.1, 0.2, 0.85);
    let lit = blade.lit(Side::Back);
    let horizon = Horizon::new(&lit);
    for d in [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [-0.48, 0.6, 0.64]] {
        for visibility in [Visibility::Hard, Visibility::Soft { width: 0.01 }, Visibility::Off] {
            assert!(irradiance(&lit, &horizon, d, visibility).iter().all(|e| (e - 0.85 * d[2]).abs() < 1e-15));
        }
    }
    assert!(irradiance(&lit, &horizon, [0.6, 0.0, -0.8], Visibility::Hard).iter().all(|e| *e == 0.0));
    let projector =
        Projector::new(HemisphereBasis::HalfLife2, &DirectionSet::new(DirectionRule::default()), SampleWeights::Gram)
            .unwrap();
    for image in project(&lit, &horizon, &projector, Visibility::Hard) {
        assert!(image.iter().all(|h| (h / (0.85 * FLAT) - 1.0).abs() < 1e-12));
    }
}

/// A tilted plane shadows itself exactly where its normal turns away. V must not cut off any light that n·ω allows, and
/// n·ω must be clamped.
#[test]
fn a_tilted_plane_shadows_itself_by_its_normal() {
    let (w, h) = (24, 20);
    let z: Vec<f64> = (0..w * h).map(|k| 0.05 * (k % w) as f64).collect();
    let blade = BladeMaps::from_heights(
        w,
        h,
        0.1,
        vec![true; w * h],
        [z, vec![0.2; w * h]],
        [vec![1.0; w * h], vec![1.0; w * h]],
    );
    let lit = blade.lit(Side::Front);
    let horizon = Horizon::new(&lit);
    let normal = [-0.5 / 1.25f64.sqrt(), 0.0, 1.0 / 1.25f64.sqrt()];
    let middle = 10 * w + 10;
    // From the rising side the plane's own slope (.5, an elevation of .4636) is the horizon. On the other side there is
    // none.
    for (elevation, azimuth) in
        [(0.5f64, 0.0f64), (0.3, 0.0), (0.3, std::f64::consts::PI), (0.05, std::f64::consts::PI), (1.2, 2.0)]
    {
        let d = raised(elevation.sin(), azimuth);
        let want = (normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2]).max(0.0);
        let found = irradiance(&lit, &horizon, d, Visibility::Hard)[middle];
        assert!((found - want).abs() < 1e-12, "{elevation} {azimuth}: {found}, expected {want}");
    }
}

/// The sides are lit independently, and a mirrored blade gives the mirrored picture.
#[test]
fn a_mirrored_blade_is_lit_the_mirrored_way() {
    let (w, h) = (31, 27);
    let blade = ridged(w, h);
    blade.validate().unwrap();
    let heights = [mirror(&blade.front.height, w), mirror(&blade.back.height, w)];
    let entry = [mirror(&blade.front.entry, w), mirror(&blade.back.entry, w)];
    let turned = BladeMaps::from_heights(w, h, 0.1, mirror(&blade.mask, w), heights, entry);
    for side in [Side::Front, Side::Back] {
        let (a, b) = (blade.lit(side), turned.lit(side));
        let (ha, hb) = (Horizon::new(&a), Horizon::new(&b));
        let d = raised(0.3, 0.9);
        let soft = Visibility::Soft { width: 0.2 };
        let (ea, eb) = (irradiance(&a, &ha, d, soft), irradiance(&b, &hb, [-d[0], d[1], d[2]], soft));
        let back = mirror(&eb, w);
        let off = ea.iter().zip(&back).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        assert!(off < 1e-4, "{off}");
        assert!(ea.iter().any(|e| *e > 0.3), "something is lit");
        assert!(ea.iter().zip(a.mask.iter()).any(|(e, m)| *m && *e == 0.0), "something is dark");
    }
}

/// Projection before convolution gives the same as convolving the image of every light and projecting the results.
#[test]
fn projection_and_convolution_commute() {
    let (w, h) = (23, 19);
    let blade = ridged(w, h);
    let lit = blade.lit(Side::Front);
    let horizon = Horizon::new(&lit);
    let lights = DirectionSet::new(DirectionRule::default());
    // A kernel that depends on the source's thickness.
    let convolve = |image: &[f64]| -> Vec<f64> {
        (0..w * h)
            .map(|o| {
                let term = |i: usize| {
                    let (dx, dy) = ((o % w) as f64 - (i % w) as f64, (o / w) as f64 - (i / w) as f64);
                    image[i] * (-(dx * dx + dy * dy) / (4.0 * lit.thickness[i] + 0.5)).exp()
                };
                (0..w * h).filter(|&i| lit.mask[i]).map(term).sum()
            })
            .collect()
    };
    for (basis, visibility) in [
        (HemisphereBasis::HalfLife2, Visibility::Hard),
        (HemisphereBasis::Cosine { degree: 3 }, Visibility::Soft { width: 0.1 }),
    ] {
        let projector = Projector::new(basis, &lights, SampleWeights::Gram).unwrap();
        let first: Vec<Vec<f64>> =
            project(&lit, &horizon, &projector, visibility).iter().map(|i| convolve(i)).collect();
        let mut after = vec![vec![0.0; w * h]; basis.count()];
        for (m, d) in lights.directions.iter().enumerate() {
            let image = convolve(&irradiance(&lit, &horizon, *d, visibility));
            for (i, out) in after.iter_mut().enumerate() {
                out.iter_mut().zip(&image).for_each(|(o, e)| *o += projector.matrix[i][m] * e);
            }
        }
        let scale = after.iter().flatten().fold(0.0f64, |a, b| a.max(b.abs()));
        let off = first.iter().flatten().zip(after.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-12 * scale && scale > 1.0, "{off} of {scale}");
    }
}

/// One direction for each texel: a blade that is bent by a known turn shows what the light turned back shows.
#[test]
fn a_curved_blade_takes_each_texels_own_light() {
    let blade = ridged(20, 16);
    let lit = blade.lit(Side::Front);
    let horizon = Horizon::new(&lit);
    let light = |k: usize| raised(0.2 + 0.7 * (k % 20) as f64 / 20.0, 0.3);
    let found = irradiance_with(&lit, &horizon, Visibility::Hard, light);
    for k in [5usize * 20 + 9, 7 * 20 + 12, 8 * 20 + 4] {
        assert_eq!(found[k], irradiance(&lit, &horizon, light(k), Visibility::Hard)[k]);
    }
}

/// The total is the sum of what all lights give.
#[test]
fn the_total_is_the_sum_over_lights() {
    let blade = ridged(20, 16);
    let lit = blade.lit(Side::Back);
    let horizon = Horizon::new(&lit);
    let lights = DirectionSet::new(DirectionRule::Product { levels: 4, azimuths: 8 });
    let total = &project(&lit, &horizon, &Projector::total(&lights), Visibility::Hard)[0];
    let mut sum = vec![0.0; 20 * 16];
    for (d, weight) in lights.directions.iter().zip(&lights.weights) {
        sum.iter_mut().zip(irradiance(&lit, &horizon, *d, Visibility::Hard)).for_each(|(s, e)| *s += weight * e);
    }
    assert!(total.iter().zip(&sum).all(|(a, b)| (a - b).abs() < 1e-12));
}
