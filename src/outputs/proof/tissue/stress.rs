//! Stiff and extreme photographs, each with the verdict that it must get.

use crate::Result;
use crate::stress::StressRow;
use mesophyll_fits::translucency::inverse::synthetic::TissueScene;
use mesophyll_fits::translucency::inverse::{Options, TissueCoefficients, TissueFit, fit, logarithms};
use mesophyll_optics::side::Side;
use std::time::Instant;

fn verdict(scene: &TissueScene, start: &TissueCoefficients, options: &Options) -> (String, Option<f64>, Option<f64>) {
    let fitted = scene.photograph().and_then(|m| fit(&m, start, options));
    match fitted {
        Err(e) => (format!("refused: {e}"), None, None),
        Ok(f) => {
            let values = values(&f.tissues, options);
            let named: Vec<String> =
                values.iter().enumerate().filter_map(|(k, v)| f.certainty.undetermined(k, *v)).collect();
            let digits = digits(&f, &scene.truth, options);
            let text = match named.first() {
                Some(first) => format!("undetermined: {first}"),
                // The fit promises a truth within five standard errors, or within a thousandth where there was no
                // noise.
                None if !held(&f, &scene.truth, options) => format!("wrong: {:?} for {:?}", f.tissues, scene.truth),
                None => "ok".into(),
            };
            (text, Some(digits), Some(f.certainty.condition))
        }
    }
}

fn values(t: &TissueCoefficients, options: &Options) -> Vec<f64> {
    logarithms(t, options).iter().map(|v| v.exp()).collect()
}

fn held(f: &TissueFit, truth: &TissueCoefficients, options: &Options) -> bool {
    let pairs = values(&f.tissues, options).into_iter().zip(values(truth, options));
    pairs.zip(&f.certainty.stderr).all(|((a, b), e)| (a / b).ln().abs() <= (5.0 * e).max(1e-3))
}

fn digits(f: &TissueFit, truth: &TissueCoefficients, options: &Options) -> f64 {
    let pairs = values(&f.tissues, options).into_iter().zip(values(truth, options));
    let worst = pairs.map(|(a, b)| (a / b - 1.0).abs()).fold(1e-16, f64::max);
    -worst.log10()
}

/// The rows of `stress translucency` that are fits of the tissue.
///
/// # Errors
/// None that a correct program meets.
pub fn rows() -> Result<Vec<StressRow>> {
    let one = |sigma_a: f64, reduced: f64, scale: f64| TissueCoefficients {
        sigma_a: vec![sigma_a],
        reduced: vec![reduced],
        scale,
    };
    let free = Options { levels: 6, ..Options::default() };
    let fixed = Options { fix_scale: true, ..free };
    let near = one(0.5, 8.0, 1.0);
    let fine = TissueScene::fine(0.4, 9.5);
    let scaled = TissueScene { truth: one(0.4, 9.5, 1.1), ..fine.clone() };
    let noisy = TissueScene { noise: 0.01, seed: 5, ..fine.clone() };
    let coarse = TissueScene { texel_mm: 3.0, noise: 0.005, ..fine.clone() };
    let clear = TissueScene { noise: 0.01, ..TissueScene::fine(1e-4, 9.5) };
    let one_beam = vec![(Side::Front, std::f64::consts::FRAC_PI_2, 0.0)];
    let only_thickness = "undetermined: sigma_a.R";
    let cases: Vec<(&str, &str, TissueScene, TissueCoefficients, Options)> = vec![
        ("noise-free, near", "ok", fine.clone(), near.clone(), free),
        ("noise-free, thickness 10 % off", "ok", scaled, near.clone(), free),
        ("noise-free, start far off", "ok", fine.clone(), one(20.0, 0.5, 1.0), free),
        ("d = l/2", "ok", TissueScene { thickness_mm: 0.1, ..TissueScene::fine(0.4, 5.0) }, near.clone(), fixed),
        (
            "sigma_a = 20 sigma_s",
            "ok",
            TissueScene { thickness_mm: 0.1, ..TissueScene::fine(20.0, 1.0) },
            near.clone(),
            fixed,
        ),
        ("1 % noise, thickness known", "ok", noisy, near.clone(), fixed),
        ("sigma_a = 1e-4", only_thickness, clear, near.clone(), fixed),
        ("texels 20 times the thickness", only_thickness, coarse.clone(), near.clone(), free),
        // A second incidence would separate the two coefficients even here.
        (
            "the same, flat, one beam",
            only_thickness,
            TissueScene { relief: 0.0, beams: one_beam, ..coarse.clone() },
            near.clone(),
            fixed,
        ),
        ("no light", "refused: ", TissueScene { beams: vec![(Side::Front, -0.1, 0.0)], ..fine }, near, free),
    ];
    let rows = cases.into_iter().map(|(case, expected, scene, start, options)| {
        let clock = Instant::now();
        let (verdict, digits, condition) = verdict(&scene, &start, &options);
        StressRow {
            model: "translucency".into(),
            case: format!("tissue: {case}"),
            expected: expected.into(),
            verdict,
            digits,
            condition,
            ms: clock.elapsed().as_secs_f64() * 1e3,
        }
    });
    Ok(rows.collect())
}
