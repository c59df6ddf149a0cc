//! `mesophyll eval gloss` and `fit gloss` as programs.

use crate::skips;
use assert_cmd::Command;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

const GEOMETRY: &str = "height_mm = 100.0\ntube_length_mm = 500.0\ntube_radius_mm = 2.5\ncamera_deg = 55.0\nu_start = \
 -4.0\nu_end = 2.5\nframes = 100\n\
                        noise_relative = 0.01\nnoise_floor = 5e-4\n";

fn geometry(dir: &Path, text: &str) -> PathBuf {
    let path = dir.join("geometry.toml");
    std::fs::write(&path, text).unwrap();
    path
}

fn mesophyll(args: &[&str], input: &str) -> (i32, String, String) {
    let out = Command::cargo_bin("mesophyll").unwrap().args(args).write_stdin(input).output().unwrap();
    (out.status.code().unwrap(), String::from_utf8(out.stdout).unwrap(), String::from_utf8(out.stderr).unwrap())
}

fn rows(csv_text: &str) -> Vec<HashMap<String, String>> {
    let mut reader = csv::Reader::from_reader(csv_text.as_bytes());
    reader.deserialize().map(|r| r.unwrap()).collect()
}

fn number(row: &HashMap<String, String>, name: &str) -> f64 {
    row[name].parse().unwrap_or_else(|_| panic!("{name} of {row:?}"))
}

#[test]
fn what_eval_shows_fit_gives_back() {
    let dir = tempfile::tempdir().unwrap();
    let geo = geometry(dir.path(), GEOMETRY);
    let geo = geo.to_str().unwrap();
    for lobe in ["beckmann", "ggx", "cook-torrance"] {
        let truth = [(0.1, 0.05, 0.2, 0.05), (0.3, 0.02, 0.08, -0.1), (0.02, 0.08, 0.4, 0.1)];
        let input: String = std::iter::once("id,rho_d,rho_s,m,tilt\n".to_string())
            .chain(truth.iter().enumerate().map(|(k, t)| format!("t{k},{},{},{},{}\n", t.0, t.1, t.2, t.3)))
            .collect();
        let (code, traces, err) = mesophyll(&["eval", "gloss", "--geometry", geo, "--lobe", lobe], &input);
        assert_eq!(code, 0, "{err}");
        let (code, fits, err) = mesophyll(&["fit", "gloss", "--geometry", geo, "--lobe", lobe, "-q"], &traces);
        assert_eq!((code, err.as_str()), (0, ""));
        for (row, t) in rows(&fits).iter().zip(truth) {
            // Without noise, the truth is recovered far within the errors that follow from the stated noise.
            for (name, want) in [("rho_d", t.0), ("rho_s", t.1), ("m", t.2), ("tilt", t.3)] {
                let (got, err) = (number(row, name), number(row, &format!("{name}_err")));
                assert!((got - want).abs() < 0.1 * err && err > 0.0, "{lobe} {name}: {got} ± {err}, truth {want}");
            }
            assert!(number(row, "chi2") < 1.0);
        }
    }
}

/// Tilts in degrees are those in radians times 180/π.
#[test]
fn tilts_may_be_given_in_degrees() {
    let dir = tempfile::tempdir().unwrap();
    let geo = geometry(dir.path(), GEOMETRY);
    let eval = |input: &str| mesophyll(&["-q", "eval", "gloss", "--geometry", geo.to_str().unwrap()], input);
    let radians =
        eval(&format!("rho_d,rho_s,m,tilt,tilt_y\n0.1,0.05,0.3,{:?},{:?}\n", 8f64.to_radians(), (-5f64).to_radians()));
    let degrees = eval("rho_d,rho_s,m,tilt_deg,tilt_y_deg\n0.1,0.05,0.3,8,-5\n");
    assert_eq!(degrees, radians);
    assert_ne!(degrees.1, eval("rho_d,rho_s,m,tilt,tilt_y\n0.1,0.05,0.3,0,0\n").1);
    let beyond = eval("rho_d,rho_s,m,tilt_deg\n0.1,0.05,0.3,89\n");
    assert!(beyond.1.contains("refused: tilt_deg or tilt_y is beyond 1.5 rad"), "{}", beyond.1);
}

#[test]
fn noisy_rgb_traces_and_their_errors() {
    let dir = tempfile::tempdir().unwrap();
    let geo = geometry(dir.path(), GEOMETRY);
    let geo = geo.to_str().unwrap();
    let header = "id,seed,rho_d_r,rho_d_g,rho_d_b,rho_s_r,rho_s_g,rho_s_b,m,tilt\n";
    let input: String = std::iter::once(header.to_string())
        .chain((0..300).map(|k| format!("{k},{k},0.1,0.2,0.05,0.05,0.05,0.06,0.25,0.08\n")))
        .collect();
    let (_, traces, _) = mesophyll(&["eval", "gloss", "--geometry", geo, "--noise", "0.01", "--seed", "5"], &input);
    let (_, again, _) =
        mesophyll(&["eval", "gloss", "--geometry", geo, "--noise", "0.01", "--seed", "5", "--threads", "1"], &input);
    assert_eq!(traces, again);
    let (code, fits, err) = mesophyll(&["fit", "gloss", "--geometry", geo], &traces);
    assert_eq!(code, 0, "{err}");
    let fits = rows(&fits);
    assert_eq!(fits.len(), 300);
    for (name, want) in [("rho_d_g", 0.2), ("rho_d_b", 0.05), ("rho_s_r", 0.05), ("m", 0.25), ("tilt", 0.08)] {
        let inside =
            fits.iter().filter(|r| (number(r, name) - want).abs() < 1.96 * number(r, &format!("{name}_err"))).count();
        // 285 are expected, with a standard deviation of 3.8.
        assert!((270..=298).contains(&inside), "{name}: {inside} of 300 inside their 95 % interval");
    }
    let mean: f64 = fits.iter().map(|r| number(r, "chi2")).sum::<f64>() / 300.0;
    assert!((mean - 292.0).abs() < 8.0, "mean chi2 {mean}, 300 samples − 8 parameters");
    assert!(fits.iter().all(|r| r["status"] == "ok" && r["id"].parse::<u32>().is_ok()));
}

#[test]
fn bad_rows_are_named_in_their_rows() {
    let dir = tempfile::tempdir().unwrap();
    let geo = geometry(dir.path(), GEOMETRY);
    let geo = geo.to_str().unwrap();
    let (_, traces, _) =
        mesophyll(&["eval", "gloss", "--geometry", geo], "id,rho_d,rho_s,m,tilt\ngood,0.1,0.05,0.2,0.0\n");
    let good = traces.lines().nth(1).unwrap().rsplit_once(',').unwrap().0;
    let cells: Vec<&str> = good.split(',').collect();
    let mut clipped: Vec<String> = cells.iter().map(|c| c.to_string()).collect();
    let peak =
        (1..=100).max_by(|a, b| cells[*a].parse::<f64>().unwrap().total_cmp(&cells[*b].parse().unwrap())).unwrap();
    clipped[0] = "clipped".into();
    clipped[peak - 1..=peak + 1].fill(String::new());
    clipped[peak] = "nan".into();
    let mut spiked: Vec<String> = cells.iter().map(|c| c.to_string()).collect();
    spiked[0] = "spiked".into();
    spiked[90] = "3.0".into();
    let head = traces.lines().next().unwrap().rsplit_once(',').unwrap().0;
    let text = format!(
        "{head}\n{good}\n{}\n{}\nempty{}\nword,x{}\nshort,1\n",
        clipped.join(","),
        spiked.join(","),
        ",".repeat(100),
        ",".repeat(99)
    );
    let (code, fits, err) = mesophyll(&["fit", "gloss", "--geometry", geo], &text);
    assert_eq!(code, 0, "{err}");
    let status: Vec<(String, String)> =
        rows(&fits).into_iter().map(|r| (r["id"].clone(), r["status"].clone())).collect();
    assert_eq!(status[0], ("good".into(), "ok".into()));
    assert_eq!(status[1].1, "ok");
    assert_eq!(status[2].1, "ok");
    assert!((number(&rows(&fits)[2], "m") - 0.2).abs() < 1e-3, "a spike does not move the fit");
    assert_eq!(status[3].1, "refused: no readings");
    assert_eq!(status[4].1, "refused: no readings");
    assert!(status[5].1.starts_with("refused: 2 fields"), "{}", status[5].1);
}

#[test]
fn wrong_geometry_is_an_error_with_its_place() {
    let dir = tempfile::tempdir().unwrap();
    for (text, wants) in [
        (GEOMETRY.replace("camera_deg", "camera_angle"), vec!["geometry.toml:4", "camera_angle"]),
        (GEOMETRY.replace("u_end = 2.5\n", ""), vec!["geometry.toml", "u_start, u_end and frames"]),
        (GEOMETRY.replace("height_mm = 100.0", "height_mm = -1"), vec!["height_mm", "-1", "positive"]),
        (GEOMETRY.replace("frames = 100", "frames = 90"), vec!["standard input", "100 trace columns", "90 frames"]),
    ] {
        let geo = geometry(dir.path(), &text);
        let header: Vec<String> = (0..100).map(|k| format!("r{k}")).collect();
        let (code, out, err) =
            mesophyll(&["fit", "gloss", "--geometry", geo.to_str().unwrap()], &format!("{}\n", header.join(",")));
        assert_eq!((code, out.as_str()), (2, ""), "{err}");
        assert!(wants.iter().all(|w| err.contains(w)), "{err}");
        assert_eq!(err.lines().count(), 1, "{err}");
    }
}

#[test]
fn goniometer_samples_give_back_a_known_leaf() {
    // BRF = ρd + π ρs D/(4 cosθi cosθr), written again for Beckmann's lobe and a tilted normal.
    let (rho_s, m, tilt, tilt_y) = (0.04, 0.3, -0.06, 0.05);
    let normal = [f64::sin(tilt) * f64::cos(tilt_y), f64::sin(tilt_y), f64::cos(tilt) * f64::cos(tilt_y)];
    let dir = |t: f64, p: f64| [t.sin() * p.cos(), t.sin() * p.sin(), t.cos()];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let mut text = String::from("leaf,species,source_zenith_deg,view_zenith_deg,view_azimuth_deg,a,b\n");
    for zenith in [0, 15, 30, 45, 60, 75] {
        for azimuth in (0..360).step_by(45) {
            let l = dir(40f64.to_radians(), 0.0);
            let v = dir(f64::from(zenith).to_radians(), f64::from(azimuth).to_radians());
            let h = [l[0] + v[0], l[1] + v[1], l[2] + v[2]];
            let cos2 = dot(h, normal).powi(2) / dot(h, h);
            let d = (-(1.0 / cos2 - 1.0) / (m * m)).exp() / (std::f64::consts::PI * m * m * cos2 * cos2);
            let gloss = std::f64::consts::PI * rho_s * d / (4.0 * dot(l, normal) * dot(v, normal));
            text += &format!("one,x,40,{zenith},{azimuth},{},{}\n", 0.05 + gloss, 0.4 + gloss);
        }
    }
    text += "two,x,40,95,0,1,1\n";
    let (code, out, err) = mesophyll(&["fit", "gloss", "--samples", "--values", "a,b"], &text);
    assert_eq!(code, 0, "{err}");
    let fits = rows(&out);
    for (name, want) in [
        ("rho_d_a", 0.05),
        ("rho_d_b", 0.4),
        ("rho_s", rho_s),
        ("m", m),
        ("tilt", tilt),
        ("tilt_y", tilt_y),
        ("rms", 0.0),
    ] {
        assert!((number(&fits[0], name) - want).abs() < 1e-6, "{name}: {}", fits[0][name]);
    }
    assert_eq!(fits[0]["status"], "ok");
    assert!(fits[1]["status"].starts_with("refused: line 50: view_zenith_deg is 95"), "{}", fits[1]["status"]);
}

/// Directions of a goniometer with readings of a known leaf in the lobe of Beckmann.
fn scan(azimuth: f64) -> Vec<([f64; 4], f64)> {
    let dir = |t: f64, p: f64| [t.sin() * p.cos(), t.sin() * p.sin(), t.cos()];
    let mut out = Vec::new();
    for source in [25.0f64, 50.0] {
        for zenith in [0.0f64, 15.0, 30.0, 45.0, 60.0, 75.0] {
            for turn in (0..360).step_by(45).map(f64::from) {
                let l = dir(source.to_radians(), azimuth.to_radians());
                let v = dir(zenith.to_radians(), (turn + azimuth).to_radians());
                let h = [l[0] + v[0], l[1] + v[1], l[2] + v[2]];
                let cos2 = h[2] * h[2] / (h[0] * h[0] + h[1] * h[1] + h[2] * h[2]);
                let d = (-(1.0 / cos2 - 1.0) / 0.09).exp() / (std::f64::consts::PI * 0.09 * cos2 * cos2);
                let value = 0.1 + std::f64::consts::PI * 0.04 * d / (4.0 * l[2] * v[2]);
                out.push(([source, azimuth, zenith, turn + azimuth], value));
            }
        }
    }
    out
}

#[test]
fn directions_are_read_in_every_form_or_refused() {
    let fit = |text: &str, more: &[&str]| mesophyll(&[&["fit", "gloss", "--samples"], more].concat(), text);
    let table = |head: &str, line: &dyn Fn(&[f64; 4], f64) -> String| {
        scan(70.0).iter().fold(format!("leaf,{head}\n"), |text, (a, v)| text + &format!("a,{}\n", line(a, *v)))
    };
    // The source's azimuth is used, in degrees and in radians; a negative zenith angle lies opposite.
    let degrees = "source_zenith_deg,source_azimuth_deg,view_zenith_deg,view_azimuth_deg,brf";
    let plain = table(degrees, &|a, v| format!("{},{},{},{},{v}", a[0], a[1], a[2], a[3]));
    let signed = table(degrees, &|a, v| format!("{},{},{},{},{v}", a[0], a[1], -a[2], a[3] + 180.0));
    let radians = table("source_zenith,source_azimuth,view_zenith,view_azimuth,brf", &|a, v| {
        let [s, t, z, p] = a.map(f64::to_radians);
        format!("{s},{t},{z},{p},{v}")
    });
    for text in [&plain, &signed, &radians] {
        let (code, out, err) = fit(text, &[]);
        assert_eq!(code, 0, "{err}");
        let row = &rows(&out)[0];
        assert!((number(row, "m") - 0.3).abs() < 1e-6 && (number(row, "rho_s") - 0.04).abs() < 1e-6, "{row:?}");
        assert!(number(row, "tilt").abs() < 1e-6 && number(row, "tilt_y").abs() < 1e-6, "{row:?}");
        assert_eq!(row["status"], "ok");
    }
    // Per cent, and a mirror side at the source's own azimuth.
    let percent = table(degrees, &|a, v| format!("{},{},{},{},{}", a[0], a[1], a[2], a[3], 100.0 * v));
    let status = |text: &str, more: &[&str]| rows(&fit(text, more).1)[0]["status"].clone();
    assert!(status(&percent, &[]).contains("--percent"));
    assert_eq!(status(&percent, &["--percent"]), "ok");
    let opposite = table(degrees, &|a, v| format!("{},{},{},{},{v}", a[0], a[1], a[2], a[3] + 180.0));
    assert!(status(&opposite, &[]).starts_with("undetermined: "));
    assert_eq!(status(&opposite, &["--mirror-azimuth", "0"]), "ok");
    // A view at the horizon costs itself, and is said.
    let (_, out, err) = fit(&format!("{plain}a,30,70,90,70,0.1\n"), &[]);
    assert!(rows(&out)[0]["status"] == "ok" && err.contains("view_zenith_deg is 90"), "{err}");
    // A column that the fit would need.
    let more = plain.replacen("brf", "relative_azimuth_deg,brf", 1);
    let (code, _, err) = fit(&more, &[]);
    assert!(code == 2 && err.contains("relative_azimuth_deg") && err.lines().count() == 1, "{err}");
}

#[test]
fn the_lobe_and_its_index_are_chosen_by_evidence() {
    let text =
        scan(0.0).iter().fold("leaf,source_zenith_deg,view_zenith_deg,view_azimuth_deg,brf\n".into(), |t, (a, v)| {
            format!("{t}a,{},{},{},{v}\n", a[0], a[2], a[3])
        });
    let fit = |more: &[&str]| mesophyll(&[&["fit", "gloss", "--samples"], more].concat(), &text);
    let (code, out, err) = fit(&["--lobe", "auto"]);
    assert_eq!(code, 0, "{err}");
    let row = &rows(&out)[0];
    assert!(err.contains("leaf a: lobe beckmann"), "{err}");
    assert_eq!((number(row, "evidence_beckmann"), row["status"].as_str()), (0.0, "ok"));
    for other in ["ggx", "cook_torrance", "ggx_fresnel"] {
        assert!(number(row, &format!("evidence_{other}")) < -20.0, "{row:?}");
    }
    let (code, _, err) = fit(&["--index", "fit"]);
    assert!(code == 2 && err.contains("cook-torrance"), "{err}");
    let (_, out, _) = fit(&["--lobe", "cook-torrance", "--index", "fit"]);
    let row = &rows(&out)[0];
    assert!(row.contains_key("index_err") && row["status"].contains("index"), "{row:?}");
    assert_eq!(number(&rows(&fit(&["--tilt", "0"]).1)[0], "tilt_err"), 0.0);
}

#[test]
fn real_leaves() {
    let Some(data) = skips::data("leaves/brf.csv") else { return };
    let brf = Path::new(&data).join("leaves/brf.csv");
    let mut medians = Vec::new();
    for lobe in ["beckmann", "ggx"] {
        let (code, out, err) =
            mesophyll(&["fit", "gloss", "--samples", "--lobe", lobe, "--in", brf.to_str().unwrap()], "");
        assert_eq!(code, 0, "{err}");
        let mut rms: Vec<f64> = rows(&out).iter().map(|r| number(r, "rms")).collect();
        rms.sort_by(f64::total_cmp);
        medians.push(rms[rms.len() / 2]);
    }
    assert!(medians[0] <= 0.0147 && medians[1] <= 0.0134, "{medians:?}");
}
