use super::exact::{self, LeafOperator, PARAMETERS, Resolution};
use super::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::{FRAC_PI_2, PI};

pub const SIDES: [Side; 2] = [Side::Front, Side::Back];
pub const INF: f64 = f64::INFINITY;

pub fn leaf(indices: [f64; 3], oblateness: [f64; 3], depth: f64) -> LayeredLeaf {
    let [n_cuticle, n_mesophyll, n_antidermal] = indices;
    let [epidermis, palisade, spongy] = oblateness;
    let oblateness = Oblateness { cuticle: 2.0, epidermis, palisade, spongy };
    LayeredLeaf { depth, n_cuticle, n_mesophyll, n_antidermal, oblateness, path: MesophyllPath::Slant }
}

fn exactly(leaf: &LayeredLeaf, side: Side, incidence: f64) -> LeafResponse {
    exact::response(leaf, side, incidence).unwrap()
}

/// A plain random walk written from the table of interfaces, one ray at a time in double precision. Returns true for a
/// ray that leaves upward.
fn literal(leaf: &LayeredLeaf, side: Side, incidence: f64, rng: &mut Pcg64) -> Option<bool> {
    let index = |m: LeafMedium| match m {
        LeafMedium::Air => 1.0,
        LeafMedium::Epidermis => leaf.n_cuticle,
        LeafMedium::Mesophyll => leaf.n_mesophyll,
        LeafMedium::Antidermal => leaf.n_antidermal,
    };
    let oblateness = |t: LeafTissue| match t {
        LeafTissue::Cuticle => leaf.oblateness.cuticle,
        LeafTissue::Epidermis => leaf.oblateness.epidermis,
        LeafTissue::Palisade => leaf.oblateness.palisade,
        LeafTissue::Spongy => leaf.oblateness.spongy,
    };
    let mut xi = || 1.0 - rng.random::<f64>();
    let (mut down, mut at) = if side == Side::Front { (true, 0i32) } else { (false, 5) };
    let mut mu = incidence.cos();
    loop {
        let face = &INTERFACES[at as usize];
        let (from, to) = if down { (face.above, face.below) } else { (face.below, face.above) };
        if from == LeafMedium::Mesophyll && -xi().ln() * mu < leaf.depth {
            return None;
        }
        let (n1, n2) = (index(from), index(to));
        let sin = n1 / n2 * (1.0 - mu * mu).max(0.0).sqrt();
        let inside = (1.0 - sin * sin).max(0.0).sqrt();
        let reflected = sin >= 1.0 || xi() < fresnel(n1, mu, n2, inside);
        let lobe = match (down, reflected) {
            (true, true) => face.down_reflected,
            (true, false) => face.down_refracted,
            (false, true) => face.up_reflected,
            (false, false) => face.up_refracted,
        };
        if !reflected {
            mu = inside;
        }
        if let Some(ob) = lobe.map(oblateness).filter(|o| o.is_finite()) {
            mu = loop {
                let (alpha, beta) = (lobe::polar(xi(), ob), 2.0 * PI * xi());
                let turned = mu * alpha.cos() - (1.0 - mu * mu).max(0.0).sqrt() * alpha.sin() * beta.cos();
                if turned > 0.0 {
                    break turned;
                }
            };
        }
        down ^= reflected;
        at += if down { 1 } else { -1 };
        if !(0..6).contains(&at) {
            return Some(!down);
        }
    }
}

/// Leaves of all kinds: total reflection at each interface, wide and narrow lobes, clear and dark.
fn kinds() -> Vec<LayeredLeaf> {
    vec![
        LayeredLeaf::soybean(0.3),
        leaf([1.3, 1.6, 1.5], [0.0, 0.5, 0.0], 0.05),
        leaf([1.2, 1.1, 2.5], [0.3, 4.5, 50.0], 0.2),
        leaf([1.5, 1.5, 1.0], [5.0, 0.0, 5.0], 0.0),
        leaf([1.6, 1.41, 1.42], [INF, 1.0, INF], 0.4),
        leaf([1.0, 1.4, 1.42], [3.0, INF, 1.0], 0.1),
        LayeredLeaf { path: MesophyllPath::Sieve, ..LayeredLeaf::soybean(0.8) },
    ]
}

/// Three methods must agree on one equation: random rays in vectors, random rays one at a time from the table, and the
/// exact method without random numbers.
#[test]
fn rays_and_the_exact_method_agree() {
    for (k, leaf) in kinds().iter().enumerate() {
        for side in SIDES {
            for incidence in [0.0f64, 50.0, 85.0].map(f64::to_radians) {
                let want = exactly(leaf, side, incidence);
                let counts = walk::count(leaf, side, incidence, 100_000, k as u64, &|| false);
                for (count, want) in [(counts.reflected, want.reflectance), (counts.transmitted, want.transmittance)] {
                    let (share, error) = counts.share(count);
                    assert!(
                        (share - want).abs() < 4.5 * error,
                        "{leaf:?} {side:?} {incidence}: {share} {error} {want}"
                    );
                }
            }
        }
    }
}

#[test]
fn the_table_of_interfaces_says_what_the_exact_method_solves() {
    let n = 40_000;
    for (k, leaf) in kinds().iter().take(6).enumerate() {
        for side in SIDES {
            let mut rng = Pcg64::seed_from_u64(k as u64);
            let (mut up, mut down) = (0.0, 0.0);
            for _ in 0..n {
                match literal(leaf, side, 0.9, &mut rng) {
                    Some(true) => up += 1.0 / f64::from(n),
                    Some(false) => down += 1.0 / f64::from(n),
                    None => {}
                }
            }
            let want = exactly(leaf, side, 0.9);
            let (r, t) = if side == Side::Front { (up, down) } else { (down, up) };
            for (got, want) in [(r, want.reflectance), (t, want.transmittance)] {
                let error = (want * (1.0 - want) / f64::from(n)).sqrt();
                assert!((got - want).abs() < 4.5 * error + 1e-12, "{leaf:?} {side:?}: {got} {want} {error}");
            }
        }
    }
}

/// Over many seeds, deviations from the exact method have a normal distribution with the stated errors.
#[test]
fn errors_of_rays_are_true() {
    let leaf = LayeredLeaf::soybean(0.5);
    let want = exactly(&leaf, Side::Back, 0.6);
    let seeds = 60;
    let (mut sum, mut squares) = (0.0, 0.0);
    for seed in 0..seeds {
        let counts = walk::count(&leaf, Side::Back, 0.6, 30_000, seed, &|| false);
        let (share, error) = counts.share(counts.reflected);
        let z = (share - want.reflectance) / error;
        sum += z;
        squares += z * z;
    }
    let n = seeds as f64;
    // four standard deviations of the mean and of χ²
    assert!((sum / n.sqrt()).abs() < 4.0, "{sum}");
    assert!((squares - n).abs() < 4.0 * (2.0 * n).sqrt(), "{squares}");
}

#[test]
fn a_clear_leaf_loses_no_light() {
    for leaf in kinds() {
        let leaf = LayeredLeaf { depth: 0.0, ..leaf };
        for side in SIDES {
            for incidence in [0.0, 0.7, 1.5] {
                let r = exactly(&leaf, side, incidence);
                assert!((r.reflectance + r.transmittance - 1.0).abs() < 1e-11, "{leaf:?} {side:?} {r:?}");
            }
        }
    }
}

#[test]
fn without_indices_only_the_mesophyll_is_left() {
    // T = 2 E₃(a t) for light along the normal that one Lambertian lobe spreads before the crossing
    let e3 = |x: f64| {
        let rule = mesophyll_base::quadrature::unit(200);
        rule.iter().map(|(mu, w)| w * mu * (-x / mu).exp()).sum::<f64>()
    };
    for depth in [0.01, 0.3, 2.0] {
        let air = [1.0; 3];
        let diffuse = exactly(&leaf(air, [INF, 1.0, INF], depth), Side::Front, 0.0);
        assert!(diffuse.reflectance.abs() < 1e-12);
        assert!((diffuse.transmittance - 2.0 * e3(depth)).abs() < 2e-5, "{depth}: {diffuse:?}");
        for incidence in [0.0f64, 0.8, 1.5] {
            for path in [MesophyllPath::Slant, MesophyllPath::Sieve] {
                let leaf = LayeredLeaf { path, ..leaf(air, [INF; 3], depth) };
                let want = (-depth * path.length(incidence.cos())).exp();
                assert!((exactly(&leaf, Side::Back, incidence).transmittance - want).abs() < 1e-12);
                let counts = walk::count(&leaf, Side::Back, incidence, 20_000, 1, &|| false);
                let (share, error) = counts.share(counts.transmitted);
                assert!((share - want).abs() < 4.5 * error);
            }
        }
    }
}

#[test]
fn a_black_leaf_of_one_index_reflects_by_its_surface_alone() {
    for incidence in [0.0, 0.6, 1.2, 1.5] {
        let leaf = leaf([1.5, 1.5, 1.4], [5.0, 1.0, 5.0], 1e9);
        let r = exactly(&leaf, Side::Front, incidence);
        assert!((r.reflectance - leaf.surface_reflectance(incidence)).abs() < 1e-9 && r.transmittance == 0.0);
        // Light that circulates inside the epidermis adds to this where the indices differ.
        let soybean = LayeredLeaf::soybean(1e9);
        assert!(exactly(&soybean, Side::Front, incidence).reflectance > soybean.surface_reflectance(incidence) + 1e-4);
    }
}

/// Without lobes the leaf is six smooth plates, whose two-flux sums have a closed form.
#[test]
fn without_lobes_the_leaf_is_six_smooth_plates() {
    let leaf = leaf([1.6, 1.41, 1.42], [INF; 3], 0.4);
    for incidence in [0.0f64, 0.5, 1.3] {
        let s = incidence.sin();
        let media = [1.0, 1.6, 1.41, 1.0, 1.42, 1.6, 1.0];
        let cos = media.map(|n: f64| (1.0 - (s / n).powi(2)).sqrt());
        // r: reflectance of all above, for light from below; its transmittance t
        let (mut r_top, mut r, mut t) = (0.0, 0.0, 1.0);
        for k in 0..6 {
            let f = fresnel(media[k], cos[k], media[k + 1], cos[k + 1]);
            let pass = if k == 2 { (-leaf.depth / cos[2]).exp() } else { 1.0 };
            // the layer above interface k, then the interface
            let (r_in, t_in) = (r * pass * pass, t * pass);
            let series = 1.0 / (1.0 - r_in * f);
            r_top += t_in * t_in * f * series;
            r = f + (1.0 - f).powi(2) * r_in * series;
            t = t_in * (1.0 - f) * series;
        }
        let got = exactly(&leaf, Side::Front, incidence);
        assert!((got.reflectance - r_top).abs() < 1e-12 && (got.transmittance - t).abs() < 1e-12, "{incidence}");
        let back = exactly(&leaf, Side::Back, incidence);
        assert!((back.reflectance - r).abs() < 1e-12 && (back.transmittance - t).abs() < 1e-12);
    }
}

/// Compares the usual resolution with one of twice the nodes, over indices, lobes, absorptions and angles.
#[test]
fn the_usual_resolution_is_right_to_2e_5() {
    let fine = Resolution { order: 26, piece: 18, azimuth: 24 };
    let mut rng = Pcg64::seed_from_u64(11);
    let mut worst: f64 = 0.0;
    for k in 0..5 {
        let mut index = || 1.0 + (1e3 * 0.8 * rng.random::<f64>()).round() / 1e3;
        let indices = [index(), index(), index()];
        let mut lobe = || if k == 0 { 0.0 } else { 10f64.powf(1.5 * rng.random::<f64>() - 0.5) };
        let oblateness = [lobe(), lobe(), lobe()].map(|x| x.min(12.0));
        let leaf = leaf(indices, oblateness, 10f64.powf(5.0 * rng.random::<f64>() - 4.0));
        if !exact::is_plain(&leaf) {
            continue;
        }
        let (usual, fine) = (LeafOperator::new(&leaf, Resolution::USUAL), LeafOperator::new(&leaf, fine));
        let (usual, fine) = (usual.solve(leaf.depth), fine.solve(leaf.depth));
        for side in SIDES {
            for incidence in [0.0, 20.0, 37.0, 45.0, 60.0, 80.0, 89.0].map(|x: f64| x.to_radians()) {
                let (a, b) = (usual.response(side, incidence), fine.response(side, incidence));
                let off = (a.reflectance - b.reflectance).abs().max((a.transmittance - b.transmittance).abs());
                assert!(off < 2e-5, "{leaf:?} {side:?} {incidence}: {off:e}");
                worst = worst.max(off);
            }
        }
    }
    println!("largest difference {worst:e}");
}

/// Narrow lobes of the epidermis on slant paths, with light along the normal: the case that leaves are fitted with.
#[test]
fn narrow_lobes_on_slant_paths_are_right_to_2e_5() {
    for (epidermis, depth, indices) in
        [(30.0, 0.3, [1.5, 1.415, 1.41]), (100.0, 1.2, [1.55, 1.46, 1.43]), (100.0, 0.05, [1.42, 1.38, 1.37])]
    {
        let leaf = leaf(indices, [epidermis, 1.0, 5.0], depth);
        let (usual, fine) =
            (LeafOperator::new(&leaf, Resolution::USUAL), LeafOperator::new(&leaf, Resolution::FINER[1]));
        let (usual, fine) = (usual.solve(leaf.depth), fine.solve(leaf.depth));
        for side in SIDES {
            let (a, b) = (usual.response(side, 0.0), fine.response(side, 0.0));
            let off = (a.reflectance - b.reflectance).abs().max((a.transmittance - b.transmittance).abs());
            println!("{epidermis} {depth} {side:?}: {off:e}");
            assert!(off < 2e-5, "{leaf:?} {side:?}: {off:e}");
        }
    }
}

#[test]
fn derivatives_are_those_of_differences() {
    let steps = 1e-4;
    for (leaf, side, incidence) in [
        (LayeredLeaf::soybean(0.4), Side::Front, 0.0),
        (LayeredLeaf::soybean(0.4), Side::Back, 0.9),
        (leaf([1.4, 1.55, 1.3], [2.5, 0.7, 9.0], 0.1), Side::Front, 1.2),
    ] {
        let got = exact::derivatives(&leaf, side, incidence);
        for (k, name) in PARAMETERS.iter().enumerate() {
            let moved = |by: f64| {
                let mut l = leaf;
                let parameter = match k {
                    0 => &mut l.depth,
                    1 => &mut l.n_cuticle,
                    2 => &mut l.n_mesophyll,
                    3 => &mut l.n_antidermal,
                    4 => &mut l.oblateness.epidermis,
                    5 => &mut l.oblateness.palisade,
                    _ => &mut l.oblateness.spongy,
                };
                *parameter += by;
                exactly(&l, side, incidence)
            };
            let (up, down) = (moved(steps), moved(-steps));
            let slope = |a: f64, b: f64| (a - b) / (2.0 * steps);
            for (analytic, numeric) in [
                (got.reflectance.by[k], slope(up.reflectance, down.reflectance)),
                (got.transmittance.by[k], slope(up.transmittance, down.transmittance)),
            ] {
                assert!((analytic - numeric).abs() < 2e-5 + 1e-4 * numeric.abs(), "{name}: {analytic} {numeric}");
            }
        }
        let plain = exactly(&leaf, side, incidence);
        assert!((plain.reflectance - got.reflectance.value).abs() < 1e-14);
    }
}

/// The ABM turns light around the ray, which no reciprocal surface does. So its transmittances from the two sides
/// differ, although FSM's rule for direct light takes them to be equal.
#[test]
fn the_model_is_not_reciprocal() {
    let leaf = LayeredLeaf::soybean(0.0);
    // Under diffuse light, a reciprocal leaf would transmit the same share from both sides.
    let diffuse = |side: Side| -> f64 {
        let rule = mesophyll_base::quadrature::unit(12);
        rule.iter().map(|(m, w)| 2.0 * w * m * exactly(&leaf, side, m.acos()).transmittance).sum()
    };
    let (above, below) = (diffuse(Side::Front), diffuse(Side::Back));
    assert!((above - below).abs() > 0.02, "{above} {below}");
}

#[test]
fn a_seed_says_which_rays_whatever_the_threads() {
    let leaf = LayeredLeaf::soybean(0.3);
    let run = |seed: u64| walk::count(&leaf, Side::Front, 0.4, 200_000, seed, &|| false);
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(run(5), alone.install(|| run(5)));
    assert_ne!(run(5), run(6));
    assert_eq!(run(5).rays, 200_000);
}

#[test]
fn the_goniometer_sees_where_light_goes() {
    use goniometer::{RINGS, SECTORS};
    let leaf = LayeredLeaf::soybean(0.3);
    let incidence = 40f64.to_radians();
    let seen = walk::directions(&leaf, Side::Back, incidence, 300_000, 2, &|| false);
    let up: u64 = seen.patches[..RINGS / 2 * SECTORS].iter().sum();
    let down: u64 = seen.patches[RINGS / 2 * SECTORS..].iter().sum();
    assert_eq!((up, down), (seen.counts.reflected, seen.counts.transmitted));
    let want = exactly(&leaf, Side::Back, incidence);
    for (count, want) in [(up, want.reflectance), (down, want.transmittance)] {
        let (share, error) = seen.counts.share(count);
        assert!((share - want).abs() < 4.5 * error);
    }
    // Left and right of the plane of incidence are alike.
    let half = |sectors: std::ops::Range<usize>| -> f64 {
        sectors.flat_map(|s| (0..RINGS).map(move |r| r * SECTORS + s)).map(|k| seen.patches[k] as f64).sum()
    };
    let (left, right) = (half(0..SECTORS / 2), half(SECTORS / 2..SECTORS));
    assert!((left - right).abs() < 4.5 * (left + right).sqrt());
    // The light that a black leaf reflects goes where FSM's surface lobe sends it.
    let black = LayeredLeaf { depth: 1e9, n_mesophyll: 1.6, ..leaf };
    let seen = walk::directions(&black, Side::Front, incidence, 400_000, 3, &|| false);
    let surface = black.surface_reflectance(incidence);
    let shares = fsm::FoliarShares { surface, diffuse: 0.0, through: 0.0 };
    let patches = (0..RINGS / 2).flat_map(|ring| (0..SECTORS).map(move |sector| (ring, sector)));
    let (mut chi2, mut judged) = (0.0, 0.0f64);
    for (ring, sector) in patches {
        let want = fsm::patch(incidence, black.oblateness.cuticle, shares, ring, sector);
        let variance = want / seen.counts.rays as f64;
        // at least five rays are expected
        if want > 5.0 / seen.counts.rays as f64 {
            chi2 += (seen.reading(ring, sector).fraction.0 - want).powi(2) / variance;
            judged += 1.0;
        }
    }
    assert!(judged > 200.0 && (chi2 - judged).abs() < 5.0 * (2.0 * judged).sqrt(), "{chi2} of {judged}");
}

#[test]
fn bad_leaves_are_named() {
    let fault = |l: LayeredLeaf| l.fault().unwrap();
    assert!(fault(LayeredLeaf::soybean(-1.0)).contains("absorption"));
    assert!(fault(LayeredLeaf { n_cuticle: 0.9, ..LayeredLeaf::soybean(0.0) }).contains("n_cuticle is 0.9"));
    assert!(fault(LayeredLeaf { n_antidermal: f64::NAN, ..LayeredLeaf::soybean(0.0) }).contains("n_antidermal"));
    assert!(fault(leaf([1.5; 3], [1.0, -1.0, 1.0], 0.0)).contains("oblateness_palisade is -1"));
    assert!(leaf([1.5; 3], [0.0, INF, 1.0], 1e300).fault().is_none());
    assert!(exactly(&LayeredLeaf::soybean(0.2), Side::Front, FRAC_PI_2).reflectance > 0.999_999);
}
