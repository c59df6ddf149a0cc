//! Derivatives of bands are compared with those of three channels, with closed forms and with differences.

use super::bands_tests::{PERIOD, channels, crown, sunlit};
use super::slopes::{DerivativeTracer, RadianceParameter};
use super::*;
use crate::test_worlds::plates;

/// ρd of both sides and ρt of the leaves, and the ground.
const OF: [RadianceParameter; 4] = [
    RadianceParameter::RhoD { leaf: 0, back: false },
    RadianceParameter::RhoD { leaf: 0, back: true },
    RadianceParameter::RhoT(0),
    RadianceParameter::RhoD { leaf: 1, back: false },
];

#[test]
fn derivatives_of_three_bands_are_those_of_the_three_channels() {
    let world = crown();
    let canopy = Canopy::new(&world, 5).unwrap();
    let toward = [[0.0, 0.0], [0.9, 2.0], [-0.5, 0.3]];
    let bands = canopy.factors_of_bands(&toward, &channels(&world), &OF, [8, 64], 11).unwrap();
    let three = DerivativeTracer::new(canopy.tracer(), &OF).factors(&canopy, &toward, [8, 64], 11).unwrap();
    assert!(three.slopes.iter().all(|v| *v > 0.0) && bands.channels == 3 && bands.parameters == 4);
    for (found, want) in [(&bands.mean, &three.mean), (&bands.slopes, &three.slopes)] {
        assert_eq!(found.len(), want.len());
        found.iter().zip(want).for_each(|(a, b)| assert!((a - b).abs() < 1e-9 * b.abs(), "{a} {b}"));
    }
    bands.variance.iter().zip(&three.variance).for_each(|(a, b)| assert!((a - b).abs() < 1e-6 * b, "{a} {b}"));
    let light = [RadianceParameter::Light { sky: None, sun: [1.0; 3] }];
    let told = canopy.factors_of_bands(&toward, &channels(&world), &light, [8, 64], 11).unwrap_err();
    assert!(told.to_string().contains("by reflectances and transmittances alone"), "{told}");
}

/// A plate that lets light through over a ground: R = ρ + τ²a/(1 − ρa), with black bands among others.
#[test]
fn derivatives_of_bands_meet_their_closed_form() {
    let of = [[0.0, 0.0, 0.0], [0.4, 0.35, 0.3], [0.0, 0.9, 1.0], [0.3, 0.0, 0.2], [0.02, 0.01, 0.1], [0.45, 0.5, 0.7]];
    let world = sunlit(plates(0.5 * PERIOD, &[(30.0, [0.4, 0.4], 0.3), (0.0, [0.3, 0.0], 0.0)]));
    let list = |k: usize| of.iter().map(|band| band[k]).collect::<Vec<f64>>();
    let surfaces = [SurfaceBands { rho_d: [list(0), list(0)], rho_t: list(1) }, SurfaceBands::opaque(list(2))];
    let canopy = Canopy::new(&world, 1).unwrap();
    let rounds = 32;
    let sheets: Vec<_> =
        (0..rounds).map(|s| canopy.factors_of_bands(&[[0.4, 1.0]], &surfaces, &OF, [2, 256], s).unwrap()).collect();
    for (b, [rho, tau, ground]) in of.into_iter().enumerate() {
        // By the front, the back, τ and the ground.
        let one = 1.0 - rho * ground;
        let want = [1.0, (tau * ground / one).powi(2), 2.0 * tau * ground / one, (tau / one).powi(2)];
        for (k, want) in want.into_iter().enumerate() {
            let each: Vec<f64> = sheets.iter().map(|sheet| sheet.slope(0, k, b)).collect();
            let (mean, error) = scatter(&each);
            assert!((mean - want).abs() <= 4.0 * error + 1e-9, "{b} {k}: {mean} ± {error}, {want}");
            assert!(error <= 0.03 * want.max(0.1), "{b} {k}: ± {error}");
        }
    }
}

/// Each derivative of a crown against the difference of two factors that were traced without any, with the same random
/// numbers.
#[test]
fn derivatives_of_bands_agree_with_differences() {
    let world = crown();
    let bands = 5;
    let spread = |list: &[f64], by: f64| (0..bands).map(|b| (list[b % 3] * (1.0 + by * b as f64)).min(0.45)).collect();
    let at: Vec<SurfaceBands> = channels(&world)
        .iter()
        .map(|s| SurfaceBands {
            rho_d: [spread(&s.rho_d[0], 0.05), spread(&s.rho_d[1], -0.1)],
            rho_t: spread(&s.rho_t, -0.1),
        })
        .collect();
    let moved = |k: usize, h: f64| {
        let mut out = at.clone();
        let list = match &OF[k] {
            RadianceParameter::RhoD { leaf, back } => &mut out[*leaf].rho_d[usize::from(*back)],
            RadianceParameter::RhoT(leaf) => &mut out[*leaf].rho_t,
            _ => panic!("a reflectance"),
        };
        list.iter_mut().for_each(|v| *v += h);
        out
    };
    let (toward, step, seeds) = ([0.5, 1.0], 0.02, 24);
    let sheet = |seed: u64| {
        let canopy = Canopy::new(&world, seed).unwrap();
        canopy.factors_of_bands(&[toward], &at, &OF, [4, 512], 100 + seed).unwrap()
    };
    let sheets: Vec<_> = (0..seeds).map(sheet).collect();
    for k in 0..OF.len() {
        let each: Vec<(Vec<f64>, Vec<f64>)> = (0..seeds)
            .map(|seed| {
                let canopy = Canopy::new(&world, seed).unwrap();
                let factors = |h: f64| canopy.brf_of_bands(toward, &moved(k, h), bands, 2048).unwrap();
                let (high, low) = (factors(step), factors(-step));
                let by_steps = high.iter().zip(&low).map(|(a, b)| (a.mean - b.mean) / (2.0 * step)).collect();
                ((0..bands).map(|b| sheets[seed as usize].slope(0, k, b)).collect(), by_steps)
            })
            .collect();
        for b in 0..bands {
            let (mean, error) = scatter(&each.iter().map(|e| e.0[b]).collect::<Vec<f64>>());
            let (want, noise) = scatter(&each.iter().map(|e| e.1[b]).collect::<Vec<f64>>());
            let off = (mean - want).abs();
            assert!(off <= 4.0 * error.hypot(noise) + 0.005 * want, "{k} {b}: {mean} ± {error}, {want} ± {noise}");
            assert!(error.hypot(noise) <= 0.01 + 0.03 * want, "{k} {b}: {mean} ± {error}, {want} ± {noise}");
        }
    }
}

/// The mean of independent numbers and its standard error.
fn scatter(each: &[f64]) -> (f64, f64) {
    let n = each.len() as f64;
    let mean = each.iter().sum::<f64>() / n;
    let spread = each.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (spread / n).sqrt())
}
