//! Tests the fit with photographs that the convolver made (other code, more levels), with random walks, and with cases
//! in which something cannot be known.

use super::synthetic::TissueScene;
use super::*;
use mesophyll_optics::side::Side;
use mesophyll_optics::walk::{Boundary, FieldRim, Histories, IncidentLight, LeafHeightField, Medium, ReliefLeaf};

const QUICK: Options = Options {
    levels: 4,
    totals: TotalsSource::Transport,
    incidence: BeamIncidence::Slant,
    fix_scale: false,
    rounds: 12,
    told: false,
};

fn start(sigma_a: f64, reduced: f64, scale: f64) -> TissueCoefficients {
    TissueCoefficients { sigma_a: vec![sigma_a], reduced: vec![reduced], scale }
}

fn worst(found: &TissueCoefficients, truth: &TissueCoefficients) -> f64 {
    let pairs = found.sigma_a.iter().zip(&truth.sigma_a).chain(found.reduced.iter().zip(&truth.reduced));
    pairs.map(|(a, b)| (a / b - 1.0).abs()).fold((found.scale / truth.scale - 1.0).abs(), f64::max)
}

#[test]
fn several_tissues_are_recovered_from_near_and_far() {
    for (sigma_a, reduced, scale, from) in [
        (0.4, 9.5, 1.0, start(0.5, 8.0, 1.0)),
        (3.0, 12.0, 1.08, start(0.3, 30.0, 1.0)),
        (0.05, 5.0, 0.95, start(2.0, 2.0, 1.0)),
    ] {
        let scene = TissueScene { truth: start(sigma_a, reduced, scale), ..TissueScene::fine(sigma_a, reduced) };
        let fitted = fit(&scene.photograph().unwrap(), &from, &Options { levels: 6, ..QUICK }).unwrap();
        assert!(worst(&fitted.tissues, &scene.truth) < 1e-3, "{:?} for {:?}", fitted.tissues, scene.truth);
        assert_eq!(fitted.termination, Termination::GradientSmall);
    }
}

#[test]
fn the_gradient_is_that_of_the_cost() {
    use mesophyll_base::solvers::lbfgs::DifferentiableCost;
    let scene = TissueScene {
        noise: 0.02,
        beams: vec![(Side::Front, 1.2, 0.3), (Side::Back, 1.5, 0.0), (Side::Back, 0.8, 2.0)],
        truth: TissueCoefficients { sigma_a: vec![0.4, 2.0], reduced: vec![9.0, 11.0], scale: 1.0 },
        size: 12,
        ..TissueScene::fine(0.4, 9.0)
    };
    let mut measured = scene.photograph().unwrap();
    measured.channels[1].images[2].exit.fill(0.8);
    measured.channels[0].images[0].used[17] = false;
    measured.channels[0].images[0].seen[17] = f64::NAN;
    let from = TissueCoefficients { sigma_a: vec![0.7, 1.0], reduced: vec![6.0, 14.0], scale: 1.1 };
    let model = model::TissueFitModel::new(&measured, &QUICK, &from).unwrap();
    let p = model::logarithms(&from, &QUICK);
    let mut gradient = vec![0.0; p.len()];
    let cost = model.evaluate(&p, &mut gradient);
    let normal = model.normal(&p).unwrap();
    assert!((normal.cost / cost - 1.0).abs() < 1e-12);
    let size = gradient.iter().fold(0.0, |m: f64, g| m.max(g.abs()));
    for k in 0..p.len() {
        let at = |by: f64| {
            let mut q = p.clone();
            q[k] += by;
            model.evaluate(&q, &mut vec![0.0; p.len()])
        };
        let h = 1e-3;
        let want = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
        assert!((gradient[k] - want).abs() < 1e-6 * size, "{k}: {} {want}", gradient[k]);
        assert!((normal.gradient[k] - gradient[k]).abs() < 1e-9 * size, "{k}");
    }
}

/// A random walk through the same relief, without diffusion and without a kernel; light leaves and enters again. The
/// difference that remains is the model's own error at two mean free paths of thickness. The transmitted light is
/// right, but its division into absorption and scattering is not right to the noise (over many histories scattering is
/// 8 % too low, and absorption .1 to .2/mm too high). The residuals say so.
#[test]
fn a_random_walk_is_fitted_within_what_diffusion_leaves_out() {
    let scene = TissueScene {
        size: 16,
        beams: vec![(Side::Front, std::f64::consts::FRAC_PI_2, 0.0)],
        ..TissueScene::fine(0.4, 9.5)
    };
    let mut measured = scene.frame(0);
    let [front, back] = scene.heights();
    let below = back.iter().map(|v| -v).collect();
    let field =
        LeafHeightField::new(16, 16, scene.texel_mm, front, below, FieldRim::Clamped { margin_mm: 0.0 }).unwrap();
    let medium = Medium { sigma_a: 0.4, sigma_s: 9.5, g: 0.0 };
    let leaf = ReliefLeaf { medium, boundary: Boundary::Matched, spread: false };
    let walk =
        leaf.walk(&field, IncidentLight::Direction([0.0, 0.0, 1.0]), Histories { count: 200_000, seed: 3 }).unwrap();
    let image = &mut measured.channels[0].images[0];
    image.seen = walk.exitance.iter().map(|e| e.value).collect();
    let spread: f64 = walk.exitance.iter().map(|e| e.error / e.value).sum::<f64>() / 256.0;
    measured.noise = TissueNoise { relative: spread, floor: 0.0, known: true };
    let fitted = fit(&measured, &start(1.0, 5.0, 1.0), &Options { fix_scale: true, ..QUICK }).unwrap();
    let (a, s) = (fitted.tissues.sigma_a[0], fitted.tissues.reduced[0]);
    let rho_t = |a: f64, s: f64| mesophyll_optics::slab::medium::response(a, s, 0.2).rho_t;
    assert!((rho_t(a, s) / rho_t(0.4, 9.5) - 1.0).abs() < 0.03, "{a} {s}");
    // At this thickness, the spread by diffusion is known to about a tenth.
    assert!((s / 9.5 - 1.0).abs() < 0.15 && (a - 0.4).abs() < 0.3, "{a} {s} {:?}", fitted.certainty.stderr);
}

/// 40 fits of noisy photographs of a flat blade of known thickness give 80 intervals, of which 76 ± 2 should contain
/// the truth.
#[test]
fn intervals_hold_the_truth() {
    use rayon::prelude::*;
    let one = |seed: u64| {
        let scene = TissueScene {
            size: 9,
            relief: 0.0,
            texel_mm: 0.1,
            noise: 0.02,
            seed,
            beams: vec![(Side::Front, 1.571, 0.0)],
            ..TissueScene::fine(0.8, 8.0)
        };
        let fitted =
            fit(&scene.photograph().unwrap(), &start(0.75, 8.5, 1.0), &Options { fix_scale: true, ..QUICK }).unwrap();
        let t = &fitted.tissues;
        [(t.sigma_a[0] / 0.8).ln() / fitted.certainty.stderr[0], (t.reduced[0] / 8.0).ln() / fitted.certainty.stderr[1]]
    };
    let off: Vec<f64> = (0..40).into_par_iter().flat_map_iter(one).collect();
    let inside = off.iter().filter(|z| z.abs() < 1.96).count();
    let mean_square = off.iter().map(|z| z * z).sum::<f64>() / off.len() as f64;
    // The limits are three standard deviations of either number.
    assert!((70..=80).contains(&inside) && (0.53..1.47).contains(&mean_square), "{inside} of 80, {mean_square}");
}

/// 32 fits, each on a thickness map drawn anew with the errors that it states: the results scatter as far as their
/// errors say.
#[test]
fn stated_errors_hold_those_of_the_thickness_map() {
    use rayon::prelude::*;
    let one = |seed: u64| {
        let scene = TissueScene {
            size: 9,
            relief: 0.0,
            texel_mm: 0.1,
            noise: 0.005,
            seed,
            beams: vec![(Side::Front, 1.571, 0.0)],
            ..TissueScene::fine(0.8, 8.0)
        };
        let exact = scene.photograph().unwrap();
        let each = exact.thickness.iter().map(|map| vec![0.006; map.len()]).collect();
        let errors = ThicknessErrors { each, ..ThicknessErrors::default() };
        let mut measured = exact.moved(&errors.draw(exact.width, 100 + seed), 1.0);
        measured.thickness_errors = errors;
        measured
    };
    let options = Options { fix_scale: true, ..QUICK };
    let fitted = |measured: &TissueMeasurement| fit(measured, &start(0.75, 8.5, 1.0), &options).unwrap();
    let truth = logarithms(&start(0.8, 8.0, 1.0), &options);
    let off = |seed: u64| {
        let f = fitted(&one(seed));
        let found = logarithms(&f.tissues, &options);
        let z = |k: usize| ((found[k] - truth[k]) / f.certainty.stderr[k]).powi(2);
        [0.5 * (z(0) + z(1)), f.reduced_chi2 / f.expected_chi2]
    };
    let all: Vec<[f64; 2]> = (0..32).into_par_iter().map(off).collect();
    let [stated, chi2] = [0, 1].map(|k: usize| all.iter().map(|z| z[k]).sum::<f64>() / 32.0);
    // The limits are three standard deviations of the mean square of 32 normal deviates.
    assert!((0.25..1.75).contains(&stated) && (0.6..1.2).contains(&chi2), "{stated} {chi2}");
    // Without the map's errors the estimate is the same, but its stated error is far too small.
    let measured = one(0);
    let certain = fitted(&TissueMeasurement { thickness_errors: ThicknessErrors::default(), ..measured.clone() });
    let honest = fitted(&measured);
    assert_eq!(honest.tissues, certain.tissues);
    assert!((0..2).all(|k| honest.certainty.stderr[k] > 1.5 * certain.certainty.stderr[k]), "{certain:?} {honest:?}");
}

#[test]
fn what_cannot_be_known_is_named() {
    // Texels far wider than light spreads, and a varying thickness: only products with the thickness are determined.
    let coarse = TissueScene { texel_mm: 3.0, noise: 0.005, ..TissueScene::fine(0.8, 9.0) };
    let fitted = fit(&coarse.photograph().unwrap(), &start(1.0, 7.0, 1.0), &QUICK).unwrap();
    let why = fitted.certainty.undetermined(0, fitted.tissues.sigma_a[0]).unwrap();
    assert!(why.contains("times thickness_scale"), "{why}");
    // A flat blade in coarse texels under one beam: the transmitted light is only one number.
    let flat = TissueScene { relief: 0.0, beams: vec![(Side::Front, std::f64::consts::FRAC_PI_2, 0.0)], ..coarse };
    let fitted =
        fit(&flat.photograph().unwrap(), &start(1.0, 7.0, 1.0), &Options { fix_scale: true, ..QUICK }).unwrap();
    let why = fitted.certainty.undetermined(0, fitted.tissues.sigma_a[0]).unwrap();
    assert!(why.contains("only how much light"), "{why}");
    // Here there is nothing to fit.
    let mut dark = flat.photograph().unwrap();
    dark.channels[0].images.iter_mut().for_each(|i| i.light.fill(0.0));
    assert!(fit(&dark, &start(1.0, 7.0, 1.0), &QUICK).unwrap_err().to_string().contains("flat"));
    dark.channels[0].images.iter_mut().for_each(|i| i.used.fill(false));
    assert!(fit(&dark, &start(1.0, 7.0, 1.0), &QUICK).unwrap_err().to_string().contains("0 readings"));
}
