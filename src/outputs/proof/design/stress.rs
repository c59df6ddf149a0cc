//! Stiff and extreme designs, each with the verdict that it must get. What is right is known in closed form, by looking
//! at every set, or by the same problem in other units.

use crate::stress::StressRow;
use crate::{Error, Result};
use mesophyll_base::selection::{DesignAim, DesignChoice, DesignParameter, DesignProblem, DesignSituation, evenly};
use mesophyll_fits::design::leaf::{TubeDesignOptions, of_capture};
use mesophyll_fits::design::search;
use mesophyll_fits::design::tube::{DesignTexel, GlossFitTruth, TexelQuantity, TubeDesign, TubePlace};
use mesophyll_fits::gloss::synthetic::device;
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::tube::Travel;
use mesophyll_synth::leaf::SyntheticLeaf;
use mesophyll_synth::scan;
use mesophyll_synth::spec::{InteriorModel, LeafSpec};
use std::time::Instant;

/// The leaf whose scan is planned for.
const LEAF: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/leaves/balata.toml"));
/// Numbers that shall be equal differ by less than this share.
const EQUAL: f64 = 1e-6;

/// A case: its name, the verdict that it must get, and how it gets one.
type Case = (&'static str, &'static str, fn() -> Result<String>);

const CASES: [Case; 18] = [
    ("a single reading to choose from", "ok", one_reading),
    ("a single reading that is asked for", "ok", one_of_many),
    ("all frames are identical", "ok", identical),
    ("more readings asked for than there are", "ok", more_than_all),
    ("everything is taken already", "ok", all_taken),
    ("a prior of zero width", "ok", nothing_unknown),
    ("a prior of zero width on everything", "ok", nothing_to_learn),
    ("a parameter that no reading sees", "ok", unseen),
    ("readings of infinite noise among good ones", "ok", blind_readings),
    ("two situations that each need another reading", "ok", contrary),
    ("units 1e12 apart", "ok", unlike_units),
    ("errors 1e4 apart", "ok", unlike_errors),
    ("errors 1e9 apart", "refused", too_unlike_errors),
    ("a Jacobian that is not a number", "refused", not_a_number),
    ("nothing is wanted", "refused", nothing_wanted),
    ("10 000 places of the tube", "ok", ten_thousand),
    ("limits that exclude everything", "refused: ", || {
        limited("x_mm = [9000.1, 9000.2]\ny_mm = [9000.1, 9000.2]\nstep_mm = 1.0")
    }),
    ("no position at a whole step", "refused: ", || {
        limited("step_mm = 5000.0\nx_mm = [10.0, 20.0]\ny_mm = [10.0, 20.0]")
    }),
];

/// Runs every case.
///
/// # Errors
/// [`Error::Write`] where no temporary folder can be had.
pub fn rows() -> Result<Vec<StressRow>> {
    let one = |(case, expected, run): &Case| {
        let clock = Instant::now();
        let verdict = run()?;
        Ok(StressRow {
            model: "design".into(),
            case: (*case).into(),
            expected: (*expected).into(),
            verdict,
            digits: None,
            condition: None,
            ms: clock.elapsed().as_secs_f64() * 1e3,
        })
    };
    CASES.iter().map(one).collect()
}

/// A problem of parameters that are known to `known` before, in one situation.
fn problem(known: &[f64], rows: Vec<Vec<f64>>) -> DesignProblem {
    let parameters = (known.iter().enumerate())
        .map(|(k, known)| DesignParameter { name: format!("p{k}"), known: *known, wanted: true })
        .collect();
    let situations = vec![DesignSituation { values: vec![1.0; known.len()], rows }];
    DesignProblem { aim: DesignAim::Parameters, parameters, situations, taken: Vec::new() }
}

/// A line c0 + c1 x, read at `count` places of [−1, 1].
fn line(count: usize) -> DesignProblem {
    let at = |k: usize| 2.0 * k as f64 / (count.max(2) - 1) as f64 - 1.0;
    problem(&[100.0, 100.0], (0..count).map(|k| vec![10.0, 10.0 * at(k)]).collect())
}

/// `ok` where the found numbers are the expected ones.
fn equal(what: &str, found: &[f64], expected: &[f64]) -> String {
    let same = |(f, e): (&f64, &f64)| (f - e).abs() <= EQUAL * e.abs().max(1e-300);
    if found.len() == expected.len() && found.iter().zip(expected).all(same) {
        return "ok".into();
    }
    format!("wrong: {what}: found {found:?}, expected {expected:?}")
}

fn chosen(problem: &DesignProblem, count: usize) -> Result<DesignChoice> {
    search::choose(problem, count)?.ok_or_else(|| Error::Missed("refused".into()))
}

/// The verdict of a problem that has no answer.
fn refused(problem: &DesignProblem) -> Result<String> {
    let found = (search::choose(problem, 3)?, search::best_possible(problem, 3)?);
    Ok(if found == (None, None) { "refused".into() } else { format!("wrong: found {found:?}") })
}

fn one_reading() -> Result<String> {
    let found = chosen(&problem(&[2.0], vec![vec![4.0]]), 1)?;
    Ok(equal("error and ratio", &[found.errors[0], found.ratio], &[(0.25f64 + 16.0).powf(-0.5), 1.0]))
}

/// One reading of a line that starts unknown: the criterion's least value among all single readings.
fn one_of_many() -> Result<String> {
    let line = line(41);
    let found = chosen(&line, 1)?.ratio;
    let least = (0..41).filter_map(|k| Some(line.judge(&[k])?.ratio)).fold(f64::INFINITY, f64::min);
    Ok(equal("ratio", &[found], &[least]))
}

/// n identical readings of error s leave an error of 1/√(1/known² + n/s²).
fn identical() -> Result<String> {
    let found = chosen(&problem(&[3.0], vec![vec![2.0]; 50]), 8)?;
    let left = |n: f64| (1.0 / 9.0 + 4.0 * n).powf(-0.5);
    Ok(equal("error and ratio", &[found.errors[0], found.ratio], &[left(8.0), left(8.0) / left(50.0)]))
}

fn more_than_all() -> Result<String> {
    let found = chosen(&line(7), 100)?;
    let all: Vec<f64> = (0..7).map(f64::from).collect();
    let chosen: Vec<f64> = found.chosen.iter().map(|k| *k as f64).collect();
    Ok(equal("readings and ratio", &[&chosen[..], &[found.ratio]].concat(), &[&all[..], &[1.0]].concat()))
}

fn all_taken() -> Result<String> {
    let mut line = line(9);
    line.taken = evenly(9, 9);
    let (found, bound) = (chosen(&line, 9)?, search::best_possible(&line, 9)?);
    Ok(equal(
        "readings, ratio and bound",
        &[found.chosen.len() as f64, found.ratio, bound.unwrap_or(0.0)],
        &[9.0, 1.0, 1.0],
    ))
}

/// With a slope that is known exactly, the line's constant is a mean.
fn nothing_unknown() -> Result<String> {
    let mut line = line(21);
    line.parameters[1].known = 0.0;
    let found = chosen(&line, 4)?;
    Ok(equal("error of the constant", &found.errors[..1], &[(1e-4f64 + 400.0).powf(-0.5)]))
}

/// Where everything is known before, all sets are alike.
fn nothing_to_learn() -> Result<String> {
    let mut line = line(21);
    line.parameters.iter_mut().for_each(|p| p.known = 0.0);
    Ok(equal("ratio", &[chosen(&line, 4)?.ratio], &[1.0]))
}

/// Its error stays what was known, and the others are chosen for as if it were not there.
fn unseen() -> Result<String> {
    let mut with = line(21);
    with.parameters.push(DesignParameter { name: "unseen".into(), known: 0.7, wanted: true });
    with.situations[0].values.push(1.0);
    with.situations[0].rows.iter_mut().for_each(|row| row.push(0.0));
    let (found, without) = (chosen(&with, 6)?, chosen(&line(21), 6)?);
    Ok(equal("errors", &found.errors, &[&without.errors[..], &[0.7]].concat()))
}

fn blind_readings() -> Result<String> {
    let mut line = line(21);
    for k in (0..21).filter(|k| k % 2 == 1) {
        line.situations[0].rows[k] = vec![0.0; 2];
    }
    let found = chosen(&line, 6)?;
    let blind = found.chosen.iter().filter(|k| **k % 2 == 1).count();
    Ok(if blind == 0 { "ok".into() } else { format!("wrong: {blind} of {:?} see nothing", found.chosen) })
}

/// A reading that tells all in one situation tells nothing in the other.
fn contrary() -> Result<String> {
    let mut two = problem(&[1.0], vec![vec![100.0], vec![0.0], vec![1.0]]);
    two.situations.push(DesignSituation { values: vec![1.0], rows: vec![vec![0.0], vec![100.0], vec![1.0]] });
    let found: Vec<f64> = chosen(&two, 2)?.chosen.iter().map(|k| *k as f64).collect();
    Ok(equal("readings", &found, &[0.0, 1.0]))
}

/// The same line with the slope in a unit 1e12 times as large.
fn unlike_units() -> Result<String> {
    let (usual, mut other) = (line(31), line(31));
    other.parameters[1].known *= 1e12;
    other.situations[0].rows.iter_mut().for_each(|row| row[1] *= 1e-12);
    let (usual, other) = (chosen(&usual, 7)?, chosen(&other, 7)?);
    Ok(equal(
        "errors and ratio",
        &[other.errors[0], other.errors[1] * 1e-12, other.ratio],
        &[usual.errors[0], usual.errors[1], usual.ratio],
    ))
}

/// The line with one reading whose error is smaller than the others' by this factor.
fn one_exact(factor: f64) -> DesignProblem {
    let mut line = line(31);
    line.situations[0].rows[4].iter_mut().for_each(|v| *v *= factor);
    line
}

/// The exact reading fixes a sum, and its best partner is the far end: the errors of a line through one known point.
fn unlike_errors() -> Result<String> {
    let found = chosen(&one_exact(1e4), 2)?;
    let near: f64 = 8.0 / 30.0 - 1.0;
    let along = 1.0 / (100.0 * (1.0 - near).powi(2) + 1e-4 * (1.0 + near * near));
    Ok(equal("errors", &found.errors, &[near.abs() * along.sqrt(), along.sqrt()]))
}

/// Double precision does not hold what the other readings add.
fn too_unlike_errors() -> Result<String> {
    refused(&one_exact(1e9))
}

fn not_a_number() -> Result<String> {
    let mut line = line(9);
    line.situations[0].rows[3][1] = f64::NAN;
    refused(&line)
}

fn nothing_wanted() -> Result<String> {
    let mut line = line(9);
    line.parameters.iter_mut().for_each(|p| p.wanted = false);
    refused(&line)
}

/// 10 000 places, of which ten are chosen for m: no farther from what cannot be beaten than a tenth, and better than
/// even ones.
fn ten_thousand() -> Result<String> {
    let device = device(Lobe::Beckmann, 0.01);
    let truth = GlossFitTruth { rho_d: [0.06, 0.12, 0.04], rho_s: [0.04; 3], m: 0.2, tilt: [0.05, 0.0] };
    let texel = DesignTexel { at_mm: [3.0, -2.0], truth, noise: device.noise() };
    let at = |k: usize| TubePlace { pass: Travel::X, position_mm: -400.0 + 0.065 * k as f64 };
    let places = (0..10_000).map(at).collect();
    let design = TubeDesign { device, places, texels: vec![texel], wanted: vec![TexelQuantity::M], taken: Vec::new() };
    let problem = design.problem();
    let found = design.choose(&problem, 10)?.ok_or_else(|| Error::Missed("refused".into()))?;
    let even = problem.judge(&design.evenly(10)).map_or(0.0, |even| even.ratio);
    let bound = search::best_possible(&problem, 10)?.unwrap_or(0.0);
    let good = bound <= found.ratio * (1.0 + EQUAL) && found.ratio < 1.1 * bound && found.ratio < even;
    Ok(if good { "ok".into() } else { format!("wrong: {:.3}, even {even:.3}, bound {bound:.3}", found.ratio) })
}

/// The design of further frames of a small scan with these `[limits]`.
fn limited(limits: &str) -> Result<String> {
    let folder = tempfile::tempdir().map_err(|e| Error::write(&std::env::temp_dir(), e))?;
    let capture = folder.path().join("scan");
    let mut spec: LeafSpec = LEAF.parse().map_err(|e| Error::Missed(format!("the stress leaf cannot be read: {e}")))?;
    (spec.veins.tertiary_mm, spec.veins.areole_mm) = (0.0, 0.0);
    let [width, height] = [12, 9];
    let leaf = SyntheticLeaf::grow(&spec, InteriorModel::Exact, width, height)
        .ok_or_else(|| Error::Missed("no texel on the leaf".into()))?;
    let options = scan::Options { width, height, frames: 24, seed: 3, ..scan::Options::default() };
    scan::scan(&spec, &leaf, &options, &capture)?;
    let path = capture.join("capture.toml");
    let text = mesophyll_files::whole_file::text(&path)?;
    let first = text.find("[[pass]]").unwrap_or(text.len());
    let text = format!("{}[limits]\n{limits}\n{}", &text[..first], &text[first..]);
    mesophyll_files::atomic::write_bytes(&path, text.as_bytes())?;
    Ok(match of_capture(&capture, &TubeDesignOptions::of(vec![TexelQuantity::M]), false) {
        Ok(design) => format!("wrong: {} places are proposed", design.places.len()),
        Err(e) => {
            let said = e.to_string();
            format!("refused: {}", said.rsplit("scan/").next().unwrap_or(&said))
        }
    })
}
