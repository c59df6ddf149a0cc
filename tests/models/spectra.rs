//! Whole spectra: `fit foliar` and `fit slab` on tables with a row for each wavelength.

use assert_cmd::Command;
use std::collections::HashMap;
use std::path::Path;

/// A made-up table of pigments with a row every 10 nm, whose absorption and indices vary like those of a leaf.
fn pigments() -> String {
    let mut text =
        "wavelength_nm,chlorophyll_cm2_g,carotenoid_cm2_g,protein_cm2_g,cellulose_lignin_cm2_g,water_per_cm,\
                    n_cuticle,n_mesophyll,n_antidermal\n"
            .to_string();
    for k in 0..=90 {
        let w = 400.0 + 10.0 * f64::from(k);
        let bell = |at: f64, width: f64| (-((w - at) / width).powi(2)).exp();
        let chlorophyll = 4.5e4 * bell(440.0, 40.0) + 3e4 * bell(660.0, 40.0) + 9e3 * bell(560.0, 80.0);
        let water = 0.4 * bell(970.0, 40.0) + 1.2 * bell(1200.0, 70.0) + 1e-3;
        // The indices have three steps, so that few leaves must be computed.
        let n = 1.53 - 0.02 * (0.0033 * (w - 400.0)).floor();
        let m = 1.42 - 0.002 * (0.0033 * (w - 400.0)).floor();
        text += &format!("{w},{chlorophyll},{},10,4.4,{water},{n},{m},{}\n", 5e4 * bell(460.0, 45.0), m - 0.0055);
    }
    text
}

fn run(args: &[&str], folder: &Path) -> String {
    let out = Command::cargo_bin("mesophyll").unwrap().args(args).current_dir(folder).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8(out.stdout).unwrap()
}

fn rows(text: &str) -> Vec<HashMap<String, String>> {
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    lines.map(|l| header.iter().map(|h| h.to_string()).zip(l.split(',').map(String::from)).collect()).collect()
}

#[test]
fn leaves_made_of_layers_are_found_in_their_spectra() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("pigments.csv"), pigments()).unwrap();
    // Two leaves every 30 nm, by the exact method.
    let mut asked =
        "leaf,wavelength_nm,incidence_deg,side,path,mesophyll_thickness_mm,n_cuticle,n_mesophyll,n_antidermal,\
                     chlorophyll_ug_cm2,carotenoid_ug_cm2,protein_ug_cm2,cellulose_lignin_ug_cm2,water_g_cm2,\
                     oblateness_epidermis\n"
            .to_string();
    let truth = [("oak", [40.0, 9.0, 0.012, 4.0]), ("a/b", [15.0, 4.0, 0.02, 8.0])];
    for (leaf, [chlorophyll, carotenoid, water, ob]) in truth {
        for w in (400..=1300).step_by(30) {
            asked += &format!("{leaf},{w},8,adaxial,sieve,0.1,,,,{chlorophyll},{carotenoid},0,0,{water},{ob}\n");
        }
    }
    std::fs::write(dir.path().join("asked.csv"), asked).unwrap();
    let table =
        run(&["eval", "abm", "--method", "exact", "--pigments", "pigments.csv", "--in", "asked.csv"], dir.path());
    let mut spectra = "leaf,wavelength_nm,R,T,h\n".to_string();
    for r in rows(&table) {
        spectra += &format!("{},{},{},{},0.1\n", r["leaf"], r["wavelength_nm"], r["reflectance"], r["transmittance"]);
    }
    // Of the last leaf one reading can be used.
    spectra += "far,2000,0.1,0.1,0.1\nbad,450,x,0.1,0.1\n";
    std::fs::write(dir.path().join("spectra.csv"), spectra).unwrap();
    let fit =
        ["fit", "foliar", "--pigments", "pigments.csv", "--noise", "0.002", "--in", "spectra.csv", "--plots", "plots"];
    let fit = [&fit[..], &["--fit", "chlorophyll,carotenoid,water,oblateness"]].concat();
    let found = rows(&run(&fit, dir.path()));
    assert_eq!(found.len(), 4);
    for (row, (leaf, truth)) in found.iter().zip(truth) {
        assert_eq!((row["leaf"].as_str(), row["status"].as_str()), (leaf, "ok"));
        let names = ["chlorophyll_ug_cm2", "carotenoid_ug_cm2", "water_g_cm2", "oblateness_epidermis"];
        for (name, truth) in names.into_iter().zip(truth) {
            let number = |name: &str| row[name].parse::<f64>().unwrap();
            // No noise was added. The remaining error is the interpolation between nodes.
            assert!((number(name) - truth).abs() < 0.3 * number(&format!("{name}_err")), "{leaf} {name}: {row:?}");
        }
    }
    let far = "refused: no reading (left out: line 64: wavelength_nm is 2000; the table of pigments has 400 to 1300";
    assert!(found[2]["status"].trim_matches('"').starts_with(far), "{}", found[2]["status"]);
    assert!(found[3]["status"].starts_with("ok") || found[3]["status"].starts_with("undetermined"));
    let svg = std::fs::read_to_string(dir.path().join("plots/a_b.svg")).unwrap();
    assert!(svg.contains("transmittance") && svg.contains("wavelength"));
    assert!(!dir.path().join("plots/far.svg").exists());

    // The slab's σa and σs of the same table.
    let slab =
        ["fit", "slab", "--columns", "rho_d=R,rho_t=T", "--noise", "0.002", "--in", "spectra.csv", "--plots", "slab"];
    let found = rows(&run(&slab, dir.path()));
    assert_eq!(found.len(), 64);
    let sigma = |row: &HashMap<String, String>| row["sigma_a"].parse::<f64>().unwrap_or(f64::NAN);
    // Red light is strongly absorbed, and infrared light hardly at all.
    let at = |w: &str| sigma(found.iter().find(|r| r["leaf"] == "oak" && r["wavelength_nm"] == w).unwrap());
    assert!(at("670") > 20.0 * at("850"), "{} {}", at("670"), at("850"));
    assert!(dir.path().join("slab/oak.svg").exists());
}

#[test]
fn what_is_no_spectrum_is_said() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("pigments.csv"), pigments()).unwrap();
    let said = |table: &str, more: &[&str]| {
        std::fs::write(dir.path().join("in.csv"), table).unwrap();
        let args = [&["fit", "foliar", "--pigments", "pigments.csv", "--in", "in.csv"], more].concat();
        let out = Command::cargo_bin("mesophyll").unwrap().args(args).current_dir(dir.path()).output().unwrap();
        assert_eq!(out.status.code(), Some(2));
        String::from_utf8(out.stderr).unwrap()
    };
    assert!(said("wavelength_nm,R\n500,0.1\n500,0.2\n", &[]).contains("leaf: no such column"));
    let numbered = said("leaf,R1,T1,R2,T2\na,0.1,0.1,0.1,0.1\n", &[]);
    assert!(
        numbered.contains("R1, T1, R2, T2 are numbered like replicates") && numbered.contains("R_err"),
        "{numbered}"
    );
    let header: Vec<String> = (350..2500).map(|w| w.to_string()).collect();
    let bare = said(&format!("leaf,{}\na{}\n", header.join(","), ",0.1".repeat(2150)), &[]);
    assert!(bare.contains("350, 351, 352, 353 and so on look like wavelengths") && bare.len() < 500, "{bare}");
    let fractions = said("leaf,R500,T500\na,0.1,0.2\n", &["--percent"]);
    assert!(fractions.contains("fractions of 1 already"), "{fractions}");
    assert!(said("leaf,wavelength_nm,albedo\na,500,0.1\n", &[]).contains("expected R or T beside wavelength_nm"));
    assert!(said("leaf,R500\na,0.1\n", &["--plots", "p"]).contains("--plots draws spectra in long form"));
    let out = Command::cargo_bin("mesophyll")
        .unwrap()
        .args(["fit", "slab", "--in", "in.csv", "--plots", "p", "--columns", "rho_d=R500,rho_t=R500,h=R500"])
        .current_dir(dir.path())
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(2));
}

/// The same table in three forms: with the column names of `fit slab`, with a row for each wavelength, and with a row
/// for each leaf.
#[test]
fn spectra_are_the_same_in_long_and_in_wide_form() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    write("plain.csv", "rho_d,rho_t,h,rho_t_err\n0.1,0.14,0.2,0.004\n0.2,0.3,0.2,0.004\n0.05,0.06,0.1,\n0.15,,0.1,\n");
    write(
        "long.csv",
        "leaf,wavelength_nm,R,T,thickness_um,T_err\na,550,0.1,0.14,200,0.004\na,800,0.2,0.3,200,0.004\n\
         b,550,0.05,0.06,100,\nb,800,0.15,,100,\n",
    );
    write(
        "wide.csv",
        "leaf_id,T800,R800,thickness_um,note,R550,T550,R900,T800_err,T550_err\n\
         a,0.3,0.2,200,x,0.1,0.14,0.3,0.004,0.004\nb,,0.15,100,,0.05,0.06,0.3,,\n",
    );
    let found = |name: &str, more: &[&str]| {
        let args = ["fit", "slab", "--noise", "0.002", "--surface", "0.01", "--in", name];
        rows(&run(&[&args[..], more].concat(), dir.path()))
    };
    let (plain, long, wide) =
        (found("plain.csv", &[]), found("long.csv", &[]), found("wide.csv", &["--plots", "plots"]));
    assert_eq!([plain.len(), long.len(), wide.len()], [4; 3]);
    for name in ["sigma_a", "sigma_s", "sigma_a_err", "sigma_s_err"] {
        let of = |rows: &[HashMap<String, String>]| rows.iter().map(|r| r[name].clone()).collect::<Vec<_>>();
        // The last row has no transmittance.
        let numbers = |rows: &[HashMap<String, String>]| {
            of(rows).iter().map(|c| c.parse::<f64>().unwrap_or(f64::NAN)).collect::<Vec<_>>()
        };
        let (p, l, w) = (numbers(&plain), numbers(&long), numbers(&wide));
        assert!(p[..3].iter().all(|v| *v > 0.0) && p[3].is_nan(), "{name}: {p:?}");
        for k in 0..3 {
            // 200 times a thousandth is not exactly 0.2.
            assert!((l[k] / p[k] - 1.0).abs() < 1e-12, "{name}, row {k}: {} and {}", l[k], p[k]);
        }
        assert_eq!(of(&long), of(&wide), "{name}");
        assert!(l[3].is_nan() && w[3].is_nan());
    }
    let which: Vec<_> = wide.iter().map(|r| (r["leaf_id"].as_str(), r["wavelength_nm"].as_str())).collect();
    assert_eq!(which, [("a", "550"), ("a", "800"), ("b", "550"), ("b", "800")]);
    assert_eq!(
        (plain[3]["status"].as_str(), wide[3]["status"].as_str()),
        ("refused: rho_t is empty", "refused: T800 is empty")
    );
    assert!(dir.path().join("plots/a.svg").exists() && dir.path().join("plots/b.svg").exists());
}

/// The same two leaves in the forms in which people have them give the same numbers by `fit slab`.
#[test]
fn spectra_are_read_in_the_forms_that_people_have() {
    let dir = tempfile::tempdir().unwrap();
    let found = |text: &str, more: &[&str]| {
        std::fs::write(dir.path().join("in.csv"), text).unwrap();
        let args = [&["fit", "slab", "--noise", "0.002", "--in", "in.csv"], more].concat();
        let out = Command::cargo_bin("mesophyll").unwrap().args(args).current_dir(dir.path()).output().unwrap();
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        // The exit code is 1 where every row is refused.
        assert!(matches!(out.status.code(), Some(0 | 1)), "{text}: {said}");
        (rows(&String::from_utf8(out.stdout).unwrap()), said)
    };
    let numbers = |rows: &[HashMap<String, String>]| -> Vec<f64> {
        let of = |r: &HashMap<String, String>| ["sigma_a", "sigma_s_err"].map(|n| r[n].parse().unwrap_or(f64::NAN));
        rows.iter().flat_map(of).collect()
    };
    let plain = "leaf,wavelength_nm,R,T,thickness_um\na,550,0.1,0.14,200\na,800,0.2,0.3,200\nb,550,0.05,0.06,100\n\
                 b,800,0.15,0.2,100\n";
    let want = numbers(&found(plain, &[]).0);
    assert!(want.iter().all(|v| *v > 0.0));
    let forms = [
        // Names and units.
        "sample;Wavelength (um);Reflectance;Transmittance;Thickness (um)\na;0,55;0,1;0,14;200\na;0,8;0,2;0,3;200\n\
         b;0,55;0,05;0,06;100\nb;0,8;0,15;0,2;100\n",
        "# a spectrometer\n#leaf,wl,R(adaxial),T(adaxial),R(abaxial),T(abaxial),thickness_um\n\
         a,550,0.1,0.14,0.3,0.1,200\na,800,0.2,0.3,0.3,0.1,200\n\
         b,550,0.05,0.06,0.3,0.1,100\nb,800,0.15,0.2,0.3,0.1,100\n",
        // A row a leaf.
        "leaf\tthickness_um\trefl_550\ttrans_550\trefl_800\ttrans_800\na\t200\t0.1\t0.14\t0.2\t0.3\n\
         b\t100\t0.05\t0.06\t0.15\t0.2\n",
        "leaf,thickness_um,R0.55,T0.55,R0.8,T0.8\na,200,0.1,0.14,0.2,0.3\nb,100,0.05,0.06,0.15,0.2\n",
        // Two rows a leaf.
        "leaf,type,thickness_um,550,800\na,R,200,0.1,0.2\na,T,200,0.14,0.3\nb,R,100,0.05,0.15\nb,T,100,0.06,0.2\n",
        "leaf;Mode;thickness_um;X550;X800\na;Reflectance;200;0,1;0,2\na;Absorbance;200;7;7\n\
         b;Reflectance;100;0,05;0,15\na;Transmittance;200;0,14;0,3\nb;Transmittance;100;0,06;0,2\n",
        "leaf,quantity,wavelength,value,thickness_um\na,R,550,0.1,200\na,R,800,0.2,200\n\
         a,T,550,0.14,200\na,T,800,0.3,200\nb,T,550,0.06,100\nb,T,800,0.2,100\nb,R,550,0.05,100\nb,R,800,0.15,100\n",
    ];
    for form in forms {
        let (rows, said) = found(form, &[]);
        let got = numbers(&rows);
        assert_eq!(got.len(), want.len(), "{form}: {said}");
        assert!(got.iter().zip(&want).all(|(g, w)| (g / w - 1.0).abs() < 1e-9), "{form}: {rows:?}");
    }
    // Per cent is refused until it is said.
    let percent =
        "leaf,wavelength_nm,R,T,thickness_um\na,550,10,14,200\na,800,20,30,200\nb,550,5,6,100\nb,800,15,20,100\n";
    let (rows, _) = found(percent, &[]);
    let all = rows.iter().all(|r| r["status"].starts_with("refused: R is") && r["status"].contains("add --percent"));
    assert!(all && rows.len() == 4, "{rows:?}");
    let got = numbers(&found(percent, &["--percent"]).0);
    assert!(got.iter().zip(&want).all(|(g, w)| (g / w - 1.0).abs() < 1e-9), "{got:?}");
    // Cells that say that there is no reading.
    let holes = "leaf,thickness_um,R550,T550,R800,T800\na,200,NA,-9999,0.2,0.3\nb,100,0.05,oops,-999,0.2\n";
    let status: Vec<String> = found(holes, &[]).0.iter().map(|r| r["status"].clone()).collect();
    assert!(
        status[0].contains("R550 is empty") && status[1] == "ok" && status[3].contains("R800 is empty"),
        "{status:?}"
    );
    assert!(status[2].contains("T550 is") && status[2].contains("oops"), "{status:?}");
}

/// A bad reading costs itself, a clash of names is refused before anything is computed, and one leaf needs no name.
#[test]
fn a_leaf_survives_its_bad_readings() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("pigments.csv"), pigments()).unwrap();
    let fit = |text: &str, more: &[&str]| {
        std::fs::write(dir.path().join("oak.csv"), text).unwrap();
        let args = ["fit", "foliar", "--pigments", "pigments.csv", "--noise", "0.002", "--in", "oak.csv"];
        let out =
            Command::cargo_bin("mesophyll").unwrap().args(args).args(more).current_dir(dir.path()).output().unwrap();
        let [out_text, said] = [out.stdout, out.stderr].map(|b| String::from_utf8(b).unwrap());
        (rows(&out_text), said, out.status.code())
    };
    let good = "450,0.055,0.02\n550,0.15,0.16\n650,0.07,0.06\n";
    let columns = ["chlorophyll_ug_cm2", "carotenoid_ug_cm2", "rms"];
    let of = |rows: &[HashMap<String, String>]| columns.map(|c| rows[0][c].clone());
    let (plain, ..) = fit(
        &format!("leaf,wavelength_nm,R,T\n{}", good.lines().map(|l| format!("oak,{l}\n")).collect::<String>()),
        &[],
    );
    // No column of leaves: the file names the leaf. Its bad readings are left out and said.
    let bad = "wl,R,T\n".to_string() + good + "500,-9999,NA\n600,x,7\n2400,0.1,0.1\n";
    let (rows, said, code) = fit(&bad, &[]);
    assert_eq!((code, rows.len(), rows[0]["leaf"].as_str()), (Some(0), 1, "oak"), "{said}");
    assert_eq!(of(&rows), of(&plain), "{said}");
    assert!(
        said.contains("4 readings left out of leaf: oak: line 6: R is \"x\"; expected a number; line 6: T is 7"),
        "{said}"
    );
    // The wide form.
    let header = "R450,T450,R550,T550,R650,T650,R500,T500,R2400";
    let (rows, said, _) = fit(&format!("{header}\n0.055,0.02,0.15,0.16,0.07,0.06,oops,-9999,0.1\n"), &[]);
    assert_eq!(of(&rows), of(&plain), "{said}");
    assert!(
        said.contains("1 reading left out: line 2: R500 is \"oops\"")
            && said.contains("1 column outside 400 to 1300 nm"),
        "{said}"
    );
    // Many wavelengths take seconds to prepare; a wrong name or path takes none of them.
    let many: Vec<String> = (400..1300).map(|w| format!("R{w},T{w}")).collect();
    let table = format!("{},chlorophyll_ug_cm2\n{}7\n", many.join(","), "0.1,0.1,".repeat(many.len()));
    let start = std::time::Instant::now();
    let (_, said, code) = fit(&table, &[]);
    assert!(code == Some(2) && said.contains("chlorophyll_ug_cm2: the input already has this output column"), "{said}");
    let (_, said, code) = fit(&table.replace("chlorophyll", "note"), &["-o", "oak.csv"]);
    assert!(code == Some(2) && said.contains("is what is to be read"), "{said}");
    assert!(start.elapsed().as_secs_f64() < 5.0, "{:?}", start.elapsed());
}
