//! Compares the walk between height fields with the plane slab, with brute-force ray tracing, and with a delta-tracking
//! walk with inside tests.

use super::phase::{henyey_greenstein, scattered};
use super::rough::RoughSurface;
use super::slab::EntryDirection;
use super::tally::uniform;
use super::*;
use rand::SeedableRng;
use rand_pcg::Pcg64;

const MATCHED: Boundary = Boundary::Matched;

fn histories(count: u64) -> Histories {
    Histories { count, seed: 11 }
}

fn agree(what: &str, a: HistoryEstimate, b: HistoryEstimate) {
    assert!((a.value - b.value).abs() <= 4.0 * a.error.hypot(b.error) + 1e-12, "{what}: {a:?} {b:?}");
}

fn flat(n: usize, texel: f64, d: f64, rim: FieldRim) -> LeafHeightField {
    LeafHeightField::new(n, n, texel, vec![0.3; n * n], vec![0.3 - d; n * n], rim).unwrap()
}

/// A bumpy leaf whose faces differ: 7 × 5 texels of 0.1 mm, 0.08 to 0.3 mm thick.
fn bumpy() -> (Vec<f64>, Vec<f64>) {
    let wave = |k: usize, a: f64, b: f64| (a * k as f64).sin() * (b * k as f64 + 1.0).cos();
    let front = (0..35).map(|k| 0.1 + 0.06 * wave(k, 1.7, 0.9)).collect();
    let back = (0..35).map(|k| -0.09 + 0.05 * wave(k, 2.3, 1.3)).collect();
    (front, back)
}

fn bumpy_field() -> LeafHeightField {
    let (front, back) = bumpy();
    LeafHeightField::new(7, 5, 0.1, front, back, FieldRim::Periodic).unwrap()
}

/// Height of a periodic bilinear map at (x, y) mm, written independently of the march through cells.
fn height(map: &[f64], w: usize, h: usize, texel: f64, x: f64, y: f64) -> f64 {
    let (gx, gy) = (x / texel - 0.5, y / texel - 0.5);
    let (i, j) = (gx.floor(), gy.floor());
    let at = |i: f64, j: f64| map[(j.rem_euclid(h as f64)) as usize * w + i.rem_euclid(w as f64) as usize];
    let (u, v) = (gx - i, gy - j);
    (1.0 - v) * ((1.0 - u) * at(i, j) + u * at(i + 1.0, j))
        + v * ((1.0 - u) * at(i, j + 1.0) + u * at(i + 1.0, j + 1.0))
}

#[test]
fn a_flat_field_is_the_plane_slab() {
    let medium = Medium { sigma_a: 0.5, sigma_s: 8.0, g: 0.3 };
    let d = 0.2;
    let direction = [0.36, -0.48, 0.8];
    for (boundary, spread) in [
        (MATCHED, false),
        (Boundary::Diffuse { reflectance: 0.4 }, true),
        (Boundary::Rough(RoughSurface { index: 1.4, slope: 0.3 }), false),
    ] {
        let entry = if spread { EntryDirection::Diffuse } else { EntryDirection::Beam([0.36, 0.48, 0.8]) };
        let slab = Slab { medium, thickness_mm: d, boundary }.walk(entry, histories(30_000), &[]).unwrap();
        for rim in [FieldRim::Periodic, FieldRim::Clamped { margin_mm: 1.0 }] {
            let leaf = ReliefLeaf { medium, boundary, spread };
            let got =
                leaf.walk(&flat(4, 0.25, d, rim), IncidentLight::Direction(direction), histories(30_000)).unwrap();
            let what = format!("{boundary:?} {rim:?}");
            agree(&what, got.transmitted, slab.transmitted);
            agree(&what, got.reflected, slab.reflected);
            agree(&what, got.glossy, slab.glossy);
            assert!(
                (got.balance.value - 1.0).abs() <= 4.0 * got.balance.error
                    && got.lost.value == 0.0
                    && got.passed.value == 0.0
            );
            // the maps: cosθ T everywhere, cosθ enters
            let chi2: f64 = got.exitance.iter().map(|e| e.deviation(0.8 * slab.transmitted.value).powi(2)).sum();
            assert!((4.0..36.0).contains(&chi2), "{what}: χ² {chi2} over 16");
            if spread {
                // light leaves Lambertian: what is seen is the exitance
                let sums = [&got.seen, &got.exitance].map(|m| m.iter().map(|e| e.value).sum::<f64>());
                let error = got.seen.iter().map(|e| e.error.powi(2)).sum::<f64>().sqrt();
                assert!((sums[0] - sums[1]).abs() < 4.0 * error, "{what}: {sums:?} ± {error}");
            }
            let enters = 0.8 * (1.0 - slab.glossy.value);
            let chi2: f64 = got.entering.iter().map(|e| e.deviation(enters).powi(2)).sum();
            assert!((4.0..36.0).contains(&chi2), "{what}: χ² {chi2} over 16");
        }
    }
    let slab = Slab { medium, thickness_mm: d, boundary: MATCHED }
        .walk(EntryDirection::Diffuse, histories(30_000), &[])
        .unwrap();
    let leaf = ReliefLeaf { medium, boundary: MATCHED, spread: false };
    let got = leaf.walk(&flat(1, 0.25, d, FieldRim::Periodic), IncidentLight::Diffuse, histories(30_000)).unwrap();
    agree("diffuse", got.transmitted, slab.transmitted);
    agree("diffuse map", got.exitance[0], slab.transmitted);
}

/// A pure absorber passes e^(−σa × the path inside): dense rays, each sampled finely.
#[test]
fn rays_through_a_bumpy_absorber_are_as_long_as_brute_force_says() {
    let (front, back) = bumpy();
    let leaf = ReliefLeaf { medium: Medium { sigma_a: 6.0, sigma_s: 0.0, g: 0.0 }, boundary: MATCHED, spread: false };
    for w in [[0.0, 0.0, 1.0], [0.8, 0.0, 0.6], [-0.5, 0.7, 0.2]] {
        let got = leaf.walk(&bumpy_field(), IncidentLight::Direction(w), histories(100_000)).unwrap();
        let length = (w[0] * w[0] + w[1] * w[1] + w[2] * w[2]).sqrt();
        let (n, steps) = (24, 160);
        let mut sum = 0.0;
        for k in 0..n * n {
            let (x, y) = ((k % n) as f64 / n as f64 * 0.7, (k / n) as f64 / n as f64 * 0.5);
            let (high, low) = (0.2, -0.2);
            let inside = (0..steps)
                .filter(|s| {
                    let z = high + (low - high) * (*s as f64 + 0.5) / steps as f64;
                    let t = (high - z) / w[2];
                    let (px, py) = (x - t * w[0], y + t * w[1]);
                    z < height(&front, 7, 5, 0.1, px, py) && z > height(&back, 7, 5, 0.1, px, py)
                })
                .count();
            sum += (-6.0 * inside as f64 / steps as f64 * (high - low) * length / w[2]).exp();
        }
        let want = sum / (n * n) as f64;
        assert!(
            (got.transmitted.value - want).abs() < 4.0 * got.transmitted.error + 1e-3 * want,
            "{w:?}: {:?} {want}",
            got.transmitted
        );
        assert!((got.absorbed.value + got.transmitted.value - 1.0).abs() < 1e-9);
    }
}

/// Woodcock's delta tracking in the bounding slab with inside tests: it uses no cells, roots or flags.
fn delta_tracking(medium: Medium, toward: [f64; 3], count: u64) -> (HistoryEstimate, HistoryEstimate) {
    let (front, back) = bumpy();
    let mut rng = Pcg64::seed_from_u64(77);
    let (mut up, mut down) = (tally::ScoreSums::default(), tally::ScoreSums::default());
    let (high, low) = (0.2, -0.2);
    for _ in 0..count {
        let mut p = [0.7 * uniform(&mut rng), 0.5 * uniform(&mut rng), high];
        let mut d = [-toward[0], toward[1], -toward[2]];
        let mut w = 1.0;
        loop {
            let s = -uniform(&mut rng).ln() / medium.extinction();
            let wall = if d[2] > 0.0 { (high - p[2]) / d[2] } else { (low - p[2]) / d[2] };
            if s >= wall {
                if d[2] > 0.0 {
                    up.add(w)
                } else {
                    down.add(w)
                }
                break;
            }
            for k in 0..3 {
                p[k] += s * d[k];
            }
            if p[2] < height(&front, 7, 5, 0.1, p[0], p[1]) && p[2] > height(&back, 7, 5, 0.1, p[0], p[1]) {
                w *= medium.albedo();
                if w < 1e-4 {
                    break;
                }
                d = scattered(d, henyey_greenstein(medium.g, &mut rng), &mut rng);
            }
        }
    }
    (up.mean(count), down.mean(count))
}

#[test]
fn a_bumpy_leaf_agrees_with_delta_tracking() {
    let medium = Medium { sigma_a: 1.0, sigma_s: 9.0, g: 0.2 };
    for toward in [[0.0, 0.0, 1.0], [0.8, 0.0, 0.6]] {
        let (up, down) = delta_tracking(medium, toward, 100_000);
        let got = ReliefLeaf { medium, boundary: MATCHED, spread: false }
            .walk(&bumpy_field(), IncidentLight::Direction(toward), histories(100_000))
            .unwrap();
        agree("reflected", got.reflected, up);
        agree("transmitted and passed", got.transmitted, down);
        let whole: f64 = got.exitance.iter().map(|e| e.value).sum::<f64>() / 35.0;
        assert!((whole / toward[2] - got.transmitted.value).abs() < 1e-9);
    }
}

/// Direct light on a ridge, its shadow and its flank: V max(0, n·ω)/n_z for each texel, from the visibility at dense
/// points.
#[test]
fn the_lit_side_shadows_itself() {
    let n = 40;
    let ridge: Vec<f64> = (0..n).map(|k| 0.2 * (-((k as f64 - 19.5) / 3.0).powi(2)).exp()).collect();
    let field = LeafHeightField::new(n, 1, 0.05, ridge.clone(), vec![-0.2; n], FieldRim::Periodic).unwrap();
    let (sin, cos) = 75f64.to_radians().sin_cos();
    let leaf = ReliefLeaf { medium: Medium { sigma_a: 0.0, sigma_s: 20.0, g: 0.0 }, boundary: MATCHED, spread: true };
    let got = leaf.walk(&field, IncidentLight::Direction([sin, 0.0, cos]), histories(40_000)).unwrap();
    let h = |x: f64| height(&ridge, n, 1, 0.05, x, 0.0);
    let (mut chi2, mut dark) = (0.0, 0);
    for (k, e) in got.entering.iter().enumerate() {
        let fine = 64;
        let want = (0..fine)
            .map(|s| {
                let x = 0.05 * (k as f64 + (s as f64 + 0.5) / fine as f64);
                let slope = (h(x + 1e-7) - h(x - 1e-7)) / 2e-7;
                let visible = (1..800).all(|t| h(x + 0.001 * f64::from(t)) <= h(x) + 0.001 * f64::from(t) * cos / sin);
                if visible { (cos - slope * sin).max(0.0) } else { 0.0 }
            })
            .sum::<f64>()
            / fine as f64;
        if want == 0.0 {
            assert!(e.value < 1e-9, "texel {k}: {e:?}");
            dark += 1;
        } else {
            // The reference's own resolution is one sub-point of 64.
            chi2 += (e.value - want).powi(2) / (e.error.powi(2) + (want / 64.0).powi(2));
        }
    }
    assert!(dark >= 6 && chi2 < 70.0, "{dark} dark, χ² {chi2}");
    assert!(got.entered_again.value > 0.01, "light from the flank meets the leaf again: {:?}", got.entered_again);
    assert!((got.balance.value - 1.0).abs() < 1e-9);
}

#[test]
fn a_hole_passes_light_and_an_inverted_leaf_is_no_leaf() {
    let (n, texel) = (10, 0.1);
    let mut front = vec![0.1; n * n];
    let mut back = vec![-0.1; n * n];
    for j in 0..n {
        for i in 0..5 {
            (front[j * n + i], back[j * n + i]) = (0.0, 0.0);
        }
    }
    let leaf = ReliefLeaf {
        medium: Medium { sigma_a: 1e4, sigma_s: 0.0, g: 0.0 },
        boundary: Boundary::Diffuse { reflectance: 0.2 },
        spread: true,
    };
    let field = LeafHeightField::new(n, n, texel, front.clone(), back.clone(), FieldRim::Periodic).unwrap();
    let got = leaf.walk(&field, IncidentLight::Direction([0.0, 0.0, 1.0]), histories(20_000)).unwrap();
    // Four of ten columns have no tissue at all; wedges of tissue lead to the others.
    assert!((got.passed.value - 0.4).abs() < 4.0 * got.passed.error, "{:?}", got.passed);
    let field = LeafHeightField::new(n, n, texel, back, front, FieldRim::Periodic).unwrap();
    let got = leaf.walk(&field, IncidentLight::Direction([0.5, 0.1, 0.3]), histories(2000)).unwrap();
    assert!((got.passed.value - 1.0).abs() < 1e-12, "{:?}", got.passed);
}

/// Lambertian light passes a leaf alike from either side, whatever its shape and faces (reciprocity of étendue).
#[test]
fn diffuse_light_passes_alike_both_ways() {
    let (front, back) = bumpy();
    let negated = |map: &[f64]| map.iter().map(|h| -h).collect::<Vec<_>>();
    let turned = LeafHeightField::new(7, 5, 0.1, negated(&back), negated(&front), FieldRim::Periodic).unwrap();
    let medium = Medium { sigma_a: 1.0, sigma_s: 9.0, g: 0.5 };
    for (boundary, spread) in [
        (MATCHED, false),
        (Boundary::Rough(RoughSurface { index: 1.4, slope: 0.4 }), false),
        (Boundary::Diffuse { reflectance: 0.5 }, true),
    ] {
        let leaf = ReliefLeaf { medium, boundary, spread };
        let there = leaf.walk(&bumpy_field(), IncidentLight::Diffuse, histories(20_000)).unwrap();
        let again = leaf.walk(&turned, IncidentLight::Diffuse, Histories { count: 20_000, seed: 12 }).unwrap();
        agree(&format!("{boundary:?}"), there.transmitted, again.transmitted);
    }
}

#[test]
fn energy_is_conserved_on_spikes_at_grazing_light() {
    let spikes: Vec<f64> = (0..36).map(|k| if k % 3 == 0 { 0.5 } else { 0.0 }).collect();
    let back: Vec<f64> = (0..36).map(|k| -0.1 - 0.3 * f64::from(u8::from(k % 4 == 0))).collect();
    for rim in [FieldRim::Periodic, FieldRim::Clamped { margin_mm: 0.5 }] {
        let field = LeafHeightField::new(6, 6, 0.1, spikes.clone(), back.clone(), rim).unwrap();
        for (boundary, spread) in [
            (MATCHED, false),
            (MATCHED, true),
            (Boundary::Diffuse { reflectance: 0.4 }, true),
            (Boundary::Rough(RoughSurface { index: 1.4, slope: 0.4 }), false),
        ] {
            for (sigma_a, g) in [(0.0, 0.9), (3.0, -0.9)] {
                let leaf = ReliefLeaf { medium: Medium { sigma_a, sigma_s: 10.0, g }, boundary, spread };
                for light in [IncidentLight::Direction([1.0, 0.3, 0.05]), IncidentLight::Diffuse] {
                    let got = leaf.walk(&field, light, histories(1500)).unwrap();
                    let what = format!("{leaf:?} {light:?} {rim:?}");
                    assert!((got.balance.value - 1.0).abs() <= 5.0 * got.balance.error, "{what}: {:?}", got.balance);
                    assert_eq!(got.lost.value, 0.0, "{what}");
                }
            }
        }
    }
}

#[test]
fn fields_that_are_none_are_refused() {
    assert!(LeafHeightField::new(2, 2, 0.1, vec![0.0; 3], vec![0.0; 4], FieldRim::Periodic).is_err());
    assert!(LeafHeightField::new(0, 0, 0.1, vec![], vec![], FieldRim::Periodic).is_err());
    assert!(LeafHeightField::new(1, 1, 0.0, vec![0.0], vec![0.0], FieldRim::Periodic).is_err());
    assert!(LeafHeightField::new(1, 1, 0.1, vec![f64::NAN], vec![0.0], FieldRim::Periodic).is_err());
    let leaf = ReliefLeaf { medium: Medium { sigma_a: 1.0, sigma_s: 1.0, g: 0.0 }, boundary: MATCHED, spread: false };
    assert!(
        leaf.walk(&flat(1, 1.0, 0.1, FieldRim::Periodic), IncidentLight::Direction([0.0, 0.0, -1.0]), histories(10))
            .is_err()
    );
}
