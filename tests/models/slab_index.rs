//! `fit slab` and `eval slab` where the slab has an index of its own, where one coefficient is known, and where no leaf
//! has what the table says.

use assert_cmd::Command;

/// Exit code, rows by column, and what was said.
fn mesophyll(args: &[&str], input: &str) -> (i32, Vec<Vec<(String, String)>>, String) {
    let out = Command::cargo_bin("mesophyll").unwrap().args(args).write_stdin(input).output().unwrap();
    let said = String::from_utf8(out.stderr).unwrap();
    let mut reader = csv::Reader::from_reader(out.stdout.as_slice());
    let header: Vec<String> = reader.headers().unwrap().iter().map(String::from).collect();
    let rows = reader.records().map(|r| header.iter().cloned().zip(r.unwrap().iter().map(String::from)).collect());
    (out.status.code().unwrap(), rows.collect(), said)
}

fn cell<'a>(row: &'a [(String, String)], column: &str) -> &'a str {
    &row.iter().find(|(name, _)| name == column).unwrap_or_else(|| panic!("no {column} in {row:?}")).1
}

fn number(row: &[(String, String)], column: &str) -> f64 {
    cell(row, column).parse().unwrap_or_else(|_| panic!("{column} in {row:?}"))
}

/// Total reflectance and transmittance of a slab of index 1.41 by adding-doubling (iadpython 0.5.3, 32 quadrature
/// points, own error below 2e-5): ω, Δ, R, T.
const ADDING_DOUBLING: [[f64; 4]; 2] = [[0.5, 0.3, 0.068954, 0.723654], [0.99, 5.0, 0.573524, 0.253627]];

#[test]
fn an_index_agrees_with_adding_doubling_both_ways() {
    let mut slabs = String::from("omega,delta\n");
    let mut leaves = String::from("rho_d,rho_t,h\n");
    for [omega, delta, r, t] in ADDING_DOUBLING {
        slabs += &format!("{omega},{delta}\n");
        leaves += &format!("{r},{t},2\n");
    }
    for method in ["fast", "exact"] {
        let (code, rows, _) = mesophyll(&["--quiet", "eval", "slab", "--index", "1.41", "--method", method], &slabs);
        assert_eq!(code, 0);
        for (row, [_, _, r, t]) in rows.iter().zip(ADDING_DOUBLING) {
            assert!((number(row, "rho_d") - r).abs() < 3e-5 && (number(row, "rho_t") - t).abs() < 3e-5, "{row:?}");
            assert_eq!(cell(row, "status"), "ok");
        }
        let args = ["fit", "slab", "--index", "1.41", "--noise", "1e-4", "--method", method];
        let (code, rows, said) = mesophyll(&args, &leaves);
        assert_eq!(code, 0);
        assert!(said.contains("index 1.41") && said.contains("σs(1−g)"), "{said}");
        for (row, [omega, delta, ..]) in rows.iter().zip(ADDING_DOUBLING) {
            assert_eq!(cell(row, "status"), "ok");
            for (name, want) in [("sigma_a", (1.0 - omega) * delta / 2.0), ("sigma_s", omega * delta / 2.0)] {
                let off = (number(row, name) - want) / number(row, &format!("{name}_err"));
                assert!(off.abs() < 1.0, "{off} errors: {row:?}");
            }
        }
    }
}

#[test]
fn what_is_assumed_is_said() {
    let input = "rho_d,rho_t,h\n0.3,0.2,0.2\n";
    let (_, matched, said) = mesophyll(&["fit", "slab", "--noise", "0.001"], input);
    assert!(
        said.contains("index of its surroundings") && said.contains("--index N") && said.contains("σs(1−g)"),
        "{said}"
    );
    let (_, stated, _) = mesophyll(&["--quiet", "fit", "slab", "--noise", "0.001", "--index", "1"], input);
    assert_eq!(matched, stated);
    let (_, glass, _) = mesophyll(&["--quiet", "fit", "slab", "--noise", "0.001", "--index", "1.5"], input);
    assert!((number(&glass[0], "sigma_s") / number(&matched[0], "sigma_s") - 1.0).abs() > 0.05);
    for bad in [
        &["--index", "0.9"][..],
        &["--index", "nan"],
        &["--index", "4"],
        &["--index", "1.4", "--surface", "0.03"],
        &["--specular", "excluded"],
        &["--specular", "both"],
    ] {
        let (code, _, said) = mesophyll(&[&["fit", "slab"], bad].concat(), input);
        assert_eq!(code, 2, "{bad:?}: {said}");
    }
    for bad in [&["--index", "0.5"][..], &["--index", "1.4", "--method", "fn"]] {
        let (code, _, said) = mesophyll(&[&["eval", "slab"], bad].concat(), "omega,delta\n0.5,1\n");
        assert_eq!(code, 2, "{bad:?}: {said}");
    }
}

#[test]
fn more_or_less_than_the_faces_reflect_is_refused_by_name() {
    let input = "rho_d,rho_t,h\n0.01,0.5,0.2\n0.02,0.97,0.2\n0.7,0.5,0.2\n11.9,20.1,0.2\n";
    let (_, rows, _) = mesophyll(&["--quiet", "fit", "slab", "--index", "1.5", "--noise", "0.001"], input);
    let starts = |k: usize, want: &str| assert!(cell(&rows[k], "status").starts_with(want), "{:?}", rows[k]);
    starts(0, "refused: rho_d is 0.01; at this rho_t the faces of a slab of index 1.5 reflect 0.0");
    starts(1, "refused: rho_t is 0.97; the faces");
    starts(2, "refused: rho_d + rho_t");
    starts(3, "refused: rho_d is 11.9");
    assert!(cell(&rows[3], "status").contains("per cent"));
    // The first is a slab whose mirror reflection was left out.
    let args = ["--quiet", "fit", "slab", "--index", "1.5", "--noise", "0.001", "--specular", "excluded"];
    assert_eq!(cell(&mesophyll(&args, input).1[0], "status"), "ok");
}

#[test]
fn one_of_r_and_t_is_enough_beside_a_known_coefficient() {
    let both = "rho_d,rho_t,h\n0.3,0.2,0.2\n";
    let noise = ["--quiet", "fit", "slab", "--noise", "0.001"];
    let (_, whole, _) = mesophyll(&noise, both);
    let (a, s) = (number(&whole[0], "sigma_a"), number(&whole[0], "sigma_s"));
    // A whole column may be missing, or a cell.
    let table = format!(
        "leaf,rho_d,h,known_sigma_a,known_sigma_s,known_sigma_s_err\np,0.3,0.2,{a},,\nq,0.3,0.2,,{s},\n\
         r,0.3,0.2,,{s},{}\nt,0.3,0.2,,,\nu,0.3,0.2,{a},{s},\nv,0.3,0.2,-1,,\n",
        0.03 * s
    );
    let (code, rows, said) = mesophyll(&noise, &table);
    assert_eq!(code, 0, "{said}");
    for row in &rows[..3] {
        assert_eq!(cell(row, "status"), "ok");
        assert!((number(row, "sigma_a") / a - 1.0).abs() < 1e-5 && (number(row, "sigma_s") / s - 1.0).abs() < 1e-5);
    }
    assert_eq!(cell(&rows[0], "sigma_a_err"), "");
    assert!(number(&rows[0], "sigma_s_err") > 0.0);
    assert!(number(&rows[2], "sigma_a_err") > number(&rows[1], "sigma_a_err"));
    for (k, want) in [
        (3, "refused: rho_t is empty; one of rho_d and rho_t"),
        (4, "refused: known_sigma_a and known_sigma_s are both given"),
        (5, "refused: known_sigma_a is -1"),
    ] {
        assert!(cell(&rows[k], "status").starts_with(want), "{:?}", rows[k]);
    }
    let table =
        format!("rho_d,rho_t,h,known_sigma_a\n,0.2,0.2,{a}\n0.3,,0.2,{a}\n,,0.2,{a}\n0.3,0.2,0.2,{a}\n0.3,0.2,0.2,\n");
    let (_, rows, _) = mesophyll(&noise, &table);
    for k in [0, 1, 4] {
        assert_eq!(cell(&rows[k], "status"), "ok", "{:?}", rows[k]);
        assert!((number(&rows[k], "sigma_s") / s - 1.0).abs() < 1e-5, "{:?}", rows[k]);
    }
    assert!(cell(&rows[2], "status").starts_with("refused: rho_d and rho_t are both empty"));
    assert!(cell(&rows[3], "status").starts_with("refused: rho_d, rho_t and a known sigma are all given"));
    let (code, _, said) = mesophyll(&noise, "leaf,h,known_sigma_a,R450,T450\na,0.2,1,0.3,0.2\n");
    assert!(code == 2 && said.contains("known sigma"), "{code} {said}");
    // Without any of this a table still needs both.
    let (code, _, said) = mesophyll(&noise, "rho_d,h\n0.3,0.2\n");
    assert!(code == 2 && said.contains("rho_t"), "{code} {said}");
}

#[test]
fn what_no_leaf_has_is_never_ok() {
    let fit = |args: &[&str], text: &str| {
        mesophyll(&[&["--quiet", "fit", "slab", "--noise", "0.002"], args].concat(), text).1
    };
    for (column, thickness, hint) in [
        ("thickness_um", "0.21", "leaves have 10 to 10000 um; is it in mm?"),
        ("thickness_mm", "200", "leaves have 0.01 to 10 mm; is it in um?"),
        ("thickness_m", "0.2", "leaves have 0.00001 to 0.01 m; is it in mm?"),
        ("thickness_mm", "30", "leaves have 0.01 to 10 mm; is it in um?"),
    ] {
        let text = format!("leaf,rho_d,rho_t,{column}\na,0.3,0.2,{thickness}\nb,0.2,0,{thickness}\n");
        let rows = fit(&[], &text);
        for row in &rows {
            let status = cell(row, "status");
            assert!(status.starts_with("undetermined: sigma_a") && status.contains(hint), "{status}");
            assert!(number(row, "sigma_a") > 0.0, "the numbers stand: {row:?}");
        }
        assert_eq!(cell(&fit(&["--any-thickness"], &text)[0], "status"), "ok");
        // The wide form is the same.
        let wide = fit(&[], &format!("leaf,{column},R550,T550\na,{thickness},0.3,0.2\n"));
        assert!(cell(&wide[0], "status").contains(hint), "{wide:?}");
    }
    for (column, thickness) in
        [("thickness_mm", "2.65"), ("thickness_mm", "8"), ("thickness_um", "50"), ("h", "30"), ("h", "1e-4")]
    {
        let rows = fit(&[], &format!("rho_d,rho_t,{column}\n0.3,0.2,{thickness}\n"));
        assert_eq!(cell(&rows[0], "status"), "ok", "{column} {thickness}");
    }
    // A millionth of the light through 11 µm: more than any tissue absorbs.
    let exact = ["--quiet", "fit", "slab", "--noise", "1e-9"];
    let dark = "rho_d,rho_t,thickness_um\n0.01,1e-6,11\n";
    let status = |args: &[&str]| cell(&mesophyll(args, dark).1[0], "status").to_string();
    assert!(
        status(&exact).starts_with("undetermined: sigma_a; sigma_s (sigma_a is above 1000/mm"),
        "{}",
        status(&exact)
    );
    assert_eq!(status(&[&exact[..], &["--any-thickness"]].concat()), "ok");
}
