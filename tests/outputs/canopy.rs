//! `mesophyll eval canopy`: a canopy in closed form, and canopies that other programs have answers for.

use super::render::discs;
use crate::common::skips::data;
use crate::common::{refused, run, succeeded};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// A canopy scene: leaves (name, disc file, positions, ρ, τ), ground and sun.
fn canopy(
    dir: &Path,
    size_m: f64,
    leaves: &[(&str, &str, &str, f64, f64)],
    ground: f64,
    sun_zenith_deg: f64,
) -> PathBuf {
    let mut text = format!(
        "schema = 1\nname = \"canopy\"\n[periodic]\nsize_mm = [{0}, {0}]\n[ground]\nalbedo = [{ground}, {ground}, \
         {ground}]\n[sun]\nzenith_deg = {sun_zenith_deg}\nradius_deg = 0\nirradiance = [1, 1, 1]\n",
        size_m * 1e3
    );
    for (name, file, positions, rho, tau) in leaves {
        let (r, t) = (vec![rho.to_string(); 3].join(", "), vec![tau.to_string(); 3].join(", "));
        let _ = write!(
            text,
            "[[leaf]]\nname = \"{name}\"\ndiscs = \"{file}\"\nuniform = {{ rho_d = [[{r}], [{r}]], rho_t = [{t}] \
             }}\n[[instance]]\nleaf = \"{name}\"\npositions = \"{positions}\"\n"
        );
    }
    let path = dir.join("canopy.toml");
    std::fs::write(&path, text).unwrap();
    path
}

/// A table's columns by name, as numbers.
fn columns<const N: usize>(csv: &[u8], names: [&str; N]) -> Vec<[f64; N]> {
    let mut reader = csv::Reader::from_reader(csv);
    let header = reader.headers().unwrap().clone();
    let at = names.map(|n| header.iter().position(|h| h == n).unwrap());
    let number = |r: &csv::StringRecord, k: usize| r[k].parse().unwrap_or(f64::NAN);
    reader.records().map(|r| r.unwrap()).map(|r| at.map(|k| number(&r, k))).collect()
}

/// Level layers of discs that are so wide that they have no gaps. These are the plates of the closed form again, as a
/// canopy. The rectangle is smaller than a disc, so discs reach across many periods.
#[test]
fn a_closed_canopy_meets_its_closed_form() {
    let dir = tempfile::tempdir().unwrap();
    discs(dir.path(), "upper.txt", &[[3.0, 0.2, 0.1, 2.0, 0.0, 0.0, 1.0]]);
    std::fs::write(dir.path().join("at.txt"), "0 0 0\n").unwrap();
    let (rho, tau, ground, sun) = (0.4, 0.35, 0.3, 40.0);
    let scene = canopy(dir.path(), 1.0, &[("plate", "upper.txt", "at.txt", rho, tau)], ground, sun);
    std::fs::write(dir.path().join("d.csv"), "view_zenith_deg,view_azimuth_deg\n0,0\n55,130\n-70,10\n").unwrap();
    // Light between plate and ground, relative to the incident light: down D = τ + ρ U, up U = ground · D.
    let down = tau / (1.0 - rho * ground);
    let (reflected, absorbed) = (rho + tau * ground * down, (1.0 - rho - tau) * (1.0 + ground * down));
    let directions = dir.path().join("d.csv");
    let args = ["eval", "canopy", scene.to_str().unwrap(), "--directions", directions.to_str().unwrap()];
    let output = run(args.iter().copied().chain(["--samples", "20000"]));
    succeeded(&output);
    for [brf, error] in columns(&output.stdout, ["brf", "brf_err"]) {
        assert!(error < 0.01 && (brf - reflected).abs() < 4.0 * error + 1e-6, "{brf} ± {error}, expected {reflected}");
    }
    let output = run(["eval", "canopy", scene.to_str().unwrap(), "--fluxes", "--samples", "40000"]);
    succeeded(&output);
    let names = ["reflected", "reflected_err", "absorbed", "absorbed_err", "transmitted", "transmitted_err"];
    let [found] = columns(&output.stdout, names)[..] else { panic!("one row expected") };
    for (k, want) in [reflected, absorbed, down].into_iter().enumerate() {
        let (value, error) = (found[2 * k], found[2 * k + 1]);
        assert!(error < 0.005 && (value - want).abs() < 4.0 * error + 1e-6, "{}: {value} {want}", names[2 * k]);
    }
    let text = std::fs::read_to_string(&scene).unwrap();
    let other = dir.path().join("other.toml");
    for (text, words) in [
        (format!("{text}[sky]\nradiance = [1, 1, 1]\n"), "there is a [sky]"),
        (text.replace("sun_zenith", "").replace("zenith_deg = 40", "zenith_deg = 95"), "above the horizon"),
        (text.replace("size_mm = [1000, 1000]", "size_mm = [1000, 0]"), "periodic.size_mm: found 0"),
        (text.replace("size_mm = [1000, 1000]", "size_mm = [1000, 1e-6]"), "copies of what stands there"),
        (text.replace("irradiance = [1, 1, 1]", "irradiance = [1, 0, 1]"), "sun.irradiance: 0 in channel G"),
    ] {
        std::fs::write(&other, text).unwrap();
        refused(&run(["eval", "canopy", other.to_str().unwrap(), "--fluxes"]), 2, &["other.toml", words]);
    }
}

/// The plates again, at many wavelengths at once. Leaf and ground have spectra, black and white bands beside each
/// other, and what no row has lies on straight lines.
#[test]
fn bands_of_a_closed_canopy_meet_their_closed_forms() {
    let dir = tempfile::tempdir().unwrap();
    discs(dir.path(), "upper.txt", &[[3.0, 0.2, 0.1, 2.0, 0.0, 0.0, 1.0]]);
    std::fs::write(dir.path().join("at.txt"), "0 0 0\n").unwrap();
    let leaf = "wavelength_nm,R,T\n450,0,0\n550,0.1,0.05\n850,0.6,0.4\n950,0.3,0.2\n";
    let soil = "wavelength_nm,albedo\n400,0.1\n800,0.3\n850,1\n950,0\n";
    std::fs::write(dir.path().join("leaf.csv"), leaf).unwrap();
    std::fs::write(dir.path().join("soil.csv"), soil).unwrap();
    let scene = canopy(dir.path(), 1.0, &[("plate", "upper.txt", "at.txt", 0.4, 0.35)], 0.3, 40.0);
    let plain = std::fs::read_to_string(&scene).unwrap();
    let (before, after) = plain.split_once("uniform = {").unwrap();
    let after = after.split_once("}\n").unwrap().1;
    let text = format!("{before}uniform = {{ spectrum = \"leaf.csv\" }}\n{after}");
    let text = text.replace("albedo = [0.3, 0.3, 0.3]", "spectrum = \"soil.csv\"");
    std::fs::write(&scene, &text).unwrap();
    let directions = dir.path().join("d.csv");
    std::fs::write(&directions, "view_zenith_deg,view_azimuth_deg\n0,0\n55,130\n").unwrap();
    let args = |scene: &Path, bands: &str| -> Vec<String> {
        let scene = scene.to_str().unwrap();
        let directions = directions.to_str().unwrap();
        ["eval", "canopy", scene, "--directions", directions, "--samples", "16384", "--bands", bands]
            .map(String::from)
            .to_vec()
    };
    let output = run(args(&scene, "850,450,700,950"));
    succeeded(&output);
    let found = columns(&output.stdout, ["brf_850", "brf_450", "brf_700", "brf_950"]);
    let errors = columns(&output.stdout, ["brf_850_err", "brf_450_err", "brf_700_err", "brf_950_err"]);
    assert_eq!(found.len(), 2);
    for (found, errors) in found.iter().zip(&errors) {
        for (k, [rho, tau, ground]) in
            [[0.6, 0.4, 1.0], [0.0, 0.0, 0.125], [0.35, 0.225, 0.25], [0.3, 0.2, 0.0]].into_iter().enumerate()
        {
            let want = rho + tau * ground * tau / (1.0 - rho * ground);
            let (brf, error) = (found[k], errors[k]);
            assert!(error < 0.01 && (brf - want).abs() < 4.0 * error + 1e-6, "{k}: {brf} ± {error}, {want}");
        }
    }
    // All wavelengths that both spectra cover.
    // Where the light of each wavelength goes: a row each, relative to what falls on the plate.
    let fluxes =
        ["eval", "canopy", scene.to_str().unwrap(), "--fluxes", "--samples", "16384", "--bands", "850,450,700"];
    let output = run(fluxes);
    succeeded(&output);
    let names = ["wavelength_nm", "reflected", "reflected_err", "absorbed", "absorbed_err", "transmitted"];
    let found = columns(&output.stdout, names);
    assert_eq!(found.iter().map(|row| row[0]).collect::<Vec<_>>(), [850.0, 450.0, 700.0]);
    for (row, [rho, tau, ground]) in found.iter().zip([[0.6, 0.4, 1.0], [0.0, 0.0, 0.125], [0.35, 0.225, 0.25]]) {
        let down = tau / (1.0 - rho * ground);
        let (up, taken) = (rho + tau * ground * down, (1.0 - rho - tau) * (1.0 + ground * down));
        assert!((row[1] - up).abs() < 4.0 * row[2] + 1e-6, "{row:?}, expected {up}");
        assert!((row[3] - taken).abs() < 4.0 * row[4] + 1e-6, "{row:?}, expected {taken}");
        assert!((row[5] - down).abs() < 0.05 * down.max(0.1), "{row:?}, expected {down}");
    }
    let output = run(args(&scene, "all"));
    succeeded(&output);
    let header = String::from_utf8(output.stdout).unwrap().lines().next().unwrap().to_string();
    for nm in [450, 550, 800, 850, 950] {
        assert!(header.contains(&format!("brf_{nm},brf_{nm}_err")), "{header}");
    }
    assert!(!header.contains("brf_400"), "{header}");
    std::fs::write(dir.path().join("bands.csv"), "wavelength_um\n0.55\n0.8\n").unwrap();
    let output = run(args(&scene, dir.path().join("bands.csv").to_str().unwrap()));
    succeeded(&output);
    assert_eq!(columns(&output.stdout, ["brf_550", "brf_800"]).len(), 2);
    let other = dir.path().join("other.toml");
    for (text, bands, words) in [
        (text.as_str(), "450,450", "--bands has 450 nm twice"),
        (&text, "400", "leaf.csv: it has 450 to 950 nm, and 400 nm is asked for"),
        (&text, "none.csv", "none.csv"),
        (&text.replace("spectrum = \"soil.csv\"", "albedo = [0.1, 0.1, 0.1]"), "550", "ground: three channels"),
        (&plain, "550", "leaf \"plate\": three channels say nothing of single wavelengths"),
        (&plain, "all", "no leaf and no ground has a spectrum"),
        (&text.replace("leaf.csv\"", "leaf.csv\", rho_t = [0, 0, 0]"), "550", "expected both rho_d and rho_t"),
        (&text.replace("leaf.csv\"", "leaf.csv\", rho_s = [0.1, 0.2, 0.1]"), "550", "rho_s differs between channels"),
        (&text.replace("leaf.csv", "soil.csv"), "550", "R: no such column; a leaf needs wavelength_nm, R and T"),
        (&text.replace("soil.csv", "d.csv"), "550", "wavelength_nm: no such column"),
    ] {
        std::fs::write(&other, text).unwrap();
        refused(&run(args(&other, bands)), 2, &[words]);
    }
    // Four wavelengths are no colours, which nothing but a picture needs.
    let mut all: Vec<String> = args(&scene, "550")[..7].to_vec();
    refused(&run(all.clone()), 2, &["canopy.toml", "leaf.csv has no colours"]);
    all.extend(["--bands".into(), "550".into(), "--channel".into(), "R".into()]);
    assert_eq!(run(all).status.code(), Some(2), "bands and a channel at once");
    std::fs::write(dir.path().join("leaf.csv"), "wavelength_nm,R,T\n450,0.6,0.5\n").unwrap();
    refused(&run(args(&scene, "450")), 2, &["leaf.csv: at 450 nm R + T is 1.1"]);
}

/// RAMI's floating spheres and its "real zoom in" are compared with the results of other programs (ROMC): 76 directions
/// each, by a χ² test of the differences.
#[test]
fn published_canopies_are_met() {
    let Some(rami) = data("canopies with answers by others").map(|folder| folder.join("rami")) else { return };
    let dir = tempfile::tempdir().unwrap();
    let unpacked = |name: &str| {
        let file = std::fs::File::open(rami.join(format!("{name}.txt.gz"))).unwrap();
        let mut text = String::new();
        std::io::Read::read_to_string(&mut flate2::read::GzDecoder::new(file), &mut text).unwrap();
        std::fs::write(dir.path().join(format!("{name}.txt")), text).unwrap();
    };
    for name in ["het01_discs", "het04_sphere_discs", "het04_cylinder_discs"] {
        unpacked(name);
    }
    for name in ["het01_instances.txt", "het04_sphere_positions.txt", "het04_cylinder_positions.txt"] {
        std::fs::copy(rami.join(name), dir.path().join(name)).unwrap();
    }
    let het01 = [("sphere", "het01_discs.txt", "het01_instances.txt", 0.4957, 0.4409)];
    let het04 = [
        ("sphere", "het04_sphere_discs.txt", "het04_sphere_positions.txt", 0.49, 0.41),
        ("cylinder", "het04_cylinder_discs.txt", "het04_cylinder_positions.txt", 0.45, 0.3),
    ];
    let known = std::fs::read(rami.join("romc_brfpp.csv")).unwrap();
    let names = csv::Reader::from_reader(known.as_slice()).into_records().map(|r| r.unwrap()[0].to_string());
    let names: Vec<String> = names.collect();
    let known = columns(&known, ["view_zenith_deg", "brf", "brf_se"]);
    for (name, leaves, size_m, ground) in [("het01", &het01[..], 100.0, 0.159), ("het04", &het04[..], 270.0, 0.15)] {
        let scene = canopy(dir.path(), size_m, leaves, ground, 20.0);
        let known: Vec<[f64; 3]> = names.iter().zip(&known).filter(|(n, _)| *n == name).map(|(_, row)| *row).collect();
        // A view without an azimuth lies in the sun's plane. Negative angles are on the sun's side, as in the table.
        let rows: Vec<String> = known.iter().map(|k| k[0].to_string()).collect();
        let file = dir.path().join("directions.csv");
        std::fs::write(&file, format!("view_zenith_deg\n{}\n", rows.join("\n"))).unwrap();
        let args = ["eval", "canopy", scene.to_str().unwrap(), "--directions", file.to_str().unwrap()];
        let output = run(args.iter().copied().chain(["--samples", "2048"]));
        succeeded(&output);
        let found = columns(&output.stdout, ["brf", "brf_err"]);
        assert_eq!(found.len(), 76);
        let (mut statistic, mut ratio, mut spread) = (0.0, 0.0, 0.0);
        for ([brf, error], [_, want, theirs]) in found.iter().zip(&known) {
            assert!(*error < 0.05 * want, "{name}: {error}");
            statistic += (brf - want).powi(2) / (error * error + theirs * theirs);
            ratio += brf / want / 76.0;
            spread += (error / want / 76.0).powi(2);
        }
        // Wilson & Hilferty 1931: values above 2.33 have a probability of 1 % by chance.
        let z = ((statistic / 76f64).cbrt() - (1.0 - 2.0 / (9.0 * 76.0))) / (2.0 / (9.0 * 76.0f64)).sqrt();
        assert!(z < 2.33, "{name}: chi² of 76 directions {statistic}");
        assert!((ratio - 1.0).abs() < 3.0 * spread.sqrt(), "{name}: mean ratio {ratio} ± {}", spread.sqrt());
    }
}
