//! `eval sky` and `fit sky` as programs.

use assert_cmd::Command;
use std::f64::consts::PI;

fn mesophyll(args: &[&str], input: &str) -> (i32, String, String) {
    let out = Command::cargo_bin("mesophyll").unwrap().args(args).write_stdin(input).output().unwrap();
    (out.status.code().unwrap(), String::from_utf8(out.stdout).unwrap(), String::from_utf8(out.stderr).unwrap())
}

fn table(text: &str) -> (Vec<String>, Vec<Vec<String>>) {
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let header = reader.headers().unwrap().iter().map(String::from).collect();
    (header, reader.records().map(|r| r.unwrap().iter().map(String::from).collect()).collect())
}

/// The numbers r, g, b of each row, for each sky.
fn coefficients(rows: &[Vec<String>], per_sky: usize) -> Vec<Vec<[f64; 3]>> {
    let first = rows[0].len() - 4;
    let number = |r: &Vec<String>, k: usize| r[first + k].parse::<f64>().unwrap();
    rows.chunks(per_sky).map(|sky| sky.iter().map(|r| [number(r, 0), number(r, 1), number(r, 2)]).collect()).collect()
}

#[test]
fn the_contract_of_eval_sky() {
    let input = "note,turbidity,sun_zenith\n\"a,b\",3,0.9\nlow,3,1.5707963267948966\nnight,3,1.58\npole,1.643,0.5\n\
         hazy,9.5,1.2\nempty,,0.3\nshort,3\n";
    let (code, out, err) = mesophyll(&["eval", "sky"], input);
    assert_eq!(code, 0);
    let (header, rows) = table(&out);
    assert_eq!(header, ["note", "turbidity", "sun_zenith", "index", "r", "g", "b", "status"]);
    assert_eq!(rows.len(), 3 * 49 + 4);
    for (k, row) in rows[..49].iter().enumerate() {
        assert_eq!(
            (row[0].as_str(), row[1].as_str(), row[3].as_str(), row[7].as_str()),
            ("a,b", "3", k.to_string().as_str(), "ok")
        );
    }
    let statuses: Vec<&str> = rows.iter().filter(|r| r[7] != "ok").map(|r| r[7].as_str()).collect();
    assert_eq!(statuses.len(), 4);
    for (status, word) in
        statuses.iter().zip(["below the horizon", "turbidity is 1.643", "turbidity is empty", "2 fields"])
    {
        assert!(status.starts_with("refused: ") && status.contains(word), "{status}");
    }
    assert!(rows.iter().filter(|r| r[7] != "ok").all(|r| r[3..7].iter().all(String::is_empty)));
    assert!(err.contains("warning") && err.contains("integrated directly"), "{err}");
    // The harmonics with m < 0 are 0 with the sun at azimuth 0.
    assert_eq!((rows[1][4].as_str(), rows[4][5].as_str()), ("0.0", "0.0"));
}

/// A column in degrees is the same as a column in radians times 180/π. Its refusals are in degrees, and both columns
/// together are an error.
#[test]
fn the_sun_may_be_given_in_degrees() {
    let run = |input: &str| mesophyll(&["--quiet", "eval", "sky", "--bands", "3"], input);
    let angles = [0.0f64, 40.0, 90.0];
    let text =
        |name: &str, unit: f64| format!("{name},turbidity\n") + &angles.map(|a| format!("{:?},3\n", a * unit)).concat();
    let (degrees, radians) =
        (table(&run(&text("sun_zenith_deg", 1.0)).1), table(&run(&text("sun_zenith", PI / 180.0)).1));
    assert_eq!(degrees.0[0], "sun_zenith_deg");
    assert_eq!(degrees.1.len(), 27);
    for (d, r) in degrees.1.iter().zip(&radians.1) {
        assert_eq!((&d[1..], d[6].as_str()), (&r[1..], "ok"));
    }
    let (code, out, _) = run("sun_zenith_deg,turbidity\n91,3\n-1,3\n");
    assert_eq!(code, 1, "every row is refused");
    for (row, found) in table(&out).1.iter().zip(["91", "-1"]) {
        assert_eq!(row[6], format!("refused: sun_zenith_deg is {found}; expected 0 (zenith) to 90 (horizon)"));
    }
    let (code, out, said) = run("sun_zenith_deg,sun_zenith,turbidity\n40,0.7,3\n");
    assert!(code == 2 && out.is_empty() && said.contains("sun_zenith_deg too"), "{said}");
}

/// The default and the compact polynomials are compared with the integral over the whole domain. Where they are a fit,
/// the limits are the 4.1e-6 and 1.1e-5 of the smallest c00 that docs/evidence/sky.md states and a fifth. Elsewhere the
/// digits are the same.
#[test]
fn the_default_is_the_integral_everywhere() {
    let mut input = String::from("sun_zenith,turbidity\n");
    for s in [0.0, 0.4, 0.9, 1.3, 1.5, 1.569, PI / 2.0] {
        for t in [1.7, 2.2, 2.5, 2.6, 4.1, 6.0, 7.5, 10.0] {
            input += &format!("{s:?},{t}\n");
        }
    }
    let run = |method: &[&str]| {
        let (code, out, _) = mesophyll(&[&["--quiet", "eval", "sky"], method].concat(), &input);
        assert_eq!(code, 0);
        let (_, rows) = table(&out);
        assert!(rows.iter().all(|r| r[6] == "ok"));
        (rows.iter().step_by(49).map(|r| r[1].parse().unwrap()).collect::<Vec<f64>>(), coefficients(&rows, 49))
    };
    let ((turbidities, fit), (_, direct), (_, compact)) =
        (run(&[]), run(&["--method", "direct"]), run(&["--method", "compact"]));
    let inside = |t: f64| (2.5..=6.0).contains(&t);
    let smallest = |inner: bool| {
        let of = direct.iter().zip(&turbidities).filter(|(_, t)| inner == inside(**t));
        of.flat_map(|(c, _)| c[0]).fold(f64::INFINITY, f64::min)
    };
    for (k, t) in turbidities.iter().enumerate() {
        for (got, limit) in [(&fit[k], 4.9e-6), (&compact[k], 1.3e-5)] {
            for c in 0..3 {
                let off: f64 = got.iter().zip(&direct[k]).map(|(a, b)| (a[c] - b[c]).powi(2)).sum::<f64>().sqrt()
                    / smallest(inside(*t));
                assert!(
                    off <= if inside(*t) { limit } else { 1e-15 },
                    "sky {k}, turbidity {t}, channel {c}: {off:.1e}"
                );
            }
        }
    }
}

/// c00 of the integral is compared with a plain sum over the hemisphere. The formulas are written again here, without
/// code of the program.
#[test]
fn the_integral_is_of_preethams_sky() {
    let (s, t): (f64, f64) = (0.8, 3.0);
    let (_, out, _) =
        mesophyll(&["--quiet", "eval", "sky", "--method", "direct", "--bands", "2"], "sun_zenith,turbidity\n0.8,3\n");
    let got = &coefficients(&table(&out).1, 4)[0];
    let perez = |p: [f64; 5], theta: f64, gamma: f64| {
        (1.0 + p[0] * (p[1] / theta.cos()).exp()) * (1.0 + p[2] * (p[3] * gamma).exp() + p[4] * gamma.cos().powi(2))
    };
    let lum =
        [0.1787 * t - 1.4630, -0.3554 * t + 0.4275, -0.0227 * t + 5.3251, 0.1206 * t - 2.5771, -0.0670 * t + 0.3703];
    let chi = (4.0 / 9.0 - t / 120.0) * (PI - 2.0 * s);
    let zenith = (4.0453 * t - 4.9710) * chi.tan() - 0.2155 * t + 2.4192;
    let (mut c00, mut c10, mut c11) = (0.0, 0.0, 0.0);
    let n = 700;
    for i in 0..n {
        let mu = (i as f64 + 0.5) / n as f64;
        for j in 0..n {
            let phi = PI * (j as f64 + 0.5) / n as f64;
            let sin = (1.0 - mu * mu).sqrt();
            let gamma = (sin * phi.cos() * s.sin() + mu * s.cos()).clamp(-1.0, 1.0).acos();
            let value = zenith * perez(lum, mu.acos(), gamma) / perez(lum, 0.0, s) * 2.0 * PI / (n * n) as f64;
            c00 += value / (4.0 * PI).sqrt();
            c10 += value * mu * (3.0 / (4.0 * PI)).sqrt();
            c11 += value * sin * phi.cos() * (3.0 / (4.0 * PI)).sqrt();
        }
    }
    // The luminance of linear sRGB (IEC 61966-2-1).
    let y = |c: [f64; 3]| 0.2126729 * c[0] + 0.7151522 * c[1] + 0.0721750 * c[2];
    for (k, want) in [(0, c00), (2, c10), (3, c11)] {
        assert!((y(got[k]) / want - 1.0).abs() < 1e-4, "index {k}: {} {want}", y(got[k]));
    }
}

#[test]
fn more_bands_and_other_skies_by_integration() {
    let input = "sun_zenith,turbidity\n0.7,3\n";
    let (code, out, err) = mesophyll(&["eval", "sky", "--bands", "20"], input);
    assert!(code == 0 && err.contains("integrated directly"), "{err}");
    let (_, rows) = table(&out);
    assert_eq!((rows.len(), rows[399][2].as_str()), (400, "399"));
    let seven = mesophyll(&["--quiet", "eval", "sky", "--method", "direct"], input).1;
    let (a, b) = (coefficients(&rows, 400), coefficients(&table(&seven).1, 49));
    assert!((0..49).all(|k| (0..3).all(|c| (a[0][k][c] - b[0][k][c]).abs() < 1e-9 * b[0][0][c])));
    let (code, out, _) =
        mesophyll(&["--quiet", "eval", "sky", "--model", "hosek-wilkie", "--method", "direct", "--bands", "1"], input);
    assert!(code == 0 && table(&out).1[0][6] == "ok");
    let (code, _, err) = mesophyll(&["--quiet", "eval", "sky", "--model", "hosek-wilkie"], input);
    assert!(code == 2 && err.contains("--method direct"), "{err}");
    for bad in
        [&["--bands", "0"][..], &["--bands", "65"], &["--albedo", "2"], &["--method", "compact", "--bands", "20"]]
    {
        assert_eq!(mesophyll(&[&["--quiet", "eval", "sky"], bad].concat(), input).0, 2, "{bad:?}");
    }
    let (code, _, err) = mesophyll(&["--quiet", "eval", "sky"], "sun_zenith\n0.7\n");
    assert!(code == 2 && err.contains("turbidity"), "{err}");
}

#[test]
fn a_fit_is_written_judged_and_evaluated() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky");
    let path = path.to_str().unwrap();
    let (code, out, _) =
        mesophyll(&["--quiet", "--json", "fit", "sky", "-o", path, "--method", "compact", "--bands", "4"], "");
    assert_eq!(code, 0);
    let json: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert!(json["error_worst"].as_f64().unwrap() < 1.3e-5 && json["bytes"] == 80 * 4 * 30);
    let input = "sun_zenith,turbidity\n0.7,3\n1.2,9\n";
    let (_, ours, _) = mesophyll(&["--quiet", "eval", "sky", "--fit", path, "--bands", "4"], input);
    let (_, direct, _) = mesophyll(&["--quiet", "eval", "sky", "--method", "direct", "--bands", "4"], input);
    let (a, b) = (coefficients(&table(&ours).1, 16), coefficients(&table(&direct).1, 16));
    for k in 0..16 {
        for c in 0..3 {
            assert!((a[0][k][c] - b[0][k][c]).abs() < 1.3e-5 * b[0][0][c]);
            assert_eq!(a[1][k][c], b[1][k][c]);
        }
    }
    let (code, _, err) = mesophyll(
        &["--quiet", "fit", "sky", "-o", path, "--method", "monomials-normal", "--bands", "2", "--grid", "50"],
        "",
    );
    assert!(code == 1 && err.contains("not positive definite"), "{err}");
    let (code, _, err) = mesophyll(&["--quiet", "fit", "sky", "-o", path, "--turbidity", "1,3"], "");
    assert!(code == 2 && err.contains("1.7"), "{err}");
}

/// A window scales the bands and leaves the first one unchanged. A ground of albedo 1 under the sky adds its own
/// irradiance over π below the horizon.
#[test]
fn windows_and_ground() {
    let input = "sun_zenith,turbidity\n0.7,3\n";
    let run = |extra: &[&str]| {
        let (code, out, _) =
            mesophyll(&[&["--quiet", "eval", "sky", "--method", "direct", "--bands", "7"], extra].concat(), input);
        assert_eq!(code, 0, "{extra:?}");
        coefficients(&table(&out).1, 49).remove(0)
    };
    let (plain, lanczos, zonal, lit) =
        (run(&[]), run(&["--window", "lanczos"]), run(&["--window", "zonal"]), run(&["--ground", "1"]));
    let sinc = |l: f64| (PI * l / 7.0).sin() / (PI * l / 7.0);
    assert_eq!(plain[0], lanczos[0]);
    // l = 2, with m = 1 and m = 0.
    assert!((lanczos[7][1] / plain[7][1] - sinc(2.0)).abs() < 1e-12 && zonal[7] == plain[7]);
    assert!((zonal[6][1] / plain[6][1] - sinc(2.0)).abs() < 1e-12);
    for c in 0..3 {
        let irradiance = plain[2][c] * (4.0 * PI / 3.0).sqrt();
        assert!(((lit[0][c] - plain[0][c]) / (irradiance / PI * 2.0 * PI / (4.0 * PI).sqrt()) - 1.0).abs() < 1e-12);
    }
    assert_eq!(mesophyll(&["--quiet", "eval", "sky", "--ground", "-1"], input).0, 2);
}

/// The sun of a table is that of textbooks: the noon sun stands at latitude minus declination in the south, it rises in
/// the east at an equinox, and the longest day has the declination of the tropic. What cannot be is refused by row.
#[test]
fn the_sun_stands_where_hour_latitude_and_season_put_it() {
    let run = |input: &str| mesophyll(&["--quiet", "eval", "sun"], input);
    let (code, out, _) =
        run("latitude_deg,hour,declination_deg\n50,12,20\n50,6,0\n-50,12,20\n50,0,0\n20,12,20\n95,12,0\n");
    assert_eq!(code, 0, "{out}");
    let (header, rows) = table(&out);
    assert_eq!(header[3..], ["sun_zenith_deg", "sun_azimuth_deg", "status"]);
    let number = |row: usize, k: usize| rows[row][k].parse::<f64>().unwrap();
    for (row, want) in [[30.0, -90.0], [90.0, 0.0], [70.0, 90.0], [130.0, -90.0]].iter().enumerate() {
        assert!((number(row, 3) - want[0]).abs() < 1e-9, "{:?}", rows[row]);
        // At midnight of the fourth row the sun is below the north.
        let azimuth = if row == 3 { 90.0 } else { want[1] };
        assert!((number(row, 4) - azimuth).abs() < 1e-9, "{:?}", rows[row]);
    }
    assert!(rows[..3].iter().all(|r| r[5] == "ok"), "{rows:?}");
    for (row, word) in [(3, "ok"), (4, "sun_azimuth_deg"), (5, "refused: latitude_deg is 95")] {
        assert!(rows[row][5].contains(word), "{:?}", rows[row]);
    }
    let (_, out, _) = run("latitude_deg,hour,day_of_year\n0,12,172\n0,12,355\n");
    let (_, rows) = table(&out);
    for (row, azimuth) in [(&rows[0], 90.0), (&rows[1], -90.0)] {
        let [zenith, at] = [3, 4].map(|k| row[k].parse::<f64>().unwrap());
        assert!((zenith - 23.44).abs() < 0.1 && (at - azimuth).abs() < 1e-6, "{row:?}");
    }
    for input in ["latitude_deg,hour\n0,12\n", "latitude_deg,hour,day_of_year,declination_deg\n0,12,1,0\n"] {
        let (code, _, said) = run(input);
        assert!(code == 2 && said.contains("declination_deg, day_of_year"), "{said}");
    }
}
