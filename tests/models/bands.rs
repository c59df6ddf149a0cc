//! `eval bands` as a program: forms of tables, standard errors against noise that is really there, and refusals.

use crate::common::{refused, run, succeeded};
use rand::{RngExt, SeedableRng};
use std::collections::HashMap;
use std::path::Path;

fn rows(args: &[&str]) -> Vec<HashMap<String, String>> {
    let out = run([&["eval", "bands"], args].concat());
    succeeded(&out);
    csv::Reader::from_reader(out.stdout.as_slice()).deserialize().map(|row| row.unwrap()).collect()
}

fn number(row: &HashMap<String, String>, name: &str) -> f64 {
    row[name].parse().unwrap_or_else(|_| panic!("{name} is {:?}", row[name]))
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A Gaussian number by the sum of twelve even ones.
fn noise(stream: &mut rand_pcg::Pcg64) -> f64 {
    (0..12).map(|_| stream.random_range(0.0..1.0)).sum::<f64>() - 6.0
}

/// 400 leaves of one spectrum with noise of 1 %: their bands scatter by the stated errors around those of the spectrum.
#[test]
fn errors_of_bands_are_their_scatter() {
    let dir = tempfile::tempdir().unwrap();
    let (path, one) = (dir.path().join("many.csv"), dir.path().join("one.csv"));
    let spectrum = |nm: u32| 0.05 + 0.1 * (-((f64::from(nm) - 550.0) / 45.0).powi(2)).exp();
    let mut stream = rand_pcg::Pcg64::seed_from_u64(7);
    let mut table = "leaf,wavelength_nm,R\n".to_string();
    for leaf in 0..400 {
        for nm in (390..=730).step_by(10) {
            table += &format!("{leaf},{nm},{}\n", spectrum(nm) + 0.01 * noise(&mut stream));
        }
    }
    std::fs::write(&path, table).unwrap();
    // The same in one row, by columns in per cent.
    let columns: Vec<u32> = (390..=730).step_by(10).collect();
    let header: Vec<String> = columns.iter().map(|nm| format!("R{nm}")).collect();
    let cells: Vec<String> = columns.iter().map(|nm| format!("{}", 100.0 * spectrum(*nm))).collect();
    std::fs::write(&one, format!("{}\n{}\n", header.join(","), cells.join(","))).unwrap();
    let many = rows(&["--noise", "0.01", "--in", text(&path)]);
    let exact = &rows(&["--percent", "--in", text(&one)])[0];
    assert_eq!((many.len(), exact["r_g_err"].as_str()), (400, ""));
    for name in ["r_r", "r_g", "r_b"] {
        let truth = number(exact, name);
        let error = number(&many[0], &format!("{name}_err"));
        let off: Vec<f64> = many.iter().map(|row| number(row, name) - truth).collect();
        let mean = off.iter().sum::<f64>() / 400.0;
        let scatter = (off.iter().map(|v| v * v).sum::<f64>() / 400.0).sqrt();
        // 400 draws give a scatter to 3.5 %.
        assert!((scatter / error - 1.0).abs() < 0.11, "{name}: {scatter} {error}");
        assert!(mean.abs() < 4.0 * error / 20.0, "{name}: {mean} {error}");
    }
}

#[test]
fn an_even_spectrum_is_grey_and_a_narrow_one_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.csv");
    let long = |list: &[(u32, f64)]| {
        let lines: String = list.iter().map(|(nm, v)| format!("{nm},{v},{}\n", 0.5 * v)).collect();
        std::fs::write(&path, format!("wavelength_nm,R,T\n{lines}")).unwrap();
    };
    // In any order.
    let even: Vec<(u32, f64)> = (0..21).rev().map(|k| (380 + 20 * k, 0.4)).collect();
    long(&even);
    let grey = &rows(&["--noise", "0", "--in", text(&path)])[0];
    for letter in ["r", "g", "b"] {
        let [r, t] = ["r", "t"].map(|q| number(grey, &format!("{q}_{letter}")));
        assert!((r - 0.4).abs() < 1e-9 && (t - 0.2).abs() < 1e-9, "{grey:?}");
    }
    let xyz = &rows(&["--response", "cie-1931", "--in", text(&path)])[0];
    assert!((number(xyz, "r_y") - 0.4).abs() < 1e-12 && number(xyz, "r_x") < number(xyz, "r_y"));
    let said = |list: &[(u32, f64)]| {
        long(list);
        let out = run(["eval", "bands", "--in", text(&path)]);
        assert_eq!(out.status.code(), Some(1));
        String::from_utf8(out.stdout).unwrap()
    };
    assert!(said(&even[..even.len() - 5]).contains("expected 400 to 700 nm at least"));
    assert!(said(&[even[0], even[10], even[20]]).contains("expected one every 20 nm"));
    long(&[&even[..], &even[5..6]].concat());
    refused(&run(["eval", "bands", "--in", text(&path)]), 2, &["680", "is there before"]);
    refused(&run(["eval", "bands", "--noise=-1", "--in", text(&path)]), 2, &["--noise is -1"]);
}

/// The mean of a straight line over a response is its value at the response's centroid: of a box its middle, of a
/// triangle the mean of its corners.
#[test]
fn bands_of_a_sensor_are_means_over_their_response() {
    let dir = tempfile::tempdir().unwrap();
    let (soil, response) = (dir.path().join("soil.csv"), dir.path().join("response.csv"));
    let line = |nm: f64| 0.001 * (nm - 400.0);
    let cells: String = (0..=40).map(|k| 430.0 + 7.5 * f64::from(k)).map(|nm| format!("{nm},{}\n", line(nm))).collect();
    std::fs::write(&soil, format!("wavelength_nm,R\n{cells}")).unwrap();
    // Responses in any unit and order; the second band is a triangle with corners at 600, 620 and 660 nm.
    std::fs::write(&response, "wavelength_nm,B2,B4\n660,0,0\n450,8,0\n600,8,0\n620,0,50\n").unwrap();
    let boxes = &rows(&["--response", "490:65, 560:35,665:30", "--noise", "0", "--in", text(&soil)])[0];
    for (name, nm) in [("r_490", 490.0), ("r_560", 560.0), ("r_665", 665.0)] {
        assert!((number(boxes, name) - line(nm)).abs() < 1e-9, "{name}: {boxes:?}");
    }
    let own = &rows(&["--response", text(&response), "--in", text(&soil)])[0];
    assert!((number(own, "r_B4") - line((600.0 + 620.0 + 660.0) / 3.0)).abs() < 1e-9, "{own:?}");
    // A box of 150 nm and a triangle of a base of 20 nm, by their areas.
    let centroid = (150.0 * 525.0 + 10.0 * (600.0 + 20.0 / 3.0)) / 160.0;
    assert!((number(own, "r_B2") - line(centroid)).abs() < 1e-9, "{own:?}");
    let run = |response: &str| run(["eval", "bands", "--response", response, "--in", text(&soil)]);
    let out = run("490:65,865:20");
    assert_eq!(out.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&out.stdout).contains("band 865: readings from 430 to 730 nm"));
    for (response, words) in [
        ("490:0", "expected a centre and a width"),
        ("490:65,560", "found 560"),
        ("490:65,490:10", "two bands have the centre 490"),
        ("srg", "expected srgb, cie-1931"),
    ] {
        // An argument that cannot be read is refused with the usage beside the sentence.
        let output = run(response);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && said.contains(words), "{said}");
    }
    std::fs::write(&response, "wavelength_nm,B2\n450,1\n500,-1\n").unwrap();
    refused(&run(text(&response)), 2, &["B2", "the response is -1 at 500 nm"]);
}
