//! Compares the FFT convolution with direct sums, the kernel with brute-force integration, and the levels with a
//! separate kernel for every thickness.

use super::super::levels::LevelKind;
use super::*;
use crate::slab;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

fn noise(seed: u64, n: usize, low: f64, high: f64) -> Vec<f64> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    (0..n).map(|_| low + (high - low) * rng.random::<f64>()).collect()
}

fn settings(form: DipoleForm, texel_mm: f64) -> ConvolutionSettings {
    ConvolutionSettings { form, ..ConvolutionSettings::new(Tissue::TABLE, texel_mm) }
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    let size = b.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    a.iter().zip(b).fold(0.0f64, |m, (a, b)| m.max((a - b).abs())) / size
}

#[test]
fn transforms_equal_direct_sums() {
    // Sizes that are no powers of two; maps wider and taller than the kernel, and smaller ones.
    for (width, height, texel) in [(37, 23, 0.1), (9, 31, 0.05), (1, 1, 0.1), (1, 12, 0.3), (14, 14, 2.0)] {
        for form in [DipoleForm::Thin, DipoleForm::Images, DipoleForm::Dipoles(3)] {
            let n = width * height;
            let mut thickness = noise(1, n, 0.15, 0.5);
            if n > 100 {
                thickness[5] = 0.0;
                thickness[70] = f64::NAN;
            }
            let images: Vec<Vec<f64>> = (0..3).map(|k| noise(2 + k, n, -0.2, 1.0)).collect();
            let convolver = Convolver::with(&settings(form, texel), width, height, 0.15, 0.5).unwrap();
            let got = convolver.run(&thickness, &images);
            for (image, got) in images.iter().zip(&got) {
                let off = largest_difference(got, &convolver.direct(&thickness, image));
                assert!(off < 1e-13, "{form:?} {width}×{height}: {off:e}");
            }
        }
    }
}

#[test]
fn the_adjoint_is_the_transpose() {
    let (width, height) = (21, 16);
    let n = width * height;
    let thickness = noise(1, n, 0.02, 0.5);
    let convolver = Convolver::with(&settings(DipoleForm::Thin, 0.07), width, height, 0.02, 0.5).unwrap();
    let (sources, views) =
        ([noise(2, n, 0.0, 1.0), noise(3, n, 0.0, 1.0)], [noise(4, n, -1.0, 1.0), noise(5, n, -1.0, 1.0)]);
    let (out, back) = (convolver.run(&thickness, &sources), convolver.adjoint(&thickness, &views));
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    for k in 0..2 {
        let (forward, backward) = (dot(&out[k], &views[k]), dot(&sources[k], &back[k]));
        assert!((forward - backward).abs() < 1e-12 * dot(&out[k], &out[k]).sqrt() * dot(&views[k], &views[k]).sqrt());
    }
}

#[test]
fn the_kernel_is_the_integral_over_each_texel() {
    let t = Tissue::TABLE;
    let (d, texel) = (0.2, 0.06);
    let [kernel] =
        Kernel::build(|r| [t.beyond(r, d, DipoleForm::Images) / t.total(d, DipoleForm::Images)], texel, 30, true);
    let rule = slab::quadrature::gauss(8);
    for (i, j) in [(0, 0), (1, 0), (2, 1), (5, 7), (12, 3)] {
        // The peak in the centre is integrated from one corner, with sides half as long.
        let integral: f64 = (0..4)
            .flat_map(|p| rule.iter().flat_map(move |a| gauss8().into_iter().map(move |b| (p, *a, b))))
            .map(|(p, a, b)| {
                let (x, y) = (f64::from(p % 2) * 0.5 + 0.5 * a.x - 0.5, f64::from(p / 2) * 0.5 + 0.5 * b.x - 0.5);
                let r = ((x + i as f64).hypot(y + j as f64)) * texel;
                0.25 * a.w * b.w * texel * texel * t.transmittance(r, d, DipoleForm::Images)
            })
            .sum();
        let want = integral / t.total(d, DipoleForm::Images);
        let got = kernel.at(i, j);
        assert!((got - want).abs() < 1e-8 * want + 1e-11, "({i}, {j}): {got} {want}");
    }
}

fn gauss8() -> Vec<slab::quadrature::QuadratureNode> {
    slab::quadrature::gauss(8)
}

#[test]
fn the_kernel_s_spectrum_is_the_tissue_s_folded_over_the_texels() {
    // Σ w e^(−ikx) = Σ over aliases of T̂ sinc sinc: the same kernel by its Fourier transform, where that converges.
    let (t, d, h) = (Tissue::TABLE, 0.35, 0.1);
    let [kernel] =
        Kernel::build(|r| [t.beyond(r, d, DipoleForm::Images) / t.total(d, DipoleForm::Images)], h, 60, true);
    let sinc = |x: f64| if x == 0.0 { 1.0 } else { x.sin() / x };
    for (kx, ky) in [(0.0, 0.0), (3.0, 0.0), (11.0, 7.0), (31.4, 2.0)] {
        let folded: f64 = (-6..=6)
            .flat_map(|a| (-6..=6).map(move |b| (f64::from(a), f64::from(b))))
            .map(|(a, b)| {
                let (x, y) = (kx + TAU * a / h, ky + TAU * b / h);
                t.spectrum(x.hypot(y), d, DipoleForm::Images) * sinc(0.5 * x * h) * sinc(0.5 * y * h)
            })
            .sum();
        let summed: f64 = (-60..=60i32)
            .flat_map(|i| (-60..=60i32).map(move |j| (i, j)))
            .map(|(i, j)| {
                let w = kernel.at(i.unsigned_abs() as usize, j.unsigned_abs() as usize);
                w * (kx * h * f64::from(i)).cos() * (ky * h * f64::from(j)).cos()
            })
            .sum();
        assert!((summed - folded / t.total(d, DipoleForm::Images)).abs() < 1e-10, "({kx}, {ky}): {summed} {folded}");
    }
}

#[test]
fn samples_of_the_peak_would_count_too_much() {
    // T at the texels' centres times their area, d = .15 mm on .1 mm texels: 1.23 times the light.
    let t = Tissue::TABLE;
    let at =
        |i: i32, j: i32| t.transmittance(f64::from(i).hypot(f64::from(j)) * 0.1, 0.15, DipoleForm::Dipoles(3)) * 0.01;
    let sampled: f64 = (-30..=30).flat_map(|i| (-30..=30).map(move |j| (i, j))).map(|(i, j)| at(i, j)).sum();
    let ratio = sampled / t.total(0.15, DipoleForm::Dipoles(3));
    assert!((ratio - 1.23).abs() < 0.005, "{ratio}");
}

#[test]
fn no_light_is_lost_on_the_grid() {
    for form in [DipoleForm::Thin, DipoleForm::Images, DipoleForm::Dipoles(3)] {
        for (d, texel) in [(0.15, 0.05), (0.15, 0.1), (0.5, 0.02), (0.11, 3.0)] {
            let convolver = Convolver::with(&settings(form, texel), 2048, 1, d, d).unwrap();
            let sum = convolver.kernels[0].sum();
            assert!((sum - 1.0).abs() < 1e-12, "{form:?} d {d}: {sum}");
        }
    }
    // The leaf is far thinner than a texel, so nothing reaches the next texel.
    let convolver = Convolver::with(&settings(DipoleForm::Thin, 1.0), 9, 9, 0.02, 0.02).unwrap();
    let mut spot = vec![0.0; 81];
    spot[40] = 1.0;
    let out = convolver.run(&[0.02; 81], &[spot]).remove(0);
    let total = Tissue::TABLE.total(0.02, DipoleForm::Thin);
    assert!((out.iter().sum::<f64>() / total - 1.0).abs() < 1e-9 && out[40] > 0.95 * total);
}

#[test]
fn nothing_wraps_around() {
    // The spot is in one corner of a small leaf. What leaves at the opposite corner is the kernel's own value and not a
    // periodic copy of the spot.
    let settings = ConvolutionSettings { tail: 1e-9, ..settings(DipoleForm::Thin, 0.1) };
    let convolver = Convolver::with(&settings, 24, 24, 0.3, 0.3).unwrap();
    let mut spot = vec![0.0; 24 * 24];
    spot[0] = 1.0;
    let out = convolver.run(&[0.3; 576], &[spot]).remove(0);
    let far = Tissue::TABLE.transmittance(23.0 * 0.1, 0.3, DipoleForm::Thin) * 0.01;
    assert!((out[23] / far - 1.0).abs() < 0.1, "{} {far}", out[23]);
}

#[test]
fn a_flat_uniform_leaf_transmits_the_slab() {
    let n = 64 * 48;
    for kind in [LevelKind::Linear, LevelKind::Cubic, LevelKind::Chebyshev, LevelKind::Svd] {
        let settings = ConvolutionSettings {
            totals: TotalsSource::Transport,
            levels: ThicknessLevels { count: 6, kind },
            ..settings(DipoleForm::Thin, 0.1)
        };
        let convolver = Convolver::with(&settings, 64, 48, 0.1, 0.6).unwrap();
        let out = convolver.run(&vec![0.234; n], &[vec![1.0; n]]).remove(0);
        let want = slab::response(0.4, Tissue::TABLE.reduced_scattering(), 0.234).rho_t;
        let middle = out[24 * 64 + 32];
        assert!((middle / want - 1.0).abs() < 3e-6, "{kind:?}: {middle} {want}");
    }
}

#[test]
fn eight_levels_are_enough() {
    // d is between .15 and .5 mm, different in every texel. The RMS error is compared with a separate kernel for each
    // texel, relative to the mean.
    let (width, height) = (12, 10);
    let n = width * height;
    let thickness = noise(1, n, 0.15, 0.5);
    let image = noise(2, n, 0.0, 1.0);
    let one_each = ConvolutionSettings {
        levels: ThicknessLevels { count: n, kind: LevelKind::Chebyshev },
        ..settings(DipoleForm::Thin, 0.1)
    };
    let exact = convolve(std::slice::from_ref(&image), &thickness, width, &one_each).unwrap().remove(0);
    let mean = exact.iter().sum::<f64>() / n as f64;
    for (kind, most) in
        [(LevelKind::Linear, 0.01), (LevelKind::Cubic, 1e-3), (LevelKind::Chebyshev, 1e-4), (LevelKind::Svd, 1e-4)]
    {
        let convolver = Convolver::with(
            &ConvolutionSettings { levels: ThicknessLevels { count: 8, kind }, ..one_each },
            width,
            height,
            0.15,
            0.5,
        )
        .unwrap();
        let got = convolver.run(&thickness, std::slice::from_ref(&image)).remove(0);
        let rms = (got.iter().zip(&exact).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / n as f64).sqrt() / mean;
        assert!(rms < most, "{kind:?}: {rms:e}");
    }
}

#[test]
fn refusals_name_what_is_wrong() {
    let make =
        |s: ConvolutionSettings, low: f64, high: f64| Convolver::with(&s, 4, 4, low, high).unwrap_err().to_string();
    assert!(make(settings(DipoleForm::Images, 0.1), 0.05, 0.3).contains("use the thin form"));
    assert!(make(settings(DipoleForm::Thin, 0.0), 0.05, 0.3).contains("texels of 0 mm"));
    assert!(make(settings(DipoleForm::Thin, 0.1), 0.0, 0.3).contains("thickness from 0"));
    let bad = ConvolutionSettings { tissue: Tissue { g: 1.0, ..Tissue::TABLE }, ..settings(DipoleForm::Thin, 0.1) };
    assert!(make(bad, 0.1, 0.3).contains("g is 1"));
    assert!(convolve(&[vec![0.0; 3]], &[0.1; 4], 2, &settings(DipoleForm::Thin, 0.1)).is_err());
    let holes = convolve(&[vec![1.0; 4]], &[0.0; 4], 2, &settings(DipoleForm::Thin, 0.1)).unwrap();
    assert_eq!(holes, [vec![0.0; 4]]);
}

#[test]
fn the_tail_of_the_paper_is_where_it_says() {
    // The corrected kernel of d = .15 mm has a millionth of its light beyond about 2 mm; the printed one would need 56.
    let r = support(&Tissue::TABLE, DipoleForm::Images, 0.15, 1e-6);
    assert!((1.0..3.0).contains(&r), "{r}");
}
