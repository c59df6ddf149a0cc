//! Stiff and extreme leaves, each with the verdict that it must get. Small synthetic scans, damaged where a case says
//! so, go through the whole of `fit leaf` in a temporary folder.
//!
//! A verdict is `ok` (σa and σs of every channel within 10 %, and the truth within four printed errors, on both sides),
//! `undetermined: ` with the shared parameters that `fit.toml` names (`gloss` where most texels' gloss is not
//! determined), or `refused: ` with the reason. Faults of the measurement ([`super::faults`]) follow; their verdict is
//! `noticed: ` with the fault's name.

use crate::stress::StressRow;
use crate::{Error, Result};
use mesophyll_files::image::{Packing, read_exr, write_exr};
use mesophyll_fits::leaf::{self, Options};
use mesophyll_fits::record::FitRecord;
use mesophyll_fits::record::maker::FitOutcome;
use mesophyll_optics::side::Side;
use mesophyll_optics::tube::Travel;
use mesophyll_synth::leaf::SyntheticLeaf;
use mesophyll_synth::scan;
use mesophyll_synth::spec::{InteriorModel, InteriorSpec, LeafSpec, SurfaceSpec};
use std::path::Path;
use std::time::Instant;

/// The leaf that cases are made from.
const LEAF: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/leaves/balata.toml"));

/// A case: how the leaf differs, how it is scanned, how the scan is damaged, and the verdict that it must get.
struct Case {
    name: &'static str,
    expected: &'static str,
    size: [usize; 2],
    frames: usize,
    noise: f64,
    passes: Vec<Travel>,
    leaf: fn(&mut LeafSpec),
    spoil: fn(&Path) -> Result<()>,
    /// Whether the damaged scan still shows the leaf that it was made from.
    true_to_leaf: bool,
}

impl Default for Case {
    fn default() -> Self {
        Case {
            name: "",
            expected: "ok",
            size: [20, 15],
            frames: 32,
            noise: 0.01,
            passes: vec![Travel::X, Travel::Y],
            leaf: |_| {},
            spoil: |_| Ok(()),
            true_to_leaf: true,
        }
    }
}

fn both_sides(spec: &mut LeafSpec, change: impl Fn(&mut SurfaceSpec)) {
    change(&mut spec.front);
    change(&mut spec.back);
}

fn cases() -> Vec<Case> {
    vec![
        Case { name: "ordinary leaf", ..Case::default() },
        Case { name: "one pass", passes: vec![Travel::X], ..Case::default() },
        Case { name: "values of single precision, no noise", noise: 0.0, ..Case::default() },
        Case { name: "noise 20 %", noise: 0.2, ..Case::default() },
        Case { name: "one texel", size: [1, 1], frames: 60, noise: 0.002, ..Case::default() },
        Case { name: "one row of texels", size: [24, 1], leaf: |s| s.field_mm = [76.0, 3.2], ..Case::default() },
        Case {
            name: "constant images",
            spoil: |c| each_frame(c, |v| v.fill(0.1)),
            true_to_leaf: false,
            expected: "undetermined: sigma_a.R sigma_a.G sigma_a.B sigma_s.R sigma_s.G sigma_s.B",
            ..Case::default()
        },
        Case {
            name: "constant light box",
            spoil: constant_light_box,
            expected: "refused: front: no texel could be fitted",
            ..Case::default()
        },
        Case {
            name: "black images",
            spoil: |c| each_frame(c, |v| v.fill(0.002)),
            expected: "refused: front: no texel",
            ..Case::default()
        },
        Case {
            name: "every reading saturated",
            spoil: |c| each_frame(c, |v| v.fill(f32::NAN)),
            expected: "refused: front: no texel",
            ..Case::default()
        },
        Case { name: "clipped peak", spoil: clipped, ..Case::default() },
        Case {
            name: "one channel black: transmits nothing of blue",
            leaf: |s| s.interior = InteriorSpec { sigma_a: [9.0, 2.6, 120.0], sigma_s: [18.0, 16.0, 60.0] },
            expected: "undetermined: sigma_a.B sigma_s.B",
            ..Case::default()
        },
        Case {
            name: "black leaf: transmits nothing at all",
            leaf: |s| s.interior = InteriorSpec { sigma_a: [150.0; 3], sigma_s: [40.0; 3] },
            expected: "refused: front: no texel",
            ..Case::default()
        },
        Case {
            name: "white leaf: 1-omega 1e-7",
            leaf: |s| {
                s.interior = InteriorSpec { sigma_a: [1.5e-6; 3], sigma_s: [15.0; 3] };
                // A γ above 1 would be more light than arrives.
                both_sides(s, |f| (f.gamma_veins, f.gamma_lamina) = ([0.0; 3], 0.0));
            },
            expected: "undetermined: sigma_a.R sigma_a.G sigma_a.B",
            ..Case::default()
        },
        Case {
            name: "weak scatterer: omega 1e-4",
            leaf: |s| s.interior = InteriorSpec { sigma_a: [8.0; 3], sigma_s: [8e-4; 3] },
            expected: "undetermined: sigma_s.R sigma_s.G sigma_s.B",
            ..Case::default()
        },
        Case {
            name: "rho_s = 0",
            leaf: |s| both_sides(s, |f| f.rho_s = 0.0),
            expected: "undetermined: gloss",
            ..Case::default()
        },
        Case {
            name: "lobe narrower than a frame",
            leaf: |s| both_sides(s, |f| (f.m, f.gloss_veins, f.gloss_lamina) = (0.03, [0.0; 2], [0.0; 2])),
            passes: vec![Travel::X],
            frames: 16,
            expected: "undetermined: gloss",
            ..Case::default()
        },
        Case {
            name: "m = 0.8",
            leaf: |s| both_sides(s, |f| (f.m, f.gloss_veins, f.gloss_lamina) = (0.8, [0.0; 2], [0.0; 2])),
            ..Case::default()
        },
        Case {
            name: "grazing tube: the mirror peak lies beyond its travel",
            leaf: |s| s.device.travel_x_mm = [-110.0, 250.0],
            ..Case::default()
        },
    ]
}

/// Runs every case.
///
/// # Errors
/// [`Error::Write`] where no temporary folder can be had.
pub fn rows() -> Result<Vec<StressRow>> {
    let mut rows = cases().iter().map(run).collect::<Result<Vec<_>>>()?;
    rows.extend(super::faults::rows()?);
    Ok(rows)
}

fn run(case: &Case) -> Result<StressRow> {
    let folder = tempfile::tempdir().map_err(|e| Error::write(&std::env::temp_dir(), e))?;
    let capture = folder.path().join("scan");
    let mut spec: LeafSpec = LEAF.parse().map_err(|e| Error::Missed(format!("the stress leaf cannot be read: {e}")))?;
    // Texels of three millimetres show no fine veins, and growing them would take longer than everything else.
    (spec.veins.tertiary_mm, spec.veins.areole_mm) = (0.0, 0.0);
    (case.leaf)(&mut spec);
    let [width, height] = case.size;
    let leaf = SyntheticLeaf::grow(&spec, InteriorModel::Exact, width, height)
        .ok_or_else(|| Error::Missed(format!("{}: no texel on the leaf", case.name)))?;
    let options = scan::Options {
        width,
        height,
        frames: case.frames,
        passes: case.passes.clone(),
        noise: case.noise,
        seed: 3,
        ..scan::Options::default()
    };
    scan::scan(&spec, &leaf, &options, &capture)?;
    (case.spoil)(&capture)?;
    let clock = Instant::now();
    let outcome = leaf::run(&capture, &folder.path().join("fit"), &Options::default());
    let ms = clock.elapsed().as_secs_f64() * 1e3;
    let (verdict, digits, condition) = match outcome {
        Ok(FitOutcome::Done(record) | FitOutcome::UpToDate(record)) => judge(&record, case, &spec),
        Ok(FitOutcome::ShardDone { .. }) => ("wrong: a shard of one is not the whole".to_string(), None, None),
        // The folder is temporary: only its last part belongs to the case.
        Err(e) => (format!("refused: {}", name_of(&e.to_string())), None, None),
    };
    Ok(StressRow {
        model: "leaf".into(),
        case: case.name.into(),
        expected: case.expected.into(),
        verdict,
        digits,
        condition,
        ms,
    })
}

/// A message without the folders before its first name.
fn name_of(message: &str) -> String {
    let (path, rest) = message.split_once(": ").unwrap_or((message, ""));
    let name = path.rsplit('/').next().unwrap_or(path);
    if rest.is_empty() { name.to_string() } else { format!("{name}: {rest}") }
}

/// The verdict over both sides, correct digits of the worst shared parameter that is claimed, and the condition number.
fn judge(record: &FitRecord, case: &Case, spec: &LeafSpec) -> (String, Option<f64>, Option<f64>) {
    let mut open: Vec<String> = Vec::new();
    let (mut worst, mut condition, mut wrong) = (None::<f64>, None::<f64>, None);
    for side in [Side::Front, Side::Back] {
        let Some(section) = record.sections.get(side.name()) else { continue };
        let count = |name: &str| section.counts.get(name).copied().unwrap_or(0);
        let left_out = 1.0 - count("good") as f64 / (count("texels") - count("outside")).max(1) as f64;
        condition = section.condition.into_iter().chain(condition).reduce(f64::max);
        for (name, truth) in [("sigma_a", spec.interior.sigma_a), ("sigma_s", spec.interior.sigma_s)] {
            let Some(p) = section.params.get(name) else { continue };
            for (c, letter) in ["R", "G", "B"].into_iter().enumerate() {
                let full = format!("{name}.{letter}");
                if p.undetermined.iter().any(|u| u.starts_with(&full)) {
                    if !open.contains(&full) {
                        open.push(full);
                    }
                    continue;
                }
                if !case.true_to_leaf {
                    continue;
                }
                let (value, error) = (p.value[c], p.stderr[c]);
                let off = (value - truth[c]).abs();
                let digits = -(off / truth[c]).clamp(1e-16, 1.0).log10();
                worst = Some(worst.map_or(digits, |w| w.min(digits)));
                // The gauge is the mean thickness of the good texels. Without the other texels the mean differs by
                // their share of its scatter. Maps are in single precision.
                if !(off <= 4.0 * error + (0.2 * left_out + 1e-5) * truth[c]) {
                    wrong = Some(format!(
                        "wrong: {} {full} is {value:.4} ± {error:.1e}, the truth {:.4}",
                        side.name(),
                        truth[c]
                    ));
                }
            }
        }
        if 2 * count("gloss_undetermined") > count("good") && !open.iter().any(|o| o == "gloss") {
            open.push("gloss".into());
        }
        // Maps are judged by their intervals, where there are enough texels and where there is noise.
        for (name, t) in section.truth.iter().filter(|_| case.true_to_leaf && case.noise > 0.0) {
            let gloss = ["rho_s", "m"].contains(&name.as_str());
            // Thickness and γ change with the gauge where texels were left out.
            let gauged = ["thickness", "gamma"].contains(&name.as_str());
            let map = ["rho_d", "rho_t"].contains(&name.as_str())
                || (gloss && !open.iter().any(|o| o == "gloss"))
                || (gauged && left_out == 0.0);
            if let Some(share) = t.coverage95.filter(|share| map && *share < 0.85 && count("good") >= 40) {
                wrong = wrong.or(Some(format!(
                    "wrong: {} {name}: {:.0} % inside 95 % intervals",
                    side.name(),
                    100.0 * share
                )));
            }
        }
    }
    open.sort_by_key(|name| (name == "gloss", name[..name.len().min(7)].to_string()));
    let verdict = match wrong {
        Some(wrong) => wrong,
        None if open.is_empty() => "ok".into(),
        None => format!("undetermined: {}", open.join(" ")),
    };
    (verdict, worst, condition)
}

/// Changes every channel of every frame of both sides.
fn each_frame(capture: &Path, change: impl Fn(&mut Vec<f32>)) -> Result<()> {
    for side in ["front", "back"] {
        for pass in ["x", "y"] {
            let folder = capture.join(side).join(pass);
            let Ok(entries) = std::fs::read_dir(&folder) else { continue };
            for entry in entries.flatten() {
                let mut maps = read_exr(&entry.path())?;
                maps.channels.iter_mut().for_each(|(_, values)| change(values));
                write_exr(&entry.path(), &maps, Packing::Raw)?;
            }
        }
    }
    Ok(())
}

/// Readings above the level that a tenth of the peak's flank reaches are removed, as in a camera whose range is too
/// small.
fn clipped(capture: &Path) -> Result<()> {
    each_frame(capture, |values| values.iter_mut().filter(|v| **v > 0.12).for_each(|v| *v = f32::NAN))
}

/// The photograph of the leaf on the box is replaced by that of the bare box.
fn constant_light_box(capture: &Path) -> Result<()> {
    let bare = read_exr(&capture.join("lightbox_empty.exr"))?;
    for side in ["front", "back"] {
        write_exr(&capture.join(side).join("lightbox.exr"), &bare, Packing::Raw)?;
    }
    Ok(())
}
