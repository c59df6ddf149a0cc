//! Faults of a measurement, each put into the files of a clean synthetic scan, with the name that the fit must give it.
//! A verdict is `noticed: NAME: SENTENCE`, `refused: …`, or `ok` where nothing was noticed.

mod dome_photo;
mod edits;

use crate::stress::StressRow;
use crate::{Error, Result};
use edits::{
    both_sides, change, every, exchange, exchange_ends, flip, frame, manifest, noisy, put, reverse, scale, shift, srgb,
};
use mesophyll_files::image::read_exr;
use mesophyll_fits::leaf::{self, Options};
use mesophyll_fits::record::maker::FitOutcome;
use mesophyll_optics::gloss::Lobe;
use mesophyll_synth::leaf::SyntheticLeaf;
use mesophyll_synth::scan;
use mesophyll_synth::spec::{InteriorModel, LeafSpec};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The leaf of the scans.
const LEAF: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/leaves/balata.toml"));
/// Frames a pass, and of the scans with few stops.
const FRAMES: usize = 40;
const FEW: usize = 22;

/// A fault, and what must be said of it.
struct Fault {
    name: &'static str,
    expected: &'static str,
    frames: usize,
    /// The surface follows this lobe.
    lobe: Lobe,
    put: fn(&Path) -> Result<()>,
}

const fn fault(name: &'static str, expected: &'static str, put: fn(&Path) -> Result<()>) -> Fault {
    Fault { name, expected, frames: FRAMES, lobe: Lobe::Beckmann, put }
}

/// Every fault of the table.
fn faults() -> Vec<Fault> {
    vec![
        fault("none", "ok", |_| Ok(())),
        Fault { frames: FEW, ..fault("none, few stops", "ok", |_| Ok(())) },
        fault("camera_deg 45 for 55", "noticed: camera-angle", |c| manifest(c, "camera_deg", 45.0)),
        Fault {
            frames: FEW,
            ..fault("camera_deg 45 for 55, few stops", "noticed: camera-angle", |c| manifest(c, "camera_deg", 45.0))
        },
        fault("tube.height_mm 115 for 100", "noticed: tube-height", |c| manifest(c, "tube.height_mm", 115.0)),
        fault("tube.length_mm 250 for 500", "noticed: tube-length", |c| manifest(c, "tube.length_mm", 250.0)),
        fault("tube.radius_mm 8 for 2.5", "noticed: mirror", |c| manifest(c, "tube.radius_mm", 8.0)),
        fault("texel_mm 1.3 times too large", "noticed: texel-size", |c| scale(c, "texel_mm", 1.3)),
        fault("thickness_mm 15", "noticed: thickness", |c| manifest(c, "thickness_mm", 15.0)),
        fault("thickness in µm", "refused: capture.toml", |c| scale(c, "thickness_mm", 1000.0)),
        fault("start_mm and end_mm of pass x exchanged", "noticed: pass-reversed", exchange_ends),
        fault("noise stated three times too small", "noticed: noise-understated", |c| {
            scale(c, "noise_relative", 1.0 / 3.0)?;
            scale(c, "noise_floor", 1.0 / 3.0)
        }),
        fault("noise stated twice too large", "noticed: noise-overstated", |c| {
            scale(c, "noise_relative", 2.0)?;
            scale(c, "noise_floor", 2.0)
        }),
        fault("one frame times 1.5", "noticed: frame-brightness", |c| change(&frame(c, "front", "x", 17), |v| 1.5 * v)),
        fault("one frame times 1.2", "noticed: frame-brightness", |c| change(&frame(c, "back", "y", 21), |v| 1.2 * v)),
        fault("one frame black", "noticed: frame-dark", |c| change(&frame(c, "front", "x", 17), |_| 0.002)),
        fault("a frame without readings", "noticed: frame-unread", |c| {
            change(&frame(c, "front", "x", 17), |_| f32::NAN)
        }),
        fault("a white frame times 1.5", "noticed: white-frame", |c| change(&c.join("white/x/0017.exr"), |v| 1.5 * v)),
        fault("two frames exchanged", "noticed: frames-exchanged", |c| {
            exchange(&frame(c, "front", "x", 12), &frame(c, "front", "x", 19))
        }),
        fault("one frame copied over the next", "noticed: frame-copied", |c| {
            let copied = std::fs::copy(frame(c, "front", "y", 19), frame(c, "front", "y", 20));
            copied.map(|_| ()).map_err(|e| Error::write(c, e))
        }),
        fault("one stop photographed twice", "noticed: frame-displaced", |c| {
            let maps = read_exr(&frame(c, "front", "x", 13))?;
            put(&frame(c, "front", "x", 15), &noisy(maps, 7))
        }),
        fault("frames of pass x in reverse", "noticed: pass-reversed", |c| {
            both_sides(|side| reverse(&c.join(side).join("x")))
        }),
        fault("frames of pass y in reverse", "noticed: pass-reversed", |c| {
            both_sides(|side| reverse(&c.join(side).join("y")))
        }),
        fault("frames of passes x and y exchanged", "noticed: passes-exchanged", |c| {
            both_sides(|side| exchange(&c.join(side).join("x"), &c.join(side).join("y")))
        }),
        fault("white frames of passes x and y exchanged", "noticed: passes-exchanged", |c| {
            exchange(&c.join("white/x"), &c.join("white/y"))
        }),
        fault("dark frame missing", "noticed: dark-level", |c| {
            std::fs::remove_file(c.join("dark.exr")).map_err(|e| Error::write(c, e))
        }),
        fault("dark level taken off before, and again by dark.exr", "noticed: dark-level", |c| {
            ["front", "back", "white"].iter().try_for_each(|folder| every(c, folder, |v| v - 0.002))
        }),
        fault("light in the room: 0.01", "noticed: stray-light", |c| {
            both_sides(|side| ["x", "y"].iter().try_for_each(|pass| every(&c.join(side), pass, |v| v + 0.01)))
        }),
        fault("frames coded with sRGB", "noticed: coded-frames", |c| {
            both_sides(|side| ["x", "y"].iter().try_for_each(|pass| every(&c.join(side), pass, srgb)))
        }),
        fault("everything coded with sRGB", "noticed: coded-frames", |c| every(c, "", srgb)),
        fault("everything coded with a gamma of 2.2", "noticed: coded-frames", |c| {
            every(c, "", |v| v.max(0.0).powf(1.0 / 2.2))
        }),
        fault("frames of 8 bits", "noticed: few-values", |c| every(c, "", |v| (v * 255.0).round() / 255.0)),
        fault("light falls by 15 % over pass x", "noticed: drift", |c| {
            both_sides(|side| {
                (0..FRAMES).try_for_each(|k| {
                    change(&frame(c, side, "x", k), |v| v * (1.0 - 0.15 * k as f32 / (FRAMES - 1) as f32))
                })
            })
        }),
        fault("pass y brighter by 10 %", "noticed: pass-brightness", |c| {
            both_sides(|side| every(&c.join(side), "y", |v| 1.1 * v))
        }),
        fault("leaf moved within pass x", "noticed: moved", |c| {
            (18..FRAMES).try_for_each(|k| shift(&frame(c, "front", "x", k), [1, 0]))?;
            (0..FRAMES).try_for_each(|k| shift(&frame(c, "front", "y", k), [1, 0]))
        }),
        fault("leaf moved between the passes", "noticed: moved", |c| {
            (0..FRAMES).try_for_each(|k| shift(&frame(c, "front", "y", k), [1, 1]))
        }),
        fault("leaf moved between the sides", "noticed: back-shifted", |c| {
            shift(&c.join("back/lightbox.exr"), [2, 1])?;
            ["x", "y"]
                .iter()
                .try_for_each(|pass| (0..FRAMES).try_for_each(|k| shift(&frame(c, "back", pass, k), [2, 1])))
        }),
        fault("back not turned", "noticed: back-not-turned", |c| {
            flip(&c.join("back/lightbox.exr"))?;
            ["x", "y"].iter().try_for_each(|pass| (0..FRAMES).try_for_each(|k| flip(&frame(c, "back", pass, k))))
        }),
        fault("back's light box is the front's", "noticed: box-mirrored", |c| {
            let copied = std::fs::copy(c.join("front/lightbox.exr"), c.join("back/lightbox.exr"));
            copied.map(|_| ()).map_err(|e| Error::write(c, e))
        }),
        fault("light boxes of the sides exchanged", "noticed: box-mirrored", |c| {
            exchange(&c.join("front/lightbox.exr"), &c.join("back/lightbox.exr"))
        }),
        fault("front's light box and the empty box exchanged", "refused: front: no texel", |c| {
            exchange(&c.join("front/lightbox.exr"), &c.join("lightbox_empty.exr"))
        }),
        fault("light box saturated", "noticed: box-saturated", |c| {
            ["lightbox_empty.exr", "front/lightbox.exr", "back/lightbox.exr"]
                .iter()
                .try_for_each(|name| change(&c.join(name), |v| v.min(0.8)))
        }),
        fault("empty box darker by 10 %", "noticed: box-exposure", |c| {
            change(&c.join("lightbox_empty.exr"), |v| 0.9 * v)
        }),
        fault("leaf moved between tube and light box", "noticed: box-shifted", |c| {
            shift(&c.join("front/lightbox.exr"), [2, 0])
        }),
        fault("white frames missing, gains near 1", "ok", |c| {
            // Nothing in the readings tells their unit while ρd + ρt stays below 1.
            std::fs::remove_dir_all(c.join("white")).map_err(|e| Error::write(c, e))
        }),
        fault("white sheet of .8 taken for 1", "ok", |c| {
            // A scale of all reflectances; only ρd + ρt > 1 could tell.
            ["x", "y"].iter().try_for_each(|pass| every(&c.join("white"), pass, |v| 0.002 + 0.8 * (v - 0.002)))
        }),
        Fault {
            lobe: Lobe::CookTorrance { index: 1.45 },
            ..fault("surface of another lobe", "noticed: lobe", |_| Ok(()))
        },
    ]
}

/// Runs every fault.
///
/// # Errors
/// [`Error::Write`] where no temporary folder can be had.
pub fn rows() -> Result<Vec<StressRow>> {
    let folder = tempfile::tempdir().map_err(|e| Error::write(&std::env::temp_dir(), e))?;
    let mut clean: Vec<(usize, Lobe, PathBuf)> = Vec::new();
    let mut out = Vec::new();
    for (n, fault) in faults().iter().enumerate() {
        let known = clean.iter().find(|c| (c.0, c.1) == (fault.frames, fault.lobe)).map(|c| c.2.clone());
        let from = match known {
            Some(path) => path,
            None => {
                let path = folder.path().join(format!("clean-{}", clean.len()));
                synthesise(fault, &path)?;
                clean.push((fault.frames, fault.lobe, path.clone()));
                path
            }
        };
        let capture = folder.path().join(format!("scan-{n}"));
        copy(&from, &capture)?;
        (fault.put)(&capture)?;
        let fit = folder.path().join(format!("fit-{n}"));
        let run = |capture: &Path, fit: &Path| leaf::run(capture, fit, &Options::default());
        out.push(judged(&format!("fault: {}", fault.name), fault.expected, [&capture, &fit], run)?);
        std::fs::remove_dir_all(&capture).map_err(|e| Error::write(&capture, e))?;
    }
    out.extend(dome_photo::rows()?);
    Ok(out)
}

/// Whether numbers of a fit that nobody changed do not go together.
fn contradicts(fit: &Path) -> Result<bool> {
    let found = mesophyll_fits::consistency::of(fit)?;
    found.contradictions.iter().for_each(mesophyll_files::progress::say);
    Ok(!found.contradictions.is_empty())
}

/// Fits a capture, and says what its fit names.
fn judged(
    case: &str,
    expected: &str,
    [capture, fit]: [&Path; 2],
    run: impl Fn(&Path, &Path) -> Result<FitOutcome>,
) -> Result<StressRow> {
    let clock = Instant::now();
    let outcome = run(capture, fit);
    let ms = clock.elapsed().as_secs_f64() * 1e3;
    let verdict = match outcome {
        Ok(FitOutcome::Done(_) | FitOutcome::UpToDate(_)) if contradicts(fit)? => {
            "wrong: the fit contradicts itself".into()
        }
        Ok(FitOutcome::Done(record) | FitOutcome::UpToDate(record)) => match record.faults.as_slice() {
            [] => "ok".to_string(),
            [first, more @ ..] => {
                let more: Vec<&str> = more.iter().map(|f| f.name.as_str()).collect();
                let also = if more.is_empty() { String::new() } else { format!(" (also {})", more.join(", ")) };
                format!("noticed: {}: {}{also}", first.name, first.says)
            }
        },
        Ok(FitOutcome::ShardDone { .. }) => "wrong: a shard of one is not the whole".to_string(),
        Err(e) => {
            let said = e.to_string();
            let said = said.replace(&format!("{}/", capture.display()), "");
            format!("refused: {}", said.replace(&capture.display().to_string(), "the capture"))
        }
    };
    Ok(StressRow {
        model: "leaf".into(),
        case: case.into(),
        expected: expected.into(),
        verdict,
        digits: None,
        condition: None,
        ms,
    })
}

fn synthesise(fault: &Fault, path: &Path) -> Result<()> {
    let mut spec: LeafSpec = LEAF.parse().map_err(|e| Error::Missed(format!("the stress leaf cannot be read: {e}")))?;
    (spec.veins.tertiary_mm, spec.veins.areole_mm) = (0.0, 0.0);
    spec.lobe = fault.lobe;
    let [width, height] = [40, 30];
    let leaf = SyntheticLeaf::grow(&spec, InteriorModel::Exact, width, height)
        .ok_or_else(|| Error::Missed(format!("{}: no texel on the leaf", fault.name)))?;
    let options = scan::Options { width, height, frames: fault.frames, seed: 5, ..scan::Options::default() };
    scan::scan(&spec, &leaf, &options, path)?;
    Ok(())
}

fn copy(from: &Path, to: &Path) -> Result<()> {
    let fail = |e| Error::write(to, e);
    std::fs::create_dir_all(to).map_err(fail)?;
    for entry in std::fs::read_dir(from).map_err(fail)? {
        let entry = entry.map_err(fail)?;
        let (path, target) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() {
            copy(&path, &target)?;
        } else {
            std::fs::copy(&path, &target).map_err(fail)?;
        }
    }
    Ok(())
}
