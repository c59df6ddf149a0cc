//! Compares the derivatives with central differences, the gradient with the derivatives, and the images with the
//! convolver that renders.

use super::super::convolution::{ConvolutionSettings, Convolver};
use super::*;
use crate::dipole::Tissue;
use crate::slab;
use crate::translucency::convolution::TotalsSource;
use crate::translucency::levels::ThicknessLevels;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

fn noise(seed: u64, n: usize, low: f64, high: f64) -> Vec<f64> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    (0..n).map(|_| low + (high - low) * rng.random::<f64>()).collect()
}

const WIDTH: usize = 13;
const TEXELS: usize = WIDTH * 9;
const TEXEL_MM: f64 = 0.07;
const RANGE: [f64; 2] = [0.1, 0.3];
const LEVELS: ThicknessLevels = ThicknessLevels { count: 3, kind: super::super::levels::LevelKind::Chebyshev };

/// Two thickness maps, the second with a hole.
fn maps() -> Vec<Vec<f64>> {
    let mut maps = [1, 2].map(|seed| noise(seed, TEXELS, RANGE[0], RANGE[1])).to_vec();
    // Both ends of the range occur, so that the convolver has the same levels.
    (maps[0][0], maps[0][1], maps[1][40]) = (RANGE[0], RANGE[1], 0.0);
    maps
}

fn stage(reach_mm: f64) -> TangentStage {
    TangentStage::new(WIDTH, TEXEL_MM, maps(), &[1.0, 0.6], LEVELS, reach_mm).unwrap()
}

fn tissue(p: &[f64]) -> Tissue {
    Tissue { sigma_a: p[0].exp(), sigma_s: p[1].exp() / 0.7, g: 0.3, a: 1.3 }
}

fn lights() -> Vec<Vec<f64>> {
    (0..3).map(|k| noise(10 + k, TEXELS, 0.0, 1.0)).collect()
}

/// The sources of these lights; the last one has the incidence `last`.
fn sources(lights: &[Vec<f64>], last: usize) -> Vec<SourceImage<'_>> {
    lights
        .iter()
        .zip([(0, 0), (1, 0), (1, last)])
        .map(|(light, (map, incidence))| SourceImage { map, incidence, light })
        .collect()
}

#[test]
fn images_are_the_convolvers() {
    let (tissue, lights, maps) = (tissue(&[0.4f64.ln(), 8f64.ln(), 0.0]), lights(), maps());
    for totals in [TotalsSource::Form, TotalsSource::Transport] {
        for tail in [1e-9, 0.02] {
            let settings =
                ConvolutionSettings { levels: LEVELS, totals, tail, ..ConvolutionSettings::new(tissue, TEXEL_MM) };
            let convolver = Convolver::with(&settings, WIDTH, 9, RANGE[0], RANGE[1]).unwrap();
            let stage = stage((convolver.reach() as f64 - 0.5) * TEXEL_MM + if tail < 1e-3 { 9.0 } else { 0.0 });
            let got = stage.at(&tissue, totals, 1.0).unwrap().run(&sources(&lights, 0));
            for (k, map) in [0, 1, 1].into_iter().enumerate() {
                let want = convolver.run(&maps[map], &lights[k..=k]).swap_remove(0);
                let size = want.iter().fold(0.0, |m: f64, v| m.max(*v));
                let off = got[k].iter().zip(&want).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs())) / size;
                assert!(off < 1e-8, "{totals:?} tail {tail} image {k}: {off:e}");
            }
        }
    }
}

#[test]
fn derivatives_agree_with_differences_and_the_gradient_with_them() {
    let (lights, views) = (lights(), (0..3).map(|k| noise(20 + k, TEXELS, -1.0, 1.0)).collect::<Vec<_>>());
    for (reach, totals) in [(9.0, TotalsSource::Form), (0.3, TotalsSource::Transport)] {
        let stage = stage(reach);
        for centre in [[0.4f64.ln(), 8f64.ln(), 0.1], [3f64.ln(), 2f64.ln(), -0.2]] {
            let at = |p: &[f64]| stage.at(&tissue(p), totals, p[2].exp()).unwrap();
            let here = at(&centre);
            let gradient = here.gradient(&sources(&lights, 1), &views);
            for p in 0..PARTIALS {
                let step = 2e-4;
                let moved = |by: f64| {
                    let mut q = centre;
                    q[p] += by;
                    at(&q).run(&sources(&lights, 1))
                };
                let derivative = here.derivative(p, &sources(&lights, 1));
                let [a, b, c, d] = [step, -step, 2.0 * step, -2.0 * step].map(moved);
                let size = derivative.iter().flatten().fold(0.0, |m: f64, v| m.max(v.abs()));
                let mut sum = 0.0;
                for i in 0..3 {
                    for k in 0..TEXELS {
                        let want = (8.0 * (a[i][k] - b[i][k]) - (c[i][k] - d[i][k])) / (12.0 * step);
                        assert!(
                            (derivative[i][k] - want).abs() < 1e-7 * size,
                            "{totals:?} {p}: {} {want}",
                            derivative[i][k]
                        );
                        sum += views[i][k] * derivative[i][k];
                    }
                }
                assert!((gradient[p] / sum - 1.0).abs() < 1e-10, "{totals:?} {p}: {} {sum}", gradient[p]);
            }
            let texels: f64 = here.by_thickness(&sources(&lights, 1), &views).iter().flatten().sum();
            assert!((gradient[2] / texels - 1.0).abs() < 1e-10, "{totals:?}: {} {texels}", gradient[2]);
        }
    }
}

/// One texel's thickness is changed. The levels are so dense that their interpolation does not matter.
#[test]
fn a_texels_thickness_moves_the_images_as_it_is_said_to() {
    let (lights, views) = (lights(), (0..3).map(|k| noise(20 + k, TEXELS, -1.0, 1.0)).collect::<Vec<_>>());
    let at = |maps: Vec<Vec<f64>>| {
        let levels = ThicknessLevels { count: 9, ..LEVELS };
        let stage = TangentStage::new(WIDTH, TEXEL_MM, maps, &[1.0, 0.6], levels, 9.0).unwrap();
        let tangent = stage.at(&tissue(&[0.4f64.ln(), 8f64.ln()]), TotalsSource::Transport, 1.0).unwrap();
        let sum = |images: Vec<Vec<f64>>| {
            images.iter().zip(&views).flat_map(|(i, v)| i.iter().zip(v).map(|(a, b)| a * b)).sum::<f64>()
        };
        (sum(tangent.run(&sources(&lights, 1))), tangent.by_thickness(&sources(&lights, 1), &views))
    };
    let (_, by) = at(maps());
    let largest = by.iter().flatten().fold(0.0, |m: f64, v| m.max(v.abs()));
    for (map, texel) in [(0, 58), (0, 7), (1, 60), (1, 100)] {
        let moved = |by: f64| {
            let mut maps = maps();
            maps[map][texel] *= 1.0 + by;
            at(maps).0
        };
        let want = (moved(1e-3) - moved(-1e-3)) / 2e-3;
        assert!((by[map][texel] - want).abs() < 1e-3 * largest, "{map} {texel}: {} {want}", by[map][texel]);
    }
}

/// A wide flat blade transmits what the transport equation gives for a slanting beam.
#[test]
fn a_slanting_beam_brings_its_own_total() {
    let (n, d) = (15, 0.2);
    let stage = TangentStage::new(n, 2.0, vec![vec![d; n * n]], &[1.0, 0.5], LEVELS, 9.0).unwrap();
    let tissue = Tissue { sigma_a: 0.4, sigma_s: 9.5, g: 0.0, a: 1.0 };
    let light = vec![1.0; n * n];
    let sources = [0, 1].map(|incidence| SourceImage { map: 0, incidence, light: &light });
    let out = stage.at(&tissue, TotalsSource::Transport, 1.0).unwrap().run(&sources);
    for (out, mu) in out.iter().zip([1.0, 0.5]) {
        let want = slab::medium::response_at(mu, 0.4, 9.5, d).rho_t;
        assert!((out[n * n / 2] / want - 1.0).abs() < 1e-6, "{} {want}", out[n * n / 2]);
    }
}

#[test]
fn what_cannot_be_is_refused() {
    assert!(TangentStage::new(4, 0.1, vec![vec![0.0; 16]], &[1.0], LEVELS, 1.0).is_err());
    assert!(TangentStage::new(4, 0.1, vec![vec![0.1; 16], vec![0.1; 12]], &[1.0], LEVELS, 1.0).is_err());
    assert!(TangentStage::new(4, 0.1, vec![vec![0.1; 16]], &[0.0], LEVELS, 1.0).is_err());
    let stage = stage(1.0);
    for p in [[f64::NAN, 1.0, 0.0], [9f64, 9.0, 2.0], [f64::NEG_INFINITY, 1.0, 0.0]] {
        assert!(stage.at(&tissue(&p), TotalsSource::Form, p[2].exp()).is_err(), "{p:?}");
    }
}
