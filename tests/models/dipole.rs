//! `eval dipole` as a program, compared with sums that are written here.

use crate::common;
use std::io::Write;
use std::process::Stdio;

/// T of the sum of dipoles (H9 Eq. 3.8 with the corrected bracket). Terms are paired, beginning with the weakest.
fn dipole_sum([sigma_a, sigma_s, g, a]: [f64; 4], n: i32, d: f64, r: f64) -> f64 {
    let scattering = (1.0 - g) * sigma_s;
    let extinction = sigma_a + scattering;
    let (l, k) = (1.0 / extinction, (3.0 * sigma_a * extinction).sqrt());
    let zb = 2.0 * a / (3.0 * extinction);
    let mut sum = 0.0;
    for j in (-n..=n).rev() {
        let center = 2.0 * f64::from(j) * (d + 2.0 * zb);
        let pole = |z: f64| {
            let rho = (r * r + (d - z).powi(2)).sqrt();
            (d - z) * (1.0 + k * rho) * (-k * rho).exp() / rho.powi(3)
        };
        sum += pole(center + l) - pole(center - l - 2.0 * zb);
    }
    scattering / extinction / (4.0 * std::f64::consts::PI) * sum
}

const TABLE: [f64; 4] = [0.4, 10.2, 0.07, 1.0];

/// Rows of `eval dipole`: t (NaN where empty) and status.
fn eval(args: &[&str], input: &str) -> Vec<(f64, String)> {
    let mut child = common::mesophyll()
        .args(["eval", "dipole"])
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    common::succeeded(&output);
    let mut reader = csv::Reader::from_reader(&output.stdout[..]);
    let at = |name: &str, header: &csv::StringRecord| header.iter().position(|h| h == name).unwrap();
    let header = reader.headers().unwrap().clone();
    let (t, status) = (at("t", &header), at("status", &header));
    assert_eq!(status, header.len() - 1);
    reader
        .records()
        .map(|row| {
            let row = row.unwrap();
            (row[t].parse().unwrap_or(f64::NAN), row[status].to_string())
        })
        .collect()
}

#[test]
fn the_sum_is_the_papers_corrected_one() {
    let mut input = String::from("radius,note,thickness\n");
    let mut want = Vec::new();
    for d in [0.12, 0.15, 0.3, 0.5] {
        for r in [0.0, 0.05, 0.3, 0.8] {
            input += &format!("{r},x,{d}\n");
            want.push(dipole_sum(TABLE, 3, d, r));
        }
    }
    for (got, want) in eval(&[], &input).iter().zip(&want) {
        assert!((got.0 / want - 1.0).abs() < 1e-12, "{got:?} {want}");
        // Far from the beam, three dipoles are not enough for a thin blade, and the sum becomes negative.
        assert!(if *want > 0.0 { got.1 == "ok" } else { got.1.starts_with("undetermined: t: negative") }, "{got:?}");
    }
    // The printed factor (1 + σtr d e^(−σtr d)) would be far off, and negative at a distance.
    let options = ["--sigma-a", "1.5", "--sigma-s=8", "--g=-0.2", "--a", "1.3", "--dipoles", "7"];
    let got = eval(&options, "thickness,radius\n0.2,0.1\n");
    assert!((got[0].0 / dipole_sum([1.5, 8.0, -0.2, 1.3], 7, 0.2, 0.1) - 1.0).abs() < 1e-12);
    let one = eval(&["--dipoles", "0"], "thickness,radius\n0.2,0.1\n");
    assert!((one[0].0 / dipole_sum(TABLE, 0, 0.2, 0.1) - 1.0).abs() < 1e-12);
}

#[test]
fn where_diffusion_does_not_hold_the_status_says_so() {
    let got = eval(&[], "thickness,radius\n0.05,0.01\n0.1,0\n0.02,0.4\n0.3,0.1\n");
    for (row, (d, r)) in [(0.05, 0.01), (0.1, 0.0), (0.02, 0.4)].iter().enumerate() {
        assert!((got[row].0 / dipole_sum(TABLE, 3, *d, *r) - 1.0).abs() < 1e-11, "{:?}", got[row]);
        assert!(got[row].1.starts_with("undetermined: t: "), "{:?}", got[row]);
    }
    assert_eq!(got[3].1, "ok");
    // With hardly any absorption, seven dipoles leave out at least a quarter of the light.
    let few = eval(&["--sigma-a", "0.001"], "thickness,radius\n0.2,0.5\n");
    assert!(few[0].1.starts_with("undetermined: t: 3 dipoles leave out 67 %"), "{few:?}");
    assert!(few[0].0.is_finite());
    let many = eval(&["--sigma-a", "0.001", "--dipoles", "400"], "thickness,radius\n0.2,0.5\n");
    assert_eq!(many[0].1, "ok");
    assert!(eval(&["--sigma-a", "30"], "thickness,radius\n0.2,0.1\n")[0].1.starts_with("undetermined: t: "));
}

#[test]
fn images_are_the_converged_sum_and_thin_needs_no_minimum() {
    let input = "thickness,radius\n0.15,0.02\n0.2,0.3\n0.5,1\n0.05,0.1\n";
    let images = eval(&["--method", "images"], input);
    for (row, (d, r)) in [(0.15, 0.02), (0.2, 0.3), (0.5, 1.0)].iter().enumerate() {
        assert!((images[row].0 / dipole_sum(TABLE, 5000, *d, *r) - 1.0).abs() < 1e-9, "{:?}", images[row]);
        assert_eq!(images[row].1, "ok");
    }
    assert!(images[3].0.is_nan() && images[3].1.starts_with("refused: thickness is 0.05"), "{:?}", images[3]);
    for row in eval(&["--method", "thin"], input) {
        assert!(row.0 > 0.0 && row.1 == "ok", "{row:?}");
    }
}

#[test]
fn bad_rows_and_bad_options_are_named() {
    let got = eval(&[], "thickness,radius\n-1,0.1\n0.2,-0.1\nnan,0\noops,0\n0.2\n0,0.1\ninf,0\n0.2,1e9\n1e6,0\n");
    for (row, status) in [
        "refused: thickness is -1",
        "refused: radius is -0.1",
        "refused: thickness is",
        "refused: thickness is \"oops\"",
        "refused: 1 fields",
        "refused: thickness is 0;",
        "refused: thickness is inf",
    ]
    .iter()
    .enumerate()
    {
        assert!(got[row].1.starts_with(status) && got[row].0.is_nan(), "{:?}", got[row]);
    }
    // Far from the beam and deep in the leaf there is no light left, and no NaN.
    assert!(got[7].0 == 0.0 && got[8].0 == 0.0, "{got:?}");
    assert!(got[7..].iter().all(|row| row.1 == "ok"), "{got:?}");
    for (args, word) in
        [(["--g", "1"], "--g is 1"), (["--sigma-a", "-1"], "--sigma-a is -1"), (["--a", "0.5"], "--a is 0.5")]
    {
        let output = common::run(["eval", "dipole"].iter().chain(&args));
        common::refused(&output, 2, &[word]);
    }
}

/// Diffusion loses light that is strongly absorbed. At σa = 2/mm, the thin form transmits a quarter less through 1 mm
/// than the transport equation.
#[test]
fn a_total_that_is_far_off_the_transport_equation_is_not_ok() {
    for (sigma_a, words) in [("2", ["undetermined: t: the form's total is -", "ok"]), ("0.4", ["ok", "ok"])] {
        let rows = eval(&["--sigma-a", sigma_a, "--method", "thin"], "thickness,radius\n1,0.1\n0.2,0.1\n");
        for (row, word) in rows.iter().zip(words) {
            assert!(row.0 > 0.0 && row.1.starts_with(word), "{row:?}: {word}");
        }
    }
}
