//! `mesophyll fit tissue` through the binary: photographs that `synth` makes, on a blade whose maps are the truth's; then everything that can be wrong with them.

mod common;

use common::{refused, run, succeeded};
use mesophyll::files::image::{Maps, Packing, read_exr, write_exr};
use mesophyll::fit::record::{FitRecord, Param, SCHEMA, Section, Times};
use std::path::{Path, PathBuf};

/// Photographs of a patch of an elm leaf in texels of .1 mm, and the leaf fit of just that patch.
struct Set {
    dir: tempfile::TempDir,
    beams: PathBuf,
    blade: PathBuf,
}

fn set(extra: &[&str]) -> Set {
    let dir = tempfile::tempdir().unwrap();
    let beams = dir.path().join("beams");
    let mut args = vec!["synth", "data/leaves/elm.toml", "-o", beams.to_str().unwrap(), "--acquisition", "beams", "--model", "exact"];
    args.extend(["--patch-mm", "3.2", "--size", "32x30", "--beam", "front,90,0", "--beam", "front,50,30", "--beam", "back,70,200"]);
    args.extend(extra);
    succeeded(&run(args));
    let blade = dir.path().join("leaf");
    leaf_fit(&beams, &blade, 1.0);
    Set { dir, beams, blade }
}

/// A folder as `fit leaf` writes it, from a capture's truth; σ off by a factor.
fn leaf_fit(beams: &Path, blade: &Path, off: f64) {
    std::fs::create_dir_all(blade).unwrap();
    let mut record = FitRecord { schema: SCHEMA, kind: "leaf".into(), name: "elm".into(), ..FitRecord::default() };
    record.options.insert("texel_mm".into(), "0.1".into());
    for side in ["front", "back"] {
        let truth = read_exr(&beams.join(format!("truth/{side}.exr"))).unwrap();
        let get = |name: &str| truth.get(name).unwrap().to_vec();
        let (mut maps, mut normals) = (Maps::new(truth.width, truth.height), Maps::new(truth.width, truth.height));
        for name in ["rho_d.R", "rho_d.G", "rho_d.B", "rho_t.R", "rho_t.G", "rho_t.B", "mask.Y", "thickness.Y"] {
            maps.push(name, get(name));
        }
        ["X", "Y", "Z"].iter().for_each(|c| normals.push(*c, get(&format!("normal.{c}"))));
        write_exr(&blade.join(format!("{side}.exr")), &maps, Packing::Zip).unwrap();
        write_exr(&blade.join(format!("{side}_normal.exr")), &normals, Packing::Zip).unwrap();
        let d = get("thickness.Y");
        let mut section = Section::default();
        let mut put = |name: &str, value: Vec<f64>| {
            let stderr = value.iter().map(|v| 0.01 * v).collect();
            section.params.insert(name.into(), Param { value, stderr, ..Param::default() });
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
        let mut args =
            vec!["fit", "tissue", self.beams.to_str().unwrap(), "--blade", self.blade.to_str().unwrap(), "-o", out.to_str().unwrap()];
        args.extend(["--levels", "4"].iter().chain(extra));
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
    let set = set(&["--noise", "0.01", "--seed", "4"]);
    let out = set.fit(&["--margin-mm", "0.6"]);
    succeeded(&out);
    let text = String::from_utf8_lossy(&out.stdout);
    assert!(text.contains("undetermined: g: only (1 - g) sigma_s") && text.contains("agrees with the slab fit"), "{text}");
    let folder = set.dir.path().join("out");
    let record = FitRecord::read(&folder).unwrap();
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
    let trace = &Times::read(&folder).unwrap().traces["tissue"];
    assert!(trace.len() >= 2 && trace.last().unwrap().truth_error.unwrap() < 0.3);
    // The report shows it, and a second run has nothing to do.
    let report = run(["report", folder.to_str().unwrap(), "--json"]);
    succeeded(&report);
    assert!(String::from_utf8_lossy(&report.stdout).contains("sigma_s_reduced"));
    let before = std::fs::read(folder.join("fit.toml")).unwrap();
    succeeded(&set.fit(&["--margin-mm", "0.6"]));
    succeeded(&set.fit(&["--margin-mm", "0.6", "--force"]));
    assert_eq!(before, std::fs::read(folder.join("fit.toml")).unwrap());
}

#[test]
fn a_slab_that_is_off_is_told_why() {
    let set = set(&["--noise", "0.005"]);
    leaf_fit(&set.beams, &set.blade, 1.3);
    let out = set.fit(&["--fix-scale", "--g", "0.5", "--json"]);
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

#[test]
fn bad_input_is_named() {
    let set = set(&[]);
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
    refused(&run(["inspect", set.beams.to_str().unwrap()]), 2, &["beams"]);
    let beam = ["synth", "data/leaves/elm.toml", "-o", "x", "--acquisition", "beams", "--beam"];
    refused(&run(beam.iter().chain(&["front,0,0"])), 2, &["--beam", "front,0,0"]);
    refused(&run(["synth", "data/leaves/elm.toml", "-o", "x", "--beam", "front,60,0"]), 2, &["--beam", "beams only"]);
    // Photographs without a reading, and without the light they claim.
    let first = set.beams.join("photographs/01_front_90_0.exr");
    let saved = std::fs::read(&first).unwrap();
    let mut maps = read_exr(&first).unwrap();
    maps.channels[1].1.fill(f32::NAN);
    write_exr(&first, &maps, Packing::Raw).unwrap();
    refused(&set.fit(&[]), 2, &["01_front_90_0.exr", "G", "no texel has a reading"]);
    std::fs::write(&first, saved).unwrap();
    // A leaf fit of one side only.
    let mut record = FitRecord::read(&set.blade).unwrap();
    record.sections.remove("back");
    record.write(&set.blade).unwrap();
    refused(&set.fit(&[]), 2, &["beam 3: lit", "no back"]);
    std::fs::remove_file(set.blade.join("fit.toml")).unwrap();
    refused(&set.fit(&[]), 2, &["no leaf fit here"]);
}
