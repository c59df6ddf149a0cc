//! Pictures of scenes that say little, too much, or something else than the scene: the verdict that `fit scene` must
//! give.

pub mod bench;

use crate::stress::StressRow;
use crate::{Error, Result};
use mesophyll_fit_scene::synthetic::{BOTH, START, TRUTH, glossy, moved, opened, photograph, scene, turned};
use mesophyll_fit_scene::{Options, run};
use mesophyll_fits::record::maker::FitOutcome;
use mesophyll_scene::placed::ledger::Ledger;
use std::time::Instant;

/// What is unknown where nothing else is said: ρd of front and back, ρt, and the ground.
const UNKNOWN: &str = "[unknown]\nleaves = { a = [\"rho_d\", \"rho_t\"] }\nground = [\"albedo\"]\n";
/// Names of the numbers of [`TRUTH`].
const NAMES: [&str; 4] = ["leaf.a.front.rho_d", "leaf.a.back.rho_d", "leaf.a.rho_t", "ground.albedo"];
/// A number is right within so many standard errors, or within the second number.
const RIGHT: (f64, f64) = (5.0, 2e-3);

/// A case: its name, the verdict that it must get, the true numbers, those that the fit starts from, what is unknown,
/// how readings are spoilt, and what else the scene of the fit states.
struct Case {
    name: &'static str,
    expected: &'static str,
    truth: [[f64; 3]; 5],
    start: [[f64; 3]; 5],
    unknown: &'static str,
    size: Option<[usize; 2]>,
    spoil: fn(usize, f64) -> f64,
    state: fn(String) -> String,
    /// What the pictures are taken of, where that is not what the fit's scene states.
    taken_of: fn(String) -> String,
}

const PLAIN: Case = Case {
    name: "",
    expected: "ok",
    truth: TRUTH,
    start: START,
    unknown: UNKNOWN,
    size: None,
    spoil: |_, v| v,
    state: |text| text,
    taken_of: |text| text,
};
const SUN: [f64; 3] = TRUTH[4];

fn verdict(case: &Case) -> Result<(String, Option<f64>)> {
    let folder = tempfile::tempdir().map_err(|e| Error::Missed(format!("no folder for pictures: {e}")))?;
    let sized = |text: String| match case.size {
        Some([w, h]) => {
            text.replace("width = 32", &format!("width = {w}")).replace("height = 24", &format!("height = {h}"))
        }
        None => text,
    };
    photograph(folder.path(), &(case.taken_of)(sized(scene(case.truth, ""))), 1.0, case.spoil)?;
    let text = (case.state)(sized(scene(case.start, &format!("{BOTH}{}", case.unknown))));
    let options = Options { samples: 512, seed: 3, force: true };
    let ended = opened(folder.path(), &text)
        .and_then(|scene| run(&scene, &folder.path().join("fit"), &options, &Ledger::new()));
    let record = match ended {
        Err(e) => return Ok((format!("refused: {e}"), None)),
        Ok(FitOutcome::Done(record)) => record,
        Ok(_) => return Err(Error::Missed("no fit was made".into())),
    };
    if let Some(fault) = record.faults.first() {
        return Ok((format!("misfit: {}", fault.says), None));
    }
    let none = Default::default();
    let section = record.sections.get("all").unwrap_or(&none);
    if let Some(why) = section.params.values().find_map(|param| param.undetermined.first()) {
        return Ok((format!("undetermined: {why}"), None));
    }
    let mut digits = f64::INFINITY;
    for (name, truth) in NAMES.iter().zip(case.truth) {
        for (channel, truth) in ["R", "G", "B"].iter().zip(truth) {
            let Some(param) = section.params.get(&format!("{name}.{channel}")) else { continue };
            let off = (param.value[0] - truth).abs();
            digits = digits.min(-(off / truth.max(0.01)).max(1e-16).log10());
            if !(off <= (RIGHT.0 * param.stderr[0]).max(RIGHT.1)) {
                let found = format!("{} ± {} for {truth}", param.value[0], param.stderr[0]);
                return Ok((format!("wrong: {name}.{channel} is {found}"), Some(digits)));
            }
        }
    }
    Ok(("ok".into(), Some(digits)))
}

/// The cases of `stress scene`.
///
/// # Errors
/// A folder that cannot be written, and a stop.
pub fn stress() -> Result<Vec<StressRow>> {
    let black = [[0.0; 3], [0.0; 3], [0.0; 3], TRUTH[3], SUN];
    let white = [[0.5; 3], [0.5; 3], [0.499; 3], TRUTH[3], SUN];
    let wrong_end = [[0.9, 0.0, 0.9], [0.0, 0.9, 0.0], [0.0, 0.05, 0.05], [1.0, 0.0, 1.0], SUN];
    let cases = [
        Case { name: "black leaves", truth: black, ..PLAIN },
        Case { name: "leaves that absorb next to nothing", truth: white, ..PLAIN },
        Case { name: "a start at the wrong end", start: wrong_end, ..PLAIN },
        Case { name: "one pixel", expected: "undetermined: ", size: Some([1, 1]), ..PLAIN },
        Case {
            name: "a leaf that no picture shows",
            expected: "undetermined: leaf.b.",
            unknown: "[unknown]\nleaves = { a = [\"rho_t\"], b = [\"rho_d\"] }\n",
            start: [TRUTH[0], TRUTH[1], START[2], TRUTH[3], SUN],
            ..PLAIN
        },
        Case { name: "saturated pixels", spoil: |_, v| v.min(0.08), ..PLAIN },
        Case {
            name: "wild values in two pixels of a hundred",
            spoil: |k, v| if k % 50 == 7 { 40.0 * v + 3.0 } else { v },
            ..PLAIN
        },
        Case {
            name: "a light that the scene does not have",
            expected: "misfit: ",
            spoil: |k, v| if k % 32 < 16 { 1.1 * v } else { v },
            ..PLAIN
        },
        Case {
            name: "a camera that stood elsewhere",
            expected: "misfit: ",
            start: TRUTH,
            state: |text| text.replace("[-150, -180, 150]", "[-160, -171, 150]"),
            ..PLAIN
        },
        Case { name: "a camera that was turned by 1 degree", expected: "misfit: ", state: turned, ..PLAIN },
        Case { name: "leaves that stood 5 mm elsewhere", expected: "misfit: ", state: moved, ..PLAIN },
        Case { name: "a gloss that the scene leaves out", expected: "misfit: ", taken_of: glossy, ..PLAIN },
        Case {
            name: "an exposure beside all of the light",
            expected: "undetermined: exposure.cam",
            start: TRUTH,
            unknown: "[unknown]\nsun = [\"irradiance\"]\nsky = [\"scale\"]\n",
            state: |text| text.replace(".exr\"\n", ".exr\"\nexposure = \"cam\"\n"),
            ..PLAIN
        },
        Case {
            name: "readings that are no numbers",
            expected: "refused: ",
            spoil: |k, v| if k == 9 { f64::NAN } else { v },
            ..PLAIN
        },
    ];
    let one = |case: &Case| {
        let clock = Instant::now();
        let (verdict, digits) = verdict(case)?;
        Ok(StressRow {
            model: "scene".into(),
            case: case.name.into(),
            expected: case.expected.into(),
            verdict,
            digits,
            condition: None,
            ms: clock.elapsed().as_secs_f64() * 1e3,
        })
    };
    cases.iter().map(one).collect()
}
