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
