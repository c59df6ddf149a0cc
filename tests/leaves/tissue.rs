//! `mesophyll fit tissue` as a program: photographs made by `synth` on a blade whose maps are the true ones, and then
//! every fault that they can have.

use crate::common::{copy_tree, refused, run, succeeded, was_fitted};
use mesophyll::files::image::{ChannelMaps, Packing, read_exr, write_exr};
use mesophyll::fits::record::{FitKind, FitParameter, FitRecord, FitTimes, RecordSection, SCHEMA};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Photographs of a patch of an elm leaf in texels of .1 mm, and the leaf fit of this patch.
struct Set {
    dir: tempfile::TempDir,
    beams: PathBuf,
    blade: PathBuf,
}

/// Two slanting beams with one elevation, because every other incidence needs another solution of the transport
/// equation.
const SLANTING: [&str; 6] = ["--beam", "front,90,0", "--beam", "front,50,30", "--beam", "back,50,200"];

fn set(size: [&str; 2], beams: &[&str], extra: &[&str]) -> Set {
    let dir = crate::common::kept::kept();
    let folder = dir.path().join("beams");
    let mut args = vec![
        "synth",
        "data/leaves/elm.toml",
        "-o",
        folder.to_str().unwrap(),
        "--acquisition",
        "beams",
        "--model",
        "exact",
    ];
    args.extend(["--patch-mm", size[0], "--size", size[1]].iter().chain(beams).chain(extra));
    succeeded(&run(args));
    let blade = dir.path().join("leaf");
    leaf_fit(&folder, &blade, 1.0);
    Set { dir, beams: folder, blade }
}

/// A copy of the set with slanting beams and 1 % of noise. The set is made once.
fn slanting() -> Set {
    static ONCE: OnceLock<Set> = OnceLock::new();
    let made = ONCE.get_or_init(|| set(["3.2", "32x30"], &SLANTING, &["--noise", "0.01", "--seed", "4"]));
    let dir = tempfile::tempdir().unwrap();
    copy_tree(made.dir.path(), dir.path());
    let [beams, blade] = ["beams", "leaf"].map(|n| dir.path().join(n));
    Set { dir, beams, blade }
}

/// Error of the thickness that the leaf fit states for each texel.
const THICKNESS_ERR_MM: f32 = 1e-4;

/// A folder like that of `fit leaf`, made from a capture's truth, with σ multiplied by a factor.
fn leaf_fit(beams: &Path, blade: &Path, off: f64) {
    std::fs::create_dir_all(blade).unwrap();
    let mut record = FitRecord { schema: SCHEMA, kind: FitKind::Leaf, name: "elm".into(), ..FitRecord::default() };
    record.options.insert("texel_mm".into(), "0.1".into());
    for side in ["front", "back"] {
        let truth = read_exr(&beams.join(format!("truth/{side}.exr"))).unwrap();
        let get = |name: &str| truth.get(name).unwrap().to_vec();
        let mut maps = ChannelMaps::new(truth.width, truth.height);
        for name in ["rho_d.R", "rho_d.G", "rho_d.B", "rho_t.R", "rho_t.G", "rho_t.B", "mask.Y", "thickness.Y"] {
            maps.push(name, get(name));
        }
        ["normal.X", "normal.Y", "normal.Z"].iter().for_each(|c| maps.push(*c, get(c)));
        write_exr(&blade.join(format!("{side}.exr")), &maps, Packing::Zip).unwrap();
        let mut errors = ChannelMaps::new(truth.width, truth.height);
        errors.push("thickness.Y", vec![THICKNESS_ERR_MM; truth.width * truth.height]);
        write_exr(&blade.join(format!("{side}_err.exr")), &errors, Packing::Zip).unwrap();
        let d = get("thickness.Y");
        let mut section = RecordSection::default();
        let mut put = |name: &str, value: Vec<f64>| {
            let stderr = value.iter().map(|v| 0.01 * v).collect();
            section.params.insert(name.into(), FitParameter { value, stderr, ..FitParameter::default() });
        };
        put("thickness", vec![d.iter().map(|v| f64::from(*v)).sum::<f64>() / d.len() as f64]);
        for q in ["sigma_a", "sigma_s"] {
            put(q, ["R", "G", "B"].map(|c| off * f64::from(get(&format!("{q}.{c}"))[0])).to_vec());
        }
        record.sections.insert(side.into(), section);
    }
    record.write(blade).unwrap();
}

impl Set {
    fn fit(&self, extra: &[&str]) -> std::process::Output {
        let out = self.dir.path().join("out");
        let mut args = vec![
            "fit",
            "tissue",
            self.beams.to_str().unwrap(),
            "--blade",
            self.blade.to_str().unwrap(),
            "-o",
            out.to_str().unwrap(),
        ];
        args.extend(extra);
        run(args)
    }

    fn edit(&self, from: &str, to: &str) {
        let path = self.beams.join("capture.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{text}");
        std::fs::write(path, text.replacen(from, to, 1)).unwrap();
    }
}

#[test]
fn photographs_give_back_what_they_were_made_of() {
    let set = slanting();
    let out = set.fit(&["--levels", "4", "--margin-mm", "0.6"]);
    succeeded(&out);
    let text = String::from_utf8_lossy(&out.stdout);
    assert!(
        text.contains("undetermined: g: only (1 - g) sigma_s") && text.contains("agrees with the slab fit"),
        "{text}"
    );
    let folder = set.dir.path().join("out");
    let record = FitRecord::read(&folder).unwrap();
    assert_eq!(mesophyll::report::figure::unnamed(&record), Vec::<String>::new());
    let all = &record.sections["all"];
    for name in ["sigma_a", "sigma_s_reduced"] {
        let (param, truth) = (&all.params[name], &all.truth[name]);
        assert!(param.undetermined.is_empty(), "{param:?}");
        for c in 0..3 {
            assert!(param.stderr[c] > 0.0 && param.stderr[c] < 0.1 * param.value[c], "{param:?}");
        }
        let widest = (0..3).map(|c| param.stderr[c] / param.value[c]).fold(0.0, f64::max);
        assert!(truth.p99_relative < 4.0 * widest, "{name} {truth:?} {param:?}");
    }
    let scale = &all.params["thickness_scale"];
    assert!((scale.value[0] - 1.0).abs() < 4.0 * scale.stderr[0] && scale.stderr[0] < 0.05, "{scale:?}");
    assert!((0.9..1.1).contains(&all.figures["reduced_chi2"]), "{:?}", all.figures);
    let trace = &FitTimes::read(&folder).unwrap().traces["tissue"];
    assert!(trace.len() >= 2 && trace.last().unwrap().truth_error.unwrap() < 0.3);
    // The report shows it, and a second run has nothing to compute.
    let report = run(["report", folder.to_str().unwrap(), "--json"]);
    succeeded(&report);
    assert!(String::from_utf8_lossy(&report.stdout).contains("sigma_s_reduced"));
    let before = std::fs::read(folder.join("fit.toml")).unwrap();
    succeeded(&set.fit(&["--levels", "4", "--margin-mm", "0.6"]));
    succeeded(&set.fit(&["--levels", "4", "--margin-mm", "0.6", "--force"]));
    assert_eq!(before, std::fs::read(folder.join("fit.toml")).unwrap());
}

#[test]
fn a_slab_that_is_off_is_told_why() {
    let set = slanting();
    leaf_fit(&set.beams, &set.blade, 1.15);
    let out = set.fit(&["--levels", "2", "--margin-mm", "0.6", "--fix-scale", "--g", "0.5", "--json"]);
    succeeded(&out);
    let record: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let said = record["options"]["comparison"].as_str().unwrap();
    assert!(said.contains("differs from the slab fit in") && said.contains("light"), "{said}");
    let all = &record["all"];
    let value = |name: &str, c: usize| all[name]["value"][c].as_f64().unwrap();
    for c in 0..3 {
        assert!((value("sigma_s", c) / value("sigma_s_reduced", c) - 2.0).abs() < 1e-12);
    }
    assert_eq!(value("thickness_scale", 0), 1.0);
}

/// The thickness map is wrong by its stated error. The photographs then scatter far more than their noise, and the
/// printed errors contain this.
#[test]
fn errors_of_the_thickness_map_are_in_the_printed_errors() {
    let set = slanting();
    let fit = |set: &Set| {
        was_fitted(&set.fit(&["--levels", "3", "--margin-mm", "0.6", "--fix-scale", "--force"]));
        FitRecord::read(&set.dir.path().join("out")).unwrap().sections.remove("all").unwrap()
    };
    let exact = fit(&set);
    let mut state = 1u32;
    for side in ["front", "back"] {
        let change = |name: &str, change: &mut dyn FnMut(&mut f32)| {
            let path = set.blade.join(format!("{side}{name}.exr"));
            let mut maps = read_exr(&path).unwrap();
            let plane = maps.channels.iter_mut().find(|(n, _)| n == "thickness.Y").unwrap();
            plane.1.iter_mut().for_each(change);
            write_exr(&path, &maps, Packing::Zip).unwrap();
        };
        // Uniform deviations with a standard deviation of .008 mm.
        change("", &mut |d| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            *d += 0.008 * 12f32.sqrt() * ((state >> 8) as f32 / 16_777_216.0 - 0.5);
        });
        change("_err", &mut |e| *e = 0.008);
    }
    let all = fit(&set);
    let (chi2, expected) = (all.figures["reduced_chi2"], all.figures["expected_reduced_chi2"]);
    assert!(chi2 > 2.0 && (0.5..1.5).contains(&(chi2 / expected)), "{chi2} {expected}");
    for name in ["sigma_a", "sigma_s_reduced"] {
        let (param, truth) = (&all.params[name], &all.truth[name]);
        for c in 0..3 {
            assert!(param.stderr[c] > 1.5 * exact.params[name].stderr[c], "{param:?}");
            assert!(!param.undetermined.iter().any(|u| u.contains("explained")), "{param:?}");
        }
        let widest = (0..3).map(|c| param.stderr[c] / param.value[c]).fold(0.0, f64::max);
        assert!(truth.p99_relative < 4.0 * widest, "{name} {truth:?} {param:?}");
    }
}

#[test]
fn bad_input_is_named() {
    let set = slanting();
    let kinds: [(&str, &str, &[&str]); 8] = [
        ("kind = \"beams\"", "kind = \"dome\"", &["capture.toml", "kind", "beams"]),
        ("elevation_deg = 90.0", "elevation_deg = 0.0", &["beam 1: elevation_deg", "found 0", "above 0"]),
        ("width = 32", "width = 33", &["33x30", "32x30"]),
        ("texel_mm = 0.1", "texel_mm = 0.2", &["texel_mm", "0.2", "leaf fit"]),
        ("photographs/01", "../photographs/01", &["beam 1: file", "inside the capture"]),
        ("photographs/01", "photographs/07", &["07_front"]),
        ("lit = \"front\"", "lit = \"left\"", &["capture.toml", "front"]),
        ("noise_relative = 0.01", "noise = 0.01", &["capture.toml", "noise"]),
    ];
    let path = set.beams.join("capture.toml");
    let whole = std::fs::read_to_string(&path).unwrap();
    for (from, to, words) in kinds {
        set.edit(from, to);
        refused(&set.fit(&[]), 2, words);
        std::fs::write(&path, &whole).unwrap();
    }
    refused(&set.fit(&["--g", "1.5"]), 2, &["--g", "1.5"]);
    refused(&set.fit(&["--margin-mm", "-1"]), 2, &["--margin-mm", "-1"]);
    refused(&run(["fit", "tissue", "nowhere", "--blade", "nowhere", "-o", "x"]), 2, &["nowhere"]);
    let beam = ["synth", "data/leaves/elm.toml", "-o", "x", "--acquisition", "beams", "--beam"];
    refused(&run(beam.iter().chain(&["front,0,0"])), 2, &["--beam", "front,0,0"]);
    refused(&run(["synth", "data/leaves/elm.toml", "-o", "x", "--beam", "front,60,0"]), 2, &["--beam", "beams only"]);
    // Photographs without a reading, and photographs without the light that they state.
    let first = set.beams.join("photographs/01_front_90_0.exr");
    let saved = std::fs::read(&first).unwrap();
    let mut maps = read_exr(&first).unwrap();
    maps.channels[1].1.fill(f32::NAN);
    write_exr(&first, &maps, Packing::Raw).unwrap();
    refused(&set.fit(&[]), 2, &["01_front_90_0.exr", "G", "no texel has a reading"]);
    std::fs::write(&first, saved).unwrap();
    // A leaf fit without stated errors of its thickness.
    let errors = set.blade.join("front_err.exr");
    let saved = std::fs::read(&errors).unwrap();
    std::fs::remove_file(&errors).unwrap();
    refused(&set.fit(&[]), 2, &["front_err.exr"]);
    std::fs::write(&errors, saved).unwrap();
    // A leaf fit of one side only.
    let mut record = FitRecord::read(&set.blade).unwrap();
    record.sections.remove("back");
    record.write(&set.blade).unwrap();
    refused(&set.fit(&[]), 2, &["beam 3: lit", "no back"]);
    std::fs::remove_file(set.blade.join("fit.toml")).unwrap();
    refused(&set.fit(&[]), 2, &["no leaf fit here"]);
}

/// `inspect --json`: exit code, problems, warnings, and the whole output.
fn look(set: &Set) -> (i32, String, String, serde_json::Value) {
    let out = run(["inspect", set.beams.to_str().unwrap(), "--json"]);
    let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let list = |name: &str| {
        found[name].as_array().unwrap().iter().map(|v| format!("{}\n", v.as_str().unwrap())).collect::<String>()
    };
    (out.status.code().unwrap(), list("problems"), list("warnings"), found.clone())
}

fn each(set: &Set, file: &str, change: impl Fn(usize, &mut [f32])) {
    let path = set.beams.join("photographs").join(file);
    let mut maps = read_exr(&path).unwrap();
    let width = maps.width;
    maps.channels.iter_mut().for_each(|(_, v)| change(width, v));
    write_exr(&path, &maps, Packing::Raw).unwrap();
}

#[test]
fn a_good_capture_is_inspected() {
    let set = slanting();
    let (code, problems, warnings, found) = look(&set);
    assert_eq!((code, problems.as_str(), warnings.as_str()), (0, "", ""));
    // The content is read and counted: beams, angles, field, brightness, noise.
    let photographs = found["photographs"].as_array().unwrap();
    let angles: Vec<_> =
        photographs.iter().map(|p| ["lit", "elevation_deg", "azimuth_deg"].map(|k| p[k].clone())).collect();
    assert_eq!(
        serde_json::json!(angles),
        serde_json::json!([["front", 90.0, 0.0], ["front", 50.0, 30.0], ["back", 50.0, 200.0]])
    );
    assert_eq!(found["leaf_texels"], 32 * 30);
    let field = [0, 1].map(|k: usize| found["field_mm"][k].as_f64().unwrap());
    assert!((field[0] - 3.2).abs() < 1e-9 && (field[1] - 3.0).abs() < 1e-9);
    let maps = read_exr(&set.beams.join("photographs/01_front_90_0.exr")).unwrap();
    let mut green = maps.get("G").unwrap().to_vec();
    green.sort_by(f32::total_cmp);
    let median = photographs[0]["colour"][1].as_f64().unwrap();
    assert!(f64::from(green[479]) <= median && median <= f64::from(green[480]), "{median}");
    // The ratio is an upper bound of the 1 % that was added.
    let ratio = found["noise_seen_over_stated"].as_f64().unwrap();
    assert!(ratio > 0.8, "{ratio}");
    let out = run(["inspect", set.beams.to_str().unwrap()]);
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    for word in [
        "3 photographs under beams",
        "32 × 30 texels of 0.1 mm",
        "50° up",
        "truth/ is there",
        "--blade",
        "This capture can be fitted.",
    ] {
        assert!(said.contains(word), "{word} is missing in\n{said}");
    }
}

#[test]
fn every_file_that_is_wrong_is_named_at_once() {
    let set = slanting();
    std::fs::remove_file(set.beams.join("photographs/01_front_90_0.exr")).unwrap();
    let mut small = ChannelMaps::new(4, 3);
    ["R", "G", "B"].iter().for_each(|c| small.push(*c, vec![0.1; 12]));
    write_exr(&set.beams.join("photographs/02_front_50_30.exr"), &small, Packing::Raw).unwrap();
    each(&set, "03_back_50_200.exr", |_, v| v.fill(f32::NAN));
    let (code, problems, _, _) = look(&set);
    assert_eq!((code, problems.lines().count()), (2, 3), "{problems}");
    for said in [
        "01_front_90_0.exr: no such file",
        "found 4x3 texels, capture.toml says 32x30",
        "03_back_50_200.exr: R: no texel has a reading",
    ] {
        assert!(problems.contains(said), "{said} is missing in\n{problems}");
    }
    set.edit("texel_mm = 0.1", "texel_mm = -0.1");
    let (code, problems, _, _) = look(&set);
    assert!(code == 2 && problems.contains("texel_mm: found -0.1, expected a positive length in mm"), "{problems}");
}

#[test]
fn what_spoils_a_fit_is_a_warning() {
    let warned = |change: &dyn Fn(&Set), said: &[&str]| {
        let set = slanting();
        change(&set);
        let (code, problems, warnings, _) = look(&set);
        assert_eq!((code, problems.as_str()), (0, ""));
        for word in said {
            assert!(warnings.contains(word), "{word} is missing in\n{warnings}");
        }
    };
    // A sensor that clips.
    warned(
        &|set| each(set, "01_front_90_0.exr", |_, v| v.iter_mut().for_each(|v| *v = v.min(0.05))),
        &["01_front_90_0.exr: ", "share the highest value, 0.0500: clipped?"],
    );
    // A photograph from the side that is lit.
    warned(
        &|set| each(set, "03_back_50_200.exr", |width, v| v.chunks_mut(width).for_each(<[f32]>::reverse)),
        &["03_back_50_200.exr: agrees with the first photograph better when mirrored"],
    );
    // Photographs that were not divided by that of the white sheet; a dark level that is too high; a part that is
    // hidden.
    warned(
        &|set| {
            each(set, "01_front_90_0.exr", |_, v| v.iter_mut().for_each(|v| *v *= 40.0));
            each(set, "02_front_50_30.exr", |_, v| v.iter_mut().for_each(|v| *v -= 0.03));
            each(set, "03_back_50_200.exr", |_, v| v[..96].fill(f32::NAN));
        },
        &[
            "brighter than a white sheet that faces the beam",
            "02_front_50_30.exr: ",
            "is the dark level too high?",
            "10.0 % of the leaf has no reading",
        ],
    );
    // A slanting beam with a level sheet, an impossible noise, a low beam, the same beam twice, coarse texels.
    warned(
        &|set| {
            each(set, "02_front_50_30.exr", |_, v| v.iter_mut().for_each(|v| *v *= 3.0));
            set.edit("noise_relative = 0.01", "noise_relative = 0.4");
            set.edit("texel_mm = 0.1", "texel_mm = 0.5");
        },
        &["of the light of beam 2", "not one that lies level", "times the stated one at most", "texel_mm is 0.5"],
    );
    warned(
        &|set| {
            set.edit("elevation_deg = 50.0", "elevation_deg = 20.0");
            set.edit("photographs/03_back_50_200.exr", "photographs/02_front_50_30.exr");
        },
        &["beam 2 stands 20° over the blade", "beams 2 and 3 name the same photograph"],
    );
}
